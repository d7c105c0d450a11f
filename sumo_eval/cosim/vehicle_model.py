"""The ego as a machine: a single-track model that turns commands into motion within physical
limits.

Within one step the acceleration is piecewise linear in time: brakes build up, drive rises. The
motion along the path is its exact integral, so stopping distances do not depend on the step. Impact
speeds do, by up to 0.06 m/s: a contact is found on the straight line between a step's ends.

Across, there are two models. In the kinematic one (`move`) the tyres do not slip, and the path
within a step is a circular arc with the step's mean road wheel angle. Real tyres hardly slip below
about 0.4 g across. The dynamic model (`move_dynamic`) has side slip and a yaw rate of its own.

Where the tyres' grip is too small for all requests, drive and braking give way in both models: they
get what the lateral acceleration leaves of the friction circle. In the kinematic model the steering
gives way to drive or braking that cannot be released within the step. In the dynamic model the
tyres' side forces give way to these instead, and the vehicle slips.

Constants, formulas and the order of operations decide recorded values to the last bit.

Users: `ads/foresight.py`, `ads/pedals.py`, `cosim/`, `extras/bench/costs.py`,
`extras/studies/qualification/`, `extras/wheel/`, and users' code (`sumo_eval.Command`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from sumo_eval.frozen import frozen
from sumo_eval.kernels import kernel

GRAVITY = 9.81  # m/s2
KINEMATIC_UP_TO = 0.4 * GRAVITY  # lateral, m/s2, up to which tyres are assumed not to slip
# m/s, below which the dynamic model moves as the kinematic one: its slip angles divide by the speed
_SLOWEST_SLIP = 2.0
# of a step, at least and at most: the dynamic model makes one step of integration in each
_PARTS, _MOST_PARTS = 10, 1000
_PART = 1.5  # longest part, over the time in which slip or yaw settle: from 2 on errors would grow
_GRANTED = 1e-9  # m/s2, a request that is missed by less counts as granted
_SAME = 1e-12  # m/s2, accelerations that differ by less are equal


@frozen(init=False)
class Command:
    """Request of an ADS for the next step: an acceleration or a speed, and a steering wheel angle.

    acceleration: along the vehicle, m/s2, negative brakes; nan if a speed is given.
    steering: steering wheel angle, rad, positive to the left.
    speed: to drive at from now on, m/s; `TrackerSettings.speed_time` says how soon.

    The constructor takes either an acceleration or a speed. Its default acceleration `...` means:
    none given.
    """

    acceleration: float
    steering: float = 0.0
    speed: float | None = None

    def __init__(
        self, acceleration: Any = ..., steering: float = 0.0, *, speed: float | None = None
    ) -> None:
        # nan with a speed is none: `dataclasses.replace` of a Command with a speed hands it over
        accelerates = acceleration is not ... and (speed is None or acceleration == acceleration)
        if accelerates == (speed is not None):
            got = "both" if accelerates else "neither"
            raise TypeError(f"a Command takes an acceleration or a speed, got {got}")
        _SET_ACCELERATION(self, math.nan if acceleration is ... else acceleration)
        _SET_STEERING(self, steering)
        _SET_SPEED(self, speed)

    @staticmethod
    def pedals(throttle: float = 0.0, brake: float = 0.0, steer: float = 0.0) -> Pedals:
        """Pedals, 0..1 each, and the steering wheel, -1..1 of its end stops, positive to the
        left.
        """
        return Pedals(throttle, brake, steer)


# Setters of the slots, past the frozen dataclass: its own constructor takes twice as long, and
# every step of an ADS makes a Command.
_SET_ACCELERATION = vars(Command)["acceleration"].__set__
_SET_STEERING = vars(Command)["steering"].__set__
_SET_SPEED = vars(Command)["speed"].__set__


@frozen
class Pedals:
    """Positions of the pedals, 0..1, and of the steering wheel, -1..1 of its end stops, positive to
    the left.
    """

    throttle: float
    brake: float
    steer: float


class EgoState(NamedTuple):
    """Centre (x, y) m, heading rad, speed m/s, acceleration m/s2, steering wheel angle rad."""

    x: float
    y: float
    heading: float
    speed: float
    acceleration: float = 0.0
    steering_wheel_angle: float = 0.0


LIMITED = (
    "steering_angle", "steering_rate", "lateral_friction", "acceleration", "friction", "speed",
    "acceleration_rate",
    "beyond_kinematic",
)  # fmt: skip
"""Quantities that the vehicle model may have to limit, by the numbers of their clips."""
_STEERING_ANGLE, _STEERING_RATE, _LATERAL_FRICTION = range(3)
_ACCELERATION, _FRICTION, _SPEED = range(3, 6)
_ACCELERATION_RATE, _BEYOND_KINEMATIC = 6, 7


@kernel
def count_clip(clips: Any, what: int, time: float, requested: float, applied: float) -> None:
    """Count a clip at `time` (s) and keep the request that was missed by most.

    clips: of one case, by number. what: the number of the clip.
    """
    clip = clips[what]
    if clip.count == 0:
        clip.first = time
    if clip.count == 0 or abs(requested - applied) > abs(clip.requested - clip.applied):
        clip.requested, clip.applied = requested, applied
    clip.count += 1


@kernel
def move(
    ego: Any, at: Any, wanted: float, steering: float, limits: Any, step: float, clips: Any
) -> None:
    """Move an ego by the kinematic model for one `step`, s.

    ego: its speed, acceleration, steering wheel angle and time.
    at: its x, y and heading.
    wanted: m/s2, and steering: rad, as in `Command`.
    limits: `VehicleSettings` or a record of them.
    clips: where limits that the command runs into are counted, by number.

    At the end of every step the total acceleration is at most friction * g.
    """
    if steering == 0.0 and ego.steering == 0.0:  # straight: nearly every step
        steering_end = curvature = lateral = 0.0
    else:
        steering_end, curvature, lateral = _steer(ego, wanted, steering, limits, step, clips)
        if lateral > KINEMATIC_UP_TO:
            count_clip(clips, _BEYOND_KINEMATIC, ego.time, lateral, KINEMATIC_UP_TO)
    target = _limit_acceleration(wanted, lateral, limits, ego.time, clips)
    _along_arc(at, _drive_within(ego, target, limits, step, clips), curvature, limits.wheelbase)
    ego.steering = steering_end


@kernel
def side_force(linear: float, limit: float) -> float:
    """Force of an axle's tyres across, N: linear at first, never above its limit: limit tanh(linear
    / limit).
    """
    return limit * math.tanh(linear / limit) if limit > 0.0 else 0.0


@kernel
def slip_rates(
    speed: float,
    slip: float,
    yaw_rate: float,
    wheel: float,
    acceleration: float,
    limits: Any,
    grip: float,
) -> tuple[float, float, float]:
    """Three values of the dynamic single-track model: the rate of the side slip, rad/s; the rate of
    the yaw rate, rad/s2; the larger of both axles' F / (grip Fz) before F is limited, 0 where
    `grip` is inf.

    Force of an axle across, N: F = mu C Fz alpha, of friction mu, cornering stiffness C, slip angle
    alpha, and load Fz, N. The acceleration shifts load between the axles.

    Source: single-track model of commonroad-vehicle-models (Althoff, Koschi, Manzinger: CommonRoad,
    IV 2017).

    slip: side slip, rad. yaw_rate: rad/s. acceleration: along the vehicle, m/s2.
    wheel: angle of the front wheels on the road, rad.
    grip: friction coefficient of the friction circle: F is at most the part of it that the
        acceleration leaves. inf: tyres stay linear, as in the source.
    """
    front = limits.front_share * limits.wheelbase
    rear = limits.wheelbase - front
    load_front = (
        limits.mass * (GRAVITY * rear - acceleration * limits.centre_height) / limits.wheelbase
    )
    load_rear = (
        limits.mass * (GRAVITY * front + acceleration * limits.centre_height) / limits.wheelbase
    )
    stiffness = limits.friction * limits.cornering_stiffness
    alpha_front = wheel - slip - front * yaw_rate / speed
    alpha_rear = rear * yaw_rate / speed - slip
    force_front = stiffness * load_front * alpha_front
    force_rear = stiffness * load_rear * alpha_rear
    used = 0.0
    if not math.isinf(grip):
        along = acceleration / GRAVITY
        # friction coefficient that remains for F
        across = math.sqrt(max(grip * grip - along * along, 0.0))
        used = max(abs(force_front) / (grip * load_front), abs(force_rear) / (grip * load_rear))
        force_front = side_force(force_front, across * load_front)
        force_rear = side_force(force_rear, across * load_rear)
    yaw_acceleration = (front * force_front - rear * force_rear) / limits.yaw_inertia
    return (force_front + force_rear) / (limits.mass * speed) - yaw_rate, yaw_acceleration, used


@kernel
def _drive_within(ego: Any, target: float, limits: Any, step: float, clips: Any) -> float:
    """Write the speed and acceleration of an ego after a step of `drive`, at most at the vehicle's
    highest speed; return the distance, m.

    Counts a clip if that speed, or the rate at which acceleration may change, limits the request.
    """
    end_acceleration, end_speed, distance = drive(ego.speed, ego.acceleration, target, limits, step)
    if end_speed > limits.max_speed:
        count_clip(clips, _SPEED, ego.time, end_speed, limits.max_speed)
        end_acceleration = 0.0
        end_speed = limits.max_speed
        distance = 0.5 * (ego.speed + end_speed) * step
    elif abs(end_acceleration - target) > _GRANTED and end_speed > 0.0:
        count_clip(clips, _ACCELERATION_RATE, ego.time, target, end_acceleration)
    ego.acceleration, ego.speed = end_acceleration, end_speed
    return distance


@kernel
def move_dynamic(
    ego: Any, at: Any, wanted: float, steering: float, limits: Any, step: float, clips: Any
) -> None:
    """Move an ego by the dynamic model, with its side slip, rad, and yaw rate, rad/s.

    Arguments as in `move`. Steering, drive and brakes have the kinematic model's limits, except
    that the tyres do not limit the steering. Side slip, yaw and position are integrated
    by Heun's method in parts of the step, `_PARTS` or more; speed and distance along the path are
    those of `drive`.
    """
    # begin, end: steering wheel angles, rad; wheel, wheel2: angles of the road wheels, rad
    speed, acceleration, begin = ego.speed, ego.acceleration, ego.steering
    slip = ego.slip
    yaw_rate = ego.yaw_rate
    end = _limit_steering(ego, steering, math.inf, limits, step, clips)
    target = _limit_acceleration(wanted, speed * yaw_rate, limits, ego.time, clips)
    distance = _drive_within(ego, target, limits, step, clips)
    end_speed, ego.steering = ego.speed, end
    # m from the rear axle to the centre of gravity
    rear = (1.0 - limits.front_share) * limits.wheelbase
    if speed < _SLOWEST_SLIP or end_speed < _SLOWEST_SLIP:
        _along_arc(at, distance, _curvature(0.5 * (begin + end), limits), limits.wheelbase)
        curvature = _curvature(end, limits)  # of the rear axle's path: its tyres do not slip
        ego.slip, ego.yaw_rate = math.atan(rear * curvature), end_speed * curvature
        return
    # m by which the centre of gravity is ahead of `at`, which is midway between the axles
    ahead = (0.5 - limits.front_share) * limits.wheelbase
    heading = at.heading
    x, y = at.x + ahead * math.cos(heading), at.y + ahead * math.sin(heading)
    # 1/s, rates at which slip and yaw settle where the tyres are linear: the larger one
    settling = limits.friction * limits.cornering_stiffness * GRAVITY / min(speed, end_speed)
    settling *= max(limits.mass * rear * (limits.wheelbase - rear) / limits.yaw_inertia, 1.0)
    parts = math.ceil(min(max(settling * step / _PART, _PARTS), _MOST_PARTS))
    part = step / parts  # s
    path = distance / parts  # m
    most = 0.0  # largest share of the friction that linear tyres would use
    for k in range(parts):
        # Heun's method: rates at the start of the part, then (names with a 2) at its predicted end
        share = k / parts
        next_share = (k + 1) / parts
        v = speed + share * (end_speed - speed)
        v2 = speed + next_share * (end_speed - speed)
        wheel = (begin + share * (end - begin)) / limits.steering_ratio
        wheel2 = (begin + next_share * (end - begin)) / limits.steering_ratio
        slipping, turning, used = slip_rates(
            v, slip, yaw_rate, wheel, acceleration, limits, limits.friction
        )
        most = max(most, used)
        slip2, yaw2 = slip + part * slipping, yaw_rate + part * turning
        slipping2, turning2, used = slip_rates(
            v2, slip2, yaw2, wheel2, ego.acceleration, limits, limits.friction
        )
        before = yaw_rate
        course = heading + slip  # direction of motion, rad
        slip += 0.5 * part * (slipping + slipping2)
        yaw_rate += 0.5 * part * (turning + turning2)
        heading += 0.5 * part * (before + yaw_rate)
        course = 0.5 * (course + heading + slip)  # the part's mean
        x += path * math.cos(course)
        y += path * math.sin(course)
    # lateral acceleration, m/s2: of linear tyres, and what the friction circle leaves beside the
    # acceleration at the start of the step
    linear = most * (limits.friction * GRAVITY)
    grip = _grip_left(limits, acceleration)
    if linear > grip:
        count_clip(clips, _LATERAL_FRICTION, ego.time, linear, grip)
    at.x, at.y, at.heading = x - ahead * math.cos(heading), y - ahead * math.sin(heading), heading
    ego.slip, ego.yaw_rate = slip, yaw_rate


@kernel
def _steer(
    ego: Any, wanted: float, steering: float, limits: Any, step: float, clips: Any
) -> tuple[float, float, float]:
    """Steering wheel angle at the end of the step, mean curvature and highest lateral acceleration
    within the step.
    """
    # m/s2, drive or braking at the end of the step if it is released from the step's start on, both
    # at `brake_jerk` (`_ramp`)
    carried = max(abs(ego.acceleration) - limits.brake_jerk * step, 0.0)
    fastest = ego.speed + step * max(ego.acceleration, min(wanted, limits.max_acceleration), 0.0)
    largest = grip_steering_wheel_angle(fastest, limits, carried)
    end = _limit_steering(ego, steering, largest, limits, step, clips)
    curvature = _curvature(min(max(0.5 * (ego.steering + end), -largest), largest), limits)
    return end, curvature, fastest * fastest * max(abs(curvature), abs(_curvature(end, limits)))


@kernel
def _curvature(steering_wheel_angle: float, limits: Any) -> float:
    """Curvature of the rear axle's path, 1/m: tan(road wheel angle) / wheelbase."""
    return float(math.tan(steering_wheel_angle / limits.steering_ratio) / limits.wheelbase)


@kernel
def _held(value: float, low: float, high: float, clips: Any, what: int, time: float) -> float:
    """A value held within its limits; counts a clip where that changes the value.

    what: number of the clip. time: of the clip, s.
    """
    held = min(max(value, low), high)
    if held != value:
        count_clip(clips, what, time, value, held)
    return held


@kernel
def _limit_steering(
    ego: Any, requested: float, largest: float, limits: Any, step: float, clips: Any
) -> float:
    """Steering wheel angle at the end of the step: within its end stops, its rate, and the grip of
    the tyres.

    largest: largest angle that the tyres hold, rad. It is applied last: where grip is lost, the
        wheel may turn back faster than its rate.
    """
    stop = math.radians(limits.max_steering_wheel_angle_deg)
    reach = math.radians(limits.max_steering_wheel_rate_deg) * step
    now, time = ego.steering, ego.time
    angle = _held(requested, -stop, stop, clips, _STEERING_ANGLE, time)
    angle = _held(angle, now - reach, now + reach, clips, _STEERING_RATE, time)
    return _held(angle, -largest, largest, clips, _LATERAL_FRICTION, time)


@kernel
def _grip_left(limits: Any, other: float) -> float:
    """sqrt((mu g)^2 - other^2): acceleration that tyres hold at right angles to `other`, m/s2."""
    grip = limits.friction * GRAVITY
    return math.sqrt(max(grip * grip - other * other, 0.0))


@kernel
def grip_steering_wheel_angle(speed: float, limits: Any, longitudinal: float = 0.0) -> float:
    """Largest steering wheel angle (rad) whose steady cornering the tyres can hold together with a
    longitudinal acceleration, m/s2.

    v^2 tan(angle / steering ratio) / wheelbase = sqrt((mu g)^2 - longitudinal^2).
    """
    wheel = math.atan2(_grip_left(limits, longitudinal) * limits.wheelbase, speed * speed)
    return float(wheel * limits.steering_ratio)


@kernel
def _limit_acceleration(
    requested: float, lateral: float, limits: Any, time: float, clips: Any
) -> float:
    """Acceleration, m/s2, within the limits of brakes, drive and the tyres' remaining grip.

    lateral: acceleration across, which uses part of the friction circle, m/s2.
    """
    granted = _held(
        requested, -limits.max_deceleration, limits.max_acceleration, clips, _ACCELERATION, time
    )
    grip = _grip_left(limits, lateral)
    held = min(max(granted, -grip), grip)
    if abs(held - granted) > _GRANTED:
        count_clip(clips, _FRICTION, time, granted, held)
    return float(held)


@kernel
def drive(
    speed: float, acceleration: float, target: float, limits: Any, step: float
) -> tuple[float, float, float]:
    """Acceleration, m/s2, and speed, m/s, at the end of the step, and the distance driven in it, m;
    exact integrals. No vehicle reverses.

    target: acceleration to reach, m/s2.
    """
    distance = 0.0
    remaining = step  # s
    a, v = acceleration, speed
    while remaining > 0.0:
        goal, jerk = _ramp(a, target, limits)
        duration = remaining if jerk == 0.0 else (goal - a) / jerk
        duration = min(duration, remaining)
        reached = a + jerk * duration
        # cheap bound before the exact test: even twice this part's strongest braking must stop it
        if v + 2.0 * min(a, reached) * duration <= 0.0:
            stop = _time_to_stop(v, a, jerk, duration)
            if stop >= 0.0:
                distance += v * stop + 0.5 * a * (stop * stop) + jerk * (stop * stop * stop) / 6.0
                if target < _SAME:
                    return 0.0, 0.0, distance
                # the target is to drive: at a standstill it begins, although the brakes are still
                # being released
                a = v = 0.0
                remaining -= stop
                continue
        square = duration * duration
        distance += v * duration + 0.5 * a * square + jerk * (square * duration) / 6.0
        v = max(v + a * duration + 0.5 * jerk * square, 0.0)
        a = goal if duration < remaining else reached
        remaining -= duration
    return (target if abs(a - target) < _SAME else a), v, distance


@kernel
def _ramp(a: float, target: float, limits: Any) -> tuple[float, float]:
    """Next acceleration on the way from `a` to `target`, m/s2, and the rate towards it, m/s3; the
    rate is 0 if `target` is reached.
    """
    if abs(a - target) < _SAME:
        return a, 0.0
    if target < a:
        return target, -limits.brake_jerk
    if a < 0.0:  # brakes are released as fast as they build up; drive begins only after that
        return min(target, 0.0), limits.brake_jerk
    return target, limits.drive_jerk


@kernel
def _time_to_stop(v: float, a: float, jerk: float, duration: float) -> float:
    """First time within `duration` at which v + a t + jerk t^2 / 2 falls to 0, s; -1: never."""
    discriminant = a * a - 2.0 * jerk * v
    if discriminant < 0.0:
        return -1.0
    if a < 0.0:  # the smaller root, in the form without a difference of nearly equal numbers
        time = 2.0 * v / (math.sqrt(discriminant) - a)
    elif jerk < 0.0:
        time = (math.sqrt(discriminant) + a) / -jerk
    else:
        return -1.0
    return time if time <= duration else -1.0


@kernel
def _along_arc(at: Any, distance: float, curvature: float, wheelbase: float) -> None:
    """Move centre and heading to where the rear axle has rolled `distance` along an arc of
    `curvature`.

    at: x, y and heading of the centre, which is half a wheelbase ahead of the rear axle.
    """
    c, s = math.cos(at.heading), math.sin(at.heading)
    if curvature == 0.0:
        at.x += distance * c
        at.y += distance * s
        return
    half = 0.5 * wheelbase
    turn = distance * curvature
    chord = distance if abs(turn) < 1e-12 else distance * math.sin(0.5 * turn) / (0.5 * turn)
    at.x += chord * math.cos(at.heading + 0.5 * turn) - half * c
    at.y += chord * math.sin(at.heading + 0.5 * turn) - half * s
    at.heading += turn
    at.x += half * math.cos(at.heading)
    at.y += half * math.sin(at.heading)
