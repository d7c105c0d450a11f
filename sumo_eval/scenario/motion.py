"""Closed forms of actors' moves: across the road, and braking, of one vehicle at one instant.

The arguments `move` (across the road) and `brake` are acts (`scenario.played.Act`), or records with
the same fields. The `duration` of a move is above 0, the `begin` of a brake finite.

The order of operations decides the last bit of recorded values, which tests compare.

Users: `ads/lane_change.py`, `method/conflict.py`, `scenario/concrete.py`, `scenario/played.py`.
"""

from math import copysign, cos, floor, pi, sin, sqrt
from typing import Any

from sumo_eval.kernels import kernel

# Kinds of lateral moves. Fixed: fingerprints hold these numbers, and `scenario.played` takes the
# smallest numbers for lateral moves.
SMOOTH = 0  # by `quintic`
CONSTANT = 1  # at constant speed, after a rise
SINUS = 2  # by `swing`, to a side and back
COSINE = 3  # by half a swing, to a side

Motion = tuple[float, float, float]
"""A distance, m, and its first and second derivatives by time, m/s and m/s2."""


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
def swing(move: Any, time: float) -> Motion:
    """Offset, m, speed, m/s, and acceleration, m/s2, of swings at a time. Each goes to one side and
    back: the first to the side of `offset`, the next to the other side, and so on.

    A swing is A (1 - cos wt) / 2 with A = `offset`. Its largest acceleration A w^2 / 2 is the
    move's `acceleration`, which gives w. The move begins at rest. `duration` must be a whole number
    of swings of 2 pi / w, as readers of scenarios demand: after it, all three values are 0.
    """
    since = time - move.begin
    if not 0.0 < since < move.duration:
        return 0.0, 0.0, 0.0
    rate = sqrt(2.0 * move.acceleration / abs(move.offset))
    phase = rate * since
    complete = floor(phase / (2.0 * pi))  # number of swings that are over
    to_first_side = complete == 2.0 * floor(0.5 * complete)  # if that number is even
    half = 0.5 * (move.offset if to_first_side else -move.offset)
    c = cos(phase)
    return half * (1.0 - c), half * rate * sin(phase), half * rate * rate * c


@kernel
def lateral_motion(move: Any, time: float) -> Motion:
    """Offset, m, speed, m/s, and acceleration, m/s2, of a lateral move at a time, all to the left.

    At an instant at which the speed jumps, the value after the jump counts.
    """
    if move.kind == CONSTANT:
        return _at_constant_speed(move, time - move.begin)
    if move.kind == SINUS:
        return swing(move, time)
    since, rate = time - move.begin, move.offset / move.duration
    s = min(max(since / move.duration, 0.0), 1.0)  # share of the duration that is over
    if move.kind != COSINE:
        bend = move.offset / (move.duration * move.duration)
        return move.offset * quintic(s), rate * quintic_rate(s), bend * quintic_bend(s)

    # A (1 - cos(pi s)) / 2. The angles `pi * s` and `w * since` are the same, but rounded in two
    # ways: recorded digits depend on which of them is used where.
    half, w = 0.5 * move.offset, pi / move.duration
    offset = half * (1.0 - cos(pi * s))
    if not 0.0 <= since < move.duration:
        # rounded, sin(pi) > 0: this lateral speed would turn a standing vehicle by 90 degrees
        return offset, 0.0, 0.0
    speed = 0.5 * pi * move.offset / move.duration * sin(pi * s)
    return offset, speed, half * w * w * cos(w * since)


@kernel
def _at_constant_speed(move: Any, since: float) -> Motion:
    """`lateral_motion` of a move at constant speed, `since` s after it began.

    The speed builds up linearly and ends at once. `concrete.constant_lateral` computes the duration
    in which the move covers `offset`.
    """
    rise, t = move.speed / move.acceleration, max(since, 0.0)  # s until the full speed; s so far
    going = 0.0 <= since < move.duration
    if t < rise:
        covered = 0.5 * move.speed * t * t / rise
        speed, acceleration = move.speed * t / rise, move.acceleration
    else:
        covered = (t - 0.5 * rise) * move.speed
        speed = move.speed
        acceleration = 0.0
    return (
        copysign(min(covered, abs(move.offset)), move.offset),
        copysign(speed, move.offset) if going else 0.0,
        # not by copysign alone, which makes 0 negative
        copysign(acceleration, move.offset) if going and t < rise else 0.0,
    )


@kernel
def time_to_stand(brake: Any, speed: float) -> float:
    """Time that braking from `speed` m/s to standstill takes, s."""
    rise = brake.acceleration / brake.jerk  # s until the full deceleration; 0 if the jerk is inf
    if speed >= brake.acceleration * rise / 2.0:
        return float(speed / brake.acceleration + rise / 2.0)
    return sqrt(2.0 * speed * rise / brake.acceleration)  # it stands before


@kernel
def braked(brake: Any, speed: float, time: float) -> tuple[float, float]:
    """Distance driven from time 0 to a time, m, and speed then, m/s, of a vehicle that drives at
    `speed` m/s until it brakes.
    """
    since = time - brake.begin
    rise = brake.acceleration / brake.jerk  # s until the full deceleration; 0 if the jerk is inf
    t = min(max(since, 0.0), time_to_stand(brake, speed))
    # s so far of rising and of full deceleration, and the share of the rise that is over
    rising, plateau = min(t, rise), max(t - rise, 0.0)
    share = rising / rise if rise > 0.0 else 0.0
    # distance that braking has cost so far, m
    lost = brake.acceleration * (
        rising * rising * share / 6.0 + rise * plateau / 2.0 + plateau * plateau / 2.0
    )
    # distance since the braking began, m; below 0 before that
    driven = speed * since if since < 0.0 else speed * t - lost
    slower = speed - brake.acceleration * (rising * share / 2.0 + plateau)
    return speed * brake.begin + driven, max(slower, 0.0)


@kernel
def along_heading(along: float, across: float, forward: float, sideways: float) -> float:
    """Acceleration along the heading of a vehicle that points where it moves, m/s2.

    along, across: its speeds along a line and to the left of it, m/s.
    forward, sideways: its accelerations in these directions, m/s2.
    """
    if across == 0.0:
        return forward
    return (along * forward + across * sideways) / sqrt(along * along + across * across)
