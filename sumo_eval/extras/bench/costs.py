"""Costs on this machine, for `sumo-eval bench`: bare libsumo, the harness, the field, D, zones.

Costs are processor time, not wall time, so that other programs disturb little. All that is compared
is measured once in each of several rounds, and the least cost counts. Costs differ from machine to
machine; ratios hardly do.

Users: `extras/bench/command.py`.
"""

import math
import multiprocessing
import os
import platform
import tempfile
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.cosim.doors.observation import Observation, Observations
from sumo_eval.cosim.simulation import simulate, simulate_many
from sumo_eval.cosim.sumo.bare_libsumo import bare_seconds
from sumo_eval.cosim.sumo.session import command_line, simulator_version
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.method.anthropomorphic import anthropomorphic_index
from sumo_eval.method.compared_drives import lateral_position, slice_points, slice_positions
from sumo_eval.method.trajectory_field import trajectory_field
from sumo_eval.method.zone_partition import partition
from sumo_eval.record.cases import Case, Outcome
from sumo_eval.record.store import open_store
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import BoolArray, FloatArray, Recording

# with the step of the public simulators of UN R157
SETTINGS = SimulationSettings(step=0.1, end_when_decided=True)
POINTS, FEW_POINTS = 2000, 100  # from which zones are learnt, and in a small benchmark
SMALL = 100  # cases, below which a benchmark is small
DRIVERS = 10  # of a point


class Row(NamedTuple):
    """One measurement.

    group: part of the benchmark.
    what: name of what is measured.
    value: its cost or its rate, in `unit`.
    ratio: its speed as a multiple of the speed of `ratio_of`; None: no comparison.
    """

    group: str
    what: str
    value: float
    unit: str
    ratio: float | None = None
    ratio_of: str = ""


Figures = tuple[Any, ...]
"""A `Row` without its group: `what`, `value`, `unit` and, if compared, `ratio`, `ratio_of`."""


class TenLines:
    """A user's ten lines of TraCI: a class with a method `step`."""

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Brake at less than 4 s to contact."""
        lead = traci.vehicle.getLeader(ego, 200.0)
        if lead and lead[0]:
            closing = traci.vehicle.getSpeed(ego) - traci.vehicle.getSpeed(lead[0])
            if closing > 0 and lead[1] < 4.0 * closing:
                return Command(acceleration=-4.0)
        return Command(acceleration=0.0)


class Policy:
    """A user's policy: one object a case, whose `act` receives an observation every step."""

    def act(self, seen: Observation) -> float:
        """Brake at less than 4 s to contact."""
        lead = seen.lead
        self.brakes = lead is not None and 0.0 < lead.gap < -4.0 * lead.relative_speed
        return -4.0 if self.brakes else 0.0

    def settled(self) -> bool:
        """Whether the ego keeps its speed while no actor is near."""
        return not self.brakes


class BatchPolicy:
    """A user's policy over arrays: `act` receives the observations of all rows every step."""

    batch = True

    def act(self, seen: Observations) -> FloatArray:
        """Brake at less than 4 s to contact."""
        self.brakes: BoolArray = (seen.lead.gap > 0.0) & (
            seen.lead.gap < -4.0 * seen.lead.relative_speed
        )
        return np.where(self.brakes, -4.0, 0.0)

    def settled(self) -> BoolArray:
        """Whether each ego keeps its speed while no actor is near."""
        return np.logical_not(self.brakes)


def set_speed(traci: Any, ego: str, time: float) -> None:
    """A user's function that commands SUMO itself: five calls that read, one that writes."""
    vehicle = traci.vehicle
    speed = vehicle.getSpeed(ego)
    lead = vehicle.getLeader(ego, 200.0)
    vehicle.getPosition(ego)
    vehicle.getAcceleration(ego)
    ahead = vehicle.getSpeed(lead[0]) if lead and lead[0] else speed
    brakes = ahead < speed and lead[1] < 4.0 * (speed - ahead)
    vehicle.setSpeed(ego, max(speed - 0.4, 0.0) if brakes else speed)


def benchmark(
    *, cases: int, rounds: int, parts: Collection[str], progress: Callable[[str], None]
) -> dict[str, Any]:
    """Measure parts of the package; the result has the machine and the rows of all parts.

    cases: number of cases of the UN R157 cut-in grid.
    rounds: how often everything is measured.
    parts: of `command.PARTS`.
    progress: receives each part before it is measured.
    """
    rows = []
    measure = {
        "co-simulation": lambda: cosimulation(cases, rounds),
        "field and D": lambda: field_and_index(rounds),
        "zones": lambda: zones(POINTS if cases >= SMALL else FEW_POINTS),
    }
    for part in parts:
        progress(part)
        rows += [Row(part, *figures) for figures in measure[part]()]
    return {
        "format_version": 1,
        "machine": {
            "processor": platform.processor() or platform.machine(),
            "cores": os.cpu_count(),
            "load": os.getloadavg()[0],
            "python": platform.python_version(),
            "simulator": simulator_version(),
        },
        "cases": cases,
        "rows": rows,
    }


_ALONE = {
    "native SUMO ego (sumo:IDM)": "sumo:IDM",
    "user's function, setSpeed": set_speed,
    "user's ten lines, vehicle model and moveToXY": TenLines,
    "careful_driver, one at a time": "careful_driver",
}
"""ADSs whose cases are simulated one at a time: name in the table -> controller."""
_BATCHED = {
    **{name: name for name in ("careful_driver", "no_reaction", "idm", "fsm", "rss", "reg157")},
    "user's function, setSpeed": set_speed,
    "user's policy": Policy,
    "user's policy over arrays": BatchPolicy,
}
"""ADSs whose cases are simulated in batches: name in the table -> controller."""


def cosimulation(cases: int, rounds: int) -> list[Figures]:
    """Costs of simulating and recording cases of the cut-in grid: every ADS, one case at a time or
    in batches, compared with bare libsumo over the same number of steps.
    """
    logical = catalogue.load("cut_in")
    grid = sample(logical).points
    # `cases` points evenly over the whole grid, from its first to its last
    rows = np.linspace(0, len(grid) - 1, min(cases, len(grid)), dtype=int)
    concretes = logical.concretes(grid[rows])

    def alone(ads: Any) -> list[Recording]:
        return [simulate(concrete, ads, SETTINGS) for concrete in concretes]

    def batched(ads: Any) -> list[Recording]:
        return list(simulate_many(concretes, ads, SETTINGS))

    # row of the table -> function that simulates all its cases; "packed": in batches
    ways = {name: partial(alone, ads) for name, ads in _ALONE.items()}
    ways |= {f"{name}, packed": partial(batched, ads) for name, ads in _BATCHED.items()}
    # not timed: it compiles what is not compiled yet, and gives the number of steps of each case
    recordings = {name: way() for name, way in ways.items()}
    steps = {
        name: [round(recording.simulated_time / SETTINGS.step) for recording in drives]
        for name, drives in recordings.items()
    }

    seconds, bare = _least_seconds(ways, concretes, steps, rounds)
    count = len(concretes)
    fastest = "careful_driver, packed"
    return [
        *((f"{name} ({np.mean(steps[name]):.0f} steps a case)", count / seconds[name],
           "cases/s", bare[name] / seconds[name], "bare libsumo") for name in ways),
        ("bare libsumo, one at a time, as many steps", count / bare[fastest], "cases/s"),
        _storing(concretes, recordings[fastest]),
    ]  # fmt: skip


def _least_seconds(
    ways: Mapping[str, partial[Any]],
    concretes: Sequence[ConcreteScenario],
    steps: Mapping[str, list[int]],
    rounds: int,
) -> tuple[dict[str, float], ...]:
    """Least seconds of each way, and of bare libsumo over the same steps: two dictionaries by name.

    ways: name -> call that simulates all concrete scenarios; its argument is the ADS.
    steps: name of a way -> number of steps of each case.
    rounds: how often each way is measured.
    """
    seconds = dict.fromkeys(ways, math.inf)
    bare = seconds.copy()
    # bare libsumo runs in a new process, in which the harness has set up nothing
    with (
        ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process,
        tempfile.TemporaryDirectory() as folder,
    ):
        command_lines = []
        for number, concrete in enumerate(concretes):
            files = Path(folder) / str(number)
            files.mkdir()
            command_lines.append(
                command_line(
                    concrete, concrete.simulation(SETTINGS), files, files / "sumo.log", None
                )
            )
        for _ in range(rounds):
            for name, way in ways.items():
                seconds[name] = min(seconds[name], _seconds(way))
                # compared with `set_speed`, bare libsumo makes this function's calls in every step
                calls = [ads for ads in way.args if ads is set_speed]
                took = process.submit(bare_seconds, command_lines, steps[name], *calls).result()
                bare[name] = min(bare[name], took)
    return seconds, bare


def _storing(concretes: Sequence[ConcreteScenario], recordings: Sequence[Recording]) -> Figures:
    """Cost of writing recordings, one of each concrete scenario, into a run's facts."""
    with (
        tempfile.TemporaryDirectory() as folder,
        open_store(Path(folder), create=True) as store,
    ):
        outcomes = [
            Outcome(
                Case(number, concrete, "ads", "careful_driver", "careful_driver"), "ok", recording
            )
            for number, (concrete, recording) in enumerate(zip(concretes, recordings, strict=True))
        ]
        took = _seconds(lambda: list(map(store.add, outcomes)))
    return "storing recordings", 1e3 * took / len(outcomes), "ms/case"


def field_and_index(rounds: int) -> list[Figures]:
    """Cost of one term of the field, compared with numpy's exp, and of D_i of a case, compared with
    its simulations in batches: that of the ADS and those of `DRIVERS`.
    """
    logical = catalogue.load("front_vehicle_cut_out")
    concrete = logical.concrete(ego_speed=25.0, obstacle_speed=10.0, gap=110.0)
    people = [human_controller(index, DRIVERS, 1, concrete) for index in range(DRIVERS)]
    drivers = [recording.ego for recording in simulate_many([concrete] * DRIVERS, people)]
    ads = simulate(concrete, "lane_changer").ego
    points = 10 * rounds  # copies of one concrete scenario, so that batches are as large as a run's
    simulated = _seconds(
        lambda: [
            *simulate_many([concrete] * DRIVERS * points, people * points),
            *simulate_many([concrete] * points, "lane_changer"),
        ]
    )
    # x of cross-sections 0.5 m apart, and the points (n, 2) on them at which D compares the field
    slices = slice_positions(ads.x[0], logical.road.length - ads.x[0], 0.5)
    places = slice_points(slices, lateral_position(ads, slices), logical.road).reshape(-1, 2)
    # the field at a place is a sum with a term for each sample of the trajectory, 0.02 s apart
    terms = len(places) * len(np.arange(0.0, ads.duration, 0.02))
    anthropomorphic_index(ads, drivers, logical.road)  # compiles what is not compiled yet
    # about as large as the exponents of the field
    numbers = np.random.default_rng(2).uniform(-0.3, 0.3, 1024)
    result = np.empty(1024)
    works = {
        "kernel": lambda: trajectory_field(places, ads, sample_interval=0.02),
        "exp": lambda: [np.exp(numbers, out=result) for _ in range(1000)],
        "index": lambda: anthropomorphic_index(ads, drivers, logical.road),
    }
    least = dict.fromkeys(works, math.inf)
    for _ in range(3 * rounds):
        for name, work in works.items():
            least[name] = min(least[name], _seconds(work))
    index = least["index"]
    kernel = least["kernel"] / terms
    exponential = least["exp"] / (1000 * numbers.size)
    ratio = simulated / points / index  # seconds of one point's simulations and of its D_i
    return [
        ("numpy's exp, a number", 1e9 * exponential, "ns"),
        ("field, a term", 1e9 * kernel, "ns", exponential / kernel, "numpy's exp"),
        ("D of a case, 10 drivers", 1e3 * index, "ms", ratio, "its 11 drives in batches"),
    ]


def zones(points: int) -> list[Figures]:
    """Cost of the zones of a scenario, learnt from its own grid and from random points.

    points: number of random points.
    """
    logical = catalogue.load("front_vehicle_cut_out")
    many = logical.from_unit(np.random.default_rng(1).random((points, len(logical.parameters))))
    return [
        ("front_vehicle_cut_out, its own grid", _seconds(lambda: partition(logical)), "s"),
        (f"{points} training points", _seconds(lambda: partition(logical, points=many)), "s"),
    ]


def _seconds(work: Callable[[], object]) -> float:
    """Processor time of a call in this process, s."""
    began = time.process_time()
    work()
    return time.process_time() - began
