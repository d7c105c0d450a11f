"""The reference drivers of UN R157: formulas by hand, and each in a plain case through SUMO."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refusal
from road_scenes import ROAD, actor, assert_last, case, clear_drive, fresh, mover
from tables import values_of

from sumo_eval.ads.braking import SAFETY_BRAKING, follow_demand
from sumo_eval.ads.eu_2022_1426 import SEATED, STANDING
from sumo_eval.ads.fuzzy_safety_model import (
    FuzzySafetyModel,
    considered,
    critical_fuzzy_safety,
    demanded_braking,
    proactive_fuzzy_safety,
)
from sumo_eval.ads.r157 import (
    SIGHTING,
    Brakes,
    brake_ramp,
    brake_ramp_lost,
    closing_across,
    foresee,
    lateral_gap,
    sight,
    time_headway,
    time_to_collision,
)
from sumo_eval.ads.r157_careful_driver import _WATCHED, CarefulDriver, _look_at, needed_deceleration
from sumo_eval.ads.reg157 import Reg157, avoidable_ttc, reg157_braking
from sumo_eval.ads.rss import lateral_safe_distance, longitudinal_safe_distance
from sumo_eval.cosim import simulate
from sumo_eval.cosim.records import MOVER
from sumo_eval.cosim.vehicle_model import drive
from sumo_eval.scenario import Actor, Start, brake_to_stop, constant_lateral
from sumo_eval.scenario.concrete import Act
from sumo_eval.scenario.played import SPEED
from sumo_eval.settings import VehicleSettings

DRIVERS = ["careful_driver", "careful_driver_aeb", "fsm", "rss", "reg157", "eu_2022_1426"]


def seen_after(sighting, time):
    """A vehicle some time after the look 0.1 s after the one before."""
    then = fresh(MOVER)
    foresee(then, sighting, time, 0.1)
    return then


def test_the_ramp_rises_holds_and_is_nothing_before_it_begins():
    assert [brake_ramp(since, 6.0, 0.6) for since in (-1.0, 0.0, 0.3, 0.6, 5.0)] == pytest.approx(
        [0.0, 0.0, 3.0, 6.0, 6.0]
    )
    assert brake_ramp(0.01, 6.0, 0.0) == 6.0


def test_the_speed_that_the_ramp_takes_off_by_hand():
    # 6 m/s2 after 0.6 s: 10 t^2 / 2 up to there, then 1.8 m/s and 6 m/s2 more
    assert [brake_ramp_lost(since, 6.0, 0.6) for since in (-1.0, 0.3, 0.6, 1.6)] == pytest.approx(
        [0.0, 0.45, 1.8, 7.8]
    )
    assert brake_ramp_lost(2.0, 6.0, 0.0) == 12.0


def test_headways_by_hand():
    me, other = mover("me", 0.0, along=20.0), mover("other", 34.5, y=3.5, along=10.0)
    assert time_to_collision(me, other) == pytest.approx(3.0)
    assert time_headway(me, other) == pytest.approx(1.5)
    assert lateral_gap(me, other) == pytest.approx(1.7)
    assert time_to_collision(other, me) == math.inf


def test_a_lead_that_was_out_of_sight_brakes_by_its_mean_rate():
    """From 20 to 18 m/s in 1 s are 2 m/s2, below the 5 m/s2 that the driver perceives."""
    known = fresh(_WATCHED)
    p = SimpleNamespace(wander=0.375, lead_braking=5.0)
    scenario = SimpleNamespace(step=0.1, road=SimpleNamespace(lane_width=3.5))
    for time, speed in ((0.0, 20.0), (0.1, 20.0), (1.1, 18.0)):
        _look_at(mover("lead", 50.0, along=speed), known, p, scenario, time)
    assert known.braking == pytest.approx(2.0)
    assert math.isnan(known.braked_at)


def test_pfs_by_hand():
    assert proactive_fuzzy_safety(43.19, 20.0, 10.0) == 1.0
    assert proactive_fuzzy_safety(61.86, 20.0, 10.0) == 0.0
    assert proactive_fuzzy_safety(52.5238095, 20.0, 10.0) == pytest.approx(0.5)


@pytest.mark.parametrize(
    "speed, acceleration, unsafe, safe",
    values_of("""
    20.0, 0.0, 15.8333333, 20.0
    20.0, -6.0, 10.4583333, 12.5
    12.0, -4.0, 0.5, 0.5
    """),
)
def test_cfs_by_hand(speed, acceleration, unsafe, safe):
    assert critical_fuzzy_safety(unsafe - 1e-6, speed, 10.0, acceleration) == 1.0
    assert critical_fuzzy_safety(safe + 1e-6, speed, 10.0, acceleration) == 0.0
    if safe > unsafe:
        middle = 0.5 * (safe + unsafe)
        assert critical_fuzzy_safety(middle, speed, 10.0, acceleration) == pytest.approx(
            0.5, abs=1e-6
        )


def test_cfs_as_the_jrc_has_it_divides_by_the_braking_itself():
    # 18.8 - 4 * 0.75 = 15.8 m/s is below the other's 15.9: 2.9^2 / 8 = 1.051 m as printed, 2.9^2 /
    # 12 = 0.701 m coded
    for gap, acceleration, as_coded in ((1.0, -6.0, 0.0), (0.7, -6.0, 1.0), (1.0, -4.0, 1.0)):
        for coded, value in ((False, 1.0), (True, as_coded)):
            assert critical_fuzzy_safety(gap, 18.8, 15.9, acceleration, coded) == value


def test_cfs_is_zero_behind_a_vehicle_as_fast():
    assert critical_fuzzy_safety(0.5, 10.0, 10.0, 0.0) == 0.0


def test_the_fuzzy_braking_by_hand():
    for safeties, braking in values_of("""
        (0.0, 0.0), 0.0
        (0.0, 0.5), 2.0
        (0.5, 1.0), 5.0
        """):
        assert demanded_braking(*safeties) == braking


def test_a_vehicle_is_considered_when_it_comes_over_before_the_ego_is_past():
    me, other = mover("me", 0.0, along=20.0), mover("other", 15.5, y=3.5, along=10.0)
    # 1.7 m / 0.82 m/s < (11 m + 9 m) / 10 m/s + 0.1 s
    assert considered(me, other, lateral_closing=0.82)
    assert not considered(me, other, lateral_closing=0.80)
    assert not considered(me, other, lateral_closing=-1.0)
    for speed in (20.0, 25.0):  # nobody comes over in front of who is not faster
        assert not considered(me, mover("lead", 15.5, along=speed, y=other.y), lateral_closing=3.0)
    assert considered(me, mover("lead", 15.5, along=10.0), lateral_closing=0.0)


def test_rss_by_hand():
    assert longitudinal_safe_distance(20.0, 10.0) == pytest.approx(48.765625)
    # both must stop where the other is oncoming: 57.098958 m from 20 m/s, 20.848958 m from 10 m/s
    assert longitudinal_safe_distance(20.0, -10.0) == pytest.approx(77.947917)
    # rounding
    assert longitudinal_safe_distance(20.0, -1e-15) == longitudinal_safe_distance(20.0, 0.0)
    assert lateral_safe_distance(1.0) == pytest.approx(2.8625)


def test_the_ttc_of_the_regulation_by_hand():
    assert avoidable_ttc(12.0, Reg157.brakes) == pytest.approx(1.35)
    # TTC 2.93 s is below 30 / 12 + 0.45 s; at 2.7 s of headway it is no matter if the lead brakes
    scenario = SimpleNamespace(road=SimpleNamespace(lane_width=3.5))
    me, lead = mover("me", 0.0, along=33.0), mover("lead", 4.5 + 88.0, along=3.0)
    for lead.braking in (0.0, 2.0):
        assert reg157_braking(me, lead, Reg157(), scenario) == 6.0


def test_the_needed_deceleration_by_hand():
    assert needed_deceleration(30.0, 20.0, 10.0, 0.0, delay=1.0) == pytest.approx(2.5)
    assert needed_deceleration(30.0, 20.0, 10.0, 5.0, delay=1.0) == pytest.approx(10.0)
    assert needed_deceleration(9.0, 20.0, 10.0, 0.0, delay=1.0) == math.inf
    assert needed_deceleration(9.0, 10.0, 10.0, 0.0, delay=1.0) == 0.0


def test_motion_is_derived_from_one_step_to_the_next():
    sighting, me = fresh(SIGHTING), mover("me", 0.0)
    sight(sighting, mover("other", 50.0, y=3.5, along=20.0, across=-0.3), 0.1)
    first = seen_after(sighting, 0.0)
    assert first.braking == 0.0
    assert closing_across(me, first) == pytest.approx(0.3)
    sight(sighting, mover("other", 52.0, y=3.4, along=19.5), 0.1)
    second = seen_after(sighting, 0.0)
    assert second.braking == pytest.approx(5.0)
    assert closing_across(me, second) == pytest.approx(1.0)


def test_a_speed_across_is_the_one_in_the_middle_of_the_step_that_shows_it():
    # 1 m/s2 to the right from rest: y = -t^2/2; between 0.1 and 0.2 s on average 0.15 m/s, as it is
    # at 0.15 s
    sighting = fresh(SIGHTING)
    for time in (0.0, 0.1, 0.2):
        sight(sighting, mover("other", 50.0, y=-0.5 * time * time, along=20.0), 0.1)
    found = [seen_after(sighting, after).across for after in (-0.05, -0.1, 0.0)]
    assert found == pytest.approx([-0.15, -0.10, -0.15])
    for speed in (-10.0, -11.0):  # oncoming, it speeds up
        sight(sighting, mover("other", 50.0, along=speed), 0.1)
    assert sighting.mover.braking == 0.0


def safety_braking():
    """Brakes that have been told nothing yet."""
    brakes = fresh(SAFETY_BRAKING)
    brakes.path.level = brakes.path.brakes = brakes.path.owed = 0.0
    return brakes


def told(brakes, demand, time, reaction):
    """What brakes that rise at 20 m/s3 to 6 m/s2 are told in a step of 0.1 s while `demand` m/s2 is
    demanded."""
    human = Brakes(reaction, 6.0, 20.0)
    cycle = SimpleNamespace(vehicle=VehicleSettings(), step=0.1)
    return follow_demand(brakes, lambda scene, after: demand, None, time, human, cycle)


def test_safety_braking_begins_and_rises_within_its_step():
    # alarmed at 0; 0.25 s later it rises with 20 m/s3 to 6 m/s2 at 0.55 s; the vehicle loses what
    # the ramp takes off
    brakes, step = safety_braking(), 0.1
    speed, acceleration, speeds = 30.0, 0.0, []
    for count in range(8):
        level = told(brakes, 8.0, count * step, reaction=0.25)
        acceleration, speed, _ = drive(speed, acceleration, -level, VehicleSettings(), step)
        speeds.append(30.0 - speed)
    # 10 (t - 0.25)^2 up to 0.55 s, 0.9 + 6 (t - 0.55) after
    expected = [0.0, 0.0, 0.025, 0.225, 0.625, 1.2, 1.8, 2.4]
    assert speeds == pytest.approx(expected, abs=0.03)
    assert speeds[-1] == pytest.approx(2.4, abs=1e-5)


def test_the_reaction_is_waited_for_once():
    brakes = safety_braking()
    for count in range(10):
        told(brakes, 8.0 if count < 5 else 0.0, 0.1 * count, reaction=0.2)
    assert brakes.path.level == 0.0
    assert told(brakes, 8.0, 1.0, reaction=0.2) > 0.5


@pytest.mark.parametrize(
    "rule, times",
    [
        (SEATED, (0.48, 0.71, 0.94, 1.18, 1.41, 1.64)),
        (STANDING, (0.74, 1.32, 1.90, 2.47, 3.05, 3.63)),
    ],
)
def test_the_ttc_of_regulation_2022_1426_is_the_printed_one(rule, times):
    # v_rel / (2 a) + tau / 2 + 0.1 s at 10, 20, .. 60 km/h
    found = [avoidable_ttc(speed / 3.6, rule) for speed in range(10, 61, 10)]
    assert [round(time, 2) for time in found] == list(times)


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_slower_vehicle_far_enough_ahead_is_not_hit(driver):
    recording = clear_drive(case(actor("lead", gap=60.0, speed=10.0)), driver)
    assert recording.ego.acceleration.min() < -2.0
    assert np.abs(recording.ego.y).max() < 1e-9


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_lead_that_brakes_hard_at_a_long_headway_is_not_hit(driver):
    lead = actor("lead", 40.0, 20.0, 0.0, brake_to_stop(1.0, 6.0))
    recording = clear_drive(case(lead), driver)
    assert recording.end_reason == "standstill"


@pytest.mark.parametrize("driver", ["careful_driver", "reg157"])
def test_a_steady_lead_at_two_seconds_headway_is_followed_at_constant_speed(driver):
    recording = simulate(case(actor("lead", gap=40.0, speed=20.0)), driver)
    assert recording.end_reason == "road_end"
    assert recording.ego.speed == pytest.approx(20.0)


def test_the_careful_driver_brakes_after_the_wandering_zone():
    other = actor("cut_in", 23.0, 11.0, 3.5, constant_lateral(0.0, 1.0, -3.5))
    ego = simulate(case(other), "careful_driver").ego
    begins = 0.375 / 1.0 + 0.4 + 0.75
    braking = ego.acceleration < -0.01
    assert ego.time[braking][0] == pytest.approx(begins, abs=0.15)
    assert not braking[ego.time < begins - 0.05].any()
    assert ego.acceleration.min() == pytest.approx(-0.774 * 9.81, abs=1e-6)


def test_a_standing_pedestrian_is_perceived_once_it_has_walked():
    # From 0.7 m beyond the middle of the lane on the right, at 1.4 m/s: 0.375 m after 0.27 s, and
    # the lane's middle is nothing to him. When he sets out he is 38 m ahead of 20 m/s: a TTC of 1.9
    # s, so nothing else is waited for.
    walking = constant_lateral(0.5, 1.4, 4.2)
    walker = Actor("walker", Start(50.0 + 2.5 + 48.0, -4.2, 0.0), (walking,), 0.5, 0.5, slides=True)
    ego = simulate(case(walker), "careful_driver").ego
    assert ego.time[ego.acceleration < -0.01][0] == pytest.approx(
        0.5 + 0.375 / 1.4 + 0.4 + 0.75, abs=0.15
    )


def test_a_cut_in_far_ahead_is_left_alone_until_its_ttc_is_below_two_seconds():
    other = actor("cut_in", 60.0, 10.0, 3.5, constant_lateral(0.0, 1.0, -3.5))
    ego = simulate(case(other), "careful_driver").ego
    first = ego.time[ego.acceleration < -0.01][0]
    assert first == pytest.approx((60.0 - 20.0) / 10.0 + 0.75, abs=0.15)


def test_a_cut_in_that_strays_while_hidden_is_evaluated_once_it_shows():
    # it strays at 1.8 s; a fifth of it shows when the vehicle before it has slid 0.3 m aside
    hider = actor("hider", 10.0, 20.0, 1.95, constant_lateral(2.2, 4.0, 4.0), slides=True)
    other = actor("cut_in", 43.0, 10.0, 3.5, constant_lateral(1.4, 1.0, -0.6), slides=True)
    ego = simulate(case(hider, other), "careful_driver").ego
    first = ego.time[ego.acceleration < -0.01][0]
    assert first == pytest.approx(2.2 + 0.3 / 4.0 + 0.4 + 0.75, abs=0.15)


def test_a_lead_that_braked_hard_far_ahead_and_no_longer_brakes_is_a_slower_lead():
    braked = Act(SPEED, 1.0, 0.0, 15.0, 0.0, 6.0, math.inf)
    recording = simulate(case(actor("lead", 80.0, 20.0, 0.0, braked)), "careful_driver")
    gap = recording.actors["lead"].x - recording.ego.x - 4.5
    # 2 s of headway are 40 m; braking is needed from 9.9 m on, and begins 1.15 s later
    assert gap[recording.ego.acceleration < -0.01][0] == pytest.approx(9.9 - 5.0 * 1.15, abs=0.6)


def test_a_vehicle_that_is_back_in_its_lane_is_not_an_event():
    strays = constant_lateral(0.5, 1.0, -0.5), constant_lateral(1.5, 1.0, 0.45)
    beside = simulate(case(actor("beside", 60.0, 10.0, 3.5, *strays)), "careful_driver").ego
    assert beside.speed.min() == 20.0
    # a lead that strays hides what is beyond it once it is back
    strays = constant_lateral(0.5, 1.0, 0.5), constant_lateral(1.5, 1.0, -0.5)
    brakes = Act(SPEED, 10.0, 0.0, 15.0, 0.0, 1.0, math.inf)
    far = actor("far", 250.0, 20.0, 0.0, brakes)
    ego = simulate(case(actor("lead", 35.0, 20.0, 0.0, *strays), far), "careful_driver").ego
    assert ego.speed[ego.time < 25.0].min() == 20.0


def test_a_vehicle_that_was_revealed_for_a_moment_is_evaluated_again():
    # the lead strays for 0.2 s, less than the evaluation takes, and leaves 9 s later
    moves = [constant_lateral(1.0, 4.0, 0.45), constant_lateral(1.2, 4.0, -0.45)]
    lead = actor("lead", 35.0, 20.0, 0.0, *moves, constant_lateral(10.0, 1.0, 3.5))
    ego = simulate(case(lead, actor("far", 230.0, 15.0)), "careful_driver").ego
    first = ego.time[ego.acceleration < -0.01][0]
    assert first == pytest.approx(10.0 + 0.375 + 0.4 + 0.75, abs=0.15)


@pytest.mark.parametrize("lane", [0.0, 3.5])
def test_a_lead_that_cut_in_long_before_it_brakes_is_a_braking_lead(lane):
    moves = [constant_lateral(1.0, 1.0, -lane)] if lane else []
    lead = actor("lead", 54.0, 30.0, lane, *moves, Act(SPEED, 10.0, 0.0, 0.0, 0.0, 6.0, math.inf))
    ego = clear_drive(case(lead, speed=30.0), "careful_driver").ego
    assert ego.time[ego.acceleration < -0.01][0] == pytest.approx(10.0 + 0.4 + 0.75, abs=0.15)


def test_a_vehicle_that_left_the_path_is_evaluated_again_when_it_is_back():
    # it brakes for 0.1 s and leaves the path meanwhile; as it slides back its TTC is above 3 s
    moves = [Act(SPEED, 1.0, 0.0, 19.0, 0.0, 10.0, math.inf)]
    moves += [constant_lateral(0.9, 12.0, 3.5), constant_lateral(5.0, 12.0, -3.5)]
    recording = simulate(
        case(actor("lead", 38.0, 20.0, 0.0, *moves, slides=True)), "careful_driver"
    )
    ego = recording.ego
    assert ego.speed[ego.time < 8.0].min() == 20.0


def test_a_vehicle_that_stays_in_its_lane_is_not_an_event():
    beside = actor("beside", 20.0, 10.0, 3.5 - 0.3)
    for driver in ("careful_driver", "fsm", "reg157"):
        assert simulate(case(beside), driver).ego.speed == pytest.approx(20.0)


@pytest.mark.parametrize("ego_y, first, then", [(0.0, 7.0, 3.5), (3.5, 0.0, 7.0)])
def test_a_vehicle_that_settles_beside_the_ego_is_not_an_event(ego_y, first, then):
    # from two lanes away, and across the ego's lane far ahead; later TTC is below 2 s
    change = constant_lateral(0.5, 2.0, then - first)
    other = actor("beside", 60.0, 10.0, first, change)
    road = replace(ROAD, lanes=3)
    assert simulate(case(other, y=ego_y, road=road), "careful_driver").ego.speed.min() == 20.0


def test_a_cut_in_from_a_lane_in_which_it_has_settled_is_evaluated():
    changes = constant_lateral(0.1, 5.0, -3.5), constant_lateral(3.0, 1.0, -3.5)
    other = actor("cut_in", 50.0, 10.0, 7.0, *changes)
    ego = simulate(case(other, road=replace(ROAD, lanes=3)), "careful_driver").ego
    first = ego.time[ego.acceleration < -0.01][0]
    assert first == pytest.approx(3.0 + 0.375 / 1.0 + 0.4 + 0.75, abs=0.15)


def test_the_aeb_stage_does_not_see_through_a_vehicle():
    # 29 m to one that stands, TTC 1.45 s, behind one that slides aside at 1.8 m/s from 0.2 s on: a
    # fifth of the hidden one's 1.8 m shows 0.2 s after that
    lead = actor("lead", 6.0, 20.0, 0.0, constant_lateral(0.2, 1.8, 3.5), slides=True)
    ego = simulate(case(lead, actor("standing", 29.0, 0.0), speed=20.0), "careful_driver_aeb").ego
    assert (ego.speed[ego.time <= 0.4] == 20.0).all()
    assert ego.speed[np.searchsorted(ego.time, 0.6)] < 20.0


def test_the_aeb_stage_avoids_what_the_driver_alone_is_too_late_for():
    standing = case(actor("lead", gap=18.0, speed=0.0), speed=13.9)
    assert simulate(standing, "careful_driver").collision is not None
    recording = clear_drive(standing, "careful_driver_aeb")
    assert recording.ego.acceleration.min() == pytest.approx(-0.85 * 9.81, abs=1e-6)


def test_the_fuzzy_model_as_printed_comes_to_rest_against_a_standing_vehicle_and_with_its_margin_short_of_it():
    standing = case(actor("lead", gap=120.0, speed=0.0), speed=20.0)
    assert_last(simulate(standing, FuzzySafetyModel(standstill_gap=0.0)), 0.1, speed=0.0)
    recording = clear_drive(standing, "fsm")
    assert recording.end_reason == "standstill"
    assert recording.actors["lead"].x[-1] - recording.ego.x[-1] - 4.5 > 0.009


def test_the_margin_of_the_fuzzy_model_is_a_distance():
    with refusal("`standstill_gap` of ADS `fsm` must be a finite number, at least 0"):
        FuzzySafetyModel(standstill_gap=-0.1)


@pytest.mark.parametrize("driver", [CarefulDriver, Reg157])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_the_readings_are_numbers(driver, value):
    with refusal(r"`lead_braking` of ADS .* must be a finite number, at least 0"):
        driver(lead_braking=value)


def test_a_subclass_may_hold_what_is_no_number():
    class Named(Reg157):
        def __init__(self):
            self.name = "mine"
            super().__init__(margin=0.2)

    assert Named().margin == 0.2
    assert Named().name == "mine"
