"""Plans, speeds and pedals, which an ADS may ask for, and how they are carried out.

A stated tracker drives plans, a first-order law takes up speeds, a linear map reads pedals. One
`Wheel` a case holds what was asked for until it is replaced.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from sumo_eval.cosim.contact import within_a_turn
from sumo_eval.cosim.doors.traci_numbers import finite_number, shown
from sumo_eval.cosim.vehicle_model import Command, Pedals
from sumo_eval.errors import ControllerError, said
from sumo_eval.scenario.road.reference_line import Piece, curvatures
from sumo_eval.settings import SimulationSettings

_NO_WAY = 1e-6  # m, points closer than this are one place


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Where the ego's centre shall be when, until another plan replaces it.

    time: s since the start of the case, increasing.
    x, y: m in road coordinates.
    heading: rad, by default where the path goes.
    speed: m/s, by default what the places and times come to. Sequences or arrays of equal lengths,
        (n,).
    """

    time: Any
    x: Any
    y: Any
    heading: Any = None
    speed: Any = None


Wanted = Command | Pedals | Plan
"""The wishes of an ADS."""

HOLD = object()
"""The answer of an adapter: what was asked for still holds."""


def wanted(answer: object) -> Command | Pedals | Plan:
    """The answer of an ADS, if it is one that can be carried out; its numbers are looked at
    then.
    """
    if isinstance(answer, Command | Pedals | Plan):
        return answer
    if answer is HOLD:
        raise ControllerError("The ADS must give a plan before one can hold")
    kind = type(answer).__name__
    raise ControllerError(f"The ADS must return a Command, Pedals, a Plan or None, got {kind}")


class Wheel:
    """Carries out what the ADS of one case asks for.

    note: puts on record what, the value asked for, the value got.
    line: the road's, where it is curved.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        note: Callable[[str, float, float], None],
        line: tuple[Piece, ...] = (),
    ) -> None:
        self._line = line
        self._law, self._vehicle, self._step = settings.tracker, settings.vehicle, settings.step
        self._note = note
        self._track: _Track | None = None
        self._last: Command | Pedals | None = None

    @property
    def holds(self) -> bool:
        """Whether something that was asked for is in force."""
        return self._track is not None or self._last is not None

    @property
    def holds_plan(self) -> bool:
        """Whether a plan is in force."""
        return self._track is not None

    def release(self) -> None:
        """Nothing is in force."""
        self._track = self._last = None

    def command(self, asked: Wanted | None, ego: Sequence[float], time: float) -> Command:
        """The acceleration and wheel angle for the step that begins at `time` s; None: what was
        asked for still holds.

        ego: centre x, y m, heading rad, speed m/s, and whatever else is known of it.
        Raises ControllerError for what no vehicle can be asked for.
        """
        if isinstance(asked, Plan):
            self._track, self._last = _Track(asked, ego, self._vehicle.wheelbase), None
        elif asked is not None:
            self._track, self._last = None, asked
        if self._track is not None:
            return self._along(self._track, ego, time)
        last = self._last
        if isinstance(last, Pedals):
            return self._pedals(last)
        assert last is not None
        acceleration, steering, speed = _read(last)
        if speed is not None:  # first order: dv/dt = (v_wanted - v) / T
            acceleration = (_finite("speed", speed, "Command") - ego[3]) / self._law.speed_time
        if (
            type(acceleration) is float
            and type(steering) is float
            and math.isfinite(acceleration + steering)
        ):
            # a class of the ADS's own may answer otherwise when it is read again
            return (
                last if type(last) is Command and speed is None else Command(acceleration, steering)
            )
        return Command(
            _finite("acceleration", acceleration, "Command"),
            _finite("steering", steering, "Command"),
        )

    def _pedals(self, asked: Pedals) -> Command:
        """throttle x the strongest drive - brake x the strongest braking; steer x the end stop of
        the wheel.
        """
        limits = self._vehicle
        for name, least in (("throttle", 0.0), ("brake", 0.0), ("steer", -1.0)):
            value = _finite(name, getattr(asked, name), "pedals")
            if not least <= value <= 1.0:
                raise ControllerError(
                    f"`{name}` of the ADS's pedals must be within {least:g}..1, got {shown(value)}"
                )
        pushed = (
            float(asked.throttle) * limits.max_acceleration
            - float(asked.brake) * limits.max_deceleration
        )
        return Command(
            pushed, float(asked.steer) * math.radians(limits.max_steering_wheel_angle_deg)
        )

    def _along(self, track: _Track, ego: Sequence[float], time: float) -> Command:
        """The tracker: Stanley's law for the front axle, and for the speed feed-forward with
        feedback of both errors.

        wheel angle = ratio (theta - heading + atan(k e / (v_s + v)) + atan(wheelbase x curvature of
        the road)),
        e: the path to the left of the front axle, m, theta: its direction there. Source: Hoffmann,
            Tomlin, Montemerlo, Thrun, ACC 2007.
        acceleration = dv_plan/dt + k_v (v_plan - v) + k_s s, s: how far the ego is behind the plan,
        m.
        """
        x, y, heading = ego[:3]
        law, limits = self._law, self._vehicle
        plan = track.at(time)
        there_x, there_y, direction = plan[:3]
        speed, planned = ego[3], plan[3]
        if time > track.end + 1e-9:
            self._note("plan_ended", track.end, time)
        ahead, left = there_x - x, there_y - y
        self._note("plan_error", 0.0, math.sqrt(ahead * ahead + left * left))
        behind = ahead * math.cos(direction) + left * math.sin(direction)
        faster = (track.at(time + self._step)[3] - planned) / self._step
        acceleration = faster + law.speed_gain * (planned - speed) + law.position_gain * behind
        half = 0.5 * limits.wheelbase
        front = x + half * math.cos(heading)
        found = track.beside(front, y + half * math.sin(heading))
        if found is None:  # a plan to stay where it is says nothing of a direction
            return Command(acceleration, 0.0)
        theta, aside = found
        turn = within_a_turn(theta - heading) + math.atan2(
            law.steering_gain * aside, law.softening_speed + speed
        )
        if self._line:  # theta and the heading are along a road that turns itself
            turn += math.atan(limits.wheelbase * float(curvatures(self._line, front)))
        return Command(acceleration, turn * limits.steering_ratio)


class _Track:
    """A plan as the tracker follows it. end: its last time, s."""

    def __init__(self, plan: Plan, ego: Sequence[float], wheelbase: float) -> None:
        time, x, y = (_numbers(name, getattr(plan, name)) for name in ("time", "x", "y"))
        heading = None if plan.heading is None else _numbers("heading", plan.heading)
        speed = None if plan.speed is None else _numbers("speed", plan.speed)
        for name, values in (("x", x), ("y", y), ("heading", heading), ("speed", speed)):
            if values is not None and len(values) != len(time):
                raise ControllerError(
                    f"`{name}` of the ADS's Plan must have as many values as `time`, {len(time)}, "
                    f"got {len(values)}"
                )
        late = next((i for i, (one, two) in enumerate(pairwise(time)) if not two > one), None)
        if late is not None:
            raise ControllerError(
                f"`time` of the ADS's Plan must increase, got {time[late + 1]:g} s behind "
                f"{time[late]:g} s"
            )
        self.end = time[-1]
        self._time, self._x, self._y = time, x, y
        self._heading = (
            _directions(x, y, ego[2]) if heading is None else np.unwrap(heading).tolist()
        )
        self._speed = _speeds(time, x, y, ego[3]) if speed is None else speed
        half = 0.5 * wheelbase
        self._front_x = [
            at + half * math.cos(psi) for at, psi in zip(x, self._heading, strict=True)
        ]
        self._front_y = [
            at + half * math.sin(psi) for at, psi in zip(y, self._heading, strict=True)
        ]
        self._tangent = _directions(self._front_x, self._front_y, self._heading[0])
        self._now = self._place = 0  # the segments where it was last: time and places go on

    def at(self, time: float) -> tuple[float, float, float, float]:
        """x, y, heading and speed at a time; before its first and behind its last point straight on
        at that speed.
        """
        times, last = self._time, len(self._time) - 1
        if last == 0 or time <= times[0] or time >= times[last]:
            i = 0 if time <= times[0] else last
            driven = self._speed[i] * (time - times[i])
            psi = self._heading[i]
            return (
                self._x[i] + driven * math.cos(psi),
                self._y[i] + driven * math.sin(psi),
                psi,
                self._speed[i],
            )
        i = self._now
        while times[i + 1] < time:
            i += 1
        self._now = max(i - 1, 0)
        share = (time - times[i]) / (times[i + 1] - times[i])

        def within(values: Sequence[float]) -> float:
            return values[i] + share * (values[i + 1] - values[i])

        return within(self._x), within(self._y), within(self._heading), within(self._speed)

    def beside(self, x: float, y: float) -> tuple[float, float] | None:
        """Direction of the front axle's path beside a place, rad, and how far it is to the left of
        it, m.
        """
        xs, ys, i = self._front_x, self._front_y, self._place
        last = len(xs) - 2
        on = None
        while i <= last:
            along_x, along_y = xs[i + 1] - xs[i], ys[i + 1] - ys[i]
            square = along_x * along_x + along_y * along_y
            if square > _NO_WAY * _NO_WAY:
                share = ((x - xs[i]) * along_x + (y - ys[i]) * along_y) / square
                on = i, share, (along_x * (ys[i] - y) - along_y * (xs[i] - x)) / math.sqrt(square)
                if share <= 1.0:
                    break
            i += 1
        if on is None:
            return None
        self._place, share, left = on
        share = min(max(share, 0.0), 1.0)
        theta = self._tangent[self._place]
        return theta + share * (self._tangent[self._place + 1] - theta), left


def _directions(x: Sequence[float], y: Sequence[float], at_rest: float) -> list[float]:
    """Where a path goes at each of its points, rad, without jumps: from the point before to the
    point behind.
    """
    found: list[float] = []
    last = at_rest
    for i in range(len(x)):
        a, b = max(i - 1, 0), min(i + 1, len(x) - 1)
        along, across = x[b] - x[a], y[b] - y[a]
        if abs(along) > _NO_WAY or abs(across) > _NO_WAY:
            last += within_a_turn(math.atan2(across, along) - last)
        found.append(last)
    # the ends turn on as the path does beside them
    for end, one in ((0, 1), (-1, -2)) if len(x) > 2 else ():
        if math.hypot(x[one] - x[end], y[one] - y[end]) > _NO_WAY:
            found[end] += found[end] - found[one]
    return found


def _speeds(
    time: Sequence[float], x: Sequence[float], y: Sequence[float], alone: float
) -> list[float]:
    """Speeds that places and times come to, m/s; of a single point the one that the ego has."""
    if len(time) == 1:
        return [alone]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    speeds: list[float] = np.gradient(way, time, edge_order=2 if len(time) > 2 else 1).tolist()
    return [max(speed, 0.0) for speed in speeds]


def _numbers(name: str, values: Any) -> list[float]:
    plain = values.tolist() if hasattr(values, "tolist") else values
    if not isinstance(plain, list | tuple) or not plain:
        raise ControllerError(
            f"`{name}` of the ADS's Plan must be a sequence of numbers, got {shown(plain)}"
        )
    return [_finite(name, value, "Plan") for value in plain]


def _finite(name: str, value: Any, owner: str) -> float:
    number = value if type(value) is float and math.isfinite(value) else finite_number(value)
    if number is None:
        raise ControllerError(
            f"`{name}` of the ADS's {owner} must be a finite number, got {shown(value)}"
        )
    return number


def _read(command: Command) -> tuple[Any, Any, Any]:
    """Acceleration, steering and speed of a command, which may be of a class of the ADS's own
    making.
    """
    try:
        return command.acceleration, command.steering, command.speed
    except Exception as error:
        raise ControllerError(f"The ADS's Command cannot be read ({said(error)})") from error
