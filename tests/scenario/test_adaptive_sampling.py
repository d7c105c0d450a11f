"""Points in rounds: unbiased whatever earlier rounds found, narrower than plain draws, refused
where they cannot be."""

import math

import numpy as np
import pytest
from refusals import refusal

from sumo_eval.scenario import Constraint, catalogue
from sumo_eval.scenario.sampling.adaptive import (
    capacity_of_cells,
    cells_of_round,
    size_of_next,
    spread,
)
from sumo_eval.scenario.sampling.request import Request
from sumo_eval.scenario.sampling.samples import Sample, sample
from sumo_eval.scoring.confidence.next_round import _collided_half_width, variance_in_cells
from tests.scenario.test_samplers import axis, space

BOX = space(axis("a"), axis("b"))
CUT_IN = catalogue.load("cut_in")


def corner(points):
    """1 in a corner of the box, 0 elsewhere: a set of collisions; its mean is 0.3 * 0.2 = 0.06."""
    return ((points[:, 0] < 0.3) & (points[:, 1] > 0.8)).astype(float)


def drawn_in_rounds(function, size, rounds, seed, logical=BOX):
    """All rounds, each spread by what the earlier ones found, and the function's values at their
    points."""
    counts = []
    while True:
        request = Request(count=size * rounds, round=size, rounds=tuple(counts), seed=seed)
        chosen = sample(logical, "adaptive", request=request)
        values = function(chosen.points)
        cells = cells_of_round(size)
        taken = np.bincount(chosen.stratum).reshape(-1, cells)
        if len(taken) == rounds:
            return chosen, values
        variance = variance_in_cells(values, chosen.stratum % cells, cells)
        room = capacity_of_cells(logical, size, seed) - taken.sum(axis=0)
        counts = [*(tuple(map(int, row)) for row in taken), spread(size, np.sqrt(variance), room)]


def test_the_weighted_mean_has_the_integral_as_its_expectation_and_less_variance_than_plain_points():
    means = []
    for seed in range(60):
        chosen, values = drawn_in_rounds(corner, 32, 4, seed)
        means.append(float(chosen.stands_for @ values) / len(values))
    error = np.std(means, ddof=1) / math.sqrt(len(means))
    assert abs(np.mean(means) - 0.06) < 3.0 * error
    # half of what 128 plain points have, who are binomial
    assert np.var(means) < 0.5 * 0.06 * 0.94 / 128


def test_a_pooled_mean_of_cells_would_be_biased_where_the_rounds_mean_is_not():
    """The bias of weights V_h / n_h, which the rounds' own weights do not have: rare collisions,
    few points a cell."""
    rare = lambda points: ((points[:, 0] * 7.0 % 1.0 < 0.2) & (points[:, 1] > 0.5)).astype(float)  # noqa: E731
    means, pooled = [], []
    for seed in range(60):
        chosen, values = drawn_in_rounds(rare, 16, 6, seed)
        means.append(float(chosen.stands_for @ values) / len(values))
        cell = chosen.stratum % cells_of_round(16)
        pooled.append(np.mean(np.bincount(cell, values) / np.bincount(cell)))
    truth = rare(
        np.stack(np.meshgrid(*[(np.arange(1000) + 0.5) / 1000] * 2), axis=-1).reshape(-1, 2)
    ).mean()
    assert abs(np.mean(means) - truth) < 3.0 * np.std(means, ddof=1) / math.sqrt(len(means))
    assert np.mean(pooled) < truth - 2.0 * np.std(pooled, ddof=1) / math.sqrt(len(pooled))


def test_every_round_stands_for_the_whole_space_and_every_point_is_possible():
    chosen, _ = drawn_in_rounds(
        lambda points: (points[:, 2] < 20.0).astype(float), 64, 3, 1, CUT_IN
    )
    assert len(chosen.points) == 192 == len(np.unique(chosen.points, axis=0))
    assert CUT_IN.feasible(chosen.points).all()
    assert not len(chosen.refused)
    rounds = chosen.stratum // cells_of_round(64)
    assert np.bincount(rounds, chosen.stands_for).tolist() == pytest.approx([64.0, 64.0, 64.0])
    assert np.bincount(chosen.stratum).min() >= 2
    assert np.array_equal(
        chosen.exposure, CUT_IN.exposure(CUT_IN.columns(chosen.points)) * chosen.stands_for
    )


def test_points_of_earlier_rounds_stay_where_they_are():
    first = sample(CUT_IN, "adaptive", request=Request(count=64, round=16))
    more = sample(CUT_IN, "adaptive", request=Request(count=640, round=40))
    later = sample(
        CUT_IN, "adaptive", request=Request(count=64, round=16, rounds=((4, 4, 4, 4), (8, 2, 4, 2)))
    )
    assert np.array_equal(later.points[:16], first.points)
    assert np.array_equal(later.exposure[:16], first.exposure)
    assert not np.array_equal(more.points[:16], first.points)  # other cells


def test_whole_points_are_spread_as_neyman_says_and_no_cell_gets_fewer_than_two():
    free = np.full(4, np.inf)
    # 58 / 6 = 9.67, 19.33, 29.0, and 2
    assert spread(60, np.array([1.0, 2.0, 3.0, 0.0]), free) == (10, 19, 29, 2)
    assert spread(12, np.zeros(4), free) == (3, 3, 3, 3)
    assert spread(20, np.array([1.0, 0.0, 0.0, 0.0]), np.array([5.0, 9.0, 9.0, 9.0])) == (
        5,
        5,
        5,
        5,
    )
    assert spread(99, np.ones(2), np.array([3.0, 4.0])) == (3, 4)  # all there are


def test_a_last_round_takes_what_is_too_few_for_another():
    assert [size_of_next(100, 30, done) for done in (0, 30, 60, 100)] == [30, 30, 40, 0]
    assert size_of_next(100, 30, 99) == 0


def test_a_cell_that_shows_no_difference_by_chance_is_not_given_up():
    found = variance_in_cells(np.array([0.0, 1.0, 0.0, 0.0]), np.array([0, 0, 1, 1]), 2)
    # squares 0.5 and 0; common 0.5 / (4 - 2) = 0.25; (0.5 + 0.25) / 2, (0 + 0.25) / 2
    assert found.tolist() == [0.375, 0.125]


def test_points_that_end_alike_do_not_make_the_share_that_collides_certain():
    """No collision at n points leaves open a share of 3/n. So sampling goes on up to `until`."""
    for n in (8, 64):
        even = Sample(
            np.zeros((n, 1)), np.empty((0, 1)), np.ones(n),
            stands_for=np.ones(n), stratum=np.repeat([0, 1], n // 2)
        )  # fmt: skip
        cell = np.repeat([0.0, 1.0], n // 2)
        for hit in (np.zeros(n), np.ones(n), cell):
            assert _collided_half_width(hit, even, np.arange(n)) == pytest.approx(1.5 / n)
        mixed = np.tile([0.0, 1.0], n // 2)
        assert _collided_half_width(mixed, even, np.arange(n)) == pytest.approx(
            1.96 * 0.5 / np.sqrt(n - 2), rel=1e-3
        )


@pytest.mark.parametrize(
    "request_, words",
    [
        (Request(count=7), "`count` .* must be at least 8 points, got 7"),
        (
            Request(count=100, round=4),
            "`round` .* must be from 8 to `count`, 100: at most 16 rounds, got 4",
        ),
        (Request(count=1000, round=30), "from 63 to `count`, 1000"),
        (
            Request(count=64, round=16, rounds=((1, 15),)),
            "`rounds` .* must be rows of 4 numbers, at least 2 each",
        ),
        (Request(count=64, levels=3), "`levels` .* does nothing in method `adaptive`"),
    ],
)
def test_what_makes_no_rounds_is_refused_by_a_sentence(request_, words):
    with refusal(words):
        sample(BOX, "adaptive", request=request_)


def test_keys_of_rounds_are_refused_by_other_methods_and_a_space_with_too_few_possible_points_too():
    with refusal(r"`until` .* does nothing in method `sobol`"):
        sample(BOX, "sobol", request=Request(count=8, until=1.0))
    narrow = space(
        axis("a"),
        axis("b"),
        constraints=(Constraint("a < 0.01", lambda values: values["a"] < 0.01),),
    )
    with refusal(r"`count` .* must be at most .* of its candidates are possible"):
        sample(narrow, "adaptive", request=Request(count=64))
