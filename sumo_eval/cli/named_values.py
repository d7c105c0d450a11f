"""Options that give values to names, NAME=VALUE."""

from __future__ import annotations

from collections.abc import Iterable


def named_values(texts: Iterable[str], option: str) -> dict[str, float]:
    """The numbers by name. option: what they were given with. Raises InputError for whatever has another form."""
    from sumo_eval.errors import InputError

    found = {}
    for name, value in named_texts(texts, option, "a number").items():
        if isinstance(value, str):
            raise InputError(f"{option} must have the form NAME=VALUE with a number, got {f'{name}={value}'!r}.")
        found[name] = value
    return found


def named_texts(texts: Iterable[str], option: str, kind: str = "a number or a word") -> dict[str, float | str]:
    """Numbers and words by name. Raises InputError for whatever has another form. kind: names what is asked for."""
    from sumo_eval.errors import InputError

    found: dict[str, float | str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"{option} must have the form NAME=VALUE with {kind}, got {text!r}.")
        try:
            found[name] = float(value)
        except ValueError:
            found[name] = value
    return found
