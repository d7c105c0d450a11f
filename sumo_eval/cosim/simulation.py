"""Cases through SUMO: one at a time, or many that are driven together, in the same loop and to the
same bits.

Cases on one road with the same settings and number of actors can share one simulation, where
the ADS looks through observations: baselines, synthetic drivers, and users' policies. A hook, the
TraCI code of one function or class, shares a simulation too; some of its cases are driven alone as
well and compared. An ADS that needs the simulation to itself (listeners, programs, TraCI code that
keeps state) is driven alone; when a batch fails as a whole, each of its cases is driven alone too.
The caller receives the reason for each case that is driven alone.

Users: `record/`, `cosim/no_return.py`, `cosim/doors/contract.py`, `extras/`; users' own code calls
`sumo_eval.simulate`.
"""

from __future__ import annotations

import gc
import inspect
import logging
import time as clock
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from math import inf, pi
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from sumo_eval.cosim.compiled import Compiled
from sumo_eval.cosim.doors.controller import (
    Adapter,
    ControllerLike,
    ListenerController,
    NativeModel,
    ObjectController,
    PolicyController,
    adapted,
    load_controller,
    located,
    own_vehicle_type,
    takes_arrays,
)
from sumo_eval.cosim.doors.entry import split_entry, steps_between
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.cosim.doors.kept_state import first_change, kept_state, module_of, reaches_libsumo
from sumo_eval.cosim.doors.traci_module import GUARD, seen_as_traci
from sumo_eval.cosim.doors.traci_program import TraciProgram, served
from sumo_eval.cosim.doors.traci_view import sharing
from sumo_eval.cosim.ego_control import EgoControl, Replay, Replays, Rules, Terms
from sumo_eval.cosim.loop import break_off, drive
from sumo_eval.cosim.on_traci import OnTraci
from sumo_eval.cosim.policies import ASKS_SUMO, OneEach, OverArrays
from sumo_eval.cosim.records import MODEL, SUMO
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.sumo.session import running, session
from sumo_eval.cosim.sumo.shared_files import shared_network_xml, shared_routes_xml
from sumo_eval.cosim.sumo.sumo_files import gripped
from sumo_eval.cosim.traffic import Traffic
from sumo_eval.cosim.world import World, kind_of
from sumo_eval.errors import ControllerError, InputError, SimulationError, must_be, said
from sumo_eval.groups import grouped
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.road.reference_line import crosses_itself
from sumo_eval.settings import SimulationSettings
from sumo_eval.text import traceback_of
from sumo_eval.trajectory import Alone, Recording

_LOG = logging.getLogger(__name__)

# cases that are sorted into batches at once: their recordings stay in memory until all of them are
# driven, because they are yielded in the order of the cases
SORTED_AT_ONCE = 4096
# cases in one simulation: enough to share a step's fixed cost, few enough for the processor's
# caches
TOGETHER = 512
HOOKS_TOGETHER = 128  # fewer of hooks, since SUMO itself moves all their vehicles
# Cases of a hook that are also driven alone and compared: its first ones, where kept state usually
# shows, and a share of all cases, which finds state that shows later.
_COMPARED_FIRST, _COMPARED_LATER = 3, 0.01  # cases; share of the cases

USUAL = SimulationSettings()  # the defaults, validated once and not for every case
# reasons to drive a case alone; `trajectory.Alone` explains them
ON_TRACI = Alone("on_traci")
ONE_OBJECT = Alone("one_object")
NOT_TOGETHER = Alone("not_together")


def simulate(
    concrete: ConcreteScenario,
    controller: ControllerLike,
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = inf,
    seed: int = 0,
    period: float | None = None,
) -> Recording:
    """Run a concrete scenario with an ADS that controls the ego.

    controller: a locator string, a function, a class or an object (see
        `sumo_eval.cosim.doors.controller`).
    folder: where relative paths in a locator start.
    step_timeout: longest wall time of one controller step, s.
    seed: of what `settings.conditions` leave to chance.
    period: s from one call of the controller to the next; its answer holds in between. None: as
        its locator says.

    A fault of the ADS (an exception, a command that is not a finite number, motion that no vehicle
    can do, touching SUMO's clock) ends the run with `end_reason` "ads_error" and a sentence in
    `error`, too slow a step with "ads_timeout", a fault of SUMO with "sim_error". What was driven
    until then is kept.
    """
    settings = concrete.simulation(settings or USUAL)  # with the case's own changes
    _check_intervals(settings)
    ads = load_controller(controller, folder)
    every = _steps_per_call(controller, period, settings)
    began = clock.perf_counter()
    plant = None if settings.plant is None else FmuPlant(settings.plant, folder)
    terms = Terms(step_timeout, plant, folder, every)
    target = _driven_object(ads)
    is_rule = Compiled.rides(target)  # a baseline or driver whose kernel the loop runs
    if every > 1 and (is_rule or isinstance(ads, ListenerController)):
        raise InputError("Baselines and step listeners drive at every step; they take no `period`.")
    on_traci = not (is_rule or ads.is_policy)
    world = World([concrete], settings, SUMO if on_traci else MODEL)
    driver = _control([target if is_rule else ads], [seed], terms)
    try:
        with _opened(concrete, settings, ads, step_timeout, on_traci) as traci, seen_as_traci():
            stage = Traffic if world.reacts else Stage
            # as_read: actors are as SUMO shows them
            drive(world, driver, stage(traci, world, ads_asks=not is_rule, as_read=on_traci))
    # raised while the simulation is opened: `drive` turns its own errors into end reasons
    except (ControllerError, SimulationError) as error:
        break_off(world, error)
        world.end(0)
    world.logs[0] += getattr(ads, "log", "")
    (recording,) = world.recordings(clock.perf_counter() - began)
    assert isinstance(recording, Recording)
    return recording


def _steps_per_call(
    controller: ControllerLike, period: float | None, settings: SimulationSettings
) -> int:
    """Steps from one call of a controller to the next."""
    owner, usual = "the ADS", 0.0  # 0: it is called at every step
    if isinstance(controller, str):
        owner = f"ADS `{controller}`"
        usual = split_entry(controller)[1].period
    return steps_between(usual if period is None else period, settings.step, owner)


def _driven_object(ads: Adapter) -> Any:
    """The user's object that is called at every step, or the baseline; None where the ADS is a
    policy, which is driven through observations.
    """
    return None if ads.is_policy else ads.target


def _control(ads: Sequence[Any], seeds: Sequence[int], terms: Terms) -> EgoControl:
    """Control of the egos of cases.

    ads: what drives each case, all of one kind: baseline (`Compiled`), `Replay` or `Adapter`.
    """
    kind: type[EgoControl] = OneEach
    first = ads[0]
    if isinstance(first, Compiled):
        kind = Rules
    elif isinstance(first, Replay):
        kind = Replays
    elif not first.is_policy:
        kind = OnTraci
    elif takes_arrays(first.target):
        kind = OverArrays
        if terms.every > 1:
            raise InputError(
                "A policy over arrays (`batch`) is asked at every step; it takes no `period`."
            )
    return kind(ads, seeds, terms)


def _opened(
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    ads: Adapter,
    step_timeout: float,
    on_traci: bool,
) -> AbstractContextManager[Any]:
    """The simulation of a single case.

    on_traci: the ADS drives through TraCI, so that SUMO's own models may move the ego.
    """
    if isinstance(ads, TraciProgram):
        return served(concrete, settings, ads, step_timeout)
    road = concrete.road
    if not on_traci and road.network is None:
        asks = ads.is_policy  # it may ask SUMO for lanes: the network must hold this road alone
        return running(
            shared_network_xml([concrete], ads_asks=asks),
            shared_routes_xml([concrete], settings, own_lanes=asks),
            settings,
            road,
            collisions="none",
        )
    ego_type = (
        ads.vtype_on(road)
        if isinstance(ads, NativeModel)
        else own_vehicle_type(_driven_object(ads), road)
    )
    return session(concrete, settings, ego_type)


def _check_intervals(settings: SimulationSettings) -> None:
    """Raise InputError unless `step` is in whole milliseconds and `record_interval` in whole
    steps.
    """
    milliseconds = settings.step * 1000.0
    if round(milliseconds) < 1 or abs(milliseconds - round(milliseconds)) > 1e-6:
        raise must_be(
            "`step`",
            "the simulation",
            "a whole number of milliseconds (SUMO rounds it)",
            settings.step,
        )
    ratio = settings.record_interval / settings.step
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9:
        raise must_be(
            "`record_interval`",
            "the simulation",
            f"a multiple of `step` ({settings.step:g} s)",
            settings.record_interval,
        )


# -- many ------------------------------------------------------------------------------------------


def simulate_many(
    cases: Sequence[ConcreteScenario],
    controller: ControllerLike | Sequence[ControllerLike],
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    alone: Counter[Alone] | None = None,
) -> Iterator[Recording]:
    """Recordings of concrete scenarios in their order; `folder` and errors as in `simulate`.

    controller: an ADS, or a list with one controller for each case. Of a locator, a class or a
        function every case gets a fresh object; a single object serves all cases in order.
    alone: counts the cases that are driven one by one, by reason.
    """
    terms = Terms(folder=folder)
    for index, driven in enumerate(simulate_together(cases, controller, settings, terms=terms)):
        if isinstance(driven, Alone):
            if alone is not None:
                alone[driven] += 1
            own = controller[index] if isinstance(controller, list | tuple) else controller
            driven = simulate(cases[index], own, settings, folder=folder)
        yield driven


def simulate_together(
    cases: Sequence[ConcreteScenario],
    controller: ControllerLike | Sequence[ControllerLike],
    settings: SimulationSettings | None,
    *,
    terms: Terms | None = None,
    seeds: Sequence[int] | None = None,
    wrap: Callable[[Adapter], Adapter] = lambda ads: ads,
    batches: bool = True,
) -> Iterator[Recording | Alone]:
    """Recordings of cases driven together, in their order; the reason instead of a recording for a
    case that has to be driven alone.

    terms: how long a step may take, and where relative paths start.
    seeds: of each case, for the random numbers of the conditions.
    wrap: applied to the policy or hook of each case, to observe its calls.
    batches: whether a policy over arrays may see many cases at once (its numbers may then depend
        on its batch).
    """
    basis = settings or USUAL
    _check_intervals(basis)
    seeds, terms = seeds or [0] * len(cases), terms or Terms()
    if isinstance(controller, list | tuple):
        if len(controller) != len(cases):
            each = f"one for each of the {len(cases)} cases"
            raise must_be("The controllers", "`simulate_many`", each, len(controller))
        manners = [_manner(it, terms.folder, wrap, batches, one_case=True) for it in controller]
    else:
        terms = terms._replace(every=_steps_per_call(controller, None, basis))
        manners = [_manner(controller, terms.folder, wrap, batches)] * len(cases)

    for window in _chunks(range(len(cases)), SORTED_AT_ONCE):
        drives: dict[int, Recording | Alone] = {}
        # indices of the cases
        by_kind = grouped((_kind(cases[index], manners[index], basis), index) for index in window)
        for kind, members in by_kind.items():
            if kind is None:
                drives.update({index: manners[index].alone or NOT_TOGETHER for index in members})
                continue
            # settings that the kind shares: one case's without its changes, which the world applies
            common = replace(cases[members[0]], changes=()).simulation(basis)
            by_end = sorted(
                members,
                key=lambda index: probable_end(cases[index], decided=common.end_when_decided),
            )
            size = HOOKS_TOGETHER if manners[members[0]].is_hook else TOGETHER
            for part in _chunks(by_end, size):
                driven = _drive_batch(
                    [cases[index] for index in part],
                    [manners[index] for index in part],
                    [seeds[index] for index in part],
                    terms,
                    common,
                )
                drives.update(zip(part, driven, strict=True))
        # a later batch of this window may have shown that a hook keeps state; drives of earlier
        # windows have been yielded already
        for index in window:
            code = manners[index].code
            drive_or_reason = drives.pop(index)
            yield drive_or_reason if code is None else _KEEPS_STATE.get(code, drive_or_reason)


def _kind(
    concrete: ConcreteScenario, manner: _Manner, basis: SimulationSettings
) -> tuple[object, ...] | None:
    """The kind of a case: cases of equal kinds share a simulation; None: it has to be driven alone.

    Kinds are equal only where driving together gives the same bits as driving alone: on one road,
    with equally many actors that look alike to SUMO (for a stream: of equal density).
    """
    road, ego = concrete.road, concrete.ego
    if (
        manner.alone is not None
        or basis.plant is not None  # it moves one ego
        or basis.conditions.step_budget is not None  # a step's wall time is one case's own
        or road.network is not None
        or not concrete.actors
        or not road.right_edge_at(ego.x) <= ego.y <= road.left_edge_at(ego.x)  # off the road
    ):
        return None
    # a hook may ask SUMO for objects that a batch does not show there: lanes that end or cross,
    # vehicles placed on the map, vehicles against the road's direction
    not_shown = road.shaped or any(
        abs(it.heading) > 0.5 * pi or it.on_map is not None for it in concrete.actors
    )
    if manner.is_hook and (not_shown or crosses_itself(road.line, road.end, road.left_edge)):
        return None
    lively = concrete.actors if concrete.lively else ()
    # settings that a case may change, but that must be equal in a batch: the vehicle, since a
    # policy over arrays receives one for all cases; the ego's deceleration limit for SUMO's models
    shared: object = None
    if concrete.changes and (concrete.reacts or manner.over_arrays):
        vehicle = concrete.simulation(basis).vehicle
        shared = vehicle if manner.over_arrays else gripped(vehicle).max_deceleration
    return (
        concrete.scenario, kind_of(concrete),
        # the actors as SUMO sees them
        tuple([(it.body, it.model is None, it.follows_at_once) for it in lively]),
        manner.driver_key,
        # a hook asks for actors by their names
        tuple([it.name for it in concrete.actors]) if manner.is_hook else (),
        shared,
    )  # fmt: skip


def _drive_batch(
    cases: list[ConcreteScenario],
    manners: list[_Manner],
    seeds: list[int],
    terms: Terms,
    settings: SimulationSettings,
) -> Sequence[Recording | Alone]:
    """The recording of each case of one kind, or why it has to be driven alone.

    Some cases of a hook, or of a policy that keeps state, are driven alone as well and compared.
    """
    control = _control([manner.make() for manner in manners], seeds, terms)
    code, is_hook = manners[0].code, manners[0].is_hook
    if code is None:
        return _together(cases, control, settings)
    if code not in _KEEPS_STATE:
        before = kept_state(code)
        drives = _together(cases, control, settings)
        changed = first_change(before, kept_state(code))
        differs = partial(_difference, cases, manners[0], seeds, terms, settings, drives)
        if is_hook:
            changed = changed or differs()
        elif changed and not differs():
            changed = None  # a cache, which changes no drive
        if changed is None:
            return drives
        _KEEPS_STATE[code] = Alone("keeps_state", changed)
    return [_KEEPS_STATE[code]] * len(cases)


class _Manner(NamedTuple):
    """Manner in which an ADS drives its cases.

    driver_key: the type of what drives, or the `id` of a policy over arrays; only cases with
        equal keys share a simulation.
    make: gives what drives one case.
    alone: why it is driven alone; None: it may share a simulation.
    over_arrays: one policy drives all cases at once.
    code: the class or function of a user, of which each case has a fresh object; else None.
    is_hook: whether it is TraCI code, which sees its own row of SUMO only.
    """

    driver_key: type | int | None
    make: Callable[[], Any]
    alone: Alone | None = None
    over_arrays: bool = False
    code: Any = None
    is_hook: bool = False


def _manner(
    controller: ControllerLike, folder: Path | None, wrap: Callable[[Adapter], Adapter],
    batches: bool,
    *, one_case: bool = False,
) -> _Manner:  # fmt: skip
    """Manner of an ADS: replay, baseline, hook, policy over arrays, or plain policy.

    one_case: the controller serves one case only.
    """

    def alone(reason: Alone) -> _Manner:
        return _Manner(None, lambda: None, reason)

    if isinstance(controller, Replay):
        return _Manner(Replay, lambda: controller)
    # user_code: class, function or object
    user_code, name, entry = located(controller, folder)
    if not entry.batch:
        return alone(Alone("asked", "batch=false"))
    if one_case and entry.period:  # a batch has one period
        return alone(Alone("asked", "period"))
    make = partial(adapted, user_code, name, entry.options)
    is_code = inspect.isclass(user_code) or inspect.isfunction(user_code)
    keeps_state = _KEEPS_STATE.get(user_code) if is_code else None
    ads: Any = make()
    target = _driven_object(ads)
    if Compiled.rides(target):
        return _Manner(type(target), lambda: target)
    if not isinstance(ads, PolicyController):
        own_type = getattr(user_code, "vehicle_type", None)
        if own_type is not None or not isinstance(ads, ObjectController):
            return alone(ON_TRACI)
        if not is_code:
            return alone(ONE_OBJECT)
        if reaches_libsumo(user_code, target):
            return alone(ON_TRACI)
        if getattr(user_code, "batch", True) is False:
            return alone(Alone("asked", "batch = False"))
        if keeps_state is not None:
            return alone(keeps_state)
        return _Manner(ObjectController, lambda: wrap(make()), code=user_code, is_hook=True)
    policy = ads.target
    if _asks_traci(policy if policy is not None else ads.act):
        return alone(ASKS_SUMO)
    if takes_arrays(policy):
        shared = wrap(ads)
        if not batches:
            return alone(Alone("batch"))
        # `id`, not type: in a list of controllers, each such policy drives its own cases
        return _Manner(id(policy), lambda: shared, over_arrays=True)
    if one_case:
        return _Manner(type(ads), lambda: ads)
    # a function or a class: fresh for each case
    if policy is None or isinstance(user_code, type):
        if keeps_state is not None:
            return alone(keeps_state)
        return _Manner(type(ads), lambda: wrap(make()), code=user_code if is_code else None)
    return alone(ONE_OBJECT)


def _asks_traci(target: Any) -> bool:
    """Whether the module of a policy holds TraCI: it may ask SUMO, so that its cases are driven
    alone. A policy that imports TraCI elsewhere is refused when it asks (`_Refused`).
    """
    module = module_of(getattr(target, "__func__", target))
    return module is not None and any(
        isinstance(it, ModuleType) and it.__name__ in ("traci", "libsumo")
        for it in list(vars(module).values())
    )


def _chunks(items: Sequence[int], size: int) -> Iterator[Sequence[int]]:
    return (items[begin : begin + size] for begin in range(0, len(items), size))


def probable_end(concrete: ConcreteScenario, *, decided: bool = False) -> float:
    """Estimated end of a case, s: cases that end together share a simulation, which lasts as long
    as its last.

    decided: cases end once they are decided: when the ego would reach an actor ahead, both at
        their first speeds. Else: when it would reach the road's end at the lowest first speed
        above 0 of any vehicle.
    """
    ego = concrete.ego
    starts = [actor.start for actor in concrete.actors]
    if decided:
        times = [
            (start.x - ego.x) / (ego.speed - start.speed)
            for start in starts
            if start.x > ego.x and ego.speed > start.speed
        ]
        return min(times, default=inf)
    slowest = min((it.speed for it in (ego, *starts) if it.speed > 0.0), default=inf)
    return (concrete.road.length - ego.x) / slowest


_COMPARED = WeakKeyDictionary[Any, int]()
"""By hook or policy: how many of its cases were driven together and alone."""
_KEEPS_STATE = WeakKeyDictionary[Any, Alone]()
"""By hook or policy that keeps state: why all its cases are driven alone."""


def _difference(
    cases: Sequence[ConcreteScenario],
    manner: _Manner,
    seeds: Sequence[int],
    terms: Terms,
    settings: SimulationSettings,
    drives: list[Recording | Alone],
) -> str | None:
    """Drive a few cases of a batch, spread over it, alone as well; return words on the first that
    differs, for the text of `Alone("keeps_state", ...)`; None: none differs.

    drives: recordings of the batch; recordings that do not differ are marked as compared.
    """
    batched = [index for index, drive in enumerate(drives) if isinstance(drive, Recording)]
    compared = _COMPARED.get(manner.code, 0)
    # compare the first few cases of this code, and of a hook also a share of each batch
    later = max(round(_COMPARED_LATER * len(batched)), 1) if manner.is_hook else 0
    wanted = max(_COMPARED_FIRST - compared, later)
    if not wanted:
        return None
    chosen = batched[:: max(len(batched) // wanted, 1)][:wanted]  # evenly spread
    _COMPARED[manner.code] = compared + len(chosen)
    for index in chosen:
        own = simulate(
            cases[index], manner.make(), settings, folder=terms.folder, seed=seeds[index],
            step_timeout=terms.step_timeout,
            period=terms.every * settings.step,
        )  # fmt: skip
        together = drives[index]
        if not (isinstance(together, Recording) and own.same_drive(together)):
            # the report names this in place of the state that changed
            return (
                "unknown which, or it reads a clock or draws without a seed: "
                f"{cases[index].label} drives differently when it is alone"
            )
        drives[index] = replace(together, batched=together.batched and "compared")
    return None


def _together(
    cases: Sequence[ConcreteScenario], driver: EgoControl, settings: SimulationSettings
) -> list[Recording | Alone]:
    """The recording of each case, or why it has to be driven alone."""
    began = clock.perf_counter()
    ads_asks = isinstance(driver, OnTraci)
    texts = (
        shared_network_xml(cases, ads_asks=ads_asks),
        shared_routes_xml(cases, settings, ads_asks=ads_asks),
    )
    try:
        world = World(cases, settings, SUMO if ads_asks else MODEL)
        with (
            running(*texts, settings, collisions="none") as traci,
            sharing() if ads_asks else seen_as_traci(_Refused("traci")),
            _rare_garbage_collection(),
        ):
            stage = Traffic if world.reacts else Stage
            drive(world, driver, stage(traci, world, ads_asks=ads_asks, as_read=ads_asks))
    # any error: the cases can still be driven alone. The log gets the traceback
    except Exception as error:  # noqa: BLE001
        _LOG.error(
            "%d cases that were driven together failed; each is driven alone.\n%s",
            len(cases),
            traceback_of(error),
        )
        return [Alone("together_failed", said(error))] * len(cases)
    batched = "batched" if ads_asks and len(cases) > 1 else ""
    return world.recordings(clock.perf_counter() - began, batched)


@contextmanager
def _rare_garbage_collection() -> Iterator[None]:
    """Let Python search for cycles of garbage a hundredth as often: a batch makes none."""
    before = gc.get_threshold()
    gc.set_threshold(100 * before[0], *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


class _Refused(ModuleType):
    """The module of `import traci` where SUMO holds many cases: it answers nothing."""

    def __getattr__(self, name: str) -> Any:
        GUARD.refuse(f"The ADS asked for traci.{name}", "it is driven together with others")
