"""An exported OpenSCENARIO file imports as its case and drives to the same digest."""

from dataclasses import replace

import numpy as np
import pytest
from laid import replace_in
from lxml import etree
from refusals import refusal

from sumo_eval.cosim import simulate
from sumo_eval.cosim.openscenario import _SEAL, CASE, _seal, opendrive_xml, openscenario_xml
from sumo_eval.extras.openscenario.describe import described
from sumo_eval.extras.openscenario.logical import concrete, read_file
from sumo_eval.extras.openscenario.written import scenario_content
from sumo_eval.extras.wheel.tape import digest
from sumo_eval.scenario.catalogue import SCENARIOS, load
from sumo_eval.scenario.concrete import Actor, Model, Start, brake_to_stop
from sumo_eval.scenario.file import scenario_from
from sumo_eval.scenario.played import AT_MOST, FOLLOW, TIME, VALUE, Act
from sumo_eval.settings import SimulationSettings


def middle(name):
    logical = load(name)
    return logical.concretes([0.5 * (logical.low + logical.high)])[0]


def exported(folder, case):
    """The files of a case."""
    drive = simulate(case, "idm")
    driven = {"ego": drive.ego, **drive.actors}
    (folder / "case.xodr").write_text(opendrive_xml(case.road))
    text = openscenario_xml(case, SimulationSettings(), "case.xodr", "a remark", driven)
    (folder / "case.xosc").write_text(text)
    return folder / "case.xosc"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in ("cut_in", "ramp_merge", "turn_across_path",
        "stop_and_go_stream") else pytest.mark.campaign) for name in SCENARIOS]
)  # fmt: skip
def test_exported_case_drives_to_the_same_digest(tmp_path, name):
    logical = load(name)
    drawn = logical.from_shares(np.random.default_rng(1).random((200, len(logical.names))))
    (case,) = logical.concretes(drawn[logical.feasible(drawn)][:1])
    case = replace(case, changes=(("conditions.perception_delay", 0.2),))
    again = concrete(read_file(exported(tmp_path, case)), {})
    for controller in ("idm", "no_reaction"):
        assert digest(simulate(again, controller)) == digest(simulate(case, controller))


def test_a_road_of_any_name_is_imported(tmp_path):
    case = middle("front_vehicle_braking")
    case = replace(case, road=replace(case.road, name="my road"))
    assert concrete(read_file(exported(tmp_path, case)), {}).road == case.road


def test_exported_case_refuses_another_ego_or_road(tmp_path):
    case = middle("front_vehicle_braking")
    path = exported(tmp_path, case)
    (tmp_path / "case.xodr").rename(tmp_path / "moved.xodr")
    moved = read_file(path, {"map": "moved.xodr", "ego": "ego"})
    assert concrete(moved, {}).actors == case.actors
    with refusal("<Entities>: `.ego=` of an exported case must be `ego`, got `Nobody`; without"):
        read_file(path, {"map": "moved.xodr", "ego": "Nobody"})
    (tmp_path / "other.xodr").write_text(opendrive_xml(middle("curve_braking").road))
    with refusal("an exported file and its road must be unchanged"):
        read_file(path, {"map": "other.xodr"})


def test_a_written_braking_keeps_its_jerk(tmp_path):
    case = middle("front_vehicle_braking")
    lead = replace(case.actors[0], acts=(brake_to_stop(1.0, 5.0, 10.0),))
    read = read_file(exported(tmp_path, replace(case, actors=(lead,))))
    assert scenario_content(read, {})["vehicle"][0]["manoeuvre"][0]["jerk"] == 10.0


@pytest.mark.parametrize(
    "use", ["cut_in", "cut_in?lateral_acceleration=1.5", "front_vehicle_cut_out"]
)
def test_a_written_move_across_is_that_of_the_case(tmp_path, use):
    case = middle(use)
    content = scenario_content(read_file(exported(tmp_path, case)), {})
    again = scenario_from(content, "content", tmp_path).concrete(only=0.0)
    assert digest(simulate(again, "idm")) == digest(simulate(case, "idm"))


def test_an_actor_at_the_roads_end_has_no_trajectory():
    case = middle("front_vehicle_braking")
    for beyond in (-1.0, 1.0):  # m; one place on the road, and none
        start = replace(case.actors[0].start, x=case.road.end + beyond)
        lead = replace(case.actors[0], start=start)
        text = openscenario_xml(replace(case, actors=(lead,)), SimulationSettings(), "", "")
        assert "<Polyline" not in text


def test_exported_actor_that_reacts_is_described(tmp_path):
    case = middle("front_vehicle_braking")
    (lead,) = case.actors
    after_2_s = ((VALUE, 0, 0, 2.0), (TIME, 0, 0, 0.0), (AT_MOST, 0, 0, 0.0))
    reacts = replace(lead, acts=(Act(FOLLOW, program=after_2_s),), model=Model("IDM", 20.0))
    lines = described(read_file(exported(tmp_path, replace(case, actors=(reacts,)))))
    assert [*lines][-1] == "      is driven by SUMO's model 0.000 s after its condition holds"


def test_a_written_curve_has_its_name_once(tmp_path):
    read = read_file(exported(tmp_path, middle("curve_braking")))
    assert scenario_content(read, {})["road"]["name"] == "two_lanes_1400m"


@pytest.mark.parametrize("changes, what", [
    ({"changes": (("conditions.perception_delay", 0.2),)}, "the conditions"),
    ({"ego": Start(50.0, 0.0, 10.0, 0.1)}, "the start of the ego"),
    ({"actors": (Actor("a", Start(90.0, 0.0, 9.0), model=Model("IDM", 9.0)),)}, "actors that SUMO"),
])  # fmt: skip
def test_no_scenario_file_leaves_out_what_an_exported_case_has(tmp_path, changes, what):
    read = read_file(exported(tmp_path, replace(middle("front_vehicle_braking"), **changes)))
    with refusal(f"no words for {what}"):
        scenario_content(read, {})


def test_a_sealed_property_that_holds_no_case_is_refused(tmp_path):
    path = exported(tmp_path, middle("cut_in"))
    tree = etree.parse(path)
    values = {CASE: "5", _SEAL: _seal(tree.getroot(), (tmp_path / "case.xodr").read_bytes(), "5")}
    for name, value in values.items():
        tree.find(f"FileHeader/Properties/Property[@name='{name}']").set("value", value)
    tree.write(path)
    with refusal("its exported case cannot be read"):
        read_file(path)


@pytest.mark.parametrize(
    "old, new", [('trackWidth="', 'trackWidth="1'), (f'"{CASE}" value="', f'"{CASE}" other="')]
)
def test_changed_exported_file_is_refused_until_its_case_is_gone(tmp_path, old, new):
    path = exported(tmp_path, middle("front_vehicle_braking"))
    replace_in(path, old, new, 1)
    with refusal(r"<FileHeader>: an exported file and its road must be"):
        read_file(path)
