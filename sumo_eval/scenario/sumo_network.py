"""A straight road inside a SUMO network of the user's: found, checked, and laid along the x axis.

Everything in this package drives along x with the right lane's centre line at y = 0. So the whole network is turned and
moved, as one rigid body, until the chosen edges lie there; its topology stays as it is. Its outermost lanes may begin
and end where edges meet: square, as SUMO has them.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.scenario.concrete import NetworkFile, Road
from sumo_eval.scenario.road.lanes import LaneSpan

STRAIGHT = 0.1  # m that a lane may be off its straight line; netconvert writes centimetres
SPEED_LIMIT = 60.0  # m/s on the driven edges: the scenario says how fast vehicles are, not the network's signs
_DEFAULT_LANE_WIDTH = 3.2  # m, SUMO's

Point = tuple[float, float]
Turn = Callable[[Point], Point]


@dataclass(frozen=True, slots=True)
class _Lane:
    id: str
    index: int
    width: float
    shape: tuple[Point, ...]


def read_road(path: Path, edges: Sequence[str], end: float) -> Road:
    """The road along `edges` of a .net.xml, judged until x = `end`, m from the begin of the first edge.

    Raises InputError where the file is no network, an edge is not in it, or the edges are not one straight road with
    the same lanes throughout.
    """
    path = path.resolve()
    owner = f"network {path.name}"
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"Network {path} cannot be read: {error}.") from error
    network = NetworkFile(str(path), tuple(edges), hashlib.sha256(content).hexdigest())
    root = _parsed(network)
    if not edges:
        raise InputError(f"The road in {owner} must name the `edges` to drive along.")
    by_id = {str(edge.get("id")): edge for edge in root.iter("edge") if not edge.get("function")}
    lanes = []
    for name in edges:
        if name not in by_id:
            raise unknown(f"edge of {owner}", name, by_id)
        lanes.append(_lanes(by_id[name]))
    width = lanes[0][0].width
    if len({lane.width for of_edge in lanes for lane in of_edge}) > 1:
        raise InputError(f"The lanes of edges {', '.join(edges)} of {owner} must have one width.")
    turn, places = _laid(lanes)
    for of_edge in lanes:
        for lane in of_edge:
            off = max(abs(turn(point)[1] - places[lane.id] * width) for point in lane.shape)
            if off > STRAIGHT:
                raise must_be(
                    f"Lane `{lane.id}`", owner, f"straight within {STRAIGHT:g} m of the first", f"{off:.2f} m"
                )
    length = turn(lanes[-1][0].shape[-1])[0]
    count = max(places.values()) + 1
    spans = tuple(span for lane in sorted({0, count - 1}) if (span := _span(lane, edges, lanes, places, turn, owner)))
    for name, of_edge in zip(edges, lanes, strict=True):
        inner = set(range(count)) - {span.lane for span in spans}
        if missing := inner - {places[lane.id] for lane in of_edge}:
            raise must_be(f"Edge `{name}`", owner, "without lanes only on the outside, and not all of one side's",
                          f"none in place {min(missing)}")  # fmt: skip
    if not 0.0 < end <= length:
        raise must_be("The end of the case", owner, f"within the {length:.1f} m of its edges", end)
    return Road(
        name=f"{path.name.removesuffix('.net.xml').removesuffix('.xml')}_{network.sha256[:8]}",
        length=end,
        lanes=count,
        lane_width=width,
        run_out=length - end,
        speed_limit=SPEED_LIMIT,
        network=network,
        spans=spans,
    )


def _laid(lanes: Sequence[Sequence[_Lane]]) -> tuple[Turn, dict[str, int]]:
    """The rigid motion that lays the driven edges along the x axis, the right-hand lane of all on it; and which place
    from the right each lane has, by its id.
    """
    turn, width = _turn(lanes[0][0]), lanes[0][0].width
    places = {lane.id: round(turn(lane.shape[0])[1] / width) for of_edge in lanes for lane in of_edge}
    lowest = min(places.values())

    def moved(point: Point) -> Point:
        x, y = turn(point)
        return x, y - lowest * width

    return (moved if lowest else turn), {lane: place - lowest for lane, place in places.items()}


def _span(
    lane: int, edges: Sequence[str], lanes: Sequence[Sequence[_Lane]], places: dict[str, int], turn: Turn, owner: str
) -> LaneSpan | None:
    """Where an outermost lane is, None where it is throughout."""
    there = [any(places[it.id] == lane for it in of_edge) for of_edge in lanes]
    if all(there):
        return None
    first, last = there.index(True), len(there) - 1 - there[::-1].index(True)
    if not all(there[first : last + 1]):
        gap = edges[first + there[first:].index(False)]
        raise InputError(f"Edge `{gap}` of {owner} must have the outermost lane that edges before and behind it have.")
    begin = turn(lanes[first][0].shape[0])[0] if first else -math.inf
    end = turn(lanes[last][0].shape[-1])[0] if last + 1 < len(there) else math.inf
    return LaneSpan(lane, begin, end)


@functools.lru_cache(maxsize=16)
def laid_along_x(network: NetworkFile) -> str:
    """The network as text, turned and moved so that its driven edges lie along the x axis from x = 0."""
    root = _parsed(network)
    driven = {str(edge.get("id")): edge for edge in root.iter("edge") if edge.get("id") in network.edges}
    of_each = [_lanes(driven[name]) for name in network.edges]
    turn, places = _laid(of_each)
    for element in root.iter():
        for key in ("shape", "customShape"):
            text = element.get(key)
            if text:
                element.set(key, _text(tuple(turn(point) for point in _points(text))))
        if element.tag == "junction" and element.get("x"):
            x, y = turn((float(element.get("x", "0")), float(element.get("y", "0"))))
            element.set("x", f"{x:.4f}")
            element.set("y", f"{y:.4f}")
    for edge in driven.values():
        lanes = _lanes(edge)
        for element, lane in zip(edge.iter("lane"), lanes, strict=True):
            y = places[lane.id] * lane.width  # exactly: the start of every vehicle is checked to a millimetre
            begin, end = lane.shape[0][0], lane.shape[-1][0]
            element.set("shape", _text(((begin, y), (end, y))))
            element.set("length", repr(end - begin))
            element.set("speed", f"{SPEED_LIMIT:g}")
            element.set("width", repr(lane.width))
    location = root.find("location")
    if location is not None:
        corners = [point for lane in root.iter("lane") for point in _points(lane.get("shape", ""))]
        bounds = (
            f"{min(x for x, _ in corners):.2f},{min(y for _, y in corners):.2f},"
            f"{max(x for x, _ in corners):.2f},{max(y for _, y in corners):.2f}"
        )
        for key, value in (
            ("netOffset", "0.00,0.00"), ("convBoundary", bounds), ("origBoundary", bounds), ("projParameter", "!"),
        ):  # fmt: skip
            location.set(key, value)
    return etree.tostring(root.getroottree(), xml_declaration=True, encoding="UTF-8").decode()


def _parsed(network: NetworkFile) -> etree._Element:
    path = Path(network.path)
    try:
        content = path.read_bytes()
        root = etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True))
    except OSError as error:
        raise InputError(f"Network {path} cannot be read: {error}.") from error
    except etree.XMLSyntaxError as error:
        raise InputError(f"Network {path} is not XML: {error}.") from error
    if hashlib.sha256(content).hexdigest() != network.sha256:
        raise InputError(f"Network {path} has changed since its scenario was read.")
    if root.tag != "net":
        raise must_be("The root", f"network {path.name}", "`net`", root.tag)
    return root


def _lanes(edge: etree._Element) -> list[_Lane]:
    return sorted(
        (
            _Lane(
                str(lane.get("id")),
                int(lane.get("index", "0")),
                float(lane.get("width", str(_DEFAULT_LANE_WIDTH))),
                _points(lane.get("shape", "")),
            )
            for lane in edge.iter("lane")
        ),
        key=lambda lane: lane.index,
    )


def _turn(lane: _Lane) -> Turn:
    """The rigid motion that lays a lane along the x axis from the origin."""
    (x0, y0), (x1, y1) = lane.shape[0], lane.shape[-1]
    long = math.hypot(x1 - x0, y1 - y0)
    cos, sin = (x1 - x0) / long, (y1 - y0) / long

    def turn(point: Point) -> Point:
        x, y = point[0] - x0, point[1] - y0
        return x * cos + y * sin, y * cos - x * sin

    return turn


def _points(text: str) -> tuple[Point, ...]:
    return tuple((float(part.split(",")[0]), float(part.split(",")[1])) for part in text.split())


def _text(points: Sequence[Point]) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points)
