"""A small language of arithmetic and comparisons for scenario files: `3.5 * ego_speed`, `lead_speed
< ego_speed`.

Python's parser reads the text, and only the node types listed here are understood: numbers, names,
+ - * / **, comparisons (chains too), and, or, not, and the functions below. There are no
attributes, no subscripts, no calls of anything else and no `eval`. One expression serves a whole
space, on numpy arrays, and one point, on plain floats.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, check_known, must_be, unknown
from sumo_eval.text import clean, shown

LONGEST = 1_000  # characters of an expression
DEEPEST = 50  # brackets within brackets
UNREADABLE = (SyntaxError, ValueError, RecursionError, MemoryError)
"""Exceptions of Python's parser for invalid text."""


def _quiet(function: Callable[..., Any]) -> Callable[..., float]:
    """A function of numpy's on plain floats: what is not defined is nan or inf, without a
    warning.
    """

    def of_floats(*values: float) -> float:
        with np.errstate(all="ignore"):
            return float(function(*values))

    return of_floats


_divide_quietly = _quiet(np.divide)


def _divide(a: float, b: float) -> float:
    return a / b if b else _divide_quietly(a, b)


def _smaller(a: float, b: float) -> float:
    return a if a < b or math.isnan(a) else b


def _larger(a: float, b: float) -> float:
    return a if a > b or math.isnan(a) else b


def _for_arrays(function: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda *values: reduce(function, values)


_Pair = tuple[Callable[..., Any], Callable[..., Any]]
"""How an operation is done on arrays, and on plain floats; the same bits come out."""

_ARITHMETIC: dict[type[ast.operator], _Pair] = {
    ast.Add: (operator.add, operator.add), ast.Sub: (operator.sub, operator.sub),
    ast.Mult: (operator.mul, operator.mul), ast.Div: (np.divide, _divide),
    ast.Pow: (np.power, _quiet(np.power)),
}  # fmt: skip
_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip
_FUNCTIONS: dict[str, tuple[_Pair, int | None]] = {
    "min": ((_for_arrays(np.minimum), _for_arrays(_smaller)), None),
    "max": ((_for_arrays(np.maximum), _for_arrays(_larger)), None),
    "abs": ((np.abs, abs), 1),
    "sqrt": ((np.sqrt, _quiet(np.sqrt)), 1),
    "exp": ((np.exp, _quiet(np.exp)), 1),
    "log": ((np.log, _quiet(np.log)), 1),
    "tanh": ((np.tanh, _quiet(np.tanh)), 1),
    "where": ((np.where, lambda holds, then, other: then if holds else other), 3),
}
"""Functions by name and how many values they take (None: two or more).

`where(condition, then, else)`.
"""
_ARRAYS, _FLOATS = 0, 1
_NOT: _Pair = (np.logical_not, operator.not_)
_AND: _Pair = (np.logical_and, lambda a, b: a and b)
_OR: _Pair = (np.logical_or, lambda a, b: a or b)


@dataclass(frozen=True, slots=True)
class Expression:
    """A checked expression.

    Two of the same text are equal, and one can be sent to another process.
    """

    text: str

    def __post_init__(self) -> None:
        _tree(self.text)

    @property
    def names(self) -> frozenset[str]:
        """The names it needs a value for."""
        return frozenset(
            node.id
            for node in ast.walk(_tree(self.text))
            if isinstance(node, ast.Name) and node.id not in _FUNCTIONS
        )

    @property
    def is_condition(self) -> bool:
        """Whether it says true or false rather than a number."""
        return _is_condition(_tree(self.text))

    def value(self, values: Mapping[str, ArrayLike]) -> Any:
        """The value at the given values by name, which broadcast.

        Where it is not defined (1 / 0) it is inf or nan.
        """
        with np.errstate(all="ignore"):
            return np.asarray(self._worked_out(values, _ARRAYS))

    def room(self, values: Mapping[str, ArrayLike]) -> Any:
        """How far a condition is from its limit, in the unit of what it compares: below 0 where it
        does not hold.
        """
        with np.errstate(all="ignore"):
            return np.asarray(_compiled_room(self.text)(values))

    def at(self, values: Mapping[str, float]) -> Any:
        """The value at one point, given as plain floats: the number (or truth) that `value` has
        there, faster.
        """
        return self._worked_out(values, _FLOATS)

    def _worked_out(self, values: Mapping[str, Any], kind: int) -> Any:
        try:
            return _compiled(self.text, kind)(values)
        except KeyError as error:
            raise unknown(
                f"name in expression `{self.text}`:", str(error.args[0]), sorted(values)
            ) from None


@dataclass(frozen=True, slots=True)
class Definitions:
    """Names for expressions, worked out in order.

    options: names of plain numbers.
    """

    entries: tuple[tuple[str, Expression], ...]
    options: tuple[tuple[str, float], ...] = ()

    def needed_by(self, *expressions: Expression) -> Definitions:
        """Those without which the expressions have no value."""
        names = set().union(*(expression.names for expression in expressions))
        entries = []
        for name, expression in reversed(self.entries):
            if name in names:
                entries.append((name, expression))
                names |= expression.names
        options = tuple((name, value) for name, value in self.options if name in names)
        return Definitions(tuple(reversed(entries)), options)

    def extend(self, values: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
        """The values and the definitions at them."""
        known = {**values, **dict(self.options)}
        for name, expression in self.entries:
            known[name] = expression.value(known)
        return known

    def at(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values and the definitions at one point, plain floats."""
        known = dict(values)
        known.update(self.options)
        for name, expression in self.entries:
            known[name] = expression.at(known)
        return known


def checked_names(expression: Expression, known: Iterable[str], owner: str) -> Expression:
    """The expression, if all its names are known; else an InputError with the nearest one."""
    names = list(known)
    check_known(f"name in `{expression.text}` of {owner}:", names, *sorted(expression.names))
    return expression


def number(text: str | float, owner: str) -> Expression:
    """An expression that must be a number."""
    if isinstance(text, int | float) and not _is_finite(text):
        raise must_be("A number", owner, "finite", text)
    found = Expression(repr(float(text)) if isinstance(text, int | float) else text)
    if found.is_condition:
        raise must_be(f"`{found.text}`", owner, "a number, not a comparison", found.text)
    return found


def condition(text: str, owner: str) -> Expression:
    """An expression that must be true or false."""
    found = Expression(text)
    if not found.is_condition:
        raise must_be(f"`{found.text}`", owner, "a condition such as `a < b`", found.text)
    return found


@lru_cache(maxsize=512)
def _tree(text: str) -> ast.expr:
    if not isinstance(text, str) or not text.strip():
        raise InputError(f"An expression must be a text such as `3.5 * ego_speed`, got {text!r}.")
    if len(text) > LONGEST:
        raise InputError(f"An expression must have at most {LONGEST} characters, got {len(text)}.")
    tree = parsed(text, f"Expression `{clean(text)}`")
    _check(tree, text, 0)
    return tree


def parsed(text: str, what: str) -> ast.expr:
    """The syntax tree of an expression; `what` names it in errors. Raises InputError."""
    try:
        return ast.parse(text.strip(), mode="eval").body
    except UNREADABLE as error:
        reason = error.msg if isinstance(error, SyntaxError) else "it is too deep or malformed"
        raise InputError(f"{what} cannot be read: {reason}.") from None


def _check(node: ast.expr, text: str, depth: int) -> None:
    """Refuse whatever is not of the language, and conditions where a number belongs."""
    if depth > DEEPEST:
        raise InputError(f"Expression `{text}` must not be nested more than {DEEPEST} deep.")
    match node:
        case ast.Constant(value=value):
            if (
                isinstance(value, bool)
                or not isinstance(value, int | float)
                or not _is_finite(value)
            ):
                raise InputError(
                    f"Expression `{text}` must hold finite numbers and names only, got "
                    f"{shown(value)}."
                )
            return
        case ast.Name(id=name):
            if name in _FUNCTIONS:
                raise InputError(
                    f"`{name}` in expression `{text}` is a function: it must be given values in "
                    "brackets."
                )
            return
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            parts, wants_condition = [operand], True
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            parts, wants_condition = [operand], False
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
            parts, wants_condition = [left, right], False
        case ast.BoolOp(values=values):
            parts, wants_condition = values, True
        case ast.Compare(left=left, ops=ops, comparators=others) if all(
            type(op) in _COMPARISONS for op in ops
        ):
            parts, wants_condition = [left, *others], False
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
            check_known(f"function in expression `{text}`:", _FUNCTIONS, name)
            count = _FUNCTIONS[name][1]
            if len(args) != count and (count is not None or len(args) < 2):
                wanted = "at least 2" if count is None else str(count)
                raise must_be(
                    f"`{name}`", f"expression `{text}`", f"given {wanted} values", len(args)
                )
            if name == "where":
                _check_kind(args[0], text, wants_condition=True)
                _check(args[0], text, depth + 1)
                args = args[1:]
            parts, wants_condition = args, False
        case _:
            raise InputError(
                f"Expression `{text}` holds `{ast.unparse(node)}`, which the language does not "
                "have. It has numbers, "
                "names, + - * / **, comparisons, and, or, not, and the functions "
                f"{', '.join(_FUNCTIONS)}."
            )
    for part in parts:
        _check_kind(part, text, wants_condition=wants_condition)
        _check(part, text, depth + 1)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer that no float can hold
        return False


def _check_kind(node: ast.expr, text: str, *, wants_condition: bool) -> None:
    if _is_condition(node) != wants_condition:
        wanted = "a condition" if wants_condition else "a number"
        raise must_be(f"`{ast.unparse(node)}`", f"expression `{text}`", wanted, ast.unparse(node))


def _is_condition(node: ast.expr) -> bool:
    return isinstance(node, ast.Compare | ast.BoolOp) or (
        isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
    )


_Work = Callable[[Mapping[str, Any]], Any]


@lru_cache(maxsize=2048)
def _compiled(text: str, kind: int) -> _Work:
    """The expression as nested functions of the values by name.

    kind: `_ARRAYS` or `_FLOATS`.
    """
    return _work(_tree(text), kind)


@lru_cache(maxsize=64)
def _compiled_room(text: str) -> _Work:
    return _work(_room(_tree(text)), _ARRAYS)


def _room(node: ast.expr) -> ast.expr:
    """A condition as a number that is below 0 where it does not hold: the least room of those that
    must all hold.
    """
    match node:
        case ast.UnaryOp(operand=operand):
            return ast.UnaryOp(ast.USub(), _room(operand))
        case ast.BoolOp(op=op, values=values):
            return _one_of(
                "min" if isinstance(op, ast.And) else "max", [_room(value) for value in values]
            )
        case ast.Compare(left=left, ops=ops, comparators=others):
            sides = [left, *others]
            return _one_of("min", list(map(_between, ops, sides, sides[1:])))
    raise AssertionError(ast.dump(node))  # `_is_condition` knows no other


def _between(op: ast.cmpop, left: ast.expr, right: ast.expr) -> ast.expr:
    less, more = (right, left) if isinstance(op, ast.Gt | ast.GtE) else (left, right)
    room: ast.expr = ast.BinOp(more, ast.Sub(), less)
    if isinstance(op, ast.Eq | ast.NotEq):
        room = ast.Call(ast.Name("abs"), [room], [])
    return ast.UnaryOp(ast.USub(), room) if isinstance(op, ast.Eq) else room


def _one_of(function: str, parts: list[ast.expr]) -> ast.expr:
    return parts[0] if len(parts) == 1 else ast.Call(ast.Name(function), parts, [])


def _work(node: ast.expr, kind: int) -> _Work:
    found = _operation(node, kind)
    if any(isinstance(part, ast.Name) and part.id not in _FUNCTIONS for part in ast.walk(node)):
        return found
    with np.errstate(all="ignore"):
        constant = found({})
    return lambda values: constant


def _operation(node: ast.expr, kind: int) -> _Work:
    match node:
        case ast.Constant(value=value):
            exact = float if kind == _FLOATS else np.float64
            constant = exact(value)  # type: ignore[arg-type]
            return lambda values: constant
        case ast.Name(id=name):
            if kind == _FLOATS:
                return operator.itemgetter(name)
            return lambda values: np.asarray(values[name], dtype=np.float64)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _work(operand, kind)
        case ast.UnaryOp(op=op, operand=operand):
            inner, turn = (
                _work(operand, kind),
                _NOT[kind] if isinstance(op, ast.Not) else operator.neg,
            )
            return lambda values: turn(inner(values))
        case ast.BinOp(left=left, op=op, right=right):
            return _joined(_ARITHMETIC[type(op)][kind], _work(left, kind), _work(right, kind))
        case ast.BoolOp(op=op, values=parts):
            join = (_AND if isinstance(op, ast.And) else _OR)[kind]
            return reduce(lambda a, b: _joined(join, a, b), [_work(part, kind) for part in parts])
        case ast.Compare(left=left, ops=ops, comparators=others):
            sides = [_work(side, kind) for side in (left, *others)]
            pairs = zip(ops, sides[:-1], sides[1:], strict=True)
            found = [_joined(_COMPARISONS[type(op)], a, b) for op, a, b in pairs]
            return reduce(lambda a, b: _joined(_AND[kind], a, b), found)
        case ast.Call(func=ast.Name(id=name), args=args):
            function, parts_of_it = _FUNCTIONS[name][0][kind], [_work(part, kind) for part in args]
            return lambda values: function(*[part(values) for part in parts_of_it])
    raise AssertionError(ast.dump(node))  # `_check` has refused every other node


def _joined(operation: Callable[[Any, Any], Any], left: _Work, right: _Work) -> _Work:
    return lambda values: operation(left(values), right(values))
