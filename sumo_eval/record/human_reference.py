"""Comparisons with each concrete scenario's drivers: D_i of the ADSs, the drivers' own band, D_i
with one left out.

All three need the trajectory fields of the same drives, so the comparisons at one point are one
job. `scoring.likeness` requests the jobs; processes read the drives from the store and compute
them.

The results depend on the recorded drives, the road, the settings and this package's code. A run's
folder keeps them under a hash of these (`record.kept_results`). Scoring, explaining or comparing
the run again reads them there, and scoring that was stopped continues where it was.

Users: `evaluation.py`, `scoring/confidence/drivers.py`, `scoring/drive_beside.py`,
`scoring/likeness.py`, `scoring/steps.py`.
"""

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple, Self

from sumo_eval.coded import decoded, encoded
from sumo_eval.frozen import frozen
from sumo_eval.method.anthropomorphic import (
    AnthropomorphicIndex,
    Ingredients,
    Likeness,
    Pairing,
    indexes_by_group,
)
from sumo_eval.method.index_terms import IndexNote
from sumo_eval.record.fingerprint import sources
from sumo_eval.record.kept_results import KeptPart, KeptResults, Kind, key_of
from sumo_eval.record.spread import Spread, spread_over
from sumo_eval.record.store import Store, open_store
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings

_CHUNK = 2  # points that a process receives at once
_KEPT_AT_ONCE = 32  # new results that are written together, and lost if scoring is stopped before
_WORTH_PROCESSES = 160  # human drives; results of fewer are computed before processes have started


Name = tuple[Kind, str | tuple[str, ...]]
"""Name of a result: its kind and owner. D_i (`index`) and D_i with drivers left out or exchanged
(`left_out`) belong to a case, a `band` to the drivers' cases at a point."""


@frozen
class PointJob:
    """Requested results at one point.

    drivers: the human drivers' cases at the point that may be compared with: those that ended "ok"
        (`scoring/likeness.py` chooses them).
    ads: the cases that get a D_i.
    left_out: ADSs' cases that get a D_i without each driver in turn, and for each of `exchanges`.
    band: whether each driver gets a D_i against all other drivers.
    exchanges: pairs of places in `drivers`: the driver that is left out, and the driver that counts
        twice instead.
    """

    drivers: tuple[str, ...]
    road: Road
    ads: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    band: bool = False
    exchanges: tuple[tuple[int, int], ...] = ()

    @property
    def names(self) -> list[Name]:
        """Names of the requested results."""
        of_cases: list[Name] = [("index", case) for case in self.ads]
        of_cases += [("left_out", case) for case in self.left_out]
        return [*of_cases, ("band", self.drivers)] if self.band else of_cases


@frozen
class Varied:
    """A value of a case, compared with different sets of drivers.

    everyone: all drivers.
    without: all but one, for each driver in their order; empty where there are only two drivers.
    exchanged: mean over the exchanges of one driver for another; `everyone` without exchanges.
    """

    everyone: float
    without: tuple[float, ...]
    exchanged: float

    @classmethod
    def of(cls, values: Sequence[float], drivers: int) -> Self:
        """From the values for the sets of `_left_out`: all drivers, all but one, exchanges."""
        first = 1 + drivers  # place of the first exchange
        # `or`: without exchanges, the mean of everyone alone
        return cls(values[0], tuple(values[1:first]), fmean(values[first:] or values[:1]))


@frozen
class LeftOut:
    """Results of leaving out drivers, on coarse slices.

    index: D_i.
    likeness: f_L * f_n+ * similarity, which is the human-likeness of the case without the factor of
        its plausibility.
    """

    index: Varied
    likeness: Varied


class PointResults(NamedTuple):
    """Results at some points.

    indexes: D_i by case.
    left_out: by case.
    bands: D_i of each driver against all other drivers, by the drivers' cases at a point.
    """

    indexes: dict[str, AnthropomorphicIndex]
    left_out: dict[str, LeftOut]
    bands: dict[tuple[str, ...], tuple[float, ...]]


_RECORDS = {
    kind.__name__: kind
    for kind in (AnthropomorphicIndex, IndexNote, Ingredients, Likeness, LeftOut, Varied)
}
"""Classes of the records that are kept, by name, for `decoded`."""


def point_processes(store: Store, workers: int) -> AbstractContextManager[Spread]:
    """Context with a function that spreads the points of a run over processes, for
    `compute_points`, or computes them here if they are few.
    """
    drives = sum(count.drives for count in store.counts() if count.role == "human")
    return spread_over(workers if drives >= _WORTH_PROCESSES else 1)


def compute_points(
    run: Path,
    jobs: Sequence[PointJob],
    settings: AnthropomorphicSettings,
    spread: Spread,
    progress: Callable[[int], None],
    cache: KeptResults,
) -> PointResults:
    """The results of all jobs.

    run: folder whose facts have the drives.
    spread: `map` or that of `point_processes`.
    progress: receives the number of jobs that are done.
    cache: of the run's folder, where results are looked up and put.
    """
    keys = _keys(run, jobs, settings)
    # results in their kept form, by name; `name[0]` is the kind of result
    results: dict[Name, bytes] = {
        name: data for name, key in keys.items() if (data := cache.get(name[0], key)) is not None
    }
    wanted = [(job, [name for name in job.names if name not in results]) for job in jobs]
    missing = [(job, names) for job, names in wanted if names]
    chunks = [
        (run, missing[first : first + _CHUNK], settings) for first in range(0, len(missing), _CHUNK)
    ]
    done = len(jobs) - len(missing)
    new = list[KeptPart]()
    for computed in spread(_compute_chunk, chunks):
        results |= computed
        # a result is one part of the cache, so its place is 0
        new += [(name[0], keys[name], 0, data) for name, data in computed.items()]
        done = min(done + _CHUNK, len(jobs))
        if len(new) >= _KEPT_AT_ONCE or done == len(jobs):
            cache.put(new)
            new = []
        progress(done)
    if jobs and not missing:  # the cache had every result
        progress(done)
    return _decoded(results)


def _decoded(results: Mapping[Name, bytes]) -> PointResults:
    """Results from their kept form. New results are decoded like kept ones, so that both are equal
    to the bit.
    """
    records: dict[Kind, dict[Any, Any]] = {"index": {}, "left_out": {}, "band": {}}
    for (kind, owner), data in results.items():
        records[kind][owner] = decoded(data, _RECORDS)
    return PointResults(records["index"], records["left_out"], records["band"])


# --- what is kept ---------------------------------------------------------------------------------


def _keys(
    run: Path, jobs: Sequence[PointJob], settings: AnthropomorphicSettings
) -> dict[Name, bytes]:
    """The key of each result in the cache: a hash of all that it depends on."""
    keys: dict[Name, bytes] = {}
    # rooms whose code reads the drives, compares them and keeps the results
    code = sources("method", "record", "scenario", "settings")
    with open_store(run) as store:
        hash_of = functools.cache(store.case_hash)  # a driver occurs in several jobs
        for job in jobs:
            common = key_of(job.road, settings, list(map(hash_of, job.drivers)), code)
            for kind, owner in job.names:
                own = hash_of(owner) if isinstance(owner, str) else b""
                exchanges = job.exchanges if kind == "left_out" else ()
                keys[kind, owner] = key_of(common, kind, own, exchanges)
    return keys


# --- computing ------------------------------------------------------------------------------------


def _compute_chunk(
    chunk: tuple[Path, Sequence[tuple[PointJob, Sequence[Name]]], AnthropomorphicSettings],
) -> dict[Name, bytes]:
    """The missing results of some jobs, encoded. Runs in a process of its own.

    chunk: folder of the run; each job with the names of its missing results; the settings.
    """
    run, jobs, settings = chunk
    with open_store(run, checked=True) as store:  # `_keys` has checked the file
        return {
            name: encoded(record)
            for job, names in jobs
            for name, record in compute_point(job, names, store, settings)
        }


def compute_point(
    job: PointJob, names: Sequence[Name], store: Store, settings: AnthropomorphicSettings
) -> Iterator[tuple[Name, object]]:
    """Each of the names with its result."""
    owners = [owner for _, owner in names if isinstance(owner, str)]
    cases = list(dict.fromkeys((*job.drivers, *owners)))
    place = {case: number for number, case in enumerate(cases)}
    drivers = tuple(place[case] for case in job.drivers)

    def pairings(kind: Kind, owner: Any) -> list[Pairing]:
        """The comparisons behind a result."""
        if kind == "band":
            return band_pairings(drivers, settings)
        if kind == "index":
            return [Pairing(place[owner], drivers, settings.slice_spacing, likeness=True)]
        sets = _left_out(drivers, job.exchanges)
        return [Pairing(place[owner], own, _coarse(settings), likeness=True) for own in sets]

    # Each result is a group of its own, so that it is the same to the last bit whatever else is
    # computed.
    trajectories = [store.trajectory(case) for case in cases]
    groups = [pairings(*name) for name in names]
    indexes = indexes_by_group(trajectories, groups, job.road, settings)
    for name, group in zip(names, indexes, strict=True):
        values = tuple(index.value for index in group)
        if name[0] == "index":
            yield name, group[0]
        elif name[0] == "band":
            yield name, values
        else:
            # `if`: for the type checker; every pairing of `_left_out` asks for the likeness
            likeness = [index.likeness.value for index in group if index.likeness]
            yield name, LeftOut(*(Varied.of(it, len(drivers)) for it in (values, likeness)))


def band_pairings(drivers: Sequence[int], settings: AnthropomorphicSettings) -> list[Pairing]:
    """Each driver against all other drivers: the comparisons behind the human band."""
    others = zip(drivers, _all_but_one(drivers), strict=True)
    return [Pairing(driver, rest, _coarse(settings)) for driver, rest in others]


def _left_out(
    drivers: tuple[int, ...], exchanges: Sequence[tuple[int, int]]
) -> list[tuple[int, ...]]:
    """All drivers. With more than two, also all but one, for each driver, and then all with one
    counted twice instead of another, for each exchange.

    Comparing an ADS with each of these measures the effect of the choice of drivers on its D_i and
    its human-likeness.
    """
    if len(drivers) <= 2:
        return [drivers]
    fewer = _all_but_one(drivers)
    # sorted: sums in this order have the same last bits whichever driver counts twice
    exchanged = (tuple(sorted((*fewer[out], drivers[twice]))) for out, twice in exchanges)
    return [drivers, *fewer, *exchanged]


def _all_but_one(drivers: Sequence[int]) -> list[tuple[int, ...]]:
    """For each driver, all others."""
    return [tuple(other for other in drivers if other != without) for without in drivers]


def _coarse(settings: AnthropomorphicSettings) -> float:
    """Distance between slices where drivers are scored against each other, or left out, m."""
    return max(settings.slice_spacing, settings.band_slice_spacing)
