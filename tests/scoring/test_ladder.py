"""A ladder of real ADSs of known order: whoever is no worse in any case and better in one has the
higher A."""

from itertools import permutations, product

import numpy as np
import pytest
from loaded import load
from road_scenes import severities

from sumo_eval.method.score_terms import avoided_share, once
from sumo_eval.scenario import catalogue

TIED = 0.02  # share of the pairs that A may tie


@pytest.fixture(scope="module")
def ladder():
    return load("tools/ladder.py")


def assert_a_orders(table, least):
    a = table[(table["scenario"] == "all") & (table["score"] == "A")].iloc[0]
    assert a["pairs"] >= least
    assert a["wrong"] == a["without a score"] == 0
    assert a["tied"] <= TIED * a["pairs"]


def test_five_rungs_stand_in_their_order(ladder):
    # without the people and the pool of a whole evaluation, which the campaign below has
    Rung = ladder.Rung
    rungs = (
        Rung(0.2, 8, 80, 0),
        Rung(0.6, 8, 80, 0),
        Rung(1.2, 8, 80, 0),
        Rung(2.0, 8, 25, 0),
        Rung(2.0, 4, 25, 0),
    )
    assert set(rungs) <= set(ladder.RUNGS)
    logical = catalogue.load("front_vehicle_braking")
    corners = logical.from_unit(np.array(list(product((0.0, 1.0), repeat=len(logical.names)))))
    cases = list(logical.concretes(corners))
    ideal, unreacting = severities(cases, "ideal_braking"), severities(cases, "no_reaction")
    driven = [severities(cases, getattr(ladder, rung.identifier)) for rung in rungs]
    shares = [
        float(avoided_share(one, ideal, unreacting, np.ones(len(cases)), once(len(cases)))[0])
        for one in driven
    ]
    pairs = 0
    for i, j in permutations(range(len(rungs)), 2):
        gains = driven[j] - driven[i]
        if gains.min() >= -ladder.EQUAL and gains.max() > ladder.EQUAL:
            assert i < j, "later, weaker and blinder is never better"
            assert shares[i] > shares[j], (rungs[i].name, rungs[j].name)
            pairs += 1
    assert pairs >= 8


def test_a_pair_counts_as_ordered_tied_wrong_or_without_a_score(ladder):
    better = {"C": 1, "S": 0, "A": 1, "A'": 1, "S+": None}
    pairs = [
        ladder.Pair("here", "one", "other", better),
        ladder.Pair("there", "one", "other", {**better, "S": -1}),
    ]
    table = ladder.table(pairs).set_index(["scenario", "score"])
    assert table.loc[("all", "S")].tolist() == [2, 0, 1, 1, 0]
    assert table.loc[("here", "C")].tolist() == [1, 1, 0, 0, 0]
    assert table.loc[("all", "S+")].tolist() == [2, 0, 0, 0, 2]


@pytest.mark.campaign
def test_a_orders_the_whole_ladder(ladder, tmp_path):
    assert len(ladder.RUNGS) >= 30
    evaluation = ladder.climb(ladder.RUNGS, ladder.SPACES, tmp_path / "run")
    assert 90 * len(ladder.RUNGS) <= len(evaluation.cases) <= 104 * len(ladder.RUNGS)
    table = ladder.table(ladder.ordered_pairs(evaluation))
    assert_a_orders(table, least=300)
    by_score = table[table["scenario"] == "all"].set_index("score")
    assert by_score.loc["C", "tied"] > 0.5 * by_score.loc["C", "pairs"], "why A stands beside C"
    assert by_score.loc["S", "wrong"] > 0, "why S+ stands beside S"
