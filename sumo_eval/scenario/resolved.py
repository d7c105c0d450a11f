"""An evaluation with its scenarios: looked up once, then passed to everything that needs them.

Users: `cli/`, `evaluation.py`, `record/`, `results.py`, `scoring/`, `report/export_case.py`,
`extras/gym/episodes.py`, `extras/rates/campaign.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from sumo_eval.errors import InputError, check_known, doubled, must_be
from sumo_eval.frozen import frozen
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import EgoBody
from sumo_eval.scenario.first_places import STANDARD_EGO
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.vehicle_tables import Placement
from sumo_eval.settings import EvaluationSettings, ScenarioSettings, VehicleSettings

WHOLE = (1, 1)  # shard 1 of 1: all points


@frozen
class Resolved:
    """An evaluation whose scenarios have been looked up.

    source: folder where its relative paths start.
    scenarios: by name, in the order of `settings.scenario`.
    shard: (i, n): of the points only part i of n, counted from 1, is recorded.
    """

    settings: EvaluationSettings
    source: Path
    scenarios: Mapping[str, LogicalScenario]
    shard: tuple[int, int] = WHOLE

    @classmethod
    def of(cls, settings: EvaluationSettings, source: Path) -> Resolved:
        """Look up its scenarios.

        Raises InputError for an unknown one, for two of one name, for a tolerance of a parameter
        that none has, and for axes of a map that are not two of the scenario's parameters.
        """
        vehicle = settings.simulation.vehicle
        scenarios = [find_with(vehicle, entry.use, source) for entry in settings.scenario]
        refuse_doubles([logical.name for logical in scenarios])
        names = [name for logical in scenarios for name in logical.names]
        check_known("parameter in `drivers.tolerance`:", names, *(settings.drivers.tolerance or ()))
        for logical in scenarios:
            axes = settings.report.axes.get(logical.name, ())
            # `column` refuses an unknown name
            if len(set(map(logical.column, axes))) < len(axes):
                owner = f"scenario `{logical.name}`"
                raise must_be("`report.axes`", owner, "two different parameters", axes)
        return cls(settings, source, {logical.name: logical for logical in scenarios})

    @property
    def entries(self) -> Iterator[tuple[ScenarioSettings, LogicalScenario]]:
        """The evaluation's entry of each scenario, and the scenario."""
        return zip(self.settings.scenario, self.scenarios.values(), strict=True)


def find_with(vehicle: VehicleSettings, use: str, folder: Path) -> LogicalScenario:
    """A scenario by its name, file or locator (`catalogue.find`). Where it prescribes no body of
    the ego, it has that of this vehicle: zones have its size, gaps of a file begin at its bumpers.
    """
    logical = catalogue.find(use, folder)
    body = EgoBody(vehicle.length, vehicle.width)
    if logical.ego_body or body == STANDARD_EGO:
        return logical
    place = logical.place
    # a user's function `place`, which is no `Placement`, decides on gaps itself
    if isinstance(place, Placement):
        place = replace(place, ego=replace(place.ego, length=body.length, width=body.width))
    return replace(logical, ego_body=body, place=place)


def refuse_doubles(names: Sequence[str]) -> None:
    """Raise InputError for two scenarios of one name: keys of cases begin with it."""
    if double := doubled(names):
        raise InputError(f"Logical scenarios must differ in their names, got `{double[0]}` twice.")
