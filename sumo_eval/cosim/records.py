"""Numbers of a case: the records of bodies, egos, actors and what rules see of them.

The loop of `cosim` and the rules of `ads` and `drivers` share these records.

A row is a case: an `EGO` record for its ego, `OTHER` records for its m actors. x, y and heading of
a body are relative to the road: x along the road's line, y to the left of it. `map` has x, y and
heading on the map, the same numbers on a straight road. Rules see a body as a `MOVER`.

Fields of numbers have eight bytes each (`numbers_of`), and code elsewhere reads some of them by
index (`first_number`, the first eight of an ego and of an actor). Append new fields at the end of
`EGO` or `OTHER`, not of `BODY`.

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
    commands: what moved the egos in each step, (n, steps, values): their commands if the vehicle
        model moves all egos, else their motion as in `ego_control.Replay`.
    """

    egos: Records
    others: Records
    clips: Records
    seen: Records
    samples: FloatArray
    shown: FloatArray
    commands: FloatArray


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
_BEFORE = [*fields("x", "y", "heading", "speed", "across"), ("map", _MAP), *fields("acceleration")]
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
        *BODY, *fields("acceleration", "steering"), ("before", [*_BEFORE, *fields("steering")]),
        ("next", _NEXT),
        ("command", fields("acceleration", "steering")), ("seen", MOVER),
        *fields("time", "stood", "share", "scripted_until", "front_x", "front_y"),
        *flags("live", "placed", "stale", "reason", "struck", "settled", "samples", "begun"),
        ("map", _MAP), ("way", _WAY), *fields("slip", "yaw_rate"),
    ]
)  # fmt: skip
"""The ego of a case.

The first fields are those of a `touch.Body`: centre, heading, speed, sizes, speed across the road.
acceleration: m/s2. steering: angle of the steering wheel, rad.
before: its motion at the start of the step.
next: the state that a plant gave; of an ego that SUMO moves only its speed, m/s along its lane.
command: acceleration, m/s2, and steering wheel angle, rad, for the next step.
seen: the ego as rules see it.
time: s since the case began.
stood: for how long it has stood, s.
share: share of the step that had passed at the contact.
scripted_until: when the actors' scripts are over, s.
front_x, front_y: centre of the front bumper on the map, m.
live: 0 once its case has ended and left the loop.
placed: what moves it: `SUMO`, `MODEL` or `PLANT`.
stale: of an ego that SUMO moves: 1 in the first step in which SUMO moves it. Of any other ego: 1 if
    SUMO has not received its last motion.
reason: why the case has ended, an index of `REASONS`; 0: it has not.
struck: index of the actor that it touched.
settled: 1 if its ADS will do nothing new.
samples: number of its samples.
begun: step of the world at which the case began.
way: as in `_WAY`.
slip, yaw_rate: of the dynamic vehicle model, rad and rad/s."""


def first_number(field: str) -> int:
    """Index of a field's first number among the numbers of an ego (`numbers_of`)."""
    return int(EGO.fields[field][1] // 8)  # type: ignore[index]


COMMAND = slice(first_number("command"), first_number("command") + 2)
"""Where the command stands among the numbers of an ego."""
MAP = first_number("map")
"""Index of x on the map among these numbers; y and heading follow."""
NEXT = slice(first_number("next"), first_number("next") + 6)
"""Where a plant's next state stands among these numbers."""

OTHER = np.dtype(
    [
        *BODY, *fields("rate", "acceleration"), ("before", _BEFORE), *fields("front_x", "front_y"),
        *flags("present", "told", "samples", "strays"),
        ("map", _MAP),
    ]
)  # fmt: skip
"""An actor; fields without a line here as in `EGO`.

rate: change of its speed over the last step, m/s2. acceleration: along its heading, m/s2.
present: 0 once it has left the network.
told: `LEFT_TO_SUMO` if SUMO moves it along its lane in this step, instead of its script. `SENT` if
    its script moves it and SUMO receives its motion. Else `NOT_SENT`, also where a SUMO model
    drives it.
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
"""A road.

bent: 1 if it is curved. shaped: 1 if lanes open or end on it, or roads cross it.
Fields of `PLACES`: x, m, at which the outermost lane of each side begins to open, is open, begins
to end, is gone, stops being an on-ramp and becomes an exit ramp.
"""
LIMITS = fields(
    "length", "width", "wheelbase", "steering_ratio", "max_steering_wheel_angle_deg",
    "max_steering_wheel_rate_deg",
    "friction", "max_acceleration", "max_deceleration", "brake_build_up", "drive_jerk",
    "max_speed", "brake_jerk",
    "dynamic", "mass", "yaw_inertia", "front_share", "centre_height", "cornering_stiffness",
)  # fmt: skip
"""A vehicle's limits: fields of `VehicleSettings`, in their units."""
SCENARIO = np.dtype(
    [
        ("road", _ROAD), ("vehicle", LIMITS),
        *fields("step", "time_limit", "standstill_speed", "standstill_time"),
        *flags("end_when_decided"),
    ]
)  # fmt: skip
"""Values of the scenario and of the ego's vehicle; `road`, `vehicle` and `step` as in a `Briefing`.

Two such records serve all rows; where cases change the vehicle, each row has two. The second of two
has a cycle of decisions as its `step`: see `CYCLE`.
"""
CYCLE = 0.05
"""Cycle of decisions, s; one step of the simulation if that is longer.

A rule that brakes above a threshold, and releases the brake below it, would switch at every step:
the finer the step, the more often. So such a rule decides once a cycle, as a control unit does. A
cycle is a whole number of steps.
"""

SAME_TIME = 1e-9  # s, rounding of sums of steps
SUMO, MODEL, PLANT = 0, 1, 2  # what moves the ego
LEFT_TO_SUMO, NOT_SENT, SENT = 0, 1, 2  # of an actor, `told`
# These numbers are no order: `step_rules.see_rows` says which reason wins.
REASONS: tuple[EndReason | None, ...] = (
    None, "contact", "standstill", "road_end", "off_road", "time_limit", "decided", "ads_error",
    "ads_timeout",
    "sim_error",
)  # fmt: skip
CONTACT, STANDSTILL, ROAD_END = range(1, 4)
OFF_ROAD, TIME_LIMIT, DECIDED = range(4, 7)
ADS_ERROR, SIM_ERROR = 7, 9

TO_ITS_END: tuple[EndReason, ...] = ("road_end", "time_limit")
"""Reasons of cases that ran to their end. Only of these a condition that never became true is
reported."""

WHATS = (*LIMITED, "actor_off_its_script")
"""Kinds of the clips that kernels count, by number."""
OFF_SCRIPT = len(LIMITED)
SCRIPT_TOLERANCE = 0.05  # m that SUMO may show an actor off its script
STRAIGHT = 90.0  # deg clockwise from north, SUMO's angle along the road
ALONG = 1e-9  # rad, a smaller heading counts as 0
ALONG_A_BEND = 0.01  # rad, a smaller heading in a curve counts as keeping the lane
DEGREES = 180.0 / math.pi
