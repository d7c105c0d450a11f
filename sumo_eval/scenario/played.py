"""Scripted motion of actors: moves that begin at a time or when a condition holds, paths, speeds by
time or by position.

A played vehicle drives along its line: straight on in its heading, or along a path of points. Its
motion along the line is a list of pieces of constant jerk; its lateral moves are offsets across the
line. A move is a function of the time since it began, so a move that begins within a step leads to
the same position with any step. Two kinds of moves are not: `MATCH` is integrated step by step, and
with `FOLLOW` SUMO drives. Records are plain numbers, and the loops over them are kernels:
a case has the same bits alone and in a batch.

An `Act` is a move as a scenario has it, unchangeable. Its record of `ACT` also has the state of the
move in a drive.

Users: `cosim/world.py` makes the records, `cosim/step_rules.py` moves the actors in every step;
readers of scenarios (`scenario/`, `extras/openscenario/`) write acts, `scenario/undisturbed.py`
plays them without a simulation. Other files of `cosim/` read the records,
`extras/wheel/quality.py` the begins of acts.
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
"""A move of an actor: number of the actor in its case, number of the move among the actor's."""
Step = tuple[int, int, int, float]
"""An operation of a condition: (op, one, two, value), see `Act`."""
Program = tuple[Step, ...]
"""A condition: its operations in order, for a stack."""

# Kinds and operations keep their numbers: fingerprints of drives contain them.
# Kinds of moves across the line. They have the smallest numbers: `kind <= COSINE` asks for them.
SMOOTH, CONSTANT = motion.SMOOTH, motion.CONSTANT
SINUS, COSINE = motion.SINUS, motion.COSINE
# kinds of moves along the line
SPEED = 10  # changes to a speed, with limited acceleration and jerk
BY_TIME, BY_PLACE = 11, 12  # has a profile: speeds at times, speeds at positions
PATH = 13  # continues along a path of points
KEEP = 14  # keeps the speed that it has
FOLLOW = 15  # from then on SUMO drives the vehicle
MATCH = 16  # keeps a speed, or a position, relative to another vehicle at every instant
# state of a move: its `begin` is unknown, is in the future, is past
WAITS, KNOWN, BEGUN = 0, 1, 2
EGO = -1  # stands for the ego where an actor would have its number
AT_ONCE, HANDED_OVER = 1, 2  # SUMO drives a vehicle from the start, or from a FOLLOW on

# Operations of a condition's program, which works on a stack. Those up to ENDED, and DEPARTED, put
# a value on top of it. NEGATE and ABSOLUTE change the top value. Every other operation replaces
# the two top values by one.
VALUE, TIME = 0, 1  # a constant; s since the start
X, Y = 2, 3  # of a vehicle, m
ALONG, ACROSS = 4, 5  # speeds of a vehicle along and across the road, m/s
GAP, DISTANCE = 6, 7  # between two vehicles, m
TTC, THW = 8, 9  # of two vehicles, s
ENDED = 10  # whether a move is over
ADD, SUBTRACT = 11, 12
MULTIPLY, DIVIDE = 13, 14
NEGATE = 15
SMALLER, LARGER = 16, 17  # of two values
ABSOLUTE = 18
BELOW, AT_MOST = 19, 20  # whether the first value is below, is at most the second
AND, OR = 21, 22
DEPARTED = 23  # distance of the ego from the recorded ego, m
DEEPEST = 24  # values on the stack of a condition, at most
# Columns of the stack: the value at the start of the simulation's step, and at its end. Of a
# condition these are 1 (true) or 0, and the third column has the share of the step at which it
# became true.
BEFORE, NOW, SHARE = 0, 1, 2

ACT = np.dtype(
    fields("begin", "duration", "speed", "offset", "acceleration", "jerk", "delay", "end")
    + flags("kind", "first", "count", "program", "steps", "state")
)
"""A move of an actor.

begin: s; inf while the move waits for its condition.
duration: s; of a `FOLLOW`, the time from one of its recorded positions to the next.
speed: at the end of a move along the line, or of a `CONSTANT` move across it, m/s.
offset: of a lateral move, to the left, m.
acceleration, jerk: largest, m/s2 and m/s3.
delay: from the instant at which its condition holds to `begin`, s.
end: s; inf while it is unknown.
kind: `SMOOTH` to `MATCH`.
first, count: index of the first of its rows in `TABLE`, and their number.
program, steps: index of the first operation of its condition in `PROGRAM`, and their number.
state: `WAITS`, `KNOWN` or `BEGUN`.
"""
PIECE = np.dtype(fields("duration", "acceleration", "jerk", "speed"))
"""A piece of motion along the line.

duration: s. acceleration: at its beginning, m/s2. jerk: m/s3. speed: at its end, m/s.
"""
TABLE = np.dtype(fields("one", "two"))
"""Pairs of numbers: points of a path (x, y), knots of a profile (time or position, speed),
positions of a recorded ego (x, y), or numbers of a `MATCH` (see `PLAY`)."""
PROGRAM = np.dtype(fields("value") + flags("op", "one", "two"))
"""An operation of a condition, as a `Step`."""
PLAY = np.dtype(
    fields("x", "y", "heading", "line_s", "line_time", "since", "s", "v", "a", "first_begin")
    + flags("acts", "pieces", "path", "points", "slides", "model", "on_map", "match")
)
"""Present motion of a vehicle.

x, y, heading: beginning and direction of its line, m and rad.
line_s, line_time: distance driven, m, and time, s, when the line began.
since: time from which its pieces count, s.
s, v, a: distance driven, m, and speed, m/s, at that time, and acceleration before it, m/s2.
first_begin: `begin` of its first move, s; inf before.
acts, pieces: number of its moves and of its pieces.
path, points: index of the first point of its path in `TABLE`, and number of points; 0: its line is
    straight.
slides: 1 if it keeps its heading while it moves across the line.
model: 0 while its script drives it, else `AT_ONCE` or `HANDED_OVER`.
on_map: 1 if x, y and heading are on the map of a curved road, 0 if along and across the road.
match: 0 without a `MATCH`, else 1 + the index of the first of its rows of `TABLE`. These are three
    pairs of numbers, or five where limits hold:

    1. number of the followed vehicle, or `EGO`; and a factor.
    2. a speed to add, m/s: the wanted speed is the factor times the followed vehicle's, plus this.
        And what is kept: 0: the wanted speed; 1: a position; 2: a position, within the limits of
        pairs 4 and 5.
    3. the position, m ahead of the followed vehicle; and a headway, s. Above 0: the position is
        further back by the headway times the own speed. Below 0: it is further ahead, by the
        headway's amount times the wanted speed.
    4. limits of acceleration and of deceleration, m/s2.
    5. limit of speed, m/s; the second number is unused.
"""


class Act(NamedTuple):
    """A move of a played vehicle as plain numbers; fields as in `ACT`, except these:

    begin: s; of a move with a condition, its delay.
    table: its rows of `TABLE`.
    program: its condition, operations (op, one, two, value). `one` and `two` are vehicles (a number
        or `EGO`); of `ENDED`, `two` is the number of a move. Empty: it begins at `begin`.
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
    """Records of the m played vehicles of each of n cases.

    plays: (n, m).
    acts, pieces, table, program: (n, m, largest number that one vehicle has).
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
        """A copy of these records in which the only case of `other` replaces case `row`; the last
        axes are wide enough for both.
        """
        plays = self.plays.copy()
        plays[row] = other.plays[0]
        joined = []
        for own, new in zip(self[1:], other[1:], strict=True):  # acts to program
            width = max(own.shape[-1], new.shape[-1])
            wide = _wide(own, width)
            wide[row] = _wide(new[0], width)
            joined.append(wide)
        return Players(plays, *joined)


def _wide(records: Records, width: int) -> Records:
    """A copy of records with zeros behind them, (..., width)."""
    wide = np.zeros((*records.shape[:-1], width), records.dtype)
    wide[..., : records.shape[-1]] = records
    return wide


class Cast(NamedTuple):
    """All vehicles of n cases, and the records of the played ones; or, from `case_of`, of one case.

    egos: (n,); of one case (1,).
    others: records of the actors, (n, m); of one case (m,).
    plays, acts, pieces, table, program: as in `Players`; of one case without the first axis.
    line: knots of the road's line, the same for all cases; none: it is straight.
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
    """The `Cast` of case i alone, of views: what is written to it is written to the whole."""
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
    """Distance, m, speed, m/s, and acceleration, m/s2, along the line at a time; before `since` as
    if the vehicle had had its last acceleration.
    """
    s, v, rest = play.s, play.v, time - play.since  # rest: s that the pieces must still cover
    if rest < 0.0:
        return s + rest * (v + rest * 0.5 * play.a), v + rest * play.a, play.a
    for k in range(play.pieces):
        piece = pieces[k]
        d = min(rest, piece.duration)  # time in this piece, s
        s += d * (v + d * (0.5 * piece.acceleration + d * piece.jerk / 6.0))
        if rest < piece.duration:
            speed = v + d * (piece.acceleration + 0.5 * d * piece.jerk)
            return s, max(speed, 0.0), piece.acceleration + d * piece.jerk
        v = piece.speed
        rest -= d
    return s + v * rest, v, 0.0  # after the last piece it keeps its speed


@kernel
def _put(
    pieces: Any, k: int, duration: float, acceleration: float, jerk: float, speed: float
) -> int:
    """Write piece k, unless it takes no time; return the number of pieces up to here."""
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
    rise = act.acceleration / act.jerk  # s in which the acceleration builds up; 0 if jerk is inf
    in_rise = 0.5 * act.acceleration * rise  # change of speed meanwhile, m/s
    if change <= in_rise:
        return _put(pieces, 0, sqrt(2.0 * change / act.jerk), 0.0, sign * act.jerk, act.speed)
    k = _put(pieces, 0, rise, 0.0, sign * act.jerk, v + sign * in_rise)
    constant = (change - in_rise) / act.acceleration  # s at the full acceleration
    return _put(pieces, k, constant, sign * act.acceleration, 0.0, act.speed)


@kernel
def _follow_profile(pieces: Any, v: float, s: float, act: Any, table: Any, play: Any) -> int:
    """Write the pieces of constant acceleration through the knots of a profile; return how many.

    v, s: speed, m/s, and distance driven, m, at its beginning.
    """
    k = 0  # number of pieces
    last = 0.0 if act.kind == BY_TIME else s  # knot before: s since `begin`, or distance driven, m
    for q in range(act.first, act.first + act.count):
        knot, speed = table[q].one, table[q].two
        if act.kind == BY_PLACE:
            knot = _driven_at(play, table, knot)
        apart = knot - last
        if not apart > 0.0:  # it is at or past this knot, or (nan) never gets to the last two
            continue
        if act.kind == BY_TIME:
            duration = apart
        elif v + speed > 0.0:
            duration = 2.0 * apart / (v + speed)  # at the mean of both speeds
        else:  # it stands, and never gets to the knot
            return _put(pieces, k, inf, 0.0, 0.0, 0.0)
        k = _put(pieces, k, duration, (speed - v) / duration, 0.0, speed)
        last, v = knot, speed
    return k


# -- where it is -----------------------------------------------------------------------------------


@kernel
def _driven_at(play: Any, table: Any, place: float) -> float:
    """Distance driven, m, at which the line gets to a place along the road, m; inf: never."""
    s, x, y = play.line_s, play.x, play.y
    share = cos(play.heading)  # of a distance on the line that leads along the road
    for q in range(play.path, play.path + play.points):
        dx, dy = table[q].one - x, table[q].two - y
        length = sqrt(dx * dx + dy * dy)
        if length == 0.0:
            continue
        share = dx / length
        if share > 0.0 and place <= table[q].one:
            break
        s += length
        x, y = table[q].one, table[q].two
    return s + (place - x) / share if share > 0.0 else inf


class OnLine(NamedTuple):
    """A place on a vehicle's line.

    x, y: m. heading: direction of the line, rad.
    past: distance from the last point of its path, m; below 0: that point is still ahead.
    """

    x: float
    y: float
    heading: float
    past: float


@kernel
def on_line(play: Any, table: Any, s: float) -> OnLine:
    """Place on the line after the vehicle has driven s m."""
    x, y, heading = play.x, play.y, play.heading
    rest = s - play.line_s  # m from x, y on
    for q in range(play.path, play.path + play.points):
        dx, dy = table[q].one - x, table[q].two - y
        length = sqrt(dx * dx + dy * dy)
        if length == 0.0:
            continue
        heading = atan2(dy, dx)
        if rest < length:
            return OnLine(x + dx * rest / length, y + dy * rest / length, heading, rest - length)
        rest -= length
        x, y = table[q].one, table[q].two
    # straight on
    return OnLine(x + rest * cos(heading), y + rest * sin(heading), heading, rest)


@kernel
def _beside_line(
    play: Any, acts: Any, table: Any, s: float, time: float
) -> tuple[OnLine, float, float]:
    """Place after the vehicle has driven s m, beside its line where it moves across it; speed, m/s,
    and acceleration, m/s2, to the left.

    Lateral values are the sums over all lateral moves that began on this line.
    """
    at = on_line(play, table, s)
    aside, across, sideways = 0.0, 0.0, 0.0
    for q in range(play.acts):
        act = acts[q]
        if act.kind <= COSINE and act.state == BEGUN and act.begin >= play.line_time:
            offset, speed, acceleration = lateral_motion(act, time)
            aside += offset
            across += speed
            sideways += acceleration
    if aside != 0.0:
        x, y = at.x - aside * sin(at.heading), at.y + aside * cos(at.heading)
        at = OnLine(x, y, at.heading, at.past)
    return at, across, sideways


@kernel
def place(
    other: Any, play: Any, acts: Any, pieces: Any, table: Any, time: float, line: Any
) -> None:
    """Put a played vehicle where it is at a time.

    other: its record, which is written. line: knots of the road's line; none: it is straight.

    On a curved road most scripts are along and across the road: heading and speeds become those
    over the ground (`_over_ground`). A vehicle that is played on the map (`on_map`) gets the road
    coordinates of its position (`_into_frame`).
    """
    s, v, a = driven(play, pieces, time)
    at, across, sideways = _beside_line(play, acts, table, s, time)

    last_x, last_heading = other.x, other.heading
    other.x, other.y = at.x, at.y
    other.heading, other.across = at.heading, across
    other.speed, other.acceleration = v, a
    if not play.slides and across != 0.0:
        other.heading = at.heading + atan2(across, v)
        other.across = 0.0
        other.speed = sqrt(v * v + across * across)
        other.acceleration = along_heading(v, across, a, sideways)

    if not len(line):
        return
    if play.on_map:
        _into_frame(other, line, last_x, last_heading)
    else:
        _over_ground(other, line)


@kernel
def _into_frame(other: Any, line: Any, last_x: float, last_heading: float) -> None:
    """Turn a position and a heading on the map into those along and across the road.

    The search begins at the last x. The heading is the one nearest to the last heading, so that it
    does not jump by 2 pi.
    """
    at = to_frame(line, other.x, other.y, other.heading, last_x)
    other.x, other.y = at.x, at.y
    turns = floor((last_heading - at.heading) / (2.0 * pi) + 0.5)  # whole turns to add
    other.heading = at.heading + 2.0 * pi * turns


@kernel
def _over_ground(other: Any, line: Any) -> None:
    """Turn heading and speeds along and across the line into those over the ground.

    At the offset y a metre along the line is `inner` = 1 - curvature y metres of ground. So the
    part of the heading's unit vector along the line is stretched by `inner`. `stretched` is the
    length of the result, (c, s) its direction.
    """
    inner = 1.0 - line_at(line, other.x).curvature * other.y
    c, s = cos(other.heading) * inner, sin(other.heading)
    stretched = sqrt(c * c + s * s)
    c, s = c / stretched, s / stretched
    # speeds over the ground, along the line and to its left, m/s
    along = inner * (other.speed * cos(other.heading) - other.across * sin(other.heading))
    left = other.speed * sin(other.heading) + other.across * cos(other.heading)
    if other.heading != 0.0:  # exactly along the line stays exactly along the line
        other.heading = atan2(s, c)
    other.speed, other.across = along * c + left * s, left * c - along * s
    other.acceleration *= stretched  # to first order: `inner` changes slowly along the road


# -- conditions ------------------------------------------------------------------------------------


@kernel
def _body_of(cast: Any, number: int, end: int) -> Body:
    """The body of an actor, by its number, or of the `EGO`, at the beginning (`BEFORE`) or at the
    end (`NOW`) of a step.
    """
    if number == EGO:
        return _body(cast.egos[0], end)
    return _body(cast.others[number], end)


@kernel
def _body(record: Any, end: int) -> Body:
    """The body of a vehicle's record at a step's beginning (`BEFORE`) or at its end (`NOW`)."""
    if end == BEFORE:  # `body_of` takes pose, speeds and size
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
    """`GAP` or `DISTANCE`, m, `TTC` or `THW`, s, of two bodies; `one` counts as the follower."""
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
def departed(act: Any, table: Any, x: float, y: float, time: float) -> float:
    """Distance of x, y from the position of the recorded ego at a time, m; after the end of the
    recording, from its last position.

    act: a `FOLLOW`. Its rows of `table` are the positions of the recorded ego, its `duration` is
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
def _pushed(cast: Any, j: int, act: Any, step: Any, end: int, time: float) -> float:
    """The value that an operation puts on the stack.

    act: a move of actor j.
    step: an operation of the move's program.
    end: of the simulation's step, `BEFORE` or `NOW`. time: at this end, s.
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
    """Write to row k of the stack, for each end of the step, whether a margin is positive, and the
    share of the step at which it became so.

    The margin is taken to change linearly. Where it is infinite or undefined, the share is 1.

    margin_before, margin: at the start and at the end of the step.
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
        if op == ENDED:
            k += 1
            ended = cast.acts[step.one, step.two].end
            _compare(stack, k, before - ended, now - ended, True)
        elif op < ENDED or op == DEPARTED:
            k += 1
            stack[k, BEFORE] = _pushed(cast, j, act, step, BEFORE, before)
            stack[k, NOW] = _pushed(cast, j, act, step, NOW, now)
        else:
            if op not in (NEGATE, ABSOLUTE):  # two values become one
                k -= 1
            _operate(stack, k, op)
    return float(stack[0, SHARE]) if stack[0, NOW] > 0.0 else -1.0


@kernel
def _operate(stack: Any, k: int, op: int) -> None:
    """Write the result of an operation to row k of the stack.

    Its operands are in the rows k and k + 1; that of `NEGATE` and `ABSOLUTE` is in row k.
    """
    if op in (BELOW, AT_MOST):
        margin_before = stack[k + 1, BEFORE] - stack[k, BEFORE]
        margin = stack[k + 1, NOW] - stack[k, NOW]
        _compare(stack, k, margin_before, margin, op == AT_MOST)
        return
    if op in (AND, OR):
        stack[k, SHARE] = _joint_share(stack, k, op)
    for end in range(2):  # `BEFORE`, `NOW`
        stack[k, end] = arithmetic(op, stack[k, end], stack[k + 1, end])


@kernel
def arithmetic(op: int, a: float, b: float) -> float:
    """Result of an operation on a, or on a and b; of conditions 1 or 0."""
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
    """Begin the move `acts[chosen]`, from the motion of the vehicle at that time."""
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

    s, v, a = driven(play, pieces, act.begin)
    if act.kind == PATH:
        _begin_path(play, acts, act, table, s)
        return
    play.since, play.s = act.begin, s
    play.v, play.a = v, a
    play.match = act.first + 1 if act.kind == MATCH else 0
    if act.kind in (KEEP, MATCH):  # for ever
        play.pieces, act.end = 0, inf
        return
    if act.kind == SPEED:
        play.pieces = _speed_up(pieces, v, act)
    else:
        play.pieces = _follow_profile(pieces, v, s, act, table, play)
    duration = 0.0
    for k in range(play.pieces):
        duration += pieces[k].duration
    act.end = act.begin + duration


@kernel
def _begin_path(play: Any, acts: Any, act: Any, table: Any, s: float) -> None:
    """Make the path of a move the vehicle's line, from where the vehicle is after s m."""
    at, _, _ = _beside_line(play, acts, table, s, act.begin)
    play.x, play.y, play.heading = at.x, at.y, at.heading
    play.line_s, play.line_time = s, act.begin
    play.path, play.points = act.first, act.count
    act.end = inf  # `_end_path` writes it: it depends on the speed


@kernel
def _order(act: Any) -> tuple[float, bool]:
    """Sort key of due moves: of those that begin together a path is first, as the places of a
    profile lie on it.
    """
    return act.begin, act.kind != PATH


@kernel
def begin_due(play: Any, acts: Any, pieces: Any, table: Any, time: float, step_ends: bool) -> bool:
    """Begin all moves of a vehicle that are due by a time, the earliest first; whether any began.

    step_ends: whether SUMO has already stepped to this time; only then can a `FOLLOW` begin.
    """
    begun = False
    while True:
        chosen = -1  # number of the earliest due move; -1: none
        for q in range(play.acts):
            due = acts[q].state == KNOWN and acts[q].begin <= time
            due = due and (step_ends or acts[q].kind != FOLLOW)
            if due and (chosen < 0 or _order(acts[q]) < _order(acts[chosen])):
                chosen = q
        if chosen < 0:
            return begun
        for q in range(play.acts):
            # a move with a later `begin` has begun already, because only the step's end showed that
            # the chosen one begins, too: it begins again after this one
            if acts[q].state == BEGUN and acts[q].begin > acts[chosen].begin:
                acts[q].state = KNOWN
        _begin(play, acts, chosen, pieces, table)
        begun = True


@kernel
def _end_path(play: Any, acts: Any, pieces: Any, table: Any, now: float, before: float) -> None:
    """Write when the vehicle came to the last point of its path, if it did in this step."""
    for q in range(play.acts):
        act = acts[q]
        underway = act.kind == PATH and act.state == BEGUN and isinf(act.end)
        if not underway or act.first != play.path:  # or a later path has replaced this one
            continue
        s, last_s = driven(play, pieces, now)[0], driven(play, pieces, before)[0]
        past, moved = on_line(play, table, s).past, s - last_s
        if past >= 0.0:
            share = 1.0 - past / moved if moved > 0.0 else 1.0
            act.end = before + max(share, 0.0) * (now - before)


@kernel
def _match(cast: Any, j: int, now: float) -> None:
    """Move actor j to `now` as its `MATCH` demands (`PLAY` explains its rows of `TABLE`).

    Its speed has changed linearly since the last step, unless it keeps a position without limits.
    """
    play, table, own = cast.plays[j], cast.table[j], cast.others[j]
    first = play.match - 1
    followed, factor = int(table[first].one), table[first].two
    added, kept = table[first + 1].one, table[first + 1].two
    distance, headway = table[first + 2].one, table[first + 2].two

    other = _body_of(cast, followed, NOW)
    elapsed = now - play.since
    speed = max(factor * _component(ALONG, other) + added, 0.0)
    if len(cast.line) and not play.on_map:
        # from speed over the ground to speed along the road's line, which differ at an offset y
        speed /= 1.0 - line_at(cast.line, own.x).curvature * own.y
    ahead = 0.5 * (play.v + speed) * elapsed  # distance to drive in this step, m
    if kept > 0.0:  # a position: `ahead` is the way to it
        ahead = other.x + distance - on_line(play, table, play.s).x
        if headway < 0.0:
            ahead -= headway * speed
        if kept > 1.0:  # within limits
            speed = _approach(play, speed, ahead, headway, elapsed, table)
            ahead = 0.5 * (play.v + speed) * elapsed
        elif headway > 0.0:
            # drive d so that the rest, ahead - d, is the headway times the own speed, d / elapsed
            ahead = ahead * elapsed / (elapsed + headway) if elapsed > 0.0 else 0.0
            speed = ahead / elapsed if elapsed > 0.0 else play.v
    play.s += ahead
    play.since, play.v = now, max(speed, 0.0)


@kernel
def _approach(
    play: Any, speed: float, ahead: float, headway: float, elapsed: float, table: Any
) -> float:
    """Speed, within its limits, of a vehicle that closes in on its position of a `MATCH`, m/s.

    speed: of the position, m/s: of the followed vehicle, times the factor and plus the speed of the
        first two rows of `PLAY.match`.
    ahead: distance to the position, m.
    headway: above 0, the position is further back by the headway times the own speed, s.
    elapsed: time since the last step, s.
    """
    first = play.match - 1  # + 3, + 4: pairs 4 and 5 of `PLAY.match`
    acceleration, deceleration = table[first + 3].one, table[first + 3].two
    top_speed = table[first + 4].one
    behind = max(headway, 0.0)
    # distance to the position at the last step; since then it has moved as the other vehicle
    apart = ahead - speed * elapsed - behind * play.v
    # the fastest closing speed that can be reduced to 0 in time, and that does not pass the
    # position in this step (driving faster moves it back by the headway); 1e-9 s instead of a
    # division by 0
    rate = deceleration if apart > 0.0 else acceleration
    closing = min(sqrt(2.0 * rate * abs(apart)), abs(apart) / max(elapsed + behind, 1e-9))
    wanted = min(speed + (closing if apart > 0.0 else -closing), top_speed)
    slowest, fastest = play.v - deceleration * elapsed, play.v + acceleration * elapsed
    return float(max(min(wanted, fastest), slowest, 0.0))


@kernel
def wake(cast: Any, now: float, before: float) -> None:
    """Begin the waiting moves of a case whose conditions hold at the end of a step.

    Where a move began, all are placed again; those that match another's motion always are.

    now, before: ends of the step, s.
    """
    for j in range(len(cast.others)):  # first: the end of a path may begin another move
        if cast.plays[j].model == 0:
            _end_path(cast.plays[j], cast.acts[j], cast.pieces[j], cast.table[j], now, before)
    begun = False
    while _begin_moves(cast, now, before):  # a move that ends in this step may begin another
        begun = True
    for j in range(len(cast.others)):
        play = cast.plays[j]
        if play.model:
            continue
        if play.match:
            _match(cast, j, now)
        if begun or play.match:
            acts, pieces, table = cast.acts[j], cast.pieces[j], cast.table[j]
            place(cast.others[j], play, acts, pieces, table, now, cast.line)


@kernel
def _begin_moves(cast: Any, now: float, before: float) -> bool:
    """Begin the moves of a case that are due at the end of a step; whether any began."""
    _find_begins(cast, now, before)
    begun = False
    for j in range(len(cast.others)):
        play = cast.plays[j]
        if play.model == 0 and begin_due(
            play, cast.acts[j], cast.pieces[j], cast.table[j], now, True
        ):
            begun = True
    return begun


@kernel
def _find_begins(cast: Any, now: float, before: float) -> None:
    """Write `begin` of the waiting moves whose conditions hold at the end of a step."""
    for j in range(len(cast.others)):
        for q in range(cast.plays[j].acts):
            act = cast.acts[j, q]
            if act.state == WAITS:
                share = holds_from(cast, j, act, now, before)
                if share >= 0.0:
                    act.begin = before + share * (now - before) + act.delay
                    act.state = KNOWN


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

    Both times hold for every case: cases with conditions begin and step together.
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
    plays = np.array([_play_of(actor) for actor in actors], PLAY).reshape(shape)
    of_actors = [_rows_of(actor) for actor in actors]
    acts, table, program = (
        _padded(layout, [rows[kind] for rows in of_actors], shape)
        for kind, layout in enumerate((ACT, TABLE, PROGRAM))
    )
    # a profile needs one piece for each knot, a change of speed two
    pieces = np.zeros((*shape, table.shape[2] + 2), PIECE)
    return Players(plays, acts, pieces, table, program)


def _padded(layout: Any, rows: Sequence[Any], shape: tuple[int, int]) -> Records:
    """The rows of each vehicle as records, (n, m, largest number that one has, at least 1); behind
    them zeros.

    rows: of n * m vehicles. shape: (n, m).
    """
    array = np.zeros((len(rows), max(map(len, rows), default=0) or 1), layout)
    for records, values in zip(array, rows, strict=True):
        if values:
            records[: len(values)] = values
    return array.reshape(*shape, array.shape[1])


def _rows_of(actor: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """Rows of `ACT`, `TABLE` and `PROGRAM` of an actor, each in the order of its fields."""
    acts: list[Any] = []
    table: list[Any] = []
    program: list[Any] = []
    for act in actor.acts:
        begin, state = (inf, WAITS) if act.program else (act.begin, KNOWN)
        numbers = act.duration, act.speed, act.offset, act.acceleration, act.jerk
        # first, count, program, steps
        places = len(table), len(act.table), len(program), len(act.program)
        # `begin` of a move with a condition is its delay; `end` is inf: it is unknown
        acts.append((begin, *numbers, act.begin, inf, act.kind, *places, state))
        table += act.table
        program += [(value, op, one, two) for op, one, two, value in act.program]
    return acts, table, program


def _play_of(actor: Any) -> tuple[Any, ...]:
    """A row of `PLAY` at the start, in the order of its fields."""
    start = actor.start
    pose = (start.x, start.y, actor.heading) if actor.on_map is None else actor.on_map
    # line_s, line_time, since, s, v, a, first_begin
    driven_so_far = 0.0, 0.0, 0.0, 0.0, start.speed, 0.0, inf
    model = AT_ONCE if actor.follows_at_once else 0
    # acts, pieces, path, points, slides, model, on_map, match
    counts = len(actor.acts), 0, 0, 0, actor.slides, model, actor.on_map is not None, 0
    return *pose, *driven_so_far, *counts
