"""The canonical table of recorded driving: one row a vehicle and instant, SI units, vehicle
centres, road coordinates.

| column | meaning |
|---|---|
| recording | a stretch of road with one direction of travel and one clock |
| vehicle | one vehicle's uninterrupted track in it |
| driver | who drove, where that is known; empty: every vehicle is a driver of its own |
| t | s, every 0.1 s |
| x, y | m, the vehicle's centre; x along the road, y to the left, 0 in the right lane's centre |
| heading | rad, 0 along the road, counter-clockwise positive |
| speed, acceleration | m/s; m/s2 along the heading |
| length, width | m, the body |
| class | car, van, truck, bus, motorcycle, bicycle, pedestrian or what the source says |
| lane | 0 is the right lane, 1 the next to the left; negative: ramps and lanes to the right |
| steering | steering wheel angle, rad; empty: not known |
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import (
    DOUBLE,
    IDENTIFIERS,
    add_motion,
    check_speeds,
    checked_numbers,
    read_table,
    unread,
)
from sumo_eval.errors import InputError, must_be
from sumo_eval.input_file import writing
from sumo_eval.text import cell, each_text, from_cell
from sumo_eval.trajectory import FloatArray

COLUMNS = (
    "recording", "vehicle", "driver", "t", "x", "y", "heading", "speed", "acceleration", "length",
    "width", "class",
    "lane", "steering",
)  # fmt: skip
NUMBERS = ("t", "x", "y", "heading", "speed", "acceleration", "length", "width", "lane")
INTERVAL = 0.1  # s between samples
LONGEST_HOLE = 0.5  # s; a track with a longer hole is two tracks
STANDARD_LANE = 3.5  # m, width of a lane where a table says nothing of lanes
# truck_bus and trailer are words of sources
MOTOR_CLASSES = frozenset({"car", "van", "truck", "bus", "motorcycle", "truck_bus", "trailer"})

# of the numbers in a CSV file; lane, the last of `NUMBERS`, is whole
_DECIMALS = dict.fromkeys(NUMBERS[:-1], 3) | {"heading": 5, "steering": 5}


class Recordings(NamedTuple):
    """A canonical table, sorted by recording, vehicle and t, and whole sentences on what was left
    out or assumed.
    """

    table: pd.DataFrame
    notes: tuple[str, ...] = ()

    @property
    def vehicles(self) -> int:
        """Number of tracks."""
        return len(self.table[["recording", "vehicle"]].drop_duplicates())


def canonical(table: pd.DataFrame, notes: Sequence[str] = ()) -> Recordings:
    """A table of samples at any rate as a canonical one: one clock of 0.1 s, holes split, columns
    complete, sorted.

    table: `recording`, `vehicle`, `t`, `x`, `y`, `heading`, `speed`, `length`, `width`, `class`,
        `lane`; `acceleration`, `driver` and `steering` may be missing.
    """
    defaults: dict[str, Any] = {"driver": "", "steering": np.nan, "acceleration": np.nan}
    rows = table.assign(**{name: defaults[name] for name in defaults if name not in table})
    keys = ["recording", "vehicle", "t"]
    rows = rows.astype(dict.fromkeys(keys[:2], str))
    rows = _checked(rows.sort_values(keys, kind="stable", ignore_index=True))
    double = rows.duplicated(keys)
    parts, holes, too_short = _even_tracks(rows[~double])
    # numbers by the words that follow them in a note
    counted = {
        f"holes of more than {LONGEST_HOLE:g} s in tracks: each side of a hole is a track of its "
        "own.": holes,
        f"tracks of less than two samples on the clock of {INTERVAL:g} s are left out.": too_short,
        DOUBLE: double.sum(),
    }
    if not parts:
        raise InputError("The recording must hold at least one vehicle with two samples, got none.")
    counts = (f"{count} {words}" for words, count in counted.items() if count)
    return Recordings(pd.concat(parts, ignore_index=True)[list(COLUMNS)], (*notes, *counts))


def _even_tracks(rows: pd.DataFrame) -> tuple[list[pd.DataFrame], int, int]:
    """Tracks on the clock, number of holes, and number of tracks too short for the clock."""
    vehicle = [rows["recording"], rows["vehicle"]]
    hole = rows["t"].groupby(vehicle).diff() > LONGEST_HOLE + 1e-6
    pieces: Any = rows.groupby([*vehicle, hole.groupby(vehicle).cumsum()], sort=False)
    tracks = []
    for (*_, holes_before), piece in pieces:
        even = _on_the_clock(piece)
        if even is not None:
            even["vehicle"] += f"#{holes_before + 1}" if holes_before else ""
            tracks.append(even)
    return tracks, hole.sum(), len(pieces) - len(tracks)


def _on_the_clock(track: pd.DataFrame) -> pd.DataFrame | None:
    """A hole-free track at whole tenths of a second; None for one that spans fewer than two of
    them.
    """
    time = track["t"].to_numpy()
    # numbers of the clock's first and last tick within the track; 1e-6 is for rounding
    first, last = np.ceil(time[0] / INTERVAL - 1e-6), np.floor(time[-1] / INTERVAL + 1e-6)
    if last - first < 1:
        return None
    clock = np.round(np.arange(first, last + 1) * INTERVAL, 3)
    even = pd.DataFrame({"t": clock})
    for name in ("x", "y", "speed", "heading", "acceleration", "steering"):
        values = track[name].to_numpy(dtype=np.float64)
        steady = np.unwrap(values) if name == "heading" else values
        # nan at one sample makes a channel unknown
        even[name] = np.interp(clock, time, steady) if np.isfinite(values).all() else np.nan
    if even["acceleration"].hasnans:
        # speeds smoothed over 11 samples: 1 s
        even["acceleration"] = np.gradient(smooth(even["speed"].to_numpy(), 11), INTERVAL)
    nearest = np.searchsorted(0.5 * (time[1:] + time[:-1]), clock)
    even["lane"] = track["lane"].to_numpy()[nearest].astype(np.int64)
    for name in ("recording", "vehicle", "driver", "class"):
        even[name] = track[name].iloc[0]
    for name in ("length", "width"):
        even[name] = np.median(track[name])
    return even


def smooth(values: FloatArray, window: int) -> FloatArray:
    """Values (n,) with second-order polynomials fitted over `window` samples; shorter ones are left
    as they are.
    """
    from scipy.signal import savgol_filter

    return savgol_filter(values, window, 2) if values.size > window else values


def write_csv(recordings: Recordings, path: Path) -> None:
    """Write a canonical table as CSV (or .csv.gz); the file appears whole or not at all."""
    with writing(f"The recordings in {path}"):
        path.parent.mkdir(parents=True, exist_ok=True)
        # in a temporary folder: a temporary file stays readable by its owner alone, even when moved
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            partial = Path(folder) / path.name
            each_text(recordings.table.round(_DECIMALS), cell).to_csv(partial, index=False)
            partial.replace(path)


def read_csv(path: Path) -> Recordings:
    """A canonical table from CSV (or .csv.gz).

    `driver`, `heading`, `speed`, `acceleration`, `class`, `lane` and `steering` may be missing: no
    driver is named, headings, speeds and accelerations follow from the motion, all are cars, lanes
    follow from y.
    """
    table = read_table(
        path, ("recording", "vehicle", "t", "x", "y", "length", "width"), dtype=IDENTIFIERS
    )
    checked_numbers(table, [*table.filter([*NUMBERS, "steering"])], path, gaps=["steering"])
    notes = unread("Column", table, COLUMNS, path)
    table = table.sort_values(["recording", "vehicle", "t"], kind="stable", ignore_index=True)
    for name, value in (("class", "car"), ("driver", ""), ("steering", np.nan)):
        if name not in table:
            table[name] = value
        table[name] = table[name].astype(object).where(table[name].notna(), value)
    add_motion(table, ("heading", "speed", "acceleration"), str(path))
    if "lane" not in table:
        table["lane"] = np.round(table["y"] / STANDARD_LANE).astype(np.int64)
    for name in ("recording", "vehicle", "driver", "class"):
        table[name] = table[name].astype(str).map(from_cell)
    table["lane"] = table["lane"].astype(np.int64)
    if _is_canonical(table):
        return Recordings(_checked(table)[list(COLUMNS)], tuple(notes))
    return canonical(table, notes)


def _checked(table: pd.DataFrame) -> pd.DataFrame:
    """Refuse a vehicle without length and width, as gaps are from bumper to bumper, and speeds in
    another unit than m/s; else the table as it is.

    table: sorted.
    """
    flat = ~(table[["length", "width"]] > 0.0).all(axis=1)
    if flat.any():
        row = table[flat].iloc[0]
        got = f"{row['length']:g} and {row['width']:g} m"
        what = f"Length and width of vehicle `{row['vehicle']}`"
        raise must_be(what, f"recording `{row['recording']}`", "above 0 m", got)
    check_speeds(table)
    return table


def _is_canonical(table: pd.DataFrame) -> bool:
    """Whether every track has several samples, all on the clock, without holes."""
    frame = (table["t"] / INTERVAL).round()
    keys = table[["vehicle", "recording"]]
    same = (keys == keys.shift()).all(axis=1)
    on_clock = (table["t"] - frame * INTERVAL).abs() < 1e-6
    return bool((on_clock & keys.duplicated(keep=False)).all() and (frame.diff()[same] == 1).all())
