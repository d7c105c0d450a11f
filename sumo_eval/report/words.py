"""The sentences that reports, terminal and nights share: what happened in a run, and why a score is
so.

Users: `cli/whatif.py`, `nightly/`, `report/`, `extras/figures/of_runs.py`, `extras/rates/`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.groups import grouped
from sumo_eval.method.anthropomorphic import IndexNote, NoteKind
from sumo_eval.method.manoeuvres import words as manoeuvre_words
from sumo_eval.results import (
    BeyondRange,
    Bounds,
    CasesMissing,
    Counted,
    DrivenAlone,
    DrivenInBlocks,
    DrivesLeftOut,
    Evaluation,
    PlausibleTo,
    Ranking,
    ReferenceMissing,
    RequirementMissed,
    ScenarioResult,
    ScoreNote,
    ThinReferences,
    WorstAndBest,
)
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.contact_cause import ContactCause
from sumo_eval.scoring.findings import Findings, findings_of, people_behind
from sumo_eval.scoring.preventability import Verdict, reference_ads
from sumo_eval.settings import EvaluationSettings, SamplingSettings
from sumo_eval.text import point_words

REASON_WITHOUT_C = "no case that tells how collisions are avoided could be evaluated"
REASON_WITHOUT_T = "no safe case could be compared with a reference"
GIVEN_UP = " (cases given up count in T, A and H)"
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
    "A": "avoided share: how much of the collision severity that doing nothing would bring and the "
    "ideal vehicle would not was avoided, over all cases. 1: as the ideal vehicle; 0: as doing "
    "nothing; below 0: worse than that",
    "H": "human-likeness: mean over the safe cases of length factor, operations factor, similarity "
    "and plausibility multiplied; 0 for a safe case with an avoidable incident",
    "T": "share of the driving task done: mean over the safe cases of t_i, how much of the way "
    "that the drivers and the reference car drove was driven in no more time than the slowest of "
    "them; 0 with an incident",
    "A'": "grade of A: by default 1 % of the avoidable harm costs 0.15, 10 % cost 0.52. 1: as "
    "the ideal vehicle; 0: as doing nothing",
    "S+": "the score that orders: T A' (a + b H), 0 to 100 points; an A' below 0 counts 0",
    "departure": "a corner of the body is more than `road_margin`, 0.5 m by default, off the road; "
    "it weighs as a contact with a standing car at that speed",
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
    "U": "severity of a collision, Eq. 15: relative speed at first contact over the overlap of "
    "the bumpers, m/s",
    "Ug": "severity of the ideal vehicle in the same concrete scenario, m/s; 0 where it avoids",
    "U0": "severity of doing nothing in the same concrete scenario, m/s; 0 where nothing is hit",
    "L": "loss class of a collision, Eq. 14: 1, 0.7, 0.4 by severity, 0.1 without one",
    "r": "weight of a case, Eq. 16: its distance from the most dangerous point, 1 at the border "
    "of the hazardous zone",
    "TTC": "time to collision: gap over closing speed, s",
    "ITTC": "inverse time to collision, 1/s: the larger, the more critical",
    "THW": "time headway: gap over own speed, s",
    "DRAC": "deceleration needed to avoid a crash, m/s²",
    "exposure": "how often a concrete scenario occurs in traffic, declared or measured; without "
    "it each counts the same",
    "slice": "a cross-section of the road, every half metre, at which paths are compared",
    "trajectory field": "how strongly a vehicle claims the space around its path, Eqs. 9–10",
    "plausibility": "share of recorded people who go to such extremes of headway, time to "
    "collision, braking, jerk and lateral motion, 1 from 5 % on",
    "safe zone, hazardous zone": "where braking as set (by default 5 m/s²) keeps the "
    "inverse time to collision below its limit (by default 0.7 1/s)",
    "interval": "a range that would hold the true number in 95 of 100 evaluations with other "
    "cases and drivers",
}
"""The terms of the report in plain words; the page explains a term only in these words."""


class VerdictStyle(NamedTuple):
    """Appearance of a verdict: words, the letter in a cell of the map (readable without colour),
    colours.
    """

    words: str
    letter: str
    colour: str
    ink: str


LOOKS: Mapping[Verdict, VerdictStyle] = {
    "avoided": VerdictStyle("avoided", "", "#d3e6f3", "#1b1f24"),
    "better": VerdictStyle("avoided, the reference had an incident", "+", "#2b74a8", "#ffffff"),
    "preventable": VerdictStyle("preventable incident", "P", "#b23c00", "#ffffff"),
    "unpreventable": VerdictStyle("unpreventable incident", "U", "#f2b97c", "#1b1f24"),
    "undecided": VerdictStyle("incident, reference not known", "?", "#e0cfdc", "#1b1f24"),
    "not evaluated": VerdictStyle("not evaluated", "–", "#69727c", "#ffffff"),
}

MEASURES = (
    ("min_ttc", "shortest TTC", "s"),
    ("max_ittc", "largest inverse TTC", "1/s"),
    ("min_thw", "shortest time headway", "s"),
    ("min_gap", "smallest gap ahead", "m"),
    ("max_drac", "largest DRAC", "m/s²"),
    ("pet", "post-encroachment time", "s"),
    ("conflict_pet", "PET of conflicting ways", "s"),
    ("undisturbed_pet", "PET without reactions", "s"),
    ("time_to_conflict", "undisturbed time to the conflict area", "s"),
    ("max_deceleration", "strongest deceleration", "m/s²"),
    ("max_jerk", "largest jerk", "m/s³"),
    ("max_lateral_jerk", "largest lateral jerk", "m/s³"),
    ("delta_v", "delta-v at contact", "m/s"),
    ("largest_offset", "largest offset from the lane's middle", "m"),
    ("overshoot", "overshoot beyond the lane's middle", "m"),
    ("over_line_time", "time over a line of the lane", "s"),
)
"""The criticality measures of a case: (field of CaseResult, words, unit)."""

_CAUSES = {
    "late": "braked {after:z.2f} s after the last moment at which full braking avoids it, {last}",
    "weak": "braked in time, not hard enough: full braking from {last} on avoids it",
    "never_braked": "did not brake: full braking from {last} on avoids it",
    "unavoidable_by_braking": "full braking from the start does not avoid it",
    "not_repeatable": "no point of no return: no replay ends in this contact",
}


def cause_words(case: CaseResult | ContactCause) -> str:
    """Cause of a contact, by the braking and the point of no return; "" without a contact."""
    last, braked = case.no_return_time or 0.0, case.braking_time or 0.0
    words = _CAUSES.get(case.contact_cause, "")
    return words.format(last=f"{last:z.2f} s", after=braked - last)


_STATUS = {
    "timeout": "The case exceeded its time limit.",
    "ads_error": "The controller failed.",
    "ads_timeout": "One step of the controller exceeded its time limit.",
    "sim_error": "SUMO refused or lost something.",
    "crashed": "The process that ran the case died.",
    "rejected": "The case was refused before it began.",
}
_REFERENCES = {
    "ideal": ("the ideal vehicle's drive", "Ug"),
    "no_reaction": ("the drive of `no_reaction`", "U0"),
}
"""Drive of a reference in words, and the symbol that needs it."""
_LEFT_OUT = {
    "collision": "collided",
    "off_road": "left the road",
    "timeout": "took too long",
    "ads_error": "failed",
    "ads_timeout": "took too long over one step",
    "sim_error": "were refused by SUMO",
    "crashed": "ended with their process",
    "rejected": "were refused before they began",
}
"""Outcome of drivers' drives that do not count as a reference, by status."""
_END = {
    "contact": "contact with another road user",
    "standstill": "the ego came to a standstill",
    "road_end": "the ego reached the end of the road",
    "off_road": "the ego left the road",
    "time_limit": "the simulated time limit was reached",
    "decided": "no collision was possible any more",
    "ads_error": "the controller failed",
    "ads_timeout": "the controller took too long over one step",
    "sim_error": "SUMO failed",
}
STRUCK = "another vehicle, at fault, ran into the ego's rear"
NEGLIGIBLE_LIMIT = 0.995  # a factor above this limits nothing that three digits would show
SHARE_WORTH_NAMING = 0.05  # of the loss 1 - C


# --- words for values -----------------------------------------------------------------------------


def number(value: float | None, digits: int) -> str:
    """A fixed number of decimals; a dash for what does not apply."""
    return "–" if value is None or not math.isfinite(value) else f"{value:z.{digits}f}"


def interval_words(interval: Bounds | None, digits: int, to: str = "..") -> str:
    """`0.912..1.000`; nothing without an interval."""
    return "" if interval is None else to.join(number(end, digits) for end in interval)


span = partial(interval_words, to=" to ")
"""`0.912 to 1.000`; nothing without an interval."""


def percent(share: float | None) -> str:
    """A share with about three significant digits, e.g. `7.69 %`, and more just below 1."""
    if share is None or not math.isfinite(share):
        return "not known"
    value = shown = 100.0 * share
    # digits by the share itself, or by what is missing to 1 if it would round to 100 %
    for part in (value, 100.0 - value):
        digits = min(6, max(0, 2 - math.floor(math.log10(abs(part) or 1.0))))
        shown = float(f"{value:z.{digits}f}")
        if shown != 100.0:
            break
    return f"{shown:z.15g} %"


def count(n: int, noun: str, nouns: str | None = None) -> str:
    """`1 case`, `3 cases`."""
    return f"{n} {noun if n == 1 else nouns or noun + 's'}"


def collision_words(exposure_known: bool) -> str:
    """Name of the collision probability.

    exposure_known: whether exposures were declared or measured.
    """
    return "Collision probability" if exposure_known else "Share of the points with a collision"


def one_line(text: str) -> str:
    """A text on one line, without control characters, which would repaint a terminal."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def end_reason(case: CaseResult) -> str:
    """Reason why a case ended, in words."""
    if case.struck_from_behind:
        return STRUCK
    return _END.get(case.end_reason or "", case.end_reason or "not known")


def nobody_recorded(evaluation: Evaluation) -> bool:
    """Whether recorded drivers were asked for, and none stands behind any D_i."""
    recorded = evaluation.settings.drivers.source == "recorded"
    return recorded and not any(people.drives for people in people_behind(evaluation))


def nobody_drove(evaluation: Evaluation) -> bool:
    """Whether no scenario has drivers to compare an ADS with."""
    return bool(evaluation.scores) and all(score.nobody_compared for score in evaluation.scores)


def people_sentence(evaluation: Evaluation) -> str:
    """The drivers that D and H compare with, how many of them are recorded people, and how many
    drives of these each limit leaves out.
    """
    words, drivers = _people_words(evaluation), evaluation.settings.drivers
    if drivers.source != "recorded":
        return words
    # columns of `left_out`; with a row of zeros they exist without any entry, too
    short, share, astray = zip((0, 0.0, 0), *evaluation.left_out, strict=True)
    if any(short):
        words += (
            f" {count(sum(short), 'recorded drive')} left out: at most {percent(max(share))} "
            f"of the road covered, at least {percent(drivers.coverage)} asked (`drivers.coverage`)."
        )
    if any(astray):
        words += f" {count(sum(astray), 'recorded drive')} left out: they leave the road."
    return words


def _people_words(evaluation: Evaluation) -> str:
    drivers = evaluation.settings.drivers
    if nobody_drove(evaluation):
        return (
            "D and H have no drivers to compare with: synthetic drivers do not cover these scenes, "
            "and no recorded driver matches them."
        )
    if drivers.source != "recorded":
        without = ", ".join(
            dict.fromkeys(score.scenario for score in evaluation.scores if score.nobody_compared)
        )
        origin = (
            f"The {drivers.count} human drivers of each concrete scenario are synthetic: "
            "drawn from distributions fitted to recorded traffic. They are not recorded people."
            if drivers.source == "synthetic"
            else f"The human drivers come from `{drivers.source}`, which this evaluation names as "
            "its reference."
        )
        return origin + (f" There are none in {without}." if without else "")
    behind = people_behind(evaluation)
    source = ", ".join(drivers.recordings) or drivers.cases
    fills = drivers.too_thin == "fill"
    if not any(people.drives for people in behind):
        instead = "D and H compare with synthetic drivers alone" if fills else "there is no D_i"
        who = "no drive counts" if fills else f"fewer than {drivers.least} drives count"
        points = count(sum(people.points for people in behind), "safe concrete scenario")
        return (
            f"D and H use no recorded driver: of {source}, {who} in any of these {points}; "
            f"{instead}. `recorded_drivers` in cases.csv counts them."
        )
    rest = "synthetic drivers fill up" if fills else "the point is left out"
    each = "; ".join(
        f"{people.scenario}: {people.with_people} of "
        f"{count(people.points, 'safe concrete scenario')}, "
        f"{count(people.drives, 'recorded drive')}"
        for people in behind
    )
    return (
        f"Recorded people ({source}) stand behind D and H in {each}. Where they are fewer than "
        f"{drivers.least}, {rest}."
    )


def sampling_words(sampling: SamplingSettings, logical: LogicalScenario) -> str:
    """Choice of the points, in words; the rules are those of
    `sumo_eval.scenario.sampling.samples.sample`.
    """
    suffixes = {item.name: item.unit_suffix for item in logical.parameters}
    grid = "grid" if sampling.levels is not None or sampling.steps else None
    method = sampling.method or grid or ("file" if sampling.file else logical.default_sample)
    # a sample that the scenario brings along describes itself
    texts = [item.about for item in logical.samples if item.name == method]
    if texts:
        return f"{method}, {texts[0]}"
    if sampling.count is not None:
        return f"{method}, {sampling.count} points asked for"
    if sampling.file is not None:
        return f"{method}, {sampling.file}"
    if isinstance(sampling.levels, int):
        return f"{method}, {sampling.levels} points on each axis"
    parts = [f"{name}: {levels} points" for name, levels in (sampling.levels or {}).items()]
    parts += [
        f"{name}: steps of {step:g}{suffixes.get(name, '')}"
        for name, step in (sampling.steps or {}).items()
    ]
    own_steps = f"{'elsewhere ' if parts else ''}the space's own steps"
    return ", ".join([method, *parts, own_steps])


# --- what could not be evaluated ------------------------------------------------------------------


def why_missing(case: CaseResult) -> str:
    """Reason why a case is missing from a mean, for missing cases only."""
    if not case.evaluated:
        return case.error or _STATUS.get(case.status, f"Its status is {case.status}.")
    for severity, whose, symbol, error in (
        (case.ideal_severity, "The ideal vehicle's case", "Ug", case.ideal_error),
        (case.no_reaction_severity, "The case of `no_reaction`", "U0", case.no_reaction_error),
    ):
        if severity is None:
            unknown = f"could not be evaluated, so {symbol} is not known."
            return f"{whose} here {unknown}{because(error)}"
    few = "Fewer than two human drivers could be compared with here."
    return f"There is no D_i: {index_note_words(case) or reference_note_words(case) or few}"


def because(error: str) -> str:
    """The recorded error of a reference's drive, to follow `... could not be evaluated.`"""
    return f" Recorded of it: {_STATUS.get(error, error)}" if error else ""


def placed(sentence: str, case: CaseResult) -> str:
    """A sentence about a case with the place in the user's code that its exception came from, where
    there is one.
    """
    return f"{sentence} At {case.error_place}." if case.error_place else sentence


def severity_words(value: float | None, unit: str, digits: int = 1) -> str:
    """`5.0 m/s`; a loss in 0..1, which has no unit, with three decimals."""
    return "not known" if value is None else number(value, digits if unit else 3) + unit


# --- why A, H and S+ are what they are ------------------------------------------------------------


def collisions_sentence(score: ScenarioResult) -> str:
    """`5 collisions: 3 avoidable (1 of them caused by the ADS), 2 unavoidable.`"""
    if score.collisions == 0:
        return f"{score.ads} did not collide."
    avoidable, unavoidable = score.avoidable_collisions, score.unavoidable_collisions
    unknown = score.collisions - avoidable - unavoidable
    caused = score.caused_collisions
    parts = f"{avoidable} avoidable"
    parts += f" ({caused} of them caused by the ADS)" if caused else ""
    parts += f", {unavoidable} unavoidable"
    parts += f", {unknown} where the ideal vehicle could not be evaluated" if unknown else ""
    return f"{score.ads} had {count(score.collisions, 'collision')}: {parts}."


def missing_term(name: str, reason: str) -> str:
    """`D is not computed: no case lies in the safe zone. Its term counts 0 points.`"""
    return f"{name} is not computed: {reason}. Its term counts 0 points."


def explain_a(findings: Findings) -> str:
    """Explanation of A."""
    score = findings.score
    sentence = collisions_sentence(score)
    if score.avoided_share is None:
        return f"{sentence} {missing_term('A', 'no case could be evaluated')}"
    unit = findings.settings.method.collision.regret_unit
    regret = "" if score.regret is None else f"; the regret is {number(score.regret, 3)}{unit}"
    if score.avoided_share == 1.0:
        return f"{sentence} A = A' = 1: no incident is harder than the ideal vehicle's{regret}."
    below = ": worse than doing nothing, and S+ takes 0" if score.avoided_share < 0.0 else ""
    grade = number(score.avoidance_grade, 3)
    losses = np.nan_to_num(findings.share_lost)
    worst = int(np.argmax(losses))
    return (
        f"{sentence} A = {number(score.avoided_share, 3)}, A' = {grade}{below}{regret}."
        + _most_from("A", findings.cases[worst], float(losses[worst]), 1.0 - score.avoided_share)
    )


def _most_from(name: str, case: CaseResult, lost: float, of: float) -> str:
    """Sentence on the case that took most from a score; empty if it is not worth naming.

    lost: loss of the case.
    of: loss of all cases; 0 where nothing is lost.
    """
    if not (lost and lost >= SHARE_WORTH_NAMING * of):
        return ""
    return f" {point_words(case.values)} took the most from {name}: {lost:z.3f} of {of:z.3f}."


def explain_h(findings: Findings) -> str:
    """Explanation of H."""
    score, likened = findings.score, findings.likened
    if score.human_likeness is None:
        return missing_term("H", reason_without("H", score))
    hits = int(np.count_nonzero(likened & findings.cases.incident))
    means = findings.likeness_means
    limit = f", {_limit(means, '{}')}" if means else ""
    counted = count(int(np.count_nonzero(likened)), "safe case")
    sentence = f"H = {number(score.human_likeness, 3)}: mean over {counted}{limit}."
    counts = "counts" if hits == 1 else "count"
    return sentence + (
        f" {count(hits, 'case')} with an avoidable incident {counts} 0." if hits else ""
    )


def explain_s_plus(findings: Findings) -> str:
    """Explanation of S+ from T, A' and H."""
    score, points = findings.score, findings.settings.method.score
    if score.s_plus is None:
        reason = REASON_WITHOUT_T if score.task_share is None else REASON_WITHOUT_C
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
    groups = (score.departures, "left the road"), (score.gave_up, "given up")
    lost = ", ".join(f"{count(cases, 'case')} {words}" for cases, words in groups if cases)
    return f"T = {number(score.task_share, 3)} beside {beside}{'; ' if lost else ''}{lost}."


def reference_sentence(settings: EvaluationSettings) -> str:
    """The reference, and why it is used."""
    ads = reference_ads(settings)
    if ads is None:
        return (
            f"No ADS of this run is “{settings.report.reference}”, so the reference is the ideal "
            "vehicle, which brakes at once at the limit, driven through the same concrete "
            "scenarios."
        )
    return (
        f"The reference is “{ads}”, driven through the same concrete scenarios as every other "
        "ADS of this run."
    )


# --- why C, D and S are what they are -------------------------------------------------------------


def explain_c(findings: Findings) -> str:
    """Explanation of C."""
    score, loss = findings.score, findings.settings.method.collision.loss
    if score.c is None:
        return missing_term("C", REASON_WITHOUT_C)
    if score.collisions == 0:
        evaluated = count(int(np.count_nonzero(findings.cases.evaluated)), "evaluated case")
        return f"{score.ads} did not collide in any of {evaluated}, so C = 1."
    zones = (
        (score.collisions - score.safe_collisions, score.hazardous_cases, "hazardous case"),
        (score.safe_collisions, score.safe_cases, "safe case"),
    )
    where = " and in ".join(f"{hits} of {count(of, noun)}" for hits, of, noun in zones if hits)
    ratio, avoiding = (
        ("Ug/U", "has Ug/U = 0") if loss == "severity" else ("Lg/L", "still has Lg = 0.1")
    )
    worst = findings.collisions[0]
    return (
        f"{score.ads} collided in {where}; the ideal vehicle avoids {score.avoidable_collisions} "
        f"of these. C = {score.c:z.3f}: the mean of {ratio} over the collisions, weighted by r. "
        f"A collision that the ideal vehicle avoids {avoiding}."
        + _most_from("C", findings.cases[worst], float(findings.lost_of_c[worst]), 1.0 - score.c)
    )


def explain_d(findings: Findings) -> str:
    """Explanation of D."""
    score, cases, counted = findings.score, findings.cases, findings.indexed
    if score.d is None:
        return missing_term("D", reason_without("D", score))
    indexed = int(np.count_nonzero(counted))
    limit = _limit(findings.factor_means, "the {} factor")
    sentence = f"D = {score.d:z.3f}: mean over {count(indexed, 'safe case')}, {limit}."
    low = int(np.count_nonzero(counted & (cases.index < 0.1)))
    if 0 < low < indexed:
        sentence += f" {low} of them {'scores' if low == 1 else 'score'} below 0.1."
    notes = cases.index_note[cases.safe]
    if split := sum(any(note.kind == "two_groups" for note in of_case) for of_case in notes):
        sentence += f" In {split} of them {TWO_GROUPS}"
    return sentence


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
    parts = [
        f"{effect} in {', '.join(names)}"
        for names, effect in (
            (ranking.without_task, "no task, so no S+,"),
            (ranking.without_people, "H counts 0, without people,"),
        )
        if names
    ]
    return ": " + "; ".join(parts) if parts else ""


def reason_without(name: str, score: ScenarioResult) -> str:
    """Reason why there is no D, or no H, without the words `not computed`."""
    note, what = {"D": (score.d_reason, "D_i"), "H": (score.h_reason, "human-likeness")}[name]
    if note is None:
        return ""
    return {
        "collisions": f"{count(note.collisions, 'collision')} in the safe zone",
        "no_safe_case": "no case lies in the safe zone",
        "no_drivers": "no drivers for it: the synthetic ones do not know this scene, and none are "
        "recorded in it",
        "nothing_compared": "no safe case could be evaluated and compared with drivers",
        "no_exposure": f"every safe case with a {what} has exposure 0",
    }[note.why]


def not_computed(reason: str) -> str:
    """`not computed: no case lies in the safe zone`; nothing where there is no reason."""
    return f"not computed: {reason}" if reason else ""


_INDEX_NOTES: dict[NoteKind, str] = {
    "manoeuvre_made_by": "Compared with the {count} of {of} drivers who made the same manoeuvre "
    "({done}).",
    "manoeuvre_made_by_nobody": "No driver made the ADS's manoeuvre ({done}), so its similarity "
    "is 0.",
    "centre_floor": "Deviation floor of the centre applied at {count} of {of} slices.",
    "field_floor": "Deviation floor of the field applied at {count} of {of} points.",
    "two_groups": "At {count} of {of} slices the drivers are in two groups, over half a lane "
    "apart (bimodal).",
    "driver_not_so_far": "At {count} of {of} slices some drivers had not got that far.",
    "drivers_hold_last_y": "At {count} of {of} slices fewer than two drivers had got that far; "
    "the rest hold their last y.",
    "ads_off_road": "At {count} of {of} slices the ADS's centre is off the road; that side's "
    "points collapse on it.",
    "past_the_road": "{count} of {of} trajectories continue past the road's end and are read up "
    "to it.",
    "drivers_start_late": "{count} of {of} drivers start beyond the ADS's start and hold their "
    "first y up to there.",
    "drivers_still_driving": "{count} of {of} drivers were still driving when last seen: their "
    "length counts to the road's end.",
    "ads_still_driving": "The ADS was still driving when last seen: its length counts to the "
    "road's end, and slices end there.",
    "ads_left_the_road": "The ADS left the road: its length is what it drove.",
    "drivers_without_operation": "The drivers made no operation at all, so the ADS's operations "
    "make D zero.",
}


def notes_sentence(notes: Sequence[IndexNote]) -> str:
    """Sentence for all notes of one kind and manoeuvre, with the ranges of their numbers."""
    first = notes[0]
    counts, totals = _range([note.count for note in notes]), _range([note.of for note in notes])
    done = manoeuvre_words(first.manoeuvre) if first.manoeuvre else ""
    return _INDEX_NOTES[first.kind].format(count=counts, of=totals, done=done)


def index_note_words(case: CaseResult) -> str:
    """Notes on the D_i of a case; empty without any."""
    return " ".join(notes_sentence([note]) for note in case.index_note)


def reference_note_words(case: CaseResult) -> str:
    """Reason why the drivers of a case are too few, and the consequence; empty where they are
    enough.
    """
    note = case.reference_note
    if note is None:
        return ""
    ending = "left out." if note.filled is None else f"filled with {note.filled} synthetic ones."
    return (
        f"Reference too thin: {note.recorded} of at least {note.least} recorded drivers; {ending}"
    )


def exposure_note_words(case: CaseResult) -> str:
    """A note where no recorded event is like the case; else empty."""
    outside = "Outside the data's support: no recorded event is like this concrete scenario."
    return outside if case.exposure_note == "outside_support" else ""


_COUNTED = {
    "compared": "{number} of {of} cases that shared SUMO were compared alone: equal.",
    "actors_left": "In {cases} an actor reached the end of the network and left it; the case "
    "continued without it (clip `actor_left_the_network`).",
    "actors_moved": "In {cases} the ADS moved an actor off its script (clip "
    "`actor_off_its_script`): do not compare these cases with those of other ADSs.",
    "outside_support": "{number} of {of} cases lie outside the support of the recorded exposure.",
    "struck_from_behind": "In {cases} an actor that reacts ran into the ego's rear: its own fault, "
    "counted apart, no collision for C and A (`method.collision.rear_end`). Its t_i is 0: any "
    "contact ends the drive, whichever vehicle is at fault.",
    "excused": "In {number} of {of} safe cases the ego stands where the references drive on. T "
    "leaves out the rest of the route, because a road user in front excuses it.",
    "gentler_than_ideal": "In {hits} the ADS hit more softly than the ideal vehicle; each has the "
    "ratio 1.",
    "references_collide": "The space is called safe at {of_points}, yet drivers or the reference "
    "car collide at {number} of them: a scripted actor does not react and may strike an ego that "
    "slows down. If another actor is struck, check `zone.obstacle` of the scenario. Synthetic "
    'drivers do not see actors that cross: such a scenario needs `people = "none"`.',
    "ideal_collides_too": "The ideal vehicle has {number} of {of_hits} in the safe zone as well: C "
    "and A count them, D and H leave them out.",
}
"""Sentence of a `Counted` note, by what it counts."""


def score_note(note: ScoreNote) -> str:
    """One note on a score as sentences."""
    match note:
        case DrivesLeftOut(left_out, drives, statuses):
            how = ", ".join(
                f"{number} {_LEFT_OUT.get(status, status)}" for status, number in statuses
            )
            return f"The reference leaves out {left_out} of the drivers' {drives} drives: {how}."
        case DrivenAlone(alone):
            why = " ".join(f"{number} x: {reason}" for reason, number in alone)
            drives = sum(times for _, times in alone)
            return (
                f"{count(drives, 'drive')} could not share one simulation with others and ran "
                f"alone, which changes results of policies over arrays only. {why}"
            )
        case DrivenInBlocks(drives, sizes):
            return (
                "Its policy over arrays received cases in fixed batches of "
                f"{' and '.join(map(str, sizes))} "
                f"({count(drives, 'drive')}). The last bits of its answers may depend on the batch."
            )
        case BeyondRange(severity, reasons):
            why = "; ".join(f"{number} x {reason}" for reason, number in reasons)
            hits = sum(number for _, number in reasons)
            return f"{count(hits, 'collision')} outside the range of `{severity}`: {why}."
        case ThinReferences(thin, safe, left_out):
            return (
                f"Reference too thin in {thin} of {safe} safe cases: {thin - left_out} filled with "
                f"synthetic drivers, {left_out} left out of D."
            )
        case Counted(what, counted, of):
            return _COUNTED[what].format(
                number=counted, of=of, cases=count(counted, "case"),
                hits=count(counted, "collision"),
                of_points=count(of, "point"), of_hits=count(of, "collision"),
            )  # fmt: skip
        case PlausibleTo(scenario, people, drives, least, instead):
            if instead is None:
                return (
                    f"Plausibility compares with {people} recorded drivers of the run ({drives} "
                    "drives)."
                )
            return (
                f"Plausibility compares with {instead} people on a motorway: the run has {people} "
                f"recorded drivers in `{scenario}`, and a table needs {least}."
            )
        case CasesMissing(zones):
            places = " and ".join(f"{number} in the {zone} zone" for zone, number in zones)
            missing = count(note.cases, "case")
            return (
                f"{missing} could not be evaluated ({places}); the scores are means over the rest"
                f"{GIVEN_UP}."
            )
        case ReferenceMissing(who, reason, cases, example):
            drove, unknown = _REFERENCES[who]
            return (
                f"In {count(cases, 'case')}, e.g. {example}, {drove} could not be evaluated, so "
                f"{unknown} is not known.{because(reason)}"
            )
        case WorstAndBest(c, d, s):
            scores = ("C", c, 3), ("D", d, 3), ("S", s, 1)
            parts = [
                f"{name} within {interval_words(it, digits)}" for name, it, digits in scores if it
            ]
            return f"With the missing cases counted as worst and as best: {', '.join(parts)}."
        case RequirementMissed(name, text, cases, of):
            words = f"`{text}`" if name == text else f"{name} (`{text}`)"
            return f"{cases} of {count(of, 'case')} miss the requirement {words}."


class GatheredNote(NamedTuple):
    """A note that D_i left in several cases of one ADS and scenario; numbers that differ stand as a
    range.
    """

    ads: str
    scenario: str
    cases: int
    text: str


def index_notes(evaluation: Evaluation) -> list[GatheredNote]:
    """The notes on D_i, gathered by kind and manoeuvre, the most frequent first."""
    gathered = []
    for findings in findings_of(evaluation):
        # each different note -> number of cases
        often = Counter(note for notes in findings.cases.index_note for note in notes)
        # the same notes by kind and manoeuvre
        alike = grouped(((note.kind, note.manoeuvre), note) for note in often)
        cases = {key: sum(often[note] for note in notes) for key, notes in alike.items()}
        gathered += [
            GatheredNote(
                findings.score.ads, findings.score.scenario, cases[key], notes_sentence(alike[key])
            )
            for key in sorted(alike, key=lambda key: (-cases[key], key))
        ]
    return gathered


def _range(numbers: Sequence[int]) -> str:
    """`3`, or `3 to 5`."""
    low, high = min(numbers), max(numbers)
    return f"{low}" if low == high else f"{low} to {high}"


def explain_s(findings: Findings) -> str:
    """Sum of S, in words."""
    score, terms = findings.score, findings.settings.method.score
    if score.s is None:
        return "S is not computed: nothing could be evaluated."
    d_term = f"D gives {score.d_points:z.1f}" if score.d is not None else "D, not computed, gives 0"
    scaled = (
        "" if terms.k5 == terms.k6 == 1.0 else f" (scaled by k5 = {terms.k5:g}, k6 = {terms.k6:g})"
    )
    c_term = f"C gives {score.c_points:z.1f} of {terms.a:g} points"
    return f"S = {score.s:z.1f}: {c_term}, {d_term} of {terms.b:g} points{scaled}."


EXPLAIN = (explain_t, explain_a, explain_h, explain_s_plus)
EXPLAIN_PAPER = (explain_c, explain_d, explain_s)
"""Functions that make the sentences on one ADS in one scenario, the paper's scores apart."""
