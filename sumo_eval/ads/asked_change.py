"""The lane change that an ego has to make: where it may, when it is free, what to follow and where
to wait until then.

For those who choose their own gap. Whose rule is for the pedals changes at the fixed place
(`lane_change.lane_kept`).
"""

from __future__ import annotations

import math
from typing import Any

from sumo_eval.ads.lane_change import shortest_duration
from sumo_eval.ads.perception import bumper_gap, gap_behind, neighbours
from sumo_eval.kernels import kernel
from sumo_eval.scenario.concrete import CHANGE_TIME, LEAST_CHANGE

# s, shortest headway accepted on both sides of a gap that has to be taken (LMRS: 0.56 s)
HEADWAY = 0.6
GAP = 2.0  # m left on both sides at a crawl
DECELERATION = 3.0  # m/s2 that whoever comes from behind need not exceed (UN R79, 5.6.4.7)
DELAY = 0.4  # s after the change began until he brakes (UN R79, 5.6.4.7)
LATERAL = 2.0  # m/s2, peak of the shortest change
STRIP = 0.2  # m on each side of the body in the strip of the other lane that must be free


@kernel
def is_waiting(path: Any, way: Any) -> bool:
    """Whether the lane change has yet to begin."""
    return bool(way.asked != 0 and path.offset == 0.0)


@kernel
def beside(way: Any, me: Any, others: Any, scenario: Any) -> tuple[int, int]:
    """Indexes of the nearest vehicles ahead and behind in the lane to change to, -1: none."""
    strip = scenario.vehicle.width + 2.0 * STRIP
    return neighbours(me, others, way.start + way.offset, strip)


@kernel
def change_if_free(path: Any, way: Any, me: Any, others: Any, scenario: Any) -> bool:
    """Begin the lane change in `path` if it may begin here and the gap beside is free; whether it
    has begun.
    """
    if not is_waiting(path, way):
        return True
    room = way.by - me.x
    shortest = max(shortest_duration(way.offset, LATERAL) * me.along, LEAST_CHANGE)
    if me.x < way.begin or (room < shortest and way.ends == 0):
        return False
    duration = shortest / max(me.along, 1.0)
    ahead, behind = beside(way, me, others, scenario)
    if ahead >= 0:
        closing = max(me.along - others[ahead].along, 0.0)
        if bumper_gap(me, others[ahead]) - closing * duration < max(HEADWAY * me.along, GAP):
            return False
    if behind >= 0:
        closing = max(others[behind].along - me.along, 0.0)
        least = (
            closing * DELAY
            + closing * closing / (2.0 * DECELERATION)
            + HEADWAY * others[behind].along
        )
        if gap_behind(me, others[behind]) < max(least, GAP):
            return False
    path.offset, path.begin = way.offset, me.x
    path.length = max(min(CHANGE_TIME * me.along, room), shortest)
    return True


@kernel
def road_left(path: Any, way: Any, me: Any) -> float:
    """Road until where the ego waits if it cannot change, from its front, m: a shortest change
    before the end of its lane; inf where that lane continues, or the change has begun.
    """
    if way.ends == 0 or not is_waiting(path, way):
        return math.inf
    return float(way.by - LEAST_CHANGE - me.x - me.half_length)


@kernel
def lead_beside(way: Any, me: Any, others: Any, scenario: Any) -> int:
    """Index of the vehicle behind which the ego will be in the other lane, from where it may change
    on, -1: none.
    """
    if me.x < way.begin:
        return -1
    ahead, _ = beside(way, me, others, scenario)
    if ahead >= 0 and bumper_gap(me, others[ahead]) <= 0.0:
        return -1
    return ahead
