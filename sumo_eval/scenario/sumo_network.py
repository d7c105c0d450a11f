"""A road inside a user's SUMO network: found, checked, and laid along the x axis.

The tables of scenario files call `read_road`, and `cosim.sumo` writes what `laid_along_x` returns.
All vehicles drive along x with the right lane's centre line at y = 0.

Straight edges: the whole network is turned and moved, as one rigid body, until they lie there. Its
    topology does not change.
Curved edges: `fitted_line` finds the line along their lanes. Only the road along this line counts:
    a network is written for it as for every other curved road.

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
_INDEX_DIGITS = 3  # of the index of a lane
_DEFAULT_LANE_WIDTH = 3.2  # m, SUMO's
_ONE_PLACE = 0.05  # m: of corners nearer to each other only one is kept: rounding makes them
_LEAST_WAY = 0.1  # m; SUMO has no shorter lane through a junction
PARALLEL = 0.3  # m: largest distance of a lane from its parallel of a curved road's line

# types of junctions for which SUMO needs no <request>
_WITHOUT_RIGHT_OF_WAY = ("dead_end", "district", "internal", "unregulated")
_CARS = {"passenger", "all"}  # SUMO's vehicle classes that include the ego's
# the connections of two edges; the lane through the junction of a lane's first connection
_BETWEEN = ".//connection[@from=$one][@to=$other]"
_VIA = "string((.//connection[@from=$edge][@fromLane=$index])[1]/@via)"

Point = tuple[float, float]
_Course = tuple[Line, list[set[int]], list[float]]
"""How edges lie on a road: (line, places, along).

line: of the road's right-hand lane.
places: for each edge, the places of its lanes on the road, 0 for the road's right-hand lane.
along: begin and end of the first edge along the line, m, begin and end of the next, and so on.
"""


@frozen
class _Lane:
    """A lane of an edge.

    index: SUMO's, from the right.
    width, shape: m; the shape is its centre line on the map.
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
    # SUMO's index of the road's lane 0 on each edge
    first_lanes = [of_edge[0].index - min(it) for of_edge, it in zip(lanes, places, strict=True)]
    # an edge ends where its lanes through the junction begin, or else where the next edge does
    ends = [
        min(own_end, next_begin - _LEAST_WAY) if any(link.ways.values()) else next_begin
        for own_end, next_begin, link in zip(along[1::2], along[2::2], links, strict=False)
    ]
    sections = tuple(zip(along[::2], [*ends, along[-1]], first_lanes, strict=True))
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
        network=replace(network, sections=sections) if straight else None,
        line=line,
        spans=spans,
    )


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
    """Lanes of an edge for cars, at least one, each with a width and a shape."""
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
    """The course of straight edges, along the x axis; None: a lane is not parallel to the first
    one's chord within `STRAIGHT`.
    """
    first = lanes[0][0]
    # a ring, whose chord has no direction
    if dist(first.shape[0], first.shape[-1]) < first.width:
        return None
    begins, places = _laid(lanes)
    for lane in chain(*lanes):
        off = onto_the_line(lane.shape, begins)[:, 1] - places[lane.id] * first.width
        if np.abs(off).max() > STRAIGHT:
            return None
    along = np.ravel([onto_the_line(it[0].shape, begins)[[0, -1], 0] for it in lanes]).tolist()
    return (), [{places[lane.id] for lane in of_edge} for of_edge in lanes], along


def _laid(lanes: _Lanes) -> tuple[Pose, dict[str, int]]:
    """Where the x axis begins on the map, and by its id each lane's place: 0 for the road's
    right-hand lane, which lies on the axis, 1 for the next one to the left.
    """
    # The axis is along the first edge's right-hand lane, which begins at `begins`, or along a lane
    # to the right of it that opens later (`lowest` below 0).
    first = lanes[0][0]
    (x0, y0), (x1, y1) = first.shape[0], first.shape[-1]
    begins = Pose(x0, y0, atan2(y1 - y0, x1 - x0))
    places = {
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

    places, along: as in `_Course`.
    """
    count = max(set().union(*places)) + 1
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
    """The course of curved edges, whose line follows a lane that all of them have.

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
    # where the road's right-hand lane does not exist throughout, its line is the parallel of that
    # of the path's lane, `left` m to the right of it
    left = min(common) * width
    if left > 0.0:
        x, y, _ = map_places(line, drawn_points(line, 0.0, length_of(line), 2.0), -left)
        # x, y and so `beside` are in the frame of `begins`
        line, beside = _line_along(np.column_stack([x, y]), what)
        begins = begins.moved(*beside)
    check_line(line, max(map(max, places)) + 1, width, what)
    _check_parallel(numbered, line, begins, owner)
    return line, places, _edge_ends(path, line, begins)


def _numbered(lanes: _Lanes, links: Sequence[_Link]) -> list[dict[int, _Lane]]:
    """The lanes of each edge by their place on the road, 0 for its right-hand lane."""
    # An edge's shift plus SUMO's index of a lane is the index of the same lane on the first edge;
    # `lowest` is the smallest such sum.
    shifts = list(accumulate((link.shift for link in links), initial=0))
    lowest = min(map(sum, zip(shifts, (of_edge[0].index for of_edge in lanes), strict=True)))
    return [
        {shift + lane.index - lowest: lane for lane in of_edge}
        for shift, of_edge in zip(shifts, lanes, strict=True)
    ]


def _path(
    numbered: Sequence[dict[int, _Lane]], lane: int, links: Sequence[_Link]
) -> list[tuple[Point, ...]]:
    """Centre line of a lane that all edges have: on each edge, and between two of them within
    their junction.

    numbered: lanes of each edge by their place on the road. lane: such a place.
    """
    path = [numbered[0][lane].shape]
    for link, before, after in zip(links, numbered, numbered[1:], strict=False):
        shape = after[lane].shape
        within = link.ways.get(before[lane].index, ())
        path += [(path[-1][-1], *within, shape[0]), shape]
    return path


def _line_along(way: FloatArray, what: str) -> tuple[Line, Pose]:
    """The line along places of a polyline, and where it begins.

    way: (n, 2), m; of places within `_ONE_PLACE` the first counts, and always the last one.
    what: the road, for messages.
    """
    kept = [way[0]]
    for place in way[1:]:
        if dist(place, kept[-1]) > _ONE_PLACE:
            kept.append(place)
    if dist(kept[-1], way[-1]) > 0.0:
        kept.append(way[-1])
    line, begins, off = fitted_line(np.array(kept))
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

    path: of a lane, on each edge and between two of them.
    """
    ends = [shape[end] for shape in path[::2] for end in (0, -1)]
    # length of the path up to each of these ends
    driven = np.cumsum([0.0, *(sum(map(dist, part, part[1:])) for part in path)])
    # a ring passes a place more than once: look for the place near that length, scaled to the line
    near = driven * (length_of(line) / driven[-1])
    x, y = onto_the_line(ends, begins).T
    along: list[float] = frame_places(line, x, y, near=near)[0].tolist()
    return along


class _Link(NamedTuple):
    """Connection of the lanes of an edge to those of the next one.

    shift: index of a lane on the edge less that of its continuation on the next one.
    ways: centre lines within the junction, by the lane's index on the edge before it.
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
    # lane before, lane after, id of the lane through the junction
    indices = [
        (_index(it.get("fromLane", "0"), what), _index(it.get("toLane", "0"), what), it.get("via"))
        for it in connections
    ]
    shifts = Counter(before - after for before, after, _ in indices)
    # the most frequent shift; of equally frequent ones the smallest
    shift = min(shifts, key=lambda it: (-shifts[it], abs(it)))
    ways = {
        before: [it for lane in _lanes_through(root, via) for it in _points(lane.get("shape", ""))]
        for before, after, via in indices
        if before - after == shift
    }
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
        edge, _, index = via.rpartition("_")
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
    for (one, other), (before, after) in zip(
        pairwise(network.edges), pairwise(sections), strict=True
    ):
        for it in root.xpath(_BETWEEN, one=one, other=other):
            # -1 on this side, None on the other: lanes that are not on the road are never equal
            place = places.get(f"{one}_{it.get('fromLane')}", -1)
            if place == places.get(f"{other}_{it.get('toLane')}"):
                _straighten(_lanes_through(root, it.get("via")), place * width, before[1], after[0])
    for location in root.findall("location"):  # the projection, which holds no longer
        root.remove(location)
    return etree.tostring(root.getroottree(), xml_declaration=True, encoding="UTF-8").decode()


def _move(element: Element, axis: Pose) -> None:
    """Move an element's shapes, and a junction's position, into the frame of the x axis."""
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
    """Whether a passenger car may drive on a lane; where SUMO has `allow`, `disallow` is unused."""
    if (allowed := lane.get("allow")) is not None:
        return not _CARS.isdisjoint(allowed.split())
    return _CARS.isdisjoint(lane.get("disallow", "").split())


def _points(text: str) -> tuple[Point, ...]:
    # a height is not used; without a y, "" is refused as a number
    xy = [[*part.split(","), ""] for part in text.split()]
    return tuple((_number(x, "x of a shape"), _number(y, "y of a shape")) for x, y, *_ in xy)


def _number(text: str, what: str) -> float:
    value = number_in(text)
    if isnan(value):
        raise must_be(what, "the network", "a finite number", text)
    return value


def _text(points: Sequence[Point] | FloatArray) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points)
