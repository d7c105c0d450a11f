"""ADS `reg157`: what UN Regulation No. 157, 5.2.5, demands of an automated lane keeping system at the least.

A cut-in must be avoided when its TTC, as it intrudes into the lane, is above v_rel / (2 * 6 m/s2) + 0.35 s: the system
may take 0.35 s and brake at 6 m/s2. So that is what this one does, and no earlier than it must. docs/controllers.md
lists the readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sumo_eval.ads.braking import SafetyBraking
from sumo_eval.ads.perception import Mover, Sensor, lateral_overlap, visible
from sumo_eval.ads.r157 import (
    FOLLOWING_HEADWAY,
    SHOWING,
    Motion,
    Sighting,
    lateral_gap,
    time_to_collision,
    within_headway,
)
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import must_be

RESPONSE = 0.35  # s
BRAKING = 6.0  # m/s2
INTRUSION = 0.3  # m, of the tyre beyond the lane marking


def critical_ttc(closing_speed: float) -> float:
    """TTC_intrusion = v_rel / (2 * 6 m/s2) + 0.35 s, in s. closing_speed: v_rel, m/s. Source: UN R157, 5.2.5.2."""
    return LastMoment("reg157", braking=BRAKING, response=RESPONSE).critical_ttc(closing_speed)


@dataclass(frozen=True, slots=True)
class LastMoment:
    """What a regulation grants before a collision has to be avoided: `braking` m/s2, `response` s, `build_up` s."""

    ads: str
    braking: float
    response: float
    build_up: float = 0.0

    def critical_ttc(self, closing_speed: float) -> float:
        """TTC above which a collision has to be avoided: v_rel / (2 a) + tau / 2 + response, s. closing_speed: m/s."""
        return closing_speed / (2.0 * self.braking) + 0.5 * self.build_up + self.response

    def brakes(self, scenario: Briefing) -> SafetyBraking:
        """Brakes that take just that."""
        jerk = self.braking / self.build_up if self.build_up > 0.0 else math.inf
        return SafetyBraking(self.response, self.braking, jerk, scenario.vehicle, scenario.step)


class Reg157:
    """ADS `reg157`: 0.35 s after the last moment to begin, 6 m/s2; for a lead that brakes, 0.35 s after it does.

    margin: how much above the critical TTC it acts, s: a sensor's step of 0.1 s. lead_braking: deceleration of a lead
    at 2 s headway or less above which the lead counts as braking, m/s2. standstill_gap: what it takes off the gap for
    TTC, m: it releases where TTC is critical, and followed in continuous time that ends exactly against the other
    vehicle, a contact at 0 m/s.
    """

    last_moment = LastMoment("reg157", braking=BRAKING, response=RESPONSE)

    def __init__(self, margin: float = 0.1, lead_braking: float = 1.0, standstill_gap: float = 0.1) -> None:
        for name, value in (("margin", margin), ("lead_braking", lead_braking), ("standstill_gap", standstill_gap)):
            if not (math.isfinite(value) and value >= 0.0):
                raise must_be(f"`{name}`", f"ADS `{self.last_moment.ads}`", "a finite number, at least 0", value)
        self.margin = margin
        self.lead_braking = lead_braking
        self.standstill_gap = standstill_gap

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Forget everything."""
        self._sensor = Sensor()
        self._motion = Motion(scenario.step)
        self._lane_width = scenario.road.lane_width
        self._braking = self.last_moment.brakes(scenario)

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Brake while a vehicle ahead demands it, else keep the speed."""
        me, others = self._sensor.look(traci, ego)
        seen = [self._motion.of(other) for other in others]
        me = me._replace(braking=self._braking.path.level)
        return Command(-self._braking.follow(lambda after: self._demanded(me, seen, after), time))

    def _demanded(self, me: Mover, others: Sequence[Sighting], after: float) -> float:
        """Deceleration demanded `after` s from now, if everybody goes on as now, m/s2."""
        me = me.after(after)
        seen = visible(me, [each.after(after) for each in others], SHOWING)
        return self.last_moment.braking if any(self._demands(me, other) for other in seen) else 0.0

    def _demands(self, me: Mover, other: Mover) -> bool:
        if other.x <= me.x or lateral_gap(me, other) > self._intruding(me):
            return False
        left, closing = time_to_collision(me, other), me.along - other.along
        if lateral_overlap(me, other) > 0.0 and other.braking > self.lead_braking and me.along > 0.0:
            return within_headway(me, other, FOLLOWING_HEADWAY)
        if closing <= 0.0:
            return False
        return left <= self.last_moment.critical_ttc(closing) + self.margin + self.standstill_gap / closing

    def _intruding(self, me: Mover) -> float:
        """Lateral gap at which a vehicle's tyre is 0.3 m inside the lane of an ego in the middle of it, m."""
        return 0.5 * self._lane_width - me.half_width - INTRUSION
