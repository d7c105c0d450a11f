"""ADS `careful_driver`: the careful and competent human of UN Regulation No. 157 (performance model 1).

It perceives an event, evaluates it for 0.4 s, and 0.75 s after braking is judged necessary its brakes begin to act: 0
to 0.774 g in 0.6 s. Between events it keeps its speed and its wheel straight. It sees the positions and speeds of the
other vehicles up to now, nothing else; a crossed threshold is dated between two looks, by linear interpolation.

Source: UN R157, Annex 4, Appendix 3 (original series), Annex 3 (amended); AEB stage as in esmini's R157 controllers.
docs/controllers.md lists the readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sumo_eval.ads.braking import Braked, BrakePath, first_instant, moved
from sumo_eval.ads.perception import Mover, Scene, Sensor, bumper_gap, lateral_overlap
from sumo_eval.ads.r157 import (
    FOLLOWING_HEADWAY,
    GRAVITY,
    HUMAN_BRAKING,
    BrakeRamp,
    Motion,
    time_to_collision,
    within_headway,
)
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import must_be

if TYPE_CHECKING:
    from sumo_eval.ads.r157_packed import PackedCarefulDriver

DRIVER_BRAKES = BrakeRamp(HUMAN_BRAKING, build_up=0.6)
AEB_BRAKES = BrakeRamp(0.85 * GRAVITY, build_up=0.6)
CUT_IN_TTC = 2.0  # s, a cut-in needs braking below it
AEB_TTC = 1.5  # s
FULL_OVERLAP = 0.05  # m, of the narrower body that may still be missing


def needed_deceleration(gap: float, speed: float, lead_speed: float, lead_braking: float, delay: float) -> float:
    """Constant deceleration that avoids the lead when it begins `delay` s from now, m/s2; inf when none does.

    The larger of (v - w)^2 / (2 (d - (v - w) delay)), for a lead that keeps its speed w, and, when it brakes with b,
    v^2 / (2 (d + w^2 / (2 b) - v delay)), for stopping behind the place where it stops. d: bumper gap, m.
    """
    closing = speed - lead_speed
    room = gap - max(closing, 0.0) * delay
    needed = 0.0 if closing <= 0.0 else closing * closing / (2.0 * room) if room > 0.0 else math.inf
    if lead_braking <= 0.0:
        return needed
    room = gap + lead_speed * lead_speed / (2.0 * lead_braking) - speed * delay
    return max(needed, speed * speed / (2.0 * room) if room > 0.0 else math.inf)


def ramped(ramp: BrakeRamp, path: BrakePath, begins: float, ends: float, step: float) -> Braked:
    """What a ramp takes off in a step, m/s, and the deceleration at the step's end, m/s2.

    begins, ends: of the ramp, s from the beginning of the step; after its end the brakes are released as fast as they
    can be, and so are those of an earlier ramp.
    """
    ends = min(ends, step)
    lost, level = ramp.lost(ends - begins) - ramp.lost(-begins), ramp.at(ends - begins)
    released = moved(level, 0.0, path.fall, step - ends)
    earlier = moved(path.level, 0.0, path.fall, step)
    return Braked(max(lost + released.lost, earlier.lost), max(released.level, earlier.level))


@dataclass(slots=True)
class _Watched:
    """What the driver remembers of another vehicle.

    lane: y of the centre of the lane where it was first seen, m. offset, time: of the last look. strayed: when it was
    further off that centre than wandering explains, s. braking: its deceleration of the last step, m/s2. braked: when
    that exceeded the driver's threshold, s. evaluated: when an event of it has been evaluated, s. necessary: when
    braking for it became necessary, s.
    """

    lane: float
    offset: float
    time: float
    strayed: float | None = None
    braking: float = 0.0
    braked: float | None = None
    evaluated: float | None = None
    necessary: float | None = None


class CarefulDriver:
    """ADS `careful_driver` (with `aeb`: `careful_driver_aeb`), performance model 1 of UN R157.

    wander: lateral distance from the lane centre that is no lane change yet, m. evaluation: s. reaction: from judging
    braking necessary to its beginning, s. lead_braking: deceleration of a lead above which it is perceived as braking,
    m/s2. in_path_limit: deceleration, m/s2, that approaching a vehicle already in the path must come to need before it
    is an event; the regulation has no such case.
    """

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
        given = {
            "wander": wander, "evaluation": evaluation, "reaction": reaction, "lead_braking": lead_braking,
            "in_path_limit": in_path_limit,
        }  # fmt: skip
        for name, value in given.items():
            if not (math.isfinite(value) and value >= 0.0):
                raise must_be(f"`{name}`", "ADS `careful_driver`", "a finite number, at least 0", value)
        self.aeb = aeb
        self.wander = wander
        self.evaluation = evaluation
        self.reaction = reaction
        self.lead_braking = lead_braking
        self.in_path_limit = in_path_limit

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Forget everything."""
        self._sensor = Sensor()
        self._motion = Motion(scenario.step)
        self._speeds = Motion(scenario.step)
        self._step = scenario.step
        self._lane_width = scenario.road.lane_width
        self._watched: dict[str, _Watched] = {}
        strongest = AEB_BRAKES if self.aeb else DRIVER_BRAKES
        self._path = BrakePath(strongest.rise, strongest.level, scenario.vehicle, scenario.step)
        self._looked = False
        self._aeb_began: float | None = None

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Braking for the vehicle that made it necessary first; else the speed is kept."""
        me, others = self._sensor.look(traci, ego)
        me = me._replace(braking=self._path.level)
        began = self._brakes_begin(Scene(me, others), time)
        self._looked = True
        ends = self._brakes_end(me, others)
        braked = ramped(DRIVER_BRAKES, self._path, math.inf if began is None else began - time, ends, self._step)
        if self.aeb:
            self._watch_over(me, others, time)
            if self._aeb_began is not None:
                automatic = ramped(AEB_BRAKES, self._path, self._aeb_began - time, self._step, self._step)
                braked = max(braked, automatic)
        self._path.level = braked.level
        releases = (began is None or ends < self._step) and self._aeb_began is None
        return Command(-self._path.command(braked.lost, releases=releases))

    def settled(self) -> bool:
        """Whether it brakes for nothing, nor is about to."""
        return all(known.necessary is None for known in self._watched.values()) and self._aeb_began is None

    def packed(self, scenario: Briefing) -> PackedCarefulDriver | None:
        """The same driver in many cases at once; there is none with the AEB stage."""
        from sumo_eval.ads.r157_packed import PackedCarefulDriver

        return None if self.aeb else PackedCarefulDriver(self, scenario)

    def _brakes_begin(self, scene: Scene, time: float) -> float | None:
        """When the brakes begin (or began) to act, s; None when nothing calls for them."""
        me, others = scene
        for other in others:
            self._look_at(other, time)
        ahead = sorted((other for other in others if other.x > me.x), key=lambda other: other.x)
        watched = self._watched
        for other in others:
            known = watched[other.name]
            if known.necessary is not None and self._is_over(me, other):
                known.braked = known.evaluated = known.necessary = None
        self._judge_cut_ins(me, ahead, time)
        self._judge_path(me, ahead, time)
        calls = [watched[other.name].necessary for other in ahead]
        first = min((call for call in calls if call is not None), default=None)
        return None if first is None else first + self.reaction

    def _brakes_end(self, me: Mover, others: Sequence[Mover]) -> float:
        """When in the coming step the ego is as slow as everybody it brakes for, s; those events are over then."""
        calls = [other for other in others if self._watched[other.name].necessary is not None and other.x > me.x]
        ends = 0.0
        for other in calls:
            if self._watched[other.name].braking > 0.0 or me.braking <= 0.0:
                return math.inf
            ends = max(ends, (me.along - other.along) / me.braking)
        if not calls or ends >= self._step:
            return math.inf
        for other in calls:
            known = self._watched[other.name]
            known.braked = known.evaluated = known.necessary = None
        return ends

    def _look_at(self, other: Mover, time: float) -> None:
        known = self._watched.get(other.name)
        braking = self._speeds.deceleration(other)
        if known is None:
            lane = self._lane_width * round(other.y / self._lane_width)
            known = self._watched[other.name] = _Watched(lane, 0.0, time)
        offset = other.y - known.lane
        if known.strayed is None and abs(offset) > self.wander:
            share = (self.wander - abs(known.offset)) / (abs(offset) - abs(known.offset))
            known.strayed = known.time + share * (time - known.time)
        if known.braked is None and braking > self.lead_braking:
            known.braked = time - self._step  # braking that jumps began at the earliest there
        known.offset, known.time, known.braking = offset, time, braking

    def _is_over(self, me: Mover, other: Mover) -> bool:
        """Whether the event no longer calls for braking: passed, no longer in or towards the path, or not closing."""
        known = self._watched[other.name]
        if other.x <= me.x:
            return True
        if lateral_overlap(me, other) <= 0.0 and not self._comes_towards(me, other):
            return True
        return me.along <= other.along and known.braking <= 0.0

    def _comes_towards(self, me: Mover, other: Mover) -> bool:
        """Whether it has left its own lane towards the ego's."""
        known = self._watched[other.name]
        own_lane = abs(known.lane - me.y) < 0.5 * self._lane_width
        return known.strayed is not None and not own_lane and known.offset * (me.y - known.lane) > 0.0

    def _judge_cut_ins(self, me: Mover, ahead: Sequence[Mover], time: float) -> None:
        for other in ahead:
            known = self._watched[other.name]
            if known.necessary is not None or known.strayed is None or not self._comes_towards(me, other):
                continue
            left = time_to_collision(me, other)
            evaluated = known.strayed + self.evaluation
            if 0.0 < left < CUT_IN_TTC and time >= evaluated - 0.5 * self._step:
                known.necessary = max(evaluated, time - min(CUT_IN_TTC - left, self._step))

    def _judge_path(self, me: Mover, ahead: Sequence[Mover], time: float) -> None:
        """The vehicles in the ego's lane, nearest first, down to the first that hides what is beyond it."""
        leaves: Mover | None = None
        for other in ahead:
            known = self._watched[other.name]
            in_path = lateral_overlap(me, other) > 0.0
            if in_path and known.necessary is None and not self._comes_towards(me, other):
                self._judge_lead(me, other, leaves, time)
            if known.strayed is not None and abs(known.lane - me.y) < 0.5 * self._lane_width:
                leaves = leaves or other
            elif in_path:
                return

    def _judge_lead(self, me: Mover, other: Mover, leaves: Mover | None, time: float) -> None:
        """A vehicle in the path: revealed by one that leaves, braking within 2 s of headway, or approached for long."""
        known = self._watched[other.name]
        if known.evaluated is None:
            perceived = self._perceived(me, other, leaves, time)
            known.evaluated = None if perceived is None else perceived + self.evaluation
        if known.evaluated is not None and time >= known.evaluated - 0.5 * self._step:
            known.necessary = known.evaluated

    def _perceived(self, me: Mover, other: Mover, leaves: Mover | None, time: float) -> float | None:
        """When the driver perceived what calls for braking behind `other`, s; None while nothing does."""
        known = self._watched[other.name]
        if leaves is not None and me.along > other.along:
            strayed = self._watched[leaves.name].strayed
            near = within_headway(me, leaves, FOLLOWING_HEADWAY) or within_headway(me, other, FOLLOWING_HEADWAY)
            if strayed is not None and near:
                return max(strayed, time - self.evaluation)
        if known.braked is not None and within_headway(me, other, FOLLOWING_HEADWAY):
            return max(known.braked, time - self.evaluation)
        needed = self._needed(me, other)
        if not needed > self.in_path_limit:
            return None
        if not self._looked:
            return time
        earlier = self._needed(me.after(-self._step), other._replace(braking=known.braking).after(-self._step))
        share = (self.in_path_limit - earlier) / (needed - earlier) if earlier < self.in_path_limit else 0.0
        return time - (1.0 - share) * self._step

    def _needed(self, me: Mover, other: Mover) -> float:
        delay = self.evaluation + self.reaction
        braking = self._watched[other.name].braking
        return needed_deceleration(bumper_gap(me, other), me.along, other.along, braking, delay)

    def _watch_over(self, me: Mover, others: Sequence[Mover], time: float) -> None:
        """The AEB stage: for a vehicle that fully overlaps the ego's path at TTC < 1.5 s, until no longer closing."""
        seen = [self._motion.of(other) for other in others]

        def alarms(after: float) -> bool:
            mine = me.after(after)
            return any(0.0 <= _aeb_ttc(mine, other.after(after)) < AEB_TTC for other in seen)

        if self._aeb_began is None:
            if alarms(self._step):
                self._aeb_began = time + (0.0 if alarms(0.0) else first_instant(alarms, 0.0, self._step))
        elif all(_aeb_ttc(me, other) == math.inf for other in others):
            self._aeb_began = None


def _aeb_ttc(me: Mover, other: Mover) -> float:
    """TTC to a vehicle ahead that fully overlaps the ego's path, s; inf to others."""
    full = 2.0 * min(me.half_width, other.half_width) - FULL_OVERLAP
    return math.inf if other.x <= me.x or lateral_overlap(me, other) < full else time_to_collision(me, other)


class CarefulDriverWithAeb(CarefulDriver):
    """ADS `careful_driver_aeb`: the same driver in a car with emergency braking."""

    def __init__(self) -> None:
        super().__init__(aeb=True)
