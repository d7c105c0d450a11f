"""Bad input at the command line: one clear sentence, the right status, no traceback, and no
finished work lost."""

import os
import shlex
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from commands import cli_refuses, in_a_process, sumo_eval
from tables import rows_of

from sumo_eval.cli.stopping import stop_on_signal
from sumo_eval.text import LOG

HEAD = """name = "bad input"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = 2
[[ads]]
name = "idm"
controller = "idm"
[drivers]
count = 2
[run]
workers = 1
"""
FULL = Path("/dev/full")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "good.toml").write_text(HEAD)
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    recorded = 'source = "recorded"\nrecordings = ["loop"]'
    (tmp_path / "recorded.toml").write_text(HEAD.replace("count = 2", recorded))
    (tmp_path / "long.toml").write_text(
        HEAD.replace('controller = "idm"', f'controller = "{"a" * 5_000}.py:x"')
    )
    (tmp_path / "surrogate.py").write_text('raise ValueError("\\ud800" + "x" * 10_000_000)\n')
    (tmp_path / "import.toml").write_text(
        HEAD.replace('controller = "idm"', 'controller = "surrogate.py:x"')
    )
    return tmp_path


@pytest.mark.parametrize(
    "arguments, words",
    [
        *rows_of(
            r"""
run folder.toml --out o | cannot be read: it is a folder
run good.toml --step-timeout nan | nan is not a number
run recorded.toml --out o | Too many levels of symbolic links
run good.toml --out good.toml | good.toml
run good.toml --out good.toml/below | good.toml
run long.toml --out o | File name too long
run import.toml --out o | ValueError: \ud800xxx
report good.toml | good.toml
report . | there is no facts.sqlite in it
""",
            str.split,
        ),
        (("run", "good.toml", "--out", "x" * 300), "File name too long"),
    ],
)
def test_what_cannot_be_used_is_one_short_sentence_and_status_2(folder, arguments, words):
    own_process = "import.toml" in arguments  # whose sentence no encoding can hold
    done = (in_a_process if own_process else partial(sumo_eval, status=2))(*arguments, cwd=folder)
    said = done.stdout + done.stderr
    assert done.returncode == 2, said
    assert words in said
    assert "Traceback" not in said
    assert len(said) <= LOG


def test_a_removed_working_folder_is_named(tmp_path):
    check = f"{shlex.quote(sys.executable)} -m sumo_eval check idm"
    done = subprocess.run(
        f"mkdir gone && cd gone && rmdir ../gone && {check}",
        shell=True, cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "The working folder must exist, but it was deleted: change to another" in done.stderr


@pytest.mark.campaign
@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_full_device_behind_stdout_loses_no_finished_work(folder):
    with FULL.open("w") as full:
        done = in_a_process("run", folder / "good.toml", "--out", folder / "o", stdout=full)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("sumo-eval: No space left on device")
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    for name in ("facts.sqlite", "cases.csv", "scores.json", "junit.xml", "report.html"):
        assert (folder / "o" / name).stat().st_size
    sumo_eval(f"score {folder}/o")


@pytest.mark.campaign
@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_full_device_behind_stderr_does_not_end_a_run(folder):
    with FULL.open("w") as full:
        done = in_a_process("run", folder / "good.toml", "--out", folder / "o", stderr=full)
    assert done.returncode == 0
    assert "front_vehicle_low_speed" in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is no fork server")
def test_a_long_path_of_temporary_files_is_refused(tmp_path):
    (tmp_path / ("x" * 100)).mkdir()
    variables = os.environ | {"TMPDIR": str(tmp_path / ("x" * 100))}
    done = in_a_process("check", "idm", env=variables)
    assert (done.returncode, "Is TMPDIR a short path?" in done.stderr) == (2, True), done.stderr


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="nothing is closed to root")
def test_a_read_only_folder_is_refused(folder):
    (folder / "closed").mkdir(mode=0o500)
    cli_refuses("Permission denied", f"run {folder}/good.toml --out {folder}/closed/o")


@pytest.mark.skipif(os.name != "posix", reason="a shell's way to close a stream")
@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-", "2>&1 | { ! grep Traceback; }"])
def test_closed_streams_do_not_end_a_command(folder, closed):
    words = [sys.executable, "-W", "error", "-m", "sumo_eval", "check", "good.toml"]
    done = subprocess.run(f"{shlex.join(words)} {closed}", shell=True, check=False, cwd=folder)
    assert done.returncode == 0
    child = [sys.executable, "-c", "import os; [os.fstat(number) for number in range(3)]"]
    script = f"""import subprocess, sys
from sumo_eval.cli import _fill_closed_streams
_fill_closed_streams()
sys.exit(subprocess.call({child}))"""
    words = [sys.executable, "-c", script]
    done = subprocess.run(f"{shlex.join(words)} {closed}", shell=True, check=False)
    assert done.returncode == 0, "children have the streams"


def test_a_signal_amid_the_last_cases_stops_what_follows():
    with pytest.raises(KeyboardInterrupt), stop_on_signal():
        signal.raise_signal(signal.SIGINT)
