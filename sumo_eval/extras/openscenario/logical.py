"""An OpenSCENARIO file as a logical scenario: its parameters span the space, its storyboard gives
the scene at each point. The front of this package: `format`, `describe` and `written` use it.

A logical scenario has one road. Where a file's parameters change the road, the file gives a logical
scenario for each road, and an option picks it: `file.xosc?road=2`.

Users: `extras/openscenario/collections.py`, `extras/openscenario/command.py`,
`extras/openscenario/describe.py`, `extras/openscenario/format.py`,
`extras/openscenario/written.py`.
"""

import math
import os.path
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.extras.openscenario.acts import changes_nothing
from sumo_eval.extras.openscenario.frame import Frame
from sumo_eval.extras.openscenario.reading import changes, read_openscenario
from sumo_eval.extras.openscenario.scene import FileCase, FileOptions, read_case
from sumo_eval.extras.openscenario.space import Assignments, Axis, FileSpace, read_space
from sumo_eval.frozen import frozen
from sumo_eval.groups import grouped
from sumo_eval.input_file import input_file
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Numbers, Road, Start
from sumo_eval.scenario.first_places import misplaced
from sumo_eval.scenario.logical import (
    ONLY,
    Constraint,
    LogicalScenario,
    NamedSample,
    Option,
    Parameter,
    PointFunction,
    Search,
    Values,
)
from sumo_eval.scenario.reachable import never_begin
from sumo_eval.scenario.road.table import bend_name, check_line
from sumo_eval.text import shown
from sumo_eval.trajectory import BoolArray, FloatArray

_MOST_POINTS = 2_000_000  # points of a grid, at most
_MOST_TRIED = 2_000  # points of a grid that are all tried when the file is read, at most
_MOST_SEARCHED = 3  # parameters of a space in which zones are searched, at most
_MOST_LISTED = 12  # values of a parameter that its description lists, at most
_ROUND = 10.0  # m: a road's end is a multiple of it
_ALONG = 0.5  # cosine of the largest angle to the road at which an actor still drives along it
# m from the ego's front to the road's end when the case ends: at the end SUMO removes the ego
_BEFORE_END = 5.0
_OPTIONS = (
    Option("ego", "name", "the entity that the ADS drives (default: `Ego`, the only one with a "
                          "controller, or the only one)"),
    Option("map", "file", "the OpenDRIVE file (.xodr) where the file names a simulator's map"),
    Option("flat", "1", "1: no effect, slopes are always left out"),
    Option("road", "1", "which of the file's roads, from 1 on"),
    Option("zones", "1", "1: search zones by ideal braking, which takes seconds a parameter; "
                         "otherwise everything counts as safe"),
)  # fmt: skip
"""Options behind a file's name: name, unit, meaning."""

Cases = Sequence[FileCase]
Scenes = Sequence[tuple[dict[str, float], FileCase]]
"""Points of the space that are supported, each with the case there."""


@frozen
class PlacedByFile:
    """Function of a point: the ego's start and the actors, as the file has them there.

    road: of the logical scenario, the same at all of its points.
    """

    space: FileSpace
    road: Frame

    def __call__(self, values: Numbers) -> tuple[Start, tuple[Actor, ...]]:
        """The scene at a point, also at one that the file's constraints forbid: a search for zones
        looks there too.
        """
        space = self.space
        case = read_case(space.file, space.parameters(values), space.options)
        if case.frame.shape != self.road.shape:
            raise InputError(
                f"{space.name}: the road must be the same at all points, got {case.frame.name}."
            )
        return case.ego, case.actors


@frozen
class Holds:
    """Function of points: whether the file's constraints hold and the scene there is supported.

    allowed: the answer at every grid point, a byte each, the last axis fastest. Empty: the grid has
        more than `_MOST_TRIED` points. Then each point is tried when it is asked for, but of more
        than `_MOST_TRIED` points at once only the file's constraints are checked.
    """

    space: FileSpace
    road: Frame
    allowed: bytes

    def __call__(self, values: Values) -> BoolArray:
        """The answers at points. Only maps of the space ask between grid points: they get the
        answer at the nearest.
        """
        axes = self.space.axes
        rows = np.broadcast_arrays(*(values[axis.name] for axis in axes))
        if self.allowed:
            table = np.frombuffer(self.allowed, dtype=np.bool_)
            places = tuple(axis.nearest(row) for axis, row in zip(axes, rows, strict=True))
            return np.asarray(table.reshape([axis.count for axis in axes])[places])
        declared = read_openscenario(self.space.file).declared
        holds = np.ones(rows[0].shape, dtype=np.bool_)
        for index in np.ndindex(holds.shape):
            point = {axis.name: float(row[index]) for axis, row in zip(axes, rows, strict=True)}
            if holds.size > _MOST_TRIED:
                _, broken = declared(self.space.parameters(point))
                holds[index] = not broken
            else:
                holds[index] = refusal(self.space, self.road, point) is None
        return holds


@frozen
class Weighted:
    """Density of points: a density of continuous parameters, times the weights of listed values.

    axes: those with weights.
    """

    density: PointFunction
    axes: tuple[Axis, ...]

    def __call__(self, values: Values) -> FloatArray:
        """The density, up to a factor; between listed values that of the nearest."""
        weights = [np.array(axis.weights)[axis.nearest(values[axis.name])] for axis in self.axes]
        return math.prod(weights, start=self.density(values))


def refusal(space: FileSpace, road: Frame, point: Numbers) -> str | None:
    """Reason why a point is not driven; None: it is driven.

    `= ` stands before a reason that the file intends: a constraint forbids the point, or the point
    has another road than `road`. Other reasons are faults, or content that is not supported.
    """
    case = _case_at(space, point)
    if isinstance(case, str):
        return case
    return None if case.frame.shape == road.shape else f"= another road, {case.frame.name}"


def _case_at(space: FileSpace, point: Numbers) -> FileCase | str:
    """The scene at a point, or why it is not driven, as `refusal` gives it."""
    assignments = tuple(sorted(space.parameters(point).items()))
    return _cached_case(space.file, changes(space.file), assignments, space.options)


# maxsize: above `_MOST_TRIED`, because each road of a file asks for the same points again
@lru_cache(maxsize=8_192)
def _cached_case(
    path: Path, changed: int, assignments: Assignments, options: FileOptions
) -> FileCase | str:
    """`_case_at`, cached. changed: number of changes of files, so that a change reads again."""
    values = dict(assignments)
    try:
        _, broken = read_openscenario(path).declared(values)
        if broken:
            return f"= {broken[0]}"
        case = read_case(path, values, options)
        if not case.exported:  # a case that `sumo-eval export` wrote was checked in its run
            _check_possible(path, case, one_point=not values)
        return case
    except InputError as error:
        return str(error)


def _check_possible(path: Path, case: FileCase, *, one_point: bool) -> None:
    """Raise the first fault of a scene by the checks that a run makes of every point.

    one_point: the space has one point. Otherwise the messages hold no places, so that points with
        one fault count together.
    """
    frame = case.frame
    road = Road(frame.name, frame.length, frame.lanes, frame.lane_width, 0.0, line=frame.line)
    for wrong in misplaced(road, case.ego, case.ego_body, case.actors):
        got = f", got {shown(wrong.got)}" if one_point else ""
        raise case.elements[wrong.name].fault(f"{wrong.what} must be {wrong.must}{got}")
    if case.ego.x + 0.5 * case.ego_body.length + _BEFORE_END >= frame.length:
        raise case.elements["ego"].fault(
            f"its front must be over {_BEFORE_END:g} m before its road's end"
        )
    starts = {"ego": case.ego} | {it.name: it.start for it in case.actors}
    for name, start in starts.items():
        if start.speed > road.speed_limit:
            fastest = f"at most {road.speed_limit:g} m/s, the fastest that roads here allow"
            raise case.elements[name].fault(f"its speed at the start must be {fastest}")
    if any(act.program for actor in case.actors for act in actor.acts):
        concrete_scenario = ConcreteScenario(
            path.stem, {}, 1.0, road, case.ego, case.actors, ego_body=case.ego_body
        )
        for actor, number in never_begin(concrete_scenario, case.ends):
            if not changes_nothing(actor.acts[number]):
                raise case.elements[actor.name].fault(
                    "the condition of a move of it can never hold, with any ADS"
                )


class Read(NamedTuple):
    """A file that was read: its logical scenario for one road, and notes on it.

    frame: this road.
    roads: short names of all roads of the file.
    road: index of this road in `roads`.
    notes: sentences on what of the file has no effect here.
    """

    logical: LogicalScenario
    space: FileSpace
    frame: Frame
    roads: tuple[str, ...]
    road: int
    notes: tuple[str, ...]


def read_file(path: Path, options: Mapping[str, str] | None = None) -> Read:
    """An OpenSCENARIO file, read and tried at points of its space.

    options: option, one of `_OPTIONS` -> its value as the user wrote it.

    Raises InputError with file, line and element for what is not supported.
    """
    path = input_file(path, "OpenSCENARIO file").resolve()
    return _read(path, changes(), tuple(sorted((options or {}).items())))


@lru_cache(maxsize=128)
def _read(path: Path, changed: int, given: tuple[tuple[str, str], ...]) -> Read:
    """`read_file`, cached. changed: number of changes of files, so that a change reads again."""
    options = dict(given)
    check_known(f"option of {path.name}", [it.name for it in _OPTIONS], *options)
    for name in ("flat", "zones"):  # checked only: they have no other value than 1
        _option_number(path, options, name, 1)
    file_space = read_space(path, FileOptions(options.get("ego"), options.get("map")))

    # the road that the options choose, and the points with this road
    tried, refused = _tried(file_space)
    if not tried:
        raise InputError(
            f"{path.name}: the constraints of {file_space.file.name} allow no point of its space."
        )
    roads = grouped((case.frame.shape, case.frame) for _, case in tried)
    frames = [first for first, *_ in roads.values()]
    number = _option_number(path, options, "road", len(frames)) - 1
    frame = frames[number]
    scenes = [(point, case) for point, case in tried if case.frame.shape == frame.shape]
    cases = [case for _, case in scenes]

    # the logical scenario, its zones and notes
    space, dropped = _without_doubles(_without_roads(file_space, frame, tried), scenes)
    if "zones" in options and len(space.axes) > _MOST_SEARCHED:
        # a search looks at the 3^k neighbours of a point again and again, k being the number of
        # parameters, and reads the file at each of them
        raise must_be(
            "`zones=1`", path.name,
            f"asked of a file with at most {_MOST_SEARCHED} parameters (without it every point "
            "counts as safe)", len(space.axes),
        )  # fmt: skip
    logical, names = _logical(space, frame, cases), _road_names(frames)
    notes = _notes(path, cases, dropped)
    further = [
        f"{count} of the points that were tried are not supported: {why}"
        for why, count in refused.items()
    ]
    search = _search(cases, logical.road)
    if isinstance(search, str):
        further.append(f"No zone can be defined, so every point counts as safe: {search}.")
    elif "zones" in options:
        logical = replace(logical, search=search)
    else:
        further.append(
            "No zones are searched, so every point counts as safe: `?zones=1` behind the file's "
            "name asks for them."
        )

    # its name: of the file, and of what tells it from others of this file
    road = [names[number]] if len(frames) > 1 else []
    ego = [re.sub(r"[^A-Za-z0-9]+", "_", options["ego"])] if options.get("ego") else []
    name = "_".join([file_space.name, *road, *ego])
    logical = replace(logical, name=name, notes=(*notes, *further))
    return Read(logical, space, frame, names, number, tuple(notes))


def _option_number(path: Path, options: Mapping[str, str], name: str, most: int) -> int:
    """An option that is a whole number within 1..`most`; 1 where it is not given."""
    written = options.get(name, "1")
    if not written.isdecimal() or not 1 <= int(written) <= most:
        must = "1" if most == 1 else f"a whole number within 1..{most}"
        raise must_be(f"`{name}`", path.name, must, written)
    return int(written)


def _notes(path: Path, cases: Cases, dropped: Sequence[str]) -> list[str]:
    """Sentences on what of a file has no effect.

    dropped: parameters on which no drive depends.
    """
    notes = []
    if dropped:
        notes.append(
            f"Points that differ in {', '.join(dropped)} alone are driven alike, and are one point."
        )
    if ignored := dict.fromkeys(kind for case in cases for kind in case.ignored):
        notes.append(f"Not simulated: {', '.join(ignored)}.")
    if len(ends := {case.ends for case in cases}) > 1:
        notes.append(
            f"The stop's time is not the same at all points: all last up to {max(ends):g} s."
        )
    if read_openscenario(path).find("ParameterValueDistribution/Stochastic"):
        notes.append("`numberOfTestRuns` and `randomSeed` are not used: the sampling's are.")
    return notes


def _road_names(frames: Sequence[Frame]) -> tuple[str, ...]:
    """Short names of several roads: without the words that all begin with, numbered if equal."""
    parts = [frame.name.split("_") for frame in frames]
    # `commonprefix` compares lists, too, although it is in `os.path`; the last word always stays
    shared = len(os.path.commonprefix([part[:-1] for part in parts]))  # noqa: RUF071
    names = ["_".join(part[shared:]) for part in parts]
    counts = [names[:number].count(name) for number, name in enumerate(names)]
    return tuple(f"{name}_{count + 1}" if count else name
                 for name, count in zip(names, counts, strict=True))  # fmt: skip


def _tried(space: FileSpace) -> tuple[Scenes, Counter[str]]:
    """The supported points that were tried, and the number of those that are not, by reason.

    All points of a grid of up to `_MOST_TRIED` are tried, of a larger one those along each axis.
    Points that the file's constraints forbid are in neither result.

    Raises InputError with the first reason where no point is supported.
    """
    if space.size > _MOST_POINTS:
        raise must_be("The points", space.name, f"at most {_MOST_POINTS:,}", space.size)
    tried, refused = [], Counter[str]()
    for point in space.points(_MOST_TRIED):
        case = _case_at(space, point)
        if not isinstance(case, str):
            tried.append((point, case))
        elif not case.startswith("= "):
            refused[case] += 1
    if refused and not tried:
        raise InputError(next(iter(refused)))
    return tried, refused


def _without_roads(space: FileSpace, frame: Frame, scenes: Scenes) -> FileSpace:
    """The space without those listed values of its axes at which the road is never `frame`.

    Where only some points of the grid were tried, an axis loses values only if each of its values
    was tried with one road.
    """
    by_axis = {}
    own = frame.shape
    for axis in space.axes:
        roads = grouped((point[axis.name], case.frame.shape) for point, case in scenes)
        one_each = all(len(set(it)) == 1 for it in roads.values())
        if axis.choices and (space.size <= _MOST_TRIED or one_each):
            # a value without a supported point stays, so that its reason is reported
            by_axis[axis.name] = tuple(
                (value, assignments)
                for value, assignments in axis.choices
                if own in roads.get(value, [own])
            )
    return space.with_choices(by_axis)


def _without_doubles(space: FileSpace, scenes: Scenes) -> tuple[FileSpace, tuple[str, ...]]:
    """The space without the axes on which no drive depends, and the parameters of these axes."""
    dropped: list[str] = []
    by_axis = {}
    for axis in space.axes:
        # groups of scenes at points that differ in the value of this axis alone
        drives = grouped(
            (
                tuple(value for name, value in point.items() if name != axis.name),
                (case.ego, case.actors, case.ego_body),
            )
            for point, case in scenes
        )
        compared = [group for group in drives.values() if len(group) > 1]
        if compared and all(len(set(group)) == 1 for group in compared):
            dropped += axis.names
            # one value stays; of a range, its lowest
            by_axis[axis.name] = axis.choices[:1] or ((axis.low, axis.assigned(axis.low)),)
    return space.with_choices(by_axis), tuple(dropped)


def _logical(space: FileSpace, frame: Frame, cases: Cases) -> LogicalScenario:
    """The logical scenario of a space in which every case has the road `frame`."""
    limit = max(case.ends for case in cases)
    body, *bodies = {case.ego_body for case in cases}
    if bodies:
        raise InputError(
            f"{space.name}.xosc, <ParameterValueDistribution>: the ego must be the same vehicle at "
            "all points."
        )
    exported = cases[0].exported
    samples: tuple[NamedSample, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    if space.axes:
        parameters = [_parameter(axis, space) for axis in space.axes]
        points = space.grid() if space.size <= _MOST_TRIED else ()
        allowed = bytes(refusal(space, frame, point) is None for point in points)
        about = "one that the file's constraints allow and that is supported"
        constraints = (Constraint(about, Holds(space, frame, allowed)),)
    else:
        parameters, sample = _the_case(exported)
        samples = (sample,)
    logical = LogicalScenario(
        name=space.name,
        about=space.about,
        source=f"{space.name}.xosc, OpenSCENARIO {space.version}",
        parameters=tuple(parameters),
        constraints=constraints,
        road=_road(frame, cases, limit),
        place=PlacedByFile(space, frame),
        ego_body=body,
        time_limit=limit,
        samples=samples,
        default_sample=samples[0].name if samples else "grid",
        options=_OPTIONS,
        # synthetic drivers react to leads alone, not to an actor that moves across the road
        has_drivers=not any(
            _moves(actor) and math.cos(actor.heading) < _ALONG
            for case in cases
            for actor in case.actors
        ),
    )
    if exported:  # an exported case keeps its own road, body and limits
        return replace(
            logical, road=exported.road, ego_body=exported.ego_body, time_limit=exported.time_limit,
            standstill_time=exported.standstill_time,
        )  # fmt: skip
    return _with_exposure(logical, space.axes)


def _the_case(exported: ConcreteScenario | None) -> tuple[list[Parameter], NamedSample]:
    """Parameters of a file without axes, and the sample with its one case.

    ONLY, which is 0, is the first. The changes of an exported case are further ones. Each
    has one value, but a parameter needs a range: it ends 1 above this value.
    """
    point = {ONLY: 0.0} | dict(exported.changes if exported else ())
    parameters = [
        Parameter(name, value, value + 1.0, 1.0, "1",
            "as exported" if name != ONLY else "nothing: the file has one case",
            (value, value + 1.0))
        for name, value in point.items()
    ]  # fmt: skip
    return parameters, NamedSample("the_case", "the one case of the file", (tuple(point.values()),))


def _with_exposure(logical: LogicalScenario, axes: Sequence[Axis]) -> LogicalScenario:
    """The logical scenario with the file's densities and weights as exposure, if it has any."""
    weighted = tuple(axis for axis in axes if axis.weights)
    names = [f"{it.name} as {it.distribution}" for it in logical.parameters if it.distribution]
    names += [f"{axis.name} by its weights" for axis in weighted]
    if not names:
        return logical
    from sumo_eval.scenario.expression import Definitions
    from sumo_eval.scenario.formulas import ExposureDensity

    density = ExposureDensity(logical.parameters, None, Definitions(()))
    return replace(logical, exposure=Weighted(density, weighted), exposure_about=", ".join(names))


def _parameter(axis: Axis, space: FileSpace) -> Parameter:
    """An axis as a parameter of the logical scenario."""
    about = f"of {space.file.name}"
    others = [name for name in axis.names if name != axis.name]
    if others:
        about += f", with {', '.join(others)}"
    # where the axis only numbers the values of its parameter, list what each number stands for
    if any(dict(row)[axis.name] != value for value, row in axis.choices):
        meanings = (
            f"{value:g}: " + ", ".join(f"{it}" for _, it in row)
            for value, row in axis.choices[:_MOST_LISTED]
        )
        about += f" ({'; '.join(meanings)})"
    # a name may end with its unit: OpenSCENARIO has none
    units = {"_kph": "km/h", "_mps": "m/s", "_mps2": "m/s2", "_m": "m", "_s": "s", "_rad": "rad"}
    unit = units.get("".join(axis.name.rpartition("_")[1:]), "1")
    values = tuple(value for value, _ in axis.choices)
    return Parameter(
        axis.name, axis.low, axis.high, axis.step, unit, about, values, axis.distribution
    )


def _road(frame: Frame, cases: Cases, time_limit: float) -> Road:
    """The road up to where the fastest ego is after the time limit, s, or to its end in the file.

    Its speed at the start counts. The rest of the file's road stays behind the end of the cases.
    """
    reach = max(case.ego.x + case.ego.speed * time_limit for case in cases)
    # an ego that starts from rest drives as fast as the ADS wants: the whole road
    if any(case.ego.speed == 0.0 for case in cases):
        reach = frame.length
    room = frame.length - max(0.5 * case.ego_body.length for case in cases) - _BEFORE_END
    length = min(math.ceil(min(reach, frame.length) / _ROUND) * _ROUND, room)
    if frame.line:
        check_line(frame.line, frame.lanes, frame.lane_width, f"the road {frame.name}")
    name = frame.name.replace("-", "minus_") + f"_to_{length:g}m"
    name = name.replace(".", "_") + bend_name(frame.line, named=False)
    return Road(name, length, frame.lanes, frame.lane_width, frame.length - length, line=frame.line)


def _moves(actor: Actor) -> bool:
    """Whether an actor drives at any time."""
    return actor.start.speed > 0.0 or not all(map(changes_nothing, actor.acts))


def _search(cases: Cases, road: Road) -> Search | str:
    """The actor that zones are searched from, or a reason why no zone can be defined.

    It is the nearest actor that stands in the ego's way, otherwise the first that moves.
    """
    if road.bent:
        return "the road is curved"
    if len({len(case.actors) for case in cases}) > 1:
        return "some points have fewer actors"
    case = cases[0]
    moving = [k for k, actor in enumerate(case.actors) if _moves(actor)]
    in_way = [
        (it.start.x, k) for k, it in enumerate(case.actors)
        if k not in moving and it.start.x > case.ego.x
        and abs(it.start.y - case.ego.y) < 0.5 * (it.width + case.ego_body.width)
    ]  # fmt: skip
    chosen = [k for _, k in sorted(in_way)] or moving
    return Search(chosen[0]) if chosen else "no actor moves or stands in the way"


def concrete_points(
    read: Read, most: float = math.inf
) -> Iterator[tuple[dict[str, float], str | None]]:
    """The points of a file that was read, each with its `refusal`: why it is not driven.

    most: of a grid with more points, only those along each axis.
    """
    for point in read.space.points(most):
        yield point, refusal(read.space, read.frame, point)


def concrete(read: Read, point: Numbers) -> ConcreteScenario:
    """The concrete scenario of a file at a point, empty for the one case of a file without axes."""
    logical = read.logical
    if not point:
        point = logical.point(logical.samples[0].points[0])
    return logical.concrete(**point)
