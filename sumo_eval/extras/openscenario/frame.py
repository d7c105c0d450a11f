"""The road of a scenario: a frame along and across the ego's road, and places in that frame.

`scene` makes the frame and places every entity in it.

Users: `extras/openscenario/acts.py`, `extras/openscenario/drive_numbers.py`,
`extras/openscenario/logical.py`, `extras/openscenario/moments.py`,
`extras/openscenario/moves.py`, `extras/openscenario/scene.py`.
"""

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

from sumo_eval.extras.openscenario.network import (
    MARKED,
    ON,
    WIDEST,
    Lane,
    MapRoad,
    Network,
    in_frame,
)
from sumo_eval.extras.openscenario.places import Entity, MapPath
from sumo_eval.scenario.road.opendrive import DRIVEN, beside
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import (
    Line,
    Piece,
    bends,
    curvatures,
    length_of,
    tightest,
)

SAME = 1e-9  # rad, s or m/s: values that differ by less count as equal
ORIGIN = Pose(0.0, 0.0, 0.0)

_beside = lru_cache(maxsize=64)(beside)
"""`opendrive.beside`, cached: a file has the same road at most of its points."""


class Frame(NamedTuple):
    """The road on which the ego drives, as `concrete.Road` has it.

    x is along the frame's line, y to the left of it. The line is the centre of lane 0, the
    rightmost lane.

    origin: where the line begins on the map, and its direction there.
    line: pieces of the line; empty: it is straight.
    lanes: number of lanes.
    lane_width, length: m.
    name: for SUMO and the report.
    offset: of lane 0's centre to the left of the road's reference line in the OpenDRIVE file, m.
    road: id in the OpenDRIVE file.
    way: 1 where the ego drives along this reference line, -1 against it.
    turns: whether the line is the path of an ego that turns, instead of a lane.
    """

    origin: Pose
    line: Line
    lanes: int
    lane_width: float
    length: float
    name: str
    offset: float
    road: str
    way: int = 1
    turns: bool = False

    @property
    def shape(self) -> tuple[object, ...]:
        """The properties in which roads differ."""
        return self.line, self.lanes, self.lane_width, round(self.length, 6)

    def ground(self, at: Pose) -> float:
        """Metres over the ground at a place beside the line, for each metre along the line.

        In a curve this is below 1 on the inner side, above 1 on the outer side.
        """
        if not self.line or self.turns:
            return 1.0
        return 1.0 - float(curvatures(self.line, at.x)) * at.y

    def pose_on_map(self, entity: Entity) -> Pose:
        """The centre of an entity's body on the map as seen from `origin`, and its direction along
        the entity's path. On a straight road this is its pose in the frame.
        """
        pose = entity.placed().pose._replace(heading=entity.heading)
        return pose.moved(entity.centre, entity.offset).seen_from(self.origin)


def frame_of(ego: Entity, network: Network, course: MapPath | None, end: Pose | None) -> Frame:
    """The road on which an ego drives.

    course: the ego's trajectory; None: the ego does not turn.
    end: of the ego's route, up to which a straight road is lengthened; None: no route.
    """
    spot = ego.placed()
    road, lane, way = spot.road, spot.lane, spot.way
    if not (road and lane):
        raise ego.element.fault(f"the ego must be placed in a driving lane{spot.reason}")
    if way == 0:
        raise ego.element.fault("the ego must start along its lane")
    # a lane wider than WIDEST is an area without marks: it becomes a lane of the usual width around
    # the ego's line, and one to its left
    marked = lane.width <= WIDEST
    width = lane.width if marked else MARKED
    if course:
        return _turning(ego, road, width, network.path.stem, course)
    centre, lanes = _lanes(ego, road, lane, way) if marked else (lane.centre, 2)
    # against the road's reference line, the frame begins at the line's end
    begin, reference = (road.begin, road.line) if way > 0 else road.begin.backward(road.line)
    origin = begin.moved(0.0, way * centre)
    name = f"{network.path.stem}_{road.name}_{lanes}x{width:g}m_at_{centre:g}m"
    name += "_back" if way < 0 else ""
    line: Line = ()
    length = road.length
    if road.bent:
        line = _beside(reference, way * centre, f"road `{road.name}` of {network.path.name}")
        length = length_of(line)
    elif end:
        length = max(length, end.seen_from(origin).x)
    return Frame(origin, line, lanes, width, length, name, centre, road.name, way)


def _lanes(ego: Entity, road: MapRoad, own: Lane, way: int) -> tuple[float, int]:
    """The frame's lanes: the centre of the rightmost one, m, and their number.

    They are the ego's own lane and all driving lanes of its width that adjoin it without a gap.

    own: the ego's lane.
    way: as in `Frame`; lanes to the right have smaller `way * centre`.
    """
    driving = sorted(
        (it for it in road.lanes.values() if it.kind in DRIVEN),
        key=lambda it: way * it.centre,
    )
    if own not in driving:
        raise ego.element.fault(
            f"the ego's lane {own.number} must be a driving lane, it is `{own.kind}`"
        )
    # whether each lane adjoins the next one to its left
    adjoin = [abs(abs(b.centre - a.centre) - own.width) < ON for a, b in pairwise(driving)]
    first = last = driving.index(own)
    while first > 0 and adjoin[first - 1]:
        first -= 1
    while last < len(adjoin) and adjoin[last]:
        last += 1
    return driving[first].centre, last - first + 1


def _turning(ego: Entity, road: MapRoad, width: float, network: str, course: MapPath) -> Frame:
    """The road of an ego that turns: its path, one lane wide, from the beginning of its road on.

    At a junction no lane lies beside a path, and crossing actors use map coordinates.

    network: name of the OpenDRIVE file.
    course: the ego's trajectory.
    """
    spot = ego.placed()
    origin = road.pose(0.0, spot.t)
    pose = spot.pose.seen_from(origin)
    if road.bent or abs(pose.y) > ON or abs(pose.heading) > SAME:
        raise ego.element.fault("an ego that turns must begin along a straight road")
    if ego.offset != 0.0:
        raise ego.element.fault("the body of an ego that turns must lie over its axle's middle")
    line = course.pieces
    if pose.x > ON:
        # a straight piece leads from the road's beginning to the path, which may begin straight
        first, *rest = line
        straight = not bends([first])
        lead = Piece(pose.x + first.length if straight else pose.x)
        line = (lead, *(rest if straight else line))
    name = f"{network}_{road.name}_turn_{tightest(line):g}m"
    return Frame(origin, line, 1, width, length_of(line), name, spot.t, road.name, turns=True)


def framed(entity: Entity, frame: Frame) -> Pose:
    """The centre of an entity's body along and across the frame's road, and its heading there."""
    spot = entity.placed()
    road, way = spot.road, spot.way
    # 1. a path that is straight on the map
    if entity.on_map:
        return in_frame(frame.pose_on_map(entity), ORIGIN, frame.line)
    pose = spot.pose.moved(entity.centre, entity.offset)
    # 2. the ego that turns, on its line
    if frame.turns:
        return pose.seen_from(frame.origin)._replace(y=0.0)
    # 3. on a straight road: along the ego's road, in its direction, the heading is exactly 0
    along = road and road.name == frame.road
    if not frame.line:
        at = pose.seen_from(frame.origin)
        return at._replace(heading=0.0) if along and way == frame.way else at
    # 4. on a curved road: the body of an entity that points along it lies ahead along the curve
    assert road is not None  # without a road it drives on the map, see 1
    if way:
        pose = road.pose(spot.s + way * entity.centre, spot.t + way * entity.offset)
    # about x: where the search for the foot of the perpendicular on the line begins
    near = spot.s + entity.centre if frame.way > 0 else road.length - spot.s
    x, y, heading = in_frame(pose, frame.origin, frame.line, near)
    if way:
        heading = 0.0 if way == frame.way else math.pi
    return Pose(x, 0.0 if abs(y) < ON else y, heading)
