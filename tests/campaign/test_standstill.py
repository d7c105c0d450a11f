"""A case ends when the ego has stood for 2 s: in no scenario that ships would somebody have touched
it later.

`pytest -m campaign tests/campaign/test_standstill.py`: 150 points of each, driven to that end and
on to the time limit."""

from dataclasses import replace

import pytest
from campaign_share import SHARE
from road_scenes import DECIDED, drawn_cases

from sumo_eval.cosim import simulate_many
from sumo_eval.scenario import catalogue

WAITING = replace(DECIDED, standstill_time=DECIDED.time_limit)


def touched(use, ads, count, settings):
    cases = drawn_cases(use, count, seed=7)
    return [recording.collision is not None for recording in simulate_many(cases, ads, settings)]


@pytest.mark.parametrize("ads", ["ideal_braking", "idm"])
def test_who_waits_for_a_turning_vehicle_touches_it_no_later(ads):
    assert touched("turn_across_path", ads, 10, DECIDED) == touched(
        "turn_across_path", ads, 10, WAITING
    )


@pytest.mark.campaign
@pytest.mark.parametrize("ads", ["ideal_braking", "idm"])
@pytest.mark.parametrize("use", sorted(catalogue.SCENARIOS))
def test_a_vehicle_that_stood_for_two_seconds_touches_none_later(use, ads):
    count = max(5, round(150 * SHARE))
    assert touched(use, ads, count, DECIDED) == touched(use, ads, count, WAITING)
