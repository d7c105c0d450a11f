"""What regulations say in numbers, through SUMO."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.ads.eu_2022_1426 import SEATED, STANDING
from sumo_eval.scenario import Actor, ConcreteScenario, ConstantLateral, Road, Start, catalogue
from sumo_eval.scenario.file import scenario_from
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.studies.qualification.check import Check
from sumo_eval.studies.qualification.driven import LENGTH, drive, least_gap, outcome

CONSENSUS, R79, EU = "UN R157, consensus rows", "UN R79, distance S", "(EU) 2022/1426, table"
SETTINGS = SimulationSettings(
    time_limit=35.0, vehicle=VehicleSettings(length=4.3, width=1.9), record_interval=0.1
)  # fmt: skip
G = 9.81  # m/s2

CUT_INS = ((40, 10, 1.2, 18, 26), (60, 30, 1.2, 18, 26), (100, 70, 1.6, 18, 22))
"""Ego's and other's speed, km/h; lateral speed, m/s; gap, m, with contact and without."""
CUT_OUTS = ((70, 1.0, 5, 20), (90, 1.5, 20, 30), (130, 1.5, 50, 75))
"""Speed of both, km/h; lateral speed of the lead, m/s; gap from it to what stands, m, with contact and without."""
BRAKING = ((30, 0.9, 0.4), (60, 0.9, 0.5), (120, 0.8, 0.6))
"""Speed of both, km/h; braking of the lead 1 s ahead, g, with contact and without."""

DISTANCES = ((130, 100, 42.7), (130, 80, 59.9), (120, 100, 35.1), (100, 80, 29.6))
"""Speeds behind and of the ego, km/h, and S, m."""

TABLE = (
    (SEATED, (0.48, 0.71, 0.94, 1.18, 1.41, 1.64)),
    (STANDING, (0.74, 1.32, 1.90, 2.47, 3.05, 3.63)),
)
"""TTC, s, above which a cut-in must be avoided, at closing speeds of 10, 20 .. 60 km/h."""
EU_ROAD = Road("eu_2022_1426_2x3.5m", 2000.0, 2, 3.5, 200.0)


def _of(name: str, **values: float) -> str:
    return outcome(drive(catalogue.load(name).concrete(**values), "careful_driver", SETTINGS))


def consensus() -> Iterator[Check]:
    """Neighbouring rows on both sides of the limit, in which independent readings of the careful driver agree."""

    def row(name: str, expected: str, shipped: str, **values: float) -> Check:
        return Check(
            CONSENSUS, name, "independent readings of Annex 3 agree", expected, partial(_of, shipped, **values)
        )

    for ego, other, lateral, hit, clear in CUT_INS:
        for gap, expected in ((hit, "contact"), (clear, "avoided")):
            yield row(f"cut-in {ego} to {other} km/h, {lateral} m/s, {gap} m", expected, "cut_in",
                      ego_speed=ego / 3.6, cut_in_speed=other / 3.6, gap=float(gap), lateral_speed=lateral)  # fmt: skip
    for ego, lateral, hit, clear in CUT_OUTS:
        for gap, expected in ((hit, "contact"), (clear, "avoided")):
            yield row(f"cut-out {ego} km/h, {lateral} m/s, {gap} m", expected, "r157_cut_out",
                      ego_speed=ego / 3.6, obstacle_gap=float(gap), lateral_speed=lateral)  # fmt: skip
    for ego, hit_g, clear_g in BRAKING:
        for braking, expected in ((hit_g, "contact"), (clear_g, "avoided")):
            yield row(f"lead brakes {ego} km/h, 1 s, {braking} g", expected, "front_vehicle_braking",
                      ego_speed=ego / 3.6, headway=1.0, lead_deceleration=G * braking)  # fmt: skip


def _margin(ego: float, faster: float) -> float:
    """S as the shipped scenario has it: its zone begins where the gap is S."""
    margin = catalogue.load("lane_change_rear").margin
    assert margin is not None
    point = {"ego_speed": np.array([ego]), "faster": np.array([faster]), "gap": np.array([100.0])}
    return 100.0 - float(margin(point)[0])


def _left(ego: float, faster: float, gap: float) -> float:
    """Time gap, s, that is left of `gap` m when whoever is behind has braked 3 m/s2 from 0.4 s on."""
    content: dict[str, Any] = {
        "name": "un_r79", "zone": "none", "ego": {"speed": ego, "x": 150.0}, "end": {"x": 600.0, "time": 8.0},
        "parameter": [{"name": "gap", "unit": "m", "low": 10.0, "high": 90.0, "step": 10.0}],
        "vehicle": [{"name": "rear", "speed": ego + faster, "gap_behind": "gap", "manoeuvre": [
            {"do": "accelerate", "when": "time >= 0", "begin": 0.4, "speed": ego, "acceleration": 3.0}]}],
    }  # fmt: skip
    found = drive(scenario_from(content, "un_r79", Path()).concrete(gap=gap), "no_reaction")
    return float(found.ego.x[-1] - found.actors["rear"].x[-1] - LENGTH) / ego


def un_r79() -> Iterator[Check]:
    """S of the regulation, and that who is behind by S is left with 1 s."""
    for behind, own, distance in DISTANCES:
        ego, faster = own / 3.6, (behind - own) / 3.6
        yield Check(R79, f"S, {behind} behind {own} km/h", "dv 0.4 s + dv^2 / (2 * 3 m/s2) + v * 1 s", distance,
                    partial(_margin, ego, faster), 0.06, "m")  # fmt: skip
    for behind, own, _ in DISTANCES[:2]:
        ego, faster = own / 3.6, (behind - own) / 3.6
        s = faster * 0.4 + faster * faster / 6.0 + ego
        yield Check(R79, f"left of S, {behind} behind {own} km/h", "1 s is left of a gap of S", 1.0,
                    partial(_left, ego, faster, s), 1e-6, "s")  # fmt: skip


def _cut_in(closing: float, ttc: float) -> ConcreteScenario:
    """Somebody who crosses at 1 m/s, with that TTC when 0.30 m over the line, 1.15 m from its lane's middle."""
    speed = 60.0 / 3.6 + 10.0
    start = Start(100.0 + LENGTH + closing * (ttc + 1.15), 3.5, speed - closing)
    other = Actor("other", start, (ConstantLateral(0.0, 1.0, -3.5),), slides=True)
    return ConcreteScenario("eu_2022_1426", {"closing": closing}, 1.0, EU_ROAD, Start(100.0, 0.0, speed), (other,))


def _spared(closing: float, ttc: float, ads: str) -> float:
    return least_gap(drive(_cut_in(closing, ttc), ads))


def eu_2022_1426() -> Iterator[Check]:
    """0.05 s above each value of the table the demanded vehicle avoids with the margin that its braking gives."""
    for granted, values in TABLE:
        for kph, ttc in zip(range(10, 70, 10), values, strict=True):
            # 0.1 m that it keeps, and a tau^2 / 24 that braking built up over tau saves
            margin = 0.1 + granted.braking * granted.build_up**2 / 24.0
            yield Check(EU, f"{granted.ads.removeprefix('eu_2022_')} {kph} km/h, TTC {ttc:.2f} + 0.05 s",
                        "Annex III: avoided, 0.1 m + a tau^2 / 24 left", margin,
                        partial(_spared, kph / 3.6, ttc + 0.05, granted.ads), 0.01, "m")  # fmt: skip
