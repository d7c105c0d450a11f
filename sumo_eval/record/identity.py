"""Dependencies of a case's facts, as short texts that are equal exactly when the facts may be taken
over.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import shlex
import sys
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

from sumo_eval.cosim.doors.controller import find_controller, takes_arrays
from sumo_eval.cosim.doors.entry import split_entry
from sumo_eval.errors import must_be
from sumo_eval.input_file import hash_of
from sumo_eval.record.cases import Case
from sumo_eval.settings import AdsSettings, DriverSettings, SimulationSettings
from sumo_eval.settings.locators import load_object

_PACKAGE = Path(__file__).parent.parent
# locators of commands and files, not of Python objects
_COMMANDS = ("exec", "traci")
_NOT_PYTHON = (*_COMMANDS, "fmu", "onnx", "sumo", "given")
_ROOMS_THAT_MAKE_FACTS = ("ads", "cosim", "drivers", "scenario")


@cache
def harness_identity() -> str:
    """Versions of the simulator and of this package, and hashes of those files of it that change
    what a drive comes to.

    Asked for once: a process that lives long, such as a Dask worker, continues with the code that
    it has loaded.
    """
    return _text(
        {
            "sumo_eval": version("sumo_eval"),
            "libsumo": version("libsumo"),
            "sources": sources_of_facts(_PACKAGE),
        }
    )


def sources_of_facts(package: Path) -> dict[str, str]:
    """Hashes of the files of this package that facts depend on, by path in it: code and the shipped
    scenarios.
    """
    rooms = [package / room for room in _ROOMS_THAT_MAKE_FACTS]
    files = sorted(
        file for room in rooms for ending in ("*.py", "*.toml") for file in room.rglob(ending)
    )
    files += [
        package / "kernels.py",
        *(package / "record" / name for name in ("claims.py", "worker.py")),
    ]
    return {str(file.relative_to(package)): hash_of(file, "file") for file in files}


def locator_identity(named: tuple[str, str], folder: Path) -> str:
    """Locator, version and hashes of the source files of what a user named.

    Raises InputError when it is not there.

    named: what it is (`ADS`, or else e.g. `Human reference`), and its locator.

    Runs in a fresh child process, because finding an ADS means running its file. Source files are
    the modules that loading it brings in and in its folder or its package; of a command,
    the files that its words name.
    """
    before = set(sys.modules)
    kind, locator = named
    found = (
        find_controller(locator, folder) if kind == "ADS" else load_object(locator, folder, kind)
    )
    in_words = locator.partition(":")[0] in _NOT_PYTHON
    module = None if in_words else sys.modules.get(getattr(found, "__module__", ""), None)
    files = _own_files(module, before) if module is not None else named_files(locator, folder)
    # such as a model's table
    files |= {Path(file) for file in getattr(getattr(found, "target", None), "files", ())}
    base = module.__name__.partition(".")[0] if module is not None else ""
    # pairs: files of several folders elsewhere may have one place
    sources = sorted((_place(file, folder), hash_of(file, "file")) for file in files)
    over_arrays = {"batch": True} if kind == "ADS" and takes_arrays(found) else {}
    return _text(
        {"locator": locator, "version": _version(base, module), "sources": sources, **over_arrays}
    )


def is_over_arrays(identity: str) -> bool:
    """Whether this is the identity of a policy over arrays."""
    return json.loads(identity).get("batch") is True


def files_identity(ads: AdsSettings, source: Path) -> str:
    """Hashes of the files that an ADS says it depends on.

    Raises InputError for one that is not there.
    """
    for name in ads.files:
        if not (source / name).is_file():
            raise must_be("`files`", f"ADS `{ads.name}`", "files that are there", name)
    return _text({name: hash_of(source / name, "file") for name in ads.files}) if ads.files else ""


def people_identity(settings: DriverSettings, source: Path) -> str:
    """Identity of recorded drivers: how they are chosen, and hashes of their files."""
    folder = source / settings.cases
    files = {name: source / name for name in settings.recordings}
    cases = sorted(folder.rglob("*.csv")) if settings.cases else []
    files |= {f"{settings.cases}/{file.relative_to(folder)}": file for file in cases}
    hashes = {name: hash_of(file, "file") for name, file in files.items() if file.is_file()}
    return _text({"settings": repr(settings), "files": hashes})


def with_fingerprint(
    case: Case, simulation: SimulationSettings, identity: str, harness: str
) -> Case:
    """The case with the hash of everything that its facts depend on; limits of time and memory are
    not among it.
    """
    content = repr((replace(case, fingerprint=""), simulation, identity, harness))
    return replace(case, fingerprint=hashlib.sha256(content.encode()).hexdigest())


def _own_files(module: ModuleType, before: set[str]) -> set[Path]:
    """Files of the modules that came with a module and belong to it."""
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
    try:  # a command's words may hold a `?`
        words = shlex.split(named) if scheme in _COMMANDS else [named.partition("?")[0]]
    except ValueError:
        return set()
    files: set[Path] = set()
    # Path.is_file raises for a word that is too long for a name
    new = {folder / word for word in words if os.path.isfile(folder / word)}
    homes = {file.parent for file in new}
    while new:
        file = new.pop()
        files.add(file)
        folders = [
            parent for parent in file.parents if any(parent.is_relative_to(home) for home in homes)
        ]
        new |= {found for parent in folders for found in _imported(file, parent)} - files
    return files


def _imported(program: Path, folder: Path) -> set[Path]:
    """Files below a folder that a Python program imports, as its words say."""
    try:
        nodes = [*ast.walk(ast.parse(program.read_bytes()))] if program.suffix == ".py" else []
    except (SyntaxError, ValueError, OSError, RecursionError):
        nodes = []
    names = {name.name for node in nodes if isinstance(node, ast.Import) for name in node.names}
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            names |= {f"{node.module or ''}.{name.name}".strip(".") for name in node.names}
    places = {folder.joinpath(*name.split(".")) for name in names}
    places |= {parent for place in places for parent in place.parents if folder in parent.parents}
    files = {file for place in places for file in (place.with_suffix(".py"), place / "__init__.py")}
    return {file for file in files if file.is_file()}


def _version(package: str, module: ModuleType | None) -> str:
    try:
        return version(package) if package else ""
    except PackageNotFoundError:
        return str(getattr(module, "__version__", ""))


def _place(file: Path, folder: Path) -> str:
    """Relative to the evaluation where possible: the same run on another machine is the same
    run.
    """
    if file.is_relative_to(folder):
        return str(file.relative_to(folder))
    home = next((parent for parent in file.parents if str(parent) in sys.path), file.parent)
    return str(file.relative_to(home))


def _text(content: dict[str, Any]) -> str:
    return json.dumps(content, sort_keys=True)
