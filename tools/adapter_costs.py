"""What each way to plug in an ADS costs per step: the same easy drive, adapters taken in turn, medians over rounds.

    python tools/adapter_costs.py [ROUNDS]

The drive follows a slower lead for 20 s (400 steps). `a step` is the whole loop per step, start and end of the case
left out by the difference to a drive of 1 s (CPU time where one process does it all, else wall time); `the ADS` is the
wall time of the ADS and its adapter.
"""

from __future__ import annotations

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import timeit
from pathlib import Path
from typing import Any

from sumo_eval.cosim.doors.traci_module import TRACI
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.sumo.session import libsumo, session
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.scenario import catalogue
from sumo_eval.settings import SimulationSettings

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
CASE = catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20.0, lead_speed=15.0)
LONG, SHORT = SimulationSettings(time_limit=20.0), SimulationSettings(time_limit=1.0)
STEPS = 380


def bare() -> float:
    """Seconds per step of libsumo alone: both vehicles' place, angle and speed read, one speed set."""
    with session(CASE, LONG) as traci:
        began = timeit.default_timer()
        for _ in range(STEPS):
            for name in ("ego", "lead"):
                traci.vehicle.getPosition(name)
                traci.vehicle.getAngle(name)
                traci.vehicle.getSpeed(name)
            traci.vehicle.setSpeed("ego", 20.0)
            traci.simulationStep()
        return (timeit.default_timer() - began) / STEPS


def costs(controller: Any, folder: Path) -> tuple[float, float, float]:
    """Seconds of the long and of the short drive, and of one step of the ADS.

    Of this process's CPU, which the load of the machine hardly disturbs; of the wall's clock where another one works.
    """
    alone = not str(controller).startswith(("exec:", "traci:"))
    walls, latency = [], 0.0
    for settings in (LONG, SHORT):
        began = time.process_time()
        found = simulate(CASE, controller, settings, folder=folder, step_timeout=10.0)
        if found.error is not None:
            raise SystemExit(found.error)
        walls.append(time.process_time() - began if alone else found.wall_time)
        latency = latency or found.controller_latency[0]
    return walls[0], walls[1], latency


def guard() -> None:
    """Nanoseconds of one call through the guarded module and through libsumo."""
    with session(CASE, LONG):
        for call in ('vehicle.getSpeed("ego")', 'vehicle.setSpeed("ego", 20.0)'):
            found = {"libsumo": [], "guarded": []}  # type: dict[str, list[float]]
            for _ in range(60):
                for name, module in (("libsumo", libsumo), ("guarded", TRACI)):
                    found[name].append(timeit.timeit(f"traci.{call}", globals={"traci": module}, number=2_000) / 2_000)
            print(f"{call:32}" + "".join(f"{name} {min(times) * 1e9:6.0f} ns   " for name, times in found.items()))


def main() -> None:
    """Print the table."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for example in EXAMPLES.iterdir():
            shutil.copy(example, folder)
        subprocess.run(["cc", "-O2", "-o", folder / "acc", folder / "acc.c"], check=True)
        from pythonfmu.builder import FmuBuilder

        FmuBuilder.build_FMU(folder / "acc_fmu.py", dest=folder)
        ways: dict[str, Any] = {
            "sumo:IDM": "sumo:IDM",
            "(traci, ego, time), says nothing": lambda traci, ego, time: None,
            "(traci, ego, time), a Command": lambda traci, ego, time: Command(0.0),
            "TraCI step listener": "step_listener.py:KeepDistance",
            "(observation), looks at nothing": lambda seen: 0.0,
            "(observation), ten-line ACC": "ten_line_acc.py:acc",
            "exec: a C program": "exec:./acc",
            "fmu: made by pythonfmu": "fmu:Acc.fmu?inputs.v=ego_speed&inputs.gap=lead_gap&outputs.acceleration=a_cmd",
            "traci: a Python client": f"traci:{sys.executable} traci_client.py",
            "fiss.py (C++ planner)": "fiss.py:Fiss",
        }
        found: dict[str, list[tuple[float, float, float]]] = {way: [] for way in ways}
        plain: list[float] = []
        for _ in range(rounds):
            plain.append(bare())
            for way, controller in ways.items():
                found[way].append(costs(controller, folder))
        print(f"{'':36}a step, us   the ADS, us   (lowest of {rounds} rounds; medians in brackets)")
        print(f"{'bare libsumo, 6 reads, 1 write':36}{min(plain) * 1e6:7.1f} ({statistics.median(plain) * 1e6:.1f})")
        for way, pairs in found.items():
            long, short, ads = zip(*pairs, strict=True)
            lowest = (min(long) - min(short)) / STEPS
            median = (statistics.median(long) - statistics.median(short)) / STEPS
            print(
                f"{way:36}{lowest * 1e6:7.1f} ({median * 1e6:.1f})"
                f"   {min(ads) * 1e6:7.1f} ({statistics.median(ads) * 1e6:.1f})"
            )
    guard()


if __name__ == "__main__":
    main()
