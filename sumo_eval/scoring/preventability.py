"""Preventability: the outcome of every case compared with that of a reference in the same concrete
scenario.

Type approval (UN Regulation No. 157) asks that no collision happens which a careful and competent
driver avoids. Here a collision, leaving the road and giving up are all incidents. The reference is
an ADS of the same run, `[report] reference`, or the ideal vehicle if the run has no such ADS.

Users: `report/`, `extras/figures/`. Fixed: the verdicts, which stand in the report's data.
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

CaseVerdict = Literal[
    "avoided", "better", "preventable", "unpreventable", "undecided", "not evaluated"
]


@frozen
class Preventability:
    """One ADS in one logical scenario compared with the reference, in numbers of cases.

    cases: all cases = avoided + incidents + not_evaluated.
    avoided: the ADS has no incident.
    better: of these, the cases in which the reference has an incident.
    incidents: cases with an incident = preventable + unpreventable + undecided.
    preventable: the reference has no incident.
    unpreventable: the reference has an incident too.
    undecided: the reference's case has no outcome.
    not_evaluated: the ADS's case has no outcome.
    collided, off_road, gave_up: cases with an incident of each kind; one case may have two kinds.
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
    """Name of the ADS whose name, or else controller, is the setting `[report] reference`. None:
    the ideal vehicle.
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
    # Whether the reference has an incident at the point of each case: 1, 0, nan if not known. Each
    # row has the outcome of the ideal vehicle. Of that only contacts count, as in Ug: the ideal
    # vehicle hardly steers, and leaves roads on which drivers stay.
    beside = cases.ideal_collided
    if reference is not None:
        other = evaluation.cases_of(reference, score.scenario)
        points, other_points = point_numbers([cases, other])
        incidents = np.full(len(cases) + len(other), np.nan)  # by number of the point
        incidents[other_points] = np.where(other.counted, _incident(other), np.nan)
        beside = incidents[points]
    # numpy's texts have a fixed length: that of the longest verdict
    verdict_of = np.full(len(cases), "avoided", f"U{max(map(len, get_args(CaseVerdict)))}")
    rules = (
        ("better", beside == 1.0),
        ("preventable", _incident(cases)),
        ("unpreventable", _incident(cases) & (beside == 1.0)),
        ("undecided", _incident(cases) & np.isnan(beside)),
        ("not evaluated", ~cases.counted),
    )
    for verdict, holds in rules:  # of several rules that hold the last one counts
        verdict_of[holds] = verdict
    return verdict_of


def _incident(cases: CaseTable) -> BoolArray:
    """Whether each case has an incident, or its centre left the road, whatever the margin, (n,)."""
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
