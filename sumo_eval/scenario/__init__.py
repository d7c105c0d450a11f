"""Parameter spaces, logical and concrete scenarios, sampling, and the scenarios that ship."""

from sumo_eval.scenario.concrete import (
    Actor,
    Brake,
    ConcreteScenario,
    ConstantLateral,
    EgoBody,
    LaneChange,
    Road,
    Start,
)
from sumo_eval.scenario.logical import Approach, Constraint, LogicalScenario, NamedSample, Parameter

__all__ = [
    "Actor",
    "Approach",
    "Brake",
    "ConcreteScenario",
    "ConstantLateral",
    "Constraint",
    "EgoBody",
    "LaneChange",
    "LogicalScenario",
    "NamedSample",
    "Parameter",
    "Road",
    "Start",
]
