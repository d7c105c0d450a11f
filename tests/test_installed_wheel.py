"""The wheel as installed: each name that users call is imported and called, commands and formats
are found."""

import os
import subprocess
import sys
import zipfile

import pytest
from commands import ROOT, python

CALLS = """
import math, sys
from pathlib import Path
import numpy as np
import gymnasium
import sumo_eval
import sumo_eval.gym
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.errors import InputError
from sumo_eval.method.anthropomorphic import anthropomorphic_index, count_operations, exposure_weighted_index
from sumo_eval.method.collision_avoidance import (
    collision_avoidance_index, collision_loss, collision_weight, impact_severity,
)
from sumo_eval.method.criticality import ideal_impact_speed, max_inverse_ttc
from sumo_eval.method.score import combined_score
from sumo_eval.method.trajectory_field import trajectory_field
from sumo_eval.method.zone_partition import partition
from sumo_eval.scenario.catalogue import find, load
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import Trajectory

assert Path(sumo_eval.__file__).is_relative_to(sys.argv[1]), sumo_eval.__file__
assert sumo_eval.__version__

# 20 m/s behind a vehicle at rest, 60 m: braking at 5 m/s2 takes 40 m; of 30 m, sqrt(400 - 300) = 10 m/s are left
assert ideal_impact_speed(20.0, 0.0, 30.0, deceleration=5.0) == 10.0
assert ideal_impact_speed(20.0, 0.0, 60.0, deceleration=5.0) == 0.0
assert max_inverse_ttc(20.0, 0.0, 30.0) == math.inf
assert max_inverse_ttc(20.0, 25.0, 30.0) == 0.0

logical = load("front_vehicle_cut_out")
zones = partition(logical, ZoneSettings(grid_points=1_000, restarts=0, refinements=0))
points = np.array([[30.0, 0.0, 40.0], [12.0, 10.0, 100.0]])
assert zones.hazardous(points).tolist() == [True, False]
assert zones.boundary_distance(points).shape == (2,)
assert collision_weight(points[0], zones) > 0.0
assert len(zones.most_dangerous) == 1

concrete = logical.concrete(ego_speed=15.0, obstacle_speed=10.0, gap=100.0)
class Steady:
    def act(self, seen):
        return sumo_eval.Command(-1.0 if seen.lead else 0.0)
alone = simulate(concrete, Steady)
assert alone.collision is None and alone.end_reason and alone.clips is not None and alone.actors
(again,) = simulate_many([concrete], "idm")
people = [alone.ego, again.ego, alone.ego]
index = anthropomorphic_index(alone.ego, people, logical.road)
assert 0.0 <= index.value <= 1.0 and index.length_factor and index.operation_factor and index.similarity
assert count_operations(alone.ego) >= 0
assert exposure_weighted_index([0.5, 1.0], [1.0, 1.0]) == 0.75
assert trajectory_field(np.zeros((1, 2)), alone.ego).shape == (1,)
assert Trajectory(time=[0.0, 0.1], x=[0.0, 1.0], y=[0.0, 0.0]).time[1] == 0.1
severity = impact_severity((20.0, 0.0), (10.0, 0.0), 1.0)
assert severity > 0.0 and 0.0 < collision_loss(severity) <= 1.0
assert collision_avoidance_index([], [], []) == 1.0
assert combined_score(1.0, 0.5).total == 75.0  # 50 * 1 + 50 * 0.5

environment = gymnasium.make("sumo_eval/front_vehicle_low_speed-v0")
environment.reset(options={"ego_speed": 20.0, "lead_speed": 15.0})
environment.close()

from click.testing import CliRunner
from sumo_eval.cli import TASKS, commands, main
assert set(commands()) >= {name for names in TASKS.values() for name in names}
for name in commands():
    assert CliRunner().invoke(main, [name, "--help"]).exit_code == 0, name
try:
    find("none.xosc")
except InputError as error:
    assert "none.xosc" in str(error), error
else:
    raise AssertionError("a file that is not there was read")
evaluation = {
    "name": "wheel", "scenario": [{"use": "front_vehicle_low_speed", "sampling": {"method": "sobol", "count": 1}}],
    "ads": [{"name": "none", "controller": "no_reaction"}], "drivers": {"count": 2},
    "run": {"engine": "serial"}, "simulation": {"step": 0.1, "time_limit": 8.0},
    "method": {"zones": {"grid_points": 1000, "restarts": 0, "refinements": 0}},
}
done = sumo_eval.evaluate(evaluation, out="run")
assert sumo_eval.score("run").scores == done.scores and sumo_eval.open_run("run")
assert done._repr_html_()
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder into which the wheel of this tree is installed, and nothing else."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [
        sys.executable,
        "-m",
        "hatchling",
        "build",
        "--target",
        "wheel",
        "--directory",
        str(folder),
    ]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


@pytest.mark.campaign  # .ci/run has it
def test_every_name_that_users_call_is_in_the_wheel_and_works(site, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(site), "SUMO_EVAL_INTERPRETED": "1"}
    python(CALLS, site, cwd=tmp_path, env=environment)


def test_the_wheel_ships_networks_routes_and_the_extras(site):
    for name in (
        "networks/two_lanes_1400m.net.xml",
        "routes",
        "extras/openscenario/format.py",
        "extras/gym/env.py",
    ):
        assert (site / "sumo_eval" / name).exists(), name
