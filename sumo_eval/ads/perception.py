"""Perception of rules: gaps, overlaps, which vehicle is ahead, which one is hidden.

The baselines of `ads/` and the synthetic drivers use it. All is along and across the road.

`me` and `other` are `MOVER` records of `cosim.records` (x, y: body centre, m; along, across: speeds
along and across the road, m/s; half_length, half_width: half the extents of the turned body along
and across the road, m). `others` is an array of them. A vehicle that is not seen has nan as its x.
Comparisons with nan are false: conditions here are written so that such a vehicle is never ahead,
behind or hiding another vehicle (`not a > b` differs from `a <= b`).

Users: `ads/`, `drivers/synthetic/driver.py`.
"""

from math import isnan
from typing import Any

from sumo_eval.kernels import kernel

LEAST_GAP = 2.0  # m between two vehicles at rest: the least following distance of UN R157
COURTESY = 1.0  # s between the ego and a road user crossing its path; if less, the ego yields
CROSSES = 0.1  # m/s towards the path; a slower road user does not count as crossing


@kernel
def bumper_gap(me: Any, other: Any) -> float:
    """Free road from the front of `me` to the rear of `other`, m; negative if they are side by
    side, or `other` is behind.
    """
    return float(other.x - me.x - other.half_length - me.half_length)


@kernel
def lateral_overlap(me: Any, other: Any) -> float:
    """Width of the strip along the road that both bodies share, m; negative: the free space between
    them across the road.
    """
    half, other_half = me.half_width, other.half_width
    # at most the width of either body
    return float(min(half + other_half - abs(me.y - other.y), 2.0 * half, 2.0 * other_half))


@kernel
def lead_in_path(me: Any, others: Any) -> int:
    """Index of the lead; -1: none.

    The lead is the nearest vehicle in front whose body reaches into the strip of road that the
    ego's body sweeps straight ahead. It hides any vehicle beyond it in the strip.
    """
    nearest = -1
    for j in range(len(others)):
        other = others[j]
        if (
            other.x > me.x
            and (nearest < 0 or other.x < others[nearest].x)
            and lateral_overlap(me, other) > 0.0
        ):
            nearest = j
    return nearest


@kernel
def coming_into_path(me: Any, others: Any) -> int:
    """Index of the nearest road user ahead that comes into the ego's path from the side, -1: none.

    The path is the strip of road that the ego's body sweeps straight ahead. The road user comes
    into it if, at the present speeds, it is in the strip while the ego passes, or less than
    `COURTESY` before or after that. A road user that a nearer vehicle hides to more than half is
    not seen.
    """
    nearest = -1
    for j in range(len(others)):
        other = others[j]
        # `not >` also skips nan
        if not other.x > me.x or (nearest >= 0 and other.x >= others[nearest].x):
            continue
        apart, reach = other.y - me.y, me.half_width + other.half_width
        towards = -other.across if apart > 0.0 else other.across  # speed towards the path, m/s
        closing, gap = me.along - other.along, bumper_gap(me, other)
        if abs(apart) < reach or towards < CROSSES or closing <= 0.0 or gap < 0.0:
            continue
        # s until the road user enters the strip, and has left it
        enters, leaves = (abs(apart) - reach) / towards, (abs(apart) + reach) / towards
        # s until the ego comes level with the road user, and has passed it
        level, passed = gap / closing, (gap + 2.0 * (me.half_length + other.half_length)) / closing
        if (
            enters < passed + COURTESY
            and level < leaves + COURTESY
            and is_in_sight(me, others, j, 0.5)
        ):
            nearest = j
    return nearest


@kernel
def next_ahead(me: Any, others: Any, last: int) -> int:
    """Index of the vehicle that comes next in front of the ego; -1: none.

    last: index of the one before it; -1: ask for the first. Of vehicles at one x, the one with the
        lower index comes first.
    """
    nearest = -1
    for j in range(len(others)):
        x = others[j].x
        if not x > me.x:
            continue
        if last >= 0 and (x < others[last].x or (x == others[last].x and j <= last)):
            continue
        if nearest < 0 or x < others[nearest].x:
            nearest = j
    return nearest


@kernel
def neighbours(me: Any, others: Any, centre: float, width: float) -> tuple[int, int]:
    """Indexes of the nearest vehicles ahead and behind, -1: none, whose body reaches into the strip
    `width` m wide around y = `centre`, m. A vehicle alongside the ego is both.
    """
    ahead = behind = -1
    for j in range(len(others)):
        other = others[j]
        if not abs(other.y - centre) < 0.5 * width + other.half_width:
            continue
        beside = abs(other.x - me.x) < other.half_length + me.half_length
        if (other.x > me.x or beside) and (ahead < 0 or other.x < others[ahead].x):
            ahead = j
        if (other.x <= me.x or beside) and (behind < 0 or other.x > others[behind].x):
            behind = j
    return ahead, behind


@kernel
def safe_gap(speed: float, lead_speed: float, deceleration: float, response: float) -> float:
    """Gap from which two vehicles that brake equally hard come to rest `LEAST_GAP` apart, m.

    d = max(0, v rho + (v^2 - w^2) / (2 b)) + 2 m: the longitudinal distance of
    Responsibility-Sensitive Safety for an ego that does not speed up in its response time
    (Shalev-Shwartz et al. 2017, Definition 1).

    speed: v, m/s.
    lead_speed: w, m/s; below 0: the lead is oncoming, and its stopping distance adds to the gap.
    deceleration: b, m/s2.
    response: rho, s.
    """
    squares = speed * speed - lead_speed * abs(lead_speed)
    return max(speed * response + squares / (2.0 * deceleration), 0.0) + LEAST_GAP


@kernel
def is_visible(me: Any, others: Any, index: int, hiding_share: float, aside: bool = False) -> bool:
    """Whether a vehicle is seen: no single nearer vehicle covers more than `hiding_share` of its
    width.

    Lines of sight run along the road: a vehicle hides what lies straight behind it. With a share of
    0 a vehicle is seen once nothing covers any of it (a sensor that needs the whole contour), with
    0.5 once half of it shows.

    index: of the vehicle among `others`.
    aside: lines of sight meet in the ego's centre instead.
    """
    other = others[index]
    if isnan(other.x):
        return False
    eye_y, share = 0.0, 1.0  # of lines along the road, any y will do
    for j in range(len(others)):
        nearer = others[j]
        if me.x < nearer.x < other.x:
            if aside:
                eye_y, share = me.y, (nearer.x - me.x) / (other.x - me.x)
            if covers(nearer, eye_y, other, share, hiding_share):
                return False
    return True


@kernel
def is_in_sight(me: Any, others: Any, index: int, hiding_share: float) -> bool:
    """Whether a vehicle is seen from the ego: `is_visible` by lines of sight along the road for a
    vehicle in the strip that the ego's body sweeps, by lines that meet in the ego for any other.

    So parked cars at the side hide what stands between them.
    """
    other = others[index]
    aside = other.x > me.x and lateral_overlap(me, other) <= 0.0
    return is_visible(me, others, index, hiding_share, aside)


@kernel
def covers(nearer: Any, eye_y: float, other: Any, share: float, hiding: float) -> bool:
    """Whether a nearer vehicle covers more than the share `hiding` of another's width, seen from an
    eye.

    nearer, other: with `y` and `half_width`, half the extent across the road, m.
    eye_y: of the eye, m.
    share: where the nearer vehicle is on the way from the eye to the other vehicle, 0..1. Lines of
        sight meet in the eye, so the other's width appears scaled by this share there. 1: lines of
        sight are parallel.
    """
    half = other.half_width * share  # of the other, as it appears where the nearer one is, m
    # from the line of sight to the nearer vehicle's middle, m
    apart = abs(nearer.y - eye_y - share * (other.y - eye_y))
    covered = min(nearer.half_width + half - apart, 2.0 * nearer.half_width, 2.0 * half)
    return bool(covered > 2.0 * half * hiding)


@kernel
def take(to: Any, other: Any) -> None:
    """Copy a vehicle's state from `other` into the record `to`."""
    to.x, to.y, to.heading = other.x, other.y, other.heading
    to.along, to.across, to.speed = other.along, other.across, other.speed
    to.half_length, to.half_width = other.half_length, other.half_width
    to.braking, to.curvature = other.braking, other.curvature


@kernel
def carry_on(mover: Any, time: float) -> None:
    """Move a vehicle to where it is `time` s later; a negative time: earlier.

    It keeps its velocity, or, with `braking` above 0, brakes along the road until `along` is 0.
    Until then it also moves across the road, and after that it stands; `across` is not changed.
    """
    if mover.braking <= 0.0:
        mover.x, mover.y = mover.x + mover.along * time, mover.y + mover.across * time
        return
    rolling = min(time, max(mover.along, 0.0) / mover.braking)  # s until it stands, at most `time`
    mover.x += rolling * (mover.along - 0.5 * mover.braking * rolling)
    mover.y += mover.across * rolling
    mover.along -= mover.braking * rolling
