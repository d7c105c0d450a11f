"""Contact: hand-worked numbers, exact instants within a step, and a brute-force twin that must
agree."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tables import values_of
from twins import contact as twin

from sumo_eval.cosim.contact import bumper_overlap, describe, struck_side
from sumo_eval.scenario.touch import TOUCH, Body, between, share_at_touch, widest_gap
from sumo_eval.trajectory import Collision

EGO = Body(0.0, 0.0, 0.0, 20.0, 4.5, 1.8)


def first_touch(*bodies):
    """Share of the step at which the bodies first touch, None when they do not."""
    share = share_at_touch(*bodies)
    return None if share < 0.0 else share


def car(x, y, heading=0.0, speed=0.0, length=4.5, width=1.8):
    return Body(x, y, heading, speed, length, width)


def moved(body, dx=0.0, dy=0.0, turn=0.0):
    return body._replace(x=body.x + dx, y=body.y + dy, heading=body.heading + turn)


# --- distance between bodies ----------------------------------------------------------------------


def test_bumper_to_bumper():
    assert widest_gap(EGO, car(10.0, 0.0))[0] == pytest.approx(5.5)  # 10 - 2.25 - 2.25
    assert widest_gap(EGO, car(4.5, 0.0))[0] == pytest.approx(0.0)
    assert widest_gap(EGO, car(4.0, 0.0))[0] == pytest.approx(-0.5)


def test_side_by_side():
    assert widest_gap(EGO, car(1.0, 3.5))[0] == pytest.approx(1.7)  # 3.5 - 0.9 - 0.9


def test_a_corner_pointing_at_a_side():
    # turned by 45 deg the other reaches (2.25 + 0.9)/sqrt(2) = 2.22739 m towards the ego: 4 - 0.9 -
    # 2.22739 = 0.87261 m
    assert widest_gap(EGO, car(0.0, 4.0, math.pi / 4))[0] == pytest.approx(0.87261, abs=1e-5)


# --- the collision, by hand -----------------------------------------------------------------------


def test_square_on_to_the_rear():
    found = describe(1.25, "lead", EGO, car(4.5, 0.0, speed=8.0))
    poses = (0.0, 0.0, 0.0), (4.5, 0.0, 0.0)
    assert found == Collision(1.25, "lead", (20.0, 0.0), (8.0, 0.0), 1.0, "front", *poses)
    assert found.relative_speed == pytest.approx(12.0)


@pytest.mark.parametrize(
    "offset, overlap",
    values_of("""
    0.0, 1.0
    0.9, 0.5
    -0.9, 0.5
    1.35, 0.25
    -1.71, 0.05
    """),
)
def test_an_offset_of_half_the_width_is_half_the_overlap(offset, overlap):
    # 1.8 m wide each: (1.8 - |offset|) / 1.8
    other = car(4.5, offset)
    assert bumper_overlap(EGO, other) == pytest.approx(overlap)
    assert struck_side(EGO, other) == "front"


def test_the_overlap_is_a_share_of_the_egos_width():
    assert bumper_overlap(EGO, car(4.0, 0.0, width=0.9)) == pytest.approx(0.5)  # 0.9 / 1.8
    assert bumper_overlap(EGO, car(4.0, 0.0, width=2.5)) == 1.0


def test_being_hit_from_the_rear():
    assert struck_side(EGO, car(-4.5, 0.0, speed=30.0)) == "rear"
    assert bumper_overlap(EGO, car(-4.5, 0.0)) == 1.0


@pytest.mark.parametrize("y, side", [(1.8, "left"), (-1.8, "right")])
def test_a_side_swipe_names_the_side_and_has_no_bumper_overlap(y, side):
    other = car(1.0, y, heading=math.copysign(0.01, -y), speed=20.0)
    assert struck_side(EGO, other) == side
    assert bumper_overlap(EGO, other) < 0.05


def test_a_crossing_car_is_hit_with_the_front():
    # it stands across the road, its side 2.25 + 0.9 = 3.15 m ahead of the ego's centre, longer than
    # the ego is wide
    found = describe(0.0, "crossing", EGO, car(3.15, 0.5, heading=math.pi / 2, speed=5.0))
    assert found.side == "front"
    assert found.overlap == 1.0
    assert found.relative_speed == pytest.approx(math.hypot(20.0, 5.0))


def test_a_rotated_corner_touching_the_left_side():
    # turned by 45 deg it reaches 2.22739 m down: its lowest corner is on the ego's left side at 0.9
    # m
    other = car(0.0, 0.9 + 2.22739, heading=math.pi / 4)
    assert widest_gap(EGO, other)[0] == pytest.approx(0.0, abs=1e-5)
    assert struck_side(EGO, other) == "left"


@pytest.mark.parametrize(
    "velocity_heading, speed, side",
    # slower car ahead; one that drops in from the left
    [(0.0, 5.0, "front"), (-math.pi / 2, 30.0, "left")],
)
def test_corner_to_corner_the_faster_closing_names_the_side(velocity_heading, speed, side):
    # a square body, so that turning it changes only where it moves; its corner sits on the ego's
    # front left corner
    other = Body(2.25 + 0.9, 0.9 + 0.9, velocity_heading, speed, 1.8, 1.8)
    assert struck_side(EGO, other) == side


# --- the instant ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "gap, closing",
    # The last jumps over a car in one step: apart before, apart after, and through it in between.
    values_of("""
    0.3, 1.0
    0.999, 1.0
    0.05, 1.5
    0.0005, 0.5
    5.5, 30.0
    """),
)
def test_the_instant_is_exact_for_constant_closing(gap, closing):
    ego_after = moved(EGO, closing)
    lead = car(4.5 + gap, 0.0)
    assert first_touch(EGO, ego_after, lead, lead) == pytest.approx(gap / closing, abs=1e-9)


def test_a_grazing_corner_that_the_samples_miss_is_found():
    # the other passes crosswise and clips the ego's front left corner for about a hundredth of the
    # step
    before, after = (
        car(2.25 + 0.9 - 2.0, 0.9 + 0.9 + 1.99, length=1.8),
        car(2.25 + 0.9 + 1.99, 0.9 + 0.9 - 2.0, length=1.8),
    )
    share = first_touch(EGO, EGO, before, after)
    assert widest_gap(EGO, before)[0] > 0.5
    assert widest_gap(EGO, after)[0] > 0.5
    # in y it comes within reach after 1.99/3.99 of the step, in x it is out of reach after 2/3.99:
    # 2/3.99 - 1.99/3.99
    assert share == pytest.approx(1.99 / 3.99, abs=1e-6)
    assert not twin.overlap(EGO, twin.pose(before, after, share + 0.0026))


def test_the_same_corner_a_centimetre_further_out_is_missed():
    before, after = (
        car(2.25 + 0.9 - 1.99, 0.9 + 0.9 + 2.0, length=1.8),
        car(2.25 + 0.9 + 2.0, 0.9 + 0.9 - 1.99, length=1.8),
    )
    assert first_touch(EGO, EGO, before, after) is None


def test_bodies_that_overlap_already_touch_at_once():
    assert first_touch(EGO, moved(EGO, 1.0), car(4.0, 0.0), car(4.0, 0.0)) == 0.0


def test_sliding_along_a_millimetre_apart_is_not_a_contact():
    beside = car(1.0, 1.801)
    assert first_touch(EGO, moved(EGO, 2.0), beside, moved(beside, -2.0)) is None
    assert (
        first_touch(EGO, moved(EGO, 2.0), car(1.0, 1.8 + 2 * TOUCH), car(-1.0, 1.8 + 2 * TOUCH))
        is None
    )


def test_between_turns_the_shorter_way_round():
    half = between(car(0, 0, math.pi - 0.1), car(0, 0, -math.pi + 0.1), 0.5)
    assert abs(math.remainder(half.heading - math.pi, math.tau)) < 1e-12


# --- laws -----------------------------------------------------------------------------------------


def random_body(rng):
    return Body(
        rng.uniform(-4, 4), rng.uniform(-4, 4), rng.uniform(-4, 4), 0.0,
        rng.uniform(3, 6), rng.uniform(1.5, 2.5),
    )  # fmt: skip


def random_pairs(seed):
    rng = random.Random(seed)
    for _ in range(300):
        a, b = random_body(rng), random_body(rng)
        shift = lambda body: moved(  # noqa: E731
            body, rng.uniform(-3, 3), rng.uniform(-3, 3), rng.uniform(-0.3, 0.3)
        )
        yield a, shift(a), b, shift(b)


def test_law_what_the_brute_force_sees_is_never_missed_and_never_later():
    seen = 0
    for pair in random_pairs(1):
        dense = twin.first_overlap(*pair)
        if dense is not None:
            seen += 1
            assert first_touch(*pair) <= dense + 1e-9
    assert seen > 100


def test_law_a_contact_is_a_contact_and_before_it_there_is_none():
    found = 0
    for a, a_after, b, b_after in random_pairs(2):
        share = first_touch(a, a_after, b, b_after)
        if share is None:
            assert twin.first_overlap(a, a_after, b, b_after, samples=60) is None
            continue
        found += 1
        assert twin.overlap(
            twin.pose(a, a_after, share), twin.pose(b, b_after, share), grow=10 * TOUCH
        )
        for index in range(20 if share > 0 else 0):
            earlier = share * index / 20
            assert not twin.overlap(twin.pose(a, a_after, earlier), twin.pose(b, b_after, earlier))
    assert found > 100


bodies = st.builds(
    Body,
    x=st.floats(-5, 5), y=st.floats(-5, 5), heading=st.floats(-3.1, 3.1), speed=st.floats(0, 40),
    length=st.floats(3, 6), width=st.floats(1.5, 2.5), across=st.floats(-3, 3),
)  # fmt: skip
shifts = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-0.3, 0.3))


@given(bodies, shifts, bodies, shifts)
def test_law_contact_is_symmetric(a, a_shift, b, b_shift):
    a_after, b_after = moved(a, *a_shift), moved(b, *b_shift)
    assert widest_gap(a, b)[0] == pytest.approx(widest_gap(b, a)[0], abs=1e-9)
    one, other = first_touch(a, a_after, b, b_after), first_touch(b, b_after, a, a_after)
    assert (one is None) == (other is None)
    if one is not None:
        assert one == pytest.approx(other, abs=1e-5)


@given(bodies, shifts, bodies, shifts, st.floats(-3, 3), st.floats(-200, 200), st.floats(-200, 200))
def test_law_moving_and_turning_the_world_moves_nothing(a, a_shift, b, b_shift, turn, dx, dy):
    def world(body):
        c, s = math.cos(turn), math.sin(turn)
        return body._replace(
            x=dx + c * body.x - s * body.y,
            y=dy + s * body.x + c * body.y,
            heading=body.heading + turn,
        )

    pair = a, moved(a, *a_shift), b, moved(b, *b_shift)
    here, there = first_touch(*pair), first_touch(*map(world, pair))
    one, other = ([between(*pair[i : i + 2], s / 50) for s in range(51)] for i in (0, 2))
    closest = min(widest_gap(*both)[0] for both in zip(one, other, strict=True))
    if abs(closest) < 1e-4:
        return  # a graze that rounding decides
    assert (here is None) == (there is None)
    if here is not None:
        assert there == pytest.approx(here, abs=1e-5)
        one = describe(0.0, "b", between(pair[0], pair[1], here), between(pair[2], pair[3], here))
        two = describe(0.0, "b", *(world(between(pair[i], pair[i + 1], here)) for i in (0, 2)))
        assert two.overlap == pytest.approx(one.overlap, abs=1e-6)
        assert two.relative_speed == pytest.approx(one.relative_speed, abs=1e-9)


@given(bodies, bodies)
def test_law_separation_is_positive_exactly_when_the_twin_sees_no_overlap(a, b):
    gap = widest_gap(a, b)[0]
    if abs(gap) > 1e-9:
        assert (gap > 0) == (not twin.overlap(a, b))
