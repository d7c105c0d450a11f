"""A scenario file of OpenSCENARIO at one point of its space: the road, the ego's start and what the
others do.

Readings, where the standard leaves one or the world here is narrower:

- The ego belongs to the ADS from the start: its controllers and actions during the drive are
  ignored, its start is not.
- A speed relative to the ego's is relative to the one with which the ego starts, a lane or an
  offset relative to the ego's to where the ego starts: nobody knows before the drive where an ADS
  will be.
- SynchronizeAction is planned once, when it begins, for a master that keeps the speed it has; when
  the master leaves its approach speed afterwards, because the ADS brakes, the target keeps its plan
  (`synchronized`).
- `sinusoidal` by `rate` has that peak lateral speed, by `maxLateralAcc` that peak lateral
  acceleration.
- A `rate` is a size; the target says which way.
- Who has come to the end of a trajectory goes on straight at its speed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.catalogs import Catalogs, named_file
from sumo_eval.extras.openscenario.moments import (
    NEVER,
    Conditions,
    Moment,
    Program,
    Span,
    operation,
)
from sumo_eval.extras.openscenario.network import (
    MARKED,
    WIDEST,
    Lane,
    MapRoad,
    in_frame,
    read_network,
)
from sumo_eval.extras.openscenario.places import (
    Entity,
    Places,
    Spot,
    Trajectory,
    UnplacedError,
    entity_of,
)
from sumo_eval.extras.openscenario.reading import Part, read_openscenario
from sumo_eval.extras.openscenario.values import Value
from sumo_eval.scenario import played
from sumo_eval.scenario.concrete import Actor, EgoBody, Start, keeps_on
from sumo_eval.scenario.road.opendrive import beside
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import (
    Piece,
    bends,
    curvatures,
    frame_places,
    length_of,
    tightest,
)

EGO = "Ego"
_AT_ONCE = 1e-6  # s that a speed takes which is told to change at once
_SAME = 1e-9
_PEAKS = {"linear": 1.0, "sinusoidal": 0.5 * math.pi, "cubic": 1.5}
"""Peak over mean lateral speed by the shape of a move across."""
_SHARES = tuple(k / 32 for k in range(1, 33))  # of a change of speed, between its knots
_ON = 1e-6  # m

_STEADY = "over the distance of a move across the speed must stay the same, above 0 m/s"
IGNORED_GLOBAL = (
    "EnvironmentAction",
    "VariableAction",
    "ParameterAction",
    "InfrastructureAction",
    "CustomCommandAction",
)
"""Actions for all that change no motion here."""
IGNORED_PRIVATE = ("ControllerAction", "ActivateControllerAction", "VisibilityAction",
    "AppearanceAction")  # fmt: skip
"""Actions of one entity that change no motion here."""


class Choice(NamedTuple):
    """What the user names behind a file's name.

    ego: the entity that the ADS drives; empty: as the file has it.
    map: the OpenDRIVE file instead of the one that the file names; empty: the file's.
    """

    ego: str = ""
    map: str = ""


NO_CHOICE = Choice()


class Frame(NamedTuple):
    """The road: where its frame begins on the map, its line (none: straight), its lanes and its
    length, m.

    offset: of lane 0's centre left of the reference line of the road `road`, m.
    way: 1 where the ego drives along that line, -1 against it.
    """

    origin: Pose
    line: tuple[Piece, ...]
    lanes: int
    lane_width: float
    length: float
    name: str
    offset: float
    road: str
    way: int = 1


@dataclass(slots=True)
class Doing:
    """What one of the others does, as it is put together.

    speed: the one it has by what stands above, from `steady` s on;
    offset: to the left of where it starts, by what stands above, m.
    speed_changes, across: when its last change of speed begins, and its last move across that ends
        by distance.
    """

    acts: list[played.Act] = field(default_factory=list)
    speed: float = 0.0
    steady: float = 0.0
    offset: float = 0.0
    busy_until: float = 0.0
    speed_changes: Moment | None = None
    across: Moment | None = None


@dataclass(frozen=True, slots=True)
class Scene:
    """The scenario at a point. broken: constraints of the file that do not hold there.

    ends: s, inf where no stop says.

    ignored: kinds of elements that mean nothing here.
    ego_name: of the entity that the ADS drives.
    """

    frame: Frame
    ego: Start
    ego_body: EgoBody
    actors: tuple[Actor, ...]
    ends: float
    ignored: tuple[str, ...]
    ego_name: str


def scene(
    path: Path,
    given: Mapping[str, Value],
    choice: Choice,
    *,
    constrained: bool = True,
) -> Scene:
    """A scenario file with given values of its parameters.

    constrained: the constraints of the file must hold.

    Raises InputError with file, line and element.
    """
    return _Player(path, given, choice, constrained=constrained).scene()


def synchronized(
    distance: float, time: float, speed: float, final: float, steady: float
) -> tuple[tuple[float, float], ...]:
    """Knots (s, m/s) of the speed with which a target is at its place, `distance` m ahead, after
    `time` s.

    It begins with `speed` and has `final` over the last `steady` m. Before that it changes its
    speed once, as gently as it can: it keeps the first speed and then changes, or changes and then
    keeps the final one. Where neither gets it there, it changes at an even rate to a speed in the
    middle of the time left, and on to the final one; and where that speed would be below 0 it
    brakes, stands and starts.

    Raises InputError where no motion forward does it.
    """
    if final <= 0.0:
        raise InputError(f"a final speed above 0 m/s is needed, got {final:g}")
    ahead, left = distance - steady, time - steady / final
    if ahead < -_ON or left < -_SAME:
        raise InputError(
            f"{distance:.2f} m in {time:.2f} s leave no room for {steady:g} m at {final:g} m/s"
        )
    if left <= _AT_ONCE or ahead <= _ON:
        return (
            ((max(left, _AT_ONCE), speed), (max(left, _AT_ONCE) + _AT_ONCE, final))
            if left > 0
            else ((_AT_ONCE, final),)
        )
    mean = ahead / left
    low, high = min(speed, final), max(speed, final)
    if high - low > _SAME and low + _SAME < mean < high - _SAME:
        # nearer to the speed it has: that first
        if (mean < 0.5 * (speed + final)) == (final > speed):
            ramp = 2.0 * (ahead - speed * left) / (final - speed)
            return _knots([(left - ramp, speed), (left, final)])
        ramp = 2.0 * (final * left - ahead) / (final - speed)
        return _knots([(ramp, final), (left, final)])
    if abs(mean - final) <= _SAME and abs(mean - speed) <= _SAME:
        return ((left, final),)
    middle = 2.0 * mean - 0.5 * (speed + final)
    if middle >= 0.0:
        return _knots([(0.5 * left, middle), (left, final)])
    # brakes and starts at one rate, and stands in between
    rate = (speed * speed + final * final) / (2.0 * ahead)
    if (speed + final) / rate > left + _SAME:
        raise InputError(
            f"{distance:.2f} m in {time:.2f} s are too few for {speed:g} m/s at the start"
        )
    return _knots([(speed / rate, 0.0), (left - final / rate, 0.0), (left, final)])


_beside = lru_cache(maxsize=64)(beside)


def _knots(knots: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Those knots that lie behind the one before them."""
    found: list[tuple[float, float]] = []
    for time, speed in knots:
        if time > (found[-1][0] if found else 0.0) + _AT_ONCE:
            found.append((time, speed))
        elif found:
            found[-1] = (found[-1][0], speed)
    return tuple(found)


def changes_nothing(act: played.Act) -> bool:
    """Whether a move only keeps a speed, or remembers that a condition held (`_Player._latch`)."""
    return act.kind == played.KEEP or (act.kind == played.COSINE and act.offset == 0.0)


def _along_line(act: played.Act, ground: float) -> played.Act:
    """A move with its speeds along the road's line.

    ground: m over the ground for a metre along that line.
    """
    if act.kind == played.SPEED:
        return act._replace(speed=act.speed / ground, acceleration=act.acceleration / ground)
    if act.kind == played.BY_TIME:
        return act._replace(table=tuple((time, speed / ground) for time, speed in act.table))
    return act


def _at_once(dynamics: Part) -> bool:
    """Whether a change is a step, or takes 0 s."""
    if dynamics.one_of("dynamicsShape", ("step", "linear", "cubic", "sinusoidal")) == "step":
        return True
    return dynamics.get("dynamicsDimension") == "time" and dynamics.number("value") == 0.0


def _from(time: float) -> Program:
    """The program of a condition that holds from a time on, s."""
    return (played.VALUE, 0, 0, time), operation(played.TIME), operation(played.AT_MOST)


def _leads(element: Part, now: bool) -> bool:
    """Whether a LongitudinalDistanceAction puts its entity ahead; `any`: where it is now."""
    known = ("any", "leadingReferencedEntity", "trailingReferencedEntity")
    where = element.one_of("displacement", known, "any")
    return now if where == "any" else where == known[1]


def _eased(shape: str, share: float) -> float:
    """The share of a change that is done after a share of its duration."""
    if shape == "cubic":
        return share * share * (3.0 - 2.0 * share)
    return 0.5 * (1.0 - math.cos(math.pi * share))


def _kinds(event: Part) -> set[str]:
    """Whether an event tells somebody to move along the road, across it, or on a way of its own."""
    return {action.only().tag for action in event.all("Action/PrivateAction")} - set(
        IGNORED_PRIVATE
    )


def _deletes(action: Part) -> bool:
    return action.tag == "EntityAction" and action.find("DeleteEntityAction") is not None


def _raise_circle(faults: list[tuple[UnplacedError, Part, Entity]]) -> None:
    """Raise why no action of Init can be done: a place that is missing, or a circle."""
    names = [entity.name for _, _, entity in faults]
    for unplaced, _, _ in faults:
        if unplaced.entity not in names:
            raise unplaced
    raise faults[0][1].fault(
        f"the starts of {', '.join(dict.fromkeys(names))} depend on each other in a circle"
    )


class _Player:
    """Walks through a file once."""

    def __init__(
        self, path: Path, given: Mapping[str, Value], choice: Choice, *, constrained: bool
    ) -> None:
        self.root = read_openscenario(path)
        if self.root.find("Storyboard") is None:
            raise self.root.fault("it must hold a <Storyboard>")
        self.root, broken = self.root.declared(given)
        if broken and constrained:
            raise self.root.child("ParameterDeclarations").fault(
                f"a constraint does not hold: {broken[0]}"
            )
        self.catalogs = Catalogs(self.root.find("CatalogLocations"))
        self.network = read_network(self._map(choice.map))
        entities = [entity_of(part, self.catalogs)
                    for part in self.root.child("Entities").all("ScenarioObject")]  # fmt: skip
        self.entities = {entity.name: entity for entity in entities}
        for earlier, entity in enumerate(entities):
            if any(entity.name == it.name for it in entities[:earlier]):
                raise entity.element.fault(f"there is another entity with the name `{entity.name}`")
        self.ego = choice.ego or self._only_controlled()
        if self.ego not in self.entities:
            raise self.root.child("Entities").fault(
                "the entity that the ADS drives must be named `Ego`, or be the only one with a "
                "controller; `?ego=NAME` behind the file's name names it, one of "
                f"{', '.join(self.entities) or 'none'}"
            )
        # scenario_runner reads these files with CARLA's axes, in which y points to the right
        about = str(self.root.child("FileHeader").get("description"))
        self.places = Places(self.network, self.catalogs, self.entities, about.startswith("CARLA:"))
        self.ignored: dict[str, None] = {}
        self.doing = {name: Doing() for name in self.entities if name != self.ego}
        self.distances: list[tuple[Part, Entity]] = []
        self.begun: list[tuple[Part, Entity]] = []
        self.ends = math.inf
        self.end_of_way: Pose | None = None
        self.turning: Trajectory | None = None

    def _map(self, other: str) -> Path:
        """The OpenDRIVE file: the one that the user names, or the scenario file."""
        if other:
            path = self.root.file.parent / other
            if not path.is_file():
                raise self.root.fault(f"the map {path} is not there")
            return path
        named = self.root.child("RoadNetwork").child("LogicFile")
        if not Path(named.text("filepath")).suffix:
            raise named.fault(
                f"`{named.text('filepath')}` is the name of a simulator's map: `?map=FILE.xodr` "
                "behind the file's name names its OpenDRIVE file"
            )
        return named_file(named)

    def _only_controlled(self) -> str:
        """The entity named `Ego`; else the only one with a controller; else none."""
        init = "Storyboard/Init/Actions/Private"
        assigned = {
            part.text("entityRef")
            for part in self.root.all(init)
            if part.find("PrivateAction/ControllerAction") is not None
        }
        controlled = {
            name
            for name, entity in self.entities.items()
            if name in assigned or entity.element.find("ObjectController/*") is not None
        }
        return EGO if EGO in self.entities or len(controlled) != 1 else controlled.pop()

    def scene(self) -> Scene:
        """All of it."""
        story = self.root.child("Storyboard")
        self._init(story.child("Init").child("Actions"))
        for name in [name for name, entity in self.entities.items() if entity.spot is None]:
            if self.entities[name].deleted and name != self.ego:
                del self.entities[name], self.doing[name]
        roads = [entity.placed(entity.element).road for entity in self.entities.values()]
        if any(road is not None and road.sloped for road in roads):
            self.ignored["elevation"] = None
        self.frame = self._frame()
        for entity in self.entities.values():
            entity.on_map = self.turning is not None and entity.name != self.ego
            entity.frame = self._framed(entity)
        for distance, entity in self.distances:
            self._keep_distance(distance, entity)
            if distance.flag("continuous"):
                self.begun.append((distance, entity))
        self.number_of: dict[str, int] = {}
        self._delete_at_once(story)
        numbers = [
            name for name in self.entities if name != self.ego and not self.entities[name].deleted
        ]
        self.number_of = {name: number for number, name in enumerate(numbers)}
        self.names: dict[str, str] = {}
        for name in numbers:  # as SUMO can have them: `ego` is the ADS's
            plain = re.sub(r"[^\w.-]", "_", name)
            while plain in ("ego", *self.names.values()):
                plain += "_"
            self.names[name] = plain
        self.conditions = self._conditions(self._latch)
        for name in self.doing:
            self.doing[name].speed = self.entities[name].speed
        self._stop(story.find("StopTrigger"))
        for element, entity in self.begun:
            move = self._speed if element.tag == "SpeedAction" else self._distance
            move(element, entity, self.doing[entity.name], Moment(0.0))
        for act in self._acts(story):
            self._act(act)
        ego = self.entities[self.ego]
        if self.turning is not None and ego.offset != 0.0:
            raise ego.element.fault("the body of an ego that turns must lie over its axle's middle")
        start = Start(ego.frame.x, ego.frame.y, ego.speed)
        actors = tuple(self._actor(self.entities[name]) for name in numbers)
        return Scene(
            self.frame,
            start,
            EgoBody(ego.length, ego.width),
            actors,
            self.ends,
            tuple(self.ignored),
            self.ego,
        )

    def _ignore(self, element: Part) -> None:
        self.ignored[element.tag] = None

    # -- before the start --------------------------------------------------------------------------

    def _init(self, actions: Part) -> None:
        waiting: list[tuple[Part, Entity]] = []
        for part in actions.children():
            added = part.find("EntityAction/AddEntityAction")
            if added is not None:
                waiting.append((added, self._referred(part.child("EntityAction"))))
            elif part.tag == "GlobalAction":
                self._global(part.only())
            elif part.tag == "UserDefinedAction":
                self._ignore(part)
            elif part.tag == "Private":
                entity = self._referred(part)
                waiting += [(action.only(), entity) for action in part.all("PrivateAction")]
            else:
                raise part.not_played()
        self._resolve(waiting)

    def _referred(self, part: Part) -> Entity:
        """The entity that an element refers to."""
        return self.places.entity(part.text("entityRef"), part)

    def _resolve(self, waiting: list[tuple[Part, Entity]]) -> None:
        """Do the actions of Init, each after those that it depends on."""
        while waiting:
            waiting = self._resolve_once(waiting)

    def _resolve_once(self, waiting: list[tuple[Part, Entity]]) -> list[tuple[Part, Entity]]:
        """Do what depends on no later action of Init; what remains.

        Actions of different entities have no order between them.
        """
        faults: list[tuple[UnplacedError, Part, Entity]] = []
        for number, (element, entity) in enumerate(waiting):
            self.waiting = [(it[1], it[2]) for it in faults] + waiting[number + 1 :]
            try:
                self._private_at_start(element, entity)
            except UnplacedError as fault:
                faults.append((fault, element, entity))
        if len(faults) == len(waiting):
            _raise_circle(faults)
        return [(element, entity) for _, element, entity in faults]

    def _global(self, element: Part) -> None:
        if element.tag in IGNORED_GLOBAL:
            self._ignore(element)
        elif _deletes(element):
            self.places.entity(element.text("entityRef"), element).deleted = True
        else:
            raise element.not_played()

    def _private_at_start(self, element: Part, entity: Entity) -> None:
        if element.tag in ("TeleportAction", "AddEntityAction"):
            entity.spot = self.places.located(self.places.spot(element.child("Position")))
        elif element.tag == "LongitudinalAction":
            inner = element.only()
            if inner.tag == "SpeedAction":
                self._speed_at_start(inner, entity)
            elif inner.tag == "LongitudinalDistanceAction":
                self.distances.append((inner, entity))
            else:
                raise inner.not_played()
        elif element.tag == "RoutingAction":
            self._route_at_start(element.only(), entity)
        elif element.tag in IGNORED_PRIVATE:
            self._ignore(element)
        else:
            raise element.not_played()

    def _speed_at_start(self, element: Part, entity: Entity) -> None:
        """A first speed; one that is reached in time, or kept relative, is a move from 0 s on."""
        speed = self._target_speed(element)
        kept = element.child("SpeedActionTarget").only().flag("continuous")
        at_once = _at_once(element.child("SpeedActionDynamics"))
        if at_once:
            entity.speed = speed
        if at_once and not kept:
            return
        if entity.name == self.ego:
            raise element.fault("the ego is driven by the ADS: its first speed must be a step")
        self.begun.append((element, entity))

    def _route_at_start(self, element: Part, entity: Entity) -> None:
        if element.tag == "AssignRouteAction":
            _, end = self.places.route(element)
            if entity.name == self.ego:
                self.end_of_way = end.pose
        elif element.tag == "FollowTrajectoryAction":
            trajectory = self._trajectory(element)
            if trajectory.times:
                raise element.fault("a trajectory with times is not played before the start")
            begin = element.number("initialDistanceOffset", 0.0)
            first = trajectory.begin
            pose = trajectory.at(begin, element)
            entity.spot = Spot(pose, first.road, first.lane, first.s + begin, first.t)
            if entity.name == self.ego:
                entity.spot = self.places.located(entity.spot)
            entity.way = ((pose.x, pose.y), *trajectory.rest(begin))
            if entity.name == self.ego:
                if trajectory.bends and begin != 0.0:
                    raise element.fault(
                        "`initialDistanceOffset` of a trajectory on which the ego turns must be 0"
                    )
                self.turning = trajectory if trajectory.bends else None
                self.end_of_way = Pose(*trajectory.points[-1], pose.heading)
        else:
            raise element.not_played()

    def _trajectory(self, element: Part) -> Trajectory:
        mode = element.find("TrajectoryFollowingMode")
        if mode is not None:
            mode.one_of("followingMode", ("position", "follow"))
        reference = element.find("TrajectoryRef")
        return self.places.trajectory(element if reference is None else reference)

    def _target_speed(self, action: Part) -> float:
        target = action.child("SpeedActionTarget").only()
        value = target.number("value")
        if target.tag == "AbsoluteTargetSpeed":
            speed = value
        elif target.tag == "RelativeTargetSpeed":
            other = self.places.entity(target.text("entityRef"), target)
            if any(entity is other and it.find("SpeedAction") for it, entity in self.waiting):
                raise UnplacedError("", other.name)
            base = (
                other.speed
                if other.name == self.ego or other.name not in self.doing
                else self.doing[other.name].speed
            )
            kind = target.one_of("speedTargetValueType", ("delta", "factor"))
            speed = base + value if kind == "delta" else base * value
        else:
            raise target.not_played()
        if speed < 0.0:
            raise target.fault(f"the speed must be at least 0 m/s, got {speed:g}")
        return speed

    # -- the road ----------------------------------------------------------------------------------

    def _frame(self) -> Frame:
        ego = self.entities[self.ego]
        spot = ego.placed(ego.element)
        road, lane = spot.road, spot.lane
        if road is None or lane is None:
            raise ego.element.fault("the ego must be placed in a driving lane")
        if spot.way == 0:
            raise ego.element.fault("the ego must start along its lane")
        if self.turning is not None:
            return self._turning_frame(road, lane, spot)
        width, centre, lanes = lane.width, lane.centre, 2
        if lane.width > WIDEST:
            width = MARKED
        else:
            driving = [
                it
                for it in sorted(road.lanes.values(), key=lambda it: spot.way * it.centre)
                if it.kind == "driving"
            ]
            own = next((k for k, it in enumerate(driving) if it.number == lane.number), None)
            if own is None:
                raise ego.element.fault(
                    f"the ego's lane {lane.number} must be a driving lane, it is `{lane.kind}`"
                )
            first, last = own, own
            while (
                first > 0
                and abs(abs(driving[first].centre - driving[first - 1].centre) - width) < _ON
            ):
                first -= 1
            while (
                last + 1 < len(driving)
                and abs(abs(driving[last + 1].centre - driving[last].centre) - width) < _ON
            ):
                last += 1
            centre, lanes = driving[first].centre, last - first + 1
        begin, reference = (road.begin, road.line) if spot.way > 0 else road.backward()
        origin = begin.moved(0.0, spot.way * centre)
        name = f"{self.network.path.stem}_{road.name}_{lanes}x{width:g}m_at_{centre:g}m"
        name += "_back" if spot.way < 0 else ""
        line: tuple[Piece, ...] = ()
        length = road.length
        if road.bent:
            owner = f"road `{road.name}` of {self.network.path.name}"
            line = _beside(reference, spot.way * centre, owner)
            length = length_of(line)
        elif self.end_of_way is not None:
            length = max(length, self.end_of_way.seen_from(origin).x)
        return Frame(origin, line, lanes, width, length, name, centre, road.name, spot.way)

    def _turning_frame(self, road: MapRoad, lane: Lane, spot: Spot) -> Frame:
        """The road of an ego that turns: the way on which it turns, one lane wide, from its own
        road's beginning on.

        At a junction there is no lane beside a way, and who comes across is told on the map.
        """
        assert self.turning is not None
        origin = road.pose(0.0, spot.t)
        there = spot.pose.seen_from(origin)
        if road.bent or abs(there.y) > _ON or abs(there.heading) > _SAME:
            raise self.entities[self.ego].element.fault(
                "an ego that turns must begin along a straight road"
            )
        line = self.turning.pieces
        if there.x > _ON:
            first, *rest = line
            line = (
                (Piece(there.x), *line)
                if bends([first])
                else (Piece(there.x + first.length), *rest)
            )
        name = f"{self.network.path.stem}_{road.name}_turn_{tightest(line):g}m"
        width = MARKED if lane.width > WIDEST else lane.width
        return Frame(origin, line, 1, width, length_of(line), name, spot.t, road.name)

    def _on_map(self, entity: Entity) -> Pose:
        """The centre of an entity's body on the map, in the axes of the road's beginning, and where
        it leads there.
        """
        pose = entity.placed(entity.element).pose._replace(heading=self._heading(entity))
        return pose.moved(entity.centre, entity.offset).seen_from(self.frame.origin)

    def _found_in_frame(self, entity: Entity) -> Pose:
        """The place of an entity in the frame of a road that bends, found from where it is on the
        map.
        """
        return in_frame(self._on_map(entity), Pose(0.0, 0.0, 0.0), self.frame.line)

    def _framed(self, entity: Entity) -> Pose:
        """The centre of an entity's body along and across the road, and its heading there."""
        spot, frame = entity.placed(entity.element), self.frame
        if entity.on_map:
            return self._found_in_frame(entity)
        pose = spot.pose.moved(entity.centre, entity.offset)
        if not frame.line:
            at = pose.seen_from(frame.origin)
            here = spot.road is not None and spot.road.name == frame.road
            return at._replace(heading=0.0) if here and spot.way == frame.way else at
        if self.turning is not None:
            return pose.seen_from(frame.origin)._replace(y=0.0)
        if spot.road is None or spot.road.name != frame.road:
            raise entity.element.fault(
                "on a road that bends every place must be told along that road"
            )
        if spot.way:
            s, t = spot.s + spot.way * entity.centre, spot.t + spot.way * entity.offset
            pose = spot.road.pose(s, t)
        at = pose.seen_from(frame.origin)
        near = spot.s + entity.centre if frame.way > 0 else spot.road.length - spot.s
        x, y, heading = (
            float(it) for it in frame_places(frame.line, at.x, at.y, at.heading, near=near)
        )
        if spot.way:
            heading = 0.0 if spot.way == frame.way else math.pi
        return Pose(x, 0.0 if abs(y) < _ON else y, heading)

    def _keep_distance(self, element: Part, entity: Entity) -> None:
        """A LongitudinalDistanceAction that is done once at the start: the entity stands at the
        distance.
        """
        other, ahead, apart = self._apart(element, entity)
        if element.get("timeGap") is not None:
            gap = element.number("timeGap") * (other.speed if ahead else entity.speed)
            apart += (gap if ahead else -gap) / self._ground(other.frame)
        entity.frame = entity.frame._replace(x=other.frame.x + apart)

    def _apart(self, element: Part, entity: Entity) -> tuple[Entity, bool, float]:
        """The other of a LongitudinalDistanceAction, whether the entity is ahead of it, and how far
        ahead its centre must be, m along the road's line, without a time gap.
        """
        other = self._referred(element)
        if element.find("DynamicConstraints") is not None or entity.on_map or other.on_map:
            raise element.fault(
                "a distance with limited dynamics, or of an entity that drives on the map, is not "
                "supported"
            )
        ahead = _leads(element, entity.frame.x >= other.frame.x)
        sign = 1.0 if ahead else -1.0
        apart = 0.0 if element.get("timeGap") is not None else element.number("distance")
        if element.flag("freespace"):
            apart += 0.5 * (entity.length + other.length)
            return other, ahead, sign * apart / self._ground(other.frame)
        between = entity.centre - other.centre
        return other, ahead, (sign * apart + between) / self._ground(other.frame)

    # -- the story ---------------------------------------------------------------------------------

    def _acts(self, story: Part) -> Iterator[Part]:
        """Every act of the stories."""
        for part in story.all("Story"):
            yield from part.within().all("Act")

    def _conditions(self, latch: Callable[[Program], tuple[int, int]]) -> Conditions:
        return Conditions(self.places, self.number_of, self.frame.origin, self.frame.line, latch)

    def _latch(self, program: Program) -> tuple[int, int]:
        """A move of the first actor that changes nothing: its end remembers that a program held."""
        acts = next(self.doing[name] for name in self.number_of).acts
        acts.append(played.Act(played.COSINE, 0.0, _AT_ONCE, program=program))
        return 0, len(acts) - 1

    def _delete_at_once(self, story: Part) -> None:
        """Entities that are deleted at the start are not there."""
        conditions = self._conditions(lambda program: (0, 0))
        for act in self._acts(story):
            for event in act.all("ManeuverGroup/Maneuver/Event"):
                deleted = event.all("Action/GlobalAction/EntityAction")
                if not any(map(_deletes, deleted)):
                    continue
                begin = conditions.moment(act.find("StartTrigger"), Moment(0.0))
                begin = conditions.moment(event.find("StartTrigger"), begin)
                if begin.time == NEVER:
                    continue
                if begin.time > 0.0 or not begin.known:
                    raise event.fault("an entity that is deleted during the drive is not played")
                for part in deleted:
                    self._referred(part).deleted = True

    def _act(self, act: Part) -> None:
        begin = self.conditions.moment(act.find("StartTrigger"), Moment(0.0))
        self.conditions.note(act, Span(begin, NEVER))  # for who is in it
        before = {name: len(doing.acts) for name, doing in self.doing.items()}
        ends = [self._group(group, begin) for group in act.all("ManeuverGroup")]
        end = max(ends, default=begin.time)
        self.conditions.note(act, Span(begin, end), again=True)
        stop = act.find("StopTrigger")
        if stop is None or stop.find("ConditionGroup") is None:
            return
        if all(len(self.doing[name].acts) == count for name, count in before.items()):
            self._ignore(stop)
            return
        at = self.conditions.moment(stop, Moment(0.0))
        if at.known and at.time < min(end, self.ends):
            raise stop.fault("an act that a time stops while an actor moves in it is not supported")
        if not at.known:
            self._stopped(stop, at, before)

    def _stopped(self, stop: Part, at: Moment, before: Mapping[str, int]) -> None:
        """Let the moves of an act begin only before a condition stops it; speeds stay as they are
        then.

        before: how many moves the actors have that are not the act's.
        """
        actor, latch = self._latch(at.program)
        stays = (played.ENDED, actor, latch, 0.0), (played.VALUE, 0, 0, 0.5)
        goes_on = *stays, operation(played.BELOW)
        for name, count in before.items():
            acts = self.doing[name].acts
            own = [k for k in range(count, len(acts)) if not changes_nothing(acts[k])]
            if not own:
                continue
            if at.time > 0.0 or any(acts[k].kind <= played.COSINE for k in own):
                raise stop.fault("an act that a condition stops is supported for changes of speed, "
                                 "without a delay")  # fmt: skip
            for k in own:
                act = acts[k]
                if not act.program:
                    raise stop.fault("an act that a condition stops must begin by one as well")
                program = (*act.program, *goes_on, operation(played.AND))
                acts[k] = act._replace(program=program)
            acts.append(played.Act(played.KEEP, program=at.program))

    def _group(self, group: Part, begin: Moment) -> float:
        if group.number("maximumExecutionCount", 1.0) != 1.0:
            raise group.fault(
                "a group of manoeuvres that runs more or less than once is not played"
            )
        actors = group.child("Actors")
        if actors.flag("selectTriggeringEntities"):
            raise actors.fault("actors that the trigger selects are not played")
        names = [part.text("entityRef") for part in actors.all("EntityRef")]
        ends = [begin.time]
        for part in group.children():
            if part.tag == "CatalogReference":
                ends.append(self._maneuver(self.catalogs.entry(part), names, begin))
            elif part.tag == "Maneuver":
                ends.append(self._maneuver(part.within(), names, begin))
        return max(ends)

    def _maneuver(self, maneuver: Part, names: list[str], begin: Moment) -> float:
        ends, moves = [begin.time], []
        running: list[tuple[Part, Span]] = []
        for event in maneuver.all("Event"):
            span = self._event(event, names, begin)
            if span is not None:
                self._check_priority(event, span, running)
                running.append((event, span))
                ends.append(span.end)
                moves.append(span.move)
        end, move = max(ends), next((it for it in reversed(moves) if it is not None), None)
        self.conditions.note(maneuver, Span(begin, end, move))
        return end

    def _check_priority(self, event: Part, span: Span, above: list[tuple[Part, Span]]) -> None:
        """Refuse an event that ends another move of its manoeuvre half-way, or is left out while
        another one runs.
        """
        for other, there in above:
            for one, first, two, second in (
                (event, span, other, there),
                (other, there, event, span),
            ):
                priority = one.attribute("priority")
                skips = priority == "skip"
                if not skips and (priority == "parallel" or _kinds(one) == _kinds(two)):
                    continue
                if not first.begin.known or not second.begin.known:
                    if skips:
                        raise one.fault(
                            "the priority `skip` is played between events that begin at times only"
                        )
                    continue
                if second.begin.time < first.begin.time < second.end - _SAME and _kinds(two):
                    what = "is left out" if skips else "ends"
                    raise one.fault(f"with its priority `{priority}` it {what} while event "
                                     f"`{two.attribute('name')}` runs, which is not "
                                     "played")  # fmt: skip

    def _event(self, event: Part, names: list[str], begin: Moment) -> Span | None:
        """When an event runs; None where nothing in it means anything here."""
        event.one_of("priority", ("overwrite", "override", "parallel", "skip"))
        told = [action.only() for action in event.all("Action")]
        idle = [part for part in told if part.tag == "UserDefinedAction" or self._idle(part, names)]
        if len(idle) == len(told):
            for part in told:
                self._ignore(part if part.tag == "UserDefinedAction" else part.only())
            return None
        begin = self.conditions.moment(event.find("StartTrigger"), begin)
        if event.number("maximumExecutionCount", 1.0) != 1.0:
            raise event.fault("an event that runs more than once is not played")
        found = Span(begin, begin.time)
        for action, inner in zip(event.all("Action"), told, strict=True):
            if inner in idle:
                self._ignore(inner.only())
                continue
            span = Span(begin, NEVER)
            for name in names:
                if begin.time < NEVER and inner.tag == "PrivateAction":
                    span = self._move(inner.only(), self.places.entity(name, event), begin)
            self.conditions.note(action, span)
            found = Span(begin, max(found.end, span.end), span.move or found.move)
        self.conditions.note(event, found)
        return found

    def _idle(self, action: Part, names: list[str]) -> bool:
        """Whether an action means nothing here, or belongs to the ego, which is the ADS's."""
        inner = action.only()
        if action.tag == "GlobalAction":
            if inner.tag not in IGNORED_GLOBAL and not _deletes(inner):
                raise inner.not_played()
            return True
        if action.tag != "PrivateAction":
            raise action.not_played()
        if inner.tag in IGNORED_PRIVATE:
            return True
        if self.ego in names:
            raise inner.fault(
                "the ego is driven by the ADS: what it does during the drive cannot be told"
            )
        return False

    def _move(self, element: Part, entity: Entity, begin: Moment) -> Span:
        """An action of one of the others during the drive."""
        if entity.deleted:
            return Span(begin, begin.time)
        doing = self.doing[entity.name]
        if element.tag in ("LongitudinalAction", "LateralAction", "RoutingAction"):
            element = element.only()
        known = {
            "SpeedAction": self._speed, "LaneChangeAction": self._lane_change,
            "LaneOffsetAction": self._lane_offset,
            "LongitudinalDistanceAction": self._distance, "FollowTrajectoryAction": self._follow,
            "SynchronizeAction": self._synchronize,
        }  # fmt: skip
        if element.tag not in known:
            raise element.not_played(f"moves that are: {', '.join(known)}")
        return known[element.tag](element, entity, doing, begin)

    def _add(
        self, entity: Entity, doing: Doing, begin: Moment, act: played.Act, lasts: float
    ) -> Span:
        doing.acts.append(act._replace(begin=begin.time, program=begin.program))
        if begin.known:
            return Span(begin, begin.time + lasts)
        return Span(begin, NEVER, (self.number_of[entity.name], len(doing.acts) - 1))

    def _speed(self, element: Part, entity: Entity, doing: Doing, begin: Moment) -> Span:
        kept = element.child("SpeedActionTarget").only()
        if kept.flag("continuous"):
            return self._match(kept, element, entity, doing, begin)
        target = self._target_speed(element)
        dynamics = element.child("SpeedActionDynamics")
        shape = self._shape(dynamics, "change of speed", "linear", "step", "cubic", "sinusoidal")
        change = abs(target - doing.speed)
        if change <= _SAME:
            return Span(begin, begin.time)
        rate = change / _AT_ONCE
        if shape != "step":
            kind = dynamics.one_of("dynamicsDimension", ("rate", "time", "distance"))
            value = (
                abs(dynamics.number("value")) if kind == "rate" else dynamics.above_zero("value")
            )
            if kind != "rate" and begin.known and begin.time < doing.steady - _SAME:
                raise dynamics.fault(f"`{entity.name}` still changes its speed when this begins, "
                                     f"at {begin.time:g} s: "
                                     "by `rate` alone that is played")  # fmt: skip
            by_distance = abs(target * target - doing.speed * doing.speed) / 2.0
            rate = {
                "rate": value,
                "time": change / (value or 1.0),
                "distance": by_distance / (value or 1.0),
            }[kind]
            if rate == 0.0:  # it never gets there
                return Span(begin, NEVER)
        if doing.across == begin:
            raise dynamics.fault(_STEADY)
        doing.speed_changes = begin
        act = played.Act(played.SPEED, 0.0, 0.0, target, 0.0, rate)
        if shape in ("cubic", "sinusoidal"):
            if kind == "distance":  # the mean speed of both is halfway
                rate = 0.5 * (target + doing.speed) * change / value
            rate /= _PEAKS[shape] if kind == "rate" else 1.0
            knots = [(share * change / rate, doing.speed + (target - doing.speed)
                      * _eased(shape, share)) for share in _SHARES]  # fmt: skip
            act = played.Act(played.BY_TIME, table=tuple(knots))
        doing.speed = target
        doing.steady = begin.time + change / rate if begin.known else 0.0
        return self._add(entity, doing, begin, act, change / rate)

    def _match(
        self, target: Part, element: Part, entity: Entity, doing: Doing, begin: Moment
    ) -> Span:
        """A speed relative to another's at every instant, without end."""
        dynamics = element.child("SpeedActionDynamics")
        if not _at_once(dynamics):
            self._shape(dynamics, "continuous speed", "step")
        doing.speed = self._target_speed(element)
        value = target.number("value")
        by_factor = target.attribute("speedTargetValueType") == "factor"
        other = self.places.entity(target.text("entityRef"), target)
        factor, added = (value, 0.0) if by_factor else (1.0, value)
        return self._relative(other, entity, doing, begin, ((added, 0.0), (0.0, 0.0)), factor)

    def _relative(
        self, other: Entity, entity: Entity, doing: Doing, begin: Moment,
        rule: tuple[tuple[float, float], ...], factor: float = 1.0,
    ) -> Span:  # fmt: skip
        """A speed or a place relative to another's at every instant.

        rule, factor: as in `played.PLAY` under `match`.
        """
        self._check_with_road(entity)
        number = self.number_of.get(other.name, played.EGO)
        act = played.Act(played.MATCH, table=((float(number), factor), *rule))
        span = self._add(entity, doing, begin, act, NEVER)
        if begin.known:  # it looks at the other after every step, as what waits does
            doing.acts[-1] = doing.acts[-1]._replace(begin=0.0, program=_from(begin.time))
        return span

    def _check_with_road(self, entity: Entity) -> None:
        if self.frame.line and math.cos(entity.frame.heading) < 0.0:
            raise entity.element.fault(
                "a speed relative to another's is not supported of an oncoming vehicle on a curve"
            )

    def _lateral(self, element: Part, entity: Entity, doing: Doing, begin: Moment, to: float,
        lasts: float,
                 shape: str) -> Span:  # fmt: skip
        """A move across the road to the offset `to` m from where it started, in `lasts` s."""
        if entity.on_map:
            raise element.fault(
                f"`{entity.name}` drives straight on the map, so it has no lane to move across"
            )
        offset = to - doing.offset
        if abs(offset) <= _ON:
            return Span(begin, begin.time)
        if begin.known and begin.time < doing.busy_until - _SAME:
            raise element.fault(
                f"`{entity.name}` still moves across when this begins, at {begin.time:.2f} s"
            )
        if math.cos(entity.frame.heading) < 0.0:  # to the left of where it drives
            offset = -offset
        doing.offset = to
        doing.busy_until = begin.time + lasts if begin.known else 0.0
        if shape != "linear":
            act = played.Act(played.COSINE, 0.0, lasts, 0.0, offset)
        else:
            act = played.Act(played.CONSTANT, 0.0, lasts, abs(offset) / lasts, offset)
        return self._add(entity, doing, begin, act, lasts)

    def _shape(self, dynamics: Part, what: str, *shapes: str) -> str:
        """The shape of a change, one of those that are played."""
        shape = dynamics.one_of("dynamicsShape", ("linear", "step", "cubic", "sinusoidal"))
        if shape not in shapes:
            those = " and ".join(f"`{name}`" for name in shapes)
            raise dynamics.fault(f"a {what} of the shape `{shape}` is not played, {those} are")
        return shape

    def _lane_change(self, element: Part, entity: Entity, doing: Doing, begin: Moment) -> Span:
        target = element.child("LaneChangeTarget").only()
        own = entity.placed(element)
        if target.tag == "RelativeTargetLane":
            other = self._now(self.places.entity(target.text("entityRef"), target), entity, target)
            lanes = target.whole("value")
            assert other.lane is not None
            lane = other.lane if lanes == 0 else self.places.lane_beside(other, lanes, target)
        elif target.tag == "AbsoluteTargetLane":
            if own.road is None:
                raise target.fault("the entity is on no road")
            lane = self.network.lane(own.road, target.text("value"), target)
        else:
            raise target.not_played()
        to = self._y(lane.centre + element.number("targetLaneOffset", 0.0), element, own)
        to -= entity.frame.y
        dynamics = element.child("LaneChangeActionDynamics")
        shape = self._shape(dynamics, "move across", *_PEAKS)
        value, offset = dynamics.above_zero("value"), abs(to - doing.offset)
        kind = dynamics.one_of("dynamicsDimension", ("rate", "time", "distance"))
        if kind == "distance":
            doing.across = begin
            changes = begin.known and begin.time < doing.steady - _SAME
            if doing.speed <= 0.0 or changes or doing.speed_changes == begin:
                raise dynamics.fault(_STEADY)
        durations = {"time": value, "rate": offset / value * _PEAKS[shape],
                     "distance": value / (doing.speed or 1.0)}  # fmt: skip
        return self._lateral(element, entity, doing, begin, to, durations[kind], shape)

    def _now(self, other: Entity, mover: Entity, element: Part) -> Spot:
        """Where somebody is in a lane when a move that is relative to it begins: the mover itself
        after its own moves across, the ego where it starts. Another one must keep its lane.
        """
        spot = other.placed(element)
        if spot.road is None or spot.lane is None:
            raise element.fault("the entity that it is relative to is in no lane")
        if other.name == self.ego or self.doing[other.name].offset == 0.0:
            return spot
        if other is not mover:
            raise element.fault(f"`{other.name}`, to which it is relative, moves across itself")
        centre = spot.t + self.doing[other.name].offset
        lanes = sorted(spot.road.lanes.values(), key=lambda it: abs(it.centre - centre))
        if abs(lanes[0].centre - centre) > 0.5 * lanes[0].width:
            raise element.fault(f"`{other.name}`, to which it is relative, is in no lane any more")
        return replace(spot, lane=lanes[0])

    def _y(self, t: float, element: Part, spot: Spot) -> float:
        """y of a place t m left of the reference line of the ego's road."""
        if spot.road is None or spot.road.name != self.frame.road:
            raise element.fault("a move across is played on the ego's road only")
        return self.frame.way * (t - self.frame.offset)

    def _lane_offset(self, element: Part, entity: Entity, doing: Doing, begin: Moment) -> Span:
        target = element.child("LaneOffsetTarget").only()
        value = target.number("value")
        own = entity.placed(element)
        if target.tag == "AbsoluteTargetLaneOffset":
            lane = self._now(entity, entity, target).lane
            assert lane is not None
            to = self._y(lane.centre, element, own) + value
        elif target.tag == "RelativeTargetLaneOffset":
            other = self.places.entity(target.text("entityRef"), target)
            moved = 0.0 if other.name == self.ego else self.doing[other.name].offset
            if moved and other is not entity:
                raise target.fault(f"`{other.name}`, to which it is relative, moves across itself")
            to = other.frame.y + moved + value
        else:
            raise target.not_played()
        to -= entity.frame.y
        dynamics = element.child("LaneOffsetActionDynamics")
        shape = self._shape(dynamics, "move across with `maxLateralAcc`", "sinusoidal", "cubic")
        strongest = dynamics.above_zero("maxLateralAcc", " m/s2")
        # peak lateral acceleration of an offset d in T s: d pi^2 / 2 T^2, or of a cubic 6 d / T^2
        peak = 6.0 if shape == "cubic" else 0.5 * math.pi**2
        lasts = math.sqrt(peak * abs(to - doing.offset) / strongest)
        span = self._lateral(element, entity, doing, begin, to, lasts, shape)
        if not element.flag("continuous"):
            return span
        if target.tag == "RelativeTargetLaneOffset":
            raise target.fault("an offset that is kept to another entity is not supported")
        return Span(begin, NEVER)  # an actor keeps its offset in the lane without end

    def _distance(self, element: Part, entity: Entity, doing: Doing, begin: Moment) -> Span:
        if element.flag("continuous"):
            return self._distance_kept(element, entity, doing, begin)
        if not begin.known or begin.time > 0.0:
            raise element.fault("a distance is taken up at the start only")
        self._keep_distance(element, entity)
        return Span(begin, begin.time)

    def _distance_kept(self, element: Part, entity: Entity, doing: Doing, begin: Moment) -> Span:
        """A distance, or a time gap, to another at every instant, without end."""
        other, ahead, apart = self._apart(element, entity)
        if other is not self.entities[self.ego]:
            doing.speed = self.doing[other.name].speed
        gap = element.number("timeGap", 0.0)
        if ahead and gap:
            raise element.fault("a time gap that is kept ahead of another is not supported")
        return self._relative(other, entity, doing, begin, ((0.0, 1.0), (apart, gap)))

    def _follow(self, element: Part, entity: Entity, doing: Doing, begin: Moment) -> Span:
        trajectory = self._trajectory(element)
        pose = entity.placed(element).pose
        first = trajectory.points[0]
        if math.hypot(first[0] - pose.x, first[1] - pose.y) > 0.5:
            raise element.fault(f"the trajectory must begin where `{entity.name}` is")
        if trajectory.bends:
            raise element.fault("a trajectory that bends is not played")
        entity.way = trajectory.points
        if self.frame.line:
            if entity.speed > 0.0 and not (begin.known and begin.time == 0.0):
                raise element.fault(
                    "on a road that bends a trajectory is played from the start, or of who stands"
                )
            entity.on_map = True
            entity.frame = self._found_in_frame(entity)
        else:
            entity.frame = self._along(entity)
        if element.number("initialDistanceOffset", 0.0) != 0.0:
            raise element.fault("`initialDistanceOffset` is played before the start only")
        if not trajectory.times:
            return self._add(entity, doing, begin, played.Act(played.KEEP), NEVER)
        if trajectory.times[0] != 0.0:
            raise element.fault(
                f"the first time of its trajectory must be 0 s, got {trajectory.times[0]:g}"
            )
        timing = element.find("TimeReference/Timing")
        scale = 1.0 if timing is None else timing.number("scale", 1.0)
        if timing is not None and timing.number("offset", 0.0) != 0.0:
            raise timing.fault("`offset` must be 0")
        if timing is not None and timing.attribute("domainAbsoluteRelative") != "relative":
            raise timing.fault("times of a trajectory are played relative to its begin only")
        knots: list[tuple[float, float]] = []
        speed = doing.speed
        for k in range(1, len(trajectory.points)):
            (x, y), (x2, y2) = trajectory.points[k - 1 : k + 1]
            since, until = trajectory.times[k - 1] * scale, trajectory.times[k] * scale
            if until <= since:
                raise element.fault("the times of its trajectory must ascend")
            speed = math.hypot(x2 - x, y2 - y) / (until - since)
            knots += [(since + _AT_ONCE, speed), (until, speed)]
        doing.speed = speed
        return self._add(
            entity, doing, begin, played.Act(played.BY_TIME, table=tuple(knots)), knots[-1][0]
        )

    def _synchronize(self, element: Part, entity: Entity, doing: Doing, begin: Moment) -> Span:
        master = self.places.entity(element.text("masterEntityRef"), element)
        if not begin.known:
            raise element.fault(
                "a SynchronizeAction that begins by a condition on the drive is not played"
            )
        if master.name != self.ego or master.speed <= 0.0:
            raise element.fault("it is played for a master that is the ego and moves at the start")
        goal = self.places.spot(element.child("TargetPositionMaster")).pose
        way = goal.seen_from(master.placed(element).pose).x
        if self.turning is not None:  # along the way on which it turns
            at, begins = (
                pose.seen_from(self.frame.origin) for pose in (goal, master.placed(element).pose)
            )
            way = float(frame_places(self.frame.line, at.x, at.y)[0]) - begins.x
        target = self.places.spot(element.child("TargetPosition")).pose
        arrives = way / master.speed - begin.time
        steady, final = 0.0, doing.speed
        wanted = element.find("FinalSpeed")
        if wanted is not None:
            kind = wanted.only()
            final = kind.number("value")
            if kind.tag == "RelativeSpeedToMaster":
                by_factor = kind.attribute("speedTargetValueType") == "factor"
                final = master.speed * final if by_factor else master.speed + final
            elif kind.tag != "AbsoluteSpeed":
                raise kind.not_played()
            rest = kind.children()
            if rest:
                by_time = rest[0].tag == "TargetTimeSteadyState"
                steady = rest[0].number("time" if by_time else "distance") * (
                    final if by_time else 1.0
                )
        ahead = target.seen_from(
            entity.placed(element).pose._replace(heading=self._heading(entity))
        ).x
        ahead -= doing.speed * begin.time
        try:
            knots = synchronized(ahead, arrives, doing.speed, final, steady)
        except InputError as error:
            raise element.fault(
                f"`{entity.name}` cannot be there when the ego is: {error}"
            ) from None
        doing.speed = final
        return self._add(entity, doing, begin, played.Act(played.BY_TIME, table=knots), arrives)

    def _heading(self, entity: Entity) -> float:
        """Where an entity goes, on the map."""
        assert entity.spot is not None
        if len(entity.way) < 2:
            return entity.spot.pose.heading
        (x, y), (x2, y2) = entity.way[0], entity.way[-1]
        return math.atan2(y2 - y, x2 - x)

    # -- what comes out ----------------------------------------------------------------------------

    def _along(self, entity: Entity) -> Pose:
        """The centre of an entity that points along its way, in the frame."""
        return (
            Pose(*entity.way[0], self._heading(entity))
            .moved(entity.centre, entity.offset)
            .seen_from(self.frame.origin)
        )

    def _actor(self, entity: Entity) -> Actor:
        frame, doing = entity.frame, self.doing[entity.name]
        acts = list(doing.acts)
        if len(entity.way) > 2:
            raise entity.element.fault("a trajectory of more than one straight line is not played")
        heading = 0.0 if abs(frame.heading) < 1e-6 else frame.heading
        across = self._on_map(entity) if entity.on_map else None
        ground = 1.0 if across is not None else self._ground(frame)
        start = Start(frame.x, frame.y, entity.speed / ground)
        acts = [_along_line(act, ground) for act in acts]
        plain = across is None and heading == 0.0 and self._beside_nothing(frame.y)
        if not plain and all(act.timed for act in acts):
            acts.append(keeps_on(acts))
        return Actor(
            self.names[entity.name], start, tuple(acts), entity.length, entity.width,
            body=entity.body, heading=heading,
            on_map=None if across is None else (across.x, across.y, across.heading),
        )  # fmt: skip

    def _ground(self, at: Pose) -> float:
        """m over the ground for a metre along the road's line, at a place beside it: 1 on a
        straight road.
        """
        if not self.frame.line or self.turning is not None:
            return 1.0
        return 1.0 - float(curvatures(self.frame.line, at.x)) * at.y

    def _beside_nothing(self, y: float) -> bool:
        """Whether a place across the road is on its lanes."""
        width = self.frame.lane_width
        return -0.5 * width <= y <= width * (self.frame.lanes - 0.5)

    def _stop(self, trigger: Part | None) -> None:
        """Stops by time end the case; what else may stop a file ends it here by contact, standstill
        or its decision.
        """
        for group in () if trigger is None else trigger.all("ConditionGroup"):
            conditions = group.all("Condition")
            kinds = [
                condition.only().only().tag
                if condition.find("ByValueCondition") is not None
                else ""
                for condition in conditions
            ]
            if kinds == ["SimulationTimeCondition"]:
                stop = self.conditions.group(group).time
                if stop <= 0.0:
                    time = conditions[0].only().only()
                    got = f"{time.get('rule')} {time.number('value'):g} s"
                    raise time.fault(f"a stop by time must come after the start, got {got}")
                self.ends = min(self.ends, stop)
            else:
                self._ignore(group)
