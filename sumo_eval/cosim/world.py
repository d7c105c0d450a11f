"""The world of one case or of many: who is where, what the scripts say, what touched, what ended, what is recorded.

A row is a case: its ego in `EGO`, its m other vehicles in `OTHER`. Bodies are in the map's coordinates; what rules see
of them is a `MOVER`, along and across the road. On a straight road both are the same numbers.
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
from sumo_eval.cosim.vehicle_model import LIMITED, count_clip, moved
from sumo_eval.kernels import kernel, rows
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road
from sumo_eval.scenario.motion import (
    along_heading,
    braked_distance_at,
    braked_speed_at,
    braking_acceleration,
    lateral,
    lateral_acceleration,
    lateral_speed,
)
from sumo_eval.scenario.played import DEEPEST, WAITS, Players, begin_play_rows, play_rows, players, wake_rows
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.text import clean, clean_log, traceback_of
from sumo_eval.trajectory import CHANNELS, Clip, Collision, EndReason, FloatArray, Recording, Trajectory

Records = NDArray[Any]
"""A structured array; each is made in one place, as every other type of it would be compiled again."""


def fields(*names: str) -> list[tuple[str, Any]]:
    """Fields of a record that are numbers."""
    return [(name, "f8") for name in names]


def flags(*names: str) -> list[tuple[str, Any]]:
    """Fields of a record that are counts, codes, or 0 and 1."""
    return [(name, "i8") for name in names]


MOVER = np.dtype(fields("x", "y", "heading", "along", "across", "half_length", "half_width", "speed", "braking"))
"""A vehicle as rules see it: along and across the road; x is nan where there is none (`ads.perception`)."""
_BODY = fields("x", "y", "heading", "speed", "length", "width", "across")
_BEFORE = fields("x", "y", "heading", "speed", "across")
_NEXT = fields("x", "y", "heading", "speed", "acceleration", "steering")

EGO = np.dtype(
    [
        *_BODY, *fields("acceleration", "steering"), ("before", _BEFORE), ("next", _NEXT),
        ("command", fields("acceleration", "steering")), ("seen", MOVER),
        *fields("time", "stood", "share", "scripted_until", "front_x", "front_y"),
        *flags("live", "placed", "stale", "reason", "struck", "settled", "samples"),
    ]
)  # fmt: skip
"""The ego of a case. The first fields are those of a `Body`. placed: who moves it, SUMO, the vehicle model or a plant.
stale: SUMO has it elsewhere by now. reason: why the case has ended, a place in `REASONS`. share: of the step at which
it touched number `struck`. samples: how many there are."""

OTHER = np.dtype(
    [
        *_BODY, *fields("acceleration"), ("before", _BEFORE), *fields("front_x", "front_y"),
        *flags("present", "told", "samples"),
        ("start", fields("x", "y", "speed")),
        ("brake", fields("begin", "deceleration", "jerk", "end")),
        *fields("script_begin", "script_end", "leaves"), *flags("slides", "brakes", "moves", "played"),
    ]
)  # fmt: skip
"""Another vehicle and its script. told: the harness has moved it in this step. script_begin, script_end: s. leaves:
when its script takes it beside the lanes for good, s: SUMO does not move a vehicle that is on no lane. played: 1 if
`scenario.played` or SUMO moves it."""

MOVE = np.dtype([*fields("begin", "duration", "speed", "offset", "acceleration"), *flags("kind")])
CLIP = np.dtype([*flags("count"), *fields("first", "requested", "applied")])

_ROAD = [*fields("length", "right_edge", "left_edge", "lane_width"), *flags("lanes")]
_LIMITS = fields(
    "length", "width", "wheelbase", "steering_ratio", "max_steering_wheel_angle_deg", "max_steering_wheel_rate_deg",
    "friction", "max_acceleration", "max_deceleration", "brake_build_up", "drive_jerk", "max_speed", "brake_jerk",
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

WHATS = (*LIMITED, "actor_off_its_script")
_OFF_SCRIPT = len(LIMITED)
_SCRIPT_TOLERANCE = 0.05  # m, what another vehicle may be off its script
STRAIGHT = 90.0  # deg clockwise from north, SUMO's angle along the road
_ALONG = 1e-9  # rad, a heading smaller than this is none
_DEGREES = 180.0 / math.pi


# -- what rules see ----------------------------------------------------------------------------------------------------


@kernel
def show(mover: Any, x: float, y: float, heading: float, speed: float, length: float, width: float) -> None:
    """Write into `mover` what a sensor shows of a body: its centre, its speeds and extents by the road's axes."""
    half_length, half_width = 0.5 * length, 0.5 * width
    mover.x, mover.y, mover.speed, mover.braking = x, y, speed, 0.0
    if abs(heading) < _ALONG:
        mover.heading, mover.along, mover.across = 0.0, speed, 0.0
        mover.half_length, mover.half_width = half_length, half_width
        return
    heading = within_a_turn(heading)
    c, s = math.cos(heading), math.sin(heading)
    mover.heading, mover.along, mover.across = heading, speed * c, speed * s
    mover.half_length = half_length * abs(c) + half_width * abs(s)
    mover.half_width = half_length * abs(s) + half_width * abs(c)


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
    """Record a vehicle as it is now, unless it has been at this instant. samples: (channels, instants)."""
    count = vehicle.samples
    if count > 0 and time - samples[0, count - 1] < 1e-9:
        return
    samples[0, count] = time
    samples[1, count] = vehicle.x
    samples[2, count] = vehicle.y
    samples[3, count] = vehicle.heading
    samples[4, count] = vehicle.speed
    samples[5, count] = acceleration
    samples[6, count] = steering
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
def begin_rows(egos: Records, others: Records, moves: Records, seen: Records, samples: FloatArray) -> None:
    """Show and record every vehicle at its start."""
    for i in range(len(egos)):
        ego = egos[i]
        show(ego.seen, ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width)
        for j in range(len(others[i])):
            other = others[i][j]
            show(seen[i][j], other.x, other.y, other.heading, other.speed, other.length, other.width)
        _sample_row(ego, others[i], moves[i], samples[i])


@rows
def stop_rows(egos: Records, others: Records, moves: Records, samples: FloatArray, row: int, back: int) -> None:
    """Record a case as it is when it is broken off; back: within a step, of which nothing counts."""
    ego = egos[row]
    if back:
        was = ego.before
        ego.x, ego.y, ego.heading, ego.speed = was.x, was.y, was.heading, was.speed
        for j in range(len(others[row])):
            other = others[row][j]
            was = other.before
            other.x, other.y, other.heading, other.speed = was.x, was.y, was.heading, was.speed
            other.across = was.across
    _sample_row(ego, others[row], moves[row], samples[row])


# -- one step, before and after SUMO's ---------------------------------------------------------------------------------


@rows
def move_rows(
    egos: Records, others: Records, moves: Records, clips: Records, tell: FloatArray, scenario: Records,
    now: float, closely: int,
) -> int:  # fmt: skip
    """Move the egos as they are commanded and the others as their scripts say to the time `now`, s.

    What SUMO has to hear of it is written to `tell`, a row each: number of the vehicle, x and y of the front bumper's
    centre, angle and speed. closely: SUMO hears of everybody; else of those that it takes over in the next step.
    Returns how many rows of `tell` there are.
    """
    told = 0
    step, limits = scenario[0].step, scenario[0].vehicle
    for i in range(len(egos)):
        ego = egos[i]
        if ego.live == 0 or ego.reason != 0:
            continue
        before = ego.before
        before.x, before.y, before.heading, before.speed = ego.x, ego.y, ego.heading, ego.speed
        if ego.placed == MODEL:
            wanted, steering = ego.command.acceleration, ego.command.steering
            if not math.isfinite(wanted + steering):
                ego.reason = _ADS_ERROR
                continue
            ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, ego.steering = moved(
                ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, ego.steering, wanted, steering, limits, step,
                ego.time, clips[i],
            )  # fmt: skip
        elif ego.placed == PLANT:
            ahead = ego.next
            ego.x, ego.y, ego.heading, ego.speed = ahead.x, ahead.y, ahead.heading, ahead.speed
            ego.acceleration, ego.steering = ahead.acceleration, ahead.steering
        if ego.placed != SUMO:
            if ego.speed != before.speed or ego.heading != 0.0 or before.heading != 0.0:
                ego.stale = 1
            if closely and ego.stale:
                ego.stale = 0
                ego.front_x = ego.x + 0.5 * ego.length * math.cos(ego.heading)
                ego.front_y = ego.y + 0.5 * ego.length * math.sin(ego.heading)
                tell[told, 0] = i * (1 + len(others[i]))
                tell[told, 1] = ego.front_x
                tell[told, 2] = ego.front_y
                tell[told, 3] = STRAIGHT - ego.heading * _DEGREES
                tell[told, 4] = ego.speed
                told += 1
        for j in range(len(others[i])):
            other = others[i][j]
            last = other.before
            last.x, last.y, last.heading, last.speed = other.x, other.y, other.heading, other.speed
            last.across = other.across
            other.told = 0
            if other.present == 0 or other.played or not _is_scripted(other, moves[i][j], now, step):
                continue
            other.told = 1
            other.x, other.y = _script_x(other, now), _script_y(other, moves[i][j], now)
            along, across = _script_speed(other, now), _script_across(other, moves[i][j], now)
            if other.slides:
                other.heading, other.speed, other.across = 0.0, along, across
            else:
                other.heading, other.across = math.atan2(across, along), 0.0
                other.speed = math.sqrt(along * along + across * across)
            other.front_x = other.x + 0.5 * other.length * math.cos(other.heading)
            other.front_y = other.y + 0.5 * other.length * math.sin(other.heading)
            if closely or not _is_scripted(other, moves[i][j], now + step, step):
                other.told = 2
                tell[told, 0] = i * (1 + len(others[i])) + 1 + j
                tell[told, 1] = other.front_x
                tell[told, 2] = other.front_y
                tell[told, 3] = STRAIGHT - other.heading * _DEGREES
                tell[told, 4] = other.speed
                told += 1
    return told


@kernel
def _place(other: Any, moves: Any, x: float, y: float, angle: float, speed: float, now: float, as_read: int) -> None:
    """Where another vehicle is at the end of a step: where SUMO shows its front bumper, unless its script moved it.

    as_read: SUMO's angle and speed count too, and its place in any case.
    """
    half = 0.5 * other.length
    if as_read:
        heading = within_a_turn((STRAIGHT - angle) / _DEGREES) if angle != STRAIGHT else 0.0
        other.x, other.y = x - half * math.cos(heading), y - half * math.sin(heading)
        other.heading, other.speed, other.across = heading, speed, 0.0
        if other.slides and other.script_begin <= now <= other.script_end:
            other.across = _script_across(other, moves, now)
        return
    if other.told:
        return
    other.heading, other.across, other.speed = 0.0, 0.0, _script_speed(other, now)
    other.x, other.y = (x - half, y) if x > NOWHERE else (_script_x(other, now), _script_y(other, moves, now))


@kernel
def _go_back(ego: Any, others: Any, share: float, step: float, now: float) -> None:
    """The case as it was a share of the way through the step, when something touched the ego."""
    was = ego.before
    before = Body(was.x, was.y, was.heading, was.speed, ego.length, ego.width, 0.0)
    here = between(before, Body(ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width, 0.0), share)
    ego.x, ego.y, ego.heading, ego.speed = here.x, here.y, here.heading, here.speed
    ego.time = now - step + share * step
    for j in range(len(others)):
        other = others[j]
        was = other.before
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
    if not road.right_edge <= ego.y <= road.left_edge:
        return _OFF_ROAD
    if ego.x >= road.length:
        return _ROAD_END
    if ego.stood >= scenario.standstill_time - 1e-9:
        return _STANDSTILL
    if now >= scenario.time_limit - 1e-9:
        return _TIME_LIMIT
    if scenario.end_when_decided == 0 or ego.settled == 0 or ego.acceleration != 0.0 or ego.heading != 0.0:
        return 0
    if now < ego.scripted_until:  # its scripts are not over
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
    shown: FloatArray, scenario: Records, now: float, sampling: int, as_read: int,
) -> int:  # fmt: skip
    """Take in what SUMO shows at the end of a step, `now`: places, contact, ends, samples, what rules see next.

    shown: (n, m, 4), x and y of the front bumper, angle and speed; the last two count if `as_read`. Returns how many
    cases have ended.
    """
    ended = 0
    step = scenario[0].step
    for i in range(len(egos)):
        ego = egos[i]
        if ego.live == 0:
            continue
        if ego.reason != 0:  # broken off in this step
            _sample_row(ego, others[i], moves[i], samples[i])
            ended += 1
            continue
        was = ego.before
        before = Body(was.x, was.y, was.heading, was.speed, ego.length, ego.width, 0.0)
        body = Body(ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width, 0.0)
        first = 2.0
        for j in range(len(others[i])):
            other = others[i][j]
            if other.present == 0:
                continue
            _place(other, moves[i][j], shown[i, j, 0], shown[i, j, 1], shown[i, j, 2], shown[i, j, 3], now, as_read)
            was = other.before
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
            show(ego.seen, ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width)
            for j in range(len(others[i])):
                other = others[i][j]
                show(seen[i][j], other.x, other.y, other.heading, other.speed, other.length, other.width)
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
def tell_played_rows(egos: Records, others: Records, plays: Records, tell: FloatArray, told: int, closely: int) -> int:
    """Write what SUMO has to hear of the played vehicles to `tell`, behind `told` rows of it; how many it then has."""
    for i in range(len(egos)):
        if egos[i].live == 0 or egos[i].reason != 0:
            continue
        for j in range(len(others[i])):
            other = others[i][j]
            other.told = 1
            if plays[i][j].model or other.present == 0:
                continue
            other.front_x = other.x + 0.5 * other.length * math.cos(other.heading)
            other.front_y = other.y + 0.5 * other.length * math.sin(other.heading)
            if closely:
                other.told = 2
                tell[told, 0] = i * (1 + len(others[i])) + 1 + j
                tell[told, 1] = other.front_x
                tell[told, 2] = other.front_y
                tell[told, 3] = STRAIGHT - other.heading * _DEGREES
                tell[told, 4] = other.speed
                told += 1
    return told


# -- all of it ---------------------------------------------------------------------------------------------------------


def described(road: Road, vehicle: VehicleSettings, step: float, settings: SimulationSettings | None = None) -> Records:
    """What the rows of a case, or of many like it, share: a `SCENARIO` record in an array of one.

    settings: when cases end; None: nobody asks.
    """
    found = np.zeros(1, SCENARIO)
    for name, _ in _ROAD:
        found["road"][name] = getattr(road, name)
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
        self.left: dict[int, str] = {}
        self.let_go: set[int] = set()
        self._shared: list[float] = [0.0, 0.0, 0]  # latency: sum, longest, number of answers
        self.latency: list[list[float]] = [[0.0, 0.0, 0] for _ in cases]
        self.scenario = described(cases[0].road, settings.vehicle, settings.step, settings)
        self.egos = _egos(cases, settings.vehicle, placed)
        self.others, self.moves = _scripts(cases, settings)
        if m:
            self.egos["scripted_until"] = self.others["script_end"].max(axis=1)
        self.clips = np.zeros((n, len(WHATS)), CLIP)
        self.seen = np.zeros((n, m), MOVER)
        self.shown = np.zeros((n, m, 4))
        self.tell = np.zeros((n * (1 + m), 5))
        self._sampled, self._room = 1, 64
        self.samples = np.zeros((n, 1 + m, len(CHANNELS), self._room))
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
            begin_play_rows(self.egos, self.others, *self.players, self._stack)
        begin_rows(self.egos, self.others, self.moves, self.seen, self.samples)
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
        play_rows(self.egos, self.others, plays, acts, pieces, table, now)
        return int(tell_played_rows(self.egos, self.others, plays, self.tell, told, int(closely)))

    def wake(self, now: float) -> None:
        """Begin the moves whose conditions have come to hold in the step that ends `now`, s."""
        if self.players is not None:
            before = self.steps * self.settings.step
            wake_rows(self.egos, self.others, *self.players, now, before, self._stack)

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

    def leave(self, row: int, why: str) -> None:
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
            grown = np.zeros((*self.samples.shape[:3], self._room))
            grown[..., : self.samples.shape[3]] = self.samples
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
        if self.players is not None:
            waiting = self.players.acts["state"][row] == WAITS
            used = np.arange(waiting.shape[1]) < self.players.plays["acts"][row][:, None]
            if count := int((waiting & used).sum()):
                self.note(case, "trigger_never_fired", float(count), 0.0)
                self.notes[case]["trigger_never_fired"].count = count
        concrete, vehicle = self.cases[case], self.settings.vehicle
        reason = REASONS[int(ego["reason"])]
        assert reason is not None
        actors = concrete.actors
        hit = self._collision(row, actors) if reason == "contact" else None
        if hit is not None and hit.side == "rear" and actors[int(ego["struck"])].model is not None:
            self.note(case, "struck_from_behind", hit.relative_speed, hit.relative_speed)
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

    def recordings(self, wall_time: float) -> list[Recording | str]:
        """What each case left behind, or why it has to be driven alone. wall_time: of all of them, s."""
        found: list[Recording | str] = []
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
        block = self.samples[row, vehicle, :, :count].copy()
        return Trajectory.of_block(block, length=body.length, width=body.width)

    def _collision(self, row: int, actors: Sequence[Actor]) -> Collision:
        ego = self.egos[row]
        struck = int(ego["struck"])
        ego_body = Body(*ego.tolist()[:7])
        time = float(self.samples[row, 0, 0, int(ego["samples"]) - 1])  # a touch at a step's first instant is that one
        return describe(time, actors[struck].name, ego_body, self.body(row, struck))

    def body(self, row: int, other: int) -> Body:
        """Another vehicle."""
        return Body(*self.others[row, other].tolist()[:7])

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
    egos["front_x"], egos["front_y"] = egos["x"] + 0.5 * vehicle.length, egos["y"]
    return egos


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
            pose = (start.x, y, 0.0, start.speed)
            others[i, j] = (
                *pose, actor.length, actor.width, 0.0, 0.0, (*pose, 0.0), start.x + 0.5 * actor.length, y, 1, 0, 0,
                (start.x, start.y, start.speed), braking, min((begin for begin, _ in spans), default=math.inf),
                max((end for _, end in spans), default=-math.inf), leaves_the_lanes_at(actor, concrete.road),
                actor.slides, brake is not None,
                len(actor.lane_changes), 0,
            )  # fmt: skip
    return others, moves
