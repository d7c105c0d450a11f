"""The world of one case or of many: who is where, what the scripts say, what touched, what ended, what is recorded.

A row is a case: its ego in `EGO`, its m other vehicles in `OTHER`. x, y and heading of a body are those of the road's
frame, along and across it; what rules see of it is a `MOVER`. On a road that bends every body stands on the map as
well (`map`): there the vehicle model moves the ego and contact is judged. On a straight one both are the same numbers,
and nobody looks at the map.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.contact import Body, between, describe, keeps_apart, share_at_touch, within_a_turn
from sumo_eval.cosim.doors.fault_place import fault_place
from sumo_eval.cosim.impossible import BESIDE
from sumo_eval.cosim.sumo.session import NOWHERE
from sumo_eval.cosim.vehicle_model import LIMITED, count_clip, moved, moved_dynamic
from sumo_eval.kernels import kernel, rows
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road, Way, departures
from sumo_eval.scenario.motion import (
    along_heading,
    braked_distance_at,
    braked_speed_at,
    braking_acceleration,
    lateral,
    lateral_acceleration,
    lateral_speed,
)
from sumo_eval.scenario.played import (
    BEGUN,
    DEEPEST,
    FOLLOW,
    WAITS,
    Players,
    begin_play_rows,
    play_rows,
    players,
    wake_rows,
)
from sumo_eval.scenario.road.lanes import left_edge_at, right_edge_at
from sumo_eval.scenario.road.reference_line import curvatures, knots_of, line_at, map_places, to_frame, to_map
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.text import clean, clean_log, traceback_of
from sumo_eval.trajectory import CHANNELS, Alone, Clip, Collision, EndReason, FloatArray, Recording, Trajectory

Records = NDArray[Any]
"""A structured array; each is made in one place, as every other type of it would be compiled again."""


def fields(*names: str) -> list[tuple[str, Any]]:
    """Fields of a record that are numbers."""
    return [(name, "f8") for name in names]


def flags(*names: str) -> list[tuple[str, Any]]:
    """Fields of a record that are counts, codes, or 0 and 1."""
    return [(name, "i8") for name in names]


MOVER = np.dtype(
    fields("x", "y", "heading", "along", "across", "half_length", "half_width", "speed", "braking", "curvature")
)
"""A vehicle as rules see it: along and across the road; x is nan where there is none (`ads.perception`). along: dx/dt,
m/s. curvature: of the road beside it, at the offset y, 1/m, positive to the left."""
_MAP = fields("x", "y", "heading")
_BODY = fields("x", "y", "heading", "speed", "length", "width", "across")
_BEFORE = [*fields("x", "y", "heading", "speed", "across"), ("map", _MAP)]
_NEXT = fields("x", "y", "heading", "speed", "acceleration", "steering")

_WAY = [*fields("start", "offset", "begin", "length", "by"), *flags("asked", "ends")]
"""Where it is to be across the road: where it began, m, and from x = `begin` on, over `length` m, `offset` m further to
the left. asked: 1 if it has to make that lane change, finished by x = `by`; ends: 1 if its first lane ends there."""
EGO = np.dtype(
    [
        *_BODY, *fields("acceleration", "steering"), ("before", _BEFORE), ("next", _NEXT),
        ("command", fields("acceleration", "steering")), ("seen", MOVER),
        *fields("time", "stood", "share", "scripted_until", "front_x", "front_y"),
        *flags("live", "placed", "stale", "reason", "struck", "settled", "samples", "begun"),
        ("map", _MAP), ("way", _WAY), *fields("slip", "yaw_rate"),
    ]
)  # fmt: skip
"""The ego of a case. The first fields are those of a `Body`. placed: who moves it, SUMO, the vehicle model or a plant.
stale: SUMO has it elsewhere by now. reason: why the case has ended, a place in `REASONS`. share: of the step at which
it touched number `struck`. samples: how many there are. begun: the step of the world at which the case began.
slip, yaw_rate: of the dynamic vehicle model, rad and rad/s.
way: as in `_WAY`."""

OTHER = np.dtype(
    [
        *_BODY, *fields("acceleration"), ("before", _BEFORE), *fields("front_x", "front_y"),
        *flags("present", "told", "samples"),
        ("start", fields("x", "y", "speed")),
        ("brake", fields("begin", "deceleration", "jerk", "end")),
        *fields("script_begin", "script_end", "leaves"), *flags("slides", "brakes", "moves", "played"),
        ("map", _MAP),
    ]
)  # fmt: skip
"""Another vehicle and its script. acceleration: the rate of its speed over the last step, m/s2, of a played one that of
its move. told: the harness has moved it in this step. script_begin, script_end: s. leaves: when its script takes it
beside the lanes for good, s: SUMO does not move a vehicle that is on no lane. played: 1 if `scenario.played` or SUMO
moves it."""

MOVE = np.dtype([*fields("begin", "duration", "speed", "offset", "acceleration"), *flags("kind")])
CLIP = np.dtype([*flags("count"), *fields("first", "requested", "applied")])

_ROAD = [
    *fields("length", "right_edge", "left_edge", "lane_width"), *flags("lanes", "bent", "shaped"),
    *fields("right_opens", "right_is_open", "right_closes", "right_is_gone", "right_parted_until", "right_parted_from"),
    *fields("left_opens", "left_is_open", "left_closes", "left_is_gone", "left_parted_until", "left_parted_from"),
]  # fmt: skip
"""Where the outermost lanes are: as in `road.lanes`."""
_LIMITS = fields(
    "length", "width", "wheelbase", "steering_ratio", "max_steering_wheel_angle_deg", "max_steering_wheel_rate_deg",
    "friction", "max_acceleration", "max_deceleration", "brake_build_up", "drive_jerk", "max_speed", "brake_jerk",
    "dynamic", "mass", "yaw_inertia", "front_share", "centre_height", "cornering_stiffness",
)  # fmt: skip
SCENARIO = np.dtype(
    [
        ("road", _ROAD), ("vehicle", _LIMITS),
        *fields("step", "time_limit", "standstill_speed", "standstill_time"), *flags("end_when_decided"),
    ]
)  # fmt: skip
"""What all rows share; `road`, `vehicle` and `step` as in a `Briefing`."""

SUMO, MODEL, PLANT = 0, 1, 2  # who moves the ego
REASONS: tuple[EndReason | None, ...] = (
    None, "contact", "standstill", "road_end", "off_road", "time_limit", "decided", "ads_error", "ads_timeout",
    "sim_error",
)  # fmt: skip
_CONTACT, _STANDSTILL, _ROAD_END, _OFF_ROAD, _TIME_LIMIT, _DECIDED, _ADS_ERROR, _ADS_TIMEOUT, _SIM_ERROR = range(1, 10)

_TO_ITS_END: tuple[EndReason, ...] = ("road_end", "time_limit")
"""Why cases end in which everything could happen that was to: a condition that never held then is worth a word."""

WHATS = (*LIMITED, "actor_off_its_script")
_OFF_SCRIPT = len(LIMITED)
_SCRIPT_TOLERANCE = 0.05  # m, what another vehicle may be off its script
STRAIGHT = 90.0  # deg clockwise from north, SUMO's angle along the road
_ROUNDING = 1e-9  # m
_ALONG = 1e-9  # rad, a heading smaller than this is none
_ALONG_A_BEND = 0.01  # rad, an ego on a bend that keeps its lane turns less than that against the road
_DEGREES = 180.0 / math.pi


# -- what rules see ----------------------------------------------------------------------------------------------------


@kernel
def show(mover: Any, x: float, y: float, heading: float, speed: float, length: float, width: float) -> None:
    """Write into `mover` what a sensor shows of a body: its centre, its speeds and extents by the road's axes."""
    half_length, half_width = 0.5 * length, 0.5 * width
    mover.x, mover.y, mover.speed, mover.braking, mover.curvature = x, y, speed, 0.0, 0.0
    if abs(heading) < _ALONG:
        mover.heading, mover.along, mover.across = 0.0, speed, 0.0
        mover.half_length, mover.half_width = half_length, half_width
        return
    heading = within_a_turn(heading)
    c, s = math.cos(heading), math.sin(heading)
    mover.heading, mover.along, mover.across = heading, speed * c, speed * s
    mover.half_length = half_length * abs(c) + half_width * abs(s)
    mover.half_width = half_length * abs(s) + half_width * abs(c)


@kernel
def show_bend(mover: Any, length: float, width: float, line: Any, rear: float) -> None:
    """Add to what `show` has written what the road's bend is to it. line: the road's, of no knots if straight.

    rear: m from the centre back to the axle that runs along the lane. A body that follows a bend leans out of it there
    by atan(rear * curvature), which takes no more of the road from others than on a straight.
    """
    if len(line):
        _, _, _, curvature = line_at(line, mover.x)
        inner = 1.0 - curvature * mover.y
        mover.along, mover.curvature = mover.along / inner, curvature / inner
        lean = mover.heading + math.atan(rear * mover.curvature)
        c, s = abs(math.cos(lean)), abs(math.sin(lean))
        if s < _ALONG:
            c, s = 1.0, 0.0
        mover.half_length, mover.half_width = 0.5 * (length * c + width * s), 0.5 * (length * s + width * c)


@kernel
def show_body(mover: Any, body: Any, line: Any, rear: float) -> None:
    """Write into `mover` what a sensor shows of a vehicle. line, rear: as in `show_bend`."""
    show(mover, body.x, body.y, body.heading, body.speed, body.length, body.width)
    show_bend(mover, body.length, body.width, line, rear)


@kernel
def put_on_map(body: Any, line: Any) -> float:
    """Put a vehicle of which the frame is known on the map; the share of a metre along the line that it drives there
    for each metre of the line.
    """
    at = body.map
    at.x, at.y, at.heading, curvature = to_map(line, body.x, body.y, body.heading)
    return float(1.0 - curvature * body.y)


@kernel
def find_in_frame(body: Any, line: Any, near: float) -> None:
    """Find a vehicle of which the place on the map is known in the frame. near: about its x there, m."""
    at = body.map
    body.x, body.y, body.heading, _ = to_frame(line, at.x, at.y, at.heading, near)


@kernel
def _keep_map(body: Any) -> None:
    was, at = body.before.map, body.map
    was.x, was.y, was.heading = at.x, at.y, at.heading


@kernel
def _map_body(at: Any, speed: float, across: float, body: Any) -> Body:
    """A vehicle on the map. at: its place there."""
    return Body(at.x, at.y, at.heading, speed, body.length, body.width, across)


@kernel
def _put_front(body: Any, at: Any) -> None:
    """The centre of a vehicle's front bumper. at: what holds its place on the map."""
    body.front_x = at.x + 0.5 * body.length * math.cos(at.heading)
    body.front_y = at.y + 0.5 * body.length * math.sin(at.heading)


@kernel
def _tell(tell: Any, told: int, number: int, body: Any, at: Any) -> None:
    """Write what SUMO hears of a vehicle into a row of `tell`. at: what holds its place on the map."""
    tell[told, 0] = number
    tell[told, 1] = body.front_x
    tell[told, 2] = body.front_y
    tell[told, 3] = STRAIGHT - at.heading * _DEGREES
    tell[told, 4] = body.speed


@kernel
def _tell_on_bend(tell: Any, told: int, number: int, body: Any, line: Any, along: float) -> None:
    """Write what SUMO hears of a vehicle on a bend into a row of `tell`. along: dx/dt, m/s."""
    _put_front(body, body.map)
    _tell(tell, told, number, body, body.map)
    s, d, _, _ = to_frame(line, body.front_x, body.front_y, body.map.heading, body.x + 0.5 * body.length)
    tell[told, 5] = s
    tell[told, 6] = d
    tell[told, 7] = along


# -- scripts -----------------------------------------------------------------------------------------------------------


@kernel
def _is_scripted(other: Any, moves: Any, time: float, step: float) -> bool:
    """Whether the harness moves it at a time; straight on at constant speed, or standing, SUMO does."""
    if time > other.leaves:
        return True
    if not other.script_begin < time < other.script_end:
        return False
    for q in range(other.moves):
        if moves[q].begin < time < moves[q].begin + moves[q].duration + step:
            return True
    return bool(other.brakes and other.brake.begin < time < other.brake.end + step)


@kernel
def _script_x(other: Any, time: float) -> float:
    if other.brakes:
        return float(other.start.x + braked_distance_at(other.brake, other.start.speed, time))
    return float(other.start.x + other.start.speed * time)


@kernel
def _script_y(other: Any, moves: Any, time: float) -> float:
    covered = 0.0
    for q in range(other.moves):
        covered += lateral(moves[q], time)
    return float(other.start.y + covered)


@kernel
def _script_speed(other: Any, time: float) -> float:
    return braked_speed_at(other.brake, other.start.speed, time) if other.brakes else float(other.start.speed)


@kernel
def _script_across(other: Any, moves: Any, time: float) -> float:
    speed = 0.0
    for q in range(other.moves):
        speed += lateral_speed(moves[q], time)
    return speed


@kernel
def _script_acceleration(other: Any, moves: Any, time: float) -> float:
    """Acceleration of another vehicle along its heading as its script has it at a time, m/s2."""
    if not other.script_begin <= time <= other.script_end:
        return 0.0
    braking = braking_acceleration(other.brake, other.start.speed, time) if other.brakes else 0.0
    if other.slides or other.moves == 0:
        return braking
    sideways = 0.0
    for q in range(other.moves):
        sideways += lateral_acceleration(moves[q], time)
    return along_heading(_script_speed(other, time), _script_across(other, moves, time), braking, sideways)


# -- samples -----------------------------------------------------------------------------------------------------------


@kernel
def _sample(samples: Any, vehicle: Any, time: float, acceleration: float, steering: float) -> None:
    """Record a vehicle as it is now, unless it has been at this instant. samples: (instants, channels)."""
    count = vehicle.samples
    if count > 0 and time - samples[count - 1, 0] < 1e-9:
        return
    samples[count, 0] = time
    samples[count, 1] = vehicle.x
    samples[count, 2] = vehicle.y
    samples[count, 3] = vehicle.heading
    samples[count, 4] = vehicle.speed
    samples[count, 5] = acceleration
    samples[count, 6] = steering
    vehicle.samples = count + 1


@kernel
def _sample_row(ego: Any, others: Any, moves: Any, samples: Any) -> None:
    """Record every vehicle of a case at its time."""
    _sample(samples[0], ego, ego.time, ego.acceleration, math.nan if ego.placed == SUMO else ego.steering)
    for j in range(len(others)):
        if others[j].present:
            acceleration = others[j].acceleration
            if others[j].played == 0:
                acceleration = _script_acceleration(others[j], moves[j], ego.time)
            _sample(samples[1 + j], others[j], ego.time, acceleration, math.nan)


@rows
def begin_rows(
    egos: Records, others: Records, moves: Records, seen: Records, samples: FloatArray, scenario: Records,
    line: Records,
) -> None:  # fmt: skip
    """Show and record every vehicle at its start."""
    for i in range(len(egos)):
        ego = egos[i]
        if len(line):
            put_on_map(ego, line)
            _keep_map(ego)
        show_body(ego.seen, ego, line, 0.5 * scenario[0].vehicle.wheelbase)
        for j in range(len(others[i])):
            other = others[i][j]
            if len(line):
                put_on_map(other, line)
                _keep_map(other)
            show_body(seen[i][j], other, line, 0.0)
        _sample_row(ego, others[i], moves[i], samples[i])


@rows
def stop_rows(egos: Records, others: Records, moves: Records, samples: FloatArray, row: int, back: int) -> None:
    """Record a case as it is when it is broken off; back: within a step, of which nothing counts."""
    ego = egos[row]
    if back:
        was = ego.before
        ego.x, ego.y, ego.heading, ego.speed = was.x, was.y, was.heading, was.speed
        ego.map.x, ego.map.y, ego.map.heading = was.map.x, was.map.y, was.map.heading
        for j in range(len(others[row])):
            other = others[row][j]
            was = other.before
            other.x, other.y, other.heading, other.speed = was.x, was.y, was.heading, was.speed
            other.across = was.across
            other.map.x, other.map.y, other.map.heading = was.map.x, was.map.y, was.map.heading
    _sample_row(ego, others[row], moves[row], samples[row])


# -- one step, before and after SUMO's ---------------------------------------------------------------------------------


@rows
def move_rows(
    egos: Records, others: Records, moves: Records, clips: Records, tell: FloatArray, scenario: Records,
    line: Records, steps: int, closely: int,
) -> int:  # fmt: skip
    """Move the egos as they are commanded and the others as their scripts say to the end of so many steps.

    What SUMO has to hear of it is written to `tell`, a row each: number of the vehicle, x and y of the front bumper's
    centre on the map, angle and speed; on a road that bends its place along and across the line and dx/dt besides.
    closely: SUMO hears of everybody; else of those that it takes over in the next step. line: the road's, of no knots
    if it is straight. Returns how many rows of `tell` there are.
    """
    told = 0
    bent = len(line) > 0
    step, limits = scenario[0].step, scenario[0].vehicle
    for i in range(len(egos)):
        ego = egos[i]
        if ego.live == 0 or ego.reason != 0:
            continue
        now = (steps - ego.begun) * step
        before = ego.before
        before.x, before.y, before.heading, before.speed = ego.x, ego.y, ego.heading, ego.speed
        if bent:
            _keep_map(ego)
        if ego.placed == MODEL:
            wanted, steering = ego.command.acceleration, ego.command.steering
            if not math.isfinite(wanted + steering):
                ego.reason = _ADS_ERROR
                continue
            if bent:
                _drive(ego, ego.map, wanted, steering, limits, step, clips[i])
            else:
                _drive(ego, ego, wanted, steering, limits, step, clips[i])
        elif ego.placed == PLANT:
            if bent:
                _go_on(ego, ego.map)
            else:
                _go_on(ego, ego)
        if bent and ego.placed != SUMO:
            find_in_frame(ego, line, before.x + before.speed * step)
            if closely:
                _, _, _, curvature = line_at(line, ego.x)
                along = ego.speed * math.cos(ego.heading) / (1.0 - curvature * ego.y)
                _tell_on_bend(tell, told, i * (1 + len(others[i])), ego, line, along)
                told += 1
        elif ego.placed != SUMO:
            if ego.speed != before.speed or ego.heading != 0.0 or before.heading != 0.0:
                ego.stale = 1
            if closely and ego.stale:
                ego.stale = 0
                _put_front(ego, ego)
                _tell(tell, told, i * (1 + len(others[i])), ego, ego)
                told += 1
        for j in range(len(others[i])):
            other = others[i][j]
            last = other.before
            last.x, last.y, last.heading, last.speed = other.x, other.y, other.heading, other.speed
            last.across = other.across
            other.told = 0
            if bent:
                _keep_map(other)
            if other.present == 0 or other.played or not (bent or _is_scripted(other, moves[i][j], now, step)):
                continue
            other.told = 1
            other.x, other.y = _script_x(other, now), _script_y(other, moves[i][j], now)
            along, across = _script_speed(other, now), _script_across(other, moves[i][j], now)
            ground = along
            if bent:
                if not _is_scripted(other, moves[i][j], now, step):
                    across = 0.0  # as where SUMO drives it
                _, _, _, curvature = line_at(line, other.x)
                ground = along * (1.0 - curvature * other.y)
            if other.slides:
                other.heading, other.speed, other.across = 0.0, ground, across
            else:
                other.heading, other.across = math.atan2(across, ground), 0.0
                other.speed = math.sqrt(ground * ground + across * across)
            if bent:
                put_on_map(other, line)
                if closely or (
                    _is_scripted(other, moves[i][j], now, step)
                    and not _is_scripted(other, moves[i][j], now + step, step)
                ):
                    other.told = 2
                    _tell_on_bend(tell, told, i * (1 + len(others[i])) + 1 + j, other, line, along)
                    told += 1
                continue
            _put_front(other, other)
            if closely or not _is_scripted(other, moves[i][j], now + step, step):
                other.told = 2
                _tell(tell, told, i * (1 + len(others[i])) + 1 + j, other, other)
                told += 1
    return told


@kernel
def _drive(ego: Any, at: Any, wanted: float, steering: float, limits: Any, step: float, clips: Any) -> None:
    """Move an ego by the vehicle model. at: what holds its place on the map."""
    if limits.dynamic > 0.0:
        (
            at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering, ego.slip, ego.yaw_rate,
        ) = moved_dynamic(
            at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering, ego.slip, ego.yaw_rate, wanted, steering,
            limits, step, ego.time, clips,
        )  # fmt: skip
        return
    at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering = moved(
        at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering, wanted, steering, limits, step, ego.time,
        clips,
    )  # fmt: skip


@kernel
def _go_on(ego: Any, at: Any) -> None:
    """Move an ego to where a plant has it next. at: what holds its place on the map."""
    ahead = ego.next
    at.x, at.y, at.heading, ego.speed = ahead.x, ahead.y, ahead.heading, ahead.speed
    ego.acceleration, ego.steering = ahead.acceleration, ahead.steering


@kernel
def _stand(other: Any, at: Any, x: float, y: float, heading: float, speed: float) -> None:
    """Put another vehicle where SUMO shows its front bumper. at: what holds its place on the map."""
    half = 0.5 * other.length
    at.x, at.y = x - half * math.cos(heading), y - half * math.sin(heading)
    at.heading, other.speed, other.across = heading, speed, 0.0


@kernel
def _place(
    other: Any, moves: Any, x: float, y: float, angle: float, speed: float, line: Any, now: float, as_read: int,
    lane_width: float,
) -> None:  # fmt: skip
    """Where another vehicle is at the end of a step: where SUMO shows its front bumper, unless its script moved it.

    as_read: SUMO's angle and speed count too, and its place in any case. Who is on a lane's centre line and has not
    moved is exactly there: on the one lane of `sumo.shared_files` SUMO shows the line and the rounding of an offset.
    """
    half = 0.5 * other.length
    if as_read:
        heading = within_a_turn((STRAIGHT - angle) / _DEGREES) if angle != STRAIGHT else 0.0
        if len(line):
            _stand(other, other.map, x, y, heading, speed)
            find_in_frame(other, line, _script_x(other, now))
        else:
            _stand(other, other, x, y, heading, speed)
        if other.slides and other.script_begin <= now <= other.script_end:
            other.across = _script_across(other, moves, now)
        return
    if other.told:
        return
    other.heading, other.across, other.speed = 0.0, 0.0, _script_speed(other, now)
    if x > NOWHERE:
        other.x, other.y = x - half, y
        centre = lane_width * round(y / lane_width)
        if centre > 0.0 and now <= other.script_begin and other.start.y == centre and abs(y - centre) < _ROUNDING:
            other.y = centre
    else:
        other.x, other.y = _script_x(other, now), _script_y(other, moves, now)


@kernel
def _map_back(body: Any, share: float) -> None:
    """Where a vehicle stood on the map a share of the way through the step."""
    was, at = _map_body(body.before.map, 0.0, 0.0, body), _map_body(body.map, 0.0, 0.0, body)
    here = between(was, at, share)
    body.map.x, body.map.y, body.map.heading = here.x, here.y, here.heading


@kernel
def _go_back(ego: Any, others: Any, share: float, step: float, now: float) -> None:
    """The case as it was a share of the way through the step, when something touched the ego."""
    was = ego.before
    _map_back(ego, share)
    before = Body(was.x, was.y, was.heading, was.speed, ego.length, ego.width, 0.0)
    here = between(before, Body(ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width, 0.0), share)
    ego.x, ego.y, ego.heading, ego.speed = here.x, here.y, here.heading, here.speed
    ego.time = now - step + share * step
    for j in range(len(others)):
        other = others[j]
        was = other.before
        _map_back(other, share)
        before = Body(was.x, was.y, was.heading, was.speed, other.length, other.width, was.across)
        after = Body(other.x, other.y, other.heading, other.speed, other.length, other.width, other.across)
        here = between(before, after, share)
        other.x, other.y, other.heading, other.speed = here.x, here.y, here.heading, here.speed
        other.across = here.across


@kernel
def _end(ego: Any, others: Any, scenario: Any, now: float) -> int:
    """Why a case ends, 0 while it goes on."""
    road = scenario.road
    ego.stood = ego.stood + scenario.step if ego.speed < scenario.standstill_speed else 0.0
    if not right_edge_at(road, ego.x) <= ego.y <= left_edge_at(road, ego.x):
        return _OFF_ROAD
    if ego.x >= road.length:
        return _ROAD_END
    if ego.stood >= scenario.standstill_time - 1e-9:
        return _STANDSTILL
    if now >= scenario.time_limit - 1e-9:
        return _TIME_LIMIT
    if scenario.end_when_decided == 0 or ego.settled == 0 or ego.acceleration != 0.0:
        return 0
    if abs(ego.heading) > (_ALONG_A_BEND if road.bent else 0.0):
        return 0
    if now < ego.scripted_until or ego.way.asked:  # its scripts are not over
        return 0
    body = Body(ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width, 0.0)
    for j in range(len(others)):
        other = others[j]
        there = Body(other.x, other.y, other.heading, other.speed, other.length, other.width, other.across)
        if other.present and not keeps_apart(body, there):
            return 0
    return _DECIDED


@rows
def see_rows(
    egos: Records, others: Records, moves: Records, clips: Records, seen: Records, samples: FloatArray,
    shown: FloatArray, scenario: Records, line: Records, steps: int, sampling: int, as_read: int,
) -> int:  # fmt: skip
    """Take in what SUMO shows at the end of so many steps: places, contact, ends, samples, what rules see next.

    shown: (n, m, 4), x and y of the front bumper, angle and speed; the last two count if `as_read`. line: the road's,
    of no knots if it is straight. Returns how many cases have ended.
    """
    ended = 0
    bent = len(line) > 0
    step, width = scenario[0].step, scenario[0].road.lane_width
    for i in range(len(egos)):
        ego = egos[i]
        if ego.live == 0:
            continue
        if ego.reason != 0:  # broken off in this step
            _sample_row(ego, others[i], moves[i], samples[i])
            ended += 1
            continue
        now = (steps - ego.begun) * step
        was = ego.before
        if bent:
            before = _map_body(was.map, was.speed, 0.0, ego)
            body = _map_body(ego.map, ego.speed, 0.0, ego)
        else:
            before = Body(was.x, was.y, was.heading, was.speed, ego.length, ego.width, 0.0)
            body = Body(ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width, 0.0)
        first = 2.0
        for j in range(len(others[i])):
            other = others[i][j]
            if other.present == 0:
                continue
            _place(
                other, moves[i][j], shown[i, j, 0], shown[i, j, 1], shown[i, j, 2], shown[i, j, 3], line, now, as_read,
                width,
            )  # fmt: skip
            was = other.before
            if other.played == 0:
                other.acceleration = (other.speed - was.speed) / step
            if bent:
                there = _map_body(was.map, was.speed, was.across, other)
                here = _map_body(other.map, other.speed, other.across, other)
            else:
                there = Body(was.x, was.y, was.heading, was.speed, other.length, other.width, was.across)
                here = Body(other.x, other.y, other.heading, other.speed, other.length, other.width, other.across)
            share = share_at_touch(before, body, there, here)
            if 0.0 <= share < first:
                first, ego.struck = share, j
        if first <= 1.0:
            ego.reason, ego.share = _CONTACT, first
            _go_back(ego, others[i], first, step, now)
        else:
            ego.time = now
            ego.reason = _end(ego, others[i], scenario[0], now)
            show_body(ego.seen, ego, line, 0.5 * scenario[0].vehicle.wheelbase)
            for j in range(len(others[i])):
                other = others[i][j]
                show_body(seen[i][j], other, line, 0.0)
                if other.present == 0:
                    seen[i][j].x = math.nan
        if sampling or ego.reason != 0:
            _sample_row(ego, others[i], moves[i], samples[i])
            for j in range(len(others[i])):
                other = others[i][j]
                ahead = other.x - _script_x(other, ego.time)
                left = other.y - _script_y(other, moves[i][j], ego.time)
                off = math.sqrt(ahead * ahead + left * left)
                if other.present and other.played == 0 and off > _SCRIPT_TOLERANCE:
                    count_clip(clips[i], _OFF_SCRIPT, now, 0.0, off)
        if ego.reason != 0:
            ended += 1
    return ended


@rows
def tell_played_rows(
    egos: Records, others: Records, plays: Records, tell: FloatArray, told: int, closely: int, line: Records
) -> int:
    """Write what SUMO has to hear of the played vehicles to `tell`, behind `told` rows of it; how many it then has.

    On a road that bends they are put on the map as well. Of one whose line is there SUMO hears at every step: it is on
    no lane, and has a place only while it is told one.
    """
    bent = len(line) > 0
    for i in range(len(egos)):
        if egos[i].live == 0 or egos[i].reason != 0:
            continue
        for j in range(len(others[i])):
            other = others[i][j]
            other.told = 1
            if plays[i][j].model or other.present == 0:
                continue
            if bent:
                inner = put_on_map(other, line)
            if bent and (closely or plays[i][j].on_map):
                other.told = 2
                along = (other.speed * math.cos(other.heading) - other.across * math.sin(other.heading)) / inner
                _tell_on_bend(tell, told, i * (1 + len(others[i])) + 1 + j, other, line, along)
                told += 1
            elif not bent:
                _put_front(other, other)
                if closely:
                    other.told = 2
                    _tell(tell, told, i * (1 + len(others[i])) + 1 + j, other, other)
                    told += 1
    return told


@rows
def map_played_rows(others: Records, line: Records) -> None:
    """Put the played vehicles on the map of a road that bends."""
    for i in range(len(others)):
        for j in range(len(others[i])):
            if others[i][j].played:
                put_on_map(others[i][j], line)


# -- all of it ---------------------------------------------------------------------------------------------------------


_PLACES = ("opens", "is_open", "closes", "is_gone", "parted_until", "parted_from")


def described(road: Road, vehicle: VehicleSettings, step: float, settings: SimulationSettings | None = None) -> Records:
    """What the rows of a case, or of many like it, share: a `SCENARIO` record in an array of one.

    settings: when cases end; None: nobody asks.
    """
    found = np.zeros(1, SCENARIO)
    for name in ("length", "right_edge", "left_edge", "lane_width", "lanes", "bent", "shaped"):
        found["road"][name] = getattr(road, name)
    for side, lane in (("right", 0), ("left", road.lanes - 1)):
        span = road.span(lane)
        for name, place in zip(_PLACES, (*span.places, span.parted_until, span.parted_from), strict=True):
            found["road"][f"{side}_{name}"] = place
    for name, _ in _LIMITS:
        found["vehicle"][name] = getattr(vehicle, name)
    found["step"] = step
    if settings is not None:
        for name in ("time_limit", "standstill_speed", "standstill_time", "end_when_decided"):
            found[name] = getattr(settings, name)
    return found


class World:
    """Cases that are driven together, on roads of one kind, with as many other vehicles each.

    rows: the numbers of the cases that are held, in the order of the arrays; some of them may have ended.
    """

    def __init__(self, cases: Sequence[ConcreteScenario], settings: SimulationSettings, placed: int = MODEL) -> None:
        self.cases, self.settings = cases, settings
        n, m = len(cases), len(cases[0].actors)
        self.rows = np.arange(n)
        self.steps = 0
        self.ended: dict[int, Callable[..., Recording]] = {}
        self.errors: dict[int, str] = {}
        self.logs: dict[int, str] = {}
        self.places: dict[int, str] = {}  # where in the user's code an exception came from
        self.notes: dict[int, Any] = {}
        self.left: dict[int, Alone] = {}
        self.let_go: set[int] = set()
        self._shared: list[float] = [0.0, 0.0, 0]  # latency: sum, longest, number of answers
        self.latency: list[list[float]] = [[0.0, 0.0, 0] for _ in cases]
        self.scenario = described(cases[0].road, settings.vehicle, settings.step, settings)
        self.line = knots_of(cases[0].road.line)
        self.egos = _egos(cases, settings.vehicle, placed)
        self.others, self.moves = _scripts(cases, settings)
        if m:
            self.egos["scripted_until"] = self.others["script_end"].max(axis=1)
        self.clips = np.zeros((n, len(WHATS)), CLIP)
        self.seen = np.zeros((n, m), MOVER)
        self.shown = np.zeros((n, m, 4))
        self.tell = np.zeros((n * (1 + m), 8))
        self._sampled, self._room = 1, 64
        self.samples = np.zeros((n, 1 + m, self._room, len(CHANNELS)))
        self.reacts = any(case.reacts for case in cases)
        self.players: Players | None = None
        self._stack = np.zeros((DEEPEST, 3))
        if any(case.lively for case in cases):
            self.players = players([case.actors for case in cases])
            self.others["played"], self.egos["scripted_until"] = 1, math.inf
            for i, case in enumerate(cases):
                self.others["heading"][i] = [actor.heading for actor in case.actors]
            self.others["before"]["heading"] = self.others["heading"]
            self._stay_before()
            begin_play_rows(self.egos, self.others, *self.players, self._stack, self.line)
        begin_rows(self.egos, self.others, self.moves, self.seen, self.samples, self.scenario, self.line)
        self.going = n

    def _stay_before(self) -> None:
        """At the start every vehicle was where it is."""
        for name in self.egos["before"].dtype.names or ():
            self.egos["before"][name] = 0.0 if name == "across" else self.egos[name]

    def play(self, now: float, told: int, closely: bool) -> int:
        """Move the played vehicles to the time `now`, s; how many rows of `tell` there are then."""
        if self.players is None:
            return told
        plays, acts, pieces, table, _ = self.players
        play_rows(self.egos, self.others, plays, acts, pieces, table, now, self.line)
        return int(tell_played_rows(self.egos, self.others, plays, self.tell, told, int(closely), self.line))

    def wake(self, now: float) -> None:
        """Begin the moves whose conditions have come to hold in the step that ends `now`, s."""
        if self.players is not None:
            before = self.steps * self.settings.step
            wake_rows(self.egos, self.others, *self.players, now, before, self._stack, self.line)
            if len(self.line):
                map_played_rows(self.others, self.line)

    @property
    def time(self) -> float:
        """s since the start of the cases."""
        return float(self.steps * self.settings.step)

    def note(self, case: int, what: str, requested: float, applied: float) -> None:
        """Count a clip that no kernel counts, and keep its worst instance."""
        if case not in self.notes:
            self.notes[case] = defaultdict(lambda: SimpleNamespace(count=0, first=0.0, requested=0.0, applied=0.0))
        count_clip(self.notes[case], what, self.time, float(requested), float(applied))  # type: ignore[arg-type]

    def keep_fault(self, case: int, error: BaseException, driver: Any, folder: Path | None) -> None:
        """Traceback and place of an exception, for a log and for a table."""
        self.logs[case] = self.logs.get(case, "") + traceback_of(error)
        self.places[case] = self.places.get(case) or fault_place(error, driver, folder)

    def touched(self, counts: Mapping[str, int]) -> None:
        """Put on record how often the ADS of a single case touched what is not its own."""
        for what, count in counts.items():
            self.note(0, what, float(count), float(count))
            self.notes[0][what].count, self.notes[0][what].first = count, 0.0

    def leave(self, row: int, why: Alone) -> None:
        """A case cannot go on beside others, and has to be driven alone from its start."""
        self.left[int(self.rows[row])] = why
        self.egos["reason"][row] = _SIM_ERROR

    def shared_latency(self, took: float) -> None:
        """A step of the driver of all rows took so long for each of them, s."""
        latency = self._shared
        latency[0] += took
        latency[2] += 1
        if took > latency[1]:
            latency[1] = took

    def fail(self, row: int, reason: EndReason, sentence: str, log: str = "") -> None:
        """A case cannot go on; the next look at it ends it."""
        case = int(self.rows[row])
        self.egos["reason"][row] = REASONS.index(reason)
        self.errors[case] = f"{self.errors[case]} {sentence}" if case in self.errors else sentence
        self.logs[case] = self.logs.get(case, "") + log

    def room_for_samples(self, sampling: bool) -> None:
        """Make room for what the coming step records."""
        self._sampled += sampling
        if self._sampled + 2 > self._room:
            self._room *= 2
            rows, vehicles, before, channels = self.samples.shape
            grown = np.zeros((rows, vehicles, self._room, channels))
            grown[:, :, :before] = self.samples
            self.samples = grown

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Hold only these rows, in this order."""
        for name in ("rows", "egos", "others", "moves", "clips", "seen", "shown", "samples"):
            setattr(self, name, getattr(self, name)[rows])
        if self.players is not None:
            self.players = self.players.of(rows)

    def end(self, row: int) -> int:
        """Take down what a case that has ended leaves behind; its number."""
        ego, case = self.egos[row], int(self.rows[row])
        self.egos["live"][row] = 0
        self.going -= 1
        reason = REASONS[int(ego["reason"])]
        assert reason is not None
        if self.players is not None and reason in _TO_ITS_END:
            acts = self.players.acts[row]
            waiting = (acts["state"] == WAITS) & (acts["kind"] != FOLLOW)  # nobody has to depart from a recording
            used = np.arange(waiting.shape[1]) < self.players.plays["acts"][row][:, None]
            if count := int((waiting & used).sum()):
                self.note(case, "trigger_never_fired", float(count), 0.0)
                self.notes[case]["trigger_never_fired"].count = count
        way = ego["way"]
        missed = abs(float(ego["y"]) - float(way["start"] + way["offset"])) > 0.5 * self.cases[case].road.lane_width
        if way["asked"] and missed and ego["x"] >= way["by"]:
            self.note(case, "goal_missed", float(way["by"]), float(ego["y"]))
        concrete, vehicle = self.cases[case], self.settings.vehicle
        actors = concrete.actors
        if concrete.ego.recorded:
            self._note_departure(row, case)
        hit = self._collision(row, actors) if reason == "contact" else None
        if hit is not None and hit.side == "rear" and actors[int(ego["struck"])].model is not None:
            self.note(case, "struck_from_behind", hit.relative_speed, self._in_its_lane_for(row))
        counts = self.others["samples"][row].tolist()
        self.ended[case] = partial(
            Recording,
            self._trajectory(row, 0, int(ego["samples"]), vehicle),
            {actor.name: self._trajectory(row, 1 + j, counts[j], actor) for j, actor in enumerate(actors)},
            hit,
            reason,
            self._clips(row, case),
        )
        return case

    def _note_departure(self, row: int, case: int) -> None:
        """Put on record how far the ego was from where the recorded one was, and who reacted to it from when on."""
        count = int(self.egos["samples"][row])
        time, x, y = self.samples[row, 0, :count, :3].T
        apart = departures(self.cases[case].ego.recorded, time, x, y)
        most = int(apart.argmax())
        self.note(case, "departed", float(apart[most]), float(apart[-1]))
        self.notes[case]["departed"].first = float(time[most])
        if self.players is None:
            return
        acts = self.players.acts[row]
        begins = acts["begin"][(acts["kind"] == FOLLOW) & (acts["state"] == BEGUN)]
        if len(begins):
            self.note(case, "handed_over", float(begins.min()), float(begins.max()))
            self.notes[case]["handed_over"].count, self.notes[case]["handed_over"].first = len(begins), begins.min()

    def _in_its_lane_for(self, row: int) -> float:
        """How long the middle of the ego has been in the lane in which it now is, s."""
        count, width = int(self.egos["samples"][row]), float(self.scenario["road"]["lane_width"][0])
        time, y = self.samples[row, 0, :count, 0], self.samples[row, 0, :count, 2]
        elsewhere = np.flatnonzero(np.round(y / width) != np.round(y[-1] / width))
        return float(time[-1] - time[elsewhere[-1]] if len(elsewhere) else time[-1])

    def recordings(self, wall_time: float) -> list[Recording | Alone]:
        """What each case left behind, or why it has to be driven alone. wall_time: of all of them, s."""
        found: list[Recording | Alone] = []
        for case in range(len(self.cases)):
            if case in self.left:
                found.append(self.left[case])
                continue
            total, longest, answers = self._shared if self._shared[2] else self.latency[case]
            latency = total / max(answers, 1), longest
            recording, error = self.ended[case], self.errors.get(case)
            found.append(
                recording(
                    None if error is None else clean(error),
                    clean_log(self.logs.get(case, "")),
                    latency,
                    wall_time / len(self.cases),
                    self.places.get(case, ""),
                )
            )
        return found

    def _trajectory(self, row: int, vehicle: int, count: int, body: VehicleSettings | Actor) -> Trajectory:
        block = self.samples[row, vehicle, :count].T.copy()
        return Trajectory.of_block(block, length=body.length, width=body.width)

    def _collision(self, row: int, actors: Sequence[Actor]) -> Collision:
        ego = self.egos[row]
        struck = int(ego["struck"])
        ego_body = self._touching(ego, float(ego["x"]))
        time = float(self.samples[row, 0, int(ego["samples"]) - 1, 0])  # a touch at a step's first instant is that one
        return describe(time, actors[struck].name, ego_body, self._touching(self.others[row, struck], float(ego["x"])))

    def _touching(self, vehicle: Any, x: float) -> Body:
        """A vehicle as it stands on the map, in the axes that the road has at x."""
        found = Body(*vehicle.tolist()[:7])
        if not len(self.line):
            return found
        line_x, line_y, along = (float(it) for it in map_places(self.cases[0].road.line, x, 0.0))
        at, c, s = vehicle["map"], math.cos(along), math.sin(along)
        ahead, left = float(at["x"]) - line_x, float(at["y"]) - line_y
        return found._replace(
            x=x + ahead * c + left * s, y=left * c - ahead * s, heading=within_a_turn(float(at["heading"]) - along)
        )

    def _clips(self, row: int, case: int) -> tuple[Clip, ...]:
        found = [
            Clip(WHATS[what], *self.clips[row, what].tolist()) for what in np.flatnonzero(self.clips["count"][row])
        ]
        for what, note in self.notes.get(case, {}).items():
            found.append(Clip(what, note.count, note.first, note.requested, note.applied))
        return tuple(sorted(found, key=lambda clip: clip.what))


def _egos(cases: Sequence[ConcreteScenario], vehicle: VehicleSettings, placed: int) -> Records:
    egos = np.zeros(len(cases), EGO)
    for name in ("x", "y", "speed"):
        egos[name] = [getattr(concrete.ego, name) for concrete in cases]
    egos["length"], egos["width"] = vehicle.length, vehicle.width
    egos["live"], egos["placed"], egos["scripted_until"] = 1, placed, -math.inf
    egos["heading"] = [concrete.ego.heading for concrete in cases]
    egos["before"]["heading"] = egos["heading"]
    egos["front_x"], egos["front_y"] = egos["x"] + 0.5 * vehicle.length, egos["y"]
    egos["way"]["start"], egos["way"]["length"] = egos["y"], 1.0
    for i, concrete in enumerate(cases):
        if concrete.ego.way is not None:
            write_way(egos[i], concrete.ego.way, concrete.ego.y, concrete.ego.speed)
    if placed == MODEL and cases[0].road.bent:
        _put_on_bend(egos, cases[0].road, vehicle)
    return egos


def write_way(ego: Any, way: Way, y: float, speed: float) -> None:
    """Write into a record what lane change an ego has to make that starts at y, m, with a speed, m/s."""
    ego["way"] = (y, way.offset, way.begin, way.length(speed), way.by, 1, int(way.ends))


def _put_on_bend(egos: Records, road: Road, vehicle: VehicleSettings) -> None:
    """Put egos that begin on a bend as those stand who drive it: the rear axle along it, the wheel turned."""
    line, half = curvatures(road.line, egos["x"]), 0.5 * vehicle.wheelbase
    bend = line / (1.0 - line * egos["y"])
    egos["y"] -= bend * half * half / (1.0 + np.sqrt(1.0 + np.square(bend * half)))
    egos["heading"] -= np.arctan(bend * half)
    egos["steering"] = vehicle.steering_ratio * np.arctan(vehicle.wheelbase * bend)


def leaves_the_lanes_at(actor: Actor, road: Road) -> float:
    """When a script takes its vehicle beside the lanes for good, s; inf: never."""
    reach = 0.5 * actor.width - BESIDE

    def beside(time: float) -> bool:
        return not road.right_edge - reach <= actor.y(time) <= road.left_edge + reach

    if beside(0.0):
        return 0.0
    ends = (move.begin for move in actor.lane_changes if beside(move.begin + move.duration))
    return min(ends, default=math.inf)


def _scripts(cases: Sequence[ConcreteScenario], settings: SimulationSettings) -> tuple[Records, Records]:
    """The other vehicles with their scripts, (n, m), and their lateral moves, (n, m, the most that one has)."""
    n, m = len(cases), len(cases[0].actors)
    most = max((len(actor.lane_changes) for concrete in cases for actor in concrete.actors), default=0)
    others, moves = np.zeros((n, m), OTHER), np.zeros((n, m, max(most, 1)), MOVE)
    step = settings.step
    for i, concrete in enumerate(cases):
        for j, actor in enumerate(concrete.actors):
            start, brake = actor.start, actor.brake
            spans = [(move.begin, move.begin + move.duration + step) for move in actor.lane_changes]
            for q, move in enumerate(actor.lane_changes):
                speed, build_up = getattr(move, "speed", 0.0), getattr(move, "acceleration", math.inf)
                moves[i, j, q] = (move.begin, move.duration, speed, move.offset, build_up, move.kind)
            braking = (0.0, 0.0, 0.0, 0.0)
            if brake is not None:
                end = brake.end(start.speed)
                braking = (brake.begin, brake.deceleration, brake.jerk, end)
                spans.append((brake.begin, end + step))
            y = actor.y(0.0)
            pose, nowhere = (start.x, y, 0.0, start.speed), (0.0, 0.0, 0.0)
            others[i, j] = (
                *pose, actor.length, actor.width, 0.0, 0.0, (*pose, 0.0, nowhere), start.x + 0.5 * actor.length, y, 1,
                0, 0,
                (start.x, start.y, start.speed), braking, min((begin for begin, _ in spans), default=math.inf),
                max((end for _, end in spans), default=-math.inf), leaves_the_lanes_at(actor, concrete.road),
                actor.slides, brake is not None,
                len(actor.lane_changes), 0, nowhere,
            )  # fmt: skip
    return others, moves
