"""Brakes and motor in continuous time, for `lane_changer`, which is called once a step and also
speeds up.

As in `sumo_eval.ads.braking`, a rule's command is a path: an acceleration over time that may change
anywhere within a step. The vehicle gets one command for the step, such that at its end the speed is
that of the path.
"""

from typing import Any

from sumo_eval.ads.braking import mean_level
from sumo_eval.cosim.vehicle_model import drive
from sumo_eval.kernels import fields, kernel

# m/s, assumed where only the change of speed counts: too fast to come to a standstill in a step
_ROLLING = 1e3

PEDALS = fields("level", "given", "owed")
"""Memory: the acceleration that the rule intends, and the vehicle's own; all 0 at the start.

level: intended acceleration, m/s2.
given: the vehicle's acceleration, m/s2.
owed: speed that the vehicle has yet to gain to be as fast as intended, m/s.
"""


@kernel
def gained_towards(pedals: Any, target: float, duration: float, vehicle: Any) -> float:
    """Speed gained in `duration` s, m/s, while the intended acceleration goes to `target` (m/s2)
    as fast as brakes and drive allow, and stays there.
    """
    level, speed, _ = drive(_ROLLING, pedals.level, target, vehicle, duration)
    pedals.level = level
    return speed - _ROLLING


@kernel
def pedal_command(pedals: Any, speed: float, gained: float, vehicle: Any, step: float) -> float:
    """Command, m/s2, for a vehicle at `speed`, m/s, that shall gain `gained` m/s in this step.

    Call once a step.

    Brakes and drive bound it; a vehicle that comes to a standstill owes nothing.
    """
    # computed for brakes; a drive that rises more slowly owes the rest
    command = mean_level(pedals.given, (gained + pedals.owed) / step, vehicle.brake_jerk, step)
    command = min(max(command, -vehicle.max_deceleration), vehicle.max_acceleration)
    given, after, _ = drive(_ROLLING, pedals.given, command, vehicle, step)
    pedals.given = given
    pedals.owed += gained - (after - _ROLLING)
    if speed + after - _ROLLING <= 0.0:
        pedals.owed = 0.0
    return float(command)
