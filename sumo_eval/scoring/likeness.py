"""Comparison of each safe case with the human drivers at its point: D_i of the case, D_i of each
driver among the other drivers (the band), and the fields of the case's row.

`steps.py` calls `survey` once for a scenario, then `compare_with_people` for some points at a time.
`quantities.py` then makes the rows.

Users: `scoring/quantities.py`, `scoring/steps.py`. Fixed: names of the fields, which are columns of
cases.csv; the order of points and cases, so that sums keep their bits.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import EVALUATED, ThinReference, Zone
from sumo_eval.errors import InputError
from sumo_eval.groups import evenly_spread, grouped
from sumo_eval.method.collision_avoidance import collision_weight
from sumo_eval.method.manoeuvres import words
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.human_reference import LeftOut, PointJob, PointResults, compute_points
from sumo_eval.record.kept_results import key_of
from sumo_eval.record.store import RECORDED
from sumo_eval.scenario.sampling.samples import Sample, sample_of
from sumo_eval.score_notes import Counted, ScoreNote, ThinReferences
from sumo_eval.scoring.confidence.drivers import exchanges
from sumo_eval.scoring.space import ScenarioRun
from sumo_eval.settings import DriverSettings
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

FEWEST_DRIVERS = 2  # a standard deviation needs two
FEWEST_FOR_A_BAND = 3  # drivers; two must remain when one is compared with the rest
_AT_ONCE = 8_192  # points whose zone and weight are computed at a time; 65,536 would need 0.3 GB
# most cases of an ADS in a scenario for which D_i is computed again without each driver
JACKKNIFED = 16


RowFields = dict[str, Any]
"""Fields of a case's row, by name."""


class PointReference(NamedTuple):
    """The human drivers of one concrete scenario, whose drives ended with status `ok`.

    cases: keys of their cases.
    drivers: who drove each, in the same order: one name for one person at all points.
    recorded: number of recorded drivers among them.
    note: note on too few recorded drivers; None: there are enough.
    usable: whether a D_i may be computed from these drivers.
    """

    cases: tuple[str, ...]
    drivers: tuple[str, ...]
    recorded: int
    note: ThinReference | None
    usable: bool


def references(drives: Iterable[Fact], settings: DriverSettings) -> dict[int, PointReference]:
    """Point -> its human drivers, for every point that has any.

    drives: of all drivers.
    """
    by_point = grouped((fact.point, fact) for fact in drives if fact.status == "ok")
    result = {}
    for point, facts in by_point.items():
        recorded = sum(fact.controller == RECORDED for fact in facts)
        cases, drivers = zip(*((fact.case, _person(fact)) for fact in facts), strict=True)
        result[point] = PointReference(
            cases, drivers, recorded, *_usable(len(facts), recorded, settings)
        )
    return result


def _person(fact: Fact) -> str:
    """The name of the person who drove, the same at every point."""
    # `driver` numbers the recorded drives of a point, `log` has the name in the recordings
    return f"{RECORDED} {fact.log}" if fact.controller == RECORDED else fact.driver


def _usable(
    drivers: int, recorded: int, settings: DriverSettings
) -> tuple[ThinReference | None, bool]:
    """A note on too few recorded drivers at a point, and whether a D_i may be computed there.

    drivers: number of drivers.
    recorded: number of recorded drivers among them.
    settings: `[drivers]`: its `source`; where that is `recorded`, also `least`, the number of
        recorded drivers that is enough, and `too_thin`, whether synthetic ones fill up.
    """
    enough = drivers >= FEWEST_DRIVERS
    if settings.source != RECORDED or recorded >= settings.least:
        return None, enough
    usable = enough and settings.too_thin == "fill"
    synthetic = drivers - recorded if usable else None
    return ThinReference(recorded, settings.least, synthetic), usable


class Survey(NamedTuple):
    """All points of a scenario of a run, looked at before its cases are scored some points at a
    time.

    hazardous: whether each point is hazardous, (points,).
    weights: r of each point, times the number of points that it stands for, (points,).
    points: values of the parameters, (points, k), nan where no case was driven.
    people: whether ADSs can be compared with human drivers.
    driven: ADS -> numbers of the points of its cases, in the order of the cases.
    left_out: ADS -> points at which D_i of its case is computed again without each driver, and
        with one driver in place of another.
    """

    hazardous: BoolArray
    weights: FloatArray
    points: FloatArray
    people: bool
    driven: Mapping[str, IntArray]
    left_out: Mapping[str, frozenset[int]]


def as_driven(chosen: Sample, driven: FloatArray, *, whole: bool) -> Sample:
    """The sample of a run: the points that the settings choose now, if these were driven. If not
    (a file of points, or of the scenario, has changed), the points that were driven.

    chosen: the points that the settings choose now.
    driven: values of points 0 to n - 1, (n, k), nan where no case was driven.
    whole: whether all points of the sample must have been driven.
    """
    is_driven = ~np.isnan(driven[:, 0])
    spare = len(chosen.points) - len(driven)  # chosen points after the last one that was driven
    if (spare == 0 or (spare > 0 and not whole)) and np.array_equal(
        chosen.points[: len(driven)][is_driven], driven[is_driven]
    ):
        return chosen
    # a point without a drive gets the values of the first driven one: parameters keep their ranges
    driven_sample = sample_of(
        np.where(is_driven[:, None], driven, driven[is_driven][0]), chosen.method
    )
    if not len(chosen.points):  # the notes say why nothing can be chosen now
        return replace(driven_sample, notes=chosen.notes)
    if spare != 0:
        return driven_sample
    # as many points as before: an adaptive sample gives these by number, wherever the points lie
    return replace(driven_sample, stands_for=chosen.stands_for, stratum=chosen.stratum)


def survey(space: ScenarioRun, zones: ZonePartition, zones_key: bytes) -> Survey:
    """Find zone and weight of all points of a scenario, and the points of each ADS's cases.

    zones: of the scenario.
    zones_key: a hash of all that the zones depend on.

    Raises InputError for an ADS without a case.
    """
    numbers, values = _driven_points(space)
    count = int(numbers.max(initial=-1)) + 1  # of points
    hazardous, weights = np.zeros(count, np.bool_), np.zeros(count)
    hazardous[numbers], weights[numbers] = _zones_and_weights(space, zones, zones_key, values)
    if space.points.stands_for is not None:
        weights = weights * space.points.stands_for[:count]
    usable = np.zeros(count, np.bool_)  # whether a point has enough drivers for a D_i
    any_drivers = False
    for point, drivers, recorded in space.store.drivers_at_points(space.name):
        usable[point] = _usable(drivers, recorded, space.settings.drivers)[1]
        any_drivers = True

    driven, with_index = _points_of_ads(space, usable & ~hazardous)
    all_values = np.full((count, values.shape[1]), np.nan)
    all_values[numbers] = values
    return Survey(
        hazardous,
        weights,
        all_values,
        space.logical.has_drivers or any_drivers,
        {name: np.array(of_ads, np.intp) for name, of_ads in driven.items()},
        {name: jackknifed(of_ads) for name, of_ads in with_index.items()},
    )


def _zones_and_weights(
    space: ScenarioRun, zones: ZonePartition, zones_key: bytes, values: FloatArray
) -> tuple[BoolArray, FloatArray]:
    """Whether each point is hazardous, and its weight r (Eq. 16), (n,) each, cached or computed.

    zones_key: a hash of all that the zones depend on.
    values: of the points, (n, k), in the parameters' units.
    """
    hazardous, weights = np.zeros(len(values), np.bool_), np.zeros(len(values))
    for first in range(0, len(values), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        points = values[part]
        key = key_of("weights", zones_key, points.tobytes())
        data = space.cache.get("weights", key)
        if data is None:
            both = zones.exactly_hazardous(points), collision_weight(points, zones)
            data = np.stack(both).tobytes()  # two rows of floats; 1: hazardous, 0: safe
            space.cache.put([("weights", key, 0, data)])
        zone, weights[part] = np.frombuffer(data).reshape(2, -1)
        hazardous[part] = zone > 0.0
        space.progress(
            f"{space.name}: weights of the points", min(part.stop, len(values)), len(values)
        )
    return hazardous, weights


def _driven_points(space: ScenarioRun) -> tuple[IntArray, FloatArray]:
    """Numbers of the points that were driven, (n,), and their values, (n, k).

    Raises InputError if the scenario had other parameters when it was driven.
    """
    names = space.logical.names
    first = next(iter(space.store.facts("ideal", space.name)), None)
    if first is not None and set(first.values) != set(names):
        raise InputError(
            f"Scenario `{space.name}` of run {space.store.path.parent} was driven with the "
            f"parameters {', '.join(first.values)}, and has {', '.join(names)} now: restore "
            "its file, or run the evaluation again."
        )
    facts = space.store.facts("ideal", space.name)  # the ideal vehicle drives every point once
    rows = ((fact.point, *(fact.values[name] for name in names)) for fact in facts)
    # the type of one row; a table without a row has the right number of columns, too
    table = np.fromiter(rows, np.dtype((np.float64, (1 + len(names),))))
    return table[:, 0].astype(np.intp), np.ascontiguousarray(table[:, 1:])


def _points_of_ads(
    space: ScenarioRun, comparable: BoolArray
) -> tuple[dict[str, array[int]], dict[str, array[int]]]:
    """ADS -> points of its cases; and ADS -> points of those cases that may have a D_i.

    comparable: whether a point is safe and has enough drivers, (points,).

    Raises InputError for an ADS without a case.
    """
    # arrays of 8-byte integers, because a run may have millions of cases
    driven: dict[str, array[int]] = {ads.name: array("q") for ads in space.settings.ads}
    with_index = {name: array("q") for name in driven}
    for point, name, status, hit in space.store.outcomes("ads", space.name):
        if name in driven:
            driven[name].append(point)
            if not hit and comparable[point] and status in EVALUATED:
                with_index[name].append(point)
    for name, points in driven.items():
        if not points:
            raise InputError(
                f"Run {space.store.path.parent} holds no case of ADS `{name}` in scenario "
                f"`{space.name}`."
            )
    return driven, with_index


class DriverComparison(NamedTuple):
    """Cases compared with the human drivers at their points.

    references: point -> the drivers there.
    results: D_i of the cases, and bands of the drivers.
    left_out: case -> its D_i without each driver and with one in place of another, and the drivers'
        names, for some cases.
    """

    references: Mapping[int, PointReference]
    results: PointResults
    left_out: dict[str, tuple[LeftOut, Sequence[str]]]


def compare_with_people(
    space: ScenarioRun,
    overview: Survey,
    points: range,
    people: Sequence[Fact],
    drives: Mapping[str, Sequence[Fact]],
) -> DriverComparison:
    """Eqs. 9-12: D_i of every evaluated safe case without a collision at a point with enough
    drivers, and D_i of the drivers there.

    overview: zones, and the points at which drivers are left out.
    points: numbers of the points.
    people: drives of the human drivers at these points.
    drives: ADS -> its drives at these points.
    """
    settings = space.settings
    compared = references(people, settings.drivers)
    # point -> cases of all ADSs that may have a D_i
    cases = grouped(
        (fact.point, fact)
        for fact in chain.from_iterable(drives.values())
        if fact.collision is None
        and fact.status in EVALUATED
        and not overview.hazardous[fact.point]
    )
    jobs = []
    drivers_of: dict[str, Sequence[str]] = {}  # case for which drivers are left out -> drivers
    for point in sorted(point for point, reference in compared.items() if reference.usable):
        reference, own = compared[point], cases.get(point, [])
        # `driver` of a case is the name of its ADS
        left_out = [fact.case for fact in own if point in overview.left_out[fact.driver]]
        drivers_of |= dict.fromkeys(left_out, reference.drivers)
        jobs.append(
            PointJob(
                reference.cases,
                space.logical.road,
                tuple(fact.case for fact in own),
                tuple(left_out),
                band=len(reference.cases) >= FEWEST_FOR_A_BAND,
                exchanges=exchanges(reference.drivers, settings.drivers, settings.seed),
            )
        )

    def progress(done: int) -> None:
        """Report a number of finished jobs as a number of finished points."""
        of_these = round(done / len(jobs) * len(points))
        space.progress(
            f"{space.name}: comparison with the drivers",
            points.start + of_these,
            len(overview.weights),
        )

    results = compute_points(
        space.store.path.parent,
        jobs,
        settings.method.anthropomorphic,
        space.spread,
        progress,
        space.cache,
    )
    varied = {case: (results.left_out[case], names) for case, names in drivers_of.items()}
    return DriverComparison(compared, results, varied)


def jackknifed(points: Sequence[int]) -> frozenset[int]:
    """At most `JACKKNIFED` of the points, evenly spread over their list."""
    return frozenset(evenly_spread(points, JACKKNIFED))


def beside_people(
    fact: Fact, zone: Zone, people: DriverComparison, settings: DriverSettings
) -> RowFields:
    """Fields of a case's row on its D_i and its human drivers; none in the hazardous zone.

    people: comparison with the drivers.
    settings: `[drivers]`.
    """
    if zone == "hazardous":
        return {}
    note, _ = _usable(0, 0, settings)
    no_drivers = PointReference((), (), 0, note, usable=False)
    reference = people.references.get(fact.point, no_drivers)
    row: RowFields = {
        "drivers": len(reference.cases),
        "recorded_drivers": reference.recorded,
        "reference_note": reference.note,
    }
    if (index := people.results.indexes.get(fact.case)) is not None:
        for name in ("length_factor", "operation_factor", "similarity"):
            row[name] = getattr(index, name)
        row |= {
            "index": index.value,
            "index_note": index.notes,
            "bimodal": any(note.kind == "two_groups" for note in index.notes),
        }
        if index.manoeuvre:
            row |= {"manoeuvre": words(index.manoeuvre), "manoeuvre_share": index.share}
        if index.likeness is not None:
            row |= asdict(index.likeness)
    if (band := people.results.bands.get(reference.cases)) is not None:
        row |= {"human_low": min(band), "human_mean": float(np.mean(band)), "human_high": max(band)}
    return row


def reference_notes(cases: CaseTable) -> Iterator[ScoreNote]:
    """Notes on too few recorded drivers, and on cases outside the support of the exposure, of one
    ADS in one scenario.
    """
    safe = cases.safe
    if thin := [note for note in cases.reference_note[safe] if note is not None]:
        left_out = sum(note.filled is None for note in thin)
        yield ThinReferences(len(thin), int(safe.sum()), left_out)
    if outside := int(np.count_nonzero(cases.exposure_note != "")):
        yield Counted("outside_support", outside, len(cases))
