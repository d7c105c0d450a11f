"""Search for the boundary between two outcomes with few trials: `ask` for points, `tell` outcomes.

A Gaussian process classifier (logistic, Laplace's approximation) learns the outcomes in the unit
box. It has a latent function f: the outcome True is likelier where f > 0. The next points are those
where the sign of f is least certain, by the straddle rule of Bryan et al. (2005): where
1.96 sd(f) - |mean(f)| is largest. The points of a round are chosen in order, each as if the earlier
ones had been tried. Every eighth point is the one of the largest sd(f) instead, so that isolated
regions are found too. The regions of both outcomes may have any shape, also holes and several
pieces.

Users: `extras/rates/importance.py`, `extras/studies/boundary.py`.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.special import expit
from scipy.stats import norm
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessClassifier
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sumo_eval.errors import InputError
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray

POOL = 4_096  # evenly spread points from which each round chooses
STRADDLE = 1.96  # factor of sd(f) in the straddle rule
EXPLORE_EVERY = 8  # every eighth point of a round has the largest sd(f)
# The kernel's constants are learnt again each time the number of trials has grown by half, until
# they were learnt from this many trials or more.
LEARN_UNTIL = 300
FIRST_SIGNAL, FIRST_SCALE = 100.0, 0.3  # variance and length scales with which learning begins
SIGNAL_BOUNDS = 1.0, 1e3  # of the kernel's variance of f
LEAST_SIGNAL = 2.0  # to which `_fit` may reduce the variance of f
SCALE_BOUNDS = 0.02, 10.0  # of the kernel's length scales, in the unit box
LABEL_VARIANCE = 1.0  # an outcome counts as a measurement of f with this variance
CONVERGED = 1e-3  # largest difference of probabilities in `_at_mode`
CONTRADICTED = 0.05  # share of trials that the classifier may put on the wrong side
LATEST_CHANGES = 4  # changes of the classes whose mean predicts the next one
# New trials, at least, between two models whose difference is such a change. A model with fewer
# hardly differs, as after a round whose trials could not be evaluated: nothing is settled then.
LEAST_NEW = 8
LEAST_VARIANCE = 1e-9  # of f, so that `probability` never divides by 0


class BoundarySearch:
    """Search among the possible points of a space.

    points: tried so far, (n, k).
    outcomes: of these points, (n,).

    The same seed and the same outcomes lead to the same points. Raises InputError for a space with
    listed values or without possible points.
    """

    def __init__(self, logical: LogicalScenario, seed: int = 1) -> None:
        listed = [item.name for item in logical.parameters if item.values]
        if listed:
            raise InputError(
                f"`{listed[0]}` of scenario `{logical.name}` has listed values only, and between "
                "them there is no boundary: hold it fixed."
            )
        self.logical = logical
        self.points = np.empty((0, len(logical.names)))
        self.outcomes = np.empty(0, bool)
        self._model: Any = None  # the classifier, once both outcomes have been seen
        self._learnt_at = 0  # number of trials from which the kernel's constants were learnt
        self._classes: BoolArray | None = None  # of the pool's points, by the last counted model
        self._counted_at = 0  # number of trials of that model
        # of each counted model: share of the pool whose class differs from that by the one before
        self._changes: list[float] = []
        pool = evenly(logical, POOL, random_stream(seed, "boundary", logical.name))
        self._pool = pool[logical.feasible(pool)]
        if not len(self._pool):
            raise InputError(
                f"Scenario `{logical.name}` must have a possible point among {POOL} evenly spread "
                "ones, got none."
            )
        self._untried = self._pool  # points that `ask` has not given yet

    def ask(self, n: int) -> FloatArray:
        """The next points to try, at most `n`, (n, k), each given once; evenly spread ones until
        both outcomes have been seen.
        """
        untried = self._untried
        n = min(n, len(untried))
        chosen = list(range(n)) if self._model is None else self._least_certain(untried, n)
        self._untried = np.delete(untried, chosen, axis=0)
        return untried[chosen]

    def _least_certain(self, points: FloatArray, n: int) -> list[int]:
        """Rows of the `n` of these points where the sign of f is least certain."""
        mean, variance, covariance = self._latent(self.logical.to_unit(points))
        chosen: list[int] = []
        for number in range(n):
            deviation = np.sqrt(np.maximum(variance, 0.0))
            explores = number % EXPLORE_EVERY == EXPLORE_EVERY - 1
            score = deviation if explores else STRADDLE * deviation - np.abs(mean)
            score[chosen] = -np.inf
            best = int(np.argmax(score))
            chosen.append(best)
            # a measurement at `best` reduces the variance everywhere, whatever its outcome
            shared = covariance(best)
            variance = variance - shared**2 / (shared[best] + LABEL_VARIANCE)
        return chosen

    def tell(self, points: FloatArray, outcomes: ArrayLike) -> None:
        """Learn from the outcomes (n,), True or False, of points (n, k)."""
        self.points = np.concatenate([self.points, points])
        self.outcomes = np.concatenate([self.outcomes, np.asarray(outcomes, bool)])
        if self.outcomes.any() and not self.outcomes.all():
            self._fit()

    def probability(self, points: FloatArray) -> FloatArray:
        """Probability (n,) that the outcome at points (n, k) is True, by the trials so far."""
        if self._model is None:
            return np.full(len(points), float(self.outcomes[0]) if len(self.outcomes) else 0.5)
        mean, variance, _ = self._latent(self.logical.to_unit(points))
        # P(f > 0) of a normal f
        return norm.cdf(mean / np.sqrt(np.maximum(variance, LEAST_VARIANCE)))

    def classify(self, points: FloatArray) -> BoolArray:
        """The likelier outcome (n,) at points (n, k)."""
        return self.probability(points) >= 0.5

    @property
    def expected_change(self) -> float:
        """Share of the possible points that the next round is expected to put in another class.

        It is the mean of the latest four changes from one model to the next, with at least
        `LEAST_NEW` trials in between. 1 stands for unknown: before the fifth model (the first needs
        both outcomes), and while the model contradicts more than 5 % of the trials.
        """
        last = self._changes[-LATEST_CHANGES:]
        if (
            len(last) < LATEST_CHANGES
            or np.mean(self.classify(self.points) != self.outcomes) > CONTRADICTED
        ):
            return 1.0
        return float(np.mean(last))

    @property
    def doubt(self) -> float:
        """Mean probability that a possible point is in the wrong class.

        Laplace's approximation makes it too large. 1 stands for unknown.
        """
        if self._model is None:
            return 1.0
        probability = self.probability(self._pool)
        return float(np.mean(np.minimum(probability, 1.0 - probability)))

    def _fit(self) -> None:
        """Fit a model to all trials. After `LEAST_NEW` new ones, note which share of the pool
        changes its class.
        """
        n = len(self.outcomes)
        # True for the first model, because `_learnt_at` is 0 then
        learn = n >= 1.5 * self._learnt_at and self._learnt_at < LEARN_UNTIL
        if learn:
            # each time from the first constants: those learnt before may be a poor local optimum
            scales = RBF(np.full(len(self.logical.names), FIRST_SCALE), SCALE_BOUNDS)
            kernel = ConstantKernel(FIRST_SIGNAL, SIGNAL_BOUNDS) * scales
            self._learnt_at = n
        else:
            kernel = self._model.kernel_
        unit = self.logical.to_unit(self.points)
        with warnings.catch_warnings(), threadpool_limits(1):
            # the warning that a constant lies at its bound does not matter here
            warnings.simplefilter("ignore", ConvergenceWarning)
            model = GaussianProcessClassifier(
                kernel, optimizer="fmin_l_bfgs_b" if learn else None
            ).fit(unit, self.outcomes)
            # Where the variance of f is large, Newton's steps can overshoot, and scikit-learn stops
            # silently before the mode. So the variance is halved until the steps converge, or until
            # it is `LEAST_SIGNAL` or less.
            while not _at_mode(model) and model.kernel_.k1.constant_value > LEAST_SIGNAL:
                signal = ConstantKernel(model.kernel_.k1.constant_value / 2.0, SIGNAL_BOUNDS)
                kernel = signal * model.kernel_.k2
                model = GaussianProcessClassifier(kernel, optimizer=None).fit(unit, self.outcomes)
        self._model = model
        if n - self._counted_at < LEAST_NEW:
            return
        classes = self.classify(self._pool)
        if self._classes is not None:
            self._changes.append(np.mean(classes != self._classes))
        self._classes, self._counted_at = classes, n

    def _latent(
        self, unit: FloatArray
    ) -> tuple[FloatArray, FloatArray, Callable[[int], FloatArray]]:
        """Mean (n,) and variance (n,) of f at points (n, k) of the unit box, and a function that
        gives its covariances.

        The function takes the row of a point and returns the covariance of f at this point with f
        at all points, (n,). It is conditional on the trials, and on the points of its own earlier
        calls as if these had been tried.

        Formulas: Rasmussen and Williams (2006), algorithm 3.2. scikit-learn's `pi_` are the
        probabilities of the trials, `W_sr_` the square roots of W, `L_` the Cholesky factor of
        I + sqrt(W) K sqrt(W).
        """
        inner = self._model.base_estimator_
        kernel = inner.kernel_
        cross = kernel(inner.X_train_, unit)
        mean = cross.T @ (inner.y_train_ - inner.pi_)
        half = solve_triangular(inner.L_, inner.W_sr_[:, None] * cross, lower=True)
        variance = kernel.diag(unit) - np.einsum("ij,ij->j", half, half)
        # for each earlier call a vector d: its point reduces the covariances by d d^T
        earlier: list[FloatArray] = []

        def covariance(row: int) -> FloatArray:
            shared = kernel(unit, unit[row : row + 1])[:, 0] - half.T @ half[:, row]
            for d in earlier:
                shared = shared - d * d[row]
            earlier.append(shared / np.sqrt(shared[row] + LABEL_VARIANCE))
            return np.asarray(shared)

        return mean, variance, covariance


def _at_mode(model: GaussianProcessClassifier) -> bool:
    """Whether Laplace's approximation has converged to the mode of f.

    There f = K (y - p), and the probabilities p of the trials are 1 / (1 + exp(-f)).
    """
    inner = model.base_estimator_
    f = inner.kernel_(inner.X_train_) @ (inner.y_train_ - inner.pi_)
    return bool(np.max(np.abs(expit(f) - inner.pi_)) < CONVERGED)
