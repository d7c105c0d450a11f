"""Confidence in an evaluation: intervals, risk, coverage and further cases, from its scores and
rows. `report/confidence_section.py` shows it.

Users: `report/assessed.py`, `report/confidence_section.py`, `report/evidence.py`,
`report/verdict.py`.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.frozen import frozen
from sumo_eval.method.score_terms import mean_shares, worth
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import CaseTerms, case_terms
from sumo_eval.scoring.confidence.coverage import SpaceCoverage, space_coverage
from sumo_eval.scoring.confidence.further_cases import FurtherCases, further_cases
from sumo_eval.scoring.confidence.intervals import LEAST, LEVEL, REPLICATES, SCORED, Interval
from sumo_eval.scoring.confidence.resamples import one_list, resamples
from sumo_eval.trajectory import FloatArray

FURTHER = 20  # cases that are proposed


@frozen
class Risk:
    """Risk of an encounter, by exposure.

    collision_probability: probability of a collision.
    expected_loss: expected L (Eq. 14); 0 without a collision.
    effective_cases: number of cases of equal exposure with the same information (Kish).
    """

    collision_probability: Interval
    expected_loss: Interval
    effective_cases: float


class Assessment(NamedTuple):
    """Confidence in one ADS's scores in one scenario.

    intervals: name of a score in `ScenarioResult` -> its interval, if it has one; empty
        with fewer than two counted cases.
    sources: score (`s`, `s_plus`) -> source (`cases`, `drivers`) -> half the interval's width.
    risk: None if there are too few evaluated cases.
    further: proposed cases; None likewise.
    reason: why these two are None.
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
    """Confidence in each score of an evaluation.

    partitions: scenario -> its zones.
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
    """The points of all cases in a scenario, each once, ascending, (n, k), in the parameters'
    units.
    """
    logical = zones.logical
    return np.unique(evaluation.cases_in(logical.name).parameters(logical.names), axis=0)


def _assess(score: ScenarioResult, evaluation: Evaluation, zones: ZonePartition) -> Assessment:
    """Confidence in the scores of one ADS in one scenario."""
    settings, cases = evaluation.settings, evaluation.cases_behind(score)
    evaluated = cases[cases.evaluated]
    risk, further = risk_of(evaluated, score, settings.seed), None
    reason = "fewer than two evaluated cases with exposure"
    if risk is not None:
        reason = ""
        points = evaluated.parameters(zones.logical.names)
        moved = influence(case_terms(evaluated, settings.method))
        further = further_cases(zones.logical, points, moved, FURTHER)
    # cases given up are not evaluated, but T, A, A', H and S+ have intervals of them
    intervals = intervals_of(score) if np.count_nonzero(cases.counted) >= LEAST else {}
    sources = score.half_widths_by_source
    return Assessment(score.ads, score.scenario, intervals, sources, risk, further, reason)


def intervals_of(score: ScenarioResult) -> dict[str, Interval]:
    """Name of a score -> its interval, for each interval that a result has."""
    ends = {name: getattr(score, f"{name}_interval") for name in SCORED}
    return {
        name: Interval(getattr(score, name), *limits)
        for name, limits in ends.items()
        if limits is not None and getattr(score, name) is not None
    }


def influence(terms: CaseTerms) -> FloatArray:
    """Points by which each case moves S, (n,), to first order: the points for C = 1 (D = 1), times
    the case's share of the mean, times its value less the mean.

    terms: of the n cases of an ADS.
    """
    moved, whole = np.zeros(len(terms.exposure)), worth(terms.method.score)
    hit = np.isfinite(terms.ratio) & np.isfinite(terms.weight)
    # if a case voids D, there is no D that another case could move
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
    """Risk of an ADS in a scenario.

    evaluated: its evaluated cases.
    seed: of the run.
    """
    loss = np.nan_to_num(evaluated.loss)
    return risk(evaluated.exposure, loss, seed, (score.scenario, score.ads))


def risk(
    exposure: FloatArray, loss: FloatArray, seed: int, name: Sequence[str] = ()
) -> Risk | None:
    """Collision probability and expected loss, with intervals from a bootstrap over the cases; None
    with fewer than two cases, or without exposure.

    exposure: p_i of the evaluated cases, (n,).
    loss: L of Eq. 14, (n,), 0 without a collision.
    seed, name: of the random stream.

    If all cases end alike, so do all resamples of them. So the upper end is at least the exact
    binomial limit for n effective cases without a collision, u = 1 - ((1 - level) / 2)^(1 / n). If
    all cases with exposure collided, the lower end is multiplied by 1 - u.
    """
    n = len(exposure)
    if n < 2 or not exposure.sum() > 0.0:
        return None
    hit = (loss > 0.0).astype(float)
    terms = np.column_stack([exposure, exposure * hit, exposure * loss])
    sums = np.zeros((REPLICATES, 3))  # of each term in each replicate
    for part in resamples(one_list(n), REPLICATES, seed, ("risk", *name)):
        sums += part.counts @ terms[part.places]
    over, hits, losses = sums.T
    drawn = over > 0.0  # whether a replicate has exposure
    effective = float(exposure.sum() ** 2 / np.sum(exposure**2))
    tail = (1.0 - LEVEL) / 2.0
    # upper limit of the probability of an outcome that none of the effective cases had
    unseen = 1.0 - tail ** (1.0 / effective)
    exposed_hit = hit[exposure > 0.0]

    def interval(values: FloatArray, drawn_sums: FloatArray) -> Interval:
        """Mean of values (n,) by exposure, with its interval.

        drawn_sums: sum of exposure times value in each replicate, (m,).
        """
        low, high = np.quantile(drawn_sums[drawn] / over[drawn], [tail, 1.0 - tail])
        if exposed_hit.all():
            low = float(low) * (1.0 - unseen)
        # `unseen` limits the expected loss as well, because L is at most 1
        high = max(high, unseen)
        return Interval(float(exposure @ values / exposure.sum()), float(low), float(high))

    return Risk(interval(hit, hits), interval(loss, losses), effective)
