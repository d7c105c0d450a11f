"""A logical scenario as a TOML file: what may stand in it, and how it becomes a `LogicalScenario`.

Every number that may depend on the parameters is an expression (`sumo_eval.scenario.expression`). What is read is
plain data throughout: two readings of one file are equal, and both can be sent to another process.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, MinLen
from numpy.typing import ArrayLike
from pydantic import TypeAdapter, ValidationError

from sumo_eval.errors import InputError, check_name, did_you_mean, must_be, unknown
from sumo_eval.scenario import played
from sumo_eval.scenario.bodies import BODIES, VULNERABLE
from sumo_eval.scenario.concrete import (
    LEAST_CHANGE,
    RECORDED_EVERY,
    Actor,
    Brake,
    ConstantLateral,
    EgoBody,
    LaneChange,
    Model,
    Road,
    Start,
    Way,
)
from sumo_eval.scenario.distribution import Distribution
from sumo_eval.scenario.expression import Expression, checked_names, condition, number
from sumo_eval.scenario.joint import Joint, of_values, read_joint
from sumo_eval.scenario.logical import (
    Approach,
    Constraint,
    Counterpart,
    LogicalScenario,
    Met,
    NamedSample,
    Option,
    Parameter,
    Values,
    ZoneCoordinates,
    uniform_exposure,
)
from sumo_eval.scenario.reachable import never_begin
from sumo_eval.scenario.requirement import Requirements, requirement
from sumo_eval.scenario.road.lanes import CrossingTable, LaneTable, crossings_of, spans_of
from sumo_eval.scenario.road.opendrive import read_opendrive
from sumo_eval.scenario.road.table import PieceTable, bend_name, check_line, line_of
from sumo_eval.scenario.streams import Spread, drawn
from sumo_eval.scenario.sumo_network import read_road
from sumo_eval.scenario.trigger import Trigger, trigger
from sumo_eval.settings import About, Checked, Positive
from sumo_eval.settings.config import mistakes
from sumo_eval.settings.toml_file import read_toml
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
    """A road, written for the scenario, or a straight one found in a network of the user's."""

    name: Annotated[str | None, About("name of its files; default: from its measures")] = None
    lanes: Annotated[int, Ge(1), About("number of lanes")] = 2
    lane_width: Annotated[float, Positive, About("width of each lane", "m")] = 3.5
    length: Annotated[float, Positive, About("length of the road; the end of the case is in [end]", "m")] = 6000.0
    network: Annotated[str | None, About("a .net.xml instead, relative to this file")] = None
    edges: Annotated[tuple[str, ...], About("the edges of that network to drive along, in order")] = ()
    line: Annotated[
        tuple[PieceTable, ...],
        About("the right lane's centre line from x = 0 on, piece by piece; behind the last one it is straight"),
    ] = ()
    opendrive: Annotated[
        str | None,
        About("an .xodr instead, relative to this file: its line, its lanes and its length"),
    ] = None
    opendrive_road: Annotated[
        str | tuple[str, ...] | None,
        About("id of the road in that file, where it has several; or of those to drive along one behind the other"),
    ] = None
    lane: Annotated[tuple[LaneTable, ...], About("lanes that open, end, or are ramps; `lanes` counts them")] = ()
    crossing: Annotated[tuple[CrossingTable, ...], About("roads that cross this one")] = ()


@dataclass(frozen=True, slots=True)
class EgoTable(Checked):
    """The vehicle under test."""

    speed: Annotated[Formula, About("speed at the start", "m/s")]
    x: Annotated[Formula, About("centre along the road at the start", "m")] = 50.0
    y: Annotated[Formula, About("centre across the road, left of the right lane's centre line", "m")] = 0.0
    lateral_speed: Annotated[
        Formula, About("speed to the left with which it starts, below `speed`; it heads that way", "m/s")
    ] = 0.0
    length: Annotated[float | None, Positive, About("body; default: as in the vehicle settings", "m")] = None
    width: Annotated[float | None, Positive, About("body; default: as in the vehicle settings", "m")] = None
    goal_lane: Annotated[int | None, Ge(0), About("lane beside its first one that it has to change to; 0: right")] = (
        None
    )
    change_from: Annotated[
        float | None, Positive, About("with `goal_lane`: its centre's x from which on it may", "m")
    ] = None
    change_by: Annotated[
        float | None,
        Positive,
        About("by which it must; default: where its lane ends or the ramp of the other begins", "m"),
    ] = None
    recorded: Annotated[
        tuple[tuple[float, float], ...],
        About(
            "where somebody was who drove here in its place: its centre along and across the road, every 0.1 s from "
            "the start on; `departed` in a condition is the ego's distance from it",
            "m",
        ),
    ] = ()


@dataclass(frozen=True, slots=True)
class ManoeuvreTable(Checked):
    """What another vehicle does, from `begin` on."""

    do: Annotated[
        Literal[
            "keep_speed",
            "brake",
            "change_lane",
            "move_sideways",
            "accelerate",
            "speed_profile",
            "sinus",
            "path",
            "follow",
            "change_lane_cosine",
        ],
        About(
            "keep_speed; brake to a standstill; change_lane smoothly in `duration`; change_lane_cosine along half a "
            "cosine, OpenSCENARIO's sinusoidal; move_sideways at `speed`; "
            "accelerate to `speed`; speed_profile through `speeds` at `times` or `places`; sinus, a swing to both "
            "sides; path through `points` or `lanes` at `places`; follow, as a model of SUMO's that reacts, from the "
            "start on or, as the last of several, from `when` on"
        ),
    ]
    name: Annotated[str, About("name, for `ended(vehicle, name)` in a condition")] = ""
    begin: Annotated[Formula, About("when it begins; with `when`: how long after its condition holds", "s")] = 0.0
    when: Annotated[
        str | None, MinLen(1), About("it begins when this holds, e.g. `ttc(ego, child) < 2`; default: at `begin`")
    ] = None
    deceleration: Annotated[Formula | None, About("of `brake`; of `follow`: comfortable", "m/s2")] = None
    jerk: Annotated[
        Formula | None, About("of `brake`, `accelerate`: how fast it builds up; default: at once", "m/s3")
    ] = None
    duration: Annotated[Formula | None, About("of `change_lane`, `change_lane_cosine`", "s")] = None
    speed: Annotated[
        Formula | None,
        About("of `move_sideways`; `accelerate`: the one it leads to; `follow`: the one that it wants", "m/s"),
    ] = None
    acceleration: Annotated[
        Formula | None,
        About(
            "of `move_sideways`: how fast its speed builds up, default at once; of `accelerate`, either sign of the "
            "change; of `sinus`, the largest; of `follow`, the largest",
            "m/s2",
        ),
    ] = None
    offset: Annotated[Formula | None, About("of moves to a side: how far to the left, negative to the right", "m")] = (
        None
    )
    cycles: Annotated[float | None, Positive, About("of `sinus`: swings, each to one side and back")] = None
    times: Annotated[tuple[Formula, ...], About("of `speed_profile`: since its begin", "s")] = ()
    places: Annotated[tuple[Formula, ...], About("of `speed_profile`, `path`: of its centre along the road", "m")] = ()
    speeds: Annotated[tuple[Formula, ...], About("of `speed_profile`, at its times or places", "m/s")] = ()
    points: Annotated[
        tuple[tuple[Formula, Formula], ...],
        About("of `path`: along and across the road, straight from one to the next", "m"),
    ] = ()
    lanes: Annotated[
        tuple[int, ...],
        About("of `path`, instead of points: in the middle of which lane it is at its places; 0: right"),
    ] = ()
    model: Annotated[
        Literal["Krauss", "IDM", "EIDM"] | None, About("of `follow`: SUMO's car-following model, without noise")
    ] = None
    headway: Annotated[Formula | None, About("of `follow`: time headway that it keeps, default 1", "s")] = None
    min_gap: Annotated[Formula | None, About("of `follow`: gap to a standing vehicle, default 2.5", "m")] = None


@dataclass(frozen=True, slots=True)
class VehicleTable(Checked):
    """Another vehicle: keeps its speed, unless a manoeuvre says otherwise."""

    name: Annotated[str, MinLen(1), About("name")]
    speed: Annotated[Formula, About("speed at the start", "m/s")]
    gap: Annotated[Formula | None, About("from the ego's front bumper to its rear at the start", "m")] = None
    gap_behind: Annotated[
        Formula | None, About("instead of gap: from its front bumper to the ego's rear at the start", "m")
    ] = None
    x: Annotated[Formula | None, About("instead of gap: its centre along the road", "m")] = None
    y: Annotated[Formula, About("centre across the road, left of the right lane's centre line", "m")] = 0.0
    heading: Annotated[
        Formula | None, About("where it points and drives, to the left of the road; default 0", "deg")
    ] = None
    lateral_speed: Annotated[
        Formula | None, About("instead of heading: across the road at the start, to the left; `speed` is along", "m/s")
    ] = None
    body: Annotated[
        Literal["car", "van", "truck", "motorcycle", "bicycle", "pedestrian", "child"],
        About("what it is: its size, its class in SUMO, how it is drawn"),
    ] = "car"
    length: Annotated[float | None, Positive, About("body; default: as the body has it, 4.5 of a car", "m")] = None
    width: Annotated[float | None, Positive, About("body; default: as the body has it, 1.8 of a car", "m")] = None
    slides: Annotated[bool, About("keeps its heading while it moves across, instead of pointing where it goes")] = False
    manoeuvre: Annotated[tuple[ManoeuvreTable, ...], About("what it does")] = ()


@dataclass(frozen=True, slots=True)
class StreamTable(Checked):
    """Traffic of a given density: vehicles one behind the other in a lane, each driven by a model of SUMO's."""

    name: Annotated[str, MinLen(1), About("name; its vehicles are name_1, name_2, ... from the foremost back")]
    lane: Annotated[int, Ge(0), About("lane; 0 is the right-hand one")]
    begin: Annotated[Formula, About("its end at the back, ahead of the ego's centre; negative: behind", "m")]
    end: Annotated[Formula, About("its end at the front, ahead of the ego's centre", "m")]
    density: Annotated[Formula, About("vehicles on a kilometre of the lane", "1/km")]
    speed: Annotated[Formula, About("mean speed, which each keeps where nobody is in its way", "m/s")]
    speed_spread: Annotated[float, Ge(0.0), About("speeds differ by at most that, evenly", "m/s")] = 0.0
    spacing_spread: Annotated[float, Ge(0.0), About("distances differ by at most that share of their mean")] = 0.3
    seed: Annotated[int, Ge(0), About("what speeds and distances are drawn from")] = 0
    model: Annotated[Literal["Krauss", "IDM", "EIDM"], About("SUMO's car-following model, without noise")] = "IDM"
    headway: Annotated[Formula, About("time headway that each keeps", "s")] = 1.0
    min_gap: Annotated[Formula, About("gap to a standing vehicle", "m")] = 2.5
    acceleration: Annotated[Formula, About("largest acceleration", "m/s2")] = 2.6
    deceleration: Annotated[Formula, About("comfortable deceleration", "m/s2")] = 4.5
    body: Annotated[Literal["car", "van", "truck", "motorcycle"], About("what they are")] = "car"


@dataclass(frozen=True, slots=True)
class EndTable(Checked):
    """When a case is over, besides contact, standstill and leaving the road."""

    x: Annotated[float, Positive, About("the ego's centre reaches this place", "m")] = 600.0
    time: Annotated[float | None, Positive, About("simulated time; default: the simulation's own", "s")] = None
    standstill: Annotated[
        float | None,
        Positive,
        About("how long the ego must stand, for scenes in which it has to go on; default: the simulation's own", "s"),
    ] = None


@dataclass(frozen=True, slots=True)
class ZoneTable(Checked):
    """What the zones are computed from: the approach to one vehicle under ideal braking (Eqs. 1-6), or a margin."""

    obstacle: Annotated[str, About("the vehicle that is in the way")] = ""
    margin: Annotated[
        Formula | None,
        About("instead of all else here: what is left to spare of a limit that is known; hazardous from 0 down", "m"),
    ] = None
    delay: Annotated[Formula, About("before ideal braking begins", "s")] = 0.0
    gap: Annotated[Formula | None, About("bumper to bumper at the start; default: the obstacle's", "m")] = None
    conflict_begin: Annotated[Formula, About("before it the obstacle is not in the way", "s")] = 0.0
    passing_length: Annotated[
        float | None, Positive, About("an ego further ahead than that when the conflict begins has passed", "m")
    ] = None
    conflict: Annotated[
        bool,
        About("criticality by the time until both would touch on their ways, from all sides; default: along the road"),
    ] = False
    coordinates: Annotated[
        dict[str, Formula] | None,
        About("in words = expression: in which the criticality is smooth; default: the parameters"),
    ] = None


@dataclass(frozen=True, slots=True)
class SampleTable(Checked):
    """Points that somebody prescribes: rows, at each value of further parameters, with others worked out."""

    name: Annotated[str, MinLen(1), About("name, for `method` of an evaluation's sampling")]
    points: Annotated[tuple[tuple[float, ...], ...], About("the rows")]
    about: Annotated[str, About("what they are")] = ""
    columns: Annotated[
        tuple[str, ...], About("the parameters that a row holds; default: all that `each` and `set` do not, in order")
    ] = ()
    units: Annotated[dict[str, str], About("units of columns that are not the parameters': km/h instead of m/s")] = (
        field(default_factory=dict)
    )
    each: Annotated[dict[str, tuple[float, ...]], About("parameter = values: every row with each of them")] = field(
        default_factory=dict
    )
    set: Annotated[dict[str, Formula], About("parameter = expression of those that rows and `each` hold")] = field(
        default_factory=dict
    )


@dataclass(frozen=True, slots=True)
class GivenTable(Checked):
    """What else is different where an option is given."""

    suffix: Annotated[
        str | None,
        MinLen(1),
        About(
            "appended to the scenario's name after `_`, `{value}` in it is what is given; default: the option's name"
        ),
    ] = None
    about: Annotated[str | None, About("what happens then, instead of the scenario's own `about`")] = None
    road: Annotated[RoadTable | None, About("the road then, instead of the scenario's own")] = None


@dataclass(frozen=True, slots=True)
class OptionTable(Checked):
    """A number that whoever uses the scenario may give: `use = "cut_in?lateral_acceleration=1.5"`."""

    name: Annotated[str, MinLen(1), About("name, for expressions and in `use`")]
    unit: Annotated[str, MinLen(1), About("unit; `1` for a share")]
    about: Annotated[str, About("what it is")] = ""
    default: Annotated[float | None, About("its value where nobody gives one; default: infinite")] = None
    above: Annotated[float | None, About("what is given must be greater than that")] = None
    given: Annotated[GivenTable, About("what else is different where it is given")] = field(default_factory=GivenTable)


@dataclass(frozen=True, slots=True)
class JointTable(Checked):
    """How often points are met, by events that were met: keeps how parameters go together."""

    events: Annotated[str, MinLen(1), About("CSV with a row an event and a column a parameter, relative to this file")]
    kind: Annotated[
        Literal["kde", "copula"],
        About("kde: a Gaussian at each event; copula: each parameter by a KDE of its own, and their correlation"),
    ] = "kde"
    bandwidth: Annotated[float | None, Positive, About("kernel deviation over the data's; default: Scott's")] = None


@dataclass(frozen=True, slots=True)
class MetTable(Checked):
    """How often the scenario was met on the road, whatever its parameters were."""

    events: Annotated[int, Ge(0), About("how many times")]
    vehicle_km: Annotated[float, Positive, About("driven by all vehicles that might have met it", "km")]
    where: Annotated[str, About("on which roads, when")] = ""


@dataclass(frozen=True, slots=True)
class RecordedTable(Checked):
    """Which events of recordings are this scenario, met on the road."""

    event: Annotated[
        Literal["approach", "cut_out", "cut_in", "lead_braking"], About("kind of event, as `humans events` finds them")
    ]
    columns: Annotated[
        dict[str, str], About("parameter = column of the events; default: the column of the parameter's name")
    ] = field(default_factory=dict)
    tolerance: Annotated[
        dict[str, float], About("how far a parameter may be from the event's; default: a tenth of its range")
    ] = field(default_factory=dict)
    start: Annotated[str, About("column with the time that is the scenario's t = 0; default by event")] = ""
    only: Annotated[dict[str, str], About("column = value that an event must have")] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RequireTable(Checked):
    """What must hold in every drive; cases that miss it are counted beside the scores."""

    check: Annotated[
        str,
        About(
            "a condition on the whole drive: min, max, at_end of time, x, offset, speed, acceleration, jerk, "
            "lateral_speed, gap, thw, ttc, and x, y, speed, lateral_speed of another vehicle, as `x(lead)`; collided, "
            "reached_end; e.g. `min(gap) > 2 and collided == 0`"
        ),
    ]
    name: Annotated[str, About("name in tables; default: the check itself")] = ""
    about: Annotated[str, About("the same in words")] = ""


@dataclass(frozen=True, slots=True)
class ScenarioFile(Checked):
    """A logical scenario file."""

    name: Annotated[str, MinLen(1), About("name of the scenario")]
    parameter: Annotated[tuple[ParameterTable, ...], About("the axes of the space")]
    ego: Annotated[EgoTable, About("the vehicle under test")]
    zone: Annotated[
        ZoneTable | Literal["none"],
        About("zone rule; `none`: no zone can be defined, everything is safe, C and A are by outcome"),
    ]
    vehicle: Annotated[tuple[VehicleTable, ...], About("the others")] = ()
    stream: Annotated[tuple[StreamTable, ...], About("traffic of a given density")] = ()
    about: Annotated[str, About("what happens, in one sentence")] = ""
    source: Annotated[str, About("where it comes from")] = "a scenario file"
    define: Annotated[dict[str, Formula], About("names for expressions, each may use those above it")] = field(
        default_factory=dict
    )
    option: Annotated[tuple[OptionTable, ...], About("numbers that whoever uses the scenario may give")] = ()
    constraint: Annotated[tuple[ConstraintTable, ...], About("which points of the box exist")] = ()
    exposure: Annotated[str | None, About("density, an expression; multiplies the parameters' distributions")] = None
    joint: Annotated[JointTable | None, About("density by events, instead of the parameters' distributions")] = None
    met: Annotated[MetTable | None, About("how often it was met on the road")] = None
    recorded: Annotated[RecordedTable | None, About("the events of recordings that are this scenario")] = None
    road: Annotated[RoadTable, About("the road")] = field(default_factory=RoadTable)
    end: Annotated[EndTable, About("when a case is over")] = field(default_factory=EndTable)
    sample: Annotated[tuple[SampleTable, ...], About("prescribed points")] = ()
    default_sample: Annotated[str, About("grid, or the name of a sample")] = "grid"
    people: Annotated[
        Literal["drivers", "none"],
        About("none: no synthetic driver knows this scene, so without recorded ones there is no D and no H"),
    ] = "drivers"
    require: Annotated[tuple[RequireTable, ...], About("what must hold in every drive")] = ()


_ADAPTER = TypeAdapter(ScenarioFile)


# --- reading ----------------------------------------------------------------------------------------------------------


def read_scenario(path: Path, given: Mapping[str, str] | None = None) -> LogicalScenario:
    """The logical scenario in a TOML file. given: options by name, as written.

    Raises InputError naming what is wrong.
    """
    return scenario_from(read_toml(path, "scenario file"), f"scenario file {path}", path.parent, given)


def scenario_from(
    content: Mapping[str, Any], where: str, folder: Path, given: Mapping[str, str] | None = None
) -> LogicalScenario:
    """The logical scenario in a plain mapping. `where` names it in errors; `folder`: where its paths start.

    given: as in `read_scenario`.
    """
    try:
        table = _ADAPTER.validate_json(json.dumps(content, default=str), strict=True)
    except ValidationError as error:
        raise InputError(mistakes(error, where, ScenarioFile)) from None
    table, options = _with_options(table, given or {})
    return _Builder(table, options, where, folder).scenario()


def _with_options(table: ScenarioFile, given: Mapping[str, str]) -> tuple[ScenarioFile, dict[str, float]]:
    """The file as it is with the options that are given, and the value of every option by name."""
    owner = f"scenario `{table.name}`"
    values = {item.name: math.inf if item.default is None else item.default for item in table.option}
    for key in given:
        if key not in values:
            raise unknown(f"option of {owner}", key, values)
    for item in table.option:
        if item.name not in given:
            continue
        wanted = "finite" if item.above is None else f"finite and above {item.above:g} {item.unit}"
        try:
            value = float(given[item.name])
        except ValueError:
            raise must_be(f"`{item.name}`", owner, f"a number of {item.unit}", given[item.name]) from None
        if not (math.isfinite(value) and (item.above is None or value > item.above)):
            raise must_be(f"`{item.name}`", owner, wanted, value)
        values[item.name] = value
        then = item.given
        table = replace(
            table,
            name=f"{table.name}_{item.name if then.suffix is None else then.suffix.replace('{value}', _worded(value))}",
            about=table.about if then.about is None else then.about,
            road=table.road if then.road is None else then.road,
        )
    return table, values


def _worded(value: float) -> str:
    """A number as a part of a name."""
    return f"{value:g}".replace("-", "minus_").replace(".", "_").replace("+", "")


def check_file(path: Path, given: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Read a scenario file, place vehicles at every point of its own sample, and say in sentences what it holds.

    given: options by name, as written. Raises InputError with what is wrong, at the first point where something is.
    """
    from sumo_eval.scenario.sampling.samples import sample

    logical = read_scenario(Path(path), given)
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
        limit = math.inf if logical.time_limit is None else logical.time_limit
        for actor, index in never_begin(concrete, limit):
            name = actor.acts[index].name or f"number {index + 1}"
            raise InputError(
                f"The condition of manoeuvre {name} of vehicle `{actor.name}` of scenario `{logical.name}` at "
                f"{concrete.label} can never hold, whoever drives: the manoeuvre would never begin."
            )
    if logical.approach is not None:
        logical.approach(logical.columns(points))
    if logical.margin is not None:
        logical.margin(logical.columns(points))


_BESIDE = 300.0  # m beside the road at which somebody may still be who comes from there, or stands there


def _reach(actor: Actor, furthest: float) -> float:
    """How far beside the lanes a vehicle may be, m: not at all where SUMO drives it, or its script knows time alone."""
    return furthest if actor.body in VULNERABLE or (actor.lively and not actor.follows_at_once) else 0.0


def _check_place(logical: LogicalScenario, ego: Start, actors: Sequence[Actor], label: str) -> None:
    road, owner = logical.road, f"scenario `{logical.name}` at {label}"
    end = road.length + road.run_out
    ego_body = logical.ego_body or EgoBody(4.5, 1.8)
    bodies = [("ego", ego, 0.0, 0.0), *((item.name, item.start, item.length, item.heading) for item in actors)]
    furthest = max([_BESIDE, *(crossing.reach for crossing in road.crossings)])
    beside = [0.0, *(_reach(item, furthest) for item in actors)]
    for (name, start, length, _), reach in zip(bodies, beside, strict=True):
        if not (length / 2 <= start.x <= end - length / 2):
            raise must_be(f"Vehicle `{name}`", owner, "on the road", start.x)
        if not road.right_edge_at(start.x) - reach <= start.y <= road.left_edge_at(start.x) + reach:
            raise must_be(f"Vehicle `{name}`", owner, "on a lane", start.y)
    for item in actors:
        reach = _reach(item, furthest)
        for act in item.acts:
            for x, y in act.table if act.kind == played.PATH else ():
                if not (0.0 <= x <= end and road.right_edge - reach <= y <= road.left_edge + reach):
                    raise must_be(f"The path of vehicle `{item.name}`", owner, "on the map", f"({x:g}, {y:g}) m")
    if not any(item.lively for item in actors):
        return
    boxes = [("ego", *_box(ego, 0.0, ego_body.length, ego_body.width))]
    boxes += [(item.name, *_box(item.start, item.heading, item.length, item.width)) for item in actors]
    for (one, x, y, long, wide), (two, x2, y2, long2, wide2) in itertools.combinations(boxes, 2):
        if abs(x - x2) < long + long2 and abs(y - y2) < wide + wide2:
            raise must_be(f"Vehicle `{two}`", owner, f"clear of `{one}` at the start", f"x = {x2:g} m beside {x:g} m")


def _box(start: Start, heading: float, length: float, width: float) -> tuple[float, float, float, float]:
    """Centre and half extents along and across the road."""
    c, s = abs(math.cos(heading)), abs(math.sin(heading))
    return start.x, start.y, 0.5 * (length * c + width * s), 0.5 * (length * s + width * c)


# --- building ---------------------------------------------------------------------------------------------------------


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

    @property
    def lively(self) -> bool:
        """Whether what it does is no function of time alone."""
        return self.heading is not None or any(move.lively for move in self.moves)


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
        if item.lively:
            return _played(item, start, heading, known, self.recorded)
        moves: list[LaneChange | ConstantLateral] = []
        brake = None
        for move in item.moves:
            numbers = {key: quantity.at(known) for key, quantity in move.numbers}
            if move.do == "brake":
                brake = Brake(**numbers)
            elif move.do in ("change_lane", "change_lane_cosine"):
                cosine = move.do == "change_lane_cosine"
                moves.append(LaneChange(numbers["begin"], numbers["duration"], numbers["offset"], cosine))
            elif move.do == "move_sideways":
                moves.append(ConstantLateral(**numbers))
        return Actor(item.name, start, tuple(moves), item.length, item.width, brake, item.slides, item.body)


def _model_numbers(numbers: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """A model's parameters by SUMO's name, of those that a file gives."""
    names = {"headway": "tau", "min_gap": "minGap", "acceleration": "accel", "deceleration": "decel"}
    return tuple((names[key], numbers[key]) for key in names if key in numbers)


def _played(
    item: Vehicle,
    start: Start,
    heading: float,
    known: Mapping[str, float],
    recorded: tuple[tuple[float, float], ...],
) -> Actor:
    """A vehicle whose moves depend on what happens, at a point. recorded: places of the recorded ego."""
    acts: list[played.Act] = [] if item.moves else [played.Act(played.KEEP)]
    model = None
    for move in item.moves:
        numbers = {key: quantity.at(known) for key, quantity in move.numbers}
        if move.do == "follow":
            model = Model(move.model, numbers.get("speed", start.speed), _model_numbers(numbers))
            if move.when is not None:
                program = move.when.at(known)
                acts.append(
                    played.Act(played.FOLLOW, numbers["begin"], RECORDED_EVERY, table=recorded, program=program)
                )
            continue
        act = _act(move.do, numbers, by_place=move.by_place)
        table = tuple((one.at(known), two.at(known)) for one, two in move.table)
        if move.do == "speed_profile" and any(b[0] <= a[0] for a, b in itertools.pairwise(((0.0, 0.0), *table))):
            raise must_be(f"The {'places' if move.by_place else 'times'}", f"`speed_profile` of vehicle `{item.name}`",
                          "above 0 and ascending", [knot[0] for knot in table])  # fmt: skip
        program = () if move.when is None else move.when.at(known)
        acts.append(act._replace(table=table, program=program, name=move.name))
    return Actor(
        item.name, start, (), item.length, item.width, None, item.slides, item.body, heading, tuple(acts), model
    )


def _act(do: str, numbers: Mapping[str, float], *, by_place: bool) -> played.Act:
    begin = numbers["begin"]
    if do == "brake":
        brake = Brake(begin, numbers["deceleration"], numbers.get("jerk", math.inf))
        return played.Act(played.SPEED, begin, 0.0, 0.0, 0.0, brake.deceleration, brake.jerk)
    if do == "accelerate":
        jerk = numbers.get("jerk", math.inf)
        return played.Act(played.SPEED, begin, 0.0, numbers["speed"], 0.0, numbers["acceleration"], jerk)
    if do in ("change_lane", "change_lane_cosine"):
        kind = played.SMOOTH if do == "change_lane" else played.COSINE
        return played.Act(kind, begin, numbers["duration"], 0.0, numbers["offset"])
    if do == "move_sideways":
        move = ConstantLateral(begin, numbers["speed"], numbers["offset"], numbers.get("acceleration", math.inf))
        return played.Act(played.CONSTANT, begin, move.duration, move.speed, move.offset, move.acceleration)
    if do == "sinus":
        offset, strongest = numbers["offset"], numbers["acceleration"]
        duration = numbers["cycles"] * 2.0 * math.pi / math.sqrt(2.0 * strongest / abs(offset)) if offset else 0.0
        return played.Act(played.SINUS, begin, duration, 0.0, offset, strongest)
    if do == "speed_profile":
        return played.Act(played.BY_PLACE if by_place else played.BY_TIME, begin)
    return played.Act(played.PATH if do == "path" else played.KEEP, begin)


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

_KMH = 1.0 / 3.6  # m/s
_CONVERSIONS = {"m/s": {"km/h": _KMH}, "m": {"km": 1000.0}, "1": {"%": 0.01}}
"""Other units of a sample's columns: by how much their numbers are multiplied to be in the parameter's unit."""


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
        options = [option.name for option in table.option]
        for name in options:
            if not name.isidentifier():
                raise must_be("The name", f"an option of {self.where}", "letters, digits and underscores", name)
        names = [*(item.name for item in parameters), *options]
        self.known = _distinct(names, "parameter and option", self.where)
        entries = []
        for name, formula in table.define.items():
            if name in self.known:
                raise InputError(f"`{name}` in [define] of {self.where} must differ from parameters and options.")
            entries.append((name, self._number(formula, f"[define] {name}")))
            self.known.append(name)
        definitions = Definitions(tuple(entries), tuple(self.options.items()))
        self.numbers_of = {item.name: number_of for number_of, item in enumerate(table.vehicle)}
        self.moves_of = {
            item.name: {move.name: index for index, move in enumerate(item.manoeuvre) if move.name}
            for item in table.vehicle
        }
        vehicles = tuple(self._vehicle(item) for item in table.vehicle)
        streams = tuple(self._stream(item) for item in table.stream)
        if not vehicles and not streams:
            raise InputError(f"{self.where} must have at least one [[vehicle]] or [[stream]].")
        _distinct(["ego", *(item.name for item in vehicles)], "vehicle", self.where)
        for item in vehicles:
            check_name("`name`", f"a vehicle of {self.where}", item.name)
        constraints = tuple(self._constraint(item, definitions) for item in table.constraint)
        density = None if table.exposure is None else self._number(table.exposure, "`exposure`")
        spread = [item for item in parameters if item.distribution is not None]
        joint = self._joint(parameters)
        told = bool(spread) or density is not None or joint is not None
        body = self._body()
        road = self._road()
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
        if road.crossings and road.bent:
            raise InputError(f"The road of {self.where} must be straight where it has a [[road.crossing]].")
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
            requirements=requirements,
        )

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
        return checked_names(number(formula, f"{what} of {self.where}"), self.known, f"{what} of {self.where}")

    def _quantity(self, formula: Formula, what: str, at_least: float = -math.inf) -> Quantity:
        return Quantity(what, self.owner, self._number(formula, what), at_least)

    def _constraint(self, item: ConstraintTable, definitions: Definitions) -> Constraint:
        expression = checked_names(condition(item.require, self.where), self.known, self.where)
        holds = Condition(expression, definitions.needed_by(expression))
        return Constraint(item.about or f"one where {item.require}", holds)

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
        if road.bent:
            raise InputError(f"The road of {self.where} must be straight where the ego has a `goal_lane`.")
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
            return read_road(self.folder / road.network, road.edges, end.x)
        if road.edges:
            raise InputError(f"`road.edges` of {self.where} name edges of a `network`, and there is none.")
        if end.x > road.length:
            raise must_be("`end.x`", self.where, f"at most the road's length {road.length:g}", end.x)
        line = line_of(road.line, self.options, road.lanes, road.lane_width, road.length, self.where)
        name = road.name or f"road_{road.lanes}x{road.lane_width:g}m_{end.x:g}m_of_{road.length:g}m"
        name += bend_name(line, named=road.name is not None)
        spans = spans_of(road.lane, road.lanes, road.length, self.where)
        crossings = crossings_of(road.crossing, road.length, self.where)
        if road.name is None and (spans or crossings):
            name += f"_{hashlib.sha256(repr((spans, crossings)).encode()).hexdigest()[:6]}"
        return Road(
            name, end.x, road.lanes, road.lane_width, road.length - end.x, line=line, spans=spans, crossings=crossings
        )

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
        if item.lane >= self.table.road.lanes and self.table.road.network is None:
            raise must_be("`lane`", f"{what} of {self.where}", f"below {self.table.road.lanes}", item.lane)
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
        road = self.table.road
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
        factors = {own: 1.0, **_CONVERSIONS.get(own, {})}
        unit = item.units.get(name, own)
        if unit not in factors:
            raise unknown(f"unit of column `{name}` of sample `{item.name}` of {self.where}:", unit, factors)
        return factors[unit]


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
