"""Scenario files of other formats than TOML: each format is an entry point of the group
`sumo_eval.scenarios`.

Its name is the ending, `xosc`; its object a `Format`, or a function `(path, options) ->
LogicalScenario`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

from sumo_eval.errors import InputError, said
from sumo_eval.gone import is_use_case, refuse_use_case
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings import ScenarioSettings

GROUP: Final = "sumo_eval.scenarios"
Entries = tuple[ScenarioSettings, ...]


@dataclass(frozen=True, slots=True)
class Format:
    """A reader of the scenario files of one ending.

    read: the scenario of a file, by its path and the options behind its name.
    expand: the entries in place of one, for files and catalogues that hold several scenarios.
    catalogues: what `use` may say instead of a file.
    samplings: ways to choose points: name -> function of a space and a `Request`, and the keys that
        it takes.
    """

    read: Callable[[Path, Mapping[str, str]], LogicalScenario]
    expand: Callable[[ScenarioSettings, Path], Entries] | None = None
    catalogues: tuple[str, ...] = ()
    samplings: Mapping[str, tuple[Callable[..., Any], frozenset[str]]] = field(default_factory=dict)


def format_of(path: str) -> Format | None:
    """The format of a file by its ending; None where no installed package reads it."""
    _, dot, ending = path.rpartition(".")
    # a shipped name looks at no other package
    return _loaded(ending) if dot and ending in _points() else None


def formats() -> Iterator[Format]:
    """Every installed format."""
    return map(_loaded, _points())


def expanded(entries: Entries, folder: Path) -> Entries:
    """One entry for each scenario: of catalogues, and of files that hold several.

    folder: where paths start.
    """
    found: list[ScenarioSettings] = []
    for entry in entries:
        if is_use_case(entry.use):
            refuse_use_case(entry.use)
        form = _form_of(entry.use)
        if entry.folder is not None and (form is None or entry.use not in form.catalogues):
            names = ", ".join(name for other in formats() for name in other.catalogues)
            raise InputError(f"`folder` of scenario `{entry.use}` is for catalogues: {names}.")
        found += [entry] if form is None or form.expand is None else form.expand(entry, folder)
    return tuple(found)


def _form_of(use: str) -> Format | None:
    """The format of an entry's file or catalogue; None for a shipped name, TOML and Python."""
    plain = use.partition("?")[0]
    if "." in plain or ":" in plain or plain in scenario_files():
        return format_of(plain)
    return next((form for form in formats() if plain in form.catalogues), None)


@cache
def _points() -> Mapping[str, EntryPoint]:
    """By ending. Raises InputError where two packages read one."""
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        ending = point.name.lstrip(".")
        other = found.setdefault(ending, point)
        if other.value != point.value:
            raise InputError(
                f"Files `.{ending}` must have one reader, got `{other.value}` and `{point.value}` "
                f"(entry points `{GROUP}`): uninstall one of their packages."
            )
    return found


@cache
def _loaded(ending: str) -> Format:
    point = _points()[ending]
    try:
        form = point.load()
    except Exception as error:  # of a package that is not ours
        raise InputError(
            f"The reader of `.{ending}` files, `{point.value}`, cannot be loaded: {said(error)}."
        ) from error
    return form if isinstance(form, Format) else Format(form)
