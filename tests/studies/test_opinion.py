"""Ratings by people compared with scores, without a run."""

from types import SimpleNamespace

import pandas as pd
import pytest

from sumo_eval.extras.studies.opinion import compare_opinion, opinion_lines
from sumo_eval.scoring.gate_settings import HIGHER_IS_BETTER

VALUES = {"a": 10.0, "b": 40.0, "c": 20.0, "d": 30.0}


def compared(ratings):
    """Ratings of each ADS compared with VALUES, which stand for all of its scores."""
    rows = [
        (f"rater {index}", ads, "cut_in", score)
        for ads, given in ratings.items()
        for index, score in enumerate(given)
    ]
    run = SimpleNamespace(
        score=lambda ads, scenario: SimpleNamespace(
            ads=ads, scenario=scenario, **dict.fromkeys(HIGHER_IS_BETTER.values(), VALUES[ads])
        )
    )
    return compare_opinion(run, pd.DataFrame(rows, columns=["rater", "ads", "scenario", "score"]))


@pytest.mark.parametrize(
    "ratings",
    [
        {ads: [7.3] * raters for ads, raters in zip("abcd", (7, 9, 1, 2), strict=True)},
        {"a": (1.1, 2.2, 3.3), "b": (3.3, 2.2, 1.1), "c": (1.1, 3.3, 2.2), "d": (2.2, 1.1, 3.3)},
    ],
)
def test_equal_mean_ratings_have_no_correlation(ratings):
    """Their last bits depended on number and order of the ratings, and were ranked."""
    opinion = compared(ratings)
    assert len({row.opinion for row in opinion.rows}) == 1
    assert set(opinion.correlations.values()) == {None}


def test_one_rated_score_has_no_concordance():
    *_, words = opinion_lines(compared({"a": (1.0, 2.0, 3.0)}))
    assert words == "Raters: fewer than two rated scores: no concordance."
