"""The ledger of a score: where every point went, term by term and case by case. Its lines add up to
the printed score.

S+ is 100 times the product of T, A' and (a + b H) / 100. The ledger begins with 100 points. Each of
the three factors takes its Shapley value (`score_terms.product_losses`) from them. The cases share
a factor's value in proportion to their losses in T, A or H.

S begins with the points for C = 1 and D = 1. Each collision takes its loss of C, each factor of a
case's D_i its part of the case's loss of D. A case loses 1 minus the product of its factors; a
factor's part of this loss is its Shapley value.

Users: `extras/figures/of_scores.py`, `report/sections.py`, `report/terminal.py`. Fixed: the sum of
the lines is the score. Free to change: causes in words.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.frozen import frozen
from sumo_eval.method.score_terms import product_losses, worth
from sumo_eval.results import ScenarioResult
from sumo_eval.scoring.findings import FACTORS, LIKENESS_FACTORS, NOTICEABLE, Findings
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

FULL = 100.0  # points of S+ at most
ROUNDING = 1e-9  # of an index or of points; less is only rounding
WORTH_COUNTING = 1e-4  # of an index; `LedgerLine.cases` counts cases that lost at least this
NOT_COMPUTED = "not computed"  # cause of a line that takes a whole term

Term = Literal["S+", "T", "A", "H", "C", "D"]


@frozen
class LedgerLine:
    """One line of the ledger.

    term: the index that the line belongs to; `S+` for the line with all points.
    cause: why the points were gained or lost, in words, or `NOT_COMPUTED`.
    index: contribution of the line to T, A, H, C or D; a loss is negative.
    entries: the m cases of the line, the costliest first.
    parts: contribution of each case to the index, (m,); a loss is negative.
    cases: number of these cases that lost at least `WORTH_COUNTING` of the index. Two terms differ:
        T counts cases with t_i below 1 - `NOTICEABLE`, and A counts every case that lost anything,
        also a light collision.
    equation: number in the paper; empty for a term that is not the paper's.
    scale: points of S+ or S for 1 of the index.
    """

    term: Term
    cause: str
    index: float
    entries: CaseTable
    parts: FloatArray
    cases: int
    equation: str
    scale: float = 1.0

    @property
    def points(self) -> float:
        """Points of S+ or S."""
        return self.index * self.scale

    def worst(self, most: int) -> Iterator[tuple[CaseResult, float]]:
        """The costliest cases that lost anything, at most `most`, each with its points, below 0."""
        points = (self.parts[:most] * self.scale).tolist()
        pairs = zip(self.entries[:most], points, strict=True)
        return ((case, lost) for case, lost in pairs if lost < 0.0)


class Ledger(NamedTuple):
    """Ledger of one score of one ADS in one logical scenario."""

    name: Literal["S+", "S"]
    score: ScenarioResult
    lines: tuple[LedgerLine, ...]

    @property
    def total(self) -> float:
        """The sum of all points, which is the score; 0 if only rounding is left, so that no -0 is
        printed.
        """
        total = math.fsum(line.points for line in self.lines)
        return 0.0 if abs(total) < ROUNDING else total


_NO_CASES: Any = np.empty(0, dtype=np.intp)  # rows, and losses, of a line without cases
_Lines = Iterable[LedgerLine]


def ledger_plus(findings: Findings) -> Ledger:
    """The ledger of S+ = T max(A', 0) (a + b H): 100 points, less what each of T, A' and
    (a + b H) / 100 takes.
    """
    score, weights = findings.score, findings.method.score
    grade = max(score.avoidance_grade or 0.0, 0.0)
    manner = (weights.a + weights.b * (score.human_likeness or 0.0)) / FULL
    losses = product_losses(np.array([[score.task_share or 0.0, grade, manner]]))[0] * FULL

    whole = _line(
        findings, "S+", "the task driven without avoidable harm, as people drive", alone=1.0
    )
    lines = _scaled(FULL, [whole])
    factors = _task_lines, _avoided_lines, _human_lines
    for lines_of, lost in zip(factors, losses.tolist(), strict=True):
        of_factor = list(lines_of(findings))
        # `lost`: points that the factor takes, its Shapley value; the lines of its index share them
        lost_of_index = -math.fsum(line.index for line in of_factor)
        lines += _scaled(lost / lost_of_index if lost_of_index > 0.0 else 0.0, of_factor)
    return Ledger("S+", score, tuple(lines))


def ledger(findings: Findings) -> Ledger:
    """The ledger of S, Eq. 18: points for C = 1 and D = 1, less what collisions and the factors of
    D_i take.
    """
    points = worth(findings.method.score)  # points of S for C = 1 and for D = 1
    lines = _scaled(points.c, _collision_lines(findings)) + _scaled(
        points.d, _likeness_lines(findings)
    )
    return Ledger("S", findings.score, tuple(lines))


def _scaled(scale: float, lines: _Lines) -> list[LedgerLine]:
    """The lines with this scale."""
    return [replace(line, scale=scale) for line in lines]


def _line(
    findings: Findings, term: Term, cause: str, places: IntArray = _NO_CASES, *,
    lost: FloatArray = _NO_CASES, alone: float = 0.0, equation: str = "",
) -> LedgerLine:  # fmt: skip
    """A line of the ledger, with scale 1.

    places: rows of its cases, (m,).
    lost: loss of each case in the index, (m,).
    alone: contribution to the index if the line has no cases.
    """
    entries = findings.cases[places]
    order = np.lexsort((entries.case, -lost))  # the largest loss first, then by name
    index = math.fsum(-lost) if len(places) else alone
    number = int(np.count_nonzero(lost >= WORTH_COUNTING))
    return LedgerLine(term, cause, index, entries[order], -lost[order], number, equation)


def _task_lines(findings: Findings) -> _Lines:
    """Losses in T, a line for each cause. A case belongs to the first cause that applies."""
    cases = findings.cases
    if findings.score.task_share is None:
        yield _line(findings, "T", NOT_COMPUTED, alone=-1.0)
        return
    task_shares = cases.task_share
    lost = np.nan_to_num(findings.shares(findings.tasked, cases.exposure) * (1.0 - task_shares))
    groups = {
        "given up": cases.gave_up,
        "a contact": cases.collided,
        "struck from behind, which ends the drive": cases.struck_from_behind,
        "left the road": cases.departed,
        "stands where the references drive": findings.stands,
        "slower than the slowest reference": lost > 0.0,  # every remaining loss
    }
    yield from _first_of(findings, "T", groups, lost, task_shares < 1.0 - NOTICEABLE)


def _first_of(
    findings: Findings,
    term: Term,
    groups: Mapping[str, BoolArray],
    lost: FloatArray,
    noticeable: BoolArray,
) -> _Lines:
    """A line for each group, with those cases that lost something and are in no earlier group.

    groups: cause -> whether each case belongs to it, (n,).
    lost: loss of each case in the index, (n,).
    noticeable: whether a line's `cases` counts each case, (n,).
    """
    remaining = lost > 0.0
    for cause, belongs in groups.items():
        places = np.flatnonzero(belongs & remaining)
        remaining = remaining & ~belongs
        if len(places):
            line = _line(findings, term, cause, places, lost=lost[places])
            yield replace(line, cases=int(np.count_nonzero(noticeable[places])))


def _avoided_lines(findings: Findings) -> _Lines:
    """Losses in A, a line for each cause. A case belongs to the first cause that applies."""
    cases = findings.cases
    if findings.score.avoided_share is None:
        yield _line(findings, "A", NOT_COMPUTED, alone=-1.0)
        return
    lost = np.nan_to_num(findings.share_lost)
    # every incident is in one of these groups
    groups = {
        # not if the ADS left the road before, with a U above U0: then "left the road" has the case
        "given up, which counts as doing nothing": cases.gave_up
        & (cases.incident_severity <= cases.no_reaction_severity),
        "collisions that the ADS caused: a vehicle that does nothing has none": cases.caused,
        "collisions that the ideal vehicle avoids": cases.avoidable,
        "collisions that the ideal vehicle has too, but softer": cases.unavoidable,
        "left the road": cases.departed,
    }
    yield from _first_of(findings, "A", groups, lost, lost > ROUNDING)


def _human_lines(findings: Findings) -> _Lines:
    """Losses in H: by incidents, then by the factors of all other cases."""
    cases, counted = findings.cases, findings.likened  # counted: has a human-likeness
    if findings.score.human_likeness is None:
        yield _line(findings, "H", NOT_COMPUTED, alone=-1.0)
        return
    weights, incident = findings.shares(counted, cases.exposure), cases.incident
    hits = np.flatnonzero(counted & incident)
    if len(hits):
        cause = "an avoidable incident in a safe case"
        yield _line(findings, "H", cause, hits, lost=weights[hits])
    yield from _factor_lines(findings, "H", np.flatnonzero(counted & ~incident), weights)


def _collision_lines(findings: Findings) -> _Lines:
    """C = 1, and losses in C by collisions (Eqs. 14-17)."""
    whole = "C = 1, no collision or none worse than the ideal vehicle's"
    yield _line(findings, "C", whole, alone=1.0, equation="17")
    if findings.score.c is None:
        yield _line(findings, "C", NOT_COMPUTED, alone=-1.0, equation="17")
        return
    lost, safe = findings.lost_of_c, findings.cases.safe
    ideal_collides = np.nan_to_num(findings.cases.ideal_severity) != 0.0
    groups = (
        ("collisions in the safe zone", safe),
        ("collisions that the ideal vehicle avoids", ~safe & ~ideal_collides),
        ("collisions that the ideal vehicle only softens", ~safe & ideal_collides),
    )
    for cause, belongs in groups:
        # cases without a collision or a known Ug have no part in C: their loss is nan
        places = np.flatnonzero(belongs & np.isfinite(lost))
        if len(places):
            yield _line(findings, "C", cause, places, lost=lost[places], equation="14–17")


def _likeness_lines(findings: Findings) -> _Lines:
    """D = 1, and losses in D by the factors of D_i (Eqs. 11-13)."""
    cases = findings.cases
    whole = "D = 1, within the drivers' own spread everywhere"
    yield _line(findings, "D", whole, alone=1.0, equation="13")
    if findings.score.d is None:
        # Without D its term of S is 0 (Eq. 18), so this line takes the 1 of the line above. If
        # collisions void D, they share it equally, because each of them alone does so. If D does
        # not exist for another reason, the line has no cases.
        reason = findings.score.d_reason
        voided = reason is not None and reason.why == "collisions"
        hits = np.flatnonzero(cases.voids_index & voided)
        each = np.full(len(hits), 1.0 / max(len(hits), 1))
        yield _line(findings, "D", NOT_COMPUTED, hits, lost=each, alone=-1.0, equation="18")
        return
    shares = findings.shares(findings.indexed, cases.exposure)
    yield from _factor_lines(findings, "D", np.flatnonzero(findings.indexed), shares)


def _factor_lines(
    findings: Findings, term: Literal["D", "H"], places: IntArray, weights: FloatArray
) -> _Lines:
    """A line for each factor of D_i (term "D"), or of a case's human-likeness (term "H").

    places: rows of the cases, (m,).
    weights: share of each of all n cases in the mean, (n,).
    """
    if not len(places):
        return
    cases = findings.cases
    factors = LIKENESS_FACTORS
    equation = ""
    likeness = cases.human_likeness
    if term == "D":
        factors = FACTORS
        equation = "11–13"
        likeness = cases.index
    share = weights[places]
    # (m, factors)
    values = np.column_stack([getattr(cases, field)[places] for field in factors.values()])
    losses = product_losses(values)
    for column, name in enumerate(factors):
        cause = name if name in ("similarity", "plausibility") else f"{name} factor"
        lost = share * losses[:, column]
        yield _line(findings, term, cause, places, lost=lost, equation=equation)
    # by how much the index of each case is below the product of its factors; below 0: a gain
    rest = share * (values.prod(axis=1) - likeness[places])
    if (np.abs(rest) > ROUNDING).any():
        cause = "the rest, not a product of the factors"
        yield _line(findings, term, cause, places, lost=rest, equation=equation)
