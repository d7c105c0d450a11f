"""Before a drive: what has to be compiled is compiled where Ctrl-C is heard at once."""

import pytest
from commands import sumo_eval

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
        "drive",
        "front_vehicle_cut_out",
        "--no-browser",
        "--port",
        0,
        "--out",
        tmp_path / "drives",
        status=130,
    )
    assert "Drive here" not in done.said


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
