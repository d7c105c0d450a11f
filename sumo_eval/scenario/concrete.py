"""A concrete scenario: one point of a space, as plain data for SUMO to be set up from and a child process to receive.

Positions are vehicle centres in road coordinates: x along the road, y to the left, y = 0 on the right lane's centre
line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sumo_eval.errors import must_be
from sumo_eval.trajectory import FloatArray


@dataclass(frozen=True, slots=True)
class Road:
    """A straight road. The ego is judged from its start to x = `length`; `run_out` lets faster vehicles drive on, m."""

    name: str
    length: float
    lanes: int
    lane_width: float
    run_out: float
    speed_limit: float = 60.0

    @property
    def right_edge(self) -> float:
        """y of the right road edge, m."""
        return -self.lane_width / 2

    @property
    def left_edge(self) -> float:
        """y of the left road edge, m."""
        return self.lane_width * (self.lanes - 0.5)

    def lane_centre(self, lane: int) -> float:
        """y of a lane's centre line, m; lane 0 is the right-hand one."""
        return self.lane_width * lane


@dataclass(frozen=True, slots=True)
class Start:
    """Where a vehicle begins: centre (x, y) m and speed m/s, heading along the road."""

    x: float
    y: float
    speed: float


def smooth_step(share: FloatArray | float) -> FloatArray:
    """Share of a lateral move done after a share of its duration: 10 s^3 - 15 s^4 + 6 s^5, at rest at both ends."""
    s = np.clip(share, 0.0, 1.0)
    return s**3 * (10.0 + s * (-15.0 + 6.0 * s))


def smooth_step_rate(share: FloatArray | float) -> FloatArray:
    """Derivative of `smooth_step` by its argument; peaks at 1.875."""
    s = np.clip(share, 0.0, 1.0)
    return 30.0 * s**2 * (1.0 - s) ** 2


@dataclass(frozen=True, slots=True)
class LaneChange:
    """A lateral move: begins at `begin` s, takes `duration` s, ends `offset` m to the left (negative: right)."""

    begin: float
    duration: float
    offset: float

    def lateral(self, time: float) -> float:
        """Offset already covered at a time, m."""
        return float(self.offset * smooth_step((time - self.begin) / self.duration))

    def lateral_speed(self, time: float) -> float:
        """Lateral speed at a time, m/s."""
        return float(self.offset / self.duration * smooth_step_rate((time - self.begin) / self.duration))


@dataclass(frozen=True, slots=True)
class Actor:
    """Another vehicle: keeps its speed, and performs its lane changes as scripted."""

    name: str
    start: Start
    lane_changes: tuple[LaneChange, ...] = ()
    length: float = 4.5
    width: float = 1.8

    def y(self, time: float) -> float:
        """Lateral position of the centre at a time, m."""
        return self.start.y + sum(move.lateral(time) for move in self.lane_changes)

    def lateral_speed(self, time: float) -> float:
        """Lateral speed at a time, m/s."""
        return sum(move.lateral_speed(time) for move in self.lane_changes)


@dataclass(frozen=True, slots=True)
class ConcreteScenario:
    """One point of a logical scenario: parameter values by name, exposure p_i, the road and every vehicle's start."""

    scenario: str
    values: Mapping[str, float]
    exposure: float
    road: Road
    ego: Start
    actors: tuple[Actor, ...]

    def __post_init__(self) -> None:
        names = ["ego", *(actor.name for actor in self.actors)]
        if len(set(names)) < len(names):
            raise must_be("The names of the vehicles", f"scenario `{self.scenario}`", "distinct", ", ".join(names))

    @property
    def label(self) -> str:
        """`ego_speed=30, gap=40`: the point in words."""
        return ", ".join(f"{name}={value:g}" for name, value in self.values.items())
