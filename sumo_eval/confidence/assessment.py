"""Confidence in an evaluation: intervals, risk, coverage and further cases, put together from its rows and facts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.batch.human_reference import PointJob, compute_points
from sumo_eval.batch.recording import Progress, quiet
from sumo_eval.batch.run_folder import FACTS
from sumo_eval.batch.store import Store, open_store
from sumo_eval.case_terms import ratios
from sumo_eval.comparison import jackknifed
from sumo_eval.confidence.coverage import SpaceCoverage, space_coverage
from sumo_eval.confidence.further_cases import FurtherCases, further_cases
from sumo_eval.confidence.intervals import CaseTerms, ScoreIntervals, jackknife_error, score_intervals
from sumo_eval.confidence.risk import Risk, risk
from sumo_eval.method.anthropomorphic import exposure_weighted_index
from sumo_eval.method.score_terms import once, weighted_mean
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.random_streams import random_stream
from sumo_eval.results import CaseResult, Evaluation, ScenarioResult
from sumo_eval.settings import EvaluationSettings, MethodSettings
from sumo_eval.trajectory import FloatArray

FURTHER = 20  # cases that are proposed


@dataclass(frozen=True, slots=True)
class Assessment:
    """Confidence in one ADS's scores in one scenario. None: too few evaluated cases, see `reason`."""

    ads: str
    scenario: str
    intervals: ScoreIntervals | None
    risk: Risk | None
    further: FurtherCases | None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Confidence:
    """Confidence in all scores of an evaluation. coverage: of each scenario's space, by name."""

    assessments: tuple[Assessment, ...]
    coverage: Mapping[str, SpaceCoverage]

    def of(self, ads: str, scenario: str) -> Assessment:
        """That of one ADS in one scenario."""
        return next(item for item in self.assessments if (item.ads, item.scenario) == (ads, scenario))


def assess(evaluation: Evaluation, partitions: Mapping[str, ZonePartition], progress: Progress = quiet) -> Confidence:
    """How far each score of an evaluation can be trusted. partitions: the zones, by scenario name."""
    coverage, assessments = {}, []
    with open_store(evaluation.folder / FACTS) as store:
        for score in evaluation.scores:
            assessments.append(_assess(score, evaluation, partitions[score.scenario], store))
            progress("confidence", len(assessments), len(evaluation.scores))
    for name, zones in partitions.items():
        rows = {tuple(zones.logical.row(case.values)) for case in evaluation.cases if case.scenario == name}
        coverage[name] = space_coverage(zones, np.array(sorted(rows)))
    return Confidence(tuple(assessments), coverage)


def _assess(score: ScenarioResult, evaluation: Evaluation, zones: ZonePartition, store: Store) -> Assessment:
    cases = [
        case for case in evaluation.cases if (case.ads, case.scenario) == (score.ads, score.scenario) and case.evaluated
    ]
    if len(cases) < 2 or not sum(case.exposure for case in cases) > 0.0:
        return Assessment(score.ads, score.scenario, None, None, None, "fewer than two evaluated cases with exposure")
    settings = evaluation.settings
    points = np.array([zones.logical.row(case.values) for case in cases])
    terms = _terms(cases, settings.method, *driver_error(score, cases, store, settings, zones))

    def stream(what: str) -> np.random.Generator:
        return random_stream(settings.seed, what, score.scenario, score.ads)

    loss = np.array([case.loss or 0.0 for case in cases])
    return Assessment(
        score.ads,
        score.scenario,
        score_intervals(terms, settings.method.score, stream("intervals")),
        risk(terms.exposure, loss, stream("risk")),
        further_cases(zones.logical, points, influence(terms, settings.method), FURTHER, settings.seed),
    )


def _terms(
    cases: Sequence[CaseResult],
    method: MethodSettings,
    driver_error: float,
    drivers: int,
) -> CaseTerms:
    def column(name: str) -> FloatArray:
        values = [getattr(case, name) for case in cases]
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)

    hit, ideal = column("severity"), column("ideal_severity")
    safe = np.array([case.zone == "safe" for case in cases])
    return CaseTerms(
        exposure=column("exposure"),
        collided=np.array([case.collided and (case.voids_index or case.zone != "safe") for case in cases]),
        avoided=ratios(hit, ideal, method),
        weight=column("weight"),
        index=column("index"),
        y=np.where(safe, 1.0, -1.0),  # the criterion itself decided the zone of each case: nothing is to be drawn
        boundary=np.zeros((len(cases), 0)),
        driver_error=driver_error,
        drivers=drivers,
    )


def influence(terms: CaseTerms, method: MethodSettings) -> FloatArray:
    """How many points of S each case moves, (n,): the first-order effect of its weight on C and D."""
    moved = np.zeros(len(terms.exposure))
    hit = np.isfinite(terms.avoided) & np.isfinite(terms.weight)
    if hit.any():
        r = terms.weight[hit] if terms.weight[hit].any() else np.ones(int(hit.sum()))
        c = float(weighted_mean(terms.avoided[hit], r, once(len(r)))[0])
        moved[hit] += method.score.a * method.score.k5 * r * (terms.avoided[hit] - c) / r.sum()
    counted = np.isfinite(terms.index) & (terms.y > 0.0)
    if counted.any() and not (terms.collided & (terms.y > 0.0)).any():
        p = terms.exposure[counted]
        d = exposure_weighted_index(terms.index[counted], p)
        moved[counted] += method.score.b * method.score.k6 * p * (terms.index[counted] - d) / p.sum()
    return moved


def driver_error(
    score: ScenarioResult, cases: Sequence[CaseResult], store: Store, settings: EvaluationSettings, zones: ZonePartition
) -> tuple[float, int]:
    """Standard error of D from the choice of drivers, by leaving each out in turn, and their number.

    The same driver is left out of all cases at once, because it is the same person; on a few evenly chosen cases, with
    slices as far apart as those of the drivers' own band.
    """
    safe = [case for case in cases if case.zone == "safe" and case.index is not None]
    if score.d is None or not safe:
        return 0.0, 0
    chosen = jackknifed(safe)
    names = {fact.case: fact.point for fact in store.facts("ads", score.scenario, score.ads)}
    drives: dict[int, dict[str, str]] = {}
    for fact in store.facts("human", score.scenario):
        if fact.status == "ok":
            drives.setdefault(fact.point, {})[fact.driver] = fact.case
    drivers = sorted({driver for case in chosen for driver in drives[names[case.case]]})
    if len(drivers) < 3:  # a deviation needs two that stay
        return 0.0, len(drivers)
    jobs = [
        PointJob(tuple(drives[names[case.case]].values()), zones.logical.road, left_out=(case.case,)) for case in chosen
    ]
    found = compute_points(store.path, jobs, settings.method.anthropomorphic, map, lambda done: None)
    without: dict[str, list[tuple[float, float]]] = {}
    for case, result in zip(chosen, found, strict=True):
        left_out, there = result.left_out[case.case], list(drives[names[case.case]])
        for driver in drivers:
            if driver not in there:
                without.setdefault(driver, []).append((left_out.everyone, case.exposure))
            elif left_out.without:
                without.setdefault(driver, []).append((left_out.without[there.index(driver)], case.exposure))
    weighted = [
        exposure_weighted_index(*np.array(pairs).T) for pairs in without.values() if np.array(pairs)[:, 1].any()
    ]
    return jackknife_error(weighted), len(weighted)
