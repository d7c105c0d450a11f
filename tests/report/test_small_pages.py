"""The pages beside the report, in a browser: two runs compared, and the points of a space."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from browser import Page, needs_chromium
from builders import LOW_SPEED
from page_checks import holds_what_every_page_holds, saved_table, size
from report_cases import HIT, pick, with_case, with_scores

from sumo_eval.record.run_folder import FACTS
from sumo_eval.report.html import write_comparison, write_report
from sumo_eval.report.points_page import write_points
from sumo_eval.report.verdict import Additions
from sumo_eval.results import NotComputed
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.sampling.samples import Sample
from sumo_eval.scoring.comparison import compare
from sumo_eval.scoring.gate_settings import GateSettings


@pytest.mark.campaign
@needs_chromium
def test_compare_points_and_a_report_without_people_hold_what_every_page_holds(
    evaluation, partitions, tmp_path
):
    """In the last one nothing but C is computed: "not computed" and its reason stand in nearly
    every cell."""
    struck = with_case(evaluation, pick(evaluation, collided=False), **HIT)
    compared = compare(evaluation, replace(struck, folder=tmp_path), GateSettings(resamples=200))
    comparison = write_comparison(struck, Additions(comparison=compared), tmp_path / "compare.html")
    nobody = NotComputed("no_drivers")
    blank = {"s": None, "d": None, "s_plus": None, "avoided_share": None, "human_likeness": None}
    bare = with_scores(evaluation, **blank, d_reason=nobody, h_reason=nobody)
    shutil.copy(evaluation.folder / FACTS, tmp_path)
    report = write_report(replace(bare, folder=tmp_path), partitions)
    logical = catalogue.load(LOW_SPEED)
    unit = np.random.default_rng(1).uniform(size=(30, len(logical.names)))
    chosen = logical.from_unit(unit)
    _, points = write_points(
        logical, Sample(chosen, chosen[:0], np.ones(30)), tmp_path, "30 points"
    )
    with Page(tmp_path / "profile") as page:
        holds_what_every_page_holds(
            page, comparison, "document.querySelector('[data-tools] button')"
        )
        holds_what_every_page_holds(
            page, points, "document.documentElement.dataset.study === 'ready'"
        )
        head, *rows = saved_table(page, ".js-plotly-plot")
        assert head == "series,x,y,value"
        pairs = {tuple(float(number) for number in row.split(",")[1:3]) for row in rows}
        assert {(x, y) for x, y in chosen[:, :2].tolist()} <= pairs
        begins = "window.dispatchEvent(new Event('beforeprint'))"
        size(page, 1400, 900)
        page.open(report.as_uri(), "document.documentElement.dataset.report === 'ready'")
        shown = (
            "['case-undrawn', 'case-charts'].map((id) => "
            "getComputedStyle(document.getElementById(id)).display)"
        )
        assert page.run(f"(() => {{ {begins}; return {shown}; }})()") == ["block", "none"], (
            "a sentence, no blank charts"
        )
        page.run("window.dispatchEvent(new Event('afterprint'))")
        assert page.run(f"{shown}[0]") == "none"
        page.run(
            "document.querySelectorAll('details.fold').forEach((fold) => { fold.open = true; })"
        )
        cut = """[...document.querySelectorAll('#verdict .overflow, #confidence .scroll, .glances')]
            .filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent.trim().slice(0, 60))"""
        assert page.run(cut) == [], "no table hides its last column"
        assert page.problems == []
