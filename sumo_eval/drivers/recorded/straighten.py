"""Road coordinates of positions on a map, without a map of the roads: roads and lanes are found
from the traffic itself.

Used by `importing`. Stream by stream: the longest of the remaining tracks is the axis, and every
vehicle that drives along it belongs to its stream. Vehicles that do not move as they are headed are
left out and counted.

Across the axis, traffic gathers in lanes of one width: the width at which positions, taken modulo
it, agree best. Their circular mean is where the lanes lie. It is tracked along the road, so the
axis may itself change lanes.

Users: `drivers/recorded/importers/commonroad.py`, `drivers/recorded/importing.py`.
"""

from collections.abc import Iterable
from math import hypot
from typing import Any

import numpy as np
from pandas import DataFrame, Series, concat
from scipy.spatial import cKDTree

from sumo_eval.drivers.recorded.importers.tables import TRACK
from sumo_eval.drivers.recorded.recordings import STANDARD_LANE, smooth
from sumo_eval.errors import InputError, must_be
from sumo_eval.trajectory import FloatArray

SHORTEST_AXIS = 30.0  # m; diagonal of the box around a track; a smaller one is no path
LONGEST_AXIS = 1e6  # m; a longer track has a wrong place, and its axis would fill the memory
AXIS_SPACING = 1.0  # m between the points of an axis; what moves less is noise of standing still
AXIS_SMOOTHING = 31  # points over which the axis is smoothed
HALF_WIDTH = 16.0  # m to each side of the axis that belong to its road
# a vehicle that heads further off than this does not drive along the axis
WRONG_WAY = np.radians(45.0)
COURSE_POINTS = 5  # points over which the course at the end of a line is measured
MIN_CONTINUATION = 10  # points by which a path must reach past the end of an axis to carry it on
MEMBER_SHARE = 0.9  # of a track's samples that must drive along the axis
LANE_WIDTHS = np.arange(2.8, 4.21, 0.02)  # m
SECTION = 5.0  # m of road; over three, an axis that changes lanes moves less than half a lane
SECTIONS_SMOOTHED = 3
FEWEST_SAMPLES = 500  # fewer do not show lanes
# share of a stream's road on which a lane of the main road is driven; ramps are shorter
LANE_COVER = 0.5


def straighten(table: DataFrame) -> tuple[DataFrame, tuple[str, ...]]:
    """Samples in map coordinates as samples in road coordinates with lanes; a recording may become
    several streams.

    table: columns as in `canonical`, x, y, heading on a map; `offset` where a map says how far to
        the left of its lane's centre a vehicle is, m. Returns the table and whole sentences on what
        was done.
    Raises InputError where nothing moves.
    """
    parts = []
    notes = []
    for recording, rows in table.groupby("recording", sort=False):
        streams, lost = _streams(rows.sort_values(["vehicle", "t"], kind="stable"))
        for number, stream in enumerate(streams, start=1):
            laned, width = _laned(stream)
            name = f"{recording}-{number}"
            parts.append(laned.assign(recording=name))
            lanes = f"lanes {width:.2f} m wide" if width else "lanes not visible, 3.5 m assumed"
            if laned["lane"].nunique() == 1:  # every width fits
                lanes = "in one lane"
            driven = laned.groupby("vehicle")["lane"].nunique()  # number of lanes
            notes.append(f"{name}: {len(driven)} vehicles along one path, {lanes}.")
            if len(driven) == 2 and driven.max() > 1:
                notes.append(
                    f"{name}: two vehicles do not show which of them changes lane. A table of the "
                    "format `csv` can give their lanes."
                )
        notes += [f"{recording}: {number} {why}." for why, number in lost.items() if number]
    if not parts:
        tracks = table.groupby(TRACK)[["x", "y"]]
        longest = np.hypot(*(tracks.max() - tracks.min()).to_numpy().T).max(initial=0.0)
        raise InputError(
            f"At least one vehicle must move {SHORTEST_AXIS:g} m as it is headed, got none that "
            f"does: by `x` and `y` none is further than {longest:.3g} m from where it was."
        )
    return concat(parts, ignore_index=True), tuple(notes)


def _streams(rows: DataFrame) -> tuple[list[DataFrame], dict[str, int]]:
    """The streams of a recording, that of the longest track first; and numbers of what is left out,
    by reason.
    """
    tracks = rows.groupby("vehicle")[["x", "y"]]
    paths = {name: _without_standing(track.to_numpy()) for name, track in tracks}
    lengths = Series({name: distances(path)[-1] for name, path in paths.items()})
    lengths = lengths.sort_values(ascending=False)
    if lengths.iloc[0] > LONGEST_AXIS:
        raise must_be(
            f"The path of vehicle `{lengths.index[0]}`", f"recording `{rows['recording'].iloc[0]}`",
            f"at most {LONGEST_AXIS:g} m long", f"{lengths.iloc[0]:g} m",
        )  # fmt: skip
    # The steps of a parked car's noise add up to a long track, but its box stays small.
    boxes = {name: np.hypot(*np.ptp(path, axis=0)) for name, path in paths.items()}
    # vehicles without a stream, longest first
    rest = [name for name in lengths.index if boxes[name] >= SHORTEST_AXIS]
    standing = len(lengths) - len(rest)
    streams = []
    while rest:
        axis = _chained(rest[0], {name: paths[name] for name in rest})
        stream = _stream(rows[rows["vehicle"].isin(rest)], axis, rest[0])
        if len(stream):  # else the longest track's vehicle is not headed as it moves
            streams.append(stream)
        # the longest track is done in any case, so that the loop ends
        members = {rest[0], *stream["vehicle"].unique()}
        rest = [vehicle for vehicle in rest if vehicle not in members]
    driving = {vehicle for stream in streams for vehicle in stream["vehicle"].unique()}
    # each other vehicle was the longest track once, and no sample of it lay along its own path
    wrong_way = len(lengths) - standing - len(driving)
    off_path = rows["vehicle"].isin(driving).sum() - sum(map(len, streams))
    return streams, {
        f"vehicles that move less than {SHORTEST_AXIS:g} m are left out": standing,
        "vehicles that do not move as they are headed are left out": wrong_way,
        "samples of vehicles off the path that they drive along or on another lap of it are left "
        "out": off_path,
    }


def _without_standing(track: FloatArray) -> FloatArray:
    """The places (n, 2) of a track that are `AXIS_SPACING` or more from the one before, m.

    A vehicle that stands still has noisy places. They would bring a line back to itself.
    """
    kept = [0]
    last_x, last_y = track[0]
    for number, (x, y) in enumerate(track.tolist()):
        if hypot(x - last_x, y - last_y) >= AXIS_SPACING:
            kept.append(number)
            last_x, last_y = x, y
    return track[kept]


def _chained(longest: str, paths: dict[str, FloatArray]) -> FloatArray:
    """The axis of a stream: the longest path, carried on at both ends by the paths that overlap it
    and reach furthest.

    A path that is joined on is shifted sideways to where the axis ends, so the axis keeps to its
    lane. The axis does not come back to a place where it has been.
    """
    line = _first_lap(_line(paths[longest]))
    for order in (1, -1):  # ahead, then (turned round) behind
        lines = {name: _line(path)[::order] for name, path in paths.items() if name != longest}
        while (part := _continuation(line, lines)) is not None:
            line = np.vstack((line, part))
        line = line[::-1]
    return _axis(line)


def _first_lap(line: FloatArray) -> FloatArray:
    """A line (n, 2) up to where it comes back to itself in one direction."""
    first, later = cKDTree(line).query_pairs(HALF_WIDTH, output_type="ndarray").T
    course = np.gradient(line, axis=0)
    same_way = (course[first] * course[later]).sum(axis=1) > np.cos(WRONG_WAY)
    # points are `AXIS_SPACING`, 1 m, apart: their numbers are m along the line
    back = later[same_way & (later - first > 2 * HALF_WIDTH)]
    return line[: back.min(initial=len(line))]


def _stream(rows: DataFrame, axis: FloatArray, longest: str) -> DataFrame:
    """The samples along an axis, in road coordinates: of the longest track's vehicle and of all
    that drive along it for `MEMBER_SHARE` of their samples.
    """
    (s, d), course, beyond = _projected(rows[["x", "y"]].to_numpy(), axis)
    heading = (rows["heading"].to_numpy() - course + np.pi) % (2 * np.pi) - np.pi
    along = (np.abs(d) <= HALF_WIDTH) & (np.abs(heading) <= WRONG_WAY) & ~beyond
    share = Series(along, index=rows.index).groupby(rows["vehicle"]).transform("mean")
    member = (share >= MEMBER_SHARE) | (rows["vehicle"] == longest)
    stream: DataFrame = rows.assign(x=s, y=d, heading=heading)[member.to_numpy() & along]
    # Where a vehicle begins another lap, x jumps back. Its samples from there on are dropped.
    steps = stream.groupby("vehicle")[["x", "t"]].diff()
    jumps = steps["x"].abs() > 2.0 * (HALF_WIDTH + stream["speed"] * steps["t"])
    return stream[jumps.groupby(stream["vehicle"]).cumsum() == 0]


def _continuation(line: FloatArray, lines: dict[str, FloatArray]) -> FloatArray | None:
    """The part that the path reaching furthest past the end of a line adds to it; None where
    none does.
    """
    part = _furthest(line, lines.values())
    # Cut off where the part comes back to the line. The line's last 2 HALF_WIDTH m, one point a m,
    # do not count: the part begins beside them. Of a short line its first point alone counts.
    driven = line[: -int(2 * HALF_WIDTH)] if len(line) > 4 * HALF_WIDTH else line[:1]
    back = np.flatnonzero(cKDTree(driven).query(part)[0] < HALF_WIDTH)
    part = part[: back[0]] if back.size else part
    return part if len(part) >= MIN_CONTINUATION else None


def _furthest(line: FloatArray, others: Iterable[FloatArray]) -> FloatArray:
    """The part past the end of a line of the other line that overlaps it and reaches furthest,
    shifted sideways to the end; empty where none does.
    """
    end = line[-1]
    course = line[-1] - line[-min(COURSE_POINTS + 1, len(line))]
    course = course / np.hypot(*course)
    normal = np.array([-course[1], course[0]])
    furthest = line[:0]
    for other in others:
        offset = other - end
        aside, along = offset @ normal, offset @ course
        near = np.flatnonzero((np.abs(aside) <= HALF_WIDTH) & (np.abs(along) <= 2 * AXIS_SPACING))
        if near.size == 0 or near[0] + COURSE_POINTS >= len(other):
            continue  # it does not pass the end, or ends there too
        joint = near[np.argmin(np.abs(along[near]))]
        ahead = other[min(joint + COURSE_POINTS, len(other) - 1)] - other[joint]
        forward = ahead @ course >= np.cos(WRONG_WAY) * np.hypot(*ahead)
        if forward and len(other) - joint > len(furthest) + 1:
            furthest = other[joint + 1 :] - aside[joint] * normal
    return furthest


def distances(points: FloatArray) -> FloatArray:
    """Distance along a line (n, 2) to each of its points, (n,), m."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))


def _line(points: FloatArray) -> FloatArray:
    """A path as points (n, 2) `AXIS_SPACING` apart."""
    moved = distances(points)
    keep = np.append(True, np.diff(moved) > 1e-6)
    places = np.arange(0.0, moved[-1], AXIS_SPACING)
    return np.column_stack([np.interp(places, moved[keep], column) for column in points[keep].T])


def _axis(line: FloatArray) -> FloatArray:
    """A line (n, 2) smoothed and carried straight on at both ends."""
    window = min(AXIS_SMOOTHING, len(line) - 1 - len(line) % 2)  # odd, as smoothing asks for
    if window > 3:
        line = np.column_stack([smooth(column, window) for column in line.T])
    reach = np.arange(1, int(HALF_WIDTH / AXIS_SPACING) + 1)[:, None]
    # directions out of both ends
    back = line[0] - line[min(COURSE_POINTS, len(line) - 1)]
    ahead = line[-1] - line[-min(COURSE_POINTS + 1, len(line))]
    before = line[0] + (reach * back / np.hypot(*back))[::-1] * AXIS_SPACING
    after = line[-1] + reach * ahead / np.hypot(*ahead) * AXIS_SPACING
    return np.vstack((before, line, after))


def _projected(points: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Distances along the axis and to its left, (2, n), its course there, and which points lie
    beyond its ends.
    """
    tangent = np.gradient(axis, axis=0)
    course = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    along = distances(axis)
    s = along[cKDTree(axis).query(points)[1]]
    # to the foot of the perpendicular in two steps: by the tangent at the nearest point of the axis
    # and by that at the place found
    for _ in range(2):
        place = s
        angle = np.interp(place, along, course)
        dx, dy = points.T - [np.interp(place, along, column) for column in axis.T]
        s = place + dx * np.cos(angle) + dy * np.sin(angle)
        d = -dx * np.sin(angle) + dy * np.cos(angle)
    beyond = (s < along[0] - AXIS_SPACING) | (s > along[-1] + AXIS_SPACING)
    return np.stack([s, d]), np.interp(s, along, course), beyond


def _laned(stream: DataFrame) -> tuple[DataFrame, float | None]:
    """A stream with y = 0 on the right lane's centre and lane numbers, and the lanes' width if they
    are visible.
    """
    s = stream["x"].to_numpy()
    aside = stream["offset"].to_numpy() if "offset" in stream else np.zeros(len(s))
    d = stream["y"].to_numpy() - aside  # of the centre of the lane that it is in
    x = s - s.min()
    width, middle, slope = _visible_lanes(s, d)
    spacing = width or STANDARD_LANE
    lane = np.round((d - middle) / spacing).astype(np.int64)
    # The right lane of the main road: the first that is driven on enough stretches of the road.
    # A stretch is a twentieth of it, or `SECTION` if that is longer.
    stretch = (x / max(np.ptp(s) / 20, SECTION)).astype(int)
    driven = Series(stretch).groupby(lane).nunique()
    enough = min(LANE_COVER * len(np.unique(stretch)), driven.max())
    right = int(driven.index[driven >= enough].min())
    y = d + aside - middle - right * spacing
    heading = stream["heading"] - np.arctan(slope)
    return stream.assign(x=x, y=y, lane=lane - right, heading=heading), width


def _visible_lanes(s: FloatArray, d: FloatArray) -> tuple[float | None, Any, Any]:
    """Width of the lanes, m, None if too few samples show it; how far to the left of the axis a
    lane's centre is at each sample, m, and its slope there.

    s, d: of the samples along the axis and to the left of it, (n,), m.
    """
    if len(s) < FEWEST_SAMPLES:
        # of the lane in the middle of all: their median itself may lie between two lanes
        middle = np.quantile(d, 0.5, method="lower")
        return None, np.median(d[np.abs(d - middle) < 0.5 * STANDARD_LANE]), 0.0
    section = ((s - s.min()) / SECTION).astype(int)
    agreement = [np.abs(_phasors(d, section, width)).sum() for width in LANE_WIDTHS]
    width = LANE_WIDTHS[np.argmax(agreement)]
    weights = np.ones(len(s))
    for _ in range(2):  # again almost without vehicles between lanes, which would shift the lanes
        phasors = _phasors(d, section, width, weights)
        steady = np.convolve(phasors, np.ones(SECTIONS_SMOOTHED), "same")[: len(phasors)]
        seen = np.flatnonzero(steady)  # a section without samples has no angle
        drift = np.unwrap(np.angle(steady[seen])) / (2 * np.pi) * width
        middles = s.min() + SECTION * (seen + 0.5)  # of the sections
        middle = np.interp(s, middles, drift)
        weights = np.maximum(np.cos(2 * np.pi * (d - middle) / width), 0.0)
    slopes = np.gradient(drift, middles) if len(drift) > 1 else np.zeros(1)
    return width, middle, np.interp(s, middles, slopes)


def _phasors(d: FloatArray, section: np.ndarray, width: float, weights: Any = 1.0) -> np.ndarray:
    """Weighted sum over each section's samples of exp(2 pi i d / width): long where they agree
    modulo the width, its angle their circular mean.
    """
    turned = weights * np.exp(2j * np.pi * d / width)
    size = int(section.max()) + 1
    return np.bincount(section, turned.real, size) + 1j * np.bincount(section, turned.imag, size)
