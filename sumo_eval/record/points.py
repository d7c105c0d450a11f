"""The points of an evaluation's logical scenarios, their zones, the weights of scenarios in the
ranking, and the check of the axes that `[report]` names for maps.

Fixed: points stand in the order of the sampling method; a point's index is its number in the names
of cases.

Users: `record/facts.py`, `scoring/`, `evaluation.py`, `cli/space.py`, `cli/tools.py`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sumo_eval.coded import decoded, encoded
from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.scenario.logical import LogicalScenario, PointFunction
from sumo_eval.settings import (
    EvaluationSettings,
    RankingSettings,
    ReportSettings,
    ScenarioSettings,
    ZoneSettings,
)

# at run time imported where needed: they take half a second
if TYPE_CHECKING:
    from sumo_eval.method.zone_partition import ZonePartition
    from sumo_eval.scenario.sampling.samples import Sample


ZONES: dict[bytes, ZonePartition] = {}
"""Partitions that this process has read or computed, by the hash of all that they depend on."""
# Most partitions in `ZONES`; the oldest is dropped first. So an evaluation of more scenarios than
# this, scored twice, computes all of them twice.
_MOST_ZONES = 64


def kept_zones(
    logical: LogicalScenario, settings: ZoneSettings, cache: KeptResults, key: bytes
) -> ZonePartition:
    """The partition of a scenario: from an earlier evaluation of this process, else from the run's
    cache, else computed. The cache holds it afterwards.

    key: hash of all that the partition depends on.
    """
    from sumo_eval.method.zone_partition import fitted_parts, of_parts, partition
    from sumo_eval.method.zone_surface import Surface

    data = cache.get("zones", key)
    if key not in ZONES:
        ZONES[key] = (
            partition(logical, settings)
            if data is None
            else of_parts(logical, settings, decoded(data, {"Surface": Surface}))
        )
    zones = ZONES[key]
    if data is None:
        cache.put([("zones", key, 0, encoded(fitted_parts(zones)))])
    if len(ZONES) > _MOST_ZONES:
        del ZONES[next(iter(ZONES))]
    return zones


def choose_points(
    logical: LogicalScenario,
    entry: ScenarioSettings,
    source: Path,
    settings: EvaluationSettings,
    exposure: PointFunction | None = None,
) -> Sample:
    """The points of a scenario's space that are simulated.

    source: folder where relative paths start.
    exposure: instead of the scenario's own.
    """
    from sumo_eval.method.point_criticality import danger
    from sumo_eval.scenario.sampling.request import Request
    from sumo_eval.scenario.sampling.samples import sample

    request = Request(
        **asdict(entry.sampling),
        folder=source,
        seed=settings.seed,
        danger=lambda points: danger(logical, points, settings.method.zones),
    )
    weighted = logical if exposure is None else replace(logical, exposure=exposure)
    points = sample(weighted, request.method, request=request)
    if not points.exposure.any():
        owner = f"the points of scenario `{entry.use}`"
        raise must_be("The exposure", owner, "above 0 at one of them", 0.0)
    return points


def refuse_unknown_axes(scenarios: Collection[str], settings: ReportSettings) -> None:
    """Raise InputError if `report.axes` names a scenario that the evaluation does not have."""
    check_known("scenario in `report.axes`", scenarios, *settings.axes)


def scenario_weights(scenarios: Sequence[str], settings: RankingSettings) -> dict[str, float]:
    """The weight of every scenario of an evaluation, by name.

    Raises InputError for a weight of another scenario, and where all weights are 0.
    """
    check_known("scenario in `method.ranking.weights`", scenarios, *settings.weights)
    weights = {name: float(settings.weights.get(name, 1.0)) for name in scenarios}
    if not any(weights.values()):
        raise InputError(
            "`method.ranking.weights` must leave at least one scenario a weight above 0, "
            "got only 0."
        )
    return weights
