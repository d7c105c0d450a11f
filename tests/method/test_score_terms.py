"""The arithmetic of the scores: worked numbers, the law of dominance, one arithmetic for one sample
and for many."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_eval.method import score_terms as terms
from sumo_eval.settings import ScoreSettings

nan = np.nan
speed = st.one_of(st.just(0.0), st.floats(0.01, 40.0))
weight = st.one_of(st.just(0.0), st.floats(0.01, 3.0))
outcomes = st.lists(st.tuples(speed, speed, speed, weight), min_size=1, max_size=30)
"""Of each point: U of an ADS, Ug, U0, w."""


def columns(cases):
    return (np.array(column) for column in zip(*cases, strict=True))


# --- worked numbers -------------------------------------------------------------------------------


def test_c_by_hand_and_without_a_collision_and_without_an_evaluated_case():
    # collisions of U = 10 and 20 against Ug = 5 and 0, r = 1 and 3: (1 * 5/10 + 3 * 0/20) / 4 =
    # 0.125
    ratio = terms.ideal_ratio([10.0, 20.0, nan, nan], [5.0, 0.0, 0.0, nan])
    hit, judged = np.array([1, 1, 0, 0]), np.array([1, 1, 1, 0])
    counts = np.array([[1, 1, 1, 1], [2, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 2]], dtype=float)
    c = terms.collision_avoidance(ratio, [1.0, 3.0, nan, nan], hit, judged, counts)
    # drawn twice and once: (2 * 1 * 0.5 + 3 * 0) / 5; no collision among the evaluated: 1; none
    # evaluated: none
    np.testing.assert_allclose(c, [0.125, 0.2, 1.0, nan])


def test_c_is_undefined_where_the_ideal_vehicle_is_unknown():
    ratio = terms.ideal_ratio([10.0, nan], [nan, nan])
    c = terms.collision_avoidance(ratio, [1.0, nan], [True, False], [True, True], terms.once(2))
    assert np.isnan(c).all()


def test_d_by_hand():
    # (3 * 0.5 + 1 * 1.0) / 4; the third case has no D_i; drawn without the first two, there is none
    counts = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 3.0]])
    np.testing.assert_allclose(
        terms.exposure_mean([0.5, 1.0, nan], [3.0, 1.0, 9.0], counts), [0.625, nan]
    )


def test_s_by_hand_and_what_was_not_computed_counts_0_unless_nothing_was():
    # 60 * 1.25 * 0.4 + 40 * 0.5 * 0.8 = 30 + 16
    points = ScoreSettings(60.0, 1.25, 0.5)
    assert terms.paper_score([0.4], [0.8], points) == pytest.approx([46.0])
    np.testing.assert_array_equal(
        terms.paper_score([0.9, nan, nan], [nan, 0.5, nan], ScoreSettings()), [45.0, 25.0, nan]
    )


def test_a_and_the_regret_by_hand():
    # Three points, Ug = 0, 4, 0 and U0 = 10, 14, 5, weights 1, 2, 1: at stake 1 * 10 + 2 * 10 + 1 *
    # 5 = 35.
    # The ADS hits at 5, 9 and not at all: lost 1 * 5 + 2 * 5 + 0 = 15. A = 1 - 15/35, regret 15/4
    # m/s.
    ads, ideal, nobody, w = [5.0, 9.0, 0.0], [0.0, 4.0, 0.0], [10.0, 14.0, 5.0], [1.0, 2.0, 1.0]
    assert terms.avoided_share(ads, ideal, nobody, w, terms.once(3)) == pytest.approx([1 - 15 / 35])
    assert terms.regret(ads, ideal, w, terms.once(3)) == pytest.approx([15 / 4])
    # drawn 2, 0, 1 times: lost 10 of 25, over a weight of 3
    drawn = np.array([[2.0, 0.0, 1.0]])
    assert terms.avoided_share(ads, ideal, nobody, w, drawn) == pytest.approx([1 - 10 / 25])
    assert terms.regret(ads, ideal, w, drawn) == pytest.approx([10 / 3])


def test_a_of_nothing_lost_is_1_and_of_something_lost_where_nothing_was_at_stake_0():
    for hits, share in ((3.0, 1.0), (5.0, 0.0)):
        others = [0.0, 3.0], [0.0, 3.0], [1.0, 1.0]
        assert terms.avoided_share([0.0, hits], *others, terms.once(2)) == [share]


def test_a_is_below_0_for_who_is_worse_than_doing_nothing_and_s_plus_takes_0():
    # lost 20 where 8 was at stake: 1 - 20/8 = -1.5
    a = terms.avoided_share([20.0], [0.0], [8.0], [1.0], terms.once(1))
    assert a == [-1.5]
    grade = terms.avoidance_grade(a, 0.01)
    # 1 - ln(1 + 2.5/0.01) / ln(101) = 1 - 5.525 / 4.615
    np.testing.assert_allclose(grade, [-0.1972], atol=1e-4)
    assert terms.ordering_score([1.0], grade, [0.5], ScoreSettings()) == [0.0]


def test_a_leaves_out_points_with_an_unevaluated_vehicle():
    ads, ideal, nobody = [5.0, nan, 9.0, 9.0], [0.0, 0.0, nan, 0.0], [10.0, 10.0, 10.0, nan]
    counts = np.array([[1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 1.0, 1.0]])
    found = terms.avoided_share(ads, ideal, nobody, np.ones(4), counts)
    np.testing.assert_array_equal(found, [0.5, nan])


def test_a_and_the_regret_where_all_weights_are_0_count_every_point_alike():
    # lost 5 and 0 of 10 and 10
    hits, none, once = [5.0, 0.0], [0.0, 0.0], terms.once(2)
    assert terms.avoided_share(hits, none, [10.0, 10.0], none, once) == [0.75]
    assert terms.regret(hits, none, none, once) == [2.5]


def test_s_plus_by_hand():
    # 0.9 * 0.8 * (60 + 40 * 0.5) = 57.6; without H 0.9 * 0.8 * 60 = 43.2; none without T or without
    # A'
    found = terms.ordering_score(
        [0.9, 0.9, nan, 0.9], [0.8, 0.8, 0.8, nan], [0.5, nan, 0.5, 0.5], ScoreSettings(60.0)
    )
    np.testing.assert_allclose(found, [57.6, 43.2, nan, nan])


def test_the_grade_of_a_by_hand():
    x = np.array([0.0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
    by_hand = [1.0, 0.979, 0.943, 0.850, 0.700, 0.480, 0.256, 0.0]
    np.testing.assert_allclose(terms.avoidance_grade(1.0 - x, 0.01), by_hand, atol=5e-4)
    # 1 and 5 avoidable collisions of 192: A = .997 and .988
    np.testing.assert_allclose(
        terms.avoidance_grade([0.997, 0.988], 0.01), [0.943, 0.829], atol=5e-4
    )


def test_the_slope_of_the_grade_is_its_difference_quotient():
    step = 1e-7
    for avoided in (0.2, 0.9, 0.999):
        low, high = terms.avoidance_grade([avoided, avoided + step], 0.01)
        assert terms.grade_slope(avoided, 0.01) == pytest.approx((high - low) / step, rel=1e-3)
    assert terms.grade_slope(-0.1, 0.01) == 0.0


shares = st.floats(0.0, 1.0)


@given(st.lists(shares, min_size=2, max_size=2), shares, shares, shares)
def test_s_plus_lies_within_0_and_100_and_rises_with_each_part(pair, task, grade, human):
    low, high = sorted(pair)
    for one, other in (
        ((low, grade, human), (high, grade, human)), ((task, low, human), (task, high, human)),
        ((task, grade, low), (task, grade, high)),
    ):  # fmt: skip
        less, more = (
            float(terms.ordering_score(*np.array([parts]).T, ScoreSettings())[0])
            for parts in (one, other)
        )
        assert 0.0 <= less <= more <= 100.0


@given(st.lists(st.floats(-2.0, 1.0), min_size=2, max_size=2), st.floats(1e-4, 1.0))
def test_the_grade_orders_as_a_does(pair, sharpness):
    low, high = sorted(pair)
    first, second = terms.avoidance_grade([low, high], sharpness)
    assert first <= second
    assert (first < second) or high - low < 1e-9


# --- laws -----------------------------------------------------------------------------------------


@given(outcomes, st.data())
def test_who_is_no_worse_in_any_case_and_better_in_one_never_has_a_lower_a(cases, data):
    """Ties at most where the better cases have no weight, are below the ideal vehicle's severity,
    or are nothing."""
    u, ideal, nobody, w = columns(cases)
    shares = np.array([data.draw(st.one_of(st.just(1.0), st.floats(0.0, 0.99))) for _ in cases])
    better = u * shares
    a, b = (
        terms.avoided_share(one, ideal, nobody, w, terms.once(len(w)))[0] for one in (u, better)
    )
    assert b >= a
    told = (np.maximum(u - ideal, 0) - np.maximum(better - ideal, 0)) * (w if w.any() else 1.0)
    at_stake = np.maximum(nobody - ideal, 0) * (w if w.any() else 1.0)
    if told.max() > 1e-6 and at_stake.sum() > 0.0:
        assert b > a
    regrets = [terms.regret(one, ideal, w, terms.once(len(w)))[0] for one in (u, better)]
    assert regrets[1] <= regrets[0]


@given(outcomes, st.integers(0, 2**32 - 1))
def test_counts_are_repeated_cases(cases, seed):
    """A sample by counts is the evaluation of the cases repeated so often: one arithmetic for
    both."""
    u, ideal, nobody, w = columns(cases)
    hit = u > 0.0
    ratio, r = terms.ideal_ratio(np.where(hit, u, nan), ideal), np.where(hit, w, nan)
    counts = np.random.default_rng(seed).multinomial(len(w), np.full(len(w), 1 / len(w)), size=3)
    for row in counts:
        again = np.repeat(np.arange(len(w)), row)
        for term, values in (
            (terms.avoided_share, (u, ideal, nobody, w)),
            (terms.regret, (u, ideal, w)),
            (terms.exposure_mean, (ratio, w)),
            (terms.collision_avoidance, (ratio, r, hit, np.ones(len(w)))),
        ):
            by_counts = term(*values, row[None, :].astype(float))
            by_repeating = term(*(it[again] for it in values), terms.once(len(again)))
            np.testing.assert_allclose(by_counts, by_repeating, rtol=1e-9, atol=1e-9)


factors = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4)


@given(values=factors)
def test_the_factors_of_a_product_share_its_loss_as_the_mean_over_all_orders(values):
    """The plain twin: take the factors off in every order and average what each one took."""
    orders = list(itertools.permutations(range(len(values))))
    slow = np.zeros(len(values))
    for order in orders:
        left = 1.0
        for place in order:
            slow[place] += left * (1.0 - values[place]) / len(orders)
            left *= values[place]
    (found,) = terms.product_losses(np.array([values]))
    np.testing.assert_allclose(found, slow, atol=1e-12)
    assert found.sum() == pytest.approx(1.0 - np.prod(values), abs=1e-12)


def test_what_each_point_takes_from_a_by_hand():
    # w (U - Ug): 1 * (10 - 5) = 5, 2 * (4 - 0) = 8; at stake w (U0 - Ug): 1 * (15 - 5) + 2 * (8 -
    # 0) = 26
    taken = terms.avoided_share_losses(
        [10.0, 4.0, 3.0], [5.0, 0.0, nan], [15.0, 8.0, 9.0], [1.0, 2.0, 1.0]
    )
    np.testing.assert_allclose(taken, [5.0 / 26.0, 8.0 / 26.0, nan])


@given(cases=outcomes)
def test_what_the_points_take_from_a_adds_up_to_what_it_lost(cases):
    u, ideal, nothing, weights = columns(cases)
    taken = terms.avoided_share_losses(u, ideal, nothing, weights)
    (a_share,) = terms.avoided_share(u, ideal, nothing, weights, terms.once(len(u)))
    assert taken.sum() == pytest.approx(1.0 - a_share, rel=1e-9, abs=1e-12)
    assert (taken >= 0.0).all()
