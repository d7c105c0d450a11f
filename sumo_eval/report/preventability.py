"""Preventability: what became of every case beside what a reference driver made of the same concrete scenario.

The question of type approval (UN Regulation No. 157): a collision that a careful and competent driver avoids must not
happen. The reference is an ADS of the same run, `[report] reference`, or the ideal vehicle where the run has none.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from sumo_eval.results import CaseResult, Evaluation
from sumo_eval.settings import EvaluationSettings

Verdict = Literal["avoided", "better", "preventable", "unpreventable", "undecided", "off road", "not evaluated"]
Point = tuple[str, tuple[float, ...]]


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


def verdicts(evaluation: Evaluation) -> dict[str, Verdict]:
    """The verdict on every case, by case."""
    reference = reference_ads(evaluation.settings)
    if reference is None:
        collided = {_point(case): case.ideal_collided for case in evaluation.cases}
    else:
        collided = {_point(case): _outcome(case) for case in evaluation.cases if case.ads == reference}
    return {case.case: _verdict(case, collided.get(_point(case))) for case in evaluation.cases}


def preventability(evaluation: Evaluation) -> tuple[Preventability, ...]:
    """The counts of every ADS in every logical scenario, in the order of the scores."""
    found = verdicts(evaluation)
    rows = []
    for score in evaluation.scores:
        here = [found[case.case] for case in evaluation.cases_of(score.ads, score.scenario)]
        count = Counter(here)
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


def _verdict(case: CaseResult, reference_collided: bool | None) -> Verdict:
    if not case.evaluated:
        return "not evaluated"
    if case.collided:
        return "undecided" if reference_collided is None else "unpreventable" if reference_collided else "preventable"
    if case.status == "off_road":
        return "off road"
    return "better" if reference_collided else "avoided"


def _outcome(case: CaseResult) -> bool | None:
    """Whether the reference collided. None: no outcome, or it left the road, which shows neither."""
    return None if not case.evaluated or case.status == "off_road" else case.collided


def _point(case: CaseResult) -> Point:
    return case.scenario, tuple(case.values.values())
