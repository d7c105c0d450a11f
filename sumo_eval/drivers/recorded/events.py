"""Events in recorded driving: approaches to a slower lead, cut-outs, cut-ins, braking leads, lane
changes.

Rules (bumper-to-bumper gaps; lanes count once they are kept for 1 s; lead: the next vehicle in
front in the same lane):

- approach: t = 0 at the first sample of a stretch behind one lead with a closing speed of at least
  2 m/s, a gap of at most max(3.5 s * speed, 30 m) and more than 2 m; kept where the least TTC of
  the stretch is at most 20 s.
- cut_out: a lead changes lane, at most max(4 s * speed, 30 m) ahead; t = 0 when its lane number
  changes. `revealed` is the next vehicle in front within 300 m.
- cut_in: a vehicle changes into the lane of another, at most max(3 s * speed, 25 m) ahead of it
  at t; gap and speeds are those at `start`, when it begins to move sideways.
- lead_braking: a lead brakes with at least 1 m/s2 and loses at least 2 m/s.

Dropped as ghosts of the tracker: a least TTC under 1 s, a gap under 1 m, accelerations beyond 6
m/s2, cut-ins with a lateral speed over 2 m/s.

Users: `drivers/recorded/reference.py`, `extras/rates/encounters.py`, `extras/rates/measured.py`,
`extras/rates/people_command.py`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pandas import DataFrame, Series

from sumo_eval.drivers import CLOSING_SPEED
from sumo_eval.drivers.recorded.recordings import (
    INTERVAL,
    MOTOR_CLASSES,
    SMOOTHED,
    Recordings,
    smooth,
)
from sumo_eval.input_file import writing
from sumo_eval.text import cell, each_text
from sumo_eval.trajectory import FloatArray

KINDS = ("approach", "cut_out", "cut_in", "lead_braking")


# Constants of the rules above, SI units; `CLOSING_SPEED`, of an approach, stands in
# drivers/__init__.py.
APPROACH_HEADWAY = 3.5
APPROACH_GAP = 30.0
LEAST_GAP = 2.0
LARGEST_TTC = 20.0
FOLLOWS_BELOW = 0.5  # closing speed under which an approach has turned into following
CUT_OUT_HEADWAY = 4.0
CUT_OUT_GAP = 30.0
REVEALED_WITHIN = 300.0
CUT_IN_HEADWAY = 3.0
CUT_IN_GAP = 25.0
LEAD_DECELERATION = 1.0
LEAD_SPEED_DROP = 2.0
BRAKING_BELOW = 0.3  # deceleration that begins and ends a lead's braking
LANE_KEPT = 1.0  # s on both sides of a lane change
LATERAL_SPEED = 0.12  # m/s, above which a vehicle is changing lane
GHOST_TTC = 1.0
GHOST_GAP = 1.0
GHOST_ACCELERATION = 6.0
GHOST_LATERAL_SPEED = 2.0
_BRAKING_SAMPLES = 100  # 10 s from a cut-out or cut-in on, in which the ego may brake for it
Event = dict[str, Any]


class Events(NamedTuple):
    """Events by kind, one row each.

    vehicles, vehicles_in_events: number of motor vehicles, and of those that are an ego.
    ghosts: how many were dropped, by kind.
    """

    tables: dict[str, DataFrame]
    lane_changes: DataFrame
    vehicles: int
    vehicles_in_events: int
    ghosts: dict[str, int]

    def sentences(self) -> list[str]:
        """The findings in words."""
        counts = ", ".join(
            f"{len(table)} {kind} ({self.ghosts[kind]} ghosts dropped)"
            for kind, table in self.tables.items()
        )
        return [
            f"{self.vehicles_in_events} of {self.vehicles} motor vehicles are in an event: "
            f"{counts}.",
            f"{len(self.lane_changes)} lane changes.",
        ]


class RecordedTraffic:
    """The motor vehicles of a recording as arrays (n,), by vehicle and time.

    frame: number of the sample's instant on the clock of `INTERVAL`.
    slices: rows of each vehicle.
    lane: counts once it is kept for `LANE_KEPT`.
    centres: median y of each lane, m.
    across: lateral speed, m/s.
    lead, follower: rows of the vehicles ahead and behind at that instant; -1: none.
    gap, closing, ttc: to the lead; without one inf, 0 and inf.
    changes: its lane changes.
    """

    def __init__(self, table: DataFrame) -> None:
        rows = table[table["class"].isin(MOTOR_CLASSES)].sort_values(
            ["vehicle", "t"], kind="stable", ignore_index=True
        )
        self.names = rows["vehicle"].to_numpy()
        self.frame = np.round(rows["t"].to_numpy() / INTERVAL).astype(np.int64)
        self.t, self.x, self.y = (rows[name].to_numpy() for name in ("t", "x", "y"))
        self.speed, self.acceleration, self.length = (
            rows[name].to_numpy() for name in ("speed", "acceleration", "length")
        )
        self.slices = {
            str(name): slice(index[0], index[-1] + 1)
            for name, index in rows.groupby("vehicle", sort=False).indices.items()
        }
        self.lane = _settled_lanes(rows)
        self.centres: dict[Any, float] = Series(self.y).groupby(self.lane).median().to_dict()
        self.across = np.zeros(len(rows))
        for part in self.slices.values():
            self.across[part] = np.gradient(smooth(self.y[part], SMOOTHED), INTERVAL)

        self.lead, self.follower = _neighbours(self.frame, self.lane, self.x)
        led = self.lead >= 0  # without a lead, -1 reads the last row, which `where` drops
        self.gap = np.where(led, self.apart(slice(None), self.lead), np.inf)
        self.closing = np.where(led, self.speed - self.speed[self.lead], 0.0)
        self.ttc = np.where(self.closing > 0, self.gap / np.maximum(self.closing, 1e-9), np.inf)
        self.changes = find_lane_changes(self)

    def apart(self, behind: Any, ahead: Any) -> Any:
        """Gap from bumper to bumper between the vehicles of rows, m."""
        bodies = (self.length[ahead] + self.length[behind]) / 2
        return self.x[ahead] - self.x[behind] - bodies

    def row_at(self, frame: int, row: int) -> int | None:
        """The row at a frame of a row's vehicle; None where it is not recorded."""
        part = self.slices[self.names[row]]
        target = row + frame - self.frame[row]
        return target if part.start <= target < part.stop else None

    def onset_of(self, row: int, change: RecordedLaneChange) -> tuple[int, float]:
        """Row of a vehicle when another vehicle's lane change begins, and that time, s: a
        scenario's t = 0.

        row: of the vehicle, when the other one crosses the lane line.

        Where the vehicle is recorded only later, its first row is returned. Then, and where it was
        in another lane at that time, the time is nan.
        """
        onset = row - round((self.t[row] - change.onset) / INTERVAL)
        begin = max(onset, self.slices[self.names[row]].start)
        ready = begin == onset and self.lane[begin] == self.lane[row]
        return begin, change.onset if ready else np.nan


def _settled_lanes(rows: DataFrame) -> np.ndarray:
    """Lane of each row, (n,).

    A visit shorter than `LANE_KEPT` counts as the lane before it, a vehicle's first as the lane
    after it.
    """
    visit = (rows[["vehicle", "lane"]] != rows[["vehicle", "lane"]].shift()).any(axis=1)
    samples = visit.groupby(visit.cumsum()).transform("size")
    kept = rows["lane"].where(samples >= round(LANE_KEPT / INTERVAL))
    settled = kept.groupby(rows["vehicle"])
    lane = settled.ffill().fillna(settled.bfill()).fillna(rows["lane"])
    return lane.to_numpy().astype(np.int64)


def _neighbours(frame: np.ndarray, lane: np.ndarray, x: FloatArray) -> np.ndarray:
    """Rows of the vehicles ahead and behind in a lane at the same frame, (2, n); -1: none."""
    order = np.lexsort((x, lane, frame))
    behind, ahead = order[:-1], order[1:]
    same = (frame[behind] == frame[ahead]) & (lane[behind] == lane[ahead])
    neighbours = np.full((2, len(x)), -1)
    neighbours[0, behind[same]] = ahead[same]
    neighbours[1, ahead[same]] = behind[same]
    return neighbours


def extract_events(recordings: Recordings) -> Events:
    """Every event of the recordings.

    The columns of an event table begin with event, recording, ego, t (s, its t = 0).
    """
    events: dict[str, list[Event]] = {kind: [] for kind in KINDS}
    changes = []
    vehicles = 0
    for recording, table in recordings.table.groupby("recording", sort=False):
        traffic = RecordedTraffic(table)
        vehicles += len(traffic.slices)
        changes += [{**change._asdict(), "recording": recording} for change in traffic.changes]
        for kind, more in encounters(traffic).items():
            events[kind] += [{"recording": recording, **event} for event in more]
    real = {kind: [event for event in events[kind] if not event["ghost"]] for kind in KINDS}
    egos = {(event["recording"], event["ego"]) for group in real.values() for event in group}
    return Events(
        {kind: _table(kind, group) for kind, group in real.items()},
        DataFrame(changes, columns=[*RecordedLaneChange._fields, "recording"]),
        vehicles,
        len(egos),
        {kind: len(events[kind]) - len(real[kind]) for kind in KINDS},
    )


def _table(kind: str, events: Sequence[Event]) -> DataFrame:
    """Events of a kind, numbered."""
    rows = [{"event": f"{kind}-{number:05d}", **event} for number, event in enumerate(events)]
    table = DataFrame(rows, columns=None if rows else ["event", "recording", "ego", "t"])
    return table.drop(columns="ghost", errors="ignore")


class RecordedLaneChange(NamedTuple):
    """A lane change that is kept.

    t: time of the crossing of the lane line, s.
    row: of the crossing in the traffic.
    origin, to: lanes.
    onset, end, duration: of the lateral motion, s.
    middle: time from 10 to 90 % of the offset, s; None if at most 0.5 m of it was recorded.
    lateral_speed: the largest, m/s.
    complete: whether beginning and end were both recorded.
    """

    vehicle: str
    t: float
    row: int
    origin: int
    to: int
    onset: float
    end: float
    duration: float
    middle: float | None
    lateral_speed: float
    complete: bool


def find_lane_changes(traffic: RecordedTraffic) -> list[RecordedLaneChange]:
    """Every lane change of a recording that is kept, by vehicle."""
    changes = []
    lane, time = traffic.lane, traffic.t
    for vehicle, part in traffic.slices.items():
        for crossing in (part.start + 1 + np.flatnonzero(np.diff(lane[part]))).tolist():
            side = np.sign(lane[crossing] - lane[crossing - 1])
            lateral = side * traffic.across
            first = last = crossing
            while first > part.start and lateral[first - 1] > LATERAL_SPEED:
                first -= 1
            while last < part.stop - 1 and lateral[last] > LATERAL_SPEED:
                last += 1
            moved = side * (traffic.y[first : last + 1] - traffic.y[first])
            middle = None
            if moved[-1] > 0.5:
                share = moved / moved[-1]
                middle = (np.argmax(share >= 0.9) - np.argmax(share >= 0.1)) * INTERVAL
            changes.append(
                RecordedLaneChange(
                    vehicle, time[crossing], crossing, lane[crossing - 1], lane[crossing],
                    time[first], time[last], time[last] - time[first], middle,
                    lateral[first : last + 1].max(),
                    first > part.start and last < part.stop - 1,
                )
            )  # fmt: skip
    return changes


def encounters(traffic: RecordedTraffic) -> dict[str, Iterable[Event]]:
    """The events of one recording by kind, ghosts among them (`ghost`)."""
    return {
        "approach": _approaches(traffic),
        "cut_out": _cut_outs(traffic),
        "cut_in": _cut_ins(traffic),
        "lead_braking": _braking_leads(traffic),
    }


def _stretches(traffic: RecordedTraffic) -> list[slice]:
    """The rows of every stretch in which a vehicle stays behind one lead in one lane."""
    led, names = traffic.lead >= 0, traffic.names
    keys = DataFrame(
        {"vehicle": names, "lead": np.where(led, names[traffic.lead], ""), "lane": traffic.lane}
    )
    edges = [*np.flatnonzero((keys != keys.shift()).any(axis=1)).tolist(), len(names)]
    return [slice(first, last) for first, last in itertools.pairwise(edges) if led[first]]


def _is_ghost(gap: float, ttc: float, accelerations: np.ndarray) -> bool:
    """Whether a gap, m, a TTC, s, or accelerations, m/s2, are a fault of the tracker."""
    strongest = np.abs(accelerations).max()
    return gap < GHOST_GAP or ttc < GHOST_TTC or strongest > GHOST_ACCELERATION


def _start_kind(traffic: RecordedTraffic, start: int, row: int) -> str:
    """Kind of start of an approach, at a row of the stretch that begins at `start`.

    dataset_edge: the recording of the ego or of the lead begins there.
    lane_entry_or_cut_in: the stretch begins there otherwise, with another lead or lane.
    range_crossing: an ego that closes in comes within `APPROACH_HEADWAY`.
    closing_builds_up: any other.
    """
    if row == start:
        edge = any(
            at == traffic.slices[traffic.names[at]].start for at in (start, traffic.lead[start])
        )
        return "dataset_edge" if edge else "lane_entry_or_cut_in"
    far = traffic.gap[row - 1] > APPROACH_HEADWAY * traffic.speed[row - 1]
    crossed = far and traffic.closing[row - 1] >= CLOSING_SPEED
    return "range_crossing" if crossed else "closing_builds_up"


def _outcome(traffic: RecordedTraffic, row: int, end: int) -> tuple[str, int]:
    """Kind and row of the end of an approach.

    follow: the closing speed is below `FOLLOWS_BELOW`.
    lane_change: the ego changes lane.
    leader_left: the lead changes lane.
    cut_in: another vehicle is between both.
    censored: a recording ends.

    row: where it begins.
    end: the row after the last of its stretch.
    """
    lane = traffic.lane
    follows = traffic.closing[row:end] < FOLLOWS_BELOW
    if follows.any():
        return "follow", row + int(np.argmax(follows))
    if end < traffic.slices[traffic.names[row]].stop:
        if lane[end] != lane[row]:
            return "lane_change", end
        lead = traffic.row_at(traffic.frame[end], traffic.lead[row])
        if lead is not None:
            return "leader_left" if lane[lead] != lane[end] else "cut_in", end
    return "censored", end - 1


def _approaches(traffic: RecordedTraffic) -> list[Event]:
    gap, speed = traffic.gap, traffic.speed
    begun = (
        (traffic.closing >= CLOSING_SPEED)
        & (gap <= np.maximum(APPROACH_HEADWAY * speed, APPROACH_GAP))
        & (gap > LEAST_GAP)
    )
    onsets = {change.row: change.onset for change in traffic.changes}
    return [
        _approach(traffic, part, part.start + int(np.argmax(begun[part])), onsets)
        for part in _stretches(traffic)
        if begun[part].any() and traffic.ttc[part].min() <= LARGEST_TTC
    ]


def _approach(
    traffic: RecordedTraffic, stretch: slice, row: int, onsets: Mapping[int, float]
) -> Event:
    """The approach that begins at a row of a stretch.

    onsets: of the lane changes, s, by the row of the crossing.
    """
    gap, speed, time = traffic.gap, traffic.speed, traffic.t
    ego, lead, end = traffic.names[row], traffic.lead[row], stretch.stop
    least_ttc, least_gap = traffic.ttc[stretch].min(), gap[stretch].min()
    outcome, ended = _outcome(traffic, row, end)
    event = {
        "ego": ego,
        "t": time[row],
        "lead": traffic.names[lead],
        "start_kind": _start_kind(traffic, stretch.start, row),
        "lane": traffic.lane[row],
        "ego_speed": speed[row],
        "lead_speed": speed[lead],
        "gap": gap[row],
        "outcome": outcome,
        "t_outcome": time[ended] - time[row],
        "min_ttc": least_ttc,
        "min_gap": least_gap,
        "min_acceleration": traffic.acceleration[row:end].min(),
        "to_left": None,
        "change_onset": None,
        "headway_at_onset": None,
        "ttc_at_onset": None,
        "ghost": _is_ghost(least_gap, least_ttc, traffic.acceleration[row:end]),
    }
    if end in onsets:  # the stretch ends with a lane change of the ego
        onset = onsets[end] - time[row]
        at = max(round(onset / INTERVAL) + row, stretch.start)
        event |= {
            "to_left": bool(traffic.lane[end] > traffic.lane[row]),
            "change_onset": onset,
            "headway_at_onset": gap[at] / max(speed[at], 0.1),  # finite at a standstill
            "ttc_at_onset": None if traffic.closing[at] <= 0 else traffic.ttc[at],
        }
    return event


def _cut_outs(traffic: RecordedTraffic) -> Iterator[Event]:
    gap, speed, names = traffic.gap, traffic.speed, traffic.names
    for change in traffic.changes:
        behind = traffic.follower[change.row - 1]
        if behind < 0:
            continue
        ego, now = names[behind], behind + 1  # rows of the ego just before the crossing, and at it
        stop = traffic.slices[ego].stop
        reach = max(CUT_OUT_HEADWAY * speed[behind], CUT_OUT_GAP)
        if now == stop or gap[behind] > reach:
            continue
        revealed = traffic.lead[now]
        near = gap[now] <= REVEALED_WITHIN and names[revealed] != change.vehicle
        begin, start = traffic.onset_of(behind, change)
        at_onset = dict.fromkeys(("obstacle_speed", "gap"), np.nan)
        if near:
            ahead = traffic.row_at(traffic.frame[begin], revealed)
            if ahead is not None:
                at_onset = {"obstacle_speed": speed[ahead], "gap": traffic.apart(begin, ahead)}
        braking = traffic.acceleration[now : min(now + _BRAKING_SAMPLES, stop)]
        yield {
            "ego": ego,
            "t": traffic.t[now],
            "cut_out": change.vehicle,
            "revealed": names[revealed] if near else "",
            "to_left": change.to > change.origin,
            "speed_at_crossing": speed[now],
            "cut_out_speed": speed[change.row],
            "gap_to_cut_out": gap[behind],
            "revealed_speed": speed[revealed] if near else np.nan,
            "gap_to_revealed": gap[now] if near else np.nan,
            "ego_speed": speed[begin],
            "start": start,
            **at_onset,
            "min_acceleration": braking.min(),
            "ghost": _is_ghost(gap[behind], np.inf, braking),
        }


def _cut_ins(traffic: RecordedTraffic) -> Iterator[Event]:
    gap, speed = traffic.gap, traffic.speed
    for change in traffic.changes:
        row = traffic.follower[change.row]
        if row < 0 or gap[row] > max(CUT_IN_HEADWAY * speed[row], CUT_IN_GAP):
            continue
        ego = traffic.names[row]
        part = traffic.slices[ego]
        if row == part.start or traffic.lane[row - 1] != traffic.lane[row]:
            continue
        begin, start = traffic.onset_of(row, change)
        other = change.row - row + begin  # row of the vehicle that cuts in, at the time of `begin`
        braking = traffic.acceleration[row : min(row + _BRAKING_SAMPLES, part.stop)]
        yield {
            "ego": ego,
            "t": traffic.t[row],
            "start": start,
            "cut_in": change.vehicle,
            "to_left": change.to > change.origin,
            "ego_speed": speed[begin],
            "cut_in_speed": speed[other],
            "gap": traffic.apart(begin, other),
            "lateral_speed": change.lateral_speed,
            "min_acceleration": braking.min(),
            "ghost": change.lateral_speed > GHOST_LATERAL_SPEED
            or _is_ghost(gap[row], np.inf, braking),
        }


def _braking_leads(traffic: RecordedTraffic) -> Iterator[Event]:
    gap, speed, acceleration = traffic.gap, traffic.speed, traffic.acceleration
    for stretch in _stretches(traffic):
        lead = traffic.lead[stretch]  # rows of the lead, one for each row of the ego
        braking = acceleration[lead] <= -BRAKING_BELOW
        # of each braking, its first sample and the one after its last
        edges = np.flatnonzero(np.diff(np.concatenate(([0], braking, [0]))))
        for first, last in edges.reshape(-1, 2).tolist():
            row = stretch.start + first
            part = slice(row, stretch.start + last)
            strongest = acceleration[lead[first:last]].min()
            drop = speed[lead[first]] - speed[lead[last - 1]]
            if strongest > -LEAD_DECELERATION or drop < LEAD_SPEED_DROP:
                continue
            of_both = np.append(acceleration[part], strongest)
            yield {
                "ego": traffic.names[row],
                "t": traffic.t[row],
                "start": traffic.t[row],
                "lead": traffic.names[lead[first]],
                "ego_speed": speed[row],
                "lead_speed": speed[lead[first]],
                "gap": gap[row],
                "headway": gap[row] / max(speed[row], 0.1),
                "lead_deceleration": -strongest,
                "lead_speed_drop": drop,
                "min_acceleration": acceleration[part].min(),
                "ghost": _is_ghost(gap[part].min(), traffic.ttc[part].min(), of_both),
            }


def write_events(events: Events, folder: Path) -> None:
    """One CSV a kind, and the lane changes."""
    tables = {**events.tables, "lane_change": events.lane_changes.drop(columns="row")}
    with writing(f"The events in {folder}", folder):
        for kind, table in tables.items():
            each_text(table.round(4), cell).to_csv(folder / f"{kind}.csv", index=False)
