"""Small evaluations on disk, and commands on them."""

import sqlite3
import sys
from contextlib import closing
from pathlib import Path

from commands import sumo_eval as sumo_eval_cli  # noqa: F401 - as those who write runs call it

import sumo_eval
from sumo_eval.record.cases import Case, Setup
from sumo_eval.record.engines import run_cases
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings

HERE = Path(__file__).parent
SPACE = catalogue.load("front_vehicle_low_speed")
CONCRETE = SPACE.concrete(ego_speed=20, lead_speed=10)
EVALUATION = """
name = "batch"
seed = 5
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = {levels}
[[ads]]
name = "mine"
controller = "my_ads.py:MyAds"
[[ads]]
name = "idm"
controller = "idm"
[drivers]
count = 2
[run]
workers = 2
case_timeout = {case_timeout}
"""

MY_ADS = """
import random
from sumo_eval import Command

class MyAds:
    def step(self, traci, ego, time):
        return Command(random.uniform(-2.0, 0.5))
"""


def write_evaluation(folder, ads=MY_ADS, levels=3, case_timeout=20.0):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "my_ads.py").write_text(ads)
    path = folder / "evaluation.toml"
    path.write_text(EVALUATION.format(levels=levels, case_timeout=case_timeout))
    return path


def command(*arguments):
    return [sys.executable, "-m", "sumo_eval", *map(str, arguments)]


def rows(run):
    """Rows in the facts of a run that may still be in the making."""
    try:
        address = f"file:{run / 'facts.sqlite'}?mode=ro"
        with closing(sqlite3.connect(address, uri=True)) as connection:
            return int(connection.execute("SELECT count(*) FROM facts").fetchone()[0])
    except sqlite3.Error:
        return 0


def digest(folder):
    return sumo_eval.open_run(folder).digest()


def limited(folder=HERE, **limits):
    return Setup(SimulationSettings(), RunSettings(**limits), folder)


def cases_of(ads, number=1):
    return [Case(point, CONCRETE, "ads", ads, ads) for point in range(number)]


def each_once(cases, **limits):
    """The outcomes of cases, each exactly once."""
    found = list(run_cases(cases, limited(**limits)))
    assert sorted(outcome.case.key for outcome in found) == sorted(case.key for case in cases)
    return found
