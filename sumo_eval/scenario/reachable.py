"""Two checks of a point before any drive: which moves can never begin, because their condition can
never become true, and which vehicles leave the road.

The reader of scenario files refuses the former and reports the latter. The reader of OpenSCENARIO
checks the former only, and accepts such a move if it would change nothing.

Each quantity in a condition is replaced by the range of its values in a drive: time up to the
case's time limit, the ego between its start and x = `road.length`, where cases end, distances not
below 0, a script no faster than its fastest speed. Sums, products and comparisons of ranges are
ranges again. A condition that is false for all of these values never holds. Any other condition may
hold: that depends on the ADS.

Users: `extras/openscenario/logical.py`, `scenario/file.py`.
"""

from collections.abc import Iterator
from math import inf, isnan

import numpy as np

from sumo_eval.scenario import played
from sumo_eval.scenario.concrete import Actor, ConcreteScenario
from sumo_eval.scenario.undisturbed import tracks

Range = tuple[float, float]
"""The least and the largest value of a quantity; of a condition 0 is false and 1 is true."""
Ranges = dict[tuple[int, int], Range]
"""Range by (operation, vehicle), as in a step of `played.Program`. `TIME` is of no vehicle: its
second number is 0."""
_ANY: Range = (-inf, inf)
_NOT_NEGATIVE: Range = (0.0, inf)
_LOOKS = 600  # times at which a script is sampled, from the start to the time limit
_HEADWAY = 2.0  # s, assumed of an ego behind a slower vehicle
_CREEPS = 0.1  # m/s, lower bound of the ego's speed, which divides
_PAST = 5.0  # m that an ego may be past x = `road.length` at the end of its last step
_ENDLESS = played.KEEP, played.FOLLOW, played.MATCH  # kinds of moves that never end


def never_begin(concrete: ConcreteScenario, time_limit: float) -> list[tuple[Actor, int]]:
    """Moves whose conditions can never hold within a time limit: (vehicle, index of the move).

    time_limit: s.
    """
    ranges = _known_ranges(concrete, time_limit)
    acts = {
        (number, index): act
        for number, actor in enumerate(concrete.actors)
        for index, act in enumerate(actor.acts)
    }
    endless = {move for move, act in acts.items() if act.kind in _ENDLESS}
    # A move that waits for another's end begins only once that may end. So assume that no condition
    # holds, and take out the moves that may begin, round by round: those that wait for their own
    # end, directly or through others, stay.
    never = {move for move, act in acts.items() if act.program}
    while True:
        still = {
            move for move in never if not _may_hold(acts[move].program, ranges, endless | never)
        }
        if still == never:
            return [(concrete.actors[number], index) for number, index in sorted(never)]
        never = still


def _known_ranges(concrete: ConcreteScenario, time_limit: float) -> Ranges:
    """Ranges of the quantities that are known before a drive."""
    road = concrete.road
    ranges = {
        (played.TIME, 0): (0.0, time_limit),
        (played.X, played.EGO): (concrete.ego.x, road.length + _PAST),
        (played.Y, played.EGO): (road.right_edge, road.left_edge),
    }
    for number, actor in enumerate(concrete.actors):
        fastest = inf if road.bent else _fastest(actor)
        ranges[played.ALONG, number] = (-fastest, fastest)
    return ranges


def leaves_at(concrete: ConcreteScenario, time_limit: float) -> Iterator[tuple[str, float]]:
    """Vehicles whose scripts leave the road before the ego's case ends: (name, time, s).

    time_limit: of the case, s.

    The ego is assumed to keep its speed, or to follow a slower vehicle at a headway of `_HEADWAY`.
    A vehicle that a SUMO model drives is assumed to keep its first speed.
    """
    ego, road = concrete.ego, concrete.road
    if not concrete.actors:
        return
    # time at which an unhindered ego ends the case, at x = `road.length`, s
    ego_time = (road.length - ego.x) / max(ego.speed, _CREEPS)
    step = time_limit / _LOOKS
    # (0, 0): length and width of the ego. Without them, conditions on distances from its body are
    # a few metres off. [0, :, :, 0]: x of the only case's actors, (actors, times)
    positions = tracks([concrete], [(0.0, 0.0)], step, time_limit).others[0, :, :, 0]
    for actor, x in zip(concrete.actors, positions, strict=True):
        beyond = x > road.end - 0.5 * actor.length
        if not beyond.any():
            continue
        time = float(np.argmax(beyond)) * step
        speed = actor.start.speed
        # A slower vehicle holds the ego up. `ego_x`: where the ego behind it is when it leaves.
        ego_x = road.end - actor.length - _HEADWAY * speed
        held_up = speed < ego.speed and ego_x < road.length
        if time < ego_time or held_up:
            yield actor.name, time


def _fastest(actor: Actor) -> float:
    """The highest speed of a script along a straight road, m/s.

    It is inf where no bound is known: where a SUMO model drives, and where the vehicle moves across
    the road or at the speed of another.
    """
    if actor.start.lateral_speed != 0.0 or actor.model is not None:
        return inf
    speeds = [actor.start.speed]
    for act in actor.acts:
        # up to COSINE: moves across the road
        if act.kind <= played.COSINE or act.kind in (played.FOLLOW, played.MATCH):
            return inf
        has_profile = act.kind in (played.BY_TIME, played.BY_PLACE)
        speeds += [speed for _, speed in act.table] if has_profile else [act.speed]
    return max(speeds)


def _may_hold(program: played.Program, ranges: Ranges, endless: set[played.Move]) -> bool:
    """Whether a condition may hold.

    program: its operations on a stack, as in `played.Act`.
    ranges: of the quantities that are known; any other has any value.
    endless: moves that never end.
    """
    stack: list[Range] = []
    for op, one, two, value in program:  # one: a vehicle; two: another vehicle, or a move
        if op == played.VALUE:
            stack.append((value, value))
        elif op == played.ENDED:
            stack.append((0.0, 0.0 if (one, two) in endless else 1.0))
        elif op in (played.DISTANCE, played.TTC, played.THW, played.DEPARTED):
            stack.append(_NOT_NEGATIVE)
        elif op <= played.GAP:  # time, or a value of one vehicle or between two
            stack.append(ranges.get((op, one), _ANY))
        elif op in (played.NEGATE, played.ABSOLUTE):
            low, high = stack.pop()
            if op == played.NEGATE or high < 0.0:
                low, high = -high, -low
            elif low < 0.0:  # the absolute of a range of both signs
                low, high = 0.0, max(-low, high)
            stack.append((low, high))
        else:
            second, first = stack.pop(), stack.pop()
            stack.append(_joined(op, first, second))
    _, upper = stack[0]
    return upper > 0.0


def _joined(op: int, first: Range, second: Range) -> Range:
    """Range of the result of an operation on two values; of a condition (0, 1) if it may hold, else
    (0, 0).
    """
    (low, high), (second_low, second_high) = first, second
    may_hold = {
        played.BELOW: low < second_high,
        played.AT_MOST: low <= second_high,
        # operands are conditions: `high` is 1 if one may hold
        played.AND: min(high, second_high),
        played.OR: max(high, second_high),
    }
    if op in may_hold:
        return 0.0, float(may_hold[op])
    if op == played.DIVIDE and second_low <= 0.0 <= second_high:
        return _ANY
    # the extremes are at ends of the ranges; with infinite ends, some results are undefined
    corners = [played.arithmetic(op, x, y) for x in first for y in second]
    defined = [corner for corner in corners if not isnan(corner)]
    return (min(defined), max(defined)) if defined else _ANY
