"""The one reader of the user's TOML files: every mistake in a file becomes an error message.

Users: `cli/tools.py`, `extras/wheel/command.py`, `scenario/file.py`, `settings/config.py`.
"""

import os
import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.input_file import named, read_input_text
from sumo_eval.text import UNFIT, shown, words_of

_NAME = r"(?:[\w-]+|\"[^\"]*\"|'[^']*')"
# a name, or several, as a.b."c d"
_NAMES = rf"(?P<name>{_NAME}(?:\s*\.\s*{_NAME})*)"
# [table] or [[list of tables]]
_HEAD = re.compile(rf"\s*\[(?P<list>\[)?\s*{_NAMES}\s*\]")
# name =
_KEY = re.compile(rf"\s*{_NAMES}\s*=")
# text in three quotes, which may have several lines and end with up to two quotes more
_LONG = r"\"{3}(?:\\.|[^\\])*?\"{3,5}|'{3}.*?'{3,5}"
# any text, or a comment
_QUOTED = re.compile(rf"(?s:{_LONG})|\"(?:\\.|[^\"\\\n])*\"|'[^'\n]*'|#[^\n]*")

_LARGEST = 50_000_000  # bytes of a file

DEEPEST = 50
"""How deep tables and lists may be nested in a file."""


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The content of a TOML file.

    what: its name in error messages, as `evaluation file`.
    Raises InputError.
    """
    try:
        text = read_input_text(path, what, _LARGEST)
    except InputError as error:
        raise InputError(f"{error}{_instead_of(path)}") from None
    return toml_from(text, named(path, what))


def _instead_of(folder: Path) -> str:
    """Last sentence of an error message: what to name instead of a folder; "" for a file."""
    if not os.path.isdir(folder):  # `Path.is_dir` raises for a long name
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
    """The line, from 1, of a key in a TOML text; None: not in the text.

    place: names and indices that lead to the key, e.g. ("ads", 0, "name").

    For a key within an inline table or a list it is the line of the key that holds these.
    """
    best_line: int | None = None
    best_length = 0
    table: tuple[str | int, ...] = ()  # place of the table that the lines are in
    last: dict[tuple[str | int, ...], int] = {}  # index of the newest entry of a list of tables
    for number, line in _outer_lines(text):
        head = _HEAD.match(line)
        named_line = head or _KEY.match(line)
        if not named_line:
            continue
        names = [part.strip("\"'") for part in re.findall(_NAME, named_line["name"])]
        if head:
            table = (*_within(names[:-1], last), names[-1])
            if head["list"]:
                last[table] = last.get(table, -1) + 1
                table = (*table, last[table])
        keys = table if head else (*table, *names)
        # the line that agrees with the longest beginning of `place`, and of these the first
        length = min(len(keys), len(place))
        if length > best_length and tuple(place[:length]) == keys[:length]:
            best_line, best_length = number, length
    return best_line


def _outer_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines, numbered from 1, that do not begin within a text or a list over several lines."""
    open_brackets = 0
    # of a text over several lines only its line breaks stay; a text in one line stays whole
    flat = _QUOTED.sub(lambda it: "\n" * it[0].count("\n") or it[0], text)
    # by "\n" only, as TOML and editors count; `splitlines` splits at more
    for number, line in enumerate(flat.split("\n"), start=1):
        if not open_brackets:
            yield number, line
        bare = _QUOTED.sub("", line)
        open_brackets += sum(map(bare.count, "[{")) - sum(map(bare.count, "]}"))


def _within(
    names: Sequence[str], last: Mapping[tuple[str | int, ...], int]
) -> tuple[str | int, ...]:
    """The place of a table by its names: each list of tables on the way stands for its newest
    entry, whose index is in `last`.
    """
    place: tuple[str | int, ...] = ()
    for name in names:
        place = (*place, name)
        if place in last:
            place = (*place, last[place])
    return place


def toml_from(text: str, where: str) -> dict[str, Any]:
    """The content of a text in TOML.

    where: beginning of error messages, as `evaluation.toml`.
    Raises InputError.
    """
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{where} must not be nested more than {DEEPEST} deep.") from None
    # TOMLDecodeError is a ValueError; so is the error of a number with thousands of digits
    except ValueError as error:
        raise InputError(f"{where} is not valid TOML: {words_of(error)}.") from error
    _check(content, where)
    return content


def _check(value: Any, where: str, depth: int = 0) -> None:
    """Refuse deep nesting, control characters in a text, and integers of more than 64 bits: no
    setting can have these.
    """
    if depth == DEEPEST:
        raise InputError(f"{where} must not be nested more than {DEEPEST} deep.")
    if isinstance(value, dict):
        value = [*value, *value.values()]  # keys are texts too
    if isinstance(value, list):
        for item in value:
            _check(item, where, depth + 1)
    # line breaks and tabs are allowed
    elif isinstance(value, str) and UNFIT.search(value.replace("\r", "")):
        raise InputError(f"{where} must hold text without control characters, got {shown(value)}.")
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise InputError(f"{where} must hold integers of at most 64 bits, got {shown(value)}.")
