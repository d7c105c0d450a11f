"""The ego as a machine: a kinematic single-track model that turns commands into motion within physical limits.

Within one step the acceleration is piecewise linear in time (brakes build up, drive rises) and the motion along the path
is its exact integral, so that stopping distances and impact speeds do not depend on the step. The path within a step is
a circular arc with the step's mean road wheel angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sumo_eval.settings import VehicleSettings

GRAVITY = 9.81  # m/s2


@dataclass(frozen=True, slots=True)
class Command:
    """What an ADS asks of its vehicle for the next step.

    acceleration: along the vehicle, m/s2, negative brakes. steering: steering wheel angle, rad, positive to the left.
    """

    acceleration: float
    steering: float = 0.0


@dataclass(frozen=True, slots=True)
class EgoState:
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
    clips: list[Clipped] = []
    carried = max(abs(state.acceleration) - limits.brake_jerk * step, 0.0)
    fastest = state.speed + step * max(state.acceleration, min(command.acceleration, limits.max_acceleration), 0.0)
    grip = grip_steering_wheel_angle(fastest, limits, carried)
    steering_end = _limit_steering(state, command.steering, grip, limits, step, clips)
    mean_steering = min(max(0.5 * (state.steering_wheel_angle + steering_end), -grip), grip)
    curvature = _curvature(mean_steering, limits)
    lateral = fastest**2 * max(abs(curvature), abs(_curvature(steering_end, limits)))
    target = _limit_acceleration(command.acceleration, lateral, limits, clips)
    acceleration, speed, distance = drive(state.speed, state.acceleration, target, limits, step)
    if speed > limits.max_speed:
        clips.append(("speed", speed, limits.max_speed))
        acceleration, speed = 0.0, limits.max_speed
        distance = 0.5 * (state.speed + speed) * step
    elif abs(acceleration - target) > 1e-9 and speed > 0.0:
        clips.append(("acceleration_rate", target, acceleration))
    x, y, heading = _along_arc(state, distance, curvature, limits.wheelbase)
    return EgoState(x, y, heading, speed, acceleration, steering_end), tuple(clips)


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
    if speed <= 0.0:
        return math.inf
    left = math.sqrt(max((limits.friction * GRAVITY) ** 2 - longitudinal**2, 0.0))
    return math.atan(left * limits.wheelbase / speed**2) * limits.steering_ratio


def _limit_acceleration(requested: float, lateral: float, limits: VehicleSettings, clips: list[Clipped]) -> float:
    """Acceleration the brakes, the drive and the tyres' remaining grip (friction circle) can give."""
    granted = min(max(requested, -limits.max_deceleration), limits.max_acceleration)
    if granted != requested:
        clips.append(("acceleration", requested, granted))
    left = math.sqrt(max((limits.friction * GRAVITY) ** 2 - lateral**2, 0.0))
    held = min(max(granted, -left), left)
    if held != granted:
        clips.append(("friction", granted, held))
    return held


def drive(
    speed: float, acceleration: float, target: float, limits: VehicleSettings, step: float
) -> tuple[float, float, float]:
    """(acceleration, speed) at the end of the step and the distance driven in it, exactly; a vehicle does not reverse."""
    distance, left, a, v = 0.0, step, acceleration, speed
    while left > 0.0:
        goal, jerk = _ramp(a, target, limits)
        duration = left if jerk == 0.0 else min((goal - a) / jerk, left)
        stop = _time_to_stop(v, a, jerk, duration)
        if stop is not None:
            distance += _moved(v, a, jerk, stop)
            if target < _SAME:
                return 0.0, 0.0, distance
            a, v, left = 0.0, 0.0, left - stop  # brakes still closing at a standstill hold nothing: drive begins
            continue
        distance += _moved(v, a, jerk, duration)
        v = max(v + a * duration + 0.5 * jerk * duration**2, 0.0)
        a = goal if duration < left else a + jerk * duration
        left -= duration
    return (target if abs(a - target) < _SAME else a), v, distance


_SAME = 1e-12  # m/s2, accelerations closer than this are one


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
    if v <= 0.0:
        return 0.0 if a < 0.0 or (a == 0.0 and jerk <= 0.0) else None
    if jerk == 0.0:
        time = -v / a if a < 0.0 else math.inf
    else:
        discriminant = a * a - 2.0 * jerk * v
        if discriminant < 0.0:
            return None
        root = math.sqrt(discriminant)
        candidates = sorted(((-a - root) / jerk, (-a + root) / jerk))
        time = next((candidate for candidate in candidates if candidate > 0.0), math.inf)
    return time if time <= duration else None


def _along_arc(state: EgoState, distance: float, curvature: float, wheelbase: float) -> tuple[float, float, float]:
    """Centre and heading after the rear axle has rolled `distance` along an arc of `curvature`."""
    half = 0.5 * wheelbase
    x = state.x - half * math.cos(state.heading)
    y = state.y - half * math.sin(state.heading)
    turn = distance * curvature
    chord = distance if abs(turn) < 1e-12 else distance * math.sin(0.5 * turn) / (0.5 * turn)
    x += chord * math.cos(state.heading + 0.5 * turn)
    y += chord * math.sin(state.heading + 0.5 * turn)
    heading = state.heading + turn
    return x + half * math.cos(heading), y + half * math.sin(heading), heading
