"""The ADS `lane_changer`: keeps its speed and overtakes a slower vehicle smoothly when it pays, else follows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sumo_eval.ads.car_following import IdmParameters, free_acceleration
from sumo_eval.ads.lane_change import Steering
from sumo_eval.ads.overtaking import Overtaking, OvertakingHabits
from sumo_eval.ads.perception import Sensor, visible
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.vehicle_model import Command

if TYPE_CHECKING:
    from sumo_eval.ads.packed_lane_changer import PackedLaneChanger

SMOOTH = OvertakingHabits(inclined=True, onset_headway=2.5, onset_ttc=10.0, duration=8.0)


class LaneChanger:
    """Overtakes a lead that is 2 m/s slower than its own initial speed: one smooth lane change, and it stays left.

    It begins at 10 s TTC or 2.5 s headway (the medians of recorded drivers, DLR-HT 2024) and takes 8 s, or the time
    that is left to be clear of the lead, but not less than a lateral acceleration of 2 m/s2 allows (3.2 s); where
    braking alone would need over 80 % of the brakes, 4 m/s2 (2.25 s). The left lane must be free: see
    `sumo_eval.ads.overtaking`. If it cannot change, it follows by the enhanced IDM. It sees a hidden vehicle once
    nothing covers any of it.
    """

    def __init__(self, habits: OvertakingHabits = SMOOTH, parameters: IdmParameters | None = None) -> None:
        self.habits = habits
        self.parameters = parameters or IdmParameters()

    def packed(self, scenario: Briefing) -> PackedLaneChanger | None:
        """The same at the wheel of many egos; None of a subclass, which may decide otherwise."""
        if type(self) is not LaneChanger:
            return None
        from sumo_eval.ads.packed_lane_changer import PackedLaneChanger

        return PackedLaneChanger(self.habits, self.parameters, scenario)

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Take the lane and the speed of the start as the wanted ones."""
        self._sensor = Sensor()
        me = self._sensor.look(traci, ego).me
        self._desired_speed = me.speed
        self._strongest = scenario.vehicle.max_deceleration
        self._overtaking = Overtaking(self.habits, self.parameters, scenario, me)
        self._steering = Steering(scenario.vehicle, scenario.step)

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Decide, then steer along the path decided on."""
        me, others = self._sensor.look(traci, ego)
        seen = visible(me, others, hiding_share=0.0)
        free = free_acceleration(me.speed, self._desired_speed, self.parameters)
        wanted = self._overtaking.acceleration(me, seen, self._desired_speed, free)
        path = self._overtaking.path
        steering = self._steering.angle(me, path.at(self._steering.rear_axle_next(me)))
        return Command(max(wanted, -self._strongest), steering)
