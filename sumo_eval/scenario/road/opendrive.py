"""Reader of a road of an OpenDRIVE file (.xodr): of the driving lanes on one side of its reference
line.

The tables of scenario files call `read_opendrive`; readers of OpenSCENARIO's networks call
`reference_line`, `lane_offset`, `beside`, `left_out` and the like.

Read: lines, arcs, spirals and parametric cubics, a constant lane offset, lanes of constant width,
    lane sections in which the outermost lane opens or ends along a straight edge, and several roads
    in order, as through a junction.
Refused, each by its name: anything else that shapes a road, as slopes, and lane offsets and other
    widths that change.
Left out: content without shape on the plane. `left_out` names objects, signals, speed limits,
    heights of single lanes and the like; marks are left out silently.

Users: `extras/openscenario/frame.py`, `extras/openscenario/network.py`, `scenario/file_tables.py`.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial
from math import atan2, ceil, hypot, inf, isnan
from pathlib import Path
from typing import Any, NamedTuple

from lxml import etree

from sumo_eval.errors import InputError, check_known, doubled, must_be
from sumo_eval.scenario.road.lanes import LaneSpan, missing
from sumo_eval.scenario.road.parametric import Cubic, pieces_along
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import Line, Piece, bends, length_of, piece_of_file
from sumo_eval.scenario.xml_file import Element, read_xml
from sumo_eval.text import capitalised, number_in

_JOINT = 0.01  # m and rad: largest distance of a geometry from the end of the one before it
# m: the parallel of a spiral is not a spiral; it is made of spirals of at most this length
_PART = 2.0
_SAME = 1e-6  # m: widths closer than this count as equal
# m: error of a width that linear changes may have; a slope in the file has six decimals, an error
# of 1e-4 m after 200 m
_SLOPE_ERROR = 1e-4
_MEETS = 0.05  # m and rad: largest distance of a road from the end of the one before, in a chain
_MOST_ROADS = 8  # of a chain: several roads that are driven in order
_Knots = list[tuple[float, float]]
"""Widths of a lane along the road: (s, m, width there, m); linear from knot to knot."""
_Types = list[tuple[float, float, str]]
"""Types of a lane along the road, section by section: (begin of the section, its end, s in m, the
lane's type).
"""
_LEFT_OUT = {
    "objects": "objects/*", "signals": "signals/*", "road surface": "surface/*",
    "speed limits": ".//speed", "heights of lanes": ".//lane/height", "rules of lanes": ".//access",
}  # fmt: skip
"""Contents of a road that have no effect: words for them -> their XPath below the road."""
DRIVEN = ("driving", "entry", "exit", "onRamp", "offRamp")  # types of lanes that cars use


class ReadRoad(NamedTuple):
    """A road as read, driven one way.

    line: centre line of the right-hand driving lane; empty if it is straight.
    lanes: number of adjacent driving lanes.
    lane_width, length: m.
    spans: of the lanes that do not exist throughout.
    begin: where the line begins on the map.
    left_out: words for contents of the file that have no effect.
    """

    line: Line
    lanes: int
    lane_width: float
    spans: tuple[LaneSpan, ...]
    length: float
    begin: Pose = Pose(0.0, 0.0, 0.0)
    left_out: tuple[str, ...] = ()


def read_opendrive(path: Path, road: str | Sequence[str] | None = None) -> ReadRoad:
    """Read one road of the file, or several that are driven in order.

    road: an id, or several; None: the only road of the file. One is driven along its reference
        line, or against it if all driving lanes are to the left. Each of several is driven in the
        direction in which it meets the one before.

    Raises InputError for content that is not supported.
    """
    owner = f"OpenDRIVE file {path.name}"
    root = read_xml(path, "OpenDRIVE file")
    if root.tag != "OpenDRIVE":
        raise must_be("The root", owner, "`OpenDRIVE`", root.tag)
    elements = list(root.iter("road"))
    roads = {str(element.get("id")): element for element in elements}
    if double := doubled([str(element.get("id")) for element in elements]):
        raise must_be("The `id` of a road", owner, "its own", double[0])
    if road is None and len(roads) != 1:
        raise InputError(
            f"{owner} has {len(roads)} roads: `opendrive_road` must name one of {', '.join(roads)}."
        )
    names = [road] if isinstance(road, str) else list(roads if road is None else road)
    check_known(f"road of {owner}", roads, *names)
    if not 0 < len(names) <= _MOST_ROADS:
        raise must_be("The roads to drive along", owner, f"1 to {_MOST_ROADS}", len(names))
    if len(names) == 1:
        single = roads[names[0]]
        against = _driven_sides(single) == ["left"]
        chain = [_stretch(single, f"road `{names[0]}` of {owner}", against=against)]
    else:
        chain = _chain([roads[name] for name in names], owner)
    line = tuple(piece for stretch in chain for piece in stretch.line)
    # number and width of the lanes are the same in the whole chain (`_chain`)
    ignored = dict.fromkeys(words for name in names for words in left_out(roads[name]))
    return chain[0]._replace(
        line=line if bends(line) else (), length=length_of(line), left_out=tuple(ignored)
    )


def left_out(road: Element) -> list[str]:
    """Words for contents of a road that have no effect."""
    return [words for words, path in _LEFT_OUT.items() if road.find(path) is not None]


def _chain(roads: Sequence[Element], owner: str) -> list[ReadRoad]:
    """The roads in order, each in the direction in which it meets the one before it.

    The first road is tried along its own direction, then against it.
    """
    faults: list[InputError] = []
    first, *others = [
        _both_ways(road, f"road `{road.get('id')}` of {owner}", faults) for road in roads
    ]
    for stretch in first:
        chain = [stretch]
        for directions in others:
            chain += [it for it in directions if _meets(chain[-1], it)][:1]
        if len(chain) == len(roads):
            break
    else:  # in both directions of the first road the chain ends too early
        if faults:
            raise faults[0]
        names = " ".join(str(element.get("id")) for element in roads)
        raise InputError(
            f"The driving lanes of the roads {names} of {owner} must meet, each at the end of the "
            "one before."
        )

    where = "where several roads are driven in order"
    for element, stretch in zip(roads, chain, strict=True):
        if stretch.spans:
            name = f"road `{element.get('id')}` of {owner}"
            wanted = f"there throughout, {where}"
            raise must_be("The driving lanes", name, wanted, "one that opens or ends")
    lanes, width = chain[0].lanes, chain[0].lane_width
    if any(it.lanes != lanes or abs(it.lane_width - width) > _SAME for it in chain):
        wanted = f"of one number and width throughout, {where}"
        widths = [(it.lanes, it.lane_width) for it in chain]
        raise must_be("The driving lanes", owner, wanted, widths)
    return chain


def _both_ways(road: Element, owner: str, faults: list[InputError]) -> list[ReadRoad]:
    """A road driven along its reference line and against it, as far as driving lanes lead there.

    faults: receives the fault of a direction that cannot be read. It only matters if the chain
        needs this direction.
    """
    stretches = []
    for side in _driven_sides(road):
        try:
            stretches.append(_stretch(road, owner, against=side == "left"))
        except InputError as fault:
            faults.append(fault)
    return stretches


def _driven_sides(road: Element) -> list[str]:
    """Sides of a road's reference line with driving lanes: `right` first, then `left`."""
    sides = []
    for side in ("right", "left"):
        lanes = road.iterfind(f"lanes/laneSection/{side}/lane")
        if any(lane.get("type") in DRIVEN for lane in lanes):
            sides.append(side)
    return sides


def _meets(before: ReadRoad, road: ReadRoad) -> bool:
    """Whether a road begins at the end of another."""
    end = before.begin.along(before.line, before.length)
    return max(end.off(road.begin)) <= _MEETS


def _stretch(road: Element, owner: str, *, against: bool) -> ReadRoad:
    """A road driven along its reference line, or against it on its left-hand lanes."""
    rule = road.get("rule", "RHT")  # right-hand traffic
    if rule != "RHT":
        raise must_be("`rule`", owner, "RHT: left-hand traffic is not supported", rule)
    reference, begin = reference_line(road, owner)
    if against:
        begin, reference = begin.backward(reference)
    offset, lanes = _driving_lanes(road, owner, length_of(reference), against=against)
    line = beside(reference, offset, owner)
    number, width, spans = lanes
    return ReadRoad(line, number, width, spans, length_of(line), begin.moved(0.0, offset))


def _number(owner: str, element: Element, name: str, default: float | None = None) -> float:
    """A finite number in an attribute; `default` counts where it is missing."""
    text = element.get(name)
    if text is None and default is not None:
        return default
    value = number_in(text)
    if isnan(value):
        raise must_be(f"`{name}` of <{element.tag}>", owner, "a finite number", text or "nothing")
    return value


_CURVATURES = {
    "line": (), "arc": ("curvature", "curvature"), "spiral": ("curvStart", "curvEnd"),
}  # fmt: skip
"""By tag of a geometry: its attributes with the curvature at its beginning and at its end."""


def reference_line(road: Element, owner: str) -> tuple[Line, Pose]:
    """The pieces of a reference line, and where it begins on the map."""
    pieces: list[Piece] = []
    geometries = road.findall("planView/geometry")
    if not geometries:
        raise InputError(f"{capitalised(owner)} has no <geometry>.")
    poses = [
        Pose(*(_number(owner, geometry, name) for name in ("x", "y", "hdg")))
        for geometry in geometries
    ]
    for geometry, pose in zip(geometries, poses, strict=True):
        # each geometry must begin where the ones before it end
        s = length_of(pieces)
        off = poses[0].along(pieces, s).off(pose)
        _check_near(f"The <geometry> at s = {s:g}", owner, "where the one before it ends", *off)
        pieces += _pieces(geometry, owner)
    return tuple(pieces), poses[0]


def _pieces(geometry: Element, owner: str) -> list[Piece]:
    """The pieces of a <geometry>."""
    # an empty <geometry> counts as its own shape: its tag is refused below
    shape = next(geometry.iterfind("*"), geometry)
    kind = str(shape.tag)
    length = _number(owner, geometry, "length")
    if kind == "paramPoly3":
        return pieces_along(_cubic(shape, length, owner), length, owner)
    if kind not in _CURVATURES:
        raise must_be("A <geometry>", owner, "a line, an arc, a spiral or a paramPoly3", kind)
    ends = (_number(owner, shape, name) for name in _CURVATURES[kind])
    return [piece_of_file(capitalised(owner), length, *ends)]


def _cubic(shape: Element, length: float, owner: str) -> Cubic:
    """The curve of a <paramPoly3>, which must begin where its geometry begins, in its direction.

    length: of the geometry, m.
    """
    # aU, bU, cU, dU, then aV, bV, cV, dV
    along, left = (
        tuple(_number(owner, shape, f"{letter}{axis}") for letter in "abcd") for axis in "UV"
    )
    kinds = {"arcLength": length, "normalized": 1.0}  # the parameter's value at the end
    kind = shape.get("pRange", "normalized")
    check_known(f"`pRange` of <paramPoly3> of {owner}:", kinds, kind)
    off = hypot(along[0], left[0])
    turned = abs(atan2(left[1], along[1]))
    what = "one that begins at its <geometry>"
    _check_near("A <paramPoly3>", owner, what, off, turned)
    return Cubic(along, left, kinds[kind])


def _check_near(what: str, owner: str, must: str, off: float, turned: float) -> None:
    """Refuse a curve that begins `off` m and `turned` rad off its place, beyond `_JOINT`."""
    if max(off, turned) > _JOINT:
        got = f"{off:.3f} m and {turned:.3f} rad off"
        raise must_be(what, owner, f"{must}, within {_JOINT:g} m and rad", got)


PROFILES = (
    "elevationProfile/elevation",
    "lateralProfile/superelevation",
    "lateralProfile/crossfall",
    "lateralProfile/shape",
)
"""Elements that give a road height (the first) and tilt, which the plane of the map does not have.
"""
SURFACE = "lateralProfile/crossSectionSurface"  # heights across a road, also not on the plane


def constant(cubics: Sequence[tuple[float, ...]], length: float) -> bool:
    """Whether cubics (start s, a, b, c, d) have the value a of the first over a length, within
    `_SAME`.

    It uses an upper bound: the sum of the absolute values of all terms at `length`.
    """
    for _, a, *rest in cubics:
        change = sum(abs(factor) * length**power for power, factor in enumerate(rest, 1))
        if not abs(a - cubics[0][1]) + change <= _SAME:
            return False
    return True


def cubics_of(
    entries: Sequence[Any], place: str, number: Callable[[Any, str, float | None], float]
) -> list[tuple[float, ...]]:
    """Cubics (start s, a, b, c, d) of elements, for `constant`.

    entries: the elements. place: their attribute with the start.
    number: function (element, attribute, default) that reads a number; without a default (None) the
        attribute must be there.
    """
    keys = place, *"abcd"
    return [tuple(number(it, key, None if key == "a" else 0.0) for key in keys) for it in entries]


def lane_offset(road: Element, owner: str, length: float, *, flat: bool = False) -> float:
    """Shift of a level road's lanes to the left of its reference line, m.

    length: of the road, m.
    flat: ignore heights and tilts.

    Raises InputError where the shift or the height changes along the road, or where the road is
    tilted.
    """
    for name in () if flat else PROFILES:
        _constant_value(road, name, owner, length)
    if not flat and road.find(SURFACE) is not None:
        raise must_be("The cross-section", owner, "flat", "<crossSectionSurface>")
    return _constant_value(road, "lanes/laneOffset", owner, length)


def _constant_value(road: Element, name: str, owner: str, length: float) -> float:
    """The value of a profile of a road, which must be constant along it; that of a tilt must be 0.

    name: path of the profile's elements, each with a cubic.
    """
    entries = list(road.iterfind(name))
    cubics = cubics_of(entries, "s", partial(_number, owner))
    is_tilt = name in PROFILES[1:]
    # before its first entry a profile is 0
    from_start = any(start <= 0.0 for start, *_ in cubics)
    value = cubics[0][1] if from_start and not is_tilt else 0.0
    for entry, cubic in zip(entries, cubics, strict=True):
        if not constant([(0.0, value), cubic], length):
            shown = etree.tostring(entry).decode().strip()
            wanted = "0: roads are driven on the plane" if is_tilt else "constant along the road"
            raise must_be(f"<{entry.tag}>", owner, wanted, shown)
    return value


class _Section(NamedTuple):
    """A lane section from s = `begin` to `end`, m, and the lanes of one side, from the inside."""

    begin: float
    end: float
    lanes: list[Element]

    @property
    def driven(self) -> list[int]:
        """Ranks of its driving lanes."""
        return [_rank(lane) for lane in self.lanes if lane.get("type") in DRIVEN]


def _driving_lanes(
    road: Element, owner: str, length: float, *, against: bool
) -> tuple[float, tuple[int, float, tuple[LaneSpan, ...]]]:
    """Where the driving lanes lie, and the lanes: offset, (number, width, spans).

    The offset is from the reference line to the centre of the outermost driving lane, m, to the
    left in the direction of driving. Number and width, m, are those of the driving lanes. The spans
    are that of the outermost driving lane, if it does not exist throughout.

    length: of the reference line, m.
    against: True: the left-hand lanes, driven against the reference line.
    """
    shift = lane_offset(road, owner, length)
    side = "left" if against else "right"
    sections = _sections(road, owner, length, side)
    ranks = _driven_ranks(sections, owner)
    outer = ranks[-1]

    inner_edges, inner_widths = _inner_lanes(sections, outer, owner)
    knots, types = _outermost(sections, outer, owner)
    width = max(value for _, value in knots)
    widths = [*(inner_widths[rank] for rank in ranks[:-1]), width]
    if width <= 0.0 or any(abs(value - width) > _SAME for value in widths):
        raise must_be("The driving lanes", owner, "of one width above 0 m", widths)
    spans = _span_of(knots, width, types, length, owner, against=against)
    if spans and len(ranks) == 1:
        raise must_be("The driving lanes", owner, "at least one that is there throughout", ranks)
    offset = (-shift if against else shift) - (inner_edges[outer] + 0.5 * width)
    return offset, (len(ranks), width, spans)


def _driven_ranks(sections: Sequence[_Section], owner: str) -> list[int]:
    """Ranks of the driving lanes on one side, from the inside, in the section with most of them.

    Raises InputError unless they are adjacent, and every section has all of them, or all but the
    outermost.
    """
    ranks = max((section.driven for section in sections), key=len)
    if not ranks:
        raise InputError(f"{capitalised(owner)} has no driving lane.")
    if ranks != list(range(ranks[0], ranks[0] + len(ranks))):
        raise must_be("The driving lanes", owner, "adjacent", ranks)
    for section in sections:
        if section.driven not in (ranks, ranks[:-1]):
            wanted = f"the same throughout, except the outermost, {ranks[-1]}"
            where = f"{owner} at s = {section.begin:g}"
            raise must_be("The driving lanes", where, wanted, section.driven)
    return ranks


def _sections(road: Element, owner: str, length: float, side: str) -> list[_Section]:
    """The lane sections of a road, with the lanes of a side, `left` or `right`.

    length: of the road, m.
    """
    elements = road.findall("lanes/laneSection")
    if not elements:
        raise must_be("The lane sections", owner, "at least one", 0)
    begins = [_number(owner, it, "s") if len(elements) > 1 else 0.0 for it in elements]
    if begins[0] > _SAME or begins[-1] >= length or begins != sorted({*begins}):
        wanted = f"growing from 0 to less than {length:g} m, the length of the road"
        raise must_be("`s` of the lane sections", owner, wanted, begins)
    return [
        _Section(begin, end, sorted(element.findall(f"{side}/lane"), key=_rank))
        for element, begin, end in zip(elements, begins, [*begins[1:], length], strict=True)
    ]


def _inner_lanes(
    sections: Sequence[_Section], outer: int, owner: str
) -> tuple[dict[int, float], dict[int, float]]:
    """Inner edges and widths of lanes, m, by rank; they must be constant, and the same in every
    section.

    outer: rank of the outermost driving lane. The result has its inner edge, but not its width,
        which may change.
    """
    edges: dict[int, float] = {}  # from the reference line to the inner edge
    widths: dict[int, float] = {}
    for section in sections:
        offset = 0.0  # of the next lane's inner edge
        for lane in section.lanes:
            rank = _rank(lane)
            if rank > outer:
                break
            if rank == outer and lane.get("type") in DRIVEN:
                edges[rank] = offset
                continue
            name = f"lane {lane.get('id')}"
            values = [value for _, value in _widths(lane, section.begin, section.end, owner)]
            width = values[0]
            if max(values) - min(values) > _SAME:
                got = f"{width:g}..{values[-1]:g} m"
                raise must_be(f"The width of {name}", owner, "constant", got)
            # `setdefault` keeps the values of the first section, to compare with
            moved = abs(edges.setdefault(rank, offset) - offset)
            if max(moved, abs(widths.setdefault(rank, width) - width)) > _SAME:
                at = f"{width:g} m at s = {section.begin:g}"
                raise must_be(capitalised(name), owner, "the same in every section", at)
            offset += width
    return edges, widths


def _outermost(sections: Sequence[_Section], outer: int, owner: str) -> tuple[_Knots, _Types]:
    """Widths and types of the outermost driving lane along the road; the width is 0 where the lane
    does not exist.

    outer: its rank.
    """
    knots: _Knots = []
    types: _Types = []
    for begin, end, lanes in sections:
        outermost = [it for it in lanes if _rank(it) == outer and it.get("type") in DRIVEN]
        for lane in outermost:
            knots += _widths(lane, begin, end, owner)
            types.append((begin, end, str(lane.get("type"))))
        if not outermost:
            knots += [(begin, 0.0), (end, 0.0)]
    return knots, types


def _rank(lane: Element) -> int:
    """Rank of a lane from the reference line outwards, from 1 on."""
    number = lane.get("id", "0")
    if not re.fullmatch(r"[+-]?0*[1-9]\d{0,5}", number):
        wanted = "a whole number, beside the reference line not 0"
        raise must_be("The `id`", "a <lane>", wanted, number)
    return abs(int(number))


def _widths(lane: Element, begin: float, end: float, owner: str) -> _Knots:
    """Widths of a lane in a section.

    begin, end: s of the section, m.
    """
    knots: _Knots = []
    cubics = cubics_of(lane.findall("width"), "sOffset", partial(_number, owner))
    if not cubics:
        raise InputError(f"Lane {lane.get('id')} of {owner} must have a <width>.")
    ends = [*(begin + offset for offset, *_ in cubics[1:]), end]
    for (offset, a, b, *curved), last in zip(cubics, ends, strict=True):
        first = begin + offset
        # without a and b the cubic must be 0 over the whole stretch
        if not constant([(0.0, 0.0, 0.0, *curved)], last - first):
            raise must_be(
                f"The width of lane {lane.get('id')}", owner, "constant, or linear", "a polynomial"
            )
        knots += [(first, a), (last, a + b * (last - first))]
    return knots


def _span_of(
    knots: _Knots, width: float, types: _Types,
    length: float,
    owner: str, *, against: bool,
) -> tuple[LaneSpan, ...]:  # fmt: skip
    """The span of the outermost lane; () if it exists throughout.

    knots, types: as from `_outermost`.
    width: its full width, m. length: of the road, m.

    The lane must open at most once and end at most once, with its full width in between. It opens
    and ends along a straight edge, or at once.
    """
    whole = [s for s, value in knots if abs(value - width) <= _SAME]  # where it has its full width
    if len(whole) == len(knots):
        return ()
    if against:
        raise must_be(
            "The width of the outermost lane", owner,
            "constant where a road is driven against its direction", [value for _, value in knots],
        )  # fmt: skip

    # from s = `opens` to `begin` the lane opens, from `end` to `closes` it narrows
    gone = [s for s, value in knots if abs(value) <= _SAME]
    begin = min(whole)
    end = max(whole)
    before, behind = [s for s in gone if s <= begin], [s for s in gone if s >= end]
    opens = max(before, default=begin)
    closes = min(behind, default=end)
    for s, value in knots:
        wanted = width * (1.0 - missing(s, opens, begin, end, closes))
        # a lane that opens or ends without a taper has two knots at that s, one of them 0 m wide
        at_once = s in (begin, end) and abs(value) <= _SAME
        if abs(value - wanted) > _SLOPE_ERROR and not at_once:
            what = "one that opens once and ends once, each along a straight edge"
            raise must_be("The outermost lane", owner, what, f"{value:g} m wide at s = {s:g}")

    # ends of the sections in which it is an on-ramp, begins of those in which it is an exit ramp
    on = [ramp_end for _, ramp_end, kind in types if kind == "onRamp"]
    off = [ramp_begin for ramp_begin, _, kind in types if kind == "offRamp"]
    from_start = not before and begin <= _SAME
    to_end = not behind and end >= length - _SAME
    return (
        LaneSpan(
            lane=0,
            begin=-inf if from_start else begin,
            end=inf if to_end else end,
            opening=begin - opens,
            closing=closes - end,
            parted_until=max(on, default=-inf) if from_start else -inf,
            parted_from=min(off, default=inf) if to_end else inf,
        ),
    )


def beside(reference: Line, offset: float, owner: str) -> Line:
    """The line `offset` m to the left of another.

    A piece of length ds and curvature k becomes a piece of length (1 - k offset) ds and curvature
    k / (1 - k offset).
    """
    pieces = []
    for piece in reference:
        sharpest = max(piece.begin * offset, piece.end * offset)
        if sharpest >= 1.0:
            wanted = f"above {abs(offset):g} m, the distance of its lane from the reference line"
            got = f"{abs(offset) / sharpest:g} m"
            raise must_be("The radius of a curve", owner, wanted, got)
        count = 1 if piece.begin == piece.end else ceil(piece.length / _PART)
        rate = (piece.end - piece.begin) / count
        for part in range(count):
            # of a part of the reference line: curvatures at both ends, length, mean curvature
            ends = piece.begin + rate * part, piece.begin + rate * (part + 1)
            length, mean = piece.length / count, 0.5 * (ends[0] + ends[1])
            # of the parallel
            begin, end = (curvature / (1.0 - curvature * offset) for curvature in ends)
            own_length = length * (1.0 - mean * offset)
            # to add to both curvatures, so that the parallel turns by exactly the same angle
            correction = mean * length / own_length - 0.5 * (begin + end)
            pieces.append(Piece(own_length, begin + correction, end + correction))
    return tuple(pieces)
