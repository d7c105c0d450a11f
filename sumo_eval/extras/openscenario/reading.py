"""Elements of OpenSCENARIO files, for all readers here: every fault names file, line, element.

Users: `extras/openscenario/`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from sumo_eval.errors import InputError, did_you_mean
from sumo_eval.extras.openscenario.values import (
    RULES,
    Value,
    WrongValueError,
    holds,
    number_of,
    worked_out,
)
from sumo_eval.input_file import changed_at, input_file
from sumo_eval.scenario.xml_file import Element, read_xml
from sumo_eval.text import shown

Choice = TypeVar("Choice")
_VERSIONS = ("1.0", "1.1", "1.2", "1.3")
_BOOLEAN = {"true": True, "false": False, "1": True, "0": False}
# a parameter whose name says km/h, such as `$Ego_kph`, without an expression around it
_IN_KMH = re.compile(r"\$(\w+_)?(kph|kmh|kmph)", re.IGNORECASE)


@lru_cache(maxsize=64)
def _read_once(path: Path, changed: int) -> Node:
    """`read_openscenario`, cached. changed: time of the file's last change, a part of the key."""
    root = read_root(path, "OpenSCENARIO")
    header = root.child("FileHeader")
    version = f"{header.get('revMajor', '?')}.{header.get('revMinor', '?')}"
    if version not in _VERSIONS:
        raise header.fault(
            f"its version must be one of {', '.join(_VERSIONS)}, got {shown(version)}"
        )
    return root


def read_root(path: Path, kind: str) -> Node:
    """The root of an XML file, which must be of a kind: `OpenSCENARIO` or `OpenDRIVE`."""
    root = Node(read_xml(path, f"{kind} file"))
    if root.tag != kind:
        raise root.fault(f"its root must be <{kind}>, got <{root.tag}>")
    return root


def read_openscenario(path: Path) -> Node:
    """The root of an OpenSCENARIO file of a supported version."""
    return _read_once(path, watch(input_file(path, "OpenSCENARIO file")))


_WATCHED: dict[Path, int] = {}
"""Files and folders on which scenes depend -> time of the last change that `watch` noticed."""
_CHANGES: list[Path] = []
"""One entry for each change that `watch` noticed."""


def watch(path: Path) -> int:
    """Note that scenes depend on a file or folder; return the time of its last change
    (`changed_at`).
    """
    now = changed_at(path)
    if _WATCHED.setdefault(path, now) != now:
        _WATCHED[path] = now
        _CHANGES.append(path)
    return now


def changes(*paths: Path) -> int:
    """Number of changes of files and folders that `watch` has noticed since the program began.

    A scene depends on its file, on catalogs and on a map. Caches of scenes have this number in
    their key, so that each change makes them read again.

    paths: those to look at now; none: all on which scenes depend.
    """
    for path in paths or [*_WATCHED]:
        watch(path)
    return len(_CHANGES)


@dataclass(slots=True, eq=False)
class Node:
    """An element of a file, and the parameters that are declared where it stands.

    Methods raise an InputError with file, line and element where something is missing or wrong.
    `get`, `attribute` and `parameter` return an attribute as it is written. The other methods for
    attributes work its value out: a literal, `$name` or `${expression}`.

    values: parameter -> its value.
    entries: (catalog, entry) of each reference that led to this element. A reference to one of
        them again would be a circle.
    """

    element: Element
    values: Mapping[str, Value] = field(default_factory=dict)
    entries: tuple[tuple[str, str], ...] = ()

    @property
    def tag(self) -> str:
        """The element's kind, as `SpeedAction`."""
        return str(self.element.tag)

    @property
    def file(self) -> Path:
        """The file that the element was read from."""
        return Path(str(self.element.getroottree().docinfo.URL))

    @property
    def where(self) -> str:
        """Place of the element for messages, as `CCRs.xosc, line 120, <SpeedAction>`."""
        return f"{self.file.name}, line {self.element.sourceline}, <{self.tag}>"

    def fault(self, text: str) -> InputError:
        """The error that says what is wrong with the element.

        text: `value must be a number, got 'x'`, with or without a full stop or question mark.
        """
        text = text.rstrip(".")
        return InputError(f"{self.where}: {text}{'' if text.endswith('?') else '.'}")

    def unsupported(self, alternatives: str = "") -> InputError:
        """The error that the element is not supported.

        alternatives: what is supported, as `moves that are: SpeedAction`.
        """
        rest = f": {alternatives}" if alternatives else ""
        return self.fault(f"this is not supported{rest}, and nothing is guessed instead")

    def chosen(self, known: Mapping[str, Choice], what: str) -> Choice:
        """The entry of `known` for the element's kind. A kind without an entry is not supported.

        known: kind -> entry, such as the function that reads it.
        what: name of the known kinds in the error, as `moves`.
        """
        if self.tag not in known:
            raise self.unsupported(f"{what} that are: {', '.join(known)}")
        return known[self.tag]

    # -- what is in it -----------------------------------------------------------------------------

    def get(self, name: str, default: Any = None) -> Any:
        """An attribute as it is written."""
        return self.element.get(name, default)

    def all(self, path: str) -> list[Node]:
        """The elements at an XPath below this one."""
        return [replace(self, element=it) for it in self.element.iterfind(path)]

    def find(self, path: str) -> Node | None:
        """The first element at an XPath below this one; None: there is none.

        A second child of one name is a fault. A path with `/` may lead to several elements.
        """
        parts = self.all(path)
        if len(parts) > 1 and "/" not in path:
            raise self.fault(f"it must hold one <{path.partition('[')[0]}>, got {len(parts)}")
        return parts[0] if parts else None

    def children(self) -> list[Node]:
        """The child elements; `*` leaves out comments."""
        return self.all("*")

    def only_child(self) -> Node:
        """The only child element."""
        parts = self.children()
        if len(parts) != 1:
            raise self.fault(f"it must hold one element, got {len(parts)}")
        return parts[0]

    def child(self, name: str) -> Node:
        """The only child element of a name."""
        part = self.find(name)
        if not part:
            raise self.fault(f"<{name}> is missing in it")
        return part

    # -- its attributes ----------------------------------------------------------------------------

    def attribute(self, name: str) -> str:
        """An attribute as it is written."""
        written = self.get(name)
        if written is None:
            raise self.fault(f"`{name}` is missing")
        return str(written)

    def parameter(self, name: str) -> str:
        """An attribute that names a parameter, without the `$` that some writers put before it."""
        return self.attribute(name).removeprefix("$")

    def one_of(self, name: str, known: tuple[str, ...], default: str | None = None) -> str:
        """An attribute that must be one of some words; default: the word where it is missing."""
        word = self.text(name, default)
        if word != default and word not in known:
            near = did_you_mean(word, known)
            raise self.fault(
                f"`{name}` must be one of {', '.join(known)}, got {shown(word)}.{near}"
            )
        return word

    def worked_out(self, written: str) -> Value:
        """The value of a written literal, `$name` or `${expression of $names}`."""
        try:
            return worked_out(written, self.values)
        except WrongValueError as error:
            raise self.fault(str(error)) from None

    def text(self, name: str, default: str | None = None) -> str:
        """An attribute as text; a whole number without its decimal point."""
        if default is not None and self.get(name) is None:
            return default
        value = self.worked_out(self.attribute(name))
        if isinstance(value, str):
            return value
        return str(int(value)) if value.is_integer() else repr(value)

    def number(self, name: str, default: float | None = None) -> float:
        """An attribute as a finite number."""
        if default is not None and self.get(name) is None:
            return default
        written = self.attribute(name)
        if _IN_KMH.fullmatch(written.strip()):
            raise self.fault(
                f"`{name}` must be in m/s, got {written}, which by its name is in km/h: "
                f"${{{written} / 3.6}}"
            )
        result = self.worked_out(written)
        value = number_of(result)
        if value is None or not math.isfinite(value):
            is_what = "" if result == written else f", which is {shown(result)}"
            raise self.fault(f"`{name}` must be a finite number, got {shown(written)}{is_what}")
        return value

    def above_zero(self, name: str, unit: str = "") -> float:
        """An attribute as a number above 0; unit: for the message, as ` m`."""
        value = self.number(name)
        if value <= 0.0:
            raise self.fault(f"`{name}` must be above 0{unit}, got {value:g}")
        return value

    def not_negative(self, name: str, default: float | None = None, unit: str = "") -> float:
        """An attribute as a number of at least 0; unit: for the message, as ` m`."""
        value = self.number(name, default)
        if value < 0.0:
            raise self.fault(f"`{name}` must be at least 0{unit}, got {value:g}")
        return value

    def whole(self, name: str) -> int:
        """An attribute as a whole number."""
        value = self.number(name)
        if not value.is_integer():
            raise self.fault(f"`{name}` must be a whole number, got {value:g}")
        return int(value)

    def flag(self, name: str) -> bool:
        """An attribute that is true or false; false where it is missing."""
        text = self.text(name, "false")
        if text not in _BOOLEAN:
            raise self.fault(f"`{name}` must be true or false, got {shown(text)}")
        return _BOOLEAN[text]

    def compared(self, one: Value, two: Value, default: str | None = None) -> bool:
        """Whether the element's `rule`, such as `lessThan`, holds between two values.

        Texts can only be equal or not.

        default: the rule where the element has none.
        """
        rule = self.one_of("rule", RULES, default)
        truth = holds(rule, one, two)
        if truth is None:
            raise self.fault(f"`{rule}` must compare numbers, got {shown(one)} and {shown(two)}")
        return truth

    # -- what is known in it -----------------------------------------------------------------------

    def declared(self, given: Mapping[str, Value]) -> tuple[Node, list[str]]:
        """The element with the parameters that its <ParameterDeclarations> add or replace, and
        a text on each parameter whose constraints do not hold.

        given: parameter -> value instead of the declared one.

        Raises InputError for a given value without a declaration.
        """
        values = dict(self.values)
        written = dict[str, str]()
        # all parts share the dictionary `values`, which the loop over them fills
        parts = [
            (part.parameter("name"), replace(part, values=values))
            for part in self.all("ParameterDeclarations/ParameterDeclaration")
        ]
        names = dict(parts)
        for name in given:
            if name not in names:
                near = did_you_mean(name, names)
                holder = self.find("ParameterDeclarations") or self
                raise holder.fault(f"parameter `{name}` is not declared.{near}")
        for name, part in parts:
            value = part.get("value", "")
            if written.setdefault(name, value) != value:
                raise part.fault(f"parameter `{name}` is declared twice, with other values")
            # a value may name parameters that are declared above it
            values[name] = given[name] if name in given else part.worked_out(value)
        broken = [why for name, part in parts for why in part._broken(name)]
        return replace(self, values=values), broken

    def within(self) -> Node:
        """The story or manoeuvre with its own parameters added; their constraints must hold."""
        inner, broken = self.declared({})
        if broken:
            raise self.fault(f"a constraint does not hold: {broken[0]}")
        return inner

    def _broken(self, name: str) -> Iterator[str]:
        """The constraint groups of a parameter's declaration as one text; nothing if they hold.

        They hold where all constraints of one group hold, and where there is no group.
        """
        groups = [group.all("ValueConstraint") for group in self.all("ConstraintGroup")]
        for group in groups:
            wanted = [(it, it.worked_out(it.attribute("value"))) for it in group]
            if all(it.compared(self.values[name], value) for it, value in wanted):
                return
        if groups:
            texts = (
                " and ".join(f"{it.get('rule')} {it.get('value')}" for it in group)
                for group in groups
            )
            yield f"{name} {' or '.join(texts)}"
