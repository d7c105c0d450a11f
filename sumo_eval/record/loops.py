"""The compiled loops of everything that ships, which are made on a machine's first run.

python -m sumo_eval.record.loops        compiles what is not compiled yet, in two processes
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

import numpy as np

from sumo_eval.cosim.doors.controller import SHIPPED, find_controller
from sumo_eval.cosim.loop import arrays
from sumo_eval.cosim.world import World, map_played_rows, move_rows, see_rows, stop_rows
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.kernels import INTERPRETED, cache_folder, warm
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road, Start
from sumo_eval.settings import SimulationSettings

_AT_A_TIME = 2  # processes: each holds half of the loops
_ALL, _PLAYED = "all rules", "moves with conditions"  # files that say what has been compiled


def load(part: int = 0, parts: int = 1) -> None:
    """Call every so-manyth loop once, on a case that needs no simulator."""
    road = Road("road", 100.0, 2, 3.5, 0.0)
    concrete = ConcreteScenario("none", {}, 1.0, road, Start(10.0, 0.0, 10.0), (Actor("lead", Start(50.0, 0.0, 5.0)),))
    world = World([concrete], SimulationSettings())
    found = [made() if isinstance(made := find_controller(name), type) else made for name in SHIPPED]
    found.append(human_controller(0, 1, 0, concrete))
    kinds = list({type(ads).loop: ads for ads in found}.values())
    for ads in kinds[part::parts]:
        own = arrays([ads], world)
        type(ads).loop(world.egos, world.seen, *own, world.scenario, 0.0)
    if part == 0:
        shown = np.zeros((1, 1, 4))
        move_rows(world.egos, world.others, world.moves, world.clips, world.tell, world.scenario, world.line, 1, 1)
        see_rows(
            world.egos, world.others, world.moves, world.clips, world.seen, world.samples, shown, world.scenario,
            world.line, 1, 1, 0,
        )  # fmt: skip
        stop_rows(world.egos, world.others, world.moves, world.samples, 0, 0)


def load_played() -> None:
    """Call the loops of vehicles whose scripts depend on what happens once, on a case that needs no simulator."""
    road = Road("road", 100.0, 2, 3.5, 0.0)
    turned = Actor("lead", Start(50.0, 0.0, 5.0), heading=0.01)
    world = World([ConcreteScenario("none", {}, 1.0, road, Start(10.0, 0.0, 10.0), (turned,))], SimulationSettings())
    assert world.players is not None
    world.play(0.05, 0, closely=True)
    world.wake(0.05)
    map_played_rows(world.others, world.line)


def are_ready() -> bool:
    """Whether every loop is compiled on this machine, or need not be."""
    return _is_made(_ALL)


def ready(cases: Iterable[ConcreteScenario] = (), progress: Progress = quiet) -> None:
    """Compile what this machine has not compiled yet, with what only such cases need; later runs find it on disk."""
    _make(_ALL, [f"load({part}, {_AT_A_TIME})" for part in range(_AT_A_TIME)], progress)
    if any(case.lively for case in cases):
        _make(_PLAYED, ["load_played()"], progress)


def _is_made(what: str) -> bool:
    return INTERPRETED or (cache_folder() / what).is_file()


def _make(what: str, calls: Sequence[str], progress: Progress = quiet) -> None:
    """Compile in a process for each of the calls, unless it is done, and mark it as done if all of them were."""
    if _is_made(what):
        return
    stage = f"compiling, once on this machine ({what})"
    progress(stage, 0, len(calls))
    failed = warm([f"from sumo_eval.record import loops; loops.{call}" for call in calls])
    progress(stage, len(calls), len(calls), failed)
    if not failed and cache_folder().is_dir():  # else nothing is kept, and every process compiles for itself
        (cache_folder() / what).touch()


if __name__ == "__main__":
    ready()
    sys.exit(0)
