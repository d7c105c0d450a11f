"""The view of one row of a batch: answers of the guarded `traci` where many cases share SUMO.

The roads of all cases are at one place, so positions, times and speeds are those of the case alone.
Names in SUMO end with the row's suffix: a call adds the suffix to its arguments, and removes it
from the answer. A call about more than the row takes the row out of its batch: `Guard.leave` raises
an error.

Users: `cosim/simulation.py` opens `sharing()` around the drive of such a batch.
"""

import functools
import inspect
import io
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from types import ModuleType
from typing import Any

from sumo_eval.cosim.doors.traci_module import GUARD, TRACI, seen_as_traci
from sumo_eval.cosim.sumo import insides
from sumo_eval.cosim.sumo.insides import libsumo
from sumo_eval.cosim.sumo.sumo_files import EGO

_Call = Callable[..., Any]
_OF_A_ROW = ("vehicle", "vehicletype", "lane", "edge", "route")  # domains whose names have a suffix
_READS = ("get", "is", "could", "wants")  # beginnings of the names of calls that read
_OF_ALL_ROWS = ("getTime", "getDeltaT", "getCurrentTime")  # have the same answer in every row
_OF_MANY = {
    "getIDList",
    "getIDCount",
    "getLoadedIDList",
    "getTeleportingIDList",
    "getDrivingDistance2D",  # its position may lie on the road of another row
    "getTaxiFleet",
    "getFoes",
    "getInternalFoes",
    "getSubscriptionResults",
    "getAllSubscriptionResults",
    "getContextSubscriptionResults",
    "getAllContextSubscriptionResults",
}
"""Reading calls of a domain that are about more than one object of the row."""
_OF_MODELS = {
    "getActionStepLength",
    "getLastActionTime",
    "getStopSpeed",
    "getLaneChangeState",
    "getLaneChangeStatePretty",
    "couldChangeLane",
    "wantsAndCouldChangeLane",
    "getSpeedWithoutTraCI",
    "getParameter",
    "getParameterWithKey",
}
"""Calls that SUMO's driver models answer. In a batch only the egos' models are on: `cosim/` moves
the actors."""


def _reading(read: _Call) -> Any:
    """A stand-in of a call that reads, for the row of `GUARD.names`."""

    def reading(*args: Any, **kwargs: Any) -> Any:
        names = GUARD.names
        try:
            # a text that names nothing of the case stays as it is (`SumoNames`)
            inside = [names[it] if type(it) is str else it for it in args]
            named = {key: names[it] if type(it) is str else it for key, it in kwargs.items()}
            return names.outside(read(*inside, **named))
        except (libsumo.TraCIException, TypeError):
            GUARD.leave()  # raises

    return reading


def _reading_by_name(read: Callable[[str], Any], usual: _Call) -> Any:
    """A stand-in of a call that reads and takes only a name, in half the time of `_reading`.

    read: the compiled call.
    usual: the stand-in by `_reading`, for a name that is given by keyword.
    """

    def reading(name: Any = None, **kwargs: Any) -> Any:
        if kwargs:
            return usual(**kwargs)
        try:
            answer = read(GUARD.names[name])
            # most answers are floats, which hold no name
            return answer if type(answer) is float else GUARD.names.outside(answer)
        except (libsumo.TraCIException, TypeError):
            GUARD.leave()  # raises

    return reading


def _of_ego(reading: _Call) -> Any:
    """The stand-in `reading` for the ego alone; for other vehicles it takes the row out."""

    def of_ego(*args: Any, **kwargs: Any) -> Any:
        if args[:1] != (EGO,):
            GUARD.leave()  # raises
        return reading(*args, **kwargs)

    return of_ego


def _kept_speed(reading: _Call) -> Any:
    """`getSpeed`, answered by the speed that was read after the last step, while that is valid."""

    def speed(vehID: Any) -> Any:  # noqa: N803 - TraCI's name
        try:
            return GUARD.speeds[GUARD.names[vehID]]
        except (KeyError, TypeError):
            return reading(vehID)

    return speed


def _kept_position(reading: _Call) -> Any:
    """`getPosition`, answered by the position that was read after the last step."""

    def position(vehID: Any, includeZ: Any = False) -> Any:  # noqa: N803 - TraCI's names
        name = GUARD.names[vehID]
        # a kept position is valid as long as its vehicle has a kept speed (`Guard.begin`)
        kept = name in GUARD.speeds and not includeZ
        return GUARD.positions[name] if kept else reading(vehID, includeZ)

    return position


def _quick_lead(reading: _Call) -> Any:
    """`getLeader` by the compiled call; where that fails, `reading` answers or takes the row out.

    The lead vehicle is of the same row, as every row has a road of its own.
    """
    read = insides.direct("getLeader", libsumo.vehicle.getLeader)

    def lead_and_gap(vehID: Any, dist: Any = 100.0) -> Any:  # noqa: N803 - TraCI's name
        names = GUARD.names
        try:
            lead, gap = read(names[vehID], dist)
            if lead:
                return names.back[lead], gap
            # the switch of libsumo's Python `getLeader`, which `read` bypasses
            return None if libsumo.vehicle._legacyGetLeader else (lead, gap)
        except (libsumo.TraCIException, TypeError):
            return reading(vehID, dist)

    return lead_and_gap


_QUICK = {"getSpeed": _kept_speed, "getPosition": _kept_position, "getLeader": _quick_lead}
"""Makers of stand-ins for the calls that most hooks make at every step."""


def _listing(read: Callable[[], Any]) -> Any:
    """A stand-in of a call that lists a domain's names, sorted as SUMO sorts them."""

    def listing() -> Any:
        names = GUARD.names
        # `read` lists the names of all rows; no name of another row has this row's suffix
        return tuple(sorted(names.outside(it) for it in read() if names.suffix in it))

    return listing


def _stand_in(domain: Any, call: str) -> Any:
    """Stand-in of a call that the guard does not wrap: it reads from the row, or takes it out."""
    kind = domain.__name__
    if kind == "vehicle" and call == "getIDList":
        return _listing(domain.getIDList)
    if kind in _OF_A_ROW and call.startswith(_READS) and call not in _OF_MANY:
        read = getattr(domain, call)
        reading = _reading(read)
        if read.__code__.co_argcount == 1:  # a static method whose one argument is the name
            reading = _reading_by_name(insides.direct(call, read, kind), reading)
        # `_of_ego` compares names, and the ego's type has the ego's name
        if call in _OF_MODELS and kind in ("vehicle", "vehicletype"):
            return _of_ego(reading)
        return _QUICK[call](reading) if kind == "vehicle" and call in _QUICK else reading
    return lambda *_, **__: GUARD.leave()  # takes the row out of its batch


@functools.cache
def _view() -> list[tuple[Any, str, Any]]:
    """The calls that differ where cases share SUMO: domain, name of the call, its stand-in."""
    # The class of a domain of `TRACI` holds the guarded writing calls (`vars(domain)`) and inherits
    # all others from libsumo: these need stand-ins.
    return [
        (domain, call, _stand_in(domain, call))
        for domain in TRACI.DOMAINS
        for call, _ in inspect.getmembers(domain, inspect.isroutine)
        if not call.startswith("_") and call not in vars(domain)
        if domain.__name__ != "simulation" or call not in _OF_ALL_ROWS
    ]


class _NoLibsumo(ModuleType):
    """Stand-in of libsumo in a batch: any use takes the row out. After the batch, a hook that has
    kept the stand-in uses libsumo through it.
    """

    def __getattr__(self, name: str) -> Any:
        if sys.modules["libsumo"] is self:
            GUARD.leave()
        return getattr(libsumo, name)


class _Console(io.TextIOBase):
    """Output stream in a batch: a case whose hook prints leaves, as output is kept with its case.

    After the batch, code that has kept the stream, as `logging` does, writes to the process's.

    stream: stdout or stderr.
    """

    def __init__(self, stream: str) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        now: Any = getattr(sys, self._stream)
        if now is self:
            GUARD.leave()
        return int(now.write(text))


_NO_LIBSUMO = _NoLibsumo("libsumo")


@contextmanager
def sharing() -> Iterator[None]:
    """A context in which `import traci` gives the guarded `traci`, which answers for the row with
    the names `GUARD.names`. `import libsumo` gives a stand-in that takes the row out.
    """
    for domain, call, stand_in in _view():
        setattr(domain, call, stand_in)
    try:
        with (
            seen_as_traci(),
            redirect_stdout(_Console("stdout")),
            redirect_stderr(_Console("stderr")),
        ):
            sys.modules["libsumo"] = _NO_LIBSUMO  # `seen_as_traci` puts libsumo back
            GUARD.shared = True
            yield
    finally:
        GUARD.shared = False
        for domain, call, _ in _view():
            delattr(domain, call)  # the inherited call of libsumo answers again
