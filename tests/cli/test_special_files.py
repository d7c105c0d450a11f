"""Special files where a user's file is asked for: one sentence, at once, whatever command reads
them."""

import os
import signal

import pytest
from commands import sumo_eval

EVALUATION = """
name = "special"
[[scenario]]
use = {use}
{sampling}
[[ads]]
name = "mine"
controller = "{controller}"
[drivers]
{drivers}
[run]
engine = "serial"
"""
SHIPPED = '"front_vehicle_low_speed"'
INPUTS = {
    "evaluation": ("run", "special.toml", "--out", "out"),
    "scenario": ("run", "scenario.toml", "--out", "out"),
    "points": ("run", "points.toml", "--out", "out"),
    "recording": ("run", "recording.toml", "--out", "out"),
    "OpenSCENARIO": ("run", "openscenario.toml", "--out", "out"),
    "ADS": ("run", "ads.toml", "--out", "out"),
    "ADS of a check": ("check", "special.py"),
    "onnx": ("check", "onnx:special.onnx"),
    "file of a check": ("check", "special.toml"),
    "partition": ("partition", "special.toml"),
    "import": ("import", "special.xosc", "--out", "out.xosc"),
    "humans import": ("humans", "import", "sumo_fcd", "special.csv", "--out", "people.csv.gz"),
    "learn": ("learn", "special.csv.gz", "--out", "out"),
    "campaign": ("campaign", "special.toml", "--out", "out"),
    "nightly": ("nightly", "special.toml", "--history", "nights"),
}
NAMES = (
    "special.toml",
    "special.py",
    "special.onnx",
    "special.xosc",
    "special.csv",
    "special.csv.gz",
)


def fifo(path):
    os.mkfifo(path)


def endless(path):
    path.symlink_to("/dev/zero")


def link_to_a_fifo(path):
    os.mkfifo(path.with_name(f"{path.name}.pipe"))
    path.symlink_to(path.with_name(f"{path.name}.pipe"))


@pytest.fixture(params=[fifo, endless, link_to_a_fifo], ids=lambda make: make.__name__)
def desk(request, tmp_path):
    """A folder of special files, and of evaluations that name them."""
    for name in NAMES:
        request.param(tmp_path / name)
    parts = {"use": SHIPPED, "sampling": "", "controller": "idm", "drivers": "count = 2"}
    files = {
        "scenario": {"use": '"special.toml"'},
        "points": {"sampling": '[scenario.sampling]\nfile = "special.csv"'},
        "recording": {"drivers": 'count = 2\nsource = "recorded"\nrecordings = ["special.csv.gz"]'},
        "openscenario": {"use": '"special.xosc"'},
        "ads": {"controller": "special.py:Mine"},
    }
    for name, changed in files.items():
        (tmp_path / f"{name}.toml").write_text(EVALUATION.format(**{**parts, **changed}))
    return tmp_path


@pytest.fixture
def within_20_seconds():
    """End a command that waits for a pipe, or reads a device that never ends."""

    def too_long(number, frame):
        raise AssertionError("the special file was opened")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.usefixtures("within_20_seconds")
@pytest.mark.parametrize("command", INPUTS)
def test_special_file_is_refused_at_once(command, desk):
    done = sumo_eval(*INPUTS[command], cwd=desk, status=2)
    assert "must be a regular file, got a" in done.said
    assert not (desk / "out" / "facts.sqlite").exists()


def test_gate_that_is_a_pipe_is_refused(standard_run_read_only, tmp_path):
    os.mkfifo(tmp_path / "gate.toml")
    run = str(standard_run_read_only)
    done = sumo_eval("compare", run, run, "--gate", "gate.toml", cwd=tmp_path, status=2)
    assert "must be a regular file, got a named pipe" in done.said
