"""An OpenSCENARIO file as a logical scenario: its parameters the space, its storyboard the scene at
each point.

A ParameterValueDistribution spans the space: a range is a range, a set its values, a set of
parameters that go together one axis. An axis has numbers where a parameter of it has different
ones, else the place in the list, from 0 on. A file without a distribution is a space of one point.

A space has one road. Where the road is a parameter, the file gives a logical scenario for each,
which an option picks: `file.xosc?road=2`.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path

import numpy as np

from sumo_eval.errors import InputError, did_you_mean, must_be
from sumo_eval.extras.openscenario.catalogs import named_file
from sumo_eval.extras.openscenario.reading import Part, read_openscenario
from sumo_eval.extras.openscenario.scene import (
    NO_CHOICE,
    Choice,
    Frame,
    Scene,
    changes_nothing,
    scene,
)
from sumo_eval.extras.openscenario.values import Value, plain
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road, Start
from sumo_eval.scenario.distribution import Distribution
from sumo_eval.scenario.first_places import misplaced
from sumo_eval.scenario.logical import (
    Constraint,
    LogicalScenario,
    NamedSample,
    Option,
    Parameter,
    Values,
)
from sumo_eval.scenario.played import KEEP
from sumo_eval.scenario.reachable import never_begin
from sumo_eval.scenario.road.table import bend_name, check_line
from sumo_eval.trajectory import BoolArray, FloatArray

_MOST = 2_000_000  # points of a grid
_LOOKED_AT = 2_000  # points at which a file is tried before the first case
_LONGEST = 60.0  # s that a case lasts where no stop of the file is by time
_SEARCHED = 3  # parameters of a space in which zones are searched, at most
_DEEPEST = 8  # files that lead to each other before the search for a cycle is given up
_ROUND = 10.0  # m: a road's end is a multiple of it
_ALONG = 0.5  # cosine of the largest angle to the road at which somebody still drives along it

Assignments = tuple[tuple[str, Value], ...]


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis of the space.

    choices: what each of its values assigns, by value; empty: the value itself, to `names[0]`.

    step: of a range, else 0.
    weights: of the choices, where they have any.
    """

    name: str
    names: tuple[str, ...]
    low: float
    high: float
    step: float
    choices: tuple[tuple[float, Assignments], ...] = ()
    distribution: Distribution | None = None
    weights: tuple[float, ...] = ()

    def assigned(self, value: float) -> Assignments:
        """What it assigns at a value; between listed ones, which only maps of the space look at,
        the nearer's.
        """
        if not self.choices or (
            len(self.names) == 1 and self.choices[0][1] == ((self.name, self.choices[0][0]),)
        ):
            return ((self.names[0], float(value)),)
        return min(self.choices, key=lambda choice: abs(choice[0] - value))[1]

    @property
    def values(self) -> list[float]:
        """Its values on the grid."""
        if self.choices:
            return [value for value, _ in self.choices]
        low, step = Fraction(repr(self.low)), Fraction(repr(self.step))
        return [float(low + step * k) for k in range(self.count)]

    @property
    def count(self) -> int:
        """How many values it has on the grid."""
        if self.choices:
            return len(self.choices)
        return (
            int((Fraction(repr(self.high)) - Fraction(repr(self.low))) // Fraction(repr(self.step)))
            + 1
        )


@dataclass(frozen=True, slots=True)
class Space:
    """What a file spans.

    file: the scenario file;
    fixed: what is assigned at every point;
    choice: the ego and the map that the user names.
    """

    name: str
    about: str
    file: Path
    fixed: Assignments
    axes: tuple[Axis, ...]
    version: str
    choice: Choice

    def given(self, values: Mapping[str, float]) -> dict[str, Value]:
        """The parameters of the scenario file at a point."""
        found = dict(self.fixed)
        for axis in self.axes:
            found |= dict(axis.assigned(float(values[axis.name])))
        return found


# -- reading what spans the space ------------------------------------------------------------------


def read_space(path: Path, choice: Choice = NO_CHOICE) -> Space:
    """The space of an OpenSCENARIO file: a ParameterValueDistribution, or a scenario file.

    Raises InputError.
    """
    root = read_openscenario(path)
    header = root.child("FileHeader")
    about = " ".join(str(header.get("description", "")).split()) or path.stem
    file, first = path, root.find("ParameterValueDistribution")
    distribution, seen = first, [path.resolve()]
    while distribution is not None:
        named = distribution.child("ScenarioFile")
        file = named_file(named)
        if file.resolve() in seen:
            raise named.fault(f"it leads back to {file.name}")
        seen.append(file.resolve())
        distribution = read_openscenario(file).find("ParameterValueDistribution")
        if distribution is not None and len(seen) > _DEEPEST:
            raise named.fault("distributions of distributions are not played")
    axes = [] if first is None else list(axes_of(first))
    names = [name for axis in axes for name in axis.names]
    for name in names:
        if names.count(name) > 1:
            assert first is not None
            raise first.fault(f"parameter `{name}` is given by more than one distribution")
    fixed = tuple(
        itertools.chain.from_iterable(axis.choices[0][1] for axis in axes if len(axis.choices) == 1)
    )
    spans = tuple(axis for axis in axes if len(axis.choices) != 1)
    version = f"{header.get('revMajor')}.{header.get('revMinor')}"
    space = Space(path.stem, about, file, fixed, spans, version, choice)
    if first is not None and len(seen) > 2:
        raise first.fault(f"{seen[1].name} must be a scenario file, it is a distribution itself")
    if first is not None:
        _check_declared(space, first)
    return space


def _check_declared(space: Space, element: Part) -> None:
    known = [
        part.attribute("name")
        for part in read_openscenario(space.file).all("ParameterDeclarations/*")
    ]
    named = [name for name, _ in space.fixed] + [name for axis in space.axes for name in axis.names]
    for name in named:
        if name not in known:
            raise element.fault(
                f"parameter `{name}` is not declared in "
                f"{space.file.name}.{did_you_mean(name, known)}"
            )


def axes_of(distribution: Part) -> Iterator[Axis]:
    """What a ParameterValueDistribution varies."""
    held = [part for part in distribution.children() if part.tag in ("Deterministic", "Stochastic")]
    if len(held) != 1:
        raise distribution.fault("it must be either <Deterministic> or <Stochastic>")
    for part in held[0].children():
        if part.tag == "DeterministicSingleParameterDistribution":
            yield _single(part)
        elif part.tag == "DeterministicMultiParameterDistribution":
            yield _together(part)
        elif part.tag == "StochasticDistribution":
            yield _drawn(part)
        else:
            raise part.not_played()


def _single(element: Part) -> Axis:
    name, kind = element.attribute("parameterName"), element.only()
    if kind.tag == "DistributionSet":
        return _values(element, name, [plain(it.attribute("value")) for it in kind.all("Element")])
    if kind.tag != "DistributionRange":
        raise kind.not_played()
    low, high = range_of(kind)
    step = kind.above_zero("stepWidth")
    if low == high:
        return _values(element, name, [low])
    return Axis(name, (name,), low, high, step)


def _together(element: Part) -> Axis:
    sets = element.all("ValueSetDistribution/ParameterValueSet")
    rows: list[Assignments] = [
        tuple(
            (it.attribute("parameterRef"), plain(it.attribute("value")))
            for it in part.all("ParameterAssignment")
        )
        for part in sets
    ]
    names = tuple(dict.fromkeys(name for row in rows for name, _ in row))
    shared = [name for name in names if all(name in dict(row) for row in rows)]
    if not shared:
        raise element.fault("its <ParameterValueSet>s must have a parameter in common")
    # the axis is named by a parameter with different values in all rows, by one with numbers if
    # there is one; what a row leaves out keeps the value that the file declares
    columns = {name: [dict(row)[name] for row in rows] for name in shared}
    apart = [name for name in shared if len(set(columns[name])) == len(rows)]
    numeric = [name for name in apart if all(isinstance(value, float) for value in columns[name])]
    return _listed(element, (numeric or apart or shared)[0], names, rows)


def _values(element: Part, name: str, values: Sequence[Value]) -> Axis:
    """The axis of one parameter with listed values."""
    return _listed(element, name, (name,), [((name, value),) for value in values])


def _listed(element: Part, name: str, names: tuple[str, ...], rows: Sequence[Assignments]) -> Axis:
    if not rows:
        raise element.fault("it must list at least one value")
    own = [dict(row)[name] for row in rows]
    if all(isinstance(value, float) for value in own) and len(set(own)) == len(own):
        choices = sorted((float(value), row) for value, row in zip(own, rows, strict=True))
    else:
        choices = [(float(place), row) for place, row in enumerate(rows)]
    return Axis(name, names, choices[0][0], choices[-1][0], 1.0, tuple(choices))


def range_of(element: Part) -> tuple[float, float]:
    """The limits of a distribution, low to high."""
    limits = element.child("Range")
    low, high = limits.decimal("lowerLimit"), limits.decimal("upperLimit")
    if low > high:
        raise limits.fault(f"`lowerLimit` must be at most `upperLimit`, got {low:g} and {high:g}")
    return low, high


def _drawn(element: Part) -> Axis:
    """A stochastic distribution: a range with a density, sampled as the evaluation says."""
    name, kind = element.attribute("parameterName"), element.only()
    if kind.tag == "ProbabilityDistributionSet":
        parts = kind.all("Element")
        weight_of = {plain(it.attribute("value")): it.decimal("weight") for it in parts}
        axis = _values(kind, name, list(weight_of))
        weights = [weight_of[assigned[0][1]] for _, assigned in axis.choices]
        return replace(axis, weights=tuple(weights))
    if kind.tag == "UniformDistribution":
        low, high = range_of(kind)
        density = Distribution("uniform", (("loc", low), ("scale", high - low)))
    elif kind.tag == "NormalDistribution":
        low, high = range_of(kind)
        mean, variance = kind.decimal("expectedValue"), kind.above_zero("variance")
        density = Distribution("norm", (("loc", mean), ("scale", math.sqrt(variance))))
    else:
        raise kind.not_played(
            "stochastic distributions that are: ProbabilityDistributionSet, UniformDistribution "
            "and NormalDistribution with a Range; others are drawn by the sampling method "
            "`openscenario`"
        )
    if not low < high:
        raise kind.fault(f"its range must not be empty, got {low:g}..{high:g}")
    return Axis(name, (name,), low, high, (high - low) / 10.0, (), density)


# -- the logical scenario --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PlacedByFile:
    """Values of one point -> (ego's start, the other vehicles), as the file has them."""

    space: Space
    road: Frame

    def __call__(self, values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
        """The scene at a point, which the constraints may forbid: a search for zones looks there as
        well.
        """
        given = self.space.given(values)
        found = scene(self.space.file, given, self.space.choice, constrained=False)
        if _shape(found.frame) != _shape(self.road):
            raise InputError(
                f"{self.space.name}: the road must be the same at all points, got "
                f"{found.frame.name}."
            )
        return found.ego, found.actors


@dataclass(frozen=True, slots=True)
class Holds:
    """Whether all constraints of the file hold, and whether everybody has a place on its road.

    allowed: of every grid point, 1 byte each, the first axis slowest, where all of them were tried;
        else empty, and each point is worked out: of many at once the constraints alone.
    """

    space: Space
    road: Frame
    allowed: bytes

    def __call__(self, values: Values) -> BoolArray:
        """At points; between two grid points, which only maps of the space look at, as at the
        nearer one.
        """
        axes = self.space.axes
        rows = np.broadcast_arrays(
            *(np.asarray(values[axis.name], dtype=np.float64) for axis in axes)
        )
        if self.allowed:
            place = np.zeros(rows[0].shape, dtype=np.intp)
            for axis, row in zip(axes, rows, strict=True):
                known = np.array(axis.values)
                place = place * len(known) + np.abs(row[..., None] - known).argmin(axis=-1)
            return np.frombuffer(self.allowed, dtype=np.bool_)[place]
        found = np.ones(rows[0].shape, dtype=np.bool_)
        for index in np.ndindex(rows[0].shape):
            point = {axis.name: float(row[index]) for axis, row in zip(axes, rows, strict=True)}
            if rows[0].size > _LOOKED_AT:
                found[index] = not read_openscenario(self.space.file).declared(
                    self.space.given(point)
                )[1]
            else:
                found[index] = refusal(self.space, self.road, point) is None
        return found


@dataclass(frozen=True, slots=True)
class Weighted:
    """Density of points: a density of continuous parameters, times the weights of listed values."""

    density: Callable[[Values], FloatArray]
    axes: tuple[Axis, ...]

    def __call__(self, values: Values) -> FloatArray:
        """The density, up to a factor; between listed values that of the nearest."""
        found = self.density(values)
        for axis in self.axes:
            known = np.array(axis.values)
            nearest = np.abs(np.asarray(values[axis.name])[..., None] - known).argmin(axis=-1)
            found = found * np.array(axis.weights)[nearest]
        return found


def refusal(space: Space, road: Frame, point: Mapping[str, float]) -> str | None:
    """Why a point cannot be played; None where it can.

    A constraint that does not hold is told as `= constraint`.
    """
    found = _looked_at(space, space.given(point))
    if isinstance(found, str):
        return found
    return None if _shape(found.frame) == _shape(road) else f"= another road, {found.frame.name}"


def _looked_at(space: Space, given: Mapping[str, Value]) -> Scene | str:
    """The scene of a file with given values of its parameters, or why there is none there, as
    `refusal` tells it.
    """
    changed = space.file.stat().st_mtime_ns
    return _scene_or_why(space.file, changed, tuple(sorted(given.items())), space.choice)


# more than are looked at of a file: each of its roads asks for the same points again
@lru_cache(maxsize=8_192)
def _scene_or_why(path: Path, changed: int, given: Assignments, choice: Choice) -> Scene | str:
    values = dict(given)
    try:
        _, broken = read_openscenario(path).declared(values)
        if broken:
            return f"= {broken[0]}"
        found = scene(path, values, choice)
        return found if (wrong := _impossible(path, found)) is None else str(wrong)
    except InputError as error:
        return str(error)


def _impossible(path: Path, found: Scene) -> InputError | None:
    """What of a scene cannot be, by the checks that a run makes of every point.

    Its sentence has no number in it, so that points with one fault are counted together.
    """
    frame, ego = found.frame, found.ego_name
    road = Road(frame.name, frame.length, frame.lanes, frame.lane_width, 0.0, line=frame.line)
    wrong = next(misplaced(road, found.ego, found.ego_body, found.actors), None)
    if wrong is not None:
        return _declared(path, ego if wrong.name == "ego" else wrong.name).fault(
            f"its body must be {wrong.must}"
        )
    for name, start in ((ego, found.ego), *((actor.name, actor.start) for actor in found.actors)):
        if start.speed > road.speed_limit:
            fastest = f"at most {road.speed_limit:g} m/s, the fastest that roads here allow"
            return _declared(path, name).fault(f"its speed at the start must be {fastest}")
    if any(act.program for actor in found.actors for act in actor.acts):
        limit = found.ends if math.isfinite(found.ends) else _LONGEST
        case = ConcreteScenario(
            path.stem, {}, 1.0, road, found.ego, found.actors, ego_body=found.ego_body
        )
        for actor, number in never_begin(case, limit):
            if changes_nothing(actor.acts[number]):
                continue
            return _declared(path, actor.name).fault(
                "the condition of a move of it can never hold, whoever drives"
            )
    return None


def _declared(path: Path, name: str) -> Part:
    """Where a file declares an entity."""
    entities = read_openscenario(path).child("Entities")
    return next(
        (part for part in entities.all("ScenarioObject") if part.get("name") == name), entities
    )


@dataclass(frozen=True, slots=True)
class FirstMover:
    """What zones are searched from: one of the others, who is in the way from its first move on."""

    obstacle: int
    conflict: bool = False

    def delay(self, values: Mapping[str, float]) -> float:
        """Ideal braking begins with its first move, s."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Read:
    """A file that was read: its logical scenario for one road, and what must be said of it.

    roads: names of the roads of the file, of which this is number `road`.
    dropped: parameters that change nothing that is played, so that their points would be driven
        twice. notes: sentences.
    """

    logical: LogicalScenario
    space: Space
    frame: Frame
    roads: tuple[str, ...]
    road: int
    dropped: tuple[str, ...]
    ignored: tuple[str, ...]
    refused: tuple[tuple[str, int], ...]


def read_file(path: Path, given: Mapping[str, str] | None = None) -> Read:
    """An OpenSCENARIO file, read and tried at points of its space.

    given: options by name, as written: `road`.

    Raises InputError with file, line and element for what is not played.
    """
    try:
        changed = path.stat().st_mtime_ns
    except OSError as error:
        raise InputError(
            f"OpenSCENARIO file {path} cannot be read: {error.strerror or error}."
        ) from error
    return _read(path.resolve(), changed, tuple(sorted((given or {}).items())))


@lru_cache(maxsize=128)
def _read(path: Path, changed: int, given: tuple[tuple[str, str], ...]) -> Read:
    options = dict(given)
    for name in options:
        if name not in _OPTIONS:
            raise InputError(
                f"Unknown option `{name}` of {path.name}.{did_you_mean(name, _OPTIONS)}"
            )
    if "flat" in options:
        _option(path, options, "flat", 1)
    choice = Choice(options.get("ego", ""), options.get("map", ""))
    whole = read_space(path, choice)
    refused: dict[str, int] = {}
    tried = list(_tried(whole, refused))
    if not tried:
        raise InputError(
            f"{path.name}: the constraints of {whole.file.name} allow no point of its space."
        )
    roads: dict[tuple[object, ...], Frame] = {}
    for _, found in tried:
        roads.setdefault(_shape(found.frame), found.frame)
    number = _option(path, options, "road", len(roads)) - 1
    zones = _option(path, options, "zones", 1) if "zones" in options else 0
    frame = list(roads.values())[number]
    scenes = [(point, found) for point, found in tried if _shape(found.frame) == _shape(frame)]
    space = _without_roads(whole, frame, tried)
    space, dropped = _without_doubles(space, scenes)
    names = _road_names(list(roads.values()))
    name = whole.name if len(roads) == 1 else f"{whole.name}_{names[number]}"
    if choice.ego:
        name = f"{name}_{re.sub(r'[^A-Za-z0-9]+', '_', choice.ego)}"
    ignored = tuple(dict.fromkeys(kind for _, found in scenes for kind in found.ignored))
    if zones == 1 and len(space.axes) > _SEARCHED:
        # a search looks at the 3^k neighbours of a point again and again, and reads the file at
        # each of them
        most = (
            f"asked of a file with at most {_SEARCHED} parameters (without it every point counts "
            "as safe)"
        )
        raise must_be("`zones=1`", path.name, most, len(space.axes))
    logical = _logical(space, frame, scenes, name, searched=zones == 1)
    notes = [*_notes(dropped, ignored, refused), *_about_zones(logical, scenes)]
    logical = replace(logical, notes=tuple(notes))
    return Read(logical, space, frame, names, number, dropped, ignored, tuple(refused.items()))


def _notes(
    dropped: Sequence[str], ignored: Sequence[str], refused: Mapping[str, int]
) -> Iterator[str]:
    """What a reader of the scores must know of the file."""
    if dropped:
        yield (
            f"Points that differ in {', '.join(dropped)} alone are driven alike, and are one point."
        )
    if ignored:
        yield f"Ignored, because they move nobody here: {', '.join(ignored)}."
    for why, count in refused.items():
        yield f"{count} of the points that were tried do not play: {why}"


def _about_zones(
    logical: LogicalScenario, scenes: Sequence[tuple[dict[str, float], Scene]]
) -> Iterator[str]:
    """Why every point counts as safe, where no zones are searched."""
    if logical.search is not None:
        return
    if _search(scenes, logical.road) is not None:
        yield (
            "No zones are searched, so every point counts as safe: `?zones=1` behind the file's "
            "name asks for them."
        )
        return
    counts = {len(found.actors) for _, found in scenes}
    if logical.road.bent:
        why = "the road bends"
    elif len(counts) > 1:
        why = "not everybody is there at every point"
    else:
        why = "nobody moves or stands in the way"
    yield f"No zone can be defined, so every point counts as safe: {why}."


def _option(path: Path, options: Mapping[str, str], name: str, most: int) -> int:
    written = options.get(name, "1")
    if not written.isdigit() or not 1 <= int(written) <= most:
        raise must_be(
            f"`{name}`",
            path.name,
            "1" if most == 1 else f"a whole number within 1..{most}",
            written,
        )
    return int(written)


def _shape(frame: Frame) -> tuple[object, ...]:
    """What makes a road another one."""
    return frame.line, frame.lanes, frame.lane_width, round(frame.length, 6)


def _road_names(frames: Sequence[Frame]) -> tuple[str, ...]:
    """Names of roads by the files they are from, without what all have in common."""
    names = [frame.name for frame in frames]
    if len(names) == 1:
        return tuple(names)
    parts = [name.split("_") for name in names]
    while all(len(part) > 1 and part[0] == parts[0][0] for part in parts):
        parts = [part[1:] for part in parts]
    return _distinct(["_".join(part) for part in parts])


def _distinct(found: Sequence[str]) -> tuple[str, ...]:
    """Names of which later ones that are the same have a number."""
    before = [found[:number].count(name) for number, name in enumerate(found)]
    return tuple(f"{name}_{count + 1}" if count else name
                 for name, count in zip(found, before, strict=True))  # fmt: skip


def _grid(space: Space) -> Iterator[dict[str, float]]:
    names = [axis.name for axis in space.axes]
    for row in itertools.product(*(axis.values for axis in space.axes)):
        yield dict(zip(names, row, strict=True))


def grid_size(space: Space) -> int:
    """How many points the grid of a space has."""
    return math.prod(axis.count for axis in space.axes)


def _tried(space: Space, refused: dict[str, int]) -> Iterator[tuple[dict[str, float], Scene]]:
    """Scenes at all points of a small grid; of a large one with each axis at each of its values in
    turn.

    refused: is told why points cannot be played, and how many of those that were tried. Raises the
        first reason where no point can.
    """
    size = grid_size(space)
    if size > _MOST:
        raise must_be("The points", space.name, f"at most {_MOST:,}", size)
    points = list(_grid(space)) if size <= _LOOKED_AT else _along_axes(space)
    first, plays = None, False
    for point in points:
        found = _looked_at(space, space.given(point))
        if not isinstance(found, str):
            plays = True
            yield point, found
        elif not found.startswith("= "):
            first = first or InputError(found)
            refused[found] = refused.get(found, 0) + 1
    if not plays and first is not None:
        raise first


def _along_axes(space: Space) -> list[dict[str, float]]:
    """Each axis at each of its values, from the first, the last and the middle value of the
    others.
    """
    values = {axis.name: axis.values for axis in space.axes}
    found: dict[tuple[float, ...], dict[str, float]] = {}
    for share in (0.0, 1.0, 0.5):
        base = {name: row[min(int(share * len(row)), len(row) - 1)] for name, row in values.items()}
        for name, row in values.items():
            points = [{**base, name: value} for value in row]
            found |= {tuple(point.values()): point for point in points}
    return list(found.values())


def _without_roads(
    space: Space, frame: Frame, scenes: Sequence[tuple[dict[str, float], Scene]]
) -> Space:
    """The space with only those values of the axes that decide on the road at which it is this one.

    Where only some of the points were looked at, an axis decides if each of its values has one
    road.
    """
    everywhere = grid_size(space) <= _LOOKED_AT
    kept = {}
    for axis in space.axes:
        roads: dict[float, set[tuple[object, ...]]] = {}
        for point, found in scenes:
            roads.setdefault(point[axis.name], set()).add(_shape(found.frame))
        several = axis.choices and len(set.union(*roads.values())) > 1
        if several and (everywhere or all(len(it) == 1 for it in roads.values())):
            own = _shape(frame)  # a value that plays nowhere stays, to be counted with its reason
            kept[axis.name] = tuple(
                choice for choice in axis.choices if own in roads.get(choice[0], {own})
            )
    return _chosen(space, kept)


def _chosen(space: Space, kept: Mapping[str, tuple[tuple[float, Assignments], ...]]) -> Space:
    """The space with these choices of axes alone; axes of one value are fixed."""
    fixed, axes = list(space.fixed), []
    for axis in space.axes:
        choices = kept.get(axis.name, axis.choices)
        if len(choices) == 1:
            fixed += choices[0][1]
        elif choices:
            axes.append(replace(axis, choices=choices, low=choices[0][0], high=choices[-1][0]))
        else:
            axes.append(axis)
    return replace(space, fixed=tuple(fixed), axes=tuple(axes))


def _without_doubles(
    space: Space, scenes: Sequence[tuple[dict[str, float], Scene]]
) -> tuple[Space, tuple[str, ...]]:
    """The space without the axes whose values all give the same drive, and their parameters."""
    dropped: list[str] = []
    kept = {}
    for axis in space.axes:
        drives: dict[tuple[object, ...], list[object]] = {}
        for point, found in scenes:
            rest = tuple(value for name, value in sorted(point.items()) if name != axis.name)
            drives.setdefault(rest, []).append((found.ego, found.actors, found.ego_body))
        compared = [group for group in drives.values() if len(group) > 1]
        if compared and all(len(set(group)) == 1 for group in compared):
            dropped += axis.names
            kept[axis.name] = (
                axis.choices[0] if axis.choices else (axis.low, axis.assigned(axis.low)),
            )
    return _chosen(space, kept), tuple(dropped)


# m that the ego's front is before the road's end when the case ends: at the end SUMO takes it out
_BEFORE_END = 5.0
_ONLY = "only"
_OPTIONS = {
    "ego": "the entity that the ADS drives (default: `Ego`, or the only one with a controller)",
    "map": "the OpenDRIVE file (.xodr) where the file names a simulator's map",
    "flat": "1: no effect, slopes are always left out",
    "road": "which of the file's roads, from 1 on",
    "zones": "1: search zones by ideal braking, which takes seconds a parameter; else everything "
    "counts as safe",
}


def _logical(
    space: Space,
    frame: Frame,
    scenes: Sequence[tuple[dict[str, float], Scene]],
    name: str,
    *,
    searched: bool,
) -> LogicalScenario:
    limit = max(found.ends for _, found in scenes)
    time_limit = limit if math.isfinite(limit) else _LONGEST
    road = _road(frame, scenes, time_limit)
    bodies = {found.ego_body for _, found in scenes}
    if len(bodies) != 1:
        raise InputError(f"{space.name}: the ego must be the same vehicle at all points.")
    parts = [_parameter(axis, space) for axis in space.axes]
    samples: tuple[NamedSample, ...] = ()
    if not parts:
        parts = [Parameter(_ONLY, 0.0, 1.0, 1.0, "1", "nothing: the file has one case", (0.0, 1.0))]
        samples = (NamedSample("the_case", "the one case of the file", ((0.0,),)),)
    constraints: tuple[Constraint, ...] = ()
    if space.axes:
        allowed = b""
        if grid_size(space) <= _LOOKED_AT:
            allowed = bytes(refusal(space, frame, point) is None for point in _grid(space))
        about = "one that the file's constraints allow and that can be played"
        constraints = (Constraint(about, Holds(space, frame, allowed)),)
    spread = [part for part in parts if part.distribution is not None]
    weighted = tuple(axis for axis in space.axes if axis.weights)
    logical = LogicalScenario(
        name=name,
        about=space.about,
        source=f"{space.name}.xosc, OpenSCENARIO {space.version}",
        parameters=tuple(parts),
        constraints=constraints,
        road=road,
        place=PlacedByFile(space, frame),
        approach=None,
        ego_body=next(iter(bodies)),
        time_limit=time_limit,
        samples=samples,
        default_sample=samples[0].name if samples else "grid",
        options=tuple(
            Option(key, {"ego": "name", "map": "file"}.get(key, "1"), about)
            for key, about in _OPTIONS.items()
        ),
        search=_search(scenes, road) if searched else None,
        has_drivers=not any(_comes_across(actor) for _, found in scenes for actor in found.actors),
    )
    if not spread and not weighted:
        return logical
    from sumo_eval.scenario.expression import Definitions
    from sumo_eval.scenario.formulas import ExposureDensity

    names = [f"{part.name} as {part.distribution}" for part in spread]
    names += [f"{axis.name} by its weights" for axis in weighted]
    exposure = Weighted(ExposureDensity(tuple(parts), None, Definitions(())), weighted)
    return replace(logical, exposure=exposure, exposure_about=", ".join(names))


def _parameter(axis: Axis, space: Space) -> Parameter:
    others = [name for name in axis.names if name != axis.name]
    listed = ""
    if axis.choices:
        own = [dict(row)[axis.name] for _, row in axis.choices]
        if any(value != known for value, (known, _) in zip(own, axis.choices, strict=True)):
            listed = "; ".join(
                f"{known:g}: " + ", ".join(f"{value}" for _, value in row)
                for known, row in axis.choices[:12]
            )
    about = (
        f"of {space.file.name}"
        + (f", with {', '.join(others)}" if others else "")
        + (f" ({listed})" if listed else "")
    )
    values = tuple(known for known, _ in axis.choices)
    return Parameter(
        axis.name,
        axis.low,
        axis.high,
        axis.step,
        _unit(axis.name),
        about,
        values,
        axis.distribution,
    )


def _unit(name: str) -> str:
    """The unit that a parameter's name ends with, else `1`: OpenSCENARIO has none."""
    units = {"_kph": "km/h", "_mps": "m/s", "_mps2": "m/s2", "_m": "m", "_s": "s", "_rad": "rad"}
    return next((unit for ending, unit in units.items() if name.endswith(ending)), "1")


def _road(
    frame: Frame, scenes: Sequence[tuple[dict[str, float], Scene]], time_limit: float
) -> Road:
    """The road, judged as far as the fastest ego comes in the time that the file gives, or to the
    file's end of it.
    """
    reach = max(found.ego.x + found.ego.speed * time_limit for _, found in scenes)
    if any(found.ego.speed == 0.0 for _, found in scenes):  # how fast it will be is the ADS's
        reach = frame.length
    room = frame.length - max(0.5 * found.ego_body.length for _, found in scenes) - _BEFORE_END
    length = min(math.ceil(reach / _ROUND) * _ROUND, room)
    if frame.line:
        check_line(frame.line, frame.lanes, frame.lane_width, f"the road {frame.name}")
    name = frame.name.replace(".", "_").replace("-", "minus_") + f"_to_{length:g}m".replace(
        ".", "_"
    )
    name += bend_name(frame.line, named=False)
    return Road(name, length, frame.lanes, frame.lane_width, frame.length - length, line=frame.line)


def _comes_across(actor: Actor) -> bool:
    """Whether another one moves at more than 60 deg to the ego's road: the synthetic drivers know
    leads alone.
    """
    moves = actor.start.speed > 0.0 or any(act.kind != KEEP for act in actor.acts)
    return moves and math.cos(actor.heading) < _ALONG


def _search(scenes: Sequence[tuple[dict[str, float], Scene]], road: Road) -> FirstMover | None:
    """The one of the others that zones are searched from: who moves of its own, else the nearest
    ahead in the way.

    None on a road that bends and where nobody is in the way: no zone can be defined there.
    """
    counts = {len(found.actors) for _, found in scenes}
    if road.bent or counts == {0} or len(counts) != 1:
        return None
    actors, ego, body = scenes[0][1].actors, scenes[0][1].ego, scenes[0][1].ego_body
    moving = [
        k
        for k, actor in enumerate(actors)
        if actor.start.speed > 0.0 or any(act.kind != KEEP for act in actor.acts)
    ]
    in_way = [
        k for k, it in enumerate(actors)
        if k not in moving and it.start.x > ego.x
        and abs(it.start.y - ego.y) < 0.5 * (it.width + body.width)
    ]  # fmt: skip
    chosen = sorted(in_way, key=lambda k: actors[k].start.x) or moving
    return FirstMover(chosen[0]) if chosen else None


def concrete_points(read: Read) -> Iterator[tuple[dict[str, float], str | None]]:
    """All grid points of a file that was read, each with why it cannot be played, None where it
    can.
    """
    for point in _grid(read.space):
        yield point, refusal(read.space, read.frame, point)


def concrete(read: Read, point: Mapping[str, float]) -> ConcreteScenario:
    """The concrete scenario of a file at a point."""
    return read.logical.concrete(**(dict(point) or {_ONLY: 0.0}))
