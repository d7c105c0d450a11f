"""The base of all settings: their meaning, unit and bounds, and the refusal of other values.

The bounds in a setting's annotation are the only place where a limit is written. A table of
settings that is made in Python checks them here; `sumo_eval.settings.config` has pydantic check the
same annotations in evaluation.toml.

Users: `cosim/doors/features.py`, `report/readings.py`, `scenario/`, `scoring/gate_settings.py`,
`settings/`, `extras/openscenario/points.py`, `extras/rates/campaign.py`,
`extras/studies/sensitivity.py`, `extras/wheel/`.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import astuple, field, fields
from numbers import Integral, Real
from types import UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from annotated_types import Ge, Gt, Le, Lt, MinLen

from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen


@frozen
class About:
    """Meaning of a setting, for the documentation, the schema and the report.

    symbol, equation: those of the paper, if it has any.
    """

    text: str
    unit: str = ""
    symbol: str = ""
    equation: str = ""

    @property
    def description(self) -> str:
        """The meaning and the unit."""
        return f"{self.text} ({self.unit})" if self.unit else self.text

    @property
    def metadata(self) -> dict[str, Any]:
        """Of a dataclass's field: for `about`, and for pydantic's schema."""
        return {"about": self, "description": self.description}

    def __get_pydantic_json_schema__(self, core: Any, handler: Callable[[Any], Any]) -> Any:
        """A key without a default in a JSON schema."""
        return {**handler(core), "description": self.description}


Default = TypeVar("Default")


def setting(
    default: Default, text: str, unit: str = "", symbol: str = "", equation: str = ""
) -> Default:
    """A key with a default, and its meaning; one without names its `About` in its annotation."""
    return field(default=default, metadata=About(text, unit, symbol, equation).metadata)


def optional(text: str, unit: str = "") -> Any:
    """A key that may be missing (None), and its meaning."""
    return setting(None, text, unit)


def empty_table(text: str) -> Any:
    """A key that is an empty table by default, and its meaning."""
    return field(default_factory=dict, metadata=About(text).metadata)


Positive = Gt(0.0)
NotNegative = Ge(0.0)
PositiveFloat = Annotated[float, Positive]
PositiveOrNone = Annotated[float | None, Positive]
NotNegativeFloat = Annotated[float, NotNegative]
Share = Annotated[NotNegativeFloat, Le(1.0)]
InnerShare = Annotated[PositiveFloat, Lt(1.0)]  # neither 0 nor 1
Natural = Annotated[int, Ge(0)]
PositiveInt = Annotated[int, Ge(1)]
FilledText = Annotated[str, MinLen(1)]


@functools.lru_cache(maxsize=64)
def hints_of(cls: Any) -> dict[str, Any]:
    """The annotations of a table of settings by key."""
    return get_type_hints(cls, include_extras=True)


def about(cls: Any, name: str) -> About:
    """The `About` of a setting; an empty one if it has none."""
    of_default = cls.__dataclass_fields__[name].metadata.get("about", About(""))
    marks = getattr(hints_of(cls)[name], "__metadata__", ())
    return next((mark for mark in marks if isinstance(mark, About)), of_default)


# annotation: (accepted type, words for it). A union or a Literal accepts any type here: the rule's
# `inner` or `choices` decide. `Any` accepts all.
_KINDS: dict[object, tuple[Any, str]] = {
    float: (Real, "a number"), int: (Integral, "a whole number"), bool: (bool, "true or false"),
    str: (str, "a text"), dict: (Mapping, "a table"), tuple: ((list, tuple), "a list"),
    **dict.fromkeys((Union, UnionType, Literal, Any), (object, "")),
}  # fmt: skip
# bound, whose only field is its limit: (test of a value and the limit, words before the limit)
_CHECKS: dict[type, tuple[Callable[[Any, Any], bool], str]] = {
    Gt: (operator.gt, "greater than"), Ge: (operator.ge, "at least"),
    Lt: (operator.lt, "less than"), Le: (operator.le, "at most"),
    MinLen: (lambda value, least: len(value) >= least, "no shorter than"),
}  # fmt: skip


class Checked:
    """Base of all settings: refuses, in Python as in a file, a value that does not fit its
    annotation.

    A subclass with a `__post_init__` of its own calls `Checked.__post_init__(self)` in it:
    `super()` fails in a dataclass with slots.
    """

    __slots__ = ()
    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        cls: type = type(self)
        for name, rule in _rules(cls):
            if wrong := _wrong(getattr(self, name), rule):
                place, demand, value = wrong
                raise must_be(f"`{name}{place}`", f"`{cls.__name__}`", demand, value)


class _Rule(NamedTuple):
    """Demands of an annotation on a value.

    form: outermost part of the annotation, e.g. dict of dict[str, float]; of a plain type: None.
    optional: whether None is accepted.
    choices: accepted values of a Literal; empty for other annotations.
    kind, kind_words: as in `_KINDS`.
    bounds: (test of a value and the limit, words before the limit, limit).
    inner: rules of the kinds of a union, of a table's keys and values, or of a list's items.
    """

    form: Any
    optional: bool
    choices: tuple[Any, ...]
    kind: Any
    kind_words: str
    bounds: tuple[tuple[Callable[[Any, Any], bool], str, Any], ...]
    inner: tuple[_Rule, ...]


@functools.lru_cache(maxsize=64)
def _rules(cls: Any) -> tuple[tuple[str, _Rule], ...]:
    """The rules of a class, computed once: settings are made for every case."""
    return tuple((item.name, _rule(hints_of(cls)[item.name])) for item in fields(cls))


def _rule(hint: Any) -> _Rule:
    """The rule of an annotation."""
    base, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    parts, form = get_args(base), get_origin(base)
    optional = type(None) in parts
    parts = tuple(it for it in parts if it not in (type(None), ...))
    if optional and len(parts) == 1:
        # The rule of the one kind beside None. `Annotated` must have a mark, and `marks` may be
        # empty: it also gets the mark None, which checks nothing.
        return _rule(Annotated[parts[0], *marks, None])._replace(optional=True)
    kind, kind_words = _KINDS.get(form or base) or (base, f"a table (`{base.__name__}`)")
    bounds = tuple(
        (*_CHECKS[type(mark)], *astuple(mark)) for mark in marks if type(mark) in _CHECKS
    )
    choices = parts if form is Literal else ()
    inner = () if choices else tuple(map(_rule, parts))
    return _Rule(form, optional, choices, kind, kind_words, bounds, inner)


Wrong = tuple[str, str, object]
"""A mistake: its place in a value (`.speed`, `[0]`, or "" for all of it), the demand on that part,
and the part."""


def _wrong(value: Any, rule: _Rule, place: str = "") -> Wrong | None:
    """The first mistake in a value; None: it has none.

    place: of the value in the whole setting.
    """
    if value is None and rule.optional:
        return None
    if rule.choices and value not in rule.choices:
        return place, "one of " + ", ".join(map(repr, rule.choices)), value
    number = rule.kind in (Real, Integral)
    if not isinstance(value, rule.kind) or (number and isinstance(value, bool)):
        return place, rule.kind_words, value
    if isinstance(value, float) and not math.isfinite(value):
        return place, "a finite number" if math.isinf(value) else "a number", value
    for holds, words, limit in rule.bounds:
        if not holds(value, limit):
            return place, f"{words} {limit:g}", value
    if rule.form in (dict, tuple):
        return _wrong_inside(value, rule, place)
    # only a union still has inner rules here: one of its kinds must accept the value
    wrongs = [wrong for it in rule.inner if (wrong := _wrong(value, it, place))]
    if not wrongs or len(wrongs) < len(rule.inner):
        return None
    words = " or ".join(dict.fromkeys(demand for _, demand, _ in wrongs))
    # a mistake in a part of the value says more than the kinds' demands on the whole: return it
    return next((it for it in wrongs if it[0] != place), (place, words, value))


def _wrong_inside(value: Any, rule: _Rule, place: str) -> Wrong | None:
    """The first mistake in a table or a list."""
    if rule.form is dict:
        items = [(f".{key}", item, rule.inner[1]) for key, item in value.items()]
    elif (length := len(rule.inner)) in (1, len(value)):  # 1: one rule for all items
        items = [(f"[{i}]", item, rule.inner[i % length]) for i, item in enumerate(value)]
    else:
        return place, f"a list of {length}", value
    wrongs = (_wrong(item, inner, place + at) for at, item, inner in items)
    return next(filter(None, wrongs), None)
