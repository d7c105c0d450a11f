"""Motion of the actors while the ego keeps its speed, or brakes ideally: scripts, no simulation.

Actors with a SUMO model are assumed to keep their speed: only SUMO knows what its models would do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.kernels import interpreted, kernel, rows
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.played import (
    AT_ONCE,
    BEGUN,
    DEEPEST,
    HANDED_OVER,
    Players,
    Records,
    begin_due,
    place,
    players,
    wake,
)
from sumo_eval.scenario.road.reference_line import knots_of
from sumo_eval.trajectory import FloatArray

_STATE = [(name, "f8") for name in ("x", "y", "heading", "speed", "across")]
_EGO = np.dtype(
    [
        *_STATE, ("length", "f8"), ("width", "f8"), ("before", _STATE), ("start_x", "f8"),
        ("start_y", "f8"),
        ("start_speed", "f8"), ("brakes_from", "f8"),
    ]
)  # fmt: skip
_OTHER = np.dtype(
    [*_STATE, ("length", "f8"), ("width", "f8"), ("before", _STATE), ("acceleration", "f8")]
)
CHANNELS = ("x", "y", "heading", "speed", "across")


class Tracks(NamedTuple):
    """Motion at times k * step: (n, T, 5) of the egos, (n, m, T, 5) of the actors; channels
    `CHANNELS`.

    begins: when each actor made its first move, s, inf where it made none, (n, m).
    """

    egos: FloatArray
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
    """Tracks of cases with equally many actors, while the egos keep their speed.

    bodies: of each, length and width.

    in_python: for a single case, whose caller shall not wait for machine code.
    """
    n, m, count = len(concretes), len(concretes[0].actors), _looks(until, step)
    egos, others, found = _begun(concretes, bodies)
    way, theirs = np.zeros((n, count, 5)), np.zeros((n, m, count, 5))
    run = interpreted(_run_rows) if in_python else _run_rows
    run(
        egos,
        others,
        *found,
        way,
        theirs,
        step,
        np.zeros((DEEPEST, 3)),
        knots_of(concretes[0].road.line),
    )
    return Tracks(way, theirs, found.plays["first_begin"].copy())


def meetings(
    concretes: Sequence[ConcreteScenario], bodies: Sequence[tuple[float, float]], step: float,
    until: float,
    deceleration: float, obstacle: int, delays: Sequence[float],
) -> FloatArray:  # fmt: skip
    """Largest inverse TTC, 1/s, impact speed, m/s, and smallest gap, m, if the ego brakes ideally.

    (n, 3), one row a case; the gap counts while the obstacle is in the ego's path. The ego brakes
    to a standstill with `deceleration` m/s2 from the first move of actor number `obstacle` plus its
    delay (s, one a case); from the start where that actor waits for nothing. The inverse TTC is inf
    where both touch.

    step: s between two looks.
    """
    egos, others, found = _begun(concretes, bodies)
    met = np.zeros((len(concretes), 3))
    _meet_rows(
        egos, others, *found, met, _looks(until, step), step, deceleration, obstacle,
        np.array(delays, dtype=np.float64), np.zeros((DEEPEST, 3)),
        knots_of(concretes[0].road.line),
    )  # fmt: skip
    return met


def _looks(until: float, step: float) -> int:
    return max(math.ceil(until / step - 1e-9), 1) + 1


def _begun(
    concretes: Sequence[ConcreteScenario], bodies: Sequence[tuple[float, float]]
) -> tuple[Records, Records, Players]:
    """All vehicles at the start."""
    n, m = len(concretes), len(concretes[0].actors)
    egos, others = np.zeros(n, _EGO), np.zeros((n, m), _OTHER)
    for i, (concrete, (length, width)) in enumerate(zip(concretes, bodies, strict=True)):
        ego = concrete.ego
        pose = (ego.x, ego.y, ego.heading, ego.speed, 0.0)
        egos[i] = (*pose, length, width, pose, ego.x, ego.y, ego.speed, math.inf)
        for j, actor in enumerate(concrete.actors):
            pose = (actor.start.x, actor.start.y, actor.heading, actor.start.speed, 0.0)
            others[i, j] = (*pose, actor.length, actor.width, pose, 0.0)
    return egos, others, players([concrete.actors for concrete in concretes])


@kernel
def _braking_from(play: Any, acts: Any, delay: float) -> float:
    """When ideal braking begins, s; inf while the obstacle waits."""
    if not math.isinf(play.first_begin):
        return float(play.first_begin + delay)
    for q in range(play.acts):
        if acts[q].state != BEGUN:
            return math.inf
    return delay


@kernel
def _look(
    ego: Any, others: Any, plays: Any, acts: Any, pieces: Any, table: Any, program: Any,
    now: float, before: float,
    deceleration: float, stack: Any, line: Any,
) -> None:  # fmt: skip
    """Move a case from one look to the next."""
    was = ego.before
    was.x, was.y, was.heading, was.speed = ego.x, ego.y, ego.heading, ego.speed
    t = now - ego.brakes_from
    way = ego.start_speed * now
    if t > 0.0 and deceleration > 0.0:
        braked = min(t, ego.start_speed / deceleration)
        ego.speed = ego.start_speed - deceleration * braked
        way = ego.start_speed * ego.brakes_from + 0.5 * braked * (ego.start_speed + ego.speed)
    if ego.heading == 0.0:
        ego.x = ego.start_x + way
    else:  # it began sideways, and holds its wheel straight
        ego.x = ego.start_x + way * math.cos(ego.heading)
        ego.y = ego.start_y + way * math.sin(ego.heading)
    for j in range(len(others)):
        other, play = others[j], plays[j]
        last = other.before
        last.x, last.y, last.heading = other.x, other.y, other.heading
        last.speed, last.across = other.speed, other.across
        if play.model == AT_ONCE:
            other.x = play.x + play.v * now
            continue
        if play.model == HANDED_OVER:  # it keeps the speed that it had then
            other.x, other.heading, other.across = other.x + other.speed * (now - before), 0.0, 0.0
            continue
        begin_due(play, acts[j], pieces[j], table[j], now)
        place(other, play, acts[j], pieces[j], table[j], now, line)
    wake(ego, others, plays, acts, pieces, table, program, now, before, stack, line)


@rows
def _run_rows(
    egos: Records, others: Records, plays: Records, acts: Records, pieces: Records, table: Records,
    program: Records,
    way: FloatArray, theirs: FloatArray, step: float, stack: FloatArray, line: Records,
) -> None:  # fmt: skip
    """Fill the tracks of every row."""
    for i in range(len(egos)):
        ego = egos[i]
        for k in range(way.shape[1]):
            _look(
                ego, others[i], plays[i], acts[i], pieces[i], table[i], program[i], k * step,
                max(k - 1, 0) * step, 0.0,
                stack, line,
            )  # fmt: skip
            way[i, k, 0], way[i, k, 1], way[i, k, 2], way[i, k, 3] = (
                ego.x,
                ego.y,
                ego.heading,
                ego.speed,
            )
            for j in range(len(others[i])):
                other = others[i][j]
                theirs[i, j, k, 0], theirs[i, j, k, 1], theirs[i, j, k, 2] = (
                    other.x,
                    other.y,
                    other.heading,
                )
                theirs[i, j, k, 3], theirs[i, j, k, 4] = other.speed, other.across


@rows
def _meet_rows(
    egos: Records, others: Records, plays: Records, acts: Records, pieces: Records, table: Records,
    program: Records,
    met: FloatArray, looks: int, step: float, deceleration: float, obstacle: int,
    delays: FloatArray,
    stack: FloatArray, line: Records,
) -> None:  # fmt: skip
    """Results of every row; a row ends once its ego stands, touched the obstacle, or is past it."""
    for i in range(len(egos)):
        ego, other = egos[i], others[i][obstacle]
        met[i, 0], met[i, 1], met[i, 2] = 0.0, 0.0, math.inf
        for k in range(looks):
            now = k * step
            if math.isinf(ego.brakes_from):
                ego.brakes_from = _braking_from(plays[i][obstacle], acts[i][obstacle], delays[i])
            _look(
                ego, others[i], plays[i], acts[i], pieces[i], table[i], program[i], now,
                max(k - 1, 0) * step,
                deceleration, stack, line,
            )  # fmt: skip
            c, s = math.cos(other.heading), math.sin(other.heading)
            reach = 0.5 * (ego.length + other.length * abs(c) + other.width * abs(s))
            wide = 0.5 * (ego.width + other.length * abs(s) + other.width * abs(c))
            ahead = other.x - ego.x
            closing = ego.speed - (other.speed * c - other.across * s)
            if abs(other.y - ego.y) < wide:
                if abs(ahead) <= reach:
                    across = other.speed * s + other.across * c
                    met[i, 0], met[i, 1] = math.inf, math.sqrt(closing * closing + across * across)
                    break
                gap = ahead - reach
                if gap > 0.0:
                    met[i, 2] = min(met[i, 2], gap)
                    if closing > 0.0:
                        met[i, 0] = max(met[i, 0], closing / gap)
            if ego.speed <= 0.0 and ego.brakes_from < now and closing <= 0.0:
                break
