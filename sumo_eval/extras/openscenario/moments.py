"""When something begins: at a time, or when a condition on what happens holds.

A trigger of which all is known before the drive is a time. What depends on the drive becomes a
program of `scenario.played`, as a `when` of a scenario file does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from sumo_eval.extras.openscenario.network import in_frame
from sumo_eval.extras.openscenario.places import Entity, Places
from sumo_eval.extras.openscenario.reading import Part
from sumo_eval.extras.openscenario.values import RULES
from sumo_eval.scenario import played
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import Piece, tightest
from sumo_eval.text import shown

Step = tuple[int, int, int, float]
Program = tuple[Step, ...]
NEVER = math.inf
NO_STEPS: Program = ()
_BENT = 0.1  # m that the road's curve may change a distance across it

DISTANCES = ("longitudinal", "lateral", "cartesianDistance", "euclidianDistance")


def operation(op: int) -> Step:
    """A step of a program that works on what is on the stack."""
    return op, 0, 0, 0.0


_PRODUCT = (operation(played.MULTIPLY),)


class Measure(NamedTuple):
    """A number of the drive that a condition compares.

    program: leaves it on the stack.
    start: its value at the start.
    limit: it is compared with.
    """

    program: Program
    start: float
    limit: float


class Truth(NamedTuple):
    """A condition on the drive.

    holds, fails: programs that leave on the stack whether it does.
    start: whether it holds at the start.
    """

    holds: Program
    fails: Program
    start: bool


@dataclass(frozen=True, slots=True)
class Moment:
    """time: s, inf for never; with a program it is the delay after the condition of the program
    holds.

    until: s, when it cannot begin any more.
    """

    time: float
    program: tuple[Step, ...] = ()
    until: float = NEVER

    @property
    def known(self) -> bool:
        """Whether it is a time."""
        return not self.program


@dataclass(slots=True)
class Span:
    """From when to when an element of the storyboard runs.

    move: the vehicle and its move that ends it, where the end is not known before.
    """

    begin: Moment
    end: float
    move: tuple[int, int] | None = None


@dataclass(slots=True)
class Conditions:
    """What conditions can ask for: entities, their numbers among the actors, and elements of the
    storyboard above.

    origin, line: of the road's frame.
    latch: adds a move that changes nothing and begins when a program holds; its actor and number.
    """

    places: Places
    number_of: Mapping[str, int]
    origin: Pose
    line: tuple[Piece, ...]
    latch: Callable[[Program], tuple[int, int]] = lambda program: (0, 0)
    spans: list[tuple[str, tuple[str, ...], Span]] = field(default_factory=list)

    def note(self, element: Part, span: Span, *, again: bool = False) -> None:
        """Remember when an element of the storyboard runs, for conditions below it.

        again: in place of what was noted of it before.
        """
        kind = str(element.tag).lower()
        names = (
            *(it.get("name", "") for it in element.element.iterancestors()),
            element.attribute("name"),
        )
        path = tuple(str(name) for name in (*reversed(names[:-1]), names[-1]) if name)
        if again:
            self.spans = [it for it in self.spans if it[:2] != (kind, path)]
        self.spans.append((kind, path, span))

    def _span(self, kind: str, name: str, element: Part) -> Span:
        """When the element above of a kind and a name runs; `act::event` where the name alone is
        not one element's.
        """
        parts = tuple(name.split("::"))
        found = [
            span
            for known, path, span in self.spans
            if known == kind.lower() and path[-len(parts) :] == parts
        ]
        if not found:
            raise element.fault(f"no {kind} `{name}` stands above it")
        if len(found) > 1:
            wanted = f"a path such as `story::act::{name}` must say which"
            raise element.fault(f"{len(found)} elements are called {kind} `{name}`: {wanted}")
        return found[0]

    def moment(self, trigger: Part | None, after: Moment) -> Moment:
        """When a <StartTrigger> lets something begin that cannot begin before `after`; without one,
        at `after`.
        """
        if trigger is None or trigger.find("ConditionGroup") is None:
            return after
        groups = [self.group(group) for group in trigger.all("ConditionGroup")]
        live = [group for group in groups if group.time < NEVER]
        if not live:
            return Moment(NEVER)
        if all(group.known for group in live):
            return self._later(after, Moment(min(group.time for group in live)), trigger)
        if len(live) == 1:
            return self._later(after, live[0], trigger)
        if any(group.known or group.time > 0.0 for group in live):
            raise trigger.fault("groups of conditions of which some depend on the drive and some "
                                "are times, or have a "
                                 "delay, are not played together")  # fmt: skip
        program = live[0].program
        for group in live[1:]:
            program = (*program, *group.program, operation(played.OR))
        return self._later(after, Moment(0.0, program), trigger)

    def _later(self, one: Moment, two: Moment, element: Part) -> Moment:
        """The later of two moments."""
        until = min(one.until, two.until)
        if one.time == NEVER or two.time == NEVER:
            return Moment(NEVER)
        if one.known and two.known:
            time = max(one.time, two.time)
            return Moment(time, until=until) if time < until else Moment(NEVER)
        if until < NEVER:
            raise element.fault(
                "a condition on the drive is not played together with a time until which it may "
                "hold"
            )
        if one.known or two.known:
            when, what = (one, two) if one.known else (two, one)
            if when.time <= 0.0:
                return what
            if what.time > 0.0:
                raise element.fault(
                    "a delay after a condition on the drive is not played together with a time"
                )
            holds = (
                (played.VALUE, 0, 0, when.time),
                operation(played.TIME),
                operation(played.AT_MOST),
            )
            return Moment(0.0, (*what.program, *holds, operation(played.AND)))
        if one.time > 0.0 or two.time > 0.0:
            raise element.fault("two conditions on the drive are not played together with a delay")
        return Moment(0.0, (*one.program, *two.program, operation(played.AND)))

    def group(self, group: Part) -> Moment:
        """When all conditions of a group hold."""
        found = Moment(0.0)
        for condition in group.all("Condition"):
            found = self._later(found, self._condition(condition), condition)
        return found

    def _condition(self, element: Part) -> Moment:
        edge = element.one_of("conditionEdge", ("none", "rising", "falling", "risingOrFalling"))
        delay = element.number("delay", 0.0)
        if delay < 0.0:
            raise element.fault(f"`delay` must be at least 0 s, got {delay:g}")
        kind = element.only()
        if kind.tag == "ByValueCondition":
            if edge == "falling":
                raise element.fault("the edge `falling` of a condition by value is not supported")
            moment = self._by_value(kind.only())
        elif kind.tag == "ByEntityCondition":
            moment = Moment(0.0, self._by_entity(kind, edge))
        else:
            raise kind.not_played()
        return Moment(moment.time + delay, moment.program, moment.until + delay)

    def _by_value(self, element: Part) -> Moment:
        if element.tag == "SimulationTimeCondition":
            rule, value = element.one_of("rule", RULES), element.number("value")
            if rule in ("greaterThan", "greaterOrEqual"):
                return Moment(max(value, 0.0))
            if rule == "equalTo":
                return Moment(value if value >= 0.0 else NEVER)
            if rule == "notEqualTo":
                return Moment(0.0)
            return Moment(0.0, until=value) if element.compared(rule, 0.0, value) else Moment(NEVER)
        if element.tag == "ParameterCondition":
            name = element.attribute("parameterRef").removeprefix("$")
            if any(
                it.get("parameterRef") == name
                for it in element.element.getroottree().iter("ParameterAction")
            ):
                raise element.fault(
                    f"parameter `{name}` is set during the drive, and is read before it here"
                )
            wanted = element.worked_out(element.attribute("value"))
            holds = element.compared(
                element.attribute("rule"), element.worked_out(f"${name}"), wanted
            )
            return Moment(0.0 if holds else NEVER)
        if element.tag == "StoryboardElementStateCondition":
            return self._state(element)
        raise element.not_played(
            "a start that depends on a variable or on the world outside is not known here"
        )

    def _state(self, element: Part) -> Moment:
        kind = element.attribute("storyboardElementType")
        state = element.one_of("state", (
            "completeState", "endTransition", "startTransition", "runningState", "standbyState",
            "skipTransition",
            "stopTransition",
        ))  # fmt: skip
        name = element.attribute("storyboardElementRef")
        span = self._span(kind, name, element)
        if state in ("startTransition", "runningState"):
            return span.begin
        if state not in ("completeState", "endTransition"):
            raise element.fault(f"the state `{state}` is not played")
        if span.move is not None:
            vehicle, move = span.move
            return Moment(0.0, ((played.ENDED, vehicle, move, 0.0),))
        return Moment(span.end)

    def _by_entity(self, element: Part, edge: str) -> Program:
        """The program of a condition on entities; an edge needs the opposite before."""
        triggering = element.child("TriggeringEntities")
        every = triggering.one_of("triggeringEntitiesRule", ("any", "all")) == "all"
        names = [part.text("entityRef") for part in triggering.all("EntityRef")]
        if not names:
            raise triggering.fault("it must name an entity")
        condition = element.child("EntityCondition").only()
        found = [self._of_entity(condition, self.places.entity(it, triggering)) for it in names]
        both, either = (played.AND, played.OR) if every else (played.OR, played.AND)
        holds = _joined([it.holds for it in found], both)
        fails = _joined([it.fails for it in found], either)
        start = (all if every else any)(it.start for it in found)
        if edge == "falling" or (edge == "risingOrFalling" and start):
            holds, fails, start = fails, holds, not start
        if edge == "none" or not start:
            return holds
        actor, move = self.latch(fails)
        return (*holds, (played.ENDED, actor, move, 0.0), operation(played.AND))

    def _number(self, entity: Entity, element: Part) -> int:
        if entity.deleted:
            raise element.fault(
                f"entity `{entity.name}` is deleted at the start, so nothing depends on it"
            )
        return self.number_of.get(entity.name, played.EGO)

    def _of_entity(self, element: Part, one: Entity) -> Truth:
        """A condition on one entity."""
        known: dict[str, Callable[[Part, Entity], Measure]] = {
            "RelativeDistanceCondition": self._distance, "DistanceCondition": self._distance,
            "ReachPositionCondition": self._reach, "TimeHeadwayCondition": self._headway,
            "TimeToCollisionCondition": self._to_collision, "SpeedCondition": self._speed,
            "RelativeSpeedCondition": self._relative_speed,
            "TraveledDistanceCondition": self._travelled,
        }  # fmt: skip
        if element.tag not in known:
            raise element.not_played(f"conditions on an entity that are: {', '.join(known)}")
        program, start, limit = known[element.tag](element, one)
        default = {"TraveledDistanceCondition": "greaterOrEqual"}.get(element.tag)
        default = "lessOrEqual" if element.tag == "ReachPositionCondition" else default
        rule = element.one_of("rule", RULES, default)
        if rule not in ("lessThan", "lessOrEqual", "greaterThan", "greaterOrEqual"):
            raise element.fault(f"`{rule}` between numbers of the drive is not played")
        below, above = (*program, _value(limit)), (_value(limit), *program)
        holds, fails = (below, above) if rule.startswith("less") else (above, below)
        strict, equal = operation(played.BELOW), operation(played.AT_MOST)
        first, second = (strict, equal) if rule.endswith("Than") else (equal, strict)
        return Truth((*holds, first), (*fails, second), element.compared(rule, start, limit))

    # -- distances ---------------------------------------------------------------------------------

    def _target(self, element: Part) -> Entity | Pose:
        """What a condition measures to: an entity, or a fixed place in the road's frame."""
        holder = element.find("TimeToCollisionConditionTarget") or element
        if holder.get("entityRef") is not None:
            return self.places.entity(holder.text("entityRef"), holder)
        reference = holder.find("EntityRef")
        if reference is not None:
            return self.places.entity(reference.text("entityRef"), reference)
        position = holder.child("Position").only()
        if position.get("entityRef") is None:
            pose = self.places.spot(holder.child("Position")).pose
            return in_frame(pose, self.origin, self.line)
        return self._moving(position)

    def _moving(self, position: Part) -> Entity:
        """The entity at whose reference point a place is."""
        shifted = any(position.number(key, 0.0) for key in ("dx", "dy"))
        if position.tag != "RelativeObjectPosition" or shifted:
            raise position.fault("a place beside an entity that moves is not supported here")
        return self.places.entity(position.text("entityRef"), position)

    def _coordinate(
        self, body: Entity | Pose, axis: int, element: Part, *, free: bool
    ) -> tuple[Program, float]:
        """x or y of a place, of a body's centre, or of its reference point.

        axis: `played.X` or `played.Y`.
        free: the centre.
        """
        number = axis - played.X
        if isinstance(body, Pose):
            return (_value(body[number]),), body[number]
        centre = body.frame[number]
        point = body.frame.moved(-body.centre, -body.offset)[number]
        program: Program = ((axis, self._number(body, element), 0, 0.0),)
        if free or point == centre:
            return program, centre
        return (*program, _value(point - centre), operation(played.ADD)), point

    def _apart(
        self, element: Part, one: Entity, other: Entity | Pose, axis: int
    ) -> tuple[Program, float]:
        """How far two bodies, or their reference points, are apart along one axis, m."""
        free = element.flag("freespace")
        half = _half(one, axis) + _half(other, axis)
        first, begin = self._coordinate(one, axis, element, free=free)
        second, end = self._coordinate(other, axis, element, free=free)
        if free and axis == played.X and isinstance(other, Entity):
            return self._gap(element, one, other), abs(end - begin) - half
        program = (*second, *first, operation(played.SUBTRACT), operation(played.ABSOLUTE))
        if free:
            program = (*program, _value(half), operation(played.SUBTRACT))
        return program, abs(end - begin) - (half if free else 0.0)

    def _gap(self, element: Part, one: Entity, other: Entity) -> Program:
        """The free distance along the road of two bodies as they point at that time."""
        a, b = self._number(one, element), self._number(other, element)
        return (played.GAP, a, b, 0.0), (played.GAP, b, a, 0.0), operation(played.LARGER)

    def _distance(self, element: Part, one: Entity) -> Measure:
        default = "euclidianDistance" if element.tag == "DistanceCondition" else None
        kind = element.one_of("relativeDistanceType", DISTANCES, default)
        value, other = element.number("value"), self._target(element)
        if kind in ("longitudinal", "lateral"):
            axis = played.X if kind == "longitudinal" else played.Y
            return Measure(*self._apart(element, one, other, axis), value)
        return self._straight(element, one, other, value)

    def _straight(self, element: Part, one: Entity, other: Entity | Pose, value: float) -> Measure:
        """The square of the distance in a straight line, m2."""
        self._check_curve(element, value)
        program, square = NO_STEPS, 0.0
        for axis in (played.X, played.Y):
            part, start = self._apart(element, one, other, axis)
            if element.flag("freespace"):
                part = (*part, _value(0.0), operation(played.LARGER))
                start = max(start, 0.0)
            program = (*program, *part, *part, *_PRODUCT)
            square += start * start
        return Measure((*program, operation(played.ADD)), square, value * abs(value))

    def _check_curve(self, element: Part, value: float) -> None:
        """Refuse a distance, m, that is not the one along the road's curve."""
        if self.line and abs(value) ** 3 / (24.0 * tightest(self.line) ** 2) > _BENT:
            raise element.fault("a distance across a curve of the road is not supported")

    def _reach(self, element: Part, one: Entity) -> Measure:
        return self._straight(
            element, one, self._target(element), element.above_zero("tolerance", " m")
        )

    def _along_road(self, element: Part, name: str) -> None:
        """A condition that says in which direction it measures must say along the road."""
        if element.get(name) not in (None, "longitudinal"):
            raise element.fault(
                f"`{name}` must be longitudinal to be played, got {shown(element.attribute(name))}"
            )

    def _headway(self, element: Part, one: Entity) -> Measure:
        """The time headway by its sign: gap - value v, m."""
        self._along_road(element, "relativeDistanceType")
        value = element.number("value")
        program, gap = self._apart(element, one, self._target(element), played.X)
        speed = _value(value), (played.ALONG, self._number(one, element), 0, 0.0), *_PRODUCT
        program = (*program, *speed, operation(played.SUBTRACT))
        return Measure(program, gap - value * one.speed, 0.0)

    def _to_collision(self, element: Part, one: Entity) -> Measure:
        """The time to collision by its sign: gap |dx| - value dx dv, m2."""
        self._along_road(element, "relativeDistanceType")
        other, value = self._target(element), element.number("value")
        closing = one.speed * math.cos(one.frame.heading)
        speeds: Program = ((played.ALONG, self._number(one, element), 0, 0.0),)
        if isinstance(other, Entity):
            closing -= other.speed * math.cos(other.frame.heading)
            its = played.ALONG, self._number(other, element), 0, 0.0
            speeds = (*speeds, its, operation(played.SUBTRACT))
        gap, start = self._apart(element, one, other, played.X)
        free = element.flag("freespace")
        first, begin = self._coordinate(one, played.X, element, free=free)
        second, end = self._coordinate(other, played.X, element, free=free)
        ahead = *second, *first, operation(played.SUBTRACT)
        closed = *ahead, *speeds, *_PRODUCT, _value(value), *_PRODUCT
        program = *gap, *ahead, operation(played.ABSOLUTE), *_PRODUCT, *closed
        before = start * abs(end - begin) - value * (end - begin) * closing
        return Measure((*program, operation(played.SUBTRACT)), before, 0.0)

    # -- speeds and ways ---------------------------------------------------------------------------

    def _speed(self, element: Part, one: Entity) -> Measure:
        self._along_road(element, "direction")
        steps = ((played.ALONG, self._number(one, element), 0, 0.0),)
        return Measure(steps, one.speed, element.number("value"))

    def _relative_speed(self, element: Part, one: Entity) -> Measure:
        self._along_road(element, "direction")
        other = self.places.entity(element.text("entityRef"), element)
        steps = (
            (played.ALONG, self._number(one, element), 0, 0.0),
            (played.ALONG, self._number(other, element), 0, 0.0),
        )
        program = (*steps, operation(played.SUBTRACT))
        return Measure(program, one.speed - other.speed, element.number("value"))

    def _travelled(self, element: Part, one: Entity) -> Measure:
        if one.on_map or abs(math.sin(one.frame.heading)) > 1e-9:
            raise element.fault("a distance travelled across the road is not played as a start")
        begin = ((played.X, self._number(one, element), 0, 0.0), _value(one.frame.x))
        program = (*begin, operation(played.SUBTRACT), operation(played.ABSOLUTE))
        return Measure(program, 0.0, element.number("value"))


def _value(number: float) -> Step:
    return played.VALUE, 0, 0, number


def _joined(programs: list[Program], op: int) -> Program:
    """Programs joined by and, or by or."""
    found = programs[0]
    for program in programs[1:]:
        found = (*found, *program, (op, 0, 0, 0.0))
    return found


def _half(body: Entity | Pose, axis: int) -> float:
    """Half the extent of a body along an axis of the road at the start, m; of a place 0."""
    if isinstance(body, Pose):
        return 0.0
    c, s = abs(math.cos(body.frame.heading)), abs(math.sin(body.frame.heading))
    along, across = (c, s) if axis == played.X else (s, c)
    return 0.5 * (body.length * along + body.width * across)
