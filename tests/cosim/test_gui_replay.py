"""A recording in a SUMO program: every vehicle stands where it was, front bumper and angle as SUMO
has them."""

import shutil
import sys
from pathlib import Path

import builders
import numpy as np
import pytest

from sumo_eval.cosim.sumo import gui_replay
from sumo_eval.scenario import catalogue

BESIDE = Path(sys.executable).with_name("sumo")
SUMO = str(BESIDE) if BESIDE.is_file() else shutil.which("sumo")


@pytest.mark.skipif(SUMO is None, reason="the sumo program is not installed (extra `gui`)")
@pytest.mark.parametrize("scenario", ["front_vehicle_cut_out", "ramp_merge", "crossing_path"])
def test_vehicles_stand_where_they_were_recorded_and_are_what_they_were(scenario, monkeypatch):
    from traci import main as traci

    road = catalogue.load(scenario).road
    vehicles = {
        "ego": builders.drive(50.0, 0.0, 30.0, 3.0),
        "lead": builders.drive(80.0, 0.0, 25.0, 6.0, offset=3.5, braking=1.0),
    }
    seen = []
    shapes = {}
    step = traci.simulationStep

    def watched():
        step()
        shapes.update((name, traci.vehicle.getShapeClass(name)) for name in vehicles)
        seen.append(
            {
                name: (traci.vehicle.getPosition(name), traci.vehicle.getAngle(name))
                for name in vehicles
            }
        )

    monkeypatch.setattr(traci, "simulationStep", watched)
    gui_replay.replay_in_gui(road, vehicles, None, program=SUMO, bodies={"lead": "bicycle"})
    assert shapes == {"ego": "passenger/sedan", "lead": "bicycle"}
    times = np.arange(0.0, vehicles["ego"].time[-1] + gui_replay.STEP, gui_replay.STEP)
    assert len(seen) == len(times) > 50
    for time, frame in zip(times, seen, strict=True):
        for name, trajectory in vehicles.items():
            (x, y), angle = frame[name]
            heading = at(trajectory, "heading", time)
            half = trajectory.length / 2.0
            assert x == pytest.approx(at(trajectory, "x", time) + half * np.cos(heading), abs=0.02)
            assert y == pytest.approx(at(trajectory, "y", time) + half * np.sin(heading), abs=0.02)
            assert angle == pytest.approx(90.0 - np.degrees(heading), abs=0.1)


def at(trajectory, channel, time):
    """A channel at a time, at most the last one the ego's recording has."""
    last = builders.drive(50.0, 0.0, 30.0, 3.0).time[-1]
    return float(np.interp(min(time, last), trajectory.time, getattr(trajectory, channel)))
