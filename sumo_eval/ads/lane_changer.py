"""The ADS `lane_changer`: keeps its speed and overtakes a slower vehicle smoothly when it pays, else follows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_eval.ads.car_following import PARAMETERS, IdmParameters, free_acceleration
from sumo_eval.ads.lane_change import path_at, rear_axle_next, steering
from sumo_eval.ads.overtaking import HABITS, OVERTAKING, WATCHED, OvertakingHabits, overtake
from sumo_eval.ads.perception import is_visible, take
from sumo_eval.cosim.compiled import Compiled, records, unknown
from sumo_eval.cosim.world import MOVER, Records, fields
from sumo_eval.kernels import kernel, rows

SMOOTH = OvertakingHabits(inclined=True, onset_headway=2.5, onset_ttc=10.0, duration=8.0)
_MEMORY = np.dtype([*OVERTAKING, *fields("desired_speed")])


@kernel
def lane_changer(
    me: Any, others: Any, memory: Any, known: Any, watched: Any, habits: Any, p: Any, way: Any, scenario: Any
) -> tuple[float, float]:
    """Acceleration, m/s2, and steering wheel angle, rad: decide, then steer along the path decided on."""
    if memory.began == 0:
        memory.desired_speed = me.speed
    for j in range(len(others)):
        take(known[j], others[j])
        if not is_visible(me, others, j, 0.0):
            known[j].x = math.nan
    free = free_acceleration(me.speed, memory.desired_speed, p)
    wanted = overtake(memory, me, known, watched, habits, p, memory.desired_speed, free, way, scenario)
    y, slope, bend = path_at(memory.path, rear_axle_next(me, scenario))
    return max(wanted, -scenario.vehicle.max_deceleration), steering(memory, me, y, slope, bend, scenario)


@rows
def lane_changer_rows(
    egos: Records, seen: Records, memory: Records, known: Records, watched: Records, habits: Records,
    parameters: Records, scenario: Records, time: float,
) -> None:  # fmt: skip
    """`lane_changer` for every row."""
    for i in range(len(egos)):
        if egos[i].live:
            command = egos[i].command
            command.acceleration, command.steering = lane_changer(
                egos[i].seen,
                seen[i],
                memory[i],
                known[i],
                watched[i],
                habits[i],
                parameters[i],
                egos[i].way,
                scenario[0],
            )


class LaneChanger(Compiled):
    """Overtakes a lead that is 2 m/s slower than its own initial speed: one smooth lane change, and it stays left.

    It begins at 10 s TTC or 2.5 s headway (the medians of recorded drivers, DLR-HT 2024) and takes 8 s, or the time
    that is left to be clear of the lead, but not less than a lateral acceleration of 2 m/s2 allows (3.2 s); where
    braking alone would need over 80 % of the brakes, 4 m/s2 (2.25 s). The left lane must be free: see
    `sumo_eval.ads.overtaking`. If it cannot change, it follows by the enhanced IDM. It sees a hidden vehicle once
    nothing covers any of it.
    """

    loop = staticmethod(lane_changer_rows)

    def __init__(self, habits: OvertakingHabits = SMOOTH, parameters: IdmParameters | None = None) -> None:
        self.habits = habits
        self.parameters = parameters or IdmParameters()

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Memory, what is seen, what is remembered of it, habits and parameters."""
        count = len(together)
        return (
            np.zeros(count, _MEMORY),
            np.zeros((count, others), MOVER),
            unknown(count, others, WATCHED),
            records([each.habits for each in together], HABITS),
            records([each.parameters for each in together], PARAMETERS),
        )
