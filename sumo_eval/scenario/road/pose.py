"""Places on the map, and places seen from other places, for readers of roads.

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
        """The place `ahead` m ahead, `left` m to the left, and turned by `turned`, rad."""
        c = math.cos(self.heading)
        s = math.sin(self.heading)
        return Pose(
            self.x + ahead * c - left * s, self.y + ahead * s + left * c, self.heading + turned
        )

    def along(self, line: Sequence[Piece], s: float, t: float = 0.0) -> Pose:
        """The place s m along a line that begins here, and t m to the left of it."""
        if not bends(line):
            return self.moved(s, t)
        # x, y, heading on the map of a line that begins at the origin: ahead, left, turned here
        return self.moved(*(float(it) for it in map_places(tuple(line), s, t)))

    def backward(self, line: Line) -> tuple[Pose, Line]:
        """Pose at the end of a line that begins here, turned round, and the line driven from there.

        Driven backwards, a curve to the left is one to the right.
        """
        pieces = tuple(Piece(it.length, -it.end, -it.begin) for it in reversed(line))
        return self.along(line, length_of(line)).moved(0.0, 0.0, math.pi), pieces

    def off(self, other: Pose) -> tuple[float, float]:
        """Distance to another place, m, and angle between both headings, rad."""
        turned = math.remainder(self.heading - other.heading, math.tau)
        return math.dist(self[:2], other[:2]), abs(turned)

    def seen_from(self, origin: Pose) -> Pose:
        """The place in the axes of another, `origin`: x ahead of that, y to its left."""
        dx, dy = self.x - origin.x, self.y - origin.y
        c = math.cos(origin.heading)
        s = math.sin(origin.heading)
        turned = math.remainder(self.heading - origin.heading, math.tau)
        return Pose(dx * c + dy * s, dy * c - dx * s, turned)


def onto_the_line(points: ArrayLike, begins: Pose) -> FloatArray:
    """Places (n, 2) of the map in the frame of a line's beginning: it is the origin, its heading
    the x axis.
    """
    x, y, heading = begins
    east, north = np.asarray(points, float).T - [[x], [y]]
    cos = np.cos(heading)
    sin = np.sin(heading)
    return np.column_stack([east * cos + north * sin, north * cos - east * sin])
