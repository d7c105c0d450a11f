"""The OpenDRIVE file of a scenario: its roads and lanes, and places on them as places of the map.

`scene` reads the file; `places` and `frame` find places on its roads.

Users: `extras/openscenario/drive_numbers.py`, `extras/openscenario/frame.py`,
`extras/openscenario/moves.py`, `extras/openscenario/places.py`, `extras/openscenario/scene.py`.
"""

import math
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from sumo_eval.errors import InputError, did_you_mean
from sumo_eval.extras.openscenario.reading import Node, read_root, watch
from sumo_eval.frozen import frozen
from sumo_eval.scenario.road.opendrive import (
    DRIVEN,
    PROFILES,
    SURFACE,
    constant,
    cubics_of,
    lane_offset,
    left_out,
    reference_line,
)
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import Line, bends, frame_places, length_of

WIDEST = 6.0  # m: a wider lane is an area without marks
MARKED = 3.5  # m: width of the ego's lane in such an area
ON = 1e-6  # m by which a place may miss a road or a line
_ROUNDS = 20  # of the iteration in `ahead_in_lane`, whose result then changes no more


class Lane(NamedTuple):
    """A lane.

    number: `id` in the file, above 0 to the left of the road's reference line, else below 0.
    kind: `type` in the file, as `driving` or `shoulder`.
    centre: distance of the lane's middle from the reference line, to the left, m.
    width: m.
    """

    number: int
    kind: str
    centre: float
    width: float


def in_frame(pose: Pose, begin: Pose, line: Line, near: float | None = None) -> Pose:
    """A place on the map in coordinates along and across a line that starts at `begin`.

    line: pieces of the line; empty: it is straight, in the direction of `begin`.
    near: where to search along the line, as in `frame_places`.
    """
    at = pose.seen_from(begin)
    if not line:
        return at
    return Pose(*(float(it) for it in frame_places(line, *at, near)))


@frozen
class MapRoad:
    """A road of an OpenDRIVE file.

    name: `id` in the file.
    begin: where the reference line begins on the map, and its direction there.
    line: the reference line.
    lanes: of both directions of travel, by number; scenarios also write it as `-1.0`, which is the
        same key.
    left_out: words for contents of the file that have no effect.
    """

    name: str
    begin: Pose
    line: Line
    lanes: dict[float, Lane]
    left_out: tuple[str, ...] = ()

    @property
    def length(self) -> float:
        """Length of the reference line, m."""
        return length_of(self.line)

    @property
    def bent(self) -> bool:
        """Whether the road is curved."""
        return bends(self.line)

    def pose(self, s: float, t: float) -> Pose:
        """The place s m along the reference line and t m to the left of it."""
        return self.begin.along(self.line, s, t)

    def coordinates(self, pose: Pose) -> Pose:
        """s, t and heading, relative to the reference line, of a place on the map."""
        return in_frame(pose, self.begin, self.line if self.bent else ())

    def ahead_in_lane(self, lane: Lane, s: float, length: float) -> float:
        """How far to go along the reference line from s, m, to go `length` m along a lane's middle.

        Where the line turns by an angle, a lane to its left is shorter by the lane's distance times
        this angle. The angle up to the sought place is unknown, so the loop approaches it.
        """
        longer = 0.0
        for _ in range(_ROUNDS if self.bent else 0):
            begin, end = (self.pose(it, 0.0).heading for it in (s, s + length + longer))
            longer = lane.centre * (end - begin)  # not wrapped: a loop turns by a whole circle
        return length + longer

    def lane_at(self, t: float) -> Lane | None:
        """The lane t m to the left of the reference line; None: no lane is there."""
        return next(
            (it for it in self.lanes.values() if abs(t - it.centre) <= 0.5 * it.width), None
        )


@frozen
class Network:
    """The roads of an OpenDRIVE file.

    path, root: of the file.
    roads: by id.
    unread: id -> why this road cannot be read. It is raised only if a road is needed: other roads
        of the file may be of any kind.
    """

    path: Path
    root: Node
    roads: dict[str, MapRoad]
    unread: dict[str, InputError]

    def road(self, name: str, element: Node) -> MapRoad:
        """A road by its id; an InputError if the file has none, or if it cannot be read.

        element: that names the road.
        """
        if name in self.unread:
            raise self.unread[name]
        if name not in self.roads:
            hint = did_you_mean(name, [*self.roads, *self.unread])
            raise element.fault(f"road `{name}` is not in {self.path.name}.{hint}")
        return self.roads[name]

    def driving(self, pose: Pose) -> tuple[MapRoad, Lane, Pose] | None:
        """The road and driving lane in which a place on the map lies, and its s and t there.

        Where roads overlap, as in a junction, it is the road whose line differs least in direction
        from `pose`, whether along or against it; of equal ones the first by name.
        """
        lanes = []  # (sine of the difference of directions, name of the road, result)
        for road in self.roads.values():
            at = road.coordinates(pose)
            lane = road.lane_at(at.y)
            if lane and lane.kind in DRIVEN and -ON <= at.x <= road.length + ON:
                lanes.append((abs(math.sin(at.heading)), road.name, (road, lane, at)))
        return min(lanes)[2] if lanes else None

    def lane(self, road: MapRoad, number: str, element: Node) -> Lane:
        """A lane of a road by its written number, `-1` or `-1.0`; an InputError without one."""
        try:
            return road.lanes[float(number)]
        except (KeyError, ValueError):
            numbers = ", ".join(f"{it:g}" for it in road.lanes)
            raise element.fault(
                f"lane `{number}` is not on road `{road.name}` of {self.path.name}, which has "
                f"{numbers}"
            ) from None


def read_network(path: Path) -> Network:
    """The roads of an OpenDRIVE file, without their slopes.

    Raises InputError for a file without roads or ids. Of a road that cannot be read, the error is
    in `unread`.
    """
    return _read(path, watch(path))


@lru_cache(maxsize=32)
def _read(path: Path, changed: int) -> Network:
    """`read_network`, cached. changed: time of the file's last change, a part of the key."""
    root = read_root(path, "OpenDRIVE")
    roads = {}
    unread = {}
    for element in root.all(".//road"):
        name = element.attribute("id")
        if name in roads or name in unread:
            raise element.fault(f"there is another road with the `id` {name}")
        try:
            roads[name] = _road(element, name)
        except InputError as error:
            unread[name] = error
    if not roads and not unread:
        raise root.fault("it has no <road>")
    return Network(path, root, roads, unread)


def _road(element: Node, name: str) -> MapRoad:
    """The road of a <road>; name: its id."""
    owner = f"road `{name}` of OpenDRIVE file {element.file.name}"
    line, begin = reference_line(element.element, owner)
    sections, length = element.all("lanes/laneSection"), length_of(line)
    if sections and sections[0].number("s", 0.0) != 0.0:
        raise sections[0].fault("the first <laneSection> must begin at s = 0")
    # flat: heights and tilts are looked at below
    shift = lane_offset(element.element, owner, length, flat=True)
    lanes = [_lanes(it, shift, length) for it in sections]
    if not lanes or lanes.count(lanes[0]) < len(lanes):
        must = "its lanes must be the same in every <laneSection>: lanes that begin, end or change"
        raise element.fault(f"{must} are not supported (got {len(sections)} sections)")
    heights, *tilts = (cubics_of(element.all(it), "s", Node.number) for it in PROFILES)
    # level: with one height, whatever it is, and all tilts 0; a 0 before the tilts makes `constant`
    # compare each with 0
    level = constant(heights, length) and constant([(0.0, 0.0), *chain(*tilts)], length)
    widths = [it.width for it in lanes[0].values() if it.kind in DRIVEN]
    # The report names these contents, because an ADS cannot know of them: an ADS overtakes on the
    # left in left-hand traffic too, and lanes of another width than the ego's do not belong to the
    # road on which the case is driven (`frame._lanes`).
    kinds = {
        "elevation": not level or element.all(SURFACE),
        "left-hand traffic": element.get("rule") == "LHT",
        "lanes of another width than the ego's": widths and max(widths) - min(widths) > ON,
        "a road length other than its geometries'": abs(element.number("length", length) - length)
        > 0.1,
        **dict.fromkeys(left_out(element.element), True),
    }
    return MapRoad(name, begin, line, lanes[0], tuple(kind for kind, has in kinds.items() if has))


def _lanes(section: Node, shift: float, length: float) -> dict[float, Lane]:
    """The lanes of a section by number.

    shift: of all lanes to the left, m.
    length: of the road, m.
    """
    lanes: dict[float, Lane] = {}
    for side, sign, must in (("left", 1.0, "above"), ("right", -1.0, "below")):
        edge = 0.0  # m from lane 0 to the inner edge of the next lane
        numbered = [(lane.whole("id"), lane) for lane in section.all(f"{side}/lane")]
        for number, lane in sorted(numbered, key=lambda it: abs(it[0])):
            if number * sign <= 0.0:
                raise lane.fault(f"its `id` must be {must} 0, got {number}")
            if number in lanes:
                raise lane.fault(f"there is another lane with the `id` {number}")
            widths = cubics_of(lane.all("width"), "sOffset", Node.number)
            if not widths or not constant(widths, length) or widths[0][1] < 0.0:
                raise lane.fault("its width must be one constant of at least 0 m")
            width = widths[0][1]
            centre = shift + sign * (edge + 0.5 * width)
            lanes[number] = Lane(number, str(lane.get("type")), centre, width)
            edge += width
    return lanes
