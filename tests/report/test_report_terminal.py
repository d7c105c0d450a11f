"""What a run says at its end: the table's numbers, and every thing that a person must know."""

from dataclasses import replace

import pytest
from builders import CALM, CUT_OUT
from click import unstyle
from report_cases import with_scores, with_settings

from sumo_eval.report.people import people_sentence
from sumo_eval.report.score_table import score_lines
from sumo_eval.report.score_words import reason_without
from sumo_eval.report.terminal import closing_lines, ledger_lines
from sumo_eval.report.words import count
from sumo_eval.results import NotComputed
from sumo_eval.scoring.findings import unevaluated
from sumo_eval.settings import DriverSettings


def test_control_characters_of_an_ads_do_not_reach_the_terminal(evaluation):
    odd = replace(evaluation, scores=(replace(evaluation.scores[0], ads="a\x1b[2Jb\nc"),))
    lines = [unstyle(line) for line in score_lines(odd)]
    assert not any("\x1b" in line or "\n" in line for line in lines)
    assert sum(line.startswith("a [2Jb c") for line in lines) == 1


def test_closing_lines_say_what_the_table_cannot(evaluation):
    text = "\n".join(closing_lines(evaluation))
    without = [score for score in evaluation.scores if score.d is None]
    assert without
    for score in without:
        hits = count(score.safe_collisions, "collision")
        assert f"is not computed: {hits} in the safe zone. Its term counts 0 points." in text
    assert "2 cases could not be evaluated and left the means (cases given up count in" in text
    assert "exit code -11" in text
    assert "lost the lane" in text
    assert "synthetic" in text
    assert "report.html" not in text  # the commands say where it is


def test_at_most_five_kinds_of_cases_are_listed_and_the_rest_is_counted(evaluation):
    broken = tuple(
        replace(case, status="timeout", collided=False, error=f"Lost at {number}.")
        for number, case in enumerate(evaluation.cases)
        if (case.ads, case.scenario) == (CALM, CUT_OUT)
    )
    odd = replace(evaluation, cases=broken)
    assert sum(map(len, unevaluated(odd))) == len(broken) > 5
    lines = closing_lines(odd)
    assert sum(line.startswith("  front_vehicle") for line in lines) == 5
    assert f"  and {len(broken) - 5} more, all in cases.csv." in lines


def test_nothing_is_said_of_synthetic_drivers_when_they_are_not(evaluation):
    recorded = with_settings(evaluation, drivers=DriverSettings(source="mine:drivers"))
    assert not any("synthetic" in line for line in closing_lines(recorded))
    nobody = NotComputed("no_drivers")
    bare = with_scores(evaluation, human_likeness=None, h_reason=nobody)
    told = "\n".join(closing_lines(bare))
    assert "D and H have no drivers to compare with" in told
    assert "human drivers of each concrete scenario" not in told
    first, *_, last = bare.scores
    some = [
        one if one.scenario == last.scenario else score
        for one, score in zip(bare.scores, evaluation.scores, strict=True)
    ]
    assert first.scenario != last.scenario
    told = "\n".join(closing_lines(replace(evaluation, scores=tuple(some))))
    assert f"They are not recorded people. There are none in {last.scenario}." in told
    filled = with_settings(
        replace(evaluation, scores=tuple(some)),
        drivers=DriverSettings(source="recorded", recordings=("drives.csv",)),
    )
    told = people_sentence(filled)
    assert "of drives.csv, no drive counts in any of these" in told
    without = f"There are none in {last.scenario}."
    assert f"alone. `recorded_drivers` in cases.csv counts them. {without}" in told


@pytest.mark.parametrize(
    "source, others",
    [
        ("synthetic", "this evaluation names no recorded ones"),
        ("recorded", "no recorded driver matches them"),
        ("mine:drivers", "`mine:drivers` returns no drive in them"),
    ],
)
def test_scenes_without_drivers_say_which_drivers_were_sought(evaluation, source, others):
    nobody = NotComputed("no_drivers")
    bare = with_scores(evaluation, human_likeness=None, h_reason=nobody)
    asked = with_settings(bare, drivers=DriverSettings(source=source, recordings=("drives.csv",)))
    assert people_sentence(asked).endswith(
        f"synthetic drivers do not cover these scenes, and {others}."
    )
    assert "recorded" not in reason_without("H", asked.scores[0])


def test_a_reference_that_is_too_thin_everywhere_is_too_thin_at_each_point(evaluation):
    drivers = DriverSettings(source="recorded", recordings=("drives.csv",), too_thin="leave_out")
    told = people_sentence(with_settings(evaluation, drivers=drivers))
    assert "of drives.csv, fewer than 10 drives count in each of these" in told


def test_the_ledger_on_the_terminal_adds_up_to_s_plus_and_s(evaluation):
    lines = ledger_lines(evaluation)
    for score in evaluation.scores:
        assert any(line.endswith(f"in {score.scenario}: S+ = {score.s_plus:.2f}") for line in lines)
        assert any(line.endswith(f"in {score.scenario}: S = {score.s:.2f}") for line in lines)
