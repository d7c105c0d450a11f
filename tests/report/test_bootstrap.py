"""The paired bootstrap is the plain loop: draw concrete scenarios, compute both runs' scores from them, subtract."""

from __future__ import annotations

from dataclasses import replace

import builders
import numpy as np
import pytest

from sumo_eval.cases import CaseResult
from sumo_eval.method.anthropomorphic import exposure_weighted_index
from sumo_eval.method.collision_avoidance import collision_avoidance_index
from sumo_eval.report.bootstrap import BLOCKS, CountsOfBlocks, blocks_of, paired_differences, quantities
from sumo_eval.results import Evaluation
from sumo_eval.scoring.case_terms import case_terms
from sumo_eval.settings import MethodSettings

METHOD = MethodSettings()


def cut_out(evaluation: Evaluation) -> list[CaseResult]:
    """Cases with collisions of different weight and ideal severity, and with D_i of different exposure."""
    cases = [case for case in evaluation.cases if (case.ads, case.scenario) == (builders.CALM, builders.SCENARIOS[1])]
    return [replace(case, exposure=1.0 + 0.1 * number) for number, case in enumerate(cases)]


def slowly(cases: list[CaseResult]) -> tuple[float, float]:
    """C and D of a list of cases in which a case may stand several times."""
    hits = [case for case in cases if case.collided]
    c = collision_avoidance_index(
        [case.severity for case in hits], [case.ideal_severity for case in hits], [case.weight for case in hits]
    )
    indexed = [case for case in cases if case.index is not None]
    return c, exposure_weighted_index([case.index for case in indexed], [case.exposure for case in indexed])


def test_each_resample_is_what_the_method_makes_of_the_drawn_cases(evaluation: Evaluation) -> None:
    cases = cut_out(evaluation)
    rng = np.random.default_rng(5)
    counts = rng.multinomial(len(cases), np.full(len(cases), 1.0 / len(cases)), size=40).astype(float)
    found = quantities(case_terms(cases, METHOD), counts, METHOD)
    for row, drawn in enumerate(counts):
        chosen = [case for case, times in zip(cases, drawn, strict=True) for _ in range(int(times))]
        c, d = slowly(chosen)
        assert found["C"][row] == pytest.approx(c, abs=1e-12)
        assert found["D"][row] == pytest.approx(d, abs=1e-12)
        assert found["S"][row] == pytest.approx(50.0 * c + 50.0 * d, abs=1e-9)
        risk = sum(case.exposure for case in chosen if case.collided) / sum(case.exposure for case in chosen)
        assert found["collision_probability"][row] == pytest.approx(risk, abs=1e-12)


def test_collisions_of_no_weight_count_alike_and_none_at_all_gives_c_1(evaluation: Evaluation) -> None:
    hits = [replace(case, weight=0.0) for case in cut_out(evaluation) if case.collided]
    others = [case for case in cut_out(evaluation) if not case.collided]
    counts = np.array([[1.0] * len(hits) + [1.0] * len(others), [0.0] * len(hits) + [1.0] * len(others)])
    found = quantities(case_terms([*hits, *others], METHOD), counts, METHOD)
    assert found["C"][0] == pytest.approx(np.mean([case.ideal_severity / case.severity for case in hits]))
    assert found["C"][1] == 1.0


def test_what_both_runs_have_in_common_cancels(evaluation: Evaluation) -> None:
    """D 0.1 lower in every case is 0.1 lower in every resample, however much D itself varies with the cases drawn."""
    cases = cut_out(evaluation)
    lower = [replace(case, index=None if case.index is None else case.index - 0.1) for case in cases]
    drawn = paired_differences(
        case_terms(cases, METHOD), case_terms(lower, METHOD), METHOD, METHOD, resamples=300, seed=1
    )
    np.testing.assert_allclose(drawn["D"], -0.1, atol=1e-12)
    assert np.ptp(drawn["C"]) == 0.0


def test_a_change_in_one_case_of_many_is_not_certain(evaluation: Evaluation) -> None:
    """About 37 % of the resamples miss the one case, (1 - 1/n)^n, so the interval reaches 0."""
    cases = cut_out(evaluation)
    place = next(k for k, case in enumerate(cases) if case.index is not None)
    other = [*cases[:place], replace(cases[place], index=0.0), *cases[place + 1 :]]
    drawn = paired_differences(
        case_terms(cases, METHOD), case_terms(other, METHOD), METHOD, METHOD, resamples=4000, seed=1
    )["D"]
    n = len(cases)
    assert np.mean(drawn == 0.0) == pytest.approx((1.0 - 1.0 / n) ** n, abs=0.03)
    assert drawn.max() == 0.0


def test_the_same_seed_draws_the_same_resamples(evaluation: Evaluation) -> None:
    cases = case_terms(cut_out(evaluation), METHOD)
    other = replace(cases, index=cases.index * 0.9)
    first, again, third = (
        paired_differences(cases, other, METHOD, METHOD, resamples=150, seed=seed)["D"] for seed in (3, 3, 4)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, third)


def test_blocks_drawn_in_place_of_single_scenarios_have_the_variance_of_a_sum() -> None:
    """Of n terms of variance v a resample's sum has the variance n v, whether terms or blocks of them are drawn."""
    n, rng = 25_000, np.random.default_rng(5)
    terms = rng.normal(2.0, 3.0, n)
    order, starts = blocks_of(n, seed=1)
    assert np.array_equal(np.sort(order), np.arange(n))
    assert set(np.diff([*starts, n])) == {12, 13}
    drawn = rng.multinomial(BLOCKS, np.full(BLOCKS, 1.0 / BLOCKS), size=400).astype(float)
    sums = CountsOfBlocks(drawn, order, starts) @ terms
    assert CountsOfBlocks(np.ones((1, BLOCKS)), order, starts) @ terms == pytest.approx([terms.sum()])
    # blocks differ in size by one, which adds the variance of what 12 or 13 terms come to: E[size] v + var(size) mean^2
    size = np.diff([*starts, n])
    assert np.var(sums) == pytest.approx(n * np.var(terms) + BLOCKS * np.var(size) * terms.mean() ** 2, rel=0.2)
