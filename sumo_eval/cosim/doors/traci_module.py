"""The `traci` that an ADS sees: the running libsumo, with a guard before every call that writes.

While an ADS's code is loaded and while it drives, `import traci` and `import libsumo` give it this
module (`seen_as_traci`). A call that reads is libsumo's own function. A call that writes goes
through a wrapper. The ADS may write to the ego; other vehicles, the road and SUMO's clock belong to
the harness. `ConditionSettings.interference` decides about calls that write to these: `refuse` ends
the case; `record` counts the call and makes it, but nothing steps, starts or closes SUMO. An
impossible number (`cosim/doors/traci_numbers.py`) ends the case either way.

`cosim/ego_control.py` begins and ends each case at the guard; `cosim/doors/traci_view.py` shows
each ADS of a batch its own case alone.

Users: `cosim/doors/controller.py`, `cosim/doors/kept_state.py`, `cosim/doors/traci_view.py`,
`cosim/discrepancies.py`, `cosim/ego_control.py`, `cosim/ego_motion.py`, `cosim/on_traci.py`,
`cosim/policies.py`, `cosim/simulation.py`.
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
_HARMLESS = ("poi", "polygon", "route")  # domains whose writing calls move no vehicle
_CLOCK = ("simulationStep", "step", "executeMove")  # calls that step SUMO
_SHARED = (MOTION - {"openGap"}) | {
    "setSpeedMode", "setLaneChangeMode", "setColor", "setSignals", "setParameter", "setMaxSpeed",
    "setAccel", "setDecel", "setEmergencyDecel", "setHeight", "setMass", "setMaxSpeedLat",
}  # fmt: skip
"""Calls that an ADS in a batch may make for its ego: they concern no other case of the simulation,
and none of them is `IGNORED`."""
# Values of `keepRoute` of moveToXY: 1 keeps the vehicle on its route, 2 keeps its exact position,
# also off the lanes, and 3 does both. On a road of one section, 2 and 3 do the same in a case that
# is alone.
_ON_ITS_ROUTE, _ANYWHERE, _ANYWHERE_ON_ITS_ROUTE = 1, 2, 3
_AT_ONCE = 1000.0  # m/s across, at which SUMO changes lanes within a step
_UNSET = 1.0  # m/s; SUMO's largest lateral speed, which no lane change has
# calls for which the ego's largest lateral speed matters
_OF_CHANGES = ("changeLane", "changeLaneRelative", "setMaxSpeedLat")
# calls that start, load or close SUMO
_RUNNING = ("close", "start", "load", "loadState", "init", "switchConnection", "setOrder")


class RefusedCallError(ControllerError):
    """The ADS made a call that belongs to the harness, or one with an impossible number."""


class SumoNames(dict[str, str]):
    """Names in SUMO of the vehicles, types, lanes and edges of one case, by the user's names. Any
    other name stays as it is.

    known: the user's names.
    suffix: part of each name in SUMO, different for each case of a batch; "": a case alone.
    back: the user's names by their names in SUMO.
    """

    def __init__(self, known: Iterable[str] = (EGO,), suffix: str = "") -> None:
        super().__init__({name: name_in_sumo(name, suffix) for name in known})
        self.suffix, self.back = suffix, {inside: name for name, inside in self.items()}

    def __missing__(self, name: str) -> str:
        return name

    def outside(self, answer: Any) -> Any:
        """The answer to a call, with the user's names.

        Raises TypeError for an answer of another type, which may hold names.
        """
        kind = type(answer)
        if kind is str:
            return answer.replace(self.suffix, "")
        if kind is tuple or kind is list:
            for it in answer:
                if type(it) is not float:
                    return kind(map(self.outside, answer))
            return answer  # floats, most often a position: no names
        if answer is None or isinstance(answer, int | float):
            return answer
        raise TypeError(f"an answer of type {kind.__name__}")


class Guard:
    """State of the guarded module during a case.

    shared: whether ADSs share SUMO (`traci_view.sharing`), even if only one drives.
    """

    shared = False

    def __init__(self) -> None:
        self.begin((), 0.0, "refuse")

    def begin(
        self,
        others: Iterable[str],
        step: float,
        interference: Literal["refuse", "record"],
        heeding_parts: Iterable[str] = (),
        lateral_speed: float = 1.0,
    ) -> None:
        """Begin a case: no listeners, nothing counted.

        others: names of the other vehicles; their types have the same names.
        step: s.
        heeding_parts: parts of SUMO, keys of `WHY_IGNORED`, that exist in the case, so that their
            calls have an effect.
        lateral_speed: m/s, of a lane change that takes the settings' duration.
        """
        self.lateral_speed = lateral_speed
        self.others = frozenset(others)
        self.step = step
        self.interference = interference
        self.listeners = libsumo.StepManager()
        # number of calls that wrote to more than the ego or had no effect, by the name of the clip
        self.touched = Counter[str]()
        self.heeding_parts = set(heeding_parts)
        self.ignorable = Counter[str]()  # number of each call that SUMO may ignore
        # whether a call has moved the ego since the step began, and whether a call has placed it
        self.moved = self.placed = False
        # largest lateral speeds of egos while `finish_change` holds, m/s, by names in SUMO
        self.lateral_speeds: dict[str, float] = {}
        self.refusal: tuple[str, str] | None = None  # `deed` and `why` of `refuse`
        self.names = SumoNames()
        self.mode_may_differ = True  # whether the ADS may have changed the ego's speed mode
        # Values read after the last step, by the vehicles' names in SUMO. A call that may change a
        # vehicle's speed or position deletes its speed: without a speed, neither value is valid.
        self.positions: dict[str, Any] = {}
        self.speeds: dict[str, float] = {}

    def leave(self) -> NoReturn:
        """Take a case out of its batch: it needs the simulation to itself.

        A user sees this message only if an ADS that drives alone calls a function that it has kept
        since a batch.
        """
        self.refuse(
            "The ADS called a function of traci that it had kept from another case",
            "it must take it from `traci` again",
        )

    def translate(
        self, call: str, vehicle: str, args: _Arguments, kwargs: Mapping[str, Any]
    ) -> tuple[str, _Arguments]:
        """Vehicle name and arguments, in SUMO, of a call that writes to an ego of a batch. Any
        other call takes the case out of its batch.
        """
        is_allowed = not kwargs and vehicle == EGO and call in _SHARED
        # a negative speed hands the ego over to SUMO's model; `not`: true of nan as well
        if not is_allowed or (call == "setSpeed" and not args[0] >= 0.0):
            self.leave()
        if call == "moveToXY":
            args = self._on_own_road(args)
        self.mode_may_differ = self.mode_may_differ or call == "setSpeedMode"
        self.speeds.pop(self.names[EGO], None)
        return self.names[EGO], tuple(self.names[it] if type(it) is str else it for it in args)

    def _on_own_road(self, args: _Arguments) -> _Arguments:
        """Arguments of moveToXY that keep the ego on its case's own road: other cases have roads at
        the same place.

        args: edge, lane, x, y, angle and `keepRoute`.
        """
        modes = (_ON_ITS_ROUTE, _ANYWHERE, _ANYWHERE_ON_ITS_ROUTE)
        if len(args) != 6 or args[0] not in ("", "road") or args[5] not in modes:
            self.leave()
        if args[5] == _ANYWHERE and "road" not in self.names:  # a road of several sections
            self.leave()
        keep_route = _ANYWHERE_ON_ITS_ROUTE if args[5] == _ANYWHERE else args[5]
        return ("road", *args[1:5], keep_route)

    def finish_change(self, ego: str) -> None:
        """Let SUMO finish a lane change in its next step: it crashes at the middle of the change if
        something else has moved the ego to the target lane by then.

        ego: its name in SUMO.
        """
        if ego not in self.lateral_speeds:
            speed = libsumo.vehicle.getMaxSpeedLat(ego)
            self.lateral_speeds[ego] = self.lateral_speed if speed == _UNSET else speed
            libsumo.vehicle.setMaxSpeedLat(ego, _AT_ONCE)

    def change_as_usual(self, ego: str) -> None:
        """Undo `finish_change`, if there was one."""
        if ego in self.lateral_speeds:
            libsumo.vehicle.setMaxSpeedLat(ego, self.lateral_speeds.pop(ego))

    def note_interference(self, what: str, deed: str, why: str) -> None:
        """Refuse or count a call that the ADS may not make.

        what: name of the clip that counts it.
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
        """Refuse a call with an impossible number, which SUMO would take.

        name: of the vehicle or type. args, kwargs: the arguments after the name.
        """
        fault = breach(domain, call, name, args, kwargs)
        if fault is not None:
            self.refuse(
                f"The ADS called traci.{domain}.{call} with `{fault.argument}` = "
                f"{shown(fault.given)}",
                f"it must be {fault.must_be}",
            )

    def note_touched(self, domain: str, call: str, name: object) -> None:
        """Refuse or count a call that writes to more than the ego.

        name: of the object that it writes to.
        """
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
            for call in self.ignorable
            if IGNORED.get(call) not in self.heeding_parts
        }

    def call_listeners(self) -> None:
        """Call every step listener of the ADS, as TraCI does after each step."""
        self.listeners.manageStepListeners(0.0)

    def end(self) -> None:
        """Count the calls that SUMO ignored, and remove every listener: its `cleanUp` is called."""
        if self.ignored:
            self.touched["ignored_traci_call"] = sum(self.ignorable[call] for call in self.ignored)
        for number in list(self.listeners._stepListeners):
            self.listeners.removeStepListener(number)


def heeding_parts(concrete: ConcreteScenario) -> set[str]:
    """Parts of SUMO, keys of `WHY_IGNORED`, that exist in a case from its start."""
    exists = {"traffic": concrete.reacts, "network": concrete.road.network is not None}
    return {key for key in exists if exists[key]}


GUARD = Guard()
"""The one of a process, as there is one libsumo."""


def _takes_any_number(write: _Call) -> _Call:
    """A call of libsumo that also takes numbers of numpy and torch, as traci does."""

    def plain(it: Any) -> Any:
        """A Python number from a number of numpy or torch."""
        return it.item() if hasattr(it, "item") else it

    @wraps(write)
    def takes_any(*args: Any, **kwargs: Any) -> Any:
        return write(*map(plain, args), **{name: plain(it) for name, it in kwargs.items()})

    return takes_any


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
            GUARD.ignorable[call] += 1
        if call == "moveToXY" and vehID == GUARD.names[EGO]:
            GUARD.finish_change(vehID)
        elif call in _OF_CHANGES:
            GUARD.change_as_usual(vehID)
        answer = write(vehID, *args, **kwargs)
        # from here on SUMO's model drives the ego; after setSpeed only if the speed is negative
        if (
            hands_over
            and vehID == EGO
            and (call != "setSpeed" or min(*args, *kwargs.values(), 0.0) < 0.0)
        ):
            GUARD.heeding_parts.add("model")
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

    # Python's error message for missing arguments shows this name
    set_speed.__qualname__ = write.__qualname__
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
            GUARD.ignorable[call] += 1
        return write(typeID, *args, **kwargs)

    return guarded


def _world_writer(domain: str, call: str, write: _Call) -> _Call:
    """A guarded call that writes to anything except vehicles and their types."""

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
        GUARD.ignorable[f"gui.{call}"] += 1

    return ignored


def _step_clock(*args: Any, **kwargs: Any) -> None:
    """Stand-in of a call that steps SUMO: notes the call and steps nothing."""
    # the argument is the time to step to, s; without one, or with 0, TraCI makes one step
    until = next((value for value in (*args, *kwargs.values()) if value), None)
    ahead = GUARD.step
    if until is not None:
        ahead = float(until) - libsumo.simulation.getTime()
    GUARD.note_interference(
        "stepped_the_clock", f"The ADS moved SUMO's clock by {ahead:+.2f} s",
        "stepping is the harness's (a program with a loop of its own runs as `traci:COMMAND`)",
    )  # fmt: skip


def _running_call(call: str) -> _Call:
    """Stand-in of a call that starts, loads or closes SUMO: notes the call and does nothing."""
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
    """A domain whose writing calls are wrapped; it inherits the reading calls as they are."""
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
"""One in a process: code that has imported `traci` in one case uses it in the next case, too."""


@contextmanager
def seen_as_traci(module: ModuleType = TRACI) -> Iterator[None]:
    """A context in which `import traci` and `import libsumo` give a module, by default `TRACI`."""
    before = {name: sys.modules[name] for name in ("traci", "libsumo")}
    sys.modules.update(dict.fromkeys(before, module))
    try:
        yield
    finally:
        sys.modules.update(before)
