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
    while degrees.max() >= 360.0:
        degrees = np.where(degrees >= 360.0, degrees - 360.0, degrees)
    while degrees.min() < 0.0:
        degrees = np.where(degrees < 0.0, degrees + 360.0, degrees)
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
    straight = Seen(
        front_x - half_length, front_y, np.zeros(len(speed)), speed, np.zeros(len(speed)), half_length, half_width
    )
    if not turned.size:
        return straight
    if turned.size == len(speed):
        return _turned(front_x, front_y, angles, speed, half_length, half_width)
    arrays = front_x, front_y, angles, speed, half_length, half_width
    channels = [channel.copy() for channel in straight]
    for channel, values in zip(channels, _turned(*(array[turned] for array in arrays)), strict=True):
        channel[turned] = values
    return Seen(*channels)


def _turned(
    front_x: FloatArray,
    front_y: FloatArray,
    angles: FloatArray,
    speed: FloatArray,
    half_length: FloatArray,
    half_width: FloatArray,
) -> Seen:
    """The same of vehicles that do not point along the road."""
    heading = read_headings(angles)
    c, s = one_by_one(math.cos, heading), one_by_one(math.sin, heading)
    c_size, s_size = np.abs(c), np.abs(s)
    return Seen(
        front_x - half_length * c,
        front_y - half_length * s,
        heading,
        speed * c,
        speed * s,
        half_length * c_size + half_width * s_size,
        half_length * s_size + half_width * c_size,
    )


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
