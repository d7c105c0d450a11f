"""Contributions of each case to the scores, as arrays, and all scores of one sample of the cases
or of many.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from sumo_eval.cases import CaseResult, CaseTable, IntArray
from sumo_eval.method import score_terms
from sumo_eval.method.collision_avoidance import collision_loss
from sumo_eval.method.score import score_of
from sumo_eval.settings import MethodSettings
from sumo_eval.trajectory import BoolArray, FloatArray

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
    "avoidance_grade", "s_plus", "collision_probability",
)  # fmt: skip
"""Values that `scores_of` computes, by the names of `ScenarioResult`."""
_SEVEREST = 100.0  # m/s: past every class of severity


@dataclass(frozen=True, slots=True, eq=False)
class CaseTerms:
    """The cases of one ADS in one logical scenario, arrays (n,); nan where a case has no part in a
    term.

    exposure: p_i.
    weight: r_i.
    severity: U_i of the worst incident, 0 without one, nan where the harness failed.
    ideal: Ug_i and unreacting: U0_i in the same concrete scenarios, likewise; with `loss = "class"`
        the classes L of all three, 0.1 without an incident.
    ratio: Ug_i/U_i (Lg/L) of a contact. collided, evaluated, incident, counted (also where the ADS
        gave up): flags.
    index: D_i, likeness: human-likeness, of the safe cases that have one.
    task: t_i of the cases that T is the mean of.
    voids: collisions after which there is no D.
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
) -> dict[str, FloatArray]:
    """Every score of `COMPUTED` in each sample, (m,), nan where it does not exist.

    counts: (m, n), see `score_terms`.

    hits: how often each case's collision stands in each sample, (m, n), which C is made of; then a
        sample without the collisions in the safe zone that leave no D has one. Without hits that is
        a fact of all cases.
    exposed: whether any case has an exposure, where these are not all of them.
    """
    c = score_terms.collision_avoidance(
        terms.ratio,
        terms.weight,
        terms.collided,
        terms.evaluated,
        counts if hits is None else hits,
    )
    d = score_terms.exposure_mean(terms.index, terms.exposure, counts)
    voided = terms.voids.any() if hits is None else hits @ terms.voids.astype(np.float64) > 0.0
    d = np.where(voided, np.nan, d)
    harm = terms.severity, terms.ideal, terms.unreacting
    avoided = score_terms.avoided_share(*harm, terms.weight, counts)
    by_exposure = np.full(d.shape, np.nan)
    if terms.exposure.any() if exposed is None else exposed:
        by_exposure = score_terms.avoided_share(*harm, terms.exposure, counts)
    human = score_terms.exposure_mean(terms.likeness, terms.exposure, counts)
    task = score_terms.exposure_mean(terms.task, terms.exposure, counts)
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
        "collision_probability": score_terms.exposure_mean(contact, terms.exposure, counts),
    }


def point_values(terms: CaseTerms, method: MethodSettings) -> dict[str, float | None]:
    """Every score of `COMPUTED` of the cases themselves; None where it does not exist."""
    counts = score_terms.once(len(terms.exposure))
    found = scores_of(terms, counts, method, counts)
    return {name: None if np.isnan(value[0]) else float(value[0]) for name, value in found.items()}


Ends = tuple[float, float]


def missing_bounds(
    cases: CaseTable,
    terms: CaseTerms,
    values: Mapping[str, float | None],
    method: MethodSettings,
    *,
    people: bool,
) -> dict[str, Ends]:
    """Worst and best of the scores with every missing case counted in; empty where none of them
    moves.

    T, A, A', regret, H, S+: a case that could not be evaluated counts as doing nothing, or as the
    ideal vehicle where that is harder; at best as the ideal vehicle. Where the ideal vehicle's own
    drive is missing, at worst it avoids, or the point has no part in A as in the score itself,
    whichever is lower; at best it hits as hard as the ADS. Where that of doing nothing is missing,
    it hits at worst as hard as the ADS, at best as hard as anywhere else. A safe case without a
    human-likeness that could have one counts 0, and 1; one with a collision of which it is unknown
    whether the ideal vehicle avoids it counts 0, and not at all.

    C: a missing case is at worst a collision of ratio 0, which never raises Eq. 17's mean; at best
    one of ratio 1, which never lowers it, but none where U in m/s is compared and the ideal vehicle
    avoids: a contact has a U above 0, but its loss may be 0. D: a safe case without a collision
    that has no D_i counts 0, and 1. S: a missing safe case may have been a collision, after which
    there is no D.

    values: the scores as they are.
    people: whether there are drivers to be like.
    """
    missing = _missing(cases, terms, people=people)
    worst = _at_worst(cases, terms, missing, method)
    best = _at_best(terms, worst, missing, method)
    found = [
        point_values(one, method)
        for one in (worst, _without_what_lifts(worst, missing.unsure, method), best)
    ]
    ordering = (
        "task_share", "avoided_share", "avoided_share_exposure", "avoidance_grade", "regret",
        "human_likeness", "s_plus",
    )  # fmt: skip
    moves = {"c": missing.unrated, "d": missing.unindexed}
    moves |= dict.fromkeys(ordering, missing.lost | missing.unsure | missing.unlike)
    bounds: dict[str, Ends] = {}
    for name, which in moves.items():
        ends = [value for value in (one[name] for one in found) if value is not None]
        if ends and which.any():
            bounds[name] = min(ends), max(ends)
    if "c" in bounds or "d" in bounds:
        (c, most_c), (d, most_d) = (
            bounds.get(name, (values[name], values[name])) for name in ("c", "d")
        )
        d = None if (cases.safe & ~terms.evaluated).any() else d
        low, high = (score_of(*both, method.score).total for both in ((c, d), (most_c, most_d)))
        bounds["s"] = low or 0.0, high or 0.0
    return bounds


class _Missing(NamedTuple):
    """Flags (n,) of the cases that lack something.

    lost: the case could not be evaluated, and the ADS did not give up.
    gone: the case was not evaluated, for whatever reason, and is without a collision.
    unsure: Ug or U0 is missing.
    untimed, unrated, unindexed, unlike: a t_i, ratio, D_i or human-likeness is missing.
    """

    lost: BoolArray
    gone: BoolArray
    unsure: BoolArray
    untimed: BoolArray
    unrated: BoolArray
    unindexed: BoolArray
    unlike: BoolArray


def _missing(cases: CaseTable, terms: CaseTerms, *, people: bool) -> _Missing:
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


def _at_worst(
    cases: CaseTable, terms: CaseTerms, missing: _Missing, method: MethodSettings
) -> CaseTerms:
    """The terms with what is missing at its worst, as `missing_bounds` says."""
    gentlest = _filled(terms.ideal, 0.0)
    idle = np.maximum(_filled(terms.unreacting, _hardest(terms)), gentlest)
    hit = np.where(missing.lost, idle, terms.severity)
    avoidable = np.where(missing.gone, _SEVEREST, cases.severity)
    ratio = ratios(avoidable, np.zeros(len(cases)), method)
    return replace(
        _with_shares(terms, missing, missing.unlike, 0.0),
        severity=hit,
        ideal=gentlest,
        unreacting=_filled(terms.unreacting, hit),
        ratio=np.where(missing.unrated, ratio, terms.ratio),
        evaluated=terms.evaluated | missing.gone,
        weight=np.where(missing.unrated, _filled(terms.weight, 1.0), terms.weight),
    )


def _at_best(
    terms: CaseTerms, worst: CaseTerms, missing: _Missing, method: MethodSettings
) -> CaseTerms:
    """The terms with what is missing at its best, as `missing_bounds` says."""
    severity = np.where(missing.lost, worst.ideal, terms.severity)
    may_touch = (terms.ideal != 0.0) | (not method.collision.unit)
    return replace(
        _with_shares(terms, missing, missing.unlike & ~terms.incident, 1.0),
        severity=severity,
        ideal=_filled(terms.ideal, severity),
        unreacting=_filled(terms.unreacting, np.maximum(_hardest(terms), severity)),
        ratio=np.where(missing.unrated & may_touch, 1.0, terms.ratio),
        evaluated=worst.evaluated,
        weight=worst.weight,
    )


def _with_shares(terms: CaseTerms, missing: _Missing, unlike: BoolArray, value: float) -> CaseTerms:
    """The terms with one value for every missing t_i, D_i and human-likeness."""
    return replace(
        terms,
        index=np.where(missing.unindexed, value, terms.index),
        likeness=np.where(unlike, value, terms.likeness),
        task=np.where(missing.untimed, value, terms.task),
    )


def _filled(values: FloatArray, instead: float | FloatArray) -> FloatArray:
    return np.where(np.isnan(values), instead, values)


def _hardest(terms: CaseTerms) -> float:
    """The hardest known collision of doing nothing, m/s (a loss); 0 without one."""
    return float(np.nanmax(terms.unreacting, initial=0.0))


def _without_what_lifts(terms: CaseTerms, unsure: BoolArray, method: MethodSettings) -> CaseTerms:
    """These terms without those points among the unsure ones that lift A.

    A falls with every round, so that it ends.
    """
    kept = terms
    for _ in range(len(unsure)):
        avoided = point_values(kept, method)["avoided_share"]
        if avoided is None:
            return terms
        taken = score_terms.excess(terms.severity, terms.ideal)
        lifts = unsure & (
            taken < (1.0 - avoided) * score_terms.excess(terms.unreacting, terms.ideal)
        )
        if np.array_equal(lifts, unsure & np.isnan(kept.ideal)):
            break
        kept = replace(terms, ideal=np.where(lifts, np.nan, terms.ideal))
    return kept
