"""Measures of an evaluated case's trajectories other than D_i: criticality, plausibility, lane
keeping, PET.

A drive's measures depend on its recorded trajectories alone: they are kept in the run's folder, and
what is not there yet is measured in the processes that compute D_i.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from sumo_eval.cases import EVALUATED, CaseResult
from sumo_eval.method.conflict import conflicting
from sumo_eval.method.measures import (
    CriticalityMeasures,
    LaneKeeping,
    conflict_pet,
    course_of,
    lane_keeping,
    measures,
)
from sumo_eval.method.plausibility import EXTREMES, Quantiles, extremes_of, plausibility
from sumo_eval.record.human_reference import method_sources
from sumo_eval.record.kept_results import key_of
from sumo_eval.record.store import EGO, Fact, Store, open_store
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.space import Space
from sumo_eval.trajectory import Collision

_AT_ONCE = 32  # drives that a process measures before it answers


@dataclass(frozen=True, slots=True)
class _Drive:
    """A case whose drive is to be measured.

    conflicting: who has a way that conflicts with the ego's, "" for none.
    """

    case: str
    collision: Collision | None
    conflicting: str


def drive_measures(
    facts: Sequence[Fact], space: Space, people: Quantiles, files: str
) -> dict[str, dict[str, float | None]]:
    """The fields of every evaluated case that its trajectories tell, by case.

    people: among whom it is more or less plausible.
    files: a hash of those of the scenario.
    """
    store, kept, lane_width = space.store, space.kept, space.logical.road.lane_width
    evaluated = [fact for fact in facts if fact.status in EVALUATED]
    keys = [
        key_of("drive", store.case_hash(fact.case), lane_width, files, method_sources())
        for fact in evaluated
    ]
    found = {
        fact.case: data
        for fact, key in zip(evaluated, keys, strict=True)
        if (data := kept.get("drive", key)) is not None
    }
    missing = [
        (fact, key) for fact, key in zip(evaluated, keys, strict=True) if fact.case not in found
    ]
    drives = [
        _Drive(fact.case, fact.collision, _conflicting(space.logical, fact)) for fact, _ in missing
    ]
    parts = [
        (store.path, drives[first : first + _AT_ONCE], lane_width)
        for first in range(0, len(drives), _AT_ONCE)
    ]
    new = [data for part in (space.spread(_measured_part, parts) if parts else ()) for data in part]
    kept.put(("drive", key, 0, data) for (_, key), data in zip(missing, new, strict=True))
    found |= {drive.case: data for drive, data in zip(drives, new, strict=True)}
    return {fact.case: _measures_in(found[fact.case], people) for fact in evaluated}


def _conflicting(logical: LogicalScenario, fact: Fact) -> str:
    if logical.search is None:
        return ""
    concrete = logical.placed(fact.values)
    other = conflicting(logical, concrete)
    return "" if other is None else concrete.actors[other].name


def _measured_part(part: tuple[Path, Sequence[_Drive], float]) -> list[bytes]:
    """The measures of some drives of a run, lane_width in m."""
    path, drives, lane_width = part
    with open_store(path, checked=True) as store:
        return [_measured(drive, store, lane_width) for drive in drives]


_CRITICALITY, _LANE = len(fields(CriticalityMeasures)), len(fields(LaneKeeping))
_NUMBERS = struct.Struct(f"<{_CRITICALITY + len(EXTREMES) + _LANE + 1}d")


def _measured(drive: _Drive, store: Store, lane_width: float) -> bytes:
    """Measures of a drive as numbers, in the order of the fields."""
    actors = store.trajectories(drive.case)
    if EGO not in actors:
        raise store.no_trajectory(drive.case)
    ego = actors.pop(EGO)
    course = course_of(ego, actors, drive.collision)
    criticality = measures(ego, actors, drive.collision, course)
    extremes = extremes_of(ego, actors, drive.collision, course)
    lane = lane_keeping(ego, lane_width)
    pet = math.nan
    if drive.conflicting in actors:
        hit = (
            drive.collision
            if drive.collision is not None and drive.collision.other == drive.conflicting
            else None
        )
        pet = conflict_pet(ego, actors[drive.conflicting], hit)
    return _NUMBERS.pack(
        *_values(criticality), *(extremes[name] for name in EXTREMES), *_values(lane), pet
    )


def _values(measured: CriticalityMeasures | LaneKeeping) -> Iterable[float]:
    return (getattr(measured, field.name) for field in fields(measured))


def finite(value: float) -> float | None:
    """None for what a table cannot hold: not defined, or unbounded."""
    return value if math.isfinite(value) else None


_MEASURED = tuple(item.name for part in (CriticalityMeasures, LaneKeeping) for item in fields(part))
_COLUMNS = frozenset(item.name for item in fields(CaseResult))


def _measures_in(data: bytes, people: Quantiles) -> dict[str, float | None]:
    """The result of `_measured`, without what no case has a field of."""
    *numbers, pet = _NUMBERS.unpack(data)
    extremes = dict(zip(EXTREMES, numbers[_CRITICALITY:-_LANE], strict=True))
    found = zip(_MEASURED, numbers[:_CRITICALITY] + numbers[-_LANE:], strict=True)
    return {
        **{name: finite(value) for name, value in found if name in _COLUMNS},
        "plausibility": plausibility(extremes, people),
        "conflict_pet": finite(pet),
    }
