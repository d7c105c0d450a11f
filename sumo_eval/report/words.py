"""The sentences that the HTML report and the terminal share: what happened in a run, and why a score is so."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.method.anthropomorphic import BIMODAL
from sumo_eval.method.collision_avoidance import collision_loss
from sumo_eval.method.score_terms import exposure_mean, ideal_ratio, once
from sumo_eval.results import CaseResult, Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import avoided_share_losses, case_terms
from sumo_eval.settings import EvaluationSettings

REASON_WITHOUT_C = "no case that tells how collisions are avoided could be evaluated"

OUTCOMES = ("no contact", "collision", "off road", "not evaluated")
"""What became of a case, in the order in which the report shows it."""

FACTORS = {
    "length": ("length_factor", "f_L, min(1, L / mean L of the drivers)"),
    "operations": ("operation_factor", "f_n, min(1, operations of the drivers / operations of the ADS)"),
    "similarity": ("similarity", "mean over the slices of min(1, pt/pt_2s) min(1, pv/pv_2s)"),
}
"""The factors of D_i: name -> (field of CaseResult, meaning)."""

LIKENESS_FACTORS = {
    "length": ("length_factor", "f_L, min(1, L / mean L of the drivers)"),
    "operations": ("operation_tolerance", "f_n+, 1 up to the drivers' mean number of operations, less far above it"),
    "similarity": ("mixture_similarity", "as in D, beside the drivers who made the same kind of manoeuvre"),
    "plausibility": ("plausibility", "1 where at least 5 % of recorded people go to such extremes, less beyond"),
}
"""The factors of a case's part in H: name -> (field of CaseResult, meaning)."""

GLOSSARY = {
    "A": "avoided share: how much of the collision severity that doing nothing would bring and the ideal vehicle would "
    "not was avoided, over all cases. 1: as the ideal vehicle; 0: as doing nothing; below 0: worse than that",
    "H": "human-likeness: mean over the safe cases of length factor, operations factor, similarity and plausibility "
    "multiplied; 0 for a safe case with an avoidable collision",
    "S+": "the score that orders: a A + b H, 0 to 100 points; an A below 0 counts 0",
    "regret": "by how much severity the ADS exceeds the ideal vehicle: mean over all cases, weighted by r; 0 is best",
    "C": "collision avoidance of the paper, Eq. 17: mean of Ug/U over the collisions alone; 1 without a collision",
    "D": "human-likeness index of the paper, Eq. 13: mean of D_i over the safe cases; none after an avoidable "
    "collision among them",
    "S": "score of the paper, Eq. 18: a C + b D, 0 to 100 points",
    "avoidable": "a collision that the ideal vehicle does not have in the same concrete scenario",
    "unavoidable": "a collision that the ideal vehicle has as well",
    "caused": "an avoidable collision that even a car that does nothing would not have had",
    "ideal vehicle": "sees whatever is in sight, brakes at once and as hard as the road allows",
    "doing nothing": "the driver `no_reaction`: keeps speed and lane whatever happens",
    "U": "severity of a collision, Eq. 15: relative speed at first contact over the overlap of the bumpers, m/s",
    "Ug": "severity of the ideal vehicle in the same concrete scenario, m/s; 0 where it avoids",
    "U0": "severity of doing nothing in the same concrete scenario, m/s; 0 where nothing is hit",
    "L": "loss class of a collision, Eq. 14: 1, 0.7, 0.4 by severity, 0.1 without one",
    "r": "weight of a case, Eq. 16: its distance from the most dangerous point, 1 at the border of the hazardous zone",
    "TTC": "time to collision: gap over closing speed, s",
    "ITTC": "inverse time to collision, 1/s: the larger, the more critical",
    "THW": "time headway: gap over own speed, s",
    "DRAC": "deceleration needed to avoid a crash, m/s²",
    "exposure": "how often a concrete scenario is met in traffic, where somebody declared or measured it; else each "
    "counts the same",
    "slice": "a cross-section of the road, every half metre, at which paths are compared",
    "trajectory field": "how strongly a vehicle claims the space around its path, Eqs. 9–10",
    "plausibility": "share of recorded people who go to such extremes of headway, time to collision, braking, jerk and "
    "lateral motion, 1 from 5 % on",
    "safe zone, hazardous zone": "where braking as set (5 m/s²) keeps clear of a collision, and where not",
    "interval": "a range that would hold the true number in 95 of 100 evaluations with other cases and drivers",
}
"""The terms of the report in plain words; what the page explains of a term stands here once."""

MEASURES = (
    ("min_ttc", "shortest TTC", "s"),
    ("max_ittc", "largest inverse TTC", "1/s"),
    ("min_thw", "shortest time headway", "s"),
    ("min_gap", "smallest gap ahead", "m"),
    ("max_drac", "largest DRAC", "m/s²"),
    ("pet", "post-encroachment time", "s"),
    ("max_deceleration", "strongest deceleration", "m/s²"),
    ("max_jerk", "largest jerk", "m/s³"),
    ("delta_v", "delta-v at contact", "m/s"),
)
"""The criticality measures of a case: (field of CaseResult, words, unit)."""

_STATUS = {
    "timeout": "The case took longer than it may.",
    "ads_error": "The controller failed.",
    "ads_timeout": "One step of the controller took longer than it may.",
    "sim_error": "SUMO refused or lost something.",
    "crashed": "The process that ran the case died.",
    "rejected": "The case was refused before it began.",
}
_END = {
    "contact": "contact with another vehicle",
    "standstill": "the ego came to a standstill",
    "road_end": "the ego reached the end of the road",
    "off_road": "the ego left the road",
    "time_limit": "the simulated time limit was reached",
    "decided": "nothing could come of it any more",
    "ads_error": "the controller failed",
    "ads_timeout": "the controller took too long over one step",
    "sim_error": "SUMO failed",
}
SCORES = {
    "A": ("avoided_share", 3),
    "H": ("human_likeness", 3),
    "S+": ("s_plus", 1),
    "C": ("c", 3),
    "D": ("d", 3),
    "S": ("s", 1),
    "regret": ("regret", 3),
}
"""The scores by the letters that people read: (field of ScenarioResult, digits)."""
NEGLIGIBLE_LIMIT = 0.995  # a factor above this limits nothing that three digits would show
SHARE_WORTH_NAMING = 0.05  # of the loss 1 - C


# --- words for values -------------------------------------------------------------------------------------------------


def number(value: float | None, digits: int) -> str:
    """A fixed number of decimals; a dash for what does not apply."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def interval_words(interval: tuple[float, float] | None, digits: int) -> str:
    """`0.912..1.000`; nothing where there is no interval."""
    return "" if interval is None else f"{number(interval[0], digits)}..{number(interval[1], digits)}"


def percent(share: float | None) -> str:
    """A share with about three significant digits, e.g. `7.69 %`."""
    if share is None or not math.isfinite(share):
        return "not known"
    value = 100.0 * share
    if value == 0.0:
        return "0 %"
    digits = min(6, max(0, 2 - math.floor(math.log10(abs(value)))))
    text = f"{value:.{digits}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def count(n: int, noun: str, nouns: str | None = None) -> str:
    """`1 case`, `3 cases`."""
    return f"{n} {noun if n == 1 else nouns or noun + 's'}"


def point(values: Mapping[str, float]) -> str:
    """`ego_speed=30, gap=40`: a point in words."""
    return ", ".join(f"{name}={value:g}" for name, value in values.items())


def collision_words(known: bool) -> str:
    """What the collision probability is called. known: whether exposures were declared or measured."""
    return "Collision probability" if known else "Share of the points with a collision"


def outcome(case: CaseResult) -> str:
    """Which of OUTCOMES a case had."""
    if case.collided:
        return "collision"
    if not case.evaluated:
        return "not evaluated"
    return "off road" if case.status == "off_road" else "no contact"


def end_reason(case: CaseResult) -> str:
    """Why a case ended, in words."""
    return "not known" if case.end_reason is None else _END.get(case.end_reason, case.end_reason)


def drivers_are_synthetic(settings: EvaluationSettings) -> bool:
    """Whether the human drivers are this package's own population."""
    return settings.drivers.source == "synthetic"


def drivers_sentence(settings: EvaluationSettings) -> str:
    """Who the human drivers are: nobody may take synthetic ones for recorded people."""
    if drivers_are_synthetic(settings):
        return (
            f"The {settings.drivers.count} human drivers of each concrete scenario are synthetic: drawn from "
            "distributions fitted to recorded traffic. They are not recorded people."
        )
    if settings.drivers.source == "recorded":
        thin = "filled with synthetic drivers" if settings.drivers.too_thin == "fill" else "left out"
        source = ", ".join(settings.drivers.recordings) or settings.drivers.cases
        return (
            f"The human drivers are recorded people ({source}). "
            f"Where fewer than {settings.drivers.least} were recorded, the concrete scenario is {thin}."
        )
    return f"The human drivers come from `{settings.drivers.source}`, which this evaluation names as its reference."


# --- what could not be evaluated --------------------------------------------------------------------------------------


def _void(score: ScenarioResult) -> bool:
    """Whether a collision in the safe zone left no D, so that nobody misses the D_i of a case."""
    return score.d is None and score.safe_collisions > 0


def cases_of(evaluation: Evaluation, score: ScenarioResult) -> list[CaseResult]:
    """The cases of one ADS in one logical scenario."""
    return [case for case in evaluation.cases if (case.ads, case.scenario) == (score.ads, score.scenario)]


def unevaluated(evaluation: Evaluation) -> list[tuple[CaseResult, str]]:
    """Every case that is missing from a mean, with a sentence that says why."""
    missing = []
    for score in evaluation.scores:
        for case in cases_of(evaluation, score):
            if not case.evaluated:
                missing.append((case, case.error or _STATUS.get(case.status, f"Its status is {case.status}.")))
            elif case.ideal_severity is None:
                missing.append((case, "The ideal vehicle's case here could not be evaluated, so Ug is not known."))
            elif case.no_reaction_severity is None:
                missing.append((case, "The case of `no_reaction` here could not be evaluated, so U0 is not known."))
            elif case.counts_for_index and not _void(score) and case.index is None:
                why = (
                    case.index_note
                    or case.reference_note
                    or "Fewer than two human drivers could be compared with here."
                )
                missing.append((case, f"There is no D_i: {why}"))
    return missing


def placed(sentence: str, case: CaseResult) -> str:
    """A sentence about a case with the place in the user's code that its exception came from, where there is one."""
    return f"{sentence} At {case.error_place}." if case.error_place else sentence


def severity_unit(settings: EvaluationSettings) -> str:
    """Unit of U, Ug, U0 and the regret, with a blank before it; a loss in 0..1 in their place has none."""
    chosen = settings.method.collision
    return " m/s" if chosen.severity == "severity" and chosen.loss == "severity" else ""


# --- why A, H and S+ are what they are --------------------------------------------------------------------------------


def collisions_sentence(score: ScenarioResult) -> str:
    """`5 collisions: 3 avoidable (1 of them caused by the ADS), 2 unavoidable.`"""
    if score.collisions == 0:
        return f"{score.ads} did not collide."
    caused = f" ({score.caused_collisions} of them caused by the ADS)" if score.caused_collisions else ""
    parts = [f"{score.avoidable_collisions} avoidable{caused}", f"{score.unavoidable_collisions} unavoidable"]
    unknown = score.collisions - score.avoidable_collisions - score.unavoidable_collisions
    if unknown:
        parts.append(f"{unknown} where the ideal vehicle could not be evaluated")
    return f"{score.ads} had {count(score.collisions, 'collision')}: {', '.join(parts)}."


def explain_a(score: ScenarioResult, cases: Sequence[CaseResult], settings: EvaluationSettings) -> list[str]:
    """Why A is what it is."""
    said = [collisions_sentence(score)]
    if score.avoided_share is None:
        return [*said, "A is not computed: no case could be evaluated. Its term counts 0 points."]
    regret = "" if score.regret is None else f"; the regret is {number(score.regret, 3)}{severity_unit(settings)}"
    if score.avoided_share == 1.0:
        return [*said, f"A = 1: no collision is harder than the ideal vehicle's{regret}."]
    below = ": worse than doing nothing, and S+ takes 0" if score.avoided_share < 0.0 else ""
    said.append(f"A = {number(score.avoided_share, 3)}{below}{regret}.")
    losses = [loss or 0.0 for loss in share_lost(cases, settings)]
    worst = int(np.argmax(losses))
    if losses[worst] >= SHARE_WORTH_NAMING * (1.0 - score.avoided_share):
        of = number(1.0 - score.avoided_share, 3)
        said.append(f"{point(cases[worst].values)} took the most from A: {number(losses[worst], 3)} of {of}.")
    return said


def share_lost(cases: Sequence[CaseResult], settings: EvaluationSettings) -> list[float | None]:
    """What each case of one ADS and scenario takes from A, together 1 - A; None where it has no part in A."""
    losses = avoided_share_losses(case_terms(cases, settings.method)).tolist()
    return [loss if math.isfinite(loss) else None for loss in losses]


def explain_h(score: ScenarioResult, cases: Sequence[CaseResult]) -> list[str]:
    """Why H is what it is."""
    if score.human_likeness is None:
        return [f"H is not computed: {reason_without_h(score)}. Its term counts 0 points."]
    counted = [case for case in cases if case.human_likeness is not None]
    hits = sum(case.collided for case in counted)
    means = likeness_means(cases)
    said = f"H = {number(score.human_likeness, 3)}: mean over {count(len(counted), 'safe case')}"
    if means:
        name = min(means, key=lambda factor: means[factor])
        others = ", ".join(f"{factor} {mean:.2f}" for factor, mean in means.items() if factor != name)
        said += (
            ", no factor limits it"
            if means[name] >= NEGLIGIBLE_LIMIT
            else f", limited most by {name} (mean {means[name]:.2f}; {others})"
        )
    lost = f"{count(hits, 'case')} with an avoidable collision {'counts' if hits == 1 else 'count'} 0."
    return [f"{said}.", *([lost] if hits else [])]


def explain_s_plus(score: ScenarioResult, settings: EvaluationSettings) -> str:
    """How S+ adds up."""
    if score.s_plus is None:
        return "S+ is not computed: nothing could be evaluated."
    terms = settings.method.score
    a_term = f"A gives {score.a_points:.1f} of {terms.a:g} points"
    h_term = f"H gives {score.h_points:.1f}" if score.human_likeness is not None else "H, not computed, gives 0"
    return f"S+ = {score.s_plus:.1f}: {a_term}, {h_term} of {terms.b:g} points."


def reason_without_h(score: ScenarioResult) -> str:
    """Why there is no H, without the words `not computed`."""
    return _reason(score.h_reason)


def likeness_means(cases: Sequence[CaseResult]) -> dict[str, float]:
    """Mean of every factor of a case's human-likeness over the safe cases without a collision, by exposure."""
    counted = [case for case in cases if case.human_likeness is not None and not case.collided]
    return _means(counted, LIKENESS_FACTORS)


# --- why C, D and S are what they are ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class CollisionShare:
    """One collision in C. avoided: its ratio Ug/U (or of the loss classes). lost: its part of 1 - C; parts add up."""

    case: CaseResult
    avoided: float | None
    lost: float | None


def collision_shares(cases: Sequence[CaseResult], settings: EvaluationSettings) -> list[CollisionShare]:
    """The collisions among the cases of one ADS and scenario, the one that took most from C first (Eq. 17)."""
    hits = [case for case in cases if case.collided]
    ratios = [ratio_of(case, settings.method.collision.loss) for case in hits]
    known = [(case, ratio) for case, ratio in zip(hits, ratios, strict=True) if ratio is not None]
    weights = np.array([case.weight or 0.0 for case, _ in known])
    if not weights.any():
        weights = np.ones(len(known))
    lost = {
        case.case: float(weight * (1.0 - ratio) / weights.sum())
        for (case, ratio), weight in zip(known, weights, strict=True)
    }
    shares = [CollisionShare(case, ratio, lost.get(case.case)) for case, ratio in zip(hits, ratios, strict=True)]
    return sorted(shares, key=lambda share: (share.lost is None, -(share.lost or 0.0), share.case.case))


def ratio_of(case: CaseResult, loss: str) -> float | None:
    """What the ideal vehicle would have suffered, over what the ADS did, at most 1."""
    if case.severity is None or case.ideal_severity is None:
        return None
    hit, best = case.severity, case.ideal_severity
    if loss == "class":
        hit, best = float(collision_loss(hit)), float(collision_loss(best))
    return float(ideal_ratio(hit, best))


def explain_c(score: ScenarioResult, cases: Sequence[CaseResult], settings: EvaluationSettings) -> list[str]:
    """Why C is what it is."""
    if score.c is None:
        return [f"C is not computed: {REASON_WITHOUT_C}. Its term counts 0 points."]
    judged = sum(case.evaluated for case in cases)
    if score.collisions == 0:
        return [f"{score.ads} did not collide in any of {count(judged, 'evaluated case')}, so C = 1."]
    risky = score.collisions - score.safe_collisions
    zones = ((risky, score.hazardous_cases, "hazardous case"), (score.safe_collisions, score.safe_cases, "safe case"))
    where = " and in ".join(f"{hits} of {count(of, noun)}" for hits, of, noun in zones if hits)
    ratio = "Ug/U" if settings.method.collision.loss == "severity" else "Lg/L"
    sentences = [
        f"{score.ads} collided in {where}; the ideal vehicle avoids {score.avoidable_collisions} of these.",
        f"C = {score.c:.3f}: the mean of {ratio} over the collisions, weighted by r. "
        + (
            f"A collision that the ideal vehicle avoids has {ratio} = 0."
            if settings.method.collision.loss == "severity"
            else "A collision that the ideal vehicle avoids still has Lg = 0.1."
        ),
    ]
    worst = next(iter(collision_shares(cases, settings)), None)
    if worst is not None and worst.lost and worst.lost >= SHARE_WORTH_NAMING * (1.0 - score.c):
        sentences.append(f"{point(worst.case.values)} took the most from C: {worst.lost:.3f} of {1.0 - score.c:.3f}.")
    return sentences


def explain_d(score: ScenarioResult, cases: Sequence[CaseResult]) -> list[str]:
    """Why D is what it is."""
    if score.d is None:
        return [f"D is not computed: {reason_without_d(score)}. Its term counts 0 points."]
    means = factor_means(cases)
    indexed = sum(case.index is not None and case.zone == "safe" for case in cases)
    name = min(means, key=lambda factor: means[factor])
    if means[name] >= NEGLIGIBLE_LIMIT:
        limit = "no factor limits it"
    else:
        others = ", ".join(f"{factor} {mean:.2f}" for factor, mean in means.items() if factor != name)
        limit = f"limited most by the {name} factor (mean {means[name]:.2f}; {others})"
    sentences = [f"D = {score.d:.3f}: mean over {count(indexed, 'safe case')}, {limit}."]
    low = [case for case in cases if case.zone == "safe" and case.index is not None and case.index < 0.1]
    if low and len(low) < indexed:
        sentences.append(f"{len(low)} of them {'scores' if len(low) == 1 else 'score'} below 0.1.")
    split = sum(case.zone == "safe" and BIMODAL in case.index_note for case in cases)
    if split:
        sentences.append(
            f"In {split} of them the drivers fall into two groups, such as overtaking and following, and one Gaussian "
            "spans both, so it tells little of the ADS's path there."
        )
    return sentences


def reason_without_d(score: ScenarioResult) -> str:
    """Why there is no D, without the words `not computed`."""
    return _reason(score.d_reason)


def _reason(recorded: str) -> str:
    return recorded.removeprefix("not computed").lstrip(": ").rstrip(".") or "no reason was recorded"


def factor_means(cases: Sequence[CaseResult]) -> dict[str, float]:
    """Mean of every factor of D_i over the safe cases that have one, by exposure; empty without any."""
    indexed = [case for case in cases if case.zone == "safe" and case.index is not None]
    return _means(indexed, FACTORS)


def _means(cases: Sequence[CaseResult], factors: Mapping[str, tuple[str, str]]) -> dict[str, float]:
    exposure = np.array([case.exposure for case in cases])
    if not exposure.sum() > 0.0:
        return {}
    return {
        name: float(exposure_mean([getattr(case, field) for case in cases], exposure, once(len(cases)))[0])
        for name, (field, _) in factors.items()
    }


@dataclass(frozen=True, slots=True)
class IndexNote:
    """A note that D_i left in several cases of one ADS and scenario; numbers that differ stand as a range."""

    ads: str
    scenario: str
    cases: int
    text: str


def index_notes(evaluation: Evaluation) -> list[IndexNote]:
    """The notes on D_i, gathered: the same sentence with other numbers is the same note, the most frequent first."""
    notes = []
    for score in evaluation.scores:
        found: dict[str, list[list[str]]] = {}
        for case in cases_of(evaluation, score):
            for sentence in _SENTENCE_END.split(case.index_note) if case.index_note else ():
                found.setdefault(_NUMBER.sub("{}", sentence), []).append(_NUMBER.findall(sentence))
        for shape, numbers in sorted(found.items(), key=lambda item: (-len(item[1]), item[0])):
            ranges = [_range(column) for column in zip(*numbers, strict=True)]
            text = "".join(
                f"{part}{value}" for part, value in itertools.zip_longest(shape.split("{}"), ranges, fillvalue="")
            )
            notes.append(IndexNote(score.ads, score.scenario, len(numbers), text))
    return notes


_SENTENCE_END = re.compile(r"(?<=\.) +(?=[A-Z])")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


def _range(texts: Sequence[str]) -> str:
    low, high = min(texts, key=float), max(texts, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"


def explain_s(score: ScenarioResult, settings: EvaluationSettings) -> str:
    """How S adds up."""
    if score.s is None:
        return "S is not computed: nothing could be evaluated."
    terms = settings.method.score
    d_term = f"D gives {score.d_points:.1f}" if score.d is not None else "D, not computed, gives 0"
    scales = "" if terms.k5 == terms.k6 == 1.0 else f" (scaled by k5 = {terms.k5:g}, k6 = {terms.k6:g})"
    c_term = f"C gives {score.c_points:.1f} of {terms.a:g} points"
    return f"S = {score.s:.1f}: {c_term}, {d_term} of {terms.b:g} points{scales}."
