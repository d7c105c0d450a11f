"""The scenarios of UN R157 as the reference tables have them, one concrete scenario a row."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from sumo_eval.cosim import simulate
from sumo_eval.cosim.controller import ControllerLike
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start
from sumo_eval.scenario.concrete import Brake, ConstantLateral
from sumo_eval.settings import SimulationSettings, VehicleSettings

TABLES = Path(__file__).parents[2].parent / "shared" / "data" / "r157"
G = 9.81  # m/s2
LENGTH, WIDTH = 4.3, 1.9  # m
LANE = 3.5  # m: 1.6 m from edge to edge of bodies in the middle of their lanes
ROAD = Road("r157_road", length=1400.0, lanes=3, lane_width=LANE, run_out=2000.0)
EGO_X = 50.0  # m
SETTINGS = SimulationSettings(
    time_limit=35.0, vehicle=VehicleSettings(length=LENGTH, width=WIDTH), record_interval=0.1
)  # fmt: skip

Row = dict[str, str]


class Sliding(Actor):
    """A vehicle that keeps its heading while it moves across, like the upright rectangles of the tables."""

    __slots__ = ()

    def lateral_speed(self, time: float) -> float:
        return 0.0


def table(name: str) -> list[Row]:
    """The rows of a reference table; the test is skipped where the tables are not."""
    path = TABLES / name
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def kmh(text: str) -> float:
    """Speed in m/s."""
    return float(text) / 3.6


def scene(speed: float, *actors: Actor, x: float = EGO_X, y: float = LANE) -> ConcreteScenario:
    """The ego in the middle lane of three."""
    return ConcreteScenario("r157", {}, 1.0, ROAD, Start(x, y, speed), actors)


def cut_in(
    speed: float,
    other_speed: float,
    gap: float,
    lateral_speed: float,
    *,
    x: float = EGO_X,
    side: float = 1.0,
    vehicle: type[Actor] = Sliding,
) -> ConcreteScenario:
    """A vehicle `gap` m ahead in the lane to the left (side -1: right) begins to come over at t = 0. m, m/s."""
    start = Start(x + LENGTH + gap, LANE + side * LANE, other_speed)
    move = ConstantLateral(0.0, lateral_speed, -side * LANE)
    return scene(speed, vehicle("cut_in", start, (move,), LENGTH, WIDTH), x=x)


def cut_out(speed: float, lead_gap: float, obstacle_gap: float, lateral_speed: float) -> ConcreteScenario:
    """The lead begins to leave to the left at t = 0 and reveals a standing vehicle `obstacle_gap` m ahead of it."""
    lead_x = EGO_X + LENGTH + lead_gap
    lead = Sliding("lead", Start(lead_x, LANE, speed), (ConstantLateral(0.0, lateral_speed, LANE),), LENGTH, WIDTH)
    obstacle = Actor("obstacle", Start(lead_x + LENGTH + obstacle_gap, LANE, 0.0), (), LENGTH, WIDTH)
    return scene(speed, lead, obstacle)


def braking(speed: float, gap: float, deceleration: float) -> ConcreteScenario:
    """The lead, as fast as the ego, brakes from t = 0."""
    start = Start(EGO_X + LENGTH + gap, LANE, speed)
    return scene(speed, Actor("lead", start, (), LENGTH, WIDTH, Brake(0.0, deceleration)))


def of_row(kind: str, row: Row) -> ConcreteScenario:
    """The row of a `cut_in`, `cut_out` or `decel` table."""
    speed = kmh(row["ve_kmh"])
    if kind == "cut_in":
        return cut_in(speed, kmh(row["vo_kmh"]), float(row["dx0_m"]), float(row["vy_mps"]))
    if kind == "cut_out":
        lead_gap = float(row["dx0_m"]) if "dx0_m" in row else 2.0 * speed
        return cut_out(speed, lead_gap, float(row["dx0_f_m"]), float(row["vy_mps"]))
    gap = float(row["dx0_m"]) if "dx0_m" in row else float(row["thw_s"]) * speed
    return braking(speed, gap, G * float(row["lead_decel_g"]))


def collides(concrete: ConcreteScenario, controller: ControllerLike, settings: SimulationSettings = SETTINGS) -> bool:
    """Whether the ego touches anything within 35 s."""
    recording = simulate(concrete, controller, settings)
    assert recording.error is None, recording.error
    return recording.collision is not None
