"""SUMO networks, routes and configurations as text, written from a road and a concrete scenario.

One writer serves the checked-in files, the run folder and the simulation itself: what opens in sumo-gui is what ran.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping

import numpy as np
from lxml import etree

from sumo_eval.scenario.bodies import BODIES, CAR
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road
from sumo_eval.scenario.road.reference_line import drawn_points, map_places
from sumo_eval.scenario.sumo_network import laid_along_x
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.trajectory import FloatArray

EGO = "ego"
SEGMENT = 1.0  # m between the vertices of a lane on a bend
_EDGE = "road"


def road_edges(road: Road) -> tuple[str, ...]:
    """Ids of the edges that are driven along."""
    return (_EDGE,) if road.network is None else road.network.edges


def _text(root: etree._Element) -> str:
    return etree.tostring(root.getroottree(), pretty_print=True, xml_declaration=True, encoding="UTF-8").decode()


def _number(value: float) -> str:
    return repr(float(value))


def _desired(speed: float) -> str:
    """A vehicle that SUMO's own models drive wants to keep its initial speed, not the road's limit; 0 is refused."""
    return _number(max(speed, 0.001))


def _metres(value: float) -> str:
    """Two decimals as netconvert writes them, and all of them where two would move a lane or a road end."""
    text = f"{value:.2f}"
    return text if float(text) == value else _number(value)


@functools.lru_cache(maxsize=64)
def network_xml(road: Road) -> str:
    """A one-way road as a final SUMO network (no netconvert needed): lane 0's centre line is y = 0.

    On a road that bends all lanes are offsets of that line, with a vertex at every metre of bend, and have its length,
    as SUMO wants of neighbours: it stretches a shape to the length evenly, so places on lane 0 alone are exact. A road
    in a network of the user's is that network, laid along the x axis.
    """
    if road.network is not None:
        return laid_along_x(road.network)
    end = road.length + road.run_out
    middle = (road.left_edge + road.right_edge) / 2
    line = drawn_points(road.line, 0.0, end, SEGMENT) if road.bent else None
    net = etree.Element("net", version="1.20", junctionCornerDetail="5", limitTurnSpeed="5.50")
    bounds = f"0.00,0.00,{_metres(end)},{_metres(road.lane_centre(road.lanes - 1))}"
    if line is not None:
        corners = np.hstack([map_places(road.line, line, edge)[:2] for edge in (road.right_edge, road.left_edge)])
        bounds = ",".join(f"{value:.2f}" for value in (*corners.min(axis=1), *corners.max(axis=1)))
    etree.SubElement(
        net, "location", netOffset="0.00,0.00", convBoundary=bounds, origBoundary=bounds, projParameter="!"
    )
    edge = etree.SubElement(net, "edge", {"id": _EDGE, "from": "begin", "to": "end", "priority": "1"})
    for lane in range(road.lanes):
        y = road.lane_centre(lane)
        etree.SubElement(
            edge,
            "lane",
            id=f"{_EDGE}_{lane}",
            index=str(lane),
            speed=_metres(road.speed_limit),
            length=_metres(end),
            width=_metres(road.lane_width),
            shape=f"0.00,{_metres(y)} {_metres(end)},{_metres(y)}" if line is None else _polyline(road, line, y),
        )
    lanes = " ".join(f"{_EDGE}_{lane}" for lane in range(road.lanes))
    for name, x, incoming in (("begin", 0.0, ""), ("end", end, lanes)):
        edges = (road.left_edge, road.right_edge) if name == "begin" else (road.right_edge, road.left_edge)
        shape = " ".join(f"{_metres(x)},{_metres(y)}" for y in edges)
        at = _metres(x), _metres(middle)
        if line is not None:
            shape = " ".join(_polyline(road, np.array([x]), y) for y in edges)
            at = tuple(_polyline(road, np.array([x]), middle).split(","))  # type: ignore[assignment]
        etree.SubElement(
            net,
            "junction",
            id=name,
            type="dead_end",
            x=at[0],
            y=at[1],
            incLanes=incoming,
            intLanes="",
            shape=shape,
        )
    return _text(net)


def _polyline(road: Road, s: FloatArray, d: float) -> str:
    """A line beside the road's as SUMO has a shape."""
    x, y, _ = map_places(road.line, s, d)
    return " ".join(f"{east:.4f},{north:.4f}" for east, north in zip(x.tolist(), y.tolist(), strict=True))


def routes_xml(
    concrete: ConcreteScenario,
    vehicle: VehicleSettings,
    ego_type: Mapping[str, str] | None = None,
    *,
    origin: str = "",
) -> str:
    """Vehicle types and departures of a concrete scenario, with a comment that says which one it is.

    `ego_type` adds to or replaces the ego's vType attributes; `origin`: a sentence on where the file comes from.
    """
    vehicle = concrete.ego_vehicle(vehicle)
    routes = etree.Element("routes")
    routes.addprevious(etree.Comment(_remarks(concrete, origin)))
    for attributes in vehicle_types(concrete, vehicle, ego_type):
        etree.SubElement(routes, "vType", attributes)
    etree.SubElement(routes, "route", id="along", edges=" ".join(road_edges(concrete.road)))
    for attributes in departures(concrete, vehicle.length):
        etree.SubElement(routes, "vehicle", attributes)
    return _text(routes)


def vehicle_types(
    concrete: ConcreteScenario, vehicle: VehicleSettings, ego_type: Mapping[str, str] | None = None
) -> list[dict[str, str]]:
    """Attributes of the vTypes of a case, the ego's first; `vehicle` has the body that the scenario prescribes."""
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
            "lcOvertakeRight": "1",  # else nobody passes a slower vehicle that drives further to the left
            **{name: _number(value) for name, value in numbers.items()},
        }
        if actor.model.name == "EIDM":  # whose noise is drawn from a stream that all vehicles share
            found |= {"sigmaleader": "0", "sigmagap": "0", "sigmaerror": "0"}
    return found


def departures(concrete: ConcreteScenario, ego_length: float, *, one_lane: bool = False) -> list[dict[str, str]]:
    """Attributes of the vehicles of a case, the ego first. one_lane: there is the right-hand lane alone."""
    found = []
    road = concrete.road
    starts = [(EGO, concrete.ego, ego_length), *((a.name, a.start, a.length) for a in concrete.actors)]
    for name, start, length in starts:
        lane = min(max(round(start.y / road.lane_width), 0), road.lanes - 1)
        if one_lane or (road.bent and not concrete.reacts):  # on a bend SUMO's place is exact along the line alone
            lane = 0
        offset = start.y - road.lane_centre(lane)
        attributes = {
            "id": name,
            "type": name,
            "route": "along",
            "depart": "0",
            "departLane": str(lane),
            "departPos": _number(start.x + length / 2),  # SUMO's position is the front bumper
            "departSpeed": _number(start.speed),
            "insertionChecks": "none",  # else SUMO delays a vehicle that it finds too close, and the case turns safe
        }
        if offset:
            attributes["departPosLat"] = _number(offset)
        found.append(attributes)
    return found


def _remarks(concrete: ConcreteScenario, origin: str) -> str:
    lines = [f"{concrete.scenario}: {concrete.label}."]
    lines += [origin] if origin else []
    for actor in concrete.actors:
        if actor.acts or actor.heading:
            lines.append(
                f"Not in this file: what `{actor.name}` does. The harness moves it step by step, and here it keeps its "
                "speed."
            )
        for move in actor.lane_changes:
            side = "left" if move.offset > 0 else "right"
            lines.append(
                f"Not in this file: `{actor.name}` moves {abs(move.offset):g} m to the {side} from {move.begin:g} s to "
                f"{move.begin + move.duration:g} s. A route file cannot say that: the harness moves the vehicle step "
                "by step, and here it stays in its lane."
            )
        if actor.brake is not None:
            lines.append(
                f"Not in this file: `{actor.name}` brakes to a standstill with {actor.brake.deceleration:g} m/s2 from "
                f"{actor.brake.begin:g} s on. The harness moves it step by step, and here it keeps its speed."
            )
    text = "\n     ".join(lines)
    return f" {text} ".replace("--", "- -")  # which ends an XML comment


@functools.lru_cache(maxsize=64)
def view_xml(road: Road) -> str:
    """Where sumo-gui looks when it opens a case: the beginning of the road, slowed down enough to be watched."""
    root = etree.Element("viewsettings")
    zoom = 100 * (road.length + road.run_out) / VIEW_LENGTH  # per cent of a view of the whole network
    middle = (road.left_edge + road.right_edge) / 2
    etree.SubElement(root, "viewport", zoom=f"{zoom:g}", x=f"{VIEW_LENGTH / 2:g}", y=f"{middle:g}")
    etree.SubElement(root, "delay", value="50")
    return _text(root)


def configuration_xml(
    network: str, routes: str, step: float, *, lane_change_duration: float | None = None, view: str | None = None
) -> str:
    """A .sumocfg that opens the case in sumo-gui with the options that the harness uses.

    step: s. lane_change_duration: s, of a lane change that SUMO itself performs; the settings' default if not given.
    network, routes, view: the files, relative to this one; without a view sumo-gui shows the whole network.
    """
    duration = SimulationSettings().lane_change_duration if lane_change_duration is None else lane_change_duration
    root = etree.Element("configuration")
    inputs = etree.SubElement(root, "input")
    etree.SubElement(inputs, "net-file", value=network)
    etree.SubElement(inputs, "route-files", value=routes)
    time = etree.SubElement(root, "time")
    etree.SubElement(time, "begin", value="0")
    etree.SubElement(time, "step-length", value=f"{step:g}")
    processing = etree.SubElement(root, "processing")
    for name, value in {**SIMULATION_OPTIONS, "lanechange.duration": f"{duration:g}"}.items():
        etree.SubElement(processing, name, value=value)
    if view is not None:
        etree.SubElement(etree.SubElement(root, "gui_only"), "gui-settings-file", value=view)
    return _text(root)


VIEW_LENGTH = 250.0  # m of road that sumo-gui shows at first


SIMULATION_OPTIONS = {
    "step-method.ballistic": "true",
    "collision.action": "warn",  # "none" reports nothing at all, and the default teleports
    "collision.mingap-factor": "0",  # minGap is no part of a body
    "time-to-teleport": "-1",
    "default.speeddev": "0",
}
"""SUMO options in force in every simulation, beside the files and the step."""
