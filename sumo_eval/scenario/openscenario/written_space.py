"""What was understood of an OpenSCENARIO file, its whole space, as scenario files of this project that say the same.

Every number of the scene that is not the same at all points becomes a definition: a line, or a parabola or hyperbola,
through its values where one goes through all of them, else a table of them. Where the others are not the same bodies,
or do not make the same kinds of moves, at all points, there is a file for each kind.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.expression import Expression
from sumo_eval.scenario.file import scenario_from
from sumo_eval.scenario.openscenario.logical import Axis, Read, concrete, grid_size, refusal
from sumo_eval.scenario.openscenario.written import scenario_content
from sumo_eval.scenario.units import KNOWN

MOST = 2_000  # points whose scenes are looked at
_ROOM = 700  # characters of an expression, from which on its halves get names of their own
_SAME = 1e-12  # share of a number that a formula may be off
_NUMBER = re.compile(r"(?<![A-Za-z_0-9.])\d+\.?\d*(?:e[-+]?\d+)?")
_FORMULAS = frozenset(
    {"x", "y", "speed", "heading", "begin", "duration", "acceleration", "deceleration", "offset", "times", "speeds"}
)
"""Keys of a scenario file that may hold an expression."""

Path = tuple[str | int, ...]
Point = tuple[float, ...]
Leaf = float | int | bool | str | None


@dataclass(slots=True)
class _Names:
    """Definitions in the order in which they use each other."""

    taken: set[str]
    formulas: dict[str, str] = field(default_factory=dict)

    def add(self, wanted: str, text: str) -> str:
        """A name for an expression."""
        name = wanted
        while name in self.taken:
            name += "_"
        self.taken.add(name)
        self.formulas[name] = text
        return name


def space_contents(read: Read, fixed: Mapping[str, float]) -> list[dict[str, Any]]:
    """The scenario files, as plain mappings, of the points of a file that play. fixed: parameters held at a value.

    Raises InputError where there is none, or where they are too many.
    """
    axes, known = read.space.axes, [axis.name for axis in read.space.axes]
    for name in fixed:
        if name not in known:
            raise must_be(f"`{name}`", read.logical.name, f"one of its parameters ({', '.join(known)})", name)
    if not axes:
        return [scenario_content(read, {})]
    values = [
        [value for value in axis.values if math.isclose(value, fixed.get(axis.name, value), abs_tol=1e-9)]
        for axis in axes
    ]
    size = math.prod(len(it) for it in values)
    if size > MOST:
        raise InputError(f"{read.logical.name} has {size:,} points, and those of at most {MOST:,} are written: "
                         "`--set NAME=VALUE` holds a parameter.")  # fmt: skip
    scenes: dict[Point, dict[Path, Leaf]] = {}
    for row in itertools.product(*values):
        point = dict(zip(known, row, strict=True))
        if refusal(read.space, read.frame, point) is None:
            content = scenario_content(read, point)
            scenes[row] = {path: leaf for path, leaf in _leaves(content) if path[0] not in _SAID_ONCE}
    if not scenes:
        told = ", ".join(f"{name}={value:g}" for name, value in fixed.items())
        raise InputError(f"No point of {read.logical.name} that plays has {told}.")
    kinds: dict[tuple[object, ...], list[Point]] = {}
    for row, scene in scenes.items():
        kinds.setdefault(_kind(scene), []).append(row)
    whole = len(kinds) == 1
    return [
        _content(read, [scenes[row] for row in rows], rows, "" if whole else f"_{number}", grid_size(read.space))
        for number, rows in enumerate(kinds.values(), 1)
    ]


_SAID_ONCE = ("name", "about", "source", "zone", "parameter", "sample", "default_sample")


def _leaves(node: object, path: Path = ()) -> Iterator[tuple[Path, Leaf]]:
    """Every plain value of a mapping, with where it is; the numbers of a condition each on their own."""
    if isinstance(node, dict):
        for key, inner in node.items():
            yield from _leaves(inner, (*path, key))
    elif isinstance(node, list | tuple):
        for place, inner in enumerate(node):
            yield from _leaves(inner, (*path, place))
    elif isinstance(node, str) and path[-1] == "when":
        yield path, _NUMBER.sub("{}", node)
        for place, found in enumerate(_NUMBER.findall(node)):
            yield (*path, place), float(found)
    elif path == ("ego", "speed"):
        yield path, float(str(node).split()[0])
    else:
        yield path, node  # type: ignore[misc]


def _may_vary(path: Path, leaf: Leaf) -> bool:
    """Whether an expression may stand there."""
    last = next(part for part in reversed(path) if isinstance(part, str))
    number = isinstance(leaf, float | int) and not isinstance(leaf, bool)
    if last == "when":
        return isinstance(path[-1], int)
    return number and path[0] in ("ego", "vehicle") and last in _FORMULAS


def _kind(scene: Mapping[Path, Leaf]) -> tuple[object, ...]:
    """What must be the same throughout a scenario file."""
    return tuple((path, None if _may_vary(path, leaf) else leaf) for path, leaf in scene.items())


def _content(
    read: Read, scenes: Sequence[Mapping[Path, Leaf]], rows: Sequence[Point], suffix: str, size: int
) -> dict[str, Any]:
    """The scenario file of points with others of one kind."""
    axes = [axis for k, axis in enumerate(read.space.axes) if len({row[k] for row in rows}) > 1]
    if not axes:
        point = dict(zip((axis.name for axis in read.space.axes), rows[0], strict=True))
        found = scenario_content(read, point)
        return {**found, "name": found["name"] + suffix}
    kept = [read.space.axes.index(axis) for axis in axes]
    points = [tuple(row[k] for k in kept) for row in rows]
    names = _Names({axis.name for axis in axes} | _others(scenes[0]))
    tabled: set[str] = set()
    used: set[str] = set()
    texts: dict[Path, str | Leaf] = {}
    for path, first in scenes[0].items():
        values = [scene[path] for scene in scenes]
        if not _may_vary(path, first):
            texts[path] = first
            continue
        by_point = {point: float(value) for point, value in zip(points, values, strict=True)}  # type: ignore[arg-type]
        on = _needed(by_point)
        used |= {axes[k].name for k in on}
        if not on:
            texts[path] = first
            continue
        texts[path], listed = _formula(axes, by_point, _name(path, scenes[0]), names)
        tabled |= listed
    speed = texts["ego", "speed"]  # all parameters of a scenario file must be used
    texts["ego", "speed"] = " + ".join([str(speed), *(f"0 * {axis.name}" for axis in axes if axis.name not in used)])
    constraint = []
    grid = list(itertools.product(*(sorted({point[k] for point in points}) for k in range(len(axes)))))
    if len(grid) != len(points):
        plays = {point: float(point in set(points)) for point in grid}
        text, listed = _formula(axes, plays, "plays", names)
        tabled |= listed
        constraint = [{"require": f"{text} > 0.5", "about": "one that the file's constraints allow and that plays"}]
    units = {item.name: item.unit for item in read.logical.parameters}
    held = {axis.name: rows[0][k] for k, axis in enumerate(read.space.axes) if k not in kept}
    values_of = {axis.name: sorted({point[k] for point in points}) for k, axis in enumerate(axes)}
    source = f"{read.space.file.name}, OpenSCENARIO {read.space.version}"
    source += f", {len(rows)} of {size} points" if len(rows) < size else ""
    scene = _rebuilt(texts)
    found = {
        "name": re.sub(r"\W", "_", read.logical.name) + suffix,
        "about": read.space.about,
        "source": source + (f", at {', '.join(f'{name}={value:g}' for name, value in held.items())}" if held else ""),
        "zone": "none",
        "define": names.formulas,
    }  # fmt: skip

    def of(listed: set[str]) -> dict[str, Any]:
        parameters = [
            _parameter(axis, units[axis.name], values_of[axis.name], tabled=axis.name in listed) for axis in axes
        ]
        return {**found, "parameter": parameters, **({"constraint": constraint} if constraint else {}), **scene}

    ranges = {axis.name for axis in axes if not axis.choices} - tabled
    return of(tabled | {name for name in ranges if not _holds_between(read, of(tabled), held, values_of, name)})


def _holds_between(
    read: Read, content: Mapping[str, Any], held: Mapping[str, float], values: Mapping[str, Sequence[float]], name: str
) -> bool:
    """Whether what was written says the same halfway between the values of a parameter, the others at an end each."""
    ours = scenario_from(content, "what was understood", read.space.file.parent)
    for end in (0, -1):
        for one, two in pairwise(values[name]):
            point = {**{other: listed[end] for other, listed in values.items()}, name: 0.5 * (one + two)}
            try:
                again, theirs = ours.concrete(**point), concrete(read, {**held, **point})
            except InputError:
                return False
            mine, asked = list(_numbers(again)), list(_numbers(theirs))
            if len(mine) != len(asked) or not all(map(_is_same, mine, asked)):
                return False
    return True


def _numbers(case: ConcreteScenario) -> Iterator[float]:
    """All numbers that say where everybody is and what everybody does."""
    yield from (case.ego.x, case.ego.y, case.ego.speed)
    for actor in case.actors:
        yield from (actor.start.x, actor.start.y, actor.start.speed, actor.heading, *(actor.on_map or ()))
        for act in actor.script:
            yield from (act.kind, act.begin, act.duration, act.speed, act.offset)
            yield from itertools.chain.from_iterable((*act.table, *act.program))


def _parameter(axis: Axis, unit: str, values: Sequence[float], *, tabled: bool) -> dict[str, Any]:
    """An axis: as a range where what depends on it is known between its values, too."""
    found: dict[str, Any] = {"name": axis.name, "unit": unit if unit in KNOWN else "1"}  # its formulas convert it
    steps = {round(b - a, 9) for a, b in pairwise(values)}
    if axis.distribution is not None:
        if tabled:
            raise InputError(f"Parameter `{axis.name}` is drawn from a distribution, and what depends on it is known "
                             "at the values of a grid alone.")  # fmt: skip
        found["distribution"] = {"name": axis.distribution.name, **dict(axis.distribution.arguments)}
    if axis.choices or tabled or len(steps) != 1:
        return {**found, "values": list(values)}
    return {**found, "low": values[0], "high": axis.high if axis.distribution else values[-1], "step": axis.step}


def _others(scene: Mapping[Path, Leaf]) -> set[str]:
    return {str(leaf) for path, leaf in scene.items() if path[0] == "vehicle" and path[-1] == "name"}


def _name(path: Path, scene: Mapping[Path, Leaf]) -> str:
    """A name for a number by where it is: `lead_act1_speed`."""
    parts = [str(part) for part in path if part not in ("vehicle", "manoeuvre")]
    if path[0] == "vehicle":
        parts[0] = str(scene["vehicle", path[1], "name"])
        if "manoeuvre" in path:
            parts[1] = f"act{parts[1]}"
    return re.sub(r"\W", "_", "_".join(parts))


def _formula(axes: Sequence[Axis], values: Mapping[Point, float], name: str, names: _Names) -> tuple[str, set[str]]:
    """An expression, or the name of one, with these values at the points; the axes on whose listed values it rests."""
    on = _needed(values)
    rest = {tuple(point[k] for k in on): value for point, value in values.items()}
    used = [axes[k].name for k in on]
    text, tabled = _of_few(used, rest, name, names)
    return names.add(name, text), tabled


def _needed(values: Mapping[Point, float]) -> list[int]:
    """The places in a point on which a number depends."""
    on = list(range(len(next(iter(values)))))
    for k in tuple(on):
        fewer = [it for it in on if it != k]
        groups: dict[Point, list[float]] = {}
        for point, value in values.items():
            groups.setdefault(tuple(point[j] for j in fewer), []).append(value)
        if all(_is_same(max(group), min(group)) for group in groups.values()):
            on = fewer
    return on


def _is_same(one: float, two: float) -> bool:
    return one == two or abs(one - two) <= _SAME * max(abs(one), 1.0)


def _of_few(used: Sequence[str], values: Mapping[Point, float], name: str, names: _Names) -> tuple[str, set[str]]:
    """An expression of the parameters that a number depends on; those on whose listed values it rests."""
    if not used:
        return repr(next(iter(values.values()))), set()
    if len(used) == 1:
        text = _closed(used[0], sorted((point[0], value) for point, value in values.items()))
        if text is not None:
            return text, set()
    if len(used) == 2:
        parts = _sum_of_two(values)
        if parts is not None:
            (first, other), tabled = parts, set[str]()
            texts = []
            for parameter, part in zip(used, (first, other), strict=True):
                text, on = _of_few([parameter], part, name, names)
                texts.append(text)
                tabled |= on
            return f"{texts[0]} + ({texts[1]})", tabled
    return _table(used, values, name, names), set(used)


def _sum_of_two(values: Mapping[Point, float]) -> tuple[dict[Point, float], dict[Point, float]] | None:
    """A number of two parameters as one of the first plus one of the second, 0 at its first value; None: it is none."""
    ones, twos = (sorted({point[k] for point in values}) for k in range(2))
    if len(values) != len(ones) * len(twos):
        return None
    first: dict[Point, float] = {(one,): values[one, twos[0]] for one in ones}
    other: dict[Point, float] = {(two,): values[ones[0], two] - values[ones[0], twos[0]] for two in twos}
    same = all(_is_same(first[point[:1]] + other[point[1:]], value) for point, value in values.items())
    return (first, other) if same else None


_SHAPES: tuple[tuple[str, Callable[[float], float]], ...] = (
    ("{}", lambda v: v), ("{} / 3.6", lambda v: v / 3.6), ("(1 / {})", lambda v: 1.0 / v), ("{} ** 2", lambda v: v * v)
)  # fmt: skip


def _closed(name: str, values: Sequence[tuple[float, float]]) -> str | None:
    """The shortest line, hyperbola or parabola through values of one parameter, three at least; None: there is none."""
    if len(values) < 3:
        return None
    (p, a), (q, b) = values[0], values[-1]
    found = []
    for shape, of in _SHAPES:
        text = shape.format(name)
        if (p == 0.0 and "1 /" in shape) or of(q) == of(p):
            continue
        slope = (b - a) / (of(q) - of(p))
        for digits in (3, 6, 17):
            factor = float(f"{slope:.{digits}g}")
            start = float(f"{a - factor * of(p):.{max(digits, 9)}g}")
            product = text if abs(factor) == 1.0 else f"{abs(factor)!r} * {text}"
            lead = f"{start!r} {'-' if factor < 0.0 else '+'} "
            if start == 0.0:
                lead = "-" if factor < 0.0 else ""
            expression = Expression(lead + product)
            if all(_is_same(expression.at({name: at}), value) for at, value in values):
                found.append(expression.text)
                break
    return min(found, key=len, default=None)


def _table(names_of: Sequence[str], values: Mapping[Point, float], name: str, names: _Names) -> str:
    """Nested `where`s that have these values at the points; between two values of a parameter, those of the nearer."""
    if not names_of:
        (value,) = values.values()
        return repr(value)
    parts: list[tuple[float, str]] = []
    for at in sorted({point[0] for point in values}):
        inner = {point[1:]: value for point, value in values.items() if point[0] == at}
        text = _table(names_of[1:], inner, f"{name}_{len(parts) + 1}", names)
        if len(names_of) > 1 and "(" in text:
            text = names.add(f"{name}_{len(parts) + 1}", text)
        parts.append((at, text))
    return _tree(names_of[0], parts, name, names)


def _tree(parameter: str, parts: Sequence[tuple[float, str]], name: str, names: _Names) -> str:
    if len({text for _, text in parts}) == 1:
        return parts[0][1]
    half = len(parts) // 2
    sides = [_tree(parameter, part, name, names) for part in (parts[:half], parts[half:])]
    if sum(map(len, sides)) > _ROOM:
        sides = [names.add(f"{name}_part", side) for side in sides]
    between = 0.5 * (parts[half - 1][0] + parts[half][0])
    return f"where({parameter} < {between!r}, {sides[0]}, {sides[1]})"


def _rebuilt(texts: Mapping[Path, str | Leaf]) -> dict[str, Any]:
    """The mapping of which these are the values."""
    found: dict[str, Any] = {}
    for path, value in texts.items():
        if path[-2:-1] == ("when",):
            continue
        if path[-1] == "when":
            numbers = [texts[(*path, place)] for place in range(str(value).count("{}"))]
            value = str(value).format(*(it if isinstance(it, str) else repr(it) for it in numbers))
        at: Any = found
        for part, following in pairwise(path):
            empty: Any = [] if isinstance(following, int) else {}
            if isinstance(part, int):
                at += [None] * (part + 1 - len(at))
                at[part] = empty if at[part] is None else at[part]
                at = at[part]
            else:
                at = at.setdefault(part, empty)
        if isinstance(path[-1], int):
            at += [None] * (path[-1] + 1 - len(at))
        at[path[-1]] = value
    return found
