"""Criticality of points of a parameter space under ideal braking, Eqs. 5-7: max ITTC, impact speed,
and the target y from which the zones are learnt.

A scenario (`LogicalScenario`) says how its criticality is found:

- `approach`: the ego approaches an obstacle in one lane: in closed form (`criticality.py`), or
  searched over time where the obstacle brakes or comes in later.
- `search`: an actor moves in two dimensions, reacts, or drives where lanes begin, end or cross:
  searched over time (`conflict.py`).
- `margin`: the scenario's own function of the parameters, m; hazardous at 0 and below.
- none of these: every point is safe.

One obstacle decides; other actors have no effect on the zone.

Users: `method/`, `record/`, `scoring/`, `report/explain.py`, `cli/`, `extras/`. Fixed: results to
the last bit, because they decide the zone of every case.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.method.checks import quotient
from sumo_eval.method.conflict import encounter
from sumo_eval.method.criticality import (
    Profile,
    ideal_impact_speed,
    max_inverse_ttc,
    searched_criticality,
)
from sumo_eval.scenario import Approach, LogicalScenario
from sumo_eval.scenario.concrete import braked_distance, braked_speed
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import BoolArray, FloatArray

DEFAULT_SETTINGS = ZoneSettings()
# m, about two cars. y = tanh(p / `PASSING_SCALE`) where y follows from a length p: the free road
# behind an ego that has passed, or a margin.
PASSING_SCALE = 10.0
# points whose criticality is searched over time in one go; their arrays, 1.3 MB each, stay in the
# processor's cache
SEARCHED_AT_ONCE = 1_000


class Criticality(NamedTuple):
    """Criticality of n points under the zones' ideal braking, which begins after the scenario's
    delay, (n,) each.

    inverse: max ITTC, Eq. 6, 1/s; inf where the ego hits.
    impact: impact speed, m/s; 0 where the ego does not hit.
    gap: m; orders points of equal ITTC and impact speed. With an `approach` the gap at the start,
        or, if the actor comes into the ego's path later, the absolute value of the gap at that
        time. With a `search` the smallest gap. With a `margin` the margin.
    target: y, Eq. 7, hazardous where <= 0.
    """

    inverse: FloatArray
    impact: FloatArray
    gap: FloatArray
    target: FloatArray


def criticality(
    logical: LogicalScenario, points: FloatArray, settings: ZoneSettings
) -> Criticality:
    """Eqs. 5-7: max ITTC, impact speed and target y of points, without any learnt surface.

    logical: the scenario.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`: a, ITTC*, scale.

    An actor that comes into the ego's path later finds the ego past it or not. If the ego has
    passed, the point is safe, with y = tanh(p / 10 m), p the free road between them. If it has not,
    p is 0 or negative, and y is the larger of tanh(p / 10 m) and the squared-time target. Without p
    the target would jump from the hardest hit to perfectly safe, and no smooth surface follows a
    jump.
    """
    if logical.margin is not None:
        margin = np.asarray(logical.values(logical.margin, points))
        lacks = margin <= 0.0
        y = np.tanh(margin / PASSING_SCALE)
        # a margin has no impact speed: how far it is below 0, m, replaces the speed
        return Criticality(np.where(lacks, np.inf, 0.0), np.where(lacks, -margin, 0.0), margin, y)
    approach = None if logical.approach is None else logical.values(logical.approach, points)
    if logical.search is not None:
        inverse, impact, gap = encounter(logical, points, settings)
    else:
        inverse, impact, gap = _approached(approach, len(points), settings)
    y = squared_time_target(inverse, impact, settings)
    if approach is not None and math.isfinite(approach.passing_length):
        free = -_gap_at_conflict(approach, settings) - approach.passing_length  # p
        y_passed = np.tanh(free / PASSING_SCALE)
        y = np.where(free > 0.0, y_passed, np.maximum(y, y_passed))
    return Criticality(inverse, impact, gap, y)


def _approached(approach: Approach | None, n: int, settings: ZoneSettings) -> FloatArray:
    """Eqs. 5-6: max ITTC, impact speed and gap of n points, as in `Criticality`, (3, n).

    approach: values of the points, numbers or (n,); None: the ego approaches nothing.
    """
    if approach is None:
        return _columns(n, 0.0, 0.0, np.inf)
    scene = approach.ego_speed, approach.obstacle_speed, approach.gap
    braking = {"deceleration": settings.deceleration, "delay": approach.delay}
    inverse = max_inverse_ttc(*scene, **braking)
    exact = _columns(n, inverse, ideal_impact_speed(*scene, **braking), approach.gap)
    if approach.has_closed_form.all():
        return exact
    # The absolute value: of two equally hard hits, the hit with the smaller overlap along the road
    # counts as worse, not the hit with the most negative gap, where the ego has nearly passed.
    gap = np.abs(_gap_at_conflict(approach, settings))
    searched = _columns(n, *_searched(approach, n, settings), gap)
    return np.where(approach.has_closed_form, exact, searched)


def squared_time_target(
    inverse_ttc: ArrayLike, impact_speed: ArrayLike, settings: ZoneSettings = DEFAULT_SETTINGS
) -> FloatArray:
    """Eq. 7: target of the GP, y = tanh((T^2 - T*^2) / scale), T = 1 / max ITTC, T* = 1 / ITTC*.

    inverse_ttc: max ITTC, (n,), 1/s, from Eq. 6; inf where the ego hits.
    impact_speed: u, (n,), m/s, of the same braking.
    settings: `[method.zones]`: a, ITTC*, scale (s2).

    Where the ego hits, T^2 := -(u/a)^2. This continues T^2 smoothly through contact: during braking
    both are 2c/a, where c is the gap left at equal speeds, negative after a hit. An ego that is not
    closing has T = inf and y = 1.
    """
    inverse, u = np.broadcast_arrays(
        np.asarray(inverse_ttc, float), np.asarray(impact_speed, float)
    )
    squared = quotient(1.0, inverse**2, inverse > 0.0)
    squared = np.where(np.isinf(inverse), -((u / settings.deceleration) ** 2), squared)
    return np.tanh((squared - settings.critical_inverse_ttc**-2) / settings.target_scale)


def _gap_at_conflict(approach: Approach, settings: ZoneSettings) -> FloatArray:
    """Gap at the time at which the obstacle comes into the ego's path, m; negative: the ego's front
    is past the obstacle's rear.
    """
    begin = approach.conflict_begin
    _, distance = _lead(
        np.asarray(approach.obstacle_speed), np.asarray(approach.obstacle_deceleration)
    )
    waits = np.minimum(begin, approach.delay)  # time before braking, s
    ego = approach.ego_speed * waits + braked_distance(
        approach.ego_speed, settings.deceleration, begin - waits
    )
    return approach.gap + distance(np.asarray(begin)) - ego


def _searched(approach: Approach, n: int, settings: ZoneSettings) -> tuple[FloatArray, FloatArray]:
    """Max ITTC, 1/s, and impact speed, m/s, of n points by search over time, (n,) each."""
    inverse, impact = np.empty(n), np.empty(n)
    egos = _columns(n, approach.ego_speed, approach.gap, approach.delay)
    obstacles = _columns(
        n, approach.obstacle_speed, approach.obstacle_deceleration, approach.conflict_begin
    )
    for first in range(0, n, SEARCHED_AT_ONCE):
        rows = slice(first, first + SEARCHED_AT_ONCE)
        ego_speed, gap, delay = egos[:, rows]
        speed, slowing, begin = obstacles[:, rows]
        inverse[rows], impact[rows] = searched_criticality(
            ego_speed,
            gap,
            _lead(speed[:, None], slowing[:, None]),
            deceleration=settings.deceleration,
            delay=delay,
            conflict_begin=begin,
            passing_length=approach.passing_length,
        )
    return inverse, impact


def _columns(n: int, *values: ArrayLike) -> FloatArray:
    """Values of n points, each of them a number or (n,), as (k, n)."""
    return np.array([np.broadcast_to(np.asarray(value, float), n) for value in values])


def _lead(speed: FloatArray, slowing: FloatArray) -> tuple[Profile, Profile]:
    """Two functions of times (n, m), s, for n obstacles: speed, m/s, and driven distance, m.

    speed: at the start, m/s, (n, 1), or of the shape of the times.
    slowing: deceleration from the start on, m/s2, as `speed`; 0: it keeps its speed.
    """
    brakes = slowing > 0.0
    if not brakes.any():  # the results below, in a third of the time
        return lambda _: speed, lambda time: speed * time
    strength = np.where(brakes, slowing, 1.0)
    return (
        lambda time: np.where(brakes, braked_speed(speed, strength, time), speed),
        lambda time: np.where(brakes, braked_distance(speed, strength, time), speed * time),
    )


def exact_target(
    logical: LogicalScenario, points: FloatArray, settings: ZoneSettings
) -> FloatArray:
    """Eq. 7: the target y of points, which the GP approximates, (n,); hazardous where <= 0.

    logical: the scenario.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`.
    """
    return criticality(logical, points, settings).target


def danger(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    """Eq. 7 as a danger from 0 to 1: (1 - y) / 2 of the target y, (n,).

    logical: the scenario.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`.

    It is 0.5 on the zone boundary, 1 where ideal braking hits hard, 0 where nothing comes near.
    """
    return (1.0 - exact_target(logical, points, settings)) / 2.0


def exactly_hazardous(
    logical: LogicalScenario, points: FloatArray, settings: ZoneSettings
) -> BoolArray:
    """Eqs. 5-6: whether max ITTC reaches its threshold ITTC*, (n,); no learnt surface is involved.

    logical: the scenario.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`.
    """
    return criticality(logical, points, settings).inverse >= settings.critical_inverse_ttc


def is_searched(logical: LogicalScenario) -> bool:
    """Whether the criticality of a scenario is searched over time, and not in closed form."""
    if logical.approach is None:
        return logical.search is not None
    # the middle of the space stands for all points
    middle = np.array(
        [[0.5 * (parameter.low + parameter.high) for parameter in logical.parameters]]
    )
    return not logical.values(logical.approach, middle).has_closed_form.all()
