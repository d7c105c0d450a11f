"""The scenarios of UN R157 as the reference tables have them, one concrete scenario a row."""

import csv

import pytest
from loaded import SHARED
from road_scenes import at_values

from sumo_eval.cosim import simulate
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start, brake_to_stop, constant_lateral
from sumo_eval.scenario.catalogue import load
from sumo_eval.settings import SimulationSettings, VehicleSettings

TABLES = SHARED / "r157"
G = 9.81  # m/s2
LENGTH, WIDTH = 4.3, 1.9  # m
LANE = 3.5  # m: 1.6 m from edge to edge of bodies in the middle of their lanes
ROAD = Road("r157_road", length=1400.0, lanes=3, lane_width=LANE, run_out=2000.0)
EGO_X = 50.0  # m
SETTINGS = SimulationSettings(
    time_limit=35.0, vehicle=VehicleSettings(length=LENGTH, width=WIDTH), record_interval=0.1
)  # fmt: skip

Row = dict[str, str]


def table(name):
    """The rows of a reference table; the test is skipped where the tables are not."""
    path = TABLES / name
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def kmh(text):
    """Speed in m/s."""
    return float(text) / 3.6


def scene(speed, *actors, x=EGO_X, y=LANE):
    """The ego in the middle lane of three."""
    return ConcreteScenario("r157", {}, 1.0, ROAD, Start(x, y, speed), actors)


def cut_in(speed, other_speed, gap, lateral_speed, *, x=EGO_X, side=1.0, slides=True):
    """A vehicle `gap` m ahead in the lane to the left (side -1: right) begins to come over at t =
    0. m, m/s."""
    start = Start(x + LENGTH + gap, LANE + side * LANE, other_speed)
    move = constant_lateral(0.0, lateral_speed, -side * LANE)
    return scene(speed, Actor("cut_in", start, (move,), LENGTH, WIDTH, slides=slides), x=x)


def cut_out(speed, lead_gap, obstacle_gap, lateral_speed):
    """The lead begins to leave to the left at t = 0 and reveals a standing vehicle `obstacle_gap` m
    ahead of it."""
    lead_x = EGO_X + LENGTH + lead_gap
    move = constant_lateral(0.0, lateral_speed, LANE)
    lead = Actor("lead", Start(lead_x, LANE, speed), (move,), LENGTH, WIDTH, slides=True)
    obstacle = Actor(
        "obstacle", Start(lead_x + LENGTH + obstacle_gap, LANE, 0.0), (), LENGTH, WIDTH
    )
    return scene(speed, lead, obstacle)


RUN_UP = 1.5  # m/s2, with which the JRC's simulator lets the lateral speed of a cut-in build up


def of_row(kind, row, *, run_up=False):
    """The row of a `cut_in`, `cut_out` or `decel` table: the shipped scenario, where its parameters
    can say it.

    run_up: the cut-in of the table begins earlier, its lateral speed built up with `RUN_UP`.
    """
    speed = kmh(row["ve_kmh"])
    if kind == "cut_in":
        other, gap, lateral = kmh(row["vo_kmh"]), float(row["dx0_m"]), float(row["vy_mps"])
        shipped = load(f"cut_in?lateral_acceleration={RUN_UP}" if run_up else "cut_in")
        return shipped.concrete(ego_speed=speed, cut_in_speed=other, gap=gap, lateral_speed=lateral)
    if kind == "cut_out":
        gap, lateral = float(row["dx0_f_m"]), float(row["vy_mps"])
        if row.get("gap_rule", "thw2") == "thw2":
            return at_values(
                "r157_cut_out", ego_speed=speed, obstacle_gap=gap, lateral_speed=lateral
            )
        return cut_out(speed, float(row.get("dx0_m", 2.0 * speed)), gap, lateral)
    gap = float(row["dx0_m"]) if "dx0_m" in row else float(row["thw_s"]) * speed
    deceleration = G * float(row["lead_decel_g"])
    if gap <= 2.5 * speed:
        shipped = load("front_vehicle_braking")
        return shipped.concrete(
            ego_speed=speed, headway=gap / speed, lead_deceleration=deceleration
        )
    start = Start(EGO_X + LENGTH + gap, LANE, speed)
    return scene(speed, Actor("lead", start, (brake_to_stop(0.0, deceleration),), LENGTH, WIDTH))


def collides(concrete, controller, settings=SETTINGS):
    """Whether the ego touches anything within 35 s."""
    recording = simulate(concrete, controller, settings)
    assert recording.error is None, recording.error
    return recording.collision is not None
