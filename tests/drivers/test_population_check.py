"""The synthetic population: each setting changes what it names, and the comparison with recorded people."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import pytest
from drivers.test_reference import write_people

from sumo_eval.cli.named_values import named_texts
from sumo_eval.drivers.recorded.events import extract_events
from sumo_eval.drivers.recorded.population_check import Comparison, _from_further_back, compare_population
from sumo_eval.drivers.recorded.recordings import read_csv
from sumo_eval.drivers.synthetic.population import (
    HEADWAY_LIMIT,
    ONSET_HEADWAY,
    ONSET_TTC,
    TTC_LIMIT,
    draw_population,
)
from sumo_eval.errors import InputError
from sumo_eval.scenario import catalogue
from sumo_eval.settings import PopulationSettings
from sumo_eval.settings.config import population_from


@pytest.mark.parametrize(
    ("changes", "field", "factor"),
    [({"reaction_scale": 2.0}, "reaction_time", 2.0), ({"lane_change_scale": 0.5}, "lane_change_10_90", 0.5)],
)
def test_a_setting_of_the_population_changes_what_it_says_and_nothing_else(changes, field, factor):
    ones = PopulationSettings(reaction_scale=1.0, lane_change_scale=1.0)
    for before, after in zip(draw_population(8, 3, ones), draw_population(8, 3, replace(ones, **changes)), strict=True):
        assert getattr(after, field) == pytest.approx(factor * getattr(before, field))
        assert asdict(after) | {field: None} == asdict(before) | {field: None}


def test_the_headway_scale_changes_the_headway_and_nothing_else():
    for before, after in zip(
        draw_population(8, 3), draw_population(8, 3, PopulationSettings(headway_scale=1.5)), strict=True
    ):
        assert after.idm.headway == pytest.approx(1.5 * before.idm.headway)
        assert asdict(after.idm) | {"headway": 0} == asdict(before.idm) | {"headway": 0}


def test_the_limits_of_the_onset_keep_everybodys_rank_and_everything_else():
    """Who turns the wheel early among people's own onsets does so among the limits, and no other draw moves."""
    own, limits = (draw_population(60, 3, PopulationSettings(onset=name)) for name in ("recorded", "limits"))
    for name, recorded, limit in (
        ("onset_headway", ONSET_HEADWAY, HEADWAY_LIMIT),
        ("onset_ttc", ONSET_TTC, TTC_LIMIT),
    ):
        ranks = [(math.log(getattr(driver, name)) - recorded.mu) / recorded.sigma for driver in own]
        assert [(math.log(getattr(driver, name)) - limit.mu) / limit.sigma for driver in limits] == pytest.approx(ranks)
        assert all(limit.low <= getattr(driver, name) <= limit.high for driver in limits)
    for before, after in zip(own, limits, strict=True):
        assert asdict(after) | {"onset_headway": 0, "onset_ttc": 0} == asdict(before) | {
            "onset_headway": 0,
            "onset_ttc": 0,
        }


@pytest.mark.parametrize("onset", ["recorded", "limits"])
def test_a_compared_approach_begins_before_anybody_has_a_reason_to_overtake(onset):
    here = catalogue.load("front_vehicle_low_speed").concrete(ego_speed=30.0, lead_speed=15.0)
    there = _from_further_back(here)
    gap, closing = there.actors[0].start.x - there.ego.x - 4.5, 15.0
    for driver in draw_population(300, 1, PopulationSettings(onset=onset)):
        assert gap > driver.onset_headway * 30.0
        assert gap > driver.onset_ttc * closing
    # 27.6 s * 15 m/s = 414 m, of which 414 - 3.5 s * 30 m/s = 309 m are closed at 15 m/s while the ego drives 618 m.
    assert gap == pytest.approx(414.0, abs=0.5)
    assert there.road.length - there.ego.x == pytest.approx(618.0 + 2_500.0, abs=1.0)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("onset=limit", "Did you mean `limits`?"),
        ("onset=3", "`onset` in the population must be 'recorded' or 'limits', got 3.0."),
        ("reaction_scale=fast", "`reaction_scale` in the population must be a number, got 'fast'."),
        ("onset=", "--set must have the form NAME=VALUE with a number or a word, got 'onset='."),
        ("onset", "--set must have the form NAME=VALUE with a number or a word, got 'onset'."),
    ],
)
def test_a_setting_on_the_command_line_is_a_number_or_a_word_and_a_wrong_one_is_one_sentence(given, sentence):
    assert population_from(named_texts(["onset=limits", "reaction_scale=2"], "--set")) == PopulationSettings(
        onset="limits", reaction_scale=2.0
    )
    with pytest.raises(InputError) as caught:
        population_from(named_texts([given], "--set"))
    assert sentence in str(caught.value)


@pytest.mark.parametrize(("share", "expected"), [(0.0, 0), (0.3, 3), (0.5, 5), (1.0, 10)])
def test_the_share_who_overtake_is_the_one_asked_for(share, expected):
    people = draw_population(10, 7, PopulationSettings(overtake_share=share))
    assert abs(sum(driver.overtakes for driver in people) - expected) <= (0 if share in (0.0, 1.0) else 1)


@pytest.mark.campaign
def test_recorded_and_synthetic_approaches_are_measured_by_the_same_rules(tmp_path):
    path = write_people(tmp_path / "people.csv", [22.0, 23.0, 24.0, 25.0, 26.0, 27.0], lead_step=0.5)
    events = extract_events(read_csv(path))
    rows = {row.name: row for row in compare_population(events, drivers=12, seed=4)}
    assert rows["overtakes"].recorded == (1.0,)  # everybody made here overtakes
    # A smooth step of 5 s: 0.506 of it from 10 to 90 %.
    assert rows["middle"].recorded[1] == pytest.approx(0.506 * 5.0, abs=0.2)
    assert 3.0 < rows["middle"].synthetic[1] < 8.0
    assert rows["middle"].words.startswith("differs: the synthetic drivers' values are higher")
    again = {row.name: row for row in compare_population(events, drivers=12, seed=4)}
    assert again["middle"].synthetic == rows["middle"].synthetic


def test_too_few_are_not_compared():
    nan = float("nan")
    assert Comparison("x", "", (nan,) * 3, (nan,) * 3, 2, 3, nan, nan).words == "too few to compare"
