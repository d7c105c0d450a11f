"""Parameter spaces, logical and concrete scenarios, sampling, and the scenarios that ship."""

from typing import Never

from sumo_eval.gone import NAMES
from sumo_eval.scenario.concrete import (
    Actor,
    ConcreteScenario,
    EgoBody,
    Road,
    Start,
    brake_to_stop,
    constant_lateral,
    lane_change,
)
from sumo_eval.scenario.logical import Approach, Constraint, LogicalScenario, NamedSample, Parameter

__all__ = [
    "Actor",
    "Approach",
    "ConcreteScenario",
    "Constraint",
    "EgoBody",
    "LogicalScenario",
    "NamedSample",
    "Parameter",
    "Road",
    "Start",
    "brake_to_stop",
    "constant_lateral",
    "lane_change",
]


def __getattr__(name: str) -> Never:
    if name in NAMES:
        raise ImportError(
            f"`{name}` was removed: `Actor(acts=({NAMES[name]}(...), ...))` says what a vehicle "
            "does."
        )
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
