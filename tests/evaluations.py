"""Evaluations of a few points with a few drivers, in the process of the test."""

from collections.abc import Mapping, Sequence
from typing import Any

from sumo_eval.settings import (
    AdsSettings,
    DriverSettings,
    EvaluationSettings,
    RunSettings,
    SamplingSettings,
    ScenarioSettings,
)


def small(
    ads: Mapping[str, str] | Sequence[str],
    scenarios: Sequence[str] = ("front_vehicle_low_speed",),
    drivers: int = 4,
    *,
    levels: int = 3,
    steps: Mapping[str, float] | None = None,
    **more: Any,
) -> EvaluationSettings:
    """So many levels an axis, or `steps`.

    ads: controllers by name, or controllers that are called like themselves.
    """
    sampling = (
        SamplingSettings(levels=levels) if steps is None else SamplingSettings(steps=dict(steps))
    )
    named = ads if isinstance(ads, Mapping) else {controller: controller for controller in ads}
    return EvaluationSettings(
        "small",
        tuple(ScenarioSettings(name, sampling) for name in scenarios),
        tuple(AdsSettings(name, controller) for name, controller in named.items()),
        drivers=DriverSettings(count=drivers),
        **{"run": RunSettings(engine="serial"), **more},
    )
