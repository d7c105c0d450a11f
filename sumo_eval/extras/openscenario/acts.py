"""Acts of the entities, in the order of the file, and the acts that each depends on.

A move may be planned from the speed or the offset that earlier acts leave. An act further down in
the file that may begin before this move is then a fault. `extras/openscenario/story.py` refuses
events that would interrupt one another.

Users: `extras/openscenario/describe.py`, `extras/openscenario/logical.py`,
`extras/openscenario/moves.py`, `extras/openscenario/scene.py`, `extras/openscenario/story.py`.
"""

import math

from sumo_eval.extras.openscenario.frame import SAME, Frame
from sumo_eval.extras.openscenario.moments import NEVER, Moment, Past, Span, from_time, implied
from sumo_eval.extras.openscenario.places import Entity, Places, PlannedMove
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.frozen import frozen
from sumo_eval.scenario.played import (
    BY_TIME,
    CONSTANT,
    COSINE,
    EGO,
    KEEP,
    MATCH,
    SPEED,
    Act,
    Move,
)

# kinds of acts that change a speed, and of acts that move across the road
SPEEDS, ACROSS = (SPEED, BY_TIME, MATCH), (COSINE, CONSTANT)
# (actor's number, act's index), for "no move": the ego has no acts
NO_MOVE = EGO, 0


@frozen
class FileTraffic:
    """Road and entities of a file, as its actions read them.

    ego: the entity that the ADS drives.
    actors: by number.
    """

    places: Places
    frame: Frame
    ego: Entity
    actors: list[Entity]


def changes_nothing(act: Act) -> bool:
    """Whether a move only keeps a speed, or is by 0 m: that it began then records that a condition
    held (`moments.Conditions.latch`).
    """
    return act.kind == KEEP or (act.kind == COSINE and act.offset == 0.0)


def add_act(traffic: FileTraffic, entity: Entity, begin: Moment, act: Act, lasts: float) -> Span:
    """Give an entity an act; return when the act runs.

    Raises an InputError if the act may begin before a move above it in the file, which was
    planned without the act.

    lasts: duration, s; without effect where the act begins by a condition.
    """
    earliest, past = _past_at(traffic, begin)
    for plan in entity.plans:
        # not the plan of this act itself (`next_move`), nor of a move that ends before it begins
        matters = act.kind in plan.kinds and plan.move not in (*past, entity.next_move)
        if matters and earliest < plan.until and not changes_nothing(act):
            raise plan.fault
    entity.acts.append(act._replace(begin=begin.time, program=begin.program))
    if begin.known:
        return Span(begin, begin.time + lasts)
    return Span(begin, NEVER, entity.ended())


def _past_at(traffic: FileTraffic, begin: Moment) -> tuple[float, set[Past]]:
    """Earliest time of a moment, s, and what is certainly past then: times, s, and moves that have
    ended.
    """
    past = set[Past]({0.0})
    programs = [begin.program]
    # The list grows in the loop: a move that has ended has begun, so its own condition held.
    for program in programs:
        new = implied(program) - past
        ended = (item for item in new if isinstance(item, tuple))
        programs += (traffic.actors[number].acts[index].program for number, index in ended)
        past |= new
    # after a condition, `time` is the delay from it
    return begin.time + max(item for item in past if isinstance(item, float)), past


def follows(traffic: FileTraffic, begin: Moment, span: Span) -> bool:
    """Whether a moment certainly comes at or after the end of an element."""
    earliest, past = _past_at(traffic, begin)
    if span.begin.known:
        return span.end - SAME <= earliest
    # all that is past at the element's end must be past at the moment, too; a moment that never
    # comes is after everything
    _, past_at_end = _past_at(traffic, Moment(0.0, span.ended))
    return earliest == NEVER or (bool(span.ended) and past_at_end <= past)


def unended_move(
    traffic: FileTraffic, entity: Entity, begin: Moment, kinds: tuple[int, ...]
) -> Move | None:
    """The entity's last move of some kinds so far, if it may not have ended at a moment.

    None where the moment and the begins of all these moves are times: `Entity.busy_until` and
    `Entity.steady` then give its end.
    """
    earlier = [k for k, act in enumerate(entity.acts)
               if act.kind in kinds and not changes_nothing(act)]  # fmt: skip
    if not earlier or (begin.known and not any(entity.acts[k].program for k in earlier)):
        return None
    last = entity.number, earlier[-1]
    return None if last in _past_at(traffic, begin)[1] else last


def changes_speed(entity: Entity, begin: Moment) -> bool:
    """Whether an earlier change of speed, begun at a time, still lasts when a move begins."""
    return begin.known and begin.time < entity.steady - SAME


def depend_on(
    traffic: FileTraffic, target: Node, mover: Entity, begin: Moment, kinds: tuple[int, ...]
) -> Entity:
    """The entity to which a move is relative. Notes that the move depends on it (`note_plan`).

    target: element that refers to this entity.
    mover: entity that moves.
    kinds: as in `note_plan`.
    """
    other = traffic.places.referred(target)
    if other is not mover:
        if kinds == ACROSS and (other.moved != 0.0 or other.leaves_lane):
            raise target.fault(f"`{other.name}`, to which it is relative, also moves across")
        note_plan(other, begin, kinds, target, mover.next_move)
    return other


def note_plan(
    entity: Entity, begin: Moment, kinds: tuple[int, ...], element: Node, move: Move
) -> None:
    """Note that a move was planned from an entity's acts so far.

    `add_act` refuses a later act of the entity that may begin before the move does.

    begin: when the move begins.
    kinds: kinds of acts on which the move depends, `SPEEDS` or `ACROSS`.
    element: that a fault names.
    move: the planned move.
    """
    fault = element.fault(
        f"`{entity.name}`, on which it depends, may move before by an event below it in the "
        "file, which is not supported"
    )
    entity.plans.append(PlannedMove(begin.time if begin.known else NEVER, kinds, fault, move))


def match_vehicle(
    traffic: FileTraffic, entity: Entity, begin: Moment, *table: tuple[float, float]
) -> Span:
    """Keep a speed or a position relative to another vehicle's at every instant.

    table: as in `played.PLAY` under `match`: three or five pairs.
    """
    # the other vehicle's number, and what is kept: above 0 a position, else a speed
    number, keeps_place = int(table[0][0]), table[1][1] > 0.0
    other = traffic.ego if number == EGO else traffic.actors[number]
    # `played` counts places, and the other's speed, along the road in the ego's direction
    for it in (other, entity) if keeps_place else (other,):
        if it.leaves_lane or math.cos(it.frame.heading) < 0.0:
            what = "distance" if keeps_place else "speed"
            raise it.element.fault(
                f"it must drive along the road as the ego does: `{entity.name}` keeps its {what} "
                f"relative to `{other.name}`"
            )
    if traffic.frame.line and math.cos(entity.frame.heading) < 0.0:
        raise entity.element.fault(
            "a speed relative to another's is not supported of an oncoming vehicle on a curve"
        )
    span = add_act(traffic, entity, begin, Act(MATCH, table=table), NEVER)
    # `played` matches after every step only where an act waits for a condition (`World.waits`): so
    # a time becomes a condition
    if begin.known:
        entity.acts[-1] = entity.acts[-1]._replace(begin=0.0, program=from_time(begin.time))
    return span
