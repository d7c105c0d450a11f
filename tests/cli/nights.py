"""A small evaluation whose ADS can be given one planted fault, and drivers that cost no simulation."""

from __future__ import annotations

from pathlib import Path

ADS = '''
from pathlib import Path

from sumo_eval import Command

FAULT = Path(__file__).with_name("fault.txt")


class Brakes:
    """Brakes at once and hard, except where fault.txt names the point."""

    def reset(self, scenario, traci, ego):
        lead = next(name for name in traci.vehicle.getIDList() if name != ego)
        point = f"{traci.vehicle.getSpeed(ego):g}, {traci.vehicle.getSpeed(lead):g}"
        fault = FAULT.read_text().split(":") if FAULT.exists() else ["", ""]
        self.fault = fault[1] if point == fault[0] else None

    def step(self, traci, ego, time):
        if self.fault == "raises":
            raise RuntimeError("no plan here")
        return Command(acceleration=0.0 if self.fault == "sleeps" else -6.0)
'''

DRIVERS = """
import numpy as np

from sumo_eval import Trajectory


def drivers(concrete):
    time = np.arange(0.0, 4.0, 0.1)
    start = concrete.ego
    return [Trajectory(time, start.x + v * time, np.full(time.size, start.y)) for v in (start.speed, start.speed - 1.0)]
"""

EVALUATION = """
name = "planted"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = {levels}
[[ads]]
name = "mine"
controller = "my_ads.py:Brakes"
[drivers]
source = "my_drivers.py:drivers"
[method.zones]
grid_points = 1000
restarts = 0
[run]
workers = 2
"""


def evaluation(folder: Path, levels: str = "3", fault: str = "") -> Path:
    """Write the evaluation and its modules. fault: `30, 0:sleeps`, the point and what the ADS does there."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "my_ads.py").write_text(ADS)
    (folder / "my_drivers.py").write_text(DRIVERS)
    plant(folder, fault)
    (folder / "evaluation.toml").write_text(EVALUATION.format(levels=levels))
    return folder / "evaluation.toml"


def plant(folder: Path, fault: str) -> None:
    """Give the ADS a fault; none with an empty text."""
    (folder / "fault.txt").write_text(fault or ":")
