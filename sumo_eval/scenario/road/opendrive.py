"""A road of an OpenDRIVE file (.xodr): its driving lanes to the right of the reference line, read as they are.

Read: lines, arcs and spirals, one lane section, lanes of constant width. Whatever else shapes a road (polynomials,
lane offsets, widths that change, slopes) is refused by name, and nothing is left out in silence but what has no shape:
marks, objects, signals, speeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.scenario.road.reference_line import Piece, map_places

_JOINT = 0.01  # m and rad that a geometry may begin beside the end of the one before it
_PART = 2.0  # m: a spiral's offset is no spiral, and is drawn in parts of it
_SAME = 1e-6  # m, widths closer than this are one


@dataclass(frozen=True, slots=True)
class ReadRoad:
    """The right-hand driving lane's centre line, how many driving lanes lie beside each other from there, their width
    and the line's length, m.
    """

    line: tuple[Piece, ...]
    lanes: int
    lane_width: float
    length: float


def read_opendrive(path: Path, road: str | None = None) -> ReadRoad:
    """A road of the file by its id; the only one where none is named. Raises InputError with what cannot be read."""
    owner = f"OpenDRIVE file {path.name}"
    try:
        root = etree.fromstring(path.read_bytes(), etree.XMLParser(resolve_entities=False, no_network=True))
    except OSError as error:
        raise InputError(f"OpenDRIVE file {path} cannot be read: {error}.") from error
    except etree.XMLSyntaxError as error:
        raise InputError(f"OpenDRIVE file {path} is not XML: {error}.") from error
    if root.tag != "OpenDRIVE":
        raise must_be("The root", owner, "`OpenDRIVE`", root.tag)
    roads = {str(element.get("id")): element for element in root.iter("road")}
    if road is None and len(roads) != 1:
        raise InputError(f"{owner} has {len(roads)} roads: `opendrive_road` must name one of {', '.join(roads)}.")
    if road is not None and road not in roads:
        raise unknown(f"road of {owner}", road, roads)
    element = roads[road] if road is not None else next(iter(roads.values()))
    owner = f"road `{element.get('id')}` of {owner}"
    reference = reference_line(element, owner)
    offset, lanes, width = _driving_lanes(element, owner)
    line = beside(reference, offset, owner)
    length = sum(piece.length for piece in line)
    bent = any(piece.begin != 0.0 or piece.end != 0.0 for piece in line)
    return ReadRoad(line if bent else (), lanes, width, length)


def _number(element: etree._Element, name: str, owner: str) -> float:
    text = element.get(name, "nothing")
    try:
        value = float(text)
    except ValueError:
        raise must_be(f"`{name}` of <{element.tag}>", owner, "a number", text) from None
    if not math.isfinite(value):
        raise must_be(f"`{name}` of <{element.tag}>", owner, "finite", value)
    return value


def reference_line(road: etree._Element, owner: str) -> tuple[Piece, ...]:
    """The reference line of a <road> in pieces; `owner` names it in sentences."""
    pieces: list[Piece] = []
    begin = None
    for geometry in road.iterfind("planView/geometry"):
        place = tuple(_number(geometry, name, owner) for name in ("x", "y", "hdg"))
        if begin is None:
            begin = place
        _check_joint(pieces, begin, place, owner)
        shape = geometry[0] if len(geometry) else geometry
        kind = str(shape.tag)
        length = _number(geometry, "length", owner)
        if kind == "line":
            ends = 0.0, 0.0
        elif kind == "arc":
            ends = (_number(shape, "curvature", owner),) * 2
        elif kind == "spiral":
            ends = _number(shape, "curvStart", owner), _number(shape, "curvEnd", owner)
        else:
            raise must_be("A <geometry>", owner, "a line, an arc or a spiral", kind)
        pieces.append(Piece(length, *ends))
    if not pieces:
        raise InputError(f"{owner} has no <geometry>.".capitalize())
    return tuple(pieces)


def _check_joint(pieces: list[Piece], begin: tuple[float, ...], place: tuple[float, ...], owner: str) -> None:
    """Each geometry must begin where the ones before it end."""
    s = sum(piece.length for piece in pieces)
    x, y, heading = (float(it) for it in map_places(tuple(pieces), s, 0.0))
    c, n = math.cos(begin[2]), math.sin(begin[2])
    off = math.hypot(begin[0] + x * c - y * n - place[0], begin[1] + x * n + y * c - place[1])
    turned = abs(math.remainder(begin[2] + heading - place[2], math.tau))
    if off > _JOINT or turned > _JOINT:
        raise must_be(
            f"The <geometry> at s = {s:g}", owner, f"where the one before it ends, within {_JOINT:g} m and rad",
            f"{off:.3f} m and {turned:.3f} rad beside it",
        )  # fmt: skip


def _driving_lanes(road: etree._Element, owner: str) -> tuple[float, int, float]:
    """Centre of the right-hand driving lane left of the reference line, m; how many there are, and their width, m."""
    sections = road.findall("lanes/laneSection")
    if len(sections) != 1:
        raise must_be("The lane sections", owner, "one", len(sections))
    for name in ("lanes/laneOffset", "elevationProfile/elevation", "lateralProfile/superelevation"):
        for found in road.iterfind(name):
            if any(float(found.get(key, "0")) != 0.0 for key in "abcd"):
                raise must_be(
                    f"<{found.tag}>",
                    owner,
                    "0 throughout, which is all that is read",
                    etree.tostring(found).decode().strip(),
                )
    offset, driving = 0.0, []
    lanes = sections[0].findall("right/lane")
    for lane in sorted(lanes, key=lambda lane: -int(lane.get("id", "0"))):
        widths = lane.findall("width")
        changes = any(float(width.get(key, "0")) != 0.0 for width in widths for key in "bcd")
        if len(widths) != 1 or changes:
            raise must_be(f"The width of lane {lane.get('id')}", owner, "constant", f"{len(widths)} <width>")
        width = _number(widths[0], "a", owner)
        if lane.get("type") == "driving":
            driving.append((int(lane.get("id", "0")), offset - 0.5 * width, width))
        offset -= width
    if not driving:
        raise InputError(f"{owner} has no driving lane to the right of its reference line.".capitalize())
    numbers, width = [number for number, _, _ in driving], driving[0][2]
    if numbers != list(range(numbers[0], numbers[0] - len(numbers), -1)):
        raise must_be("The driving lanes", owner, "beside each other", numbers)
    if any(abs(other - width) > _SAME for _, _, other in driving):
        raise must_be("The driving lanes", owner, "of one width", [other for _, _, other in driving])
    return driving[-1][1], len(driving), width


def beside(reference: tuple[Piece, ...], offset: float, owner: str) -> tuple[Piece, ...]:
    """The line `offset` m to the left of another: curvature k / (1 - k d), length (1 - k d) ds."""
    found = []
    for piece in reference:
        if max(piece.begin * offset, piece.end * offset) >= 1.0:
            raise must_be("A bend", owner, "wider than its lanes", f"{piece}")
        count = 1 if piece.begin == piece.end else math.ceil(piece.length / _PART)
        rate = (piece.end - piece.begin) / count
        for part in range(count):
            ends = piece.begin + rate * part, piece.begin + rate * (part + 1)
            begin, end = (curvature / (1.0 - curvature * offset) for curvature in ends)
            length, mean = piece.length / count, 0.5 * (ends[0] + ends[1])
            beside = length * (1.0 - mean * offset)
            missing = mean * length / beside - 0.5 * (begin + end)  # so that it turns exactly as far
            found.append(Piece(beside, begin + missing, end + missing))
    return tuple(found)
