"""Discrepancies between SUMO and the world: in the clock, of vehicles that have left, in places.

An ADS may have caused each by its calls of TraCI; that is its fault, not SUMO's.

Users: `cosim/stage.py`, `cosim/traffic.py`.
"""

from collections.abc import Callable
from typing import Any

from sumo_eval.cosim.doors.traci_module import GUARD
from sumo_eval.cosim.world import World
from sumo_eval.errors import ControllerError

_CLOCK_TOLERANCE = 1e-4  # s; SUMO counts in milliseconds


def check_clock(traci: Any, clock: Callable[[], float], step: float, time: float) -> None:
    """Raise ControllerError if the ADS has stepped or closed the simulation, or if the guard has
    refused one of its calls: the ADS may have caught that exception.

    clock: gives SUMO's time, s. step: length of a step, s. time: of the world, s.
    """
    if GUARD.refusal is not None:
        deed, reason = GUARD.refusal
        raise ControllerError(f"{deed} at {time:.2f} s; {reason}.")
    try:
        now = clock()
    except (traci.TraCIException, traci.FatalTraCIError) as error:
        raise ControllerError(
            f"The ADS closed the simulation at {time:.2f} s; that is the harness's."
        ) from error
    # SUMO's clock is ahead by the step that inserted the vehicles
    ahead = now - time - step
    if abs(ahead) > _CLOCK_TOLERANCE:
        raise ControllerError(
            f"The ADS moved SUMO's clock by {ahead:+.2f} s at {time:.2f} s; stepping is the "
            "harness's."
        )


def note_leaving(world: World, row: int, other: int) -> None:
    """Record an actor that left the network; raise ControllerError if the ADS removed it.

    other: index of the actor in its row.
    """
    case = world.case_of(row)
    now = world.time + world.settings.step
    actor = world.cases[case].actors[other]
    left_itself = actor.model or may_leave_sumo(world, row, other)
    if not left_itself and world.each[case].conditions.interference == "refuse":
        raise ControllerError(
            f"The ADS removed vehicle `{actor.name}` before {now:.2f} s; it may change only "
            'its own vehicle (`interference = "record"` permits more, and counts it).'
        )
    world.note(case, "actor_left_the_network", now, now)


def may_leave_sumo(world: World, row: int, other: int) -> bool:
    """Whether an actor may leave SUMO by itself: its script has brought its front bumper beyond
    the last lane, or a SUMO model drives it, which may have begun beside the lanes.
    """
    body = world.others[row, other]
    return bool(
        body["x"] + 0.5 * body["length"] > world.end_of_lanes
        or world.players.plays["model"][row, other]
    )


def fail_misplaced(world: World, row: int, vehicle: int, words: str, *, ads_asks: bool) -> None:
    """Fail a case in which SUMO shows a vehicle at another place; it is the ADS's fault if its
    calls moved the ego.

    vehicle: 0 the ego, then the actors.
    words: of the message after "SUMO", with {} for the vehicle.
    ads_asks: as of `Stage`.
    """
    actors = world.cases[world.case_of(row)].actors
    subject = f"vehicle `{actors[vehicle - 1].name}`" if vehicle else "the ego"
    by_ads = ads_asks and len(world.cases) == 1 and GUARD.moved and not vehicle
    world.fail(row, "ads_error" if by_ads else "sim_error", f"SUMO {words.format(subject)}")
