"""Preventability: the outcome of every case beside that of a reference in the same concrete
scenario.

The question of type approval (UN Regulation No. 157): a collision that a careful and competent
driver avoids must not happen. Leaving the road and giving up are incidents as a collision is, and U
counts them. The reference is an ADS of the same run, `[report] reference`, or the ideal vehicle
where the run has none. Users: `report/`, `extras/figures/`.
"""

from collections import Counter
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sumo_eval.case_table import CaseTable, point_numbers
from sumo_eval.frozen import frozen
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.settings import EvaluationSettings
from sumo_eval.trajectory import BoolArray

Verdict = Literal["avoided", "better", "preventable", "unpreventable", "undecided", "not evaluated"]


@frozen
class Preventability:
    """One ADS in one logical scenario beside the reference, in numbers of cases.

    cases = avoided + incidents + not_evaluated. incidents (U > 0) = preventable (the reference has
    none) + unpreventable (it has one too) + undecided (its case has no outcome).

    better: those of the avoided in which the reference has an incident.
    collided, off_road, gave_up: incidents of each kind; one case may hold two.
    """

    ads: str
    scenario: str
    cases: int
    avoided: int
    better: int
    incidents: int
    preventable: int
    unpreventable: int
    undecided: int
    not_evaluated: int
    collided: int
    off_road: int
    gave_up: int


def reference_ads(settings: EvaluationSettings) -> str | None:
    """Name of the ADS whose name, or else controller, is the setting `[report] reference`.

    None: ideal vehicle.
    """
    wanted = settings.report.reference
    by_key = (
        ads.name
        for key in ("name", "controller")
        for ads in settings.ads
        if getattr(ads, key) == wanted
    )
    return next(by_key, None)


def verdicts(evaluation: Evaluation, score: ScenarioResult) -> NDArray[np.str_]:
    """The verdict on every case of one ADS in one scenario, (n,)."""
    cases = evaluation.cases_behind(score)
    reference = reference_ads(evaluation.settings)
    # The ideal vehicle drove every point once, so each row has its outcome: 1, 0, nan where it is
    # not known. Its contacts alone count (Ug): it hardly steers, and leaves roads that drivers stay
    # on.
    beside = cases.ideal_collided
    if reference is not None:
        other = evaluation.cases_of(reference, score.scenario)
        points, other_points = point_numbers([cases, other])
        incidents = np.full(len(cases) + len(other), np.nan)  # by number of the point
        incidents[other_points] = np.where(other.counted, _incident(other), np.nan)
        beside = incidents[points]
    # texts as long as the longest verdict
    verdict_of = np.full(len(cases), "avoided", f"U{max(map(len, get_args(Verdict)))}")
    rules = (
        ("better", beside == 1.0),
        ("preventable", _incident(cases)),
        ("unpreventable", _incident(cases) & (beside == 1.0)),
        ("undecided", _incident(cases) & np.isnan(beside)),
        ("not evaluated", ~cases.counted),
    )
    for verdict, holds in rules:  # of several that hold the last one counts
        verdict_of[holds] = verdict
    return verdict_of


def _incident(cases: CaseTable) -> BoolArray:
    """Cases with U > 0, (n,), also those whose centre left the road, whatever the margin."""
    return np.asarray(cases.incident | cases.off_road)


def preventability(evaluation: Evaluation) -> tuple[Preventability, ...]:
    """The counts of every ADS in every logical scenario, in the order of the scores."""
    return tuple(preventability_of(evaluation, score) for score in evaluation.scores)


def preventability_of(evaluation: Evaluation, score: ScenarioResult) -> Preventability:
    """The counts of one ADS in one scenario."""
    cases = evaluation.cases_behind(score)
    count = Counter(verdicts(evaluation, score).tolist())
    return Preventability(
        ads=score.ads,
        scenario=score.scenario,
        cases=len(cases),
        avoided=count["avoided"] + count["better"],
        better=count["better"],
        incidents=count["preventable"] + count["unpreventable"] + count["undecided"],
        preventable=count["preventable"],
        unpreventable=count["unpreventable"],
        undecided=count["undecided"],
        not_evaluated=count["not evaluated"],
        collided=int(cases.collided.sum()),
        off_road=int((cases.departed | cases.off_road).sum()),
        gave_up=int(cases.gave_up.sum()),
    )
