"""CARLA-style agents: `run_step(...)` returns something with `throttle`, `brake` and `steer`.

CARLA's frame is left-handed: y to the right, yaw clockwise in degrees, steer positive to the right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fnmatch import fnmatchcase
from importlib import import_module
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import numpy as np
from other_tools import found_agent, made_agent, positional, takes, vector

from sumo_eval.cosim.doors.controller import Briefing
from sumo_eval.cosim.doors.observation import Observation
from sumo_eval.cosim.vehicle_model import Command, Pedals
from sumo_eval.errors import ControllerError, InputError

_NAME = "carla_agent.py:CarlaAgent"
_PLAIN = SimpleNamespace(
    Location=lambda x=0.0, y=0.0, z=0.0: vector(x, y),
    Vector3D=lambda x=0.0, y=0.0, z=0.0: SimpleNamespace(x=x, y=y, z=z),
    Rotation=lambda pitch, yaw, roll: SimpleNamespace(pitch=pitch, yaw=yaw, roll=roll),
    Transform=lambda location, rotation: SimpleNamespace(location=location, rotation=rotation),
    BoundingBox=lambda location, extent: SimpleNamespace(location=location, extent=extent),
)
carla: Any = import_module("carla") if find_spec("carla") else _PLAIN
"""CARLA's own classes where its package is installed."""


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
        self._pose = x, -y, -math.degrees(heading)
        self._velocity = carla.Vector3D(speed * c, speed * s, 0.0)
        self._acceleration = carla.Vector3D(acceleration * c, acceleration * s, 0.0)
        self.bounding_box = carla.BoundingBox(
            carla.Location(), carla.Vector3D(length / 2.0, width / 2.0, 0.75)
        )

    def get_location(self) -> Any:
        """Its centre, m."""
        return carla.Location(*self._pose[:2])

    def get_transform(self) -> Any:
        """`location` and `rotation`."""
        return carla.Transform(self.get_location(), carla.Rotation(0.0, self._pose[2], 0.0))

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
        self.road: Any = None

    def look(self, seen: Observation) -> None:
        """Take in one instant."""
        me = seen.ego
        self.show(me.x, me.y, me.heading, me.speed, me.acceleration, me.length, me.width)
        self._seen, self._limit, self._time = [], seen.speed_limit, seen.time
        for it in seen.vehicles:
            other = Actor(it.number, it.kind)
            # 1 mm aside: CARLA's agents see nothing at an angle of exactly 0
            other.show(
                it.x, it.y - 1e-3, it.heading, it.speed, it.acceleration, it.length, it.width
            )
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

    def get_map(self) -> Any:
        """The road as a `carla.Map`, along and across which places are."""
        return carla.Map("road", _opendrive(self.road))

    def get_snapshot(self) -> Any:
        """`timestamp.elapsed_seconds`."""
        return SimpleNamespace(timestamp=SimpleNamespace(elapsed_seconds=self._time))

    def get_actors(self) -> Actors:
        """Itself and the vehicles that are seen."""
        return Actors([self, *self._seen])


def _opendrive(road: Any) -> str:
    """Straight lanes, 200 m before the start and 50 m past its end, and a road behind them: where a road leads
    nowhere, CARLA's planner finds no route."""

    def part(number: int, begin: float, end: float, link: str) -> str:
        mark = '<roadMark sOffset="0" type="broken" laneChange="both"/>'
        other, at = ("start", 1) if link == "successor" else ("end", 0)
        lanes = "".join(
            f'<lane id="{-1 - k}" type="driving" level="false"><link><{link} id="{-1 - k}"/></link>'
            f'<width sOffset="0" a="{road.lane_width}" b="0" c="0" d="0"/>{mark}</lane>'
            for k in range(road.lanes)
        )
        return (
            f'<road id="{number}" length="{end - begin}" junction="-1"><link><{link} '
            f'elementType="road" elementId="{at}" contactPoint="{other}"/></link><planView>'
            f'<geometry s="0" x="{begin}" y="{road.left_edge}" hdg="0" length="{end - begin}">'
            '<line/></geometry></planView><lanes><laneSection s="0"><center><lane id="0" '
            f'type="none">{mark}</lane></center><right>{lanes}</right></laneSection></lanes></road>'
        )

    end = road.length + 50.0
    return (
        "<OpenDRIVE><header><geoReference>+proj=tmerc +lat_0=0 +lon_0=0</geoReference></header>"
        f"{part(0, -200.0, end, 'successor')}{part(1, end, end + 10.0, 'predecessor')}</OpenDRIVE>"
    )


class Actors(list[Actor]):
    """A list of actors that can be filtered, in the form of `carla.ActorList`."""

    def filter(self, pattern: str) -> Actors:
        """The actors whose type a pattern names: `*vehicle*`, `walker.*`, or a part of it."""
        return Actors(
            it for it in self if pattern in it.type_id or fnmatchcase(it.type_id, pattern)
        )


class CarlaAgent:
    """Drives an agent that has `run_step()` or `run_step(input_data, timestamp)`.

    agent: a class, an object or the name of one. Its constructor receives the options, and
        `vehicle` if it takes one. A leaderboard's agent is made for each case, as the leaderboard
        does: constructor, `setup(config)`, `sensors()`, `set_global_plan`.
    config: the file that `setup` receives.
    """

    def __init__(self, agent: Any = None, config: str = "", **options: Any) -> None:
        self._kind = found_agent(agent, "run_step", _NAME)
        self._options, self._config, self._ego = options, config, Ego()
        # an agent that takes its vehicle looks at its road at once
        self._begins = isinstance(self._kind, type) and takes(self._kind, "vehicle")
        self.agent: Any = None
        if not self._begins:
            self._make()

    def _make(self) -> None:
        """A fresh agent, and its sensors."""
        kind, own = self._kind, dict(self._options)
        if isinstance(kind, type):
            usual = {"vehicle": self._ego, "carla_host": "", "carla_port": 0}
            usual |= {"path_to_conf_file": self._config}
            own = {name: it for name, it in usual.items() if takes(kind, name)} | own
        self.agent = made_agent(kind, own, _NAME)
        if callable(begin := getattr(self.agent, "setup", None)):
            begin(self._config)
        declared = getattr(self.agent, "sensors", None)
        self._sensors = list(declared()) if callable(declared) else []
        for sensor in self._sensors:
            if sensor["type"] not in SENSORS:
                raise InputError(
                    f"Sensor `{sensor['id']}` of {type(self.agent).__name__} must be one of "
                    f"{', '.join(SENSORS)}: {sensor['type']} is not supported."
                )
        self._arguments = positional(self.agent.run_step)

    def reset(self, scenario: Briefing) -> None:
        """Start a case: a fresh agent of the leaderboard or of a vehicle."""
        self._scenario, self._ego.road = scenario, scenario.road
        self._frame, self._heading, self._time = 0, 0.0, -1.0
        if self._begins:
            self.agent = None
            return
        if isinstance(self._kind, type) and hasattr(self._kind, "setup"):
            self.close()
            self._make()
        self._tell()

    def _tell(self) -> None:
        """Tell the agent the desired speed (km/h), the goal and the plan."""
        goal = carla.Location(self._scenario.goal[0], -self._scenario.goal[1], 0.0)
        if callable(tell := getattr(self.agent, "set_target_speed", None)):
            tell(3.6 * self._scenario.desired_speed)
        if callable(tell := getattr(self.agent, "set_destination", None)):
            tell(goal)
        # a navigation agent has the latter too, for waypoints of its map
        plans = hasattr(self.agent, "setup") or not hasattr(self.agent, "set_destination")
        if plans and callable(tell := getattr(self.agent, "set_global_plan", None)):
            tell(*_route(self._scenario))

    def act(self, seen: Observation) -> Pedals:
        """Show the world, read the pedals.

        Raises ControllerError for what the vehicle does not have.
        """
        self._ego.look(seen)
        if self.agent is None:
            self._make()
            self._tell()
        control = self.agent.run_step(*self._input(seen)[: self._arguments])
        self._frame += 1
        missing = [name for name in ("throttle", "brake", "steer") if not hasattr(control, name)]
        if missing:
            raise ControllerError(
                "`run_step` of the ADS must return throttle, brake and steer, got "
                f"{type(control).__name__} without {', '.join(missing)}"
            )
        if getattr(control, "reverse", False):
            raise ControllerError(
                "`run_step` of the ADS must not ask for `reverse`: the vehicle drives forwards"
            )
        self._ego.obey(control)
        brake = 1.0 if getattr(control, "hand_brake", False) else control.brake
        return Command.pedals(control.throttle, brake, -control.steer)

    def _input(self, seen: Observation) -> tuple[Any, ...]:
        """The arguments of a leaderboard's agent: by sensor (frame, data), and the time, s."""
        me = seen.ego
        step = seen.time - self._time
        yaw_rate = (me.heading - self._heading) / step if self._frame and step > 0.0 else 0.0
        self._heading, self._time = me.heading, seen.time
        data = {
            "speed": {"speed": me.speed},
            "ego": self._ego,
            "actors": self._ego.get_actors()[1:],
            "observation": seen,
        }
        for sensor in self._sensors:
            data[sensor["id"]] = SENSORS[sensor["type"]](sensor, seen, yaw_rate)
        return {name: (self._frame, it) for name, it in data.items()}, seen.time

    def close(self) -> None:
        """Pass on, as the leaderboard's `destroy`."""
        if callable(end := getattr(self.agent, "destroy", None)):
            end()


def _radar(sensor: Mapping[str, Any], seen: Observation, yaw_rate: float) -> Any:
    """A detection for each vehicle, (n, 4): depth m, altitude and azimuth rad (to the right),
    radial speed m/s (positive: it recedes)."""
    me, mount = seen.ego, (float(sensor.get("x", 0.0)), -float(sensor.get("y", 0.0)))
    c, s = math.cos(me.heading), math.sin(me.heading)
    place = np.array([me.x + c * mount[0] - s * mount[1], me.y + s * mount[0] + c * mount[1]])
    facing = me.heading - math.radians(sensor.get("yaw", 0.0))
    half, reach = math.radians(sensor.get("horizontal_fov", 30.0)) / 2.0, sensor.get("range", 100.0)
    rows = []
    for it in seen.vehicles:
        axes = np.array([[math.cos(it.heading), math.sin(it.heading)],
                         [-math.sin(it.heading), math.cos(it.heading)]])  # fmt: skip
        size = 0.5 * np.array([it.length, it.width])
        nearest = np.clip(axes @ (place - (it.x, it.y)), -size, size) @ axes + (it.x, it.y)
        depth = float(np.linalg.norm(nearest - place))
        if not 0.0 < depth <= reach:
            continue
        towards = (nearest - place) / depth
        azimuth = math.remainder(facing - math.atan2(towards[1], towards[0]), math.tau)
        relative = it.speed * axes[0] - me.speed * np.array([c, s])
        if abs(azimuth) <= half:
            rows.append((depth, 0.0, azimuth, float(relative @ towards)))
    return np.array(rows, dtype=np.float32).reshape(-1, 4)


def _gnss(sensor: Mapping[str, Any], seen: Observation, yaw_rate: float) -> Any:
    return np.array([*_degrees(seen.ego.x, seen.ego.y), 0.0])


def _imu(sensor: Mapping[str, Any], seen: Observation, yaw_rate: float) -> Any:
    """Accelerometer, m/s2, gyroscope, rad/s, and compass, rad clockwise from north."""
    me = seen.ego
    compass = (0.5 * math.pi - me.heading) % math.tau
    return np.array([me.acceleration, -me.speed * yaw_rate, 9.81, 0.0, 0.0, -yaw_rate, compass])


SENSORS: dict[str, Callable[[Mapping[str, Any], Observation, float], Any]] = {
    "sensor.speedometer": lambda sensor, seen, yaw_rate: {"speed": seen.ego.speed},
    "sensor.other.radar": _radar,
    "sensor.other.gnss": _gnss,
    "sensor.other.imu": _imu,
}
"""Data of a leaderboard's sensor, in the leaderboard's form."""


def _degrees(x: float, y: float) -> tuple[float, float]:
    """Latitude and longitude of a place, with the origin at 0, 0."""
    radius = 6378137.0  # m, CARLA's
    latitude = 360.0 * math.atan(math.exp(y / radius)) / math.pi - 90.0
    return latitude, math.degrees(x / radius)


def _route(scenario: Briefing) -> tuple[list[Any], list[Any]]:
    """The plan of `set_global_plan`, as GPS and as places: to the goal along its lane."""
    option: Any = SimpleNamespace(name="LANEFOLLOW", value=4)
    if find_spec("agents"):
        option = import_module("agents.navigation.local_planner").RoadOption.LANEFOLLOW
    x, y = scenario.goal
    places = [(at, y) for at in np.arange(0.0, x, 10.0).tolist()] + [(x, y)]
    gps = [dict(zip(("lat", "lon"), _degrees(*it), strict=True), z=0.0) for it in places]
    level = SimpleNamespace(pitch=0.0, yaw=0.0, roll=0.0)
    world = [SimpleNamespace(location=_location(*it), rotation=level) for it in places]
    return [(it, option) for it in gps], [(it, option) for it in world]


def _location(x: float, y: float) -> Any:
    at = vector(x, -y)
    at.distance = lambda to: math.dist((at.x, at.y), (to.x, to.y))
    return at
