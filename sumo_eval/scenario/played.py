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
from sumo_eval.scenario import motion
from sumo_eval.scenario.motion import along_heading, lateral_motion
from sumo_eval.scenario.road.reference_line import line_at, to_frame

Records = NDArray[Any]

# kinds of moves across the line
SMOOTH, CONSTANT = motion.SMOOTH, motion.CONSTANT
SINUS, COSINE = motion.SINUS, motion.COSINE
# kinds of moves along it
SPEED, KEEP, PATH = 10, 14, 13
BY_TIME, BY_PLACE = 11, 12
FOLLOW = 15  # from its begin on SUMO drives the vehicle
MATCH = 16  # a speed, or a place, relative to another vehicle's at every instant
# state of a move: its begin is unknown, is to come, is past
WAITS, KNOWN, BEGUN = 0, 1, 2
EGO = -1
AT_ONCE, HANDED_OVER = 1, 2  # since when SUMO drives a vehicle

# operations of a condition's program, on a stack; first those that put a value on it
VALUE, TIME = 0, 1
X, Y = 2, 3
ALONG, ACROSS = 4, 5
GAP, DISTANCE = 6, 7
TTC, THW = 8, 9
ENDED, DEPARTED = 10, 23
ADD, SUBTRACT = 11, 12
MULTIPLY, DIVIDE = 13, 14
SMALLER, LARGER = 16, 17
NEGATE, ABSOLUTE = 15, 18
BELOW, AT_MOST = 19, 20
AND, OR = 21, 22
DEEPEST = 24  # values on the stack of a condition


def _fields(kind: str, *names: str) -> list[tuple[str, str]]:
    return [(name, kind) for name in names]


ACT = np.dtype(
    _fields("f8", "begin", "duration", "speed", "offset", "acceleration", "jerk", "delay", "end")
    + _fields("i8", "kind", "first", "count", "program", "steps", "state")
)
"""A move.

begin: s, inf while it waits; delay: s after its condition holds. speed: the one it leads to, m/s,
or of a lateral move its own. first, count: its places in `TABLE`; program, steps: of its condition,
in `PROGRAM`.
"""
PIECE = np.dtype(_fields("f8", "duration", "acceleration", "jerk", "speed"))
"""A piece of motion: acceleration at its begin, jerk, and the speed at its end."""
TABLE = np.dtype(_fields("f8", "one", "two"))
"""Points of a path (x, y), knots of a profile (time or place, speed), or positions of a recorded
ego (x, y)."""
PROGRAM = np.dtype([("value", "f8"), *_fields("i8", "op", "one", "two")])
PLAY = np.dtype(
    _fields("f8", "x", "y", "heading", "line_s", "line_time", "since", "s", "v", "first_begin")
    + _fields("i8", "acts", "pieces", "path", "points", "slides", "model", "on_map", "match")
)
"""Present motion of a vehicle.

x, y, heading: beginning and direction of its line; on_map: 1 if these are on the map of a curved
road, 0 if along and across the road. line_s, line_time: distance driven and time when the line
began. since, s, v: time from which its pieces count, distance and speed then. first_begin: begin of
its first move, s. model: `AT_ONCE` if SUMO drives it from the start, `HANDED_OVER` if it does now.
match: 1 + the row of `TABLE` of what it follows, or 0: (vehicle, factor of its speed), (m/s added,
1 if it keeps a place instead, 2 within limits), (m ahead of that vehicle, s behind that at its own
speed, below 0 ahead at that vehicle's); the limits (acceleration, deceleration), (speed, 0).
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
        """These with the only row of `other` in place of one, wide enough for both."""
        plays, joined = self.plays.copy(), []
        plays[row] = other.plays[0]
        for own, new in zip(self[1:], other[1:], strict=True):
            width = max(own.shape[-1], new.shape[-1])
            joined.append(_wide(own, width))
            joined[-1][row] = _wide(new[0], width)
        return Players(plays, *joined)


def _wide(records: Records, width: int) -> Records:
    """Records (..., width) that begin with these."""
    wide = np.zeros((*records.shape[:-1], width), records.dtype)
    wide[..., : records.shape[-1]] = records
    return wide


class Cast(NamedTuple):
    """All vehicles of cases and what the played ones have; of one case, arrays of one axis less.

    egos: (n,); of one case (1,).
    others, plays: (n, m).
    acts, pieces, table, program: as in `Players`.
    """

    egos: Records
    others: Records
    plays: Records
    acts: Records
    pieces: Records
    table: Records
    program: Records


@kernel
def case_of(cast: Any, i: int) -> Any:
    """The vehicles of case i."""
    return Cast(
        cast.egos[i : i + 1],
        cast.others[i],
        cast.plays[i],
        cast.acts[i],
        cast.pieces[i],
        cast.table[i],
        cast.program[i],
    )


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
    piece = pieces[k]
    piece.duration, piece.acceleration = duration, acceleration
    piece.jerk, piece.speed = jerk, speed
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
def _across_line(play: Any, acts: Any, time: float) -> tuple[float, float, float]:
    """Offset m, speed m/s and acceleration m/s2 to the left, of the moves begun on this line."""
    aside, across, sideways = 0.0, 0.0, 0.0
    for q in range(play.acts):
        act = acts[q]
        if act.kind <= COSINE and act.state == BEGUN and act.begin >= play.line_time:
            offset, speed, acceleration = lateral_motion(act, time)
            aside += offset
            across += speed
            sideways += acceleration
    return aside, across, sideways


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
    aside, across, sideways = _across_line(play, acts, time)
    if aside != 0.0:
        x, y = x - aside * math.sin(heading), y + aside * math.cos(heading)

    near, last = other.x, other.heading
    other.x, other.y = x, y
    other.heading, other.across = heading, across
    other.speed, other.acceleration = v, a
    if not play.slides and across != 0.0:
        other.heading, other.across = heading + math.atan2(across, v), 0.0
        other.speed = math.sqrt(v * v + across * across)
        other.acceleration = along_heading(v, across, a, sideways)

    if not len(line):
        return
    if play.on_map:
        at = to_frame(line, x, y, other.heading, near)
        other.x, other.y, turned = at[0], at[1], at[2]
        other.heading = turned + 2.0 * math.pi * math.floor((last - turned) / (2.0 * math.pi) + 0.5)
    else:
        _over_ground(other, line)


@kernel
def _over_ground(other: Any, line: Any) -> None:
    """Turn heading and speeds along and across the line into those over the ground."""
    inner = 1.0 - line_at(line, other.x)[3] * other.y
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


class Body(NamedTuple):
    """A vehicle at an instant: centre m, heading rad, speeds along and across it m/s, size m."""

    x: float
    y: float
    heading: float
    speed: float
    across: float
    length: float
    width: float


@kernel
def _body_of(cast: Any, number: int, end: int) -> Body:
    """A vehicle as it was before the step, end 0, or is."""
    if number == EGO:
        return _body(cast.egos[0], end)
    return _body(cast.others[number], end)


@kernel
def _body(record: Any, end: int) -> Body:
    if end == 0:
        was = record.before
        return Body(was.x, was.y, was.heading, was.speed, was.across, record.length, record.width)
    return Body(
        record.x, record.y, record.heading, record.speed, record.across, record.length, record.width
    )


@kernel
def _of(body: Body, what: int) -> float:
    """One number of a body."""
    if what == X:
        return body.x
    if what == Y:
        return body.y
    c, s = math.cos(body.heading), math.sin(body.heading)
    if what == ALONG:
        return body.speed * c - body.across * s
    return body.speed * s + body.across * c


@kernel
def _half_along(body: Body) -> float:
    return 0.5 * (
        body.length * abs(math.cos(body.heading)) + body.width * abs(math.sin(body.heading))
    )


@kernel
def _between(op: int, one: Body, two: Body) -> float:
    """A number of two bodies, the first taken as the follower: gap m, distance m, TTC s, THW s."""
    dx, dy = two.x - one.x, two.y - one.y
    if op == DISTANCE:
        return math.sqrt(dx * dx + dy * dy)
    gap = dx - _half_along(one) - _half_along(two)
    if op == GAP:
        return gap
    speed = _of(one, ALONG)
    if op == TTC:
        speed -= _of(two, ALONG)
    return gap / speed if gap > 0.0 and speed > 0.0 else math.inf


@kernel
def _number(cast: Any, j: int, act: Any, it: Any, end: int, time: float) -> float:
    """The number that a step of a program asks for at an end of the time step."""
    op = it.op
    if op == VALUE:
        return float(it.value)
    if op == TIME:
        return time
    if op == DEPARTED:
        ego = _body(cast.egos[0], end)
        return departed(act, cast.table[j], ego.x, ego.y, time)
    one = _body_of(cast, it.one, end)
    return _of(one, op) if op <= ACROSS else _between(op, one, _body_of(cast, it.two, end))


@kernel
def _compare(stack: Any, k: int, margin_before: float, margin: float, equal: int) -> None:
    """Write whether a margin was, and is, positive, and at which share of the step it became so."""
    was = margin_before > 0.0 or (equal != 0 and margin_before == 0.0)
    holds = margin > 0.0 or (equal != 0 and margin == 0.0)
    stack[k, 0], stack[k, 1] = 1.0 if was else 0.0, 1.0 if holds else 0.0
    stack[k, 2] = 0.0
    if holds and not was:
        share = -margin_before / (margin - margin_before)
        stack[k, 2] = share if 0.0 <= share <= 1.0 and margin < math.inf else 1.0


@kernel
def _joint_share(stack: Any, k: int, op: int) -> float:
    """When both of the conditions on top, or one, became true: the later or earlier instant."""
    first, second = stack[k, 2], stack[k + 1, 2]
    if op == AND:
        return float(max(first, second))
    if stack[k + 1, 1] == 0.0:
        return float(first)
    return float(min(first, second) if stack[k, 1] > 0.0 else second)


@kernel
def holds_from(cast: Any, j: int, act: Any, now: float, before: float, stack: Any) -> float:
    """Share of the step from `before` to `now` at which the condition of a move became true.

    0 if it held before; -1: it does not hold. act: a move of actor j. Numbers are interpolated
    linearly between both ends of the step; where a number was undefined, the end counts.
    """
    program = cast.program[j]
    k = -1
    for q in range(act.program, act.program + act.steps):
        it = program[q]
        op = it.op
        asks = op < ENDED or op == DEPARTED
        if asks or op == ENDED:
            k += 1
        elif op not in (NEGATE, ABSOLUTE):
            k -= 1
        if op == ENDED:
            end = cast.acts[it.one][it.two].end
            _compare(stack, k, before - end, now - end, 1)
        elif op in (BELOW, AT_MOST):
            was, margin = stack[k + 1, 0] - stack[k, 0], stack[k + 1, 1] - stack[k, 1]
            _compare(stack, k, was, margin, 1 if op == AT_MOST else 0)
        elif asks:
            stack[k, 0] = _number(cast, j, act, it, 0, before)
            stack[k, 1] = _number(cast, j, act, it, 1, now)
        else:
            if op in (AND, OR):
                stack[k, 2] = _joint_share(stack, k, op)
            for at in range(2):
                stack[k, at] = arithmetic(op, stack[k, at], stack[k + 1, at])
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
def arithmetic(op: int, a: float, b: float) -> float:
    """The number that an operation makes of one or two; of conditions, 1 or 0."""
    if op == NEGATE:
        return -a
    if op == ABSOLUTE:
        return abs(a)
    if op == ADD:
        return a + b
    if op == SUBTRACT:
        return a - b
    if op == MULTIPLY:
        return a * b
    if op == DIVIDE:
        return a / b if b != 0.0 else math.nan
    return min(a, b) if op in (SMALLER, AND) else max(a, b)


# -- what begins -----------------------------------------------------------------------------------


@kernel
def _begin(play: Any, acts: Any, chosen: int, pieces: Any, table: Any) -> None:
    """Begin a move, one of `acts`, from where the vehicle is at that instant."""
    act = acts[chosen]
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
    x, y, heading = on_line(play, table, s)
    if act.kind == PATH:
        aside = _across_line(play, acts, act.begin)[0]
        if aside != 0.0:
            x, y = x - aside * math.sin(heading), y + aside * math.cos(heading)
        play.x, play.y, play.heading = x, y, heading
        play.line_s, play.line_time = s, act.begin
        play.path, play.points = act.first, act.count
        act.end = math.inf  # until it is there, which depends on its speed
        return
    play.since, play.match = act.begin, 0
    play.s, play.v = s, v
    if act.kind == SPEED:
        play.pieces = _speed_up(pieces, v, act)
    elif act.kind == KEEP:
        play.pieces = 0
    elif act.kind == MATCH:
        play.pieces, play.match, act.end = 0, act.first + 1, math.inf
        return
    else:
        play.pieces = _follow_profile(pieces, v, x, act, table)
    act.end = act.begin + lasts(play, pieces)


@kernel
def begin_due(play: Any, acts: Any, pieces: Any, table: Any, time: float) -> bool:
    """Begin all moves of a vehicle that are due by a time, in order; whether there was any."""
    begun = False
    while True:
        chosen = -1
        for q in range(play.acts):
            if acts[q].state == KNOWN and acts[q].begin <= time and (
                chosen < 0 or acts[q].begin < acts[chosen].begin
            ):  # fmt: skip
                chosen = q
        if chosen < 0:
            return begun
        _begin(play, acts, chosen, pieces, table)
        begun = True


@kernel
def _end_path(play: Any, acts: Any, pieces: Any, table: Any, before: float, now: float) -> None:
    """Write when the path that is driven came to its last point, if it did in this step."""
    for q in range(play.acts):
        act = acts[q]
        ends = act.kind == PATH and act.state == BEGUN and math.isinf(act.end)
        if not ends or act.first != play.path:
            continue
        length, x, y = 0.0, play.x, play.y
        for p in range(play.path, play.path + play.points):
            dx, dy = table[p].one - x, table[p].two - y
            length += math.sqrt(dx * dx + dy * dy)
            x, y = table[p].one, table[p].two
        s, was = driven(play, pieces, now)[0], driven(play, pieces, before)[0]
        if s - play.line_s >= length:
            moved = s - was
            share = (length - (was - play.line_s)) / moved if moved > 0.0 else 1.0
            act.end = before + min(max(share, 0.0), 1.0) * (now - before)


@kernel
def _match(cast: Any, j: int, now: float, line: Any) -> None:
    """Move a vehicle to `now` relative to another, whose speed is linear since the last look."""
    play, table, own = cast.plays[j], cast.table[j], cast.others[j]
    of, more, place = table[play.match - 1], table[play.match], table[play.match + 1]
    other = _body_of(cast, int(of.one), 1)
    speed, since = max(of.two * _of(other, ALONG) + more.one, 0.0), now - play.since
    if len(line) and not play.on_map:
        speed /= 1.0 - line_at(line, own.x)[3] * own.y
    ahead = 0.5 * (play.v + speed) * since
    if more.two > 0.0:
        ahead = other.x + place.one - on_line(play, table, play.s)[0]
        if place.two < 0.0:  # that vehicle's speed
            ahead -= place.two * speed
        if more.two > 1.0:
            speed = _approach(play, speed, ahead, place.two, since, table)
            ahead = 0.5 * (play.v + speed) * since
        elif place.two > 0.0:  # other.x + place.one - own place = its own speed x place.two
            ahead = ahead * since / (since + place.two) if since > 0.0 else 0.0
            speed = ahead / since if since > 0.0 else play.v
    play.s += ahead
    play.since, play.v = now, max(speed, 0.0)


@kernel
def _approach(play: Any, speed: float, ahead: float, gap: float, since: float, table: Any) -> float:
    """The speed of a vehicle whose place is `ahead` m in front of it, within its limits, m/s.

    speed: of the other vehicle. gap: s that the place moves back at the own speed, above 0.
    """
    rates, top = table[play.match + 2], table[play.match + 3].one
    behind = max(gap, 0.0)
    # the place moved with the other vehicle in this step
    apart = ahead - speed * since - behind * play.v
    # the fastest closing speed that ends in time, and without passing the place in this step
    rate = rates.two if apart > 0.0 else rates.one
    closing = min(math.sqrt(2.0 * rate * abs(apart)), abs(apart) / max(since + behind, 1e-9))
    wanted = min(speed + (closing if apart > 0.0 else -closing), top)
    slowest, fastest = play.v - rates.two * since, play.v + rates.one * since
    return float(max(min(wanted, fastest), slowest, 0.0))


@kernel
def wake(cast: Any, now: float, before: float, stack: Any, line: Any) -> None:
    """Begin the waiting moves of a case whose conditions hold at the end of a step.

    Vehicles whose moves began are placed again.
    """
    others, plays = cast.others, cast.plays
    acts, pieces, table = cast.acts, cast.pieces, cast.table
    for j in range(len(others)):
        for q in range(plays[j].acts):
            act = acts[j][q]
            if act.state == WAITS:
                share = holds_from(cast, j, act, now, before, stack)
                if share >= 0.0:
                    act.begin = before + share * (now - before) + act.delay
                    act.state = KNOWN
    for j in range(len(others)):
        play = plays[j]
        if play.model:
            continue
        begun = begin_due(play, acts[j], pieces[j], table[j], now)
        _end_path(play, acts[j], pieces[j], table[j], before, now)
        if play.match:
            _match(cast, j, now, line)
        if begun or play.match:
            place(others[j], play, acts[j], pieces[j], table[j], now, line)


@kernel
def move(other: Any, play: Any, acts: Any, pieces: Any, table: Any, time: float, line: Any) -> None:
    """Begin the due moves of a played vehicle, and put it where it is at a time."""
    begin_due(play, acts, pieces, table, time)
    place(other, play, acts, pieces, table, time, line)


# -- rows ------------------------------------------------------------------------------------------


@kernel
def play_actors(cast: Cast, steps: int, step: float, line: Records) -> None:
    """Move the actors of every live case to the end of `steps` steps."""
    egos, others, plays = cast.egos, cast.others, cast.plays
    acts, pieces, table = cast.acts, cast.pieces, cast.table
    for i in range(len(egos)):
        if egos[i].live == 0 or egos[i].reason != 0:
            continue
        now = (steps - egos[i].begun) * step
        for j in range(len(others[i])):
            play = plays[i][j]
            if play.model == 0:
                move(others[i][j], play, acts[i][j], pieces[i][j], table[i][j], now, line)


@rows
def wake_rows(
    cast: Cast, now: float, before: float, stack: NDArray[np.float64], line: Records
) -> None:
    """Begin moves whose conditions hold at the end of a step from `before` to `now`, s."""
    egos = cast.egos
    for i in range(len(egos)):
        if egos[i].live != 0 and egos[i].reason == 0:
            wake(case_of(cast, i), now, before, stack, line)


def players(cases: Sequence[Sequence[Any]]) -> Players:
    """Records of the vehicles of cases, as they are before anything has begun.

    cases: the actors of each.
    """
    actors = [actor for case in cases for actor in case]
    shape = len(cases), len(cases[0])
    lists = list(map(_records_of, actors))

    def records(kind: Any, rows: list[list[tuple[Any, ...]]]) -> Records:
        """Records of each vehicle, (n, m, as many as one has at most, at least one)."""
        found = np.zeros((len(rows), max(map(len, rows), default=0) or 1), kind)
        for row, values in zip(found, rows, strict=True):
            if values:
                row[: len(values)] = values
        return found.reshape(*shape, found.shape[1])

    plays = np.array([_play_of(actor) for actor in actors], PLAY).reshape(shape)
    acts, table = records(ACT, [it[0] for it in lists]), records(TABLE, [it[1] for it in lists])
    pieces = np.zeros((*shape, table.shape[2] + 2), PIECE)
    return Players(plays, acts, pieces, table, records(PROGRAM, [it[2] for it in lists]))


def _records_of(actor: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """Records of an actor's acts, of their tables and of their programs."""
    acts: list[Any] = []
    table: list[Any] = []
    program: list[Any] = []
    for act in actor.acts:
        begin, state = (math.inf, WAITS) if act.program else (act.begin, KNOWN)
        numbers = act.duration, act.speed, act.offset, act.acceleration, act.jerk
        counts = act.kind, len(table), len(act.table), len(program), len(act.program)
        acts.append((begin, *numbers, act.begin, math.inf, *counts, state))
        table += act.table
        program += [(value, op, one, two) for op, one, two, value in act.program]
    return acts, table, program


def _play_of(actor: Any) -> tuple[Any, ...]:
    """A `PLAY` record before the start."""
    start = actor.start
    pose = (start.x, start.y, actor.heading) if actor.on_map is None else actor.on_map
    motion = 0.0, 0.0, 0.0, 0.0, start.speed, math.inf
    model = AT_ONCE if actor.follows_at_once else 0
    counts = len(actor.acts), 0, 0, 0, actor.slides, model, actor.on_map is not None, 0
    return *pose, *motion, *counts
