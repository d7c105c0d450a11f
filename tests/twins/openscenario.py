"""A second, independent reader of OpenSCENARIO: steps of 0.01 s along reference lines that it
evaluates geometry by geometry, for an ego that keeps its speed. Tests compare places with it."""

import bisect
import itertools
import math
import operator
import re
from dataclasses import dataclass, field
from typing import Any

from lxml import etree

STEP = 0.01
PLAIN = etree.XMLParser(remove_comments=True)
RULES = {
    "greaterThan": operator.gt, "lessThan": operator.lt, "greaterOrEqual": operator.ge,
    "lessOrEqual": operator.le, "equalTo": operator.eq, "notEqualTo": operator.ne,
}  # fmt: skip
SHAPES = {
    "linear": lambda u: u,
    "step": lambda u: 1.0,
    "cubic": lambda u: u * u * (3.0 - 2.0 * u),
    "sinusoidal": lambda u: 0.5 - 0.5 * math.cos(math.pi * u),
}
PEAKS = {"linear": 1.0, "cubic": 1.5, "sinusoidal": 0.5 * math.pi}
Point = tuple[float, float, float]


class Road:
    """A reference line, and the lanes of its only section."""

    def __init__(self, element):
        self.geometries = list(element.iterfind("planView/geometry"))
        self.length = sum(float(it.get("length")) for it in self.geometries)
        shift = element.find("lanes/laneOffset")
        self.lanes = {}
        for side, sign in (("left", 1), ("right", -1)):
            edge = 0.0
            lanes = element.find("lanes/laneSection").findall(f"{side}/lane")
            for lane in sorted(lanes, key=lambda it: abs(int(it.get("id")))):
                held = lane.find("width")
                wide = 0.0 if held is None else float(held.get("a"))
                centre = sign * (edge + wide / 2) + (
                    0.0 if shift is None else float(shift.get("a"))
                )
                self.lanes[int(lane.get("id"))] = centre, wide, lane.get("type")
                edge += wide

    def at(self, s, t=0.0):
        """x, y and heading."""
        before = [it for it in self.geometries if float(it.get("s")) <= s + 1e-9]
        piece = (before or self.geometries[:1])[-1]
        u, shape = s - float(piece.get("s")), piece[0]
        x, y, turned = self._local(shape, u, float(piece.get("length")))
        x, y = x - t * math.sin(turned), y + t * math.cos(turned)
        hdg = float(piece.get("hdg"))
        c, d = math.cos(hdg), math.sin(hdg)
        return (
            float(piece.get("x")) + c * x - d * y,
            float(piece.get("y")) + d * x + c * y,
            hdg + turned,
        )

    def _local(self, shape, u, length):
        number = {key: float(value) for key, value in shape.attrib.items() if key != "pRange"}
        if shape.tag == "paramPoly3":
            scale = length if shape.get("pRange", "normalized") == "normalized" else 1.0
            p = u / scale
            (x, dx), (y, dy) = (
                (sum(number[f"{k}{axis}"] * p**n for n, k in enumerate("abcd")),
                 sum(n * number[f"{k}{axis}"] * p ** (n - 1) for n, k in enumerate("abcd") if n))
                for axis in "UV"
            )  # fmt: skip
            return x, y, math.atan2(dy, dx)
        begin = number.get("curvature", number.get("curvStart", 0.0))
        rate = (number.get("curvEnd", begin) - begin) / length
        x = y = 0.0
        count = 64 if begin or rate else 1
        for k in range(count):
            v = u * (k + 0.5) / count
            turned = begin * v + 0.5 * rate * v * v
            x, y = x + u / count * math.cos(turned), y + u / count * math.sin(turned)
        return x, y, begin * u + 0.5 * rate * u * u

    def bend(self, s):
        """Curvature, 1/m."""
        return math.remainder(self.at(s + 0.05)[2] - self.at(s - 0.05)[2], math.tau) / 0.1

    def nearest(self, x, y):
        """s and t of a place."""
        s = min((0.5 * self.length * k / 200 * 2 for k in range(201)),
                key=lambda it: math.dist(self.at(it)[:2], (x, y)))  # fmt: skip
        for _ in range(20):
            a, b, heading = self.at(s)
            s = min(
                max(s + (x - a) * math.cos(heading) + (y - b) * math.sin(heading), 0.0), self.length
            )
        a, b, heading = self.at(s)
        return s, (y - b) * math.cos(heading) - (x - a) * math.sin(heading)


class Line(Road):
    """A trajectory: straight lines between places on the map, and straight on beyond them."""

    def __init__(self, places):
        self.places = [it for k, it in enumerate(places) if not k or it != places[k - 1]]
        self.lanes = {}
        self.begins = [0.0]
        for ends in itertools.pairwise(self.places):
            self.begins.append(self.begins[-1] + math.dist(*ends))
        self.length = self.begins[-1]

    def at(self, s, t=0.0):
        k = min(max(bisect.bisect_right(self.begins, s) - 1, 0), len(self.places) - 2)
        (x, y), (x2, y2) = self.places[k : k + 2]
        heading, u = math.atan2(y2 - y, x2 - x), s - self.begins[k]
        c, d = math.cos(heading), math.sin(heading)
        return x + u * c - t * d, y + u * d + t * c, heading

    def bend(self, s):
        return 0.0


@dataclass
class Body:
    """A vehicle: its reference point in its road, and what moves it."""

    length: float
    width: float
    centre: float
    road: Road | None = None
    s: float = 0.0
    t: float = 0.0
    way: int = 1
    v: float = 0.0
    driven: float = 0.0
    turn: float | None = None
    unknown: bool = False  # between the begin of a synchronized move and its last part
    moves: dict[str, Any] = field(default_factory=dict)

    def place(self):
        """The centre of the body on the map."""
        x, y, _ = self.road.at(self.s, self.t)
        heading = self.heading()
        return x + self.centre * math.cos(heading), y + self.centre * math.sin(heading)

    def heading(self):
        """Where it points on the map."""
        turn = (0.0 if self.way > 0 else math.pi) if self.turn is None else self.turn
        return self.road.at(self.s, self.t)[2] + turn

    def touches(self, other):
        """Whether two bodies overlap: along no axis of either they are apart."""
        (x, y), (x2, y2), turned = self.place(), other.place(), other.heading() - self.heading()
        c, s = abs(math.cos(turned)), abs(math.sin(turned))
        for one, two in ((self, other), (other, self)):
            d, e = math.cos(one.heading()), math.sin(one.heading())
            along, across = (x2 - x) * d + (y2 - y) * e, (y2 - y) * d - (x2 - x) * e
            if abs(along) > 0.5 * (one.length + c * two.length + s * two.width):
                return False
            if abs(across) > 0.5 * (one.width + c * two.width + s * two.length):
                return False
        return True

    def lane(self):
        """The number of its lane."""
        return next(k for k, (c, w, _) in self.road.lanes.items() if abs(self.t - c) <= w / 2)


class Reader:
    """A scenario file that runs step by step."""

    def __init__(self, path, given=None, road=""):
        self.root = etree.parse(path, PLAIN).getroot()
        self.carla = self.root.find("FileHeader").get("description").startswith("CARLA:")
        self.time = 0.0
        self.values = {}
        self._declare(self.root, given or {})
        self.entries = {}
        for folder in self.root.iterfind("CatalogLocations/*/Directory"):
            for file in sorted((path.parent / folder.get("path")).glob("*.xosc")):
                for catalog in etree.parse(file, PLAIN).getroot().iter("Catalog"):
                    self._declare(catalog, self.values)
                    for entry in catalog.iterchildren(etree.Element):
                        self.entries[catalog.get("name"), entry.get("name")] = entry
        logic = path.parent / (
            road or self.text(self.root.find("RoadNetwork/LogicFile"), "filepath")
        )
        self.roads = {
            it.get("id"): Road(it) for it in etree.parse(logic, PLAIN).getroot().iterfind("road")
        }
        self.bodies = {it.get("name"): self._body(it) for it in self.root.iter("ScenarioObject")}
        self._start()
        self.states = {}
        self.before = {}
        self.actions = {}

    # values

    def _declare(self, element, given):
        for part in element.iter("ParameterDeclaration"):
            name = part.get("name").lstrip("$")
            self.values[name] = given.get(name, part.get("value"))

    def text(self, element, name, default=""):
        written = str(element.get(name, default)).strip()
        if written.startswith("${"):
            inner = re.sub(
                r"\$(\w+)",
                lambda it: f"({self.text({'x': self.values[it[1]]}, 'x')})",
                written[2:-1],
            )
            return str(eval(inner, {"__builtins__": {}, **vars(math)}))
        while written.startswith("$"):
            written = self.values[written[1:]]
            if written.startswith("${"):
                return self.text({"x": written}, "x")
        return written

    def number(self, element, name, default=0.0):
        return float(self.text(element, name, str(default)))

    def _body(self, element):
        reference = element.find("CatalogReference")
        held = element
        if reference is not None:
            held = self.entries[
                tuple(self.text(reference, it) for it in ("catalogName", "entryName"))
            ]
        box = next(held.iter("BoundingBox"))
        size, centre = box.find("Dimensions"), box.find("Center")
        return Body(
            *(self.number(size, it) for it in ("length", "width")), self.number(centre, "x")
        )

    # places

    def _start(self):
        waiting = [(self.bodies[self.text(private, "entityRef")], action[0])
                   for private in self.root.iterfind("Storyboard/Init/Actions/Private")
                   for action in private.iterfind("PrivateAction")]  # fmt: skip
        for entity in self.root.iterfind("Storyboard/Init/Actions/*//EntityAction"):
            if entity.find("DeleteEntityAction") is not None:
                del self.bodies[self.text(entity, "entityRef")]
            else:
                waiting.append((self.bodies[self.text(entity, "entityRef")], entity[0]))
        while waiting:
            left = [it for it in waiting if not self._started(*it)]
            assert len(left) < len(waiting)
            waiting = left

    def _started(self, body, action):
        if action.tag in ("TeleportAction", "AddEntityAction"):
            return self._put(body, action.find("Position")[0])
        follow = action.find("FollowTrajectoryAction")
        if follow is not None:
            body.road, body.s = self._line(follow), self.number(follow, "initialDistanceOffset")
        speed = action.find("SpeedAction")
        if speed is not None:
            target = speed.find("SpeedActionTarget")[0]
            if target.tag == "AbsoluteTargetSpeed":
                body.v = self.number(target, "value")
            else:
                body.v = self._relative(target, self.bodies[self.text(target, "entityRef")].v)
                if self.text(target, "continuous") == "true":
                    self._speed(body, speed)
        return True

    def _relative(self, target, base):
        value = self.number(target, "value")
        return base * value if target.get("speedTargetValueType") == "factor" else base + value

    def _held(self, holder, tag):
        """An element, or the entry that its <CatalogReference> names with the values it gives."""
        reference = next(holder.iter("CatalogReference"), None)
        if reference is None:
            return next(holder.iter(tag))
        entry = self.entries[tuple(self.text(reference, it) for it in ("catalogName", "entryName"))]
        given = {
            it.get("parameterRef"): self.text(it, "value")
            for it in reference.iter("ParameterAssignment")
        }
        self._declare(entry, given)
        return entry

    def _line(self, holder):
        values = dict(self.values)
        line = Line(self._places(holder))
        self.values = values
        return line

    def _places(self, holder):
        trajectory = self._held(holder, "Trajectory")
        places = []
        for vertex in trajectory.iter("Vertex"):
            goal = Body(0.0, 0.0, 0.0)
            self._put(goal, vertex.find("Position")[0])
            places.append(goal.place())
        for segment in trajectory.iter("ClothoidSplineSegment"):
            first = segment.find("PositionStart")
            if first is not None:
                goal = Body(0.0, 0.0, 0.0)
                self._put(goal, first[0])
                x, y, heading = goal.road.at(goal.s, goal.t)
                places.append((x, y))
            length, begin, end = (
                self.number(segment, it) for it in ("length", "curvatureStart", "curvatureEnd")
            )
            count = max(round(length / 0.05), 1)
            for k in range(count):
                curvature = begin + (end - begin) * (k + 0.5) / count
                turned = heading + 0.5 * curvature * length / count
                x += length / count * math.cos(turned)
                y += length / count * math.sin(turned)
                heading += curvature * length / count
                places.append((x, y))
        return places

    def _put(self, body, position):
        if position.tag == "TrajectoryPosition":
            body.road, body.s = self._line(position), self.number(position, "s")
            return True
        if position.tag == "RoutePosition":
            route = self._held(position.find("RouteRef"), "Route")
            self._put(body, next(route.iter("LanePosition")))
            at = position.find("InRoutePosition")[0]
            body.s += self.number(at, "pathS")
            if at.tag == "FromLaneCoordinates":
                lane = body.road.lanes[int(self.text(at, "laneId"))]
                body.t = lane[0] + self.number(at, "laneOffset")
            else:
                body.t = self.number(at, "t")
            return self._turn(body, position)
        other = self.bodies.get(self.text(position, "entityRef"))
        if other is not None and other.road is None:
            return False
        body.way = 1 if other is None else other.way
        if position.tag in ("LanePosition", "RoadPosition"):
            body.road = self.roads[self.text(position, "roadId")]
            body.s = self.number(position, "s")
            body.t = self.number(position, "t")
            if position.tag == "LanePosition":
                lane = int(self.text(position, "laneId"))
                body.t = body.road.lanes[lane][0] + self.number(position, "offset")
        elif position.tag == "RelativeLanePosition":
            body.road, body.s = other.road, other.s + self.number(position, "ds")
            lane = self._beside(other.lane(), int(self.number(position, "dLane")))
            body.t = body.road.lanes[lane][0] + self.number(position, "offset")
        elif position.tag == "RelativeRoadPosition":
            body.road, body.s = other.road, other.s + self.number(position, "ds")
            body.t = other.t + self.number(position, "dt")
        else:
            if position.tag == "RelativeObjectPosition":
                x, y, _ = other.road.at(other.s, other.t)
                along = other.heading()
                dx, dy = self.number(position, "dx"), self.number(position, "dy")
                x += dx * math.cos(along) - dy * math.sin(along)
                y += dx * math.sin(along) + dy * math.cos(along)
            else:
                assert position.tag == "WorldPosition"
                x, y, along = (self.number(position, it) for it in "xyh")
                if self.carla:
                    y, along = -y, -along  # as scenario_runner reads it
            beside = []
            for road in self.roads.values():
                s, t = road.nearest(x, y)
                if 1e-6 < s < road.length - 1e-6:
                    lanes = [
                        abs(t - c) - w / 2
                        for c, w, kind in road.lanes.values()
                        if kind == "driving"
                    ]
                    beside.append((max(min(lanes, default=math.inf), 0.0), len(beside), road, s, t))
            _, _, body.road, body.s, body.t = min(beside)
            body.turn = along - body.road.at(body.s)[2]
            body.way = 1 if math.cos(body.turn) > 0.0 else -1
            if position.tag == "RelativeObjectPosition" or abs(math.sin(body.turn)) < 0.01:
                body.turn = None  # it drives along the road
            return True
        return self._turn(body, position)

    def _turn(self, body, position):
        """Point a body as its <Orientation> says; one that drives keeps to its road."""
        turn = position.find("Orientation")
        if turn is None:
            return True
        heading = self.number(turn, "h")
        if turn.get("type") != "relative":
            heading -= body.road.at(body.s)[2]
        body.way = 1 if math.cos(heading) > 0.0 else -1
        if abs(math.sin(heading)) > 0.01:
            body.turn = heading
        return True

    @staticmethod
    def _beside(lane, count):
        for _ in range(abs(count)):
            lane += 1 if count > 0 else -1
            lane += 0 if lane else (1 if count > 0 else -1)
        return lane

    # moves

    def _speed(self, body, action):
        target, dynamics = action.find("SpeedActionTarget")[0], action.find("SpeedActionDynamics")
        other = self.bodies.get(self.text(target, "entityRef"))
        if other is not None and self.text(target, "continuous") == "true":
            body.moves["speed"] = lambda: self._relative(target, other.v)
            body.v = self._relative(target, other.v)
            return lambda: False
        goal = self.number(target, "value") if other is None else self._relative(target, other.v)
        shape, kind = dynamics.get("dynamicsShape"), dynamics.get("dynamicsDimension")
        first, begun, value = body.v, self.time, self.number(dynamics, "value")
        lasts = value
        if shape == "step" or goal == first:
            lasts = 0.0
        elif kind == "rate":
            lasts = abs(goal - first) / abs(value) * PEAKS[shape]
        elif kind == "distance":
            lasts = 2.0 * value / (goal + first)

        def now():
            u = min((self.time - begun) / lasts, 1.0) if lasts else 1.0
            return first + (goal - first) * SHAPES[shape](u)

        body.moves["speed"] = now
        body.v = now()
        return lambda: self.time >= begun + lasts - 1e-9

    def _across(self, body, action):
        target = next(it for it in action if it.tag.endswith("Target"))[0]
        dynamics = next(it for it in action if it.tag.endswith("Dynamics"))
        other = self.bodies.get(self.text(target, "entityRef"), body)
        offset = self.number(action, "targetLaneOffset")
        if target.tag == "AbsoluteTargetLane":
            goal = body.road.lanes[int(self.number(target, "value"))][0] + offset
        elif target.tag == "RelativeTargetLane":
            lane = self._beside(other.lane(), int(self.number(target, "value")))
            goal = body.road.lanes[lane][0] + offset
        elif target.tag == "AbsoluteTargetLaneOffset":
            goal = body.road.lanes[body.lane()][0] + self.number(target, "value")
        else:
            goal = other.t + self.number(target, "value")
        shape, kind = dynamics.get("dynamicsShape"), dynamics.get("dynamicsDimension", "acc")
        first, begun, driven = body.t, self.time, body.driven
        value, way = self.number(dynamics, "value"), abs(goal - first)
        if kind == "acc":
            strongest = {"cubic": 6.0, "sinusoidal": 0.5 * math.pi**2}[shape]
            value = math.sqrt(strongest * way / self.number(dynamics, "maxLateralAcc"))
        elif kind == "rate":
            value = way / value * PEAKS[shape]

        def share():
            done = body.driven - driven if kind == "distance" else self.time - begun
            return min(done / value, 1.0) if value else 1.0

        body.moves["across"] = lambda: first + (goal - first) * SHAPES[shape](share())
        return lambda: share() >= 1.0 - 1e-9 and action.get("continuous") != "true"

    def _do(self, body, private):
        if private[0].tag == "SynchronizeAction":
            return self._synchronize(body, private[0])
        inner = private[0][0] if len(private[0]) else private[0]
        if inner.tag == "SpeedAction":
            return self._speed(body, inner)
        if inner.tag in ("LaneChangeAction", "LaneOffsetAction"):
            return self._across(body, inner)
        if inner.tag == "LongitudinalDistanceAction":
            other = self.bodies[self.text(inner, "entityRef")]
            if inner.find("DynamicConstraints") is not None:  # only its end is said
                body.unknown = True
                return lambda: False
            assert (inner.get("freespace"), inner.get("continuous")) == ("true", "false")
            apart = self.number(inner, "distance") + 0.5 * (body.length + other.length)
            body.s = other.s + other.centre + apart - body.centre
            return lambda: True
        if inner.tag == "FollowTrajectoryAction":
            assert all(it.get("time") is None for it in inner.iter("Vertex"))
            body.road, body.s, body.t, body.way = self._line(inner), 0.0, 0.0, 1
            return lambda: False
        assert private[0].tag in (
            "AppearanceAction",
            "ControllerAction",
            "ActivateControllerAction",
            "VisibilityAction",
        )
        return lambda: True

    def _synchronize(self, body, action):
        """Only the last part is said by the standard: at the place in time, at the final speed."""
        master = self.bodies[action.get("masterEntityRef")]
        goals = []
        for name, mover in (("TargetPositionMaster", master), ("TargetPosition", body)):
            goal = Body(0.0, 0.0, 0.0)
            self._put(goal, action.find(name)[0])
            x, y = goal.place()
            a, b, heading = mover.road.at(mover.s, mover.t)
            ahead = (x - a) * math.cos(heading) + (y - b) * math.sin(heading)
            if isinstance(mover.road, Line) and isinstance(goal.road, Line):
                ahead = goal.s - mover.s
            goals.append(ahead)
        final = action.find("FinalSpeed/AbsoluteSpeed")
        speed = self.number(final, "value")
        steady = sum(self.number(it, "distance") for it in final)
        arrives, target = self.time + goals[0] / master.v, body.s + body.way * goals[1]
        body.unknown = True

        def now():
            rest = speed * (arrives - self.time)
            body.unknown = body.unknown and rest > steady + 1e-9
            if not body.unknown and "sync" not in body.moves:
                body.moves["sync"], body.s = True, target - body.way * rest
            return 0.0 if body.unknown else speed

        body.moves["speed"] = now
        return lambda: self.time >= arrives

    # conditions

    def _holds(self, trigger):
        groups = [] if trigger is None else trigger.findall("ConditionGroup")
        return not groups or any([all([self._true(it) for it in group]) for group in groups])  # noqa: C419 - each is looked at

    def _true(self, condition):
        kind = condition[0]
        if kind.tag == "ByValueCondition":
            value = self._by_value(kind[0])
        else:
            triggering = kind.find("TriggeringEntities")
            found = [self._of(kind.find("EntityCondition")[0], self.bodies[self.text(it, "entityRef")])
                     for it in triggering.iterfind("EntityRef")]  # fmt: skip
            value = (all if triggering.get("triggeringEntitiesRule") == "all" else any)(found)
        seen = self.before.setdefault(condition, [])
        seen.append(value)
        late = round(self.number(condition, "delay") / STEP)
        if len(seen) <= late:
            return False
        first = False if kind.tag == "ByValueCondition" else None  # nothing held before the start
        now, was = seen[-1 - late], seen[-2 - late] if len(seen) > late + 1 else first
        if self.carla:  # scenario_runner keeps a condition that was true
            return any(seen)
        edges = {"none": now, "rising": now and was is False, "falling": not now and was is True,
                 "risingOrFalling": was is not None and now != was}  # fmt: skip
        return edges[condition.get("conditionEdge")]

    def _by_value(self, element):
        if element.tag == "SimulationTimeCondition":
            # a step is short: `greaterThan` begins at the time itself
            rule = element.get("rule").replace("greaterThan", "greaterOrEqual")
            return RULES[rule](self.time, self.number(element, "value"))
        if element.tag == "ParameterCondition":
            known = self.values[element.get("parameterRef").lstrip("$")]
            sides = (self.text({"x": known}, "x"), self.text(element, "value"))
            return (sides[0] == sides[1]) == (element.get("rule") == "equalTo")
        assert element.tag == "StoryboardElementStateCondition", element.tag
        name, kind = element.get("storyboardElementRef"), element.get("storyboardElementType")
        states = [state for it, state in self.states.items()
                  if it.get("name") == name and it.tag.lower() == kind.lower()]  # fmt: skip
        ended = element.get("state") in ("completeState", "endTransition")
        return any(state == "complete" or (not ended and state == "running") for state in states)

    def _of(self, element, body):
        rule = RULES[element.get("rule", "greaterOrEqual")]
        value, free = self.number(element, "value"), element.get("freespace") == "true"
        reference = self.text(element, "entityRef")
        for part in element.iter("RelativeObjectPosition", "EntityRef"):
            reference = self.text(part, "entityRef")
        other = self.bodies.get(reference)
        if element.tag == "TraveledDistanceCondition":
            return body.driven >= value
        if element.tag == "SpeedCondition":
            return rule(body.v, value)
        if element.tag == "ReachPositionCondition":
            goal = Body(0.0, 0.0, 0.0)
            self._put(goal, element.find("Position")[0])
            assert body.road is goal.road
            reached = math.hypot(goal.s - body.s, goal.t - body.t)
            return reached <= self.number(element, "tolerance")
        assert other is not None, element.tag
        if element.tag == "RelativeSpeedCondition":
            return rule(body.v - other.v, value)
        along = self._ahead(element, body, other)
        gap = abs(along + free * (other.centre - body.centre)) - free * 0.5 * (
            body.length + other.length
        )
        if element.tag == "TimeHeadwayCondition":
            follows = along > 0.0 or not free
            return rule(gap / body.v if follows and body.v > 0.0 else math.inf, value)
        if element.tag == "TimeToCollisionCondition":
            closing = math.copysign(1.0, along) * (body.way * body.v - other.way * other.v)
            return rule(gap / closing if closing > 0.0 else math.inf, value)
        assert element.tag in ("RelativeDistanceCondition", "DistanceCondition"), element.tag
        if element.get("relativeDistanceType") == "longitudinal":
            return rule(gap, value)
        assert not free
        x, y, _ = body.road.at(body.s, body.t)
        return rule(math.dist((x, y), other.road.at(other.s, other.t)[:2]), value)

    def _ahead(self, element, body, other):
        """How far another reference point is ahead: along the body's own axis, the middle of its
        lane, or the reference line."""
        along_road = self.text(element, "alongRoute") == "true"
        system = element.get("coordinateSystem", "lane" if along_road else "entity")
        if system != "entity":
            t = body.road.lanes[body.lane()][0] if system == "lane" else 0.0
            mean = 0.5 * (body.s + other.s)
            return body.way * (other.s - body.s) * (1.0 - body.road.bend(mean) * t)
        x, y, heading = body.road.at(body.s, body.t)
        x2, y2, _ = other.road.at(other.s, other.t)
        return body.way * ((x2 - x) * math.cos(heading) + (y2 - y) * math.sin(heading))

    # the storyboard

    def step(self):
        """The next 0.01 s."""
        for body in self.bodies.values():
            was = body.v
            if "speed" in body.moves:
                body.v = body.moves["speed"]()
            if "across" in body.moves:
                body.t = body.moves["across"]()
            ahead = 0.5 * (was + body.v) * STEP if self.time else 0.0
            body.driven += ahead
            body.s += body.way * ahead / (1.0 - body.road.bend(body.s) * body.t)
        for act in self.root.iterfind("Storyboard/Story/Act"):
            if self.states.get(act) is None and self._holds(act.find("StartTrigger")):
                self.states[act] = "running"
            if self.states.get(act) == "running":
                self._act(act)
        self.time += STEP

    def _maneuvers(self, group):
        yield from group.iterfind("Maneuver")
        for reference in group.iterfind("CatalogReference"):
            for it in reference.iter("ParameterAssignment"):
                self.values[it.get("parameterRef")] = self.text(it, "value")
            yield self.entries[
                tuple(self.text(reference, it) for it in ("catalogName", "entryName"))
            ]

    def _act(self, act):
        done = []
        for group in act.iterfind("ManeuverGroup"):
            names = [self.text(it, "entityRef") for it in group.iterfind("Actors/EntityRef")]
            for maneuver in self._maneuvers(group):
                ends = []
                for event in maneuver.iterfind("Event"):
                    self._event(event, names)
                    ends.append(self.states.get(event) == "complete")
                if all(ends):
                    self.states[maneuver] = "complete"
                done += ends
        if all(done):
            self.states[act] = "complete"

    def _event(self, event, names):
        actions = event.findall("Action")
        if all(it.find("GlobalAction") is not None for it in actions):
            deleted = list(event.iter("EntityAction"))
            if deleted and self._holds(event.find("StartTrigger")):
                for entity in deleted:
                    self.bodies.pop(self.text(entity, "entityRef"), None)
            return
        if self.states.get(event) is None and self._holds(event.find("StartTrigger")):
            self.states[event] = "running"
            for action in actions:
                self.states[action] = "running"
                ends = [self._do(self.bodies[name], action[0]) for name in names if name in self.bodies
                        if action[0].tag == "PrivateAction"]  # fmt: skip
                self.actions[action] = lambda ends=ends: all(it() for it in ends)
        for action in actions:
            if self.states.get(action) == "running" and self.actions[action]():
                self.states[action] = "complete"
        if self.states.get(event) == "running" and all(
            self.states[it] == "complete" for it in actions
        ):
            self.states[event] = "complete"
