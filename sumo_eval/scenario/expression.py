"""A small language of arithmetic and comparisons for scenario files: `3.5 * ego_speed`, `lead_speed < ego_speed`.

Python's parser reads the text, and only the node types listed here are understood: numbers, names, + - * / **,
comparisons (chains too), and, or, not, and the functions below. There are no attributes, no subscripts, no calls of
anything else and no `eval`. Values are numpy arrays, so that one expression serves one point and a whole space.
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

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.text import clean, shown

LONGEST = 1_000  # characters of an expression
DEEPEST = 50  # brackets within brackets

_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: np.divide, ast.Pow: np.power,
}  # fmt: skip
_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip
_FUNCTIONS: dict[str, tuple[Callable[..., Any], int | None]] = {
    "min": (lambda *values: reduce(np.minimum, values), None),
    "max": (lambda *values: reduce(np.maximum, values), None),
    "abs": (np.abs, 1),
    "sqrt": (np.sqrt, 1),
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "tanh": (np.tanh, 1),
    "where": (np.where, 3),
}
"""Functions by name and how many values they take (None: two or more). `where(condition, then, else)`."""


@dataclass(frozen=True, slots=True)
class Expression:
    """A checked expression. Two of the same text are equal, and one can be sent to another process."""

    text: str

    def __post_init__(self) -> None:
        _tree(self.text)

    @property
    def names(self) -> frozenset[str]:
        """The names it needs a value for."""
        return frozenset(
            node.id for node in ast.walk(_tree(self.text)) if isinstance(node, ast.Name) and node.id not in _FUNCTIONS
        )

    @property
    def is_condition(self) -> bool:
        """Whether it says true or false rather than a number."""
        return _is_condition(_tree(self.text))

    def value(self, values: Mapping[str, ArrayLike]) -> Any:
        """The value at the given values by name, which broadcast. Where it is not defined (1 / 0) it is inf or nan."""
        for name in self.names:
            if name not in values:
                raise unknown(f"name in expression `{self.text}`:", name, sorted(values))
        with np.errstate(all="ignore"):
            return np.asarray(_value(_tree(self.text), values))


def checked_names(expression: Expression, known: Iterable[str], owner: str) -> Expression:
    """The expression, if all its names are known; else an InputError with the nearest one."""
    names = list(known)
    for name in sorted(expression.names):
        if name not in names:
            raise unknown(f"name in `{expression.text}` of {owner}:", name, names)
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
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"Expression `{clean(text)}` cannot be read: {_reason(error)}.") from None
    _check(tree, text, 0)
    return tree


def _reason(error: BaseException) -> str:
    return str(error.msg) if isinstance(error, SyntaxError) else "it is too deep or malformed"


def _check(node: ast.expr, text: str, depth: int) -> None:
    """Refuse whatever is not of the language, and conditions where a number belongs."""
    if depth > DEEPEST:
        raise InputError(f"Expression `{text}` must not be nested more than {DEEPEST} deep.")
    match node:
        case ast.Constant(value=value):
            if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
                raise InputError(f"Expression `{text}` must hold finite numbers and names only, got {shown(value)}.")
            return
        case ast.Name(id=name):
            if name in _FUNCTIONS:
                raise InputError(f"`{name}` in expression `{text}` is a function: it must be given values in brackets.")
            return
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            parts, wants_condition = [operand], True
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            parts, wants_condition = [operand], False
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
            parts, wants_condition = [left, right], False
        case ast.BoolOp(values=values):
            parts, wants_condition = values, True
        case ast.Compare(left=left, ops=ops, comparators=others) if all(type(op) in _COMPARISONS for op in ops):
            parts, wants_condition = [left, *others], False
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
            if name not in _FUNCTIONS:
                raise unknown(f"function in expression `{text}`:", name, _FUNCTIONS)
            count = _FUNCTIONS[name][1]
            if len(args) != count and (count is not None or len(args) < 2):
                wanted = "at least 2" if count is None else str(count)
                raise must_be(f"`{name}`", f"expression `{text}`", f"given {wanted} values", len(args))
            if name == "where":
                _check_kind(args[0], text, wants_condition=True)
                _check(args[0], text, depth + 1)
                args = args[1:]
            parts, wants_condition = args, False
        case _:
            raise InputError(
                f"Expression `{text}` holds `{ast.unparse(node)}`, which the language does not have. It has numbers, "
                f"names, + - * / **, comparisons, and, or, not, and the functions {', '.join(_FUNCTIONS)}."
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


def _value(node: ast.expr, values: Mapping[str, ArrayLike]) -> Any:
    match node:
        case ast.Constant(value=value):
            return np.float64(value)  # type: ignore[arg-type]
        case ast.Name(id=name):
            return np.asarray(values[name], dtype=np.float64)
        case ast.UnaryOp(op=op, operand=operand):
            inner = _value(operand, values)
            return np.logical_not(inner) if isinstance(op, ast.Not) else -inner if isinstance(op, ast.USub) else inner
        case ast.BinOp(left=left, op=op, right=right):
            return _ARITHMETIC[type(op)](_value(left, values), _value(right, values))
        case ast.BoolOp(op=op, values=parts):
            join = np.logical_and if isinstance(op, ast.And) else np.logical_or
            return reduce(join, [_value(part, values) for part in parts])
        case ast.Compare(left=left, ops=ops, comparators=others):
            sides = [_value(side, values) for side in (left, *others)]
            found = [_COMPARISONS[type(op)](a, b) for op, a, b in zip(ops, sides[:-1], sides[1:], strict=True)]
            return reduce(np.logical_and, found)
        case ast.Call(func=ast.Name(id=name), args=args):
            return _FUNCTIONS[name][0](*(_value(part, values) for part in args))
    raise AssertionError(ast.dump(node))  # `_check` has refused every other node
