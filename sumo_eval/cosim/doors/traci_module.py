"""The `traci` that an ADS sees: the running libsumo, with a guard before every call that writes.

`import traci` or `import libsumo` in an ADS's code gives this module while the code is loaded and
while it drives (`seen_as_traci`). A call that reads is libsumo's own function. A call that writes
goes through a wrapper: the ADS may write to the ego, while other vehicles, the road and SUMO's
clock belong to the harness. For a call that writes to these, `ConditionSettings.interference`
decides: `refuse` ends the case; `record` counts the call and makes it, except that nothing steps,
starts or closes SUMO. A meaningless number (see `traci_numbers`) ends the case either way.

`cosim/ego_control.py` begins and ends each case at the guard; `traci_view.py` shows
each ADS of a batch its own case alone.

Users: `cosim/doors/controller.py`, `cosim/doors/kept_state.py`, `cosim/doors/traci_view.py`,
`cosim/ego_control.py`, `cosim/on_traci.py`, `cosim/policies.py`, `cosim/simulation.py`,
`cosim/stage.py`.
"""

import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from types import ModuleType
from typing import Any, Literal, NoReturn

from sumo_eval.cosim.doors.traci_numbers import (
    HANDS_OVER,
    IGNORED,
    MOTION,
    PLACING,
    WHY_IGNORED,
    breach,
    shown,
    writing_calls,
)
from sumo_eval.cosim.sumo import insides
from sumo_eval.cosim.sumo.insides import libsumo
from sumo_eval.cosim.sumo.shared_files import name_in_sumo
from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.errors import ControllerError
from sumo_eval.scenario.concrete import ConcreteScenario

_Call = Callable[..., Any]
_Arguments = tuple[Any, ...]  # of a call, by position
_HARMLESS = ("poi", "polygon", "route")  # domains in which writing moves no vehicle
_CLOCK = ("simulationStep", "step", "executeMove")
_SHARED = (MOTION - {"openGap"}) | {
    "setSpeedMode", "setLaneChangeMode", "setColor", "setSignals", "setParameter", "setMaxSpeed",
    "setAccel", "setDecel", "setEmergencyDecel", "setHeight", "setMass", "setMaxSpeedLat",
}  # fmt: skip
"""Calls that an ADS in a batch may make for its ego: they concern no other case of the simulation,
and none of them is `IGNORED`."""
# Values of `keepRoute` of moveToXY: 1 keeps the vehicle on its route, 2 keeps its exact position,
# also off the lanes, and 3 does both. For a case that drives alone, 2 and 3 are the same.
_ON_ITS_ROUTE, _ANYWHERE, _ANYWHERE_ON_ITS_ROUTE = 1, 2, 3
_RUNNING = ("close", "start", "load", "loadState", "init", "switchConnection", "setOrder")


class RefusedCallError(ControllerError):
    """The ADS called what belongs to the harness, or with a meaningless number."""


class SumoNames(dict[str, str]):
    """Names in SUMO of the vehicles, types, lanes and edges of one case, by the user's names.

    suffix: part of each name in SUMO, different for each case of a batch; "": a case alone.
    back: the user's names by those in SUMO.
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
        kind = type(answer)
        if kind is str:
            return answer.replace(self.suffix, "")
        if kind is tuple or kind is list:
            for it in answer:
                if type(it) is not float:
                    return kind(map(self.outside, answer))
            return answer  # floats, nearly always a position: no names
        if answer is None or isinstance(answer, int | float):
            return answer
        raise TypeError(f"an answer of type {kind.__name__}")


class Guard:
    """State of the guarded module during a case.

    shared: whether an ADS sees a row of a batch (`traci_view.sharing`), even if it is the only one.
    """

    shared = False

    def __init__(self) -> None:
        self.begin((), 0.0, "refuse")

    def begin(
        self,
        others: Iterable[str],
        step: float,
        interference: Literal["refuse", "record"],
        heeding: Iterable[str] = (),
    ) -> None:
        """Begin a case: no listeners, nothing counted.

        others: names of the other vehicles; their types have the same names.
        heeding: keys of `WHY_IGNORED` that exist in the case, so that their calls have an effect.
        """
        self.others = frozenset(others)
        self.step = step
        self.interference = interference
        self.listeners = libsumo.StepManager()
        self.touched = Counter[str]()  # number of calls, by the clip that shows it
        self.heeding = set(heeding)
        self.asked = Counter[str]()  # number of each call that SUMO may ignore
        # whether a call has moved the ego since the step began, and whether one has placed it
        self.moved = self.placed = False
        self.refusal: tuple[str, str] | None = None  # `deed` and `why` of `refuse`
        self.names = SumoNames()
        self.mode_may_differ = True  # whether the ADS may have changed the ego's speed mode
        # Read after the last step, by the vehicles' names in SUMO. The first call that may change
        # a vehicle's speed or position deletes its speed: without a speed, neither is valid.
        self.positions: dict[str, Any] = {}
        self.speeds: dict[str, float] = {}

    def leave(self) -> NoReturn:
        """Take a case out of its batch: it needs the simulation to itself.

        A user sees this error only if an ADS that drives alone calls a function kept from a batch.
        """
        self.refuse(
            "The ADS called a function of traci that it had kept from another case",
            "it must take it from `traci` again",
        )

    def translate(
        self, call: str, vehicle: str, args: _Arguments, kwargs: Mapping[str, Any]
    ) -> tuple[str, _Arguments]:
        """Name and arguments, in SUMO, of a call that writes to an ego of a batch. Any other call
        takes the case out of its batch.
        """
        plain = not kwargs and vehicle == EGO and call in _SHARED
        # a negative speed hands the ego over to SUMO's model; nan compares as false
        if not plain or (call == "setSpeed" and not args[0] >= 0.0):
            self.leave()
        if call == "moveToXY":
            args = self._on_own_road(args)
        self.mode_may_differ = self.mode_may_differ or call == "setSpeedMode"
        self.speeds.pop(self.names[EGO], None)
        return self.names[EGO], tuple(self.names[it] if type(it) is str else it for it in args)

    def _on_own_road(self, args: _Arguments) -> _Arguments:
        """Arguments of moveToXY, edge, lane, x, y, angle and `keepRoute`, on the case's own road.

        Beside it are the roads of other cases, and the nearest edge could be one of theirs.
        """
        modes = (_ON_ITS_ROUTE, _ANYWHERE, _ANYWHERE_ON_ITS_ROUTE)
        if len(args) != 6 or args[0] not in ("", "road") or args[5] not in modes:
            self.leave()
        keep = _ANYWHERE_ON_ITS_ROUTE if args[5] == _ANYWHERE else args[5]
        return ("road", *args[1:5], keep)

    def note_interference(self, what: str, deed: str, why: str) -> None:
        """Refuse or count a call that the ADS may not make.

        what: name of its count.
        deed, why: as of `refuse`.
        """
        if self.interference == "refuse" or self.shared:
            self.refuse(deed, why)
        self.touched[what] += 1

    def refuse(self, deed: str, why: str) -> NoReturn:
        """End the case, even if the ADS catches the exception.

        deed, why: halves of the error message, between which the loop puts the time.
        """
        self.refusal = self.refusal or (deed, why)
        raise RefusedCallError(f"{deed}; {why}")

    def check(
        self, domain: str, call: str, name: object, args: Sequence[Any], kwargs: Mapping[str, Any]
    ) -> None:
        """Refuse a meaningless number, which SUMO would take."""
        fault = breach(domain, call, name, args, kwargs)
        if fault is not None:
            self.refuse(
                f"The ADS called traci.{domain}.{call} with `{fault.argument}` = "
                f"{shown(fault.given)}",
                f"it must be {fault.must_be}",
            )

    def note_touched(self, domain: str, call: str, name: object) -> None:
        """Refuse or count a call that writes to something else than the ego."""
        self.note_interference(
            f"touched_{domain}", f"The ADS called traci.{domain}.{call} for `{name}`",
            "it may change only its own vehicle "
            '(`interference = "record"` permits more, and counts it)',
        )  # fmt: skip

    @property
    def ignored(self) -> dict[str, str]:
        """TraCI call -> reason why SUMO ignored it in this case."""
        return {
            call: WHY_IGNORED[IGNORED.get(call, "window")]
            for call in self.asked
            if IGNORED.get(call) not in self.heeding
        }

    def call_listeners(self) -> None:
        """Call every step listener of the ADS, as TraCI does after each step."""
        if self.listeners._stepListeners:
            self.listeners.manageStepListeners(0.0)

    def end(self) -> None:
        """Count what SUMO ignored. Remove every listener; each may clean up."""
        if self.ignored:
            self.touched["ignored_traci_call"] = sum(self.asked[call] for call in self.ignored)
        for number in list(self.listeners._stepListeners):
            self.listeners.removeStepListener(number)


def heeding(concrete: ConcreteScenario) -> set[str]:
    """Keys of `WHY_IGNORED` that exist in a case from its start."""
    exists = {"traffic": concrete.reacts, "network": concrete.road.network is not None}
    return {key for key in exists if exists[key]}


GUARD = Guard()
"""The one of a process, as there is one libsumo."""


def _takes_any_number(write: _Call) -> _Call:
    """A call of libsumo that takes numbers of numpy and torch, as traci does."""

    def plain(it: Any) -> Any:
        return it.item() if hasattr(it, "item") else it

    return wraps(write)(
        lambda *args, **kwargs: write(*map(plain, args), **{k: plain(kwargs[k]) for k in kwargs})
    )


def _vehicle_writer(call: str, write: _Call) -> _Call:
    """A guarded call that writes to a vehicle."""
    moves, ignored, hands_over = call in MOTION, call in IGNORED, call in HANDS_OVER

    def guarded(vehID: str, *args: Any, **kwargs: Any) -> Any:  # noqa: N803 - TraCI's name
        # SUMO refuses a call on a vehicle that does not exist, unless the call adds the vehicle
        if vehID != EGO and (vehID in GUARD.others or call.startswith("add")):
            GUARD.note_touched("vehicle", call, vehID)
        if moves and vehID == EGO:
            GUARD.moved = True
            GUARD.placed |= call in PLACING
        if GUARD.shared:
            vehID, args = GUARD.translate(call, vehID, args, kwargs)  # noqa: N806
        GUARD.check("vehicle", call, vehID, args, kwargs)
        if ignored and vehID == EGO:
            GUARD.asked[call] += 1
        answer = write(vehID, *args, **kwargs)
        # SUMO's model drives the ego from here on: for setSpeed, if the speed is negative
        if (
            hands_over
            and vehID == EGO
            and (call != "setSpeed" or min(*args, *kwargs.values(), 0.0) < 0.0)
        ):
            GUARD.heeding.add("model")
        return answer

    if call != "setSpeed":
        return guarded
    direct = insides.direct(call, write)

    def set_speed(vehID: str, speed: float) -> Any:  # noqa: N803 - TraCI's name
        # The usual call: the ego and a speed that needs no check. It takes effect in the next step,
        # so values that were read after the last step stay valid.
        if vehID == EGO and type(speed) is float and 0.0 <= speed < math.inf:
            GUARD.moved = True
            return direct(GUARD.names[vehID], speed)
        return guarded(vehID, speed)

    set_speed.__qualname__ = write.__qualname__  # Python's error for missing arguments names it
    return set_speed


def _type_writer(call: str, write: _Call) -> _Call:
    """A guarded call that writes to a vehicle type."""

    def guarded(typeID: str, *args: Any, **kwargs: Any) -> Any:  # noqa: N803 - TraCI's name
        if GUARD.shared:
            GUARD.leave()
        if typeID in GUARD.others and call != "copy":
            GUARD.note_touched("vehicletype", call, typeID)
        GUARD.check("vehicletype", call, typeID, args, kwargs)
        if call in IGNORED and typeID == EGO:
            GUARD.asked[call] += 1
        return write(typeID, *args, **kwargs)

    return guarded


def _world_writer(domain: str, call: str, write: _Call) -> _Call:
    """A guarded call that writes to anything but vehicles and their types."""

    def guarded(*args: Any, **kwargs: Any) -> Any:
        GUARD.note_touched(domain, call, args[0] if args else "")
        GUARD.check(domain, call, "", args, kwargs)
        return write(*args, **kwargs)

    return guarded


def _gui_writer(call: str) -> _Call:
    """Stand-in of a call that changes a window, of which a case has none."""

    def ignored(*args: Any, **kwargs: Any) -> None:
        if GUARD.shared:
            GUARD.leave()
        GUARD.asked[f"gui.{call}"] += 1

    return ignored


def _step_clock(*args: Any, **kwargs: Any) -> None:
    """Stand-in of a call that steps SUMO: notes it and steps nothing."""
    # the time to step to, s; without one, or with 0, TraCI makes one step
    until = next((value for value in (*args, *kwargs.values()) if value), None)
    ahead = GUARD.step
    if until is not None:
        ahead = float(until) - libsumo.simulation.getTime()
    GUARD.note_interference(
        "stepped_the_clock", f"The ADS moved SUMO's clock by {ahead:+.2f} s",
        "stepping is the harness's (a program with a loop of its own runs as `traci:COMMAND`)",
    )  # fmt: skip


def _running_call(call: str) -> _Call:
    """Stand-in of a call that starts, loads or closes SUMO: notes it and does nothing."""
    deed, why = "closed the simulation", "that is the harness's"
    if call != "close":
        deed = f"called traci.{call}"
        why += " (a program that starts SUMO itself runs as `traci:COMMAND`)"

    def guarded(*args: Any, **kwargs: Any) -> Any:
        GUARD.note_interference("started_or_closed", f"The ADS {deed}", why)

    return guarded


_HARNESS = dict.fromkeys(_CLOCK, _step_clock) | {call: _running_call(call) for call in _RUNNING}
"""Stand-ins of calls that are the harness's, by their names."""


def _guarded_domain(domain: type) -> type:
    """The domain with its writing calls wrapped; reading ones are inherited as they are."""
    wrapped = {}
    name = domain.__name__
    for call, write in writing_calls(domain).items() if name not in _HARMLESS else ():
        write = _takes_any_number(write)
        if name == "simulation" and call in _HARNESS:
            guarded = _HARNESS[call]
        elif name == "vehicle":
            guarded = _vehicle_writer(call, write)
        elif name == "vehicletype":
            guarded = _type_writer(call, write)
        elif name == "gui":
            guarded = _gui_writer(call)
        else:
            guarded = _world_writer(name, call, write)
        wrapped[call] = guarded  # hides the call of the parent class
    return type(name, (domain,), wrapped)


def _build() -> ModuleType:
    """A module with all that libsumo has, its writing calls guarded."""
    module = ModuleType("traci", "The running simulation, as an ADS may use it.")
    real = sys.modules["traci"]
    own = module.__dict__
    own |= {name: value for name, value in vars(libsumo).items() if not name.startswith("__")}
    own |= {call: stand_in for call, stand_in in _HARNESS.items() if call in own}
    module.__path__ = list(real.__path__)
    module.__spec__ = real.__spec__
    domains = [_guarded_domain(domain) for domain in libsumo.DOMAINS]
    own.update({domain.__name__: domain for domain in domains}, DOMAINS=domains)

    def add_listener(listener: Any) -> Any:
        if GUARD.shared:
            GUARD.leave()
        return GUARD.listeners.addStepListener(listener)

    module.addStepListener = add_listener  # type: ignore[attr-defined]
    # a function, because each case has other `listeners`
    module.removeStepListener = (  # type: ignore[attr-defined]
        lambda number: GUARD.listeners.removeStepListener(number)
    )
    return module


TRACI = _build()
"""One in a process: the `traci` that code imported in one case is the next case's, too."""


@contextmanager
def seen_as_traci(module: ModuleType = TRACI) -> Iterator[None]:
    """A context in which `import traci` and `import libsumo` give a module, by default the guarded
    one.
    """
    before = {name: sys.modules[name] for name in ("traci", "libsumo")}
    sys.modules.update(dict.fromkeys(before, module))
    try:
        yield
    finally:
        sys.modules.update(before)
