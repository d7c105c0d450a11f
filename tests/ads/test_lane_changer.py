"""The ADS `lane_changer` in SUMO."""

from dataclasses import replace

import numpy as np
import pytest
from road_scenes import (
    ROAD,
    actor,
    at_values,
    case,
    clear_drive,
    drawn_cases,
    low_speed,
    safe_cut_outs,
)

from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.scenario import Actor, Start
from sumo_eval.scenario.road.lanes import LaneSpan


def onset(recording):
    """Time at which the lane change shows, s."""
    ego = recording.ego
    return float(ego.time[np.argmax(ego.y > 0.05)])


@pytest.mark.parametrize("concrete", low_speed(), ids=lambda c: c.label)
def test_it_overtakes_a_slower_vehicle_smoothly_and_stays_left(concrete):
    recording = clear_drive(concrete, "lane_changer")
    ego, lead = recording.ego, recording.actors["lead"]
    assert recording.end_reason == "road_end"
    assert ego.speed == pytest.approx(concrete.ego.speed, abs=0.05)
    assert abs(ego.y[-1] - 3.5) < 0.02
    assert np.diff(ego.y).min() > -1e-3
    assert ego.y.max() < 3.52
    assert np.abs(np.gradient(np.gradient(ego.y, ego.time), ego.time)).max() < 2.1
    assert np.all(ego.y[np.abs(ego.x - lead.x) < 4.5] > 1.9)


def test_it_begins_at_ten_seconds_to_collision():
    recording = simulate(case(actor("lead", 150.0, 20.0), speed=30.0), "lane_changer")
    assert 5.0 < onset(recording) < 6.5
    assert recording.ego.speed == pytest.approx(30.0)


@pytest.mark.parametrize("exit_from, changes", [(200.0, False), (400.0, True)])
def test_it_does_not_cross_the_line_of_an_exit(exit_from, changes):
    road = replace(ROAD, spans=(LaneSpan(0, parted_from=exit_from),))
    concrete = replace(case(actor("lead", 60.0, 10.0), speed=25.0), road=road)
    assert (simulate(concrete, "lane_changer").ego.y[-1] > 1.75) == changes


@pytest.mark.parametrize("speed, headway, lead_braking", [(7.5, 0.5, 9.81), (15.0, 2.0, 3.81)])
def test_it_does_not_creep_once_it_stands(speed, headway, lead_braking):
    ego = simulate(
        at_values(
            "front_vehicle_braking",
            ego_speed=speed, headway=headway, lead_deceleration=lead_braking,
        ),
        "lane_changer",
    ).ego  # fmt: skip
    assert ego.speed[-1] == 0.0
    assert np.diff(ego.speed[ego.speed < 0.05]).max() <= 0.0


def test_it_does_not_react_to_the_lead_that_leaves_its_lane():
    (concrete,) = [
        c for c in safe_cut_outs(1) if c.label == "ego_speed=25, obstacle_speed=20, gap=60"
    ]
    recording = simulate(concrete, "lane_changer")
    assert recording.ego.acceleration.min() > -0.2
    assert onset(recording) > 1.0


@pytest.mark.parametrize(
    "blocker",
    [
        Actor("beside", Start(48.0, 3.5, 25.0)),
        actor("just_ahead", 8.0, 25.0, y=3.5),
        Actor("just_behind", Start(30.0, 3.5, 25.0)),
    ],
    ids=lambda a: a.name,
)
def test_behind_a_blocked_left_lane_it_follows(blocker):
    recording = clear_drive(case(actor("lead", 60.0, 15.0), blocker, speed=25.0), "lane_changer")
    behind_lead = recording.ego.time < 2.0
    assert np.abs(recording.ego.y[behind_lead]).max() < 0.01
    assert recording.ego.acceleration[behind_lead].min() < -1.0


def test_once_the_left_lane_is_free_it_overtakes_after_all():
    blocker = Actor("passing", Start(40.0, 3.5, 28.0))
    recording = simulate(case(actor("lead", 60.0, 15.0), blocker, speed=25.0), "lane_changer")
    ego = recording.ego
    assert recording.end_reason == "road_end"
    assert abs(ego.y[-1] - 3.5) < 0.02
    assert ego.speed.min() < 24.0
    assert ego.speed[-1] > ego.speed.min() + 1.0
    assert ego.x[-1] >= ROAD.length


def collisions(name, points):
    cases = drawn_cases(name, points, 5)
    return sum(
        recording.collision is not None for recording in simulate_many(cases, "lane_changer")
    )


def test_it_leaves_oncoming_and_following_vehicles_their_room():
    # Of these 30 points each `no_reaction` hits the oncoming vehicle in 7.
    assert collisions("oncoming_in_lane", 30) == 0
    assert collisions("lane_change_rear", 30) == 0
