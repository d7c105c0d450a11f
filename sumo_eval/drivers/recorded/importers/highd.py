"""highD: bird's-eye recordings of German motorways (25 Hz; `NN_tracks.csv`, `NN_tracksMeta.csv`,
`NN_recordingMeta.csv`).

Traps: `width` is the vehicle's length and `height` its width; x, y is the upper left corner of its
box; y points down. Vehicles of direction 1 drive to the left, on the upper lanes, those of
direction 2 to the right, on the lower ones. Each direction becomes a recording of its own, with the
lanes of the file's lane markings.

Users: `drivers/recorded/importing.py`.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.levelx import read_tables
from sumo_eval.drivers.recorded.importers.tables import Samples, require

_TRACKS = (
    "frame", "id", "x", "y", "width", "height", "xVelocity", "yVelocity", "xAcceleration",
    "yAcceleration",
)  # fmt: skip
_UPPER = 1  # drivingDirection of the vehicles that drive to the left


def read(path: Path) -> Samples:
    """The recordings of a file."""
    tracks, meta, about = read_tables(
        path, _TRACKS, ("id", "class", "drivingDirection"),
        ("frameRate", "upperLaneMarkings", "lowerLaneMarkings"),
    )  # fmt: skip
    stem = path.name.removesuffix("_tracks.csv")
    names = "tracksMeta", "recordingMeta"
    meta_path, about_path = (path.with_name(f"{stem}_{name}.csv") for name in names)
    require(
        meta["drivingDirection"].isin((_UPPER, 2)).all(),
        meta_path,
        "must have a `drivingDirection` of 1 or 2 in each row",
    )
    vehicles = meta.set_index("id")
    direction = tracks["id"].map(vehicles["drivingDirection"])
    parts = []
    # x along the road is x of the image times `forward`; y to the left is y of the image, which
    # points down, times the opposite
    for name, forward in (("upper", -1.0), ("lower", 1.0)):
        rows = tracks[(direction == _UPPER) == (forward < 0.0)]
        if rows.empty:
            continue
        y = -forward * (rows["y"] + rows["height"] / 2)
        edges = np.sort(-forward * _edges(about[f"{name}LaneMarkings"].iloc[0], about_path))
        vx, vy = forward * rows["xVelocity"], -forward * rows["yVelocity"]
        ax, ay = forward * rows["xAcceleration"], -forward * rows["yAcceleration"]
        speed = np.hypot(vx, vy)
        parts.append(
            pd.DataFrame(
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
                    "class": rows["id"].map(vehicles["class"]).astype(str),
                    "lane": np.clip(np.searchsorted(edges, y) - 1, 0, len(edges) - 2),
                }
            )
        )
    return pd.concat(parts), []


def _edges(text: object, path: Path) -> np.ndarray:
    """Lane markings `8.5;12.25;16.0`, m."""
    edges = pd.to_numeric(pd.Series(str(text).split(";")), errors="coerce").to_numpy()
    valid = len(edges) >= 2 and np.isfinite(edges).all()
    require(valid, path, f"must have at least two lane markings separated by `;`, got '{text}'")
    return edges
