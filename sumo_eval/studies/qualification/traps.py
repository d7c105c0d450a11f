"""Known traps of libsumo, into which a drive through the harness must not fall."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.scenario import Actor, ConcreteScenario, Start
from sumo_eval.settings import SimulationSettings
from sumo_eval.studies.qualification.check import Check
from sumo_eval.studies.qualification.driven import EGO_X, ROAD, behind, drive

KIND = "libsumo traps"
SHORT = SimulationSettings(time_limit=0.5)


def _rolls(*_: Any) -> Command:
    return Command(0.0)


def _tricky(traci: Any, ego: str, time: float) -> None:
    """Asks SUMO for what no car can do."""
    traci.vehicle.setSpeedMode(ego, 0)
    traci.vehicle.setSpeed(ego, 0.0)


def _start() -> float:
    """Where a vehicle stands at t = 0 that starts 1 m behind a slower one, less where it was to stand, m."""
    return float(drive(behind(20.0, 10.0, 1.0), _rolls, SHORT).ego.x[0]) - EGO_X


def _across() -> str:
    """Bodies of 1.8 m whose middles are 1.5 m apart, each in its own lane."""
    other = Actor("other", Start(EGO_X + 1.0, 2.4, 20.0))
    concrete = ConcreteScenario("qualification", {}, 1.0, ROAD, Start(EGO_X, 0.9, 20.0), (other,))
    return drive(concrete, _rolls, SHORT).end_reason


def _stops() -> float:
    found = drive(behind(20.0, 20.0, 100.0), _tricky, SHORT)
    return float(found.ego.speed[-1])


def _not_a_number() -> str:
    return simulate(behind(20.0, 20.0, 100.0), lambda *_: Command(math.nan), SHORT).end_reason


def _second() -> float:
    """Largest difference between a drive and the same after another simulation in the process, m."""
    first = drive(behind(20.0, 15.0, 30.0), _rolls, SHORT).ego.x
    drive(behind(30.0, 5.0, 9.0), _rolls, SHORT)
    return float(abs(drive(behind(20.0, 15.0, 30.0), _rolls, SHORT).ego.x - first).max())


def checks() -> Iterator[Check]:
    """What bare libsumo does is in each source."""
    yield Check(KIND, "a start 1 m behind is not delayed", "libsumo inserts it seconds later", 0.0, _start, 1e-9, "m")
    yield Check(KIND, "bodies touch across a lane line", "getCollisions does not see them", "contact", _across)
    # 9 m/s2 for 0.5 s from 20 m/s
    yield Check(KIND, "speed mode 0 stops nobody at once", "libsumo brakes with 400 m/s2", 15.5, _stops, 1e-6, "m/s")
    yield Check(KIND, "a command that is no number", "libsumo takes nan in silence", "ads_error", _not_a_number)
    yield Check(KIND, "a simulation leaves nothing behind", "one process, one after the other", 0.0, _second, 0.0, "m")
