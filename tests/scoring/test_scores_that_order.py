"""The scores that order ADSs, on real SUMO runs: A, regret, H and S+ follow from the case table,
and are one ADS's."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from evaluations import small
from laid import read_json
from scoring.test_scoring_intervals import HIT, LOST, LOST_SAFE, SAFE, combined

import sumo_eval
from sumo_eval.method.criticality import max_inverse_ttc
from sumo_eval.record.store import open_store
from sumo_eval.report.tables import write_tables
from sumo_eval.results import NotComputed
from sumo_eval.score_notes import Counted
from sumo_eval.scoring.gate_settings import TIMED

CUT_OUT = "front_vehicle_cut_out"


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """`idm` beside one that strikes in the safe zone as well."""
    found = sumo_eval.evaluate(
        small(("idm", "no_reaction", "ideal_braking"), (CUT_OUT,)),
        tmp_path_factory.mktemp("both") / "run",
    )
    write_tables(found)
    return found


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    return sumo_eval.evaluate(small(("idm",), (CUT_OUT,)), tmp_path_factory.mktemp("alone") / "run")


def rows(evaluation, ads):
    return [case for case in evaluation.cases if case.ads == ads]


def facts_of(run):
    """A hash of each of the drives of `idm`, trajectories and all."""
    with open_store(run) as store:
        return [
            store.drive(case)
            for case, _, who in sorted(store.names("ads", CUT_OUT))
            if who == "idm"
        ]


def test_an_unchanged_ads_keeps_every_digit_in_any_company(both, alone):
    assert facts_of(both.folder) == facts_of(alone.folder)
    assert both.score("idm", CUT_OUT) == alone.score("idm", CUT_OUT)
    circumstances = dict.fromkeys(TIMED)
    for together, by_itself in zip(rows(both, "idm"), rows(alone, "idm"), strict=True):
        assert replace(together, **circumstances) == replace(by_itself, **circumstances)


def test_the_references_are_driven_at_every_point(both):
    for case in both.cases:
        assert case.ideal_severity is not None
        assert case.no_reaction_severity is not None
    with open_store(both.folder) as store:
        for role in ("ideal", "no_reaction"):
            assert len(list(store.names(role, CUT_OUT))) == len(rows(both, "idm"))


def test_doing_nothing_has_a_0_and_the_ideal_vehicle_a_1(both):
    nothing, ideal = both.score("no_reaction", CUT_OUT), both.score("ideal_braking", CUT_OUT)
    assert nothing.avoided_share == 0.0
    assert nothing.avoided_share_exposure == 0.0
    assert ideal.avoided_share == 1.0
    assert ideal.avoided_share_exposure == 1.0
    assert ideal.regret == 0.0
    assert ideal.c == 1.0
    assert nothing.regret > both.score("idm", CUT_OUT).regret > 0.0


@pytest.mark.parametrize("ads", ["idm", "no_reaction", "ideal_braking"])
def test_a_and_the_regret_are_those_of_the_case_table(both, ads):
    cases, score = rows(both, ads), both.score(ads, CUT_OUT)
    u = np.array([case.severity or 0.0 for case in cases])
    ideal, nothing = (
        np.array([getattr(case, name) for case in cases])
        for name in ("ideal_severity", "no_reaction_severity")
    )
    for name, weights in (
        ("avoided_share", np.array([case.weight for case in cases])),
        ("avoided_share_exposure", np.array([case.exposure for case in cases])),
    ):
        lost, at_stake = (weights * np.maximum(one - ideal, 0.0) for one in (u, nothing))
        assert getattr(score, name) == pytest.approx(1.0 - lost.sum() / at_stake.sum(), abs=1e-12)
    weights = np.array([case.weight for case in cases])
    assert score.regret == pytest.approx(
        (weights * np.maximum(u - ideal, 0.0)).sum() / weights.sum(), abs=1e-12
    )


@pytest.mark.parametrize("ads", ["idm", "no_reaction"])
def test_h_and_s_plus_are_those_of_the_case_table(both, ads):
    """A safe case with an avoidable collision counts 0, every other the product of its four
    terms."""
    score = both.score(ads, CUT_OUT)
    safe = [case for case in rows(both, ads) if case.zone == "safe"]
    assert bool([case for case in safe if case.collided]) == (ads == "no_reaction")
    likeness = []
    for case in safe:
        if case.collided:
            assert case.human_likeness == 0.0
            likeness.append(0.0)
        else:
            product = case.operation_tolerance * case.mixture_similarity * case.plausibility
            assert case.human_likeness <= product
            likeness.append(case.human_likeness)
    assert score.human_likeness == pytest.approx(np.mean(likeness), abs=1e-12)
    task = np.mean([case.task_share for case in safe])
    assert score.task_share == pytest.approx(task, abs=1e-12)
    grade = 1.0 - np.log1p((1.0 - score.avoided_share) / 0.01) / np.log1p(100.0)
    assert score.avoidance_grade == pytest.approx(grade, abs=1e-12)
    by_hand = task * max(grade, 0.0) * (50.0 + 50.0 * score.human_likeness)
    assert score.s_plus == pytest.approx(by_hand, abs=1e-9)
    assert (score.a_points + score.h_points) == pytest.approx(score.s_plus, abs=1e-9)


def test_after_a_collision_in_the_safe_zone_there_is_no_d_but_there_is_an_h(both):
    score = both.score("no_reaction", CUT_OUT)
    assert score.d is None
    assert score.h_reason is None
    assert score.d_reason == NotComputed("collisions", score.safe_collisions)
    # by hand: likeness 0.6 of exposure 3, and an avoidable collision, 0, of exposure 1: H = 1.8 / 4
    made = combined(
        replace(SAFE, human_likeness=0.6),
        replace(HIT, zone="safe", ideal_severity=0.0, human_likeness=0.0),
    )
    assert (made.d, made.d_reason) == (None, NotComputed("collisions", 1))
    assert made.human_likeness == pytest.approx(0.45)


def test_a_collision_in_the_safe_zone_that_the_ideal_vehicle_has_as_well_does_not_void_d():
    shared = replace(HIT, zone="safe", ideal_severity=4.0)
    made = combined(replace(SAFE, human_likeness=0.6), shared)
    assert made.d == pytest.approx(0.8)
    assert made.human_likeness == 0.6
    assert made.safe_collisions == 1
    assert made.c == pytest.approx(0.4), "it is in C all the same: 4 / 10"
    assert made.not_evaluated == 0
    assert made.notes[0] == Counted("ideal_collides_too", 1, 1)


def test_safe_cases_cut_short_as_decided_are_noted():
    """T counts the road that they did not drive as not driven."""
    made = combined(replace(SAFE, end_reason="decided"), SAFE, replace(HIT, end_reason="decided"))
    assert made.notes == (Counted("cut_short", 1, 2),)


def test_tables_hold_every_name(both):
    scores = read_json(both.folder / "scores.json")["scores"]
    names = (
        "c",
        "d",
        "s",
        "avoided_share",
        "avoided_share_exposure",
        "regret",
        "human_likeness",
        "s_plus",
    )
    for score in scores:
        assert {*names, *(f"{name}_interval" for name in names)} <= set(score)
    with (both.folder / "cases.csv").open() as file:
        table = list(csv.DictReader(file))
    assert {
        "d_i",
        "index",
        "plausibility",
        "human_likeness",
        "no_reaction_severity",
        "ideal_severity",
        "recorded_drivers",
    } <= set(table[0])
    for row in table:
        assert row["d_i"] == row["index"]
        assert row["ideal_severity"] != ""
        assert row["no_reaction_severity"] != ""
        assert row["weight"] != ""


def test_the_zone_of_every_case_is_the_criterions_own(both):
    for case in rows(both, "idm"):
        values = case.values
        worst = max_inverse_ttc(
            values["ego_speed"], values["obstacle_speed"], values["gap"], delay=1.0
        )
        assert (case.zone == "hazardous") == bool(worst >= 0.7)


def test_nothing_evaluated_gives_no_score():
    nothing = combined(LOST, LOST_SAFE)
    assert nothing.c is None
    assert nothing.d is None
    assert nothing.s is None
    assert nothing.avoided_share is None
    assert nothing.human_likeness is None
    assert nothing.s_plus is None
