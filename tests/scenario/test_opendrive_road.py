"""Roads out of OpenDRIVE files: those of the ALKS and NCAP catalogues, one written here, and what
is refused."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from laid import replace_in
from lxml import etree
from refusals import refusal, refused
from scipy.special import fresnel
from tables import rows_of, values_of

from sumo_eval.cosim.openscenario import opendrive_xml
from sumo_eval.cosim.sumo.sumo_files import network_xml
from sumo_eval.extras.openscenario.network import Lane, MapRoad, read_network
from sumo_eval.scenario import Road
from sumo_eval.scenario.file import scenario_from
from sumo_eval.scenario.road.lanes import Crossing, LaneSpan
from sumo_eval.scenario.road.opendrive import read_opendrive
from sumo_eval.scenario.road.parametric import NEAR, Cubic, pieces_along
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
from tests.scenario.test_openscenario import CATALOGUES, needs_catalogues

ALKS = CATALOGUES / "osc_alks" / "logical_scenarios" / "concrete_scenarios" / "road_networks"
LINE = (Piece(100.0), Piece(60.0, 0.0, 1 / 200), arc(150.0, 200.0), Piece(60.0, 1 / 200, 0.0))
PLAN = """<OpenDRIVE><road id="{id}" length="1"><planView>
<geometry s="0" x="7" y="3" hdg="1.5" length="100"><line/></geometry>
{more}</planView>{profile}<lanes><laneSection s="0"><right>
<lane id="-1" type="border"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>
<lane id="-2" type="driving"><width sOffset="0" a="{width}" b="{b}" c="0" d="0"/></lane>
<lane id="-3" type="driving"><width sOffset="0" a="{a}" b="0" c="0" d="0"/></lane>
</right></laneSection></lanes></road></OpenDRIVE>"""

NEXT = '<geometry s="100" x="{x}" y="102.75" hdg="1.5" length="9"><{shape}/></geometry>'
SLOPE = '<elevationProfile><elevation s="0" a="0" b="0.1" c="0" d="0"/></elevationProfile>'
SURFACE = "<lateralProfile><crossSectionSurface><tOffset/></crossSectionSurface></lateralProfile>"
CAMBER = '<lateralProfile><shape s="0" t="0" a="0" b="0.1" c="0" d="0"/></lateralProfile>'


def written(tmp_path, **parts):
    path = tmp_path / "road.xodr"
    plain = {"id": "0", "more": "", "profile": "", "width": 3.5, "a": 3.5, "b": 0}
    path.write_text(PLAN.format(**plain | parts))
    return path


BORDER = '<width sOffset="0" a="2" b="0" c="0" d="0"/>'


@pytest.mark.parametrize(
    "old, new",
    [
        ("<line/>", "<!-- straight --><line/>"),
        ("<OpenDRIVE>", '<OpenDRIVE xmlns="http://www.opendrive.org">'),
        (BORDER, BORDER + BORDER.replace('sOffset="0"', 'sOffset="50"')),
        (BORDER, BORDER.replace('b="0" c="0"', 'b="1e-11" c="-1e-13"')),
        ("<lanes>", '<lanes><laneOffset s="0" a="0" b="0" c="1e-13" d="-1e-15"/>'),
        ("</lanes>", "{section}</lanes>"),
    ],
)
def test_law_content_without_shape_changes_no_road(tmp_path, old, new):
    path = written(tmp_path)
    plain, text = read_opendrive(path), path.read_text()
    roads = read_network(path).roads
    section = text[text.index("<laneSection") : text.index("</lanes>")]
    new = new.format(section=section.replace('s="0"', 's="40"', 1))
    path.write_text(text.replace(old, new))
    assert read_opendrive(path) == plain
    assert read_network(path).roads == roads


@needs_catalogues
@pytest.mark.parametrize(
    "name, radius",
    values_of("""
    "left_radius_250m", 250.0
    "right_radius_250m", -250.0
    "left_radius_1000m", 1000.0
    "right_radius_1000m", -1000.0
    """),
)  # fmt: skip
def test_the_curves_of_the_alks_catalogue(name, radius):
    """Driving lanes begin 2.75 m to the right; the third one's centre is 2.75 + 2.5 * 3.5 = 11.5 m
    from the line."""
    read = read_opendrive(ALKS / f"alks_road_{name}.xodr")
    assert read.lanes == 3
    assert read.lane_width == 3.5
    (piece,) = [piece for piece in read.line if piece.begin]
    assert 1.0 / piece.begin == pytest.approx(radius + 11.5, rel=1e-12)


@needs_catalogues
def test_the_road_of_many_curvatures_is_the_offset_of_its_reference_line():
    """The reference line is drawn again from the file's own numbers; ours must lie 11.5 m to its
    right everywhere."""
    path = ALKS / "alks_road_different_curvatures.xodr"
    read = read_opendrive(path)
    reference = []
    for geometry in etree.parse(path).iterfind(".//geometry"):
        shape = geometry[0]
        begin = float(shape.get("curvStart") or shape.get("curvature") or 0.0)
        end = float(shape.get("curvEnd") or shape.get("curvature") or 0.0)
        reference.append(Piece(float(geometry.get("length")), begin, end))
    assert len(reference) == 33
    s = np.linspace(0.0, read.length, 4001)
    # which begins at the origin, 11.5 m beside the reference line
    x, y, heading = map_places(read.line, s, 0.0)
    along, across, turned = frame_places(tuple(reference), x, y - 11.5, heading)
    assert np.abs(across + 11.5).max() < 2e-3
    assert np.abs(turned).max() < 2e-5
    assert along[-1] == pytest.approx(5100.0, abs=2e-3)


@needs_catalogues
def test_straight_roads_are_straight_and_a_crossing_asks_which_road():
    straight = read_opendrive(ALKS / "alks_road_straight.xodr")
    assert straight.line == ()
    assert straight.lanes == 3
    assert straight.length == 10_000.0
    ncap = CATALOGUES / "osc_ncap" / "OpenDRIVE" / "NCAP"
    assert read_opendrive(ncap / "StraightRoad_NCAP_Roadmarks.xodr").line == ()
    with refusal("has 10 roads: `opendrive_road` must name one of"):
        read_opendrive(ncap / "X-Intersection_NCAP.xodr")


def test_law_a_road_that_is_written_is_read_again(tmp_path):
    """It is written with a lane offset, so that the line of the file is the right lane's centre:
    which is read."""
    path = tmp_path / "bend.xodr"
    path.write_text(opendrive_xml(Road("bend", 500.0, 2, 3.5, 100.0, line=LINE)))
    read = read_opendrive(path)
    assert read.lanes == 2
    assert read.lane_width == 3.5
    x, y, heading = map_places(read.line, np.linspace(0.0, read.length, 500), 0.0)
    _, across, turned = frame_places(LINE, x, y, heading)
    assert np.abs(across).max() < 1e-5
    assert np.abs(turned).max() < 2e-5


OFFSET = '<laneOffset s="{s}" a="{a}" b="0" c="0" d="0"/>'


def test_a_constant_lane_offset_shifts_the_lanes_and_one_that_changes_is_refused(tmp_path):
    """The right driving lane's centre lies 2 + 3.5 + 1.75 = 7.25 m right of the line, less 1.25 m
    by the offset."""
    bend = (
        '<geometry s="100" x="14.07372" y="102.7495" hdg="1.5" length="80"><arc '
        'curvature="0.01"/></geometry>'
    )
    path = written(tmp_path, more=bend)
    text = path.read_text()
    path.write_text(text.replace("<lanes>", "<lanes>" + OFFSET.format(s=0, a=1.25)))
    assert 1.0 / read_opendrive(path).line[-1].begin == pytest.approx(
        100.0 + 7.25 - 1.25, rel=1e-12
    )
    steps = OFFSET.format(s=0, a=1.25) + OFFSET.format(s=50, a=0)
    for offsets in (steps, OFFSET.format(s=50, a=1.25)):
        path.write_text(text.replace("<lanes>", "<lanes>" + offsets))
        with refusal(r"<laneOffset> of .* must be constant along the road"):
            read_opendrive(path)
    path.write_text(text.replace("<road ", '<road rule="LHT" '))
    with refusal("left-hand traffic is not supported, got 'LHT'"):
        read_opendrive(path)


CUBIC = """<OpenDRIVE><road id="0" length="{length}"><planView><geometry s="0" x="5" y="-3" hdg="0.7"
length="{length}"><paramPoly3 {kind} aU="{aU}" bU="{bU}" cU="0" dU="{dU}" aV="0" bV="{bV}" cV="{cV}" dV="{dV}"/>
</geometry></planView><lanes><laneSection s="0"><right>
<lane id="-1" type="driving"><width sOffset="0" a="3.5"/></lane></right></laneSection></lanes></road></OpenDRIVE>"""
COEFFICIENTS = {"aU": 0.0, "bU": 1.0, "dU": -9e-8, "bV": 0.0, "cV": 1e-3, "dV": -1e-5}


def own_length(c, last):
    """Of the cubic, m: the polygon through a million of its points errs by less than 1e-9."""
    p = np.linspace(0.0, last, 1_000_001)
    u, v = c["aU"] + c["bU"] * p + c["dU"] * p**3, c["bV"] * p + c["cV"] * p**2 + c["dV"] * p**3
    return float(np.hypot(np.diff(u), np.diff(v)).sum())


def cubic(tmp_path, last, kind, **changes):
    numbers = COEFFICIENTS | {"length": own_length(COEFFICIENTS, last)} | changes
    path = tmp_path / "cubic.xodr"
    path.write_text(CUBIC.format(kind=kind, **numbers))
    return path


@pytest.mark.parametrize("normalised", [False, True])
def test_law_a_parametric_cubic_is_followed(tmp_path, normalised):
    """u = p - 9e-8 p3, v = 1e-3 p2 - 1e-5 p3 for p to 60 m, or the same in p / 60.

    The lane's centre is 1.75 m to its right, so the cubic lies 1.75 m to the left of what is read,
    within 0.1 mm, and twice that as offsets are in parts.
    """
    last = 60.0
    scaled = (
        {"bU": last, "dU": -9e-8 * last**3, "cV": 1e-3 * last**2, "dV": -1e-5 * last**3}
        if normalised
        else {}
    )
    path = cubic(tmp_path, last, "" if normalised else 'pRange="arcLength"', **scaled)
    read = read_opendrive(path)
    p = np.linspace(0.0, last, 2001)[1:-1]
    u, v = p - 9e-8 * p**3, 1e-3 * p**2 - 1e-5 * p**3
    heading = np.arctan2(2e-3 * p - 3e-5 * p**2, 1.0 - 2.7e-7 * p**2)
    _, across, turned = frame_places(read.line, u, v + 1.75, heading)
    assert np.abs(across - 1.75).max() < 2e-4
    assert np.abs(turned).max() < 2e-4
    # v'' / u'2 at its begin
    assert read.line[0].begin == pytest.approx(2e-3 / (1.0 + 1.75 * 2e-3), abs=2e-6)


def test_law_a_cubic_is_near_its_pieces_between_their_ends_too():
    along, left = (0.0, 1.0, 0.0, 5e-5), (0.0, 0.0, 8e-3, 1e-4)
    p = np.linspace(0.0, 20.0, 400_001)
    u, v = np.polyval(along[::-1], p), np.polyval(left[::-1], p)
    length = np.hypot(np.diff(u), np.diff(v)).sum()
    line = tuple(pieces_along(Cubic(along, left, 20.0), length, "r"))
    assert np.abs(frame_places(line, u[::1000], v[::1000])[1]).max() < NEAR


@pytest.mark.parametrize(
    "changes, kind, sentence",
    [
        ({"length": 90.0}, "", "The length of a <paramPoly3> .* must be its curve's"),
        ({"aU": 0.5}, 'pRange="arcLength"', "begins at its <geometry>, within 0.01 m and rad"),
        ({"bV": 0.2}, 'pRange="arcLength"', "begins at its <geometry>, within 0.01 m and rad"),
        ({"bU": 0.0, "cV": 0.0, "dV": 0.0, "dU": 1.0}, 'pRange="arcLength"', "stands still"),
        ({}, 'pRange="arclength"', r"Unknown `pRange` .* Did you mean `arcLength`\?"),
    ],
)  # fmt: skip
def test_a_cubic_that_is_not_what_its_geometry_says_is_refused(tmp_path, changes, kind, sentence):
    with refusal(sentence):
        read_opendrive(cubic(tmp_path, 60.0, kind, **changes))


def test_a_scenario_file_drives_on_it(tmp_path):
    written(tmp_path, more='<geometry s="100" x="14.07372" y="102.7495" hdg="1.5" '
                           'length="80"><arc curvature="0.01"/>'
            "</geometry>")  # fmt: skip
    content = tomllib.loads("""
name = "theirs"
parameter = [{ name = "ego_speed", unit = "m/s", low = 10.0, high = 20.0, step = 5.0 }]
ego = { speed = "ego_speed" }
vehicle = [{ name = "lead", speed = 5.0, gap = 40.0 }]
zone = { obstacle = "lead" }
end = { x = 150.0 }
road = { opendrive = "road.xodr" }
""")  # fmt: skip
    road = scenario_from(content, "the file", tmp_path).road
    assert road.lanes == 2
    assert road.lane_width == 3.5
    assert road.length == 150.0
    assert road.line == (
        Piece(100.0),
        Piece(80.0 * (1 + 0.01 * 7.25), 0.01 / 1.0725, 0.01 / 1.0725),
    )
    for key, value in (("line", [{"length": 9.0}]), ("network", "town.net.xml")):
        with refusal("opendrive"):
            scenario_from(
                {**content, "road": {"opendrive": "road.xodr", key: value}}, "the file", tmp_path
            )
    # written after the profile: contents of the road without shape
    contents = '<objects><object id="1"/></objects><signals><signal id="2"/></signals>'
    written(tmp_path, profile=contents, more=NEXT.format(x="14.07372", shape="line"))
    content["end"]["x"] = 105.0
    notes = scenario_from(content, "the file", tmp_path).notes
    assert notes == ("Not simulated: objects, signals.",)


@pytest.mark.parametrize(
    "parts, sentence",
    [
        ({"more": NEXT.format(x="14.07", shape="poly3")}, "a line, an arc"),
        ({"more": NEXT.format(x="20", shape="line")}, "within 0.01 m and rad"),
        *values_of("""
    {"b": 0.1}, "The width of lane -2 .* must be constant"
    {"a": 3.0}, "of one width"
    {"a": 0.0, "width": 0.0}, "of one width above 0 m"
    """),
        ({"profile": SLOPE}, "<elevation> .* must be constant"),
        ({"profile": CAMBER}, "<shape> .* must be 0"),
        ({"profile": SURFACE}, "The cross-section .* must be flat, got '<crossSectionSurface>'"),
        ({"more": NEXT.format(x="oops", shape="line")}, "`x` of <geometry>"),
    ],
)  # fmt: skip
def test_what_would_be_another_road_is_refused_by_name(tmp_path, parts, sentence):
    with refusal(sentence):
        read_opendrive(written(tmp_path, **parts))


SECTION = """</laneSection><laneSection s="{}"><right>
<lane id="-2" type="driving"><width sOffset="0" a="3.5"/></lane></right></laneSection></lanes>"""


@pytest.mark.parametrize(
    "old, new, sentence",
    [
        ("</OpenDRIVE>", '<road id="0"/></OpenDRIVE>', "`id` of a road .* its own, got '0'"),
        ("</laneSection></lanes>", SECTION.format(100), r"less than 100 m.*, got \[0.0, 100.0\]"),
        ("</laneSection></lanes>", SECTION.format(0), r"growing from 0 .*, got \[0.0, 0.0\]"),
        ('id="-2"', 'id="0"', "`id` of a <lane> must be a whole number, .* not 0, got '0'"),
    ],
)
def test_a_file_that_contradicts_itself_is_refused(tmp_path, old, new, sentence):
    path = written(tmp_path)
    replace_in(path, old, new)
    with refusal(sentence):
        read_opendrive(path, "0")


def test_a_file_that_is_none_and_a_road_that_is_not_there(tmp_path):
    with refusal("There is no OpenDRIVE file"):
        read_opendrive(tmp_path / "none.xodr")
    (tmp_path / "text.xodr").write_text("hello")
    with refusal("is not XML"):
        read_opendrive(tmp_path / "text.xodr")
    with refusal(r"Unknown road `main` .*\. Did you mean `mein`\?"):
        read_opendrive(written(tmp_path, id="mein"), "main")


def test_law_a_road_whose_right_lane_opens_or_ends_comes_back_from_its_own_export(tmp_path):
    for span in (LaneSpan(0, -math.inf, 300.0, 0.0, 50.0), LaneSpan(0, 200.0, math.inf, 40.0, 0.0),
                 LaneSpan(0, 200.0, 300.0, 40.0, 50.0)):  # fmt: skip
        road = Road("t", 500.0, 3, 3.5, 400.0, spans=(span,))
        (tmp_path / "t.xodr").write_text(opendrive_xml(road))
        read = read_opendrive(tmp_path / "t.xodr")
        assert read.lanes == 3
        assert read.lane_width == 3.5
        assert read.length == 900.0
        assert read.line == ()
        assert read.spans == (span,)


def test_an_export_has_the_left_edge_where_the_road_has_it():
    road = Road(
        "t",
        500.0,
        2,
        3.5,
        400.0,
        spans=(LaneSpan(1, -math.inf, 300.0, 0.0, 50.0),),
        crossings=(Crossing(400.0),),
    )
    root = etree.fromstring(opendrive_xml(road).encode())
    found = [
        (float(it.get("s")), float(it.get("a")), float(it.get("b")))
        for it in root.iter("laneOffset")
    ]
    assert found == [(0.0, 0.0, 0.0), (300.0, 0.0, -0.07), (350.0, -3.5, 0.0)]  # 3.5 m in 50 m
    lanes = [
        len(section.findall("right/lane")) for section in root.find("road").iter("laneSection")
    ]
    assert lanes == [2, 2, 1]
    # the left lane, -1, ends with the second section; the right one, -2, becomes -1
    following = root.findall("road/lanes/laneSection/right/lane/link/successor")
    assert [it.get("id") for it in following] == ["-1", "-2", "-1"]
    assert [it.get("name") for it in root.iter("road")] == ["t", "crossing"]


LANES = """<lanes><laneSection s="0"><{side}><lane id="{id}" type="driving"><width sOffset="0" a="{a}"/></lane></{side}>
</laneSection></lanes></road>"""
CHAIN = """<OpenDRIVE><road id="in"><planView>
<geometry s="0" x="100" y="0" hdg="{pi}" length="100"><line/></geometry></planView>{left}
<road id="turn"><planView>
<geometry s="0" x="100" y="0" hdg="0" length="{quarter}"><arc curvature="0.05"/></geometry></planView>{right}
<road id="out"><planView>
<geometry s="0" x="120" y="20" hdg="{half}" length="50"><line/></geometry></planView>{last}
</OpenDRIVE>"""


def chain(tmp_path, a=3.5):
    path = tmp_path / "chain.xodr"
    quarter = 10.0 * math.pi
    left, right = LANES.format(side="left", id=1, a=3.5), LANES.format(side="right", id=-1, a=3.5)
    last = LANES.format(side="right", id=-1, a=a)
    numbers = {"pi": math.pi, "half": 0.5 * math.pi, "quarter": quarter}
    path.write_text(CHAIN.format(**numbers, left=left, right=right, last=last))
    return path


def test_the_roads_of_a_turn_are_driven_in_order(tmp_path):
    """The first is driven against its direction; the lane's centre is 1.75 m right of the arc: R =
    21.75 m."""
    path = chain(tmp_path)
    # what is wrong on a side that is not driven does not matter
    path.write_text(
        path.read_text().replace("<right>", '<left><lane id="2" type="exit"/></left><right>', 1)
    )
    read = read_opendrive(path, ["in", "turn", "out"])
    assert [(round(piece.length, 9), piece.begin) for piece in read.line] == [
        (100.0, 0.0), (round(0.5 * math.pi * 21.75, 9), pytest.approx(1 / 21.75)), (50.0, 0.0),
    ]  # fmt: skip
    x, y, heading = (float(it) for it in map_places(read.line, read.length, 0.0))
    assert (x, y, heading) == pytest.approx((121.75, 71.75, 0.5 * math.pi))


@pytest.mark.parametrize("road", ["in", "turn", "out"])
def test_a_fault_on_a_side_that_is_not_driven_does_not_matter(tmp_path, road):
    """Of the first road, which is driven against its direction, it is the side read first."""
    path = chain(tmp_path)
    plain = read_opendrive(path, ["in", "turn", "out"])
    side = "right" if road == "in" else "left"
    fault = f'<{side}><lane id="1" type="driving"><width sOffset="0" a="2" c="1"/></lane></{side}>'
    head, tail = path.read_text().split(f'<road id="{road}">')
    path.write_text(f'{head}<road id="{road}">' + tail.replace('s="0">', f's="0">{fault}', 1))
    assert read_opendrive(path, ["in", "turn", "out"]) == plain


def test_a_road_of_a_chain_that_is_driven_against_is_read_on_its_own_side(tmp_path):
    """The last road of the turn, turned round: the side that is read first has a fault."""
    path = chain(tmp_path)
    plain = read_opendrive(path, ["in", "turn", "out"])
    lane = '<lane id="{}" type="driving"><width sOffset="0" a="3.5" b="{}"/></lane>'
    sides = f"<left>{lane.format(1, 0)}</left><right>{lane.format(-1, 0.01)}</right>"
    head, tail = path.read_text().split('<road id="out">')
    tail = tail.replace('y="20"', 'y="70"').replace('hdg="', 'hdg="-')
    before, section = tail.split('<laneSection s="0">')
    _, after = section.split("</right>")
    path.write_text(f'{head}<road id="out">{before}<laneSection s="0">{sides}{after}')
    read = read_opendrive(path, ["in", "turn", "out"])
    assert [(it.length, it.begin) for it in read.line] == [
        (pytest.approx(it.length), it.begin) for it in plain.line
    ]


def test_a_road_with_left_lanes_alone_is_driven_against_its_line(tmp_path):
    """As are many of CARLA's roads; alone and as the first of a turn it begins in one place."""
    path = chain(tmp_path)
    alone, first = read_opendrive(path, "in"), read_opendrive(path, ["in", "turn", "out"])
    assert (alone.line, alone.length, alone.begin) == ((), 100.0, first.begin)


def test_a_lane_that_opens_in_a_chain_is_named_with_its_road(tmp_path):
    path = chain(tmp_path)
    more = '<lane id="-2" type="driving"><width sOffset="0" a="3.5"/></lane></right>'
    opens = more.replace('a="3.5"', 'a="0" b="0.175"').replace(
        "/></lane>",
        """/>
<width sOffset="20" a="3.5"/></lane>""",
    )
    text = path.read_text()
    head, last = text.split('<road id="out">')
    path.write_text(head.replace("</right>", more) + '<road id="out">'
                    + last.replace("</right>", opens))  # fmt: skip
    with refusal(
        "lanes of road `out` .* must be there throughout, .* got 'one that opens or ends'"
    ):
        read_opendrive(path, ["turn", "out"])


@pytest.mark.parametrize(
    "names, a, sentence",
    values_of("""
    ["in", "out"], 3.5, "must meet, each at the end of the one before"
    ["in", "turn", "out"], 3.0, "must meet"
    ["in", "trun"], 3.5, "Did you mean `turn`?"
    [], 3.5, "must be 1 to 8"
    """),
)
def test_roads_that_do_not_follow_each_other_are_refused(tmp_path, names, a, sentence):
    with refused(sentence):
        read_opendrive(chain(tmp_path, a), names)


def test_a_curve_tighter_than_its_lane_is_refused_with_its_radius(tmp_path):
    """The right lane's centre is 7.25 m right of the line, the curve's centre 2 m."""
    arc_of_file = '<arc curvature="-0.5"/>'
    path = written(tmp_path)
    path.write_text(path.read_text().replace("<line/>", arc_of_file))
    with refusal(r"must be above 7\.25 m, .* got '2 m'"):
        read_opendrive(path)


def test_a_width_that_is_a_polynomial_is_refused_by_its_lane(tmp_path):
    road = Road("t", 500.0, 3, 3.5, 400.0, spans=(LaneSpan(0, -math.inf, 300.0, 0.0, 50.0),))
    path = tmp_path / "t.xodr"
    path.write_text(opendrive_xml(road).replace('b="-0.07" c="0"', 'b="0" c="-0.001"'))
    with refusal(r"The width of lane -3 of road `0` of OpenDRIVE file .* must be constant, or"):
        read_opendrive(path)


@needs_catalogues
def test_all_twelve_ways_through_the_junction_of_the_ncap_catalogue_are_driven():
    path = CATALOGUES / "osc_ncap" / "OpenDRIVE" / "NCAP" / "X-Intersection_NCAP.xodr"
    root = etree.parse(path).getroot()
    joined = {
        it.get("id"): [end.get("elementId") for end in it.find("link")] for it in root.iter("road")
    }
    turns = []
    for connection in root.iter("connection"):
        first, middle = connection.get("incomingRoad"), connection.get("connectingRoad")
        (last,) = [name for name in joined[middle] if name != first]
        read = read_opendrive(path, [first, middle, last])
        turns.append([round(1.0 / piece.begin, 2) for piece in read.line if piece.begin])
    # arcs of R = 11.5 m; the lanes' centres are 1.75 m right of them
    assert sorted(turns) == [[]] * 4 + [[-9.75]] * 4 + [[13.25]] * 4


# --- reference line: closed forms, frame, polyline in SUMO ----------------------------------------


PIECES = (
    Piece(80.0), Piece(60.0, 0.0, 1 / 250), arc(200.0, 250.0), Piece(90.0, 1 / 250, -1 / 120),
    arc(70.0, -120.0),
    Piece(50.0, -1 / 120, 0.0),
)  # fmt: skip
"""Straight, into a left bend, over into a right one, and straight again."""
RNG = np.random.default_rng(17)
LIMITS = [0.0, -8.0, -1.0], [560.0, 8.0, 1.0]  # of s, d and a heading


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
    s, d, heading = RNG.uniform(*LIMITS, (2000, 3)).T
    back = frame_places(PIECES, *map_places(PIECES, s, d, heading))
    for found, given in zip(back, (s, d, heading), strict=True):
        assert np.abs(found - given).max() < 1e-9


def test_law_a_line_has_no_gap_no_kink_and_the_length_it_says():
    s = np.linspace(-10.0, 600.0, 61_001)
    x, y, heading = map_places(PIECES, s, 0.0)
    assert np.abs(np.hypot(np.diff(x), np.diff(y)) - 0.01).max() < 1e-9
    assert np.abs(np.diff(heading)).max() <= 0.01 / 120 + 1e-12
    assert np.abs(np.diff(heading) / 0.01 - curvatures(PIECES, s[:-1] + 0.005)).max() < 1e-7
    assert tightest(PIECES) == 120.0
    assert tightest(()) == math.inf


def test_a_straight_road_has_one_pair_of_numbers():
    s, d, heading = RNG.uniform(*LIMITS, (50, 3)).T.copy()
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
    road = Road("chain", 500.0, 3, 3.5, 100.0, line=PIECES)
    lanes = list(etree.fromstring(network_xml(road).encode()).iter("lane"))
    assert [lane.get("length") for lane in lanes] == ["600.00"] * 3
    for number, lane in enumerate(lanes):
        points = np.array(
            [[float(it) for it in pair.split(",")] for pair in lane.get("shape").split()]
        )
        s, d, _ = frame_places(PIECES, points[:, 0], points[:, 1])
        assert np.abs(d - 3.5 * number).max() < 1e-4  # four decimals
        bends = np.abs(curvatures(PIECES, 0.5 * (s[1:] + s[:-1]))) > 0.0
        assert np.diff(s)[bends].max() < 1.0 + 1e-3
        assert len(points) < 480  # straights have two
    assert drawn_points(PIECES, 0.0, 600.0)[[0, 1, -1]].tolist() == [0.0, 80.0, 600.0]


@pytest.mark.parametrize("seed", range(20))
def test_law_no_corner_is_drawn_twice_where_pieces_meet(seed):
    stream = np.random.default_rng(seed)
    line = tuple(Piece(float(it), 0.001, 0.002) for it in stream.uniform(1.0, 99.0, 50))
    corners = drawn_points(line, float(stream.uniform(0.0, 9.0)), 1000.0)
    assert np.diff(corners).min() > 1e-6


def test_a_bent_road_as_opendrive_has_its_pieces():
    root = etree.fromstring(
        opendrive_xml(Road("chain", 500.0, 2, 3.5, 100.0, line=PIECES)).encode()
    )
    kinds = [geometry[0].tag for geometry in root.iter("geometry")]
    assert kinds == ["line", "spiral", "arc", "spiral", "arc", "spiral", "line"]
    for geometry, s in zip(
        root.iter("geometry"), np.cumsum([0.0, *(piece.length for piece in PIECES)]), strict=True
    ):
        x, y, heading = map_places(PIECES, s, 0.0)
        found = [float(geometry.get(key, "")) for key in ("s", "x", "y", "hdg")]
        assert np.allclose(found, (s, x, y, heading), atol=1e-6)


# -- in a scenario file ----------------------------------------------------------------------------


def read(keys=""):
    """The road of a scenario file by its keys."""
    text = f"""
name = "bent"
parameter = [{{ name = "ego_speed", unit = "m/s", low = 10.0, high = 20.0, step = 5.0 }}]
option = [{{ name = "radius", unit = "m", default = 300.0 }}, {{ name = "bend", unit = "m" }}]
ego = {{ speed = "ego_speed" }}
vehicle = [{{ name = "lead", speed = 5.0, gap = 40.0 }}]
zone = {{ obstacle = "lead" }}
[road]
length = 800.0
{keys}"""
    return scenario_from(tomllib.loads(text), "the file", Path()).road


def test_a_file_draws_a_road_piece_by_piece():
    road = read("""line = [
    { length = 100.0 }, { length = 50.0, end_radius = "radius" },
    { length = 200.0, radius = "radius" },
    { length = 40.0, begin_radius = 300.0, end_radius = -200.0 },
]""")  # fmt: skip
    assert road.line == (
        Piece(100.0), Piece(50.0, 0.0, 1 / 300), Piece(200.0, 1 / 300, 1 / 300),
        Piece(40.0, 1 / 300, -1 / 200),
    )  # fmt: skip
    assert road.name.startswith("road_2x3.5m_600m_of_800m_right_200m_")
    hill = read('name = "hill"\nline = [{ length = 90.0, radius = "radius" }]')
    assert hill.name == "hill_left_300m"


def test_a_line_without_curves_is_a_straight_road():
    assert read('line = [{ length = 100.0 }, { length = 50.0, radius = "bend" }]') == read()


@pytest.mark.parametrize(
    "line, sentence",
    rows_of(
        r"""
{ length = 100.0, radius = "radios" } | `radios`.*Did you mean `radius`\?
{ length = 100.0, radius = "ego_speed" } | `radius` in the file must be in m, got `ego_speed`
{ length = 100.0, radious = 100.0 } | line\[0\]\.radious` in the file\. Did you mean `radius`\?
{ length = 100.0, radius = 0.0 } | must be a number other than 0 m
{ length = 100.0, radius = 300.0, end_radius = 100.0 } | either `radius` or `begin_radius`
{ length = 100.0 }, { length = 20.0, radius = 6.0 }
| piece 2 .*so that the ego can drive its innermost
{ length = 801.0, radius = 300.0 } | at most as long as the road \(800 m\), got 801
{ length = -1.0 } | length
"""
    ),
)
def test_a_road_that_cannot_be_driven_is_refused(line, sentence):
    with refusal(sentence):
        read(f"line = [{line}]")


def test_a_network_of_the_users_has_its_line_already():
    with refusal(r"`road\.line` of the file must not stand beside `network`: it shapes a road"):
        read('network = "town.net.xml"\nedges = ["a"]\nline = [{ length = 9.0 }]')
