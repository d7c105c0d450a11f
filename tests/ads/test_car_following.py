"""The IDM and its enhanced form as printed, and the ADS `idm` in SUMO."""

import math

import numpy as np
import pytest
from refusals import refusal
from road_scenes import (
    actor,
    case,
    clear_drive,
    clips_of,
    cut_outs_at_the_edge,
    fresh,
    low_speed,
    mover,
    safe_cut_outs,
)

from sumo_eval.ads.car_following import (
    FOLLOWED,
    Idm,
    IdmParameters,
    constant_acceleration_heuristic,
    constant_speed_heuristic,
    desired_gap,
    enhanced_idm_acceleration,
    follow,
    free_acceleration,
    idm_acceleration,
    improved_idm_acceleration,
)
from sumo_eval.ads.fuzzy_safety_model import FuzzySafetyModel
from sumo_eval.ads.lane_changer import LaneChanger
from sumo_eval.ads.r157_careful_driver import CarefulDriver
from sumo_eval.cosim import simulate
from sumo_eval.cosim.doors.entry import made
from sumo_eval.scenario import Actor, Start

IDM = IdmParameters(headway=1.2, standstill_gap=2.0, acceleration=1.5, deceleration=2.0)
STATES = [
    (speed, gap, lead)
    for speed in (0.5, 10.0, 20.0, 30.0)
    for gap in (3.0, 15.0, 60.0)
    for lead in (0.0, 10.0, 30.0)
]


def test_the_desired_gap_by_hand():
    assert desired_gap(20.0, 5.0, IDM) == pytest.approx(2.0 + 24.0 + 100.0 / (2.0 * math.sqrt(3.0)))
    assert desired_gap(20.0, -50.0, IDM) == 2.0
    assert desired_gap(20.0, 0.0, IDM, headway=0.5) == pytest.approx(12.0)


def test_the_idm_by_hand():
    assert idm_acceleration(20.0, 30.0, 50.0, 15.0, IDM) == pytest.approx(-0.602562, abs=1e-6)


def test_on_a_free_road_the_idm_is_its_free_term():
    assert idm_acceleration(20.0, 30.0, math.inf, 0.0, IDM) == pytest.approx(
        1.5 * (1.0 - (2.0 / 3.0) ** 4)
    )
    for speed in (0.0, 20.0, 30.0):
        assert improved_idm_acceleration(speed, 30.0, math.inf, 0.0, IDM) == free_acceleration(
            speed, 30.0, IDM
        )


def test_the_free_term_is_zero_at_the_desired_speed_and_brakes_no_harder_than_b_above_it():
    assert free_acceleration(30.0, 30.0, IDM) == 0.0
    assert free_acceleration(0.0, 30.0, IDM) == IDM.acceleration
    assert free_acceleration(33.0, 30.0, IDM) == pytest.approx(-2.0 * (1.0 - (30.0 / 33.0) ** 3.0))
    assert free_acceleration(1e6, 30.0, IDM) == pytest.approx(-IDM.deceleration)


def test_at_its_desired_speed_the_improved_idm_settles_at_the_desired_gap_and_the_idm_does_not():
    gap = desired_gap(30.0, 0.0, IDM)
    assert improved_idm_acceleration(30.0, 30.0, gap, 30.0, IDM) == 0.0
    assert idm_acceleration(30.0, 30.0, gap, 30.0, IDM) == pytest.approx(-IDM.acceleration)


def test_the_improved_idm_by_hand():
    gap = 2.0 * desired_gap(20.0, 0.0, IDM)
    free = free_acceleration(20.0, 30.0, IDM)
    assert improved_idm_acceleration(20.0, 30.0, gap, 20.0, IDM) == pytest.approx(
        free * (1.0 - 0.5 ** (3.0 / free))
    )
    assert improved_idm_acceleration(20.0, 30.0, gap / 4.0, 20.0, IDM) == pytest.approx(
        1.5 * (1.0 - 4.0)
    )
    above = free_acceleration(33.0, 30.0, IDM)
    near = desired_gap(33.0, 0.0, IDM) / 2.0
    assert improved_idm_acceleration(33.0, 30.0, near, 33.0, IDM) == pytest.approx(
        above - 3.0 * 1.5
    )


def test_the_heuristic_is_the_braking_that_just_avoids_contact():
    assert constant_speed_heuristic(20.0, 40.0, 10.0) == pytest.approx(-(10.0**2) / 80.0)
    assert constant_speed_heuristic(10.0, 40.0, 10.0) == 0.0


@pytest.mark.parametrize("speed, gap, lead", STATES)
def test_the_enhanced_idm_brakes_at_least_as_needed_and_at_most_b_more(speed, gap, lead):
    needed = constant_speed_heuristic(speed, gap, lead)
    plain = improved_idm_acceleration(speed, 30.0, gap, lead, IDM)
    enhanced = enhanced_idm_acceleration(speed, 30.0, gap, lead, IDM)
    if plain >= needed:
        assert enhanced == plain
    else:
        assert needed - IDM.deceleration + 0.01 * plain - 1e-9 <= enhanced < needed


def followed(known, gap, desired_speed, lead_speed):
    known.gap = gap
    me, lead = mover("ego", 0.0, along=25.0), mover("lead", 0.0, along=lead_speed)
    return follow(known, me, lead, desired_speed, IDM, 0.05)


def test_a_follower_accepts_the_short_headway_it_finds_and_lets_it_grow_back():
    known = fresh(FOLLOWED)
    assert followed(known, 12.0, 25.0, 25.0) == pytest.approx(0.0, abs=1e-9)
    assert enhanced_idm_acceleration(25.0, 25.0, 12.0, 25.0, IDM) < -1.5
    for _ in range(int(25.0 / 0.05) - 1):
        followed(known, 12.0, 25.0, 25.0)
    accepted = 1.2 - (1.2 - 0.4) * math.exp(-1.0)
    assert followed(known, 12.0, 25.0, 25.0) == pytest.approx(
        enhanced_idm_acceleration(25.0, 25.0, 12.0, 25.0, IDM, accepted), abs=1e-2
    )


def test_a_follower_with_room_keeps_its_own_headway():
    expected = enhanced_idm_acceleration(25.0, 30.0, 60.0, 22.0, IDM)
    assert followed(fresh(FOLLOWED), 60.0, 30.0, 22.0) == expected


@pytest.mark.parametrize("name", ["headway", "standstill_gap", "acceleration", "deceleration"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_parameters_of_the_idm_are_positive_numbers(name, value):
    with refusal(f"`{name}` of the IDM must be a finite number greater than 0"):
        IdmParameters(**{name: value})


def test_idm_never_collides_in_front_vehicle_low_speed_and_keeps_its_lane():
    for concrete in low_speed():
        recording = clear_drive(concrete, "idm")
        assert np.abs(recording.ego.y).max() < 1e-6
        assert recording.end_reason == (
            "standstill" if concrete.values["lead_speed"] == 0.0 else "road_end"
        )


@pytest.mark.parametrize("ads, seed", [("idm", 1), ("lane_changer", 2)])
def test_none_collides_in_the_safe_zone_of_the_cut_out(ads, seed):
    for concrete in safe_cut_outs(8) + cut_outs_at_the_edge(12, seed):
        recording = clear_drive(concrete, ads)
        assert recording.end_reason in ("road_end", "standstill"), concrete.label


def test_idm_brakes_as_hard_as_the_formula_asks_up_to_its_brakes():
    recording = simulate(case(actor("lead", 60.0, 0.0), speed=30.0), "idm")
    assert recording.ego.acceleration.min() == -9.0
    assert "acceleration" not in clips_of(recording)


def test_idm_brakes_for_an_oncoming_lead_as_the_formula_asks():
    oncoming = Actor("oncoming", Start(50.0 + 4.5 + 150.0, 0.0, 15.0), heading=math.pi)
    ego = simulate(case(oncoming, speed=15.0), "idm").ego
    asked = idm_acceleration(15.0, 15.0, 150.0, -15.0, IDM)
    assert ego.acceleration[ego.time <= 0.3].min() == pytest.approx(asked, abs=0.1)


def test_idm_holds_its_speed_and_passes_the_other_lane():
    recording = simulate(case(actor("slow", 60.0, 5.0, y=3.5), speed=30.0), "idm")
    assert recording.end_reason == "road_end"
    assert recording.ego.speed == pytest.approx(30.0)


def test_behind_a_braking_lead_the_heuristic_stops_just_behind_where_the_lead_stops():
    # lead: 20^2 / (2 * 4) = 50 m to standstill, 40 m ahead; so 90 m are left: 20^2 / (2 * 90) =
    # 2.222 m/s2
    assert constant_acceleration_heuristic(20.0, 40.0, 20.0, 4.0) == pytest.approx(-400.0 / 180.0)
    # closing fast on a lead that hardly brakes, the speeds meet first: 1 + 20^2 / (2 * 10) = 21
    # m/s2
    assert constant_acceleration_heuristic(30.0, 10.0, 10.0, 1.0) == pytest.approx(-21.0)


def test_a_lead_that_hardly_brakes_is_almost_one_that_keeps_its_speed():
    for speed, gap, lead in ((20.0, 30.0, 10.0), (15.0, 20.0, 14.0)):
        steady = constant_speed_heuristic(speed, gap, lead)
        assert constant_acceleration_heuristic(speed, gap, lead, 1e-9) == pytest.approx(
            steady, abs=1e-6
        )


@pytest.mark.parametrize(
    "ads, options, wrong",
    [
        (Idm, {"parameters": {"headway": 1.0}}, {"parameters": {"headwy": 1.0}}),
        (LaneChanger, {"parameters": {"headway": 1.0}}, {"habits": 3}),
        (LaneChanger, {"habits": {"duration": 5.0}}, {"habits": {"duration": 0.0}}),
        (FuzzySafetyModel, {"as_coded": True}, {"as_coded": "no"}),
        (CarefulDriver, {"aeb": True}, {"aeb": "false"}),
    ],
)
def test_options_may_be_tables_and_wrong_ones_are_refused(ads, options, wrong):
    ((name, value),) = options.items()
    own = getattr(made(ads, options, "a"), {"parameters": "idm"}.get(name, name))
    expected = value if isinstance(value, dict) else {}
    assert {key: getattr(own, key) for key in expected} == expected
    with refusal():
        made(ads, wrong, "a")
