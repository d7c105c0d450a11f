"""The fault campaign: faults by the thousand, kills at random moments, broken evaluation files.

`pytest -m campaign`.

SUMO_EVAL_CAMPAIGN_SHARE, default 1, is the share of the full size that is run; the table says what
was run.
"""

import random
import subprocess
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from campaign.mutants import mutant, own_inputs
from campaign_share import SHARE
from commands import sumo_eval as sumo_eval_cli
from record.runs import command, digest, write_evaluation

import sumo_eval
from sumo_eval.record.cases import Case, Setup
from sumo_eval.record.engines import run_cases
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings

ADS = Path(__file__).parent.parent / "record"

# What each fault must be called. A fault of memory can hit SUMO's own allocation, which ends the
# process.
EXPECTED = {
    "raises": {"ads_error"},
    "gives_nan": {"ads_error"},
    "wrong_type": {"ads_error"},
    "hangs": {"ads_timeout"},
    "hangs_in_c": {"timeout"},
    "leaves": {"ads_error"},
    "vanishes": {"crashed"},
    "segfaults": {"crashed"},
    "fills_memory": {"ads_error", "crashed"},
    "chatters": {"collision"},
    "leaves_threads": {"collision"},
    "leaves_a_process": {"collision"},
}

# Faults that cost a limit each, by which they are ended. Eight hang at once: a thousand take five
# minutes, not twenty.
TIGHT = {
    "hangs": {"step_timeout": 0.1},
    "hangs_in_c": {"case_timeout": 2.5, "workers": 8},
}


def size(full):
    return max(1, round(full * SHARE))


@pytest.mark.campaign
@pytest.mark.parametrize("fault", EXPECTED)
def test_faults_by_the_thousand_cost_their_own_cases(fault, capsys):
    concrete = catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20, lead_speed=10)
    limits = RunSettings(workers=2, case_timeout=30.0, step_timeout=5.0, memory_limit=800.0)
    limits = replace(limits, **TIGHT.get(fault, {}))
    number = size(1000)
    cases = [Case(n, concrete, "ads", fault, f"faulty_ads.py:{fault}") for n in range(number)]
    good = [Case(n, concrete, "ads", "idm", "idm") for n in range(number // 10)]
    mixed = random.Random(fault).sample(cases + good, len(cases) + len(good))
    began = time.perf_counter()
    found = list(run_cases(mixed, Setup(SimulationSettings(), limits, ADS)))
    took = time.perf_counter() - began
    ends = Counter(o.status for o in found if o.case.driver == fault)
    beside = Counter(o.status for o in found if o.case.driver == "idm")
    with capsys.disabled():
        print(
            f"\n{fault:<16}{number:>7} cases{took:>8.1f} s  {dict(ends)}; idm beside it: "
            f"{dict(beside)}"
        )
    assert sorted(o.case.key for o in found) == sorted(case.key for case in mixed), (
        "each exactly once"
    )
    assert set(ends) <= EXPECTED[fault]
    assert set(beside) <= {"ok"}


@pytest.mark.campaign
def test_runs_that_are_killed_again_and_again_end_with_the_same_content(tmp_path, capsys):
    kills, folders = kill_and_resume(tmp_path, size(50), levels=4)
    with capsys.disabled():
        print(
            f"\n{kills} kills of {folders} runs: every run ended with the digest of an "
            "uninterrupted one"
        )


def kill_and_resume(tmp_path, wanted, levels):
    """Kill runs `wanted` times at random moments, resume each to its end, compare; how many kills
    and runs it took."""
    path = write_evaluation(tmp_path, levels=levels)
    began = time.perf_counter()
    subprocess.run(
        command("run", path, "--out", tmp_path / "whole"), capture_output=True, check=True
    )
    longest = time.perf_counter() - began
    expected = digest(tmp_path / "whole")
    draw = random.Random(1)
    kills = folders = 0
    while kills < wanted:
        folders += 1
        out = tmp_path / f"killed_{folders}"
        for _ in range(8):
            process = subprocess.Popen(
                command("run", path, "--out", out, "--resume"),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )
            try:
                process.wait(draw.uniform(0.0, longest))
            except subprocess.TimeoutExpired:
                process.kill()
                kills += 1
            _, errors = process.communicate()
            assert b"Traceback" not in errors, errors.decode()
            if process.returncode == 0 or kills == wanted:
                break
        done = subprocess.run(
            command("run", path, "--out", out, "--resume"), capture_output=True, check=False
        )
        assert done.returncode == 0, done.stderr.decode()
        assert digest(out) == expected
    return kills, folders


def run_mutant(number, folder):
    """Run a broken evaluation file; how it ended: refused, scored, incomplete.

    Fails on anything else.
    """
    data, name = mutant(number)
    path, out = folder / f"{number}.toml", folder / f"run_{number}"
    path.write_bytes(data)
    result = sumo_eval_cli("run", path, "--dry-run", status=None)
    if result.returncode == 0 and " with " in result.said and _small(result.said):
        result = sumo_eval_cli("run", path, "--out", out, status=None)
    assert result.returncode in (0, 1, 2, 3), f"{number} {name}: {result.returncode}"
    assert "Traceback" not in result.said, f"{number} {name}"
    if result.returncode == 2:
        assert result.stderr.startswith("sumo-eval: "), f"{number} {name}: {result.said}"
        return "refused"
    if not out.exists():
        return "valid, too large to run here"
    opened = sumo_eval.open_run(out)
    assert (
        opened.scores["cases"].sum() == len(opened.cases) == (opened.drives["role"] == "ads").sum()
    ), f"{number} {name}"
    return "scored" if result.returncode == 0 else "incomplete"


def _small(words):
    drives = [int(word) for word in words.split() if word.isdecimal()]
    return sum(drives[:3]) < 200


def run_own_inputs(number, folder):
    """Check an own scenario, or estimate a run of it: taken, or refused in sentences.

    Fails on anything else.
    """
    files, words, name = own_inputs(number)
    for file, data in files.items():
        (folder / file).write_bytes(data)
    result = sumo_eval_cli(*words, status=None)
    assert result.returncode in (0, 2), f"{number} {name}: {result.returncode}"
    assert "Traceback" not in result.said, f"{number} {name}"
    return "taken" if result.returncode == 0 else "refused"


@pytest.mark.campaign
def test_own_scenarios_networks_tables_and_locators_are_taken_or_refused(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    ends = Counter(run_own_inputs(number, tmp_path) for number in range(size(2000)))
    with capsys.disabled():
        print(f"\n{sum(ends.values())} own inputs: {dict(ends)}")


def test_a_few_own_inputs_are_taken_or_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert {run_own_inputs(number, tmp_path) for number in range(16)} == {"taken", "refused"}


@pytest.mark.campaign
def test_broken_evaluation_files_never_show_a_traceback(tmp_path, capsys):
    ends = Counter()
    faults = []
    for number in range(size(2000)):
        try:
            ends[run_mutant(number, tmp_path)] += 1
        except AssertionError as error:
            faults.append(str(error))
    with capsys.disabled():
        print(f"\n{sum(ends.values())} broken evaluation files: {dict(ends)}; {len(faults)} faults")
        print("\n".join(faults[:20]))
    assert not faults


def test_a_few_broken_evaluation_files_never_show_a_traceback(tmp_path):
    ends = {run_mutant(number, tmp_path) for number in range(12)}
    assert "refused" in ends
