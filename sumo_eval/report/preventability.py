"""Preventability: what became of every case beside what a reference driver made of the same concrete scenario.

The question of type approval (UN Regulation No. 157): a collision that a careful and competent driver avoids must not
happen. The reference is an ADS of the same run, `[report] reference`, or the ideal vehicle where the run has none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args, overload

import numpy as np
from numpy.typing import NDArray

from sumo_eval.results import CaseResult, Evaluation, ScenarioResult
from sumo_eval.scoring.kept_rows import arrays, point_numbers
from sumo_eval.scoring.outcome_columns import OutcomeColumns
from sumo_eval.settings import EvaluationSettings
from sumo_eval.trajectory import BoolArray, FloatArray

Verdict = Literal["avoided", "better", "preventable", "unpreventable", "undecided", "off road", "not evaluated"]


@dataclass(frozen=True, slots=True)
class Look:
    """How a verdict appears: words, the letter in a cell of the map (so that nothing hangs on colour), colours."""

    words: str
    letter: str
    colour: str
    ink: str


LOOKS: Mapping[Verdict, Look] = {
    "avoided": Look("avoided", "", "#d3e6f3", "#1b1f24"),
    "better": Look("avoided, the reference collided", "+", "#2b74a8", "#ffffff"),
    "preventable": Look("preventable collision", "P", "#b23c00", "#ffffff"),
    "unpreventable": Look("unpreventable collision", "U", "#f2b97c", "#1b1f24"),
    "undecided": Look("collision, reference not known", "?", "#e0cfdc", "#1b1f24"),
    "off road": Look("off road", "R", "#8a3d74", "#ffffff"),
    "not evaluated": Look("not evaluated", "–", "#69727c", "#ffffff"),
}


@dataclass(frozen=True, slots=True)
class Preventability:
    """One ADS in one logical scenario beside the reference, in numbers of cases.

    cases = avoided + collided + off_road + not_evaluated. collided = preventable (the reference avoided) +
    unpreventable (it collided too) + undecided (its case has no outcome, or it left the road). better: those of the
    avoided in which the reference collided.
    """

    ads: str
    scenario: str
    cases: int
    avoided: int
    better: int
    collided: int
    preventable: int
    unpreventable: int
    undecided: int
    off_road: int
    not_evaluated: int


def reference_ads(settings: EvaluationSettings) -> str | None:
    """Name of the ADS that is the reference: the one that is called so, or has that controller. None: ideal vehicle."""
    wanted = settings.report.reference
    named = [ads.name for ads in settings.ads if ads.name == wanted]
    driven_by = [ads.name for ads in settings.ads if ads.controller == wanted]
    return next(iter((*named, *driven_by)), None)


def reference_sentence(settings: EvaluationSettings) -> str:
    """Who the reference is, and why."""
    ads = reference_ads(settings)
    if ads is not None:
        return f"The reference is “{ads}”, driven through the same concrete scenarios as every other ADS of this run."
    return (
        f"No ADS of this run is “{settings.report.reference}”, so the reference is the ideal vehicle, which brakes at "
        "once at the limit, driven through the same concrete scenarios."
    )


_CODES: Mapping[Verdict, int] = {verdict: code for code, verdict in enumerate(get_args(Verdict))}


@dataclass(frozen=True, slots=True, eq=False)
class Verdicts(Sequence[Verdict]):
    """The verdicts on many cases, in their order. codes: the place of each among all that there are, (n,)."""

    codes: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.codes)

    @overload
    def __getitem__(self, place: int) -> Verdict: ...

    @overload
    def __getitem__(self, place: slice) -> Verdicts: ...

    def __getitem__(self, place: int | slice) -> Verdict | Verdicts:
        return Verdicts(self.codes[place]) if isinstance(place, slice) else tuple(_CODES)[self.codes[place]]

    def numbers(self) -> dict[Verdict, int]:
        """How many cases have each verdict."""
        found = np.bincount(self.codes, minlength=len(_CODES)).tolist()
        return dict(zip(_CODES, found, strict=True))

    def among(self, *wanted: Verdict) -> BoolArray:
        """Which cases have one of these, (n,)."""
        return np.isin(self.codes, [_CODES[one] for one in wanted])


def verdicts(evaluation: Evaluation, score: ScenarioResult) -> Verdicts:
    """The verdict on every case of one ADS in one scenario."""
    cases, reference = evaluation.cases_of(score.ads, score.scenario), reference_ads(evaluation.settings)
    there = OutcomeColumns.of(cases)
    if reference is None:
        # The ideal vehicle drove every point once, so each row has its outcome: 1, 0, nan where it is not known.
        collided = arrays(cases, "ideal_collided")["ideal_collided"]
    else:
        collided = _outcomes_at(cases, evaluation.cases_of(reference, score.scenario))
    found = np.full(len(there.safe), _CODES["avoided"], dtype=np.uint8)
    rules: tuple[tuple[Verdict, BoolArray], ...] = (
        ("better", collided == 1.0),
        ("off road", there.off_road),
        ("preventable", there.collided),
        ("unpreventable", there.collided & (collided == 1.0)),
        ("undecided", there.collided & np.isnan(collided)),
        ("not evaluated", ~there.evaluated),
    )
    for verdict, holds in rules:  # of several that hold it is the last
        found[holds] = _CODES[verdict]
    return Verdicts(found)


def _outcomes_at(cases: Sequence[CaseResult], reference: Sequence[CaseResult]) -> FloatArray:
    """Whether the reference collided at the point of each case, (n,): 1 or 0, nan where it has no outcome there, or
    left the road, which shows neither.
    """
    if not len(reference):
        return np.full(len(cases), np.nan)
    there = OutcomeColumns.of(reference)
    known = there.evaluated & ~there.off_road
    at, its = point_numbers([cases, reference])
    found = np.full(int(max(at.max(initial=0), its.max(initial=0))) + 1, np.nan)
    found[its] = np.where(known, there.collided.astype(np.float64), np.nan)
    return np.asarray(found[at])


def preventability(evaluation: Evaluation) -> tuple[Preventability, ...]:
    """The counts of every ADS in every logical scenario, in the order of the scores."""
    rows = []
    for score in evaluation.scores:
        here = verdicts(evaluation, score)
        count = here.numbers()
        rows.append(
            Preventability(
                ads=score.ads,
                scenario=score.scenario,
                cases=len(here),
                avoided=count["avoided"] + count["better"],
                better=count["better"],
                collided=count["preventable"] + count["unpreventable"] + count["undecided"],
                preventable=count["preventable"],
                unpreventable=count["unpreventable"],
                undecided=count["undecided"],
                off_road=count["off road"],
                not_evaluated=count["not evaluated"],
            )
        )
    return tuple(rows)
