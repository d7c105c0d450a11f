"""A road inside a user's SUMO network: read, checked, and laid along the x axis.

The tables of scenario files call `read_road`, and `cosim/sumo/sumo_files.py` writes what
`laid_along_x` returns. In the result vehicles drive along x, with the right lane's centre line at
y = 0.

Straight edges: the whole network is turned and moved, as one rigid body, until the edges lie along
    x. Its topology does not change.
Curved edges: `fitted_line` finds the line along their lanes. The rest of the network is left out: a
    network of this one road is written, as for every other curved road.

The outermost lanes may begin and end where edges meet, without a taper, as in SUMO.

Users: `cosim/sumo/sumo_files.py`, `scenario/file_tables.py`.
"""

from __future__ import annotations

import functools
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, chain, pairwise
from math import atan2, dist, inf, isnan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from lxml import etree

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.frozen import frozen
from sumo_eval.input_file import LARGEST, hash_of
from sumo_eval.scenario.concrete import NetworkFile, Road
from sumo_eval.scenario.road.fitted_line import WITHIN, fitted_line
from sumo_eval.scenario.road.lanes import LaneSpan
from sumo_eval.scenario.road.pose import Pose, onto_the_line
from sumo_eval.scenario.road.reference_line import (
    Line,
    drawn_points,
    frame_places,
    length_of,
    map_places,
)
from sumo_eval.scenario.road.table import bend_name, check_line
from sumo_eval.scenario.xml_file import Element, read_xml
from sumo_eval.text import number_in, shown
from sumo_eval.trajectory import FloatArray

STRAIGHT = 0.1  # m: largest distance of a lane from its straight line; netconvert rounds to 0.01 m
# m/s on the driven edges: the scenario says how fast vehicles are, not the network's signs
SPEED_LIMIT = 60.0
_INDEX_DIGITS = 3  # of the index of a lane, at most
_DEFAULT_LANE_WIDTH = 3.2  # m, SUMO's
_ONE_PLACE = 0.05  # m: corners nearer to each other than this are one corner, rounded differently
_LEAST_WAY = 0.1  # m: length of the shortest lane through a junction in SUMO
# m: largest distance of a lane from where the road's line and the lane widths put it, on a curve
PARALLEL = 0.3

# types of junctions for which SUMO needs no <request>
_WITHOUT_RIGHT_OF_WAY = ("dead_end", "district", "internal", "unregulated")
_CARS = {"passenger", "all"}  # SUMO's vehicle classes that include the ego's
# XPath: the connections between two edges
_BETWEEN = ".//connection[@from=$one][@to=$other]"
# XPath: id of the lane within the junction that the first connection of a lane leads through
_VIA = "string((.//connection[@from=$edge][@fromLane=$index])[1]/@via)"

Point = tuple[float, float]
_Course = tuple[Line, list[set[int]], list[float]]
"""How edges lie on a road: (line, places, along).

line: of the road's right-hand lane.
places: for each edge, the places of its lanes on the road: 0 for the road's right-hand lane, 1 for
    the lane to the left of it, and so on.
along: begin and end of the first edge along the line, m, then those of the second, and so on.
"""


@frozen
class _Lane:
    """A lane of an edge.

    index: SUMO's, from the right.
    width: m. shape: corners of its centre line on the map, m.
    """

    id: str
    index: int
    width: float
    shape: tuple[Point, ...]


_Lanes = Sequence[Sequence[_Lane]]
"""The lanes of each driven edge, from the right."""


def read_road(path: Path, edges: Sequence[str], end: float) -> Road:
    """Read a road of a SUMO network.

    path: of the .net.xml.
    edges: ids of the edges to drive along, in order.
    end: x at which cases end, m from the start of the first edge.

    Raises InputError where the file is not a network, an edge is not in it, or the edges are not
    one road: lanes of one width, the same on all edges except the outermost of each side.
    """
    path = Path(os.path.realpath(path))  # a loop of links is refused below
    owner = f"network {path.name}"
    network = NetworkFile(str(path), tuple(edges), hash_of(path, "network"))
    root = _parsed(network)
    driven = _driven_edges(root, edges, owner)
    lanes = [_checked_lanes(edge, owner) for edge in driven]  # of each edge
    _check_widths(lanes, edges, owner)
    _check_junctions(root, driven[1:], owner)
    links = [_links(root, one, other, owner) for one, other in pairwise(edges)]

    straight = _along_x(lanes)
    what = f"the road along {', '.join(edges)} of {owner}"
    line, places, along = straight or _along_curves(lanes, links, what, owner)
    spans = _spans(edges, places, along, owner)
    if not 0.0 < end <= along[-1]:
        wanted = f"above 0, within the {along[-1]:.1f} m of its edges"
        raise must_be("`end.x`, the end of a case,", owner, wanted, end)
    stem = path.name.removesuffix(".net.xml").removesuffix(".xml")
    return Road(
        name=f"{stem}_{network.sha256[:8]}{bend_name(line, named=True)}",
        length=end,
        lanes=max(map(max, places)) + 1,
        lane_width=lanes[0][0].width,
        run_out=along[-1] - end,
        speed_limit=SPEED_LIMIT,
        network=replace(network, sections=_sections(lanes, links, places, along))
        if straight
        else None,
        line=line,
        spans=spans,
    )


def _sections(
    lanes: _Lanes, links: Sequence[_Link], places: Sequence[set[int]], along: Sequence[float]
) -> tuple[tuple[float, float, int], ...]:
    """`NetworkFile.sections`: begin and end of each edge, and SUMO's index of the road's lane 0.

    places, along: as in `_Course`.
    """
    first_lanes = [
        of_edge[0].index - min(place) for of_edge, place in zip(lanes, places, strict=True)
    ]
    begins, own_ends = along[::2], along[1::2]
    # an edge ends where its lanes through the junction begin, or else where the next edge does
    ends = [
        min(own_end, next_begin - _LEAST_WAY) if any(link.ways.values()) else next_begin
        for own_end, next_begin, link in zip(own_ends, begins[1:], links, strict=False)
    ]
    return tuple(zip(begins, [*ends, along[-1]], first_lanes, strict=True))


def _driven_edges(root: Element, names: Sequence[str], owner: str) -> list[Element]:
    """The edges with these ids, in order."""
    if not names:
        raise InputError(f"The road in {owner} must name the `edges` to drive along.")
    by_id = {
        str(edge.get("id")): edge
        for edge in root.iter("edge")
        if edge.get("function", "normal") == "normal"
    }
    check_known(f"edge of {owner}", by_id, *names)
    return [by_id[name] for name in names]


def _checked_lanes(edge: Element, owner: str) -> list[_Lane]:
    """The lanes of an edge for cars; raises InputError unless there is one, and each has a width
    and a shape.
    """
    lanes = _lanes(edge)
    if not lanes:
        raise InputError(
            f"Edge `{edge.get('id')}` of {owner} must have a lane on which a car may drive."
        )
    for lane in lanes:
        if lane.width <= 0.0:
            raise must_be(f"The width of lane `{lane.id}`", owner, "above 0 m", lane.width)
        if len(lane.shape) < 2 or lane.shape[0] == lane.shape[-1]:
            must = "of at least 2 points, with distinct ends"
            raise must_be(f"The shape of lane `{lane.id}`", owner, must, len(lane.shape))
    return lanes


def _check_widths(lanes: _Lanes, edges: Sequence[str], owner: str) -> None:
    """Refuse lanes of different widths."""
    every = list(chain(*lanes))
    if any(lane.width != every[0].width for lane in every):
        widths = ", ".join(f"{lane.id} {lane.width:g} m" for lane in every)
        raise InputError(
            f"The lanes of edges {', '.join(edges)} of {owner} must have one width, got {widths}."
        )


def _check_junctions(root: Any, edges: Sequence[Element], owner: str) -> None:
    """Refuse junctions at which SUMO crashes: with incoming lanes, but no right of way.

    edges: those that begin at the junctions in question.
    """
    begins = {edge.get("from") for edge in edges}
    for junction in root.xpath(".//junction[@incLanes!=''][not(request)]"):
        regulated = junction.get("type") not in _WITHOUT_RIGHT_OF_WAY
        if junction.get("id") in begins and regulated:
            raise InputError(
                f"Junction `{junction.get('id')}` of {owner} must have a <request> for each of its "
                "connections, as netconvert writes it, or be of type `unregulated`: it has none."
            )


def _along_x(lanes: _Lanes) -> _Course | None:
    """The course of straight edges, along the x axis; None: they are not straight.

    They are straight if every lane is parallel, within `STRAIGHT`, to the chord of the first edge's
    right-hand lane.
    """
    first = lanes[0][0]
    # a ring, whose chord has no direction
    if dist(first.shape[0], first.shape[-1]) < first.width:
        return None
    axis, places = _laid(lanes)
    for lane in chain(*lanes):
        y = onto_the_line(lane.shape, axis)[:, 1]
        if np.abs(y - places[lane.id] * first.width).max() > STRAIGHT:
            return None
    along: list[float] = []
    for right_lane, *_ in lanes:  # of each edge x of both ends
        x = onto_the_line(right_lane.shape, axis)[:, 0]
        if x[-1] <= x[0]:  # back beside the first edge, after a turn
            return None
        along += [float(x[0]), float(x[-1])]
    return (), [{places[lane.id] for lane in of_edge} for of_edge in lanes], along


def _laid(lanes: _Lanes) -> tuple[Pose, dict[str, int]]:
    """The x axis of a straight road, as the pose of its origin on the map; and by its id each
    lane's place: 0 for the road's right-hand lane, which lies on the axis, 1 for the lane to the
    left of it, and so on.
    """
    # The axis is along the first edge's right-hand lane, which begins at `begins`, or along a lane
    # to the right of it that opens later (`lowest` below 0).
    first = lanes[0][0]
    (x0, y0), (x1, y1) = first.shape[0], first.shape[-1]
    begins = Pose(x0, y0, atan2(y1 - y0, x1 - x0))
    places = {
        # [0, 1]: y of the lane's first corner
        lane.id: round(onto_the_line(lane.shape, begins)[0, 1] / first.width)
        for lane in chain(*lanes)
    }
    lowest = min(places.values())
    axis = begins.moved(0.0, lowest * first.width)
    return axis, {lane: place - lowest for lane, place in places.items()}


def _spans(
    edges: Sequence[str], places: Sequence[set[int]], along: Sequence[float], owner: str
) -> tuple[LaneSpan, ...]:
    """Spans of outermost lanes that do not exist throughout.

    edges: ids. places, along: as in `_Course`.
    """
    count = max(set().union(*places)) + 1  # number of lanes of the road
    spans = []
    for lane in sorted({0, count - 1}):
        # numbers of the edges that have it
        with_lane = [number for number, of_edge in enumerate(places) if lane in of_edge]
        if len(with_lane) == len(edges):
            continue
        first, last = with_lane[0], with_lane[-1]
        if gaps := set(range(first, last)) - set(with_lane):
            raise InputError(
                f"Edge `{edges[min(gaps)]}` of {owner} must have the outermost lane that edges "
                "before and behind it have."
            )
        # `along` has begin and end of each edge by turns
        begin = along[2 * first] if first > 0 else -inf
        end = along[2 * last + 1] if last + 1 < len(edges) else inf
        spans.append(LaneSpan(lane, begin, end))

    throughout = set(range(count)) - {span.lane for span in spans}
    for name, of_edge in zip(edges, places, strict=True):
        if missing := throughout - of_edge:
            must = "as wide as the road, except the outermost lane of each side"
            raise must_be(
                f"Edge `{name}`", owner, must, f"no lane {min(missing)} (0: the right one)"
            )
    return tuple(spans)


# -- a curved road ---------------------------------------------------------------------------------


def _along_curves(lanes: _Lanes, links: Sequence[_Link], what: str, owner: str) -> _Course:
    """The course of curved edges. Its line follows the rightmost of the lanes that all edges have,
    or is the parallel to this lane where the road's right-hand lane lies.

    links: from each edge to the next one. what: the road, for messages.
    """
    numbered = _numbered(lanes, links)
    width = lanes[0][0].width
    places = list(map(set, numbered))
    common = set.intersection(*places)
    if not common:
        raise InputError(f"The edges of {owner} must have a lane that goes through all of them.")
    path = _path(numbered, min(common), links)
    line, begins = _line_along(np.concatenate(path), what)
    aside = min(common) * width  # m from this lane to the road's right-hand one, to the right
    if aside > 0.0:
        corners = drawn_points(line, 0.0, length_of(line), longest=2.0)
        x, y, _ = map_places(line, corners, -aside)
        # x, y and so the parallel's beginning are in the frame of `begins`
        line, parallel_begins = _line_along(np.column_stack([x, y]), what)
        begins = begins.moved(*parallel_begins)
    check_line(line, max(map(max, places)) + 1, width, what)
    _check_parallel(numbered, line, begins, owner)
    return line, places, _edge_ends(path, line, begins)


def _numbered(lanes: _Lanes, links: Sequence[_Link]) -> list[dict[int, _Lane]]:
    """The lanes of each edge by their place on the road, 0 for its right-hand lane."""
    # SUMO's index of a lane plus the shift of its edge is the index of the same lane on the first
    # edge. The smallest such sum is that of the road's right-hand lane.
    shifts = list(accumulate((link.shift for link in links), initial=0))
    lowest = min(shift + of_edge[0].index for shift, of_edge in zip(shifts, lanes, strict=True))
    return [
        {shift + lane.index - lowest: lane for lane in of_edge}
        for shift, of_edge in zip(shifts, lanes, strict=True)
    ]


def _path(
    numbered: Sequence[dict[int, _Lane]], lane: int, links: Sequence[_Link]
) -> list[tuple[Point, ...]]:
    """Centre line of a lane that all edges have, in parts: on the first edge, within the junction,
    on the second edge, and so on.

    numbered: lanes of each edge by their place on the road. lane: place of the lane.
    """
    path = [numbered[0][lane].shape]
    for link, before, after in zip(links, numbered, numbered[1:], strict=False):
        shape = after[lane].shape
        within = link.ways.get(before[lane].index, ())
        path += [(path[-1][-1], *within, shape[0]), shape]
    return path


def _line_along(way: FloatArray, what: str) -> tuple[Line, Pose]:
    """The line along a polyline, and where it begins on the map.

    way: corners, (n, 2), m. A corner within `_ONE_PLACE` of the one before is left out, unless it
        is the last.
    what: the road, for messages.
    """
    corners = [way[0]]
    for corner in way[1:]:
        if dist(corner, corners[-1]) > _ONE_PLACE:
            corners.append(corner)
    if dist(corners[-1], way[-1]) > 0.0:
        corners.append(way[-1])
    line, begins, off = fitted_line(np.array(corners))
    if off > WITHIN:
        raise must_be(
            "The lanes",
            what,
            f"without corners, so that a line can follow them within {WITHIN:g} m",
            round(off, 2),
        )
    return line, begins


def _check_parallel(
    numbered: Sequence[dict[int, _Lane]], line: Line, begins: Pose, owner: str
) -> None:
    """Refuse lanes that are not parallel to the line.

    numbered: lanes of each edge by their place on the road.
    """
    for place, lane in chain(*(of_edge.items() for of_edge in numbered)):
        _, across, _ = frame_places(line, *onto_the_line(lane.shape, begins).T)
        off = float(np.abs(across - lane.width * place).max())
        if off > PARALLEL:
            must = f"beside the first within {PARALLEL:g} m"
            raise must_be(f"Lane `{lane.id}`", owner, must, round(off, 2))


def _edge_ends(path: Sequence[Sequence[Point]], line: Line, begins: Pose) -> list[float]:
    """Begin and end of each edge along the line, m.

    path: as from `_path`.
    """
    on_edges = path[::2]
    ends = [shape[end] for shape in on_edges for end in (0, -1)]
    # length of the path up to each of these ends, m: an end lies where two parts meet
    driven = np.cumsum([0.0, *(sum(map(dist, part, part[1:])) for part in path)])
    # a ring passes a place more than once: look for each end near its length, scaled to the line
    near = driven * (length_of(line) / driven[-1])
    x, y = onto_the_line(ends, begins).T
    along: list[float] = frame_places(line, x, y, near=near)[0].tolist()
    return along


class _Link(NamedTuple):
    """Connection of the lanes of an edge to those of the next one.

    shift: SUMO's index of a lane on the edge less that of its continuation on the next edge.
    ways: centre lines within the junction, by the lane's index on the first of both edges.
    """

    shift: int
    ways: dict[int, list[Point]]


def _links(root: Any, one: str, other: str, owner: str) -> _Link:
    """Connection from edge `one` to edge `other`."""
    connections = root.xpath(_BETWEEN, one=one, other=other)
    if not connections:
        raise InputError(
            f"Edge `{one}` of {owner} must lead to edge `{other}`: no lane of it does."
        )
    what = f"A lane of the connection from edge `{one}` to edge `{other}` in {owner}"
    # index of the lane before, index of the lane after, id of the lane through the junction
    joined = [
        (_index(it.get("fromLane", "0"), what), _index(it.get("toLane", "0"), what), it.get("via"))
        for it in connections
    ]
    shifts = Counter(before - after for before, after, _ in joined)
    # the most frequent shift; of equally frequent ones the one nearest to 0
    shift = min(shifts, key=lambda it: (-shifts[it], abs(it)))
    ways: dict[int, list[Point]] = {}
    for before, after, via in joined:
        if before - after == shift:
            shapes = (_points(lane.get("shape", "")) for lane in _lanes_through(root, via))
            ways[before] = list(chain(*shapes))
    return _Link(shift, ways)


def _lanes_through(root: Any, via: str | None) -> list[Element]:
    """The lanes that lead through a junction, in order.

    via: id of the first of them; None: there is none.
    """
    passed: list[Element] = []
    while via:
        lanes = root.xpath(".//lane[@id=$via]", via=via)
        if not lanes or lanes[0] in passed:  # a faulty network may lead in a circle
            break
        passed.append(lanes[0])
        edge, _, index = via.rpartition("_")  # a lane's id is `edge_index`
        via = root.xpath(_VIA, edge=edge, index=index)
    return passed


# -- a straight road -------------------------------------------------------------------------------


@functools.lru_cache(maxsize=16)
def laid_along_x(network: NetworkFile) -> str:
    """Text of the network, turned and moved so that its driven edges lie along x from x = 0."""
    root: Any = _parsed(network)
    driven = _driven_edges(root, network.edges, network.path)
    axis, places = _laid([_lanes(edge) for edge in driven])
    for element in root.iter():
        _move(element, axis)
    width = _lanes(driven[0])[0].width
    sections = network.sections
    for edge, (begin, end, _) in zip(driven, sections, strict=True):
        for lane in edge.iter("lane"):
            if (name := lane.get("id")) in places:
                _straighten([lane], places[name] * width, begin, end)
    for (one, other), ((_, end, _), (next_begin, _, _)) in zip(
        pairwise(network.edges), pairwise(sections), strict=True
    ):
        for it in root.xpath(_BETWEEN, one=one, other=other):
            # -1 for a lane before that is not on the road, None for a lane after: never equal
            place = places.get(f"{one}_{it.get('fromLane')}", -1)
            if place == places.get(f"{other}_{it.get('toLane')}"):
                lanes = _lanes_through(root, it.get("via"))
                _straighten(lanes, place * width, end, next_begin)
    for location in root.findall("location"):  # the map projection, no longer true after the move
        root.remove(location)
    return etree.tostring(root.getroottree(), xml_declaration=True, encoding="UTF-8").decode()


def _move(element: Element, axis: Pose) -> None:
    """Move an element's shape, and a junction's position, into the frame of the x axis."""
    if points := _points(element.get("shape", "")):
        element.set("shape", _text(onto_the_line(points, axis)))
    if element.tag == "junction" and element.get("x"):
        x, y = (_number(element.get(key, "0"), f"{key} of a junction") for key in "xy")
        for key, value in zip("xy", Pose(x, y, 0.0).seen_from(axis), strict=False):
            element.set(key, f"{value:.4f}")


def _straighten(lanes: Sequence[Element], y: float, begin: float, end: float) -> None:
    """Lay lanes that follow one another exactly along x, with their length and the speed limit.

    y: of their centre lines, m.
    begin, end: x at which the first one begins and the last one ends, m.
    """
    ends = np.linspace(begin, end, len(lanes) + 1).tolist()
    for lane, x in zip(lanes, pairwise(ends), strict=True):
        lane.attrib.update({
            "shape": _text([(it, y) for it in x]), "length": repr(x[1] - x[0]),
            "speed": f"{SPEED_LIMIT:g}",
        })  # fmt: skip


# -- elements of the file --------------------------------------------------------------------------


def _parsed(network: NetworkFile) -> Element:
    """Root of the network's file. Raises InputError for a file that has changed."""
    path = Path(network.path)
    root = read_xml(path, "Network", LARGEST)
    if hash_of(path, "network") != network.sha256:
        raise InputError(f"Network {path} has changed since its scenario was read.")
    owner = f"network {path.name}"
    if root.tag != "net":
        raise must_be("The root", owner, "`net`", root.tag)
    if root.get("lefthand") == "true":
        raise must_be("`lefthand`", owner, "false: left-hand traffic is not supported", "true")
    return root


def _lanes(edge: Element) -> list[_Lane]:
    """The lanes of an edge on which cars may drive, from the right."""
    return sorted(
        (
            _Lane(
                str(lane.get("id")),
                _index(lane.get("index", "0"), f"The index of lane {shown(str(lane.get('id')))}"),
                _number(lane.get("width", str(_DEFAULT_LANE_WIDTH)), "The width of a lane"),
                _points(lane.get("shape", "")),
            )
            for lane in edge.iter("lane")
            if _carries_cars(lane)
        ),
        key=lambda lane: lane.index,
    )


def _index(text: str, owner: str) -> int:
    """The index of a lane, 0 to 999."""
    if not (text.isdecimal() and len(text) <= _INDEX_DIGITS):
        raise InputError(
            f"{owner} must be a whole number of at most {_INDEX_DIGITS} digits, got {shown(text)}."
        )
    return int(text)


def _carries_cars(lane: Element) -> bool:
    """Whether a passenger car may drive on a lane; as in SUMO, `allow` has precedence over
    `disallow`.
    """
    if (allowed := lane.get("allow")) is not None:
        return not _CARS.isdisjoint(allowed.split())
    return _CARS.isdisjoint(lane.get("disallow", "").split())


def _points(text: str) -> tuple[Point, ...]:
    """The points of a shape, as `1.00,2.00 3.00,4.00`; a third coordinate, the height, is left
    out.
    """
    # the added "" stands for a missing y, and is refused as a number
    xy = [[*part.split(","), ""] for part in text.split()]
    return tuple((_number(x, "x of a shape"), _number(y, "y of a shape")) for x, y, *_ in xy)


def _number(text: str, what: str) -> float:
    """A finite number in an attribute."""
    value = number_in(text)
    if isnan(value):
        raise must_be(what, "the network", "a finite number", text)
    return value


def _text(points: Sequence[Point] | FloatArray) -> str:
    """A shape as SUMO writes it."""
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points)
