"""The lock of run folders and histories: one holder, whose words a refusal repeats; it ends with
the process."""

import errno
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
with held(Path(sys.argv[1]), "process of the test", "The folder", str):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_the_second_writer_sees_the_first_and_deletes_nothing(tmp_path):
    path = tmp_path / "lock"
    with held(path, "the first", "The folder", str):
        for _ in range(2):
            with (
                pytest.raises(InputError, match="the first"),
                held(path, "the second", "The folder", str),
            ):
                pass
        assert path.read_text() == "the first\n"
    assert not path.exists()
    with held(path, "the second", "The folder", str):
        assert path.read_text() == "the second\n"


def test_a_file_system_without_locks_is_not_another_writer(tmp_path, monkeypatch):
    def no_locks(_file):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(lock, "_lock", no_locks)
    with (
        pytest.raises(InputError, match="No locks available"),
        held(tmp_path / "lock", "mine", "The folder", str),
    ):
        pass


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
            pytest.raises(InputError, match="process of the test"),
            held(path, "mine", "The folder", str),
        ):
            pass
        holder.kill()
    assert path.exists(), "a killed process takes nothing away"
    with held(path, "mine", "The folder", str):
        assert path.read_text() == "mine\n"
