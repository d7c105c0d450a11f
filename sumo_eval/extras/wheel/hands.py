"""From keys, a steering wheel or a stick to the command of one step: the steering law, evaluated by the server.

A key cannot be pressed halfway. While one is held the steering wheel turns towards a limit that the speed sets, the
angle that gives a stated acceleration across the road, and goes back as soon as it is let go. Measured with a scripted
driver (preview 1.2 s, reaction 0.25 s) at 10..40 m/s: lane changes of 3.5 m overshoot by 0.3 m, lanes are kept to
0.2 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.settings import VehicleSettings

LEFT, RIGHT, DRIVE, BRAKE, HARD, EVADE = (1 << bit for bit in range(6))
KEYS: Final = {"left": LEFT, "right": RIGHT, "drive": DRIVE, "brake": BRAKE, "hard": HARD, "evade": EVADE}
"""What a key does: name -> its bit in the message of the page."""


@dataclass(frozen=True, slots=True)
class HandSettings:
    """The steering law: accelerations in m/s2, times in s."""

    lateral: float = 3.0  # acceleration across the road that a held key steers for
    evasive: float = 6.0  # with the key for evasion, and of a stick at its end
    turn_time: float = 0.3  # from straight to that limit
    return_time: float = 0.15  # and back
    fastest: float = 12.0  # rad/s of the steering wheel
    widest: float = math.radians(450.0)  # rad of the steering wheel
    drive: float = 2.5
    brake: float = 4.0
    hard: float = 9.0


class Given(NamedTuple):
    """What the driver's hands and feet do at one instant.

    kind: `keys`, `wheel` or `stick`. keys: bits of `KEYS`. steer: of a wheel its angle, rad; of a stick -1..1; positive
    to the left. throttle, brake: how far the pedals are pressed, 0..1.
    """

    kind: str = "keys"
    keys: int = 0
    steer: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0


LET_GO: Final = Given()


def angle_of(lateral: float, speed: float, vehicle: VehicleSettings, widest: float) -> float:
    """Steering wheel angle, rad, whose path has the acceleration `lateral` (m/s2) across it at a speed, m/s.

    steering ratio * atan(lateral * wheelbase / v^2), at most `widest`.
    """
    return min(vehicle.steering_ratio * math.atan2(lateral * vehicle.wheelbase, speed * speed), widest)


class Hands:
    """The steering wheel as the server turns it: one object a drive, one call a step (`step`, s)."""

    def __init__(self, vehicle: VehicleSettings, step: float) -> None:
        self._vehicle, self._step = vehicle, step
        self._law = HandSettings()
        self.angle = 0.0  # rad, positive to the left

    def command(self, given: Given, speed: float) -> Command:
        """The command of the coming step. speed: the ego's, m/s."""
        if given.kind == "keys":
            return self._by_keys(given.keys, speed)
        law, vehicle = self._law, self._vehicle
        if given.kind == "wheel":
            self.angle = min(max(given.steer, -law.widest), law.widest)
        else:
            wanted = given.steer * angle_of(law.evasive, speed, vehicle, law.widest)
            self._turn_to(wanted, law.fastest)
        return Command(given.throttle * vehicle.max_acceleration - given.brake * vehicle.max_deceleration, self.angle)

    def _by_keys(self, keys: int, speed: float) -> Command:
        law = self._law
        limit = angle_of(law.evasive if keys & EVADE else law.lateral, speed, self._vehicle, law.widest)
        side = bool(keys & LEFT) - bool(keys & RIGHT)
        self._turn_to(side * limit, limit / (law.turn_time if side else law.return_time))
        if keys & HARD:
            wanted = -law.hard
        elif keys & BRAKE:
            wanted = -law.brake
        else:
            wanted = law.drive if keys & DRIVE else 0.0
        return Command(wanted, self.angle)

    def _turn_to(self, wanted: float, rate: float) -> None:
        reach = min(rate, self._law.fastest) * self._step
        self.angle = min(max(wanted, self.angle - reach), self.angle + reach)
