"""What `ads.perception.Sensor.look` shows of many vehicles at once, to the last bit.

SUMO keeps a vehicle's place as it is told, but its heading passes through degrees clockwise from north: `shown_angles`
does to a heading what SUMO does to it between `moveToXY` and `getAngle`, with the same operations in the same order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sumo_eval.cosim.packed_vehicle_model import PackedEgos, one_by_one
from sumo_eval.trajectory import FloatArray

STRAIGHT = 90.0  # deg clockwise from north, SUMO's angle along the road
_ALONG = 1e-9  # rad, a heading smaller than this is none, as in `Sensor`


class Seen(NamedTuple):
    """Vehicles as a sensor shows them; arrays of one shape, as in `PackedScene`."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    along: FloatArray
    across: FloatArray
    half_length: FloatArray
    half_width: FloatArray


def shown_angles(headings: FloatArray) -> FloatArray:
    """What `getAngle` gives after `moveToXY(..., 90.0 - math.degrees(heading), ...)`, deg."""
    told = _within_a_turn(STRAIGHT - headings * (180.0 / math.pi))
    radians = math.pi / 2.0 - told * math.pi / 180.0
    return _within_a_turn((math.pi / 2.0 - radians) * 180.0 / math.pi)


def _within_a_turn(degrees: FloatArray) -> FloatArray:
    """As SUMO: whole turns are taken off or added one by one."""
    while (high := degrees >= 360.0).any():
        degrees = np.where(high, degrees - 360.0, degrees)
    while (low := degrees < 0.0).any():
        degrees = np.where(low, degrees + 360.0, degrees)
    return degrees


def read_headings(angles: FloatArray) -> FloatArray:
    """Headings within -pi..pi from SUMO's angles, rad."""
    headings = (STRAIGHT - angles) * (math.pi / 180.0)
    return headings if headings.min(initial=0.0) >= -math.pi else one_by_one(_wrapped, headings)


def _wrapped(heading: float) -> float:
    return math.remainder(heading, math.tau)


def as_seen(
    front_x: FloatArray,
    front_y: FloatArray,
    angles: FloatArray,
    speed: FloatArray,
    half_length: FloatArray,
    half_width: FloatArray,
) -> Seen:
    """Vehicles of which SUMO shows the front bumper, the angle and the speed; (k,) each."""
    headings = (STRAIGHT - angles) * (math.pi / 180.0)
    turned = np.flatnonzero(np.abs(headings) >= _ALONG)
    x, across = front_x - half_length, np.zeros(len(speed))
    if not turned.size:
        return Seen(x, front_y, np.zeros(len(speed)), speed, across, half_length, half_width)
    heading, y, along = np.zeros(len(speed)), front_y.copy(), speed.copy()
    long, wide = half_length.copy(), half_width.copy()
    h = read_headings(angles[turned])
    c, s = one_by_one(math.cos, h), one_by_one(math.sin, h)
    length, width, v = half_length[turned], half_width[turned], speed[turned]
    x[turned], y[turned], heading[turned] = front_x[turned] - length * c, front_y[turned] - length * s, h
    along[turned], across[turned] = v * c, v * s
    long[turned] = length * np.abs(c) + width * np.abs(s)
    wide[turned] = length * np.abs(s) + width * np.abs(c)
    return Seen(x, y, heading, along, across, long, wide)


def fronts(egos: PackedEgos, half_length: float) -> tuple[FloatArray, FloatArray]:
    """Centres of the egos' front bumpers, m."""
    return egos.x + half_length * egos.cosine, egos.y + half_length * egos.sine


def egos_as_seen(egos: PackedEgos, half_length: FloatArray, half_width: FloatArray) -> Seen:
    """Egos that SUMO shows where the vehicle model has them."""
    if not egos.heading.any():
        x = (egos.x + half_length) - half_length
        nothing = np.zeros(len(x))
        return Seen(x, egos.y, nothing, egos.speed, nothing, half_length, half_width)
    front_x, front_y = egos.x + half_length * egos.cosine, egos.y + half_length * egos.sine
    return as_seen(front_x, front_y, shown_angles(egos.heading), egos.speed, half_length, half_width)
