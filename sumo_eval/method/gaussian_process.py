"""Covariance of the zones' Gaussian process, Eq. 7, and the search for its hyperparameters by
marginal likelihood.

K = sf^2 exp(-|(x - x')/sl|^2 / 2) + sn^2 I: a smooth part with a length scale sl for each
coordinate, and a common noise. In addition, each training value has a variance of its own. The
likelihood is Alg. 2.1 of Rasmussen and Williams, Gaussian Processes for Machine Learning (2006),
its gradient their Eq. 5.9. scikit-learn's regressor finds the same hyperparameters (the tests
compare) in four times the time: it solves K X = I for the inverse, and builds an (n, n) derivative
for each hyperparameter.

Users: `method/zone_surface.py`, which has the seed and the first start. Fixed, as zones depend on
them: K, which a test compares with scikit-learn's to the bit; the generator and the order of its
draws; the method of the search, with scipy's default rule of when to stop.
"""

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import Bounds, minimize
from scipy.spatial.distance import pdist, squareform

from sumo_eval.trajectory import FloatArray


class Hyperparameters(NamedTuple):
    """Eq. 7: the constants of the covariance.

    signal: sf^2.
    length_scales: sl, one a coordinate.
    noise: sn^2.
    """

    signal: float
    length_scales: tuple[float, ...]
    noise: float

    @classmethod
    def of_logarithms(cls, theta: FloatArray) -> Self:
        """Hyperparameters from the vector that is optimised: log sf^2, log sl, log sn^2."""
        signal, *scales, noise = np.exp(theta).tolist()
        return cls(signal, tuple(scales), noise)

    @property
    def logarithms(self) -> FloatArray:
        """log sf^2, log sl, log sn^2."""
        return np.log([self.signal, *self.length_scales, self.noise])


def covariance(points: FloatArray, parameters: Hyperparameters) -> FloatArray:
    """Eq. 7: K of training points, (n, n), without the training values' own variances.

    points: x, (n, k), each coordinate scaled to 0..1 by `zone_surface.fit`.
    parameters: sf^2, sl (k,), sn^2, without unit.
    """
    between = pdist(points / np.array(parameters.length_scales), "sqeuclidean")
    between *= -0.5
    np.exp(between, out=between)
    between *= parameters.signal
    k = squareform(between)
    k[np.diag_indices_from(k)] = parameters.signal + parameters.noise
    return k


Likelihood = Callable[[FloatArray], tuple[float, FloatArray]]
"""-log p(y | x, theta) at theta (log sf^2, log sl (k,), log sn^2), (k + 2,), and its gradient,
(k + 2,). Infinite where K is not positive definite in floating point.
"""


def marginal_likelihood(
    points: FloatArray, target: FloatArray, variances: FloatArray
) -> Likelihood:
    """The function that the hyperparameters theta minimise.

    points: x, (n, k), unit box.
    target: y, (n,), within -1..1.
    variances: of each target, added to K's diagonal, (n,).
    """
    n = len(target)
    # Squared distances along each coordinate, (k, n*n), doubled above the diagonal and 0 below it.
    # `by_scales` below sums their products with a symmetric matrix, of which LAPACK gives only the
    # upper half.
    squares = (points.T[:, :, None] - points.T[:, None, :]) ** 2
    squares = 2.0 * np.triu(squares).reshape(points.shape[1], -1)

    def at(theta: FloatArray) -> tuple[float, FloatArray]:
        """The value at theta, and its gradient."""
        parameters = Hyperparameters.of_logarithms(theta)
        k = covariance(points, parameters)
        k[np.diag_indices_from(k)] += variances
        # Cholesky: K = factor factor^T. K is symmetric, and `k.T` has Fortran's order of elements,
        # which LAPACK needs. `k` is not overwritten.
        factor, status = lapack.dpotrf(k.T, lower=1, clean=1)
        if status:  # K is not positive definite
            return np.inf, np.zeros(len(theta))
        weights, _ = lapack.dpotrs(factor, target, lower=1)  # K^-1 y
        value = (
            0.5 * float(target @ weights)
            + float(np.log(factor.diagonal()).sum())
            + 0.5 * n * np.log(2.0 * np.pi)
        )
        inverse, _ = lapack.dpotri(factor, lower=1, overwrite_c=1)
        # Eq. 5.9: d log p / d theta = tr(inner dK/dtheta) / 2, inner = weights weights^T - K^-1
        inner = np.outer(weights, weights)
        # dpotri fills the lower triangle alone, which is the upper one of `inverse.T`: below its
        # diagonal `inner` is wrong, and `squares` is 0 there
        inner -= inverse.T
        diagonal = inner.diagonal().copy()
        by_noise = parameters.noise * float(diagonal.sum())
        # K has the variances on its diagonal: dK / d log sf^2 = K - sn^2 I - diag(variances). So
        # tr(inner dK) has three terms. The first is tr(inner K) = weights^T y - n, because
        # K weights = y.
        by_signal = float(target @ weights) - n - by_noise - float(diagonal @ variances)
        # dK / d log sl = K (x - x')^2 / sl^2 for each coordinate, element by element
        inner *= k
        by_scales = squares @ inner.ravel() / np.array(parameters.length_scales) ** 2
        return value, -0.5 * np.array([by_signal, *by_scales, by_noise])

    return at


def most_likely(
    likelihood: Likelihood,
    start: Hyperparameters,
    bounds: FloatArray,
    *,
    restarts: int,
    seed: int,
) -> tuple[FloatArray, list[str]]:
    """The likeliest theta (log sf^2, log sl, log sn^2), (k + 2,), and the messages of the searches
    that stopped early.

    start: where the first search begins.
    bounds: low and high of each logarithm, (k + 2, 2).
    restarts: number of further searches, which begin at random places within the bounds.
    seed: of these places.
    """
    low, high = bounds.T
    # the legacy generator: scikit-learn draws the same places for this seed
    stream = np.random.RandomState(seed)
    starts = start.logarithms, *(stream.uniform(low, high) for _ in range(restarts))
    results = [
        minimize(likelihood, theta, method="L-BFGS-B", jac=True, bounds=Bounds(low, high))
        for theta in starts
    ]
    failures = [str(result.message) for result in results if not result.success]
    return min(results, key=lambda result: result.fun).x, failures
