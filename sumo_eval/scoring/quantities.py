"""From recorded facts to the quantities of the paper: D_i, U, L, Ug and r of every case, then C, D and S."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from sumo_eval.cases import EVALUATED, GAVE_UP, CaseResult, CaseTable, Column, Zone
from sumo_eval.method.anthropomorphic import exposure_weighted_index
from sumo_eval.method.collision_avoidance import (
    collision_avoidance_index,
    collision_loss,
    impact_severity,
)
from sumo_eval.method.conflict import Conflict, conflict_at
from sumo_eval.method.driving_task import roadside_contact
from sumo_eval.method.score import plus_of, score_of
from sumo_eval.method.severity import Severity
from sumo_eval.method.zone_partition import ZonePartition, boundary_error
from sumo_eval.record.cases import IN_BLOCK
from sumo_eval.record.human_reference import CaseIndex
from sumo_eval.record.store import Fact, Store
from sumo_eval.results import (
    ActorsLeft,
    BeyondRange,
    CasesMissing,
    DrivenAlone,
    DrivenInBlocks,
    DrivesLeftOut,
    GentlerThanIdeal,
    IdealCollidesToo,
    NotComputed,
    ReferenceMissing,
    ReferencesCollide,
    ScenarioResult,
    ScoreNote,
    StruckFromBehind,
    WorstAndBest,
    ZoneResult,
)
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import Sample
from sumo_eval.scoring.case_terms import case_terms, missing_bounds, point_values
from sumo_eval.scoring.drive_measures import DriveMeasures
from sumo_eval.scoring.driving_task import TaskOfDrive
from sumo_eval.settings import CollisionSettings, MethodSettings
from sumo_eval.text import without_numbers
from sumo_eval.trajectory import BoolArray, FloatArray

_RECORDED = {item.name for item in fields(CaseResult)} & {item.name for item in fields(Fact)} - {"clips"}
"""What a row has of its fact as it is."""
STRUCK_FROM_BEHIND = "struck_from_behind"
LEFT_THE_NETWORK = "actor_left_the_network"
"""The clip of a collision in which a vehicle that reacts ran into the ego's rear."""


def drivers_left_out(logical: LogicalScenario, store: Store) -> tuple[ScoreNote, ...]:
    """Drivers' drives that are no reference: a skilled driver's safe-zone case ends well."""
    ended = [
        (status, number)
        for scenario, role, _, status, number, _ in store.counts()
        if (scenario, role) == (logical.name, "human")
    ]
    left_out = [(status, number) for status, number in ended if status != "ok"]
    if not left_out:
        return ()
    return (DrivesLeftOut(sum(n for _, n in left_out), sum(n for _, n in ended), tuple(sorted(left_out))),)


def simulated_alone(logical: LogicalScenario, ads: str, store: Store) -> tuple[ScoreNote, ...]:
    """Drives that were to be simulated together with others, and had to be done again alone."""
    reasons = store.simulated_alone(logical.name, ads)
    return (DrivenAlone(tuple(reasons.items())),) if reasons else ()


class Remarks:
    """What is to be said of all drives of an ADS in a scenario, gathered some drives at a time."""

    def __init__(self, severity: Severity) -> None:
        self._severity = severity
        self._blocks: Counter[int] = Counter()
        self._left = 0
        self._beyond: Counter[str] = Counter()
        self._safe, self._struck = 0, 0

    def add(self, facts: Sequence[Fact]) -> None:
        """Take in some drives."""
        self._blocks.update(int(clip.requested) for fact in facts for clip in fact.clips if clip.what == IN_BLOCK)
        self._left += sum(any(clip.what == LEFT_THE_NETWORK for clip in fact.clips) for fact in facts)
        self._beyond.update(self._severity.beyond(fact.collision) for fact in facts if fact.collision is not None)

    def add_references(self, facts: Sequence[Fact]) -> None:
        """Take in the drives of drivers and of the reference car at some points of the safe zone."""
        self._safe += len({fact.point for fact in facts})
        self._struck += len({fact.point for fact in facts if fact.status == "collision"})

    @property
    def references_collide(self) -> tuple[ScoreNote, ...]:
        """Points called safe at which those who are compared with collide."""
        return (ReferencesCollide(self._struck, self._safe),) if self._struck else ()

    @property
    def in_blocks(self) -> tuple[ScoreNote, ...]:
        """Drives of a policy over arrays, and how many cases it was shown together."""
        return (DrivenInBlocks(self._blocks.total(), tuple(sorted(self._blocks))),) if self._blocks else ()

    @property
    def actors_left(self) -> tuple[ScoreNote, ...]:
        """Cases in which an actor came to the end of the network."""
        return (ActorsLeft(self._left),) if self._left else ()

    @property
    def beyond_range(self) -> tuple[ScoreNote, ...]:
        """Collisions outside the range that the severity is known for."""
        reasons = {reason: number for reason, number in self._beyond.items() if reason}
        return (BeyondRange(self._severity.name, tuple(sorted(reasons.items()))),) if reasons else ()


@dataclass(frozen=True, slots=True)
class PointTerms:
    """One concrete scenario in Eqs. 14-17, whoever drives there. weight: r. ideal_severity: Ug, of contacts, and
    no_reaction_severity: U0, of contacts and departures, 0 without them, None where their drive could not be evaluated;
    ideal_error and no_reaction_error: why not. conflict: of its ways, None where none conflicts with the ego's.
    """

    weight: float
    ideal_severity: float | None
    no_reaction_severity: float | None
    conflict: Conflict | None = None
    ideal_error: str = ""
    no_reaction_error: str = ""


def struck_by_other(fact: Fact, settings: CollisionSettings) -> bool:
    """Whether a case's collision is the other's fault: one that reacts has run into the rear of an ego that had been in
    that lane for long enough. The clip of such a collision holds how long that was.
    """
    if fact.collision is None or settings.rear_end == "counts":
        return False
    enough = min(settings.others_fault_after, fact.collision.time - 1e-6)  # who began in the lane had been there before
    return any(clip.what == STRUCK_FROM_BEHIND and clip.applied >= enough for clip in fact.clips)


def point_terms(
    weights: FloatArray,
    points: range,
    logical: LogicalScenario,
    store: Store,
    severity: Severity,
    method: MethodSettings,
    idle: Sequence[Fact],
    tasks: Mapping[str, TaskOfDrive],
) -> dict[int, PointTerms]:
    """r, Ug and U0 of some concrete scenarios of a run, by point. weights: r, by the number of the point. severity:
    what stands in the place of U. idle: the drives of `no_reaction` there. tasks: departures by case.
    """
    found, settings = store.facts_at(points, "ideal", logical.name), method.collision
    unreacting = {
        fact.point: (
            None
            if (contact := _reference_severity(fact, severity, settings)) is None
            else max(contact, _of_departure(fact, tasks, severity, method)),
            _reference_error(fact),
        )
        for fact in idle
    }
    nobody: tuple[None, str] = (None, "")
    return {
        fact.point: PointTerms(
            float(weights[fact.point]),
            _reference_severity(fact, severity, settings),
            unreacting.get(fact.point, nobody)[0],
            conflict_at(logical, fact.values),
            _reference_error(fact),
            unreacting.get(fact.point, nobody)[1],
        )
        for fact in found
    }


def _of_departure(fact: Fact, tasks: Mapping[str, TaskOfDrive], severity: Severity, method: MethodSettings) -> float:
    """U of a drive's departure, as a contact beside the road; 0 where it stayed on the road."""
    departure = tasks[fact.case].departure if fact.case in tasks else None
    if departure is None:
        return 0.0
    return severity.of(roadside_contact(departure, method.task.roadside_overlap), fact.case)


def _loss(fact: Fact) -> float | None:
    """L of a case's collision, None without one."""
    hit = fact.collision
    if hit is None:
        return None
    return float(collision_loss(impact_severity(hit.ego_velocity, hit.other_velocity, hit.overlap)))


def _severity(fact: Fact, severity: Severity) -> float | None:
    """U of a case's collision, or what stands in its place, None without one."""
    return None if fact.collision is None else severity.of(fact.collision, fact.case)


def _reference_severity(fact: Fact, severity: Severity, settings: CollisionSettings) -> float | None:
    """Ug or U0: U of a reference's drive, 0 where it avoids, None where it could not be evaluated."""
    if struck_by_other(fact, settings):
        return 0.0
    return (_severity(fact, severity) or 0.0) if fact.status in EVALUATED else None


def _reference_error(fact: Fact) -> str:
    """Why a reference's drive could not be evaluated: its error, its status where it has none; else nothing."""
    return "" if fact.status in EVALUATED else fact.error or fact.status


def tabulate(
    facts: Sequence[Fact],
    hazardous: BoolArray,
    indexes: Mapping[str, CaseIndex],
    points: Mapping[int, PointTerms],
    measured: Mapping[str, DriveMeasures],
    chosen: Severity,
    method: MethodSettings,
    tasks: Mapping[str, TaskOfDrive],
) -> list[CaseResult]:
    """One row a case. indexes, measured, tasks: by case. points: by point. chosen: what stands in the place of U."""
    rows, settings, nothing = [], method.collision, TaskOfDrive(None, None)
    for fact, dangerous in zip(facts, hazardous, strict=True):
        index, hit, there = indexes.get(fact.case), fact.collision, points[fact.point]
        struck = struck_by_other(fact, settings)
        severity, ideal = None if struck else _severity(fact, chosen), there.ideal_severity
        likeness = index.likeness if index else None
        gave_up, task = fact.status in GAVE_UP, tasks.get(fact.case, nothing)
        departure = task.departure
        rows.append(
            CaseResult(
                ads=fact.driver,
                zone="hazardous" if dangerous else "safe",
                **{name: getattr(fact, name) for name in _RECORDED},
                latency_relative=fact.latency_median / fact.latency_reference
                if fact.latency_median is not None and fact.latency_reference
                else None,
                collided=hit is not None and not struck,
                struck_from_behind=struck,
                impact_speed=hit.relative_speed if hit else None,
                overlap=hit.overlap if hit else None,
                side=hit.side if hit else None,
                severity=severity,
                loss=None if struck else _loss(fact),
                ideal_severity=ideal,
                no_reaction_severity=there.no_reaction_severity,
                ideal_error=there.ideal_error,
                no_reaction_error=there.no_reaction_error,
                weight=there.weight,
                beats_ideal=severity is not None and ideal is not None and severity < ideal,
                index=index.value if index else None,
                length_factor=index.length_factor if index else None,
                operation_factor=index.operation_factor if index else None,
                similarity=index.similarity if index else None,
                operation_tolerance=likeness.operation_tolerance if likeness else None,
                mixture_similarity=likeness.similarity if likeness else None,
                index_note=index.notes if index else (),
                clips="; ".join(f"{clip.what} x{clip.count}" for clip in fact.clips),
                ideal_collided=None if ideal is None else ideal > 0.0,
                undisturbed_pet=None if there.conflict is None else _finite(there.conflict.pet),
                time_to_conflict=None if there.conflict is None else _finite(there.conflict.time_to),
                task_share=0.0 if gave_up else task.share,
                departure_time=None if departure is None else departure.time,
                departure_speed=None if departure is None else departure.speed,
                departure_severity=None if departure is None else _of_departure(fact, tasks, chosen, method),
            )
        )
    return [_judged(row, indexes.get(row.case), measured.get(row.case)) for row in rows]


def _judged(row: CaseResult, index: CaseIndex | None, found: DriveMeasures | None) -> CaseResult:
    """The row with what its trajectories tell."""
    harmful = row.zone == "safe" and row.incident and row.ideal_severity == 0.0
    if found is None:
        return replace(row, human_likeness=0.0) if harmful else row
    likeness: float | None = None
    if harmful:
        likeness = 0.0
    elif row.counts_for_index and not row.incident and index is not None and index.likeness is not None:
        likeness = index.likeness.value * found.plausibility
    columns = [(item.name, part) for part in (found.criticality, found.lane) for item in fields(part)]
    measured = {name: _finite(getattr(part, name)) for name, part in columns if hasattr(row, name)}
    return replace(
        row,
        plausibility=found.plausibility,
        human_likeness=likeness,
        conflict_pet=_finite(found.conflict_pet),
        **measured,  # type: ignore[arg-type]
    )


def _finite(value: float) -> float | None:
    """None for what a table cannot hold: not defined, or unbounded."""
    return value if math.isfinite(value) else None


def combine(
    ads: str,
    scenario: str,
    rows: CaseTable | Sequence[CaseResult],
    method: MethodSettings,
    notes: Sequence[ScoreNote] = (),
    *,
    people: bool = True,
    task_reference: str = "",
) -> ScenarioResult:
    """Every score of one ADS in one scenario, Eqs. 13, 17, 18 and those that order, and the counts beside them.

    people: whether there is anybody to compare with; where not, nothing is missing without D and H. task_reference: the
    reference car that T compares with, "" where the run holds none.
    """
    notes = list(notes)
    cases = CaseTable.of(rows)
    terms = case_terms(cases, method)
    values = point_values(terms, method)
    c, d = values["c"], values["d"]
    safe, collided, lacks, indexed = cases.safe, cases.collided, cases.missing, np.isfinite(cases.index)
    safe_cases, safe_hits, voiding = _number(safe), _number(safe & collided), _number(cases.voids_index)
    if not voiding and people:
        lacks = lacks | (cases.counts_for_index & ~indexed)
    missing = +Counter[Zone]({"safe": _number(lacks & safe), "hazardous": _number(lacks & ~safe)})
    c_interval = _c_interval(cases, method)
    d_interval = _d_interval(cases) if safe_cases and not voiding and people else None
    s_interval = _s_interval(c, d, c_interval, d_interval, _number(safe & ~cases.evaluated), method)
    others = missing_bounds(terms, safe, method, people=people) if missing else {}
    if missing:
        notes.append(CasesMissing(tuple(sorted(missing.items()))))
        notes += _references_missing(cases)
    if s_interval:
        notes.append(WorstAndBest(c_interval, d_interval, s_interval))
    if struck := _number(cases.struck_from_behind):
        notes.append(StruckFromBehind(struck))
    if beaten := _number(collided & cases.beats_ideal):
        notes.append(GentlerThanIdeal(beaten))
    if safe_hits > voiding:
        notes.append(IdealCollidesToo(safe_hits - voiding, safe_hits))
    human, likened = values["human_likeness"], _number(safe & np.isfinite(cases.human_likeness))
    total = score_of(c, d, method.score)
    plus = plus_of(values["task_share"], values["avoidance_grade"], human, method.score)
    return ScenarioResult(
        ads=ads,
        scenario=scenario,
        c=c,
        d=d,
        d_reason=None if d is not None else _without_mean(safe_cases, voiding, _number(safe & indexed), people=people),
        s=total.total,
        c_points=total.c_points,
        d_points=total.d_points,
        cases=len(cases),
        safe_cases=safe_cases,
        hazardous_cases=len(cases) - safe_cases,
        collisions=_number(collided),
        safe_collisions=safe_hits,
        avoidable_collisions=_number(cases.avoidable),
        unavoidable_collisions=_number(cases.unavoidable),
        caused_collisions=_number(cases.caused),
        collision_probability=_or_nan(values["collision_probability"]),
        struck_from_behind=struck,
        off_road=_number(cases.off_road),
        not_evaluated=missing.total(),
        notes=tuple(notes),
        c_interval=c_interval,
        d_interval=d_interval,
        s_interval=s_interval,
        task_share=values["task_share"],
        avoidance_grade=values["avoidance_grade"],
        departures=_number(cases.departed),
        gave_up=_number(cases.gave_up),
        task_reference=task_reference,
        avoided_share=values["avoided_share"],
        avoided_share_exposure=values["avoided_share_exposure"],
        regret=values["regret"],
        human_likeness=human,
        h_reason=None if human is not None else _without_mean(safe_cases, 0, likened, people=people),
        s_plus=values["s_plus"],
        a_points=plus.a_points,
        h_points=plus.h_points,
        **{f"{name}_interval": ends for name, ends in others.items()},  # type: ignore[arg-type]
    )


def _number(flags: BoolArray) -> int:
    return int(np.count_nonzero(flags))


def _references_missing(cases: CaseTable) -> Iterator[ReferenceMissing]:
    """Why references of cases could not be evaluated, the most frequent reason first."""
    errors: tuple[tuple[Literal["ideal", "no_reaction"], Column], ...] = (
        ("ideal", cases.ideal_error), ("no_reaction", cases.no_reaction_error)
    )  # fmt: skip
    for who, reasons in errors:
        alike: dict[str, list[int]] = {}
        for place in np.flatnonzero(reasons != "").tolist():
            alike.setdefault(without_numbers(str(reasons[place])), []).append(place)
        for places in sorted(alike.values(), key=len, reverse=True):
            first = cases[places[0]]
            yield ReferenceMissing(who, str(reasons[places[0]]), len(places), first.case)


def _without_mean(safe: int, voiding: int, known: int, *, people: bool) -> NotComputed:
    """Why there is no mean over the safe cases. voiding: collisions that leave none. known: safe cases with a value."""
    if not people:
        return NotComputed("no_drivers")
    if voiding:
        return NotComputed("collisions", voiding)
    if not safe:
        return NotComputed("no_safe_case")
    return NotComputed("no_exposure" if known else "nothing_compared")


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


_SEVEREST = 100.0  # m/s: past every class of severity


def _c_interval(cases: CaseTable, method: MethodSettings) -> tuple[float, float] | None:
    """C with everything that is missing as a collision: one that the ideal vehicle avoids, or as gentle as its own.

    Both are bounds: a collision of ratio 0 never raises Eq. 17's mean, one of ratio 1 never lowers it.
    """
    severity, weight, known = cases.severity, cases.weight, np.isfinite(cases.ideal_severity)
    hit = cases.collided & np.isfinite(severity) & np.isfinite(weight)
    lost = ~hit & ~cases.evaluated
    if not (lost | (hit & ~known)).any():
        return None
    u = np.where(hit, severity, _SEVEREST)
    counted = np.where(np.isnan(weight), 1.0, weight)
    worst, best = (np.where(hit & known, cases.ideal_severity, other) for other in (0.0, u))
    part = hit | lost
    low, high = (
        collision_avoidance_index(u[part], ideal[part], counted[part], loss=method.collision.loss)
        for ideal in (worst, best)
    )
    return low, high


def _d_interval(cases: CaseTable) -> tuple[float, float] | None:
    """D with every safe case without a collision that has no D_i as 0, and as 1."""
    index, exposures = (column[cases.counts_for_index] for column in (cases.index, cases.exposure))
    if np.isfinite(index).all() or not exposures.any():
        return None
    low, high = (exposure_weighted_index(np.where(np.isnan(index), fill, index), exposures) for fill in (0.0, 1.0))
    return low, high


def _s_interval(
    c: float | None,
    d: float | None,
    c_interval: tuple[float, float] | None,
    d_interval: tuple[float, float] | None,
    safe_not_evaluated: int,
    method: MethodSettings,
) -> tuple[float, float] | None:
    """S at both ends; a missing safe case may have been a collision, after which there is no D."""
    if c_interval is None and d_interval is None:
        return None
    lowest_d = None if safe_not_evaluated else (d_interval[0] if d_interval else d)
    low, high = (
        score_of(at_c, at_d, method.score).total or 0.0
        for at_c, at_d in (
            (c_interval[0] if c_interval else c, lowest_d),
            (c_interval[1] if c_interval else c, d_interval[1] if d_interval else d),
        )
    )
    return low, high


def describe_zones(logical: LogicalScenario, zones: ZonePartition, points: Sample) -> ZoneResult:
    """What the report says of a partition."""
    inside = zones.exactly_hazardous(points.points)
    error = boundary_error(zones)
    return ZoneResult(
        scenario=logical.name,
        zones=len(zones.most_dangerous),
        hazardous_share=float(np.average(inside, weights=points.stands_for)),
        most_dangerous=zones.most_dangerous,
        boundary_error=error.feasible,
        boundary_error_box=error.box,
        sampled=len(points.points),
        refused=len(points.refused),
        notes=(*logical.notes, *zones.notes, *points.notes),
    )
