"""The code that a run names is run for a run of one's own, and for nobody else's."""

import json
import os
import shlex
import shutil

import pytest
from commands import in_a_process
from commands import sumo_eval as sumo_eval_cli
from refusals import refusal
from tables import rows_of

import sumo_eval
from sumo_eval.record import trust
from sumo_eval.record.sealed import SEAL, sealed

EVALUATION = """
name = "trust"
[[scenario]]
use = "front_vehicle_low_speed"
sampling.levels = { ego_speed = 2, lead_speed = 2 }
[[ads]]
name = "mine"
controller = "code.py:mine"
[drivers]
count = 2
[run]
workers = 1
[method.collision]
severity = "code.py:severity"
"""
CODE = """
from pathlib import Path
Path(__file__).with_name("it_ran").touch()

def severity(contact):
    return 0.5

def mine(seen):
    return 0.0
"""
CASE = "front_vehicle_low_speed-0000-mine"


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """A run of one's own, `run`, of an evaluation in `source`."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "source").mkdir()
    (folder / "source" / "code.py").write_text(CODE)
    (folder / "source" / "evaluation.toml").write_text(EVALUATION)
    sumo_eval.evaluate(folder / "source" / "evaluation.toml", folder / "run")
    return folder


@pytest.fixture
def another_process(monkeypatch):
    """What another process of the same user knows."""
    monkeypatch.setattr(trust, "_trusted", set())
    monkeypatch.setattr(trust, "_trust_all", False)


@pytest.fixture
def foreign(own, tmp_path, monkeypatch, another_process):
    """The same run as another user finds it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (own / "source" / "it_ran").unlink(missing_ok=True)
    return own


def ran(folder):
    return (folder / "source" / "it_ran").exists()


def said(*arguments):
    done = sumo_eval_cli(*arguments, status=None)
    return done.returncode, done.stderr


COMMANDS = dict(
    rows_of("""
report | report {run}
score | score {run}
compare | compare {run} {run}
explain | explain {run} CASE
find | find {run} ego_speed=20
replay | replay {run} CASE
plot | plot {run} zone_map
export | export {run}
export a case | export {run} CASE
evidence | export {run} --evidence
verify | verify {run}
resume | run --out {run} --resume
merge | merge {run} --out {run}-whole
trend | trend {run}-history --import {run}
sensitivity | sensitivity {run}
""")
)


@pytest.mark.parametrize("kind", COMMANDS)
def test_no_command_runs_code_of_others(foreign, tmp_path, kind):
    run = tmp_path / "run"
    shutil.copytree(foreign / "run", run)
    status, words = said(*COMMANDS[kind].replace("CASE", CASE).format(run=run).split())
    assert status == 2
    assert words.startswith("sumo-eval: ")
    assert "--trust" in words
    assert "Traceback" not in words
    assert not ran(foreign)


EVIL = {
    name: row
    for name, *row in rows_of("""
severity | severity = "injury:cyclist" | severity = "{evil}"
severity as a module | severity = "injury:cyclist" | severity = "evil:severity"
module | severity = "injury:cyclist" | severity = "sumo:severity"
scenario | use = "front_vehicle_low_speed" | use = "{evil}"
scenario with options | use = "front_vehicle_low_speed" | use = "{evil}?a=1"
people | source = "synthetic" | source = "{evil}"
""")
} | {
    "sampler": ("[scenario.sampling]\n", '[scenario.sampling]\nmethod = "{evil}"\n'),
}


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(it, marks=[pytest.mark.campaign] * (it not in ("module", "scenario")))
        for it in EVIL
    ],
)
def test_every_name_of_code_is_refused(tmp_path, kind, another_process):
    """A run recorded here, to which somebody has added a name of code since."""
    run, evil = tmp_path / "run", tmp_path / "evil.py"
    evil.write_text(CODE)
    plain = EVALUATION.replace("code.py:severity", "injury:cyclist").replace("code.py:mine", "idm")
    (tmp_path / "evaluation.toml").write_text(plain)
    sumo_eval.evaluate(tmp_path / "evaluation.toml", run)
    old, new = EVIL[kind]
    text = (run / "evaluation.toml").read_text()
    assert old in text
    (run / "evaluation.toml").write_text(text.replace(old, new.format(evil=f"{evil}:severity")))
    for command in (("report", run), ("score", run), ("compare", run, run), ("verify", run)):
        status, words = said(*command)
        assert (status, "--trust" in words, "Traceback" in words) == (2, True, False), words
    assert not (tmp_path / "it_ran").exists()


def test_own_run_needs_no_option(own, another_process):
    (own / "source" / "it_ran").unlink(missing_ok=True)
    for command in (("report", own / "run"), ("verify", own / "run"), ("explain", own / "run")):
        status, words = said(*command)
        assert status == 0, words


@pytest.mark.parametrize("name", ["evaluation.toml", "manifest.json"])
def test_own_run_that_names_other_code_now_is_refused(own, tmp_path, name, another_process):
    file = own / "run" / name
    before = file.read_text()
    other = before.replace("code.py:severity", "code.py:other")
    if name == "manifest.json":
        content = {**json.loads(before), "source_folder": str(tmp_path)}
        del content[SEAL]
        other = sealed(content)
    try:
        file.write_text(other)
        with refusal("--trust"):
            sumo_eval.score(own / "run")
    finally:
        file.write_text(before)


def test_trust_is_asked_once(foreign, monkeypatch):
    assert said("score", foreign / "run")[0] == 2
    assert said("score", foreign / "run", "--trust")[0] == 0
    monkeypatch.setattr(trust, "_trusted", set())
    assert said("score", foreign / "run")[0] == 0


def test_advice_for_a_run_whose_only_code_is_its_ads_works(tmp_path, monkeypatch, another_process):
    run = tmp_path / "a run"
    (tmp_path / "code.py").write_text(CODE)
    (tmp_path / "evaluation.toml").write_text(
        EVALUATION.replace("code.py:severity", "injury:cyclist")
    )
    sumo_eval.evaluate(tmp_path / "evaluation.toml", run)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    trust._trusted.clear()
    (tmp_path / "it_ran").unlink(missing_ok=True)

    for command in (("whatif", run, CASE), ("run", "--out", run, "--resume")):
        status, words = said(*command)
        assert status == 2
        assert not (tmp_path / "it_ran").exists()
    advice = words.rpartition("sumo-eval ")[2].strip().removesuffix(".")
    assert said(*shlex.split(advice))[0] == 0

    trust._trusted.clear()
    trust.trust_what_is_opened(False)
    for command in (("run", "--out", run, "--resume"), ("verify", run)):
        done = in_a_process(*command, errors="replace")
        assert done.returncode == 0, done.stderr


def test_code_that_the_evaluation_names_is_the_users(foreign, tmp_path):
    """As in a job whose base comes out of a cache: what it names, the run beside it names too."""
    base = tmp_path / "base"
    shutil.copytree(foreign / "run", base)
    sumo_eval.evaluate(foreign / "source" / "evaluation.toml", tmp_path / "new")
    trust._trusted.clear()
    status, words = said("compare", base, tmp_path / "new")
    assert status == 0, words


def test_state_folder_that_takes_nothing_ends_no_run(own, tmp_path, monkeypatch):
    (tmp_path / "state").write_text("a file in its place")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert sumo_eval.evaluate(own / "source" / "evaluation.toml", tmp_path / "run").scores


def test_a_run_in_a_folder_whose_name_is_not_utf8(own, tmp_path, another_process):
    run = tmp_path / os.fsdecode(b"r\xff")
    shutil.copytree(own / "run", run)
    for command in (("report", run, "--trust"), ("score", run)):  # the second finds a note
        done = in_a_process(*command, errors="replace")
        assert done.returncode == 0, done.stderr
    assert r"r\udcff" in (run / "report.html").read_text("utf-8")


def test_an_ads_whose_path_no_evaluation_file_can_hold(tmp_path):
    folder = tmp_path / os.fsdecode(b"s\xff")
    folder.mkdir()
    (folder / "code.py").write_text(CODE)
    status, words = said("run", "--ads", folder / "code.py:mine", "--out", tmp_path / "run")
    assert status == 2
    assert words.startswith("sumo-eval: The path of an ADS must hold text without control")
    assert not (tmp_path / "run").exists()
