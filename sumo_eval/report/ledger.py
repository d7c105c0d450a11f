"""The ledger of a score: where every point went, term by term and case by case, adding up to the
printed number.

S+ is 100 times the product of T, A' and (a + b H) / 100. Each of the three costs its Shapley value
of 100 - S+, which its cases share by what they take from T, A and H.

S begins with what C = 1 and D = 1 would give. From it, each collision and each factor of a case's
D_i take their part. A case loses 1 minus the product of its factors. A factor's part of that loss
is its Shapley value (`score_terms.product_losses`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from sumo_eval.cases import CaseResult, CaseTable, IntArray
from sumo_eval.method.score_terms import mean_shares, product_losses, worth
from sumo_eval.report.words import (
    REASON_WITHOUT_T,
    count,
    reason_without,
)
from sumo_eval.scoring.findings import FACTORS, LIKENESS_FACTORS, NOTICEABLE, Findings
from sumo_eval.trajectory import BoolArray, FloatArray

FULL = 100.0  # points
ROUNDING = 1e-9  # of an index or of points: less is only rounding
WORTH_COUNTING = 1e-4  # of an index: a case that lost less is not one of the cases that lost


Term = Literal["S+", "T", "A", "H", "C", "D"]


@dataclass(frozen=True, slots=True)
class LedgerLine:
    """One term of the ledger.

    index: in units of T, A, H, C or D.
    points: of S+ or S.
    scale: points for 1 of the index.
    entries: its cases, the costliest first.
    parts: what each case adds to the index, (m,); a loss is negative.
    cases: number of those that lost something worth counting.
    equation: its number in the paper; empty for a term that is not the paper's.
    """

    term: Term
    equation: str
    words: str
    index: float
    points: float
    scale: float
    entries: CaseTable
    parts: FloatArray
    cases: int

    def worst(self, most: int) -> Iterator[tuple[CaseResult, float]]:
        """The costliest cases that cost anything, each with its points."""
        points = (self.parts[:most] * self.scale).tolist()
        return (
            (case, lost)
            for case, lost in zip(self.entries[:most], points, strict=True)
            if lost < 0.0
        )


@dataclass(frozen=True, slots=True)
class Ledger:
    """Ledger of one score of one ADS in one logical scenario.

    name: `S+` or `S`.
    total: the sum of all points, the score.
    """

    name: Literal["S+", "S"]
    ads: str
    scenario: str
    lines: tuple[LedgerLine, ...]
    total: float

    def index(self, term: Term) -> float:
        """The sum of a term's lines in units of the index.

        C or D (0 where not computed); for T, A and H, which only lose, the value less 1.
        """
        return math.fsum(line.index for line in self.lines if line.term == term)


def ledger_plus(found: Findings) -> Ledger:
    """100 points less what T, A' and (a + b H) / 100 take from S+ = T max(A', 0) (a + b H)."""
    score, cases, weights = found.score, found.cases, found.settings.method.score
    grade = max(score.avoidance_grade or 0.0, 0.0)
    manner = (weights.a + weights.b * (score.human_likeness or 0.0)) / FULL
    losses = product_losses(np.array([[score.task_share or 0.0, grade, manner]]))[0] * FULL

    terms: tuple[tuple[Term, float, _Lines], ...] = (
        ("T", float(losses[0]), list(_task_lines(found))),
        ("A", float(losses[1]), list(_avoided_lines(found))),
        ("H", float(losses[2]), list(_human_lines(found))),
    )
    whole = "", "the task driven without avoidable harm, as people drive", 1.0, _NONE
    lines = _scaled("S+", FULL, cases, [whole])
    for term, lost, parts in terms:
        # points for 1 of T, A or H, so that the lines of a term cost its Shapley value
        taken = -math.fsum(
            float(its.sum()) if len(its) else alone for _, _, alone, (_, its, _) in parts
        )
        lines += _scaled(term, lost / taken if taken > 0.0 else 0.0, cases, parts)
    return Ledger("S+", score.ads, score.scenario, tuple(lines), _total(lines))


def ledger(found: Findings) -> Ledger:
    """Every term, scale and correction of S, Eq. 18."""
    score, cases, whole = found.score, found.cases, worth(found.settings.method.score)
    lines = (
        *_scaled("C", whole.c, cases, _collision_lines(found)),
        *_scaled("D", whole.d, cases, _likeness_lines(found)),
    )
    return Ledger("S", score.ads, score.scenario, lines, _total(lines))


def _total(lines: Iterable[LedgerLine]) -> float:
    """The sum of all points; rounding that would print as -0 is none."""
    total = math.fsum(line.points for line in lines)
    return 0.0 if abs(total) < ROUNDING else total


def sentences(found: Ledger) -> list[str]:
    """The lines that cost points, the costliest first: `H lost 6.1 of 50 points: plausibility in 14
    cases.`
    """
    # terms of S begin with a line of gain, without cases
    whole = {
        line.term: line.points for line in found.lines if line.index > 0.0 and not line.entries
    }
    losses = sorted(
        (line for line in found.lines if line.points < 0.0), key=lambda line: line.points
    )
    return [
        f"{line.term} lost {-line.points:z.1f} of {whole.get(line.term, FULL):g} points: "
        f"{line.words}" + (f" in {count(line.cases, 'case')}" if line.cases else "") + "."
        for line in losses
        if line.points <= -0.05  # less would print as 0.0
    ]


_Parts = tuple[IntArray, FloatArray, int]
"""Places of cases, their additions to a line in units of the index, (m,) each, and its `cases`."""
_NONE: Final[_Parts] = (np.empty(0, dtype=np.intp), np.empty(0), 0)
_Lines = Iterable[tuple[str, str, float, _Parts]]
"""(equation, words, index where there are no cases, the parts of its cases)."""


def _parts(places: IntArray, lost: FloatArray) -> _Parts:
    return places, -lost, int(np.count_nonzero(lost >= WORTH_COUNTING))


def _scaled(term: Term, scale: float, cases: CaseTable, lines: _Lines) -> list[LedgerLine]:
    scaled, names = [], cases.case
    for equation, words, alone, (places, parts, number) in lines:
        index = math.fsum(map(float, parts)) if len(places) else alone
        order = np.lexsort((names[places], parts))  # by loss, then by name
        entries, parts = cases[places[order]], parts[order]
        scaled.append(
            LedgerLine(term, equation, words, index, index * scale, scale, entries, parts, number)
        )
    return scaled


def _task_lines(found: Findings) -> _Lines:
    cases = found.cases
    if found.score.task_share is None:
        yield "", f"T not computed: {REASON_WITHOUT_T}", -1.0, _NONE
        return
    shares = cases.task_share
    lost = np.nan_to_num(_shares(cases, cases.safe & np.isfinite(shares)) * (1.0 - shares))
    groups = {
        "given up": cases.gave_up,
        "a contact": cases.collided,
        "left the road": cases.departed,
        "stands where the references drive": found.stands,
        "slower than the slowest reference": lost > 0.0,  # all that are left
    }
    yield from _first_of(groups, lost, shares < 1.0 - NOTICEABLE)


def _first_of(groups: Mapping[str, BoolArray], lost: FloatArray, counts: BoolArray) -> _Lines:
    """A line for each group: the cases of it that lost something and are in no group before it.

    counts: which cases lost something worth counting, (n,).
    """
    left = lost > 0.0
    for words, belongs in groups.items():
        places = np.flatnonzero(belongs & left)
        left = left & ~belongs
        if len(places):
            yield "", words, 0.0, (places, -lost[places], int(np.count_nonzero(counts[places])))


def _avoided_lines(found: Findings) -> _Lines:
    cases = found.cases
    if found.score.avoided_share is None:
        yield "", "A not computed", -1.0, _NONE
        return
    lost = np.nan_to_num(found.share_lost)
    groups = {
        "given up, which counts as doing nothing": cases.gave_up,
        "collisions that the ADS caused: a vehicle that does nothing has none": cases.caused,
        "collisions that the ideal vehicle avoids": cases.avoidable,
        "collisions that the ideal vehicle has too, but softer": cases.unavoidable,
        "left the road": cases.departed,
    }
    yield from _first_of(groups, lost, lost >= WORTH_COUNTING)


def _human_lines(found: Findings) -> _Lines:
    score, cases = found.score, found.cases
    if score.human_likeness is None:
        yield "", f"H not computed: {reason_without('H', score)}", -1.0, _NONE
        return
    counted = found.likened
    weights, incident = _shares(cases, counted), cases.incident
    hits = np.flatnonzero(counted & incident)
    if len(hits):
        yield "", "an avoidable incident in a safe case", 0.0, _parts(hits, weights[hits])
    yield from _factor_lines(cases, np.flatnonzero(counted & ~incident), weights, "human_likeness")


def _collision_lines(found: Findings) -> _Lines:
    yield "17", "C = 1, no collision or none worse than the ideal vehicle's", 1.0, _NONE
    if found.score.c is None:
        yield "17", "C not computed", -1.0, _NONE
        return
    shares, safe = found.collisions, found.cases.safe
    ideal_collides = np.nan_to_num(found.cases.ideal_severity) != 0.0
    groups = (
        ("collisions in the safe zone", safe),
        ("collisions that the ideal vehicle avoids", ~safe & ~ideal_collides),
        ("collisions that the ideal vehicle only softens", ~safe & ideal_collides),
    )
    for words, belongs in groups:
        part = belongs[shares.places] & np.isfinite(shares.lost)
        if part.any():
            yield "14–17", words, 0.0, _parts(shares.places[part], shares.lost[part])


def _likeness_lines(found: Findings) -> _Lines:
    score, cases = found.score, found.cases
    yield "13", "D = 1, within the drivers' own spread everywhere", 1.0, _NONE
    if score.d is None:
        hits = np.flatnonzero(cases.voids_index)
        # one of them alone would take D: they share the loss equally
        each = np.full(len(hits), 1.0 / max(len(hits), 1))
        yield "18", f"D not computed: {reason_without('D', score)}", -1.0, _parts(hits, each)
        return
    indexed = cases.counts_for_index & np.isfinite(cases.index)
    yield from _factor_lines(cases, np.flatnonzero(indexed), _shares(cases, indexed), "index")


def _shares(cases: CaseTable, counted: BoolArray) -> FloatArray:
    """Weight of each case in a mean over those that are counted, (n,)."""
    weights = np.zeros(len(counted))
    weights[counted] = mean_shares(cases.exposure[counted])
    return weights


def _factor_lines(
    cases: CaseTable,
    places: IntArray,
    weights: FloatArray,
    what: Literal["index", "human_likeness"],
) -> _Lines:
    """A line for each factor of D_i, or of a case's human-likeness.

    weights: each case's share of the mean, (n,).
    """
    if not len(places):
        return
    factors, equation = (FACTORS, "11–13") if what == "index" else (LIKENESS_FACTORS, "")
    share = weights[places]
    values = np.column_stack([getattr(cases, field)[places] for field in factors.values()])
    losses = product_losses(values)
    for column, name in enumerate(factors):
        label = name if name in ("similarity", "plausibility") else f"{name} factor"
        yield equation, label, 0.0, _parts(places, share * losses[:, column])
    # by what the index is below the product of its factors; above: negative, a gain
    rest = share * (values.prod(axis=1) - getattr(cases, what)[places])
    if (np.abs(rest) > ROUNDING).any():
        yield equation, "the rest, not a product of the factors", 0.0, _parts(places, rest)
