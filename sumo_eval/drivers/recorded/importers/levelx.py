"""The levelX family, inD, exiD, rounD and uniD: drone recordings in metres with centres and
headings (`NN_tracks.csv` ...).

They share one layout: x to the east, y to the north, heading in degrees counter-clockwise. Roads
may be curved, so `importing` straightens the samples along the paths that vehicles drive.

Users: `drivers/recorded/importers/highd.py`, `drivers/recorded/importing.py`.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import (
    Samples,
    make_numbers,
    read_table,
    require,
)

_TRACKS = (
    "trackId", "frame", "xCenter", "yCenter", "heading", "width", "length", "xVelocity",
    "yVelocity",
)  # fmt: skip


def read_tables(path: Path, *columns: Sequence[str]) -> list[pd.DataFrame]:
    """The tables of a recording of levelX: tracks, vehicles and facts on the recording.

    columns: for each table, those that it must have; in the vehicles' table the first is its key.
    """
    stem = path.name.removesuffix("_tracks.csv")
    require(stem != path.name, path, "must be called NN_tracks.csv, beside its NN_tracksMeta.csv")
    names = "tracks", "tracksMeta", "recordingMeta"
    paths = [path.with_name(f"{stem}_{name}.csv") for name in names]
    tables = [read_table(file, needed) for file, needed in zip(paths, columns, strict=True)]
    # all needed columns, and lonAcceleration if it is there
    make_numbers(tables[0], sorted({"lonAcceleration", *columns[0]} & {*tables[0]}), path)
    key = columns[1][0]
    make_numbers(tables[1], (key,), paths[1])
    require(not tables[1][key].duplicated().any(), paths[1], f"must name each {key} once")
    unknown = tables[0].loc[~tables[0][key].isin(tables[1][key]), key]
    require(
        unknown.empty, path, f"must hold vehicles of {paths[1].name} only, got {unknown.min():.0f}"
    )
    make_numbers(tables[2], ("frameRate",), paths[2])
    require(tables[2]["frameRate"].iloc[0] > 0.0, paths[2], "must have a `frameRate` above 0")
    return tables


def read(path: Path) -> Samples:
    """The samples of one recording, and a note on the road users that are left out."""
    tracks, meta, about = read_tables(path, _TRACKS, ("trackId", "class"), ("frameRate",))
    kind = tracks["trackId"].map(meta.set_index("trackId")["class"])
    has_box = tracks["length"] > 0.0  # pedestrians and bicycles have none
    table = pd.DataFrame(
        {
            "recording": path.name.removesuffix("_tracks.csv"),
            "vehicle": tracks["trackId"].astype(np.int64).astype(str),
            "t": tracks["frame"] / about["frameRate"].iloc[0],
            "x": tracks["xCenter"],
            "y": tracks["yCenter"],
            "heading": np.radians(tracks["heading"]),
            "speed": np.hypot(tracks["xVelocity"], tracks["yVelocity"]),
            "length": tracks["length"],
            "width": tracks["width"],
            "class": kind.astype(str),
        }
    )
    if "lonAcceleration" in tracks:
        table["acceleration"] = tracks["lonAcceleration"]
    without = tracks.loc[~has_box, "trackId"].nunique()
    note = f"{without} road users without a box (on foot, on bicycles) in {path.name} are left out."
    return table[has_box], [note] if without else []
