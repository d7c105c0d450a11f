"""ADS `rss`: Responsibility-Sensitive Safety, as in the JRC's comparison of models for UN
Regulation No. 157.

A vehicle that is too close both along the road and across it is unsafe. Source: Shalev-Shwartz,
Shammah, Shashua, arXiv:1708.06374; constants as in the JRC's implementation. docs/baselines.md
lists the choices that the source leaves open.

Users: `cosim/doors/controller.py`, by its locator.
"""

from typing import Any

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
from sumo_eval.cosim.compiled import Compiled
from sumo_eval.kernels import kernel

RESPONSE = 0.75  # rho, s
ACCELERATION = 3.0  # a, m/s2, of the ego within the response time
BRAKING = 6.0  # b, m/s2, of the ego in its stopping distance; it brakes with `HUMAN_BRAKING`
OTHER_BRAKING = 6.0  # bl, m/s2, of the actor ahead
LATERAL_ACCELERATION = 1.0  # ay, m/s2
LATERAL_MARGIN = 0.3  # mu, m
ROUNDING = 1e-6  # m/s by which the speed of a standing vehicle may be below 0


@kernel
def stopping_distance(speed: float, braking: float) -> float:
    """D(v, b) = v rho + a rho^2 / 2 + (v + rho a)^2 / (2 b), m."""
    # x * x instead of x**2: compiled code then gives the same bits as Python
    faster = speed + RESPONSE * ACCELERATION
    reaction = speed * RESPONSE + 0.5 * ACCELERATION * RESPONSE * RESPONSE
    return reaction + faster * faster / (2.0 * braking)


@kernel
def longitudinal_safe_distance(speed: float, other_speed: float) -> float:
    """d_lon = D(v, b) - w^2 / (2 bl), to an oncoming vehicle D(v, b) + D(|w|, bl), m.

    speed: v, other_speed: w, m/s, both along the road; an oncoming vehicle has w < 0.
    """
    own = stopping_distance(speed, BRAKING)
    if other_speed < -ROUNDING:
        return own + stopping_distance(-other_speed, OTHER_BRAKING)
    return own - other_speed * other_speed / (2.0 * OTHER_BRAKING)


@kernel
def lateral_safe_distance(lateral_speed: float) -> float:
    """d_lat = mu + (2 vy + ay rho) rho / 2 + (vy + ay rho)^2 / (2 ay), m.

    lateral_speed: vy >= 0, m/s: a vehicle that moves away counts as one that comes.
    """
    faster = lateral_speed + LATERAL_ACCELERATION * RESPONSE
    driven = (2.0 * lateral_speed + LATERAL_ACCELERATION * RESPONSE) * RESPONSE / 2.0
    return LATERAL_MARGIN + driven + faster * faster / (2.0 * LATERAL_ACCELERATION)


@kernel
def rss_braking(me: Any, other: Any, p: Any, scenario: Any) -> float:
    """Deceleration that an actor ahead demands, m/s2: `HUMAN_BRAKING` where it is too close.

    me, other: the ego and the actor, as `MOVER`s; p and scenario are not used.
    """
    d_lon = longitudinal_safe_distance(me.along, other.along)
    d_lat = lateral_safe_distance(abs(closing_across(me, other)))
    unsafe = bumper_gap(me, other) < d_lon and lateral_gap(me, other) < d_lat
    return HUMAN_BRAKING if unsafe else 0.0


class ResponsibilitySensitiveSafety(Compiled):
    """ADS `rss`: brakes with `HUMAN_BRAKING` while the distances along and across the road to an
    actor ahead, in sight, are both too short, and then releases the brakes.

    The response time `RESPONSE`, s, passes only once, after the first such demand
    (`braking.follow_demand`). The ADS decides at every step (`clocks`).
    """

    loop = braking_loop(rss_braking, clocks=1)
    memory, watched, numbers = SAFETY_MEMORY, SIGHTED, [BRAKES]
    brakes = Brakes(RESPONSE, HUMAN_BRAKING, HUMAN_JERK)
