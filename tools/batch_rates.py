"""Cases per second of every engine, as a ratio to one bare libsumo loop over the same cases, interleaved in one run.

python tools/batch_rates.py [CASES] [tcp://SCHEDULER]
"""

import statistics
import sys
import time
from pathlib import Path

from sumo_eval.batch.cases import Case, Setup
from sumo_eval.batch.engines import run_cases
from sumo_eval.cosim import simulate
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings

ROUNDS = 3


def main() -> None:
    """Print a line for each engine."""
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    scheduler = sys.argv[2] if len(sys.argv) > 2 else ""
    concrete = catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20, lead_speed=10)
    cases = [Case(point, concrete, "ads", "idm", "idm") for point in range(number)]
    engines = {
        "serial": RunSettings(engine="serial"),
        "1 worker": RunSettings(workers=1),
        "2 workers": RunSettings(workers=2),
    }
    if scheduler:
        engines["dask"] = RunSettings(engine="dask", scheduler=scheduler)
    seconds: dict[str, list[float]] = {name: [] for name in ("bare", *engines)}
    own = dict.fromkeys(seconds, 0.0)  # s of processor time in this process: what a parent costs on a busy machine too
    for _ in range(ROUNDS):
        began, busy = time.perf_counter(), time.process_time()
        for case in cases:
            simulate(case.concrete, case.controller)
        seconds["bare"].append(time.perf_counter() - began)
        own["bare"] += time.process_time() - busy
        for name, run in engines.items():
            began, busy = time.perf_counter(), time.process_time()
            done = sum(1 for _ in run_cases(cases, Setup(SimulationSettings(), run, Path())))
            seconds[name].append(time.perf_counter() - began)
            own[name] += time.process_time() - busy
            if done != number:
                raise SystemExit(f"{name}: {done} outcomes of {number} cases")
        print(", ".join(f"{name} {found[-1]:.2f} s" for name, found in seconds.items()), flush=True)
    bare = statistics.median(seconds["bare"])
    for name, found in seconds.items():
        middle = statistics.median(found)
        parent = 1e3 * own[name] / (number * ROUNDS)
        print(f"{name:<10}{number / middle:8.1f} cases/s, {bare / middle:5.2f} of the bare loop, {parent:6.2f} ms here")


if __name__ == "__main__":
    main()
