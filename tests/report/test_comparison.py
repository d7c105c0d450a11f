"""Two runs side by side: what changed is found whatever the order, and nothing else is compared in
silence."""

from dataclasses import replace

import pytest
from builders import CALM, CUT_OUT, HOSTILE
from refusals import refusal
from report_cases import HIT, pick, with_case, with_settings

from sumo_eval.errors import InputError
from sumo_eval.nightly.gates import _moved
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.report.comparison_lines import (
    change_lines,
    comparison_notes,
    moved_words,
    quantity_words,
)
from sumo_eval.scoring.comparison import QuantityChange, compare
from sumo_eval.scoring.gate_settings import GateSettings
from sumo_eval.scoring.kept_scores import KeptScoring
from sumo_eval.settings import AdsSettings

GATE = GateSettings(resamples=200)


def changes(comparison):
    return [(item.change, item.new.case) for one in comparison.ads for item in one.changed]


def test_a_run_beside_itself_has_no_change_and_intervals_of_zero_width(evaluation):
    comparison = compare(evaluation, evaluation, GATE)
    assert changes(comparison) == []
    assert comparison.differences == ()
    assert sum(one.pairs for one in comparison.ads) == len(evaluation.cases)
    for one in comparison.ads:
        for change in one.quantities.values():
            assert (change.difference, change.low, change.high) in (
                (0.0, 0.0, 0.0),
                (None, None, None),
            )


def test_the_quantities_over_all_pairs_are_the_printed_ones(evaluation):
    for one in compare(evaluation, evaluation, GATE).ads:
        score = evaluation.score(one.ads, one.scenario)
        printed = {
            "A": score.avoided_share, "regret": score.regret, "H": score.human_likeness,
            "S+": score.s_plus,
            "S": score.s, "C": score.c, "D": score.d,
        }  # fmt: skip
        for name, value in printed.items():
            assert one.quantities[name].new == (
                None if value is None else pytest.approx(value, abs=1e-12)
            )


def test_a_single_pair_has_no_interval_of_a_change(evaluation):
    """One pair does not show how far pairs differ: 95 % of nothing is no ground for a gate."""
    likened = pick(evaluation, collided=False, zone="safe")
    one = replace(evaluation, cases=(likened,))
    worse = with_case(one, likened, task_share=0.2, human_likeness=0.1, index=0.1)
    (part,) = compare(one, worse, GATE).ads
    assert part.quantities["S+"].difference < 0.0
    assert not any(change.certain for change in part.quantities.values())
    (same,) = compare(one, one, GATE).ads
    assert same.quantities["S+"].unchanged


def test_one_safe_pair_leaves_means_without_interval(evaluation):
    group = evaluation.cases_of(CALM, CUT_OUT)
    likened = next(case for case in group if case.safe and case.index is not None)
    few = [case for case in group if not case.safe or case.case == likened.case]
    assert len(few) > 2
    run = replace(evaluation, cases=few)
    worse = with_case(run, likened, task_share=0.2, human_likeness=0.1, index=0.1)
    (part,) = compare(run, worse, GATE).ads
    changes = part.quantities
    assert changes["T"].difference < 0.0
    assert [name for name in ("T", "H", "D", "S+", "S") if changes[name].low is not None] == []
    assert changes["A"].unchanged


def test_every_kind_of_change_is_found_and_named(evaluation):
    safe, struck = pick(evaluation, collided=False), pick(evaluation, collided=True)
    likened = pick(evaluation, collided=False, zone="safe")
    for worse, better, case, change in (
        ("new collision", "collision gone", safe, HIT),
        ("harsher", "softer", struck, {"severity": 12.0}),
        ("less human", "more human", likened, {"index": likened.index - 0.1}),
        ("left the road", "back on the road", safe, {"status": "off_road"}),
        ("left the road", "back on the road", safe, {"departure_time": 2.0}),
        ("not evaluated any more", "evaluated again", safe, {"status": "timeout"}),
    ):
        other = with_case(evaluation, case, **change)
        forth, back = compare(evaluation, other, GATE), compare(other, evaluation, GATE)
        assert changes(forth) == [(worse, case.case)]
        assert changes(back) == [(better, case.case)]
        assert forth.worse == back.better == 1
        assert not forth.better
        assert not back.worse


def test_no_improvement_hides_a_change_for_the_worse(evaluation):
    """Leaving the road instead of a collision, or a collision where there was no outcome, is not
    an improvement."""
    struck, safe = pick(evaluation, collided=True), pick(evaluation, collided=False)
    gone = {"status": "ok", "collided": False, "severity": None, "departure_time": 2.0}
    lost = with_case(evaluation, safe, status="timeout")
    for base, new, change, case in (
        (evaluation, with_case(evaluation, struck, **gone), "left the road", struck),
        (lost, with_case(evaluation, safe, **HIT), "new collision", safe),
    ):
        comparison = compare(base, new, GATE)
        assert changes(comparison) == [(change, case.case)]
        assert comparison.better == 0


def test_changes_that_are_not_listed_are_in_the_junit_file(evaluation, monkeypatch):
    monkeypatch.setattr("sumo_eval.report.comparison_lines.MOST_CHANGES", 0)
    case = pick(evaluation, collided=False)
    comparison = compare(evaluation, with_case(evaluation, case, **HIT), GATE)
    assert "    and 1 more; `sumo-eval compare --junit` lists all." in change_lines(comparison)


def test_a_case_that_is_less_human_only_in_h_is_found_with_what_it_moved(evaluation):
    likened = pick(evaluation, collided=False, zone="safe")
    less = (likened.human_likeness or 0.0) - 0.2
    other = with_case(evaluation, likened, human_likeness=less)
    (item,) = (item for one in compare(evaluation, other, GATE).ads for item in one.changed.worse)
    assert item.change == "less human"
    assert item.by == pytest.approx(-0.2)
    assert item.moved == {"H_i": pytest.approx(-0.2)}
    assert moved_words(item, " m/s") == ["H_i -0.2"]


def test_a_new_collision_says_by_how_much_the_regret_grew(evaluation):
    """The ideal vehicle avoids, so the regret of the case grows by U = 5 m/s, and A falls."""
    safe = pick(evaluation, collided=False)
    comparison = compare(evaluation, with_case(evaluation, safe, **HIT), GATE)
    (item,) = (item for one in comparison.ads for item in one.changed.worse)
    assert item.moved["regret"] == pytest.approx(5.0)
    (change,) = [
        one.quantities["A"]
        for one in comparison.ads
        if (one.ads, one.scenario) == (safe.ads, safe.scenario)
    ]
    assert change.difference < 0.0


def test_a_change_below_the_tolerance_is_none(evaluation):
    struck = pick(evaluation, collided=True)
    other = with_case(evaluation, struck, severity=struck.severity + 0.05)
    assert changes(compare(evaluation, other, GATE)) == []
    assert changes(compare(evaluation, other, replace(GATE, harsher_by=0.04))) == [
        ("harsher", struck.case)
    ]


def test_kept_rows_compare_as_rows_in_memory_do(evaluation, tmp_path):
    """Columns that are read in arrays have every number, missing ones too, that the rows have."""
    changed = with_case(evaluation, pick(evaluation, collided=False), **HIT)
    kept, runs = KeptResults(tmp_path), []
    for key, run in ((b"base", evaluation), (b"new", changed)):
        writer = KeptScoring(kept, key)
        pairs = [(score.ads, score.scenario) for score in run.scores]
        for ads, scenario in pairs:
            cases = run.cases_of(ads, scenario)
            writer.add(list(cases[:3]))  # in chunks of their own
            writer.add(list(cases[3:]))
        runs.append(replace(run, cases=writer.table(writer.chunks(pairs))))
    found, known = compare(*runs, GATE), compare(evaluation, changed, GATE)
    kept.close()
    assert changes(known)
    assert [(one.quantities, one.counts, one.pairs) for one in found.ads] == [
        (one.quantities, one.counts, one.pairs) for one in known.ads
    ]


def test_counts_of_a_comparison_are_those_of_its_rows(evaluation):
    for one in compare(evaluation, evaluation, GATE).ads:
        rows = list(one.changed.paired.new)
        expected = {
            "collisions": sum(case.collided for case in rows),
            "avoidable_collisions": sum(case.avoidable for case in rows),
            "unavoidable_collisions": sum(case.unavoidable for case in rows),
            "caused_collisions": sum(case.caused for case in rows),
            "safe_collisions": sum(case.collided and case.zone == "safe" for case in rows),
            "off_road": sum(case.status == "off_road" for case in rows),
            "departures": sum(case.departed for case in rows),
            "gave_up": sum(case.gave_up for case in rows),
            "not_evaluated": sum(not case.evaluated for case in rows),
            "requirements_missed": sum(bool(case.requirements_missed) for case in rows),
        }
        assert one.counts == {name: (number, number) for name, number in expected.items()}


def test_not_evaluated_counts_what_the_table_counts(evaluation):
    """A case without Ug is not evaluated in the table of scores; a limit on a rise sees it too."""
    case = pick(evaluation, collided=False)
    other = with_case(evaluation, case, ideal_severity=None)
    part = next(
        one
        for one in compare(evaluation, other, GATE).ads
        if (one.ads, one.scenario) == (case.ads, case.scenario)
    )
    before, now = part.counts["not_evaluated"]
    assert before == evaluation.score(case.ads, case.scenario).not_evaluated
    assert now == before + 1


def test_cases_are_paired_by_their_values_not_by_their_order_or_number(evaluation):
    renumbered = [
        replace(case, case=f"other-{number}")
        for number, case in enumerate(reversed(evaluation.cases))
    ]
    other = replace(evaluation, cases=tuple(renumbered))
    assert changes(compare(evaluation, other, GATE)) == []


def test_a_case_in_one_run_only_is_counted_and_said(evaluation):
    comparison = compare(evaluation, replace(evaluation, cases=evaluation.cases[1:]), GATE)
    assert len(comparison.ads[0].changed.paired.lost) == 1
    assert any("exist in one run only" in note for note in comparison_notes(comparison))


def test_a_case_with_another_exposure_is_counted_and_said(evaluation):
    case = evaluation.cases[0]
    new = with_case(evaluation, case, exposure=2.0 * case.exposure)
    notes = [*comparison_notes(compare(evaluation, new, GATE))]
    assert notes == ["The exposure differs from the base in 1 case."]


def test_an_ads_without_a_partner_is_said_and_a_pair_can_be_named(evaluation):
    scores, cases = (
        tuple(replace(it, ads="new") if it.ads == CALM else it for it in items)
        for items in (evaluation.scores, evaluation.cases)
    )
    renamed = replace(evaluation, scores=scores, cases=cases)
    comparison = compare(evaluation, renamed, GATE)
    assert {one.ads for one in comparison.ads} == {HOSTILE}
    assert any("`new` is not in the base" in note for note in comparison_notes(comparison))
    paired = compare(evaluation, renamed, GATE, pairs={CALM: "new"})
    assert {(one.base_ads, one.ads) for one in paired.ads} >= {(CALM, "new")}
    with refusal(r"Unknown ADS `calmer`\. Did you mean `calm`"):
        compare(evaluation, renamed, GATE, pairs={"calmer": "new"})


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda e: with_settings(e, seed=2), "seed: 1 in the base, 2 in "
                                                                     "the new run"),
        (
            lambda e: with_settings(e, simulation=replace(e.settings.simulation, step=0.1)),
            "simulation.step: 0.05 in the base, 0.1 in the new run",
        ),
        (
            lambda e: with_settings(e, scenario=e.settings.scenario[:1]),
            "scenario.front_vehicle_cut_out",
        ),
        (
            lambda e: replace(e,
                manifest={**e.manifest, "versions": {**e.manifest["versions"], "libsumo": "1.29"}}),
            "version of libsumo: 1.28 in the base, 1.29 in the new run",
        ),
        (
            lambda e: replace(e,
                manifest={**e.manifest, "sha256": {"routes/front_vehicle_cut_out.rou.xml": "ab"}}),
            "routes/front_vehicle_cut_out.rou.xml: not set in the base, ab in the new run",
        ),
    ],
)  # fmt: skip
def test_what_could_change_a_score_by_itself_is_refused_unless_accepted(evaluation, change, words):
    other = change(evaluation)
    with pytest.raises(InputError, match="not only the ADS differs") as caught:
        compare(evaluation, other, GATE)
    assert words in str(caught.value)
    assert str(caught.value).count("\n  ") == 1  # one line a difference
    comparison = compare(evaluation, other, GATE, accept_differences=True)
    assert any(words in item.words and item.decides for item in comparison.differences)


def test_edited_recordings_are_refused(evaluation):
    base, other = (
        replace(evaluation, manifest={**evaluation.manifest, "files": {"people.csv": sha256}})
        for sha256 in ("aa", "bb")
    )
    with pytest.raises(InputError, match="csv: aa in the base, bb in the new run"):
        compare(base, other, GATE)
    # an earlier version of this package did not record the hashes
    assert compare(evaluation, other, GATE).differences == ()


def test_changed_limits_and_scenario_code_are_shown_and_not_refused(evaluation):
    base, edited = (
        replace(evaluation, exposures={"cut_in": {"file": "", "code": sha256}})
        for sha256 in ("aa", "bb")
    )
    other = with_settings(edited, run=replace(edited.settings.run, step_timeout=0.01))
    assert [item.words for item in compare(base, other, GATE).differences] == [
        "code of scenario cut_in: aa in the base, bb in the new run",
        "run.step_timeout: 1.0 in the base, 0.01 in the new run",
    ]


def test_another_controller_or_another_version_of_numpy_is_shown_and_not_refused(evaluation):
    versions = {**evaluation.manifest["versions"], "numpy": "3.0"}
    ads = (AdsSettings(CALM, "lane_changer"), *evaluation.settings.ads[1:])
    other = replace(
        with_settings(evaluation, ads=ads), manifest={**evaluation.manifest, "versions": versions}
    )
    words = [item.words for item in compare(evaluation, other, GATE).differences]
    assert "version of numpy: not set in the base, 3.0 in the new run" in words
    assert "controller of calm: idm in the base, lane_changer in the new run" in words


@pytest.mark.parametrize("confidence, printed", [(0.95, "95"), (0.995, "99.5"), (0.9999, "99.99")])
def test_a_confidence_is_printed_as_it_was_set(confidence, printed):
    change = QuantityChange(71.2, 70.1, -1.1, -2.0, -0.4)
    assert quantity_words("S+", change, confidence) == (
        f"71.20 -> 70.10, -1.10 ({printed}% interval of the difference: -2.00 to -0.40)"
    )
    assert _moved("S+", change, "", confidence).endswith(f"within -2 to -0.4 ({printed}%)")
