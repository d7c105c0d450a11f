"""Poses on the map: places with a heading, moved, followed along a line, and seen from each other.

Users: `cosim/`, `scenario/`, `extras/openscenario/`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.scenario.road.reference_line import Line, Piece, bends, length_of, map_places
from sumo_eval.trajectory import FloatArray


class Pose(NamedTuple):
    """A place on the map, m, and where it points, rad."""

    x: float
    y: float
    heading: float

    def moved(self, ahead: float, left: float = 0.0, turned: float = 0.0) -> Pose:
        """The pose `ahead` m ahead of this one and `left` m to the left, turned by `turned` rad."""
        c = math.cos(self.heading)
        s = math.sin(self.heading)
        return Pose(
            self.x + ahead * c - left * s, self.y + ahead * s + left * c, self.heading + turned
        )

    def along(self, line: Sequence[Piece], s: float, t: float = 0.0) -> Pose:
        """The pose s m along a line that begins here, and t m to the left of the line."""
        if not bends(line):
            return self.moved(s, t)
        # seen from the line's beginning, x, y and heading on the line's map are ahead, left, turned
        return self.moved(*(float(it) for it in map_places(tuple(line), s, t)))

    def backward(self, line: Line) -> tuple[Pose, Line]:
        """A line that begins here, driven from its end: the pose there, turned round, and the line.

        Driven backwards, a curve to the left is a curve to the right.
        """
        pieces = tuple(Piece(it.length, -it.end, -it.begin) for it in reversed(line))
        return self.along(line, length_of(line)).moved(0.0, 0.0, math.pi), pieces

    def off(self, other: Pose) -> tuple[float, float]:
        """Distance to another pose, m, and angle between both headings, at least 0, rad."""
        turned = math.remainder(self.heading - other.heading, math.tau)
        return math.dist(self[:2], other[:2]), abs(turned)

    def seen_from(self, origin: Pose) -> Pose:
        """The pose in the axes of another, `origin`: x ahead of the origin, y to its left."""
        dx, dy = self.x - origin.x, self.y - origin.y
        c = math.cos(origin.heading)
        s = math.sin(origin.heading)
        turned = math.remainder(self.heading - origin.heading, math.tau)
        return Pose(dx * c + dy * s, dy * c - dx * s, turned)


def onto_the_line(points: ArrayLike, begins: Pose) -> FloatArray:
    """Places (n, 2) of the map in axes whose origin is a line's beginning and whose x axis is the
    heading there.
    """
    x, y, heading = begins
    east, north = np.asarray(points, float).T - [[x], [y]]
    cos = np.cos(heading)
    sin = np.sin(heading)
    return np.column_stack([east * cos + north * sin, north * cos - east * sin])
