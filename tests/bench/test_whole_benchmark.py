"""What a whole evaluation costs: stages from the command's own lines, and processor time of all its processes."""

import sys

import pytest

from sumo_eval.bench.whole import END, stage_name, stages_of, whole_costs
from sumo_eval.errors import InputError

SMALL = """
name = "small"
seed = 1
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = 2
[[ads]]
name = "idm"
controller = "idm"
[drivers]
count = 2
[run]
workers = 1
"""


def test_stages_take_from_the_end_of_the_one_before():
    heard = [
        (1.5, "controllers: 2 done\n"),
        (2.0, "zones: 2 done\n"),
        (3.0, "cut_out: ADSs: 10 of 20, 5.0/s, about 2 s left\n"),  # not the end of a stage
        (5.0, "cut_out: ADSs: 20 done, 1 failed\n"),
        (9.0, "low_speed: ADSs: 20 done\n"),
        (9.5, "report: 1 done\n"),
    ]
    stages = stages_of(heard, 10.0)
    assert stages == {"start-up": 1.5, "zones": 0.5, "driving: ADSs": 7.0, "report": 0.5, END: 0.5}
    assert sum(stages.values()) == 10.0


def test_a_scenario_may_have_any_name_and_an_unknown_stage_its_own():
    assert stage_name("a: zones: drivers against each other") == "D"
    assert stage_name("a: human-likeness of b") == "D"
    assert stage_name("a: drivers") == "driving: drivers"
    assert stage_name("a: recorded drivers") == "recorded drivers"


@pytest.mark.campaign
def test_a_whole_evaluation_is_measured_stage_by_stage(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    heard = []
    costs = whole_costs(tmp_path / "small.toml", heard.append)
    assert sum(costs.stages.values()) == pytest.approx(costs.wall)
    assert {"start-up", "zones", "driving: ADSs", "driving: drivers", "report", END} <= set(costs.stages)
    assert "front_vehicle_low_speed: drivers" in heard
    assert costs.own > 0.0
    if sys.platform == "linux":
        assert costs.children is not None
        assert costs.children > 0.0


def test_an_evaluation_that_fails_is_an_error_with_its_own_words(tmp_path):
    with pytest.raises(InputError, match=r"ended with status 2 and said: .*nowhere\.toml"):
        whole_costs(tmp_path / "nowhere.toml", print)
