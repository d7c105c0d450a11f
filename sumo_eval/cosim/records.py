"""Numbers of a case: the records of bodies, egos, actors and what rules see of them.

The loop of `cosim` and the rules of `ads` and `drivers` share them.

A row is a case: its ego in `EGO`, its m actors in `OTHER`. x, y and heading of a body are relative
to the road; `map` has them on the map, where they are the same numbers for a straight road. Rules
see a body as a `MOVER`.

Users: `ads/`, `cosim/`, `drivers/synthetic/driver.py`, `record/loops.py`.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_eval.cosim.vehicle_model import LIMITED
from sumo_eval.kernels import Records, fields, flags
from sumo_eval.trajectory import EndReason, FloatArray


class Scenes(NamedTuple):
    """State of n cases with m actors each, and what SUMO shows of them.

    egos, others, clips: (n,), (n, m) and (n, kinds).
    seen: the actors as rules see them, (n, m).
    samples: (n, 1 + m, instants, channels).
    shown: x and y of the front bumper, angle and speed of the actors, (n, m, 4).
    kept: what moved the egos in each step, (n, steps, values): commands where the vehicle model
        moves them all, else their motion as in `_NEXT`.
    """

    egos: Records
    others: Records
    clips: Records
    seen: Records
    samples: FloatArray
    shown: FloatArray
    kept: FloatArray


MOVER = np.dtype(
    fields(
        "x", "y", "heading", "along", "across", "half_length", "half_width", "speed", "braking",
        "curvature",
    )
)  # fmt: skip
"""A vehicle as rules see it.

x, y: of its centre, along and across the road, m; x is nan where there is no vehicle.
along, across: dx/dt and dy/dt, m/s. speed: along its heading, m/s.
half_length, half_width: half its extents along and across the road, m.
braking: deceleration that a rule predicts with, m/s2; 0: the vehicle keeps its velocity.
curvature: of the road at x and the offset y, 1/m, positive to the left.
"""
_MAP = fields("x", "y", "heading")
BODY = fields("x", "y", "heading", "speed", "length", "width", "across")
_BEFORE = [*fields("x", "y", "heading", "speed", "across"), ("map", _MAP)]
_NEXT = fields("x", "y", "heading", "speed", "acceleration", "steering")

_WAY = [*fields("start", "offset", "begin", "length", "by"), *flags("asked", "ends")]
"""The ego's path: at y = `start`, m, then a lane change by `offset` m to the left, from x = `begin`
on and over `length` m.

asked: 1 if it has to make that lane change, finished by x = `by`; 0: there is none.
ends: 1 if its first lane ends at `by`.
"""


def numbers_of(records: Records) -> FloatArray:
    """Records as rows of numbers, (..., fields), without a copy: each field has eight bytes.

    A count appears as the float with the same bits.
    """
    return records.view(np.float64).reshape(*records.shape, records.itemsize // 8)


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

The first fields are those of a `Body`.
before: at the start of the step.
next: the state that a plant gave; of an ego that SUMO moves only its speed, m/s along its lane.
stood: for how long it has stood, s.
scripted_until: when the actors' scripts are over, s.
placed: what moves it: `SUMO`, `MODEL` or `PLANT`.
stale: 1 if SUMO has not received its last motion; of an ego that SUMO moves: 1 if SUMO began to in
    this step.
reason: why the case has ended, a place in `REASONS`; 0: it has not.
struck: number of the actor that it touched.
share: share of the step that had passed at the contact.
settled: 1 if its ADS will do nothing new.
samples: number of its samples.
begun: step of the world at which the case began.
slip, yaw_rate: of the dynamic vehicle model, rad and rad/s.
way: as in `_WAY`."""


def first_number(field: str) -> int:
    """Index of a field's first number among the numbers of an ego (`numbers_of`)."""
    return int(EGO.fields[field][1] // 8)  # type: ignore[index]


COMMAND = slice(first_number("command"), first_number("command") + 2)
"""Place of the command in the numbers of an ego."""
MAP = first_number("map")
NEXT = slice(first_number("next"), first_number("next") + 6)
"""Place of a plant's next state."""

OTHER = np.dtype(
    [
        *BODY, *fields("rate", "acceleration"), ("before", _BEFORE), *fields("front_x", "front_y"),
        *flags("present", "told", "samples", "strays"),
        ("map", _MAP),
    ]
)  # fmt: skip
"""An actor.

rate: of its speed over the last step, m/s2. acceleration: along its heading, m/s2.
present: 0 once it has left the network.
told: 0 if SUMO moved it by itself in this step, 1 if not, 2 if SUMO also received it.
strays: 1 once it has been beside the lanes, from where SUMO moves no vehicle.
"""

CLIP = np.dtype([*flags("count"), *fields("first", "requested", "applied")])
"""A limit that a drive ran into: fields as in `trajectory.Clip`, of the kind `WHATS`[number]."""

PLACES = ("opens", "is_open", "closes", "is_gone", "parted_until", "parted_from")
_ROAD = [
    *fields("length", "right_edge", "left_edge", "lane_width"),
    *flags("lanes", "bent", "shaped"),
    *fields(*(f"{side}_{name}" for side in ("right", "left") for name in PLACES)),
]
"""A road; the fields of `PLACES` are x, m, at which the outermost lane of each side begins to open,
is open, begins to end, is gone, stops being an on-ramp and becomes an exit ramp.
"""
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
"""Values that all rows share; `road`, `vehicle` and `step` as in a `Briefing`.

There are always two of them. The second has a cycle of decisions as its `step`: see `CYCLE`.
"""
CYCLE = 0.05
"""Cycle of decisions, s; a step where that is longer.

A rule that releases the brake below a threshold exceeds the threshold again at once: the finer the
step, the more often. So such a rule decides once a cycle, as a control unit does. The step of the
simulation may be any part of a cycle.
"""

SUMO, MODEL, PLANT = 0, 1, 2  # what moves the ego
REASONS: tuple[EndReason | None, ...] = (
    None, "contact", "standstill", "road_end", "off_road", "time_limit", "decided", "ads_error",
    "ads_timeout",
    "sim_error",
)  # fmt: skip
CONTACT, STANDSTILL, ROAD_END = range(1, 4)
OFF_ROAD, TIME_LIMIT, DECIDED = range(4, 7)
ADS_ERROR, SIM_ERROR = 7, 9

TO_ITS_END: tuple[EndReason, ...] = ("road_end", "time_limit")
"""Reasons of cases that ran to their end: a condition that never became true is reported."""

WHATS = (*LIMITED, "actor_off_its_script")
OFF_SCRIPT = len(LIMITED)
SCRIPT_TOLERANCE = 0.05  # m that SUMO may show an actor off its script
STRAIGHT = 90.0  # deg clockwise from north, SUMO's angle along the road
ALONG = 1e-9  # rad, a smaller heading counts as 0
# rad off the road's direction, up to which an ego in a curve counts as keeping its lane
ALONG_A_BEND = 0.01
DEGREES = 180.0 / math.pi
