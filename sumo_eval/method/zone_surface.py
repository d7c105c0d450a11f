"""The Gaussian process from which `zone_partition` makes zones, Eqs. 7-8.

Not in the paper, and stated here: the GP may miss each training value by about 10 % of it
(`TARGET_TOLERANCE`) and by a common noise that the likelihood finds like its other constants. The
target has plateaus and kinks away from the zone boundary. A surface that must pass through all of
them takes length scales so short that it falls back to 0 between the points; this one is exact
where it matters, near y = 0. For the same reason no length scale may be below half the spacing of
the training points.

Users: `method/zone_partition.py`, `method/zone_search.py`, `method/zone_training.py`,
`record/points.py`.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np

from sumo_eval.frozen import frozen
from sumo_eval.method.checks import finite
from sumo_eval.method.point_criticality import Criticality
from sumo_eval.scenario import LogicalScenario
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import FloatArray

# of the search's restarts and its sample of training points; constant, so that zones never vary
SEED = 20220
# the hyperparameters are searched on at most so many training points, the GP uses all of them
SEARCH_POINTS = 350
TARGET_TOLERANCE = 0.1  # share of a training value by which the GP may miss it
# unit-box lengths; a longer length scale is indistinguishable from "does not matter"
LONGEST_SCALE = 10.0
SIGNAL_BOUNDS, NOISE_BOUNDS = (1e-2, 1e2), (1e-6, 1.0)  # variances of a target within -1..1
NUDGE = 1e-6  # unit-box lengths, for derivatives


@frozen(eq=False)
class Surface:
    """Eqs. 7-8: the GP's posterior mean y(x) = sf^2 sum_i exp(-|(x - x_i)/sl|^2 / 2) weight_i, x in
    a unit box.

    points: x_i, (n, m).
    weights: (K + sn^2 I + diag(0.1 y_i)^2)^-1 y, (n,).
    length_scales: sl, (m,).
    signal_deviation: sf.
    noise_deviation: sn.
    level: added to y. It is 0, except where all training points are on one side: then n is 0, and y
        is this constant, +1 (safe) or -1 (hazardous).
    coordinates: function from points (q, k) of the parameters' unit box to x, (q, m); None: x are
        these points.
    """

    points: FloatArray
    weights: FloatArray
    length_scales: FloatArray
    signal_deviation: float
    noise_deviation: float
    level: float = 0.0
    coordinates: Callable[[FloatArray], FloatArray] | None = None

    def value(self, unit_points: FloatArray) -> FloatArray:
        """Eq. 8 at points (..., k) of the parameters' unit box: y, (...)."""
        from scipy.spatial.distance import cdist

        *shape, k = unit_points.shape
        x = unit_points.reshape(-1, k)
        y = np.full(len(x), self.level)
        x = x if self.coordinates is None else self.coordinates(x)
        known = self.points / self.length_scales
        size = max(1, 250_000 // max(1, len(known)))  # a block stays in the processor's cache, 2 MB
        for first in range(0, len(x), size):
            rows = slice(first, first + size)
            # in place: new blocks of this size cost more than the arithmetic
            exponent = cdist(x[rows] / self.length_scales, known, "sqeuclidean")
            exponent *= -0.5
            np.exp(exponent, out=exponent)
            exponent *= self.signal_deviation**2
            y[rows] += exponent @ self.weights
        return y.reshape(shape)

    def gradient(self, unit_points: FloatArray) -> FloatArray:
        """Derivative of Eq. 8 by each unit parameter, (..., k), by central differences."""
        nudges = NUDGE * np.eye(unit_points.shape[-1])
        rises = [self.value(unit_points + step) - self.value(unit_points - step) for step in nudges]
        return np.stack(rises, axis=-1) / (2.0 * NUDGE)


def coordinates(
    logical: LogicalScenario, training: FloatArray
) -> Callable[[FloatArray], FloatArray] | None:
    """Function from the parameters' unit box to the scenario's coordinates for the GP, scaled so
    that the training points fill a unit box; None: the scenario has none.
    """
    own = logical.zone_coordinates
    if own is None:
        return None

    def raw(points: FloatArray) -> FloatArray:
        columns = np.stack(own.of(logical.columns(points)), axis=-1)
        return finite(f"scenario `{logical.name}`", "zone.coordinates", columns)

    learnt = raw(training)
    low = learnt.min(axis=0)
    span = np.ptp(learnt, axis=0)
    span[span == 0.0] = 1.0
    return lambda unit: (raw(logical.from_unit(unit)) - low) / span


def fit(
    logical: LogicalScenario, training: FloatArray, danger: Criticality, settings: ZoneSettings
) -> tuple[Surface, list[str]]:
    """The GP, and sentences on what limits the trust in it.

    danger: of the training points.
    """
    from scipy.linalg import cho_solve, cholesky
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    from sumo_eval.method.gaussian_process import (
        Hyperparameters,
        MarginalLikelihood,
        covariance,
        most_likely,
    )

    target = danger.target
    if settings.target == "label":  # the zone alone, without how far the point is inside it
        target = np.where(danger.inverse >= settings.critical_inverse_ttc, -1.0, 1.0)
    to_x = coordinates(logical, training)
    unit = logical.to_unit(training)
    if to_x is not None:
        unit = to_x(unit)
    n, k = unit.shape
    hazardous = target <= 0.0
    if hazardous.all() or not hazardous.any():
        side, level = ("hazardous", -1.0) if hazardous[0] else ("safe", 1.0)
        advice = "make `step` smaller or ranges wider"
        if logical.margin is None and not danger.inverse.any():
            advice = "let the obstacle come into the ego's path: the ego closes on it at no point"
        return Surface(unit[:0], np.empty(0), np.full(k, np.inf), 0.0, 0.0, level, to_x), [
            f"A zone boundary needs safe and hazardous training points; all {n} are {side}, so the "
            f"whole space counts as such. If it has a boundary, {advice}."
        ]

    # along each coordinate: the widest gap between its values, at least that of an even grid
    spacing = np.array([np.diff(np.unique([0.0, *column, 1.0])).max() for column in unit.T])
    spacing = np.maximum(spacing, n ** (-1.0 / k))
    bounds = np.log(
        [SIGNAL_BOUNDS, *((0.5 * step, LONGEST_SCALE) for step in spacing), NOISE_BOUNDS]
    )
    # variance of the signal, length scales, variance of the noise
    start = Hyperparameters(1.0, tuple(np.maximum(0.5, 2.0 * spacing).tolist()), 1e-3)
    tolerance = (TARGET_TOLERANCE * target) ** 2
    sample = np.random.default_rng(SEED).permutation(n)[:SEARCH_POINTS]
    # One thread: matrices this small gain nothing from more, and several waited 20 s for each other
    # on a busy machine.
    with threadpool_limits(1):
        likelihood = MarginalLikelihood(unit[sample], target[sample], tolerance[sample])
        theta, failures = most_likely(
            likelihood, start, bounds, restarts=settings.restarts, seed=SEED
        )
        # Three digits are more than the likelihood can tell apart; the search's last digits do not
        # reach the zones.
        rounded = Hyperparameters.of_logarithms(
            np.log([float(f"{value:.3g}") for value in np.exp(theta)])
        )
        k_training = covariance(unit, rounded) + np.diag(tolerance)  # the first with the noise
        factor = cholesky(k_training, lower=True, check_finite=False)
        weights = cho_solve((factor, True), target, check_finite=False)
    notes = []
    if failures:
        notes.append(
            f"{len(failures)} of {settings.restarts + 1} searches for the GP's hyperparameters "
            f"stopped early: {failures[0]}."
        )
    surface = Surface(
        unit,
        weights,
        np.array(rounded.length_scales),
        signal_deviation=math.sqrt(rounded.signal),
        noise_deviation=math.sqrt(rounded.noise),
        coordinates=to_x,
    )
    return surface, [*notes, *_bound_notes(logical, theta, bounds)]


def _bound_notes(logical: LogicalScenario, theta: FloatArray, bounds: FloatArray) -> Iterator[str]:
    """One sentence for each hyperparameter that the search left at a bound."""
    seen = (logical.zone_coordinates or logical).names
    names = ["signal deviation", *(f"length scale of `{name}`" for name in seen), "noise deviation"]
    # by the first word of a name
    meaning = {
        ("length", "upper"): "the zones hardly depend on it",
        (
            "length",
            "lower",
        ): "the zones change faster than the training points can tell; add points",
        ("noise", "lower"): "the surface follows the training points as closely as it may",
        ("noise", "upper"): "the surface hardly follows the training points; add points",
        ("signal", "lower"): "the training points are almost alike",
        ("signal", "upper"): "the surface may swing far between the training points; add points",
    }
    for name, value, (low, high) in zip(names, theta, bounds, strict=True):
        reached = "lower" if value <= low + 1e-6 else "upper" if value >= high - 1e-6 else None
        if reached:
            yield (
                f"The GP's {name} reached its {reached} bound: {meaning[name.split()[0], reached]}."
            )
