"""The one reader of TOML from outside: whatever is wrong with a file is a sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Final

from sumo_eval.errors import InputError
from sumo_eval.text import clean, shown, words_of

DEEPEST: Final = 50
"""Tables and lists within each other that a file may hold."""


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The content of a TOML file, which `what` names in sentences: `evaluation file`. Raises InputError."""
    where = clean(f"{what} {path}")
    where = where[0].upper() + where[1:]
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"There is no {clean(f'{what} {path}')}.") from None
    except (OSError, ValueError) as error:  # a path can hold what no path may, too
        raise InputError(f"{where} cannot be read: {words_of(error)}.") from error
    return toml_from(text, where)


def toml_from(text: str, where: str) -> dict[str, Any]:
    """The content of a text in TOML. Raises InputError, whose sentences begin with `where`."""
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{where} must not be nested more than {DEEPEST} deep.") from None
    except ValueError as error:  # TOMLDecodeError is one; a number of thousands of digits is another
        raise InputError(f"{where} is not valid TOML: {words_of(error)}.") from error
    _check(content, where)
    return content


def _check(content: dict[str, Any], where: str) -> None:
    """Refuse what no setting can be, wherever it stands: nesting without end, text with control characters, numbers
    that no float can hold.
    """
    level: list[Any] = [content]
    for _ in range(DEEPEST):
        inner: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                inner += [*value, *value.values()]
            elif isinstance(value, list):
                inner += value
            elif isinstance(value, str) and clean(flat := " ".join(value.split()), len(flat)) != flat:
                raise InputError(f"{where} must hold text without control characters, got {shown(value)}.")
            elif isinstance(value, int) and not -(2**63) <= value < 2**63:
                raise InputError(f"{where} must hold integers of at most 64 bits, got {shown(value)}.")
        level = inner
        if not level:
            return
    raise InputError(f"{where} must not be nested more than {DEEPEST} deep.")
