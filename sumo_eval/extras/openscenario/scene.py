"""A scenario file of OpenSCENARIO at one point of its space: the road, the ego's start, the actors.

`logical` reads every point by `read_case`.

Interpretations, where the standard leaves a choice or this package supports less:

- The ego belongs to the ADS from the start: its controllers are ignored, an action that would move
  it during the drive is refused, its start is read.
- At the end of a trajectory an actor keeps straight on at its speed.

Users: `extras/openscenario/logical.py`, `extras/openscenario/space.py`,
`extras/openscenario/written.py`.
"""

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from sumo_eval.cosim.openscenario import CASE, exported_case
from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.acts import FileTraffic
from sumo_eval.extras.openscenario.catalogs import Catalogs, named_file
from sumo_eval.extras.openscenario.frame import ORIGIN, Frame, frame_of, framed
from sumo_eval.extras.openscenario.moments import Conditions, Moment
from sumo_eval.extras.openscenario.moves import begin_action, place_apart
from sumo_eval.extras.openscenario.network import read_network
from sumo_eval.extras.openscenario.places import Entity, Places, entity_of
from sumo_eval.extras.openscenario.reading import Node, read_openscenario
from sumo_eval.extras.openscenario.starts import Starts
from sumo_eval.extras.openscenario.story import Story, awaited_names, delete_at_once
from sumo_eval.extras.openscenario.values import Value
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, EgoBody, Start, keeps_on
from sumo_eval.scenario.first_places import STANDARD_EGO
from sumo_eval.scenario.played import BY_TIME, SPEED, Act

EGO, EXPORTED_EGO = "Ego", "ego"
CONTROLLER_ACTIONS = "ControllerAction", "ActivateControllerAction"
LONGEST = 60.0  # s that a case lasts where no stop of the file is by time


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
    elements: <ScenarioObject> of the ego, as `ego`, and of each actor by its name; empty for a file
        that `sumo-eval export` wrote.
    exported: the case that `sumo-eval export` wrote into the file; None in other files.
    """

    frame: Frame
    ego: Start
    ego_body: EgoBody
    actors: tuple[Actor, ...]
    ends: float
    ignored: tuple[str, ...]
    elements: Mapping[str, Node]
    exported: ConcreteScenario | None = None


def read_case(path: Path, given: Mapping[str, Value], options: FileOptions) -> FileCase:
    """The case of a scenario file with given values of its parameters.

    given: parameter -> value; other parameters have the value that the file declares.

    The file's constraints are not checked here: `logical` checks them where they must hold.

    Raises InputError with file, line and element.
    """
    root = read_openscenario(path)
    if root.find(f"FileHeader/Properties/Property[@name='{CASE}']"):
        return _exported(root, options)
    return _scene(root, given, options)


def _exported(root: Node, options: FileOptions) -> FileCase:
    """The case that `sumo-eval export` wrote into the file, with the road of that run."""
    road_file = _map_of(root, options.map)
    try:
        exported = exported_case(root.element, road_file.read_bytes())
    except InputError as error:
        raise root.child("FileHeader").fault(str(error)) from None
    if options.ego not in (None, EXPORTED_EGO):
        raise root.child("Entities").fault(
            f"`?ego=` of an exported case must be `{EXPORTED_EGO}`, got `{options.ego}`; without "
            "the <Properties> of its <FileHeader> it is read as any other file"
        )
    road, body = exported.road, exported.ego_body or STANDARD_EGO
    frame = Frame(ORIGIN, road.line, road.lanes, road.lane_width, road.end, road.name, 0.0, "")
    ends = LONGEST if exported.time_limit is None else exported.time_limit
    return FileCase(frame, exported.ego, body, exported.actors, ends, (), {}, exported)


def _scene(root: Node, given: Mapping[str, Value], options: FileOptions) -> FileCase:
    """The case of a storyboard. Each of the five steps needs the results of the earlier ones."""
    if not root.find("Storyboard"):
        got = ", ".join(f"<{it.tag}>" for it in root.children())
        raise root.fault(f"it must hold a <Storyboard>, got {got}")
    root, _ = root.declared(given)
    story = root.child("Storyboard")
    places = _entities_of(root, options.map)
    entities = places.entities
    ego = _ego_of(root, entities, options.ego)
    # 1. starts: places and speeds on the map
    starts = Starts(places, ego)
    starts.read(story.child("Init").child("Actions"))
    # deleted in <Init>; step 3 marks those that the story deletes at 0 s
    for name, entity in list(entities.items()):
        if not entity.spot and entity.deleted and entity is not ego:
            del entities[name]
    # 2. the road, and all entities in its frame
    for entity in entities.values():
        road = entity.placed().road
        of_road = road.left_out if road else ()
        places.ignored |= dict.fromkeys((*of_road, *entity.left_out))
    frame = frame_of(ego, places.network, starts.turning, starts.route_end)
    for entity in entities.values():
        entity.on_map = entity is not ego and _on_map(entity, frame)
        entity.frame = framed(entity, frame)  # its pose in the road's frame
    actors = list[Entity]()  # `traffic` and `conditions` share this list, which step 3 fills
    traffic, conditions = FileTraffic(places, frame, ego, actors), Conditions(places, frame, actors)
    # A distance with limits is reached during the drive. One without is there at the start, which
    # the conditions of step 3 need; step 4 reads both kinds as moves.
    for distance, entity in starts.distances:
        if not distance.find("DynamicConstraints"):
            place_apart(traffic, distance, entity)
    # 3. the actors by number: all but the ego and those that are deleted at the start
    delete_at_once(story, conditions)
    starts.check_ego()
    actors += [it for it in entities.values() if it is not ego and not it.deleted]
    for number, entity in enumerate(actors):
        entity.number = number
    # 4. the story: stops, moves from the start on, acts in the order of the file
    awaited = awaited_names(root) if actors else set()  # without an actor there are no moves
    limit = _time_limit(story, conditions)
    for element, entity in starts.begun + starts.distances:
        begin_action(traffic, element, entity, Moment(0.0))
    reader = Story(traffic, conditions, awaited, limit)
    for part in story.all("Story"):
        reader.read_story(part)
    # 5. names that SUMO accepts; `ego` is that of the ADS
    names = distinct((re.sub(r"[^\w.-]", "_", it.name) for it in actors), "ego")
    named = dict(zip(names, actors, strict=True))
    return FileCase(
        frame,
        Start(ego.frame.x, ego.frame.y, ego.speed),
        EgoBody(ego.length, ego.width),
        tuple(_actor(name, it, frame, limit, places.ignored) for name, it in named.items()),
        limit,
        tuple(places.ignored),
        {name: it.element for name, it in {"ego": ego, **named}.items()},
    )


def _entities_of(root: Node, map_file: str | None) -> Places:
    """The entities of a file, still without places, and the reader of their places.

    map_file: as `FileOptions.map`.
    """
    catalogs = Catalogs(root)
    network = read_network(_map_of(root, map_file))
    entities: dict[str, Entity] = {}
    for part in root.child("Entities").all("ScenarioObject"):
        entity = entity_of(part, catalogs)
        if entities.setdefault(entity.name, entity) is not entity:
            raise part.fault(f"there is another entity with the name `{entity.name}`")
    # scenario_runner reads these files with CARLA's axes, in which y points to the right
    about = str(root.child("FileHeader").get("description"))
    side = -1.0 if about.startswith("CARLA:") else 1.0
    ignored = dict.fromkeys(it.tag for it in root.all("RoadNetwork/TrafficSignals/*"))
    return Places(network, catalogs, entities, side, ignored)


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


def _ego_of(root: Node, entities: Mapping[str, Entity], name: str | None) -> Entity:
    """The entity that the ADS drives.

    name: by the user. None: it is the only one called `Ego` (in any case of letters), else the only
        one with a controller, else the only one. Of several called so, it is `Ego` itself.

    Raises InputError where this names no entity.
    """
    if name is None:
        egos = [it for it in entities if it.lower() == EGO.lower()]
        controlled = {
            it for it, entity in entities.items() if entity.element.find("ObjectController/*")
        }
        for part in root.all("Storyboard/Init/Actions/Private"):
            if any(part.find(f"PrivateAction/{tag}") for tag in CONTROLLER_ACTIONS):
                controlled |= {part.text("entityRef")} & entities.keys()
        candidates = egos or controlled or [*entities]
        name = candidates.pop() if len(candidates) == 1 else EGO
    if name not in entities:
        raise root.child("Entities").fault(
            "the entity that the ADS drives must be named `Ego`, or be the only one with a "
            "controller; `?ego=NAME` behind the file's name names it, one of "
            f"{', '.join(entities) or 'none'}"
        )
    return entities[name]


def _on_map(actor: Entity, frame: Frame) -> bool:
    """Whether an actor's path is straight on the map, instead of along the ego's road.

    It is for every actor of an ego that turns, and off the ego's road where that road is curved.
    """
    road = actor.placed().road
    elsewhere = not road or road.name != frame.road
    return frame.turns or (elsewhere and bool(frame.line))  # a line: the road is curved


def _time_limit(story: Node, conditions: Conditions) -> float:
    """Time that the case lasts at most, s: the first stop by time ends it.

    All other stops are ignored: contact, standstill or the ADS end a case here.
    """
    ends = math.inf
    for group in story.all("StopTrigger/ConditionGroup"):
        by_time = group.all("Condition/ByValueCondition/SimulationTimeCondition")
        if len(group.all("Condition")) > len(by_time) or not by_time:
            conditions.places.ignored["StopTrigger"] = None
            continue
        stop = conditions.group(group).time
        if stop <= 0.0:
            got = f"{by_time[0].get('rule')} {by_time[0].number('value'):g} s"
            raise by_time[0].fault(f"a stop by time must come after the start, got {got}")
        ends = min(ends, stop)
    return ends if math.isfinite(ends) else LONGEST


def distinct(names: Iterable[str], *taken: str) -> list[str]:
    """The names, each with `_` appended until it differs from earlier and taken names."""
    names_so_far = [*taken]
    for name in names:
        while name in names_so_far:
            name += "_"
        names_so_far.append(name)
    return names_so_far[len(taken) :]


def _actor(
    name: str, entity: Entity, frame: Frame, limit: float, ignored: dict[str, None]
) -> Actor:
    """An entity as an actor of the concrete scenario.

    limit: time that the case lasts at most, s.
    ignored: as in `Places`.
    """
    pose, spot = entity.frame, entity.placed()
    road = spot.road
    other = road if road and road.name != frame.road else None  # its road, if not the ego's
    moves_along = spot.way != 0 and not entity.path and (entity.speed > 0.0 or bool(entity.acts))
    if other and other.bent and moves_along:
        raise entity.element.fault("it must not drive along a curved road that is not the ego's")
    # on the ego's road, `scenario.file.leaving` reports an actor that leaves it
    if other and not entity.path and _fastest(entity) * limit > spot.room:
        ignored[f"the end of the road of `{entity.name}`"] = None
    heading = 0.0 if abs(pose.heading) < 1e-6 else pose.heading
    map_pose = frame.pose_on_map(entity) if entity.on_map else None
    # metres over the ground for each metre along the line; on the map there is no line
    ground = 1.0 if map_pose else frame.ground(pose)
    acts = [_along_line(act, ground) for act in entity.acts]
    width = frame.lane_width
    on_lanes = -0.5 * width <= pose.y <= width * (frame.lanes - 0.5)
    # Off the lanes, at an angle or on the map, its script must move it instead of SUMO. An act that
    # is not timed makes it so already (`Actor.lively`).
    by_sumo = not map_pose and heading == 0.0 and on_lanes
    if not by_sumo and all(act.timed for act in acts):
        acts.append(keeps_on(acts))
    return Actor(
        name, Start(pose.x, pose.y, entity.speed / ground), tuple(acts), entity.length,
        entity.width, body=entity.body, heading=heading,
        on_map=(*map_pose,) if map_pose else None,
    )  # fmt: skip


def _along_line(act: Act, ground: float) -> Act:
    """A move with its speeds along the road's line instead of over the ground.

    ground: metres that the actor drives over the ground for each metre along that line.
    """
    if act.kind == SPEED:
        return act._replace(speed=act.speed / ground, acceleration=act.acceleration / ground)
    if act.kind == BY_TIME:
        return act._replace(table=tuple((time, speed / ground) for time, speed in act.table))
    return act


def _fastest(entity: Entity) -> float:
    """Highest speed of an entity, m/s; not exact where it follows another's speed."""
    speeds = [entity.speed, *(act.speed for act in entity.acts)]
    speeds += (speed for act in entity.acts for _, speed in act.table)
    return max(speeds)
