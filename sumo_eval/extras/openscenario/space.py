"""The space of an OpenSCENARIO file, for `logical`: its ParameterValueDistribution as axes.

A range is an axis with a step, and a set an axis of listed values. Sets of several parameters are
one axis for all of these. A listed axis has the numbers of the file where they are all different.
Otherwise (texts, equal numbers) it has the indices in the list, from 0 on. A file without a
distribution is a space of one point.

Users: `extras/openscenario/logical.py`, `extras/openscenario/points.py`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sumo_eval.errors import did_you_mean
from sumo_eval.extras.openscenario.catalogs import named_file
from sumo_eval.extras.openscenario.reading import Node, read_openscenario
from sumo_eval.extras.openscenario.scene import FileOptions
from sumo_eval.extras.openscenario.values import Value, plain
from sumo_eval.frozen import frozen
from sumo_eval.scenario.distribution import Distribution
from sumo_eval.scenario.sampling.grid import decimal

Assignments = tuple[tuple[str, Value], ...]
"""Parameters of the scenario file, each with the value that it gets."""
Choices = tuple[tuple[float, Assignments], ...]
"""Values of a listed axis in ascending order, each with what it assigns."""
_STEPS = 10.0  # of a stochastic range on a grid


@frozen
class Axis:
    """An axis of the space.

    name: of the axis, one of `names`.
    names: the parameters that the axis sets.
    low, high: least and largest value.
    step: of a range, otherwise 1.
    choices: listed values; empty: a range of values of one parameter.
    distribution: density of a range; None: the file gives none.
    weights: of the choices; empty: the file gives none.
    """

    name: str
    names: tuple[str, ...]
    low: float
    high: float
    step: float
    choices: Choices = ()
    distribution: Distribution | None = None
    weights: tuple[float, ...] = ()

    def assigned(self, value: float) -> Assignments:
        """The assignments at a value.

        Maps of the space also ask between listed values. They get the value itself where each
        listed value is assigned to the axis's own parameter, else what the nearest one assigns.
        """
        # `all` is also true for a range, which has no choices
        if all(sets == ((self.name, listed),) for listed, sets in self.choices):
            return ((self.name, value),)
        return min(self.choices, key=lambda choice: abs(choice[0] - value))[1]

    @property
    def values(self) -> list[float]:
        """The axis's values on the grid."""
        if self.choices:
            return [value for value, _ in self.choices]
        low, step = decimal(self.low), decimal(self.step)
        return [float(low + step * k) for k in range(self.count)]

    @property
    def count(self) -> int:
        """Number of the axis's values on the grid."""
        if self.choices:
            return len(self.choices)
        return (decimal(self.high) - decimal(self.low)) // decimal(self.step) + 1

    def with_choices(self, choices: Choices) -> Axis:
        """The axis with some of its choices, at least one."""
        # no pairs where the file gives no weights
        pairs = zip(self.choices, self.weights, strict=False)
        weights = tuple(weight for choice, weight in pairs if choice in choices)
        low, high = choices[0][0], choices[-1][0]
        return replace(self, choices=choices, low=low, high=high, weights=weights)

    def nearest(self, values: ArrayLike) -> NDArray[Any]:
        """Indices of the values on the grid that are nearest to `values`, an array of any shape."""
        apart = np.abs(np.asarray(values)[..., None] - np.array(self.values))
        return np.asarray(apart.argmin(axis=-1))


@frozen
class FileSpace:
    """The space of a file.

    name: of the file that was named, without its ending.
    about: description in that file's header.
    file: the scenario file, which that file may refer to.
    fixed: assignments at every point.
    version: of the standard, as `1.2`.
    options: what the user gave behind the file's name.
    """

    name: str
    about: str
    file: Path
    fixed: Assignments
    axes: tuple[Axis, ...]
    version: str
    options: FileOptions

    def parameters(self, values: Mapping[str, float]) -> dict[str, Value]:
        """The parameters that the space sets in the scenario file at a point.

        values: axis -> its value.
        """
        varied = (axis.assigned(float(values[axis.name])) for axis in self.axes)
        return dict(itertools.chain(self.fixed, *varied))

    @property
    def size(self) -> int:
        """Number of points of the grid."""
        return math.prod(axis.count for axis in self.axes)

    def grid(self) -> Iterator[dict[str, float]]:
        """The points of the grid; the value of the first axis changes last."""
        names = [axis.name for axis in self.axes]
        for row in itertools.product(*(axis.values for axis in self.axes)):
            yield dict(zip(names, row, strict=True))

    def points(self, most: float) -> Iterable[dict[str, float]]:
        """The points of the grid. Where these are more than `most`, the points of three stars: each
        axis at each of its values, with all other axes at their first, last or middle value.
        """
        if self.size <= most:
            return self.grid()
        values = {axis.name: axis.values for axis in self.axes}
        columns = values.values()
        ends_and_middles = ((column[0], column[-1], column[len(column) // 2]) for column in columns)
        points = (
            (*centre[:k], value, *centre[k + 1 :])
            for centre in zip(*ends_and_middles, strict=True)
            for k, column in enumerate(columns)
            for value in column
        )
        return [dict(zip(values, point, strict=True)) for point in dict.fromkeys(points)]

    def with_choices(self, by_axis: Mapping[str, Choices]) -> FileSpace:
        """The space with fewer choices; an axis with one choice becomes a fixed assignment.

        by_axis: axis -> the choices that stay; an axis without an entry keeps its own.
        """
        fixed = list(self.fixed)
        axes = []
        for axis in self.axes:
            choices = by_axis.get(axis.name, axis.choices)
            if len(choices) == 1:
                ((_, assignments),) = choices
                fixed += assignments
            else:
                axes.append(axis.with_choices(choices) if choices else axis)
        return replace(self, fixed=tuple(fixed), axes=tuple(axes))


def read_space(path: Path, options: FileOptions) -> FileSpace:
    """The space of an OpenSCENARIO file: a ParameterValueDistribution, or a scenario file.

    Raises InputError.
    """
    root = read_openscenario(path)
    header = root.child("FileHeader")
    about = " ".join(str(header.get("description", "")).split()) or path.stem
    version = f"{header.get('revMajor')}.{header.get('revMinor')}"
    distribution = root.find("ParameterValueDistribution")
    if not distribution:
        return FileSpace(path.stem, about, path, (), (), version, options)
    file = named_file(distribution.child("ScenarioFile"))
    scenario = read_openscenario(file)
    for inner in scenario.all("ParameterValueDistribution/ScenarioFile"):
        if named_file(inner).resolve() == path.resolve():
            raise inner.fault(f"it leads back to {path.name}")
        raise distribution.fault(
            f"{file.name} must be a scenario file, it is a distribution itself"
        )
    axes = tuple(axes_of(distribution))
    declared = [part.parameter("name") for part in scenario.all("ParameterDeclarations/*")]
    names = []
    for name in itertools.chain.from_iterable(axis.names for axis in axes):
        if name in names:
            raise distribution.fault(f"parameter `{name}` is given by more than one distribution")
        if name not in declared:
            near = did_you_mean(name, declared)
            raise distribution.fault(f"parameter `{name}` is not declared in {file.name}.{near}")
        names.append(name)
    # makes an axis with one value a fixed assignment
    return FileSpace(path.stem, about, file, (), axes, version, options).with_choices({})


def axes_of(distribution: Node) -> Iterator[Axis]:
    """The axes that a ParameterValueDistribution varies."""
    kinds = [
        part for part in distribution.children() if part.tag in ("Deterministic", "Stochastic")
    ]
    if len(kinds) != 1:
        raise distribution.fault("it must be either <Deterministic> or <Stochastic>")
    readers = {
        "DeterministicSingleParameterDistribution": _single,
        "DeterministicMultiParameterDistribution": _together,
        "StochasticDistribution": _drawn,
    }
    for part in kinds[0].children():
        yield part.chosen(readers, "distributions")(part)


def _single(element: Node) -> Axis:
    """A deterministic distribution of one parameter: a list of values, or a range with a step."""
    name, kind = element.parameter("parameterName"), element.only_child()
    if kind.tag == "DistributionSet":
        return _values(element, name, [plain(it.attribute("value")) for it in kind.all("Element")])
    if kind.tag != "DistributionRange":
        raise kind.unsupported()
    low, high = range_of(kind)
    step = kind.above_zero("stepWidth")
    if low == high:
        return _values(element, name, [low])
    return Axis(name, (name,), low, high, step)


def _together(element: Node) -> Axis:
    """A deterministic distribution of several parameters: the sets of their values, listed."""
    rows = [
        tuple((it.parameter("parameterRef"), plain(it.attribute("value")))
            for it in part.all("ParameterAssignment"))
        for part in element.all("ValueSetDistribution/ParameterValueSet")
    ]  # fmt: skip
    names = tuple(dict.fromkeys(name for row in rows for name, _ in row))
    columns = {name: [value for row in rows for it, value in row if it == name] for name in names}
    shared = [name for name in names if len(columns[name]) == len(rows)]
    if not shared:
        raise element.fault("its <ParameterValueSet>s must have a parameter in common")
    # The axis has the name of a parameter with a value in every row: of one with different numbers,
    # else of one with different values, else of any. A parameter without a value in some row keeps
    # there the value that the scenario file declares.
    unique = [name for name in shared if len(set(columns[name])) == len(rows)]
    numeric = [name for name in unique if all(isinstance(value, float) for value in columns[name])]
    return _listed(element, (numeric or unique or shared)[0], names, rows)


def _values(element: Node, name: str, values: Sequence[Value]) -> Axis:
    """The axis of one parameter with listed values."""
    return _listed(element, name, (name,), [((name, value),) for value in values])


def _listed(element: Node, name: str, names: tuple[str, ...], rows: Sequence[Assignments]) -> Axis:
    """The axis of listed assignments, in the order of its values.

    name: of the axis, a parameter with a value in every row.
    names: of all parameters in the rows.
    """
    if not rows:
        raise element.fault("it must list at least one value")
    pairs = itertools.chain(*rows)
    values = [value for it, value in pairs if it == name and isinstance(value, float)]
    if len(set(values)) < len(rows):  # texts or equal numbers: the index instead
        values = list(map(float, range(len(rows))))
    choices = sorted(zip(values, rows, strict=True))
    return Axis(name, names, choices[0][0], choices[-1][0], 1.0, tuple(choices))


def range_of(element: Node) -> tuple[float, float]:
    """The limits of a distribution, low to high."""
    limits = element.child("Range")
    low, high = limits.number("lowerLimit"), limits.number("upperLimit")
    if low > high:
        raise limits.fault(f"`lowerLimit` must be at most `upperLimit`, got {low:g} and {high:g}")
    return low, high


def _drawn(element: Node) -> Axis:
    """A stochastic distribution: values with weights, or a range with a density.

    The sampling of the evaluation draws from it.
    """
    name, kind = element.parameter("parameterName"), element.only_child()
    if kind.tag == "ProbabilityDistributionSet":
        return _weighted(name, kind)
    if kind.tag not in ("UniformDistribution", "NormalDistribution"):
        raise kind.unsupported(
            "stochastic distributions that are: ProbabilityDistributionSet, UniformDistribution "
            "and NormalDistribution with a Range; others are drawn by the sampling method "
            "`openscenario`"
        )
    low, high = range_of(kind)
    if not low < high:
        raise kind.fault(f"its range must not be empty, got {low:g}..{high:g}")
    density = Distribution("uniform", (("loc", low), ("scale", high - low)))
    if kind.tag == "NormalDistribution":
        deviation = math.sqrt(kind.above_zero("variance"))
        loc = kind.number("expectedValue")
        density = Distribution("norm", (("loc", loc), ("scale", deviation)))
    return Axis(name, (name,), low, high, (high - low) / _STEPS, (), density)


def _weighted(name: str, kind: Node) -> Axis:
    """The axis of a ProbabilityDistributionSet: the values of a parameter, each with a weight."""
    weight_of: dict[Value, float] = {}
    for part in kind.all("Element"):
        value = plain(part.attribute("value"))
        weight_of[value] = weight_of.get(value, 0.0) + part.number("weight")
    weights = weight_of.values() or [1.0]  # an empty set is refused by `_values`
    if min(weights) < 0.0 or max(weights) == 0.0:
        raise kind.fault("its weights must be at least 0, one of them above 0")
    axis = _values(kind, name, list(weight_of))
    # the axis has another order, and its values may be indices: each assigns one value
    values = (value for _, ((_, value),) in axis.choices)
    return replace(axis, weights=tuple(weight_of[value] for value in values))
