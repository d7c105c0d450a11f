"""Scenario files of other formats than TOML, for `catalogue.find` and the reader of an evaluation.

Each format is an entry point of the group `sumo_eval.scenarios`. Its name is the ending of the
files, e.g. `xosc`. Its object is a `Format`, or a function `(path, options) -> LogicalScenario`.

Users: `extras/openscenario/format.py`, `record/facts.py`, `record/fingerprint.py`,
`record/scenario_files.py`, `scenario/catalogue.py`, `scenario/sampling/samples.py`.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError, SumoEvalError, users_code
from sumo_eval.frozen import frozen
from sumo_eval.gone import refuse_use_case
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings import ScenarioSettings

GROUP = "sumo_eval.scenarios"
Entries = tuple[ScenarioSettings, ...]
"""The tables `[[scenario]]` of an evaluation."""


@frozen
class Format:
    """A reader of the scenario files of one ending.

    read: makes the scenario of a path and of the options after the `?` of `use`.
    expand: takes an entry and the folder where paths start; gives one entry for each scenario in
        the entry's file or catalogue. None: a file holds one scenario.
    catalogues: names that `use` may have instead of a file.
    samplings: methods of sampling that the format adds, by name: a function of a space and a
        `Request` (`scenario/sampling/request.py`), and the keys of `sampling` that it takes.
    """

    read: Callable[[Path, Mapping[str, str]], LogicalScenario]
    expand: Callable[[ScenarioSettings, Path], Entries] | None = None
    catalogues: tuple[str, ...] = ()
    samplings: Mapping[str, tuple[Callable[..., Any], frozenset[str]]] = field(default_factory=dict)


def format_of(path: str) -> Format | None:
    """The format of a file by its ending; None where no installed package reads it."""
    _, dot, ending = path.rpartition(".")
    # a text without a dot is a name: no need to look for installed packages
    return _loaded(ending) if dot and ending in _readers() else None


def formats() -> Iterator[Format]:
    """Every installed format; imports the package of each."""
    return map(_loaded, _readers())


def expanded(entries: Entries, folder: Path) -> Entries:
    """The entries, with one entry for each scenario in place of an entry of a catalogue or of a
    file with several scenarios.

    folder: where relative paths start.
    """
    single: list[ScenarioSettings] = []
    for entry in entries:
        refuse_use_case(entry.use)
        form = _form_of(entry.use)
        if entry.folder is not None and (form is None or entry.use not in form.catalogues):
            names = ", ".join(name for other in formats() for name in other.catalogues)
            raise InputError(f"`folder` of scenario `{entry.use}` is for catalogues: {names}.")
        with users_code(f"Scenario `{entry.use}` cannot be read", SumoEvalError):
            single += form.expand(entry, folder) if form and form.expand else [entry]
    return tuple(single)


def _form_of(use: str) -> Format | None:
    """The format of an entry's file or catalogue; None for a shipped scenario, TOML and Python."""
    plain = use.partition("?")[0]  # without its options
    # a file or an object is no catalogue: do not import the packages of all formats for it
    if "." in plain or ":" in plain or plain in scenario_files():
        return format_of(plain)
    return next((form for form in formats() if plain in form.catalogues), None)


@cache
def _readers() -> Mapping[str, EntryPoint]:
    """Entry points by ending. Raises InputError where two packages read one ending."""
    readers: dict[str, EntryPoint] = {}
    for reader in entry_points(group=GROUP):
        ending = reader.name.lstrip(".")
        other = readers.setdefault(ending, reader)
        if other.value != reader.value:
            raise InputError(
                f"Files `.{ending}` must have one reader, got `{other.value}` and `{reader.value}` "
                f"(entry points `{GROUP}`): uninstall one of their packages."
            )
    return readers


@cache
def _loaded(ending: str) -> Format:
    """The format of an ending that is installed."""
    reader = _readers()[ending]
    with users_code(f"The reader of `.{ending}` files, `{reader.value}`, cannot be loaded"):
        form = reader.load()
        if not isinstance(form, Format):
            form = Format(form)
        # for its error only, where a field of another package's format has a wrong type
        frozenset(form.catalogues).union(*(keys for _, keys in form.samplings.values()))
    return form
