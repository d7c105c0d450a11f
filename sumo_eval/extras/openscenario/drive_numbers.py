"""Numbers that change during the drive, and the conditions on an entity that compare them.

A number is a program of `scenario.played` that leaves it on the stack.

Users: `extras/openscenario/moments.py`, `extras/openscenario/moves.py`,
`extras/openscenario/story.py`.
"""

from __future__ import annotations

import math
from functools import partialmethod
from typing import NamedTuple

from sumo_eval.extras.openscenario.frame import Frame
from sumo_eval.extras.openscenario.network import in_frame
from sumo_eval.extras.openscenario.places import Entity, Places
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.extras.openscenario.values import RULES
from sumo_eval.frozen import frozen
from sumo_eval.scenario.bodies import half_sizes
from sumo_eval.scenario.played import (
    ABSOLUTE,
    ADD,
    ALONG,
    AT_MOST,
    BELOW,
    GAP,
    LARGER,
    MULTIPLY,
    SUBTRACT,
    VALUE,
    Program,
    Step,
    X,
    Y,
    arithmetic,
)
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import length_of, tightest
from sumo_eval.text import shown

_BENT = 0.1  # m: largest error of a straight distance that is computed along and across a curve
_ACROSS = 0.1  # cosine of a heading to the road; where it is smaller, a body moves across the road


def operation(op: int) -> Step:
    """The step of a program for an operation without operands, which works on the stack alone."""
    return op, 0, 0, 0.0


@frozen
class DriveNumber:
    """A number that changes during the drive.

    program: leaves the number on the stack.
    start: the number at the start.
    """

    program: Program
    start: float

    def joined(self, op: int, other: DriveNumber) -> DriveNumber:
        """The result of an operation on both."""
        program = (*self.program, *other.program, operation(op))
        return DriveNumber(program, arithmetic(op, self.start, other.start))

    __add__ = partialmethod(joined, ADD)
    __sub__ = partialmethod(joined, SUBTRACT)
    __mul__ = partialmethod(joined, MULTIPLY)

    def __abs__(self) -> DriveNumber:
        return DriveNumber((*self.program, operation(ABSOLUTE)), abs(self.start))


Compared = tuple[DriveNumber, float]
"""A number of the drive, and the limit that it is compared with."""


def constant(value: float) -> DriveNumber:
    """A number that does not change during the drive."""
    return DriveNumber(((VALUE, 0, 0, value),), value)


def of_vehicle(op: int, number: int, start: float = 0.0) -> DriveNumber:
    """A number of a vehicle, as its place or speed.

    op: operation that gives it, such as `played.X`.
    number: of the vehicle among the actors.
    start: the number at the start.
    """
    return DriveNumber(((op, number, 0, 0.0),), start)


class Truth(NamedTuple):
    """A condition on the drive.

    holds, fails: programs that leave 1 on the stack where it holds, or where it fails; else 0.
    start: whether it holds at the start.
    """

    holds: Program
    fails: Program
    start: bool


def truth_of(element: Node, entity: Entity, places: Places, frame: Frame) -> Truth:
    """A condition on one entity; element: child of <EntityCondition>."""
    readers = {
        "RelativeDistanceCondition": EntityCondition.distance,
        "DistanceCondition": EntityCondition.distance,
        "ReachPositionCondition": EntityCondition.reach,
        "TimeHeadwayCondition": EntityCondition.headway,
        "TimeToCollisionCondition": EntityCondition.to_collision,
        "SpeedCondition": EntityCondition.speed,
        "RelativeSpeedCondition": EntityCondition.speed,
        "TraveledDistanceCondition": EntityCondition.travelled,
    }
    reader = element.chosen(readers, "conditions on an entity")
    number, limit = reader(EntityCondition(element, entity, places, frame))
    # the rule of kinds without the attribute `rule`
    default = {
        "TraveledDistanceCondition": "greaterOrEqual", "ReachPositionCondition": "lessOrEqual"
    }.get(element.tag)  # fmt: skip
    # the first four rules compare: numbers of a drive are never exactly equal
    rule = element.one_of("rule", RULES[:4], default)
    sides = (number.program, constant(limit).program)
    # the condition holds where low < high (or <=), and fails where high <= low (or <)
    low, high = sides if rule.startswith("less") else sides[::-1]
    strict, equal = operation(BELOW), operation(AT_MOST)
    holds, fails = (strict, equal) if rule.endswith("Than") else (equal, strict)
    start = element.compared(number.start, limit, default)
    return Truth((*low, *high, holds), (*high, *low, fails), start)


class EntityCondition(NamedTuple):
    """Reader of a condition on one entity. Each method without an underscore is for a kind of
    condition, and returns what its rule compares.

    element: child of <EntityCondition>.
    entity: the triggering entity.
    """

    element: Node
    entity: Entity
    places: Places
    frame: Frame

    def distance(self) -> Compared:
        """A distance to an entity or a place, m."""
        element = self.element
        default = None
        if element.tag == "DistanceCondition":  # `alongRoute` is version 1.0's word for a kind
            default = "longitudinal" if element.flag("alongRoute") else "euclidianDistance"
        kinds = ("longitudinal", "lateral", "cartesianDistance", "euclidianDistance")
        kind = element.one_of("relativeDistanceType", kinds, default)
        value, other = element.number("value"), self._target()
        if kind not in ("longitudinal", "lateral"):
            return self._straight(other, value)
        if self.entity.leaves_lane and self._system() == "entity":
            raise element.fault(
                f"a {kind} distance along the axes of `{self.entity.name}`, which leaves its lane, "
                "is not supported: the `coordinateSystem` lane or road is"
            )
        return self._apart(other, X if kind == "longitudinal" else Y), value

    def reach(self) -> Compared:
        """A distance to a place, within a tolerance."""
        tolerance = self.element.above_zero("tolerance", " m")
        return self._straight(self._target(), tolerance)

    def headway(self) -> Compared:
        """gap - value * speed, m, and 0: it has the sign of time headway minus value, without a
        division by 0.
        """
        gap = self._apart(self._target(), X)
        return gap - constant(self.element.number("value")) * self._own_speed(), 0.0

    def to_collision(self) -> Compared:
        """gap |dx| - value dx dv, m2, and 0: it has the sign of time to collision minus value.

        dx: from this body to the other along the road, m. dv: its speed minus the other's, m/s.
        The bodies close in where dx dv is above 0.
        """
        other, value = self._target(), constant(self.element.number("value"))
        speed = self._along(self.entity)
        if isinstance(other, Entity):
            speed -= self._along(other)
        ahead = self._ahead(other, X)
        return self._apart(other, X) * abs(ahead) - ahead * speed * value, 0.0

    def speed(self) -> Compared:
        """A speed, m/s, or the difference of two along the road."""
        if self.element.tag == "SpeedCondition":
            speed = self._own_speed()
        else:
            speed = self._along(self.entity) - self._along(self.places.referred(self.element))
        return speed, self.element.number("value")

    def travelled(self) -> Compared:
        """The distance that the entity has driven, m."""
        element, entity = self.element, self.entity
        if entity.on_map or abs(math.sin(entity.frame.heading)) > 1e-9:
            raise element.fault("a distance travelled across the road is not supported as a start")
        x = of_vehicle(X, vehicle_number(entity, element), entity.frame.x)
        return abs(x - constant(x.start)), element.number("value")

    def _target(self) -> Entity | Pose:
        """The target of the condition: an entity, or a fixed place in the road's frame.

        A place at an entity, without a shift, counts as the entity.
        """
        holder = self.element.find("TimeToCollisionConditionTarget") or self.element
        named = holder if holder.get("entityRef") is not None else holder.find("EntityRef")
        if named:
            return self.places.referred(named)
        position = holder.child("Position").only_child()
        if position.get("entityRef") is None:
            pose = self.places.spot(holder.child("Position")).pose
            return in_frame(pose, self.frame.origin, self.frame.line)
        shifted = any(position.number(key, 0.0) for key in ("dx", "dy"))
        if position.tag != "RelativeObjectPosition" or shifted:
            raise position.fault("a place beside an entity that moves is not supported here")
        return self.places.referred(position)

    def _straight(self, other: Entity | Pose, value: float) -> Compared:
        """The square of the distance in a straight line, m2, and the square of `value`, m2, with
        the sign of `value`.

        value: the distance that the condition states, m.
        """
        # From x and y of the frame. Along a curve of radius r a distance d is off by
        # d^3 / (24 r^2); d^3 of the largest float would overflow.
        line = self.frame.line
        if line and abs(value) > math.cbrt(24.0 * tightest(line) ** 2 * _BENT):
            raise self.element.fault("a distance across a curve of the road is not supported")
        x, y = (self._apart(other, axis) for axis in (X, Y))
        if self.element.flag("freespace"):
            x, y = (it.joined(LARGER, constant(0.0)) for it in (x, y))
        return x * x + y * y, value * abs(value)

    def _apart(self, other: Entity | Pose, axis: int) -> DriveNumber:
        """Distance of two bodies, or of their reference points, along one axis, m."""
        apart, free = abs(self._ahead(other, axis)), self.element.flag("freespace")
        bodies = constant(_half(self.entity, axis) + _half(other, axis))
        if free and axis == X and isinstance(other, Entity):
            # GAP uses the bodies' present headings. It assumes that its first body is behind: the
            # larger of both orders has the right one.
            a, b = (vehicle_number(it, self.element) for it in (self.entity, other))
            gaps = (GAP, a, b, 0.0), (GAP, b, a, 0.0), operation(LARGER)
            apart = DriveNumber(gaps, apart.start - bodies.start)
            free = False  # GAP is between the bodies already
        scale = self._scale() if axis == X else 1.0
        if scale != 1.0:
            apart *= constant(scale)
        return apart - bodies if free else apart

    def _scale(self) -> float:
        """Metres that the condition measures for each metre along the frame's line.

        In the systems `entity` and `lane` the condition measures along the parallel of that line
        through the entity's start, in the system `road` along the file's reference line. In a
        curve, a metre of the line is 1 - curvature * left metres on the parallel `left` m to its
        left. The mean curvature of the whole line counts.
        """
        frame, system = self.frame, self._system()
        if not frame.line:
            return 1.0
        # angle from the first heading to the last, rad: mean curvature of each piece by its length
        turned = sum(0.5 * (it.begin + it.end) * it.length for it in frame.line)
        # m to the left of the frame's line: the file's reference line, or the entity's start
        left = -frame.way * frame.offset if system == "road" else self.entity.frame.y
        curvature = turned / length_of(frame.line)  # mean, 1/m
        return 1.0 - curvature * left

    def _system(self) -> str:
        """The coordinate system in which the condition measures."""
        default = "lane" if self.element.flag("alongRoute") else "entity"
        return self.element.one_of("coordinateSystem", ("entity", "lane", "road"), default)

    def _ahead(self, other: Entity | Pose, axis: int) -> DriveNumber:
        """Distance from the entity's body to another, or between their reference points, m; it is
        above 0 where the other is ahead (X) or to the left (Y).
        """
        return self._coordinate(other, axis) - self._coordinate(self.entity, axis)

    def _coordinate(self, body: Entity | Pose, axis: int) -> DriveNumber:
        """x or y of a place, of a body's centre with `freespace`, or else of its reference point.

        axis: `played.X` or `played.Y`.
        """
        k = axis - X  # index in a pose: 0 for x, 1 for y
        if isinstance(body, Pose):
            return constant(body[k])
        centre = of_vehicle(axis, vehicle_number(body, self.element), body.frame[k])
        # from the centre to the reference point with the heading at the start
        shift = body.frame.moved(-body.centre, -body.offset)[k] - centre.start
        if shift == 0.0 or self.element.flag("freespace"):
            return centre
        return centre + constant(shift)

    def _own_speed(self) -> DriveNumber:
        """The entity's speed in the direction in which it points, m/s."""
        along, share = self._along(self.entity), math.cos(self.entity.frame.heading)
        if abs(share) < _ACROSS:
            raise self.element.fault(
                "the speed of an entity that crosses the road is not supported"
            )
        return along if math.isclose(share, 1.0) else along * constant(1.0 / share)

    def _along(self, body: Entity) -> DriveNumber:
        """The speed of a body along the road, m/s."""
        of_speed = self.element.tag.endswith("SpeedCondition")
        name = "direction" if of_speed else "relativeDistanceType"
        got = self.element.text(name, "longitudinal")
        if got != "longitudinal":
            raise self.element.fault(
                f"`{name}` must be longitudinal to be supported, got {shown(got)}"
            )
        at_start = body.speed * math.cos(body.frame.heading)
        return of_vehicle(ALONG, vehicle_number(body, self.element), at_start)


def _half(body: Entity | Pose, axis: int) -> float:
    """Half the extent of a body along an axis of the road at the start, m; 0 for a place."""
    if isinstance(body, Pose):
        return 0.0
    return half_sizes(body.frame.heading, body.length, body.width)[axis - X]


def vehicle_number(entity: Entity, element: Node) -> int:
    """Number of an entity in programs.

    Raises InputError if it takes no part: it has the number of the ego then.
    """
    if entity.deleted:
        raise element.fault(
            f"entity `{entity.name}` is deleted at the start, so nothing depends on it"
        )
    return entity.number
