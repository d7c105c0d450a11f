"""Eq. 18."""

import json

import pytest
from refusals import refusal
from tables import rows_of, values_of

from sumo_eval.method.score import combined_score, population_scale


@pytest.mark.parametrize(
    "c, d, scales, expected",
    values_of("""
    # 60 * 1.25 * 0.4 + 40 * 0.5 * 0.8
    0.4, 0.8, {"a": 60, "b": 40, "k5": 1.25, "k6": 0.5}, (46.0, 30.0, 16.0)
    0.5, 1.0, {}, (75.0, 25.0, 50.0)
    None, 0.5, {}, (25.0, 0.0, 25.0)
    0.9, None, {}, (45.0, 45.0, 0.0)
    0.0, None, {}, (0.0, 0.0, 0.0)
    None, None, {}, (None, 0.0, 0.0)
    """),
)
def test_the_score_by_hand(c, d, scales, expected):
    score = combined_score(c, d, **scales)
    assert (score.c, score.d, *score[3:]) == pytest.approx((c, d, *expected[1:]))
    assert score.total == pytest.approx(expected[0])


def test_the_population_scale_gives_the_middle_ads_half_of_the_points():
    # median of 0.2, 0.4, 0.9 is 0.4: k5 = 0.5/0.4 = 1.25; mean 0.5: k5 = 1
    assert population_scale([0.9, 0.2, 0.4]) == 1.25
    assert population_scale([0.9, 0.2, 0.4], centre="mean") == pytest.approx(1.0)
    assert population_scale([0.4], 0.3) == pytest.approx(0.75)
    assert combined_score(0.4, 0.0, k5=population_scale([0.9, 0.2, 0.4])).c_points == 25.0


@pytest.mark.parametrize(
    "arguments, keywords, sentence",
    rows_of(
        """
[1.1, 0.5] | {} | `c` of the score must be within 0..1, got 1.1
[NaN, 0.5] | {} | `c` of the score must be within 0..1, got nan
[0.5, -0.1] | {} | `d` of the score must be within 0..1, got -0.1
[0.5, 0.5] | {"a": 60}
| `a` and `b` of the score must be at least 0 and together 100, got .60, 50.0.
[0.5, 0.5] | {"a": -10, "b": 110} | `a` and `b` of the score must be at least 0 and together 100
[0.5, 0.5] | {"k5": 0.0} | `k5` of the score must be greater than 0, got 0.0
[0.5, null] | {"k6": Infinity} | `k6` of the score must be greater than 0, got inf
""",
        json.loads,
        json.loads,
    ),
)
def test_what_makes_no_score_is_refused(arguments, keywords, sentence):
    with refusal(sentence):
        combined_score(*arguments, **keywords)


@pytest.mark.parametrize(
    "arguments, keywords, sentence",
    rows_of(
        """
[[]] | {} | `values` of `population_scale` must be at least one index
[[0.5, 1.5]] | {} | `values` of the score must be within 0..1, got 1.5
[[0.0, 0.0, 1.0]] | {} | The median of the population's indexes must be greater than 0
[[0.5], 0.0] | {} | `share` of `population_scale` must be within 0..1 and above 0, got 0.0
[[0.5]] | {"centre": "mode"}
| `centre` of `population_scale` must be 'median' or 'mean', got 'mode'
""",
        json.loads,
        json.loads,
    ),
)
def test_what_makes_no_scale_is_refused(arguments, keywords, sentence):
    with refusal(sentence):
        population_scale(*arguments, **keywords)
