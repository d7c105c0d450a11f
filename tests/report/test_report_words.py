"""The sentences: they must say what the numbers say."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from builders import CALM, CUT_OUT, HOSTILE
from report_cases import every, findings, pick, with_case, with_losses, with_scores
from tables import values_of

from sumo_eval.case_table import CaseTable
from sumo_eval.method.collision_avoidance import collision_avoidance_index, collision_weight
from sumo_eval.method.index_terms import IndexNote, NoteKind
from sumo_eval.nightly.rule_limits import end_change
from sumo_eval.report import words
from sumo_eval.report.explain import _zone, explain_case, known_case
from sumo_eval.report.junit import _facts
from sumo_eval.report.notes import index_notes, notes_sentence
from sumo_eval.report.score_words import explain_a, explain_c, explain_d, explain_s, explain_t
from sumo_eval.report.words import count, number, percent, sampling_words, severity_words
from sumo_eval.results import NotComputed
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.findings import LIKENESS_FACTORS, Findings, unevaluated
from sumo_eval.scoring.quantities import combine
from sumo_eval.settings import CollisionSettings, SamplingSettings


@pytest.mark.parametrize("loss", ["severity", "class"])
def test_the_parts_of_the_collisions_add_up_to_what_c_lost(evaluation, loss):
    _, found = findings(with_losses(evaluation, loss=loss), HOSTILE, 1)
    rows, lost = found.cases, found.lost_of_c[found.collisions]
    hits = [row for row in rows if row.collided]
    c = collision_avoidance_index(
        [row.severity for row in hits],
        [row.ideal_severity for row in hits],
        [row.weight for row in hits],
        loss,
    )
    assert lost.sum() == pytest.approx(1.0 - c, abs=1e-12)
    assert lost.tolist() == sorted(lost, reverse=True)


def test_without_any_weight_every_collision_counts_the_same(evaluation):
    rows = [
        replace(row, weight=0.0, ideal_severity=0.0) for row in evaluation.cases if row.collided
    ][:4]
    found = Findings(evaluation.scores[0], CaseTable.of(rows), evaluation.settings.method)
    assert found.lost_of_c.tolist() == [0.25] * 4


def test_a_collision_without_a_known_ideal_is_listed_and_takes_nothing(evaluation):
    _, found = findings(evaluation, CALM, 1)
    first = next(row for row in found.cases if row.collided)
    odd = with_case(evaluation, first, ideal_severity=None)
    _, found = findings(odd, CALM, 1)
    last = found.collisions[-1]
    assert found.cases[last].case == first.case
    assert math.isnan(found.lost_of_c[last])
    assert first.case in {case.case for table in unevaluated(odd) for case in table}


def test_c_is_explained_by_counts_of_each_zone(evaluation):
    score, found = findings(evaluation, HOSTILE, 1)
    text = explain_c(found)
    assert (
        f"{score.collisions - score.safe_collisions} of {score.hazardous_cases} hazardous cases"
        in text
    )
    assert f"in {score.safe_collisions} of {score.safe_cases} safe cases" in text
    assert f"avoids {score.avoidable_collisions} of these" in text
    assert f"C = {score.c:.3f}" in text


def test_losses_of_t_are_of_safe_cases(evaluation):
    """T has no part of a hazardous case, however it ended."""
    for zone in ("safe", "hazardous"):
        case = pick(evaluation, collided=False, zone=zone)
        left = with_case(with_scores(evaluation, departures=1), case, departure_time=1.0)
        found = Findings.of(left, left.score(CALM, case.scenario))
        assert ("1 case left the road" in explain_t(found)) == case.safe


def test_no_collision_is_said_as_such(evaluation):
    _, found = findings(evaluation, CALM, 0)
    number = sum(row.evaluated for row in found.cases)
    sentence = f"calm did not collide in any of {number} evaluated cases, so C = 1."
    assert explain_c(found) == sentence


def explained(evaluation, partitions, case):
    return "\n".join(explain_case(evaluation, partitions, known_case(evaluation.folder, case.case)))


def test_no_case_takes_from_a_score_that_is_not_computed(evaluation, partitions):
    _, found = findings(evaluation, CALM, 1)
    case = next(row for row in found.cases if row.index is not None)
    assert "of D = 0." in explained(evaluation, partitions, case)
    reason = NotComputed("collisions", 2)
    without = with_scores(evaluation, d=None, d_reason=reason, task_share=None, s_plus=None)
    text = explained(without, partitions, case)
    assert "Eq. 13: D is not computed: 2 collisions in the safe zone. Its term counts 0" in text
    assert "; T is not computed: no safe case" in text
    assert not re.search("of D =|of 1 - T", text)


def test_failed_case_is_explained_by_its_own_reason(evaluation, partitions):
    _, found = findings(evaluation, CALM, 0)
    case = next(row for row in found.cases if row.safe and row.status == "crashed")
    without = with_scores(evaluation, d=None, d_reason=NotComputed("collisions", 2))
    assert "no D_i: The process that ran the case died" in explained(without, partitions, case)
    failed = with_case(without, case, status="sim_error", task_share=None)
    text = explained(failed, partitions, case)
    assert "T: this case has no part in it: it could not be evaluated" in text


def test_r_of_a_point_of_an_adaptive_sample_is_told_from_what_it_counts(evaluation, partitions):
    case = pick(evaluation, collided=True)
    r = float(collision_weight(case.values, partitions[case.scenario]))
    for of_even, said in ((1.0, False), (1.5, True)):
        odd = with_case(evaluation, case, weight=of_even * r)
        text = explained(odd, partitions, case)
        assert f"Eq. 16: r = |x - x*| / |b - x*| = {r:.4f}: " in text
        words = f"stands for 1.5000 points of an even one, so its r counts {r:.4f} x 1.5000 = "
        assert (words in text) is said


def test_a_drive_is_called_as_the_drivers_only_if_it_was_compared(evaluation, partitions):
    _, found = findings(evaluation, CALM, 0)
    case = next(row for row in found.cases if row.safe and row.task_share == 1.0)
    for value, sentence in (
        (1.0, "It drove as the drivers did, without harm."),
        (None, "It had no contact and stayed on the road."),
    ):
        factors = dict.fromkeys(LIKENESS_FACTORS.values(), value)
        odd = with_case(evaluation, case, human_likeness=value, index=None, **factors)
        assert f"\n  {sentence}\n" in explained(odd, partitions, case)


def test_no_drivers_are_named_beside_t_where_there_are_none(evaluation, partitions):
    case = next(row for row in evaluation.cases if row.safe and row.task_share is not None)
    some = with_scores(evaluation, task_reference="attentive")
    assert "slowest of `attentive` and the drivers / own" in explained(some, partitions, case)
    nobody = with_scores(some, h_reason=NotComputed("no_drivers"))
    assert "min(1, time of `attentive` / own time)" in explained(nobody, partitions, case)


def test_shares_of_equal_weight_are_explained_as_such(evaluation, partitions):
    case = pick(evaluation, collided=True)
    without = every(evaluation, weight=0.0)
    text = explained(without, partitions, case)
    hits = without.cases_of(CALM, case.scenario).collided.sum()
    assert f"sum r = 1.0000 x 0.6000 / {hits:.4f} = {0.6 / hits:.4f}" in text
    assert "A: w = 1, as r is 0 in all cases; w max(0, U - Ug) = 6.0000" in text


def test_d_names_the_factor_that_limits_it(evaluation):
    score, found = findings(evaluation, CALM, 1)
    assert found.factor_means["operations"] == pytest.approx(0.5)
    text = explain_d(found)
    assert "limited most by the operations factor (mean 0.50; length 1.00" in text
    assert f"mean over {score.safe_cases} safe cases" in text


def test_a_perfect_d_is_limited_by_nothing(evaluation):
    score, found = findings(evaluation, CALM, 1)
    rows = [
        replace(
            row, index=1.0, length_factor=1.0, operation_factor=1.0, similarity=1.0, index_note=()
        )
        for row in found.cases
        if row.index is not None
    ]
    perfect = Findings(replace(score, d=1.0), CaseTable.of(rows), evaluation.settings.method)
    assert (
        explain_d(perfect) == f"D = 1.000: mean over {len(rows)} safe cases, no factor limits it."
    )


def test_no_d_is_a_value_with_a_reason(evaluation):
    score, found = findings(evaluation, HOSTILE, 1)
    assert (
        explain_d(found)
        == f"D is not computed: {count(score.safe_collisions, 'collision')} in the safe zone. "
        "Its term counts 0 points."
    )
    assert "D, not computed, gives 0" in explain_s(found)


def test_the_same_note_with_other_numbers_is_gathered(evaluation):
    notes = [
        note for note in index_notes(evaluation) if (note.ads, note.scenario) == (CALM, CUT_OUT)
    ]
    assert len(notes) == 1
    numbers = [row.index_note[0].count for row in evaluation.cases if row.ads == CALM
               and row.scenario == CUT_OUT and row.index_note]  # fmt: skip
    assert notes[0].cases == len(numbers)
    assert notes[0].text == (
        f"At {min(numbers)} to {max(numbers)} of 1101 slices the drivers are in two groups, over "
        "half a lane apart "
        "(bimodal)."
    )


@pytest.mark.parametrize("kind", get_args(NoteKind))
def test_every_kind_of_note_has_a_sentence_with_its_numbers(kind):
    sentence = notes_sentence([IndexNote(kind, 3, 7, (0, 1))])
    assert sentence.endswith(".")
    assert "{" not in sentence
    if "3" in sentence:
        assert "3 of 7" in sentence or "the 3 of 7" in sentence


@pytest.mark.parametrize(
    "share, text",
    [
        *values_of("""
    0.0, "0 %"
    0.0365, "3.65 %"
    0.5, "50 %"
    0.9996, "99.96 %"
    1.0, "100 %"
    0.00012345, "0.0123 %"
    0.99951, "99.951 %"
    2e-6, "0.0002 %"
    1e-7, "less than 0.0001 %"
    4e-9, "less than 0.0001 %"
    0.999999999, "more than 99.9999 %"
    """),
        (np.nan, "not known"),
    ],
)
def test_shares_have_three_digits(share, text):
    assert percent(share) == text


def test_no_number_is_shown_as_minus_zero():
    assert number(-0.0004, 3) == number(-0.0, 3) == "0.000"
    assert number(-0.0006, 3) == "-0.001"
    # a fixed format without `z`
    found = re.compile(r":[<>^]?[+]?[0-9]*[.]([0-9]|[{]digits[}])+[fge%][}]")
    for room in ("report", "cli", "nightly", "studies"):
        for file in (Path(words.__file__).parents[1] / room).glob("*.py"):
            assert not found.findall(file.read_text()), file


def test_a_loss_in_place_of_u_has_no_unit_anywhere(evaluation):
    """An injury risk of 0.05 is not 0.1 m/s, in JUnit, changes and limits alike."""
    own = evaluation.settings.method.collision
    collision = with_losses(evaluation, severity="injury:car_driver").settings.method.collision
    case = next(one for one in evaluation.cases if one.collided)
    case = replace(case, severity=0.05, ideal_severity=0.0, no_reaction_severity=0.2)
    assert "U = 0.050, Ug of the ideal vehicle = 0.000, U0 of doing nothing = 0.200" in _facts(
        case, collision.unit
    )
    assert end_change(case, case, (collision.unit, " m/s")).before == "contact with U 0.050"
    assert severity_words(5.0, own.unit) == "5.0 m/s"
    assert CollisionSettings(severity="eq14").unit == " m/s", "L is computed from U"


def test_the_zone_of_a_case_is_that_of_its_criticality(evaluation, partitions):
    """Also where the learnt boundary has the point on its other side."""
    zones = partitions[CUT_OUT]
    rows = zones.logical.from_unit(np.random.default_rng(1).random((4_000, 3)))
    row = rows[zones.exactly_hazardous(rows) & ~zones.hazardous(rows)][0]
    values = dict(zip(zones.logical.names, row.tolist(), strict=True))
    case = replace(evaluation.cases_in(CUT_OUT)[0], values=values, zone="hazardous")
    exact, learnt = _zone(case, zones)
    assert exact.endswith("hazardous from 0.7 1/s: the hazardous zone")
    assert learnt.endswith("safe as learnt, for maps and weights")


def test_no_inverse_ttc_is_printed_where_the_zone_has_another_rule(evaluation, partitions):
    zones, case = partitions[CUT_OUT], evaluation.cases_in(CUT_OUT)[0]
    no_rule = replace(zones.logical, approach=None, search=None, margin=None)
    (line,) = _zone(case, replace(zones, logical=no_rule))
    assert line == "Eqs. 1-8: the scenario declares no zones, so every point counts as safe"
    limit = replace(no_rule, margin=lambda values: 0.0 * next(iter(values.values())) + 2.5)
    first, _ = _zone(case, replace(zones, logical=limit))
    assert first.startswith("in place of Eqs. 1-6: 2.5000 m to the limit")


def test_a_hard_collision_that_weighs_nothing_is_not_called_soft(evaluation):
    _, found = findings(evaluation, CALM, 1)
    calm = next(row for row in found.cases if row.evaluated and not row.incident)
    hit = next(row for row in found.cases if row.unavoidable)
    for above, said in (
        (0.0, "no incident is"),
        (1.0, "no incident at a point with r above 0 is"),
    ):
        rows = [calm, replace(hit, weight=0.0, severity=hit.ideal_severity + above)]
        score = combine(CALM, hit.scenario, rows, found.method)
        assert score.avoided_share == 1.0
        assert said in explain_a(Findings(score, CaseTable.of(rows), found.method))


def test_the_choice_of_points_in_words():
    logical = catalogue.load("ncap_ccrs")
    assert sampling_words(SamplingSettings(file="own.csv"), logical) == "file, own.csv"
    one = SamplingSettings(method="sobol", count=1)
    assert sampling_words(one, logical) == "sobol, 1 point asked for"
    assert sampling_words(SamplingSettings(levels=3), logical) == "grid, 3 points on each axis"
    side = catalogue.load("exit_cut")  # `side` has two listed values
    *speeds, gap, _ = side.names
    three, some = dict.fromkeys((*speeds, gap), 3), dict.fromkeys(speeds, 3)
    for levels, axes in (
        (3, "side: 2 values, 3 points on each other axis"),
        (three, "ego_speed: 3 points, other_speed: 3 points, gap: 3 points, side: 2 values"),
        (some, "ego_speed: 3 points, other_speed: 3 points, elsewhere the space's own steps"),
    ):
        assert sampling_words(SamplingSettings(levels=levels), side) == f"grid, {axes}"
    for default in (SamplingSettings(), SamplingSettings(levels={})):
        assert sampling_words(default, logical).startswith("ncap_2026, the Euro NCAP matrix")
