"""Vehicles of a scenario file: their tables `[ego]`, `[[vehicle]]` and `[[vehicle.manoeuvre]]`,
these tables read and checked, and the vehicles at a point of the space.

Three forms follow one another: a table as in the file (`VehicleTable`), with its formulas read
(`Vehicle`), and at a point (`concrete.Actor`); likewise `ManoeuvreTable`, `Move`, `played.Act`.
The names of keys are a public format.

Users: `scenario/file_tables.py`, `scenario/resolved.py`, `scenario/zone_table.py`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, replace
from functools import partial
from math import atan2, degrees, isfinite, isinf, pi, radians, sqrt
from typing import Annotated, Any, Literal

from annotated_types import Ge, MinLen, MultipleOf

from sumo_eval.errors import InputError, check_vehicle_name, did_you_mean, must_be
from sumo_eval.frozen import frozen, required
from sumo_eval.scenario import played
from sumo_eval.scenario.bodies import BODIES
from sumo_eval.scenario.concrete import (
    LEAST_CHANGE,
    RECORDED_EVERY,
    Actor,
    EgoBody,
    Numbers,
    Road,
    Start,
    Way,
    brake_to_stop,
    constant_lateral,
    keeps_on,
    lane_at,
    lane_change,
)
from sumo_eval.scenario.expression import Definitions
from sumo_eval.scenario.first_places import STANDARD_EGO
from sumo_eval.scenario.formulas import (
    ABOVE_0,
    NOT_BELOW_0,
    NOT_NAN,
    Formula,
    LimitedFormula,
    LimitedFormulas,
    Limits,
    Names,
    PositiveFormulaOrNone,
)
from sumo_eval.scenario.played import Act, Pairs, Program
from sumo_eval.scenario.road.reference_line import frame_places
from sumo_eval.scenario.streams import FollowModel, StreamTable, sumo_model
from sumo_eval.scenario.trigger import Step, trigger
from sumo_eval.settings.checked import Checked, FilledText, PositiveOrNone, optional, setting
from sumo_eval.text import capitalised

_MANOEUVRES: dict[str, tuple[tuple[str, ...], tuple[str, ...], Callable[..., Act]]] = {
    "keep_speed": ((), (), partial(Act, played.KEEP)),
    "brake": (("deceleration",), ("jerk",), brake_to_stop),
    "change_lane": (("duration", "offset"), (), lane_change),
    "move_sideways": (("speed", "offset"), ("acceleration",), constant_lateral),
    "accelerate": (("speed", "acceleration"), ("jerk",), partial(Act, played.SPEED)),
    "speed_profile": (("speeds",), ("times", "places"), partial(Act, played.BY_TIME)),
    "sinus": (("offset", "acceleration"), ("cycles",), partial(Act, played.SINUS)),
    "path": ((), ("points", "lanes", "places"), partial(Act, played.PATH)),
    "follow": (
        ("model",),
        ("speed", "acceleration", "deceleration", "headway", "min_gap"),
        Act,  # not called: `Vehicle.actor` makes its act
    ),
    "change_lane_cosine": (("duration", "offset"), (), partial(lane_change, cosine=True)),
}
"""By `do`: keys that a manoeuvre must have, keys that it may have, and the function that makes its
act of its numbers. Any manoeuvre may also have `name`, `begin` and `when`.
"""
_ENDLESS = Limits(above=0.0, endless=True)
# rad: largest heading at which a vehicle may have speeds at `places`, which are along the road
_AHEAD = 0.1


@frozen
class EgoTable(Checked):
    """The vehicle under test."""

    speed: Annotated[Formula, NOT_BELOW_0] = required("speed at the start", "m/s")
    x: Formula = setting(50.0, "centre along the road at the start", "m")
    y: Formula = setting(
        0.0, "its centre's distance to the left of the right lane's centre line", "m"
    )
    lateral_speed: Formula = setting(
        0.0, "speed to the left at the start, below `speed`; it heads where it moves", "m/s"
    )
    length: PositiveOrNone = optional("body; default: as in the vehicle settings", "m")
    width: PositiveOrNone = optional("body; default: as in the vehicle settings", "m")
    goal_lane: Annotated[int | None, Ge(0)] = optional(
        "number of the neighbouring lane that it must change to; 0: right"
    )
    change_from: PositiveOrNone = optional(
        "with `goal_lane`: x of its centre where it may begin", "m"
    )
    change_by: PositiveOrNone = optional(
        "x of its centre by which it must have changed; default: where its lane or the other "
        "one ends, or where the other becomes an exit ramp",
        "m",
    )
    recorded: Pairs = setting(
        (),
        "positions of a recorded ego: its centre along and across the road, every 0.1 s from "
        "the start; `departed` in a condition is the ego's distance from it",
        "m",
    )

    def check(self, where: str, road: Road) -> None:
        """Refuse combinations of keys that do not fit together or the road.

        where: how errors call the file.
        """
        owner = f"[ego] of {where}"
        if len(self.recorded) == 1:
            raise must_be("`recorded`", owner, "two places or more", 1)
        if (self.length is None) != (self.width is None):
            raise InputError(f"{owner} must have both length and width, or neither.")
        if self.goal_lane is None:
            if self.change_from is not None or self.change_by is not None:
                raise InputError(f"{owner} must have a `goal_lane`, or no place to change lanes.")
            return
        if self.goal_lane >= road.lanes:
            raise must_be("`goal_lane`", owner, f"below {road.lanes}", self.goal_lane)
        if self.change_from is None:
            raise InputError(f"{owner} has a `goal_lane`, so it must have a `change_from`.")

    @property
    def body(self) -> EgoBody | None:
        """The ego's body; None: the file has none."""
        return (
            None if self.length is None or self.width is None else EgoBody(self.length, self.width)
        )

    def start(self, numbers: Mapping[str, Any], road: Road, owner: str) -> Start:
        """Start of the ego at a point.

        numbers: values of the table's formulas there, by key.
        owner: how errors call the scenario.
        """
        ego = Start(**numbers, recorded=self.recorded)
        if ego.lateral_speed and not abs(ego.lateral_speed) < ego.speed:
            raise must_be(
                "`lateral_speed`",
                owner,
                f"below the ego's speed {ego.speed:g} m/s",
                ego.lateral_speed,
            )
        if self.goal_lane is None or self.change_from is None:  # after `check` both are, or neither
            return ego
        return replace(ego, way=self._way(self.goal_lane, self.change_from, ego.y, road, owner))

    def _way(self, goal: int, begin: float, y: float, road: Road, owner: str) -> Way:
        """The lane change, from x = `begin` m on, of an ego that starts at y.

        Raises InputError for an impossible one.
        """
        lane = lane_at(road, y)  # in which the ego starts
        if abs(lane - goal) != 1:
            raise must_be(
                "`goal_lane`", owner, f"a lane beside lane {lane}, in which the ego starts", goal
            )
        own, other = road.span(lane), road.span(goal)
        by = self.change_by
        if by is None:
            by = min(own.end, other.parted_from, other.end)
        if isinf(by):
            raise InputError(
                f"The ego of {owner} must have a `change_by`: neither its lane nor the other one "
                "ends."
            )
        # from x = `first` to `last` both lanes are there, side by side: before `parted_until` and
        # after `parted_from` a lane is a ramp behind a solid line
        first = max(own.parted_until, other.parted_until, own.begin, other.begin, 0.0)
        last = min(own.end, other.end, own.parted_from, other.parted_from, road.length)
        if not first <= begin <= by - LEAST_CHANGE or by > last:
            within = (
                f"within {first:g}..{last:g} m and {LEAST_CHANGE:g} m apart, where both lanes are"
            )
            raise must_be("`change_from` and `change_by`", owner, within, f"{begin:g} and {by:g} m")
        return Way(road.lane_width * (goal - lane), begin, by, ends=isfinite(own.end))


@frozen
class ManoeuvreTable(Checked):
    """Manoeuvre of an actor, from `begin` on."""

    do: Literal[tuple(_MANOEUVRES)] = required(  # type: ignore[valid-type]
        "keep_speed; brake to a standstill; change_lane smoothly in `duration`; "
        "change_lane_cosine along half a cosine, OpenSCENARIO's sinusoidal; move_sideways at "
        "`speed`; accelerate to `speed`; speed_profile through `speeds` at `times` or "
        "`places`; sinus, a swing to one side and back, the next to the other side; path "
        "through `points`, or through `lanes` at `places`; follow by a model of SUMO that "
        "reacts, from the start on or, as the last manoeuvre, from `when` on"
    )
    name: str = setting("", "name, for `ended(vehicle, name)` in a condition")
    begin: Annotated[Formula, NOT_BELOW_0] = setting(
        0.0, "when it begins; with `when`: how long after its condition holds", "s"
    )
    when: Annotated[str | None, MinLen(1)] = optional(
        "it begins when this holds, e.g. `ttc(ego, child) < 2`; default: at `begin`"
    )
    deceleration: PositiveFormulaOrNone = optional("of `brake`; of `follow`: comfortable", "m/s2")
    jerk: Annotated[Formula | None, _ENDLESS] = optional(
        "of `brake`, `accelerate`: how fast it builds up; default: at once", "m/s3"
    )
    duration: PositiveFormulaOrNone = optional("of `change_lane`, `change_lane_cosine`", "s")
    speed: Annotated[Formula | None, NOT_BELOW_0] = optional(
        "of `move_sideways`: across; of `accelerate`: at its end; of `follow`: desired", "m/s"
    )
    acceleration: PositiveFormulaOrNone = optional(
        "of `move_sideways`: how fast its speed builds up, default at once; of `accelerate`: "
        "how fast its speed rises or falls; of `sinus`, `follow`: the largest",
        "m/s2",
    )
    offset: Formula | None = optional(
        "of moves to a side: how far to the left, negative to the right", "m"
    )
    cycles: Annotated[PositiveOrNone, MultipleOf(1.0)] = optional(
        "of `sinus`: swings, each to one side and back"
    )
    times: tuple[Formula, ...] = setting((), "of `speed_profile`: since its start", "s")
    places: tuple[Formula, ...] = setting(
        (), "of `speed_profile`, `path`: of its centre along the road", "m"
    )
    speeds: tuple[Formula, ...] = setting((), "of `speed_profile`, at its times or places", "m/s")
    points: tuple[tuple[Formula, Formula], ...] = setting(
        (), "of `path`: along and across the road, straight from one to the next", "m"
    )
    lanes: tuple[int, ...] = setting(
        (), "of `path`, instead of points: lane in whose middle it is at each place; 0: right"
    )
    model: FollowModel | None = optional("of `follow`: SUMO's car-following model, without noise")
    headway: PositiveFormulaOrNone = optional(
        "of `follow`: time headway that it keeps, default 1", "s"
    )
    min_gap: PositiveFormulaOrNone = optional(
        "of `follow`: gap to a standing vehicle, default 2.5", "m"
    )

    @property
    def lively(self) -> bool:
        """Whether it makes its vehicle `Actor.lively`: it waits for a condition, or its motion has
        no closed form.
        """
        closed_form = ("keep_speed", "brake", "change_lane", "change_lane_cosine", "move_sideways")
        return self.when is not None or self.do not in closed_form

    def read(self, vehicle: str, names: Names, road: Road) -> Move:
        """Check this table and read its formulas and its condition.

        vehicle: name of its vehicle, for messages.
        """
        what = f"`{self.do}` of {vehicle}"
        owner = f"{what} in {names.where}"
        self._check_keys(owner)
        # limits of formulas where they are not those of the key's annotation
        limits = {
            "follow": {"speed": ABOVE_0},
            # inf may be given, as `constant_lateral`'s default is; it refuses 0 and less itself
            "move_sideways": {"acceleration": NOT_NAN},
        }.get(self.do, {})
        numbers = names.quantities(self, what, **limits)
        when = []
        if self.when is not None:
            # only a `follow` may use `departed`, the ego's distance from the recorded ego
            may_use_departed = names.has_recorded_ego and self.do == "follow"
            when = trigger(self.when, owner, names, may_use_departed=may_use_departed)
        return Move(self, numbers, tuple(self._pairs(what, owner, names, road)), tuple(when))

    def _check_keys(self, owner: str) -> None:
        """Refuse missing keys, and keys that `do` does not have."""
        needed, optional_keys, _ = _MANOEUVRES[self.do]
        allowed = (*needed, *optional_keys)
        for item in fields(self)[4:]:  # after `do`, `name`, `begin`, `when`, which all may have
            key = item.name
            absent = getattr(self, key) in (None, ())
            if absent and key in needed:
                raise InputError(f"{owner} must have `{key}`.")
            if not absent and key not in allowed:
                raise InputError(f"{owner} has no `{key}`.{did_you_mean(key, allowed)}")
        if self.do == "follow" and self.when is None and self.begin != 0.0:
            raise InputError(
                f"{owner} has no `begin` without a `when`: a vehicle follows from the start."
            )

    def _pairs(
        self, what: str, owner: str, names: Names, road: Road
    ) -> Iterator[tuple[LimitedFormula, LimitedFormula]]:
        """The knots of a profile (time or place, speed), or the points of a path (x, y); nothing of
        any other manoeuvre.

        what, owner: names of the manoeuvre, in its scenario and in its file, for messages.
        """
        if self.do == "speed_profile":
            knots = self.places or self.times
            if bool(self.places) == bool(self.times) or len(knots) != len(self.speeds):
                raise InputError(
                    f"{owner} must have as many `times`, or else `places`, as `speeds`, got "
                    f"{len(self.times)} and {len(self.places)} for {len(self.speeds)}."
                )
            for at, speed in zip(knots, self.speeds, strict=True):
                yield (names.quantity(at, f"times or places of {what}"),
                       names.quantity(speed, f"speeds of {what}", NOT_BELOW_0))  # fmt: skip
        elif self.do == "path":
            if bool(self.points) == bool(self.lanes) or len(self.lanes) != len(self.places):
                raise InputError(
                    f"{owner} must have either `points`, or as many `lanes` as `places`."
                )
            for lane in self.lanes:
                if not 0 <= lane < road.lanes:
                    raise must_be("Each of `lanes`", owner, f"within 0..{road.lanes - 1}", lane)
            middles = (road.lane_width * lane for lane in self.lanes)
            for x, y in self.points or zip(self.places, middles, strict=True):
                yield names.quantity(x, f"points of {what}"), names.quantity(y, f"points of {what}")


@frozen
class Move:
    """A manoeuvre as read from its table.

    numbers: its formulas by key.
    pairs: as from `ManoeuvreTable._pairs`.
    when: steps of its condition; empty: it begins at a time.
    """

    table: ManoeuvreTable
    numbers: LimitedFormulas
    pairs: tuple[tuple[LimitedFormula, LimitedFormula], ...]
    when: tuple[Step, ...]

    def act(self, values: Numbers, vehicle: str) -> Act:
        """Its act at a point; not for a `follow`, whose act `Vehicle.actor` makes.

        values: of parameters and definitions there, by name.
        vehicle: name of its vehicle, for messages.
        """
        table = self.table
        pairs = tuple((one.at(values), two.at(values)) for one, two in self.pairs)
        _, _, make_act = _MANOEUVRES[table.do]
        act = make_act(**self.numbers.at(values))
        if table.do == "sinus" and act.offset:
            phase = 2.0 * pi * (table.cycles or 1.0)  # w t at the end of the last swing, rad
            # A swing by A (1 - cos wt) / 2 has the largest acceleration A w^2 / 2, the one that the
            # table gives. So w is sqrt(2 acceleration / A), and the duration phase / w.
            act = act._replace(duration=phase / sqrt(2.0 * act.acceleration / abs(act.offset)))
        if table.do == "speed_profile":
            knots = [knot for knot, _ in pairs]
            what = "The places" if table.places else "The times"
            if not all(a < b for a, b in itertools.pairwise([0.0, *knots])):
                owner = f"`speed_profile` of vehicle `{vehicle}`"
                raise must_be(what, owner, "above 0 and ascending", knots)
            if table.places:
                act = act._replace(kind=played.BY_PLACE)
        return act._replace(table=pairs, program=self.program(values), name=table.name)

    def program(self, values: Numbers) -> Program:
        """Its condition with these values of parameters and definitions, as in `Act.program`."""
        return tuple(
            (op, one, two, 0.0 if value is None else float(value.at(values)))
            for op, one, two, value in self.when
        )


@frozen
class VehicleTable(Checked):
    """An actor: keeps its speed until one of its manoeuvres begins."""

    name: FilledText = required("name")
    speed: Annotated[Formula, NOT_BELOW_0] = required("speed at the start", "m/s")
    gap: Formula | None = optional("from the ego's front bumper to its rear at the start", "m")
    gap_behind: Formula | None = optional(
        "instead of gap: from its front bumper to the ego's rear at the start", "m"
    )
    x: Formula | None = optional("instead of gap: its centre along the road", "m")
    y: Formula = setting(
        0.0, "its centre's distance to the left of the right lane's centre line", "m"
    )
    heading: Formula | None = optional(
        "direction in which it points and drives, left of the road's; default 0", "deg"
    )
    lateral_speed: Formula | None = optional(
        "instead of heading: across the road at the start, to the left; `speed` is along",
        "m/s",
    )
    body: Literal[tuple(BODIES)] = setting(  # type: ignore[valid-type]
        "car", "kind of road user: its size, its class in SUMO, its shape"
    )
    length: PositiveOrNone = optional("body; default: as the body has it, 4.5 of a car", "m")
    width: PositiveOrNone = optional("body; default: as the body has it, 1.8 of a car", "m")
    slides: bool = setting(
        False, "keeps its heading while it moves across, instead of pointing where it goes"
    )
    on_map: bool = setting(
        False,
        "x, y and heading are on the map of a curved road, from the line's beginning: it "
        "drives straight there",
    )
    manoeuvre: tuple[ManoeuvreTable, ...] = setting((), "its manoeuvres")

    @property
    def lively(self) -> bool:
        """Whether its actors are `Actor.lively`."""
        turned = self.heading is not None or self.lateral_speed is not None
        brakes = any(it.do == "brake" for it in self.manoeuvre)
        # a `keep_speed` counts where a condition can name it in `ended`, or where it ends a braking
        keeps = any(it.do == "keep_speed" and (it.name or brakes) for it in self.manoeuvre)
        return turned or self.on_map or keeps or any(it.lively for it in self.manoeuvre)

    @property
    def scripted(self) -> list[ManoeuvreTable]:
        """Its manoeuvres that become acts: without `keep_speed` where that changes nothing."""
        return [it for it in self.manoeuvre if self.lively or it.do != "keep_speed"]

    @property
    def endings(self) -> dict[str, int]:
        """By name of a manoeuvre, index of its act. A `follow` from the start has no act."""
        acts = enumerate(self.scripted)
        return {it.name: index for index, it in acts if it.name and (it.when or it.do != "follow")}

    def read(self, names: Names, road: Road) -> Vehicle:
        """Check this table and read its formulas and manoeuvres."""
        check_vehicle_name(f"a vehicle of {names.where}", self.name)
        what = f"vehicle `{self.name}`"
        owner = capitalised(f"{what} of {names.where}")
        if sum(position is not None for position in (self.gap, self.gap_behind, self.x)) != 1:
            raise InputError(f"{owner} must have either gap, gap_behind or x.")
        names.distinct((move.name for move in self.manoeuvre if move.name), "manoeuvre", owner)
        moves = [move.read(what, names, road) for move in self.manoeuvre]
        scripted = tuple(move for move in moves if move.table in self.scripted)
        numbers = names.quantities(self, what)
        self._check_manoeuvres(owner)
        if self.heading is not None and self.lateral_speed is not None:
            raise InputError(f"{owner} must have either heading or lateral_speed.")
        if self.on_map:
            self._check_on_map(owner, road)
        return Vehicle(self, numbers, scripted)

    def _check_manoeuvres(self, owner: str) -> None:
        """Refuse manoeuvres that do not fit together."""
        follows = [move.do == "follow" for move in self.manoeuvre]
        if sum(move.do == "brake" for move in self.manoeuvre) > 1 and not self.lively:
            raise InputError(f"{owner} must brake at most once.")
        if any(follows[:-1]):
            raise InputError(f"{owner} must do nothing after it does `follow`.")
        at_once = any(follows) and self.manoeuvre[-1].when is None
        if at_once and (len(follows) > 1 or self.heading or self.lateral_speed):
            raise InputError(
                f"{owner} must do nothing else where it does `follow` from the start: `when` says "
                "from when on it does."
            )

    def _check_on_map(self, owner: str, road: Road) -> None:
        """Refuse `on_map` on a straight road, and together with keys that are along the road."""
        if not road.bent:
            raise InputError(
                f"{owner} must not have `on_map`: on a straight road the map is the road."
            )
        along = [
            key for key in ("gap", "gap_behind", "lateral_speed") if getattr(self, key) is not None
        ]
        along += [f"`{it.do}`" for it in self.manoeuvre if it.do in ("path", "follow") or it.places]
        if along:
            raise InputError(f"{owner} has no {along[0]} beside `on_map`: that is along the road.")


@frozen
class Vehicle:
    """An actor as read from its table.

    numbers: its formulas by key.
    moves: its manoeuvres, as in `VehicleTable.scripted`.
    """

    table: VehicleTable
    numbers: LimitedFormulas
    moves: tuple[Move, ...]

    def actor(self, ego: Start, ego_table: EgoTable, road: Road, values: Numbers) -> Actor:
        """The actor at a point.

        ego: start of the ego there.
        values: of parameters and definitions there, by name.
        """
        table = self.table
        body = BODIES[table.body]
        length, width = table.length or body.length, table.width or body.width
        # from centre to centre, m, of the ego and this vehicle if they touch bumper to bumper
        apart = ((ego_table.length or STANDARD_EGO.length) + length) / 2
        start, heading = self._start(ego, apart, values)
        on_map = None
        if table.on_map:  # its numbers are on the map: start and heading along the road follow
            on_map = start.x, start.y, heading
            s, d, heading = (float(it) for it in frame_places(road.line, *on_map))
            start = Start(s, d, start.speed)

        acts = [move.act(values, table.name) for move in self.moves if move.table.do != "follow"]
        if abs(heading) > _AHEAD and any(act.kind == played.BY_PLACE for act in acts):
            owner = f"vehicle `{table.name}` with `places` of a `speed_profile`"
            must = f"within {degrees(_AHEAD):.1f} deg of the road (use `times` otherwise)"
            raise must_be("`heading`", owner, must, round(degrees(heading), 6))

        model = None
        last = self.moves[-1] if self.moves else None
        if last and last.table.model is not None:
            numbers = last.numbers.at(values)
            model = sumo_model(last.table.model, numbers.get("speed", start.speed), numbers)
            # With `when`, SUMO takes over by an act; else it drives from the start. For `departed`
            # the act has the recorded ego's positions, and the time between two as its duration.
            if program := last.program(values):
                follow = Act(played.FOLLOW, numbers["begin"], RECORDED_EVERY, program=program)
                acts.append(follow._replace(table=ego_table.recorded))
        elif table.lively and all(act.timed for act in acts):
            # an `Actor` of acts with closed forms alone is not `lively`: one more act makes it so
            acts.append(keeps_on(acts))
        return Actor(
            table.name,
            start,
            tuple(acts),
            length,
            width,
            slides=table.slides,
            body=table.body,
            heading=heading,
            model=model,
            on_map=on_map,
        )

    def _start(self, ego: Start, apart: float, values: Numbers) -> tuple[Start, float]:
        """Start at a point, and heading, rad.

        ego: start of the ego.
        apart: from centre to centre of two vehicles that touch, m.
        """
        numbers = self.numbers.at(values)
        speed = numbers["speed"]
        heading = radians(numbers.get("heading", 0.0))
        if "lateral_speed" in numbers:
            across = numbers["lateral_speed"]
            speed, heading = sqrt(speed * speed + across * across), atan2(across, speed)
        if "gap" in numbers:
            x = ego.x + numbers["gap"] + apart
        elif "x" in numbers:
            x = numbers["x"]
        else:
            x = ego.x - numbers["gap_behind"] - apart
        return Start(x, numbers["y"], speed), heading


@frozen
class Placement:
    """The function `place` of a `LogicalScenario`: values of a point -> the ego's start and the
    actors.

    definitions: that the formulas of all vehicles need.
    owner: how errors call the scenario.
    numbers: the ego's formulas by key.
    streams: each with its formulas by key.
    """

    definitions: Definitions
    owner: str
    road: Road
    ego: EgoTable
    numbers: LimitedFormulas
    vehicles: tuple[Vehicle, ...]
    streams: tuple[tuple[StreamTable, LimitedFormulas], ...]

    @property
    def lively(self) -> bool:
        """Whether the actors' motion has no closed form: some vehicle is lively, or in a stream."""
        return bool(self.streams) or any(vehicle.table.lively for vehicle in self.vehicles)

    def __call__(self, values: Numbers) -> tuple[Start, tuple[Actor, ...]]:
        """The start of the ego, and the actors."""
        extended = self.definitions.extend(values)
        ego = self.ego.start(self.numbers.at(extended), self.road, self.owner)
        actors = [vehicle.actor(ego, self.ego, self.road, extended) for vehicle in self.vehicles]
        for stream, numbers in self.streams:
            actors += stream.actors(ego, self.road, numbers.at(extended))
        return ego, tuple(actors)
