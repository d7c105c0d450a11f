"""Parameter spaces, logical and concrete scenarios, sampling, and the scenarios that ship."""

from sumo_eval.scenario.concrete import Actor, ConcreteScenario, LaneChange, Road, Start
from sumo_eval.scenario.logical import Approach, Constraint, LogicalScenario, Parameter

__all__ = [
    "Actor",
    "Approach",
    "ConcreteScenario",
    "Constraint",
    "LaneChange",
    "LogicalScenario",
    "Parameter",
    "Road",
    "Start",
]
