"""The whole arithmetic of one case in words, each step with its equation's number."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import closing
from itertools import chain
from pathlib import Path

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.errors import unknown
from sumo_eval.method.anthropomorphic import AnthropomorphicIndex
from sumo_eval.method.collision_avoidance import SMALLEST_OVERLAP
from sumo_eval.method.point_criticality import criticality
from sumo_eval.method.score_terms import excess, worth
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.human_reference import PointJob, compute_points
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import Fact, Store, open_store
from sumo_eval.report.driving_words import driving_words
from sumo_eval.report.words import (
    MEASURES,
    STRUCK,
    because,
    end_reason,
    explain_s,
    explain_s_plus,
    index_note_words,
    not_computed,
    notes_sentence,
    number,
    placed,
    ratio_of,
    reason_without,
)
from sumo_eval.results import Evaluation
from sumo_eval.scoring.findings import FACTORS, LIKENESS_FACTORS, Findings
from sumo_eval.text import point_words
from sumo_eval.trajectory import BoolArray, FloatArray

ROUNDING = 1e-9


def known_case(run: Path, key: str) -> Fact:
    """A drive of an ADS by its case's key.

    Raises InputError with the nearest known one.
    """
    with open_store(run / FACTS) as store:
        found = store.fact(key)
        if found is None or found.role != "ads":
            raise unknown("case", key, [case for case, _, _ in store.names("ads")])
    return found


def explain_case(
    evaluation: Evaluation, partitions: Mapping[str, ZonePartition], fact: Fact
) -> list[str]:
    """The lines that `sumo-eval explain` prints on the drive of an ADS."""
    case = evaluation.case(fact.case)
    assert case is not None, "every drive of an ADS is a case"
    zones = partitions[case.scenario]
    found = Findings.of(evaluation, evaluation.score(case.ads, case.scenario))
    with open_store(evaluation.folder / FACTS) as store:
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
                    _collision(case, fact, found, zones),
                    _likeness(case, fact, found, evaluation, zones, store),
                    _task(case, found),
                    _avoided(case, found),
                    _human(case, found),
                    _measures(case),
                    (explain_s_plus(found), f"Eq. 18: {explain_s(found)}"),
                )
            ),
        ]


def _zone(case: CaseResult, zones: ZonePartition) -> Iterator[str]:
    settings = zones.settings
    row = zones.logical.row(case.values)
    largest = float(criticality(zones.logical, row[None], settings).inverse[0])
    peak = "unbounded, ideal braking hits" if math.isinf(largest) else f"{largest:z.4f} 1/s"
    yield (
        f"Eqs. 1-6: largest inverse TTC under ideal braking with {settings.deceleration:g} m/s2: "
        f"{peak}; hazardous from {settings.critical_inverse_ttc:g} 1/s: the {case.zone} zone"
    )
    learnt = float(zones.predicted(row))
    side = "safe" if learnt > 0.0 else "hazardous"
    yield f"Eqs. 7-8: y = {learnt:+z.4f}: {side} as learnt, for maps and weights"


def _collision(
    case: CaseResult, fact: Fact, found: Findings, zones: ZonePartition
) -> Iterator[str]:
    hit = fact.collision
    if hit is None:
        yield "Eqs. 14-17: no contact, so this case has no part in C"
        return
    if case.struck_from_behind:
        yield f"Eqs. 14-17: {STRUCK}, so this case has no part in C"
        return
    own, other = hit.ego_velocity, hit.other_velocity
    used, floor = hit.overlap, ""
    if used < SMALLEST_OVERLAP:
        used = SMALLEST_OVERLAP
        floor = f" (recorded {hit.overlap:z.3f}, at least {used:g})"
    yield (
        f"Eq. 15: U = |({own[0]:z.3f}, {own[1]:z.3f}) - ({other[0]:z.3f}, {other[1]:z.3f})| / w = "
        f"{hit.relative_speed:z.3f} / {used:z.3f}{floor} = {hit.relative_speed / used:z.3f} m/s, "
        f"with `{hit.other}` at t = {hit.time:z.2f} s"
    )
    chosen = found.settings.method.collision
    if not chosen.unit:
        yield f"`{chosen.severity}` replaces U: {number(case.severity, 4)}"
    yield f"Eq. 14: L = {number(case.loss, 1)}"
    if case.ideal_severity is None:
        why = because(case.ideal_error)
        yield (
            "Eq. 17: the ideal vehicle's case could not be evaluated, so this collision has no "
            f"part in C.{why}"
        )
        return
    ratio, ideal = ratio_of(case, chosen.loss), case.ideal_severity
    what = "Ug/U" if chosen.loss == "severity" else "Lg/L"
    best = f"hits with Ug = {ideal:z.3f}{chosen.unit}" if ideal else "avoids, Ug = 0"
    capped = ", capped at 1: gentler than the ideal vehicle" if case.beats_ideal else ""
    yield f"Eq. 17: the ideal vehicle {best}: {what} = {ratio:z.4f}{capped}"
    yield from _weight(case, zones)
    counted = found.cases.collided & np.isfinite(found.cases.ideal_severity)
    weights, share = _share(case, found, counted, found.cases.weight)
    whole = worth(found.settings.method.score)
    yield (
        f"Eq. 17: of 1 - C = {1.0 - (found.score.c or 0.0):z.4f} this case took r (1 - {what}) / "
        f"sum r = {number(case.weight, 4)} x {1.0 - ratio:z.4f} / {math.fsum(weights):z.4f} = "
        f"{share * (1.0 - ratio):z.4f} ({len(weights)} collisions), "
        f"{whole.c * share * (1.0 - ratio):z.2f} points of S"
    )


def _weight(case: CaseResult, zones: ZonePartition) -> Iterator[str]:
    if zones.zones == 0:
        yield "Eq. 16: r = 1, there is no hazardous zone"
        return
    logical = zones.logical
    row = logical.row(case.values)
    star = zones.most_dangerous[int(zones.nearest_zone(row))]
    away = float(np.linalg.norm(logical.to_unit(row) - logical.to_unit(logical.row(star))))
    weight = case.weight or 0.0
    exit_at = f", zone's boundary at {away / weight:z.4f}" if weight > 0.0 else ""
    yield (
        f"Eq. 16: r = |x - x*| / |b - x*| = {weight:z.4f}: {away:z.4f} unit-box lengths from x* "
        f"({point_words(star)}){exit_at}"
    )


def _likeness(
    case: CaseResult,
    fact: Fact,
    found: Findings,
    evaluation: Evaluation,
    zones: ZonePartition,
    store: Store,
) -> Iterator[str]:
    if case.zone != "safe":
        yield "Eqs. 11-13: the hazardous zone has no D_i"
        return
    if case.index is None:
        why = not_computed(reason_without("D", found.score)) or _without_likeness(case)
        yield f"Eqs. 11-13: no D_i: {why}"
        return
    if store.is_discarded(case.case):
        factors = [getattr(case, field) for field in FACTORS.values()]
        product = " x ".join(number(value, 4) for value in factors)
        yield (
            f"Eqs. 11-12: D_i = {product} = {case.index:z.4f}; its trajectories were discarded "
            "(`[run] keep`)"
        )
        return
    drives = store.driven_at(case.scenario, fact.point, "human")
    job = PointJob(tuple(one.case for one in drives), zones.logical.road, (case.case,))
    settings = evaluation.settings.method.anthropomorphic
    with closing(KeptResults(evaluation.folder)) as kept:
        (result,) = compute_points(store.path, [job], settings, map, lambda done: None, kept)
    index = result.indexes[case.case]
    yield from _factors(index)
    if abs(index.value - case.index) > ROUNDING:
        yield f"WARNING: the score has D_i = {case.index:z.6f}, which this arithmetic does not give"
    exposures, share = _share(case, found, found.indexed, found.cases.exposure)
    of = "exposure" if evaluation.exposure_known(case.scenario) else "the points"
    whole = worth(found.settings.method.score)
    yield (
        f"Eq. 13: share of {of} p / sum p = {case.exposure:z.6g} / {math.fsum(exposures):z.6g} = "
        f"{share:z.5f} ({len(exposures)} cases); of D = {number(found.score.d, 4)} this case gives "
        f"{share * case.index:z.5f} and took {share * (1.0 - case.index):z.5f}, "
        f"{whole.d * share * (1.0 - case.index):z.2f} points of S"
    )
    for note in index.notes:
        yield f"note: {notes_sentence([note])}"


def _without_likeness(case: CaseResult) -> str:
    """Why a safe case has neither D_i nor a part in H."""
    if case.struck_from_behind:
        return STRUCK
    if case.unavoidable:
        return "the ideal vehicle collides here as well"
    return index_note_words(case) or case.error or "fewer than two drivers to compare with"


def _factors(index: AnthropomorphicIndex) -> Iterator[str]:
    made = index.ingredients
    yield (
        f"Eq. 12: f_L = min(1, L / mean L of {made.drivers} drivers) = min(1, "
        f"{made.ads_length:z.2f} / {made.mean_length:z.2f}) = {index.length_factor:z.4f}"
    )
    ratio = (
        f"{made.mean_operations:z.2f} / {made.ads_operations}"
        if made.ads_operations
        else "no operation by the ADS: 1"
    )
    yield (
        f"Eq. 12: f_n = min(1, mean n of the drivers / n) = {ratio} = {index.operation_factor:z.4f}"
    )
    yield (
        f"Eq. 11: mean of min(1, pt/pt_2s) min(1, pv/pv_2s) over {made.slices} slices = "
        f"{index.similarity:z.4f} (path alone {made.centre_similarity:z.4f}, field alone "
        f"{made.field_similarity:z.4f}; lowest {made.lowest:z.4f} at x = {made.lowest_at:z.1f} m)"
    )
    product = (
        f"{index.length_factor:z.4f} x {index.operation_factor:z.4f} x {index.similarity:z.4f}"
    )
    yield f"Eq. 12: D_i = {product} = {index.value:z.4f}"


def _avoided(case: CaseResult, found: Findings) -> Iterator[str]:
    """Loss of the case in A = 1 - sum(w max(0, U - Ug)) / sum(w max(0, U0 - Ug))."""
    known = {
        "the case": case.evaluated or case.gave_up,
        "the ideal vehicle's": case.ideal_severity is not None,
        "that of `no_reaction`": case.no_reaction_severity is not None,
    }
    unknown, score = [words for words, it in known.items() if not it], found.score
    if unknown or score.avoided_share is None:
        yield (
            f"A: this case has no part in it; {' and '.join(unknown) or 'it'} could not be "
            "evaluated"
        )
        return
    unit, terms = found.settings.method.collision.regret_unit, found.terms
    row = int(np.flatnonzero(found.cases.case == case.case)[0])
    u, ideal, nothing = (
        float(part[row]) for part in (terms.severity, terms.ideal, terms.unreacting)
    )
    lost, at_stake = (float(excess(part, ideal)) for part in (u, nothing))
    if case.departed:
        yield (
            f"A: left the road at t = {case.departure_time:z.2f} s with "
            f"{case.departure_speed:z.3f} m/s"
        )
    if case.gave_up:
        yield "A: the ADS gave the case up, which counts as doing nothing, U0, at least"
    kind = {"caused": "caused by the ADS"}.get(case.kind, case.kind)
    which = "" if kind == "not known" else f": the collision is {kind}"
    beside = f"ideal vehicle Ug = {ideal:z.3f}{unit}, doing nothing U0 = {nothing:z.3f}{unit}"
    yield f"A: U = {u:z.3f}{unit}, {beside}{which}"
    taken = float(found.share_lost[row])
    yield (
        f"A: w = r = {number(case.weight, 4)}; w max(0, U - Ug) = "
        f"{(case.weight or 0.0) * lost:z.4f}, w max(0, U0 - Ug) = "
        f"{(case.weight or 0.0) * at_stake:z.4f}; of 1 - A = {1.0 - score.avoided_share:z.4f} this "
        f"case took {taken:z.4f}; A' = {number(score.avoidance_grade, 4)}"
        + (": below 0, S+ takes 0" if score.avoided_share < 0.0 else "")
    )


def _task(case: CaseResult, found: Findings) -> Iterator[str]:
    """Part of the case in T, the mean of t_i over the safe cases."""
    if case.zone != "safe":
        yield "T: the hazardous zone has no part in it"
        return
    if case.task_share is None:
        yield "T: this case has no part in it: no reference is there without an incident"
        return
    score = found.score
    beside = f"`{score.task_reference}` and the drivers" if score.task_reference else "the drivers"
    why = " for its incident" if case.incident or case.struck_from_behind else ""
    exposures, share = _share(case, found, found.tasked, found.cases.exposure)
    yield (
        f"T: t_i = {case.task_share:z.4f}{why}, mean over the way of min(1, time of the slowest of "
        f"{beside} / own time); of 1 - T = {1.0 - (score.task_share or 0.0):z.4f} this case took "
        f"{share * (1.0 - case.task_share):z.4f} ({len(exposures)} cases)"
    )


def _human(case: CaseResult, found: Findings) -> Iterator[str]:
    """Part of the case in H, the mean of f_L f_n+ similarity plausibility over the safe cases."""
    if case.zone != "safe":
        yield "H: the hazardous zone has no part in it"
        return
    if case.human_likeness is None:
        yield f"H: this case has no part in it: {_without_likeness(case)}"
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
    exposures, share = _share(case, found, found.likened, found.cases.exposure)
    if math.fsum(exposures) > 0.0:
        yield (
            f"H: share of the mean {share:z.5f} ({len(exposures)} cases); of H = "
            f"{number(found.score.human_likeness, 4)} this case gives "
            f"{share * case.human_likeness:z.5f} "
            f"and took {share * (1.0 - case.human_likeness):z.5f}"
        )


def _share(
    case: CaseResult, found: Findings, counted: BoolArray, weights: FloatArray
) -> tuple[list[float], float]:
    """The weights of the cases that a mean is over, and the share of this case in it.

    counted: those, (n,).
    """
    here = found.cases.case == case.case
    known = np.nan_to_num(weights[counted]).tolist()
    return known, float(found.shares(counted, weights)[here][0])


def _measures(case: CaseResult) -> Iterator[str]:
    values = [(getattr(case, name), words, unit) for name, words, unit in MEASURES]
    known = [f"{words} {it:z.3g} {unit}" for it, words, unit in values if it is not None]
    if known:
        yield "measures: " + "; ".join(known)
