"""Preventability: every case has one verdict beside the reference, and the counts add up to what
the cases say."""

import json
from dataclasses import replace

import pytest
from builders import CALM, LOW_SPEED
from report_cases import with_settings

from sumo_eval.report.tables import scores_json
from sumo_eval.report.words import LOOKS, reference_sentence
from sumo_eval.scoring.preventability import Preventability, preventability, reference_ads, verdicts
from sumo_eval.settings import AdsSettings, ReportSettings

SCENARIO = LOW_SPEED


def against(evaluation, reference):
    return with_settings(evaluation, report=ReportSettings(reference))


def made(evaluation, outcomes, ideal=None):
    """One scenario: for each ADS what became of it point by point.

    -: avoided, X: collided, R: off road, G: given up, E: error of the harness.
    """
    like = evaluation.cases[0]
    cases = []
    for ads, kinds in outcomes.items():
        for number, kind in enumerate(kinds):
            status = {
                "-": "ok",
                "X": "collision",
                "R": "off_road",
                "G": "ads_error",
                "E": "sim_error",
            }[kind]
            cases.append(
                replace(
                    like,
                    case=f"{ads}-{number}",
                    ads=ads,
                    scenario=SCENARIO,
                    values={"ego_speed": float(number)},
                    status=status,
                    collided=kind == "X",
                    ideal_collided=ideal[number] if ideal else None,
                )
            )
    score = evaluation.score(CALM, SCENARIO)
    scores = tuple(replace(score, ads=ads) for ads in outcomes)
    run = replace(evaluation, cases=tuple(cases), scores=scores)
    return with_settings(run, ads=tuple(AdsSettings(ads, ads) for ads in outcomes))


def by_case(evaluation):
    """The verdict on every case, by case."""
    return {
        case.case: verdict
        for score in evaluation.scores
        for case, verdict in zip(
            evaluation.cases_of(score.ads, score.scenario), verdicts(evaluation, score), strict=True
        )
    }


def test_every_pair_of_outcomes_has_its_verdict(evaluation):
    odd = made(evaluation, {"mine": [*"-X-XXXRGE-"], "careful_driver": [*"--XXREX-G-"]})
    found = by_case(odd)
    assert [found[f"mine-{number}"] for number in range(10)] == [
        "avoided", "preventable", "better", "unpreventable", "unpreventable", "undecided",
        "unpreventable",
        "preventable", "not evaluated", "avoided",
    ]  # fmt: skip
    mine, careful = preventability(odd)
    assert mine == Preventability(
        ads="mine", scenario=SCENARIO, cases=10, avoided=3, better=1, incidents=6, preventable=2,
        unpreventable=3,
        undecided=1, not_evaluated=1, collided=4, off_road=1, gave_up=1,
    )  # fmt: skip
    assert careful.collided == 3
    assert careful.incidents == 5
    assert careful.unpreventable == 5
    assert careful.preventable == 0


def test_without_the_named_ads_the_ideal_vehicle_is_the_reference(evaluation):
    odd = made(
        evaluation, {"mine": [*"XXX--"], "idm": [*"X--X-"]}, ideal=[False, True, None, True, None]
    )
    assert reference_ads(odd.settings) is None
    assert [by_case(odd)[f"mine-{number}"] for number in range(5)] == [
        "preventable", "unpreventable", "undecided", "better", "avoided",
    ]  # fmt: skip
    assert "ideal vehicle" in reference_sentence(odd.settings)
    assert "careful_driver" in reference_sentence(odd.settings)


@pytest.mark.parametrize("reference", ["idm", "ideal_braking"])
def test_the_counts_add_up(evaluation, reference):
    odd = against(evaluation, reference)
    found = by_case(odd)
    assert set(found) == {case.case for case in evaluation.cases}
    assert set(found.values()) <= set(LOOKS)
    for row, score in zip(preventability(odd), evaluation.scores, strict=True):
        assert row.ads == score.ads
        assert row.scenario == score.scenario
        assert row.cases == score.cases
        assert row.cases == row.avoided + row.incidents + row.not_evaluated
        assert row.incidents == row.preventable + row.unpreventable + row.undecided
        assert row.collided == score.collisions
        assert row.gave_up == score.gave_up
        assert row.better <= row.avoided


def test_the_reference_is_found_by_name_before_controller(evaluation):
    ads = (AdsSettings("first", "careful_driver"), AdsSettings("careful_driver", "idm"))
    both = replace(evaluation.settings, ads=ads)
    assert reference_ads(both) == "careful_driver"
    assert reference_ads(replace(both, ads=ads[:1])) == "first"
    assert "“first”" in reference_sentence(replace(both, ads=ads[:1]))


def test_scores_json_carries_the_counts_and_the_reference(evaluation):
    plain = json.loads(json.dumps(scores_json(evaluation), allow_nan=False))["preventability"]
    assert plain["reference"] == "ideal vehicle"
    assert [row["preventable"] for row in plain["rows"]] == [
        row.preventable for row in preventability(evaluation)
    ]
    assert scores_json(against(evaluation, "idm"))["preventability"]["reference"] == CALM


def test_no_two_verdicts_look_the_same():
    assert (
        len({look.letter for look in LOOKS.values()})
        == len({look.colour for look in LOOKS.values()})
        == len(LOOKS)
    )
