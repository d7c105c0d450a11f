"""Requirements of a scenario: conditions on the whole drive, such as `min(gap) > 2 and
max(abs(offset)) <= 0.15`.

The tables `[[require]]` of scenario files become requirements here; `scoring.requirements`
evaluates them in recorded drives.

A value over time is `min`, `max` or `at_end` of an expression, over all moments of the drive. That
expression may combine the quantities of a moment (`SERIES`, `OF_ACTORS`) with parameters and
definitions. The rest is the language of scenario files (`scenario.expression`).

Users: `scenario/file_tables.py`, `scenario/logical.py`.
"""

import ast
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.frozen import frozen
from sumo_eval.scenario.expression import (
    Definitions,
    Expression,
    condition,
    parsed,
)
from sumo_eval.trajectory import FloatArray

SERIES = {
    "time": "since the start, s",
    "x": "centre along the road, m",
    "offset": "centre across the road from where the ego started, to the left, m",
    "speed": "along its heading, m/s",
    "acceleration": "along the heading, m/s2",
    "jerk": "rate of the acceleration from sample to sample, m/s3",
    "lateral_speed": "across the road, m/s",
    "gap": "bumper to bumper to the nearest one ahead in the ego's path, m; inf without one",
    "thw": "gap over the ego's speed, s; inf without one ahead",
    "ttc": "gap over the closing speed, s; inf where the gap does not close",
}
"""Quantities of each moment that a requirement may use."""
OUTCOMES = {
    "collided": "1 if the ego touched an actor, else 0",
    "reached_end": "1 if it came to the end of the scenario's road, else 0",
}
"""Quantities of the whole drive that a requirement may use."""
OF_ACTORS = ("x", "y", "speed", "lateral_speed")
"""Quantities of an actor at each moment that a requirement may use, as `x(lead)`: x, m, and speed,
m/s, along the road; y, m, to the left of the right lane's centre line; lateral_speed, m/s, to the
left."""
_OVER_TIME: dict[str, Callable[[FloatArray], Any]] = {
    "min": np.min,
    "max": np.max,
    "at_end": lambda values: values[-1],
}


class RequirementOutcome(NamedTuple):
    """Outcome of a requirement in a drive.

    undecided: moment at which a value of it is not a number (nan), as `inf - inf`, s; for a value
        of the whole drive, its end. Then it does not hold. None: it is decided.
    """

    holds: bool
    undecided: float | None = None


@frozen
class Requirement:
    """A checked requirement.

    text: as written, e.g. `min(x(lead) - x) > 2`.
    about: what it means, in the user's words.
    outer: its condition, with a placeholder for each value over time: `over_time_0 > 2`.
    parts: of each value over time the placeholder, the function of `_OVER_TIME`, and the argument:
        (`over_time_0`, `min`, `x_of_lead - x`).
    asks: quantities of actors that these arguments ask for: of each the placeholder, the name in
        `OF_ACTORS`, and the actor: (`x_of_lead`, `x`, `lead`).
    """

    name: str
    text: str
    about: str
    outer: Expression
    parts: tuple[tuple[str, str, Expression], ...]
    asks: tuple[tuple[str, str, str], ...]

    @property
    def expressions(self) -> tuple[Expression, ...]:
        """The expressions whose names the requirement depends on."""
        return (self.outer, *(inner for _, _, inner in self.parts))

    def check(
        self, series: Mapping[str, FloatArray], known: Mapping[str, float]
    ) -> RequirementOutcome:
        """Check it in a drive of n moments.

        series: by the names in `SERIES` and the placeholders of `asks`, (n,) each.
        known: parameters, options, definitions and `OUTCOMES`, by name.
        """
        numbers, time = dict(known), series["time"]
        moment: dict[str, Any] = {**known, **series}
        for placeholder, function, inner in self.parts:
            values = np.broadcast_to(inner.value(moment), time.shape)
            numbers[placeholder] = float(_OVER_TIME[function](values))
            # a comparison with nan would be False silently
            sides = [side.value(moment) for side in inner.sides]
            unclear = time[np.isnan(np.broadcast_arrays(values, *sides)).any(axis=0)]
            if function == "at_end":
                unclear = unclear[unclear == time[-1]]
            if unclear.size:
                return RequirementOutcome(False, float(unclear[0]))
        # `inf - inf` between values over time
        if any(math.isnan(side.at(numbers)) for side in self.outer.sides):
            return RequirementOutcome(holds=False, undecided=float(time[-1]))
        return RequirementOutcome(bool(self.outer.at(numbers)))


@frozen
class Requirements:
    """All requirements of a scenario.

    numbers: the definitions and options of the file, which the requirements may use.
    """

    all: tuple[Requirement, ...]
    numbers: Definitions


def requirement(
    name: str,
    text: str,
    about: str,
    owner: str,
    known: Collection[str],
    vehicles: Sequence[str] = (),
) -> Requirement:
    """Read a requirement.

    name: in tables; text: its condition; about: what it means, in the user's words.
    owner: the scenario, for messages.
    known: names of parameters, options and definitions.
    vehicles: names of the actors.

    Raises InputError unless the text is a condition on a drive.
    """
    # a cell of cases.csv lists missed requirements, with `;` between their names
    if not name or ";" in name:
        raise must_be("The name", f"a requirement of {owner}", "a text without `;`", name)
    for reserved in (*SERIES, *OUTCOMES, *_OVER_TIME):
        if reserved in known:
            raise InputError(
                f"`{reserved}` of {owner} must have another name: in a requirement it is a "
                "value of the drive."
            )
    tree = parsed(text, f"Requirement `{text[:200]}` of {owner}")
    replaced = _Parts(text, owner, vehicles, known)
    outer = condition(ast.unparse(replaced.visit(tree)), owner, text)
    checked = Requirement(name, text, about, outer, tuple(replaced.parts), tuple(replaced.asks))
    _check_names(checked, owner, [*known, *OUTCOMES], vehicles)
    return checked


def _check_names(
    item: Requirement, owner: str, names: Sequence[str], vehicles: Sequence[str]
) -> None:
    """Refuse unknown names, and quantities of a moment in the wrong place.

    names: those that all expressions of the requirement may use.
    vehicles: names of the actors.
    """
    place = f"requirement `{item.name}` of {owner}"
    # quantities of each moment, as a user writes them: `gap`, `x(lead)`
    moments = [*SERIES, *(f"{name}({vehicle})" for vehicle in vehicles for name in OF_ACTORS)]
    of_actors = {placeholder for placeholder, _, _ in item.asks}
    for _, _, inner in item.parts:
        check_known(f"name in {place}:", [*names, *moments], *sorted(inner.names - of_actors))
        if not inner.names & {*SERIES, *of_actors}:
            raise must_be(f"`{inner.text}`", place, f"of {', '.join(moments)}", item.text)
    over_time = {placeholder for placeholder, _, _ in item.parts}
    for word in sorted(item.outer.names - over_time):
        if word in SERIES:
            raise must_be(f"`{word}`", place, "within min(), max() or at_end()", item.text)
        check_known(f"name in {place}:", [*names, *moments], word)


@dataclass
class _Parts(ast.NodeTransformer):
    """A visitor of a syntax tree that replaces values over time by placeholders, and within their
    arguments also quantities of actors.

    text, owner, vehicles, known: as in `requirement`.
    parts, asks: what the placeholders stand for, as in `Requirement`; filled by the visit.
    within: whether the visited node is within the argument of a value over time.
    """

    text: str
    owner: str
    vehicles: Sequence[str]
    known: Collection[str]
    parts: list[tuple[str, str, Expression]] = field(default_factory=list)
    asks: list[tuple[str, str, str]] = field(default_factory=list)
    within: bool = False

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """The placeholder of a call, or the call itself; `ast` calls this by its name."""
        match node:
            case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]) if (
                function in _OVER_TIME and not self.within
            ):
                placeholder = self._new_name(f"over_time_{len(self.parts)}")
                self.within = True
                inner = ast.unparse(self.visit(argument))
                self.within = False
                self.parts.append((placeholder, function, Expression(inner)))
                return ast.Name(placeholder, ast.Load())
            case ast.Call(func=ast.Name(id=function), args=[ast.Name(id=vehicle)], keywords=[]) if (
                function in OF_ACTORS
            ):
                place = f"requirement `{self.text}` of {self.owner}"
                check_known(f"vehicle in {place}:", self.vehicles, vehicle)
                if not self.within:
                    wanted = "within min(), max() or at_end()"
                    raise must_be(f"`{function}({vehicle})`", place, wanted, self.text)
                ask = self._new_name(f"{function}_of_{vehicle}"), function, vehicle
                if ask not in self.asks:
                    self.asks.append(ask)
                return ast.Name(ask[0], ast.Load())
        # any other call is a function of the language, and stays
        return self.generic_visit(node)

    def _new_name(self, name: str) -> str:
        """The name of a placeholder, made longer where a parameter has it."""
        while name in self.known:
            name += "_"
        return name
