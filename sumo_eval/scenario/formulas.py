"""Formulas of a scenario file: read, checked against the names that are known, evaluated at points.

The tables of a scenario file make these objects. They are plain data: two readings of one file are
equal, and workers can receive them. A formula is an `Expression` (`scenario/expression.py`, which
lists the functions that it may call) with what it needs to be evaluated: definitions, limits, a
place in the file for messages.

Users: `extras/openscenario/logical.py`, `extras/rates/exposure.py`, `scenario/file_tables.py`,
`scenario/streams.py`, `scenario/trigger.py`, `scenario/vehicle_tables.py`,
`scenario/zone_table.py`. Fixed: values, what is refused, words of messages.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from dataclasses import field
from math import inf, isfinite
from typing import Annotated, Any, get_args

import numpy as np

from sumo_eval.errors import InputError, doubled, must_be
from sumo_eval.frozen import frozen
from sumo_eval.scenario.expression import Definitions, Expression, checked_names, number
from sumo_eval.scenario.joint import Joint, of_values
from sumo_eval.scenario.logical import Constraint, Parameter, Values
from sumo_eval.scenario.units import refuse_unit
from sumo_eval.settings.checked import hints_of
from sumo_eval.text import point_words
from sumo_eval.trajectory import FloatArray

Formula = str | float
"""In a file: a number, or an expression of the parameters, options and definitions."""


@frozen
class Limits:
    """Limits of a formula's values; the annotation of a table's key may hold them.

    at_least: lower limit, included.
    above: lower limit, excluded; None: no such limit.
    endless: whether a value may be infinite. nan is never allowed.
    """

    at_least: float = -inf
    above: float | None = None
    endless: bool = False


ANY, NOT_BELOW_0, ABOVE_0 = Limits(), Limits(at_least=0.0), Limits(above=0.0)
NOT_NAN = Limits(endless=True)
PositiveFormula = Annotated[Formula, ABOVE_0]
PositiveFormulaOrNone = Annotated[Formula | None, ABOVE_0]


@frozen
class Formulas:
    """Expressions of a zone rule or of a constraint, to be evaluated together, with the definitions
    that they need.
    """

    definitions: Definitions
    expressions: tuple[Expression, ...]

    @classmethod
    def of(cls, definitions: Definitions, *expressions: Expression) -> Formulas:
        """Formulas of these expressions."""
        return cls(definitions.needed_by(*expressions), expressions)

    def __call__(self, values: Values) -> tuple[FloatArray, ...]:
        """The value of each expression, an array of the values' common shape.

        Raises InputError for nan.
        """
        extended = self.definitions.extend(values)
        shape = np.broadcast_shapes(*map(np.shape, values.values()))
        results = []
        for expression in self.expressions:
            results.append(np.broadcast_to(expression.value(extended), shape))
            if np.isnan(results[-1]).any():
                # This is a zone rule, as conditions are true or false. A nan is refused also where
                # a constraint does not hold, because the zones are learnt there, too.
                wanted = "a number at every point of the ranges"
                raise must_be(f"`{expression.text}`", "the zone rule", wanted, np.nan)
        return tuple(results)


@frozen
class FormulaValue:
    """A function that gives one number at every point, or whether a condition holds there.

    formulas: of one expression.
    """

    formulas: Formulas

    def __call__(self, values: Values) -> Any:
        """An array of the values' common shape."""
        return self.formulas(values)[0]

    def room(self, values: Values) -> FloatArray:
        """Distance of a condition from its limit, below 0 where it does not hold."""
        extended = self.formulas.definitions.extend(values)
        return np.asarray(self.formulas.expressions[0].room(extended), float)


@frozen
class ExposureDensity:
    """Exposure of points as a density: that of `joint`, or else the product of the parameters'
    distributions within their ranges; times an expression.

    expression: a factor; None: 1.
    joint: then no parameter has a distribution of its own.
    constraints: where one of them does not hold, the expression may be undefined, and the density
        is then 0.
    """

    parameters: tuple[Parameter, ...]
    expression: Expression | None
    definitions: Definitions
    joint: Joint | None = None
    constraints: tuple[Constraint, ...] = ()

    def __call__(self, values: Values) -> FloatArray:
        """The density, up to a factor."""
        shape = np.broadcast_shapes(*map(np.shape, values.values()))
        density: FloatArray = (
            np.ones(shape) if self.joint is None else of_values(self.joint, values)
        )
        for item in self.parameters:
            if item.distribution is not None:
                density = density * item.distribution.density(
                    values[item.name], item.low, item.high
                )
        if self.expression is None:
            return density
        return density * self._factor(self.expression, values)

    def _factor(self, expression: Expression, values: Values) -> FloatArray:
        """The value of the expression, 0 where it is undefined: not finite, or below 0.

        Raises InputError if it is undefined where all constraints hold.
        """
        factor = expression.value(self.definitions.extend(values))
        undefined = ~(np.isfinite(factor) & (factor >= 0.0))
        wrong = undefined  # after the loop: undefined where all constraints hold
        for constraint in self.constraints:
            wrong = wrong & constraint.holds(values)
        if wrong.any():
            first = np.broadcast_to(factor, wrong.shape)[wrong].item(0)
            raise must_be(f"`{expression.text}`", "the exposure", "finite and at least 0", first)
        return np.where(undefined, 0.0, factor)


@frozen
class LimitedFormula:
    """A formula that gives one number of a concrete scenario.

    what, owner: name of the number, and of the scenario or sample, in error messages.
    """

    what: str
    owner: str
    expression: Expression
    limits: Limits = ANY

    def at(self, values: Mapping[str, float]) -> float:
        """Its value at a point.

        values: of parameters and definitions there, by name.
        Raises InputError for nan, for inf unless it may be endless, and for a value outside its
        limits.
        """
        value: float = self.expression.at(values)
        least, above, endless = self.limits.at_least, self.limits.above, self.limits.endless
        # no comparison holds for nan
        if least <= value and (above is None or above < value) and (endless or isfinite(value)):
            return value
        wanted = "a number" if endless else "finite"
        wanted += f" and at least {least:g}" if least > -inf else ""
        wanted += f" and above {above:g}" if above is not None else ""
        what = f"{self.what} = `{self.expression.text}`"
        raise must_be(what, self.owner, wanted, f"{value:g} at {point_words(values)}")


@frozen
class LimitedFormulas:
    """The formulas of a table.

    by_key: (key of the table, formula).
    """

    by_key: tuple[tuple[str, LimitedFormula], ...]

    def at(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Their values at a point, by key; `values` as in `LimitedFormula.at`."""
        return {key: formula.at(values) for key, formula in self.by_key}

    def __getitem__(self, key: str) -> Expression:
        return dict(self.by_key)[key].expression


@frozen
class Names:
    """The names that formulas and conditions of a file may use.

    where, owner: names of the file and of the scenario in error messages.
    known: names of parameters, options and definitions.
    vehicles: name of an actor -> name of a manoeuvre -> index of the act.
    has_recorded_ego: whether the ego has recorded positions. Then the `when` of a `follow` may use
        `departed`.
    definitions: whose names are in `known`.
    scene: expressions that the scene depends on: `quantity` appends its own, and
        `scenario/trigger.py` those of conditions.
    """

    where: str
    owner: str
    known: list[str]
    vehicles: Mapping[str, Mapping[str, int]]
    has_recorded_ego: bool
    definitions: Definitions = Definitions(())
    scene: list[Expression] = field(default_factory=list)

    def expression(self, formula: Formula, what: str) -> Expression:
        """The expression of a number.

        what: place of the formula in the file.
        Raises InputError for a name that is not known.
        """
        owner = f"{what} of {self.where}"
        refuse_unit(formula, owner)
        return checked_names(number(formula, owner), self.known, owner)

    def quantity(self, formula: Formula, what: str, limits: Limits = ANY) -> LimitedFormula:
        """The formula of a number of each concrete scenario; adds its expression to `scene`."""
        self.scene.append(self.expression(formula, what))
        return LimitedFormula(what, self.owner, self.scene[-1], limits)

    def quantities(self, table: Any, what: str, **others: Limits) -> LimitedFormulas:
        """The formulas that a table has.

        what: name of the table in error messages.
        others: limits of keys, instead of those in their annotations.
        """
        # the cache hashes the class; mypy does not know that a class can be hashed
        keys = _formula_keys(type(table))  # type: ignore[arg-type]
        return LimitedFormulas(
            tuple(
                (key, self.quantity(value, f"{key} of {what}", others.get(key, limits)))
                for key, limits in keys
                if (value := getattr(table, key)) is not None
            )
        )

    def distinct(self, names: Iterable[str], kind: str, owner: str = "") -> list[str]:
        """The names as a list; raises InputError if one occurs twice.

        kind: of what they are names. owner: part of the file that holds them; default: the file.
        """
        listed = list(names)
        if double := doubled(listed):
            raise InputError(
                f"Every {kind} of {owner or self.where} must have a name of its own, "
                f"got `{double[0]}` twice."
            )
        return listed


@functools.cache
def _formula_keys(cls: Any) -> list[tuple[str, Limits]]:
    """The keys of a table's class that are formulas, with their limits."""
    keys = []
    for key, hint in hints_of(cls).items():
        # `Annotated[base, *marks]`, or `base` alone
        base, *marks = get_args(hint) if hasattr(hint, "__metadata__") else [hint]
        # a formula is `str | float`, or `str | float | None`
        if {str, float} <= set(get_args(base)):
            keys.append((key, next((mark for mark in marks if isinstance(mark, Limits)), ANY)))
    return keys
