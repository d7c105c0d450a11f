"""ADS `careful_driver`: the careful and competent human of UN Regulation No. 157 (performance model
1).

It perceives an event and evaluates it for 0.4 s. Its brakes begin to act 0.75 s after braking
became necessary, and rise from 0 to 0.774 g in 0.6 s. Between events it keeps its speed and its
lane. It knows no more than the present and past positions and speeds of the other vehicles.
Between two steps, the instant at which `wander` or `in_path_limit` is crossed is interpolated
linearly; for other thresholds the code says how.

Source: UN R157, Annex 4, Appendix 3 (original series), Annex 3 (amended); AEB stage as in esmini's
R157 controllers. docs/baselines.md lists the readings.

Users: `cosim/doors/controller.py`, by name.
"""

from dataclasses import KW_ONLY, dataclass
from math import inf, isinf, isnan, nan
from typing import Any, ClassVar

from sumo_eval.ads.braking import BRAKE_PATH, Braked, first_instant, moved, path_command
from sumo_eval.ads.lane_change import lane_kept
from sumo_eval.ads.perception import (
    bumper_gap,
    carry_on,
    is_in_sight,
    is_visible,
    lateral_overlap,
    next_ahead,
    take,
)
from sumo_eval.ads.r157 import (
    BRAKES,
    GRAVITY,
    HUMAN_BRAKING,
    MOST_COVERED,
    SIGHTED,
    Brakes,
    brake_ramp,
    brake_ramp_lost,
    foresee_all,
    sight,
    time_to_collision,
    within_headway,
)
from sumo_eval.cosim.compiled import Compiled, check_numbers, each_row
from sumo_eval.cosim.records import MOVER
from sumo_eval.kernels import fields, flags, kernel

BUILD_UP = 0.6  # s, of the driver's brakes and of the emergency brakes (AEB)
AEB_BRAKING = 0.85 * GRAVITY  # m/s2
CUT_IN_TTC = 2.0  # s; below this TTC a cut-in needs braking
AEB_TTC = 1.5  # s; below this TTC the emergency brakes act
OVERLAP_TOLERANCE = 0.05  # m by which a full overlap may fall short of the narrower body


@kernel
def needed_deceleration(
    gap: float, speed: float, lead_speed: float, lead_braking: float, delay: float
) -> float:
    """Constant deceleration that avoids the lead vehicle if it begins `delay` s from now, m/s2; inf
    if none does.

    The larger of two decelerations: to the speed w of a lead vehicle that keeps it, and, if the
    lead vehicle brakes with b, to a standstill behind the point where it stops:

        (v - w)^2 / (2 (d - (v - w) delay)),  v^2 / (2 (d + w^2 / (2 b) - v delay))

    gap: d, bumper to bumper, m. speed: v. lead_speed: w, m/s. lead_braking: b, m/s2; 0: none.
    """
    closing = speed - lead_speed
    needed = 0.0
    if closing > 0.0:
        room = gap - closing * delay
        needed = closing * closing / (2.0 * room) if room > 0.0 else inf
    if lead_braking <= 0.0:
        return needed
    room = gap + lead_speed * lead_speed / (2.0 * lead_braking) - speed * delay
    return max(needed, speed * speed / (2.0 * room) if room > 0.0 else inf)


@kernel
def ramped(
    level: float, path: Any, begins: float, ends: float, vehicle: Any, step: float
) -> Braked:
    """Speed lost by a brake ramp in a step, m/s, and the deceleration at the step's end, m/s2.

    Braking from before the step is released meanwhile, as fast as possible. Of both the stronger
    counts.

    level: deceleration at the end of the ramp, m/s2.
    path: of `BRAKE_PATH`; its `level` is the braking at the step's start.
    begins: start of the ramp, s after the step's start; may be negative.
    ends: when the ramp is released, as fast as possible, s after the step's start.
    """
    ends = min(ends, step)
    lost = brake_ramp_lost(ends - begins, level, BUILD_UP) - brake_ramp_lost(
        -begins, level, BUILD_UP
    )
    released = moved(
        brake_ramp(ends - begins, level, BUILD_UP), 0.0, vehicle.brake_jerk, step - ends
    )
    earlier = moved(path.level, 0.0, vehicle.brake_jerk, step)
    return Braked(max(lost + released.lost, earlier.lost), max(released.level, earlier.level))


_WATCHED = fields(
    "lane_y", "offset", "moved", "time", "speed", "strayed_at", "braking", "braked_at",
    "evaluated_at", "necessary_at",
)  # fmt: skip
"""The driver's memory of one vehicle; nan: nothing yet. Kernels call the memories of all vehicles
`watched`, and that of the vehicle in question `known`.

lane_y: y of the centre of the vehicle's lane, m: where it was first seen, then each lane beside
    the ego's in which it settles; of a vehicle that stood when first seen, its own y.
moved: motion across between the last two looks, to the left, m.
offset, time, speed: distance to the left of `lane_y`, m, time, s, and speed along the road, m/s,
    when it was last looked at. Every vehicle in the network is, hidden or not.
strayed_at: instant from which the driver sees it further from `lane_y` than wandering explains, s.
braking: its mean deceleration between the last two looks, m/s2; negative: it got faster.
braked_at: instant from which `braking` exceeds the driver's threshold, s; nan while it does not.
evaluated_at: instant at which the driver has evaluated an event of this vehicle, s.
necessary_at: instant at which braking for this vehicle became necessary, s. From then on until it
    is nan again, there is an event.
"""


@kernel
def careful_driver(
    ego: Any, others: Any, own: Any, watched: Any, others_then: Any, scenario: Any
) -> None:
    """Brake for the vehicle that made braking necessary first, else keep the speed.

    own: `CarefulDriver.memory`.
    watched: `CarefulDriver.watched`, of each other vehicle.
    others_then: scratch records, the other vehicles at another instant; `own.then` is that of the
        ego.
    scenario: two `SCENARIO` records; only the first is used, as the driver decides at every step.
    """
    me, path, time = own.me, own.path, ego.time
    shared = scenario[0]
    vehicle, step = shared.vehicle, shared.step
    take(me, ego.seen)
    me.braking = path.level
    begins_at = own.p.reaction + _braking_necessary(own, others, watched, others_then, shared, time)
    own.looked = 1
    ends = _end_events_within(me, others, watched, step)
    braked = ramped(HUMAN_BRAKING, path, begins_at - time, ends, vehicle, step)
    if own.p.aeb:
        _watch_over(others, own, watched, others_then, step, time)
        if own.aeb_brakes:
            emergency = ramped(AEB_BRAKING, path, own.aeb_began - time, step, vehicle, step)
            if emergency > braked:  # tuples: by speed lost, then by level
                braked = emergency
    path.level = braked.level
    releases = (isinf(begins_at) or ends < step) and own.aeb_brakes == 0
    ego.command.acceleration = -path_command(
        path, braked.lost, releases, own.p.brakes, vehicle, step
    )
    ego.command.steering = lane_kept(ego, shared)
    # settled: without an event it does nothing as long as no vehicle comes nearer, so the loop may
    # end the case
    ego.settled = 1 - own.aeb_brakes
    for j in range(len(others)):
        if not isnan(watched[j].necessary_at):
            ego.settled = 0


@kernel
def _braking_necessary(
    own: Any, others: Any, watched: Any, others_then: Any, scenario: Any, time: float
) -> float:
    """Earliest instant at which braking became necessary for a vehicle in front, s; inf: none.

    Updates the memory of every vehicle.
    """
    me, p = own.me, own.p
    for j in range(len(others)):
        known = watched[j]
        if not isnan(others[j].x):
            _look_at(others[j], known, p, scenario, time)
            _settle(me, others[j], known, p, scenario)
        if _is_over(me, others[j], known, scenario):
            known.evaluated_at = known.necessary_at = nan
    _find_cut_ins(me, others, watched, p, scenario, time)
    _find_events_in_path(own, others, watched, others_then, scenario, time)
    first = inf
    for j in range(len(others)):
        necessary_at = watched[j].necessary_at
        if others[j].x > me.x and necessary_at < first:  # false for nan
            first = necessary_at
    return first


@kernel
def _look_at(other: Any, known: Any, p: Any, scenario: Any, time: float) -> None:
    """Write into the memory what a vehicle in the network shows at this step, hidden or not."""
    braking = 0.0
    if isnan(known.lane_y):  # first seen at this step
        centre = scenario.road.lane_width * round(other.y / scenario.road.lane_width)
        # a vehicle parked off the centre has not strayed
        known.lane_y = centre if other.speed > 0.0 else other.y
    else:
        # it may have been out of the network for some steps
        steps = max(round((time - known.time) / scenario.step), 1)
        braking = (known.speed - other.along) / (steps * scenario.step)
    offset = other.y - known.lane_y
    now, before = abs(offset), abs(known.offset)
    # `now > before` is false if the vehicle is first seen: `before` is nan then
    if now <= p.wander:
        known.strayed_at = nan  # it is back, or has not left its lane
    elif isnan(known.strayed_at) and now > before:
        # share of the time since the last look after which it crossed `wander`
        share = max((p.wander - before) / (now - before), 0.0)
        known.strayed_at = known.time + share * (time - known.time)
    if not braking > p.lead_braking:
        known.braked_at = nan
    elif isnan(known.braked_at):
        known.braked_at = time - scenario.step  # not interpolated: braking may jump at any instant
    known.moved, known.offset, known.time = offset - known.offset, offset, time
    known.braking, known.speed = braking, other.along


@kernel
def _settle(me: Any, other: Any, known: Any, p: Any, scenario: Any) -> None:
    """Give the memory a vehicle's new lane beside the ego's, once it ceases to move to the ego."""
    width = scenario.road.lane_width
    centre = width * round(other.y / width)
    ceases = known.moved * (me.y - centre) <= 0.0
    in_ego_lane = abs(centre - me.y) < 0.5 * width or _began_in_ego_lane(me, known, scenario)
    along = other.along > abs(other.across)  # a crossing road user keeps no lane
    if along and ceases and not in_ego_lane and abs(other.y - centre) <= p.wander:
        known.lane_y, known.offset, known.strayed_at = centre, other.y - centre, nan


@kernel
def _is_over(me: Any, other: Any, known: Any, scenario: Any) -> bool:
    """Whether a vehicle needs no braking, or no more of it: it is passed, or it is neither in the
    path nor on its way there, or it neither comes nearer nor brakes.
    """
    if not other.x > me.x:  # passed, or nan: it is not there
        return True
    if lateral_overlap(me, other) <= 0.0 and not _comes_towards(me, known, scenario):
        return True
    return bool(me.along <= other.along and known.braking <= 0.0)


@kernel
def _began_in_ego_lane(me: Any, known: Any, scenario: Any) -> bool:
    """Whether the vehicle was in the ego's lane when it was first seen."""
    return bool(abs(known.lane_y - me.y) < 0.5 * scenario.road.lane_width)


@kernel
def _comes_towards(me: Any, known: Any, scenario: Any) -> bool:
    """Whether the vehicle has left its own lane towards the ego's."""
    if isnan(known.strayed_at) or _began_in_ego_lane(me, known, scenario):
        return False
    # it is off its lane to the side on which the ego is: both have the same sign
    return bool(known.offset * (me.y - known.lane_y) > 0.0)


@kernel
def _find_cut_ins(me: Any, others: Any, watched: Any, p: Any, scenario: Any, time: float) -> None:
    """Write `necessary_at` of vehicles that cut in and for which braking has become necessary."""
    for j in range(len(others)):
        other, known = others[j], watched[j]
        if (
            not other.x > me.x
            or not isnan(known.necessary_at)
            or not _comes_towards(me, known, scenario)
        ):
            continue
        if not is_in_sight(me, others, j, MOST_COVERED):
            known.strayed_at = time  # its evaluation begins with the last step that hides it
            continue
        ttc = time_to_collision(me, other)
        evaluated_at = known.strayed_at + p.evaluation
        # the step nearest to the end of the evaluation is the first at which the driver decides
        if 0.0 < ttc < CUT_IN_TTC and time >= evaluated_at - 0.5 * scenario.step:
            # TTC falls by about 1 s a second, so it crossed the threshold CUT_IN_TTC - ttc ago: a
            # step ago at the earliest, and not before the evaluation ended
            known.necessary_at = max(evaluated_at, time - min(CUT_IN_TTC - ttc, scenario.step))


@kernel
def _find_events_in_path(
    own: Any, others: Any, watched: Any, others_then: Any, scenario: Any, time: float
) -> None:
    """Write `necessary_at` of vehicles in the ego's path for which braking has become necessary.

    The event of such a vehicle: another vehicle leaves the lane and reveals it, it brakes within
    2 s of headway, or the ego approaches it too fast. The search, from the nearest vehicle on, ends
    at a vehicle that stays in the path: it hides what is beyond it.
    """
    me = own.me
    leaves = -1  # index of the nearest vehicle that leaves the ego's lane
    j = next_ahead(me, others, -1)
    while j >= 0:
        known = watched[j]
        in_path = lateral_overlap(me, others[j]) > 0.0
        if in_path and isnan(known.necessary_at):
            # of a vehicle that cuts in only braking counts here: `_find_cut_ins` asks for its TTC
            cuts_in = _comes_towards(me, known, scenario)
            if isnan(known.evaluated_at):
                perceived_at = _revealed(own, others, watched, j, -1 if cuts_in else leaves, time)
                if isnan(perceived_at) and not cuts_in:
                    perceived_at = _approached(
                        own, others[j], known, others_then[j], scenario.step, time
                    )
                known.evaluated_at = perceived_at + own.p.evaluation
            # the nearest step decides, as for a cut-in; false if `evaluated_at` is nan
            if time >= known.evaluated_at - 0.5 * scenario.step:
                known.necessary_at = known.evaluated_at
        if not isnan(known.strayed_at) and _began_in_ego_lane(me, known, scenario):
            leaves = j if leaves < 0 else leaves
        elif in_path:
            # what it hides has to be evaluated again once it shows
            for k in range(len(others)):
                if others[k].x > others[j].x and isnan(watched[k].necessary_at):
                    watched[k].evaluated_at = nan
            return
        j = next_ahead(me, others, j)


@kernel
def _revealed(own: Any, others: Any, watched: Any, j: int, leaves: int, time: float) -> float:
    """Instant at which the driver perceived vehicle j as revealed or as braking, s; nan while it is
    neither. To be revealed, j or the vehicle that leaves must be near; to brake, j must.

    The instant is at most one evaluation ago, so that the evaluation ends now at the earliest.

    leaves: index of the nearest vehicle that has left the ego's lane; -1: none.
    """
    me, other, known = own.me, others[j], watched[j]
    near = within_headway(me, other)
    if leaves >= 0 and me.along > other.along and (near or within_headway(me, others[leaves])):
        return float(max(watched[leaves].strayed_at, time - own.p.evaluation))
    if not isnan(known.braked_at) and near:
        return float(max(known.braked_at, time - own.p.evaluation))
    return nan


@kernel
def _approached(
    own: Any, other: Any, known: Any, other_then: Any, step: float, time: float
) -> float:
    """Instant at which the driver perceived that approaching a vehicle needs braking, s; nan while
    it does not.

    other_then: scratch record, for the vehicle a step ago.
    """
    me, p = own.me, own.p
    needed = _needed(me, other, known, p)
    if not needed > p.in_path_limit:
        return nan
    if own.looked == 0:  # there is no step before this one
        return time
    take(own.then, me)
    carry_on(own.then, -step)
    take(other_then, other)
    other_then.braking = known.braking
    carry_on(other_then, -step)
    earlier = _needed(own.then, other_then, known, p)
    # share of the last step after which the needed deceleration crossed the limit
    share = (p.in_path_limit - earlier) / (needed - earlier) if earlier < p.in_path_limit else 0.0
    return time - (1.0 - share) * step


@kernel
def _needed(me: Any, other: Any, known: Any, p: Any) -> float:
    """`needed_deceleration`, m/s2, of a driver that must still evaluate and react."""
    delay = p.evaluation + p.reaction
    return needed_deceleration(bumper_gap(me, other), me.along, other.along, known.braking, delay)


@kernel
def _end_events_within(me: Any, others: Any, watched: Any, step: float) -> float:
    """Time until the ego is as slow as all vehicles for which it brakes, s; inf: not in this step,
    or such a vehicle brakes itself, or the ego does not brake.

    If that is in this step, the events of these vehicles end.
    """
    ends, events = 0.0, 0  # s, and number of vehicles for which it brakes
    for j in range(len(others)):
        if isnan(watched[j].necessary_at) or not others[j].x > me.x:
            continue
        if watched[j].braking > 0.0 or me.braking <= 0.0:
            return inf
        ends = max(ends, (me.along - others[j].along) / me.braking)
        events += 1
    if events == 0 or ends >= step:
        return inf
    for j in range(len(others)):
        known = watched[j]
        if not isnan(known.necessary_at) and others[j].x > me.x:
            known.evaluated_at = known.necessary_at = nan
    return ends


@kernel
def _aeb_ttc(me: Any, other: Any) -> float:
    """TTC to a vehicle in front that fully overlaps the ego's path, s; inf to any other."""
    full = 2.0 * min(me.half_width, other.half_width) - OVERLAP_TOLERANCE
    if other.x > me.x and lateral_overlap(me, other) >= full:
        return time_to_collision(me, other)
    return inf


@kernel
def _aeb_demand(scene: Any, after: float) -> float:
    """A demand for `first_instant`: 1 if the AEB stage demands braking `after` s from now, if all
    vehicles continue as now, else 0.

    scene: (own, watched, scratch records of the other vehicles at that instant, step).
    """
    own, watched, others = scene[:3]
    foresee_all(own, watched, others, after, scene[3])
    for j in range(len(others)):
        if 0.0 <= _aeb_ttc(own.then, others[j]) < AEB_TTC and is_visible(
            own.then, others, j, MOST_COVERED
        ):
            return 1.0
    return 0.0


@kernel
def _watch_over(
    others: Any, own: Any, watched: Any, others_then: Any, step: float, time: float
) -> None:
    """Decide whether the AEB stage brakes: for a vehicle in sight and fully in the path, from
    TTC < 1.5 s until the ego no longer closes in on any vehicle fully in the path.

    time: now, s.
    """
    for j in range(len(others)):
        sight(watched[j].sighting, others[j], step)
    if own.aeb_brakes == 0:
        scene = (own, watched, others_then, step)
        if _aeb_demand(scene, step) > 0.0:  # the demand is 0 or 1: its limit is 0
            begins = (
                0.0
                if _aeb_demand(scene, 0.0) > 0.0
                else first_instant(_aeb_demand, scene, 0.0, 0.0, step)
            )
            own.aeb_brakes = 1
            own.aeb_began = time + begins
        return
    for j in range(len(others)):
        if _aeb_ttc(own.me, others[j]) < inf:  # still closing in
            return
    own.aeb_brakes = 0


@dataclass(eq=False)
class CarefulDriver(Compiled):
    """ADS `careful_driver` (with `aeb`: `careful_driver_aeb`), performance model 1 of UN R157.

    aeb: whether the car has emergency braking.
    wander: largest distance from the lane centre that does not count as a lane change, m.
    evaluation: time from perceiving an event to the end of its evaluation, s.
    reaction: time from the instant at which braking became necessary to its start, s.
    lead_braking: deceleration above which a lead vehicle is perceived as braking, m/s2.
    in_path_limit: needed deceleration above which approaching a vehicle in the path is an event,
        m/s2; not in the regulation.
    """

    loop = each_row(careful_driver)
    memory: ClassVar = [
        ("path", BRAKE_PATH), ("me", MOVER), ("then", MOVER), *fields("aeb_began"),
        *flags("aeb_brakes", "looked"),
    ]  # fmt: skip
    """path: of the ego's braking, of `BRAKE_PATH`.
    me, then: the ego now, and at another instant.
    aeb_began: start of the emergency braking, s.
    aeb_brakes: 1 while the emergency brakes act.
    looked: 1 after the first step.
    """
    watched: ClassVar = [*_WATCHED, *SIGHTED]
    numbers: ClassVar = [
        BRAKES, *fields("wander", "evaluation", "reaction", "lead_braking", "in_path_limit"),
        *flags("aeb"),
    ]  # fmt: skip

    aeb: bool = False
    _: KW_ONLY
    wander: float = 0.375
    evaluation: float = 0.4
    reaction: float = 0.75
    lead_braking: float = 5.0
    in_path_limit: float = 3.0

    def __post_init__(self) -> None:
        check_numbers("careful_driver", self)

    @property
    def brakes(self) -> Brakes:
        """Brakes of the driver, or the emergency brakes where they are stronger."""
        strongest = AEB_BRAKING if self.aeb else HUMAN_BRAKING
        return Brakes(self.reaction, strongest, strongest / BUILD_UP)


class CarefulDriverWithAeb(CarefulDriver):
    """ADS `careful_driver_aeb`: the same driver in a car with emergency braking."""

    def __init__(self) -> None:
        super().__init__(aeb=True)
