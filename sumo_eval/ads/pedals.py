"""Brakes and motor in continuous time, for a rule that is called once a step and also speeds up.

As in `sumo_eval.ads.braking`, the acceleration that a rule intends is a path: a function of time
that may change anywhere within a step. The vehicle gets one command for the step, such that its
speed at the end of the step is that of the path.

Users: `ads/lane_changer.py`.
"""

from typing import Any

from sumo_eval.ads.braking import mean_level
from sumo_eval.cosim.vehicle_model import drive
from sumo_eval.kernels import fields, kernel

# m/s, a speed for `drive` where only its change counts: too fast for a standstill within a step
_ROLLING = 1e3

PEDALS = fields("level", "own", "owed")
"""Memory: the acceleration that the rule intends, and the vehicle's own; all 0 at the start.

level: intended acceleration, m/s2.
own: the vehicle's acceleration, m/s2.
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

    Brakes and drive limit the command. A vehicle that comes to a standstill owes nothing.
    """
    # as if the acceleration changed as fast as the brakes'; a drive is slower, and owes the rest
    command = mean_level(pedals.own, (gained + pedals.owed) / step, vehicle.brake_jerk, step)
    command = min(max(command, -vehicle.max_deceleration), vehicle.max_acceleration)
    own, after, _ = drive(_ROLLING, pedals.own, command, vehicle, step)
    pedals.own = own
    pedals.owed += gained - (after - _ROLLING)
    if speed + after - _ROLLING <= 0.0:
        pedals.owed = 0.0
    return float(command)
