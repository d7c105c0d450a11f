"""Bodies of vehicles as oriented boxes: their gap, and the first instant of touching within a step.

Within a step every pose is taken to move linearly. Conservative advancement finds the first touch,
even one that ends within the step:

1. Find the axis along which the gap between the bodies is widest.
2. Along this axis, no two points of the bodies approach faster than `closing`.
3. So the bodies do not touch before gap / closing: go to that time, and begin again.

Users: `cosim/`, in every step of the loop; `ads/foresight.py`, for contact before a case begins;
`method/conflict.py`, for contact on conflicting paths; `scenario/`; `extras/gym/episodes.py`.
"""

from math import cos, floor, pi, sin, sqrt
from typing import Any, NamedTuple

from sumo_eval.kernels import kernel

TOUCH = 1e-6  # m, bodies closer than this touch
FULL_TURN = 2.0 * pi  # rad


class Body(NamedTuple):
    """A vehicle body's pose and motion at an instant.

    x, y: centre, m. heading: rad. length, width: m.
    speed: along the heading, m/s. across: to the left of the heading, of a body that slides, m/s.
    """

    x: float
    y: float
    heading: float
    speed: float
    length: float
    width: float
    across: float = 0.0

    def moved(self, distance: float) -> "Body":
        """The body `distance` m further in its heading."""
        return self._replace(
            x=self.x + distance * cos(self.heading), y=self.y + distance * sin(self.heading)
        )

    def corners(self) -> tuple[tuple[float, float], ...]:
        """The four corners, m."""
        c = cos(self.heading)
        s = sin(self.heading)
        half_length, half_width = 0.5 * self.length, 0.5 * self.width
        return tuple(
            (
                self.x + i * half_length * c - j * half_width * s,
                self.y + i * half_length * s + j * half_width * c,
            )
            # i: 1 front, -1 rear; j: 1 left, -1 right
            for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))
        )


@kernel
def body_of(at: Any, moving: Any, body: Any) -> Body:
    """The `Body` of a vehicle, of parts of its record in `cosim.records`.

    at: record with its pose, on the map or along and across the road, now or before the step.
    moving: record with its speeds at that time.
    body: record with its size.
    """
    return Body(at.x, at.y, at.heading, moving.speed, body.length, body.width, moving.across)


@kernel
def velocity(body: Any) -> tuple[float, float]:
    """(vx, vy) of a `Body` or of a record with its fields, m/s."""
    c, s = cos(body.heading), sin(body.heading)
    return body.speed * c - body.across * s, body.speed * s + body.across * c


@kernel
def within_a_turn(angle: float) -> float:
    """An angle without whole turns: the same direction within -pi..pi, rad."""
    if not (angle < -pi or angle > pi):  # true of nan as well, of which there is no `floor`
        return angle
    return angle - FULL_TURN * floor(angle / FULL_TURN + 0.5)


@kernel
def radius(body: Body) -> float:
    """Distance from a body's centre to a corner, m."""
    return 0.5 * sqrt(body.length * body.length + body.width * body.width)


@kernel
def widest_gap(a: Body, b: Body) -> tuple[float, float, float]:
    """Gap along the axis along which the boxes are furthest apart, m, and that axis as a unit
    vector x, y, pointing from a to b.

    The axis is the length or the width of either box (separating axis theorem). The gap is at most
    the distance of the boxes. A negative gap is the depth of their overlap.
    """
    dx, dy = b.x - a.x, b.y - a.y
    ca, sa = cos(a.heading), sin(a.heading)
    cb, sb = cos(b.heading), sin(b.heading)
    cos_between, sin_between = abs(ca * cb + sa * sb), abs(ca * sb - sa * cb)
    la, wa = 0.5 * a.length, 0.5 * a.width
    lb, wb = 0.5 * b.length, 0.5 * b.width
    # vector from a's centre to b's, along and across each body
    along_a, across_a = dx * ca + dy * sa, dy * ca - dx * sa
    along_b, across_b = dx * cb + dy * sb, dy * cb - dx * sb
    # half the extents of each body by the axes of the other: along the other's length, and across
    b_along, b_across = lb * cos_between + wb * sin_between, lb * sin_between + wb * cos_between
    a_along, a_across = la * cos_between + wa * sin_between, la * sin_between + wa * cos_between
    # widest gap so far, b's centre along its axis, and the axis: the four axes one after another
    gap, offset = abs(along_a) - la - b_along, along_a
    x, y = ca, sa
    candidate = abs(across_a) - wa - b_across
    if candidate > gap:
        gap, offset = candidate, across_a
        x, y = -sa, ca
    candidate = abs(along_b) - lb - a_along
    if candidate > gap:
        gap, offset = candidate, along_b
        x, y = cb, sb
    candidate = abs(across_b) - wb - a_across
    if candidate > gap:
        gap, offset = candidate, across_b
        x, y = -sb, cb
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
    """Share of the step at which two bodies first touch: 0 if they do at its start, -1 if they do
    not at all.

    before, after: the bodies at the start and at the end of the step.
    """
    # motion of b relative to a, m
    shift_x = (b_after.x - b_before.x) - (a_after.x - a_before.x)
    shift_y = (b_after.y - b_before.y) - (a_after.y - a_before.y)
    # m between the centres at the start, along x or y, beyond which the bodies cannot touch in this
    # step: a box in any direction stays within (length + width) / 2 of its centre
    reach = (
        0.5 * (a_after.length + a_after.width + b_after.length + b_after.width)
        + abs(shift_x)
        + abs(shift_y)
    )
    if abs(b_before.x - a_before.x) > reach or abs(b_before.y - a_before.y) > reach:
        return -1.0
    # most that a corner of each body moves by turning, added up, m
    turning = abs(within_a_turn(a_after.heading - a_before.heading)) * radius(a_after)
    turning += abs(within_a_turn(b_after.heading - b_before.heading)) * radius(b_after)
    share = 0.0
    gap, x, y = widest_gap(a_before, b_before)
    while gap > TOUCH:
        # most that the gap closes in the whole step, m; a shift of b along (x, y) opens the gap,
        # because this axis points from a to b
        closing = turning - (shift_x * x + shift_y * y)
        if gap > closing * (1.0 - share):
            return -1.0
        share += gap / closing
        gap, x, y = widest_gap(between(a_before, a_after, share), between(b_before, b_after, share))
    return min(share, 1.0)  # the last advance may round past the step's end


@kernel
def keeps_apart(ego: Body, other: Body) -> bool:
    """Whether two bodies certainly never touch if they continue straight along the road at their
    speeds. False also where the other body does not move straight along the road.

    ego: its heading counts as 0.
    """
    if other.heading != 0.0 or other.across != 0.0:
        return False
    if abs(other.y - ego.y) >= 0.5 * ego.width + 0.5 * other.width:
        return True
    ahead = other.x - ego.x
    touching = 0.5 * ego.length + 0.5 * other.length
    return (ahead >= touching and other.speed >= ego.speed) or (
        -ahead >= touching and other.speed <= ego.speed
    )
