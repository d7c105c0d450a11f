"""Conflicts of ways: the time to collision on them against closed forms, and the area, time to it
and PET by hand."""

from dataclasses import replace

import numpy as np
import pytest
from road_scenes import scenario_of
from tables import values_of

from sumo_eval.method.conflict import (
    conflict_at,
    conflict_criticality,
    conflicting,
    crossing_conflict,
)
from sumo_eval.method.criticality import ideal_impact_speed, max_inverse_ttc
from sumo_eval.method.point_criticality import criticality
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.logical import Approach
from sumo_eval.settings import ZoneSettings

SIZE = (4.5, 1.8)
ZONES = ZoneSettings()  # ideal braking with 5 m/s2
RAMP = "lanes = 3, lane = [{ lane = 0, end = 500.0, ramp_until = 120.0 }]"
CROSSED = "lanes = 2, crossing = [{ x = 300.0 }]"
MERGES = 'speed = "v", goal_lane = 1, change_from = 120.0'


def scene(speed, other, second="", road=CROSSED, ego='speed = "v"'):
    """The ego at x = 50 m; bodies are 4.5 x 1.8 m; keys as in a scenario file."""
    return scenario_of(f"""
name = "t"
parameter = [{{ name = "v", low = 1.0, high = 50.0, step = 1.0, unit = "m/s" }}]
zone = {{ obstacle = "other", conflict = true }}
vehicle = [{{ name = "other", {other} }}, {second}]
road = {{ length = 2000.0, {road} }}
ego = {{ {ego} }}
""").concrete(v=speed)  # fmt: skip


def critical(concrete, delay=0.0):
    found = conflict_criticality([concrete], 0, [delay], SIZE, ZONES)
    return tuple(float(it[0]) for it in found)


@pytest.mark.parametrize(
    "speed, lead, gap, delay",
    values_of("""
    20.0, 0.0, 60.0, 0.0
    20.0, 10.0, 20.0, 0.0
    20.0, 10.0, 30.0, 1.0
    15.0, 5.0, 40.0, 1.0
    """),
)
def test_law_behind_a_vehicle_in_the_lane_it_is_the_closed_form(speed, lead, gap, delay):
    concrete = scene(speed, f"speed = {lead}, gap = {gap}")
    wanted = max_inverse_ttc(speed, lead, gap, deceleration=5.0, delay=delay)
    assert critical(concrete, delay)[0] == pytest.approx(wanted, rel=1e-2)


def test_law_ideal_braking_that_hits_hits_as_the_closed_form_says():
    inverse, impact, _ = critical(scene(20.0, "speed = 0.0, gap = 30.0"))
    assert inverse == np.inf
    # sqrt(400 - 2 * 5 * 30) = 10 m/s; found at most one look of 0.1 s (0.5 m/s) late
    assert impact == pytest.approx(ideal_impact_speed(20.0, 0.0, 30.0, deceleration=5.0), abs=0.51)


@pytest.mark.parametrize("apart", [1.6e-3, -1.6e-3])
def test_law_between_two_looks_the_ego_brakes_as_it_does_at_them(apart):
    # At 1.05 s its rear is at 47.75 + 20 * 1.05 - 2.5 * 1.05^2 = 65.99375 m, and `apart` m beyond
    # the side of a vehicle whose front then comes into the strip: -13.65 + 10 * 1.05 + 2.25 = -0.9.
    x = 65.99375 - 0.9 - apart
    second = f'{{ name = "second", speed = 10.0, heading = 90.0, x = {x}, y = -13.65 }}'
    both = scene(20.0, "speed = 0.0, gap = 60.0", second)
    assert np.isinf(critical(both)[0]) == (apart < 0.0)


@pytest.mark.parametrize("leaves", [2.3, 2.6, 4.0])
def test_law_a_crossing_vehicle_counts_as_long_as_the_ego_would_find_it_in_its_way(leaves):
    # It is in the strip (2.25 + 0.9 m to both sides) from 1 s until `leaves`; the ego's front is 20
    # m from its side.
    across = 6.3 / (leaves - 1.0)
    x, y = 50.0 + 2.25 + 20.0 + 0.9, -3.15 - across
    concrete = scene(10.0, f"speed = {across}, heading = 90.0, x = {x}, y = {y}")
    t = np.linspace(0.0, 2.5, 250_001)
    v = 10.0 - 5.0 * np.clip(t - 0.5, 0.0, 2.0)
    d = 20.0 - 10.0 * np.minimum(t, 0.5) - 0.5 * np.clip(t - 0.5, 0.0, 2.0) * (10.0 + v)
    counts = (t + d / np.maximum(v, 1e-9) < leaves) & (v > 0.0)
    assert critical(concrete, 0.5)[0] == pytest.approx(float((v / d)[counts].max()), rel=0.05)
    if leaves == 4.0:  # it is there all the time: the closed form for a standing vehicle
        assert critical(concrete, 0.5)[0] == pytest.approx(
            max_inverse_ttc(10.0, 0.0, 20.0, deceleration=5.0, delay=0.5), rel=1e-2
        )


@pytest.mark.parametrize(
    "name, point, hits",
    values_of("""
    "crossing_path", [21.3, 12.1, -0.2], True  # corners meet for less than 0.1 s
    "turn_across_path", [6.9, 3.0, -0.2], False  # only rectangles around the bodies meet
    "ramp_merge", [26.9, 33.4, -32.7, 1.4], True  # the ego's corner, turned to its new lane
    """),
)
def test_law_bodies_touch_as_they_lie_also_between_two_looks(name, point, hits):
    assert np.isinf(criticality(catalogue.load(name), np.array([point]), ZONES).inverse[0]) == hits


def test_without_a_meeting_there_is_no_conflict():
    assert critical(scene(20.0, "speed = 5.0, heading = 90.0, x = 75.0, y = -20.0"))[0] == 0.0


def test_law_a_merge_behind_a_slower_vehicle_is_the_approach_to_it():
    # 25 m/s against 15 m/s and 50 m: they would touch after 5 s, at x = 175 m, when the change
    # (120..220 m) has brought the ego's side over the other's; from the ramp it is the closed form
    # of a vehicle in the own lane.
    slower = "speed = 15.0, gap = 50.0, y = 3.5"
    assert critical(scene(25.0, slower, road=RAMP, ego=MERGES))[0] == pytest.approx(
        max_inverse_ttc(25.0, 15.0, 50.0, deceleration=5.0), rel=1e-2
    )
    # which stays on the ramp's lane
    assert critical(scene(25.0, slower, road=RAMP))[0] == 0.0


def test_the_area_the_time_to_it_and_the_pet_of_a_crossing_by_hand():
    # The other's side is at x = 99.1..100.9 m. In the ego's strip from y = -3.15 to 3.15 m: 2.1 m/s
    # from y = -10 m on.
    crossing = "speed = 2.1, heading = 90.0, x = 100.0, y = -10.0"
    found = crossing_conflict(scene(10.0, crossing), 0, SIZE)
    assert (found.begin, found.end) == pytest.approx((99.1, 100.9))
    assert (found.enters, found.leaves) == pytest.approx((6.85 / 2.1, 13.15 / 2.1))
    assert found.time_to == pytest.approx((99.1 - 52.25) / 10.0)
    # both at once: from 4.685 s on, while it is there from 3.262 s to 6.262 s
    assert found.pet == 0.0
    sooner = crossing_conflict(scene(30.0, crossing), 0, SIZE)
    # the ego's rear leaves at (100.9 + 2.25 - 50) / 30 = 1.772 s
    assert sooner.pet == pytest.approx(6.85 / 2.1 - 53.15 / 30.0)
    later = crossing_conflict(scene(5.0, crossing), 0, SIZE)
    assert later.pet == pytest.approx(46.85 / 5.0 - 13.15 / 2.1)
    away = crossing_conflict(scene(5.0, "speed = 2.1, x = 100.0, y = 3.5"), 0, SIZE)
    assert np.isnan(away.pet)
    # the ego stands in the area
    crossing = 'speed = "v", heading = 90.0, x = 50.0, y = -10.0'
    stands = scene(2.1, crossing, ego="speed = 0.0")
    assert crossing_conflict(stands, 0, SIZE).pet == 0.0


def test_the_pet_of_ways_that_join_is_that_at_the_place_where_they_do():
    # The other drives in lane 1, its rear at p = `begin` when its body comes into the ego's strip.
    # It is 50 m ahead at 25 m/s, the ego is at 20 m/s: the other's rear leaves p first, the ego's
    # front is there at (p - 52.25) / 20.
    concrete = scene(20.0, "speed = 25.0, gap = 50.0, y = 3.5", road=RAMP, ego=MERGES)
    found = crossing_conflict(concrete, 0, SIZE)
    rear = 50.0 + 2.25 + 50.0  # at the start
    assert np.isinf(found.leaves)
    assert found.enters == pytest.approx((found.begin - rear) / 25.0, abs=0.1)
    assert found.time_to == pytest.approx((found.begin - 52.25) / 20.0)
    assert found.pet == pytest.approx(found.time_to - found.enters)
    # From 100 m behind at 25 m/s: the ego's rear leaves p at (p + 2.25 - 50) / 20, the other's
    # front comes later.
    behind = scene(20.0, "speed = 25.0, gap_behind = 100.0, y = 3.5", road=RAMP, ego=MERGES)
    later = crossing_conflict(behind, 0, SIZE)
    front = 50.0 - 2.25 - 100.0
    assert later.pet == pytest.approx(
        (later.begin - front) / 25.0 - (later.begin - 47.75) / 20.0, abs=0.1
    )


def test_whose_way_conflicts_is_the_obstacle_of_a_conflict_or_who_crosses():
    for name, expected in values_of("""
    "crossing_path", 0
    "pedestrian_crossing", 0
    "swerving_lead", None
    "cut_in", None
    """):
        logical = catalogue.load(name)
        point = dict(zip(logical.names, [one.low for one in logical.parameters], strict=True))
        assert conflicting(logical, logical.placed(point)) == expected, name
        assert (conflict_at(logical, point) is None) == (expected is None), name


@pytest.mark.parametrize("name", ["lane_drop_cut", "leaving_traffic"])
def test_criticality_does_not_depend_on_the_points_beside(name):
    logical = catalogue.load(name)
    points = logical.from_unit(np.random.default_rng(3).random((40, len(logical.parameters))))
    points = points[logical.feasible(points)]
    alone = [criticality(logical, point[None], ZONES) for point in points]
    np.testing.assert_array_equal(criticality(logical, points, ZONES), np.concatenate(alone, 1))


def test_law_a_point_does_not_depend_on_its_batch():
    """Of an obstacle that keeps its speed the criticality is exact, also beside one that brakes."""
    logical = replace(
        catalogue.load("front_vehicle_cut_out"),
        approach=lambda at: Approach(
            at["ego_speed"], at["obstacle_speed"], at["gap"], 0.5, 0.2 * (at["gap"] > 35.0)
        ),
    )
    points = np.array([[20.0, 10.0, 30.0], [20.0, 10.0, 40.0]])
    together = criticality(logical, points, ZONES)
    for number, point in enumerate(points):
        alone = criticality(logical, point[None], ZONES)
        assert [values[number] for values in together] == [values[0] for values in alone]
