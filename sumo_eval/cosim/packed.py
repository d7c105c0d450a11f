"""Many cases in one simulation: SUMO steps them together, and a vectorised controller drives all egos with one call.

A pack holds cases on the same road with the same settings and as many other vehicles. Every recording is bit for bit
what `simulate` gives for that case, but for the wall times. A case that leaves the ordinary course (its controller asks
for the impossible, SUMO loses a vehicle) leaves the pack and is simulated alone, so that it costs only itself and ends
in the words of `simulate`; when the pack as a whole fails, each of its cases is. Who asks is told how many, and why.
"""

from __future__ import annotations

import logging
import math
import time as clock
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any, TypeVar

from sumo_eval.cosim.controller import Briefing, ControllerLike, ObjectController, load_controller
from sumo_eval.cosim.packed_controller import PackedCommand, PackedController, PackedScene
from sumo_eval.cosim.packed_files import packed_network_xml, packed_routes_xml
from sumo_eval.cosim.packed_run import PackedRun
from sumo_eval.cosim.session import packed_session
from sumo_eval.cosim.simulate import check_intervals, simulate
from sumo_eval.errors import must_be, said
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import ConditionSettings, SimulationSettings
from sumo_eval.text import traceback_of
from sumo_eval.trajectory import Recording

__all__ = ["PackedCommand", "PackedController", "PackedScene", "simulate_many"]

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)

SORTED_AT_ONCE = 4096  # cases whose recordings are held until those before them are there
PACK = 512  # cases in one simulation: enough to share a step's fixed cost, few enough for the processor's caches

NO_PACKED_FORM = "The ADS has no packed form."
NOT_FOR_PACKS = "The case or its settings allow no pack (its road's network, its conditions, its vehicle model)."


def simulate_many(
    cases: Sequence[ConcreteScenario],
    controller: ControllerLike | Sequence[ControllerLike],
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = math.inf,
    alone: Counter[str] | None = None,
) -> Iterator[Recording]:
    """Recordings of concrete scenarios in their order; other arguments and errors as in `simulate`.

    controller: an ADS (a locator, a class or a function, so that every case gets a fresh one; an object that is given
    ready-made serves all cases one after the other), or a list with one controller for each case.
    Cases that follow each other are packed where the controller has a packed form (see `PackedController`) and the case
    allows it; the others are simulated one by one. alone: counts these, by the reason.
    """
    together = simulate_packed(cases, controller, settings, folder=folder, step_timeout=step_timeout)
    each = controller if isinstance(controller, list | tuple) else [controller] * len(cases)
    for concrete, its_own, found in zip(cases, each, together, strict=True):
        if isinstance(found, Recording):
            yield found
        else:
            if alone is not None:
                alone[found] += 1
            yield simulate(concrete, its_own, settings, folder=folder, step_timeout=step_timeout)


def simulate_packed(
    cases: Sequence[ConcreteScenario],
    controller: ControllerLike | Sequence[ControllerLike],
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = math.inf,
) -> Iterator[Recording | str]:
    """As `simulate_many`, but for cases that have to be simulated alone: the reason, for the caller to see to them."""
    basis = settings or SimulationSettings()
    check_intervals(basis)
    each = list(controller) if isinstance(controller, list | tuple) else [controller] * len(cases)
    if len(each) != len(cases):
        raise must_be("The controllers", "`simulate_many`", f"one for each of the {len(cases)} cases", len(each))
    packed_form = None if isinstance(controller, list | tuple) else _packed_form(controller, folder)
    as_usual = basis.plant is None and basis.conditions == ConditionSettings()

    def kind(index: int) -> tuple[object, ...] | None:
        concrete = cases[index]
        if not as_usual or concrete.road.network is not None or not _stands_on_its_road(concrete):
            return None
        body = concrete.scenario, concrete.road, concrete.ego_body, concrete.time_limit, len(concrete.actors)
        return (*body, type(each[index]) if packed_form is None else None)

    for key, group in groupby(range(len(cases)), key=kind):
        for members in _chunks(list(group), SORTED_AT_ONCE):
            found: dict[int, Recording | str] = {}
            if key is not None:
                resolved = cases[members[0]].simulation(basis)
                order = sorted(members, key=lambda index: probable_end(cases[index], decided=resolved.end_when_decided))
                for part in _chunks(order, PACK):
                    form = packed_form or _together([each[index] for index in part])
                    pack = [cases[index] for index in part]
                    found.update(zip(part, _packed(pack, form, resolved, step_timeout), strict=True))
            for index in members:
                yield found.pop(index, NOT_FOR_PACKS)


def _chunks(items: list[_T], size: int) -> Iterator[list[_T]]:
    return (items[begin : begin + size] for begin in range(0, len(items), size))


def probable_end(concrete: ConcreteScenario, *, decided: bool = False) -> float:
    """About when a case ends, s: cases that end together share a pack, which lasts as long as its last.

    When the ego is at the road's end if it stays behind the slowest that moves; of a case that ends when it is
    `decided`, when the ego reaches another vehicle if nobody does anything.
    """
    ego, starts = concrete.ego, [actor.start for actor in concrete.actors]
    if decided:
        times = [(start.x - ego.x) / (ego.speed - start.speed) for start in starts if ego.speed > start.speed]
        return min(times, default=math.inf)
    speeds = [start.speed for start in (ego, *starts) if start.speed > 0.0]
    return (concrete.road.length - ego.x) / min(speeds, default=math.inf)


PackedForm = Callable[[Briefing], PackedController | None]


def _packed_form(controller: ControllerLike, folder: Path | None) -> PackedForm | None:
    """What makes the packed form of an ADS from a briefing; None where it has none."""
    ads = load_controller(controller, folder)
    target: Any = ads.target if isinstance(ads, ObjectController) else getattr(ads, "function", None)
    found: PackedForm | None = getattr(target, "packed", None)
    return found


def _together(controllers: Sequence[Any]) -> PackedForm | None:
    """What makes one packed form of controllers of one type; None where the type has none."""
    together = getattr(type(controllers[0]), "together", None)
    return None if together is None else lambda briefing: together(controllers, briefing)


def _stands_on_its_road(concrete: ConcreteScenario) -> bool:
    road = concrete.road
    return bool(concrete.actors) and road.right_edge <= concrete.ego.y <= road.left_edge


def _packed(
    cases: Sequence[ConcreteScenario],
    packed_form: PackedForm | None,
    settings: SimulationSettings,
    step_timeout: float,
) -> Sequence[Recording | str]:
    """The recording of each case, or why it has to be simulated alone."""
    if packed_form is None:
        return [NO_PACKED_FORM] * len(cases)
    road = replace(cases[0].road, name="road")  # the scenario is not revealed, as in `simulate`
    briefing = Briefing("", road, settings.vehicle, settings.step, None, step_timeout)
    began = clock.perf_counter()
    try:
        controller = packed_form(briefing)
        if controller is None:
            return [NO_PACKED_FORM] * len(cases)
        pack = PackedRun(cases, settings, controller)
        network = packed_network_xml(cases[0].road, len(cases))
        with packed_session(network, packed_routes_xml(cases, settings.vehicle), settings) as traci:
            pack.drive(traci, step_timeout)
    except Exception as error:  # noqa: BLE001 - logged in full and told, and each case is simulated alone
        _LOG.error("A pack of %d cases failed; each of them is simulated alone.\n%s", len(cases), traceback_of(error))
        return [f"A pack failed: {said(error)}."] * len(cases)
    recordings = pack.recordings(clock.perf_counter() - began)
    return [pack.left[case] if one is None else one for case, one in enumerate(recordings)]
