"""The replay: its TTC is the method's, it plays in a browser without a request, and shows what was recorded."""

from __future__ import annotations

import json
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import builders
import numpy as np
import pytest
from browser import CHROMIUM, Page

from sumo_eval.cosim.sumo.gui_replay import sumo_gui
from sumo_eval.errors import InputError
from sumo_eval.method.measures import time_to_collision, vehicle_ahead
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import EGO, Fact, open_store
from sumo_eval.report.page_data import drawn_line
from sumo_eval.report.replay import recorded, write_replay
from sumo_eval.results import Evaluation
from sumo_eval.scenario import Road, catalogue
from sumo_eval.scenario.road.reference_line import Piece, arc, map_places
from sumo_eval.trajectory import Collision, Trajectory

REPLAY_JS = str(files("sumo_eval.report") / "templates" / "replay.js")
NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")


def plain(trajectory: Trajectory) -> dict[str, object]:
    channels = {name: getattr(trajectory, name).tolist() for name in ("time", "x", "y", "heading", "speed")}
    return {**channels, "length": trajectory.length, "width": trajectory.width}


@needs_node
@pytest.mark.parametrize("contact", [False, True])
def test_the_page_computes_the_gap_and_ttc_of_the_method(contact: bool) -> None:
    """An ego that weaves behind a braking lorry, beside a faster car, with an actor whose recording ends early."""
    ego = builders.drive(50.0, 0.0, 25.0, 6.0, offset=2.0)
    actors = {
        "lead": lorry(builders.drive(90.0, 0.0, 20.0, 6.0, braking=2.0)),
        "fast": builders.drive(60.0, 3.5, 40.0, 6.0),
        "gone": builders.drive(70.0, 0.0, 15.0, 2.0),
    }
    pose = (0.0, 0.0, 0.0)
    hit = Collision(4.0, "lead", (20.0, 0.0), (12.0, 0.0), 1.0, "front", pose, pose) if contact else None
    given = {
        "ego": plain(ego),
        "actors": [[name, plain(actor)] for name, actor in actors.items()],
        "contact": {"time": 4.0, "other": "lead", "side": "front"} if contact else None,
    }
    script = f"""
        const replay = require({json.dumps(REPLAY_JS)});
        const given = JSON.parse(require("fs").readFileSync(0, "utf8"));
        const {{ gap, ttc }} = replay.ahead(given.ego, given.actors, given.contact);
        const word = (value) => (Number.isFinite(value) ? value : String(value));
        console.log(JSON.stringify({{ gap: Array.from(gap, word), ttc: Array.from(ttc, word) }}));
    """
    assert NODE is not None
    done = subprocess.run([NODE, "-e", script], input=json.dumps(given), capture_output=True, text=True, check=True)
    there = {name: np.array([float(value) for value in values]) for name, values in json.loads(done.stdout).items()}
    gap, closing = vehicle_ahead(ego, actors, hit)
    np.testing.assert_allclose(there["gap"], gap, atol=1e-9)
    np.testing.assert_allclose(there["ttc"], time_to_collision(gap, closing), rtol=1e-9)
    assert np.isfinite(gap).any()


def lorry(driven: Trajectory) -> Trajectory:
    channels = {name: getattr(driven, name) for name in ("time", "x", "y", "heading", "speed")}
    return Trajectory(**channels, length=12.0, width=2.5)


def collision(evaluation: Evaluation) -> Fact:
    key = next(case.case for case in evaluation.cases if case.ads == builders.CALM and case.collided)
    return recorded(evaluation.folder, key)


def test_a_replay_is_small_and_asks_for_nothing(evaluation: Evaluation, tmp_path: Path) -> None:
    """The player is about 35 kB; one case of the hand-made evaluation adds less than the 14 kB a case may take."""
    fact = collision(evaluation)
    path = write_replay(evaluation.folder, catalogue.load(fact.scenario), fact, tmp_path / "replay.html")
    page = path.read_text(encoding="utf-8")
    (data,) = page.split('id="replay-data">')[1].split("</script>")[:1]
    assert len(data) < 14_000
    assert "http" not in page.replace("http-equiv", "")


@needs_chromium
def test_the_replay_page_plays_in_a_browser(evaluation: Evaluation, tmp_path: Path) -> None:
    fact = collision(evaluation)
    logical = catalogue.load(fact.scenario)
    path = write_replay(evaluation.folder, logical, fact, tmp_path / "replay.html", beside=builders.HOSTILE)
    with open_store(evaluation.folder / FACTS) as store:
        ego = store.trajectory(fact.case, EGO)
    with Page(tmp_path / "profile") as page:
        page.open(path.as_uri(), "document.documentElement.dataset.replay === 'ready'")
        names = page.run("[...document.querySelectorAll('.replay-view figcaption')].map((one) => one.textContent)")
        assert names == [builders.CALM, builders.HOSTILE]
        assert "contact at t = 3.04 s, 7.5 m/s" in page.run("document.querySelector('.replay-reading').textContent")
        page.run("""(() => { const slider = document.querySelector('.replay-slider');
            slider.value = 1; slider.dispatchEvent(new Event('input')); })()""")
        speed = float(np.interp(1.0, ego.time, ego.speed))
        assert f"v {speed:.1f} m/s" in page.run("document.querySelector('.replay-reading').textContent")
        page.run("document.querySelector('.replay-play').click()")
        page.wait("Number(document.querySelector('.replay-slider').value) > 1.1")
        page.run("document.querySelector('.replay-play').click()")
        held = page.run("document.querySelector('.replay-slider').value")
        page.run("new Promise((resolve) => setTimeout(resolve, 150))")
        assert page.run("document.querySelector('.replay-slider').value") == held
        painted = page.run("""[...document.querySelectorAll('canvas')].map((canvas) => new Set(
            canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data).size > 3)""")
        assert len(painted) == 8
        assert all(painted)
        assert page.problems == []
        assert [one for one in page.requests if not one.startswith(("data:", "blob:"))] == [path.as_uri()]


def test_a_case_without_a_recording_and_a_companion_that_was_not_there_get_a_sentence(
    evaluation: Evaluation, tmp_path: Path
) -> None:
    crashed = next(case for case in evaluation.cases if case.status == "crashed")
    with pytest.raises(InputError, match="has no recording to replay"):
        recorded(evaluation.folder, crashed.case)
    with pytest.raises(InputError, match="Did you mean"):
        recorded(evaluation.folder, crashed.case + "x")
    fact = collision(evaluation)
    with pytest.raises(InputError, match="Unknown ADS or driver"):
        write_replay(evaluation.folder, catalogue.load(fact.scenario), fact, tmp_path / "r.html", beside="nobody")


def test_without_sumo_gui_a_sentence_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("sys.executable", str(tmp_path / "python"))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"needs the extra `gui`, which this installs: .* -m pip install .*\[gui\]"):
        sumo_gui()


@needs_node
def test_the_page_puts_a_bend_where_the_road_has_it() -> None:
    line = (Piece(40.0), Piece(60.0, 0.0, 1 / 200), arc(300.0, 200.0), Piece(90.0, 1 / 200, -1 / 80))
    s, d = np.linspace(-20.0, 600.0, 63), np.linspace(-2.0, 5.0, 63)
    given = {"line": drawn_line(Road("bend", 400.0, 2, 3.5, 0.0, line=line)), "places": np.stack([s, d], 1).tolist()}
    script = f"""
        const replay = require({json.dumps(REPLAY_JS)});
        const given = JSON.parse(require("fs").readFileSync(0, "utf8"));
        console.log(JSON.stringify(given.places.map(([x, y]) => replay.onMap(given, x, y))));
    """
    done = subprocess.run(
        [str(NODE), "-e", script], input=json.dumps(given), capture_output=True, text=True, check=True
    )
    found = np.array(json.loads(done.stdout))
    assert np.abs(found - np.stack(map_places(line, s, d), axis=1)).max() < 1e-5  # nine digits of the line travel
