"""The points of an evaluation's logical scenarios, and the zones they lie in."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from sumo_eval.errors import InputError
from sumo_eval.method.zone_partition import ZonePartition, partition
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling import Sample, sample
from sumo_eval.settings import ScenarioSettings, ZoneSettings


@lru_cache(maxsize=16)
def zones_of(logical: LogicalScenario, settings: ZoneSettings) -> ZonePartition:
    """The partition of a scenario; asked for again by every stage of an evaluation, computed once."""
    return partition(logical, settings)


def choose_points(entry: ScenarioSettings, source: Path) -> tuple[LogicalScenario, Sample]:
    """A logical scenario and the points of its space that are simulated."""
    logical = catalogue.find(entry.use, source)
    sampling = entry.sampling
    points = sample(logical, sampling.method, levels=sampling.levels, steps=sampling.steps)
    if len(points.points) == 0:
        raise InputError(f"The sampling of scenario `{entry.use}` must choose at least one possible point, got none.")
    return logical, points
