"""The ledger adds up: every point between 100 and S is on a line, and every line is its cases."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import builders
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_eval.report.ledger import _factor_losses, ledger, sentences
from sumo_eval.results import CaseResult, Evaluation
from sumo_eval.settings import MethodSettings, ScoreSettings


def test_the_lines_add_up_to_the_printed_scores(evaluation: Evaluation) -> None:
    for score in evaluation.scores:
        found = ledger(evaluation, score)
        assert found.total == pytest.approx(score.s, abs=1e-9)
        assert found.index("C") == pytest.approx(score.c or 0.0, abs=1e-12)
        assert found.index("D") == pytest.approx(score.d or 0.0, abs=1e-12)


def test_every_line_with_cases_is_the_sum_of_its_cases(evaluation: Evaluation) -> None:
    lines = [line for score in evaluation.scores for line in ledger(evaluation, score).lines if line.entries]
    assert len(lines) > 6
    for line in lines:
        assert math.fsum(entry.points for entry in line.entries) == pytest.approx(line.points, abs=1e-9)
        assert [entry.points for entry in line.entries] == sorted(entry.points for entry in line.entries)


def test_scales_and_points_of_eq_18_are_in_the_sum(evaluation: Evaluation) -> None:
    """a = 60, k5 = 0.5, k6 = 2: S = 60 * 0.5 C + 40 * 2 D."""
    settings = replace(evaluation.settings, method=MethodSettings(score=ScoreSettings(a=60.0, k5=0.5, k6=2.0)))
    for score in evaluation.scores:
        found = ledger(replace(evaluation, settings=settings), score)
        assert found.total == pytest.approx(30.0 * (score.c or 0.0) + 80.0 * (score.d or 0.0), abs=1e-9)


def test_a_missing_d_is_a_line_with_the_collisions_that_took_it(evaluation: Evaluation) -> None:
    score = evaluation.score(builders.HOSTILE, builders.SCENARIOS[1])
    assert score.d is None
    (line,) = [line for line in ledger(evaluation, score).lines if "not computed" in line.words]
    assert line.points == pytest.approx(-50.0)
    assert len(line.entries) == score.safe_collisions


def test_what_cost_most_is_said_first(evaluation: Evaluation) -> None:
    score = evaluation.score(builders.CALM, builders.SCENARIOS[1])
    said = sentences(ledger(evaluation, score))
    lost = [float(sentence.split(" lost ")[1].split(" of ")[0]) for sentence in said]
    assert lost == sorted(lost, reverse=True)
    assert any("operations factor in" in sentence for sentence in said)


factor = st.floats(0.0, 1.0)


@given(length=factor, operations=factor, similarity=factor)
def test_the_factors_share_a_loss_as_the_mean_over_all_orders(
    length: float, operations: float, similarity: float
) -> None:
    """The plain twin: take the factors off in each of the six orders and average what each one took."""
    values = {"length": length, "operations": operations, "similarity": similarity}
    slow = dict.fromkeys(values, 0.0)
    for order in itertools.permutations(values):
        left = 1.0
        for name in order:
            slow[name] += left * (1.0 - values[name]) / 6.0
            left *= values[name]
    found = _factor_losses(case_with(length, operations, similarity))
    assert found == pytest.approx(slow, abs=1e-12)
    assert sum(found.values()) == pytest.approx(1.0 - length * operations * similarity, abs=1e-12)


def case_with(length: float, operations: float, similarity: float) -> CaseResult:
    return SimpleNamespace(length_factor=length, operation_factor=operations, similarity=similarity)  # type: ignore[return-value]
