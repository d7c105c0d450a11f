"""The ledger of a score: where every point went, term by term and case by case, adding up to the printed number.

That of S+ begins with what A = 1 and H = 1 would give, that of S with what C = 1 and D = 1 would give; off go what each
collision and each factor of a case's human-likeness cost. A case loses 1 minus the product of its factors. A factor's
part of that loss is its Shapley value (`score_terms.product_losses`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

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
from sumo_eval.scoring.kept_rows import OfSomeRows, arrays, name_ranks
from sumo_eval.scoring.outcome_columns import OutcomeColumns
from sumo_eval.settings import EvaluationSettings
from sumo_eval.trajectory import BoolArray, FloatArray

IntArray = NDArray[np.intp]
ROUNDING = 1e-9  # an index off the product of its factors by less is only rounding
WORTH_COUNTING = 1e-4  # of an index: a case that lost less is not one of the cases that lost


Term = Literal["A", "H", "C", "D"]


@dataclass(frozen=True, slots=True)
class Entry:
    """What one case adds to a line, in units of the index and in points of the score; both at most 0."""

    case: CaseResult
    index: float
    points: float


@dataclass(frozen=True, slots=True, eq=False)
class Entries(OfSomeRows[Entry]):
    """What cases add to a line, the costliest first. parts: in units of the index, (m,). scale: points of a unit."""

    parts: FloatArray
    scale: float

    def _made(self, place: int) -> Entry:
        part = float(self.parts[place])
        return Entry(self._row(place), part, part * self.scale)


NOBODY: Final = Entries((), np.empty(0, dtype=np.intp), np.empty(0), 1.0)


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
    entries: Entries = NOBODY

    @property
    def cases(self) -> int:
        """Number of cases that lost something worth counting."""
        return int(np.count_nonzero(self.entries.parts <= -WORTH_COUNTING))


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
        *_scaled("A", whole.a, cases, _avoided_lines(score, cases, settings)),
        *_scaled("H", whole.h, cases, _human_lines(score, cases)),
    )
    return Ledger("S+", score.ads, score.scenario, lines, _total(lines))


def ledger(evaluation: Evaluation, score: ScenarioResult) -> Ledger:
    """Every term, scale and correction of S, Eq. 18."""
    settings, cases = evaluation.settings, cases_of(evaluation, score)
    whole = worth(settings.method.score)
    lines = (
        *_scaled("C", whole.c, cases, _collision_lines(score, cases, settings)),
        *_scaled("D", whole.d, cases, _likeness_lines(score, cases)),
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


_Parts = tuple[IntArray, FloatArray]
"""Places of cases, and what each adds to a line in units of the index: (m,) each."""
_NONE: Final[_Parts] = (np.empty(0, dtype=np.intp), np.empty(0))
_Lines = Iterable[tuple[str, str, float, _Parts]]
"""(equation, words, index where there are no cases, what its cases add)."""


def _scaled(term: Term, scale: float, cases: Sequence[CaseResult], lines: _Lines) -> list[Line]:
    scaled, ranks = [], name_ranks(cases, np.arange(len(cases)))
    for equation, words, alone, (places, parts) in lines:
        index = math.fsum(map(float, parts)) if len(places) else alone
        order = np.lexsort((ranks[places], parts))
        entries = Entries(cases, places[order], parts[order], scale)
        scaled.append(Line(term, equation, words, index, index * scale, entries))
    return scaled


def _avoided_lines(score: ScenarioResult, cases: Sequence[CaseResult], settings: EvaluationSettings) -> _Lines:
    yield "", "A = 1, no collision is harder than the ideal vehicle's", 1.0, _NONE
    if score.avoided_share is None:
        yield "", "A not computed", -1.0, _NONE
        return
    there = OutcomeColumns.of(cases)
    losses = avoided_share_losses(case_terms(cases, settings.method, there))
    groups = (
        ("collisions that the ADS caused: doing nothing has none", there.caused),
        ("collisions that the ideal vehicle avoids", there.avoidable & ~there.caused),
        ("collisions that the ideal vehicle has too, but softer", there.unavoidable),
    )
    for words, belongs in groups:
        places = np.flatnonzero(belongs & (losses > 0.0))
        if len(places):
            yield "", words, 0.0, (places, -losses[places])
    if score.avoided_share < 0.0:
        yield "", "A is below 0, worse than doing nothing, and S+ takes 0", -score.avoided_share, _NONE


def _human_lines(score: ScenarioResult, cases: Sequence[CaseResult]) -> _Lines:
    yield "", "H = 1, as people drive in every safe case", 1.0, _NONE
    if score.human_likeness is None:
        yield "", f"H not computed: {reason_without_h(score)}", -1.0, _NONE
        return
    counted = np.isfinite(arrays(cases, "human_likeness")["human_likeness"])
    weights, collided = _shares(cases, counted), OutcomeColumns.of(cases).collided
    hits = np.flatnonzero(counted & collided)
    if len(hits):
        yield "", "a collision in a safe case that the ideal vehicle avoids", 0.0, (hits, -weights[hits])
    yield from _factor_lines(cases, np.flatnonzero(counted & ~collided), weights, "human_likeness")


def _collision_lines(score: ScenarioResult, cases: Sequence[CaseResult], settings: EvaluationSettings) -> _Lines:
    yield "17", "C = 1, no collision or none worse than the ideal vehicle's", 1.0, _NONE
    if score.c is None:
        yield "17", "C not computed", -1.0, _NONE
        return
    there, shares = OutcomeColumns.of(cases), collision_shares(cases, settings)
    hits = np.nan_to_num(there.ideal) != 0.0
    groups = (
        ("collisions in the safe zone", there.safe),
        ("collisions that the ideal vehicle avoids", ~there.safe & ~hits),
        ("collisions that the ideal vehicle only softens", ~there.safe & hits),
    )
    for words, belongs in groups:
        part = belongs[shares.places] & np.isfinite(shares.lost)
        if part.any():
            yield "14–17", words, 0.0, (shares.places[part], -shares.lost[part])


def _likeness_lines(score: ScenarioResult, cases: Sequence[CaseResult]) -> _Lines:
    yield "13", "D = 1, within the drivers' own spread everywhere", 1.0, _NONE
    there = OutcomeColumns.of(cases)
    if score.d is None:
        hits = np.flatnonzero(there.voids_index)
        each = np.full(len(hits), -1.0 / max(len(hits), 1))
        yield "18", f"D not computed: {reason_without_d(score)}", -1.0, (hits, each)
        return
    indexed = there.counts_for_index & np.isfinite(arrays(cases, "index")["index"])
    yield from _factor_lines(cases, np.flatnonzero(indexed), _shares(cases, indexed), "index")


def _shares(cases: Sequence[CaseResult], counted: BoolArray) -> FloatArray:
    """What each case weighs in a mean over those that are counted, (n,)."""
    weights = np.zeros(len(counted))
    weights[counted] = mean_shares(arrays(cases, "exposure")["exposure"][counted])
    return weights


def _factor_lines(
    cases: Sequence[CaseResult], places: IntArray, weights: FloatArray, what: Literal["index", "human_likeness"]
) -> _Lines:
    """A line for each factor of D_i, or of a case's human-likeness. weights: each case's share of the mean, (n,)."""
    if not len(places):
        return
    factors, equation = (FACTORS, "11–13") if what == "index" else (LIKENESS_FACTORS, "")
    read, share = arrays(cases, what, *(field for field, _ in factors.values())), weights[places]
    values = np.column_stack([read.pop(field)[places] for field, _ in factors.values()])  # no column is held twice
    losses = product_losses(values)
    for column, name in enumerate(factors):
        label = name if name in ("similarity", "plausibility") else f"{name} factor"
        yield equation, label, 0.0, (places, -share * losses[:, column])
    rest = share * (read[what][places] - values.prod(axis=1))
    if (np.abs(rest) > ROUNDING).any():
        yield equation, "what is not the product of the factors", 0.0, (places, rest)
