"""Progress where there is no terminal: plain lines with rate, time left and failures, one at a stage's end."""

from __future__ import annotations

import pytest

from sumo_eval.cli import progress as module
from sumo_eval.cli.progress import Progress


def test_plain_lines_tell_rate_time_left_and_failures(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [100.0]
    monkeypatch.setattr(module.clock, "monotonic", lambda: now[0])
    with Progress() as show:
        for done in range(1, 41):
            show("cut_out: ADSs", done, 40, done // 10)
            now[0] += 0.5
        show("cut_out: ADSs", 40, 40, 4)
        show("cut_out: drivers", 3, 3)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "cut_out: ADSs: 21 of 40, 2.0/s, about 10 s left, 2 failed",
        "cut_out: ADSs: 40 done, 4 failed",
        "cut_out: drivers: 3 done",
    ]
