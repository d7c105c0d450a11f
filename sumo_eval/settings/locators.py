"""Find what a user names: `package.module:name`, or `path/to/file.py:name` relative to the
evaluation file.

Users: `cases.py`, `cosim/doors/controller.py`, `evaluation.py`, `method/severity.py`, `record/`,
`results.py`, `scenario/`.
"""

import hashlib
import importlib
import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from unicodedata import normalize

from sumo_eval.errors import InputError, did_you_mean, users_code
from sumo_eval.gone import MODULES
from sumo_eval.input_file import hash_of
from sumo_eval.text import words_of

FOLDERS: list[str] = []
"""Folders of users' files that this process has made importable."""


def load_object(locator: str, folder: Path | None, kind: str) -> Any:
    """The object that a locator names.

    Raises InputError when there is no such file, module or name, or when importing it fails.

    folder: where relative paths start, and where modules are also looked for. None: paths start in
        the current folder, and modules are looked for only where Python finds them.
    kind: of the object, for errors, e.g. `ADS`.
    """
    module, colon, name = locator.rpartition(":")
    owner = f"{kind} `{locator}`"
    if not colon or not module or not name:
        raise InputError(f"{owner} must have the form `package.module:name` or `file.py:name`.")
    load = _load_file if module.endswith(".py") else _load_module
    value: Any = load(module, folder, owner)
    # Python reads names in its source in this form; macOS may give them in another
    for part in normalize("NFKC", name).split("."):
        try:
            # a module may have a `__getattr__` of its own, which may fail
            with users_code(f"{owner}: `{name}` of `{module}` failed", AttributeError):
                value = getattr(value, part)
        except AttributeError as error:
            public = [item for item in dir(value) if not item.startswith("_")]
            hint = did_you_mean(part, public)
            raise InputError(f"{owner}: `{module}` has no `{name}`.{hint}") from error
    return value


def _load_module(name: str, folder: Path | None, owner: str) -> ModuleType:
    _make_importable(folder)
    try:
        with users_code(f"{owner}: importing `{name}` failed", ModuleNotFoundError):
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        # True if the named module, or a package around it, is missing. False if the module exists
        # and imports a module that is missing.
        if error.name is not None and (name == error.name or name.startswith(error.name + ".")):
            instead = f" It was removed: {MODULES[name]}." if name in MODULES else ""
            raise InputError(f"{owner}: there is no module `{name}` to import.{instead}") from error
        raise InputError(f"{owner}: importing `{name}` failed: {words_of(error)}.") from error


def _load_file(file: str, folder: Path | None, owner: str) -> ModuleType:
    path = Path(os.path.realpath((folder or Path()) / file))  # a loop of links raises no error
    try:
        content = hash_of(path, "file")
    except InputError as error:
        raise InputError(f"{owner}: {error}") from None
    # the content is part of the name: a file that is edited while a notebook runs is a new module
    digest = hashlib.sha256(bytes(path) + content.encode()).hexdigest()[:12]
    name = f"_sumo_eval_file_{path.stem}_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    _make_importable(path.parent)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{owner}: {path} is not a Python file.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        with users_code(f"{owner}: running {path} failed"):
            spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _make_importable(folder: Path | None) -> None:
    """Let the user's file import its neighbours, after everything that is installed."""
    if folder is not None and str(folder) not in sys.path:
        sys.path.append(str(folder))
        FOLDERS.append(str(folder))
