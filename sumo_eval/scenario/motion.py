"""Moves of other vehicles as functions of time: across the road and braking, for one vehicle at an
instant.

`move` and `brake` are acts (`scenario.played`), or records with their fields.
"""

from __future__ import annotations

import math
from typing import Any

from sumo_eval.kernels import kernel

SMOOTH, CONSTANT, SINUS, COSINE = 0, 1, 2, 3  # kinds of lateral moves


@kernel
def quintic(s: Any) -> Any:
    """10 s^3 - 15 s^4 + 6 s^5, from 0 to 1 over 0..1, at rest at both ends."""
    return s * s * s * (10.0 + s * (-15.0 + 6.0 * s))


@kernel
def quintic_rate(s: Any) -> Any:
    """Derivative of `quintic`: 30 s^2 (1 - s)^2."""
    return 30.0 * s * s * (1.0 - s) * (1.0 - s)


@kernel
def quintic_bend(s: Any) -> Any:
    """Second derivative of `quintic`: 60 s (1 - s) (1 - 2 s)."""
    return 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)


@kernel
def share_done(move: Any, time: float) -> float:
    """Share of a move's duration that has gone by, 0..1."""
    return float(min(max((time - move.begin) / move.duration, 0.0), 1.0))


@kernel
def build_up(move: Any) -> float:
    """Time in which the speed of a move at constant lateral speed builds up, s."""
    return float(move.speed / move.acceleration)


@kernel
def swing(move: Any, time: float) -> tuple[float, float, float]:
    """Offset m, speed m/s and acceleration m/s2 of a swing to one side and back, then to the other,
    A (1 - cos wt) / 2.

    A is `offset`, and A w^2 / 2 the largest acceleration, `acceleration`. It begins and ends at
    rest.
    """
    since = time - move.begin
    if not 0.0 < since < move.duration:
        return 0.0, 0.0, 0.0
    rate = math.sqrt(2.0 * move.acceleration / abs(move.offset))
    phase = rate * since
    turns = math.floor(phase / (2.0 * math.pi))
    half = 0.5 * (move.offset if turns == 2.0 * math.floor(0.5 * turns) else -move.offset)
    c = math.cos(phase)
    return half * (1.0 - c), half * rate * math.sin(phase), half * rate * rate * c


@kernel
def lateral(move: Any, time: float) -> float:
    """Offset already covered by a lateral move at a time, m."""
    if move.kind == CONSTANT:
        since, rise = max(time - move.begin, 0.0), build_up(move)
        covered = (
            0.5 * move.speed * since * since / rise
            if since < rise
            else (since - 0.5 * rise) * move.speed
        )
        return math.copysign(min(covered, abs(move.offset)), move.offset)
    if move.kind == SINUS:
        return swing(move, time)[0]
    if move.kind == COSINE:
        return float(0.5 * move.offset * (1.0 - math.cos(math.pi * share_done(move, time))))
    return float(move.offset * quintic(share_done(move, time)))


@kernel
def lateral_speed(move: Any, time: float) -> float:
    """Lateral speed of a move at a time, m/s; at the very instants at which it jumps, the speed
    after them.
    """
    if move.kind == CONSTANT:
        since, rise = time - move.begin, build_up(move)
        if not 0.0 <= since < move.duration:
            return 0.0
        return math.copysign(move.speed * since / rise if since < rise else move.speed, move.offset)
    if move.kind == SINUS:
        return swing(move, time)[1]
    if move.kind == COSINE:
        return float(
            0.5 * math.pi * move.offset / move.duration * math.sin(math.pi * share_done(move, time))
        )
    return float(move.offset / move.duration * quintic_rate(share_done(move, time)))


@kernel
def lateral_acceleration(move: Any, time: float) -> float:
    """Lateral acceleration of a move at a time, m/s2; jumps of the speed take no time."""
    if move.kind == CONSTANT:
        builds_up = 0.0 <= time - move.begin < min(build_up(move), move.duration)
        return math.copysign(move.acceleration, move.offset) if builds_up else 0.0
    if move.kind == SINUS:
        return swing(move, time)[2]
    if move.kind == COSINE:
        if not 0.0 <= time - move.begin < move.duration:
            return 0.0
        rate = math.pi / move.duration
        return float(0.5 * move.offset * rate * rate * math.cos(rate * (time - move.begin)))
    return float(
        move.offset / (move.duration * move.duration) * quintic_bend(share_done(move, time))
    )


@kernel
def time_to_stand(brake: Any, speed: float) -> float:
    """Time from the first touch of the brake to standstill, s, from `speed` m/s."""
    rise = brake.acceleration / brake.jerk
    if speed >= brake.acceleration * rise / 2.0:
        return float(speed / brake.acceleration + rise / 2.0)
    return math.sqrt(2.0 * speed * rise / brake.acceleration)


@kernel
def braked_speed_at(brake: Any, speed: float, time: float) -> float:
    """Speed at a time of a vehicle that began to brake at `speed`, m/s."""
    rise = brake.acceleration / brake.jerk
    t = min(max(time - brake.begin, 0.0), time_to_stand(brake, speed))
    rising = min(t, rise)
    share = rising / rise if rise > 0.0 else 0.0
    return float(max(speed - brake.acceleration * (rising * share / 2.0 + (t - rising)), 0.0))


@kernel
def braked_distance_at(brake: Any, speed: float, time: float) -> float:
    """Distance driven from time 0 until a time, at `speed` m/s until the brake, m."""
    since = time - brake.begin
    if since < 0.0:
        return float(speed * brake.begin + speed * since)
    rise = brake.acceleration / brake.jerk
    t = min(max(since, 0.0), time_to_stand(brake, speed))
    rising = min(t, rise)
    share = rising / rise if rise > 0.0 else 0.0
    plateau = max(t - rise, 0.0)
    lost = brake.acceleration * (
        rising * rising * share / 6.0 + rise * plateau / 2.0 + plateau * plateau / 2.0
    )
    return float(speed * brake.begin + (speed * t - lost))


@kernel
def along_heading(along: float, across: float, braking: float, sideways: float) -> float:
    """Rate of the ground speed of a vehicle that points where it goes, m/s2."""
    if across == 0.0:
        return braking
    return (along * braking + across * sideways) / math.sqrt(along * along + across * across)
