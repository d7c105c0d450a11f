"""Search on the zones' Gaussian process for boundary points and most dangerous points.

Users: `method/zone_partition.py`.
"""

from typing import Any

import numpy as np

from sumo_eval.method.point_criticality import criticality
from sumo_eval.method.zone_surface import Surface
from sumo_eval.method.zone_training import EDGE
from sumo_eval.scenario import LogicalScenario
from sumo_eval.scenario.sampling.grid import mesh
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

# Unit-box length at which the search for a most dangerous point ends where criticality is searched
# over time.
SEARCHED_WINDOW = 1e-3


def exists(logical: LogicalScenario, unit: FloatArray) -> BoolArray:
    """Whether each unit point (..., k), or one of its neighbours at `EDGE` along any of the axes,
    satisfies the constraints.
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
    """Points of the space where a line between neighbours on the dense grid crosses y = 0, (m, k).

    unit: points of the grid, unit box, (..., k).
    y: the GP's value at each, (...).
    """
    parts = []
    for axis in range(y.ndim):
        # neighbours along this axis are neighbours along the first axis of these
        along_y, along_unit = np.moveaxis(y, axis, 0), np.moveaxis(unit, axis, 0)
        changes = (along_y[:-1] <= 0.0) != (along_y[1:] <= 0.0)
        y0 = along_y[:-1][changes]
        y1 = along_y[1:][changes]
        x0 = along_unit[:-1][changes]
        x1 = along_unit[1:][changes]
        # Five steps of regula falsi put each crossing onto the curved surface. One straight line
        # would put it off the boundary, and `boundary_distance` would be too short.
        for _ in range(5):
            crossing = x0 + (y0 / (y0 - y1))[:, None] * (x1 - x0)
            value = surface.value(crossing)
            first = (value <= 0.0) == (y0 <= 0.0)  # True: the crossing replaces x0
            x0[first], y0[first] = crossing[first], value[first]
            x1[~first], y1[~first] = crossing[~first], value[~first]
        parts.append(crossing)
    points = np.concatenate(parts)
    return points[exists(logical, points)]


def nearest_on_boundary(surface: Surface, unit: FloatArray, foot: FloatArray) -> FloatArray:
    """The point of y = 0 that is nearest to each unit point, (..., k).

    foot: a point of y = 0 near each.

    Each round takes the surface as linear around `foot`, projects the unit point onto the plane
    where that is 0, and moves `foot` half of the way there. Whole steps would diverge where the
    boundary's radius of curvature is less than the distance.
    """
    for _ in range(60):
        slope = surface.gradient(foot)
        linear_y = surface.value(foot) + np.sum(slope * (unit - foot), axis=-1)
        slope_squared = np.maximum(np.sum(slope**2, axis=-1), np.finfo(float).tiny)
        projected = np.clip(unit - (linear_y / slope_squared)[..., None] * slope, 0.0, 1.0)
        foot = (foot + projected) / 2.0
    return foot


def most_dangerous_point(
    zones: Any, number: int, candidates: FloatArray, cell: float
) -> dict[str, float]:
    """The most dangerous point of a zone, in the order of `_by_danger`.

    zones: a `ZonePartition`, which imports this file.
    number: of the zone.
    candidates: points at which the search may begin, (n, k).
    cell: half of the first window's width, unit box.

    The search begins at the worst candidate in the zone. In each round it looks around its point in
    a window: it moves to the worst point of the zone there, or shrinks the window if there is no
    worse point. The windows find corners between a constraint and the box, where no grid point
    lies. At last the point is rounded.
    """
    logical = zones.logical
    searched = logical.search is not None
    k = len(logical.parameters)
    members = zones.members(number, candidates)
    best = members[_by_danger(zones, members)[0]]
    half_width = cell
    # values on each axis of a window; fewer with more parameters, as a window has their k-th power
    values_per_axis = 3 if searched else {1: 21, 2: 15, 3: 9, 4: 5}.get(k, 3)
    offsets = mesh([np.linspace(-1.0, 1.0, values_per_axis).tolist()] * k)
    for _ in range(200):  # a bound; usually the window is small enough long before
        around = logical.from_unit(np.clip(logical.to_unit(best) + half_width * offsets, 0.0, 1.0))
        rows = np.concatenate([best[None, :], around[logical.feasible(around)]])
        order = _by_danger(zones, rows)
        # `best` is row 0. Its place in `order` is argmin(order); the rows before it are worse. Only
        # these are looked up in the zone, because the GP takes most of the time.
        worse = zones.members(number, rows[order[: np.argmin(order)]])
        if len(worse):
            best = worse[0]
        else:
            half_width *= 0.4
        if half_width < (SEARCHED_WINDOW if searched else 1e-12):
            break
    rounded = _rounded(zones, number, best, SEARCHED_WINDOW if searched else 1e-7)
    return dict(zip(logical.names, rounded.tolist(), strict=True))


def _rounded(zones: Any, number: int, point: FloatArray, tolerance: float) -> FloatArray:
    """The point with the fewest digits with which it moves by less than a tolerance, in unit-box
    length, and stays in its zone.
    """
    logical = zones.logical
    for digits in range(10):  # at 10 digits and more, the point stays as it is
        rounded = np.clip(np.round(point, digits), logical.low, logical.high)
        near = np.all(np.abs(logical.to_unit(rounded) - logical.to_unit(point)) < tolerance)
        if near and len(zones.members(number, rounded[None, :])):
            return rounded
    return point


def _by_danger(zones: Any, points: FloatArray) -> IntArray:
    """Indices of points (n, k), the most dangerous first: by largest impact speed, largest ITTC,
    smallest gap, smallest parameters, in this order.
    """
    danger = criticality(zones.logical, points, zones.settings)
    # rounded, so that the last digit does not decide between points of equal danger
    keys = (np.round(danger.gap, 9), -np.round(danger.inverse, 9), -np.round(danger.impact, 9))
    return np.lexsort((*points.T[::-1], *keys))  # the last key counts first
