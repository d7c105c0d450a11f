"""Collision avoidance of an ADS, Eqs. 14-17: severity U, loss L, weight r and the index C.

Users: `scoring/` (U, L and r of every case), `report/`, `extras/`, `method.severity`. Fixed: names
and arguments (docs/reference/python.md); results to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.method import checks, score_terms
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

# not imported at run time: a loss or a severity needs no zones, which import scenarios and readers
if TYPE_CHECKING:
    from sumo_eval.method.zone_partition import ZonePartition

SMALLEST_OVERLAP = 0.5  # w of Eq. 15 lies in [0.5, 1]
LOSS_CLASSES = ((15.0, 1.0), (8.0, 0.7), (0.0, 0.4))  # Eq. 14: (U above this, m/s, has this L)
LEAST_LOSS = 0.1  # Eq. 14: L otherwise
MARCH = 1.0 / 250.0  # most unit-box lengths between the samples of a ray of Eq. 16
AT_ONCE = 32  # samples of each ray that are evaluated together; most rays need few
BISECTIONS = 40  # halvings of the step in which a ray leaves the zone, down to the last digits
SAME_POINT = 1e-12  # unit-box lengths; two points that are nearer count as one
_not_negative = partial(checks.not_negative, "a collision")


def collision_loss(u: ArrayLike) -> FloatArray:
    """Eq. 14: L = 1 if U > 15 m/s, 0.7 if 8 < U <= 15, 0.4 if 0 < U <= 8, 0.1 otherwise.

    u: U, severity of a collision, m/s, any shape, from `impact_severity`.

    Raises InputError for values that are negative or not finite.
    """
    severity = _not_negative("u", u)
    above = [severity > limit for limit, _ in LOSS_CLASSES]
    return np.select(above, [loss for _, loss in LOSS_CLASSES], LEAST_LOSS)[()]


def impact_severity(
    ego_velocity: ArrayLike, obstacle_velocity: ArrayLike, overlap: ArrayLike
) -> FloatArray:
    """Eq. 15: U = |v_ego - v_obstacle| / w at first contact, m/s.

    ego_velocity: v_ego, (..., 2), m/s, of a recorded `Collision`.
    obstacle_velocity: v_obstacle, (..., 2), m/s, in the same frame.
    overlap: w, share of the ego's bumper width that faces the obstacle, (...), 0..1, of the same
        `Collision`.

    The paper has w in [0.5, 1]. A smaller share counts as 0.5, so a graze is at most twice as
    severe as a full hit at the same speed; without this floor its U would have no limit.

    Raises InputError for velocities that are not finite pairs and for an overlap outside 0..1.
    """
    ego = _velocity("ego_velocity", ego_velocity)
    obstacle = _velocity("obstacle_velocity", obstacle_velocity)
    share = _not_negative("overlap", overlap)
    if np.any(share > 1.0):
        raise must_be("`overlap`", "a collision", "within 0..1", float(share[share > 1.0].flat[0]))
    return np.asarray(
        np.linalg.norm(ego - obstacle, axis=-1) / np.maximum(share, SMALLEST_OVERLAP)
    )[()]


def collision_weight(
    point: Mapping[str, float] | ArrayLike, partition: ZonePartition
) -> FloatArray:
    """Eq. 16: r_i = |x_i - x*| / |b - x*| in the unit box, a number or (n,).

    point: x_i, the point of a collision: values by name, or a row (k,) or rows (n, k) in the order
        of the space's parameters and in their units.
    partition: the zones of the space.

    x*: most dangerous point of the zone nearest to x_i. b: the exit, where the ray from x* through
    x_i first leaves the zone, into the safe zone, over a constraint or over the edge of the box. So
    r is 0 at x*, 1 at the exit, and above 1 beyond it, as for every collision in the safe zone.
    Without a hazardous zone r = 1.

    Raises InputError for points outside the box and for missing or unknown names.
    """
    rows = _rows(point, partition)
    zone = partition.nearest_zone(rows)  # refuses points outside the box
    if partition.zones == 0:
        return np.ones(rows.shape[:-1])[()]
    logical = partition.logical
    stars = logical.to_unit([logical.row(values) for values in partition.most_dangerous])
    unit = logical.to_unit(rows).reshape(-1, rows.shape[-1])
    start = stars[np.ravel(zone)]
    away = np.linalg.norm(unit - start, axis=1) > SAME_POINT
    r = np.zeros(len(unit))
    if away.any():
        r[away] = 1.0 / _first_exit(partition, start[away], unit[away] - start[away])
    return r.reshape(rows.shape[:-1])[()]


def collision_avoidance_index(
    u: ArrayLike,
    u_ideal: ArrayLike,
    weights: ArrayLike,
    loss: Literal["severity", "class"] = "severity",
) -> float:
    """Eq. 17: C = sum(r_i Ug_i / U_i) / sum(r_i) over the collisions; 1 if there are none.

    u: U_i of the ADS, (n,), m/s, from `impact_severity`.
    u_ideal: Ug_i of the ideal vehicle in the same concrete scenarios, (n,), m/s, 0 where it avoids
        the collision.
    weights: r_i, (n,), from `collision_weight`.
    loss: "severity" compares U as printed, "class" the loss L of Eq. 14 of both.

    A collision in which the ADS hits no harder than the ideal vehicle counts 1, also one at 0 m/s.
    If all weights are 0, every collision weighs the same. With "class" an ideal vehicle that avoids
    the collision still has L = 0.1 (Eq. 14).

    Raises InputError for arrays of different lengths and for values that are negative or not
    finite.
    """
    if loss not in ("severity", "class"):
        raise must_be("`loss`", "`collision_avoidance_index`", "'severity' or 'class'", loss)
    hit, ideal = _not_negative("u", u), _not_negative("u_ideal", u_ideal)
    r = _not_negative("weights", weights)
    if hit.ndim != 1 or not hit.shape == ideal.shape == r.shape:
        shapes = [array.shape for array in (hit, ideal, r)]
        wanted = "of one length (n,)"
        raise must_be("`u`, `u_ideal` and `weights`", "the collisions", wanted, shapes)
    if hit.size == 0:
        return 1.0
    if loss == "class":
        hit, ideal = collision_loss(hit), collision_loss(ideal)
    ratio = score_terms.ideal_ratio(hit, ideal)
    every = np.ones(hit.shape, bool)  # every case collided, and was evaluated
    once = score_terms.once(hit.size)
    return float(score_terms.collision_avoidance(ratio, r, every, every, once)[0])


def _first_exit(partition: ZonePartition, start: FloatArray, direction: FloatArray) -> FloatArray:
    """Eq. 16: smallest t > 0, (n,), at which the ray start + t direction leaves the zone.

    start: x*, (n, k), in the unit box.
    direction: x_i - x*, (n, k), in the unit box.

    Each ray is marched in equal steps of at most `MARCH`, then the step in which it leaves is
    bisected. A gap in the zone that is narrower than a step can be missed.
    """
    # t_face: where each coordinate meets the box's face ahead of it, (n, k); t_box: where the ray
    # leaves the box, (n,), not before t = 1, which is x_i itself
    ahead = np.where(direction > 0.0, 1.0 - start, start)
    moves = np.abs(direction) > SAME_POINT
    t_face = checks.quotient(ahead, np.abs(direction), moves)  # inf where a coordinate stays
    t_box = np.maximum(t_face.min(axis=1), 1.0)

    def inside(rays: IntArray, t: FloatArray) -> BoolArray:
        """Whether each of these rays is in the zone at its t, (m,)."""
        unit = np.clip(start[rays] + t[:, None] * direction[rays], 0.0, 1.0)
        points = partition.logical.from_unit(unit)
        return partition.hazardous(points) & partition.exists(points)

    # the same number of steps for each ray: r must not depend on the other points
    low, high = _march(inside, t_box, math.ceil(math.sqrt(start.shape[1]) / MARCH))
    rays = np.arange(len(start))
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        stays = inside(rays, middle)
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
    return high


def _march(
    inside: Callable[[IntArray, FloatArray], BoolArray], t_box: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray]:
    """The step in which each of n rays leaves its zone: the last t inside, the first t outside,
    (n,) each.

    inside: function of rays (m,) and a t of each, (m,): whether the ray is in its zone there.
    t_box: t at which each ray leaves the box, (n,).
    steps: of equal length, from t = 0 to `t_box`.
    """
    low: FloatArray = np.zeros(len(t_box))
    high: FloatArray = t_box.copy()
    marching = np.arange(len(t_box))  # rays that have not left their zone so far
    for first in range(1, steps + 1, AT_ONCE):
        shares = np.arange(first, min(first + AT_ONCE, steps + 1)) / steps
        # t of each marching ray: the last one inside so far, then those of these samples
        t = np.column_stack([low[marching], t_box[marching, None] * shares])
        samples = np.repeat(marching, len(shares)), t[:, 1:].ravel()
        stays = inside(*samples).reshape(-1, len(shares))
        # number of samples before the first one outside
        count = np.cumprod(stays, axis=1).sum(axis=1)
        rows = np.arange(len(t))
        leaves = count < len(shares)
        low[marching] = t[rows, count]
        high[marching[leaves]] = t[rows[leaves], count[leaves] + 1]
        marching = marching[~leaves]
        if marching.size == 0:
            break
    return low, high


def _rows(point: Mapping[str, float] | ArrayLike, partition: ZonePartition) -> FloatArray:
    """The `point` of `collision_weight` as a row (k,) or rows (n, k), in the parameters' units.

    Raises InputError for a single number, and for missing or unknown names.
    """
    logical = partition.logical
    if not isinstance(point, Mapping):
        array = np.asarray(point, float)
        if array.ndim == 0:
            raise must_be(
                "`point`", f"scenario `{logical.name}`", "values by name, a row or rows", point
            )
        return array
    check_known(f"parameter of scenario `{logical.name}`", logical.names, *point)
    for name in logical.names:
        if name not in point:
            raise InputError(f"Parameter `{name}` of scenario `{logical.name}` is missing.")
    return logical.row(point)


def _velocity(name: str, values: ArrayLike) -> FloatArray:
    """Velocities as an array (..., 2), m/s. Raises InputError for other shapes and for values that
    are not finite.
    """
    array = np.asarray(values, float)
    if array.ndim == 0 or array.shape[-1] != 2 or not np.all(np.isfinite(array)):
        raise must_be(f"`{name}`", "a collision", "finite with a last axis of 2 (vx, vy)", array)
    return array
