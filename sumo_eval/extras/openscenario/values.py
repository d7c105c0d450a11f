"""Values in OpenSCENARIO files: literals, `$name` and `${expression}`, parameter declarations and their constraints."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

from sumo_eval.errors import InputError, did_you_mean
from sumo_eval.extras.openscenario.reading import attribute, children, fault, where
from sumo_eval.scenario.xml_file import Element
from sumo_eval.text import shown

Value = float | str
_LONGEST = 2_000  # characters of an expression
_DEEPEST = 60
_REFERENCE = re.compile(r"\$([^\W\d]\w*)")

_BINARY: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Mod: lambda one, two: math.fmod(one, two) if two else operator.mod(one, two),  # 0: divides by zero
}  # fmt: skip
FUNCTIONS: dict[str, tuple[Callable[..., float], int]] = {
    "sqrt": (math.sqrt, 1), "pow": (math.pow, 2), "sin": (math.sin, 1), "cos": (math.cos, 1), "tan": (math.tan, 1),
    "asin": (math.asin, 1), "acos": (math.acos, 1), "atan": (math.atan, 1), "abs": (abs, 1), "floor": (math.floor, 1),
    "ceil": (math.ceil, 1), "round": (lambda a: math.floor(a + 0.5), 1), "min": (min, 2), "max": (max, 2),
    "sign": (lambda a: float((a > 0.0) - (a < 0.0)), 1),
}  # fmt: skip
"""Functions of an expression, and how many values each takes."""
_RULES: dict[str, Callable[[float, float], bool]] = {
    "lessThan": operator.lt, "lessOrEqual": operator.le, "greaterThan": operator.gt, "greaterOrEqual": operator.ge,
    "equalTo": operator.eq, "notEqualTo": operator.ne,
}  # fmt: skip
RULES = tuple(_RULES)
_BOOLEAN = {"true": "true", "false": "false", "1": "true", "0": "false"}


@dataclass(slots=True)
class Scope:
    """Values by name."""

    values: dict[str, Value]

    def get(self, name: str, element: Element) -> Value:
        """The value of a name; refused where it is not known."""
        if name not in self.values:
            raise fault(element, f"parameter `{name}` is not declared.{did_you_mean(name, self.values)}".rstrip("."))
        return self.values[name]


def text(element: Element, name: str, scope: Scope, default: str | None = None) -> str:
    """An attribute as text, worked out."""
    if default is not None and element.get(name) is None:
        return default
    found = worked_out(attribute(element, name), scope, element)
    if isinstance(found, str):
        return found
    return str(int(found)) if found.is_integer() else repr(found)


_IN_KMH = re.compile(r"\$(\w+_)?(kph|kmh|kmph)", re.IGNORECASE)


def number(element: Element, name: str, scope: Scope, default: float | None = None) -> float:
    """An attribute as a finite number, worked out."""
    if default is not None and element.get(name) is None:
        return default
    written = attribute(element, name)
    if _IN_KMH.fullmatch(written.strip()):
        raise fault(
            element, f"`{name}` must be in m/s, got {written}, which by its name is in km/h: ${{{written} / 3.6}}"
        )
    found = worked_out(written, scope, element)
    value = _number(found)
    if value is None or not math.isfinite(value):
        is_what = "" if found == written else f", which is {shown(found)}"
        raise fault(element, f"`{name}` must be a finite number, got {shown(written)}{is_what}")
    return value


def whole(element: Element, name: str, scope: Scope) -> int:
    """An attribute as a whole number, worked out."""
    value = number(element, name, scope)
    if not value.is_integer():
        raise fault(element, f"`{name}` must be a whole number, got {value:g}")
    return int(value)


def flag(element: Element, name: str, scope: Scope, *, default: bool) -> bool:
    """An attribute that is true or false."""
    found = text(element, name, scope, "true" if default else "false")
    if found not in _BOOLEAN:
        raise fault(element, f"`{name}` must be true or false, got {shown(found)}")
    return _BOOLEAN[found] == "true"


def _number(value: Value) -> float | None:
    if isinstance(value, float):
        return value
    if "_" in value:  # a number in Python alone
        return None
    try:
        return float(value)
    except ValueError:
        return None


def plain(written: str) -> Value:
    """A literal: a number where it is one, else the text."""
    value = _number(written)
    return written if value is None else value


def worked_out(written: str, scope: Scope, element: Element) -> Value:
    """The value of what is written in an attribute: a literal, `$name`, or `${expression of $names}`."""
    written = written.strip()
    if not written.startswith("$"):
        return written
    if not written.startswith("${"):
        found = _REFERENCE.fullmatch(written)
        if found is None:
            raise fault(element, f"`{shown(written)}` cannot be read: a parameter is `$name`")
        return scope.get(found.group(1), element)
    if not written.endswith("}"):
        raise fault(element, f"`{shown(written)}` cannot be read: its bracket does not close")
    names: dict[str, float] = {}
    for name in _REFERENCE.findall(written[2:-1]):
        value = _number(scope.get(name, element))
        if value is None:
            raise fault(
                element, f"parameter `{name}` must be a number in an expression, got {shown(scope.values[name])}"
            )
        names[name] = value
    try:
        result = _evaluate(_tree(written[2:-1]), names, 0)
    except ZeroDivisionError:
        raise fault(element, f"expression `{shown(written)}` divides by zero") from None
    except (ValueError, OverflowError):
        raise fault(element, f"expression `{shown(written)}` has no value at these parameters") from None
    except _WrongExpressionError as error:
        raise fault(element, f"expression `{shown(written)}` {error}") from None
    if not math.isfinite(result):
        raise fault(element, f"expression `{shown(written)}` must be finite, got {result}")
    return float(result)


class _WrongExpressionError(Exception):
    """What an expression holds that the language does not have."""


@lru_cache(maxsize=2048)
def _tree(inner: str) -> ast.expr:
    if len(inner) > _LONGEST:
        raise _WrongExpressionError(f"must have at most {_LONGEST} characters")
    try:
        return ast.parse(_REFERENCE.sub(r"p_\1", inner).strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise _WrongExpressionError("cannot be read") from None


def _evaluate(node: ast.expr, names: Mapping[str, float], depth: int) -> float:
    if depth > _DEEPEST:
        raise _WrongExpressionError("is nested too deep")
    match node:
        case ast.Constant(value=value) if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        case ast.Name(id="pi" | "PI"):
            return math.pi
        case ast.Name(id=name) if name.startswith("p_") and name[2:] in names:
            return names[name[2:]]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_evaluate(operand, names, depth + 1)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _evaluate(operand, names, depth + 1)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            return _BINARY[type(op)](_evaluate(left, names, depth + 1), _evaluate(right, names, depth + 1))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in FUNCTIONS:
            function, count = FUNCTIONS[name]
            if len(args) != count:
                raise _WrongExpressionError(f"must give {count} values to `{name}`, got {len(args)}")
            return function(*(_evaluate(part, names, depth + 1) for part in args))
    held = re.sub(r"\bp_(?=[^\W\d])", "$", ast.unparse(node))  # as the file has it
    raise _WrongExpressionError(f"holds `{held[:60]}`; it has numbers, $names, + - * / %, pi and "
                                f"{', '.join(FUNCTIONS)}")  # fmt: skip


def compared(rule: str, one: Value, two: Value, element: Element) -> bool:
    """Whether a rule of OpenSCENARIO holds between two values; texts are equal or not."""
    if rule not in _RULES:
        raise fault(
            element,
            f"`rule` must be one of {', '.join(RULES)}, got {shown(rule)}.{did_you_mean(rule, RULES)}".rstrip("."),
        )
    first, second = _number(one), _number(two)
    if first is not None and second is not None:
        return _RULES[rule](first, second)
    if rule not in ("equalTo", "notEqualTo"):
        raise fault(element, f"`{rule}` must compare numbers, got {shown(one)} and {shown(two)}")
    return (str(one) == str(two)) == (rule == "equalTo")


def declared(
    parent: Element | None, given: Mapping[str, Value], around: Scope | None = None
) -> tuple[Scope, list[str]]:
    """The declared parameters at given values, in the order of the file, and the constraints that do not hold.

    around: what is known there besides; a parameter of the same name takes its place. Raises InputError for a given
    value that nobody declares.
    """
    scope = Scope({} if around is None else dict(around.values))
    broken: list[str] = []
    found = [] if parent is None else [part for part in children(parent) if part.tag == "ParameterDeclaration"]
    names = [attribute(part, "name") for part in found]
    for name in given:
        if name not in names:
            place = "The file" if parent is None else where(parent)
            raise InputError(f"{place}: parameter `{name}` is not declared.{did_you_mean(name, names)}")
    for earlier, (part, name) in enumerate(zip(found, names, strict=True)):
        if name in names[:earlier]:
            raise fault(part, f"parameter `{name}` is declared twice")
        scope.values[name] = given[name] if name in given else worked_out(str(part.get("value", "")), scope, part)
    for part, name in zip(found, names, strict=True):
        broken += _broken(part, name, scope)
    return scope, broken


def within(outer: Scope, part: Element) -> Scope:
    """What a story or a manoeuvre knows: all around it, and what its own <ParameterDeclarations> add or replace."""
    scope, broken = declared(part.find("ParameterDeclarations"), {}, outer)
    if broken:
        raise fault(part, f"a constraint does not hold: {broken[0]}")
    return scope


def _broken(part: Element, name: str, scope: Scope) -> list[str]:
    """Of several constraint groups one must hold, with all of its constraints."""
    groups = part.findall("ConstraintGroup")
    if not groups:
        return []
    for group in groups:
        if all(
            compared(attribute(it, "rule"), scope.values[name], worked_out(attribute(it, "value"), scope, it), it)
            for it in group.iterfind("ValueConstraint")
        ):
            return []
    wanted = " or ".join(
        " and ".join(f"{it.get('rule')} {it.get('value')}" for it in group.iterfind("ValueConstraint"))
        for group in groups
    )
    return [f"{name} {wanted}"]
