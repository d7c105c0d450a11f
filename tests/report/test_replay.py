"""The replay: its TTC is the method's, it plays in a browser without a request, and shows what was
recorded."""

import json
from dataclasses import replace
from importlib.resources import files

import builders
import numpy as np
import pytest
from browser import Page, needs_chromium, needs_node, node, plain
from builders import CALM, HOSTILE
from commands import cli_refuses
from lxml import etree
from packed_pages import unpacked
from page_checks import press
from refusals import refusal
from report_cases import pick

from sumo_eval.cosim.sumo.gui_replay import sumo_gui
from sumo_eval.errors import InputError
from sumo_eval.method.measures import time_to_collision, vehicle_ahead
from sumo_eval.record.store import open_store
from sumo_eval.report.page_data import drawn_line, drawn_road
from sumo_eval.report.replay import recorded, write_replay
from sumo_eval.scenario import Road, catalogue
from sumo_eval.scenario.bodies import BODIES
from sumo_eval.scenario.road.lanes import LaneSpan
from sumo_eval.scenario.road.reference_line import Piece, arc, map_places
from sumo_eval.trajectory import Collision, Trajectory

REPLAY_JS = str(files("sumo_eval.report") / "templates" / "replay.js")


@needs_node
@pytest.mark.parametrize("contact", [False, True])
def test_the_page_computes_the_gap_and_ttc_of_the_method(contact):
    """An ego that weaves behind a braking lorry, beside a faster car, with a car that crosses and
    an actor whose recording ends early."""
    ego = builders.drive(50.0, 0.0, 25.0, 6.0, offset=2.0)
    actors = {
        "lead": replace(builders.drive(90.0, 0.0, 20.0, 6.0, braking=2.0), length=12.0, width=2.5),
        "fast": builders.drive(60.0, 3.5, 40.0, 6.0),
        "gone": builders.drive(70.0, 0.0, 15.0, 2.0),
        "across": Trajectory(ego.time, 80.0 + 0.0 * ego.time, 10.0 * (1.0 - ego.time)),
    }
    road = Road("bend", 400.0, 2, 3.5, 0.0, line=(arc(400.0, 250.0),))
    pose = (0.0, 0.0, 0.0)
    hit = (
        Collision(4.0, "lead", (20.0, 0.0), (12.0, 0.0), 1.0, "front", pose, pose)
        if contact
        else None
    )
    given = {
        "ego": plain(ego),
        "actors": [[name, plain(actor)] for name, actor in actors.items()],
        "contact": {"time": 4.0, "other": "lead", "side": "front"} if contact else None,
        "road": {"line": drawn_line(road)},
    }
    script = f"""
        const replay = require({json.dumps(REPLAY_JS)});
        const {{ gap, ttc }} = replay.ahead(given.ego, given.actors, given.contact, given.road);
        const word = (value) => (Number.isFinite(value) ? value : String(value));
        console.log(JSON.stringify({{ gap: Array.from(gap, word), ttc: Array.from(ttc, word) }}));
    """
    there = {
        name: np.array([float(value) for value in values])
        for name, values in node(script, given).items()
    }
    gap, closing = vehicle_ahead(ego, actors, hit, road)
    np.testing.assert_allclose(there["gap"], gap, atol=1e-9)
    np.testing.assert_allclose(there["ttc"], time_to_collision(gap, closing), rtol=1e-9)
    assert np.isfinite(gap).any()


def collision(evaluation):
    return recorded(evaluation.folder, pick(evaluation, collided=True).case)


def replay_of_collision(evaluation, folder, beside=None):
    fact = collision(evaluation)
    return write_replay(
        evaluation.folder, catalogue.load(fact.scenario), fact, folder / "r.html", beside=beside
    )


def test_a_replay_is_small_and_asks_for_nothing(evaluation, tmp_path):
    """The player is about 60 kB; one case of the hand-made evaluation adds less than the 14 kB a
    case may take."""
    page = replay_of_collision(evaluation, tmp_path).read_text()
    (data,) = page.split('id="replay-data">')[1].split("</script>")[:1]
    assert len(data) < 14_000
    # a name, no address
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")


PAINTED = """Promise.all([...document.querySelectorAll('canvas')].map(async (canvas) => {
    const sheet = document.createElement('canvas').getContext('2d');
    sheet.drawImage(canvas, 0, 0);
    return new Set(sheet.getImageData(0, 0, 300, 100).data).size > 3;
}))"""
"""Of every canvas of a page, whether something is drawn on it."""


@needs_chromium
def test_the_replay_page_plays_in_a_browser(evaluation, tmp_path):
    path = replay_of_collision(evaluation, tmp_path, HOSTILE)
    with open_store(evaluation.folder) as store:
        ego = store.trajectory(collision(evaluation).case)
    with Page(tmp_path / "profile") as page:
        page.open(path.as_uri(), "document.documentElement.dataset.replay === 'ready'")
        names = page.run(
            "[...document.querySelectorAll('.replay-view figcaption')].map((one) => "
            "one.textContent)"
        )
        assert names == [CALM, HOSTILE]
        assert "contact at t = 3.04 s, 7.5 m/s" in page.run(
            "document.querySelector('.replay-reading').textContent"
        )
        page.run("""(() => { const slider = document.querySelector('.replay-slider');
            slider.value = 1; slider.dispatchEvent(new Event('input')); })()""")
        speed = float(np.interp(1.0, ego.time, ego.speed))
        assert f"v {speed:.1f} m/s" in page.run(
            "document.querySelector('.replay-reading').textContent"
        )
        press(page, " ")  # nothing was clicked before
        page.wait("Number(document.querySelector('.replay-slider').value) > 1.1")
        press(page, " ")
        held = page.run("document.querySelector('.replay-slider').value")
        page.run("new Promise((resolve) => setTimeout(resolve, 150))")
        assert page.run("document.querySelector('.replay-slider').value") == held
        assert page.run(PAINTED) == [True] * 8
        assert page.run(
            "[...document.querySelectorAll('.replay-chase')].every((it) => it.getContext('webgl2'))"
        )
        assert page.problems == []
        assert page.asked_for() == [path.as_uri()]


def share_of(page, colour, within=40):
    """Share of the first view's pixels that are about of a colour."""
    return float(
        page.run(f"""(() => {{
        const canvas = document.querySelector('.replay-chase'), sheet = document.createElement('canvas');
        Object.assign(sheet, {{ width: 200, height: 100 }});
        const pen = sheet.getContext('2d');
        pen.drawImage(canvas, 0, 0, 200, 100);
        const data = pen.getImageData(0, 0, 200, 100).data, wanted = {list(colour)};
        let found = 0;
        for (let k = 0; k < data.length; k += 4) found += wanted.every((v, c) => Math.abs(v - data[k + c]) < {within});
        return found / 20000;
    }})()""")
    )


@pytest.mark.campaign
@needs_chromium
def test_every_camera_shows_road_and_ego_and_contact_has_its_frames(evaluation, tmp_path):
    """Asphalt is grey in every camera; the ego's blue, its bonnet from the seat; red frames at
    contact, none before."""
    path = replay_of_collision(evaluation, tmp_path, HOSTILE)
    with Page(tmp_path / "profile") as page:
        page.open(path.as_uri(), "document.documentElement.dataset.replay === 'ready'")
        for camera in ("behind", "above", "seat", "free"):
            page.run(f"""(() => {{ const it = document.querySelector('.replay-camera');
                it.value = {camera!r}; it.dispatchEvent(new Event('change')); }})()""")
            assert share_of(page, (105, 110, 118)) > 0.02, camera
            assert share_of(page, (0, 90, 145), 50) > 0.001, camera
            assert share_of(page, (199, 41, 41), 50) > 0.0005, camera
        page.run("""(() => { const slider = document.querySelector('.replay-slider');
            slider.value = 0; slider.dispatchEvent(new Event('input')); })()""")
        assert share_of(page, (199, 41, 41), 25) == 0.0
        page.run("document.querySelector('.replay-ghosted input').click()")
        assert page.run(
            "[...document.querySelectorAll('.replay-chase')].map((it) => it.hidden)"
        ) == [False, True]
        assert page.problems == []


@pytest.mark.campaign
@needs_chromium
def test_where_webgl_is_missing_the_plain_drawing_stays(evaluation, tmp_path):
    path = replay_of_collision(evaluation, tmp_path)
    with Page(tmp_path / "profile", 800, 600, "--disable-3d-apis") as page:
        page.open(path.as_uri(), "document.documentElement.dataset.replay === 'ready'")
        assert page.run("document.querySelector('.replay-camera').hidden")
        assert page.run("document.querySelector('.replay-chase').getContext('webgl2')") is None
        assert all(page.run(PAINTED))
        assert not [it for it in page.problems if "WebGL" not in it]


def test_a_case_without_a_recording_and_a_companion_that_was_not_there_get_a_sentence(
    evaluation, tmp_path
):
    crashed = next(case for case in evaluation.cases if case.status == "crashed")
    with refusal("has no recording to replay"):
        recorded(evaluation.folder, crashed.case)
    with refusal("Did you mean"):
        recorded(evaluation.folder, crashed.case + "x")
    with refusal("Unknown ADS or driver"):
        replay_of_collision(evaluation, tmp_path, "nobody")


def test_a_companion_without_a_recording_is_not_called_unknown(evaluation, tmp_path):
    crashed = next(case for case in evaluation.cases if case.status == "crashed")
    with open_store(evaluation.folder) as store:
        point = store.fact(crashed.case).point
        (other, *_) = (
            it
            for it in store.facts_at(range(point, point + 1), "ads", crashed.scenario)
            if store.trajectories(it.case)
        )
    with refusal(f"Case `{crashed.case}` has no recording to replay"):
        write_replay(
            evaluation.folder, catalogue.load(other.scenario), other, tmp_path / "r.html",
            beside=crashed.ads,
        )  # fmt: skip


def test_a_driver_is_played_beside_an_ads(evaluation, tmp_path):
    safe = next(it for it in evaluation.cases if it.safe and it.status == "ok")
    fact = recorded(evaluation.folder, safe.case)
    page = write_replay(
        evaluation.folder, catalogue.load(safe.scenario), fact, tmp_path / "r.html",
        beside="driver_01",
    )  # fmt: skip
    assert "driver_01" in unpacked(page.read_text(), "replay-data")


def test_without_sumo_gui_a_sentence_says_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setattr("sys.executable", str(tmp_path / "python"))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        InputError, match=r"needs the extra `gui`, which this installs: .* -m pip install .*\[gui\]"
    ):
        sumo_gui()


@pytest.mark.parametrize("option", [["--out", "r.html"], ["--beside", "driver_01"], ["--open"]])
def test_options_of_the_animation_are_refused_with_gui(evaluation, option):
    case = evaluation.cases[0].case
    cli_refuses("`--gui` writes no animation", "replay", evaluation.folder, case, "--gui", *option)


@needs_node
def test_the_page_puts_a_curve_where_the_road_has_it():
    line = (
        Piece(40.0),
        Piece(60.0, 0.0, 1 / 200),
        arc(300.0, 200.0),
        Piece(90.0, 1 / 200, -1 / 80),
    )
    s, d = np.linspace(-20.0, 600.0, 63), np.linspace(-2.0, 5.0, 63)
    given = {
        "line": drawn_line(Road("bend", 400.0, 2, 3.5, 0.0, line=line)),
        "places": np.stack([s, d], 1).tolist(),
    }
    script = f"""
        const replay = require({json.dumps(REPLAY_JS)});
        console.log(JSON.stringify(given.places.map(([x, y]) => replay.onMap(given, x, y))));
    """
    found = np.array(node(script, given))
    # nine digits of the line travel
    assert np.abs(found - np.stack(map_places(line, s, d), axis=1)).max() < 1e-5


@needs_node
def test_bodies_are_drawn_in_their_size_as_what_their_scenario_says():
    """A truck of a van's size is a truck; at 20 m a pixel a child is 4 by 8 of them."""
    bodies = [
        {"kind": kind, "length": body.length, "width": body.width} for kind, body in BODIES.items()
    ]
    bodies += [
        {"kind": "truck", "length": 6.5, "width": 2.16},
        {"kind": "van", "length": 6.5, "width": 2.16},
    ]
    script = f"""
        const replay = require({json.dumps(REPLAY_JS)});
        console.log(JSON.stringify([given.map((body) => replay.bodyParts(body)), replay.bodyParts(given[6], 20)]));
    """
    drawn, child_from_afar = node(script, bodies)
    for body, parts in zip(bodies, drawn, strict=True):
        places = np.concatenate([part["ring"] for part in parts if part["role"] == "body"])
        rider = 0.56 if body["kind"] == "bicycle" else 0.0  # who rides is as wide as that at least
        size = np.ptp(places, axis=0)
        assert size == pytest.approx([body["length"], max(body["width"], rider)], abs=0.03), body
    roles = {
        body["kind"]: [part["role"] for part in parts]
        for body, parts in zip(bodies, drawn, strict=True)
    }
    assert roles["child"] == roles["pedestrian"] == ["body", "head"]
    assert roles["bicycle"] == roles["motorcycle"] == ["body"] * 3
    assert roles["car"] == roles["truck"] == ["body", "glass"]
    cab = [
        parts[1]["ring"][0][0]
        for body, parts in zip(bodies, drawn, strict=True)
        if body["length"] == 6.5
    ]
    assert cab == pytest.approx([3.25 - 1.4, 3.25 - 2.2, 3.25 - 1.4])  # van, truck, van
    assert np.ptp(child_from_afar[0]["ring"], axis=0).tolist() == [80.0, 160.0]


@needs_node
@pytest.mark.parametrize("length, kind", [(4.5, "car"), (12.0, "truck")])
def test_the_ego_is_drawn_as_what_its_size_looks_like(length, kind):
    ego = plain(builders.drive(0.0, 0.0, 10.0, 1.0)) | {"length": length, "width": 2.5}
    given = json.dumps(ego | {"acceleration": [0.0] * 99})
    script = f"""
        const body = require({json.dumps(REPLAY_JS)}).bodyAt({{ road: {{}} }}, {given}, "ego", 0, "");
        console.log(JSON.stringify(body.kind))"""
    assert node(script) == kind


@needs_node
def test_a_lane_without_a_taper_is_gone_at_once():
    """As networks of SUMO have it: the left lane, y 1.75 to 5.25, ends at x = 500."""
    road = Road("road", 1000.0, 2, 3.5, 100.0, spans=(LaneSpan(1, end=500.0),))
    templates = files("sumo_eval.report") / "templates"
    space = (templates / "scene3d.js").read_text().replace("create, means };", "roadMeshes };")
    report = (templates / "report.js").read_text()
    paths = report[report.index("function roadShapes") : report.index("const LEAST_PIXELS")]
    script = f"""
        const C = String, road = {json.dumps(drawn_road(road))};
        {space}
        {paths}
        const {{ data }} = sumoScene.roadMeshes(road, (_, x, y) => [x, y, 0], [300, 700]).surface;
        const grass = Array.from({{ length: data.length / 10 }}, (_, k) => data.slice(10 * k, 10 * k + 8))
            .filter((it) => it[6] === 0.62 && it[7] === 0.69).map(([x, y]) => [x, y]);
        const drawn = roadShapes({{ road }}, [300, 700]).filter(({{ type }}) => type === "path");
        console.log(JSON.stringify([grass, drawn.map(({{ path }}) => path)]));
    """
    grass, drawn = node(script)
    assert {(x, y) for x, y in grass if y < 5.25} == {(500.0, 1.75), (700.0, 1.75)}
    assert drawn[0] == "M700,5.25L700,1.75L500,1.75L500,5.25L500,5.25Z"


@needs_node
def test_an_actor_that_has_left_is_drawn_no_more():
    script = f"""
        const replay = require({json.dumps(REPLAY_JS)});
        const still = (time, x) => ({{ time, x: [x, x], y: [0, 0], heading: [0, 0], speed: [0, 0],
            acceleration: [0, 0], length: 4.5, width: 1.8 }});
        const ego = still([0, 9], 0), lead = still([0, 3], 20);
        const road = {{ left: 5, right: -2, lanes: 2, laneWidth: 3.5, crossings: [], solid: [], gone: [] }};
        function fills(actors, time) {{
            let count = 0;
            const context = new Proxy({{}}, {{
                get: (_, name) => () => {{ count += name === "fill"; }}, set: () => true }});
            replay.drawChase({{ clientWidth: 600, clientHeight: 300, getContext: () => context }},
                {{ road }}, {{ ego, actors, contact: null }}, "#0072b2", time, {{ ratio: 1 }});
            return count;
        }}
        console.log(JSON.stringify([3, 3.1].map((time) => fills([["lead", lead]], time) - fills([], time))));
    """
    there, gone = node(script)
    assert there > 0 == gone


@pytest.mark.campaign
@needs_chromium
def test_the_charts_of_a_replay_follow_the_theme_and_are_saved_as_they_are_drawn(
    evaluation, tmp_path
):
    path = replay_of_collision(evaluation, tmp_path)
    with Page(tmp_path / "profile") as page:
        page.open(path.as_uri(), "document.documentElement.dataset.replay === 'ready'")
        assert page.run("document.querySelectorAll('.replay-held .save button').length") == 4 * 3
        ground = """(() => {
            const sheet = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
            sheet.drawImage(document.querySelector('.replay-top'), 0, 0);
            return [...sheet.getImageData(2, 2, 1, 1).data].slice(0, 3);
        })()"""
        light = page.run(ground)
        page.run(
            "[...document.querySelectorAll('[data-tools] button')].find((b) => b.textContent === "
            "'Dark').click()"
        )
        assert sum(page.run(ground)) < sum(light) / 2
        page.run("""window.saved = [];
            URL.createObjectURL = (blob) => { blob.text().then((text) => window.saved.push(text)); return '#'; };
            HTMLAnchorElement.prototype.click = function () {};
            document.querySelectorAll('.replay-held .save button')
              .forEach((b, k) => { if (k === 0 || k === 2) b.click(); }); null""")
        page.wait("window.saved.length === 2")
        table, drawing = sorted(page.run("window.saved"), key=lambda text: text.startswith("<svg"))
        assert drawing.count("<path") >= 4  # three lines of the scale and a curve
        etree.fromstring(drawing.encode())  # it is well formed
        assert table.startswith('ads,"time, s","speed, m/s"')
        assert page.problems == []
