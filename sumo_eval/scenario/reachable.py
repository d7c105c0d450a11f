"""Whether a condition can become true at all, as far as that is known before a drive.

Every number of the moment is taken as the range that it can ever have (time up to the case's end,
the ego between its start and the end of the road, distances not below 0, a script no faster than
its fastest speed); sums, products and comparisons of ranges are ranges again. What comes out false
for all of them never holds. What may hold still need not: that depends on who drives.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from sumo_eval.scenario import played
from sumo_eval.scenario.concrete import Actor, ConcreteScenario
from sumo_eval.scenario.undisturbed import tracks

Range = tuple[float, float]
_ANY: Range = (-math.inf, math.inf)
_NOT_NEGATIVE: Range = (0.0, math.inf)
_LOOKS = 600  # at a script until the time limit
_HEADWAY = 2.0  # s
_CREEPS = 0.1  # m/s, no ego counts as slower
_PAST = 5.0  # m that an ego may be past the end of its road at the end of a step


def never_begin(concrete: ConcreteScenario, time_limit: float) -> list[tuple[Actor, int]]:
    """The moves, with their vehicles, whose conditions can never hold within `time_limit` s."""
    ego, road = concrete.ego, concrete.road
    known = {
        (played.TIME, 0): (0.0, time_limit),
        (played.X, played.EGO): (ego.x, road.length + _PAST),
        (played.Y, played.EGO): (road.right_edge, road.left_edge),
    }
    for number, actor in enumerate(concrete.actors):
        fastest = math.inf if road.bent else _fastest(actor)
        known[played.ALONG, number] = (-fastest, fastest)
    acts = {
        (number, index): act
        for number, actor in enumerate(concrete.actors)
        for index, act in enumerate(actor.acts)
    }
    keeps = {place for place, act in acts.items() if act.kind == played.KEEP}
    endless: set[tuple[int, int]] = set()
    while True:  # a move that waits for the end of one that never ends never begins either
        never = {
            place
            for place, act in acts.items()
            if act.program and not _may_hold(act.program, known, endless)
        }
        if never | keeps <= endless:
            return [(concrete.actors[number], index) for number, index in sorted(never)]
        endless |= never | keeps


def leaves_at(
    concrete: ConcreteScenario, end: float, time_limit: float
) -> Iterator[tuple[str, float]]:
    """The vehicles whose scripts lead to x = `end`, m, within `time_limit` s and before the ego is
    done; and when.

    The ego keeps its speed, or follows a slower vehicle at a headway of `_HEADWAY`. A vehicle that
    reacts counts with the speed that it begins with.
    """
    ego, road = concrete.ego, concrete.road
    if not concrete.actors:
        return
    alone = (road.length - ego.x) / max(ego.speed, _CREEPS)
    step = time_limit / _LOOKS
    # the ego's body moves nothing here
    tracked = tracks([concrete], [(0.0, 0.0)], step, time_limit).others[0, :, :, 0]
    for actor, x in zip(concrete.actors, tracked, strict=True):
        beyond = x > end - 0.5 * actor.length
        if not beyond.any():
            continue
        time, speed = float(np.argmax(beyond)) * step, actor.start.speed
        held_up = speed < ego.speed and end - actor.length - _HEADWAY * speed < road.length
        if time < alone or held_up:
            yield actor.name, time


def _fastest(actor: Actor) -> float:
    """The highest speed that a script has on a straight road, m/s; inf where SUMO drives, or it
    moves across.
    """
    if actor.start.lateral_speed != 0.0 or actor.model is not None:
        return math.inf
    speeds = [actor.start.speed, 0.0]
    for act in actor.acts:
        if act.kind <= played.COSINE or act.kind in (played.FOLLOW, played.MATCH):
            return math.inf
        profiled = act.kind in (played.BY_TIME, played.BY_PLACE)
        speeds += [speed for _, speed in act.table] if profiled else [act.speed]
    return max(speeds)


def _may_hold(
    program: Sequence[tuple[int, int, int, float]],
    known: dict[tuple[int, int], Range],
    endless: set[tuple[int, int]],
) -> bool:
    stack: list[Range] = []
    for op, one, two, value in program:
        if op == played.VALUE:
            stack.append((value, value))
        elif op == played.ENDED:
            stack.append((0.0, 0.0 if (one, two) in endless else 1.0))
        elif op in (played.DISTANCE, played.TTC, played.THW, played.DEPARTED):
            stack.append(_NOT_NEGATIVE)
        elif op == played.TIME or op <= played.GAP:
            stack.append(known.get((op, one), _ANY))
        elif op in (played.NEGATE, played.ABSOLUTE):
            low, high = stack.pop()
            if op == played.NEGATE or high < 0.0:
                low, high = -high, -low
            elif low < 0.0:  # of both signs
                low, high = 0.0, max(-low, high)
            stack.append((low, high))
        else:
            second, first = stack.pop(), stack.pop()
            stack.append(_joined(op, first, second))
    return stack[0][1] > 0.0


def _joined(op: int, first: Range, second: Range) -> Range:
    """The range of what two ranges come to; of comparisons 1 where it may hold, 0 where it
    cannot.
    """
    (a, b), (c, d) = first, second
    holds = {
        played.BELOW: a < d,
        played.AT_MOST: a <= d,
        played.AND: min(b, d),
        played.OR: max(b, d),
    }
    if op in holds:
        return 0.0, float(holds[op])
    if op == played.DIVIDE and c <= 0.0 <= d:
        return _ANY
    corners = [played.arithmetic(op, x, y) for x in first for y in second]
    # of unbounded ranges some corners are undefined; the others bound what lies between
    known = [corner for corner in corners if not math.isnan(corner)]
    return (min(known), max(known)) if known else _ANY
