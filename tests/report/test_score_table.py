"""The tables of scores in text: as wide as the terminal at most, a row an ADS and scenario, every
number somewhere."""

from dataclasses import replace

import click
import pytest

from sumo_eval.report.score_table import BY_IMPORTANCE, FIRST, MORE, cells_of, score_lines

LONG = ("acc", "front_assist_planner_of_the_year_2026_a", "front_assist_planner_of_the_year_2026_b")
INTERVALS = {
    f"{name}_interval": (0.123, 0.987)
    for name in ("task_share", "avoidance_grade", "avoided_share", "human_likeness", "c", "d", "s")
}


def with_ads(evaluation, number):
    """Its first ADS under so many names, short and long ones, every score with an interval."""
    first = evaluation.scores[0].ads
    own = [score for score in evaluation.scores if score.ads == first]
    names = [f"{LONG[place % 3]}{place or ''}" for place in range(number)]
    scores = [
        replace(score, ads=name, s_plus_interval=(12.3, 100.0), **INTERVALS)
        for score in own
        for name in names
    ]
    return replace(evaluation, scores=tuple(scores))


@pytest.mark.parametrize("number", [1, 12])
@pytest.mark.parametrize("everything", [False, True])
@pytest.mark.parametrize("width", [30, 60, 80, 100, 140])
def test_no_line_is_wider_than_the_terminal(evaluation, width, number, everything):
    many = with_ads(evaluation, number)
    lines = [click.unstyle(line) for line in score_lines(many, width, everything)]
    assert max(len(line) for line in lines if not line.startswith("Not shown")) <= width
    rows = [line for line in lines if "(12.3..100.0)" in line]
    assert len(rows) == len(many.scores), "one row each, none wrapped"


@pytest.mark.parametrize("number", [1, 12])
def test_a_narrower_terminal_gets_fewer_columns(evaluation, number):
    many, before = with_ads(evaluation, number), len(BY_IMPORTANCE)
    for width in (140, 100, 80, 60, 40, 30):
        text = click.unstyle("\n".join(score_lines(many, width)))
        table = text.partition("\nNot shown")[0]
        shown = [
            heading
            for heading in FIRST
            if heading.split("\n")[-1] in table.split() or heading in table
        ]
        assert len(shown) <= before
        assert (len(shown) == len(FIRST)) or "Not shown for want of room" in text
        assert shown, "S+ stays"
        before = len(shown)
    assert before < len(FIRST)


def test_a_hundred_characters_hold_the_whole_first_table(evaluation):
    for number in (1, 12):
        assert "Not shown" not in "\n".join(score_lines(with_ads(evaluation, number), 100))


def test_all_prints_every_number_at_every_width(evaluation):
    cells = cells_of(with_ads(evaluation, 1).scores[0])
    for width in (60, 100):
        text = click.unstyle(
            "\n".join(score_lines(with_ads(evaluation, 1), width, everything=True))
        )
        assert {cells[heading] for heading in (*FIRST, *MORE)} <= {
            cell for cell in cells.values() if cell in text
        }
        for heading in (*FIRST, *MORE):
            assert all(word in text for word in heading.split("\n"))


def test_long_names_keep_begin_and_end(evaluation):
    text = click.unstyle("\n".join(score_lines(with_ads(evaluation, 12), 80)))
    names = {line.split()[0] for line in text.splitlines() if " of " in line and "…" in line}
    assert len(names) == 8, "names that differ at their end stay different"


def test_avoidable_collisions_are_red_and_none_are_not(evaluation):
    hit = replace(evaluation.scores[0], avoidable_collisions=3, collisions=5)
    calm = replace(hit, avoidable_collisions=0)
    red = click.style("3 of 5".rjust(10), fg="red")
    assert red in "\n".join(score_lines(replace(evaluation, scores=(hit,))))
    assert "\x1b[31m" not in "\n".join(score_lines(replace(evaluation, scores=(calm,))))
