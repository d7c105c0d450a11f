"""Contributions of each case to the scores, as arrays, and all scores of one sample of the cases
or of many. `scoring.quantities` makes the scores of a run here, `scoring.confidence` their
intervals, `scoring.comparison` the scores of paired cases.

Users: `nightly/`, `report/`, `scoring/`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.frozen import frozen
from sumo_eval.method import score_terms
from sumo_eval.method.collision_avoidance import collision_loss
from sumo_eval.settings import MethodSettings
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

SCORES = {
    "T": ("task_share", 3),
    "A": ("avoided_share", 3),
    "A'": ("avoidance_grade", 3),
    "regret": ("regret", 3),
    "H": ("human_likeness", 3),
    "S+": ("s_plus", 1),
    "C": ("c", 3),
    "D": ("d", 3),
    "S": ("s", 1),
}
"""The scores by the letters that people read: (field of ScenarioResult, digits).

Comparisons show one digit more.
"""
COMPUTED = (
    "c", "d", "s", "avoided_share", "avoided_share_exposure", "regret", "human_likeness",
    "task_share",
    "avoidance_grade", "s_plus", "collision_probability"
)  # fmt: skip
"""Values that `scores_of` computes, by the names of `ScenarioResult`."""
ScoreSamples = dict[str, FloatArray]
"""Each score in m samples, (m,), by its name."""
_SEVEREST = 100.0  # m/s, in the severest class of Eq. 14


@frozen(eq=False)
class CaseTerms:
    """The cases of one ADS in one logical scenario, arrays (n,); nan where a case has no part in a
    term.

    exposure: p_i.
    weight: r_i.
    severity: U_i of the worst incident, 0 without one, nan where the harness failed; with
        `loss = "class"` its class L, 0.1 without an incident.
    ideal: Ug_i in the same concrete scenario, or its class.
    unreacting: U0_i in the same concrete scenario, or its class.
    ratio: Ug_i/U_i of a contact, or that of the classes.
    collided: whether the case is a collision.
    evaluated: whether it was driven to an end that can be evaluated.
    index: D_i of a safe case that has one.
    likeness: human-likeness of a safe case that has one.
    voids: whether it is a collision after which there is no D.
    incident: whether it has an incident.
    counted: whether it was evaluated or the ADS gave up.
    task: t_i of a case in the mean T.
    """

    exposure: FloatArray
    weight: FloatArray
    severity: FloatArray
    ideal: FloatArray
    unreacting: FloatArray
    ratio: FloatArray
    collided: BoolArray
    evaluated: BoolArray
    index: FloatArray
    likeness: FloatArray
    voids: BoolArray
    incident: BoolArray
    counted: BoolArray
    task: FloatArray

    def part(self, rows: IntArray | BoolArray | slice) -> CaseTerms:
        """Terms of some of the cases."""
        return CaseTerms(*(getattr(self, item.name)[rows] for item in fields(self)))


def case_terms(cases: CaseTable | Sequence[CaseResult], method: MethodSettings) -> CaseTerms:
    """The terms of cases, in their order."""
    table = CaseTable.of(cases)
    return CaseTerms(
        exposure=table.exposure,
        weight=table.weight,
        severity=_compared(table.incident_severity, method),
        ideal=_compared(table.ideal_severity, method),
        unreacting=_compared(table.no_reaction_severity, method),
        ratio=ratios(
            np.where(table.collided, table.severity, np.nan), table.ideal_severity, method
        ),
        collided=table.collided,
        evaluated=table.evaluated,
        index=np.where(table.counts_for_index, table.index, np.nan),
        likeness=table.human_likeness,
        voids=table.voids_index,
        incident=table.incident,
        counted=table.counted,
        task=np.where(table.safe, table.task_share, np.nan),
    )


def ratios(severity: FloatArray, ideal: FloatArray, method: MethodSettings) -> FloatArray:
    """Ug/U of collisions, (n,), or that of their loss classes; nan where one of both is nan."""
    return score_terms.ideal_ratio(_compared(severity, method), _compared(ideal, method))


def _compared(severity: FloatArray, method: MethodSettings) -> FloatArray:
    """U, or its loss class where classes are compared, (n,); nan stays nan."""
    if method.collision.loss != "class":
        return severity
    return np.where(np.isnan(severity), np.nan, collision_loss(np.nan_to_num(severity)))


def scores_of(
    terms: CaseTerms,
    counts: score_terms.Counts,
    method: MethodSettings,
    hits: score_terms.Counts | None = None,
    *,
    exposed: bool | None = None,
) -> ScoreSamples:
    """Every score of `COMPUTED` in each of m samples, (m,), nan where it does not exist.

    counts: of the cases in each sample, (m, n), see `score_terms`.
    hits: counts of the cases, (m, n), for C and for whether a sample has a D. None: C by `counts`,
        and D exists in all samples or in none, by the cases in `terms`.
    exposed: whether any case has an exposure; None: by the cases in `terms`.
    """

    def mean(values: FloatArray) -> FloatArray:
        return score_terms.exposure_mean(values, terms.exposure, counts)

    collisions = terms.ratio, terms.weight, terms.collided, terms.evaluated
    c = score_terms.collision_avoidance(*collisions, counts if hits is None else hits)
    d = mean(terms.index)
    voided = terms.voids.any() if hits is None else hits @ terms.voids.astype(np.float64) > 0.0
    d = np.where(voided, np.nan, d)
    harm = terms.severity, terms.ideal, terms.unreacting
    avoided = score_terms.avoided_share(*harm, terms.weight, counts)
    by_exposure = np.full(d.shape, np.nan)  # where no case has an exposure
    if terms.exposure.any() if exposed is None else exposed:
        by_exposure = score_terms.avoided_share(*harm, terms.exposure, counts)
    human, task = mean(terms.likeness), mean(terms.task)
    grade = score_terms.avoidance_grade(avoided, method.task.sharpness)
    contact = np.where(terms.evaluated, terms.collided.astype(np.float64), np.nan)
    return {
        "c": c,
        "d": d,
        "s": score_terms.paper_score(c, d, method.score),
        "avoided_share": avoided,
        "avoided_share_exposure": by_exposure,
        "regret": score_terms.regret(terms.severity, terms.ideal, terms.weight, counts),
        "human_likeness": human,
        "task_share": task,
        "avoidance_grade": grade,
        "s_plus": score_terms.ordering_score(task, grade, human, method.score),
        "collision_probability": mean(contact),
    }


def point_values(terms: CaseTerms, method: MethodSettings) -> dict[str, float | None]:
    """Every score of `COMPUTED` of the cases themselves; None where it does not exist."""
    counts = score_terms.once(len(terms.exposure))
    values = scores_of(terms, counts, method, counts)
    return {name: None if np.isnan(value[0]) else float(value[0]) for name, value in values.items()}


def missing_bounds(
    cases: CaseTable,
    terms: CaseTerms,
    values: Mapping[str, float | None],
    method: MethodSettings,
    *,
    people: bool,
) -> dict[str, tuple[float, float]]:
    """Least and largest value of each score that missing cases leave open, without the scores that
    they cannot move.

    cases, terms: of an ADS.
    values: the scores as they are.
    people: whether there are drivers to compare with.

    What is missing, and what stands for it at worst and at best:
    - T, A, A', regret, H, S+, a case that could not be evaluated: doing nothing, or the ideal
      vehicle where that hits harder; at best the ideal vehicle.
    - The ideal vehicle's drive: it avoids, or the point has no part in A, whichever gives the lower
      A; at best it hits as hard as the ADS.
    - The drive of doing nothing: it hits as hard as the ADS; at best as hard as the hardest one.
    - The human-likeness of a safe case: 0; at best 1. After a collision of which it is unknown
      whether the ideal vehicle avoids it: 0; at best the case has no part in H.
    - C, a case: a collision of ratio 0, which never raises Eq. 17's mean; at best one of ratio 1,
      which never lowers it. Where U in m/s is compared and the ideal vehicle avoids, at best no
      collision, because any contact has a U above 0 (a loss may be 0).
    - D, the D_i of a safe case without a collision: 0; at best 1.
    - S: as C and D. A missing safe case may have been a collision, after which there is no D.
    """
    missing = _missing(cases, terms, people=people)
    worst, best = _worst_and_best(cases, terms, missing, method)
    extremes = [
        point_values(filled, method)
        for filled in (worst, _without_what_lifts(worst, missing.unsure, method), best)
    ]
    ordering = (
        "task_share", "avoided_share", "avoided_share_exposure", "avoidance_grade", "regret",
        "human_likeness", "s_plus"
    )  # fmt: skip
    # cases by which each score may move
    moves = {"c": missing.unrated, "d": missing.unindexed}
    moves |= dict.fromkeys(ordering, missing.lost | missing.unsure | missing.unlike)
    bounds = {}
    for name, which in moves.items():
        ends = [value for values in extremes if (value := values[name]) is not None]
        if ends and which.any():
            bounds[name] = min(ends), max(ends)
    if "c" in bounds or "d" in bounds:
        c, d = (
            np.array(bounds.get(name, (values[name], values[name])), float) for name in ("c", "d")
        )
        if (cases.safe & ~terms.evaluated).any():  # one may be a collision, after which D is void
            d[0] = np.nan
        low, high = np.nan_to_num(score_terms.paper_score(c, d, method.score))
        bounds["s"] = float(low), float(high)
    return bounds


class _Missing(NamedTuple):
    """Flags of the cases that lack something, (n,) each.

    lost: the case could not be evaluated, and the ADS did not give up.
    gone: the case was not evaluated, for whatever reason, and is without a collision.
    unsure: Ug or U0 is missing.
    untimed: t_i is missing.
    unrated: the ratio is missing.
    unindexed: D_i is missing.
    unlike: the human-likeness is missing.
    """

    lost: BoolArray
    gone: BoolArray
    unsure: BoolArray
    untimed: BoolArray
    unrated: BoolArray
    unindexed: BoolArray
    unlike: BoolArray


def _missing(cases: CaseTable, terms: CaseTerms, *, people: bool) -> _Missing:
    """Flags of the cases of an ADS."""
    no_ideal = np.isnan(terms.ideal)
    lost, gone = ~terms.counted, ~terms.collided & ~terms.evaluated
    return _Missing(
        lost,
        gone,
        unsure=no_ideal | np.isnan(terms.unreacting),
        untimed=cases.safe & lost,
        unrated=gone | (terms.collided & np.isnan(terms.ratio)),
        unindexed=cases.counts_for_index & np.isnan(terms.index) & people,
        unlike=cases.safe & np.isnan(terms.likeness) & (~terms.incident | no_ideal) & people,
    )


def _worst_and_best(
    cases: CaseTable, terms: CaseTerms, missing: _Missing, method: MethodSettings
) -> tuple[CaseTerms, CaseTerms]:
    """The terms with missing values at their worst, and at their best (see `missing_bounds`)."""
    ideal = _filled(terms.ideal, 0.0)
    # U of the hardest known collision of doing nothing, m/s, or its class; 0 without one
    hardest = float(np.nanmax(terms.unreacting, initial=0.0))
    idle = np.maximum(_filled(terms.unreacting, hardest), ideal)
    severity = np.where(missing.lost, idle, terms.severity)
    # ratio of each case if the ideal vehicle avoids its collision; an unknown one is the severest
    ratio = ratios(np.where(missing.gone, _SEVEREST, cases.severity), np.zeros(len(cases)), method)
    worst = replace(
        _with_shares(terms, missing, missing.unlike, 0.0),
        severity=severity,
        ideal=ideal,
        unreacting=_filled(terms.unreacting, severity),
        ratio=np.where(missing.unrated, ratio, terms.ratio),
        evaluated=terms.evaluated | missing.gone,
        weight=np.where(missing.unrated, _filled(terms.weight, 1.0), terms.weight),
    )
    severity = np.where(missing.lost, ideal, terms.severity)
    # whether a collision can have the ratio 1; a loss, which has no unit, may be 0
    may_touch = (terms.ideal != 0.0) | (not method.collision.unit)
    return worst, replace(
        _with_shares(terms, missing, missing.unlike & ~terms.incident, 1.0),
        severity=severity,
        ideal=_filled(terms.ideal, severity),
        unreacting=_filled(terms.unreacting, np.maximum(hardest, severity)),
        ratio=np.where(missing.unrated & may_touch, 1.0, terms.ratio),
        evaluated=worst.evaluated,
        weight=worst.weight,
    )


def _with_shares(terms: CaseTerms, missing: _Missing, unlike: BoolArray, value: float) -> CaseTerms:
    """The terms with one value for every missing t_i and D_i, and for the human-likeness of the
    cases in `unlike`.
    """
    return replace(
        terms,
        index=np.where(missing.unindexed, value, terms.index),
        likeness=np.where(unlike, value, terms.likeness),
        task=np.where(missing.untimed, value, terms.task),
    )


def _filled(values: FloatArray, instead: float | FloatArray) -> FloatArray:
    """The values, (n,), with others in place of nan."""
    return np.where(np.isnan(values), instead, values)


def _without_what_lifts(terms: CaseTerms, unsure: BoolArray, method: MethodSettings) -> CaseTerms:
    """The terms without those points among the unsure ones that lift A.

    A point lifts A if it lost a smaller share of what was at stake there than all points did. A
    falls when such points are left out, so further points may then lift it: the rounds end once
    these points stay the same.
    """
    taken = score_terms.excess(terms.severity, terms.ideal)
    stake = score_terms.excess(terms.unreacting, terms.ideal)
    kept = terms
    for _ in range(len(unsure)):
        avoided = point_values(kept, method)["avoided_share"]
        if avoided is None:
            return terms
        lifts = unsure & (taken < (1.0 - avoided) * stake)
        if np.array_equal(lifts, unsure & np.isnan(kept.ideal)):  # the same points lift A again
            break
        kept = replace(terms, ideal=np.where(lifts, np.nan, terms.ideal))
    return kept
