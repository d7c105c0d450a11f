"""When to change to the left lane instead of following, and how quickly: for `lane_changer` and the human drivers.

A vehicle is in the ego's way if, at the present speeds, the ego's path overlaps it where the ego reaches it. That one
rule serves for keeping the lane, for passing the old lead during a change, and for the lead behind which it ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from sumo_eval.ads.car_following import Follower, IdmParameters
from sumo_eval.ads.lane_change import LanePath, share_of_duration, shortest_duration, smooth_step
from sumo_eval.ads.perception import Mover, bumper_gap, gap_behind, neighbours
from sumo_eval.cosim.controller import Briefing
from sumo_eval.errors import must_be

CLEARANCE = 0.3  # m, free space across the road when the ego's front comes level with the lead's rear
AT_EASE = 0.6  # m of free space across from which on a vehicle ahead needs no attention any more
SIDE_CLEARANCE = 0.2  # m, on each side of the body, in the strip of the other lane that must be free
COMFORTABLE_LATERAL = 2.0  # m/s2, peak of a quick but ordinary lane change: 3.2 s for 3.5 m
EMERGENCY_LATERAL = 4.0  # m/s2, peak of an evasion that ordinary drivers still master: 2.25 s for 3.5 m
EMERGENCY_BRAKING = 0.8  # share of the strongest braking; needing more, braking alone is not relied on
EMERGENCY_GAP = 2.0  # m left to a vehicle in the other lane after an evasion
SPEED_RESERVE = 1.0  # m/s; nobody gains speed while he would not be clear of what he passes at this much more
LEAST_LENGTH = 20.0  # m of road for a lane change at a crawl: a fifth of a car's tightest curve
LEAST_SPEED = 2.0  # m/s, nobody overtakes from a slower roll
AHEAD_HEADWAY = 0.6  # s, shortest headway accepted behind the vehicle in the other lane (LMRS: 0.56 s)

# UN R79, 5.6.4.7 (lane change, ACSF C): whoever comes from behind in the other lane need not brake harder than 3 m/s2,
# beginning 0.4 s after the change began, to keep a headway of 1 s.
REAR_DECELERATION = 3.0  # m/s2
REAR_DELAY = 0.4  # s
REAR_HEADWAY = 1.0  # s


@dataclass(frozen=True, slots=True)
class OvertakingHabits:
    """When someone overtakes.

    inclined: whether he overtakes at all when not in danger. onset_headway, onset_ttc: s, the change begins at the
    first of the two. duration: s, of the whole smooth step when there is no hurry. worth: m/s by which the lead must be
    slower than the ego was at the start.
    """

    inclined: bool
    onset_headway: float
    onset_ttc: float
    duration: float
    worth: float = 2.0

    def __post_init__(self) -> None:
        for name in ("onset_headway", "onset_ttc", "duration", "worth"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise must_be(f"`{name}`", "`OvertakingHabits`", "a finite number greater than 0", value)


class Lead(NamedTuple):
    """A vehicle in the way: bumper gap, m, and closing speed, m/s."""

    mover: Mover
    gap: float
    closing: float


class Overtaking:
    """Follows what is in the way, or changes to the lane left of the start, once and for good.

    path: where to drive. passing: the lane change has begun, and something ahead in the old lane is not well clear yet.
    emergency_braking: needing more, m/s2, braking alone is not relied on. quickest, evasion: s, the shortest lane
    change of ordinary driving and of an emergency.
    """

    def __init__(self, habits: OvertakingHabits, idm: IdmParameters, scenario: Briefing, me: Mover) -> None:
        road = scenario.road
        lane = min(max(round(me.y / road.lane_width), 0), road.lanes - 1)
        self.path = LanePath(road.lane_centre(lane))
        self.passing = False
        self.has_left_lane = lane + 1 < road.lanes
        self._lane_width = road.lane_width
        self._habits = habits
        self._cruising_speed = me.speed
        self._half_width = 0.5 * scenario.vehicle.width
        self.emergency_braking = EMERGENCY_BRAKING * scenario.vehicle.max_deceleration
        self._follower = Follower(idm, scenario.step)
        self.quickest = shortest_duration(road.lane_width, COMFORTABLE_LATERAL)
        self.evasion = shortest_duration(road.lane_width, EMERGENCY_LATERAL)

    @property
    def changing(self) -> bool:
        """Whether the lane change has begun (it may have ended since)."""
        return self.path.offset != 0.0

    def acceleration(self, me: Mover, others: Sequence[Mover], desired_speed: float, free: float) -> float:
        """Acceleration wanted in this step, m/s2; may begin the lane change, which then shows in `path`.

        others: the vehicles known. desired_speed: m/s. free: the acceleration wanted with nothing in the way, m/s2.
        """
        leads = self._in_the_way(me, others)
        if leads and self.has_left_lane and not self.changing:
            if self._begins(me, others, leads):
                leads = self._in_the_way(me, others)
            elif self._bides_its_time(me, others, leads):
                return free
        wanted = free
        for lead in leads:
            behind_it = self._follower.acceleration(
                lead.mover.name, me.speed, desired_speed, lead.gap, lead.mover.along, lead.mover.braking
            )
            wanted = min(wanted, behind_it)
        passed = self._still_ahead(me, others) if self.changing else []
        self.passing = bool(passed)
        if passed and wanted > 0.0 and self._in_the_way(me, passed, SPEED_RESERVE, CLEARANCE):
            return 0.0
        return wanted

    def begins(self, me: Mover, others: Sequence[Mover]) -> bool:
        """Begin the lane change, which then shows in `path`, if this is when. others: the vehicles known."""
        leads = self._in_the_way(me, others)
        return bool(leads) and self._begins(me, others, leads)

    def _in_the_way(
        self, me: Mover, others: Sequence[Mover], faster: float = 0.0, clearance: float = 0.0
    ) -> list[Lead]:
        """The vehicles that the ego would come nearer than `clearance` (m) if it were `faster` (m/s) than it is."""
        speed = me.along + faster
        path, my_x, half_width = self.path, me.x, self._half_width
        off_path = me.y - path.y(my_x)
        leads = []
        for other in others:
            if other.x <= my_x:
                continue
            gap = bumper_gap(me, other)
            closing = speed - other.along
            y = path.y(my_x + speed * max(gap, 0.0) / closing) if closing > 0.0 else path.target
            if abs(y + off_path - other.y) < half_width + other.half_width + clearance:
                leads.append(Lead(other, gap, closing))
        return leads

    def _begins(self, me: Mover, others: Sequence[Mover], leads: list[Lead]) -> bool:
        """Begin the lane change if it is wanted, or if braking alone will not do, and if it can be done."""
        if me.along < LEAST_SPEED:
            return False
        lead = min(leads, key=lambda each: each.gap)
        emergency = any(self._needed_braking(each) > self.emergency_braking for each in leads)
        if not emergency and not (self._pays(lead) and self._is_time(me, lead)):
            return False
        shortest = max(self.evasion if emergency else self.quickest, LEAST_LENGTH / me.along)
        duration = self._duration(me, leads, shortest)
        if duration is None or not self._left_is_free(me, others, duration, emergency):
            return False
        self.path = LanePath(self.path.start, self._lane_width, me.x, duration * me.along)
        return True

    def _bides_its_time(self, me: Mover, others: Sequence[Mover], leads: list[Lead]) -> bool:
        """Whether it is going to overtake but is not near enough yet, so that nothing calls for following."""
        lead = min(leads, key=lambda each: each.gap)
        return (
            me.along >= LEAST_SPEED
            and self._pays(lead)
            and not self._is_time(me, lead)
            and self._left_is_free(me, others, self._habits.duration, emergency=False)
        )

    def _pays(self, lead: Lead) -> bool:
        return self._habits.inclined and self._cruising_speed - lead.mover.along >= self._habits.worth

    def _is_time(self, me: Mover, lead: Lead) -> bool:
        return lead.gap <= max(self._habits.onset_headway * me.along, self._habits.onset_ttc * lead.closing)

    def _needed_braking(self, lead: Lead) -> float:
        """Constant deceleration to the lead's speed just short of it, m/s2, less the time brakes take to build up."""
        if lead.closing <= 0.0:
            return 0.0
        room = lead.gap - 0.1 * lead.closing
        return lead.closing * lead.closing / (2.0 * room) if room > 0.0 else math.inf

    def _duration(self, me: Mover, leads: list[Lead], shortest: float) -> float | None:
        """The habitual duration, or the longest that is clear of every lead when the ego reaches it, s.

        None when that is less than `shortest`.
        """
        longest = max(self._habits.duration, shortest)
        for lead in leads:
            other = lead.mover
            share = (other.y + self._half_width + other.half_width + CLEARANCE - me.y) / self._lane_width
            if share > 1.0 or lead.gap <= 0.0:
                return None
            if share <= 0.0 or lead.closing <= 0.0:
                continue
            reached = lead.gap / lead.closing
            if smooth_step(reached / shortest) < share:
                return None
            if smooth_step(reached / longest) < share:
                longest = max(reached / share_of_duration(share), shortest)
        return longest

    def _left_is_free(self, me: Mover, others: Sequence[Mover], duration: float, emergency: bool) -> bool:
        strip = 2.0 * (self._half_width + SIDE_CLEARANCE)
        ahead, behind = neighbours(me, others, self.path.start + self._lane_width, strip)
        if ahead is not None:
            least = EMERGENCY_GAP if emergency else AHEAD_HEADWAY * me.along
            if bumper_gap(me, ahead) - max(me.along - ahead.along, 0.0) * duration < least:
                return False
        if behind is not None:
            closing = max(behind.along - me.along, 0.0)
            least = closing * REAR_DELAY + closing * closing / (2.0 * REAR_DECELERATION) + me.along * REAR_HEADWAY
            if gap_behind(me, behind) < (EMERGENCY_GAP + closing * duration if emergency else least):
                return False
        return True

    def _still_ahead(self, me: Mover, others: Sequence[Mover]) -> list[Mover]:
        """The vehicles that the lane change leads past, until the ego has passed them or is well clear of them."""
        return [
            other
            for other in others
            if other.x > me.x - me.half_length
            and abs(me.y - other.y) < self._half_width + other.half_width + AT_EASE
            and abs(self.path.target - other.y) >= self._half_width + other.half_width
        ]
