"""Roads whose lanes open, end, are ramps or are crossed: where they are, what is refused, what SUMO
is given."""

import sys
import tomllib
from pathlib import Path
from string import Template

import numpy as np
import pytest
from commands import program
from lxml import etree
from refusals import refused
from road_scenes import central_case, scenario_of
from tables import rows_of

from sumo_eval.cosim.sumo.sections import road_edges, vehicle_edges
from sumo_eval.cosim.sumo.sumo_files import network_xml, routes_xml
from sumo_eval.method.compared_drives import slice_points
from sumo_eval.report.page_data import drawn_shape
from sumo_eval.scenario import catalogue
from sumo_eval.settings import VehicleSettings

SHAPED = [name for name in catalogue.SCENARIOS if catalogue.load(name).road.shaped]
RAMP = "lane = [{ lane = 0, end = 300.0, taper = 50.0, ramp_until = 120.0 }]"
BASE = tomllib.loads(f"""
name = "t"
parameter = [{{ name = "v", low = 10.0, high = 30.0, step = 10.0, unit = "m/s" }}]
ego = {{ speed = "v" }}
zone = "none"
vehicle = [{{ name = "other", speed = 20.0, x = 20.0, y = 7.0 }}]
road = {{ lanes = 3, length = 900.0, {RAMP} }}
""")


def read(changes=""):
    return scenario_of(BASE | tomllib.loads(changes))


def test_the_edge_moves_in_a_straight_line_over_the_taper():
    road = read().road
    # lane 0 (y -1.75..1.75) is whole until 300 m and gone at 350 m; at 325 m half of its 3.5 m are
    # left
    assert road.right_edge_at([0.0, 300.0, 325.0, 350.0, 800.0]).tolist() == [
        -1.75,
        -1.75,
        0.0,
        1.75,
        1.75,
    ]
    assert road.left_edge_at([0.0, 325.0]).tolist() == [8.75, 8.75]
    assert road.lanes_at(100.0) == (0, 1, 2)
    assert road.lanes_at(310.0) == (1, 2)
    lane = "{ lane = 1, begin = 200.0, taper = 40.0 }"
    opens = read(f"road = {{ lanes = 2, length = 900.0, lane = [{lane}] }}").road
    assert opens.left_edge_at([100.0, 160.0, 190.0, 200.0]).tolist() == [
        1.75,
        1.75,
        1.75 + 3.5 * 0.75,
        5.25,
    ]


def test_the_seven_points_of_d_stay_on_the_road_where_a_lane_has_ended():
    points = slice_points(np.array([200.0, 400.0]), np.array([3.5, 2.0]), read().road)
    assert points[0, :, 1].tolist() == [2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0]
    # behind the lane's end the road begins at y = 1.75: the three points to the right share 0.25 m
    assert points[1, :4, 1] == pytest.approx([1.75, 1.75 + 0.25 / 3, 1.75 + 0.5 / 3, 2.0])


def test_sections_and_ramps_are_edges():
    road = read().road
    net = etree.fromstring(network_xml(road).encode())
    lanes = {str(lane.get("id")): str(lane.get("shape")) for lane in net.iter("lane")}
    assert road_edges(road) == ("road0", "road1", "road2")
    assert lanes["ramp0_0"] == "0.00,0.00 120.00,0.00"
    assert lanes["road0_0"] == "0.00,3.50 120.00,3.50"
    assert lanes["road1_0"] == "120.00,0.00 300.00,0.00"
    assert lanes["road2_0"] == "300.00,3.50 900.00,3.50"
    links = {
        (it.get("from"), it.get("fromLane"), it.get("to"), it.get("toLane"))
        for it in net.iter("connection")
    }
    assert ("ramp0", "0", "road1", "0") in links
    assert ("road1", "1", "road2", "0") in links
    # it ends: who is there has to merge
    assert not any(one == "road1" and lane == "0" for one, lane, _, _ in links)
    assert vehicle_edges(road, 0.0, 3.5) == ("ramp0", "road1", "road2")
    assert vehicle_edges(road, 3.5) == ("road0", "road1", "road2")
    # one that starts on an exit ramp and then moves to the left
    ramp = catalogue.load("exit").road
    assert vehicle_edges(ramp, 0.0, 3.5, first=2) == ("road0", "road1", "ramp2")


def test_lanes_that_open_and_end_follow_a_curve():
    line = "line = [{ length = 800.0, radius = 250.0 }]"
    road = read(f"road = {{ lanes = 3, length = 900.0, {RAMP}, {line} }}").road
    net = etree.fromstring(network_xml(road).encode())
    lanes = {
        str(it.get("id")): np.array([p.split(",") for p in str(it.get("shape")).split()], float)
        for it in net.iter("lane")
    }
    for lane, d in (("ramp0_0", 0.0), ("road0_0", 3.5), ("road1_2", 7.0)):
        assert (
            np.abs(np.hypot(lanes[lane][:, 0], lanes[lane][:, 1] - 250.0) - (250.0 - d)).max()
            < 1e-4
        )
    assert lanes["ramp0_0"][-1].tolist() == lanes["road1_0"][0].tolist()
    assert lanes["road1_1"][-1].tolist() == lanes["road2_0"][0].tolist()
    lengths = {str(it.get("id")): float(str(it.get("length"))) for it in net.iter("lane")}
    assert lengths["ramp0_0"] == 120.0
    assert lengths["road1_2"] == 180.0
    assert lengths["road2_0"] == 600.0


@pytest.mark.parametrize("name", SHAPED)
def test_sumo_opens_the_network_of_a_shipped_scenario_and_drives_its_routes(name, tmp_path):
    concrete = central_case(name)
    (tmp_path / "n.xml").write_text(network_xml(concrete.road))
    (tmp_path / "r.xml").write_text(routes_xml(concrete, VehicleSettings()))
    sumo = Path(sys.executable).with_name("sumo")
    if not sumo.exists():
        pytest.skip("SUMO's program is not beside this Python")
    words = "-n", "n.xml", "-r", "r.xml", "--end", "3", "--no-step-log"
    done = program(sumo, *words, "--duration-log.disable", "true", cwd=tmp_path)
    assert done.stderr == ""


def test_pages_draw_what_is_not_there_the_lines_of_ramps_and_the_roads_that_cross():
    crossing = "crossing = [{ x = 500.0 }]"
    road = read(f"road = {{ lanes = 3, length = 900.0, {RAMP}, {crossing} }}").road
    assert drawn_shape(road) == tomllib.loads("""
gone = [[[900.0, -1.75], [900.0, 1.75], [350.0, 1.75], [300.0, -1.75]]]
solid = [[0.0, 120.0, 1.75]]
crossings = [[500.0, 7.0, 100.0]]
""")


@pytest.mark.parametrize(
    "ego, begin, by, ends",
    rows_of(
        """
goal_lane = 1, change_from = 150.0 | 150.0 | 300.0 | 1
goal_lane = 1, change_from = 150.0, change_by = 250.0 | 150.0 | 250.0 | 1
y = 3.5, goal_lane = 2, change_from = 150.0, change_by = 250.0 | 150.0 | 250.0 | 0
""",
        str,
        float,
        float,
        int,
    ),
)
def test_a_goal_lane_is_a_way_that_ends_where_the_first_lane_does(ego, begin, by, ends):
    start = read(f'ego = {{ speed = "v", {ego} }}').concrete(v=20.0).ego
    way = start.way
    assert way.offset == 3.5
    assert way.begin == begin
    assert way.by == by
    assert way.ends == ends
    assert way.length(20.0) == 80.0  # 4 s
    assert way.length(200.0) == by - begin
    assert start.y_at([begin, begin + 40.0, begin + 80.0]).tolist() == [
        start.y,
        start.y + 1.75,
        start.y + 3.5,
    ]


@pytest.mark.parametrize(
    "changes, sentence",
    rows_of(
        Template("""
$road, lane = [{ lane = 1, end = 300.0, taper = 50.0, ramp_until = 120.0 }] }
| must be 0 or 2, of a road of at least 2 lanes
$road, lane = [{ lane = 0 }] } | must have a `begin` or an `end`
$road, lane = [{ lane = 0, end = 890.0, taper = 50.0, ramp_until = 120.0 }] }
| must be in order within 0..900 m
$road, lane = [{ lane = 0, end = 300.0, taper = 50.0, ramp_until = 310.0 }] }
| must be within 0..300 m, where the lane is
$road, lane = [{ lane = 0, end = 300.0, taper = 50.0, ramp_until = 120.0, ramp_from = 310.0 }] }
| has a `ramp_from`, so it must be one that
$road, lane = [{ lane = 0, end = 300.0, taper = 50.0, ramp_until = 120.0, rmp_until = 31.0 }] }
| ramp_until
$road, crossing = [{ x = 2000.0 }] } | must be within the road's 900 m
$road, crossing = [{ x = 898.0 }] } | 3.5 to 896.5 m with its width, got 898.0
$road, lane = [{ lane = 0, begin = 300.0, end = 280.0 }] } | got '250, 300, 280, 330 m'
vehicle = [{ name = "other", speed = 20.0, x = 52.0, y = 0.5 }]
| must be clear of `ego` at the start
$road, line = [{ length = 500.0, radius = 9.0 }] }
| so that the ego can drive its innermost lane
$road, line = [{ length = 30.0, begin_radius = -9.0, end_radius = 10.0 }] }
| must be at least 11.0 m, so that the ego can drive its innermost lane, got 10.0
ego = { speed = "v", change_from = 150.0 } | must have a `goal_lane`
ego = { speed = "v", goal_lane = 1 } | so it must have a `change_from`
ego = { speed = "v", goal_lane = 7, change_from = 150.0 } | must be below 3
ego = { speed = "v", goal_lane = 2, change_from = 150.0 } | must be a lane beside lane 0
ego = { speed = "v", goal_lane = 1, change_from = 100.0 }
| must be within 120..300 m and 20 m apart, where both lanes are
ego = { speed = "v", goal_lane = 1, change_from = 150.0, y = 7.0 }
| must have a `change_by`: neither its lane nor the other one ends
vehicle = [{ name = "other", speed = 20.0, x = 600.0 }] | must be on a lane
$road, lane = [{ lane = 0, end = 300.0 }, { lane = 0, end = 300.0 }] } | must have lane 0 once
$road, crossing = [{ x = 400.0, reach = 280.0 }], line = [{ length = 500.0, radius = 300.0 }] }
| `reach` of [[road.crossing]] of t must be at most 270.0 m, 0.9 of the radius there
road = { network = "a.net.xml", $ramp }
| must not stand beside `network`: it shapes a road that is written
""").substitute(road="road = { lanes = 3, length = 900.0", ramp=RAMP)
    ),
)
def test_a_shape_that_cannot_be_is_refused(changes, sentence):
    from sumo_eval.scenario.file import check_points

    with refused(sentence):
        check_points(read(changes), [[20.0]])


@pytest.mark.parametrize("conflict, notes", [("true", 0), ("false", 1)])
def test_zones_of_an_ego_that_changes_lanes_say_which_path_they_take(conflict, notes):
    logical = read(f"""
zone = {{ obstacle = "other", conflict = {conflict} }}
ego = {{ speed = "v", goal_lane = 1, change_from = 150.0 }}
""")
    assert len(logical.notes) == notes
