"""Points from an OpenSCENARIO parameter variation (ParameterValueDistribution), mapped onto the
space of a logical scenario.

A mapping file gives each parameter of the scenario as an expression of the variation's parameters.
Below, "our" parameters are those of the scenario, "their" parameters those of the variation:

    distribution = "ALKS_Scenario_4.4_1_CutInNoCollision_Variation.xosc"
    [parameters]
    ego_speed = "Ego_InitSpeed_Ve0_kph / 3.6"
    [only]
    CutInVehicle_Model = "car"

Deterministic distributions give all combinations, stochastic ones as many draws as asked for. The
constraint groups of the scenario file that the variation names are honoured as the standard has it:
within a group all constraints hold, and of several groups at least one.

Users: `extras/openscenario/format.py`.
"""

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.extras.openscenario.reading import Node, read_openscenario
from sumo_eval.extras.openscenario.space import axes_of, range_of
from sumo_eval.extras.openscenario.values import Value, number_of, plain
from sumo_eval.frozen import frozen
from sumo_eval.scenario.expression import Expression, checked_names, number
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.request import MAX_POINTS, Drawn, Request
from sumo_eval.settings import About, Checked
from sumo_eval.settings.checked import empty_table
from sumo_eval.settings.config import read_checked
from sumo_eval.settings.random_streams import random_stream

Combination = dict[str, Value]


@frozen
class MappingTable(Checked):
    """A mapping file as it is written."""

    distribution: Annotated[str, About("the .xosc of the variation, relative to this file")]
    parameters: Annotated[dict[str, str | float], About("our parameter = expression of theirs")]
    only: dict[str, str | float | bool] = empty_table(
        "their parameter = its only value that is kept"
    )


class SpaceMapping(NamedTuple):
    """A mapping file: the variation, our parameters as expressions of theirs, and the values that
    theirs are held to.
    """

    distribution: Path
    parameters: dict[str, Expression]
    only: dict[str, Value]


class Variation(NamedTuple):
    """A parsed variation: combinations to try.

    combinations: each, name of their parameter -> value.
    scenario: the file that declares the parameters; None where it is missing, or declares none.
    notes: sentences on parts of the file that have no effect.
    """

    combinations: tuple[Combination, ...]
    scenario: Node | None
    notes: tuple[str, ...]


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
    if variation.scenario:
        parts = variation.scenario.all("ParameterDeclarations/*")
        theirs |= {part.parameter("name") for part in parts}
    for name, expression in mapping.parameters.items():
        checked_names(expression, theirs, f"`{name}` of mapping {request.file}")
    check_known(f"parameter in [only] of mapping {request.file}:", theirs, *mapping.only)
    # Keep the combinations that agree with [only], and set the parameters of [only] that a
    # combination lacks: declared, but not varied.
    kept = [
        item | mapping.only
        for item in variation.combinations
        if all(item.get(name, value) == value for name, value in mapping.only.items())
    ]
    if not kept:
        raise InputError(f"[only] of mapping {request.file} keeps no combination.")
    allowed = kept
    if variation.scenario:
        # for each combination: a scene, whose `values` also have the declared values of all other
        # parameters, and the constraint groups that it violates
        checked = map(variation.scenario.declared, kept)
        allowed = [dict(scene.values) for scene, violated in checked if not violated]
    if not allowed:
        raise InputError(
            f"The constraints of {mapping.distribution.name} allow none of its {len(kept)} "
            "combinations."
        )
    rows = np.array([_row(mapping, item) for item in allowed])
    inside = logical.in_box(rows)
    # rounded, as x / 3.6 can give equal points with different last digits
    # times: number of combinations that give a point
    points, times = np.unique(np.round(rows[inside], 9), axis=0, return_counts=True)
    if not len(points):
        raise InputError(
            f"No point of {mapping.distribution.name} lies within the ranges of `{logical.name}`."
        )
    used = {name for expression in mapping.parameters.values() for name in expression.names}
    # varied, but neither used by an expression nor in [only]
    loose = sorted({name for item in kept for name in item} - used - mapping.only.keys())
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
    if loose:
        notes.append(
            f"Not mapped, so that {times.sum()} combinations are {len(points)} points: "
            f"{', '.join(loose)}."
        )
    return Drawn(points, exposure=times.astype(float), notes=tuple(notes))


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
    only = {  # as an .xosc writes it: `true`, not `True`
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
    axes = list(axes_of(distribution))
    total = math.prod(axis.count for axis in axes) if axes else 0
    if not 1 <= total <= MAX_POINTS:
        raise must_be("The combinations", owner, f"between 1 and {MAX_POINTS:,}", total)
    # a value of an axis sets one or several parameters: (name, value) of each
    assignments = [map(axis.assigned, axis.values) for axis in axes]
    combinations = itertools.product(*assignments)
    return tuple(dict(itertools.chain(*parts)) for parts in combinations)


def _stochastic(element: Node, owner: str, count: int | None, seed: int) -> tuple[Combination, ...]:
    runs = element.whole("numberOfTestRuns") if count is None else count
    if not 1 <= runs <= MAX_POINTS:
        within = f"within 1..{MAX_POINTS:,}, or give a `count`"
        raise element.fault(f"`numberOfTestRuns` must be {within}, got {runs}")
    kinds = {  # their parameter -> node of its distribution
        it.parameter("parameterName"): it.only() for it in element.all("StochasticDistribution")
    }
    if not kinds:
        raise InputError(f"{owner} must have at least one StochasticDistribution.")
    columns = [
        _draws(kind, runs, random_stream(seed, "openscenario", owner, name))
        for name, kind in kinds.items()
    ]
    return tuple(dict(zip(kinds, row, strict=True)) for row in zip(*columns, strict=True))


def _draws(kind: Node, runs: int, stream: np.random.Generator) -> list[Value]:
    """Values of a stochastic distribution."""
    tag = kind.tag
    if tag == "UniformDistribution":
        return list(stream.uniform(*range_of(kind), runs).tolist())
    if tag in ("ProbabilityDistributionSet", "Histogram"):
        parts = kind.all("Element") or kind.all("Bin")
        weights = np.array([part.number("weight", 1.0) for part in parts])
        if weights.min(initial=0.0) < 0.0 or not weights.sum() > 0.0:
            raise kind.fault("its weights must be above 0")
        picks = stream.choice(len(parts), runs, p=weights / weights.sum())
        if tag != "Histogram":
            return [plain(parts[pick].attribute("value")) for pick in picks]
        low, high = np.array([range_of(part) for part in parts])[picks].T  # of each draw's bin
        return list((low + stream.uniform(size=runs) * (high - low)).tolist())
    if tag not in ("NormalDistribution", "LogNormalDistribution", "PoissonDistribution"):
        raise kind.unsupported()
    low, high = range_of(kind) if kind.find("Range") else (-math.inf, math.inf)
    normal, variance = tag == "NormalDistribution", kind.not_negative("variance", 0.0)
    mean = kind.number("expectedValue") if normal else kind.above_zero("expectedValue")
    drawn = []
    # Draw until `runs` values lie within the Range; refuse it if 1000 times `runs` draws do not
    # suffice.
    for _ in range(1000):
        if normal:
            values = stream.normal(mean, math.sqrt(variance), runs)
        elif tag == "PoissonDistribution":
            values = stream.poisson(mean, runs).astype(float)
        else:  # mean and variance are those of the value, `spread` is the variance of its logarithm
            spread = math.log1p(variance / mean**2)
            values = stream.lognormal(math.log(mean) - spread / 2.0, math.sqrt(spread), runs)
        drawn += values[(values >= low) & (values <= high)].tolist()
        if len(drawn) >= runs:
            return drawn[:runs]
    raise kind.fault(f"its Range must have values of the distribution, got {low}..{high}")


def _row(mapping: SpaceMapping, values: Mapping[str, Value]) -> list[float]:
    """Our parameters at a combination of theirs."""
    numbers = {
        name: known for name, value in values.items() if (known := number_of(value)) is not None
    }
    row = []
    for name, expression in mapping.parameters.items():
        if lacking := expression.names - numbers.keys():
            needed = min(lacking)
            raise must_be(f"`{needed}`", f"the mapping of `{name}`", "a number", values[needed])
        row.append(float(expression.value(numbers)))
    return row
