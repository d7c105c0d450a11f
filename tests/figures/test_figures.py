"""Figures for papers: every one is drawn of a real run, in every format and width, and mistakes are
sentences."""

import json
import re
import tomllib
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from types import SimpleNamespace

import commands
import numpy as np
import pytest
from browser import CHROMIUM, Page
from builders import SCENARIOS
from evaluations import small
from refusals import refusal
from tables import rows_of

import sumo_eval
from sumo_eval import Trajectory
from sumo_eval.evaluation import zone_partitions
from sumo_eval.extras.figures.drawn import FIGURES, OF_RUNS, draw
from sumo_eval.extras.figures.of_scores import intervals
from sumo_eval.extras.figures.style import MM, WIDTHS, look_of, on_paper, save
from sumo_eval.extras.panels import INK, Marks, Panel
from sumo_eval.nightly.history import open_history
from sumo_eval.nightly.night import import_run
from sumo_eval.record.store import Store
from sumo_eval.report.html import write_report
from sumo_eval.scenario.road.reference_line import arc

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Two ADSs in a space of two parameters and in one of three."""
    settings = small(("idm", "no_reaction"), SCENARIOS, 3)
    return sumo_eval.evaluate(settings, tmp_path_factory.mktemp("drawn") / "run")


@pytest.mark.parametrize("name", OF_RUNS)
@pytest.mark.parametrize("width", WIDTHS)
def test_every_figure_of_a_run_fits_its_width_and_holds_its_words(done, tmp_path, name, width):
    file = save(draw(done, name, width=width), tmp_path / f"{name}.svg")
    found = re.fullmatch(r"([\d.]+)pt", ElementTree.parse(file).getroot().attrib["width"])
    assert float(found[1]) == pytest.approx(WIDTHS[width] * 72.0, abs=0.5)
    assert "<path" in file.read_text(), "letters travel as outlines: no font is missing anywhere"
    if width == "column":  # drawn again: the same bytes
        assert (
            save(draw(done, name, width=width), tmp_path / "again.svg").read_bytes()
            == file.read_bytes()
        )


def test_many_ads_look_different():
    names = [str(number) for number in range(64)]
    assert len({look_of(name, names) for name in names}) == 64


def test_a_column_is_88_mm_and_a_page_180_mm():
    assert WIDTHS["column"] / MM == pytest.approx(88.0)
    assert WIDTHS["page"] / MM == pytest.approx(180.0)


@pytest.mark.parametrize(
    "ending, begin", [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")]
)
def test_the_ending_says_the_format(done, tmp_path, ending, begin):
    file = save(
        draw(done, "zone_map", ads="idm", scenario="front_vehicle_cut_out"),
        tmp_path / f"map.{ending}",
    )
    assert file.read_bytes().startswith(begin)
    assert ending != "pdf" or b"/FontFile2" in file.read_bytes(), "the fonts are in the file"


def test_a_map_is_of_an_ads_that_drove_in_its_space(done):
    first = done.settings.ads[0].name
    few = replace(done, scores=tuple(it for it in done.scores if it.ads != first))
    assert draw(few, "zone_map").axes
    with refusal(f"Unknown ADS `{first}`"):
        draw(few, "zone_map", ads=first)


def test_every_point_of_a_map_is_drawn(done):
    """Each panel of cut-out is one ego speed; its dots are the cases of the ADS at that speed."""
    figure = draw(done, "zone_map", ads="no_reaction", scenario="front_vehicle_cut_out")
    dots = sum(
        len(line.get_xdata())
        for panel in figure.axes
        for line in panel.lines
        if line.get_marker() in "oPX"
    )
    assert dots == sum(
        (case.scenario, case.ads) == ("front_vehicle_cut_out", "no_reaction") for case in done.cases
    )


def test_the_bars_of_the_points_end_at_the_score(done):
    figure = draw(done, "points")
    kept = [
        patch.get_width()
        for patch in figure.axes[0].patches
        if patch.get_y() == pytest.approx(-0.3)
    ][:1]
    assert kept == [pytest.approx(done.scores[0].s_plus)]


def test_a_score_that_was_not_computed_has_no_bar(done):
    """Without a safe point there is no S+ and no D, which is no loss by driving."""
    cases = tuple(it for it in done.cases if it.zone == "hazardous")
    gone = dict.fromkeys(("s_plus", "task_share", "human_likeness", "d"))
    scores = tuple(replace(it, **gone) for it in done.scores)
    figure = draw(replace(done, cases=cases, scores=scores), "points")
    ordering, paper = figure.axes
    assert {text.get_text() for text in ordering.texts} == {"not computed"}
    assert not sum(bar.get_width() for bar in ordering.patches)
    assert "not computed" not in {text.get_text() for text in paper.texts}, "C is enough for S"
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == ["kept", "of a term that was not computed", "lost by harm (A, C)"]


def test_the_title_counts_collisions_without_a_severity(done):
    unknown = tuple(replace(it, ideal_severity=None) for it in done.cases)
    number = sum(bool(it.collided) for it in unknown if it.scenario == SCENARIOS[0])
    figure = draw(replace(done, cases=unknown), "collisions", scenario=SCENARIOS[0])
    wanted = f"{SCENARIOS[0]}: U unknown in {number} of {number}"
    assert [axes.get_title() for axes in figure.axes] == [wanted]


def test_axes_hold_what_is_drawn_and_no_more(done):
    """Points go from 0 to 100; the share of collisions begins at 0, the field's colours at its
    lowest value."""
    assert draw(done, "points").axes[0].get_xlim() == (0.0, 100.0)
    for line in draw(done, "boundary").axes[0].lines[1:]:
        assert line.get_xdata()[0] == -1.0
        assert line.get_ydata()[0] == 0.0
    (mesh,) = draw(done, "field").axes[0].collections
    assert mesh.get_clim()[0] > 0.0


@pytest.mark.parametrize("speed, line", [(0.0, ()), (20.0, (arc(600.0, 100.0),))])
def test_fields_of_egos_that_stand_or_turn_are_drawn(done, monkeypatch, speed, line):
    from sumo_eval.extras.figures import of_scenes

    time, driven = np.arange(100) / 10.0, of_scenes.driven_point
    drive = Trajectory(time, 50.0 + speed * time, 0.0 * time, 0.0 * time)
    shown = lambda asked, names: replace(driven(asked, names), runs={names[0]: drive}, line=line)  # noqa: E731
    monkeypatch.setattr(of_scenes, "driven_point", shown)
    assert draw(done, "field").axes[0].collections


def test_fields_stand_under_the_names_of_ads_and_driver(done):
    for ads in done.ads_names:
        figure = draw(done, "field", ads=ads)
        assert [ax.get_title() for ax in figure.axes[:2]] == [ads, "driver_00"]
        assert done.case(figure.get_suptitle().splitlines()[0]).ads == ads


def test_an_ads_without_an_outcome_has_no_boundary(done):
    first = done.ads_names[0]
    cases = [replace(it, status="sim_error") if it.ads == first else it for it in done.cases]
    figure = draw(replace(done, cases=tuple(cases)), "boundary")
    assert f"{first}: 0 of 0 collide" in figure.legends[0].get_texts()[0].get_text()


def test_names_of_any_signs_are_drawn_and_in_the_legend(done, tmp_path):
    scores = [replace(score, ads="a$b_$c") for score in done.scores]
    asked = SimpleNamespace(names=["a$b_$c"], scores=scores, width="page")
    assert "a$b_$c" in save(intervals(asked), tmp_path / "intervals.svg").read_text()
    marks = [Marks(name, [0.0, 1.0], [0.0, 1.0], INK, "-") for name in ("_mine", "a$b_$c")]
    figure = on_paper([Panel(marks)], "page", 0.5, words="a$b_$c")
    save(figure, tmp_path / "legend.svg")
    assert [it.get_text().strip() for it in figure.legends[0].get_texts()] == ["_mine", "a$b_$c"]


@pytest.mark.campaign
def test_a_map_of_four_parameters_is_the_slice_with_most_collisions(tmp_path):
    """Two levels of cut_in: `no_reaction` collides nowhere at the slow lateral speed and a gap of 0
    m, the first slice; no stray piece of the learnt boundary stands at the stairs of the edge of
    what can be.
    """
    evaluation = small({"none": "no_reaction"}, ("cut_in",), 2, levels=2)
    figure = draw(sumo_eval.evaluate(evaluation, tmp_path / "run"), "zone_map")
    assert "with most incidents" in figure.get_suptitle()
    words = str(figure.get_suptitle())
    assert re.search(r"[1-9]\d* of \d+ cases", words), words
    dashes = [one for one in figure.axes[0].collections if one.get_linestyle()[0][1]]
    paths = [path for one in dashes for path in one.get_paths()]
    assert sum(len(path.to_polygons(closed_only=False)) for path in paths) <= 2


def test_a_history_of_nights_is_drawn(done, tmp_path):
    history = tmp_path / "history"
    history.mkdir()
    night = import_run(history, done.folder)
    with open_history(history) as database:  # a night without scores: the lines have a gap there
        database.add(night._replace(night="2999-01-01T00-00-00Z"), replace(done, scores=()), ())
        database.add(night._replace(night="2999-01-02T00-00-00Z"), done, ())
    figure = draw(history, "trend", ads="idm")
    assert np.isnan(figure.axes[0].lines[0].get_ydata()).tolist() == [False, True, False]
    assert [panel.get_ylabel() for panel in figure.axes]
    lines = [line for panel in figure.axes for line in panel.lines]
    assert not [line for line in lines if line.get_linewidth() == 3.0], "no gate: it did not fail"
    save(figure, tmp_path / "trend.pdf")
    with open_history(history) as database:  # an ADS of another scenario has no trend in this one
        other = replace(done.scores[0], ads="new", scenario="other")
        database.add(
            night._replace(night="2999-01-03T00-00-00Z"), replace(done, scores=(other,)), ()
        )
    with refusal("A night must have driven new"):
        draw(history, "trend", ads="new")


@pytest.mark.parametrize(
    "figure, more, words",
    rows_of(
        """
zonemap | {} | Unknown figure `zonemap`.*Did you mean `zone_map`
field | {"case": "nobody"} | Unknown case `nobody`
field | {"ads": "idn"} | Unknown ADS `idn`.*Did you mean `idm`
points | {"scenario": "cut"} | Unknown scenario `cut`
points | {"width": "wide"} | Unknown width `wide`
opinion | {} | must hold ratings, got none
trend | {} | There is no history in
trend | {"case": "x"} | takes no `case`, got 'x'
opinion | {"ads": "idm"} | takes no `ads`, got 'idm'
""",
        str,
        json.loads,
    ),
)
def test_what_is_missing_is_named(done, figure, more, words):
    with refusal(words):
        draw(done, figure, **more)


def test_a_missing_trajectory_is_that_of_the_ads(done, monkeypatch):
    """Not that of the case by which the point was chosen."""
    case = done.cases_of("idm", SCENARIOS[0])[0].case
    other = next(
        it.case for it in done.cases_of("no_reaction", SCENARIOS[0])
        if it.values == done.case(case).values
    )  # fmt: skip
    monkeypatch.setattr(Store, "trajectories", lambda store, name: {})
    with refusal(f"No trajectory is kept of {other}, so"):
        draw(done, "field", case=case, ads="no_reaction")


@pytest.mark.parametrize("figure", ["field", "zone_map", "points"])
@pytest.mark.parametrize("scenario", ["front_vehicle_cut_out", "unknown"])
def test_the_scenario_of_a_case_is_its_own(done, figure, scenario):
    case = next(it.case for it in done.cases if it.scenario == "front_vehicle_low_speed")
    assert draw(done, figure, case=case, scenario="front_vehicle_low_speed")
    words = f"The scenario of case `{case}` must be front_vehicle_low_speed, got '{scenario}'."
    with refusal(re.escape(words)):
        draw(done, figure, case=case, scenario=scenario)


def test_the_command_draws_and_says_what_it_wrote(done, tmp_path):
    out = tmp_path / "of" / "paper.png"
    told = commands.sumo_eval("plot", done.folder, "intervals", "--out", out)
    assert told.stdout.strip() == str(out)
    assert out.read_bytes().startswith(b"\x89PNG")
    wrong = commands.sumo_eval(
        "plot", done.folder, "intervals", "--out", tmp_path / "x.gif", status=2
    )
    # at once: no run is scored for it
    words = "The figure's file must end in one of .svg, .png, .pdf, got 'x.gif'."
    assert wrong.stderr == f"sumo-eval: {words}\n"


@pytest.mark.parametrize("option, kind", [("ads", "ADS"), ("scenario",) * 2, ("case",) * 2])
def test_names_are_checked_before_scoring(done, monkeypatch, option, kind):
    monkeypatch.setattr("sumo_eval.evaluation.KeptScoring", None)  # scoring would be a TypeError
    wrong = commands.sumo_eval("plot", done.folder, "intervals", f"--{option}", "x", status=2)
    assert f"Unknown {kind} `x`" in wrong.stderr


def test_the_list_of_figures_is_the_documented_one():
    documented = (
        "zone_map field trajectories time_history collisions boundary intervals points trend "
        "opinion"
    )
    assert " ".join(FIGURES) == documented


@pytest.mark.campaign
def test_on_a_curve_field_and_ways_are_drawn_on_the_map(tmp_path):
    """Along an arc of R = 250 m to the left the ego ends about s^2 / 2R to the left of where it
    began: metres."""
    evaluation = tomllib.loads("""
name = "bend"
scenario = [{ use = "curve_cut_in", sampling = { levels = { ego_speed = 2, gap = 2 } } }]
ads = [{ name = "idm", controller = "idm" }]
drivers = { count = 2 }
run = { engine = "serial" }
method = { zones = { restarts = 0, refinements = 0, grid_points = 1000 } }
""")
    bent = sumo_eval.evaluate(evaluation, tmp_path / "run")
    for name in ("field", "trajectories"):
        figure = draw(bent, name, ads="idm")
        (x, y) = next(
            line.get_data()
            for panel in figure.axes
            for line in panel.lines
            if len(line.get_xdata()) > 2
        )
        assert abs(y[-1] - y[0]) > 3.0
        assert len(x) == len(y)
    if CHROMIUM is None:
        return
    report = write_report(bent, zone_partitions(bent))
    with Page(tmp_path / "profile") as page:  # so does the report
        page.open(report.as_uri(), "document.documentElement.dataset.report === 'ready'")
        page.run("document.getElementById('case').closest('details').open = true")
        page.wait("document.documentElement.dataset.fields === 'drawn'")
        assert page.run("document.getElementById('plot-field-ads').layout.images.length") == 1
        assert page.run("document.getElementById('paths-scale').textContent").startswith(
            "on the map"
        )
        assert page.run("document.querySelector('#plot-paths').layout.yaxis.scaleanchor") == "x"
        assert page.problems == []
