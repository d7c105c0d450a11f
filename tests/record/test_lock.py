"""The lock of run folders and histories: one holder, whose name a refusal repeats; it ends with the
process."""

import errno
import os
import platform
import subprocess
import sys

import pytest

from sumo_eval.errors import InputError
from sumo_eval.record import lock
from sumo_eval.record.lock import held

HOLDER = """
import sys
from pathlib import Path
from sumo_eval.record.lock import held
with held(Path(sys.argv[1]), "The folder", str):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_the_second_writer_sees_the_first_and_deletes_nothing(tmp_path):
    path = tmp_path / "lock"
    name = f"process {os.getpid()} on {platform.node()} since 20"
    with held(path, "The folder", str):
        for _ in range(2):
            with (
                pytest.raises(InputError, match=name),
                held(path, "The folder", str),
            ):
                pass
        assert path.read_text().startswith(name)
    assert not path.exists()
    with held(path, "The folder", str):
        assert path.exists()


def test_a_file_system_without_locks_is_not_another_writer(tmp_path, monkeypatch):
    def no_locks(_file):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(lock, "_lock", no_locks)
    before = os.dup(0)  # the lowest free number
    os.close(before)
    with (
        pytest.raises(InputError, match="No locks available"),
        held(tmp_path / "lock", "The folder", str),
    ):
        pass
    after = os.dup(0)
    os.close(after)
    assert before == after


def test_the_lock_of_a_process_that_was_killed_is_free(tmp_path):
    path = tmp_path / "lock"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout.readline() == "held\n"
        with (
            pytest.raises(InputError, match=f"process {holder.pid} on"),
            held(path, "The folder", str),
        ):
            pass
        holder.kill()
    assert path.exists(), "a killed process takes nothing away"
    with held(path, "The folder", str):
        assert path.read_text().startswith(f"process {os.getpid()} on")
