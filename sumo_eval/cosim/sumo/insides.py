"""libsumo, and the internals of it and of Xerces that this package uses. Tested with SUMO 1.28.

- `vehicles`, `direct`, `simulation_step`, `simulation_time`: the functions that libsumo's Python
  ones wrap. 40 cut-ins one by one take 1.2 s of processor time in place of 1.5 s.
- `keep_xml_parser`: Xerces is set up once in a process. The same cases take 1.2 s in place of 1.6
  s.
- `VehicleDomain`, `VehicleTypeDomain`: traci's, whose calls name their arguments.

SUMO_EVAL_PLAIN=1 leaves out all but the last.

Users: `cosim/`.
"""

import ctypes
import functools
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from sumo_eval import kernels
from sumo_eval.errors import NotInstalledError

SYSTEM_LIBRARIES = ("libatomic1", "libexpat1", "libgl1", "libx11-6", "libxext6", "libxrender1")
"""Packages of Debian and Ubuntu with libraries that libsumo's wheel links but does not contain."""

os.environ["LIBSUMO_AS_TRACI"] = "quiet"  # otherwise the import may print a notice to stdout
try:
    import libsumo as libsumo  # for those who must not import it before the line above
    from traci._vehicle import VehicleDomain as VehicleDomain
    from traci._vehicletype import VehicleTypeDomain as VehicleTypeDomain
except ImportError as missing:
    raise NotInstalledError(
        f"SUMO's library cannot be loaded: {missing.msg}. It needs system libraries that a machine "
        "without a desktop may lack; on Debian and Ubuntu: apt-get install --no-install-recommends "
        f"{' '.join(SYSTEM_LIBRARIES)}"
    ) from missing

_XERCES_SET_UP = (
    "_ZN11xercesc_3_216XMLPlatformUtils10InitializeEPKcS2_PNS_12PanicHandlerEPNS_13MemoryManagerE"
)
"""Xerces 3.2: `XMLPlatformUtils::Initialize(locale, messages, panic_handler, memory_manager)`, as a
linker knows it."""


@functools.cache
def keep_xml_parser() -> bool:
    """Set up Xerces, with which SUMO reads its files, once for the process; whether it was found.

    SUMO sets it up in every start and takes it down in every close, and that is half of what both
    cost. Xerces counts set-ups and closes: with one set-up more it keeps its tables (character
    classes, codings), which nothing writes to. Where the library has another name or place, SUMO
    sets it up each time as before.
    """
    if kernels.PLAIN:
        return False
    for library in (Path(libsumo.__file__).parent.parent / "libsumo.libs").glob(
        "libxerces-c-3*.so*"
    ):
        set_up = getattr(ctypes.CDLL(str(library)), _XERCES_SET_UP, None)
        if set_up is not None:
            set_up(b"en_US", None, None, None)
            return True
    return False


_CALLS = (
    "getAngle", "getLaneIndex", "getLanePosition", "getLateralLanePosition", "getLateralSpeed",
    "getPosition",
    "getSpeed", "getSpeedMode", "moveTo", "moveToXY", "setLaneChangeMode",
    "setLateralLanePosition", "setPreviousSpeed",
    "setSpeed", "setSpeedMode",
)  # fmt: skip
_LIBSUMO = libsumo.libsumo._libsumo
# Python finds a function of a module twice as fast as one of an object
_DIRECT = ModuleType("vehicle")
vars(_DIRECT).update({call: getattr(_LIBSUMO, f"vehicle_{call}") for call in _CALLS})


def _borrows(traci: Any) -> bool:
    """Whether a simulation is stepped and read by libsumo's inner functions."""
    return traci is libsumo and not kernels.PLAIN


def vehicles(traci: Any) -> Any:
    """The calls of a simulation's vehicle domain that every step makes.

    Of libsumo they are its compiled functions: its Python functions around them cost as much again.
    """
    return _DIRECT if _borrows(traci) else traci.vehicle


def direct(call: str, wrapper: Callable[..., Any], domain: str = "vehicle") -> Callable[..., Any]:
    """The compiled function that a call of one of libsumo's domains wraps, at half the cost.

    wrapper: the call itself, which is returned where it is not libsumo's own plain wrapper.
    """
    if kernels.PLAIN or getattr(wrapper, "__module__", "") != "libsumo.libsumo":
        return wrapper
    return getattr(_LIBSUMO, f"{domain}_{call}", wrapper)


def simulation_step(traci: Any) -> Callable[[], None]:
    """The function that steps a simulation; of libsumo the inner one, and step listeners where
    there are any.
    """
    if not _borrows(traci):
        return cast("Callable[[], None]", traci.simulationStep)
    listeners = libsumo._stepManager
    step = _LIBSUMO.simulation_step

    def stepped() -> None:
        step(0.0)
        if listeners._stepListeners:
            listeners.manageStepListeners(0.0)

    return stepped


def simulation_time(traci: Any) -> Callable[[], float]:
    """The function that gives the time of a simulation, s; of libsumo the inner one."""
    return cast(
        "Callable[[], float]",
        _LIBSUMO.simulation_getTime if _borrows(traci) else traci.simulation.getTime,
    )
