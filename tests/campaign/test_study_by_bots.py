"""A whole study by three participants without persons, in real time, in a browser: from the first
code to Fig. 11."""

import json
import re
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from laid import read_json

pytest.importorskip("websockets")
from browser import Page, needs_chromium

import sumo_eval
from sumo_eval.extras.figures.drawn import draw
from sumo_eval.extras.wheel.tape import again

BOT = Path(__file__).parents[1] / "wheel" / "bot.js"
RUN = """
name = "afternoon"
[[scenario]]
use = "front_vehicle_cut_out"
[scenario.sampling]
method = "grid"
levels = { ego_speed = 2, obstacle_speed = 2, gap = 3 }
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
method = "grid"
levels = { ego_speed = 3, lead_speed = 3 }
[[ads]]
name = "idm"
controller = "idm"
[[ads]]
name = "lane_changer"
controller = "lane_changer"
[[ads]]
name = "asleep"
controller = "no_reaction"
[[ads]]
name = "careful"
controller = "careful_driver"
[drivers]
count = 5
[run]
workers = 1
"""
STUDY = """
name = "bots"
run = "run"
consent = "We record how you drive and what you answer, under your code alone."
count = 8
break_after = 4
[practice]
seconds = 10.0
most = 3
[quality]
dropped = 1.0
latency_ms = 10000.0
stalls = 1000
stepped_down = 1000
unanswered = 1000.0
"""
PEOPLE = tomllib.loads("""
P01 = { overtakes = true, wander = 0.006, headway = 1.0 }
P02 = { overtakes = false, wander = 0.01, headway = 1.4 }
P03 = { overtakes = true, wander = 0.008, headway = 1.2 }
""")
OPINION = """() => { const hit = document.querySelector('.replay-contact');
    return (hit && !hit.hidden ? 2 : 5) + Math.floor(Math.random() * 3); }"""


def take_part(page, code):
    """A participant from the code to the thanks, the page opened anew before."""
    page.call("Page.reload")
    page.wait("document.documentElement.dataset.shown === 'sheet' && !window.through", 120.0)
    page.run(BOT.read_text())
    page.run(
        f"bot({{ code: {json.dumps(code)}, wish: {json.dumps(PEOPLE[code])}, opinion: {OPINION} }})"
    )
    page.wait("Boolean(window.through)", 900.0)


@pytest.mark.campaign
@needs_chromium
def test_three_bots_drive_a_study_in_a_browser_and_fig_11_is_drawn(tmp_path):
    """8 drives each: every tape comes to the same bytes again, every rated score stands in the
    figure."""
    (tmp_path / "base.toml").write_text(RUN)
    (tmp_path / "study.toml").write_text(STUDY)
    sumo_eval.evaluate(tmp_path / "base.toml", out=tmp_path / "run")
    command = [
        sys.executable,
        "-m",
        "sumo_eval",
        "drive",
        str(tmp_path / "study.toml"),
        "--no-browser",
        "--port",
        "0",
    ]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    address = server.stdout.readline().split(": ", 1)[1].strip()
    with Page(tmp_path / "profile", 800, 600, "--disable-3d-apis") as page:
        page.open(address, "document.documentElement.dataset.shown === 'sheet'")
        for code in PEOPLE:
            take_part(page, code)
            page.run(
                f"[...document.querySelectorAll('button')].at({-1 if code == 'P03' else 0}).click()"
            )
            time.sleep(1.0)
    said = server.communicate(timeout=120.0)[0]
    tapes = sorted((tmp_path / "bots" / "participants").glob("*/front*.jsonl"))
    assert len(tapes) == 24
    assert all(again(tape).same for tape in tapes)
    counted = re.search(
        r"3 took part; (\d+) drives by (\d+) of them count, (\d+) (?:are|is) left out", said
    )
    assert int(counted[1]) + int(counted[3]) == 24
    with_people = tmp_path / "people"
    sumo_eval.evaluate(tmp_path / "bots" / "evaluation.toml", out=with_people)
    opinion = [sys.executable, "-m", "sumo_eval", "humans", "opinion", str(with_people)]
    subprocess.run([*opinion, str(tmp_path / "bots" / "ratings.csv")], check=True)
    told = read_json(with_people / "opinion.json")
    assert len(told["rows"]) == 8
    assert told["intervals"]["A"] is not None
    draw(with_people, "opinion", scenario=None, ads=None, case=None, width="page")
