"""Known in closed form, reproduced through SUMO: an ego with delay, ramp and plateau behind a
steady target."""

import csv
import math

import pytest
from loaded import SHARED

from sumo_eval.cosim import Command, simulate
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start
from sumo_eval.settings import SimulationSettings, VehicleSettings

TABLE = SHARED / "r157" / "analytic_approach.csv"
ROAD = Road("oracle_road", length=1500.0, lanes=2, lane_width=3.5, run_out=1000.0)
LENGTH = 4.5  # m, ego and target
STEP_BRAKING = 1e-6  # s, the build-up that stands for none
G = 9.81  # m/s2

Row = dict[str, float]


class DelayedBraking:
    """Rolls for `delay` s, then asks for full braking; the vehicle model makes the ramp of it."""

    def __init__(self, delay):
        self.delay = delay

    def step(self, traci, ego, time):
        return Command(-100.0 if time >= self.delay - 1e-9 else 0.0)


def approach(row, gap, target_speed):
    """The row's ego `gap` m behind a target of constant speed."""
    vehicle = VehicleSettings(
        length=LENGTH,
        max_deceleration=row["a_max_mps2"],
        brake_build_up=row["ramp_s"] or STEP_BRAKING,
        friction=2.0,
    )
    target = Actor("target", Start(50.0 + LENGTH + gap, 0.0, target_speed), length=LENGTH)
    concrete = ConcreteScenario(
        "oracle", {}, 1.0, ROAD, Start(50.0, 0.0, target_speed + row["dv0_mps"]), (target,)
    )
    return simulate(
        concrete, DelayedBraking(row["delay_s"]),
        SimulationSettings(time_limit=60.0, vehicle=vehicle)
    )  # fmt: skip


def rows():
    if not TABLE.is_file():
        pytest.skip(f"{TABLE} is not there")
    with TABLE.open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def check(row, target_speed):
    """Collision or none, and impact speed, as the table has them."""
    recording = approach(row, row["gap0_m"], target_speed)
    assert recording.error is None
    collision = recording.collision
    assert (collision is not None) == (row["crash"] == 1.0), row
    if collision is not None:
        impact = math.hypot(*collision.ego_velocity) - math.hypot(*collision.other_velocity)
        assert impact == pytest.approx(row["dv_impact_mps"], abs=0.1), row


def clear_of_the_boundary(table):
    return [row for row in table if abs(row["gap0_m"] - row["gap_required_m"]) > 0.1]


def test_the_approach_is_right_in_every_ninth_row():
    for number, row in enumerate(clear_of_the_boundary(rows())[::9]):
        check(row, target_speed=5.0 * (number % 2))


@pytest.mark.campaign
@pytest.mark.parametrize("target_speed", [0.0, 5.0])
def test_the_approach_is_right_in_every_row(target_speed):
    for row in clear_of_the_boundary(rows()):
        check(row, target_speed)


@pytest.mark.parametrize(
    "speed_kmh, gap", [(30.0, 16.54), (40.0, 24.13), (50.0, 32.73), (60.0, 42.34)]
)
@pytest.mark.parametrize("target_speed", [0.0, 5.0])
def test_the_gap_that_the_careful_driver_needs(speed_kmh, gap, target_speed):
    row = {"dv0_mps": speed_kmh / 3.6, "delay_s": 1.15, "a_max_mps2": 0.774 * G, "ramp_s": 0.6}
    hit, clear = 0.0, 2.0 * gap
    while clear - hit > 0.02:
        middle = 0.5 * (hit + clear)
        if approach(row, middle, target_speed).collision is None:
            clear = middle
        else:
            hit = middle
    assert 0.5 * (hit + clear) == pytest.approx(gap, abs=0.1)
