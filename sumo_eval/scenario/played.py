"""Scripted motion of actors: moves that begin at a time or when a condition holds, paths, speeds by
time or by position.

A played vehicle drives along a line: straight on in its heading, or a path of points. Its speed is
a list of pieces of constant jerk, its lateral moves are offsets across the line. Every move is a
function of the time since it began, so a move that begins within a step leads to the same position
with any step. Records are plain numbers, and the loops over them are kernels: a case has the same
bits alone and in a batch.

Users: `cosim/world.py` makes the records, `cosim/step_rules.py` moves the actors in every step;
readers of scenarios (`scenario/`, `extras/openscenario/`) write acts, `scenario/undisturbed.py`
plays them without an ego. `cosim/` knows their records.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, floor, inf, isinf, nan, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.kernels import Records, fields, flags, kernel, rows
from sumo_eval.scenario import motion
from sumo_eval.scenario.bodies import half_sizes
from sumo_eval.scenario.motion import Motion, along_heading, lateral_motion
from sumo_eval.scenario.road.reference_line import line_at, to_frame
from sumo_eval.scenario.touch import Body, body_of, velocity
from sumo_eval.trajectory import IntArray

Pairs = tuple[tuple[float, float], ...]
Move = tuple[int, int]
"""A move of an actor: the actor's number, and its own."""
Step = tuple[int, int, int, float]
Program = tuple[Step, ...]
"""A condition: operations (op, one, two, value), see `Act`."""

# Kinds and operations keep their numbers, which identities of drives contain.
# Kinds of moves across the line. They have the smallest numbers: `kind <= COSINE` asks for them.
SMOOTH, CONSTANT = motion.SMOOTH, motion.CONSTANT
SINUS, COSINE = motion.SINUS, motion.COSINE
# kinds of moves along the line
SPEED = 10  # to a speed, with limited acceleration and jerk
BY_TIME, BY_PLACE = 11, 12  # speeds by time, by position
PATH = 13  # along points
KEEP = 14  # the speed that it has
FOLLOW = 15  # from then on SUMO drives the vehicle
MATCH = 16  # a speed, or a position, relative to another vehicle's at every instant
# state of a move: its `begin` is unknown, is in the future, is past
WAITS, KNOWN, BEGUN = 0, 1, 2
EGO = -1  # in place of the index of an actor
AT_ONCE, HANDED_OVER = 1, 2  # SUMO drives a vehicle from the start, or from a FOLLOW on

# Operations of a condition's program, which works on a stack. Those up to ENDED, and DEPARTED, put
# a value on top of it. NEGATE and ABSOLUTE change the top value. Every other operation replaces
# the two top values by one.
VALUE, TIME = 0, 1
X, Y = 2, 3
ALONG, ACROSS = 4, 5
GAP, DISTANCE = 6, 7
TTC, THW = 8, 9
ENDED = 10
ADD, SUBTRACT = 11, 12
MULTIPLY, DIVIDE = 13, 14
NEGATE = 15
SMALLER, LARGER = 16, 17
ABSOLUTE = 18
BELOW, AT_MOST = 19, 20
AND, OR = 21, 22
DEPARTED = 23
DEEPEST = 24  # values on the stack of a condition, at most
# Columns of the stack: a value at the start of the step and at its end; of a condition, which has
# the values 1 and 0, also the share of the step at which it became true.
BEFORE, NOW, SHARE = 0, 1, 2

ACT = np.dtype(
    fields("begin", "duration", "speed", "offset", "acceleration", "jerk", "delay", "end")
    + flags("kind", "first", "count", "program", "steps", "state")
)
"""A move.

begin, end: s; begin is inf while the move waits for its condition.
duration: s; of a `FOLLOW`, between two positions of its rows.
speed: at the end of a move along the line, or of a `CONSTANT` move across it, m/s.
offset: of a lateral move, to the left, m.
acceleration, jerk: largest, m/s2 and m/s3.
delay: from the instant at which its condition holds to `begin`, s.
kind: `SMOOTH` to `MATCH`.
first, count: index and number of its rows in `TABLE`.
program, steps: index and number of the rows of its condition in `PROGRAM`.
state: `WAITS`, `KNOWN` or `BEGUN`.
"""
PIECE = np.dtype(fields("duration", "acceleration", "jerk", "speed"))
"""A piece of motion: its duration, its first acceleration, its jerk, and the speed at its end."""
TABLE = np.dtype(fields("one", "two"))
"""Pairs of numbers: points of a path (x, y), knots of a profile (time or position, speed),
positions of a recorded ego (x, y), or what a `MATCH` follows (see `PLAY`)."""
PROGRAM = np.dtype(fields("value") + flags("op", "one", "two"))
"""An operation of a condition, as a `Step`."""
PLAY = np.dtype(
    fields("x", "y", "heading", "line_s", "line_time", "since", "s", "v", "first_begin")
    + flags("acts", "pieces", "path", "points", "slides", "model", "on_map", "match")
)
"""Present motion of a vehicle.

x, y, heading: beginning and direction of its line.
line_s, line_time: distance driven, m, and time, s, when the line began.
since, s, v: time from which its pieces count, s, and distance, m, and speed, m/s, then.
first_begin: `begin` of its first move, s.
acts, pieces: number of its moves and of its pieces.
path, points: index and number of the points of its path in `TABLE`; no points: a straight line.
slides: 1 if it keeps its heading while it moves across the line.
model: 0 while its script drives it, else `AT_ONCE` or `HANDED_OVER`.
on_map: 1 if x, y and heading are on the map of a curved road, 0 if along and across the road.
match: 0 while it follows no vehicle, else 1 + the index of the first of its rows of `TABLE`: three
    pairs of numbers, five where limits hold
    1. number of the followed vehicle (`EGO`: the ego), and a factor
    2. a speed to add, m/s: the wanted speed is the factor times the followed vehicle's, plus this;
        and what is kept: 0: that speed, 1: a position, 2: a position within the limits of 4 and 5
    3. the position, m ahead of the followed vehicle; and a headway, s. Above 0: the position is
        further back by the headway times the own speed. Below 0: it is further ahead, by the
        headway's amount times the wanted speed.
    4. limits of acceleration and of deceleration, m/s2
    5. limit of speed, m/s; unused
"""


class Act(NamedTuple):
    """A move of a played vehicle as plain numbers; fields as in `ACT`.

    begin: of a move with a condition, its delay, s.
    table: its rows of `TABLE`.
    program: its condition as operations (op, one, two, value), one and two being vehicles (index or
        `EGO`), or of `ENDED` a vehicle and a move; empty: it begins at `begin`.
    name: for messages.
    """

    kind: int
    begin: float = 0.0
    duration: float = 0.0
    speed: float = 0.0
    offset: float = 0.0
    acceleration: float = inf
    jerk: float = inf
    table: Pairs = ()
    program: Program = ()
    name: str = ""

    @property
    def timed(self) -> bool:
        """Whether it has a closed form (`motion.lateral_motion`, `motion.braked`) and a finite
        `begin` that is known before the drive.
        """
        stops = self.kind == SPEED and self.speed == 0.0
        known = self.begin < inf and not self.program
        return known and (stops or self.kind in (SMOOTH, CONSTANT, COSINE))


class Players(NamedTuple):
    """Records of the played vehicles of n cases with m each.

    plays: (n, m).
    acts, pieces, table, program: (n, m, most that one vehicle has).
    """

    plays: Records
    acts: Records
    pieces: Records
    table: Records
    program: Records

    def of(self, chosen: IntArray) -> Players:
        """The records of some cases."""
        return Players(*(array[chosen] for array in self))

    def with_row(self, row: int, other: Players) -> Players:
        """These records with the only case of `other` in place of case `row`, wide enough for
        both.
        """
        plays = self.plays.copy()
        joined = []
        plays[row] = other.plays[0]
        for own, new in zip(self[1:], other[1:], strict=True):
            width = max(own.shape[-1], new.shape[-1])
            joined.append(_wide(own, width))
            joined[-1][row] = _wide(new[0], width)
        return Players(plays, *joined)


def _wide(records: Records, width: int) -> Records:
    """These records with zeros behind them, (..., width)."""
    wide = np.zeros((*records.shape[:-1], width), records.dtype)
    wide[..., : records.shape[-1]] = records
    return wide


class Cast(NamedTuple):
    """All vehicles of n cases, and the records of the played ones.

    egos: (n,).
    others, plays: (n, m).
    acts, pieces, table, program: as in `Players`.
    line: knots of the road's line; none: it is straight.

    As `case_of` gives it for one case: egos (1,), the line as it is, all else
    without the first axis.
    """

    egos: Records
    others: Records
    plays: Records
    acts: Records
    pieces: Records
    table: Records
    program: Records
    line: Records


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
        cast.line,
    )


# -- along the line --------------------------------------------------------------------------------


@kernel
def driven(play: Any, pieces: Any, time: float) -> Motion:
    """Distance m, speed m/s and acceleration m/s2 along the line at a time."""
    s, v, left = play.s, play.v, time - play.since  # left: time that is not yet driven, s
    for k in range(play.pieces):
        piece = pieces[k]
        d = min(left, piece.duration)  # time in this piece, s
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
    """Write piece k, unless it takes no time; return the number of pieces."""
    if duration <= 0.0:
        return k
    piece = pieces[k]
    piece.duration, piece.acceleration = duration, acceleration
    piece.jerk, piece.speed = jerk, speed
    return k + 1


@kernel
def _speed_up(pieces: Any, v: float, act: Any) -> int:
    """Write the pieces from speed v to the act's, whose acceleration is finite; return how many.

    The acceleration builds up at the act's jerk and ends at once.
    """
    change = abs(act.speed - v)
    sign = 1.0 if act.speed > v else -1.0
    rise = act.acceleration / act.jerk  # time in which the acceleration builds up, s; may be 0
    in_rise = 0.5 * act.acceleration * rise  # change of speed meanwhile, m/s
    if change <= in_rise:
        return _put(pieces, 0, sqrt(2.0 * change / act.jerk), 0.0, sign * act.jerk, act.speed)
    k = _put(pieces, 0, rise, 0.0, sign * act.jerk, v + sign * in_rise)
    return _put(
        pieces, k, (change - in_rise) / act.acceleration, sign * act.acceleration, 0.0, act.speed
    )


@kernel
def _follow_profile(pieces: Any, v: float, x: float, act: Any, table: Any) -> int:
    """Write the pieces of constant acceleration through the knots of a profile; return how many."""
    # last: the knot before; by time: s since `begin`, by position: x, m
    k = 0
    last = 0.0 if act.kind == BY_TIME else x
    for q in range(act.first, act.first + act.count):
        knot, speed = table[q].one, table[q].two
        apart = knot - last
        if apart <= 0.0:  # it is at or past this knot
            continue
        if act.kind == BY_TIME:
            duration = apart
        elif v + speed > 0.0:
            duration = 2.0 * apart / (v + speed)
        else:  # it stands, and never gets to the knot
            return _put(pieces, k, inf, 0.0, 0.0, 0.0)
        k = _put(pieces, k, duration, (speed - v) / duration, 0.0, speed)
        last, v = knot, speed
    return k


# -- where it is -----------------------------------------------------------------------------------


@kernel
def on_line(play: Any, table: Any, s: float) -> tuple[float, float, float]:
    """x, y and direction of the line, s m along it."""
    x, y, heading = play.x, play.y, play.heading
    left = s - play.line_s
    for q in range(play.path, play.path + play.points):
        dx, dy = table[q].one - x, table[q].two - y
        length = sqrt(dx * dx + dy * dy)
        if length == 0.0:
            continue
        heading = atan2(dy, dx)
        if left < length:
            return x + dx * left / length, y + dy * left / length, heading
        left -= length
        x, y = table[q].one, table[q].two
    return x + left * cos(heading), y + left * sin(heading), heading


@kernel
def _across_line(play: Any, acts: Any, time: float) -> Motion:
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

    On a curved road most scripts are along and across the road. At the offset y a metre along the
    road's line is 1 - curvature y metres of ground: heading and speed become those over the ground.
    A vehicle that is played on the map (`on_map`) gets the road coordinates of its position. The
    search for them begins at its last x, and its heading does not jump by 2 pi.

    line: knots of the road's line; none: it is straight.
    """
    s, v, a = driven(play, pieces, time)
    x, y, heading = on_line(play, table, s)
    aside, across, sideways = _across_line(play, acts, time)
    if aside != 0.0:
        x, y = x - aside * sin(heading), y + aside * cos(heading)

    last_x, last_heading = other.x, other.heading
    other.x, other.y = x, y
    other.heading, other.across = heading, across
    other.speed, other.acceleration = v, a
    if not play.slides and across != 0.0:
        other.heading = heading + atan2(across, v)
        other.across = 0.0
        other.speed = sqrt(v * v + across * across)
        other.acceleration = along_heading(v, across, a, sideways)

    if not len(line):
        return
    if play.on_map:
        at = to_frame(line, x, y, other.heading, last_x)
        other.x, other.y = at.x, at.y
        # whole turns to add, so that the heading stays the nearest to the last one
        turns = floor((last_heading - at.heading) / (2.0 * pi) + 0.5)
        other.heading = at.heading + 2.0 * pi * turns
    else:
        _over_ground(other, line)


@kernel
def _over_ground(other: Any, line: Any) -> None:
    """Turn heading and speeds along and across the line into those over the ground.

    Of the unit vector (cos, sin) of the heading the part along the line is stretched by `inner`:
    metres of ground for each metre of the line. `stretched` is the length of the result, (c, s) its
    direction.
    """
    inner = 1.0 - line_at(line, other.x).curvature * other.y
    c, s = cos(other.heading) * inner, sin(other.heading)
    stretched = sqrt(c * c + s * s)
    c, s = c / stretched, s / stretched
    along = inner * (other.speed * cos(other.heading) - other.across * sin(other.heading))
    left = other.speed * sin(other.heading) + other.across * cos(other.heading)
    if other.heading != 0.0:  # 0 stays 0
        other.heading = atan2(s, c)
    other.speed, other.across = along * c + left * s, left * c - along * s
    other.acceleration *= stretched


# -- conditions ------------------------------------------------------------------------------------


@kernel
def _body_of(cast: Any, number: int, end: int) -> Body:
    """Vehicle `number`, an actor's index or `EGO`, at an end of the step, `BEFORE` or `NOW`."""
    if number == EGO:
        return _body(cast.egos[0], end)
    return _body(cast.others[number], end)


@kernel
def _body(record: Any, end: int) -> Body:
    """The vehicle of a record at an end of the step."""
    if end == BEFORE:
        return body_of(record.before, record.before, record)
    return body_of(record, record, record)


@kernel
def _component(op: int, body: Body) -> float:
    """`X` or `Y` of a body, m, or its speed `ALONG` or `ACROSS` the road, m/s."""
    if op == X:
        return body.x
    if op == Y:
        return body.y
    along, across = velocity(body)
    return along if op == ALONG else across


@kernel
def _between(op: int, one: Body, two: Body) -> float:
    """`GAP` or `DISTANCE`, m, `TTC` or `THW`, s, of two bodies of which `one` follows `two`."""
    dx, dy = two.x - one.x, two.y - one.y
    if op == DISTANCE:
        return sqrt(dx * dx + dy * dy)
    gap = dx - half_sizes(one.heading, one.length, one.width)[0]
    gap -= half_sizes(two.heading, two.length, two.width)[0]
    if op == GAP:
        return gap
    speed = _component(ALONG, one)
    if op == TTC:
        speed -= _component(ALONG, two)
    return gap / speed if gap > 0.0 and speed > 0.0 else inf


@kernel
def _pushed(cast: Any, j: int, act: Any, step: Any, end: int, time: float) -> float:
    """The value that an operation puts on the stack.

    act: a move of actor j.
    step: of its program, the operation.
    end: of the simulation's step, `BEFORE` or `NOW`.
    time: then, s.
    """
    op = step.op
    if op == VALUE:
        return float(step.value)
    if op == TIME:
        return time
    if op == DEPARTED:
        ego = _body(cast.egos[0], end)
        return departed(act, cast.table[j], ego.x, ego.y, time)
    one = _body_of(cast, step.one, end)
    if op <= ACROSS:
        return _component(op, one)
    return _between(op, one, _body_of(cast, step.two, end))


@kernel
def _compare(stack: Any, k: int, margin_before: float, margin: float, equal: bool) -> None:
    """Write to row k of the stack whether a margin is positive at both ends of the step, and at
    which share of the step it became so.

    The margin changes linearly. Where it is infinite or undefined, the share is 1.

    equal: whether a margin of 0 counts as well.
    """
    held = margin_before > 0.0 or (equal and margin_before == 0.0)
    holds = margin > 0.0 or (equal and margin == 0.0)
    stack[k, BEFORE], stack[k, NOW] = 1.0 if held else 0.0, 1.0 if holds else 0.0
    stack[k, SHARE] = 0.0
    if holds and not held:
        share = -margin_before / (margin - margin_before)
        stack[k, SHARE] = share if 0.0 <= share <= 1.0 and margin < inf else 1.0


@kernel
def _joint_share(stack: Any, k: int, op: int) -> float:
    """Share of the step at which the later (`AND`) or the earlier (`OR`) of two conditions became
    true.

    k: row of one condition; the other has row k + 1.
    """
    first, second = stack[k, SHARE], stack[k + 1, SHARE]
    if op == AND:
        return float(max(first, second))
    # ignore the share of a condition that does not hold
    if stack[k + 1, NOW] == 0.0:
        return float(first)
    return float(min(first, second) if stack[k, NOW] > 0.0 else second)


@kernel
def holds_from(cast: Any, j: int, act: Any, now: float, before: float) -> float:
    """Share of the step at which the condition of a move became true; 0: it held before; -1: it
    does not hold.

    Values are interpolated linearly between both ends of the step; where a value was undefined, the
    end of the step counts.

    act: a move of actor j.
    now, before: ends of the step, s.
    """
    program, stack = cast.program[j], np.zeros((DEEPEST, 3))
    k = -1  # top of the stack
    for q in range(act.program, act.program + act.steps):
        step = program[q]
        op = step.op
        reads_value = op < ENDED or op == DEPARTED
        if reads_value or op == ENDED:
            k += 1
        elif op not in (NEGATE, ABSOLUTE):  # two values, now in rows k and k + 1, become one
            k -= 1
        if op == ENDED:
            ended = cast.acts[step.one, step.two].end
            _compare(stack, k, before - ended, now - ended, True)
        elif op in (BELOW, AT_MOST):
            margin_before = stack[k + 1, BEFORE] - stack[k, BEFORE]
            margin = stack[k + 1, NOW] - stack[k, NOW]
            _compare(stack, k, margin_before, margin, op == AT_MOST)
        elif reads_value:
            stack[k, BEFORE] = _pushed(cast, j, act, step, BEFORE, before)
            stack[k, NOW] = _pushed(cast, j, act, step, NOW, now)
        else:
            if op in (AND, OR):
                stack[k, SHARE] = _joint_share(stack, k, op)
            for end in range(2):  # `BEFORE`, `NOW`
                stack[k, end] = arithmetic(op, stack[k, end], stack[k + 1, end])
    return float(stack[0, SHARE]) if stack[0, NOW] > 0.0 else -1.0


@kernel
def departed(act: Any, table: Any, x: float, y: float, time: float) -> float:
    """Distance of x, y from the position of the recorded ego at a time, m; after the end of its
    recording, from the last position.

    act: a `FOLLOW`, whose rows of `table` are the positions of the recorded ego. Its `duration` is
        the time from one position to the next, s.
    """
    # index in the recording, with its fraction
    position = min(max(time / act.duration, 0.0), act.count - 1.0)
    first = min(int(position), act.count - 2)
    share = position - first
    one, two = table[act.first + first], table[act.first + first + 1]
    dx = x - (one.one + share * (two.one - one.one))
    dy = y - (one.two + share * (two.two - one.two))
    return sqrt(dx * dx + dy * dy)


@kernel
def arithmetic(op: int, a: float, b: float) -> float:
    """Result of an operation on one value or two; of conditions, 1 or 0."""
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
        return a / b if b != 0.0 else nan
    return min(a, b) if op in (SMALLER, AND) else max(a, b)


# -- what begins -----------------------------------------------------------------------------------


@kernel
def _begin(play: Any, acts: Any, chosen: int, pieces: Any, table: Any) -> None:
    """Begin the move `acts[chosen]`, from the position of the vehicle at that time."""
    act = acts[chosen]
    act.state = BEGUN
    play.first_begin = min(play.first_begin, act.begin)
    if act.kind <= COSINE:
        act.end = act.begin + act.duration
        return
    if act.kind == FOLLOW:
        play.model = HANDED_OVER
        act.end = inf
        return

    s, v, _ = driven(play, pieces, act.begin)
    x, y, heading = on_line(play, table, s)
    if act.kind == PATH:
        aside = _across_line(play, acts, act.begin)[0]
        if aside != 0.0:
            x, y = x - aside * sin(heading), y + aside * cos(heading)
        play.x, play.y, play.heading = x, y, heading
        play.line_s, play.line_time = s, act.begin
        play.path, play.points = act.first, act.count
        act.end = inf  # `_end_path` writes it: it depends on the speed
        return
    play.since, play.s, play.v = act.begin, s, v
    play.match = act.first + 1 if act.kind == MATCH else 0
    if act.kind in (KEEP, MATCH):  # for ever
        play.pieces, act.end = 0, inf
        return
    if act.kind == SPEED:
        play.pieces = _speed_up(pieces, v, act)
    else:
        play.pieces = _follow_profile(pieces, v, x, act, table)
    duration = 0.0
    for k in range(play.pieces):
        duration += pieces[k].duration
    act.end = act.begin + duration


@kernel
def begin_due(play: Any, acts: Any, pieces: Any, table: Any, time: float, step_ends: bool) -> bool:
    """Begin all moves of a vehicle that are due by a time, in order; whether any began.

    step_ends: whether SUMO has moved the vehicle up to this time; only then can a `FOLLOW` begin.
    """
    begun = False
    while True:
        chosen = -1
        for q in range(play.acts):
            due = acts[q].state == KNOWN and acts[q].begin <= time
            due = due and (step_ends or acts[q].kind != FOLLOW)
            if due and (chosen < 0 or acts[q].begin < acts[chosen].begin):
                chosen = q
        if chosen < 0:
            return begun
        _begin(play, acts, chosen, pieces, table)
        begun = True


@kernel
def _end_path(play: Any, acts: Any, pieces: Any, table: Any, now: float, before: float) -> None:
    """Write when the vehicle came to the last point of its path, if it did in this step."""
    for q in range(play.acts):
        act = acts[q]
        underway = act.kind == PATH and act.state == BEGUN and isinf(act.end)
        if not underway or act.first != play.path:
            continue
        length, x, y = 0.0, play.x, play.y
        for p in range(play.path, play.path + play.points):
            dx, dy = table[p].one - x, table[p].two - y
            length += sqrt(dx * dx + dy * dy)
            x, y = table[p].one, table[p].two
        s, last_s = driven(play, pieces, now)[0], driven(play, pieces, before)[0]
        if s - play.line_s >= length:
            moved = s - last_s
            share = (length - (last_s - play.line_s)) / moved if moved > 0.0 else 1.0
            act.end = before + min(max(share, 0.0), 1.0) * (now - before)


@kernel
def _match(cast: Any, j: int, now: float) -> None:
    """Move actor j to `now` as its `MATCH` demands (`PLAY` explains its rows of `TABLE`).

    Its speed has changed linearly since the last step.
    """
    play, table, own = cast.plays[j], cast.table[j], cast.others[j]
    first = play.match - 1
    added, kept = table[first + 1].one, table[first + 1].two
    distance, headway = table[first + 2].one, table[first + 2].two

    other = _body_of(cast, int(table[first].one), NOW)
    elapsed = now - play.since
    speed = max(table[first].two * _component(ALONG, other) + added, 0.0)
    if len(cast.line) and not play.on_map:
        # along the road's line: over the ground the offset y makes it longer or shorter
        speed /= 1.0 - line_at(cast.line, own.x).curvature * own.y
    ahead = 0.5 * (play.v + speed) * elapsed  # distance to drive in this step, m
    if kept > 0.0:  # a position
        ahead = other.x + distance - on_line(play, table, play.s)[0]
        if headway < 0.0:
            ahead -= headway * speed
        if kept > 1.0:  # within limits
            speed = _approach(play, speed, ahead, headway, elapsed, table)
            ahead = 0.5 * (play.v + speed) * elapsed
        elif headway > 0.0:
            # the gap that is left, ahead - driven, shall be headway * driven / elapsed
            ahead = ahead * elapsed / (elapsed + headway) if elapsed > 0.0 else 0.0
            speed = ahead / elapsed if elapsed > 0.0 else play.v
    play.s += ahead
    play.since, play.v = now, max(speed, 0.0)


@kernel
def _approach(
    play: Any, speed: float, ahead: float, headway: float, elapsed: float, table: Any
) -> float:
    """Speed, within its limits, of a vehicle that closes in on its position of a `MATCH`, m/s.

    speed: of the other vehicle, m/s.
    ahead: distance to the position, m.
    headway: above 0, the position is further back by the headway times the own speed, s.
    elapsed: time since the last step, s.
    """
    rates = table[play.match + 2]  # one: limit of acceleration, two: of deceleration
    top_speed = table[play.match + 3].one
    behind = max(headway, 0.0)
    # distance to the position at the last step; since then it has moved as the other vehicle
    apart = ahead - speed * elapsed - behind * play.v
    # the fastest closing speed that ends in time, and does not pass the position in this step
    # (1e-9: not by 0)
    rate = rates.two if apart > 0.0 else rates.one
    closing = min(sqrt(2.0 * rate * abs(apart)), abs(apart) / max(elapsed + behind, 1e-9))
    wanted = min(speed + (closing if apart > 0.0 else -closing), top_speed)
    slowest, fastest = play.v - rates.two * elapsed, play.v + rates.one * elapsed
    return float(max(min(wanted, fastest), slowest, 0.0))


@kernel
def wake(cast: Any, now: float, before: float) -> None:
    """Begin the waiting moves of a case whose conditions hold at the end of a step.

    Vehicles whose moves began, and those that match another's motion, are placed again.

    now, before: ends of the step, s.
    """
    others, plays = cast.others, cast.plays
    acts, pieces, table = cast.acts, cast.pieces, cast.table
    for j in range(len(others)):
        for q in range(plays[j].acts):
            act = acts[j, q]
            if act.state == WAITS:
                share = holds_from(cast, j, act, now, before)
                if share >= 0.0:
                    act.begin = before + share * (now - before) + act.delay
                    act.state = KNOWN
    for j in range(len(others)):
        play = plays[j]
        if play.model:
            continue
        begun = begin_due(play, acts[j], pieces[j], table[j], now, True)
        _end_path(play, acts[j], pieces[j], table[j], now, before)
        if play.match:
            _match(cast, j, now)
        if begun or play.match:
            place(others[j], play, acts[j], pieces[j], table[j], now, cast.line)


@kernel
def move(other: Any, play: Any, acts: Any, pieces: Any, table: Any, time: float, line: Any) -> None:
    """Begin the due moves of a played vehicle, and put it where it is at a time."""
    begin_due(play, acts, pieces, table, time, False)
    place(other, play, acts, pieces, table, time, line)


@kernel
def play_actor(cast: Any, i: int, j: int, time: float) -> None:
    """Move actor j of case i to where its script has it at a time, unless SUMO drives it."""
    play = cast.plays[i, j]
    if play.model == 0:
        move(
            cast.others[i, j], play, cast.acts[i, j], cast.pieces[i, j], cast.table[i, j], time,
            cast.line,
        )  # fmt: skip


# -- rows ------------------------------------------------------------------------------------------


@rows
def wake_rows(cast: Cast, now: float, before: float) -> None:
    """Begin moves whose conditions hold at the end of a step from `before` to `now`, s.

    All cases have these times: cases with conditions begin together.
    """
    egos = cast.egos
    for i in range(len(egos)):
        if egos[i].live != 0 and egos[i].reason == 0:
            wake(case_of(cast, i), now, before)


def players(cases: Sequence[Sequence[Any]]) -> Players:
    """Records of the played vehicles at the start of their cases.

    cases: the actors of each case, the same number in all.
    """
    actors = [actor for case in cases for actor in case]
    shape = len(cases), len(cases[0])

    def records(kind: Any, rows: Sequence[Any]) -> Records:
        """Records of each vehicle, (n, m, most that one has, at least one)."""
        array = np.zeros((len(rows), max(map(len, rows), default=0) or 1), kind)
        for row, values in zip(array, rows, strict=True):
            if values:
                row[: len(values)] = values
        return array.reshape(*shape, array.shape[1])

    plays = np.array([_play_of(actor) for actor in actors], PLAY).reshape(shape)
    # by kind: the rows of each actor
    lists = [*zip(*map(_records_of, actors), strict=True)] or 3 * [()]
    acts, table, program = map(records, (ACT, TABLE, PROGRAM), lists)
    # a profile needs one piece for each knot, a change of speed two
    pieces = np.zeros((*shape, table.shape[2] + 2), PIECE)
    return Players(plays, acts, pieces, table, program)


def _records_of(actor: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """Rows of `ACT`, `TABLE` and `PROGRAM` of an actor."""
    acts: list[Any] = []
    table: list[Any] = []
    program: list[Any] = []
    for act in actor.acts:
        begin, state = (inf, WAITS) if act.program else (act.begin, KNOWN)
        numbers = act.duration, act.speed, act.offset, act.acceleration, act.jerk
        rows = act.kind, len(table), len(act.table), len(program), len(act.program)
        # in the order of `ACT`; `begin` of a move with a condition is its delay
        acts.append((begin, *numbers, act.begin, inf, *rows, state))
        table += act.table
        program += [(value, op, one, two) for op, one, two, value in act.program]
    return acts, table, program


def _play_of(actor: Any) -> tuple[Any, ...]:
    """A row of `PLAY` at the start, in the order of its fields."""
    start = actor.start
    pose = (start.x, start.y, actor.heading) if actor.on_map is None else actor.on_map
    # line_s, line_time, since, s, v, first_begin
    driven_so_far = 0.0, 0.0, 0.0, 0.0, start.speed, inf
    model = AT_ONCE if actor.follows_at_once else 0
    # acts, pieces, path, points, slides, model, on_map, match
    counts = len(actor.acts), 0, 0, 0, actor.slides, model, actor.on_map is not None, 0
    return *pose, *driven_so_far, *counts
