"""The `traci` that an ADS sees: the running libsumo, with every call that is not the ADS's own
guarded.

`import traci` or `import libsumo` in an ADS's code gives this module while the code is loaded and
while it drives (`seen_as_traci`). Reading is libsumo's own function, untouched. A call that writes
goes through a thin wrapper: the ego may be written to; other vehicles, the road and SUMO's clock
are the harness's. What happens then is `ConditionSettings.interference`: the call is refused and
the case ends, or it is put on record (and stepping, starting and closing are left out). A
meaningless number (see `traci_numbers`) is refused in either case.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Any, Literal, NoReturn

from sumo_eval.cosim.doors.traci_numbers import (
    HANDS_OVER,
    IGNORED,
    MOTION,
    WHY_IGNORED,
    breach,
    shown,
)
from sumo_eval.cosim.sumo import insides
from sumo_eval.cosim.sumo.insides import libsumo
from sumo_eval.cosim.sumo.shared_files import name_in_sumo
from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.errors import ControllerError
from sumo_eval.scenario.concrete import ConcreteScenario

_READS = (
    "_", "get", "is", "subscribe", "unsubscribe", "addSubscriptionFilter", "could", "wants",
    "find", "convert", "has",
    "DOMAIN", "domain", "this", "updateBestLanes", "highlight", "saveState", "writeMessage",
)  # fmt: skip
_HARMLESS = ("gui", "poi", "polygon", "route")  # domains in which writing changes nobody's driving
_CLOCK = ("simulationStep", "step", "executeMove")
_SHARED = MOTION - {"openGap"} | {
    "setSpeedMode", "setLaneChangeMode", "setColor", "setSignals", "setParameter", "setMaxSpeed",
    "setAccel", "setDecel", "setEmergencyDecel", "setHeight", "setMass", "setMaxSpeedLat",
}  # fmt: skip
"""Calls that write to the ego and concern no other case of the simulation."""
# keepRoute of moveToXY: the nearest road of a case that is alone is that of its route
_ANYWHERE, _ANYWHERE_ON_ITS_ROUTE = 2, 3
_RUNNING = ("close", "start", "load", "loadState", "init", "switchConnection", "setOrder")


class RefusedCallError(ControllerError):
    """The ADS called what belongs to the harness, or with a meaningless number."""


class Names(dict[str, str]):
    """Names in SUMO of the vehicles, types, lanes and edges of one case, by the user's names.

    suffix: part of each of them where several cases share a simulation.
    """

    def __init__(self, known: Iterable[str] = (EGO,), suffix: str = "") -> None:
        super().__init__({name: name_in_sumo(name, suffix) for name in known})
        self.suffix, self.back = suffix, {inside: name for name, inside in self.items()}

    def __missing__(self, name: str) -> str:
        return name

    def outside(self, answer: Any) -> Any:
        """The answer to a call as the user knows it.

        Raises TypeError for an object that may hold names.
        """
        if type(answer) is str:
            return answer.replace(self.suffix, "")
        if type(answer) is tuple or type(answer) is list:
            for it in answer:
                if type(it) is not float:
                    return type(answer)(map(self.outside, answer))
            return answer  # a place, nearly always
        if answer is None or isinstance(answer, int | float):
            return answer
        raise TypeError(f"an answer of type {type(answer).__name__}")


class Guard:
    """State of the guarded module during a case."""

    def __init__(self) -> None:
        self.begin((), 0.0, "refuse")

    def begin(
        self,
        others: Iterable[str],
        step: float,
        interference: Literal["refuse", "record"],
        heeding: Iterable[str] = (),
    ) -> None:
        """A new case: no listeners, nothing touched.

        others: names of the other vehicles, which are their types'.

        heeding: which of `WHY_IGNORED` there is.
        """
        self.others = frozenset(others)
        self.step = step
        self.interference = interference
        self.listeners = libsumo.StepManager()
        self.touched: dict[str, int] = {}
        self.heeding = set(heeding)
        self.asked: dict[str, int] = {}  # calls that SUMO may ignore
        self.moved = False  # the ego, by a call, since the step began
        self.refusal: tuple[str, str] | None = None
        self.names, self.shared = Names(), False  # whether other cases share the simulation
        self.moded = True  # whether the ego may have another speed mode than it was given
        # what was read of vehicles after the last step, by their names in SUMO; a position counts
        # while there is a speed, which goes with the first call that may change either
        self.positions: dict[str, Any] = {}
        self.speeds: dict[str, float] = {}

    def leave(self) -> NoReturn:
        """Take a case out of its batch: it needs the simulation to itself.

        The words are read only if a hook that is alone calls what it has kept from a batch.
        """
        self.refuse(
            "The ADS called a function of traci that it had kept from another case",
            "it must take it from `traci` again",
        )

    def told_of_a_row(
        self, call: str, vehicle: str, args: tuple[Any, ...], kwargs: Mapping[str, Any]
    ) -> tuple[str, tuple[Any, ...]]:
        """A call that writes to the ego of a row, as SUMO takes it, if it concerns no other row."""
        plain = not kwargs and vehicle == EGO and call in _SHARED
        if not plain or (call == "setSpeed" and not args[0] >= 0.0):
            self.leave()
        told = self._place_of_a_row(args) if call == "moveToXY" else args
        self.moded = self.moded or call == "setSpeedMode"
        self.speeds.pop(self.names[EGO], None)
        return self.names[EGO], tuple(self.names[it] if type(it) is str else it for it in told)

    def _place_of_a_row(self, args: tuple[Any, ...]) -> tuple[Any, ...]:
        """Arguments of moveToXY with the road of the row, the only one that it can be on."""
        if len(args) != 6:
            self.leave()
        edge, keep = args[0], args[5]
        if edge not in ("", "road") or keep not in (1, _ANYWHERE, _ANYWHERE_ON_ITS_ROUTE):
            self.leave()
        keep = _ANYWHERE_ON_ITS_ROUTE if keep == _ANYWHERE else keep
        return ("road", *args[1:5], keep)

    def meddles(self, what: str, deed: str, why: str) -> None:
        """An ADS does what is not its own.

        deed, why: the sentence's two halves, a time comes between them.
        """
        if self.interference == "refuse" or self.shared:
            self.refuse(deed, why)
        self.count(what)

    def refuse(self, deed: str, why: str) -> NoReturn:
        """End the case, whether the ADS lets the exception through or not."""
        self.refusal = self.refusal or (deed, why)
        raise RefusedCallError(f"{deed}; {why}")

    def check(
        self, domain: str, call: str, name: object, args: Sequence[Any], kwargs: Mapping[str, Any]
    ) -> None:
        """No number that an ADS writes may be a meaningless one that SUMO takes."""
        found = breach(domain, call, name, args, kwargs)
        if found is not None:
            self.refuse(
                f"The ADS called traci.{domain}.{call} with `{found.argument}` = "
                f"{shown(found.given)}",
                f"it must be {found.must_be}",
            )

    def count(self, what: str) -> None:
        """Put something on record once more."""
        if self.shared:
            self.leave()
        self.touched[what] = self.touched.get(what, 0) + 1

    def touches(self, domain: str, call: str, name: object) -> None:
        """An ADS writes to something that is not the ego's."""
        self.meddles(
            f"touched_{domain}", f"The ADS called traci.{domain}.{call} for `{name}`",
            "it may change only its own vehicle "
            '(`interference = "record"` permits more, and counts it)',
        )  # fmt: skip

    def asks(self, call: str) -> None:
        """An ADS makes a call that SUMO may ignore."""
        if self.shared:
            self.leave()
        self.asked[call] = self.asked.get(call, 0) + 1

    @property
    def ignored(self) -> dict[str, str]:
        """TraCI call -> reason why SUMO ignored it in this case."""
        return {
            call: WHY_IGNORED[IGNORED[call]]
            for call in self.asked
            if IGNORED[call] not in self.heeding
        }

    def heard(self) -> None:
        """Call every step listener, as TraCI does after each step."""
        if self.listeners._stepListeners:
            self.listeners.manageStepListeners(0.0)

    def end(self) -> None:
        """Count what SUMO ignored. Remove every listener; each may clean up."""
        if self.ignored:
            self.touched["ignored_traci_call"] = sum(self.asked[call] for call in self.ignored)
        for number in list(self.listeners._stepListeners):
            self.listeners.removeStepListener(number)


def heeding(concrete: ConcreteScenario) -> set[str]:
    """Names in `WHY_IGNORED` that hold for a case from its start."""
    drives = any(actor.model is not None for actor in concrete.actors)
    return {
        by
        for by, there in (("traffic", drives), ("network", concrete.road.network is not None))
        if there
    }


def _vehicle_writer(guard: Guard, call: str, write: Callable[..., Any]) -> Callable[..., Any]:
    moves, ignored, hands_over = call in MOTION, call in IGNORED, call in HANDS_OVER

    def guarded(vehID: str, *args: Any, **kwargs: Any) -> Any:  # noqa: N803 - TraCI's name
        # of a name that nobody has, SUMO says so
        if vehID != EGO and (vehID in guard.others or call.startswith("add")):
            guard.touches("vehicle", call, vehID)
        if moves and vehID == EGO:
            guard.moved = True
        if guard.shared:
            vehID, args = guard.told_of_a_row(call, vehID, args, kwargs)  # noqa: N806
        guard.check("vehicle", call, vehID, args, kwargs)
        if ignored and vehID == EGO:
            guard.asks(call)
        answer = write(vehID, *args, **kwargs)
        if (
            hands_over
            and vehID == EGO
            and (call != "setSpeed" or min(*args, *kwargs.values(), 0.0) < 0.0)
        ):
            guard.heeding.add("model")
        return answer

    if call != "setSpeed":
        return guarded
    direct = insides.direct(call, write)

    def set_speed(vehID: str, speed: float) -> Any:  # noqa: N803 - TraCI's name
        # as nearly always: the ego, and a finite float
        if vehID == EGO and type(speed) is float and 0.0 <= speed < math.inf:
            guard.moved = True
            return direct(guard.names[vehID], speed)
        return guarded(vehID, speed)

    set_speed.__qualname__ = write.__qualname__  # in the error of a missing argument
    return set_speed


def _type_writer(guard: Guard, call: str, write: Callable[..., Any]) -> Callable[..., Any]:
    def guarded(typeID: str, *args: Any, **kwargs: Any) -> Any:  # noqa: N803 - TraCI's name
        if guard.shared:
            guard.leave()
        if typeID in guard.others and call != "copy":
            guard.touches("vehicletype", call, typeID)
        guard.check("vehicletype", call, typeID, args, kwargs)
        if call in IGNORED and typeID == EGO:
            guard.asks(call)
        return write(typeID, *args, **kwargs)

    return guarded


def _world_writer(
    guard: Guard, domain: str, call: str, write: Callable[..., Any]
) -> Callable[..., Any]:
    def guarded(*args: Any, **kwargs: Any) -> Any:
        guard.touches(domain, call, args[0] if args else "")
        guard.check(domain, call, "", args, kwargs)
        return write(*args, **kwargs)

    return guarded


def _clock_call(guard: Guard) -> Callable[..., Any]:
    def guarded(*args: Any, **kwargs: Any) -> Any:
        until = next((value for value in (*args, *kwargs.values()) if value), None)
        ahead = guard.step
        if until is not None:
            ahead = float(until) - libsumo.simulation.getTime()
        guard.meddles(
            "stepped_the_clock", f"The ADS moved SUMO's clock by {ahead:+.2f} s",
            "stepping is the harness's (a program with a loop of its own runs as `traci:COMMAND`)",
        )  # fmt: skip

    return guarded


def _running_call(guard: Guard, call: str) -> Callable[..., Any]:
    doing = {"close": "closed", "start": "started", "load": "loaded", "loadState": "loaded"}.get(
        call, f"{call} for"
    )

    def guarded(*args: Any, **kwargs: Any) -> Any:
        guard.meddles(
            "started_or_closed", f"The ADS {doing} the simulation", "that is the harness's"
        )

    return guarded


def _guarded_domain(guard: Guard, domain: type) -> type:
    """The domain with its writing calls wrapped; reading ones are inherited as they are."""
    wrapped: dict[str, Any] = {}
    name = domain.__name__
    for call in () if name in _HARMLESS else dir(domain):
        write = getattr(domain, call)
        if call.startswith(_READS) or isinstance(write, type) or not callable(write):
            continue
        if name == "simulation" and call in _CLOCK:
            guarded = _clock_call(guard)
        elif name == "simulation" and call in _RUNNING:
            guarded = _running_call(guard, call)
        elif name == "vehicle":
            guarded = _vehicle_writer(guard, call, write)
        elif name == "vehicletype":
            guarded = _type_writer(guard, call, write)
        else:
            guarded = _world_writer(guard, name, call, write)
        wrapped[call] = guarded  # found sooner than a staticmethod
    return type(name, (domain,), wrapped)


def _build() -> tuple[ModuleType, Guard]:
    guard, real = Guard(), sys.modules["traci"]
    module = ModuleType("traci", "The running simulation, as an ADS may use it.")
    module.__dict__.update(
        {name: value for name, value in vars(libsumo).items() if not name.startswith("__")}
    )
    module.__path__, module.__spec__ = list(real.__path__), real.__spec__
    domains = [_guarded_domain(guard, domain) for domain in libsumo.DOMAINS]
    module.__dict__.update({domain.__name__: domain for domain in domains}, DOMAINS=domains)
    for call in ("simulationStep", "executeMove"):
        setattr(module, call, _clock_call(guard))
    for call in ("close", "start", "load", "init"):
        setattr(module, call, _running_call(guard, call))

    def add_listener(listener: Any) -> Any:
        if guard.shared:
            guard.leave()
        return guard.listeners.addStepListener(listener)

    module.addStepListener = add_listener  # type: ignore[attr-defined]
    module.removeStepListener = (  # type: ignore[attr-defined]
        lambda number: guard.listeners.removeStepListener(number)
    )
    return module, guard


TRACI, GUARD = _build()
"""One for the process, as libsumo is: code that imported `traci` in one case finds the next one's
under it."""


@contextmanager
def seen_as_traci(module: ModuleType = TRACI) -> Iterator[None]:
    """`import traci` and `import libsumo` give a module within this block, by default the running
    simulation; afterwards what was there.
    """
    before = {name: sys.modules[name] for name in ("traci", "libsumo")}
    sys.modules.update(dict.fromkeys(before, module))
    try:
        yield
    finally:
        sys.modules.update(before)
