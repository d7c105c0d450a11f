"""What rules see of bodies on the road, and what is hidden."""

import math

import numpy as np
import pytest
from road_scenes import fresh, mover
from tables import values_of

from sumo_eval.ads.perception import (
    bumper_gap,
    carry_on,
    is_in_sight,
    is_visible,
    lateral_overlap,
    lead_in_path,
    neighbours,
    next_ahead,
)
from sumo_eval.cosim.records import BODY, MOVER
from sumo_eval.cosim.step_rules import show_body
from sumo_eval.scenario.road.reference_line import knots_of


def test_a_turned_body_is_shown_by_its_extents_and_speeds_along_and_across_the_road():
    other, body = fresh(MOVER), fresh(BODY)
    body.x, body.y, body.heading, body.speed, body.length, body.width = (
        198.0,
        2.0,
        math.radians(30.0),
        10.0,
        4.0,
        2.0,
    )
    show_body(other, body, knots_of(()), 0.0)
    assert (other.x, other.y, other.heading) == (198.0, 2.0, pytest.approx(math.radians(30.0)))
    assert (other.along, other.across) == pytest.approx((10.0 * math.cos(math.pi / 6), 5.0))
    assert other.half_length == pytest.approx(2.0 * math.cos(math.pi / 6) + 0.5)
    assert other.half_width == pytest.approx(1.0 + math.cos(math.pi / 6))
    body.x, body.y, body.heading, body.speed = 98.0, 0.0, 0.0, 20.0
    show_body(other, body, knots_of(()), 0.0)
    straight = {"x": 98.0, "y": 0.0, "heading": 0.0, "along": 20.0, "across": 0.0,
        "half_length": 2.0,
                "half_width": 1.0, "speed": 20.0, "braking": 0.0, "curvature": 0.0}  # fmt: skip
    assert vars(other) == straight


def test_gaps_run_from_bumper_to_bumper():
    me = mover("ego", 100.0)
    assert bumper_gap(me, mover("ahead", 130.0)) == pytest.approx(25.5)
    assert bumper_gap(mover("behind", 70.0), me) == pytest.approx(25.5)
    assert bumper_gap(me, mover("beside", 102.0)) < 0.0


@pytest.mark.parametrize(
    "y, half, overlap",
    values_of("""
    0.0, 0.9, 1.8
    1.0, 0.9, 0.8
    -1.0, 0.9, 0.8
    1.8, 0.9, 0.0
    3.5, 0.9, -1.7
    0.0, 0.2, 0.4
    """),
)  # fmt: skip
def test_lateral_overlap_is_the_shared_strip(y, half, overlap):
    """The ego's half width is 0.9 m; a narrow body shares no more than its own width."""
    other = mover("b", 10.0, y)._replace(half_width=half)
    assert lateral_overlap(mover("a", 0.0), other) == pytest.approx(overlap)


def test_the_lead_is_the_nearest_vehicle_in_the_strip_ahead():
    me = mover("ego", 100.0)
    behind, beside = mover("behind", 90.0), mover("beside", 110.0, 3.5)
    lead, obstacle = mover("lead", 130.0, 1.7), mover("obstacle", 160.0)
    assert lead_in_path(me, (obstacle, behind, lead, beside)) == 2
    assert lead_in_path(me, (obstacle, lead._replace(y=1.81))) == 0
    assert lead_in_path(me, (behind, beside)) == -1


def test_vehicles_ahead_come_in_order_the_nearest_first():
    me = mover("ego", 100.0)
    others = [
        mover("far", 180.0),
        mover("behind", 90.0),
        mover("near", 120.0),
        mover("abreast", 120.0, 3.5),
    ]
    found, last = [], -1
    while (last := next_ahead(me, others, last)) >= 0:
        found.append(others[last].name)
    assert found == ["near", "abreast", "far"]


@pytest.mark.parametrize(
    "lead_y, share, seen",
    values_of("""
    0.0, 0.0, False
    1.79, 0.0, False
    1.81, 0.0, True
    0.89, 0.5, False
    0.91, 0.5, True
    """),
)
def test_a_nearer_vehicle_hides_what_it_covers(lead_y, share, seen):
    lead, obstacle = mover("lead", 130.0, lead_y), mover("obstacle", 160.0)
    assert is_visible(mover("ego", 100.0), (obstacle, lead), 0, share) is seen


@pytest.mark.parametrize(
    "eye, x, y, seen",
    values_of("""
    # at 156 m the line to the child is at -4.2 m, right of the car's -3.9 to -2.1 m
    100.0, 160.0, -4.5, True
    140.0, 160.0, -4.5, False  # and here at -3.6 m
    100.0, 160.0, -3.0, False
    100.0, 160.0, -2.0, True  # at -1.87 m, left of the car
    100.0, 150.0, -3.0, True  # before the parked car
    100.0, 160.0, -0.5, True  # in the ego's way
    """),
)
def test_a_vehicle_off_the_way_is_seen_along_the_line_to_it(eye, x, y, seen):
    child = mover("child", x, y)._replace(half_width=0.1)
    assert is_in_sight(mover("ego", eye), (child, mover("parked", 156.0, -3.0)), 0, 0.5) is seen


def test_nothing_behind_the_ego_hides_what_is_ahead():
    behind, ahead = mover("behind", 80.0), mover("ahead", 160.0)
    assert [is_visible(mover("ego", 100.0), (behind, ahead), j, 0.0) for j in (0, 1)] == [
        True,
        True,
    ]


def test_neighbours_are_the_nearest_in_the_strip_and_one_beside_is_both():
    me = mover("ego", 100.0)
    far, near, rear, right = (
        mover("far", 180.0, 3.5),
        mover("near", 130.0, 3.5),
        mover("r", 60.0, 3.5),
        mover("x", 110.0),
    )
    assert neighbours(me, (far, right, near, rear), centre=3.5, width=2.2) == (2, 3)
    beside = mover("beside", 103.0, 3.5)
    assert neighbours(me, (far, beside, rear), centre=3.5, width=2.2) == (1, 1)
    assert neighbours(me, (right,), centre=3.5, width=2.2) == (-1, -1)


def test_a_vehicle_carried_on_moves_at_its_velocity():
    later = mover("a", 10.0, 1.0, along=20.0, across=-0.5)
    carry_on(later, 2.0)
    assert np.allclose((later.x, later.y, later.along), (50.0, 0.0, 20.0))
