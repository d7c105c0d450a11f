"""Which points a replicate holds: lists that may stand for each other, draws from them, and their
balance."""

import math
import tracemalloc

import numpy as np
import pytest

from sumo_eval.scoring.confidence import resamples as drawing
from sumo_eval.scoring.confidence.resamples import (
    Balance,
    Strata,
    draw_counts,
    of_one_number,
    one_list,
    resamples,
    same_sizes,
    strata,
)
from sumo_eval.settings.random_streams import random_stream


def lists(groups):
    """The lists of strata."""
    return np.split(groups.order, groups.ends[:-1])


def halves(rows, unit):
    """The rule of `strata`, said plainly."""
    if len(rows) < 4:
        return [rows.tolist()]
    axis = int(np.argmax(np.ptp(unit[rows], axis=0)))
    order = rows[np.argsort(unit[rows, axis], kind="stable")]
    return [*halves(order[: len(rows) // 2], unit), *halves(order[len(rows) // 2 :], unit)]


@pytest.mark.parametrize("n", [1, 3, 4, 5, 31, 200, 1001])
def test_law_strata_are_the_halves_of_halves_in_their_order(n):
    unit = np.round(np.random.default_rng(n).random((n, 3)), 1)  # with equal places
    groups, plain = strata(unit, "sobol"), halves(np.arange(n), unit)
    assert [group.tolist() for group in lists(groups)] == plain
    for size, same in same_sizes(groups):
        assert same.tolist() == [group for group in plain if len(group) == size]
    numbers = np.floor(unit[:, 0] * 3)
    assert [group.tolist() for group in lists(of_one_number(numbers))] == [
        np.flatnonzero(numbers == one).tolist() for one in np.unique(numbers)
    ]


def test_law_strata_hold_two_numbers_a_point():
    n = 20_000
    unit = np.random.default_rng(1).random((n, 4))
    tracemalloc.start()
    try:
        groups = strata(unit, "sobol")
        held = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert len(groups.ends) > n / 3
    assert held < 16 * n + 10_000, "bytes"


def test_points_of_an_even_sample_stand_only_for_their_neighbours():
    unit = np.column_stack([np.repeat(np.arange(8) / 8, 4), np.tile(np.arange(4) / 4, 8)])
    groups = strata(unit, "grid")
    assert sorted(groups.order.tolist()) == list(range(32))
    assert set(groups.sizes.tolist()) == {2}
    assert max(float(np.ptp(unit[group], axis=0).max()) for group in lists(groups)) <= 0.25
    assert [group.tolist() for group in lists(strata(unit, "latin_hypercube"))] == [list(range(32))]


def test_each_replicate_holds_as_many_points_of_every_group_as_the_group_has():
    groups = Strata(np.array([0, 3, 1, 2, 4, 5]), np.array([2, 5, 6]))
    counts = draw_counts(groups, 4_000, np.random.default_rng(1))
    for group in lists(groups):
        assert counts[:, group].sum(axis=1) == pytest.approx(np.full(4_000, len(group)))
    # Of two, one is drawn and counts twice: the mean (a + b)/2 becomes a or b, with the variance (a
    # - b)^2 / 4, which is s^2 / 2 = ((a - b)^2 / 2) / 2
    assert set(np.unique(counts[:, [0, 3]])) == {0.0, 2.0}
    assert np.var(counts[:, [0, 3]] @ np.array([1.0, 5.0]) / 2.0) == pytest.approx(4.0, rel=0.05)
    assert np.all(counts[:, 5] == 1.0)


def balanced(counts, groups, unit):
    balance, everywhere = Balance.of(groups, unit), np.arange(len(unit))
    return (
        None
        if balance is None
        else balance.balanced(counts, everywhere, balance.along(counts, everywhere))
    )


def even_sample(n=64):
    unit = np.column_stack([(np.arange(n) + 0.5) / n, np.arange(n) * 0.618034 % 1.0])
    groups = strata(unit, "sobol")
    return unit, groups, draw_counts(groups, 4_000, np.random.default_rng(1))


def test_replicates_of_an_even_sample_have_the_mean_place_of_its_points():
    unit, groups, counts = even_sample()
    found = balanced(counts, groups, unit)
    plain, even = (
        np.abs(each @ unit / 64.0 - unit.mean(axis=0)).mean() for each in (counts, found)
    )
    assert even < 0.6 * plain  # not 0: no point stands in a replicate less than never
    assert found.min() == 0.0


@pytest.mark.parametrize("n", [40, 333, 1001])
def test_law_what_balances_draws_is_summed_group_by_group_in_their_order(n):
    """To the bit, for groups of two and three, and of tens."""
    unit = np.random.default_rng(n).random((n, 3))
    for groups in (strata(unit, "sobol"), of_one_number(np.arange(n) % 7)):
        balance = Balance.of(groups, unit)
        free, lost = 0.0, 0.0
        for rows in (group for group in lists(groups) if len(group) > 1):
            free += len(rows)
            about = balance.trend[rows] - balance.trend[rows].mean(axis=0)
            lost += len(rows) / (len(rows) - 1) * float(np.sum(np.square(about)))
        assert balance.scale == math.sqrt(free / (free - lost))


def test_balance_leaves_the_variance_of_what_has_no_trend():
    unit, groups, counts = even_sample()
    values = np.random.default_rng(2).standard_normal((64, 40))
    plain, even = (
        np.var(each @ values, axis=0).mean() for each in (counts, balanced(counts, groups, unit))
    )
    assert even == pytest.approx(plain, rel=0.06)


def test_a_sample_too_small_to_tell_a_trend_and_a_direction_without_one_are_left_alone():
    unit, groups, counts = even_sample(5)
    assert balanced(counts, groups, unit) is None
    unit, groups, counts = even_sample()
    flat = np.column_stack([unit, np.full(64, 0.5)])
    assert balanced(counts, groups, flat) == pytest.approx(balanced(counts, groups, unit))


# --- some points at a time ------------------------------------------------------------------------


def whole(groups, replicates, **given):
    """All parts put together: counts, as drawn, and how many parts there were."""
    parts = list(resamples(groups, replicates, 3, ("intervals", "s"), **given))
    places = np.concatenate([part.places for part in parts])
    assert sorted(places.tolist()) == list(range(len(places))), "every point once"
    counts, drawn = (np.empty((replicates, len(places))) for _ in range(2))
    for part in parts:
        counts[:, part.places], drawn[:, part.places] = part.counts, part.drawn
    return counts, drawn, len(parts)


@pytest.mark.parametrize("most", [7, 20, 10_000])
def test_law_parts_keep_lists_together_and_every_list_as_large_as_it_is(most, monkeypatch):
    monkeypatch.setattr(drawing, "AT_ONCE", most * 500)
    numbers = np.random.default_rng(1).permutation(np.repeat(np.arange(6), [1, 2, 3, 5, 30, 59]))
    groups = of_one_number(numbers)
    counts, drawn, parts = whole(groups, 500)
    assert np.array_equal(counts, drawn)
    assert (parts == 1) == (most >= 100)
    for group in lists(groups):
        assert counts[:, group].sum(axis=1) == pytest.approx(np.full(500, len(group)))
    if parts == 1:  # the numbers of the stream of that name, list by list
        plain = draw_counts(groups, 500, random_stream(3, "intervals", "s"))
        assert np.array_equal(counts, plain)


@pytest.mark.parametrize("most", [9, 1_000])
def test_a_long_list_in_pieces_is_drawn_as_the_whole_list_is(most, monkeypatch):
    # The variance of the sum of 40 values, 39 drawn of them and counted 40/39 times: 39 (40/39)^2
    # var, and the share of replicates in which a point never stands (1 - 1/40)^39 = 0.3725. Two
    # points of two pieces: covariance
    # -39 (40/39)^2 / 40^2 = -0.02564.
    monkeypatch.setattr(drawing, "AT_ONCE", most * 20_000)
    counts, _, parts = whole(one_list(40), 20_000)
    assert (parts == 1) == (most >= 40)
    values = np.linspace(-1.0, 2.0, 40)
    assert np.var(counts @ values) == pytest.approx(39 * (40 / 39) ** 2 * np.var(values), rel=0.03)
    assert np.mean(counts == 0.0) == pytest.approx(0.3725, abs=0.002)
    assert np.mean(
        (counts[:, :9] - 1.0).mean(axis=1) * (counts[:, 31:] - 1.0).mean(axis=1)
    ) == pytest.approx(-0.02564, abs=0.003)


def test_law_a_balanced_sample_in_parts_is_balanced_as_a_whole(monkeypatch):
    unit = np.random.default_rng(2).random((300, 3))
    groups = strata(unit, "sobol")
    monkeypatch.setattr(drawing, "AT_ONCE", 11 * 50)
    told = []
    counts, drawn, parts = whole(groups, 50, done=lambda *numbers: told.append(numbers))
    assert parts > 20
    assert counts == pytest.approx(balanced(drawn, groups, unit), abs=1e-12)
    assert [points for points, _ in told] == sorted(points for points, _ in told)
    assert told[-1] == (600, 600), "each point was drawn twice"


@pytest.mark.parametrize("shape", [(1, 1), (40, 7), (3, 500)])
def test_law_draws_of_pairs_are_the_streams_own_multinomial_numbers(shape):
    one, other = np.random.default_rng(4), np.random.default_rng(4)
    assert np.array_equal(
        drawing._multinomial(2, shape, one), other.multinomial(1, [0.5, 0.5], shape)
    )
    assert one.random() == other.random()
