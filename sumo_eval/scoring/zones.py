"""The zones of a run's scenarios, kept in its folder or computed (Eqs. 7-8)."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.kept_results import KeptResults, key_of
from sumo_eval.record.points import ZONES, kept_zones
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.scoring.fingerprint import sources, space_key
from sumo_eval.settings import EvaluationSettings, ScenarioSettings

ROOMS_OF_ZONES = ("method", "scenario", "settings")
"""Rooms of this package that a partition comes from."""


def zones_of(run: Resolved, kept: KeptResults) -> dict[str, ZonePartition]:
    """The partition of each scenario by its name, kept or computed."""
    settings = run.settings
    return {
        logical.name: kept_zones(
            logical, settings.method.zones, kept, zones_key(entry, settings, run.source)
        )
        for entry, logical in run.entries
    }


def zones_key(entry: ScenarioSettings, settings: EvaluationSettings, source: Path) -> bytes:
    """Key of a kept partition of a scenario: a hash of all that it depends on."""
    return key_of(
        "zones",
        settings.method.zones,
        entry.use,
        space_key(entry, source),
        sources(*ROOMS_OF_ZONES),
    )


def zones_are_known(settings: EvaluationSettings, source: Path) -> bool:
    """Whether this process has the partition of every scenario of an evaluation."""
    return all(zones_key(entry, settings, source) in ZONES for entry in settings.scenario)


def find_zones(settings: EvaluationSettings, source: Path, folder: Path) -> None:
    """Compute the partition of every scenario of a run that its folder does not keep yet."""
    with closing(KeptResults(folder)) as kept:
        zones_of(Resolved.of(settings, source), kept)
