"""Synthetic drivers side by side do what each of them does alone, to the last bit."""

from dataclasses import replace

import numpy as np
import pytest
from road_scenes import BRIEFING
from side_by_side import assert_same_commands, assert_same_recordings, points

from sumo_eval.drivers.packed_wander import PackedNoise
from sumo_eval.drivers.population import draw_population
from sumo_eval.drivers.synthetic import SyntheticDriver
from sumo_eval.drivers.wander import SmoothNoise
from sumo_eval.random_streams import random_stream
from sumo_eval.scenario import catalogue

DRIVERS = draw_population(10, seed=3)
CONCRETE = catalogue.load("front_vehicle_cut_out").concrete(ego_speed=25.0, obstacle_speed=10.0, gap=80.0)


@pytest.mark.parametrize("others", [1, 2, 5])
def test_each_command_is_the_one_a_driver_gives_alone_whatever_the_scene(others):
    # half of them with whole steps of reaction time, so that looks fall due exactly when they are made
    people = DRIVERS * 4 + tuple(replace(driver, reaction_time=0.5 + 0.1 * driver.index) for driver in DRIVERS * 4)
    plain, packed = ([SyntheticDriver(driver, CONCRETE, seed=4) for driver in people] for _ in range(2))
    together = SyntheticDriver.together(packed, BRIEFING)
    assert together is not None
    assert_same_commands(plain, together, others, seed=others, steps=100)


def test_a_subclass_which_may_decide_otherwise_has_no_packed_form():
    class Own(SyntheticDriver):
        pass

    assert Own.together([Own(DRIVERS[0], CONCRETE, seed=4)], BRIEFING) is None


@pytest.mark.parametrize(
    ("scenario", "every"),
    [("front_vehicle_cut_out", 23), ("front_vehicle_low_speed", 4), ("cut_in", 331), ("r157_cut_out", 150)],
)
def test_recordings_of_drivers_in_a_pack_are_those_of_each_alone(scenario, every):
    cases = points(scenario, every)
    assert_same_recordings(
        cases,
        lambda: [SyntheticDriver(DRIVERS[index % 10], concrete, seed=index) for index, concrete in enumerate(cases)],
    )


def test_noises_side_by_side_are_each_the_one_alone():
    noises = [SmoothNoise(random_stream(number, "noise"), 0.1 * (1 + number), 2.2) for number in range(5)]
    packed, times = PackedNoise(noises), np.linspace(-3.0, 40.0, 5)
    assert packed.value(7.3).tolist() == [noise.value(7.3) for noise in noises]
    assert np.stack(packed.at(times), axis=1).tolist() == [
        list(noise.at(time)) for noise, time in zip(noises, times.tolist(), strict=True)
    ]
    packed.keep(np.array([3, 0]))
    assert packed.value(1.0).tolist() == [noises[3].value(1.0), noises[0].value(1.0)]
