"""The drawn drivers have the recorded statistics, as far as the cuts at the bounds leave them."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from drivers.populations import draw_population
from refusals import refusal

from sumo_eval.drivers.synthetic.population import (
    HEADWAY_LIMIT,
    IDM_CORRELATION,
    IDM_FIT,
    LANE_CHANGE_10_90,
    ONSET_HEADWAY,
    ONSET_TTC,
    REACTION,
    TTC_LIMIT,
    draw_driver,
)
from sumo_eval.scenario.concrete import smooth_step
from sumo_eval.scenario.motion import quintic_rate
from sumo_eval.settings import PopulationSettings

AS_FITTED = PopulationSettings(lane_change_scale=1.0)
"""Drivers whose every parameter has the fitted distribution."""


@pytest.fixture(scope="module")
def drivers():
    return draw_population(2000, seed=1, settings=AS_FITTED)


OWN = {
    "reaction_time": REACTION,
    "onset_headway": ONSET_HEADWAY,
    "onset_ttc": ONSET_TTC,
    "lane_change_10_90": LANE_CHANGE_10_90,
}


def values_of(drivers, name):
    return np.array(
        [getattr(driver.idm if name in IDM_FIT else driver, name) for driver in drivers]
    )


@pytest.mark.parametrize("name, fit", (IDM_FIT | OWN).items())
def test_log_normal_parameters_have_the_fitted_median_and_spread(drivers, name, fit):
    values = values_of(drivers, name)
    assert fit.low <= values.min() < values.max() <= fit.high
    assert np.median(values) == pytest.approx(math.exp(fit.mu), rel=0.08)
    assert 0.7 * fit.sigma < np.log(values).std() < fit.sigma


def test_the_numbers_are_those_of_the_recordings():
    medians = {name: round(math.exp(fit.mu), 2) for name, fit in (IDM_FIT | OWN).items()}
    assert medians == {
        "headway": 0.87, "standstill_gap": 1.9, "acceleration": 1.19, "deceleration": 2.25,
        "reaction_time": 1.2, "onset_headway": 2.38, "onset_ttc": 10.43, "lane_change_10_90": 5.09,
    }  # fmt: skip


def test_idm_parameters_are_correlated_as_fitted(drivers):
    logs = [np.log(values_of(drivers, name)) for name in IDM_FIT]
    assert np.corrcoef(logs) == pytest.approx(np.array(IDM_CORRELATION), abs=0.12)


def test_shares_offsets_and_free_speeds_are_those_recorded(drivers):
    assert np.mean([driver.overtakes for driver in drivers]) == pytest.approx(0.771, abs=0.002)
    offsets = values_of(drivers, "lane_offset")
    assert (offsets.mean(), offsets.std()) == pytest.approx((0.0, 0.18), abs=0.015)
    free = values_of(drivers, "free_speed")
    assert (free.mean(), free.std()) == pytest.approx((33.79, 5.9), abs=0.4)


def test_a_driver_is_inclined_to_overtake_with_the_recorded_share_whatever_the_seed():
    assert np.mean([draw_driver(3, seed).overtakes for seed in range(600)]) == pytest.approx(
        0.771, abs=0.04
    )


def test_any_ten_drivers_hold_two_or_three_followers():
    inclined = np.array([driver.overtakes for driver in draw_population(200, seed=7)])
    assert {int(10 - inclined[first : first + 10].sum()) for first in range(190)} == {2, 3}


def test_lane_changes_last_as_long_and_are_as_quick_as_recorded(drivers):
    duration = np.median([driver.lane_change_duration for driver in drivers])
    time = np.linspace(0.0, duration, 20_001)
    done = smooth_step(time / duration)
    ten_to_ninety = time[np.argmax(done > 0.9)] - time[np.argmax(done > 0.1)]
    assert ten_to_ninety == pytest.approx(math.exp(1.628), rel=0.03)
    # the recorded motorway has lanes of 3.62 and 3.79 m
    across = 3.65 / duration * quintic_rate(time / duration)
    assert across.max() == pytest.approx(math.exp(-0.373), rel=0.03)
    assert np.mean(across > 0.12) * duration == pytest.approx(math.exp(2.125), rel=0.1)


def test_lane_changes_of_the_drivers_that_ship_last_a_tenth_longer_than_fitted(drivers):
    for fitted, ships in zip(drivers[:20], draw_population(20, seed=1), strict=True):
        assert ships.lane_change_10_90 == pytest.approx(1.1 * fitted.lane_change_10_90)


def test_the_speed_at_which_drivers_settle_spreads_as_recorded(drivers):
    ratio = np.array([driver.gain for driver in drivers])
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)
    assert ratio.std() == pytest.approx(0.087, rel=0.15)


def test_an_alerted_driver_reacts_sooner():
    driver = draw_driver(0, seed=1)
    assert driver.alerted_reaction_time == pytest.approx(0.56 * driver.reaction_time)


def test_another_seed_is_another_population():
    assert not set(draw_population(10, seed=1)) & set(draw_population(10, seed=2))


@pytest.mark.parametrize("index", [-1, 1.0, False])
def test_a_driver_has_a_number(index):
    with refusal("`index` of a driver must be a whole number of at least 0"):
        draw_driver(index, seed=1)


# --- the synthetic population: each setting changes what it names ---------------------------------


def parameters(driver):
    return asdict(driver) | asdict(driver.idm) | {"idm": None}


@pytest.mark.parametrize(
    "scale, field, factor",
    [
        ("reaction_scale", "reaction_time", 2.0),
        ("lane_change_scale", "lane_change_10_90", 0.5),
        ("headway_scale", "headway", 1.5),
    ],
)
def test_a_setting_of_the_population_changes_what_it_says_and_nothing_else(scale, field, factor):
    ones = PopulationSettings(reaction_scale=1.0, lane_change_scale=1.0)
    people = (draw_population(8, 3, it) for it in (ones, replace(ones, **{scale: factor})))
    for before, after in zip(*(map(parameters, it) for it in people), strict=True):
        assert after[field] == pytest.approx(factor * before[field])
        assert after | {field: None} == before | {field: None}


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
