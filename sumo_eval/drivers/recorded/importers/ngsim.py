"""NGSIM trajectories in feet: the original 18 columns without a head row, and the 25 columns of
data.transportation.gov.

Traps: x, y is the centre of the FRONT; Local_X grows to the right from the left road edge, Local_Y
along the road; vehicle ids are used again, in other recordings of the same file and within one;
speeds and accelerations are rough differences, so `v_Acc` is not read: `recordings.py` derives
accelerations from smoothed speeds.

Lane 1 is the leftmost. On US-101 lane 5 is the right main lane, 6 an auxiliary lane, 7 and 8 are
ramps. On I-80 lane 6 is the right main lane, 7 the ramp at Powell Street, 9 the shoulder. Only the
25 columns have the road, as `Location`. Without it lanes are read as on US-101. Streets are left
out: their lanes are numbered in another way in each direction and section.

Users: `drivers/recorded/importing.py`.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import (
    Samples,
    make_numbers,
    read_table,
    require_columns,
)
from sumo_eval.errors import InputError
from sumo_eval.input_file import input_file

FOOT = 0.3048  # m
US_101, I_80 = "us-101", "i-80"  # in the column `Location`, which also has streets
RIGHT_LANES = {US_101: 5, I_80: 6}  # number of the right main lane
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
    unknown = rows["right_lane"].isna()
    streets = ", ".join(sorted(set(rows.loc[unknown, "place"])))
    only = f"only lanes of {' and '.join(RIGHT_LANES)} are supported"
    if unknown.all():
        raise InputError(f"{path} must have lanes that are known, got {streets}: {only}.")
    rows = rows[~unknown].astype({"right_lane": np.int64})
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
            "lane": rows["right_lane"] - rows["Lane_ID"].astype(np.int64),
        }
    )
    # y = 0 is the median of y in the right lane, or, if a recording has none, in the nearest lane
    lanes_off = table["lane"].abs()
    nearest = table["y"].where(lanes_off == lanes_off.groupby(table["recording"]).transform("min"))
    table["y"] -= nearest.groupby(table["recording"]).transform("median")
    notes = [f"{path.name} has no headings: 0 is assumed."]
    for place, lane in rows.groupby("place")["right_lane"].first().items():
        notes.append(
            f"Lane {lane} of {place} is taken as the right lane (lane 0), lanes beyond it as "
            "auxiliary lanes and ramps."
        )
    if streets:
        notes.append(f"{unknown.sum()} samples of {streets} in {path.name} are left out: {only}.")
    if "Location" not in rows and (rows["Lane_ID"] == RIGHT_LANES[I_80]).any():
        notes.append(
            f"{path.name} names no road: US-101 is assumed. On I-80 its lane {RIGHT_LANES[I_80]} "
            "would be a main lane."
        )
    if not rows["v_Class"].isin(_CLASSES).all():
        notes.append(f"{path.name} has classes beyond 1 to 3: those are assumed to be cars.")
    if again.any():
        notes.append(
            f"{again.sum()} times {path.name} uses a vehicle id again; each use is a vehicle of "
            "its own."
        )
    return table, notes


def _rows(path: Path) -> pd.DataFrame:
    """The file's samples, sorted by place, vehicle and time, with columns `place` and
    `right_lane`, the number of the right main lane there, nan on a street.
    """
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
    make_numbers(rows, _NEEDED, path, heading=int(has_head_row))
    rows["place"] = path.stem
    rows["right_lane"] = RIGHT_LANES[US_101]
    if "Location" in rows:
        rows["place"] = rows["Location"].astype(str)
        rows["right_lane"] = rows["place"].str.lower().map(RIGHT_LANES)
    return rows.sort_values(["place", "Vehicle_ID", "Global_Time"], kind="stable")
