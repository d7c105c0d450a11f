"""Manoeuvres that a driver had to answer, found in recordings and measured as parameters of a
scenario.

Rules (who counts is decided by `drivers.recorded.events`; what is measured, here):

- cut_in: a vehicle changes into the lane ahead of another, which it had not overtaken just before.
- overtaken_and_cut_off: a cut-in by a faster vehicle that had been behind within `OVERTOOK` s
  before.
- merging: a cut-in from a ramp or an auxiliary lane, whose lane number is negative.
- cut_out: a leader leaves the lane and reveals the next vehicle ahead.
- braking: a leader at most 5 s ahead brakes.
- approach: the gap to a slower leader falls through 3.5 s.
- lane_change: a vehicle changes to the left, with a leader in its old lane and somebody behind in
  the new one.

t = 0 is when the other begins to move sideways or to brake, when the gap passes 3.5 s, when the
changing vehicle begins to move. Sideways moves are fitted with the smooth step that scenario files
have, motion along the road with constant acceleration. Moves to either side count alike: the
scenario shows them to one.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np

from sumo_eval.drivers.recorded.events import (
    RULES,
    RecordedLaneChange,
    Traffic,
    encounters,
    find_lane_changes,
)
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
# s of a leader's motion that is measured; it keeps the speed it then has
APPROACH_WINDOW: Final = 5.0
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


class NotMeasuredError(Exception):
    """An event that counts but has no parameters; its text is one of the reasons above."""


@dataclass(frozen=True, slots=True)
class Moved:
    """An actor's recorded motion: times from t = 0 on, s; place ahead of the ego's centre
    at t = 0 and to the left of the lane that it begins or ends in, m.

    bodies: half the lengths of both, m.
    """

    time: FloatArray
    x: FloatArray
    y: FloatArray
    bodies: float


Measured = tuple[dict[str, float], Moved]
"""Parameters of an event, and how the other vehicle of it moved."""


@dataclass(slots=True, eq=False)
class Encounters:
    """The encounters of one class.

    rows: parameters of each.
    who: `recording`, `ego`, `other` and `t` of each.
    motions: how the other vehicle of each really moved.
    events: how many count for the rate, those without parameters included.
    left_out: why these have none. ghosts are in neither.
    """

    name: str
    rows: list[dict[str, float]] = field(default_factory=list)
    who: list[dict[str, Any]] = field(default_factory=list)
    motions: list[Moved] = field(default_factory=list)
    events: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    ghosts: int = 0

    def add(self, who: dict[str, Any], measure: Callable[[], Measured]) -> None:
        """Count an event without ghosts, with its parameters where `measure` finds them."""
        self.events += 1
        try:
            row, motion = measure()
        except NotMeasuredError as reason:
            self.left_out[str(reason)] += 1
            return
        self.rows.append(row)
        self.motions.append(motion)
        self.who.append(who)


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Encounters in recordings.

    kilometres: driven by all motor vehicles.
    hours: of these together.
    recordings: names.
    speeds: 5, 50 and 95 % of their speeds, m/s.
    lane_width: m, the median distance between neighbouring lanes; 3.5 where there are none.
    notes: what was said when they were read.
    """

    classes: Mapping[str, Encounters]
    kilometres: float
    hours: float
    vehicles: int
    recordings: tuple[str, ...]
    speeds: tuple[float, float, float]
    lane_width: float
    notes: tuple[str, ...]


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

    def part(self, vehicle: str, begin: float, duration: float) -> slice:
        """The rows of a vehicle from `begin` on for `duration`, s; it must be recorded
        throughout.
        """
        whole = self.traffic.slices[vehicle]
        first = whole.start + int(np.ceil((begin - self.t[whole.start]) / INTERVAL - 1e-6))
        last = whole.start + int(
            np.floor((begin + duration - self.t[whole.start]) / INTERVAL + 1e-6)
        )
        if not whole.start <= first < last < whole.stop:
            raise NotMeasuredError(NOT_WHOLE)
        return slice(first, last + 1)

    def at(self, vehicle: str, time: float) -> tuple[float, float] | None:
        """Place, m, and speed, m/s, of a vehicle at a time; None where it is not recorded then."""
        whole = self.traffic.slices[vehicle]
        if not self.t[whole.start] - 1e-6 <= time <= self.t[whole.stop - 1] + 1e-6:
            return None
        x, speed = (
            float(np.interp(time, self.t[whole], values[whole])) for values in (self.x, self.speed)
        )
        return x, speed

    def bodies(self, one: str, other: str) -> float:
        """Half the lengths of two vehicles together, m."""
        return float(
            sum(self.length[self.traffic.slices[name].start] for name in (one, other)) / 2.0
        )


class _Pair:
    """The ego at t = 0 (`begin`), and another vehicle's motion over the rows `part` with constant
    acceleration.
    """

    def __init__(self, tracks: _Tracks, ego: str, begin: float, part: slice) -> None:
        start = tracks.at(ego, begin)
        if start is None:
            raise NotMeasuredError(NOT_WHOLE)
        self.ego_x, self.ego_speed = start
        self.bodies = tracks.bodies(ego, str(tracks.names[part.start]))
        self._tracks, self._part = tracks, part
        self._time = tracks.t[part] - begin
        self.x0, self.speed, self.acceleration = constant_acceleration(self._time, tracks.x[part])
        self.gap = self.x0 - self.ego_x - self.bodies
        self.closing = self.ego_speed - self.speed

    def lane(self, changes: str) -> int:
        """The lane of the other vehicle; one that changes it has no parameters, for the reason
        `changes`.
        """
        lanes = self._tracks.lane[self._part]
        if np.ptp(lanes):
            raise NotMeasuredError(changes)
        return int(lanes[0])

    def moved(self, lane: int, mirror: float = 1.0) -> Moved:
        """How the other vehicle moved, across the road from the centre of a lane."""
        y = self._tracks.y[self._part] - self._tracks.centres[lane]
        return Moved(self._time, self._tracks.x[self._part] - self.ego_x, mirror * y, self.bodies)


def find_encounters(
    parts: Iterable[Recordings], watch: Callable[[str, int], None] = lambda what, done: None
) -> Found:
    """Every encounter in recordings, by class; one part of them is held at a time.

    watch: told the name of the recording that was looked through last, and how many were.
    Raises InputError where two have one name.
    """
    classes = {name: Encounters(name) for name in CLASSES}
    kilometres = hours = 0.0
    names: list[str] = []
    notes: list[str] = []
    speeds, gaps, vehicles = [np.zeros(0)], [], 0
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
            # a view would hold the whole recording
            speeds.append(tracks.speed[::SPEEDS_EVERY].copy())
            centres = [tracks.centres[lane] for lane in sorted(tracks.centres) if lane >= 0]
            gaps += [b - a for a, b in itertools.pairwise(centres) if 2.5 < b - a < 4.5]
            _of_recording(str(name), traffic, tracks, classes)
            watch(str(name), len(names))
    everybody = np.concatenate(speeds)
    low, middle, high = (
        np.quantile(everybody, [0.05, 0.5, 0.95]) if len(everybody) else (0.0, 0.0, 0.0)
    )
    return Found(
        classes,
        kilometres,
        hours,
        vehicles,
        tuple(names),
        (float(low), float(middle), float(high)),
        round(float(np.median(gaps)), 2) if gaps else 3.5,
        tuple(dict.fromkeys(notes)),
    )


def _of_recording(
    name: str, traffic: Traffic, tracks: _Tracks, classes: Mapping[str, Encounters]
) -> None:
    changes = find_lane_changes(traffic)
    by_row = {(change.vehicle, round(change.t, 3)): change for change in changes}
    events = encounters(traffic, changes)

    def take(
        kind: str,
        event: Mapping[str, Any],
        other: str,
        measure: Callable[..., Measured],
        *more: Any,
    ) -> None:
        """Count an event; a ghost is counted as one."""
        if event["ghost"]:
            classes[kind].ghosts += 1
            return
        who = {"recording": name, "ego": event["ego"], "other": other, "t": event["t"]}
        classes[kind].add(who, partial(measure, tracks, event, *more))

    for event in events["cut_in"]:
        change = by_row[str(event["cut_in"]), round(float(event["t"]), 3)]
        take(_kind_of_cut_in(tracks, event, change), event, change.vehicle, _cut_in, change)
    for event in events["cut_out"]:
        change = by_row[str(event["cut_out"]), round(float(event["t"]), 3)]
        take("cut_out", event, change.vehicle, _cut_out, change)
    for event in events["lead_braking"]:
        if event["headway"] <= BRAKING_HEADWAY:
            take("braking", event, str(event["lead"]), _braking)
    for event in events["approach"]:
        if event["start_kind"] == "range_crossing":
            take("approach", event, str(event["lead"]), _approach)
    for change in changes:
        met = _neighbours(tracks, change) if change.to > change.origin >= 0 else None
        if met is not None:
            ghost = change.lateral_speed > RULES.ghost_lateral_speed
            event = {"ego": change.vehicle, "t": change.t, "ghost": ghost}
            take("lane_change", event, met[1], _lane_change, change, *met)


def _kind_of_cut_in(tracks: _Tracks, event: Mapping[str, Any], change: RecordedLaneChange) -> str:
    if change.origin < 0:
        return "merging"
    ego, begin = str(event["ego"]), float(event["t"])
    if event["cut_in_speed"] > event["ego_speed"]:
        for time in np.arange(begin - OVERTOOK, begin, 1.0):
            ego_at, other_at = tracks.at(ego, time), tracks.at(change.vehicle, time)
            if ego_at is not None and other_at is not None and other_at[0] < ego_at[0]:
                return "overtaken_and_cut_off"
    return "cut_in"


def _sideways(tracks: _Tracks, change: RecordedLaneChange) -> tuple[float, float, float]:
    """Begin, duration, s, and offset, m, of the smooth step that a lane change fits best."""
    if not change.complete:
        raise NotMeasuredError(NOT_WHOLE)
    whole = tracks.traffic.slices[change.vehicle]
    t = tracks.t[whole]
    seen = (t >= change.onset - AROUND) & (t <= change.end + AROUND)
    begin, duration, offset = fit_smooth_step(
        t[seen], tracks.y[whole][seen], change.onset, change.duration
    )
    if not (SHORTEST <= duration <= LONGEST and 1.5 <= abs(offset) <= 6.0):
        raise NotMeasuredError(BESIDE)
    return begin, duration, offset


def fit_smooth_step(
    time: FloatArray, y: FloatArray, onset: float, duration: float
) -> tuple[float, float, float]:
    """Begin s, duration s and offset m of y0 + offset * smooth_step((t - begin) / duration), by
    least squares.

    time, y: (n,).
    onset, duration: about where to look.
    """
    from scipy import optimize

    minimize: Any = optimize.minimize

    def parts(guess: FloatArray) -> tuple[float, float, float]:
        share = smooth_step((time - guess[0]) / max(abs(guess[1]), 0.1))
        share_mean, y_mean = share.mean(), y.mean()
        spread = float(((share - share_mean) ** 2).sum())
        offset = (
            float(((share - share_mean) * (y - y_mean)).sum()) / spread if spread > 0.0 else 0.0
        )
        rest = y - y_mean - offset * (share - share_mean)
        return float(rest @ rest), offset, spread

    begin = np.array([onset - 0.1 * duration, 1.2 * max(duration, 0.5)], dtype=np.float64)
    options = {"xatol": 1e-3, "fatol": 1e-9}
    best: FloatArray = minimize(
        lambda guess: parts(guess)[0], begin, method="Nelder-Mead", options=options
    ).x
    return float(best[0]), float(abs(best[1])), parts(best)[1]


def constant_acceleration(time: FloatArray, x: FloatArray) -> tuple[float, float, float]:
    """x0 m, v0 m/s and a m/s2 of x0 + v0 t + a t^2 / 2 by least squares over (n,) samples."""
    design = np.column_stack([np.ones_like(time), time, 0.5 * time**2])
    x0, v0, a = np.linalg.lstsq(design, x, rcond=None)[0]
    return float(x0), float(v0), float(a)


def _cut_in(tracks: _Tracks, event: Mapping[str, Any], change: RecordedLaneChange) -> Measured:
    begin, duration, offset = _sideways(tracks, change)
    pair = _Pair(tracks, str(event["ego"]), begin, tracks.part(change.vehicle, begin, duration))
    values = {
        "ego_speed": pair.ego_speed,
        "closing_speed": pair.closing,
        "gap": pair.gap,
        "duration": duration,
        "acceleration": pair.acceleration,
    }
    return values, pair.moved(change.to, -float(np.sign(offset)))


def _cut_out(tracks: _Tracks, event: Mapping[str, Any], change: RecordedLaneChange) -> Measured:
    if not event["revealed"]:
        raise NotMeasuredError(NO_OTHER)
    begin, duration, offset = _sideways(tracks, change)
    ego, revealed = str(event["ego"]), str(event["revealed"])
    pair = _Pair(tracks, ego, begin, tracks.part(change.vehicle, begin, duration))
    ahead = tracks.part(revealed, begin, duration)
    revealed_speed, revealed_x = np.polyfit(tracks.t[ahead] - begin, tracks.x[ahead], 1)
    values = {
        "ego_speed": pair.ego_speed,
        "lead_closing": pair.closing,
        "lead_gap": pair.gap,
        "lead_acceleration": pair.acceleration,
        "duration": duration,
        "closing_speed": pair.ego_speed - float(revealed_speed),
        "gap": float(revealed_x) - pair.ego_x - tracks.bodies(ego, revealed),
    }
    return values, pair.moved(change.origin, float(np.sign(offset)))


def _braking(tracks: _Tracks, event: Mapping[str, Any]) -> Measured:
    lead, begin = str(event["lead"]), float(event["t"])
    whole = tracks.traffic.slices[lead]
    acceleration = tracks.traffic.rows["acceleration"].to_numpy()[whole]
    first = round((begin - tracks.t[whole.start]) / INTERVAL)
    eased = np.flatnonzero(acceleration[first:] > -RULES.braking_below)
    steps = int(eased[0]) if eased.size else 0
    if steps < 3:
        raise NotMeasuredError(NOT_WHOLE)
    pair = _Pair(
        tracks,
        str(event["ego"]),
        begin,
        slice(whole.start + first, whole.start + first + steps + 1),
    )
    lane = pair.lane(LEAD_MOVES)
    values = {
        "ego_speed": pair.ego_speed,
        "closing_speed": pair.closing,
        "headway": pair.gap / max(pair.ego_speed, 0.1),
        "deceleration": -pair.acceleration,
        "duration": steps * INTERVAL,
    }
    return values, pair.moved(lane)


def _approach(tracks: _Tracks, event: Mapping[str, Any]) -> Measured:
    begin, speed = float(event["t"]), float(event["ego_speed"])
    pair = _Pair(
        tracks, str(event["ego"]), begin, tracks.part(str(event["lead"]), begin, APPROACH_WINDOW)
    )
    values = {
        "ego_speed": speed,
        "closing_speed": speed - pair.speed,
        "acceleration": pair.acceleration,
    }
    return values, pair.moved(pair.lane(LEAD_MOVES))


def _neighbours(tracks: _Tracks, change: RecordedLaneChange) -> tuple[str, str] | None:
    """The lead in the old lane and the vehicle behind in the new one at a lane change; None
    unless both are near.
    """
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
    tracks: _Tracks, event: Mapping[str, Any], change: RecordedLaneChange, lead: str, rear: str
) -> Measured:
    begin, duration, _ = _sideways(tracks, change)
    start = tracks.at(lead, begin)
    if start is None:
        raise NotMeasuredError(NOT_WHOLE)
    lead_x, lead_speed = start
    pair = _Pair(tracks, change.vehicle, begin, tracks.part(rear, begin, duration))
    pair.lane(REAR_MOVES)
    values = {
        "ego_speed": pair.ego_speed,
        "lead_closing": pair.ego_speed - lead_speed,
        "lead_gap": lead_x - pair.ego_x - tracks.bodies(change.vehicle, lead),
        "rear_closing": -pair.closing,
        "rear_gap": pair.ego_x - pair.x0 - pair.bodies,
        "rear_acceleration": pair.acceleration,
        "duration": duration,
    }
    return values, pair.moved(change.origin)
