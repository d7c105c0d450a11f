"""Cases through SUMO: one at a time, or many that are driven together, in the same loop and to the
same bits.

Cases on the same road with the same settings and as many actors can share one simulation, where
the ADS looks through observations: baselines, synthetic drivers, and users' policies. An ADS that
needs the simulation to itself (TraCI code, listeners, programs) is driven alone; when a batch fails
as a whole, each of its cases is driven alone too. The caller receives how many, and why.
"""

from __future__ import annotations

import gc
import inspect
import logging
import math
import sys
import time as clock
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeVar
from weakref import WeakKeyDictionary

from sumo_eval.cosim.compiled import Compiled
from sumo_eval.cosim.doors.controller import (
    Adapter,
    ControllerLike,
    ListenerController,
    NativeModel,
    ObjectController,
    adapted,
    find_controller,
    load_controller,
    own_vehicle_type,
    takes_arrays,
)
from sumo_eval.cosim.doors.entry import PLAIN, split_entry, steps_between
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.cosim.doors.kept_state import first_change, kept_state, reached_modules
from sumo_eval.cosim.doors.traci_module import RefusedCallError, seen_as_traci
from sumo_eval.cosim.doors.traci_program import TraciProgram, served
from sumo_eval.cosim.doors.traci_view import sharing
from sumo_eval.cosim.loop import (
    ASKS_SUMO,
    EgoControl,
    OneEach,
    OverArrays,
    Replay,
    Replays,
    Rules,
    Terms,
    break_off,
    drive,
)
from sumo_eval.cosim.on_traci import OnTraci
from sumo_eval.cosim.records import MODEL, SUMO
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.sumo.insides import libsumo
from sumo_eval.cosim.sumo.session import running, session
from sumo_eval.cosim.sumo.shared_files import plain, shared_network_xml, shared_routes_xml
from sumo_eval.cosim.sumo.sumo_files import network_xml
from sumo_eval.cosim.traffic import Traffic
from sumo_eval.cosim.world import World, kind_of
from sumo_eval.errors import ControllerError, InputError, SimulationError, must_be, said
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.text import traceback_of
from sumo_eval.trajectory import Alone, Recording

__all__ = ["simulate", "simulate_many", "simulate_together"]

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)

SORTED_AT_ONCE = 4096  # cases whose recordings are held until those before them are there
# cases in one simulation: enough to share a step's fixed cost, few enough for the processor's
# caches
TOGETHER = 512

USUAL = SimulationSettings()  # checked once, and not for every case
# cases of hooks in one simulation, whose every vehicle SUMO's driver models move
HOOKS_TOGETHER = 256
ON_TRACI = Alone("on_traci")
ONE_OBJECT = Alone("one_object")
NOT_TOGETHER = Alone("not_together")
BATCH = Alone("batch")


def simulate(
    concrete: ConcreteScenario,
    controller: ControllerLike,
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = math.inf,
    seed: int = 0,
    period: float | None = None,
) -> Recording:
    """Run a concrete scenario with an ADS that controls the ego.

    controller: a locator string, a function, a class or an object (see
        `sumo_eval.cosim.doors.controller`).
    folder: where relative paths in a locator start.
    step_timeout: longest wall time of one controller step, s.
    seed: of what `settings.conditions` leave to chance.
    period: s from one call of the controller to the next, in between its answer holds; None: as its
        locator says.

    A fault of the ADS (an exception, a command that is not a finite number, motion that no vehicle
    can do, touching SUMO's clock) ends the run with `end_reason` "ads_error" and a sentence in
    `error`, too slow a step with "ads_timeout", a fault of SUMO with "sim_error". What was driven
    until then is kept.
    """
    settings = concrete.simulation(settings or USUAL)
    check_intervals(settings)
    ads = load_controller(controller, folder)
    every = _steps_between(controller, period, settings)
    began = clock.perf_counter()
    plant = (
        None if settings.plant is None else FmuPlant(settings.plant, settings.plant.file, folder)
    )
    terms = Terms(step_timeout, plant, folder, every)
    target = _target(ads)
    if every > 1 and (Compiled.rides(target) or isinstance(ads, ListenerController)):
        raise InputError("Baselines and step listeners drive at every step; they take no `period`.")
    alone = Compiled.rides(target) or ads.is_policy
    world = World([concrete], settings, MODEL if alone else SUMO)
    driver: EgoControl
    if Compiled.rides(target):
        driver = Rules([target], terms)
    elif ads.is_policy:
        driver = _policies([ads], [seed], terms)
    else:
        driver = OnTraci([ads], [seed], terms)
    asks = not Compiled.rides(target)
    try:
        with _opened(concrete, settings, ads, step_timeout, alone) as traci, seen_as_traci():
            stage = Traffic if world.reacts else Stage
            drive(world, driver, stage(traci, world, asked=asks, as_read=not alone))
    except (ControllerError, SimulationError) as error:  # before the first step
        break_off(world, error)
        world.end(0)
    world.logs[0] = world.logs.get(0, "") + getattr(ads, "log", "")
    (recording,) = world.recordings(clock.perf_counter() - began)
    assert isinstance(recording, Recording)
    return recording


def _steps_between(
    controller: ControllerLike, period: float | None, settings: SimulationSettings
) -> int:
    """Steps from one call of a controller to the next."""
    if period is None:
        period = split_entry(controller)[1].period if isinstance(controller, str) else 0.0
    return steps_between(
        period, settings.step, f"ADS `{controller}`" if isinstance(controller, str) else "the ADS"
    )


def _target(ads: Adapter) -> Any:
    """The user's own object or the baseline; None of a policy."""
    return None if ads.is_policy else ads.target


def _policies(ads: Sequence[Any], seeds: Sequence[int], terms: Terms) -> EgoControl:
    if takes_arrays(ads[0].target):
        if terms.every > 1:
            raise InputError(
                "A policy over arrays (`batch`) is asked at every step; it takes no `period`."
            )
        return OverArrays(ads[0], seeds, terms)
    return OneEach(ads, seeds, terms)


def _opened(
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    ads: Adapter,
    step_timeout: float,
    alone: bool,
) -> AbstractContextManager[Any]:
    """The simulation of a single case.

    alone: SUMO's own models are asked nothing.
    """
    if isinstance(ads, TraciProgram):
        return served(concrete, settings, ads, step_timeout)
    if alone and concrete.road.network is None:
        asks = ads.is_policy  # and may look at SUMO's lanes
        network = network_xml(plain(concrete.road)) if asks else shared_network_xml([concrete])
        texts = network, shared_routes_xml([concrete], settings.vehicle, own_lanes=asks)
        return running(*texts, settings, concrete.road, collisions="none")
    road = concrete.road
    its_own = (
        ads.vtype_on(road) if isinstance(ads, NativeModel) else own_vehicle_type(_target(ads), road)
    )
    return session(concrete, settings, its_own)


def check_intervals(settings: SimulationSettings) -> None:
    """SUMO rounds its step to milliseconds, and a sample falls on a step."""
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
    """Recordings of concrete scenarios in their order; other arguments and errors as in `simulate`.

    controller: an ADS (a locator, a class or a function, so that every case gets a fresh one; an
        object that is given ready-made serves all cases in order), or a list with one controller
        for each case. Cases of one kind are driven together where the ADS and they allow it, in any
        order; all else one by one.
    alone: counts these, by the reason.
    """
    together = simulate_together(cases, controller, settings, terms=Terms(folder=folder))
    each = controller if isinstance(controller, list | tuple) else [controller] * len(cases)
    for concrete, its_own, found in zip(cases, each, together, strict=True):
        if isinstance(found, Recording):
            yield found
        else:
            if alone is not None:
                alone[found] += 1
            yield simulate(concrete, its_own, settings, folder=folder)


def simulate_together(
    cases: Sequence[ConcreteScenario],
    controller: ControllerLike | Sequence[ControllerLike],
    settings: SimulationSettings | None = None,
    *,
    terms: Terms | None = None,
    seeds: Sequence[int] | None = None,
    wrap: Callable[[Adapter], Adapter] = lambda ads: ads,
    batches: bool = True,
) -> Iterator[Recording | Alone]:
    """Recordings of cases driven together, in their order; for one that has to be driven alone, the
    reason. Those of a kind go together: as many other vehicles on one road. How many there are of a
    stream depends on its density.

    terms: how long a step may take, and where relative paths start.
    seeds: of each case, of what the conditions leave to chance.
    wrap: put around the policy of each case.
    batches: whether a policy over arrays may see many cases at once; its numbers may depend on
        which.
    """
    basis = settings or USUAL
    check_intervals(basis)
    given, terms = seeds or [0] * len(cases), terms or Terms()
    folder = terms.folder
    if isinstance(controller, list | tuple):
        if len(controller) != len(cases):
            each = f"one for each of the {len(cases)} cases"
            raise must_be("The controllers", "`simulate_many`", each, len(controller))
        riders = [_rider(its_own, folder, wrap, batches, its_own=True) for its_own in controller]
    else:
        terms = terms._replace(every=_steps_between(controller, None, basis))
        riders = [_rider(controller, folder, wrap, batches)] * len(cases)
    # a plant moves one ego, and a step's wall time is one case's own
    as_usual = basis.plant is None and basis.conditions.step_budget is None

    def kind(index: int) -> tuple[object, ...] | None:
        concrete, rider = cases[index], riders[index]
        if (
            rider.why is not None
            or not as_usual
            or concrete.road.network is not None
            or not _stands_on_its_road(concrete)
            or (rider.is_hook and not _fits_beside_others(concrete, basis))
        ):
            return None
        body = (
            concrete.scenario, kind_of(concrete),
            tuple([(it.body, it.model is None,
                it.follows_at_once) for it in concrete.actors if concrete.lively]),
        )  # fmt: skip
        # SUMO's models and a policy over arrays know of one vehicle for all
        one = bool(concrete.changes) and (concrete.reacts or rider.over_arrays)
        names = tuple([it.name for it in concrete.actors]) if rider.is_hook else ()
        return (*body, rider.kind, names, concrete.simulation(basis).vehicle if one else None)

    for window in _chunks(list(range(len(cases))), SORTED_AT_ONCE):
        found: dict[int, Recording | Alone] = {}
        alike: dict[tuple[object, ...] | None, list[int]] = {}
        for index in window:
            alike.setdefault(kind(index), []).append(index)
        for key, members in alike.items():
            if key is None:
                found.update({index: riders[index].why or NOT_TOGETHER for index in members})
                continue
            resolved = replace(cases[members[0]], changes=()).simulation(basis)
            order = sorted(
                members,
                key=lambda index: probable_end(cases[index], decided=resolved.end_when_decided),
            )
            size = HOOKS_TOGETHER if riders[members[0]].is_hook else TOGETHER
            for part in _chunks(order, size):
                made, batch = (
                    [riders[index].make() for index in part],
                    [cases[index] for index in part],
                )
                seeds_here = [given[index] for index in part]
                if riders[part[0]].is_hook:
                    driven: Sequence[Recording | Alone] = _hooks_together(
                        batch, riders[part[0]], made, seeds_here, terms, resolved
                    )
                else:
                    driver = (
                        Rules(made, terms) if isinstance(made[0], Compiled)
                        else Replays(made, terms) if isinstance(made[0], Replay)
                        else _policies(made, seeds_here, terms)
                    )  # fmt: skip
                    driven = _together(batch, driver, resolved)
                found.update(zip(part, driven, strict=True))
        for index in window:  # a later batch may have shown what an earlier one did not
            hook, recording = riders[index].hook, found.pop(index)
            yield recording if hook is None else _KEEPS_STATE.get(hook, recording)


class _Rider(NamedTuple):
    """How a case is driven: `make` gives its driver, those of one kind can share a simulation.

    why: it drives alone.
    over_arrays: one policy drives all of them.
    hook: the class or function that asks SUMO, which shows it its own row.
    """

    kind: type | None
    make: Callable[[], Any]
    why: Alone | None = None
    over_arrays: bool = False
    hook: Any = None

    @property
    def is_hook(self) -> bool:
        """Whether it asks SUMO."""
        return self.hook is not None


def _rider(
    controller: ControllerLike, folder: Path | None, wrap: Callable[[Adapter], Adapter],
    batches: bool,
    *, its_own: bool = False,
) -> _Rider:  # fmt: skip
    """How an ADS drives its cases.

    its_own: the object serves this case and no other.
    """

    def alone(why: Alone) -> _Rider:
        return _Rider(None, lambda: None, why)

    if isinstance(controller, Replay):
        return _Rider(Replay, lambda: controller)
    found, name, entry = controller, repr(controller), PLAIN
    if isinstance(controller, str):
        found, name, entry = (
            find_controller(controller, folder),
            controller,
            split_entry(controller)[1],
        )
    if not entry.batch:
        return alone(Alone("asked", "batch=false"))
    if its_own and entry.period:  # a batch has one period
        return alone(Alone("asked", "period"))
    make = partial(adapted, found, name, entry.options)
    with seen_as_traci():
        ads: Any = make()
    target = _target(ads)
    if Compiled.rides(target):
        return _Rider(type(target), lambda: target)
    if not ads.is_policy:
        batches_hooks = isinstance(ads, ObjectController) and not _needs_all_of_sumo(found)
        if not batches_hooks or getattr(found, "vehicle_type", None) is not None:
            return alone(ON_TRACI)
        if not inspect.isclass(found) and not inspect.isfunction(found):
            return alone(ONE_OBJECT)
        if getattr(found, "batch", True) is False:
            return alone(Alone("asked", "batch = False"))
        if found in _KEEPS_STATE:
            return alone(_KEEPS_STATE[found])
        return _Rider(ObjectController, lambda: wrap(make()), hook=found)
    if asks_traci(ads.target if ads.target is not None else ads.act):
        return alone(ASKS_SUMO)
    if its_own:
        return _Rider(type(ads), lambda: ads)
    if takes_arrays(ads.target):
        all_of_them = wrap(ads)
        if not batches:
            return alone(BATCH)
        return _Rider(type(ads), lambda: all_of_them, over_arrays=True)
    if ads.target is None or isinstance(found, type):
        return _Rider(type(ads), lambda: wrap(make()))
    return alone(ONE_OBJECT)


def _needs_all_of_sumo(hook: Any) -> bool:
    """Whether a hook's code has libsumo itself, or functions of it that know no rows."""
    return any(
        it is libsumo or getattr(it, "__module__", "") == "libsumo.libsumo"
        for module in reached_modules(hook)
        for it in list(vars(module).values())
    )


def asks_traci(target: Any) -> bool:
    """Whether the module of a policy has imported TraCI: it may ask SUMO, which then has to hold
    its case alone.
    """
    function = getattr(target, "__func__", target)
    module = sys.modules.get(getattr(function, "__module__", "") or type(target).__module__)
    values = [] if module is None else list(vars(module).values())
    return any(isinstance(it, ModuleType) and it.__name__ in ("traci", "libsumo") for it in values)


def _chunks(items: list[_T], size: int) -> Iterator[list[_T]]:
    return (items[begin : begin + size] for begin in range(0, len(items), size))


def probable_end(concrete: ConcreteScenario, *, decided: bool = False) -> float:
    """About when a case ends, s: cases that end together share a simulation, which lasts as long as
    its last.

    When the ego is at the road's end if it stays behind the slowest that moves; of a case that ends
    when it is `decided`, when the ego reaches another vehicle at the speeds of the start.
    """
    ego, starts = concrete.ego, [actor.start for actor in concrete.actors]
    if decided:
        times = [
            (start.x - ego.x) / (ego.speed - start.speed)
            for start in starts
            if start.x > ego.x and ego.speed > start.speed
        ]
        return min(times, default=math.inf)
    speeds = [start.speed for start in (ego, *starts) if start.speed > 0.0]
    return (concrete.road.length - ego.x) / min(speeds, default=math.inf)


def _stands_on_its_road(concrete: ConcreteScenario) -> bool:
    road = concrete.road
    ego = concrete.ego
    return bool(concrete.actors) and bool(
        road.right_edge_at(ego.x) <= ego.y <= road.left_edge_at(ego.x)
    )


def _fits_beside_others(concrete: ConcreteScenario, basis: SimulationSettings) -> bool:
    """Whether SUMO finds the vehicles of a case on the same lanes beside others as alone."""
    road = concrete.road
    usual = replace(concrete, changes=()) if concrete.changes else concrete
    its_own = concrete.simulation(basis).vehicle != usual.simulation(basis).vehicle
    if road.shaped or concrete.reacts or its_own:
        return False
    return all(
        it.heading == 0.0 and it.on_map is None and road.right_edge <= it.start.y <= road.left_edge
        for it in concrete.actors
    )


# how many cases of a hook were driven both ways, and why one drives all of them alone
_COMPARED: WeakKeyDictionary[Any, int] = WeakKeyDictionary()
_KEEPS_STATE: WeakKeyDictionary[Any, Alone] = WeakKeyDictionary()
_COMPARED_FIRST, _COMPARED_LATER = 3, 0.01  # cases; share of the cases


def _hooks_together(
    cases: Sequence[ConcreteScenario],
    rider: _Rider,
    made: Sequence[Adapter],
    seeds: Sequence[int],
    terms: Terms,
    settings: SimulationSettings,
) -> Sequence[Recording | Alone]:
    """The recording of each case of a hook, some of which were compared with those alone."""
    hook = rider.hook
    if why := _KEEPS_STATE.get(hook):
        return [why] * len(cases)
    before = kept_state(hook)
    found = _together(cases, OnTraci(made, seeds, terms), settings)
    changed = first_change(before, kept_state(hook)) or _difference(
        cases, rider, seeds, terms, settings, found
    )
    if changed is None:
        return found
    why = _KEEPS_STATE[hook] = Alone("keeps_state", changed)
    return [why] * len(cases)


def _difference(
    cases: Sequence[ConcreteScenario],
    rider: _Rider,
    seeds: Sequence[int],
    terms: Terms,
    settings: SimulationSettings,
    found: list[Recording | Alone],
) -> str | None:
    """Drive a few cases of a batch alone, too; which of them differs, None: none does."""
    drive_alone = _as_alone(terms, settings)
    for index in _chosen(rider.hook, found):
        own, batched = drive_alone(cases[index], rider.make(), seed=seeds[index]), found[index]
        if not (isinstance(batched, Recording) and own.same_motion(batched)):
            return f"not seen where; {cases[index].label} differs alone"
        found[index] = replace(batched, batched="compared")
    return None


def _as_alone(terms: Terms, settings: SimulationSettings) -> Callable[..., Recording]:
    """`simulate` on the terms of a batch."""
    period = terms.every * settings.step if terms.every > 1 else None
    return partial(simulate, settings=settings, folder=terms.folder,
        step_timeout=terms.step_timeout, period=period)  # fmt: skip


def _chosen(hook: Any, found: Sequence[Recording | Alone]) -> list[int]:
    """Cases of a batch to be driven alone, too, spread over it."""
    batched = [index for index, one in enumerate(found) if isinstance(one, Recording)]
    compared = _COMPARED.get(hook, 0)
    wanted = max(_COMPARED_FIRST - compared, math.ceil(_COMPARED_LATER * len(batched)), 1)
    chosen = batched[:: max(len(batched) // wanted, 1)][:wanted]
    _COMPARED[hook] = compared + len(chosen)
    return chosen


def _together(
    cases: Sequence[ConcreteScenario], driver: EgoControl, settings: SimulationSettings
) -> list[Recording | Alone]:
    """The recording of each case, or why it has to be driven alone."""
    began = clock.perf_counter()
    asks = isinstance(driver, OnTraci)
    texts = (
        shared_network_xml(cases, asked=asks),
        shared_routes_xml(cases, settings.vehicle, asked=asks),
    )
    try:
        world = World(cases, settings, SUMO if asks else MODEL)
        with (
            running(*texts, settings, collisions="none") as traci,
            sharing() if asks else seen_as_traci(_Refused("traci")),
            _little_garbage(),
        ):
            stage = Traffic if world.reacts else Stage
            drive(world, driver, stage(traci, world, asked=asks, as_read=asks))
    # logged in full and told, and each case is driven alone
    except Exception as error:  # noqa: BLE001
        _LOG.error(
            "%d cases that were driven together failed; each is driven alone.\n%s",
            len(cases),
            traceback_of(error),
        )
        return [Alone("together_failed", said(error))] * len(cases)
    return world.recordings(clock.perf_counter() - began)


@contextmanager
def _little_garbage() -> Iterator[None]:
    """Python looks for cycles of garbage a hundredth as often: a batch's tuples and arrays
    make none.
    """
    before = gc.get_threshold()
    gc.set_threshold(100 * before[0], *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


class _Refused(ModuleType):
    """The module of `import traci` where SUMO holds many cases: it answers nothing."""

    def __getattr__(self, name: str) -> Any:
        raise RefusedCallError(f"The ADS asked for traci.{name}; it is driven together with others")
