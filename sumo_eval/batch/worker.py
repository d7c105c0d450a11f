"""What runs in a child process: one case through SUMO. Imports no more than that needs."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np

from sumo_eval.ads.known_answers import IdealBraking
from sumo_eval.batch.cases import Case, Outcome, Setup, Status
from sumo_eval.batch.watch import watched
from sumo_eval.cosim import simulate
from sumo_eval.cosim.controller import load_controller
from sumo_eval.cosim.vehicle_model import GRAVITY
from sumo_eval.drivers.synthetic import human_controller
from sumo_eval.errors import InputError
from sumo_eval.random_streams import random_stream
from sumo_eval.settings import ConditionSettings, SimulationSettings
from sumo_eval.trajectory import EndReason, Recording

_STATUS: dict[EndReason, Status] = {
    "contact": "collision",
    "standstill": "ok",
    "road_end": "ok",
    "time_limit": "ok",
    "decided": "ok",
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


def _ideal_vehicle(settings: SimulationSettings) -> SimulationSettings:
    """The simulation with the ideal vehicle's own brakes, on a road that can hold them."""
    vehicle = settings.vehicle
    friction = max(vehicle.friction, settings.ideal_deceleration / GRAVITY)
    return replace(
        settings,
        vehicle=replace(
            vehicle,
            max_deceleration=settings.ideal_deceleration,
            brake_build_up=settings.ideal_build_up,
            friction=friction,
        ),
    )


def _simulate(case: Case, setup: Setup) -> Recording:
    if case.role != "ads":  # the conditions and the vehicle model of the ADSs under test are not theirs
        simulation = replace(setup.simulation, conditions=ConditionSettings(), plant=None)
        setup = replace(setup, simulation=simulation)
    if case.role == "human":
        driver = human_controller(case.driver_index, case.driver_count, case.seed, case.concrete, case.population)
        return simulate(case.concrete, driver, setup.simulation)
    if case.role == "ideal":
        settings = _ideal_vehicle(setup.simulation)
        return simulate(case.concrete, IdealBraking(settings.vehicle.max_deceleration), settings)
    _seed_global_generators(case)
    controller = watched(load_controller(case.controller, setup.folder), setup.run)
    return simulate(
        case.concrete,
        controller,
        setup.simulation,
        folder=setup.folder,
        step_timeout=setup.run.step_timeout,
        seed=case.seed,
    )


def _seed_global_generators(case: Case) -> None:
    """An ADS that draws from the global generators draws the same in every run, whatever ran in this process before.

    The point's values choose the stream and not its number, so that a case alone is what it was among others.
    """
    stream = random_stream(case.seed, "ads", case.concrete.scenario, case.concrete.label, case.driver)
    random.seed(int(stream.integers(2**63)))
    np.random.seed(int(stream.integers(2**32)))  # noqa: NPY002 - the generator that such an ADS uses
