"""Zones of a space at the points of a map, and at a lattice over the whole space, as whole numbers
for the data of the report's page.

Users: `report/page_data.py`. Fixed: scales and order of the arrays, which the page's JavaScript
reads.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.method.point_criticality import exact_target
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.map_view import View, slice_points
from sumo_eval.trajectory import FloatArray

LATTICE_POINTS = 32_000  # about this number of points in the lattice of a whole space
LEAST_LATTICE, MOST_LATTICE = 4, 73  # fewest and most points on each axis of the lattice
MAP_CELLS = 72  # cells on each axis of a zone map's background
# MAP_CELLS and LATTICE_POINTS of a scenario with a `search`, which takes 3 ms a point
SEARCHED_CELLS, SEARCHED_LATTICE_POINTS = 16, 1_500
SCALE = 32_000  # the whole number for y = 1; within 16 bits

Levels = NDArray[np.int16]


def zone_levels(zones: ZonePartition, points: FloatArray) -> list[Levels]:
    """The zones at points as arrays of 16-bit numbers, (n,) each.

    points: (n, k), in the parameters' units.

    1. y of the GP times `SCALE`; at most 0 is hazardous.
    2. y of the criterion itself, in the same way.
    3. The room of each constraint (`rooms_of`). A point is impossible if one of them is below 0.
    """
    exact = exact_target(zones.logical, points, zones.settings)
    return [_levels(zones.predicted(points)), _levels(exact), *rooms_of(zones.logical, points)]


def map_points(
    logical: LogicalScenario, view: View, panel: int
) -> tuple[dict[str, Any], FloatArray]:
    """Corners of the cells of a map: axis (`x`, `y`) -> values, and the points, (n, k), y slowest.

    panel: index of the map's panel.
    """
    ticks = np.linspace(0.0, 1.0, (MAP_CELLS if logical.search is None else SEARCHED_CELLS) + 1)
    points = slice_points(logical, view, panel, ticks, np.array([0.5]) if view.y is None else ticks)
    low, span = logical.low, logical.high - logical.low
    axes = {
        name: np.round(low[column] + ticks * span[column], 6).tolist()
        for name, column in (("x", view.x), ("y", view.y))
        if column is not None
    }
    # a strip has no y: one value stands for it
    return {"y": [0.0]} | axes, points.reshape(-1, points.shape[-1])


def lattice_points(logical: LogicalScenario) -> tuple[int, FloatArray] | None:
    """A lattice over the whole space: number of points on each axis, the ends included, and its
    points, (n, k), the last parameter fastest. None for a space of one parameter, and for one whose
    lattice would be too large.
    """
    k = len(logical.parameters)
    most = LATTICE_POINTS if logical.search is None else SEARCHED_LATTICE_POINTS
    size = max(LEAST_LATTICE, min(MOST_LATTICE, int(most ** (1.0 / k))))
    if k < 2 or size**k > 4 * most:
        return None
    ticks = np.linspace(0.0, 1.0, size)
    # clipped: rounding may move a point past the end of a range
    unit = np.stack(np.meshgrid(*[ticks] * k, indexing="ij"), axis=-1).reshape(-1, k)
    return size, np.clip(logical.from_unit(unit), logical.low, logical.high)


def rooms_of(logical: LogicalScenario, points: FloatArray) -> list[Levels]:
    """Each constraint's room, the distance to its limit, at points (n, k): scaled to 1..`SCALE`,
    negative at points that the constraint rules out, (n,) each. If the room is not known, it is
    `SCALE` everywhere.
    """
    values = logical.columns(points)
    rooms = []
    for constraint in logical.constraints:
        holds = np.broadcast_to(constraint.holds(values), len(points))
        room = np.ones(len(points)) if constraint.room is None else np.abs(constraint.room(values))
        # nan and inf become 0, because the largest room is the divisor of all
        room = np.broadcast_to(np.nan_to_num(room, nan=0.0, posinf=0.0), len(points))
        # from 1 on, so that a room of 0 has a sign too; 1e-300 avoids a division by 0
        steps = np.round(room / max(float(room.max()), 1e-300) * (SCALE - 1)) + 1.0
        rooms.append(np.where(holds, steps, -steps).astype("<i2"))
    return rooms


def _levels(y: FloatArray) -> Levels:
    """y times `SCALE` as 16-bit numbers, (n,)."""
    levels = np.clip(np.round(y * SCALE), -SCALE, SCALE)
    # rounding must not move a safe point into the hazardous zone, which includes 0
    return np.where((y > 0.0) & (levels == 0.0), 1.0, levels).astype("<i2")
