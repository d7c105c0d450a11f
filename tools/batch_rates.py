"""What the batch costs around the simulation: engines beside a bare loop, and one size of run beside another.

python tools/batch_rates.py engines [CASES] [tcp://SCHEDULER | -] [ADS]     # default 1,000 cases, no Dask
python tools/batch_rates.py sizes [CASES ...]                     # default 100 1000 10000
python tools/batch_rates.py scheduler [BATCHES ...]               # default 200 400 800 1600

engines: an ADS (`careful_driver`) in the cut-in of UN R157 through every engine, as ratios to a bare `simulate_many`
over the same cases in the same round: of wall time (what more processes gain; it hangs on what else the machine does)
and of processor time, children's included. Each is the median of the rounds with the least and the most. Of a cluster's
workers the processor time is not known here. The last lines are what two workers gain over one, and what two bare loops
side by side, each with half of the cases, gain over one: no engine can gain more on that machine.

scheduler: what Dask itself costs a batch, by how many there are: batches of 100 cases go out as the engine sends them
and come back empty. Scheduler, worker and client share this process, so it is the sum of all three. The slope, not the
first figure, says what 10^7 cases would cost.

sizes: whole runs (`record_facts`, resume, score, report) of so many points, without human drivers, each in a process of
its own: cost per case and peak memory of the process that collects.
"""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import forkserver, get_context
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from typing import Any

from sumo_eval.cosim.simulation import simulate_many
from sumo_eval.record.cases import Case, Setup
from sumo_eval.record.engines import run_cases
from sumo_eval.record.points import zones_of
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.sampling.request import Request
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import (
    AdsSettings,
    DriverSettings,
    EvaluationSettings,
    RunSettings,
    SamplingSettings,
    ScenarioSettings,
    SimulationSettings,
)
from sumo_eval.trajectory import Trajectory

ROUNDS = 5
WARM_UP = 40  # cases before the clock runs: imports, and the process that the children come from, are no rate
ADS = "careful_driver"
BESIDE = "2 bare loops"
SIMULATION = SimulationSettings(step=0.1, end_when_decided=True)
POSSIBLE = 0.56  # share of the cut-in's box that can be


def no_drivers(concrete: ConcreteScenario) -> list[Trajectory]:
    """A human reference that has nobody."""
    return []


def cut_ins(count: int) -> list[ConcreteScenario]:
    """That many cut-ins from all over the space."""
    logical = catalogue.load("cut_in")
    points = sample(logical, "latin_hypercube", request=Request(count=round(count / POSSIBLE * 1.1), seed=1)).points
    return list(logical.concretes(points[:count]))


def bare(cases: Sequence[Case]) -> int:
    """Simulate the cases in this process, with nothing around them."""
    recordings = simulate_many([case.concrete for case in cases], cases[0].controller, SIMULATION)
    return sum(1 for recording in recordings if recording.error is None)


def side_by_side(cases: Sequence[Case]) -> int:
    """Two bare loops at once, each in a process of its own with half of the cases."""
    with ProcessPoolExecutor(2, mp_context=get_context("fork")) as pool:
        return sum(pool.map(bare, (cases[::2], cases[1::2])))


def engine(run: RunSettings) -> Callable[[Sequence[Case]], int]:
    """Simulate the cases through an engine, and count the outcomes that came and were evaluated."""
    setup = Setup(SIMULATION, run, Path())
    return lambda cases: sum(1 for outcome in run_cases(cases, setup) if outcome.status in ("ok", "collision"))


def children_time() -> float:
    """Processor time of all children that have ended, s; they are children of the fork server, not ours."""
    server = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]  # the standard library shows it nowhere else
    if server is None:
        return 0.0
    fields = Path(f"/proc/{server}/stat").read_text().rpartition(")")[2].split()
    return sum(int(field) for field in fields[11:15]) / os.sysconf("SC_CLK_TCK")


def spread(basis: Sequence[float], found: Sequence[float]) -> str:
    """The ratio of each round: median, least, most."""
    ratios = [one / other for one, other in zip(basis, found, strict=True)]
    return f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"


def engines(number: int, scheduler: str, ads: str) -> None:
    """Print a line for each engine."""
    cases = [Case(point, concrete, "ads", ads, ads) for point, concrete in enumerate(cut_ins(number))]
    ways = {
        "bare": bare,
        "serial": engine(RunSettings(engine="serial")),
        "1 worker": engine(RunSettings(workers=1)),
        "2 workers": engine(RunSettings(workers=2)),
        BESIDE: side_by_side,
    }
    if scheduler:
        ways["dask"] = engine(RunSettings(engine="dask", scheduler=scheduler))
    for way in ways.values():
        way(cases[:WARM_UP])
    wall: dict[str, list[float]] = {name: [] for name in ways}
    processor: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, way in ways.items():
            began, busy = time.perf_counter(), sum(os.times()[:4]) + children_time()
            done = way(cases)
            wall[name].append(time.perf_counter() - began)
            processor[name].append(sum(os.times()[:4]) + children_time() - busy)
            if done != number:
                raise SystemExit(f"{name}: {done} cases of {number} came to their end")
        print(", ".join(f"{name} {found[-1]:.2f} s" for name, found in wall.items()), flush=True)
    print(f"{ads}, {number} cases, {ROUNDS} rounds, {os.cpu_count()} cores, Python {platform.python_version()}")
    for name in ways:
        rate = number / statistics.median(wall[name])
        line = f"{name:<14}{rate:7.1f} cases/s; of the bare loop: wall {spread(wall['bare'], wall[name])}"
        if name != "dask":
            line += f", processor {spread(processor['bare'], processor[name])}"
        print(line)
    print(f"2 workers over 1: wall {spread(wall['1 worker'], wall['2 workers'])}")
    print(f"{BESIDE} over 1: wall {spread(wall['bare'], wall[BESIDE])}")


def size(number: int) -> None:
    """One whole run, in this process; a line of what it cost."""
    from sumo_eval.evaluation import score
    from sumo_eval.record.facts import record_facts
    from sumo_eval.report.assessed import write_assessed_report
    from sumo_eval.report.tables import write_tables

    def peak() -> str:
        return f"{getrusage(RUSAGE_SELF).ru_maxrss // 1024} MB"

    sampling = SamplingSettings(method="latin_hypercube", count=round(number / POSSIBLE))
    evaluation = EvaluationSettings(
        name="size",
        simulation=SIMULATION,
        scenario=(ScenarioSettings("cut_in", sampling),),
        ads=(AdsSettings(ADS, ADS),),
        drivers=DriverSettings(source=f"{Path(__file__).name}:{no_drivers.__name__}"),
    )
    source = Path(__file__).parent
    zones_of(catalogue.load("cut_in"), evaluation.method.zones)  # kept in this process; they cost nothing by the case
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        costs = []
        for resume in (False, True):
            began, busy = time.perf_counter(), time.process_time()
            recorded = record_facts(evaluation, source, run, resume=resume)
            costs.append((time.perf_counter() - began, time.process_time() - busy))
        each = 1e3 / recorded.drives
        (wall, own), (_, again) = costs
        print(
            f"{recorded.drives} drives: {each * wall:.2f} ms wall and {each * own:.3f} ms of the parent each, children "
            f"{each * children_time():.2f} ms; resumed {each * again:.3f} ms; {peak()}",
            end="", flush=True,
        )  # fmt: skip
        result = score(run)
        print(f"; scored {peak()}", end="", flush=True)
        write_tables(result)
        write_assessed_report(result)
        print(f"; report {peak()}", flush=True)


def scheduler(numbers: Sequence[int]) -> None:
    """Print what a batch of no work costs, and what all batches of 10^7 cases would."""
    import distributed

    from sumo_eval.record.cluster import BATCH

    setup = Setup(SIMULATION, RunSettings(), Path())
    concretes = cut_ins(BATCH)
    batch = [Case(point, concrete, "ads", ADS, ADS) for point, concrete in enumerate(concretes[:BATCH])]
    dask: Any = distributed  # has no types
    machine = dask.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, protocol="tcp", dashboard_address=None
    )
    with machine, dask.Client(machine, set_as_default=False) as client:
        spent = []
        for number in (20, *numbers):
            began, wall = time.process_time(), time.perf_counter()
            under_way = dask.as_completed(loop=client.loop)
            sent = 0
            for _ in range(min(6, number)):
                under_way.add(client.submit(nothing, batch, setup, sent, pure=False))
                sent += 1
            for future in under_way:
                future.result()
                future.release()
                if sent < number:
                    under_way.add(client.submit(nothing, batch, setup, sent, pure=False))
                    sent += 1
            spent.append((number, time.process_time() - began))
            peak = getrusage(RUSAGE_SELF).ru_maxrss // 1024
            print(
                f"{number} batches: {1e3 * spent[-1][1] / number:.2f} ms of processor time each, "
                f"{1e3 * (time.perf_counter() - wall) / number:.2f} ms of wall time; {peak} MB", flush=True,
            )  # fmt: skip
    (few, least), (many, most) = spent[1], spent[-1]
    each = (most - least) / max(many - few, 1)
    print(f"slope {1e3 * each:.2f} ms a batch: {1e7 / BATCH * each:.0f} s of processor time for 10^7 cases")


def nothing(batch: Sequence[Case], setup: Setup, number: int) -> list[int]:
    """A batch whose cases are not driven."""
    return [number] * len(batch)


def main() -> None:
    """Do what the command line asks for."""
    what, *rest = sys.argv[1:] or ["engines"]
    if what == "engines":
        address = rest[1] if len(rest) > 1 and rest[1] != "-" else ""
        engines(int(rest[0]) if rest else 1000, address, rest[2] if len(rest) > 2 else ADS)
    elif what == "sizes":
        for number in map(int, rest or ["100", "1000", "10000"]):
            subprocess.run([sys.executable, __file__, "size", str(number)], check=True)
    elif what == "scheduler":
        scheduler([int(number) for number in rest or ["200", "400", "800", "1600"]])
    elif what == "size":
        size(int(rest[0]))
    else:
        raise SystemExit(__doc__)


if __name__ == "__main__":
    main()
