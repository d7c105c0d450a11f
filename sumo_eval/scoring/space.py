"""One logical scenario of a run while it is scored, with all that the steps of `scoring.steps`
need of it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TypeVar

from sumo_eval.method.severity import Severity
from sumo_eval.record.cases import Role
from sumo_eval.record.kept_results import KeptResults, Kind
from sumo_eval.record.progress import Progress
from sumo_eval.record.spread import Spread
from sumo_eval.record.store import Fact, Store, open_store
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import Sample
from sumo_eval.settings import EvaluationSettings, MethodSettings, ScenarioSettings

Job = TypeVar("Job")
Work = Callable[[Job, Store], Iterable[tuple[str, bytes]]]
"""A job, and the facts to read: its cases, each with its result."""


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
        work: Work[Job],
        at_once: int,
    ) -> dict[str, bytes]:
        """Results by case, from the cache, or computed in processes and kept.

        kind: of the results.
        keys: of the results, by case.
        jobs_of: function from cases without a result to jobs.
        at_once: jobs that a process does before it answers.
        """
        cached = {case: self.kept.get(kind, key) for case, key in keys.items()}
        results = {case: data for case, data in cached.items() if data is not None}
        jobs = jobs_of(keys.keys() - results.keys())
        starts = range(0, len(jobs), at_once)
        parts = [jobs[first : first + at_once] for first in starts]
        do_jobs = partial(_do_jobs, self.store.path, work)
        new = dict(chain.from_iterable(self.spread(do_jobs, parts) if parts else ()))
        self.kept.put((kind, keys[case], 0, data) for case, data in new.items())
        return results | new


def _do_jobs(path: Path, work: Work[Job], jobs: Sequence[Job]) -> list[tuple[str, bytes]]:
    """Results of some jobs, from the facts at a path."""
    with open_store(path, checked=True) as store:
        return list(chain.from_iterable(work(job, store) for job in jobs))
