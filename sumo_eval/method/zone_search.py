"""Search on the zones' Gaussian process (GP) for boundary points and most dangerous points.

Users: `method/zone_partition.py`. Fixed: results to the last bit, because Eq. 16's weights r follow
from the most dangerous points.
"""

from collections.abc import Callable

import numpy as np

from sumo_eval.method.point_criticality import criticality
from sumo_eval.method.zone_surface import Surface
from sumo_eval.method.zone_training import EDGE
from sumo_eval.scenario import LogicalScenario
from sumo_eval.scenario.sampling.grid import mesh
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

# Half of the window, unit-box length, at which the search for a most dangerous point ends. The
# second one is for a scenario with a `search`, which takes milliseconds a point.
SMALLEST_WINDOW, SEARCHED_WINDOW = 1e-12, 1e-3
ROUNDS = 200  # most windows of this search; usually the smallest window is reached long before
REGULA_FALSI = 5  # steps that put a crossing of a grid line onto the curved surface
HALF_STEPS = 60  # of the search for the nearest boundary point

Members = Callable[[FloatArray], FloatArray]
"""Those of some points (n, k), in the parameters' units, that are in a zone."""


def exists(logical: LogicalScenario, unit: FloatArray) -> BoolArray:
    """Whether each point satisfies the constraints, or would if it were moved by rounding (`EDGE`)
    along some of the axes, (...).

    unit: points in the unit box, (..., k).
    """
    holds = np.asarray(logical.feasible(logical.from_unit(unit)))
    if not holds.all():
        nudges = EDGE * mesh([[-1.0, 0.0, 1.0]] * unit.shape[-1])
        nudged = np.clip(unit[~holds][:, None, :] + nudges, 0.0, 1.0)
        holds[~holds] = logical.feasible(logical.from_unit(nudged)).any(axis=1)
    return holds


def crossings(
    logical: LogicalScenario, surface: Surface, unit: FloatArray, y: FloatArray
) -> FloatArray:
    """Points of the space where a line between neighbours on the dense grid crosses y = 0, unit
    box, (b, k).

    unit: points of the grid, unit box, (d1, ..., dk, k), di points along axis i.
    y: the GP's value at each, (d1, ..., dk).
    """
    parts = []
    for axis in range(y.ndim):
        # neighbours along this axis are neighbours along the first axis of these
        along_y, along_unit = np.moveaxis(y, axis, 0), np.moveaxis(unit, axis, 0)
        changes = (along_y[:-1] <= 0.0) != (along_y[1:] <= 0.0)
        x0, x1 = along_unit[:-1][changes], along_unit[1:][changes]
        y0, y1 = along_y[:-1][changes], along_y[1:][changes]
        parts.append(_crossing(surface, x0, x1, y0, y1))
    points = np.concatenate(parts)
    return points[exists(logical, points)]


def _crossing(
    surface: Surface, x0: FloatArray, x1: FloatArray, y0: FloatArray, y1: FloatArray
) -> FloatArray:
    """Where y is 0 on the line from x0 to x1, unit box, (c, k), by regula falsi.

    x0, x1: ends of the lines, unit box, (c, k). Overwritten.
    y0, y1: y at the ends, of different signs, (c,). Overwritten.

    One step, a straight line through y0 and y1, would end off the curved boundary, and
    `boundary_distance` would be too short.
    """
    for _ in range(REGULA_FALSI):
        crossing = x0 + (y0 / (y0 - y1))[:, None] * (x1 - x0)
        value = surface.value(crossing)
        first = (value <= 0.0) == (y0 <= 0.0)  # True: the crossing replaces x0
        x0[first], y0[first] = crossing[first], value[first]
        x1[~first], y1[~first] = crossing[~first], value[~first]
    return crossing


def nearest_on_boundary(surface: Surface, unit: FloatArray, foot: FloatArray) -> FloatArray:
    """The point of y = 0 nearest to each point, unit box, (..., k).

    unit: the points, unit box, (..., k).
    foot: a point of y = 0 near each, where the search begins, unit box, (..., k).

    Each step takes y as linear around `foot`, projects `unit` onto the plane where the linear y is
    0, and moves `foot` half of the way to this projection. Whole steps would diverge where the
    boundary's radius of curvature is less than the distance.
    """
    for _ in range(HALF_STEPS):
        slope = surface.gradient(foot)
        linear_y = surface.value(foot) + np.sum(slope * (unit - foot), axis=-1)
        slope_squared = np.maximum(np.sum(slope**2, axis=-1), np.finfo(float).tiny)
        projected = np.clip(unit - (linear_y / slope_squared)[..., None] * slope, 0.0, 1.0)
        foot = (foot + projected) / 2.0
    return foot


def most_dangerous_point(
    logical: LogicalScenario,
    settings: ZoneSettings,
    members: Members,
    candidates: FloatArray,
    cell: float,
) -> dict[str, float]:
    """The most dangerous point of a zone, first in the order of `_by_danger`: name -> value.

    settings: `[method.zones]`.
    members: of the zone.
    candidates: points at which the search may begin, (n, k), in the parameters' units.
    cell: half of the first window's width, unit box.

    The search begins at the worst candidate in the zone. Each round looks at a small grid, the
    window, around the best point so far. It moves to the worst point of the zone in the window. If
    none is worse, it shrinks the window. This finds corners between a constraint and the box, where
    no grid point lies. In the end the point is rounded.
    """
    searched = logical.search is not None
    k = len(logical.parameters)
    inside = members(candidates)
    best = inside[_by_danger(logical, settings, inside)[0]]
    half_width = cell
    # values on each axis of a window, fewer with more parameters: a window of k parameters has the
    # k-th power of them
    values_per_axis = 3 if searched else {1: 21, 2: 15, 3: 9, 4: 5}.get(k, 3)
    offsets = mesh([np.linspace(-1.0, 1.0, values_per_axis).tolist()] * k)
    for _ in range(ROUNDS):
        around = logical.from_unit(np.clip(logical.to_unit(best) + half_width * offsets, 0.0, 1.0))
        rows = np.concatenate([best[None, :], around[logical.feasible(around)]])
        order = _by_danger(logical, settings, rows)
        # `best` is row 0, whose place in `order` is argmin(order). The rows before it are more
        # dangerous. Only these are looked up in the zone, because the GP takes most of the time.
        worse = members(rows[order[: np.argmin(order)]])
        if len(worse):
            best = worse[0]
        else:
            half_width *= 0.4
        if half_width < (SEARCHED_WINDOW if searched else SMALLEST_WINDOW):
            break
    rounded = _rounded(logical, members, best, SEARCHED_WINDOW if searched else 1e-7)
    return dict(zip(logical.names, rounded.tolist(), strict=True))


def _rounded(
    logical: LogicalScenario, members: Members, point: FloatArray, tolerance: float
) -> FloatArray:
    """The point with the fewest decimal places with which it moves by less than `tolerance`
    (unit-box length) along each axis, and stays in its zone.
    """
    for digits in range(10):  # if 9 places are too few, the point stays as it is
        rounded = np.clip(np.round(point, digits), logical.low, logical.high)
        near = np.all(np.abs(logical.to_unit(rounded) - logical.to_unit(point)) < tolerance)
        if near and len(members(rounded[None, :])):
            return rounded
    return point


def _by_danger(logical: LogicalScenario, settings: ZoneSettings, points: FloatArray) -> IntArray:
    """Indices of points (n, k), the most dangerous first: by largest impact speed, then by largest
    max ITTC, smallest gap, smallest parameters.
    """
    danger = criticality(logical, points, settings)
    # rounded, so that the last digit does not decide between points of equal danger
    keys = (np.round(danger.gap, 9), -np.round(danger.inverse, 9), -np.round(danger.impact, 9))
    # lexsort takes the last key first, so the first parameter is the last of its block
    return np.lexsort((*points.T[::-1], *keys))
