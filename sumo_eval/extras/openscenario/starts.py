"""Starts in a scenario file: the actions of <Init>, carried out on the map.

Users: `extras/openscenario/scene.py`.
"""

from dataclasses import dataclass, field

from sumo_eval.extras.openscenario.moves import is_step, target_speed
from sumo_eval.extras.openscenario.places import (
    ALONG,
    EGO_ALONG,
    Entity,
    MapPath,
    Places,
    Spot,
    UnplacedError,
)
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.scenario.road.pose import Pose

Actions = list[tuple[Node, Entity]]
"""Actions of Init, each with its entity."""


@dataclass(slots=True)
class Starts:
    """Places and speeds at the start, and the actions of <Init> that need the road.

    `read` gives the entities their places and speeds, and fills the fields below `ego`.

    ego: the entity that the ADS drives.
    distances: LongitudinalDistanceActions; they place an entity once the road is known.
    begun: actions that are moves from 0 s on.
    route_end: end of the ego's route or trajectory; None: it has neither.
    turning: the ego's trajectory if it turns; None: it does not.
    """

    places: Places
    ego: Entity
    distances: Actions = field(default_factory=list)
    begun: Actions = field(default_factory=list)
    route_end: Pose | None = None
    turning: MapPath | None = None

    def read(self, actions: Node) -> None:
        """Carry out the actions of <Init>: places, speeds and moves at the start."""
        waiting = []
        for part in actions.children():
            inner = part.only_child() if part.tag == "GlobalAction" else part
            if part.tag == "Private":
                entity = self.places.referred(part)
                waiting += [(action.only_child(), entity) for action in part.all("PrivateAction")]
            elif inner.tag == "EntityAction":
                entity, action = self.places.referred(inner), inner.only_child()
                entity.deleted = action.tag == "DeleteEntityAction"
                if not entity.deleted:
                    waiting.append((action, entity))
            else:
                self.places.ignore(inner)
        self.check_ego()
        for element, entity in waiting:
            entity.waits += element.find("SpeedAction") is not None
        while waiting:
            waiting = self._do_possible(waiting)

    def check_ego(self) -> None:
        """Refuse a file that deletes the ego at the start."""
        if self.ego.deleted:
            raise self.ego.element.fault("it must not be deleted: the ADS drives it")

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
            element = element.only_child()
        match element.tag:
            case "TeleportAction" | "AddEntityAction":
                along = EGO_ALONG if entity is self.ego else ALONG
                spot = self.places.spot(element.child("Position"))
                entity.spot = self.places.located(spot, along)
            case "SpeedAction":
                self._speed_at_start(element, entity)
            case "LongitudinalDistanceAction":
                lasts = element.flag("continuous") or element.find("DynamicConstraints")
                if lasts and entity is self.ego:
                    raise element.fault("the ego is driven by the ADS: it keeps no distance")
                self.distances.append((element, entity))
            case "AssignRouteAction":
                _, end = self.places.route(element)
                if entity is self.ego:
                    self.route_end = end.pose
            case "FollowTrajectoryAction":
                self._follow_from_start(element, entity)
            case _:
                self.places.ignore(element)

    def _speed_at_start(self, element: Node, entity: Entity) -> None:
        """Set a speed at the start.

        A gradual change, or a speed that is kept relative to another's, is a move from 0 s on.
        """
        speed = target_speed(element, self.places, entity)
        entity.waits -= 1
        if is_step(element.child("SpeedActionDynamics")):
            entity.speed = entity.pace = speed
            if not element.child("SpeedActionTarget").only_child().flag("continuous"):
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
