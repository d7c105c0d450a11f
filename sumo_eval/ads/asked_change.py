"""The lane change that an ego has to make, for rules that choose their own gap (`idm`, those that
overtake). A rule for the pedals alone changes at the fixed place (`lane_change.lane_kept`).

path: the ego's `lane_change.PATH`; its offset is 0 until the change has begun.
way: the change that the scenario asks for (`cosim.records._WAY`).

Users: `ads/car_following.py`.
"""

from typing import Any

from sumo_eval.ads.lane_change import shortest_duration
from sumo_eval.ads.perception import bumper_gap, neighbours
from sumo_eval.kernels import kernel
from sumo_eval.scenario.concrete import CHANGE_TIME, LEAST_CHANGE

# s, shortest headway accepted ahead and behind: short, because the change must be made (LMRS:
# 0.56 s)
HEADWAY = 0.6
GAP = 2.0  # m, shortest gap accepted ahead and behind, however slow the vehicles are
DECELERATION = 3.0  # m/s2 that a vehicle from behind need not exceed (UN R79, 5.6.4.7)
DELAY = 0.4  # s after the change began until that vehicle brakes (UN R79, 5.6.4.7)
LATERAL = 2.0  # m/s2, peak of the lateral acceleration in the shortest change
STRIP = 0.2  # m on each side of the body in the strip of the other lane that must be free


@kernel
def beside(way: Any, me: Any, others: Any, scenario: Any) -> tuple[int, int]:
    """Indexes of the nearest vehicles ahead and behind in the lane to change to, -1: none. One
    alongside the ego is both.
    """
    return neighbours(me, others, way.start + way.offset, scenario.vehicle.width + 2.0 * STRIP)


@kernel
def change_if_free(path: Any, way: Any, me: Any, others: Any, scenario: Any) -> bool:
    """Begin the lane change in `path` if it may begin here and the gap in the other lane is free.

    Returns whether the change has begun, now or before.
    """
    if path.offset != 0.0:
        return True
    speed = me.along
    room = way.by - me.x  # m of road left for the change
    # m of road that the shortest change takes
    shortest = max(shortest_duration(way.offset, LATERAL) * speed, LEAST_CHANGE)
    # not yet, or too late; where the ego's lane ends, a late change is better than none
    if me.x < way.begin or (room < shortest and way.ends == 0):
        return False
    duration = shortest / max(speed, 1.0)  # s, at no less than 1 m/s, so that it stays finite
    ahead, behind = beside(way, me, others, scenario)
    if ahead >= 0:
        closing = max(speed - others[ahead].along, 0.0)
        if bumper_gap(me, others[ahead]) - closing * duration < max(HEADWAY * speed, GAP):
            return False
    if behind >= 0:
        closing = max(others[behind].along - speed, 0.0)
        least = (
            closing * DELAY
            + closing * closing / (2.0 * DECELERATION)
            + HEADWAY * others[behind].along
        )
        if bumper_gap(others[behind], me) < max(least, GAP):
            return False
    path.offset, path.begin = way.offset, me.x
    # the usual time, as far as the road allows
    path.length = max(min(CHANGE_TIME * speed, room), shortest)
    return True
