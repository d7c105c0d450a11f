"""Compiling before the first case: what a run needs, once on a machine; only what came to its end counts as done."""

from __future__ import annotations

from pathlib import Path

import pytest

from sumo_eval import kernels
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.record import loops
from sumo_eval.record.cases import Case
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road, Start
from sumo_eval.settings.config import PAPER_EVALUATION, read_evaluation

LEAD = Actor("lead", Start(50.0, 0.0, 5.0))
CONCRETE = ConcreteScenario("none", {}, 1.0, Road("road", 100.0, 2, 3.5, 0.0), Start(10.0, 0.0, 10.0), (LEAD,))


@pytest.mark.skipif(kernels.INTERPRETED, reason="nothing is compiled")
def test_what_failed_to_compile_is_not_marked_as_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(loops, "warm", lambda scripts: loops._mark("idm").touch())
    told: list[tuple[int, int, int]] = []

    def progress(stage: str, done: int, total: int, failed: int = 0) -> None:
        told.append((done, total, failed))

    loops.ready(["idm", "rss"], progress)
    assert loops.compiled() == ["idm"]
    assert told == [(0, 2, 0), (2, 2, 1)], "who waits is told of it, and that one failed"
    loops.ready(["idm"], progress)
    assert len(told) == 2, "what is done is not done again"


def test_children_that_end_badly_are_waited_for(tmp_path: Path) -> None:
    kernels.warm([f"open({str(tmp_path / 'done')!r}, 'w').close()", "raise SystemExit(3)"])
    assert (tmp_path / "done").is_file()


def test_a_run_compiles_what_it_needs() -> None:
    settings = read_evaluation(PAPER_EVALUATION)
    assert loops.of_evaluation(settings) == {
        loops.WORLD, loops.PEOPLE, "ideal_braking", "no_reaction", "idm", "lane_changer"
    }  # fmt: skip
    assert loops.of_cases([Case(0, CONCRETE, "ads", "mine", "my_ads.py:Mine")]) == {loops.WORLD}
    assert loops.of_cases([Case(0, CONCRETE, "human", "driver_00", "synthetic")]) == {loops.WORLD, loops.PEOPLE}


def test_every_rule_that_ships_is_a_piece() -> None:
    for locator in SHIPPED:
        (piece,) = loops.of_cases([Case(0, CONCRETE, "ads", "it", locator)]) - {loops.WORLD}
        assert piece in loops.everything()
