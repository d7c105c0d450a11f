"""What a case holds as numbers: the records of bodies, egos, other vehicles and what rules see of
them.

A row is a case: its ego in `EGO`, its m other vehicles in `OTHER`. x, y and heading of a body are
those of the road's frame, along and across it; what rules see of it is a `MOVER`. On a road that
bends every body stands on the map as well (`map`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.vehicle_model import LIMITED
from sumo_eval.trajectory import EndReason

Records = NDArray[Any]
"""A structured array; each is made in one place, as every other type of it would be compiled
again."""


Layout = list[tuple[str, Any]]
"""Fields of a record and their types."""


def fields(*names: str) -> Layout:
    """Fields of a record that are numbers."""
    return [(name, "f8") for name in names]


def flags(*names: str) -> Layout:
    """Fields of a record that are counts, codes, or 0 and 1."""
    return [(name, "i8") for name in names]


MOVER = np.dtype(
    fields(
        "x",
        "y",
        "heading",
        "along",
        "across",
        "half_length",
        "half_width",
        "speed",
        "braking",
        "curvature",
    )
)
"""A vehicle as rules see it: along and across the road; x is nan where there is none
(`ads.perception`). along: dx/dt, m/s. curvature: of the road beside it, at the offset y, 1/m,
positive to the left."""
_MAP = fields("x", "y", "heading")
BODY = fields("x", "y", "heading", "speed", "length", "width", "across")
_BEFORE = [*fields("x", "y", "heading", "speed", "across"), ("map", _MAP)]
_NEXT = fields("x", "y", "heading", "speed", "acceleration", "steering")

_WAY = [*fields("start", "offset", "begin", "length", "by"), *flags("asked", "ends")]
"""Where it is to be across the road: where it began, m, and from x = `begin` on, over `length` m,
`offset` m further to the left. asked: 1 if it has to make that lane change, finished by x = `by`;
ends: 1 if its first lane ends there."""
EGO = np.dtype(
    [
        *BODY, *fields("acceleration", "steering"), ("before", _BEFORE), ("next", _NEXT),
        ("command", fields("acceleration", "steering")), ("seen", MOVER),
        *fields("time", "stood", "share", "scripted_until", "front_x", "front_y"),
        *flags("live", "placed", "stale", "reason", "struck", "settled", "samples", "begun"),
        ("map", _MAP), ("way", _WAY), *fields("slip", "yaw_rate"),
    ]
)  # fmt: skip
"""The ego of a case.

The first fields are those of a `Body`. placed: who moves it, SUMO, the vehicle model or a plant.
stale: SUMO has it elsewhere by now. reason: why the case has ended, a place in `REASONS`. share: of
the step at which it touched number `struck`. samples: how many there are. begun: the step of the
world at which the case began.
slip, yaw_rate: of the dynamic vehicle model, rad and rad/s.
way: as in `_WAY`."""

OTHER = np.dtype(
    [
        *BODY, *fields("rate", "acceleration"), ("before", _BEFORE), *fields("front_x", "front_y"),
        *flags("present", "told", "samples", "strays"),
        ("map", _MAP),
    ]
)  # fmt: skip
"""Another vehicle.

acceleration: along its heading, m/s2; rate: of its speed over the last step, m/s2. told: 1 where it
was moved in this step, 2 where SUMO has heard of it. strays: 1 once it has been beside the lanes,
from where SUMO moves no vehicle.
"""

CLIP = np.dtype([*flags("count"), *fields("first", "requested", "applied")])

_ROAD = [
    *fields("length", "right_edge", "left_edge", "lane_width"), *flags("lanes", "bent", "shaped"),
    *fields("right_opens", "right_is_open", "right_closes", "right_is_gone", "right_parted_until",
        "right_parted_from"),
    *fields("left_opens", "left_is_open", "left_closes", "left_is_gone", "left_parted_until",
        "left_parted_from"),
]  # fmt: skip
"""Where the outermost lanes are: as in `road.lanes`."""
LIMITS = fields(
    "length", "width", "wheelbase", "steering_ratio", "max_steering_wheel_angle_deg",
    "max_steering_wheel_rate_deg",
    "friction", "max_acceleration", "max_deceleration", "brake_build_up", "drive_jerk",
    "max_speed", "brake_jerk",
    "dynamic", "mass", "yaw_inertia", "front_share", "centre_height", "cornering_stiffness",
)  # fmt: skip
SCENARIO = np.dtype(
    [
        ("road", _ROAD), ("vehicle", LIMITS),
        *fields("step", "time_limit", "standstill_speed", "standstill_time"),
        *flags("end_when_decided"),
    ]
)  # fmt: skip
"""What all rows share; `road`, `vehicle` and `step` as in a `Briefing`.

There are two: the second has a cycle as its step, in which a rule that jumps decides once.
"""
CYCLE = 0.05
"""s from one decision to the next, or a step where that is longer.

A rule that releases the brake below a threshold exceeds it again at once: the finer the step, the
more often. So what it does depends on when it looks: once a cycle, as a control unit does. The step
of the simulation may be any part of that.
"""

SUMO, MODEL, PLANT = 0, 1, 2  # who moves the ego
REASONS: tuple[EndReason | None, ...] = (
    None, "contact", "standstill", "road_end", "off_road", "time_limit", "decided", "ads_error",
    "ads_timeout",
    "sim_error",
)  # fmt: skip
CONTACT, STANDSTILL, ROAD_END, OFF_ROAD, TIME_LIMIT, DECIDED, ADS_ERROR, _ADS_TIMEOUT, SIM_ERROR = (
    range(1, 10)
)

TO_ITS_END: tuple[EndReason, ...] = ("road_end", "time_limit")
"""Why cases end in which everything could happen that was to: a condition that never held then is
worth a word."""

WHATS = (*LIMITED, "actor_off_its_script")
OFF_SCRIPT = len(LIMITED)
SCRIPT_TOLERANCE = 0.05  # m, what another vehicle may be off its script
STRAIGHT = 90.0  # deg clockwise from north, SUMO's angle along the road
ALONG = 1e-9  # rad, a heading smaller than this is none
# rad, an ego on a bend that keeps its lane turns less than that against the road
ALONG_A_BEND = 0.01
DEGREES = 180.0 / math.pi
