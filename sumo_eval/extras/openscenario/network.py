"""The OpenDRIVE file of a scenario: where a place on a road, in a lane, lies on the map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from sumo_eval.errors import InputError, did_you_mean
from sumo_eval.extras.openscenario.reading import Part
from sumo_eval.scenario.road.opendrive import lane_offset, reference_line
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import Piece, bends, length_of
from sumo_eval.scenario.xml_file import read_xml

WIDEST = 6.0  # m: a wider lane is an area without marks
MARKED = 3.5  # m: the lane that the ego is given in such an area


class Lane(NamedTuple):
    """A lane.

    centre: left of the road's reference line, m.
    """

    number: int
    kind: str
    centre: float
    width: float


@dataclass(frozen=True, slots=True)
class MapRoad:
    """A road of an OpenDRIVE file: where it begins, its reference line and its lanes by number."""

    name: str
    begin: Pose
    line: tuple[Piece, ...]
    lanes: dict[int, Lane]

    @property
    def length(self) -> float:
        """Of its reference line, m."""
        return length_of(self.line)

    @property
    def bent(self) -> bool:
        """Whether it is no straight line."""
        return bends(self.line)

    def pose(self, s: float, t: float) -> Pose:
        """The place s m along the reference line and t m to the left of it."""
        return self.begin.along(self.line, s, t)


@dataclass(frozen=True, slots=True)
class Network:
    """The roads of a file by id.

    unread: why a road cannot be read, which nobody minds who is not on it.
    """

    path: Path
    roads: dict[str, MapRoad]
    unread: dict[str, InputError]

    def road(self, name: str, element: Part) -> MapRoad:
        """A road by its id; refused where it is not there, or cannot be read.

        element: what asks for it.
        """
        if name in self.unread:
            raise self.unread[name]
        if name not in self.roads:
            known = [*self.roads, *self.unread]
            raise element.fault(
                f"road `{name}` is not in {self.path.name}.{did_you_mean(name, known)}"
            )
        return self.roads[name]

    def lane(self, road: MapRoad, number: str, element: Part) -> Lane:
        """A lane of a road; refused where it is not there."""
        found = next((lane for lane in road.lanes.values() if _is(lane.number, number)), None)
        if found is None:
            known = ", ".join(str(it) for it in road.lanes)
            raise element.fault(
                f"lane `{number}` is not on road `{road.name}` of {self.path.name}, which has "
                f"{known}"
            )
        return found


def _is(number: int, written: str) -> bool:
    """Whether what is written is a number: `-1`, or `-1.0`."""
    try:
        return float(written) == number
    except ValueError:
        return False


def read_network(path: Path, *, flat: bool = False) -> Network:
    """The roads of an OpenDRIVE file.

    flat: slopes are left out.
    Raises InputError with what cannot be read.
    """
    return _read(path, path.stat().st_mtime_ns, flat)


@lru_cache(maxsize=32)
def _read(path: Path, changed: int, flat: bool) -> Network:
    root = Part(read_xml(path, "OpenDRIVE file"))
    if root.tag != "OpenDRIVE":
        raise root.fault("the root of an OpenDRIVE file must be <OpenDRIVE>")
    roads: dict[str, MapRoad] = {}
    unread: dict[str, InputError] = {}
    for element in root.all(".//road"):
        name = element.attribute("id")
        if name in roads or name in unread:
            raise element.fault(f"there is another road with the `id` {name}")
        try:
            roads[name] = _road(element, name, flat)
        except InputError as error:
            unread[name] = error
    if not roads and not unread:
        raise root.fault("it has no <road>")
    return Network(path, roads, unread)


def _road(element: Part, name: str, flat: bool) -> MapRoad:
    owner = f"road `{name}` of OpenDRIVE file {element.file.name}"
    line, begin = reference_line(element.element, owner)
    sections = element.all("lanes/laneSection")
    if len(sections) != 1:
        raise element.fault(f"it must have one <laneSection>, got {len(sections)}")
    shift = lane_offset(element.element, owner, flat=flat)
    lanes: dict[int, Lane] = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        offset = 0.0
        numbered = [(_lane_number(lane, sign), lane) for lane in sections[0].all(f"{side}/lane")]
        for number, lane in sorted(numbered, key=lambda it: abs(it[0])):
            widths = lane.all("width")
            changes = len(widths) == 1 and any(
                widths[0].decimal(key) for key in "bcd" if widths[0].get(key) is not None
            )
            if len(widths) != 1 or changes:
                raise lane.fault("its width must be one constant")
            if number in lanes:
                raise lane.fault(f"there is another lane with the `id` {number}")
            width = widths[0].decimal("a")
            lanes[number] = Lane(
                number, str(lane.get("type")), shift + sign * (offset + 0.5 * width), width
            )
            offset += width
    return MapRoad(name, begin, line, lanes)


def _lane_number(lane: Part, sign: float) -> int:
    """The `id` of a lane: above 0 to the left of the reference line, below 0 to its right."""
    number = lane.decimal("id")
    if not number.is_integer() or number * sign <= 0.0:
        side = "above" if sign > 0.0 else "below"
        raise lane.fault(f"its `id` must be a whole number {side} 0, got {lane.get('id')}")
    return int(number)
