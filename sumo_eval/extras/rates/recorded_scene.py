"""A recorded scene as a scenario file: an ADS replaces one of the recorded vehicles, the rest drive
as recorded.

The others drive along their recorded path at their recorded speed. Where a model is named, SUMO
drives each of them by it from when the ADS is further from the recorded ego than so many metres,
once it is within a lane: who is changing lane then does so first. The file's only parameter,
`react_beyond`, is that distance; at `NEVER` nobody reacts.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import tomli_w

from sumo_eval.drivers.recorded.recordings import INTERVAL, STANDARD_LANE, Recordings
from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.scenario.file import check_file, read_scenario
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.trajectory import FloatArray

NEVER: Final = 100_000.0  # m; no ADS departs that far
REACH: Final = 300.0  # m along the road; who is always further from the ego is left out
LONGEST: Final = 120.0  # s of a scene
KNOTS: Final = 0.5  # s between two knots of a recorded speed
PATH_TOLERANCE: Final = 0.03  # m, that a path may be off the recorded one
WITHIN_LANE: Final = 0.6  # m off a lane's middle, from where on a vehicle can be handed over
# m of road behind whoever is last at the start, and ahead of whoever is first at the end
BEFORE, BEHIND = 100.0, 500.0
BODIES: Final = {"van": "van", "truck": "truck", "bus": "truck", "truck_bus": "truck",
    "motorcycle": "motorcycle",
                 "bicycle": "bicycle", "pedestrian": "pedestrian"}  # fmt: skip
"""Bodies of scenario files by recorded class; all others are cars."""
ROAD_AS_WRITTEN: Final = (
    "The lanes are straight and there throughout; bends, ramps and lanes that end are not written."
)
FAR, IN_ANOTHER, SHORT = (
    f"never within {REACH:g} m of the ego",
    "would stand in another vehicle where its track is continued to the start",
    "recorded for less than a second",
)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The scenario of a scene, and its errors.

    path: of the file.
    others: how many vehicles.
    left_out: why vehicles are not in it.

    continued: how many of the others were not recorded throughout, and are taken to keep their
        speed and lane before and after.
    error: root mean square and largest distance, m, of the others in the file from their recorded
        places.
    """

    path: Path
    others: int
    left_out: dict[str, int]
    continued: int
    error: tuple[float, float]
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class _Track:
    name: str
    body: str
    length: float
    width: float
    time: FloatArray
    x: FloatArray
    y: FloatArray


def write_scene(
    recordings: Recordings,
    path: Path,
    ego: str,
    *,
    recording: str | None = None,
    begin: float | None = None,
    end: float | None = None,
    model: str | None = None,
    beyond: float = 2.0,
) -> Scene:
    """Write the scenario file of a scene and say what became of it.

    ego: the vehicle in whose place an ADS is to drive.
    recording: which one; None: the only one that the ego is in.
    begin, end: of the scene, s of the recording; default: the first 30 s of the ego.
    model: SUMO's, by which the others react; None: nobody does.
    beyond: m.
    """
    table = _of_recording(recordings.table, recording, ego)
    if not 0.0 < beyond < NEVER:
        raise must_be(
            "The distance from which on others react",
            "a scene",
            f"above 0 m and below {NEVER:g} m",
            beyond,
        )
    own = table[table["vehicle"] == ego]
    first = float(own["t"].iloc[0]) if begin is None else begin
    last = min(first + 30.0, float(own["t"].iloc[-1])) if end is None else end
    if not (
        own["t"].iloc[0] - 1e-6 <= first < last <= own["t"].iloc[-1] + 1e-6
        and last - first <= LONGEST
    ):
        raise must_be(
            "Begin and end", f"the scene of vehicle `{ego}`",
            f"within its recording, {own['t'].iloc[0]:g} to {own['t'].iloc[-1]:g} s, at most "
            f"{LONGEST:g} s apart",
            f"{first:g} to {last:g} s",
        )  # fmt: skip
    lowest, width, lanes = _lanes(table[(table["t"] >= first) & (table["t"] <= last)])
    clock = np.arange(round((last - first) / INTERVAL) + 1) * INTERVAL
    mine = _track(own, first, lowest, "ego")
    at = np.column_stack([np.interp(clock, mine.time, mine.x), np.interp(clock, mine.time, mine.y)])
    left_out: Counter[str] = Counter()
    others: list[_Track] = []
    continued = 0
    begins = {
        str(name): float(rows["t"].iloc[0]) for name, rows in table.groupby("vehicle", sort=False)
    }
    for name in sorted(begins, key=lambda name: (begins[name], name)):
        rows = table[(table["vehicle"] == name) & (table["t"] >= first) & (table["t"] <= last)]
        if name == ego or rows.empty:
            continue
        if len(rows) < round(1.0 / INTERVAL):
            left_out[SHORT] += 1
            continue
        track = _track(rows, first, lowest, "v" + re.sub(r"\W", "_", name))
        near = np.abs(track.x - np.interp(track.time, clock, at[:, 0]))
        if near.min() > REACH:
            left_out[FAR] += 1
            continue
        whole = _continued(track)
        if any(_overlap(whole, other) for other in (mine, *others)):
            left_out[IN_ANOTHER] += 1
            continue
        continued += not (track.time[0] < INTERVAL and track.time[-1] > clock[-1] - INTERVAL)
        others.append(whole)
    if not others:
        raise InputError(
            f"Around vehicle `{ego}` there must be another one from {first:g} to {last:g} s, got "
            "none."
        )
    shift = BEFORE - min(float(track.x[0]) for track in (mine, *others))
    road = max(float(track.x.max()) for track in (mine, *others)) + shift + BEHIND
    seconds = float(clock[-1])
    content = {
        "name": re.sub(r"\W", "_", path.stem),
        "about": f"A recorded scene: what was around vehicle {ego}, {first:g} to {last:g} s. "
                 f"{ROAD_AS_WRITTEN}",
        "source": f"{table['recording'].iloc[0]}, recorded; " + (
            "nobody reacts" if model is None else "from a departure on others react as SUMO's "
                                                  f"{model}"),
        "zone": "none",
        "people": "none",
        "parameter": [{"name": "react_beyond", "unit": "m", "values": [beyond, NEVER],
                       "about": "distance of the ego from the recorded one beyond which the "
                                "others react"}],
        "constraint": [] if model else [{"require": f"react_beyond >= {NEVER:g}",
            "about": "one where nobody reacts"}],
        "road": {"lanes": lanes, "lane_width": width, "length": round(road, 1)},
        "end": {"x": round(road - BEHIND / 2.0, 1), "time": round(seconds, 1)},
        "ego": {"speed": round(_speed(mine, 0.0), 3), "x": round(at[0, 0] + shift, 3),
            "y": round(at[0, 1], 3),
                "length": mine.length, "width": mine.width,
                "recorded": [[round(x + shift, 3), round(y, 3)] for x, y in at.tolist()]},
        "vehicle": [_vehicle(track, shift, width, lanes, model or "IDM") for track in others],
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(content), encoding="utf-8")
    check_file(path)
    error = _error(path, others, shift, seconds)
    return Scene(path, len(others), dict(sorted(left_out.items())), continued, error, seconds)


def _of_recording(table: pd.DataFrame, recording: str | None, ego: str) -> pd.DataFrame:
    """The rows of the recording that is named, or else of the only one that the ego is in."""
    table = table.assign(
        recording=table["recording"].astype(str), vehicle=table["vehicle"].astype(str)
    )
    if recording is not None and recording not in set(table["recording"]):
        raise unknown("recording", recording, [str(name) for name in table["recording"].unique()])
    searched = table if recording is None else table[table["recording"] == recording]
    names = [str(name) for name in searched.loc[searched["vehicle"] == ego, "recording"].unique()]
    if not names:
        raise unknown(
            "vehicle of the recording", ego, [str(name) for name in searched["vehicle"].unique()]
        )
    if len(names) > 1:
        raise InputError(
            f"`recording` must say which one is meant: vehicle `{ego}` is in {len(names)}, "
            f"{', '.join(names[:8])}."
        )
    return table[table["recording"] == names[0]]


def _lanes(rows: pd.DataFrame) -> tuple[float, float, int]:
    """Middle of the right-most lane with a vehicle, m, width of the lanes and how many
    there are.
    """
    middles = np.sort(rows.groupby("lane")["y"].median().to_numpy())
    gaps = np.diff(middles)
    gaps = gaps[(gaps > 2.5) & (gaps < 4.5)]
    width = round(float(np.median(gaps)), 2) if len(gaps) else STANDARD_LANE
    return float(middles[0]), width, max(round(float(middles[-1] - middles[0]) / width) + 1, 1)


def _track(rows: pd.DataFrame, first: float, lowest: float, name: str) -> _Track:
    """A vehicle's places since the begin of the scene, across the road from the middle of its
    right-most lane.
    """
    one = rows.iloc[0]
    time, x, y = (rows[key].to_numpy(dtype=np.float64) for key in ("t", "x", "y"))
    body = BODIES.get(str(one["class"]), "car")
    return _Track(
        name, body, float(one["length"]), float(one["width"]), time - first, x, y - lowest
    )


def _speed(track: _Track, time: float) -> float:
    """Speed along the road at a time, m/s, over half a second."""
    begin = min(max(time - 0.25, track.time[0]), track.time[-1] - 0.5)
    x = np.interp([begin, begin + 0.5], track.time, track.x)
    return float(max(x[1] - x[0], 0.0) / 0.5)


def _continued(track: _Track) -> _Track:
    """From the begin of the scene on: before its first place it is taken to have had its speed and
    lane.
    """
    if track.time[0] < INTERVAL / 2.0:
        return track
    before = np.arange(0.0, track.time[0] - INTERVAL / 2.0, INTERVAL)
    speed = _speed(track, float(track.time[0]))
    return replace(
        track,
        time=np.concatenate([before, track.time]),
        x=np.concatenate([track.x[0] - speed * (track.time[0] - before), track.x]),
        y=np.concatenate([np.full(len(before), track.y[0]), track.y]),
    )


def _overlap(one: _Track, other: _Track) -> bool:
    """Whether two bodies share ground at the begin of the scene."""
    beside = abs(one.y[0] - other.y[0]) < (one.width + other.width) / 2.0
    return bool(beside and abs(one.x[0] - other.x[0]) < (one.length + other.length) / 2.0)


def _vehicle(track: _Track, shift: float, width: float, lanes: int, model: str) -> dict[str, Any]:
    """A vehicle of the file: along its path, at its speed, until it is handed over."""
    x, y = track.x + shift, track.y
    way = np.concatenate([[0.0], np.hypot(np.diff(x), np.diff(y)).cumsum()])
    knots, speeds = fit_speeds(track.time, way)
    within = " or ".join(
        f"abs(y({track.name}) - {width * lane:g}) < {WITHIN_LANE}" for lane in range(lanes)
    )
    moves: list[dict[str, Any]] = []
    if way[-1] > 1.0:
        chosen = thinned(x, y, PATH_TOLERANCE)[1:]
        moves.append(
            {
                "do": "path",
                "points": [[round(float(x[k]), 3), round(float(y[k]), 3)] for k in chosen],
            }
        )
        moves.append(
            {
                "do": "speed_profile",
                "times": knots[1:].round(3).tolist(),
                "speeds": speeds[1:].round(3).tolist(),
            }
        )
    fastest = max(float(speeds.max()), 1.0)
    moves.append(
        {
            "do": "follow",
            "model": model,
            "speed": round(fastest, 2),
            "when": f"departed > react_beyond and ({within})",
        }
    )
    return {
        "name": track.name, "speed": round(float(speeds[0]), 3), "x": round(float(x[0]), 3),
        "y": round(float(y[0]), 3),
        "body": track.body, "length": track.length, "width": track.width, "manoeuvre": moves,
    }  # fmt: skip


def fit_speeds(time: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Knots, s, and speeds there, m/s, none below 0: straight between them, so that what is driven
    is nearest to `way` (n,) m at times (n,) s in the least squares sense. The first knot is at
    time[0].
    """
    from scipy.interpolate import make_interp_spline
    from scipy.optimize import lsq_linear

    count = max(round(float(time[-1] - time[0]) / KNOTS), 1) + 1
    knots = np.linspace(float(time[0]), float(time[-1]), count)
    hats = make_interp_spline(knots, np.eye(count), k=1)  # a speed of 1 m/s at each knot in turn
    solve: Any = lsq_linear
    return knots, np.asarray(
        solve(hats.antiderivative()(time), way - way[0], bounds=(0.0, np.inf)).x
    )


def thinned(x: FloatArray, y: FloatArray, tolerance: float) -> list[int]:
    """Numbers of the points that keep a line (n,) within `tolerance` m of what it was, by Douglas
    and Peucker.
    """
    kept, open_ = {0, len(x) - 1}, [(0, len(x) - 1)]
    while open_:
        a, b = open_.pop()
        if b - a < 2:
            continue
        dx, dy = x[b] - x[a], y[b] - y[a]
        length = math.hypot(dx, dy)
        px, py = x[a + 1 : b] - x[a], y[a + 1 : b] - y[a]
        off = np.abs(px * dy - py * dx) / length if length > 0.0 else np.hypot(px, py)
        worst = int(off.argmax())
        if off[worst] > tolerance:
            middle = a + 1 + worst
            kept.add(middle)
            open_ += [(a, middle), (middle, b)]
    return sorted(kept)


def _error(path: Path, others: list[_Track], shift: float, seconds: float) -> tuple[float, float]:
    """Root mean square and largest distance of the actors from their recorded positions, m."""
    concrete = read_scenario(path).concrete(react_beyond=NEVER)
    body = concrete.ego_body
    assert body is not None
    found = tracks([concrete], [(body.length, body.width)], INTERVAL, seconds).others[0]
    apart = []
    for j, track in enumerate(others):
        seen = track.time <= seconds + 1e-6
        clock = np.arange(found.shape[1]) * INTERVAL
        ahead = np.interp(track.time[seen], clock, found[j, :, 0]) - track.x[seen] - shift
        apart.append(
            np.hypot(ahead, np.interp(track.time[seen], clock, found[j, :, 1]) - track.y[seen])
        )
    every = np.concatenate(apart)
    return float(np.sqrt(np.mean(every**2))), float(every.max())
