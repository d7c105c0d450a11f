"""Synthetic drivers in many cases at once: the decisions of `drivers.synthetic`, to the last bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.lane_change import smooth_step as smooth_step_of
from sumo_eval.ads.packed_lane_change import PackedPathPoints, PackedSteering, smooth_step
from sumo_eval.ads.packed_overtaking import PackedOvertaking
from sumo_eval.ads.packed_perception import PackedEgos, look
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.packed_controller import PackedCommand, PackedScene
from sumo_eval.drivers.packed_attention import PackedAttention
from sumo_eval.drivers.packed_wander import PackedNoise
from sumo_eval.drivers.synthetic import FOCUS_TIME, SETTLING_TIME, SPEED_RELAXATION, WANDER_PACE, SyntheticDriver
from sumo_eval.trajectory import BoolArray, FloatArray


class PackedDrivers:
    """n `SyntheticDriver`s, each at the wheel of its own ego."""

    def __init__(self, drivers: Sequence[SyntheticDriver], scenario: Briefing) -> None:
        self._drivers, self._scenario = drivers, scenario
        self._wander = PackedNoise([driver.wander for driver in drivers])
        self._pedal = PackedNoise([driver.pedal for driver in drivers])
        self._lane_offset = np.array([driver.driver.lane_offset for driver in drivers])
        self._clock = np.zeros(len(drivers))
        self._ease = np.ones(len(drivers))
        self._began = False
        self._desired_speed: FloatArray

    def settled(self) -> BoolArray:
        """Like the plain ones, they never say that they are."""
        return np.zeros(len(self._clock), dtype=bool)

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these cases, in this order."""
        for part in (self._wander, self._pedal, self._attention, self._overtaking, self._steering):
            part.keep(rows)
        self._lane_offset, self._desired_speed = self._lane_offset[rows], self._desired_speed[rows]
        self._clock, self._ease = self._clock[rows], self._ease[rows]

    def step(self, scene: PackedScene, time: float) -> PackedCommand:
        """Look, decide, work the pedals and the wheels."""
        with np.errstate(all="ignore"):
            return self._step(scene, time)

    def _sit_down(self, me: PackedEgos, others: int) -> None:
        self._began = True
        scenario, drivers = self._scenario, [each.driver for each in self._drivers]
        self._attention = PackedAttention(drivers, scenario.step, others)
        habits = [each.habits for each in self._drivers]
        self._overtaking = PackedOvertaking(habits, [driver.idm for driver in drivers], scenario, me, others)
        self._steering = PackedSteering(scenario, len(drivers))
        speeds = zip(drivers, me.speed.tolist(), strict=True)
        self._desired_speed = np.array([driver.desired_speed(speed) for driver, speed in speeds])

    def _step(self, scene: PackedScene, time: float) -> PackedCommand:
        me, others = look(scene)
        if not self._began:
            self._sit_down(me, len(others.x))
        known, which = self._attention.known(me, others, time)
        free = (self._desired_speed - me.speed) / SPEED_RELAXATION + self._pedal.value(time)
        free *= smooth_step_of(time / SETTLING_TIME)
        rank = self._attention.first_seen
        wanted = self._overtaking.acceleration(me, known, which, rank, self._desired_speed, free)
        steering = self._steering.angle(me, self._line(me))
        return PackedCommand(np.maximum(wanted, -self._scenario.vehicle.max_deceleration), steering)

    def _line(self, me: PackedEgos) -> PackedPathPoints:
        """As `SyntheticDriver._line`."""
        step = self._scenario.step
        focus = np.where(self._overtaking.passing, 0.0, 1.0)
        self._ease = self._ease + (focus - self._ease) * min(step / FOCUS_TIME, 1.0)
        pace = np.maximum(me.speed, WANDER_PACE) / np.maximum(self._ease, 1e-3)
        self._clock = self._clock + step * me.speed / pace
        path = self._overtaking.paths.at(self._steering.rear_axle_next(me))
        value, rate, bend = self._wander.at(self._clock)
        value = self._lane_offset + value
        share = self._clock / SETTLING_TIME
        if np.count_nonzero(share < 1.0):
            value, rate, bend = _settling(share, value, rate, bend)
        return PackedPathPoints(path.y + value, path.slope + rate / pace, path.bend + bend / (pace * pace))


def _settling(share: FloatArray, shift: FloatArray, rate: FloatArray, bend: FloatArray) -> tuple[FloatArray, ...]:
    """The wander while it takes over from the middle of the lane; share: of that time which is over."""
    s = np.minimum(np.maximum(share, 0.0), 1.0)
    left = 1.0 - s
    blend = smooth_step(share)
    rising = 30.0 * s * s * left * left / SETTLING_TIME
    bending = 60.0 * s * left * (1.0 - 2.0 * s) / (SETTLING_TIME * SETTLING_TIME)
    settled = share >= 1.0
    return (
        np.where(settled, shift, blend * shift),
        np.where(settled, rate, rising * shift + blend * rate),
        np.where(settled, bend, bending * shift + 2.0 * rising * rate + blend * bend),
    )
