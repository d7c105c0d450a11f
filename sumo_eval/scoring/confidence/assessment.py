"""Confidence in an evaluation: intervals, risk, coverage and further cases, put together from its
scores and rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sumo_eval.method.score_terms import mean_shares, worth
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import CaseTerms, case_terms
from sumo_eval.scoring.confidence.coverage import SpaceCoverage, space_coverage
from sumo_eval.scoring.confidence.further_cases import FurtherCases, further_cases
from sumo_eval.scoring.confidence.intervals import SCORED, Interval
from sumo_eval.scoring.confidence.risk import Risk, risk
from sumo_eval.settings import MethodSettings
from sumo_eval.trajectory import FloatArray

FURTHER = 20  # cases that are proposed


@dataclass(frozen=True, slots=True)
class Assessment:
    """Confidence in one ADS's scores in one scenario.

    intervals: of every score that has one, by its name in `ScenarioResult`.
    sources: half-widths of S and S+ by source.
    risk, further: None where there are too few evaluated cases, see `reason`.
    """

    ads: str
    scenario: str
    intervals: Mapping[str, Interval]
    sources: Mapping[str, Mapping[str, float]]
    risk: Risk | None
    further: FurtherCases | None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Confidence:
    """Confidence in all scores of an evaluation.

    coverage: of each scenario's space, by name.
    """

    assessments: tuple[Assessment, ...]
    coverage: Mapping[str, SpaceCoverage]

    def of(self, ads: str, scenario: str) -> Assessment:
        """That of one ADS in one scenario."""
        return next(
            item for item in self.assessments if (item.ads, item.scenario) == (ads, scenario)
        )


def assess(
    evaluation: Evaluation, partitions: Mapping[str, ZonePartition], progress: Progress = quiet
) -> Confidence:
    """How far each score of an evaluation can be trusted.

    partitions: the zones, by scenario name.
    """
    coverage, assessments = {}, []
    for score in evaluation.scores:
        assessments.append(_assess(score, evaluation, partitions[score.scenario]))
        progress("confidence in the scores", len(assessments), len(evaluation.scores))
    for name, zones in partitions.items():
        coverage[name] = space_coverage(zones, _points(evaluation, zones))
    return Confidence(tuple(assessments), coverage)


def _points(evaluation: Evaluation, zones: ZonePartition) -> FloatArray:
    """The points of all cases in a scenario, each once, ascending, (n, k)."""
    found = np.empty((0, len(zones.logical.parameters)))
    for score in evaluation.scores:
        if score.scenario == zones.logical.name:
            rows = evaluation.cases_of(score.ads, score.scenario).parameters(zones.logical.names)
            found = np.unique(np.concatenate([found, rows]), axis=0)
    return found


def _assess(score: ScenarioResult, evaluation: Evaluation, zones: ZonePartition) -> Assessment:
    settings = evaluation.settings
    cases = evaluation.cases_of(score.ads, score.scenario)
    terms = case_terms(cases, settings.method)
    evaluated = terms.evaluated
    if evaluated.sum() < 2 or not terms.exposure[evaluated].sum() > 0.0:
        reason = "fewer than two evaluated cases with exposure"
        return Assessment(score.ads, score.scenario, {}, {}, None, None, reason)
    terms = terms.part(evaluated)
    points = cases.parameters(zones.logical.names)[evaluated]
    loss = np.nan_to_num(cases.loss[evaluated])
    return Assessment(
        score.ads,
        score.scenario,
        intervals_of(score),
        score.half_widths_by_source,
        risk(terms.exposure, loss, settings.seed, (score.scenario, score.ads)),
        further_cases(zones.logical, points, influence(terms, settings.method), FURTHER),
    )


def intervals_of(score: ScenarioResult) -> dict[str, Interval]:
    """The intervals of a result by the name of the score, without those that it does not have."""
    found = {name: (getattr(score, name), getattr(score, f"{name}_interval")) for name in SCORED}
    return {
        name: Interval(value, ends[0], ends[1])
        for name, (value, ends) in found.items()
        if value is not None and ends is not None
    }


def influence(terms: CaseTerms, method: MethodSettings) -> FloatArray:
    """How many points of S each case moves, (n,): the first-order effect of its weight on C and
    D.
    """
    moved, whole = np.zeros(len(terms.exposure)), worth(method.score)
    hit = np.isfinite(terms.ratio) & np.isfinite(terms.weight)
    if hit.any():
        shares, ratio = mean_shares(terms.weight[hit]), terms.ratio[hit]
        moved[hit] += whole.c * shares * (ratio - float(shares @ ratio))
    counted = np.isfinite(terms.index)
    if counted.any() and not terms.voids.any():
        shares, index = mean_shares(terms.exposure[counted]), terms.index[counted]
        moved[counted] += whole.d * shares * (index - float(shares @ index))
    return moved
