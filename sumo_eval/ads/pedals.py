"""Brakes and motor in continuous time, for a rule that is called once a cycle.

As in `sumo_eval.ads.braking`, the acceleration that a rule intends is a path: a function of time
that may change anywhere within a cycle. The vehicle gets one command for the cycle: the one by
which its speed at the end is that of the path, or as near to it as brakes and motor can come. Here
the acceleration may be positive, too.

Users: `ads/lane_changer.py`.
"""

from typing import Any

from sumo_eval.ads.braking import mean_level
from sumo_eval.cosim.vehicle_model import drive
from sumo_eval.kernels import fields, kernel

# m/s, a speed for `drive` where only its change counts: too fast for a standstill within a cycle
_ROLLING = 1e3

PEDALS = fields("level", "own", "owed")
"""Memory of `pedal_command`; all 0 at the start.

level: acceleration that the rule intends, m/s2.
own: acceleration of the vehicle, m/s2.
owed: speed that the vehicle has yet to gain to be as fast as intended, m/s.
"""


@kernel
def gained_towards(pedals: Any, target: float, duration: float, vehicle: Any) -> float:
    """Speed gained in `duration` s, m/s, while the intended acceleration goes to `target` (m/s2)
    as fast as brakes and motor allow, and stays there.
    """
    level, speed, _ = drive(_ROLLING, pedals.level, target, vehicle, duration)
    pedals.level = level
    return speed - _ROLLING


@kernel
def pedal_command(pedals: Any, speed: float, gained: float, vehicle: Any, cycle: float) -> float:
    """Command, m/s2, for a vehicle at `speed`, m/s, that shall gain `gained` m/s in this cycle.

    Call once a cycle, whose length is `cycle` s.

    Brakes and motor limit the command. A vehicle that comes to a standstill owes nothing.
    """
    before = pedals.own
    # The rate is that of the brakes. A motor changes the acceleration more slowly: the speed that
    # it does not reach is owed to the next cycle.
    command = mean_level(before, (gained + pedals.owed) / cycle, vehicle.brake_jerk, cycle)
    command = min(max(command, -vehicle.max_deceleration), vehicle.max_acceleration)
    own, after, _ = drive(_ROLLING, before, command, vehicle, cycle)
    pedals.owed += gained - (after - _ROLLING)
    if speed + after - _ROLLING <= 0.0:
        # its own acceleration is 0 at a standstill, however hard the brakes are pressed
        own, _, _ = drive(speed, before, command, vehicle, cycle)
        pedals.owed = 0.0
    pedals.own = own
    return float(command)
