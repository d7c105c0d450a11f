"""Confidence in an evaluation: intervals, risk, coverage and further cases, put together from its
scores and rows. `report.confidence_section` shows it.

Users: `report/assessed.py`, `report/confidence_section.py`, `report/evidence.py`,
`report/verdict.py`.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.method.score_terms import mean_shares, worth
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import CaseTerms, case_terms
from sumo_eval.scoring.confidence.coverage import SpaceCoverage, space_coverage
from sumo_eval.scoring.confidence.further_cases import FurtherCases, further_cases
from sumo_eval.scoring.confidence.intervals import LEVEL, REPLICATES, SCORED, Interval
from sumo_eval.scoring.confidence.resamples import one_list, resamples
from sumo_eval.settings import MethodSettings
from sumo_eval.trajectory import FloatArray

FURTHER = 20  # cases that are proposed


@frozen
class Risk:
    """Exposure-weighted collision probability and expected loss L (Eq. 14) of an encounter.

    effective_cases: number of equally frequent cases with the same information (Kish).
    """

    collision_probability: Interval
    expected_loss: Interval
    effective_cases: float


class Assessment(NamedTuple):
    """Confidence in one ADS's scores in one scenario.

    intervals: of every score that has one, by its name in `ScenarioResult`.
    sources: score (`s`, `s_plus`) -> source (`cases`, `drivers`) -> half the interval's width.
    risk, further: None where there are too few evaluated cases, see `reason`.
    """

    ads: str
    scenario: str
    intervals: Mapping[str, Interval]
    sources: Mapping[str, Mapping[str, float]]
    risk: Risk | None
    further: FurtherCases | None
    reason: str = ""


class Confidence(NamedTuple):
    """Confidence in all scores of an evaluation.

    coverage: of each scenario's space, by name.
    """

    assessments: tuple[Assessment, ...]
    coverage: Mapping[str, SpaceCoverage]


def assess(
    evaluation: Evaluation, partitions: Mapping[str, ZonePartition], progress: Progress = quiet
) -> Confidence:
    """Confidence of each score of an evaluation.

    partitions: the zones, by scenario name.
    """
    assessments = []
    for score in evaluation.scores:
        assessments.append(_assess(score, evaluation, partitions[score.scenario]))
        progress("confidence in the scores", len(assessments), len(evaluation.scores))
    coverage = {
        name: space_coverage(zones, _points(evaluation, zones))
        for name, zones in partitions.items()
    }
    return Confidence(tuple(assessments), coverage)


def _points(evaluation: Evaluation, zones: ZonePartition) -> FloatArray:
    """The points of all cases in a scenario, each once, ascending, (n, k)."""
    logical = zones.logical
    return np.unique(evaluation.cases_in(logical.name).parameters(logical.names), axis=0)


def _assess(score: ScenarioResult, evaluation: Evaluation, zones: ZonePartition) -> Assessment:
    settings, cases = evaluation.settings, evaluation.cases_behind(score)
    evaluated = cases[cases.evaluated]
    risk = risk_of(evaluated, score, settings.seed)
    if risk is None:
        reason = "fewer than two evaluated cases with exposure"
        return Assessment(score.ads, score.scenario, {}, {}, None, None, reason)
    moved = influence(case_terms(evaluated, settings.method), settings.method)
    points = evaluated.parameters(zones.logical.names)
    return Assessment(
        score.ads,
        score.scenario,
        intervals_of(score),
        score.half_widths_by_source,
        risk,
        further_cases(zones.logical, points, moved, FURTHER),
    )


def intervals_of(score: ScenarioResult) -> dict[str, Interval]:
    """Each interval that a result has, by the name of its score."""
    ends = {name: getattr(score, f"{name}_interval") for name in SCORED}
    return {
        name: Interval(getattr(score, name), *limits)
        for name, limits in ends.items()
        if limits is not None and getattr(score, name) is not None
    }


def influence(terms: CaseTerms, method: MethodSettings) -> FloatArray:
    """Points by which each case moves S, (n,), to first order: the points that C or D is worth,
    times the case's share of all weights, times its value less the mean.
    """
    moved, whole = np.zeros(len(terms.exposure)), worth(method.score)
    hit = np.isfinite(terms.ratio) & np.isfinite(terms.weight)
    # where a case voids D, no case moves it
    counted = np.isfinite(terms.index) & ~terms.voids.any()
    for rows, worth_points, weights, values in (
        (hit, whole.c, terms.weight, terms.ratio),
        (counted, whole.d, terms.exposure, terms.index),
    ):
        if rows.any():
            shares, value = mean_shares(weights[rows]), values[rows]
            moved[rows] += worth_points * shares * (value - float(shares @ value))
    return moved


def risk_of(evaluated: CaseTable, score: ScenarioResult, seed: int) -> Risk | None:
    """Risk of an ADS in a scenario, from its evaluated cases; None with fewer than two of them, or
    without exposure.
    """
    if len(evaluated) < 2 or not evaluated.exposure.sum() > 0.0:
        return None
    loss = np.nan_to_num(evaluated.loss)
    return risk(evaluated.exposure, loss, seed, (score.scenario, score.ads))


def risk(exposure: FloatArray, loss: FloatArray, seed: int, name: Sequence[str] = ()) -> Risk:
    """Collision probability and expected loss, with intervals from a bootstrap over the cases.

    exposure: p_i of the evaluated cases, (n,).
    loss: L of Eq. 14, (n,), 0 without a collision.
    name: parts of the random stream's name.

    Resamples of cases with one outcome have no other. So the exact binomial limit for n effective
    cases, u = 1 - ((1 - level) / 2)^(1 / n), is the upper end if no case with exposure collided. If
    all of them collided, the lower end is multiplied by 1 - u.
    """
    n = len(exposure)
    if n < 2 or not exposure.sum() > 0.0:
        raise must_be(
            "The cases",
            "a risk",
            "at least 2, with exposure above 0",
            f"{n} with exposure {exposure.sum():g}",
        )
    hit = (loss > 0.0).astype(float)
    terms = np.column_stack([exposure, exposure * hit, exposure * loss])
    sums = np.zeros((REPLICATES, 3))
    for part in resamples(one_list(n), REPLICATES, seed, ("risk", *name)):
        sums += part.counts @ terms[part.places]
    over, hits, losses = sums.T
    drawn = over > 0.0  # replicates with exposure
    effective = float(exposure.sum() ** 2 / np.sum(exposure**2))
    tail = (1.0 - LEVEL) / 2.0
    # upper limit of the probability of an outcome that none of the effective cases had
    unseen = 1.0 - tail ** (1.0 / effective)
    exposed_hit = hit[exposure > 0.0]

    def interval(values: FloatArray, drawn_sums: FloatArray) -> Interval:
        low, high = np.quantile(drawn_sums[drawn] / over[drawn], [tail, 1.0 - tail])
        if not exposed_hit.any():
            high = unseen  # limits the expected loss as well, because L is at most 1
        elif exposed_hit.all():
            low = float(low) * (1.0 - unseen)
        return Interval(float(exposure @ values / exposure.sum()), float(low), float(high))

    return Risk(interval(hit, hits), interval(loss, losses), effective)
