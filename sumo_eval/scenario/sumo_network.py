"""A straight road inside a SUMO network of the user's: found, checked, and laid along the x axis.

Everything in this package drives along x with the right lane's centre line at y = 0. So the whole network is turned and
moved, as one rigid body, until the chosen edges lie there; its topology stays as it is.
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
    first = lanes[0]
    turn = _turn(first[0])
    for name, of_edge in zip(edges, lanes, strict=True):
        if [(lane.index, lane.width) for lane in of_edge] != [(lane.index, lane.width) for lane in first]:
            raise InputError(f"Edge `{name}` of {owner} must have the lanes of edge `{edges[0]}`.")
        for lane in of_edge:
            off = max(abs(turn(point)[1] - _centre(of_edge, lane)) for point in lane.shape)
            if off > STRAIGHT:
                raise must_be(
                    f"Lane `{lane.id}`", owner, f"straight within {STRAIGHT:g} m of the first", f"{off:.2f} m"
                )
    if len({lane.width for lane in first}) > 1:
        raise InputError(f"The lanes of edge `{edges[0]}` of {owner} must have one width.")
    length = turn(lanes[-1][0].shape[-1])[0]
    if not 0.0 < end <= length:
        raise must_be("The end of the case", owner, f"within the {length:.1f} m of its edges", end)
    return Road(
        name=f"{path.name.removesuffix('.net.xml').removesuffix('.xml')}_{network.sha256[:8]}",
        length=end,
        lanes=len(first),
        lane_width=first[0].width,
        run_out=length - end,
        speed_limit=SPEED_LIMIT,
        network=network,
    )


@functools.lru_cache(maxsize=16)
def laid_along_x(network: NetworkFile) -> str:
    """The network as text, turned and moved so that its driven edges lie along the x axis from x = 0."""
    root = _parsed(network)
    driven = {str(edge.get("id")): edge for edge in root.iter("edge") if edge.get("id") in network.edges}
    of_first = _lanes(driven[network.edges[0]])
    turn = _turn(of_first[0])
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
            y = _centre(lanes, lane)  # exactly: the start of every vehicle is checked to a millimetre
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


def _centre(lanes: Sequence[_Lane], lane: _Lane) -> float:
    """y of a lane's centre line once the network is laid along x."""
    return lane.index * lanes[0].width


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
