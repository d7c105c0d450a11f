"""One drive through SUMO, and what the checks read off it."""

from __future__ import annotations

from sumo_eval.cosim.doors.controller import ControllerLike
from sumo_eval.cosim.simulation import simulate
from sumo_eval.errors import SimulationError
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start
from sumo_eval.scenario.concrete import Brake
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording

LENGTH = 4.5  # m, of every body
EGO_X = 50.0  # m
ROAD = Road("qualification_road", 1500.0, 2, 3.5, 1000.0)


def drive(concrete: ConcreteScenario, ads: ControllerLike, settings: SimulationSettings | None = None) -> Recording:
    """Raises SimulationError where the drive ended with an error."""
    recording = simulate(concrete, ads, settings)
    if recording.error is not None:
        raise SimulationError(recording.error)
    return recording


def behind(speed: float, other: float, gap: float, braking: Brake | None = None) -> ConcreteScenario:
    """The ego `gap` m behind another in its lane, who keeps the speed or brakes. m/s."""
    lead = Actor("other", Start(EGO_X + LENGTH + gap, 0.0, other), (), LENGTH, brake=braking)
    return ConcreteScenario("qualification", {}, 1.0, ROAD, Start(EGO_X, 0.0, speed), (lead,))


def impact_speed(recording: Recording) -> float:
    """Relative speed at contact, 0 without one, m/s."""
    return 0.0 if recording.collision is None else recording.collision.relative_speed


def outcome(recording: Recording) -> str:
    """`contact` or `avoided`."""
    return "avoided" if recording.collision is None else "contact"


def least_gap(recording: Recording) -> float:
    """Smallest distance along the road from the ego's front to the other's rear, m."""
    ahead = recording.actors["other"].x - recording.ego.x
    return float(ahead.min()) - LENGTH
