"""The ideal vehicle of Eq. 17: what it knows, when it brakes, and that nobody who ships is
gentler."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ads.ads_cases import SCRIPTED
from campaign_share import SHARE
from road_scenes import (
    DECIDED,
    actor,
    assert_ended,
    at_point,
    case,
    clear_drive,
    drawn_cases,
    severities,
    severity,
)

from sumo_eval.ads.foresight import evasion, foresee
from sumo_eval.ads.known_answers import IdealBraking, safe_gap
from sumo_eval.cosim import Command, simulate
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.method.criticality import ideal_impact_speed
from sumo_eval.scenario import Actor, Start, brake_to_stop, catalogue, constant_lateral
from sumo_eval.scenario.concrete import Way
from sumo_eval.settings import SimulationSettings

OTHERS = tuple(
    name for name in SHIPPED if name not in ("ideal_braking", "no_reaction", "careful_driver")
)


def assert_nobody_is_gentler(name, count, ads):
    """Nobody can be gentler than who touches nobody, so the others drive the points where the ideal
    vehicle hits."""
    cases = drawn_cases(name, count, seed=5)
    ideal = severities(cases, "ideal_braking")
    hit = np.flatnonzero(ideal > 0.0)
    cases, ideal = [cases[row] for row in hit], ideal[hit]
    print(f"{name}: {count} points, the ideal vehicle hits at {len(hit)}")
    for one in ads if cases else ():
        found = severities(cases, one)
        print(f"    {one}: hits at {np.count_nonzero(found)} of these")
        gentler = found < ideal - 1e-9
        assert not gentler.any(), (one, [cases[row].label for row in np.flatnonzero(gentler)[:3]])


@pytest.mark.parametrize("name", SCRIPTED)
def test_no_shipped_ads_is_gentler_than_the_ideal_vehicle(name):
    assert_nobody_is_gentler(name, 40, ("no_reaction", "careful_driver"))
    assert_nobody_is_gentler(name, 4, OTHERS)


@pytest.mark.campaign
@pytest.mark.parametrize("name", sorted(catalogue.SCENARIOS))
def test_no_shipped_ads_is_gentler_at_10000_points(name):
    assert_nobody_is_gentler(
        name, max(40, round(10_000 * SHARE)), ("no_reaction", "careful_driver", *OTHERS)
    )


def test_no_ads_sees_a_child_through_parked_cars():
    case = at_point("child_from_behind_parked_cars", 13.9545, 2.74439, 0.546293)
    ideal, careful = (simulate(case, ads, DECIDED) for ads in ("ideal_braking", "careful_driver"))
    assert 0.0 < severity(ideal) < severity(careful)
    # the child runs from 24 m before it on; until then there are parked cars, which stand
    assert careful.ego.speed[careful.ego.x < 160.0 - 24.0].min() == 13.9545


NARROW = [
    # in its own lane change it would graze the other, and is up to 0.13 m behind one that keeps its
    # speed beside it
    ("exit", 16.6837, 14.0662, 27.5042, -5.21963),
    ("lane_drop_cut", 16.7039, 10.1173, 5.49282, 1.0),
    # the other turns its front into the lane 3 cm behind it, and reaches it with a corner
    ("side_vehicle", 25.38993, -4.53052, 0.959677),
    # the way as it lies misses the other by 0.01 mm, the way as it is driven touches it
    ("exit", 29.42476, 15.3235, 41.73862, -2.501959),
    # who keeps his speed has left after 22 s; the other slows down for 46 s, to 6 m/s
    ("cut_in_from_ramp", 31.60413, 12.01993, 49.57272, -0.129984),
]


@pytest.mark.parametrize("point", NARROW)
def test_it_touches_no_vehicle_where_bodies_pass_by_centimetres(point):
    assert simulate(at_point(*point), "ideal_braking", DECIDED).collision is None


FAST = at_point("r157_cut_out", 37.0, 2.0, 1.0)


def test_it_steers_round_what_shows_too_late_to_brake():
    # 78.3 m to a standing vehicle at 37 m/s: 37 * 0.075 + 37^2 / 18 = 78.8 m are needed; 2.25 s for
    # the next lane
    steered = clear_drive(FAST, "ideal_braking", DECIDED)
    assert steered.ego.speed.min() == 37.0
    assert steered.ego.y.max() > 3.4
    braked = simulate(FAST, "ideal_braking", replace(DECIDED, ideal_steers=False))
    assert 0.0 < braked.collision.relative_speed < 5.0


def test_it_steers_where_lane_changer_would_be_gentler():
    stream = np.random.default_rng(3)
    cases = [
        at_point("r157_cut_out", stream.uniform(36.0, 37.5), stream.uniform(0.0, 8.0), 1.0)
        for _ in range(12)
    ]
    ideal, other = severities(cases, "ideal_braking"), severities(cases, "lane_changer")
    braking = severities(cases, "ideal_braking", replace(DECIDED, ideal_steers=False))
    assert (other >= ideal).all()
    assert (other < braking).any()


def path_of(concrete, settings=DECIDED):
    settings = concrete.simulation(settings)
    return evasion(concrete, settings, foresee(concrete, settings), 9.0)


def test_it_steers_from_where_it_sees_on_and_as_quickly_as_a_driver():
    start, offset, begin, length = path_of(FAST)
    noticed = foresee(FAST, FAST.simulation(DECIDED))[1].noticed
    assert start == 0.0
    assert offset == 3.5
    assert begin == pytest.approx(FAST.ego.x + 37.0 * noticed)
    assert length == pytest.approx(37.0 * math.sqrt(10.0 / math.sqrt(3.0) * 3.5 / 4.0))


@pytest.mark.parametrize("headway", [1.5, 1.7])
def test_a_lane_is_free_with_1_6_seconds_to_the_lead_in_it(headway):
    lead, hidden = (replace(one) for one in FAST.actors)
    nearer = replace(lead, start=replace(lead.start, x=FAST.ego.x + 4.3 + 37.0 * headway))
    assert (path_of(replace(FAST, actors=(nearer, hidden)))[1] > 0.0) == (headway > 1.6)


def test_it_only_brakes_where_braking_will_do_or_the_lane_is_not_free():
    # 76.3 m, 74.7 m needed
    slower = at_point("r157_cut_out", 36.0, 2.0, 1.0)
    beside = Actor("beside", Start(FAST.ego.x - 10.0, 3.5, 37.0), (), 4.3, 1.9)
    assert path_of(slower)[1] == 0.0
    # 5.7 m behind, and no faster
    assert path_of(replace(FAST, actors=(*FAST.actors, beside)))[1] > 0.0
    # 2 m behind when it is in the lane: its path is 0.1 m longer
    touching = replace(beside, start=Start(FAST.ego.x - 6.4, 3.5, 37.0))
    assert path_of(replace(FAST, actors=(*FAST.actors, touching)))[1] == 0.0
    assert path_of(FAST, replace(DECIDED, ideal_steers=False))[1] == 0.0


def test_in_the_papers_cut_out_it_brakes_everywhere():
    assert all(
        path_of(concrete)[1] == 0.0 for concrete in drawn_cases("front_vehicle_cut_out", 60, seed=5)
    )


def lateness(first):
    """A driver who brakes as hard as the ideal vehicle, but later, for whoever is in its path,
    hidden or not."""

    class Late:
        def step(self, traci, ego, time):
            return Command(-9.0 if time >= first else 0.0)

    return Late


@pytest.mark.campaign
def test_six_drivers_of_known_order_have_six_c_in_cut_out():
    cases = drawn_cases("front_vehicle_cut_out", 150, seed=8)
    ideal, nothing = severities(cases, "ideal_braking"), severities(cases, "no_reaction")
    hit = np.flatnonzero(nothing > 0.0)[:40]
    cases, ideal = [cases[row] for row in hit], ideal[hit]
    assert (ideal > 0.0).any()
    found = []
    for first in (0.8, 1.0, 1.2, 1.5, 1.8, 2.2):
        u = np.array([severity(simulate(one, lateness(first), DECIDED)) for one in cases])
        touched = u > 0.0
        found.append(float(np.mean(np.minimum(ideal[touched] / u[touched], 1.0))))
    assert found == sorted(found, reverse=True)
    assert len({round(c, 6) for c in found}) == 6


def test_the_ideal_vehicle_reacts_to_the_first_lateral_motion_and_not_to_the_overlap():
    ego = simulate(at_point("cut_in", 20.0, 10.0, 15.0, 0.8), "ideal_braking").ego
    assert ego.acceleration[2] == -9.0, (
        "0.2 s after the lateral motion began; the bodies overlap from 2 s on"
    )


def test_it_passes_where_keeping_its_speed_is_free():
    # 15 m/s faster, 5 m behind: it is 5 + 8.6 m further ahead after 0.907 s, the overlap begins
    # after 1.6 / 1.6 = 1 s
    passed, touched = (
        simulate(at_point("cut_in", 25.0, 10.0, gap, 1.6), "ideal_braking", DECIDED)
        for gap in (5.0, 8.0)
    )
    assert passed.collision is None
    assert passed.ego.speed.min() == 25.0
    assert touched.ego.speed.min() < 25.0


def test_it_falls_behind_a_vehicle_that_it_would_be_beside_of_at_equal_speed():
    # 5 m/s faster and 1 m behind, it is beside the other when it is as slow: 25 / 18 + 0.375 m; 8 s
    # to the overlap
    beside = at_point("cut_in", 15.0, 12.5, 0.0, 0.9)
    recording = clear_drive(beside, "ideal_braking", DECIDED)
    assert recording.ego.speed.min() < 12.5


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 1.0])
def test_it_sees_the_obstacle_once_a_share_of_its_width_shows(share):
    # sliding to the left at 1.8 m/s: a share of 1.8 m shows after that share of a second; all of it
    # at 1 s
    lead = actor("lead", 25.5, 20.0, 0.0, constant_lateral(0.3, 1.8, 3.5), slides=True)
    settings = SimulationSettings(ideal_visible_share=share)
    first, obstacle = foresee(case(lead, actor("obstacle", 60.0, 0.0)), settings)
    assert obstacle.meets
    assert not first.meets
    assert obstacle.noticed == pytest.approx(0.0 if share == 0.0 else 0.3 + share, abs=1e-6)


def test_the_first_braking_of_a_lead_is_noticed_when_it_begins():
    lead = actor("lead", 25.5, 20.0, 0.0, brake_to_stop(0.73, 6.0))
    (known,) = foresee(case(lead), SimulationSettings())
    assert known == (0.73, True, 0.0, False)


@pytest.mark.parametrize("step", [0.02, 0.05, 0.1])
def test_braking_that_begins_within_a_step_hits_as_fast_as_in_closed_form(step):
    # the lead brakes from 0.73 s on, so hard that it stands at once
    lead = actor("lead", 40.0, 30.0, 0.0, brake_to_stop(0.73, 1e6))
    recording = simulate(
        case(lead, speed=30.0), "ideal_braking", SimulationSettings(step=step, record_interval=0.1)
    )
    expected = ideal_impact_speed(30.0, 0.0, 40.0, deceleration=9.0, build_up=0.15)
    assert recording.collision.relative_speed == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("gap, meets", [(100.3, True), (100.6, False)])
def test_the_step_in_which_the_case_ends_is_foreseen_to_its_end(gap, meets):
    # 10 m/s faster: contact after 10.03 or 10.06 s, where the road ends at 10.02 s, in the step to
    # 10.05 s
    lead = actor("lead", gap, 10.0)
    assert foresee(case(lead), SimulationSettings(time_limit=10.02))[0].meets == meets


def test_a_touch_of_corners_on_a_curve_is_foreseen_on_the_map():
    # 0.02 m apart by the road's frame, 5 mm into each other on the map: the left curve turns the
    # corners together
    grazes = at_point("curve_cut_in", 24.8564, 14.8803, 1.67441, 1.55033)
    settings = grazes.simulation(DECIDED)
    assert not foresee(replace(grazes, road=replace(grazes.road, line=())), settings)[0].meets
    assert foresee(grazes, settings)[0].meets


def test_only_the_ideal_vehicle_itself_receives_the_scripts():
    class Mine(IdealBraking):
        pass

    recording = simulate(case(actor("lead", 40.0, 0.0)), Mine)
    assert_ended(recording, "ads_error", "The ideal vehicle must know the scripts of the actors")


def test_the_safe_gap_by_hand():
    # equal speeds: 30 * 0.15 + 2 m; 20 behind 10 m/s: 20 * 0.15 + (400 - 100) / 18 + 2 m; who is
    # much slower: 2 m; 10 m/s that comes towards one: (400 + 100) / 18
    assert safe_gap(30.0, 30.0, 9.0, 0.15) == pytest.approx(6.5)
    assert safe_gap(20.0, 10.0, 9.0, 0.15) == pytest.approx(3.0 + 300.0 / 18.0 + 2.0)
    assert safe_gap(10.0, 30.0, 9.0, 0.15) == 2.0
    assert safe_gap(20.0, -10.0, 9.0, 0.15) == pytest.approx(3.0 + 500.0 / 18.0 + 2.0)


@pytest.mark.parametrize("gap, keeps", [(6.4, False), (6.6, True)])
def test_it_brakes_at_once_where_it_is_too_close_to_what_hides(gap, keeps):
    # fronts at 50 + 2.25 m and the lead's rear `gap` further on; the obstacle shows after 0.2 s at
    # the earliest
    lead = actor("lead", gap, 30.0, 0.0, constant_lateral(0.0, 1.8, 3.5), slides=True)
    ego = simulate(case(lead, actor("obstacle", 200.0, 0.0), speed=30.0), "ideal_braking").ego
    assert (ego.speed[1] == 30.0) == keeps


def test_who_stands_in_the_way_of_an_oncoming_vehicle_waits_until_it_has_passed():
    waited = clear_drive(at_point("oncoming_in_lane", 10, 25, 300, 0.9), "ideal_braking", DECIDED)
    assert waited.end_reason == "time_limit"
    assert waited.ego.speed[-1] == 0.0
    assert waited.actors["oncoming"].x[-1] < waited.ego.x[-1]


def test_who_has_driven_into_another_hides_it_no_longer():
    # 20 m/s: its front, 2.25 m ahead of its centre, meets the obstacle's rear, 9 - 2.25 m on, after
    # 4.5 / 20 s
    lead = actor("lead", 25.5, 20.0, 0.0, constant_lateral(0.0, 0.1, 3.5), slides=True)
    known = foresee(case(lead, actor("obstacle", 34.5, 0.0)), SimulationSettings())
    assert known[1].noticed == pytest.approx(0.225, abs=1e-6)
    assert known[1].hidden


def test_what_is_never_seen_is_never_noticed():
    lead, hidden = actor("lead", 20.0, 20.0), actor("obstacle", 40.0, 20.0)
    known = foresee(case(lead, hidden), SimulationSettings())
    assert [one.noticed for one in known] == [0.0, math.inf]


def test_sight_begins_where_an_ego_that_changes_lane_is():
    # the lead stands at x = 150 m in the lane entered and hides the obstacle until the ego is there
    lead = actor("lead", 95.5, 0.0, 3.5)
    there = case(lead, actor("obstacle", 345.5, 1.0, 5.35, brake_to_stop(4.0, 1.0)))
    ego = replace(there.ego, way=Way(3.5, 55.0, 95.0, ends=False))
    known = foresee(replace(there, ego=ego), SimulationSettings())
    assert ego.x_after(20.0 * known[1].noticed) == pytest.approx(150.0, abs=1e-6)
