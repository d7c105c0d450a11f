"""The ego as a machine: a kinematic single-track model that turns commands into motion within physical limits.

Within one step the acceleration is piecewise linear in time (brakes build up, drive rises) and the motion along the
path is its exact integral, so that stopping distances and impact speeds do not depend on the step. The path within a
step is a circular arc with the step's mean road wheel angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from sumo_eval.settings import VehicleSettings

GRAVITY = 9.81  # m/s2
_GRANTED = 1e-9  # m/s2, a request met as closely as this is granted
_SAME = 1e-12  # m/s2, accelerations closer than this are one


@dataclass(frozen=True, slots=True, init=False)
class Command:
    """What an ADS asks of its vehicle for the next step.

    acceleration: along the vehicle, m/s2, negative brakes. steering: steering wheel angle, rad, positive to the left.
    """

    acceleration: float
    steering: float = 0.0

    def __init__(self, acceleration: float, steering: float = 0.0) -> None:
        _SET_ACCELERATION(self, acceleration)
        _SET_STEERING(self, steering)


# a frozen dataclass's own constructor takes twice as long, and every step of an ADS pays it
_SET_ACCELERATION = vars(Command)["acceleration"].__set__
_SET_STEERING = vars(Command)["steering"].__set__


class EgoState(NamedTuple):
    """Centre (x, y) m, heading rad, speed m/s, acceleration m/s2, steering wheel angle rad."""

    x: float
    y: float
    heading: float
    speed: float
    acceleration: float = 0.0
    steering_wheel_angle: float = 0.0


Clipped = tuple[str, float, float]
"""What was limited, the value asked for, the value granted."""


def advance(
    state: EgoState, command: Command, limits: VehicleSettings, step: float
) -> tuple[EgoState, tuple[Clipped, ...]]:
    """The state one `step` (s) later and every limit that the command ran into.

    The tyres hold a total acceleration of friction * g at the end of every step: steering comes first, braking and
    drive get the rest of the friction circle, and what brakes and drive cannot let go of within the step is taken from
    the steering.
    """
    x, y, heading, speed, acceleration, wheel = state
    wanted = command.acceleration
    straight = command.steering == 0.0 and wheel == 0.0
    granted = (
        -limits.max_deceleration <= wanted <= limits.max_acceleration
        and abs(wanted) < limits.friction * GRAVITY - _GRANTED
    )
    if straight and granted and abs(acceleration - wanted) < _SAME and speed + 2.0 * acceleration * step > 0.0:
        faster = speed + acceleration * step  # far from a standstill: all that follows comes down to this, to the bit
        if faster <= limits.max_speed:
            distance = speed * step + 0.5 * acceleration * step**2
            x, y = x + distance * math.cos(heading), y + distance * math.sin(heading)
            return tuple.__new__(EgoState, (x, y, heading, faster, wanted, 0.0)), ()
    clips: list[Clipped] = []
    if straight:  # as nearly always
        steering_end = curvature = lateral = 0.0
    else:
        steering_end, curvature, lateral = _steer(state, command, limits, step, clips)
    target = wanted if straight and granted else _limit_acceleration(wanted, lateral, limits, clips)
    acceleration, speed, distance = drive(speed, acceleration, target, limits, step)
    if speed > limits.max_speed:
        clips.append(("speed", speed, limits.max_speed))
        acceleration, speed = 0.0, limits.max_speed
        distance = 0.5 * (state.speed + speed) * step
    elif abs(acceleration - target) > _GRANTED and speed > 0.0:
        clips.append(("acceleration_rate", target, acceleration))
    x, y, heading = _along_arc(state, distance, curvature, limits.wheelbase)
    return EgoState(x, y, heading, speed, acceleration, steering_end), tuple(clips)


def _steer(
    state: EgoState, command: Command, limits: VehicleSettings, step: float, clips: list[Clipped]
) -> tuple[float, float, float]:
    """Steering wheel angle at the end of the step, mean curvature and highest lateral acceleration within the step."""
    carried = max(abs(state.acceleration) - limits.brake_jerk * step, 0.0)
    fastest = state.speed + step * max(state.acceleration, min(command.acceleration, limits.max_acceleration), 0.0)
    grip = grip_steering_wheel_angle(fastest, limits, carried)
    end = _limit_steering(state, command.steering, grip, limits, step, clips)
    curvature = _curvature(min(max(0.5 * (state.steering_wheel_angle + end), -grip), grip), limits)
    return end, curvature, fastest**2 * max(abs(curvature), abs(_curvature(end, limits)))


def _curvature(steering_wheel_angle: float, limits: VehicleSettings) -> float:
    """Curvature of the rear axle's path, 1/m: tan(road wheel angle) / wheelbase."""
    return math.tan(steering_wheel_angle / limits.steering_ratio) / limits.wheelbase


def _limit_steering(
    state: EgoState, requested: float, grip: float, limits: VehicleSettings, step: float, clips: list[Clipped]
) -> float:
    """Steering wheel angle at the end of the step: within its end stops, its rate, and the grip of the tyres."""
    stop = math.radians(limits.max_steering_wheel_angle_deg)
    angle = min(max(requested, -stop), stop)
    if angle != requested:
        clips.append(("steering_angle", requested, angle))
    reach = math.radians(limits.max_steering_wheel_rate_deg) * step
    reachable = min(max(angle, state.steering_wheel_angle - reach), state.steering_wheel_angle + reach)
    if reachable != angle:
        clips.append(("steering_rate", angle, reachable))
    held = min(max(reachable, -grip), grip)
    if held != reachable:
        clips.append(("lateral_friction", reachable, held))
    return held


def grip_steering_wheel_angle(speed: float, limits: VehicleSettings, longitudinal: float = 0.0) -> float:
    """Largest steering wheel angle (rad) whose steady cornering the tyres can hold beside a longitudinal acceleration.

    v^2 tan(angle / steering ratio) / wheelbase = sqrt((mu g)^2 - longitudinal^2).
    """
    left = math.sqrt(max((limits.friction * GRAVITY) ** 2 - longitudinal**2, 0.0))
    return math.atan2(left * limits.wheelbase, speed**2) * limits.steering_ratio


def _limit_acceleration(requested: float, lateral: float, limits: VehicleSettings, clips: list[Clipped]) -> float:
    """Acceleration the brakes, the drive and the tyres' remaining grip (friction circle) can give."""
    granted = min(max(requested, -limits.max_deceleration), limits.max_acceleration)
    if granted != requested:
        clips.append(("acceleration", requested, granted))
    left = math.sqrt(max((limits.friction * GRAVITY) ** 2 - lateral**2, 0.0))
    held = min(max(granted, -left), left)
    if abs(held - granted) > _GRANTED:
        clips.append(("friction", granted, held))
    return held


def drive(
    speed: float, acceleration: float, target: float, limits: VehicleSettings, step: float
) -> tuple[float, float, float]:
    """(acceleration, speed) at the end of the step and the distance driven in it, exactly; no vehicle reverses."""
    distance, left, a, v = 0.0, step, acceleration, speed
    while left > 0.0:
        goal, jerk = (a, 0.0) if abs(a - target) < _SAME else _ramp(a, target, limits)
        duration = left if jerk == 0.0 else (goal - a) / jerk
        duration = min(duration, left)
        reached = a + jerk * duration
        if v + 2.0 * (a if a < reached else reached) * duration <= 0.0:  # else it is far from standing still
            stop = _time_to_stop(v, a, jerk, duration)
            if stop is not None:
                distance += _moved(v, a, jerk, stop)
                if target < _SAME:
                    return 0.0, 0.0, distance
                a, v, left = 0.0, 0.0, left - stop  # brakes still closing at a standstill hold nothing: drive begins
                continue
        square = duration**2
        distance += v * duration + 0.5 * a * square + jerk * duration**3 / 6.0
        v = max(v + a * duration + 0.5 * jerk * square, 0.0)
        a = goal if duration < left else reached
        left -= duration
    return (target if abs(a - target) < _SAME else a), v, distance


def _ramp(a: float, target: float, limits: VehicleSettings) -> tuple[float, float]:
    """Where the acceleration goes next on its way from `a` to `target`, m/s2, and its rate, m/s3 (0: it is there)."""
    if abs(a - target) < _SAME:
        return a, 0.0
    if target < a:
        return target, -limits.brake_jerk
    if a < 0.0:  # brakes are released as fast as they build up; drive begins only after that
        return min(target, 0.0), limits.brake_jerk
    return target, limits.drive_jerk


def _moved(v: float, a: float, jerk: float, duration: float) -> float:
    return v * duration + 0.5 * a * duration**2 + jerk * duration**3 / 6.0


def _time_to_stop(v: float, a: float, jerk: float, duration: float) -> float | None:
    """First time within `duration` at which v + a t + jerk t^2 / 2 falls to 0, None if it does not."""
    discriminant = a * a - 2.0 * jerk * v
    if discriminant < 0.0:
        return None
    if a < 0.0:  # of the two ways to write the smaller root, the one that does not cancel
        time = 2.0 * v / (math.sqrt(discriminant) - a)
    elif jerk < 0.0:
        time = (math.sqrt(discriminant) + a) / -jerk
    else:
        return None
    return time if time <= duration else None


def _along_arc(state: EgoState, distance: float, curvature: float, wheelbase: float) -> tuple[float, float, float]:
    """Centre and heading after the rear axle has rolled `distance` along an arc of `curvature`."""
    if curvature == 0.0:
        x, y = state.x + distance * math.cos(state.heading), state.y + distance * math.sin(state.heading)
        return x, y, state.heading
    x, y, heading = state[:3]
    half = 0.5 * wheelbase
    x -= half * math.cos(heading)
    y -= half * math.sin(heading)
    turn = distance * curvature
    chord = distance if abs(turn) < 1e-12 else distance * math.sin(0.5 * turn) / (0.5 * turn)
    x += chord * math.cos(heading + 0.5 * turn)
    y += chord * math.sin(heading + 0.5 * turn)
    heading += turn
    return x + half * math.cos(heading), y + half * math.sin(heading), heading
