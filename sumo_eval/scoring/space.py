"""One logical scenario of a run while it is scored: where each step finds what it needs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TypeVar

from sumo_eval.method.severity import Severity
from sumo_eval.record.cases import Role
from sumo_eval.record.kept_results import KeptResults, Kind
from sumo_eval.record.progress import Progress
from sumo_eval.record.spread import Spread
from sumo_eval.record.store import Fact, Store
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import Sample
from sumo_eval.settings import EvaluationSettings, MethodSettings, ScenarioSettings

Job = TypeVar("Job")


@dataclass(frozen=True, slots=True)
class ScenarioRun:
    """A logical scenario of a run, with its points and the run's facts.

    entry: the scenario in the evaluation.
    severity: U, or what stands for it.
    kept: earlier results of the run.
    spread: `map`, or that of `point_processes`.
    car: the reference car of T, "" where the run holds none.
    outside: numbers of the points outside the support of recorded events.
    """

    entry: ScenarioSettings
    logical: LogicalScenario
    points: Sample
    settings: EvaluationSettings
    source: Path
    severity: Severity
    store: Store
    kept: KeptResults
    spread: Spread
    progress: Progress
    car: str
    outside: frozenset[int]

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.logical.name

    @property
    def method(self) -> MethodSettings:
        """Settings of the method."""
        return self.settings.method

    def facts_at(self, points: range, role: Role) -> list[Fact]:
        """The recorded drives of a role at some points."""
        return self.store.facts_at(points, role, self.name)

    def results(
        self,
        kind: Kind,
        keys: Mapping[str, bytes],
        jobs_of: Callable[[Collection[str]], Sequence[Job]],
        work: Callable[[tuple[Path, Sequence[Job]]], Sequence[tuple[str, bytes]]],
        at_once: int,
    ) -> dict[str, bytes]:
        """Results by case: those that the run keeps under the keys, all others computed in
        processes and kept.

        jobs_of: cases without a result -> jobs.
        work: path of the facts and some jobs, at most `at_once` -> cases, each with its result.
        """
        parts = {case: self.kept.get(kind, key) for case, key in keys.items()}
        found = {case: data for case, data in parts.items() if data is not None}
        jobs = jobs_of(keys.keys() - found.keys())
        starts = range(0, len(jobs), at_once)
        some = [(self.store.path, jobs[first : first + at_once]) for first in starts]
        new = dict(chain.from_iterable(self.spread(work, some) if some else ()))
        self.kept.put((kind, keys[case], 0, data) for case, data in new.items())
        return found | new
