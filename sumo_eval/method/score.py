"""The combined score S, Eq. 18, of one ADS, and the scales k5, k6 by a population of ADSs.

The scores of a run come from `score_terms.paper_score`, over arrays. This file has the equation for
users with single numbers.

Users: `extras/studies/calibration.py`, `extras/studies/qualification/table.py`. Fixed: name and
arguments of `combined_score`, which users call.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from sumo_eval.errors import must_be

ROUNDING = 1e-9  # how far beyond 0..1 rounding may put an index


class Score(NamedTuple):
    """S and its parts.

    total: S, points; None if neither index was computed.
    c, d: the indexes C and D, 0..1; None if not computed.
    c_points, d_points: points that each adds to S; 0 if it was not computed.
    """

    total: float | None
    c: float | None
    d: float | None
    c_points: float
    d_points: float


def combined_score(
    c: float | None,
    d: float | None,
    *,
    a: float = 50.0,
    b: float = 50.0,
    k5: float = 1.0,
    k6: float = 1.0,
) -> Score:
    """Eq. 18: S = a k5 C + b k6 D.

    c: C, 0..1, from `collision_avoidance_index`; None: no case could be evaluated.
    d: D, 0..1, from `exposure_weighted_index`; None: after a collision in the safe zone there is no
        D.
    a, b: points for C = 1 and for D = 1, at least 0, together 100.
    k5, k6: scales, above 0: 1, or from `population_scale`. With a scale above 1 S can exceed 100.

    The term of an index that was not computed counts 0.

    Raises InputError for values outside these ranges.
    """
    for index, value in (("c", c), ("d", d)):
        if value is not None:
            _check_index(index, value)
    if not (a >= 0.0 and b >= 0.0 and math.isclose(a + b, 100.0, abs_tol=1e-9)):
        raise must_be("`a` and `b`", "the score", "at least 0 and together 100", (a, b))
    for name, scale in (("k5", k5), ("k6", k6)):
        if not (math.isfinite(scale) and scale > 0.0):
            raise must_be(f"`{name}`", "the score", "greater than 0", scale)
    c_points = 0.0 if c is None else a * k5 * c
    d_points = 0.0 if d is None else b * k6 * d
    total = None if c is None and d is None else c_points + d_points
    return Score(total, c, d, c_points, d_points)


def population_scale(
    values: Sequence[float], share: float = 0.5, *, centre: Literal["median", "mean"] = "median"
) -> float:
    """Eq. 18: k5 = share / median(C) for a population of ADSs, so that the median ADS gets
    share * a points for C. With D instead of C: k6.

    values: C of every ADS, or D of every ADS that has one, 0..1.
    share: of the points a (b), within (0, 1]; 0.5 in the paper.
    centre: whether the median or the mean of the values stands for the population.

    Raises InputError for arguments out of range, for an empty list, and if the centre is 0, because
    no scale can lift it.
    """
    if len(values) == 0:
        raise must_be("`values`", "`population_scale`", "at least one index", values)
    for value in values:
        _check_index("values", value)
    if not 0.0 < share <= 1.0:
        raise must_be("`share`", "`population_scale`", "within 0..1 and above 0", share)
    if centre not in ("median", "mean"):
        raise must_be("`centre`", "`population_scale`", "'median' or 'mean'", centre)
    typical = middle(values, centre)
    if typical == 0.0:
        raise must_be(f"The {centre}", "the population's indexes", "greater than 0", typical)
    return share / typical


def middle(values: Sequence[float], centre: Literal["median", "mean"]) -> float:
    """The median or the mean of a population's indexes."""
    return float(np.median(values) if centre == "median" else np.mean(values))


def _check_index(name: str, value: float) -> None:
    """Raise InputError unless an index is within 0..1."""
    if not -ROUNDING <= value <= 1.0 + ROUNDING:
        raise must_be(f"`{name}`", "the score", "within 0..1", value)
