"""From recorded facts to the quantities of the paper: D_i, U, L, Ug and r of every case, then C, D and S."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sumo_eval.batch.store import EGO, Fact, Store
from sumo_eval.method.anthropomorphic import AnthropomorphicIndex, exposure_weighted_index
from sumo_eval.method.collision_avoidance import (
    collision_avoidance_index,
    collision_loss,
    collision_weight,
    impact_severity,
)
from sumo_eval.method.measures import CriticalityMeasures, measures
from sumo_eval.method.score import combined_score
from sumo_eval.method.zone_partition import ZonePartition, boundary_error
from sumo_eval.results import EVALUATED, CaseResult, ScenarioResult, ZoneResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling import Sample
from sumo_eval.settings import MethodSettings
from sumo_eval.trajectory import BoolArray


@dataclass(frozen=True, slots=True)
class CollisionTerms:
    """One collision in Eqs. 14-17. `ideal_severity` None: the ideal vehicle's case could not be evaluated."""

    severity: float
    loss: float
    ideal_severity: float | None
    weight: float


def drivers_left_out(logical: LogicalScenario, store: Store) -> tuple[str, ...]:
    """A sentence about drivers' drives that are no reference: a skilled driver's safe-zone case ends well."""
    drives = store.facts("human", logical.name)
    left_out = [fact for fact in drives if fact.status != "ok"]
    if not left_out:
        return ()
    how = ", ".join(f"{number} {status}" for status, number in sorted(Counter(f.status for f in left_out).items()))
    return (f"{len(left_out)} of {len(drives)} drives of the drivers are left out of the reference ({how}).",)


def simulated_alone(logical: LogicalScenario, ads: str, store: Store) -> tuple[str, ...]:
    """A sentence about drives that were to be simulated together with others, and had to be done again alone."""
    reasons = store.simulated_alone(logical.name, ads)
    if not reasons:
        return ()
    why = " ".join(f"{number} x: {reason}" for reason, number in reasons.items())
    return (f"{_count(sum(reasons.values()), 'drive')} left the pack and had to be simulated alone. {why}",)


def collision_terms(
    logical: LogicalScenario, zones: ZonePartition, facts: Sequence[Fact], store: Store
) -> dict[str, CollisionTerms]:
    """U, L, Ug and r of every collision, by case."""
    ideal = {fact.point: fact for fact in store.facts("ideal", logical.name)}
    terms = {}
    for fact in facts:
        severity = _severity(fact)
        if severity is not None:
            weight = float(collision_weight(logical.row(fact.values), zones))
            terms[fact.case] = CollisionTerms(
                severity, float(collision_loss(severity)), _ideal_severity(ideal.get(fact.point)), weight
            )
    return terms


def missing_weights(logical: LogicalScenario, zones: ZonePartition, facts: Sequence[Fact]) -> dict[str, float]:
    """r of every case that could not be evaluated, as if it had been a collision, by case."""
    return {
        fact.case: float(collision_weight(logical.row(fact.values), zones))
        for fact in facts
        if fact.status not in EVALUATED and fact.collision is None
    }


def ideal_outcomes(logical: LogicalScenario, store: Store) -> dict[int, bool]:
    """Whether the ideal vehicle collided, by point; without the points where it was not driven or not evaluated."""
    return {
        fact.point: fact.collision is not None
        for fact in store.facts("ideal", logical.name)
        if fact.status in EVALUATED
    }


def criticality_measures(facts: Sequence[Fact], store: Store) -> dict[str, CriticalityMeasures]:
    """The criticality measures of every evaluated case, by case."""
    measured = {}
    for fact in facts:
        if fact.status in EVALUATED:
            actors = store.trajectories(fact.case)
            measured[fact.case] = measures(actors.pop(EGO), actors, fact.collision)
    return measured


def _severity(fact: Fact) -> float | None:
    """U of a case's collision, None without one."""
    hit = fact.collision
    return None if hit is None else float(impact_severity(hit.ego_velocity, hit.other_velocity, hit.overlap))


def _ideal_severity(fact: Fact | None) -> float | None:
    """Ug: the ideal vehicle's U, 0 where it avoids, None where its case could not be evaluated."""
    if fact is None or fact.status not in EVALUATED:
        return None
    return _severity(fact) or 0.0


def tabulate(
    facts: Sequence[Fact],
    hazardous: BoolArray,
    indexes: Mapping[str, AnthropomorphicIndex],
    collisions: Mapping[str, CollisionTerms],
    ideal_hits: Mapping[int, bool],
    measured: Mapping[str, CriticalityMeasures],
) -> list[CaseResult]:
    """One row a case. The mappings go by case, `ideal_hits` by point."""
    rows = []
    for fact, dangerous in zip(facts, hazardous, strict=True):
        index, hit, terms = indexes.get(fact.case), fact.collision, collisions.get(fact.case)
        rows.append(
            CaseResult(
                case=fact.case,
                scenario=fact.scenario,
                ads=fact.driver,
                values=fact.values,
                zone="hazardous" if dangerous else "safe",
                exposure=fact.exposure,
                status=fact.status,
                end_reason=fact.end_reason,
                error=fact.error,
                error_place=fact.error_place,
                wall_time=fact.wall_time,
                simulated_time=fact.simulated_time,
                latency_mean=fact.latency_mean,
                latency_max=fact.latency_max,
                collided=hit is not None,
                impact_speed=hit.relative_speed if hit else None,
                overlap=hit.overlap if hit else None,
                side=hit.side if hit else None,
                severity=terms.severity if terms else None,
                loss=terms.loss if terms else None,
                ideal_severity=terms.ideal_severity if terms else None,
                weight=terms.weight if terms else None,
                beats_ideal=bool(terms and terms.ideal_severity is not None and terms.severity < terms.ideal_severity),
                index=index.value if index else None,
                length_factor=index.length_factor if index else None,
                operation_factor=index.operation_factor if index else None,
                similarity=index.similarity if index else None,
                index_note=" ".join(index.notes) if index else "",
                clips="; ".join(f"{clip.what} x{clip.count}" for clip in fact.clips),
                ideal_collided=ideal_hits.get(fact.point),
            )
        )
    return [_with_measures(row, measured[row.case]) if row.case in measured else row for row in rows]


def _with_measures(row: CaseResult, found: CriticalityMeasures) -> CaseResult:
    return replace(
        row,
        min_ttc=_finite(found.min_ttc),
        max_ittc=_finite(found.max_ittc),
        min_thw=_finite(found.min_thw),
        min_gap=_finite(found.min_gap),
        max_drac=_finite(found.max_drac),
        pet=_finite(found.pet),
        max_deceleration=_finite(found.max_deceleration),
        max_jerk=_finite(found.max_jerk),
        delta_v=_finite(found.delta_v),
    )


def _finite(value: float) -> float | None:
    """None for what a table cannot hold: not defined, or unbounded."""
    return value if math.isfinite(value) else None


def combine(
    ads: str,
    scenario: str,
    cases: Sequence[CaseResult],
    method: MethodSettings,
    notes: Sequence[str] = (),
    unknown: Mapping[str, float] | None = None,
) -> ScenarioResult:
    """C, D and S of one ADS in one scenario, Eqs. 13, 17 and 18, and the counts that stand beside them.

    unknown: r of the cases that could not be evaluated, had they been collisions; 1 where it is not given.
    """
    notes = list(notes)
    hits = [case for case in cases if case.collided]
    compared = [
        (case.severity, case.ideal_severity, case.weight)
        for case in hits
        if case.severity is not None and case.ideal_severity is not None and case.weight is not None
    ]
    judged = [case for case in cases if case.evaluated]
    c: float | None = None  # an ADS that never got as far as a collision has not avoided any
    if compared or (judged and not hits):
        u, ideal_u, weights = np.array(compared).reshape(-1, 3).T
        c = collision_avoidance_index(u, ideal_u, weights, loss=method.collision.loss)
    safe = [case for case in cases if case.zone == "safe"]
    safe_hits = sum(case.collided for case in safe)
    indexed = [(case.index, case.exposure) for case in safe if case.index is not None]
    d: float | None = None
    reason = ""
    if safe_hits:
        reason = f"not computed: {_count(safe_hits, 'collision')} in the safe zone"
    elif not safe:
        reason = "not computed: no case lies in the safe zone"
    elif not indexed:
        reason = "not computed: no safe case could be evaluated and compared with drivers"
    elif not sum(exposure for _, exposure in indexed) > 0.0:
        reason = "not computed: every safe case with a D_i has exposure 0"
    else:
        d = exposure_weighted_index(*np.array(indexed).T)
    missing = {case.case for case in cases if not case.evaluated}
    missing |= {case.case for case in hits if case.ideal_severity is None}
    if not safe_hits:
        missing |= {case.case for case in safe if case.index is None}
    c_interval = _c_interval(cases, method, unknown or {})
    d_interval = _d_interval(safe) if safe and not safe_hits else None
    s_interval = _s_interval(c, d, c_interval, d_interval, safe, method)
    if missing:
        where = Counter(case.zone for case in cases if case.case in missing)
        places = " and ".join(f"{number} in the {zone} zone" for zone, number in sorted(where.items()))
        notes.append(
            f"{_count(len(missing), 'case')} could not be evaluated ({places}); C and D are means over the others."
        )
    if s_interval:
        notes.append(_interval_sentence(c_interval, d_interval, s_interval))
    beaten = sum(case.beats_ideal for case in hits)
    if beaten:
        notes.append(f"In {_count(beaten, 'collision')} the ADS was gentler than the ideal vehicle; each counts 1.")
    total = combined_score(c, d, a=method.score.a, b=method.score.b, k5=method.score.k5, k6=method.score.k6)
    exposure = sum(case.exposure for case in judged)
    statuses = Counter(case.status for case in cases)
    return ScenarioResult(
        ads=ads,
        scenario=scenario,
        c=c,
        d=d,
        d_reason=reason,
        s=total.total,
        c_points=total.c_points,
        d_points=total.d_points,
        cases=len(cases),
        safe_cases=len(safe),
        hazardous_cases=len(cases) - len(safe),
        collisions=len(hits),
        safe_collisions=safe_hits,
        avoidable_collisions=sum(case.ideal_severity == 0.0 for case in hits),
        collision_probability=sum(case.exposure for case in hits) / exposure if exposure else float("nan"),
        off_road=statuses["off_road"],
        not_evaluated=len(missing),
        notes=tuple(notes),
        c_interval=c_interval,
        d_interval=d_interval,
        s_interval=s_interval,
    )


_SEVEREST = 100.0  # m/s: past every class of severity


def _c_interval(
    cases: Sequence[CaseResult], method: MethodSettings, unknown: Mapping[str, float]
) -> tuple[float, float] | None:
    """C with everything that is missing as a collision: one that the ideal vehicle avoids, or as gentle as its own.

    Both are bounds: a collision of ratio 0 never raises Eq. 17's mean, one of ratio 1 never lowers it.
    """
    worst, best = [], []
    open_cases = 0
    for case in cases:
        if case.collided and case.severity is not None and case.weight is not None:
            known = case.ideal_severity is not None
            open_cases += not known
            worst.append((case.severity, case.ideal_severity if known else 0.0, case.weight))
            best.append((case.severity, case.ideal_severity if known else case.severity, case.weight))
        elif not case.evaluated:
            weight = unknown.get(case.case, 1.0)
            open_cases += 1
            worst.append((_SEVEREST, 0.0, weight))
            best.append((_SEVEREST, _SEVEREST, weight))
    if not open_cases:
        return None
    low, high = (
        collision_avoidance_index(u, ideal, weights, loss=method.collision.loss)
        for u, ideal, weights in (np.array(terms, dtype=np.float64).T for terms in (worst, best))
    )
    return low, high


def _d_interval(safe: Sequence[CaseResult]) -> tuple[float, float] | None:
    """D with every safe case that has no D_i as 0, and as 1."""
    if all(case.index is not None for case in safe):
        return None
    exposures = [case.exposure for case in safe]
    low, high = (
        exposure_weighted_index([fill if case.index is None else case.index for case in safe], exposures)
        for fill in (0.0, 1.0)
    )
    return low, high


def _s_interval(
    c: float | None,
    d: float | None,
    c_interval: tuple[float, float] | None,
    d_interval: tuple[float, float] | None,
    safe: Sequence[CaseResult],
    method: MethodSettings,
) -> tuple[float, float] | None:
    """S at both ends; a missing safe case may have been a collision, after which there is no D."""
    if c_interval is None and d_interval is None:
        return None
    lowest_d = None if any(not case.evaluated for case in safe) else (d_interval[0] if d_interval else d)
    low, high = (
        combined_score(at_c, at_d, a=method.score.a, b=method.score.b, k5=method.score.k5, k6=method.score.k6).total
        for at_c, at_d in (
            (c_interval[0] if c_interval else c, lowest_d),
            (c_interval[1] if c_interval else c, d_interval[1] if d_interval else d),
        )
    )
    return low, high


def _interval_sentence(
    c_interval: tuple[float, float] | None, d_interval: tuple[float, float] | None, s_interval: tuple[float, float]
) -> str:
    parts = [
        f"{name} within {interval[0]:.{digits}f}..{interval[1]:.{digits}f}"
        for name, interval, digits in (("C", c_interval, 3), ("D", d_interval, 3), ("S", s_interval, 1))
        if interval is not None
    ]
    return f"With the missing cases counted as worst and as best: {', '.join(parts)}."


def describe_zones(logical: LogicalScenario, zones: ZonePartition, points: Sample) -> ZoneResult:
    """What the report says of a partition."""
    inside = zones.hazardous(points.points)
    error = boundary_error(zones)
    return ZoneResult(
        scenario=logical.name,
        zones=len(zones.most_dangerous),
        hazardous_share=float(np.mean(inside)),
        most_dangerous=zones.most_dangerous,
        boundary_error=error.feasible,
        boundary_error_box=error.box,
        sampled=len(points.points),
        refused=len(points.refused),
        notes=(*zones.notes, *points.notes),
    )


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
