"""Departure and t_i of recorded drives, point by point: `method.driving_task` over the facts of a
run.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from sumo_eval.coded import decoded, encoded
from sumo_eval.method.driving_task import (
    Departure,
    asked_way,
    first_departure,
    is_excused,
    task_share,
)
from sumo_eval.method.measures import STANDING
from sumo_eval.record.human_reference import method_sources
from sumo_eval.record.kept_results import key_of
from sumo_eval.record.store import EGO, Fact, Store
from sumo_eval.scenario.concrete import Road, Way
from sumo_eval.scoring.space import ScenarioRun

_AT_ONCE = 16  # points that a process does before it answers


@dataclass(frozen=True, slots=True)
class TaskOfDrive:
    """Result of one drive.

    departure: None where the drive stayed on the road.
    share: t_i; None without a reference.
    """

    departure: Departure | None
    share: float | None


@dataclass(frozen=True, slots=True)
class _Point:
    """Job: all drives at one point.

    drives: whether each drive had a contact, by case.
    references: cases of the references' drives, which ended without contact.
    road: of the scenario.
    margin: how far a corner may be beyond the road (`road_margin`), m.
    begin: x of the ego's start, m.
    way: the lane change that the point asks for; None without one.
    """

    drives: Mapping[str, bool]
    references: Sequence[str]
    road: Road
    margin: float
    begin: float
    way: Way | None


_RECORDS = {record.__name__: record for record in (TaskOfDrive, Departure)}


def tasks_of_drives(
    drives: Sequence[Fact], references: Iterable[Fact], space: ScenarioRun
) -> dict[str, TaskOfDrive]:
    """Departure and t_i of every recorded drive at some points of a scenario, by case.

    references: the drives of drivers and of the reference car there.
    """
    hash_of = space.store.case_hash
    road, margin = space.logical.road, space.method.task.road_margin
    references_at: dict[int, list[str]] = {}
    for fact in references:
        if fact.status == "ok":
            references_at.setdefault(fact.point, []).append(fact.case)
    points: list[_Point] = []
    keys: dict[str, bytes] = {}
    ordered = sorted(drives, key=lambda fact: fact.point)
    for number, facts in groupby(ordered, key=lambda fact: fact.point):
        here, others = list(facts), references_at.get(number, [])
        start = space.logical.placed(here[0].values).ego
        hits = {
            fact.case: fact.status == "collision"
            for fact in here
            # these two ends have no drive; a case given up has one, which may leave the road
            if fact.end_reason not in (None, "sim_error")
        }
        points.append(_Point(hits, others, road, margin, start.x, start.way))
        # a result depends on the point's references and on its own drive
        common = key_of(
            [hash_of(case) for case in others], road, margin, start.x, start.way, method_sources()
        )
        keys |= {case: key_of(common, hash_of(case), hit) for case, hit in hits.items()}

    def points_of(missing: Collection[str]) -> list[_Point]:
        return [point for point in points if not point.drives.keys().isdisjoint(missing)]

    found = space.results("task", keys, points_of, _tasks, _AT_ONCE)
    return {case: decoded(data, _RECORDS) for case, data in found.items()}


def _tasks(point: _Point, store: Store) -> Iterator[tuple[str, bytes]]:
    """Every case at a point with its `TaskOfDrive`."""
    beside = [store.trajectory(case) for case in point.references]
    clean = [drive for drive in beside if first_departure(drive, point.road, point.margin) is None]
    asked = asked_way(point.begin, clean)  # its places with times; `point.way`: a lane change
    for case, hit in point.drives.items():
        ego, share = store.trajectory(case), None
        departure = first_departure(ego, point.road, point.margin)
        if asked is not None:
            incident = hit or departure is not None
            # the actors are read only if they could excuse the ego
            excused = not incident and ego.speed[-1] < STANDING and _excused(case, store)
            share = task_share(ego, asked, point.way, incident=incident, excused=excused)
        yield case, encoded(TaskOfDrive(departure, share))


def _excused(case: str, store: Store) -> bool:
    """`is_excused` of a recorded drive."""
    actors = store.trajectories(case)
    return is_excused(actors.pop(EGO), actors)


def recorded_with(store: Store, car: str) -> bool:
    """Whether a run holds the drive of the reference car at every point: as many as of `ideal`."""
    counts = dict.fromkeys(("ideal", "task_reference"), 0)
    for _scenario, role, _driver, _status, number, _exposure in store.counts():
        if role in counts:
            counts[role] += number
    first = next(store.facts("task_reference"), None)
    driven = first is not None and first.controller == car
    return driven and counts["ideal"] == counts["task_reference"]
