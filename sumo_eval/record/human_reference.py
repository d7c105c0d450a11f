"""What the drivers of each concrete scenario tell: D_i of the ADSs, the drivers' own band, D_i with a driver left out.

All three need the fields of the same drives, so a point is one piece of work. Points are read from the store and spread
over processes.

The band and the indexes with a driver left out depend on the recorded drives and the settings alone, so a run's folder
keeps what has been computed in `bands.json`: scoring, explaining or comparing a run again reads it there. It may be
deleted.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import islice
from pathlib import Path

import sumo_eval.method
from sumo_eval.errors import InputError
from sumo_eval.method.anthropomorphic import AnthropomorphicIndex, Pairing, indexes_by_group
from sumo_eval.method.leave_one_out import HumanBand, band_of, band_pairings, left_out_pairings
from sumo_eval.method.shared_fields import prepare
from sumo_eval.record.sealed import read_sealed, sealed
from sumo_eval.record.spread import Spread, beside, spread_over
from sumo_eval.record.store import Store, open_store
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings
from sumo_eval.text import words_of

KEPT = "bands.json"
_MEND = "It may be deleted: what it holds is computed again from the recorded drives."
_CHUNK = 2
_WORTH_PROCESSES = 160  # fewer drives of drivers than this are done sooner than processes start


@dataclass(frozen=True, slots=True)
class PointJob:
    """What is wanted at one point. drivers: their cases. ads: the cases that get a D_i. left_out: the ADSs' cases that
    get one with each driver left out. band: whether the drivers are scored against each other.
    """

    drivers: tuple[str, ...]
    road: Road
    ads: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    band: bool = False


@dataclass(frozen=True, slots=True)
class LeftOut:
    """D_i of a case on coarse slices against all drivers, and without each of them in their order; `without` is empty
    where only two drivers are there. likeness, likeness_without: likewise f_L * f_n+ * similarity of its
    human-likeness, which leaves out its plausibility.
    """

    everyone: float
    without: tuple[float, ...]
    likeness: float
    likeness_without: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class PointResult:
    """What was found at one point, by case."""

    indexes: Mapping[str, AnthropomorphicIndex]
    left_out: Mapping[str, LeftOut]
    band: HumanBand | None


@contextmanager
def prepared_meanwhile() -> Iterator[None]:
    """On a machine's first time a process of its own compiles what scoring needs; later there is nothing to do."""
    source = Path(sumo_eval.method.__file__).with_name("field_loops.py")
    kept = source.parent.glob("__pycache__/field_loops.*.nbi")
    if any(index.stat().st_mtime >= source.stat().st_mtime for index in kept):
        yield
        return
    with beside(prepare):
        yield


@contextmanager
def point_processes(store: Store, workers: int) -> Iterator[Spread]:
    """Where `compute_points` may spread the points of a run: as many processes, if it has enough of them."""
    drives = sum(number for _, role, _, _, number, _ in store.counts() if role == "human")
    with spread_over(workers if drives >= _WORTH_PROCESSES else 1, prepare) as spread:
        yield spread


def compute_points(
    facts: Path,
    jobs: Sequence[PointJob],
    settings: AnthropomorphicSettings,
    spread: Spread,
    progress: Callable[[int], None],
) -> list[PointResult]:
    """The results of every job, in order. spread: `map` or that of `point_processes`. `progress` is told how many are
    done.
    """
    keys = _keys(facts, jobs, settings)
    bands, left_out = _read(facts.parent / KEPT)
    todo = [
        replace(
            job,
            left_out=tuple(case for case in job.left_out if known[case] not in left_out),
            band=job.band and known[""] not in bands,
        )
        for job, known in zip(jobs, keys, strict=True)
    ]
    work = [place for place, job in enumerate(todo) if job.ads or job.left_out or job.band]
    found: list[PointResult] = []
    if work:
        parts = [
            (facts, [todo[n] for n in work[first : first + _CHUNK]], settings) for first in range(0, len(work), _CHUNK)
        ]
        for part in spread(_compute_part, parts):
            found += part
            progress(len(jobs) - len(work) + len(found))
    elif jobs:
        progress(len(jobs))
    computed = dict(zip(work, found, strict=True))
    new = False
    for place, result in computed.items():
        for case, values in result.left_out.items():
            left_out[keys[place][case]], new = values, True
        if result.band is not None:
            bands[keys[place][""]], new = result.band, True
    if new:
        _write(facts.parent / KEPT, bands, left_out)
    return [
        PointResult(
            computed[place].indexes if place in computed else {},
            {case: left_out[known[case]] for case in job.left_out},
            bands[known[""]] if job.band else None,
        )
        for place, (job, known) in enumerate(zip(jobs, keys, strict=True))
    ]


# --- what is kept -----------------------------------------------------------------------------------------------------


def _keys(facts: Path, jobs: Sequence[PointJob], settings: AnthropomorphicSettings) -> list[dict[str, str]]:
    """Under what each job's band ("") and each of its left-out cases are kept."""
    with open_store(facts) as store:
        digest = cache(store.case_digest)

        def key(job: PointJob, *ads: str) -> str:
            cases = tuple(digest(case) for case in (*ads, *job.drivers))
            return hashlib.sha256(repr((job.road, settings, cases, len(ads), _method())).encode()).hexdigest()

        return [({"": key(job)} if job.band else {}) | {case: key(job, case) for case in job.left_out} for job in jobs]


@cache
def _method() -> str:
    """A hash of the method's own source: what another version computed is not taken over."""
    files = sorted(Path(sumo_eval.method.__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _read(path: Path) -> tuple[dict[str, HumanBand], dict[str, LeftOut]]:
    """What is kept; nothing where there is no file. Raises InputError for one that is not as it was written."""
    try:
        content = read_sealed(path, _MEND)
    except OSError:
        return {}, {}
    try:
        bands = {
            key: HumanBand(tuple(band["values"]), tuple(band["similarities"])) for key, band in content["bands"].items()
        }
        left_out = {
            key: LeftOut(
                float(one["everyone"]), tuple(one["without"]), float(one["likeness"]), tuple(one["likeness_without"])
            )
            for key, one in content["left_out"].items()
        }
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} holds no drivers' bands: {words_of(error)}. {_MEND}") from error
    return bands, left_out


def _write(path: Path, bands: Mapping[str, HumanBand], left_out: Mapping[str, LeftOut]) -> None:
    """In one step; a folder that cannot be written costs the saving, not the scores."""
    half = path.with_name(f"{path.name}.{os.getpid()}.half")
    content = {
        "bands": {key: asdict(band) for key, band in bands.items()},
        "left_out": {key: asdict(one) for key, one in left_out.items()},
    }
    with suppress(OSError):
        half.write_text(sealed(content), encoding="utf-8")
        half.replace(path)


# --- computing --------------------------------------------------------------------------------------------------------


def _compute_part(part: tuple[Path, Sequence[PointJob], AnthropomorphicSettings]) -> list[PointResult]:
    facts, jobs, settings = part
    with open_store(facts, checked=True) as store:
        return [_compute(job, store, settings) for job in jobs]


def _compute(job: PointJob, store: Store, settings: AnthropomorphicSettings) -> PointResult:
    cases = list(dict.fromkeys((*job.drivers, *job.ads, *job.left_out)))
    place = {case: number for number, case in enumerate(cases)}
    drivers = [place[case] for case in job.drivers]
    judged = [[Pairing(place[case], tuple(drivers), settings.slice_spacing, likeness=True)] for case in job.ads]
    among = band_pairings(drivers, settings) if job.band else []
    without = {case: left_out_pairings(place[case], drivers, settings) for case in job.left_out}
    trajectories = [store.trajectory(case) for case in cases]
    # Each ADS apart, so that what is found of it is the same to the last bit whoever else is judged.
    found = iter(indexes_by_group(trajectories, [*judged, among, *without.values()], job.road, settings))
    indexes = {case: index for case, (index,) in zip(job.ads, islice(found, len(judged)), strict=True)}
    band = next(found)
    return PointResult(
        indexes=indexes,
        band=band_of(band) if job.band else None,
        left_out={
            case: LeftOut(
                everyone.value, tuple(index.value for index in fewer), _likeness(everyone), tuple(map(_likeness, fewer))
            )
            for case, (everyone, *fewer) in zip(without, found, strict=True)
        },
    )


def _likeness(index: AnthropomorphicIndex) -> float:
    assert index.likeness is not None, "left-out pairings ask for it"
    return index.likeness.value
