"""The logical scenarios that ship, the files in `sumo_eval/scenario/files`, and the lookup of any
logical scenario by the text `use` of an evaluation.

A shipped file is read once, when its scenario is first asked for. The names of shipped scenarios
and the form of `use` are public; users' evaluations contain them.

Users: `cli/`, `record/`, `report/export_case.py`, `scenario/resolved.py`, `extras/`.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path

from sumo_eval.errors import InputError, SumoEvalError, doubled, unknown, users_code
from sumo_eval.gone import refuse_use_case
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.formats import GROUP, format_of
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings.locators import load_object

SCENARIOS = tuple(scenario_files())
"""Names of the shipped logical scenarios."""


def find(use: str, folder: Path | None = None) -> LogicalScenario:
    """A logical scenario by `use`, one of:

    - the name of a shipped one: `cut_in`
    - a scenario file: `file.toml`, or a file of another installed format
    - a Python object: `module:name` or `file.py:name`

    After a name or a file options may follow: `cut_in?lateral_acceleration=1.5`.

    folder: where relative paths start; None: the current folder.
    """
    plain, options = options_of(use)
    if reader := _reader_of(plain):
        with users_code(f"Logical scenario `{use}` cannot be read", SumoEvalError):
            logical = reader((folder or Path.cwd()) / plain, options)
    else:
        refuse_use_case(plain)
        if ":" not in plain:
            return load(use)
        logical = load_object(use, folder, "Logical scenario")
    if not isinstance(logical, LogicalScenario):
        raise InputError(
            f"Logical scenario `{use}` must be a LogicalScenario, got {type(logical).__name__}."
        )
    return logical


def _reader_of(file: str) -> Callable[..., LogicalScenario] | None:
    """Reader of a scenario file by its ending; None if no installed reader has that ending."""
    if file.endswith(".toml"):
        return read_scenario
    form = format_of(file)
    return form.read if form else None


def is_file(use: str) -> bool:
    """Whether a `use` names a scenario file, not a shipped scenario or a Python object."""
    return _reader_of(use.partition("?")[0]) is not None


@cache
def load(name: str) -> LogicalScenario:
    """The shipped logical scenario of that name, with options if it has any:
    `cut_in?lateral_acceleration=1.5`.
    """
    plain, options = options_of(name)
    files = scenario_files()
    if plain not in files:
        ending = Path(plain).suffix[1:]
        if ending in ("", "toml"):  # a name, or a TOML file, which only `find` reads
            raise unknown("logical scenario", plain, files)
        # this package reads .xosc itself: an installation older than that reader lacks the entry
        own = " It is one of sumo_eval's own: `pip install -e .` once more."
        again = own if ending == "xosc" else ""
        raise InputError(
            f"Unknown logical scenario `{plain}`: no installed package reads `.{ending}` files, "
            f"which the entry point `{ending}` of the group `{GROUP}` would do.{again}"
        )
    return read_scenario(files[plain], options)


def options_of(use: str) -> tuple[str, dict[str, str]]:
    """The part before the options of `cut_in?a=1&b=2`, and the options by name, as written."""
    plain, mark, text = use.partition("?")
    options = [option.partition("=") for option in text.split("&")] if mark else []
    if double := doubled(key for key, _, _ in options):
        raise InputError(f"Option `{double[0]}` of `{use}` must be given once.")
    return plain, {key: value for key, _, value in options}
