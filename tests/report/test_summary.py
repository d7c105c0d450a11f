"""The first screen and the groups of failures, on evaluations made by hand."""

from __future__ import annotations

from dataclasses import replace
from urllib.parse import unquote

import builders
import numpy as np

from sumo_eval.report.failure_groups import failure_groups
from sumo_eval.report.summary import summary_content
from sumo_eval.results import Evaluation, RankedAds, RankedPair, Ranking
from sumo_eval.scenario import catalogue


def ranked(evaluation: Evaluation, interval: tuple[float, float], *, told_apart: bool) -> Evaluation:
    first, second = builders.CALM, builders.HOSTILE
    ads = (RankedAds(first, 1, 60.0, (55.0, 66.0)), RankedAds(second, 2 if told_apart else 1, 50.0, (44.0, 57.0)))
    pair = RankedPair(first, second, 10.0, interval, told_apart)
    return replace(evaluation, ranking=Ranking({}, 0.95, ads, (pair,)))


def answers(evaluation: Evaluation) -> dict[str, tuple[str, str]]:
    found = summary_content(evaluation, None, ())["answers"]
    return {one.question: (one.short, " ".join(one.sentences)) for one in found}


def test_the_best_is_named_and_the_difference_is_real_where_the_interval_leaves_out_zero(
    evaluation: Evaluation,
) -> None:
    told = answers(ranked(evaluation, (4.0, 16.0), told_apart=True))
    assert told["Which ADS is best?"][0] == builders.CALM
    assert told["Is the difference real?"][0] == "yes"
    assert "10.0 points above" in told["Is the difference real?"][1]
    assert "(4.0 to 16.0)" in told["Is the difference real?"][1]


def test_who_cannot_be_told_apart_shares_the_place(evaluation: Evaluation) -> None:
    told = answers(ranked(evaluation, (-2.0, 22.0), told_apart=False))
    assert told["Which ADS is best?"][0] == "2 share the first place"
    assert told["Is the difference real?"][0] == "it may be chance"
    alike = answers(ranked(evaluation, (0.0, 0.0), told_apart=False))["Is the difference real?"]
    assert alike == ("there is none", f"{builders.HOSTILE} drove every case as {builders.CALM} did.")


def test_an_ads_with_avoidable_collisions_is_not_called_good(evaluation: Evaluation) -> None:
    own = [score for score in evaluation.scores if score.ads == builders.CALM]
    (short, words) = answers(ranked(evaluation, (4.0, 16.0), told_apart=True))[f"Is {builders.CALM} good?"]
    avoidable = sum(score.avoidable_collisions for score in own)
    assert (short == "it has avoidable collisions") == (avoidable > 0)
    assert f"{avoidable} collision" in words or not avoidable


def test_what_to_look_at_leads_to_cases_of_the_run(evaluation: Evaluation) -> None:
    look = next(one for one in summary_content(evaluation, None, ())["answers"] if "look at" in one.question)
    keys = {case.case for case in evaluation.cases}
    targets = [unquote(address.removeprefix("#case:")) for _, address in look.looks if address.startswith("#case:")]
    assert targets
    assert set(targets) <= keys
    assert any(address == "#missing" for _, address in look.looks)


def test_failures_next_to_each_other_are_one_group_and_far_ones_another(evaluation: Evaluation) -> None:
    """On a 9 x 9 grid, collisions in two corners: 4 cases at small, 4 at large values of both parameters."""
    logical = catalogue.load("front_vehicle_low_speed")
    model = next(case for case in evaluation.cases if case.scenario == logical.name and not case.collided)
    unit = np.linspace(0.0, 1.0, 9)
    cases = []
    for i, x in enumerate(unit):
        for j, y in enumerate(unit):
            values = dict(zip(logical.names, logical.from_unit(np.array([[x, y]]))[0].tolist(), strict=True))
            hit = (i < 2 and j < 2) or (i > 6 and j > 6)
            new = replace(
                model, case=f"c{i}{j}", values=values, status="ok", collided=hit, severity=5.0 if hit else None,
                ideal_severity=0.0, ideal_collided=False, no_reaction_severity=9.0, index=None,
            )  # fmt: skip
            cases.append(new)
    groups = failure_groups(logical, cases)
    assert [len(group.places) for group in groups] == [4, 4]
    assert all((group.alike, group.inside) == (4, 4) for group in groups)
    failed = {place for place, case in enumerate(cases) if case.collided}
    assert set(groups[0].places.tolist()) | set(groups[1].places.tolist()) == failed
    low = next(group for group in groups if 0 in group.places)
    step = (logical.high - logical.low)[0] / 8.0
    assert low.ranges[logical.names[0]] == (logical.low[0], logical.low[0] + step)
