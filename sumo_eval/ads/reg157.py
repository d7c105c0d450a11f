"""ADS `reg157`: what UN Regulation No. 157, 5.2.5, demands of an automated lane keeping system at the least.

A cut-in must be avoided when its TTC, as it intrudes into the lane, is above v_rel / (2 * 6 m/s2) + 0.35 s: the system
may take 0.35 s and brake at 6 m/s2. So that is what this one does, and no earlier than it must. docs/controllers.md
lists the readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_eval.ads.perception import is_visible, lateral_overlap
from sumo_eval.ads.r157 import (
    BRAKES,
    FOLLOWING_HEADWAY,
    MOTION,
    SHOWING,
    brake_towards,
    deceleration,
    lateral_gap,
    time_to_collision,
    within_headway,
)
from sumo_eval.cosim.compiled import Compiled, records, unknown
from sumo_eval.cosim.world import Records, fields
from sumo_eval.errors import must_be
from sumo_eval.kernels import kernel, rows

RESPONSE = 0.35  # s
BRAKING = 6.0  # m/s2
INTRUSION = 0.3  # m, of the tyre beyond the lane marking


@kernel
def critical_ttc(closing_speed: float) -> float:
    """TTC_intrusion = v_rel / (2 * 6 m/s2) + 0.35 s, in s. closing_speed: v_rel, m/s. Source: UN R157, 5.2.5.2."""
    return closing_speed / (2.0 * BRAKING) + RESPONSE


_MEMORY = np.dtype(BRAKES)
_PARAMETERS = fields("margin", "lead_braking")


@kernel
def demands_braking(me: Any, other: Any, braking: float, p: Any, scenario: Any) -> bool:
    """Whether a vehicle demands braking; braking: its own deceleration, m/s2."""
    intruding = 0.5 * scenario.road.lane_width - me.half_width - INTRUSION  # m, lateral gap of who is in the lane
    if other.x <= me.x or lateral_gap(me, other) > intruding:
        return False
    if lateral_overlap(me, other) > 0.0 and braking > p.lead_braking and me.along > 0.0:
        return within_headway(me, other, FOLLOWING_HEADWAY)
    return bool(time_to_collision(me, other) <= critical_ttc(me.along - other.along) + p.margin)


@kernel
def reg157(me: Any, others: Any, memory: Any, motions: Any, p: Any, scenario: Any, time: float) -> float:
    """Braking while a vehicle ahead demands it, else the speed is kept, as an acceleration, m/s2."""
    demanded = 0.0
    for j in range(len(others)):
        if is_visible(me, others, j, SHOWING):
            braking = deceleration(motions[j], others[j], scenario.step)
            if demands_braking(me, others[j], braking, p, scenario):
                demanded = BRAKING
    return -brake_towards(memory, demanded, time, RESPONSE, BRAKING, math.inf, scenario.step)


@rows
def reg157_rows(
    egos: Records, seen: Records, memory: Records, motions: Records, parameters: Records, scenario: Records,
    time: float,
) -> None:  # fmt: skip
    """`reg157` for every row."""
    for i in range(len(egos)):
        if egos[i].live:
            egos[i].command.acceleration = reg157(
                egos[i].seen, seen[i], memory[i], motions[i], parameters[i], scenario[0], time
            )


class Reg157(Compiled):
    """ADS `reg157`: 0.35 s after the last moment to begin, 6 m/s2; for a lead that brakes, 0.35 s after it does.

    margin: how much above the critical TTC it acts, s: a sensor's step of 0.1 s. lead_braking: deceleration of a lead
    at 2 s headway or less above which the lead counts as braking, m/s2.
    """

    loop = staticmethod(reg157_rows)

    def __init__(self, margin: float = 0.1, lead_braking: float = 1.0) -> None:
        for name, value in (("margin", margin), ("lead_braking", lead_braking)):
            if not (math.isfinite(value) and value >= 0.0):
                raise must_be(f"`{name}`", "ADS `reg157`", "a finite number, at least 0", value)
        self.margin = margin
        self.lead_braking = lead_braking

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Memory, what is remembered of the others, parameters."""
        count = len(together)
        return np.zeros(count, _MEMORY), unknown(count, others, MOTION), records(together, _PARAMETERS)
