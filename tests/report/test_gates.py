"""Gates: a limit fails when its bound is passed, says by what and where, and is never judged
without a base."""

import json
import math
import re
from dataclasses import replace

import pytest
from builders import CALM, CUT_OUT, LOW_SPEED
from refusals import refused
from report_cases import HIT, every, pick, with_case, with_scores
from tables import rows_of, values_of

from sumo_eval.nightly import gates
from sumo_eval.nightly.gates import judge
from sumo_eval.report.gate_result import failed
from sumo_eval.report.score_words import REASON_WITHOUT_C, REASON_WITHOUT_T
from sumo_eval.results import NotComputed
from sumo_eval.scoring.comparison import compare
from sumo_eval.scoring.gate_settings import (
    HIGHER_IS_BETTER,
    GateSettings,
    LimitSettings,
    NearMissSettings,
    OutcomeSettings,
    ShiftSettings,
    read_gate,
)

OFF = {
    "outcome": OutcomeSettings(on=False),
    "near_miss": NearMissSettings(on=False),
    "shift": ShiftSettings(on=False),
}


def judged(base, new, *limits):
    """By these limits alone, without any by the rule."""
    settings = GateSettings(resamples=400, **({"limit": limits, **OFF} if limits else {}))
    return judge(new, compare(base, new, settings), settings)


def test_a_repeat_of_the_same_run_passes_every_gate(evaluation):
    results = judged(evaluation, evaluation)
    assert {result.ads for result in results} == {score.ads for score in evaluation.scores}
    assert not failed(results)
    passed = {result.quantity for result in results if result.passed}
    assert passed >= {"collided", "simulated_time", "index"}
    blind = [result for result in results if result.passed is None]
    assert all("cannot see a change with 0 cases" in result.sentence for result in blind)


def test_a_limit_on_missed_requirements_is_about_the_scenarios_that_have_some(evaluation):
    limit = LimitSettings("requirements_missed", at_most=0.0)
    first, *others = evaluation.scores
    assert any(score.scenario != first.scenario for score in others)
    some = tuple(
        replace(score, requirements_missed=0 if score.scenario == first.scenario else None)
        for score in evaluation.scores
    )
    results = judge(replace(evaluation, scores=some), None, GateSettings(limit=(limit,)))
    assert {result.scenario for result in results} == {first.scenario}
    assert all(result.passed for result in results)
    named = replace(
        limit, scenario=next(score.scenario for score in others if score.scenario != first.scenario)
    )
    assert failed(judge(replace(evaluation, scores=some), None, GateSettings(limit=(named,)))), (
        "it has none to miss"
    )
    assert failed(judge(evaluation, None, GateSettings(limit=(limit,)))), (
        "no scenario has any: a mistake of the file"
    )


def test_one_new_collision_fails_the_gate_that_names_it(evaluation):
    case = pick(evaluation, collided=False)
    (outcome,) = failed(judged(evaluation, with_case(evaluation, case, **HIT)))
    assert outcome.quantity == "collided"
    assert outcome.cases == (case.case,)
    assert outcome.worst[0].words == "ok -> contact with U 5.0 m/s"
    limit = LimitSettings("new_collisions", at_most=0.0)
    bad = failed(judged(evaluation, with_case(evaluation, case, **HIT), limit))
    named = [result for result in bad if result.quantity == "new_collisions"]
    assert [result.cases for result in named] == [(case.case,)]
    assert case.case in named[0].sentence
    assert "it must be at most 0" in named[0].sentence


def test_limits_are_absolute_relative_or_of_the_value_itself(evaluation):
    """D of `calm` falls by 0.05 in every case; its printed base value is in the run."""
    lower = evaluation
    for case in evaluation.cases:
        if case.index is not None:
            lower = with_case(lower, case, index=case.index - 0.05)
    share = 100.0 * 0.05 / evaluation.score(CALM, LOW_SPEED).d
    for limit, passes in (
        (LimitSettings("D", worse_by=0.0501), True),
        (LimitSettings("D", worse_by=0.0499), False),
        (LimitSettings("D", worse_by_percent=1.001 * share), True),
        (LimitSettings("D", worse_by_percent=0.999 * share), False),
        (LimitSettings("D", worse_by=0.0, only_if_certain=True), False),
    ):
        one = replace(limit, ads=CALM, scenario=LOW_SPEED)
        (result,) = judged(evaluation, lower, one)
        assert result.passed is passes, limit


def test_each_bound_is_a_limit_of_its_own(evaluation):
    bounds = ({"worse_by": 1.0}, {"worse_by": 2.0}, {"worse_by_percent": 1.0}, {"at_least": 0.1})
    for quantity in ("D", "min_gap"):
        one = {"ads": CALM, "scenario": LOW_SPEED}
        limits = [LimitSettings(quantity, **one, **bound) for bound in bounds]
        results = judged(evaluation, evaluation, *limits)
        assert len({result.name for result in results}) == 4


CERTAIN = "counts only where the interval leaves out 0"


@pytest.mark.parametrize(
    "quantity, by, words",
    [
        *rows_of("""
D | {"worse_by": 0.01} | it may fall by at most 0.01
D | {"worse_by_percent": 1.0} | it may fall by at most 1 %
D | {"worse_by": 0.0} | it must not fall
regret | {"worse_by": 0.2} | it may rise by at most 0.2 m/s
""", str, json.loads),
        ("D", {"worse_by": 0.0, "only_if_certain": True}, f"it must not fall; a fall {CERTAIN}"),
        ("D", {"worse_by": 0.01, "only_if_certain": True},
            f"it may fall by at most 0.01; a larger fall {CERTAIN}"),
    ],
)  # fmt: skip
def test_a_limit_on_a_change_says_what_may_change(evaluation, quantity, by, words):
    result = judged(evaluation, evaluation, LimitSettings(quantity, **by))[0]
    assert result.passed
    unit = " m/s" * (quantity == "regret")
    assert re.fullmatch(
        rf"{quantity} is [\d.]+{unit} as in the base; {re.escape(words)}", result.sentence
    )


@pytest.mark.parametrize("column, worse", [("min_ttc", -1.0), ("max_jerk", 1.0)])
def test_a_column_gets_worse_in_its_own_direction(evaluation, column, worse):
    base, *moved = (every(evaluation, **{column: 5.0 + by}) for by in (0.0, worse, -worse))
    limit = LimitSettings(column, worse_by=0.5)
    assert [bool(failed(judged(base, new, limit))) for new in moved] == [True, False]


@pytest.mark.parametrize("by", [{"worse_by": 4.9}, {"worse_by_percent": 1.0}])
def test_a_new_contact_is_a_rise_of_its_severity_from_0(evaluation, by):
    case = pick(evaluation, collided=False)
    hit = with_case(evaluation, case, status="collision", collided=True, severity=5.0)
    limit = LimitSettings("severity", ads=CALM, scenario=case.scenario, **by)
    (passed,), (fails,) = (judged(evaluation, new, limit) for new in (evaluation, hit))
    assert (passed.passed, fails.passed) == (True, False)
    assert [change.words for change in fails.worst] == ["0 m/s -> 5 m/s"]


def test_a_limit_on_a_change_counts_cases_with_one_value(evaluation):
    case = pick(evaluation, collided=False)
    base = every(evaluation, min_gap=5.0)
    limit = LimitSettings("min_gap", ads=CALM, scenario=case.scenario, worse_by=1.0)
    (result,) = judged(base, with_case(base, case, min_gap=None), limit)
    assert result.sentence.endswith(" cases, and 1 with a value in one run alone, not compared")


def test_an_uncertain_change_is_excused_only_by_its_limit(evaluation):
    case = pick(evaluation, collided=False, zone="safe")
    other = with_case(evaluation, case, index=0.0)
    where = {"ads": CALM, "scenario": case.scenario}
    (strict,) = judged(evaluation, other, LimitSettings("D", worse_by=0.0, **where))
    (lenient,) = judged(
        evaluation, other, LimitSettings("D", worse_by=0.0, only_if_certain=True, **where)
    )
    assert (strict.passed, lenient.passed) == (False, True)


@pytest.mark.parametrize(
    "quantity, lost, why",
    [
        ("T", {"task_share": None}, f"not computed: {REASON_WITHOUT_T}"),
        ("S+", {"task_share": None}, f"not computed: {REASON_WITHOUT_T}"),
        ("H", {"human_likeness": None}, "not computed: no case lies in the safe zone"),
        ("A", {"ideal_severity": None}, "no case could be evaluated"),
        ("C", {"ideal_severity": None}, f"not computed: {REASON_WITHOUT_C}"),
    ],
)
def test_why_a_score_is_not_computed_any_more(evaluation, quantity, lost, why):
    note = NotComputed("no_safe_case")
    new = with_scores(evaluation, task_share=lost.get("task_share", 1.0), h_reason=note)
    result = judged(evaluation, every(new, **lost), LimitSettings(quantity, worse_by=0.0))[0]
    assert result.passed is False
    assert result.sentence.endswith(f" and is not computed any more: {why}")


@pytest.mark.parametrize("most, end", [(5, ")"), (3, " and 2 others")])
def test_a_limit_names_some_of_its_cases_and_counts_others(evaluation, most, end, monkeypatch):
    monkeypatch.setattr(gates, "MOST_NAMED", most)
    cases = evaluation.cases_of(CALM, LOW_SPEED)
    free = [case for case in cases if case.evaluated and not case.collided]
    new = evaluation
    for case in free[:5]:
        new = with_case(new, case, **HIT)
    (gate,) = failed(judged(evaluation, new, LimitSettings("new_collisions", at_most=0.0)))
    assert gate.value == 5.0
    assert len(gate.cases) == 5
    assert len(gate.worst) == most
    assert gate.sentence.endswith(end)


def test_a_limit_on_what_the_run_has_not_says_so(evaluation):
    score = evaluation.scores[0]
    for key, name in (("ads", score.ads), ("scenario", score.scenario)):
        limit = LimitSettings("collisions", at_most=0.0, **{key: f"{name}x"})
        (found,) = judged(evaluation, evaluation, limit)
        assert found.passed is None
        assert "the run has no case of" in found.sentence
        assert f"{name}x" in found.sentence
        assert f". Did you mean `{name}`?" in found.sentence


def test_without_a_base_only_limits_on_values_are_evaluated(evaluation):
    limits = LimitSettings("new_collisions", at_most=0.0), LimitSettings("S", at_least=100.0)
    results = judge(evaluation, None, GateSettings(limit=limits))
    found = {(result.quantity, result.passed, result.threshold) for result in results}
    assert found == {("new_collisions", None, 0.0), ("S", False, 100.0)}


def test_a_value_that_is_missing_cannot_be_at_least_something(evaluation):
    lost = with_scores(evaluation, collision_probability=math.nan)
    limit = LimitSettings("collision_probability", at_most=1.0)
    assert "is not computed;" in failed(judged(lost, lost, limit))[0].sentence
    settings = GateSettings(limit=(LimitSettings("D", at_least=0.0),))
    results = judge(with_scores(evaluation, d=None), None, settings)
    assert all(result.passed is False for result in results)


GATE_FILE = """
confidence = 0.9
[[limit]]
quantity = "S"
ads = "mine"
worse_by_percent = 5
only_if_certain = true
[[limit]]
quantity = "new_collisions"
at_most = 0
"""


def test_a_gate_file_is_read(tmp_path):
    (tmp_path / "gate.toml").write_text(GATE_FILE)
    settings = read_gate(tmp_path / "gate.toml")
    assert settings.confidence == 0.9
    assert settings.limit[0] == LimitSettings(
        "S", ads="mine", worse_by_percent=5.0, only_if_certain=True
    )
    assert read_gate(None) == GateSettings()


@pytest.mark.parametrize(
    "before, after, sentence",
    [
        *rows_of(r"""
quantity = "S" | quantity = "Q" | Unknown quantity `Q` of `limit` 1 in
[[limit]]\nquantity = "S"
| near_miss.measure = [{ quantity = "min_gab", absolute = 0.1 }]\n[[limit]]\nquantity = "S"
| Did you mean `min_gap`?
worse_by_percent | worse_by_procent | Did you mean `worse_by_percent`?
confidence = 0.9 | confidense = 0.9 | Did you mean `confidence`?
at_most = 0 | worse_by = 0 | is a change already
at_most = 0 | at_least = 0 | is a change already
worse_by_percent = 5 | worse_by = -1 | must be at least 0
worse_by_percent = 5 | at_least = 5 | must stand beside worse_by
confidence = 0.9 | confidence = 1.5 | confidence
confidence = 0.9 | outcome.repeats = 1 | must be at most `repeats` + 1 = 2, the number of drives, got 3
[[limit]] | [[limit | not valid TOML
"""),
        ("at_most = 0", "", "must have at_least, at_most, worse_by or worse_by_percent"),
    ],
)
def test_a_mistake_in_a_gate_file_gets_a_sentence(before, after, sentence, tmp_path):
    (tmp_path / "gate.toml").write_text(GATE_FILE.replace(before, after))
    with refused(sentence):
        read_gate(tmp_path / "gate.toml")


@pytest.mark.parametrize(
    "quantity, field",
    rows_of("""
A | avoided_share
H | human_likeness
S+ | s_plus
regret | regret
T | task_share
A' | avoidance_grade
C | c
D | d
S | s
avoidable_collisions | avoidable_collisions
unavoidable_collisions | unavoidable_collisions
caused_collisions | caused_collisions
"""),
)  # fmt: skip
def test_the_scores_that_order_can_be_limited_by_value(evaluation, quantity, field):
    """The bound is the value itself, which holds; the same bound with another value in the run does
    not."""
    score = evaluation.score(CALM, CUT_OUT)
    value = float(getattr(score, field))
    best = quantity in HIGHER_IS_BETTER
    bound = {"at_least": value} if best else {"at_most": value}
    limit = LimitSettings(quantity, ads=score.ads, scenario=score.scenario, **bound)
    (holds,) = judged(evaluation, evaluation, limit)
    assert holds.passed
    (broken,) = judged(
        evaluation, with_scores(evaluation, **{field: value - 1.0 if best else value + 1.0}), limit
    )
    assert broken.passed is False
    assert quantity in broken.sentence


@pytest.mark.parametrize(
    "by, tolerance, passes", [(1e-12, 1e-9, True), (1e-6, 1e-9, False), (1e-6, 1e-5, True)]
)
def test_worse_by_has_a_tolerance_of_its_own(evaluation, by, tolerance, passes):
    """A regret of 0 that rises by the last digit of 1 fails no limit, though any share of 0 is
    0."""
    still, lower = (every(evaluation, index=value) for value in (0.5, 0.5 - by))
    limit = LimitSettings("D", ads=CALM, scenario=LOW_SPEED, worse_by=0.0, tolerance=tolerance)
    (result,) = judged(still, lower, limit)
    assert result.passed is passes
    rounded = replace(limit, worse_by=None, at_least=0.5)
    assert judged(still, with_scores(still, d=0.5 - by), rounded)[0].passed is passes


def test_a_column_is_evaluated_case_by_case(evaluation):
    """Gaps of 5 m, one of them 3 m now: 2 m worse, 40 % worse, below 4 m; a case without a value is
    not judged."""
    base = every(evaluation, min_gap=5.0)
    case = pick(base, collided=False)
    new = with_case(base, case, min_gap=3.0)
    other = next(one for one in new.cases if one.case != case.case and one.ads == case.ads)
    new = with_case(new, other, min_gap=None)
    for bound, fails in values_of("""
    # 0.22 of the bound, not of the base's 5 m
    {"at_least": 4.0, "tolerance": 0.22}, True
    {"at_least": 3.0}, False
    {"at_most": 5.0}, False
    {"worse_by": 1.9}, True
    {"worse_by": 2.0}, False
    {"worse_by_percent": 39.0}, True
    {"worse_by_percent": 40.0}, False
    """):  # fmt: skip
        results = judged(
            base, new, LimitSettings("min_gap", ads=case.ads, scenario=case.scenario, **bound)
        )
        assert [result.passed for result in results] == [not fails], bound
        assert [one.words for result in results for one in result.worst] == ["5 m -> 3 m"] * fails
    (blind,) = judged(
        base, new, LimitSettings("pet", ads=case.ads, scenario=case.scenario, at_least=1.0)
    )
    assert blind.passed is None
    assert blind.sentence == "pet: no case has a value to compare"
