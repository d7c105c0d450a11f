"""A small language of arithmetic and comparisons for scenario files: `3.5 * ego_speed`, `lead_speed
< ego_speed`.

Python's parser reads the text, and only the node types listed here are understood: numbers, names,
+ - * / **, comparisons (chains too), and, or, not, and the functions below. There are no
attributes, no subscripts, no calls of anything else and no `eval`. One expression serves a whole
space, on numpy arrays, and one point, on plain floats.
"""

from __future__ import annotations

import ast
import keyword
import math
import operator
import unicodedata
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, check_known, must_be, unknown
from sumo_eval.text import clean, shown

LONGEST = 1_000  # characters of an expression
DEEPEST = 50  # brackets within brackets
UNREADABLE = (SyntaxError, ValueError, RecursionError, MemoryError)
"""Exceptions of Python's parser for invalid text."""


def _quiet(function: Callable[..., Any]) -> Callable[..., float]:
    """Apply a function of numpy to plain floats; undefined values are nan or inf, without a
    warning.
    """

    def of_floats(*values: float) -> float:
        with np.errstate(all="ignore"):
            return float(function(*values))

    return of_floats


class _Operation(NamedTuple):
    """on_arrays, on_floats: how it is done, to the same bits.
    takes: how many values; None: two or more.
    """

    on_arrays: Callable[..., Any]
    on_floats: Callable[..., Any]
    takes: int | None


_divide = _quiet(np.divide)
_ALIKE = (
    ("Add", operator.add), ("Sub", operator.sub), ("Mult", operator.mul), ("Lt", operator.lt),
    ("LtE", operator.le), ("Gt", operator.gt), ("GtE", operator.ge), ("Eq", operator.eq),
    ("NotEq", operator.ne),
)  # fmt: skip
_UFUNCS = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log, "tanh": np.tanh}
_OPERATIONS: dict[str, _Operation] = {
    **{name: _Operation(function, function, 2) for name, function in _ALIKE},
    "Div": _Operation(np.divide, lambda a, b: a / b if b else _divide(a, b), 2),
    "Pow": _Operation(np.power, _quiet(np.power), 2),
    "UAdd": _Operation(operator.pos, operator.pos, 1),
    "USub": _Operation(operator.neg, operator.neg, 1),
    "Not": _Operation(np.logical_not, operator.not_, 1),
    "And": _Operation(np.logical_and, lambda a, b: a and b, None),
    "Or": _Operation(np.logical_or, lambda a, b: a or b, None),
    "min()": _Operation(np.minimum, lambda a, b: a if a < b or math.isnan(a) else b, None),
    "max()": _Operation(np.maximum, lambda a, b: a if a > b or math.isnan(a) else b, None),
    "abs()": _Operation(abs, abs, 1),
    **{f"{name}()": _Operation(ufunc, _quiet(ufunc), 1) for name, ufunc in _UFUNCS.items()},
    "where()": _Operation(np.where, lambda holds, then, other: then if holds else other, 3),
}
"""The language: operators by Python's names, functions with brackets.

`where(condition, then, else)`.
"""
ARITHMETIC = [name[:-2] for name in _OPERATIONS if name.endswith("()")]
"""Names of the functions."""


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
            if isinstance(node, ast.Name) and node.id not in ARITHMETIC
        )

    def value(self, values: Mapping[str, ArrayLike]) -> Any:
        """The value at the given values by name, which broadcast.

        Where it is not defined (1 / 0) it is inf or nan.
        """
        with np.errstate(all="ignore"):
            return np.asarray(self._evaluated(values))

    def room(self, values: Mapping[str, ArrayLike]) -> Any:
        """Distance of a condition from its limit, in the unit of the compared values; below 0 where
        it does not hold.
        """
        with np.errstate(all="ignore"):
            return np.asarray(_work(_room(_tree(self.text)))(values))

    def at(self, values: Mapping[str, float]) -> Any:
        """The value at one point, given as plain floats: the number (or truth) that `value` has
        there, faster.
        """
        return self._evaluated(values, plain=True)

    def _evaluated(self, values: Mapping[str, Any], *, plain: bool = False) -> Any:
        try:
            return _compiled(self.text, plain)(values)
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
        """The definitions that the expressions need."""
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
        return self._with(values, Expression.value)

    def at(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values and the definitions at one point, plain floats."""
        return self._with(values, Expression.at)

    def _with(self, values: Mapping[str, Any], evaluate: Callable[..., Any]) -> dict[str, Any]:
        known = {**values, **dict(self.options)}
        for name, expression in self.entries:
            known[name] = evaluate(expression, known)
        return known


def checked_names(expression: Expression, known: Iterable[str], owner: str) -> Expression:
    """The expression, if all its names are known; else an InputError with the nearest one."""
    names = list(known)
    check_known(f"name in `{expression.text}` of {owner}:", names, *sorted(expression.names))
    return expression


def number(text: str | float, owner: str) -> Expression:
    """An expression that must be a number."""
    if isinstance(text, int | float):
        if not _is_finite(text):
            raise must_be("A number", owner, "finite", text)
        text = repr(float(text))
    return _of_kind(text, owner, "a number, not a comparison", condition=False)


def condition(text: str, owner: str) -> Expression:
    """An expression that must be true or false."""
    return _of_kind(text, owner, "a condition such as `a < b`", condition=True)


def _of_kind(text: str, owner: str, wanted: str, *, condition: bool) -> Expression:
    if not (isinstance(text, str) and text.strip()):
        raise must_be("The expression", owner, "a text such as `3.5 * ego_speed`", text)
    expression = Expression(text)
    if _is_condition(_tree(text)) != condition:
        raise must_be(f"`{text}`", owner, wanted, text)
    return expression


@lru_cache(maxsize=512)
def _tree(text: str) -> ast.expr:
    if len(text) > LONGEST:
        raise InputError(f"An expression must have at most {LONGEST} characters, got {len(text)}.")
    tree = parsed(text, f"Expression `{clean(text)}`")
    _check(tree, text)
    return tree


def parsed(text: str, what: str) -> ast.expr:
    """The syntax tree of an expression; `what` names it in errors. Raises InputError."""
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except UNREADABLE as error:
        reason = error.msg if isinstance(error, SyntaxError) else "it is too deep or malformed"
        raise InputError(f"{what} cannot be read: {reason}.") from None
    # level by level: whatever reads or writes the tree later may call itself at each
    level: list[ast.AST] = [tree]
    for _ in range(DEEPEST + 1):
        level = [
            part
            for node in level
            for part in ast.iter_child_nodes(node)
            if not isinstance(part, ast.expr_context)  # which a name has below it
        ]
    if level:
        raise InputError(f"{what} must not be nested more than {DEEPEST} deep.")
    return tree


def check_variable(name: str, owner: str, also: Collection[str] = ()) -> None:
    """Refuse a name that no expression could use.

    also: names that are allowed all the same.
    """
    # Python reads letters in their normal form: the micro sign as the Greek letter
    plain = name.isidentifier() and unicodedata.is_normalized("NFKC", name)
    if not (plain and not keyword.iskeyword(name)) and name not in also:
        allowed = "letters, digits and underscores in the form NFKC, and no keyword of Python"
        raise must_be("The name", owner, allowed, name)


def _check(node: ast.expr, text: str, *, condition: bool | None = None) -> None:
    """Refuse whatever is not of the language.

    condition: whether a condition or a number must stand here; None: either.
    """
    if condition not in (None, _is_condition(node)):
        wanted = "a condition" if condition else "a number"
        raise must_be(f"`{ast.unparse(node)}`", f"expression `{text}`", wanted, ast.unparse(node))
    if isinstance(node, ast.Constant):
        value: Any = node.value
        if type(value) not in (int, float) or not _is_finite(value):
            raise InputError(
                f"Expression `{text}` must hold finite numbers and names only, got {shown(value)}."
            )
        return
    if isinstance(node, ast.Name):
        if node.id in ARITHMETIC:
            raise InputError(
                f"`{node.id}` in expression `{text}` is a function: it must be given values in "
                "brackets."
            )
        return
    name, parts = operation(node)
    if name.endswith("()"):
        check_known(f"function in expression `{text}`:", ARITHMETIC, name[:-2])
    if name not in _OPERATIONS:
        raise InputError(
            f"Expression `{text}` holds `{ast.unparse(node)}`, which the language does not "
            "have. It has numbers, names, + - * / **, comparisons, and, or, not, and the "
            f"functions {', '.join(ARITHMETIC)}."
        )
    count = _OPERATIONS[name].takes
    if len(parts) != count if count else len(parts) < 2:
        wanted = f"given {count or 'at least 2'} values"
        raise must_be(f"`{name[:-2]}`", f"expression `{text}`", wanted, len(parts))
    for place, part in enumerate(parts):
        joined = name in ("And", "Or", "Not") or (name == "where()" and place == 0)
        _check(part, text, condition=joined)


def operation(node: ast.expr) -> tuple[str, list[ast.expr]]:
    """Name of an operation in `_OPERATIONS` and what it is applied to; a chain of comparisons is an
    `And` of pairs.
    """
    op: ast.AST
    match node:
        case ast.UnaryOp(op=op, operand=operand):
            parts = [operand]
        case ast.BinOp(left=left, op=op, right=right):
            parts = [left, right]
        case ast.BoolOp(op=op, values=parts):
            pass
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            parts = [left, right]
        case ast.Compare(left=left, ops=ops, comparators=sides):
            pairs = zip(ops, [left, *sides], sides, strict=False)
            op, parts = ast.And(), [ast.Compare(a, [one], [b]) for one, a, b in pairs]
        case ast.Call(func=ast.Name(id=name), args=parts, keywords=[]):
            return f"{name}()", parts
        case _:
            return "", []
    return type(op).__name__, parts


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer that no float can hold
        return False


def _is_condition(node: ast.expr) -> bool:
    negated = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
    return negated or isinstance(node, ast.Compare | ast.BoolOp)


_Work = Callable[[Mapping[str, Any]], Any]


@lru_cache(maxsize=2048)
def _compiled(text: str, plain: bool) -> _Work:
    """The expression as nested functions of the values by name.

    plain: of plain floats, else of arrays.
    """
    return _work(_tree(text), plain=plain)


def _work(node: ast.expr, *, plain: bool = False) -> _Work:
    if isinstance(node, ast.Constant):
        constant = (float if plain else np.float64)(node.value)  # type: ignore[arg-type]
        return lambda values: constant
    if isinstance(node, ast.Name):
        name = node.id
        if plain:
            return operator.itemgetter(name)
        return lambda values: np.asarray(values[name], dtype=np.float64)
    name, parts = operation(node)
    done, inner = _OPERATIONS[name], [_work(part, plain=plain) for part in parts]
    function = done.on_floats if plain else done.on_arrays
    if done.takes in (2, None):
        return reduce(lambda a, b: lambda values: function(a(values), b(values)), inner)
    return lambda values: function(*[part(values) for part in inner])


def _room(node: ast.expr) -> ast.expr:
    """A condition as a number that is below 0 where it does not hold: the least room of those that
    must all hold.
    """
    name, parts = operation(node)
    if name == "Not":
        return ast.UnaryOp(ast.USub(), _room(parts[0]))
    if name in ("And", "Or"):
        rooms = [_room(part) for part in parts]
        return ast.Call(ast.Name("min" if name == "And" else "max"), rooms, [])
    less, more = reversed(parts) if name in ("Gt", "GtE") else parts
    room: ast.expr = ast.BinOp(more, ast.Sub(), less)
    if name in ("Eq", "NotEq"):
        room = ast.Call(ast.Name("abs"), [room], [])
    return ast.UnaryOp(ast.USub(), room) if name == "Eq" else room
