"""Command of one step from keys, a steering wheel or a stick, by a law of steering.

A key cannot be pressed halfway. So a held steering key turns the steering wheel towards a limit:
the angle that gives the acceleration `LATERAL` across the road at the ego's speed. When the key is
released, the wheel returns. A scripted driver (preview 1.2 s, reaction 0.25 s) at 10..40 m/s
overshoots by 0.3 m in lane changes of 3.5 m, and keeps its lane within 0.2 m.

Users: `extras/wheel/messages.py`, `extras/wheel/seat.py`.
"""

import math
from typing import NamedTuple

from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.settings import VehicleSettings

# Functions of keys, as bits of one number; `BITS` in templates/drive.js must have the same.
LEFT, RIGHT, DRIVE = 1, 2, 4
BRAKE, HARD, EVADE = 8, 16, 32
EVERY_KEY = LEFT | RIGHT | DRIVE | BRAKE | HARD | EVADE

LATERAL = 3.0  # m/s2 across the path, which the limit of a held steering key gives
EVASIVE = 6.0  # m/s2, the same with the key for evasion, and of a stick pushed to its end
TURN_TIME = 0.3  # s in which a held key turns the wheel from straight to its limit
RETURN_TIME = 0.15  # s in which the released wheel turns from its limit to straight
FASTEST = 12.0  # rad/s: keys and stick never turn the wheel faster, so at low speed it takes longer
WIDEST = math.radians(450.0)  # largest angle of the steering wheel to each side, rad
DRIVES, BRAKES, BRAKES_HARD = 2.5, 4.0, 9.0  # m/s2: size of the acceleration by each key


class Given(NamedTuple):
    """Input of the driver's hands and feet at one instant.

    kind: `keys`, `wheel` or `stick`.
    keys: the keys that are held, bits of `EVERY_KEY`.
    steer: of a wheel its angle, rad; of a stick -1..1; positive to the left.
    throttle, brake: how far the pedals are pressed, 0..1.
    """

    kind: str = "keys"
    keys: int = 0
    steer: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0


RELEASED = Given()


def angle_of(lateral: float, speed: float, vehicle: VehicleSettings) -> float:
    """Steering wheel angle, rad, that gives an acceleration across the path.

    lateral: that acceleration, m/s2.
    speed: of the ego, m/s.

    It is steering ratio * atan(lateral * wheelbase / speed^2), at most `WIDEST`.
    """
    return min(
        vehicle.steering_ratio * math.atan2(lateral * vehicle.wheelbase, speed * speed), WIDEST
    )


class Hands:
    """The steering wheel as the server turns it: one object a drive.

    step: time between two calls of `command`, s.
    """

    def __init__(self, vehicle: VehicleSettings, step: float) -> None:
        self._vehicle, self._step = vehicle, step
        self.angle = 0.0  # rad, positive to the left

    def command(self, given: Given, speed: float) -> Command:
        """The command of the coming step.

        speed: the ego's, m/s.
        """
        if given.kind == "keys":
            return self._by_keys(given.keys, speed)
        vehicle = self._vehicle
        if given.kind == "wheel":
            self.angle = min(max(given.steer, -WIDEST), WIDEST)
        else:
            self._turn_to(given.steer * angle_of(EVASIVE, speed, vehicle), FASTEST)
        return Command(
            given.throttle * vehicle.max_acceleration - given.brake * vehicle.max_deceleration,
            self.angle,
        )

    def _by_keys(self, keys: int, speed: float) -> Command:
        """The command by keys: bits of `EVERY_KEY`."""
        limit = angle_of(EVASIVE if keys & EVADE else LATERAL, speed, self._vehicle)
        side = bool(keys & LEFT) - bool(keys & RIGHT)
        self._turn_to(side * limit, limit / (TURN_TIME if side else RETURN_TIME))
        if keys & HARD:
            acceleration = -BRAKES_HARD
        elif keys & BRAKE:
            acceleration = -BRAKES
        else:
            acceleration = DRIVES if keys & DRIVE else 0.0
        return Command(acceleration, self.angle)

    def _turn_to(self, angle: float, rate: float) -> None:
        """Turn the wheel towards an angle, rad, for one step at a rate, rad/s."""
        reach = min(rate, FASTEST) * self._step
        self.angle = min(max(angle, self.angle - reach), self.angle + reach)
