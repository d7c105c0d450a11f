"""NGSIM trajectories in feet: the original 18 columns without a head row, and the 25 columns of
data.transportation.gov.

Traps: x, y is the centre of the FRONT; Local_X grows to the right from the left road edge, Local_Y
along the road; lane 1 is the leftmost, 6 an auxiliary lane, 7 and 8 ramps; vehicle ids are used
again, in other recordings of the same file and within one; speeds and accelerations are rough
differences, so accelerations are derived again from smoothed speeds.

Users: `drivers/recorded/importing.py`.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import (
    Samples,
    checked_numbers,
    read_table,
    require_columns,
)
from sumo_eval.input_file import input_file

FOOT = 0.3048  # m
MAIN_LANES = 5  # of US-101 and I-80
_ORIGINAL = (
    "Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X",
    "Global_Y", "v_length",
    "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID", "Preceding", "Following", "Space_Headway",
    "Time_Headway",
)  # fmt: skip
_NEEDED = (
    "Vehicle_ID", "Frame_ID", "Global_Time", "Local_X", "Local_Y", "v_length", "v_Width", "v_Class",
    "v_Vel", "Lane_ID",
)  # fmt: skip
_CLASSES = {1: "motorcycle", 2: "car", 3: "truck"}


def read(path: Path) -> Samples:
    """The recordings of a file."""
    rows = _rows(path)
    # same id as in the row before
    same = (rows["Vehicle_ID"].diff() == 0) & (rows["place"] == rows["place"].shift())
    # yet a new vehicle: the clock jumps by more than 1000 ms, or the length by 0.05 ft
    again = same & ((rows["Global_Time"].diff() > 1000.0) | (rows["v_length"].diff().abs() > 0.05))
    # number of earlier vehicles with this id
    use = again.groupby([rows["place"], rows["Vehicle_ID"]]).cumsum().astype(int)
    start = rows.groupby("place")["Global_Time"].transform("min")
    number = rows["Vehicle_ID"].astype(np.int64).astype(str)
    table = pd.DataFrame(
        {
            "recording": rows["place"],
            "vehicle": number.where(use == 0, number + "/" + (use + 1).astype(str)),
            "t": (rows["Global_Time"] - start) / 1000.0,
            "x": FOOT * (rows["Local_Y"] - rows["v_length"] / 2),
            "y": -FOOT * rows["Local_X"],
            "heading": 0.0,
            "speed": FOOT * rows["v_Vel"],
            "length": FOOT * rows["v_length"],
            "width": FOOT * rows["v_Width"],
            "class": rows["v_Class"].map(_CLASSES).fillna("car"),
            "lane": MAIN_LANES - rows["Lane_ID"].astype(np.int64),
        }
    )
    # y = 0: where a recording's vehicles drive (median) in that lane of it nearest to lane 0
    lanes_off = table["lane"].abs()
    right = table["y"].where(lanes_off == lanes_off.groupby(table["recording"]).transform("min"))
    table["y"] -= right.groupby(table["recording"]).transform("median")
    notes = [
        f"{path.name} has no headings: 0 is assumed. Its lane {MAIN_LANES} is the right lane "
        "(lane 0); lanes beyond it are auxiliary lanes and ramps."
    ]
    if not rows["v_Class"].isin(_CLASSES).all():
        notes.append(f"{path.name} has classes beyond 1 to 3: those are assumed to be cars.")
    if again.any():
        notes.append(
            f"{again.sum()} times {path.name} uses a vehicle id again; each use is a vehicle of "
            "its own."
        )
    return table, notes


def _rows(path: Path) -> pd.DataFrame:
    """The file's samples, with a column `place`, sorted by place, vehicle and time."""
    with input_file(path, "file").open("rb") as file:
        first = file.readline().lstrip()
    # a head row begins with a title, maybe behind a quote, a byte order mark, or the comma of a
    # column of row numbers
    has_head_row = first[:1] not in b"+-.0123456789"
    if has_head_row:
        spelling = {name.lower(): name for name in (*_NEEDED, "Location")}
        rows = read_table(path, (), dtype={"Location": str}).rename(
            columns=lambda name: spelling.get(name.lower(), name)
        )
        require_columns(rows, _NEEDED, path)
    else:
        rows = read_table(path, (), sep=r"\s+", header=None, names=_ORIGINAL)
    checked_numbers(rows, _NEEDED, path, heading=int(has_head_row))
    rows["place"] = rows["Location"].astype(str) if "Location" in rows else path.stem
    return rows.sort_values(["place", "Vehicle_ID", "Global_Time"], kind="stable")
