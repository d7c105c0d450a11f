"""SUMO's floating car data (--fcd-output), XML and CSV.

Traps: x, y is the centre of the FRONT bumper; angles are degrees clockwise from north. The output
    has no bodies: a vehicle gets SUMO's default size for the class that its type is named after
    (`BODIES`), else a car's. The output mixes persons and containers with the vehicles: `read`
    leaves them out.

Users: `drivers/recorded/importing.py`.
"""

import gzip
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from lxml import etree
from pandas import DataFrame, Series

from sumo_eval.drivers.recorded.importers.tables import (
    Samples,
    make_numbers,
    read_table,
    reading,
)
from sumo_eval.drivers.recorded.recordings import LONGEST_HOLE
from sumo_eval.errors import InputError
from sumo_eval.input_file import input_file

LENGTH, WIDTH = 5.0, 1.8  # m, SUMO's default passenger car
# length and width of SUMO's other classes of vehicles, m
BODIES = {
    "truck": (7.1, 2.4),
    "trailer": (16.5, 2.55),
    "bus": (12.0, 2.5),
    "motorcycle": (2.2, 0.9),
    "bicycle": (1.6, 0.65),
}
_NEEDED = ("x", "y", "angle", "speed")


def read(path: Path) -> Samples:
    """The recordings of a file."""
    is_xml = ".xml" in path.suffixes
    rows = _from_xml(path) if is_xml else _from_csv(path)
    # a vehicle has a lane, a person or container an edge
    on_edge = rows.get("edge", Series(np.nan, rows.index)).notna()
    persons, rows = rows[on_edge], rows[~on_edge]
    if rows.empty:
        raise InputError(
            f"{path} must be SUMO's FCD output with at least one vehicle (<fcd-export>), got none."
        )
    numbers = [*rows.filter(["time", *_NEEDED, "acceleration", "posLat"])]
    lines = rows["row"].tolist() if is_xml else None
    make_numbers(rows, numbers, path, rows=lines, gaps=["posLat"])
    _check_clock_and_places(rows, path)
    kinds = rows.get("type", Series("car", rows.index)).astype(str).str.lower()
    kinds = kinds.replace("default_biketype", "bicycle")  # the name of SUMO's own type
    length, width = np.array([BODIES.get(kind, (LENGTH, WIDTH)) for kind in kinds]).T
    heading = np.radians(90.0 - rows["angle"])
    table = DataFrame(
        {
            "recording": Path(path.name.removesuffix(".gz")).stem,
            "vehicle": rows["id"].astype(str),
            "t": rows["time"],
            "x": rows["x"] - length / 2 * np.cos(heading),
            "y": rows["y"] - length / 2 * np.sin(heading),
            "heading": heading,
            "speed": rows["speed"],
            "length": length,
            "width": width,
            "class": kinds.where(kinds.isin([*BODIES, "car", "van"]), "car"),
        }
    )
    if "acceleration" in rows:
        table["acceleration"] = rows["acceleration"]
    if "posLat" in rows:  # empty: assumed in the middle of its lane
        table["offset"] = rows["posLat"].fillna(0.0)
    notes = [
        f"{path.name} has no vehicle bodies: SUMO's default sizes are assumed ({LENGTH:g} m x "
        f"{WIDTH:g} m for a car)."
    ]
    if len(persons):
        left_out = persons["id"].nunique()
        notes.append(f"Persons and containers of {path.name} are left out: {left_out}.")
    return table, notes


def _check_clock_and_places(rows: DataFrame, path: Path) -> None:
    """Refuse places in degrees and samples too far apart, each with the option of SUMO."""
    steps = rows.groupby("id")[["time", "x", "y"]].diff()
    # a metre is about 1e-5 degrees
    by_speed = (rows["speed"] * steps["time"]).sum()
    if np.hypot(steps["x"], steps["y"]).sum() < 1e-3 * by_speed:
        raise InputError(
            f"{path} must have `x` and `y` in m, got degrees: run SUMO without `--fcd-output.geo`."
        )
    usual = steps["time"].median()
    if usual > LONGEST_HOLE + 1e-6:  # for rounding
        raise InputError(
            f"{path} must have samples of a vehicle at most {LONGEST_HOLE:g} s apart, got {usual:g}"
            " s: run SUMO with `--step-length 0.1`."
        )


def _from_csv(path: Path) -> DataFrame:
    columns = "timestep_time", "vehicle_id", *(f"vehicle_{name}" for name in _NEEDED)
    names = {"vehicle_id": str}
    # only empty cells are missing values: a vehicle may be called NA
    rows = read_table(path, columns, sep=";", converters=names, keep_default_na=False, na_values="")
    rows = rows.dropna(subset="vehicle_id")  # a row without a name is a step without vehicles
    rows.columns = rows.columns.str.removeprefix("timestep_").str.removeprefix("vehicle_")
    return rows


def _from_xml(path: Path) -> DataFrame:
    rows = []
    opening = gzip.open if path.suffix == ".gz" else open
    with reading(path), ExitStack() as opened:
        for _, step in etree.iterparse(
            opened.enter_context(opening(input_file(path, "file"), "rb")),
            tag="timestep",
            resolve_entities=False,
            no_network=True,
        ):
            for item in step.iterchildren("vehicle", "person", "container"):
                rows.append(dict(item.attrib, time=step.get("time"), row=item.sourceline))
            step.clear()
    for row in rows:
        for name in ("id", *_NEEDED):
            if name not in row:
                raise InputError(
                    f"The vehicle in row {row['row']} of {path} must have `{name}`, got none."
                )
    return DataFrame(rows)
