"""Edge cases of a space are its extremes, possible, no two the same, and the same for one seed."""

import pytest

from sumo_eval.method.point_criticality import danger
from sumo_eval.record.edge_cases import edge_cases
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import ZoneSettings


@pytest.mark.parametrize("name", ["front_vehicle_low_speed", "front_vehicle_cut_out"])
def test_edge_cases_are_the_extremes_of_the_space(name):
    logical = catalogue.load(name)
    cases = edge_cases(logical, seed=1)
    points = [tuple(case.values.values()) for case in cases]
    assert len(set(points)) == len(points) >= 4
    risk = danger(logical, sample(logical).points, ZoneSettings())
    mine = danger(logical, [logical.row(case.values) for case in cases], ZoneSettings())
    assert mine.max() >= risk.max() - 1e-9
    assert mine.min() <= risk.min() + 1e-9
    speeds = [case.ego.speed for case in cases]
    assert min(speeds) == logical.low[0]
    assert max(speeds) == logical.high[0]
    assert [tuple(case.values.values()) for case in edge_cases(logical, seed=1)] == points
