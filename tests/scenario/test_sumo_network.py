"""A straight road in a network of the user's, wherever it lies and whichever way it goes."""

import cmath
import contextlib
import itertools
import json
import math
import random
import re
from dataclasses import replace

import numpy as np
import pytest
from laid import replace_in
from lxml import etree
from refusals import refusal, refused
from road_scenes import assert_ended, assert_last, at_values, clear_drive
from tables import rows_of, values_of

from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.sumo.session import session
from sumo_eval.cosim.sumo.sumo_files import network_xml, routes_xml
from sumo_eval.errors import InputError
from sumo_eval.record.run_folder import create
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start, brake_to_stop
from sumo_eval.scenario import played as played_kinds
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.first_places import STANDARD_EGO, misplaced
from sumo_eval.scenario.played import Act
from sumo_eval.scenario.road.fitted_line import fitted_line
from sumo_eval.scenario.road.lanes import LaneSpan
from sumo_eval.scenario.road.reference_line import Piece, arc, curvatures, map_places
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.scenario.sumo_network import laid_along_x, read_road
from sumo_eval.settings import (
    AdsSettings,
    EvaluationSettings,
    ScenarioSettings,
    SimulationSettings,
    VehicleSettings,
)

PLAIN = Road("plain", 900.0, 2, 3.5, 100.0)


def turned(path, *, bend=0.0, road=PLAIN):
    """The package's own straight network, turned and moved, with the two decimals that netconvert
    writes."""
    root = etree.fromstring(network_xml(road).encode())

    def move(text):
        points = []
        for part in text.split():
            x, y = map(float, part.split(","))
            y += bend * x * (1000.0 - x) / 250_000.0
            place = complex(x, y) * cmath.rect(1.0, 0.7) + 1234.5 - 987.0j
            points.append(f"{round(place.real, 2)},{round(place.imag, 2)}")
        return " ".join(points)

    for element in root.iter():
        if element.tag == "junction":  # as netconvert marks one whose shape a user drew
            element.set("customShape", "1")
        if element.get("shape"):
            text = element.get("shape")
            if element.tag == "lane" and bend:
                begin, end = text.split()
                text = f"{begin} 500.0,{begin.split(',')[1]} {end}"
            element.set("shape", move(text))
    side = (
        '<edge id="side_road" from="end" to="begin" priority="1">'
        '<lane id="side_road_0" index="0" speed="13.9" length="20" shape="0,0 20,0"/></edge>'
    )
    root.append(etree.fromstring(side))
    path.write_bytes(etree.tostring(root))
    return path


def town_road(path):
    return read_road(path, ["road"], 600.0)


def own_road(path):
    return read_road(path, ["m"], 280.0)


@pytest.fixture
def network(tmp_path):
    return turned(tmp_path / "town.net.xml")


def test_the_road_lies_along_x_with_its_own_lanes(network):
    road = town_road(network)
    assert road.lanes == 2
    assert road.lane_width == 3.5
    assert road.length == 600.0
    assert road.run_out == pytest.approx(400.0, abs=0.02)
    root = etree.fromstring(laid_along_x(road.network).encode())
    shapes = {lane.get("id"): lane.get("shape") for lane in root.iter("lane")}
    for lane, y in (("road_0", 0.0), ("road_1", 3.5)):
        (x0, y0), (x1, y1) = (tuple(map(float, part.split(","))) for part in shapes[lane].split())
        assert y0 == y
        assert y1 == y
        assert x0 == pytest.approx(0.0, abs=1e-4)
        assert x1 == pytest.approx(road.end, abs=1e-4)
    # everything else went along: the side road began at the old origin
    assert float(shapes["side_road_0"].split()[0].split(",")[0]) == pytest.approx(
        -(1234.5 * math.cos(0.7) - 987.0 * math.sin(0.7)), abs=0.05
    )


def test_a_case_on_a_turned_network_is_the_same_case(network):
    concrete = at_values("front_vehicle_cut_out", ego_speed=25.0, obstacle_speed=5.0, gap=60.0)
    there = replace(concrete, road=town_road(network))
    ours, theirs = simulate(concrete, "careful_driver"), simulate(there, "careful_driver")
    assert theirs.error is None
    assert theirs.end_reason == ours.end_reason
    assert_last(theirs, 0.05, x=ours.ego.x[-1])
    assert simulate(there, "lane_changer").error is None


def test_a_scenario_file_names_a_network_of_its_folder(tmp_path, network):
    before, _, rest = scenario_files()["front_vehicle_low_speed"].read_text().partition("[road]")
    (tmp_path / "mine.toml").write_text(
        before
        + '[road]\nnetwork = "town.net.xml"\nedges = ["road"]\n'
        + rest[rest.index("[end]") :]
    )
    concrete = read_scenario(tmp_path / "mine.toml").concrete(ego_speed=20.0, lead_speed=5.0)
    assert concrete.road.name.startswith("town_")
    assert 'edges="road"' in routes_xml(concrete, VehicleSettings())
    assert simulate(concrete, "no_reaction").end_reason == "contact"


@pytest.mark.parametrize(
    "edges, end, sentence",
    rows_of(
        """
[] | 600.0 | must name the `edges`
["raod"] | 600.0 | Did you mean `road`?
["road", "road"] | 600.0 | Edge `road` of network town.net.xml must lead to edge `road`
["road", "side_road"] | 600.0 | must have one width
["road"] | 1200.0 | within the 1000.0 m of its edges
""",
        json.loads,
        float,
    ),
)
def test_a_road_that_is_not_there_is_refused(network, edges, end, sentence):
    with refused(sentence):
        read_road(network, edges, end)


SIDEWALK = """<net version="1.20">
<location netOffset="0.00,0.00" convBoundary="0.00,0.00,286.40,0.00" origBoundary="0,0,1,1" projParameter="!"/>
<edge id="m" from="a" to="b" priority="-1">
{lanes}
</edge>
<junction id="a" type="dead_end" x="0.00" y="0.00" incLanes="" intLanes="" shape="0.00,0.00 0.00,-9.90"/>
<junction id="b" type="dead_end" x="286.40" y="0.00" incLanes="{ids}" intLanes="" shape="286.40,-9.90 286.40,0.00"/>
</net>
"""  # as netconvert writes it
LANE = (
    '<lane id="m_{0}" index="{0}" {1} speed="30.00" length="286.40" width="{2}" shape="0.00,{3} '
    '286.40,{3}"/>'
)


def edge_of(folder, *lanes, name="own"):
    """An edge of 286.4 m of lanes: (permissions, width, m)."""
    path, y, rows = folder / f"{name}.net.xml", -9.9, []
    for k, (permissions, width) in enumerate(lanes):
        rows.append(LANE.format(k, permissions, width, f"{y + width / 2:.2f}"))
        y += width
    ids = " ".join(f"m_{k}" for k in range(len(lanes)))
    path.write_text(SIDEWALK.format(lanes="\n".join(rows), ids=ids))
    return path


CAR = ('disallow="pedestrian bicycle"', 3.2)
NO_CARS = ['allow="pedestrian"', 'allow="bicycle pedestrian"', 'disallow="all"',
    'disallow="bicycle passenger"',
           'allow=""']  # fmt: skip


@pytest.mark.parametrize("permissions", NO_CARS)
def test_a_lane_without_cars_is_not_a_lane_of_the_road(tmp_path, permissions):
    road = own_road(edge_of(tmp_path, (permissions, 2.0), CAR, ("", 3.2), (permissions, 1.5)))
    plain = own_road(edge_of(tmp_path, CAR, CAR, name="bare"))
    assert road.lanes == 2
    assert road.lane_width == 3.2
    assert road.run_out == pytest.approx(6.4)
    with refusal("must have a lane on which a car may drive"):
        own_road(edge_of(tmp_path, (permissions, 2.0), name="none"))
    if permissions != NO_CARS[0]:
        return
    drives = [simulate(replace(LED, road=one), "idm") for one in (road, plain)]
    assert drives[0].error is None
    assert drives[0].simulated_time == drives[1].simulated_time
    np.testing.assert_allclose(drives[0].ego.x, drives[1].ego.x, atol=1e-9)
    np.testing.assert_allclose(drives[0].actors["lead"].y, 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(60))
def test_any_permissions_of_lanes_make_a_road_or_a_sentence(tmp_path, seed):
    """A fuzz of the permissions and widths of lanes."""
    draw = random.Random(seed)
    classes = [
        None,
        "",
        "all",
        "passenger",
        "pedestrian",
        "bus taxi",
        "passenger bus",
        "ignored",
        "é",
    ]
    lanes = []
    for _ in range(draw.randint(1, 4)):
        told = {name: draw.choice(classes) for name in ("allow", "disallow")}
        lanes.append(
            (
                " ".join(f'{k}="{v}"' for k, v in told.items() if v is not None),
                draw.choice([3.2, 3.2, 2.0]),
            )
        )
    path = edge_of(tmp_path, *lanes)
    with contextlib.suppress(InputError):
        assert 1 <= own_road(path).lanes <= len(lanes)


@pytest.mark.parametrize(
    "index", ["nan", "1e308", "-1", "", "9" * 5_000], ids=lambda index: index[:9]
)
def test_a_lane_index_must_be_a_small_number(tmp_path, index):
    path = edge_of(tmp_path, CAR, CAR)
    replace_in(path, 'index="1"', f'index="{index}"')
    with refusal("The index of lane 'm_1' must be a whole number of at most 3 digits, got"):
        own_road(path)


@pytest.mark.parametrize("text", ["wide", "nan"])
def test_lengths_of_a_network_must_be_numbers(tmp_path, network, text):
    replace_in(network, ' x="0.00"', f' x="{text}"')
    with refusal("x of a junction of the network must be a finite number"):
        laid_along_x(town_road(network).network)
    path = edge_of(tmp_path, CAR, CAR)
    for old, new in (('width="3.2"', f'width="{text}"'), (' shape="0', f' shape="{text}')):
        replace_in(path, old, new, 1)
        with refusal("of the network must be a finite number"):
            own_road(path)
        replace_in(path, new, old)


def test_left_hand_traffic_is_refused(network):
    replace_in(network, "<net ", '<net lefthand="true" ', 1)
    with refusal("`lefthand` of network .* must be false: left-hand traffic is not supported"):
        town_road(network)


def test_lanes_of_different_widths_are_listed(tmp_path):
    path = edge_of(tmp_path, ('allow="pedestrian"', 2.0), ("", 3.2), ("", 3.5))
    with refusal(r"must have one width, got m_1 3\.2 m, m_2 3\.5 m"):
        own_road(path)


LED = ConcreteScenario(
    "led", {}, 1.0, PLAIN, Start(210.0, 0.0, 10.0), (Actor("lead", Start(240.0, 0.0, 4.0)),)
)


JOINED = """<net version="1.20"><edge id=":b_0" function="internal">
<lane id=":b_0_0" index="0" speed="9" length="{way}" shape="286.4,0 {begin},0"/></edge>
<edge id="m" from="a" to="b"><lane id="m_0" index="0" speed="30" length="9" shape="0,0 286.4,0"/></edge>
<edge id="n" from="b" to="c"><lane id="n_0" index="0" speed="30" length="9" shape="{begin},0 986,0"/></edge>
<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,9"/>
<junction id="b" type="priority" x="290" y="0" incLanes="m_0" intLanes=":b_0_0" shape="0,0 0,9">
<request index="0" response="0" foes="0" cont="0"/></junction>
<junction id="c" type="dead_end" x="986" y="0" incLanes="n_0" intLanes="" shape="0,0 0,9"/>
<connection from="m" to="n" fromLane="0" toLane="0" via=":b_0_0" dir="s" state="M"/>
<connection from=":b_0" to="n" fromLane="0" toLane="0" dir="s" state="M"/></net>"""


WITHIN = r'<edge id=":b(.|\n)*?</edge>|<connection from=":b.*?/>|(via=)?":b_0_0"'


@pytest.mark.parametrize("begin, way", [(286.4, 0.1), (297.61, 11.2), (297.61, None)])
def test_law_no_joint_of_edges_holds_an_ego_up(tmp_path, begin, way):
    path, text = tmp_path / "two.net.xml", JOINED.format(begin=begin, way=way)
    path.write_text(text if way else re.sub(WITHIN, "", text).replace("intLanes= ", ""))
    there = replace(LED, road=read_road(path, ["m", "n"], 400.0), actors=())
    for driver in ("no_reaction", "sumo:IDM", lambda traci, ego, time: None):
        found = simulate(there, driver)
        assert_ended(found, "road_end")
        assert found.clips == ()
        assert found.ego.speed.min() > 9.99


def test_a_vehicle_at_the_end_of_the_network_leaves_it(tmp_path):
    """Its front, 2.25 m before its centre, is 0.1 m before the end, where SUMO takes vehicles out,
    after
    (286.4 - 0.1 - 242.25) / 4 = 11.0 s: whatever drives the ego, the case goes on to its end, and
    says it.
    """
    road = own_road(edge_of(tmp_path, CAR, CAR))
    case = replace(LED, road=road)
    brakes, played = (
        replace(case, actors=(replace(LED.actors[0], acts=(act,)),))
        for act in (
            brake_to_stop(5.0, 0.1),
            Act(played_kinds.SPEED, 2.0, speed=6.0, acceleration=1.0),
        )
    )
    for one, drivers in (
        (case, ("idm", policy, tracied, "sumo:IDM")),
        (brakes, ("idm", tracied)),
        (played, ("idm",)),
    ):
        for driver in drivers:
            found = simulate(one, driver)
            assert_ended(found, "road_end")
            (left,) = [clip for clip in found.clips if clip.what == "actor_left_the_network"]
            if one is case:
                assert left.applied == pytest.approx(11.05, abs=0.051)
            assert found.actors["lead"].x[-1] > 280.0
    together = replace(case, road=replace(PLAIN, length=280.0, run_out=6.4))
    bend = replace(together, road=replace(together.road, name="bend", line=(arc(290.0, 400.0),)))
    for one in (together, bend):
        found = simulate_many(
            [one, replace(one, ego=Start(190.0, 0.0, 10.0))], "idm", SimulationSettings()
        )
        assert [(it.end_reason, it.error) for it in found] == [("road_end", None)] * 2
        assert all("actor_left_the_network" in {clip.what for clip in it.clips} for it in found)


def policy(seen):
    return (
        0.3
        if seen.lead is None
        else min(0.15 * (seen.lead.gap - 8.0) + 0.9 * seen.lead.relative_speed, 0.0)
    )


def tracied(traci, ego, time):
    traci.vehicle.setSpeed(ego, 4.0 if "lead" in traci.vehicle.getIDList() else 10.0)


BENT = Road("bent", 900.0, 3, 3.5, 100.0,
    line=(Piece(100.0), Piece(80.0, 0.0, 1 / 250.0), arc(400.0, 250.0)),
            spans=(LaneSpan(0, end=660.0), LaneSpan(2, begin=420.0)))  # fmt: skip


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """A network of three edges round a bend, turned, moved, and rounded to centimetres."""
    return turned(tmp_path_factory.mktemp("bent") / "hill.net.xml", road=BENT)


def test_law_a_curved_network_is_the_road_along_its_lanes(bent):
    road = read_road(bent, ["road0", "road1", "road2"], 900.0)
    assert road.lanes == 3
    assert road.lane_width == 3.5
    assert road.network is None
    assert road.length + road.run_out == pytest.approx(1000.0, abs=0.1)
    right, left = road.spans
    assert right.lane == 0
    assert right.end == pytest.approx(660.0, abs=0.2)
    assert left.lane == 2
    assert left.begin == pytest.approx(420.0, abs=0.2)
    s = np.arange(0.0, 1000.0, 5.0)
    x, y, heading = map_places(road.line, s, 0.0)
    wanted_x, wanted_y, wanted_heading = map_places(BENT.line, s, 0.0)
    assert np.hypot(x - wanted_x, y - wanted_y).max() < 0.1
    assert np.abs(heading - wanted_heading).max() < 0.006
    assert 1.0 / curvatures(road.line, 400.0) == pytest.approx(250.0, rel=0.02)


@pytest.mark.parametrize("laps", [1, 2])
def test_laps_of_a_ring_are_as_long_as_they_are_many(tmp_path, laps):
    net = etree.Element("net")
    for k, name in enumerate("ab"):
        angle = math.pi * (k + np.linspace(0.0, 1.0, 33))
        shape = " ".join(f"{100.0 * math.cos(w):.3f},{100.0 * math.sin(w):.3f}" for w in angle)
        ends = {"id": name, "from": str(k), "to": str(1 - k)}
        lane = {"id": f"{name}_0", "index": "0", "width": "3.5", "shape": shape}
        etree.SubElement(etree.SubElement(net, "edge", ends), "lane", lane)
        etree.SubElement(net, "connection", {"from": name, "to": "ba"[k]})
    path = tmp_path / "ring.net.xml"
    path.write_bytes(etree.tostring(net))
    road = read_road(path, ["a", "b"] * laps, 200.0)
    assert road.length + road.run_out == pytest.approx(laps * 200.0 * math.pi, rel=2e-3)


def test_junction_without_right_of_way_is_refused(tmp_path):
    """SUMO ends with a segmentation fault where a vehicle comes to one, whatever its type but
    `unregulated`."""
    root = etree.fromstring(network_xml(BENT).encode())
    before, behind = (root.find(f".//edge[@id='{name}']") for name in ("road0", "road1"))
    junction = root.find(f"junction[@id='{behind.get('from')}']")
    junction.set("type", "priority")
    junction.set("incLanes", " ".join(lane.get("id") for lane in before.iter("lane")))
    for request in junction.findall("request"):
        junction.remove(request)
    path = tmp_path / "hill.net.xml"
    path.write_bytes(etree.tostring(root))
    sentence = (
        "must have a <request> for each of its connections.*or be of type `unregulated`: it has "
        "none"
    )
    with refusal(sentence):
        read_road(path, ["road0", "road1"], 500.0)
    junction.set("type", "unregulated")
    path.write_bytes(etree.tostring(root))
    assert read_road(path, ["road0", "road1"], 500.0).lanes == 3


def test_curved_edges_are_driven_in_their_order(bent):
    missing = "Edge `road0` of network hill.net.xml must lead to edge `road2`: no lane of it does."
    with refusal(missing):
        read_road(bent, ["road0", "road2"], 1200.0)
    with refusal("of its edges, got 1200"):
        read_road(bent, ["road0", "road1", "road2"], 1200.0)


U_TURN = """<net><edge id="out" from="a" to="b"><lane id="out_0" index="0" speed="30" length="200"
shape="0,0 200,0"/></edge><edge id="back" from="b" to="c"><lane id="back_0" index="0" speed="30"
length="120" shape="200,3.2 80,3.2"/></edge><junction id="a" type="dead_end" x="0" y="0" incLanes=""
intLanes=""/><junction id="b" type="unregulated" x="200" y="0" incLanes="out_0" intLanes=""/><junction
id="c" type="dead_end" x="80" y="3.2" incLanes="back_0" intLanes=""/><connection from="out" to="back"
fromLane="0" toLane="0" dir="t" state="M"/></net>"""


def test_an_edge_back_beside_the_first_is_no_lane_of_a_straight_road(tmp_path):
    """It was the left lane of a straight road of 80 m."""
    (tmp_path / "u.net.xml").write_text(U_TURN)
    with refusal("The radius of the road along out, back of network u.net.xml must be at least"):
        read_road(tmp_path / "u.net.xml", ["out", "back"], 60.0)


@pytest.mark.campaign
def test_corner_that_no_car_can_drive_is_refused(tmp_path):
    corner = turned(tmp_path / "corner.net.xml", bend=800.0)
    with refusal(r"must be at least 7.5 m, so that the ego can drive its innermost"):
        town_road(corner)


def test_traffic_reacts_on_a_straight_network_too(network, tmp_path):
    (tmp_path / "chased.toml").write_text(
        'name = "chased"\nzone = "none"\n'
        'parameter = [{ name = "v", unit = "m/s", low = 20.0, high = 30.0, step = 5.0 }]\n'
        'road = { network = "town.net.xml", edges = ["road"] }\nego = { speed = "v", x = 120.0 }\n'
        'end = { x = 600.0, time = 6.0 }\n[[vehicle]]\nname = "rear"\nspeed = 30.0\ngap_behind = '
        "40.0\n"
        'manoeuvre = [{ do = "follow", model = "IDM" }]\n'
    )
    chased = clear_drive(read_scenario(tmp_path / "chased.toml").concrete(v=20.0), "no_reaction")
    assert chased.actors["rear"].speed.min() < 25.0


def test_traffic_reacts_on_a_curved_network(bent, tmp_path):
    (tmp_path / "hill.toml").write_text(
        'name = "hill"\nzone = "none"\n'
        'parameter = [{ name = "v", unit = "m/s", low = 20.0, high = 30.0, step = 5.0 }]\n'
        f'road = {{ network = "{bent}", edges = ["road0", "road1", "road2"] }}\n'
        'ego = { speed = "v", y = 3.5 }\nend = { x = 600.0 }\n'
        '[[stream]]\nname = "queue"\nlane = 1\nbegin = 30.0\nend = 160.0\ndensity = 20.0\nspeed = '
        "12.0\n"
    )
    logical = read_scenario(tmp_path / "hill.toml")
    together = list(simulate_many([logical.concrete(v=v) for v in (20.0, 30.0)], "idm"))
    assert [(it.error, it.collision) for it in together] == [(None, None)] * 2
    assert np.abs(together[1].ego.y - 3.5).max() < 0.3
    assert together[1].ego.speed.min() < 15.0


def test_edges_of_one_network_are_roads_with_files_of_their_own(tmp_path):
    edge = (
        "<edge id='{0}' from='{0}1' to='{0}2' function='normal'>"
        "<lane id='{0}_0' index='0' length='500' shape='0,{1} 500,{1}' width='3.5'/></edge>"
    )
    path = tmp_path / "n.net.xml"
    path.write_text(f"<net>{edge.format('a', 0)}{edge.format('b', 50)}</net>")
    plain = at_values("front_vehicle_low_speed", ego_speed=20.0, lead_speed=10.0)
    examples = [
        replace(plain, scenario=f"../../{name}", road=read_road(path, [name], 300.0))
        for name in ("a", "b")
    ]
    settings = EvaluationSettings("e", (ScenarioSettings("a"),), (AdsSettings("idm", "idm"),))
    create(tmp_path / "run", settings, tmp_path, examples, another_round=False)
    for concrete in examples:
        stem = concrete.scenario.replace("/", "_")  # a name leads to no other folder
        text = (tmp_path / "run" / "routes" / f"{stem}.sumocfg").read_text()
        file = tmp_path / "run" / "networks" / re.search(r"[\w.]+\.net\.xml", text)[0]
        assert file.read_text() == network_xml(concrete.road)


def test_a_network_that_changed_after_reading_is_refused(network):
    road = town_road(network)
    replace_in(network, "side_road", "other_road")
    with refusal("has changed since"):
        laid_along_x(road.network)


def test_a_file_that_is_not_a_network_is_refused(tmp_path):
    (tmp_path / "x.net.xml").write_text("<routes/>")
    with refusal("must be `net`"):
        town_road(tmp_path / "x.net.xml")
    (tmp_path / "x.net.xml").write_text("<net>")
    with refusal("is not XML"):
        town_road(tmp_path / "x.net.xml")


SHAPED = replace(
    PLAIN, lanes=3, spans=(LaneSpan(0, end=660.0, parted_until=420.0), LaneSpan(2, begin=500.0))
)


def test_the_outermost_lanes_of_a_network_begin_and_end_where_its_edges_meet(tmp_path):
    path = turned(tmp_path / "town.net.xml", road=SHAPED)
    names = ["road0", "road1", "road2", "road3"]
    road = read_road(path, names, 900.0)
    assert road.lanes == 3
    assert road.lane_width == 3.5
    assert [(span.lane, span.closing, span.opening) for span in road.spans] == [
        (0, 0.0, 0.0),
        (2, 0.0, 0.0),
    ]
    right, left = road.spans
    ends = right.begin, right.end, left.begin, left.end
    assert ends == pytest.approx((420.0, 660.0, 500.0, math.inf), abs=0.02)
    assert road.right_edge_at([400.0, 430.0, 670.0]).tolist() == [1.75, -1.75, 1.75]
    assert road.left_edge_at([400.0, 510.0]).tolist() == [5.25, 8.75]
    shapes = {
        lane.get("id"): lane.get("shape")
        for lane in etree.fromstring(laid_along_x(road.network).encode()).iter("lane")
    }
    assert {float(part.split(",")[1]) for part in shapes["road0_0"].split()} == {3.5}
    assert {float(part.split(",")[1]) for part in shapes["road2_0"].split()} == {0.0}
    odd, missing = ["road1", "road3", "road2"], "must lead to edge `road3`: no lane of it does"
    with refusal(missing):
        read_road(path, odd, 300.0)
    joined = "".join(
        f'<connection from="{one}" to="{other}" fromLane="0" toLane="0"/>'
        for one, other in itertools.pairwise(odd)
    )
    replace_in(path, "</net>", f"{joined}</net>")
    with refusal("must have the outermost lane that edges before and behind it have"):
        read_road(path, odd, 300.0)


@pytest.mark.parametrize(
    "ahead, lane",
    values_of("""
    0.0, "road0_0"
    430.0, "road1_1"
    560.0, "road2_1"
    700.0, "road3_0"
    """),
)
def test_a_vehicle_starts_in_the_lane_of_its_edge_where_the_right_hand_one_is_not_yet(
    tmp_path, ahead, lane
):
    (tmp_path / "town.net.xml").write_text(network_xml(SHAPED))
    road = read_road(tmp_path / "town.net.xml", ["road0", "road1", "road2", "road3"], 900.0)
    concrete = at_values("front_vehicle_low_speed", ego_speed=20.0, lead_speed=10.0)

    def moved(start):
        return replace(start, x=start.x + ahead, y=3.5)

    actors = tuple(replace(it, start=moved(it.start)) for it in concrete.actors)
    lifted = replace(concrete, road=road, ego=moved(concrete.ego), actors=actors)
    with session(lifted, SimulationSettings()) as traci:  # which checks where everybody stands
        assert traci.vehicle.getLaneID("ego") == lane
    in_a_junction = replace(road.network, sections=((0.0, 10.0, 0), (lifted.ego.x + 5.0, 900.0, 0)))
    faults = misplaced(
        replace(road, network=in_a_junction), lifted.ego, STANDARD_EGO, lifted.actors
    )
    assert [it.name for it in faults if "is a junction" in it.must] == ["ego"]


def test_a_fit_without_a_possible_line_does_not_end_the_search():
    """A turn within 1 m: with knots further apart the curvatures become impossible."""
    there_and_back = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]])
    assert fitted_line(there_and_back).off <= 0.25
