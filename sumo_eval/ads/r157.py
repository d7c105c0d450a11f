"""What the reference drivers of UN Regulation No. 157 share: brakes that build up, headways along and across."""

from __future__ import annotations

import math
from typing import Any

from sumo_eval.ads.braking import SAFETY_BRAKING
from sumo_eval.ads.perception import bumper_gap, carry_on, take
from sumo_eval.cosim.records import MOVER, fields
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
def brake_ramp_lost(since: float, level: float, build_up: float) -> float:
    """Speed that a `brake_ramp` has taken off `since` s after it began, m/s; 0 before."""
    if since <= 0.0:
        return 0.0
    if since < build_up:
        return 0.5 * level * since * since / build_up
    return level * (since - 0.5 * build_up)


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


@kernel
def closing_across(me: Any, other: Any) -> float:
    """Speed at which the other comes nearer across the road, m/s; negative: away."""
    relative = other.across - me.across
    return float(-relative if other.y > me.y else relative)


SIGHTING = [*fields("last_speed", "last_y", "across", "gain"), ("mover", MOVER)]
"""Another vehicle as the last two steps show it; nan before it was seen.

last_speed, last_y: of the last look. mover: with its braking, and the mean of its speed across the road over the last
step (across), which it had in the middle of it. gain: of that speed on the one in the middle of the step before, m/s2;
0 if the motion began or turned round in between.
"""
SAFETY_MEMORY = [("braking", SAFETY_BRAKING), ("me", MOVER), ("then", MOVER)]
"""What a driver with safety braking remembers; all 0 at the beginning. me: the ego as it is, with the driver's braking.
then: where the ego is foreseen to be at some instant."""


@kernel
def sight(sighting: Any, other: Any, step: float) -> None:
    """Take in what speed and position of one step to the next tell of a vehicle. Call once a step and vehicle.

    Speeds across the road come from positions, as a body may move across without turning.
    """
    mover = sighting.mover
    take(mover, other)
    if math.isnan(other.x):
        return
    last_speed = other.along if math.isnan(sighting.last_speed) else sighting.last_speed
    last_y, before = sighting.last_y, 0.0 if math.isnan(sighting.across) else sighting.across
    mover.braking = max((last_speed - other.along) / step, 0.0)
    sighting.last_speed, sighting.last_y, sighting.gain = other.along, other.y, 0.0
    if math.isnan(last_y):
        return
    across = (other.y - last_y) / step
    mover.across = sighting.across = across
    if across * before > 0.0:
        sighting.gain = (across - before) / step


@kernel
def foresee(then: Any, sighting: Any, time: float, step: float) -> None:
    """Write into `then` the vehicle `time` s from now, if it goes on as now, or before that."""
    take(then, sighting.mover)
    carry_on(then, time)
    if sighting.gain != 0.0 and not math.isnan(sighting.gain):
        middle = -0.5 * step
        then.across += sighting.gain * (min(time, middle) - middle)


@kernel
def sight_all(memory: Any, me: Any, others: Any, sightings: Any, step: float) -> None:
    """Take in the ego, with where its driver's braking is, and everybody else. memory: of `SAFETY_MEMORY`."""
    take(memory.me, me)
    memory.me.braking = memory.braking.path.level
    for j in range(len(others)):
        sight(sightings[j], others[j], step)


@kernel
def foresee_all(me: Any, then: Any, sightings: Any, later: Any, time: float, step: float) -> None:
    """Write into `then` and `later` the ego and everybody else `time` s from now, if all go on as now."""
    take(then, me)
    carry_on(then, time)
    for j in range(len(sightings)):
        foresee(later[j], sightings[j], time, step)
