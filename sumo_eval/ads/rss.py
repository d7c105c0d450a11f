"""ADS `rss`: Responsibility-Sensitive Safety, as the JRC compares it with the models of UN Regulation No. 157.

Unsafe is who is too close along the road and across it. Source: Shalev-Shwartz, Shammah, Shashua, arXiv:1708.06374;
constants as in the JRC's implementation. docs/controllers.md lists the readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from sumo_eval.ads.braking import SafetyBraking
from sumo_eval.ads.perception import Mover, Sensor, bumper_gap, visible
from sumo_eval.ads.r157 import HUMAN_BRAKING, HUMAN_JERK, SHOWING, Motion, Sighting, closing_across, lateral_gap
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.vehicle_model import Command

RESPONSE = 0.75  # rho, s
ACCELERATION = 3.0  # a, m/s2, of the ego within the response time
BRAKING = 6.0  # b, m/s2, of the ego
OTHER_BRAKING = 6.0  # bl, m/s2, of the vehicle ahead
LATERAL_ACCELERATION = 1.0  # ay, m/s2
LATERAL_MARGIN = 0.3  # mu, m


def longitudinal_safe_distance(speed: float, other_speed: float) -> float:
    """d_lon = v rho + a rho^2 / 2 + (v + rho a)^2 / (2 b) - w^2 / (2 bl), m. speed: v, other_speed: w, m/s."""
    faster = speed + RESPONSE * ACCELERATION
    driven = speed * RESPONSE + 0.5 * ACCELERATION * RESPONSE * RESPONSE
    return driven + faster * faster / (2.0 * BRAKING) - other_speed * other_speed / (2.0 * OTHER_BRAKING)


def lateral_safe_distance(lateral_speed: float) -> float:
    """d_lat = mu + |(2 vy + ay rho) rho / 2| + (vy + ay rho)^2 / (2 ay), m. lateral_speed: vy towards the ego, m/s."""
    faster = lateral_speed + LATERAL_ACCELERATION * RESPONSE
    driven = math.fabs((2.0 * lateral_speed + LATERAL_ACCELERATION * RESPONSE) * RESPONSE / 2.0)
    return LATERAL_MARGIN + driven + faster * faster / (2.0 * LATERAL_ACCELERATION)


class ResponsibilitySensitiveSafety:
    """ADS `rss`: full braking while a vehicle ahead violates both distances, `RESPONSE` s after one first did."""

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Forget everything."""
        self._sensor = Sensor()
        self._motion = Motion(scenario.step)
        self._braking = SafetyBraking(RESPONSE, HUMAN_BRAKING, HUMAN_JERK, scenario.vehicle, scenario.step)

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Brake at 0.774 g while unsafe, keep the speed while safe."""
        me, others = self._sensor.look(traci, ego)
        seen = [self._motion.of(other) for other in others]
        me = me._replace(braking=self._braking.path.level)
        return Command(-self._braking.follow(lambda after: demanded(me, seen, after), time))


def demanded(me: Mover, others: Sequence[Sighting], after: float) -> float:
    """Deceleration demanded `after` s from now, if everybody goes on as now, m/s2."""
    me = me.after(after)
    for other in visible(me, [each.after(after) for each in others], SHOWING):
        if other.x <= me.x or bumper_gap(me, other) >= longitudinal_safe_distance(me.along, other.along):
            continue
        if lateral_gap(me, other) < lateral_safe_distance(abs(closing_across(me, other))):
            return HUMAN_BRAKING
    return 0.0
