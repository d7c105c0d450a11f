"""The page of what was learnt and of rates: charts when they are unfolded, tables by their columns,
nothing escapes."""

import plotly.graph_objects as go
import pytest
from browser import Page, needs_chromium

from sumo_eval.report.study_page import (
    MOST_ROWS,
    Chart,
    Fold,
    Table,
    Text,
    amount,
    interval,
    table,
    write_parts,
    write_study,
)

HOSTILE = "</script><b>bold"


def test_large_amounts_are_written_out_and_small_ones_in_three_digits():
    assert amount(168_123.0) == "168,000"
    assert amount(999.4) == "999"
    assert amount(-999.7) == "-1,000"
    assert amount(0.00012345) == "0.000123"
    assert interval(0.0, 1234.5) == "0 to 1,230"


def test_a_column_is_one_of_numbers_when_all_its_cells_are(tmp_path, monkeypatch):
    found = table(
        [{"who": "a", "rate": "12 (3 to 40)", "where": "as given"}, {"who": "b", "where": "2 km"}]
    )
    assert found.numbers == (False, True, False)
    parts, once = [table([{"gap": 20.0}])], iter([(True,)])
    monkeypatch.setattr(Table, "numbers", property(lambda _: next(once)))  # not for every cell
    page = write_parts(tmp_path / "page.html", kicker="k", title="t", sentences=[], parts=parts)
    assert '<td class="n" data-label="gap">20' in page.read_text(), "a narrow screen names it"


def test_a_table_of_one_row_has_one_row_and_not_rows(tmp_path):
    common = {"kicker": "k", "title": "t", "sentences": [], "figures": {}}
    for rows, words in (([["1"]], "1 row<"), ([["1"], ["2"]], "2 rows<")):
        page = write_study(tmp_path / "page.html", **common, data=Table(["a"], rows))
        assert words in page.read_text()


@pytest.mark.parametrize("file, shown", [("all.csv", MOST_ROWS), ("", MOST_ROWS + 1)])
def test_long_table_names_only_a_file_that_has_its_rows(tmp_path, file, shown):
    data = Table(["a"], [["x"]] * (MOST_ROWS + 1), file)
    common = {"kicker": "k", "title": "t", "sentences": [], "figures": {}}
    page = write_study(tmp_path / "page.html", **common, data=data).read_text()
    assert page.count('<th scope="row">x') == shown
    assert (
        ("beside this page" in page) == ("all.csv beside this page has all" in page) == bool(file)
    )


@pytest.mark.campaign
@needs_chromium
def test_a_chart_in_a_folded_section_is_drawn_when_it_opens_and_follows_the_theme(tmp_path):
    chart = Chart("recorded", go.Figure(go.Scatter(x=[1, 2], y=[3, 4], name=HOSTILE)))
    inside = Fold(HOSTILE, "one chart", (chart, Text("a sentence")))
    page = write_parts(
        tmp_path / "page.html",
        kicker="k",
        title=HOSTILE,
        sentences=["s"],
        parts=[table([{"a": "c", "b": 1}]), inside],
    )
    with Page(tmp_path / "profile") as opened:
        opened.open(page.as_uri(), "document.documentElement.dataset.study === 'ready'")
        assert opened.run("document.querySelectorAll('b').length") == 0
        assert opened.run("document.querySelectorAll('.js-plotly-plot').length") == 0
        opened.run("document.querySelector('details').open = true")
        opened.wait("document.querySelectorAll('.js-plotly-plot .main-svg').length > 0")
        assert opened.run("document.querySelectorAll('.save button').length") == 3
        before = opened.run("document.querySelector('[data-figure]').layout.font.color")
        opened.run(
            "[...document.querySelectorAll('[data-tools] button')].find((b) => b.textContent === "
            "'Dark').click()"
        )
        opened.wait(f"document.querySelector('[data-figure]').layout.font.color !== '{before}'")
        opened.open(page.as_uri(), "document.documentElement.dataset.study === 'ready'")
        drawn = "document.querySelectorAll('.js-plotly-plot .main-svg').length > 0"
        assert not opened.run(drawn)
        at_once = f"(() => {{ window.dispatchEvent(new Event('beforeprint')); return {drawn}; }})()"
        assert opened.run(at_once), "Ctrl+P waits for nothing"
        assert opened.problems == []
