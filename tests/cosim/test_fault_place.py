"""Where in the user's code an exception came from, from real files."""

from pathlib import Path

import pytest
from road_scenes import half_second

from sumo_eval.cosim.doors.fault_place import fault_place

ADS = """import numpy as np
import fault_place_helper
from sumo_eval import Command

class InHelper:
    def act(self, seen):
        return fault_place_helper.plan()

class InLibrary:
    def act(self, seen):
        return Command(float(np.linalg.inv(np.zeros((2, 2)))[0, 0]))

class InReset:
    def reset(self, *briefing):
        raise ValueError("no map")
    def act(self, seen):
        return Command(0.0)

def with_cause(traci, ego, time):
    try:
        {}["key"]
    except KeyError as error:
        raise RuntimeError("no plan") from error

def nonsense(traci, ego, time):
    return "brake"

def swallows(traci, ego, time):
    try:
        traci.vehicle.setSpeed(ego, float("nan"))
    except Exception:
        pass

def jumps(traci, ego, time):
    traci.vehicle.moveToXY(ego, "", -1, 10.0, 0.0, 90.0, 2)

class TakesNoReset:
    def step(self, traci, ego, time): ...
    def reset(self): ...

class TakesNoClose:
    def act(self, seen): return 0.0
    def close(self, seen): ...

class OverArrays:
    batch = True
    def act(self, seen):
        return np.zeros(len(seen.number))
    def close(self):
        fault_place_helper.plan()

def no_number(seen):
    return "brake"

class Called:
    def __call__(self, seen):
        return "brake"
"""
PLACES = {
    "InHelper": "fault_place_ads.py:7 in act",  # the ADS's own file, not its helper's
    "InLibrary": "fault_place_ads.py:11 in act",  # not numpy's
    "InReset": "fault_place_ads.py:15 in reset",
    "with_cause": "fault_place_ads.py:23 in with_cause",
    "nonsense": "fault_place_ads.py:25 in nonsense",  # nothing was raised: where it begins
    "swallows": "fault_place_ads.py:28 in swallows",
    "jumps": "fault_place_ads.py:34 in jumps",
    "TakesNoReset": "fault_place_ads.py:39 in reset",
    "TakesNoClose": "fault_place_ads.py:43 in close",
    "OverArrays": "fault_place_ads.py:50 in close",
    "no_number": "fault_place_ads.py:52 in no_number",
    "Called": "fault_place_ads.py:56 in __call__",
}


def write_ads(folder):
    (folder / "fault_place_helper.py").write_text("def plan():\n    raise ValueError('no path')\n")
    (folder / "fault_place_ads.py").write_text(ADS)


@pytest.mark.parametrize("name", PLACES)
def test_the_place_is_the_innermost_line_of_the_users_own_file(tmp_path, monkeypatch, name):
    monkeypatch.syspath_prepend(str(tmp_path))
    write_ads(tmp_path)
    found = half_second(f"fault_place_ads.py:{name}", folder=tmp_path)
    assert found.end_reason == "ads_error"
    assert found.error_place == PLACES[name]


def test_through_a_link_to_the_folder_the_place_is_the_same(tmp_path, monkeypatch):
    (tmp_path / "real").mkdir()
    write_ads(tmp_path / "real")
    link = tmp_path / "link"
    link.symlink_to("real")
    monkeypatch.syspath_prepend(str(link))
    found = half_second("fault_place_ads:InHelper", folder=link)
    assert found.error_place == PLACES["InHelper"]


def test_outside_the_users_file_it_is_the_innermost_line_of_no_library():
    try:
        {}["key"]
    except KeyError as error:
        place = fault_place(error, None, Path(__file__).parent)
    assert place.startswith("test_fault_place.py:")
    assert fault_place(None, None, None) == ""
