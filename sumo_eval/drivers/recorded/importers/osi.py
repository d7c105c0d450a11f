"""ASAM Open Simulation Interface: `.osi` traces, MCAP files, and omega-prime's tables (`.parquet`).

A trace (`.osi`, also `.osi.gz`, `.osi.xz`) holds messages in order, each preceded by its length
(4 bytes, little-endian). They are GroundTruth, or SensorView (`_sv_` in the file's name), which
holds a GroundTruth. An MCAP file names the kind of each message. Time and moving objects of a
GroundTruth are read by their field numbers, which no release of OSI 3 may change. Positions are
centres, angles counter-clockwise from x, as here. MCAP needs the extra `osi`, tables the extra
`parquet`.

Users: `drivers/recorded/importing.py`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame, Series, to_numeric

from sumo_eval.drivers.recorded.importers.tables import (
    COMPRESSED,
    Samples,
    make_numbers,
    reading,
    require_columns,
)
from sumo_eval.errors import InputError, needs_extra
from sumo_eval.input_file import input_file

ENDINGS = (".osi", ".osi.gz", ".osi.xz", ".mcap", ".parquet")
VEHICLE, PEDESTRIAN = 2, 3  # MovingObject.Type
CLASSES = {
    2: "car", 3: "car", 4: "car", 5: "car", 6: "van", 7: "truck", 10: "motorcycle",
    11: "bicycle", 12: "bus", 16: "truck",
}  # fmt: skip
"""Classes by VehicleClassification.Type; of all others `other`. `_TOWED` are left out."""
_SENSOR_VIEW = "SensorView"
_TOWED = (8, 9)  # VehicleClassification.Type of what another vehicle pulls
# wire types of protocol buffers
_VARINT, _BYTES = 0, 2
_FIXED64, _FIXED32 = 1, 5
_TRACE_LIMIT = 1 << 28  # bytes of a message; a longer one is no message

Row = tuple[float, ...]  # as `_COLUMNS`
_COLUMNS = "t", "vehicle", "x", "y", "length", "width", "heading", "speed", "type", "subtype"


def read(path: Path) -> Samples:
    """The recordings of a file."""
    rows = _moving_objects(path)
    kinds = rows.groupby("vehicle")[["type", "subtype"]].first()
    bodies = rows.groupby("vehicle")[["length", "width"]].median()
    reasons = _why_left_out(kinds, bodies)
    counts = reasons[reasons != ""].value_counts().sort_index()
    left_out = ", ".join(f"{number} {reason}" for reason, number in counts.items())
    notes = [f"{path.name}: moving objects left out: {left_out}."] if left_out else []
    rows = rows[rows["vehicle"].isin(reasons.index[reasons == ""])]
    if rows.empty:  # all were left out, so there is a note
        raise InputError(
            f"{path} must hold vehicles or pedestrians with a body, got none: {notes[-1]}"
        )
    rows = rows.sort_values(["vehicle", "t"], kind="stable")
    classes = kinds["subtype"].map(CLASSES).fillna("other")
    bodies["class"] = classes.where(kinds["type"] != PEDESTRIAN, "pedestrian")
    rows = rows[["t", "vehicle", "x", "y", "heading", "speed"]].join(bodies, on="vehicle")
    ending = next(it for it in ENDINGS if path.name.endswith(it))
    rows["recording"] = path.name.removesuffix(ending)
    return rows.astype({"vehicle": str}), notes


def _moving_objects(path: Path) -> DataFrame:
    """Every moving object at every instant, with finite numbers: a table of `_COLUMNS`."""
    if not path.name.endswith(ENDINGS):
        raise InputError(f"{path} must end in {', '.join(ENDINGS)}.")
    input_file(path, "file")
    is_table = path.suffix == ".parquet"
    rows = _omega_prime(path) if is_table else DataFrame(_objects(path), columns=_COLUMNS)
    if rows.empty:
        raise InputError(f"{path} must hold GroundTruth with moving objects, got none.")
    numbers = [name for name in _COLUMNS if name not in ("vehicle", "type", "subtype")]
    make_numbers(rows, numbers, path, rows=range(1, len(rows) + 1))
    return rows


def _why_left_out(kinds: DataFrame, bodies: DataFrame) -> Series[str]:
    """Reason to leave out each object; empty keeps it.

    kinds: type and subtype; bodies: length and width, m; a row each.
    """
    reasons = {
        "neither vehicle nor pedestrian": ~kinds["type"].isin((VEHICLE, PEDESTRIAN)),
        "pulled by another vehicle": (kinds["type"] == VEHICLE) & kinds["subtype"].isin(_TOWED),
        "without a body": ~(bodies > 0.0).all(axis=1),
    }
    return Series(np.select(list(reasons.values()), list(reasons), ""), index=kinds.index)


# --- files of messages ----------------------------------------------------------------------------


def _objects(path: Path) -> Iterator[Row]:
    """Every moving object of every GroundTruth of a file."""
    messages = _mcap(path) if path.suffix == ".mcap" else _trace(path)
    with reading(path):
        for number, (kind, message) in enumerate(messages):
            try:
                if kind == _SENSOR_VIEW:
                    # field 7: global_ground_truth
                    message = dict(_fields(message)).get(7, b"")
                yield from _ground_truth(message)
            except (IndexError, KeyError, struct.error, ValueError, TypeError) as error:
                raise InputError(f"Message {number} of {path} is not a {kind} of OSI 3.") from error


def _trace(path: Path) -> Iterator[tuple[str, bytes]]:
    """The messages of a trace.

    What they are is in the file's name, as OSI asks: `_sv_` or `_gt_`.
    """
    opened = COMPRESSED.get(path.suffix, open)
    kind = _SENSOR_VIEW if "_sv_" in path.name else "GroundTruth"
    with opened(path, "rb") as file:
        while header := file.read(4):
            # a length that is cut off fails below, as a message that is cut off
            size = struct.unpack("<I", header)[0] if len(header) == 4 else 1
            if size >= _TRACE_LIMIT:
                raise InputError(
                    f"{path} must be a trace of OSI, each message after its length below "
                    f"{_TRACE_LIMIT:,} bytes, got the length {size:,}."
                )
            message = file.read(size)
            if len(message) < size:
                raise InputError(
                    f"{path} must be a trace of OSI, each message after its length; it ends "
                    "within one."
                )
            yield kind, message


def _mcap(path: Path) -> Iterator[tuple[str, bytes]]:
    """The messages of an MCAP file that are GroundTruth or SensorView."""
    try:
        reader = import_module("mcap.reader")
        mcap_error = import_module("mcap.exceptions").McapError
    except ImportError:
        raise needs_extra(f"{path} is an MCAP file, which", "osi") from None
    with path.open("rb") as file:
        try:
            for schema, _, message in reader.make_reader(file).iter_messages(log_time_order=False):
                kind = "" if schema is None else schema.name.rpartition(".")[2]
                if kind in ("GroundTruth", _SENSOR_VIEW):
                    yield kind, message.data
        except (mcap_error, ValueError, struct.error) as error:
            raise InputError(f"{path} is damaged or not an MCAP file: {error}.") from error


def _ground_truth(message: bytes) -> Iterator[Row]:
    """The moving objects of a GroundTruth: field 2 is timestamp, field 5 moving_object."""
    fields = list(_fields(message))
    stamp = dict(_fields(dict(fields).get(2, b"")))  # 1: s, 2: ns
    time = stamp.get(1, 0) + 1e-9 * stamp.get(2, 0)
    yield from (_moving_object(time, value) for number, value in fields if number == 5)


def _moving_object(time: float, message: bytes) -> Row:
    """A MovingObject: 1 id, 2 base, 3 type, 6 vehicle_classification.

    A base: 1 dimension, 2 position, 3 orientation, 4 velocity.
    """
    fields = dict(_fields(message))
    base = dict(_fields(fields[2]))
    length, width, _ = _numbers(base.get(1, b""))
    x, y, _ = _numbers(base[2])
    *_, yaw = _numbers(base.get(3, b""))
    vx, vy, _ = _numbers(base.get(4, b""))
    # id and vehicle_classification have their value in field 1
    vehicle, subtype = (int(dict(_fields(fields.get(it, b""))).get(1, 0)) for it in (1, 6))
    speed = math.sqrt(vx * vx + vy * vy)
    return time, vehicle, x, y, length, width, yaw, speed, int(fields.get(3, 0)), subtype


def _numbers(message: bytes) -> list[float]:
    """The first three fields of a message of doubles, 0 where one is not there."""
    fields = dict(_fields(message))
    return [struct.unpack("<d", fields.get(number, bytes(8)))[0] for number in (1, 2, 3)]


def _fields(message: bytes) -> Iterator[tuple[int, Any]]:
    """Number and value of each field of a message in the wire format of protocol buffers. In a
    `dict` of them the last of a repeated field counts.
    """
    at = 0
    end = len(message)
    while at < end:
        key, at = _varint(message, at)
        kind = key & 7
        if kind == _VARINT:
            value, at = _varint(message, at)
            yield key >> 3, value
            continue
        size = {_FIXED64: 8, _FIXED32: 4}.get(kind, -1)
        if kind == _BYTES:
            size, at = _varint(message, at)
        if size < 0 or at + size > end:
            raise ValueError(f"a field of kind {kind} does not end within its message")
        yield key >> 3, message[at : at + size]
        at += size


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """A number of variable length, and where the next thing begins."""
    value = shift = 0
    while True:
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7


# --- tables ---------------------------------------------------------------------------------------


def _omega_prime(path: Path) -> DataFrame:
    """The moving objects of an omega-prime recording kept as a table."""
    try:
        duckdb: Any = import_module("duckdb")
    except ImportError:
        raise needs_extra(f"{path} is a Parquet table, which", "parquet") from None
    wanted = (
        "total_nanos", "idx", "x", "y", "length", "width", "type", "subtype", "yaw", "vel_x",
        "vel_y",
    )  # fmt: skip
    try:
        with duckdb.connect() as database:
            rows: DataFrame = database.read_parquet(str(path)).df()
    except duckdb.Error as error:
        raise InputError(f"{path} is not a Parquet table: {str(error).splitlines()[0]}.") from error
    require_columns(rows, wanted, path)
    rows = rows[list(wanted)].rename(columns={"idx": "vehicle", "yaw": "heading"})
    clock = rows[["total_nanos", "vel_x", "vel_y"]].apply(to_numeric, errors="coerce")
    rows["t"], rows["speed"] = clock["total_nanos"] * 1e-9, np.hypot(clock["vel_x"], clock["vel_y"])
    rows = rows.fillna({"type": 0, "subtype": 0})
    # columns of integers need no check, and a 64-bit id does not fit into the check's doubles
    not_integer = [it for it in ("vehicle", "type", "subtype") if rows[it].dtype.kind not in "iu"]
    make_numbers(rows, not_integer, path, rows=range(1, len(rows) + 1))
    return rows.astype(dict.fromkeys(not_integer, int))[list(_COLUMNS)]
