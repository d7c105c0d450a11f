"""ADS `reg157`: what UN Regulation No. 157, 5.2.5, demands of an automated lane keeping system at the least.

A cut-in must be avoided when its TTC, as it intrudes into the lane, is above v_rel / (2 * 6 m/s2) + 0.35 s: the system
may take 0.35 s and brake at 6 m/s2. So that is what this one does, and no earlier than it must. docs/controllers.md
lists the readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from sumo_eval.ads.braking import follow_demand
from sumo_eval.ads.cycle import cycles_of
from sumo_eval.ads.lane_change import lane_kept
from sumo_eval.ads.perception import is_in_sight, lateral_overlap
from sumo_eval.ads.r157 import (
    FOLLOWING_HEADWAY,
    SAFETY_MEMORY,
    SHOWING,
    SIGHTING,
    foresee_all,
    lateral_gap,
    sight_all,
    time_to_collision,
    within_headway,
)
from sumo_eval.cosim.compiled import Compiled, records, unknown
from sumo_eval.cosim.records import MOVER, Records, fields, flags
from sumo_eval.errors import must_be
from sumo_eval.kernels import kernel, rows

RESPONSE = 0.35  # s
BRAKING = 6.0  # m/s2
INTRUSION = 0.3  # m, of the tyre beyond the lane marking


@dataclass(frozen=True, slots=True)
class LastMoment:
    """What a regulation grants before a collision has to be avoided: `braking` m/s2, `response` s, `build_up` s."""

    ads: str
    braking: float
    response: float
    build_up: float = 0.0

    def critical_ttc(self, closing_speed: float) -> float:
        """TTC above which a collision has to be avoided, s: `avoidable_ttc`. closing_speed: m/s."""
        return avoidable_ttc(closing_speed, self)


@kernel
def avoidable_ttc(closing_speed: float, granted: Any) -> float:
    """TTC above which a collision has to be avoided: v_rel / (2 a) + tau / 2 + response, s. closing_speed: m/s.

    granted: a `LastMoment`, or a record of one.
    """
    return float(closing_speed / (2.0 * granted.braking) + 0.5 * granted.build_up + granted.response)


def critical_ttc(closing_speed: float) -> float:
    """TTC_intrusion = v_rel / (2 * 6 m/s2) + 0.35 s, in s. closing_speed: v_rel, m/s. Source: UN R157, 5.2.5.2."""
    return Reg157.last_moment.critical_ttc(closing_speed)


_PARAMETERS = fields("margin", "lead_braking", "standstill_gap")
_GRANTED = fields("braking", "response", "build_up")
_MEMORY = [("safety", SAFETY_MEMORY), *fields("told"), *flags("steps")]
"""safety: its brakes, and where the ego is. told: the acceleration told in this cycle, m/s2. steps: driven so far."""


@kernel
def demands_braking(me: Any, other: Any, p: Any, granted: Any, scenario: Any) -> bool:
    """Whether a vehicle demands braking."""
    intruding = 0.5 * scenario.road.lane_width - me.half_width - INTRUSION  # m, lateral gap of who is in the lane
    if other.x <= me.x or lateral_gap(me, other) > intruding:
        return False
    left, closing = time_to_collision(me, other), me.along - other.along
    if lateral_overlap(me, other) > 0.0 and other.braking > p.lead_braking and me.along > 0.0:
        return within_headway(me, other, FOLLOWING_HEADWAY)
    if closing <= 0.0:
        return False
    return bool(left <= avoidable_ttc(closing, granted) + p.margin + p.standstill_gap / closing)


@kernel
def reg157_demand(scene: Any, after: float) -> float:
    """Deceleration demanded `after` s from now, if everybody goes on as now, m/s2. scene: as the rule makes it."""
    now, me, sightings, others, p, granted, scenario = scene
    foresee_all(now, me, sightings, others, after, scenario.step)
    for j in range(len(others)):
        if is_in_sight(me, others, j, SHOWING) and demands_braking(me, others[j], p, granted, scenario):
            return float(granted.braking)
    return 0.0


@kernel
def reg157(
    me: Any, others: Any, memory: Any, sightings: Any, later: Any, p: Any, granted: Any, cycle: Any, scenario: Any,
    time: float,
) -> float:  # fmt: skip
    """Braking while a vehicle ahead demands it, else the speed is kept, as an acceleration, m/s2; decided once a cycle.

    cycle: the scenario, with a cycle as its step.
    """
    if memory.steps % round(cycle.step / scenario.step) == 0:
        safety = memory.safety
        sight_all(safety, me, others, sightings, cycle.step)
        scene = (safety.me, safety.then, sightings, later, p, granted, cycle)
        jerk = granted.braking / granted.build_up if granted.build_up > 0.0 else math.inf
        memory.told = -follow_demand(
            safety.braking, reg157_demand, scene, time, granted.response, granted.braking, jerk, cycle.vehicle,
            cycle.step,
        )  # fmt: skip
    memory.steps += 1
    return float(memory.told)


@rows
def reg157_rows(
    egos: Records, seen: Records, memory: Records, sightings: Records, later: Records, parameters: Records,
    granted: Records, cycles: Records, scenario: Records, time: float,
) -> None:  # fmt: skip
    """`reg157` for every row."""
    for i in range(len(egos)):
        if egos[i].live:
            egos[i].command.acceleration = reg157(
                egos[i].seen, seen[i], memory[i], sightings[i], later[i], parameters[i], granted[i], cycles[i],
                scenario[0], time,
            )  # fmt: skip
            egos[i].command.steering = lane_kept(egos[i], scenario[0])


class Reg157(Compiled):
    """ADS `reg157`: 0.35 s after the last moment to begin, 6 m/s2; for a lead that brakes, 0.35 s after it does.

    margin: how much above the critical TTC it acts, s: a sensor's step of 0.1 s. lead_braking: deceleration of a lead
    at 2 s headway or less above which the lead counts as braking, m/s2. standstill_gap: what it takes off the gap for
    TTC, m: it releases where TTC is critical, and followed in continuous time that ends exactly against the other
    vehicle, a contact at 0 m/s.
    """

    loop = staticmethod(reg157_rows)
    last_moment: ClassVar[LastMoment] = LastMoment("reg157", braking=BRAKING, response=RESPONSE)

    def __init__(self, margin: float = 0.1, lead_braking: float = 1.0, standstill_gap: float = 0.1) -> None:
        for name, value in (("margin", margin), ("lead_braking", lead_braking), ("standstill_gap", standstill_gap)):
            if not (math.isfinite(value) and value >= 0.0):
                raise must_be(f"`{name}`", f"ADS `{self.last_moment.ads}`", "a finite number, at least 0", value)
        self.margin = margin
        self.lead_braking = lead_braking
        self.standstill_gap = standstill_gap

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Memory, what is remembered of the others, room for where they are foreseen to be, parameters, what is granted
        and what a cycle is.
        """
        count = len(together)
        granted = records([each.last_moment for each in together], _GRANTED)
        later = np.zeros((count, others), MOVER)
        return (
            np.zeros(count, _MEMORY), unknown(count, others, SIGHTING), later, records(together, _PARAMETERS),
            granted, cycles_of(scenario, count),
        )  # fmt: skip
