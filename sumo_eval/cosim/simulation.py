"""Drives of cases through SUMO: one at a time, or many together as a batch, in the same loop and to
the same bits.

Cases on one road with the same settings and number of actors can share one simulation (`_kind`).
Baselines, synthetic drivers and users' policies share it. So does a hook, the TraCI code of one
function or class; some cases of each batch are then driven alone as well, and compared. ADSs that
need the simulation to themselves are driven alone: listeners, programs, TraCI code that keeps
state. If a batch fails as a whole, each of its cases is driven alone. The caller receives the
reason for each case that is driven alone (`trajectory.Alone`).

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
from sumo_eval.cosim.recordings import end_case, make_recordings
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
from sumo_eval.settings import RunSettings, SimulationSettings
from sumo_eval.text import traceback_of
from sumo_eval.trajectory import Alone, Recording

_LOG = logging.getLogger(__name__)

# cases that are sorted into batches at once: their recordings stay in memory until all of them are
# driven, because they are yielded in the order of the cases
SORTED_AT_ONCE = 4096
# cases in one simulation: enough to share a step's fixed cost, few enough for the processor's
# caches
TOGETHER = 512
HOOKS_TOGETHER = 128  # cases of a hook in one simulation: fewer, as SUMO moves all their vehicles
# Cases of a hook, or of a policy that changes state, that are also driven alone and compared: its
# first ones, where kept state usually shows, and a share of each batch, which finds state that
# shows later.
_COMPARED_FIRST, _COMPARED_LATER = 3, 0.01  # cases; share of a batch's cases

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
    step_timeout: longest wall time of one controller step, s; inf: a program that never answers
        is waited for without end.
    seed: of the random effects of `settings.conditions`.
    period: s from one call of the controller to the next; its answer holds in between. None: as
        its locator says.

    A fault ends the drive with an error message in `error`; the recording holds the motion until
    then. `end_reason` is "ads_error" after a fault of the ADS: an exception, a command that is not
    a finite number, motion that no vehicle can do, touching SUMO's clock. It is "ads_timeout" after
    a step that took too long, "sim_error" after a fault of SUMO.
    """
    settings = concrete.simulation(settings or USUAL)  # with the case's own changes
    if step_timeout != inf:
        RunSettings(step_timeout=step_timeout)  # raises InputError for an impossible one
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
    control = _control([target if is_rule else ads], [seed], terms)
    try:
        with _opened(concrete, settings, ads, step_timeout, on_traci) as traci, seen_as_traci():
            stage = Traffic if world.reacts else Stage
            # as_read: actors are as SUMO shows them
            drive(world, control, stage(traci, world, ads_asks=not is_rule, as_read=on_traci))
    # an error of `_opened`: `drive` turns the errors within it into end reasons
    except (ControllerError, SimulationError) as error:
        break_off(world, error)
        end_case(world, 0)
    world.logs[0] += getattr(ads, "log", "")
    (recording,) = make_recordings(world, clock.perf_counter() - began)
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
    """The user's object that is called at every step, or the baseline; None for a policy, which
    sees observations.
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
        # a policy may ask SUMO for lanes, so the network must have the lanes and names of the case
        asks = ads.is_policy
        return running(
            shared_network_xml([concrete], own_lanes=asks),
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

    controller: an ADS, or a list with one controller for each case. A locator, a class or a
        function gives each case a fresh object; a single object serves all cases in order.
    alone: receives the number of cases that are driven alone, by reason.
    """
    terms = Terms(folder=folder)
    together = simulate_together(cases, controller, settings, terms=terms)
    for index, recording in enumerate(together):
        if isinstance(recording, Alone):
            if alone is not None:
                alone[recording] += 1
            own = controller[index] if isinstance(controller, list | tuple) else controller
            recording = simulate(cases[index], own, settings, folder=folder)
        yield recording


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
    """Recordings of cases driven together, in the order of the cases; a case that has to be driven
    alone gives the reason instead.

    terms: how long a step may take, and where relative paths start.
    seeds: of each case, for the random numbers of the conditions.
    wrap: applied to the policy or hook of each case, to observe its calls.
    batches: whether a policy over arrays may see many cases at once (its numbers may then depend
        on its batch).
    """
    basis = settings or USUAL
    seeds, terms = seeds or [0] * len(cases), terms or Terms()
    if isinstance(controller, list | tuple):
        if len(controller) != len(cases):
            each = f"one for each of the {len(cases)} cases"
            raise must_be("The controllers", "`simulate_many`", each, len(controller))
        manners = [_manner(it, terms.folder, wrap, batches, one_case=True) for it in controller]
    else:
        terms = terms._replace(every=_steps_per_call(controller, None, basis))
        manners = [_manner(controller, terms.folder, wrap, batches)] * len(cases)

    requested = _Batch(cases, manners, seeds, terms, basis)
    for window in _chunks(range(len(cases)), SORTED_AT_ONCE):
        drives = _drive_window(requested, window)
        # a later batch of this window may have shown that a hook keeps state; drives of earlier
        # windows have been yielded already
        for index in window:
            code = manners[index].code
            drive_or_reason = drives.pop(index)
            yield drive_or_reason if code is None else _KEEPS_STATE.get(code, drive_or_reason)


class _Batch(NamedTuple):
    """Cases and how each is driven, all that are requested or those of one simulation.

    manners, seeds: of each case.
    settings: without the cases' own changes, which the world applies.
    """

    cases: Sequence[ConcreteScenario]
    manners: Sequence[_Manner]
    seeds: Sequence[int]
    terms: Terms
    settings: SimulationSettings

    def part(self, indices: Sequence[int], settings: SimulationSettings) -> _Batch:
        """The cases with these indices, in this order."""
        return _Batch(
            [self.cases[i] for i in indices],
            [self.manners[i] for i in indices],
            [self.seeds[i] for i in indices],
            self.terms,
            settings,
        )


def _drive_window(requested: _Batch, window: Sequence[int]) -> dict[int, Recording | Alone]:
    """By its index, the recording of each case of a window, or why it has to be driven alone."""
    cases, manners, basis = requested.cases, requested.manners, requested.settings
    drives: dict[int, Recording | Alone] = {}
    # indices of the cases
    by_kind = grouped((_kind(cases[index], manners[index], basis), index) for index in window)
    for kind, members in by_kind.items():
        if kind is None:
            drives.update({index: manners[index].alone or NOT_TOGETHER for index in members})
            continue
        # equal for all cases of the kind, except for their own changes
        common = replace(cases[members[0]], changes=()).simulation(basis)
        by_end = sorted(
            members, key=lambda index: probable_end(cases[index], decided=common.end_when_decided)
        )
        size = HOOKS_TOGETHER if manners[members[0]].is_hook else TOGETHER
        for indices in _chunks(by_end, size):
            drives.update(zip(indices, _drive_batch(requested.part(indices, common)), strict=True))
    return drives


def _kind(
    concrete: ConcreteScenario, manner: _Manner, basis: SimulationSettings
) -> tuple[object, ...] | None:
    """The kind of a case: cases of equal kinds share a simulation; None: it has to be driven alone.

    Kinds are equal only where driving together gives the same bits as driving alone: on one road,
    with equally many actors that look alike to SUMO. Streams also need the same density.
    """
    road, ego = concrete.road, concrete.ego
    if (
        manner.alone is not None
        or basis.plant is not None  # a plant moves one ego
        or basis.conditions.step_budget is not None  # needs the wall time of one case's step
        or road.network is not None
        or not concrete.actors
        or not road.right_edge_at(ego.x) <= ego.y <= road.left_edge_at(ego.x)  # off the road
    ):
        return None
    if manner.is_hook and _needs_any_edge(concrete):
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


def _needs_any_edge(concrete: ConcreteScenario) -> bool:
    """Whether SUMO may have to look for vehicles off their routes (`Stage._tell_sections`), where
    in a batch of hooks the edges of all cases are: on roads that cross or that lanes leave, and for
    vehicles that are placed on the map or point against the road.

    Also true of a curved road of several sections, as `on_route` knows straight roads alone.
    """
    road = concrete.road
    return (
        bool(road.crossings or (road.spans and road.line))
        or any(span.parted_from < road.end for span in road.spans)
        or any(abs(it.heading) > 0.5 * pi or it.on_map is not None for it in concrete.actors)
        or crosses_itself(road.line, road.end, road.left_edge)
    )


def _drive_batch(batch: _Batch) -> Sequence[Recording | Alone]:
    """The recording of each case of one kind, or why it has to be driven alone.

    Some cases of a hook, or of a policy that keeps state, are driven alone as well and compared.
    """
    code, is_hook = batch.manners[0].code, batch.manners[0].is_hook
    # before a policy's objects are made, as these may change state, too; `_manner` has made one
    before = None if code is None or is_hook else kept_state(code)
    control = _control([manner.make() for manner in batch.manners], batch.seeds, batch.terms)
    if code is None:
        return _together(batch, control)
    if code not in _KEEPS_STATE:
        before = before or kept_state(code)  # some drives of a hook are compared in any case
        drives = _together(batch, control)
        changed = first_change(before, kept_state(code))
        if is_hook:
            changed = changed or _difference(batch, drives)
        elif changed and not _difference(batch, drives):
            changed = None  # a cache, which changes no drive
        if changed is None:
            return drives
        _KEEPS_STATE[code] = Alone("keeps_state", changed)
    return [_KEEPS_STATE[code]] * len(batch.cases)


class _Manner(NamedTuple):
    """Manner in which an ADS drives its cases.

    driver_key: the type of the object that drives, or the `id` of a policy over arrays; only cases
        with equal keys share a simulation.
    make: makes the object that drives one case, as in `_control`.
    alone: why a case is driven alone; None: it may share a simulation.
    over_arrays: one policy drives all cases at once.
    code: the user's class or function that gives each case a fresh object; else None.
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

    wrap, batches: as in `simulate_together`.
    one_case: the controller serves one case only.
    """
    if isinstance(controller, Replay):
        return _Manner(Replay, lambda: controller)
    # user_code: class, function or object
    user_code, name, entry = located(controller, folder)
    if not entry.batch:
        return _alone(Alone("asked", "batch=false"))
    if one_case and entry.period:  # a batch has one period
        return _alone(Alone("asked", "period"))
    make = partial(adapted, user_code, name, entry.options)
    ads: Any = make()
    target = _driven_object(ads)
    if Compiled.rides(target):
        return _Manner(type(target), lambda: target)
    if not isinstance(ads, PolicyController):
        return _manner_of_hook(user_code, ads, lambda: wrap(make()))
    policy = ads.target
    if _asks_traci(policy):
        return _alone(ASKS_SUMO)
    if takes_arrays(policy):
        if not batches:
            return _alone(Alone("batch"))
        shared = wrap(ads)
        # `id`, not type: in a list of controllers, each such policy drives its own cases
        return _Manner(id(policy), lambda: shared, over_arrays=True)
    if one_case:
        return _Manner(type(ads), lambda: ads)
    if reason := _shared_state(user_code):
        return _alone(reason)
    return _Manner(type(ads), lambda: wrap(make()), code=user_code)


def _manner_of_hook(user_code: Any, ads: Adapter, make: Callable[[], Adapter]) -> _Manner:
    """Manner of an ADS that drives through TraCI.

    make: makes an adapter like `ads` for one case.
    """
    own_type = getattr(user_code, "vehicle_type", None)
    if own_type is not None or not isinstance(ads, ObjectController):
        return _alone(ON_TRACI)
    if reason := _shared_state(user_code):
        return _alone(reason)
    if reaches_libsumo(user_code, ads.target):
        return _alone(ON_TRACI)
    if getattr(user_code, "batch", True) is False:
        return _alone(Alone("asked", "batch = False"))
    return _Manner(ObjectController, make, code=user_code, is_hook=True)


def _alone(reason: Alone) -> _Manner:
    """Manner of an ADS whose cases are driven alone."""
    return _Manner(None, lambda: None, reason)


def _shared_state(user_code: Any) -> Alone | None:
    """Why each case of an ADS is driven alone: its cases share state; None: they are not known to.

    Either one object serves all cases, or each case gets an object of a class or function that an
    earlier batch has shown to keep state.
    """
    is_fresh = inspect.isclass(user_code) or inspect.isfunction(user_code)
    return _KEEPS_STATE.get(user_code) if is_fresh else ONE_OBJECT


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
    """Parts of `size` items; the last may be shorter."""
    return (items[begin : begin + size] for begin in range(0, len(items), size))


def probable_end(concrete: ConcreteScenario, *, decided: bool = False) -> float:
    """Estimated end of a case, s. Cases are sorted by it: a simulation lasts as long as its longest
    case.

    It is the time at which the ego would reach the road's end at the lowest first speed above 0 of
    any vehicle.

    decided: cases end once they are decided: the estimate is then the time at which the ego would
        reach an actor ahead, both at their first speeds.
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


def _difference(batch: _Batch, drives: list[Recording | Alone]) -> str | None:
    """Drive a few cases of a batch alone as well; return the text for `Alone("keeps_state", ...)`
    about the first drive that differs; None: none differs.

    drives: of the batch; drives that do not differ are marked as compared.
    """
    manner, terms, settings = batch.manners[0], batch.terms, batch.settings
    period = terms.every * settings.step
    for index in _compared_cases(manner, drives):
        own = simulate(
            batch.cases[index], manner.make(), settings, folder=terms.folder,
            seed=batch.seeds[index], step_timeout=terms.step_timeout, period=period,
        )  # fmt: skip
        together = drives[index]
        if not (isinstance(together, Recording) and own.same_drive(together)):
            # the report shows this text where it else names the state that changed
            return (
                "unknown which, or it reads a clock or draws without a seed: "
                f"{batch.cases[index].label} drives differently when it is alone"
            )
        drives[index] = replace(together, batched=together.batched and "compared")
    return None


def _compared_cases(manner: _Manner, drives: Sequence[Recording | Alone]) -> Sequence[int]:
    """Indices of the cases to compare, spread evenly over a batch; counts them in `_COMPARED`.

    They are the first few cases of this code, and a share of each batch.
    """
    batched = [index for index, drive in enumerate(drives) if isinstance(drive, Recording)]
    compared = _COMPARED.get(manner.code, 0)
    share = max(round(_COMPARED_LATER * len(batched)), 1)
    count = max(_COMPARED_FIRST - compared, share)
    indices = batched[:: max(len(batched) // count, 1)][:count]
    _COMPARED[manner.code] = compared + len(indices)
    return indices


def _together(batch: _Batch, control: EgoControl) -> list[Recording | Alone]:
    """The recording of each case, or why it has to be driven alone."""
    began = clock.perf_counter()
    cases, settings = batch.cases, batch.settings
    ads_asks = isinstance(control, OnTraci)
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
            drive(world, control, stage(traci, world, ads_asks=ads_asks, as_read=ads_asks))
    # after any error the cases can still be driven alone; the log gets the traceback
    except Exception as error:  # noqa: BLE001
        _LOG.error(
            "%d cases that were driven together failed; each is driven alone.\n%s",
            len(cases),
            traceback_of(error),
        )
        return [Alone("together_failed", said(error))] * len(cases)
    batched = "batched" if ads_asks and len(cases) > 1 else ""
    return make_recordings(world, clock.perf_counter() - began, batched)


@contextmanager
def _rare_garbage_collection() -> Iterator[None]:
    """Let Python search for cycles of garbage a hundredth as often: a batch makes none."""
    usual = gc.get_threshold()
    gc.set_threshold(100 * usual[0], *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)


class _Refused(ModuleType):
    """The module of `import traci` for policies of a batch: it refuses every use."""

    def __getattr__(self, name: str) -> Any:
        GUARD.refuse(f"The ADS asked for traci.{name}", "it is driven together with others")
