"""Named random streams, and a noise that can be driven."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refusal

from sumo_eval.drivers.synthetic.wander import noise_at, random_waves
from sumo_eval.settings.random_streams import random_stream


def test_a_stream_is_the_same_everywhere_and_for_ever():
    assert random_stream(1, "population", 0).integers(0, 2**63) == 7500556233804648741


def test_streams_of_different_seeds_or_names_differ():
    names = [(0, "a"), (1, "a"), (1, "b"), (1, "a", 0), (1, "a", "0"), (1, "a", 1), (1, "a0")]
    assert len({random_stream(*name).integers(0, 2**63) for name in names}) == len(names)


@pytest.mark.parametrize("seed", [-1, 1.0, "1", None, True])
def test_a_seed_is_a_whole_number(seed):
    with refusal("`seed` of a random stream must be a whole number of at least 0"):
        random_stream(seed, "a")


def value(waves, time):
    return noise_at(waves, 0.25, time)[0]


def at(waves, time):
    found = noise_at(waves, 0.25, time)
    return SimpleNamespace(**dict(zip(("value", "rate", "bend"), found, strict=True)))


def ensemble(time):
    return np.array(
        [value(random_waves(random_stream(number, "noise"), 2.2), time) for number in range(4000)]
    )


def test_the_noise_has_its_deviation_at_any_time_and_its_correlation():
    start, later, apart = ensemble(0.0), ensemble(2.2), ensemble(8.8)
    for values in (start, later, apart):
        assert values.mean() == pytest.approx(0.0, abs=0.02)
        assert values.std() == pytest.approx(0.25, rel=0.05)
    assert np.corrcoef(start, later)[0, 1] == pytest.approx(math.exp(-0.5), abs=0.04)
    assert np.corrcoef(start, apart)[0, 1] == pytest.approx(0.0, abs=0.05)


def test_rate_and_curvature_of_the_noise_are_its_derivatives():
    waves = random_waves(random_stream(5, "noise"), 2.2)
    step = 1e-4
    for time in (0.0, 3.7, 41.0):
        before, here, after = (at(waves, time + shift) for shift in (-step, 0.0, step))
        assert here.value == pytest.approx(value(waves, time), abs=1e-15)
        assert here.rate == pytest.approx((after.value - before.value) / (2 * step), abs=1e-7)
        assert here.bend == pytest.approx((after.rate - before.rate) / (2 * step), abs=1e-7)
