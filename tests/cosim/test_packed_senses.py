"""What a pack shows of its egos is what SUMO would show of them."""

import math

import numpy as np
from cosim_cases import case, lead

from sumo_eval.ads.perception import Sensor
from sumo_eval.cosim.packed_files import edge_name, packed_network_xml, packed_routes_xml, vehicle_name
from sumo_eval.cosim.packed_senses import egos_as_seen, fronts, shown_angles
from sumo_eval.cosim.packed_vehicle_model import PackedEgos
from sumo_eval.cosim.session import packed_session
from sumo_eval.settings import SimulationSettings

N = 100


def test_a_placed_ego_looks_to_a_sensor_as_computed_to_the_last_bit():
    settings = SimulationSettings()
    rng = np.random.default_rng(3)
    cases = [case(lead(400.0)) for _ in range(N)]
    half_length, half_width = np.full(N, 0.5 * settings.vehicle.length), np.full(N, 0.5 * settings.vehicle.width)
    texts = packed_network_xml(cases[0].road, N), packed_routes_xml(cases, settings.vehicle)
    with packed_session(*texts, settings) as traci:
        for spread in (1e-10, 1e-3, 0.1, 0.5, 2.0):
            heading = np.clip(rng.normal(0.0, spread, N), -math.pi, math.pi)
            heading[:3] = 0.0, -0.0, math.pi / 2.0
            egos = PackedEgos(
                rng.uniform(50.0, 500.0, N), rng.uniform(0.0, 3.5, N), heading, rng.uniform(0.0, 30.0, N),
                np.zeros(N), np.zeros(N), *(np.array([f(h) for h in heading.tolist()]) for f in (math.cos, math.sin)),
            )  # fmt: skip
            front_x, front_y = fronts(egos, half_length[0])
            for row in range(N):
                name, angle = vehicle_name(row, 0), 90.0 - math.degrees(heading[row])
                traci.vehicle.setSpeedMode(name, 32)
                traci.vehicle.setSpeed(name, float(egos.speed[row]))
                traci.vehicle.moveToXY(name, edge_name(row), 0, float(front_x[row]), float(front_y[row]), angle, 3)
            traci.simulationStep()
            seen = egos_as_seen(egos, half_length, half_width)
            angles = shown_angles(heading)
            for row in range(N):
                name = vehicle_name(row, 0)
                assert traci.vehicle.getAngle(name) == angles[row]
                assert Sensor().look(traci, name).me[1:8] == tuple(float(channel[row]) for channel in seen)
