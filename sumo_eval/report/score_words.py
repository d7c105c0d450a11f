"""The scores in words: what each term means, and why a score is what it is.

Users: `nightly/gates.py`, `report/`.
"""

from collections.abc import Mapping

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.report.words import count, number
from sumo_eval.results import Ranking, ScenarioResult
from sumo_eval.scoring.findings import Findings
from sumo_eval.text import point_words
from sumo_eval.trajectory import FloatArray

REASON_WITHOUT_A = "no case could be evaluated"
REASON_WITHOUT_C = "no case that tells how collisions are avoided could be evaluated"
REASON_WITHOUT_T = (
    "no safe case could be compared with a reference, or those compared have exposure 0"
)
WITHOUT_REFERENCE_CAR = (
    "T compares with the drivers alone: this run was recorded without the reference car. "
    "`sumo-eval run --resume` adds it."
)

FACTORS = {
    "length": "f_L, min(1, L / mean L of the drivers)",
    "operations": "f_n, min(1, operations of the drivers / operations of the ADS)",
    "similarity": "mean over the slices of min(1, pt/pt_2s) min(1, pv/pv_2s)",
}
"""Meaning of the factors of D_i."""

LIKENESS_FACTORS = {
    "length": FACTORS["length"],
    "operations": "f_n+, 1 up to the drivers' mean number of operations, less far above it",
    "similarity": "as in D, beside the drivers who made the same kind of manoeuvre",
    "plausibility": "1 where at least 5 % of recorded people go to such extremes, less beyond",
}
"""Meaning of the factors of a case's part in H."""

GLOSSARY = {
    "A": "avoided share: of the collision severity by which doing nothing exceeds the ideal "
    "vehicle, the share that the ADS avoided, over all cases. 1: as the ideal vehicle; 0: as doing "
    "nothing; below 0: worse than that",
    "H": "human-likeness: mean over the safe cases of length factor, operations factor, similarity "
    "and plausibility multiplied; 0 for a safe case with an avoidable incident",
    "T": "share of the driving task done: mean over the safe cases of t_i. Along the way that the "
    "drivers and the reference car drove, t_i is 1 where the ADS was no later than the slowest of "
    "them, less where it was later, 0 where it never came; 0 with an incident",
    "A'": "grade of A: by default 1 % of the avoidable harm costs 0.15, 10 % cost 0.52. 1: as "
    "the ideal vehicle; 0: as doing nothing",
    "S+": "the score that orders: T A' (a + b H), 0 to 100 points; an A' below 0 counts 0",
    "departure": "a corner of the body is more than `road_margin`, 0.5 m by default, off the road; "
    "it weighs as a contact with a standing car at the speed of leaving",
    "gave up": "the ADS failed, ran out of time or ended its process: as bad as doing nothing, no "
    "task done",
    "regret": "by how much severity the ADS exceeds the ideal vehicle: mean over all cases, "
    "weighted by r; 0 is best",
    "C": "collision avoidance of the paper, Eq. 17: mean of Ug/U over the collisions alone; 1 "
    "without a collision",
    "D": "human-likeness index of the paper, Eq. 13: mean of D_i over the safe cases; none after "
    "an avoidable collision among them",
    "S": "score of the paper, Eq. 18: a C + b D, 0 to 100 points",
    "avoidable": "a collision that the ideal vehicle does not have in the same concrete scenario",
    "unavoidable": "a collision that the ideal vehicle has as well",
    "caused": "an avoidable collision that even a car that does nothing would not have had",
    "ideal vehicle": "knows what actors will do, sees what is in sight, brakes at once with its "
    "full deceleration",
    "doing nothing": "the driver `no_reaction`: keeps speed and lane whatever happens",
    "U": "severity of a collision, Eq. 15: relative speed at first contact, divided by the share "
    "of the front that overlaps, m/s",
    "Ug": "severity of the ideal vehicle in the same concrete scenario, m/s; 0 where it avoids",
    "U0": "severity of doing nothing in the same concrete scenario, m/s; 0 where nothing is hit",
    "L": "loss class of a collision, Eq. 14: 1, 0.7, 0.4 by severity, 0.1 without one",
    "r": "weight of a case, Eq. 16: its distance from the most dangerous point, 1 at the border "
    "of the hazardous zone; in an adaptive sample times the points that the case stands for",
    "TTC": "time to collision: gap over closing speed, s",
    "ITTC": "inverse time to collision, 1/s: the larger, the more critical",
    "THW": "time headway: gap over own speed, s",
    "DRAC": "deceleration needed to avoid a crash, m/s²",
    "exposure": "how often a concrete scenario occurs in traffic, declared or measured; without "
    "it each counts the same",
    "slice": "of a path: a cross-section of the road, every half metre, at which paths are "
    "compared; of a map: a cut through the space, at one value of each further parameter",
    "trajectory field": "how strongly a vehicle claims the space around its path, Eqs. 9–10",
    "plausibility": "share of recorded people who go to such extremes of headway, time to "
    "collision, braking, jerk and lateral motion, 1 from 5 % on",
    "safe zone, hazardous zone": "where braking as set (by default 5 m/s²) keeps the "
    "inverse time to collision below its limit (by default 0.7 1/s)",
    "interval": "a range that would hold the true number in 95 of 100 evaluations with other "
    "cases and drivers",
}
"""The terms of the report in plain words, of its tooltips and of the glossary at its end."""
NEGLIGIBLE_LIMIT = 0.995  # a factor above this limits nothing that three digits would show
SHARE_WORTH_NAMING = 0.05  # of what a score lost


def collision_words(exposure_known: bool) -> str:
    """Name of the collision probability.

    exposure_known: whether exposures were declared or measured.
    """
    return "Collision probability" if exposure_known else "Share of the points with a collision"


def collisions_sentence(score: ScenarioResult) -> str:
    """`idm had 5 collisions: 3 avoidable (1 of them caused by the ADS), 2 unavoidable.`"""
    if score.collisions == 0:
        return f"{score.ads} did not collide."
    avoidable, unavoidable = score.avoidable_collisions, score.unavoidable_collisions
    unknown = score.collisions - avoidable - unavoidable
    own = score.caused_collisions
    caused = f" ({own} of them caused by the ADS)" if own else ""
    rest = f", {unknown} where the ideal vehicle could not be evaluated" if unknown else ""
    hits = count(score.collisions, "collision")
    return (
        f"{score.ads} had {hits}: {avoidable} avoidable{caused}, {unavoidable} unavoidable{rest}."
    )


def missing_term(name: str, reason: str) -> str:
    """`D is not computed: no case lies in the safe zone. Its term counts 0 points.`"""
    return f"{name} is not computed: {reason}. Its term counts 0 points."


def explain_a(findings: Findings) -> str:
    """Explanation of A."""
    score = findings.score
    sentence = collisions_sentence(score)
    if score.avoided_share is None:
        return f"{sentence} A is not computed: {REASON_WITHOUT_A}."
    unit = findings.method.collision.regret_unit
    regret = "" if score.regret is None else f"; the regret is {number(score.regret, 3)}{unit}"
    if score.avoided_share == 1.0:
        # at the most dangerous point r is 0, and a hard collision there takes nothing
        harder = (findings.beyond > 0.0).any()
        which = "no incident at a point with r above 0" if harder else "no incident"
        return f"{sentence} A = A' = 1: {which} is harder than the ideal vehicle's{regret}."
    below = ": worse than doing nothing, and S+ takes 0" if score.avoided_share < 0.0 else ""
    grade = number(score.avoidance_grade, 3)
    return (
        f"{sentence} A = {number(score.avoided_share, 3)}, A' = {grade}{below}{regret}."
        + _most_from("A", findings.cases, findings.share_lost, 1.0 - score.avoided_share)
    )


def _most_from(name: str, cases: CaseTable, losses: FloatArray, total: float) -> str:
    """Sentence on the case that took most from a score; empty if it is not worth naming.

    losses: of the cases, (n,); nan where a case has no part in the score.
    total: their sum; 0 where nothing is lost.
    """
    worst = int(np.argmax(np.nan_to_num(losses)))
    lost = losses[worst]
    if not (lost and lost >= SHARE_WORTH_NAMING * total):  # `not`: refuses nan as well
        return ""
    point = point_words(cases[worst].values)
    return f" {point} took the most from {name}: {lost:z.3f} of {total:z.3f}."


def explain_h(findings: Findings) -> str:
    """Explanation of H."""
    score, likened = findings.score, findings.likened
    if score.human_likeness is None:
        return missing_term("H", reason_without("H", score))
    hits, means = (likened & findings.cases.incident).sum(), findings.likeness_means
    limit = f", {_limit(means, '{}')}" if means else ""
    counted = count(likened.sum(), "safe case")
    sentence = f"H = {number(score.human_likeness, 3)}: mean over {counted}{limit}."
    if not hits:
        return sentence
    counts = "counts" if hits == 1 else "count"
    return f"{sentence} {count(hits, 'case')} with an avoidable incident {counts} 0."


def explain_s_plus(findings: Findings) -> str:
    """Explanation of S+ from T, A' and H."""
    score, points = findings.score, findings.method.score
    if score.s_plus is None:
        reason = REASON_WITHOUT_T if score.task_share is None else REASON_WITHOUT_A
        return f"S+ is not computed: {reason}."
    product = f"{score.task_share:z.3f} x {max(score.avoidance_grade or 0.0, 0.0):z.3f}"
    missing = "" if score.human_likeness is not None else ", H not computed"
    manner = f"({points.a:g} + {points.b:g} x {score.human_likeness or 0.0:z.3f}{missing})"
    return f"S+ = T A' (a + b H) = {product} x {manner} = {score.s_plus:z.1f} points."


def explain_t(findings: Findings) -> str:
    """Explanation of T."""
    score = findings.score
    if score.task_share is None:
        return f"T is not computed: {REASON_WITHOUT_T}."
    car = score.task_reference
    beside = f"`{car}`" if car else "the drivers alone: the run has no reference car"
    cases = findings.cases[findings.cases.safe]
    groups = (cases.departed.sum(), "left the road"), (cases.gave_up.sum(), "given up")
    losses = ", ".join(f"{count(lost, 'case')} {words}" for lost, words in groups if lost)
    return f"T = {number(score.task_share, 3)} beside {beside}{'; ' if losses else ''}{losses}."


def explain_c(findings: Findings) -> str:
    """Explanation of C."""
    score, loss = findings.score, findings.method.collision.loss
    if score.c is None:
        return missing_term("C", REASON_WITHOUT_C)
    if score.collisions == 0:
        evaluated = count(findings.cases.evaluated.sum(), "evaluated case")
        return f"{score.ads} did not collide in any of {evaluated}, so C = 1."
    ratio, avoiding = (
        ("Ug/U", "has Ug/U = 0") if loss == "severity" else ("Lg/L", "still has Lg = 0.1")
    )
    return (
        f"{score.ads} collided in {_zones_of_collisions(score)}; the ideal vehicle avoids "
        f"{score.avoidable_collisions} of these. C = {score.c:z.3f}: the mean of {ratio} over the "
        f"collisions, weighted by r. A collision that the ideal vehicle avoids {avoiding}."
        + _most_from("C", findings.cases, findings.lost_of_c, 1.0 - score.c)
    )


def _zones_of_collisions(score: ScenarioResult) -> str:
    """`2 of 7 hazardous cases and in 1 of 20 safe cases`."""
    zones = (
        (score.collisions - score.safe_collisions, score.hazardous_cases, "hazardous case"),
        (score.safe_collisions, score.safe_cases, "safe case"),
    )
    return " and in ".join(f"{hits} of {count(of, noun)}" for hits, of, noun in zones if hits)


def explain_d(findings: Findings) -> str:
    """Explanation of D."""
    score, cases, counted = findings.score, findings.cases, findings.indexed
    if score.d is None:
        return missing_term("D", reason_without("D", score))
    indexed = counted.sum()
    limit = _limit(findings.factor_means, "the {} factor")
    sentence = f"D = {score.d:z.3f}: mean over {count(indexed, 'safe case')}, {limit}."
    low = (counted & (cases.index < 0.1)).sum()
    if 0 < low < indexed:
        sentence += f" {low} of them {'scores' if low == 1 else 'score'} below 0.1."
    notes = cases.index_note[cases.safe]  # of each safe case
    divided = sum(any(note.kind == "two_groups" for note in of_case) for of_case in notes)
    return f"{sentence} In {divided} of them {TWO_GROUPS}" if divided else sentence


TWO_GROUPS = (
    "some drivers overtook and others followed. D compares the ADS with all of them at once "
    "there, so nearly any path between the two counts as human."
)


def _limit(means: Mapping[str, float], words: str) -> str:
    """Factor that limits a mean most, with the mean of each.

    words: text with `{}` for the factor's name.
    """
    name = min(means, key=lambda factor: means[factor])
    if means[name] >= NEGLIGIBLE_LIMIT:
        return "no factor limits it"
    rest = ", ".join(f"{factor} {mean:z.2f}" for factor, mean in means.items() if factor != name)
    return f"limited most by {words.format(name)} (mean {means[name]:z.2f}; {rest})"


def parts_of_total(ranking: Ranking) -> str:
    """Scenarios without S+, and those in which H counts 0; empty without any.

    For example `: no task, so no S+, in cut_in; H counts 0, without people, in own`.
    """
    effects = (
        (ranking.without_task, "no task, so no S+,"),
        (ranking.without_people, "H counts 0, without people,"),
    )
    parts = "; ".join(f"{effect} in {', '.join(names)}" for names, effect in effects if names)
    return f": {parts}" if parts else ""


def reason_without(name: str, score: ScenarioResult) -> str:
    """Reason why there is no C, D, H or T, without the words `not computed`; "" for other names."""
    notes = {"D": (score.d_reason, "D_i"), "H": (score.h_reason, "human-likeness")}
    note, what = notes.get(name, (None, ""))
    if note is None:
        return {"C": REASON_WITHOUT_C, "T": REASON_WITHOUT_T}.get(name, "")
    return {
        "collisions": f"{count(note.collisions, 'collision')} in the safe zone",
        "no_safe_case": "no case lies in the safe zone",
        "no_drivers": "no drivers for it: the synthetic ones do not know this scene, and [drivers] "
        "gives no others",
        "nothing_compared": "no safe case could be evaluated and compared with drivers",
        "no_exposure": f"every safe case with a {what} has exposure 0",
    }[note.why]


def not_computed(name: str, score: ScenarioResult) -> str:
    """`not computed: no case lies in the safe zone`; nothing where there is no reason."""
    reason = reason_without(name, score)
    return f"not computed: {reason}" if reason else ""


def explain_s(findings: Findings) -> str:
    """Sum of S, in words."""
    score, terms = findings.score, findings.method.score
    if score.s is None:
        return "S is not computed: nothing could be evaluated."
    d_term = f"D gives {score.d_points:z.1f}" if score.d is not None else "D, not computed, gives 0"
    scaled = (
        "" if terms.k5 == terms.k6 == 1.0 else f" (scaled by k5 = {terms.k5:g}, k6 = {terms.k6:g})"
    )
    c_term = f"C gives {score.c_points:z.1f} of {terms.a:g} points"
    return f"S = {score.s:z.1f}: {c_term}, {d_term} of {terms.b:g} points{scaled}."


EXPLAIN = explain_t, explain_a, explain_h, explain_s_plus
EXPLAIN_PAPER = explain_c, explain_d, explain_s
"""Functions that make the sentences on one ADS in one scenario, the paper's scores apart."""
