"""The whole arithmetic of one case in words, each step with its equation's number, for
`sumo-eval explain`.

Fixed: numbers, which are those of the scores. Zone, r and D_i are computed again, as a check. Free
to change: words.

Users: `cli/look.py`, `cli/whatif.py`, `extras/figures/drawn.py`, `nightly/night.py`,
`report/export_case.py`, `report/replay.py`.
"""

import math
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.errors import unknown
from sumo_eval.method.anthropomorphic import AnthropomorphicIndex
from sumo_eval.method.collision_avoidance import SMALLEST_OVERLAP, collision_weight
from sumo_eval.method.point_criticality import criticality
from sumo_eval.method.score_terms import worth
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.store import Store, open_store
from sumo_eval.report.driving_words import driving_words
from sumo_eval.report.notes import because, index_note_words, notes_sentence
from sumo_eval.report.score_words import (
    REASON_WITHOUT_T,
    explain_s,
    explain_s_plus,
    missing_term,
    not_computed,
    reason_without,
)
from sumo_eval.report.words import MEASURES, STRUCK, count, end_reason, number, placed
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.drive_beside import index_again
from sumo_eval.scoring.findings import FACTORS, LIKENESS_FACTORS, Findings
from sumo_eval.scoring.zones import star_distance
from sumo_eval.text import point_words

ROUNDING = 1e-9  # largest accepted difference of a recomputed D_i from the scored one


def known_case(run: Path, key: str) -> Fact:
    """The drive of an ADS in a case.

    key: of the case, as in cases.csv.

    Raises InputError, with the nearest known key, where no ADS drove such a case.
    """
    with open_store(run) as store:
        fact = store.fact(key)
        if fact is None or fact.role != "ads":
            raise unknown("case", key, [case for case, _, _ in store.names("ads")])
    return fact


def explain_case(
    evaluation: Evaluation, partitions: Mapping[str, ZonePartition], fact: Fact
) -> list[str]:
    """The lines that `sumo-eval explain` prints on the drive of an ADS."""
    case = evaluation.case(fact.case)
    assert case is not None, "every drive of an ADS is a case"
    zones = partitions[case.scenario]
    findings = Findings.of(evaluation, evaluation.score(case.ads, case.scenario))
    with open_store(evaluation.folder) as store:
        return [
            f"{case.case}: {case.ads} in {case.scenario} at {point_words(case.values)}",
            f"  {'struck' if case.struck_from_behind else case.outcome}; {end_reason(case)}"
            + (f" after {case.simulated_time:z.2f} s" if case.simulated_time is not None else "")
            + (f"; {placed(case.error, case)}" if case.error else ""),
            *(f"  {line}" for line in driving_words(evaluation, case, fact, zones.logical, store)),
            "",
            *(
                f"  {line}"
                for line in chain(
                    _zone(case, zones),
                    _weight(case, zones),
                    _collision(case, fact, findings),
                    _likeness(case, fact, findings, evaluation, zones, store),
                    _task(case, findings),
                    _avoided(case, findings),
                    _human(case, findings),
                    _measures(case),
                    (explain_s_plus(findings), f"Eq. 18: {explain_s(findings)}"),
                )
            ),
        ]


def _zone(case: CaseResult, zones: ZonePartition) -> Iterator[str]:
    """Zone of the case: exact, and as the Gaussian process learnt it."""
    logical, settings = zones.logical, zones.settings
    if not (logical.approach or logical.search or logical.margin):
        yield "Eqs. 1-8: the scenario declares no zones, so every point counts as safe"
        return
    row = logical.row(case.values)
    critical = criticality(logical, row[None], settings)  # arrays of one point
    if logical.margin is not None:
        yield (
            f"in place of Eqs. 1-6: {critical.gap[0]:z.4f} m to the limit that the scenario "
            f"states; hazardous from 0 down: the {case.zone} zone"
        )
    else:
        largest = critical.inverse[0]
        peak = "unbounded, ideal braking hits" if math.isinf(largest) else f"{largest:z.4f} 1/s"
        yield (
            f"Eqs. 1-6: largest inverse TTC under ideal braking with {settings.deceleration:g} "
            f"m/s2: {peak}; hazardous from {settings.critical_inverse_ttc:g} 1/s: the {case.zone} "
            "zone"
        )
    learnt = float(zones.predicted(row))
    side = "safe" if learnt > 0.0 else "hazardous"
    yield f"Eqs. 7-8: y = {learnt:+z.4f}: {side} as learnt, for maps and weights"


def _weight(case: CaseResult, zones: ZonePartition) -> Iterator[str]:
    """Weight r of the case's point, alone and times the points that it stands for."""
    row = zones.logical.row(case.values)
    r = float(collision_weight(row, zones))
    if zones.zones == 0:
        yield "Eq. 16: r = 1, there is no hazardous zone"
    else:
        star, away, boundary = star_distance(zones, row, r)
        edge = "" if boundary is None else f", zone's boundary at {boundary:z.4f}"
        yield (
            f"Eq. 16: r = |x - x*| / |b - x*| = {r:z.4f}: {away:z.4f} unit-box lengths from x* "
            f"({point_words(star)}){edge}"
        )
    weight = r if case.weight is None else case.weight
    if r and not math.isclose(weight, r, rel_tol=ROUNDING):
        yield (
            f"adaptive sample: this point stands for {weight / r:z.4f} points of an even one, so "
            f"its r counts {r:z.4f} x {weight / r:z.4f} = {weight:z.4f} below"
        )


def _collision(case: CaseResult, fact: Fact, findings: Findings) -> Iterator[str]:
    """U and L of the case's collision, and what it took from C and S."""
    hit = fact.collision
    if hit is None:
        yield "Eqs. 14-17: no contact, so this case has no part in C"
        return
    if case.struck_from_behind:
        yield f"Eqs. 14-17: {STRUCK}, so this case has no part in C"
        return
    own, other = hit.ego_velocity, hit.other_velocity
    overlap = max(hit.overlap, SMALLEST_OVERLAP)
    raised = overlap > hit.overlap
    remark = f" (recorded {hit.overlap:z.3f}, at least {overlap:g})" if raised else ""
    yield (
        f"Eq. 15: U = |({own[0]:z.3f}, {own[1]:z.3f}) - ({other[0]:z.3f}, {other[1]:z.3f})| / w = "
        f"{hit.relative_speed:z.3f} / {overlap:z.3f}{remark} = {hit.relative_speed / overlap:z.3f} "
        f"m/s, with `{hit.other}` at t = {hit.time:z.2f} s"
    )
    settings = findings.method.collision
    if not settings.unit:  # another severity than U: a loss in 0..1
        yield f"`{settings.severity}` replaces U: {number(case.severity, 4)}"
    yield f"Eq. 14: L = {number(case.loss, 1)}"
    if case.ideal_severity is None:
        why = because(case.ideal_error)
        yield (
            "Eq. 17: the ideal vehicle's case could not be evaluated, so this collision has no "
            f"part in C.{why}"
        )
        return
    counted = findings.cases.collided & np.isfinite(findings.cases.ideal_severity)
    part = findings.part(case, counted, findings.cases.weight, findings.terms.ratio)
    ratio = "Ug/U" if settings.loss == "severity" else "Lg/L"
    ideal = case.ideal_severity
    best = f"hits with Ug = {ideal:z.3f}{settings.unit}" if ideal else "avoids, Ug = 0"
    capped = ", capped at 1: gentler than the ideal vehicle" if case.beats_ideal else ""
    yield f"Eq. 17: the ideal vehicle {best}: {ratio} = {part.value:z.4f}{capped}"
    points = worth(findings.method.score)  # what C = 1 and D = 1 add to S
    weight, total, replaced = case.weight, part.total, ""
    if not total:  # `Findings.part` weighs all collisions alike then
        weight, total, replaced = 1.0, part.cases, ", r counts 1 as it is 0 in all"
    yield (
        f"Eq. 17: of 1 - C = {1.0 - (findings.score.c or 0.0):z.4f} this case took "
        f"r (1 - {ratio}) / sum r = {number(weight, 4)} x {1.0 - part.value:z.4f} / "
        f"{total:z.4f} = {part.takes:z.4f} ({count(part.cases, 'collision')}{replaced}), "
        f"{points.c * part.takes:z.2f} points of S"
    )


def _likeness(
    case: CaseResult,
    fact: Fact,
    findings: Findings,
    evaluation: Evaluation,
    zones: ZonePartition,
    store: Store,
) -> Iterator[str]:
    """D_i of the case, recomputed from its trajectories, and what it took from D and S."""
    if case.zone != "safe":
        yield "Eqs. 11-13: the hazardous zone has no D_i"
        return
    if case.index is None:
        yield f"Eqs. 11-13: no D_i: {_without_likeness(case, 'D', findings.score)}"
        return
    if store.is_discarded(case.case):
        product = " x ".join(number(getattr(case, field), 4) for field in FACTORS.values())
        yield (
            f"Eqs. 11-12: D_i = {product} = {case.index:z.4f}; its trajectories were discarded "
            "(`[run] keep`)"
        )
        return
    index = index_again(evaluation, fact, zones.logical.road, store)
    yield from _factors(index)
    if abs(index.value - case.index) > ROUNDING:
        yield f"WARNING: the score has D_i = {case.index:z.6f}, which this arithmetic does not give"
    if reason := reason_without("D", findings.score):
        yield f"Eq. 13: {missing_term('D', reason)}"
    else:
        part = findings.part(case, findings.indexed, findings.cases.exposure, findings.cases.index)
        whole = "exposure" if evaluation.exposure_known(case.scenario) else "the points"
        points = worth(findings.method.score)
        yield (
            f"Eq. 13: share of {whole} p / sum p = {case.exposure:z.6g} / {part.total:z.6g} = "
            f"{part.share:z.5f} ({count(part.cases, 'case')}); of D = "
            f"{number(findings.score.d, 4)} this case gives {part.gives:z.5f} and took "
            f"{part.takes:z.5f}, {points.d * part.takes:z.2f} points of S"
        )
    for note in index.notes:
        yield f"note: {notes_sentence([note])}"


def _without_likeness(case: CaseResult, mean: str, score: ScenarioResult) -> str:
    """Why a safe case has no part in a mean: its own reason, else why the scenario has no mean.

    mean: `D` or `H`.
    """
    if case.struck_from_behind:
        return STRUCK
    if case.unavoidable:
        return "the ideal vehicle collides here as well"
    own = index_note_words(case) or case.error
    return own or not_computed(mean, score) or "fewer than two drivers to compare with"


def _factors(index: AnthropomorphicIndex) -> Iterator[str]:
    """D_i as the product of its factors."""
    parts = index.ingredients
    yield (
        f"Eq. 12: f_L = min(1, L / mean L of {count(parts.drivers, 'driver')}) = min(1, "
        f"{parts.ads_length:z.2f} / {parts.mean_length:z.2f}) = {index.length_factor:z.4f}"
    )
    ratio = (
        f"{parts.mean_operations:z.2f} / {parts.ads_operations}"
        if parts.ads_operations
        else "no operation by the ADS: 1"
    )
    yield (
        f"Eq. 12: f_n = min(1, mean n of the drivers / n) = {ratio} = {index.operation_factor:z.4f}"
    )
    yield (
        f"Eq. 11: mean of min(1, pt/pt_2s) min(1, pv/pv_2s) over {count(parts.slices, 'slice')} = "
        f"{index.similarity:z.4f} (path alone {parts.centre_similarity:z.4f}, field alone "
        f"{parts.field_similarity:z.4f}; "
        f"lowest {parts.lowest:z.4f} at x = {parts.lowest_at:z.1f} m)"
    )
    product = (
        f"{index.length_factor:z.4f} x {index.operation_factor:z.4f} x {index.similarity:z.4f}"
    )
    yield f"Eq. 12: D_i = {product} = {index.value:z.4f}"


def _task(case: CaseResult, findings: Findings) -> Iterator[str]:
    """Part of the case in T, the mean of t_i over the safe cases."""
    if case.zone != "safe":
        yield "T: the hazardous zone has no part in it"
        return
    if case.task_share is None:
        no_reference = "there is no reference, or each of them had an incident"
        why = no_reference if case.counted else "it could not be evaluated"
        yield f"T: this case has no part in it: {why}"
        return
    score = findings.score
    if score.task_share is None:
        yield f"T: t_i = {case.task_share:z.4f}; T is not computed: {REASON_WITHOUT_T}"
        return
    car = score.task_reference
    slowest = f"the slowest of `{car}` and the drivers" if car else "the slowest of the drivers"
    if score.nobody_compared:  # no drivers
        slowest = f"`{car}`"
    why = " for its incident" if case.incident or case.struck_from_behind else ""  # t_i is 0
    part = findings.part(case, findings.tasked, findings.cases.exposure, findings.cases.task_share)
    yield (
        f"T: t_i = {case.task_share:z.4f}{why}, mean over the way of min(1, time of "
        f"{slowest} / own time); of 1 - T = {1.0 - score.task_share:z.4f} this case took "
        f"{part.takes:z.4f} ({count(part.cases, 'case')})"
    )


def _avoided(case: CaseResult, findings: Findings) -> Iterator[str]:
    """Loss of the case in A = 1 - sum(w max(0, U - Ug)) / sum(w max(0, U0 - Ug))."""
    evaluated = {
        "the case": case.evaluated or case.gave_up,
        "the ideal vehicle's": case.ideal_severity is not None,
        "that of `no_reaction`": case.no_reaction_severity is not None,
    }
    missing = [drive for drive, is_evaluated in evaluated.items() if not is_evaluated]
    score = findings.score
    if missing or score.avoided_share is None:
        yield (
            f"A: this case has no part in it; {' and '.join(missing) or 'A'} could not be evaluated"
        )
        return
    unit = findings.method.collision.regret_unit
    harm = findings.harm(case)
    if case.departed:
        yield (
            f"A: left the road at t = {case.departure_time:z.2f} s with "
            f"{case.departure_speed:z.3f} m/s"
        )
    if case.gave_up:
        yield "A: the ADS gave the case up, which counts at least as doing nothing, U0"
    weight = f"r = {number(case.weight, 4)}" if findings.weighted else "1, as r is 0 in all cases"
    kind = "caused by the ADS" if case.caused else case.kind
    collision = f": the collision is {kind}" if case.collided else ""
    yield (
        f"A: U = {harm.u:z.3f}{unit}, ideal vehicle Ug = {harm.ideal:z.3f}{unit}, doing nothing "
        f"U0 = {harm.nothing:z.3f}{unit}{collision}"
    )
    yield (
        f"A: w = {weight}; w max(0, U - Ug) = {harm.lost:z.4f}, "
        f"w max(0, U0 - Ug) = {harm.at_stake:z.4f}; of 1 - A = {1.0 - score.avoided_share:z.4f} "
        f"this case took {harm.taken:z.4f}; A' = {number(score.avoidance_grade, 4)}"
        + (": below 0, S+ takes 0" if score.avoided_share < 0.0 else "")
    )


def _human(case: CaseResult, findings: Findings) -> Iterator[str]:
    """Part of the case in H, the mean of f_L f_n+ similarity plausibility over the safe cases."""
    if case.zone != "safe":
        yield "H: the hazardous zone has no part in it"
        return
    if case.human_likeness is None:
        yield f"H: this case has no part in it: {_without_likeness(case, 'H', findings.score)}"
        return
    if case.incident:
        yield "H: 0, an avoidable incident in a safe case"
    else:
        factors = [getattr(case, field) for field in LIKENESS_FACTORS.values()]
        yield (
            "H: f_L f_n+ similarity plausibility = "
            f"{' x '.join(number(value, 4) for value in factors)} = {case.human_likeness:z.4f}; "
            "plausibility: 1 where at least 5 % of recorded people go to such extremes"
        )
    part = findings.part(
        case, findings.likened, findings.cases.exposure, findings.cases.human_likeness
    )
    if part.total > 0.0:
        yield (
            f"H: share of the mean {part.share:z.5f} ({count(part.cases, 'case')}); of H = "
            f"{number(findings.score.human_likeness, 4)} this case gives {part.gives:z.5f} "
            f"and took {part.takes:z.5f}"
        )


def _measures(case: CaseResult) -> Iterator[str]:
    """The measures of the case that are known, on one line."""
    measures = [
        f"{words} {value:z.3g} {unit}"
        for name, words, unit in MEASURES
        if (value := getattr(case, name)) is not None
    ]
    if measures:
        yield "measures: " + "; ".join(measures)
