"""Drives whose outcome is known in closed form, through SUMO."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.method.criticality import ideal_impact_speed, required_gap
from sumo_eval.scenario.concrete import Brake
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.studies.qualification.check import Check
from sumo_eval.studies.qualification.driven import behind, drive, impact_speed, least_gap

KIND = "closed forms through SUMO"
STRENGTH, BUILD_UP = 9.0, 0.15  # m/s2, s: brakes of the ideal vehicle and of the default vehicle model
IMPACT, GAP = 0.1, 0.05  # m/s, m: bounds
APPROACHES = ((20.0, 0.0, 0.6), (30.0, 10.0, 0.8), (30.0, 0.0, 0.9))
"""Ego's and other's speed, m/s, and gap as a share of what braking needs."""
DELAYED = (
    (10.0, 0.4, 7.59294, 0.6, 6.7356, 9.51065), (30.0, 0.0, 7.59294, 0.6, 34.0758, 22.74802),
    (20.0, 1.15, 7.59294, 0.6, 27.6132, 19.6595), (25.0, 0.4, 9.0, 1e-6, 22.3611, 20.06241),
)  # fmt: skip
"""Closing speed, m/s; delay, s; plateau, m/s2; rise, s; gap, m; impact speed, m/s: integrated apart from this code."""


class _Delayed:
    """Rolls for `delay` s, then asks for all that the brakes have."""

    def __init__(self, delay: float) -> None:
        self.delay = delay

    def step(self, traci: Any, ego: str, time: float) -> Command:
        return Command(-100.0 if time >= self.delay - 1e-9 else 0.0)


def _ideal(speed: float, other: float, gap: float) -> float:
    return impact_speed(drive(behind(speed, other, gap), "ideal_braking"))


def _delayed(closing: float, delay: float, plateau: float, rise: float, gap: float) -> float:
    vehicle = VehicleSettings(length=4.5, max_deceleration=plateau, brake_build_up=rise, friction=2.0)
    return impact_speed(
        drive(behind(closing, 0.0, gap), _Delayed(delay), SimulationSettings(time_limit=60.0, vehicle=vehicle))
    )


def _rolls_into_braking(speed: float, gap: float, braking: float) -> float:
    return impact_speed(drive(behind(speed, speed, gap, Brake(0.0, braking)), "no_reaction"))


def _brakes_alike(speed: float, gap: float) -> float:
    concrete = behind(speed, speed, gap, Brake(0.0, STRENGTH))
    return least_gap(drive(concrete, "ideal_braking", SimulationSettings(time_limit=speed / STRENGTH + 2.0)))


def checks() -> Iterator[Check]:
    """Ideal braking, delayed braking, and behind a lead that brakes."""
    for speed, other, share in APPROACHES:
        gap = round(share * float(required_gap(speed - other, deceleration=STRENGTH, build_up=BUILD_UP)), 2)
        expected = float(ideal_impact_speed(speed, other, gap, deceleration=STRENGTH, build_up=BUILD_UP))
        yield Check(
            KIND, f"ideal braking {speed:g} to {other:g} m/s in {gap:g} m", "ramp and plateau: `ideal_impact_speed`",
            expected, partial(_ideal, speed, other, gap), IMPACT, "m/s",
        )  # fmt: skip
    needed = float(required_gap(25.0, deceleration=STRENGTH, build_up=BUILD_UP)) + 0.1
    yield Check(KIND, "ideal braking, 0.1 m more than it needs", "`required_gap`", 0.0,
                partial(_ideal, 25.0, 0.0, needed), 0.0, "m/s")  # fmt: skip
    for closing, delay, plateau, rise, gap, expected in DELAYED:
        yield Check(
            KIND, f"delay {delay:g} s, rise {rise:.2g} s, from {closing:g} m/s", "closed form, as a number",
            expected, partial(_delayed, closing, delay, plateau, rise, gap), IMPACT, "m/s",
        )  # fmt: skip
    # both at v, the lead at once with a: the gap d is used up after sqrt(2 d / a), sqrt(2 d a) m/s apart
    yield Check(KIND, "no reaction behind a braking lead", "sqrt(2 d a), d = 10 m, a = 5 m/s2", math.sqrt(100.0),
                partial(_rolls_into_braking, 25.0, 10.0, 5.0), IMPACT, "m/s")  # fmt: skip
    # as hard as the lead, only built up over T: the ego comes to stand v T / 2 - a T^2 / 24 further on
    left = 20.0 - 25.0 * BUILD_UP / 2.0 + STRENGTH * BUILD_UP**2 / 24.0
    yield Check(KIND, "as hard as the lead: gap that is left", "d - v T / 2 + a T^2 / 24, d = 20 m, v = 25 m/s", left,
                partial(_brakes_alike, 25.0, 20.0), GAP, "m")  # fmt: skip
