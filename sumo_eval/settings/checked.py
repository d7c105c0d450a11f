"""The base of all settings: their meaning, unit and bounds, and the refusal of other values.

The `Annotated` bounds of a setting are the only place where a limit is written: a setting made in
Python is checked here, and `sumo_eval.settings.config` hands the same annotations to the reader of
evaluation.toml.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    get_args,
    get_origin,
    get_type_hints,
)

from annotated_types import Ge, Gt, Le, Lt, MinLen

from sumo_eval.errors import must_be


@dataclass(frozen=True, slots=True)
class About:
    """Meaning of a setting, for the documentation, the schema and the report."""

    text: str
    unit: str = ""
    symbol: str = ""
    equation: str = ""


# the bounds alone are for settings that may be None: Annotated[float | None, Positive]
Positive = Gt(0.0)
NotNegative = Ge(0.0)
PositiveFloat = Annotated[float, Positive]
NotNegativeFloat = Annotated[float, NotNegative]


@functools.lru_cache(maxsize=64)
def hints_of(cls: Any) -> dict[str, Any]:
    """The annotations of a table of settings by key."""
    return get_type_hints(cls, include_extras=True)


def about(cls: type, name: str) -> About:
    """The `About` of a setting (an empty one where a setting has none)."""
    hint = hints_of(cls)[name]
    for extra in getattr(hint, "__metadata__", ()):
        if isinstance(extra, About):
            return extra
    return About("")


# annotation: (what is accepted, its words)
_KINDS: dict[object, tuple[type, str]] = {
    float: (Real, "a number"), int: (Integral, "a whole number"), bool: (bool, "true or false"),
    str: (str, "a text"),
}  # fmt: skip
# (bound, its attribute with the limit, test of a value and the limit, words before the limit)
_CHECKS: tuple[tuple[type, str, Callable[[Any, Any], bool], str], ...] = (
    (Gt, "gt", operator.gt, "greater than"),
    (Ge, "ge", operator.ge, "at least"),
    (Lt, "lt", operator.lt, "less than"),
    (Le, "le", operator.le, "at most"),
    (MinLen, "min_length", lambda value, least: len(value) >= least, "no shorter than"),
)


class Checked:
    """Base of all settings: refuses a value outside the bounds that its annotation states.

    Tables, tuples and values of several types (`int | dict`) are not checked here, only by the
    reader of files. A `__post_init__` of a subclass calls `Checked.__post_init__(self)`: a
    dataclass with slots has no `super()`.
    """

    __slots__ = ()
    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        cls: type = type(self)
        owner = f"`{cls.__name__}`"
        for rule in _rules(cls):
            value = getattr(self, rule.name)
            if value is None and rule.optional:
                continue
            if rule.choices and value not in rule.choices:
                raise must_be(
                    f"`{rule.name}`", owner, "one of " + ", ".join(map(repr, rule.choices)), value
                )
            kind = rule.kind
            if not isinstance(value, kind) or (
                isinstance(value, bool) and kind in (Real, Integral)
            ):
                raise must_be(f"`{rule.name}`", owner, rule.kind_words, value)
            if isinstance(value, float) and not math.isfinite(value):
                wanted = "a finite number" if math.isinf(value) else "a number"
                raise must_be(f"`{rule.name}`", owner, wanted, value)
            # None gets here where the kind of a setting is not checked
            for holds, limit, words in rule.bounds if value is not None else ():
                if not holds(value, limit):
                    raise must_be(f"`{rule.name}`", owner, f"{words} {limit:g}", value)


class _Rule(NamedTuple):
    """Demands of a setting's annotation on its value.

    kind: accepted type; object: not checked.
    bounds: (test of a value and the limit, limit, words before the limit).
    """

    name: str
    optional: bool
    choices: tuple[Any, ...]
    kind: type
    kind_words: str
    bounds: tuple[tuple[Callable[[Any, Any], bool], Any, str], ...]


@functools.lru_cache(maxsize=64)
def _rules(cls: Any) -> tuple[_Rule, ...]:
    """The rules of a class, computed once: settings are made for every case."""
    rules = []
    for item in fields(cls):
        hint = hints_of(cls)[item.name]
        base = get_args(hint)[0] if get_origin(hint) is Annotated else hint
        optional = type(None) in get_args(base)
        if optional:
            kinds = set(get_args(base)) - {type(None)}
            base = kinds.pop() if len(kinds) == 1 else base  # float | None -> float
        choices = get_args(base) if get_origin(base) is Literal else ()
        kind, kind_words = _KINDS.get(base, (object, ""))
        bounds = tuple(
            (holds, getattr(extra, attribute), words)
            for extra in getattr(hint, "__metadata__", ())
            for bound_type, attribute, holds, words in _CHECKS
            if isinstance(extra, bound_type)
        )
        rules.append(_Rule(item.name, optional, choices, kind, kind_words, bounds))
    return tuple(rules)
