"""Pedal levels that make a vehicle which is told a level once a step lose speed as it would in continuous time.

The vehicle model's brakes move to a told level at a finite rate, from the beginning of the step on, and then hold it.
So a level is chosen for what it brings about, not for what is wanted at some instant of the step.
"""

from __future__ import annotations

import math

from sumo_eval.settings import VehicleSettings


class BrakeOnset:
    """Full braking that begins within a step. level: the strongest asked for, m/s2."""

    def __init__(self, level: float, vehicle: VehicleSettings, step: float) -> None:
        self._full = level
        self._jerk = vehicle.brake_jerk
        self._step = step
        self._strongest = min(level, vehicle.max_deceleration)

    def level(self, wait: float) -> float:
        """Deceleration to ask for in the coming step, m/s2, if braking is to begin `wait` s from its beginning.

        With h the step, j the brakes' rate, B the strongest level, b = B / j:

            c = j / 2 (h + b - sqrt((h + b)^2 - 4 b (h - wait)))

        A ramp from 0 to c, c until the end of the step, and full braking from then on lose the same speed in the end
        as a ramp to B that begins `wait` s late.
        """
        if wait <= 0.0:
            return self._full
        if wait >= self._step:
            return 0.0
        build_up = self._strongest / self._jerk
        both = self._step + build_up
        return 0.5 * self._jerk * (both - math.sqrt(both * both - 4.0 * build_up * (self._step - wait)))
