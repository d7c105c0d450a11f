"""ADSs that a caller in Python gives as a class, a function or an object instead of a locator, for
example from a notebook's cell.

A class or a function that a file holds gets a locator of this file; of a package, its import path,
`package.module:Name`. Anything else (an object, a lambda, one defined in a function, all of a
script or a cell) is pickled into the run folder by the user's own process, with the user's code
that it needs. Child processes only read it there.

Users: `record/facts.py`.
"""

import hashlib
import inspect
import pickletools
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import cloudpickle

from sumo_eval.errors import InputError, said
from sumo_eval.input_file import writing
from sumo_eval.record.run_folder import GIVEN, refuse_foreign
from sumo_eval.settings import AdsSettings

_OF_ONE_PROCESS = re.compile(
    "[0-9a-f]{12}4[0-9a-f]{3}[89ab][0-9a-f]{15}|ipykernel_[0-9]+|ipython-input-[0-9]+"
)
"""Texts of a pickle that differ from process to process: cloudpickle's random number of a class
(`uuid4`), and the file of a notebook's cell."""


def entry_of(ads: Any, run: Path, *, resume: bool) -> AdsSettings:
    """The `[[ads]]` entry of an ADS that is a class, a function, an object or already an entry.

    run: folder of the run, which need not exist yet.
    resume: whether that folder may hold a run.
    """
    if isinstance(ads, AdsSettings):
        return ads
    has_name = inspect.isclass(ads) or inspect.isfunction(ads)
    name = (ads if has_name else type(ads)).__name__.strip("<>")  # `<lambda>` without brackets
    if has_name and (place := _place(ads)):
        return AdsSettings(name, place)
    try:
        data = _pickled(ads)
    except Exception as error:
        raise InputError(
            f"ADS `{name}` cannot be sent to the processes that drive: {said(error)}. Make what it "
            "holds in its constructor or in `reset`, or give its locator, `my_ads.py:Name`."
        ) from error
    refuse_foreign(run, resume)
    file = (run / GIVEN / f"{name}-{_digest(data)[:12]}.pickle").resolve()
    with writing(f"The run folder {run}", file.parent):
        # A resumed run keeps its file: recorded drives are found by the file's bytes.
        if not file.exists():
            file.write_bytes(data)
    return AdsSettings(name, f"given:{file}")


def _place(ads: Any) -> str:
    """Locator, as `/path/my_ads.py:Name`, of a class or a function that its file holds under its
    own name, also within classes (`Outer.Inner`); else "".
    """
    module_name, name = ads.__module__, ads.__qualname__
    module = sys.modules.get(module_name)
    file = getattr(module, "__file__", None) if module_name != "__main__" else None
    held: Any = module
    for part in name.split("."):
        held = getattr(held, part, None)
    if not file or not file.endswith(".py") or held is not ads:
        return ""
    if "." in module_name:  # in a package, whose relative imports fail in a file by itself
        return f"{module_name}:{name}"
    return f"{Path(file).resolve()}:{name}"


def _pickled(ads: Any) -> bytes:
    """The ADS with all of users' code that it needs.

    Where this code holds what cannot be pickled, the ADS names its modules instead: then only
    processes with the `sys.path` of this one can drive it, and edits of the code are not noticed.
    """
    modules = [
        module
        for name, module in [*sys.modules.items()]
        if _is_users(module) and module.__name__ == name
    ]
    for module in modules:
        cloudpickle.register_pickle_by_value(module)
    try:
        with suppress(Exception):
            return bytes(cloudpickle.dumps(ads))
    finally:
        for module in modules:
            cloudpickle.unregister_pickle_by_value(module)
    return bytes(cloudpickle.dumps(ads))


def _is_users(module: Any) -> bool:
    """Whether a module is a Python file that is not installed."""
    file = getattr(module, "__file__", None)
    if not isinstance(file, str) or not file.endswith(".py") or "-packages" in file:
        return False
    return module.__name__.partition(".")[0] not in {"sumo_eval", *sys.stdlib_module_names}


def _digest(data: bytes) -> str:
    """A hash of a pickle that is the same in each process that pickles the same ADS.

    A set of texts in the code has an order of its own in each process: a resumed run repeats the
    drives of such an ADS.
    """
    digest = hashlib.sha256()
    for operation, argument, _ in pickletools.genops(data):
        if operation.name == "FRAME":  # a length, which the texts of one process change
            continue
        if isinstance(argument, str):
            argument = _OF_ONE_PROCESS.sub("", argument)
        content = argument if isinstance(argument, bytes) else repr(argument).encode()
        digest.update(operation.code.encode() + content)
    return digest.hexdigest()
