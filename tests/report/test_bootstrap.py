"""The paired bootstrap is the plain loop: draw concrete scenarios, compute both runs' scores from
them, subtract."""

from dataclasses import replace

import numpy as np
import pytest
from builders import CALM, CUT_OUT
from scipy.stats import norm, t
from scoring.confidence.scored_by_hand import terms_of

from sumo_eval.method.anthropomorphic import exposure_weighted_index
from sumo_eval.method.collision_avoidance import collision_avoidance_index
from sumo_eval.scoring.case_terms import case_terms
from sumo_eval.scoring.comparison import _quantity_changes
from sumo_eval.scoring.confidence.paired_differences import paired_differences
from sumo_eval.scoring.confidence.resamples import one_list, resamples
from sumo_eval.scoring.gate_settings import GateSettings
from sumo_eval.settings import MethodSettings

METHOD = MethodSettings()


def differences(before, after, replicates, seed):
    return paired_differences(before, after, replicates, seed)


def cut_out(evaluation):
    """Cases with collisions of different weight and ideal severity, and with D_i of different
    exposure."""
    cases = evaluation.cases_of(CALM, CUT_OUT)
    return [replace(case, exposure=1.0 + 0.1 * number) for number, case in enumerate(cases)]


def slowly(cases):
    """C and D of a list of cases in which a case may stand several times."""
    hits = [case for case in cases if case.collided]
    c = collision_avoidance_index(
        [case.severity for case in hits],
        [case.ideal_severity for case in hits],
        [case.weight for case in hits],
    )
    indexed = [case for case in cases if case.index is not None]
    return c, exposure_weighted_index(
        [case.index for case in indexed], [case.exposure for case in indexed]
    )


def test_each_resample_is_what_the_method_makes_of_the_drawn_cases(evaluation):
    """Of the drawn counts c' = n/(n - 1) times how often a case is drawn, which cancels in
    means."""
    cases = cut_out(evaluation)
    worse = [
        replace(case, severity=2.0 * case.severity) if case.collided else case for case in cases
    ]
    found = differences(case_terms(cases, METHOD), case_terms(worse, METHOD), 40, 5)
    (part,) = resamples(one_list(len(cases)), 40, 5, ("comparison",))
    times = np.rint(part.counts * (len(cases) - 1) / len(cases)).astype(int)
    chosen = [(np.repeat(cases, row), np.repeat(worse, row)) for row in times]
    before, after = ([slowly(list(run)) for run in runs] for runs in zip(*chosen, strict=True))
    c, d = np.subtract(after, before).T
    np.testing.assert_allclose(found["C"], c, atol=1e-12)
    np.testing.assert_allclose(found["D"], d, atol=1e-12)
    np.testing.assert_allclose(found["S"], 50.0 * (c + d), atol=1e-9)


def test_what_both_runs_have_in_common_cancels(evaluation):
    """D 0.1 lower in every case is 0.1 lower in every resample, however much D itself varies with
    the cases drawn."""
    cases = cut_out(evaluation)
    lower = [
        replace(case, index=None if case.index is None else case.index - 0.1) for case in cases
    ]
    drawn = differences(case_terms(cases, METHOD), case_terms(lower, METHOD), 300, 1)
    np.testing.assert_allclose(drawn["D"], -0.1, atol=1e-12)
    assert np.ptp(drawn["C"]) == 0.0


def test_a_change_in_one_case_of_many_is_not_certain(evaluation):
    """About 37 % of the resamples miss the one case, (1 - 1/n)^(n - 1), so the interval reaches
    0."""
    cases = cut_out(evaluation)
    place = next(k for k, case in enumerate(cases) if case.index is not None)
    other = [*cases[:place], replace(cases[place], index=0.0), *cases[place + 1 :]]
    drawn = differences(case_terms(cases, METHOD), case_terms(other, METHOD), 4000, 1)["D"]
    n = len(cases)
    assert np.mean(drawn == 0.0) == pytest.approx((1.0 - 1.0 / n) ** (n - 1), abs=0.03)
    assert drawn.max() == 0.0


def test_the_same_seed_draws_the_same_resamples(evaluation):
    cases = case_terms(cut_out(evaluation), METHOD)
    other = replace(cases, index=cases.index * 0.9)
    first, again, third = (differences(cases, other, 150, seed)["D"] for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, third)


def test_blocks_drawn_in_place_of_single_scenarios_have_the_variance_of_a_mean():
    """A of n cases that lose x or nothing each varies by s / sqrt(n), whether cases or blocks of
    them are drawn."""
    n = 25_000
    terms = terms_of(n)
    lost = np.random.default_rng(5).random(n) < 0.3
    worse = replace(terms, severity=np.where(lost, 10.0, 0.0))
    drawn = differences(terms, worse, 400, 1)["A"]
    assert drawn.mean() == pytest.approx(-lost.mean(), abs=1e-3)
    assert drawn.std() == pytest.approx(lost.std() / np.sqrt(n), rel=0.1)


def test_ends_of_differences_are_those_of_students_t(evaluation):
    cases = case_terms(cut_out(evaluation)[:9], METHOD)
    other = replace(cases, index=np.linspace(0.0, 1.0, 9) ** 2)
    settings = GateSettings(confidence=0.9)
    runs = cases, other
    change = _quantity_changes(runs, settings)["D"]
    drawn = paired_differences(*runs, settings.resamples, settings.seed)["D"]
    tails = norm.cdf(t.ppf([0.05, 0.95], len(cases.collided) - 1))
    np.testing.assert_allclose((change.low, change.high), np.quantile(drawn, tails))


def test_a_run_without_d_has_none_in_any_resample():
    """S of 90 falls to 0 by a collision that voids D. A resample without this collision has C = 1
    in both runs, so it loses the points of D, 20 to 50; all others lose 50 more."""
    calm = replace(terms_of(20), index=np.linspace(0.6, 1.0, 20))
    first = np.arange(20) == 0
    hit = replace(calm, collided=first, voids=first, ratio=np.where(first, 0.0, np.nan))
    change = _quantity_changes((calm, hit), GateSettings())["S"]
    assert (change.base, change.new, change.difference) == pytest.approx((90.0, 0.0, -90.0))
    assert change.low <= change.difference <= change.high < -20.0
