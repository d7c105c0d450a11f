"""Data files of measurements: complete, linked from a page, and equal to the figures that
docs/trust.md repeats."""

import re

import pytest
from laid import read_json
from loaded import ROOT, load

DOCS = ROOT / "docs"
FILES = sorted((DOCS / "measurements").glob("*.json"))


def tables(name):
    """Tables of a data file."""
    return read_json(DOCS / "measurements" / f"{name}.json")["tables"]


def table(name, title):
    """Table of a data file by the beginning of its title."""
    (found,) = [one for one in tables(name) if one["title"].startswith(title)]
    return found


def page_rows(heading):
    """Cells of the first table under a heading of docs/trust.md, by its first cell."""
    part = (DOCS / "trust.md").read_text().split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in part.splitlines()
        if line[:1] == "|"
    ]
    return {re.sub(r"[`*]", "", row[0]): row[1:] for row in rows[2:]}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_data_file_is_complete_and_linked(path):
    content = read_json(path)
    if path.stem != "paper_example":  # written by docs/examples/paper_example.py
        assert set(content) == {"name", "about", "version", "libsumo", "tables"}
        assert content["name"] == path.stem
        for one in content["tables"]:
            assert set(one) == {"title", "command", "date", "columns", "rows"}
            assert one["rows"]
            assert {len(row) for row in one["rows"]} == {len(one["columns"])}, one["title"]
    pages = "".join(page.read_text() for page in DOCS.rglob("*.md"))
    assert f"measurements/{path.name}" in pages


def test_summary_of_the_page_is_the_generated_one():
    summary = load("docs/measurements/trust_summary.py").summary()
    assert summary in (DOCS / "trust.md").read_text()


def test_ladder_of_the_page_is_the_measured_one():
    rows = page_rows("A ladder of ADSs")
    measured = table("trust", "Pairs of a ladder")["rows"]
    assert {name: [int(cell) for cell in cells] for name, cells in rows.items()} == {
        name: counts for name, *counts in measured
    }


def test_games_of_the_page_are_the_measured_ones():
    measured = {row[0]: row for row in table("trust", "Games")["rows"]}
    shown = page_rows("Games")
    for name in (
        "lane_changer",
        "idm",
        "careful_driver",
        "creeps at 2 m/s",
        "crawls at 60 %",
        "brakes to a stop",
    ):
        _, task, _, grade, likeness, s_plus, *_ = measured[name]
        assert [float(cell) for cell in shown[name]] == [task, grade, likeness, s_plus]


def test_areas_under_curves_of_the_page_are_the_measured_ones():
    rows = {row[0]: row for row in table("trust", "AUC")["rows"]}
    for name, (paper, likeness, least, target) in page_rows("Recorded drivers").items():
        row = (
            rows.get(name)
            or rows[
                "swerves at a TTC of 1.5 s" if "swerves" in name else "drives through its leader"
            ]
        )
        seeds = [float(value) for value in row[6].split()]
        assert [float(paper), float(likeness)] == pytest.approx([row[1], row[3]], abs=0.0051)
        assert float(least) == pytest.approx(min(row[3], *seeds), abs=0.0051)
        assert target == "none" or float(target) <= min(row[3], *seeds)
