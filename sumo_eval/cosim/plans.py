"""Plans, speeds and pedals that an ADS may request, and how they become accelerations and steering
wheel angles.

A tracker follows plans (`Executor._along` states its law), a first-order law reaches speeds, a
linear map reads pedals. One `Executor` a case holds the last request until a new one arrives.

Users: `cosim/doors/controller.py`, `cosim/doors/fmu.py`, `cosim/doors/json_lines.py`,
`cosim/on_traci.py`, `cosim/policies.py`, `record/watch.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import atan, atan2, cos, hypot, isfinite, radians, sin, sqrt
from typing import Any

import numpy as np

from sumo_eval.cosim.doors.traci_numbers import finite_number, shown
from sumo_eval.cosim.records import SAME_TIME
from sumo_eval.cosim.vehicle_model import Command, Pedals
from sumo_eval.errors import ControllerError, said
from sumo_eval.frozen import frozen
from sumo_eval.scenario.road.reference_line import Line, curvatures
from sumo_eval.scenario.touch import within_a_turn
from sumo_eval.settings import SimulationSettings

_Numbers = Sequence[float]  # of an ego (x, y, heading, speed, ...), or one field of a plan
_SAME_PLACE = 1e-6  # m, points closer than this are the same place
_LARGEST = 1e9  # of a plan's numbers, in their units: products of much larger ones are not finite


@frozen(eq=False)
class Plan:
    """Places of the ego's centre over time. It holds until another plan replaces it.

    time: s since the start of the case, increasing.
    x, y: m in road coordinates.
    heading: rad, by default the direction of the path.
    speed: m/s, by default the speed between the places.

    All are sequences or arrays of the same length, (n,).
    """

    time: Any
    x: Any
    y: Any
    heading: Any = None
    speed: Any = None


Wanted = Command | Pedals | Plan
"""A request of an ADS."""


def checked_answer(answer: object) -> Wanted:
    """The answer of an ADS as a request; `Executor.command` checks its numbers.

    Raises ControllerError for an answer of any other kind.
    """
    if isinstance(answer, Wanted):
        return answer
    kind = type(answer).__name__
    raise ControllerError(f"The ADS must return a Command, Pedals, a Plan or None, got {kind}")


class Executor:
    """Carries out the requests of the ADS of one case.

    note: records an event: its name, the requested value, the applied value.
    line: the road's; empty where the road is straight.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        note: Callable[[str, float, float], None],
        line: Line = (),
    ) -> None:
        self._line = line
        self._gains, self._vehicle, self._step = settings.tracker, settings.vehicle, settings.step
        self._note = note
        self._in_force: _FollowedPlan | Command | Pedals | None = None
        # whether a plan is in force, or was late: then None as answer means that the plan holds
        self.holds_plan = False

    @property
    def holds(self) -> bool:
        """Whether a request is in force."""
        return self._in_force is not None

    def release(self) -> None:
        """Drop the request in force."""
        self._in_force = None
        self.holds_plan = False

    def command(
        self, request: Wanted | None, ego: _Numbers, time: float, *, late: bool = False
    ) -> Command:
        """The acceleration and steering-wheel angle for the step that begins at `time` s.

        request: the new one; None: the last request still holds (`holds`).
        ego: its centre x, y, m, heading, rad, and speed, m/s; further numbers are not read.
        late: drop the new request. The request in force holds; without one, the ego keeps its
            speed with straight wheels.
        Raises ControllerError for a request that no vehicle can carry out.
        """
        if late:
            if self._in_force is None:
                self._in_force = Command(0.0)
            self.holds_plan |= isinstance(request, Plan)
        elif request is not None:
            self._in_force = (
                _FollowedPlan(request, ego, self._vehicle.wheelbase)
                if isinstance(request, Plan)
                else request
            )
            self.holds_plan = isinstance(request, Plan)
        held = self._in_force
        if isinstance(held, _FollowedPlan):
            return self._along(held, ego, time)
        if isinstance(held, Pedals):
            return self._pedals(held)
        assert held is not None
        acceleration, steering, speed = _read(held)
        if speed is not None:
            acceleration = self._towards(speed, ego[3])
        # the usual case, in a quick way: the command as it is. Objects of an ADS's own class are
        # copied, as their attributes may have other values when they are read again.
        if (
            type(held) is Command
            and speed is None
            and type(acceleration) is float
            and type(steering) is float
            and isfinite(acceleration + steering)
        ):
            return held
        return Command(
            _finite("acceleration", acceleration, "Command"),
            _finite("steering", steering, "Command"),
        )

    def _towards(self, requested_speed: Any, speed: float) -> float:
        """Acceleration towards a speed, m/s2: dv/dt = (requested speed - v) / T, of T =
        `speed_time`.
        """
        number = _finite("speed", requested_speed, "Command")
        if number < 0.0:  # the ego brakes to a standstill: no vehicle here drives backwards
            self._note("negative_speed", number, 0.0)
        return (number - speed) / self._gains.speed_time

    def _pedals(self, pedals: Pedals) -> Command:
        """acceleration = throttle * max_acceleration - brake * max_deceleration; steering-wheel
        angle = steer * end stop, positive to the left.
        """
        limits = self._vehicle
        values = []
        for name, least in (("throttle", 0.0), ("brake", 0.0), ("steer", -1.0)):
            value = _finite(name, getattr(pedals, name), "pedals")
            if not least <= value <= 1.0:
                raise ControllerError(
                    f"`{name}` of the ADS's pedals must be within {least:g}..1, got {shown(value)}"
                )
            values.append(value)
        throttle, brake, steer = values
        acceleration = throttle * limits.max_acceleration - brake * limits.max_deceleration
        return Command(acceleration, steer * radians(limits.max_steering_wheel_angle_deg))

    def _along(self, track: _FollowedPlan, ego: _Numbers, time: float) -> Command:
        """The tracker: Stanley's law for the front axle, feed-forward and feedback for the speed.

        steering-wheel angle = steering ratio * angle of the front wheels
        angle of the front wheels = theta - heading + atan(k e / (v_s + v))
            + atan(wheelbase * curvature)
        acceleration = dv_plan/dt + k_v (v_plan - v) + k_s s

        e: m from the front axle to the path, positive where the path is to the left.
        theta: direction of the path beside the front axle, rad.
        heading, v: of the ego, rad and m/s. v_plan: speed of the plan at `time`, m/s.
        curvature: of the road's line, the right lane's centre line, 1/m.
        s: m by which the ego is behind the plan.
        k, v_s, k_v, k_s: `steering_gain`, `softening_speed`, `speed_gain` and `position_gain` of
            `TrackerSettings`.

        Source: Hoffmann, Tomlin, Montemerlo, Thrun, ACC 2007.
        """
        x, y, heading = ego[:3]
        speed = ego[3]
        gains = self._gains
        limits = self._vehicle
        (plan_x, plan_y), direction, plan_speed = track.at(time)
        dx, dy = plan_x - x, plan_y - y
        behind = dx * cos(direction) + dy * sin(direction)
        next_speed = track.at(time + self._step)[2]
        acceleration = (
            (next_speed - plan_speed) / self._step  # dv_plan/dt, m/s2
            + gains.speed_gain * (plan_speed - speed)
            + gains.position_gain * behind
        )
        _finite("acceleration", acceleration, "Plan")  # of times that hardly differ it is not
        if time > track.end + SAME_TIME:
            self._note("plan_ended", track.end, time)
        if plan_speed < 0.0:  # as in `_towards`
            self._note("negative_speed", plan_speed, 0.0)
        self._note("plan_error", 0.0, sqrt(dx * dx + dy * dy))
        half = 0.5 * limits.wheelbase
        front = x + half * cos(heading)  # x of the front axle, m
        path = track.beside(front, y + half * sin(heading))
        # A plan whose places are all the same has no direction to follow: the wheels stay straight,
        # even where the road is curved.
        if path is None:
            return Command(acceleration, 0.0)
        theta, aside = path
        turn = within_a_turn(theta - heading) + atan2(
            gains.steering_gain * aside, gains.softening_speed + speed
        )
        # theta and heading are relative to the road, so its curvature has to be added
        if self._line:
            turn += atan(limits.wheelbase * curvatures(self._line, front))
        return Command(acceleration, turn * limits.steering_ratio)


class _FollowedPlan:
    """A plan as the tracker follows it.

    end: its last time, s.
    ego: as of `Executor.command`; its heading serves where the path does not move, its speed where
        the plan has one place.
    """

    def __init__(self, plan: Plan, ego: _Numbers, wheelbase: float) -> None:
        numbers = _checked_fields(plan)
        time, x, y = numbers["time"], numbers["x"], numbers["y"]
        self.end = time[-1]
        self._time, self._x, self._y = time, x, y
        ego_heading, ego_speed = ego[2:4]
        self._heading = (
            np.unwrap(numbers["heading"]).tolist()
            if "heading" in numbers
            else _directions(x, y, ego_heading)
        )
        self._speed = numbers.get("speed") or _speeds(time, x, y, ego_speed)
        half = 0.5 * wheelbase
        self._front_x = [it + half * cos(psi) for it, psi in zip(x, self._heading, strict=True)]
        self._front_y = [it + half * sin(psi) for it, psi in zip(y, self._heading, strict=True)]
        self._tangent = _directions(self._front_x, self._front_y, self._heading[0])
        # segments of the last results of `at` and of `beside`: the next search begins there, and
        # goes forward only
        self._segment_in_time = self._segment_in_place = 0

    def at(self, time: float) -> tuple[tuple[float, float], float, float]:
        """Place, heading and speed at a time; outside the plan's times along the straight line
        through its first or last point, at that point's speed.
        """
        times = self._time
        if not times[0] < time < times[-1]:
            i = 0 if time <= times[0] else -1
            driven = self._speed[i] * (time - times[i])
            psi = self._heading[i]
            place = self._x[i] + driven * cos(psi), self._y[i] + driven * sin(psi)
            return place, psi, self._speed[i]
        i = self._segment_in_time
        while times[i + 1] < time:
            i += 1
        # one back: the tracker also calls for one step ahead, and by rounding the next step's call
        # may be for a slightly earlier time
        self._segment_in_time = max(i - 1, 0)
        share = (time - times[i]) / (times[i + 1] - times[i])

        def within(values: _Numbers) -> float:
            return values[i] + share * (values[i + 1] - values[i])

        return (within(self._x), within(self._y)), within(self._heading), within(self._speed)

    def beside(self, x: float, y: float) -> tuple[float, float] | None:
        """Direction of the front axle's path beside a place, rad, and m by which the path lies to
        the left of the place; None where the path has no length.

        x, y: of the place, m.
        """
        xs, ys = self._front_x, self._front_y
        nearest = None
        # the first segment whose end is not behind the place, else the last one
        for i in range(self._segment_in_place, len(xs) - 1):
            along_x, along_y = xs[i + 1] - xs[i], ys[i + 1] - ys[i]
            square = along_x * along_x + along_y * along_y
            if square > _SAME_PLACE * _SAME_PLACE:
                share = ((x - xs[i]) * along_x + (y - ys[i]) * along_y) / square
                across = along_x * (ys[i] - y) - along_y * (xs[i] - x)  # cross product
                nearest = i, share, across / sqrt(square)
                if share <= 1.0:
                    break
        if nearest is None:
            return None
        i, share, left = nearest
        self._segment_in_place = i
        share = min(max(share, 0.0), 1.0)
        theta = self._tangent[i]
        return theta + share * (self._tangent[i + 1] - theta), left


def _checked_fields(plan: Plan) -> dict[str, list[float]]:
    """The fields of a plan that are given, as numbers; all of one length, with increasing times."""
    numbers = {name: _numbers_of(name, getattr(plan, name)) for name in ("time", "x", "y")}
    for name in ("heading", "speed"):
        if getattr(plan, name) is not None:
            numbers[name] = _numbers_of(name, getattr(plan, name))
    time = numbers["time"]
    for name, values in numbers.items():
        if len(values) != len(time):
            raise ControllerError(
                f"`{name}` of the ADS's Plan must have as many values as `time`, {len(time)}, "
                f"got {len(values)}"
            )
    for before, after in pairwise(time):
        if not after > before:
            raise ControllerError(
                f"`time` of the ADS's Plan must increase, got {after:g} s behind {before:g} s"
            )
    return numbers


def _directions(x: _Numbers, y: _Numbers, first_heading: float) -> list[float]:
    """Direction of a path at each of its points, rad, without jumps: from the point before to the
    point after.

    first_heading: direction at the points before the first movement, rad.
    """
    directions = []
    last = first_heading
    for i in range(len(x)):
        before = max(i - 1, 0)
        after = min(i + 1, len(x) - 1)
        along, across = x[after] - x[before], y[after] - y[before]
        if abs(along) > _SAME_PLACE or abs(across) > _SAME_PLACE:
            last += within_a_turn(atan2(across, along) - last)
        directions.append(last)
    # at an end the chord of one segment is the direction at its middle: extrapolate to the end
    if len(x) > 2:
        for end, inner in ((0, 1), (-1, -2)):
            if hypot(x[inner] - x[end], y[inner] - y[end]) > _SAME_PLACE:
                directions[end] += directions[end] - directions[inner]
    return directions


def _speeds(time: _Numbers, x: _Numbers, y: _Numbers, ego_speed: float) -> list[float]:
    """Speeds of the places over the times, m/s; at a single point the ego's own speed."""
    if len(time) == 1:
        return [ego_speed]
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    speeds = np.gradient(driven, time, edge_order=2 if len(time) > 2 else 1)
    return [max(speed, 0.0) for speed in speeds.tolist()]  # second order may extrapolate below 0


def _numbers_of(name: str, values: Any) -> list[float]:
    """A field of a plan as a list of numbers, each up to `_LARGEST`."""
    plain = values.tolist() if hasattr(values, "tolist") else values
    if not isinstance(plain, Sequence) or isinstance(plain, str) or not plain:
        raise ControllerError(
            f"`{name}` of the ADS's Plan must be a sequence of numbers, got {shown(plain)}"
        )
    numbers = [_finite(name, value, "Plan") for value in plain]
    largest = max(numbers, key=abs)
    if abs(largest) > _LARGEST:
        raise ControllerError(
            f"`{name}` of the ADS's Plan must be within -{_LARGEST:g}..{_LARGEST:g}, got {largest}"
        )
    return numbers


def _finite(name: str, value: Any, owner: str) -> float:
    """A value of a request as a finite number.

    name, owner: of the value, for the error message.
    """
    number = value if type(value) is float and isfinite(value) else finite_number(value)
    if number is None:
        raise ControllerError(
            f"`{name}` of the ADS's {owner} must be a finite number, got {shown(value)}"
        )
    return number


def _read(command: Command) -> tuple[Any, Any, Any]:
    """Acceleration, steering and speed of a command, whose class may be one of the ADS."""
    try:
        return command.acceleration, command.steering, command.speed
    except Exception as error:
        raise ControllerError(f"The ADS's Command cannot be read ({said(error)})") from error
