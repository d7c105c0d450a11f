"""Reading of a user's TOML file, and the line of a mistake in it. `settings/checked.py` checks keys
and values.

Users: `cli/tools.py`, `extras/wheel/command.py`, `nightly/night.py`, `record/facts.py`,
`scenario/file.py`, `settings/checked.py`, `settings/config.py`.
"""

import os
import re
import shlex
import tomllib
from collections.abc import Iterator
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

_FILE_SIZE = 50_000_000  # bytes of a file

DEEPEST = 50
"""Greatest depth to which tables and lists may be nested in a file."""
_TOO_DEEP = f"must not be nested more than {DEEPEST} deep."

Place = tuple[str | int, ...]
"""Names and indices that lead to a key or a table, e.g. ("ads", 0, "name")."""


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The content of a TOML file.

    what: its name in error messages, as `evaluation file`.
    Raises InputError.
    """
    try:
        text = read_input_text(path, what, _FILE_SIZE)
    except InputError as error:
        raise InputError(f"{error}{_folder_hint(path)}") from None
    return toml_from(text, named(path, what))


def _folder_hint(path: Path) -> str:
    """Last sentence of an error message: what to name instead of a folder; "" for a file."""
    if not os.path.isdir(path):  # `Path.is_dir` raises for a long name
        return ""
    if (path / "manifest.json").is_file():
        run = shlex.quote(str(path))
        return (
            f" It holds a run: `sumo-eval score {run}` scores it, `sumo-eval report {run}` "
            "shows it."
        )
    files = sorted(it for it in path.glob("*.toml") if it.is_file())
    return f" Did you mean `{files[0]}`?" if files else ""


def line_of(text: str, place: Place) -> int | None:
    """The line, from 1, of a key in a TOML text, or of what holds it: an inline table, a list, or,
    where the key is missing, its table; None: nothing of it is in the text.
    """
    # by line: the number of names and indices that it shares with the beginning of `place`
    shared: dict[int, int] = {}
    for number, keys in _places(text):
        length = min(len(keys), len(place))
        if length and keys[:length] == place[:length]:
            shared[number] = length
    return max(shared, key=lambda number: shared[number], default=None)


def _places(text: str) -> Iterator[tuple[int, Place]]:
    """Lines with a key or the head of a table: number from 1, and place of the key or table."""
    table: Place = ()  # that the lines are in
    newest: dict[Place, int] = {}  # by list of tables: index of its newest entry
    for number, line in _outer_lines(text):
        head = _HEAD.match(line)
        named_line = head or _KEY.match(line)
        if not named_line:
            continue
        names = [part.strip("\"'") for part in re.findall(_NAME, named_line["name"])]
        if head:
            table = ()
            for name in names:
                if table in newest:
                    table = (*table, newest[table])
                table = (*table, name)
            if head["list"]:
                newest[table] = newest.get(table, -1) + 1
                table = (*table, newest[table])
        yield number, table if head else (*table, *names)


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


def toml_from(text: str, where: str) -> dict[str, Any]:
    """The content of a text in TOML.

    where: beginning of error messages, as `evaluation.toml`.
    Raises InputError.
    """
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{where} {_TOO_DEEP}") from None
    # TOMLDecodeError is a ValueError; so is the error of a number with thousands of digits
    except ValueError as error:
        raise InputError(f"{where} is not valid TOML: {words_of(error)}.") from error
    refuse_unfit(content, where)
    return content


def refuse_unfit(value: Any, where: str, depth: int = 0) -> None:
    """Refuse deep nesting, control characters in a text, and integers of more than 64 bits: no
    setting can have these.
    """
    if depth == DEEPEST:
        raise InputError(f"{where} {_TOO_DEEP}")
    if isinstance(value, dict):
        value = [*value, *value.values()]  # keys are texts too
    if isinstance(value, list):
        for item in value:
            refuse_unfit(item, where, depth + 1)
    # line breaks and tabs are allowed
    elif isinstance(value, str) and UNFIT.search(value.replace("\r", "")):
        raise InputError(f"{where} must hold text without control characters, got {shown(value)}.")
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise InputError(f"{where} must hold integers of at most 64 bits, got {shown(value)}.")
