"""Points from an OpenSCENARIO parameter variation (ParameterValueDistribution), mapped onto one of
our spaces.

A mapping file says which of our parameters is which expression of theirs:

    distribution = "ALKS_Scenario_4.4_1_CutInNoCollision_Variation.xosc"
    [parameters]
    ego_speed = "Ego_InitSpeed_Ve0_kph / 3.6"
    [only]
    CutInVehicle_Model = "car"

Deterministic distributions give all combinations, stochastic ones as many draws as asked for. The
constraint groups of the scenario file that the variation names are honoured as the standard has it:
within a group all constraints hold, and of several groups at least one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.extras.openscenario.reading import Node, read_openscenario
from sumo_eval.extras.openscenario.space import Axis, axes_of, range_of
from sumo_eval.extras.openscenario.values import Value, plain
from sumo_eval.scenario.expression import Expression, checked_names, number
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.request import MAX_POINTS, Drawn, Request
from sumo_eval.settings import About, Checked
from sumo_eval.settings.config import read_checked
from sumo_eval.settings.random_streams import random_stream

Combination = dict[str, Value]


@dataclass(frozen=True, slots=True)
class MappingTable(Checked):
    """A mapping file as it is written."""

    distribution: Annotated[str, About("the .xosc of the variation, relative to this file")]
    parameters: Annotated[dict[str, str | float], About("our parameter = expression of theirs")]
    only: Annotated[
        dict[str, str | float | bool], About("their parameter = the value that it is held to")
    ] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SpaceMapping:
    """A mapping file: the variation, our parameters as expressions of theirs, and the values theirs
    are held to.
    """

    distribution: Path
    parameters: tuple[tuple[str, Expression], ...]
    only: tuple[tuple[str, Value], ...]


@dataclass(frozen=True, slots=True)
class Variation:
    """A parsed variation: combinations to try, and the parameters that the scenario file declares.

    scenario: the file that declares them; None where it is not there, or declares none.
    """

    combinations: tuple[Combination, ...]
    scenario: Node | None
    notes: tuple[str, ...]

    def completed(self, combination: Combination) -> Combination | None:
        """A combination with the defaults of what it leaves out; None where the constraint groups
        forbid it.
        """
        if self.scenario is None:
            return combination
        inner, broken = self.scenario.declared(combination)
        return None if broken else dict(inner.values)


def from_openscenario(logical: LogicalScenario, request: Request) -> Drawn:
    """The points of the variation that the mapping file `request.file` names, `request.count` draws
    if stochastic.
    """
    if request.file is None:
        raise InputError(
            f"`file` of the sampling of scenario `{logical.name}`, the mapping, is missing."
        )
    mapping = read_mapping((request.folder or Path.cwd()) / request.file, logical)
    variation = read_variation(mapping.distribution, request.count, request.seed)
    theirs = {name for item in variation.combinations for name in item}
    if variation.scenario is not None:
        theirs |= {
            part.attribute("name") for part in variation.scenario.all("ParameterDeclarations/*")
        }
    for name, expression in mapping.parameters:
        checked_names(expression, theirs, f"`{name}` of mapping {request.file}")
    for name, _ in mapping.only:
        if name not in theirs:
            raise unknown(f"parameter in [only] of mapping {request.file}:", name, theirs)
    kept = [
        item
        for item in variation.combinations
        if all(item[n] == v for n, v in mapping.only if n in item)
    ]
    allowed = [item for item in map(variation.completed, kept) if item is not None]
    if not allowed:
        raise InputError(
            f"The constraints of {mapping.distribution.name} allow none of its {len(kept)} "
            "combinations."
        )
    rows = np.array([_row(mapping, item) for item in allowed])
    inside = logical.in_box(rows)
    points, times = np.unique(np.round(rows[inside], 9), axis=0, return_counts=True)
    if not len(points):
        raise InputError(
            f"No point of {mapping.distribution.name} lies within the ranges of `{logical.name}`."
        )
    used = {name for _, expression in mapping.parameters for name in expression.names}
    loose = sorted(
        {name for item in kept for name in item} - used - {name for name, _ in mapping.only}
    )
    notes = [*variation.notes]
    if len(kept) < len(variation.combinations):
        notes.append(f"[only] keeps {len(kept)} of {len(variation.combinations)} combinations.")
    if len(allowed) < len(kept):
        notes.append(
            f"Constraint groups of the OpenSCENARIO file exclude {len(kept) - len(allowed)} "
            "combinations."
        )
    if not inside.all():
        notes.append(
            f"{int(np.sum(~inside))} combinations lie outside the ranges of `{logical.name}`."
        )
    if loose:
        notes.append(
            f"Not mapped, so that {int(times.sum())} combinations are {len(points)} points: "
            f"{', '.join(loose)}."
        )
    return Drawn(points, exposure=times.astype(np.float64), notes=tuple(notes))


def read_mapping(path: Path, logical: LogicalScenario) -> SpaceMapping:
    """A mapping file.

    Raises InputError where a parameter of ours is missing or not known.
    """
    table, owner = read_checked(path, MappingTable, "mapping"), f"mapping {path}"
    for name in table.parameters:
        if name not in logical.names:
            raise unknown(
                f"parameter of scenario `{logical.name}` in {owner}:", name, logical.names
            )
    for name in logical.names:
        if name not in table.parameters:
            raise InputError(
                f"`{name}` of scenario `{logical.name}` is missing in [parameters] of {owner}."
            )
    found = tuple((name, number(table.parameters[name], owner)) for name in logical.names)
    held = tuple((name, plain(str(value))) for name, value in table.only.items())
    return SpaceMapping(path.parent / table.distribution, found, held)


def read_variation(path: Path, count: int | None, seed: int) -> Variation:
    """A ParameterValueDistribution file and the constraints of the scenario file that it names."""
    distribution = read_openscenario(path).find("ParameterValueDistribution")
    if distribution is None:
        raise InputError(f"{path.name} must hold a ParameterValueDistribution.")
    notes: list[str] = []
    scenario = _scenario(path, distribution, notes)
    stochastic = distribution.find("Stochastic")
    if stochastic is not None and distribution.find("Deterministic") is None:
        return Variation(
            tuple(_stochastic(stochastic, path, count, seed, notes)), scenario, tuple(notes)
        )
    combinations = tuple(_deterministic(distribution, path.name))
    if count is not None:
        raise InputError(
            f"`count` does nothing for {path.name}: its distribution is deterministic, and all "
            "combinations are "
            "driven; [only] of the mapping leaves some out."
        )
    return Variation(combinations, scenario, tuple(notes))


def _scenario(path: Path, distribution: Node, notes: list[str]) -> Node | None:
    named = distribution.find("ScenarioFile")
    target = None if named is None else path.parent / str(named.get("filepath", ""))
    if target is None or not target.exists():
        notes.append(
            f"The scenario file of {path.name} is not there: no constraint groups, no default "
            "values."
        )
        return None
    scenario = read_openscenario(target)
    return None if scenario.find("ParameterDeclarations") is None else scenario


def _deterministic(distribution: Node, owner: str) -> Iterator[Combination]:
    axes = list(axes_of(distribution))
    total = math.prod(axis.count for axis in axes)
    if not axes or total > MAX_POINTS:
        raise must_be(
            "The combinations", owner, f"between 1 and {MAX_POINTS:,}", total if axes else 0
        )
    for parts in itertools.product(*map(_choices, axes)):
        yield dict(itertools.chain.from_iterable(parts))


def _choices(axis: Axis) -> list[tuple[tuple[str, Value], ...]]:
    """What an axis gives to its parameters, in the order of its values."""
    if axis.choices:
        return [given for _, given in axis.choices]
    return [((axis.name, value),) for value in axis.values]


# --- stochastic -----------------------------------------------------------------------------------


def _stochastic(
    element: Node, path: Path, count: int | None, seed: int, notes: list[str]
) -> Iterator[Combination]:
    runs = count if count is not None else int(str(element.get("numberOfTestRuns", "0")))
    if not 1 <= runs <= MAX_POINTS:
        raise must_be(
            "`numberOfTestRuns`", path.name, f"within 1..{MAX_POINTS:,}, or give a `count`", runs
        )
    theirs = element.get("randomSeed")
    if theirs is not None:
        notes.append(
            f"The random seed {theirs} of {path.name} is not used: the evaluation's own is."
        )
    columns: dict[str, list[Value]] = {}
    for item in element.all("StochasticDistribution"):
        name = str(item.get("parameterName"))
        columns[name] = _draws(
            item, name, runs, random_stream(seed, "openscenario", path.name, name)
        )
    if not columns:
        raise InputError(f"{path.name} must have at least one StochasticDistribution.")
    for row in zip(*columns.values(), strict=True):
        yield dict(zip(columns, row, strict=True))


def _draws(item: Node, name: str, runs: int, stream: np.random.Generator) -> list[Value]:
    kind = next(iter(item.children()), None)
    tag = "nothing" if kind is None else kind.tag
    if kind is None or tag not in _DISTRIBUTIONS:
        raise InputError(
            f"Parameter `{name}` has the distribution `{tag}`, which this program does not know."
        )
    if tag in ("ProbabilityDistributionSet", "Histogram"):
        parts = kind.all("Element" if tag == "ProbabilityDistributionSet" else "Bin")
        weights = np.array([float(str(part.get("weight", "1"))) for part in parts])
        limits = np.array([range_of(part) for part in parts]) if tag == "Histogram" else None
        picks = stream.choice(len(parts), runs, p=weights / weights.sum())
        if limits is None:
            return [plain(str(parts[pick].get("value"))) for pick in picks]
        return list(
            (limits[picks, 0] + stream.uniform(size=runs) * np.ptp(limits[picks], axis=1)).tolist()
        )
    if tag == "UniformDistribution":
        return list(stream.uniform(*range_of(kind), runs).tolist())
    low, high = (-math.inf, math.inf) if kind.find("Range") is None else range_of(kind)
    mean, variance = float(str(kind.get("expectedValue"))), float(str(kind.get("variance", "0")))
    found: list[float] = []
    for _ in range(1000):  # rejection: what lies outside the Range is drawn anew
        if tag == "NormalDistribution":
            drawn = stream.normal(mean, math.sqrt(variance), runs)
        elif tag == "PoissonDistribution":
            drawn = stream.poisson(mean, runs).astype(np.float64)
        else:
            spread = math.log1p(variance / mean**2)
            drawn = stream.lognormal(math.log(mean) - spread / 2.0, math.sqrt(spread), runs)
        found += drawn[(drawn >= low) & (drawn <= high)].tolist()
        if len(found) >= runs:
            return list(found[:runs])
    raise must_be(
        "The Range", f"parameter `{name}`", f"one in which the {tag} has values", f"{low}..{high}"
    )


_DISTRIBUTIONS = (
    "ProbabilityDistributionSet", "Histogram", "UniformDistribution", "NormalDistribution",
    "LogNormalDistribution",
    "PoissonDistribution",
)  # fmt: skip


# --- rows -----------------------------------------------------------------------------------------


def _row(mapping: SpaceMapping, values: Mapping[str, Value]) -> list[float]:
    known = {
        name: plain(value) if isinstance(value, str) else value for name, value in values.items()
    }
    numbers = {name: value for name, value in known.items() if not isinstance(value, str)}
    row = []
    for name, expression in mapping.parameters:
        for needed in expression.names:
            if needed not in numbers:
                raise must_be(f"`{needed}`", f"the mapping of `{name}`", "a number", values[needed])
        row.append(float(expression.value(numbers)))
    return row
