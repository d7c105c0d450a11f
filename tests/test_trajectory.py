"""Trajectories: what is derived, what is refused, what cannot be changed; collisions and
recordings."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal, refused
from tables import rows_of

from sumo_eval.trajectory import CHANNELS, Collision, Recording, Trajectory

TIME = np.arange(0.0, 3.01, 0.1)


def test_speed_heading_and_acceleration_are_derived_from_positions():
    # 10 m/s, 2 m/s2, along a straight line at atan2(3, 4): s = 10 t + t^2
    s = 10.0 * TIME + TIME**2
    track = Trajectory(TIME, 0.8 * s, 0.6 * s)
    inner = slice(2, -2)  # central differences are exact there for a parabola
    assert track.heading == pytest.approx(math.atan2(3, 4))
    assert track.speed[inner] == pytest.approx((10.0 + 2.0 * TIME)[inner])
    assert track.acceleration[inner] == pytest.approx(2.0)
    assert np.all(np.isnan(track.steering_wheel_angle))  # not known is not zero


def test_what_is_given_is_not_derived():
    ones = np.ones_like(TIME)
    track = Trajectory(
        TIME,
        TIME,
        0 * TIME,
        heading=0.1 * ones,
        speed=7 * ones,
        acceleration=-3 * ones,
        steering_wheel_angle=ones,
    )
    assert track.heading[0] == 0.1
    assert track.speed[0] == 7.0
    assert track.acceleration[0] == -3.0
    assert track.steering_wheel_angle[0] == 1.0


def test_acceleration_is_derived_from_the_given_speed():
    track = Trajectory(TIME, TIME, 0 * TIME, speed=20.0 - 3.0 * TIME)
    assert track.acceleration == pytest.approx(-3.0)


def test_a_standing_vehicle_keeps_the_heading_it_stopped_with():
    # north for 1 s, then it stands
    track = Trajectory(TIME, 0 * TIME, np.minimum(TIME, 1.0))
    assert track.heading == pytest.approx(math.pi / 2)
    assert track.speed[-1] == 0.0


def test_a_vehicle_that_stands_at_first_has_the_heading_it_leaves_with_and_one_that_never_moves_has_0():
    y = np.maximum(TIME - 1.0, 0.0)
    assert Trajectory(TIME, 0 * TIME, y).heading == pytest.approx(math.pi / 2)
    assert np.all(Trajectory(TIME, 0 * TIME + 5.0, 0 * TIME).heading == 0.0)


def test_unevenly_sampled_motion_is_derived_with_its_own_times():
    time = np.array([0.0, 0.1, 0.2, 0.3, 0.37, 0.5, 0.9])
    track = Trajectory(time, 3.0 * time, 0 * time)
    assert track.speed == pytest.approx(3.0)
    assert track.acceleration == pytest.approx(0.0, abs=1e-9)


def test_a_single_sample_is_a_trajectory():
    track = Trajectory([2.0], [5.0], [1.0])
    assert len(track) == 1
    assert track.duration == 0.0
    assert track.speed[0] == 0.0
    assert track.heading[0] == 0.0
    assert track.acceleration[0] == 0.0


def test_length_duration_and_body():
    track = Trajectory(TIME, TIME, TIME, length=4.3, width=1.9)
    assert len(track) == 31
    assert track.length == 4.3
    assert track.width == 1.9
    assert track.duration == pytest.approx(3.0)
    assert Trajectory(TIME, TIME, TIME).length == 4.5
    assert Trajectory(TIME, TIME, TIME).width == 1.8


@pytest.mark.parametrize(
    "arguments, sentence",
    rows_of(
        """
[[], [], []] | `time` of a Trajectory must be a non-empty (n,) array, got shape (0,)
[[[0.0, 1.0]], [0, 1], [0, 1]]
| `time` of a Trajectory must be a non-empty (n,) array, got shape (1, 2)
[[0.0, 0.0], [0, 1], [0, 1]] | must be finite and strictly increasing
[[1.0, 0.0], [0, 1], [0, 1]] | must be finite and strictly increasing
[[0.0, NaN], [0, 1], [0, 1]] | must be finite and strictly increasing
[[0.0, 1.0], [0, 1, 2], [0, 1]] | `x` of a Trajectory must have the shape of `time` (2,), got (3,)
[[0.0, 1.0], [0, 1], [0, NaN]] | `y` of a Trajectory must be finite, got nan at sample 1
[[0.0, 1.0], [0, 1], [0, 1], [Infinity, 0]]
| `heading` of a Trajectory must be finite, got inf at sample 0
[[0.0, 1.0], [0, 1], [0, 1], [0, 0], [0, NaN]] | `speed` of a Trajectory must be finite
""",
        json.loads,
    ),
)
def test_what_is_not_a_trajectory_is_refused(arguments, sentence):
    with refused(sentence):
        Trajectory(*arguments)


@pytest.mark.parametrize("channel", CHANNELS)
def test_a_trajectory_cannot_be_changed(channel):
    track = Trajectory(TIME, TIME, TIME)
    with pytest.raises(ValueError, match="read-only"):
        getattr(track, channel)[0] = 1.0
    with pytest.raises(AttributeError):
        setattr(track, channel, TIME)


def test_a_trajectory_does_not_change_with_the_array_it_was_made_from():
    x = TIME.copy()
    track = Trajectory(TIME, x, TIME)
    x[0] = 99.0
    assert track.x[0] == 0.0


@given(st.floats(-3.1, 3.1), st.floats(-1000, 1000), st.floats(-1000, 1000), st.floats(1, 40))
def test_law_turning_the_world_turns_the_heading_and_keeps_the_speed(turn, dx, dy, speed):
    s = speed * TIME
    wave = np.sin(TIME)
    here = Trajectory(TIME, s, wave)
    c, k = math.cos(turn), math.sin(turn)
    there = Trajectory(TIME, dx + c * s - k * wave, dy + k * s + c * wave)
    assert there.speed == pytest.approx(here.speed, abs=1e-6)
    assert np.cos(there.heading - here.heading) == pytest.approx(math.cos(turn), abs=1e-6)


def collision(ego, other):
    return Collision(1.0, "lead", ego, other, 1.0, "front", (0.0, 0.0, 0.0), (4.5, 0.0, 0.0))


def test_the_relative_speed_is_that_of_vectors():
    assert collision((20.0, 0.0), (8.0, 0.0)).relative_speed == pytest.approx(12.0)
    # never negative
    assert collision((8.0, 0.0), (20.0, 0.0)).relative_speed == pytest.approx(12.0)
    assert collision((3.0, 0.0), (0.0, 4.0)).relative_speed == pytest.approx(5.0)


def test_a_recordings_simulated_time_is_its_last_sample():
    recording = Recording(Trajectory(TIME, TIME, TIME), {}, None, "time_limit")
    assert recording.simulated_time == pytest.approx(3.0)


def block(n):
    values = np.random.default_rng(1).normal(size=(len(CHANNELS), n))
    values[0] = np.arange(n)
    values[-1] = np.nan
    return values


def test_a_trajectory_of_one_block_is_the_one_of_its_channels():
    made = Trajectory.of_block(block(5), length=4.0, width=1.9)
    given = Trajectory(*block(5), length=4.0, width=1.9)
    assert all(getattr(made, name).tobytes() == getattr(given, name).tobytes() for name in CHANNELS)
    assert made.length == 4.0
    assert made.width == 1.9
    with pytest.raises(ValueError, match="read-only"):
        made.x[0] = 1.0


@pytest.mark.parametrize("channel, value", [(0, 7.0), (0, np.nan), (1, np.inf), (5, np.nan)])
def test_a_block_is_refused_as_its_channels_are(channel, value):
    spoiled = block(5)
    spoiled[channel, 2] = value
    with refusal() as of_channels:
        Trajectory(*spoiled)
    with refusal() as of_block:
        Trajectory.of_block(spoiled, length=4.5, width=1.8)
    assert str(of_block.value) == str(of_channels.value)


def test_an_empty_block_is_refused():
    with refusal("non-empty"):
        Trajectory.of_block(np.empty((len(CHANNELS), 0)), length=4.5, width=1.8)


@pytest.mark.parametrize("shape", [(len(CHANNELS) + 1, 3), (0, 3), (7,)])
def test_a_block_of_another_shape_is_refused(shape):
    with refusal(r"must have shape \(7, n\)"):
        Trajectory.of_block(np.empty(shape), length=4.5, width=1.8)
