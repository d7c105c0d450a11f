"""Moments at which storyboard elements begin: a time, or a condition on what happens.

A trigger that is known before the drive is a time. A condition on the drive becomes a program of
`scenario.played`, as a `when` of a scenario file does: a list of operations on a stack of values.
`scene` and `story` read moments with `Conditions`; `acts` and `moves` plan moves with them.

Users: `extras/openscenario/acts.py`, `extras/openscenario/moves.py`,
`extras/openscenario/scene.py`, `extras/openscenario/story.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from sumo_eval.extras.openscenario.drive_numbers import operation, truth_of
from sumo_eval.extras.openscenario.frame import Frame
from sumo_eval.extras.openscenario.places import Entity, Places
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.extras.openscenario.values import RULES
from sumo_eval.frozen import frozen
from sumo_eval.scenario.played import (
    ABSOLUTE,
    AND,
    AT_MOST,
    BELOW,
    COSINE,
    ENDED,
    OR,
    TIME,
    VALUE,
    Act,
    Move,
    Program,
)

Past = float | Move
"""A time that has passed, s, or a move that has ended."""
NEVER = math.inf
AT_ONCE = 1e-6  # s: duration of a change that is a step


def from_time(time: float) -> Program:
    """The program of a condition that holds from a time on, s."""
    return (VALUE, 0, 0, time), operation(TIME), operation(AT_MOST)


def implied(program: Program) -> set[Past]:
    """Times and moves that are certainly past whenever a condition holds.

    The function runs the program with a set in place of each value on the stack: what is past
    whenever that value is true. AND unites two sets, OR keeps what both have. In the order of
    `played`'s numbers, operations up to `ENDED` put a value on the stack, and later ones join two
    values, except `ABSOLUTE`.
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
            # of BELOW both have nothing: one of its sides at least is a number, whose set is empty
            # (0.5 where it negates "has ended")
            if op in (OR, BELOW):
                stack[-1] &= last
            else:
                stack[-1] |= last
    return stack[-1]


@frozen
class Moment:
    """A time, or a condition on the drive.

    time: s, inf for never. With a program: the delay after its condition holds, s.
    program: of the condition; empty: the moment is a time.
    until: time from which on nothing begins any more, s; inf: no such time.
    past: where the condition is joined with others, whether it is enough that it held once, before
        they hold, as that an element has begun. Otherwise all must hold at the same time.
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

    end: s; inf: the end has no known time. Where `begin` is a condition, a finite end means that
        the element takes no time: it ends as it begins, and `end` is only the delay of `begin`.
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

    def end_by(self, program: Program) -> None:
        """Let a condition end the element also, unless the element ends at a known time."""
        if self.end == NEVER:
            self.ended = _joined([self.ended, program], OR) if self.ended else program


@dataclass(slots=True)
class Conditions:
    """Reads the conditions of a file as moments.

    actors: in the order of their numbers; empty until the numbers are known.
    spans: of the elements read so far, for conditions on elements: tag in small letters, path,
        span. The path joins the names of the elements around it and its own by `::`.
    """

    places: Places
    frame: Frame
    actors: list[Entity]
    spans: list[tuple[str, str, Span]] = field(default_factory=list)

    def latch(self, program: Program, delay: float) -> Program:
        """The condition that `program` held `delay` s ago or earlier, even if it fails again.

        Programs remember nothing. So the first actor gets a move that changes nothing and begins
        `delay` s after `program` holds. The result is the condition that this move has ended.
        `acts.changes_nothing` knows such a move as a COSINE by 0 m.
        """
        if not self.actors:  # before their numbers are known, no move can wait for the condition
            return program
        actor = self.actors[0]
        actor.acts.append(Act(COSINE, delay, AT_ONCE, program=program))
        return actor.ended()

    def note(self, element: Node, above: Sequence[str], span: Span) -> Span:
        """Note when an element of the storyboard runs, for conditions further down in the file.

        above: names of the elements around it, the outermost first. Those of a catalog's entry are
            not in its file; "" for an element without a name.
        """
        path = "::".join((*filter(None, above), element.attribute("name")))
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
        # 1. all groups are times
        if all(group.known for group in live):
            if after.known:
                return Moment(min(self._later(after, group, trigger).time for group in live))
            # the earliest, of equal ones that with the latest `until`; joined with `after` below
            begin = min(live, key=lambda group: (group.time, -group.until))
        # 2. several, of which some are times or have a delay
        elif len(live) > 1 and any(group.known or group.time > 0.0 for group in live):
            raise trigger.fault(
                "groups of conditions of which some depend on the drive and some are times, or "
                "have a delay, are not supported together"
            )
        # 3. one condition on the drive, or several without a delay: one of them must hold
        else:
            past = all(group.past for group in live)
            # If all are past, `_later` latches the whole. Else each group that is past has a latch
            # of its own, if anything may have to hold after it.
            latched = not past and (after.program or after.time > 0.0)
            programs = [
                self.latch(it.program, 0.0) if latched and it.past else it.program for it in live
            ]
            begin = replace(live[0], program=_joined(programs, OR), past=past)
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
        kind = element.only_child()
        if kind.tag == "ByValueCondition":
            moment = self._by_value(kind.only_child(), edge)
        elif kind.tag == "ByEntityCondition":
            moment = Moment(0.0, self._by_entity(kind, edge))
        else:
            raise kind.unsupported()
        return replace(moment, time=moment.time + delay, until=moment.until + delay)

    def _by_value(self, element: Node, edge: str) -> Moment:
        """The moment of a condition on a value; element: child of <ByValueCondition>."""
        if element.tag == "SimulationTimeCondition":
            moment = _by_time(element, edge)
            # in files for CARLA it is enough, as for scenario_runner, that it held once
            return replace(moment, until=NEVER) if self.places.side < 0.0 else moment
        if edge == "falling":
            raise element.fault("the edge `falling` is not supported of it")
        if element.tag == "ParameterCondition":
            name = element.parameter("parameterRef")
            sets = "//ParameterAction[translate(@parameterRef, '$', '')=$name]"
            if element.element.xpath(sets, name=name):
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
        # it begins by a condition and takes no time: it ends as it begins (`Span.end`)
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
        condition = element.child("EntityCondition").only_child()
        truths = [truth_of(condition, it, self.places, self.frame) for it in entities]
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


def _by_time(element: Node, edge: str) -> Moment:
    """The moment of a <SimulationTimeCondition>.

    The time only grows: `less` holds until a time, `greater` from a time on. `equalTo` holds at
    one instant, and `notEqualTo` at all others.
    """
    rule, value = element.one_of("rule", RULES), element.number("value")
    less = rule.startswith("less")
    if rule not in RULES[4:] and edge == ("rising" if less else "falling"):
        raise element.fault(f"the time grows, so `{rule}` never has the edge `{edge}`: use `none`")
    if less and not element.compared(0.0, value):
        return Moment(NEVER)
    at_value = value + AT_ONCE  # it still holds at `value`: steps are longer than `AT_ONCE`
    if less and edge == "none":
        return Moment(0.0, until=value if rule == "lessThan" else at_value)
    if less:
        return Moment(value)
    if value < 0.0 and (rule == "equalTo" or edge != "none"):
        return Moment(NEVER)  # nothing changes from the start on
    if rule == "equalTo" and edge != "falling":
        return Moment(value, until=at_value)
    # `notEqualTo` holds from the start; with an edge it counts from `value` on
    at_start = rule == "notEqualTo" and edge == "none"
    return Moment(0.0 if at_start else max(value, 0.0))


def _joined(programs: list[Program], op: int) -> Program:
    """Programs joined by `op`, AND or OR; at least one."""
    first, *rest = programs
    return (*first, *(step for program in rest for step in (*program, operation(op))))
