"""Training of the zones' Gaussian process: its points, from the parameters' steps or a caller, and
the rounds that add points where it is wrong.

Users: `method/zone_partition.py`, `method/zone_search.py`.
"""

import itertools
from math import ceil, prod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, must_be
from sumo_eval.method.point_criticality import criticality, exactly_hazardous
from sumo_eval.method.zone_surface import SEED, Surface, fit
from sumo_eval.scenario import LogicalScenario, Parameter
from sumo_eval.scenario.sampling.grid import decimal, evenly, mesh
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import BoolArray, FloatArray

# Most training points from the parameters' steps: the time to fit a GP grows with their cube.
OWN_GRID_POINTS = 1_500
MOST_POINTS = 5_000  # most training points that a caller may give
# Most points of the dense grid in a scenario whose criticality is searched over time, point by
# point.
SEARCHED_GRID = 8_000
ADDED_AT_ONCE = 500  # most training points that one refinement adds
EDGE = 1e-9  # unit-box length; a point this close to an edge of the space counts as on the edge
ERROR_WORTH_A_NOTE = 0.01  # share of the space on the wrong side of the GP's boundary


def dense_grid(
    logical: LogicalScenario, axes: list[list[float]], settings: ZoneSettings
) -> tuple[list[list[float]], FloatArray, BoolArray]:
    """Axes of the dense grid, its points (n, k), and which of them satisfy the constraints."""
    most = settings.grid_points
    refined = _refine(axes, most if logical.search is None else min(most, SEARCHED_GRID))
    grid = mesh(refined)
    feasible = logical.feasible(grid)
    if not feasible.any():
        raise InputError(
            f"Scenario `{logical.name}` must have points that satisfy its constraints: none of "
            f"{len(grid)} do."
        )
    return refined, grid, feasible


class _Learnt(NamedTuple):
    """Outcome of one fit of the GP.

    training: training points, (n, k).
    surface: the GP that was fitted to them.
    y: on the dense grid, (g,).
    wrong: where y has the wrong sign at a point that satisfies the constraints, (g,).
    notes: sentences on what limits the trust in the surface.
    """

    training: FloatArray
    surface: Surface
    y: FloatArray
    wrong: BoolArray
    notes: tuple[str, ...]


def learn(
    logical: LogicalScenario,
    training: FloatArray,
    grid: FloatArray,
    feasible: BoolArray,
    settings: ZoneSettings,
    rounds: int,
) -> _Learnt:
    """Fit the GP in up to `rounds` rounds, and return the round with the fewest wrong grid points.

    training: training points of the first round, (n, k).
    grid: points of the dense grid, (g, k).
    feasible: which of these satisfy the constraints, (g,).

    As long as more than `ERROR_WORTH_A_NOTE` of the dense grid is on the wrong side, some of those
    points become training points of the next round.
    """
    exact = np.zeros(len(grid), bool)
    exact[feasible] = exactly_hazardous(logical, grid[feasible], settings)
    unit = logical.to_unit(grid)
    n_first = len(training)
    n_feasible = feasible.sum()
    fits: list[_Learnt] = []
    for _ in range(rounds):
        danger = criticality(logical, training, settings)
        surface, notes = fit(logical, training, danger, settings)
        y = surface.value(unit)
        wrong = feasible & ((y <= 0.0) != exact)
        if added := len(training) - n_first:
            notes += [f"{added} training points were added where the GP was on the wrong side."]
        fits.append(_Learnt(training, surface, y, wrong, tuple(notes)))
        if wrong.sum() <= ERROR_WORTH_A_NOTE * n_feasible:
            break
        more = np.random.default_rng(SEED).permutation(np.flatnonzero(wrong))[:ADDED_AT_ONCE]
        training = np.unique(np.concatenate([training, grid[more]]), axis=0)
    best = min(fits, key=lambda fit: fit.wrong.sum())
    share = best.wrong.sum() / n_feasible
    if share > ERROR_WORTH_A_NOTE:
        remark = f"The GP puts {100 * share:.1f} % of the space in the wrong zone: add points."
        best = best._replace(notes=(*best.notes, remark))
    return best


def own_axes(logical: LogicalScenario) -> tuple[list[list[float]], tuple[str, ...]]:
    """The values of each parameter at its `step`, fewer where the grid of them is too large for a
    GP, and a note on that.

    Raises InputError where two values of each parameter are too many.
    """
    counts = [_own_count(parameter) for parameter in logical.parameters]
    own = prod(counts)
    # parameters of which two values each still fit: 2**most points
    most = OWN_GRID_POINTS.bit_length() - 1
    if len(counts) > most:
        raise InputError(
            f"Scenario `{logical.name}` must have at most {most} parameters, since its zones are "
            f"learnt from a grid, got {len(counts)}: give some of them a fixed value."
        )
    # Take a value from the longest axis until the grid is small enough. An axis that alone is too
    # long is cut at once.
    while prod(counts) > OWN_GRID_POINTS:
        counts[counts.index(max(counts))] = min(max(counts) - 1, OWN_GRID_POINTS)
    axes = list(map(_axis, logical.parameters, counts))
    if prod(counts) == own:
        return axes, ()
    return axes, (
        f"The zones were learnt from a grid of {prod(counts)} points, coarser than the "
        f"scenario's own of {own}.",
    )


def _own_count(parameter: Parameter) -> int:
    """Number of values of a parameter: low, low + step, ... and high."""
    extent = decimal(parameter.high) - decimal(parameter.low)
    return ceil(extent / decimal(parameter.step)) + 1


def _axis(parameter: Parameter, count: int) -> list[float]:
    """Low, low + step, ... and high; if `count` is too small for these, evenly spaced values."""
    if count < _own_count(parameter):
        return evenly(parameter, count)
    low, step = decimal(parameter.low), decimal(parameter.step)
    return [*(float(low + step * index) for index in range(count - 1)), float(parameter.high)]


def _refine(axes: list[list[float]], most: int) -> list[list[float]]:
    """Split every interval of the axes into equally many parts: as many as keep the grid within
    `most` points. The old values stay on the axes.

    The values are computed as decimals: two parameters that a constraint compares must get equal
    floats where their values are equal.
    """
    parts = 1
    while prod((len(axis) - 1) * (parts + 1) + 1 for axis in axes) <= most:
        parts += 1
    return [
        [
            *(
                float(a + (b - a) * part / parts)
                for a, b in itertools.pairwise(map(decimal, axis))
                for part in range(parts)
            ),
            axis[-1],
        ]
        for axis in axes
    ]


def user_points(logical: LogicalScenario, points: ArrayLike) -> FloatArray:
    """Training points of a caller, sorted, each once. Raises InputError as `partition` does."""
    array = np.asarray(points, float)
    owner = f"scenario `{logical.name}`"
    if (
        array.ndim != 2
        or array.shape[1] != len(logical.parameters)
        or not 1 <= len(array) <= MOST_POINTS
    ):
        wanted = f"an (n, {len(logical.parameters)}) array with n in 1..{MOST_POINTS}"
        raise must_be("The training points", owner, wanted, array.shape)
    checked_unit(logical, array)
    return np.unique(array, axis=0)


def checked_unit(logical: LogicalScenario, points: ArrayLike) -> FloatArray:
    """Points in the unit box; refuses what lies outside of it by more than rounding."""
    columns = logical.columns(points)
    for parameter in logical.parameters:
        values = columns[parameter.name]
        slack = EDGE * (parameter.high - parameter.low)
        outside = ~((values >= parameter.low - slack) & (values <= parameter.high + slack))
        if np.any(outside):
            allowed = f"within {parameter.low:g}..{parameter.high:g}{parameter.unit_suffix}"
            owner = f"scenario `{logical.name}`"
            raise must_be(
                f"`{parameter.name}`", owner, allowed, float(np.ravel(values)[np.ravel(outside)][0])
            )
    return np.clip(logical.to_unit(points), 0.0, 1.0)
