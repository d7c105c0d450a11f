"""The one reader of TOML from outside: every mistake in a file is an error message."""

from __future__ import annotations

import os
import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from sumo_eval.errors import InputError
from sumo_eval.input_file import named, read_input_text
from sumo_eval.text import clean, shown, words_of

_NAMES = r"(?P<name>[\w-]+(?:\s*\.\s*[\w-]+)*|\"[^\"]*\"|'[^']*')"
_HEAD: Final = re.compile(rf"\s*\[(?P<list>\[)?\s*{_NAMES}\s*\]")
_KEY: Final = re.compile(rf"\s*{_NAMES}\s*=")
_LONG: Final = r"\"{3}(?:\\.|[^\\])*?\"{3,5}|'{3}.*?'{3,5}"
_QUOTED: Final = re.compile(rf"(?s:{_LONG})|\"(?:\\.|[^\"\\\n])*\"|'[^'\n]*'|#[^\n]*")

_LARGEST: Final = 50_000_000  # bytes of a file

DEEPEST: Final = 50
"""Tables and lists within each other that a file may hold."""


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The content of a TOML file, which `what` names in sentences: `evaluation file`.

    Raises InputError.
    """
    try:
        text = read_input_text(path, what, _LARGEST)
    except InputError as error:
        raise InputError(f"{error}{_instead_of(path)}") from None
    return toml_from(text, named(path, what))


def _instead_of(folder: Path) -> str:
    """Suggestion for a folder in place of a file, as the end of an error message."""
    if not os.path.isdir(folder):  # False for what no path may be, too
        return ""
    if (folder / "manifest.json").is_file():
        run = shlex.quote(str(folder))
        return (
            f" It holds a run: `sumo-eval score {run}` scores it, `sumo-eval report {run}` "
            "shows it."
        )
    files = sorted(path.name for path in folder.glob("*.toml") if path.is_file())
    return f" Did you mean `{folder / files[0]}`?" if files else ""


def line_of(text: str, place: Sequence[str | int]) -> int | None:
    """The line, from 1, on which the key stands that `place` leads to in a TOML text, e.g. ("ads",
    0, "name").

    A key within an inline table or a list is found by the line of the key that holds it. None: not
    in the text.
    """
    found: int | None = None
    best = 0
    table: tuple[str | int, ...] = ()
    counts: dict[tuple[str | int, ...], int] = {}
    for number, line in _outer_lines(text):
        if head := _HEAD.match(line):
            names: tuple[str | int, ...] = tuple(
                part.strip(" \t\"'") for part in head["name"].split(".")
            )
            parent = _within(names[:-1], counts)
            table = (*parent, names[-1])
            if head["list"]:
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            keys = table
        elif key := _KEY.match(line):
            keys = (*table, *(part.strip(" \t\"'") for part in key["name"].split(".")))
        else:
            continue
        common = min(len(keys), len(place))
        if common > best and tuple(place[:common]) == keys[:common]:
            found, best = number, common
    return found


def _outer_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines, numbered from 1, that do not begin within a text or a list over several lines."""
    brackets = 0
    flat = _QUOTED.sub(lambda it: "\n" * it[0].count("\n") or it[0], text)
    for number, line in enumerate(flat.split("\n"), start=1):  # as TOML and editors count
        if not brackets:
            yield number, line
        bare = _QUOTED.sub("", line)
        brackets += sum(map(bare.count, "[{")) - sum(map(bare.count, "]}"))


def _within(
    names: Sequence[str | int], counts: Mapping[tuple[str | int, ...], int]
) -> tuple[str | int, ...]:
    """The place of a table, with the number of the newest entry of every list of tables on the way
    to it.
    """
    place: tuple[str | int, ...] = ()
    for name in names:
        place = (*place, name)
        if place in counts:
            place = (*place, counts[place])
    return place


def toml_from(text: str, where: str) -> dict[str, Any]:
    """The content of a text in TOML.

    Raises InputError, whose sentences begin with `where`.
    """
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{where} must not be nested more than {DEEPEST} deep.") from None
    # TOMLDecodeError is one; a number of thousands of digits is another
    except ValueError as error:
        raise InputError(f"{where} is not valid TOML: {words_of(error)}.") from error
    _check(content, where)
    return content


def _check(value: Any, where: str, depth: int = 0) -> None:
    """Refuse what no setting can be, wherever it stands: nesting without end, text with control
    characters, numbers that no float can hold.
    """
    if depth == DEEPEST:
        raise InputError(f"{where} must not be nested more than {DEEPEST} deep.")
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, list):
        for item in value:
            _check(item, where, depth + 1)
    elif isinstance(value, str) and clean(flat := " ".join(value.split()), len(flat)) != flat:
        raise InputError(f"{where} must hold text without control characters, got {shown(value)}.")
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise InputError(f"{where} must hold integers of at most 64 bits, got {shown(value)}.")
