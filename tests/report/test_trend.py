"""The history and its page: lines come back as written, charts are drawn to their ticks, gates are
on them."""

import functools

import pytest
import report_cases
from browser import Page, needs_chromium
from builders import CALM, LOW_SPEED
from page_checks import holds_what_every_page_holds, saved_table
from record.edited_store import edit
from refusals import refusal
from report_cases import with_losses
from tables import values_of

from sumo_eval.nightly.history import HISTORY, REGRET_OF_LOSSES, open_history
from sumo_eval.nightly.trend import (
    CHARTS,
    HEIGHT,
    TOP,
    WIDTH,
    _dates,
    _ticks,
    charts,
    failed_nights,
    write_trend,
)
from sumo_eval.report.gate_result import GateResult

night = functools.partial(report_cases.night, verdict="NO GATE <b>FAILED</b>", wall_time=12.5)


@pytest.fixture
def history(evaluation, tmp_path):
    gate = GateResult("S", CALM, LOW_SPEED, True, "S is fine", 70.0, 40.0)
    with open_history(tmp_path, create=True) as lines:
        for number in range(3):
            lines.add(night(f"2026-01-0{number + 1}T02-00-00Z", number % 2), evaluation, [gate])
    return tmp_path


def test_older_imported_runs_stand_before_the_nights(history, evaluation):
    with open_history(history) as lines:
        for day in ("02T01", "01T01"):
            older = night(f"2026-01-{day}-00-00Z", 0)._replace(imported=True)
            lines.add(older, evaluation, [])
        days = [it.night[8:13] for it in lines.in_time()]
        page = write_trend(history, lines).read_text("utf-8")
    assert days == ["01T01", "01T02", "02T01", "02T02", "03T02"]
    assert page.index("2026-01-03 02:00") < page.index("2026-01-01 01:00")


def test_what_was_added_comes_back(history, evaluation):
    with open_history(history) as lines:
        assert lines.nights()[1] == night("2026-01-02T02-00-00Z", 1)
        values = {
            (value.ads, value.scenario, value.quantity): value.value for value in lines.values()
        }
        for score in evaluation.scores:
            expected = {
                "S": score.s, "D": score.d, "A": score.avoided_share, "H": score.human_likeness,
                "S+": score.s_plus, "regret": score.regret,
                "avoidable_collisions": score.avoidable_collisions,
            }  # fmt: skip
            for name, value in expected.items():
                assert values[score.ads, score.scenario, name] == value
            assert (score.ads, score.scenario, REGRET_OF_LOSSES) not in values
        assert {gate.threshold for gate in lines.gates()} == {40.0}


def test_a_night_is_never_replaced(history, evaluation):
    with open_history(history, create=True) as lines, refusal("nothing in it is replaced"):
        lines.add(night("2026-01-01T02-00-00Z"), evaluation, [])


def test_another_format_and_another_file_are_refused(tmp_path):
    with refusal("There is no history"), open_history(tmp_path):
        pass
    edit(tmp_path / HISTORY, "PRAGMA user_version = 99")
    with refusal("format version 99"), open_history(tmp_path, create=True):
        pass
    edit(tmp_path / HISTORY, "PRAGMA user_version = 1")
    with refusal("no such table: nights"), open_history(tmp_path, create=True):
        pass
    (tmp_path / HISTORY).write_bytes(b"no database at all, only words" * 100)
    with refusal("is not a history"), open_history(tmp_path):
        pass


@pytest.mark.parametrize(
    "low, high, least, expected",
    values_of("""
    0.0, 1.0, 0.0, [0.0, 0.25, 0.5, 0.75, 1.0]
    50.0, 50.0, 0.0, [20.0, 40.0, 60.0, 80.0]
    0.0, 0.0, 0.0, [0.0, 0.2, 0.4, 0.6]
    7e-19, 7e-19, 0.0, [0.0, 0.2, 0.4, 0.6]
    0.0, 1.0, 1.0, [0.0, 1.0]
    -3.0, 7.0, 0.0, [-5.0, -2.5, 0.0, 2.5, 5.0, 7.5]
    """),
)
def test_ticks_are_round_and_hold_the_range(low, high, least, expected):
    ticks = _ticks(low, high, least)
    assert ticks == pytest.approx(expected)
    assert ticks[0] <= low
    assert ticks[-1] >= high


def test_a_quantity_that_was_not_computed_breaks_the_line_and_a_gate_is_a_stroke(history):
    with open_history(history) as lines:
        nights, values, gates = lines.nights(), lines.values(), lines.gates()
    gap = [
        value._replace(value=None)
        if (value.night, value.quantity) == (nights[1].night, "S")
        else value
        for value in values
    ]
    chart = next(
        one for one in charts(LOW_SPEED, nights, gap, gates) if one.title == "Score S of the paper"
    )
    assert [len(part) for part in chart.lines[0].parts] == [1, 1]
    assert _dates(nights * 30)[0][0] + 33 <= WIDTH, "half of the last date"
    assert len(chart.gates) == 3
    two = [*gates, *(gate._replace(threshold=50.0) for gate in gates)]
    twice = charts(LOW_SPEED, nights, gap, two)
    assert {len(one.gates) for one in twice if one.title == chart.title} == {6}
    assert all(
        TOP <= point.y <= HEIGHT for line in chart.lines for part in line.parts for point in part
    )


def test_a_history_of_earlier_nights_without_the_newer_quantities_still_reads(history):
    """The oldest night knows S, C, D and collisions only: its line of A begins a night later, the
    others are whole."""
    with open_history(history) as lines:
        nights, values = lines.nights(), lines.values()
    known = ("S", "C", "D", "collisions", "collision_probability", "not_evaluated", "run_time")
    older = [value for value in values if value.night != nights[0].night or value.quantity in known]
    found = {chart.title: chart for chart in charts(LOW_SPEED, nights, older, [])}
    assert [len(part) for part in found["Avoided share A"].lines[0].parts] == [2]
    assert [len(part) for part in found["Score S of the paper"].lines[0].parts] == [3]
    only = [value for value in older if value.quantity in known]
    assert "Avoided share A" not in {chart.title for chart in charts(LOW_SPEED, nights, only, [])}


def test_each_quantity_of_the_history_has_a_chart(history):
    with open_history(history) as lines:
        kept = {value.quantity for value in lines.values()}
    charted = {quantity for quantity, _, _ in CHARTS}
    assert kept | {REGRET_OF_LOSSES} == charted


def test_unavoidable_collisions_have_a_chart_where_a_gate_limits_them(history):
    with open_history(history) as lines:
        nights, values, gates = lines.nights(), lines.values(), lines.gates()
    of_them = [gate._replace(quantity="unavoidable_collisions") for gate in gates]
    without, drawn = (charts(LOW_SPEED, nights, values, it) for it in (gates, of_them))
    title = "Unavoidable collisions"
    assert title not in {chart.title for chart in without}
    assert [len(chart.gates) for chart in drawn if chart.title == title] == [len(nights)]


def test_regrets_of_two_units_have_a_chart_each(history, evaluation):
    """Three nights in m/s, one of losses; each night's gate of the regret is in its own chart."""
    losses = with_losses(evaluation, severity="injury:cyclist")
    gate = GateResult("regret", CALM, LOW_SPEED, True, "fine", 0.1, 0.2)
    with open_history(history, create=True) as lines:
        lines.add(night("2026-01-04T02-00-00Z"), losses, [gate])
        drawn = charts(LOW_SPEED, lines.nights(), lines.values(), lines.gates())
    found = {chart.title: chart for chart in drawn if "Regret" in chart.title}
    told = {it.unit: (len(it.lines[0].parts[0]), len(it.gates)) for it in found.values()}
    assert told == {"m/s": (3, 0), "": (1, 1)}


def test_lines_of_many_ads_differ(history):
    with open_history(history) as lines:
        nights, value = lines.nights(), lines.values()[0]
    values = [value._replace(ads=str(number), quantity="S") for number in range(30)]
    (chart,) = charts(value.scenario, nights, values, [])
    assert len({(line.colour, line.dash) for line in chart.lines}) == 30


def test_only_nights_of_a_failed_limit_are_marked_as_failed():
    """Status 3: cases without an outcome, in a good night."""
    nights = [night(f"2026-01-0{status + 1}T02-00-00Z", status) for status in (0, 1, 3)]
    assert [bar["words"][:23] for bar in failed_nights(nights)] == ["2026-01-02 02:00 failed"]


@needs_chromium
def test_the_trend_page_opens_without_an_error_and_without_a_request(history, evaluation, tmp_path):
    with open_history(history) as lines:
        path = write_trend(history, lines)
    assert "<b>FAILED" not in path.read_text()
    with Page(tmp_path / "profile") as page:
        holds_what_every_page_holds(page, path, "document.querySelectorAll('polyline').length > 10")
        head, *rows = saved_table(page, "svg[data-chart$='S+']")
        assert head == "night,series,Score S+"
        score = evaluation.score(CALM, LOW_SPEED).s_plus
        assert f"2026-01-01T02-00-00Z,{CALM},{score!r}" in rows
