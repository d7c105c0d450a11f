"""ADSs and people whose rule is a kernel: the door between their objects and the loop that drives them.

An object of such a class holds what was given to it and nothing of a case: what it remembers of a case stands in arrays
that the loop keeps, a row each. The same object can be driven through TraCI, a step at a time; that is one row too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from sumo_eval.cosim.records import EGO, MOVER, Records
from sumo_eval.cosim.step_rules import show
from sumo_eval.cosim.sumo.insides import vehicles
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.cosim.world import described, write_way
from sumo_eval.kernels import rows as compiled_rows
from sumo_eval.scenario.road.reference_line import frame_places, knots_of


@compiled_rows
def _show_rows(movers: Records, bodies: Any, line: Records, rear: float) -> None:
    for i in range(len(movers)):
        body = bodies[i]
        own = rear if i == 0 else 0.0
        show(movers[i], body[0], body[1], body[2], body[3], body[4], body[5], line, own)


def records(objects: Sequence[Any], layout: list[tuple[str, Any]]) -> Records:
    """A record for each object, of its attributes."""
    rows = [tuple(getattr(each, name) for name, _ in layout) for each in objects]
    return np.array(rows, dtype=layout)


def unknown(count: int, others: int, layout: list[tuple[str, Any]]) -> Records:
    """Memories of vehicles that nobody has seen yet, (count, others): nan in every field that is a number."""
    found = np.zeros((count, others), layout)
    for name, kind in layout:
        if kind == "f8":
            found[name] = np.nan
    return found


class Compiled:
    """Base of what ships.

    loop: the rows of its rule, called with the egos, what is seen of the others, the arrays, the scenario and the time;
    writes the egos' commands, and whether they have settled.
    """

    loop: ClassVar[Callable[..., None]]

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """What the loop wants between what is seen and the scenario, a row for each of these objects.

        scenario: a `SCENARIO` record in an array of one. others: how many other vehicles there are.
        """
        raise NotImplementedError

    @classmethod
    def rides(cls, target: Any) -> bool:
        """Whether an object is driven by its loop: a subclass with a `step` of its own is not."""
        own = type(target)
        return isinstance(target, Compiled) and own.step is Compiled.step and own.reset is Compiled.reset

    def reset(self, scenario: Any, traci: Any, ego: str) -> None:
        """Begin a case that is driven through TraCI."""
        self._scenario = described(scenario.road, scenario.vehicle, scenario.step)
        self._line, self._way = scenario.road.line, scenario.way
        self._along: list[float] | None = None
        self._names: tuple[str, ...] | None = None

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """One row of the loop, with what TraCI shows."""
        calls = vehicles(traci)
        if self._names is None:
            self._names = tuple(name for name in traci.vehicle.getIDList() if name != ego)
            self._own = type(self).arrays([self], self._scenario, len(self._names))
            self._egos, self._seen = np.zeros(1, EGO), np.zeros((1, len(self._names)), MOVER)
            self._egos["live"] = 1
            self._sizes = [(traci.vehicle.getLength(n), traci.vehicle.getWidth(n)) for n in (ego, *self._names)]
        bodies = np.array(
            [(*_pose(calls, name, size[0]), *size) for name, size in zip((ego, *self._names), self._sizes, strict=True)]
        )
        movers = np.zeros(len(bodies), MOVER)
        rear = 0.5 * float(self._scenario["vehicle"]["wheelbase"][0])
        _show_rows(movers, self._in_frame(bodies), knots_of(self._line), rear)
        if time == 0.0:
            self._egos["way"]["start"], self._egos["way"]["length"] = movers["y"][0], 1.0
            if self._way is not None:
                write_way(self._egos[0], self._way, float(movers["y"][0]), float(movers["speed"][0]))
        self._egos["seen"][0] = movers[0]
        self._seen[0] = movers[1:]
        type(self).loop(self._egos, self._seen, *self._own, self._scenario, time)
        command = self._egos["command"][0]
        self._egos["steering"] = command["steering"]
        return Command(float(command["acceleration"]), float(command["steering"]))

    def _in_frame(self, bodies: Any) -> Any:
        """Bodies with their places and headings along and across the road, of which SUMO shows those on the map."""
        if not self._line:
            return bodies
        if self._along is None:
            self._along = frame_places(self._line, bodies[:, 0], bodies[:, 1])[0].tolist()
        for i, near in enumerate(self._along):
            x, y, heading = frame_places(self._line, bodies[i, 0], bodies[i, 1], bodies[i, 2], near=near)
            bodies[i, :3], self._along[i] = (x, y, heading), float(x)
        return bodies

    def settled(self) -> bool:
        """Whether nothing more will come of it in a case that is driven through TraCI."""
        return bool(self._egos["settled"][0])


def _pose(calls: Any, name: str, length: float) -> tuple[float, float, float, float]:
    """Centre, heading and speed of a vehicle of which SUMO shows the front bumper and an angle clockwise from north."""
    x, y = calls.getPosition(name)
    heading = np.radians(90.0 - calls.getAngle(name))
    return x - 0.5 * length * np.cos(heading), y - 0.5 * length * np.sin(heading), heading, calls.getSpeed(name)
