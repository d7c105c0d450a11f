"""A small evaluation whose ADS can be given one planted fault, and drivers that cost no
simulation."""

ADS = '''
from pathlib import Path

from sumo_eval import Command

FAULT = Path(__file__).with_name("fault.txt")


class Brakes:
    """Brakes at once and hard, except where fault.txt names the point."""

    fault = None

    def act(self, seen):
        if self.fault is None:
            point = f"{seen.ego.speed:g}, {seen.lead.speed:g}"
            fault = FAULT.read_text().split(":") if FAULT.exists() else ["", ""]
            self.fault = fault[1] if point == fault[0] else ""
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
engine = "{engine}"
cases_per_pack = 32
"""


def evaluation(folder, levels="3", fault="", engine="serial"):
    """Write the evaluation and its modules.

    fault: `30, 0:sleeps`, the point and what the ADS does there.

    engine: without processes of its own a run costs half.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "my_ads.py").write_text(ADS)
    (folder / "my_drivers.py").write_text(DRIVERS)
    plant(folder, fault)
    (folder / "evaluation.toml").write_text(EVALUATION.format(levels=levels, engine=engine))
    return folder / "evaluation.toml"


def plant(folder, fault):
    """Give the ADS a fault; none with an empty text."""
    (folder / "fault.txt").write_text(fault or ":")
