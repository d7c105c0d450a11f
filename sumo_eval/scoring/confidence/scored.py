"""Puts the intervals of a scored scenario into its results, together with the bounds that missing
cases leave open.

Users: `scoring/steps.py`.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.method.score_terms import worth
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.results import ScenarioResult
from sumo_eval.scoring.case_terms import case_terms
from sumo_eval.scoring.confidence.drivers import DriverDeviations
from sumo_eval.scoring.confidence.intervals import LEAST, AdsCases, ScoreIntervals, score_intervals
from sumo_eval.scoring.confidence.resamples import Strata
from sumo_eval.settings import EvaluationSettings
from sumo_eval.trajectory import IntArray

WITHIN = {
    "c": (0.0, 1.0),
    "d": (0.0, 1.0),
    "avoided_share": (-np.inf, 1.0),
    "avoided_share_exposure": (-np.inf, 1.0),
    "regret": (0.0, np.inf),
    "human_likeness": (0.0, 1.0),
    "task_share": (0.0, 1.0),
    "avoidance_grade": (-np.inf, 1.0),
    "s_plus": (0.0, 100.0),
}
"""Score -> its range. The range of S, which is not in it, is 0 to S of C = D = 1 (Eq. 18)."""


def with_intervals(
    scores: Sequence[ScenarioResult],
    rows: Sequence[CaseTable],
    places: Sequence[IntArray],
    drivers: Sequence[DriverDeviations],
    groups: Strata,
    settings: EvaluationSettings,
    progress: Progress = quiet,
) -> tuple[list[ScenarioResult], list[ScoreIntervals | None]]:
    """The results of all ADSs in one scenario with the interval of every score, and the intervals
    that a ranking needs.

    scores: the results. Their intervals so far are the bounds that missing cases leave open.
    rows: cases of each ADS.
    places: of each ADS the indices of its cases' points.
    drivers: of each ADS the errors by the choice of drivers.
    groups: all points, in lists of points that may replace each other.

    An ADS with fewer than two counted cases keeps the intervals that it has. Instead of intervals
    for a ranking it has None.
    """
    ads_cases = []
    for score, cases, at, errors in zip(scores, rows, places, drivers, strict=True):
        terms, missing = case_terms(cases, settings.method), (0.0, 0.0)
        # how far missing cases may move S+, down and up
        if score.s_plus is not None and score.s_plus_interval is not None:
            low, high = score.s_plus_interval
            missing = low - score.s_plus, high - score.s_plus
        if np.count_nonzero(terms.counted) >= LEAST:
            ads_cases.append(AdsCases(score.ads, terms, at, ~cases.safe, errors, missing))
    computed = []
    if ads_cases:
        scenario = scores[0].scenario
        computed = score_intervals(ads_cases, groups, settings.seed, scenario, progress=progress)
    by_ads = {each.ads: interval for each, interval in zip(ads_cases, computed, strict=True)}
    intervals = [by_ads.get(score.ads) for score in scores]
    most = sum(worth(settings.method.score))  # of S
    return [
        score if interval is None else _joined(score, interval, most)
        for score, interval in zip(scores, intervals, strict=True)
    ], intervals


def _joined(score: ScenarioResult, intervals: ScoreIntervals, most_of_s: float) -> ScenarioResult:
    """A result whose intervals contain both what missing cases leave open and the chance of the
    sample.

    score: the result. Its intervals are the bounds that missing cases leave open.
    intervals: by the sample, of the cases that are there.
    most_of_s: largest value of S.

    Each end is the bound by missing cases, moved outwards by the distance between the score and the
    sample's end, but not out of the score's range.
    """
    ends: dict[str, Any] = {}
    for name, (low, high) in intervals.limits.items():
        value = getattr(score, name)
        worst, best = getattr(score, f"{name}_interval") or (value, value)
        least, most = WITHIN.get(name, (0.0, most_of_s))
        # if rounding has put the bound out of the score's range, the bound itself is the limit
        ends[f"{name}_interval"] = (
            float(max(worst - (value - low), min(least, worst))),
            float(min(best + (high - value), max(most, best))),
        )
    return replace(score, **ends, half_widths_by_source=intervals.sources)
