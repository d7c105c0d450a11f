"""Results of each recorded drive: its departure and t_i (share of the driving task done). In an
evaluated case also its measures: criticality, plausibility, lane keeping, PET. The equations are in
`method/`.

A result depends on recorded trajectories alone. So it is kept in the cache of the run's folder.
Results that are not there are computed point by point, in the processes that compute D_i.

Users: `report/page_data.py`, `scoring/quantities.py`, `scoring/steps.py`. Fixed: the keys must name
all that a result depends on.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, fields
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_eval.cases import EVALUATED
from sumo_eval.coded import decoded, encoded
from sumo_eval.frozen import frozen
from sumo_eval.groups import grouped
from sumo_eval.method.conflict import conflicting
from sumo_eval.method.driving_task import (
    Departure,
    asked_way,
    clean_references,
    first_departure,
    is_excused,
    task_share,
)
from sumo_eval.method.measures import (
    CriticalityMeasures,
    LaneKeeping,
    conflict_pet,
    course_of,
    lane_keeping,
    measures,
)
from sumo_eval.method.plausibility import EXTREMES, Quantiles, extremes_of, plausibility
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.fingerprint import sources, space_key
from sumo_eval.record.kept_results import key_of
from sumo_eval.record.store import EGO, Store, open_store
from sumo_eval.scenario.concrete import Road, Way
from sumo_eval.scoring.space import ScenarioRun
from sumo_eval.trajectory import FloatArray, Trajectories, Trajectory

_AT_ONCE = 16  # points that a process computes before it returns them
# fields of a case, in the order in which `DriveResult.numbers` begins
_MEASURED = (
    *(item.name for part in (CriticalityMeasures, LaneKeeping) for item in fields(part)),
    "conflict_pet",
)


@frozen(eq=False)
class DriveResult:
    """Result of one drive.

    departure: from the road; None if the drive stayed on it.
    share: t_i; None without a reference.
    excused: whether the ego stands because of a road user, so that t_i leaves out the places that
        the ego did not reach.
    numbers: criticality, lane keeping, PET of conflicting paths (`_MEASURED`), then `EXTREMES`.
        `_numbers` makes them, `measures` reads them. Empty except for an ADS's evaluated case.
    """

    departure: Departure | None
    share: float | None
    excused: bool
    numbers: FloatArray

    def measures(self, people: Quantiles) -> dict[str, float | None]:
        """The numbers as fields of a case, by name.

        people: table of people that the plausibility compares with.
        """
        if not len(self.numbers):
            return {}
        numbers = self.numbers.tolist()
        # strict=False: the extremes follow the measures
        row = {name: finite(value) for name, value in zip(_MEASURED, numbers, strict=False)}
        extremes = dict(zip(EXTREMES, numbers[len(_MEASURED) :], strict=True))
        return row | {"plausibility": plausibility(extremes, people)}


def finite(value: float) -> float | None:
    """The value, but None for one that a table cannot hold: not defined (nan), or unbounded."""
    return value if math.isfinite(value) else None


_UNDRIVEN = DriveResult(None, None, False, np.empty(0))  # result of a case without a drive
_RECORDS = {record.__name__: record for record in (DriveResult, Departure)}


class _Point(NamedTuple):
    """Job of a process: the drives at one point whose results are missing.

    drives: facts of these drives.
    references: keys of the cases of references that ended without contact.
    road: of the scenario.
    margin: how far a corner may be beyond the road (`road_margin`), m.
    begin: x of the ego's start, m.
    way: the lane change that the point asks for; None without one.
    conflicting: name of the actor whose path conflicts with the ego's; "": none.
    """

    drives: Sequence[Fact]
    references: Sequence[str]
    road: Road
    margin: float
    begin: float
    way: Way | None
    conflicting: str


def drive_results(
    drives: Sequence[Fact], references: Iterable[Fact], space: ScenarioRun
) -> dict[str, DriveResult]:
    """Case -> its result, for the cases at some points of a scenario, from the cache or computed in
    processes.

    drives: drives of the ADSs and of `no_reaction` at these points.
    references: drives of the drivers and of the reference car there.
    """
    logical, hash_of = space.logical, space.store.case_hash
    road, margin = logical.road, space.method.task.road_margin
    # all that the path of a conflicting actor may depend on: the scenario's files, and the code of
    # this package
    files = space.entry.use, space_key(space.entry, space.source)
    code = sources("method", "record", "scenario", "scoring", "settings")
    references_at = grouped((fact.point, fact.case) for fact in references if fact.status == "ok")
    results = {}  # case -> encoded result from the cache
    keys = {}  # case -> key in the cache
    points = []  # jobs
    # A case without an end, or with `sim_error`, has no drive. A case that the ADS gave up has
    # one, in which the ego may leave the road: it has a result.
    facts_at = grouped(
        (fact.point, fact) for fact in drives if fact.end_reason not in (None, "sim_error")
    )
    for number, facts in facts_at.items():
        others, concrete = references_at.get(number, []), logical.placed(facts[0].values)
        start = concrete.ego
        # a result depends on the point's references (this key) and on its own drive (`hash_of`)
        common = key_of(
            [hash_of(case) for case in others], road, margin, start.x, start.way, files, code
        )  # fmt: skip
        for fact in facts:
            keys[fact.case] = key_of(common, hash_of(fact.case))
            if (data := space.cache.get("drive", keys[fact.case])) is not None:
                results[fact.case] = data
        if missing := [fact for fact in facts if fact.case not in results]:
            other = conflicting(logical, concrete)
            name = "" if other is None else concrete.actors[other].name
            points.append(_Point(missing, others, road, margin, start.x, start.way, name))

    parts = [points[first : first + _AT_ONCE] for first in range(0, len(points), _AT_ONCE)]
    new: dict[str, bytes] = {}
    for part in space.spread(partial(_results, space.store.path.parent), parts):
        new |= part
    space.cache.put(("drive", keys[case], 0, data) for case, data in new.items())
    records = {case: decoded(data, _RECORDS) for case, data in (results | new).items()}
    return {fact.case: records.get(fact.case, _UNDRIVEN) for fact in drives}


def _results(run: Path, points: Sequence[_Point]) -> dict[str, bytes]:
    """Case -> encoded result, for the drives at some points. Runs in a process of its own.

    run: folder with the facts.
    """
    with open_store(run, checked=True) as store:
        return {
            case: encoded(result) for point in points for case, result in _results_at(point, store)
        }


def _results_at(point: _Point, store: Store) -> Iterator[tuple[str, DriveResult]]:
    """Each case at a point with its result."""
    references = (store.trajectory(case) for case in point.references)
    asked = asked_way(point.begin, clean_references(references, point.road, point.margin))
    for fact in point.drives:
        actors = store.trajectories(fact.case)
        if EGO not in actors:
            raise store.no_trajectory(fact.case)
        ego = actors.pop(EGO)
        departure = first_departure(ego, point.road, point.margin)
        share, excused = None, False
        if asked is not None:
            incident = fact.status == "collision" or departure is not None
            excused = not incident and is_excused(ego, actors) and any(asked.places > ego.x.max())
            share = task_share(ego, asked, point.way, incident=incident, excused=excused)
        evaluated = fact.role == "ads" and fact.status in EVALUATED
        numbers = _numbers(fact, point, ego, actors) if evaluated else []
        yield fact.case, DriveResult(departure, share, excused, np.array(numbers))


def _numbers(fact: Fact, point: _Point, ego: Trajectory, actors: Trajectories) -> list[float]:
    """The numbers of a `DriveResult`."""
    hit = fact.collision
    course = course_of(ego, actors, hit, point.road)
    pet = math.nan
    if point.conflicting in actors:
        contact = hit if hit is not None and hit.other == point.conflicting else None
        pet = conflict_pet(ego, actors[point.conflicting], contact)
    return [
        *astuple(measures(ego, actors, hit, course)),
        *astuple(lane_keeping(ego, point.road.lane_width)),
        pet,
        *extremes_of(course).values(),
    ]


def recorded_with(store: Store, car: str) -> bool:
    """Whether a run has the drive of this reference car at every point: as many as of the ideal
    vehicle, which drives every point.

    car: locator of the reference car.
    """
    counts = Counter[str]()
    for count in store.counts():
        counts[count.role] += count.drives
    first = next(store.facts("task_reference"), None)
    is_recorded = first is not None and first.controller == car
    return is_recorded and counts["ideal"] == counts["task_reference"]
