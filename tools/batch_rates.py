"""Cases per second of every engine, as a ratio to one bare libsumo loop over the same cases, interleaved in one run.

python tools/batch_rates.py [CASES] [tcp://SCHEDULER]

A ratio compares an engine with the bare loop of the same round; the table gives the median of the rounds and how
far they lie apart. One worker above 1, or wide ranges, say that the machine was busy.
"""

import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Sequence
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
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    own = dict.fromkeys(ways, 0.0)  # s of processor time in this process: what a parent costs on a busy machine too
    for _ in range(ROUNDS):
        for name, way in ways.items():
            began, busy = time.perf_counter(), time.process_time()
            done = way(cases)
            seconds[name].append(time.perf_counter() - began)
            own[name] += time.process_time() - busy
            if done != number:
                raise SystemExit(f"{name}: {done} cases of {number} came to their end")
        print(", ".join(f"{name} {found[-1]:.2f} s" for name, found in seconds.items()), flush=True)
    print(f"{number} cases, {ROUNDS} rounds, {os.cpu_count()} cores, Python {platform.python_version()}")
    for name, found in seconds.items():
        ratios = [basis / took for basis, took in zip(seconds["bare"], found, strict=True)]
        print(
            f"{name:<10}{number / statistics.median(found):8.1f} cases/s,"
            f" {statistics.median(ratios):5.2f} ({min(ratios):.2f} to {max(ratios):.2f}) of the bare loop,"
            f" {1e3 * own[name] / (number * ROUNDS):6.2f} ms of this process a case"
        )


if __name__ == "__main__":
    main()
