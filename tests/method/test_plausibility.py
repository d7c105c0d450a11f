"""Plausibility: worked numbers, laws, and the shipped table against the recordings that it was made
from."""

import math

import numpy as np
import pytest
from drivers.real_data import HUMAN, needs_recordings
from hypothesis import given
from hypothesis import strategies as st
from loaded import load
from refusals import refusal
from road_scenes import ROAD
from scipy.integrate import cumulative_trapezoid
from tables import values_of

from sumo_eval import Trajectory
from sumo_eval.method import plausibility as module
from sumo_eval.method.anthropomorphic import operation_tolerance
from sumo_eval.method.measures import course_of, smooth_motion
from sumo_eval.method.operations import most_operations
from sumo_eval.method.plausibility import (
    EXTREMES,
    MOTORWAY_PEOPLE,
    least_plausible,
    plausibility,
    quantiles_of,
)
from sumo_eval.scenario.concrete import smooth_step

CALM = {
    "min_ttc": math.inf,
    "min_thw": 3.0,
    "max_deceleration": 0.3,
    "max_jerk": 0.3,
    "max_unrest": 0.3,
    "max_lateral_speed": 0.2,
    "max_lateral_acceleration": 0.1,
}


def drive(speeds, y=0.0, *, x=0.0, interval=0.1):
    speeds = np.asarray(speeds, dtype=np.float64)
    time = interval * np.arange(speeds.size)
    xs = x + cumulative_trapezoid(speeds, dx=interval, initial=0.0)
    return Trajectory(time, xs, np.broadcast_to(y, time.shape), np.zeros(time.size), speeds)


def extremes_of(ego, **actors):
    return module.extremes_of(course_of(ego, actors, None, ROAD))


def of_people(extremes):
    return plausibility(extremes, MOTORWAY_PEOPLE)


def test_the_extremes_of_a_steady_approach_by_hand():
    # 30 behind 20 m/s, 100 m apart at first, for 5 s: 50 m are left. TTC 50/10, THW 50/30.
    found = extremes_of(drive(np.full(51, 30.0)), lead=drive(np.full(51, 20.0), x=104.5))
    assert found["min_ttc"] == pytest.approx(5.0)
    assert found["min_thw"] == pytest.approx(50.0 / 30.0)
    assert [found[name] for name in list(EXTREMES)[2:]] == pytest.approx([0.0] * 5, abs=1e-9)


def test_constant_braking_and_a_parabola_across_have_their_own_derivatives():
    time = np.arange(0.0, 5.05, 0.1)
    found = smooth_motion(drive(30.0 - 3.0 * time, 0.5 * time**2))
    assert found.acceleration == pytest.approx(-3.0)
    assert found.jerk == pytest.approx(0.0, abs=1e-9)
    assert found.lateral_speed == pytest.approx(time[5:-5])  # d(t^2 / 2)/dt = t
    assert found.lateral_acceleration == pytest.approx(1.0)


def test_the_rate_of_the_recording_does_not_matter():
    time = np.arange(0.0, 10.001, 0.02)
    speed, y = 25.0 - 2.0 * smooth_step((time - 3.0) / 3.0), 3.5 * smooth_step((time - 2.0) / 6.0)
    fine, coarse = drive(speed, y, interval=0.02), drive(speed[::5], y[::5])
    for name, value in extremes_of(coarse).items():
        assert extremes_of(fine)[name] == pytest.approx(value, abs=1e-3, nan_ok=True)


def test_noise_of_a_tracker_does_not_make_a_calm_drive_extreme():
    rng = np.random.default_rng(5)
    noisy = drive(25.0 + 0.05 * rng.standard_normal(200), 0.05 * rng.standard_normal(200))
    assert of_people(extremes_of(noisy)) == 1.0
    assert np.abs(np.gradient(np.gradient(noisy.y, 0.1), 0.1)).max() > 4.0, (
        "plain differences see a violent swerve"
    )


def test_stopping_is_not_a_jerk_a_short_drive_has_no_derivatives():
    stops = drive(np.maximum(10.0 - 1.5 * np.arange(0.0, 12.0, 0.1), 0.0))
    assert extremes_of(stops)["max_jerk"] < 0.5
    assert extremes_of(stops)["max_deceleration"] == pytest.approx(1.5)
    short = extremes_of(drive(np.full(5, 10.0)))
    assert all(math.isnan(short[name]) for name in list(EXTREMES)[2:])
    assert of_people(short) == 1.0


def test_plausibility_is_the_least_share_over_five_percent():
    assert of_people(CALM) == 1.0
    # 2 % of the people brake with 2.66 m/s2 or harder: 0.02 / 0.05.
    braking = CALM | {"max_deceleration": 2.66}
    assert of_people(braking) == pytest.approx(0.4)
    assert least_plausible(braking, MOTORWAY_PEOPLE) == ("max_deceleration", pytest.approx(0.02))
    # Halfway between 1 % (0.304 s) and 2 % (0.331 s): 1.5 %.
    assert of_people(braking | {"min_thw": 0.3175}) == pytest.approx(0.3)
    # The most extreme jerk is 2.819 m/s3, of 0.156 % of the people; 1 % reach 1.593, so 0 % is at
    # 2.819 + 1.226.
    assert of_people(CALM | {"max_jerk": 2.819 + 0.613}) == pytest.approx(0.00078 / 0.05)
    assert of_people(CALM | {"max_jerk": 4.05}) == 0.0
    assert of_people(CALM | {"min_ttc": math.nan, "min_thw": math.nan}) == 1.0


def test_what_fields_cannot_see_has_no_plausibility():
    time = np.arange(0.0, 12.0, 0.1)
    lead = drive(np.full(120, 22.0), x=74.5)
    # 70 m, closing at 8 m/s: through after 8.75 s
    through = extremes_of(drive(np.full(120, 30.0)), lead=lead)
    assert through["min_thw"] < 0.01
    assert of_people(through) == 0.0
    for begin, duration, expected in ((6.0, 2.0, 0.0), (0.5, 7.5, 1.0)):  # a swerve, a calm one
        change = drive(np.full(120, 30.0), 3.5 * smooth_step((time - begin) / duration))
        assert of_people(extremes_of(change, lead=lead)) == expected
    ahead = drive(np.full(120, 22.0), x=4.5 + 0.25 * 22.0)
    assert of_people(extremes_of(drive(np.full(120, 22.0)), lead=ahead)) < 0.15


@given(st.sampled_from(list(EXTREMES)), st.floats(0.0, 12.0), st.floats(0.0, 3.0))
def test_more_extreme_is_never_more_plausible(name, value, more):
    before, after = (
        CALM | {name: max(value + shift, 0.0)} for shift in (0.0, EXTREMES[name] * more)
    )
    assert of_people(after) <= of_people(before)


@pytest.mark.parametrize(
    "frequency, least",
    values_of("""
    0.1, 0.6
    0.5, 0.01
    1.0, 0.01
    1.5, 0.03
    2.0, 1.0
    3.0, 0.2
    """),
)
def test_an_oscillation_is_never_more_plausible_when_it_grows(frequency, least):
    # The acceleration of 2 m/s2 at 1 Hz has a jerk of 2 * 2 pi = 12.6 m/s3; its slopes over 1 s
    # nearly cancel.
    time = np.arange(0.0, 12.0, 0.02)
    turns = 2.0 * np.pi * frequency
    oscillating = [
        extremes_of(drive(30.0 + strength / turns * np.sin(turns * time), interval=0.02))
        for strength in np.linspace(0.0, 4.0, 17)
    ]
    found = [of_people(extremes) for extremes in oscillating]
    assert found[0] == 1.0
    assert np.all(np.diff(found) <= 0.0)
    assert found[8] <= least, "2 m/s2; at 2 Hz the slopes over 7 samples see nothing"


@pytest.mark.parametrize("frequency", [0.1, 0.25, 0.4, 0.5, 0.7, 1.0, 1.1, 1.5, 1.6, 2.0, 2.1, 3.0])
def test_law_h_never_rises_with_an_oscillations_amplitude(frequency):
    """f_n+ times plausibility, beside drivers with 1 to 3 operations.

    By n of Eq. 12 it rises but at 1, 2 and 3 Hz.
    """
    turns = 2.0 * np.pi * frequency
    found = []
    for amplitude in np.linspace(0.0, 4.0, 41):
        swaying = drive(30.0 + amplitude / turns * np.sin(turns * 0.1 * np.arange(180)))
        tolerance = operation_tolerance(most_operations(swaying), [1, 2, 1, 2, 2, 1, 3, 1])
        found.append(tolerance * of_people(extremes_of(swaying)))
    assert found[0] == 1.0
    assert np.all(np.diff(found) <= 0.0)


def test_a_table_of_people_is_their_own_shares():
    drives = [CALM | {"max_deceleration": 0.1 * (n + 1)} for n in range(100)]
    table = quantiles_of(drives, list(map(str, range(len(drives)))))
    assert table.people == 100
    assert table.drives == 100
    for n in (0, 60, 94, 95, 97, 99):  # 100 - n of 100 people brake at least as hard as number n
        assert table.share("max_deceleration", drives[n]["max_deceleration"]) == pytest.approx(
            1.0 if n < 50 else (100 - n) / 100
        )
    assert "min_ttc" not in table.values, "nobody ever closed in: there is nothing to compare with"


def test_most_people_may_share_the_most_extreme_value():
    drives = [CALM | {"max_deceleration": 2.0 if n < 15 else 1.0} for n in range(25)]
    table = quantiles_of(drives, list(map(str, range(25))))
    shares = [table.share("max_deceleration", strong) for strong in (0.9, 1.0, 2.0, 2.5, 3.0)]
    assert shares == pytest.approx([1.0, 1.0, 0.6, 0.3, 0.0])


def test_every_person_weighs_the_same_however_often_recorded():
    drives = [CALM | {"max_deceleration": 0.1 * (n + 1)} for n in range(40)]
    people = [str(n) for n in range(40)]
    often = quantiles_of([*drives, *[CALM] * 9], [*people, *["39"] * 9])
    assert often.people == 40
    assert often.drives == 49
    # Number 39 is 1/40 of the people and braked hard in one drive of ten.
    assert often.share("max_deceleration", 4.0) == pytest.approx(1 / 400)
    assert often.shares["max_deceleration"][0] == pytest.approx(1 / 400)
    all_hard = quantiles_of([*drives, *[drives[-1]] * 9], [*people, *["39"] * 9])
    assert all_hard.share("max_deceleration", 4.0) == pytest.approx(1 / 40)


def test_too_few_people_are_refused():
    with refusal(r"at least 20 people, .* got 19"):
        quantiles_of([CALM] * 19, list(map(str, range(19))))


@pytest.mark.campaign
@needs_recordings
def test_the_shipped_table_is_what_the_tool_makes_of_the_recordings():
    pytest.importorskip("duckdb")
    table, ghosts = load("tools/motorway_people.py").motorway_people(HUMAN)
    shipped = MOTORWAY_PEOPLE.people, MOTORWAY_PEOPLE.drives
    assert (table.people, table.drives) == shipped
    assert ghosts == 1
    for name in EXTREMES:
        assert table.shares[name] == pytest.approx(MOTORWAY_PEOPLE.shares[name], abs=1.1e-5)
        assert table.values[name] == pytest.approx(MOTORWAY_PEOPLE.values[name], abs=1.1e-3)
