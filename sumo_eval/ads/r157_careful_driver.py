"""ADS `careful_driver`: the careful and competent human of UN Regulation No. 157 (performance model
1).

It perceives an event, evaluates it for 0.4 s, and 0.75 s after braking is found necessary its
brakes begin to act: 0 to 0.774 g in 0.6 s. Between events it keeps its speed and its wheel
straight. It sees the positions and speeds of the other vehicles up to now, nothing else; a crossed
threshold is dated between two looks, by linear interpolation.

Source: UN R157, Annex 4, Appendix 3 (original series), Annex 3 (amended); AEB stage as in esmini's
R157 controllers. docs/baselines.md lists the readings.
"""

from __future__ import annotations

import math
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
    FOLLOWING_HEADWAY,
    GRAVITY,
    HUMAN_BRAKING,
    SHOWING,
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
from sumo_eval.cosim.records import MOVER, fields, flags
from sumo_eval.kernels import kernel

BUILD_UP = 0.6  # s, of the driver's brakes and of the emergency brakes
AEB_BRAKING = 0.85 * GRAVITY  # m/s2
CUT_IN_TTC = 2.0  # s, a cut-in needs braking below it
AEB_TTC = 1.5  # s
FULL_OVERLAP = 0.05  # m, of the narrower body that may still be missing


@kernel
def needed_deceleration(
    gap: float, speed: float, lead_speed: float, lead_braking: float, delay: float
) -> float:
    """Constant deceleration that avoids the lead when it begins `delay` s from now, m/s2; inf when
    none does.

    The larger of (v - w)^2 / (2 (d - (v - w) delay)), for a lead that keeps its speed w, and, when
    it brakes with b, v^2 / (2 (d + w^2 / (2 b) - v delay)), for stopping behind the place where it
    stops. d: bumper gap, m.
    """
    closing = speed - lead_speed
    room = gap - max(closing, 0.0) * delay
    needed = 0.0 if closing <= 0.0 else closing * closing / (2.0 * room) if room > 0.0 else math.inf
    if lead_braking <= 0.0:
        return needed
    room = gap + lead_speed * lead_speed / (2.0 * lead_braking) - speed * delay
    return max(needed, speed * speed / (2.0 * room) if room > 0.0 else math.inf)


@kernel
def ramped(
    level: float, path: Any, begins: float, ends: float, vehicle: Any, step: float
) -> Braked:
    """Speed that a brake ramp takes off in a step, m/s, and the deceleration at the step's end,
    m/s2.

    level: of the ramp, m/s2.
    path: of the driver's braking so far.
    begins, ends: of the ramp, s from the beginning of the step. After its end the brakes are
        released as fast as they can be, and so are those of an earlier ramp.
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
    "lane", "offset", "time", "speed", "strayed", "braking", "braked", "evaluated", "necessary"
)  # fmt: skip
"""The driver's memory of one vehicle, nan where there is nothing.

lane: y of the centre of the lane where it was first seen, or of the place where it stood then, m.
offset, time, speed: of the last look.
strayed: when it was further off there than wandering explains, s.
braking: its deceleration of the last step, m/s2.
braked: when that exceeded the driver's threshold, s.
evaluated: when an event of it has been evaluated, s.
necessary: when braking for it became necessary, s.
"""


@kernel
def careful_driver(ego: Any, others: Any, own: Any, known: Any, later: Any, scenario: Any) -> None:
    """Braking for the vehicle that made it necessary first, else the speed is kept."""
    me, path, time = own.me, own.path, ego.time
    vehicle, step = scenario[0].vehicle, scenario[0].step
    take(me, ego.seen)
    me.braking = path.level
    began = _braking_necessary(own, others, known, later, scenario[0], time) + own.p.reaction
    own.looked = 1
    ends = _brakes_end(me, others, known, step)
    begins = math.inf if math.isnan(began) else began - time
    braked = ramped(HUMAN_BRAKING, path, begins, ends, vehicle, step)
    lost, level = braked.lost, braked.level
    if own.p.aeb:
        _watch_over(others, own, known, later, step, time)
        if own.aeb_brakes:
            braked = ramped(AEB_BRAKING, path, own.aeb_began - time, step, vehicle, step)
            if braked.lost > lost or (braked.lost == lost and braked.level > level):
                lost, level = braked.lost, braked.level
    path.level = level
    releases = (math.isnan(began) or ends < step) and own.aeb_brakes == 0
    ego.command.acceleration = -path_command(path, lost, releases, own.p.brakes, vehicle, step)
    ego.command.steering = lane_kept(ego, scenario[0])
    ego.settled = 1 - own.aeb_brakes
    for j in range(len(others)):
        if not math.isnan(known[j].necessary):
            ego.settled = 0


@kernel
def _braking_necessary(
    own: Any, others: Any, watched: Any, later: Any, scenario: Any, time: float
) -> float:
    """When braking became necessary for any lead vehicle, s; nan when nothing calls for it."""
    me, p = own.me, own.p
    for j in range(len(others)):
        if not math.isnan(others[j].x):
            _look_at(others[j], watched[j], p, scenario, time)
    for j in range(len(others)):
        known = watched[j]
        if not math.isnan(known.necessary) and _is_over(me, others[j], known, scenario):
            known.braked = known.evaluated = known.necessary = math.nan
    _judge_cut_ins(me, others, watched, p, scenario, time)
    _judge_path(own, others, watched, later, scenario, time)
    first = math.nan
    for j in range(len(others)):
        call = watched[j].necessary
        if others[j].x > me.x and not math.isnan(call) and not call >= first:
            first = call
    return first


@kernel
def _look_at(other: Any, known: Any, p: Any, scenario: Any, time: float) -> None:
    braking = 0.0
    if math.isnan(known.lane):
        centre = scenario.road.lane_width * round(other.y / scenario.road.lane_width)
        known.lane = centre if other.speed > 0.0 else other.y
        known.offset, known.time = other.y - known.lane, time
    else:
        braking = (known.speed - other.along) / scenario.step
    offset = other.y - known.lane
    # not who is parked
    if math.isnan(known.strayed) and abs(offset) > p.wander and abs(offset) > abs(known.offset):
        share = max((p.wander - abs(known.offset)) / (abs(offset) - abs(known.offset)), 0.0)
        known.strayed = known.time + share * (time - known.time)
    if math.isnan(known.braked) and braking > p.lead_braking:
        known.braked = time - scenario.step  # braking that jumps began at the earliest there
    known.offset, known.time = offset, time
    known.braking, known.speed = braking, other.along


@kernel
def _is_over(me: Any, other: Any, known: Any, scenario: Any) -> bool:
    """Whether the event no longer calls for braking: passed, no longer in or towards the path, or
    not closing.
    """
    if not other.x > me.x:
        return True
    if lateral_overlap(me, other) <= 0.0 and not _comes_towards(me, known, scenario):
        return True
    return bool(me.along <= other.along and known.braking <= 0.0)


@kernel
def _is_from_own_lane(me: Any, known: Any, scenario: Any) -> bool:
    return bool(abs(known.lane - me.y) < 0.5 * scenario.road.lane_width)


@kernel
def _comes_towards(me: Any, known: Any, scenario: Any) -> bool:
    """Whether it has left its own lane towards the ego's."""
    if math.isnan(known.strayed) or _is_from_own_lane(me, known, scenario):
        return False
    return bool(known.offset * (me.y - known.lane) > 0.0)


@kernel
def _judge_cut_ins(me: Any, others: Any, watched: Any, p: Any, scenario: Any, time: float) -> None:
    for j in range(len(others)):
        other, known = others[j], watched[j]
        if (
            not other.x > me.x
            or not math.isnan(known.necessary)
            or not _comes_towards(me, known, scenario)
        ):
            continue
        if not is_in_sight(me, others, j, SHOWING):
            continue
        left = time_to_collision(me, other)
        evaluated = known.strayed + p.evaluation
        if 0.0 < left < CUT_IN_TTC and time >= evaluated - 0.5 * scenario.step:
            known.necessary = max(evaluated, time - min(CUT_IN_TTC - left, scenario.step))


@kernel
def _judge_path(
    own: Any, others: Any, watched: Any, later: Any, scenario: Any, time: float
) -> None:
    """The vehicles in the ego's lane, nearest first, down to the first that hides what is beyond
    it: revealed by one that leaves, braking within 2 s of headway, or approached for long.
    """
    me, leaves = own.me, -1
    j = next_ahead(me, others, -1)
    while j >= 0:
        known = watched[j]
        in_path = lateral_overlap(me, others[j]) > 0.0
        if in_path and math.isnan(known.necessary) and not _comes_towards(me, known, scenario):
            if math.isnan(known.evaluated):
                perceived = _revealed(own, others, watched, j, leaves, time)
                if math.isnan(perceived):
                    perceived = _approached(own, others[j], known, later[j], scenario.step, time)
                known.evaluated = perceived + own.p.evaluation
            if not math.isnan(known.evaluated) and time >= known.evaluated - 0.5 * scenario.step:
                known.necessary = known.evaluated
        if not math.isnan(known.strayed) and _is_from_own_lane(me, known, scenario):
            leaves = j if leaves < 0 else leaves
        elif in_path:
            return
        j = next_ahead(me, others, j)


@kernel
def _revealed(own: Any, others: Any, watched: Any, j: int, leaves: int, time: float) -> float:
    """When the driver perceived a near vehicle as revealed or braking, s; nan while it is
    neither.
    """
    me, other, known = own.me, others[j], watched[j]
    near = within_headway(me, other, FOLLOWING_HEADWAY)
    if leaves >= 0 and me.along > other.along and not math.isnan(watched[leaves].strayed):
        near_lead = within_headway(me, others[leaves], FOLLOWING_HEADWAY)
        if near_lead or near:
            return float(max(watched[leaves].strayed, time - own.p.evaluation))
    if not math.isnan(known.braked) and near:
        return float(max(known.braked, time - own.p.evaluation))
    return math.nan


@kernel
def _approached(own: Any, other: Any, known: Any, then: Any, step: float, time: float) -> float:
    """When the driver perceived that approaching a vehicle needs braking, s; nan while it does
    not.
    """
    me, p = own.me, own.p
    needed = _needed(me, other, known, p)
    if not needed > p.in_path_limit:
        return math.nan
    if own.looked == 0:
        return float(time)
    take(own.then, me)
    carry_on(own.then, -step)
    take(then, other)
    then.braking = known.braking
    carry_on(then, -step)
    earlier = _needed(own.then, then, known, p)
    share = (p.in_path_limit - earlier) / (needed - earlier) if earlier < p.in_path_limit else 0.0
    return float(time - (1.0 - share) * step)


@kernel
def _needed(me: Any, other: Any, known: Any, p: Any) -> float:
    delay = p.evaluation + p.reaction
    return needed_deceleration(bumper_gap(me, other), me.along, other.along, known.braking, delay)


@kernel
def _brakes_end(me: Any, others: Any, watched: Any, step: float) -> float:
    """When in the coming step the ego is as slow as everybody it brakes for, s, inf: not in it;
    those events are over then.
    """
    ends, calls = 0.0, 0
    for j in range(len(others)):
        if math.isnan(watched[j].necessary) or not others[j].x > me.x:
            continue
        if watched[j].braking > 0.0 or me.braking <= 0.0:
            return math.inf
        ends = max(ends, (me.along - others[j].along) / me.braking)
        calls += 1
    if calls == 0 or ends >= step:
        return math.inf
    for j in range(len(others)):
        known = watched[j]
        if not math.isnan(known.necessary) and others[j].x > me.x:
            known.braked = known.evaluated = known.necessary = math.nan
    return float(ends)


@kernel
def _aeb_ttc(me: Any, other: Any) -> float:
    """TTC to a lead vehicle that fully overlaps the ego's path, s; inf to any other."""
    full = 2.0 * min(me.half_width, other.half_width) - FULL_OVERLAP
    return (
        math.inf
        if not other.x > me.x or lateral_overlap(me, other) < full
        else time_to_collision(me, other)
    )


@kernel
def _aeb_demand(scene: Any, after: float) -> float:
    """1 where the AEB stage demands braking `after` s from now, if all vehicles continue as now,
    else 0.
    """
    own, known, others = scene[:3]
    foresee_all(own, known, others, after, scene[3])
    for j in range(len(others)):
        if 0.0 <= _aeb_ttc(own.then, others[j]) < AEB_TTC and is_visible(
            own.then, others, j, SHOWING
        ):
            return 1.0
    return 0.0


@kernel
def _watch_over(others: Any, own: Any, known: Any, later: Any, step: float, time: float) -> None:
    """The AEB stage: for a vehicle in sight and fully in the path at TTC < 1.5 s, until no longer
    closing.
    """
    for j in range(len(others)):
        sight(known[j].sighting, others[j], step)
    if own.aeb_brakes == 0:
        scene = (own, known, later, step)
        if _aeb_demand(scene, step) > 0.0:
            begins = (
                0.0
                if _aeb_demand(scene, 0.0) > 0.0
                else first_instant(_aeb_demand, scene, 0.0, 0.0, step)
            )
            own.aeb_brakes, own.aeb_began = 1, time + begins
        return
    for j in range(len(others)):
        if _aeb_ttc(own.me, others[j]) < math.inf:
            return
    own.aeb_brakes = 0


class CarefulDriver(Compiled):
    """ADS `careful_driver` (with `aeb`: `careful_driver_aeb`), performance model 1 of UN R157.

    wander: lateral distance from the lane centre that does not count as a lane change, m.
    evaluation: s.
    reaction: from finding braking necessary to its beginning, s.
    lead_braking: deceleration of a lead above which it is perceived as braking, m/s2.
    in_path_limit: deceleration, m/s2, that approaching a vehicle already in the path must come to
        need before it is an event; the regulation has no such case.
    """

    loop = staticmethod(each_row(careful_driver))
    memory: ClassVar = [
        ("path", BRAKE_PATH), ("me", MOVER), ("then", MOVER), *fields("aeb_began"),
        *flags("aeb_brakes", "looked"),
    ]  # fmt: skip
    """me: the ego as it is, with the driver's braking. then: where it is at some other instant."""
    known: ClassVar = [*_WATCHED, *SIGHTED]
    numbers: ClassVar = [
        BRAKES, *fields("wander", "evaluation", "reaction", "lead_braking", "in_path_limit"),
        *flags("aeb"),
    ]  # fmt: skip

    def __init__(
        self,
        aeb: bool = False,
        *,
        wander: float = 0.375,
        evaluation: float = 0.4,
        reaction: float = 0.75,
        lead_braking: float = 5.0,
        in_path_limit: float = 3.0,
    ) -> None:
        check_numbers(
            "careful_driver", wander=wander, evaluation=evaluation, reaction=reaction,
            lead_braking=lead_braking,
            in_path_limit=in_path_limit, aeb=aeb,
        )  # fmt: skip
        self.aeb = aeb
        self.wander = wander
        self.evaluation = evaluation
        self.reaction = reaction
        self.lead_braking = lead_braking
        self.in_path_limit = in_path_limit

    @property
    def brakes(self) -> Brakes:
        """Of the driver, and of the emergency brakes where they are stronger."""
        strongest = AEB_BRAKING if self.aeb else HUMAN_BRAKING
        return Brakes(self.reaction, strongest, strongest / BUILD_UP)


class CarefulDriverWithAeb(CarefulDriver):
    """ADS `careful_driver_aeb`: the same driver in a car with emergency braking."""

    def __init__(self) -> None:
        super().__init__(aeb=True)
