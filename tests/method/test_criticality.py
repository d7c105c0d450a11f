"""Eqs. 1-6 against hand-worked numbers, published tables and a plain simulation."""

import csv
import json
import math
from functools import partial

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from loaded import SHARED
from refusals import refusal
from tables import rows_of, values_of
from twins.criticality import braked

from sumo_eval.method.criticality import (
    critical_gap,
    ideal_braking_gap,
    ideal_braking_speed,
    ideal_impact_speed,
    inverse_ttc,
    max_inverse_ttc,
    required_gap,
    searched_criticality,
    time_to_collision,
)

TABLES = SHARED / "r157"
CAREFUL = {"deceleration": 7.593, "delay": 1.15, "build_up": 0.6}
speeds = st.floats(0.0, 40.0)
gaps = st.floats(0.1, 200.0)
delays = st.floats(0.0, 2.0)
braking = partial(st.builds, dict, deceleration=st.floats(1.0, 10.0), delay=delays)


def table(name):
    path = TABLES / name
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {column: np.array([float(row[column]) for row in rows]) for column in rows[0]}


def test_ttc_and_its_inverse():
    # 40 m apart, closing at 30 - 10 = 20 m/s: 2 s, 0.5 1/s
    assert time_to_collision(30, 10, 40) == 2.0
    assert inverse_ttc(30, 10, 40) == 0.5


def test_touching_while_closing_is_unbounded_and_not_closing_is_not_critical():
    assert inverse_ttc(30, 10, [0, -1]).tolist() == [math.inf, math.inf]
    assert time_to_collision(30, 10, [0, -1]).tolist() == [0.0, 0.0]
    assert inverse_ttc([10, 5], 10, [0, 20]).tolist() == [0.0, 0.0]
    assert time_to_collision([10, 5], 10, [0, 20]).tolist() == [math.inf, math.inf]


def test_ideal_braking_by_hand():
    # 20 m/s behind 10 m/s, 30 m, braking 5 m/s2 after 1 s. At 2 s: 20 - 5 = 15 m/s; gap 30 - 10 -
    # (10 + 5)/2 = 12.5 m. From 3 s on both drive 10 m/s: gap 30 - 10 - 10^2/(2*5) = 10 m.
    time = [0.0, 1.0, 2.0, 3.0, 9.0]
    assert ideal_braking_speed(20, 10, time, deceleration=5, delay=1).tolist() == [
        20,
        20,
        15,
        10,
        10,
    ]
    assert ideal_braking_gap(20, 10, 30, time, deceleration=5, delay=1).tolist() == [
        30,
        20,
        12.5,
        10,
        10,
    ]


def test_an_ego_that_is_not_closing_does_not_brake():
    assert ideal_braking_speed(10, 15, 4.0) == 10.0
    assert ideal_braking_gap(10, 15, 20.0, 4.0) == 40.0


def test_max_inverse_ttc_by_hand():
    # rel 20, gap 50, a 5: c = 50 - 400/10 = 10, u = sqrt(2*5*10) = 10 <= 20: sqrt(5/(2*10)) = 0.5
    assert max_inverse_ttc(20, 0, 50) == pytest.approx(0.5, abs=1e-15)
    # rel 5, gap 10: c = 7.5, u = sqrt(75) > 5: 5/10, at the start
    assert max_inverse_ttc(15, 10, 10) == 0.5
    # the delay of 1 s takes 5 m: 5/5
    assert max_inverse_ttc(15, 10, 10, delay=1.0) == 1.0


@pytest.mark.parametrize(
    "ego, lead, gap, expected",
    [
        *values_of("""
    10, 10, 5, 0.0  # as fast as the lead
    5, 10, 5, 0.0  # slower
    5, 10, 0, 0.0  # touching, but slower
    """),
        (20, 0, 40, math.inf),  # c = 40 - 400/10 = 0: touches just as it stops
        (20, 0, 39, math.inf),
        (20, 0, 0, math.inf),
        (20, 0, -1, math.inf),
    ],
)
def test_max_inverse_ttc_at_its_edges(ego, lead, gap, expected):
    assert max_inverse_ttc(ego, lead, gap) == expected


def test_delay_alone_can_reach_contact():
    # 20 m/s, 20 m, 1 s: contact just when braking would begin, unbraked
    assert max_inverse_ttc(20, 0, 20, delay=1.0) == math.inf
    assert ideal_impact_speed(20, 0, 20, deceleration=5, delay=1.0) == 20.0


@given(speeds, speeds, gaps, braking())
def test_max_inverse_ttc_is_what_a_plain_simulation_finds(ego, lead, gap, brakes):
    assume(abs(gap - required_gap(max(ego - lead, 0.0), **brakes)) > 1e-6)
    plain, _ = braked(ego, lead, gap, **brakes)
    assert max_inverse_ttc(ego, lead, gap, **brakes) == pytest.approx(plain, rel=1e-9)


@given(speeds, speeds, gaps, braking(build_up=st.sampled_from([0.0, 0.15, 0.6, 3.0])))
def test_impact_speed_is_what_a_plain_simulation_finds(ego, lead, gap, brakes):
    # at the very gap that is required the impact speed leaves 0 like a square root: digits of the
    # gap are lost there
    assume(abs(gap - required_gap(max(ego - lead, 0.0), **brakes)) > 1e-4)
    _, plain = braked(ego, lead, gap, **brakes)
    assert ideal_impact_speed(ego, lead, gap, **brakes) == pytest.approx(plain, abs=1e-9)


@given(st.floats(0.1, 40.0), braking(build_up=st.floats(0.0, 3.0)))
def test_required_gap_is_where_contact_ends(closing, brakes):
    gap = required_gap(closing, **brakes)
    assert ideal_impact_speed(closing, 0.0, gap + 1e-6, **brakes) == 0.0
    assert ideal_impact_speed(closing, 0.0, gap - 1e-6, **brakes) > 0.0


@given(st.floats(0.1, 40.0), st.floats(0.2, 2.0), braking())
def test_critical_gap_is_where_max_inverse_ttc_meets_the_threshold(closing, k, brakes):
    gap = critical_gap(closing, critical_inverse_ttc=k, **brakes)
    assert max_inverse_ttc(closing, 0.0, gap, **brakes) == pytest.approx(k, rel=1e-9)


@given(st.floats(0.0, 30.0), st.floats(0.0, 30.0), gaps, delays, st.floats(0.0, 1.0))
@example(1e-161, 0.0, 1.0, 0.0, 1e-161)
def test_only_the_speed_difference_counts(closing, lead, gap, delay, build_up):
    moving = ideal_impact_speed(
        lead + closing, lead, gap, deceleration=6, delay=delay, build_up=build_up
    )
    standing = ideal_impact_speed(closing, 0.0, gap, deceleration=6, delay=delay, build_up=build_up)
    # a square root near 0 spreads the last digit of the difference
    assert moving == pytest.approx(standing, abs=1e-5)


def test_the_zone_boundary_of_the_paper():
    # D^2/10 + 5/(2*0.49): 10 + 5.102, 40 + 5.102, 90 + 5.102; the delay of 1 s adds D
    assert critical_gap([10, 20, 30]) == pytest.approx([15.10, 45.10, 95.10], abs=0.005)
    assert critical_gap([10, 20, 30], delay=1.0) == pytest.approx([25.10, 65.10, 125.10], abs=0.005)
    # below the knee at 5/0.7 = 7.143 m/s it is D/0.7: 5/0.7 = 7.143 m; not closing: no gap is
    # critical
    assert critical_gap([5, 0, -3]) == pytest.approx([7.142857, 0, 0], abs=1e-6)


def test_careful_driver_behind_a_standing_target():
    # 30 km/h = 8.333 m/s: 8.333*1.75 - 7.593*0.36/6 + (8.333 - 2.2779)^2/15.186 = 14.583 - 0.456 +
    # 2.415 = 16.54 m
    gaps = required_gap(np.array([30, 40, 50, 60]) / 3.6, **CAREFUL)
    assert gaps == pytest.approx([16.54, 24.13, 32.73, 42.34], abs=0.005)


def test_contact_within_the_ramp_by_hand():
    # jerk 12, ramp of 1 s: D = 10, after 0.5 s it has gone 10*0.5 - 12*0.125/6 = 4.75 m and does 10
    # - 12*0.25/2 = 8.5
    assert ideal_impact_speed(10, 0, 4.75, deceleration=12, build_up=1.0) == pytest.approx(
        8.5, abs=1e-12
    )
    # slower than 12*1/2 = 6 m/s it stops on the ramp: D = 1.5, t* = sqrt(2*1.5/12) = 0.5,
    # 2/3*1.5*0.5 = 0.5 m
    assert required_gap(1.5, deceleration=12, build_up=1.0) == pytest.approx(0.5, abs=1e-15)


def test_published_approaches():
    rows = table("analytic_approach.csv")
    brakes = {
        "deceleration": rows["a_max_mps2"],
        "delay": rows["delay_s"],
        "build_up": rows["ramp_s"],
    }
    assert required_gap(rows["dv0_mps"], **brakes) == pytest.approx(
        rows["gap_required_m"], abs=1e-5
    )
    # the gaps are printed to 0.1 mm, and v dv = a dd: 8 m/s2 * 1e-4 m moves v^2/2 by less than 1e-3
    impact = ideal_impact_speed(rows["dv0_mps"], 0.0, rows["gap0_m"], **brakes)
    assert np.max(np.abs(impact**2 - rows["dv_impact_mps"] ** 2)) < 2e-3
    clear = np.abs(rows["gap0_m"] - rows["gap_required_m"]) > 1e-4
    assert clear.sum() > 400
    assert np.array_equal(impact[clear] > 0, rows["crash"][clear] == 1)


def test_published_zone_boundaries():
    rows = table("paper_zone_boundary.csv")
    constants = {
        "deceleration": rows["a_mps2"],
        "critical_inverse_ttc": rows["ittc_threshold_per_s"],
    }
    boundary = rows["d_boundary_no_delay_m"]
    assert critical_gap(rows["dv_mps"], **constants) == pytest.approx(boundary, rel=1e-4)
    assert critical_gap(rows["dv_mps"], delay=1.0, **constants) == pytest.approx(
        rows["d_boundary_1s_delay_m"], rel=1e-4
    )
    for share, column in ((0.98, "ittc_max_at_d_minus_2pct"), (1.02, "ittc_max_at_d_plus_2pct")):
        gap = share * critical_gap(rows["dv_mps"], **constants)
        peak = max_inverse_ttc(rows["dv_mps"], 0.0, gap, deceleration=rows["a_mps2"])
        assert peak == pytest.approx(rows[column], rel=1e-4)


def test_arrays_broadcast_and_scalars_stay_scalars():
    assert max_inverse_ttc(np.full((4, 1), 20.0), np.zeros(3), 50.0).shape == (4, 3)
    assert ideal_impact_speed(20.0, [0.0, 10.0], [[10.0], [30.0]], deceleration=5).shape == (2, 2)
    own = {"deceleration": [4.0, 8.0], "build_up": [[0.0], [0.6], [2.0]]}
    assert ideal_impact_speed(20.0, 0.0, 15.0, **own).tolist() == [
        [ideal_impact_speed(20, 0, 15, deceleration=a, build_up=t) for a in own["deceleration"]]
        for (t,) in own["build_up"]
    ]
    for value in (
        max_inverse_ttc(20, 0, 50),
        ideal_impact_speed(20, 0, 5, deceleration=5),
        critical_gap(10),
    ):
        assert isinstance(value, np.float64)


@pytest.mark.parametrize(
    "wrong, sentence",
    rows_of(
        """
{"ego_speed": NaN} | `ego_speed` of an approach must be finite, got nan
{"lead_speed": -1.0} | `lead_speed` of an approach must be at least 0, got -1.0
{"gap": Infinity} | `gap` of an approach must be finite, got inf
{"deceleration": 0.0} | `deceleration` of an approach must be greater than 0, got 0.0
{"delay": -0.1} | `delay` of an approach must be at least 0, got -0.1
{"build_up": -0.1} | `build_up` of an approach must be at least 0, got -0.1
""",
        json.loads,
    ),
)
def test_impossible_approaches_are_refused(wrong, sentence):
    approach = {
        "ego_speed": 20.0,
        "lead_speed": 0.0,
        "gap": 30.0,
        "deceleration": 5.0,
        "delay": 0.0,
    } | wrong
    with refusal(sentence):
        ideal_impact_speed(**approach)
    if "build_up" not in wrong:
        with refusal(sentence):
            max_inverse_ttc(**approach)


def test_impossible_thresholds_and_times_are_refused():
    with refusal("`critical_inverse_ttc` of an approach must be greater than 0"):
        critical_gap(10.0, critical_inverse_ttc=0.0)
    with refusal("`time` of an approach must be at least 0"):
        ideal_braking_gap(20, 0, 30, -1.0)


# --- the search over time -------------------------------------------------------------------------


def searched(ego, lead, gap, **how):
    """The search behind vehicles of constant speed."""
    ego, lead, gap = (np.atleast_1d(np.asarray(value, dtype=float)) for value in (ego, lead, gap))
    lead_speed = lambda time: np.broadcast_to(lead[:, None], time.shape)  # noqa: E731
    return searched_criticality(ego, gap, (lead_speed, lambda time: lead[:, None] * time), **how)


def test_law_the_search_is_the_closed_form_where_the_lead_keeps_its_speed():
    random = np.random.default_rng(11)
    n = 4_000
    ego, lead, gap = random.uniform(0, 40, n), random.uniform(0, 30, n), random.uniform(1.0, 200, n)
    how = {"deceleration": random.uniform(2, 9, n), "delay": random.uniform(0, 2, n)}
    inverse, impact = searched(ego, lead, gap, **how)
    exact, exact_impact = (
        max_inverse_ttc(ego, lead, gap, **how),
        ideal_impact_speed(ego, lead, gap, **how),
    )
    # within a hair of contact: the zone is far behind
    grazing = (exact_impact < 0.5) & (exact > 20.0)
    assert 500 < np.isinf(exact).sum() < 3_500
    assert np.array_equal(np.isinf(inverse)[~grazing], np.isinf(exact)[~grazing])
    finite = np.isfinite(exact) & ~grazing
    assert inverse[finite] == pytest.approx(exact[finite], rel=1e-3, abs=1e-9)
    assert impact[~grazing] == pytest.approx(exact_impact[~grazing], abs=1e-6)


def test_law_a_conflict_that_begins_with_the_braking_is_an_approach_from_the_gap_left_then():
    gap = np.linspace(0.0, 100.0, 401)
    ego, lead = np.full_like(gap, 60 / 3.6), np.full_like(gap, 20 / 3.6)
    inverse, impact = searched(ego, lead, gap, delay=2.0, conflict_begin=2.0, passing_length=8.6)
    left = gap - 2.0 * (40 / 3.6)
    exact = np.where(left < -8.6, 0.0, max_inverse_ttc(ego, lead, left))
    assert np.array_equal(np.isinf(inverse), np.isinf(exact))
    assert inverse[np.isfinite(exact)] == pytest.approx(exact[np.isfinite(exact)], rel=1e-3)
    assert impact == pytest.approx(
        np.where(left < -8.6, 0.0, ideal_impact_speed(ego, lead, left, deceleration=5.0))
    )
    # both bodies are 4.3 m: safe below 22.22 - 8.6 m, where the ego has passed, and above 22.22 +
    # 17.45 m
    hazardous = gap[inverse >= 0.7]
    assert hazardous[0] == 13.75
    assert hazardous[-1] == 39.5
    assert np.all(np.diff(hazardous) == 0.25)


def test_the_search_behind_a_braking_lead_by_hand():
    # Both at 20 m/s; the lead stands after 40 m (5 m/s2). Without delay the ego needs the same 40
    # m: never closing. After 1 s it needs 20 + 40 m: with 10 m it lacks 10 m. Both brake alike
    # until the lead stands at 4 s: then the ego is 1 s behind in its braking, 5 m/s fast, and has
    # lost 2.5 + 5*3 = 17.5 m of the gap; so contact comes before.
    lead_speed = lambda time: np.maximum(20.0 - 5.0 * time, 0.0)  # noqa: E731
    lead_distance = lambda time: 40.0 - lead_speed(time) ** 2 / 10.0  # noqa: E731
    ego = np.array([20.0])
    assert searched_criticality(ego, [5.0], (lead_speed, lead_distance))[1] == 0.0
    inverse, impact = searched_criticality(ego, [10.0], (lead_speed, lead_distance), delay=1.0)
    # from 1 s on it closes at 5 m/s with 10 - 2.5 m left: contact after 1.5 s more, at 5 m/s
    assert inverse[0] == math.inf
    assert impact[0] == pytest.approx(5.0)
    # with 30 m it stops 10 m short; its ITTC peaks while it brakes behind the standing lead: sqrt(a
    # / 2c), c = 10 m, is reached at sqrt(2 a c) = 10 m/s, but it has only 5 m/s when the lead
    # stands, 12.5 m away: 5 / 12.5
    inverse, impact = searched_criticality(ego, [30.0], (lead_speed, lead_distance), delay=1.0)
    assert inverse[0] == pytest.approx(0.4, rel=1e-3)
    assert impact[0] == 0.0
