"""The first words of a run: worked numbers, and an alarm for each thing that must not be missed."""

import re
import tomllib
from dataclasses import replace
from urllib.parse import unquote

import numpy as np
import pytest
import report_cases
from builders import CALM, CUT_OUT, HOSTILE, LOW_SPEED

from sumo_eval.case_table import CaseTable
from sumo_eval.report.headline import headline, safety_words
from sumo_eval.report.summary import summary_content
from sumo_eval.report.verdict import Additions
from sumo_eval.results import RankedAds, RankedPair, Ranking
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.behaviour import behaviour_of, harm_beside, worst_case
from sumo_eval.scoring.failure_groups import failure_groups, failure_kinds
from sumo_eval.scoring.findings import findings_of
from sumo_eval.scoring.ledger import ledger_plus
from sumo_eval.scoring.quantities import combine

NAME = CUT_OUT
UNRANKED = Ranking({}, 0.95, (), ())


def of_one_scenario(evaluation, cases):
    """Some cases of CALM and HOSTILE in one scenario, with the counts of their scores made anew."""
    scores = []
    for score in evaluation.scores:
        own = [case for case in cases if case.ads == score.ads]
        if score.scenario == NAME and own:
            scores.append(combine(score.ads, NAME, own, evaluation.settings.method))
    return replace(evaluation, scores=tuple(scores), cases=tuple(cases))


def safety(run):
    return safety_words(run, behaviour_of(run, CALM))


def clean(evaluation, ads, number=4):
    """So many safe cases of an ADS without an incident, at points of their own."""
    own = [case for case in evaluation.cases if case.ads == CALM]
    model = next(case for case in own if case.zone == "safe" and not case.incident)
    parameter = next(iter(model.values))
    return [
        replace(model, case=f"{ads}{place}", ads=ads, scenario=NAME, status="ok", exposure=1.0,
            task_share=1.0,
                values={**model.values, parameter: float(place)})
        for place in range(number)
    ]  # fmt: skip


HIT = report_cases.HIT | {"severity": 12.0, "impact_speed": 12.0}
ALARMS = {
    **tomllib.loads("""
"left the road in 1 case" = { departure_time = 1.0, departure_speed = 20.0, departure_severity = 20.0 }
"gave up 1 case" = { status = "ads_error", no_reaction_severity = 9.0 }
"stands in 1 safe case where the references drive on" = { task_share = 0.4, end_reason = "standstill" }
"slower than the slowest reference in 1 safe case" = { task_share = 0.9, end_reason = "road_end" }
"1 case not evaluated" = { status = "sim_error" }
"""),
    "1 avoidable collision": HIT,
}


@pytest.mark.parametrize("words", ALARMS)
def test_each_alarm_is_raised_by_one_case(evaluation, words):
    first, *rest = clean(evaluation, CALM)
    assert headline(of_one_scenario(evaluation, [first, *rest])).alarms == ()
    odd = headline(of_one_scenario(evaluation, [replace(first, **ALARMS[words]), *rest]))
    ((ads, said),) = odd.alarms
    assert ads == CALM
    assert words in said


def test_alarm_of_what_no_recorded_person_does_in_most_cases(evaluation):
    for number, alarmed in ((2, False), (3, True)):
        first, rest = clean(evaluation, CALM)[:number], clean(evaluation, CALM)
        odd = [replace(case, plausibility=0.0) for case in first] + rest[number:]
        alarms = headline(of_one_scenario(evaluation, odd)).alarms
        assert alarms == ((CALM, "unlike any recorded person in 3 safe cases"),) * alarmed


def test_alarm_and_ledger_count_the_same_standing_cases(evaluation):
    """A case that stands just before the end of the way is in neither."""
    shares = (0.4, 0.9, 0.995, 1.0)
    stands = [
        replace(case, task_share=share, end_reason="standstill")
        for case, share in zip(clean(evaluation, CALM), shares, strict=True)
    ]
    odd = of_one_scenario(evaluation, stands)
    (found,) = findings_of(odd)
    lines = {line.cause: line.cases for line in ledger_plus(found).lines}
    assert lines["stands where the references drive"] == behaviour_of(odd, CALM).stands == 2


def test_safety_in_a_test_engineers_words(evaluation):
    """One hit of 12 m/s = 43 km/h in 4 cases: mean excess 3 m/s, 50 / 3.6 / 3 = 4.6 cases a
    contact."""
    first, *rest = clean(evaluation, CALM)
    one = of_one_scenario(evaluation, [replace(first, **HIT), *rest])
    assert safety(one) == (
        "1 avoidable collision in 4 cases, worst 43 km/h; "
        "as much excess impact speed as one 50 km/h contact every 5 cases of this grid"
    )
    # a scenario without an evaluated case takes nothing from it
    lost = replace(first, scenario=LOW_SPEED, status="sim_error")
    scores = (*one.scores, replace(one.scores[0], scenario=lost.scenario))
    both = replace(one, scores=scores, cases=(*one.cases, lost))
    assert behaviour_of(both, CALM).excess == 3.0
    # the ideal vehicle hits as well, by 6 m/s
    softer = {"ideal_severity": 6.0, "ideal_collided": True}
    harder = of_one_scenario(evaluation, [replace(first, **HIT | softer), *rest])
    assert safety(harder) == (
        "no avoidable collision in 4 cases, yet as much impact speed above the ideal vehicle's "
        "as one 50 km/h contact every 9 cases of this grid"
    )
    # 27.8 m/s in every case
    fast = [replace(case, **HIT | {"severity": 100.0 / 3.6}) for case in (first, *rest)]
    every = of_one_scenario(evaluation, fast)
    assert safety(every).endswith(
        "as much excess impact speed as 2.0 contacts at 50 km/h a case of this grid"
    )
    none = of_one_scenario(evaluation, [first, *rest])
    assert safety(none) == "no avoidable collision in 4 cases"


@pytest.mark.parametrize("hits, words", [(5, "Not told apart"), (6, "Told apart")])
def test_sign_test_tells_the_safest_apart(evaluation, hits, words):
    """2 x 0.5^5 = 0.063 is chance, 2 x 0.5^6 = 0.031 is not."""
    calm, hostile = (clean(evaluation, ads, 8) for ads in (CALM, HOSTILE))
    hostile = [replace(case, **HIT) if place < hits else case for place, case in enumerate(hostile)]
    both = of_one_scenario(evaluation, [*calm, *hostile])
    assert harm_beside(both, CALM, HOSTILE) == (hits, 0, 8)
    worse = tuple(
        replace(one, avoidance_grade=1.0 if one.ads == CALM else 0.5, s_plus=None)
        for one in both.scores
    )
    answer = dict(headline(replace(both, scores=worse, ranking=UNRANKED)).answers)["Safest"]
    assert answer.startswith(f"{CALM} with no avoidable collision in 8 cases. {words} from")


def test_the_same_harm_is_said_of_compared_cases_alone(evaluation):
    calm, hostile = (clean(evaluation, ads, 8) for ads in (CALM, HOSTILE))
    hostile = [replace(hostile[0], status="sim_error"), *hostile[1:]]
    both = of_one_scenario(evaluation, [*calm, *hostile])
    scores = tuple(replace(one, s_plus=None) for one in both.scores)
    answer = dict(headline(replace(both, scores=scores, ranking=UNRANKED)).answers)["Safest"]
    assert answer.endswith("does the same harm in each of 7 compared cases.")


def test_the_best_is_distinguished_or_not(evaluation):
    first, second = CALM, HOSTILE
    for apart, words in ((True, "Told apart from"), (False, "Not told apart from")):
        ads = (
            RankedAds(first, 1, 60.0, (55.0, 66.0)),
            RankedAds(second, 2 if apart else 1, 50.0, (44.0, 57.0)),
            RankedAds("last", 2 if apart else 3, 0.0, (0.0, 0.0)),
        )
        pairs = (
            RankedPair(first, second, 10.0, (4.0 if apart else -4.0, 16.0), apart),
            RankedPair(first, "last", 60.0, (55.0, 66.0), told_apart=True),
        )
        scores = (*evaluation.scores, replace(evaluation.scores[0], ads="last"))
        run = replace(evaluation, scores=scores, ranking=Ranking({}, 0.95, ads, pairs))
        answer = dict(headline(run).answers)["Best by S+"]
        assert "last" not in answer
        assert answer.startswith(
            f"{first} with 60.0 of 100 points (55.0 to 66.0). {words} {second}"
        )


@pytest.mark.parametrize(
    "field, place, none, one",
    [
        ("avoidance_grade", 0, "not known: no ADS has A' in every scenario.", r"calm with [^.]*\."),
        ("human_likeness", 1, "not known: no safe case could be compared with drivers.",
            r"calm with H 0\.\d\d of 1\."),
    ],
)  # fmt: skip
def test_an_answer_compares_those_who_have_its_score(evaluation, field, place, none, one):
    names = CALM, HOSTILE
    unranked = Ranking({}, 0.95, tuple(RankedAds(it, None, None, None) for it in names), ())
    for those, words in ((names, none), (names[1:], one)):
        scores = (
            replace(it, **{field: None}) if it.ads in those else it for it in evaluation.scores
        )
        run = replace(evaluation, scores=tuple(scores), ranking=unranked)
        found = headline(run).answers[place][1]
        assert found == words or re.fullmatch(words, found)


def test_no_ads_is_the_most_human_at_nought(evaluation):
    even = report_cases.with_scores(evaluation, human_likeness=0.004)
    ads = tuple(RankedAds(it.ads, None, None, None) for it in even.scores)
    found = headline(replace(even, ranking=Ranking({}, 0.95, ads, ()))).answers
    assert found[1] == ("Most human", "no ADS, every H is 0.00.")


def test_no_ads_is_the_best_or_the_safest_at_nought(evaluation):
    given_up = report_cases.with_scores(evaluation, avoidance_grade=0.0, task_share=0.0)
    ads = tuple(RankedAds(it, 1, 0.0, (0.0, 0.0)) for it in (CALM, HOSTILE))
    pair = RankedPair(CALM, HOSTILE, 0.0, (0.0, 0.0), told_apart=False)
    ranking = Ranking({}, 0.95, ads, (pair,))
    answers = dict(headline(replace(given_up, ranking=ranking)).answers)
    assert answers["Safest"] == "no ADS, no A' is above 0.00."
    assert answers["Best by S+"] == "no ADS, every S+ is 0.0."


def test_the_safest_ads_says_that_it_hardly_drove(evaluation):
    for share, said in ((0.03, True), (0.9, False)):
        scores = report_cases.with_scores(
            evaluation, avoidance_grade=1.0, task_share=share, s_plus=None
        )
        answer = dict(headline(replace(scores, ranking=UNRANKED)).answers)["Safest"]
        assert (" It did 0.03 of the driving task (T)." in answer) == said


def test_without_a_task_a_prime_stands_in_for_s_plus(evaluation):
    without = report_cases.with_scores(evaluation, task_share=None, s_plus=None)
    ranking = replace(UNRANKED, without_task=(NAME,))
    answer = dict(headline(replace(without, ranking=ranking)).answers)["Best by S+"]
    assert answer.startswith("none: no safe case could be compared with a reference")
    assert "A'" in answer


def test_without_a_prime_the_best_is_not_blamed_on_the_task(evaluation):
    without = report_cases.with_scores(evaluation, avoidance_grade=None, s_plus=None)
    answer = dict(headline(replace(without, ranking=UNRANKED)).answers)["Best by S+"]
    assert answer == "none: no ADS has A' in every scenario."


def test_a_departure_is_off_road_on_every_picture(evaluation):
    first, *rest = clean(evaluation, CALM)
    gone = replace(first, **ALARMS["left the road in 1 case"])
    assert first.outcome == "no contact"
    assert gone.outcome == "off road"
    kinds, words = failure_kinds(CaseTable.of([gone, *rest]))
    assert [words[kind] for kind in kinds] == ["off road", "", "", ""]


def test_a_collision_without_ug_is_not_called_unavoidable(evaluation):
    hit = next(case for case in evaluation.cases if case.collided)
    kinds, words = failure_kinds(CaseTable.of([replace(hit, ideal_severity=None)]))
    assert words[kinds[0]] == "collision"


# --- the first screen and the groups of failures, on evaluations made by hand ---------------------


def test_worst_case_of_the_best_ads_comes_first(evaluation):
    """The case that takes most from A; without any the least human-like one."""
    for ads in (CALM, HOSTILE):
        worst = worst_case(evaluation, [ads])
        assert worst.ads == ads
        assert (worst.incident_severity or 0.0) > (worst.ideal_severity or 0.0)
    calm = [case for case in evaluation.cases if case.ads == CALM and not case.incident]
    least = worst_case(replace(evaluation, cases=tuple(calm)), [CALM])
    assert least.human_likeness == min(
        case.human_likeness for case in calm if case.human_likeness is not None
    )


def test_first_screen_says_what_the_terminal_says(evaluation):
    shown, said = summary_content(evaluation, Additions()), headline(evaluation)
    assert shown["answers"] == said.answers
    assert shown["alarms"] == said.alarms
    assert shown["alarms"]


def test_departures_stand_beside_collisions(evaluation):
    left = report_cases.with_scores(evaluation, departures=2)
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
    late = CaseTable.of([replace(case, contact_cause="late") for case in evaluation.cases])
    words, _ = summary_content(replace(evaluation, cases=late), Additions())["looks"][0]
    assert words.startswith(f"the collision that lowers A of {CALM} most: braked ")


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
            values = dict(zip(logical.names, logical.from_unit([[x, y]])[0].tolist(), strict=True))
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
