"""ADSs whose result is known in closed form: one that does nothing, and the ideal vehicle of Eq. 17."""

from __future__ import annotations

import math
from typing import Any

from sumo_eval.ads.perception import Sensor, lateral_overlap
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import must_be


def no_reaction(traci: Any, ego: str, time: float) -> Command:
    """ADS `no_reaction`: keeps its speed and its wheel straight, whatever is ahead."""
    return Command(0.0)


class IdealBraking:
    """ADS `ideal_braking`, the reference Ug of Eq. 17: perfect perception, immediate braking at the road's limit.

    It brakes whenever it closes on any vehicle ahead in its path, a hidden one too, until it is as slow as that
    vehicle; it never drives faster again. The pressure build-up is the vehicle model's
    (`VehicleSettings.brake_build_up`, 0.15 s), as far as `deceleration` is the strongest that the vehicle has. So its
    impact speed is `criticality.ideal_impact_speed(..., deceleration=deceleration, delay=0, build_up=0.15)`.
    """

    def __init__(self, deceleration: float = 9.0) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise must_be("`deceleration`", "ADS `ideal_braking`", "a finite number greater than 0 m/s2", deceleration)
        self.deceleration = deceleration

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Open the eyes."""
        self._sensor = Sensor()

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Full braking while closing on anything ahead, else roll."""
        me, others = self._sensor.look(traci, ego)
        for other in others:
            if other.x > me.x and me.along > other.along and lateral_overlap(me, other) > 0.0:
                return Command(-self.deceleration)
        return Command(0.0)
