"""Work alongside other work."""

import os
import signal
import time

import pytest
from refusals import refusal

from sumo_eval.record.spread import alongside, spread_over


class Writing:
    """Work that leaves a file behind, importable by a child."""

    def __init__(self, path, after=0.0):
        self.path, self.after = path, after

    def __call__(self):
        self.path.with_suffix(".pid").write_text(str(os.getpid()))
        time.sleep(self.after)
        self.path.write_text("done")


def test_what_is_done_alongside_is_done_at_the_end(tmp_path):
    with alongside(Writing(tmp_path / "file")):
        pass
    assert (tmp_path / "file").read_text() == "done"


def _interrupted(work, began):
    with alongside(work):
        while not began.exists() or not began.read_text():
            time.sleep(0.01)
        raise KeyboardInterrupt


def test_what_ends_early_ends_what_is_done_alongside(tmp_path):
    began = tmp_path / "file.pid"
    with pytest.raises(KeyboardInterrupt):
        _interrupted(Writing(tmp_path / "file", after=60.0), began)
    with pytest.raises(ProcessLookupError):
        os.kill(int(began.read_text()), 0)
    assert not (tmp_path / "file").exists()


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_killed_process_of_scoring_is_one_sentence():
    with refusal("A process that computes scores was killed"), spread_over(2) as spread:
        list(spread(signal.raise_signal, [signal.SIGKILL]))
