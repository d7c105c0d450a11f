"""What the others do while the ego keeps its speed, or brakes ideally along its path: no simulation, the scripts alone.

Whoever reacts is taken to keep its speed here: what SUMO's models would do is known only once SUMO has driven them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.kernels import rows
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.played import (
    BEGUN,
    DEEPEST,
    Records,
    begin_due,
    place,
    players,
    wake,
)
from sumo_eval.trajectory import FloatArray

_STATE = [(name, "f8") for name in ("x", "y", "heading", "speed", "across")]
_EGO = np.dtype(
    [*_STATE, ("length", "f8"), ("width", "f8"), ("before", _STATE), ("start_x", "f8"), ("start_speed", "f8")]
)
_OTHER = np.dtype([*_STATE, ("length", "f8"), ("width", "f8"), ("before", _STATE), ("acceleration", "f8")])
CHANNELS = ("x", "y", "heading", "speed", "across")


class Tracks(NamedTuple):
    """Where everybody is at times k * step: (n, T, 5) of the egos, (n, m, T, 5) of the others; channels `CHANNELS`.

    begins: when each of the others made its first move, s, inf where it made none, (n, m).
    """

    egos: FloatArray
    others: FloatArray
    begins: FloatArray


def tracks(
    concretes: Sequence[ConcreteScenario],
    bodies: Sequence[tuple[float, float]],
    step: float,
    until: float,
    braking: tuple[float, int, Sequence[float]] | None = None,
) -> Tracks:
    """Tracks of cases with as many others each.

    bodies: length and width of each ego, m. braking: deceleration m/s2, number of the other at whose first move, plus a
    delay (s, one a case), the ego begins to brake to a standstill; from the start on where that one waits for nothing.
    """
    n, m, count = len(concretes), len(concretes[0].actors), max(math.ceil(until / step - 1e-9), 1) + 1
    egos, others = np.zeros(n, _EGO), np.zeros((n, m), _OTHER)
    for i, (concrete, (length, width)) in enumerate(zip(concretes, bodies, strict=True)):
        ego = concrete.ego
        pose = (ego.x, ego.y, 0.0, ego.speed, 0.0)
        egos[i] = (*pose, length, width, pose, ego.x, ego.speed)
        for j, actor in enumerate(concrete.actors):
            pose = (actor.start.x, actor.start.y, actor.heading, actor.start.speed, 0.0)
            others[i, j] = (*pose, actor.length, actor.width, pose, 0.0)
    found = players([concrete.actors for concrete in concretes])
    deceleration, obstacle, delays = braking or (0.0, -1, [0.0] * n)
    way, theirs = np.zeros((n, count, 5)), np.zeros((n, m, count, 5))
    _run_rows(
        egos, others, *found, way, theirs, step, deceleration, obstacle, np.array(delays, dtype=np.float64),
        np.zeros((DEEPEST, 3)),
    )  # fmt: skip
    return Tracks(way, theirs, found.plays["first_begin"].copy())


@rows
def _run_rows(
    egos: Records, others: Records, plays: Records, acts: Records, pieces: Records, table: Records, program: Records,
    way: FloatArray, theirs: FloatArray, step: float, deceleration: float, obstacle: int, delays: FloatArray,
    stack: FloatArray,
) -> None:  # fmt: skip
    """Fill the tracks of every row."""
    for i in range(len(egos)):
        ego = egos[i]
        brakes_from = math.inf
        for k in range(way.shape[1]):
            now, before = k * step, max(k - 1, 0) * step
            was = ego.before
            was.x, was.y, was.heading, was.speed = ego.x, ego.y, ego.heading, ego.speed
            if obstacle >= 0 and math.isinf(brakes_from):
                play = plays[i][obstacle]
                waits = 0
                for q in range(play.acts):
                    if acts[i][obstacle][q].state != BEGUN:
                        waits = 1
                if waits == 0 or not math.isinf(play.first_begin):
                    first = play.first_begin if not math.isinf(play.first_begin) else 0.0
                    brakes_from = first + delays[i]
            t = now - brakes_from
            if t > 0.0 and deceleration > 0.0:
                braked = min(t, ego.start_speed / deceleration)
                ego.speed = ego.start_speed - deceleration * braked
                ego.x = ego.start_x + ego.start_speed * brakes_from + 0.5 * braked * (ego.start_speed + ego.speed)
            else:
                ego.x = ego.start_x + ego.start_speed * now
            for j in range(len(others[i])):
                other, play = others[i][j], plays[i][j]
                last = other.before
                last.x, last.y, last.heading = other.x, other.y, other.heading
                last.speed, last.across = other.speed, other.across
                if play.model:
                    other.x = play.x + play.v * now
                    continue
                begin_due(play, acts[i][j], pieces[i][j], table[i][j], now)
                place(other, play, acts[i][j], pieces[i][j], table[i][j], now)
            wake(ego, others[i], plays[i], acts[i], pieces[i], table[i], program[i], now, before, stack)
            way[i, k, 0], way[i, k, 1], way[i, k, 2], way[i, k, 3] = ego.x, ego.y, ego.heading, ego.speed
            for j in range(len(others[i])):
                other = others[i][j]
                theirs[i, j, k, 0], theirs[i, j, k, 1], theirs[i, j, k, 2] = other.x, other.y, other.heading
                theirs[i, j, k, 3], theirs[i, j, k, 4] = other.speed, other.across
