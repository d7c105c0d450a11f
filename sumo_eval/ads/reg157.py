"""ADS `reg157`: the least that UN Regulation No. 157, 5.2.5, demands of an ALKS.

A collision with a vehicle that cuts in must be avoided if the TTC, as the vehicle intrudes into the
lane, is above v_rel / (2 * 6 m/s2) + 0.35 s: so the system may respond after 0.35 s and brake at 6
m/s2. This ADS does just that, and begins no earlier than it must. docs/baselines.md lists the
readings.

Users: `ads/eu_2022_1426.py`; `cosim/doors/controller.py`, by name.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from sumo_eval.ads.perception import lateral_overlap
from sumo_eval.ads.r157 import (
    BRAKES,
    SAFETY_MEMORY,
    SIGHTED,
    braking_loop,
    lateral_gap,
    time_to_collision,
    within_headway,
)
from sumo_eval.cosim.compiled import Compiled, check_numbers
from sumo_eval.kernels import fields, kernel

RESPONSE = 0.35  # s
BRAKING = 6.0  # m/s2
INTRUSION = 0.3  # m, of the tyre beyond the lane marking


class LastMoment(NamedTuple):
    """Time and braking that a regulation grants: it demands that a collision is avoided only if
    they are enough.

    ads: name of the ADS that uses all of them.
    braking: a, m/s2.
    response: s before the brakes act.
    build_up: tau, s from no braking to `braking`.
    """

    ads: str
    braking: float
    response: float
    build_up: float = 0.0

    @property
    def jerk(self) -> float:
        """Rate at which the braking builds up, m/s3."""
        return self.braking / self.build_up if self.build_up > 0.0 else math.inf


@kernel
def avoidable_ttc(closing_speed: float, granted: Any) -> float:
    """TTC above which a collision has to be avoided: v_rel / (2 a) + tau / 2 + response, s.

    UN R157, 5.2.5.2: v_rel / (2 * 6 m/s2) + 0.35 s.

    closing_speed: v_rel, m/s.
    granted: a `LastMoment`, or a record with its fields.
    """
    return float(
        closing_speed / (2.0 * granted.braking) + 0.5 * granted.build_up + granted.response
    )


@kernel
def reg157_braking(me: Any, other: Any, p: Any, scenario: Any) -> float:
    """Deceleration that a vehicle in front demands, m/s2: all that is granted, or 0.

    A braking vehicle in the path demands it at a headway of at most 2 s. A vehicle that has
    intruded into the lane demands it at or below the critical TTC.

    p: parameters of `Reg157`.
    """
    # m, lateral gap to a vehicle that has just intruded, if the ego is in the lane's middle
    intruded_gap = 0.5 * scenario.road.lane_width - me.half_width - INTRUSION
    if lateral_gap(me, other) > intruded_gap:
        return 0.0
    demands = lateral_overlap(me, other) > 0.0 and other.braking > p.lead_braking
    demands = demands and within_headway(me, other)
    closing = me.along - other.along
    if closing > 0.0:
        critical = avoidable_ttc(closing, p.brakes) + p.margin + p.standstill_gap / closing
        demands = demands or time_to_collision(me, other) <= critical
    return p.brakes.braking if demands else 0.0


@dataclass(eq=False)
class Reg157(Compiled):
    """ADS `reg157`: brakes at 6 m/s2, 0.35 s after the last moment to react or after a lead
    began to brake.

    margin: added to the critical TTC, s; by default one sensor step of 0.1 s.
    lead_braking: deceleration above which a lead at a headway of at most 2 s counts as braking,
        m/s2.
    standstill_gap: subtracted from the gap for TTC, m. The rule brakes only while TTC is critical:
        without this gap the ego would stop in contact, at 0 m/s.
    """

    loop = braking_loop(reg157_braking)
    memory, watched = SAFETY_MEMORY, SIGHTED
    numbers: ClassVar = [
        ("brakes", [*BRAKES[1], *fields("build_up")]),  # BRAKES is (name, fields)
        *fields("margin", "lead_braking", "standstill_gap"),
    ]
    brakes: ClassVar[LastMoment] = LastMoment("reg157", braking=BRAKING, response=RESPONSE)

    margin: float = 0.1
    lead_braking: float = 1.0
    standstill_gap: float = 0.1

    def __post_init__(self) -> None:
        check_numbers(self.brakes.ads, self)
