"""Departure, excuse and t_i: worked numbers, and the laws of the driving task."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tables import values_of

from sumo_eval import Trajectory
from sumo_eval.method.driving_task import (
    asked_way,
    first_departure,
    is_excused,
    misses,
    roadside_contact,
    task_share,
    times_at,
)
from sumo_eval.scenario.concrete import Road, Way
from sumo_eval.scenario.road.lanes import Crossing
from sumo_eval.scenario.road.reference_line import arc

ROAD = Road("road", 400.0, 2, 3.5, 0.0)


def drive(speed, seconds, *, sideways=0.0, brakes=0.0):
    """From x = 0 on the right lane's centre line;

    brakes: m/s2, from t = 0 on;
    sideways: m/s to the left.
    """
    time = np.arange(0.0, seconds + 1e-9, 0.1)
    rolling = np.minimum(time, speed / brakes) if brakes else time
    x = speed * rolling - 0.5 * brakes * rolling**2
    speeds = np.maximum(speed - brakes * time, 0.0)
    return Trajectory(time, x, sideways * time, np.zeros(len(time)), speeds)


DRIFTS = drive(20.0, 5.0, sideways=-1.0)


def share(ego, *references, way=None, excused=False):
    asked = asked_way(0.0, references)
    assert asked is not None
    return task_share(ego, asked, way, incident=False, excused=excused)


def test_a_departure_is_the_first_corner_beyond_the_edge_and_the_margin():
    """The right edge is at y = -1.75, half the body 0.9: with 0.5 m more, a corner is out from y =
    -1.35 on."""
    found = first_departure(DRIFTS, ROAD, 0.5)
    assert found.time == pytest.approx(1.4)
    assert found.speed == 20.0
    assert first_departure(drive(20.0, 1.3, sideways=-1.0), ROAD, 0.5) is None
    assert first_departure(DRIFTS, ROAD, 5.0) is None


def test_a_road_that_crosses_is_drivable():
    crossing = Road("road", 400.0, 2, 3.5, 0.0, crossings=(Crossing(50.0, 200.0, 100.0),))
    assert first_departure(DRIFTS, crossing, 0.5) is None


@pytest.mark.parametrize("heading", [-1.0, 1.0])
def test_a_turned_body_departs_with_its_corner(heading):
    """By 3:4:5 it reaches 2.25 * 0.6 + 0.9 * 0.8 = 2.07 m aside: out from y = -0.18 or 3.68 on."""
    for sideways, time in ((-1.0, 0.2), (1.0, 3.7)):
        straight = drive(20.0, 5.0, sideways=sideways)
        ego = replace(straight, heading=np.full(51, heading * np.arcsin(0.6)))
        assert first_departure(ego, ROAD, 0.5).time == pytest.approx(time)


@pytest.mark.parametrize(
    "x, y, off",
    values_of("""
    45.5, -10, False
    45.3, -10, True
    54.5, -10, False
    54.7, -10, True
    50.0, -18.2, False
    50.0, -18.3, True
    50.0, 18.2, False
    50.0, 18.3, True
    """),
)  # fmt: skip
def test_across_a_crossing_road_its_corners_count(x, y, off):
    """Drivable within 5.5 m of x = 50 and 20.5 m of y = 0; the body is 1.8 x 4.5 m there."""
    road = replace(ROAD, crossings=(Crossing(50.0, 10.0, 20.0),))
    ego = Trajectory([0.0, 1.0], [x, x], [y, y], heading=np.full(2, np.pi / 2), speed=np.ones(2))
    assert (first_departure(ego, road, 0.5) is not None) is off


@pytest.mark.parametrize("y, off", [(4.77, False), (4.79, True), (-1.43, False), (-1.45, True)])
def test_on_a_curve_corners_are_those_of_the_map(y, off):
    """To the right with R = 30 m, corners are sqrt((30 + y +- 0.9)^2 + 2.25^2) from the centre.

    Limits are 30 + 5.75 and 30 - 2.25 m. In the frame a rectangle's corners are 0.07 m further in.
    """
    road = replace(ROAD, line=(arc(100.0, -30.0),))
    ego = Trajectory([0.0, 1.0], [50.0, 50.0], [y, y], heading=np.zeros(2), speed=np.ones(2))
    assert (first_departure(ego, road, 0.5) is not None) is off


def test_a_departure_weighs_as_a_full_width_contact_with_a_standing_car():
    contact = roadside_contact(first_departure(DRIFTS, ROAD, 0.5), 1.0)
    assert contact.relative_speed == 20.0
    assert contact.overlap == 1.0
    assert contact.side == "front"


def test_times_at_places():
    places, found = np.array([10.0, 25.0, 60.0]), drive(10.0, 5.0)
    for clock in (0.0, 7.0):
        since = times_at(replace(found, time=found.time + clock), places)
        np.testing.assert_allclose(since, [1.0, 2.5, np.inf])


def test_place_beyond_a_stop_is_reached_after_it():
    halting = Trajectory([0.0, 5.0, 64.0, 65.0, 66.0], [0.0, 49.9, 49.9, 49.9, 60.0], np.zeros(5))
    since = times_at(halting, np.array([49.0, 49.9, 50.0]))
    np.testing.assert_allclose(since, [4.91, 5.0, 65.01], atol=1e-3)


def test_a_reference_has_1_and_half_its_speed_has_a_half():
    fast, slow = drive(20.0, 10.0), drive(10.0, 20.0)
    assert share(fast, fast) == 1.0
    assert share(slow, fast) == pytest.approx(0.5)
    assert share(slow, fast, slow) == pytest.approx(1.0), "the slowest reference counts"
    assert share(fast, slow) == 1.0, "faster is no better"
    assert share(drive(0.0, 20.0), slow, excused=True) == 1.0, "no place counts"


def test_a_stop_is_0_from_there_on_unless_it_is_excused():
    """10 m/s, brakes with 1 m/s2: it stands after 50 m of the 195 m that are asked for."""
    reference, stopped = drive(10.0, 20.0), drive(10.0, 20.0, brakes=1.0)
    plain, excused = share(stopped, reference), share(stopped, reference, excused=True)
    assert plain < 49.0 / 195.0
    assert excused == pytest.approx(plain * 195.0 / 49.0, rel=0.05)
    assert excused > plain


def test_who_stands_behind_a_standing_car_is_excused():
    stopped, n = drive(10.0, 20.0, brakes=1.0), 201
    time = np.arange(n) * 0.1

    def car(x, y, speed=0.0):
        y, heading, v = np.multiply.outer([y, 0.0, speed], np.ones(n))
        return {"car": Trajectory(time, x + speed * time, y, heading, v)}

    for x, y, v, excused in values_of("""
    64.0, 0.0, 0.0, True  # fronts and rears at 50 + 2.25 and x - 2.25: 10 m at x = 64.5
    65.0, 0.0, 0.0, False
    40.0, 0.0, 0.0, False  # behind
    60.0, 5.2, 0.0, True
    60.0, 5.4, 0.0, False  # 3.6 m beside
    60.0, -5.2, 0.0, True
    60.0, -5.4, 0.0, False
    45.0, 0.0, 0.9, True  # at 10 s, when the ego stands, both are at x = 54
    43.0, 0.0, 1.1, False
    40.0, 0.0, 1.5, False  # it drives on
    """):
        assert is_excused(stopped, car(x, y, v)) is excused, (x, y, v)
    assert not is_excused(drive(10.0, 20.0), car(64.0, 0.0)), "an ego that drives needs no excuse"
    assert is_excused(drive(0.0, 20.0), car(10.0, 0.0)), "it has stood from the start"
    gone = {"car": Trajectory(time[:99], np.full(99, 60.0), np.zeros(99))}  # at 9.8 s
    assert not is_excused(stopped, gone)
    assert is_excused(replace(stopped, speed=np.zeros(n)), gone)


def test_an_incident_leaves_nothing_and_no_reference_no_share():
    asked = asked_way(0.0, [drive(10.0, 20.0)])
    assert asked is not None
    assert task_share(drive(10.0, 20.0), asked, None, incident=True, excused=False) == 0.0
    assert asked_way(0.0, []) is None


def test_a_reference_that_starts_ahead_has_t_1_and_the_way_begins_where_it_starts():
    """No reference drove the 20 m before, so they are no part of the way."""
    early = drive(20.0, 10.0)
    ahead = replace(early, x=early.x + 20.0)
    assert share(ahead, ahead) == 1.0
    assert asked_way(0.0, [ahead]).places[0] == 21.0
    assert asked_way(0.0, [ahead, early]).places[0] == 1.0


def test_behind_a_missed_lane_change_nothing_counts():
    """95 of the 195 places lie at most at x = 95, where the change should have been made."""
    reference, way = drive(10.0, 20.0), Way(3.5, 20.0, 95.0, ends=False)
    assert share(drive(10.0, 20.0), reference, way=way) == pytest.approx(95.0 / 195.0)
    assert share(drive(10.0, 20.0, sideways=0.3), reference, way=way) == 1.0
    # after 9.5 s there, y must be within 1.75 m of 3.5 m to the left of the start
    for sideways, missed in ((0.18, True), (0.19, False), (0.55, False), (0.56, True)):
        ego = drive(10.0, 20.0, sideways=sideways)
        assert misses(replace(ego, time=ego.time + 7.0, y=ego.y + 1.0), way) is missed
    assert not misses(drive(10.0, 5.0), way), "it did not come there"


@given(st.floats(2.0, 30.0), st.floats(0.0, 10.0), st.floats(3.0, 20.0))
def test_later_or_cut_off_earlier_is_not_better(speed, faster, seconds):
    reference = drive(20.0, 10.0)
    found = share(drive(speed, 20.0), reference)
    assert found <= share(drive(speed + faster, 20.0), reference) + 1e-12
    assert share(drive(speed, seconds), reference) <= found + 1e-12
