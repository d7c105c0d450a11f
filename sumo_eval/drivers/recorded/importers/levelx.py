"""The levelX family, inD, exiD, rounD and uniD: drone recordings in metres with centres and
headings (`NN_tracks.csv` ...).

They share one layout: x to the east, y to the north, heading in degrees counter-clockwise. Roads
may be curved, so the samples are straightened along the paths that vehicles drive.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.found import ImportedSamples
from sumo_eval.drivers.recorded.importers.tables import checked_numbers, read_table, require

_TRACKS = (
    "trackId",
    "frame",
    "xCenter",
    "yCenter",
    "heading",
    "width",
    "length",
    "xVelocity",
    "yVelocity",
)


def read(path: Path) -> Iterator[ImportedSamples]:
    """The recordings of a file."""
    require(
        path.name.endswith("_tracks.csv"),
        path,
        "must be called NN_tracks.csv, beside its NN_tracksMeta.csv",
    )
    stem = path.name.removesuffix("_tracks.csv")
    tracks = read_table(path, _TRACKS)
    checked_numbers(
        tracks, [*_TRACKS, *(["lonAcceleration"] if "lonAcceleration" in tracks else [])], path
    )
    meta_path, about_path = (
        path.with_name(f"{stem}_tracksMeta.csv"),
        path.with_name(f"{stem}_recordingMeta.csv"),
    )
    meta = read_table(meta_path, ("trackId", "class"))
    about = read_table(about_path, ("frameRate",))
    checked_numbers(about, ("frameRate",), about_path)
    kind = tracks["trackId"].map(meta.set_index("trackId")["class"])
    require(not kind.isna().any(), path, f"must hold vehicles of {meta_path.name} only")
    bodies = tracks["length"] > 0.0  # pedestrians and bicycles have no box
    table = pd.DataFrame(
        {
            "recording": stem,
            "vehicle": tracks["trackId"].astype(np.int64).astype(str),
            "t": tracks["frame"] / about["frameRate"].iloc[0],
            "x": tracks["xCenter"],
            "y": tracks["yCenter"],
            "heading": np.radians(tracks["heading"]),
            "speed": np.hypot(tracks["xVelocity"], tracks["yVelocity"]),
            "length": tracks["length"],
            "width": tracks["width"],
            "class": kind.astype(str).str.lower(),
        }
    )
    if "lonAcceleration" in tracks:
        table["acceleration"] = tracks["lonAcceleration"]
    left_out = int(tracks.loc[~bodies, "trackId"].nunique())
    notes = (
        (
            f"{left_out} road users without a box (on foot, on bicycles) in {path.name} are left "
            "out.",
        )
        if left_out
        else ()
    )
    yield ImportedSamples(table[bodies], planar=True, notes=notes)
