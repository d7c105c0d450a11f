"""Conditions on what happens: `ttc(ego, child) < 2 and y(child) > 1`, made into steps that a kernel
can do.

Numbers of the point (parameters, definitions, options) may stand in one beside numbers of the
moment: `time`, s since the start, `departed`, m between the ego and where the recorded one was at
the time, and the functions below. What it says in plain numbers is worked out once for a case.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

from sumo_eval.errors import InputError, check_known, must_be, unknown
from sumo_eval.scenario import played
from sumo_eval.scenario.expression import UNREADABLE, Expression, checked_names, number
from sumo_eval.scenario.formulas import Names

OF_ONE = {"x": played.X, "y": played.Y, "speed": played.ALONG, "lateral_speed": played.ACROSS}
OF_TWO = {"gap": played.GAP, "distance": played.DISTANCE, "ttc": played.TTC, "thw": played.THW}
FUNCTIONS = {
    "x": "x(a): its centre along the road, m",
    "y": "y(a): its centre across the road, m",
    "speed": "speed(a): along the road, m/s",
    "lateral_speed": "lateral_speed(a): across the road, m/s, to the left",
    "gap": "gap(a, b): along the road from a's front to b's rear, m; negative once a is beside or "
    "past b",
    "distance": "distance(a, b): between the centres, m",
    "ttc": "ttc(a, b): gap over closing speed, s; inf where they do not close",
    "thw": "thw(a, b): gap over a's speed, s; inf behind b",
    "ended": "ended(a, m): whether a's manoeuvre of the name m is over",
}
"""Functions of vehicles that a condition may use, `ego` among them."""
_ARITHMETIC: dict[type[ast.operator], int] = {
    ast.Add: played.ADD, ast.Sub: played.SUBTRACT, ast.Mult: played.MULTIPLY,
    ast.Div: played.DIVIDE,
}  # fmt: skip
OF_NUMBERS = {"min": played.SMALLER, "max": played.LARGER}
EGO_NAME = "ego"

Step = tuple[int, int, int, Expression | None]


@dataclass(frozen=True, slots=True)
class Trigger:
    """A checked condition: what a kernel does for it, with the expressions of the numbers that a
    point decides.
    """

    text: str
    steps: tuple[Step, ...]

    def at(self, known: Mapping[str, float]) -> tuple[tuple[int, int, int, float], ...]:
        """Its steps at a point."""
        return tuple(
            (op, one, two, 0.0 if value is None else float(value.at(known)))
            for op, one, two, value in self.steps
        )


def trigger(text: str, owner: str, names: Names, *, departs: bool) -> Trigger:
    """The condition in a text.

    departs: whether it may ask how far the ego is from a recorded one.
    Raises InputError naming what is wrong, and the nearest word.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except UNREADABLE:
        raise InputError(f"Condition `{text[:200]}` of {owner} cannot be read.") from None
    steps = _Writer(text, owner, names, departs).condition(tree)
    if len(steps) > 4 * played.DEEPEST:
        raise InputError(f"Condition `{text[:200]}` of {owner} is too long.")
    return Trigger(text, tuple(steps))


@dataclass(frozen=True, slots=True)
class _Writer:
    text: str
    owner: str
    names: Names
    departs: bool

    def condition(self, node: ast.expr, depth: int = 0) -> list[Step]:
        """Steps that leave on the stack whether it holds."""
        self._shallow(depth)
        match node:
            case ast.BoolOp(op=op, values=values):
                steps = self.condition(values[0], depth + 1)
                for value in values[1:]:
                    steps += [
                        *self.condition(value, depth + 1),
                        _step(played.AND if isinstance(op, ast.And) else played.OR),
                    ]
                return steps
            case ast.Compare(left=left, ops=ops, comparators=others):
                sides = [left, *others]
                found: list[Step] = []
                for number_of, compared in enumerate(ops):
                    a, b = (
                        self.number(sides[number_of], depth + 1),
                        self.number(sides[number_of + 1], depth + 1),
                    )
                    if isinstance(compared, ast.Gt | ast.GtE):
                        a, b = b, a
                    elif not isinstance(compared, ast.Lt | ast.LtE):
                        raise self._wrong(node, "compared with <, <=, > or >=")
                    strict = isinstance(compared, ast.Lt | ast.Gt)
                    found += [*a, *b, _step(played.BELOW if strict else played.AT_MOST)]
                    if number_of:
                        found.append(_step(played.AND))
                return found
            case ast.Call(
                func=ast.Name(id="ended"),
                args=[ast.Name(id=vehicle), ast.Name(id=move)],
                keywords=[],
            ):
                one = self._vehicle(vehicle)
                if one == played.EGO:
                    raise self._wrong(node, "of a vehicle with manoeuvres: the ego has none")
                named = self.names.vehicles[vehicle]
                check_known(
                    f"manoeuvre of vehicle `{vehicle}` in `{self.text}` of {self.owner}:",
                    named,
                    move,
                )
                return [(played.ENDED, one, named[move], None)]
        raise self._wrong(node, "a condition such as `ttc(ego, child) < 2`")

    def number(self, node: ast.expr, depth: int) -> list[Step]:
        """Steps that leave a number on the stack."""
        self._shallow(depth)
        if not self._of_the_moment(node):
            text = ast.unparse(node)
            owner = f"`{self.text}` of {self.owner}"
            self.names.scene.append(
                checked_names(number(text, owner), [*self.names.known, "time"], owner)
            )
            return [(played.VALUE, 0, 0, self.names.scene[-1])]
        match node:
            case ast.Name(id="time"):
                return [_step(played.TIME)]
            case ast.Name(id="departed"):
                if not self.departs:
                    raise InputError(
                        f"`departed` in the condition `{self.text[:200]}` of {self.owner} may "
                        "stand in one of a "
                        "`follow` alone, where [ego] has `recorded` places."
                    )
                return [_step(played.DEPARTED)]
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return [*self.number(operand, depth + 1), _step(played.NEGATE)]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return [
                    *self.number(left, depth + 1), *self.number(right, depth + 1),
                    _step(_ARITHMETIC[type(op)]),
                ]  # fmt: skip
            case ast.Call(func=ast.Name(id="abs"), args=[one], keywords=[]):
                return [*self.number(one, depth + 1), _step(played.ABSOLUTE)]
            case ast.Call(func=ast.Name(id="min" | "max" as name), args=[one, two], keywords=[]):
                return [
                    *self.number(one, depth + 1),
                    *self.number(two, depth + 1),
                    _step(OF_NUMBERS[name]),
                ]
            case ast.Call(func=ast.Name(id=name), args=[ast.Name(id=one)], keywords=[]) if (
                name in OF_ONE
            ):
                return [(OF_ONE[name], self._vehicle(one), 0, None)]
            case ast.Call(
                func=ast.Name(id=name), args=[ast.Name(id=one), ast.Name(id=two)], keywords=[]
            ) if name in OF_TWO:
                if one == two:
                    raise self._wrong(node, "of two vehicles")
                return [(OF_TWO[name], self._vehicle(one), self._vehicle(two), None)]
            case ast.Call(func=ast.Name(id=name)) if name not in FUNCTIONS and name not in (
                *OF_NUMBERS,
                "abs",
            ):
                raise unknown(
                    f"function in `{self.text}` of {self.owner}:",
                    name,
                    [*FUNCTIONS, *OF_NUMBERS, "abs"],
                )
            case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS:
                raise self._wrong(node, f"as in {FUNCTIONS[name]}")
        raise self._wrong(
            node, "of numbers, names, + - * /, min, max, abs, `time` and " + ", ".join(FUNCTIONS)
        )

    def _of_the_moment(self, node: ast.expr) -> bool:
        for part in ast.walk(node):
            if (
                isinstance(part, ast.Name)
                and part.id in ("time", "departed")
                and part.id not in self.names.known
            ):
                return True
            if isinstance(part, ast.Call) and not (
                isinstance(part.func, ast.Name)
                and part.func.id in ("min", "max", "abs", "sqrt", "exp", "log", "tanh")
            ):
                return True
        return False

    def _vehicle(self, name: str) -> int:
        if name == EGO_NAME:
            return played.EGO
        if name not in self.names.vehicles:
            raise unknown(
                f"vehicle in `{self.text}` of {self.owner}:", name, [EGO_NAME, *self.names.vehicles]
            )
        return list(self.names.vehicles).index(name)

    def _shallow(self, depth: int) -> None:
        if depth >= played.DEEPEST - 2:
            raise InputError(f"Condition `{self.text[:200]}` of {self.owner} is nested too deep.")

    def _wrong(self, node: ast.expr, wanted: str) -> InputError:
        return must_be(
            f"`{ast.unparse(node)}` in the condition", self.owner, wanted, self.text[:200]
        )


def _step(op: int) -> Step:
    return op, 0, 0, None
