"""Progress where there is no terminal: plain lines with rate, time left and failures, one at a
stage's end."""

import pytest

from sumo_eval.cli import progress as module
from sumo_eval.cli.progress import Progress


def test_plain_lines_tell_rate_time_left_and_failures(monkeypatch, capsys):
    now = [100.0]
    monkeypatch.setattr(module.clock, "monotonic", lambda: now[0])
    with Progress() as show:
        for done in range(1, 41):
            show("cut_out: ADSs", done, 40, done // 10)
            now[0] += 0.5
        show("cut_out: ADSs", 40, 40, 4)
        for total in (3, 3, 8):  # 8: after a further round
            show("cut_out: drivers", total, total)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "cut_out: ADSs: 21 of 40, 2.0/s, about 10 s left, 2 failed",
        "cut_out: ADSs: 40 done, 4 failed",
        "cut_out: drivers: 3 done",
        "cut_out: drivers: 8 done",
    ]


def shown(monkeypatch, reports, total, at_most=False):
    """Report how much was done at these times, s."""
    now = [0.0]
    monkeypatch.setattr(module.clock, "monotonic", lambda: now[0])
    with Progress(at_most) as show:
        for when, done in reports:
            now[0] = when
            show("drives", done, total)


@pytest.mark.parametrize("idle", [[], [(5.0, 0)]])
def test_time_before_the_first_case_does_not_count_for_the_rest(idle, monkeypatch, capsys):
    """After 40 s of compiling, with a report that nothing is done or without, 20 every 2 s: 10/s.

    The mean since the beginning, 80/46 s, would give 9 min.
    """
    batches = [(40.0, 20), (42.0, 40), (44.0, 60), (46.0, 80), (52.0, 140)]
    shown(monkeypatch, [(0.0, 0), *idle, *batches], 1000)
    assert capsys.readouterr().err.splitlines() == [
        "drives: 20 of 1000",
        "drives: 140 of 1000, 10.0/s, about 86 s left",
    ]


def test_a_batch_that_ends_at_once_has_no_rate(monkeypatch, capsys):
    shown(monkeypatch, [(0.0, 0), *((11.0 + k / 1000, k) for k in range(1, 200))], 1000)
    assert capsys.readouterr().err.splitlines() == ["drives: 1 of 1000"]


def test_a_search_that_may_settle_reports_it(monkeypatch, capsys):
    shown(monkeypatch, [(0.0, 0), (2.0, 8), (7.0, 28), (12.0, 48)], 500, at_most=True)
    assert capsys.readouterr().err.splitlines() == [
        "drives: 48 of at most 500, 4.0/s, about 113 s left if it takes them all"
    ]
