"""Places of OpenSCENARIO on the map: positions, trajectories, routes, and entities with their
places.

The place of an entity is that of its reference point, for a vehicle the middle of its rear axle.
`BoundingBox/Center` gives the body's centre relative to this point. Without an <Orientation> an
entity points towards growing s, even in a left lane, where traffic goes the other way: the UN R157
file with its ego in lane 4 is written so. On a route towards falling s, number and offset of a lane
keep the signs that they have on the road, but t changes its sign.

Users: `extras/openscenario/acts.py`, `extras/openscenario/drive_numbers.py`,
`extras/openscenario/frame.py`, `extras/openscenario/moments.py`, `extras/openscenario/moves.py`,
`extras/openscenario/scene.py`, `extras/openscenario/starts.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.catalogs import Catalogs
from sumo_eval.extras.openscenario.conformity import IGNORED
from sumo_eval.extras.openscenario.earth import on_map
from sumo_eval.extras.openscenario.network import ON, Lane, MapRoad, Network
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.frozen import frozen
from sumo_eval.scenario.played import EGO, ENDED, PATH, Act, Move, Pairs, Program
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import Line, length_of, map_places, piece_of_file

# rad: an entity drives along its lane if their headings differ by less
ALONG = 0.01
# rad, the same for the ego, which must start along its lane, and for headings along a trajectory
EGO_ALONG = 0.1
_FINE = 0.25  # m between two points of a curved trajectory
_STRAIGHT = 0.05  # m that a straight route or trajectory may be off the line through its ends


NOWHERE = Pose(math.nan, math.nan, math.nan)
"""Pose of an entity in the scenario's road while the road is unknown."""


@frozen
class Spot:
    """A place: its pose on the map, and its road, lane, s and t where it lies on a road.

    s, t: along the road's reference line and to the left of it, m.
    way: from `Places.located`: 1: the pose points along this line; -1: against it; 0: neither, or
        on no road.
    reason: from `Places.located`: why the place may be on no road, as the end of an error message
        (`; ...`): a road of the file cannot be read. Empty: all roads can.
    """

    pose: Pose
    road: MapRoad | None = None
    lane: Lane | None = None
    s: float = math.nan
    t: float = math.nan
    way: int = 0
    reason: str = ""

    @property
    def room(self) -> float:
        """Length of the road ahead, m; inf where the place does not point along a road."""
        if not self.road or self.way == 0:
            return math.inf
        return self.road.length - self.s if self.way > 0 else self.s

    def in_lane(self, element: Node) -> tuple[MapRoad, Lane]:
        """Road and lane of the place; an InputError without them.

        element: that is relative to the place.
        """
        if not (self.road and self.lane):
            raise element.fault(f"the entity that it is relative to is in no lane{self.reason}")
        return self.road, self.lane

    def turned(self, way: int) -> Spot:
        """The place, its heading reversed if `way` is -1."""
        heading = self.pose.heading + (math.pi if way < 0 else 0.0)
        return replace(self, pose=self.pose._replace(heading=heading))


class UnplacedError(InputError):
    """A place or a speed depends on an entity whose own place or speed is not known yet.

    entity: its name.
    """

    def __init__(self, message: str, entity: str) -> None:
        super().__init__(message)
        self.entity = entity


class PlannedMove(NamedTuple):
    """A move that was planned as if an entity began no further act of some kinds until a time.

    until: this time, s: when the move begins, or ends if it is over a distance.
    kinds: of these acts.
    fault: what to raise if the entity begins one.
    move: the planned move; once it has ended, the entity may begin one.
    """

    until: float
    kinds: tuple[int, ...]
    fault: InputError
    move: Move


@dataclass(slots=True)
class Entity:
    """A vehicle, a pedestrian or an object. Reading the file fills it in, step by step.

    From its <ScenarioObject>:

    length, width: of its body, m.
    centre, offset: the body's centre ahead of the reference point and to the left of it, m.
    body: as in `concrete.Actor`.
    element: the <ScenarioObject>.
    left_out: tags of its parts that have no effect: limits of a vehicle, a controller, a trailer.

    At the start:

    spot: place of its reference point; None: not known yet.
    speed: m/s.
    waits: number of actions of Init that set this speed and are not done yet.
    path: points on the map of the trajectory that it follows; empty: none.
    frame: the centre of its body along and across the scenario's road, m, and its heading relative
        to the road; `NOWHERE` while the road is unknown.
    deleted: whether it takes no part.
    on_map: whether its path is straight on the map, instead of along the curved road.
    number: its index among the actors, for a `Program`; of the ego `played.EGO`.

    By its moves so far, in the order of the file:

    acts: these moves.
    before, pace: its speed before the last change of speed and after it, m/s.
    steady: end of that change, s.
    moved: its offset to the left of its start, m.
    busy_until: end of its last lateral move, s.
    plans: moves of any entity that were planned from the acts of this entity.
    """

    name: str
    length: float
    width: float
    centre: float
    offset: float
    body: str
    element: Node
    left_out: tuple[str, ...]
    spot: Spot | None = None
    speed: float = 0.0
    path: Pairs = ()
    frame: Pose = NOWHERE
    deleted: bool = False
    on_map: bool = False
    number: int = EGO
    acts: list[Act] = field(default_factory=list)
    waits: int = 0
    pace: float = 0.0
    before: float = 0.0
    steady: float = 0.0
    moved: float = 0.0
    busy_until: float = 0.0
    plans: list[PlannedMove] = field(default_factory=list)

    @property
    def next_move(self) -> Move:
        """Identity of the move that the entity will be given next."""
        return self.number, len(self.acts)

    @property
    def leaves_lane(self) -> bool:
        """Whether its path so far leads across the road, or off it, instead of along a lane."""
        turned = abs(math.sin(self.frame.heading)) > ALONG
        return turned or self.on_map or any(act.kind == PATH for act in self.acts)

    def ended(self) -> Program:
        """The condition that the entity's last move so far has ended."""
        return ((ENDED, self.number, len(self.acts) - 1, 0.0),)

    @property
    def heading(self) -> float:
        """The direction in which the entity drives on the map, rad."""
        if len(self.path) < 2:
            return self.placed().pose.heading
        return _towards(*self.path[:2]).heading

    def placed(self, asks: Node | None = None) -> Spot:
        """The place of the entity's reference point.

        asks: element whose line the error names; None: the entity's own.

        Raises UnplacedError while the place is unknown.
        """
        if not self.spot:
            fault = (asks or self.element).fault(
                f"entity `{self.name}` has no place: it needs a TeleportAction or a trajectory "
                "before the start"
            )
            raise UnplacedError(str(fault), self.name)
        return self.spot


def _towards(begin: tuple[float, float], end: tuple[float, float]) -> Pose:
    """The point `begin` on the map, with the heading from there to `end`."""
    return Pose(*begin, math.atan2(end[1] - begin[1], end[0] - begin[0]))


@frozen
class MapPath:
    """A trajectory on the map.

    points: (x, y), m.
    times: at the points, s; empty: the file gives none.
    begin: the place of the first point.
    pieces: of a clothoid spline; empty: the path is a polyline.
    """

    points: Pairs
    times: tuple[float, ...]
    begin: Spot
    pieces: Line = ()

    @property
    def straight(self) -> bool:
        """Whether the path is one straight line, within `_STRAIGHT`."""
        line = _towards(self.points[0], self.points[-1])
        return all(abs(Pose(*it, 0.0).seen_from(line).y) <= _STRAIGHT for it in self.points)

    @property
    def length(self) -> float:
        """Length of the path, m."""
        return sum(math.dist(*ends) for ends in pairwise(self.points))

    def at(self, s: float, element: Node, t: float = 0.0) -> Pose:
        """The place s m along the path, and t m to its left; an InputError beyond its ends.

        element: that names the place.
        """
        ahead = s  # from the beginning of the loop's stretch
        length = 0.0  # of the loop's stretch
        pairs = list(pairwise(self.points))
        # a stretch between equal points has no direction: it counts only if there is no other
        for begin, end in [it for it in pairs if it[0] != it[1]] or pairs:
            ahead -= length
            length = math.dist(begin, end)
            if ahead <= length:
                break
        if ahead > length + _STRAIGHT or s < -_STRAIGHT:
            raise element.fault(f"s = {s:g} m is beyond its trajectory")
        return _towards(begin, end).moved(ahead, t)

    def rest(self, s: float) -> Pairs:
        """The points that lie further along the path than s m; 1e-9 m is a rounding."""
        lengths = accumulate(math.dist(*ends) for ends in pairwise(self.points))
        return tuple(it for it, at in zip(self.points[1:], lengths, strict=True) if at > s + 1e-9)


@dataclass(slots=True)
class Places:
    """Reader of the file's places, with its parameters' values at one point of the parameter space.

    entities: by name.
    side: factor of the file's y and headings: 1, or -1 in files for CARLA, where they point to the
        right.
    ignored: contents of the file without effect, in the order of reading; the values are not used.
    """

    network: Network
    catalogs: Catalogs
    entities: dict[str, Entity]
    side: float
    ignored: dict[str, None]

    def ignore(self, action: Node) -> None:
        """Note an action without a meaning here; refuse any other."""
        if action.tag not in IGNORED:
            raise action.unsupported()
        self.ignored[action.tag] = None

    def entity(self, name: str, element: Node) -> Entity:
        """An entity by its name; an InputError if the file has none of this name."""
        if name not in self.entities:
            raise element.fault(f"entity `{name}` is not among {', '.join(self.entities)}")
        return self.entities[name]

    def referred(self, element: Node) -> Entity:
        """The entity that an element refers to."""
        return self.entity(element.text("entityRef"), element)

    def spot(self, position: Node) -> Spot:
        """The place that a <Position>, or another element with one of its kinds, gives."""
        kind = position.only_child()
        readers = {
            "LanePosition": self._lane, "RelativeLanePosition": self._relative_lane,
            "RoadPosition": self._road,
            "RelativeRoadPosition": self._relative_road,
            "RelativeObjectPosition": self._relative_object,
            "RoutePosition": self._route, "TrajectoryPosition": self._on_trajectory,
            "WorldPosition": self._world, "RelativeWorldPosition": self._relative_world,
            "GeoPosition": self._geo,
        }  # fmt: skip
        spot = kind.chosen(readers, "positions")(kind)
        if any(kind.number(name, 0.0) for name in ("z", "dz", "altitude", "height")):
            self.ignored["heights of positions"] = None
        # a WorldPosition has its angles itself, all others have them in an <Orientation>
        turn = kind.find("Orientation") or kind
        if any(turn.number(name, 0.0) for name in ("p", "r")):
            self.ignored["tilts of positions"] = None
        if turn is kind:
            return spot
        heading = self.side * turn.number("h", 0.0)
        if turn.one_of("type", ("relative", "absolute"), "absolute") == "relative":
            heading += spot.pose.heading
        return replace(spot, pose=spot.pose._replace(heading=heading))

    def located(self, spot: Spot, along: float = ALONG) -> Spot:
        """A place with its road, lane and `way`. A place off all roads gets a `reason` instead.

        along: angle to the lane, rad, below which a place points along it.
        """
        road, lane = spot.road, spot.lane
        s, t = spot.s, spot.t
        if not road:
            driving = self.network.driving(spot.pose)
            if not driving:
                # the first road that cannot be read; no reason if all can be
                errors = (f"; {it}".rstrip(".") for it in self.network.unread.values())
                return replace(spot, reason=next(errors, ""))
            road, lane, (s, t, _) = driving
        turned = abs(spot.pose.seen_from(road.pose(s, t)).heading)
        way = int(turned < along) - int(turned > math.pi - along)  # 1, -1, or 0 for neither
        return Spot(spot.pose, road, lane or road.lane_at(t), s, t, way)

    def _on(self, road: MapRoad, s: float, t: float, lane: Lane | None, element: Node) -> Spot:
        """The place at s and t of a road; an InputError where s is beyond its ends."""
        if not -ON <= s <= road.length + ON:
            raise element.fault(
                f"s = {s:g} m is not on road `{road.name}`, which is {road.length:g} m long"
            )
        return Spot(road.pose(s, t), road, lane, s, t)

    def _lane(self, element: Node) -> Spot:
        road = self.network.road(element.text("roadId"), element)
        lane = self.network.lane(road, element.text("laneId"), element)
        t = lane.centre + element.number("offset", 0.0)
        return self._on(road, element.number("s"), t, lane, element)

    def _relative_lane(self, element: Node) -> Spot:
        other = self.referred(element).placed(element)
        road, lane = other.in_lane(element)
        s = other.s + element.number("ds", 0.0)
        s += road.ahead_in_lane(lane, s, element.number("dsLane", 0.0))
        lane = self.lane_beside(road, lane, element.whole("dLane"), element)
        t = lane.centre + element.number("offset", 0.0)
        return self._on(road, s, t, lane, element).turned(other.way)

    def lane_beside(self, road: MapRoad, lane: Lane, lanes: int, element: Node) -> Lane:
        """The lane that is `lanes` to the left of another; lane 0 does not count."""
        number = lane.number + lanes
        if number * lane.number <= 0:  # on the other side of lane 0, or 0 itself
            number += 1 if lanes > 0 else -1
        return self.network.lane(road, str(number), element)

    def _road(self, element: Node) -> Spot:
        road = self.network.road(element.text("roadId"), element)
        return self._on(road, element.number("s"), element.number("t"), None, element)

    def _relative_road(self, element: Node) -> Spot:
        other = self.referred(element).placed(element)
        if not other.road:
            raise element.fault("the entity that it is relative to is on no road")
        s, t = other.s + element.number("ds"), other.t + element.number("dt")
        return self._on(other.road, s, t, None, element).turned(other.way)

    def _relative_object(self, element: Node) -> Spot:
        if self.side < 0.0:  # CARLA's scenario_runner takes dx and dy along the map's axes
            return self._relative_world(element)
        other = self.referred(element).placed(element)
        return Spot(other.pose.moved(element.number("dx"), element.number("dy", 0.0)))

    def _world(self, element: Node) -> Spot:
        y, heading = element.number("y"), element.number("h", 0.0)
        return Spot(Pose(element.number("x"), self.side * y, self.side * heading))

    def _relative_world(self, element: Node) -> Spot:
        x, y, heading = self.referred(element).placed(element).pose
        y += self.side * element.number("dy", 0.0)
        return Spot(Pose(x + element.number("dx"), y, heading))

    def _geo(self, element: Node) -> Spot:
        return Spot(Pose(*on_map(element, self.network.root), 0.0))

    # -- trajectories ------------------------------------------------------------------------------

    def trajectory(self, holder: Node) -> MapPath:
        """The trajectory of a <TrajectoryRef>."""
        element = self.catalogs.held(holder, "Trajectory")
        if element.flag("closed"):
            raise element.fault("a closed trajectory is not supported")
        shape = element.child("Shape").only_child()
        readers = {"Polyline": self._polyline, "ClothoidSpline": self._spline}
        return shape.chosen(readers, "shapes")(shape)

    def followed(self, action: Node) -> MapPath:
        """The trajectory of a FollowTrajectoryAction."""
        for mode in action.all("TrajectoryFollowingMode"):
            self.exact(mode)
        course = self.trajectory(action.find("TrajectoryRef") or action)
        # with <None> the times at its vertices do not count, but version 1.0 requires them
        return replace(course, times=()) if action.find("TimeReference/None") else course

    def exact(self, element: Node) -> Node:
        """The element itself. A `followingMode` that allows deviations is noted as ignored, because
        scripts are always driven exactly.
        """
        if element.one_of("followingMode", ("position", "follow"), "position") == "follow":
            self.ignored["followingMode `follow`"] = None
        return element

    def _polyline(self, shape: Node) -> MapPath:
        """The path through the vertices of a <Polyline>."""
        vertices = shape.all("Vertex")
        if len(vertices) < 2:
            raise shape.fault(f"it must have at least two vertices, got {len(vertices)}")
        timed = [vertex for vertex in vertices if vertex.get("time") is not None]
        if timed not in ([], vertices):
            raise shape.fault("either all of its vertices must have a `time`, or none")
        spots = [self.spot(vertex.child("Position")) for vertex in vertices]
        points = tuple(spot.pose[:2] for spot in spots)
        for vertex, spot, ends in zip(vertices, spots, pairwise(points), strict=False):
            has_heading = vertex.all("Position/*[@h]") or vertex.all("Position/*/Orientation")
            # `off`: how far two poses lie apart, m, and the angle between them, rad
            if has_heading and _towards(*ends).off(spot.pose)[1] > EGO_ALONG:
                self.ignored["headings along a trajectory"] = None
        return MapPath(points, tuple(vertex.number("time") for vertex in timed), spots[0])

    def _spline(self, shape: Node) -> MapPath:
        """The path of a <ClothoidSpline>, with a point every `_FINE` m."""
        first = shape.find("ClothoidSplineSegment[1]/PositionStart")
        if not first:
            raise shape.fault("its first segment must have a <PositionStart>")
        segments = shape.all("ClothoidSplineSegment")
        pieces = tuple(
            piece_of_file(it.where, it.number("length"), it.number("curvatureStart"),
                it.number("curvatureEnd"))
            for it in segments
        )  # fmt: skip
        if any(it.number("hOffset", 0.0) for it in segments):
            self.ignored["headings along a trajectory"] = None
        begin, total = self.spot(first), length_of(pieces)
        s = np.linspace(0.0, total, math.ceil(total / _FINE) + 1)
        x, y, _ = map_places(pieces, s, 0.0)
        points = tuple(
            begin.pose.moved(*point)[:2] for point in zip(x.tolist(), y.tolist(), strict=True)
        )
        times = []
        if shape.get("timeEnd") or shape.all("ClothoidSplineSegment[@timeStart]"):
            # each segment is driven at one speed, so its times are linear in s
            ends = [0.0, *accumulate(it.length for it in pieces)]
            times_of_ends = [
                *(it.number("timeStart") for it in segments), shape.number("timeEnd")
            ]  # fmt: skip
            times = np.interp(s, ends, times_of_ends).tolist()
        return MapPath(points, tuple(times), begin, pieces)

    def _on_trajectory(self, element: Node) -> Spot:
        trajectory = self.trajectory(element.child("TrajectoryRef"))
        return Spot(trajectory.at(element.number("s"), element, element.number("t", 0.0)))

    # -- routes ------------------------------------------------------------------------------------

    def route(self, holder: Node) -> tuple[Spot, Spot]:
        """Both ends of a route, which must lie on one road or on a straight line."""
        route = self.catalogs.held(holder, "Route")
        if route.flag("closed"):
            raise route.fault("a closed route is not supported")
        waypoints = route.all("Waypoint")
        if len(waypoints) < 2:
            raise holder.fault(f"its route must have at least two waypoints, got {len(waypoints)}")
        begin, *spots = [self.located(self.spot(it.child("Position"))) for it in waypoints]
        if not (begin.road and begin.lane):
            raise waypoints[0].fault("its first waypoint must be in a lane")
        for spot, waypoint in zip(spots, waypoints[1:], strict=True):
            at = spot.pose.seen_from(begin.pose)
            if spot.road is not begin.road and (at.x <= 0.0 or abs(at.y) > _STRAIGHT):
                raise waypoint.fault("a route that turns is not supported")
        return begin, spots[-1]

    def _route(self, element: Node) -> Spot:
        """The place of a <RoutePosition>."""
        begin, end = self.route(element.child("RouteRef"))
        road = begin.road
        assert road is not None  # `route` refuses a begin off all roads
        at = element.child("InRoutePosition").only_child()
        way = -1 if end.road is road and end.s < begin.s else 1
        s = at.number("pathS")
        lane = None
        if at.tag == "FromLaneCoordinates":
            lane = self.network.lane(road, at.text("laneId"), at)
            t = lane.centre + at.number("laneOffset", 0.0)
        elif at.tag == "FromRoadCoordinates":
            t = way * at.number("t")
        else:
            raise at.unsupported(
                "places on a route that are: FromLaneCoordinates, FromRoadCoordinates"
            )
        # pathS counts from the place on the reference line (t = 0) beside the route's begin: along
        # the road, or along a straight line if the route ends on another road
        origin = road.pose(begin.s, 0.0)
        reach = abs(end.s - begin.s) if end.road is road else end.pose.seen_from(origin).x
        if not 0.0 <= s <= reach + ON:
            raise at.fault(f"pathS = {s:g} m is not on its route, which is {reach:g} m long")
        if end.road is road:
            return self._on(road, begin.s + way * s, t, lane, element).turned(way)
        # the route ends on another road: `s` may be beyond its first road, straight ahead
        return Spot(origin.moved(s, t), road, lane, begin.s + s, t)


BODY_OF = {
    "car": "car", "van": "van", "truck": "truck", "trailer": "truck", "semitrailer": "truck",
    "bus": "truck", "motorbike": "motorcycle", "bicycle": "bicycle",
}  # fmt: skip
"""`vehicleCategory` in a file -> body, as in `concrete.Actor`."""


def entity_of(element: Node, catalogs: Catalogs) -> Entity:
    """The entity of a <ScenarioObject>."""
    descriptions = [part for part in element.children() if part.tag != "ObjectController"]
    if len(descriptions) != 1:
        raise element.fault(
            f"it must be one vehicle, pedestrian or object, got {len(descriptions)}"
        )
    (described,) = descriptions
    if described.tag == "CatalogReference":
        described = catalogs.entry(described)
    body = _body_of(described)
    left_out = [it.tag for it in (*described.all("Performance"), *element.all("ObjectController"))]
    # A trailer is an element of its own, or a reference by `entityRef`. esmini's cars have no
    # trailer and refer to "". "its own": any text but "", for an element without `entityRef`.
    if any(it.text("entityRef", "its own") for it in described.all("Trailer/*")):
        left_out.append("Trailer")
    box = described.child("BoundingBox")
    centre, size = box.child("Center"), box.child("Dimensions")
    return Entity(
        element.attribute("name"), size.above_zero("length", " m"), size.above_zero("width", " m"),
        centre.number("x"), centre.number("y"), body, element,
        tuple(left_out),
    )  # fmt: skip


def _body_of(described: Node) -> str:
    """Body of a <Vehicle>, <Pedestrian> or <MiscObject>; an object counts as a standing car."""
    if described.tag != "Vehicle":
        bodies = {"Pedestrian": "pedestrian", "MiscObject": "car"}
        return described.chosen(bodies, "objects")
    category = described.text("vehicleCategory")
    if category not in BODY_OF:
        raise described.fault(f"a vehicle of category `{category}` is not supported")
    return BODY_OF[category]
