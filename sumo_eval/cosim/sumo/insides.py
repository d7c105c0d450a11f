"""libsumo, and the internals of libsumo, traci and Xerces that this package uses. Tested with SUMO
1.28.

- `vehicles`, `direct`, `simulation_step`, `simulation_time`: compiled functions that libsumo's
  Python functions wrap. 40 cut-ins one by one take 1.2 s of processor time instead of 1.5 s.
- `keep_xml_parser`: Xerces is set up once in a process. The same cases take 1.2 s instead of 1.6 s.
- `VehicleDomain`, `VehicleTypeDomain`: classes of traci whose calls name their arguments.

With SUMO_EVAL_PLAIN=1 the first two are not used.

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
    import libsumo as libsumo  # other files import libsumo from here: after the line above
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
"""`XMLPlatformUtils::Initialize(locale, messages, panic_handler, memory_manager)` of Xerces 3.2, by
its mangled name in C++."""


@functools.cache
def keep_xml_parser() -> bool:
    """Set up Xerces, SUMO's XML parser, once for the process; return whether its library was found.

    SUMO sets Xerces up in every start and takes it down in every close: half of the time of both.
    Xerces counts set-ups and closes. With one more set-up it keeps its tables (character classes,
    codings), to which nothing writes. Where the library is not found, SUMO sets it up each time.
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
# a module, as Python looks up its attributes twice as fast as those of an object
_DIRECT = ModuleType("vehicle")
vars(_DIRECT).update({call: getattr(_LIBSUMO, f"vehicle_{call}") for call in _CALLS})


def _uses_compiled(traci: Any) -> bool:
    """Whether to step and read a simulation by libsumo's compiled functions.

    traci: libsumo, or the connection to a sumo process (`doors/traci_program.ServedSimulation`).
    """
    return traci is libsumo and not kernels.PLAIN


def vehicles(traci: Any) -> Any:
    """The calls of a simulation's vehicle domain that every step makes.

    Of libsumo they are its compiled functions: the Python functions around them double the time.
    """
    return _DIRECT if _uses_compiled(traci) else traci.vehicle


def direct(call: str, wrapper: Callable[..., Any], domain: str = "vehicle") -> Callable[..., Any]:
    """The compiled function that a call of one of libsumo's domains wraps; it takes half the time.

    wrapper: the call, which is returned instead unless it is libsumo's own plain wrapper.
    """
    if kernels.PLAIN or getattr(wrapper, "__module__", "") != "libsumo.libsumo":
        return wrapper
    return getattr(_LIBSUMO, f"{domain}_{call}", wrapper)


def simulation_step(traci: Any) -> Callable[[], None]:
    """The function that steps a simulation.

    Of libsumo it is the compiled one, and then calls step listeners if there are any.
    """
    if not _uses_compiled(traci):
        return cast("Callable[[], None]", traci.simulationStep)
    listeners = libsumo._stepManager
    step = _LIBSUMO.simulation_step

    def stepped() -> None:
        step(0.0)
        if listeners._stepListeners:
            listeners.manageStepListeners(0.0)

    return stepped


def simulation_time(traci: Any) -> Callable[[], float]:
    """The function that gives the time of a simulation, s; of libsumo the compiled one."""
    return cast(
        "Callable[[], float]",
        _LIBSUMO.simulation_getTime if _uses_compiled(traci) else traci.simulation.getTime,
    )
