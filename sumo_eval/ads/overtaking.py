"""The decision to change to the left lane instead of following, and how quickly: for `lane_changer`
and the synthetic drivers.

A vehicle is in the ego's way (a lead) if, at the present speeds along the road, the ego's path
overlaps the vehicle where the ego reaches it. The same rule serves before a lane change, during it
for the vehicle that is overtaken, and after it for the lead in the new lane.

Arguments of most kernels here: memory, of `OVERTAKING`; me and others, the ego and the vehicles
that it knows, as `MOVER`s; watched, its memory of each vehicle, of `WATCHED`; habits, of `HABITS`;
scenario, a `SCENARIO` record.

Users: `ads/foresight.py`, `ads/lane_changer.py`, `drivers/synthetic/driver.py`,
`drivers/synthetic/population.py`. Fixed: constants and order of operations, which decide how
`lane_changer`, the synthetic drivers and evasions drive.
"""

from math import inf, isfinite
from typing import Any

from sumo_eval.ads.asked_change import (
    COMFORTABLE_LATERAL,
    HEADWAY,
    REAR_DELAY,
    SIDE_CLEARANCE,
    closes_by,
)
from sumo_eval.ads.car_following import FOLLOWED, change_as_asked, follow
from sumo_eval.ads.lane_change import (
    PATH,
    curvature_kept,
    keep_lane,
    path_y,
    share_when_done,
    shortest_duration,
    smooth_step,
)
from sumo_eval.ads.perception import bumper_gap, neighbours
from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.kernels import fields, flags, kernel
from sumo_eval.scenario.concrete import lane_at

# m, least free space across the road when the ego's front comes level with the lead's rear
CLEARANCE = 0.3
AT_EASE = 0.6  # m, free space across beyond which a vehicle ahead needs no more attention

# m/s2, peak of an evasion that ordinary drivers still master: 2.25 s for 3.5 m
EMERGENCY_LATERAL = 4.0
# share of the strongest braking; an ego that needs more does not rely on braking alone
EMERGENCY_BRAKING = 0.8
EMERGENCY_GAP = 2.0  # m left to a vehicle in the other lane after an evasion
# m/s: an ego speeds up only if it would pass clear even when faster by this
SPEED_RESERVE = 1.0
BRAKE_BUILD_UP = 0.1  # s, in which the gap closes before brakes hold
# m, shortest lane change, however slow the ego is: its path is a fifth as curved as a car can drive
LEAST_LENGTH = 20.0
# s before the left lane ends, or a line begins that must not be crossed: no lane change begins
# later
END_AHEAD = 10.0
LEAST_SPEED = 2.0  # m/s; a slower ego does not overtake
COMES_TOWARDS = 1.0  # m/s against the ego's direction, above which a vehicle is oncoming

# s, headway that is left to the vehicle behind once it has slowed down to the ego's speed. By UN
# R79, 5.6.4.7 (lane change, ACSF C), a lane change must not force that vehicle to brake harder than
# `asked_change.REAR_DECELERATION`, or earlier than `REAR_DELAY` after the ego's side has come to
# the line between the lanes.
REAR_HEADWAY = 1.0


@frozen
class OvertakingHabits:
    """Conditions under which an ego overtakes.

    inclined: whether it overtakes at all when not in danger.
    onset_headway, onset_ttc: headway and TTC, s; the change begins when the first of both is
        reached.
    duration: of a lane change that need not be quicker, s.
    worth: speed by which the lead must be slower than the ego was at the start, m/s.
    """

    inclined: bool
    onset_headway: float
    onset_ttc: float
    duration: float
    worth: float = 2.0

    def __post_init__(self) -> None:
        if self.inclined not in (True, False):  # accepts numpy's bool
            raise must_be("`inclined`", "`OvertakingHabits`", "true or false", self.inclined)
        for name in ("onset_headway", "onset_ttc", "duration", "worth"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0.0):
                raise must_be(
                    f"`{name}`", "`OvertakingHabits`", "a finite number greater than 0", value
                )


HABITS = [*fields("onset_headway", "onset_ttc", "duration", "worth"), *flags("inclined")]
"""`OvertakingHabits` as a record, for kernels."""
OVERTAKING = [
    ("path", PATH),
    *fields("cruising_speed", "curvature", "desired_speed", "free"),
    *flags("began", "passing", "changing"),
]
"""Memory of a case.

path: the ego's path, which it steers along.
cruising_speed: speed at the start of the case, m/s.
curvature: curvature that the ego steers, 1/m; at first that of its lane. `lane_change.steering`
    reads it and writes the new one.
desired_speed: of this step, m/s.
free: acceleration wanted in this step with nothing in the way, m/s2.
began: 1 after the first step.
passing: 1 while the ego has a vehicle of the old lane still to pass (`_still_to_pass`).
changing: 1 once the lane change has begun, also after its end.
"""
WATCHED = [*FOLLOWED, *fields("closing"), *flags("leads")]
"""Memory of each vehicle.

closing: speed at which the gap closes in this step, m/s.
leads: 1 if the vehicle is in the ego's way in this step.
"""


@kernel
def overtake(
    memory: Any, me: Any, others: Any, watched: Any, p: Any, way: Any, scenario: Any
) -> float:
    """Acceleration wanted in this step, m/s2; may begin the lane change, which then is in
    `memory.path`.

    The ego follows what is in the way, or changes once and for good to the lane on the left of its
    first lane. An ego that has to change lanes (`way`) does that and never overtakes.

    memory: with the desired speed and the free acceleration of this step.
    p: parameters: `idm` and `habits`.
    way: the lane change that the scenario asks of the ego.
    """
    habits = p.habits
    if memory.began == 0:
        memory.began = 1
        memory.cruising_speed = me.speed
        keep_lane(memory.path, me, scenario.road)
        memory.curvature = curvature_kept(memory.path, me)  # where `steering` begins
    allowed = inf  # strongest acceleration during the requested lane change, m/s2
    if way.asked:
        allowed = change_as_asked(
            memory.path, way, me, others, memory.desired_speed, p.idm, scenario
        )
    lead = _find_leads(memory, me, others, watched, scenario)
    may_change = memory.changing == 0 and way.asked == 0 and me.along >= LEAST_SPEED
    may_change = may_change and _has_left_lane(memory, me, scenario.road)
    if lead >= 0 and may_change and not _comes_towards(others, watched):
        emergency = _is_emergency(watched, scenario.vehicle)
        pays, near = _pays(memory, others[lead], habits), _is_time(me, watched[lead], habits)
        if (emergency or (pays and near)) and _begins(
            memory, me, others, watched, emergency, habits, scenario
        ):
            # on the new path other vehicles are in the way
            _find_leads(memory, me, others, watched, scenario)
        elif (
            not emergency  # in an emergency that it cannot evade, it has to brake
            and pays
            and not near
            and _left_is_free(memory, me, others, habits.duration, False, scenario)
        ):
            # it will overtake once it is near enough: until then it drives as if the road were free
            return float(memory.free)
    wanted: float = min(memory.free, allowed)
    for j in range(len(others)):
        known = watched[j]
        if known.leads:
            follows = follow(known, me, others[j], memory.desired_speed, p.idm, scenario.step)
            wanted = min(wanted, follows)
    if _passes_too_near(memory, me, others, scenario) and wanted > 0.0:
        return 0.0
    return wanted


@kernel
def _passes_too_near(memory: Any, me: Any, others: Any, scenario: Any) -> bool:
    """Whether an ego that changes lane would be too near to a vehicle that it passes, if it were
    faster by `SPEED_RESERVE`. Also writes `memory.passing`.
    """
    memory.passing = 0
    too_near = False
    if memory.changing:
        for j in range(len(others)):
            if _still_to_pass(memory, me, others[j], scenario):
                memory.passing = 1
                too_near = too_near or _in_the_way(
                    memory, me, others[j], scenario, SPEED_RESERVE, CLEARANCE
                )
    return too_near


@kernel
def _has_left_lane(memory: Any, me: Any, road: Any) -> bool:
    """Whether there is a lane on the left that the ego can change to here.

    On a shaped road the outermost lanes may open, end, or be a ramp behind a line that must not be
    crossed (parted).
    """
    lane = lane_at(road, memory.path.start)
    if lane + 1 >= road.lanes:
        return False
    if road.shaped == 0:
        return True
    begin, end = -inf, inf  # x between which both lanes are there, side by side, m
    if lane == 0:  # the ego drives in the rightmost lane, so that lane is open already
        begin, end = road.right_parted_until, road.right_parted_from
    if lane + 2 == road.lanes:  # of the lanes to change to, only the leftmost may open or end
        begin = max(begin, road.left_is_open, road.left_parted_until)
        end = min(end, road.left_closes, road.left_parted_from)
    return bool(begin <= me.x < end - END_AHEAD * me.along)


@kernel
def _comes_towards(others: Any, watched: Any) -> bool:
    """Whether a vehicle in the way comes towards the ego.

    The ego does not overtake such a vehicle, and does not evade it to the left: that is the
    vehicle's own side of the road, to which it will return.
    """
    for j in range(len(others)):  # noqa: SIM110 - kernels have no generators
        if watched[j].leads and others[j].along < -COMES_TOWARDS:
            return True
    return False


@kernel
def _in_the_way(
    memory: Any, me: Any, other: Any, scenario: Any, faster: float, clearance: float
) -> bool:
    """Whether the ego will be too near, across the road, to a vehicle when it reaches that vehicle;
    false where the vehicle's centre is not ahead of the ego's.

    faster: speed to add to the ego's, m/s.
    clearance: least free space across, m.
    """
    if not other.x > me.x:
        return False
    path = memory.path
    speed = me.along + faster
    closing = speed - other.along
    # y of the path, m, where the ego reaches the vehicle; if it never does, at the path's end
    y = path.start + path.offset
    if closing > 0.0:
        y = path_y(path, me.x + speed * max(bumper_gap(me, other), 0.0) / closing)
    off_path = me.y - path_y(path, me.x)  # m to the left of the path, assumed to stay the same
    return bool(
        abs(y + off_path - other.y) < 0.5 * scenario.vehicle.width + other.half_width + clearance
    )


@kernel
def _find_leads(memory: Any, me: Any, others: Any, watched: Any, scenario: Any) -> int:
    """Mark the vehicles in the way (`leads`); return the index of the nearest, -1: none."""
    nearest = -1
    for j in range(len(others)):
        known = watched[j]
        known.leads = 0
        if _in_the_way(memory, me, others[j], scenario, 0.0, 0.0):
            known.leads = 1
            known.gap = bumper_gap(me, others[j])
            known.closing = me.along - others[j].along
            if nearest < 0 or known.gap < watched[nearest].gap:
                nearest = j
    return nearest


@kernel
def _is_emergency(watched: Any, vehicle: Any) -> bool:
    """Whether some vehicle in the way needs more braking than `EMERGENCY_BRAKING` allows."""
    for j in range(len(watched)):
        if (
            watched[j].leads
            and _needed_braking(watched[j]) > EMERGENCY_BRAKING * vehicle.max_deceleration
        ):
            return True
    return False


@kernel
def _begins(
    memory: Any, me: Any, others: Any, watched: Any, emergency: bool, habits: Any, scenario: Any
) -> bool:
    """Begin the lane change if it can be done; return whether it has begun."""
    lateral = EMERGENCY_LATERAL if emergency else COMFORTABLE_LATERAL
    shortest = max(shortest_duration(scenario.road.lane_width, lateral), LEAST_LENGTH / me.along)
    duration = _duration(me, others, watched, shortest, habits, scenario)
    if duration < 0.0 or not _left_is_free(memory, me, others, duration, emergency, scenario):
        return False
    memory.path.offset = scenario.road.lane_width
    memory.path.begin = me.x
    memory.path.length = duration * me.along
    memory.changing = 1
    return True


@kernel
def _pays(memory: Any, lead: Any, habits: Any) -> bool:
    """Whether the ego is inclined to overtake, and the lead is slow enough to be worth it."""
    return bool(habits.inclined and memory.cruising_speed - lead.along >= habits.worth)


@kernel
def _is_time(me: Any, lead: Any, habits: Any) -> bool:
    """Whether the lead is near enough to begin the change, by headway or TTC.

    lead: memory of the lead, of `WATCHED`.
    """
    return bool(lead.gap <= max(habits.onset_headway * me.along, habits.onset_ttc * lead.closing))


@kernel
def _needed_braking(lead: Any) -> float:
    """Constant deceleration that reaches the lead's speed where the gap becomes 0, m/s2.

    Before it begins, the gap closes for `BRAKE_BUILD_UP`.

    lead: memory of the lead, of `WATCHED`.
    """
    if lead.closing <= 0.0:
        return 0.0
    room = lead.gap - BRAKE_BUILD_UP * lead.closing
    return lead.closing * lead.closing / (2.0 * room) if room > 0.0 else inf


@kernel
def _duration(
    me: Any, others: Any, watched: Any, shortest: float, habits: Any, scenario: Any
) -> float:
    """Duration of the lane change, s: the habitual one, or less where the ego would not be clear of
    a lead when it reaches the lead. -1: even with the duration `shortest`, s, it would not be.
    """
    duration = max(habits.duration, shortest)
    for j in range(len(others)):
        if watched[j].leads == 0:
            continue
        other = others[j]
        gap, closing = watched[j].gap, watched[j].closing
        # y from which on the ego passes this lead at `CLEARANCE`, m
        clear_y = other.y + 0.5 * scenario.vehicle.width + other.half_width + CLEARANCE
        # share of the change's offset that leads to `clear_y`
        share = (clear_y - me.y) / scenario.road.lane_width
        if share > 1.0 or gap <= 0.0:
            return -1.0
        if share <= 0.0 or closing <= 0.0:
            continue
        level = gap / closing  # s until the ego's front is level with the lead's rear
        if smooth_step(level / shortest) < share:
            return -1.0
        if smooth_step(level / duration) < share:
            # the ego has covered `share` of the offset when it comes level
            duration = max(level / share_when_done(share), shortest)
    return float(duration)


@kernel
def _left_is_free(
    memory: Any, me: Any, others: Any, duration: float, emergency: bool, scenario: Any
) -> bool:
    """Whether the lane on the left has gaps for a lane change that takes `duration`, s."""
    strip = scenario.vehicle.width + 2.0 * SIDE_CLEARANCE
    ahead, behind = neighbours(me, others, memory.path.start + scenario.road.lane_width, strip)
    if ahead >= 0:
        least = EMERGENCY_GAP if emergency else HEADWAY * me.along
        closed = max(me.along - others[ahead].along, 0.0) * duration
        if bumper_gap(me, others[ahead]) - closed < least:
            return False
    if behind >= 0:
        least = _gap_behind(me, others[behind], duration, emergency, scenario)
        if bumper_gap(others[behind], me) < least:
            return False
    return True


@kernel
def _gap_behind(me: Any, behind: Any, duration: float, emergency: bool, scenario: Any) -> float:
    """Least gap to the vehicle behind in the other lane at the start of a lane change, m.

    duration: of the lane change, s.
    """
    closing = max(behind.along - me.along, 0.0)
    if emergency:
        return float(EMERGENCY_GAP + closing * duration)
    # share of the offset at which the ego's side comes to the line between the lanes
    at_line = 0.5 * (1.0 - scenario.vehicle.width / scenario.road.lane_width)
    wait = duration * share_when_done(at_line) + REAR_DELAY  # s until the vehicle behind brakes
    return float(closes_by(closing, wait) + me.along * REAR_HEADWAY)


@kernel
def _still_to_pass(memory: Any, me: Any, other: Any, scenario: Any) -> bool:
    """Whether the lane change leads past a vehicle that the ego has not passed yet, and the free
    space across the road between both is less than `AT_EASE`.
    """
    widths = 0.5 * scenario.vehicle.width + other.half_width
    new_y = memory.path.start + memory.path.offset  # of the ego after the change, m
    return bool(
        other.x > me.x - me.half_length  # its centre is ahead of the ego's rear
        and abs(me.y - other.y) < widths + AT_EASE
        and abs(new_y - other.y) >= widths  # it is not in the way there
    )
