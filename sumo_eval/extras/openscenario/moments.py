"""Moments at which storyboard elements begin: a time, or a condition on what happens.

A trigger that is known before the drive is a time. A condition on the drive becomes a program of
`scenario.played`, as a `when` of a scenario file does: a list of operations on a stack of values.
`scene` reads moments with `Conditions`, and `moves` plans moves with them.

Users: `extras/openscenario/moves.py`, `extras/openscenario/scene.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partialmethod
from typing import Any, NamedTuple

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
    AND,
    AT_MOST,
    BELOW,
    COSINE,
    ENDED,
    GAP,
    LARGER,
    MULTIPLY,
    OR,
    SUBTRACT,
    TIME,
    VALUE,
    Act,
    Move,
    Program,
    Step,
    X,
    Y,
    arithmetic,
)
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import length_of, tightest
from sumo_eval.text import shown

Past = float | Move
"""A time that has passed, s, or a move that has ended."""
NEVER = math.inf
AT_ONCE = 1e-6  # s: duration of a change that is a step
_BENT = 0.1  # m: largest error of a straight distance that is computed along and across a curve
_ACROSS = 0.1  # cosine of a heading to the road; where it is smaller, a body moves across the road


def operation(op: int) -> Step:
    """The step of a program for an operation without operands, which works on the stack alone."""
    return op, 0, 0, 0.0


def from_time(time: float) -> Program:
    """The program of a condition that holds from a time on, s."""
    return (VALUE, 0, 0, time), operation(TIME), operation(AT_MOST)


def implied(program: Program) -> set[Past]:
    """Times and moves that are certainly past whenever a condition holds.

    The function runs the program with a set instead of each value on the stack. AND unites two
    sets, OR keeps what both have. Of the operations that programs here use, those up to `ENDED` put
    a value on the stack. Later ones join two values, except `ABSOLUTE`.
    """
    stack: list[set[Past]] = [set()]  # what an empty program implies: nothing
    for k, (op, one, two, _) in enumerate(program):
        if op == ENDED:
            stack.append({(one, two)})
        elif op < ENDED:
            # TIME implies that the time of the step before it has passed (`from_time`)
            stack.append({program[k - 1][3]} if op == TIME else set())
        elif op != ABSOLUTE:
            last = stack.pop()
            # BELOW implies nothing: it compares numbers, or "has ended" with 0.5 to negate it
            if op in (OR, BELOW):
                stack[-1] &= last
            else:
                stack[-1] |= last
    return stack[-1]


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


@frozen
class Moment:
    """A time, or a condition on the drive.

    time: s, inf for never. With a program: the delay after its condition holds, s.
    program: of the condition; empty: the moment is a time.
    until: time from which on nothing begins any more, s; inf: no such time.
    past: whether it is enough that the condition held before, as for the start of an element.
        Otherwise it must still hold when all conditions joined with it hold.
    """

    time: float
    program: Program = ()
    until: float = NEVER
    past: bool = False

    @property
    def known(self) -> bool:
        """Whether the moment is a time."""
        return not self.program


@dataclass(slots=True)
class Span:
    """Begin and end of an element of the storyboard.

    end: s; inf: the end has no known time.
    ended: the condition that the element has ended, where `end` is inf; empty: it never ends.
    """

    begin: Moment
    end: float
    ended: Program = ()

    @classmethod
    def over(cls, begin: Moment, parts: Sequence[Span]) -> Span:
        """The span of an element that ends with the last of its parts; without parts at once."""
        end = max((it.end for it in parts), default=begin.time)
        unending = any(it.end == NEVER and not it.ended for it in parts)
        if unending or not any(it.ended for it in parts):
            return cls(begin, end)  # with `unending`, `end` is NEVER
        return cls(begin, end, _joined([it.ended or from_time(it.end) for it in parts], AND))


@dataclass(slots=True)
class Conditions:
    """Reads the conditions of a file as moments.

    actors: in the order of their numbers; empty until the numbers are known.
    spans: of the elements read so far, for conditions on elements. Each is a tuple: tag in small
        letters; its name after those of the elements around it, joined by `::`; its span.
    """

    places: Places
    frame: Frame
    actors: list[Entity]
    spans: list[tuple[str, str, Span]] = field(default_factory=list)

    def latch(self, program: Program, delay: float) -> Program:
        """The condition that `program` held `delay` s ago or earlier, even if it fails again.

        Programs remember nothing. So the first actor gets a move that changes nothing and begins
        `delay` s after `program` holds. The result is the condition that this move has ended.
        """
        if not self.actors:  # before their numbers are known, no move can wait for the condition
            return program
        actor = self.actors[0]
        actor.acts.append(Act(COSINE, delay, AT_ONCE, program=program))
        return actor.ended()

    def note(self, element: Node, span: Span) -> Span:
        """Note when an element of the storyboard runs, for conditions further down in the file."""
        above: Any = element.element.xpath("ancestor::*/@name[. != '']")
        path = "::".join((*above, element.attribute("name")))
        self.spans.append((element.tag.lower(), path, span))
        return span

    def _span(self, element: Node) -> Span:
        """The span of the storyboard element that a condition names; it must stand above it.

        A path such as `act::event` tells elements of one kind and name apart.
        """
        kind = element.text("storyboardElementType")
        name = element.attribute("storyboardElementRef")
        spans = [
            span
            for tag, path, span in self.spans
            if tag == kind.lower() and f"::{path}".endswith(f"::{name}")
        ]
        if not spans:
            raise element.fault(f"no {kind} `{name}` stands above it")
        if len(spans) > 1:
            wanted = f"a path such as `story::act::{name}` must say which"
            raise element.fault(f"{len(spans)} elements are called {kind} `{name}`: {wanted}")
        return spans[0]

    def moment(self, element: Node, after: Moment, kind: str = "StartTrigger") -> Moment:
        """The moment of an element's trigger, not before `after`.

        One of the trigger's groups of conditions must hold. Without groups the moment is `after`.

        kind: `StartTrigger` or `StopTrigger`.
        """
        trigger = element.find(f"{kind}[ConditionGroup]")
        if not trigger:
            return after
        groups = map(self.group, trigger.all("ConditionGroup"))
        live = [group for group in groups if group.time < NEVER]
        if not live:
            return Moment(NEVER)
        # 1. All groups are times: the earliest counts, and of equal ones the one with the latest
        # `until`. Where `after` is a condition, it is joined with this one below.
        if all(group.known for group in live):
            if after.known:
                return Moment(min(self._later(after, group, trigger).time for group in live))
            begin = min(live, key=lambda group: (group.time, -group.until))
        # 2. several, of which some are times or have a delay
        elif len(live) > 1 and any(group.known or group.time > 0.0 for group in live):
            raise trigger.fault(
                "groups of conditions of which some depend on the drive and some are times, or "
                "have a delay, are not supported together"
            )
        # 3. one condition on the drive, or several without a delay: one of them must hold
        else:
            program = _joined([group.program for group in live], OR)
            begin = replace(live[0], program=program, past=all(group.past for group in live))
        return replace(self._later(after, begin, trigger), past=True)

    def _later(self, one: Moment, two: Moment, element: Node) -> Moment:
        """The later of two moments: when both conditions hold, or both times have passed.

        element: that a fault names.
        """
        time, until = max(one.time, two.time), min(one.until, two.until)
        if one.known and two.known:
            return Moment(time, until=until) if time < until else Moment(NEVER)
        if time == NEVER:
            return Moment(NEVER)
        if until < NEVER:
            raise element.fault(
                "a condition on the drive is not supported together with a time until which it "
                "may hold"
            )
        if one.known and one.time <= 0.0:
            return two
        if two.known and two.time <= 0.0:
            return one
        if any(it.program and it.time > 0.0 and not it.past for it in (one, two)):
            raise element.fault(
                "a delay after a condition on the drive is not supported together with a time or "
                "another such condition"
            )
        # Conditions first, then times as conditions. A condition is latched where it is enough that
        # it held before.
        programs = [
            self.latch(it.program, it.time)
            if it.past and it.program
            else it.program or from_time(it.time)
            for it in sorted((one, two), key=lambda it: it.known)
        ]
        return Moment(0.0, _joined(programs, AND))

    def group(self, group: Node) -> Moment:
        """When all conditions of a group hold."""
        moment = Moment(0.0)
        for condition in group.all("Condition"):
            moment = self._later(moment, self._condition(condition), condition)
        return moment

    def _condition(self, element: Node) -> Moment:
        """The moment of one <Condition>."""
        edge = element.one_of("conditionEdge", ("none", "rising", "falling", "risingOrFalling"))
        delay = element.not_negative("delay", 0.0, " s")
        kind = element.only()
        if kind.tag == "ByValueCondition":
            moment = self._by_value(kind.only(), edge)
        elif kind.tag == "ByEntityCondition":
            moment = Moment(0.0, self._by_entity(kind, edge))
        else:
            raise kind.unsupported()
        return replace(moment, time=moment.time + delay, until=moment.until + delay)

    def _by_time(self, element: Node, edge: str) -> Moment:
        """The moment of a <SimulationTimeCondition>.

        The time only grows: `less` holds until a time, all other rules from a time on.
        """
        rule, value = element.one_of("rule", RULES), element.number("value")
        less = rule.startswith("less")
        if edge == ("rising" if less else "falling"):
            raise element.fault(
                f"the time grows, so `{rule}` never has the edge `{edge}`: use `none`"
            )
        if less and not element.compared(0.0, value):
            return Moment(NEVER)
        if less:
            return Moment(0.0, until=value) if edge == "none" else Moment(value)
        if rule == "equalTo" and value < 0.0:
            return Moment(NEVER)
        # `notEqualTo` holds from the start; with an edge it counts from `value` on
        at_start = rule == "notEqualTo" and edge == "none"
        return Moment(0.0 if at_start else max(value, 0.0))

    def _by_value(self, element: Node, edge: str) -> Moment:
        """The moment of a condition on a value; element: child of <ByValueCondition>."""
        if element.tag == "SimulationTimeCondition":
            return self._by_time(element, edge)
        if edge == "falling":
            raise element.fault("the edge `falling` is not supported of it")
        if element.tag == "ParameterCondition":
            name = element.parameter("parameterRef")
            if element.element.xpath("//ParameterAction[@parameterRef=$name]", name=name):
                raise element.fault(
                    f"parameter `{name}` is set during the drive, and is read before it here"
                )
            wanted = element.worked_out(element.attribute("value"))
            present = element.worked_out(f"${name}")
            return Moment(0.0 if element.compared(present, wanted) else NEVER)
        if element.tag == "StoryboardElementStateCondition":
            return self._state(element)
        raise element.unsupported(
            "a start that depends on a variable or on the world outside is unknown here"
        )

    def _state(self, element: Node) -> Moment:
        """The moment of a <StoryboardElementStateCondition>."""
        span = self._span(element)
        begin = span.begin
        state = element.text("state")
        if state in ("startTransition", "runningState"):
            # it holds until the element's end where both are times, else from the begin on
            has_end = begin.known and span.end > begin.time
            return replace(begin, until=span.end) if has_end else begin
        if state not in ("completeState", "endTransition"):
            raise element.fault(f"the state `{state}` is not supported")
        if span.ended:
            return Moment(0.0, span.ended, past=True)  # what has ended does not run again
        # an element that takes no time ends as it begins, which may be by a condition
        at_once = not begin.known and span.end < NEVER
        return begin if at_once else Moment(span.end)

    def _by_entity(self, element: Node, edge: str) -> Program:
        """The program of a condition on entities.

        edge: `none`: the condition holds. `rising`: it holds after it was false. `falling`: it is
            false after it was true. `risingOrFalling`: whichever of these two comes first.
        """
        triggering = element.child("TriggeringEntities")
        every = triggering.one_of("triggeringEntitiesRule", ("any", "all")) == "all"
        entities = [self.places.referred(it) for it in triggering.all("EntityRef")]
        if not entities:
            raise triggering.fault("it must name an entity")
        condition = element.child("EntityCondition").only()
        truths = [self._of_entity(condition, it) for it in entities]
        # if all must hold, it fails as soon as one does; if any may hold, it fails when all do
        op, opposite = (AND, OR) if every else (OR, AND)
        holds = _joined([it.holds for it in truths], op)
        fails = _joined([it.fails for it in truths], opposite)
        start = (all if every else any)(it.start for it in truths)
        if edge == "falling" or (edge == "risingOrFalling" and start):
            holds, fails, start = fails, holds, not start
        if edge == "none" or not start:
            return holds
        # it holds at the start, so the edge comes only after it has failed once
        return (*holds, *self.latch(fails, 0.0), operation(AND))

    def _number(self, entity: Entity, element: Node) -> int:
        """Number of an entity in programs; an InputError if it takes no part."""
        if entity.deleted:
            raise element.fault(
                f"entity `{entity.name}` is deleted at the start, so nothing depends on it"
            )
        return entity.number

    def _of_entity(self, element: Node, entity: Entity) -> Truth:
        """A condition on one entity; element: child of <EntityCondition>."""
        readers = {
            "RelativeDistanceCondition": self._distance, "DistanceCondition": self._distance,
            "ReachPositionCondition": self._reach, "TimeHeadwayCondition": self._headway,
            "TimeToCollisionCondition": self._to_collision, "SpeedCondition": self._speed,
            "RelativeSpeedCondition": self._speed,
            "TraveledDistanceCondition": self._travelled,
        }  # fmt: skip
        number, limit = element.chosen(readers, "conditions on an entity")(element, entity)
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

    # -- distances ---------------------------------------------------------------------------------

    def _target(self, element: Node) -> Entity | Pose:
        """The target of a condition: an entity, or a fixed place in the road's frame.

        A place at an entity, without a shift, counts as the entity.
        """
        holder = element.find("TimeToCollisionConditionTarget") or element
        named = holder if holder.get("entityRef") is not None else holder.find("EntityRef")
        if named:
            return self.places.referred(named)
        position = holder.child("Position").only()
        if position.get("entityRef") is None:
            pose = self.places.spot(holder.child("Position")).pose
            return in_frame(pose, self.frame.origin, self.frame.line)
        shifted = any(position.number(key, 0.0) for key in ("dx", "dy"))
        if position.tag != "RelativeObjectPosition" or shifted:
            raise position.fault("a place beside an entity that moves is not supported here")
        return self.places.referred(position)

    def _coordinate(self, body: Entity | Pose, axis: int, element: Node) -> DriveNumber:
        """x or y of a place, of a body's centre with `freespace`, or else of its reference point.

        axis: `played.X` or `played.Y`.
        """
        k = axis - X  # index in a pose: 0 for x, 1 for y
        if isinstance(body, Pose):
            return constant(body[k])
        centre = of_vehicle(axis, self._number(body, element), body.frame[k])
        # from the centre to the reference point with the heading at the start
        shift = body.frame.moved(-body.centre, -body.offset)[k] - centre.start
        if shift == 0.0 or element.flag("freespace"):
            return centre
        return centre + constant(shift)

    def _ahead(self, element: Node, one: Entity, other: Entity | Pose, axis: int) -> DriveNumber:
        """Distance from one body to another, or between their reference points, m; it is above 0
        where the other is ahead (X) or to the left (Y).
        """
        return self._coordinate(other, axis, element) - self._coordinate(one, axis, element)

    def _apart(self, element: Node, one: Entity, other: Entity | Pose, axis: int) -> DriveNumber:
        """Distance of two bodies, or of their reference points, along one axis, m."""
        apart, free = abs(self._ahead(element, one, other, axis)), element.flag("freespace")
        bodies = constant(_half(one, axis) + _half(other, axis))
        if free and axis == X and isinstance(other, Entity):
            # GAP uses the bodies' present headings. It assumes that its first body is behind: the
            # larger of both orders has the right one.
            a, b = self._number(one, element), self._number(other, element)
            gaps = (GAP, a, b, 0.0), (GAP, b, a, 0.0), operation(LARGER)
            apart = DriveNumber(gaps, apart.start - bodies.start)
            free = False  # GAP is between the bodies already
        scale = self._scale(element, one) if axis == X else 1.0
        if scale != 1.0:
            apart *= constant(scale)
        return apart - bodies if free else apart

    def _scale(self, element: Node, entity: Entity) -> float:
        """Metres that a condition measures for each metre along the frame's line.

        In the systems `entity` and `lane` the condition measures along the parallel of that line
        through the entity's start, in the system `road` along the file's reference line. In a
        curve, a metre of the line is 1 - curvature * left metres on the parallel `left` m to its
        left. The mean curvature of the whole line counts.
        """
        default = "lane" if element.flag("alongRoute") else "entity"
        system = element.one_of("coordinateSystem", ("entity", "lane", "road"), default)
        frame = self.frame
        if not frame.line:
            return 1.0
        # angle from the first heading to the last, rad: mean curvature of each piece by its length
        turned = sum(0.5 * (it.begin + it.end) * it.length for it in frame.line)
        # m to the left of the frame's line: the file's reference line, or the entity's start
        left = -frame.way * frame.offset if system == "road" else entity.frame.y
        curvature = turned / length_of(frame.line)  # mean, 1/m
        return 1.0 - curvature * left

    # Each function for a kind of condition takes its element and the triggering entity, and returns
    # the two numbers that the rule compares.

    def _distance(self, element: Node, entity: Entity) -> Compared:
        default = "euclidianDistance" if element.tag == "DistanceCondition" else None
        kinds = ("longitudinal", "lateral", "cartesianDistance", "euclidianDistance")
        kind = element.one_of("relativeDistanceType", kinds, default)
        value, other = element.number("value"), self._target(element)
        if kind in ("longitudinal", "lateral"):
            axis = X if kind == "longitudinal" else Y
            return self._apart(element, entity, other, axis), value
        return self._straight(element, entity, other, value)

    def _straight(self, element: Node, one: Entity, other: Entity | Pose, value: float) -> Compared:
        """The square of the distance in a straight line, m2, and the square of `value`, m2, with
        the sign of `value`.

        value: the distance that the condition states, m.
        """
        # From x and y of the frame; along a curve of radius r a distance d is off by d^3 / (24 r^2)
        line = self.frame.line
        if line and abs(value) ** 3 / (24.0 * tightest(line) ** 2) > _BENT:
            raise element.fault("a distance across a curve of the road is not supported")
        x, y = (self._apart(element, one, other, axis) for axis in (X, Y))
        if element.flag("freespace"):
            x, y = (it.joined(LARGER, constant(0.0)) for it in (x, y))
        return x * x + y * y, value * abs(value)

    def _reach(self, element: Node, entity: Entity) -> Compared:
        tolerance = element.above_zero("tolerance", " m")
        return self._straight(element, entity, self._target(element), tolerance)

    # -- speeds and times --------------------------------------------------------------------------

    def _along(self, element: Node, body: Entity) -> DriveNumber:
        """The speed of a body along the road, m/s."""
        of_speed = element.tag.endswith("SpeedCondition")
        name = "direction" if of_speed else "relativeDistanceType"
        got = element.text(name, "longitudinal")
        if got != "longitudinal":
            raise element.fault(f"`{name}` must be longitudinal to be supported, got {shown(got)}")
        at_start = body.speed * math.cos(body.frame.heading)
        return of_vehicle(ALONG, self._number(body, element), at_start)

    def _own(self, element: Node, entity: Entity) -> DriveNumber:
        """The speed of a body in the direction in which it points, m/s."""
        along, share = self._along(element, entity), math.cos(entity.frame.heading)
        if abs(share) < _ACROSS:
            raise element.fault("the speed of an entity that crosses the road is not supported")
        return along if math.isclose(share, 1.0) else along * constant(1.0 / share)

    def _headway(self, element: Node, entity: Entity) -> Compared:
        """gap - value * speed, m, and 0: it has the sign of time headway minus value, without a
        division by 0.
        """
        speed = self._own(element, entity)
        gap = self._apart(element, entity, self._target(element), X)
        return gap - constant(element.number("value")) * speed, 0.0

    def _to_collision(self, element: Node, entity: Entity) -> Compared:
        """gap |dx| - value dx dv, m2, and 0: it has the sign of time to collision minus value.

        dx: from this body to the other along the road, m. dv: its speed minus the other's, m/s.
        The bodies close in where dx dv is above 0.
        """
        other, value = self._target(element), constant(element.number("value"))
        speed = self._along(element, entity)
        if isinstance(other, Entity):
            speed -= self._along(element, other)
        ahead = self._ahead(element, entity, other, X)
        gap = self._apart(element, entity, other, X)
        return gap * abs(ahead) - ahead * speed * value, 0.0

    def _speed(self, element: Node, entity: Entity) -> Compared:
        if element.tag == "SpeedCondition":
            speed = self._own(element, entity)
        else:
            speed = self._along(element, entity)
            speed -= self._along(element, self.places.referred(element))
        return speed, element.number("value")

    def _travelled(self, element: Node, entity: Entity) -> Compared:
        if entity.on_map or abs(math.sin(entity.frame.heading)) > 1e-9:
            raise element.fault("a distance travelled across the road is not supported as a start")
        x = of_vehicle(X, self._number(entity, element), entity.frame.x)
        return abs(x - constant(x.start)), element.number("value")


def _joined(programs: list[Program], op: int) -> Program:
    """Programs joined by `op`, AND or OR; at least one."""
    first, *rest = programs
    return (*first, *(step for program in rest for step in (*program, operation(op))))


def _half(body: Entity | Pose, axis: int) -> float:
    """Half the extent of a body along an axis of the road at the start, m; 0 for a place."""
    if isinstance(body, Pose):
        return 0.0
    return half_sizes(body.frame.heading, body.length, body.width)[axis - X]
