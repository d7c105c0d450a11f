"""The ledger of a score: where every point of S went, term by term and case by case, adding up to the printed number.

It begins with what C = 1 and D = 1 would give and takes off what each collision and each factor of D_i cost. A case's
loss 1 - f_L f_n similarity is shared among its factors by the mean over the orders in which they can be taken off
(the Shapley value), because a product has no order of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from sumo_eval.report.words import FACTORS, cases_of, collision_shares, count, reason_without_d
from sumo_eval.results import CaseResult, Evaluation, ScenarioResult
from sumo_eval.settings import EvaluationSettings

ROUNDING = 1e-9  # an index off the product of its factors by less is only rounding
WORTH_COUNTING = 1e-4  # of an index: a case that lost less is not one of the cases that lost


@dataclass(frozen=True, slots=True)
class Entry:
    """What one case adds to a line, in units of the index and in points of S; both at most 0."""

    case: CaseResult
    index: float
    points: float


@dataclass(frozen=True, slots=True)
class Line:
    """One term of the ledger. index: in units of C or D; points: of S. entries: its cases, the costliest first."""

    term: Literal["C", "D"]
    equation: str
    words: str
    index: float
    points: float
    entries: tuple[Entry, ...] = ()

    @property
    def cases(self) -> int:
        """Number of cases that lost something worth counting."""
        return sum(entry.index <= -WORTH_COUNTING for entry in self.entries)


@dataclass(frozen=True, slots=True)
class Ledger:
    """S of one ADS in one logical scenario. total: the sum of all points, S."""

    ads: str
    scenario: str
    lines: tuple[Line, ...]
    total: float

    def index(self, term: Literal["C", "D"]) -> float:
        """The sum of a term's lines in units of the index: C or D, 0 where it was not computed."""
        return math.fsum(line.index for line in self.lines if line.term == term)


def ledger(evaluation: Evaluation, score: ScenarioResult) -> Ledger:
    """Every term, scale and correction of one score."""
    settings, cases = evaluation.settings, cases_of(evaluation, score)
    terms = settings.method.score
    lines = (
        *_scaled("C", terms.a * terms.k5, _collision_lines(score, cases, settings)),
        *_scaled("D", terms.b * terms.k6, _likeness_lines(score, cases)),
    )
    return Ledger(score.ads, score.scenario, lines, math.fsum(line.points for line in lines))


def sentences(found: Ledger) -> list[str]:
    """The lines that cost points, the costliest first: `D lost 6.1 of 50 points: operations factor in 14 cases.`"""
    whole = {line.term: line.points for line in found.lines if line.index > 0.0}
    losses = sorted((line for line in found.lines if line.points < 0.0), key=lambda line: line.points)
    return [
        f"{line.term} lost {-line.points:.1f} of {whole[line.term]:g} points: {line.words}"
        + (f" in {count(line.cases, 'case')}" if line.cases else "")
        + "."
        for line in losses
        if line.points <= -0.05
    ]


_Lines = Iterable[tuple[str, str, float, list[tuple[CaseResult, float]]]]
"""(equation, words, index where there are no cases, [(case, index)])."""


def _scaled(term: Literal["C", "D"], scale: float, lines: _Lines) -> list[Line]:
    scaled = []
    for equation, words, alone, parts in lines:
        index = math.fsum(part for _, part in parts) if parts else alone
        costliest = sorted(parts, key=lambda item: (item[1], item[0].case))
        entries = tuple(Entry(case, part, part * scale) for case, part in costliest)
        scaled.append(Line(term, equation, words, index, index * scale, entries))
    return scaled


def _collision_lines(score: ScenarioResult, cases: Sequence[CaseResult], settings: EvaluationSettings) -> _Lines:
    yield "17", "C = 1, no collision or none worse than the ideal vehicle's", 1.0, []
    if score.c is None:
        yield "17", "C not computed", -1.0, []
        return
    groups: tuple[tuple[str, Callable[[CaseResult], bool]], ...] = (
        ("collisions in the safe zone", lambda case: case.zone == "safe"),
        ("collisions that the ideal vehicle avoids", lambda case: case.zone != "safe" and not case.ideal_severity),
        (
            "collisions that the ideal vehicle only softens",
            lambda case: case.zone != "safe" and bool(case.ideal_severity),
        ),
    )
    shares = [share for share in collision_shares(cases, settings) if share.lost is not None]
    for words, belongs in groups:
        parts = [(share.case, -(share.lost or 0.0)) for share in shares if belongs(share.case)]
        if parts:
            yield "14–17", words, 0.0, parts


def _likeness_lines(score: ScenarioResult, cases: Sequence[CaseResult]) -> _Lines:
    yield "13", "D = 1, within the drivers' own spread everywhere", 1.0, []
    if score.d is None:
        hits = [case for case in cases if case.voids_index]
        yield "18", f"D not computed: {reason_without_d(score)}", -1.0, [(case, -1.0 / len(hits)) for case in hits]
        return
    indexed = [case for case in cases if case.counts_for_index and case.index is not None]
    exposure = math.fsum(case.exposure for case in indexed)
    losses = [(case, case.exposure / exposure, _factor_losses(case)) for case in indexed]
    for name in FACTORS:
        label = "similarity" if name == "similarity" else f"{name} factor"
        yield "11–13", label, 0.0, [(case, -weight * found[name]) for case, weight, found in losses]
    rest = [(case, weight * ((case.index or 0.0) - 1.0 + math.fsum(found.values()))) for case, weight, found in losses]
    if any(abs(part) > ROUNDING for _, part in rest):
        yield "11–13", "what is not the product of the factors", 0.0, rest


def _factor_losses(case: CaseResult) -> dict[str, float]:
    """What each factor took from D_i; together 1 minus their product."""
    factors = {name: getattr(case, field) for name, (field, _) in FACTORS.items()}
    losses = {}
    for name, own in factors.items():
        one, other = (value for key, value in factors.items() if key != name)
        losses[name] = (1.0 - own) * (1.0 / 3.0 + (one + other) / 6.0 + one * other / 3.0)
    return losses
