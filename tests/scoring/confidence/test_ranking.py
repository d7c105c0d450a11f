"""ADSs in the order of S+: told apart by differences over the same points, not by intervals that
overlap."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refusals import refusal, refused
from scoring.test_scoring_intervals import HIT, LOST_SAFE, SAFE, SETTINGS, combined

from sumo_eval.case_table import CaseTable
from sumo_eval.report.score_table import score_lines
from sumo_eval.report.tables import scores_json
from sumo_eval.report.terminal import ranking_lines
from sumo_eval.results import Evaluation, NotComputed
from sumo_eval.scoring.confidence.drivers import NO_DEVIATIONS
from sumo_eval.scoring.confidence.ranking import rank
from sumo_eval.scoring.confidence.resamples import one_list
from sumo_eval.scoring.confidence.scored import with_intervals
from sumo_eval.scoring.quantities import combine
from sumo_eval.settings import RankingSettings

UNIFORM = np.random.default_rng(4).uniform(size=80)


def drives(ads, shift, scenario="s", own=0.0):
    """80 safe cases whose human-likeness differs from point to point, alike for every ADS, but for
    a shift."""
    noise = np.random.default_rng(len(ads)).uniform(-own, own, 80)
    return [
        replace(SAFE, case=f"{ads}{n}", ads=ads, scenario=scenario, exposure=1.0, weight=1.0,
            no_reaction_severity=0.0,
                human_likeness=0.2 + 0.5 * x + shift + e)
        for n, (x, e) in enumerate(zip(UNIFORM.tolist(), noise.tolist(), strict=True))
    ]  # fmt: skip


def scored(*tables, settings=SETTINGS):
    scores = [
        replace(
            combine("a", "s", rows, settings.method), ads=rows[0].ads, scenario=rows[0].scenario
        )
        for rows in tables
    ]
    done, found = with_intervals(
        scores, list(map(CaseTable.of, tables)), [np.arange(len(rows)) for rows in tables],
        [NO_DEVIATIONS] * len(tables),
        one_list(len(tables[0])), settings,
    )  # fmt: skip
    return done, {(one.ads, one.scenario): spread for one, spread in zip(done, found, strict=True)}


def places(ranking):
    return [(row.ads, row.place) for row in ranking.ads]


def lost_case(ads):
    return replace(LOST_SAFE, ads=ads, exposure=1.0, weight=1.0, no_reaction_severity=0.0)


def test_a_difference_over_the_same_points_tells_apart_what_two_intervals_do_not():
    scores, found = scored(drives("low", 0.0), drives("high", 0.02))
    low, high = (score.s_plus_interval for score in scores)
    assert low[1] > high[0], "the intervals overlap"
    ranking = rank(scores, found, RankingSettings())
    assert places(ranking) == [("high", 1), ("low", 2)]
    pair = ranking.pair("high", "low")
    assert pair.told_apart
    assert pair.difference == pytest.approx(50 * 0.02)
    with refused("Unknown pair `low above high` of this ranking. Known: high above low."):
        ranking.pair("low", "high")
    # One more case takes e of n + e cases from T of both: e = 0.5 ln 40 = 1.84 at most in 97.5 % of
    # the replicates
    assert pair.interval == (pytest.approx(80 / 81.84, abs=2e-3), pytest.approx(1.0)), (
        "what both have in common cancels"
    )


def test_law_a_difference_from_nothing_is_as_wide_as_the_score():
    few = drives("a", 0.0)[:6], drives("bb", 0.0)[:6]
    scores, found = scored(few[0], [replace(row, task_share=0.0) for row in few[1]])
    (pair,) = rank(scores, found, RankingSettings()).pairs
    assert pair.interval == pytest.approx(scores[0].s_plus_interval)
    alike, others = scored(drives("a", 0.0, "t"), drives("bb", 0.0, "t"))
    (pair,) = rank([*scores, *alike], found | others, RankingSettings()).pairs
    assert 2.0 * np.array(pair.interval) == pytest.approx(scores[0].s_plus_interval)


def test_one_ads_under_two_names_differs_from_itself_by_nothing_and_shares_its_place():
    """In `s` both drove alike but for the computer's time, in `t` by 0.02 of H in every case: 1
    point, and 0.5 over both scenarios. One other drive in `s` that scores the same changes nothing,
    one that scores less widens it.
    """
    one = drives("a", 0.0)
    other = [replace(row, wall_time=3.0, latency_max=0.2) for row in drives("bb", 0.0)]
    scores, found = scored(one, other)
    ranking = rank(scores, found, RankingSettings())
    assert places(ranking) == [("a", 1), ("bb", 1)]
    pair = ranking.pairs[0]
    assert (pair.difference, pair.interval, pair.told_apart) == (0.0, (0.0, 0.0), False)
    assert "(0.0..0.0) to a: scored alike in every case, the place is shared" in "\n".join(
        ranking_lines(ranking)
    )
    further, others = scored(drives("a", 0.02, "t"), drives("bb", 0.0, "t"))
    both = rank([*scores, *further], found | others, RankingSettings())
    assert both.pairs[0].interval == (pytest.approx(0.5, abs=0.02), pytest.approx(0.5))
    for less, apart in ((0.0, False), (0.1, True)):
        other[3] = replace(other[3], min_gap=7.0, human_likeness=one[3].human_likeness - less)
        staked = [[replace(row, no_reaction_severity=5.0) for row in rows] for rows in (one, other)]
        scores, found = scored(*staked)
        low, high = rank(scores, found, RankingSettings()).pairs[0].interval or (0.0, 0.0)
        assert (low < high) is apart


@pytest.mark.parametrize("shift, neighbours_apart", [(-0.1, True), (-0.016, False)])
def test_who_is_told_apart_from_the_first_has_another_place(shift, neighbours_apart):
    scores, found = scored(
        drives("a", 0.001, own=0.1), drives("bb", 0.0, own=0.1), drives("ccc", shift, own=0.1)
    )
    ranking = rank(scores, found, RankingSettings())
    assert ranking.pair("bb", "ccc").told_apart is neighbours_apart
    assert {(one.ads, one.place) for one in ranking.ads} == {("a", 1), ("bb", 1), ("ccc", 3)}
    evaluation = Evaluation("e", Path(), SETTINGS, {}, (), tuple(scores), (), ranking=ranking)
    text = "\n".join(ranking_lines(ranking))
    assert "not told apart, the place is shared" in text
    assert text.index("ccc") > text.index("bb")
    plain = scores_json(evaluation)["ranking"]
    assert [row["place"] for row in plain["ads"]] == [1, 1, 3]
    assert {"above", "below", "difference", "interval", "told_apart"} == set(plain["pairs"][0])
    assert len(plain["pairs"]) == 3


def test_the_weights_of_scenarios_decide_and_the_total_is_their_mean():
    one, found = scored(drives("a", 0.1), drives("bb", 0.0))
    two, others = scored(drives("a", 0.0, "t"), drives("bb", 0.04, "t"))
    both = rank([*one, *two], found | others, RankingSettings())
    assert [row.ads for row in both.ads] == ["a", "bb"]
    weighed = rank([*one, *two], found | others, RankingSettings({"t": 4.0}))
    assert [row.ads for row in weighed.ads] == ["bb", "a"]
    assert weighed.weights == {"s": 1.0, "t": 4.0}
    # (0.1 - 0)/5 of S+ from s, (0 - 0.04) 4/5 from t, 50 points each: 1.0 - 1.6
    assert weighed.pair("bb", "a").difference == pytest.approx(0.6)
    only = rank([*one, *two], found | others, RankingSettings({"s": 0.0}))
    assert only.ads[0].interval == two[1].s_plus_interval


def test_a_misspelt_scenario_and_weights_of_nothing_are_refused():
    scores, found = scored(drives("a", 0.0))
    with refusal(r"Unknown scenario `z` in `method.ranking.weights`"):
        rank(scores, found, RankingSettings({"z": 2.0}))
    with refusal("at least one scenario a weight above 0"):
        rank(scores, found, RankingSettings({"s": 0.0}))
    with refusal(r"`weights.s` of `RankingSettings` must be at least 0"):
        RankingSettings({"s": -1.0})


def test_an_ads_without_an_s_plus_has_no_place():
    scores, found = scored(drives("a", 0.0), drives("bb", 0.0))
    gone = [replace(scores[0], s_plus=None), scores[1]]
    ranking = rank(gone, found, RankingSettings())
    assert places(ranking) == [("bb", 1), ("a", None)]
    assert "not ranked: a has no S+ in some scenario" in "\n".join(ranking_lines(ranking))


def test_without_people_h_counts_0_and_without_a_task_a_scenario_has_no_part():
    """T = A' = 1 throughout.

    In `s` H of `a` is 0.2 above that of `bb`: 10 points, 5 over `s` and `t`. `t` has nobody to
    compare with: 50 points for both. `u` has no safe point, so no S+ and no part.
    """
    one, found = scored(drives("a", 0.2), drives("bb", 0.0))
    bare = [
        [replace(row, human_likeness=None) for row in drives(ads, 0.0, "t")] for ads in ("a", "bb")
    ]
    two, others = scored(*bare)
    two = [replace(score, h_reason=NotComputed("no_drivers")) for score in two]
    three, more = scored(
        *([replace(row, zone="hazardous") for row in drives(ads, 0.0, "u")] for ads in ("a", "bb"))
    )
    assert [(score.task_share, score.s_plus) for score in three] == [(None, None)] * 2
    ranking = rank([*one, *two, *three], found | others | more, RankingSettings())
    assert ranking.without_people == ("t",)
    assert ranking.without_task == ("u",)
    assert places(ranking) == [("a", 1), ("bb", 2)]
    assert [row.a_points for row in ranking.ads] == [pytest.approx(50.0)] * 2
    assert ranking.ads[0].s_plus == pytest.approx(ranking.ads[0].a_points + ranking.ads[0].h_points)
    assert ranking.pair("a", "bb").difference == pytest.approx(5.0)
    assert "no task, so no S+, in u; H counts 0, without people, in t" in ranking_lines(ranking)[0]
    assert [row.place for row in rank(three, more, RankingSettings()).ads] == [None, None]


def test_missing_cases_move_both_ends_on_and_keep_two_ads_from_being_told_apart():
    whole, lost = drives("low", 0.0), drives("high", 0.02)
    lost[:8] = [lost_case("high")] * 8
    scores, found = scored(whole, lost)
    high = scores[1]
    worst, best = combined(*lost).human_likeness_interval
    known = sum(row.human_likeness or 0.0 for row in lost)
    assert (worst, best) == pytest.approx((known / 80, (known + 8) / 80))
    assert high.human_likeness_interval[0] < worst < best < high.human_likeness_interval[1]
    assert not rank(scores, found, RankingSettings()).pairs[0].told_apart


def test_no_interval_of_s_reaches_beyond_what_eq_18_can_give():
    """Missing cases could all have been as good as can be, and so could the next ones: still C = D
    = 1 at most."""
    some = [
        replace(one, index=1.0 if x < 0.85 else 0.6)
        for one, x in zip(drives("some", 0.0), UNIFORM, strict=True)
    ]
    some[:40] = [lost_case("some")] * 40
    for points, most in (
        (SETTINGS.method.score, 100.0),
        (replace(SETTINGS.method.score, k5=0.8, k6=0.5), 65.0),
    ):
        settings = replace(SETTINGS, method=replace(SETTINGS.method, score=points))
        (one,), _ = scored(some, settings=settings)
        assert one.s_interval[1] <= most + 1e-9


def test_a_missing_case_counts_as_doing_nothing_and_as_the_ideal_vehicle():
    # U0 - Ug: 6 at the hit (U - Ug = 6), 10 at the lost one; A = 1 - 6/6 = 0, worst 1 - 16/16, best
    # 1 - 6/16
    hit = replace(HIT, weight=1.0, no_reaction_severity=10.0)
    lost = replace(LOST_SAFE, zone="hazardous", weight=1.0, no_reaction_severity=10.0)
    made = combined(hit, lost)
    assert made.avoided_share_interval == (pytest.approx(0.0), pytest.approx(1.0 - 6.0 / 16.0))
    assert made.regret_interval == (pytest.approx(3.0), pytest.approx(8.0)), "6/2 and 16/2 m/s"


def test_the_table_shows_an_interval_beside_every_score():
    scores, _ = scored(drives("a", 0.0))
    lines = score_lines(
        Evaluation("e", Path(), SETTINGS, {}, (), tuple(scores), ()), 300, everything=True
    )
    assert sum(line.count("..") for line in lines) == 8
