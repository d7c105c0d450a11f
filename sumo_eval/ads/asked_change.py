"""The lane change that a scenario asks of the ego, for rules that choose their own gap in the other
lane: `idm`, and those that overtake. A rule that decides on the pedals alone changes lanes at the
fixed place (`lane_change.lane_kept`).

Arguments of the functions here:

path: the ego's `lane_change.PATH`; its offset is 0 until the change has begun.
way: the requested lane change, `EGO["way"]` of `cosim.records`.
me, others: the ego and the actors, as `MOVER`s. scenario: a `SCENARIO` record.

Users: `ads/car_following.py`; `ads/overtaking.py`, which takes the limits and `closes_by`, but not
`GAP`, and has its own headway to the vehicle behind.
"""

from typing import Any

from sumo_eval.ads.lane_change import shortest_duration
from sumo_eval.ads.perception import bumper_gap, neighbours
from sumo_eval.kernels import kernel
from sumo_eval.scenario.concrete import CHANGE_TIME, LEAST_CHANGE

# s, shortest headway accepted ahead and behind: short, because the change must be made (LMRS, the
# lane-change model of Schakel et al. 2012: 0.56 s)
HEADWAY = 0.6
GAP = 2.0  # m, shortest gap accepted ahead and behind, however slow the vehicles are
REAR_DECELERATION = 3.0  # m/s2 that a vehicle from behind need not exceed (UN R79, 5.6.4.7)
REAR_DELAY = 0.4  # s until that vehicle brakes (UN R79, 5.6.4.7)
COMFORTABLE_LATERAL = 2.0  # m/s2, peak of a quick but ordinary lane change: 3.2 s for 3.5 m
SIDE_CLEARANCE = 0.2  # m that must be free on each side of the body, in the other lane
LEAST_SPEED = 1.0  # m/s, least speed to divide by


@kernel
def beside(way: Any, me: Any, others: Any, scenario: Any) -> tuple[int, int]:
    """Indexes of the nearest vehicles ahead and behind in the lane to change to; -1: none. A
    vehicle alongside the ego is both.
    """
    strip = scenario.vehicle.width + 2.0 * SIDE_CLEARANCE
    return neighbours(me, others, way.start + way.offset, strip)


@kernel
def closes_by(closing: float, wait: float) -> float:
    """Distance by which the gap to a vehicle behind closes until that vehicle is as slow as the
    ego, m.

    closing: speed by which it is faster, m/s. wait: s until it brakes.
    """
    return closing * wait + closing * closing / (2.0 * REAR_DECELERATION)


@kernel
def change_if_free(path: Any, way: Any, me: Any, others: Any, scenario: Any) -> bool:
    """Begin the lane change if it may begin here and the gap in the other lane is free: write it to
    `path`. Returns whether the change has begun, now or before.
    """
    if path.offset != 0.0:
        return True
    speed = me.along
    room = way.by - me.x  # m of road for the change
    # m of road that the shortest change takes
    shortest = max(shortest_duration(way.offset, COMFORTABLE_LATERAL) * speed, LEAST_CHANGE)
    if me.x < way.begin:  # not yet
        return False
    # too late; but where the ego's lane ends, a late change is better than none
    if room < shortest and way.ends == 0:
        return False
    if not _gap_is_free(way, me, others, shortest / max(speed, LEAST_SPEED), scenario):
        return False
    path.offset, path.begin = way.offset, me.x
    # the usual duration, as far as the road allows
    path.length = max(min(CHANGE_TIME * speed, room), shortest)
    return True


@kernel
def _gap_is_free(way: Any, me: Any, others: Any, duration: float, scenario: Any) -> bool:
    """Whether the vehicles ahead and behind in the other lane leave enough gap for a change that
    takes `duration` s.
    """
    speed = me.along
    ahead, behind = beside(way, me, others, scenario)
    if ahead >= 0:
        closing = max(speed - others[ahead].along, 0.0)
        if bumper_gap(me, others[ahead]) - closing * duration < max(HEADWAY * speed, GAP):
            return False
    if behind >= 0:
        closing = max(others[behind].along - speed, 0.0)
        least = closes_by(closing, REAR_DELAY) + HEADWAY * others[behind].along
        if bumper_gap(others[behind], me) < max(least, GAP):
            return False
    return True
