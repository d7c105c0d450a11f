"""The logical scenarios that ship. Names and parameters are listed in the README."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.locators import load_object
from sumo_eval.scenario.concrete import Actor, Brake, ConstantLateral, EgoBody, LaneChange, Road, Start
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.logical import (
    Approach,
    Constraint,
    LogicalScenario,
    NamedSample,
    Parameter,
    Values,
    ZoneCoordinates,
)
from sumo_eval.trajectory import BoolArray, FloatArray

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

# --- UN R157 ----------------------------------------------------------------------------------------------------------

R157_BODY = EgoBody(length=4.3, width=1.9)  # m, every vehicle of the regulation's examples
R157_TIME = 35.0  # s, the horizon of the public simulators of the regulation's models
R157_ROAD = Road(name="two_lanes_1400m", length=1400.0, lanes=2, lane_width=3.5, run_out=600.0)
_R157 = "UN Regulation No. 157, performance models; ranges cover the grids of JRC-FSM (20..130 km/h) and OSC-ALKS."


def _r157_actor(
    name: str, gap: float, speed: float, y: float = 0.0, move: ConstantLateral | None = None, brake: Brake | None = None
) -> Actor:
    """A vehicle `gap` m (bumper to bumper) ahead of the ego. It slides across: dx0, dy0 and the known outcomes of the
    regulation's scenarios are those of rectangles along the road.
    """
    start = Start(EGO_START + gap + R157_BODY.length, y, speed)
    moves = () if move is None else (move,)
    return Actor(name, start, moves, R157_BODY.length, R157_BODY.width, brake, slides=True)


LEAD_BRAKING_DELAY = 1.0  # s before ideal braking: the paper's for a danger that has to be noticed first


def _braking_approach(values: Values) -> Approach:
    speed = values["ego_speed"]
    gap = speed * values["headway"]
    return Approach(speed, speed, gap, LEAD_BRAKING_DELAY, obstacle_deceleration=values["lead_deceleration"])


def _braking_place(values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
    speed = values["ego_speed"]
    brake = Brake(begin=0.0, deceleration=values["lead_deceleration"])
    return Start(EGO_START, 0.0, speed), (_r157_actor("lead", speed * values["headway"], speed, brake=brake),)


FRONT_VEHICLE_BRAKING = LogicalScenario(
    name="front_vehicle_braking",
    about="The vehicle ahead, as fast as the ego, brakes to a standstill from t = 0 on.",
    source=_R157,
    parameters=(
        Parameter("ego_speed", 5.0, 37.5, 2.5, "m/s", "speed of both at the start"),
        Parameter("headway", 0.5, 2.5, 0.5, "s", "bumper gap over ego speed at the start"),
        Parameter("lead_deceleration", 1.81, 9.81, 2.0, "m/s2", "deceleration of the lead, at once, to a standstill"),
    ),
    constraints=(),
    road=R157_ROAD,
    place=_braking_place,
    approach=_braking_approach,
    ego_body=R157_BODY,
    time_limit=R157_TIME,
)

CUT_IN_APART = R157_ROAD.lane_width - R157_BODY.width  # m, dy0: from edge to edge when the lateral motion begins


CUT_IN_ROAD = replace(R157_ROAD, name="three_lanes_1400m", lanes=3)  # room for a run-up to the left of the lane

_FAR = 100.0  # m


def _cut_in_coordinates(values: Values) -> tuple[FloatArray, ...]:
    closing = values["ego_speed"] - values["cut_in_speed"]
    left = values["gap"] - closing * CUT_IN_APART / values["lateral_speed"]
    return closing, np.tanh(left / _FAR)  # far ahead and long past are each all alike


def _other_slower(values: Values) -> BoolArray:
    return np.asarray(values["cut_in_speed"] < values["ego_speed"])


@dataclass(frozen=True, slots=True)
class _CutInApproach:
    """lateral_acceleration: m/s2 with which the other's lateral speed builds up; inf: at once."""

    lateral_acceleration: float

    def __call__(self, values: Values) -> Approach:
        run_up = values["lateral_speed"] / self.lateral_acceleration
        overlap = run_up + CUT_IN_APART / values["lateral_speed"]
        return Approach(
            values["ego_speed"],
            values["cut_in_speed"],
            values["gap"] + (values["ego_speed"] - values["cut_in_speed"]) * run_up,
            delay=overlap,
            conflict_begin=overlap,
            passing_length=2.0 * R157_BODY.length,
        )


@dataclass(frozen=True, slots=True)
class _CutInPlace:
    """lateral_acceleration: m/s2 with which the other's lateral speed builds up; inf: at once."""

    lateral_acceleration: float

    def __call__(self, values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
        speed = values["lateral_speed"]
        run_up = speed / self.lateral_acceleration
        gap = values["gap"] + (values["ego_speed"] - values["cut_in_speed"]) * run_up
        across = R157_ROAD.lane_width + 0.5 * speed * run_up
        move = ConstantLateral(0.0, speed, -across, self.lateral_acceleration)
        other = _r157_actor("other", gap, values["cut_in_speed"], y=across, move=move)
        return Start(EGO_START, 0.0, values["ego_speed"]), (other,)


CUT_IN = LogicalScenario(
    name="cut_in",
    about="A slower vehicle in the left lane moves into the ego's lane at constant lateral speed.",
    source=_R157,
    parameters=(
        Parameter("ego_speed", 5.0, 40.0, 5.0, "m/s", "Ve0: speed of the ego at the start"),
        Parameter("cut_in_speed", 2.5, 37.5, 5.0, "m/s", "Vo0: speed of the other along the road"),
        Parameter("gap", 0.0, 100.0, 10.0, "m", "dx0: bumper to bumper along the road when the lateral motion begins"),
        Parameter("lateral_speed", 0.2, 3.0, 0.7, "m/s", "Vy: lateral speed of the other until the lane centre"),
    ),
    constraints=(Constraint("one where the other is slower than the ego (cut_in_speed < ego_speed)", _other_slower),),
    road=R157_ROAD,
    place=_CutInPlace(math.inf),
    approach=_CutInApproach(math.inf),
    zone_coordinates=ZoneCoordinates(("closing speed", "gap left when the lane is entered"), _cut_in_coordinates),
    ego_body=R157_BODY,
    time_limit=R157_TIME,
)


def cut_in_with_run_up(lateral_acceleration: float) -> LogicalScenario:
    """`cut_in` with a lateral run-up: dx0, dy0 and Vy are those at the instant at which the lateral speed is reached.

    The run begins earlier, with the other further to the left and the gap larger. lateral_acceleration: m/s2; the JRC's
    simulator has 1.5. The road has a third lane for it.
    """
    if not (math.isfinite(lateral_acceleration) and lateral_acceleration > 0.0):
        raise must_be("`lateral_acceleration`", "scenario `cut_in`", "finite and above 0 m/s2", lateral_acceleration)
    return replace(
        CUT_IN,
        name="cut_in_run_up",
        about="A slower vehicle speeds up sideways, then moves into the ego's lane at constant lateral speed.",
        road=CUT_IN_ROAD,
        place=_CutInPlace(lateral_acceleration),
        approach=_CutInApproach(lateral_acceleration),
    )


R157_CUT_OUT_HEADWAY = 2.0  # s, from the ego to the lead
R157_REVEALED = 0.5  # share of its width by which the lead has to move before the obstacle counts as seen


def _r157_cut_out_gap(ego_speed: FloatArray | float, obstacle_gap: FloatArray | float) -> FloatArray | float:
    """From the ego's front bumper to the obstacle's rear, m."""
    return R157_CUT_OUT_HEADWAY * ego_speed + R157_BODY.length + obstacle_gap


def _r157_cut_out_approach(values: Values) -> Approach:
    speed = values["ego_speed"]
    gap = np.asarray(_r157_cut_out_gap(speed, values["obstacle_gap"]))
    return Approach(speed, np.zeros_like(speed), gap, R157_REVEALED * R157_BODY.width / values["lateral_speed"])


def _r157_cut_out_place(values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
    speed = values["ego_speed"]
    move = ConstantLateral(begin=0.0, speed=values["lateral_speed"], offset=R157_ROAD.lane_width)
    lead = _r157_actor("lead", R157_CUT_OUT_HEADWAY * speed, speed, move=move)
    obstacle = _r157_actor("obstacle", float(_r157_cut_out_gap(speed, values["obstacle_gap"])), 0.0)
    return Start(EGO_START, 0.0, speed), (lead, obstacle)


R157_CUT_OUT = LogicalScenario(
    name="r157_cut_out",
    about="The vehicle ahead leaves the lane at constant lateral speed and reveals a stationary one.",
    source=_R157,
    parameters=(
        Parameter("ego_speed", 5.0, 37.5, 2.5, "m/s", "speed of the ego and of the lead"),
        Parameter("obstacle_gap", 0.0, 100.0, 10.0, "m", "dx0_f: from the lead's front bumper to the obstacle's rear"),
        Parameter("lateral_speed", 0.5, 3.0, 0.5, "m/s", "Vy: lateral speed of the lead until the left lane's centre"),
    ),
    # Where the lead would have to drive through the obstacle the regulation's tables still ask what the ego does.
    constraints=(),
    road=R157_ROAD,
    place=_r157_cut_out_place,
    approach=_r157_cut_out_approach,
    ego_body=R157_BODY,
    time_limit=R157_TIME,
)

# --- Euro NCAP, car to car rear ---------------------------------------------------------------------------------------

NCAP_BODY = EgoBody(length=4.5, width=1.8)  # m, the car under test; `overlap` is a share of its width
NCAP_TARGET = EgoBody(length=4.023, width=1.712)  # m, the global vehicle target, from the same source
NCAP_TIME_TO_COLLISION = 5.0  # s at the start; the protocol asks for more than 4 s
_KMH = 1.0 / 3.6
_OVERLAPS = (-0.5, -0.75, 1.0, 0.75, 0.5)
_NCAP = "Euro NCAP car-to-car rear, as encoded in vectorgrp/OSC-NCAP-scenarios (C2C v4.3.1 of 2023, CA-FC v1.1 of 2026)"
_OVERLAP = Parameter(
    "overlap", -1.0, 1.0, 0.25, "1",
    "share of the ego's width that faces the target; 1 or -1: centred, 0.5: its left half, -0.5: its right",
)  # fmt: skip


def _overlap_possible(values: Values) -> BoolArray:
    return np.asarray(np.abs(values["overlap"]) >= 0.5)


_OVERLAP_EXISTS = Constraint(
    "one where at least half of the ego faces the target (|overlap| >= 0.5)", _overlap_possible
)


def _target(
    values: Mapping[str, float], gap: float, speed: float, brake: Brake | None = None
) -> tuple[Start, tuple[Actor, ...]]:
    """The ego, and the target `gap` m ahead, moved sideways until the overlap is right."""
    overlap = values["overlap"]
    shift = max((NCAP_BODY.width + NCAP_TARGET.width) / 2 - abs(overlap) * NCAP_BODY.width, 0.0)
    y = -shift if overlap < 0.0 else shift  # the sign of the encoded test specification
    x = EGO_START + gap + (NCAP_BODY.length + NCAP_TARGET.length) / 2
    target = Actor("target", Start(x, y, speed), (), NCAP_TARGET.length, NCAP_TARGET.width, brake)
    return Start(EGO_START, 0.0, values["ego_speed"]), (target,)


def _ccrs_approach(values: Values) -> Approach:
    speed = values["ego_speed"]
    return Approach(speed, np.zeros_like(speed), NCAP_TIME_TO_COLLISION * speed, delay=0.0)


def _ccrs_place(values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
    return _target(values, NCAP_TIME_TO_COLLISION * values["ego_speed"], 0.0)


def _matrix(edition: str, *rows: tuple[float, ...]) -> NamedSample:
    """A test matrix of speeds in km/h, m, m/s2 in the columns before `overlap`, at each overlap."""
    points = tuple((*row[:1], overlap, *row[1:]) for overlap in _OVERLAPS for row in rows)
    return NamedSample(f"ncap_{edition}", f"the Euro NCAP matrix of {edition}, AEB and FCW", points)


NCAP_CCRS = LogicalScenario(
    name="ncap_ccrs",
    about="Euro NCAP: a stationary car ahead, 5 s away.",
    source=f"{_NCAP}: 10..80 km/h.",
    parameters=(Parameter("ego_speed", 2.5, 22.5, 2.5, "m/s", "speed of the car under test"), _OVERLAP),
    constraints=(_OVERLAP_EXISTS,),
    road=MOTORWAY,
    place=_ccrs_place,
    approach=_ccrs_approach,
    ego_body=NCAP_BODY,
    samples=(
        _matrix("2026", *((speed * _KMH,) for speed in range(10, 81, 10))),
        _matrix("2023", *((speed * _KMH,) for speed in range(10, 81, 5))),
    ),
    default_sample="ncap_2026",
)


def _ccrm_gap(values: Values) -> FloatArray:
    return NCAP_TIME_TO_COLLISION * np.asarray(values["ego_speed"] - values["lead_speed"])


def _ccrm_approach(values: Values) -> Approach:
    return Approach(values["ego_speed"], values["lead_speed"], _ccrm_gap(values), delay=0.0)


def _ccrm_place(values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
    gap = NCAP_TIME_TO_COLLISION * (values["ego_speed"] - values["lead_speed"])
    return _target(values, gap, values["lead_speed"])


_CCRM_2026 = (*((speed, 20) for speed in range(30, 81, 10)), *((lead + 60, lead) for lead in range(30, 71, 10)))

NCAP_CCRM = LogicalScenario(
    name="ncap_ccrm",
    about="Euro NCAP: a slower car ahead, 5 s away.",
    source=f"{_NCAP}: 30..80 km/h behind 20, and 90 behind 30 to 130 behind 70.",
    parameters=(
        Parameter("ego_speed", 7.5, 37.5, 5.0, "m/s", "speed of the car under test"),
        _OVERLAP,
        Parameter("lead_speed", 5.0, 20.0, 5.0, "m/s", "constant speed of the target"),
    ),
    constraints=(
        _OVERLAP_EXISTS,
        Constraint("one where the target is slower than the ego (lead_speed < ego_speed)", _lead_slower),
    ),
    road=MOTORWAY,
    place=_ccrm_place,
    approach=_ccrm_approach,
    ego_body=NCAP_BODY,
    samples=(
        _matrix("2026", *((ego * _KMH, lead * _KMH) for ego, lead in _CCRM_2026)),
        _matrix("2023", *((speed * _KMH, 20 * _KMH) for speed in range(30, 81, 5))),
    ),
    default_sample="ncap_2026",
)


def _ccrb_approach(values: Values) -> Approach:
    speed, slowing = values["ego_speed"], values["lead_deceleration"]
    return Approach(speed, speed, values["headway_distance"], LEAD_BRAKING_DELAY, obstacle_deceleration=slowing)


def _ccrb_place(values: Mapping[str, float]) -> tuple[Start, tuple[Actor, ...]]:
    brake = Brake(begin=0.0, deceleration=values["lead_deceleration"])
    return _target(values, values["headway_distance"], values["ego_speed"], brake)


NCAP_CCRB = LogicalScenario(
    name="ncap_ccrb",
    about="Euro NCAP: the car ahead, as fast as the ego, brakes to a standstill from t = 0 on.",
    source=f"{_NCAP}: 2023 at 50 km/h, 12 and 40 m, 2 and 6 m/s2, centred; 2026 at 30..80 km/h, 1 s, 4 m/s2.",
    parameters=(
        Parameter("ego_speed", 7.5, 22.5, 5.0, "m/s", "speed of both at the start"),
        _OVERLAP,
        Parameter("headway_distance", 5.0, 40.0, 5.0, "m", "bumper to bumper at the start"),
        Parameter("lead_deceleration", 2.0, 6.0, 1.0, "m/s2", "deceleration of the target, at once, to a standstill"),
    ),
    constraints=(_OVERLAP_EXISTS,),
    road=MOTORWAY,
    place=_ccrb_place,
    approach=_ccrb_approach,
    ego_body=NCAP_BODY,
    samples=(
        _matrix("2026", *((speed * _KMH, 1.0 * speed * _KMH, 4.0) for speed in range(30, 81, 10))),
        NamedSample(
            "ncap_2023",
            "the Euro NCAP matrix of 2023, AEB and FCW",
            tuple((50 * _KMH, 1.0, headway, slowing) for headway in (12.0, 40.0) for slowing in (2.0, 6.0)),
        ),
    ),
    default_sample="ncap_2026",
)

SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        FRONT_VEHICLE_LOW_SPEED,
        FRONT_VEHICLE_CUT_OUT,
        FRONT_VEHICLE_BRAKING,
        CUT_IN,
        R157_CUT_OUT,
        NCAP_CCRS,
        NCAP_CCRM,
        NCAP_CCRB,
    )
}


def find(use: str, folder: Path | None = None) -> LogicalScenario:
    """A logical scenario by its shipped name, or `file.toml`, `module:name`, `file.py:name` relative to `folder`."""
    if use.endswith(".toml"):
        return read_scenario((Path.cwd() if folder is None else folder) / use)
    if ":" not in use:
        return load(use)
    found = load_object(use, folder, "Logical scenario")
    if not isinstance(found, LogicalScenario):
        raise InputError(f"Logical scenario `{use}` must be a LogicalScenario, got {type(found).__name__}.")
    return found


def load(name: str) -> LogicalScenario:
    """The shipped logical scenario of that name. `cut_in?lateral_acceleration=1.5`: with a lateral run-up, m/s2."""
    plain, asks, option = name.partition("?")
    if plain not in SCENARIOS:
        raise unknown("logical scenario", plain, SCENARIOS)
    if not asks:
        return SCENARIOS[plain]
    key, _, value = option.partition("=")
    options = ("lateral_acceleration",) if plain == "cut_in" else ()
    if key not in options:
        raise unknown(f"option of scenario `{plain}`", key, options)
    try:
        lateral_acceleration = float(value)
    except ValueError:
        raise must_be(f"`{key}`", f"scenario `{plain}`", "a number of m/s2", value) from None
    return cut_in_with_run_up(lateral_acceleration)
