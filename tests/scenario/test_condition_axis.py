"""A condition as a parameter of a scenario file."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from loaded import ROOT
from refusals import refusal

import sumo_eval
from sumo_eval.cosim import simulate
from sumo_eval.drivers.recorded.exposure import exposure_of
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.file import check_file, scenario_from
from sumo_eval.scenario.number_table import read_numbers
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings import DriverSettings, ExposureSettings

SHIPPED = scenario_files()["cut_in"]
EXAMPLE = ROOT / "docs" / "examples" / "cut_in_perceived.toml"
POLICY = """
class Keeps:
    def act(self, observation):
        lead = observation.lead
        return 0.0 if lead is None or lead.gap > 1.5 * observation.ego.speed else -6.0
"""


def test_the_example_is_cut_in_with_two_more_axes():
    shipped, example = (tomllib.loads(file.read_text()) for file in (SHIPPED, EXAMPLE))
    axes = [axis["name"] for axis in example["parameter"][:2]]
    assert axes == ["conditions.perception_delay", "conditions.sensor_range"]
    recorded = {"recorded": shipped["recorded"], "name": "cut_in"}
    logical = scenario_from(example | recorded, "t", EXAMPLE.parent)
    del example["parameter"][:2]
    assert example | recorded == shipped
    assert tuple(dict(logical.recorded.columns)) == logical.names[2:]
    settings = ExposureSettings("recorded", recordings=("p.csv",))
    with refusal(r"Unknown parameter `conditions\.perception_delay` in \[recorded\]"):
        exposure_of(logical, settings, DriverSettings(), Path())


def test_axis_beyond_the_bounds_of_its_setting_is_refused(tmp_path):
    text = EXAMPLE.read_text().replace("conditions.sensor_range", "conditions.dropout")
    (tmp_path / EXAMPLE.name).write_text(text)
    with refusal("`dropout` of `ConditionSettings` must be at most 1, got"):
        check_file(tmp_path / EXAMPLE.name)


@pytest.fixture
def logical(tmp_path):
    (tmp_path / EXAMPLE.name).write_text(EXAMPLE.read_text())
    (tmp_path / "keeps.py").write_text(POLICY)
    return catalogue.find(EXAMPLE.name, tmp_path)


def test_column_of_a_condition_may_name_a_unit(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("conditions.perception_delay (ms),gap (m)\n300,20\n")
    units = {"conditions.perception_delay": "s", "gap": "m"}
    assert read_numbers(path, "points", units).rows.tolist() == [[0.3, 20.0]]


def test_delay_and_range_are_axes_that_only_the_ads_feels(logical, tmp_path):
    here = {"ego_speed": 30.0, "cut_in_speed": 15.0, "gap": 40.0, "lateral_speed": 0.9}
    worst = {"conditions.perception_delay": 1.0, "conditions.sensor_range": 20.0}
    late = logical.concrete(**here, **worst)
    assert dict(late.changes) == worst
    assert not late.without_ads.changes
    sharp = logical.concrete(
        **here, **dict.fromkeys(worst, 0.0) | {"conditions.sensor_range": 120.0}
    )
    keeps = f"{tmp_path / 'keeps.py'}:Keeps"
    assert not simulate(late, keeps).same_drive(simulate(sharp, keeps))
    assert simulate(late, "no_reaction").same_drive(simulate(sharp, "no_reaction"))


@pytest.mark.campaign
def test_scores_and_maps_work_on_axes_of_conditions(logical, tmp_path):
    evaluation = """
name = "seen"
seed = 3
[[scenario]]
use = "cut_in_perceived.toml"
[scenario.sampling]
method = "latin_hypercube"
count = 8
[[ads]]
name = "keeps"
controller = "keeps.py:Keeps"
[drivers]
count = 2
[run]
workers = 1
[method.zones]
restarts = 0
refinements = 0
grid_points = 1000
"""
    (tmp_path / "night.toml").write_text(evaluation)
    done = sumo_eval.evaluate(tmp_path / "night.toml", tmp_path / "run")
    assert not done.cases_of("keeps", "cut_in_perceived").missing.any()
    points = np.array([[delay, 120.0, 30.0, 15.0, 40.0, 0.9] for delay in (0.0, 1.0)])
    assert np.ptp(logical.approach(logical.columns(points)).gap) == 0.0
