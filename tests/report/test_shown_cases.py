"""A page of more cases than it can hold: what it leaves out, what it shows of all, and how a case
is found."""

import json
import re
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import CALM, CUT_OUT, HOSTILE
from packed_pages import unpacked
from refusals import refusal

from sumo_eval.case_table import CaseTable
from sumo_eval.report.density import TILES, density_maps
from sumo_eval.report.html import write_report
from sumo_eval.report.terminal import nearest_cases
from sumo_eval.scoring import shown_cases as module
from sumo_eval.scoring.behaviour import least_human, ranked, worst_case
from sumo_eval.scoring.failure_groups import failure_kinds
from sumo_eval.scoring.nearest import nearest
from sumo_eval.scoring.shown_cases import shown_cases


@pytest.fixture
def most(evaluation, monkeypatch):
    """Four cases of each score, the most that a page shows."""
    monkeypatch.setattr(module, "MOST_SHOWN", found := 4 * len(evaluation.scores))
    return found


def test_a_page_that_holds_all_cases_leaves_none_out(evaluation):
    for name, places in shown_cases(evaluation).items():
        most = max(len(evaluation.cases_of(one.ads, name)) for one in evaluation.scores_in(name))
        assert places.tolist() == list(range(most))


def test_half_of_the_shown_cases_tell_most_half_lie_evenly(evaluation, most):
    for name, shown in shown_cases(evaluation).items():
        assert len(shown) == len(set(shown.tolist())) == 4
        tells = np.any(
            [
                [case.collided or not case.evaluated for case in evaluation.cases_of(one.ads, name)]
                for one in evaluation.scores_in(name)
            ],
            axis=0,
        )
        assert sum(tells[shown]) >= min(2, sum(tells))


def test_linked_cases_are_on_the_page(evaluation, most):
    shown = {name: set(places.tolist()) for name, places in shown_cases(evaluation).items()}
    left_out = [
        case.case
        for score in evaluation.scores
        for place, case in enumerate(evaluation.cases_of(score.ads, score.scenario))
        if place not in shown[score.scenario]
    ]
    order = [one.ads for one in ranked(evaluation)]
    linked = worst_case(evaluation, order), least_human(evaluation, order[0])
    assert not {one.case for one in linked if one}.intersection(left_out)
    for name in left_out[:2]:
        found = shown_cases(evaluation, [name])
        assert any(
            name == case.case
            for score in evaluation.scores
            for case in evaluation.cases_of(score.ads, score.scenario)[found[score.scenario]]
        )


@pytest.mark.parametrize("number", [3, 6])
def test_all_named_cases_are_on_the_page(evaluation, most, number):
    """More of a scenario than the half that weighs most, and more than a page's share of it."""
    score = evaluation.scores[-1]
    cases = evaluation.cases_behind(score)
    named = cases.case[np.arange(number) * len(cases) // number]
    shown = shown_cases(evaluation, named.tolist())[score.scenario]
    assert set(named) <= set(cases[shown].case)


def test_a_missing_s_plus_comes_last_without_a_ranking():
    values = 0.0, None, 0.5
    scores = [SimpleNamespace(ads=it, s_plus=it, s_plus_interval=None) for it in values]
    order = ranked(SimpleNamespace(ranking=None, ads_names=values, scores=scores))
    assert [it.s_plus for it in order] == [0.5, 0.0, None]


def test_the_page_says_what_it_leaves_out_and_draws_where_all_cases_lie(
    evaluation, partitions, most, tmp_path
):
    shutil.copytree(evaluation.folder, tmp_path / "run")
    page = write_report(replace(evaluation, folder=tmp_path / "run"), partitions).read_text()
    data = json.loads(unpacked(page, "report-data"))
    assert sum(len(scenario["cases"]) for scenario in data["scenarios"]) == most
    told = re.findall(r"This page has (\d+) of (\d+) cases", page)
    assert np.array(told, int).sum(axis=0).tolist() == [most, len(evaluation.cases)]
    assert page.count('<svg class="density" data-chart="') == 2 * len(evaluation.scores), (
        "each can be saved"
    )
    for scenario in data["scenarios"]:
        here = {case["key"] for case in scenario["cases"]}
        assert all(here.issuperset(group["cases"]) for group in scenario["groups"]), (
            "links lead to cases that are here"
        )
        failed = np.count_nonzero(failure_kinds(evaluation.cases_in(scenario["name"]))[0])
        assert sum(group["size"] for group in scenario["groups"]) == failed, (
            "those that are left out count"
        )


def test_tiles_hold_every_case_once_and_shares_are_of_those_that_collided(evaluation, partitions):
    name = CUT_OUT
    logical, cases = partitions[name].logical, evaluation.cases_of(HOSTILE, name)
    places = {
        tuple(
            np.clip(
                (logical.to_unit(logical.row(case.values))[[0, 1]] * TILES).astype(int),
                0,
                TILES - 1,
            )
        )
        for case in cases
    }
    (words, number), (share_words, share) = density_maps(logical, cases, 0, 1)
    assert number.count("<rect") == len(places)
    assert sum(json.loads(row)[2] for row in re.findall(r'data-row="([^"]*)"', number)) == len(
        cases
    )
    assert 0 < share.count("<rect") <= sum(case.collided for case in cases)
    assert words.startswith("how many cases, up to ")
    assert share_words.startswith("share of them that collided, up to ")


def test_a_case_is_found_by_some_of_its_parameters(evaluation):
    case = [one for one in evaluation.cases if one.ads == CALM][2]
    some = dict(list(case.values.items())[:2])
    head, first, *_ = nearest_cases(nearest(evaluation, some, case.ads, case.scenario, 3))
    assert head.startswith(f"{case.ads} in {case.scenario}, ")
    assert all(f"{name}={value:g}" in first for name, value in some.items())
    lines = nearest_cases(nearest(evaluation, dict(case.values), None, case.scenario, 1))
    assert case.case in {line.split(":")[0].strip() for line in lines}
    scores = [it for it in evaluation.scores if (it.ads, it.scenario) != (case.ads, case.scenario)]
    few = replace(evaluation, scores=tuple(scores))  # as where `run.only` names cases
    heads = [
        line for line in nearest_cases(nearest(few, some, None, case.scenario, 1)) if line[0] != " "
    ]
    assert heads
    assert not any(line.startswith(f"{case.ads} in") for line in heads)
    # `$_$` is no formula of matplotlib
    dollars = [replace(score, ads=f"$_$ {score.ads}") for score in scores]
    assert replace(few, scores=tuple(dollars)).plot()._repr_png_()


@pytest.mark.parametrize(
    "values, ads, words",
    [
        ({"gapp": 1.0}, None, "gapp"),
        ({"ego_speed": 1.0}, "nobody", "Unknown ADS"),
        ({"ego_speed": np.nan}, None, "finite"),
    ],
)
def test_what_the_run_does_not_have_is_said(evaluation, values, ads, words):
    with refusal(words):
        list(nearest_cases(nearest(evaluation, values, ads, None, 1)))


def test_a_departure_tells_as_much_as_a_collision(evaluation):
    calm = next(case for case in evaluation.cases if case.evaluated and not case.incident)
    rows = [
        replace(calm, human_likeness=None, departure_time=1.0, departure_severity=speed)
        for speed in (20.0, 10.0)
    ]
    tells = module.case_weights(CaseTable.of([calm, *rows]), ())
    assert tells[1] > tells[2] >= 2.0 > tells[0]
