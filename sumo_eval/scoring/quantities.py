"""Rows of cases from recorded facts (D_i, U, L, Ug, U0, r of each case), then the scores of an ADS
in a scenario from its rows.

`steps.py` calls `references_struck`, then `harm_at` and `tabulate` for some points at a time, then
`combine`. It and `cli/space.py` call `describe_zones`.

Users: `scoring/steps.py`, `cli/space.py`. Fixed: fields of `CaseResult` and `ScenarioResult`, which
are columns of cases.csv and keys of scores.json.
"""

import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable, counts
from sumo_eval.cases import EVALUATED, GAVE_UP, CaseResult, Zone
from sumo_eval.groups import grouped
from sumo_eval.method.collision_avoidance import collision_loss, impact_severity
from sumo_eval.method.conflict import conflict_at
from sumo_eval.method.driving_task import Departure, roadside_contact
from sumo_eval.method.plausibility import Quantiles
from sumo_eval.method.score_terms import worth
from sumo_eval.method.severity import Severity
from sumo_eval.method.zone_partition import ZonePartition, boundary_error
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.cases import IN_BLOCK, Role
from sumo_eval.results import NotComputed, ScenarioResult, ZoneResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import Sample
from sumo_eval.score_notes import (
    BeyondRange,
    CasesMissing,
    Counted,
    DrivenAlone,
    DrivenInBlocks,
    DrivesLeftOut,
    ReferenceMissing,
    ScoreNote,
    WorstAndBest,
)
from sumo_eval.scoring.case_terms import case_terms, missing_bounds, point_values
from sumo_eval.scoring.contact_cause import cause_of_contact
from sumo_eval.scoring.drive_results import DriveResult, finite
from sumo_eval.scoring.findings import LIKENESS_FACTORS, missing_cases
from sumo_eval.scoring.likeness import (
    DriverComparison,
    RowFields,
    Survey,
    beside_people,
    reference_notes,
)
from sumo_eval.scoring.requirements import requirements_missed
from sumo_eval.scoring.space import ScenarioRun
from sumo_eval.settings import MethodSettings
from sumo_eval.text import without_numbers
from sumo_eval.trajectory import NO_RETURN, BoolArray, FloatArray

_RECORDED = {item.name for item in fields(CaseResult) if item.name != "clips"} & {
    item.name for item in fields(Fact)
}
"""Fields that a row takes from its fact unchanged. Of the clips `tabulate` makes one text."""


LIGHTEST = sys.float_info.min
"""Least loss, 0..1, of a contact of the ideal vehicle: 0 stands for no contact. So a contact of an
ADS with loss 0 is compared as if it had this loss, too."""


class Remarks(NamedTuple):
    """Counts for an ADS's notes in a scenario that its rows do not have, collected from its facts,
    some drives at a time.

    blocks: size of a fixed batch -> number of drives in batches of this size.
    beyond: reason why a severity may not hold -> number of collisions with it.
    """

    blocks: Counter[int]
    beyond: Counter[str]

    def add(self, facts: Sequence[Fact], severity: Severity) -> None:
        """Count some drives of the ADS."""
        for fact in facts:
            # `requested` of this clip is the size of the fixed batch
            self.blocks.update(int(it.requested) for it in fact.clips if it.what == IN_BLOCK)
            if fact.collision is not None and (reason := severity.beyond(fact.collision)):
                self.beyond[reason] += 1

    def notes(
        self,
        ads: str,
        space: ScenarioRun,
        plausible: Sequence[ScoreNote],
        struck: Sequence[ScoreNote],
        cases: CaseTable,
    ) -> Iterator[ScoreNote]:
        """The notes on an ADS in a scenario.

        plausible: notes on the people that the plausibility compares with.
        struck: notes of `references_struck`.
        cases: all cases of the ADS.
        """
        # status -> number of drives of human drivers. The store counts all human drivers together,
        # so each status occurs once.
        statuses = {
            count.status: count.drives
            for count in space.store.counts()
            if (count.scenario, count.role) == (space.name, "human")
        }
        drives, complete = sum(statuses.values()), statuses.pop("ok", 0)
        if statuses:
            yield DrivesLeftOut(drives - complete, drives, tuple(sorted(statuses.items())))
        yield from plausible
        if alone := space.store.simulated_alone(space.name, ads):
            yield DrivenAlone(tuple(alone.items()))
        if batched := _number(cases.batched != ""):
            yield Counted("compared", _number(cases.batched == "compared"), batched)
        if self.blocks:
            yield DrivenInBlocks(self.blocks.total(), tuple(sorted(self.blocks)))
        # `clips` is one text a case; find: -1 if the clip is not in it
        if number := _number(np.strings.find(cases.clips, "actor_left_the_network") >= 0):
            yield Counted("actors_left", number, len(cases))
        if number := _number(np.strings.find(cases.clips, "actor_off_its_script") >= 0):
            yield Counted("actors_moved", number, len(cases))
        yield from struck
        yield from reference_notes(cases)
        if self.beyond:
            yield BeyondRange(space.severity.name, tuple(sorted(self.beyond.items())))


def references_struck(space: ScenarioRun, overview: Survey) -> Iterator[ScoreNote]:
    """Note on the safe points at which a human driver or the reference car collides."""
    safe_points, struck_points = set[int](), set[int]()
    roles: tuple[Role, ...] = ("human", "task_reference") if space.car else ("human",)
    for role in roles:
        for point, _, status, _ in space.store.outcomes(role, space.name):
            if not overview.hazardous[point]:
                safe_points.add(point)
                if status == "collision":
                    struck_points.add(point)
    if struck_points:
        yield Counted("references_collide", len(struck_points), len(safe_points))


def struck_by_other(fact: Fact, space: ScenarioRun) -> bool:
    """Whether a case's collision is the other vehicle's fault: a vehicle that reacts ran into the
    rear of an ego that had been in its lane for at least `others_fault_after`.
    """
    settings = space.method.collision
    if fact.collision is None or settings.rear_end == "counts":
        return False
    # An ego that has been in the lane since its start has been there long enough, even if the
    # collision comes sooner; 1e-6 s is rounding.
    enough = min(settings.others_fault_after, fact.collision.time - 1e-6)
    # `applied` of this clip is the time that the ego had been in the lane, s
    return any(clip.what == "struck_from_behind" and clip.applied >= enough for clip in fact.clips)


def harm_at(
    space: ScenarioRun,
    overview: Survey,
    points: range,
    unreacting: Sequence[Fact],
    drives: Mapping[str, DriveResult],
) -> dict[int, RowFields]:
    """Point -> fields that all cases there share: weight (Eq. 16), Ug (Eq. 17), U0, and PET and
    time to the conflict if no vehicle reacts.

    overview: weights of all points (r times the number of points that each stands for).
    points: numbers of the points.
    unreacting: drives of `no_reaction` at these points.
    drives: results of each drive, by case, which have its departure.
    """
    unreacting_at = {fact.point: fact for fact in unreacting}
    harm = {}
    for fact in space.facts_at(points, "ideal"):
        shared = {"weight": float(overview.weights[fact.point]), **_reference("ideal", fact, space)}
        if (no_reaction := unreacting_at.get(fact.point)) is not None:
            departure = _of_departure(drives[no_reaction.case].departure, no_reaction.case, space)
            shared |= _reference("no_reaction", no_reaction, space, least=departure)
        if (conflict := conflict_at(space.logical, fact.values)) is not None:
            shared["undisturbed_pet"] = finite(conflict.pet)
            shared["time_to_conflict"] = finite(conflict.time_to)
        harm[fact.point] = shared
    return harm


def _reference(
    reference: Literal["ideal", "no_reaction"], fact: Fact, space: ScenarioRun, least: float = 0.0
) -> RowFields:
    """Fields on the drive of a reference: Ug or U0, 0 if it avoids the contact. If the drive could
    not be evaluated, the field is None, and a second field has the reason.

    least: U of its departure from the road, m/s, which is the lower bound.
    """
    if fact.status not in EVALUATED:
        return {f"{reference}_severity": None, f"{reference}_error": fact.error or fact.status}
    severity = _severity(fact, space)
    if severity is not None and reference == "ideal" and not space.method.collision.unit:
        severity = max(severity, LIGHTEST)
    return {f"{reference}_severity": max(severity or 0.0, least)}


def _of_departure(departure: Departure | None, case: str, space: ScenarioRun) -> float:
    """U of a departure from the road, as a contact with an obstacle beside the road; 0 without a
    departure.

    case: its key, for error messages.
    """
    if departure is None:
        return 0.0
    return space.severity.of(roadside_contact(departure, space.method.task.roadside_overlap), case)


def _severity(fact: Fact, space: ScenarioRun) -> float | None:
    """U of a case's collision, or the severity that the settings use instead; None without a
    collision, and if the collision is the other vehicle's fault.
    """
    if fact.collision is None or struck_by_other(fact, space):
        return None
    return space.severity.of(fact.collision, fact.case)


def tabulate(
    facts: Sequence[Fact],
    space: ScenarioRun,
    overview: Survey,
    people: DriverComparison,
    harm: Mapping[int, Mapping[str, Any]],
    drives: Mapping[str, DriveResult],
    plausible: Quantiles,
) -> Iterator[CaseResult]:
    """Make the row of each case.

    facts: drives of one ADS, each of which becomes a row.
    overview: zones of the points.
    people: comparison with the human drivers.
    harm: point -> fields that the cases there share, from `harm_at`.
    drives: departure, t_i and measures, by case.
    plausible: table of people that the plausibility compares with.
    """
    for fact in facts:
        zone: Zone = "hazardous" if overview.hazardous[fact.point] else "safe"
        drive, struck = drives[fact.case], struck_by_other(fact, space)
        severity = _severity(fact, space)
        ideal = harm[fact.point]["ideal_severity"]  # Ug; None: not known
        fields_of_row: RowFields = {
            **{name: getattr(fact, name) for name in _RECORDED},
            **harm[fact.point],
            **beside_people(fact, zone, people, space.settings.drivers),
            **drive.measures(plausible),
            **_of_contact(fact, struck),
        }
        if fact.latency_median is not None and fact.latency_reference:
            fields_of_row["latency_relative"] = fact.latency_median / fact.latency_reference
        if (departure := drive.departure) is not None:
            fields_of_row |= {
                "departure_time": departure.time,
                "departure_speed": departure.speed,
                "departure_severity": _of_departure(departure, fact.case, space),
            }
        row = CaseResult(
            ads=fact.driver,
            zone=zone,
            collided=fact.collision is not None and not struck,
            struck_from_behind=struck,
            severity=severity,
            beats_ideal=severity is not None
            and ideal is not None
            and max(severity, LIGHTEST) < ideal,
            ideal_collided=None if ideal is None else ideal > 0.0,
            task_share=0.0 if fact.status in GAVE_UP else drive.share,
            excused=drive.excused,
            clips="; ".join(
                f"{clip.what} x{clip.count}" for clip in fact.clips if clip.what != NO_RETURN
            ),
            exposure_note="outside_support" if fact.point in space.outside else "",
            requirements_missed=requirements_missed(fact, space),
            **fields_of_row,
        )
        # last the human-likeness, which needs the properties of a complete row
        yield replace(row, human_likeness=_human_likeness(row) if overview.people else None)


def _of_contact(fact: Fact, struck: bool) -> RowFields:
    """Fields on the contact of a case; none without a contact.

    struck: whether it is the other vehicle's fault. Then it has no L.
    """
    hit = fact.collision
    if hit is None:
        return {}
    contact = cause_of_contact(fact)._asdict()
    contact |= {"impact_speed": hit.relative_speed, "overlap": hit.overlap, "side": hit.side}
    if not struck:
        # L is always that of the paper's U, whatever `severity` is
        u = impact_severity(hit.ego_velocity, hit.other_velocity, hit.overlap)
        contact["loss"] = float(collision_loss(u))
    return contact


def _human_likeness(row: CaseResult) -> float | None:
    """Human-likeness of a case: the product of its factors; 0 after an incident in the safe zone
    that the ideal vehicle avoids; None if the case has no part in H.
    """
    if row.safe and row.incident and row.ideal_severity == 0.0:
        return 0.0
    factors = [getattr(row, name) for name in LIKENESS_FACTORS.values()]
    if None in factors or row.incident or not row.counts_for_index:
        return None
    return float(math.prod(factors))


def combine(
    ads: str,
    scenario: str,
    rows: CaseTable | Sequence[CaseResult],
    method: MethodSettings,
    notes: Iterable[ScoreNote] = (),
    *,
    people: bool = True,
    task_reference: str = "",
) -> ScenarioResult:
    """All scores of one ADS in one scenario: C, D and S (Eqs. 13, 17, 18), T, A', H and S+, and
    counts.

    rows: of all its cases.
    method: `[method]`.
    notes: made so far; more are added here.
    people: whether there are human drivers to compare with. If not, cases without D_i or
        human-likeness are not missing.
    task_reference: the reference car that T compares with; empty: the run has none.
    """
    cases = CaseTable.of(rows)
    terms = case_terms(cases, method)
    values = point_values(terms)
    safe_cases = _number(cases.safe)
    voiding = _number(cases.voids_index)  # collisions after which there is no D
    is_missing = missing_cases(cases, has_index=people and not voiding)
    missing = Counter[Zone](cases.zone[is_missing].tolist())
    bounds = missing_bounds(cases, terms, values, people=people) if missing else {}
    notes = list(notes)
    if missing:
        notes += [CasesMissing(tuple(sorted(missing.items()))), *_references_missing(cases)]
    if "s" in bounds:
        notes.append(WorstAndBest(bounds.get("c"), bounds.get("d"), bounds["s"]))
    human_likeness = values["human_likeness"]
    points = worth(method.score)
    # T max(A', 0), the part of S+ that a and b H multiply
    harmless_task = (values["task_share"] or 0.0) * max(values["avoidance_grade"] or 0.0, 0.0)
    # Fields of the result by name. An interval holds only what missing cases leave open:
    # `with_intervals` widens it. A case without D_i alone is not evaluated either.
    scores: dict[str, Any] = {f"{name}_interval": ends for name, ends in bounds.items()}
    scores |= values | counts(cases) | {"not_evaluated": missing.total()}
    if values["collision_probability"] is None:
        scores["collision_probability"] = math.nan  # this field is never None
    return ScenarioResult(
        ads=ads,
        scenario=scenario,
        **scores,
        d_reason=None
        if values["d"] is not None
        else _without_mean(cases.index[cases.safe], voiding, people=people),
        h_reason=None
        if human_likeness is not None
        else _without_mean(cases.human_likeness[cases.safe], 0, people=people),
        c_points=points.c * (values["c"] or 0.0),
        d_points=points.d * (values["d"] or 0.0),
        a_points=method.score.a * harmless_task,
        h_points=method.score.b * harmless_task * (human_likeness or 0.0),
        cases=len(cases),
        safe_cases=safe_cases,
        hazardous_cases=len(cases) - safe_cases,
        struck_from_behind=_number(cases.struck_from_behind),
        notes=(*notes, *_case_notes(cases)),
        task_reference=task_reference,
    )


def _number(flags: BoolArray) -> int:
    """Number of flags that are true."""
    return int(np.count_nonzero(flags))


def _case_notes(cases: CaseTable) -> Iterator[ScoreNote]:
    """A note on each kind of case that occurs, with the number of its cases."""
    safe, hits = _number(cases.safe), _number(cases.collided)
    safe_hits = _number(cases.collided & cases.safe)
    counted = (
        Counted("struck_from_behind", _number(cases.struck_from_behind), len(cases)),
        Counted("excused", _number(cases.counts_for_index & cases.excused), safe),
        Counted("cut_short", _number(cases.safe & (cases.end_reason == "decided")), safe),
        Counted("gentler_than_ideal", _number(cases.collided & cases.beats_ideal), hits),
        Counted("ideal_collides_too", safe_hits - _number(cases.voids_index), safe_hits),
    )
    yield from (note for note in counted if note.number)


def _references_missing(cases: CaseTable) -> Iterator[ReferenceMissing]:
    """Notes on cases whose references could not be evaluated, the most frequent reason first."""
    for reference in ("ideal", "no_reaction"):
        reasons = getattr(cases, f"{reference}_error")
        failed = np.flatnonzero(reasons != "").tolist()
        alike = grouped((without_numbers(str(reasons[row])), row) for row in failed)
        for first, *more in sorted(alike.values(), key=len, reverse=True):
            yield ReferenceMissing(reference, str(reasons[first]), 1 + len(more), cases[first].case)


def _without_mean(values: FloatArray, voiding: int, *, people: bool) -> NotComputed:
    """The reason why there is no mean over the safe cases.

    values: of the safe cases, nan for a case without one.
    voiding: number of collisions that void the mean; one is enough.
    people: whether there are human drivers to compare with.
    """
    if not people:
        return NotComputed("no_drivers")
    if voiding:
        return NotComputed("collisions", voiding)
    if not values.size:
        return NotComputed("no_safe_case")
    return NotComputed("no_exposure" if np.isfinite(values).any() else "nothing_compared")


def describe_zones(logical: LogicalScenario, zones: ZonePartition, points: Sample) -> ZoneResult:
    """Summary of a scenario's zones for the report.

    points: the sample that was driven.
    """
    # whether each point is hazardous by max ITTC itself
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
