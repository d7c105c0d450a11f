"""Values in OpenSCENARIO files: literals, `$name` and `${expression}`, and the rules that compare
them. `reading.Node` uses them for attributes.

Users: `extras/openscenario/drive_numbers.py`, `extras/openscenario/earth.py`,
`extras/openscenario/moments.py`, `extras/openscenario/points.py`,
`extras/openscenario/reading.py`, `extras/openscenario/scene.py`, `extras/openscenario/space.py`.
"""

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from functools import lru_cache

from sumo_eval.errors import did_you_mean
from sumo_eval.scenario.expression import UNREADABLE, operation
from sumo_eval.text import shown

Value = float | str
_LONGEST = 2_000  # characters of an expression
_DEEPEST = 60  # levels of nested operations
# `$name`, whose name does not begin with a digit
_REFERENCE = re.compile(r"\$([^\W\d]\w*)")

FUNCTIONS: dict[str, tuple[Callable[..., float], int]] = {
    "sqrt": (math.sqrt, 1), "pow": (math.pow, 2), "sin": (math.sin, 1), "cos": (math.cos, 1),
    "tan": (math.tan, 1),
    "asin": (math.asin, 1), "acos": (math.acos, 1), "atan": (math.atan, 1), "abs": (abs, 1),
    "floor": (math.floor, 1),
    "ceil": (math.ceil, 1), "round": (lambda a: math.floor(a + 0.5), 1), "min": (min, 2),
    "max": (max, 2),
    "sign": (lambda a: float((a > 0.0) - (a < 0.0)), 1),
}  # fmt: skip
"""Functions of an expression: name -> function, and how many values it takes."""
_OPERATIONS: dict[str, tuple[Callable[..., float], int]] = {
    "Add": (operator.add, 2), "Sub": (operator.sub, 2), "Mult": (operator.mul, 2),
    "Div": (operator.truediv, 2), "USub": (operator.neg, 1), "UAdd": (operator.pos, 1),
    # the dividend's sign, as in C; for divisor 0, `operator.mod` raises ZeroDivisionError
    "Mod": (lambda one, two: math.fmod(one, two) if two else operator.mod(one, two), 2),
    **{f"{name}()": known for name, known in FUNCTIONS.items()},
}  # fmt: skip
"""Operations by the names of `scenario.expression.operation`, with their numbers of values."""
_RULES: dict[str, Callable[[float, float], bool]] = {
    "lessThan": operator.lt, "lessOrEqual": operator.le, "greaterThan": operator.gt,
    "greaterOrEqual": operator.ge,
    "equalTo": operator.eq, "notEqualTo": operator.ne,
}  # fmt: skip
RULES = tuple(_RULES)


def number_of(value: Value) -> float | None:
    """A value as a number; None for a text that is not a number."""
    if isinstance(value, float):
        return value
    if "_" in value:  # Python reads 1_0 as 10, other tools do not
        return None
    try:
        return float(value)
    except ValueError:
        return None


def plain(written: str) -> Value:
    """A literal: a number where it is one, else the text."""
    value = number_of(written)
    return written if value is None else value


class WrongValueError(Exception):
    """Reason why a written value is wrong, as the end of a message on its element."""


def worked_out(written: str, values: Mapping[str, Value]) -> Value:
    """The value of what is written in an attribute: `$name`, `${expression of $names}`, or a
    literal, which stays a text.

    values: values of parameters, by name.

    Raises WrongValueError.
    """
    written = written.strip()
    if not written.startswith("$"):
        return written
    if not written.startswith("${"):
        named = _REFERENCE.fullmatch(written)
        if named is None:
            raise WrongValueError(f"`{shown(written)}` cannot be read: a parameter is `$name`")
        return _value(named[1], values)
    if not written.endswith("}"):
        raise WrongValueError(f"`{shown(written)}` cannot be read: its bracket does not close")
    # in Python's tree `$name` is `p_name`, so that no parameter hides pi or a function
    names = {"pi": math.pi, "PI": math.pi}
    for name in _REFERENCE.findall(written[2:-1]):
        value = number_of(_value(name, values))
        if value is None:
            raise WrongValueError(
                f"parameter `{name}` must be a number in an expression, got {shown(values[name])}"
            )
        names[f"p_{name}"] = value
    try:
        result = _evaluate(_tree(written[2:-1]), names, 0)
        why = "" if math.isfinite(result) else f"must be finite, got {result}"
    except ZeroDivisionError:
        why = "divides by zero"
    except (ValueError, OverflowError):
        why = "has no value at these parameters"
    except WrongValueError as error:
        why = str(error)
    if why:
        raise WrongValueError(f"expression `{shown(written)}` {why}")
    return float(result)


def _value(name: str, values: Mapping[str, Value]) -> Value:
    """The value of a parameter."""
    if name not in values:
        raise WrongValueError(f"parameter `{name}` is not declared.{did_you_mean(name, values)}")
    return values[name]


@lru_cache(maxsize=2048)
def _tree(inner: str) -> ast.expr:
    """Python's syntax tree of an expression without its brackets."""
    if len(inner) > _LONGEST:
        raise WrongValueError(f"must have at most {_LONGEST} characters")
    # as in `number_of`; not of a name such as `$speed_1`
    if re.search(r"(?<![\w$])\d\w*_", inner):
        raise WrongValueError("cannot be read: no number has a `_`")
    try:
        return ast.parse(_REFERENCE.sub(r"p_\1", inner).strip(), mode="eval").body
    except UNREADABLE:
        raise WrongValueError("cannot be read") from None


def _evaluate(node: ast.expr, names: Mapping[str, float], depth: int) -> float:
    """The value of a part of an expression; depth: operations around it."""
    if depth > _DEEPEST:
        raise WrongValueError("is nested too deep")
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name) and node.id in names:
        return names[node.id]
    name, parts = operation(node)
    if name in _OPERATIONS:
        function, count = _OPERATIONS[name]
        if len(parts) != count:  # only of a function, whose name ends with `()`
            raise WrongValueError(f"must give {count} values to `{name[:-2]}`, got {len(parts)}")
        return function(*(_evaluate(part, names, depth + 1) for part in parts))
    part = re.sub(r"\bp_(?=[^\W\d])", "$", ast.unparse(node))  # `p_name` is `$name` in the file
    raise WrongValueError(f"holds `{part[:60]}`; it has numbers, $names, + - * / %, pi and "
                                f"{', '.join(FUNCTIONS)}")  # fmt: skip


def holds(rule: str, one: Value, two: Value) -> bool | None:
    """Whether a rule holds between two values; None where it would order texts.

    rule: one of `RULES`.
    """
    first, second = number_of(one), number_of(two)
    if first is not None and second is not None:
        return _RULES[rule](first, second)
    if rule not in ("equalTo", "notEqualTo"):
        return None
    return (str(one) == str(two)) == (rule == "equalTo")
