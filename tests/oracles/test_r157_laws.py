"""What must not matter: the speed itself in a cut-in, the place on the road, the side, and the
step."""

import random
from dataclasses import replace

import numpy as np
import pytest
from r157_cases import EGO_X, LANE, SETTINGS, cut_in
from tables import in_campaign

from sumo_eval.cosim import simulate, simulate_many

CONTROLLERS = ["careful_driver", "reg157"]
ONE_IN_THE_SUITE = [CONTROLLERS[0], in_campaign(CONTROLLERS[1])]
Point = tuple[float, float, float, float]


def points(seed, count):
    """Ego speed, other's speed, gap, lateral speed: m/s and m."""
    rng = random.Random(seed)
    drawn = []
    for _ in range(count):
        closing = rng.uniform(3.0, 15.0)
        other = rng.uniform(4.0, 15.0)
        drawn.append((other + closing, other, rng.uniform(1.0, 60.0), rng.uniform(0.4, 1.8)))
    return drawn


def contact(point, controller, **where):
    """Time of contact, s."""
    recording = simulate(cut_in(*point, **where), controller, SETTINGS)
    assert recording.error is None
    return None if recording.collision is None else recording.collision.time


@pytest.mark.campaign
@pytest.mark.parametrize("controller", ONE_IN_THE_SUITE)
def test_a_cut_in_depends_on_the_difference_of_the_speeds_only(controller):
    seen = set()
    for ego, other, gap, lateral in points(1, 24):
        slow, fast = (
            contact((ego, other, gap, lateral), controller),
            contact((ego + 9.0, other + 9.0, gap, lateral), controller),
        )
        assert slow == pytest.approx(fast, abs=1e-3)
        seen.add(slow is None)
    assert seen == {True, False}


@pytest.mark.parametrize("controller", [*CONTROLLERS, "fsm", "rss"])
def test_shifting_the_world_along_the_road_moves_nothing(controller):
    for point in points(2, 8):
        here = simulate(cut_in(*point), controller, SETTINGS)
        there = simulate(cut_in(*point, x=EGO_X + 137.0), controller, SETTINGS)
        shared = min(len(here.ego.x), len(there.ego.x))  # the road ends earlier for one
        assert here.ego.x[:shared] + 137.0 == pytest.approx(there.ego.x[:shared], abs=1e-6)
        assert (here.collision is None) == (there.collision is None)


@pytest.mark.parametrize(
    "slides",
    [
        in_campaign(True, id="sliding"),
        pytest.param(False, id="turning"),
    ],
)
@pytest.mark.parametrize("controller", [*CONTROLLERS, "fsm", "rss"])
def test_a_mirrored_cut_in_has_the_mirrored_result(controller, slides):
    for point in points(3, 8):
        left = simulate(cut_in(*point, slides=slides), controller, SETTINGS)
        right = simulate(cut_in(*point, side=-1.0, slides=slides), controller, SETTINGS)
        assert left.ego.x == pytest.approx(right.ego.x, abs=1e-6)
        mirrored = 2.0 * LANE - right.actors["cut_in"].y
        assert left.actors["cut_in"].y == pytest.approx(mirrored, abs=1e-6)
        if left.collision is not None and right.collision is not None:
            swapped = {"left": "right", "right": "left"}
            assert left.collision.side == swapped.get(right.collision.side, right.collision.side)
            assert left.collision.time == pytest.approx(right.collision.time, abs=1e-6)
        assert (left.collision is None) == (right.collision is None)


@pytest.mark.parametrize("controller", ONE_IN_THE_SUITE)
def test_halving_the_step_flips_under_two_per_cent(controller):
    finer = replace(SETTINGS, step=0.025)
    drawn = [cut_in(*point) for point in points(4, 100)]
    coarse, fine = (
        np.array(
            [
                recording.collision is None
                for recording in simulate_many(drawn, controller, settings)
            ]
        )
        for settings in (SETTINGS, finer)
    )
    assert 0 < coarse.sum() < len(coarse)
    assert (coarse != fine).mean() < 0.02


@pytest.mark.parametrize("controller", ONE_IN_THE_SUITE)
def test_what_halving_the_step_flips_lies_within_two_steps_of_the_boundary(controller):
    # Two steps of the closing speed are how far the gap changes meanwhile. Gaps on both sides of
    # both ends of the crash interval of one cut-in, ever closer to the coarse boundary: outcomes
    # may differ only that near.
    ego, other, lateral = 20.0, 10.0, 0.8
    two_steps = 2.0 * SETTINGS.step * (ego - other)
    finer = replace(SETTINGS, step=0.025)
    for low, high in ((8.0, 16.0), (26.0, 42.0)):  # one end of the interval in each
        safe = low < 20.0
        while high - low > 0.001:
            gap = 0.5 * (low + high)
            clear = contact((ego, other, gap, lateral), controller) is None
            low, high = (gap, high) if clear == safe else (low, gap)
        shares = 2.0 * np.linspace(-1.0, 1.0, 20) ** 3
        near = [cut_in(ego, other, low + share * two_steps, lateral) for share in shares]
        pairs = zip(
            *(simulate_many(near, controller, step) for step in (SETTINGS, finer)), strict=True
        )
        seen = set()
        for share, (coarse, fine) in zip(shares, pairs, strict=True):
            clear = coarse.collision is None
            assert clear == (fine.collision is None) or abs(share) <= 1.0
            seen.add((clear, abs(share) > 1.0))
        assert seen == {(True, True), (False, True), (True, False), (False, False)}
