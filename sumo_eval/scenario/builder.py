"""How the tables of a scenario file become a `LogicalScenario`: names looked up, expressions read, units converted."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from sumo_eval.errors import InputError, check_name, did_you_mean, must_be, unknown
from sumo_eval.scenario.bodies import BODIES
from sumo_eval.scenario.concrete import (
    EgoBody,
    Road,
)
from sumo_eval.scenario.distribution import Distribution
from sumo_eval.scenario.expression import Expression, checked_names, condition, number
from sumo_eval.scenario.joint import Joint, read_joint
from sumo_eval.scenario.logical import (
    Constraint,
    Counterpart,
    LogicalScenario,
    Met,
    NamedSample,
    Option,
    Parameter,
    ZoneCoordinates,
    uniform_exposure,
)
from sumo_eval.scenario.parts import (
    Condition,
    Coordinates,
    Definitions,
    Exposure,
    Goal,
    Margin,
    Move,
    Place,
    Quantity,
    SearchRule,
    Stream,
    Vehicle,
    ZoneRule,
)
from sumo_eval.scenario.requirement import Requirements, requirement
from sumo_eval.scenario.road.lanes import crossings_of, spans_of
from sumo_eval.scenario.road.opendrive import read_opendrive
from sumo_eval.scenario.road.table import bend_name, check_line, line_of
from sumo_eval.scenario.streams import Spread
from sumo_eval.scenario.sumo_network import read_road
from sumo_eval.scenario.tables import (
    ConstraintTable,
    Formula,
    ManoeuvreTable,
    ParameterTable,
    SampleTable,
    ScenarioFile,
    StreamTable,
    VehicleTable,
)
from sumo_eval.scenario.trigger import trigger
from sumo_eval.scenario.units import check_unit, check_uses, factor_to, refuse_unit

_NEEDS = {
    "keep_speed": ((), ()),
    "brake": (("deceleration",), ("jerk",)),
    "change_lane": (("duration", "offset"), ()),
    "change_lane_cosine": (("duration", "offset"), ()),
    "move_sideways": (("speed", "offset"), ("acceleration",)),
    "accelerate": (("speed", "acceleration"), ("jerk",)),
    "speed_profile": (("speeds",), ("times", "places")),
    "sinus": (("offset", "acceleration"), ("cycles",)),
    "path": ((), ("points", "lanes", "places")),
    "follow": (("model",), ("speed", "acceleration", "deceleration", "headway", "min_gap")),
}
"""Keys that a manoeuvre must have and those it may have, besides `begin`."""

_ABOVE_ZERO = {
    ("change_lane", "duration"), ("change_lane_cosine", "duration"),
    ("accelerate", "acceleration"), ("accelerate", "jerk"), ("sinus", "acceleration"),
    ("sinus", "cycles"), ("follow", "acceleration"), ("follow", "deceleration"), ("follow", "headway"),
    ("follow", "min_gap"), ("follow", "speed"),
}  # fmt: skip
"""Numbers of manoeuvres that must be above 0; brakes and sideways moves check themselves."""
_LISTS = ("times", "places", "speeds", "points", "lanes", "model")
_KEYS = (
    "deceleration", "jerk", "duration", "speed", "acceleration", "offset", "cycles", "headway", "min_gap", *_LISTS,
)  # fmt: skip


def built(table: ScenarioFile, options: Mapping[str, float], where: str, folder: Path) -> LogicalScenario:
    """The logical scenario that the tables of a file describe. options: the value of every option. where: how errors
    call the file. folder: where its paths start.
    """
    return _Builder(table, dict(options), where, folder).scenario()


class _Builder:
    """Checks names across tables and puts the parts together."""

    def __init__(self, table: ScenarioFile, options: Mapping[str, float], where: str, folder: Path) -> None:
        self.table, self.options, self.where, self.folder = table, options, where, folder
        self.owner = f"scenario `{table.name}`"
        self.known: list[str] = []

    def scenario(self) -> LogicalScenario:
        table = self.table
        parameters = tuple(self._parameter(item) for item in table.parameter)
        if not parameters:
            raise InputError(f"{self.where} must have at least one [[parameter]].")
        for option in table.option:
            check_unit(option.unit, f"option `{option.name}` of {self.where}", {"default": option.default})
        options = [option.name for option in table.option]
        for name in options:
            if not name.isidentifier():
                raise must_be("The name", f"an option of {self.where}", "letters, digits and underscores", name)
        names = [*(item.name for item in parameters), *options]
        self.known = _distinct(names, "parameter and option", self.where)
        check_uses(
            table,
            {item.name: item.unit for item in parameters} | {item.name: item.unit for item in table.option},
            self.where,
        )
        entries = []
        for name, formula in table.define.items():
            if name in self.known:
                raise InputError(f"`{name}` in [define] of {self.where} must differ from parameters and options.")
            entries.append((name, self._number(formula, f"[define] {name}")))
            self.known.append(name)
        definitions = Definitions(tuple(entries), tuple(self.options.items()))
        self.road = self._road()
        self.numbers_of = {item.name: number_of for number_of, item in enumerate(table.vehicle)}
        self.moves_of = {
            item.name: {move.name: index for index, move in enumerate(item.manoeuvre) if move.name}
            for item in table.vehicle
        }
        vehicles = tuple(self._vehicle(item) for item in table.vehicle)
        streams = tuple(self._stream(item) for item in table.stream)
        if not vehicles and not streams and table.zone != "none":
            raise InputError(f"{self.where} must have at least one [[vehicle]] or [[stream]].")
        _distinct(["ego", *(item.name for item in vehicles)], "vehicle", self.where)
        for item in vehicles:
            check_name("`name`", f"a vehicle of {self.where}", item.name)
        constraints = tuple(self._constraint(item, definitions) for item in table.constraint)
        density = None if table.exposure is None else self._number(table.exposure, "`exposure`")
        spread = [item for item in parameters if item.distribution is not None]
        joint = self._joint(parameters)
        told = bool(spread) or density is not None or joint is not None
        body, road = self._body(), self.road
        for vehicle in table.vehicle:
            self._check_on_map(vehicle, road)
        ego = table.ego
        ego_speed = self._quantity(ego.speed, "speed of the ego", at_least=0.0)
        ego_x, ego_y = self._quantity(ego.x, "x of the ego"), self._quantity(ego.y, "y of the ego")
        ego_lateral = self._quantity(ego.lateral_speed, "lateral_speed of the ego")
        placed = [ego_speed, ego_x, ego_y, ego_lateral]
        placed += itertools.chain.from_iterable(_quantities(item) for item in vehicles)
        placed += [quantity for item in streams for _, quantity in item.numbers]
        triggers = [move.when for item in vehicles for move in item.moves if move.when is not None]
        told_by = [*(quantity.expression for quantity in placed), *(it for when in triggers for it in when.expressions)]
        lively = bool(streams) or any(item.lively for item in vehicles) or road.shaped
        searched = lively or ego.goal_lane is not None or (table.zone != "none" and table.zone.conflict)
        requirements = self._requirements(definitions)
        asked = requirements.all if requirements is not None else ()
        self._all_used(parameters, definitions, [*told_by, *(it for one in asked for it in one.expressions)])
        margin = self._margin(definitions)
        return LogicalScenario(
            name=table.name,
            about=table.about or table.name,
            source=table.source,
            parameters=parameters,
            constraints=constraints,
            road=road,
            place=Place(
                definitions=definitions.needed_by(*told_by),
                ego_speed=ego_speed,
                ego_x=ego_x,
                ego_y=ego_y,
                ego_lateral=ego_lateral,
                ego_length=4.5 if body is None else body.length,
                vehicles=vehicles,
                streams=streams,
                lane_width=road.lane_width,
                goal=self._goal(road),
                line=road.line,
                recorded=self._recorded_ego(),
            ),
            approach=None if searched or margin or table.zone == "none" else self._zone(definitions, vehicles),
            search=self._search(definitions, vehicles) if searched and not margin and table.zone != "none" else None,
            margin=margin,
            exposure=Exposure(parameters, density, definitions, joint) if told else uniform_exposure,
            exposure_about=_exposure_about(spread, density, joint),
            recorded=self._recorded(parameters),
            met=None if table.met is None else Met(table.met.events, table.met.vehicle_km, table.met.where),
            ego_body=body,
            time_limit=table.end.time,
            standstill_time=table.end.standstill,
            zone_coordinates=self._coordinates(definitions),
            samples=tuple(self._sample(item, parameters) for item in table.sample),
            default_sample=table.default_sample,
            has_drivers=table.people == "drivers",
            options=tuple(Option(option.name, option.unit, option.about) for option in table.option),
            notes=("It declares no zones, so every point counts as safe.",) if table.zone == "none" else (),
            requirements=requirements,
        )

    def _check_on_map(self, item: VehicleTable, road: Road) -> None:
        if not item.on_map:
            return
        owner = f"vehicle `{item.name}` of {self.where}"
        if not road.bent:
            raise InputError(f"{owner.capitalize()} must not have `on_map`: on a straight road the map is the road.")
        along = [key for key in ("gap", "gap_behind", "lateral_speed") if getattr(item, key) is not None]
        along += [f"`{it.do}`" for it in item.manoeuvre if it.do in ("path", "follow") or it.places]
        if along:
            raise InputError(f"{owner.capitalize()} has no {along[0]} beside `on_map`: that is along the road.")

    def _requirements(self, definitions: Definitions) -> Requirements | None:
        if not self.table.require:
            return None
        found = tuple(
            requirement(item.name or item.check, item.check, item.about, self.where, self.known, list(self.numbers_of))
            for item in self.table.require
        )
        _distinct([item.name for item in found], "requirement", self.where)
        return Requirements(found, definitions)

    def _number(self, formula: Formula, what: str) -> Expression:
        refuse_unit(formula, f"{what} of {self.where}")
        return checked_names(number(formula, f"{what} of {self.where}"), self.known, f"{what} of {self.where}")

    def _quantity(self, formula: Formula, what: str, at_least: float = -math.inf) -> Quantity:
        return Quantity(what, self.owner, self._number(formula, what), at_least)

    def _constraint(self, item: ConstraintTable, definitions: Definitions) -> Constraint:
        expression = checked_names(condition(item.require, self.where), self.known, self.where)
        holds = Condition(expression, definitions.needed_by(expression))
        return Constraint(item.about or f"one where {item.require}", holds, holds.room)

    def _parameter(self, item: ParameterTable) -> Parameter:
        owner = f"parameter `{item.name}` of {self.where}"
        if not item.name.isidentifier():
            raise must_be("The name", owner, "letters, digits and underscores", item.name)
        ranged = [item.low, item.high, item.step]
        check_unit(item.unit, owner, {"low": item.low, "high": item.high, "step": item.step})
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

    def _joint(self, parameters: Sequence[Parameter]) -> Joint | None:
        table = self.table.joint
        if table is None:
            return None
        for item in parameters:
            if item.distribution is not None or item.values:
                raise InputError(
                    f"Parameter `{item.name}` of {self.where} must have a range and no distribution: [joint] says how "
                    "often its values are met."
                )
        box = [item.low for item in parameters], [item.high for item in parameters]
        names = [item.name for item in parameters]
        return read_joint(self.folder / table.events, table.kind, names, box, table.bandwidth)

    def _recorded(self, parameters: Sequence[Parameter]) -> Counterpart | None:
        table, names = self.table.recorded, [item.name for item in parameters]
        if table is None:
            return None
        for name in (*table.columns, *table.tolerance):
            if name not in names:
                raise unknown(f"parameter in [recorded] of {self.where}:", name, names)
        tolerance = {item.name: table.tolerance.get(item.name, (item.high - item.low) / 10.0) for item in parameters}
        for name, within in tolerance.items():
            if not within > 0.0:
                raise must_be(f"`recorded.tolerance.{name}`", self.where, "above 0", within)
        return Counterpart(
            table.event,
            tuple((name, table.columns.get(name, name)) for name in names),
            tuple(tolerance.items()),
            table.start,
            tuple(table.only.items()),
        )

    def _recorded_ego(self) -> tuple[tuple[float, float], ...]:
        places = self.table.ego.recorded
        if len(places) == 1:
            raise must_be("`recorded`", f"[ego] of {self.where}", "two places or more", "1")
        if not all(math.isfinite(number) for place in places for number in place):
            raise must_be("`recorded`", f"[ego] of {self.where}", "finite", "a number that is not")
        return places

    def _body(self) -> EgoBody | None:
        ego = self.table.ego
        if (ego.length is None) != (ego.width is None):
            raise InputError(f"[ego] of {self.where} must have both length and width, or neither.")
        return None if ego.length is None or ego.width is None else EgoBody(ego.length, ego.width)

    def _goal(self, road: Road) -> Goal | None:
        ego = self.table.ego
        if ego.goal_lane is None:
            for key in ("change_from", "change_by"):
                if getattr(ego, key) is not None:
                    raise InputError(f"[ego] of {self.where} has a `{key}`, so it must have a `goal_lane`.")
            return None
        if ego.goal_lane >= road.lanes:
            raise must_be("`goal_lane`", f"[ego] of {self.where}", f"below {road.lanes}", ego.goal_lane)
        if ego.change_from is None:
            raise InputError(f"[ego] of {self.where} has a `goal_lane`, so it must have a `change_from`.")
        return Goal(ego.goal_lane, ego.change_from, ego.change_by, road)

    def _road(self) -> Road:
        road, end = self.table.road, self.table.end
        for key in ("lane", "crossing"):
            if getattr(road, key) and (road.network is not None or road.opendrive is not None):
                raise InputError(
                    f"[[road.{key}]] of {self.where} shapes a road that is written, and there is one already."
                )
        for other in ("network", "opendrive"):
            if road.line and getattr(road, other) is not None:
                raise InputError(f"`road.line` of {self.where} draws a road, and its `{other}` has one already.")
        if road.opendrive_road is not None and road.opendrive is None:
            raise InputError(f"`road.opendrive_road` of {self.where} names a road of an `opendrive`: there is none.")
        if road.opendrive is not None:
            return self._opendrive(road.opendrive)
        if road.network is not None:
            read = read_road(self.folder / road.network, road.edges, end.x)
            return replace(read, network=None) if self._reacts() else read  # shadows of bodies have lanes in ours alone
        if road.edges:
            raise InputError(f"`road.edges` of {self.where} name edges of a `network`, and there is none.")
        if end.x > road.length:
            raise must_be("`end.x`", self.where, f"at most the road's length {road.length:g}", end.x)
        line = line_of(road.line, self.options, road.lanes, road.lane_width, road.length, self.where)
        name = road.name or f"road_{road.lanes}x{road.lane_width:g}m_{end.x:g}m_of_{road.length:g}m"
        name += bend_name(line, named=road.name is not None)
        spans = spans_of(road.lane, road.lanes, road.length, self.where)
        crossings = crossings_of(road.crossing, road.length, line, self.where)
        if road.name is None and (spans or crossings):
            name += f"_{hashlib.sha256(repr((spans, crossings)).encode()).hexdigest()[:6]}"
        return Road(
            name, end.x, road.lanes, road.lane_width, road.length - end.x, line=line, spans=spans, crossings=crossings
        )

    def _reacts(self) -> bool:
        """Whether somebody in it is driven by a model of SUMO's."""
        vehicles = [*self.table.vehicle, *(it for option in self.table.option for it in option.given.vehicle)]
        return bool(self.table.stream) or any(move.do == "follow" for it in vehicles for move in it.manoeuvre)

    def _opendrive(self, file: str) -> Road:
        road, end = self.table.road, self.table.end
        if road.network is not None or road.edges:
            raise InputError(f"[road] of {self.where} must have either `network` or `opendrive`.")
        path = self.folder / file
        read = read_opendrive(path, road.opendrive_road)
        if end.x > read.length:
            raise must_be("`end.x`", self.where, f"at most the road's length {read.length:.1f} m", end.x)
        check_line(read.line, read.lanes, read.lane_width, f"the road of {path.name}")
        if read.spans and read.line:
            raise InputError(f"The road of {path.name} must be straight where its outermost lane opens or ends.")
        name = (road.name or path.stem) + bend_name(read.line, named=False)
        if read.spans:
            name += f"_{hashlib.sha256(repr(read.spans).encode()).hexdigest()[:6]}"
        return Road(name, end.x, read.lanes, read.lane_width, read.length - end.x, line=read.line, spans=read.spans)

    def _all_used(self, parameters: Sequence[Parameter], definitions: Definitions, told_by: list[Expression]) -> None:
        """A parameter that nothing depends on would only repeat cases. InputError naming it."""
        table = self.table
        zone = table.zone
        texts = [] if zone == "none" else [zone.delay, zone.gap, zone.conflict_begin, zone.margin]
        expressions = [*told_by, *(number(text, self.where) for text in texts if text is not None)]
        expressions += [number(text, self.where) for item in table.sample for text in item.set.values()]
        needed = definitions.needed_by(*expressions)
        names = set().union(*(it.names for it in expressions), *(it.names for _, it in needed.entries))
        for parameter in parameters:
            if parameter.name not in names:
                raise InputError(
                    f"Parameter `{parameter.name}` of {self.where} must be used: nothing in the scene depends on it."
                )

    def _stream(self, item: StreamTable) -> Stream:
        what = f"stream `{item.name}`"
        check_name("`name`", f"a stream of {self.where}", item.name)
        if item.lane >= self.road.lanes:
            raise must_be("`lane`", f"{what} of {self.where}", f"below {self.road.lanes}", item.lane)
        above = ("density", "speed", "headway", "min_gap", "acceleration", "deceleration")
        numbers = [(key, self._quantity(getattr(item, key), f"{key} of {what}")) for key in ("begin", "end")]
        for key in above:
            numbers.append((key, replace(self._quantity(getattr(item, key), f"{key} of {what}"), above=0.0)))
        spread = Spread(item.speed_spread, item.spacing_spread, item.seed)
        return Stream(item.name, item.lane, tuple(numbers), spread, item.model, item.body)

    def _vehicle(self, item: VehicleTable) -> Vehicle:
        what = f"vehicle `{item.name}`"
        places = {"gap": item.gap, "gap_behind": item.gap_behind, "x": item.x}
        chosen = [key for key, value in places.items() if value is not None]
        if len(chosen) != 1:
            raise InputError(f"{what.capitalize()} of {self.where} must have either gap, gap_behind or x.")
        moves = tuple(self._move(move, what) for move in item.manoeuvre)
        lively = item.heading is not None or item.lateral_speed is not None or any(move.lively for move in moves)
        if sum(move.do == "brake" for move in moves) > 1 and not lively:
            raise InputError(f"{what.capitalize()} of {self.where} must brake at most once.")
        if any(move.do == "follow" for move in moves[:-1]):
            raise InputError(f"{what.capitalize()} of {self.where} must do nothing after it does `follow`.")
        at_once = any(move.do == "follow" and move.when is None for move in moves)
        if at_once and (len(moves) > 1 or item.heading or item.lateral_speed):
            raise InputError(
                f"{what.capitalize()} of {self.where} must do nothing else where it does `follow` from the start: "
                "`when` says from when on it does."
            )
        if item.heading is not None and item.lateral_speed is not None:
            raise InputError(f"{what.capitalize()} of {self.where} must have either heading or lateral_speed.")
        value = places[chosen[0]]
        assert value is not None
        place = self._quantity(value, f"{chosen[0]} of {what}")
        sideways = item.lateral_speed if item.heading is None else item.heading
        key = "lateral_speed" if item.heading is None else "heading"
        standard = BODIES[item.body]
        return Vehicle(
            name=item.name,
            speed=self._quantity(item.speed, f"speed of {what}", at_least=0.0),
            place=place,
            by_gap=item.gap is not None,
            y=self._quantity(item.y, f"y of {what}"),
            length=standard.length if item.length is None else item.length,
            width=standard.width if item.width is None else item.width,
            slides=item.slides,
            moves=moves,
            behind=item.gap_behind is not None,
            heading=None if sideways is None else self._quantity(sideways, f"{key} of {what}"),
            by_lateral_speed=item.lateral_speed is not None,
            body=item.body,
            on_map=item.on_map,
        )

    def _move(self, item: ManoeuvreTable, what: str) -> Move:
        needed, allowed = _NEEDS[item.do]
        name = f"`{item.do}` of {what}"
        numbers = [("begin", self._quantity(item.begin, f"begin of {name}", at_least=0.0))]
        for key in _KEYS:
            value = getattr(item, key)
            absent = value is None or value == ()
            if absent and key in needed:
                raise InputError(f"{name} in {self.where} must have `{key}`.")
            if not absent and key not in (*needed, *allowed):
                raise InputError(f"{name} in {self.where} has no `{key}`.{did_you_mean(key, (*needed, *allowed))}")
            if not absent and key not in _LISTS:
                quantity = self._quantity(value, f"{key} of {name}")
                above = 0.0 if (item.do, key) in _ABOVE_ZERO else -math.inf
                endless = key == "jerk" or (key == "acceleration" and item.do == "move_sideways")
                least = 0.0 if (item.do, key) == ("accelerate", "speed") else -math.inf
                numbers.append((key, replace(quantity, above=above, endless=endless, at_least=least)))
        if item.do == "sinus" and item.cycles is None:
            numbers.append(("cycles", self._quantity(1.0, f"cycles of {name}")))
        if item.do == "follow" and item.when is None and item.begin != 0.0:
            raise InputError(
                f"{name} in {self.where} has no `begin` without a `when`: a vehicle follows from the start."
            )
        when = None
        if item.when is not None:
            departs = item.do == "follow" and bool(self.table.ego.recorded)
            when = trigger(
                item.when, f"{name} in {self.where}", self.known, self.numbers_of, self.moves_of, departs=departs
            )
        table, by_place = self._table(item, name)
        return Move(item.do, tuple(numbers), table, by_place, when, item.name, item.model or "")

    def _table(self, item: ManoeuvreTable, name: str) -> tuple[tuple[tuple[Quantity, Quantity], ...], bool]:
        """Pairs of a path or a profile, and whether a profile's are places."""
        if item.do == "speed_profile":
            where = item.places or item.times
            if bool(item.places) == bool(item.times) or len(where) != len(item.speeds):
                raise InputError(f"{name} in {self.where} must have as many `times` (or `places`) as `speeds`, "
                                 f"got {len(where)} and {len(item.speeds)}.")  # fmt: skip
            pairs = [(self._quantity(one, f"times or places of {name}"),
                      self._quantity(two, f"speeds of {name}", at_least=0.0))
                     for one, two in zip(where, item.speeds, strict=True)]  # fmt: skip
            return tuple(pairs), bool(item.places)
        if item.do != "path":
            return (), False
        if bool(item.points) == bool(item.lanes) or len(item.lanes) != len(item.places):
            raise InputError(f"{name} in {self.where} must have either `points`, or as many `lanes` as `places`.")
        road = self.road
        for lane in item.lanes:
            if not 0 <= lane < road.lanes:
                raise must_be("Each of `lanes`", f"{name} in {self.where}", f"within 0..{road.lanes - 1}", lane)
        points = item.points or tuple(
            (place, road.lane_width * lane) for place, lane in zip(item.places, item.lanes, strict=True)
        )
        return tuple(
            (self._quantity(x, f"path of {name}"), self._quantity(y, f"path of {name}")) for x, y in points
        ), False

    def _zone(self, definitions: Definitions, vehicles: Sequence[Vehicle]) -> ZoneRule:
        zone = self.table.zone
        assert zone != "none"
        by_name = {item.name: item for item in vehicles}
        if zone.obstacle not in by_name:
            raise unknown(f"vehicle in `zone.obstacle` of {self.where}:", zone.obstacle, by_name)
        obstacle = by_name[zone.obstacle]
        if zone.gap is None and not obstacle.by_gap:
            raise InputError(f"[zone] of {self.where} must have a `gap`: vehicle `{obstacle.name}` starts at an x.")
        braking = [dict(move.numbers)["deceleration"].expression for move in obstacle.moves if move.do == "brake"]
        parts = {
            "ego_speed": self._number(self.table.ego.speed, "`ego.speed`"),
            "obstacle_speed": obstacle.speed.expression,
            "gap": obstacle.place.expression if zone.gap is None else self._number(zone.gap, "`zone.gap`"),
            "delay": self._number(zone.delay, "`zone.delay`"),
            "obstacle_deceleration": braking[0] if braking else Expression("0.0"),
            "conflict_begin": self._number(zone.conflict_begin, "`zone.conflict_begin`"),
        }
        return ZoneRule(
            definitions=definitions.needed_by(*parts.values()),
            passing_length=math.inf if zone.passing_length is None else zone.passing_length,
            **parts,
        )

    def _margin(self, definitions: Definitions) -> Margin | None:
        zone = self.table.zone
        if zone == "none" or zone.margin is None:
            if zone != "none" and not zone.obstacle:
                raise InputError(f"[zone] of {self.where} must have an `obstacle`, or a `margin`.")
            return None
        for key, default in (("obstacle", ""), ("delay", 0.0), ("gap", None), ("conflict_begin", 0.0),
                             ("passing_length", None)):  # fmt: skip
            if getattr(zone, key) != default:
                raise InputError(f"[zone] of {self.where} has no `{key}` beside `margin`, which says all.")
        expression = self._number(zone.margin, "`zone.margin`")
        return Margin(definitions.needed_by(expression), expression)

    def _search(self, definitions: Definitions, vehicles: Sequence[Vehicle]) -> SearchRule:
        zone = self.table.zone
        assert zone != "none"
        by_name = {item.name: index for index, item in enumerate(vehicles)}
        if zone.obstacle not in by_name:
            raise unknown(f"vehicle in `zone.obstacle` of {self.where}:", zone.obstacle, by_name)
        for key, default in (("gap", None), ("conflict_begin", 0.0), ("passing_length", None)):
            if getattr(zone, key) != default:
                raise InputError(
                    f"[zone] of {self.where} has no `{key}`: what a vehicle does that is played is searched as it is."
                )
        delay = self._number(zone.delay, "`zone.delay`")
        return SearchRule(by_name[zone.obstacle], definitions.needed_by(delay), delay, zone.conflict)

    def _coordinates(self, definitions: Definitions) -> ZoneCoordinates | None:
        given = None if self.table.zone == "none" else self.table.zone.coordinates
        if not given:
            return None
        expressions = tuple(self._number(formula, f"zone.coordinates `{name}`") for name, formula in given.items())
        return ZoneCoordinates(tuple(given), Coordinates(definitions.needed_by(*expressions), expressions))

    def _sample(self, item: SampleTable, parameters: Sequence[Parameter]) -> NamedSample:
        owner = f"sample `{item.name}` of {self.where}"
        names = [parameter.name for parameter in parameters]
        for name in (*item.columns, *item.each, *item.set):
            if name not in names:
                raise unknown(f"parameter in {owner}:", name, names)
        columns = item.columns or [name for name in names if name not in item.each and name not in item.set]
        held = _distinct([*columns, *item.each, *item.set], "parameter", owner)
        for name in names:
            if name not in held:
                raise InputError(f"Parameter `{name}` of {owner} is missing: `columns`, `each` or `set` must have it.")
        factors = [self._factor(item, columns, parameters, name) for name in columns]
        given = [*item.each, *columns]
        derived = {
            name: Quantity(name, owner, checked_names(number(formula, f"`set.{name}` of {owner}"), given, owner))
            for name, formula in item.set.items()
        }
        points = []
        for further in itertools.product(*item.each.values()):
            for row in item.points:
                if len(row) != len(columns):
                    raise must_be("Each point", owner, f"{len(columns)} numbers", list(row))
                scaled = [value * factor for value, factor in zip(row, factors, strict=True)]
                values = dict(zip(given, (*further, *scaled), strict=True))
                values |= {name: quantity.at(values) for name, quantity in derived.items()}
                points.append(tuple(values[name] for name in names))
        return NamedSample(item.name, item.about or item.name, tuple(points))

    def _factor(self, item: SampleTable, columns: Sequence[str], parameters: Sequence[Parameter], name: str) -> float:
        """What the numbers of a column are multiplied by to be in the parameter's unit."""
        for column in item.units:
            if column not in columns:
                raise unknown(f"column in `units` of sample `{item.name}` of {self.where}:", column, columns)
        own = next(parameter.unit for parameter in parameters if parameter.name == name)
        return factor_to(own, item.units.get(name, own), f"column `{name}` of sample `{item.name}` of {self.where}")


def _quantities(vehicle: Vehicle) -> list[Quantity]:
    """All quantities of a vehicle."""
    moves = [quantity for move in vehicle.moves for _, quantity in move.numbers]
    tables = [quantity for move in vehicle.moves for pair in move.table for quantity in pair]
    heading = [] if vehicle.heading is None else [vehicle.heading]
    return [vehicle.speed, vehicle.place, vehicle.y, *heading, *moves, *tables]


def _distinct(names: Iterable[str], kind: str, where: str) -> list[str]:
    seen: list[str] = []
    for name in names:
        if name in seen:
            raise InputError(f"Every {kind} of {where} must have a name of its own, got `{name}` twice.")
        seen.append(name)
    return seen


def _exposure_about(spread: Sequence[Parameter], density: Expression | None, joint: Joint | None) -> str:
    parts = [f"{item.name} as {item.distribution}" for item in spread] + ([] if joint is None else [str(joint)])
    parts += [] if density is None else [f"times `{density.text}`"]
    return ", ".join(parts) if parts else "uniform: every concrete scenario counts the same"
