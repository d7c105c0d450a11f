"""Scripted motion of one vehicle at one time is, to the last bit, what the array functions say."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sumo_eval.scenario import Brake, ConstantLateral, LaneChange
from sumo_eval.scenario.concrete import (
    braked_distance,
    braked_speed,
    braking_time,
    smooth_step,
    smooth_step_curvature,
    smooth_step_rate,
)

TIMES = st.floats(-1.0, 60.0)


@given(TIMES, st.floats(0.0, 5.0), st.floats(0.1, 10.0), st.floats(-4.0, 4.0))
def test_a_lane_change_is_the_smooth_step_to_the_last_bit(time, begin, duration, offset):
    move, share = LaneChange(begin, duration, offset), (time - begin) / duration
    assert move.lateral(time) == float(offset * smooth_step(share))
    assert move.lateral_speed(time) == float(offset / duration * smooth_step_rate(share))
    assert move.lateral_acceleration(time) == float(offset / duration**2 * smooth_step_curvature(share))


@given(TIMES, st.floats(0.0, 5.0), st.floats(0.0, 60.0), st.floats(0.1, 12.0), st.sampled_from([math.inf, 12.65, 1.0]))
def test_a_brake_is_the_braked_motion_to_the_last_bit(time, begin, speed, deceleration, jerk):
    brake, since = Brake(begin, deceleration, jerk), time - begin
    assert brake.end(speed) == begin + float(braking_time(speed, deceleration, jerk))
    assert brake.speed(speed, time) == float(braked_speed(speed, deceleration, since, jerk))
    assert brake.distance(speed, time) == speed * begin + float(braked_distance(speed, deceleration, since, jerk))


def test_a_brake_by_hand():
    # 20 m/s, 8 m/s2 risen over 1 s: 20 - 4 = 16 m/s after 1 s, and 16/8 = 2 s later it stands.
    brake = Brake(0.0, 8.0, 8.0)
    assert np.isclose(brake.speed(20.0, 1.0), 16.0)
    assert np.isclose(brake.end(20.0), 3.0)
    # 20 - 8/6 m in the rise, then 16 * 2 - 8 * 4 / 2 = 16 m
    assert np.isclose(brake.distance(20.0, 3.0), 20.0 - 8.0 / 6.0 + 16.0)


def test_a_lateral_speed_that_builds_up_by_hand():
    # 1.5 m/s at 1.5 m/s2: 1 s and 0.75 m to the right; then 2.25 m at 1.5 m/s, 1.5 s
    move = ConstantLateral(2.0, 1.5, -3.0, 1.5)
    assert np.isclose(move.duration, 2.5)
    assert [move.lateral(time) for time in (1.0, 2.5, 3.0, 4.0, 9.0)] == [-0.0, -0.1875, -0.75, -2.25, -3.0]
    assert [move.lateral_speed(time) for time in (1.9, 2.5, 3.0, 4.4, 4.5)] == [0.0, -0.75, -1.5, -1.5, 0.0]
    assert [move.lateral_acceleration(time) for time in (1.9, 2.0, 2.9, 3.0)] == [0.0, -1.5, -1.5, 0.0]
    # 0.1875 m are covered while the speed is still building up: sqrt(2 * 0.1875 / 1.5) = 0.5 s
    assert np.isclose(ConstantLateral(0.0, 1.5, 0.1875, 1.5).duration, 0.5)


def test_a_lateral_speed_that_is_there_at_once_by_hand():
    move = ConstantLateral(2.0, 1.5, 3.0)
    assert [move.lateral(time) for time in (1.0, 3.0, 9.0)] == [0.0, 1.5, 3.0]
    assert [move.lateral_speed(time) for time in (1.9, 2.0, 3.9, 4.0)] == [0.0, 1.5, 1.5, 0.0]
    assert move.lateral_acceleration(2.0) == 0.0
