"""Intervals hold what they promise, on a problem whose answer is known, and follow from worked
numbers."""

import math

import numpy as np
import pytest
from scoring.confidence.scored_by_hand import terms_of
from tables import values_of

from sumo_eval.drivers.synthetic.population import draw_driver
from sumo_eval.method.score_terms import avoidance_grade
from sumo_eval.scoring.case_terms import scores_of
from sumo_eval.scoring.confidence import resamples as drawing
from sumo_eval.scoring.confidence.drivers import (
    NO_DEVIATIONS,
    DriverDeviations,
    exchanges,
    stratified_deviations,
)
from sumo_eval.scoring.confidence.intervals import (
    ONE_MORE,
    AdsCases,
    _with_one_more,
    score_intervals,
)
from sumo_eval.scoring.confidence.resamples import of_one_number, one_list, resamples, strata
from sumo_eval.settings import DriverSettings, MethodSettings, PopulationSettings
from sumo_eval.settings.random_streams import random_stream

METHOD = MethodSettings()


def hits(hit, share):
    """What cases with a collision have: Ug/U."""
    ratio = np.where(hit, share, np.nan)
    return {"severity": np.where(hit, 10.0, 0.0), "collided": hit, "ratio": ratio}


def judged(n=60, *, ads="one", hazardous=None, drivers=NO_DEVIATIONS, **changes):
    marked = np.ones(n, dtype=bool) if hazardous is None else hazardous
    return AdsCases(ads, terms_of(n, **changes), np.arange(n), marked, drivers)


def intervals(one, groups=None, *, seed=3, replicates=2_000):
    (found,) = score_intervals(
        [one], groups or one_list(len(one.points)), seed, "s", replicates=replicates
    )
    return found


def half(limits):
    return (limits[1] - limits[0]) / 2.0


def test_cases_that_were_all_lost_have_intervals_without_c():
    lost = np.zeros(3, dtype=bool)
    found = intervals(
        judged(3, counted=lost, evaluated=lost, incident=np.ones(3, dtype=bool)), replicates=20
    )
    assert "c" not in found.limits


def test_mean_over_a_single_case_may_be_anything():
    def limits_of(cases):
        some = np.where(np.arange(12) < cases, 0.8, np.nan)
        return intervals(judged(12, task=some, index=some, likeness=some)).limits

    alone, two = limits_of(1), limits_of(2)
    for name in ("task_share", "d", "human_likeness"):
        assert alone[name] == (0.0, 1.0)
        assert two[name][1] == pytest.approx(0.8)
    assert alone["s_plus"] == (0.0, pytest.approx(100.0))


# --- the known answer -----------------------------------------------------------------------------

DRIVERS, CASES = 10, 90
THRESHOLD = 0.3  # x above it is safe
DRIVER_SPREAD = 0.06


def truth_d():
    # exposure 1 + x over x in U(0, 1), safe where x > t = 0.3: D = int (1+x)(0.35+0.4x) / int (1+x)
    # from t to 1
    upper, lower = [0.4 / 3, 0.75 / 2, 0.35, 0.0], [0.5, 1.0, 0.0]
    over, under = (np.diff(np.polyval(of, [THRESHOLD, 1.0]))[0] for of in (upper, lower))
    return over / under


def one_experiment(random):
    x = random.uniform(size=CASES)
    shifts = DRIVER_SPREAD * random.standard_normal(DRIVERS)
    own = np.clip(0.08 * random.standard_normal(CASES), -0.2, 0.2)
    index = 0.35 + 0.4 * x + own + shifts.mean()
    hit = (x < 0.14) & (random.uniform(size=CASES) < 0.9)
    u = random.uniform(size=CASES)
    exposure, safe = 1.0 + x, x > THRESHOLD

    def weighted(values):
        return float(np.sum((exposure * values)[safe]) / np.sum(exposure[safe]))

    others = (shifts.sum() - shifts) / (DRIVERS - 1) - shifts.mean()
    left_out = np.array([weighted(index + shift) for shift in others])
    errors = stratified_deviations(left_out, [None] * DRIVERS)
    names = tuple(f"{number}" for number in range(DRIVERS + 1))
    ideal = np.where(safe, 0.0, 10.0 * (0.2 + 0.6 * u))
    return judged(
        CASES,
        hazardous=~safe,
        drivers=DriverDeviations(names, errors, errors, DRIVERS - 1),
        exposure=exposure,
        weight=1.0 + u,
        ideal=ideal,
        unreacting=np.where(safe, 0.0, 20.0),
        **hits(hit, ideal / 10.0),
        index=np.where(safe, index, np.nan),
        likeness=np.where(safe, index, np.nan),
        task=np.where(safe, index - shifts.mean(), np.nan),
    )


@pytest.mark.campaign
def test_95_per_cent_intervals_hold_the_truth_in_95_per_cent_of_200_repetitions():
    random = np.random.default_rng(2026)
    truth = {
        # nine of ten cases at x < 0.14 collide; Ug/U = 0.2 + 0.6 u, u in U(0, 1), and r = 1 + u:
        # int (1+u)(0.2+0.6u) du / int (1+u) du = (0.2 + 0.8/2 + 0.6/3) / 1.5
        "c": 0.8 / 1.5,
        "d": truth_d(),
        "human_likeness": truth_d(),
        # U = 10, Ug = 10 (0.2 + 0.6 u), U0 = 20 where x < 0.3. Lost: 0.126 int (1+u) 10 (0.8-0.6u)
        # du = 0.126 * 7; at stake: 0.3 int (1+u)(18-6u) du = 0.3 * 22
        "avoided_share": 1.0 - 0.126 * 7.0 / (0.3 * 22.0),
    }
    truth["s"] = 50.0 * truth["c"] + 50.0 * truth["d"]
    truth["task_share"] = truth_d()
    truth["avoidance_grade"] = float(avoidance_grade(truth["avoided_share"], METHOD.task.sharpness))
    truth["s_plus"] = (
        truth["task_share"] * truth["avoidance_grade"] * (50.0 + 50.0 * truth["human_likeness"])
    )
    held = dict.fromkeys(truth, 0)
    for seed in range(200):
        found = intervals(one_experiment(random), seed=seed, replicates=400)
        for name, value in truth.items():
            low, high = found.limits[name]
            held[name] += low <= value <= high
    shares = {name: count / 200 for name, count in held.items()}
    assert all(0.93 <= shares[name] <= 0.97 for name in ("c", "d", "human_likeness", "s")), shares
    # Unseen collisions, as hard as doing nothing, are twice as hard here as those that were seen:
    # A's end is too low.
    low_ends = ("avoided_share", "task_share", "avoidance_grade", "s_plus")
    assert all(0.93 <= shares[name] <= 0.995 for name in low_ends), shares


# --- the points' part -----------------------------------------------------------------------------


def test_an_interval_of_a_mean_is_students():
    # 60 equal weights, index evenly spread over 0.2..0.8: sd = 0.6 * sqrt((60 + 1) / (12 * 59)) =
    # 0.17611,
    # se = 0.17611 / sqrt(60) = 0.022736, t(59) at 97.5 % = 2.0010: half-width 0.0455
    found = intervals(judged(), replicates=20_000)
    assert half(found.limits["d"]) == pytest.approx(0.0455, rel=0.03)
    assert found.sources["s"]["cases"] == pytest.approx(50 * 0.0455, rel=0.03)
    assert found.sources["s"]["drivers"] == 0.0


def test_an_even_sample_of_a_smooth_score_has_a_narrower_interval_than_one_by_chance():
    even = intervals(judged(), strata(np.linspace(0.0, 1.0, 60)[:, None], "sobol"))
    assert half(even.limits["d"]) < 0.15 * half(intervals(judged()).limits["d"])


def test_a_trend_along_a_parameter_is_not_an_error_of_a_sample():
    unit = np.column_stack([(np.arange(64) + 0.5) / 64, np.arange(64) * 0.618034 % 1.0])
    groups = strata(unit, "sobol")
    one = judged(64, index=unit[:, 1], likeness=unit[:, 1])
    plain, even = (
        intervals(one, groups._replace(even=each)).limits["human_likeness"] for each in (None, unit)
    )
    assert half(even) < 0.25 * half(plain)


# --- what was not seen ----------------------------------------------------------------------------


def test_with_no_collision_seen_the_rule_of_three_gives_the_end_on_the_bad_side():
    # 30 hazardous points (U0 - Ug = 10 - 4 = 6), 30 others (10 - 8 = 2); 3/30 = 0.1 of the
    # hazardous ones may hold one. A: 1 - 0.1 * 30*6 / (30*6 + 30*2) = 0.925. Regret: 0.1 * 30*6 /
    # 60 = 0.3 m/s.
    # C: 1 - 0.9^30 = 0.95761 of evaluations of 30 such points see a collision and have 4/10, so 1 -
    # 0.95761 * 0.6.
    hazardous = np.arange(60) < 30
    found = intervals(judged(hazardous=hazardous, ideal=np.where(hazardous, 4.0, 8.0)))
    assert found.limits["avoided_share"] == (pytest.approx(0.925), 1.0)
    assert found.limits["avoided_share_exposure"] == (pytest.approx(0.925), 1.0)
    assert found.limits["regret"] == (0.0, pytest.approx(0.3))
    assert found.limits["c"] == (pytest.approx(1.0 - 0.95761 * 0.6, abs=1e-5), 1.0)
    assert found.limits["s"][0] < 50.0 + 50.0 * 0.5
    assert found.limits["s_plus"][0] < 50.0 + 50.0 * 0.5


def test_where_nothing_is_hazardous_all_points_count_and_where_nothing_is_at_stake_nothing_is_lost():
    none = np.zeros(60, dtype=bool)
    assert intervals(judged(hazardous=none)).limits["avoided_share"][0] == pytest.approx(
        1.0 - 3.0 / 60.0
    )
    calm = intervals(judged(hazardous=none, unreacting=np.zeros(60)))
    assert calm.limits["avoided_share"] == (1.0, 1.0)
    assert calm.limits["c"] == (1.0, 1.0)


@pytest.mark.parametrize("expected", [0.5, 1.0, 2.0])
def test_intervals_hold_the_mean_of_c_over_evaluations_most_of_which_see_no_collision(expected):
    # 30 hazardous points of 60, each of which holds a collision with the chance expected/30, Ug/U =
    # 0.4: the mean of C over evaluations is 0.4 + 0.6 (1 - expected/30)^30, about 0.76, 0.62, 0.48.
    random = np.random.default_rng(7)
    hazardous = np.arange(60) < 30
    ideal = np.where(hazardous, 4.0, 8.0)
    truth = 0.4 + 0.6 * (1.0 - expected / 30.0) ** 30
    held = 0
    for seed in range(60):
        hit = hazardous & (random.uniform(size=60) < expected / 30.0)
        one = judged(hazardous=hazardous, ideal=ideal, **hits(hit, 0.4))
        low, high = intervals(one, seed=seed, replicates=400).limits["c"]
        held += low <= truth <= high
    assert held >= 0.93 * 60


def test_s_of_an_evaluation_without_a_d_reaches_to_what_it_would_be_without_the_collision_in_the_safe_zone():
    # D_i = 0.5 everywhere, one of 60 points holds the collision, Ug/U = 0.4: S = 50 * 0.4 with it,
    # 50 + 50 * 0.5 without it, which (1 - 1/60)^59 = 0.37 of all replicates are. Neither end owes
    # anything to another collision.
    hit = np.arange(60) == 7
    found = intervals(judged(**hits(hit, 0.4), voids=hit, index=np.where(hit, np.nan, 0.5)))
    assert "d" not in found.limits
    assert found.limits["s"] == (pytest.approx(20.0), pytest.approx(75.0))


def test_fewer_points_than_three_prove_nothing():
    assert intervals(judged(hazardous=np.arange(60) < 2)).limits["c"][0] == pytest.approx(0.0)


@pytest.mark.parametrize("count", [1, 2, 5, 12])
def test_unseen_collisions_never_lift_the_lower_end_and_seen_ones_stay_inside(count):
    hit = np.arange(60) % (60 // count) == 0
    low, high = intervals(judged(**hits(hit, 0.0))).limits["avoided_share"]
    assert low < 1.0 - hit.sum() / 60.0 <= high
    assert low < intervals(judged()).limits["avoided_share"][0]


# --- the drivers' part ----------------------------------------------------------------------------


def drivers(error):
    return DriverDeviations(("a", "b"), np.array([0.6, 0.8]) * error, np.zeros(2), 9)


def test_drivers_alone_widen_d_by_students_t_of_their_number():
    # 0.6^2 + 0.8^2 = 1: t(9) at 97.5 % = 2.2622 times 0.05, for 60 points widened by t(59)/z =
    # 2.0010/1.9600
    one = judged(index=np.full(60, 0.5), drivers=drivers(0.05))
    found = intervals(one, replicates=40_000)
    assert found.sources["s"]["cases"] == pytest.approx(0.0, abs=1e-9)
    assert half(found.limits["d"]) == pytest.approx(2.2622 * 0.05, rel=0.06)
    assert found.sources["s"]["drivers"] == pytest.approx(50 * 2.2622 * 0.05, rel=0.06)
    assert found.limits["human_likeness"] == pytest.approx(
        intervals(judged()).limits["human_likeness"], abs=0.01
    )


def test_the_drivers_errors_of_one_group_are_the_jackknifes():
    values = np.array([1.0, 2.0, 4.0, 9.0])
    left_out = np.array([(values.sum() - value) / 3 for value in values])
    errors = stratified_deviations(left_out, [None] * 4)
    assert math.sqrt(np.sum(errors**2)) == pytest.approx(values.std(ddof=1) / math.sqrt(4))


def test_the_drivers_errors_of_a_mean_are_those_of_a_stratified_sample():
    # 3 followers, 5 overtakers. Variance of the mean: sum over groups of n_h s_h^2 / n^2; the
    # difference between the groups has no part in it, but for the rounding: 8 * 0.6 = 4.8
    # overtakers are 4 or 5, a deviation of
    # sqrt(0.8 * 0.2) = 0.4 drivers; a follower counted twice in the place of an overtaker moves the
    # mean by
    # (the means' difference)/8 in the mean over all such exchanges.
    groups = [True] * 5 + [False] * 3
    values = np.array([5.0, 6.0, 5.5, 7.0, 6.5, 1.0, 0.5, 2.0])
    left_out = (values.sum() - values) / 7
    over, follow = values[:5], values[5:]
    change = float(
        np.mean(
            [(values.sum() - one + other) / 8 - values.mean() for one in over for other in follow]
        )
    )
    errors = stratified_deviations(left_out, groups, 0.6, change)
    variance = (5 * over.var(ddof=1) + 3 * follow.var(ddof=1)) / 64
    assert np.sum(errors[:-1] ** 2) == pytest.approx(variance)
    assert errors[-1] == pytest.approx(-0.4 * (over.mean() - follow.mean()) / 8), (
        "a follower for an overtaker"
    )
    assert stratified_deviations(left_out, groups, 1.0, change)[-1] == 0.0
    assert np.sum(errors**2) < np.sum(stratified_deviations(left_out, [None] * 8) ** 2)


@pytest.mark.parametrize(
    "seed, share",
    values_of("""
    0, 0.64
    1, 0.64
    2, 0.64
    0, 0.5
    3, 0.05
    4, 0.96
    """),
)
def test_a_case_rounded_up_leaves_once_and_another_counts_twice(seed, share):
    settings = DriverSettings(count=10, population=PopulationSettings(overtake_share=share))
    names = [f"driver_{index:02d}" for index in range(10)]
    overtakes = np.array(
        [draw_driver(index, seed, settings.population).overtakes for index in range(10)]
    )
    found = exchanges(names, settings, seed)
    if len(set(overtakes)) == 1:
        assert found == ()
        return
    leave, twice = np.array(found).T
    assert set(overtakes[leave]) == {overtakes.sum() > 10 * share}
    assert set(overtakes[twice]) == {not overtakes.sum() > 10 * share}
    assert list(leave) == list(np.flatnonzero(overtakes == overtakes[leave[0]])), (
        "each of them once"
    )
    times = np.bincount(twice)[np.unique(twice)]
    assert times.max() - times.min() <= 1, "all of the others as often"


def test_nothing_is_exchanged_among_recorded_people():
    assert (
        exchanges(["person_1", "person_2", "driver_00"], DriverSettings(source="recorded"), 1) == ()
    )
    assert exchanges(["driver_00"], DriverSettings(), 1) == ()


# --- one ADS's own --------------------------------------------------------------------------------


def test_no_digit_depends_on_company_or_order():
    hit = np.arange(60) == 7
    one = judged(drivers=drivers(0.05))
    other = judged(ads="other", **hits(hit, 0.0))
    alone = intervals(one)
    first, _ = score_intervals([one, other], one_list(60), 3, "s")
    _, last = score_intervals([other, one], one_list(60), 3, "s")
    for found in (first, last):
        assert found.limits == alone.limits
        assert found.sources == alone.sources
        assert np.array_equal(found.worse, alone.worse)
    ends, renamed = (intervals(each).limits for each in (other, other._replace(ads="renamed")))
    assert renamed["avoided_share"] != ends["avoided_share"], "unseen collisions are an ADS's own"
    assert renamed["s_plus"] == ends["s_plus"], "the one more case is the scenario's"


# --- part by part ---------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["even", "chance", "numbered"])
def test_law_scores_added_up_part_by_part_are_those_of_whole_replicates(how, monkeypatch):
    """The plain twin holds how often every point stands in every replicate, and asks for the scores
    of all at once."""
    monkeypatch.setattr(drawing, "AT_ONCE", 3_000)  # 30 points with 100 replicates
    random = np.random.default_rng(5)
    unit = random.random((200, 2))
    groups = {
        "even": strata(unit, "sobol"),
        "chance": one_list(200),
        "numbered": of_one_number(unit[:, 0] // 0.3),
    }[how]
    at = random.permutation(200)[:170]  # the others could not be driven
    hit, safe = random.random(170) < 0.2, random.random(170) < 0.4
    one = judged(
        170, hazardous=~safe, unreacting=np.where(safe, 0.0, 20.0),
        **hits(hit, random.random(170)), weight=1.0 + random.random(170),
        voids=hit & (at == at[hit][0]), exposure=np.where(at < 60, 0.0, random.random(170)),
        index=np.where(safe, random.random(170), np.nan),
        likeness=np.where(safe, random.random(170), np.nan),
    )  # fmt: skip
    one = one._replace(points=at)
    (found,) = score_intervals([one], groups, 3, "s", replicates=100)

    counts, drawn = np.full((100, 200), np.nan), np.full((100, 200), np.nan)
    for part in resamples(groups, 100, 3, ("intervals", "s")):
        assert len(part.places) <= 30
        assert np.isnan(counts[:, part.places]).all(), "every point once"
        counts[:, part.places], drawn[:, part.places] = part.counts, part.drawn
    whole = scores_of(one.terms, counts[:, at], drawn[:, at])
    assert found.better == pytest.approx(whole["s_plus"], rel=1e-12)
    one_more = random_stream(3, "intervals", "one more", "s").exponential(ONE_MORE, 100)
    assert found.worse == pytest.approx(
        _with_one_more(whole, whole, one.terms, one_more)["s_plus"], rel=1e-12
    )


def test_many_cases_are_drawn_in_parts_that_are_one_interval():
    # 3,000 points: 2,000 replicates do not fit at once
    n = 3_000
    found = intervals(judged(n), strata(np.linspace(0, 1, n)[:, None], "halton"))
    assert len(found.worse) == 2_000
    assert found.limits["d"][0] <= 0.5 <= found.limits["d"][1]
