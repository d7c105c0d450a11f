"""Contributions of each case to the scores, as arrays, and all scores of one sample of the cases or
of many.

`scoring.quantities` makes the scores of a run here, `scoring.confidence` their intervals,
`scoring.comparison` the scores of paired cases.

Users: `nightly/`, `report/`, `scoring/`. Fixed: letters of `SCORES`, which people read; names of
scores, which are keys of scores.json; number and order of the sums (see `method/score_terms.py`).
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
"""Letter that people read -> (field of ScenarioResult, digits after the point).

Comparisons show one digit more.
"""
COMPUTED = (
    "c", "d", "s", "avoided_share", "avoided_share_exposure", "regret", "human_likeness",
    "task_share",
    "avoidance_grade", "s_plus", "collision_probability"
)  # fmt: skip
"""Names of the values that `scores_of` computes: fields of `ScenarioResult`."""
ScoreSamples = dict[str, FloatArray]
"""Each score in m samples, (m,), by its name."""
_SEVEREST = 100.0  # m/s, a U in the severest class of Eq. 14


@frozen(eq=False)
class CaseTerms:
    """The n cases of one ADS in one logical scenario, arrays (n,). A number is nan if the case has
    no part in it.

    method: `[method]`, by which the terms were made and scores are made of them.
    exposure: p_i.
    weight: r_i times the number of points that the point stands for.
    severity: U_i of the worst incident, 0 without an incident, nan if the simulation failed, or
        if the ADS gave up and U0 is not known. With `loss = "class"` the class L of the incident,
        0.1 without an incident.
    ideal: Ug_i in the same concrete scenario, or its class.
    unreacting: U0_i in the same concrete scenario, or its class.
    ratio: Ug_i/U_i of a collision, or the ratio of their classes.
    collided: whether the case is a collision that counts in C: not one in which the ego was struck
        from behind.
    evaluated: whether the case ended in a way that can be evaluated.
    index: D_i of a safe case without a collision.
    likeness: human-likeness of a safe case; after an incident that the ideal vehicle avoids 0.
    voids: whether the case is a collision after which there is no D.
    incident: whether the case has an incident.
    counted: whether the case was evaluated, or the ADS gave up.
    task: t_i of a safe case; 0 after an incident.
    """

    method: MethodSettings
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
        # [1:]: all fields but `method`
        arrays = (getattr(self, item.name) for item in fields(self)[1:])
        return CaseTerms(self.method, *(values[rows] for values in arrays))


def case_terms(cases: CaseTable | Sequence[CaseResult], method: MethodSettings) -> CaseTerms:
    """The terms of cases, in the order of the cases.

    method: `[method]`: whether severities or their classes are compared.
    """
    table = CaseTable.of(cases)
    return CaseTerms(
        method,
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
    """Eq. 17: Ug/U of collisions, (n,), or the ratio of their loss classes; nan where U or Ug is
    nan.
    """
    return score_terms.ideal_ratio(_compared(severity, method), _compared(ideal, method))


def _compared(severity: FloatArray, method: MethodSettings) -> FloatArray:
    """U, or its loss class where classes are compared, (n,); nan stays nan."""
    if method.collision.loss != "class":
        return severity
    return np.where(np.isnan(severity), np.nan, collision_loss(np.nan_to_num(severity)))


def scores_of(
    terms: CaseTerms,
    counts: score_terms.Counts,
    hits: score_terms.Counts | None = None,
    *,
    rows: IntArray | slice = slice(None),
) -> ScoreSamples:
    """Every score of `COMPUTED` in each of m samples, by name, (m,) each; nan where it does not
    exist.

    terms: of all cases.
    counts: how often each case occurs in each sample, (m, n), see `score_terms`.
    hits: as `counts`, but of collisions, which `intervals.py` draws in another way: for C, and for
        whether a collision in a sample voids its D. None: `counts` for C, and if any case voids D,
        no sample has a D.
    rows: the n cases to read.
    """
    method = terms.method
    # of all cases, not of `rows` alone: whether any has an exposure, and whether any voids D
    exposed, without_d = terms.exposure.any(), terms.voids.any()
    terms = terms.part(rows)

    def mean(values: FloatArray) -> FloatArray:
        """Mean of a value of the cases in each sample, by exposure, (m,)."""
        return score_terms.exposure_mean(values, terms.exposure, counts)

    collisions = terms.ratio, terms.weight, terms.collided, terms.evaluated
    c = score_terms.collision_avoidance(*collisions, counts if hits is None else hits)
    d = mean(terms.index)
    voided = without_d if hits is None else hits @ terms.voids.astype(np.float64) > 0.0
    d = np.where(voided, np.nan, d)
    harm = terms.severity, terms.ideal, terms.unreacting
    avoided = score_terms.avoided_share(*harm, terms.weight, counts)
    by_exposure = np.full(d.shape, np.nan)  # where no case has an exposure
    if exposed:
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


def point_values(terms: CaseTerms) -> dict[str, float | None]:
    """Every score of `COMPUTED` of the cases themselves, by name; None if it does not exist."""
    values = scores_of(terms, score_terms.once(len(terms.exposure)))
    return {name: None if np.isnan(value[0]) else float(value[0]) for name, value in values.items()}


def missing_bounds(
    cases: CaseTable,
    terms: CaseTerms,
    values: Mapping[str, float | None],
    *,
    people: bool,
) -> dict[str, tuple[float, float]]:
    """Score -> least and largest value, maybe the same, that missing cases leave open. Scores that
    lack no value, and the collision probability, are not in it.

    cases, terms: of an ADS.
    values: the scores of the cases as they are.
    people: whether there are drivers to compare with.

    What may be missing, and what replaces it:
    - A case whose simulation failed, in T, A, A', regret, H and S+. At worst the ADS does
      nothing (or hits as hard as the ideal vehicle, if that hits harder), at best it drives as the
      ideal vehicle.
    - The ideal vehicle's drive. At worst it avoids the contact, or the point has no part in A,
      whichever gives the lower A. At best it hits as hard as the ADS.
    - The drive of `no_reaction`. At worst it hits as hard as the ADS, at best as hard as the
      hardest drive of `no_reaction`.
    - The human-likeness of a safe case. At worst 0, at best 1. After an incident of which it is not
      known whether the ideal vehicle avoids it: at worst 0, at best no part in H.
    - A case in C. At worst a collision of ratio 0, which never raises Eq. 17's mean, at best one of
      ratio 1, which never lowers it. But where the ideal vehicle avoids the contact, Ug is 0 m/s,
      and any contact has a U above 0: no ratio is 1, so at best the ADS avoids it too. (A severity
      of the user's without a unit may be 0 after a contact, so that the ratio is 1 even there.)
    - D_i of a safe case without a collision. At worst 0, at best 1.
    - S follows from C and D. A missing safe case may have been a collision, after which there is no
      D.
    """
    missing = _missing(cases, terms, people=people)
    worst, best = _worst_and_best(cases, terms, missing)
    extremes = [
        point_values(filled)
        for filled in (worst, _without_what_lifts(worst, missing.no_reference), best)
    ]
    ordering = (
        "task_share", "avoided_share", "avoided_share_exposure", "avoidance_grade", "regret",
        "human_likeness", "s_plus"
    )  # fmt: skip
    # score -> flags of the cases that may move it
    moving = {"c": missing.no_ratio, "d": missing.no_index}
    moving |= dict.fromkeys(
        ordering, missing.no_outcome | missing.no_reference | missing.no_likeness
    )
    bounds = {}
    for name, flags in moving.items():
        ends = [value for values in extremes if (value := values[name]) is not None]
        if ends and flags.any():
            bounds[name] = min(ends), max(ends)
    if "c" in bounds or "d" in bounds:
        c, d = (
            np.array(bounds.get(name, (values[name], values[name])), float) for name in ("c", "d")
        )
        # a missing safe case may be a collision, after which there is no D: in the lower S the term
        # of D then counts 0
        if (cases.safe & ~terms.evaluated).any():
            d[0] = np.nan
        low, high = np.nan_to_num(score_terms.paper_score(c, d, terms.method.score))
        bounds["s"] = float(low), float(high)
    return bounds


class _Missing(NamedTuple):
    """Whether each case lacks something, (n,) each.

    no_outcome: it could not be evaluated, and the ADS did not give up.
    may_have_hit: it was not evaluated, for whatever reason, and no collision is known.
    no_reference: Ug or U0 is missing.
    no_task: t_i is missing.
    no_ratio: Ug/U is missing.
    no_index: D_i is missing.
    no_likeness: the human-likeness is missing.
    """

    no_outcome: BoolArray
    may_have_hit: BoolArray
    no_reference: BoolArray
    no_task: BoolArray
    no_ratio: BoolArray
    no_index: BoolArray
    no_likeness: BoolArray


def _missing(cases: CaseTable, terms: CaseTerms, *, people: bool) -> _Missing:
    """Flags of all that each case of an ADS lacks. Without drivers to compare with (`people`), no
    D_i and no human-likeness is missing.
    """
    no_ideal = np.isnan(terms.ideal)
    no_outcome, may_have_hit = ~terms.counted, ~terms.collided & ~terms.evaluated
    return _Missing(
        no_outcome,
        may_have_hit,
        no_reference=no_ideal | np.isnan(terms.unreacting),
        no_task=cases.safe & no_outcome,
        no_ratio=may_have_hit | (terms.collided & np.isnan(terms.ratio)),
        no_index=cases.counts_for_index & np.isnan(terms.index) & people,
        # an incident has the likeness 0, or no part in H: the ideal vehicle's drive decides
        no_likeness=cases.safe & np.isnan(terms.likeness) & (~terms.incident | no_ideal) & people,
    )


def _worst_and_best(
    cases: CaseTable, terms: CaseTerms, missing: _Missing
) -> tuple[CaseTerms, CaseTerms]:
    """The terms with missing values at their worst, and at their best (see `missing_bounds`)."""
    # worst: the ideal vehicle avoids, the ADS does nothing
    ideal = _filled(terms.ideal, 0.0)
    # U of the hardest known drive of `no_reaction`, m/s, or its class; 0 if none is known
    hardest = float(np.nanmax(terms.unreacting, initial=0.0))
    idle = np.maximum(_filled(terms.unreacting, hardest), ideal)
    severity = np.where(missing.no_outcome, idle, terms.severity)
    # ratio of each case if the ideal vehicle avoids its collision: 0, or that of the classes. A
    # collision that may have happened is the severest.
    hits = np.where(missing.may_have_hit, _SEVEREST, cases.severity)
    ratio = ratios(hits, np.zeros(len(cases)), terms.method)
    worst = replace(
        _with_shares(terms, missing, missing.no_likeness, 0.0),
        severity=severity,
        ideal=ideal,
        unreacting=_filled(terms.unreacting, severity),
        ratio=np.where(missing.no_ratio, ratio, terms.ratio),
        # C counts each evaluated case with a ratio as a hit
        evaluated=terms.evaluated | missing.may_have_hit,
        weight=np.where(missing.no_ratio, _filled(terms.weight, 1.0), terms.weight),
    )
    # best: the ADS drives as the ideal vehicle
    severity = np.where(missing.no_outcome, ideal, terms.severity)
    # whether a collision may have the ratio 1: only a severity without a unit may be 0 after one
    may_equal = (terms.ideal != 0.0) | (not terms.method.collision.unit)
    return worst, replace(
        _with_shares(terms, missing, missing.no_likeness & ~terms.incident, 1.0),
        severity=severity,
        ideal=_filled(terms.ideal, severity),
        unreacting=_filled(terms.unreacting, np.maximum(hardest, severity)),
        ratio=np.where(missing.no_ratio & may_equal, 1.0, terms.ratio),
        evaluated=worst.evaluated,
        weight=worst.weight,
    )


def _with_shares(
    terms: CaseTerms, missing: _Missing, no_likeness: BoolArray, value: float
) -> CaseTerms:
    """The terms with `value` for every missing t_i and D_i, and for the human-likeness of the cases
    flagged in `no_likeness`.
    """
    return replace(
        terms,
        index=np.where(missing.no_index, value, terms.index),
        likeness=np.where(no_likeness, value, terms.likeness),
        task=np.where(missing.no_task, value, terms.task),
    )


def _filled(values: FloatArray, instead: float | FloatArray) -> FloatArray:
    """The values, (n,), with `instead` for every nan."""
    return np.where(np.isnan(values), instead, values)


def _without_what_lifts(terms: CaseTerms, no_reference: BoolArray) -> CaseTerms:
    """The terms at their worst, without the points that lift A though a reference is missing there.

    A point lifts A if it lost a smaller share of what was at stake there than all points did. When
    such points are left out, A falls, and further points may lift the lower A. So points are left
    out in rounds, until they stay the same.
    """
    lost = score_terms.excess(terms.severity, terms.ideal)
    stake = score_terms.excess(terms.unreacting, terms.ideal)
    remaining = terms
    for _ in range(len(no_reference)):
        avoided = point_values(remaining)["avoided_share"]
        if avoided is None:
            return terms
        lifts = no_reference & (lost < (1.0 - avoided) * stake)
        if np.array_equal(lifts, no_reference & np.isnan(remaining.ideal)):  # the same as before
            break
        # without Ug a point has no part in A
        remaining = replace(terms, ideal=np.where(lifts, np.nan, terms.ideal))
    return remaining
