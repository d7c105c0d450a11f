"""Drives that the known answers share: an ego behind a lead vehicle, and what is measured of it.

Users: `extras/studies/qualification/regulations.py`, `extras/studies/qualification/table.py`.
"""

from collections.abc import Iterator
from typing import Any

from sumo_eval.cosim.doors.controller import ControllerLike
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import SimulationError
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start, brake_to_stop
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording

LENGTH = 4.5  # m, of every vehicle unless a check sets its own
EGO_X = 50.0  # m, where the ego starts
# name; x at which drives end, m; number of lanes; lane width, m; length of road after the end, m
ROAD = Road("qualification_road", 1500.0, 2, 3.5, 1000.0)
# deceleration of the ideal vehicle and of the default vehicle model, m/s2, and the time in which it
# is built up, s
STRENGTH, BUILD_UP = 9.0, 0.15
SHORT = SimulationSettings(time_limit=0.5)
"""Half a second, for the traps of libsumo."""


Rows = Iterator[tuple[Any, ...]]
"""Rows of `table.py`: the fields of a `Check` after `kind`, of which the last may be missing."""


def drive(
    concrete: ConcreteScenario, ads: ControllerLike, settings: SimulationSettings | None = None
) -> Recording:
    """The recording of one drive.

    Raises SimulationError where it ended with an error.
    """
    recording = simulate(concrete, ads, settings)
    if recording.error is not None:
        raise SimulationError(recording.error)
    return recording


def behind(speed: float, lead_speed: float, gap: float, braking: float = 0.0) -> ConcreteScenario:
    """An ego behind a lead vehicle, the actor `other`, which keeps its speed or brakes at once.

    speed: of the ego, m/s.
    gap: between the two bodies, m.
    braking: deceleration of the lead vehicle, m/s2; 0: it keeps its speed.
    """
    acts = (brake_to_stop(0.0, braking),) if braking else ()
    lead = Actor("other", Start(EGO_X + LENGTH + gap, 0.0, lead_speed), acts, LENGTH)
    return ConcreteScenario("qualification", {}, 1.0, ROAD, Start(EGO_X, 0.0, speed), (lead,))


def impact(*arguments: Any) -> float:
    """Relative speed at contact in a `drive` with these arguments, m/s; 0 without contact."""
    collision = drive(*arguments).collision
    return 0.0 if collision is None else collision.relative_speed


def least_gap(*arguments: Any) -> float:
    """Smallest distance along the road from the ego's front to the rear of `other`, m, in a `drive`
    with these arguments.
    """
    recording = drive(*arguments)
    return float((recording.actors["other"].x - recording.ego.x).min()) - LENGTH


def rolls(*_: Any) -> Command:
    """ADS that neither brakes nor accelerates."""
    return Command(0.0)
