"""The smooth step over the road, and a single-track vehicle that is steered along it."""

import math
from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from refusals import refusal
from road_scenes import BRIEFING, advance, mover

from sumo_eval.ads.lane_change import (
    path_at,
    path_y,
    rear_axle_next,
    share_of_duration,
    shortest_duration,
    smooth_step,
    smooth_step_at,
    steering,
)
from sumo_eval.cosim.vehicle_model import Command, EgoState
from sumo_eval.scenario import concrete, motion

SHARES = np.linspace(-0.2, 1.2, 57)


class Path(NamedTuple):
    """What a driver remembers of its path: the smooth step by `offset` over `length` m of road,
    from `begin` on."""

    start: float
    offset: float = 0.0
    begin: float = 0.0
    length: float = 1.0


aside = partial(Path, 0.0, 3.5)


def test_the_smooth_step_is_that_of_the_scenarios():
    assert [smooth_step(s) for s in SHARES.tolist()] == pytest.approx(
        concrete.smooth_step(SHARES), abs=1e-15
    )
    assert [smooth_step_at(s)[1] for s in SHARES.tolist()] == pytest.approx(
        motion.quintic_rate(SHARES.clip(0.0, 1.0)), abs=1e-14
    )


def test_the_curvature_is_the_derivative_of_the_rate():
    step = 1e-6
    inside = SHARES[(SHARES > 0.01) & (SHARES < 0.99)]
    slope = (motion.quintic_rate(inside + step) - motion.quintic_rate(inside - step)) / (2 * step)
    assert [smooth_step_at(s)[2] for s in inside.tolist()] == pytest.approx(slope, abs=1e-7)


@pytest.mark.parametrize("done", [0.0, 0.1, 0.5, 0.6, 0.9, 1.0])
def test_share_of_duration_inverts_the_smooth_step(done):
    assert smooth_step(share_of_duration(done)) == pytest.approx(done, abs=1e-9)


def test_ten_to_ninety_percent_take_half_of_the_duration():
    assert share_of_duration(0.9) - share_of_duration(0.1) == pytest.approx(0.506, abs=1e-3)


@pytest.mark.parametrize("done", [-0.01, 1.01, math.nan])
def test_a_share_outside_0_to_1_is_refused(done):
    with refusal(r"`done` of a lane change must be within 0\.\.1"):
        share_of_duration(done)


def test_the_shortest_duration_peaks_at_the_lateral_acceleration_asked_for():
    duration = shortest_duration(3.5, 2.0)
    time = np.linspace(0.0, duration, 4001)
    lateral = np.gradient(np.gradient(3.5 * concrete.smooth_step(time / duration), time), time)
    assert np.abs(lateral[3:-3]).max() == pytest.approx(2.0, rel=1e-3)


def test_slope_and_curvature_of_a_path_are_its_derivatives():
    path = aside(100.0, 80.0)
    step = 1e-4
    for x in np.linspace(101.0, 179.0, 14).tolist():
        before, here, after = (
            SimpleNamespace(
                **dict(zip(("y", "slope", "bend"), path_at(path, x + shift), strict=True))
            )
            for shift in (-step, 0.0, step)
        )
        assert here.y == path_y(path, x)
        assert here.slope == pytest.approx((after.y - before.y) / (2 * step), abs=1e-9)
        assert here.bend == pytest.approx((after.slope - before.slope) / (2 * step), abs=1e-9)


def test_a_path_is_straight_before_and_after_its_lane_change():
    path = aside(100.0, 80.0)
    assert path_at(path, 99.0) == (0.0, 0.0, 0.0)
    assert path_at(path, 181.0) == (3.5, 0.0, 0.0)


def drive(path, speed, duration, *, y=0.0, acceleration=0.0):
    """x, y and steering wheel angle of a vehicle that starts at x = 0, y, and is steered along a
    path."""
    memory = SimpleNamespace(curvature=0.0)
    state = EgoState(0.0, y, 0.0, speed)
    rows = []
    for _ in range(round(duration / BRIEFING.step)):
        along, across = state.speed * math.cos(state.heading), state.speed * math.sin(state.heading)
        me = mover("ego", state.x, state.y, along, across)._replace(heading=state.heading)
        angle = steering(memory, me, *path_at(path, rear_axle_next(me, BRIEFING)), BRIEFING)
        state, clips = advance(state, Command(acceleration, angle), BRIEFING.vehicle, BRIEFING.step)
        assert not any(what.startswith(("steering", "lateral")) for what, _, _ in clips)
        rows.append((state.x, state.y, state.steering_wheel_angle))
    return np.array(rows).T


def off_path(path, x, y):
    return np.abs(y - [path_y(path, each) for each in x.tolist()]).max()


@pytest.mark.parametrize("duration", [3.2, 5.0, 8.0])
@pytest.mark.parametrize("speed", [10.0, 15.0, 20.0, 25.0, 30.0, 35.0])
def test_a_lane_change_is_tracked_to_5_cm_without_overshoot(speed, duration):
    path = aside(speed, duration * speed)
    x, y, _ = drive(path, speed, duration + 4.0)
    assert off_path(path, x, y) < 0.05
    assert y.max() < 3.5 + 0.01
    assert y.min() > -0.01
    assert abs(y[-1] - 3.5) < 0.005


@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_an_evasion_is_tracked_to_10_cm(speed):
    path = aside(speed, shortest_duration(3.5, 4.0) * speed)
    x, y, _ = drive(path, speed, 6.0)
    assert off_path(path, x, y) < 0.10


def test_braking_in_a_lane_change_does_not_leave_the_path():
    path = aside(10.0, 100.0)
    x, y, _ = drive(path, 25.0, 6.0, acceleration=-4.0)
    assert off_path(path, x, y) < 0.05


@pytest.mark.parametrize("speed", [2.0, 10.0, 35.0])
def test_a_vehicle_off_its_path_comes_back_without_swinging_over(speed):
    _, y, wheel = drive(Path(0.0), speed, 200.0 / speed + 8.0, y=0.5)
    assert abs(y[-1]) < 0.01
    assert y.min() > -0.05
    assert np.degrees(np.abs(wheel)).max() < 40.0


def test_straight_ahead_needs_no_steering():
    _, y, wheel = drive(Path(0.0), 20.0, 3.0)
    assert not y.any()
    assert not wheel.any()
