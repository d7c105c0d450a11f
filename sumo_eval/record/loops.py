"""The compiled loops of everything that ships: a run compiles those that it needs, each once on a
machine.

A piece is what is compiled and marked as done together: the world's own loops, those of vehicles
whose moves depend on what happens, and the loop of each rule, which is named by its locator.

python -m sumo_eval.record.loops        compiles all that is not compiled yet, in as many processes
as there are cores
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.cosim.compiled import Compiled
from sumo_eval.cosim.doors.controller import SHIPPED, find_controller, knows_the_scripts
from sumo_eval.cosim.doors.entry import split_entry
from sumo_eval.cosim.records import EGO, MOVER
from sumo_eval.cosim.step_rules import stop_rows
from sumo_eval.cosim.world import World, described
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.kernels import INTERPRETED, cache_folder, warm
from sumo_eval.method import shared_fields
from sumo_eval.method.conflict import conflict_criticality
from sumo_eval.record.cases import Case
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road, Start
from sumo_eval.scenario.road.reference_line import arc, frame_places
from sumo_eval.scenario.undisturbed import meetings
from sumo_eval.settings import SimulationSettings, ZoneSettings
from sumo_eval.settings.evaluation import EvaluationSettings

WORLD, PLAYED, PEOPLE = "~world", "~world that reacts", "~people"
# a run compiles the first where it meets it
AHEAD, FIELDS = "~what comes before a drive", "~fields"
OF_EVERY_RUN = (WORLD, PEOPLE, "ideal_braking", "no_reaction", "idm")
_LONG = {
    WORLD: 13, PLAYED: 1, "ideal_braking": 2, AHEAD: 5, FIELDS: 5,
    PEOPLE: 6, "lane_changer": 6, "careful_driver": 4, "fsm": 2, "rss": 2, "reg157": 2, "idm": 2,
}  # fmt: skip
"""About what compiling a piece takes after those before it, s of processor time: neighbours have
parts in common, and so share a process."""
_MOST = 4  # processes: each compiles what its pieces have in common with the others' once more

_ROAD = Road("road", 100.0, 2, 3.5, 0.0)


@functools.cache
def _locators() -> dict[type[Compiled], list[str]]:
    """The rules that ship, with the locators by which each goes; those of one loop stand
    together.
    """
    found: dict[type[Compiled], list[str]] = {}
    for locator in SHIPPED:
        kind = type(_made(locator))
        same = next((other for other in found if other.loop is kind.loop), kind)
        found.setdefault(same, []).append(locator)
    return found


def _made(locator: str) -> Compiled:
    found = find_controller(locator)
    return found() if isinstance(found, type) else found  # type: ignore[no-any-return]


def everything() -> list[str]:
    """All pieces."""
    return [
        WORLD,
        PLAYED,
        PEOPLE,
        AHEAD,
        FIELDS,
        *(locators[0] for locators in _locators().values()),
    ]


def load(pieces: Iterable[str]) -> None:
    """Have the loops of these pieces in this process: from disk, or compiled now, and then marked
    as done.
    """
    parts: dict[str, Callable[[], object]] = {
        WORLD: _load_world,
        PLAYED: lambda: World([_concrete(0.01)], SimulationSettings()).wake(0.05),
        AHEAD: _load_ahead,
        FIELDS: shared_fields.prepare,
        PEOPLE: lambda: _load_rule(human_controller(0, 1, 0, _concrete(0.0))),
    }
    for piece in pieces:
        if piece in parts:
            parts[piece]()
        else:
            _load_rule(_made(piece))
        with contextlib.suppress(OSError):  # where nothing can be kept
            _mark(piece).touch()


def _concrete(heading: float) -> ConcreteScenario:
    """A case that needs no simulator.

    heading: of the other vehicle, rad; a turned one is a played one.
    """
    lead = Actor("lead", Start(50.0, 0.0, 5.0), heading=heading)
    return ConcreteScenario("none", {}, 1.0, _ROAD, Start(10.0, 0.0, 10.0), (lead,))


def _load_world() -> None:
    world = World([_concrete(0.0)], SimulationSettings())
    world.move(closely=True)
    world.read(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, np.int64))
    world.see(sampling=True)
    stop_rows(world.egos, world.others, world.samples, 0, 0)


def _load_ahead() -> None:
    """Zones of what is played, foresight, and curves."""
    played, size = [_concrete(0.01)], (4.0, 2.0)
    conflict_criticality(played, 0, [0.0], size, ZoneSettings())
    meetings(played, [size], 0.1, [0.1], 5.0, 0, [0.0])
    frame_places((arc(10.0, 100.0),), 1.0, 0.0)


def _load_rule(ads: Compiled) -> None:
    """Its loop over no rows: a rule needs nothing of the world's loops."""
    settings, concrete = SimulationSettings(), _concrete(0.0)
    scenario = described(_ROAD, settings.vehicle, settings)
    kind = type(ads)
    told = knows_the_scripts(ads)
    law: Any = kind
    own = law.foreseeing([ads], [concrete], [settings]) if told else law.arrays([ads], scenario, 1)
    kind.loop(np.zeros(0, EGO), np.zeros((0, 1), MOVER), *own, scenario, 0.0)


def _mark(piece: str) -> Path:
    """The file that says that a piece has been compiled."""
    return cache_folder() / f"{piece} is compiled"


def _is_compiled(piece: str) -> bool:
    return os.path.isfile(_mark(piece))  # Path.is_file raises where a folder is closed


def compiled() -> list[str]:
    """The pieces that this machine has compiled."""
    return [] if INTERPRETED else [piece for piece in everything() if _is_compiled(piece)]


def of_evaluation(settings: EvaluationSettings) -> set[str]:
    """Loops that every evaluation needs: drivers, the world, and fields."""
    drivers = settings.drivers
    # recorded people, where they are too few
    fills = drivers.too_thin == "fill" and ":" not in drivers.source
    people = {PEOPLE} if drivers.source == "synthetic" or fills else set()
    driven = (settings.method.task.task_reference, *(ads.locator for ads in settings.ads))
    return {WORLD, FIELDS, "ideal_braking", "no_reaction"} | people | _rules(driven)


def of_cases(cases: Iterable[Case]) -> set[str]:
    """Loops that these cases need."""
    listed = list(cases)
    needs = {
        WORLD: bool(listed),
        PEOPLE: any(case.role == "human" for case in listed),
        PLAYED: any(case.concrete.lively for case in listed),
    }
    rules = _rules(case.controller for case in listed if case.role != "human")
    return rules | {piece for piece, needed in needs.items() if needed}


def _rules(locators: Iterable[str]) -> set[str]:
    """The pieces of those locators that name a rule that ships; what users bring may be one: it is
    compiled by who drives it.
    """
    names = {split_entry(locator)[0] for locator in locators}
    return {known[0] for known in _locators().values() if names.intersection(known)}


def ready(wanted: Iterable[str], progress: Progress = quiet) -> None:
    """Compile those pieces that this machine has not compiled yet, in processes of their own; it
    keeps them on disk.
    """
    if INTERPRETED:
        return
    wanted = set(wanted)
    first = [it for it in _LONG if it in wanted]
    missing = [it for it in (*first, *sorted(wanted - _LONG.keys())) if not _is_compiled(it)]
    if not missing:
        return
    if not _is_kept():
        stage = f"compiling in every process, since nothing can be kept in {cache_folder()}"
        progress(stage, len(missing), len(missing))
        return
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    shares: list[list[str]] = [[] for _ in range(min(cores or 1, _MOST, len(missing)))]
    ends = list(itertools.accumulate(_LONG.get(it, 1) for it in missing))
    for piece, end in zip(missing, ends, strict=True):
        middle = end - 0.5 * _LONG.get(piece, 1)
        shares[int(middle / ends[-1] * len(shares))].append(piece)
    stage = "compiling, once on this machine"
    progress(stage, 0, len(missing))
    # Ctrl-C ends them without a traceback
    silent = "import signal; signal.signal(signal.SIGINT, signal.SIG_DFL)\n"
    warm([f"{silent}from sumo_eval.record import loops; loops.load({share!r})" for share in shares])
    progress(stage, len(missing), len(missing), sum(not _is_compiled(piece) for piece in missing))


def _is_kept() -> bool:
    """Whether machine code can be kept on this machine; else every process compiles for itself."""
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(cache_folder(), os.W_OK)


if __name__ == "__main__":
    ready(everything())
    sys.exit(0)
