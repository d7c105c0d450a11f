"""Rank correlation and concordance, by hand."""

import math

import numpy as np
import pytest
from refusals import refusal
from scipy import stats

from sumo_eval.method.agreement import concordance, rank_correlation, rank_interval


def test_spearmans_rho_by_hand():
    # Ranks 1 2 3 4 and 2 1 4 3: rho = 1 - 6 (1 + 1 + 1 + 1) / (4 * 15) = 0.6.
    assert rank_correlation([1.0, 2.0, 3.0, 4.0], [20.0, 10.0, 40.0, 30.0]).value == pytest.approx(
        0.6
    )
    assert rank_correlation([1.0, 2.0, 3.0], [9.0, 5.0, 1.0]).value == pytest.approx(-1.0)
    assert math.isnan(rank_correlation([1.0, 1.0, 1.0], [9.0, 5.0, 1.0]).value)
    assert math.isnan(rank_correlation([1.0, 2.0, math.nan], [9.0, 5.0, 1.0]).p_value)


def test_kendalls_w_by_hand():
    assert concordance([[1, 2, 3], [4, 5, 9], [1, 5, 6]]).value == pytest.approx(1.0)
    # Ranks 1 2 3 and 3 2 1 add up to 4 4 4: no agreement.
    assert concordance([[1, 2, 3], [3, 2, 1]]).value == pytest.approx(0.0)
    # Ranks 1 2 3, 1 3 2: sums 2 5 5, mean 4, S = 4 + 1 + 1 = 6; W = 12 * 6 / (4 * 24) = 0.75.
    assert concordance([[1, 2, 3], [1, 3, 2]]).value == pytest.approx(0.75)
    # A tie: ranks 1.5 1.5 3 and 1 2 3: sums 2.5 3.5 6, mean 4, S = 2.25 + 0.25 + 4 = 6.5; W = 78 /
    # (96 - 2 * 6).
    assert concordance([[5, 5, 7], [1, 2, 3]]).value == pytest.approx(78 / 84)


def test_kendalls_w_beside_friedmans_test():
    """Friedman's statistic is m (n - 1) W, its P that of W."""
    ratings = np.array([[5, 3, 8, 8], [4, 2, 9, 6], [7, 1, 5, 6]])
    friedman, found = stats.friedmanchisquare(*ratings.T), concordance(ratings)
    assert 9.0 * found.value == pytest.approx(friedman.statistic)
    assert found.p_value == pytest.approx(friedman.pvalue)


def test_too_little_is_refused():
    with refusal("at least 3"):
        rank_correlation([1.0, 2.0], [1.0, 2.0])
    with refusal("at least 2 raters"):
        concordance([[1.0, 2.0, 3.0]])


def test_the_p_value_of_few_pairs_counts_orders():
    """Of 4! = 24 orders two have |rho| = 1: p = 1/12, not 0.

    [1, 2, 3, 4] against [2, 1, 4, 3]: rho 0.6; 10 of 24 are as large. Tied, [1, 1, 2] against [1,
    2, 3] has rho 0.87 in 4 of 6.
    """
    assert rank_correlation(
        [1.0, 2.0, 3.0, 4.0], [10.0, 20.0, 30.0, 40.0]
    ).p_value == pytest.approx(1.0 / 12.0)
    assert rank_correlation(
        [1.0, 2.0, 3.0, 4.0], [20.0, 10.0, 40.0, 30.0]
    ).p_value == pytest.approx(10.0 / 24.0)
    assert rank_correlation([1.0, 1.0, 2.0], [1.0, 2.0, 3.0]).p_value == pytest.approx(4.0 / 6.0)


def test_the_interval_of_rho_is_bonett_and_wrights():
    """rho 0.5, n 28: atanh 0.5 = 0.54931, half 1.95996 sqrt(1.125 / 25) = 0.41577; tanh of 0.13354
    and 0.96508."""
    assert rank_interval(0.5, 28) == pytest.approx((0.13275, 0.74653), abs=1e-5)
    one = rank_correlation(range(5), range(5)).value  # 1 but for rounding
    assert rank_interval(one, 5) is rank_interval(math.nan, 28) is rank_interval(0.5, 3) is None
    assert rank_interval(0.5, 4) is not None
