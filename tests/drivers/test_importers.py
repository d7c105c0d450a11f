"""Importers: the traps of each format, on real samples and on rows worked by hand."""

import bz2
import gzip
import lzma
import shutil

import numpy as np
import pandas as pd
import pytest
from commands import cli_refuses, sumo_eval
from drivers.real_data import needs_recordings, recording
from laid import replace_in
from refusals import refusal
from tables import rows_of

from sumo_eval.drivers.recorded.events import extract_events
from sumo_eval.drivers.recorded.importers import commonroad, highd, levelx, ngsim, openacc, sumo_fcd
from sumo_eval.drivers.recorded.importing import FORMATS, each_of, import_recordings
from sumo_eval.drivers.recorded.recordings import COLUMNS, canonical, read_csv, write_csv
from sumo_eval.scenario.concrete import smooth_step

FCD = "timestep_time;vehicle_angle;vehicle_id;vehicle_speed;vehicle_x;vehicle_y\n"
OWN = "recording,vehicle,t,x,y,length,width\n"
NO_ANGLE = (
    "<fcd-export><timestep time='0'><vehicle id='a' x='1' y='2' speed='3'/></timestep></fcd-export>"
)


def plain_table():
    """Two cars on the same road in this project's own layout."""
    time = np.round(np.arange(0.0, 3.0, 0.1), 3)
    about = {"recording": "r", "y": 0.1, "length": 4.5, "width": 1.8}
    cars = (pd.DataFrame({"vehicle": name, "t": time, "x": x0 + 20.0 * time}).assign(**about)
            for name, x0 in (("a", 0.0), ("b", 50.0)))  # fmt: skip
    return pd.concat(cars)[OWN.strip().split(",")]


def plain_file(path):
    """A file of that table."""
    plain_table().to_csv(path, index=False)
    return path


def imported(folder, table):
    """What is imported of a table in this project's own layout."""
    table.to_csv(folder / "table.csv", index=False)
    return import_recordings("csv", [folder / "table.csv"])


@needs_recordings
def test_highd_width_is_the_length_y_points_down_and_the_corner_is_the_upper_left_one(tmp_path):
    (file,) = recording("samples", "highd_layout").glob("*_tracks.csv")
    found = dict(list(highd.read(file)[0].groupby("recording")))
    raw = pd.read_csv(recording("samples", "highd_layout", "01_tracks.csv"))
    # frame 10, x -5.227, y 24.902, width 4.44, height 1.892; drives to the right
    first = raw[raw["id"] == 1].iloc[0]
    row = found["01-lower"][found["01-lower"]["vehicle"] == "1"].iloc[0]
    assert row["length"] == pytest.approx(4.44)
    assert row["width"] == pytest.approx(1.892)
    assert row["t"] == pytest.approx(10 / 25)
    assert row["x"] == pytest.approx(-5.227 + 4.44 / 2)
    # Lanes 22 .. 25.75 .. 29.5 (down): the right lane's centre is 27.625; the vehicle's is 24.902 +
    # 0.946 = 25.848.
    assert row["y"] == pytest.approx(27.625 - 25.848)
    assert row["speed"] == pytest.approx(np.hypot(first["xVelocity"], first["yVelocity"]))
    # A positive image yVelocity is a move to the right, so the heading is negative.
    assert row["heading"] < 0 < first["yVelocity"]
    upper = found["01-upper"]
    # they drive forwards too
    assert upper.groupby("vehicle")["x"].agg(lambda x: x.iloc[-1] - x.iloc[0]).min() > 0
    for table in found.values():
        slow, fast = (table.loc[table["lane"] == lane, "speed"].median() for lane in (0, 1))
        assert slow < fast  # the right lane is the slow one
        assert abs(table.loc[table["lane"] == 0, "y"].median()) < 0.3
    shutil.copytree(file.parent, tmp_path / "copy")
    (meta,) = (tmp_path / "copy").glob("*_tracksMeta.csv")
    pd.read_csv(meta).assign(drivingDirection=3).to_csv(meta)
    with refusal("`drivingDirection` of 1 or 2"):
        highd.read(meta.with_name(file.name))


@needs_recordings
def test_ngsim_feet_front_centre_and_lanes_from_the_left(tmp_path):
    path = recording("samples", "ngsim_layout_i80_pairs.csv")
    table, raw = ngsim.read(path)[0], pd.read_csv(path)
    raw.to_csv(tmp_path / path.name)  # with a column of row numbers
    assert ngsim.read(tmp_path / path.name)[0].equals(table)
    # Local_X 6.627 ft, Local_Y 77.133 ft, v_length 16.798 ft, lane 1
    first = raw[raw["Vehicle_ID"] == 101].iloc[0]
    row = table[table["vehicle"] == "101"].iloc[0]
    assert row["x"] == pytest.approx(0.3048 * (77.133 - 16.798 / 2))
    assert row["speed"] == pytest.approx(0.3048 * first["v_Vel"])
    assert row["length"] == pytest.approx(0.3048 * 16.798)
    assert row["lane"] == 6 - first["Lane_ID"]
    left, right = (raw.loc[raw["Lane_ID"] == lane, "Local_X"].median() for lane in (1, 2))
    assert left < right  # Local_X grows to the right, y to the left
    assert table.loc[table["lane"] == 5, "y"].median() > table.loc[table["lane"] == 4, "y"].median()
    other = raw.assign(Location="us-101", Local_X=raw["Local_X"] + 30.0)
    pd.concat([raw, other]).to_csv(tmp_path / "both.csv", index=False)
    aside = ngsim.read(tmp_path / "both.csv")[0].groupby("recording")["y"].median()
    assert aside["us-101"] == pytest.approx(aside["i-80"])  # each from its own right lane


@pytest.mark.parametrize(
    "location, lanes, words",
    [
        (",i-80", [5, 1, 0, -1], "Lane 6 of i-80 is taken as the right lane"),
        (",us-101", [4, 0, -1, -2], "Lane 5 of us-101 is taken as the right lane"),
        ("", [4, 0, -1, -2], "x.csv names no road: US-101 is assumed. On I-80 its lane 6 would"),
    ],
)
def test_ngsim_lanes_of_each_road(tmp_path, location, lanes, words):
    """Its lanes 1, 5, 6 and 7: on I-80 lane 6 is the right main lane, on US-101 an auxiliary lane."""
    head = ",".join(ngsim._NEEDED) + ",Location" * bool(location)
    rows = [f"{lane},1,0,{12 * lane - 6},100,15,6,2,40,{lane}{location}" for lane in (1, 5, 6, 7)]
    (tmp_path / "x.csv").write_text("\n".join([head, *rows]))
    table, notes = ngsim.read(tmp_path / "x.csv")
    assert table["lane"].tolist() == lanes
    assert table.loc[table["lane"] == 0, "y"].tolist() == [0.0]
    assert words in " ".join(notes)
    assert any("names no road" in note for note in notes) == (not location)


def test_ngsim_streets_are_left_out_by_name(tmp_path):
    head = ",".join(ngsim._NEEDED) + ",Location"
    rows = [f"{place},1,0,6,100,15,6,2,40,1,{name}" for place, name in
            ((1, "us-101"), (2, "peachtree"), (3, "lankershim"))]  # fmt: skip
    (tmp_path / "x.csv").write_text("\n".join([head, *rows]))
    table, notes = ngsim.read(tmp_path / "x.csv")
    assert table["recording"].tolist() == ["us-101"]
    assert any(note.startswith("2 samples of lankershim, peachtree in x.csv") for note in notes)
    (tmp_path / "x.csv").write_text("\n".join([head, rows[1]]))
    with refusal("got peachtree: only lanes of us-101 and i-80 are supported"):
        ngsim.read(tmp_path / "x.csv")


def test_ngsim_original_layout_and_a_vehicle_id_that_is_used_again(tmp_path):
    rows = [
        [7, frame, 20, 1118846980000 + 100 * frame, 18.0, 100.0 + 4.0 * frame, 0, 0, length, 6, 2,
            40, 0, 2, 0, 0, 0, 0]
        for length, frames in ((15.0, range(10)), (20.0, range(500, 510)))
        for frame in frames
    ]  # fmt: skip
    path = tmp_path / "trajectories.txt"
    path.write_text("\n".join("  ".join(str(value) for value in row) for row in rows) + "\n")
    found = import_recordings("ngsim", [path])
    assert sorted(found.table["vehicle"].unique()) == ["7", "7/2"]
    assert any("uses a vehicle id again" in note for note in found.notes)
    assert found.table.groupby("vehicle")["length"].first().tolist() == pytest.approx(
        [15 * 0.3048, 20 * 0.3048]
    )


@needs_recordings
def test_sumo_front_bumper_clockwise_from_north_and_both_layouts_alike():
    xml = sumo_fcd.read(recording("samples", "sumo_1.28_fcd_all_attributes.xml"))[0]
    csv = sumo_fcd.read(recording("samples", "sumo_1.28_fcd.csv"))[0]
    row = xml[(xml["vehicle"] == "lead") & (xml["t"] == 0.0)].iloc[0]
    # x 130.00, y -5.62, angle 90 deg (east); a truck is 7.1 m long.
    assert row["heading"] == pytest.approx(0.0)
    assert row["x"] == pytest.approx(130.0 - 7.1 / 2)
    assert row["y"] == pytest.approx(-5.62)
    for column in ("x", "y", "heading", "speed"):
        assert csv[column].to_numpy() == pytest.approx(xml[column].to_numpy())


@needs_recordings
def test_commonroad_obstacles_are_straightened_with_the_lanes_of_the_map():
    path = recording("samples", "commonroad_USA_US101-11_1_T-1.xml")
    raw, _ = commonroad.read(path)
    assert "lane" not in raw
    assert raw["vehicle"].nunique() == 32
    # map and traffic of this file are up to a metre apart, not a lane
    assert raw["offset"].abs().median() < 1.0
    table = import_recordings("commonroad", [path]).table
    assert table["vehicle"].nunique() >= 26
    assert (table.groupby("vehicle")["x"].agg(lambda x: x.iloc[-1] - x.iloc[0]) > 0).all()
    assert table["heading"].abs().max() < 0.35


@needs_recordings
def test_openacc_gaps_to_the_lead_are_kept():
    path = recording("samples", "openacc_zalazone_noACC_part40_head.csv")
    table = openacc.read(path)[0]
    raw = pd.read_csv(path, skiprows=5)
    chain = table[table["recording"].str.endswith("-1")]
    third, fourth = (
        chain[chain["vehicle"].str.startswith(f"{place}-")].set_index("t") for place in (3, 4)
    )
    both = third.index.intersection(fourth.index)
    gap = third.loc[both, "x"] - fourth.loc[both, "x"] - 4.5
    known = raw["IVS3"].set_axis(raw["Time"] - raw["Time"].iloc[0]).dropna()
    shared = both.intersection(known.index)
    assert len(shared) > 300
    assert gap[shared].to_numpy() == pytest.approx(known[shared].to_numpy(), abs=1e-6)


def _levelx(folder):
    """Six cars on two lanes of 3.6 m that follow a curve of 200 m radius, in the levelX layout."""
    tracks, frames = [], np.arange(250)
    for number in range(6):
        lane, speed = number % 2, 20.0 + 5.0 * (number % 2)
        radius = 200.0 - 3.6 * lane  # the left lane is the inner one of a left-hand curve
        angle = speed * frames / 25.0 / radius
        track = {
            "recordingId": 0,
            "trackId": number,
            "frame": 25 * number + frames,
            "xCenter": radius * np.sin(angle),
            "yCenter": -radius * np.cos(angle),
            "heading": np.degrees(angle) % 360.0,
            "width": 1.8,
            "length": 4.5,
            "xVelocity": speed * np.cos(angle),
            "yVelocity": speed * np.sin(angle),
            "lonAcceleration": 0.0,
        }
        tracks.append(pd.DataFrame(track))
    about = {"recordingId": 0, "trackId": range(6), "class": "car"}
    for name, table in (
        ("tracks", pd.concat(tracks)),
        ("tracksMeta", pd.DataFrame(about)),
        ("recordingMeta", pd.DataFrame({"recordingId": [0], "frameRate": 25.0})),
    ):
        table.to_csv(folder / f"07_{name}.csv", index=False)
    return folder / "07_tracks.csv"


def test_levelx_a_curved_road_becomes_a_straight_one(tmp_path):
    path = _levelx(tmp_path)
    assert "lane" not in levelx.read(path)[0]
    table = import_recordings("exid", [path]).table
    assert table["recording"].nunique() == 1
    assert sorted(table["lane"].unique()) == [0, 1]
    for lane, vehicles in table.groupby("lane"):
        assert vehicles["y"].to_numpy() == pytest.approx(3.6 * lane, abs=0.15)
    assert table["heading"].abs().max() < 0.03
    right = table[table["lane"] == 0].groupby("vehicle").agg(x=("x", np.ptp), t=("t", np.ptp))
    assert (right["x"] / right["t"]).to_numpy() == pytest.approx(20.0, rel=0.03)


def test_a_refusal_names_the_file_and_what_was_left_out_of_it(tmp_path):
    path = _levelx(tmp_path)
    pd.read_csv(path).assign(length=0.0).to_csv(path, index=False)  # people on foot
    with refusal(r"07_tracks.csv: At least one vehicle must move .* 6 road users without a box"):
        import_recordings("ind", [tmp_path])


def test_levelx_facts_that_cannot_be_used_are_refused(tmp_path):
    path = _levelx(tmp_path)
    for name, fault, sentence in (
        ("tracksMeta", lambda table: pd.concat([table, table]), "must name each trackId once"),
        ("recordingMeta", lambda table: table.assign(frameRate=0), "`frameRate` above 0"),
    ):
        file = path.with_name(f"07_{name}.csv")
        text = file.read_text()
        fault(pd.read_csv(file)).to_csv(file, index=False)
        with refusal(sentence):
            levelx.read(path)
        file.write_text(text)


def test_the_own_table_comes_back_as_it_was_written(tmp_path):
    first = import_recordings("csv", [plain_file(tmp_path / "plain.csv")])
    write_csv(first, tmp_path / "again.csv.gz")
    assert (tmp_path / "again.csv.gz").stat().st_mode == (tmp_path / "plain.csv").stat().st_mode
    again = read_csv(tmp_path / "again.csv.gz")
    assert list(again.table.columns) == list(COLUMNS)
    assert again.table["speed"].to_numpy() == pytest.approx(20.0)
    for column in ("t", "x", "y", "lane", "length"):
        assert again.table[column].to_numpy() == pytest.approx(first.table[column].to_numpy())


def test_a_hole_in_a_track_makes_two_tracks_and_is_said(tmp_path):
    table = plain_table()
    hole = (table["vehicle"] == "b") | (table["t"] < 1.0) | (table["t"] > 1.95)
    found = imported(tmp_path, table[hole].assign(drivers="x"))
    assert sorted(found.table["vehicle"].unique()) == ["a", "a#2", "b"]
    assert any("1 holes" in note for note in found.notes)
    assert found.notes[0].endswith("Did you mean `driver`?")
    named = imported(tmp_path, table[hole].replace({"vehicle": {"b": "a#2"}})).table
    assert named.groupby("vehicle").size().to_dict() == {"a": 10, "a##2": 10, "a#2": 30}
    jumps = table.assign(x=table["x"] + 40.0 * ((table["vehicle"] == "a") & (table["t"] > 1.0)))
    found = imported(tmp_path, jumps)
    assert found.notes[0].startswith("1 jumps in tracks, as of an id that is used again")
    assert found.table.groupby("vehicle").size().to_dict() == {"a": 11, "a#2": 19, "b": 30}
    assert found.table["speed"].to_numpy() == pytest.approx(20.0)
    slow = table[table["vehicle"] == "a"].assign(t=lambda rows: np.round(5.0 * rows["t"] + 0.1, 3))
    assert imported(tmp_path, slow).vehicles == 1, "2 Hz have no holes"


def test_noise_of_positions_is_no_wrong_heading(tmp_path):
    """1.2 m from sample to sample, across steps of 2 m."""
    table = plain_table()
    table["y"] += np.resize([0.6, -0.6], len(table))
    assert imported(tmp_path, table).table["heading"].abs().median() < 1e-6


def test_events_report_what_no_event_can_have(tmp_path):
    table = plain_table().assign(**{"class": "Car "})
    odd = table[table["vehicle"] == "a"].assign(vehicle="c", **{"class": "tank"})
    back = table[table["vehicle"] == "a"].assign(vehicle="d", x=-20.0 * odd["t"])
    pd.concat([table, table[:3], odd, back]).to_csv(tmp_path / "odd.csv", index=False)
    said = sumo_eval(f"humans events {tmp_path}/odd.csv").said
    assert "3 samples with a time that their vehicle already had were left out." in said
    assert "1 vehicles that go back more than 10 m along x are left out" in said
    assert (
        "1 vehicles have the class `tank`, which is not known: they are in no event. Known: "
        in said
    )
    assert " bicycle, bus, car, " in said
    assert "0 of 2 motor vehicles" in said


PLATOON = "\ufeffVehicle_order,a\nACC,0\n,\n,\n,\nTime,Speed1,SpeedLimit\n"
NGSIM = ",".join((*ngsim._ORIGINAL, "Location")) + "\n"


@pytest.mark.parametrize(
    "form, name, text, words",
    [
        *rows_of(r"""
csv | x.csv | OWNr,a,0,1,2,4,2\n\n \nr,a,0.1,oops,2,4,2\n | `x` in row 5 of
csv | x.csv | OWNr,a,0,1,2,0,2\nr,a,0.1,2,2,0,2\n | must be above 0 m, got '0 and
csv | x.csv | OWNr,a,0,1,2,15,6\nr,a,0.1,2,2,15,6\n
| The median `width` of recording `r` must be in m, across the vehicle, got 6
csv | x.csv | OWNr,a,0,0,2,4,2\nr,a,0.1,9,2,4,2\n
| `x` and `y` of recording `r` must be in m, got 90 m/s as the median speed that x, y and t show
csv | x.csv | OWNr,a,0,1e300,2,4,2\nr,a,0.1,2,2,4,2\n
| must be at most 9.0072e+15 in size, got 1e+300
csv | x.csv | recording,vehicle,t,x,y,length,width,speed\nr,a,0,1,2,4,2,36\nr,a,1,11,2,4,2,36\n
| `speed` of recording `r` must be in m/s, got 3.6 times the speed that x, y and t show
csv | x.csv | recording,vehicle,t,x,y,length,width,speed\nr,a,0,1,2,4,2,-9\nr,a,1,10,2,4,2,-9\n
| must be in m/s, got -1 times the speed
csv | x.csv | recording,vehicle,t,x,y,length,width,heading\nr,a,0,1,2,4,2,90\nr,a,1,9,2,4,2,90\n
| `heading` of recording `r` must be in rad, counter-clockwise from x, got 2.04 rad off the course
csv | x.csv | recording,vehicle,t,x,y,length,width,lane\nr,a,0,1,2,4,2,0\nr,b,1,9,-2,4,2,1\n
| must grow to the left, as y does, got lane 1 to the right of the one before
csv | x.csv | OWNr,a,0,0,5,0,4,2\n | a row has more cells than the heading. Commas separate cells
csv | x.csv | OWNr,a,0,0,0,4,2\nr,a,1000,9,0,4,2\n | at most 0.5 s apart, got none: 1 holes
csv | x.csv | recording,vehicle,t,x,y,length,width,lane\nr,a,0,1,2,4,2,1.5\n
| `lane` in row 2 of
csv | x.csv | recording,vehicle,time,x,y,length,width\nr,a,0,1,2,4,2\n | must have a column `t`
csv | x.csv | vehicle;t\na;0\n
| must have the columns `recording`, `vehicle`, `t`, `x`, `y`, `length`, `width`, got one, 'vehicle;t'. Commas separate
csv | x.csv | OWNr,a,0,0,0,4,2\nr,a,100,2,0,4,2\n | Samples of a vehicle are 100 s apart
map | x.csv | vehicle,t,x,y\na,0,0,0\na,.1,.002,0\n | none is further than 0.002 m from where it was
csv | x.csv | vehicel,time\na,0\n
| must have the columns `recording`, `vehicle`, `t`, `x`, `y`, `length`, `width`. Known: vehicel, time
csv | x.csv | recording,vehicle,t,x,y,length,width,x\n | must have every column once, got `x` twice
csv | x.csv | OWNr,a,0,true,2,4,2\n | `x` in row 2 of
csv | x.csv | recording,vehicle,t,x,y,length,width,steering\nr,a,0,1,2,4,2,\nr,a,1,1,2,4,2,left\n
| `steering` in row 3 of
map | x.csv | vehicle,t,x,y\na,0,0,0\na,1,1e15,0\n | at most 1e+06 m long
ngsim | x.txt | 1 2 3\n | `Global_Time` in row 1 of
highd | 01_tracks.csv | frame,id,x\n1,1,1\n | must have the columns `y`, `width`, `height`
commonroad | x.xml | <commonRoad timeStepSize='0.1'>\n<dynamic | is not well-formed XML
commonroad | x.xml | <commonRoad timeStepSize='nan'/> | must be a number, got 'nan'
commonroad | x.xml | <commonRoad timeStepSize='0'/> | must have a `timeStepSize` above 0 s
sumo_fcd | x.csv | FCD0;;;;;\n1;90;a;oops;2;3\n | `speed` in row 3 of
sumo_fcd | x.xml.gz | <fcd-export/> | cannot be read: Not a gzipped file
openacc | x.csv | a,b\n1,2\n | must begin with the five rows
dlr_highway | x.csv | timestamp,id\n1,2\n | must have the columns `center_easting`
"""),
        ("sumo_fcd", "x.csv", FCD[:-1] + ";vehicle_posLat\n1;90;a;3;2;3;inf\n",
            "`posLat` in row 2 of"),
        ("openacc", "x.csv", PLATOON + "0,10,\n0.1,\"1,5\",\n", "`Speed1` in row 8 of"),
        ("sumo_fcd", "x.xml", NO_ANGLE, "must have `angle`"),
        ("sumo_fcd", "x.csv", FCD + "0;;;;;\n", "at least one vehicle (<fcd-export>), got none"),
        ("commonroad", "y.xml", "<commonRoad/>", "must be a number, got nothing"),
        ("sumo_fcd", "x.csv", FCD.replace(";", ","), "'. Semicolons separate cells"),
        ("sumo_fcd", "x.csv", FCD + "0;90;a;20;9.9;52\n.1;90;a;20;9.90003;52\n",
            "must have `x` and `y` in m, got degrees: run SUMO without `--fcd-output.geo`"),
        ("sumo_fcd", "x.csv", FCD + "0;90;a;20;0;2\n1;90;a;20;20;2\n",
            "at most 0.5 s apart, got 1 s: run SUMO with `--step-length 0.1`"),
        ("ngsim", "x.csv", NGSIM + "1," * 18 + "\n", "`Location` in row 2 of"),
        ("ngsim", "x.csv", NGSIM + "1," * 30 + "\n", "is not such a table"),
        ("openacc", "x.csv", 'a,"' + "b" * 200_000, "field larger than field limit"),
        ("hihgD", "x.csv", "", "Did you mean `highd`?"),
    ],
)  # fmt: skip
def test_a_damaged_file_gets_one_sentence_and_nothing_half_imported_stays(
    tmp_path, form, name, text, words
):
    (tmp_path / name).write_text(text.replace("OWN", OWN).replace("FCD", FCD))
    out = tmp_path / "out" / "table.csv"
    cli_refuses(words, "humans", "import", form, tmp_path / name, "--out", out)
    assert not out.exists()
    assert not list(tmp_path.rglob("*.part*"))
    assert not out.parent.exists() or not list(out.parent.iterdir())


def test_a_table_in_another_encoding_is_refused_with_the_remedy(tmp_path):
    (tmp_path / "x.csv").write_bytes("vehicle,t,x,y\n\u8f66,0,0,0\n".encode("gbk"))
    arguments = "map", tmp_path / "x.csv", "--out", tmp_path / "y.csv"
    cli_refuses("invalid start byte. Save it as UTF-8.", "humans", "import", *arguments)


def test_the_first_time_has_no_sign(tmp_path):
    out = tmp_path / "out.csv"
    write_csv(import_recordings("map", [plain_file(tmp_path / "a.csv")]), out)
    assert pd.read_csv(out, dtype=str)["t"][0] == "0.0"


@pytest.mark.parametrize("form", ["csv", "map"])
def test_identifiers_are_text_whatever_it_is(tmp_path, form):
    text = plain_file(tmp_path / "plain.csv").read_text()
    (tmp_path / "digits.csv").write_text(text.replace("r,a,", "01,NA,").replace("r,b,", "01,07,"))
    table = import_recordings(form, [tmp_path / "digits.csv"]).table
    assert set(table["vehicle"]) == {"NA", "07"}
    assert set(table["recording"]) == {"01" if form == "csv" else "01-1"}
    (tmp_path / "empty.csv").write_text(text.replace("r,b,", "r,,"))
    with refusal(r"`vehicle` in row 32 of .* must be a name, got nothing"):
        import_recordings(form, [tmp_path / "empty.csv"])


@pytest.mark.parametrize("form", ["csv", "map"])
def test_names_of_drivers_are_text_too_and_may_be_missing(tmp_path, form):
    for names in (["01", "1"], ["7", ""]):
        table = plain_table()
        table["driver"] = np.repeat(names, len(table) // 2)
        table.to_csv(tmp_path / "named.csv", index=False)
        found = import_recordings(form, [tmp_path / "named.csv"]).table
        assert found.groupby("vehicle")["driver"].unique().map(list).tolist() == [
            [names[0]],
            [names[1]],
        ]


def test_sumo_keeps_every_id_beside_a_step_without_vehicles(tmp_path):
    (tmp_path / "a.csv").write_text(FCD + "0;;;;;\n1;90;01;3;2;3\n1;90;1;3;9;3\n1;90;NA;3;5;3\n")
    assert sumo_fcd.read(tmp_path / "a.csv")[0]["vehicle"].tolist() == ["01", "1", "NA"]
    typed = FCD.strip() + ";vehicle_type\n1;90;a;3;2;3;DEFAULT_BIKETYPE\n"
    (tmp_path / "b.csv").write_text(typed)
    bicycle = sumo_fcd.read(tmp_path / "b.csv")[0].iloc[0]
    assert bicycle["class"] == "bicycle"
    assert bicycle["length"] == 1.6


@pytest.mark.parametrize("packed", [gzip, bz2, lzma])
def test_a_fault_of_a_compressed_table_has_its_row(tmp_path, packed):
    ending = {gzip: "gz", bz2: "bz2", lzma: "xz"}[packed]
    path = tmp_path / f"x.csv.{ending}"
    path.write_bytes(packed.compress(f"{OWN}r,a,0,1,2,4,2\n\nr,a,0.1,oops,2,4,2\n".encode()))
    with refusal("`x` in row 4 of"):
        read_csv(path)


@pytest.mark.parametrize("name", ["x.csv", "x.xml", "x.xml.gz"])
def test_sumo_leaves_persons_out_with_a_note(tmp_path, name):
    """SUMO's own table has persons as vehicles of an edge and without a lane."""
    pose = "x='1' y='2' speed='3' angle='90'"
    text = {
        "x.csv": FCD[:-1] + ";vehicle_lane;vehicle_edge\n0;90;a;3;1;2;e_0;\n0;90;p;3;1;2;;e\n",
        "x.xml": f"<fcd-export><timestep time='0'><vehicle id='a' {pose} lane='e_0'/>"
        f"<person id='p' {pose} edge='e'/></timestep></fcd-export>",
    }
    packed = gzip.compress if name.endswith(".gz") else bytes
    (tmp_path / name).write_bytes(packed(text[name.removesuffix(".gz")].encode()))
    table, notes = sumo_fcd.read(tmp_path / name)
    assert table["vehicle"].tolist() == ["a"]
    assert table["recording"].tolist() == ["x"]
    assert notes[1] == f"Persons and containers of {name} are left out: 1."


def test_openacc_reads_a_marked_file_with_other_speeds(tmp_path):
    (tmp_path / "a.csv").write_text(PLATOON + "0,10,30\n0.1,10,30\n")
    assert openacc.read(tmp_path / "a.csv")[0]["x"].tolist() == [0.0, 1.0]


def test_openacc_counts_what_it_leaves_out_behind_an_unknown_gap(tmp_path):
    head = PLATOON.replace("Speed1,SpeedLimit", "Speed1,Speed2,IVS1")
    (tmp_path / "a.csv").write_text(head + "0,10,10,20\n0.1,10,10,\n0.2,,10,20\n0.3,10,,20\n")
    table, notes = openacc.read(tmp_path / "a.csv")
    assert table.groupby("vehicle").size().tolist() == [3, 1]
    assert sum(note.startswith("2 samples in a.csv are left out") for note in notes) == 1


def test_a_table_of_this_project_names_what_it_does_not_have(tmp_path):
    assert imported(tmp_path, plain_table()).notes == (
        "table.csv has no classes: all are assumed to be cars.",
        "table.csv has no lanes: a width of 3.5 m is assumed.",
    )
    assert not imported(tmp_path, plain_table().assign(lane=0, **{"class": "car"})).notes


@pytest.mark.parametrize("rate", [10, 20, 25])
def test_a_lane_is_that_of_the_nearest_sample(tmp_path, rate):
    table = plain_table()
    time = np.arange(2 * rate + 1) / rate
    table = table.iloc[:1].drop(columns="t").merge(pd.DataFrame({"t": time}), how="cross")
    table = table.assign(
        lane=(time > 0.999).astype(int), heading=0.0, speed=20.0, **{"class": "car"}
    )
    lanes = canonical(table).table.set_index("t")["lane"]
    assert lanes[0.9] == 0
    assert lanes[1.0] == 1


def test_one_bad_file_among_good_ones_imports_nothing(tmp_path):
    good = plain_file(tmp_path / "good.csv")
    (tmp_path / "bad.csv").write_text(good.read_text().replace("r,b,1.0,", "r,b,when,"))
    with refusal(r"`t` in row \d+ of .*bad\.csv must be a number, got 'when'"):
        import_recordings("csv", [good, tmp_path / "bad.csv"])


def test_tracks_that_stand_in_two_recordings_are_counted(tmp_path):
    table = plain_table()
    other = table[table["vehicle"] == "a"].assign(recording="s")
    (note,) = imported(tmp_path, pd.concat([table, other])).notes[-1:]
    assert note.startswith("1 tracks end like one of the same name in another recording.")
    later = imported(tmp_path, pd.concat([table, other.assign(t=other["t"] + 1.0)]))
    assert not any("end like" in note for note in later.notes)


def test_files_of_a_folder_are_read_one_by_one_when_they_are_asked_for(tmp_path):
    good = plain_file(tmp_path / "1.csv")
    (tmp_path / "2.csv").write_text(good.read_text().replace("r,b,1.0,", "r,b,when,"))
    parts = each_of("map", [tmp_path])
    assert next(parts).vehicles == 2
    with refusal(r"`t` in row \d+ of .*2\.csv must be a number, got 'when'"):
        next(parts)


def test_the_help_names_every_format():
    result = sumo_eval("humans import --help")
    assert all(form in result.said for form in FORMATS)


STATE = "<shape><rectangle><length>4</length><width>2</width></rectangle></shape>"
SETS = (
    "<commonRoad timeStepSize='0.1'><dynamicObstacle "
    "id='7'><type>car</type>{}</dynamicObstacle></commonRoad>"
)


@pytest.mark.parametrize(
    "name, inside, sentence",
    [
        ("a.xml", "<occupancySet><occupancy/></occupancySet>", r"got a set-based prediction "
                                                               r"\(`occupancySet`\)"),
        ("a.xml", "<trajectory><state><position><rectangle/></position></state></trajectory>",
         r"Obstacle 7 in row 1 of .*a\.xml must have exact states, got sets of them "
         r"\(`position/rectangle`\)"),
        ("a.pb", "", r"binary format \(\.pb\), which is not read: write it as XML"),
    ],
)  # fmt: skip
def test_commonroads_sets_and_binary_files_are_refused_in_words(tmp_path, name, inside, sentence):
    (tmp_path / name).write_text(SETS.format(STATE + inside))
    with refusal(sentence):
        commonroad.read(tmp_path / name)


def test_commonroads_obstacles_that_are_left_out_are_counted_by_why(tmp_path):
    """One that drives, beside one that stands, a person whose body is a circle, one whose body lies
    ahead of its place, and one that is predicted by sets."""
    state = "<position><point><x>{0}</x><y>0</y></point></position><orientation><exact>0</exact></orientation>"
    state = f"<state>{state}<time><exact>{{0}}</exact></time><velocity><exact>10</exact></velocity></state>"
    path = "<trajectory>" + "".join(state.format(k) for k in range(3)) + "</trajectory>"
    circle = "<shape><circle><radius>0.3</radius></circle></shape>"
    ahead = STATE.replace("</length>", "</length><center><x>1.4</x><y>0.0</y></center>")
    (tmp_path / "a.xml").write_text(
        "<commonRoad timeStepSize='0.1'><dynamicObstacle "
        f"id='1'><type>car</type>{STATE}{path}</dynamicObstacle>"
        f"<dynamicObstacle id='2'><type>pedestrian</type>{circle}{path}</dynamicObstacle>"
        f"<dynamicObstacle id='3'><type>car</type>{STATE}<occupancySet/></dynamicObstacle>"
        f"<dynamicObstacle id='4'><type>car</type>{STATE}</dynamicObstacle>"
        f"<dynamicObstacle id='6'><type>car</type>{ahead}{path}</dynamicObstacle>"
        f"<staticObstacle id='5'><type>parkedVehicle</type>{STATE}</staticObstacle></commonRoad>"
    )
    table, notes = commonroad.read(tmp_path / "a.xml")
    assert set(table["vehicle"]) == {"1"}
    assert set(notes) == {
        "a.xml: 1 obstacles are left out, which stand.",
        "a.xml: 1 obstacles are left out, whose body is not a rectangle.",
        "a.xml: 1 obstacles are left out, whose rectangle is shifted or turned.",
        "a.xml: 1 obstacles are left out, which have a set-based prediction and no trajectory.",
        "a.xml: 1 obstacles are left out, which have no trajectory.",
    }


def test_commonroad_offsets_are_to_the_left_of_the_drive(tmp_path):
    """A vehicle overtakes 1 m to the right of the centre of the oncoming lane, at y = 3.5 m."""

    def lanelet(begin, end, left, right):
        points = "<point><x>{}</x><y>{}</y></point>".format
        bounds = (
            f"<{side}Bound>{points(begin, y)}{points(end, y)}</{side}Bound>"
            for side, y in (("left", left), ("right", right))
        )
        return f"<lanelet>{''.join(bounds)}</lanelet>"

    lanelets = lanelet(0, 90, 1.75, -1.75) + lanelet(90, 0, 1.75, 5.25)
    state = (
        "<state><position><point><x>{0}</x><y>2.5</y></point></position><orientation><exact>0.1"
        "</exact></orientation><time><exact>{0}</exact></time><velocity><exact>10</exact></velocity>"
        "</state>"
    )
    path = "<trajectory>" + "".join(state.format(k) for k in range(3)) + "</trajectory>"
    (tmp_path / "a.xml").write_text(
        f"<commonRoad timeStepSize='0.1'>{lanelets}<dynamicObstacle id='1'><type>car</type>{STATE}"
        f"{path}</dynamicObstacle></commonRoad>"
    )
    table, _ = commonroad.read(tmp_path / "a.xml")
    assert table["offset"].to_numpy() == pytest.approx(-1.0)


def _bend(path, **columns):
    """Eight cars along a circle of 300 m, in two lanes of 3.5 m, on a map, one that stands, and one
    that reverses.
    """
    rows = []
    for number in range(8):
        lane = number % 2
        radius = 300.0 - 3.5 * lane
        for t in np.round(np.arange(0.0, 12.0, 0.1), 1):
            angle = (20.0 * t + 15.0 * number) / radius
            rows.append(
                (
                    f"v{number}",
                    t,
                    radius * np.sin(angle),
                    300.0 - radius * np.cos(angle),
                    np.degrees(angle),
                )
            )
    rows += [("parked", t, 80.0, 30.0, 0.0) for t in (0.0, 0.1, 0.2)]
    rows += [rows[0]]
    rows += [("reversing", t, -5.0 * t, 900.0, 0.0) for t in np.arange(0.0, 12.0, 0.5).tolist()]
    table = pd.DataFrame(rows, columns=["vehicle", "t", "x", "y", "heading_deg"]).assign(**columns)
    table.to_csv(path, index=False)
    return path


def test_any_table_on_a_map_is_straightened_and_says_what_it_assumed_and_left_out(tmp_path):
    recordings = import_recordings("map", [_bend(tmp_path / "bend.2.csv")])
    table = recordings.table
    assert set(table["recording"]) == {"bend.2-1"}
    assert set(table["vehicle"]) == {f"v{number}" for number in range(8)}
    assert sorted(table["lane"].unique()) == [0, 1]
    for _, track in table.groupby("vehicle"):
        # 20 m/s along a lane: what is straightened advances by that, within the 1.2 % by which one
        # lane is shorter.
        assert np.polyfit(track["t"], track["x"], 1)[0] == pytest.approx(20.0, rel=0.02)
        assert np.ptp(track["y"]) < 0.5
    said = " ".join(recordings.notes)
    assert "1 vehicles that move less than 30 m are left out" in said
    assert "1 vehicles that do not move as they are headed are left out" in said
    assert "no length of the vehicles: 4.5 m are assumed" in said
    assert "no speed: from the motion" in said
    assert "1 samples with a time that their vehicle already had" in said


def on_a_map(folder, *tracks):
    """What is imported of vehicles on a map: t, x and y of each."""
    rows = [
        pd.DataFrame(dict(zip("txy", track, strict=True))).assign(vehicle=i)
        for i, track in enumerate(tracks)
    ]
    pd.concat(rows).to_csv(folder / "a.csv", index=False)
    return import_recordings("map", [folder / "a.csv"])


def test_lanes_are_found_when_the_axis_changes_lanes(tmp_path):
    t = np.arange(0.0, 30.0, 0.1)
    changes = t, 16.5 * t, np.interp(t, [10, 14], [0, 3.5])
    cars = [(t, 15.0 * t, 3.5 * (i % 2) + 0.0 * t) for i in range(1, 8)]
    table = on_a_map(tmp_path, changes, *cars).table.query("vehicle != '0'")
    assert table["lane"].eq(table["vehicle"].astype(int) % 2).all()


def test_a_cut_in_is_as_quick_as_recorded_whoever_is_the_axis(tmp_path):
    """At most 1.64 m/s across. Beyond 2 m/s it would be a ghost."""
    t = np.arange(0.0, 12.0, 0.05)
    cuts_in = t, 10.0 + 30.0 * t, 3.5 - 3.5 * smooth_step((t - 3.0) / 4.0)
    keep = [(t, 25.0 * t - 40.0 * i, 0.0 * t) for i in (0, 1)]
    found = on_a_map(tmp_path, cuts_in, *keep)
    (event,) = extract_events(found).tables["cut_in"].itertuples()
    assert event.lateral_speed == pytest.approx(1.64, abs=0.2)
    assert not any("which of them" in note for note in found.notes)
    assert any("which of them" in note for note in on_a_map(tmp_path, cuts_in, keep[0]).notes)


def test_two_cars_in_few_samples_are_each_in_a_lane(tmp_path):
    t = np.arange(0.0, 12.0, 0.1)
    table = on_a_map(tmp_path, *((t, 15.0 * t, 3.5 * i + 0.0 * t) for i in (0, 1))).table
    assert table["lane"].eq(table["vehicle"].astype(int)).all()
    assert table["y"].to_numpy() == pytest.approx(3.5 * table["lane"].to_numpy(), abs=1e-6)


def test_a_parked_car_with_noise_of_its_places_is_no_path(tmp_path):
    """Its steps add up to 1.6 km within a box of half a metre."""
    t = np.arange(0.0, 12.0, 0.1)
    cars = [(t + 4.0 * i, 20.0 * t, 3.5 * (i % 2) + 0.0 * t) for i in range(6)]
    t = np.arange(0.0, 1000.0, 0.1)
    x, y = np.random.default_rng(0).normal(0.0, 0.1, (2, len(t)))
    found = on_a_map(tmp_path, *cars, (t, 120.0 + x, y - 6.0))
    assert "a-1: 6 vehicles along one path, lanes 3.50 m wide." in found.notes
    assert "a: 1 vehicles that move less than 30 m are left out." in found.notes


def test_a_path_goes_on_where_a_car_stood_with_noise_of_its_places(tmp_path):
    t = np.arange(0.0, 1000.0, 0.1)  # 100 m, a stand of 980 s, 100 m
    x = np.interp(t, [10.0, 990.0], [0.0, 1e-3]) + 10.0 * (t.clip(max=10.0) + (t - 990.0).clip(0.0))
    x, y = np.stack([x, 0.0 * t]) + np.random.default_rng(0).normal(0.0, 0.1, (2, len(t)))
    table = on_a_map(tmp_path, (t, x, y)).table
    assert table["x"].max() == pytest.approx(200.0, abs=1.0)


def test_law_places_do_not_jump_from_lap_to_lap(tmp_path):
    angle = np.arange(0.0, 14.0, 0.013)  # 1.3 m a sample, over two laps of 628 m
    x, y = 100.0 * np.sin(angle), 100.0 * np.cos(angle)
    table, notes = on_a_map(tmp_path, (10.0 * angle, x, y))
    assert "a-1: 1 vehicles along one path, in one lane." in notes
    assert np.diff(table["x"]) == pytest.approx(10.0 * np.diff(table["t"]), rel=0.02)
    assert np.ptp(table["x"]) > 400.0


def test_of_two_headings_one_is_not_read_and_named(tmp_path):
    plain_table().assign(heading=0.0, heading_deg=90.0).to_csv(tmp_path / "a.csv", index=False)
    table, notes = import_recordings("map", [tmp_path / "a.csv"])
    assert table["heading"].abs().max() < 0.01
    assert "a.csv has `heading` and `heading_deg`: `heading_deg` is not read." in notes


def test_a_table_on_a_map_without_a_place_is_refused_with_its_row(tmp_path):
    path = _bend(tmp_path / "bend.csv")
    replace_in(path, "v0,0.1,", "v0,later,", 1)
    with refusal(r"`t` in row 3 .* must be a number"):
        import_recordings("map", [path])
