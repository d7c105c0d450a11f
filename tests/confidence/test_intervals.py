"""Intervals hold what they promise, on a problem whose answer is known."""

import math

import numpy as np
import pytest

from sumo_eval.confidence.intervals import CaseTerms, jackknife_error, score_intervals
from sumo_eval.errors import InputError
from sumo_eval.settings import ScoreSettings

SCORE = ScoreSettings()


def terms(**changes):
    n = 60
    plain = {
        "exposure": np.ones(n),
        "collided": np.zeros(n, dtype=bool),
        "avoided": np.full(n, np.nan),
        "weight": np.full(n, np.nan),
        "index": np.linspace(0.2, 0.8, n),
        "y": np.ones(n),
        "boundary": np.zeros((n, 0)),
        "driver_error": 0.0,
        "drivers": 10,
    }
    return CaseTerms(**{**plain, **changes})


def stream(seed=3):
    return np.random.default_rng(seed)


# --- the known answer -------------------------------------------------------------------------------------------------

DRIVERS, CASES = 10, 90
THRESHOLD, THRESHOLD_ERROR = 0.3, 0.04  # x above it is safe; what is measured of it is off by so much
DRIVER_SPREAD = 0.06


def expected_index(x):
    return 0.35 + 0.4 * x


def truth_d():
    # exposure 1 + x over x in U(0, 1), safe where x > t = 0.3: D = int (1+x)(0.35+0.4x) / int (1+x) from t to 1
    def upper(x):
        return 0.35 * x + 0.75 * x**2 / 2 + 0.4 * x**3 / 3

    def lower(x):
        return x + x**2 / 2

    return (upper(1.0) - upper(THRESHOLD)) / (lower(1.0) - lower(THRESHOLD))


def truth_c():
    # nine of ten cases at x < 0.14 collide, far from the safe zone; Ug/U = 0.2 + 0.6 u, u in U(0, 1), and r = 1 + u:
    # int (1+u)(0.2+0.6u) du / int (1+u) du = (0.2 + 0.8/2 + 0.6/3) / 1.5
    return 0.8 / 1.5


def one_experiment(random):
    x = random.uniform(size=CASES)
    threshold = THRESHOLD + THRESHOLD_ERROR * random.standard_normal()
    shifts = DRIVER_SPREAD * random.standard_normal(DRIVERS)
    own = np.clip(0.08 * random.standard_normal(CASES), -0.2, 0.2)
    index = expected_index(x) + own + shifts.mean()
    hit = (x < THRESHOLD - 4 * THRESHOLD_ERROR) & (random.uniform(size=CASES) < 0.9)
    u = random.uniform(size=CASES)
    exposure, safe = 1.0 + x, x > threshold

    def weighted(values):
        return float(np.sum((exposure * values)[safe]) / np.sum(exposure[safe]))

    left_out = [weighted(index - shifts.mean() + (shifts.sum() - shift) / (DRIVERS - 1)) for shift in shifts]
    return CaseTerms(
        exposure=exposure,
        collided=hit,
        avoided=np.where(hit, 0.2 + 0.6 * u, np.nan),
        weight=np.where(hit, 1.0 + u, np.nan),
        index=np.where(hit, np.nan, index),
        y=x - threshold,
        boundary=np.full((CASES, 1), THRESHOLD_ERROR),
        driver_error=jackknife_error(left_out),
        drivers=DRIVERS,
    )


def test_95_per_cent_intervals_hold_the_truth_in_95_per_cent_of_500_repetitions():
    random = np.random.default_rng(2026)
    held = {"c": 0, "d": 0, "s": 0}
    truth = {"c": truth_c(), "d": truth_d()}
    truth["s"] = 50.0 * truth["c"] + 50.0 * truth["d"]
    for _ in range(500):
        found = score_intervals(one_experiment(random), SCORE, random, replicates=600)
        for name in held:
            interval = getattr(found, name)
            held[name] += interval is not None and interval.low <= truth[name] <= interval.high
    shares = {name: count / 500 for name, count in held.items()}
    assert all(0.93 <= share <= 0.97 for share in shares.values()), shares


# --- laws -------------------------------------------------------------------------------------------------------------


def test_an_interval_of_a_mean_is_students():
    # 60 equal weights, index evenly spread over 0.2..0.8: sd = 0.6 * sqrt((60 + 1) / (12 * 59)) = 0.17611,
    # se = 0.17611 / sqrt(60) = 0.022736, t(59) at 97.5 % = 2.0010: half-width 0.0455
    found = score_intervals(terms(), SCORE, stream(), replicates=20_000)
    assert found.d.value == pytest.approx(0.5)
    assert found.d.half_width == pytest.approx(0.0455, rel=0.03)
    assert found.s.value == pytest.approx(50 + 25)
    assert found.s.half_width == pytest.approx(50 * 0.0455, rel=0.03)


def test_no_collision_leaves_c_at_1_without_a_width():
    found = score_intervals(terms(), SCORE, stream())
    assert (found.c.low, found.c.value, found.c.high) == (1.0, 1.0, 1.0)


def test_drivers_alone_widen_d_by_students_t_of_their_number():
    # t(9) at 97.5 % = 2.2622 times 0.05
    found = score_intervals(terms(index=np.full(60, 0.5), driver_error=0.05), SCORE, stream(), replicates=40_000)
    assert found.sources["cases"] == pytest.approx(0.0, abs=1e-9)
    assert found.d.half_width == pytest.approx(2.2622 * 0.05, rel=0.06)
    assert found.sources["drivers"] == pytest.approx(50 * 2.2622 * 0.05, rel=0.06)


def test_a_collision_that_may_lie_in_the_safe_zone_may_cost_the_whole_d():
    hit = np.arange(60) == 7
    y = np.where(hit, -0.1, 1.0)
    boundary = np.where(hit, 0.1, 0.0)[:, None]  # y is -0.1 +- 0.1: safe with probability 1 - Phi(1) = 0.159
    shared = {
        "collided": hit,
        "avoided": np.where(hit, 0.5, np.nan),
        "weight": np.where(hit, 1.0, np.nan),
        "index": np.where(hit, np.nan, 0.5),
        "y": y,
        "boundary": boundary,
    }
    found = score_intervals(terms(**shared), SCORE, stream(), replicates=20_000)
    # and it is in the replicate at all with probability 1 - (1 - 1/60)^60 = 0.635: 0.159 * 0.635 = 0.101
    assert found.d_lost == pytest.approx(0.101, abs=0.01)
    assert found.s.low == pytest.approx(25.0)  # C = 0.5, no D
    sure = score_intervals(terms(**{**shared, "boundary": np.zeros((60, 0))}), SCORE, stream())
    assert sure.d_lost == 0.0


def test_same_stream_same_interval():
    assert score_intervals(terms(), SCORE, stream(5)) == score_intervals(terms(), SCORE, stream(5))


def test_the_jackknife_of_a_mean_is_its_standard_error():
    values = np.array([1.0, 2.0, 4.0, 9.0])
    left_out = [(values.sum() - value) / 3 for value in values]
    assert jackknife_error(left_out) == pytest.approx(values.std(ddof=1) / math.sqrt(4))


def test_one_case_has_no_interval():
    with pytest.raises(InputError, match="at least 2"):
        score_intervals(
            CaseTerms(
                np.ones(1), np.zeros(1, bool), np.full(1, np.nan), np.full(1, np.nan), np.ones(1), np.ones(1),
                np.zeros((1, 0)), 0.0, 10,
            ), SCORE, stream(),
        )  # fmt: skip
