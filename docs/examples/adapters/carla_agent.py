"""CARLA-style agents: `run_step(...)` returns something with `throttle`, `brake` and `steer`.

CARLA's frame is left-handed: y to the right, yaw clockwise in degrees, steer positive to the right.
"""

from __future__ import annotations

import math
from fnmatch import fnmatchcase
from types import SimpleNamespace
from typing import Any

from other_tools import found_agent, made_agent, positional, takes, vector

from sumo_eval.cosim.doors.controller import Briefing
from sumo_eval.cosim.doors.observation import Observation
from sumo_eval.cosim.vehicle_model import Command, Pedals
from sumo_eval.errors import ControllerError

_NAME = "carla_agent.py:CarlaAgent"


class Actor:
    """A vehicle as `carla.Vehicle` shows it: `get_transform()`, `get_velocity()`,
    `bounding_box.extent` and others."""

    def __init__(self, number: int, kind: str = "car") -> None:
        walks = kind in ("pedestrian", "child")
        self.type_id = f"walker.pedestrian.{kind}" if walks else f"vehicle.sumo_eval.{kind}"
        self.id, self.attributes = number, {"role_name": "autopilot"}
        self.show(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0)

    def show(
        self,
        x: float,
        y: float,
        heading: float,
        speed: float,
        acceleration: float,
        length: float,
        width: float,
    ) -> None:
        """Where it is, in road coordinates."""
        c, s = math.cos(heading), -math.sin(heading)
        self._location = vector(x, -y)
        self._rotation = SimpleNamespace(pitch=0.0, yaw=-math.degrees(heading), roll=0.0)
        self._velocity = vector(speed * c, speed * s)
        self._acceleration = vector(acceleration * c, acceleration * s)
        self.bounding_box = SimpleNamespace(
            extent=SimpleNamespace(x=length / 2.0, y=width / 2.0, z=0.75)
        )

    def get_location(self) -> Any:
        """Its centre, m."""
        return self._location

    def get_transform(self) -> Any:
        """`location` and `rotation`."""
        return SimpleNamespace(location=self._location, rotation=self._rotation)

    def get_velocity(self) -> Any:
        """In m/s."""
        return self._velocity

    def get_acceleration(self) -> Any:
        """In m/s2."""
        return self._acceleration


class Ego(Actor):
    """The agent's own vehicle: an actor that also knows its world, the speed limit and its last
    control."""

    def __init__(self) -> None:
        super().__init__(0)
        self.attributes = {"role_name": "hero"}
        self._seen: list[Actor] = []
        self._control: Any = SimpleNamespace(throttle=0.0, brake=0.0, steer=0.0)
        self._limit = math.inf
        self._time = 0.0

    def look(self, seen: Observation) -> None:
        """Take in one instant."""
        me = seen.ego
        self.show(me.x, me.y, me.heading, me.speed, me.acceleration, me.length, me.width)
        self._seen, self._limit, self._time = [], seen.speed_limit, seen.time
        for it in seen.vehicles:
            other = Actor(it.number, it.kind)
            other.show(it.x, it.y, it.heading, it.speed, it.acceleration, it.length, it.width)
            self._seen.append(other)

    def obey(self, control: Any) -> None:
        """Remember what was asked for."""
        self._control = control

    def get_control(self) -> Any:
        """The last control."""
        return self._control

    def get_speed_limit(self) -> float:
        """In km/h, as CARLA has it."""
        return 3.6 * self._limit

    def get_world(self) -> Ego:
        """It stands for its world, too."""
        return self

    def get_snapshot(self) -> Any:
        """`timestamp.elapsed_seconds`."""
        return SimpleNamespace(timestamp=SimpleNamespace(elapsed_seconds=self._time))

    def get_actors(self) -> Actors:
        """Itself and the vehicles that are seen."""
        return Actors([self, *self._seen])


class Actors(list[Actor]):
    """A list of actors that can be filtered, in the form of `carla.ActorList`."""

    def filter(self, pattern: str) -> Actors:
        """The actors whose type a pattern names: `*vehicle*`, `walker.*`, or a part of it."""
        return Actors(
            it for it in self if pattern in it.type_id or fnmatchcase(it.type_id, pattern)
        )


class CarlaAgent:
    """Drives an agent that has `run_step()` or `run_step(input_data, timestamp)`.

    agent: a class, an object or the name of one. Its constructor is given the options, and
        `vehicle` if it takes one."""

    def __init__(self, agent: Any = None, **options: Any) -> None:
        kind = found_agent(agent, "run_step", _NAME)
        self._ego = Ego()
        own = (
            {"vehicle": self._ego, **options}
            if isinstance(kind, type) and takes(kind, "vehicle")
            else options
        )
        self.agent = made_agent(kind, own, _NAME)
        self._arguments = positional(self.agent.run_step)
        self._frame = 0

    def reset(self, scenario: Briefing) -> None:
        """Pass on where the case leads, where the agent wants to know, as CARLA's `set_destination`
        and `set_target_speed` (km/h) do.
        """
        self._frame = 0
        if callable(tell := getattr(self.agent, "set_target_speed", None)):
            tell(3.6 * scenario.desired_speed)
        if callable(tell := getattr(self.agent, "set_destination", None)):
            tell(vector(scenario.goal[0], -scenario.goal[1]))

    def act(self, seen: Observation) -> Pedals:
        """Show the world, read the pedals.

        Raises ControllerError for what the vehicle does not have.
        """
        self._ego.look(seen)
        control = self.agent.run_step(*self._told(seen)[: self._arguments])
        self._frame += 1
        missing = [name for name in ("throttle", "brake", "steer") if not hasattr(control, name)]
        if missing:
            raise ControllerError(
                "`run_step` of the ADS must return throttle, brake and steer, got "
                f"{type(control).__name__} "
                f"without {', '.join(missing)}"
            )
        if getattr(control, "reverse", False):
            raise ControllerError(
                "`run_step` of the ADS must not ask for `reverse`: the vehicle drives forwards"
            )
        self._ego.obey(control)
        brake = 1.0 if getattr(control, "hand_brake", False) else control.brake
        return Command.pedals(control.throttle, brake, -control.steer)

    def _told(self, seen: Observation) -> tuple[Any, ...]:
        """The arguments of a leaderboard's agent: by sensor (frame, data), and the time, s."""
        me = seen.ego
        data = {
            "speed": {"speed": me.speed},
            "ego": self._ego,
            "actors": self._ego.get_actors()[1:],
            "observation": seen,
        }
        return {name: (self._frame, it) for name, it in data.items()}, seen.time

    def close(self) -> None:
        """Pass on, as the leaderboard's `destroy`."""
        if callable(end := getattr(self.agent, "destroy", None)):
            end()
