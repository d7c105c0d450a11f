"""Points from an OpenSCENARIO parameter variation (ParameterValueDistribution), mapped onto one of our spaces.

A mapping file says which of our parameters is which expression of theirs:

    distribution = "ALKS_Scenario_4.4_1_CutInNoCollision_Variation.xosc"
    [parameters]
    ego_speed = "Ego_InitSpeed_Ve0_kph / 3.6"
    [only]
    CutInVehicle_Model = "car"

Deterministic distributions give all combinations, stochastic ones as many draws as asked for. The constraint groups of
the scenario file that the variation names are honoured as the standard has it: within a group all constraints hold, and
of several groups at least one.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.input_file import read_input
from sumo_eval.scenario.expression import Expression, checked_names, number
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.request import MAX_POINTS, Drawn, Request
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.settings.toml_file import read_toml

Value = float | str
Combination = dict[str, Value]

_RULES = {
    "lessThan": lambda a, b: a < b,
    "lessOrEqual": lambda a, b: a <= b,
    "greaterThan": lambda a, b: a > b,
    "greaterOrEqual": lambda a, b: a >= b,
    "equalTo": lambda a, b: a == b,
    "notEqualTo": lambda a, b: a != b,
}
_REFERENCE = re.compile(r"\$(\w+)")


@dataclass(frozen=True, slots=True)
class SpaceMapping:
    """A mapping file: the variation, our parameters as expressions of theirs, and the values theirs are held to."""

    distribution: Path
    parameters: tuple[tuple[str, Expression], ...]
    only: tuple[tuple[str, Value], ...]


@dataclass(frozen=True, slots=True)
class Constraint:
    """One value constraint of a parameter: compared by `rule` with a literal or an expression of other parameters."""

    parameter: str
    rule: str
    value: str

    def holds(self, values: Mapping[str, Value]) -> bool:
        """Whether it holds at values by name."""
        mine, other = values[self.parameter], _evaluated(self.value, values)
        if isinstance(mine, str) or isinstance(other, str):
            if self.rule not in ("equalTo", "notEqualTo"):
                raise must_be(f"`{self.rule}`", f"parameter `{self.parameter}`", "of numbers", f"{mine!r}, {other!r}")
            mine, other = str(mine), str(other)
        return bool(_RULES[self.rule](mine, other))


@dataclass(frozen=True, slots=True)
class Variation:
    """A parsed variation: combinations to try, defaults of what is not varied, and constraint groups by parameter.

    groups: parameter -> its groups, each a tuple of constraints.
    """

    combinations: tuple[Combination, ...]
    defaults: Mapping[str, Value]
    groups: Mapping[str, tuple[tuple[Constraint, ...], ...]]
    notes: tuple[str, ...]

    def allowed(self, combination: Combination) -> bool:
        """Whether the constraint groups of every parameter allow a combination."""
        values = {**self.defaults, **combination}
        return all(
            any(all(constraint.holds(values) for constraint in group) for group in groups)
            for name, groups in self.groups.items()
            if name in values
        )


def from_openscenario(logical: LogicalScenario, request: Request) -> Drawn:
    """The points of the variation that the mapping file `request.file` names, `request.count` draws if stochastic."""
    if request.file is None:
        raise InputError(f"`file` of the sampling of scenario `{logical.name}`, the mapping, is missing.")
    mapping = read_mapping((request.folder or Path.cwd()) / request.file, logical)
    variation = read_variation(mapping.distribution, request.count, request.seed)
    theirs = set(variation.defaults) | {name for item in variation.combinations for name in item}
    for name, expression in mapping.parameters:
        checked_names(expression, theirs, f"`{name}` of mapping {request.file}")
    for name, _ in mapping.only:
        if name not in theirs:
            raise unknown(f"parameter in [only] of mapping {request.file}:", name, theirs)
    kept = [item for item in variation.combinations if all(item[n] == v for n, v in mapping.only if n in item)]
    allowed = [item for item in kept if variation.allowed(item)]
    if not allowed:
        raise InputError(f"The constraints of {mapping.distribution.name} allow none of its {len(kept)} combinations.")
    rows = np.array([_row(mapping, {**variation.defaults, **item}) for item in allowed])
    inside = logical.in_box(rows)
    points, times = np.unique(np.round(rows[inside], 9), axis=0, return_counts=True)
    if not len(points):
        raise InputError(f"No point of {mapping.distribution.name} lies within the ranges of `{logical.name}`.")
    used = {name for _, expression in mapping.parameters for name in expression.names}
    loose = sorted({name for item in allowed for name in item} - used - {name for name, _ in mapping.only})
    notes = [*variation.notes]
    if len(kept) < len(variation.combinations):
        notes.append(f"[only] keeps {len(kept)} of {len(variation.combinations)} combinations.")
    if len(allowed) < len(kept):
        notes.append(f"Constraint groups of the OpenSCENARIO file exclude {len(kept) - len(allowed)} combinations.")
    if not inside.all():
        notes.append(f"{int(np.sum(~inside))} combinations lie outside the ranges of `{logical.name}`.")
    if loose:
        notes.append(
            f"Not mapped, so that {int(times.sum())} combinations are {len(points)} points: {', '.join(loose)}."
        )
    return Drawn(points, exposure=times.astype(np.float64), notes=tuple(notes))


def read_mapping(path: Path, logical: LogicalScenario) -> SpaceMapping:
    """A mapping file. Raises InputError where a parameter of ours is missing or not known."""
    content = read_toml(path, "mapping")
    owner = f"mapping {path}"
    for key in content:
        if key not in ("distribution", "parameters", "only"):
            raise unknown(f"key of {owner}", key, ("distribution", "parameters", "only"))
    where, formulas, only = content.get("distribution"), content.get("parameters"), content.get("only", {})
    if not isinstance(where, str) or not isinstance(formulas, dict) or not isinstance(only, dict):
        raise InputError(f"{owner.capitalize()} must have a `distribution`, the .xosc file, and a table [parameters].")
    for name in formulas:
        if name not in logical.names:
            raise unknown(f"parameter of scenario `{logical.name}` in {owner}:", name, logical.names)
    found = []
    for name in logical.names:
        if not isinstance(formulas.get(name), str | int | float):
            raise InputError(f"`{name}` of scenario `{logical.name}` is missing in [parameters] of {owner}.")
        found.append((name, number(formulas[name], owner)))
    held = tuple((name, _value(str(value))) for name, value in only.items())
    return SpaceMapping(path.parent / where, tuple(found), held)


def read_variation(path: Path, count: int | None, seed: int) -> Variation:
    """A ParameterValueDistribution file and the constraints of the scenario file that it names."""
    root = _parsed(path)
    distribution = root.find("ParameterValueDistribution")
    if distribution is None:
        raise InputError(f"{path.name} must hold a ParameterValueDistribution.")
    notes: list[str] = []
    defaults, groups = _declarations(path, distribution, notes)
    deterministic, stochastic = distribution.find("Deterministic"), distribution.find("Stochastic")
    if (deterministic is None) == (stochastic is None):
        raise InputError(f"{path.name} must be either Deterministic or Stochastic.")
    if deterministic is not None:
        if count is not None:
            raise InputError(
                f"`count` does nothing for {path.name}: its distribution is deterministic, and all combinations are "
                "driven; [only] of the mapping leaves some out."
            )
        combinations = tuple(_deterministic(deterministic, path.name))
    else:
        assert stochastic is not None
        combinations = tuple(_stochastic(stochastic, path, count, seed, notes))
    return Variation(combinations, defaults, groups, tuple(notes))


# --- the scenario file's declarations ---------------------------------------------------------------------------------


def _declarations(
    path: Path, distribution: etree._Element, notes: list[str]
) -> tuple[dict[str, Value], dict[str, tuple[tuple[Constraint, ...], ...]]]:
    named = distribution.find("ScenarioFile")
    target = None if named is None else path.parent / str(named.get("filepath", ""))
    if target is None or not target.exists():
        notes.append(f"The scenario file of {path.name} is not there: no constraint groups, no default values.")
        return {}, {}
    defaults: dict[str, Value] = {}
    groups: dict[str, tuple[tuple[Constraint, ...], ...]] = {}
    for declaration in _parsed(target).iterfind("ParameterDeclarations/ParameterDeclaration"):
        name = str(declaration.get("name"))
        defaults[name] = _value(str(declaration.get("value", "")))
        found = []
        for group in declaration.iterfind("ConstraintGroup"):
            constraints = []
            for item in group.iterfind("ValueConstraint"):
                rule = str(item.get("rule"))
                if rule not in _RULES:
                    raise unknown(f"rule of parameter `{name}` in {target.name}:", rule, _RULES)
                constraints.append(Constraint(name, rule, str(item.get("value", ""))))
            found.append(tuple(constraints))
        if found:
            groups[name] = tuple(found)
    return defaults, groups


# --- deterministic ----------------------------------------------------------------------------------------------------


def _deterministic(element: etree._Element, owner: str) -> Iterator[Combination]:
    choices: list[list[Combination]] = []
    for item in element:
        if not isinstance(item.tag, str):
            continue
        if item.tag == "DeterministicSingleParameterDistribution":
            name = str(item.get("parameterName"))
            choices.append([{name: value} for value in _single(item, name, owner)])
        elif item.tag == "DeterministicMultiParameterDistribution":
            sets = item.findall("ValueSetDistribution/ParameterValueSet")
            if not sets:
                raise InputError(f"A DeterministicMultiParameterDistribution of {owner} must have ParameterValueSets.")
            choices.append(
                [
                    {
                        str(part.get("parameterRef")): _value(str(part.get("value")))
                        for part in one.iterfind("ParameterAssignment")
                    }
                    for one in sets
                ]
            )
        else:
            raise InputError(f"`{item.tag}` of {owner} is no deterministic distribution that this program knows.")
    total = math.prod(len(choice) for choice in choices)
    if not choices or total > MAX_POINTS:
        raise must_be("The combinations", owner, f"between 1 and {MAX_POINTS:,}", total if choices else 0)
    for parts in itertools.product(*choices):
        merged: Combination = {}
        for part in parts:
            merged.update(part)
        yield merged


def _single(item: etree._Element, name: str, owner: str) -> list[Value]:
    elements, spread = item.find("DistributionSet"), item.find("DistributionRange")
    if elements is not None:
        return [_value(str(element.get("value"))) for element in elements.iterfind("Element")]
    if spread is None:
        raise InputError(f"Parameter `{name}` of {owner} must have a DistributionSet or a DistributionRange.")
    low, high = _range(spread, name, owner)
    step = Fraction(str(spread.get("stepWidth", "0")))
    if step <= 0 or (Fraction(high) - Fraction(low)) / step > MAX_POINTS:
        raise must_be("`stepWidth`", f"parameter `{name}` of {owner}", "greater than 0, and not tiny", float(step))
    first, last = Fraction(low), Fraction(high)  # exact decimals: 0.1 steps end where they should
    return [float(first + step * index) for index in range((last - first) // step + 1)]


def _range(item: etree._Element, name: str, owner: str) -> tuple[str, str]:
    limits = item.find("Range")
    if limits is None:
        raise InputError(f"Parameter `{name}` of {owner} must have a Range.")
    low, high = str(limits.get("lowerLimit")), str(limits.get("upperLimit"))
    try:
        ordered = Fraction(low) <= Fraction(high)
    except ValueError:
        ordered = False
    if not ordered:
        raise must_be("The Range", f"parameter `{name}` of {owner}", "two numbers, low to high", f"{low}..{high}")
    return low, high


# --- stochastic -------------------------------------------------------------------------------------------------------


def _stochastic(
    element: etree._Element, path: Path, count: int | None, seed: int, notes: list[str]
) -> Iterator[Combination]:
    runs = count if count is not None else int(str(element.get("numberOfTestRuns", "0")))
    if not 1 <= runs <= MAX_POINTS:
        raise must_be("`numberOfTestRuns`", path.name, f"within 1..{MAX_POINTS:,}, or give a `count`", runs)
    theirs = element.get("randomSeed")
    if theirs is not None:
        notes.append(f"The random seed {theirs} of {path.name} is not used: the evaluation's own is.")
    columns: dict[str, list[Value]] = {}
    for item in element.iterfind("StochasticDistribution"):
        name = str(item.get("parameterName"))
        columns[name] = _draws(item, name, runs, random_stream(seed, "openscenario", path.name, name))
    if not columns:
        raise InputError(f"{path.name} must have at least one StochasticDistribution.")
    for row in zip(*columns.values(), strict=True):
        yield dict(zip(columns, row, strict=True))


def _draws(item: etree._Element, name: str, runs: int, stream: np.random.Generator) -> list[Value]:
    kind = next((part for part in item if isinstance(part.tag, str)), None)
    tag = "nothing" if kind is None else str(kind.tag)
    if kind is not None and tag == "ProbabilityDistributionSet":
        elements = kind.findall("Element")
        weights = np.array([float(str(element.get("weight", "1"))) for element in elements])
        picks = stream.choice(len(elements), runs, p=weights / weights.sum())
        return [_value(str(elements[pick].get("value"))) for pick in picks]
    if kind is not None and tag == "Histogram":
        bins = kind.findall("Bin")
        weights = np.array([float(str(part.get("weight"))) for part in bins])
        limits = np.array([[float(end) for end in _range(part, name, tag)] for part in bins])
        picks = stream.choice(len(bins), runs, p=weights / weights.sum())
        return list((limits[picks, 0] + stream.uniform(size=runs) * np.ptp(limits[picks], axis=1)).tolist())
    if kind is not None and tag == "UniformDistribution":
        low, high = (float(end) for end in _range(kind, name, tag))
        return list(stream.uniform(low, high, runs).tolist())
    if kind is not None and tag in ("NormalDistribution", "LogNormalDistribution", "PoissonDistribution"):
        low, high = (
            (-math.inf, math.inf) if kind.find("Range") is None else (float(end) for end in _range(kind, name, tag))
        )
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
        raise must_be("The Range", f"parameter `{name}`", f"one in which the {tag} has values", f"{low}..{high}")
    raise InputError(f"Parameter `{name}` has the distribution `{tag}`, which this program does not know.")


# --- values -----------------------------------------------------------------------------------------------------------


def _row(mapping: SpaceMapping, values: Mapping[str, Value]) -> list[float]:
    numbers = {name: value for name, value in values.items() if not isinstance(value, str)}
    row = []
    for name, expression in mapping.parameters:
        for needed in expression.names:
            if needed not in numbers:
                raise must_be(f"`{needed}`", f"the mapping of `{name}`", "a number", values[needed])
        row.append(float(expression.value(numbers)))
    return row


def _evaluated(text: str, values: Mapping[str, Value]) -> Value:
    """A literal, `$name`, or `${expression of $names}`."""
    text = text.strip()
    if not text.startswith("$"):
        return _value(text)
    inner = text[2:-1] if text.startswith("${") and text.endswith("}") else text
    bare = _REFERENCE.sub(r"\1", inner)
    if bare in values:
        return values[bare]
    numbers: dict[str, Any] = {name: value for name, value in values.items() if not isinstance(value, str)}
    return float(Expression(bare).value(numbers))


def _value(text: str) -> Value:
    try:
        return float(text)
    except ValueError:
        return text


def _parsed(path: Path) -> etree._Element:
    content = read_input(path, "OpenSCENARIO file")
    try:
        return etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError as error:
        raise InputError(f"OpenSCENARIO file {path} is not XML: {error}.") from error
