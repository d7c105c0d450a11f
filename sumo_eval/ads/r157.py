"""What the reference drivers of UN Regulation No. 157 share: brakes that build up, headways along and across."""

from __future__ import annotations

import math
from typing import Any

from sumo_eval.ads.perception import bumper_gap
from sumo_eval.cosim.world import fields, flags
from sumo_eval.kernels import kernel

GRAVITY = 9.81  # m/s2
HUMAN_JERK = 12.65  # m/s3, rate at which the regulation's human brakes (0.774 g in 0.6 s)
HUMAN_BRAKING = 0.774 * GRAVITY  # m/s2, the strongest of the regulation's human
FOLLOWING_HEADWAY = 2.0  # s, at which and below which the regulation's human minds what the lead does
HEADWAY_ROUNDING = 0.01  # s
SHOWING = 0.8  # share of a vehicle that a nearer one may cover at most, or it is hidden: 0.375 m of 1.9 m must show


@kernel
def brake_ramp(since: float, level: float, build_up: float) -> float:
    """Braking `since` s after it began, m/s2: from 0 to `level`, linear over `build_up` s, then held; 0 before."""
    if since <= 0.0:
        return 0.0
    return level * min(since / build_up, 1.0) if build_up > 0.0 else level


@kernel
def time_to_collision(me: Any, other: Any) -> float:
    """TTC = d / (v - w), s: bumper gap over closing speed; inf when not closing, 0 or less beside a slower vehicle."""
    closing = me.along - other.along
    return bumper_gap(me, other) / closing if closing > 0.0 else math.inf


@kernel
def time_headway(me: Any, other: Any) -> float:
    """THW = d / v, s: bumper gap over the ego's own speed; inf at standstill."""
    return bumper_gap(me, other) / me.along if me.along > 0.0 else math.inf


@kernel
def lateral_gap(me: Any, other: Any) -> float:
    """Edge to edge across the road, m; negative when the bodies share a strip of road."""
    return float(abs(other.y - me.y) - me.half_width - other.half_width)


@kernel
def within_headway(me: Any, other: Any, limit: float) -> bool:
    """Whether the time headway is at most `limit` s; one that is so by construction counts, whatever the rounding."""
    return time_headway(me, other) <= limit + HEADWAY_ROUNDING


MOTION = [*fields("last_speed", "last_y")]
"""What is remembered of a vehicle from one step to the next; nan before it was seen."""
BRAKES = [*fields("level", "alarmed"), *flags("is_alarmed")]
"""Brakes that follow a demand: how hard they brake, m/s2, and since when there is one, s."""


@kernel
def deceleration(motion: Any, other: Any, step: float) -> float:
    """Mean deceleration of a vehicle over the last step, m/s2, 0 at first sight. Call once a step and vehicle."""
    last = other.along if math.isnan(motion.last_speed) else motion.last_speed
    motion.last_speed = other.along
    return float((last - other.along) / step)


@kernel
def lateral_closing_speed(motion: Any, me: Any, other: Any, step: float) -> float:
    """Mean speed over the last step at which the other came nearer across the road, m/s; negative: away.

    It comes from positions, as a body may move across without turning. Call once a step and vehicle.
    """
    last = motion.last_y
    motion.last_y = other.y
    relative = (other.across if math.isnan(last) else (other.y - last) / step) - me.across
    return float(-relative if other.y > me.y else relative)


@kernel
def brake_towards(
    brakes: Any, demanded: float, time: float, reaction: float, strongest: float, jerk: float, step: float
) -> float:
    """Deceleration of the coming step, m/s2: `reaction` s after the first demand, rising at `jerk` m/s3, at most
    `strongest`. demanded: m/s2, 0 for none. Call once a step.

    The reaction is waited for once: who has been alarmed stays alert.
    """
    if demanded > 0.0 and brakes.is_alarmed == 0:
        brakes.is_alarmed, brakes.alarmed = 1, time
    if brakes.is_alarmed == 0 or time < brakes.alarmed + reaction - 0.5 * step:
        return 0.0
    brakes.level = min(brakes.level + jerk * step, demanded, strongest)
    return float(brakes.level)
