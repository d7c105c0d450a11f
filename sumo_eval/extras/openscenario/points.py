"""Points from an OpenSCENARIO parameter variation (ParameterValueDistribution), mapped onto the
space of a logical scenario.

A mapping file gives each parameter of the logical scenario as an expression of the variation's
parameters. In this file, "our" parameters are those of the logical scenario, "their" parameters
those of the variation. A mapping file:

    distribution = "ALKS_Scenario_4.4_1_CutInNoCollision_Variation.xosc"
    [parameters]
    ego_speed = "Ego_InitSpeed_Ve0_kph / 3.6"
    [only]
    CutInVehicle_Model = "car"

Deterministic distributions give all combinations. Stochastic ones give `numberOfTestRuns` draws, or
as many as the sampling's `count`. A combination must satisfy the constraint groups of the scenario
file that the variation names: all constraints of at least one group.

Users: `extras/openscenario/format.py`.
"""

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.extras.openscenario.reading import Node, read_openscenario
from sumo_eval.extras.openscenario.space import axes_of, range_of
from sumo_eval.extras.openscenario.values import Value, number_of, plain
from sumo_eval.frozen import frozen, required
from sumo_eval.scenario.expression import Expression, checked_names, number
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.request import MAX_POINTS, Drawn, Request
from sumo_eval.settings import Checked
from sumo_eval.settings.checked import empty_table
from sumo_eval.settings.config import read_checked
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

Combination = dict[str, Value]
"""Their parameter -> its value."""
_ATTEMPTS = 1000  # rounds of draws, at most, until enough values lie within a distribution's Range


@frozen
class MappingTable(Checked):
    """A mapping file as it is written."""

    distribution: str = required("the .xosc of the variation, relative to this file")
    parameters: dict[str, str | float] = required("our parameter = expression of theirs")
    only: dict[str, str | float | bool] = empty_table(
        "their parameter = its only value that is kept"
    )


class SpaceMapping(NamedTuple):
    """A mapping file.

    distribution: file of the variation.
    parameters: our parameter -> expression of theirs.
    only: their parameter -> its only value that is kept.
    """

    distribution: Path
    parameters: dict[str, Expression]
    only: dict[str, Value]


class Variation(NamedTuple):
    """A variation that was read.

    scenario: root of the scenario file, which declares their parameters; None: it is missing, or
        declares none.
    notes: sentences on parts of the file that have no effect.
    """

    combinations: tuple[Combination, ...]
    scenario: Node | None
    notes: tuple[str, ...]


def from_openscenario(logical: LogicalScenario, request: Request) -> Drawn:
    """The points of a variation, with the number of its combinations at each point as exposure.

    request: `file`: the mapping file; `count`: number of draws of a stochastic variation.
    """
    if request.file is None:
        raise InputError(
            f"`file` of the sampling of scenario `{logical.name}`, the mapping, is missing."
        )
    mapping = read_mapping((request.folder or Path.cwd()) / request.file, logical)
    count = None if request.count is None else request.wanted(logical)
    variation = read_variation(mapping.distribution, count, request.seed)
    _check_names(mapping, variation, f"mapping {request.file}")
    # Keep the combinations that agree with [only], and set the parameters of [only] that a
    # combination lacks: declared, but not varied.
    kept = [
        item | mapping.only
        for item in variation.combinations
        if all(item.get(name, value) == value for name, value in mapping.only.items())
    ]
    if not kept:
        raise InputError(f"[only] of mapping {request.file} keeps no combination.")
    allowed = _allowed(kept, variation.scenario)
    if not allowed:
        raise InputError(
            f"The constraints of {mapping.distribution.name} allow none of its {len(kept)} "
            "combinations."
        )
    rows = np.array([_row(mapping, item) for item in allowed])
    inside = logical.in_box(rows)
    # Rounded, because x / 3.6 can give equal points with different last digits. `times` is the
    # number of combinations that give a point.
    points, times = np.unique(np.round(rows[inside], 9), axis=0, return_counts=True)
    if not len(points):
        raise InputError(
            f"No point of {mapping.distribution.name} lies within the ranges of `{logical.name}`."
        )
    used = {name for expression in mapping.parameters.values() for name in expression.names}
    # varied, but neither used by an expression nor in [only]
    unused = sorted({name for item in kept for name in item} - used - mapping.only.keys())
    forbidden, outside = len(kept) - len(allowed), int(np.sum(~inside))
    notes, total = [*variation.notes], len(variation.combinations)
    if len(kept) < total:
        notes.append(f"[only] keeps {len(kept)} of {total} combinations.")
    if forbidden:
        notes.append(
            f"Constraint groups of the OpenSCENARIO file exclude {forbidden} combinations."
        )
    if outside:
        notes.append(f"{outside} combinations lie outside the ranges of `{logical.name}`.")
    if unused:
        notes.append(
            f"Not mapped, so that {times.sum()} combinations are {len(points)} points: "
            f"{', '.join(unused)}."
        )
    return Drawn(points, exposure=times.astype(float), notes=tuple(notes))


def _check_names(mapping: SpaceMapping, variation: Variation, owner: str) -> None:
    """Raise InputError where the mapping names a parameter that the variation does not have.

    owner: name of the mapping in the message.
    """
    theirs = {name for item in variation.combinations for name in item}
    if variation.scenario:
        parts = variation.scenario.all("ParameterDeclarations/*")
        theirs |= {part.parameter("name") for part in parts}
    for name, expression in mapping.parameters.items():
        checked_names(expression, theirs, f"`{name}` of {owner}")
    check_known(f"parameter in [only] of {owner}:", theirs, *mapping.only)


def _allowed(combinations: list[Combination], scenario: Node | None) -> list[Combination]:
    """The combinations that the constraint groups of the scenario file allow.

    Each also gets the declared values of all other parameters.
    """
    if scenario is None:
        return combinations
    # of each combination, the scenario with all values, and the constraints that these break
    declared = map(scenario.declared, combinations)
    return [dict(complete.values) for complete, broken in declared if not broken]


def read_mapping(path: Path, logical: LogicalScenario) -> SpaceMapping:
    """A mapping file.

    Raises InputError where a parameter of the scenario is missing or unknown.
    """
    table, owner = read_checked(path, MappingTable, "mapping"), f"mapping {path}"
    kind = f"parameter of scenario `{logical.name}` in {owner}:"
    check_known(kind, logical.names, *table.parameters)
    for name in logical.names:
        if name not in table.parameters:
            raise InputError(
                f"`{name}` of scenario `{logical.name}` is missing in [parameters] of {owner}."
            )
    expressions = {name: number(table.parameters[name], owner) for name in logical.names}
    # `plain` reads a value as it does that of an .xosc, where a truth value is `true`, not `True`
    only = {
        name: plain(str(value).lower() if isinstance(value, bool) else str(value))
        for name, value in table.only.items()
    }
    return SpaceMapping(path.parent / table.distribution, expressions, only)


def read_variation(path: Path, count: int | None, seed: int) -> Variation:
    """A ParameterValueDistribution file and the constraints of the scenario file that it names."""
    distribution = read_openscenario(path).find("ParameterValueDistribution")
    if not distribution:
        raise InputError(f"{path.name} must hold a ParameterValueDistribution.")
    notes = []
    scenario = None
    named = distribution.find("ScenarioFile")
    target = path.parent / (named.get("filepath", "") if named else "")
    if not target.is_file():
        notes.append(
            f"The scenario file of {path.name} is not there: no constraint groups, no default "
            "values."
        )
    else:
        scenario = read_openscenario(target)
        if not scenario.find("ParameterDeclarations"):
            scenario = None
    stochastic = distribution.find("Stochastic")
    if stochastic and not distribution.find("Deterministic"):
        combinations = _stochastic(stochastic, path.name, count, seed)
        theirs = stochastic.get("randomSeed")
        if theirs is not None:
            notes.append(
                f"The random seed {theirs} of {path.name} is not used: the evaluation's own is."
            )
    else:
        combinations = _deterministic(distribution, path.name)
        if count is not None:
            raise InputError(
                f"`count` does nothing for {path.name}: its distribution is deterministic, and all "
                "combinations are driven; [only] of the mapping leaves some out."
            )
    return Variation(combinations, scenario, tuple(notes))


def _deterministic(distribution: Node, owner: str) -> tuple[Combination, ...]:
    """All combinations of a deterministic variation; owner: name of its file."""
    axes = list(axes_of(distribution))
    total = math.prod(axis.count for axis in axes) if axes else 0
    if not 1 <= total <= MAX_POINTS:
        raise must_be("The combinations", owner, f"between 1 and {MAX_POINTS:,}", total)
    # for each axis what each of its values assigns: one or several parameters
    assignments = [map(axis.assigned, axis.values) for axis in axes]
    combinations = itertools.product(*assignments)
    return tuple(dict(itertools.chain(*parts)) for parts in combinations)


def _stochastic(element: Node, owner: str, count: int | None, seed: int) -> tuple[Combination, ...]:
    """Draws of a stochastic variation; owner: name of its file."""
    runs = element.whole("numberOfTestRuns") if count is None else count
    if not 1 <= runs <= MAX_POINTS:  # a `count` is within, see `Request.wanted`
        within = f"within 1..{MAX_POINTS:,}, or give a `count`"
        raise element.fault(f"`numberOfTestRuns` must be {within}, got {runs}")
    distributions = {
        part.parameter("parameterName"): part.only_child()
        for part in element.all("StochasticDistribution")
    }
    if not distributions:
        raise InputError(f"{owner} must have at least one StochasticDistribution.")
    columns = [
        _draws(kind, runs, random_stream(seed, "openscenario", owner, name))
        for name, kind in distributions.items()
    ]
    rows = zip(*columns, strict=True)
    return tuple(dict(zip(distributions, row, strict=True)) for row in rows)


def _draws(kind: Node, runs: int, stream: Generator) -> list[Value]:
    """Values (runs,) of a stochastic distribution."""
    if kind.tag == "UniformDistribution":
        return list(stream.uniform(*range_of(kind), runs).tolist())
    if kind.tag in ("ProbabilityDistributionSet", "Histogram"):
        return _weighted_draws(kind, runs, stream)
    if kind.tag not in ("NormalDistribution", "LogNormalDistribution", "PoissonDistribution"):
        raise kind.unsupported()
    low, high = range_of(kind) if kind.find("Range") else (-math.inf, math.inf)
    drawn: list[Value] = []
    for _ in range(_ATTEMPTS):
        values = _unbounded_draws(kind, runs, stream)
        drawn += values[(values >= low) & (values <= high)].tolist()
        if len(drawn) >= runs:
            return drawn[:runs]
    raise kind.fault(f"its Range must have values of the distribution, got {low}..{high}")


def _weighted_draws(kind: Node, runs: int, stream: Generator) -> list[Value]:
    """Values (runs,) of listed ones with weights, or within the weighted bins of a histogram."""
    parts = kind.all("Element") or kind.all("Bin")
    weights = np.array([part.number("weight", 1.0) for part in parts])
    if weights.min(initial=0.0) < 0.0 or not weights.sum() > 0.0:
        raise kind.fault("its weights must be at least 0, one of them above 0")
    picks = stream.choice(len(parts), runs, p=weights / weights.sum())
    if kind.tag != "Histogram":
        return [plain(parts[pick].attribute("value")) for pick in picks]
    low, high = np.array([range_of(part) for part in parts])[picks].T  # of each draw's bin
    return list((low + stream.uniform(size=runs) * (high - low)).tolist())


def _unbounded_draws(kind: Node, runs: int, stream: Generator) -> FloatArray:
    """Values (runs,) of a normal, log-normal or Poisson distribution, whatever its Range."""
    normal, variance = kind.tag == "NormalDistribution", kind.not_negative("variance", 0.0)
    mean = kind.number("expectedValue") if normal else kind.above_zero("expectedValue")
    if normal:
        return stream.normal(mean, math.sqrt(variance), runs)
    if kind.tag == "PoissonDistribution":
        return stream.poisson(mean, runs).astype(float)
    # the file has mean and variance of the value, numpy needs those of its logarithm
    log_variance = math.log1p(variance / mean**2)
    return stream.lognormal(math.log(mean) - log_variance / 2.0, math.sqrt(log_variance), runs)


def _row(mapping: SpaceMapping, values: Mapping[str, Value]) -> list[float]:
    """Our parameters at a combination of theirs."""
    numbers = {
        name: parsed for name, value in values.items() if (parsed := number_of(value)) is not None
    }
    row = []
    for name, expression in mapping.parameters.items():
        if not_numbers := expression.names - numbers.keys():
            first = min(not_numbers)
            raise must_be(f"`{first}`", f"the mapping of `{name}`", "a number", values[first])
        row.append(float(expression.value(numbers)))
    return row
