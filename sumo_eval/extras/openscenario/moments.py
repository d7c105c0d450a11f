"""When something begins: at a time, or when a condition on what happens holds.

A trigger of which all is known before the drive is a time. What depends on the drive becomes a
program of `scenario.played`, as a `when` of a scenario file does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from sumo_eval.extras.openscenario.places import Entity, Places
from sumo_eval.extras.openscenario.reading import Part
from sumo_eval.extras.openscenario.values import RULES
from sumo_eval.scenario import played
from sumo_eval.text import shown

Step = tuple[int, int, int, float]
NEVER = math.inf


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
    """What conditions can ask for: entities, their numbers among the others, and elements of the
    storyboard above.
    """

    places: Places
    number_of: Mapping[str, int]
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
            program = (*program, *group.program, (played.OR, 0, 0, 0.0))
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
                (played.TIME, 0, 0, 0.0),
                (played.AT_MOST, 0, 0, 0.0),
            )
            return Moment(0.0, (*what.program, *holds, (played.AND, 0, 0, 0.0)))
        if one.time > 0.0 or two.time > 0.0:
            raise element.fault("two conditions on the drive are not played together with a delay")
        return Moment(0.0, (*one.program, *two.program, (played.AND, 0, 0, 0.0)))

    def group(self, group: Part) -> Moment:
        """When all conditions of a group hold."""
        found = Moment(0.0)
        for condition in group.all("Condition"):
            found = self._later(found, self._condition(condition), condition)
        return found

    def _condition(self, element: Part) -> Moment:
        edge = element.one_of("conditionEdge", ("none", "rising", "falling", "risingOrFalling"))
        if edge in ("falling", "risingOrFalling"):
            raise element.fault(f"the edge `{edge}` is not played, `none` and `rising` are")
        delay = element.number("delay", 0.0)
        if delay < 0.0:
            raise element.fault(f"`delay` must be at least 0 s, got {delay:g}")
        kind = element.only()
        if kind.tag == "ByValueCondition":
            moment = self._by_value(kind.only())
        elif kind.tag == "ByEntityCondition":
            moment = self._by_entity(kind, rising=edge == "rising")
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
        if not math.isfinite(span.end):
            return Moment(NEVER)
        return Moment(span.end)

    def _by_entity(self, element: Part, *, rising: bool) -> Moment:
        triggering = element.child("TriggeringEntities")
        rule = triggering.one_of("triggeringEntitiesRule", ("any", "all"))
        names = [part.text("entityRef") for part in triggering.all("EntityRef")]
        if not names:
            raise triggering.fault("it must name an entity")
        condition = element.child("EntityCondition").only()
        program: tuple[Step, ...] = ()
        for count, name in enumerate(names):
            program += self._of_entity(
                condition, self.places.entity(name, triggering), rising=rising
            )
            if count:
                program = (*program, (played.OR if rule == "any" else played.AND, 0, 0, 0.0))
        return Moment(0.0, program)

    def _number(self, entity: Entity, element: Part) -> int:
        if entity.deleted:
            raise element.fault(
                f"entity `{entity.name}` is deleted at the start, so nothing depends on it"
            )
        return self.number_of.get(entity.name, played.EGO)

    def _of_entity(self, element: Part, one: Entity, *, rising: bool) -> tuple[Step, ...]:
        """A condition on one entity, as a program that leaves on the stack whether it holds."""
        known: dict[str, Callable[[Part, Entity], tuple[tuple[Step, ...], float]]] = {
            "RelativeDistanceCondition": self._distance, "TimeHeadwayCondition": self._headway,
            "TimeToCollisionCondition": self._to_collision, "SpeedCondition": self._speed,
            "RelativeSpeedCondition": self._relative_speed,
            "TraveledDistanceCondition": self._travelled,
        }  # fmt: skip
        if element.tag not in known:
            raise element.not_played(f"conditions on an entity that are: {', '.join(known)}")
        program, at_start = known[element.tag](element, one)
        default = "greaterOrEqual" if element.tag == "TraveledDistanceCondition" else None
        rule, value = element.one_of("rule", RULES, default), element.number("value")
        compare = {"lessThan": played.BELOW, "lessOrEqual": played.AT_MOST,
            "greaterThan": played.BELOW,
                   "greaterOrEqual": played.AT_MOST}.get(rule)  # fmt: skip
        if compare is None:
            raise element.fault(f"`{rule}` between numbers of the drive is not played")
        if rising and element.compared(rule, at_start, value):
            raise element.fault(f"it holds at the start already ({at_start:g} {rule} {value:g}), "
                                "so its rising edge "
                                 "never comes")  # fmt: skip
        limit: Step = (played.VALUE, 0, 0, value)
        last: Step = (compare, 0, 0, 0.0)
        return (*program, limit, last) if rule.startswith("less") else (limit, *program, last)

    def _between(
        self, element: Part, one: Entity, what: str, to: Part | None = None
    ) -> tuple[Entity, float]:
        """The other entity, and the free distance along the road at the start, m.

        to: where it is named.
        """
        to = element if to is None else to
        other = self.places.entity(to.text("entityRef"), to)
        if not element.flag("freespace"):
            raise element.fault(f"{what} that are played are free space, from bumper to bumper")
        a, b = one.frame, other.frame
        half = 0.0
        for pose, entity in ((a, one), (b, other)):
            half += 0.5 * (
                entity.length * abs(math.cos(pose.heading))
                + entity.width * abs(math.sin(pose.heading))
            )
        return other, abs(b.x - a.x) - half

    def _distance(self, element: Part, one: Entity) -> tuple[tuple[Step, ...], float]:
        kinds = ("longitudinal", "lateral", "cartesianDistance", "euclidianDistance")
        if element.one_of("relativeDistanceType", kinds) != "longitudinal":
            raise element.fault("distances that are played are longitudinal")
        other, gap = self._between(element, one, "distances")
        a, b = self._number(one, element), self._number(other, element)
        return ((played.GAP, a, b, 0.0), (played.GAP, b, a, 0.0), (played.LARGER, 0, 0, 0.0)), gap

    def _along_road(self, element: Part, name: str) -> None:
        """A condition that says in which direction it measures must say along the road."""
        if element.get(name) not in (None, "longitudinal"):
            raise element.fault(
                f"`{name}` must be longitudinal to be played, got {shown(element.attribute(name))}"
            )

    def _headway(self, element: Part, one: Entity) -> tuple[tuple[Step, ...], float]:
        self._along_road(element, "relativeDistanceType")
        other, gap = self._between(element, one, "headways")
        return self._until(element, played.THW, one, other, gap, one.speed)

    def _to_collision(self, element: Part, one: Entity) -> tuple[tuple[Step, ...], float]:
        self._along_road(element, "relativeDistanceType")
        target = element.child("TimeToCollisionConditionTarget").child("EntityRef")
        other, gap = self._between(element, one, "times to collision", target)
        closing = one.speed * math.cos(one.frame.heading) - other.speed * math.cos(
            other.frame.heading
        )
        return self._until(element, played.TTC, one, other, gap, closing)

    def _until(
        self, element: Part, op: int, one: Entity, other: Entity, gap: float, speed: float
    ) -> tuple[tuple[Step, ...], float]:
        """The time in which a speed, m/s, covers the gap, m."""
        start = gap / speed if gap > 0.0 and speed > 0.0 else math.inf
        return ((op, self._number(one, element), self._number(other, element), 0.0),), start

    def _speed(self, element: Part, one: Entity) -> tuple[tuple[Step, ...], float]:
        self._along_road(element, "direction")
        return ((played.ALONG, self._number(one, element), 0, 0.0),), one.speed

    def _relative_speed(self, element: Part, one: Entity) -> tuple[tuple[Step, ...], float]:
        self._along_road(element, "direction")
        other = self.places.entity(element.text("entityRef"), element)
        steps = (
            (played.ALONG, self._number(one, element), 0, 0.0),
            (played.ALONG, self._number(other, element), 0, 0.0),
        )
        return (*steps, (played.SUBTRACT, 0, 0, 0.0)), one.speed - other.speed

    def _travelled(self, element: Part, one: Entity) -> tuple[tuple[Step, ...], float]:
        if one.on_map or abs(math.sin(one.frame.heading)) > 1e-9:
            raise element.fault("a distance travelled across the road is not played as a start")
        begin = ((played.X, self._number(one, element), 0, 0.0), (played.VALUE, 0, 0, one.frame.x))
        return (*begin, (played.SUBTRACT, 0, 0, 0.0), (played.ABSOLUTE, 0, 0, 0.0)), 0.0
