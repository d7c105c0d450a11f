"""Evaluations of a few points with a few drivers, in the process of the test."""

import tomllib
from collections.abc import Mapping

from sumo_eval.cases import CaseResult
from sumo_eval.settings import (
    AdsSettings,
    DriverSettings,
    EvaluationSettings,
    RunSettings,
    SamplingSettings,
    ScenarioSettings,
)
from sumo_eval.settings.config import settings_from

EMPTY = CaseResult(
    case="", scenario="s", ads="a", values={}, zone="hazardous", exposure=1.0, status="ok",
    end_reason=None, error=None,
    wall_time=None, simulated_time=None, latency_mean=None, latency_max=None, collided=False,
    ideal_severity=0.0, no_reaction_severity=10.0,
)  # fmt: skip
"""A case in which nothing happened."""


def settings_of(**changes):
    """Settings of an evaluation file with `idm` in `cut_in` and these keys."""
    plain = tomllib.loads("""
name = "x"
scenario = [{ use = "cut_in" }]
ads = [{ name = "a", controller = "idm" }]
""")
    return settings_from(plain | changes, "evaluation.toml")


def small(
    ads=("idm",), scenarios=("front_vehicle_low_speed",), drivers=4, *, levels=3, steps=None, **more
):
    """So many levels an axis, or `steps`, or a `sampling`.

    ads: controllers by name, or controllers that are called like themselves.
    """
    how = {"levels": levels} if steps is None else {"steps": dict(steps)}
    sampling = more.pop("sampling", None) or SamplingSettings(**how)
    named = ads if isinstance(ads, Mapping) else {controller: controller for controller in ads}
    return EvaluationSettings(
        "small",
        tuple(ScenarioSettings(name, sampling) for name in scenarios),
        tuple(AdsSettings(name, controller) for name, controller in named.items()),
        drivers=DriverSettings(count=drivers),
        **{"run": RunSettings(engine="serial"), **more},
    )
