"""SUMO's input files: what is written, that it loads, and that the checked-in ones are what would
be written."""

import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import libsumo
import pytest
from loaded import load
from lxml import etree
from road_scenes import ROAD, case, central_case, lead

from sumo_eval.cosim.sumo.session import session
from sumo_eval.cosim.sumo.sumo_files import (
    SIMULATION_OPTIONS,
    configuration_xml,
    network_xml,
    routes_xml,
)
from sumo_eval.scenario import Actor, Start, brake_to_stop, catalogue, lane_change
from sumo_eval.settings import SimulationSettings, VehicleSettings

TREE = Path(__file__).resolve().parents[2]
CAR = VehicleSettings()


tool = load("tools/generate_sumo_inputs.py")


def parse(text):
    return etree.fromstring(text.encode())


# --- text -----------------------------------------------------------------------------------------


def test_the_network_has_the_right_lane_on_y_0():
    lanes = parse(network_xml(ROAD)).findall("edge/lane")
    assert [lane.get("shape") for lane in lanes] == [
        "0.00,0.00 6000.00,0.00",
        "0.00,3.50 6000.00,3.50",
    ]
    assert {(lane.get("length"), lane.get("width"), lane.get("speed")) for lane in lanes} == {
        ("6000.00", "3.50", "60.00")
    }


def test_the_network_keeps_every_decimal_that_two_would_lose():
    road = replace(ROAD, lane_width=3.333, lanes=3)
    lanes = parse(network_xml(road)).findall("edge/lane")
    assert [lane.get("shape").split(",")[-1] for lane in lanes] == ["0.00", "3.333", "6.666"]


def test_a_route_file_places_front_bumpers_and_lateral_offsets():
    routes = parse(routes_xml(case(Actor("other", Start(100.0, 2.5, 7.0), length=5.0)), CAR))
    ego, other = (dict(vehicle.attrib) for vehicle in routes.findall("vehicle"))
    start = {"departLane": "0", "departPos": "52.25", "insertionChecks": "none"}
    assert start.items() <= ego.items()
    assert "departPosLat" not in ego
    # 2.5 m to the left is lane 1 (3.5 m), 1.0 m to the right of its centre line; front bumper at
    # 100 + 5/2
    start |= {"departLane": "1", "departPos": "102.5", "departPosLat": "-1.0"}
    assert start.items() <= other.items()


def test_the_egos_type_has_the_vehicles_limits_and_may_be_added_to():
    more = {"carFollowModel": "IDM", "accel": "2"}
    ego = dict(parse(routes_xml(case(), CAR, more)).find("vType").attrib)
    limits = {"decel": "9.0", "emergencyDecel": "9.0", "minGap": "0"}
    assert (limits | more).items() <= ego.items()


def test_a_vehicle_that_sumo_drives_wants_its_initial_speed():
    types = parse(routes_xml(case(lead(gap=10.0, speed=0.0)), CAR)).findall("vType")
    # SUMO refuses a desired 0
    assert [vtype.get("desiredMaxSpeed") for vtype in types] == ["20.0", "0.001"]


def test_a_route_file_says_which_point_it_is_and_what_it_cannot_express():
    mover = Actor(
        "mover", Start(80.0, 0.0, 20.0), (lane_change(0.5, 3.0, 3.5), lane_change(5.0, 2.0, -3.5))
    )
    concrete = replace(case(mover), scenario="cut---out", values={"gap": 30.0, "ego_speed": 20.0})
    comment = parse(routes_xml(concrete, CAR, origin="From a test.")).getprevious()
    assert "cut- - -out: gap=30, ego_speed=20." in comment.text  # two hyphens would end the comment
    assert "From a test." in comment.text
    assert "`mover` moves 3.5 m to the left from 0.5 s to 3.5 s" in comment.text
    assert "`mover` moves 3.5 m to the right from 5 s to 7 s" in comment.text
    assert "Not in this file" not in routes_xml(case(), CAR)
    braking = routes_xml(
        case(Actor("lead", Start(80.0, 0.0, 20.0), (brake_to_stop(0.5, 4.0),))), CAR
    )
    assert "`lead` brakes to a standstill with 4 m/s2 from 0.5 s on" in braking
    crossing = Actor("other", Start(80.0, -20.0, 10.0), heading=0.5 * math.pi)
    words = "here it keeps its speed and drives along the road."
    assert words in routes_xml(case(crossing), CAR), "a route file has no headings"


def test_a_configuration_has_the_options_of_the_harness():
    root = parse(configuration_xml("a.net.xml", "b.rou.xml", 0.05, lane_change_duration=3.5))
    values = {element.tag: element.get("value") for section in root for element in section}
    assert values == {
        "net-file": "a.net.xml", "route-files": "b.rou.xml", "begin": "0", "step-length": "0.05",
        "lanechange.duration": "3.5", **SIMULATION_OPTIONS,
    }  # fmt: skip


# --- the files in the tree ------------------------------------------------------------------------


def files_below(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_the_checked_in_files_are_what_the_tool_writes_byte_for_byte(tmp_path):
    assert tool.main(["--out", str(tmp_path)]) == 0
    written = files_below(tmp_path)
    in_tree = {
        f"{name}/{key}": text
        for name in ("networks", "routes")
        for key, text in files_below(TREE / name).items()
    }
    assert written == in_tree
    assert {f"routes/{name}.sumocfg" for name in catalogue.SCENARIOS} <= set(written)


def test_the_check_names_every_file_that_is_not_right(tmp_path, capsys):
    tool.main(["--out", str(tmp_path)])
    assert tool.main(["--check", "--out", str(tmp_path)]) == 0
    (tmp_path / "routes" / "front_vehicle_cut_out.rou.xml").write_text("<routes/>")
    (tmp_path / "routes" / "front_vehicle_low_speed.sumocfg").unlink()
    (tmp_path / "networks" / "old.net.xml").write_text("<net/>")
    assert tool.main(["--check", "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert "routes/front_vehicle_cut_out.rou.xml is stale" in said
    assert "routes/front_vehicle_low_speed.sumocfg is missing" in said
    assert "networks/old.net.xml belongs to no shipped scenario" in said


@pytest.mark.parametrize("name", sorted(catalogue.SCENARIOS))
def test_every_shipped_configuration_loads_in_libsumo_and_steps(name):
    concrete = central_case(name)
    libsumo.start(["sumo", "-c", str(TREE / "routes" / f"{name}.sumocfg"), "--no-step-log", "true"])
    try:
        libsumo.simulationStep()
        assert set(libsumo.vehicle.getIDList()) == {
            "ego",
            *(actor.name for actor in concrete.actors),
        }
        assert libsumo.vehicle.getSpeed("ego") == concrete.ego.speed
        assert libsumo.simulation.getDeltaT() == SimulationSettings().step
        for _ in range(40):  # nobody drives off at the road's limit of 60 m/s
            libsumo.simulationStep()
        assert libsumo.vehicle.getSpeed("ego") <= concrete.ego.speed + 1e-6
        for actor in concrete.actors:
            assert libsumo.vehicle.getSpeed(actor.name) <= actor.start.speed + 0.0011
    finally:
        libsumo.close()


@pytest.mark.parametrize("name", sorted(catalogue.SCENARIOS))
def test_what_is_checked_in_is_what_a_session_starts(name):
    concrete = central_case(name)
    shipped = etree.parse(TREE / "routes" / f"{name}.rou.xml").getroot()
    started = parse(routes_xml(concrete, concrete.simulation(SimulationSettings()).vehicle))
    assert [dict(element.attrib) for element in shipped] == [
        dict(element.attrib) for element in started
    ]
    with session(concrete, SimulationSettings()):
        pass


# --- against SUMO's own tool ----------------------------------------------------------------------


@pytest.mark.skipif(
    shutil.which("netconvert") is None,
    reason="netconvert comes with the extra `gui` (eclipse-sumo)",
)
def test_netconvert_makes_the_same_network(tmp_path):
    (tmp_path / "n.xml").write_text(
        '<nodes><node id="begin" x="0" y="5.25"/><node id="end" x="6000" y="5.25"/></nodes>'
    )
    (tmp_path / "e.xml").write_text(
        '<edges><edge id="road" from="begin" to="end" numLanes="2" speed="60" width="3.5" '
        'priority="1"/></edges>'
    )
    subprocess.run(
        ["netconvert", "-n", "n.xml", "-e", "e.xml", "-o", "o.xml",
            "--offset.disable-normalization"],
        cwd=tmp_path, check=True, capture_output=True,
    )  # fmt: skip
    theirs, ours = etree.parse(tmp_path / "o.xml").getroot(), parse(network_xml(ROAD))
    for path in ("edge", "edge/lane"):
        assert [dict(e.attrib) for e in ours.findall(path)] == [
            dict(e.attrib) for e in theirs.findall(path)
        ]
    for mine, other in zip(ours.findall("junction"), theirs.findall("junction"), strict=True):
        for name in ("id", "type", "x", "incLanes", "intLanes", "shape"):  # y is a label's place
            assert mine.get(name) == other.get(name)
