"""The synthetic population: each setting changes what it names."""

import math
from dataclasses import asdict, replace

import pytest
from drivers.populations import draw_population

from sumo_eval.drivers.synthetic.population import (
    HEADWAY_LIMIT,
    ONSET_HEADWAY,
    ONSET_TTC,
    TTC_LIMIT,
)
from sumo_eval.settings import PopulationSettings


@pytest.mark.parametrize(
    "changes, field, factor",
    [
        ({"reaction_scale": 2.0}, "reaction_time", 2.0),
        ({"lane_change_scale": 0.5}, "lane_change_10_90", 0.5),
    ],
)
def test_a_setting_of_the_population_changes_what_it_says_and_nothing_else(changes, field, factor):
    ones = PopulationSettings(reaction_scale=1.0, lane_change_scale=1.0)
    for before, after in zip(
        draw_population(8, 3, ones), draw_population(8, 3, replace(ones, **changes)), strict=True
    ):
        assert getattr(after, field) == pytest.approx(factor * getattr(before, field))
        assert asdict(after) | {field: None} == asdict(before) | {field: None}


def test_the_headway_scale_changes_the_headway_and_nothing_else():
    for before, after in zip(
        draw_population(8, 3),
        draw_population(8, 3, PopulationSettings(headway_scale=1.5)),
        strict=True,
    ):
        assert after.idm.headway == pytest.approx(1.5 * before.idm.headway)
        assert asdict(after.idm) | {"headway": 0} == asdict(before.idm) | {"headway": 0}


def test_the_limits_of_the_onset_keep_everybodys_rank_and_everything_else():
    """Who turns the wheel early among people's own onsets does so among the limits, and no other
    draw moves."""
    own, limits = (
        draw_population(60, 3, PopulationSettings(onset=name)) for name in ("recorded", "limits")
    )
    for name, recorded, limit in (
        ("onset_headway", ONSET_HEADWAY, HEADWAY_LIMIT),
        ("onset_ttc", ONSET_TTC, TTC_LIMIT),
    ):
        ranks = [(math.log(getattr(driver, name)) - recorded.mu) / recorded.sigma for driver in own]
        assert [
            (math.log(getattr(driver, name)) - limit.mu) / limit.sigma for driver in limits
        ] == pytest.approx(ranks)
        assert all(limit.low <= getattr(driver, name) <= limit.high for driver in limits)
    for before, after in zip(own, limits, strict=True):
        assert asdict(after) | {"onset_headway": 0, "onset_ttc": 0} == asdict(before) | {
            "onset_headway": 0,
            "onset_ttc": 0,
        }


@pytest.mark.parametrize("share, expected", [(0.0, 0), (0.3, 3), (0.5, 5), (1.0, 10)])
def test_the_share_who_overtake_is_the_one_asked_for(share, expected):
    people = draw_population(10, 7, PopulationSettings(overtake_share=share))
    assert abs(sum(driver.overtakes for driver in people) - expected) <= (
        0 if share in (0.0, 1.0) else 1
    )
