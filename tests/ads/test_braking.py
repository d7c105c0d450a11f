"""Told levels take off, by way of the vehicle model's brakes, the speed that braking in continuous
time would."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from road_scenes import fresh

from sumo_eval.ads.braking import (
    SAFETY_BRAKING,
    first_instant,
    follow_demand,
    mean_level,
    moved,
    path_command,
    released_level,
    switched,
)
from sumo_eval.ads.r157 import Brakes
from sumo_eval.cosim.vehicle_model import drive
from sumo_eval.settings import VehicleSettings

VEHICLE = VehicleSettings()
RATE = VEHICLE.brake_jerk  # 60 m/s3
at_every_step = pytest.mark.parametrize("step", [0.01, 0.05, 0.1])


def lost(level, told):
    """Speed that the vehicle model loses from a level on when it is told levels for durations,
    m/s."""
    speed, acceleration = 40.0, -level
    for target, duration in told:
        acceleration, speed, _ = drive(speed, acceleration, -target, VEHICLE, duration)
    return 40.0 - speed


def draws(count):
    return np.random.default_rng(3).random((count, 3))


def test_a_deceleration_on_its_way_by_hand():
    # 0 to 3 m/s2 at 60 m/s3 takes 0.05 s and 0.075 m/s, then 0.05 s of 3 m/s2
    assert moved(0.0, 3.0, RATE, 0.1) == (pytest.approx(0.225), 3.0)
    assert moved(0.0, 9.0, RATE, 0.1) == (pytest.approx(0.3), pytest.approx(6.0))
    assert moved(9.0, 0.0, RATE, 0.1) == (pytest.approx(0.6), pytest.approx(3.0))


@at_every_step
def test_law_moved_is_what_the_vehicle_model_does(step):
    for level, target, _ in 9.0 * draws(50):
        assert moved(level, target, RATE, step).lost == pytest.approx(
            lost(level, [(target, step)]), abs=1e-12
        )


@at_every_step
def test_law_a_switch_within_a_step_takes_off_in_the_end_what_a_late_one_does(step):
    for level, target, wait in draws(100) * (9.0, 9.0, step):
        told = switched(level, target, wait, RATE, step)
        late = lost(level, [(level, wait), (target, 1.0 - wait)])
        assert lost(level, [(told, step), (target, 1.0 - step)]) == pytest.approx(late, abs=1e-12)


@at_every_step
def test_law_a_mean_is_reached_where_the_brakes_can(step):
    for level, share, _ in draws(100):
        level *= 9.0
        most = 0.5 * RATE * step
        mean = min(max(level + (2.0 * share - 1.0) * most, 0.0), 9.0)
        told = mean_level(level, mean, RATE, step)
        assert moved(level, told, RATE, step).lost == pytest.approx(mean * step, abs=1e-12)
    assert mean_level(0.0, 9.0, RATE, step) == pytest.approx(RATE * step)


@at_every_step
def test_law_a_release_takes_off_what_it_is_to(step):
    for level, share, _ in draws(100):
        level *= 9.0
        least, most = (
            lost(level, [(told, step), (0.0, 1.0)]) for told in (0.0, level + RATE * step)
        )
        wanted = least + share * (most - least)
        told = released_level(level, wanted, RATE, step, 99.0)
        assert lost(level, [(told, step), (0.0, 1.0)]) == pytest.approx(wanted, abs=1e-9)
    assert released_level(5.0, 0.0, RATE, step, 9.0) == 0.0
    assert released_level(5.0, 99.0, RATE, step, 5.1) == 5.1
    assert released_level(5.0, 99.0, RATE, step, 99.0) == 5.0 + RATE * step


def test_law_a_demand_that_ends_within_every_step_is_braked_for_all_the_same():
    # As one does that ends when the ego stands: 0.2 m/s2 on the mean of 40 steps are 0.4 m/s, owed
    # for a step at most.
    path = SimpleNamespace(level=0.0, brakes=0.0, owed=0.0)
    told = [
        (path_command(path, 0.01, True, Brakes(0.0, 6.0, math.inf), VEHICLE, 0.05), 0.05)
        for _ in range(40)
    ]
    assert lost(0.0, told) == pytest.approx(0.4, abs=0.01)


def test_the_instant_of_a_change_is_found():
    found = first_instant(lambda start, time: time - start, 0.0123, 0.0, 0.0, 0.05)
    assert found == pytest.approx(0.0123, abs=1e-7)


@at_every_step
@pytest.mark.parametrize("jumps_at", [0.512, 0.537, 0.561, 0.5999])
def test_a_demand_that_jumps_within_a_step_counts_from_there(step, jumps_at):
    # 4 m/s2 from 0.1 s on, 2 more from the jump on; rising at 12 m/s3 loses 4^2/24 and 2^2/24 m/s
    # of it
    brakes, speed, acceleration = fresh(SAFETY_BRAKING), 40.0, 0.0
    brakes.path.level = brakes.path.brakes = brakes.path.owed = 0.0
    for count in range(round(1.0 / step)):
        time = count * step
        told = follow_demand(
            brakes, lambda now, after: 4.0 if now + after < jumps_at else 6.0, time, time,
            Brakes(0.1, 7.0, 12.0), SimpleNamespace(vehicle=VEHICLE, step=step),
        )  # fmt: skip
        acceleration, speed, _ = drive(speed, acceleration, -told, VEHICLE, step)
    expected = 4.0 * 0.9 - 16.0 / 24.0 + 2.0 * (1.0 - jumps_at) - 4.0 / 24.0
    assert 40.0 - speed == pytest.approx(expected, abs=1e-3)
