"""The benchmark runs, small; nothing here asserts a time."""

import pytest
from commands import sumo_eval
from laid import read_json

from sumo_eval.cosim import simulate
from sumo_eval.extras.bench.costs import SETTINGS, TenLines, set_speed
from sumo_eval.scenario import catalogue

CUT_IN = catalogue.load("cut_in").concrete(
    ego_speed=30.0, cut_in_speed=12.5, gap=60.0, lateral_speed=0.9
)


@pytest.mark.campaign
def test_bench_prints_every_group_with_ratios_and_writes_json(tmp_path):
    result = sumo_eval("bench", "--small", "--json", tmp_path / "bench.json")
    print(result.said)
    found = read_json(tmp_path / "bench.json")
    assert found["format_version"] == 1
    assert {row["group"] for row in found["rows"]} == {"co-simulation", "field and D", "zones"}
    assert all(row["value"] > 0.0 for row in found["rows"])
    assert sum(row["ratio"] is not None for row in found["rows"]) >= 8
    assert "x bare libsumo" in result.said


def test_one_part_can_be_measured_alone():
    result = sumo_eval("bench", "--small", "--only", "zones")
    assert "training points" in result.said
    assert "co-simulation" not in result.said


def test_the_measured_controllers_react():
    for ads in (TenLines, set_speed):
        assert simulate(CUT_IN, ads, SETTINGS).ego.speed.min() < 29.0
