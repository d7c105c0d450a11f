"""Motion of the actors while the ego keeps its speed, or brakes ideally: scripts, no simulation.

Actors with a SUMO model are assumed to keep their speed: only SUMO knows what its models would do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sumo_eval.kernels import interpreted, kernel, rows
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.played import (
    AT_ONCE,
    BEGUN,
    DEEPEST,
    HANDED_OVER,
    Cast,
    Records,
    case_of,
    move,
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
    cast = _begun(concretes, bodies)
    n, m = cast.others.shape
    found = np.zeros((n, 1 + m, _looks(until, step), 5))
    run = interpreted(_run_rows) if in_python else _run_rows
    run(cast, found, step, np.zeros((DEEPEST, 3)), knots_of(concretes[0].road.line))
    return Tracks(found[:, 0], found[:, 1:], cast.plays["first_begin"])


class Braking(NamedTuple):
    """Ideal braking of egos, each `delays` s after the first move of actor number `obstacle`.

    deceleration: m/s2. step: s between two looks; looks: how many, (n,). delays: (n,).
    """

    deceleration: float
    obstacle: int
    delays: FloatArray
    step: float
    looks: NDArray[np.int64]


def meetings(
    concretes: Sequence[ConcreteScenario], bodies: Sequence[tuple[float, float]], step: float,
    until: ArrayLike,
    deceleration: float, obstacle: int, delays: Sequence[float],
) -> FloatArray:  # fmt: skip
    """Largest inverse TTC, 1/s, impact speed, m/s, and smallest gap, m, if the ego brakes ideally.

    (n, 3), one row a case; the gap counts while the obstacle is in the ego's path. The ego brakes
    to a standstill with `deceleration` m/s2 from the first move of actor number `obstacle` plus its
    delay (s, one a case); from the start where that actor waits for nothing. The inverse TTC is inf
    where both touch.

    step: s between two looks.
    until: s, one a case: its own, because nothing may depend on the cases searched with it.
    """
    after = np.array(delays, dtype=np.float64)
    braking = Braking(deceleration, obstacle, after, step, _looks(until, step))
    met, line = np.zeros((len(concretes), 3)), knots_of(concretes[0].road.line)
    _meet_rows(_begun(concretes, bodies), braking, met, np.zeros((DEEPEST, 3)), line)
    return met


def _looks(until: ArrayLike, step: float) -> Any:
    steps = np.ceil(np.asarray(until) / step - 1e-9)
    return np.maximum(steps, 1.0).astype(np.int64) + 1


def _begun(concretes: Sequence[ConcreteScenario], bodies: Sequence[tuple[float, float]]) -> Cast:
    """All vehicles at the start."""
    n, m = len(concretes), len(concretes[0].actors)
    egos, others = np.zeros(n, _EGO), np.zeros((n, m), _OTHER)
    for i, (concrete, body) in enumerate(zip(concretes, bodies, strict=True)):
        ego = concrete.ego
        pose = (ego.x, ego.y, ego.heading, ego.speed, 0.0)
        egos[i] = (*pose, *body, pose, ego.x, ego.y, ego.speed, math.inf)
        for j, actor in enumerate(concrete.actors):
            pose = (actor.start.x, actor.start.y, actor.heading, actor.start.speed, 0.0)
            others[i, j] = (*pose, actor.length, actor.width, pose, 0.0)
    return Cast(egos, others, *players([concrete.actors for concrete in concretes]))


@kernel
def _braking_from(play: Any, acts: Any, delay: float) -> float:
    """Time at which ideal braking begins, s; inf while the obstacle waits."""
    if not math.isinf(play.first_begin):
        return float(play.first_begin + delay)
    for q in range(play.acts):
        if acts[q].state != BEGUN:
            return math.inf
    return delay


@kernel
def _keep_before(body: Any) -> None:
    """Remember the state of a body before a step."""
    was = body.before
    was.x, was.y, was.heading = body.x, body.y, body.heading
    was.speed, was.across = body.speed, body.across


@kernel
def _brake(ego: Any, now: float, deceleration: float) -> None:
    """Move an ego that keeps its speed, and brakes from `brakes_from` on, to a time."""
    t, way = now - ego.brakes_from, ego.start_speed * now
    if t > 0.0 and deceleration > 0.0:
        braked = min(t, ego.start_speed / deceleration)
        ego.speed = ego.start_speed - deceleration * braked
        way = ego.start_speed * ego.brakes_from + 0.5 * braked * (ego.start_speed + ego.speed)
    if ego.heading == 0.0:
        ego.x = ego.start_x + way
    else:  # it began sideways, and holds its wheel straight
        ego.x = ego.start_x + way * math.cos(ego.heading)
        ego.y = ego.start_y + way * math.sin(ego.heading)


@kernel
def _look(case: Any, now: float, before: float, deceleration: float, stack: Any, line: Any) -> None:
    """Move a case from one look to the next."""
    ego, others, plays = case.egos[0], case.others, case.plays
    acts, pieces, table = case.acts, case.pieces, case.table
    _keep_before(ego)
    _brake(ego, now, deceleration)
    for j in range(len(others)):
        other, play = others[j], plays[j]
        _keep_before(other)
        if play.model == AT_ONCE:
            other.x = play.x + play.v * now
        elif play.model == HANDED_OVER:  # it keeps the speed that it had then
            other.x += other.speed * (now - before)
            other.heading, other.across = 0.0, 0.0
        else:
            move(other, play, acts[j], pieces[j], table[j], now, line)
    wake(case, now, before, stack, line)


@kernel
def _write(found: Any, i: int, j: int, k: int, body: Any) -> None:
    """Write the channels of a body at a look."""
    found[i, j, k, 0], found[i, j, k, 1] = body.x, body.y
    found[i, j, k, 2], found[i, j, k, 3] = body.heading, body.speed
    found[i, j, k, 4] = body.across


@rows
def _run_rows(cast: Cast, found: FloatArray, step: float, stack: FloatArray, line: Records) -> None:
    """Fill the tracks of every row: the ego, then the actors."""
    for i in range(len(cast.egos)):
        case = case_of(cast, i)
        ego, others = case.egos[0], case.others
        for k in range(found.shape[2]):
            _look(case, k * step, max(k - 1, 0) * step, 0.0, stack, line)
            _write(found, i, 0, k, ego)
            for j in range(len(others)):
                _write(found, i, 1 + j, k, others[j])


@rows
def _meet_rows(
    cast: Cast, braking: Braking, met: FloatArray, stack: FloatArray, line: Records
) -> None:
    """Results of every row; a row ends once its ego stands, touched the obstacle, or is past it."""
    obstacle, step = braking.obstacle, braking.step
    for i in range(len(cast.egos)):
        case = case_of(cast, i)
        ego, other = case.egos[0], case.others[obstacle]
        met[i, 2] = math.inf
        for k in range(braking.looks[i]):
            now = k * step
            if math.isinf(ego.brakes_from):
                ego.brakes_from = _braking_from(
                    case.plays[obstacle], case.acts[obstacle], braking.delays[i]
                )
            _look(case, now, max(k - 1, 0) * step, braking.deceleration, stack, line)
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
