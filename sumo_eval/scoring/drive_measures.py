"""Measures of an evaluated case's trajectories other than D_i: criticality, plausibility, lane
keeping, PET.

A drive's measures depend on its recorded trajectories alone: they are kept in the run's folder, and
the missing ones are measured in the processes that compute D_i.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import astuple, dataclass, fields

from sumo_eval.cases import EVALUATED
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
from sumo_eval.record.store import EGO, Fact, Store
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.space import ScenarioRun
from sumo_eval.trajectory import Collision

_AT_ONCE = 32  # drives that a process measures before it answers


@dataclass(frozen=True, slots=True)
class _Request:
    """A drive to be measured.

    road: the drive is in its coordinates.
    conflicting: the actor whose way conflicts with the ego's, "" for none.
    """

    case: str
    collision: Collision | None
    road: Road
    conflicting: str


def drive_measures(
    facts: Sequence[Fact], space: ScenarioRun, people: Quantiles, files: str
) -> dict[str, dict[str, float | None]]:
    """Fields of every evaluated case that follow from its trajectories, by case.

    people: table of people that the plausibility compares with.
    files: a hash of the scenario's files.
    """
    road, hash_of = space.logical.road, space.store.case_hash
    evaluated = [fact for fact in facts if fact.status in EVALUATED]
    keys = {
        fact.case: key_of("drive", hash_of(fact.case), road, files, method_sources())
        for fact in evaluated
    }

    def requests(missing: Collection[str]) -> list[_Request]:
        return [
            _Request(fact.case, fact.collision, road, _conflicting(space.logical, fact))
            for fact in evaluated
            if fact.case in missing
        ]

    found = space.results("drive", keys, requests, _measured, _AT_ONCE)
    return {case: _measures_in(found[case], people) for case in keys}


def _conflicting(logical: LogicalScenario, fact: Fact) -> str:
    """Name of the actor whose way conflicts with the ego's; empty without one."""
    concrete = logical.placed(fact.values)
    other = conflicting(logical, concrete)
    return "" if other is None else concrete.actors[other].name


_CRITICALITY, _LANE = len(fields(CriticalityMeasures)), len(fields(LaneKeeping))
# a drive's measures as they are kept: criticality, extremes, lane keeping, PET of conflicting ways
_NUMBERS = struct.Struct(f"<{_CRITICALITY + len(EXTREMES) + _LANE + 1}d")


def _measured(request: _Request, store: Store) -> Iterator[tuple[str, bytes]]:
    """A case with the measures of its drive as numbers, in the order of the fields."""
    actors, hit = store.trajectories(request.case), request.collision
    if EGO not in actors:
        raise store.no_trajectory(request.case)
    ego = actors.pop(EGO)
    course = course_of(ego, actors, hit, request.road)
    extremes = extremes_of(course)
    pet = math.nan
    if request.conflicting in actors:
        contact = hit if hit is not None and hit.other == request.conflicting else None
        pet = conflict_pet(ego, actors[request.conflicting], contact)
    yield (
        request.case,
        _NUMBERS.pack(
            *astuple(measures(ego, actors, hit, course)),
            *(extremes[name] for name in EXTREMES),
            *astuple(lane_keeping(ego, request.road.lane_width)),
            pet,
        ),
    )


def finite(value: float) -> float | None:
    """None for values that a table cannot hold: not defined, or unbounded."""
    return value if math.isfinite(value) else None


_MEASURED = tuple(item.name for part in (CriticalityMeasures, LaneKeeping) for item in fields(part))


def _measures_in(data: bytes, people: Quantiles) -> dict[str, float | None]:
    """The result of `_measured` as fields of a case."""
    *numbers, pet = _NUMBERS.unpack(data)
    extremes = dict(zip(EXTREMES, numbers[_CRITICALITY:-_LANE], strict=True))
    found = zip(_MEASURED, numbers[:_CRITICALITY] + numbers[-_LANE:], strict=True)
    return {
        **{name: finite(value) for name, value in found},
        "plausibility": plausibility(extremes, people),
        "conflict_pet": finite(pet),
    }
