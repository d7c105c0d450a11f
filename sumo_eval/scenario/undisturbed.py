"""Motion of the actors while the ego keeps its speed, or brakes ideally, from their scripts alone,
without SUMO.

Actors with a SUMO model are assumed to keep their speed: only SUMO knows what its models would do.

Users: `ads/foresight.py`, `cosim/openscenario.py`, `method/conflict.py` (zones),
`record/loops.py`, `scenario/reachable.py`, `scoring/plausible_people.py`, `extras/rates/`.
"""

from collections.abc import Sequence
from math import cos, inf, isinf, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.kernels import fields, interpreted, kernel, rows
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.played import (
    AT_ONCE,
    HANDED_OVER,
    Cast,
    case_of,
    move,
    players,
    wake,
)
from sumo_eval.scenario.road.reference_line import knots_of
from sumo_eval.scenario.touch import velocity
from sumo_eval.trajectory import FloatArray, IntArray

CHANNELS = ("x", "y", "heading", "speed", "across")
"""Road coordinates of the centre, m; heading, rad; speeds along and left of the heading, m/s."""
_STATE = fields(*CHANNELS)
_BODY = [*_STATE, *fields("length", "width"), ("before", _STATE)]  # before: state a look earlier
# record of an ego; brakes_from: time at which ideal braking begins, s; inf: not known yet
_EGO = np.dtype([*_BODY, *fields("start_x", "start_y", "start_speed", "brakes_from")])
_OTHER = np.dtype([*_BODY, *fields("acceleration")])  # record of an actor


class Tracks(NamedTuple):
    """Motion of the m actors of each of n cases at T looks: the times k * step, k = 0..T-1.

    others: of the actors, (n, m, T, 5); the last axis has the `CHANNELS`.
    begins: when each actor made its first move, s, (n, m); inf where it made none.
    """

    others: FloatArray
    begins: FloatArray


def tracks(
    concretes: Sequence[ConcreteScenario],
    bodies: Sequence[tuple[float, float]],
    step: float,
    until: float,
    *,
    in_python: bool = False,
) -> Tracks:
    """Tracks of cases on one road with equally many actors, while the egos keep their speed.

    bodies: length and width of each ego, m.
    step: between two looks, s.
    until: the tracks reach at least this time, s.
    in_python: run the kernels as plain Python, for a single case: nothing has to be compiled.
    """
    cast = _at_start(concretes, bodies)
    others = np.zeros((*cast.others.shape, _looks(until, step), len(CHANNELS)))
    run = interpreted(_run_rows) if in_python else _run_rows
    run(cast, others, step)
    return Tracks(others, cast.plays["first_begin"])


def meetings(
    concretes: Sequence[ConcreteScenario], bodies: Sequence[tuple[float, float]], step: float,
    until: ArrayLike,
    deceleration: float, obstacle: int, delays: Sequence[float],
) -> FloatArray:  # fmt: skip
    """Encounters of ideally braking egos with an obstacle: (n, 3), a row for each case.

    Columns: largest inverse TTC, 1/s (inf where both touch); impact speed, m/s (0: no contact);
        smallest gap while the obstacle is in the ego's path, m (inf: it never is).

    step: between two looks, s.
    until: end of each case, s, (n,), chosen for that case alone: its result must not depend on the
        other cases.
    deceleration: of the egos, to a standstill, m/s2.
    obstacle: number of an actor, the same in every case.
    delays: time from the obstacle's first move until the ego brakes, s, (n,); from the start if the
        obstacle has no moves.
    """
    encounters = np.zeros((len(concretes), 3))
    cast, waits = _at_start(concretes, bodies), np.array(delays, float)
    _meet_rows(cast, step, _looks(until, step), deceleration, obstacle, waits, encounters)
    return encounters


def _looks(until: ArrayLike, step: float) -> Any:
    """Number of looks, from the one at time 0 to the first at or after `until`; at least two."""
    steps = np.ceil(np.asarray(until) / step - 1e-9)  # - 1e-9: rounding must not add one
    return np.maximum(steps, 1.0).astype(np.int64) + 1


def _at_start(concretes: Sequence[ConcreteScenario], bodies: Sequence[tuple[float, float]]) -> Cast:
    """All vehicles at the start; arguments as in `tracks`."""
    n, m = len(concretes), len(concretes[0].actors)
    egos, others = np.zeros(n, _EGO), np.zeros((n, m), _OTHER)
    # each record in the order of its fields: state, length and width, state before, the rest
    for i, (concrete, body) in enumerate(zip(concretes, bodies, strict=True)):
        ego = concrete.ego
        state = (ego.x, ego.y, ego.heading, ego.speed, 0.0)
        egos[i] = (*state, *body, state, ego.x, ego.y, ego.speed, inf)
        for j, actor in enumerate(concrete.actors):
            state = (actor.start.x, actor.start.y, actor.heading, actor.start.speed, 0.0)
            others[i, j] = (*state, actor.length, actor.width, state, 0.0)
    played = players([concrete.actors for concrete in concretes])
    return Cast(egos, others, *played, knots_of(concretes[0].road.line))


@kernel
def _keep_before(body: Any) -> None:
    """Copy the state of a body to `before`, for the next look."""
    before = body.before
    before.x, before.y, before.heading = body.x, body.y, body.heading
    before.speed, before.across = body.speed, body.across


@kernel
def _brake(ego: Any, now: float, deceleration: float) -> None:
    """Put an ego where it is at a time: it keeps its speed, and brakes from `brakes_from` on.

    now: s. deceleration: m/s2; 0: it never brakes.
    """
    since, driven = now - ego.brakes_from, ego.start_speed * now
    if since > 0.0 and deceleration > 0.0:
        braking = min(since, ego.start_speed / deceleration)  # s, until it stands
        ego.speed = ego.start_speed - deceleration * braking
        driven = ego.start_speed * ego.brakes_from + 0.5 * braking * (ego.start_speed + ego.speed)
    if ego.heading == 0.0:
        ego.x = ego.start_x + driven
    else:  # it starts with a heading, and keeps it
        ego.x = ego.start_x + driven * cos(ego.heading)
        ego.y = ego.start_y + driven * sin(ego.heading)


@kernel
def _advance(case: Any, now: float, before: float, deceleration: float) -> None:
    """Move a case from one look to the next.

    before, now: times of the looks, s.
    deceleration: as in `_brake`.
    """
    ego, others, plays = case.egos[0], case.others, case.plays
    _keep_before(ego)
    _brake(ego, now, deceleration)
    for j in range(len(others)):
        other, play = others[j], plays[j]
        _keep_before(other)
        if play.model == AT_ONCE:  # SUMO drives it from the start: it keeps its speed
            other.x = play.x + play.v * now
        elif play.model == HANDED_OVER:  # it keeps the speed that it had when SUMO took over
            other.x += other.speed * (now - before)
            other.heading, other.across = 0.0, 0.0
        else:
            move(other, play, case.acts[j], case.pieces[j], case.table[j], now, case.line)
    wake(case, now, before)


@rows
def _run_rows(cast: Cast, tracks: FloatArray, step: float) -> None:
    """Fill the tracks of every case, (n, m, T, 5)."""
    for i in range(len(cast.egos)):
        case = case_of(cast, i)
        for k in range(tracks.shape[2]):
            _advance(case, k * step, max(k - 1, 0) * step, 0.0)
            for j in range(len(case.others)):
                it = case.others[j]
                tracks[i, j, k] = it.x, it.y, it.heading, it.speed, it.across


@rows
def _meet_rows(
    cast: Cast, step: float, looks: IntArray,
    deceleration: float, obstacle: int, delays: FloatArray,
    encounters: FloatArray,
) -> None:  # fmt: skip
    """Write `meetings` of every case to `encounters`, (n, 3).

    looks: number of looks of each case, (n,); other arguments as in `meetings`.

    A case ends when both touch, or once its ego stands and the obstacle does not come nearer.
    """
    for i in range(len(cast.egos)):
        case, row = case_of(cast, i), encounters[i]
        ego, other = case.egos[0], case.others[obstacle]
        row[2] = inf
        for k in range(looks[i]):
            now = k * step
            if isinf(ego.brakes_from):  # the obstacle's first move was still to come
                play = case.plays[obstacle]
                begin = 0.0 if play.acts == 0 else play.first_begin
                ego.brakes_from = begin + delays[i]
            _advance(case, now, max(k - 1, 0) * step, deceleration)
            along, across = velocity(other)
            closing = ego.speed - along
            if _touches(ego, other, closing, row):
                row[0], row[1] = inf, sqrt(closing * closing + across * across)
                break
            if ego.speed <= 0.0 and ego.brakes_from < now and closing <= 0.0:
                break


@kernel
def _touches(ego: Any, other: Any, closing: float, row: FloatArray) -> bool:
    """Whether the ego touches the obstacle. If not, the row of `meetings` gets the largest inverse
    TTC and the smallest gap up to this look.

    closing: speed of the ego along the road less that of the obstacle, m/s.
    """
    c, s = cos(other.heading), sin(other.heading)
    # bodies overlap where their centres are less than `long` m apart along the road, and less than
    # `wide` m across it
    long = 0.5 * (ego.length + other.length * abs(c) + other.width * abs(s))
    wide = 0.5 * (ego.width + other.length * abs(s) + other.width * abs(c))
    ahead = other.x - ego.x
    if not abs(other.y - ego.y) < wide:  # it is not in the ego's path
        return False
    if abs(ahead) <= long:
        return True
    gap = ahead - long
    if gap > 0.0:
        row[2] = min(row[2], gap)
        if closing > 0.0:
            row[0] = max(row[0], closing / gap)
    return False
