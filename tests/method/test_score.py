"""Eq. 18."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal

from sumo_eval.method.score import combined_score, population_scale

index = st.floats(0.0, 1.0)


def test_the_score_by_hand():
    # 60 * 1.25 * 0.4 + 40 * 0.5 * 0.8 = 30 + 16
    score = combined_score(0.4, 0.8, a=60, b=40, k5=1.25, k6=0.5)
    assert (score.total, score.c_points, score.d_points) == pytest.approx((46.0, 30.0, 16.0))
    assert (score.c, score.d) == (0.4, 0.8)


def test_the_defaults_are_halves_and_full_marks_are_100():
    assert combined_score(1.0, 1.0).total == 100.0
    assert combined_score(0.5, 1.0).total == 75.0


def test_without_c_its_term_counts_0_and_reports_it():
    score = combined_score(None, 0.5)
    assert (score.total, score.c, score.c_points, score.d_points) == (25.0, None, 0.0, 25.0)


def test_without_c_and_d_there_is_no_s_and_never_0_points():
    assert combined_score(None, None).total is None
    assert combined_score(0.0, None).total == 0.0


def test_without_d_its_term_counts_0_and_reports_it():
    score = combined_score(0.9, None)
    assert (score.total, score.d, score.d_points) == (45.0, None, 0.0)
    assert combined_score(0.9, 0.0).d == 0.0


@given(
    index,
    index,
    index,
    index,
    st.floats(0.0, 100.0),
    st.floats(0.1, 3.0),
    st.floats(0.1, 3.0),
    index,
)
def test_s_is_linear_in_c_and_d(c, d, other_c, other_d, a, k5, k6, share):
    scales = {"a": a, "b": 100.0 - a, "k5": k5, "k6": k6}
    mixed = combined_score(
        share * c + (1 - share) * other_c, share * d + (1 - share) * other_d, **scales
    ).total
    ends = combined_score(c, d, **scales).total, combined_score(other_c, other_d, **scales).total
    assert mixed == pytest.approx(share * ends[0] + (1 - share) * ends[1], abs=1e-9)
    assert combined_score(0.0, 0.0, **scales).total == 0.0


def test_the_population_scale_gives_the_middle_ads_half_of_the_points():
    # median of 0.2, 0.4, 0.9 is 0.4: k5 = 0.5/0.4 = 1.25; mean 0.5: k5 = 1
    assert population_scale([0.9, 0.2, 0.4]) == 1.25
    assert population_scale([0.9, 0.2, 0.4], centre="mean") == pytest.approx(1.0)
    assert population_scale([0.4], 0.3) == pytest.approx(0.75)
    assert combined_score(0.4, 0.0, k5=population_scale([0.9, 0.2, 0.4])).c_points == 25.0


@pytest.mark.parametrize(
    ("arguments", "keywords", "sentence"),
    [
        ((1.1, 0.5), {}, "`c` of the score must be within 0..1, got 1.1"),
        ((math.nan, 0.5), {}, "`c` of the score must be within 0..1, got nan"),
        ((0.5, -0.1), {}, "`d` of the score must be within 0..1, got -0.1"),
        (
            (0.5, 0.5),
            {"a": 60},
            "`a` and `b` of the score must be at least 0 and together 100, got .60, 50.0.",
        ),
        (
            (0.5, 0.5),
            {"a": -10, "b": 110},
            "`a` and `b` of the score must be at least 0 and together 100",
        ),
        ((0.5, 0.5), {"k5": 0.0}, "`k5` of the score must be greater than 0, got 0.0"),
        ((0.5, None), {"k6": math.inf}, "`k6` of the score must be greater than 0, got inf"),
    ],
)
def test_what_makes_no_score_is_refused(arguments, keywords, sentence):
    with refusal(sentence):
        combined_score(*arguments, **keywords)


@pytest.mark.parametrize(
    ("arguments", "keywords", "sentence"),
    [
        (([],), {}, "`values` of `population_scale` must be at least one index"),
        (([0.5, 1.5],), {}, "`values` of the score must be within 0..1, got 1.5"),
        (([0.0, 0.0, 1.0],), {}, "The median of the population's indexes must be greater than 0"),
        (
            ([0.5], 0.0),
            {},
            "`share` of `population_scale` must be within 0..1 and above 0, got 0.0",
        ),
        (
            ([0.5],),
            {"centre": "mode"},
            "`centre` of `population_scale` must be 'median' or 'mean', got 'mode'",
        ),
    ],
)
def test_what_makes_no_scale_is_refused(arguments, keywords, sentence):
    with refusal(sentence):
        population_scale(*arguments, **keywords)
