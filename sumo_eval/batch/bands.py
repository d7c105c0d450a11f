"""Leave-one-driver-out bands of many concrete scenarios, read from the store and spread over processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from sumo_eval.batch.children import child_context
from sumo_eval.batch.store import open_store
from sumo_eval.method.leave_one_out import HumanBand, human_band
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings

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
    chunks = [(facts, jobs[start : start + _CHUNK], settings) for start in range(0, len(jobs), _CHUNK)]
    results: list[HumanBand] = []
    if workers == 1 or len(jobs) < _WORTH_PROCESSES:
        for chunk in chunks:
            results += _compute_chunk(chunk)
            progress(len(results))
        return results
    with ProcessPoolExecutor(workers, mp_context=child_context()) as pool:
        for part in pool.map(_compute_chunk, chunks):
            results += part
            progress(len(results))
    return results


def _compute_chunk(chunk: tuple[Path, Sequence[BandJob], AnthropomorphicSettings]) -> list[HumanBand]:
    facts, jobs, settings = chunk
    with open_store(facts) as store:
        return [human_band([store.trajectory(case) for case in job.drivers], job.road, settings) for job in jobs]
