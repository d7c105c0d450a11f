"""Criticality of points of a parameter space under ideal braking, Eqs. 5-7.

Each point is solved in closed form where its scenario has one, and searched over time elsewhere.
Users: `method/`, which learns the zones from it, `record/`, `scoring/`, `report/explain.py`,
`cli/`, `extras/`.
"""

import math
from collections.abc import Iterator
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
# m, about two cars: with this much free road behind it an ego that has passed has y = tanh(1)
PASSING_SCALE = 10.0
# points whose criticality is searched over time in one go; their arrays, 1.3 MB each, stay in the
# processor's cache
SEARCHED_AT_ONCE = 1_000


class Criticality(NamedTuple):
    """Outcome of points under the zones' ideal braking after the scenario's delay, (n,) each.

    inverse: Eq. 6, max ITTC, 1/s, inf where it hits.
    impact: speed, m/s.
    gap: m; where the actor comes into the ego's way later, the one left when it does, of either
        sign.
    target: y on the scale that the GP learns, hazardous where <= 0.
    """

    inverse: FloatArray
    impact: FloatArray
    gap: FloatArray
    target: FloatArray


def criticality(
    logical: LogicalScenario, points: FloatArray, settings: ZoneSettings
) -> Criticality:
    """Eqs. 5-7: criticality of points itself, in closed form or searched.

    Without an approach, a search or a margin all points are safe.

    logical: the scenario.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`.

    Where the actor comes into the ego's way later, an ego that has passed by then is safe: y =
    tanh(p / 10 m), p the free road between them. If it has not passed (p <= 0), y is the larger of
    this and the squared-time target. Without p the target would jump from the hardest hit to
    perfectly safe, and no smooth surface follows a jump.
    """
    n = len(points)
    if logical.margin is not None:
        # A scenario with a margin, m, has no impact speed: how far the margin is below 0, in m,
        # stands for it.
        margin = np.asarray(logical.margin(logical.columns(points)))
        lacks = margin <= 0.0
        y = np.tanh(margin / PASSING_SCALE)
        return Criticality(np.where(lacks, np.inf, 0.0), np.where(lacks, -margin, 0.0), margin, y)
    approach = None if logical.approach is None else logical.approach(logical.columns(points))
    if logical.search is not None:
        inverse, impact, gap = encounter(logical, points, settings)
    elif approach is None:
        inverse = np.zeros(n)
        impact = np.zeros(n)
        gap = np.full(n, np.inf)
    elif not approach.has_closed_form:
        inverse, impact = _searched(approach, n, settings)
        # Of two equally hard hits the hit at the closer meeting counts, and not the hit that the
        # ego has nearly passed.
        gap = np.broadcast_to(np.abs(_gap_at_conflict(approach, settings)), n)
    else:
        scene = approach.ego_speed, approach.obstacle_speed, approach.gap
        braking = {"deceleration": settings.deceleration, "delay": approach.delay}
        inverse, impact, gap = _broadcast(
            n,
            max_inverse_ttc(*scene, **braking),
            ideal_impact_speed(*scene, **braking),
            approach.gap,
        )
    y = squared_time_target(inverse, impact, settings)
    if approach is not None and math.isfinite(approach.passing_length):
        free = -_gap_at_conflict(approach, settings) - approach.passing_length  # p
        y_passed = np.tanh(free / PASSING_SCALE)
        y = np.where(free > 0.0, y_passed, np.maximum(y, y_passed))
    return Criticality(inverse, impact, gap, y)


def squared_time_target(
    inverse_ttc: ArrayLike, impact_speed: ArrayLike, settings: ZoneSettings = DEFAULT_SETTINGS
) -> FloatArray:
    """Eq. 7: target of the GP, y = tanh((T^2 - T*^2) / scale), T = 1 / max ITTC, T* = 1 / ITTC*.

    inverse_ttc: max ITTC, (n,), 1/s.
    impact_speed: u, (n,), m/s, under the zones' braking a.
    settings: `[method.zones]`: a, ITTC*, scale.

    Where it hits, T^2 := -(u/a)^2, which continues T^2 smoothly through contact: both are 2c/a with
    the gap c that is left over. An ego that is not closing has T = inf and y = 1.
    """
    inverse, u = np.broadcast_arrays(
        np.asarray(inverse_ttc, float), np.asarray(impact_speed, float)
    )
    squared = quotient(1.0, inverse**2, inverse > 0.0)
    squared = np.where(np.isinf(inverse), -((u / settings.deceleration) ** 2), squared)
    return np.tanh((squared - settings.critical_inverse_ttc**-2) / settings.target_scale)


def _gap_at_conflict(approach: Approach, settings: ZoneSettings) -> FloatArray:
    """The gap when the obstacle comes into the ego's way, m; negative: the ego's front is past the
    obstacle's rear.
    """
    begin = approach.conflict_begin
    _, distance = _lead(
        np.asarray(approach.obstacle_speed), np.asarray(approach.obstacle_deceleration)
    )
    waits = np.minimum(begin, approach.delay)
    ego = approach.ego_speed * waits + braked_distance(
        approach.ego_speed, settings.deceleration, begin - waits
    )
    return approach.gap + distance(np.asarray(begin)) - ego


def _searched(approach: Approach, n: int, settings: ZoneSettings) -> tuple[FloatArray, FloatArray]:
    """Max ITTC, 1/s, and impact speed, m/s, of `n` points without a closed form, (n,) each."""
    inverse, impact = np.empty(n), np.empty(n)
    arrays = list(
        _broadcast(
            n, approach.ego_speed, approach.gap, approach.delay,
            approach.obstacle_speed, approach.obstacle_deceleration, approach.conflict_begin,
        )
    )  # fmt: skip
    for first in range(0, n, SEARCHED_AT_ONCE):
        rows = slice(first, first + SEARCHED_AT_ONCE)
        ego_speed, gap, delay = (array[rows] for array in arrays[:3])
        speed, slowing, begin = (array[rows] for array in arrays[3:])
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


def _broadcast(n: int, *values: ArrayLike) -> Iterator[FloatArray]:
    """Each of the values as (n,) numbers."""
    return (np.broadcast_to(np.asarray(value, float), n) for value in values)


def _lead(speed: FloatArray, slowing: FloatArray) -> tuple[Profile, Profile]:
    """Functions from times to the speed and the driven distance of n leads.

    speed: at the start, (n, 1), m/s.
    slowing: their deceleration from the start on, (n, 1), m/s2; 0: they keep their speed.
    """
    brakes = slowing > 0.0
    if not brakes.any():  # the same, in a third of the time
        return lambda _: speed, lambda time: speed * time
    strength = np.where(brakes, slowing, 1.0)
    return (
        lambda time: np.where(brakes, braked_speed(speed, strength, time), speed),
        lambda time: np.where(brakes, braked_distance(speed, strength, time), speed * time),
    )


def exact_target(
    logical: LogicalScenario, points: FloatArray, settings: ZoneSettings
) -> FloatArray:
    """Eqs. 5-7: criticality y of points itself, on the scale that the GP learns: hazardous where
    <= 0, (n,).

    logical, points, settings: as in `criticality`.
    """
    return criticality(logical, points, settings).target


def danger(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    """Eqs. 5-7: (1 - y) / 2 of the criticality y that the zones are learnt from, (n,).

    logical: the scenario.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`.

    0.5 on the zone boundary, 1 where ideal braking hits hard, 0 where nothing comes near.
    """
    return (1.0 - exact_target(logical, points, settings)) / 2.0


def exactly_hazardous(
    logical: LogicalScenario, points: FloatArray, settings: ZoneSettings
) -> BoolArray:
    """Eqs. 5-6: whether max ITTC itself, without any partition, reaches its threshold, (n,).

    logical, points, settings: as in `criticality`.
    """
    return criticality(logical, points, settings).inverse >= settings.critical_inverse_ttc


def asks_some(logical: LogicalScenario) -> bool:
    """Whether criticality in a scenario is searched over time, and not in closed form."""
    if logical.approach is None:
        return logical.search is not None
    middle = np.array(
        [[0.5 * (parameter.low + parameter.high) for parameter in logical.parameters]]
    )
    return not logical.approach(logical.columns(middle)).has_closed_form
