"""The first screen and the groups of failures, on evaluations made by hand."""

from dataclasses import replace
from urllib.parse import unquote

import builders
import numpy as np

from sumo_eval.cases import CaseTable
from sumo_eval.report.headline import headline
from sumo_eval.report.summary import summary_content
from sumo_eval.report.verdict import Additions
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.behaviour import worst_case
from sumo_eval.scoring.failure_groups import failure_groups


def test_worst_case_of_the_best_ads_comes_first(evaluation):
    """The case that takes most from A; without any the least human-like one."""
    for ads in (builders.CALM, builders.HOSTILE):
        worst = worst_case(evaluation, [ads])
        assert worst.ads == ads
        assert (worst.incident_severity or 0.0) > (worst.ideal_severity or 0.0)
    calm = [case for case in evaluation.cases if case.ads == builders.CALM and not case.incident]
    least = worst_case(replace(evaluation, cases=tuple(calm)), [builders.CALM])
    assert least.human_likeness == min(
        case.human_likeness for case in calm if case.human_likeness is not None
    )


def test_first_screen_says_what_the_terminal_says(evaluation):
    shown, said = summary_content(evaluation, Additions()), headline(evaluation)
    assert (shown["answers"], shown["alarms"]) == (said.answers, said.alarms)
    assert shown["alarms"]


def test_departures_stand_beside_collisions(evaluation):
    left = replace(
        evaluation, scores=tuple(replace(score, departures=2) for score in evaluation.scores)
    )
    for row in summary_content(left, Additions())["rows"]:
        assert (
            row["of"].departures == 2 * sum(score.ads == row["of"].ads for score in left.scores) > 0
        )
    gone = [case for case in evaluation.cases if case.evaluated and not case.incident]
    alone = replace(evaluation, cases=tuple(replace(case, departure_time=1.0) for case in gone))
    assert "#maps" in dict(summary_content(alone, Additions())["looks"]).values()


def test_what_to_look_at_leads_to_cases_of_the_run(evaluation):
    looks = summary_content(evaluation, Additions())["looks"]
    keys = {case.case for case in evaluation.cases}
    targets = [
        unquote(address.removeprefix("#case:"))
        for _, address in looks
        if address.startswith("#case:")
    ]
    assert targets
    assert set(targets) <= keys
    assert any(address == "#missing" for _, address in looks)


def test_failures_next_to_each_other_are_one_group_and_far_ones_another(evaluation):
    """On a 9 x 9 grid, collisions in two corners: 4 cases at small, 4 at large values of both
    parameters."""
    logical = catalogue.load("front_vehicle_low_speed")
    model = next(
        case for case in evaluation.cases if case.scenario == logical.name and not case.collided
    )
    unit = np.linspace(0.0, 1.0, 9)
    cases = []
    for i, x in enumerate(unit):
        for j, y in enumerate(unit):
            values = dict(
                zip(logical.names, logical.from_unit(np.array([[x, y]]))[0].tolist(), strict=True)
            )
            hit = (i < 2 and j < 2) or (i > 6 and j > 6)
            new = replace(
                model, case=f"c{i}{j}", values=values, status="ok", collided=hit,
                severity=5.0 if hit else None,
                ideal_severity=0.0, ideal_collided=False, no_reaction_severity=9.0, index=None,
            )  # fmt: skip
            cases.append(new)
    groups = failure_groups(logical, CaseTable.of(cases))
    assert [len(group.places) for group in groups] == [4, 4]
    assert all((group.alike, group.inside) == (4, 4) for group in groups)
    failed = {place for place, case in enumerate(cases) if case.collided}
    assert set(groups[0].places.tolist()) | set(groups[1].places.tolist()) == failed
    low = next(group for group in groups if 0 in group.places)
    step = (logical.high - logical.low)[0] / 8.0
    assert low.ranges[logical.names[0]] == (logical.low[0], logical.low[0] + step)
