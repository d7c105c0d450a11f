"""Tables and keys of a scenario file, each with its unit; each table builds its own value by its
method `read`.

pydantic fills the tables from a file; `scenario/vehicle_tables.py`, `scenario/streams.py`,
`scenario/zone_table.py`, `scenario/road/table.py` and `scenario/road/lanes.py` have the other
tables. The names of keys are a public format, and docs/reference/scenario_file.md lists them.

Users: `scenario/file.py` reads files by these tables, `scenario/schema.py` describes them.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import MinLen

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.frozen import frozen, required
from sumo_eval.input_file import sha256
from sumo_eval.scenario.concrete import CHANGES, Numbers, Road
from sumo_eval.scenario.distribution import Distribution
from sumo_eval.scenario.expression import (
    Definitions,
    check_variable,
    checked_names,
    condition,
    number,
)
from sumo_eval.scenario.formulas import (
    ExposureDensity,
    Formula,
    Formulas,
    FormulaValue,
    LimitedFormula,
    Names,
)
from sumo_eval.scenario.joint import Joint, JointKind
from sumo_eval.scenario.logical import (
    Constraint,
    Counterpart,
    LogicalScenario,
    NamedSample,
    Occurrence,
    Option,
    Parameter,
)
from sumo_eval.scenario.number_table import read_numbers
from sumo_eval.scenario.requirement import Requirement, Requirements, requirement
from sumo_eval.scenario.road.lanes import Crossing, CrossingTable, LaneTable, crossings_of, spans_of
from sumo_eval.scenario.road.opendrive import ReadRoad, read_opendrive
from sumo_eval.scenario.road.table import PieceTable, bend_name, check_line, line_of
from sumo_eval.scenario.streams import StreamTable
from sumo_eval.scenario.sumo_network import read_road
from sumo_eval.scenario.units import check_unit, check_uses, factor_to, in_own_unit
from sumo_eval.scenario.vehicle_tables import EgoTable, Placement, VehicleTable
from sumo_eval.scenario.zone_table import ZoneTable
from sumo_eval.settings.checked import (
    Checked,
    FilledText,
    PositiveFloat,
    PositiveInt,
    PositiveOrNone,
    empty_table,
    optional,
    setting,
)
from sumo_eval.text import capitalised


@frozen
class ParameterTable(Checked):
    """One axis of the space."""

    name: FilledText = required("name, for expressions and tables")
    unit: FilledText = required("unit; `1` for a share")
    about: str = setting("", "what it is")
    low: float | None = optional("lower end of the range")
    high: float | None = optional("upper end of the range")
    step: float | None = optional("step of the default grid")
    values: tuple[float, ...] = setting(
        (), "instead of low, high and step: the only values there are"
    )
    distribution: dict[str, str | float] | None = optional(
        "how often values occur: `name` of a continuous distribution of scipy.stats, and "
        "its arguments",
    )

    def read(self, where: str) -> Parameter:
        """The axis of the space.

        where: how errors call the file.
        """
        owner = f"parameter `{self.name}` of {where}"
        # its name may be one of `CHANGES`: settings of the simulation that differ between cases
        check_variable(self.name, owner, CHANGES)
        low, high, step = self._range(owner)
        spread = self._distribution(owner)
        parameter = Parameter(
            self.name, low, high, step, self.unit, self.about, self.values, spread
        )
        if spread is not None and not spread.inside(low, high) > 0.0:
            raise must_be(
                f"Distribution {spread}", owner, f"possible within {low:g}..{high:g}", 0.0
            )
        return parameter

    def _range(self, owner: str) -> tuple[float, float, float]:
        """Lower end, upper end and step of the axis; of listed values the least distance is the
        step.
        """
        ranged = {"low": self.low, "high": self.high, "step": self.step}
        check_unit(self.unit, owner, ranged)
        if bool(self.values) == any(value is not None for value in ranged.values()):
            raise InputError(
                f"{capitalised(owner)} must have either low, high and step, or values."
            )
        if self.values:
            if len(self.values) < 2:
                raise must_be("`values`", owner, "at least two numbers", list(self.values))
            step = min(b - a for a, b in itertools.pairwise(self.values))
            return self.values[0], self.values[-1], step
        if missing := [f"`{key}`" for key, value in ranged.items() if value is None]:
            raise InputError(f"{' and '.join(missing)} of {owner} must be given.")
        low, high, step = (value for value in ranged.values() if value is not None)
        return low, high, step

    def _distribution(self, owner: str) -> Distribution | None:
        """How often values occur; None: unknown."""
        if self.distribution is None:
            return None
        arguments = dict(self.distribution)
        name = arguments.pop("name", None)
        if not isinstance(name, str):
            raise InputError(f"The distribution of {owner} must have a `name`.")
        for key, value in arguments.items():
            if isinstance(value, str):
                raise must_be(f"`{key}`", f"the distribution of {owner}", "a number", value)
        # mypy does not know that the loop has refused all texts
        return Distribution.of(name, arguments, owner)  # type: ignore[arg-type]


@frozen
class ConstraintTable(Checked):
    """Constraint on the points of the box."""

    require: str = required("a condition on the parameters, e.g. `lead_speed < ego_speed`")
    about: str = setting("", "the same in words: the point must be ...")

    def read(self, names: Names) -> Constraint:
        """The condition on points."""
        expression = checked_names(condition(self.require, names.where), names.known, names.where)
        holds = FormulaValue(Formulas.of(names.definitions, expression))
        return Constraint(self.about or f"one where {self.require}", holds, room=holds.room)


@frozen
class RoadTable(Checked):
    """A road, written for the scenario, or found in a network of the user's."""

    name: str | None = optional("name of its files; default: from its measures")
    lanes: PositiveInt = setting(2, "number of lanes")
    lane_width: PositiveFloat = setting(3.5, "width of each lane", "m")
    length: PositiveFloat = setting(
        6000.0, "length of the road; the end of the case is in [end]", "m"
    )
    network: str | None = optional("a .net.xml instead, relative to this file")
    edges: tuple[str, ...] = setting((), "the edges of that network to drive along, in order")
    line: tuple[PieceTable, ...] = setting(
        (),
        "the right lane's centre line from x = 0 on, piece by piece; behind the last one it "
        "is straight",
    )
    opendrive: str | None = optional(
        "an .xodr instead, relative to this file: its line, its lanes and its length"
    )
    opendrive_road: str | tuple[str, ...] | None = optional(
        "id of the road in that file, where it has several; or of those to drive along, in order",
    )
    lane: tuple[LaneTable, ...] = setting(
        (), "lanes that open, end, or are ramps; `lanes` includes them"
    )
    crossing: tuple[CrossingTable, ...] = setting((), "roads that cross this one")

    def read(
        self, end: float, options: Numbers, where: str, folder: Path, *, reacts: bool
    ) -> tuple[Road, tuple[str, ...]]:
        """The road, and words for contents of its file that have no effect.

        end: x at which cases end, m.

        options: the value of every option.
        where: how errors call the file. folder: where its paths start.
        reacts: whether a SUMO model drives any actor on the road.
        """
        self._check_keys(where)
        if self.network is not None:
            road = read_road(folder / self.network, self.edges, end)
            # where vehicles react, lanes must be the package's own (shadows in `cosim/traffic.py`):
            # with None a network is written instead of the user's
            return replace(road, network=None) if reacts else road, ()

        crossings: tuple[Crossing, ...] = ()
        # Different roads need different names: exported files are called by them. `hashed` is the
        # part of the shape that the name does not show; nothing if the user has named the road.
        if self.opendrive is not None:
            path = folder / self.opendrive
            shape = self._of_opendrive(path)
            name = (self.name or path.stem) + bend_name(shape.line, named=False)
            hashed: tuple[Any, ...] = shape.spans
        else:
            line = line_of(self.line, options, self.lanes, self.lane_width, self.length, where)
            spans = spans_of(self.lane, self.lanes, self.length, where)
            shape = ReadRoad(line, self.lanes, self.lane_width, spans, self.length)
            crossings = crossings_of(self.crossing, self.length, line, where)
            name = f"road_{self.lanes}x{self.lane_width:g}m_{end:g}m_of_{self.length:g}m"
            name = (self.name or name) + bend_name(line, named=self.name is not None)
            hashed = (spans, crossings) if self.name is None and (spans or crossings) else ()
        if end > shape.length:
            raise must_be("`end.x`", where, f"at most the road's length {shape.length:g} m", end)
        if hashed:
            name += f"_{sha256(repr(hashed))[:6]}"
        road = Road(name, end, shape.lanes, shape.lane_width, shape.length - end, line=shape.line,
                    spans=shape.spans, crossings=crossings)  # fmt: skip
        return road, shape.left_out

    def _check_keys(self, where: str) -> None:
        """Refuse keys that cannot stand together."""
        sources = [key for key in ("network", "opendrive") if getattr(self, key) is not None]
        shapes = [key for key in ("lane", "crossing", "line") if getattr(self, key)]
        if sources and shapes:
            raise InputError(
                f"`road.{shapes[0]}` of {where} must not stand beside `{sources[0]}`: it shapes a "
                "road that is written for the scenario."
            )
        if len(sources) > 1:
            raise InputError(f"[road] of {where} must have either `network` or `opendrive`.")
        for key, source in (("opendrive_road", "opendrive"), ("edges", "network")):
            if getattr(self, key) and source not in sources:
                raise InputError(f"`road.{key}` of {where} is of a `{source}`, and there is none.")

    def _of_opendrive(self, path: Path) -> ReadRoad:
        """The road of an OpenDRIVE file, on which the ego can drive every lane."""
        shape = read_opendrive(path, self.opendrive_road)
        check_line(shape.line, shape.lanes, shape.lane_width, f"the road of {path.name}")
        if shape.spans and shape.line:
            raise InputError(
                f"The road of {path.name} must be straight where its outermost lane opens or ends."
            )
        return shape


@frozen
class EndTable(Checked):
    """Further ends of a case, after contact, standstill and leaving the road."""

    x: PositiveFloat = setting(600.0, "the ego's centre reaches this place", "m")
    time: PositiveOrNone = optional("simulated time; default: the simulation's own", "s")
    standstill: PositiveOrNone = optional(
        "how long the ego must stand, for scenes in which it has to drive off again; default: "
        "the simulation's own",
        "s",
    )


@frozen
class SampleTable(Checked):
    """Prescribed points: every row of `points` with every combination of the values in `each`; the
    other parameters are computed by `set`.
    """

    name: FilledText = required("name, for `method` of an evaluation's sampling")
    points: Annotated[tuple[tuple[float, ...], ...], MinLen(1)] = required("the rows")
    about: str = setting("", "what they are")
    columns: tuple[str, ...] = setting(
        (), "the parameters that a row holds; default: all that `each` and `set` do not, in order"
    )
    units: dict[str, str] = empty_table(
        "units of columns, where not the parameters': km/h instead of m/s"
    )
    each: dict[str, Annotated[tuple[float, ...], MinLen(1)]] = empty_table(
        "parameter = values: every row with each of them"
    )
    set: dict[str, Formula] = empty_table(
        "parameter = expression of those that rows and `each` hold"
    )

    def read(self, names: Names, units: Mapping[str, str]) -> NamedSample:
        """The points, each in the order of the parameters.

        units: of the parameters by name, in the order of the parameters.
        """
        owner = f"sample `{self.name}` of {names.where}"
        columns = self._columns(names, units, owner)
        factors = [
            factor_to(units[name], self.units.get(name, units[name]), f"column `{name}` of {owner}")
            for name in columns
        ]
        # the parameters that need no formula; the formulas of `set` may use them
        direct = [*self.each, *columns]
        inner = replace(names, known=direct)
        derived = {
            name: LimitedFormula(name, owner, inner.expression(formula, f"`set.{name}` of {owner}"))
            for name, formula in self.set.items()
        }
        points = []
        combinations = itertools.product(*self.each.values())
        for combination, row in itertools.product(combinations, self.points):
            if len(row) != len(columns):
                raise must_be("Each point", owner, f"{len(columns)} numbers", list(row))
            scaled = itertools.starmap(in_own_unit, zip(row, factors, strict=True))
            values = dict(zip(direct, (*combination, *scaled), strict=True))
            values |= {name: formula.at(values) for name, formula in derived.items()}
            points.append(tuple(values[name] for name in units))
        return NamedSample(self.name, self.about or self.name, tuple(points))

    def _columns(self, names: Names, units: Mapping[str, str], owner: str) -> Sequence[str]:
        """The parameters that a row holds.

        Raises InputError unless each parameter comes from one of `columns`, `each` and `set`.
        """
        check_known(f"parameter in {owner}:", units, *self.columns, *self.each, *self.set)
        columns = self.columns or [
            name for name in units if name not in self.each and name not in self.set
        ]
        named = names.distinct([*columns, *self.each, *self.set], "parameter", owner)
        for name in units:
            if name not in named:
                raise InputError(
                    f"Parameter `{name}` of {owner} is missing: `columns`, `each` or `set` must "
                    "have it."
                )
        check_known(f"column in `units` of {owner}:", columns, *self.units)
        return columns


@frozen
class GivenTable(Checked):
    """Changes to the scenario where an option is given."""

    suffix: Annotated[str | None, MinLen(1)] = optional(
        "appended to the scenario's name after `_`, `{value}` in it is what is given; "
        "default: the option's name",
    )
    about: str | None = optional("what happens then, instead of the scenario's own `about`")
    road: RoadTable | None = optional("the road then, instead of the scenario's own")
    vehicle: tuple[VehicleTable, ...] = setting(
        (), "further vehicles then, in addition to the scenario's own"
    )


@frozen
class OptionTable(Option):
    """A number that `use` may set: `use = "cut_in?lateral_acceleration=1.5"`."""

    default: float | None = optional("its value if `use` does not set it; default: infinite")
    above: float | None = optional("what is given must be greater than that")
    given: GivenTable = setting(GivenTable(), "what else is different where it is given")


@frozen
class JointTable(Checked):
    """Exposure of points from recorded events, with the dependence between parameters."""

    events: FilledText = required(
        "CSV with a row an event and a column a parameter, relative to this file"
    )
    kind: JointKind = setting(
        "kde",
        "kde: a Gaussian at each event; copula: each parameter by a KDE of its own, and their "
        "correlation",
    )
    bandwidth: PositiveOrNone = optional("kernel deviation divided by the data's; default: Scott's")

    def read(self, parameters: Sequence[Parameter], where: str, folder: Path) -> Joint:
        """The density, over all parameters of the scenario.

        where: how errors call the file. folder: where the path of the events starts.
        """
        for item in parameters:
            if item.distribution is not None or item.values:
                raise InputError(
                    f"Parameter `{item.name}` of {where} must have a range and no distribution: "
                    "[joint] says how often its values occur."
                )
        path = folder / self.events
        units = {item.name: item.unit for item in parameters}
        return Joint(
            self.kind,
            tuple(units),
            tuple(map(tuple, read_numbers(path, "events", units).rows.tolist())),
            tuple(item.low for item in parameters),
            tuple(item.high for item in parameters),
            self.bandwidth,
            path.name,
        )


@frozen
class RecordedTable(Checked):
    """The events of recordings that are this scenario."""

    event: Literal["approach", "cut_out", "cut_in", "lead_braking"] = required(
        "kind of event, as `humans events` finds them"
    )
    columns: dict[str, str] = empty_table(
        "parameter = column of the events; default: the column of the parameter's name"
    )
    tolerance: dict[str, float] = empty_table(
        "how far a parameter may be from the event's; default: a tenth of its range"
    )
    start: str = setting("", "column with the time that is the scenario's t = 0; default by event")
    only: dict[str, str] = empty_table("column = value that an event must have")

    def read(self, parameters: Sequence[Parameter], where: str) -> Counterpart:
        """The events that correspond to the scenario.

        They are compared by its parameters. Those in `CHANGES` are settings of the simulation, for
        which recordings have no column.
        """
        parameters = [item for item in parameters if item.name not in CHANGES]
        names = [item.name for item in parameters]
        check_known(f"parameter in [recorded] of {where}:", names, *self.columns, *self.tolerance)
        tolerance = {
            item.name: self.tolerance.get(item.name, (item.high - item.low) / 10.0)
            for item in parameters
        }
        for name, largest in tolerance.items():
            if not largest > 0.0:
                raise must_be(f"`recorded.tolerance.{name}`", where, "above 0", largest)
        columns = tuple((name, self.columns.get(name, name)) for name in names)
        # `t` and `start`: columns of the tables that `drivers/recorded/events.py` makes
        start = self.start or ("t" if self.event == "approach" else "start")
        return Counterpart(
            self.event, columns, tuple(tolerance.items()), start, tuple(self.only.items())
        )


@frozen
class RequireTable(Checked):
    """A condition on every drive; cases that miss it are counted next to the scores."""

    check: str = required(
        "a condition on the whole drive: min, max, at_end of time, x, offset, speed, "
        "acceleration, jerk, lateral_speed, gap, thw, ttc, and x, y, speed, lateral_speed of "
        "another vehicle, as `x(lead)`; collided, reached_end; e.g. `min(gap) > 2 and collided "
        "== 0`"
    )
    name: str = setting("", "name in tables; default: the check itself")
    about: str = setting("", "the same in words")


@frozen
class ScenarioFile(Checked):
    """A logical scenario file."""

    name: FilledText = required("name of the scenario")
    parameter: tuple[ParameterTable, ...] = required("the axes of the space")
    ego: EgoTable = required("the vehicle under test")
    zone: ZoneTable | Literal["none"] = required(
        "zone rule; `none`: no zone can be defined, everything is safe, C and A are by outcome"
    )
    vehicle: tuple[VehicleTable, ...] = setting((), "the actors")
    stream: tuple[StreamTable, ...] = setting((), "traffic of a given density")
    about: str = setting("", "what happens, a sentence")
    source: str = setting("a scenario file", "where it comes from")
    define: dict[str, Formula] = empty_table("names for expressions, each may use those above it")
    option: tuple[OptionTable, ...] = setting((), "numbers that `use` may set")
    constraint: tuple[ConstraintTable, ...] = setting((), "which points of the box exist")
    exposure: str | None = optional(
        "density, an expression; multiplies the parameters' distributions"
    )
    joint: JointTable | None = optional(
        "density by events, instead of the parameters' distributions"
    )
    met: Occurrence | None = optional("how often it occurred on the road")
    recorded: RecordedTable | None = optional("the events of recordings that are this scenario")
    road: RoadTable = setting(RoadTable(), "the road")
    end: EndTable = setting(EndTable(), "when a case is over")
    sample: tuple[SampleTable, ...] = setting((), "prescribed points")
    default_sample: str = setting("grid", "grid, or the name of a sample")
    people: Literal["drivers", "none"] = setting(
        "drivers", "none: no synthetic driver knows this scene, so D and H need recorded ones"
    )
    require: tuple[RequireTable, ...] = setting((), "what must hold in every drive")

    def logical(self, options: Numbers, where: str, folder: Path) -> LogicalScenario:
        """The logical scenario.

        options: the value of every option.
        where: how errors call the file.
        folder: where its paths start.
        """
        parameters = tuple(item.read(where) for item in self.parameter)
        if not parameters:
            raise InputError(f"{where} must have at least one [[parameter]].")
        names = self._names(parameters, options, where)
        road, ignored = self.road.read(self.end.x, options, where, folder, reacts=self._reacts)
        placement = self._place(names, road)
        constraints = tuple(item.read(names) for item in self.constraint)
        requirements = tuple(
            requirement(item.name or item.check, item.check, item.about, where, names.known,
                        list(names.vehicles))
            for item in self.require
        )  # fmt: skip
        names.distinct((item.name for item in requirements), "requirement")
        self._check_used(names, requirements)
        units = {item.name: item.unit for item in parameters}
        names.distinct((item.name for item in self.sample), "sample")
        notes = [f"Not simulated: {', '.join(ignored)}."] if ignored else []
        if self.zone == "none":
            notes.append("It declares no zones, so every point counts as safe.")
        elif self.ego.goal_lane is not None and self.zone.obstacle and not self.zone.conflict:
            notes.append(
                "Its zones take the ego to keep its first lane; with `zone.conflict = true` they "
                "take it to change lanes."
            )
        return LogicalScenario(
            name=self.name,
            about=self.about or self.name,
            source=self.source,
            parameters=parameters,
            constraints=constraints,
            road=road,
            place=placement,
            recorded=None if self.recorded is None else self.recorded.read(parameters, where),
            met=self.met,
            ego_body=self.ego.body,
            time_limit=self.end.time,
            standstill_time=self.end.standstill,
            samples=tuple(item.read(names, units) for item in self.sample),
            default_sample=self.default_sample,
            has_drivers=self.people == "drivers",
            notes=tuple(notes),
            options=self.option,
            requirements=Requirements(requirements, names.definitions) if requirements else None,
            **self._exposure(parameters, names, folder, constraints),
            **self._zones(names, placement),
        )

    @property
    def _reacts(self) -> bool:
        """Whether a SUMO model drives any vehicle, also one that only an option adds: so one file
        has one kind of road.
        """
        vehicles = [*self.vehicle, *(it for option in self.option for it in option.given.vehicle)]
        follows = any(move.do == "follow" for it in vehicles for move in it.manoeuvre)
        return follows or bool(self.stream)

    def _zones(self, names: Names, placement: Placement) -> dict[str, Any]:
        """Keywords of the logical scenario for its zone rule."""
        if self.zone == "none":
            return {}
        # where the motion has no closed form, the zones need a search
        searched = placement.lively or placement.road.shaped or self.ego.goal_lane is not None
        return self.zone.read(names, placement, searched=searched or self.zone.conflict)

    def _names(self, parameters: Sequence[Parameter], options: Numbers, where: str) -> Names:
        """The names that formulas may use, with the definitions.

        options: the value of every option. where: how errors call the file.
        """
        for option in self.option:
            check_unit(
                option.unit, f"option `{option.name}` of {where}", {"default": option.default}
            )
            check_variable(option.name, f"an option of {where}")
        # by vehicle and name of a manoeuvre: number of its act
        acts = {item.name: item.endings for item in self.vehicle}
        names = Names(where, f"scenario `{self.name}`", [], acts, bool(self.ego.recorded))
        named: Sequence[Parameter | OptionTable] = (*parameters, *self.option)
        names.known.extend(names.distinct((item.name for item in named), "parameter and option"))
        check_uses(self, {item.name: item.unit for item in named}, where)
        entries = []
        for name, formula in self.define.items():
            check_variable(name, f"a definition of {where}")
            if name in names.known:
                raise InputError(
                    f"`{name}` in [define] of {where} must differ from parameters and options."
                )
            entries.append((name, names.expression(formula, f"[define] {name}")))
            names.known.append(name)
        return replace(names, definitions=Definitions(tuple(entries), tuple(options.items())))

    def _place(self, names: Names, road: Road) -> Placement:
        """The ego's start and the actors as a function of a point's values."""
        vehicles = tuple(item.read(names, road) for item in self.vehicle)
        streams = tuple((item, item.read(names, road)) for item in self.stream)
        if not vehicles and not streams and self.zone != "none":
            raise InputError(f"{names.where} must have at least one [[vehicle]] or [[stream]].")
        names.distinct(["ego", *(item.name for item in self.vehicle)], "vehicle")
        self.ego.check(names.where, road)
        numbers = names.quantities(self.ego, "the ego")
        # the reads above have put the expressions of the ego and all vehicles into `names.scene`
        needed = names.definitions.needed_by(*names.scene)
        return Placement(needed, names.owner, road, self.ego, numbers, vehicles, streams)

    def _check_used(self, names: Names, requirements: Sequence[Requirement]) -> None:
        """Raise InputError for a parameter that nothing depends on: it would only repeat cases."""
        zone = self.zone
        formulas = (
            [] if zone == "none" else [zone.delay, zone.gap, zone.conflict_begin, zone.margin]
        )
        formulas += [formula for item in self.sample for formula in item.set.values()]
        expressions = [
            *names.scene,
            *(number(formula, names.where) for formula in formulas if formula is not None),
        ]
        for item in requirements:
            expressions += item.expressions
        # a parameter is used by an expression, or by a definition that an expression needs
        needed = names.definitions.needed_by(*expressions)
        used = set().union(
            *(it.names for it in expressions), *(it.names for _, it in needed.entries)
        )
        for parameter in self.parameter:
            if parameter.name not in used and parameter.name not in CHANGES:
                raise InputError(
                    f"Parameter `{parameter.name}` of {names.where} must be used: nothing in the "
                    "scene depends on it."
                )

    def _exposure(
        self,
        parameters: tuple[Parameter, ...],
        names: Names,
        folder: Path,
        constraints: tuple[Constraint, ...],
    ) -> dict[str, Any]:
        """Keywords of the logical scenario: `exposure` and `exposure_about`; no keywords where all
        points count the same.
        """
        density = None if self.exposure is None else names.expression(self.exposure, "`exposure`")
        joint = None if self.joint is None else self.joint.read(parameters, names.where, folder)
        about = [
            f"{item.name} as {item.distribution}"
            for item in parameters
            if item.distribution is not None
        ]
        if joint is not None:
            # [met] has the number of events that were found; the file may hold fewer of them
            total = f" of {self.met.events} in [met]" if self.met else ""
            about.append(f"{joint}{total}")
        about += [] if density is None else [f"times `{density.text}`"]
        exposure = ExposureDensity(parameters, density, names.definitions, joint, constraints)
        return {"exposure": exposure, "exposure_about": ", ".join(about)} if about else {}
