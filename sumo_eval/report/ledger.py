"""The ledger of a score: where every point went, term by term and case by case, adding up to the printed number.

That of S+ begins with what A = 1 and H = 1 would give, that of S with what C = 1 and D = 1 would give; off go what each
collision and each factor of a case's human-likeness cost. A case loses 1 minus the product of its factors. A factor's
part of that loss is its Shapley value (`score_terms.product_losses`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sumo_eval.method.score_terms import mean_shares, product_losses, worth
from sumo_eval.report.words import (
    FACTORS,
    LIKENESS_FACTORS,
    cases_of,
    collision_shares,
    count,
    reason_without_d,
    reason_without_h,
)
from sumo_eval.results import CaseResult, Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import avoided_share_losses, case_terms
from sumo_eval.settings import EvaluationSettings

ROUNDING = 1e-9  # an index off the product of its factors by less is only rounding
WORTH_COUNTING = 1e-4  # of an index: a case that lost less is not one of the cases that lost


Term = Literal["A", "H", "C", "D"]


@dataclass(frozen=True, slots=True)
class Entry:
    """What one case adds to a line, in units of the index and in points of the score; both at most 0."""

    case: CaseResult
    index: float
    points: float


@dataclass(frozen=True, slots=True)
class Line:
    """One term of the ledger. index: in units of A, H, C or D; points: of S+ or S. entries: its cases, the costliest
    first. equation: its number in the paper; empty for what is not the paper's.
    """

    term: Term
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
    """A score of one ADS in one logical scenario. name: `S+` or `S`. total: the sum of all points, the score."""

    name: Literal["S+", "S"]
    ads: str
    scenario: str
    lines: tuple[Line, ...]
    total: float

    def index(self, term: Term) -> float:
        """The sum of a term's lines in units of the index: A (at least 0), H, C or D, 0 where it was not computed."""
        return math.fsum(line.index for line in self.lines if line.term == term)


def ledger_plus(evaluation: Evaluation, score: ScenarioResult) -> Ledger:
    """Every term of S+ = a max(A, 0) + b H."""
    settings, cases = evaluation.settings, cases_of(evaluation, score)
    whole = worth(settings.method.score)
    lines = (
        *_scaled("A", whole.a, _avoided_lines(score, cases, settings)),
        *_scaled("H", whole.h, _human_lines(score, cases)),
    )
    return Ledger("S+", score.ads, score.scenario, lines, _total(lines))


def ledger(evaluation: Evaluation, score: ScenarioResult) -> Ledger:
    """Every term, scale and correction of S, Eq. 18."""
    settings, cases = evaluation.settings, cases_of(evaluation, score)
    whole = worth(settings.method.score)
    lines = (
        *_scaled("C", whole.c, _collision_lines(score, cases, settings)),
        *_scaled("D", whole.d, _likeness_lines(score, cases)),
    )
    return Ledger("S", score.ads, score.scenario, lines, _total(lines))


def _total(lines: Iterable[Line]) -> float:
    """The sum of all points; rounding that would print as -0 is none."""
    total = math.fsum(line.points for line in lines)
    return 0.0 if abs(total) < ROUNDING else total


def sentences(found: Ledger) -> list[str]:
    """The lines that cost points, the costliest first: `H lost 6.1 of 50 points: plausibility in 14 cases.`"""
    whole = {line.term: line.points for line in found.lines if line.index > 0.0}
    losses = sorted((line for line in found.lines if line.points < 0.0), key=lambda line: line.points)
    return [
        f"{line.term} lost {-line.points:z.1f} of {whole[line.term]:g} points: {line.words}"
        + (f" in {count(line.cases, 'case')}" if line.cases else "")
        + "."
        for line in losses
        if line.points <= -0.05
    ]


_Lines = Iterable[tuple[str, str, float, list[tuple[CaseResult, float]]]]
"""(equation, words, index where there are no cases, [(case, index)])."""


def _scaled(term: Term, scale: float, lines: _Lines) -> list[Line]:
    scaled = []
    for equation, words, alone, parts in lines:
        index = math.fsum(part for _, part in parts) if parts else alone
        costliest = sorted(parts, key=lambda item: (item[1], item[0].case))
        entries = tuple(Entry(case, part, part * scale) for case, part in costliest)
        scaled.append(Line(term, equation, words, index, index * scale, entries))
    return scaled


def _avoided_lines(score: ScenarioResult, cases: Sequence[CaseResult], settings: EvaluationSettings) -> _Lines:
    yield "", "A = 1, no collision is harder than the ideal vehicle's", 1.0, []
    if score.avoided_share is None:
        yield "", "A not computed", -1.0, []
        return
    losses = avoided_share_losses(case_terms(cases, settings.method)).tolist()
    lost = [(case, -loss) for case, loss in zip(cases, losses, strict=True) if loss > 0.0]
    groups: tuple[tuple[str, Callable[[CaseResult], bool]], ...] = (
        ("collisions that the ADS caused: doing nothing has none", lambda case: case.caused),
        ("collisions that the ideal vehicle avoids", lambda case: case.avoidable and not case.caused),
        ("collisions that the ideal vehicle has too, but softer", lambda case: case.unavoidable),
    )
    for words, belongs in groups:
        parts = [(case, loss) for case, loss in lost if belongs(case)]
        if parts:
            yield "", words, 0.0, parts
    if score.avoided_share < 0.0:
        yield "", "A is below 0, worse than doing nothing, and S+ takes 0", -score.avoided_share, []


def _human_lines(score: ScenarioResult, cases: Sequence[CaseResult]) -> _Lines:
    yield "", "H = 1, as people drive in every safe case", 1.0, []
    if score.human_likeness is None:
        yield "", f"H not computed: {reason_without_h(score)}", -1.0, []
        return
    counted = [case for case in cases if case.human_likeness is not None]
    weights = _shares(counted)
    hits = [case for case in counted if case.collided]
    if hits:
        yield (
            "",
            "a collision in a safe case that the ideal vehicle avoids",
            0.0,
            [(case, -weights[case.case]) for case in hits],
        )
    yield from _factor_lines([case for case in counted if not case.collided], weights, "human_likeness")


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
    yield from _factor_lines(indexed, _shares(indexed), "index")


def _shares(cases: Sequence[CaseResult]) -> dict[str, float]:
    """What each case weighs in a mean over them, by case."""
    shares = mean_shares([case.exposure for case in cases]).tolist()
    return {case.case: share for case, share in zip(cases, shares, strict=True)}


def _factor_lines(
    cases: Sequence[CaseResult], weights: Mapping[str, float], what: Literal["index", "human_likeness"]
) -> _Lines:
    """A line for each factor of D_i, or of a case's human-likeness. weights: the case's share of the mean, by case."""
    if not cases:
        return
    factors, equation = (FACTORS, "11–13") if what == "index" else (LIKENESS_FACTORS, "")
    values = np.array([[getattr(case, field) for field, _ in factors.values()] for case in cases], dtype=np.float64)
    losses = product_losses(values)
    for column, name in enumerate(factors):
        label = name if name in ("similarity", "plausibility") else f"{name} factor"
        yield (
            equation,
            label,
            0.0,
            [(case, -weights[case.case] * loss) for case, loss in zip(cases, losses[:, column].tolist(), strict=True)],
        )
    rest = [
        (case, weights[case.case] * (getattr(case, what) - product))
        for case, product in zip(cases, values.prod(axis=1).tolist(), strict=True)
    ]
    if any(abs(part) > ROUNDING for _, part in rest):
        yield equation, "what is not the product of the factors", 0.0, rest
