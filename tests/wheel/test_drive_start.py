"""Before a drive: what has to be compiled is compiled where Ctrl-C is heard at once."""

import pytest
from commands import sumo_eval

from sumo_eval.extras.wheel.trip import concrete_of
from sumo_eval.record import loops
from sumo_eval.scenario import catalogue


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
