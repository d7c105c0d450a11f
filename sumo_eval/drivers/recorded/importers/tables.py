"""Files and tables of foreign formats, for all importers: read, checked and completed. Every fault
is named with its file and row.

Users: `drivers/`, `extras/studies/`.
"""

from __future__ import annotations

import bz2
import csv
import gzip
import itertools
import lzma
import warnings
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from lxml import etree
from pandas import DataFrame, Series

from sumo_eval.errors import MOST_KNOWN, InputError, did_you_mean
from sumo_eval.input_file import input_file
from sumo_eval.text import shown
from sumo_eval.trajectory import Trajectory

# Largest magnitude of a number in a recording: an identifier may count microseconds since 1970,
# 2e15, and beyond 2^53 = 9e15 doubles skip integers.
LARGEST = 2.0**53

# columns that are text even where all are digits: 007 is not 7
DRIVER = {"driver": str}  # whose cells may be empty: not every driver is known
TRACK = ["recording", "vehicle"]  # columns that name a track
IDENTIFIERS = dict.fromkeys(TRACK, str) | DRIVER

# m, and m/s: a step that is longer than the first and its time at the second together is a jump to
# another vehicle, unless the track is usually that fast
JUMP, JUMP_SPEED = 10.0, 100.0
CHORD = 0.5  # s between the samples that show speed and course; noise is then small
FASTEST = 70.0  # m/s; a faster median is in feet or cm
MOVES = 3.0  # m/s; a faster step shows the unit of `speed`
SPEEDS_AGREE = 0.67, 1.5  # median of `speed` over that of steps; km/h are 3.6, miles/h 2.24
STEP = 1.0  # m; a longer step shows its course, a shorter one the noise of positions
HEADING_SHARE = 0.99  # of these steps, whose course is near the heading
HEADING_LIMIT = 0.5  # rad; a course at most this far from the heading is near it
COMPRESSED: Any = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
"""Functions that open a compressed file, by its ending."""
_UNREADABLE = OSError, EOFError, csv.Error, zlib.error, lzma.LZMAError
_SEPARATORS = {",": "Commas", ";": "Semicolons", r"\s+": "Spaces"}
WHOLE = {"lane", "Lane_ID", "Vehicle_ID", "id", "trackId"}  # columns of whole numbers

Samples = tuple[DataFrame, list[str]]
"""A table of tracks, sampled as in the source, and sentences on what was assumed."""


def files_in(path: Path, *patterns: str) -> list[Path]:
    """The file itself, or all files of a folder that match a pattern, sorted: at least one."""
    if not path.exists():
        raise InputError(f"There is no file or folder {path}.")
    if not path.is_dir():
        return [path]
    files = sorted({file for pattern in patterns for file in path.glob(pattern)})
    if not files:
        raise InputError(f"Folder {path} must hold files called {', '.join(patterns)}, got none.")
    return files


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raise InputError for a file that cannot be read, or for the line where its XML is damaged."""
    try:
        yield
    except UnicodeDecodeError as error:
        raise InputError(f"{path} cannot be read: {error}. Save it as UTF-8.") from error
    except _UNREADABLE as error:
        raise InputError(f"{path} cannot be read: {str(error).rstrip('.')}.") from error
    except etree.XMLSyntaxError as error:
        raise InputError(f"{path} is not well-formed XML: {str(error.msg).rstrip('.')}.") from error


def read_table(path: Path, required: Sequence[str], **options: Any) -> DataFrame:
    """A CSV file with at least the `required` columns.

    options: of pandas; a `dtype` is a dict. With it no option may leave out rows, as its columns
        are read a second time.

    Raises InputError for a file that is not such a table.
    """
    separated = f"{_SEPARATORS[options.get('sep', ',')]} separate cells, points decimals."
    try:
        with reading(path), warnings.catch_warnings():
            # Pandas only warns of a row with more cells than the heading and cuts it; without
            # `index_col` it would shift the columns.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table: DataFrame = pd.read_csv(
                input_file(path, "file"), low_memory=False, index_col=False, **options
            )
    except InputError:
        raise
    except pd.errors.ParserWarning:
        raise InputError(
            f"{path} is not such a table: a row has more cells than the heading. {separated}"
        ) from None
    except ValueError as error:
        raise InputError(
            f"{path} is not such a table: {str(error).strip().rstrip('.')}."
        ) from error
    if len(table.columns) == 1 < len(required):
        wanted = ", ".join(f"`{name}`" for name in required)
        got = shown(str(table.columns[0]))
        raise InputError(f"{path} must have the columns {wanted}, got one, {got}. {separated}")
    require_columns(table, required, path)
    if double := [name for name in table if f"{name}.1" in table]:  # so pandas calls the second one
        raise InputError(f"{path} must have every column once, got `{double[0]}` twice.")
    if table.empty:
        raise InputError(f"{path} must have at least one row, got none.")
    for name in options.get("dtype", ()):
        if name in table and name not in DRIVER and table[name].hasnans:
            # pandas reads a name such as NA as a missing value
            names = pd.read_csv(
                input_file(path, "file"), usecols=[name], dtype=str, na_filter=False
            )
            table[name] = names[name]
            for row in np.flatnonzero(table[name] == ""):
                line = line_of_row(path, int(row))
                raise InputError(f"`{name}` in row {line} of {path} must be a name, got nothing.")
    return table


def require_columns(table: DataFrame, required: Sequence[str], path: Path) -> None:
    """Refuse a table that lacks some of the `required` columns, and name all of them."""
    missing = [name for name in required if name not in table]
    if missing:
        known = [str(column) for column in table.columns]
        columns = "the columns " + ", ".join(f"`{name}`" for name in missing)
        hint = f" Known: {', '.join(known)[:MOST_KNOWN]}."
        if len(missing) == 1:
            columns, hint = f"a column `{missing[0]}`", did_you_mean(missing[0], known)
        raise InputError(f"{path} must have {columns}.{hint}")


def make_numbers(
    table: DataFrame,
    columns: Sequence[str],
    path: Path,
    *,
    heading: int = 1,
    rows: Sequence[int] | None = None,
    gaps: Sequence[str] = (),
) -> None:
    """Make `columns` finite numbers in place.

    table: made by `read_table`, or some of its rows; its index is a row's number in the file.
    heading: as in `line_of_row`.
    rows: lines in which the rows stand, of a file in another format than CSV.
    gaps: those of the columns whose cells may be empty; they become nan.
    """
    for name in columns:
        # true and false are no numbers to a reader of the file
        cells = table[name].astype(str) if table[name].dtype == bool else table[name]
        numbers = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=np.float64)
        # not `>`: nan is bad, too
        fits = (np.abs(numbers) <= LARGEST) & ((numbers == np.round(numbers)) | (name not in WHOLE))
        bad = np.flatnonzero(~fits & ~(cells.isna() & (name in gaps)))
        if bad.size:
            place = int(bad[0])
            number, got = numbers[place], table[name].iloc[place]
            demand = "a number, got " + ("nothing" if pd.isna(got) else repr(str(got)))
            if np.isfinite(number):
                large = abs(number) > LARGEST
                demand = f"at most {LARGEST:g} in size" if large else "a whole number"
                demand += f", got {number:g}"
            row = (
                line_of_row(path, int(table.index[place]), heading) if rows is None else rows[place]
            )
            raise InputError(f"`{name}` in row {row} of {path} must be {demand}.")
        table[name] = numbers


def unread(kind: str, names: Iterable[object], known: Sequence[str], path: Path) -> list[str]:
    """A sentence on each name that is not known: a misspelt one is as good as missing.

    kind: of the names, "Column" or "Scenario", for the sentences.
    """
    return [
        f"{kind} `{name}` of {path.name} is not known and is not read.{did_you_mean(name, known)}"
        for name in map(str, names)
        if name not in known
    ]


def in_order(table: DataFrame) -> tuple[DataFrame, list[str]]:
    """The samples by vehicle and time, and notes.

    Of samples of a vehicle at one time the first stays. A track is split where it jumps.
    """
    keys = [*TRACK, "t"]
    rows = table.sort_values(keys, kind="stable", ignore_index=True)
    double = rows.duplicated(keys)
    rows = rows[~double].reset_index(drop=True)
    track = [rows[name] for name in TRACK]
    moved, seconds = _steps(rows)
    usual = (moved / seconds).groupby(track).transform("median")  # speed of the track, m/s
    jump = moved > JUMP + np.maximum(JUMP_SPEED, 3.0 * usual) * seconds
    rows["vehicle"] = numbered(rows["vehicle"], jump.groupby(track).cumsum())
    counted = {
        "samples with a time that their vehicle already had were left out.": double,
        "jumps in tracks, as of an id that is used again: each side is a vehicle of its own.": jump,
    }
    return rows, [f"{flags.sum()} {words}" for words, flags in counted.items() if flags.any()]


def numbered(vehicle: Series[str], before: Series[Any]) -> Series[str]:
    """Names of the parts of tracks: `a`, `a#2`, ...; before: number of parts before it."""
    mark = "#"
    while vehicle.str.contains(mark).any():  # a vehicle may be called `a#2`
        mark += "#"
    return vehicle.where(before == 0, vehicle + mark + (before + 1).astype(str))


def _steps(table: DataFrame, samples: int = 1) -> tuple[Series[float], Series[float]]:
    """Distance, m, and time, s, to each row from the row `samples` before it in its track."""
    steps: Any = table.groupby(TRACK, sort=False)[["t", "x", "y"]].diff(samples)
    return np.hypot(steps["x"], steps["y"]), steps["t"]


def check_motion(table: DataFrame) -> None:
    """Refuse speeds in another unit than m/s and headings that are not rad along the motion.

    table: recording, vehicle, t, x, y and what is known of speed and heading, by vehicle and time.
    """
    sizes = table.groupby(TRACK).size()
    # a step spans as many samples as `CHORD` lasts, but not more than a usual track has
    in_chord = CHORD / np.nan_to_num(_steps(table)[1].median(), nan=CHORD)
    samples = round(max(1.0, min(in_chord, sizes.median() - 1.0)))
    moved, seconds = _steps(table, samples)
    moved = moved.where(seconds < 3.0 * CHORD)  # a hole shows neither
    recording, speeds = table["recording"], moved / seconds
    median = speeds.groupby(recording).median()
    _refuse(median[median > FASTEST], "`x` and `y`", "m", "m/s as the median speed")
    if "speed" in table:
        factors = (table["speed"] / speeds)[speeds > MOVES].groupby(recording).median()
        _refuse(factors[~factors.between(*SPEEDS_AGREE)], "`speed`", "m/s", "times the speed")
    if "heading" in table:
        aside, ahead = (table[name].diff(samples) for name in ("y", "x"))
        # the cosine has no jumps of 2 pi; arccos makes it the angle between course and heading
        turned = np.cos(np.arctan2(aside, ahead) - table["heading"])
        angles = np.arccos(turned[moved > STEP]).groupby(recording).quantile(HEADING_SHARE)
        unit = "rad, counter-clockwise from x"
        _refuse(angles[angles > HEADING_LIMIT], "`heading`", unit, "rad off the course")


def _refuse(bad: Series[float], channel: str, unit: str, words: str) -> None:
    """Refuse the first of the values of recordings in `bad`; without any, nothing is refused.

    channel, unit: the columns and the unit that they must have.
    words: unit and meaning of the values.
    """
    for recording, value in bad.items():
        raise InputError(
            f"{channel} of recording `{recording}` must be in {unit}, got {value:.3g} {words} that "
            "x, y and t show."
        )


def line_of_row(path: Path, row: int, heading: int = 1) -> int:
    """The line of a CSV file, as an editor counts, in which a row of its table ends.

    row: number in the table of pandas, from 0; it has no rows for blank lines.
    heading: number of lines before the first row, blank ones not counted.
    """
    opened = COMPRESSED.get(path.suffix, open)
    with opened(path, "rt", encoding="utf-8", errors="replace", newline="") as file:
        lines = csv.reader(file)  # `line_num` is that of the row just read
        filled = (lines.line_num for cells in lines if len(cells) > 1 or "".join(cells).strip())
        in_file = itertools.islice(filled, heading + row, None)
        return next(in_file, heading + row + 1)  # of a compression that only pandas reads


def add_motion(table: DataFrame, names: Sequence[str], owner: str) -> list[str]:
    """Compute the missing ones of the channels `names` from t, x and y of each track, and return
    their names.

    table: tracks, sorted by time; completed in place.
    owner: names the table in sentences.
    """
    missing = [name for name in names if name not in table]
    if not missing:
        return []
    for (_, vehicle), track in table.groupby(TRACK, sort=False):
        try:
            motion = Trajectory(track["t"], track["x"], track["y"])
        except InputError as error:
            raise InputError(f"Vehicle `{vehicle}` in {owner}: {error}") from error
        for name in missing:
            table.loc[track.index, name] = getattr(motion, name)
    return missing


def require(condition: Any, path: Path, sentence: str) -> None:
    """Refuse a file unless the condition holds.

    sentence: the rest of one that begins with the file, as `must have a row`.
    """
    if not condition:
        raise InputError(f"{path} {sentence}.")
