"""Puts the intervals of a scored scenario into its results, with what missing cases leave open.

`scoring.steps` calls it.
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
from sumo_eval.scoring.confidence.intervals import Judged, ScoreIntervals, score_intervals
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
"""Range of each score. That of S, which is not here, ends at the S of C = D = 1 (Eq. 18)."""

LEAST = 2  # fewest cases that count for an interval


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

    scores: the results; their intervals so far are the bounds that missing cases leave open.
    rows: cases of each ADS.
    places: of each ADS the indices of its cases' points.
    drivers: of each ADS the errors by the choice of drivers.
    groups: all points, in lists of those that may stand for each other.

    An ADS with fewer than two cases that count keeps the intervals that it has.
    """
    judged = []
    for score, cases, at, errors in zip(scores, rows, places, drivers, strict=True):
        terms, missing = case_terms(cases, settings.method), (0.0, 0.0)
        if score.s_plus is not None and score.s_plus_interval is not None:
            low, high = score.s_plus_interval
            missing = low - score.s_plus, high - score.s_plus
        if np.count_nonzero(terms.counted) >= LEAST:
            judged.append(Judged(score.ads, terms, at, ~cases.safe, errors, missing))
    computed = (
        score_intervals(
            judged, groups, settings.method, settings.seed, scores[0].scenario, progress=progress
        )
        if judged
        else []
    )
    by_ads = {it.ads: interval for it, interval in zip(judged, computed, strict=True)}
    intervals = [by_ads.get(score.ads) for score in scores]
    most = sum(worth(settings.method.score))  # of S
    return [
        score if interval is None else _joined(score, interval, most)
        for score, interval in zip(scores, intervals, strict=True)
    ], intervals


def _joined(score: ScenarioResult, intervals: ScoreIntervals, most_of_s: float) -> ScenarioResult:
    """A result whose intervals hold what missing cases leave open and the chance of the sample.

    score: the result; its intervals are what missing cases leave open.
    intervals: intervals by the sample, of the cases that are there.
    most_of_s: largest value of S.

    Each end is the bound that missing cases leave open, moved outwards by the distance of the
    sample's end from the score, but not out of the score's range.
    """
    ends: dict[str, Any] = {}
    for name, (low, high) in intervals.limits.items():
        value = getattr(score, name)
        worst, best = getattr(score, f"{name}_interval") or (value, value)
        least, most = WITHIN.get(name, (0.0, most_of_s))
        # where rounding has put the score out of its range, the score is the bound
        ends[f"{name}_interval"] = (
            float(max(worst - (value - low), min(least, worst))),
            float(min(best + (high - value), max(most, best))),
        )
    sources = {name: dict(parts) for name, parts in intervals.sources.items()}
    return replace(score, **ends, half_widths_by_source=sources)
