"""SUMO networks, routes and configurations as text, written from a road and a concrete scenario.

One writer serves the checked-in files, the run folder and the simulation itself: what opens in
sumo-gui is what ran.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from lxml import etree
from lxml.builder import ElementMaker  # type: ignore[import-not-found]

from sumo_eval.scenario.bodies import BODIES, CAR
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road
from sumo_eval.scenario.road.reference_line import drawn_points, map_places, tightest
from sumo_eval.scenario.sumo_network import laid_along_x
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.trajectory import FloatArray

EGO = "ego"
SEGMENT = 1.0  # m between the vertices of a lane on a bend
# m: below this radius they are closer, so that a chord is as near to its arc as here
_TIGHT = 100.0
_EDGE = "road"


def road_edges(road: Road) -> tuple[str, ...]:
    """Ids of the edges that are driven along."""
    if road.network is not None:
        return road.network.edges
    return tuple(section.edge for section in sections(road)) if road.spans else (_EDGE,)


class Section(NamedTuple):
    """A stretch of a road with the same lanes throughout, an edge of its own.

    lanes: those on it; SUMO counts from its right-hand one.
    ramp: the lane that a line parts from it, -1: none; an edge beside it, `ramp_edge`.
    """

    edge: str
    begin: float
    end: float
    lanes: tuple[int, ...]
    ramp: int
    ramp_edge: str


@functools.lru_cache(maxsize=64)
def sections(road: Road) -> tuple[Section, ...]:
    """The sections of a road whose lanes are not the same throughout.

    SUMO knows no tapers: lanes end square.
    """
    last = road.length + road.run_out
    places = {0.0, last}
    for span in road.spans:
        places |= {
            it
            for it in (span.begin, span.end, span.parted_until, span.parted_from)
            if 0.0 < it < last
        }
    found = []
    for number, (begin, end) in enumerate(itertools.pairwise(sorted(places))):
        lanes, ramp = [], -1
        for lane in road.lanes_at(0.5 * (begin + end)):
            span = road.span(lane)
            if end <= span.parted_until or begin >= span.parted_from:
                ramp = lane
            else:
                lanes.append(lane)
        found.append(
            Section(
                f"{_EDGE}{number}",
                begin,
                end,
                tuple(lanes),
                ramp,
                f"ramp{number}" if ramp >= 0 else "",
            )
        )
    return tuple(found)


def vehicle_edges(road: Road, y: float, goal: float | None = None) -> tuple[str, ...]:
    """The edges of a route that begins in the lane at y, m, and ends in the lane at `goal`; None:
    in the first one.
    """
    if not road.spans or road.network is not None:
        return road_edges(road)
    first, last = (_lane_at(road, place) for place in (y, y if goal is None else goal))
    found = []
    for section in sections(road):
        on_ramp = section.ramp >= 0 and section.ramp == (first if section.begin == 0.0 else last)
        found.append(section.ramp_edge if on_ramp else section.edge)
    return tuple(found)


def _lane_at(road: Road, y: float) -> int:
    return min(max(round(y / road.lane_width), 0), road.lanes - 1)


def _text(root: Any) -> str:
    return etree.tostring(
        root.getroottree(), pretty_print=True, xml_declaration=True, encoding="UTF-8"
    ).decode()


def _number(value: float) -> str:
    return repr(float(value))


def _desired(speed: float) -> str:
    """A vehicle that SUMO's own models drive wants to keep its initial speed, not the road's limit;
    0 is refused.
    """
    return _number(max(speed, 0.001))


def _metres(value: float) -> str:
    """Two decimals as netconvert writes them, and all of them where two would move a lane or a road
    end.
    """
    text = f"{value:.2f}"
    return text if float(text) == value else _number(value)


E: Any = ElementMaker(
    typemap={float: lambda _, value: _metres(value), int: lambda _, value: str(value)}
)


@functools.lru_cache(maxsize=64)
def network_xml(road: Road) -> str:
    """A one-way road as a final SUMO network (no netconvert needed): lane 0's centre line is y = 0.

    On a road that bends all lanes are offsets of that line, with a vertex at every metre of bend,
    and have its length, as SUMO wants of neighbours: it stretches a shape to the length evenly, so
    places on lane 0 alone are exact. A road in a network of the user's is that network, laid along
    the x axis.
    """
    if road.network is not None:
        return laid_along_x(road.network)
    if road.shaped:
        return _shaped_xml(road)
    end = road.length + road.run_out
    bounds = f"0.00,0.00,{_metres(end)},{_metres(road.lane_centre(road.lanes - 1))}"
    ids = [f"{_EDGE}_{lane}" for lane in range(road.lanes)]
    lanes = [
        _lane(
            road, name, lane, end, road.lane_width, _along(road, 0.0, end, road.lane_centre(lane))
        )
        for lane, name in enumerate(ids)
    ]
    edges = road.left_edge, road.right_edge
    return _network(_bounds(road, end) if road.bent else bounds, [
        _edge(_EDGE, "begin", "end", lanes),
        _junction(road, "begin", 0.0, sum(edges) / 2, [], edges),
        _junction(road, "end", end, sum(edges) / 2, ids, edges[::-1]),
    ])  # fmt: skip


def _network(bounds: str, parts: Sequence[Any]) -> str:
    location = E.location(
        netOffset="0.00,0.00", convBoundary=bounds, origBoundary=bounds, projParameter="!"
    )
    return _text(
        E.net(location, *parts, version="1.20", junctionCornerDetail="5", limitTurnSpeed="5.50")
    )


def _edge(name: str, begin: str, end: str, lanes: Sequence[Any]) -> Any:
    return E.edge({"id": name, "from": begin, "to": end, "priority": "1"}, *lanes)


def _lane(road: Road, name: str, index: int, length: float, width: float, shape: str) -> Any:
    return E.lane(
        id=name, index=index, speed=road.speed_limit, length=length, width=width, shape=shape
    )


def _junction(
    road: Road,
    name: str,
    x: float,
    y: float,
    lanes: Sequence[str],
    edges: Sequence[float],
    links: int = 0,
) -> Any:
    """The end of edges.

    lanes: that lead there.
    edges: y of the ends of its shape, m.
    links: lanes that continue.
    """
    at, none = _place(road, x, y).split(","), "0" * links
    return E.junction(
        *(E.request(index=index, response=none, foes=none, cont=0) for index in range(links)),
        id=name, type="priority" if links else "dead_end", x=at[0], y=at[1],
        incLanes=" ".join(lanes), intLanes="",
        shape=" ".join(_place(road, x, edge) for edge in edges),
    )  # fmt: skip


def _segment(road: Road) -> float:
    """m between the vertices of a road's lanes where it bends: a chord's height goes with its
    square by the radius.
    """
    return SEGMENT * math.sqrt(min(tightest(road.line) / _TIGHT, 1.0))


def _shaped_xml(road: Road) -> str:
    """A road of several edges, one a section, its ramps beside it, and the roads that cross it, as
    a network.
    """
    last = road.length + road.run_out
    reach = max([0.0, *(crossing.reach for crossing in road.crossings)])
    low, high = min(road.right_edge, -reach), max(road.left_edge, reach)
    bounds = f"0.00,{_metres(low)},{_metres(last)},{_metres(high)}"
    parts = (
        sections(road)
        if road.spans
        else (Section(_EDGE, 0.0, last, tuple(range(road.lanes)), -1, ""),)
    )
    names = [f"node{number}" for number in range(len(parts) + 1)]
    middle, begins = (
        0.5 * (road.left_edge + road.right_edge),
        (*(part.begin for part in parts), last),
    )
    where = {name: (place, middle) for name, place in zip(names, begins, strict=True)}
    ways: list[tuple[str, str, str, list[tuple[str, float, float]]]] = []
    for number, part in enumerate(parts):
        lanes = [
            (f"{part.edge}_{k}", road.lane_centre(lane), road.lane_width)
            for k, lane in enumerate(part.lanes)
        ]
        ways.append((part.edge, names[number], names[number + 1], lanes))
        if part.ramp >= 0:
            y = road.lane_centre(part.ramp)
            begin, end = names[number], names[number + 1]
            if part.begin == 0.0:
                begin = f"{part.ramp_edge}_begin"
                where[begin] = (0.0, y)
            if part.end == last:
                end = f"{part.ramp_edge}_end"
                where[end] = (last, y)
            ways.append((part.ramp_edge, begin, end, [(f"{part.ramp_edge}_0", y, road.lane_width)]))
    into: dict[str, list[str]] = {}
    found = []
    for edge, begin, end, lanes in ways:
        first, until = where[begin][0], where[end][0]
        into.setdefault(end, []).extend(lane for lane, _, _ in lanes)
        found.append(_edge(edge, begin, end, [
            _lane(road, lane, index, until - first, width, _along(road, first, until, y))
            for index, (lane, y, width) in enumerate(lanes)
        ]))  # fmt: skip
    for number, crossing in enumerate(road.crossings):
        edge = f"crossing{number}"
        begin, end, lane = f"{edge}_begin", f"{edge}_end", f"{edge}_0"
        where |= {begin: (crossing.at, -crossing.reach), end: (crossing.at, crossing.reach)}
        into[end] = [lane]
        shape = " ".join(_place(road, *where[name]) for name in (begin, end))
        found.append(
            _edge(
                edge,
                begin,
                end,
                [_lane(road, lane, 0, 2.0 * crossing.reach, crossing.width, shape)],
            )
        )
    joints = _joints(road, parts)
    for name, place in where.items():
        links = len(joints[names.index(name)]) if name in names[1:-1] else 0
        found.append(
            _junction(
                road, name, *place, into.get(name, ()), (road.right_edge, road.left_edge), links
            )
        )
    for one, from_lane, other, to_lane in itertools.chain(*joints.values()):
        found.append(E.connection({
            "from": one, "to": other, "fromLane": str(from_lane), "toLane": str(to_lane),
            "dir": "s", "state": "M",
        }))  # fmt: skip
    return _network(_bounds(road, last) if road.bent else bounds, found)


def _joints(road: Road, parts: Sequence[Section]) -> dict[int, list[tuple[str, int, str, int]]]:
    """Where lanes go on from one section to the next: edge and index, of both.

    By the number of the node between.
    """
    found: dict[int, list[tuple[str, int, str, int]]] = {}

    def place(part: Section, lane: int) -> tuple[str, int] | None:
        if lane == part.ramp:
            return part.ramp_edge, 0
        return (part.edge, part.lanes.index(lane)) if lane in part.lanes else None

    for number, (one, other) in enumerate(itertools.pairwise(parts), 1):
        links = []
        for lane in range(road.lanes):
            before, after = place(one, lane), place(other, lane)
            if before is not None and after is not None:
                links.append((*before, *after))
        found[number] = links
    return found


def _along(road: Road, first: float, until: float, y: float) -> str:
    """The shape of a lane from one place along the road to another, y beside its line."""
    if not road.bent:
        return f"{_metres(first)},{_metres(y)} {_metres(until)},{_metres(y)}"
    return _polyline(road, drawn_points(road.line, first, until, _segment(road)), y)


def _place(road: Road, x: float, y: float) -> str:
    """A place along and across the road as SUMO has one on the map."""
    return _polyline(road, np.array([x]), y) if road.bent else f"{_metres(x)},{_metres(y)}"


def _bounds(road: Road, end: float) -> str:
    """What encloses a road that bends, up to `end`, m, and those that cross it."""
    line = drawn_points(road.line, 0.0, end, _segment(road))
    edges = [map_places(road.line, line, edge)[:2] for edge in (road.right_edge, road.left_edge)]
    for crossing in road.crossings:
        edges += [
            map_places(road.line, np.array([crossing.at]), end * crossing.reach)[:2]
            for end in (-1.0, 1.0)
        ]
    corners = np.hstack(edges)
    return ",".join(f"{value:.2f}" for value in (*corners.min(axis=1), *corners.max(axis=1)))


def _polyline(road: Road, s: FloatArray, d: float) -> str:
    """A line beside the road's as SUMO has a shape."""
    x, y, _ = map_places(road.line, s, d)
    return " ".join(
        f"{east:.4f},{north:.4f}" for east, north in zip(x.tolist(), y.tolist(), strict=True)
    )


def routes_xml(
    concrete: ConcreteScenario,
    vehicle: VehicleSettings,
    ego_type: Mapping[str, str] | None = None,
    *,
    origin: str = "",
) -> str:
    """Vehicle types and departures of a concrete scenario, with a comment that says which one it
    is.

    `ego_type` adds to or replaces the ego's vType attributes; `origin`: a sentence on where the
    file comes from.
    """
    vehicle = concrete.ego_vehicle(vehicle)
    routes = E.routes(
        *(E.vType(attributes) for attributes in vehicle_types(concrete, vehicle, ego_type))
    )
    routes.addprevious(etree.Comment(_remarks(concrete, origin)))
    for attributes in departures(concrete, vehicle.length):
        edges = " ".join(_route(concrete, attributes["id"]))
        if routes.find(f"route[@id='{attributes['route']}']") is None:
            routes.append(E.route(id=attributes["route"], edges=edges))
        routes.append(E.vehicle(attributes))
    return _text(routes)


def vehicle_types(
    concrete: ConcreteScenario, vehicle: VehicleSettings, ego_type: Mapping[str, str] | None = None
) -> list[dict[str, str]]:
    """Attributes of the vTypes of a case, the ego's first; `vehicle` has the body that the scenario
    prescribes.
    """
    ego = {
        "id": EGO,
        "length": _number(vehicle.length),
        "width": _number(vehicle.width),
        "accel": _number(vehicle.max_acceleration),
        "decel": _number(vehicle.max_deceleration),
        "emergencyDecel": _number(vehicle.max_deceleration),
        "maxSpeed": _number(vehicle.max_speed),
        "desiredMaxSpeed": _desired(concrete.ego.speed),
        "minGap": "0",
        "sigma": "0",
        "speedDev": "0",
        "tau": "1",
        "color": "0,0.6,0.2",
        **(ego_type or {}),
    }
    others = [
        {
            "id": actor.name,
            "length": _number(actor.length),
            "width": _number(actor.width),
            "accel": "10",
            "decel": "10",
            "emergencyDecel": "10",
            "maxSpeed": _number(concrete.road.speed_limit),
            "desiredMaxSpeed": _desired(actor.start.speed),
            "minGap": "0",
            "sigma": "0",
            "speedDev": "0",
            "color": "0.8,0.2,0.1",
            **_as_it_is(actor),
        }
        for actor in concrete.actors
    ]
    return [ego, *others]


def _as_it_is(actor: Actor) -> dict[str, str]:
    """Attributes of a vType that differ from those of a car that the harness moves."""
    if actor.body == CAR and actor.model is None:
        return {}
    body = BODIES[actor.body]
    found = {"vClass": body.sumo_class, "guiShape": body.shape}
    if actor.model is not None:
        numbers = dict(actor.model.numbers)
        found |= {
            "carFollowModel": actor.model.name,
            "desiredMaxSpeed": _desired(actor.model.desired),
            "accel": "2.6",
            "decel": "4.5",
            "emergencyDecel": "9",
            "minGap": "2.5",
            "tau": "1",
            # else nobody passes a slower vehicle that drives further to the left
            "lcOvertakeRight": "1",
            **{name: _number(value) for name, value in numbers.items()},
        }
        if actor.model.name == "EIDM":  # whose noise is drawn from a stream that all vehicles share
            found |= {"sigmaleader": "0", "sigmagap": "0", "sigmaerror": "0"}
    return found


def _route(concrete: ConcreteScenario, name: str) -> tuple[str, ...]:
    """The edges of a vehicle's route."""
    if name == EGO:
        way, y = concrete.ego.way, concrete.ego.y
        return vehicle_edges(concrete.road, y, None if way is None else y + way.offset)
    actor = next(actor for actor in concrete.actors if actor.name == name)
    return vehicle_edges(
        concrete.road, actor.start.y, actor.y(math.inf) if actor.lateral_moves else None
    )


def departures(
    concrete: ConcreteScenario, ego_length: float, *, one_lane: bool = False
) -> list[dict[str, str]]:
    """Attributes of the vehicles of a case, the ego first.

    one_lane: there is the right-hand lane alone.
    """
    found = []
    road = concrete.road
    parted = bool(road.spans) and road.network is None and not one_lane
    starts = [
        (EGO, concrete.ego, ego_length),
        *((a.name, a.start, a.length) for a in concrete.actors),
    ]
    on_map = {a.name for a in concrete.actors if a.on_map is not None}
    for name, start, length in starts:
        lane = min(max(round(start.y / road.lane_width), 0), road.lanes - 1)
        # on a bend SUMO's place is exact along the line alone
        if one_lane or (road.bent and not concrete.reacts):
            lane = 0
        offset = start.y - road.lane_centre(lane)
        # SUMO has no lane there, and is told a place on the map before the first step
        if name in on_map:
            start = replace(
                start, x=min(max(start.x, length / 2), road.length + road.run_out - length)
            )
        if road.network is not None and road.spans and 0 not in road.lanes_at(start.x + length / 2):
            lane -= 1  # SUMO counts from the right-hand lane of the edge
        lane += 0 if road.network is None else road.network.first_lane
        section = (
            next((it for it in sections(road) if start.x + length / 2 <= it.end), None)
            if parted
            else None
        )
        attributes = {
            "id": name,
            "type": name,
            "route": "along",
            "depart": "0",
            "departLane": str(lane),
            "departPos": _number(start.x + length / 2),  # SUMO's position is the front bumper
            "departSpeed": _number(start.speed),
            # else SUMO delays a vehicle that it finds too close, and the case turns safe
            "insertionChecks": "none",
        }
        if section is not None:
            here = (section.ramp,) if lane == section.ramp else section.lanes
            attributes |= {
                "route": f"along_{name}",
                "departEdge": str(sections(road).index(section)),
                "departLane": str(here.index(min(max(lane, here[0]), here[-1]))),
                "departPos": _number(start.x + length / 2 - section.begin),
            }
        if offset:
            attributes["departPosLat"] = _number(offset)
        found.append(attributes)
    return found


def _remarks(concrete: ConcreteScenario, origin: str) -> str:
    lines = [f"{concrete.scenario}: {concrete.label}."]
    lines += [origin] if origin else []
    for actor in concrete.actors:
        if actor.lively and not actor.follows_at_once:
            lines.append(
                f"Not in this file: what `{actor.name}` does. The harness moves it step by step, "
                "and here it keeps its "
                "speed."
            )
        for move in actor.lateral_moves:
            side = "left" if move.offset > 0 else "right"
            lines.append(
                f"Not in this file: `{actor.name}` moves {abs(move.offset):g} m to the {side} "
                f"from {move.begin:g} s to "
                f"{move.begin + move.duration:g} s. A route file cannot say that: the harness "
                "moves the vehicle step "
                "by step, and here it stays in its lane."
            )
        if actor.braking is not None:
            lines.append(
                f"Not in this file: `{actor.name}` brakes to a standstill with "
                f"{actor.braking.acceleration:g} m/s2 "
                f"from {actor.braking.begin:g} s on. The harness moves it step by step, and here "
                "it keeps its speed."
            )
    text = "\n     ".join(lines)
    return f" {text} ".replace("--", "- -")  # which ends an XML comment


@functools.lru_cache(maxsize=64)
def view_xml(road: Road) -> str:
    """Where sumo-gui looks when it opens a case: the beginning of the road, slowed down enough to
    be watched.
    """
    # per cent of a view of the whole network
    zoom = 100 * (road.length + road.run_out) / VIEW_LENGTH
    middle = (road.left_edge + road.right_edge) / 2
    viewport = E.viewport(zoom=f"{zoom:g}", x=f"{VIEW_LENGTH / 2:g}", y=f"{middle:g}")
    return _text(E.viewsettings(viewport, E.delay(value="50")))


def configuration_xml(
    network: str,
    routes: str,
    step: float,
    *,
    lane_change_duration: float | None = None,
    view: str | None = None,
) -> str:
    """A .sumocfg that opens the case in sumo-gui with the options that the harness uses.

    step: s.
    lane_change_duration: s, of a lane change that SUMO itself performs; the settings' default if
        not given.
    network, routes, view: the files, relative to this one; without a view sumo-gui shows the whole
        network.
    """
    duration = (
        SimulationSettings().lane_change_duration
        if lane_change_duration is None
        else lane_change_duration
    )
    options = {**SIMULATION_OPTIONS, "lanechange.duration": f"{duration:g}"}
    return _text(E.configuration(
        E.input(E("net-file", value=network), E("route-files", value=routes)),
        E.time(E.begin(value="0"), E("step-length", value=f"{step:g}")),
        E.processing(*(E(name, value=value) for name, value in options.items())),
        *([] if view is None else [E.gui_only(E("gui-settings-file", value=view))]),
    ))  # fmt: skip


VIEW_LENGTH = 250.0  # m of road that sumo-gui shows at first


SIMULATION_OPTIONS = {
    "step-method.ballistic": "true",
    "collision.action": "warn",  # "none" reports nothing at all, and the default teleports
    "collision.mingap-factor": "0",  # minGap is no part of a body
    "time-to-teleport": "-1",
    "default.speeddev": "0",
}
"""SUMO options in force in every simulation, beside the files and the step."""
