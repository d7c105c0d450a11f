"""What a run says at its end: the table's numbers, and every thing that a person must know."""

from __future__ import annotations

import io
from dataclasses import replace

import builders
from rich.console import Console

from sumo_eval.report.terminal import COLUMNS, closing_lines, ledger_lines, plain_table, score_table
from sumo_eval.report.words import count, unevaluated
from sumo_eval.results import Evaluation, NotComputed
from sumo_eval.settings import DriverSettings


def rendered(evaluation: Evaluation) -> str:
    console = Console(file=io.StringIO(), width=200, force_terminal=True, color_system=None)
    console.print(score_table(evaluation))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_both_tables_show_the_same_numbers(evaluation: Evaluation) -> None:
    for text in (rendered(evaluation), plain_table(evaluation)):
        for score in evaluation.scores:
            assert f"{score.c:.3f}" in text
            assert f"{score.s:.1f}" in text
            assert f"{score.avoided_share:.3f}" in text
            assert f"{score.s_plus:.1f}" in text
            assert score.scenario in text
        assert "not computed" in text


def test_an_ads_name_is_never_read_as_a_colour(evaluation: Evaluation) -> None:
    assert "[red]" in rendered(evaluation)


def test_control_characters_of_an_ads_do_not_reach_the_terminal(evaluation: Evaluation) -> None:
    odd = replace(evaluation, scores=(replace(evaluation.scores[0], ads="a\x1b[2Jb\nc"),))
    assert "\x1b" not in plain_table(odd)
    assert len(plain_table(odd).splitlines()) == 2


def test_the_plain_table_is_aligned(evaluation: Evaluation) -> None:
    lines = plain_table(evaluation).splitlines()
    assert len(lines) == 1 + len(evaluation.scores)
    assert len({line.index("front_vehicle") for line in lines[1:]}) == 1
    assert not any(line != line.rstrip() for line in lines)


def test_closing_lines_say_what_the_table_cannot(evaluation: Evaluation) -> None:
    lines = closing_lines(evaluation)
    text = "\n".join(lines)
    without = [score for score in evaluation.scores if score.d is None]
    assert without
    for score in without:
        hits = count(score.safe_collisions, "collision")
        assert f"is not computed: {hits} in the safe zone. Its term counts 0 points." in text
    assert "2 cases could not be evaluated" in text
    assert "exit code -11" in text
    assert "lost the lane" in text
    assert "synthetic" in text
    assert str(evaluation.folder / "report.html") in lines[-1]


def test_at_most_five_kinds_of_cases_are_listed_and_the_rest_is_counted(evaluation: Evaluation) -> None:
    broken = tuple(
        replace(case, status="timeout", collided=False, error=f"Lost at {number}.")
        for number, case in enumerate(evaluation.cases)
        if (case.ads, case.scenario) == (builders.CALM, builders.SCENARIOS[1])
    )
    odd = replace(evaluation, cases=broken)
    assert len(unevaluated(odd)) == len(broken) > 5
    lines = closing_lines(odd)
    assert sum(line.startswith("  front_vehicle") for line in lines) == 5
    assert f"  and {len(broken) - 5} more, all in the report." in lines


def test_nothing_is_said_of_synthetic_drivers_when_they_are_not(evaluation: Evaluation) -> None:
    recorded = replace(evaluation.settings, drivers=DriverSettings(source="mine:drivers"))
    assert not any("synthetic" in line for line in closing_lines(replace(evaluation, settings=recorded)))
    nobody = NotComputed("no_drivers")
    alone = [replace(score, human_likeness=None, h_reason=nobody) for score in evaluation.scores]
    told = "\n".join(closing_lines(replace(evaluation, scores=tuple(alone))))
    assert "There is nobody whom D and H compare with" in told
    assert "human drivers of each concrete scenario" not in told
    (first, *_), (last, *_) = alone, reversed(alone)
    some = [
        one if one.scenario == last.scenario else score for one, score in zip(alone, evaluation.scores, strict=True)
    ]
    assert first.scenario != last.scenario
    told = "\n".join(closing_lines(replace(evaluation, scores=tuple(some))))
    assert f"They are not recorded people. In {last.scenario} there is nobody to compare with." in told


def with_intervals(evaluation: Evaluation) -> Evaluation:
    low_high = {"avoided_share": (-0.25, 1.0), "human_likeness": (0.0, 0.75), "s_plus": (12.5, 100.0), "c": (0.5, 1.0)}
    intervals = {f"{name}_interval": values for name, values in low_high.items()}
    return replace(evaluation, scores=tuple(replace(score, **intervals) for score in evaluation.scores))  # type: ignore[arg-type]


def test_an_interval_stands_with_its_score_on_every_terminal(evaluation: Evaluation) -> None:
    odd = with_intervals(evaluation)
    narrow, plain = ("-0.25..1.00", "0.00..0.75", "12..100", "0.50..1.00"), ("-0.250..1.000", "12.5..100.0")
    for text, intervals in ((rendered(odd), narrow), (plain_table(odd), plain)):
        for interval in intervals:
            assert text.count(interval) >= len(odd.scores)


def test_the_collisions_and_the_scores_that_order_come_before_the_papers(evaluation: Evaluation) -> None:
    heading = plain_table(evaluation).splitlines()[0].split()
    leading = ["collisions", "avoidable", "unavoidable", "caused", "T", "A'", "A", "H", "S+", "C", "D", "S"]
    assert [word for word in heading if word in leading][: len(leading)] == leading


def test_no_line_is_wider_than_the_terminal_and_nothing_is_cut(evaluation: Evaluation) -> None:
    """Eighty columns: the paper's scores move to a table of their own, below."""
    short = with_intervals(evaluation)
    short = replace(short, scores=tuple(score for score in short.scores if score.ads == builders.CALM))
    for width in (80, 120, 160):
        console = Console(file=io.StringIO(), width=width, force_terminal=True, color_system=None)
        console.print(score_table(short, width))
        text = console.file.getvalue()  # type: ignore[attr-defined]
        assert max(map(len, text.splitlines())) <= width
        assert "…" not in text
        for score in short.scores:
            assert f"{score.s_plus:.1f}" in text
            assert f"{score.s:.1f}" in text


def test_no_word_of_a_table_is_broken_at_eighty_columns(evaluation: Evaluation) -> None:
    """Every heading's words and every name of up to 24 characters stand in one piece, in lines of up to 80."""
    for ads in ("idm", "acc_aeb_with_long_name_1"):
        odd = with_intervals(replace(evaluation, scores=tuple(replace(one, ads=ads) for one in evaluation.scores)))
        console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None)
        console.print(score_table(odd, 80))
        text = console.file.getvalue()  # type: ignore[attr-defined]
        assert max(map(len, text.splitlines())) <= 80
        assert {word for heading in COLUMNS[2:] for word in heading.split()} <= set(text.split())
        assert {ads, *(score.scenario for score in odd.scores)} <= set(text.split())
        assert "not computed" in text


def test_the_ledger_on_the_terminal_adds_up_to_s_plus_and_s(evaluation: Evaluation) -> None:
    lines = ledger_lines(evaluation)
    for score in evaluation.scores:
        assert any(line.endswith(f"in {score.scenario}: S+ = {score.s_plus:.2f}") for line in lines)
        assert any(line.endswith(f"in {score.scenario}: S = {score.s:.2f}") for line in lines)
