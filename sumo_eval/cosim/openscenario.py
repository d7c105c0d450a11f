"""A concrete scenario as OpenSCENARIO XML 1.2, and its road as OpenDRIVE, for other simulators.

Vehicles with scripted manoeuvres follow a trajectory with times, so that they do there exactly what they did here;
those whose moves depend on what happens follow the one that was recorded. The reference point of every vehicle is put
into the middle of its body, where this package has it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from lxml import etree

from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.scenario.concrete import ConcreteScenario, Road
from sumo_eval.scenario.road.lanes import EVERYWHERE, Crossing, LaneSpan, missing_at
from sumo_eval.scenario.road.reference_line import Piece, map_places
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Trajectory

VERTEX_INTERVAL = 0.1  # s between the vertices of a trajectory
HEIGHT = 1.5  # m of every body: nothing here knows it, and the format asks
_ON_FOOT = ("pedestrian", "child")
_CATEGORIES = {"car": "car", "van": "van", "truck": "truck", "motorcycle": "motorbike", "bicycle": "bicycle"}


def opendrive_xml(road: Road) -> str:
    """The road as OpenDRIVE 1.6; lane -1 is the leftmost one. The reference line is the left edge; of a road that bends
    it is the right lane's centre, from which the lanes are offset.
    """
    length = road.length + road.run_out
    root = etree.Element("OpenDRIVE")
    etree.SubElement(root, "header", revMajor="1", revMinor="6", name=road.name)
    element = etree.SubElement(root, "road", name=road.name, length=_text(length), id="0", junction="-1")
    plan = etree.SubElement(element, "planView")
    lanes = etree.SubElement(element, "lanes")
    if not road.bent:
        geometry = etree.SubElement(
            plan, "geometry", s="0", x="0", y=_text(road.left_edge), hdg="0", length=_text(length)
        )
        etree.SubElement(geometry, "line")
    else:  # the line itself, which a spiral's offset would not be
        _plan(plan, road, length)
        if road.span(road.lanes - 1) is EVERYWHERE:
            etree.SubElement(lanes, "laneOffset", s="0", a=_text(road.left_edge), b="0", c="0", d="0")
    places = [0.0, *sorted({it for span in road.spans for it in span.places if 0.0 < it < length}), length]
    sections = list(itertools.pairwise(places))
    left, base = road.span(road.lanes - 1), road.left_edge if road.bent else 0.0
    for begin, end in sections if left is not EVERYWHERE else ():
        first, last = (base - road.lane_width * gone for gone in _gone(left, begin, end))
        slope = _text((last - first) / (end - begin))
        etree.SubElement(lanes, "laneOffset", s=_text(begin), a=_text(first), b=slope, c="0", d="0")
    for begin, end in sections:
        section = etree.SubElement(lanes, "laneSection", s=_text(begin))
        etree.SubElement(etree.SubElement(section, "center"), "lane", id="0", type="none", level="false")
        right = etree.SubElement(section, "right")
        number = 0
        for place in reversed(range(road.lanes)):
            first, last = (road.lane_width * (1.0 - gone) for gone in _gone(road.span(place), begin, end))
            if first == last == 0.0:
                continue
            number -= 1
            lane = etree.SubElement(right, "lane", id=str(number), type="driving", level="false")
            slope = _text((last - first) / (end - begin))
            etree.SubElement(lane, "width", sOffset="0", a=_text(first), b=slope, c="0", d="0")
    for crossing in road.crossings:
        _crossing(root, road, crossing, str(len(root.findall("road"))))
    return _document(root)


def _gone(span: LaneSpan, begin: float, end: float) -> tuple[float, float]:
    """The shares of a lane that are not there at the ends of a section, throughout which its edge is straight."""
    inside = 1e-6 * (end - begin)  # an end may be where the lane's edge turns
    return tuple(float(missing_at(span, place).round(5)) for place in (begin + inside, end - inside))  # type: ignore[return-value]


def _crossing(root: etree._Element, road: Road, crossing: Crossing, number: str) -> None:
    """A road that crosses, its middle the reference line."""
    length = 2.0 * crossing.reach
    x, y, along = (float(it) for it in map_places(road.line, crossing.at, -crossing.reach))
    element = etree.SubElement(root, "road", name="crossing", length=_text(length), id=number, junction="-1")
    plan = etree.SubElement(element, "planView")
    geometry = etree.SubElement(
        plan, "geometry", s="0", x=_text(x), y=_text(y), hdg=f"{along + 0.5 * math.pi:.12g}", length=_text(length),
    )  # fmt: skip
    etree.SubElement(geometry, "line")
    section = etree.SubElement(etree.SubElement(element, "lanes"), "laneSection", s="0")
    for side, number_of in (("left", 1), ("center", 0), ("right", -1)):
        kind = "driving" if number_of else "none"
        lane = etree.SubElement(etree.SubElement(section, side), "lane", id=str(number_of), type=kind, level="false")
        if number_of:
            etree.SubElement(lane, "width", sOffset="0", a=_text(0.5 * crossing.width), b="0", c="0", d="0")


def _plan(plan: etree._Element, road: Road, length: float) -> None:
    """The pieces of a line, and the straight behind them."""
    s, pieces = 0.0, list(road.line)
    pieces.append(Piece(max(length - sum(piece.length for piece in pieces), 1e-3)))
    for piece in pieces:
        x, y, heading = (float(it) for it in map_places(road.line, s, 0.0))
        geometry = etree.SubElement(
            plan, "geometry", s=_text(s), x=_text(x), y=_text(y), hdg=f"{heading:.12g}", length=_text(piece.length)
        )
        if piece.begin == piece.end == 0.0:
            etree.SubElement(geometry, "line")
        elif piece.begin == piece.end:
            etree.SubElement(geometry, "arc", curvature=f"{piece.begin:.12g}")
        else:
            etree.SubElement(geometry, "spiral", curvStart=f"{piece.begin:.12g}", curvEnd=f"{piece.end:.12g}")
        s += piece.length


def openscenario_xml(
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    road_file: str,
    remark: str,
    driven: Mapping[str, Trajectory] | None = None,
) -> str:
    """The scenario. driven: how everybody was recorded, by name: the ego drives that way again, until it ends, as do
    those whose moves depend on what happens. None: the ego keeps its speed, as which controller drives it is the other
    simulator's to say.

    road_file: the OpenDRIVE file, relative. remark: where it comes from, for the header.
    """
    settings = concrete.simulation(settings)
    root = etree.Element("OpenSCENARIO")
    etree.SubElement(
        root, "FileHeader", revMajor="1", revMinor="2", date="2022-01-01T00:00:00", author="sumo_eval",
        description=f"{concrete.scenario}: {concrete.label}. {remark}",
    )  # fmt: skip
    for empty in ("ParameterDeclarations", "CatalogLocations"):
        etree.SubElement(root, empty)
    etree.SubElement(etree.SubElement(root, "RoadNetwork"), "LogicFile", filepath=road_file)
    entities = etree.SubElement(root, "Entities")
    vehicle = settings.vehicle
    _entity(entities, EGO, "car", vehicle.length, vehicle.width, vehicle.max_acceleration, vehicle.max_deceleration)
    for actor in concrete.actors:
        _entity(entities, actor.name, actor.body, actor.length, actor.width, 10.0, 10.0)
    storyboard = etree.SubElement(root, "Storyboard")
    actions = etree.SubElement(etree.SubElement(storyboard, "Init"), "Actions")
    for name, start in [(EGO, concrete.ego), *((actor.name, actor.start) for actor in concrete.actors)]:
        private = etree.SubElement(actions, "Private", entityRef=name)
        teleport = etree.SubElement(etree.SubElement(private, "PrivateAction"), "TeleportAction")
        _position(teleport, concrete.road, start.x, start.y, start.heading)
        speed = _under(private, "PrivateAction", "LongitudinalAction", "SpeedAction")
        etree.SubElement(speed, "SpeedActionDynamics", dynamicsShape="step", value="0", dynamicsDimension="time")
        etree.SubElement(_under(speed, "SpeedActionTarget"), "AbsoluteTargetSpeed", value=_text(start.speed))
    story = etree.SubElement(storyboard, "Story", name="others")
    act = etree.SubElement(story, "Act", name="others")
    known = {name: path for name, path in (driven or {}).items() if len(path) > 1}
    ego = known.get(EGO)
    scripted = [actor for actor in concrete.actors if actor.acts and not actor.lively]
    recorded = [actor.name for actor in concrete.actors if actor.lively and actor.name in known]
    body = vehicle.length, vehicle.width
    moved = tracks([concrete], [body], VERTEX_INTERVAL, settings.time_limit, in_python=True)
    for actor, rows in zip(concrete.actors, moved.others[0].tolist(), strict=True):
        if actor in scripted and actor.name not in recorded:
            _follow(act, actor.name, _on_the_road(rows, concrete.road), concrete.road)
    for name in [*([] if ego is None else [EGO]), *recorded]:
        columns = (getattr(known[name], column).tolist() for column in ("time", "x", "y", "heading"))
        _follow(act, name, zip(*columns, strict=True), concrete.road)
    if not scripted and not recorded and ego is None:
        group = etree.SubElement(act, "ManeuverGroup", maximumExecutionCount="1", name="nobody")
        etree.SubElement(group, "Actors", selectTriggeringEntities="false")
    _after(etree.SubElement(act, "StartTrigger"), 0.0, "begin")
    end = settings.time_limit if ego is None else float(ego.time[-1])
    _after(etree.SubElement(storyboard, "StopTrigger"), end, "end")
    return _document(root)


def _entity(
    parent: etree._Element, name: str, body: str, length: float, width: float, accel: float, decel: float
) -> None:
    item = etree.SubElement(parent, "ScenarioObject", name=name)
    if body in _ON_FOOT:
        person = etree.SubElement(item, "Pedestrian", name=name, mass="75", pedestrianCategory="pedestrian")
        _box(person, length, width)
        etree.SubElement(person, "Properties")
        return
    vehicle = etree.SubElement(item, "Vehicle", name=name, vehicleCategory=_CATEGORIES[body])
    _box(vehicle, length, width)
    etree.SubElement(vehicle, "Performance", maxSpeed="70", maxAcceleration=_text(accel), maxDeceleration=_text(decel))
    axles = etree.SubElement(vehicle, "Axles")
    for axle, place in (("FrontAxle", 0.3 * length), ("RearAxle", -0.3 * length)):
        etree.SubElement(
            axles, axle, maxSteering="0.5", wheelDiameter="0.6", trackWidth=_text(0.85 * width),
            positionX=_text(place), positionZ="0.3",
        )  # fmt: skip
    etree.SubElement(vehicle, "Properties")


def _box(parent: etree._Element, length: float, width: float) -> None:
    """A body around the reference point in its middle."""
    etree.SubElement(parent, "ParameterDeclarations")
    box = etree.SubElement(parent, "BoundingBox")
    etree.SubElement(box, "Center", x="0", y="0", z=_text(HEIGHT / 2))
    etree.SubElement(box, "Dimensions", width=_text(width), length=_text(length), height=_text(HEIGHT))


def _on_the_road(rows: Sequence[Sequence[float]], road: Road) -> Iterator[tuple[float, float, float, float]]:
    """Time, x, y and heading of a vehicle at every vertex, until it leaves the road. rows: as in `Tracks`."""
    for number, (x, y, heading, *_) in enumerate(rows):
        if x > road.length + road.run_out:
            return
        yield round(number * VERTEX_INTERVAL, 6), x, y, heading


def _follow(act: etree._Element, name: str, vertices: Iterable[tuple[float, float, float, float]], road: Road) -> None:
    """A vehicle on one timed trajectory. vertices: time, x, y, heading."""
    group = etree.SubElement(act, "ManeuverGroup", maximumExecutionCount="1", name=name)
    etree.SubElement(etree.SubElement(group, "Actors", selectTriggeringEntities="false"), "EntityRef", entityRef=name)
    event = etree.SubElement(etree.SubElement(group, "Maneuver", name=name), "Event", name=name, priority="overwrite")
    action = etree.SubElement(event, "Action", name=name)
    follow = _under(action, "PrivateAction", "RoutingAction", "FollowTrajectoryAction")
    trajectory = etree.SubElement(_under(follow, "TrajectoryRef"), "Trajectory", name=name, closed="false")
    line = _under(trajectory, "Shape", "Polyline")
    for time, x, y, heading in vertices:
        _position(etree.SubElement(line, "Vertex", time=_text(time)), road, x, y, heading)
    etree.SubElement(
        _under(follow, "TimeReference"), "Timing", domainAbsoluteRelative="absolute", scale="1", offset="0"
    )
    etree.SubElement(follow, "TrajectoryFollowingMode", followingMode="position")
    _after(etree.SubElement(event, "StartTrigger"), 0.0, f"{name} begins")


def _after(trigger: etree._Element, time: float, name: str) -> None:
    group = etree.SubElement(trigger, "ConditionGroup")
    condition = etree.SubElement(group, "Condition", name=name, delay="0", conditionEdge="none")
    etree.SubElement(
        _under(condition, "ByValueCondition"), "SimulationTimeCondition", value=_text(time), rule="greaterOrEqual"
    )


def _position(parent: etree._Element, road: Road, x: float, y: float, heading: float) -> None:
    x, y, heading = (float(it) for it in map_places(road.line, x, y, heading))
    etree.SubElement(
        _under(parent, "Position"), "WorldPosition", x=_text(x), y=_text(y), z="0", h=_text(heading), p="0", r="0"
    )


def _under(parent: etree._Element, *names: str) -> etree._Element:
    for name in names:
        parent = etree.SubElement(parent, name)
    return parent


def _text(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".") if value else "0"


def _document(root: etree._Element) -> str:
    return etree.tostring(root.getroottree(), pretty_print=True, xml_declaration=True, encoding="UTF-8").decode()
