"""A road inside a user's SUMO network: found, checked, and laid along the x axis.

The tables of scenario files call `read_road`, and `cosim.sumo` writes what `laid_along_x` returns.
All vehicles drive along x with the right lane's centre line at y = 0.

Straight edges: the whole network is turned and moved, as one rigid body, until they lie there. Its
    topology does not change.
Curved edges: `fitted_line` finds the line along their lanes. Only the road along this line counts:
    a network is written for it as for every other curved road.

The outermost lanes may begin and end where edges meet, without a taper, as in SUMO.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from lxml import etree

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.input_file import LARGEST, hash_of
from sumo_eval.scenario.concrete import NetworkFile, Road
from sumo_eval.scenario.road.fitted_line import WITHIN, fitted_line, onto_the_line
from sumo_eval.scenario.road.lanes import LaneSpan
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import (
    Piece,
    drawn_points,
    frame_places,
    length_of,
    map_places,
)
from sumo_eval.scenario.road.table import bend_name, check_line
from sumo_eval.scenario.xml_file import read_xml
from sumo_eval.text import number_in, shown
from sumo_eval.trajectory import FloatArray

STRAIGHT = 0.1  # m that a lane may be off its straight line; netconvert writes centimetres
# m/s on the driven edges: the scenario says how fast vehicles are, not the network's signs
SPEED_LIMIT = 60.0
_INDEX_DIGITS = 3  # of the index of a lane
_DEFAULT_LANE_WIDTH = 3.2  # m, SUMO's
_ONE_PLACE = 0.05  # m: corners nearer than that are netconvert's rounding
PARALLEL = 0.3  # m that a lane may be off its distance from the line of a curved road

# types of junctions for which SUMO needs no <request>
_WITHOUT_RIGHT_OF_WAY = ("dead_end", "district", "internal", "unregulated")
_CARS = {"passenger", "all"}  # SUMO's vehicle classes that include the ego's

Point = tuple[float, float]
RigidMotion = Callable[[Point], Point]


@dataclass(frozen=True, slots=True)
class _Lane:
    """A lane of an edge.

    index: SUMO's, from the right.
    width, shape: m; the shape is its centre line on the map.
    """

    id: str
    index: int
    width: float
    shape: tuple[Point, ...]


def read_road(path: Path, edges: Sequence[str], end: float) -> Road:
    """Read a road of a SUMO network.

    path: of the .net.xml.
    edges: ids of the edges to drive along, in order.
    end: x at which cases end, m from the start of the first edge.

    Raises InputError where the file is not a network, an edge is not in it, or the edges are not
    one road: lanes of one width, the same on all edges except the outermost of each side.
    """
    path = path.resolve()
    owner = f"network {path.name}"
    network = NetworkFile(str(path), tuple(edges), hash_of(path, "network"))
    root = _parsed(network)
    if not edges:
        raise InputError(f"The road in {owner} must name the `edges` to drive along.")
    by_id = {
        str(edge.get("id")): edge
        for edge in root.iter("edge")
        if edge.get("function", "normal") == "normal"
    }
    check_known(f"edge of {owner}", by_id, *edges)
    lanes = [_checked_lanes(by_id[name], owner) for name in edges]  # of each edge
    network = replace(network, first_lane=lanes[0][0].index)
    width = lanes[0][0].width
    if any(lane.width != width for of_edge in lanes for lane in of_edge):
        widths = ", ".join(f"{lane.id} {lane.width:g} m" for of_edge in lanes for lane in of_edge)
        raise InputError(
            f"The lanes of edges {', '.join(edges)} of {owner} must have one width, got {widths}."
        )
    _check_junctions(root, [by_id[name] for name in edges[1:]], owner)
    links = [_links(root, one, other, owner) for one, other in itertools.pairwise(edges)]
    stem = path.name.removesuffix(".net.xml").removesuffix(".xml")
    if not _is_straight(lanes):
        return _bent_road(root, network, lanes, links, end, stem)

    to_axis, places = _laid(lanes)
    begins = [to_axis(of_edge[0].shape[0])[0] for of_edge in lanes]
    ends = [to_axis(of_edge[0].shape[-1])[0] for of_edge in lanes]
    places_of_edges = [{places[lane.id] for lane in of_edge} for of_edge in lanes]
    spans = _spans(edges, places_of_edges, begins, ends, owner)
    _check_end(end, ends[-1], owner)
    return Road(
        name=f"{stem}_{network.sha256[:8]}",
        length=end,
        lanes=max(places.values()) + 1,
        lane_width=width,
        run_out=ends[-1] - end,
        speed_limit=SPEED_LIMIT,
        network=network,
        spans=spans,
    )


def _checked_lanes(edge: etree._Element, owner: str) -> list[_Lane]:
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


def _laid(lanes: Sequence[Sequence[_Lane]]) -> tuple[RigidMotion, dict[str, int]]:
    """How driven edges are laid along the x axis.

    lanes: of each edge.

    Gives the rigid motion that does it, and each lane's place by its id: 0 for the road's
    right-hand lane, which comes to lie on the axis, 1 for the next one to the left.
    """
    # at first y = 0 is the first edge's right-hand lane; lanes to the right of it may open later
    to_axis, width = _onto_x(lanes[0][0]), lanes[0][0].width
    places = {
        lane.id: round(to_axis(lane.shape[0])[1] / width) for of_edge in lanes for lane in of_edge
    }
    lowest = min(places.values())

    def moved(point: Point) -> Point:
        x, y = to_axis(point)
        return x, y - lowest * width

    return (moved if lowest else to_axis), {lane: place - lowest for lane, place in places.items()}


def _spans(
    edges: Sequence[str],
    there: Sequence[set[int]],
    begins: Sequence[float],
    ends: Sequence[float],
    owner: str,
) -> tuple[LaneSpan, ...]:
    """Spans of outermost lanes that do not exist throughout.

    there: places of each edge's lanes, 0 for the road's right-hand lane.
    begins, ends: of each edge along the road, m.
    """
    count = max(set().union(*there)) + 1
    spans = []
    for lane in sorted({0, count - 1}):
        with_lane = [number for number, places in enumerate(there) if lane in places]
        if len(with_lane) == len(edges):
            continue
        first, last = with_lane[0], with_lane[-1]
        if gaps := set(range(first, last)) - set(with_lane):
            raise InputError(
                f"Edge `{edges[min(gaps)]}` of {owner} must have the outermost lane that edges "
                "before and behind it have."
            )
        begin = begins[first] if first > 0 else -math.inf
        end = ends[last] if last + 1 < len(edges) else math.inf
        spans.append(LaneSpan(lane, begin, end))

    throughout = set(range(count)) - {span.lane for span in spans}
    for name, places in zip(edges, there, strict=True):
        if missing := throughout - places:
            must = "as wide as the road, except the outermost lane of each side"
            raise must_be(
                f"Edge `{name}`", owner, must, f"no lane {min(missing)} (0: the right one)"
            )
    return tuple(spans)


def _check_junctions(root: etree._Element, edges: Sequence[etree._Element], owner: str) -> None:
    """Refuse junctions at which SUMO crashes: with incoming lanes, but no right of way.

    edges: those that begin at the junctions in question.
    """
    begins = {edge.get("from") for edge in edges}
    for junction in root.iter("junction"):
        incoming = junction.get("id") in begins and junction.get("incLanes")
        regulated = junction.get("type") not in _WITHOUT_RIGHT_OF_WAY
        if incoming and regulated and junction.find("request") is None:
            raise InputError(
                f"Junction `{junction.get('id')}` of {owner} must have a <request> for each of its "
                "connections, as netconvert writes it, or be of type `unregulated`: it has none."
            )


def _check_end(end: float, length: float, owner: str) -> None:
    if not 0.0 < end <= length:
        raise must_be("The end of the case", owner, f"within the {length:.1f} m of its edges", end)


def _is_straight(lanes: Sequence[Sequence[_Lane]]) -> bool:
    """Whether all lanes are parallel to the first one's chord, within `STRAIGHT`."""
    first, width = lanes[0][0], lanes[0][0].width
    if math.dist(first.shape[0], first.shape[-1]) < width:  # a ring, whose chord has no direction
        return False
    to_axis, places = _laid(lanes)
    return all(
        abs(to_axis(point)[1] - places[lane.id] * width) <= STRAIGHT
        for of_edge in lanes for lane in of_edge for point in lane.shape
    )  # fmt: skip


# -- a curved road ---------------------------------------------------------------------------------


def _bent_road(
    root: etree._Element,
    network: NetworkFile,
    lanes: Sequence[Sequence[_Lane]],
    links: Sequence[_Link],
    end: float,
    stem: str,
) -> Road:
    """The road along curved edges: its line follows a lane that all of them have.

    lanes: of each edge. links: from each edge to the next one.
    end: x at which cases end, m. stem: beginning of the road's name.
    """
    edges, width, owner = network.edges, lanes[0][0].width, f"network {Path(network.path).name}"
    # lanes are numbered as on the first edge: by SUMO's index plus the shift of their edge
    shifts = list(itertools.accumulate((link.shift for link in links), initial=0))
    there = [
        {shift + it.index for it in of_edge} for shift, of_edge in zip(shifts, lanes, strict=True)
    ]
    common = set.intersection(*there)
    if not common:
        raise InputError(f"The edges of {owner} must have a lane that goes through all of them.")
    lane, lowest = min(common), min(set().union(*there))

    # shapes of the common lane: on each edge, and of its lanes within junctions from edge to edge
    shapes = [
        it.shape
        for shift, of_edge in zip(shifts, lanes, strict=True)
        for it in of_edge
        if it.index + shift == lane
    ]
    between = [
        tuple(p for name in link.vias.get(lane - shift, ()) for p in _shape(root, name))
        for link, shift in zip(links, shifts, strict=False)
    ]
    parts = [shapes[0]]
    for via, shape in zip(between, shapes[1:], strict=True):
        parts += [(parts[-1][-1], *via, shape[0]), shape]
    way = [place for part in parts for place in part]
    what = f"the road along {', '.join(edges)} of {owner}"
    line, begins = _line_along(np.array(way), what)
    # the road's right-hand lane does not exist throughout, and is parallel to the common lane
    if lane > lowest:
        s = drawn_points(line, 0.0, length_of(line), 2.0)
        x, y, _ = map_places(line, s, -width * (lane - lowest))
        line, beside = _line_along(np.column_stack([x, y]), what)
        begins = begins.moved(*beside)
    count = max(set().union(*there)) - lowest + 1
    check_line(line, count, width, what)

    # every lane must be parallel to the line
    for of_edge, shift in zip(lanes, shifts, strict=True):
        for it in of_edge:
            _, across, _ = frame_places(line, *onto_the_line(np.array(it.shape), begins).T)
            off = float(np.abs(across - width * (shift + it.index - lowest)).max())
            if off > PARALLEL:
                raise must_be(
                    f"Lane `{it.id}`",
                    owner,
                    f"beside the first within {PARALLEL:g} m",
                    f"{off:.2f} m",
                )

    # begin and end of each edge along the line; of a place that a ring passes more than once, the
    # one near the distance driven until then
    joints = onto_the_line(np.array([p for shape in shapes for p in (shape[0], shape[-1])]), begins)
    driven = np.cumsum([0.0, *(sum(map(math.dist, part, part[1:])) for part in parts)])
    near = driven * (length_of(line) / driven[-1])
    along = frame_places(line, joints[:, 0], joints[:, 1], near=near)[0].tolist()
    places_of_edges = [{number - lowest for number in of_edge} for of_edge in there]
    spans = _spans(edges, places_of_edges, along[::2], along[1::2], owner)
    _check_end(end, along[-1], owner)
    return Road(
        name=f"{stem}_{network.sha256[:8]}{bend_name(line, named=True)}", length=end, lanes=count,
        lane_width=width,
        run_out=along[-1] - end, speed_limit=SPEED_LIMIT, line=line, spans=spans,
    )  # fmt: skip


def _line_along(way: FloatArray, what: str) -> tuple[tuple[Piece, ...], Pose]:
    """The line along places of a polyline, and where it begins.

    way: (n, 2), m; of places within `_ONE_PLACE` the first counts, and always the last one.
    what: the road, for messages.
    """
    kept = [way[0]]
    for place in way[1:]:
        if math.dist(place, kept[-1]) > _ONE_PLACE:
            kept.append(place)
    if math.dist(kept[-1], way[-1]) > 0.0:
        kept.append(way[-1])
    line, begins, off = fitted_line(np.array(kept))
    if off > WITHIN:
        raise must_be(
            "The lanes",
            what,
            f"without corners, so that a line can follow them within {WITHIN:g} m",
            f"{off:.2f} m",
        )
    return line, begins


class _Link(NamedTuple):
    """Connection of the lanes of an edge to those of the next one.

    shift: index of a lane on the edge less that of its continuation on the next one.
    vias: ids of the lanes within the junction, by the index on the edge before it.
    """

    shift: int
    vias: dict[int, tuple[str, ...]]


def _links(root: etree._Element, one: str, other: str, owner: str) -> _Link:
    found = _connections(root, {"from": one, "to": other})
    if not found:
        raise InputError(
            f"Edge `{one}` of {owner} must lead to edge `{other}`: no lane of it does."
        )
    ends = f"A lane of the connection from edge `{one}` to edge `{other}` in {owner}"
    indices = [
        (_index(it.get("fromLane", "0"), ends), _index(it.get("toLane", "0"), ends), it.get("via"))
        for it in found
    ]
    shifts = Counter(before - after for before, after, _ in indices)
    # the one of most lanes; of several the smallest
    shift = min(shifts, key=lambda it: (-shifts[it], abs(it)))
    vias = {before: _vias(root, via) for before, after, via in indices if before - after == shift}
    return _Link(shift, vias)


def _vias(root: etree._Element, via: str | None) -> tuple[str, ...]:
    """Ids of the lanes that lead through a junction, in order.

    via: the first of them; None: there is none.
    """
    found: list[str] = []
    while via is not None and via not in found:  # a faulty network may lead in a circle
        found.append(via)
        edge, _, index = via.rpartition("_")
        further = _connections(root, {"from": edge, "fromLane": index})
        via = further[0].get("via") if further else None
    return tuple(found)


def _connections(root: etree._Element, wanted: dict[str, str]) -> list[etree._Element]:
    """The connections with these attributes."""
    return [it for it in root.iter("connection") if wanted.items() <= set(it.attrib.items())]


def _shape(root: etree._Element, name: str) -> tuple[Point, ...]:
    return next(
        (_points(it.get("shape", "")) for it in root.iter("lane") if it.get("id") == name), ()
    )


# -- a straight road -------------------------------------------------------------------------------


@functools.lru_cache(maxsize=16)
def laid_along_x(network: NetworkFile) -> str:
    """Text of the network, turned and moved so that its driven edges lie along x from x = 0."""
    root = _parsed(network)
    driven = {
        str(edge.get("id")): edge for edge in root.iter("edge") if edge.get("id") in network.edges
    }
    of_each = [_lanes(driven[name]) for name in network.edges]
    to_axis, places = _laid(of_each)
    for element in root.iter():
        for key in ("shape", "customShape"):
            text = element.get(key)
            if text:
                element.set(key, _text(tuple(to_axis(point) for point in _points(text))))
        if element.tag == "junction" and element.get("x"):
            x, y = to_axis((float(element.get("x", "0")), float(element.get("y", "0"))))
            element.set("x", f"{x:.4f}")
            element.set("y", f"{y:.4f}")
    for edge in driven.values():
        elements = {element.get("id"): element for element in edge.iter("lane")}
        for lane in _lanes(edge):  # read again, because their shapes now lie along x
            element = elements[lane.id]
            # y exactly: the start of every vehicle is checked to a millimetre
            y = places[lane.id] * lane.width
            begin, end = lane.shape[0][0], lane.shape[-1][0]
            element.set("shape", _text(((begin, y), (end, y))))
            element.set("length", repr(end - begin))
            element.set("speed", f"{SPEED_LIMIT:g}")
            element.set("width", repr(lane.width))
    for location in root.findall("location"):  # the projection, which holds no longer
        root.remove(location)
    return etree.tostring(root.getroottree(), xml_declaration=True, encoding="UTF-8").decode()


# -- elements of the file --------------------------------------------------------------------------


def _parsed(network: NetworkFile) -> etree._Element:
    path = Path(network.path)
    root = read_xml(path, "Network", LARGEST)
    if hash_of(path, "network") != network.sha256:
        raise InputError(f"Network {path} has changed since its scenario was read.")
    if root.tag != "net":
        raise must_be("The root", f"network {path.name}", "`net`", root.tag)
    return root


def _lanes(edge: etree._Element) -> list[_Lane]:
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


def _carries_cars(lane: etree._Element) -> bool:
    """Whether a passenger car may drive on a lane; where SUMO has `allow`, `disallow` is unused."""
    if (allowed := lane.get("allow")) is not None:
        return not _CARS.isdisjoint(allowed.split())
    return _CARS.isdisjoint(lane.get("disallow", "").split())


def _onto_x(lane: _Lane) -> RigidMotion:
    """The rigid motion that lays a lane's chord along the x axis from the origin."""
    (x0, y0), (x1, y1) = lane.shape[0], lane.shape[-1]
    chord = math.hypot(x1 - x0, y1 - y0)
    cos, sin = (x1 - x0) / chord, (y1 - y0) / chord

    def to_axis(point: Point) -> Point:
        x, y = point[0] - x0, point[1] - y0
        return x * cos + y * sin, y * cos - x * sin

    return to_axis


def _points(text: str) -> tuple[Point, ...]:
    # a height is not used; without a y, "" is refused as a number
    xy = [[*part.split(","), ""] for part in text.split()]
    return tuple((_number(x, "x of a shape"), _number(y, "y of a shape")) for x, y, *_ in xy)


def _number(text: str, what: str) -> float:
    value = number_in(text)
    if math.isnan(value):
        raise must_be(what, "the network", "a finite number", text)
    return value


def _text(points: Sequence[Point]) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points)
