"""Costs on this machine: bare libsumo, the harness, the field, D, zones.

Processor time of this process, not wall time, so that other programs disturb little; the rows of
one table are measured in turns, several rounds, and the least of each counts. What carries over to
other machines are the ratios.
"""

from __future__ import annotations

import functools
import multiprocessing
import os
import platform
import tempfile
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.doors.observation import Observation, Observations
from sumo_eval.cosim.simulation import simulate, simulate_many
from sumo_eval.cosim.sumo.bare_libsumo import bare_seconds
from sumo_eval.cosim.sumo.session import command_line, simulator_version
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.method.anthropomorphic import (
    anthropomorphic_index,
    lateral_position,
    slice_points,
    slice_positions,
)
from sumo_eval.method.trajectory_field import trajectory_field
from sumo_eval.method.zone_partition import partition
from sumo_eval.record.cases import Case, Outcome
from sumo_eval.record.store import open_store
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import FloatArray, Recording

# the step of the public simulators of UN R157
SETTINGS = SimulationSettings(step=0.1, end_when_decided=True)


@dataclass(frozen=True, slots=True)
class Row:
    """One measurement: what, how much, in which unit, and a ratio with its meaning ("" where there
    is none).
    """

    group: str
    what: str
    value: float
    unit: str
    ratio: float | None = None
    ratio_of: str = ""


class TenLines:
    """A user's controller, as the README has it."""

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Brake at less than 4 s to contact."""
        lead = traci.vehicle.getLeader(ego, 200.0)
        if lead and lead[0]:
            closing = traci.vehicle.getSpeed(ego) - traci.vehicle.getSpeed(lead[0])
            if closing > 0 and lead[1] < 4.0 * closing:
                return Command(acceleration=-4.0)
        return Command(acceleration=0.0)


class Policy:
    """A user's policy, as the README has it: one object a case, asked with an observation."""

    def act(self, seen: Observation) -> float:
        """Brake at less than 4 s to contact."""
        lead = seen.lead
        self.brakes = lead is not None and 0.0 < lead.gap < -4.0 * lead.relative_speed
        return -4.0 if self.brakes else 0.0

    def settled(self) -> bool:
        """Whether the ego keeps its speed while no actor is near."""
        return not self.brakes


class BatchPolicy:
    """A user's policy over arrays: asked once a step with the observations of all rows."""

    batch = True

    def act(self, seen: Observations) -> FloatArray:
        """Brake at less than 4 s to contact."""
        self.brakes: NDArray[np.bool_] = (seen.lead.gap > 0.0) & (
            seen.lead.gap < -4.0 * seen.lead.relative_speed
        )
        return np.where(self.brakes, -4.0, 0.0)

    def settled(self) -> NDArray[np.bool_]:
        """Which egos keep their speed while no actor is near."""
        return np.logical_not(self.brakes)


def set_speed(traci: Any, ego: str, time: float) -> None:
    """A user's function that commands SUMO itself."""
    lead = traci.vehicle.getLeader(ego, 200.0)
    if (
        lead
        and lead[0]
        and lead[1] < 4.0 * (traci.vehicle.getSpeed(ego) - traci.vehicle.getSpeed(lead[0]))
    ):
        traci.vehicle.setSpeed(ego, max(traci.vehicle.getSpeed(ego) - 0.4, 0.0))


def benchmark(
    *, cases: int, rounds: int, parts: Collection[str], progress: Callable[[str], None]
) -> dict[str, Any]:
    """Measure these `parts`; `cases`: of the R157 cut-in grid.

    The result is plain data for a table or for JSON.
    """
    rows: list[Row] = []
    measures: dict[str, Callable[[], list[Row]]] = {
        "co-simulation": lambda: cosimulation(cases, rounds),
        "field and D": lambda: field_and_index(rounds),
        "zones": lambda: zones(2000 if cases >= 100 else 100),
    }
    for part, measure in measures.items():
        if part in parts:
            progress(part)
            rows += measure()
    machine = {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        "simulator": simulator_version(),
    }
    return {
        "format_version": 1,
        "machine": machine,
        "cases": cases,
        "rows": [asdict(row) for row in rows],
    }


def cosimulation(cases: int, rounds: int) -> list[Row]:
    """Cases of the cut-in grid, recorded: each way of driving them beside bare libsumo on as many
    steps.
    """
    logical = catalogue.load("cut_in")
    grid = sample(logical).points
    concretes = list(logical.concretes(grid[:: max(len(grid) // cases, 1)][:cases]))
    alone = {
        "native SUMO ego (sumo:IDM)": "sumo:IDM",
        "user's function, setSpeed": set_speed,
        "user's ten lines, vehicle model and moveToXY": TenLines,
        "careful_driver, one at a time": "careful_driver",
    }
    packed = {
        **{
            f"{ads}, packed": ads
            for ads in ("careful_driver", "no_reaction", "idm", "fsm", "rss", "reg157")
        },
        "user's policy, packed": Policy,
        "user's policy over arrays, packed": BatchPolicy,
    }
    ways = {
        name: functools.partial(drive, concretes, ads)
        for drive, those in ((_alone, alone), (_packed, packed))
        for name, ads in those.items()
    }
    # warms up, and says how many steps there are
    recordings = {name: way() for name, way in ways.items()}
    steps = {
        name: [round(one.simulated_time / SETTINGS.step) for one in found]
        for name, found in recordings.items()
    }
    timed: dict[str, list[float]] = {}
    with _bare_process() as bare_, tempfile.TemporaryDirectory() as folder:
        lines = [
            command_line(one, one.simulation(SETTINGS), *_place(Path(folder), number))
            for number, one in enumerate(concretes)
        ]
        for _ in range(rounds):
            for name, way in ways.items():
                timed.setdefault(name, []).append(_seconds(way))
                timed.setdefault(f"bare {name}", []).append(
                    bare_.submit(bare_seconds, lines, steps[name]).result()
                )
    count = len(concretes)
    rows = [
        Row(
            "co-simulation",
            f"{name} ({np.mean(steps[name]):.0f} steps a case)",
            count / min(timed[name]),
            "cases/s",
            min(timed[f"bare {name}"]) / min(timed[name]),
            "bare libsumo",
        )
        for name in ways
    ]
    bare = min(timed["bare careful_driver, packed"])
    rows.append(
        Row("co-simulation", "bare libsumo, one at a time, as many steps", count / bare, "cases/s")
    )
    rows.append(_storing(concretes, recordings["careful_driver, packed"]))
    return rows


def _alone(concretes: Sequence[ConcreteScenario], ads: Any) -> list[Recording]:
    return [simulate(one, ads, SETTINGS) for one in concretes]


def _packed(concretes: Sequence[ConcreteScenario], ads: Any) -> list[Recording]:
    return list(simulate_many(concretes, ads, SETTINGS))


def _place(folder: Path, number: int) -> tuple[Path, Path, None]:
    """Where the files of a case and SUMO's log of it lie; the ego's type is its own."""
    here = folder / str(number)
    here.mkdir()
    return here, here / "sumo.log", None


@contextmanager
def _bare_process() -> Iterator[ProcessPoolExecutor]:
    """A process in which libsumo is as it comes: no session of the harness has set anything up in
    it.
    """
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        process.submit(int).result()  # it has started
        yield process


def _storing(concretes: Sequence[ConcreteScenario], recordings: Sequence[Recording]) -> Row:
    with (
        tempfile.TemporaryDirectory() as folder,
        open_store(Path(folder) / "facts.sqlite", create=True) as store,
    ):
        outcomes = [
            Outcome(
                Case(number, concrete, "ads", "careful_driver", "careful_driver"), "ok", recording
            )
            for number, (concrete, recording) in enumerate(zip(concretes, recordings, strict=True))
        ]

        def add_all() -> None:
            for outcome in outcomes:
                store.add(outcome)

        took = _seconds(add_all)
    return Row("co-simulation", "storing recordings", 1e3 * took / len(outcomes), "ms/case")


def field_and_index(rounds: int) -> list[Row]:
    """The field's kernel beside numpy's exp, and D of a case beside its 11 simulations in packs."""
    logical = catalogue.load("front_vehicle_cut_out")
    concrete = logical.concrete(ego_speed=25.0, obstacle_speed=10.0, gap=110.0)
    people = [human_controller(index, 10, 1, concrete) for index in range(10)]
    drivers = [recording.ego for recording in simulate_many([concrete] * 10, people)]
    ads = simulate(concrete, "lane_changer").ego
    points = 10 * rounds  # as many concrete scenarios stand for the pack of a run
    began = time.process_time()
    list(simulate_many([concrete] * 10 * points, people * points))
    list(simulate_many([concrete] * points, "lane_changer"))
    simulated = (time.process_time() - began) / points
    slices = slice_positions(float(ads.x[0]), logical.road.length - float(ads.x[0]), 0.5)
    places = slice_points(slices, lateral_position(ads, slices), logical.road).reshape(-1, 2)
    terms = len(places) * len(np.arange(0.0, ads.duration, 0.02))
    anthropomorphic_index(ads, drivers, logical.road)  # compiles what is not compiled yet
    numbers, result = np.random.default_rng(2).uniform(-0.3, 0.3, 1024), np.empty(1024)
    kernels, exponentials = [], []
    for _ in range(3 * rounds):
        kernels.append(
            _seconds(lambda: trajectory_field(places, ads, sample_interval=0.02)) / terms
        )
        exponentials.append(
            _seconds(lambda: [np.exp(numbers, out=result) for _ in range(1000)])
            / (1000 * numbers.size)
        )
    kernel, exponential = min(kernels), min(exponentials)
    index = min(_seconds(anthropomorphic_index, ads, drivers, logical.road) for _ in range(rounds))
    return [
        Row("field and D", "numpy's exp, a number", 1e9 * exponential, "ns"),
        Row(
            "field and D", "field, a term", 1e9 * kernel, "ns", exponential / kernel, "numpy's exp"
        ),
        Row(
            "field and D",
            "D of a case, 10 drivers",
            1e3 * index,
            "ms",
            simulated / index,
            "its 11 runs in packs",
        ),
    ]


def zones(points: int) -> list[Row]:
    """Zones of a scenario on its own grid, and on many training points."""
    logical = catalogue.load("front_vehicle_cut_out")
    many = logical.from_unit(np.random.default_rng(1).random((points, len(logical.parameters))))
    return [
        Row("zones", "front_vehicle_cut_out, its own grid", _seconds(partition, logical), "s"),
        Row(
            "zones",
            f"{points} training points",
            _seconds(lambda: partition(logical, points=many)),
            "s",
        ),
    ]


def _seconds(work: Callable[..., object], *args: object) -> float:
    began = time.process_time()
    work(*args)
    return time.process_time() - began
