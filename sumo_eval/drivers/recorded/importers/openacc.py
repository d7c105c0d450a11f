"""OpenACC (JRC): platoons on test tracks, one row an instant, columns numbered by place in the
platoon.

Position k has Speed{k}, E{k}, N{k}; IVS{k} is the bumper gap between vehicle k and the one behind
it. The vehicles drive in one line, so x is the distance along the path of the first one and follows
from the gaps: x_(k+1) = x_k - IVS_k - length. Lateral positions are those of a point on a curved
track and are not read: y = 0. Only runs whose `ACC` is 0 are human drives.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.found import ImportedSamples
from sumo_eval.drivers.recorded.importers.tables import checked_numbers, read_table, require
from sumo_eval.errors import InputError
from sumo_eval.input_file import input_file

LENGTH, WIDTH = 4.5, 1.8  # m; the files name the cars but not their sizes
_HEAD_ROWS = 5


def read(path: Path) -> Iterator[ImportedSamples]:
    """The recordings of a file."""
    try:
        with input_file(path, "file").open(newline="", encoding="utf-8") as file:
            head = {
                row[0]: row[1:]
                for row, _ in zip(csv.reader(file), range(_HEAD_ROWS), strict=False)
                if row
            }
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read: {error}.") from error
    require(
        "Vehicle_order" in head and "ACC" in head,
        path,
        "must begin with the five rows of OpenACC's head",
    )
    names = [name for name in head["Vehicle_order"] if name]
    rows = read_table(path, ("Time",), skiprows=_HEAD_ROWS)
    checked_numbers(rows, ("Time",), path, first_row=_HEAD_ROWS + 2)
    places = sorted(
        int(str(name).removeprefix("Speed")) for name in rows if str(name).startswith("Speed")
    )
    require(bool(places), path, "must have columns Speed1, Speed2, ..., got none")
    parts: list[pd.DataFrame] = []
    chains = 0
    ahead: pd.Series | None = None
    previous = None
    for place in places:
        speed = pd.to_numeric(rows[f"Speed{place}"], errors="coerce")
        gap = (
            pd.to_numeric(rows[f"IVS{previous}"], errors="coerce")
            if f"IVS{previous}" in rows
            else None
        )
        adjacent = (
            previous is not None and place == previous + 1 and gap is not None and ahead is not None
        )
        driven = pd.Series(
            np.concatenate(([0.0], np.cumsum(_steps(speed, rows["Time"])))), index=rows.index
        )
        if adjacent and gap is not None and ahead is not None and (ahead - gap).notna().any():
            x = ahead - gap - LENGTH
        else:
            chains += 1
            x = driven.where(speed.notna())
        usable = speed.notna() & x.notna()
        name = names[place - 1] if place - 1 < len(names) else f"vehicle_{place}"
        parts.append(
            pd.DataFrame(
                {
                    "recording": f"{path.stem}-{chains}",
                    "vehicle": f"{place}-{name}",
                    "t": rows["Time"] - rows["Time"].iloc[0],
                    "x": x,
                    "y": 0.0,
                    "heading": 0.0,
                    "speed": speed,
                    "length": LENGTH,
                    "width": WIDTH,
                    "class": "car",
                    "lane": 0,
                }
            )[usable]
        )
        previous, ahead = place, x
    notes = [
        f"{path.name} has no vehicle sizes and no lateral positions: {LENGTH:g} m x {WIDTH:g} m "
        "and y = 0 are assumed.",
        f"{path.name} is recorded as {chains} platoons: gaps to the lead vehicle are known only "
        "inside each.",
    ]
    engaged = next((value for value in head["ACC"] if value), "0")
    if engaged not in ("0", "0.0"):
        notes.append(
            f"{path.name} was driven with ACC engaged in {engaged} cars: these are not people."
        )
    yield ImportedSamples(pd.concat(parts, ignore_index=True), notes=tuple(notes))


def _steps(speed: pd.Series, time: pd.Series) -> np.ndarray:
    """Distance driven between samples, m."""
    values = speed.ffill().fillna(0.0).to_numpy()
    steps: np.ndarray = (values[1:] + values[:-1]) / 2 * np.diff(time.to_numpy())
    return steps
