"""Zones of a space at the points of a map, and of a lattice over the whole space, for the data of
the report's page.

Users: `report/page_data.py`.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.method.point_criticality import exact_target
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.map_view import View, slice_points
from sumo_eval.trajectory import FloatArray

LATTICE_POINTS = 32_000  # about, of the lattice of a whole space
LEAST_LATTICE, MOST_LATTICE = 4, 73  # points on each axis of the lattice
MAP_CELLS = 72  # cells on each axis of a zone map's background
# of maps and lattices where a search finds the criticality, which takes 3 ms a point
SEARCHED_CELLS, SEARCHED_LATTICE_POINTS = 16, 1_500

Levels = NDArray[np.int16]


def zone_levels(zones: ZonePartition, points: FloatArray) -> list[Levels]:
    """The zones at points (n, k) as arrays (n,) of 16 bits.

    First y of the GP times 32000: 0 is the boundary, more is safe. Then y of the criterion itself,
    in the same way. Then the room of each constraint (`rooms_of`): at an impossible point one of
    these is below 0.
    """
    exact = exact_target(zones.logical, points, zones.settings)
    return [_levels(zones.predicted(points)), _levels(exact), *rooms_of(zones.logical, points)]


def map_points(
    logical: LogicalScenario, view: View, panel: int
) -> tuple[dict[str, Any], FloatArray]:
    """Values of x and y at the corners of a map's cells, and the points there, (n, k), y
    slowest.
    """
    ticks = np.linspace(0.0, 1.0, (MAP_CELLS if logical.search is None else SEARCHED_CELLS) + 1)
    points = slice_points(logical, view, panel, ticks, np.array([0.5]) if view.y is None else ticks)
    low, span = logical.low, logical.high - logical.low
    axes = {
        name: np.round(low[column] + ticks * span[column], 6).tolist()
        for name, column in (("x", view.x), ("y", view.y))
        if column is not None
    }
    return {"y": [0.0]} | axes, points.reshape(-1, points.shape[-1])  # [0.0]: a strip has no y


def lattice_points(logical: LogicalScenario) -> tuple[int, FloatArray] | None:
    """Number of points on each axis of a lattice over the whole space, the ends included, and its
    points, (n, k), the last parameter fastest; None for one parameter, and where it would be too
    large.
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
    """Each constraint's room at points (n, k), scaled to 1..32000, negated at points that the
    constraint rules out; 32000 everywhere if only its sign is known.
    """
    values = logical.columns(points)
    rooms = []
    for constraint in logical.constraints:
        holds = np.broadcast_to(constraint.holds(values), len(points))
        room = np.ones(len(points)) if constraint.room is None else np.abs(constraint.room(values))
        # nan and inf become 0: the largest room scales all
        room = np.broadcast_to(np.nan_to_num(room, nan=0.0, posinf=0.0), len(points))
        # 1 more than the room: a room of 0, too, shows whether the constraint holds
        steps = np.round(room / max(float(room.max()), 1e-300) * 31_999.0) + 1.0
        rooms.append(np.where(holds, steps, -steps).astype("<i2"))
    return rooms


def _levels(y: FloatArray) -> Levels:
    levels = np.clip(np.round(y * 32000.0), -32000, 32000)
    # rounding must move no point into the hazardous zone
    return np.where((y > 0.0) & (levels == 0.0), 1.0, levels).astype("<i2")
