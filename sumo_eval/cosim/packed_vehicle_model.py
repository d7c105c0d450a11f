"""The vehicle model for many egos at once: `vehicle_model.advance` on arrays, to the last bit, in its ordinary course.

Where a limit is met the answer is the scalar model's to give, which says what it limited. Sines, tangents and powers
are taken one by one: numpy has its own, whose last bits differ from those of Python's `math`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sumo_eval.cosim.packed_controller import PackedCommand
from sumo_eval.cosim.vehicle_model import GRAVITY, EgoState, drive
from sumo_eval.settings import VehicleSettings
from sumo_eval.trajectory import BoolArray, FloatArray

_GRANTED = 1e-9  # m/s2, as in the scalar model
_SAME = 1e-12  # m/s2, as in the scalar model
_NEARLY = 1.0 - 1e-9  # of a limit that is computed with numpy's own functions: below it the limit does not bind


class PackedEgos(NamedTuple):
    """States of n egos, (n,) each, as in `EgoState`; cosine and sine are the heading's."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    steering_wheel_angle: FloatArray
    cosine: FloatArray
    sine: FloatArray

    def state(self, row: int) -> EgoState:
        """One of them."""
        return EgoState(*(float(channel[row]) for channel in self[:6]))

    def put(self, row: int, state: EgoState) -> None:
        """Set one of them."""
        for channel, value in zip(self, (*state, math.cos(state.heading), math.sin(state.heading)), strict=True):
            channel[row] = value


def one_by_one(function: Callable[[float], float], values: FloatArray) -> FloatArray:
    """A function of Python's `math` of every value."""
    return np.array(list(map(function, values.tolist())), dtype=np.float64)


def advance_all(
    egos: PackedEgos, command: PackedCommand, limits: VehicleSettings, step: float
) -> tuple[PackedEgos, BoolArray]:
    """The states one `step` (s) later, and where they do not hold: there a limit is met, or the command is no number.

    Within `np.errstate(all="ignore")`, please: what does not hold may be anything.
    """
    target, angle = command.acceleration, command.steering
    grip = limits.friction * GRAVITY
    exceptional = ~((target >= -limits.max_deceleration) & (target <= limits.max_acceleration))
    turns = (angle != 0.0) | (egos.steering_wheel_angle != 0.0)
    steers = bool(turns.any())
    if steers:
        stop = math.radians(limits.max_steering_wheel_angle_deg)
        mean = np.minimum(np.maximum(0.5 * (egos.steering_wheel_angle + angle), -stop), stop)
        curvature = one_by_one(math.tan, mean / limits.steering_ratio) / limits.wheelbase
        refused, left = _steering_limits(egos, command, mean, curvature, limits, step)
        exceptional |= turns & refused
        exceptional |= np.abs(target) >= left * _NEARLY
        angle = np.where(turns, angle, 0.0)
    else:
        curvature = angle = np.zeros(len(target))
        exceptional |= np.abs(target) >= grip * _NEARLY
    acceleration, speed, distance = drive_all(egos.speed, egos.acceleration, target, limits, step)
    exceptional |= speed > limits.max_speed
    exceptional |= (np.abs(acceleration - target) > _GRANTED) & (speed > 0.0)
    if steers or egos.heading.any():
        x, y, heading, cosine, sine = _along_arcs(egos, distance, curvature, limits.wheelbase)
    else:
        x, y, (heading, cosine, sine) = egos.x + distance, egos.y + 0.0, (egos.heading, egos.cosine, egos.sine)
    return PackedEgos(x, y, heading, speed, acceleration, angle, cosine, sine), exceptional


def _steering_limits(
    egos: PackedEgos,
    command: PackedCommand,
    mean: FloatArray,
    curvature: FloatArray,
    limits: VehicleSettings,
    step: float,
) -> tuple[BoolArray, FloatArray]:
    """Where the steering wheel cannot, or not for sure, be turned as asked, and the grip left for braking, m/s2."""
    angle, present = command.steering, egos.steering_wheel_angle
    stop = math.radians(limits.max_steering_wheel_angle_deg)
    reach = math.radians(limits.max_steering_wheel_rate_deg) * step
    grip = limits.friction * GRAVITY
    carried = np.maximum(np.abs(egos.acceleration) - limits.brake_jerk * step, 0.0)
    driven = np.minimum(command.acceleration, limits.max_acceleration)
    fastest = egos.speed + step * np.maximum(np.maximum(egos.acceleration, driven), 0.0)
    square = fastest * fastest
    free = np.sqrt(np.maximum(grip * grip - carried * carried, 0.0))
    held = np.arctan2(free * limits.wheelbase, square) * limits.steering_ratio * _NEARLY
    fine = (angle >= -stop) & (angle <= stop) & (angle >= present - reach) & (angle <= present + reach)
    fine &= (np.abs(angle) < held) & (np.abs(mean) < held)
    at_end = np.tan(angle / limits.steering_ratio) / limits.wheelbase
    lateral = square * np.maximum(np.abs(curvature), np.abs(at_end))
    return ~fine, np.sqrt(np.maximum(grip * grip - lateral * lateral, 0.0))


def drive_all(
    speed: FloatArray, acceleration: FloatArray, target: FloatArray, limits: VehicleSettings, step: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`vehicle_model.drive` on arrays: acceleration and speed at the end of the step, and the distance driven in it.

    In its ordinary course the acceleration goes to its target, or on its way there, and stays. What may stop within the
    step, or goes from braking to driving, is left to the scalar model.
    """
    away = np.abs(acceleration - target) >= _SAME
    decelerating = np.minimum(acceleration, target) < 0.0
    odd = decelerating & (speed <= -step * np.minimum(acceleration, target) + 1e-9)
    if away.any():
        down, releases = target < acceleration, acceleration < 0.0
        goal = np.where(away, np.where(~down & releases, np.minimum(target, 0.0), target), acceleration)
        jerk = np.where(down, -limits.brake_jerk, np.where(releases, limits.brake_jerk, limits.drive_jerk))
        ramp = np.where(away, np.minimum((goal - acceleration) / jerk, step), 0.0)
        durations = ramp.tolist()
        square, cube = np.array([value**2 for value in durations]), np.array([value**3 for value in durations])
        distance = speed * ramp + 0.5 * acceleration * square + jerk * cube / 6.0
        v = np.maximum(speed + acceleration * ramp + 0.5 * jerk * square, 0.0)
        a = np.where(ramp >= step, acceleration + jerk * ramp, goal)
        rest = step - ramp
        square = np.array([value**2 for value in rest.tolist()])
        distance = distance + (v * rest + 0.5 * a * square)
        v = np.maximum(v + a * rest, 0.0)
        there = np.abs(a - target) < _SAME
        odd |= (rest > 0.0) & ~there
        a = np.where(there, target, a)
    else:
        distance = speed * step + 0.5 * acceleration * step**2 + 0.0
        a, v = target.copy(), np.maximum(speed + acceleration * step + 0.0, 0.0)
    for row in np.flatnonzero(odd).tolist():
        given = float(speed[row]), float(acceleration[row]), float(target[row])
        a[row], v[row], distance[row] = drive(*given, limits, step)
    return a, v, distance


def _along_arcs(
    egos: PackedEgos, distance: FloatArray, curvature: FloatArray, wheelbase: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """As `_along_arc` of the scalar model, with the cosines and sines of the new headings."""
    x, y = egos.x + distance * egos.cosine, egos.y + distance * egos.sine
    heading, cosine, sine = egos.heading, egos.cosine, egos.sine
    bends = curvature != 0.0
    if not bends.any():
        return x, y, heading, cosine, sine
    rows = slice(None) if bends.all() else np.flatnonzero(bends)
    c, s, h, driven = cosine[rows], sine[rows], heading[rows], distance[rows]
    half = 0.5 * wheelbase
    turn = driven * curvature[rows]
    half_turn = 0.5 * turn
    chord = np.where(np.abs(turn) < 1e-12, driven, driven * one_by_one(math.sin, half_turn) / half_turn)
    middle = h + half_turn
    rear_x = egos.x[rows] - half * c + chord * one_by_one(math.cos, middle)
    rear_y = egos.y[rows] - half * s + chord * one_by_one(math.sin, middle)
    new = h + turn
    new_cosine, new_sine = one_by_one(math.cos, new), one_by_one(math.sin, new)
    heading, cosine, sine = heading.copy(), cosine.copy(), sine.copy()
    heading[rows], cosine[rows], sine[rows] = new, new_cosine, new_sine
    x[rows], y[rows] = rear_x + half * new_cosine, rear_y + half * new_sine
    return x, y, heading, cosine, sine
