"""highD: bird's-eye recordings of German motorways (25 Hz; `NN_tracks.csv`, `NN_tracksMeta.csv`,
`NN_recordingMeta.csv`).

Traps: `width` is the vehicle's length and `height` its width; x, y is the upper left corner of its
    box; y points down; direction 1 drives to the left on the upper lanes, direction 2 to the right
    on the lower ones. Each direction becomes a recording of its own, with the lanes of the file's
    lane markings.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.found import ImportedSamples
from sumo_eval.drivers.recorded.importers.tables import checked_numbers, read_table, require

_TRACKS = (
    "frame",
    "id",
    "x",
    "y",
    "width",
    "height",
    "xVelocity",
    "yVelocity",
    "xAcceleration",
    "yAcceleration",
)
_UPPER = 1  # drivingDirection of the vehicles that drive to the left


def read(path: Path) -> Iterator[ImportedSamples]:
    """The recordings of a file."""
    require(
        path.name.endswith("_tracks.csv"),
        path,
        "must be called NN_tracks.csv, beside its NN_tracksMeta.csv",
    )
    stem = path.name.removesuffix("_tracks.csv")
    tracks = read_table(path, _TRACKS)
    checked_numbers(tracks, _TRACKS, path)
    meta_path, about_path = (
        path.with_name(f"{stem}_tracksMeta.csv"),
        path.with_name(f"{stem}_recordingMeta.csv"),
    )
    meta = read_table(meta_path, ("id", "class", "drivingDirection"))
    checked_numbers(meta, ("id", "drivingDirection"), meta_path)
    about = read_table(about_path, ("frameRate", "upperLaneMarkings", "lowerLaneMarkings"))
    checked_numbers(about, ("frameRate",), about_path)
    unknown = ~tracks["id"].isin(meta["id"])
    require(
        not unknown.any(),
        path,
        f"must hold vehicles of {meta_path.name} only, got id {tracks['id'][unknown].min()}",
    )
    direction = tracks["id"].map(meta.set_index("id")["drivingDirection"])
    for name, upper in (("upper", True), ("lower", False)):
        rows = tracks[(direction == _UPPER) == upper]
        if rows.empty:
            continue
        edges = _edges(about[f"{name}LaneMarkings"].iloc[0], about_path)
        # image x to x along the road; image y (down) to y (left) is the opposite
        forward = -1.0 if upper else 1.0
        y = -forward * (rows["y"] + rows["height"] / 2)
        edges = np.sort(-forward * edges)
        vx, vy = forward * rows["xVelocity"], -forward * rows["yVelocity"]
        ax, ay = forward * rows["xAcceleration"], -forward * rows["yAcceleration"]
        speed = np.hypot(vx, vy)
        table = pd.DataFrame(
            {
                "recording": f"{stem}-{name}",
                "vehicle": rows["id"].astype(np.int64).astype(str),
                "t": rows["frame"] / about["frameRate"].iloc[0],
                "x": forward * (rows["x"] + rows["width"] / 2),
                "y": y - (edges[0] + edges[1]) / 2,
                "heading": np.arctan2(vy, vx),
                "speed": speed,
                "acceleration": (vx * ax + vy * ay) / np.maximum(speed, 0.1),
                "length": rows["width"],
                "width": rows["height"],
                "class": rows["id"].map(meta.set_index("id")["class"]).astype(str).str.lower(),
                "lane": np.clip(np.searchsorted(edges, y) - 1, 0, len(edges) - 2),
            }
        )
        yield ImportedSamples(table)


def _edges(text: object, path: Path) -> np.ndarray:
    """Lane markings `8.5;12.25;16.0`, m."""
    try:
        edges = np.array([float(part) for part in str(text).split(";")])
    except ValueError:
        edges = np.empty(0)
    require(
        len(edges) >= 2,
        path,
        f"must have at least two lane markings separated by `;`, got {text!r}",
    )
    return edges
