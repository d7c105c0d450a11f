"""Records for scenarios in Python: logical scenarios with their parameters, and concrete ones.

Samplers are in `sumo_eval.scenario.sampling`, shipped scenarios in `sumo_eval.scenario.catalogue`.
"""

from typing import Never

from sumo_eval.gone import NAMES as ACTS_BY_REMOVED_NAME
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
    """Name what replaced a removed class: `from ... import` hides an AttributeError's words."""
    if name in ACTS_BY_REMOVED_NAME:
        raise ImportError(
            f"`{name}` was removed: `Actor(acts=({ACTS_BY_REMOVED_NAME[name]}(...), ...))` says "
            "what a vehicle does."
        )
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
