"""One operation count for both sides: knowing the steering wheel's angle changes no D_i."""

import numpy as np
import pytest

from sumo_eval.cosim.simulation import simulate_many
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.method.anthropomorphic import anthropomorphic_index
from sumo_eval.scenario import catalogue
from sumo_eval.settings import AnthropomorphicSettings
from sumo_eval.trajectory import Trajectory

COARSE = AnthropomorphicSettings(slice_spacing=5.0)
LOW_SPEED = [
    (30.0, 20.0),
    (30.0, 15.0),
    (30.0, 10.0),
    (25.0, 15.0),
    (25.0, 10.0),
    (20.0, 10.0),
    (20.0, 5.0),
]
CUT_OUT = [(30.0, 20.0, 120.0), (25.0, 15.0, 100.0), (20.0, 10.0, 90.0)]


def concrete_scenarios():
    low_speed, cut_out = (
        catalogue.load(name) for name in ("front_vehicle_low_speed", "front_vehicle_cut_out")
    )
    return [
        *(low_speed.concrete(ego_speed=v, lead_speed=w) for v, w in LOW_SPEED),
        *(cut_out.concrete(ego_speed=v, obstacle_speed=w, gap=gap) for v, w, gap in CUT_OUT),
    ]


def without_steering(drive):
    return Trajectory(
        drive.time, drive.x, drive.y, drive.heading, drive.speed, drive.acceleration,
        length=drive.length, width=drive.width,
    )  # fmt: skip


def test_lane_changer_has_the_same_d_with_and_without_its_steering_channel():
    cases = concrete_scenarios()
    people = [human_controller(i, 6, 1, concrete) for concrete in cases for i in range(6)]
    drives = iter(
        [found.ego for found in simulate_many([one for one in cases for _ in range(6)], people)]
    )
    overtakes = 0
    for concrete, found in zip(cases, simulate_many(cases, "lane_changer"), strict=True):
        drivers = [next(drives) for _ in range(6)]
        assert np.isfinite(found.ego.steering_wheel_angle).all()
        overtakes += bool(found.ego.y[-1] > 1.75)
        with_it, without = (
            anthropomorphic_index(drive, drivers, concrete.road, COARSE)
            for drive in (found.ego, without_steering(found.ego))
        )
        assert with_it.ingredients.ads_operations == without.ingredients.ads_operations
        assert with_it.value == pytest.approx(without.value, abs=0.02), concrete.label
        stripped = anthropomorphic_index(
            found.ego, [without_steering(one) for one in drivers], concrete.road, COARSE
        )
        assert stripped.value == pytest.approx(with_it.value, abs=0.02), concrete.label
    assert overtakes >= 8, "a lane change is what the steering channel is about"
