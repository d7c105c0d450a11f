"""Anthropomorphic indexes of many cases, read from the store and spread over processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sumo_eval.batch.spread import spread
from sumo_eval.batch.store import open_store
from sumo_eval.method.anthropomorphic import AnthropomorphicIndex, anthropomorphic_index
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings

_CHUNK = 4
_WORTH_PROCESSES = 24  # fewer indexes than this are done sooner than processes start


@dataclass(frozen=True, slots=True)
class IndexJob:
    """One D_i to compute: the ADS's case and the drivers' cases at the same point."""

    case: str
    drivers: tuple[str, ...]
    road: Road


def compute_indexes(
    facts: Path,
    jobs: Sequence[IndexJob],
    settings: AnthropomorphicSettings,
    workers: int,
    progress: Callable[[int], None],
) -> list[AnthropomorphicIndex]:
    """D_i of every job, in order. `progress` is told how many are done."""
    parts = [(facts, jobs[start : start + _CHUNK], settings) for start in range(0, len(jobs), _CHUNK)]
    results: list[AnthropomorphicIndex] = []
    for part in spread(_compute_part, parts, workers if len(jobs) >= _WORTH_PROCESSES else 1):
        results += part
        progress(len(results))
    return results


def _compute_part(
    part: tuple[Path, Sequence[IndexJob], AnthropomorphicSettings],
) -> list[AnthropomorphicIndex]:
    facts, jobs, settings = part
    with open_store(facts) as store:
        return [
            anthropomorphic_index(
                store.trajectory(job.case), [store.trajectory(driver) for driver in job.drivers], job.road, settings
            )
            for job in jobs
        ]
