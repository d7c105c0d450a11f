"""Places of bodies on SUMO's lanes, of arrays with a value for each vehicle.

Users: `cosim/traffic.py`.
"""

from typing import Any, NamedTuple

import numpy as np

from sumo_eval.cosim.impossible import LOSS_MARGIN, farthest_in
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.road.reference_line import curvatures
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

# m between a front's position and the position from which SUMO's step leads to the next one: if it
# is more, the vehicle has turned within the step
_TURNED = 0.02


class Vehicles(NamedTuple):
    """Some vehicles of a world, by their numbers: records of all egos and actors, now or before."""

    egos: Any
    others: Any
    number: IntArray

    def field(self, name: str) -> FloatArray:
        """A field of these vehicles, in the order of `number`."""
        return np.column_stack([self.egos[name], self.others[name]]).ravel()[self.number]


def ground_of_lane(road: Road, x: Any, y: Any) -> Any:
    """Metres that a vehicle drives at the offset y for each metre of its lane: 1 - curvature y.

    A lane is as long in SUMO as the road's line.
    """
    return 1.0 - curvatures(road.line, x) * y


def exact_begins(begin: FloatArray, before: Vehicles, half: FloatArray) -> FloatArray:
    """Positions of the fronts along straight lanes at a step's start, m: exactly where they were,
    unless the vehicle turns within the step.

    begin: positions from which SUMO's step leads to the fronts' positions at its end, m.
    before: the vehicles at the step's start.
    half: half the length of each body, m.
    """
    was = before.field("x") + half * np.cos(before.field("heading"))
    return np.where(np.abs(was - begin) > _TURNED, begin, was)


def inside_lanes(
    road: Road, begin: FloatArray, y: FloatArray, heading: FloatArray, step: float
) -> BoolArray:
    """Whether each vehicle is on the lanes, heads in their direction, and is further than a step
    from the network's end.

    begin: position of the front along the lane at the step's start, m.
    y, heading: of the front across the road, m, and of the body, rad, at the step's end.
    step: s.
    """
    inside = (y > road.right_edge + LOSS_MARGIN) & (y < road.left_edge - LOSS_MARGIN)
    inside &= (np.cos(heading) > 0.0) & (begin >= 0.0)
    inside &= begin < road.end - farthest_in(step)
    return np.asarray(inside)


def shadow_lanes(
    road: Road, y: FloatArray, across: FloatArray, lane: IntArray, over_line: float
) -> IntArray:
    """The neighbouring lane into which each body reaches by more than `over_line`, m; the left
    one if it reaches into both; -1: none.

    y: of each body's centre, m.
    across: half the extent of each body across the road, m.
    lane: of each body's front.
    """
    width, lanes = road.lane_width, road.lanes
    left = (y + across > width * (lane + 0.5) + over_line) & (lane + 1 < lanes)
    right = (y - across < width * (lane - 0.5) - over_line) & (lane > 0)
    return np.where(left, lane + 1, np.where(right, lane - 1, -1))
