"""The logical scenarios that ship: the scenario files in `sumo_eval/scenario/files`; and how a user
names one.

A file is read when its scenario is asked for, once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Final

from sumo_eval.errors import InputError, unknown
from sumo_eval.gone import is_use_case, refuse_use_case
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.formats import GROUP, format_of
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings.locators import load_object


class _Shipped(Mapping[str, LogicalScenario]):
    """The shipped logical scenarios by name, each without options."""

    def __getitem__(self, name: str) -> LogicalScenario:
        if name not in scenario_files():
            raise KeyError(name)
        return load(name)

    def __contains__(self, name: object) -> bool:
        return name in scenario_files()

    def __iter__(self) -> Iterator[str]:
        return iter(scenario_files())

    def __len__(self) -> int:
        return len(scenario_files())


SCENARIOS: Final[Mapping[str, LogicalScenario]] = _Shipped()


def find(use: str, folder: Path | None = None) -> LogicalScenario:
    """A logical scenario by its shipped name, or `file.toml`, a file of another installed format,
    `module:name`, `file.py:name` relative to `folder`.

    After the name of a shipped one or of a file options may stand:
    `cut_in?lateral_acceleration=1.5`.
    """
    plain, given = options_of(use)
    if plain.endswith(".toml"):
        return read_scenario((Path.cwd() if folder is None else folder) / plain, given)
    if form := format_of(plain):
        return form.read((Path.cwd() if folder is None else folder) / plain, given)
    if is_use_case(plain):
        refuse_use_case(plain)
    if ":" not in plain:
        return load(use)
    found = load_object(use, folder, "Logical scenario")
    if not isinstance(found, LogicalScenario):
        raise InputError(
            f"Logical scenario `{use}` must be a LogicalScenario, got {type(found).__name__}."
        )
    return found


def is_file(use: str) -> bool:
    """Whether a `use` names a file with a scenario of its own, not a shipped one and no Python."""
    plain = use.partition("?")[0]
    return plain.endswith(".toml") or format_of(plain) is not None


@cache
def load(name: str) -> LogicalScenario:
    """The shipped logical scenario of that name, with options if it has any:
    `cut_in?lateral_acceleration=1.5`.
    """
    plain, given = options_of(name)
    files = scenario_files()
    if plain not in files:
        _, dot, ending = plain.rpartition(".")
        if not dot:
            raise unknown("logical scenario", plain, files)
        again = (
            " It is one of sumo_eval's own: `pip install -e .` once more."
            if ending == "xosc"
            else ""
        )
        raise InputError(
            f"Unknown logical scenario `{plain}`: no installed package reads `.{ending}` files, "
            "which the entry point "
            f"`{ending}` of the group `{GROUP}` would do.{again}"
        )
    return read_scenario(files[plain], given)


def options_of(use: str) -> tuple[str, dict[str, str]]:
    """The part before the options of `cut_in?a=1&b=2`, and the options by name, as written."""
    plain, asks, options = use.partition("?")
    given: dict[str, str] = {}
    for option in options.split("&") if asks else ():
        key, _, value = option.partition("=")
        if key in given:
            raise InputError(f"Option `{key}` of `{use}` must be given once.")
        given[key] = value
    return plain, given
