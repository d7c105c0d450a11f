"""The ADS `lane_changer` in many cases at once: the decisions of `ads.lane_changer`, to the last bit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.car_following import IdmParameters
from sumo_eval.ads.overtaking import OvertakingHabits
from sumo_eval.ads.packed_car_following import PackedIdmParameters, free_acceleration
from sumo_eval.ads.packed_lane_change import PackedSteering
from sumo_eval.ads.packed_overtaking import PackedOvertaking
from sumo_eval.ads.packed_perception import look, visible
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.packed_controller import PackedCommand, PackedScene
from sumo_eval.trajectory import BoolArray, FloatArray


class PackedLaneChanger:
    """`LaneChanger` at the wheel of n egos."""

    def __init__(self, habits: OvertakingHabits, parameters: IdmParameters, scenario: Briefing) -> None:
        self._habits, self._parameters, self._scenario = habits, parameters, scenario
        self._began = False
        self._idm: PackedIdmParameters
        self._desired_speed: FloatArray
        self._overtaking: PackedOvertaking
        self._steering: PackedSteering

    def settled(self) -> BoolArray:
        """Like the plain one, it never says that it is."""
        return np.zeros(len(self._desired_speed), dtype=bool)

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these cases, in this order."""
        self._desired_speed, self._idm = self._desired_speed[rows], self._idm.at(rows)
        self._overtaking.keep(rows)
        self._steering.keep(rows)

    def step(self, scene: PackedScene, time: float) -> PackedCommand:
        """Decide, then steer along the paths decided on."""
        with np.errstate(all="ignore"):
            return self._step(scene)

    def _step(self, scene: PackedScene) -> PackedCommand:
        me, others = look(scene)
        if not self._began:
            self._began = True
            n, scenario = len(me.x), self._scenario
            self._idm = PackedIdmParameters.of([self._parameters] * n)
            self._desired_speed = me.speed
            self._overtaking = PackedOvertaking([self._habits] * n, [self._parameters] * n, scenario, me, len(others.x))
            self._steering = PackedSteering(scenario, n)
        seen = visible(me, others, hiding_share=0.0)
        free = free_acceleration(me.speed, self._desired_speed, self._idm)
        rank = np.zeros(others.x.shape)  # it holds the others as they come
        wanted = self._overtaking.acceleration(me, others, seen, rank, self._desired_speed, free)
        steering = self._steering.angle(me, self._overtaking.paths.at(self._steering.rear_axle_next(me)))
        return PackedCommand(np.maximum(wanted, -self._scenario.vehicle.max_deceleration), steering)
