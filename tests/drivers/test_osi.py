"""OSI and omega-prime: traces, MCAP files and tables become recordings; what is left out is
counted."""

import gzip
import math
import struct

import numpy as np
import pandas as pd
import pytest
from refusals import refusal

from sumo_eval.drivers.recorded.importers import osi
from sumo_eval.drivers.recorded.importing import import_recordings

TURN = math.radians(30.0)  # of the road on the map
CAR, SEMITRAILER, ANIMAL = (2, 4), (2, 8), (4, 0)  # type and subtype


def varint(value):
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + varint(rest) if rest else bytes([low])


def field(number, value):
    """A field in the wire format: varint, double or length-delimited."""
    if isinstance(value, bytes):
        return varint(number << 3 | 2) + varint(len(value)) + value
    if isinstance(value, float):
        return varint(number << 3 | 1) + struct.pack("<d", value)
    return varint(number << 3) + varint(value)


def vector(*values):
    return b"".join(field(number, float(value)) for number, value in enumerate(values, 1))


def moving(name, s, d, speed, kind=CAR, length=4.6):
    x, y = s * math.cos(TURN) - d * math.sin(TURN), s * math.sin(TURN) + d * math.cos(TURN)
    base = (
        field(1, vector(length, 1.9, 1.5))
        + field(2, vector(x, y, 0.7))
        + field(3, vector(0.0, 0.0, TURN))
    )
    base += field(4, vector(speed * math.cos(TURN), speed * math.sin(TURN), 0.0))
    return (
        field(1, field(1, name)) + field(2, base) + field(3, kind[0]) + field(6, field(1, kind[1]))
    )


def ground_truths():
    """Two cars in two lanes, at 25 and 30 m/s, a semitrailer and a dog, 10 times a second from t =
    5 s to 13 s."""
    found = []
    for k in range(80):
        t = k / 10
        stamp = field(1, 5 + k // 10) + field(2, (k % 10) * 100_000_000)
        objects = [
            moving(3, 50.0 + 25.0 * t, 0.0, 25.0), moving(4, 20.0 + 30.0 * t, 3.5, 30.0),
            moving(5, 40.0 + 25.0 * t, 0.0, 25.0, SEMITRAILER), moving(6, 80.0, 9.0, 0.0, ANIMAL),
        ]  # fmt: skip
        found.append(field(2, stamp) + b"".join(field(5, one) for one in objects))
    return found


def trace(messages):
    return b"".join(struct.pack("<I", len(one)) + one for one in messages)


def is_the_scene(path):
    found = import_recordings("osi", [path])
    table = found.table
    assert set(table["vehicle"]) == {"3", "4"}
    assert set(table["class"]) == {"car"}
    fast, slow = (table[table["vehicle"] == name] for name in ("4", "3"))
    for rows, speed in ((slow, 25.0), (fast, 30.0)):
        assert rows["speed"].to_numpy() == pytest.approx(speed)
        assert np.diff(rows["x"]) == pytest.approx(speed * 0.1, abs=1e-3)
        assert rows["t"].iloc[0] == pytest.approx(5.0)
    assert np.allclose(fast["y"].to_numpy() - slow["y"].to_numpy(), 3.5, atol=0.01)
    assert slow["length"].iloc[0] == 4.6
    assert slow["width"].iloc[0] == 1.9
    (note,) = [note for note in found.notes if "left out" in note]
    assert "1 neither vehicle nor pedestrian, 1 pulled by another vehicle" in note


@pytest.mark.parametrize("packed", [False, True])
def test_a_trace_of_ground_truth_is_read_and_straightened(tmp_path, packed):
    path = tmp_path / ("drive_gt_3.7.0.osi" + (".gz" if packed else ""))
    content = trace(ground_truths())
    path.write_bytes(gzip.compress(content) if packed else content)
    is_the_scene(path)
    assert set(osi.read(path)[0]["recording"]) == {"drive_gt_3.7.0"}


def test_a_trace_of_sensor_views_is_read_by_its_name(tmp_path):
    path = tmp_path / "20260101T000000Z_sv_370.osi"
    path.write_bytes(trace([field(7, one) for one in ground_truths()]))
    is_the_scene(path)


def test_a_table_of_omega_prime_is_read(tmp_path):
    duckdb = pytest.importorskip("duckdb")
    rows = pd.DataFrame(
        [row for one in ground_truths() for row in osi._ground_truth(one)], columns=osi._COLUMNS
    )
    rows["total_nanos"] = (rows["t"] * 1e9).round().astype(np.int64)
    rows["vel_x"], rows["vel_y"] = rows["speed"] * np.cos(TURN), rows["speed"] * np.sin(TURN)
    rows = rows.rename(columns={"vehicle": "idx", "heading": "yaw"}).drop(columns=["t", "speed"])
    path = tmp_path / "drive.parquet"
    duckdb.from_df(rows).write_parquet(str(path))
    is_the_scene(path)
    ids = rows["idx"].to_numpy(np.uint64) + np.uint64(2**63)
    duckdb.from_df(rows.assign(idx=ids)).write_parquet(str(path))
    assert set(osi.read(path)[0]["vehicle"]) <= set(map(str, ids.tolist()))
    for column, name in (("type", "type"), ("total_nanos", "t"), ("idx", "vehicle")):
        duckdb.from_df(rows.assign(**{column: "text"})).write_parquet(str(path))
        with refusal(f"`{name}` in row 1 of .* must be a number"):
            osi.read(path)


def test_an_mcap_file_is_read(tmp_path):
    writer = pytest.importorskip("mcap.writer")
    path = tmp_path / "drive.mcap"
    with path.open("wb") as file:
        writing = writer.Writer(file)
        writing.start()
        schema = writing.register_schema("osi3.GroundTruth", "protobuf", b"")
        channel = writing.register_channel("ground_truth", "protobuf", schema)
        for number, message in enumerate(ground_truths()):
            writing.add_message(channel, log_time=number, data=message, publish_time=number)
        writing.finish()
    is_the_scene(path)


@pytest.mark.parametrize(
    "name, content, words",
    [
        ("a.osi", b"\x05\x00\x00\x00abc", "it ends within one"),
        ("a.osi", b"\x05\x00", "it ends within one"),
        ("a.osi", b"no trace at all", "below 268,435,456 bytes, got the length 1,948,282,734"),
        ("a.osi", trace([b"\xff\xff\xff"]), "Message 0 of .* is not a GroundTruth of OSI 3"),
        ("a.osi", b"", "must hold GroundTruth with moving objects, got none"),
        ("a.osi.gz", b"plain", "cannot be read"),
        ("a.csv", b"t,x\n", "must end in .osi"),
        ("a.parquet", b"no table", "is not a Parquet table"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_refused(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with refusal(words):
        import_recordings("osi", [tmp_path / name])
