"""The base of all settings: their meaning, unit and bounds, and the refusal of other values.

The annotation of a setting is the only place where its kind and its bounds are written. `fitted`
compares a value with them, in Python and in a file. pydantic makes JSON schemas of them.

Users: `cosim/doors/features.py`, `report/readings.py`, `scenario/`, `scoring/gate_settings.py`,
`settings/`, `extras/openscenario/points.py`, `extras/rates/campaign.py`,
`extras/studies/sensitivity.py`, `extras/wheel/`.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, astuple, field, fields
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

from annotated_types import Ge, Gt, Le, Lt, MinLen, MultipleOf

from sumo_eval.errors import InputError, did_you_mean, nearest
from sumo_eval.frozen import About
from sumo_eval.settings.toml_file import Place
from sumo_eval.text import shown

Default = TypeVar("Default")


def setting(
    default: Default, text: str, unit: str = "", symbol: str = "", equation: str = ""
) -> Default:
    """A key with a default, and its meaning; one without is `frozen.required`."""
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


@functools.cache
def hints_of(cls: Any) -> dict[str, Any]:
    """The annotations of a table of settings by key."""
    return get_type_hints(cls, include_extras=True)


def about(cls: Any, name: str) -> About:
    """The `About` of a setting; an empty one if it has none."""
    meaning: About = cls.__dataclass_fields__[name].metadata.get("about", About(""))
    return meaning


_UNIONS = (Union, UnionType)
# annotation: (accepted type, words for it). A Literal accepts any type here: the rule's `choices`
# decide. `Any` accepts all.
_KINDS: dict[object, tuple[Any, str]] = {
    float: (Real, "a number"), int: (Integral, "a whole number"), bool: (bool, "true or false"),
    str: (str, "a text"), dict: (Mapping, "a table"), tuple: ((list, tuple), "a list"),
    **dict.fromkeys((*_UNIONS, Literal, Any), (object, "")),
}  # fmt: skip
# bound, whose only field is its limit: (test of a value and the limit, words with `{}` for it).
# `.15g` writes a million in full. `MinLen` is used with 1 alone.
_CHECKS: dict[type, tuple[Callable[[Any, Any], bool], str]] = {
    Gt: (operator.gt, "greater than {:.15g}"), Ge: (operator.ge, "at least {:.15g}"),
    Lt: (operator.lt, "less than {:.15g}"), Le: (operator.le, "at most {:.15g}"),
    MinLen: (lambda value, least: len(value) >= least, "non-empty"),
    MultipleOf: (lambda value, step: value % step == 0, "a multiple of {:.15g}"),
}  # fmt: skip


class Checked:
    """Base of all settings: refuses, in Python as in a file, a value that does not fit its
    annotation.

    A subclass with a `__post_init__` of its own calls `Checked.__post_init__(self)` in it:
    `super()` fails in a dataclass with slots.
    """

    __slots__ = ()
    # for JSON schemas: a table has no other keys
    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        cls: type = type(self)
        for name, rule in _rules(cls).items():
            mistakes: list[Mistake] = []
            fitted(getattr(self, name), rule, (name,), mistakes)
            if mistakes:
                raise InputError(mistakes[0].sentence(f"of `{cls.__name__}`"))


class _Rule(NamedTuple):
    """Demands of an annotation on a value.

    form: outermost part of the annotation: `dict` of dict[str, float], `tuple`, `Literal` or a
        union; None for a plain type such as `float`.
    optional: whether None is accepted.
    choices: accepted values of a Literal; empty for other annotations.
    kind, kind_words: as in `_KINDS`; of settings in a table of their own, their class.
    bounds: (test of a value and the limit, words with `{}` for it, limit).
    inner: rules of the kinds of a union, of a table's keys and values, or of a list's items.
    """

    form: Any
    optional: bool
    choices: tuple[Any, ...]
    kind: Any
    kind_words: str
    bounds: tuple[tuple[Callable[[Any, Any], bool], str, Any], ...]
    inner: tuple[_Rule, ...]

    @property
    def is_table(self) -> bool:
        """Whether values are settings in a table of their own."""
        return isinstance(self.kind, type) and issubclass(self.kind, Checked)


@functools.cache
def _rules(cls: Any) -> dict[str, _Rule]:
    """The rules of a class by key, computed once: settings are made for every case."""
    return {item.name: _rule(hints_of(cls)[item.name]) for item in fields(cls)}


def _rule(hint: Any) -> _Rule:
    """The rule of an annotation."""
    base, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    parts, form = get_args(base), get_origin(base)
    optional = type(None) in parts
    parts = tuple(it for it in parts if it not in (type(None), ...))
    if optional and len(parts) == 1:
        # `float | None` has the rule of float, which also accepts None. The mark None checks
        # nothing: `Annotated` must have a mark, and `marks` may be empty.
        return _rule(Annotated[parts[0], *marks, None])._replace(optional=True)
    kind, kind_words = _KINDS.get(form or base) or (base, "a table")
    bounds = tuple(
        (*_CHECKS[type(mark)], *astuple(mark)) for mark in marks if type(mark) in _CHECKS
    )
    assert not (bounds and form in _UNIONS), f"{hint}: write a bound at each kind of the union"
    choices = parts if form is Literal else ()
    inner = () if choices else tuple(map(_rule, parts))
    return _Rule(form, optional, choices, kind, kind_words, bounds, inner)


class Mistake(NamedTuple):
    """A mistake in settings, of which `sentence` makes a message.

    place: of the wrong value in its owner; (): the whole owner.
    begin, end: of the message. The path of the place and the owner stand between them.
    demand: what the value must be; "" for a missing or unknown key and for keys that contradict
        each other.
    """

    place: Place
    end: str
    begin: str = ""
    demand: str = ""

    def sentence(self, owner: str) -> str:
        """The message.

        owner: of the value, as "of `RunSettings`" or "in evaluation.toml".
        """
        path = "".join(
            f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.place
        ).removeprefix(".")
        subject = f"`{path}` {owner}" if self.place else owner.removeprefix("in ")
        return f"{self.begin}{subject}{self.end}"


def _wrong(place: Place, demand: str, value: object, choices: Sequence[object] = ()) -> Mistake:
    """The mistake of a value that does not meet a demand.

    choices: accepted values; the message offers the text that is most similar to the value.
    """
    texts = [choice for choice in choices if isinstance(choice, str)]
    near = nearest(value, texts) if isinstance(value, str) else None
    hint = "" if near is None else f" Did you mean `{near}`?"
    return Mistake(place, f" must be {demand}, got {shown(value)}.{hint}", demand=demand)


def fitted(
    value: Any, rule: _Rule, place: Place, mistakes: list[Mistake], *, plain: bool = False
) -> Any:
    """A value compared with the rule of its setting; returns the value that the setting keeps.

    place: of the value, for messages.
    mistakes: all mistakes in the value are added to it.
    plain: whether the value comes from a file. Then tables of settings become objects, lists become
        tuples, and whole numbers become floats, where the rule asks for these. A value from Python
        must have its final type; the result is not used.
    """
    if value is None and rule.optional:
        return None
    if rule.form in _UNIONS:
        return _fitted_to_any(value, rule, place, mistakes, plain=plain)
    if plain and rule.is_table and isinstance(value, dict):
        return read_table(value, rule.kind, place, mistakes)

    demand = (plain and _heading(value, rule, place)) or _unmet(value, rule)
    if demand:
        if rule.is_table and not plain:
            demand += f" (`{rule.kind.__name__}`)"
        mistakes.append(_wrong(place, demand, value, rule.choices))
        return value
    if rule.form is dict:
        of_key, of_item = rule.inner
        for key in value:
            if demand := _unmet(key, of_key):
                mistakes.append(_wrong(place, f"a table with {demand} as each key", key))
        return {
            key: fitted(item, of_item, (*place, key), mistakes, plain=plain)
            for key, item in value.items()
        }
    if rule.form is tuple:
        rules = rule.inner  # one for all items, or one for each
        return tuple(
            fitted(item, rules[index % len(rules)], (*place, index), mistakes, plain=plain)
            for index, item in enumerate(value)
        )
    return float(value) if plain and rule.kind is Real else value


def _unmet(value: Any, rule: _Rule) -> str:
    """The first demand that a value as a whole does not meet; "" if there is none. `fitted` checks
    the parts of a table or a list.
    """
    if rule.choices and value not in rule.choices:
        choices = ", ".join(map(repr, rule.choices))
        return f"one of {choices}" if len(rule.choices) > 1 else choices
    number = rule.kind in (Real, Integral)
    if not isinstance(value, rule.kind) or (number and isinstance(value, bool)):
        return rule.kind_words
    if (isinstance(value, float) or rule.kind is Real) and not _is_finite(value):
        return "a finite number" if value == value else "a number"
    for holds, words, limit in rule.bounds:
        if not holds(value, limit):
            return words.format(limit)
    # one inner rule holds for all items
    if rule.form is tuple and len(rule.inner) not in (1, len(value)):
        return f"a list of {len(rule.inner)}"
    return ""


def _is_finite(number: Any) -> bool:
    """Whether a number is finite, also as a float."""
    try:
        return math.isfinite(number)
    except OverflowError:  # a whole number beyond all floats
        return False


def _fitted_to_any(
    value: Any, rule: _Rule, place: Place, mistakes: list[Mistake], *, plain: bool
) -> Any:
    """`fitted` for a union: the first kind that accepts the value decides. `int` stands before
    `float` in an annotation, so that whole numbers of a file stay whole.
    """
    refusals: list[Mistake] = []
    for kind in rule.inner:
        of_kind: list[Mistake] = []
        made = fitted(value, kind, place, of_kind, plain=plain)
        if not of_kind:
            return made
        refusals += of_kind
    # Mistakes in a part of the value, or in keys that contradict each other, say more than the
    # kinds' demands on the whole.
    inside = [mistake for mistake in refusals if mistake.place != place or not mistake.demand]
    demands = dict.fromkeys(mistake.demand for mistake in refusals)
    # last "one table: write [zone], ...": the words after it would be read as a part of it
    demand = " or ".join(sorted(demands, key=lambda demand: ":" in demand))
    choices = [choice for kind in rule.inner for choice in kind.choices]
    mistakes += inside or [_wrong(place, demand, value, choices)]
    return value


def _heading(value: Any, rule: _Rule, place: Place) -> str:
    """The demand on a table that must be a list of tables, or the reverse; "" for other values."""
    table = ".".join(part for part in place if isinstance(part, str))
    if isinstance(value, dict) and rule.form is tuple and rule.inner[0].is_table:
        return f"a list of tables: write [[{table}]], with two brackets, not [{table}]"
    # an entry of a list of tables, `ads[0]`, has no brackets to be corrected
    if isinstance(value, list) and rule.is_table and isinstance(place[-1], str):
        return f"one table: write [{table}], with one bracket, not [[{table}]]"
    return ""


def read_table(content: Mapping[str, Any], kind: Any, place: Place, mistakes: list[Mistake]) -> Any:
    """Settings of a kind from a table of a file; None if there is a mistake in it.

    place, mistakes: as in `fitted`.
    """
    before = len(mistakes)
    rules, values = _rules(kind), {}
    for item in fields(kind):
        name, here = item.name, (*place, item.name)
        if name in content:
            values[name] = fitted(content[name], rules[name], here, mistakes, plain=True)
        elif item.default is MISSING and item.default_factory is MISSING:
            mistakes.append(Mistake(here, " is missing."))
    for name in content:
        if name not in rules:
            end = f".{did_you_mean(name, rules)}"
            mistakes.append(Mistake((*place, name), end, "Unknown key "))
    if len(mistakes) > before:
        return None
    try:
        return kind(**values)
    except InputError as error:  # its keys do not fit each other
        mistakes.append(Mistake(place, f": {error}"))
        return None
