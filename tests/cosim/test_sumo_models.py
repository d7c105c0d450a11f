"""`sumo:`: Plexe's CC, CACC and EIDM with parameters, and TraCI code that names its vehicle's
type."""

import json
import re

import pytest
from cosim_cases import case, lead
from refusals import refusal
from tables import rows_of

from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.cosim.simulation import simulate
from sumo_eval.settings import SimulationSettings

TEN = SimulationSettings(time_limit=10.0)


@pytest.mark.parametrize(
    "model",
    ["sumo:CC", "sumo:cc?tauEngine=0.3", "sumo:CACC?gapControlGainGap=0.5", "sumo:EIDM?jerkmax=2"],
)
def test_a_model_follows_a_slower_vehicle_without_a_contact(model):
    found = simulate(case(lead(60.0, speed=10.0)), model, SimulationSettings(time_limit=30.0))
    assert (found.error, found.collision) == (None, None)
    assert found.ego.speed[-1] < 13.0


def test_a_parameter_of_plexe_reaches_its_model():
    """Its cruise control (`ccac` 1) slows down to the 12 m/s that it is told, on an empty road."""
    alone = simulate(case(), "sumo:CC", TEN)
    slower = simulate(case(), "sumo:CC?carFollowModel.ccac=1&carFollowModel.ccds=12", TEN)
    assert slower.error is None
    assert slower.ego.speed[-1] < alone.ego.speed[-1] - 3.0


def test_traci_code_names_its_vehicles_type():
    class Platoon:
        vehicle_type = {"carFollowModel": "CC", "tauEngine": 0.3}  # noqa: RUF012

        def reset(self, scenario, traci, ego):
            traci.vehicle.setParameter(ego, "carFollowModel.ccac", "1")
            traci.vehicle.setParameter(ego, "carFollowModel.ccds", "12")
            traci.vehicle.setSpeedMode(ego, 31)
            traci.vehicle.setSpeed(ego, -1)

        def step(self, traci, ego, time):
            """SUMO drives."""

    found = simulate(case(), Platoon, TEN)
    assert found.error is None
    assert found.ego.speed[-1] < 17.0


@pytest.mark.parametrize(
    "given, sentence",
    rows_of(
        """
{"carFollowModel": "CCC"} | Unknown SUMO car-following model `CCC`
{"length": 1.0} | Unknown vType parameter `length`
{"tau": "soon"} | `tau` of `vehicle_type` of Mine must be a finite number
"CC" | must be a dict
""",
        json.loads,
    ),
)
def test_a_type_is_how_the_vehicle_follows_and_nothing_else(given, sentence):
    class Mine:
        vehicle_type = given

        def step(self, traci, ego, time):
            """SUMO drives."""

    with refusal(re.escape(sentence)):
        simulate(case(), Mine, TEN)


def test_an_unknown_model_is_refused_with_the_nearest():
    with refusal(r"Did you mean `CACC`\?"):
        load_controller("sumo:CACCC")
