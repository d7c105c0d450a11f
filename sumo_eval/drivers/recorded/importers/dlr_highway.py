"""DLR Highway Traffic dataset (v1.1, `trajectories_*.csv`, 20 Hz): centres in UTM, yaw in degrees
counter-clockwise.

Each sample has probabilities of six classes. A vehicle's class is the one that is the most probable
in most of its samples. The motorway is curved: `importing` straightens the samples.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import (
    Samples,
    line_of_row,
    make_numbers,
    read_table,
)
from sumo_eval.errors import InputError

_CLASSES = ("pedestrian", "bicycle", "motorbike", "car", "van", "truck")
_NUMBERS = (
    "id", "center_easting", "center_northing", "velocity_easting", "velocity_northing",
    "acceleration_easting",
    "acceleration_northing", "yaw", "dimension_length", "dimension_width",
    *(f"classifications_{c}" for c in _CLASSES),
)  # fmt: skip


def read(path: Path) -> Samples:
    """The recordings of a file."""
    columns = ("timestamp", *_NUMBERS)
    rows = read_table(path, columns, usecols=lambda name: name in columns)
    make_numbers(rows, _NUMBERS, path)
    # most probable class of each sample; of a vehicle the most frequent of these
    likely = np.argmax(rows[[f"classifications_{name}" for name in _CLASSES]].to_numpy(), axis=1)
    kind = {
        name: _CLASSES[np.bincount(likely[index]).argmax()]
        for name, index in rows.groupby("id").indices.items()
    }
    vx, vy = rows["velocity_easting"], rows["velocity_northing"]
    ax, ay = rows["acceleration_easting"], rows["acceleration_northing"]
    speed = np.hypot(vx, vy)
    bodies = rows.groupby("id")[["dimension_length", "dimension_width"]].transform("median")
    table = pd.DataFrame(
        {
            "recording": path.stem,
            "vehicle": rows["id"].astype(np.int64).astype(str),
            "t": _times(rows["timestamp"], path),
            "x": rows["center_easting"] - rows["center_easting"].iloc[0],
            "y": rows["center_northing"] - rows["center_northing"].iloc[0],
            "heading": np.radians(rows["yaw"]),
            "speed": speed,
            # component along the motion; 0.1 m/s keeps it finite at a standstill
            "acceleration": (vx * ax + vy * ay) / np.maximum(speed, 0.1),
            "length": bodies["dimension_length"],
            "width": bodies["dimension_width"],
            "class": rows["id"].map(kind).replace("motorbike", "motorcycle"),
        }
    )
    return table, []  # nothing was assumed


def _times(stamps: pd.Series[Any], path: Path) -> pd.Series[float]:
    """Times since the first stamp, s."""
    time = pd.to_datetime(stamps, utc=True, errors="coerce", format="ISO8601")
    if time.isna().any():
        bad = int(np.flatnonzero(time.isna())[0])
        raise InputError(
            f"`timestamp` in row {line_of_row(path, bad)} of {path} must be a time, got "
            f"'{stamps.iloc[bad]}'."
        )
    return (time - time.min()).dt.total_seconds()
