"""Real SUMO runs in child processes: one fault costs one case, the rest is untouched, the order is kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from sumo_eval.batch.cases import Case, Outcome, Setup
from sumo_eval.batch.engines import run_cases
from sumo_eval.batch.store import pack
from sumo_eval.cosim import simulate
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings

FAULTS = """
import os, time
from sumo_eval import Command

def coast(traci, ego, time): return Command(0.0)
def raises(traci, ego, t): raise ValueError("no path found")
def gives_nan(traci, ego, t): return Command(float("nan"))
def wrong_type(traci, ego, t): return "brake"
def leaves(traci, ego, t): raise SystemExit(3)
def vanishes(traci, ego, t): os._exit(7)
def hangs(traci, ego, t):
    while True: pass
def slow(traci, ego, t): time.sleep(0.3)
class NeedsArguments:
    def __init__(self, model): pass
    def step(self, traci, ego, t): pass
"""

CONCRETE = catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20, lead_speed=10)


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Outcome]:
    folder = tmp_path_factory.mktemp("ads")
    (folder / "faults.py").write_text(FAULTS)
    names = [
        "coast",
        "raises",
        "gives_nan",
        "wrong_type",
        "leaves",
        "vanishes",
        "hangs",
        "slow",
        "NeedsArguments",
        "idm",
    ]
    cases = [
        Case(number, CONCRETE, "ads", name, name if name == "idm" else f"faults.py:{name}")
        for number, name in enumerate(names)
    ]
    setup = Setup(SimulationSettings(), RunSettings(workers=2, case_timeout=6.0, step_timeout=0.2), folder)
    found = list(run_cases(cases, setup))
    assert [outcome.case.driver for outcome in found] == names, "outcomes come in the order of the cases"
    return {outcome.case.driver: outcome for outcome in found}


@pytest.mark.parametrize(
    ("name", "status", "sentence"),
    [
        ("raises", "ads_error", "The ADS raised at 0.00 s: ValueError: no path found."),
        ("gives_nan", "ads_error", "`acceleration` of the ADS's Command must be a finite number, got nan at 0.00 s."),
        ("wrong_type", "ads_error", "The ADS must return a Command or None, got str at 0.00 s."),
        ("leaves", "ads_error", "The ADS raised at 0.00 s: SystemExit: 3."),
        ("vanishes", "crashed", "The process that ran the case died with exit code 7."),
        ("hangs", "timeout", "The case took longer than 6 s of wall time."),
        ("slow", "ads_timeout", "The ADS must answer within 0.2 s"),
        ("NeedsArguments", "rejected", "making one without arguments failed"),
    ],
)
def test_a_faulty_ads_costs_its_own_case_and_the_row_says_why(
    outcomes: dict[str, Outcome], name: str, status: str, sentence: str
) -> None:
    assert outcomes[name].status == status
    assert sentence in (outcomes[name].error or "")


def test_the_traceback_of_an_exception_is_kept(outcomes: dict[str, Outcome]) -> None:
    assert "faults.py" in outcomes["raises"].log


def test_cases_beside_faulty_ones_are_what_they_are_alone(outcomes: dict[str, Outcome]) -> None:
    for name in ("coast", "idm"):
        outcome = outcomes[name]
        assert outcome.recording is not None
        controller = "idm" if name == "idm" else lambda traci, ego, time: _coast()
        alone = simulate(CONCRETE, controller)
        assert pack(outcome.recording.ego) == pack(alone.ego), "bit for bit"
    assert outcomes["coast"].status == "collision"
    assert outcomes["idm"].status == "ok"


def _coast():
    from sumo_eval import Command

    return Command(0.0)


@pytest.mark.parametrize("workers", [1, 3])
def test_the_number_of_workers_changes_no_byte(workers: int) -> None:
    space = catalogue.load("front_vehicle_low_speed")
    cases = [
        Case(number, space.concrete(ego_speed=speed, lead_speed=5), "human", "driver_00", "synthetic", 0, 4, 11)
        for number, speed in enumerate((10, 20, 30))
    ]
    setup = Setup(SimulationSettings(), RunSettings(workers=workers), Path.cwd())
    bytes_found = [pack(outcome.recording.ego) for outcome in run_cases(cases, setup) if outcome.recording]
    setup_one = Setup(SimulationSettings(), RunSettings(workers=2), Path.cwd())
    backwards = [pack(outcome.recording.ego) for outcome in run_cases(cases[::-1], setup_one) if outcome.recording]
    assert bytes_found == backwards[::-1]
    assert len({len(data) for data in bytes_found}) > 1, "three different drives"
