"""Leave-one-driver-out bands of many concrete scenarios, read from the store and spread over processes.

A band costs as much as ten D_i and depends on the recorded drives and the settings alone, so a run's folder keeps what
has been computed in `bands.json`: scoring, explaining or comparing a run again reads it there. It may be deleted.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import sumo_eval.method
from sumo_eval.batch.spread import spread
from sumo_eval.batch.store import open_store
from sumo_eval.method.leave_one_out import HumanBand, human_band
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings

KEPT = "bands.json"
_CHUNK = 4
_WORTH_PROCESSES = 16  # fewer bands than this are done sooner than processes start


@dataclass(frozen=True, slots=True)
class BandJob:
    """One band to compute: the drivers' cases at one point."""

    drivers: tuple[str, ...]
    road: Road


def compute_bands(
    facts: Path,
    jobs: Sequence[BandJob],
    settings: AnthropomorphicSettings,
    workers: int,
    progress: Callable[[int], None],
) -> list[HumanBand]:
    """The band of every job, in order. `progress` is told how many are done."""
    with open_store(facts) as store:
        digests = {case: store.case_digest(case) for job in jobs for case in job.drivers}
    keys = [_key(job, settings, [digests[case] for case in job.drivers]) for job in jobs]
    kept = _read(facts.parent / KEPT)
    missing = [job for job, key in zip(jobs, keys, strict=True) if key not in kept]
    done = len(jobs) - len(missing)
    if missing:
        parts = [(facts, missing[start : start + _CHUNK], settings) for start in range(0, len(missing), _CHUNK)]
        found: list[HumanBand] = []
        for part in spread(_compute_part, parts, workers if len(missing) >= _WORTH_PROCESSES else 1):
            found += part
            progress(done + len(found))
        new = iter(found)
        kept |= {key: next(new) for key in keys if key not in kept}
        _write(facts.parent / KEPT, kept)
    elif jobs:
        progress(done)
    return [kept[key] for key in keys]


def _key(job: BandJob, settings: AnthropomorphicSettings, digests: Sequence[str | None]) -> str:
    return hashlib.sha256(repr((job.road, settings, tuple(digests), _method())).encode()).hexdigest()


@cache
def _method() -> str:
    """A hash of the method's own source: bands of another version are not taken over."""
    files = sorted(Path(sumo_eval.method.__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _read(path: Path) -> dict[str, HumanBand]:
    """What is kept; nothing of a file that is missing or damaged, because everything in it can be computed again."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {key: HumanBand(tuple(band["values"]), tuple(band["similarities"])) for key, band in content.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _write(path: Path, kept: dict[str, HumanBand]) -> None:
    """In one step; a folder that cannot be written costs the saving, not the scores."""
    half = path.with_name(f"{path.name}.{os.getpid()}.half")
    with suppress(OSError):
        half.write_text(json.dumps({key: asdict(band) for key, band in kept.items()}), encoding="utf-8")
        half.replace(path)


def _compute_part(part: tuple[Path, Sequence[BandJob], AnthropomorphicSettings]) -> list[HumanBand]:
    facts, jobs, settings = part
    with open_store(facts) as store:
        return [human_band([store.trajectory(case) for case in job.drivers], job.road, settings) for job in jobs]
