"""A recorded scene as a scenario file, in which an ADS replaces one vehicle, the recorded ego.

`sumo-eval humans scene` writes it. All other vehicles are actors: they drive along their recorded
paths at their recorded speeds.

The file's only parameter is `react_beyond`, a distance. The ego departs from the recorded ego by
the distance between both at the same time. If the user names a model, SUMO takes over the actors
once the ego has departed by more than `react_beyond`. An actor that is changing lane ends the
change first. At `NEVER` no actor reacts.

Users: `extras/rates/people_command.py`.
"""

import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from pandas import DataFrame

from sumo_eval.drivers.recorded.recordings import INTERVAL, STANDARD_LANE, Recordings
from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.extras.rates.encounters import lane_gaps
from sumo_eval.extras.rates.fitted import fit_speeds, thinned
from sumo_eval.report.page import write_page
from sumo_eval.scenario.file import check_points, scenario_from
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.trajectory import FloatArray

NEVER = 100_000.0  # m; no ADS departs that far
REACH = 300.0  # m along the road; vehicles that are always further from the ego are left out
LONGEST, USUAL = 120.0, 30.0  # s of a scene: at most, and by default
PATH_TOLERANCE = 0.03  # m; largest distance of a written path from the recorded one
WITHIN_LANE = 0.6  # m from the middle of a lane; further off, SUMO does not take over an actor
STANDS = 1.0  # m; a vehicle that drives no further in the scene stands
SPEED_OVER = 0.5  # s over which a speed is a mean
ROAD_BEHIND = 100.0  # m of road behind the last vehicle at the start
ROAD_AHEAD = 500.0  # m of road ahead of the first vehicle at the end
BODIES = {
    "van": "van",
    "truck": "truck",
    "bus": "truck",
    "truck_bus": "truck",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
"""Recorded class -> body of scenario files; all other classes are cars."""
ROAD_AS_WRITTEN = (
    "The lanes are straight and there throughout; curves, ramps and lanes that end are not written."
)
NO_REACTION = "no actor reacts"
# reasons why a vehicle is left out
FAR = f"never within {REACH:g} m of the ego"
IN_ANOTHER = "would stand in another vehicle where its track is continued to the start"
SHORT = "recorded for less than a second of the scene"


class WrittenScene(NamedTuple):
    """Report on a written scene.

    others: number of actors.
    left_out: reason -> number of vehicles.
    continued: number of actors that were not recorded throughout. Before and after they keep their
        speed and lane.
    error: root mean square and largest distance of the actors in the file from their recorded
        positions, m.
    seconds: duration of the scene.
    """

    others: int
    left_out: dict[str, int]
    continued: int
    error: tuple[float, float]
    seconds: float


class _Lanes(NamedTuple):
    """Lanes of the scene.

    right: y of the middle of the right-most lane with a vehicle, m.
    width: of each lane, m.
    """

    right: float
    width: float
    number: int


class _Track(NamedTuple):
    """Positions of a vehicle.

    body: as in scenario files.
    length, width: of the body, m.
    time: s since the start of the scene, (n,).
    x: along the road, m, (n,).
    y: to the left of the middle of the right-most lane, m, (n,).
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
    recording: str | None = None,
    span: tuple[float | None, float | None] = (None, None),
    model: str | None = None,
    beyond: float = 2.0,
) -> WrittenScene:
    """Write the scenario file of a scene and report on it.

    path: of the file.
    ego: name of the vehicle that an ADS is to replace.
    recording: name of its recording; None: the only one that the ego is in.
    span: start and end of the scene, s of the recording; None: start of the ego's recording, and
        `USUAL` s after the start.
    model: SUMO's model by which the actors react; None: they do not react.
    beyond: the first value of `react_beyond`, m; the second is `NEVER`.
    Raises InputError if there is no such scene.
    """
    if path.suffix != ".toml":
        raise must_be("The file", "a scene", "one that ends with .toml", str(path))
    table = _of_recording(recordings.table, recording, ego)
    if not 0.0 < beyond < NEVER:
        raise must_be(
            "The distance from which on actors react",
            "a scene",
            f"above 0 m and below {NEVER:g} m",
            beyond,
        )
    first, last = _span_of(table[table["vehicle"] == ego], span)
    recorded, others, lanes = _recorded_tracks(table, ego, first, last)
    # the ego from the start of the scene to its end, one position each `INTERVAL`
    clock = np.arange(round((last - first) / INTERVAL) + 1.0) * INTERVAL
    x, y = (np.interp(clock, recorded.time, values) for values in (recorded.x, recorded.y))
    scene_ego = recorded._replace(time=clock, x=x, y=y)
    actors, continued, left_out = _actors_of(others, scene_ego)
    if not actors:
        reasons = "; ".join(f"{number} {reason}" for reason, number in left_out.items())
        raise InputError(
            f"Around vehicle `{ego}` there must be a vehicle from {first:g} to {last:g} s, got "
            f"none{reasons and f' (left out: {reasons})'}."
        )

    # the file's road begins behind all vehicles
    shift = ROAD_BEHIND - min(track.x[0] for track in (scene_ego, *actors))
    scene_ego, *actors = (track._replace(x=track.x + shift) for track in (scene_ego, *actors))
    # without a model this constraint leaves one point, `NEVER`
    never = {"require": f"react_beyond >= {NEVER:g}", "about": f"one where {NO_REACTION}"}
    reaction = f"from a departure on actors react as SUMO's {model}" if model else NO_REACTION
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
        **_traffic(scene_ego, _speed(recorded, 0.0), actors, lanes, model or "IDM"),
    }  # fmt: skip
    logical = scenario_from(content, f"scene {path}", path.parent)
    check_points(logical, sample(logical).points)  # before a file is written
    write_page(path, tomli_w.dumps(content), "The scene")
    error = _error(logical, scene_ego, actors)
    return WrittenScene(len(actors), dict(sorted(left_out.items())), continued, error, clock[-1])


def _of_recording(table: DataFrame, recording: str | None, ego: str) -> DataFrame:
    """The rows of a recording; None: of the only one that the ego is in.

    table: rows of all recordings.
    """
    table = table.astype({"recording": str, "vehicle": str})
    if recording is not None:
        check_known("recording", table["recording"].unique().tolist(), recording)
        table = table[table["recording"] == recording]
    check_known("vehicle of the recording", table["vehicle"].unique().tolist(), ego)
    names = table.loc[table["vehicle"] == ego, "recording"].unique()
    if len(names) > 1:
        raise InputError(
            f"`recording` must name one recording: vehicle `{ego}` is in {len(names)}, "
            f"{', '.join(names[:8])}."
        )
    rows: DataFrame = table[table["recording"] == names[0]]
    return rows


def _span_of(own: DataFrame, span: tuple[float | None, float | None]) -> tuple[float, float]:
    """Start and end of the scene, s of the recording.

    own: the ego's rows.
    span: as in `write_scene`.
    """
    start, stop = own["t"].iloc[[0, -1]]
    first = start if span[0] is None else span[0]
    last = min(first + USUAL, stop) if span[1] is None else span[1]
    # 1e-6: times are rounded, and so is their difference
    if not (start - 1e-6 <= first < last <= stop + 1e-6 and last - first <= LONGEST + 1e-6):
        raise must_be(
            "Begin and end", f"the scene of vehicle `{own['vehicle'].iloc[0]}`",
            f"within its recording, {start:g} to {stop:g} s, at most {LONGEST:g} s apart",
            f"{first:g} to {last:g} s",
        )  # fmt: skip
    return first, last


def _recorded_tracks(
    table: DataFrame, ego: str, first: float, last: float
) -> tuple[_Track, list[_Track], _Lanes]:
    """Track of the ego, tracks of all other vehicles, and the lanes.

    The ego's track is whole, also before and after the scene. The other tracks are cut to the
    scene, in the order in which their vehicles first were recorded.

    table: rows of the recording.
    first, last: start and end of the scene, s of the recording.
    """
    begins = table.groupby("vehicle")["t"].min()
    scene = table[table["t"].between(first, last)]
    lanes = _lanes(scene)
    groups = scene[scene["vehicle"] != ego].groupby("vehicle")
    others = [
        _track(rows, first, lanes) for _, rows in sorted(groups, key=lambda group: begins[group[0]])
    ]
    return _track(table[table["vehicle"] == ego], first, lanes), others, lanes


def _actors_of(tracks: list[_Track], ego: _Track) -> tuple[list[_Track], int, Counter[str]]:
    """Actors of the file; number of them that were not recorded throughout; and reason -> number of
    vehicles left out.

    Each actor has a track from the start of the scene on, and a name that SUMO accepts.

    tracks: of the vehicles. If two overlap at the start, the later one in the list is left out.
    """
    left_out = Counter[str]()
    actors = list[_Track]()
    continued = 0
    for track in tracks:
        name = "v" + re.sub(r"\W", "_", track.name)
        while name in (it.name for it in actors):
            name += "_"
        actor = _from_start(track)._replace(name=name)
        if len(track.time) < round(1.0 / INTERVAL):
            left_out[SHORT] += 1
        elif np.abs(track.x - np.interp(track.time, ego.time, ego.x)).min() > REACH:
            left_out[FAR] += 1
        elif any(_overlap(actor, other) for other in (ego, *actors)):
            left_out[IN_ANOTHER] += 1
        else:
            # Before its first position `_from_start` continues its track. After its last position
            # an actor keeps speed and lane, as after every script.
            if track.time[0] >= INTERVAL or track.time[-1] <= ego.time[-1] - INTERVAL:
                continued += 1
            actors.append(actor)
    return actors, continued, left_out


def _lanes(rows: DataFrame) -> _Lanes:
    """The lanes from the right-most to the left-most with a vehicle."""
    middles = np.sort(rows.groupby("lane")["y"].median().to_numpy())
    gaps = lane_gaps(middles)
    width = round(float(np.median(gaps)), 2) if len(gaps) else STANDARD_LANE
    return _Lanes(middles[0], width, round((middles[-1] - middles[0]) / width) + 1)


def _track(rows: DataFrame, first: float, lanes: _Lanes) -> _Track:
    """The track of a vehicle's rows.

    first: start of the scene, s of the recording.
    """
    time, x, y = (rows[key].to_numpy() for key in ("t", "x", "y"))
    row = rows.iloc[0]
    body = BODIES.get(row["class"], "car")
    return _Track(
        row["vehicle"], body, row["length"], row["width"], time - first, x, y - lanes.right
    )


def _speed(track: _Track, time: float) -> float:
    """Mean speed along the road over the recorded half second around a time, m/s."""
    begin = min(max(time - SPEED_OVER / 2.0, track.time[0]), track.time[-1] - SPEED_OVER)
    before, after = np.interp([begin, begin + SPEED_OVER], track.time, track.x)
    return float(max(after - before, 0.0) / SPEED_OVER)


def _from_start(track: _Track) -> _Track:
    """The track from the start of the scene on.

    Up to its first position the vehicle drives at the speed that it has there, in its lane.
    """
    begin = track.time[0]
    # half an interval less: rounding must not repeat the first position
    before = np.arange(0.0, begin - INTERVAL / 2.0, INTERVAL)
    return track._replace(
        time=np.append(before, track.time),
        x=np.append(track.x[0] - _speed(track, begin) * (begin - before), track.x),
        y=np.append(np.full(len(before), track.y[0]), track.y),
    )


def _overlap(one: _Track, other: _Track) -> bool:
    """Whether two vehicles overlap at the start of the scene."""
    beside = abs(one.y[0] - other.y[0]) < (one.width + other.width) / 2.0
    return bool(beside and abs(one.x[0] - other.x[0]) < (one.length + other.length) / 2.0)


def _traffic(
    ego: _Track, speed: float, actors: list[_Track], lanes: _Lanes, model: str
) -> dict[str, Any]:
    """Road, end, ego and vehicles of the file.

    speed: of the ego at the start, m/s.
    model: as in `_vehicle`.
    """
    road = max(float(track.x.max()) for track in (ego, *actors)) + ROAD_AHEAD
    path = np.column_stack([ego.x, ego.y]).round(3).tolist()
    x, y = path[0]
    return {
        "road": {"lanes": lanes.number, "lane_width": lanes.width, "length": round(road, 1)},
        "end": {"x": round(road - ROAD_AHEAD / 2.0, 1), "time": round(float(ego.time[-1]), 1)},
        "ego": {"speed": round(speed, 3), "x": x, "y": y,
            "length": ego.length, "width": ego.width, "recorded": path},
        "vehicle": [_vehicle(track, lanes, model) for track in actors],
    }  # fmt: skip


def _vehicle(track: _Track, lanes: _Lanes, model: str) -> dict[str, Any]:
    """A vehicle of the file: along its path, at its speed, until SUMO takes it over.

    model: by which it then reacts; without a reaction the file's constraint keeps it from that.
    """
    x, y = track.x, track.y
    driven = np.append(0.0, np.hypot(np.diff(x), np.diff(y)).cumsum())  # m since the start
    knots, speeds = fit_speeds(track.time, driven)
    within = " or ".join(
        f"abs(y({track.name}) - {lanes.width * lane:g}) < {WITHIN_LANE}"
        for lane in range(lanes.number)
    )
    stands = driven[-1] <= STANDS
    begin, *points = np.column_stack([x, y]).round(3)[thinned(x, y, PATH_TOLERANCE)].tolist()
    speed, *later_speeds = speeds.round(3).tolist()
    path = {"do": "path", "points": points}
    profile = {"do": "speed_profile", "times": knots.round(3).tolist()[1:], "speeds": later_speeds}
    follow = {
        "do": "follow",
        "model": model,
        "speed": round(max(float(speeds.max()), 1.0), 2),
        "when": f"departed > react_beyond and ({within})",
    }
    return {
        # without a profile, one that comes to a stop would keep its first speed
        "name": track.name, "speed": 0.0 if stands else speed, "x": begin[0], "y": begin[1],
        "body": track.body, "length": track.length, "width": track.width,
        # a vehicle that stands has no path
        "manoeuvre": [follow] if stands else [path, profile, follow],
    }  # fmt: skip


def _error(logical: LogicalScenario, ego: _Track, actors: list[_Track]) -> tuple[float, float]:
    """Root mean square and largest distance of a scene's actors from their tracks, m."""
    concrete = logical.concrete(react_beyond=NEVER)
    driven = tracks([concrete], [(ego.length, ego.width)], INTERVAL, ego.time[-1]).others[0]
    clock = np.arange(driven.shape[1]) * INTERVAL
    errors = []
    # driven: (actors, steps, columns), of which the first are x and y
    for (x, y, *_), track in zip(driven.transpose(0, 2, 1), actors, strict=True):
        # the last recorded time may lie within half an interval after the end of the scene
        in_scene = track.time <= ego.time[-1] + 1e-6
        time = track.time[in_scene]
        along = np.interp(time, clock, x) - track.x[in_scene]
        errors.append(np.hypot(along, np.interp(time, clock, y) - track.y[in_scene]))
    distances = np.concatenate(errors)
    return np.sqrt(np.mean(distances**2)), distances.max()
