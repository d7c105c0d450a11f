"""Conditions on what happens: `ttc(ego, child) < 2 and y(child) > 1`, made into steps that a kernel
can do.

Numbers of the point (parameters, definitions, options) may stand in one beside numbers of the
moment: `time`, s since the start, `departed`, m between the ego and where the recorded one was at
the time, and the functions below. What it says in plain numbers is worked out once for a case.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Mapping
from dataclasses import dataclass

from sumo_eval.errors import InputError, check_known, must_be, unknown
from sumo_eval.scenario import played
from sumo_eval.scenario.expression import Expression, checked_names, number, parsed
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
_OF_ARGUMENTS = {("abs", 1): played.ABSOLUTE} | {(key, 2): op for key, op in OF_NUMBERS.items()}
_NUMBERS = "of numbers, names, + - * /, min, max, abs, `time` and " + ", ".join(FUNCTIONS)
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
    tree = parsed(text, f"Condition `{text[:200]}` of {owner}")
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
                sides = [self.number(side, depth + 1) for side in (left, *others)]
                found: list[Step] = []
                for compared, *pair in zip(ops, sides, sides[1:], strict=False):
                    if not isinstance(compared, ast.Lt | ast.LtE | ast.Gt | ast.GtE):
                        raise self._wrong(node, "compared with <, <=, > or >=")
                    smaller, larger = pair if isinstance(compared, ast.Lt | ast.LtE) else pair[::-1]
                    strict = isinstance(compared, ast.Lt | ast.Gt)
                    joins = [_step(played.AND)] if found else []
                    found += smaller + larger
                    found += [_step(played.BELOW if strict else played.AT_MOST), *joins]
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
                    f"manoeuvre of vehicle `{vehicle}` in {self._place}:",
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
            known = [*self.names.known, "time"]
            self.names.scene.append(checked_names(number(text, self._place), known, self._place))
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
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._call(node, name, args, depth)
        raise self._wrong(node, _NUMBERS)

    def _call(self, node: ast.expr, name: str, args: list[ast.expr], depth: int) -> list[Step]:
        """Steps of a function's value."""
        vehicles = [arg.id for arg in args if isinstance(arg, ast.Name)]
        if (name, len(args)) in _OF_ARGUMENTS:
            values = itertools.chain.from_iterable(self.number(arg, depth + 1) for arg in args)
            return [*values, _step(_OF_ARGUMENTS[name, len(args)])]
        if name in OF_ONE and len(vehicles) == len(args) == 1:
            return [(OF_ONE[name], self._vehicle(vehicles[0]), 0, None)]
        if name in OF_TWO and len(vehicles) == len(args) == 2:
            one, two = vehicles
            if one == two:
                raise self._wrong(node, "of two vehicles")
            return [(OF_TWO[name], self._vehicle(one), self._vehicle(two), None)]
        check_known(f"function in {self._place}:", [*FUNCTIONS, *OF_NUMBERS, "abs"], name)
        raise self._wrong(node, f"as in {FUNCTIONS[name]}" if name in FUNCTIONS else _NUMBERS)

    @property
    def _place(self) -> str:
        """How errors call the condition."""
        return f"`{self.text}` of {self.owner}"

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
            raise unknown(f"vehicle in {self._place}:", name, [EGO_NAME, *self.names.vehicles])
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
