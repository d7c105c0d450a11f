"""What may stand in a scenario file: its tables and keys, each with its unit, checked as they are read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, MinLen

from sumo_eval.scenario.road.lanes import CrossingTable, LaneTable
from sumo_eval.scenario.road.table import PieceTable
from sumo_eval.settings import About, Checked, Positive

Formula = str | float
"""In a file: a number, or an expression of the parameters and definitions."""


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
    """A road, written for the scenario, or found in a network of the user's."""

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
    on_map: Annotated[
        bool,
        About(
            "x, y and heading are on the map of a road that bends, from the line's beginning: it drives straight there"
        ),
    ] = False
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
    vehicle: Annotated[tuple[VehicleTable, ...], About("who is there then, besides the scenario's own")] = ()


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
