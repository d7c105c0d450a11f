"""SUMO networks, routes and configurations as text, written from a road and a concrete scenario.

The simulation itself, the run folder and the files of the shipped scenarios
(`tools/generate_sumo_inputs.py`) use these functions: sumo-gui opens the same files that ran. Every
digit written here decides recorded values.

Users: `cosim/`, `record/run_folder.py`, `report/export_case.py`.
"""

import functools
import itertools
import math
import re
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from posixpath import dirname, relpath
from typing import Any

import numpy as np
from lxml import etree
from lxml.builder import ElementMaker  # type: ignore[import-not-found]

from sumo_eval.cosim.sumo.sections import RoadSection, sections, vehicle_routes
from sumo_eval.cosim.vehicle_model import GRAVITY
from sumo_eval.scenario.bodies import BODIES, CAR
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road, Start, lane_at
from sumo_eval.scenario.road.reference_line import curvatures, drawn_points, map_places, tightest
from sumo_eval.scenario.sumo_network import laid_along_x
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.trajectory import FloatArray

Attributes = dict[str, str]  # of an element of a file
EGO = "ego"
SEGMENT = 1.0  # m, largest distance between the vertices of a lane in a curve, see `_segment`
_TIGHT = 100.0  # m, radius of a curve below which vertices are closer than `SEGMENT`
VIEW_LENGTH = 250.0  # m of road that sumo-gui shows at first


def document(root: Any) -> str:
    """An element as an XML document."""
    return etree.tostring(
        root.getroottree(), pretty_print=True, xml_declaration=True, encoding="UTF-8"
    ).decode()


def _number(value: float) -> str:
    """A number with all its digits."""
    return repr(float(value))


def _texts(**values: Any) -> Attributes:
    """Attributes of an element: texts as they are, numbers with all their digits."""
    return {
        name: value if isinstance(value, str) else _number(value) for name, value in values.items()
    }


def _desired(speed: float) -> float:
    """Desired speed of a vehicle, m/s: SUMO's own models keep this speed, not the road's limit.

    SUMO refuses 0: 1 mm/s stands for it.
    """
    return max(speed, 0.001)


def _metres(value: float) -> str:
    """A length in m with two decimals, as netconvert writes it; with all its decimals if it has
    more, as rounding would move a lane or a road's end.
    """
    text = f"{value:.2f}"
    return text if float(text) == value else _number(value)


E: Any = ElementMaker(
    typemap={float: lambda _, value: _metres(value), int: lambda _, value: str(value)}
)


@functools.lru_cache(maxsize=64)
def network_xml(road: Road) -> str:
    """A one-way road as a final SUMO network (no netconvert needed): lane 0's centre line is y = 0.

    The network has an edge for each section, each ramp and each road that crosses.

    All lanes of a curved road are offsets of lane 0's centre line. SUMO needs one length for all
    lanes of an edge: here it is that of lane 0. SUMO stretches each lane's shape to this length, so
    a position along the road is exact on lane 0 alone.

    A road of a user's network is that network, turned and moved so that the road lies along x.
    """
    if road.network is not None:
        return laid_along_x(road.network)
    parts = sections(road)
    nodes = ["begin", *(f"node{number}" for number in range(1, len(parts))), "end"]
    edges, positions = _edges_along(road, nodes)
    for number, crossing in enumerate(road.crossings):
        edge = f"crossing{number}"
        begin = f"{edge}_begin"
        end = f"{edge}_end"
        reach = crossing.reach
        positions |= {begin: (crossing.at, -reach), end: (crossing.at, reach)}
        shape = " ".join(_shape(road, *positions[name]) for name in (begin, end))
        lane = _lane(road, f"{edge}_0", 0, 2.0 * reach, crossing.width, shape)
        edges.append(_edge(edge, begin, end, [lane]))

    # by node between two sections: the lanes that continue there
    joints = {
        node: _joints(before, after)
        for node, before, after in zip(nodes[1:-1], parts, parts[1:], strict=False)
    }
    junctions = [
        _junction(road, name, position, edges, len(joints.get(name, ())))
        for name, position in positions.items()
    ]
    # dir: s, straight on. state: M, with right of way
    connections = [
        E.connection({"from": edge, "to": next_edge, "fromLane": str(lane),
            "toLane": str(next_lane), "dir": "s", "state": "M"})
        for (edge, lane), (next_edge, next_lane) in itertools.chain(*joints.values())
    ]  # fmt: skip
    bounds = _bounds(road)
    return document(E.net(
        E.location(
            netOffset="0.00,0.00", convBoundary=bounds, origBoundary=bounds, projParameter="!"
        ),
        *edges, *junctions, *connections,
        version="1.20", junctionCornerDetail="5", limitTurnSpeed="5.50",
    ))  # fmt: skip


def _edges_along(
    road: Road, nodes: Sequence[str]
) -> tuple[list[Any], dict[str, tuple[float, float]]]:
    """Edges of the sections and their ramps; and x and y of all their nodes by name, m.

    nodes: names of the nodes where sections begin or end, in order.
    """
    last = road.end
    parts = sections(road)
    middle = 0.5 * (road.left_edge + road.right_edge)
    places = ((x, middle) for x in (*(part.begin for part in parts), last))
    positions = dict(zip(nodes, places, strict=True))
    edges = []
    for part, (begin, end) in zip(parts, itertools.pairwise(nodes), strict=True):
        edges.append(_section_edge(road, part, part.edge, (begin, end), part.lanes))
        if part.ramp >= 0:
            y = road.lane_centre(part.ramp)
            ramp = part.ramp_edge
            if part.begin == 0.0:
                begin = f"{ramp}_begin"
                positions[begin] = (0.0, y)
            if part.end == last:
                end = f"{ramp}_end"
                positions[end] = (last, y)
            edges.append(_section_edge(road, part, ramp, (begin, end), (part.ramp,)))
    return edges, positions


def _section_edge(
    road: Road, part: RoadSection, name: str, nodes: tuple[str, str], lanes: Sequence[int]
) -> Any:
    """The edge of a section or of its ramp, between two nodes, with these lanes of the road."""
    s = drawn_points(road.line, part.begin, part.end, _segment(road))  # m along the road
    return _edge(name, *nodes, [
        _lane(road, f"{name}_{index}", index, part.end - part.begin, road.lane_width,
            _shape(road, s, road.lane_centre(lane)))
        for index, lane in enumerate(lanes)
    ])  # fmt: skip


def _edge(name: str, begin: str, end: str, lanes: Sequence[Any]) -> Any:
    """An edge between two nodes."""
    return E.edge({"id": name, "from": begin, "to": end, "priority": "1"}, *lanes)


def _lane(road: Road, name: str, index: int, length: float, width: float, shape: str) -> Any:
    """A lane; length and width in m, `index` within its edge."""
    return E.lane(
        id=name, index=index, speed=road.speed_limit, length=length, width=width, shape=shape
    )


def _junction(
    road: Road, name: str, position: tuple[float, float], edges: Sequence[Any], links: int
) -> Any:
    """A node of the network: a line across the road where edges end.

    position: x and y, m.
    edges: all edges of the network.
    links: number of lanes that continue here; none of them gives way to another.
    """
    x, y = _shape(road, *position).split(",")
    no_link = "0" * links  # a bit for each link: 1 would mean that a link gives way to it
    borders = [road.right_edge, road.left_edge]
    if name == "begin":  # the shape goes from left to right there
        borders.reverse()
    return E.junction(
        *(E.request(index=index, response=no_link, foes=no_link, cont=0) for index in range(links)),
        id=name, type="priority" if links else "dead_end", x=x, y=y,
        incLanes=" ".join(lane.get("id") for it in edges if it.get("to") == name for lane in it),
        intLanes="",
        shape=" ".join(_shape(road, position[0], border) for border in borders),
    )  # fmt: skip


def _segment(road: Road) -> float:
    """Distance between the vertices of a curved road's lanes, m.

    A chord of length c is up to c^2 / (8 r) from its arc of radius r. Below r = `_TIGHT`, c falls
    with the root of r, so that no chord is farther from its arc than at `_TIGHT`.
    """
    return SEGMENT * math.sqrt(min(tightest(road.line) / _TIGHT, 1.0))


def _joints(
    section: RoadSection, following: RoadSection
) -> list[tuple[tuple[str, int], tuple[str, int]]]:
    """Lanes that continue from a section to the next: edge and index of each lane in both."""
    before, after = (
        {lane: (part.edge, index) for index, lane in enumerate(part.lanes)}
        | ({part.ramp: (part.ramp_edge, 0)} if part.ramp >= 0 else {})
        for part in (section, following)
    )
    return [(before[lane], after[lane]) for lane in sorted(before) if lane in after]


def _bounds(road: Road) -> str:
    """The box around a road and its crossing roads on the map: least x and y, largest x and y."""
    s = drawn_points(road.line, 0.0, road.end, _segment(road))  # m along the road
    outlines = [map_places(road.line, s, edge)[:2] for edge in (road.right_edge, road.left_edge)]
    for it in road.crossings:
        ends = np.array([-it.reach, it.reach])
        outlines.append(map_places(road.line, np.full(2, it.at), ends)[:2])
    points = np.hstack(outlines)  # rows: x, y
    write = "{:.2f}".format if road.bent else _metres
    return ",".join(map(write, (*points.min(axis=1), *points.max(axis=1))))


def _shape(road: Road, s: FloatArray | float, d: float) -> str:
    """Positions s along the road at an offset d, m, as a shape in SUMO's map coordinates."""
    write = "{:.4f}".format if road.bent else _metres
    places = map_places(road.line, np.atleast_1d(s), d)[:2]
    return " ".join(f"{write(x)},{write(y)}" for x, y in zip(*places, strict=True))


def routes_xml(
    concrete: ConcreteScenario,
    vehicle: VehicleSettings,
    ego_type: Mapping[str, str] | None = None,
    *,
    origin: str = "",
) -> str:
    """Vehicle types and departures of a concrete scenario; a comment names the scenario.

    vehicle: as in `vehicle_types`.
    ego_type: vType attributes of the ego, added to the usual ones or instead of them.
    origin: a sentence on where the file comes from.
    """
    # `etree` takes a third of the time of `E`, and every case has such a file
    root = etree.Element("routes")
    root.addprevious(etree.Comment(_remarks(concrete, origin)))
    for attributes in vehicle_types(concrete, vehicle, ego_type):
        etree.SubElement(root, "vType", attributes)
    starts = departures(concrete, vehicle.length, exact=True)
    routes = vehicle_routes(concrete, starts)
    for attributes in starts:
        route = attributes["route"]
        if edges := routes.pop(route, ()):
            etree.SubElement(root, "route", id=route, edges=" ".join(edges))
        etree.SubElement(root, "vehicle", attributes)
    return document(root)


def vehicle_types(
    concrete: ConcreteScenario, vehicle: VehicleSettings, ego_type: Mapping[str, str] | None = None
) -> list[Attributes]:
    """Attributes of the vTypes of a case, the ego's first.

    vehicle: settings of the ego, as `concrete.simulation` gives them.
    """
    vehicle = gripped(vehicle)
    strongest = vehicle.max_deceleration
    ego = _texts(
        id=EGO, length=vehicle.length, width=vehicle.width, accel=vehicle.max_acceleration,
        decel=strongest, emergencyDecel=strongest, maxSpeed=vehicle.max_speed,
        desiredMaxSpeed=_desired(concrete.ego.speed), **_EXACT, tau="1", color="0,0.6,0.2",
    )  # fmt: skip
    others = [
        _texts(
            id=actor.name, length=actor.length, width=actor.width, accel="10", decel="10",
            emergencyDecel="10", maxSpeed=concrete.road.speed_limit,
            desiredMaxSpeed=_desired(actor.start.speed), **_EXACT, color="0.8,0.2,0.1",
        ) | _own_attributes(actor)
        for actor in concrete.actors
    ]  # fmt: skip
    return [ego | dict(ego_type or {}), *others]


@functools.lru_cache(maxsize=64)  # checked once for all cases
def gripped(vehicle: VehicleSettings) -> VehicleSettings:
    """The vehicle with brakes and drive no stronger than its tyres hold: SUMO knows no friction."""
    grip = vehicle.friction * GRAVITY
    brakes, drive = min(vehicle.max_deceleration, grip), min(vehicle.max_acceleration, grip)
    return replace(vehicle, max_deceleration=brakes, max_acceleration=drive)


_EXACT = {"minGap": "0", "sigma": "0", "speedDev": "0"}
"""No standstill gap is kept, and nothing is random."""


def _own_attributes(actor: Actor) -> Attributes:
    """Attributes of an actor's vType that a car without a SUMO model does not have."""
    model = actor.model
    if actor.body == CAR and model is None:
        return {}
    body = BODIES[actor.body]
    attributes = {"vClass": body.sumo_class, "guiShape": body.shape}
    if model is not None:
        attributes |= _texts(
            carFollowModel=model.name, desiredMaxSpeed=_desired(model.desired),
            accel="2.6", decel="4.5", emergencyDecel="9", minGap="2.5", tau="1",
            # without it SUMO never passes a slower vehicle that drives further to the left
            lcOvertakeRight="1",
        ) | _texts(**dict(model.numbers))  # fmt: skip
        # without the noise of the EIDM, which is drawn from a random stream that all vehicles share
        if model.name == "EIDM":
            attributes |= {"sigmaleader": "0", "sigmagap": "0", "sigmaerror": "0"}
    return attributes


def first_front(road: Road, start: Start, length: float) -> float:
    """x of a vehicle's front bumper at the start, m.

    Half a length beside a curved line is more or less than that length along the line.

    length: of the body, m.
    """
    if not road.line:  # faster, as every case asks this of each vehicle more than once
        return start.x + 0.5 * length
    bend = float(curvatures(road.line, start.x))
    return start.x + 0.5 * length / (1.0 - bend * start.y)


def departure_speed(actor: Actor) -> float:
    """Speed at which SUMO inserts an actor, m/s: at most the desired speed of the actor's model, as
    SUMO refuses more. `Stage.take_charge` then gives the actor its first speed.
    """
    speed = actor.start.speed
    return speed if actor.model is None else min(speed, _desired(actor.model.desired))


def inserted(
    concrete: ConcreteScenario, ego_length: float
) -> Iterator[tuple[str, Start, float, object]]:
    """Vehicles that SUMO inserts, the ego first: name, start, length, m, and place on the map.

    The place is `Actor.on_map`: None for a vehicle whose path is along the road.
    """
    yield EGO, concrete.ego, ego_length, None
    for it in concrete.actors:
        speed = departure_speed(it)
        start = it.start if speed == it.start.speed else replace(it.start, speed=speed)
        # Beside a curve, the front of an actor with a place on the map may be beyond the road.
        # SUMO inserts the actor on the road, and it is moved there before the first step.
        if it.on_map is not None:
            start = replace(
                start, x=min(max(start.x, it.length / 2), concrete.road.end - it.length)
            )
        yield it.name, start, it.length, it.on_map


def departures(
    concrete: ConcreteScenario, ego_length: float, *, one_lane: bool = False, exact: bool = False
) -> list[Attributes]:
    """Attributes of the vehicles of a case, the ego first.

    ego_length: m.
    one_lane: the network has only lane 0 (`shared_files.fits_one_lane`).
    exact: on a curved road, vehicles depart in their own lanes, at their true places on the map.
    """
    vehicles = []
    road = concrete.road
    for name, start, length, _ in inserted(concrete, ego_length):
        front = first_front(road, start, length)  # SUMO's position is the front bumper
        # On a curved road a position along the road is that along lane 0 alone (`network_xml`). So
        # every vehicle departs there, unless SUMO's models or an ADS look at lanes.
        in_lane_0 = one_lane or (road.bent and not (concrete.reacts or exact))
        own_lane = lane_at(road, start.y)
        lane = 0 if in_lane_0 else own_lane
        attributes = _texts(
            id=name, type=name, route="along", depart="0", departLane=str(lane), departPos=front,
            departSpeed=start.speed,
            # with checks SUMO would delay a vehicle that it finds too close: another, safer case
            insertionChecks="none",
        )  # fmt: skip
        if road.network is not None:
            ends = [end for _, end, _ in road.network.sections]
            index = min(bisect_left(ends, front), len(ends) - 1)
            begin, _, first_lane = road.network.sections[index]
            attributes |= _texts(
                departEdge=str(index), departLane=str(lane + first_lane), departPos=front - begin
            )
        elif road.spans and not one_lane:
            lane, departure = _departure(road, name, (own_lane, lane), front, exact=exact)
            attributes |= departure
        elif road.bent and exact and lane:
            attributes |= _texts(departPos=_lane_metres(road, lane, (0.0, front, road.end)))
        if start.y != road.lane_centre(lane):
            attributes["departPosLat"] = _number(start.y - road.lane_centre(lane))
        vehicles.append(attributes)
    return vehicles


def _departure(
    road: Road, name: str, lanes: tuple[int, int], front: float, *, exact: bool
) -> tuple[int, Attributes]:
    """The lane in which a vehicle departs on a road of several sections, and attributes of its
    departure; no attributes beyond the road's end.

    lanes: the lane in which the vehicle starts, and the lane that it asks for. The first decides
        whether it departs on the main edge or on a ramp's, the second in which lane of that edge:
        in the nearest one.
    front: x of the vehicle's front bumper, m.
    exact: as in `departures`.
    """
    own_lane, lane = lanes
    for index, section in enumerate(sections(road)):
        if front <= section.end:
            on_edge = (section.ramp,) if own_lane == section.ramp else section.lanes
            nearest = min(max(lane, on_edge[0]), on_edge[-1])
            position = front - section.begin
            # SUMO counts metres along a lane, which beside lane 0 are not those of the road. In the
            # lane that it asked for, a vehicle keeps those of the road, unless it must be exact.
            if road.bent and nearest != 0 and (exact or nearest != lane):
                position = _lane_metres(road, nearest, (section.begin, front, section.end))
            return nearest, _texts(
                route=f"along_{name}", departEdge=str(index),
                departLane=str(on_edge.index(nearest)), departPos=position,
            )  # fmt: skip
    return lane, {}


def _lane_metres(road: Road, lane: int, x: tuple[float, float, float]) -> float:
    """Position along a lane beside a curved road's line, in SUMO's metres: for SUMO each lane of a
    section is as long as the line there.

    x: of the beginning of the section, of the position, and of the section's end, m.
    """
    direction = map_places(road.line, np.array(x), 0.0)[2]  # of the line, rad
    # a lane at the offset d is shorter than the line by d times the angle that the line turns
    begin, position, end = (np.array(x) - road.lane_centre(lane) * direction).tolist()
    return float((x[2] - x[0]) * (position - begin) / (end - begin))


def _remarks(concrete: ConcreteScenario, origin: str) -> str:
    """Comment of a route file: the concrete scenario, and the motions that such a file lacks."""
    lines = [f"{concrete.scenario}: {concrete.label}."]
    if origin:
        lines.append(origin)
    for actor in concrete.actors:
        missing = f"Not in this file: `{actor.name}`"
        if actor.lively and not actor.follows_at_once:
            lines.append(
                f"Not in this file: what `{actor.name}` does. The harness moves it step by step, "
                "and here it keeps its speed and drives along the road."
            )
        lines += [
            f"{missing} moves {abs(move.offset):g} m to the "
            f"{'left' if move.offset > 0 else 'right'} from {move.begin:g} s to "
            f"{move.begin + move.duration:g} s. A route file cannot say that: the harness moves "
            "the vehicle step by step, and here it stays in its lane."
            for move in actor.lateral_moves
        ]
        if actor.braking is not None:
            lines.append(
                f"{missing} brakes to a standstill with {actor.braking.acceleration:g} m/s2 from "
                f"{actor.braking.begin:g} s on. The harness moves it step by step, and here it "
                "keeps its speed."
            )
    text = "\n     ".join(lines)
    return re.sub("-(?=-)", "- ", f" {text} ")  # two hyphens would end the comment


def view_xml(road: Road) -> str:
    """View of sumo-gui at the start of a case: the beginning of the road, slowed down."""
    zoom = 100 * road.end / VIEW_LENGTH  # per cent; at 100 sumo-gui shows the whole network
    middle = (road.left_edge + road.right_edge) / 2
    viewport = E.viewport(zoom=f"{zoom:g}", x=f"{VIEW_LENGTH / 2:g}", y=f"{middle:g}")
    return document(E.viewsettings(viewport, E.delay(value="50")))


def case_files(
    concrete: ConcreteScenario, settings: SimulationSettings, network: str, routes: str,
    origin: str = "",
) -> dict[str, str]:  # fmt: skip
    """Texts of the files that open a case in sumo-gui, by path: network, view, routes,
    configuration.

    network, routes: paths of the network and of the routes, without their endings. The view gets
        the path of the network, the configuration that of the routes.
    origin: as of `routes_xml`.
    """
    paths = f"{network}.net.xml", f"{routes}.rou.xml", f"{network}.view.xml"
    net, rou, view = (relpath(path, dirname(routes)) for path in paths)
    return {
        paths[0]: network_xml(concrete.road),
        paths[2]: view_xml(concrete.road),
        paths[1]: routes_xml(concrete, concrete.simulation(settings).vehicle, origin=origin),
        f"{routes}.sumocfg": configuration_xml(
            net, rou, settings.step, lane_change_duration=settings.lane_change_duration, view=view
        ),
    }


def configuration_xml(
    network: str, routes: str, step: float, *, lane_change_duration: float, view: str | None = None
) -> str:
    """A .sumocfg that opens the case in sumo-gui with the options that the harness uses.

    step: s.
    lane_change_duration: s, of a lane change that SUMO itself performs.
    network, routes, view: the files, relative to this one; without a view sumo-gui shows the whole
        network.
    """
    options = SIMULATION_OPTIONS | {"lanechange.duration": f"{lane_change_duration:g}"}
    return document(E.configuration(
        E.input(E("net-file", value=network), E("route-files", value=routes)),
        E.time(E.begin(value="0"), E("step-length", value=f"{step:g}")),
        E.processing(*(E(name, value=value) for name, value in options.items())),
        *([] if view is None else [E.gui_only(E("gui-settings-file", value=view))]),
    ))  # fmt: skip


SIMULATION_OPTIONS = {
    "step-method.ballistic": "true",
    "collision.action": "warn",  # "none" reports nothing, the default "teleport" moves vehicles
    "collision.mingap-factor": "0",  # bodies that are closer than minGap do not collide yet
    "time-to-teleport": "-1",
    "default.speeddev": "0",
}
"""Options of SUMO in every simulation, in addition to the files and the step."""
