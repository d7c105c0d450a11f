"""One logical scenario of a run during scoring, with all that `scoring.steps` needs.

Users: `scoring/drive_results.py`, `scoring/likeness.py`, `scoring/quantities.py`,
`scoring/requirements.py`, `scoring/steps.py`.
"""

from pathlib import Path
from typing import NamedTuple

from sumo_eval.method.severity import Severity
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.cases import Role
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.record.progress import Progress
from sumo_eval.record.spread import Spread
from sumo_eval.record.store import Store
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import Sample
from sumo_eval.settings import EvaluationSettings, MethodSettings, ScenarioSettings


class ScenarioRun(NamedTuple):
    """A logical scenario of a run, with its points and the run's facts.

    entry: the scenario in the evaluation.
    points: the sample that the settings choose now.
    settings: of the run; under `run.only` without ADSs that have no case here.
    source: folder of the evaluation, where relative paths start.
    severity: the measure of a collision's severity: U, or its replacement.
    store: the facts.
    cache: earlier results of the run.
    spread: maps a function over items: `map`, or a function like it that uses several processes.
    car: locator of the reference car of T; "": the run has none.
    outside: numbers of the points outside the support of recorded events.
    edited: whether the scenario's file has changed since the scenario was driven.
    """

    entry: ScenarioSettings
    logical: LogicalScenario
    points: Sample
    settings: EvaluationSettings
    source: Path
    severity: Severity
    store: Store
    cache: KeptResults
    spread: Spread
    progress: Progress
    car: str
    outside: frozenset[int]
    edited: bool

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.logical.name

    @property
    def method(self) -> MethodSettings:
        """Settings of the method, the same in all scenarios of a run."""
        return self.settings.method

    def facts_at(self, points: range, role: Role) -> list[Fact]:
        """The recorded drives of a role (`ads`, `ideal`, `human` ...) at some points."""
        return self.store.facts_at(points, role, self.name)
