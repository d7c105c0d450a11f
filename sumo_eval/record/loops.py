"""The compiled loops of everything that ships: a run compiles those that it needs, each once on a
machine.

A piece is a group of loops that are compiled together, and marked as compiled together. The pieces
are the constants below, such as the world's own loops, and the loop of each rule of a baseline,
under the rule's locator. `record.facts` and `record.engines` ask for pieces before the first drive.

python -m sumo_eval.record.loops        compiles all that is not compiled yet, in as many processes
as there are cores, at most `_MOST`

Users: `cli/tools.py`, `extras/studies/trials.py`, `extras/wheel/command.py`, `record/engines.py`,
`record/facts.py`, `record/loaded_loops.py`.
"""

import contextlib
import functools
import os
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
from sumo_eval.groups import grouped
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

# Pieces that are no rules. PLAYED: actors whose moves depend on what happens; PEOPLE: synthetic
# drivers.
WORLD, PLAYED, PEOPLE = "~world", "~world that reacts", "~people"
# AHEAD: few evaluations need it; they compile it at first use. FIELDS: the fields of Eq. 9.
AHEAD, FIELDS = "~what comes before a drive", "~fields"
OF_EVERY_RUN = (WORLD, PEOPLE, "ideal_braking", "no_reaction", "idm")
"""Pieces that every child process loads at its start if they are compiled (`loaded_loops`)."""
_SECONDS = {
    WORLD: 13, PLAYED: 1, "ideal_braking": 2, AHEAD: 5, FIELDS: 5,
    PEOPLE: 6, "lane_changer": 6, "careful_driver": 4, "fsm": 2, "rss": 2, "reg157": 2, "idm": 2,
}  # fmt: skip
"""Approximate processor time to compile a piece after those before it, s. Pieces that share
functions are neighbours, so that one process compiles them."""
_MOST = 4  # processes that compile; each of them compiles the functions that its pieces share

_ROAD = Road("road", 100.0, 2, 3.5, 0.0)  # to compile with; no vehicle drives on it
_TURNED = 0.01  # rad; an actor with a heading off the road's direction is `PLAYED`


@functools.cache
def _locators() -> list[list[str]]:
    """Locators of the shipped rules. Those that share a loop are one piece, which has the name of
    the first of them.
    """
    return list(grouped((type(_rule(it)).loop, it) for it in SHIPPED).values())


def _rule(locator: str) -> Compiled:
    """A shipped rule: its locator names an object or its class."""
    rule = find_controller(locator)
    return rule() if isinstance(rule, type) else rule  # type: ignore[no-any-return]


def everything() -> list[str]:
    """All pieces."""
    return [*_LOADS, *(locators[0] for locators in _locators())]


def load(pieces: Iterable[str]) -> None:
    """Load the loops of these pieces into this process, from disk or compiled now, and mark them
    as compiled.
    """
    for piece in pieces:
        if piece in _LOADS:
            _LOADS[piece]()
        else:
            _load_rule(_rule(piece))
        with contextlib.suppress(OSError):  # where nothing can be kept
            _mark(piece).touch()


def _concrete(heading: float) -> ConcreteScenario:
    """A concrete scenario to compile with, which is never driven.

    heading: of the actor, rad.
    """
    lead = Actor("lead", Start(50.0, 0.0, 5.0), heading=heading)
    return ConcreteScenario("none", {}, 1.0, _ROAD, Start(10.0, 0.0, 10.0), (lead,))


def _load_world() -> None:
    world = World([_concrete(0.0)], SimulationSettings())
    world.move(to_sumo=1)
    world.read(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, np.int64))
    world.received(0.0)
    world.see(sampling=True)
    stop_rows(world.egos, world.others, world.samples, 0)


def _load_ahead() -> None:
    """Load what zones of `PLAYED` moves, foresight and curves need; the numbers are arbitrary."""
    played = [_concrete(_TURNED)]
    size = (4.0, 2.0)
    conflict_criticality(played, 0, [0.0], size, ZoneSettings())
    meetings(played, [size], 0.1, [0.1], 5.0, 0, [0.0])
    frame_places((arc(10.0, 100.0),), 1.0, 0.0)


def _load_rule(ads: Compiled) -> None:
    """Compile the loop of a rule by running it over no rows."""
    settings = SimulationSettings()
    concrete = _concrete(0.0)
    scenario = described(_ROAD, [settings.vehicle], settings)
    kind: Any = type(ads)
    if knows_the_scripts(ads):
        arrays = kind.foreseeing([ads], [concrete], [settings])
    else:
        arrays = kind.arrays([ads], scenario, 1)
    kind.loop(np.zeros(0, EGO), np.zeros((0, 1), MOVER), *arrays, scenario, 0.0)


_LOADS: dict[str, Callable[[], object]] = {
    WORLD: _load_world,
    PLAYED: lambda: World([_concrete(_TURNED)], SimulationSettings()).wake(0.05),
    PEOPLE: lambda: _load_rule(human_controller(0, 1, 0, _concrete(0.0))),
    AHEAD: _load_ahead,
    FIELDS: shared_fields.prepare,
}
"""Function that loads each piece other than a rule."""


def _mark(piece: str) -> Path:
    """The file that exists once a piece is compiled."""
    return cache_folder() / f"{piece} is compiled"


def _is_compiled(piece: str) -> bool:
    return os.path.isfile(_mark(piece))  # Path.is_file raises for a folder without permission


def compiled() -> list[str]:
    """The pieces that this machine has compiled."""
    return [] if INTERPRETED else [piece for piece in everything() if _is_compiled(piece)]


def of_evaluation(settings: EvaluationSettings) -> set[str]:
    """Pieces that an evaluation needs by its settings, whatever its scenarios are."""
    drivers = settings.drivers
    # synthetic drivers are added where recorded ones are too few, not to a user's function (`:`)
    fills = drivers.too_thin == "fill" and ":" not in drivers.source
    people = {PEOPLE} if drivers.source == "synthetic" or fills else set()
    driven = (settings.method.task.task_reference, *(ads.locator for ads in settings.ads))
    return {WORLD, FIELDS, "ideal_braking", "no_reaction"} | people | _rules(driven)


def of_cases(cases: Iterable[Case]) -> set[str]:
    """Pieces that these cases need."""
    listed = list(cases)
    world = {WORLD} if listed else set()
    people = {PEOPLE for case in listed if case.role == "human"}
    played = {PLAYED for case in listed if case.concrete.lively}
    rules = _rules(case.controller for case in listed if case.role != "human")
    return world | people | played | rules


def _rules(locators: Iterable[str]) -> set[str]:
    """The pieces of those locators that name a shipped rule. A user's own compiled rule is left to
    the process that drives it.
    """
    names = {split_entry(locator)[0] for locator in locators}
    return {shipped[0] for shipped in _locators() if names.intersection(shipped)}


def ready(wanted: Iterable[str], progress: Progress = quiet) -> None:
    """Compile those pieces that this machine has not compiled yet, in processes of their own. The
    machine code is kept on disk.
    """
    if INTERPRETED:
        return
    wanted = set(wanted)
    ordered = (*_SECONDS, *sorted(wanted - _SECONDS.keys()))
    missing = [piece for piece in ordered if piece in wanted and not _is_compiled(piece)]
    if not missing:
        return
    if not _is_kept():
        stage = f"compiling in every process, since nothing can be kept in {cache_folder()}"
        progress(stage, len(missing), len(missing))
        return
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    # The time of all pieces in order is cut into equal shares, one for each process; a piece
    # belongs to the share in which the middle of its own time lies.
    seconds = np.array([_SECONDS.get(piece, 1) for piece in missing])
    middles = (seconds.cumsum() - 0.5 * seconds) / seconds.sum()
    numbers = (min(cores or 1, _MOST, len(missing)) * middles).astype(int).tolist()
    shares = grouped(zip(numbers, missing, strict=True)).values()
    stage = "compiling, once on this machine"
    progress(stage, 0, len(missing))
    # Ctrl-C ends them without a traceback
    silent = "import signal; signal.signal(signal.SIGINT, signal.SIG_DFL)\n"
    warm([f"{silent}from sumo_eval.record import loops; loops.load({share!r})" for share in shares])
    failed = sum(not _is_compiled(piece) for piece in missing)
    progress(stage, len(missing), len(missing), failed)


def _is_kept() -> bool:
    """Whether machine code can be kept on this machine; else every process compiles for itself."""
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(cache_folder(), os.W_OK)


if __name__ == "__main__":
    ready(everything())
