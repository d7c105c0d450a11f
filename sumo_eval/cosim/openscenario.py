"""A concrete scenario as OpenSCENARIO XML 1.2, and its road as OpenDRIVE, for other simulators.

Vehicles with scripted manoeuvres follow a trajectory with times, so that they do in the other
simulator what they did here. Vehicles whose moves depend on what happens follow their recorded
trajectory; without a recording they keep their speed. The reference point of every vehicle is in
the middle of its body, as in this package.

The header holds the case to the last bit, with a seal over the file and its road: if neither is
changed, the file imports as that case. Both files are a format that users' simulators read.

`sumo-eval export` writes both files; `extras/openscenario` reads the case (`exported_case`).

Users: `extras/openscenario/scene.py`, `report/export_case.py`.
"""

import hashlib
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from lxml import etree
from lxml.builder import ElementMaker  # type: ignore[import-not-found]

from sumo_eval.coded import decoded, encoded
from sumo_eval.cosim.sumo.sumo_files import EGO, document
from sumo_eval.errors import InputError
from sumo_eval.scenario.concrete import (
    Actor,
    ConcreteScenario,
    EgoBody,
    Model,
    NetworkFile,
    Road,
    Start,
    Way,
)
from sumo_eval.scenario.played import Act
from sumo_eval.scenario.road.lanes import EVERYWHERE, Crossing, LaneSpan, missing_at
from sumo_eval.scenario.road.reference_line import Piece, length_of, map_places
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import FloatArray, Trajectories

VERTEX_INTERVAL = 0.1  # s between the vertices of a trajectory
HEIGHT = 1.5  # m, of every body: the format needs one, and the package has none
_ON_FOOT = ("pedestrian", "child")
CASE, _SEAL = "sumo_eval_case", "sumo_eval_seal"  # names of properties of the file's header


def _actor(name: str, start: Start, acts: Iterable[Any], *rest: Any) -> Actor:
    """An actor of an encoded case, which holds the values of each act without their names."""
    return Actor(name, start, tuple(Act(*act) for act in acts), *rest)


# maker of each record of an encoded case, by its class name
_RECORDS: dict[str, Any] = {
    it.__name__: it
    for it in (ConcreteScenario, Crossing, EgoBody, LaneSpan, Model, NetworkFile, Piece, Road,
        Start, Way)
} | {"Actor": _actor}  # fmt: skip


def _written(_: object, value: float) -> str:
    """A number as an attribute's text, to six decimals."""
    return f"{value:z.6f}".rstrip("0").rstrip(".")  # z: 0 for -0


E: Any = ElementMaker(typemap={float: _written, int: _written, np.float64: _written})


def opendrive_xml(road: Road) -> str:
    """The road as OpenDRIVE 1.6; lane -1 is the leftmost one.

    The reference line of a straight road is its left edge. On a curved road it is the road's line,
    the right lane's centre line, and lanes are offset from it, as an offset of a spiral is not one.
    """
    length = road.end
    # m, distance of the reference line to the left of the road's line
    aside = 0.0 if road.bent else road.left_edge
    changes = {it for span in road.spans for it in span.places if 0.0 < it < length}
    sections = list(itertools.pairwise([0.0, *sorted(changes), length]))
    # lane numbers (`_numbers`) of each section, with none before the first and after the last
    numbers = [{}, *(_numbers(road, *section) for section in sections), {}]
    lanes = E.lanes(
        *_left_edge(road, sections, aside),
        *(_section(road, *section, *numbers[i : i + 3]) for i, section in enumerate(sections)),
    )
    return document(E.OpenDRIVE(
        E.header(revMajor=1, revMinor=6, name=road.name),
        E.road(E.planView(*_plan(road, length, aside)), lanes, name=road.name, length=length, id=0,
            junction=-1),
        *(_crossing(road, crossing, number) for number, crossing in enumerate(road.crossings, 1)),
    ))  # fmt: skip


def _left_edge(road: Road, sections: Sequence[tuple[float, float]], aside: float) -> Iterator[Any]:
    """Lane offsets from the reference line to the road's left edge, where the two differ.

    sections: begin and end of each, m.
    aside: distance of the reference line to the left of the road's line, m.
    """
    left = road.span(road.lanes - 1)
    if left is not EVERYWHERE:  # the left edge moves with the end of the leftmost lane
        for begin, end in sections:
            # m, offsets at both ends
            first, last = (
                road.left_edge - aside - road.lane_width * gone for gone in _gone(left, begin, end)
            )
            yield E.laneOffset(s=begin, a=first, b=(last - first) / (end - begin), c=0, d=0)
    elif road.bent:
        yield E.laneOffset(s=0, a=road.left_edge, b=0, c=0, d=0)


def _numbers(road: Road, begin: float, end: float) -> dict[int, int]:
    """Numbers in the file of the lanes that exist in a section, by lane, from the left."""
    lanes = [it for it in reversed(range(road.lanes)) if min(_gone(road.span(it), begin, end)) < 1]
    return {lane: -1 - index for index, lane in enumerate(lanes)}


def _section(
    road: Road, begin: float, end: float,
    before: Mapping[int, int], numbers: Mapping[int, int], after: Mapping[int, int],
) -> Any:  # fmt: skip
    """A section with its lanes from the left.

    numbers: as of `_numbers`; before, after: those of the sections next to it.
    """
    right = E.right()
    for lane, number in numbers.items():
        # m, width at both ends
        first, last = (
            road.lane_width * (1.0 - gone) for gone in _gone(road.span(lane), begin, end)
        )
        width = E.width(sOffset=0, a=first, b=(last - first) / (end - begin), c=0, d=0)
        beside = ("predecessor", before), ("successor", after)
        links = [E(name, id=section[lane]) for name, section in beside if lane in section]
        link = [E.link(*links)] if links else []
        right.append(E.lane(*link, width, id=number, type="driving", level="false"))
    return E.laneSection(E.center(E.lane(id=0, type="none", level="false")), right, s=begin)


def _gone(span: LaneSpan, begin: float, end: float) -> tuple[float, float]:
    """Shares of a lane's width that are missing at both ends of a section.

    begin, end: of the section, in which the lane's edge is straight, m.
    """
    # at either end the lane's edge may turn or jump: take the share just inside, rounded
    inside = 1e-6 * (end - begin)
    return tuple(
        float(missing_at(span, position).round(5)) for position in (begin + inside, end - inside)
    )  # type: ignore[return-value]


def _crossing(road: Road, crossing: Crossing, number: int) -> Any:
    """A road that crosses; its reference line is its middle.

    number: its id in the file.
    """
    length = 2.0 * crossing.reach
    line = _geometry(road, crossing.at, -crossing.reach, 0.5 * math.pi, length, E.line())
    section = E.laneSection(s=0)
    for side, lane in (("left", 1), ("center", 0), ("right", -1)):
        width = [E.width(sOffset=0, a=0.5 * crossing.width, b=0, c=0, d=0)] if lane else []
        section.append(
            E(side, E.lane(*width, id=lane, type="driving" if lane else "none", level="false"))
        )
    return E.road(
        E.planView(line), E.lanes(section), name="crossing", length=length, id=number, junction=-1
    )


def _geometry(road: Road, s: float, aside: float, turned: float, length: float, shape: Any) -> Any:
    """A piece of a reference line that begins `aside` m to the left of the road's line at s, m.

    turned: direction of a crossing road relative to the road's, rad: the piece is then at s = 0 of
        that road. 0: the piece is of the road itself.
    """
    x, y, heading = map_places(road.line, s, aside)
    return E.geometry(
        shape,
        s=0 if turned else s,
        x=float(x),
        y=float(y),
        hdg=f"{heading + turned:.12g}",
        length=length,
    )


def _plan(road: Road, length: float, aside: float) -> Iterator[Any]:
    """The pieces of a road's line, and a straight one for the rest of its length.

    aside: distance of the reference line to the left of the road's line, m.
    """
    s = 0.0
    # the format asks for a length above 0, hence 1 mm where nothing is left
    for piece in (*road.line, Piece(max(length - length_of(road.line), 1e-3))):
        if piece.begin != piece.end:
            shape = E.spiral(curvStart=f"{piece.begin:.12g}", curvEnd=f"{piece.end:.12g}")
        elif piece.begin:
            shape = E.arc(curvature=f"{piece.begin:.12g}")
        else:
            shape = E.line()
        yield _geometry(road, s, aside, 0.0, piece.length, shape)
        s += piece.length


def openscenario_xml(
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    road_file: str,
    remark: str,
    driven: Trajectories | None = None,
) -> str:
    """The scenario as text.

    road_file: path of the OpenDRIVE file, relative to this one.
    remark: a sentence for the header on where the scenario comes from.
    driven: recorded trajectories by vehicle. The ego follows its own until that ends, and so do
        actors whose moves depend on what happens. None: the ego keeps its speed, because the other
        simulator chooses the controller that drives it.
    """
    settings = concrete.simulation(settings)  # with the case's own changes
    vehicle = settings.vehicle
    road = concrete.road
    actors = concrete.actors
    # a polyline has at least two vertices
    recorded = {name: path for name, path in (driven or {}).items() if len(path) > 1}
    # lively: an actor whose moves depend on more than time
    unrecorded = ", ".join(it.name for it in actors if it.lively and it.name not in recorded)
    if unrecorded:
        remark = f"Not recorded, and so at one speed throughout: {unrecorded}. {remark}"
    end = float(recorded[EGO].time[-1]) if EGO in recorded else settings.time_limit
    root = E.OpenSCENARIO(
        E.FileHeader(
            revMajor=1, revMinor=2, date="2022-01-01T00:00:00", author="sumo_eval",
            description=f"{concrete.scenario}: {concrete.label}. {remark}",
        ),
        E.ParameterDeclarations(), E.CatalogLocations(),
        E.RoadNetwork(E.LogicFile(filepath=road_file)),
        E.Entities(
            _entity(EGO, "car", vehicle.length, vehicle.width, vehicle.max_acceleration,
                vehicle.max_deceleration),
            *(_entity(it.name, it.body, it.length, it.width, 10.0, 10.0) for it in actors),
        ),
        E.Storyboard(
            E.Init(E.Actions(
                _begin(EGO, concrete.ego, concrete.ego.heading, road),
                *(_begin(it.name, it.start, it.heading, road) for it in actors),
            )),
            E.Story(_act(concrete, settings, recorded), name="others"),
            E.StopTrigger(_after(end, "end")),
        ),
    )  # fmt: skip
    case = encoded(concrete).decode()
    seal = _seal(root, opendrive_xml(road).encode(), case)
    root[0].append(
        E.Properties(E.Property(name=CASE, value=case), E.Property(name=_SEAL, value=seal))
    )
    return document(root)


def _entity(name: str, body: str, length: float, width: float, accel: float, decel: float) -> Any:
    """A vehicle or pedestrian, its body around the reference point in the middle.

    The format also asks for mass, axles and limits of performance. They have typical values here:
    only a simulator that drives the vehicle by a model of its own uses them.

    length, width: m. accel, decel: m/s2.
    """
    size = E.Dimensions(width=width, length=length, height=HEIGHT)
    box = E.ParameterDeclarations(), E.BoundingBox(E.Center(x=0, y=0, z=HEIGHT / 2), size)
    if body in _ON_FOOT:
        it = E.Pedestrian(*box, E.Properties(), name=name, mass=75, pedestrianCategory="pedestrian")
    else:
        axles = (
            E(
                axle,
                maxSteering="0.5",
                wheelDiameter="0.6",
                trackWidth=0.85 * width,
                positionX=at,
                positionZ="0.3",
            )
            for axle, at in (("FrontAxle", 0.3 * length), ("RearAxle", -0.3 * length))
        )
        it = E.Vehicle(
            *box,
            E.Performance(maxSpeed=70, maxAcceleration=accel, maxDeceleration=decel),
            E.Axles(*axles),
            E.Properties(),
            name=name,
            vehicleCategory="motorbike" if body == "motorcycle" else body,
        )
    return E.ScenarioObject(it, name=name)


def _begin(name: str, start: Start, heading: float, road: Road) -> Any:
    """Place and speed of a vehicle at the start.

    heading: rad to the left of the road.
    """
    return E.Private(
        E.PrivateAction(E.TeleportAction(_position(road, start.x, start.y, heading))),
        E.PrivateAction(E.LongitudinalAction(E.SpeedAction(
            E.SpeedActionDynamics(dynamicsShape="step", value=0, dynamicsDimension="time"),
            E.SpeedActionTarget(E.AbsoluteTargetSpeed(value=start.speed)),
        ))),
        entityRef=name,
    )  # fmt: skip


def _act(concrete: ConcreteScenario, settings: SimulationSettings, recorded: Trajectories) -> Any:
    """The act in which vehicles follow trajectories.

    recorded: trajectories by vehicle.
    """
    vertices = _scripted_vertices(concrete, settings)
    # the motion of the ego and of lively actors depends on more than time
    for name in (EGO, *(actor.name for actor in concrete.actors if actor.lively)):
        if path := recorded.get(name):
            vertices[name] = np.column_stack([path.time, path.x, path.y, path.heading])
    groups = [_follow(name, rows, concrete.road) for name, rows in vertices.items()]
    # an act must hold a group, even where no vehicle has a trajectory
    empty = E.ManeuverGroup(
        E.Actors(selectTriggeringEntities="false"), maximumExecutionCount=1, name="nobody"
    )
    return E.Act(*(groups or [empty]), E.StartTrigger(_after(0.0, "begin")), name="others")


def _scripted_vertices(
    concrete: ConcreteScenario, settings: SimulationSettings
) -> dict[str, FloatArray]:
    """By actor with a script that depends on time alone, vertices as of `_follow`."""
    scripted = tracks(
        [concrete],
        [(settings.vehicle.length, settings.vehicle.width)],
        VERTEX_INTERVAL,
        settings.time_limit,
        in_python=True,  # quicker: a single case is over before machine code is ready
    ).others[0, :, :, :3]  # (m, T, 3): x, y, heading of m actors at T times
    vertices = {}
    for actor, places in zip(concrete.actors, scripted, strict=True):
        if actor.acts and not actor.lively:
            times = VERTEX_INTERVAL * np.arange(len(places))
            # number of places before the first beyond the road's end (argmin: the first False)
            on_road = np.append(places[:, 0] <= concrete.road.end, False).argmin()
            if on_road > 1:  # with fewer, the actor leaves the road at its first speed
                vertices[actor.name] = np.column_stack([times, places])[:on_road]
    return vertices


def _follow(name: str, vertices: FloatArray, road: Road) -> Any:
    """A vehicle on one timed trajectory.

    vertices: rows of time, s, x and y in road coordinates, m, and heading, rad.
    """
    line = E.Polyline(
        *(E.Vertex(_position(road, *pose), time=time) for time, *pose in vertices.tolist())
    )
    follow = E.FollowTrajectoryAction(
        E.TrajectoryRef(E.Trajectory(E.Shape(line), name=name, closed="false")),
        E.TimeReference(E.Timing(domainAbsoluteRelative="absolute", scale=1, offset=0)),
        E.TrajectoryFollowingMode(followingMode="position"),
    )
    event = E.Event(
        E.Action(E.PrivateAction(E.RoutingAction(follow)), name=name),
        E.StartTrigger(_after(0.0, f"{name} begins")),
        name=name, priority="overwrite",
    )  # fmt: skip
    return E.ManeuverGroup(
        E.Actors(E.EntityRef(entityRef=name), selectTriggeringEntities="false"),
        E.Maneuver(event, name=name),
        maximumExecutionCount=1, name=name,
    )  # fmt: skip


def _after(time: float, name: str) -> Any:
    """Condition that is true from a time on, s."""
    return E.ConditionGroup(E.Condition(
        E.ByValueCondition(E.SimulationTimeCondition(value=time, rule="greaterOrEqual")),
        name=name, delay=0, conditionEdge="none",
    ))  # fmt: skip


def _position(road: Road, x: float, y: float, heading: float) -> Any:
    """A position on the map, from one along and across the road."""
    x, y, heading = (float(it) for it in map_places(road.line, x, y, heading))
    return E.Position(E.WorldPosition(x=x, y=y, z=0, h=heading, p=0, r=0))


def _seal(root: Any, road: bytes, case: str) -> str:
    """The hash of a file without its properties, of its road and of its case."""
    elements = [
        (it.tag, sorted(it.attrib.items()))
        for it in root.iter(etree.Element)
        if it.tag not in ("Properties", "Property")
    ]
    return hashlib.sha256(repr(elements).encode() + road + case.encode()).hexdigest()


def exported_case(root: Any, road: bytes) -> ConcreteScenario:
    """The case of a file that `openscenario_xml` wrote.

    root: the file's root element; its header has the property `CASE`.
    road: the content of its OpenDRIVE file.

    Raises InputError where either file was changed since.
    """
    properties = {
        it.get("name"): it.get("value", "")
        for it in root.iterfind("FileHeader/Properties/Property")
    }
    if properties.get(_SEAL) != _seal(root, road, properties[CASE]):
        raise InputError(
            "an exported file and its road must be unchanged since; without the <Properties> of "
            "its <FileHeader> it is read as any other file"
        )
    try:
        case = decoded(properties[CASE].encode(), _RECORDS)
        if not isinstance(case, ConcreteScenario):
            raise TypeError(case)
    # of a version with other records
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError("its exported case cannot be read") from error
    return case
