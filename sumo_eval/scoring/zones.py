"""The zones of a run's scenarios, kept in its folder or computed (Eqs. 7-8)."""

from __future__ import annotations

from pathlib import Path

from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.kept_results import KeptResults, key_of
from sumo_eval.record.points import ZONES, kept_zones
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.fingerprint import sources, space_key
from sumo_eval.settings import EvaluationSettings, ScenarioSettings

ROOMS_OF_ZONES = ("method", "scenario", "settings")
"""Rooms of this package that a partition comes from."""


def zones_of_entry(
    entry: ScenarioSettings, logical: LogicalScenario, settings: EvaluationSettings, source: Path, kept: KeptResults
) -> ZonePartition:
    """The partition of a scenario, kept or computed."""
    return kept_zones(logical, settings.method.zones, kept, zones_key(entry, settings, source))


def zones_key(entry: ScenarioSettings, settings: EvaluationSettings, source: Path) -> bytes:
    """What the partition of a scenario is kept under: a hash of all that it depends on."""
    return key_of("zones", settings.method.zones, entry.use, space_key(entry, source), sources(*ROOMS_OF_ZONES))


def zones_are_known(settings: EvaluationSettings, source: Path) -> bool:
    """Whether this process has the partition of every scenario of an evaluation."""
    return all(zones_key(entry, settings, source) in ZONES for entry in settings.scenario)


def find_zones(settings: EvaluationSettings, source: Path, folder: Path) -> None:
    """Compute the partition of every scenario of a run that its folder does not keep yet."""
    kept = KeptResults(folder)
    for entry in settings.scenario:
        zones_of_entry(entry, catalogue.find(entry.use, source), settings, source, kept)
    kept.close()
