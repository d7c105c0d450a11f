"""Contact between vehicle bodies: oriented boxes, the first instant of touching within a step,
where and how fast.

SUMO's own collision check sees lanes, not bodies, so the harness decides. Between two samples every
pose moves linearly. Conservative advancement finds the first touch without skipping a graze:

1. Find the axis along which the gap between the bodies is widest.
2. No two points of them close along it faster than `closing`.
3. So they do not touch before gap / closing: go there, and begin again.

Users: the loop, in every step; `ads/foresight.py`, for contact before a case begins; the gym's
episodes, for the velocities of both bodies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sumo_eval.kernels import kernel
from sumo_eval.trajectory import Collision, Side

TOUCH = 1e-6  # m, bodies closer than this touch
FULL_TURN = 2.0 * math.pi  # rad
# m by which bodies grow on every side, so that the corner that touches is inside the other
_GROWN = 1e-3


class Body(NamedTuple):
    """A vehicle body's pose and motion at an instant: centre (x, y) m, heading rad, speed m/s along
    the heading.

    across: m/s, to the left of the heading, of a body that slides.
    """

    x: float
    y: float
    heading: float
    speed: float
    length: float
    width: float
    across: float = 0.0

    @property
    def velocity(self) -> tuple[float, float]:
        """(vx, vy), m/s."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return self.speed * c - self.across * s, self.speed * s + self.across * c

    def corners(self) -> tuple[tuple[float, float], ...]:
        """The four corners, m."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        half_length, half_width = 0.5 * self.length, 0.5 * self.width
        return tuple(
            (
                self.x + i * half_length * c - j * half_width * s,
                self.y + i * half_length * s + j * half_width * c,
            )
            for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))  # 1: front, left; -1: rear, right
        )


@kernel
def within_a_turn(angle: float) -> float:
    """An angle's direction as one within -pi..pi, rad."""
    if -math.pi <= angle <= math.pi:
        return angle
    return angle - FULL_TURN * math.floor(angle / FULL_TURN + 0.5)


@kernel
def radius(body: Body) -> float:
    """Distance from a body's centre to a corner, m."""
    return 0.5 * math.sqrt(body.length * body.length + body.width * body.width)


@kernel
def widest_gap(a: Body, b: Body) -> tuple[float, float, float]:
    """(gap m, axis x, axis y): the axis of either box along which they are furthest apart, pointing
    from a to b.

    The gap is at most the distance of the boxes; negative: they overlap by as much.
    """
    dx, dy = b.x - a.x, b.y - a.y
    ca, sa = math.cos(a.heading), math.sin(a.heading)
    cb, sb = math.cos(b.heading), math.sin(b.heading)
    cos_between, sin_between = abs(ca * cb + sa * sb), abs(ca * sb - sa * cb)
    la, wa = 0.5 * a.length, 0.5 * a.width
    lb, wb = 0.5 * b.length, 0.5 * b.width
    # from a's centre to b's, along and across each body
    along_a, across_a = dx * ca + dy * sa, dy * ca - dx * sa
    along_b, across_b = dx * cb + dy * sb, dy * cb - dx * sb
    # half the extents of b along a's length and along a's width; then of a along b's
    reach_b, span_b = lb * cos_between + wb * sin_between, lb * sin_between + wb * cos_between
    reach_a, span_a = la * cos_between + wa * sin_between, la * sin_between + wa * cos_between
    gap, offset = abs(along_a) - la - reach_b, along_a
    x, y = ca, sa
    candidate = abs(across_a) - wa - span_b
    if candidate > gap:
        gap, offset = candidate, across_a
        x, y = -sa, ca
    candidate = abs(along_b) - lb - reach_a
    if candidate > gap:
        gap, offset = candidate, along_b
        x, y = cb, sb
    candidate = abs(across_b) - wb - span_a
    if candidate > gap:
        gap, offset = candidate, across_b
        x, y = -sb, cb
    # from a to b
    return (gap, x, y) if offset >= 0.0 else (gap, -x, -y)


@kernel
def between(before: Body, after: Body, share: float) -> Body:
    """The body when a share of the time from one sample to the next has passed."""
    turn = within_a_turn(after.heading - before.heading)
    return Body(
        before.x + share * (after.x - before.x),
        before.y + share * (after.y - before.y),
        before.heading + share * turn,
        before.speed + share * (after.speed - before.speed),
        after.length,
        after.width,
        before.across + share * (after.across - before.across),
    )


@kernel
def share_at_touch(a_before: Body, a_after: Body, b_before: Body, b_after: Body) -> float:
    """Share of the step at which the bodies first touch; -1 when they do not."""
    shift_x = (b_after.x - b_before.x) - (a_after.x - a_before.x)
    shift_y = (b_after.y - b_before.y) - (a_after.y - a_before.y)
    # a box in any direction stays within (length + width) / 2 of its centre
    reach = (
        0.5 * (a_after.length + a_after.width + b_after.length + b_after.width)
        + abs(shift_x)
        + abs(shift_y)
    )
    if abs(b_before.x - a_before.x) > reach or abs(b_before.y - a_before.y) > reach:
        return -1.0
    # m that a corner moves at most by turning, of both bodies
    turning = abs(within_a_turn(a_after.heading - a_before.heading)) * radius(a_after)
    turning += abs(within_a_turn(b_after.heading - b_before.heading)) * radius(b_after)
    share = 0.0
    gap, x, y = widest_gap(a_before, b_before)
    while gap > TOUCH:
        # m, most that the gap closes in the whole step: (x, y) points from a to b, so b's shift
        # along it opens the gap
        closing = turning - (shift_x * x + shift_y * y)
        if gap > closing * (1.0 - share):
            return -1.0
        share += gap / closing
        gap, x, y = widest_gap(between(a_before, a_after, share), between(b_before, b_after, share))
    return min(share, 1.0)  # the last advance may round past the step's end


@kernel
def keeps_apart(ego: Body, other: Body) -> bool:
    """Whether two bodies that continue straight along the road at their speeds surely never touch.

    False: they touch, or it is not sure.

    ego: its heading counts as 0.
    """
    if other.heading != 0.0 or other.across != 0.0:
        return False
    ahead = other.x - ego.x
    touching = 0.5 * ego.length + 0.5 * other.length
    if abs(other.y - ego.y) >= 0.5 * ego.width + 0.5 * other.width:
        return True
    return (ahead >= touching and other.speed >= ego.speed) or (
        -ahead >= touching and other.speed <= ego.speed
    )


def describe(time: float, name: str, ego: Body, other: Body) -> Collision:
    """The collision at the instant of touching."""
    return Collision(
        time=time,
        other=name,
        ego_velocity=ego.velocity,
        other_velocity=other.velocity,
        overlap=bumper_overlap(ego, other),
        side=struck_side(ego, other),
        ego_pose=(ego.x, ego.y, ego.heading),
        other_pose=(other.x, other.y, other.heading),
    )


def _in_frame_of(body: Body, point: tuple[float, float]) -> tuple[float, float]:
    """A point as (ahead, left) of a body's centre, m."""
    dx, dy = point[0] - body.x, point[1] - body.y
    c, s = math.cos(body.heading), math.sin(body.heading)
    return dx * c + dy * s, dy * c - dx * s


def bumper_overlap(ego: Body, other: Body) -> float:
    """Share of the ego's width that the other body covers, seen along the ego's heading, 0..1."""
    across = [_in_frame_of(ego, corner)[1] for corner in other.corners()]
    half = 0.5 * ego.width
    left, right = min(max(across), half), max(min(across), -half)
    return min(max((left - right) / ego.width, 0.0), 1.0)


def struck_side(ego: Body, other: Body) -> Side:
    """Face of the ego that is touched; at a corner, the one into which the other moves faster."""
    corners = [corner for corner in other.corners() if _inside(ego, corner)]
    corners += [corner for corner in ego.corners() if _inside(other, corner)]
    # no corner is inside where bodies cross like a plus: the other's centre decides
    points = [_in_frame_of(ego, corner) for corner in corners or [(other.x, other.y)]]
    ahead = sum(point[0] for point in points) / len(points)
    left = sum(point[1] for point in points) / len(points)
    depths: dict[Side, float] = {
        "front": 0.5 * ego.length - ahead,
        "rear": 0.5 * ego.length + ahead,
        "left": 0.5 * ego.width - left,
        "right": 0.5 * ego.width + left,
    }
    nearest = min(depths.values())
    # at a corner of the ego two faces are touched: their depths differ by as much as both bodies
    # have grown, at most
    candidates = [side for side, depth in depths.items() if depth <= nearest + 2.0 * _GROWN]
    closing = (other.velocity[0] - ego.velocity[0], other.velocity[1] - ego.velocity[1])
    c, s = math.cos(ego.heading), math.sin(ego.heading)
    forward, leftward = closing[0] * c + closing[1] * s, closing[1] * c - closing[0] * s
    # m/s, at which the other body moves into each face
    inward: dict[Side, float] = {
        "front": -forward,
        "rear": forward,
        "left": -leftward,
        "right": leftward,
    }
    return max(candidates, key=lambda side: inward[side])


def _inside(body: Body, point: tuple[float, float]) -> bool:
    """Whether a point lies in a body that has grown by `_GROWN`."""
    ahead, left = _in_frame_of(body, point)
    return abs(ahead) <= 0.5 * body.length + _GROWN and abs(left) <= 0.5 * body.width + _GROWN
