"""Cases per second of every engine, as a ratio to one bare libsumo loop over the same cases, interleaved in one run.

python tools/batch_rates.py [CASES] [tcp://SCHEDULER]

Two ratios to the bare loop of the same round: of wall time (what more processes gain; it hangs on what else the machine
does) and of processor time, children's included (what a case costs; much steadier on a busy machine). Each is the
median of the rounds with the least and the most. Of a cluster's workers the processor time is not known here.
"""

import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from multiprocessing import forkserver
from pathlib import Path

from sumo_eval.batch.cases import Case, Setup
from sumo_eval.batch.engines import run_cases
from sumo_eval.cosim import simulate
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings

ROUNDS = 5
WARM_UP = 4  # cases before the clock runs: imports, and the process that the children come from, are no rate


def bare(cases: Sequence[Case]) -> int:
    """Simulate the cases one after the other in this process, with nothing around them."""
    return sum(1 for case in cases if simulate(case.concrete, case.controller).error is None)


def engine(run: RunSettings) -> Callable[[Sequence[Case]], int]:
    """The same through an engine: how many outcomes came, and were evaluated."""
    setup = Setup(SimulationSettings(), run, Path())
    return lambda cases: sum(1 for outcome in run_cases(cases, setup) if outcome.status == "ok")


def processor_time() -> float:
    """Seconds of this process and of all children that have ended; they are children of the fork server, not ours."""
    server = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]  # the standard library shows it nowhere else
    if server is None:
        return time.process_time()
    fields = Path(f"/proc/{server}/stat").read_text().rpartition(")")[2].split()
    ticks = sum(int(field) for field in fields[11:15])  # user and system time, its own and its children's
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")


def spread(basis: Sequence[float], found: Sequence[float]) -> str:
    """The ratio of each round: median, least, most."""
    ratios = [one / other for one, other in zip(basis, found, strict=True)]
    return f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"


def main() -> None:
    """Print a line for each engine."""
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    scheduler = sys.argv[2] if len(sys.argv) > 2 else ""
    concrete = catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20, lead_speed=10)
    cases = [Case(point, concrete, "ads", "idm", "idm") for point in range(number)]
    ways = {
        "bare": bare,
        "serial": engine(RunSettings(engine="serial")),
        "1 worker": engine(RunSettings(workers=1)),
        "2 workers": engine(RunSettings(workers=2)),
    }
    if scheduler:
        ways["dask"] = engine(RunSettings(engine="dask", scheduler=scheduler))
    for way in ways.values():
        way(cases[:WARM_UP])
    wall: dict[str, list[float]] = {name: [] for name in ways}
    processor: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, way in ways.items():
            began, busy = time.perf_counter(), processor_time()
            done = way(cases)
            wall[name].append(time.perf_counter() - began)
            processor[name].append(processor_time() - busy)
            if done != number:
                raise SystemExit(f"{name}: {done} cases of {number} came to their end")
        print(", ".join(f"{name} {found[-1]:.2f} s" for name, found in wall.items()), flush=True)
    print(f"{number} cases, {ROUNDS} rounds, {os.cpu_count()} cores, Python {platform.python_version()}")
    for name in ways:
        rate = number / statistics.median(wall[name])
        line = f"{name:<10}{rate:7.1f} cases/s; of the bare loop: wall {spread(wall['bare'], wall[name])}"
        if name != "dask":
            line += f", processor {spread(processor['bare'], processor[name])}"
        print(line)


if __name__ == "__main__":
    main()
