"""The reference line of a road: its closed forms, its frame, its polyline in SUMO, and how a file
draws it."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from refusals import refusal
from scipy.special import fresnel
from tables import rows_of

from sumo_eval.cosim.openscenario import opendrive_xml
from sumo_eval.cosim.sumo.sumo_files import network_xml
from sumo_eval.extras.openscenario.network import Lane, MapRoad
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.file import scenario_from
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import (
    Piece,
    arc,
    curvatures,
    drawn_points,
    frame_places,
    map_places,
    tightest,
)

CHAIN = (
    Piece(80.0), Piece(60.0, 0.0, 1 / 250), arc(200.0, 250.0), Piece(90.0, 1 / 250, -1 / 120),
    arc(70.0, -120.0),
    Piece(50.0, -1 / 120, 0.0),
)  # fmt: skip
"""Straight, into a left bend, over into a right one, and straight again."""
RNG = np.random.default_rng(17)


def test_an_arc_is_a_circle():
    # a quarter of a circle of 100 m to the left ends at (100, 100) m, heading north; 2 m inside it,
    # at (98, 100) m
    quarter = (arc(50.0 * math.pi, 100.0),)
    s = 50.0 * math.pi
    assert np.allclose(map_places(quarter, s, 0.0), (100.0, 100.0, math.pi / 2), atol=1e-12)
    assert np.allclose(
        map_places(quarter, s, 2.0, 0.1), (98.0, 100.0, math.pi / 2 + 0.1), atol=1e-12
    )
    right = (arc(50.0 * math.pi, -100.0),)
    assert np.allclose(map_places(right, s, 2.0), (102.0, -100.0, -math.pi / 2), atol=1e-12)


@pytest.mark.parametrize("centre", [3.5, -3.5])
def test_a_length_along_a_lane_holds_round_a_loop(centre):
    # a turn of 6 rad: the road's 240 m are 6 rad * (40 m - centre) along the lane
    loop = MapRoad("loop", Pose(0.0, 0.0, 0.0), (arc(240.0, 40.0),), {})
    lane = Lane(1, "driving", centre, 3.5)
    assert loop.ahead_in_lane(lane, 0.0, 6.0 * (40.0 - centre)) == pytest.approx(240.0)


@pytest.mark.parametrize("length", [30.0, 100.0, 250.0])
def test_a_spiral_is_a_fresnel_integral(length):
    # with curvature c s the place is a (C(s / a), S(s / a)), a = sqrt(pi / c), by the definition of
    # C and S
    rate = (1.0 / 150.0) / length
    s = np.linspace(0.0, length, 41)
    a = math.sqrt(math.pi / rate)
    sine, cosine = fresnel(s / a)
    x, y, heading = map_places((Piece(length, 0.0, 1.0 / 150.0),), s, 0.0)
    assert np.abs(x - a * cosine).max() < 1e-10
    assert np.abs(y - a * sine).max() < 1e-10
    assert np.abs(heading - 0.5 * rate * s * s).max() < 1e-13


def test_law_frame_and_map_are_inverses():
    s, d, heading = (
        RNG.uniform(0.0, 560.0, 2000),
        RNG.uniform(-8.0, 8.0, 2000),
        RNG.uniform(-1.0, 1.0, 2000),
    )
    back = frame_places(CHAIN, *map_places(CHAIN, s, d, heading))
    for found, given in zip(back, (s, d, heading), strict=True):
        assert np.abs(found - given).max() < 1e-9


def test_law_a_line_has_no_gap_no_kink_and_the_length_it_says():
    s = np.linspace(-10.0, 600.0, 61_001)
    x, y, heading = map_places(CHAIN, s, 0.0)
    assert np.abs(np.hypot(np.diff(x), np.diff(y)) - 0.01).max() < 1e-9
    assert np.abs(np.diff(heading)).max() <= 0.01 / 120 + 1e-12
    assert np.abs(np.diff(heading) / 0.01 - curvatures(CHAIN, s[:-1] + 0.005)).max() < 1e-7
    assert tightest(CHAIN) == 120.0
    assert tightest(()) == math.inf


def test_a_straight_road_has_one_pair_of_numbers():
    s, d, heading = (
        RNG.uniform(0.0, 560.0, 50),
        RNG.uniform(-8.0, 8.0, 50),
        RNG.uniform(-1.0, 1.0, 50),
    )
    for there in (map_places((), s, d, heading), frame_places((), s, d, heading)):
        assert [it.tobytes() for it in there] == [s.tobytes(), d.tobytes(), heading.tobytes()]


@pytest.mark.parametrize(
    "piece",
    [(0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (1e9, 0.0, 0.0), (5.0, math.nan, 0.0), (5.0, 0.0, 1e9)],
)
def test_a_piece_that_no_road_can_have_is_refused(piece):
    """One of 1e9 m, or of as many turns, took all memory."""
    with refusal("piece of a road"):
        Piece(*piece)


def test_lanes_in_sumo_have_a_vertex_at_every_metre_of_curve():
    road = Road("chain", 500.0, 3, 3.5, 100.0, line=CHAIN)
    lanes = list(etree.fromstring(network_xml(road).encode()).iter("lane"))
    assert [lane.get("length") for lane in lanes] == ["600.00"] * 3
    for number, lane in enumerate(lanes):
        points = np.array(
            [[float(it) for it in pair.split(",")] for pair in lane.get("shape").split()]
        )
        s, d, _ = frame_places(CHAIN, points[:, 0], points[:, 1])
        assert np.abs(d - 3.5 * number).max() < 1e-4  # four decimals
        bends = np.abs(curvatures(CHAIN, 0.5 * (s[1:] + s[:-1]))) > 0.0
        assert np.diff(s)[bends].max() < 1.0 + 1e-3
        assert len(points) < 480  # straights have two
    assert drawn_points(CHAIN, 0.0, 600.0)[[0, 1, -1]].tolist() == [0.0, 80.0, 600.0]


def test_a_bent_road_as_opendrive_has_its_pieces():
    root = etree.fromstring(opendrive_xml(Road("chain", 500.0, 2, 3.5, 100.0, line=CHAIN)).encode())
    kinds = [geometry[0].tag for geometry in root.iter("geometry")]
    assert kinds == ["line", "spiral", "arc", "spiral", "arc", "spiral", "line"]
    for geometry, s in zip(
        root.iter("geometry"), np.cumsum([0.0, *(piece.length for piece in CHAIN)]), strict=True
    ):
        x, y, heading = map_places(CHAIN, s, 0.0)
        found = [float(geometry.get(key, "")) for key in ("s", "x", "y", "hdg")]
        assert np.allclose(found, (s, x, y, heading), atol=1e-6)


# -- in a scenario file ----------------------------------------------------------------------------


def scenario(**road):
    return {
        **tomllib.loads("""
name = "bent"
parameter = [{ name = "ego_speed", unit = "m/s", low = 10.0, high = 20.0, step = 5.0 }]
option = [{ name = "radius", unit = "m", default = 300.0 }, { name = "bend", unit = "m" }]
ego = { speed = "ego_speed" }
vehicle = [{ name = "lead", speed = 5.0, gap = 40.0 }]
zone = { obstacle = "lead" }
"""),
        "road": {"length": 800.0, **road},
    }


def read(**road):
    return scenario_from(scenario(**road), "the file", Path()).road


def test_a_file_draws_a_road_piece_by_piece():
    road = read(line=[
        {"length": 100.0}, {"length": 50.0, "end_radius": "radius"},
        {"length": 200.0, "radius": "radius"},
        {"length": 40.0, "begin_radius": 300.0, "end_radius": -200.0},
    ])  # fmt: skip
    assert road.line == (
        Piece(100.0), Piece(50.0, 0.0, 1 / 300), Piece(200.0, 1 / 300, 1 / 300),
        Piece(40.0, 1 / 300, -1 / 200),
    )  # fmt: skip
    assert road.name.startswith("road_2x3.5m_600m_of_800m_right_200m_")
    assert read(name="hill", line=[{"length": 90.0, "radius": "radius"}]).name == "hill_left_300m"


def test_a_line_without_curves_is_a_straight_road():
    assert read(line=[{"length": 100.0}, {"length": 50.0, "radius": "bend"}]) == read()


@pytest.mark.parametrize(
    "line, sentence",
    rows_of(
        r"""
[{"length": 100.0, "radius": "radios"}] | `radios`.*Did you mean `radius`\?
[{"length": 100.0, "radius": "ego_speed"}] | `radius` in the file must be in m, got `ego_speed`
[{"length": 100.0, "radious": 100.0}] | line\[0\]\.radious` in the file\. Did you mean `radius`\?
[{"length": 100.0, "radius": 0.0}] | must be a number other than 0 m
[{"length": 100.0, "radius": 300.0, "end_radius": 100.0}] | either `radius` or `begin_radius`
[{"length": 100.0}, {"length": 20.0, "radius": 6.0}]
| piece 2 .*so that the ego can drive its innermost
[{"length": 801.0, "radius": 300.0}] | at most as long as the road \(800 m\), got 801
[{"length": -1.0}] | length
""",
        json.loads,
    ),
)
def test_a_road_that_cannot_be_driven_is_refused(line, sentence):
    with refusal(sentence):
        read(line=line)


def test_a_network_of_the_users_has_its_line_already():
    with refusal(r"`road\.line` of the file must not stand beside `network`: it shapes a road"):
        read(network="town.net.xml", edges=["a"], line=[{"length": 9.0}])
