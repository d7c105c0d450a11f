"""A ladder of real ADSs of known order: whoever is no worse in any case and better in one has the higher A."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest

from sumo_eval.settings import SamplingSettings, ScenarioSettings

TIED = 0.02  # share of the pairs that A may tie


@pytest.fixture(scope="module")
def ladder() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "tools" / "ladder.py"
    spec = importlib.util.spec_from_file_location("ladder", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def of_a(table: pd.DataFrame) -> pd.Series:
    return table[(table["scenario"] == "all") & (table["score"] == "A")].iloc[0]


def assert_a_orders(table: pd.DataFrame, least: int) -> None:
    a = of_a(table)
    assert a["pairs"] >= least
    assert a["wrong"] == a["without a score"] == 0
    assert a["tied"] <= TIED * a["pairs"]


def test_five_rungs_stand_in_their_order(ladder: ModuleType, tmp_path: Path) -> None:
    Rung = ladder.Rung
    rungs = (Rung(0.2, 8, 80, 0), Rung(0.6, 8, 80, 0), Rung(1.2, 8, 80, 0), Rung(2.0, 8, 25, 0), Rung(2.0, 4, 25, 0))
    assert set(rungs) <= set(ladder.RUNGS)
    spaces = (ScenarioSettings("front_vehicle_braking", SamplingSettings(levels=2)),)
    evaluation = ladder.climb(rungs, spaces, tmp_path / "run")
    pairs = ladder.ordered_pairs(evaluation)
    built = {(rungs[i].name, rungs[j].name) for i in range(5) for j in range(i + 1, 5)}
    assert {(pair.better, pair.worse) for pair in pairs} <= built, "later, weaker and blinder is never better"
    assert_a_orders(ladder.table(pairs), least=8)


def test_a_pair_counts_as_ordered_tied_wrong_or_without_a_score(ladder: ModuleType) -> None:
    better = {"C": 1, "S": 0, "A": 1, "S+": None}
    pairs = [ladder.Pair("here", "one", "other", better), ladder.Pair("there", "one", "other", {**better, "S": -1})]
    table = ladder.table(pairs).set_index(["scenario", "score"])
    assert table.loc[("all", "S")].tolist() == [2, 0, 1, 1, 0]
    assert table.loc[("here", "C")].tolist() == [1, 1, 0, 0, 0]
    assert table.loc[("all", "S+")].tolist() == [2, 0, 0, 0, 2]


@pytest.mark.campaign
def test_a_orders_the_whole_ladder(ladder: ModuleType, tmp_path: Path) -> None:
    assert len(ladder.RUNGS) >= 20
    evaluation = ladder.climb(ladder.RUNGS, ladder.SPACES, tmp_path / "run")
    assert 90 * len(ladder.RUNGS) <= len(evaluation.cases) <= 104 * len(ladder.RUNGS)
    table = ladder.table(ladder.ordered_pairs(evaluation))
    assert_a_orders(table, least=300)
    by_score = table[table["scenario"] == "all"].set_index("score")
    assert by_score.loc["C", "tied"] > 0.5 * by_score.loc["C", "pairs"], "why A stands beside C"
    assert by_score.loc["S", "wrong"] > 0, "why S+ stands beside S"
