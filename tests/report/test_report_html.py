"""The report as a file: complete, closed, and deaf to what people write into names and error
texts."""

import json
import re
from dataclasses import replace
from html import escape, unescape
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote

import numpy as np
import pytest
from builders import CALM, CUT_OUT, ERROR, HOSTILE, LOW_SPEED
from lxml import html
from packed_pages import unpacked
from refusals import refusal
from report_cases import with_case, with_losses, with_scores, with_settings
from tables import values_of

from sumo_eval.case_table import CaseTable
from sumo_eval.report import sent_drives
from sumo_eval.report.html import term, write_report
from sumo_eval.report.page import code_marked, template
from sumo_eval.report.page_data import embedded_cases, gathered_words
from sumo_eval.report.readings import readings, setting_rows
from sumo_eval.report.score_words import GLOSSARY
from sumo_eval.report.sections import ranking_content
from sumo_eval.report.verdict import Additions
from sumo_eval.report.words import count
from sumo_eval.results import RankedAds, RankedPair, Ranking
from sumo_eval.scenario import Parameter, catalogue
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.scoring.findings import unevaluated
from sumo_eval.scoring.map_view import choose_view, telling_slice
from sumo_eval.scoring.preventability import preventability
from sumo_eval.scoring.shown_cases import shown_cases
from sumo_eval.scoring.zone_levels import rooms_of
from sumo_eval.settings import DriverSettings, PlantSettings, RunSettings, SimulationSettings


@pytest.fixture(scope="module")
def tags(page):
    """Every tag with its attributes, in order."""
    return [(element.tag, element.attrib) for element in html.fromstring(page).iter("*")]


def embedded(page):
    """The data that the page draws from."""
    return json.loads(unpacked(page, "report-data"))


@pytest.fixture(scope="module")
def data(page):
    return embedded(page)


def visible(page):
    """The page's words, without scripts, styles and tags."""
    bare = re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.S)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", bare)).split())


def test_the_scores_stand_in_the_verdict(evaluation, page):
    text = visible(page)
    for score in evaluation.scores:
        for value in (score.c, score.d, score.avoided_share, score.human_likeness):
            assert value is None or f"{value:.3f}" in text
        for value in (score.s, score.s_plus):
            assert f"{value:.1f}" in text
        if score.collisions:
            assert f"{score.avoidable_collisions} avoidable" in text
            assert f"{score.unavoidable_collisions} unavoidable" in text
        if score.caused_collisions:
            assert f"{score.caused_collisions} of these caused" in text


def test_the_collisions_and_s_plus_come_before_the_papers_scores(page):
    heading = re.search(r'<table class="scores">.*?</thead>', page, flags=re.S)
    columns = [
        unescape(re.sub(r"<[^>]+>", "", cell)).strip()
        for cell in re.findall(r"<th.*?</th>", heading[0], re.S)
    ]
    points = "Points for the task + for driving like people"
    assert columns[:10] == ["ADS", "Collisions", "T", "A' and A", "H", "S+", points, "C", "D", "S"]


@pytest.mark.parametrize("name", GLOSSARY)
def test_jargon_has_a_line_in_the_glossary(page, name):
    glossary = page[page.index('<dl class="glossary">') :]
    assert f"<dt>{name}</dt><dd>{escape(GLOSSARY[name], quote=False)[:20]}" in unescape(glossary)


def test_the_scores_headings_have_tooltips(tags):
    told = {attributes.get("title") for tag, attributes in tags if tag == "abbr"}
    assert {
        GLOSSARY[name]
        for name in ("A", "H", "S+", "C", "D", "S", "avoidable", "U", "Ug", "U0", "r")
    } <= told


def test_an_interval_stands_below_its_score(evaluation, partitions):
    wide = with_scores(evaluation, s_plus_interval=(12.0, 87.0))
    page = write_report(wide, partitions).read_text()
    assert page.count('<small class="pair">12..87</small>') == len(evaluation.scores)


def test_the_ranking_has_a_section_where_there_is_one(evaluation):
    """Two ADSs whose difference may be chance share the first place."""
    assert ranking_content(evaluation, Additions()) is None
    ranked = SimpleNamespace(
        ranking=Ranking(
            weights={"a": 1.0, "b": 2.0}, level=0.95,
            ads=tuple(RankedAds(name, 1, 60.0, (50.0, 70.0)) for name in ("x", "<y>")),
            pairs=(RankedPair("x", "<y>", 1.5, (-2.0, 5.0), told_apart=False),),
        )
    )  # fmt: skip
    content = ranking_content(ranked, Additions())
    text = template("sections/ranking.html.j2").render(content={"ranking": content}, term=term)
    assert '<th scope="row">&lt;y&gt;</th>' in text
    words = visible(text)
    assert "1 x 60.0 50.0 to 70.0" in words
    assert "x <y> +1.5 -2.0 to 5.0 no" in words
    assert "a 1, b 2" in words


def test_d_that_was_not_computed_is_said_with_its_reason(evaluation, page):
    score = evaluation.score(HOSTILE, CUT_OUT)
    assert score.d is None
    assert f"not computed {count(score.safe_collisions, 'collision')} in the safe zone" in visible(
        page
    )


def test_the_drivers_are_called_synthetic_and_only_when_they_are(evaluation, partitions, page):
    words = "synthetic: drawn from distributions fitted to recorded traffic. They are not"
    assert visible(page).count(words) == 3  # first screen, scores, human-likeness
    drivers = DriverSettings(count=3, source="mine:drivers")
    recorded = with_settings(evaluation, drivers=drivers)
    other = visible(write_report(recorded, partitions).read_text())
    write_report(evaluation, partitions)
    assert "not recorded people" not in other
    assert "mine:drivers" in other


def test_every_collision_and_every_missing_case_is_listed(evaluation, tags):
    links = [attributes.get("href") or "" for tag, attributes in tags if tag == "a"]
    linked = {unquote(link.removeprefix("#case:")) for link in links if link.startswith("#case:")}
    missing = {case.case for table in unevaluated(evaluation) for case in table}
    assert linked >= {case.case for case in evaluation.cases if case.collided} | missing


def test_the_masthead_counts_missing_cases_beyond_those_listed(
    evaluation, partitions, report, monkeypatch
):
    """Two are missing, one is listed."""
    whole = report.read_text()
    with monkeypatch.context() as patched:
        patched.setattr("sumo_eval.report.html.MOST_LISTED", 1)
        page = write_report(evaluation, partitions).read_text()
    report.write_text(whole)
    assert "<b>2</b>&nbsp;could not be evaluated" in page


def test_names_and_errors_are_text_everywhere(page, tags):
    assert HOSTILE not in page
    assert escape(HOSTILE, quote=False).split("&quot;")[0][:20] in page
    assert ERROR not in page
    assert "lost the lane" in visible(page)
    assert not [tag for tag, attributes in tags if tag == "img" or "onerror" in attributes]
    assert sum(tag == "script" for tag, _ in tags) == page.count("</script>") == 7


def test_the_data_cannot_be_read_as_markup(page):
    for name in ("report-data", "plotly-code"):
        assert unpacked(page, name), "it is plain base64 in the page"


def test_the_data_holds_every_name_as_it_is(evaluation, data):
    assert [scenario["ads"] for scenario in data["scenarios"]] == [[CALM, HOSTILE]] * 2
    keys = [case["key"] for scenario in data["scenarios"] for case in scenario["cases"]]
    assert sorted(keys) == sorted(case.case for case in evaluation.cases)


def test_nothing_is_fetched_from_anywhere(page, tags):
    for tag, attributes in tags:
        for name in ("src", "href", "data", "poster", "srcset", "action"):
            address = attributes.get(name) or ""
            assert address.startswith("#") or address in ("", "data:,"), (tag, address)
    style = re.findall(r"<style>(.*?)</style>", page, flags=re.S)
    assert "url(" not in "".join(style)
    assert "@import" not in "".join(style)
    policy = next(attributes["content"] for tag, attributes in tags if attributes.get("http-equiv"))
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy


def test_every_label_and_picture_has_words(tags):
    ids, targets = [], set()
    for tag, attributes in tags:
        if attributes.get("role") == "img":
            assert attributes.get("aria-label"), (tag, attributes)
        ids += [attributes["id"]] if "id" in attributes else []
        link = (attributes.get("href") or "") if tag == "a" else ""
        if link.startswith("#") and ":" not in link:
            targets.add(link[1:])
        if "aria-labelledby" in attributes:
            targets.add(attributes["aria-labelledby"])
    assert len(ids) == len(set(ids))
    assert targets <= set(ids)


def test_the_preventability_of_every_ads_stands_in_a_table(evaluation, page):
    text = visible(page)
    assert "No ADS of this run is “careful_driver”, so the reference is the ideal vehicle" in text
    for row in preventability(evaluation):
        counts = f"{row.cases} {row.avoided} {row.better} {row.incidents} {row.preventable}"
        assert f"{counts} {row.unpreventable}" in text


ROWS = np.argwhere(np.ones((2, 1, 4, 3))).astype(float).tolist()


def test_a_map_of_many_parameters_takes_the_two_that_vary_most(evaluation):
    view = choose_view(space(4), points(evaluation, ROWS))
    assert view.x == 2
    assert view.y == 3
    assert set(view.fixed) == {0, 1}


def test_loss_of_a_by_any_incident_is_in_the_page(evaluation):
    """A map opens at the case that loses most, which may leave the road without a contact."""
    case = next(
        it for it in evaluation.cases if it.ads == CALM and it.evaluated and not it.incident
    )
    gone = with_case(evaluation, case, departure_time=1.0, departure_severity=20.0)
    for run, lost in ((evaluation, False), (gone, True)):
        rows = embedded_cases(run, shown_cases(run))[case.scenario]
        (details,) = (more for it, more in rows if it.case == case.case)
        assert bool(details["aLost"]) == lost


def test_a_map_shows_the_two_chosen_parameters(evaluation):
    cases = points(evaluation, ROWS)
    view = choose_view(space(4), cases, ("p3", "p0"))
    assert view.x == 3
    assert view.y == 0
    assert set(view.fixed) == {1, 2}
    assert choose_view(space(3), cases, ("p2", "p0")).panel is None
    two = choose_view(space(2), points(evaluation, [[0.0, 1.0]]), ("p1", "p0"))
    assert two.x == 1
    assert two.y == 0
    assert two.fixed == {}
    for axes, words in ((("gap", "p7"), "p7"), (("gap", "gap"), "two different")):
        settings = replace(evaluation.settings.report, axes={CUT_OUT: axes})
        with refusal(words):
            Resolved.of(replace(evaluation.settings, report=settings), Path())


@pytest.mark.parametrize(
    "incident", [{"collided": True}, {"departure_time": 1.0}, {"status": "ads_error"}]
)
def test_a_map_with_slices_opens_where_most_incidents_are(evaluation, incident):
    rows = np.argwhere(np.ones((3, 3, 2, 2))).astype(float).tolist()
    calm = CaseTable.of(
        replace(case, collided=False, departure_time=None, status="ok")
        for case in points(evaluation, rows)
    )
    view = choose_view(space(4), calm)
    assert telling_slice(view, calm) == {2: 0.0, 3: 0.0}
    hits = CaseTable.of(
        replace(case, **incident) if case.values["p2"] == 1.0 and case.values["p3"] == 0.0 else case
        for case in calm
    )
    assert telling_slice(view, hits) == {2: 1.0, 3: 0.0}
    assert telling_slice(choose_view(space(3), calm), calm) == {}


@pytest.mark.parametrize("name", ["front_vehicle_cut_out", "curve_braking", "oncoming_in_lane"])
def test_law_the_least_room_of_constraints_is_what_is_possible(name):
    logical = catalogue.load(name)
    rows = logical.from_unit(np.random.default_rng(1).random((500, len(logical.parameters))))
    assert ((np.min(rooms_of(logical, rows), axis=0) >= 0) == logical.feasible(rows)).all()
    said = replace(
        logical, constraints=tuple(replace(one, room=None) for one in logical.constraints)
    )
    plain = rooms_of(said, rows)
    assert set(np.abs(plain).ravel().tolist()) == {32_000}
    assert ((np.min(plain, axis=0) >= 0) == logical.feasible(rows)).all()


def test_zones_stand_with_their_boundary_errors(page):
    assert "1.23 % 2.34 % over the whole box" in visible(page)


def test_settings_stand_with_unit_and_meaning(page):
    text = visible(page)
    assert (
        "critical_inverse_ttc 0.7 1/s ITTC* 6 inverse TTC from which a point is hazardous" in text
    )
    assert re.search(r"drivers \d+ settings ?, 1 not at the default", text)
    assert "count 3 default 10" in text


def test_the_same_evaluation_gives_the_same_bytes(evaluation, partitions, page):
    assert write_report(evaluation, partitions).read_text() == page


def test_a_run_without_facts_is_refused(evaluation, partitions, tmp_path):
    with refusal("is not a run folder"):
        write_report(replace(evaluation, folder=tmp_path), partitions)


# --- how a space is put on paper ------------------------------------------------------------------


def space(k):
    logical = catalogue.load(LOW_SPEED)
    parameters = tuple(
        Parameter(f"p{index}", 0.0, 10.0, 5.0, "m", "a length") for index in range(k)
    )
    return replace(logical, name="made_up", parameters=parameters, constraints=())


def points(evaluation, rows):
    first = evaluation.cases[0]
    records = (
        replace(first, values={f"p{index}": value for index, value in enumerate(row)})
        for row in rows
    )
    return CaseTable.of(records)


@pytest.mark.parametrize(
    "k, x, y, panel",
    values_of("""
    1, 0, None, None
    2, 0, 1, None
    3, 1, 2, 0
    """),
)
def test_up_to_three_parameters_are_all_shown(evaluation, k, x, y, panel):
    cases = points(evaluation, [[0.0] * k, [5.0] * k])
    view = choose_view(space(k), cases)
    assert view.x == x
    assert view.y == y
    assert view.panel == panel
    assert view.panels == ((0.0, 5.0) if k == 3 else (None,))
    assert all(view.shows(case) for case in cases)
    assert gathered_words(view) == ""


def test_many_values_of_the_first_parameter_share_panels(evaluation):
    cases = points(evaluation, [[0.1 * index, 1.0, 2.0] for index in range(50)])
    view = choose_view(space(3), cases)
    assert len(view.panels) == 6
    assert "p0 is nearest" in gathered_words(view)


def test_the_report_names_the_slice_of_four_parameters(evaluation):
    rows = [[7.0, x, 3.0, y, z] for x in (0.0, 5.0) for y in (0.0, 5.0) for z in (0.0, 0.0, 5.0)]
    view = choose_view(space(5), points(evaluation, rows))
    assert view.x == 1
    assert view.y == 3
    assert view.panel is None
    assert view.fixed == {0: 7.0, 2: 3.0, 4: 0.0}
    assert not view.projected


def test_when_hardly_a_case_is_on_the_slice_all_are_projected(evaluation):
    rows = [[float(index % 11), float(index), 0.1 * index, 0.2 * index] for index in range(11)]
    assert choose_view(space(4), points(evaluation, rows)).projected


def test_a_large_evaluation_reports_that_it_embeds_some_points(
    evaluation, partitions, page, monkeypatch
):
    assert "points are in this file" not in page
    monkeypatch.setattr(sent_drives, "MOST_BYTES", 20 * sent_drives.BYTES_OF_A_TRAJECTORY)
    small = write_report(evaluation, partitions).read_text()
    monkeypatch.undo()
    write_report(evaluation, partitions)
    cases = [case for scenario in embedded(small)["scenarios"] for case in scenario["cases"]]
    here = {case["key"] for case in cases if case["embedded"]}
    assert 0 < len(here) < len(cases)
    hits = [case for case in evaluation.cases if case.collided]
    assert max(hits, key=lambda case: case.severity or 0.0).case in here, "the hardest comes first"
    assert (
        sum(len(scenario["trajectories"]["data"]) for scenario in embedded(small)["scenarios"])
        <= 20 * 900
    )
    points = len({tuple(key.split("-")[:2]) for key in here})
    assert (
        f"Trajectories of {points} of {sum(zone.sampled for zone in evaluation.zones)} points"
        in visible(small)
    )


def test_drives_to_embed_are_the_hardest_of_all_scenarios(evaluation):
    hit = next(case for case in evaluation.cases if case.collided)
    points = {"a": {"x": 0, "y": 1}, "b": {"z": 0}}
    severities = {"x": 9.0, "y": 5.0, "z": 1.0}
    cases = {
        name: [replace(hit, scenario=name, case=case, severity=severities[case]) for case in its]
        for name, its in points.items()
    }
    store = SimpleNamespace(
        names=lambda role, name: [("", at, "") for at in points[name].values() if role == "ads"]
    )
    chosen = sent_drives.worth_embedding(cases, points, store, 2)
    assert chosen.points == {("a", 0), ("a", 1)}


def test_the_reading_of_u_names_what_replaces_it(evaluation):
    own = with_losses(evaluation, severity="injury:car_driver")
    plain, replaced = (dict(readings(one.settings))["14–15"] for one in (evaluation, own))
    assert replaced == f"{plain} `injury:car_driver` replaces it."


@pytest.mark.parametrize(
    "table, settings, words",
    [
        ("simulation.plant", SimulationSettings(plant=PlantSettings(file="Car.fmu")), "Car.fmu"),
        ("run", RunSettings(only=("cut_in-0000-idm", "~ideal")), "cut_in-0000-idm, ~ideal"),
        ("drivers", DriverSettings(recordings=("day.csv",)), "day.csv"),
        ("simulation", SimulationSettings(end_when_decided=True), "true"),
    ],
)
def test_changed_setting_is_listed(evaluation, table, settings, words):
    changed = replace(evaluation.settings, **{table.partition(".")[0]: settings})
    assert [row.value for row in setting_rows(changed)[table] if row.changed] == [words]


def test_settings_without_a_value_are_shown_as_none(evaluation):
    rows = setting_rows(evaluation.settings)["simulation.conditions"]
    values = {row.path.rpartition(".")[2]: row.value for row in rows}
    assert (values["sensor_range"], values["occlusion"]) == ("none", "false")


def test_text_between_backticks_is_code_and_stays_escaped():
    marked = code_marked('Check `zone.<b>` and "people".')
    assert marked == "Check <code>zone.&lt;b&gt;</code> and &#34;people&#34;."
    assert marked.__html__() == marked, "a template does not escape it again"
