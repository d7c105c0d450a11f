"""Training of the zones' Gaussian process (GP): which points it learns from, and rounds that add
points where its zone is wrong.

The training points are the grid of the parameters' own steps, or come from a caller. A finer, dense
grid over the same space shows where the GP is wrong.

Users: `method/zone_partition.py`, `method/zone_search.py`, `record/facts.py`. Fixed: the grids and
the rounds decide the zones to the last bit. Free to change: the notes.
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

# most training points from the parameters' steps: the time to fit a GP grows with their cube
OWN_GRID_POINTS = 1_500
MOST_POINTS = 5_000  # most training points that a caller may give
# most points of the dense grid in a scenario with a `search`, which takes milliseconds a point
SEARCHED_GRID = 8_000
ADDED_AT_ONCE = 500  # most training points that one round adds
EDGE = 1e-9  # unit-box length; a point this close to an edge of the space counts as on the edge
ERROR_WORTH_A_NOTE = 0.01  # share of the space on the wrong side of the GP's boundary


def dense_grid(
    logical: LogicalScenario, axes: list[list[float]], settings: ZoneSettings
) -> tuple[list[list[float]], FloatArray, BoolArray]:
    """The dense grid: its axes, its g points, (g, k), and which of these satisfy the constraints,
    (g,).

    axes: values of each parameter on the grid of its own steps.
    settings: `[method.zones]`: `grid_points`, the most points.

    Raises InputError where no point satisfies the constraints.
    """
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


class _Fit(NamedTuple):
    """One fit of the GP.

    training: training points, (n, k).
    surface: the GP.
    y: of the GP on the dense grid, (g,).
    wrong: whether y has the wrong sign at a point that satisfies the constraints, (g,).
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
) -> _Fit:
    """Fit the GP in at most `rounds` rounds, and return the fit with the fewest wrong grid points.

    training: training points of the first round, (n, k).
    grid: points of the dense grid, (g, k).
    feasible: which of these satisfy the constraints, (g,).
    settings: `[method.zones]`.

    While more than `ERROR_WORTH_A_NOTE` of the dense grid is wrong, at most `ADDED_AT_ONCE` wrong
    points, drawn at random, become training points of the next round.
    """
    exact = np.zeros(len(grid), bool)
    exact[feasible] = exactly_hazardous(logical, grid[feasible], settings)
    unit = logical.to_unit(grid)
    n_first = len(training)
    n_feasible = feasible.sum()
    fits: list[_Fit] = []
    for _ in range(rounds):
        danger = criticality(logical, training, settings)
        surface, notes = fit(logical, training, danger, settings)
        y = surface.value(unit)
        wrong = feasible & ((y <= 0.0) != exact)
        if added := len(training) - n_first:
            notes += [f"{added} training points were added where the GP was on the wrong side."]
        fits.append(_Fit(training, surface, y, wrong, tuple(notes)))
        if wrong.sum() <= ERROR_WORTH_A_NOTE * n_feasible:
            break
        more = np.random.default_rng(SEED).permutation(np.flatnonzero(wrong))[:ADDED_AT_ONCE]
        training = np.unique(np.concatenate([training, grid[more]]), axis=0)
    best = min(fits, key=lambda each: each.wrong.sum())
    share = best.wrong.sum() / n_feasible
    if share > ERROR_WORTH_A_NOTE:
        remark = f"The GP puts {100 * share:.1f} % of the space in the wrong zone: add points."
        best = best._replace(notes=(*best.notes, remark))
    return best


def own_axes(logical: LogicalScenario) -> tuple[list[list[float]], tuple[str, ...]]:
    """Values of each parameter: low, low + step, ... high. Fewer where their grid would be too
    large for a GP; then the second part of the result is a note on it.

    Raises InputError where even two values of each parameter make too large a grid.
    """
    counts = [_own_count(parameter) for parameter in logical.parameters]
    own = prod(counts)  # points of the scenario's own grid
    # most parameters: two values of each make 2**most points, within `OWN_GRID_POINTS`
    most = OWN_GRID_POINTS.bit_length() - 1
    if len(counts) > most:
        raise InputError(
            f"Scenario `{logical.name}` must have at most {most} parameters, since its zones are "
            f"learnt from a grid, got {len(counts)}: give some of them a fixed value."
        )
    # Take one value from the longest axis again and again, until the grid is small enough. An axis
    # longer than the largest grid is cut to its size at once, to save steps.
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
    """Number of values of a parameter: low, low + step, ... high. The last step may be shorter."""
    extent = decimal(parameter.high) - decimal(parameter.low)
    return ceil(extent / decimal(parameter.step)) + 1


def _axis(parameter: Parameter, count: int) -> list[float]:
    """Values of a parameter: low, low + step, ... high. If `count` is fewer than these, that many
    evenly spaced values.
    """
    if count < _own_count(parameter):
        return evenly(parameter, count)
    low, step = decimal(parameter.low), decimal(parameter.step)
    return [*(float(low + step * index) for index in range(count - 1)), float(parameter.high)]


def _refine(axes: list[list[float]], most: int) -> list[list[float]]:
    """Axes with every interval split into equal parts, as many as keep the grid within `most`
    points. The old values stay on the axes.

    Parts are computed as decimals: two parameters that a constraint compares must get equal floats
    where their values are equal.
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
    """Training points from a caller, sorted, each once, (n, k).

    points: in the parameters' units. Raises InputError for another shape, for too many points, and
    for points outside the box.
    """
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
    """Points in the unit box, (..., k). Raises InputError for a point that lies outside the
    parameters' ranges by more than rounding (`EDGE`).

    points: (..., k), in the parameters' units.
    """
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
