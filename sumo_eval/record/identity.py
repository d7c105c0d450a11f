"""Identities: texts that state what a case's facts depend on before it is driven. Recorded facts
are reused only for equal identities: `record.recording` makes a fingerprint of each case from them.
Files that an ADS reads while it drives: `record/reads.py`.

Fixed: the form of these texts, because another form makes all recorded facts stale.

Users: `extras/studies/qualification/table.py`, `extras/studies/trials.py`, `record/cluster.py`,
`record/engines.py`, `record/recording.py`, `record/run_folder.py`, `record/worker.py`.
"""

import ast
import json
import os
import shlex
import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

from sumo_eval.cosim.doors.controller import (
    SHIPPED,
    Adapter,
    adapted,
    called_by,
    located,
    takes_arrays,
)
from sumo_eval.cosim.doors.entry import split_entry
from sumo_eval.errors import must_be
from sumo_eval.input_file import hash_of, sha256
from sumo_eval.record.cases import Case
from sumo_eval.settings import AdsSettings, DriverSettings, EvaluationSettings, SimulationSettings
from sumo_eval.settings.locators import load_object

_PACKAGE = Path(__file__).parent.parent
_COMMANDS = ("exec", "traci")  # schemes of locators that name a command
# schemes of locators that name a command, a file, a model of SUMO or a pickled object
_NOT_PYTHON = (*_COMMANDS, "fmu", "onnx", "sumo", "given")
_ROOMS_THAT_MAKE_FACTS = ("ads", "cosim", "drivers", "scenario")
# files of other rooms that facts depend on; values of settings are in each fingerprint
_FILES_THAT_MAKE_FACTS = (
    "kernels.py",
    "trajectory.py",
    "settings/random_streams.py",
    *(f"method/{name}.py" for name in ("checks", "criticality", "driving_task", "measures")),
    *(f"record/{name}.py" for name in ("claims", "worker")),
)


@cache
def harness_identity() -> str:
    """Versions of the simulator and of this package, and hashes of its files that facts depend on.

    Computed once in a process: a Dask worker that runs for long keeps the code that it has loaded,
    even if the files change.
    """
    return _text(
        {
            "sumo_eval": version("sumo_eval"),
            "libsumo": version("libsumo"),
            "sources": sources_of_facts(_PACKAGE),
        }
    )


def sources_of_facts(package: Path) -> dict[str, str]:
    """Hashes of the files of this package that facts depend on, code and the shipped scenarios, by
    path in the package.
    """
    rooms = [package / room for room in _ROOMS_THAT_MAKE_FACTS]
    files = sorted(
        file for room in rooms for ending in ("*.py", "*.toml") for file in room.rglob(ending)
    )
    files += [package / name for name in _FILES_THAT_MAKE_FACTS]
    return {str(file.relative_to(package)): hash_of(file, "file") for file in files}


def locator_identity(named: tuple[str, str], folder: Path) -> str:
    """Locator, version and hashes of the source files of an object that a user named.

    Raises InputError if it does not exist.

    named: its kind (`ADS`, or else e.g. `Human reference`), and its locator.

    Runs in a fresh child process, because finding an ADS means running its file. Source files of a
    Python object are the modules that its loading imports from its folder or its package; of a
    command, the files that its words name.
    """
    before = set(sys.modules)
    kind, locator = named
    if kind == "ADS":
        loaded, described, entry = located(locator, folder)
        # a class with neither `act` nor `step`: `adapted` makes an object, and refuses one that has
        # neither; of an ADS that ships, it also refuses wrong keys of an option that is a table
        if not called_by(loaded) or locator.partition("?")[0] in SHIPPED:
            adapted(loaded, described, entry.options)
    else:
        loaded = load_object(locator, folder, kind)
    of_python = locator.partition(":")[0] not in _NOT_PYTHON
    module = sys.modules.get(getattr(loaded, "__module__", "")) if of_python else None
    files = _own_files(module, before) if module is not None else named_files(locator, folder)
    # an ONNX policy has more files (the table beside the model, external weights) and a period
    policy = loaded.target if isinstance(loaded, Adapter) else None
    files |= set(getattr(policy, "files", ()))
    package = module.__name__.partition(".")[0] if module is not None else ""
    # a list of pairs, because files of different folders can have the same `_place`
    sources = sorted((_place(file, folder), hash_of(file, "file")) for file in files)
    more: dict[str, Any] = {"batch": True} if kind == "ADS" and takes_arrays(loaded) else {}
    if policy is not None and policy.interface.period:
        more["period"] = policy.interface.period
    return _text(
        {
            "locator": locator,
            "version": _version(package, module),
            "sources": sources,
            **more,
        }
    )


def period_of(identity: str) -> float:
    """The period that an ADS with this identity has by its own table, s; 0: none."""
    return float(json.loads(identity).get("period", 0.0))


def is_over_arrays(identity: str) -> bool:
    """Whether this is the identity of a policy over arrays."""
    return json.loads(identity).get("batch") is True


def files_identity(ads: AdsSettings, source: Path) -> str:
    """Hashes of the files that an ADS depends on by its entry (`files`); empty without such.

    Raises InputError for a file that does not exist.
    """
    for name in ads.files:
        if not (source / name).is_file():
            raise must_be("`files`", f"ADS `{ads.name}`", "files that are there", name)
    return _text({name: hash_of(source / name, "file") for name in ads.files}) if ads.files else ""


def people_identity(settings: DriverSettings, source: Path) -> str:
    """Identity of recorded drivers: how they are chosen, and hashes of their files."""
    hashes = _hashes(settings.recordings, settings.cases, source)
    return _text({"settings": repr(settings), "files": hashes})


def hashes_of_inputs(settings: EvaluationSettings, source: Path) -> dict[str, str]:
    """Hashes, by path, of files whose content changes drives or exposures of all ADSs: recordings,
    drives recorded in named cases, the FMU of the vehicle.

    A scenario's own files are not among them (`scenario_files.hashes_of_scenario`).
    """
    drivers, plant = settings.drivers, settings.simulation.plant
    exposures = [entry.exposure for entry in settings.scenario if entry.exposure.kind == "recorded"]
    names = [name for it in exposures for name in it.recordings or drivers.recordings]
    if plant is not None:
        names.append(plant.file)
    if drivers.source != "recorded":
        return _hashes(names, "", source)
    return _hashes([*names, *drivers.recordings], drivers.cases, source)


def _hashes(names: Iterable[str], cases: str, source: Path) -> dict[str, str]:
    """Hashes, by path, of the named files and of all tables in the folder `cases`; "": no folder.

    A file that does not exist has none.
    """
    folder = source / cases
    files = {name: source / name for name in names}
    tables = sorted(folder.rglob("*.csv")) if cases else []
    files |= {f"{cases}/{file.relative_to(folder)}": file for file in tables}
    return {name: hash_of(file, "file") for name, file in files.items() if file.is_file()}


def with_fingerprint(
    case: Case, simulation: SimulationSettings, identity: str, harness: str
) -> Case:
    """The case with a hash of everything that its facts depend on.

    Limits of `[run]`, on time and memory, are not part of it.
    """
    content = repr((replace(case, fingerprint=""), simulation, identity, harness))
    return replace(case, fingerprint=sha256(content))


def _own_files(module: ModuleType, before: set[str]) -> set[Path]:
    """Files of a module, and of the modules imported along with it from its package or folder.

    before: names of the modules that were loaded before it.
    """
    own, top = _file(module), module.__name__.partition(".")[0]
    if own is None:
        return set()
    files = {own}
    for name in sys.modules.keys() - before:
        file = _file(sys.modules[name])
        if file is not None and (
            name.partition(".")[0] == top
            or (file.is_relative_to(own.parent) and "site-packages" not in file.parts)
        ):
            files.add(file)
    return files


def _file(module: Any) -> Path | None:
    name = getattr(module, "__file__", None)
    return Path(name) if isinstance(name, str) and Path(name).is_file() else None


def named_files(locator: str, folder: Path) -> set[Path]:
    """Files that the words of a command name, and modules beside a Python program that it
    imports; of any other locator, its file.
    """
    scheme, _, named = split_entry(locator)[0].partition(":")
    try:  # in a locator of a file, options follow the path after a `?`; a command may hold a `?`
        words = shlex.split(named) if scheme in _COMMANDS else [named.partition("?")[0]]
    except ValueError:  # an open quotation mark
        return set()
    files = set()
    # not Path.is_file, which raises for a word that is too long for a path
    new = {folder / word for word in words if os.path.isfile(folder / word)}
    homes = {file.parent for file in new}
    while new:
        file = new.pop()
        files.add(file)
        # imports are looked for in the file's folder and in those above it, up to the folder of a
        # file that the command names
        folders = [
            parent for parent in file.parents if any(parent.is_relative_to(home) for home in homes)
        ]
        new |= {module for parent in folders for module in _imported(file, parent)} - files
    return files


def _imported(program: Path, folder: Path) -> set[Path]:
    """Files below a folder that the import statements of a Python program name."""
    try:
        nodes = [*ast.walk(ast.parse(program.read_bytes()))] if program.suffix == ".py" else []
    except (SyntaxError, ValueError, OSError, RecursionError):
        nodes = []
    names = {name.name for node in nodes if isinstance(node, ast.Import) for name in node.names}
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            names |= {f"{node.module or ''}.{name.name}".strip(".") for name in node.names}
    # importing `a.b.c` runs `a` and `a.b` too; each may be a file or a package
    places = {folder.joinpath(*name.split(".")) for name in names}
    places |= {parent for path in places for parent in path.parents if folder in parent.parents}
    files = {file for path in places for file in (path.with_suffix(".py"), path / "__init__.py")}
    return {file for file in files if file.is_file()}


def _version(package: str, module: ModuleType | None) -> str:
    try:
        return version(package) if package else ""
    except PackageNotFoundError:
        return str(getattr(module, "__version__", ""))


def _place(file: Path, folder: Path) -> str:
    """Path of a file relative to the evaluation's folder, else to a folder of `sys.path`, else its
    name. Another machine gives the same.
    """
    if file.is_relative_to(folder):
        return str(file.relative_to(folder))
    home = next((parent for parent in file.parents if str(parent) in sys.path), file.parent)
    return str(file.relative_to(home))


def _text(content: dict[str, Any]) -> str:
    return json.dumps(content, sort_keys=True)
