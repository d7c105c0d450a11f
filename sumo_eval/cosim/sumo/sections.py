"""The sections of a road in SUMO: stretches with the same lanes throughout, each with an edge of
its own, and the routes of vehicles along these edges.

Fixed: the edges' names, which users' ADSs and shipped networks contain.

Users: `cosim/ego_motion.py`, `cosim/on_traci.py`, `cosim/stage.py`, `cosim/sumo/gui_replay.py`,
`cosim/sumo/shared_files.py`, `cosim/sumo/sumo_files.py`.
"""

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from sumo_eval.scenario.concrete import ConcreteScenario, Road, lane_at

_EDGE = "road"  # id of a road's edge; if the road has several, each with its number added


def road_edges(road: Road) -> tuple[str, ...]:
    """Ids of the edges along a road, without its ramps and crossings."""
    if road.network is not None:
        return road.network.edges
    return tuple(section.edge for section in sections(road))


class RoadSection(NamedTuple):
    """A stretch of a road with the same lanes throughout; it has an edge of its own.

    begin, end: m along the road.
    lanes: numbers of the road's lanes on this edge, from the right. SUMO numbers the lanes of each
        edge from 0.
    ramp: number of the road's lane that is a ramp here, with an edge of its own, `ramp_edge`; -1:
        none.
    """

    edge: str
    begin: float
    end: float
    lanes: tuple[int, ...]
    ramp: int
    ramp_edge: str


@functools.lru_cache(maxsize=64)
def sections(road: Road) -> tuple[RoadSection, ...]:
    """The sections of a road: a new one wherever a lane begins, ends, or starts or stops being a
    ramp.

    SUMO knows no lanes that become narrower: those of a section have their full width throughout.
    """
    last = road.end
    if not road.spans:
        return (RoadSection(_EDGE, 0.0, last, tuple(range(road.lanes)), -1, ""),)
    inside = {
        x
        for it in road.spans
        for x in (it.begin, it.end, it.parted_until, it.parted_from)
        if 0.0 < x < last
    }
    parts = []
    for number, (begin, end) in enumerate(itertools.pairwise([0.0, *sorted(inside), last])):
        lanes = []
        ramp = -1
        for lane in road.lanes_at(0.5 * (begin + end)):
            span = road.span(lane)
            # the lane is parted from the road all along this section
            if end <= span.parted_until or begin >= span.parted_from:
                ramp = lane
            else:
                lanes.append(lane)
        name = f"ramp{number}" if ramp >= 0 else ""
        parts.append(RoadSection(f"{_EDGE}{number}", begin, end, tuple(lanes), ramp, name))
    return tuple(parts)


def vehicle_edges(
    road: Road, y: float, goal: float | None = None, first: int = 0
) -> tuple[str, ...]:
    """The edges of a vehicle's route: of the lane at y up to the section in which the vehicle
    starts, then of the lane at `goal`.

    y, goal: m; goal None: y.
    first: number of the section in which the vehicle starts.
    """
    start, later = lane_at(road, y), lane_at(road, y if goal is None else goal)
    return tuple(
        section.ramp_edge if section.ramp == (later if number > first else start) else section.edge
        for number, section in enumerate(sections(road))
    )


def on_route(road: Road, route: Sequence[str], x: float, y: float) -> bool:
    """Whether the lane at a place is on a route of a straight road; beyond the road's end: true.

    x, y: m. route: `vehicle_edges`.
    """
    lane = lane_at(road, y)
    for section, edge in zip(sections(road), route, strict=True):
        if x <= section.end:
            is_ramp = edge == section.ramp_edge
            return lane == section.ramp if is_ramp else lane in section.lanes
    return True


def vehicle_routes(
    concrete: ConcreteScenario, starts: Sequence[Mapping[str, str]]
) -> dict[str, tuple[str, ...]]:
    """The edges of the vehicles' routes by the routes' names.

    starts: the vehicles' `departures`.
    """
    road = concrete.road
    if not road.spans:
        return {"along": road_edges(road)}
    way, y = concrete.ego.way, concrete.ego.y
    # y at the start, m, and after all lane changes, None without any
    goals = [(y, None if way is None else y + way.offset)] + [
        (it.start.y, it.y(math.inf) if it.lateral_moves else None) for it in concrete.actors
    ]
    return {
        it["route"]: vehicle_edges(road, begin, goal, int(it.get("departEdge", "0")))
        for it, (begin, goal) in zip(starts, goals, strict=True)
    }
