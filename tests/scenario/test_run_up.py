"""The lateral run-up of a cut-in: `cut_in?lateral_acceleration=1.5`, and `acceleration` of
`move_sideways`."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal
from road_scenes import drawn_points
from scenario.test_scenario_file import EXAMPLE

from sumo_eval.method.point_criticality import exact_target
from sumo_eval.scenario import catalogue, constant_lateral, motion
from sumo_eval.scenario.file import read_scenario
from sumo_eval.settings import ZoneSettings

SPEEDS, OFFSETS, BUILD_UPS = st.floats(0.2, 3.0), st.floats(0.1, 6.0), st.floats(0.3, 20.0)
SIDES = st.sampled_from([1.0, -1.0])
PLAIN = catalogue.load("cut_in")


def with_run_up(acceleration):
    return catalogue.load(f"cut_in?lateral_acceleration={acceleration!r}")


# --- a move whose speed builds up -----------------------------------------------------------------


def test_a_run_up_by_hand():
    # 1.5 m/s2 to 3 m/s: 2 s, 3 m. The other 4 m take 4/3 s.
    move = constant_lateral(begin=1.0, speed=3.0, offset=-7.0, acceleration=1.5)
    assert move.duration == pytest.approx(2.0 + 4.0 / 3.0)
    assert [motion.lateral_motion(move, t)[0] for t in (0.5, 2.0, 3.0, 4.0, 9.0)] == pytest.approx(
        [0.0, -0.75, -3.0, -6.0, -7.0]
    )
    assert [motion.lateral_motion(move, t)[1] for t in (0.5, 2.0, 3.0, 4.0, 4.5)] == pytest.approx(
        [0.0, -1.5, -3.0, -3.0, 0.0]
    )
    assert [motion.lateral_motion(move, t)[2] for t in (0.5, 1.0, 2.9, 3.1)] == [
        0.0,
        -1.5,
        -1.5,
        0.0,
    ]


@given(SPEEDS, OFFSETS, BUILD_UPS, SIDES)
def test_law_the_way_is_the_integral_of_the_speed_and_the_speed_of_the_acceleration(
    speed, offset, build_up, side
):
    move = constant_lateral(0.0, speed, side * offset, build_up)
    for end in (0.3, 0.7, 0.99):
        middles = (np.arange(2000) + 0.5) / 2000 * end * move.duration
        step = end * move.duration / 2000
        driven = step * sum(motion.lateral_motion(move, time)[1] for time in middles)
        gained = step * sum(motion.lateral_motion(move, time)[2] for time in middles)
        assert driven == pytest.approx(
            motion.lateral_motion(move, end * move.duration)[0], abs=speed * step
        ), "the midpoint rule misses a kink by that"
        assert gained == pytest.approx(
            motion.lateral_motion(move, end * move.duration)[1], abs=build_up * step
        )
    assert motion.lateral_motion(move, move.duration)[0] == pytest.approx(side * offset)


@given(st.floats(0.0, 30.0), SPEEDS, OFFSETS, BUILD_UPS)
def test_law_the_run_up_makes_a_move_late_by_half_its_duration(time, speed, offset, build_up):
    """Once the speed is reached, a move is where the one without a run-up was v / 2a s before."""
    plain, move = (
        constant_lateral(0.0, speed, offset),
        constant_lateral(0.0, speed, offset, build_up),
    )
    rise = speed / build_up
    if time >= rise and 0.5 * speed * rise <= offset:
        assert motion.lateral_motion(move, time)[0] == pytest.approx(
            motion.lateral_motion(plain, time - 0.5 * speed / build_up)[0], abs=1e-9
        )
    assert motion.lateral_motion(move, time)[0] <= motion.lateral_motion(plain, time)[0]


# --- cut_in ---------------------------------------------------------------------------------------


def test_gap_and_distance_across_are_those_when_the_lateral_speed_is_reached():
    # 3 m/s at 1.5 m/s2: 2 s and 3 m; at 10 m/s of closing speed the gap was 20 m larger
    concrete = with_run_up(1.5).concrete(
        ego_speed=30.0, cut_in_speed=20.0, gap=40.0, lateral_speed=3.0
    )
    (other,) = concrete.actors
    assert other.y(0.0) == pytest.approx(6.5)
    assert (other.y(2.0), other.lateral_speed(2.0)) == pytest.approx((3.5, -3.0))
    assert other.x(2.0) - (concrete.ego.x + 60.0) - 4.3 == pytest.approx(40.0)
    assert other.y(2.0 + 1.6 / 3.0) - 1.9 == pytest.approx(0.0), "the bodies begin to overlap"
    assert (other.y(2.0 + 3.5 / 3.0), other.lateral_speed(9.0)) == pytest.approx((0.0, 0.0))


def test_the_zone_of_a_point_is_that_without_the_run_up():
    """Ideal braking begins with the overlap, until which both drive on as they were."""
    drawn = drawn_points(PLAIN, 300, 3)
    for acceleration in (0.5, 1.5, 20.0):
        plain, run_up = (
            exact_target(each, drawn, ZoneSettings()) for each in (PLAIN, with_run_up(acceleration))
        )
        assert 0 < (plain <= 0.0).sum() < len(plain)
        np.testing.assert_allclose(run_up, plain, atol=1e-6)


def test_law_the_faster_the_run_up_the_nearer_it_is_to_none():
    """The run-up lasts v/a and the other is v^2 / 2a further to the left: both go to 0 with 1/a."""
    for row in drawn_points(PLAIN, 30, 4):
        values = dict(zip(PLAIN.names, row, strict=True))
        (plain,) = PLAIN.concrete(**values).actors
        for acceleration in (10.0, 1e3, 1e6):
            (other,) = with_run_up(acceleration).concrete(**values).actors
            speed, rise = values["lateral_speed"], values["lateral_speed"] / acceleration
            for time in (0.0, 0.4, 1.0, 3.0):
                assert abs(other.y(time + rise) - plain.y(time)) <= 1e-9 + (
                    0.5 * speed * rise if time == 0.0 else 0.0
                )
                assert abs(other.y(time) - plain.y(time)) <= 1e-9 + speed * rise


# --- a scenario of one's own ----------------------------------------------------------------------


def own(tmp_path, acceleration):
    move = f'{{ do = "move_sideways", begin = 1.0, speed = 2.0, offset = 3.5{acceleration} }}'
    old = '{ do = "brake", begin = 1.0, deceleration = 4.0 }'
    assert old in EXAMPLE
    (tmp_path / "s.toml").write_text(EXAMPLE.replace(old, move))
    return (
        read_scenario(tmp_path / "s.toml")
        .concrete(ego_speed=20.0, truck_speed=10.0)
        .actors[0]
        .lateral_moves
    )


def test_move_sideways_has_the_acceleration_of_the_file(tmp_path):
    assert own(tmp_path, ', acceleration = "truck_speed / 8.0"') == (
        constant_lateral(1.0, 2.0, 3.5, 1.25),
    )
    assert own(tmp_path, "") == (constant_lateral(1.0, 2.0, 3.5, math.inf),)


def test_move_sideways_without_an_acceleration_above_0_is_refused(tmp_path):
    with refusal(r"`acceleration`.* must be greater than 0 m/s2, got 0"):
        own(tmp_path, ", acceleration = 0.0")
