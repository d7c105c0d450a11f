"""Files of a user: what is no regular file is refused before it is opened, through every way in."""

import os
import random
import re
import resource
import socket
from pathlib import Path

import pytest
from refusals import refusal
from tables import in_campaign

from sumo_eval.cosim.doors.controller import find_controller
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.cosim.doors.given import load_given
from sumo_eval.drivers.recorded.importing import FORMATS, import_recordings
from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.points import read_variation
from sumo_eval.extras.openscenario.reading import read_openscenario, read_xml
from sumo_eval.extras.rates.campaign import read_campaign
from sumo_eval.extras.wheel.tape import read_tape
from sumo_eval.input_file import changed_at, hash_of, read_input, write_whole
from sumo_eval.record.qualification import read_qualification
from sumo_eval.report.page import write_csv
from sumo_eval.scenario.catalogue import find
from sumo_eval.scenario.number_table import read_numbers
from sumo_eval.scenario.sampling.listed_points import from_csv
from sumo_eval.scenario.sampling.request import Request
from sumo_eval.scenario.sumo_network import read_road
from sumo_eval.scoring.gate_settings import read_gate
from sumo_eval.settings import PlantSettings
from sumo_eval.settings.locators import load_object
from sumo_eval.settings.toml_file import read_toml

ROOMS = ("settings", "scenario", "drivers", "cosim/doors", "wheel/tape.py", "cli/tools.py")
OPENS = re.compile(
    r"\.(read_bytes|read_text)\(|(?<!_file)\bopen\((?!\")|etree\.(parse|iterparse)\(|pd\.read_\w+\(|\.read_parquet\("
)


ALLOWED = ("input_file(", '.open("x', '.open("w', "gzip.open", "read_parquet(str(path))")
"""Opened after a look at the file, or for writing; `osi` looks at its file before it asks which
kind it is."""


def joined(source):
    """The lines of a source, a call that is broken over several as one."""
    return re.sub(r"\(\n\s+", "(", source).splitlines()


def _points(path):
    return from_csv(find("cut_in", None), Request("file", file=str(path), folder=path.parent))


READERS = {
    "settings": lambda path: read_toml(path, "evaluation file"),
    "scenario": lambda path: find(f"{path}.toml", path.parent),
    "network": lambda path: read_road(path, ["a"], 100.0),
    "points": _points,
    "events": lambda path: read_numbers(path, "events", {"a": "1"}),
    "OpenSCENARIO": read_openscenario,
    "OpenDRIVE": lambda path: read_xml(path, "OpenDRIVE file"),
    "variation": lambda path: read_variation(path, None, 1),
    "tape": read_tape,
    "ADS": lambda path: load_object(f"{path}.py:Ads", None, "ADS"),
    "ADS by value": lambda path: load_given(path.name, path.parent),
    "vehicle model": lambda path: FmuPlant(PlantSettings(file=path.name), path.parent),
    "qualification": lambda path: read_qualification(path.name, path.parent),
    "hash": lambda path: hash_of(path, "file"),
    "model": lambda path: find_controller(f"onnx:{path.name}", path.parent),
    "gate": read_gate,
    "campaign": read_campaign,
    **{
        f"recording, {form}": lambda path, form=form: import_recordings(form, [path])
        for form in FORMATS
    },
}
NAMES = {
    "model": "special.onnx",
    "scenario": "special.toml",
    "ADS": "special.py",
    "recording, osi": "special.osi",
}
# each named after its number, beside its NN_tracksMeta.csv
LEVELX = ("highd", "ind", "exid", "round", "unid")
NAMES |= {f"recording, {form}": "01_tracks.csv" for form in LEVELX}


def laid_out(what, folder):
    """Where a reader's file belongs, all other files laid, and what the reader is given."""
    for name in ("01_tracksMeta.csv", "01_recordingMeta.csv"):
        (folder / name).write_text("id\n1\n")
    place = folder / NAMES.get(what, "special")
    return place, place.with_suffix("") if what in ("scenario", "ADS") else place


@pytest.mark.parametrize("what", READERS)
@pytest.mark.parametrize("kind", ["pipe", "link to a device"])
def test_special_files_are_refused_unopened(what, kind, tmp_path):
    place, given = laid_out(what, tmp_path)
    if kind == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to("/dev/zero")
    with refusal(r"must be a regular file, got a (named pipe|character device)\.$"):
        READERS[what](given)


@pytest.mark.parametrize("what", READERS)
def test_a_loop_of_links_is_refused(what, tmp_path):
    place, given = laid_out(what, tmp_path)
    place.symlink_to(place)
    with refusal(r"symbolic links|[Tt]here is no"):
        READERS[what](given)


@pytest.mark.parametrize("seeds", [range(60), in_campaign(range(60, 3_000))])
def test_a_special_file_behind_links_is_refused(seeds, tmp_path):
    """A fuzz of what stands in the place of a file that any reader is given."""
    for seed in seeds:
        draw, folder = random.Random(seed), tmp_path / str(seed)
        folder.mkdir()
        what = draw.choice([*READERS])
        place, given = laid_out(what, folder)
        kind = draw.choice(
            [
                "pipe",
                "folder",
                "/dev/zero",
                "/dev/random",
                "/dev/full",
                "/dev/tty",
                "nowhere",
                "loop",
            ]
        )
        last = place
        for number in range(draw.randint(0, 6)):
            last.symlink_to(folder / f"link_{number}")
            last = folder / f"link_{number}"
        if kind == "pipe":
            os.mkfifo(last)
        elif kind == "folder":
            last.mkdir()
        else:
            last.symlink_to(place if kind == "loop" else kind)
        with refusal() as found:
            READERS[what](given)
        assert "Traceback" not in str(found.value), (seed, what, kind)
        assert len(str(found.value).splitlines()) == 1, (seed, what, kind)


def test_a_socket_is_named_as_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("here")
        with refusal(r"^File here must be a regular file, got a socket\.$"):
            read_input(Path("here"), "file")


def test_whole_files_have_a_limit(tmp_path):
    path = tmp_path / "long"
    path.write_bytes(b"x" * 1_000_001)
    assert read_input(path, "file", 1_000_001) == b"x" * 1_000_001
    with refusal(r"^File .* must be at most 1 MB\.$"):
        read_input(path, "file", 1_000_000)


def test_rooms_of_input_open_files_one_way():
    package = Path(__file__).parents[1] / "sumo_eval"
    files = [
        file
        for room in ROOMS
        for file in (package, *package.rglob("*.py"))
        if file.is_relative_to(package / room)
    ]
    wrong = [
        f"{file.relative_to(package)}: {line.strip()}"
        for file in files
        for line in joined(file.read_text())
        if OPENS.search(line) and not any(word in line for word in ALLOWED)
    ]
    assert not wrong


def test_events_of_a_spreadsheet_with_a_byte_order_mark_are_read(tmp_path):
    path = tmp_path / "events.csv"
    path.write_text("a\n1\n2\n4\n", encoding="utf-8-sig")
    assert read_numbers(path, "events", {"a": "1"}).rows.tolist() == [[1.0], [2.0], [4.0]]


def test_a_full_disk_leaves_a_file_as_it_was(tmp_path):
    path = tmp_path / "report.html"
    write_whole(path, "of yesterday")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError, match="too large"):
            write_whole(path, "x" * 1001)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_text() == "of yesterday"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_leaves_a_table_as_it_was(tmp_path):
    path = tmp_path / "cases.csv"
    write_csv(path, ["case"], [["a"]])
    with pytest.raises(ZeroDivisionError):
        write_csv(path, ["case"], ([1 / left] for left in (1, 0)))
    assert path.read_text() == "case\na\n"
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_to_a_file_stays_a_link(tmp_path):
    link = tmp_path / "latest.html"
    link.symlink_to(tmp_path / "report.html")
    write_whole(link, "today")
    assert link.is_symlink()
    assert (tmp_path / "report.html").read_text() == "today"


@pytest.mark.parametrize("kind", ["file", "pipe", "nothing"])
def test_a_link_out_of_a_runs_folder_is_not_followed(tmp_path, kind):
    run, own = tmp_path / "run", tmp_path / "own.txt"
    run.mkdir()
    if kind == "file":
        own.write_text("mine")
    elif kind == "pipe":  # to open it would wait for ever
        os.mkfifo(own)
    (run / "manifest.json").touch()
    (run / "report.html").symlink_to(own)
    with pytest.raises(InputError, match=r"a link out of its run's folder.*own\.txt"):
        write_whole(run / "report.html", "today")
    assert kind != "file" or own.read_text() == "mine"
    assert kind != "nothing" or not own.exists()


def test_a_pipe_behind_a_descriptor_receives_the_text():
    reading, into = os.pipe()
    write_whole(Path(f"/dev/fd/{into}"), "today")
    os.close(into)
    with open(reading) as pipe:
        assert pipe.read() == "today"


def test_time_of_a_name_too_long_is_that_of_no_file():
    assert changed_at(Path("9" * 999)) == -1
