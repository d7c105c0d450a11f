"""ADS `fsm`: the fuzzy safety model, performance model 2 of UN Regulation No. 157 (01 series, Annex
3).

Two surrogate safety metrics between 0 (safe) and 1 (unsafe) set the braking: PFS (proactive fuzzy
safety) supposes that the lead may brake hard, CFS (critical fuzzy safety) that both continue as
they are. Source: the regulation, and Mattas et al., Accid. Anal. Prev. 148, 105794 (2020);
constants as in the JRC's implementation. docs/baselines.md lists the readings.

Users: `cosim/doors/controller.py`, by its locator.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from sumo_eval.ads.perception import bumper_gap
from sumo_eval.ads.r157 import (
    BRAKES,
    HUMAN_BRAKING,
    HUMAN_JERK,
    SAFETY_MEMORY,
    SIGHTED,
    Brakes,
    braking_loop,
    closing_across,
    lateral_gap,
)
from sumo_eval.cosim.compiled import Compiled, check_numbers
from sumo_eval.kernels import fields, flags, kernel

REACTION = 0.75  # tau, s
COMFORTABLE = 4.0  # bc, m/s2
STRONGEST = 6.0  # bm, m/s2
OTHER_BRAKING = 7.0  # bo, m/s2, of the vehicle ahead
MARGIN = 2.0  # d1, m
CUT_IN_MARGIN = 0.1  # s after the ego has got past, within which a cut-in still counts


@kernel
def _between(distance: float, unsafe: float, safe: float) -> float:
    """1 below `unsafe`, 0 above `safe`, linear between."""
    if distance >= safe:
        return 0.0
    return 1.0 if distance <= unsafe else (safe - distance) / (safe - unsafe)


@kernel
def proactive_fuzzy_safety(gap: float, speed: float, other_speed: float) -> float:
    """PFS(d): 1 below d1 + d_unsafe, 0 above d1 + d_safe, linear between.

    d_safe = u tau + u^2 / (2 bc) - w^2 / (2 bo) + d1
    d_unsafe = u tau + u^2 / (2 bm) - w^2 / (2 bo)
    As printed, d1 counts twice in the upper limit, and once in the lower one.

    gap: d, m.
    speed: u, other_speed: w, m/s.
    """
    shared = speed * REACTION - other_speed * other_speed / (2.0 * OTHER_BRAKING)
    safe = shared + speed * speed / (2.0 * COMFORTABLE) + MARGIN
    unsafe = shared + speed * speed / (2.0 * STRONGEST)
    return _between(gap, MARGIN + unsafe, MARGIN + safe)


@kernel
def critical_fuzzy_safety(
    gap: float, speed: float, other_speed: float, acceleration: float, as_coded: bool = False
) -> float:
    """CFS(d): 1 below d_unsafe, 0 above d_safe, linear between; 0 when not closing.

    a' = max(a, -bc); u2 = u + a' tau, the speed after the reaction time. If u2 > w:
    d_new = ((u + u2) / 2 - w) tau, d_safe = d_new + (u2 - w)^2 / (2 bc),
    d_unsafe = d_new + (u2 - w)^2 / (2 bm). Else both are (u - w)^2 / (2 |a'|).

    gap: d, m.
    speed: u, other_speed: w, m/s.
    acceleration: a, of the ego as its brakes intend it, at most 0, m/s2.
    as_coded: |a| stands for |a'| in the last of these, as in the JRC's program.
    """
    closing = speed - other_speed
    if closing <= 0.0:
        return 0.0
    bounded = max(acceleration, -COMFORTABLE)  # a'
    later = speed + bounded * REACTION  # u2
    if later <= other_speed:
        # not 0: at u2 <= w < u the ego brakes
        distance = closing * closing / (2.0 * abs(acceleration if as_coded else bounded))
        return 1.0 if gap < distance else 0.0
    covered = (0.5 * (speed + later) - other_speed) * REACTION
    remaining = (later - other_speed) * (later - other_speed)
    return _between(
        gap, covered + remaining / (2.0 * STRONGEST), covered + remaining / (2.0 * COMFORTABLE)
    )


@kernel
def demanded_braking(critical: float, proactive: float) -> float:
    """Deceleration for CFS and PFS, m/s2: bc + CFS (bm - bc) when CFS > 0, else PFS bc."""
    return (
        COMFORTABLE + critical * (STRONGEST - COMFORTABLE)
        if critical > 0.0
        else proactive * COMFORTABLE
    )


@kernel
def considered(me: Any, other: Any, lateral_closing: float) -> bool:
    """Whether the other vehicle counts: it overlaps already, or will reach the ego's strip before
    the ego is past.

    u > w and (lateral gap) / (lateral closing speed) < (d + both lengths) / (u - w) + 0.1 s. One
    outside the strip that is at least as fast as the ego is ignored, as in the regulation's lateral
    safety check.

    lateral_closing: m/s.
    """
    across = lateral_gap(me, other)
    if across <= 0.0:
        return True
    closing = me.along - other.along
    if lateral_closing <= 0.0 or closing <= 0.0:
        return False
    lengths = 2.0 * (me.half_length + other.half_length)
    return bool(
        across / lateral_closing < (bumper_gap(me, other) + lengths) / closing + CUT_IN_MARGIN
    )


@kernel
def fuzzy_braking(me: Any, other: Any, p: Any, scenario: Any) -> float:
    """Deceleration that an actor demands, m/s2.

    me, other: the ego and the actor, as `MOVER`s. p: parameters of `FuzzySafetyModel`.
    """
    if not considered(me, other, closing_across(me, other)):
        return 0.0
    # PFS has a margin of its own, so only CFS takes the standstill gap off
    gap = bumper_gap(me, other)
    critical = critical_fuzzy_safety(
        gap - p.standstill_gap, me.along, other.along, -me.braking, p.as_coded == 1
    )
    return demanded_braking(critical, proactive_fuzzy_safety(gap, me.along, other.along))


@dataclass(eq=False)
class FuzzySafetyModel(Compiled):
    """ADS `fsm`: brakes as PFS and CFS demand, `REACTION` s after they first do; otherwise it
    keeps its speed.

    standstill_gap: subtracted from the gap in CFS, m. Without it, braking as CFS demands brings the
        ego to rest exactly against the other vehicle, which is a contact at 0 m/s. PFS has the
        margin d1 already.
    as_coded: CFS as the JRC's program has it (`critical_fuzzy_safety`), not as it is printed.
    """

    loop = braking_loop(fuzzy_braking)
    memory, watched = SAFETY_MEMORY, SIGHTED
    numbers: ClassVar = [BRAKES, *fields("standstill_gap"), *flags("as_coded")]
    brakes = Brakes(REACTION, HUMAN_BRAKING, HUMAN_JERK)

    standstill_gap: float = 0.01
    as_coded: bool = False

    def __post_init__(self) -> None:
        check_numbers("fsm", self)
