"""Departure and t_i of recorded drives, point by point: `method.driving_task` over the facts of a
run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path

from sumo_eval.cases import EVALUATED
from sumo_eval.coded import decoded, encoded
from sumo_eval.method.driving_task import (
    AskedWay,
    Departure,
    asked_way,
    first_departure,
    is_excused,
    task_share,
)
from sumo_eval.method.measures import STANDING
from sumo_eval.record.human_reference import method_sources
from sumo_eval.record.kept_results import key_of
from sumo_eval.record.store import EGO, Fact, Store, open_store
from sumo_eval.scenario.concrete import Road, Way
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.space import Space
from sumo_eval.trajectory import Trajectory

_AT_ONCE = 16  # points that a process works on before it answers


@dataclass(frozen=True, slots=True)
class TaskOfDrive:
    """departure: None where the drive stayed on the road.
    share: t_i; None without a reference.
    """

    departure: Departure | None
    share: float | None


@dataclass(frozen=True, slots=True)
class _Point:
    """Request at one point.

    drives: cases, and whether each holds a contact.
    references: cases without one.
    """

    drives: tuple[tuple[str, bool], ...]
    references: tuple[str, ...]
    road: Road
    margin: float
    begin: float
    way: Way | None


_RECORDS = {one.__name__: one for one in (TaskOfDrive, Departure)}


def tasks_of_drives(
    drives: Sequence[Fact], references: Iterable[Fact], space: Space
) -> dict[str, TaskOfDrive]:
    """Departure and t_i of every evaluated drive at some points of a scenario, by case.

    references: the drives of drivers and of the reference car there.
    """
    store, kept, margin = space.store, space.kept, space.method.task.road_margin
    beside: dict[int, list[str]] = {}
    for fact in references:
        if fact.status == "ok":
            beside.setdefault(fact.point, []).append(fact.case)
    wanted = [
        _point(list(facts), tuple(beside.get(point, ())), space.logical, margin)
        for point, facts in groupby(
            sorted(drives, key=lambda fact: fact.point), key=lambda fact: fact.point
        )
    ]
    keys = {case: key for point in wanted for case, key in _keys(point, store)}
    found = {
        case: data for case, key in keys.items() if (data := kept.get("task", key)) is not None
    }
    missing = [point for point in wanted if any(case not in found for case, _ in point.drives)]
    parts = [
        (store.path, missing[first : first + _AT_ONCE])
        for first in range(0, len(missing), _AT_ONCE)
    ]
    new = {
        case: data
        for part in (space.spread(_some_points, parts) if parts else ())
        for case, data in part
    }
    kept.put(("task", keys[case], 0, data) for case, data in new.items())
    return {case: decoded(data, _RECORDS) for case, data in {**found, **new}.items()}


def _point(
    facts: Sequence[Fact], references: tuple[str, ...], logical: LogicalScenario, margin: float
) -> _Point:
    start = logical.placed(facts[0].values).ego
    drives = tuple(
        (fact.case, fact.status == "collision") for fact in facts if fact.status in EVALUATED
    )
    return _Point(drives, references, logical.road, margin, start.x, start.way)


def _keys(point: _Point, store: Store) -> Iterator[tuple[str, bytes]]:
    """The cases of a point, each with a hash of all that its result depends on."""
    hash_of = cache(store.case_hash)
    beside = [hash_of(case) for case in point.references]
    common = key_of(beside, point.road, point.margin, point.begin, point.way, method_sources())
    return ((case, key_of(common, hash_of(case), hit)) for case, hit in point.drives)


def _some_points(part: tuple[Path, Sequence[_Point]]) -> list[tuple[str, bytes]]:
    path, points = part
    with open_store(path, checked=True) as store:
        return [
            (case, encoded(task)) for point in points for case, task in _tasks(point, store).items()
        ]


def _tasks(point: _Point, store: Store) -> dict[str, TaskOfDrive]:
    beside = [store.trajectory(case) for case in point.references]
    clean = [drive for drive in beside if first_departure(drive, point.road, point.margin) is None]
    asked = asked_way(point.begin, clean)
    return {case: _task(case, hit, asked, point, store) for case, hit in point.drives}


def _task(case: str, hit: bool, asked: AskedWay | None, point: _Point, store: Store) -> TaskOfDrive:
    ego = store.trajectory(case)
    departure = first_departure(ego, point.road, point.margin)
    if asked is None:
        return TaskOfDrive(departure, None)
    incident = hit or departure is not None
    excused = not incident and _is_excused(case, ego, store)
    return TaskOfDrive(
        departure, task_share(ego, asked, point.way, incident=incident, excused=excused)
    )


def _is_excused(case: str, ego: Trajectory, store: Store) -> bool:
    if ego.speed[-1] >= STANDING:
        return False
    others = store.trajectories(case)
    others.pop(EGO)
    return is_excused(ego, others)


def recorded_with(store: Store, car: str) -> bool:
    """Whether a run holds the drive of the reference car at every point."""
    counts: dict[str, int] = {"ideal": 0, "task_reference": 0}
    for _, role, _, _, number, _ in store.counts():
        if role in counts:
            counts[role] += number
    first = next(iter(store.each_fact("task_reference")), None)
    return (
        first is not None
        and first.controller == car
        and counts["ideal"] == counts["task_reference"]
    )
