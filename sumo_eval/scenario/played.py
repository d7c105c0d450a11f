"""Scripts that depend on what happens: moves that begin when a condition holds, paths, speeds by
time or by place.

A played vehicle drives along a line: straight on in its heading, or a path of points. Its speed is
a list of pieces of constant jerk, its lateral moves are offsets across the line. Every move is a
function of the time since it began, so a move that begins within a step has the place that it would
have had with any other step. Records are plain numbers, and the loops over them are kernels: a case
has the same bits alone and beside others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_eval.kernels import kernel, rows
from sumo_eval.scenario.motion import along_heading, lateral, lateral_acceleration, lateral_speed
from sumo_eval.scenario.road.reference_line import line_at, to_frame

Records = NDArray[Any]

# kinds of moves across the line, as in `scenario.motion`
SMOOTH, CONSTANT, SINUS, COSINE = 0, 1, 2, 3
SPEED, BY_TIME, BY_PLACE, PATH, KEEP = 10, 11, 12, 13, 14  # kinds of moves along it
FOLLOW = 15  # from its begin on SUMO drives the vehicle
# what has become of a move: its begin is not known, is to come, has been
WAITS, KNOWN, BEGUN = 0, 1, 2
ALWAYS, EGO = -1, -1
AT_ONCE, HANDED_OVER = 1, 2  # since when SUMO drives a vehicle

(
    VALUE, TIME, X, Y, ALONG, ACROSS, GAP, DISTANCE, TTC, THW, ENDED, ADD, SUBTRACT, MULTIPLY,
    DIVIDE, NEGATE, SMALLER,
    LARGER, ABSOLUTE, BELOW, AT_MOST, AND, OR, DEPARTED,
) = range(24)  # fmt: skip
"""Operations of a condition's program, on a stack."""
DEEPEST = 24  # values on the stack of a condition

ACT = np.dtype(
    [
        *(
            (name, "f8")
            for name in (
                "begin",
                "duration",
                "speed",
                "offset",
                "acceleration",
                "jerk",
                "delay",
                "end",
            )
        ),
        *((name, "i8") for name in ("kind", "first", "count", "program", "steps", "state")),
    ]
)
"""A move.

begin: s, inf while it waits; delay: s after its condition holds. speed: the one it leads to, m/s,
or of a lateral move its own. first, count: its places in `TABLE`; program, steps: of its condition,
in `PROGRAM`.
"""
PIECE = np.dtype([(name, "f8") for name in ("duration", "acceleration", "jerk", "speed")])
"""A piece of motion: acceleration at its begin, jerk, and the speed at its end."""
TABLE = np.dtype([("one", "f8"), ("two", "f8")])
"""Points of a path (x, y), knots of a profile (time or place, speed), or where a recorded ego was
(x, y)."""
PROGRAM = np.dtype([("value", "f8"), ("op", "i8"), ("one", "i8"), ("two", "i8")])
PLAY = np.dtype(
    [
        *(
            (name, "f8")
            for name in (
                "x",
                "y",
                "heading",
                "line_s",
                "line_time",
                "since",
                "s",
                "v",
                "first_begin",
            )
        ),
        *(
            (name, "i8")
            for name in ("acts", "pieces", "path", "points", "slides", "model", "on_map")
        ),
    ]
)
"""Present motion of a vehicle.

x, y, heading: beginning and direction of its line; on_map: 1 if these are on the map of a curved
road, 0 if along and across the road. line_s, line_time: distance driven and time when the line
began. since, s, v: time from which its pieces count, distance and speed then. first_begin: begin of
its first move, s. model: `AT_ONCE` if SUMO drives it from the start, `HANDED_OVER` if it does now.
"""


class Act(NamedTuple):
    """A move of a played vehicle as plain numbers; fields as in `ACT`.

    program: steps (op, one, two, value).
    """

    kind: int
    begin: float = 0.0
    duration: float = 0.0
    speed: float = 0.0
    offset: float = 0.0
    acceleration: float = math.inf
    jerk: float = math.inf
    table: tuple[tuple[float, float], ...] = ()
    program: tuple[tuple[int, int, int, float], ...] = ()
    name: str = ""

    @property
    def timed(self) -> bool:
        """Whether its begin and its end are known before the drive: a move across, or braking to a
        standstill.
        """
        stops = self.kind == SPEED and self.speed == 0.0
        return not self.program and (stops or self.kind in (SMOOTH, CONSTANT, COSINE))


# -- along the line --------------------------------------------------------------------------------


@kernel
def driven(play: Any, pieces: Any, time: float) -> tuple[float, float, float]:
    """Distance m, speed m/s and acceleration m/s2 along the line at a time."""
    s, v, left = play.s, play.v, time - play.since
    for k in range(play.pieces):
        piece = pieces[k]
        d = min(left, piece.duration)
        s += d * (v + d * (0.5 * piece.acceleration + d * piece.jerk / 6.0))
        if left < piece.duration:
            speed = v + d * (piece.acceleration + 0.5 * d * piece.jerk)
            return s, max(speed, 0.0), piece.acceleration + d * piece.jerk
        v = piece.speed
        left -= d
    return s + v * left, v, 0.0


@kernel
def _put(
    pieces: Any, k: int, duration: float, acceleration: float, jerk: float, speed: float
) -> int:
    if duration <= 0.0:
        return k
    pieces[k].duration, pieces[k].acceleration, pieces[k].jerk, pieces[k].speed = (
        duration,
        acceleration,
        jerk,
        speed,
    )
    return k + 1


@kernel
def _speed_up(pieces: Any, v: float, act: Any) -> int:
    """Pieces from speed v to the act's, the acceleration building up at its jerk and ending at
    once; how many.
    """
    change = abs(act.speed - v)
    sign = 1.0 if act.speed > v else -1.0
    rise = act.acceleration / act.jerk
    in_rise = 0.5 * act.acceleration * rise
    if rise > 0.0 and change <= in_rise:
        return _put(pieces, 0, math.sqrt(2.0 * change / act.jerk), 0.0, sign * act.jerk, act.speed)
    k = 0
    if rise > 0.0:
        k = _put(pieces, k, rise, 0.0, sign * act.jerk, v + sign * in_rise)
    return _put(
        pieces, k, (change - in_rise) / act.acceleration, sign * act.acceleration, 0.0, act.speed
    )


@kernel
def _follow_profile(pieces: Any, v: float, x: float, act: Any, table: Any) -> int:
    """Pieces of constant acceleration through the knots of a profile; how many."""
    k, at = 0, (0.0 if act.kind == BY_TIME else x)
    for q in range(act.first, act.first + act.count):
        there, speed = table[q].one, table[q].two
        apart = there - at
        if apart <= 0.0:
            continue
        if act.kind == BY_TIME:
            duration = apart
        elif v + speed > 0.0:
            duration = 2.0 * apart / (v + speed)
        else:
            duration = math.inf
        if math.isinf(duration):
            return _put(pieces, k, duration, 0.0, 0.0, 0.0)
        k = _put(pieces, k, duration, (speed - v) / duration, 0.0, speed)
        at, v = there, speed
    return k


@kernel
def lasts(play: Any, pieces: Any) -> float:
    """How long the pieces last, s."""
    total = 0.0
    for k in range(play.pieces):
        total += pieces[k].duration
    return total


# -- where it is -----------------------------------------------------------------------------------


@kernel
def on_line(play: Any, table: Any, s: float) -> tuple[float, float, float]:
    """x, y and direction of the line, s m along it."""
    x, y, heading = play.x, play.y, play.heading
    left = s - play.line_s
    for q in range(play.path, play.path + play.points):
        dx, dy = table[q].one - x, table[q].two - y
        length = math.sqrt(dx * dx + dy * dy)
        if length == 0.0:
            continue
        heading = math.atan2(dy, dx)
        if left < length:
            return x + dx * left / length, y + dy * left / length, heading
        left -= length
        x, y = table[q].one, table[q].two
    return x + left * math.cos(heading), y + left * math.sin(heading), heading


@kernel
def place(
    other: Any, play: Any, acts: Any, pieces: Any, table: Any, time: float, line: Any
) -> None:
    """Put a played vehicle where it is at a time.

    line: the road's, of no knots if it is straight.

    On a curve, position and line are along and across the road, as scripts are: a metre along the
    road's line is 1 - curvature y metres of ground, so heading and speed are those over the ground.
    A position on the map is sought in the frame near the last one; its heading does not jump.
    """
    s, v, a = driven(play, pieces, time)
    x, y, heading = on_line(play, table, s)
    aside, across, sideways = 0.0, 0.0, 0.0
    for q in range(play.acts):
        act = acts[q]
        if act.kind <= COSINE and act.state == BEGUN and act.begin >= play.line_time:
            aside += lateral(act, time)
            across += lateral_speed(act, time)
            sideways += lateral_acceleration(act, time)
    if aside != 0.0:
        x, y = x - aside * math.sin(heading), y + aside * math.cos(heading)
    near, last = other.x, other.heading
    other.x, other.y = x, y
    if play.slides or across == 0.0:
        other.heading, other.speed, other.across, other.acceleration = heading, v, across, a
    else:
        other.heading, other.across = heading + math.atan2(across, v), 0.0
        other.speed = math.sqrt(v * v + across * across)
        other.acceleration = along_heading(v, across, a, sideways)
    if not len(line):
        return
    if play.on_map:
        other.x, other.y, turned, _ = to_frame(line, x, y, other.heading, near)
        other.heading = turned + 2.0 * math.pi * math.floor((last - turned) / (2.0 * math.pi) + 0.5)
    else:
        _over_ground(other, line)


@kernel
def _over_ground(other: Any, line: Any) -> None:
    """Turn heading and speeds along and across the line into those over the ground."""
    _, _, _, curvature = line_at(line, other.x)
    inner = 1.0 - curvature * other.y
    c, s = math.cos(other.heading) * inner, math.sin(other.heading)
    stretched = math.sqrt(c * c + s * s)
    c, s = c / stretched, s / stretched
    along = inner * (other.speed * math.cos(other.heading) - other.across * math.sin(other.heading))
    left = other.speed * math.sin(other.heading) + other.across * math.cos(other.heading)
    if other.heading != 0.0:
        other.heading = math.atan2(s, c)
    other.speed, other.across = along * c + left * s, left * c - along * s
    other.acceleration *= stretched


# -- conditions ------------------------------------------------------------------------------------


@kernel
def _of(body: Any, what: int) -> float:
    """One number of a body, or of what it was before the step."""
    if what == X:
        return float(body.x)
    if what == Y:
        return float(body.y)
    if what == ALONG:
        return float(body.speed * math.cos(body.heading) - body.across * math.sin(body.heading))
    return float(body.speed * math.sin(body.heading) + body.across * math.cos(body.heading))


@kernel
def _half_along(body: Any, length: float, width: float) -> float:
    return 0.5 * (length * abs(math.cos(body.heading)) + width * abs(math.sin(body.heading)))


@kernel
def _between(
    what: int,
    one: Any,
    two: Any,
    one_length: float,
    one_width: float,
    two_length: float,
    two_width: float,
) -> float:
    """A number of two bodies, the first seen as the one that follows: gap m, distance m, TTC s, THW
    s.
    """
    if what == DISTANCE:
        dx, dy = two.x - one.x, two.y - one.y
        return math.sqrt(dx * dx + dy * dy)
    gap = (
        two.x
        - one.x
        - _half_along(one, one_length, one_width)
        - _half_along(two, two_length, two_width)
    )
    if what == GAP:
        return float(gap)
    speed = _of(one, ALONG)
    if what == THW:
        return float(gap / speed) if gap > 0.0 and speed > 0.0 else math.inf
    closing = speed - _of(two, ALONG)
    return float(gap / closing) if gap > 0.0 and closing > 0.0 else math.inf


@kernel
def _compare(stack: Any, k: int, margin_before: float, margin: float, equal: int) -> None:
    """Write to the stack whether a margin was, and is, positive, and at which share of the step it
    became so.
    """
    was = margin_before > 0.0 or (equal != 0 and margin_before == 0.0)
    holds = margin > 0.0 or (equal != 0 and margin == 0.0)
    stack[k, 0], stack[k, 1], stack[k, 2] = 1.0 if was else 0.0, 1.0 if holds else 0.0, 0.0
    if holds and not was:
        share = -margin_before / (margin - margin_before)
        stack[k, 2] = share if 0.0 <= share <= 1.0 else 1.0


@kernel
def holds_from(
    program: Any,
    act: Any,
    ego: Any,
    others: Any,
    acts: Any,
    table: Any,
    now: float,
    before: float,
    stack: Any,
) -> float:
    """Share of the step from `before` to `now` at which a condition came to hold, 0 if it held
    before; -1: it does not.

    Numbers are interpolated linearly between both ends of the step. Where a number was not defined,
    the end counts.
    """
    k = -1
    for q in range(act.program, act.program + act.steps):
        it = program[q]
        op = it.op
        if op == VALUE:
            k += 1
            stack[k, 0], stack[k, 1] = it.value, it.value
        elif op == TIME:
            k += 1
            stack[k, 0], stack[k, 1] = before, now
        elif op <= ACROSS:
            k += 1
            if it.one == EGO:
                stack[k, 0], stack[k, 1] = _of(ego.before, op), _of(ego, op)
            else:
                other = others[it.one]
                stack[k, 0], stack[k, 1] = _of(other.before, op), _of(other, op)
        elif op <= THW:
            k += 1
            if it.one == EGO:
                _pair(stack, k, op, ego, others[it.two])
            elif it.two == EGO:
                _pair(stack, k, op, others[it.one], ego)
            else:
                _pair(stack, k, op, others[it.one], others[it.two])
        elif op == DEPARTED:
            k += 1
            stack[k, 0] = departed(act, table, ego.before.x, ego.before.y, before)
            stack[k, 1] = departed(act, table, ego.x, ego.y, now)
        elif op == ENDED:
            k += 1
            end = acts[it.one][it.two].end
            _compare(stack, k, before - end, now - end, 1)
        elif op == NEGATE:
            stack[k, 0], stack[k, 1] = -stack[k, 0], -stack[k, 1]
        elif op == ABSOLUTE:
            stack[k, 0], stack[k, 1] = abs(stack[k, 0]), abs(stack[k, 1])
        elif op in (BELOW, AT_MOST):
            k -= 1
            was, isnow = stack[k + 1, 0] - stack[k, 0], stack[k + 1, 1] - stack[k, 1]
            _compare(stack, k, was, isnow, 1 if op == AT_MOST else 0)
        elif op in (AND, OR):
            k -= 1
            _join(stack, k, op)
        else:
            k -= 1
            for end in range(2):
                stack[k, end] = _arithmetic(op, stack[k, end], stack[k + 1, end])
    return float(stack[0, 2]) if stack[0, 1] > 0.0 else -1.0


@kernel
def departed(act: Any, table: Any, x: float, y: float, time: float) -> float:
    """How far a place is from where the recorded ego was at a time, m; the end of its recording
    counts after it.

    act: a move whose places in `table` are those of the recorded ego, `duration` s apart.
    """
    at = min(max(time / act.duration, 0.0), act.count - 1.0)
    first = min(int(at), act.count - 2)
    share = at - first
    one, two = table[act.first + first], table[act.first + first + 1]
    dx = x - (one.one + share * (two.one - one.one))
    dy = y - (one.two + share * (two.two - one.two))
    return math.sqrt(dx * dx + dy * dy)


@kernel
def _pair(stack: Any, k: int, op: int, one: Any, two: Any) -> None:
    """Write a number of two bodies to the stack, as it was before the step and as it is."""
    stack[k, 0] = _between(op, one.before, two.before, one.length, one.width, two.length, two.width)
    stack[k, 1] = _between(op, one, two, one.length, one.width, two.length, two.width)


@kernel
def _join(stack: Any, k: int, op: int) -> None:
    """And, or of the two conditions on top of the stack: it holds from the later, or the earlier,
    of both instants.
    """
    a, b = stack[k, 1] > 0.0, stack[k + 1, 1] > 0.0
    share_a, share_b = stack[k, 2], stack[k + 1, 2]
    if op == AND:
        stack[k, 0] = min(stack[k, 0], stack[k + 1, 0])
        stack[k, 1] = 1.0 if a and b else 0.0
        stack[k, 2] = max(share_a, share_b)
        return
    stack[k, 0] = max(stack[k, 0], stack[k + 1, 0])
    stack[k, 1] = 1.0 if a or b else 0.0
    if a and b:
        stack[k, 2] = min(share_a, share_b)
    elif b:
        stack[k, 2] = share_b


@kernel
def _arithmetic(op: int, a: float, b: float) -> float:
    if op == ADD:
        return a + b
    if op == SUBTRACT:
        return a - b
    if op == MULTIPLY:
        return a * b
    if op == DIVIDE:
        return a / b if b != 0.0 else math.nan
    if op == SMALLER:
        return min(a, b)
    return max(a, b)


# -- what begins -----------------------------------------------------------------------------------


@kernel
def _begin(play: Any, act: Any, pieces: Any, table: Any) -> None:
    """A move begins: what it leads from is where the vehicle is at that instant."""
    act.state = BEGUN
    play.first_begin = min(play.first_begin, act.begin)
    if act.kind <= COSINE:
        act.end = act.begin + act.duration
        return
    if act.kind == FOLLOW:
        play.model = HANDED_OVER
        act.end = math.inf
        return
    s, v, _ = driven(play, pieces, act.begin)
    if act.kind == PATH:
        x, y, heading = on_line(play, table, s)
        play.x, play.y, play.heading, play.line_s, play.line_time = x, y, heading, s, act.begin
        play.path, play.points = act.first, act.count
        act.end = math.inf  # until it is there, which depends on its speed
        return
    x, _, _ = on_line(play, table, s)
    play.since, play.s, play.v = act.begin, s, v
    if act.kind == SPEED:
        play.pieces = _speed_up(pieces, v, act)
    elif act.kind == KEEP:
        play.pieces = 0
    else:
        play.pieces = _follow_profile(pieces, v, x, act, table)
    act.end = act.begin + lasts(play, pieces)


@kernel
def begin_due(play: Any, acts: Any, pieces: Any, table: Any, time: float) -> int:
    """Begin all moves that are due by a time, in the order of their begins; how many."""
    count = 0
    while True:
        chosen = -1
        for q in range(play.acts):
            if acts[q].state == KNOWN and acts[q].begin <= time and (
                chosen < 0 or acts[q].begin < acts[chosen].begin
            ):  # fmt: skip
                chosen = q
        if chosen < 0:
            return count
        _begin(play, acts[chosen], pieces, table)
        count += 1


@kernel
def _path_ended(play: Any, acts: Any, pieces: Any, table: Any, before: float, now: float) -> None:
    """Put down when the path that is driven came to its last point, if it did in this step."""
    for q in range(play.acts):
        act = acts[q]
        if (
            act.kind == PATH
            and act.state == BEGUN
            and math.isinf(act.end)
            and act.first == play.path
        ):
            length, x, y = 0.0, play.x, play.y
            for p in range(play.path, play.path + play.points):
                dx, dy = table[p].one - x, table[p].two - y
                length += math.sqrt(dx * dx + dy * dy)
                x, y = table[p].one, table[p].two
            s, _, _ = driven(play, pieces, now)
            was, _, _ = driven(play, pieces, before)
            if s - play.line_s >= length:
                moved = s - was
                share = (length - (was - play.line_s)) / moved if moved > 0.0 else 1.0
                act.end = before + min(max(share, 0.0), 1.0) * (now - before)


@kernel
def wake(
    ego: Any, others: Any, plays: Any, acts: Any, pieces: Any, table: Any, program: Any,
    now: float, before: float,
    stack: Any, line: Any,
) -> int:  # fmt: skip
    """Begin the waiting moves of a case whose conditions hold at the end of a step; how many began.

    Vehicles whose moves began are placed again.
    """
    count = 0
    for j in range(len(others)):
        for q in range(plays[j].acts):
            act = acts[j][q]
            if act.state == WAITS:
                share = holds_from(program[j], act, ego, others, acts, table[j], now, before, stack)
                if share >= 0.0:
                    act.begin = before + share * (now - before) + act.delay
                    act.state = KNOWN
    for j in range(len(others)):
        play = plays[j]
        if play.model:
            continue
        begun = begin_due(play, acts[j], pieces[j], table[j], now)
        _path_ended(play, acts[j], pieces[j], table[j], before, now)
        if begun:
            place(others[j], play, acts[j], pieces[j], table[j], now, line)
            count += begun
    return count


# -- rows ------------------------------------------------------------------------------------------


@rows
def begin_play_rows(
    egos: Records, others: Records, plays: Records, acts: Records, pieces: Records, table: Records,
    program: Records,
    stack: NDArray[np.float64], line: Records,
) -> None:  # fmt: skip
    """Begin what begins at the start of the cases, where every vehicle is as it starts."""
    for i in range(len(egos)):
        wake(
            egos[i],
            others[i],
            plays[i],
            acts[i],
            pieces[i],
            table[i],
            program[i],
            0.0,
            0.0,
            stack,
            line,
        )
        for j in range(len(others[i])):
            if plays[i][j].model == 0:
                place(others[i][j], plays[i][j], acts[i][j], pieces[i][j], table[i][j], 0.0, line)


@rows
def play_rows(
    egos: Records, others: Records, plays: Records, acts: Records, pieces: Records, table: Records,
    steps: int,
    step: float, line: Records,
) -> None:  # fmt: skip
    """Move the actors of every live case to the end of `steps` steps."""
    for i in range(len(egos)):
        if egos[i].live == 0 or egos[i].reason != 0:
            continue
        now = (steps - egos[i].begun) * step
        for j in range(len(others[i])):
            play = plays[i][j]
            if play.model:
                continue
            begin_due(play, acts[i][j], pieces[i][j], table[i][j], now)
            place(others[i][j], play, acts[i][j], pieces[i][j], table[i][j], now, line)


@rows
def wake_rows(
    egos: Records, others: Records, plays: Records, acts: Records, pieces: Records, table: Records,
    program: Records,
    now: float, before: float, stack: NDArray[np.float64], line: Records,
) -> None:  # fmt: skip
    """Look at the conditions of every live case at the end of a step from `before` to `now`, s."""
    for i in range(len(egos)):
        if egos[i].live == 0 or egos[i].reason != 0:
            continue
        wake(
            egos[i],
            others[i],
            plays[i],
            acts[i],
            pieces[i],
            table[i],
            program[i],
            now,
            before,
            stack,
            line,
        )


class Players(NamedTuple):
    """The records of played vehicles: (n, m) and what each of them has."""

    plays: Records
    acts: Records
    pieces: Records
    table: Records
    program: Records

    def of(self, chosen: NDArray[np.intp]) -> Players:
        """Those of these rows."""
        return Players(*(array[chosen] for array in self))

    def with_row(self, row: int, other: Players) -> Players:
        """These with the only row of others in place of one, wide enough for both."""
        found = [self.plays.copy()]
        found[0][row] = other.plays[0]
        for own, new in zip(self[1:], other[1:], strict=True):
            wide = np.zeros((*own.shape[:2], *np.maximum(own.shape, new.shape)[2:]), own.dtype)
            wide[:, :, : own.shape[-1]] = own
            wide[row] = np.zeros((), own.dtype)
            wide[row, :, : new.shape[-1]] = new[0]
            found.append(wide)
        return Players(*found)


def players(cases: Sequence[Sequence[Any]]) -> Players:
    """Records of the vehicles of cases, as they are before anything has begun.

    cases: the actors of each.
    """
    n, m = len(cases), len(cases[0])
    actors = [actor for case in cases for actor in case]
    most = max((len(actor.acts) for actor in actors), default=0)
    tables = max((sum(len(act.table) for act in actor.acts) for actor in actors), default=0)
    steps = max((sum(len(act.program) for act in actor.acts) for actor in actors), default=0)
    found = Players(
        np.zeros((n, m), PLAY), np.zeros((n, m, max(most, 1)), ACT),
        np.zeros((n, m, max(tables, 1) + 2), PIECE),
        np.zeros((n, m, max(tables, 1)), TABLE), np.zeros((n, m, max(steps, 1)), PROGRAM),
    )  # fmt: skip
    for i, case in enumerate(cases):
        for j, actor in enumerate(case):
            start = actor.start
            pose = (start.x, start.y, actor.heading) if actor.on_map is None else actor.on_map
            found.plays[i, j] = (
                *pose, 0.0, 0.0, 0.0, 0.0, start.speed, math.inf, len(actor.acts), 0, 0, 0,
                actor.slides, AT_ONCE if actor.follows_at_once else 0, actor.on_map is not None,
            )  # fmt: skip
            first = step = 0
            for q, act in enumerate(actor.acts):
                waits = bool(act.program)
                found.acts[i, j, q] = (
                    math.inf if waits else act.begin, act.duration, act.speed, act.offset,
                    act.acceleration, act.jerk,
                    act.begin, math.inf, act.kind, first, len(act.table), step, len(act.program),
                    WAITS if waits else KNOWN,
                )  # fmt: skip
                for knot in act.table:
                    found.table[i, j, first] = knot
                    first += 1
                for op, one, two, value in act.program:
                    found.program[i, j, step] = (value, op, one, two)
                    step += 1
    return found
