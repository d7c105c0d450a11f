"""Before a drive: what has to be compiled is compiled where Ctrl-C is heard at once."""

import sys
from urllib.request import urlopen

import pytest
from commands import cli_refuses, sumo_eval
from tables import rows_of

from sumo_eval.extras.wheel.command import _open
from sumo_eval.extras.wheel.trip import concrete_of
from sumo_eval.record import loops
from sumo_eval.scenario import catalogue
from tests.scenario.test_openscenario import RANGE, VARIATION, changed


def test_ctrl_c_while_a_drive_compiles_stops_it_at_once(tmp_path, monkeypatch):
    def stopped(scripts):
        raise KeyboardInterrupt

    monkeypatch.setattr(loops, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(loops, "warm", stopped)
    done = sumo_eval(
        f"drive front_vehicle_cut_out --no-browser --port 0 --out {tmp_path}/drives", status=130
    )
    assert "Drive here" not in done.said


def test_the_page_comes_while_the_browsers_command_runs(monkeypatch):
    """It may be one that ends once the page is there, such as BROWSER="curl %s"."""
    pages = []

    def fetch(address):
        with urlopen(address, timeout=10.0) as page:
            pages.append(page.read())
        return True

    async def work(_):
        pass

    monkeypatch.setattr("webbrowser.open", fetch)
    _open("Drive", 0, work, no_browser=False)
    assert b"Drive" in pages[0]


def test_a_parameter_with_listed_values_begins_at_one_of_them():
    """`side` is -1 or 1; between them there is no scene to drive."""
    assert concrete_of(catalogue.load("exit_cut"), {}).values["side"] == 1.0


@pytest.mark.parametrize("name", ["ncap_ccrs", "ncap_ccrb", "ncap_ccrm"])
def test_a_drive_begins_where_the_middle_is_impossible(name):
    values = concrete_of(catalogue.load(name), {"ego_speed": 10.0}).values
    assert values["ego_speed"] == 10.0
    assert abs(values["overlap"]) == 0.5


def test_a_drive_of_a_large_file_begins_at_a_supported_point(tmp_path):
    """In one lane, bodies of 4 m and 6 m must be 5 m apart."""
    scene = changed(tmp_path, ("light", "gap"), ('dLane="1" ds="50"', 'dLane="0" ds="$gap"'))
    speed = RANGE.replace("18", "1").format(name="kph")
    gap = speed.replace("kph", "gap").replace("36", "-27").replace("90", "27")
    path = tmp_path / "varied.xosc"
    path.write_text(VARIATION.format(file=scene.name, parts=speed + gap))
    assert concrete_of(catalogue.find(str(path)), {}).values == {"kph": 63.0, "gap": 5.0}


# --- `sumo-eval drive` given what it cannot use: one sentence, exit status 2 ----------------------


@pytest.mark.parametrize(
    "arguments, words",
    rows_of(
        """
nowhere_at_all | nowhere_at_all
cut_in --rate 30 | one of 20, 50, 100 Hz, got 30
cut_in --set gap | NAME=VALUE with a number
cut_in --set =5 | NAME=VALUE with a number
cut_in --set gap=3 --set gap=4 | must be given once, got `gap` twice
cut_in --set gapp=3 | Did you mean `gap`
cut_in --set gap=1e9 | gap
nothing.jsonl | There is no tape nothing.jsonl
nothing.toml | nothing.toml
""",
        str.split,
    ),
)
def test_what_it_cannot_use_gets_a_sentence(arguments, words):
    cli_refuses(words, "drive", *arguments, "--no-browser", "--port", "0")


def test_without_websockets_a_sentence_names_the_extra(monkeypatch, tmp_path):
    for name in list(sys.modules):
        if name.partition(".")[0] == "websockets" or name == "sumo_eval.extras.wheel.window":
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "websockets", None)
    cli_refuses("needs the extra `drive`", f"drive cut_in --no-browser --port 0 --out {tmp_path}")
