"""The zones of a run's scenarios (Eqs. 7-8), from the cache in the run's folder or computed.

Users: `evaluation`, `scoring.steps`, `report.explain`. Fixed: `zones_key` must name all that the
zones depend on, or a stale partition would be used.
"""

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

import numpy as np

from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.fingerprint import sources, space_key
from sumo_eval.record.kept_results import KeptResults, key_of
from sumo_eval.record.points import ZONES, kept_zones
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import EvaluationSettings, ScenarioSettings
from sumo_eval.trajectory import FloatArray


def zones_of(run: Resolved, cache: KeptResults) -> dict[str, ZonePartition]:
    """Scenario -> its partition, from the cache or computed."""
    settings = run.settings
    return {
        logical.name: kept_zones(
            logical, settings.method.zones, cache, zones_key(entry, settings, run.source)
        )
        for entry, logical in run.entries
    }


def zones_key(entry: ScenarioSettings, settings: EvaluationSettings, source: Path) -> bytes:
    """Key of a scenario's partition in the cache: a hash of all that the partition depends on.

    entry: the scenario in the evaluation.
    source: folder of the evaluation, where relative paths start.
    """
    return key_of(
        "zones",
        settings.method.zones,
        entry.use,
        space_key(entry, source),
        # rooms whose code computes a partition
        sources("method", "scenario", "scoring", "settings"),
    )


def star_distance(
    zones: ZonePartition, row: FloatArray, weight: float
) -> tuple[Mapping[str, float], float, float | None]:
    """The ray of Eq. 16 from x* through a point: x*, the most dangerous point of the nearest zone,
    by name; |x - x*|; and |b - x*|, None at x* itself. Lengths are in the unit box.

    zones: at least one.
    row: x, values of the point, (k,).
    weight: r of the point (Eq. 16).
    """
    logical, star = zones.logical, zones.most_dangerous[int(zones.nearest_zone(row))]
    away = float(np.linalg.norm(logical.to_unit(row) - logical.to_unit(logical.row(star))))
    # r = |x - x*| / |b - x*|
    return star, away, away / weight if weight > 0.0 else None


def zones_are_known(settings: EvaluationSettings, source: Path) -> bool:
    """Whether this process has computed or read the partition of every scenario of an evaluation.

    source: folder of the evaluation.
    """
    return all(zones_key(entry, settings, source) in ZONES for entry in settings.scenario)


def find_zones(settings: EvaluationSettings, source: Path, folder: Path) -> None:
    """Compute the partitions of a run's scenarios that its folder does not have.

    source: folder of the evaluation.
    folder: of the run.
    """
    with closing(KeptResults(folder)) as cache:
        zones_of(Resolved.of(settings, source), cache)
