"""Compiling before the first case: done once on a machine, and only what came to its end counts as done."""

from __future__ import annotations

from pathlib import Path

import pytest

from sumo_eval import kernels
from sumo_eval.record import loops


@pytest.mark.skipif(kernels.INTERPRETED, reason="nothing is compiled")
def test_what_failed_to_compile_is_not_marked_as_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "cache_folder", lambda: tmp_path)
    told: list[tuple[int, int, int]] = []

    def progress(stage: str, done: int, total: int, failed: int = 0) -> None:
        told.append((done, total, failed))

    loops._make("half", ["are_ready()", "nobody()"], progress)
    assert list(tmp_path.iterdir()) == []
    assert told == [(0, 2, 0), (2, 2, 1)], "who waits is told of it, and that one failed"
    loops._make("whole", ["are_ready()"])
    assert [file.name for file in tmp_path.iterdir()] == ["whole"]


def test_a_child_that_ends_badly_is_told() -> None:
    assert kernels.warm(["pass", "pass"]) == 0
    assert kernels.warm(["pass", "raise SystemExit(3)"]) == 1
