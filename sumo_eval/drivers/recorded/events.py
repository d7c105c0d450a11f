"""Events in recorded driving: approaches to a slower lead, cut-outs, cut-ins, braking leads, lane
changes.

Rules (bumper-to-bumper gaps; lanes count once they are kept for 1 s; lead: the next vehicle in
front in the same lane):

- approach: t = 0 at the first sample of a stretch behind one lead with a closing speed of at least
  2 m/s, a gap of at most max(3.5 s * speed, 30 m) and more than 2 m; kept where the least TTC of
  the stretch is at most 20 s.
- cut_out: a lead changes lane, at most max(4 s * speed, 30 m) ahead; t = 0 when its lane number
  changes. `revealed` is the next vehicle in front within 300 m.
- cut_in: a vehicle changes into the lane of another, at most max(3 s * speed, 25 m) ahead of it.
- lead_braking: a lead brakes with at least 1 m/s2 and loses at least 2 m/s.

Dropped as ghosts of the tracker: a least TTC under 1 s, a gap under 1 m, accelerations beyond 6
m/s2, cut-ins with a lateral speed over 2 m/s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.recordings import INTERVAL, MOTOR_CLASSES, Recordings, smooth
from sumo_eval.input_file import writing
from sumo_eval.text import cells

KINDS: Final = ("approach", "cut_out", "cut_in", "lead_braking")


@dataclass(frozen=True, slots=True)
class EventRules:
    """The constants of the rules above, SI units."""

    closing_speed: float = 2.0
    approach_headway: float = 3.5
    approach_gap: float = 30.0
    least_gap: float = 2.0
    largest_ttc: float = 20.0
    follows_below: float = 0.5  # closing speed under which an approach has turned into following
    cut_out_headway: float = 4.0
    cut_out_gap: float = 30.0
    revealed_within: float = 300.0
    cut_in_headway: float = 3.0
    cut_in_gap: float = 25.0
    lead_deceleration: float = 1.0
    lead_speed_drop: float = 2.0
    braking_below: float = 0.3  # deceleration that begins and ends a leader's braking
    lane_kept: float = 1.0  # s on both sides of a lane change
    lateral_speed: float = 0.12  # m/s, above which a vehicle is changing lane
    ghost_ttc: float = 1.0
    ghost_gap: float = 1.0
    ghost_acceleration: float = 6.0
    ghost_lateral_speed: float = 2.0


RULES: Final = EventRules()


@dataclass(frozen=True, slots=True, eq=False)
class Events:
    """Events by kind, one row each; how many vehicles were looked at and are in an event; how many
    were ghosts.
    """

    tables: dict[str, pd.DataFrame]
    lane_changes: pd.DataFrame
    vehicles: int
    vehicles_in_events: int
    ghosts: dict[str, int] = field(default_factory=dict)

    def sentences(self) -> list[str]:
        """The findings in words."""
        counts = ", ".join(
            f"{len(self.tables[kind])} {kind} ({self.ghosts.get(kind, 0)} ghosts dropped)"
            for kind in KINDS
        )
        return [
            f"{self.vehicles_in_events} of {self.vehicles} motor vehicles are in an event: "
            f"{counts}.",
            f"{len(self.lane_changes)} lane changes.",
        ]


class Traffic:
    """A recording indexed for questions: each vehicle's arrays, and which vehicle is in front of
    and behind each one at each instant.
    """

    def __init__(self, table: pd.DataFrame) -> None:
        rows = table[table["class"].isin(MOTOR_CLASSES)].sort_values(
            ["vehicle", "t"], kind="stable", ignore_index=True
        )
        rows["frame"] = np.round(rows["t"] / INTERVAL).astype(np.int64)
        settled, across = [], []
        self.slices: dict[str, slice] = {}
        for name, index in rows.groupby("vehicle", sort=False).indices.items():
            self.slices[str(name)] = slice(int(index[0]), int(index[-1]) + 1)
            settled.append(
                _settled(rows["lane"].to_numpy()[index], round(RULES.lane_kept / INTERVAL))
            )
            across.append(np.gradient(smooth(rows["y"].to_numpy()[index], 11), INTERVAL))
        rows["lane"] = np.concatenate(settled) if settled else rows["lane"]
        rows["across"] = np.concatenate(across) if across else 0.0
        self.rows = rows
        self.frame = rows["frame"].to_numpy()
        order = rows.sort_values(["frame", "lane", "x"], kind="stable")
        ahead = order.index.to_series().shift(-1)
        same = (order["frame"] == order["frame"].shift(-1)) & (
            order["lane"] == order["lane"].shift(-1)
        )
        leader = pd.Series(-1, index=order.index)
        leader[same] = ahead[same].astype(np.int64)
        self.leader = leader.reindex(rows.index).to_numpy()
        x, length, speed = (rows[name].to_numpy() for name in ("x", "length", "speed"))
        has = self.leader >= 0
        lead = np.where(has, self.leader, 0)
        self.gap = np.where(has, x[lead] - x - (length[lead] + length) / 2, np.inf)
        self.closing = np.where(has, speed - speed[lead], 0.0)
        self.follower = np.full(len(rows), -1)
        self.follower[self.leader[has]] = np.flatnonzero(has)

    def columns(self, *names: str) -> Iterator[np.ndarray]:
        """Columns of the rows, (n,)."""
        return (self.rows[name].to_numpy() for name in names)

    def row_of(self, vehicle: str, frame: int) -> int | None:
        """The row of a vehicle at a frame; None where it is not recorded."""
        part = self.slices[vehicle]
        row = part.start + frame - int(self.frame[part.start])
        return row if part.start <= row < part.stop else None


def extract_events(recordings: Recordings) -> Events:
    """Every event of the recordings.

    The columns of an event table begin with event, recording, ego, t (s, its t = 0).
    """
    found: dict[str, list[dict[str, Any]]] = {kind: [] for kind in KINDS}
    changes: list[dict[str, Any]] = []
    vehicles = 0
    for recording, table in recordings.table.groupby("recording", sort=False):
        traffic = Traffic(table)
        vehicles += len(traffic.slices)
        lane_changes = find_lane_changes(traffic)
        changes += [{**asdict(change), "recording": recording} for change in lane_changes]
        for kind, events in encounters(traffic, lane_changes).items():
            found[kind] += [{"recording": recording, **event} for event in events]
    kept = {
        kind: [event for event in events if not event["ghost"]] for kind, events in found.items()
    }
    return Events(
        {kind: _table(kind, events) for kind, events in kept.items()},
        pd.DataFrame(changes, columns=[*_CHANGE_COLUMNS, "recording"]),
        vehicles,
        len({(event["recording"], event["ego"]) for events in kept.values() for event in events}),
        {kind: len(found[kind]) - len(kept[kind]) for kind in KINDS},
    )


def _table(kind: str, events: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """Events of a kind, numbered."""
    rows = [{"event": f"{kind}-{number:05d}", **event} for number, event in enumerate(events)]
    table = pd.DataFrame(rows, columns=None if rows else ["event", "recording", "ego", "t"])
    return table.drop(columns="ghost", errors="ignore")


def encounters(
    traffic: Traffic, changes: Sequence[RecordedLaneChange]
) -> dict[str, list[dict[str, Any]]]:
    """The events of one recording by kind, ghosts among them (`ghost`).

    changes: its lane changes.
    """
    return {
        "approach": _approaches(traffic, changes),
        "cut_out": _cut_outs(traffic, changes),
        "cut_in": _cut_ins(traffic, changes),
        "lead_braking": _braking_leads(traffic),
    }


def _settled(lane: np.ndarray, shortest: int) -> np.ndarray:
    """Lane numbers without visits shorter than `shortest` samples: these stay with the lane before
    (at first, after).
    """
    settled = lane.copy()
    starts = np.flatnonzero(np.append(True, np.diff(settled) != 0))
    ends = np.append(starts[1:], len(settled))
    previous: int | None = None
    for start, end in zip(starts, ends, strict=True):
        if end - start >= shortest:
            if previous is None:
                settled[:start] = settled[start]
            previous = int(settled[start])
        elif previous is not None:
            settled[start:end] = previous
    return settled


@dataclass(frozen=True, slots=True)
class RecordedLaneChange:
    """A lane change that is kept.

    t: crossing;
    onset, end: of the lateral motion;
    duration: between them;
    middle: from 10 to 90 % of the offset, all s.
    lateral_speed: the largest, m/s.
    row: of the crossing in `Traffic.rows`.
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


_CHANGE_COLUMNS: Final = [item.name for item in fields(RecordedLaneChange)]


def find_lane_changes(traffic: Traffic) -> list[RecordedLaneChange]:
    """Every lane change of a recording that is kept, by vehicle."""
    found: list[RecordedLaneChange] = []
    lane, time = traffic.columns("lane", "t")
    across, y = traffic.columns("across", "y")
    for vehicle, part in traffic.slices.items():
        for crossing in part.start + 1 + np.flatnonzero(np.diff(lane[part])):
            side = float(np.sign(lane[crossing] - lane[crossing - 1]))
            moving = side * across > RULES.lateral_speed
            first = int(crossing)
            while first > part.start and moving[first - 1]:
                first -= 1
            last = int(crossing)
            while last < part.stop - 1 and moving[last]:
                last += 1
            moved = side * (y[first : last + 1] - y[first])
            share = moved / moved[-1] if moved[-1] > 0.5 else None
            found.append(
                RecordedLaneChange(
                    vehicle=vehicle,
                    t=time[crossing],
                    row=crossing,
                    origin=lane[crossing - 1],
                    to=lane[crossing],
                    onset=time[first],
                    end=time[last],
                    duration=time[last] - time[first],
                    middle=None
                    if share is None
                    else float(np.argmax(share >= 0.9) - np.argmax(share >= 0.1)) * INTERVAL,
                    lateral_speed=np.max(side * across[first : last + 1]),
                    complete=first > part.start and last < part.stop - 1,
                )
            )
    return found


def _stretches(traffic: Traffic) -> list[tuple[int, int]]:
    """First and last-plus-one row of every stretch in which a vehicle stays behind one lead in
    one lane.
    """
    names, lane = traffic.columns("vehicle", "lane")
    has = traffic.leader >= 0
    lead = np.where(has, names[np.where(has, traffic.leader, 0)], "")
    new = np.append(
        True, (names[1:] != names[:-1]) | (lead[1:] != lead[:-1]) | (lane[1:] != lane[:-1])
    )
    starts = np.flatnonzero(new)
    ends = np.append(starts[1:], len(names))
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True) if has[a]]


def _is_ghost(gap: float, ttc: float, accelerations: np.ndarray) -> bool:
    """Whether these extremes are a tracker's, m, s and m/s2."""
    strongest = np.abs(accelerations).max()
    near = gap < RULES.ghost_gap or ttc < RULES.ghost_ttc
    return bool(near or strongest > RULES.ghost_acceleration)


def _start_kind(traffic: Traffic, start: int, row: int) -> str:
    """How an approach begins, at a row of the stretch that begins at `start`."""
    speed, names = traffic.columns("speed", "vehicle")
    if row == start:
        places = (start, traffic.leader[start])
        edge = any(place == traffic.slices[str(names[place])].start for place in places)
        return "dataset_edge" if edge else "lane_entry_or_cut_in"
    far = traffic.gap[row - 1] > RULES.approach_headway * speed[row - 1]
    crossed = far and traffic.closing[row - 1] >= RULES.closing_speed
    return "range_crossing" if crossed else "closing_builds_up"


def _outcome(traffic: Traffic, row: int, end: int) -> tuple[str, int]:
    """How an approach ends that begins at a row of a stretch up to `end`, and the row of that."""
    names, lane, frames = traffic.columns("vehicle", "lane", "frame")
    followed = np.flatnonzero(traffic.closing[row:end] < RULES.follows_below)
    if followed.size:
        return "follow", row + int(followed[0])
    if end < traffic.slices[str(names[row])].stop:
        if lane[end] != lane[end - 1]:
            return "lane_change", end
        after = traffic.row_of(str(names[traffic.leader[row]]), int(frames[end]))
        if after is not None:
            return "leader_left" if lane[after] != lane[end] else "cut_in", end
    return "censored", end - 1


def _approaches(traffic: Traffic, changes: Sequence[RecordedLaneChange]) -> list[dict[str, Any]]:
    gap, closing = traffic.gap, traffic.closing
    speed, acceleration, time = traffic.columns("speed", "acceleration", "t")
    lane, names = traffic.columns("lane", "vehicle")
    ttc = np.where(closing > 0, gap / np.maximum(closing, 1e-9), np.inf)
    begun = (
        (closing >= RULES.closing_speed)
        & (gap <= np.maximum(RULES.approach_headway * speed, RULES.approach_gap))
        & (gap > RULES.least_gap)
    )
    onsets = {(change.vehicle, change.row): change for change in changes}
    found = []
    for start, end in _stretches(traffic):
        hits = np.flatnonzero(begun[start:end])
        least_ttc, least_gap = ttc[start:end].min(), gap[start:end].min()
        if hits.size == 0 or least_ttc > RULES.largest_ttc:
            continue
        row = start + int(hits[0])
        ego, lead = str(names[row]), traffic.leader[row]
        leaves = end < traffic.slices[ego].stop and lane[end] != lane[end - 1]
        change = onsets.get((ego, end)) if leaves else None
        outcome, ended = _outcome(traffic, row, end)
        event = {
            "ego": ego,
            "t": time[row],
            "lead": str(names[lead]),
            "start_kind": _start_kind(traffic, start, row),
            "lane": lane[row],
            "ego_speed": speed[row],
            "lead_speed": speed[lead],
            "gap": gap[row],
            "outcome": outcome,
            "t_outcome": float(time[ended] - time[row]),
            "min_ttc": least_ttc,
            "min_gap": least_gap,
            "min_acceleration": float(acceleration[row:end].min()),
            "to_left": None,
            "change_onset": None,
            "headway_at_onset": None,
            "ttc_at_onset": None,
            "ghost": _is_ghost(least_gap, least_ttc, acceleration[row:end]),
        }
        if change is not None:
            onset = float(change.onset - time[row])
            at = max(round(onset / INTERVAL) + row, start)
            event |= {
                "to_left": bool(change.to > change.origin),
                "change_onset": onset,
                "headway_at_onset": float(gap[at] / max(speed[at], 0.1)),
                "ttc_at_onset": None if closing[at] <= 0 else float(ttc[at]),
            }
        found.append(event)
    return found


def _cut_outs(traffic: Traffic, changes: Sequence[RecordedLaneChange]) -> list[dict[str, Any]]:
    gap = traffic.gap
    speed, acceleration, time = traffic.columns("speed", "acceleration", "t")
    names, frames = traffic.columns("vehicle", "frame")
    found = []
    for change in changes:
        behind = int(traffic.follower[int(change.row) - 1])
        if behind < 0:
            continue
        ego = str(names[behind])
        now = traffic.row_of(ego, int(frames[change.row]))
        if now is None or gap[behind] > max(
            RULES.cut_out_headway * speed[behind], RULES.cut_out_gap
        ):
            continue
        revealed = int(traffic.leader[now])
        if revealed < 0 or gap[now] > RULES.revealed_within or names[revealed] == change.vehicle:
            revealed = -1
        begin = traffic.row_of(ego, round(change.onset / INTERVAL))
        begin = now if begin is None else begin
        window = slice(now, min(now + 100, traffic.slices[ego].stop))
        found.append(
            {
                "ego": ego,
                "t": time[now],
                "cut_out": change.vehicle,
                "revealed": str(names[revealed]) if revealed >= 0 else "",
                "to_left": change.to > change.origin,
                "speed_at_crossing": speed[now],
                "cut_out_speed": speed[change.row],
                "gap_to_cut_out": gap[behind],
                "revealed_speed": float(speed[revealed]) if revealed >= 0 else np.nan,
                "gap_to_revealed": float(gap[now]) if revealed >= 0 else np.nan,
                "ego_speed": speed[begin],
                "start": float(time[begin]),
                **_at_onset(traffic, revealed, begin),
                "min_acceleration": acceleration[window].min(),
                "ghost": _is_ghost(gap[behind], np.inf, acceleration[window]),
            }
        )
    return found


def _at_onset(traffic: Traffic, revealed: int, begin: int) -> dict[str, float]:
    """Speed of the revealed vehicle and gap to it at the onset of a cut-out; nan without one."""
    names, frames = traffic.columns("vehicle", "frame")
    ahead = traffic.row_of(str(names[revealed]), int(frames[begin])) if revealed >= 0 else None
    if ahead is None:
        return {"obstacle_speed": np.nan, "gap": np.nan}
    x, length, speed = traffic.columns("x", "length", "speed")
    gap = float(x[ahead] - x[begin] - (length[begin] + length[ahead]) / 2)
    return {"obstacle_speed": float(speed[ahead]), "gap": gap}


def _cut_ins(traffic: Traffic, changes: Sequence[RecordedLaneChange]) -> list[dict[str, Any]]:
    gap = traffic.gap
    speed, acceleration, time = traffic.columns("speed", "acceleration", "t")
    names, lane = traffic.columns("vehicle", "lane")
    found = []
    for change in changes:
        row = int(traffic.follower[int(change.row)])
        if row < 0 or gap[row] > max(RULES.cut_in_headway * speed[row], RULES.cut_in_gap):
            continue
        ego = str(names[row])
        part = traffic.slices[ego]
        if row == part.start or lane[row - 1] != lane[row]:
            continue
        window = slice(row, min(row + 100, part.stop))
        found.append(
            {
                "ego": ego,
                "t": time[row],
                "start": time[row],
                "cut_in": change.vehicle,
                "to_left": change.to > change.origin,
                "ego_speed": speed[row],
                "cut_in_speed": speed[change.row],
                "gap": gap[row],
                "lateral_speed": change.lateral_speed,
                "min_acceleration": acceleration[window].min(),
                "ghost": _is_ghost(gap[row], np.inf, acceleration[window])
                or change.lateral_speed > RULES.ghost_lateral_speed,
            }
        )
    return found


def _braking_leads(traffic: Traffic) -> list[dict[str, Any]]:
    gap, closing = traffic.gap, traffic.closing
    speed, acceleration, time = traffic.columns("speed", "acceleration", "t")
    (names,) = traffic.columns("vehicle")
    ttc = np.where(closing > 0, gap / np.maximum(closing, 1e-9), np.inf)
    found = []
    for start, end in _stretches(traffic):
        lead = traffic.leader[start:end]
        braking = acceleration[lead] <= -RULES.braking_below
        edges = np.flatnonzero(np.diff(np.concatenate(([False], braking, [False])).astype(int)))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            part = slice(start + int(first), start + int(last))
            strongest = float(acceleration[lead[first:last]].min())
            drop = float(speed[lead[first]] - speed[lead[last - 1]])
            if strongest > -RULES.lead_deceleration or drop < RULES.lead_speed_drop:
                continue
            row = part.start
            both = np.append(acceleration[part], strongest)
            found.append(
                {
                    "ego": str(names[row]),
                    "t": time[row],
                    "start": time[row],
                    "lead": str(names[lead[first]]),
                    "ego_speed": speed[row],
                    "lead_speed": speed[lead[first]],
                    "gap": gap[row],
                    "headway": gap[row] / max(speed[row], 0.1),
                    "lead_deceleration": -strongest,
                    "lead_speed_drop": drop,
                    "min_acceleration": acceleration[part].min(),
                    "ghost": _is_ghost(gap[part].min(), ttc[part].min(), both),
                }
            )
    return found


def write_events(events: Events, folder: Path) -> None:
    """One CSV a kind, and the lane changes."""
    with writing(f"The events in {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        for kind, table in events.tables.items():
            cells(table.round(4)).to_csv(folder / f"{kind}.csv", index=False)
        changes = events.lane_changes.drop(columns="row", errors="ignore").round(4)
        cells(changes).to_csv(folder / "lane_change.csv", index=False)


def lane_centres(table: pd.DataFrame) -> dict[tuple[str, int], float]:
    """Median y of the vehicles in each lane of each recording, m."""
    centres = {}
    for recording, rows in table.groupby("recording", sort=False):
        for lane, middle in rows.groupby("lane")["y"].median().items():
            centres[str(recording), int(str(lane))] = float(middle)
    return centres
