"""Manoeuvres of others that somebody had to answer, found in recordings and measured as parameters of a scenario.

Rules (who counts is decided by `drivers.recorded.events`; what is measured, here):

- cut_in: a vehicle changes into the lane ahead of another, which it had not overtaken just before.
- overtaken_and_cut_off: a cut-in by a faster vehicle that had been behind within `OVERTOOK` s before.
- merging: a cut-in from a ramp or an auxiliary lane, whose lane number is negative.
- cut_out: a leader leaves the lane and reveals the next vehicle ahead.
- braking: a leader at most 5 s ahead brakes.
- approach: the gap to a slower leader falls through 3.5 s.
- lane_change: a vehicle changes to the left, with a leader in its old lane and somebody behind in the new one.

t = 0 is when the other begins to move sideways or to brake, when the gap passes 3.5 s, when the changing vehicle begins
to move. Sideways moves are fitted with the smooth step that scenario files have, motion along the road with constant
acceleration. Moves to either side count alike: the scenario shows them to one.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.events import RULES, RecordedLaneChange, Traffic, encounters, find_lane_changes
from sumo_eval.drivers.recorded.recordings import INTERVAL, MOTOR_CLASSES, Recordings
from sumo_eval.errors import InputError
from sumo_eval.scenario.concrete import smooth_step
from sumo_eval.trajectory import FloatArray

CLASSES: Final = (
    "cut_in", "overtaken_and_cut_off", "merging", "cut_out", "braking", "approach", "lane_change",
)  # fmt: skip
OVERTOOK: Final = 20.0  # s before its lane change within which an overtaking vehicle was behind
AROUND: Final = 2.0  # s before and after a lane change that its fit sees
SPEEDS_EVERY: Final = 10  # samples; speeds are told by quantiles of every tenth
SHORTEST, LONGEST = 1.0, 15.0  # s; a fitted lane change outside is none
APPROACH_WINDOW: Final = 5.0  # s of a leader's motion that is measured; it keeps the speed it then has
BRAKING_HEADWAY: Final = 5.0  # s; a leader that brakes further ahead does not count
REAR_HEADWAY: Final = 4.0  # s; who is further behind in the new lane does not count
LEAD_HEADWAY: Final = 6.0  # s; who is further ahead in the old lane does not count

NOT_WHOLE, NO_OTHER, BESIDE, REAR_MOVES, LEAD_MOVES = (
    "not recorded from its beginning to its end",
    "no vehicle ahead that it reveals",
    "does not fit a lane change of 1 to 15 s",
    "the vehicle behind changes lane as well",
    "the vehicle ahead changes lane meanwhile",
)
"""Why an event has no parameters."""


@dataclass(frozen=True, slots=True)
class Moved:
    """How one of the others really moved: times from t = 0 on, s; place ahead of the ego's centre at t = 0 and to the
    left of the lane that it begins or ends in, m. bodies: half the lengths of both, m.
    """

    time: FloatArray
    x: FloatArray
    y: FloatArray
    bodies: float


@dataclass(frozen=True, slots=True, eq=False)
class Encounters:
    """The encounters of one class. values: parameter -> (n,). who: recording, ego, other and t of each.

    motions: how the other of each really moved. events: how many count for the rate, those without parameters
    included; left_out: why these have none. ghosts are in neither.
    """

    name: str
    values: Mapping[str, FloatArray]
    who: pd.DataFrame
    motions: tuple[Moved, ...]
    events: int
    left_out: Mapping[str, int]
    ghosts: int


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What recordings hold. kilometres: driven by all motor vehicles. hours: of these together. recordings: names.
    speeds: 5, 50 and 95 % of their speeds, m/s. lane_width: m, the median distance between neighbouring lanes; 3.5
    where there are none. notes: what was said when they were read.
    """

    classes: Mapping[str, Encounters]
    kilometres: float
    hours: float
    vehicles: int
    recordings: tuple[str, ...]
    speeds: tuple[float, float, float]
    lane_width: float
    lanes: int
    notes: tuple[str, ...]


@dataclass(slots=True)
class _Class:
    rows: list[dict[str, float]] = field(default_factory=list)
    who: list[dict[str, Any]] = field(default_factory=list)
    motions: list[Moved] = field(default_factory=list)
    events: int = 0
    ghosts: int = 0
    left_out: Counter[str] = field(default_factory=Counter)

    def add(self, who: dict[str, Any], found: tuple[dict[str, float], Moved] | str) -> None:
        self.events += 1
        if isinstance(found, str):
            self.left_out[found] += 1
        else:
            self.rows.append(found[0])
            self.motions.append(found[1])
            self.who.append(who)


class _Tracks:
    """A recording's vehicles as arrays."""

    def __init__(self, traffic: Traffic) -> None:
        self.traffic = traffic
        rows = traffic.rows
        self.t, self.x, self.y, self.speed, self.length = (
            rows[name].to_numpy(dtype=np.float64) for name in ("t", "x", "y", "speed", "length")
        )
        self.lane = rows["lane"].to_numpy()
        self.names = rows["vehicle"].to_numpy()
        settled = traffic.rows.groupby("lane")["y"].median()
        self.centres = {int(str(lane)): float(middle) for lane, middle in settled.items()}

    def part(self, vehicle: str, begin: float, end: float) -> slice | None:
        """The rows of a vehicle from one time to another; None where it is not recorded throughout."""
        whole = self.traffic.slices[vehicle]
        first = whole.start + int(np.ceil((begin - self.t[whole.start]) / INTERVAL - 1e-6))
        last = whole.start + int(np.floor((end - self.t[whole.start]) / INTERVAL + 1e-6))
        return slice(first, last + 1) if whole.start <= first < last < whole.stop else None

    def at(self, vehicle: str, time: float, values: FloatArray) -> float | None:
        """A value of a vehicle at a time; None where it is not recorded then."""
        whole = self.traffic.slices[vehicle]
        if not self.t[whole.start] - 1e-6 <= time <= self.t[whole.stop - 1] + 1e-6:
            return None
        return float(np.interp(time, self.t[whole], values[whole]))

    def motion(self, vehicle: str, time: float) -> tuple[float, float] | None:
        """Place, m, and speed, m/s, of a vehicle at a time; None where it is not recorded then."""
        x, speed = self.at(vehicle, time, self.x), self.at(vehicle, time, self.speed)
        return None if x is None or speed is None else (x, speed)


def find_encounters(parts: Iterable[Recordings], watch: Callable[[str, int], None] = lambda what, done: None) -> Found:
    """Every encounter in recordings, by class; one part of them is held at a time.

    watch: told the name of the recording that was looked through last, and how many were. Raises InputError where two
    have one name.
    """
    classes = {name: _Class() for name in CLASSES}
    kilometres = hours = 0.0
    names: list[str] = []
    notes: list[str] = []
    speeds, gaps, lanes, vehicles = [np.zeros(0)], [], 1, 0
    for part in parts:
        notes += part.notes
        motor = part.table[part.table["class"].isin(MOTOR_CLASSES)]
        for name, table in motor.groupby("recording", sort=False):
            if str(name) in names:
                raise InputError(f"Recordings must have different names, got {str(name)!r} twice.")
            traffic = Traffic(table)
            tracks = _Tracks(traffic)
            names.append(str(name))
            vehicles += len(traffic.slices)
            for track in traffic.slices.values():
                kilometres += float(np.abs(np.diff(tracks.x[track])).sum()) / 1000.0
                hours += (tracks.t[track.stop - 1] - tracks.t[track.start]) / 3600.0
            speeds.append(tracks.speed[::SPEEDS_EVERY].copy())  # a view would hold the whole recording
            centres = [tracks.centres[lane] for lane in sorted(tracks.centres) if lane >= 0]
            lanes = max(lanes, len(centres))
            gaps += [b - a for a, b in itertools.pairwise(centres) if 2.5 < b - a < 4.5]
            _of_recording(str(name), traffic, tracks, classes)
            watch(str(name), len(names))
    everybody = np.concatenate(speeds)
    low, middle, high = np.quantile(everybody, [0.05, 0.5, 0.95]) if len(everybody) else (0.0, 0.0, 0.0)
    return Found(
        {name: _encounters(name, found) for name, found in classes.items()},
        kilometres,
        hours,
        vehicles,
        tuple(names),
        (float(low), float(middle), float(high)),
        round(float(np.median(gaps)), 2) if gaps else 3.5,
        lanes,
        tuple(dict.fromkeys(notes)),
    )


def _encounters(name: str, found: _Class) -> Encounters:
    columns = list(found.rows[0]) if found.rows else []
    values = {column: np.array([row[column] for row in found.rows]) for column in columns}
    who = pd.DataFrame(found.who, columns=["recording", "ego", "other", "t"])
    return Encounters(
        name, values, who, tuple(found.motions), found.events, dict(sorted(found.left_out.items())), found.ghosts
    )


def _of_recording(name: str, traffic: Traffic, tracks: _Tracks, classes: Mapping[str, _Class]) -> None:
    changes = find_lane_changes(traffic)
    by_row = {(change.vehicle, round(change.t, 3)): change for change in changes}
    events = encounters(traffic, changes)

    def counts(kind: str, event: Mapping[str, Any], other: str) -> dict[str, Any] | None:
        """Who meets whom; None for a ghost, which is counted as one."""
        if event["ghost"]:
            classes[kind].ghosts += 1
            return None
        return {"recording": name, "ego": event["ego"], "other": other, "t": event["t"]}

    for event in events["cut_in"]:
        change = by_row[str(event["cut_in"]), round(float(event["t"]), 3)]
        kind = _kind_of_cut_in(tracks, event, change)
        if (who := counts(kind, event, change.vehicle)) is not None:
            classes[kind].add(who, _cut_in(tracks, event, change))
    for event in events["cut_out"]:
        change = by_row[str(event["cut_out"]), round(float(event["t"]), 3)]
        if (who := counts("cut_out", event, change.vehicle)) is not None:
            classes["cut_out"].add(who, _cut_out(tracks, event, change))
    for event in events["lead_braking"]:
        near = event["headway"] <= BRAKING_HEADWAY
        if near and (who := counts("braking", event, str(event["lead"]))) is not None:
            classes["braking"].add(who, _braking(tracks, event))
    for event in events["approach"]:
        comes_up = event["start_kind"] == "range_crossing"
        if comes_up and (who := counts("approach", event, str(event["lead"]))) is not None:
            classes["approach"].add(who, _approach(tracks, event))
    for change in changes:
        met = _neighbours(tracks, change) if change.to > change.origin >= 0 else None
        if met is None:
            continue
        ghost = change.lateral_speed > RULES.ghost_lateral_speed
        event = {"ego": change.vehicle, "t": change.t, "ghost": ghost}
        if (who := counts("lane_change", event, met[1])) is not None:
            classes["lane_change"].add(who, _lane_change(tracks, change, *met))


def _kind_of_cut_in(tracks: _Tracks, event: Mapping[str, Any], change: RecordedLaneChange) -> str:
    if change.origin < 0:
        return "merging"
    ego, begin = str(event["ego"]), float(event["t"])
    if event["cut_in_speed"] > event["ego_speed"]:
        for time in np.arange(begin - OVERTOOK, begin, 1.0):
            mine, its = tracks.at(ego, time, tracks.x), tracks.at(change.vehicle, time, tracks.x)
            if mine is not None and its is not None and its < mine:
                return "overtaken_and_cut_off"
    return "cut_in"


def _sideways(tracks: _Tracks, change: RecordedLaneChange) -> tuple[float, float, float] | str:
    """Begin, duration, s, and offset, m, of the smooth step that a lane change fits best; or why there is none."""
    if not change.complete:
        return NOT_WHOLE
    whole = tracks.traffic.slices[change.vehicle]
    t = tracks.t[whole]
    seen = (t >= change.onset - AROUND) & (t <= change.end + AROUND)
    fitted = fit_smooth_step(t[seen], tracks.y[whole][seen], change.onset, change.duration)
    return fitted if SHORTEST <= fitted[1] <= LONGEST and 1.5 <= abs(fitted[2]) <= 6.0 else BESIDE


def fit_smooth_step(time: FloatArray, y: FloatArray, onset: float, duration: float) -> tuple[float, float, float]:
    """Begin s, duration s and offset m of y0 + offset * smooth_step((t - begin) / duration), by least squares.

    time, y: (n,). onset, duration: about where to look.
    """
    from scipy import optimize

    minimize: Any = optimize.minimize

    def parts(guess: FloatArray) -> tuple[float, float, float]:
        share = smooth_step((time - guess[0]) / max(abs(guess[1]), 0.1))
        share_mean, y_mean = share.mean(), y.mean()
        spread = float(((share - share_mean) ** 2).sum())
        offset = float(((share - share_mean) * (y - y_mean)).sum()) / spread if spread > 0.0 else 0.0
        rest = y - y_mean - offset * (share - share_mean)
        return float(rest @ rest), offset, spread

    begin = np.array([onset - 0.1 * duration, 1.2 * max(duration, 0.5)], dtype=np.float64)
    options = {"xatol": 1e-3, "fatol": 1e-9}
    best: FloatArray = minimize(lambda guess: parts(guess)[0], begin, method="Nelder-Mead", options=options).x
    return float(best[0]), float(abs(best[1])), parts(best)[1]


def constant_acceleration(time: FloatArray, x: FloatArray) -> tuple[float, float, float]:
    """x0 m, v0 m/s and a m/s2 of x0 + v0 t + a t^2 / 2 by least squares over (n,) samples."""
    design = np.column_stack([np.ones_like(time), time, 0.5 * time**2])
    x0, v0, a = np.linalg.lstsq(design, x, rcond=None)[0]
    return float(x0), float(v0), float(a)


def _moved(tracks: _Tracks, ego: str, part: slice, begin: float, ego_x: float, level: float, mirror: float) -> Moved:
    bodies = _bodies(tracks, ego, str(tracks.names[part.start]))
    return Moved(tracks.t[part] - begin, tracks.x[part] - ego_x, mirror * (tracks.y[part] - level), bodies)


def _cut_in(
    tracks: _Tracks, event: Mapping[str, Any], change: RecordedLaneChange
) -> tuple[dict[str, float], Moved] | str:
    fitted = _sideways(tracks, change)
    if isinstance(fitted, str):
        return fitted
    begin, duration, offset = fitted
    ego = str(event["ego"])
    me, part = tracks.motion(ego, begin), tracks.part(change.vehicle, begin, begin + duration)
    if me is None or part is None:
        return NOT_WHOLE
    ego_x, ego_speed = me
    x0, speed, acceleration = constant_acceleration(tracks.t[part] - begin, tracks.x[part])
    values = {
        "ego_speed": ego_speed,
        "closing_speed": ego_speed - speed,
        "gap": x0 - ego_x - _bodies(tracks, ego, change.vehicle),
        "duration": duration,
        "acceleration": acceleration,
    }
    return values, _moved(tracks, ego, part, begin, ego_x, tracks.centres[change.to], -float(np.sign(offset)))


def _cut_out(
    tracks: _Tracks, event: Mapping[str, Any], change: RecordedLaneChange
) -> tuple[dict[str, float], Moved] | str:
    if not event["revealed"]:
        return NO_OTHER
    fitted = _sideways(tracks, change)
    if isinstance(fitted, str):
        return fitted
    begin, duration, offset = fitted
    ego, revealed = str(event["ego"]), str(event["revealed"])
    me = tracks.motion(ego, begin)
    part, ahead = (tracks.part(who, begin, begin + duration) for who in (change.vehicle, revealed))
    if me is None or part is None or ahead is None:
        return NOT_WHOLE
    ego_x, ego_speed = me
    x0, speed, acceleration = constant_acceleration(tracks.t[part] - begin, tracks.x[part])
    there = tracks.t[ahead] - begin
    its_speed, its_x = np.polyfit(there, tracks.x[ahead], 1)
    values = {
        "ego_speed": ego_speed,
        "lead_closing": ego_speed - speed,
        "lead_gap": x0 - ego_x - _bodies(tracks, ego, change.vehicle),
        "lead_acceleration": acceleration,
        "duration": duration,
        "closing_speed": ego_speed - float(its_speed),
        "gap": float(its_x) - ego_x - _bodies(tracks, ego, revealed),
    }
    return values, _moved(tracks, ego, part, begin, ego_x, tracks.centres[change.origin], float(np.sign(offset)))


def _braking(tracks: _Tracks, event: Mapping[str, Any]) -> tuple[dict[str, float], Moved] | str:
    ego, lead, begin = str(event["ego"]), str(event["lead"]), float(event["t"])
    whole = tracks.traffic.slices[lead]
    acceleration = tracks.traffic.rows["acceleration"].to_numpy()[whole]
    first = round((begin - tracks.t[whole.start]) / INTERVAL)
    eased = np.flatnonzero(acceleration[first:] > -RULES.braking_below)
    if not eased.size:
        return NOT_WHOLE
    last = first + int(eased[0])
    if last - first < 3:
        return NOT_WHOLE
    me = tracks.motion(ego, begin)
    if me is None:
        return NOT_WHOLE
    ego_x, ego_speed = me
    part = slice(whole.start + first, whole.start + last + 1)
    if np.ptp(tracks.lane[part]):
        return LEAD_MOVES
    duration = (last - first) * INTERVAL
    x0, speed, rate = constant_acceleration(tracks.t[part] - begin, tracks.x[part])
    values = {
        "ego_speed": ego_speed,
        "closing_speed": ego_speed - speed,
        "headway": (x0 - ego_x - _bodies(tracks, ego, lead)) / max(ego_speed, 0.1),
        "deceleration": -rate,
        "duration": duration,
    }
    return values, _moved(tracks, ego, part, begin, ego_x, tracks.centres[int(tracks.lane[part.start])], 1.0)


def _approach(tracks: _Tracks, event: Mapping[str, Any]) -> tuple[dict[str, float], Moved] | str:
    ego, lead, begin = str(event["ego"]), str(event["lead"]), float(event["t"])
    part = tracks.part(lead, begin, begin + APPROACH_WINDOW)
    ego_x = tracks.at(ego, begin, tracks.x)
    if part is None or ego_x is None:
        return NOT_WHOLE
    if np.ptp(tracks.lane[part]):
        return LEAD_MOVES
    _, speed, acceleration = constant_acceleration(tracks.t[part] - begin, tracks.x[part])
    values = {
        "ego_speed": float(event["ego_speed"]),
        "closing_speed": float(event["ego_speed"]) - speed,
        "acceleration": acceleration,
    }
    level = tracks.centres[int(tracks.lane[part.start])]
    return values, _moved(tracks, ego, part, begin, ego_x, level, 1.0)


def _neighbours(tracks: _Tracks, change: RecordedLaneChange) -> tuple[str, str] | None:
    """The leader in the old lane and the vehicle behind in the new one at a lane change; None unless both are near."""
    before, now = change.row - 1, change.row
    lead, rear = int(tracks.traffic.leader[before]), int(tracks.traffic.follower[now])
    if lead < 0 or rear < 0:
        return None
    reach = float(tracks.traffic.gap[before])
    behind = float(tracks.traffic.gap[rear])
    if reach > LEAD_HEADWAY * tracks.speed[before] or behind > REAR_HEADWAY * tracks.speed[rear]:
        return None
    return str(tracks.names[lead]), str(tracks.names[rear])


def _lane_change(
    tracks: _Tracks, change: RecordedLaneChange, lead: str, rear: str
) -> tuple[dict[str, float], Moved] | str:
    fitted = _sideways(tracks, change)
    if isinstance(fitted, str):
        return fitted
    begin, duration, _ = fitted
    ego = change.vehicle
    me, leader = tracks.motion(ego, begin), tracks.motion(lead, begin)
    behind = tracks.part(rear, begin, begin + duration)
    if me is None or leader is None or behind is None:
        return NOT_WHOLE
    (ego_x, ego_speed), (lead_x, lead_speed) = me, leader
    if np.ptp(tracks.lane[behind]):
        return REAR_MOVES
    x0, speed, acceleration = constant_acceleration(tracks.t[behind] - begin, tracks.x[behind])
    values = {
        "ego_speed": ego_speed,
        "lead_closing": ego_speed - lead_speed,
        "lead_gap": lead_x - ego_x - _bodies(tracks, ego, lead),
        "rear_closing": speed - ego_speed,
        "rear_gap": ego_x - x0 - _bodies(tracks, ego, rear),
        "rear_acceleration": acceleration,
        "duration": duration,
    }
    return values, _moved(tracks, ego, behind, begin, ego_x, tracks.centres[change.origin], 1.0)


def _bodies(tracks: _Tracks, one: str, other: str) -> float:
    """Half the lengths of two vehicles together, m."""
    return float(sum(tracks.length[tracks.traffic.slices[name].start] for name in (one, other)) / 2.0)
