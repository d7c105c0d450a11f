"""The language of scenario files, arithmetic and comparisons: `3.5 * ego_speed`, `lead_speed <
ego_speed`.

`scenario/formulas.py` uses the expressions for points of a space. `scenario/requirement.py` and
`scenario/trigger.py` extend the language.

Python's parser reads the text. Only these nodes are accepted: numbers, names, + - * / **,
comparisons (chains too), and, or, not, and the functions below. There are no attributes, subscripts
or other calls, and no `eval`. Numpy computes an expression for one point or for arrays of points.
The language is a public format: it may grow, but not change.

Users: `scenario/`, `extras/openscenario/`.
"""

from __future__ import annotations

import ast
import keyword
import math
import operator
import unicodedata
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import lru_cache, reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, check_known, must_be, unknown
from sumo_eval.frozen import frozen
from sumo_eval.text import clean, shown

LONGEST = 1_000  # characters of an expression
DEEPEST = 50  # brackets within brackets
UNREADABLE = (SyntaxError, ValueError, RecursionError, MemoryError)
"""Exceptions of Python's parser for invalid text."""


_OPERATIONS: dict[str, tuple[Callable[..., Any], int | None]] = {
    "Add": (operator.add, 2), "Sub": (operator.sub, 2), "Mult": (operator.mul, 2),
    "Div": (np.divide, 2), "Pow": (np.power, 2),
    "UAdd": (operator.pos, 1), "USub": (operator.neg, 1),
    "Lt": (operator.lt, 2), "LtE": (operator.le, 2), "Gt": (operator.gt, 2),
    "GtE": (operator.ge, 2), "Eq": (operator.eq, 2), "NotEq": (operator.ne, 2),
    "Not": (np.logical_not, 1), "And": (np.logical_and, None), "Or": (np.logical_or, None),
    "min()": (np.minimum, None), "max()": (np.maximum, None), "abs()": (abs, 1),
    "sqrt()": (np.sqrt, 1), "exp()": (np.exp, 1), "log()": (np.log, 1), "tanh()": (np.tanh, 1),
    "where()": (np.where, 3),
}  # fmt: skip
"""The language. Key: name of an operator's class in `ast`, or of a function with `()`. Value: what
computes it, and the number of operands; None: two or more, joined two by two from the left.

The operands of `where()` are (condition, then, else).
"""
MATH_FUNCTIONS = [name[:-2] for name in _OPERATIONS if name.endswith("()")]
"""Names of the functions, without brackets."""


@frozen
class Expression:
    """A checked expression. It holds only its text, so that it can be compared and sent to a
    worker.
    """

    text: str

    def __post_init__(self) -> None:
        _tree(self.text)

    @property
    def names(self) -> frozenset[str]:
        """Names of the values that it needs."""
        return frozenset(
            node.id
            for node in ast.walk(_tree(self.text))
            if isinstance(node, ast.Name) and node.id not in MATH_FUNCTIONS
        )

    @property
    def sides(self) -> Iterator[Expression]:
        """The numbers that its comparisons compare."""
        for node in ast.walk(_tree(self.text)):
            if isinstance(node, ast.Compare):
                for side in (node.left, *node.comparators):
                    yield Expression(ast.unparse(side))

    def value(self, values: Mapping[str, ArrayLike]) -> Any:
        """The value as an array; inf or nan where it is not defined, as 1 / 0.

        values: by name, arrays that broadcast.
        """
        try:
            with np.errstate(all="ignore"):
                return np.asarray(_compiled(self.text)(values))
        except KeyError as error:
            raise unknown(
                f"name in expression `{self.text}`:", str(error.args[0]), sorted(values)
            ) from None

    def room(self, values: Mapping[str, ArrayLike]) -> Any:
        """Distance of a condition from its limit, in the unit of the compared values: above 0 the
        condition holds, below 0 it does not.

        values: as in `value`.
        """
        with np.errstate(all="ignore"):
            return np.asarray(_evaluator(_room(_tree(self.text)))(values))

    def at(self, values: Mapping[str, ArrayLike]) -> Any:
        """The value at one point: a float, or a bool of a condition.

        values: by name, one number each.
        """
        return self.value(values).item()


@frozen
class Definitions:
    """Named expressions, each of which may use those before it.

    entries: (name, expression).
    options: (name, number), for all expressions.
    """

    entries: tuple[tuple[str, Expression], ...]
    options: tuple[tuple[str, float], ...] = ()

    def needed_by(self, *expressions: Expression) -> Definitions:
        """The definitions that the expressions need, in their order."""
        names = set().union(*(expression.names for expression in expressions))
        entries = []
        for name, expression in reversed(self.entries):  # a definition needs only earlier ones
            if name in names:
                entries.append((name, expression))
                names |= expression.names
        options = tuple((name, value) for name, value in self.options if name in names)
        return Definitions(tuple(reversed(entries)), options)

    def extend(self, values: Mapping[str, ArrayLike]) -> dict[str, Any]:
        """The values with those of the definitions."""
        extended = {**values, **dict(self.options)}
        for name, expression in self.entries:
            extended[name] = expression.value(extended)
        return extended


def checked_names(expression: Expression, known: Iterable[str], owner: str) -> Expression:
    """The expression, unchanged; raises InputError if one of its names is not among `known`."""
    names = list(known)
    check_known(f"name in `{expression.text}` of {owner}:", names, *sorted(expression.names))
    return expression


def number(text: str | float, owner: str) -> Expression:
    """Read an expression that must be a number.

    owner: place in the file, for messages.
    """
    if isinstance(text, int | float):
        if not _is_finite(text):
            raise must_be("A number", owner, "finite", text)
        text = repr(float(text))
    return _of_kind(text, owner, "a number, not a comparison", condition=False)


def condition(text: str, owner: str, written: str = "") -> Expression:
    """Read an expression that must be true or false.

    written: what the user wrote, for the message, if it is not `text`.
    """
    return _of_kind(text, owner, "a condition such as `a < b`", condition=True, written=written)


def _of_kind(
    text: str, owner: str, wanted: str, *, condition: bool, written: str = ""
) -> Expression:
    """The expression in a text, which must be a condition, or a number.

    wanted: the same in words, for messages. written: as in `condition`.
    """
    if not (isinstance(text, str) and text.strip()):
        raise must_be("The expression", owner, "a text such as `3.5 * ego_speed`", text)
    try:
        expression = Expression(text)
    except InputError as error:
        raise InputError(f"In {owner}: {error}") from None
    if _is_condition(_tree(text)) != condition:
        raise must_be(f"`{written or text}`", owner, wanted, written or text)
    return expression


@lru_cache(maxsize=512)
def _tree(text: str) -> ast.expr:
    """The syntax tree of an expression, checked."""
    if len(text) > LONGEST:
        raise InputError(f"An expression must have at most {LONGEST} characters, got {len(text)}.")
    tree = parsed(text, f"Expression `{clean(text)}`")
    _check(tree, text)
    return tree


def parsed(text: str, what: str) -> ast.expr:
    """The syntax tree of a text, at most `DEEPEST` levels deep.

    what: begins the message of an InputError.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except UNREADABLE as error:
        reason = error.msg if isinstance(error, SyntaxError) else "it is too deep or malformed"
        raise InputError(f"{what} cannot be read: {reason}.") from None
    # Level by level, not by recursion: the functions below recurse, and would fail on a deeper
    # tree, so this check must not. After the loop, `level` has the nodes that are too deep.
    level: list[ast.AST] = [tree]
    for _ in range(DEEPEST + 1):
        level = [
            part
            for node in level
            for part in ast.iter_child_nodes(node)
            if not isinstance(part, ast.expr_context)  # `Load`, which Python adds to a name
        ]
    if level:
        raise InputError(f"{what} must not be nested more than {DEEPEST} deep.")
    return tree


def check_variable(name: str, owner: str, also: Collection[str] = ()) -> None:
    """Refuse a name that no expression could use.

    also: further names that are allowed.
    """
    # Python reads names in the form NFKC: a micro sign (U+00B5) becomes a Greek mu
    plain = name.isidentifier() and unicodedata.is_normalized("NFKC", name)
    if (not plain or keyword.iskeyword(name)) and name not in also:
        allowed = "letters, digits and underscores in the form NFKC, and no keyword of Python"
        raise must_be("The name", owner, allowed, name)


def _check(node: ast.expr, text: str, *, condition: bool | None = None) -> None:
    """Refuse a node, or one within it, that the language does not have.

    text: the whole expression, for messages.
    condition: True: the node must be a condition; False: a number; None: either.
    """
    if condition is not None and condition != _is_condition(node):
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
        if node.id in MATH_FUNCTIONS:
            raise InputError(
                f"`{node.id}` in expression `{text}` is a function: it must be given values in "
                "brackets."
            )
        return
    name, parts = operation(node)
    if name.endswith("()"):
        check_known(f"function in expression `{text}`:", MATH_FUNCTIONS, name[:-2])
    if name not in _OPERATIONS:
        raise InputError(
            f"Expression `{text}` holds `{ast.unparse(node)}`, which the language does not "
            "have. It has numbers, names, + - * / **, comparisons, and, or, not, and the "
            f"functions {', '.join(MATH_FUNCTIONS)}."
        )
    _, count = _OPERATIONS[name]  # None: two or more
    if len(parts) < 2 if count is None else len(parts) != count:
        wanted = f"given {count or 'at least 2'} values"
        raise must_be(f"`{name[:-2]}`", f"expression `{text}`", wanted, len(parts))
    for index, part in enumerate(parts):
        takes_condition = name in ("And", "Or", "Not") or (name == "where()" and index == 0)
        _check(part, text, condition=takes_condition)


def operation(node: ast.expr) -> tuple[str, list[ast.expr]]:
    """Name of a node's operation as in `_OPERATIONS`, and the nodes that are its operands.

    The name of a call is that of any function, known or not. A chain of comparisons counts as an
    `And` of comparisons of two. A node without an operation has the name "" and no operands.
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
            # a < b < c: `ops` (<, <), `sides` (b, c); not strict: the first list has one more
            pairs = zip(ops, [left, *sides], sides, strict=False)
            op = ast.And()
            parts = [ast.Compare(a, [sign], [b]) for sign, a, b in pairs]
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


_Evaluator = Callable[[Mapping[str, Any]], Any]
"""Values by name -> value of an expression."""


@lru_cache(maxsize=2048)
def _compiled(text: str) -> _Evaluator:
    """The evaluator of an expression."""
    return _evaluator(_tree(text))


def _evaluator(node: ast.expr) -> _Evaluator:
    """The evaluator of a node, made of the evaluators of its operands."""
    if isinstance(node, ast.Constant):
        constant = np.float64(node.value)  # type: ignore[arg-type]
        return lambda values: constant
    if isinstance(node, ast.Name):
        name = node.id
        return lambda values: np.asarray(values[name], float)
    name, parts = operation(node)
    function, count = _OPERATIONS[name]
    operands = list(map(_evaluator, parts))
    if count in (2, None):  # more than two operands are joined two by two from the left
        return reduce(lambda a, b: lambda values: function(a(values), b(values)), operands)
    return lambda values: function(*[operand(values) for operand in operands])


def _room(node: ast.expr) -> ast.expr:
    """The expression of a condition's `Expression.room`, by the rooms of its parts: of `and` the
    least, of `or` the largest, of `not` the negative.
    """
    name, parts = operation(node)
    if name == "Not":
        return ast.UnaryOp(ast.USub(), _room(parts[0]))
    if name in ("And", "Or"):
        rooms = [_room(part) for part in parts]
        return ast.Call(ast.Name("min" if name == "And" else "max"), rooms, [])
    # `less < more` has the room more - less; `a > b` is `b < a`
    less, more = reversed(parts) if name in ("Gt", "GtE") else parts
    room: ast.expr = ast.BinOp(more, ast.Sub(), less)
    if name in ("Eq", "NotEq"):  # equal: -|a - b|; different: |a - b|
        room = ast.Call(ast.Name("abs"), [room], [])
    return ast.UnaryOp(ast.USub(), room) if name == "Eq" else room
