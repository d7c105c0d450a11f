"""An evaluation with its scenarios, looked up once and handed on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings import EvaluationSettings, ScenarioSettings

WHOLE = (1, 1)


@dataclass(frozen=True, slots=True)
class Resolved:
    """An evaluation whose scenarios have been looked up.

    source: where its relative paths start.
    scenarios: by name, in the order of `settings.scenario`.
    shard: number and count of the share of its points that is recorded.
    """

    settings: EvaluationSettings
    source: Path
    scenarios: Mapping[str, LogicalScenario]
    shard: tuple[int, int] = WHOLE

    @classmethod
    def of(cls, settings: EvaluationSettings, source: Path) -> Resolved:
        """Look up its scenarios.

        Raises InputError for an unknown one, for two of one name, and for axes of a map that it
        does not have.
        """
        scenarios = [catalogue.find(entry.use, source) for entry in settings.scenario]
        refuse_doubles([logical.name for logical in scenarios])
        for logical in scenarios:
            axes = settings.report.axes.get(logical.name, ())
            if len(set(map(logical.column, axes))) < len(axes):
                raise must_be("`axes`", logical.name, "two different parameters", axes)
        return cls(settings, source, {logical.name: logical for logical in scenarios})

    @property
    def entries(self) -> Iterator[tuple[ScenarioSettings, LogicalScenario]]:
        """The evaluation's entry of each scenario, and the scenario."""
        return zip(self.settings.scenario, self.scenarios.values(), strict=True)


def refuse_doubles(names: Sequence[str]) -> None:
    """Raise InputError for two scenarios of one name, by which their cases are named."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"Logical scenarios of one evaluation must differ in their names, got `{name}` "
                "twice."
            )
