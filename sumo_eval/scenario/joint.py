"""Densities of points of a space from recorded events, with the dependence between parameters.

There are two kinds of density, both cut to the box of the space:

- kde (kernel density estimate): a Gaussian at each event, with the events' covariance times the
  squared bandwidth.
- copula: a one-dimensional KDE for each parameter, cut to its range; their dependence by the
  correlation of their normal scores (a Gaussian copula).

A sum of kernels is wider than the events, by sqrt(1 + h^2) for a KDE of bandwidth h. So rare values
get too high a density where the events' tails are those of a normal distribution. The narrow form
of either kind divides the distances from the events' mean, and the kernels' width, by that factor.
It varies as much as the events do (Silverman, Density Estimation, 1986, 6.4.1), but gives values in
a long tail too low a density.

`[joint]` of a scenario file (its keys: `file_tables.JointTable`) and `sumo-eval learn` make these
densities; only `sumo-eval campaign` makes the narrow form. scipy is imported only when the first of
them is computed. Fixed: densities and draws, on which exposure and drawn points depend.

Users: `extras/rates/exposure.py`, `extras/rates/importance.py`, `extras/rates/learn_page.py`,
`extras/rates/learned.py`, `scenario/file_tables.py`, `scenario/formulas.py`.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, must_be
from sumo_eval.frozen import frozen
from sumo_eval.trajectory import BoolArray, FloatArray

JointKind = Literal["kde", "copula"]
GRID = 1025  # values of a parameter at which a copula's one-dimensional density is tabulated
# draws that estimate the share of a KDE within its box; `Joint.draw` gives up after as many draws
# outside the box
MASS_DRAWS = 32_768
LEAST_EIGENVALUE = 1e-9  # of a copula's correlation matrix, so that it has a Cholesky factor
LEAST_SHARE = 1e-9  # of probability at both ends: normal scores lie within +-6
_BATCH = 4096  # points whose distances from all kernels are computed at once: limits the memory
# least share of a KDE within its box: callers of `density` divide by it (`mass`)
_LEAST_INSIDE = 1e-4


@frozen
class Joint:
    """A density over k parameters, from n events.

    names: of the parameters, in the order of the columns of `events`.
    events: n rows of k finite numbers.
    low, high: corners of the box that the density is cut to.
    bandwidth: standard deviation of a kernel over the spread of the events: their standard
        deviation, or for a copula `_spread`; None: Scott's n^(-1/(k+4)), with k = 1 for a copula.
    source: name of the file with the events, for sentences.
    weights: of the events; empty: all equal.
    narrow: whether it is the narrow form.
    """

    kind: JointKind
    names: tuple[str, ...]
    events: tuple[tuple[float, ...], ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    bandwidth: float | None = None
    source: str = ""
    weights: tuple[float, ...] = ()
    narrow: bool = False

    def __post_init__(self) -> None:
        n, k = len(self.events), len(self.names)
        owner = f"the joint distribution {self.source}".rstrip()
        if n < k + 2:
            raise must_be("The events", owner, f"at least {k + 2}", n)
        if not vary_alone(np.array(self.events)):
            raise InputError(
                f"The events of {owner} must vary in each of {', '.join(self.names)} on its own."
            )

    @property
    def factor(self) -> float:
        """The bandwidth, Scott's if it is None."""
        if self.bandwidth is not None:
            return self.bandwidth
        k = len(self.names) if self.kind == "kde" else 1
        return float(len(self.events) ** (-1.0 / (k + 4)))

    def density(self, points: ArrayLike) -> FloatArray:
        """Probability density (n,) at points (n, k), 0 outside the box.

        Over the box it integrates to `mass`.
        """
        rows = np.asarray(points, float).reshape(-1, len(self.names))
        inside = self._inside(rows)
        densities = np.zeros(len(rows))
        if inside.any():
            densities[inside] = _prepared(self).density(rows[inside])
        return densities

    def mass(self) -> float:
        """Integral of `density` over the box: 1 for a copula, whose one-dimensional densities are
        cut to their ranges; for a KDE the share of it that lies in the box.
        """
        return 1.0 if self.kind == "copula" else _share_inside(self)

    def draw(self, count: int, stream: Generator) -> FloatArray:
        """Points (count, k) of this density within the box."""
        prepared = _prepared(self)
        if self.kind == "copula":
            return prepared.draw(count, stream)
        inside = np.empty((0, len(self.names)))
        drawn = 0
        while len(inside) < count:
            rows = prepared.draw(2 * count, stream)
            drawn += len(rows)
            inside = np.concatenate([inside, rows[self._inside(rows)]])
            if not len(inside) and drawn >= MASS_DRAWS:
                raise InputError(
                    f"No draw of the joint distribution {self.source} lies within the ranges."
                )
        return inside[:count]

    def _inside(self, rows: FloatArray) -> BoolArray:
        """Whether each of the points (n, k) is within the box."""
        return np.asarray(((rows >= self.low) & (rows <= self.high)).all(axis=1))

    def __str__(self) -> str:
        kind = {"kde": "KDE", "copula": "copula of one-dimensional KDEs"}[self.kind]
        events = f"{len(self.events)} recorded events"
        source = f" of {self.source}" if self.source else ""
        return f"a Gaussian {kind} over {events}{source} (bandwidth {self.factor:.3f})"


def vary_alone(rows: FloatArray) -> bool:
    """Whether each column of events (n, k) varies on its own.

    With a column that depends on others linearly, the covariance has no Cholesky factor.
    """
    scaled = (rows - rows.mean(axis=0)) / np.maximum(rows.std(axis=0), 1e-12)
    return bool(np.linalg.matrix_rank(scaled, tol=1e-6) == rows.shape[1])


class _Kernels(NamedTuple):
    """A `Joint` of the kind kde made ready for densities and draws, not cut to the box.

    rows: centres of the kernels, (n, k).
    shares: weights of the kernels, (n,), together 1.
    root: Cholesky factor of a kernel's covariance, (k, k).
    """

    rows: FloatArray
    shares: FloatArray
    root: FloatArray

    def draw(self, count: int, stream: Generator) -> FloatArray:
        """Points (count, k)."""
        kernels = stream.choice(len(self.rows), size=count, p=self.shares)
        off_centre = stream.standard_normal((count, self.rows.shape[1])) @ self.root.T
        return self.rows[kernels] + off_centre

    def density(self, points: FloatArray) -> FloatArray:
        """Density (n,) at points (n, k)."""
        k = points.shape[1]
        # in the whitened space every kernel has the unit covariance
        whiten = np.linalg.inv(self.root)
        centres = self.rows @ whiten.T
        norm = np.abs(np.linalg.det(whiten)) / (2.0 * np.pi) ** (k / 2.0)
        sums = np.zeros(len(points))
        for first in range(0, len(points), _BATCH):
            part = slice(first, first + _BATCH)
            sums[part] = bells(points[part] @ whiten.T, centres) @ self.shares
        return np.asarray(sums * norm)


class _Copula(NamedTuple):
    """A `Joint` of the kind copula made ready for densities and draws.

    root: Cholesky factor of the correlation of the normal scores, (k, k).
    grids: values of each parameter, (k, GRID).
    densities, distributions: its density and its cumulative distribution there, (k, GRID).
    """

    root: FloatArray
    grids: FloatArray
    densities: FloatArray
    distributions: FloatArray

    def draw(self, count: int, stream: Generator) -> FloatArray:
        """Points (count, k)."""
        from scipy.special import ndtr

        shares = ndtr(stream.standard_normal((count, len(self.root))) @ self.root.T)
        # of each parameter the value at its share: the inverse of its distribution
        inverses = zip(shares.T, self.distributions, self.grids, strict=True)
        return np.column_stack([np.interp(*inverse) for inverse in inverses])

    def density(self, points: FloatArray) -> FloatArray:
        """Density (n,) at points (n, k)."""
        from scipy.special import ndtri

        distributions = zip(points.T, self.grids, self.distributions, strict=True)
        shares = np.column_stack([np.interp(*distribution) for distribution in distributions])
        scores = ndtri(np.clip(shares, LEAST_SHARE, 1.0 - LEAST_SHARE))
        # density of a Gaussian copula: that of the correlated scores over that of independent ones
        whitened = np.linalg.solve(self.root, scores.T).T
        density = np.exp(0.5 * (scores**2 - whitened**2).sum(axis=1)) / np.diag(self.root).prod()
        for marginal in zip(points.T, self.grids, self.densities, strict=True):
            density = density * np.interp(*marginal)
        return np.asarray(density)


@lru_cache(maxsize=64)
def _share_inside(joint: Joint) -> float:
    """Share of a KDE within its box, estimated by draws."""
    prepared = _prepared(joint)
    stream = np.random.default_rng(len(joint.events))  # any fixed seed
    inside = joint._inside(prepared.draw(MASS_DRAWS, stream))
    return max(float(np.mean(inside)), _LEAST_INSIDE)


@lru_cache(maxsize=512)
def _prepared(joint: Joint) -> _Kernels | _Copula:
    """The density, ready for points and draws."""
    rows = np.array(joint.events)
    weights = joint.weights or (1.0,) * len(rows)
    shares = np.array(weights) / sum(weights)
    if joint.kind == "kde":
        covariance = np.atleast_2d(np.cov(rows.T, aweights=shares)) * joint.factor**2
        root = np.asarray(np.linalg.cholesky(covariance), float)
        if joint.narrow:
            rows, root = _narrowed(rows, shares, root, joint.factor**2)
        return _Kernels(rows, shares, root)

    grids = np.linspace(joint.low, joint.high, GRID, axis=1)
    marginals = [_marginal(joint, *it, shares) for it in zip(grids, rows.T, strict=True)]
    densities, distributions = map(np.array, zip(*marginals, strict=True))
    return _Copula(_correlation_root(rows, shares), grids, densities, distributions)


def _narrowed(rows: FloatArray, shares: FloatArray, width: Any, ratio: Any) -> tuple[Any, Any]:
    """The narrow form: events nearer to their mean, and narrower kernels, by one factor.

    rows: (n, k) of all parameters, or (n,) of one. shares: weights of the events, (n,).
    width: of the kernels: Cholesky factor (k, k), or standard deviation of one parameter.
    ratio: variance of a kernel over that of the events.
    """
    factor, mean = 1.0 / np.sqrt(1.0 + ratio), shares @ rows
    return mean + factor * (rows - mean), factor * width


def _correlation_root(rows: FloatArray, shares: FloatArray) -> FloatArray:
    """Cholesky factor of the weighted correlation of the normal scores of events, (k, k)."""
    scores = np.column_stack([_normal_scores(it) for it in rows.T])
    centred = scores - shares @ scores
    covariance = (centred * shares[:, None]).T @ centred
    deviation = np.sqrt(np.diag(covariance))
    correlation = np.atleast_2d(covariance / np.outer(deviation, deviation))
    # two parameters that put the events in the same order have a singular correlation: lift it
    lift = max(LEAST_EIGENVALUE - float(np.linalg.eigvalsh(correlation)[0]), 0.0)
    return np.asarray(np.linalg.cholesky(correlation + lift * np.eye(len(correlation))), float)


def _normal_scores(values: FloatArray) -> FloatArray:
    """Normal scores (n,) of a parameter's values."""
    from scipy.special import ndtri

    # equal values get one score, at the middle of their ranks: different scores would follow the
    # order of the events, and make parameters seem correlated
    _, index, times = np.unique(values, return_inverse=True, return_counts=True)
    middle_ranks = np.cumsum(times) - 0.5 * times
    return ndtri(middle_ranks[index] / len(values))


def _marginal(
    joint: Joint, grid: FloatArray, values: FloatArray, shares: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Density and cumulative distribution of a parameter on its grid, (GRID,) each, both of the KDE
    cut to the range of the grid.

    values: of the events, (n,). shares: weights of the events, (n,).
    """
    from scipy.special import ndtr

    width = joint.factor * _spread(values)
    if joint.narrow:
        variance = shares @ (values - shares @ values) ** 2
        values, width = _narrowed(values, shares, width, width**2 / variance)
    # (GRID, n): distance of each grid value from each kernel, in deviations of the kernel
    away = (grid[:, None] - values) / width
    uncut = ndtr(away) @ shares  # distribution before the cut
    mass = max(uncut[-1] - uncut[0], 1e-12)
    density = np.exp(-0.5 * away**2) @ shares / (width * np.sqrt(2.0 * np.pi) * mass)
    return density, (uncut - uncut[0]) / mass


def _spread(values: FloatArray) -> float:
    """The smaller of two deviations of values: their standard deviation, and that of a normal
    distribution with their quartiles, which lie 1.34 deviations apart.

    A long tail must not make the kernels in the middle wide.
    """
    low, high = np.quantile(values, [0.25, 0.75])
    deviation = float(values.std(ddof=1))
    return min(deviation, float(high - low) / 1.34) or deviation


def bells(points: FloatArray, centres: FloatArray) -> FloatArray:
    """exp(-d^2/2) by the distance d of points (n, k) from centres (m, k): (n, m)."""
    # |p - c|^2 = |p|^2 + |c|^2 - 2 p.c, which rounding may make negative
    squared = (points**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * points @ centres.T
    return np.asarray(np.exp(-0.5 * np.maximum(squared, 0.0)))


def of_values(joint: Joint, values: Mapping[str, ArrayLike]) -> FloatArray:
    """The density at points given as values by name, arrays that broadcast to one shape."""
    columns = np.broadcast_arrays(*(np.asarray(values[name], float) for name in joint.names))
    shape = columns[0].shape
    return joint.density(np.column_stack([column.ravel() for column in columns])).reshape(shape)
