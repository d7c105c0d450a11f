"""The logical scenarios that ship. Names and parameters are listed in the README."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sumo_eval.errors import InputError, unknown
from sumo_eval.locators import load_object
from sumo_eval.scenario.concrete import Actor, LaneChange, Road, Start
from sumo_eval.scenario.logical import Approach, Constraint, LogicalScenario, Parameter, Values
from sumo_eval.trajectory import BoolArray

BODY_LENGTH = 4.5  # m, every vehicle of the paper's scenarios
EGO_START = 50.0  # m along the road, the ego's centre
MOTORWAY = Road(name="two_lanes_600m", length=600.0, lanes=2, lane_width=3.5, run_out=5400.0)

_SPEEDS = "The paper's step; its table of ranges is not public."


def _behind(gap: float) -> float:
    """x of the centre of the vehicle `gap` m (bumper to bumper) ahead of the ego."""
    return EGO_START + gap + BODY_LENGTH


# --- front vehicle low speed ------------------------------------------------------------------------------------------

LOW_SPEED_HEADWAY = 3.5  # s, initial gap over ego speed (paper)


def _low_speed_approach(values: Values) -> Approach:
    return Approach(values["ego_speed"], values["lead_speed"], LOW_SPEED_HEADWAY * values["ego_speed"], delay=0.0)


def _low_speed_place(values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
    gap = LOW_SPEED_HEADWAY * values["ego_speed"]
    lead = Actor("lead", Start(_behind(gap), 0.0, values["lead_speed"]))
    return Start(EGO_START, 0.0, values["ego_speed"]), (lead,)


def _lead_slower(values: Values) -> BoolArray:
    return np.asarray(values["lead_speed"] < values["ego_speed"])


FRONT_VEHICLE_LOW_SPEED = LogicalScenario(
    name="front_vehicle_low_speed",
    about="A slower vehicle drives ahead in the ego's lane, 3.5 s of ego speed away; the left lane is free.",
    source="The paper's first logical scenario; ranges are this project's.",
    parameters=(
        Parameter("ego_speed", 10.0, 30.0, 5.0, "m/s", "speed of the ego at the start"),
        Parameter("lead_speed", 0.0, 20.0, 5.0, "m/s", "constant speed of the vehicle ahead"),
    ),
    constraints=(Constraint("one where the lead is slower than the ego (lead_speed < ego_speed)", _lead_slower),),
    road=MOTORWAY,
    place=_low_speed_place,
    approach=_low_speed_approach,
)

# --- front vehicle cut-out --------------------------------------------------------------------------------------------

CUT_OUT_DURATION = 2.0  # s, the lead's whole lane change: the strongest a car can do (peak 5.1 m/s2 across)
CUT_OUT_CLEARED = 1.3  # s, by then the lead's whole body is beside the obstacle's lane, at any speed of the space
CUT_OUT_HEADWAY = 1.0  # s, the lead's distance over its speed, where there is room for it
CUT_OUT_MIN_GAP = 2.0  # m, the least distance from the ego to the lead
CUT_OUT_DELAY = 1.0  # s before ideal braking (the paper): about the time for which the lead hides the obstacle


def _cut_out_lead_room(values: Values) -> np.ndarray:
    """Largest gap from ego to lead that lets the lead clear the obstacle, m (bumper to bumper)."""
    closing = values["ego_speed"] - values["obstacle_speed"]
    return np.asarray(values["gap"] - BODY_LENGTH - closing * CUT_OUT_CLEARED)


def _cut_out_possible(values: Values) -> BoolArray:
    return np.asarray(_cut_out_lead_room(values) >= CUT_OUT_MIN_GAP)


def _obstacle_slower(values: Values) -> BoolArray:
    return np.asarray(values["obstacle_speed"] < values["ego_speed"])


def _cut_out_approach(values: Values) -> Approach:
    return Approach(values["ego_speed"], values["obstacle_speed"], values["gap"], delay=CUT_OUT_DELAY)


def _cut_out_place(values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
    speed = values["ego_speed"]
    room = float(_cut_out_lead_room({name: np.asarray(value, dtype=np.float64) for name, value in values.items()}))
    lead_gap = min(CUT_OUT_HEADWAY * speed, room)
    lead = Actor(
        "lead",
        Start(_behind(lead_gap), 0.0, speed),
        lane_changes=(LaneChange(begin=0.0, duration=CUT_OUT_DURATION, offset=MOTORWAY.lane_width),),
    )
    obstacle = Actor("obstacle", Start(_behind(values["gap"]), 0.0, values["obstacle_speed"]))
    return Start(EGO_START, 0.0, speed), (lead, obstacle)


FRONT_VEHICLE_CUT_OUT = LogicalScenario(
    name="front_vehicle_cut_out",
    about="The vehicle ahead leaves the lane at the last moment and reveals a slower one.",
    source="The paper's second logical scenario; ranges are this project's.",
    parameters=(
        Parameter("ego_speed", 10.0, 30.0, 5.0, "m/s", "speed of the ego and of the lead"),
        Parameter("obstacle_speed", 0.0, 20.0, 5.0, "m/s", "constant speed of the revealed vehicle"),
        Parameter("gap", 20.0, 120.0, 10.0, "m", "d_c: from the ego's front bumper to the obstacle's rear at t = 0"),
    ),
    constraints=(
        Constraint("one where the obstacle is slower than the ego (obstacle_speed < ego_speed)", _obstacle_slower),
        Constraint(
            "one where the lead can leave the lane before it reaches the obstacle "
            f"(gap >= {CUT_OUT_MIN_GAP + BODY_LENGTH:g} m + {CUT_OUT_CLEARED:g} s * (ego_speed - obstacle_speed))",
            _cut_out_possible,
        ),
    ),
    road=MOTORWAY,
    place=_cut_out_place,
    approach=_cut_out_approach,
)

SCENARIOS = {scenario.name: scenario for scenario in (FRONT_VEHICLE_LOW_SPEED, FRONT_VEHICLE_CUT_OUT)}


def find(use: str, folder: Path | None = None) -> LogicalScenario:
    """A logical scenario by its shipped name, or as `module:name` or `file.py:name` relative to `folder`."""
    if ":" not in use:
        return load(use)
    found = load_object(use, folder, "Logical scenario")
    if not isinstance(found, LogicalScenario):
        raise InputError(f"Logical scenario `{use}` must be a LogicalScenario, got {type(found).__name__}.")
    return found


def load(name: str) -> LogicalScenario:
    """The shipped logical scenario of that name."""
    try:
        return SCENARIOS[name]
    except KeyError:
        raise unknown("logical scenario", name, SCENARIOS) from None
