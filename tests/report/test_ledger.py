"""The ledger adds up: every point between 100 and S is on a line, and every line is its cases."""

import math
from dataclasses import replace

import pytest
from builders import CALM, CUT_OUT, HOSTILE
from report_cases import every, findings, with_case, with_settings

from sumo_eval.case_table import CaseTable
from sumo_eval.report.score_words import explain_a
from sumo_eval.report.terminal import ledger_lines, ledger_words
from sumo_eval.report.terminal import ledger_sentences as sentences
from sumo_eval.results import NotComputed
from sumo_eval.scoring.findings import Findings
from sumo_eval.scoring.ledger import ledger, ledger_plus
from sumo_eval.scoring.quantities import combine
from sumo_eval.settings import MethodSettings, ScoreSettings


def line_of(found, words):
    (line,) = [line for line in found.lines if words in line.cause]
    return line


def index(found, term):
    """The sum of a term's lines in units of the index."""
    return math.fsum(line.index for line in found.lines if line.term == term)


def test_the_lines_add_up_to_the_printed_scores(evaluation):
    for score in evaluation.scores:
        found = ledger(Findings.of(evaluation, score))
        assert found.total == pytest.approx(score.s, abs=1e-9)
        assert index(found, "C") == pytest.approx(score.c or 0.0, abs=1e-12)
        assert index(found, "D") == pytest.approx(score.d or 0.0, abs=1e-12)


def test_a_ledger_of_no_score_says_that_there_is_none(evaluation):
    found = Findings.of(evaluation, replace(evaluation.scores[0], s_plus=None, s=0.0))
    assert ledger_words(ledger_plus(found), 1) == "S+ is not computed"
    assert ledger_words(ledger(found), 1).startswith("S = ")


def test_every_line_with_cases_is_the_sum_of_its_cases(evaluation):
    lines = [
        line
        for score in evaluation.scores
        for line in ledger(Findings.of(evaluation, score)).lines
        if line.entries
    ]
    assert len(lines) > 6
    for line in lines:
        assert math.fsum(line.parts * line.scale) == pytest.approx(line.points, abs=1e-9)
        assert line.parts.tolist() == sorted(line.parts)
        assert [case for case, _ in line.worst(2)] == list(line.entries[line.parts < 0.0])[:2]


def test_scales_and_points_of_eq_18_are_in_the_sum(evaluation):
    """a = 60, k5 = 0.5, k6 = 2: S = 60 * 0.5 C + 40 * 2 D."""
    method = MethodSettings(score=ScoreSettings(a=60.0, k5=0.5, k6=2.0))
    for score in evaluation.scores:
        found = ledger(Findings.of(with_settings(evaluation, method=method), score))
        assert found.total == pytest.approx(
            30.0 * (score.c or 0.0) + 80.0 * (score.d or 0.0), abs=1e-9
        )


def test_a_missing_d_is_a_line_with_the_collisions_that_took_it(evaluation):
    score, found = findings(evaluation, HOSTILE, 1)
    assert score.d is None
    line = line_of(ledger(found), "not computed")
    assert line.points == pytest.approx(-50.0)
    assert len(line.entries) == score.safe_collisions


def test_what_cost_most_is_said_first(evaluation):
    said = sentences(ledger(findings(evaluation, CALM, 1)[1]))
    lost = [float(sentence.split(" lost ")[1].split(" of ")[0]) for sentence in said]
    assert lost == sorted(lost, reverse=True)
    assert any("operations factor in" in sentence for sentence in said)
    assert ", 0 cases" not in "\n".join(ledger_lines(evaluation))


def test_a_case_that_gains_leaves_the_points_of_its_term(evaluation):
    found = ledger(findings(evaluation, CALM, 1)[1])
    line = next(line for line in found.lines if line.term == "D" and line.entries)
    gain = replace(line, index=0.001)
    assert sentences(found._replace(lines=(*found.lines, gain))) == sentences(found)


def test_the_lines_of_s_plus_add_up_and_each_case_takes_its_part(evaluation):
    for score in evaluation.scores:
        found = ledger_plus(Findings.of(evaluation, score))
        assert found.total == pytest.approx(score.s_plus, abs=1e-9)
        for term, value in (
            ("T", score.task_share),
            ("A", score.avoided_share),
            ("H", score.human_likeness or 0.0),
        ):
            assert 1.0 + index(found, term) == pytest.approx(value, abs=1e-12)
        for line in found.lines:
            if line.entries:
                assert math.fsum(line.parts * line.scale) == pytest.approx(line.points, abs=1e-9)


def test_a_case_given_up_costs_points_of_t(evaluation):
    line = line_of(ledger_plus(findings(evaluation, CALM, 0)[1]), "given up")
    assert line.term == "T"
    assert line.entries.status.tolist() == ["crashed"]
    assert line.points < 0.0


def test_a_case_struck_from_behind_is_a_cause_of_its_own_in_t(evaluation):
    score, found = findings(evaluation, CALM, 0)
    rows = list(found.cases)
    hit = next(row for row in rows if row.counts_for_index and not row.incident)
    struck = replace(hit, struck_from_behind=True, task_share=0.0)
    rows[rows.index(hit)] = struck
    found = Findings(
        combine(score.ads, score.scenario, rows, evaluation.settings.method),
        CaseTable.of(rows),
        evaluation.settings.method,
    )
    line = line_of(ledger_plus(found), "struck from behind")
    assert line.term == "T"
    assert line.entries.case.tolist() == [struck.case]
    assert not found.slow[rows.index(struck)]


def test_an_a_below_zero_is_shown_and_taken_as_zero(evaluation):
    """`calm` hits at 40 m/s wherever it hits: worse than doing nothing, which hits at 12."""
    names = CALM, CUT_OUT
    worse = every(evaluation, lambda case: case.collided and case.ads == names[0], severity=40.0)
    score = combine(*names, list(worse.cases_of(*names)), worse.settings.method)
    assert score.avoided_share < 0.0
    found = ledger_plus(Findings.of(worse, score))
    assert 1.0 + index(found, "A") == pytest.approx(score.avoided_share, abs=1e-12)
    assert found.total == pytest.approx(score.s_plus, abs=1e-9) == 0.0
    assert "worse than doing nothing" in explain_a(Findings.of(worse, score))


def test_a_collision_that_doing_nothing_avoids_is_called_caused(evaluation):
    score, found = findings(evaluation, HOSTILE, 1)
    struck = [case for case in found.cases if case.avoidable and case.no_reaction_severity == 0.0]
    assert score.caused_collisions == len(struck) > 0
    assert score.collisions == score.avoidable_collisions + score.unavoidable_collisions
    line = line_of(ledger_plus(found), "caused")
    assert set(line.entries.case.tolist()) == {case.case for case in struck}
    assert f"({len(struck)} of them caused by the ADS)" in explain_a(found)


def test_a_collision_that_costs_a_little_counts_in_a_as_in_c(evaluation):
    score, found = findings(evaluation, HOSTILE, 1)
    case = next(it for it in found.cases if it.unavoidable)
    little = with_case(evaluation, case, severity=case.ideal_severity + 1e-3)
    found = Findings.of(little, score)
    line = line_of(ledger_plus(found), "has too, but softer")
    assert line.cases == len(line.entries) == score.unavoidable_collisions
    assert line.parts.max() > -1e-4


def test_collisions_take_d_only_where_they_are_the_reason_that_there_is_none(evaluation):
    score, found = findings(evaluation, HOSTILE, 1)
    voiding = int(found.cases.voids_index.sum())
    assert len(line_of(ledger(found), "not computed").entries) == voiding > 0
    nobody = found._replace(score=replace(score, d_reason=NotComputed("no_drivers")))
    line = line_of(ledger(nobody), "not computed")
    assert (line.index, len(line.entries), line.cases) == (-1.0, 0, 0)


def test_a_safe_case_with_an_avoidable_collision_costs_its_whole_share_of_h(evaluation):
    _, found = findings(evaluation, HOSTILE, 1)
    line = line_of(ledger_plus(found), "incident in a safe case")
    counted = [case for case in found.cases if case.human_likeness is not None]
    hits = [case for case in counted if case.collided]
    exposure = sum(case.exposure for case in counted)
    assert line.index == pytest.approx(-sum(case.exposure for case in hits) / exposure)
