"""Plain slow twin of `sumo_eval.cosim.contact`: polygons that overlap, looked for at many instants
of a step."""

import math


def pose(before, after, share):
    """The body a share of the way from one sample to the next, turning the shorter way round."""
    turn = (after.heading - before.heading + math.pi) % math.tau - math.pi
    return before._replace(
        x=before.x + share * (after.x - before.x),
        y=before.y + share * (after.y - before.y),
        heading=before.heading + share * turn,
    )


def corners(body, grow=0.0):
    """Corners as complex numbers, counter-clockwise, of a body grown by `grow` m on every side."""
    turn = complex(math.cos(body.heading), math.sin(body.heading))
    length, width = body.length / 2 + grow, body.width / 2 + grow
    return [
        complex(body.x, body.y) + turn * complex(i * length, j * width)
        for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]


def _left_of(point, start, end):
    return ((end - start).conjugate() * (point - start)).imag


def _inside(point, polygon):
    return all(_left_of(point, polygon[i - 1], polygon[i]) >= 0 for i in range(len(polygon)))


def _cross(a, b, c, d):
    return _left_of(a, c, d) * _left_of(b, c, d) < 0 and _left_of(c, a, b) * _left_of(d, a, b) < 0


def overlap(a, b, grow=0.0):
    """Whether two bodies overlap: a corner of one inside the other, or two edges that cross."""
    one, two = corners(a, grow), corners(b, grow)
    if any(_inside(point, two) for point in one) or any(_inside(point, one) for point in two):
        return True
    return any(_cross(one[i - 1], one[i], two[j - 1], two[j]) for i in range(4) for j in range(4))


def first_overlap(a_before, a_after, b_before, b_after, samples=200):
    """The first of many evenly spaced instants (share of the step) at which the bodies overlap."""
    for index in range(samples + 1):
        share = index / samples
        if overlap(pose(a_before, a_after, share), pose(b_before, b_after, share)):
            return share
    return None
