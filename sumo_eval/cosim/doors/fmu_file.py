"""Files of FMUs: unpacked, and checked to be of a supported kind, with a library for this platform.

Users: `cosim/doors/fmu.py`.
"""

import functools
import tempfile
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError, must_be, needs_extra, users_code
from sumo_eval.input_file import changed_at, input_file

_unpack_folders: list[tempfile.TemporaryDirectory[str]] = []  # removed when the process ends


def open_fmu(path: Path) -> tuple[Any, str, Any]:
    """The library fmpy, the folder into which an FMU was unpacked, and its model description."""
    try:
        import fmpy
    except ImportError as error:
        raise needs_extra("An FMU", "fmu") from error
    input_file(path, "FMU")
    with users_code(f"FMU {path} cannot be read"):
        folder, model = _unpacked(path, changed_at(path))
    _check_kind(path.name, model)
    _check_library(path.name, Path(folder), model)
    return fmpy, folder, model


@functools.lru_cache(maxsize=16)
def _unpacked(path: Path, _changed: int) -> tuple[str, Any]:
    """The folder into which an FMU was unpacked, once a process, and its model description.

    _changed: time of its last change, so that a changed file is unpacked again.
    """
    import fmpy

    folder = tempfile.TemporaryDirectory(prefix="sumo_eval_fmu_")
    _unpack_folders.append(folder)
    fmpy.extract(str(path), unzipdir=folder.name)
    return folder.name, fmpy.read_model_description(str(path))


def _check_kind(name: str, model: Any) -> None:
    """Raise InputError unless an FMU is of a supported version, and for co-simulation.

    name: of the file. model: its description.
    """
    if model.fmiVersion not in ("2.0", "3.0"):
        raise must_be("The FMI version", f"FMU `{name}`", "2.0 or 3.0", model.fmiVersion)
    if model.coSimulation is None:
        kinds = {
            "model exchange": model.modelExchange,
            "scheduled execution": model.scheduledExecution,
        }
        other = " and ".join(kind for kind, interface in kinds.items() if interface)
        raise InputError(
            f"FMU `{name}` must be one for co-simulation, got one for {other or 'nothing'}."
        )


def _check_library(name: str, folder: Path, model: Any) -> None:
    """Refuse an FMU without a library for this platform.

    name: of the file. folder: into which it was unpacked. model: its description.
    """
    import fmpy

    kind = "platform" if model.fmiVersion == "2.0" else "platform_tuple"
    file = model.coSimulation.modelIdentifier + fmpy.sharedLibraryExtension
    library = f"binaries/{getattr(fmpy, kind)}/{file}"
    libraries = sorted(it.relative_to(folder).as_posix() for it in folder.glob("binaries/*/*"))
    if library not in libraries:
        owner = f"FMU `{name}` for this platform"
        raise must_be("The library", owner, library, ", ".join(libraries) or "none")
