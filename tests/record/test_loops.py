"""Compiling before the first case: what a run needs, once on a machine; only what came to its end
counts as done."""

import os
import signal
import sys

import pytest
from commands import program
from loaded import ROOT

from sumo_eval import kernels
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.record import loops
from sumo_eval.record.cases import Case
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start
from sumo_eval.settings.config import PAPER_EVALUATION, read_evaluation

LEAD = Actor("lead", Start(50.0, 0.0, 5.0))
CONCRETE = ConcreteScenario(
    "none", {}, 1.0, Road("road", 100.0, 2, 3.5, 0.0), Start(10.0, 0.0, 10.0), (LEAD,)
)


@pytest.mark.skipif(kernels.INTERPRETED, reason="nothing is compiled")
def test_what_failed_to_compile_is_not_marked_as_done(tmp_path, monkeypatch):
    monkeypatch.setattr(loops, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(loops, "warm", lambda scripts: loops._mark("idm").touch())
    told = []

    def progress(stage, done, total, failed=0):
        told.append((done, total, failed))

    loops.ready(["idm", "rss"], progress)
    assert loops.compiled() == ["idm"]
    assert told == [(0, 2, 0), (2, 2, 1)], "who waits is told of it, and that one failed"
    loops.ready(["idm"], progress)
    assert len(told) == 2, "what is done is not done again"


def test_children_that_end_badly_are_waited_for(tmp_path):
    kernels.warm([f"open({str(tmp_path / 'done')!r}, 'w').close()", "raise SystemExit(3)"])
    assert (tmp_path / "done").is_file()


def test_an_interrupt_ends_what_compiles(tmp_path):
    """Only this process is told, as by a service; a terminal tells its children, too."""
    file = tmp_path / "pid"

    def press(number, frame):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, press)
    begun = (
        f"import os, time; open({str(file)!r}, 'w').write(str(os.getpid())); "
        f"os.kill({os.getpid()}, 14)"
    )
    try:
        with pytest.raises(KeyboardInterrupt):
            kernels.warm([f"{begun}; time.sleep(300)"])
    finally:
        signal.signal(signal.SIGALRM, before)
    with pytest.raises(ProcessLookupError):
        os.kill(int(file.read_text()), 0)


@pytest.mark.campaign
def test_children_take_no_module_from_the_folder_in_which_a_run_is_started(tmp_path):
    """A clone of this package lies there, as where it is installed from, and files that are called
    as modules are."""
    (tmp_path / "sumo_eval").mkdir()
    for name in ("sumo_eval/__init__.py", "random.py", "numba.py"):
        (tmp_path / name).write_text("raise RuntimeError('taken from the working folder')\n")
    (tmp_path / "mine.py").write_text("def acc(seen):\n    return 0.0\n")
    (tmp_path / "evaluation.toml").write_text(
        'name = "x"\n[[scenario]]\nuse = "front_vehicle_low_speed"\nsampling.levels = '
        '2\n[[ads]]\nname = "mine"\n'
        'controller = "mine.py:acc"\n[drivers]\ncount = 2\n'
    )
    words = (sys.executable, "-P", "-m", "sumo_eval", "run", "evaluation.toml", "--out", "run")
    done = program(*words, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert "working folder" not in done.stderr
    assert "failed" not in done.stderr


def test_a_run_compiles_what_it_needs():
    settings = read_evaluation(PAPER_EVALUATION)
    assert loops.of_evaluation(settings) == {
        loops.WORLD, loops.FIELDS, loops.PEOPLE, "ideal_braking", "no_reaction", "idm",
        "lane_changer"
    }  # fmt: skip
    assert loops.of_cases([Case(0, CONCRETE, "ads", "mine", "my_ads.py:Mine")]) == {loops.WORLD}
    assert loops.of_cases([Case(0, CONCRETE, "human", "driver_00", "synthetic")]) == {
        loops.WORLD,
        loops.PEOPLE,
    }


def test_every_rule_that_ships_is_a_piece():
    for locator in SHIPPED:
        (piece,) = loops.of_cases([Case(0, CONCRETE, "ads", "it", locator)]) - {loops.WORLD}
        assert piece in loops.everything()
