"""The story of a scenario file: its acts, as moves of the actors.

Users: `extras/openscenario/scene.py`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from sumo_eval.extras.openscenario.acts import (
    SPEEDS,
    FileTraffic,
    changes_nothing,
    follows,
    note_plan,
)
from sumo_eval.extras.openscenario.conformity import IGNORED
from sumo_eval.extras.openscenario.drive_numbers import operation
from sumo_eval.extras.openscenario.moments import NEVER, Conditions, Moment, Span
from sumo_eval.extras.openscenario.moves import begin_action
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.scenario.played import AND, BELOW, COSINE, KEEP, SPEED, VALUE, Act, Program


def _kinds(holder: Node) -> set[str]:
    """Tags of the actions in an event or an act that move an entity."""
    return {action.tag for action in holder.all(".//PrivateAction/*")}.difference(IGNORED)


def awaited_names(root: Node) -> set[str]:
    """Names of the elements whose states a move in `root` waits for, directly or through other
    events.
    """
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


def acts_of(storyboard: Node) -> Iterator[Node]:
    """Every act of the stories."""
    for part in storyboard.all("Story"):
        yield from part.within().all("Act")


def delete_at_once(storyboard: Node, conditions: Conditions) -> None:
    """Mark the entities that are deleted at the start."""
    for act in acts_of(storyboard):
        for event in act.all("ManeuverGroup/Maneuver/Event"):
            deleted = event.all("Action/GlobalAction/EntityAction[DeleteEntityAction]")
            if not deleted:
                continue
            fault = event.fault("deleting an entity during the drive is not supported")
            # no element has been noted yet whose state could be known
            if any(it.find("StartTrigger//StoryboardElementStateCondition") for it in (act, event)):
                raise fault
            begin = conditions.moment(act, Moment(0.0))
            begin = conditions.moment(event, begin)
            if begin.time == NEVER:
                continue
            if begin.time > 0.0 or not begin.known:
                raise fault
            for part in deleted:
                conditions.places.referred(part).deleted = True


class Story(NamedTuple):
    """Reader of acts, in the order of the file.

    traffic: the entities, to which the acts add moves.
    awaited: names of the elements whose states a move waits for (`awaited_names`): of the file,
        and of the manoeuvres of catalogs so far.
    limit: time that the case lasts at most, s.
    """

    traffic: FileTraffic
    conditions: Conditions
    awaited: set[str]
    limit: float

    def read_story(self, story: Node) -> None:
        """Make moves of a <Story>, which runs from the start until its last act ends."""
        name = story.get("name", "")  # it may have none
        span = Span(Moment(0.0), NEVER)
        if name:
            self.conditions.note(story, (), span)
        acts = [self._act(it, name) for it in story.within().all("Act")]
        over_acts = Span.over(span.begin, acts)
        span.end, span.ended = over_acts.end, over_acts.ended

    def _act(self, act: Node, story: str) -> Span:
        """Make moves of an act's events, and let its <StopTrigger> stop them; return when it runs.

        story: its name.
        """
        begin = self.conditions.moment(act, Moment(0.0))
        # conditions in the act may ask whether it runs: it is noted before its end is known
        first = len(self.conditions.spans)
        span = self.conditions.note(act, (story,), Span(begin, NEVER))
        before = self._move_counts()
        above = story, act.attribute("name")
        groups = [self._group(it, above, begin) for it in act.all("ManeuverGroup")]
        over_groups = Span.over(begin, groups)
        span.end, span.ended = over_groups.end, over_groups.ended
        stop = act.find("StopTrigger[ConditionGroup]")
        if not stop:
            return span
        if before == self._move_counts():  # it has no moves to stop
            self.traffic.places.ignored["StopTrigger"] = None
            return span
        at = self.conditions.moment(act, Moment(0.0), stop.tag)
        if not at.known:
            has_held = self._stopped(stop, at, before)
            for _, _, inside in self.conditions.spans[first:]:  # the stop completes them, too
                inside.end_by(has_held)
        elif at.time < min(span.end, self.limit):
            # else its acts are latches alone, of events that others wait for
            moves = any(
                not changes_nothing(it)
                for entity, count in zip(self.traffic.actors, before, strict=True)
                for it in entity.acts[count:]
            )
            why = "an actor moves in it" if moves else "a condition waits for what is in it"
            raise stop.fault(f"an act that a time stops while {why} is not supported")
        return span

    def _move_counts(self) -> list[int]:
        """Number of moves so far of each actor."""
        return [len(entity.acts) for entity in self.traffic.actors]

    def _stopped(self, stop: Node, at: Moment, before: list[int]) -> Program:
        """Let a condition stop an act: further moves do not begin, speeds stay as they are.

        Returns the condition that the act was stopped.

        at: when the condition holds.
        before: number of moves of each actor before the act.
        """
        # Appended to the program of a move, in postfix: "and has held < 0.5". `latch` gives 1 once
        # the condition has held, else 0.
        has_held = self.conditions.latch(at.program, 0.0)
        and_not_held = (*has_held, (VALUE, 0, 0, 0.5), operation(BELOW), operation(AND))
        for entity, count in zip(self.traffic.actors, before, strict=True):
            acts = entity.acts
            own = [k for k in range(count, len(acts)) if not changes_nothing(acts[k])]
            # kinds up to COSINE are moves across the road
            if own and (at.time > 0.0 or any(acts[k].kind <= COSINE for k in own)):
                raise stop.fault("an act that a condition stops is supported for changes of speed, "
                                 "without a delay")  # fmt: skip
            for k in own:
                if not acts[k].program:
                    raise stop.fault("an act that a condition stops must begin by one as well")
                acts[k] = acts[k]._replace(program=(*acts[k].program, *and_not_held))
            if own:
                acts.append(Act(KEEP, program=at.program))
        return has_held

    def _group(self, group: Node, above: Sequence[str], begin: Moment) -> Span:
        """Make moves of a <ManeuverGroup>; return when it runs. above: as of `Conditions.note`."""
        if group.number("maximumExecutionCount", 1.0) != 1.0:
            raise group.fault("a group of manoeuvres must run once")
        actors = group.child("Actors")
        if actors.flag("selectTriggeringEntities"):
            raise actors.fault("actors that the trigger selects are not supported")
        names = [part.text("entityRef") for part in actors.all("EntityRef")]
        parts = [self.traffic.places.catalogs.entry(part) for part in group.all("CatalogReference")]
        self.awaited.update(*map(awaited_names, parts))
        parts += [part.within() for part in group.all("Maneuver")]
        around = *above, group.attribute("name")
        spans = [self._maneuver(part, around, names, begin) for part in parts]
        return self.conditions.note(group, above, Span.over(begin, spans))

    def _maneuver(
        self, maneuver: Node, above: Sequence[str], names: list[str], begin: Moment
    ) -> Span:
        """Make moves of a <Maneuver>; return when it runs. names: of its group's entities."""
        running: list[tuple[Node, Span]] = []
        around = *above, maneuver.attribute("name")
        for event in maneuver.all("Event"):
            span = self._event(event, around, names, begin)
            for other, earlier in running:
                self._check_priority(event, span, other, earlier)
                self._check_priority(other, earlier, event, span)
            running.append((event, span))
        spans = [span for _, span in running]
        return self.conditions.note(maneuver, above, Span.over(begin, spans))

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
            follows(self.traffic, running.begin, replace(span, end=span.begin.time))
            or follows(self.traffic, span.begin, running)
        ):
            raise event.fault(
                f"with its priority `{priority}` it {'is left out' if skips else 'ends'} while "
                f"event `{other.attribute('name')}` runs, which is not supported"
            )

    def _event(self, event: Node, above: Sequence[str], names: list[str], begin: Moment) -> Span:
        """Make moves of an event's actions; return when it runs.

        An event counts as done at `begin`, and its own trigger is not read, if none of its actions
        has a meaning here and no condition waits for it.
        """
        event.one_of("priority", ("overwrite", "override", "parallel", "skip"))
        actions = [(action, action.only_child()) for action in event.all("Action")]
        idle = [self._idle(inner, names) for _, inner in actions]
        around = *above, event.get("name", "")
        awaited = self.awaited & {*around, *_names_around(event.element)}
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
                    begin_action(
                        self.traffic,
                        inner.only_child(),
                        self.traffic.places.entity(name, event),
                        begin,
                    )
                    for name in names
                    if begin.time < NEVER
                ]
                span = Span.over(spans[0].begin, spans) if spans else Span(begin, NEVER)
            parts.append(self.conditions.note(action, around, span))
        if awaited and begin.known:
            self._note_ends(event, begin, names)
        span = self.conditions.note(event, above, Span.over(begin, parts))
        # an event that takes no time and begins by a condition: it ends as this condition holds
        if awaited and begin.program and span.end < NEVER and not span.ended:
            ended = self.conditions.latch(begin.program, begin.time)
            return replace(span, end=NEVER, ended=ended)
        return span

    def _note_ends(self, event: Node, begin: Moment, names: list[str]) -> None:
        """Note changes of speed whose ends are awaited: how long they take depends on the speed at
        which they begin.
        """
        for name in names:
            entity = self.traffic.places.entity(name, event)
            if entity.acts and (entity.acts[-1].kind, entity.acts[-1].begin) == (SPEED, begin.time):
                note_plan(entity, begin, SPEEDS, event, (entity.number, len(entity.acts) - 1))

    def _idle(self, action: Node, names: list[str]) -> bool:
        """Whether an action has no meaning here; such an action is noted. A move of the ego is
        refused.
        """
        inner = action if action.tag == "UserDefinedAction" else action.only_child()
        if action.tag == "PrivateAction" and inner.tag not in IGNORED:
            if self.traffic.ego.name in names:
                raise inner.fault(
                    "the ego is driven by the ADS: an action of it during the drive is not "
                    "supported"
                )
            return False
        # a deletion: see `delete_at_once`
        if not inner.find("DeleteEntityAction"):
            self.traffic.places.ignore(inner)
        return True
