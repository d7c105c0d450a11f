"""A scenario file of OpenSCENARIO at one point of its space: the road, the ego's start, the actors.

`logical` reads every point by `read_case`.

Interpretations, where the standard leaves a choice or this package supports less:

- The ego belongs to the ADS from the start: its controllers and actions during the drive are
  ignored, its start is not.
- At the end of a trajectory an actor keeps straight on at its speed.

Users: `extras/openscenario/logical.py`, `extras/openscenario/space.py`,
`extras/openscenario/written.py`.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from sumo_eval.cosim.openscenario import CASE, exported_case
from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.catalogs import Catalogs, named_file
from sumo_eval.extras.openscenario.conformity import IGNORED
from sumo_eval.extras.openscenario.drive_numbers import operation
from sumo_eval.extras.openscenario.frame import ORIGIN, Frame, frame_of, framed
from sumo_eval.extras.openscenario.moments import (
    NEVER,
    Conditions,
    Moment,
    Span,
)
from sumo_eval.extras.openscenario.moves import (
    Moves,
    changes_nothing,
    is_step,
    target_speed,
)
from sumo_eval.extras.openscenario.network import read_network
from sumo_eval.extras.openscenario.places import (
    ALONG,
    EGO_ALONG,
    Entity,
    MapPath,
    Places,
    Spot,
    UnplacedError,
    entity_of,
)
from sumo_eval.extras.openscenario.reading import Node, read_openscenario
from sumo_eval.extras.openscenario.values import Value
from sumo_eval.scenario import played
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, EgoBody, Start, keeps_on
from sumo_eval.scenario.first_places import STANDARD_EGO
from sumo_eval.scenario.played import Act
from sumo_eval.scenario.road.pose import Pose

EGO = "Ego"
LONGEST = 60.0  # s that a case lasts where no stop of the file is by time
Actions = list[tuple[Node, Entity]]
"""Actions of Init, each with its entity."""


class FileOptions(NamedTuple):
    """The user's options behind a file's name, as in `a.xosc?ego=Car1`.

    ego: the entity that the ADS drives; None: `Ego`, else the only one with a controller, else the
        only one.
    map: the OpenDRIVE file; None: the one that the scenario file names.
    """

    ego: str | None = None
    map: str | None = None


class FileCase(NamedTuple):
    """The scenario at a point.

    frame: the road.
    ego: where the ego starts.
    ends: time at which the case ends at the latest, s.
    ignored: kinds of elements without a meaning here.
    elements: <ScenarioObject> of the ego, as `ego`, and of each actor by its name.
    whole: the case that `sumo-eval export` wrote into the file; None in other files.
    """

    frame: Frame
    ego: Start
    ego_body: EgoBody
    actors: tuple[Actor, ...]
    ends: float
    ignored: tuple[str, ...]
    elements: Mapping[str, Node]
    whole: ConcreteScenario | None = None


def read_case(path: Path, given: Mapping[str, Value], options: FileOptions) -> FileCase:
    """The case of a scenario file with given values of its parameters.

    given: parameter -> value; other parameters have the value that the file declares.

    The file's constraints are not checked here: `logical` checks them where they must hold.

    Raises InputError with file, line and element.
    """
    root = read_openscenario(path)
    if root.find(f"FileHeader/Properties/Property[@name='{CASE}']"):
        file = _map_of(root, None)
        try:
            whole = exported_case(root.element, file.read_bytes())
        except InputError as error:
            raise root.child("FileHeader").fault(str(error)) from None
        if whole:  # `sumo-eval export` wrote it
            road, body = whole.road, whole.ego_body or STANDARD_EGO
            frame = Frame(ORIGIN, road.line, road.lanes, road.lane_width, road.end, road.name, 0.0,
                          "")  # fmt: skip
            ends = LONGEST if whole.time_limit is None else whole.time_limit
            return FileCase(frame, whole.ego, body, whole.actors, ends, (), {}, whole)
    return _Player(root, given, options).scene()


def _kinds(holder: Node) -> set[str]:
    """Tags of the actions in an event or an act that move an entity."""
    return {action.tag for action in holder.all(".//PrivateAction/*")}.difference(IGNORED)


def _awaited(root: Node) -> set[str]:
    """Names of the elements whose states a move waits for, directly or through other events."""
    # of each condition on an element's state: the name of this element, and the names of the event
    # or act that waits for it, with those around it
    waits = []
    names = set()
    states: Any = root.element.xpath(".//StoryboardElementStateCondition")
    for state in states:
        name = str(state.get("storyboardElementRef")).rpartition("::")[2]
        # the innermost event or act around it, which waits; none in a stop of the storyboard
        for holder in state.xpath("ancestor::*[self::Event or self::Act][1]"):
            if _kinds(Node(holder)) or holder.find("ManeuverGroup/CatalogReference") is not None:
                names.add(name)
            waits.append((name, _names_around(holder)))
    # what an awaited element waits for is awaited too; each round follows chains one link further
    for _ in waits:
        names |= {name for name, around in waits if around & names}
    return names


def _names_around(element: Any) -> set[str]:
    """The names of an element, of the elements around it, and of the actions in it."""
    return set(element.xpath("ancestor-or-self::*/@name | .//Action/@name"))


def distinct(names: Iterable[str], *taken: str) -> list[str]:
    """The names, each with `_` appended until it differs from earlier and taken names."""
    names_so_far = [*taken]
    for name in names:
        while name in names_so_far:
            name += "_"
        names_so_far.append(name)
    return names_so_far[len(taken) :]


def _along_line(act: Act, ground: float) -> Act:
    """A move with its speeds along the road's line instead of over the ground.

    ground: metres that the actor drives over the ground for each metre along that line.
    """
    if act.kind == played.SPEED:
        return act._replace(speed=act.speed / ground, acceleration=act.acceleration / ground)
    if act.kind == played.BY_TIME:
        return act._replace(table=tuple((time, speed / ground) for time, speed in act.table))
    return act


def _map_of(root: Node, other: str | None) -> Path:
    """The OpenDRIVE file of a scenario file.

    other: the user's own; None: the one that the scenario file names.
    """
    if other is not None:
        return named_file(root, other)
    network = root.child("RoadNetwork")
    named = network.find("LogicFile") or network
    file = named.text("filepath", "")
    if not Path(file).suffix:
        raise named.fault(
            f"it must name an OpenDRIVE file, `{file}` is nothing or the name of a simulator's "
            "map: `?map=FILE.xodr` behind the scenario file's name names one"
        )
    return named_file(named)


class _Player:
    """Reader of one scenario file at one point; `scene` may be called once.

    root: of the file, with the parameters of the point.
    ignored: kinds of elements without a meaning here, in the order of reading.
    distances: LongitudinalDistanceActions of Init; they place an entity once the road is known.
    begun: actions of Init that are moves from 0 s on.
    ends: time of the first stop by time, s; inf: the file has none.
    route_end: end of the ego's route or trajectory; None: it has neither.
    turning: the ego's trajectory if it turns; None: it does not.

    `scene` adds the `frame`, the `actors`, and with them `moves`, `conditions` and `awaited`, the
    names of elements whose states a move waits for.
    """

    def __init__(self, root: Node, given: Mapping[str, Value], options: FileOptions) -> None:
        if not root.find("Storyboard"):
            raise root.fault("it must hold a <Storyboard>")
        root, _ = root.declared(given)
        self.root = root
        self.catalogs = Catalogs(root)
        network = read_network(_map_of(root, options.map))
        holder = root.child("Entities")
        entities: dict[str, Entity] = {}
        for part in holder.all("ScenarioObject"):
            entity = entity_of(part, self.catalogs)
            if entities.setdefault(entity.name, entity) is not entity:
                raise part.fault(f"there is another entity with the name `{entity.name}`")
        # scenario_runner reads these files with CARLA's axes, in which y points to the right
        about = str(root.child("FileHeader").get("description"))
        side = -1.0 if about.startswith("CARLA:") else 1.0
        signals = root.all("RoadNetwork/TrafficSignals/*")
        self.ignored = dict.fromkeys(it.tag for it in signals)
        self.places = Places(network, self.catalogs, entities, side, self.ignored)
        ego = self._only_controlled() if options.ego is None else options.ego
        if ego not in entities:
            raise holder.fault(
                "the entity that the ADS drives must be named `Ego`, or be the only one with a "
                "controller; `?ego=NAME` behind the file's name names it, one of "
                f"{', '.join(entities) or 'none'}"
            )
        self.ego = entities[ego]
        self.distances: Actions = []
        self.begun: Actions = []
        self.ends = math.inf
        self.route_end: Pose | None = None
        self.turning: MapPath | None = None

    def _only_controlled(self) -> str:
        """Name of the entity that the ADS drives where the user names none.

        It is the only one called `Ego` (in any case of letters), else the only one with a
        controller, else the only one. Where several are possible, it is `Ego`.
        """
        egos = [name for name in self.places.entities if name.lower() == EGO.lower()]
        controlled = {
            name
            for name, entity in self.places.entities.items()
            if entity.element.find("ObjectController/*")
        }
        for part in self.root.all("Storyboard/Init/Actions/Private"):
            if part.find("PrivateAction/ControllerAction"):
                controlled.add(part.text("entityRef"))
        candidates = egos or controlled or [*self.places.entities]
        return candidates.pop() if len(candidates) == 1 else EGO

    def scene(self) -> FileCase:
        """The case. Each of the five steps needs the results of the earlier ones."""
        # 1. starts: places and speeds on the map
        story, entities, ego = self.root.child("Storyboard"), self.places.entities, self.ego
        self._init(story.child("Init").child("Actions"))
        for name, entity in list(entities.items()):
            if not entity.spot and entity.deleted and entity is not ego:
                del entities[name]
        # 2. the road, and all entities in its frame
        for entity in entities.values():
            road = entity.placed().road
            self.ignored |= dict.fromkeys((*(road.left_out if road else ()), *entity.left_out))
        self.frame = frame = frame_of(ego, self.places.network, self.turning, self.route_end)
        # `moves` and `conditions` share this list, which step 3 fills
        self.actors = actors = list[Entity]()
        self.moves = Moves(self.places, frame, ego, actors)
        for entity in entities.values():
            road = entity.placed().road
            elsewhere = not road or road.name != frame.road
            entity.on_map = entity is not ego and (
                frame.turns or (elsewhere and bool(frame.line))  # a line: the road is curved
            )
            entity.frame = framed(entity, frame)
        for distance, entity in self.distances:
            if not distance.find("DynamicConstraints"):
                self.moves.place_apart(distance, entity)

        # 3. the actors by number: all but the ego and those that are deleted at the start
        self.conditions = Conditions(self.places, frame, actors)
        self._delete_at_once(story)
        actors += [it for it in entities.values() if it is not ego and not it.deleted]
        for number, entity in enumerate(actors):
            entity.number = number
        # 4. the story: stops, moves from the start on, acts in the order of the file
        self.awaited = _awaited(self.root) if actors else set[str]()
        self._stop(story)
        for element, entity in self.begun + self.distances:
            self.moves.begin(element, entity, Moment(0.0))
        for act in self._acts(story):
            self._act(act)
        # 5. names that SUMO accepts; `ego` is that of the ADS
        names = distinct((re.sub(r"[^\w.-]", "_", it.name) for it in actors), "ego")
        return FileCase(
            frame,
            Start(ego.frame.x, ego.frame.y, ego.speed),
            EgoBody(ego.length, ego.width),
            tuple(map(self._actor, names, actors)),
            self.limit,
            tuple(self.ignored),
            {"ego": ego.element}
            | {name: it.element for name, it in zip(names, actors, strict=True)},
        )

    def _ignore(self, action: Node) -> None:
        """Note an action without a meaning here; refuse any other."""
        if action.tag not in IGNORED:
            raise action.unsupported()
        self.ignored[action.tag] = None

    # -- before the start --------------------------------------------------------------------------

    def _init(self, actions: Node) -> None:
        """Carry out the actions of <Init>: places, speeds and moves at the start."""
        waiting = []
        for part in actions.children():
            inner = part.only() if part.tag == "GlobalAction" else part
            if part.tag == "Private":
                entity = self.places.referred(part)
                waiting += [(action.only(), entity) for action in part.all("PrivateAction")]
            elif inner.tag == "EntityAction":
                entity, action = self.places.referred(inner), inner.only()
                entity.deleted = action.tag == "DeleteEntityAction"
                waiting += [] if entity.deleted else [(action, entity)]
            else:
                self._ignore(inner)
        for element, entity in waiting:
            entity.waits += element.find("SpeedAction") is not None
        while waiting:
            waiting = self._do_possible(waiting)

    def _do_possible(self, waiting: Actions) -> Actions:
        """Do the actions of Init that need no unknown place or speed; return the rest.

        An action may depend on one of another entity further down in the file.
        """
        rest = []
        faults = []
        for element, entity in waiting:
            try:
                self._private_at_start(element, entity)
            except UnplacedError as fault:
                rest.append((element, entity))
                faults.append(fault)
        if len(rest) < len(waiting):
            return rest
        names = dict.fromkeys(entity.name for _, entity in rest)
        for unplaced in faults:
            if unplaced.entity not in names:  # no action of Init places it
                raise unplaced
        raise rest[0][0].fault(f"the starts of {', '.join(names)} depend on each other in a circle")

    def _private_at_start(self, element: Node, entity: Entity) -> None:
        """Do one action of an entity in Init. Raises UnplacedError where it must wait."""
        if element.tag in ("LongitudinalAction", "RoutingAction"):
            element = element.only()
        match element.tag:
            case "TeleportAction" | "AddEntityAction":
                along = EGO_ALONG if entity is self.ego else ALONG
                spot = self.places.spot(element.child("Position"))
                entity.spot = self.places.located(spot, along)
            case "SpeedAction":
                self._speed_at_start(element, entity)
            case "LongitudinalDistanceAction":
                self.distances.append((element, entity))
            case "AssignRouteAction":
                _, end = self.places.route(element)
                if entity is self.ego:
                    self.route_end = end.pose
            case "FollowTrajectoryAction":
                self._follow_from_start(element, entity)
            case _:
                self._ignore(element)

    def _speed_at_start(self, element: Node, entity: Entity) -> None:
        """Set a speed at the start.

        A gradual change, or a speed that is kept relative to another's, is a move from 0 s on.
        """
        speed = target_speed(element, self.places, entity)
        entity.waits -= 1
        if is_step(element.child("SpeedActionDynamics")):
            entity.speed = entity.pace = speed
            if not element.child("SpeedActionTarget").only().flag("continuous"):
                return
        if entity is self.ego:
            raise element.fault("the ego is driven by the ADS: its first speed must be a step")
        self.begun.append((element, entity))

    def _follow_from_start(self, element: Node, entity: Entity) -> None:
        """Place an entity on the trajectory that it follows from the start.

        A straight one without times only gives the path. Any other is a move of an actor from 0 s
        on, or the path of an ego that turns.
        """
        course = self.places.followed(element)
        begin = element.number("initialDistanceOffset", 0.0)
        first, pose = course.begin, course.at(begin, element)
        entity.spot = Spot(pose, first.road, first.lane, first.s + begin, first.t)
        entity.path = (pose[:2], course.points[-1])
        if entity is not self.ego:
            if course.times or not course.straight:
                self.begun.append((element, entity))
            return
        if course.times or not (course.straight or (course.pieces and begin == 0.0)):
            raise element.fault(
                "the trajectory of the ego must be a straight line or a whole ClothoidSpline, "
                "without times"
            )
        entity.spot = self.places.located(entity.spot)
        self.turning = None if course.straight else course
        self.route_end = Pose(*course.points[-1], pose.heading)

    # -- the story ---------------------------------------------------------------------------------

    def _acts(self, story: Node) -> Iterator[Node]:
        """Every act of the stories."""
        for part in story.all("Story"):
            yield from part.within().all("Act")

    def _delete_at_once(self, story: Node) -> None:
        """Mark the entities that are deleted at the start."""
        for act in self._acts(story):
            for event in act.all("ManeuverGroup/Maneuver/Event"):
                deleted = event.all("Action/GlobalAction/EntityAction[DeleteEntityAction]")
                if not deleted:
                    continue
                begin = self.conditions.moment(act, Moment(0.0))
                begin = self.conditions.moment(event, begin)
                if begin.time == NEVER:
                    continue
                if begin.time > 0.0 or not begin.known:
                    raise event.fault("deleting an entity during the drive is not supported")
                for part in deleted:
                    self.places.referred(part).deleted = True

    def _act(self, act: Node) -> None:
        """Make moves of an act's events, and let its <StopTrigger> stop them."""
        begin = self.conditions.moment(act, Moment(0.0))
        # conditions in the act may ask whether it runs: it is noted before its end is known
        span = self.conditions.note(act, Span(begin, NEVER))
        before = [len(entity.acts) for entity in self.actors]
        over_groups = Span.over(begin, [self._group(it, begin) for it in act.all("ManeuverGroup")])
        span.end, span.ended = over_groups.end, over_groups.ended
        stop = act.find("StopTrigger[ConditionGroup]")
        if not stop:
            return
        if before == [len(entity.acts) for entity in self.actors]:  # it has no moves to stop
            self.ignored["StopTrigger"] = None
            return
        at = self.conditions.moment(act, Moment(0.0), stop.tag)
        if not at.known:
            self._stopped(stop, at, before)
        elif at.time < min(span.end, self.limit):
            raise stop.fault("an act that a time stops while an actor moves in it is not supported")

    def _stopped(self, stop: Node, at: Moment, before: list[int]) -> None:
        """Let a condition stop an act: further moves do not begin, speeds stay as they are.

        at: when the condition holds.
        before: number of moves of each actor before the act.
        """
        # Appended to the program of a move, in postfix: "and has held < 0.5". `latch` gives 1 once
        # the condition has held, else 0.
        has_held = *self.conditions.latch(at.program, 0.0), (played.VALUE, 0, 0, 0.5)
        and_not_held = (*has_held, operation(played.BELOW), operation(played.AND))
        for entity, count in zip(self.actors, before, strict=True):
            acts = entity.acts
            own = [k for k in range(count, len(acts)) if not changes_nothing(acts[k])]
            # kinds up to COSINE are moves across the road
            if own and (at.time > 0.0 or any(acts[k].kind <= played.COSINE for k in own)):
                raise stop.fault("an act that a condition stops is supported for changes of speed, "
                                 "without a delay")  # fmt: skip
            for k in own:
                if not acts[k].program:
                    raise stop.fault("an act that a condition stops must begin by one as well")
                acts[k] = acts[k]._replace(program=(*acts[k].program, *and_not_held))
            if own:
                acts.append(Act(played.KEEP, program=at.program))

    def _group(self, group: Node, begin: Moment) -> Span:
        """Make moves of a <ManeuverGroup>; return when it runs."""
        if group.number("maximumExecutionCount", 1.0) != 1.0:
            raise group.fault("a group of manoeuvres must run once")
        actors = group.child("Actors")
        if actors.flag("selectTriggeringEntities"):
            raise actors.fault("actors that the trigger selects are not supported")
        names = [part.text("entityRef") for part in actors.all("EntityRef")]
        parts = [self.catalogs.entry(part) for part in group.all("CatalogReference")]
        parts += [part.within() for part in group.all("Maneuver")]
        spans = [self._maneuver(part, names, begin) for part in parts]
        return self.conditions.note(group, Span.over(begin, spans))

    def _maneuver(self, maneuver: Node, names: list[str], begin: Moment) -> Span:
        """Make moves of a <Maneuver>; return when it runs. names: of its group's entities."""
        running: list[tuple[Node, Span]] = []
        for event in maneuver.all("Event"):
            span = self._event(event, names, begin)
            for other, earlier in running:
                self._check_priority(event, span, other, earlier)
                self._check_priority(other, earlier, event, span)
            running.append((event, span))
        return self.conditions.note(maneuver, Span.over(begin, [span for _, span in running]))

    def _check_priority(self, event: Node, span: Span, other: Node, running: Span) -> None:
        """Refuse an event whose priority would end a running move of its manoeuvre, or would leave
        out the event itself.

        span: when the event runs.
        other, running: another event of the manoeuvre, and when it runs.
        """
        priority = event.text("priority")
        skips, kinds, others = priority == "skip", _kinds(event), _kinds(other)
        # supported: parallel events, and an event that overwrites a move of the same kinds
        if not (kinds and others) or (not skips and (priority == "parallel" or kinds == others)):
            return
        # Two changes of speed of which one begins by a condition may overlap: as in the standard,
        # `played` then ends the earlier one. All other pairs must not overlap.
        apart = skips or "LateralAction" in others or (span.begin.known and running.begin.known)
        # apart: `other` begins after this event begins, or ends before
        if apart and not (
            self.moves.follows(running.begin, replace(span, end=span.begin.time))
            or self.moves.follows(span.begin, running)
        ):
            raise event.fault(
                f"with its priority `{priority}` it {'is left out' if skips else 'ends'} while "
                f"event `{other.attribute('name')}` runs, which is not supported"
            )

    def _event(self, event: Node, names: list[str], begin: Moment) -> Span:
        """Make moves of an event's actions; return when it runs.

        An event counts as done at `begin`, and its own trigger is not read, if none of its actions
        has a meaning here and no condition waits for it.
        """
        event.one_of("priority", ("overwrite", "override", "parallel", "skip"))
        actions = [(action, action.only()) for action in event.all("Action")]
        idle = [self._idle(inner, names) for _, inner in actions]
        awaited = self.awaited & _names_around(event.element)
        if all(idle) and not awaited:
            return Span(begin, begin.time)
        begin = self.conditions.moment(event, begin)
        if event.number("maximumExecutionCount", 1.0) != 1.0:
            raise event.fault("an event must run once")
        parts = []
        for (action, inner), ignored in zip(actions, idle, strict=True):
            if ignored:
                span = Span(begin, begin.time)
            else:
                spans = [
                    self.moves.begin(inner.only(), self.places.entity(name, event), begin)
                    for name in names
                    if begin.time < NEVER
                ]
                span = Span.over(spans[0].begin, spans) if spans else Span(begin, NEVER)
            parts.append(self.conditions.note(action, span))
        span = self.conditions.note(event, Span.over(begin, parts))
        # an event that takes no time and begins by a condition: it ends as this condition holds
        if awaited and begin.program and span.end < NEVER and not span.ended:
            return replace(span, ended=self.conditions.latch(begin.program, begin.time))
        return span

    def _idle(self, action: Node, names: list[str]) -> bool:
        """Whether an action has no meaning here; such an action is noted. A move of the ego is
        refused.
        """
        inner = action if action.tag == "UserDefinedAction" else action.only()
        if action.tag == "PrivateAction" and inner.tag not in IGNORED:
            if self.ego.name in names:
                raise inner.fault(
                    "the ego is driven by the ADS: an action of it during the drive is not "
                    "supported"
                )
            return False
        # a deletion: see `_delete_at_once`
        if not inner.find("DeleteEntityAction"):
            self._ignore(inner)
        return True

    # -- the result --------------------------------------------------------------------------------

    def _actor(self, name: str, entity: Entity) -> Actor:
        """An entity as an actor of the concrete scenario."""
        frame, acts = entity.frame, list(entity.acts)
        spot = entity.placed()
        follows = spot.way and not entity.path and (entity.speed or acts)
        if follows and spot.road and spot.road.bent and spot.road.name != self.frame.road:
            raise entity.element.fault(
                "it must not drive along a curved road that is not the ego's"
            )
        # on the ego's road, `scenario.file.leaving` reports an actor that leaves it
        elsewhere = spot.road and spot.road.name != self.frame.road
        if elsewhere and not entity.path and self._farthest(entity) > spot.room:
            self.ignored[f"the end of the road of `{entity.name}`"] = None
        heading = 0.0 if abs(frame.heading) < 1e-6 else frame.heading
        map_pose = self.frame.pose_on_map(entity) if entity.on_map else None
        ground = 1.0 if map_pose else self.frame.ground(frame)
        acts = [_along_line(act, ground) for act in acts]
        width = self.frame.lane_width
        on_lanes = -0.5 * width <= frame.y <= width * (self.frame.lanes - 0.5)
        # off the lanes, at an angle or on the map, its script must move it instead of SUMO
        by_sumo = not map_pose and heading == 0.0 and on_lanes
        if not by_sumo and all(act.timed for act in acts):
            acts.append(keeps_on(acts))
        return Actor(
            name, Start(frame.x, frame.y, entity.speed / ground), tuple(acts), entity.length,
            entity.width, body=entity.body, heading=heading,
            on_map=(*map_pose,) if map_pose else None,
        )  # fmt: skip

    def _farthest(self, entity: Entity) -> float:
        """Distance that an entity drives at most, m; not exact where it follows another's speed."""
        speeds = [entity.speed, *(act.speed for act in entity.acts)]
        speeds += (speed for act in entity.acts for _, speed in act.table)
        return max(speeds) * self.limit

    @property
    def limit(self) -> float:
        """Time that the case lasts at most, s."""
        return self.ends if math.isfinite(self.ends) else LONGEST

    def _stop(self, story: Node) -> None:
        """Note the first stop by time, which ends the case.

        All other stops are ignored: contact, standstill or the ADS end a case here.
        """
        for group in story.all("StopTrigger/ConditionGroup"):
            conditions = group.all("Condition")
            times = group.all("Condition/ByValueCondition/SimulationTimeCondition")
            if len(conditions) != 1 or not times:
                self.ignored["StopTrigger"] = None
                continue
            stop = self.conditions.group(group).time
            if stop <= 0.0:
                got = f"{times[0].get('rule')} {times[0].number('value'):g} s"
                raise times[0].fault(f"a stop by time must come after the start, got {got}")
            self.ends = min(self.ends, stop)
