"""Base of baselines and synthetic drivers: their rule is a kernel that a loop calls for all rows.

An object of such a class holds its parameters alone. Its memory of a case is a row of arrays that
`ego_control.Rules` keeps. Through TraCI, `Compiled.step` makes one row of what TraCI shows and
calls the same loop: so a user's class may wrap a baseline.

Users: `ads/`, `cosim/simulation.py`, `drivers/synthetic/driver.py`, `record/`.
"""

import dataclasses
from collections.abc import Callable, Sequence
from math import isfinite, nan
from typing import Any, ClassVar

import numpy as np

from sumo_eval.cosim.records import BODY, EGO, MOVER
from sumo_eval.cosim.step_rules import first_of, show_body
from sumo_eval.cosim.sumo.insides import vehicles
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.cosim.world import described, way_of
from sumo_eval.errors import must_be
from sumo_eval.kernels import Layout, Records, fields, flags, kernel
from sumo_eval.kernels import rows as compiled_rows
from sumo_eval.scenario.road.reference_line import frame_places, knots_of
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import FloatArray


@compiled_rows
def _show_rows(movers: Records, bodies: Records, line: Records, rear: float) -> None:
    """`show_body` of each body, the ego first; only of the ego a rear axle at `rear` is known."""
    for i in range(len(movers)):
        show_body(movers[i], bodies[i], line, rear if i == 0 else 0.0)


def each_row(rule: Callable[..., None]) -> Callable[..., None]:
    """Make the loop that calls a rule for every live row.

    rule: kernel with six arguments: the ego; the actors, as `MOVER`s; the rule's own record of the
        row; its record of each actor; a `MOVER` of each actor, for the rule's predictions; the two
        `SCENARIO` records.
    """

    @compiled_rows
    def loop(
        egos: Records, seen: Records, own: Records, watched: Records, others_then: Records,
        scenario: Records, time: float,
    ) -> None:  # fmt: skip
        for i in range(len(egos)):
            if egos[i].live:
                at = first_of(scenario, i)
                rule(egos[i], seen[i], own[i], watched[i], others_then[i], scenario[at : at + 2])

    return loop


@kernel
def decides(own: Any, scenario: Any) -> bool:
    """Whether a cycle of decisions begins now. Call once a step.

    own: counts `steps`.
    scenario: two records; the `step` of the second is a cycle, s.
    """
    own.steps += 1
    return bool((own.steps - 1) % round(scenario[-1].step / scenario[0].step) == 0)


def _numbers(thing: Any, layout: Layout) -> tuple[Any, ...]:
    """Attributes of an object as a record; an attribute with a layout becomes a nested record."""
    return tuple(
        _numbers(getattr(thing, name), kind) if isinstance(kind, list) else getattr(thing, name)
        for name, kind in layout
    )


def unseen(count: int, others: int, layout: Layout) -> Records:
    """Records of actors that no rule has seen yet, (count, others): nan in every field of
    `kernels.fields`, 0 in every one of `kernels.flags`.
    """

    def row(layout: Layout) -> tuple[Any, ...]:
        return tuple(
            row(kind) if isinstance(kind, list) else nan if kind == "f8" else 0
            for _, kind in layout
        )

    return np.full((count, others), np.array(row(layout), layout))


def check_numbers(ads: str, rule: Any) -> None:
    """Raise InputError unless each field of an ADS, a dataclass, is finite and at least 0.

    A subclass may hold anything in other attributes.
    """
    for field in dataclasses.fields(rule):
        value = getattr(rule, field.name)
        if not (isfinite(value) and value >= 0.0):
            raise must_be(f"`{field.name}`", f"ADS `{ads}`", "a finite number, at least 0", value)


class Compiled:
    """Base of baselines and synthetic drivers.

    loop: the rule over rows (`each_row`); writes the egos' `command` and `settled`. Call it by way
        of the class: an object would pass itself as the first argument.
    memory: layout of the rule's memory of a case, 0 at first.
    watched: layout of the rule's memory of each actor, nan at first.
    numbers: layout of the rule's parameters: the object's attributes of these names. They become
        the field `p` of the memory.
    """

    loop: ClassVar[Callable[..., None]]
    memory: ClassVar[Layout] = flags("steps")
    watched: ClassVar[Layout] = fields("last_speed")
    numbers: ClassVar[Layout] = fields()
    _decided = False  # on TraCI: whether the rule has decided since `settled` was last asked

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """The arguments `own`, `watched` and `others_then` of `loop`, a row for each object.

        together: the objects, one for each row.
        scenario: the `SCENARIO` records.
        others: number of actors.
        """
        watched = unseen(len(together), others, cls.watched)
        return cls.own_records(together), watched, np.zeros(watched.shape, MOVER)

    @classmethod
    def own_records(cls, together: Sequence[Any]) -> Records:
        """Memory and parameters of each object, (n,)."""
        numbers = cls.numbers
        own = np.zeros(len(together), [*cls.memory, ("p", numbers)] if numbers else cls.memory)
        if numbers:
            own["p"] = np.array([_numbers(each, numbers) for each in together], numbers)
        return own

    @classmethod
    def rides(cls, target: Any) -> bool:
        """Whether the loop over rows can drive an object: its class must not override `step` or
        `reset`.
        """
        own = type(target)
        return (
            isinstance(target, Compiled)
            and own.step is Compiled.step
            and own.reset is Compiled.reset
        )

    def reset(self, scenario: Any, traci: Any, ego: str) -> None:
        """Begin a case that is driven through TraCI."""
        # the interval is not used, but must be whole steps
        settings = SimulationSettings(step=scenario.step, record_interval=scenario.step)
        self._scenario = described(scenario.road, [scenario.vehicle], settings)
        self._line = scenario.road.line
        self._way = scenario.way
        self._along: FloatArray | None = None
        self._sizes: dict[str, tuple[float, float]] = {}  # of each vehicle, the ego first

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """One step of a case on TraCI: makes one row of what TraCI shows, and calls the loop."""
        # a class that wraps this one may call it first at a later time than 0
        is_first = not self._sizes
        if is_first:  # all vehicles are there
            self._begin(traci, ego)
        movers = self._movers(traci)
        egos = self._egos
        egos["time"] = time
        if is_first:
            egos["way"][0] = way_of(self._way, movers["y"][0], movers["speed"][0])
        egos["seen"][0] = movers[0]
        self._seen[0] = movers[1:]
        type(self).loop(egos, self._seen, *self._own, self._scenario, time)
        self._decided = True
        command = egos["command"][0]
        egos["steering"] = command["steering"]
        return Command(float(command["acceleration"]), float(command["steering"]))

    def _begin(self, traci: Any, ego: str) -> None:
        """Make the arrays of a row for the vehicles that are there."""
        others = [name for name in traci.vehicle.getIDList() if name != ego]
        self._own = type(self).arrays([self], self._scenario, len(others))
        self._egos, self._seen = np.zeros(1, EGO), np.zeros((1, len(others)), MOVER)
        self._egos["live"] = 1
        for name in (ego, *others):
            self._sizes[name] = traci.vehicle.getLength(name), traci.vehicle.getWidth(name)

    def _movers(self, traci: Any) -> Records:
        """The vehicles as rules see them, the ego first."""
        calls = vehicles(traci)
        bodies = np.array(
            [
                # 0: TraCI shows no speed across
                (*_pose(calls, name, size[0], traci.TraCIException), *size, 0.0)
                for name, size in self._sizes.items()
            ],
            BODY,
        )
        movers = np.zeros(len(bodies), MOVER)
        rear = 0.5 * self._scenario["vehicle"]["wheelbase"][0]
        _show_rows(movers, self._in_frame(bodies), knots_of(self._line), rear)
        return movers

    def _in_frame(self, bodies: Any) -> Any:
        """Move bodies from the map into the road's frame, in place; return them."""
        if not self._line:
            return bodies
        on_map = bodies["x"], bodies["y"], bodies["heading"]
        # `_along`: last x of each body, m, where the search along the line begins
        if self._along is None:
            self._along = frame_places(self._line, *on_map)[0]
        in_frame = frame_places(self._line, *on_map, self._along)
        bodies["x"], bodies["y"], bodies["heading"] = in_frame
        self._along = in_frame[0]
        return bodies

    def settled(self) -> bool:
        """Whether its rule will do nothing new in a case that is driven through TraCI. False where
        a class of the user's has decided in its place.
        """
        decided = self._decided
        self._decided = False
        return decided and bool(self._egos["settled"][0])


def _pose(
    calls: Any, name: str, length: float, gone: type[Exception]
) -> tuple[float, float, float, float]:
    """Centre x, y, m, heading, rad, and speed, m/s, of a vehicle; nan if it has left.

    SUMO shows the front bumper and an angle clockwise from north, deg.

    gone: TraCI's exception for an unknown vehicle.
    """
    try:
        x, y = calls.getPosition(name)
    except gone:
        return (nan,) * 4
    heading = np.radians(90.0 - calls.getAngle(name))
    return (
        x - 0.5 * length * np.cos(heading),
        y - 0.5 * length * np.sin(heading),
        heading,
        calls.getSpeed(name),
    )
