"""The Gaussian process (GP) from which `zone_partition` makes zones, Eqs. 7-8.

The paper leaves open how closely the GP follows its training values. Here it may miss each value by
about 10 % of that value (`TARGET_TOLERANCE`), and by a common noise, a hyperparameter like the
others. The reason: away from the zone boundary the target has plateaus and kinks. A surface through
all training values has length scales so short that it falls back to 0 between the points. This
surface is exact near y = 0, where it matters. For the same reason no length scale may be below half
the spacing of the training points.

Users: `method/zone_partition.py`, `method/zone_search.py`, `method/zone_training.py`,
`record/points.py`. Fixed: fields of `Surface`, which a run's cache stores; y to the last bit.
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

# seed of the random choices in training and search; constant, so that zones never vary
SEED = 20220
# most training points on which the hyperparameters are searched; the GP then uses all of them
SEARCH_POINTS = 350
TARGET_TOLERANCE = 0.1  # share of a training value by which the GP may miss it
# unit-box lengths; along a coordinate with this length scale y hardly changes
LONGEST_SCALE = 10.0
# least and largest variance of the signal and of the noise; the target is within -1..1
SIGNAL_BOUNDS, NOISE_BOUNDS = (1e-2, 1e2), (1e-6, 1.0)
NUDGE = 1e-6  # unit-box lengths, step of numerical derivatives
CACHED_DISTANCES = 250_000  # numbers of a block that stays in the processor's cache, 2 MB


@frozen(eq=False)
class Surface:
    """Eqs. 7-8: the GP's posterior mean y(x) = sf^2 sum_i exp(-|(x - x_i)/sl|^2 / 2) weight_i.

    points: x_i, training points in the GP's unit box, (n, m).
    weights: (K + sn^2 I + diag(0.1 y_i)^2)^-1 y, (n,).
    length_scales: sl, (m,), unit-box lengths.
    signal_deviation: sf.
    noise_deviation: sn.
    level: constant added to y: 0. If all training points are on one side, n is 0 and `level` alone
        is y: +1 (safe) or -1 (hazardous).
    coordinates: function from points (q, k) of the parameters' unit box to x, (q, m); None: x are
        the points themselves.
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
        scaled = self.points / self.length_scales
        size = max(1, CACHED_DISTANCES // max(1, len(scaled)))  # points of a block
        for first in range(0, len(x), size):
            rows = slice(first, first + size)
            # in place: new arrays of this size would take longer than the arithmetic
            exponent = cdist(x[rows] / self.length_scales, scaled, "sqeuclidean")
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
    """Function from the parameters' unit box, (q, k), to the scenario's own coordinates for the GP,
    (q, m), scaled so that the training points fill a unit box; None: the scenario has none.

    training: training points, (n, k), in the parameters' units.

    The function raises InputError where a coordinate is not finite.
    """
    own = logical.zone_coordinates
    if own is None:
        return None

    def raw(points: FloatArray) -> FloatArray:
        columns = np.stack(logical.values(own.of, points), axis=-1)
        return finite(f"scenario `{logical.name}`", "zone.coordinates", columns)

    learnt = raw(training)
    low = learnt.min(axis=0)
    span = np.ptp(learnt, axis=0)
    span[span == 0.0] = 1.0
    return lambda unit: (raw(logical.from_unit(unit)) - low) / span


def fit(
    logical: LogicalScenario, training: FloatArray, danger: Criticality, settings: ZoneSettings
) -> tuple[Surface, list[str]]:
    """Eqs. 7-8: the GP of training points, and sentences on what limits the trust in it.

    training: (n, k), in the parameters' units.
    danger: criticality of the training points, from `point_criticality.criticality`.
    settings: `[method.zones]`.
    """
    from scipy.linalg import cho_solve, cholesky
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    from sumo_eval.method.gaussian_process import Hyperparameters, covariance

    target = danger.target
    if settings.target == "label":  # the paper's: the zone alone, not how far a point is inside it
        target = np.where(danger.inverse >= settings.critical_inverse_ttc, -1.0, 1.0)
    to_x = coordinates(logical, training)
    unit = logical.to_unit(training)
    if to_x is not None:
        unit = to_x(unit)
    hazardous = target <= 0.0
    if hazardous.all() or not hazardous.any():
        side, level = ("hazardous", -1.0) if hazardous[0] else ("safe", 1.0)
        advice = "make `step` smaller or ranges wider"
        if logical.margin is None and not danger.inverse.any():
            advice = "let the obstacle come into the ego's path: the ego closes on it at no point"
        no_scales = np.full(unit.shape[1], np.inf)
        return Surface(unit[:0], np.empty(0), no_scales, 0.0, 0.0, level, to_x), [
            f"A zone boundary needs safe and hazardous training points; all {len(unit)} are "
            f"{side}, so the whole space counts as such. If it has a boundary, {advice}."
        ]

    tolerance = (TARGET_TOLERANCE * target) ** 2  # variance of each training value
    # One thread: matrices this small gain nothing from more, and several waited 20 s for each other
    # on a busy machine.
    with threadpool_limits(1):
        theta, bounds, notes = _likeliest(unit, target, tolerance, settings)
        # Rounded to three digits, so that the last digits of the search do not change the zones.
        # The likelihood tells fewer digits apart.
        rounded = Hyperparameters.of_logarithms(
            np.log([float(f"{value:.3g}") for value in np.exp(theta)])
        )
        k_training = covariance(unit, rounded) + np.diag(tolerance)  # `covariance` has the noise
        factor = cholesky(k_training, lower=True, check_finite=False)
        weights = cho_solve((factor, True), target, check_finite=False)
    surface = Surface(
        unit,
        weights,
        np.array(rounded.length_scales),
        signal_deviation=math.sqrt(rounded.signal),
        noise_deviation=math.sqrt(rounded.noise),
        coordinates=to_x,
    )
    return surface, [*notes, *_bound_notes(logical, theta, bounds)]


def _likeliest(
    unit: FloatArray, target: FloatArray, variances: FloatArray, settings: ZoneSettings
) -> tuple[FloatArray, FloatArray, list[str]]:
    """Eq. 7: theta (log sf^2, log sl, log sn^2) of largest likelihood, (m + 2,), its bounds, low
    and high, (m + 2, 2), and a note on searches that stopped early.

    unit: training points in the GP's unit box, (n, m).
    target: y of each, (n,).
    variances: of each training value, (n,).
    """
    from sumo_eval.method.gaussian_process import Hyperparameters, marginal_likelihood, most_likely

    n, m = unit.shape
    # along each coordinate: the widest gap between its values, at least that of an even grid
    spacing = np.array([np.diff(np.unique([0.0, *column, 1.0])).max() for column in unit.T])
    spacing = np.maximum(spacing, n ** (-1.0 / m))
    bounds = np.log(
        [SIGNAL_BOUNDS, *((0.5 * step, LONGEST_SCALE) for step in spacing), NOISE_BOUNDS]
    )
    # variance of the signal, length scales, variance of the noise
    start = Hyperparameters(1.0, tuple(np.maximum(0.5, 2.0 * spacing).tolist()), 1e-3)
    sample = np.random.default_rng(SEED).permutation(n)[:SEARCH_POINTS]
    likelihood = marginal_likelihood(unit[sample], target[sample], variances[sample])
    theta, failures = most_likely(likelihood, start, bounds, restarts=settings.restarts, seed=SEED)
    notes = []
    if failures:
        notes.append(
            f"{len(failures)} of {settings.restarts + 1} searches for the GP's hyperparameters "
            f"stopped early: {failures[0]}."
        )
    return theta, bounds, notes


def _bound_notes(logical: LogicalScenario, theta: FloatArray, bounds: FloatArray) -> Iterator[str]:
    """One sentence for each hyperparameter that the search left at a bound.

    theta: logarithms of the hyperparameters, (m + 2,).
    bounds: of each logarithm, low and high, (m + 2, 2).
    """
    axes = (logical.zone_coordinates or logical).names  # of the GP's unit box
    names = ["signal deviation", *(f"length scale of `{name}`" for name in axes), "noise deviation"]
    # by the first word of a hyperparameter's name, and by the bound that it reached
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
        bound = "lower" if value <= low + 1e-6 else "upper" if value >= high - 1e-6 else None
        if bound:
            yield (f"The GP's {name} reached its {bound} bound: {meaning[name.split()[0], bound]}.")
