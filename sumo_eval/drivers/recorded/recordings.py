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

Users: `drivers/`, `extras/rates/`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pandas import DataFrame, Series, concat

from sumo_eval.drivers.recorded.importers.tables import (
    IDENTIFIERS,
    TRACK,
    add_motion,
    check_motion,
    in_order,
    make_numbers,
    numbered,
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
SMOOTHED = 11  # samples, 1 s, over which speeds and lateral positions are smoothed
LONGEST_HOLE = 0.5  # s; a track with a longer hole is two tracks
BACK = 10.0  # m; a vehicle that ends further behind its start drives in the other direction
WIDEST = 3.5  # m; a wider median is in feet, or is a length
STANDARD_LANE = 3.5  # m, width of a lane where a table says nothing of lanes
# truck_bus, trailer, taxi and priorityvehicle are words of sources
MOTOR_CLASSES = frozenset(
    {"car", "van", "truck", "bus", "motorcycle", "truck_bus", "trailer", "taxi", "priorityvehicle"}
)

# of the numbers in a CSV file; lane, the last of `NUMBERS`, is whole
_DECIMALS = dict.fromkeys(NUMBERS[:-1], 3) | {"heading": 5, "steering": 5}


class Recordings(NamedTuple):
    """A canonical table, sorted by recording, vehicle and t, and whole sentences on what was left
    out or assumed.
    """

    table: DataFrame
    notes: tuple[str, ...] = ()

    @property
    def vehicles(self) -> int:
        """Number of tracks."""
        return self.table.groupby(TRACK).ngroups


def canonical(table: DataFrame, notes: Sequence[str] = ()) -> Recordings:
    """A table of samples at any rate as a canonical one: one clock of 0.1 s, holes split, columns
    complete, sorted.

    table: `recording`, `vehicle`, `t`, `x`, `y`, `heading`, `speed`, `length`, `width`, `class`,
        `lane`; `acceleration`, `driver` and `steering` may be missing.
    """
    rows, doubled = in_order(table.astype(dict.fromkeys(TRACK, str)))
    back = _goes_back(rows)
    oncoming = rows[back].groupby(TRACK).ngroups
    parts, holes, too_short = _even_tracks(_checked(rows[~back]))
    # numbers by the words that follow them in a note
    counted = {
        f"holes of more than {LONGEST_HOLE:g} s in tracks: each side of a hole is a track of its "
        "own.": holes,
        f"tracks of less than two samples on the clock of {INTERVAL:g} s are left out.": too_short,
        f"vehicles that go back more than {BACK:g} m along x are left out: each direction of "
        "travel must be a recording of its own, with x along it.": oncoming,
    }
    counts = [*doubled, *(f"{count} {words}" for words, count in counted.items() if count)]
    if not parts:
        step = table.sort_values("t").groupby(TRACK)["t"].diff().median()
        counts += [f"Samples of a vehicle are {step:g} s apart."] if step > 0.0 else []
        raise InputError(
            "The recording must hold at least one vehicle with two samples at most "
            f"{LONGEST_HOLE:g} s apart, got none: {' '.join(counts)}"
        )
    return Recordings(concat(parts, ignore_index=True)[list(COLUMNS)], (*notes, *counts))


def _goes_back(table: DataFrame) -> Series[bool]:
    """Whether the vehicle of each row ends far behind its first place.

    table: sorted.
    """
    x = table.groupby(TRACK, sort=False)["x"]
    return x.transform("first") - x.transform("last") > BACK


def _even_tracks(rows: DataFrame) -> tuple[list[DataFrame], int, int]:
    """Tracks on the clock, number of holes, and number of tracks too short for the clock."""
    vehicle = [rows[name] for name in TRACK]
    hole = rows["t"].groupby(vehicle).diff() > LONGEST_HOLE + 1e-6
    names = numbered(rows["vehicle"], hole.groupby(vehicle).cumsum())
    # both sides of a hole have one driver, by the name that a track without one gives its driver
    unnamed = hole.groupby(vehicle).transform("any") & (rows["driver"] == "")
    drivers = rows["driver"].mask(unnamed, rows["recording"] + "/" + rows["vehicle"])
    pieces = rows.assign(vehicle=names, driver=drivers).groupby(TRACK, sort=False)
    tracks = [even for _, piece in pieces if (even := _on_the_clock(piece)) is not None]
    return tracks, hole.sum(), pieces.ngroups - len(tracks)


def _on_the_clock(track: DataFrame) -> DataFrame | None:
    """A hole-free track at whole tenths of a second; None for one that spans fewer than two of
    them.
    """
    time = track["t"].to_numpy()
    # numbers of the clock's first and last tick within the track; 1e-6 is for rounding
    first, last = np.ceil(time[0] / INTERVAL - 1e-6), np.floor(time[-1] / INTERVAL + 1e-6)
    if last - first < 1:
        return None
    clock = np.round(np.arange(first, last + 1) * INTERVAL, 3) + 0.0  # -0 becomes 0
    even = DataFrame({"t": clock})
    for name in ("x", "y", "speed", "heading", "acceleration", "steering"):
        values = track[name].to_numpy(dtype=np.float64)
        steady = np.unwrap(values) if name == "heading" else values
        # nan at one sample makes a channel unknown
        even[name] = np.interp(clock, time, steady) if np.isfinite(values).all() else np.nan
    if even["acceleration"].hasnans:
        speed = smooth(even["speed"].to_numpy(), SMOOTHED)
        even["acceleration"] = np.gradient(speed, INTERVAL)
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
    with (
        writing(f"The recordings in {path}", path.parent),
        # in a temporary folder: a temporary file stays readable by its owner alone, even when moved
        tempfile.TemporaryDirectory(dir=path.parent) as folder,
    ):
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
    make_numbers(table, [*table.filter([*NUMBERS, "steering"])], path, gaps=["steering"])
    notes = unread("Column", table, COLUMNS, path)
    table, doubled = in_order(table)
    notes += doubled
    assumed = {
        "class": "classes: all are assumed to be cars",
        "lane": f"lanes: a width of {STANDARD_LANE:g} m is assumed",
    }
    notes += [
        f"{path.name} has no {words}." for name, words in assumed.items() if name not in table
    ]
    add_motion(table, ("heading", "speed", "acceleration"), str(path))
    if "lane" not in table:
        table["lane"] = np.round(table["y"] / STANDARD_LANE).astype(np.int64)
    for name in TRACK:
        table[name] = table[name].map(from_cell)
    table["lane"] = table["lane"].astype(np.int64)
    if _is_canonical(table):
        return Recordings(_checked(table)[list(COLUMNS)], tuple(notes))
    return canonical(table, notes)


def _checked(table: DataFrame) -> DataFrame:
    """The table with all columns, after a check of bodies, units and lanes.

    table: sorted.
    """
    _check_bodies(table)
    check_motion(table)
    _check_lanes(table)
    unknown = Series(np.nan, table.index)
    channels = {name: table.get(name, unknown) for name in ("acceleration", "steering")}
    return table.assign(
        **channels,
        driver=_texts(table.get("driver", unknown), ""),
        **{"class": _texts(table.get("class", unknown), "car").str.strip().str.lower()},
    )


def _check_bodies(table: DataFrame) -> None:
    """Refuse a vehicle without length and width, as gaps are from bumper to bumper, and widths in
    another unit.
    """
    flat = ~(table[["length", "width"]] > 0.0).all(axis=1)
    if flat.any():
        row = table[flat].iloc[0]
        got = f"{row['length']:g} and {row['width']:g} m"
        what = f"Length and width of vehicle `{row['vehicle']}`"
        raise must_be(what, f"recording `{row['recording']}`", "above 0 m", got)
    widths = table.groupby("recording")["width"].median()
    for recording, width in widths[widths > WIDEST].items():
        owner, wanted = f"recording `{recording}`", "in m, across the vehicle"
        raise must_be("The median `width`", owner, wanted, round(width, 2))


def _check_lanes(table: DataFrame) -> None:
    """Refuse lanes that grow to the right."""
    # median y of each lane, m
    lanes = table[table["lane"] >= 0].groupby(["recording", "lane"])["y"].median()
    for recording, lane in lanes.index[lanes.groupby("recording").diff() < -STANDARD_LANE / 2]:
        raise InputError(
            f"`lane` of recording `{recording}` must grow to the left, as y does, got lane {lane} "
            "to the right of the one before."
        )


def _texts(cells: Series[Any], empty: str) -> Series[str]:
    """A column of texts; empty: what an empty cell means."""
    return cells.astype(object).where(cells.notna(), empty).astype(str).map(from_cell)


def _is_canonical(table: DataFrame) -> bool:
    """Whether every track has several samples, all on the clock, without holes, and drives on."""
    frame = (table["t"] / INTERVAL).round()
    on_clock = (table["t"] - frame * INTERVAL).abs() < 1e-6
    steps = frame.groupby([table[name] for name in TRACK], sort=False).diff()
    several = table.duplicated(TRACK, keep=False)
    return bool((on_clock & several & (steps.fillna(1) == 1)).all() and not _goes_back(table).any())
