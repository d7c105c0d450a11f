"""A recorded scene as a scenario file: an ADS replaces one of the recorded vehicles, the rest drive
as recorded.

The actors drive along their recorded path at their recorded speed. Where a model is named, SUMO
drives each of them by it from when the ADS is further from the recorded ego than a distance, once
the actor is within a lane: an unfinished lane change ends first. The file's only parameter,
`react_beyond`, is that distance; at `NEVER` no actor reacts.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import tomli_w

from sumo_eval.drivers.recorded.recordings import INTERVAL, STANDARD_LANE, Recordings
from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.scenario.file import check_file, read_scenario
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.trajectory import FloatArray

NEVER = 100_000.0  # m; no ADS departs that far
REACH = 300.0  # m along the road; vehicles that are always further from the ego are left out
LONGEST = 120.0  # s of a scene
KNOTS = 0.5  # s between two knots of a recorded speed
PATH_TOLERANCE = 0.03  # m, that a path may be off the recorded one
WITHIN_LANE = 0.6  # m off a lane's middle, from where on a vehicle can be handed over
# m of road behind the last vehicle at the start, and ahead of the first one at the end
BEFORE, BEHIND = 100.0, 500.0
BODIES = {"van": "van", "truck": "truck", "bus": "truck", "truck_bus": "truck",
    "motorcycle": "motorcycle",
                 "bicycle": "bicycle", "pedestrian": "pedestrian"}  # fmt: skip
"""Bodies of scenario files by recorded class; all others are cars."""
ROAD_AS_WRITTEN = (
    "The lanes are straight and there throughout; curves, ramps and lanes that end are not written."
)
NO_REACTION = "no actor reacts"
FAR, IN_ANOTHER, SHORT = (
    f"never within {REACH:g} m of the ego",
    "would stand in another vehicle where its track is continued to the start",
    "recorded for less than a second",
)


class WrittenScene(NamedTuple):
    """The scenario of a scene, and its errors.

    path: of the file.
    others: number of actors.
    left_out: why vehicles are not in it.
    continued: number of actors that were not recorded throughout, and are assumed to keep their
        speed and lane before and after.
    error: root mean square and largest distance, m, of the actors in the file from their recorded
        positions.
    """

    path: Path
    others: int
    left_out: dict[str, int]
    continued: int
    error: tuple[float, float]
    seconds: float


class _Track(NamedTuple):
    """Positions since the start of the scene, across the road from the middle of its right-most
    lane.
    """

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
    span: tuple[float | None, float | None] = (None, None),
    model: str | None = None,
    beyond: float = 2.0,
) -> WrittenScene:
    """Write the scenario file of a scene and report on it.

    ego: the vehicle that an ADS is to replace.
    recording: its name; None: the only one that the ego is in.
    span: start and end of the scene, s of the recording; default: the first 30 s of the ego.
    model: SUMO's, by which the actors react; None: they do not.
    beyond: m.
    """
    if path.suffix != ".toml":
        raise must_be("The file", "a scene", "one that ends with .toml", str(path))
    table = _of_recording(recordings.table, recording, ego)
    if not 0.0 < beyond < NEVER:
        bounds = f"above 0 m and below {NEVER:g} m"
        raise must_be("The distance from which on actors react", "a scene", bounds, beyond)
    own = table[table["vehicle"] == ego]
    start, stop = own["t"].iloc[[0, -1]]
    first = start if span[0] is None else span[0]
    last = min(first + 30.0, stop) if span[1] is None else span[1]
    if not (start - 1e-6 <= first < last <= stop + 1e-6 and last - first <= LONGEST):
        raise must_be(
            "Begin and end", f"the scene of vehicle `{ego}`",
            f"within its recording, {start:g} to {stop:g} s, at most {LONGEST:g} s apart",
            f"{first:g} to {last:g} s",
        )  # fmt: skip
    begins = table.groupby("vehicle", sort=False)["t"].min()
    table = table[table["t"].between(first, last)]
    lowest, width, lanes = _lanes(table)
    clock = np.arange(round((last - first) / INTERVAL) + 1) * INTERVAL
    seconds = float(clock[-1])
    mine = _track(own, first, lowest, "ego")
    speed = _speed(mine, 0.0)
    # before and after the scene it is not there
    x, y = (np.interp(clock, mine.time, values) for values in (mine.x, mine.y))
    mine = mine._replace(time=clock, x=x, y=y)
    left_out: Counter[str] = Counter()
    actors: list[_Track] = []
    continued = 0
    names = set(table["vehicle"]) - {ego}
    for name in sorted(names, key=lambda name: (begins[name], name)):
        rows = table[table["vehicle"] == name]
        written = "v" + re.sub(r"\W", "_", name)
        while written in (it.name for it in actors):
            written += "_"
        track = _track(rows, first, lowest, written)
        whole = _continued(track)
        if len(rows) < round(1.0 / INTERVAL):
            left_out[SHORT] += 1
        elif np.abs(track.x - np.interp(track.time, clock, x)).min() > REACH:
            left_out[FAR] += 1
        elif any(_overlap(whole, other) for other in (mine, *actors)):
            left_out[IN_ANOTHER] += 1
        else:
            continued += track.time[0] >= INTERVAL or track.time[-1] <= clock[-1] - INTERVAL
            actors.append(whole)
    if not actors:
        raise InputError(
            f"Around vehicle `{ego}` there must be a vehicle from {first:g} to {last:g} s, got "
            "none."
        )
    shift = BEFORE - min(float(track.x[0]) for track in (mine, *actors))
    road = max(float(track.x.max()) for track in (mine, *actors)) + shift + BEHIND
    reaction = f"from a departure on actors react as SUMO's {model}" if model else NO_REACTION
    never = {"require": f"react_beyond >= {NEVER:g}", "about": f"one where {NO_REACTION}"}
    content = {
        "name": re.sub(r"\W", "_", path.stem),
        "about": f"A recorded scene: traffic around vehicle {ego}, {first:g} to {last:g} s. "
                 f"{ROAD_AS_WRITTEN}",
        "source": f"{table['recording'].iloc[0]}, recorded; {reaction}",
        "zone": "none",
        "people": "none",
        "parameter": [{"name": "react_beyond", "unit": "m", "values": [beyond, NEVER],
            "about": "distance of the ego from the recorded one beyond which actors react"}],
        "constraint": [] if model else [never],
        "road": {"lanes": lanes, "lane_width": width, "length": round(road, 1)},
        "end": {"x": round(road - BEHIND / 2.0, 1), "time": round(seconds, 1)},
        "ego": {"speed": round(speed, 3), "x": round(x[0] + shift, 3),
            "y": round(y[0], 3), "length": mine.length, "width": mine.width,
            "recorded": np.column_stack([x + shift, y]).round(3).tolist()},
        "vehicle": [_vehicle(track, shift, width, lanes, model or "IDM") for track in actors],
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(content), encoding="utf-8")
    check_file(path)
    error = _error(path, actors, shift, seconds)
    return WrittenScene(
        path, len(actors), dict(sorted(left_out.items())), continued, error, seconds
    )


def _of_recording(table: pd.DataFrame, recording: str | None, ego: str) -> pd.DataFrame:
    """The rows of the recording that is named, or else of the only one that the ego is in."""
    table = table.astype({"recording": str, "vehicle": str})
    known = table["recording"].unique().tolist()
    if recording is not None and recording not in known:
        raise unknown("recording", recording, known)
    searched = table if recording is None else table[table["recording"] == recording]
    names = searched.loc[searched["vehicle"] == ego, "recording"].unique().tolist()
    if not names:
        raise unknown("vehicle of the recording", ego, searched["vehicle"].unique().tolist())
    if len(names) > 1:
        raise InputError(
            f"`recording` must name one recording: vehicle `{ego}` is in {len(names)}, "
            f"{', '.join(names[:8])}."
        )
    rows: pd.DataFrame = table[table["recording"] == names[0]]
    return rows


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
    time, x, y = (rows[key].to_numpy(dtype=np.float64) for key in ("t", "x", "y"))
    kind, length, width = (rows[key].iloc[0] for key in ("class", "length", "width"))
    body = BODIES.get(str(kind), "car")
    return _Track(name, body, float(length), float(width), time - first, x, y - lowest)


def _speed(track: _Track, time: float) -> float:
    """Speed along the road at a time, m/s, over half a second."""
    begin = min(max(time - 0.25, track.time[0]), track.time[-1] - 0.5)
    x = np.interp([begin, begin + 0.5], track.time, track.x)
    return float(max(x[1] - x[0], 0.0) / 0.5)


def _continued(track: _Track) -> _Track:
    """From the start of the scene on: before its first position it is assumed to have had its speed
    and lane.
    """
    before = np.arange(0.0, track.time[0] - INTERVAL / 2.0, INTERVAL)
    x = track.x[0] - _speed(track, float(track.time[0])) * (track.time[0] - before)
    return track._replace(
        time=np.append(before, track.time),
        x=np.append(x, track.x),
        y=np.append(np.full(len(before), track.y[0]), track.y),
    )


def _overlap(one: _Track, other: _Track) -> bool:
    """Whether two bodies share ground at the start of the scene."""
    beside = abs(one.y[0] - other.y[0]) < (one.width + other.width) / 2.0
    return bool(beside and abs(one.x[0] - other.x[0]) < (one.length + other.length) / 2.0)


def _vehicle(track: _Track, shift: float, width: float, lanes: int, model: str) -> dict[str, Any]:
    """A vehicle of the file: along its path, at its speed, until it is handed over."""
    x, y = track.x + shift, track.y
    way = np.append(0.0, np.hypot(np.diff(x), np.diff(y)).cumsum())
    knots, speeds = fit_speeds(track.time, way)
    within = " or ".join(
        f"abs(y({track.name}) - {width * lane:g}) < {WITHIN_LANE}" for lane in range(lanes)
    )
    places = np.column_stack([x, y]).round(3)
    times, pace = knots.round(3).tolist(), speeds.round(3).tolist()
    path = {"do": "path", "points": places[thinned(x, y, PATH_TOLERANCE)[1:]].tolist()}
    profile = {"do": "speed_profile", "times": times[1:], "speeds": pace[1:]}
    follow = {
        "do": "follow",
        "model": model,
        "speed": round(max(float(speeds.max()), 1.0), 2),
        "when": f"departed > react_beyond and ({within})",
    }
    return {
        "name": track.name, "speed": pace[0], "x": float(places[0, 0]), "y": float(places[0, 1]),
        "body": track.body, "length": track.length, "width": track.width,
        "manoeuvre": [path, profile, follow] if way[-1] > 1.0 else [follow],
    }  # fmt: skip


def fit_speeds(time: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Knots, s, and speeds there, m/s, none below 0: straight between them, so that the distance is
    nearest to `way` (n,) m at times (n,) s in the least squares sense. The first knot is at
    time[0].
    """
    from scipy.interpolate import make_interp_spline
    from scipy.optimize import lsq_linear

    count = max(round(float(time[-1] - time[0]) / KNOTS), 1) + 1
    knots = np.linspace(float(time[0]), float(time[-1]), count)
    hats = make_interp_spline(
        knots, np.eye(count), k=1
    )  # a speed of 1 m/s at one knot, 0 at others
    solve: Any = lsq_linear
    driven = hats.antiderivative()(time)
    return knots, np.asarray(solve(driven, way - way[0], bounds=(0.0, np.inf)).x)


def thinned(x: FloatArray, y: FloatArray, tolerance: float) -> list[int]:
    """Numbers of the points that keep a line (n,) within `tolerance` m of its former course, by
    Douglas and Peucker.
    """
    kept, open_ = {0, len(x) - 1}, [(0, len(x) - 1)]
    while open_:
        a, b = open_.pop()
        dx, dy = x[b] - x[a], y[b] - y[a]
        length = math.hypot(dx, dy)
        px, py = x[a + 1 : b] - x[a], y[a + 1 : b] - y[a]
        off = np.abs(px * dy - py * dx) / length if length > 0.0 else np.hypot(px, py)
        if off.size and off.max() > tolerance:
            middle = a + 1 + int(off.argmax())
            kept.add(middle)
            open_ += [(a, middle), (middle, b)]
    return sorted(kept)


def _error(path: Path, actors: list[_Track], shift: float, seconds: float) -> tuple[float, float]:
    """Root mean square and largest distance of the actors from their recorded positions, m."""
    concrete = read_scenario(path).concrete(react_beyond=NEVER)
    body = concrete.ego_body
    assert body is not None
    driven = tracks([concrete], [(body.length, body.width)], INTERVAL, seconds).others[0]
    clock = np.arange(driven.shape[1]) * INTERVAL
    apart = []
    for (x, y, *_), track in zip(driven.transpose(0, 2, 1), actors, strict=True):
        seen = track.time <= seconds + 1e-6
        time = track.time[seen]
        ahead = np.interp(time, clock, x) - track.x[seen] - shift
        apart.append(np.hypot(ahead, np.interp(time, clock, y) - track.y[seen]))
    every = np.concatenate(apart)
    return float(np.sqrt(np.mean(every**2))), float(every.max())
