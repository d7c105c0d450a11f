"""Partitions of 2, 3 and 4 parameters against the closed form of Eq. 6, with the worst points and
Eq. 16's rays."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from tables import in_campaign

from sumo_eval.method.collision_avoidance import collision_weight
from sumo_eval.method.criticality import critical_gap
from sumo_eval.method.zone_partition import partition
from sumo_eval.scenario import Approach, LogicalScenario, Parameter, Road
from sumo_eval.scenario.logical import Constraint, ZoneCoordinates
from sumo_eval.settings import ZoneSettings

SPACE = (
    Parameter("ego_speed", 10.0, 30.0, 5.0, "m/s", ""),
    Parameter("gap", 5.0, 150.0, 10.0, "m", ""),
    Parameter("obstacle_speed", 0.0, 10.0, 2.5, "m/s", ""),
    Parameter("delay", 0.0, 2.0, 0.5, "s", ""),
)
HELD = {"obstacle_speed": 0.0, "delay": 1.0}


def approached(count):
    """The first `count` parameters free, the others held."""

    def approach(values):
        free = {**HELD, **values}
        return Approach(free["ego_speed"], free["obstacle_speed"], free["gap"], free["delay"])

    return LogicalScenario(
        name=f"approach_{count}", about="", source="", parameters=SPACE[:count], constraints=(),
        road=Road("none", 100.0, 1, 3.5, 0.0), place=lambda values: None, approach=approach,
    )  # fmt: skip


@pytest.mark.parametrize("count", [2, 3, in_campaign(4)])
def test_a_partition_is_the_closed_forms(count):
    logical = approached(count)
    zones = partition(logical, ZoneSettings(restarts=1, grid_points=10_000))
    points = logical.from_unit(np.random.default_rng(count).random((4_000, count)))
    values = HELD | dict(zip(logical.names, points.T, strict=True))
    truth = values["gap"] <= critical_gap(
        values["ego_speed"] - values["obstacle_speed"], delay=values["delay"]
    )
    found = zones.hazardous(points)
    assert 0.2 < truth.mean() < 0.8
    assert np.mean(found != truth) <= 0.01

    # the hardest impact: fastest ego, standing obstacle, shortest gap, longest delay
    worst = {"ego_speed": 30.0, "gap": 5.0, "obstacle_speed": 0.0, "delay": 2.0}
    impact = {name: worst[name] for name in logical.names}
    (most,) = zones.most_dangerous
    assert most["ego_speed"] == pytest.approx(impact["ego_speed"])
    assert most["gap"] == pytest.approx(impact["gap"])
    if count >= 3:
        assert most["obstacle_speed"] == pytest.approx(0.0)

    # Eq. 16: r is finite, 0 at the worst point, at most 1 where the ray is still inside, above 1
    # beyond the boundary
    inside, outside = (
        collision_weight(points[found][:200], zones),
        collision_weight(points[~found][:200], zones),
    )
    assert np.isfinite(inside).all()
    assert np.isfinite(outside).all()
    assert inside.min() > 0.0
    assert inside.max() <= 1.0
    assert outside.min() >= 1.0
    assert collision_weight(most, zones) == 0.0


def fails(values):
    """A user's function that knows only a part of the space."""
    raise KeyError("beyond the table")


@pytest.mark.parametrize(
    "change",
    [
        {"approach": fails},
        {"approach": None, "margin": fails},
        {"zone_coordinates": ZoneCoordinates(("a",), fails)},
        {"constraints": (Constraint("", fails),)},
    ],
    ids=lambda change: ", ".join(change),
)
def test_a_users_function_that_raises_within_the_space_is_named(change):
    with refusal("Scenario `approach_2` failed: KeyError: 'beyond the table'"):
        partition(replace(approached(2), **change), ZoneSettings(restarts=1, grid_points=1_000))
