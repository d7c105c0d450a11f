"""The rule of a night: worked numbers of its equations, and what each part finds and lets pass."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import CALM
from refusals import refusal
from report_cases import HIT, calm, every, pick, with_case, with_losses
from tables import values_of

from sumo_eval.cases import CaseResult
from sumo_eval.nightly import rule_limits
from sumo_eval.nightly.gates import judge
from sumo_eval.nightly.rule_limits import EVERYWHERE, judge_pairs, judge_rule
from sumo_eval.report.gate_result import GateResult, failed
from sumo_eval.report.sections import change_content
from sumo_eval.report.verdict import Additions, verdict
from sumo_eval.scoring.comparison import compare, side_by_side
from sumo_eval.scoring.gate_settings import (
    OF_U,
    GateSettings,
    LimitSettings,
    MeasureSettings,
    NearMissSettings,
    NoiseSettings,
    ShiftSettings,
)
from sumo_eval.scoring.rule import (
    Ends,
    Noise,
    Repeats,
    Tally,
    can_fail,
    floor_of,
    got_worse,
    holm,
    kept_margin,
    only_improved,
    severity_floor,
    sign_test,
    tolerance,
    worsening,
)

SETTINGS = GateSettings(resamples=100)
GAP = MeasureSettings("min_gap", 0.1, 0.1, zone=2.0)
DRAC = MeasureSettings("max_drac", 0.2, 0.05, zone=3.4)
NOISY = Repeats(30, 0)
Change = Callable[[CaseResult], CaseResult]


def test_worsening_has_the_sign_of_the_quantity():
    """A gap that falls from 0.92 to 0.32 m is 0.60 m worse; a DRAC that rises from 3.5 to 4.1 is
    0.6 m/s2 worse."""
    assert worsening(0.92, 0.32, GAP) == pytest.approx(0.60)
    assert worsening(3.5, 4.1, DRAC) == pytest.approx(0.6)
    assert replace(DRAC, higher_is_better=True).sign == 1.0


def test_tolerance_is_the_largest_of_three():
    """max(0.1, 0.1 * 0.5, 0) = 0.1; max(0.1, 0.1 * 1.5, 0) = 0.15; with a floor of 0.4 both are
    0.4."""
    base = np.array([0.5, 1.5])
    assert tolerance(base, GAP) == pytest.approx([0.1, 0.15])
    assert tolerance(base, GAP, 0.4) == pytest.approx([0.4, 0.4])


def test_sign_test_counts_coins():
    """5 of 5: 1/32; 4 of 5: (1 + 5) / 32; 0 of 0: certain."""
    assert [sign_test(5, 0), sign_test(4, 1), sign_test(0, 0)] == pytest.approx(
        [1 / 32, 6 / 32, 1.0]
    )


def test_kept_margin_is_a_ratio_towards_the_accident():
    """A gap of 0.32 of 0.92 m keeps 0.348; a DRAC of 7 after 3.5 m/s2 keeps half."""
    assert kept_margin(0.92, 0.32, GAP) == pytest.approx(0.32 / 0.92)
    assert kept_margin(3.5, 7.0, DRAC) == pytest.approx(0.5)


def test_floor_is_half_again_the_95th_percentile():
    """|d| = 0, 1, ..., 20: the 95th percentile is 19, the floor 28.5; of nothing it is 0."""
    differences = np.arange(21.0) * np.tile([1.0, -1.0, 1.0], 7)
    assert floor_of(differences, NoiseSettings()) == pytest.approx(28.5)
    assert floor_of(np.full(3, np.nan), NoiseSettings()) == 0.0


def test_floor_of_u_is_that_of_cases_with_a_contact():
    """19 of 20 cases end without contact; the other has U = 4, then 3 m/s: |d| = 1, the floor 1.5
    m/s, not 0."""
    never = np.zeros(20, dtype=bool)
    once, twice, free = (
        Ends(never, never, never, never, never, np.where(np.arange(20) == 0, u, 0.0))
        for u in (4.0, 3.0, 0.0)
    )
    assert severity_floor(once, twice, NoiseSettings()) == pytest.approx(1.5)
    assert severity_floor(once, once, NoiseSettings()) == 0.0
    for pair in ((once, free), (free, once)):
        assert severity_floor(*pair, NoiseSettings()) == pytest.approx(6.0)
    crashed = free._replace(gave_up=~never)
    for pair in ((once, crashed), (crashed, once)):
        assert severity_floor(*pair, NoiseSettings()) == 0.0, "a crash has no U"


def test_holm_rejects_in_steps_and_leaves_out_what_cannot_fail():
    """0.02 / 2 = 0.01 >= 0.008, then 0.02 / 1 >= 0.015: both.

    With a third test that counts, 0.02 / 3 < 0.008: none.

    A test whose least P is 0.25 can never be rejected, so it costs the others nothing.
    """
    two = [(0.008, 0.0), (0.015, 0.0)]
    assert holm(two, 0.02) == [True, True]
    assert holm([*two, (0.9, 0.0)], 0.02) == [False, False, False]
    assert holm([*two, (0.9, 0.25)], 0.02) == [True, True, False]
    assert holm([], 0.02) == []
    assert holm([*two, (0.9, 0.03)], 0.02) == [True, True, False]
    # a P of the level itself rejects, and a least P of 0.02 / 2 itself counts
    assert holm([(0.02, 0.0)], 0.02) == [True]
    assert holm([(0.015, 0.0), (0.9, 0.01)], 0.02) == [False, False]
    # the least P comes first, whatever was possible
    assert holm([(0.015, 0.0), (0.008, 0.005)], 0.02) == [True, True]


@pytest.mark.parametrize(
    "near, worse, better, cases, kept, fails",
    values_of("""
    True, 1, 0, 9, 1.0, True  # none better
    True, 1, 1, 9, 0.1, False  # no more worse than better
    True, 5, 1, 9, 1.0, False  # P = (6 + 1) / 64 = 0.109
    True, 6, 1, 9, 1.0, True  # P = (7 + 1) / 128 = 0.0625
    True, 2, 1, 9, 0.61, False
    True, 2, 1, 9, 0.6, True
    False, 2, 0, 3, 1.0, False  # fewer than 3
    False, 3, 0, 20, 1.0, True  # 15 % of 20, none better
    False, 3, 0, 21, 1.0, False  # less, and P = 1 / 8
    False, 6, 0, 100, 1.0, True  # 5 % and more, P = 1 / 64
    False, 12, 3, 240, 1.0, True  # 5 % of 240, P = (455 + 105 + 15 + 1) / 2^15 = 0.018
    False, 12, 3, 241, 1.0, False
    False, 11, 3, 100, 1.0, False  # P = (364 + 91 + 14 + 1) / 2^14 = 0.029
    """),
)
def test_got_worse_by_counts(near, worse, better, cases, kept, fails):
    part = SimpleNamespace(which=range(worse))
    found = Tally("ads", GAP, near, (part,), better, cases, kept, 0.0, 1.0)
    assert got_worse(found, SETTINGS) is fails


@pytest.mark.parametrize(
    "quantity, worse, most, better, furthest, fails",
    values_of("""
    "task_share", 1, 0.29999999999999993, 0, 4.9, True  # 0.7 - 0.4
    "task_share", 1, 0.29, 0, 29.0, False
    "task_share", 1, 0.3, 1, 4.9, False
    "max_jerk", 3, 9.0, 0, 5.0, True  # 3 of 99 are too few otherwise
    "max_jerk", 3, 9.0, 0, 4.9, False
    "max_jerk", 2, 9.0, 0, 5.0, False
    "max_jerk", 3, 9.0, 1, 5.0, False
    "simulated_time", 3, 9.0, 0, 5.0, False
    "latency_relative", 3, 9.0, 0, 5.0, False
    """),
)
def test_a_lost_task_or_one_of_three_far_worse_shifts(
    quantity, worse, most, better, furthest, fails
):
    part = SimpleNamespace(which=range(worse))
    measure = MeasureSettings(quantity, absolute=0.01)
    found = Tally("ads", measure, False, (part,), better, 99, 1.0, most, furthest)
    assert got_worse(found, SETTINGS) is fails


def test_can_fail_by_counts():
    """One case of a near miss, three of a shift; of a noisy ADS 6: 1 / 64 <= 0.02 < 1 / 32."""

    def least(near, noisy):
        found = (Tally("ads", GAP, near, (), 0, cases, 1.0, 0.0, 0.0) for cases in range(9))
        return [can_fail(one, SETTINGS, noisy=noisy) for one in found].index(True)

    assert [least(True, False), least(False, False), least(True, True)] == [1, 3, 6]


def test_each_bad_end_alone_is_bad():
    for flags in np.eye(5, dtype=bool)[..., None]:
        assert Ends(*flags, np.zeros(1)).bad
    assert not Ends(*np.zeros((5, 1), dtype=bool), np.ones(1)).bad


def some(evaluation, number, **values):
    """A run with the first cases of `calm` that ended well changed."""
    well = [it for it in evaluation.cases if it.ads == CALM and it.status == "ok"]
    return every(evaluation, lambda case: case in well[:number], **values)


def judged(base, new, noise=None):
    comparison = compare(base, new, SETTINGS)
    return list(failed(judge(new, comparison, SETTINGS, noise or Noise())))


def test_a_noisy_ads_needs_five_drives_to_lose_a_case(evaluation):
    """Bad in two of five drives: listed. In three, or in one where the base repeated to the bit:
    failed. Bad in some drives before: listed."""
    case = pick(evaluation, collided=False)
    new = with_case(evaluation, case, **HIT)
    for bad, shaky, steady, fails in (
        (2, (), (), False),
        (3, (), (), True),
        (1, (), (case.ads,), True),
        (5, (case.case,), (case.ads,), False),
    ):
        noise = Noise({case.ads: NOISY}, {case.case: bad}, frozenset(shaky), frozenset(steady))
        assert [gate.quantity for gate in judged(evaluation, new, noise)] == ["collided"] * fails
        results = judge(new, compare(evaluation, new, SETTINGS), SETTINGS, noise)
        listed = f"tonight (in brackets how many) or in an earlier night: {case.case} ({bad})"
        assert [gate.passed for gate in results if listed in gate.sentence] == [None] * (not fails)


def test_renamed_ads_that_lost_repeatability_fails_by_one_drive(evaluation):
    """The base's record has the ADS by its old name."""
    case = pick(evaluation, collided=False)
    comparison = compare(evaluation, with_case(evaluation, case, **HIT), SETTINGS)
    renamed = comparison._replace(
        ads=tuple(part._replace(base_ads=f"old {part.ads}") for part in comparison.ads)
    )
    noise = Noise({case.ads: NOISY}, {case.case: 1}, steady=frozenset({f"old {case.ads}"}))
    assert [gate.quantity for gate in failed(judge_rule(renamed, SETTINGS, noise))] == ["collided"]


def test_more_shaky_cases_than_are_named_fail_nothing(evaluation, monkeypatch):
    monkeypatch.setattr(rule_limits, "MOST_KEYS", 1)
    new = some(evaluation, 2, **HIT)
    shaky = frozenset(case.case for case in new.cases)
    assert not judged(evaluation, new, Noise({CALM: NOISY}, shaky=shaky))
    (gate,) = judged(evaluation, new)
    assert gate.value == 2.0
    assert len(gate.cases) == 1


def test_a_noisy_ads_is_evaluated_by_chance_alone(evaluation):
    """One case 0.6 m nearer fails for an ADS that repeats; by chance it is 1 of 1, P = 0.5."""
    base = calm(evaluation, min_gap=0.92, min_ttc=9.0)
    one = some(base, 1, min_gap=0.32)
    every = calm(base, min_gap=0.32)
    noise = Noise({CALM: NOISY})
    assert not judged(base, one, noise)
    assert [gate.quantity for gate in judged(base, every, noise)] == ["min_gap"]
    assert not judged(base, every, Noise({CALM: Repeats(30, 0, {"min_gap": 0.7})}))


def test_three_cases_far_worse_fail_and_say_how_far(evaluation):
    """1 to 11 m/s3 is 10 / 2 = 5 tolerances."""
    base = calm(evaluation, max_jerk=1.0)
    settings = replace(SETTINGS, shift=ShiftSettings(share_alone=1.0))
    for jerk, fails in ((11.0, True), (10.9, False)):
        new = some(some(base, 3, max_jerk=3.1), 1, max_jerk=jerk)
        gates = failed(judge(new, compare(base, new, settings), settings))
        assert [gate.sentence.partition("; ")[2] for gate in gates] == [
            "one by 5 tolerances"
        ] * fails
    late = some(calm(evaluation, simulated_time=1.0), 3, simulated_time=9.0)
    (gate,) = judged(calm(evaluation, simulated_time=1.0), late)
    assert "tolerances" not in gate.sentence  # of a time they do not count


@pytest.mark.parametrize(
    "quantity, before, after, last",
    [("min_ttc", 1.7, 1.3, (0.2, 0.0)), ("max_jerk", 20.0, 26.0, (1.0, 5.0))],
)
def test_first_named_case_is_the_one_of_the_sentence(evaluation, quantity, before, after, last):
    """It kept 0 % of its margin, or is worse by 2 of its tolerances, not by the largest amount."""
    base = some(calm(evaluation, **{quantity: before}), 1, **{quantity: last[0]})
    new = some(calm(evaluation, **{quantity: after}), 1, **{quantity: last[1]})
    (gate,) = judged(base, new)
    assert (gate.worst[0].before, gate.worst[0].after) == last


def test_cases_with_a_value_in_one_run_are_reported(evaluation):
    """Without a lead in the base: there is no headway that could have become smaller."""
    base = some(calm(evaluation, min_thw=2.0), 2, min_thw=None)
    new = calm(evaluation, min_thw=2.0)
    results = judge(new, compare(base, new, SETTINGS), SETTINGS)
    (thw,) = [it for it in results if it.ads == CALM and it.quantity == "min_thw"]
    assert thw.sentence.endswith(", and 2 with a value in one run alone, not compared")
    with refusal("Measure `min_thw` of .shift. must have no `zone`"):
        ShiftSettings(measure=(MeasureSettings("min_thw", 0.1, zone=1.0),))


def test_too_few_cases_are_not_good_news(evaluation):
    base = calm(evaluation, min_gap=5.0, min_ttc=9.0)
    results = judge(base, compare(base, base, SETTINGS), SETTINGS)
    (gap,) = [one for one in results if one.ads == CALM and one.quantity == "min_gap"]
    assert gap.passed is None
    assert gap.sentence == "smallest gap ahead: cannot see a change with 0 cases inside 2 m"


def test_only_improved_forgives_no_last_millimetre(evaluation):
    base = calm(evaluation, min_gap=0.9, min_ttc=9.0)
    mixed = some(some(base, 2, min_gap=0.899), 1, min_gap=1.5)
    assert not only_improved(compare(base, mixed, SETTINGS), SETTINGS)


def test_lost_ads_scenario_and_tenth_of_pairs_fail(evaluation):
    """Of one ADS in one scenario the first case is lost, then all of them, then the ADS
    everywhere."""

    def without(unwanted, run=evaluation):
        cases = tuple(case for case in run.cases if not unwanted(case))
        pairs = {(case.ads, case.scenario) for case in cases}
        scores = tuple(score for score in run.scores if (score.ads, score.scenario) in pairs)
        return replace(run, cases=cases, scores=scores)

    first = evaluation.cases[0]

    def sentence(new):
        found = judge_pairs(compare(evaluation, new, SETTINGS), SETTINGS, "accept it")
        return found[0].sentence if found else ""

    assert sentence(without(lambda case: case.case == first.case)) == ""
    assert f"ADS `{first.ads}` of the base is missing" in sentence(
        without(lambda case: case.ads == first.ads)
    )
    gone = sentence(without(lambda case: case.scenario == first.scenario))
    assert f"logical scenario `{first.scenario}` of the base is missing" in gone
    assert gone.endswith("If this is meant: accept it")
    part = without(lambda case: case.scenario == first.scenario and case.ads == first.ads)
    assert f"`{first.ads}` has no case of the base's {first.scenario} any more" in sentence(part)


def test_an_ads_driven_at_other_points_is_not_called_missing(evaluation):
    """As after another seed or a changed range: no point of the base is left."""
    moved = [
        replace(case, values={name: it + 0.5 for name, it in case.values.items()})
        for case in evaluation.cases
    ]
    comparison = side_by_side(evaluation, replace(evaluation, cases=tuple(moved)), SETTINGS)
    assert all(group.lost == group.of == group.added for group in comparison.unpaired)
    (gate,) = judge_pairs(comparison, SETTINGS, "accept it")
    assert "is missing" not in gate.sentence
    first = evaluation.cases[0]
    assert f"`{first.ads}` has no case of the base's {first.scenario} any more" in gate.sentence


def test_the_same_is_said_of_equal_bits_alone(evaluation):
    """The last digit of one value of one case is enough; so is a case without a partner."""

    def told(new):
        found = verdict(compare(evaluation, new, SETTINGS), (), new)
        return f"{found.word}: {found.sentence}"

    assert told(evaluation).startswith("same: THE SAME as")
    case = pick(evaluation, collided=False)
    digit = np.nextafter(case.max_jerk, 9.0)
    for jerk in (digit, 99.0):  # far beyond its own tolerance
        changed = told(with_case(evaluation, case, max_jerk=jerk))
        assert changed.startswith("no_limit_failed: NO LIMIT FAILED")
        assert "1 case changed by less than the tolerances of outcome and likeness" in changed
    fewer = replace(
        evaluation, cases=tuple(one for one in evaluation.cases if one.case != case.case)
    )
    assert "equal to the last bit, 1 of the base have no partner" in told(fewer)
    slower = with_case(evaluation, case, latency_median=1.0, wall_time=9.0, batched="compared")
    assert told(slower).startswith("same: THE SAME as"), "no two drives take the same time or batch"


def test_the_verdict_names_the_run_that_a_limit_failed_beside(evaluation):
    """The base, the accepted night where only that comparison failed, or neither."""
    comparison = compare(evaluation, evaluation, SETTINGS)
    failure = GateResult("min_gap", CALM, EVERYWHERE, False, "nearer")
    lost = failure._replace(quantity="pairs", against="night")
    folder = evaluation.folder.name
    for gates, words in (
        ([failure], f"WORSE than {folder}: 1 limit failed; outcome"),
        (
            [failure._replace(against="night")],
            f"WORSE than the accepted night: 1 limit failed; beside {folder} outcome",
        ),
        ([failure._replace(own=True)], f"NOT GOOD beside {folder}: 1 limit failed; outcome"),
        ([lost], "INCOMPLETE beside the accepted night: nearer"),
    ):
        assert verdict(comparison, gates, evaluation).sentence.startswith(words)
    assert verdict(comparison, (), evaluation).sentence.endswith(
        f", {evaluation.not_evaluated} cases not evaluated."
    )


@pytest.mark.parametrize(
    "quantity, before, allowed, worse",
    values_of("""
    "latency_relative", 20.0, 30.0, 31.0
    "latency_relative", 3.0, 5.0, 5.1
    "overshoot", 0.05, 0.15, 0.16
    "max_lateral_jerk", 3.0, 8.0, 8.1
    """),
)
def test_slower_or_swaying_ads_fails_and_a_loaded_machine_does_not(
    evaluation, quantity, before, allowed, worse
):
    """20 times the fixed work before, of which half is allowed (max(2, 0.5 * 20) = 10); 0.1 m."""
    base = calm(evaluation, latency_median=1e-4, **{quantity: before})
    assert not judged(base, calm(base, latency_median=9e-4, **{quantity: allowed}))
    assert [gate.quantity for gate in judged(base, calm(base, **{quantity: worse}))] == [quantity]


def test_latency_is_not_compared_between_batch_sizes(evaluation):
    """Latency is a share of the batch: in a smaller one it is larger, though no ADS changed."""
    base = calm(evaluation, latency_relative=3.0)
    slower = calm(base, latency_relative=9.0)
    run = replace(base.settings.run, cases_per_pack=7)
    new = replace(slower, settings=replace(base.settings, run=run))
    assert judged(base, slower)
    assert not judged(base, new)
    (difference,) = compare(base, new, SETTINGS).differences
    assert difference.words == "run.cases_per_pack: 512 in the base, 7 in the new run"


def test_a_harder_injury_risk_fails(evaluation):
    """0.5, meant for m/s, is half of all losses."""
    case = pick(evaluation, collided=True)

    def risk(value):
        return with_losses(with_case(evaluation, case, severity=value), severity="injury:cyclist")

    gates = judged(risk(0.1), risk(0.3))
    assert any("U rose by more than 0.01 in 1 case" in gate.sentence for gate in gates)
    (one,) = [it for it in compare(risk(0.1), risk(0.15), SETTINGS).ads if len(it.changed)]
    assert [it.change for it in one.changed] == ["harsher"]
    hit = with_case(evaluation, case, severity=0.05)
    sides = compare(hit, risk(0.9), SETTINGS, accept_differences=True).ads
    assert not any(len(it.changed) for it in sides), "a speed is not compared with a risk"
    assert {it.units for it in sides} == {(" m/s", "")}
    regrets = [it.quantities["regret"] for it in sides]
    assert {it.difference for it in regrets} == {None}
    assert all(it.base is not None for it in regrets)
    classes = with_losses(hit, loss="class")
    sides = compare(hit, classes, SETTINGS, accept_differences=True).ads
    assert {it.quantities["regret"].difference for it in sides} == {None}
    assert not any("regret" in it.moved for one in sides for it in one.changed)
    free = with_case(risk(0.9), case, collided=False, severity=None)
    comparison = compare(hit, free, SETTINGS, accept_differences=True)
    content = change_content(free, Additions(comparison))
    assert content["cases"][0]["base"] == "U 0.1 m/s", "the base has a speed"
    of_u = tuple(LimitSettings(name, worse_by=0.0) for name in ("regret", *sorted(OF_U)))
    watched = NearMissSettings(measure=(GAP, MeasureSettings("severity", 0.01, zone=9.0)))
    limits = GateSettings(resamples=100, limit=of_u, near_miss=watched)
    gates = {it.quantity: it for it in judge(free, comparison, limits) if it.ads == case.ads}
    for limit in of_u:
        told = gates[limit.quantity]
        words = f"{limit.quantity} has another unit in the base"
        assert told.passed is None
        assert told.sentence == words
    harder = calm(with_case(hit, case, severity=9.0), min_gap=9.0)
    improved = compare(calm(risk(0.9), min_gap=0.5), harder, SETTINGS, accept_differences=True)
    assert only_improved(improved, limits), "9 m/s is no worse than a risk of 0.9"
