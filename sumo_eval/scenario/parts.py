"""The parts of a logical scenario that a file describes: conditions, exposure, vehicles, zones.

They are plain data throughout: two readings of one file are equal, and all of it can be sent to another process.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario import played
from sumo_eval.scenario.bodies import BODIES
from sumo_eval.scenario.concrete import (
    LEAST_CHANGE,
    RECORDED_EVERY,
    Actor,
    Model,
    Road,
    Start,
    Way,
    brake_to_stop,
    constant_lateral,
    keeps_on,
    lane_change,
)
from sumo_eval.scenario.expression import Expression
from sumo_eval.scenario.joint import Joint, of_values
from sumo_eval.scenario.logical import (
    Approach,
    Parameter,
    Values,
)
from sumo_eval.scenario.road.reference_line import Piece, frame_places
from sumo_eval.scenario.streams import Spread, drawn
from sumo_eval.scenario.trigger import Trigger
from sumo_eval.trajectory import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Definitions:
    """Names for expressions, worked out in order. options: names of plain numbers."""

    entries: tuple[tuple[str, Expression], ...]
    options: tuple[tuple[str, float], ...] = ()

    def needed_by(self, *expressions: Expression) -> Definitions:
        """Those without which the expressions have no value."""
        names = set().union(*(expression.names for expression in expressions))
        entries = []
        for name, expression in reversed(self.entries):
            if name in names:
                entries.append((name, expression))
                names |= expression.names
        options = tuple((name, value) for name, value in self.options if name in names)
        return Definitions(tuple(reversed(entries)), options)

    def extend(self, values: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
        """The values and the definitions at them."""
        known = {**values, **dict(self.options)}
        for name, expression in self.entries:
            known[name] = expression.value(known)
        return known

    def at(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values and the definitions at one point, plain floats."""
        known = dict(values)
        known.update(self.options)
        for name, expression in self.entries:
            known[name] = expression.at(known)
        return known


_FLOATS: frozenset[type] = frozenset({float, np.float64})


@dataclass(frozen=True, slots=True)
class Condition:
    """A constraint's condition."""

    expression: Expression
    definitions: Definitions

    def __call__(self, values: Values) -> BoolArray:
        """Whether it holds."""
        if _FLOATS.issuperset(map(type, values.values())):  # one point, as `LogicalScenario.concrete` asks
            point = self.definitions.at(dict(zip(values, map(float, values.values()), strict=True)))
            return np.asarray(self.expression.at(point))
        return np.asarray(self.expression.value(self.definitions.extend(values)), dtype=np.bool_)

    def room(self, values: Values) -> FloatArray:
        """How far it is from its limit: below 0 where it does not hold."""
        return np.asarray(self.expression.room(self.definitions.extend(values)), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Exposure:
    """Density: the product of the parameters' distributions in their ranges, or a joint one, times an expression."""

    parameters: tuple[Parameter, ...]
    expression: Expression | None
    definitions: Definitions
    joint: Joint | None = None

    def __call__(self, values: Values) -> FloatArray:
        """The density, up to a factor."""
        shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
        density: FloatArray = np.ones(shape) if self.joint is None else of_values(self.joint, values)
        for item in self.parameters:
            if item.distribution is not None:
                density = density * item.distribution.density(values[item.name], item.low, item.high)
        if self.expression is not None:
            factor = self.expression.value(self.definitions.extend(values))
            if not np.all(np.isfinite(factor) & (factor >= 0.0)):
                raise must_be(f"`{self.expression.text}`", "the exposure", "finite and at least 0", factor)
            density = density * factor
        return density


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number of a concrete scenario. what, owner: they name it in sentences; endless: it may be inf."""

    what: str
    owner: str
    expression: Expression
    at_least: float = -math.inf
    above: float = -math.inf
    endless: bool = False

    def at(self, known: Mapping[str, float]) -> float:
        """Its value where these names have these values. Raises InputError for one that it must not have."""
        found: float = self.expression.at(known)
        if self.at_least <= found and self.above < found and (found < math.inf or self.endless):
            return found
        wanted = "a number" if self.endless else "finite"
        wanted += f" and at least {self.at_least:g}" if self.at_least > -math.inf else ""
        wanted += f" and above {self.above:g}" if self.above > -math.inf else ""
        at = ", ".join(f"{name}={value:g}" for name, value in known.items())
        raise must_be(f"{self.what} = `{self.expression.text}`", self.owner, wanted, f"{found:g} at {at}")


@dataclass(frozen=True, slots=True)
class Move:
    """A manoeuvre with its quantities by key, `begin` among them. table: pairs of quantities, of paths and profiles."""

    do: str
    numbers: tuple[tuple[str, Quantity], ...]
    table: tuple[tuple[Quantity, Quantity], ...] = ()
    by_place: bool = False
    when: Trigger | None = None
    name: str = ""
    model: str = ""

    @property
    def lively(self) -> bool:
        """Whether only a played vehicle, or SUMO, can do it."""
        return self.when is not None or self.do in ("accelerate", "speed_profile", "sinus", "path", "follow")


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Another vehicle with its quantities. place: the gap ahead of the ego if `by_gap`, behind it if `behind`, else x.

    heading: deg, or the lateral speed if `by_lateral_speed`; None: along the road.
    """

    name: str
    speed: Quantity
    place: Quantity
    by_gap: bool
    y: Quantity
    length: float
    width: float
    slides: bool
    moves: tuple[Move, ...]
    behind: bool = False
    heading: Quantity | None = None
    by_lateral_speed: bool = False
    body: str = "car"
    on_map: bool = False

    @property
    def lively(self) -> bool:
        """Whether what it does is no function of time alone."""
        return self.heading is not None or self.on_map or any(move.lively for move in self.moves)


@dataclass(frozen=True, slots=True)
class Stream:
    """Traffic of a given density with its quantities by key."""

    name: str
    lane: int
    numbers: tuple[tuple[str, Quantity], ...]
    spread: Spread
    model: str
    body: str


@dataclass(frozen=True, slots=True)
class Goal:
    """The lane of a road that the ego has to change to, from where on and by where, m; None: as the road has it."""

    lane: int
    begin: float
    by: float | None
    road: Road

    def way(self, y: float, owner: str) -> Way:
        """The lane change of an ego that starts at y. Raises InputError for one that nobody can make."""
        road = self.road
        lane = min(max(round(y / road.lane_width), 0), road.lanes - 1)
        if abs(lane - self.lane) != 1:
            raise must_be("`goal_lane`", owner, f"a lane beside lane {lane}, in which the ego starts", self.lane)
        own, other = road.span(lane), road.span(self.lane)
        begin, by = self.begin, self.by
        if by is None:
            by = min(own.end, other.parted_from, other.end)
            if math.isinf(by):
                raise InputError(
                    f"The ego of {owner} must have a `change_by`: neither its lane nor the other one ends."
                )
        first = max(own.parted_until, other.parted_until, own.begin, other.begin, 0.0)
        last = min(own.end, other.end, own.parted_from, other.parted_from, road.length)
        if not first <= begin <= by - LEAST_CHANGE or by > last:
            within = f"within {max(first, 0.0):g}..{last:g} m and {LEAST_CHANGE:g} m apart, where both lanes are"
            raise must_be("`change_from` and `change_by`", owner, within, f"{begin:g} and {by:g} m")
        return Way(road.lane_width * (self.lane - lane), begin, by, math.isfinite(own.end))


@dataclass(frozen=True, slots=True)
class Place:
    """Values of one point -> the ego's start and the other vehicles."""

    definitions: Definitions
    ego_speed: Quantity
    ego_x: Quantity
    ego_y: Quantity
    ego_lateral: Quantity
    ego_length: float
    vehicles: tuple[Vehicle, ...]
    streams: tuple[Stream, ...] = ()
    lane_width: float = 3.5
    goal: Goal | None = None
    line: tuple[Piece, ...] = ()
    recorded: tuple[tuple[float, float], ...] = ()

    def __call__(self, values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
        """Where everybody starts and what everybody does."""
        known = self.definitions.at(values)
        x, y, speed, lateral = (it.at(known) for it in (self.ego_x, self.ego_y, self.ego_speed, self.ego_lateral))
        ego = Start(x, y, speed, lateral, recorded=self.recorded)
        if ego.lateral_speed and not abs(ego.lateral_speed) < ego.speed:
            raise must_be(
                "`lateral_speed`", self.ego_lateral.owner, f"below the ego's speed {ego.speed:g} m/s", ego.lateral_speed
            )
        if self.goal is not None:
            ego = replace(ego, way=self.goal.way(ego.y, self.ego_y.owner))
        others = [self._actor(item, ego, known) for item in self.vehicles]
        for stream in self.streams:
            others += self._stream(stream, ego, known)
        return ego, tuple(others)

    def _stream(self, stream: Stream, ego: Start, known: Mapping[str, float]) -> list[Actor]:
        numbers = {key: quantity.at(known) for key, quantity in stream.numbers}
        body = BODIES[stream.body]
        found = []
        drawn_cars = drawn(stream.name, stream.spread, body.length, numbers)
        for count, (ahead, speed) in enumerate(drawn_cars, 1):
            start = Start(ego.x + ahead, self.lane_width * stream.lane, speed)
            model = Model(stream.model, speed, _model_numbers(numbers))
            name = f"{stream.name}_{count}"
            found.append(Actor(name, start, (), body.length, body.width, body=stream.body, model=model))
        return found

    def _actor(self, item: Vehicle, ego: Start, known: Mapping[str, float]) -> Actor:
        x = item.place.at(known)
        if item.by_gap:
            x = ego.x + x + (self.ego_length + item.length) / 2
        elif item.behind:
            x = ego.x - x - (self.ego_length + item.length) / 2
        speed, heading = item.speed.at(known), 0.0
        if item.heading is not None and item.by_lateral_speed:
            across = item.heading.at(known)
            speed, heading = math.sqrt(speed * speed + across * across), math.atan2(across, speed)
        elif item.heading is not None:
            heading = math.radians(item.heading.at(known))
        start = Start(x, item.y.at(known), speed)
        on_map = None
        if item.on_map:
            on_map = start.x, start.y, heading
            s, d, heading = (float(it) for it in frame_places(self.line, *on_map))
            start = Start(s, d, speed)
        acts, model = self._acts(item, speed, known)
        return Actor(
            item.name, start, acts, item.length, item.width, item.slides, item.body, heading, model, on_map
        )  # fmt: skip

    def _acts(
        self, item: Vehicle, speed: float, known: Mapping[str, float]
    ) -> tuple[tuple[played.Act, ...], Model | None]:
        """What a vehicle does at a point, and the model that drives it."""
        acts: list[played.Act] = []
        model = None
        for move in item.moves:
            if move.do == "keep_speed" and not item.lively:
                continue
            numbers = {key: quantity.at(known) for key, quantity in move.numbers}
            program = () if move.when is None else move.when.at(known)
            if move.do == "follow":
                model = Model(move.model, numbers.get("speed", speed), _model_numbers(numbers))
                if program:
                    begin = numbers["begin"]
                    acts.append(played.Act(played.FOLLOW, begin, RECORDED_EVERY, table=self.recorded, program=program))
                continue
            table = tuple((one.at(known), two.at(known)) for one, two in move.table)
            if move.do == "speed_profile" and any(b[0] <= a[0] for a, b in itertools.pairwise(((0.0, 0.0), *table))):
                raise must_be(f"The {'places' if move.by_place else 'times'}", f"`speed_profile` of vehicle "
                              f"`{item.name}`", "above 0 and ascending", [knot[0] for knot in table])  # fmt: skip
            act = _act(move, **numbers)
            acts.append(act._replace(table=table, program=program, name=move.name))
        if item.lively and model is None and all(act.timed for act in acts):
            acts.append(keeps_on(acts))
        return tuple(acts), model


def _model_numbers(numbers: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """A model's parameters by SUMO's name, of those that a file gives."""
    names = {"headway": "tau", "min_gap": "minGap", "acceleration": "accel", "deceleration": "decel"}
    return tuple((names[key], numbers[key]) for key in names if key in numbers)


def _act(
    move: Move, begin: float, speed: float = 0.0, acceleration: float = math.inf, jerk: float = math.inf,
    duration: float = 0.0, offset: float = 0.0, deceleration: float = 0.0, cycles: float = 1.0,
) -> played.Act:  # fmt: skip
    """The act of a manoeuvre with its numbers by key."""
    if move.do == "brake":
        return brake_to_stop(begin, deceleration, jerk)
    if move.do == "accelerate":
        return played.Act(played.SPEED, begin, 0.0, speed, 0.0, acceleration, jerk)
    if move.do in ("change_lane", "change_lane_cosine"):
        return lane_change(begin, duration, offset, cosine=move.do == "change_lane_cosine")
    if move.do == "move_sideways":
        return constant_lateral(begin, speed, offset, acceleration)
    if move.do == "sinus":
        lasts = cycles * 2.0 * math.pi / math.sqrt(2.0 * acceleration / abs(offset)) if offset else 0.0
        return played.Act(played.SINUS, begin, lasts, 0.0, offset, acceleration)
    if move.do == "speed_profile":
        return played.Act(played.BY_PLACE if move.by_place else played.BY_TIME, begin)
    return played.Act(played.PATH if move.do == "path" else played.KEEP, begin)


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Values by name (arrays) -> what the zones' GP sees."""

    definitions: Definitions
    expressions: tuple[Expression, ...]

    def __call__(self, values: Values) -> tuple[FloatArray, ...]:
        """One array for each coordinate, of the values' shape."""
        known = self.definitions.extend(values)
        shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
        return tuple(np.broadcast_to(expression.value(known), shape) for expression in self.expressions)


@dataclass(frozen=True, slots=True)
class Margin:
    """Values by name (arrays) -> what is left to spare of a limit, m: hazardous where that is 0 or less."""

    definitions: Definitions
    expression: Expression

    def __call__(self, values: Values) -> FloatArray:
        """The margin at every point, m."""
        shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
        known = self.definitions.extend(values)
        return np.broadcast_to(np.asarray(self.expression.value(known), dtype=np.float64), shape)


@dataclass(frozen=True, slots=True)
class SearchRule:
    """What zones are searched from where somebody is played: the number of the obstacle among the others, and the delay
    between its first move and ideal braking; from the start on where it makes none. conflict: as in `ZoneTable`.
    """

    obstacle: int
    definitions: Definitions
    delay_of: Expression
    conflict: bool = False

    def delay(self, values: Mapping[str, float]) -> float:
        """The delay at a point, s."""
        return float(self.delay_of.at(self.definitions.at(values)))


@dataclass(frozen=True, slots=True)
class ZoneRule:
    """Values by name (arrays) -> the approach that criticality is computed from."""

    definitions: Definitions
    ego_speed: Expression
    obstacle_speed: Expression
    gap: Expression
    delay: Expression
    obstacle_deceleration: Expression
    conflict_begin: Expression
    passing_length: float

    def __call__(self, values: Values) -> Approach:
        """The approach at every point."""
        known = self.definitions.extend(values)
        shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
        return Approach(
            ego_speed=np.broadcast_to(self.ego_speed.value(known), shape),
            obstacle_speed=np.broadcast_to(self.obstacle_speed.value(known), shape),
            gap=np.broadcast_to(self.gap.value(known), shape),
            delay=self.delay.value(known),
            obstacle_deceleration=self.obstacle_deceleration.value(known),
            conflict_begin=self.conflict_begin.value(known),
            passing_length=self.passing_length,
        )
