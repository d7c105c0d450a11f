"""OpenACC (JRC): platoons on test tracks, one row an instant, columns numbered by place in the
platoon.

Position k has Speed{k}, E{k}, N{k}; IVS{k} is the bumper gap between vehicle k and the one behind
it. The vehicles drive in one line, so x is the distance along the path of the first one and follows
from the gaps: x_(k+1) = x_k - IVS_k - length. Lateral positions are those of a point on a curved
track and are not read: y = 0. Only runs whose `ACC` is 0 are human drives.

Users: `drivers/recorded/importing.py`.
"""

import csv
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import (
    Samples,
    make_numbers,
    read_table,
    reading,
    require,
)
from sumo_eval.input_file import input_file

LENGTH, WIDTH = 4.5, 1.8  # m; the files name the cars but not their sizes
_HEAD_ROWS = 5


def read(path: Path) -> Samples:
    """The recordings of a file."""
    head = _head(path)
    names = [name for name in head["Vehicle_order"] if name]
    rows = read_table(path, ("Time",), skiprows=_HEAD_ROWS)
    numbers = [*rows.filter(regex="^(Speed|IVS)[1-9][0-9]*$")]
    speeds = (name for name in numbers if name.startswith("Speed"))
    places = sorted(int(name.removeprefix("Speed")) for name in speeds)
    require(places, path, "must have columns Speed1, Speed2, ..., got none")
    make_numbers(rows, ["Time", *numbers], path, heading=_HEAD_ROWS + 1, gaps=numbers)
    parts = []
    # A chain is a row of vehicles with known gaps, all of one length. centre_ahead: x of the centre
    # of the vehicle ahead less the gap of the bumpers, m: one length ahead of the next centre.
    chains = 0
    hidden = 0  # samples of speed without a known place
    centre_ahead: Any = np.nan
    for place in places:
        speed = rows[f"Speed{place}"]
        x = centre_ahead - LENGTH  # of the first place a number, nan
        if place - 1 not in places or x.isna().all():  # the first of a chain
            chains += 1
            values = speed.ffill().fillna(0.0).to_numpy()
            steps = (values[1:] + values[:-1]) / 2 * np.diff(rows["Time"].to_numpy())
            driven = np.concatenate(([0.0], np.cumsum(steps)))
            x = pd.Series(driven, index=rows.index).where(speed.notna())
        name = names[place - 1] if place - 1 < len(names) else f"vehicle_{place}"
        table = pd.DataFrame(
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
        )
        parts.append(table[speed.notna() & x.notna()])
        hidden += int((speed.notna() & x.isna()).sum())
        centre_ahead = x - rows.get(f"IVS{place}", np.nan)
    notes = [
        f"{path.name} has no vehicle sizes and no lateral positions: {LENGTH:g} m x {WIDTH:g} m "
        "and y = 0 are assumed.",
        f"{path.name} is recorded as {chains} platoons: gaps to the lead vehicle are known only "
        "inside each.",
    ]
    if hidden:
        notes.append(
            f"{hidden} samples in {path.name} are left out: an IVS or speed ahead of them is empty."
        )
    engaged = next((value for value in head["ACC"] if value), "0")  # number of cars
    if engaged not in ("0", "0.0"):
        notes.append(
            f"{path.name} was driven with ACC engaged in {engaged} cars: these are not people."
        )
    return pd.concat(parts, ignore_index=True), notes


def _head(path: Path) -> dict[str, list[str]]:
    """The cells of the rows above the table, by the first of each."""
    with reading(path), input_file(path, "file").open(newline="", encoding="utf-8-sig") as file:
        head = {row[0]: row[1:] for row in islice(csv.reader(file), _HEAD_ROWS) if row}
    require(
        {"Vehicle_order", "ACC"} <= head.keys(),
        path,
        "must begin with the five rows of OpenACC's head",
    )
    return head
