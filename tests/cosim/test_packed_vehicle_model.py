"""The vehicle model of a pack is the vehicle model."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_eval.cosim.packed_controller import PackedCommand
from sumo_eval.cosim.packed_vehicle_model import PackedEgos, advance_all
from sumo_eval.cosim.vehicle_model import Command, EgoState, advance
from sumo_eval.settings import VehicleSettings

N = 4000
LIMITS = VehicleSettings()


def states(rng: np.random.Generator, wild: float) -> PackedEgos:
    """Egos that drive, creep and stand, most of them nearly along the road."""
    x, y = rng.uniform(0.0, 600.0, N), rng.uniform(-1.0, 5.0, N)
    heading = np.where(rng.random(N) < 0.1, rng.uniform(-3.2, 3.2, N), rng.normal(0.0, 0.05, N))
    heading[rng.random(N) < 0.2] = 0.0
    speed = np.where(rng.random(N) < 0.3, rng.choice([0.0, 0.01, 0.3, 1.0], N), rng.uniform(0.0, 40.0, N))
    acceleration = np.where(rng.random(N) < 0.3, 0.0, wild * rng.uniform(-9.0, 4.0, N))
    acceleration[speed == 0.0] = 0.0
    steering = np.where(rng.random(N) < 0.3, 0.0, wild * rng.normal(0.0, 0.3, N))
    cosine, sine = (np.array([function(h) for h in heading.tolist()]) for function in (np.cos, np.sin))
    egos = PackedEgos(x, y, heading, speed, acceleration, steering, cosine, sine)
    for row in range(N):
        egos.put(row, egos.state(row))  # with the cosines of `math`
    return egos


def commands(rng: np.random.Generator, egos: PackedEgos, wild: float) -> PackedCommand:
    acceleration = egos.acceleration + wild * rng.normal(0.0, 3.0, N)
    acceleration[rng.random(N) < 0.3] = 0.0
    same = rng.random(N) < 0.3
    acceleration[same] = egos.acceleration[same]
    steering = egos.steering_wheel_angle + wild * rng.normal(0.0, 0.3, N)
    steering[rng.random(N) < 0.3] = 0.0
    return PackedCommand(acceleration, steering)


@pytest.mark.parametrize("limits", [LIMITS, replace(LIMITS, friction=0.3, max_speed=30.0)], ids=["dry", "slippery"])
@pytest.mark.parametrize(("wild", "step"), [(0.03, 0.05), (0.3, 0.05), (1.0, 0.1)])
def test_where_no_limit_is_met_the_vectorised_model_gives_the_bits_of_the_scalar_one(wild, step, limits):
    rng = np.random.default_rng(7)
    egos = states(rng, wild)
    command = commands(rng, egos, wild)
    with np.errstate(all="ignore"):
        after, exceptional = advance_all(egos, command, limits, step)
    for row in range(N):
        wanted = Command(float(command.acceleration[row]), float(command.steering[row]))
        expected, clips = advance(egos.state(row), wanted, limits, step)
        if not exceptional[row]:
            assert not clips
            assert after.state(row) == expected
            assert str(after.state(row)) == str(expected)  # signs of zeros, too
            put = PackedEgos(*(channel[row : row + 1].copy() for channel in after))
            put.put(0, expected)
            assert (put.cosine[0], put.sine[0]) == (after.cosine[row], after.sine[row])
    if wild < 0.1 and limits is LIMITS:
        assert exceptional.mean() < 0.02  # what is ordinary is not left to the scalar model


def test_a_command_that_is_no_number_is_exceptional():
    rng = np.random.default_rng(8)
    egos = states(rng, 0.1)
    for bad in (np.nan, np.inf, -np.inf):
        for command in (PackedCommand(np.full(N, bad), np.zeros(N)), PackedCommand(np.zeros(N), np.full(N, bad))):
            with np.errstate(all="ignore"):
                assert advance_all(egos, command, LIMITS, 0.05)[1].all()


def test_a_state_is_put_and_taken_back():
    egos = states(np.random.default_rng(9), 0.1)
    state = EgoState(1.0, 2.0, 0.5, 10.0, -1.0, 0.1)
    egos.put(3, state)
    assert egos.state(3) == state
