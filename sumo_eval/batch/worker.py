"""What runs in a child process: one case through SUMO. Imports no more than that needs."""

from __future__ import annotations

from sumo_eval.batch.cases import Case, Outcome, Setup, Status
from sumo_eval.cosim import simulate
from sumo_eval.drivers.synthetic import human_controller
from sumo_eval.errors import InputError
from sumo_eval.trajectory import EndReason, Recording

_STATUS: dict[EndReason, Status] = {
    "contact": "collision",
    "standstill": "ok",
    "road_end": "ok",
    "time_limit": "ok",
    "off_road": "off_road",
    "ads_error": "ads_error",
    "ads_timeout": "ads_timeout",
    "sim_error": "sim_error",
}


def run_case(case: Case, setup: Setup) -> Outcome:
    """Simulate a case. Whatever goes wrong in it is part of the outcome."""
    try:
        recording = _simulate(case, setup)
    except InputError as error:
        return Outcome(case, "rejected", None, str(error))
    return Outcome(case, _STATUS[recording.end_reason], recording, recording.error, recording.log)


def _simulate(case: Case, setup: Setup) -> Recording:
    if case.role == "human":
        driver = human_controller(case.driver_index, case.driver_count, case.seed, case.concrete)
        return simulate(case.concrete, driver, setup.simulation)
    return simulate(
        case.concrete, case.controller, setup.simulation, folder=setup.folder, step_timeout=setup.run.step_timeout
    )
