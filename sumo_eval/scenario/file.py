"""A logical scenario as a TOML file: what may stand in it, and how it becomes a `LogicalScenario`.

Every number that may depend on the parameters is an expression (`sumo_eval.scenario.expression`). What is read is
plain data throughout: two readings of one file are equal, and both can be sent to another process.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, MinLen
from numpy.typing import ArrayLike
from pydantic import TypeAdapter, ValidationError

from sumo_eval.config import mistakes
from sumo_eval.errors import InputError, check_name, must_be, unknown
from sumo_eval.scenario.concrete import Actor, Brake, ConstantLateral, EgoBody, LaneChange, Road, Start
from sumo_eval.scenario.distribution import Distribution
from sumo_eval.scenario.expression import Expression, checked_names, condition, number
from sumo_eval.scenario.logical import (
    Approach,
    Constraint,
    LogicalScenario,
    NamedSample,
    Parameter,
    Values,
    ZoneCoordinates,
)
from sumo_eval.scenario.sumo_network import read_road
from sumo_eval.settings import About, Checked, Positive
from sumo_eval.toml_file import read_toml
from sumo_eval.trajectory import BoolArray, FloatArray

Formula = str | float
"""In a file: a number, or an expression of the parameters and definitions."""


# --- what may stand in a file -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ParameterTable(Checked):
    """One axis of the space."""

    name: Annotated[str, MinLen(1), About("name, for expressions and tables")]
    unit: Annotated[str, MinLen(1), About("unit; `1` for a share")]
    about: Annotated[str, About("what it is")] = ""
    low: Annotated[float | None, About("lower end of the range")] = None
    high: Annotated[float | None, About("upper end of the range")] = None
    step: Annotated[float | None, About("step of the default grid")] = None
    values: Annotated[tuple[float, ...], About("instead of low, high and step: the only values there are")] = ()
    distribution: Annotated[
        dict[str, str | float] | None,
        About("how often values are met: `name` of a continuous distribution of scipy.stats, and its arguments"),
    ] = None


@dataclass(frozen=True, slots=True)
class ConstraintTable(Checked):
    """Which points of the box exist."""

    require: Annotated[str, About("a condition on the parameters, e.g. `lead_speed < ego_speed`")]
    about: Annotated[str, About("the same in words: the point must be ...")] = ""


@dataclass(frozen=True, slots=True)
class RoadTable(Checked):
    """A straight road, written for the scenario or found in a network of the user's."""

    name: Annotated[str | None, About("name of its files; default: from its measures")] = None
    lanes: Annotated[int, Ge(1), About("number of lanes")] = 2
    lane_width: Annotated[float, Positive, About("width of each lane", "m")] = 3.5
    length: Annotated[float, Positive, About("length of the road; the end of the case is in [end]", "m")] = 6000.0
    network: Annotated[str | None, About("a .net.xml instead, relative to this file")] = None
    edges: Annotated[tuple[str, ...], About("the edges of that network to drive along, in order")] = ()


@dataclass(frozen=True, slots=True)
class EgoTable(Checked):
    """The vehicle under test."""

    speed: Annotated[Formula, About("speed at the start", "m/s")]
    x: Annotated[Formula, About("centre along the road at the start", "m")] = 50.0
    y: Annotated[Formula, About("centre across the road, left of the right lane's centre line", "m")] = 0.0
    length: Annotated[float | None, Positive, About("body; default: as in the vehicle settings", "m")] = None
    width: Annotated[float | None, Positive, About("body; default: as in the vehicle settings", "m")] = None


@dataclass(frozen=True, slots=True)
class ManoeuvreTable(Checked):
    """What another vehicle does, from `begin` on."""

    do: Annotated[
        Literal["keep_speed", "brake", "change_lane", "move_sideways"],
        About("keep_speed; brake to a standstill; change_lane smoothly in `duration`; move_sideways at `speed`"),
    ]
    begin: Annotated[Formula, About("when it begins", "s")] = 0.0
    deceleration: Annotated[Formula | None, About("of `brake`", "m/s2")] = None
    jerk: Annotated[Formula | None, About("of `brake`: how fast it builds up; default: at once", "m/s3")] = None
    duration: Annotated[Formula | None, About("of `change_lane`", "s")] = None
    speed: Annotated[Formula | None, About("of `move_sideways`", "m/s")] = None
    acceleration: Annotated[
        Formula | None, About("of `move_sideways`: how fast its speed builds up; default: at once", "m/s2")
    ] = None
    offset: Annotated[Formula | None, About("of both: how far to the left, negative to the right", "m")] = None


@dataclass(frozen=True, slots=True)
class VehicleTable(Checked):
    """Another vehicle: keeps its speed, unless a manoeuvre says otherwise."""

    name: Annotated[str, MinLen(1), About("name")]
    speed: Annotated[Formula, About("speed at the start", "m/s")]
    gap: Annotated[Formula | None, About("from the ego's front bumper to its rear at the start", "m")] = None
    x: Annotated[Formula | None, About("instead of gap: its centre along the road", "m")] = None
    y: Annotated[Formula, About("centre across the road, left of the right lane's centre line", "m")] = 0.0
    length: Annotated[float, Positive, About("body", "m")] = 4.5
    width: Annotated[float, Positive, About("body", "m")] = 1.8
    slides: Annotated[bool, About("keeps its heading while it moves across, instead of pointing where it goes")] = False
    manoeuvre: Annotated[tuple[ManoeuvreTable, ...], About("what it does")] = ()


@dataclass(frozen=True, slots=True)
class EndTable(Checked):
    """When a case is over, besides contact, standstill and leaving the road."""

    x: Annotated[float, Positive, About("the ego's centre reaches this place", "m")] = 600.0
    time: Annotated[float | None, Positive, About("simulated time; default: the simulation's own", "s")] = None


@dataclass(frozen=True, slots=True)
class ZoneTable(Checked):
    """What the zones are computed from: the approach to one vehicle under ideal braking (Eqs. 1-6)."""

    obstacle: Annotated[str, About("the vehicle that is in the way")]
    delay: Annotated[Formula, About("before ideal braking begins", "s")] = 0.0
    gap: Annotated[Formula | None, About("bumper to bumper at the start; default: the obstacle's", "m")] = None
    conflict_begin: Annotated[Formula, About("before it the obstacle is not in the way", "s")] = 0.0
    passing_length: Annotated[
        float | None, Positive, About("an ego further ahead than that when the conflict begins has passed", "m")
    ] = None
    coordinates: Annotated[
        dict[str, Formula] | None,
        About("in words = expression: in which the criticality is smooth; default: the parameters"),
    ] = None


@dataclass(frozen=True, slots=True)
class SampleTable(Checked):
    """Points that somebody prescribes, columns in the order of the parameters."""

    name: Annotated[str, MinLen(1), About("name, for `method` of an evaluation's sampling")]
    points: Annotated[tuple[tuple[float, ...], ...], About("the points")]
    about: Annotated[str, About("what they are")] = ""


@dataclass(frozen=True, slots=True)
class ScenarioFile(Checked):
    """A logical scenario file."""

    name: Annotated[str, MinLen(1), About("name of the scenario")]
    parameter: Annotated[tuple[ParameterTable, ...], About("the axes of the space")]
    ego: Annotated[EgoTable, About("the vehicle under test")]
    vehicle: Annotated[tuple[VehicleTable, ...], About("the others")]
    zone: Annotated[ZoneTable, About("zone rule")]
    about: Annotated[str, About("what happens, in one sentence")] = ""
    source: Annotated[str, About("where it comes from")] = "a scenario file"
    define: Annotated[dict[str, Formula], About("names for expressions, each may use those above it")] = field(
        default_factory=dict
    )
    constraint: Annotated[tuple[ConstraintTable, ...], About("which points of the box exist")] = ()
    exposure: Annotated[str | None, About("density, an expression; multiplies the parameters' distributions")] = None
    road: Annotated[RoadTable, About("the road")] = field(default_factory=RoadTable)
    end: Annotated[EndTable, About("when a case is over")] = field(default_factory=EndTable)
    sample: Annotated[tuple[SampleTable, ...], About("prescribed points")] = ()
    default_sample: Annotated[str, About("grid, or the name of a sample")] = "grid"


_ADAPTER = TypeAdapter(ScenarioFile)


# --- reading ----------------------------------------------------------------------------------------------------------


def read_scenario(path: Path) -> LogicalScenario:
    """The logical scenario in a TOML file. Raises InputError naming what is wrong."""
    return scenario_from(read_toml(path, "scenario file"), f"scenario file {path}", path.parent)


def scenario_from(content: Mapping[str, Any], where: str, folder: Path) -> LogicalScenario:
    """The logical scenario in a plain mapping. `where` names it in errors; `folder`: where its paths start."""
    try:
        table = _ADAPTER.validate_json(json.dumps(content, default=str), strict=True)
    except ValidationError as error:
        raise InputError(mistakes(error, where, ScenarioFile)) from None
    return _Builder(table, where, folder).scenario()


def check_file(path: Path) -> tuple[str, ...]:
    """Read a scenario file, place vehicles at every point of its own sample, and say in sentences what it holds.

    Raises InputError with what is wrong, at the first point where something is.
    """
    from sumo_eval.scenario.sampling import sample

    logical = read_scenario(Path(path))
    chosen = sample(logical)
    if not len(chosen.points):
        raise InputError(f"Scenario `{logical.name}` must have possible points, got none of {len(chosen.refused)}.")
    check_points(logical, chosen.points)
    ranges = ", ".join(f"{item.name} {item.low:g}..{item.high:g} {item.unit}" for item in logical.parameters)
    return (
        f"Logical scenario `{logical.name}`: {ranges}.",
        f"Its own sample has {len(chosen.points)} possible points; constraints refuse {len(chosen.refused)} more.",
        f"Exposure: {logical.exposure_about}.",
        *chosen.notes,
    )


def check_points(logical: LogicalScenario, points: FloatArray) -> None:
    """Place every vehicle at every point (n, k), and work out the approach there. InputError at the first fault."""
    for row in points.tolist():
        concrete = logical.concrete(**dict(zip(logical.names, row, strict=True)))
        _check_place(logical, concrete.ego, concrete.actors, concrete.label)
    logical.approach(logical.columns(points))


def _check_place(logical: LogicalScenario, ego: Start, actors: Sequence[Actor], label: str) -> None:
    end = logical.road.length + logical.road.run_out
    for name, start, length in [("ego", ego, 0.0), *((item.name, item.start, item.length) for item in actors)]:
        if not (length / 2 <= start.x <= end - length / 2):
            raise must_be(f"Vehicle `{name}`", f"scenario `{logical.name}` at {label}", "on the road", start.x)
        if not logical.road.right_edge <= start.y <= logical.road.left_edge:
            raise must_be(f"Vehicle `{name}`", f"scenario `{logical.name}` at {label}", "on a lane", start.y)


# --- building ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Definitions:
    """Names for expressions, worked out in order."""

    entries: tuple[tuple[str, Expression], ...]

    def extend(self, values: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
        """The values and the definitions at them."""
        known = dict(values)
        for name, expression in self.entries:
            known[name] = expression.value(known)
        return known


@dataclass(frozen=True, slots=True)
class Condition:
    """A constraint's condition."""

    expression: Expression
    definitions: Definitions

    def __call__(self, values: Values) -> BoolArray:
        """Whether it holds."""
        return np.asarray(self.expression.value(self.definitions.extend(values)), dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class Exposure:
    """Density: the product of the parameters' distributions within their ranges, times an expression."""

    parameters: tuple[Parameter, ...]
    expression: Expression | None
    definitions: Definitions

    def __call__(self, values: Values) -> FloatArray:
        """The density, up to a factor."""
        shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
        density: FloatArray = np.ones(shape)
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
class Move:
    """A manoeuvre with its expressions."""

    do: str
    begin: Expression
    numbers: tuple[tuple[str, Expression], ...]


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Another vehicle with its expressions. `gap` None: `x` says where it starts."""

    name: str
    speed: Expression
    gap: Expression | None
    x: Expression | None
    y: Expression
    length: float
    width: float
    slides: bool
    moves: tuple[Move, ...]


@dataclass(frozen=True, slots=True)
class Place:
    """Values of one point -> the ego's start and the other vehicles."""

    owner: str
    definitions: Definitions
    ego_speed: Expression
    ego_x: Expression
    ego_y: Expression
    ego_length: float
    vehicles: tuple[Vehicle, ...]

    def __call__(self, values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
        """Where everybody starts and what everybody does."""
        known = self.definitions.extend(values)

        def real(expression: Expression, what: str, least: float = -math.inf) -> float:
            found = float(expression.value(known))
            if not (math.isfinite(found) and found >= least):
                wanted = "finite" if least == -math.inf else f"finite and at least {least:g}"
                at = ", ".join(f"{name}={value:g}" for name, value in values.items())
                raise must_be(f"{what} = `{expression.text}`", self.owner, wanted, f"{found:g} at {at}")
            return found

        ego = Start(
            real(self.ego_x, "x of the ego"), real(self.ego_y, "y of the ego"), real(self.ego_speed, "speed", 0.0)
        )
        actors = []
        for item in self.vehicles:
            what = f"of vehicle `{item.name}`"
            if item.gap is not None:
                x = ego.x + real(item.gap, f"gap {what}") + (self.ego_length + item.length) / 2
            else:
                assert item.x is not None
                x = real(item.x, f"x {what}")
            start = Start(x, real(item.y, f"y {what}"), real(item.speed, f"speed {what}", 0.0))
            moves: list[LaneChange | ConstantLateral] = []
            brake = None
            for move in item.moves:
                begin = real(move.begin, f"begin of `{move.do}` {what}", 0.0)
                numbers = {name: real(value, f"{name} of `{move.do}` {what}") for name, value in move.numbers}
                if move.do == "brake":
                    brake = Brake(begin, numbers["deceleration"], numbers.get("jerk", math.inf))
                elif move.do == "change_lane":
                    if not numbers["duration"] > 0.0:
                        raise must_be(f"`duration` of `change_lane` {what}", self.owner, "above 0", numbers["duration"])
                    moves.append(LaneChange(begin, numbers["duration"], numbers["offset"]))
                elif move.do == "move_sideways":
                    build_up = numbers.get("acceleration", math.inf)
                    moves.append(ConstantLateral(begin, numbers["speed"], numbers["offset"], build_up))
            actors.append(Actor(item.name, start, tuple(moves), item.length, item.width, brake, item.slides))
        return ego, tuple(actors)


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
        return Approach(
            ego_speed=self.ego_speed.value(known),
            obstacle_speed=self.obstacle_speed.value(known),
            gap=self.gap.value(known),
            delay=self.delay.value(known),
            obstacle_deceleration=self.obstacle_deceleration.value(known),
            conflict_begin=self.conflict_begin.value(known),
            passing_length=self.passing_length,
        )


_NEEDS = {
    "keep_speed": ((), ()),
    "brake": (("deceleration",), ("jerk",)),
    "change_lane": (("duration", "offset"), ()),
    "move_sideways": (("speed", "offset"), ("acceleration",)),
}
"""Keys that a manoeuvre must have and those it may have, besides `begin`."""


class _Builder:
    """Checks names across tables and puts the parts together."""

    def __init__(self, table: ScenarioFile, where: str, folder: Path) -> None:
        self.table, self.where, self.folder = table, where, folder
        self.known: list[str] = []

    def scenario(self) -> LogicalScenario:
        table = self.table
        parameters = tuple(self._parameter(item) for item in table.parameter)
        if not parameters:
            raise InputError(f"{self.where} must have at least one [[parameter]].")
        self.known = _distinct([item.name for item in parameters], "parameter", self.where)
        entries = []
        for name, formula in table.define.items():
            if name in self.known:
                raise InputError(f"`{name}` in [define] of {self.where} must differ from the parameters.")
            entries.append((name, self._number(formula, f"[define] {name}")))
            self.known.append(name)
        definitions = Definitions(tuple(entries))
        vehicles = tuple(self._vehicle(item) for item in table.vehicle)
        _distinct(["ego", *(item.name for item in vehicles)], "vehicle", self.where)
        for item in vehicles:
            check_name("`name`", f"a vehicle of {self.where}", item.name)
        constraints = tuple(
            Constraint(
                item.about or f"one where {item.require}",
                Condition(checked_names(condition(item.require, self.where), self.known, self.where), definitions),
            )
            for item in table.constraint
        )
        density = None if table.exposure is None else self._number(table.exposure, "`exposure`")
        spread = [item for item in parameters if item.distribution is not None]
        exposure = Exposure(parameters, density, definitions)
        body = self._body()
        ego = table.ego
        return LogicalScenario(
            name=table.name,
            about=table.about or table.name,
            source=table.source,
            parameters=parameters,
            constraints=constraints,
            road=self._road(),
            place=Place(
                owner=f"scenario `{table.name}`",
                definitions=definitions,
                ego_speed=self._number(ego.speed, "`ego.speed`"),
                ego_x=self._number(ego.x, "`ego.x`"),
                ego_y=self._number(ego.y, "`ego.y`"),
                ego_length=4.5 if body is None else body.length,
                vehicles=vehicles,
            ),
            approach=self._zone(definitions, vehicles),
            exposure=exposure,
            exposure_about=_exposure_about(spread, density),
            ego_body=body,
            time_limit=table.end.time,
            zone_coordinates=self._coordinates(definitions),
            samples=tuple(self._sample(item, len(parameters)) for item in table.sample),
            default_sample=table.default_sample,
        )

    def _number(self, formula: Formula, what: str) -> Expression:
        return checked_names(number(formula, f"{what} of {self.where}"), self.known, f"{what} of {self.where}")

    def _parameter(self, item: ParameterTable) -> Parameter:
        owner = f"parameter `{item.name}` of {self.where}"
        if not item.name.isidentifier():
            raise must_be("The name", owner, "letters, digits and underscores", item.name)
        ranged = [item.low, item.high, item.step]
        if bool(item.values) == any(value is not None for value in ranged):
            raise InputError(f"{owner} must have either low, high and step, or values.".capitalize())
        distribution = None
        if item.distribution is not None:
            arguments = dict(item.distribution)
            name = arguments.pop("name", None)
            if not isinstance(name, str):
                raise InputError(f"The distribution of {owner} must have a `name`.")
            numbers = {}
            for key, value in arguments.items():
                if not isinstance(value, int | float):
                    raise must_be(f"`{key}`", f"the distribution of {owner}", "a number", value)
                numbers[key] = float(value)
            distribution = Distribution.of(name, numbers, owner)
        if item.values:
            values = item.values
            if len(values) < 2:
                raise must_be("`values`", owner, "at least two numbers", list(values))
            step = min(b - a for a, b in itertools.pairwise(values))
            if step <= 0:
                raise must_be("`values`", owner, "ascending", list(values))
            low, high = values[0], values[-1]
        else:
            for key, number_or_none in zip(("low", "high", "step"), ranged, strict=True):
                if number_or_none is None:
                    raise InputError(f"`{key}` of {owner} is missing.")
            low, high, step = (float(value) for value in ranged if value is not None)
        parameter = Parameter(item.name, low, high, step, item.unit, item.about, item.values, distribution)
        if distribution is not None and not distribution.inside(low, high) > 0.0:
            raise must_be(f"Distribution {distribution}", owner, f"possible within {low:g}..{high:g}", 0.0)
        return parameter

    def _body(self) -> EgoBody | None:
        ego = self.table.ego
        if (ego.length is None) != (ego.width is None):
            raise InputError(f"[ego] of {self.where} must have both length and width, or neither.")
        return None if ego.length is None or ego.width is None else EgoBody(ego.length, ego.width)

    def _road(self) -> Road:
        road, end = self.table.road, self.table.end
        if road.network is not None:
            return read_road(self.folder / road.network, road.edges, end.x)
        if road.edges:
            raise InputError(f"`road.edges` of {self.where} name edges of a `network`, and there is none.")
        if end.x > road.length:
            raise must_be("`end.x`", self.where, f"at most the road's length {road.length:g}", end.x)
        name = road.name or f"road_{road.lanes}x{road.lane_width:g}m_{end.x:g}m_of_{road.length:g}m"
        return Road(name, end.x, road.lanes, road.lane_width, road.length - end.x)

    def _vehicle(self, item: VehicleTable) -> Vehicle:
        what = f"vehicle `{item.name}`"
        if (item.gap is None) == (item.x is None):
            raise InputError(f"{what.capitalize()} of {self.where} must have either gap or x.")
        moves = tuple(self._move(move, what) for move in item.manoeuvre)
        if sum(move.do == "brake" for move in moves) > 1:
            raise InputError(f"{what.capitalize()} of {self.where} must brake at most once.")
        return Vehicle(
            name=item.name,
            speed=self._number(item.speed, f"speed of {what}"),
            gap=None if item.gap is None else self._number(item.gap, f"gap of {what}"),
            x=None if item.x is None else self._number(item.x, f"x of {what}"),
            y=self._number(item.y, f"y of {what}"),
            length=item.length,
            width=item.width,
            slides=item.slides,
            moves=moves,
        )

    def _move(self, item: ManoeuvreTable, what: str) -> Move:
        needed, allowed = _NEEDS[item.do]
        numbers = []
        for key in ("deceleration", "jerk", "duration", "speed", "acceleration", "offset"):
            value = getattr(item, key)
            if value is None and key in needed:
                raise InputError(f"`{item.do}` of {what} in {self.where} must have `{key}`.")
            if value is not None and key not in (*needed, *allowed):
                raise InputError(f"`{item.do}` of {what} in {self.where} has no `{key}`.")
            if value is not None:
                numbers.append((key, self._number(value, f"{key} of {what}")))
        return Move(item.do, self._number(item.begin, f"begin of {what}"), tuple(numbers))

    def _zone(self, definitions: Definitions, vehicles: Sequence[Vehicle]) -> ZoneRule:
        zone = self.table.zone
        by_name = {item.name: item for item in vehicles}
        if zone.obstacle not in by_name:
            raise unknown(f"vehicle in `zone.obstacle` of {self.where}:", zone.obstacle, by_name)
        obstacle = by_name[zone.obstacle]
        gap = obstacle.gap if zone.gap is None else self._number(zone.gap, "`zone.gap`")
        if gap is None:
            raise InputError(f"[zone] of {self.where} must have a `gap`: vehicle `{obstacle.name}` starts at an x.")
        braking = [dict(move.numbers)["deceleration"] for move in obstacle.moves if move.do == "brake"]
        return ZoneRule(
            definitions=definitions,
            ego_speed=self._number(self.table.ego.speed, "`ego.speed`"),
            obstacle_speed=obstacle.speed,
            gap=gap,
            delay=self._number(zone.delay, "`zone.delay`"),
            obstacle_deceleration=braking[0] if braking else Expression("0.0"),
            conflict_begin=self._number(zone.conflict_begin, "`zone.conflict_begin`"),
            passing_length=math.inf if zone.passing_length is None else zone.passing_length,
        )

    def _coordinates(self, definitions: Definitions) -> ZoneCoordinates | None:
        given = self.table.zone.coordinates
        if not given:
            return None
        expressions = tuple(self._number(formula, f"zone.coordinates `{name}`") for name, formula in given.items())
        return ZoneCoordinates(tuple(given), Coordinates(definitions, expressions))

    def _sample(self, item: SampleTable, columns: int) -> NamedSample:
        for row in item.points:
            if len(row) != columns:
                raise must_be("Each point", f"sample `{item.name}` of {self.where}", f"{columns} numbers", list(row))
        return NamedSample(item.name, item.about or item.name, item.points)


def _distinct(names: Iterable[str], kind: str, where: str) -> list[str]:
    seen: list[str] = []
    for name in names:
        if name in seen:
            raise InputError(f"Every {kind} of {where} must have a name of its own, got `{name}` twice.")
        seen.append(name)
    return seen


def _exposure_about(spread: Sequence[Parameter], density: Expression | None) -> str:
    parts = [f"{item.name} as {item.distribution}" for item in spread]
    parts += [] if density is None else [f"times `{density.text}`"]
    return ", ".join(parts) if parts else "uniform: every concrete scenario counts the same"
