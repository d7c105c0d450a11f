"""The arithmetic of every score, over one sample of cases or over many: Eqs. 13, 17 and 18, and T,
A', H and S+, which order ADSs.

A score's function takes arrays (n,) with a quantity of each case, nan if the case has no part in
it, and `counts`, (m, n): how often each case occurs in each of m samples. A row of ones is the
evaluation itself; a bootstrap draws further rows. The function returns the score of each sample,
(m,), nan if the sample holds nothing to compute it from. So a score, its interval and a difference
of two scores come from one function and from its arguments alone.

Users: `scoring/`, `report/`, `extras/`, `method/anthropomorphic.py`,
`method/collision_avoidance.py`. Fixed: names and arguments (docs/reference/python.md); number and
order of the sums that a function asks `counts` for must not depend on the data (`AskedTerms`).
"""

import itertools
import math
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.method.checks import quotient
from sumo_eval.settings import ScoreSettings
from sumo_eval.trajectory import BoolArray, FloatArray


class Counts(Protocol):
    """Number of times that each of n cases occurs in each of m samples, (m, n). An array, or an
    object with the same operator `@`: `AskedTerms`, `KnownSums`.
    """

    def __matmul__(self, terms: FloatArray, /) -> FloatArray:
        """Sums of terms (n,) over every sample, (m,)."""


def once(n: int) -> FloatArray:
    """The counts, (1, n), of the evaluation itself: each of n cases stands in it once."""
    return np.ones((1, n))


class AskedTerms:
    """Counts that record the terms which a score sums, in order. Each sum that they return is 0.

    A score reads cases only through sums, and asks for the same sums whatever the data. So a long
    table of cases is scored in parts:

    1. For the cases of each part the score is called with `AskedTerms`. The caller sums the
       recorded terms over every sample, and adds these sums to those of earlier parts.
    2. In the end the score is called once with `KnownSums` of the totals.

    The memory in use does not grow with the number of cases.
    """

    def __init__(self) -> None:
        self.terms: list[FloatArray] = []

    def __matmul__(self, terms: FloatArray, /) -> FloatArray:
        self.terms.append(terms)
        return np.zeros(1)


class KnownSums:
    """Counts that return sums computed before, in the order of `AskedTerms`.

    sums: of k terms in m samples, (k, m).
    """

    def __init__(self, sums: FloatArray) -> None:
        self._sums = iter(sums)

    def __matmul__(self, terms: FloatArray, /) -> FloatArray:
        return next(self._sums)


def weighted_mean(values: ArrayLike, weights: ArrayLike, counts: Counts) -> FloatArray:
    """sum(w_i v_i) / sum(w_i) in every sample, (m,); nan where the weights add up to 0.

    values: v_i, (n,), in any unit.
    weights: w_i, (n,), at least 0. A case whose value or weight is nan has no part.
    counts: (m, n).
    """
    counted = np.isfinite(values) & np.isfinite(weights)
    weight = np.where(counted, weights, 0.0)
    total = counts @ weight
    terms = counts @ (weight * np.where(counted, values, 0.0))
    return quotient(terms, total, total > 0.0, np.nan)


def ideal_ratio(severity: ArrayLike, ideal: ArrayLike) -> FloatArray:
    """Eq. 17: Ug_i / U_i of each collision, 1 where the ADS hit no harder than the ideal vehicle;
    nan where U_i or Ug_i is nan.

    severity: U_i of the ADS (Eq. 15), m/s, or its loss L (Eq. 14), of any shape.
    ideal: Ug_i of the ideal vehicle, m/s, or its loss, of the same shape.
    """
    # the result where the division is not made
    otherwise = np.where(np.isnan(severity) | np.isnan(ideal), np.nan, 1.0)
    return np.divide(ideal, severity, out=otherwise, where=np.greater(severity, ideal))


def collision_avoidance(
    ratio: ArrayLike, weight: ArrayLike, collided: ArrayLike, evaluated: ArrayLike, counts: Counts
) -> FloatArray:
    """Eq. 17: C = sum(r_i Ug_i / U_i) / sum(r_i) over the collisions of every sample, (m,).

    ratio: Ug_i / U_i (`ideal_ratio`), (n,), nan without a collision and where Ug_i is not known.
    weight: r_i (Eq. 16), (n,), nan likewise.
    collided: whether the ADS collided, (n,).
    evaluated: whether the case could be evaluated, (n,).
    counts: (m, n).

    - All collisions of a sample have r = 0: C is their plain mean.
    - A sample has no collision: C is 1 if one of its cases was evaluated, else nan.
    - A sample has collisions, but none with a ratio: C is nan.
    """
    compared = np.where(np.isfinite(weight), ratio, np.nan)
    plain = weighted_mean(compared, np.ones(compared.shape), counts)
    c = weighted_mean(compared, np.nan_to_num(weight), counts)
    c = np.where(np.isnan(c), plain, c)
    no_collision = ~_contains(collided, counts) & _contains(evaluated, counts)
    return np.where(np.isnan(c) & no_collision, 1.0, c)


exposure_mean = weighted_mean
"""Eq. 13: D = sum(p_i D_i) / sum(p_i) in every sample, (m,); H and T likewise.

values: D_i, (n,), nan for a case without one.
weights: exposure p_i, (n,), at least 0.
counts: (m, n).

nan where no case with exposure has a value.
"""


class Worth(NamedTuple):
    """Points of S for C = 1 and for D = 1 (Eq. 18): a k5 and b k6."""

    c: float
    d: float


def worth(points: ScoreSettings) -> Worth:
    """Eq. 18: a k5, the points for C = 1, and b k6, the points for D = 1.

    points: `[method.score]`: a, b, in points, k5 and k6.
    """
    return Worth(points.a * points.k5, points.b * points.k6)


def paper_score(c: ArrayLike, d: ArrayLike, points: ScoreSettings) -> FloatArray:
    """Eq. 18: S = a k5 C + b k6 D, points, (m,).

    c: C, (m,), 0..1, from `collision_avoidance`.
    d: D, (m,), 0..1, from `exposure_mean`.
    points: `[method.score]`: a, b, in points, k5 and k6.

    A term that is nan counts 0. S is nan where both terms are nan.
    """
    terms = np.asarray([c, d], float)
    full = worth(points)
    total = full.c * np.nan_to_num(terms[0]) + full.d * np.nan_to_num(terms[1])
    return np.where(np.isnan(terms).all(axis=0), np.nan, total)


def ordering_score(
    task: ArrayLike, grade: ArrayLike, human_likeness: ArrayLike, points: ScoreSettings
) -> FloatArray:
    """S+ = T max(A', 0) (a + b H), points, (m,).

    task: T, (m,), 0..1, from `exposure_mean`.
    grade: A', (m,), at most 1, from `avoidance_grade`.
    human_likeness: H, (m,), 0..1, from `exposure_mean`.
    points: `[method.score]`: a for driving the task without harm, b for doing it as human drivers
        do, together 100 points.

    An H that is nan counts 0. S+ is nan where T or A' is nan.
    """
    done = task * np.maximum(grade, 0.0)
    return np.asarray(done * (points.a + points.b * np.nan_to_num(human_likeness)))


def mean_shares(weights: ArrayLike) -> FloatArray:
    """Eqs. 13 and 17: w_i / sum(w_i), the weight of each case in a mean, (n,); 1/n each where all
    weights are 0.

    weights: w_i, (n,), at least 0.
    """
    weight = np.asarray(weights, float)
    if not weight.any():
        weight = np.ones(weight.shape)
    return np.asarray(weight / weight.sum())


def excess(severity: ArrayLike, ideal: ArrayLike) -> FloatArray:
    """max(0, U_i - Ug_i), m/s, (n,): how much harder the ADS hit than the ideal vehicle; nan where
    U_i or Ug_i is nan.

    severity: U_i, (n,), m/s, 0 without an incident.
    ideal: Ug_i, (n,), m/s, 0 where the ideal vehicle avoids the contact.
    """
    # np.maximum keeps nan
    return np.maximum(np.subtract(severity, ideal), 0.0)


def avoided_share(
    severity: ArrayLike, ideal: ArrayLike, unreacting: ArrayLike, weights: ArrayLike, counts: Counts
) -> FloatArray:
    """A = 1 - sum(w_i max(0, U_i - Ug_i)) / sum(w_i max(0, U0_i - Ug_i)) over all evaluated points,
    (m,).

    severity: U_i of the ADS, (n,), m/s, 0 without an incident, nan where it could not be evaluated.
    ideal: Ug_i of the ideal vehicle in the same concrete scenarios, (n,), m/s, likewise.
    unreacting: U0_i of `no_reaction` in the same concrete scenarios, (n,), m/s, likewise.
    weights: w_i, (n,), nan where a case has no part.
    counts: (m, n).

    A is 1 for an ADS that does as the ideal vehicle, 0 for one that does nothing, and below 0 for
    one that does worse. A numerator of 0 gives 1. A denominator of 0 with any other numerator gives
    0. If all points of a sample have the weight 0, every point weighs the same. A is nan if no
    point of a sample is known. An ADS that is at least as good in every case and better in one
    never has a lower A.
    """
    stakes = Stakes.of(severity, ideal, unreacting, weights)
    weighted = counts @ stakes.weight > 0.0  # where False, every point of the sample weighs 1
    numerator, denominator = (
        np.where(weighted, counts @ (stakes.weight * part), counts @ part)
        for part in (stakes.lost, stakes.at_stake)
    )
    share = 1.0 - quotient(numerator, denominator, denominator > 0.0, 1.0)
    share = np.where(numerator > 0.0, share, 1.0)
    return np.where(_contains(stakes.known, counts), share, np.nan)


class Stakes(NamedTuple):
    """Terms of A, (n,) each. If one of a point's three terms is not known, all three are 0.

    lost: max(0, U_i - Ug_i), m/s.
    at_stake: max(0, U0_i - Ug_i), m/s.
    weight: w_i.
    known: whether all three terms are known.
    """

    lost: FloatArray
    at_stake: FloatArray
    weight: FloatArray
    known: BoolArray

    @classmethod
    def of(
        cls, severity: ArrayLike, ideal: ArrayLike, unreacting: ArrayLike, weights: ArrayLike
    ) -> Self:
        """Terms of each point, from the arguments of `avoided_share`."""
        lost, at_stake = excess(severity, ideal), excess(unreacting, ideal)
        known = np.isfinite(lost) & np.isfinite(at_stake) & np.isfinite(weights)
        lost, at_stake, weight = (np.where(known, each, 0.0) for each in (lost, at_stake, weights))
        return cls(lost, at_stake, weight, known)


def avoided_share_losses(
    severity: ArrayLike, ideal: ArrayLike, unreacting: ArrayLike, weights: ArrayLike
) -> FloatArray:
    """Part of each point in 1 - A: w_i max(0, U_i - Ug_i) / sum(w_i max(0, U0_i - Ug_i)), (n,).

    severity, ideal, unreacting, weights: as in `avoided_share`.

    nan where a point is not known. If nothing was at stake but something was lost, A is 0: the part
    of a point is then its share of all that was lost.
    """
    stakes = Stakes.of(severity, ideal, unreacting, weights)
    weight = stakes.weight if stakes.weight.any() else stakes.known.astype(np.float64)
    taken = weight * stakes.lost
    # the divisor is the sum at stake; if that is 0, the sum of the losses; if that is 0 too, 1
    whole = float(np.sum(weight * stakes.at_stake)) or float(np.sum(taken)) or 1.0
    return np.where(stakes.known, taken / whole, np.nan)


def product_losses(factors: FloatArray) -> FloatArray:
    """Part of each factor in 1 minus a product of factors, (n, k); a row adds up to 1 minus its
    product.

    factors: v_j of each of n cases, (n, k), 0..1.

    This is the Shapley value. Set the factors of a case to 1 in some order. Each gains (1 - v_j)
    times the product of the factors that are not yet 1. The value is the mean gain over all
    orders. In it every number of factors not yet 1, from 0 to k - 1, has the same weight 1/k,
    shared by all combinations of this number.
    """
    k = factors.shape[1]
    losses = np.empty(factors.shape)
    for column in range(k):
        others = [other for other in range(k) if other != column]
        share = np.zeros(len(factors))
        for size in range(k):
            weight = 1.0 / (k * math.comb(k - 1, size))
            for chosen in itertools.combinations(others, size):
                share += weight * factors[:, list(chosen)].prod(axis=1)
        losses[:, column] = (1.0 - factors[:, column]) * share
    return losses


def regret(
    severity: ArrayLike, ideal: ArrayLike, weights: FloatArray, counts: Counts
) -> FloatArray:
    """sum(w_i max(0, U_i - Ug_i)) / sum(w_i) over all evaluated points of every sample, m/s, (m,).

    severity, ideal, weights, counts: as in `avoided_share`.

    If all weights of a sample are 0, every point weighs the same. nan if no point of a sample is
    known.
    """
    lost = excess(severity, ideal)
    mean = weighted_mean(lost, weights, counts)
    plain = weighted_mean(lost, np.where(np.isnan(weights), np.nan, 1.0), counts)
    return np.where(np.isnan(mean), plain, mean)


def avoidance_grade(avoided: ArrayLike, sharpness: float) -> FloatArray:
    """A' = 1 - ln(1 + x/x0) / ln(1 + 1/x0), x = 1 - A, any shape: 1 for the ideal vehicle, 0 for
    doing nothing.

    avoided: A, at most 1, from `avoided_share`; nan stays nan.
    sharpness: x0, above 0, from `[method.task]`: a share of harm below which A' hardly falls.
    """
    x = np.subtract(1.0, avoided)
    return np.asarray(1.0 - np.log1p(x / sharpness) / np.log1p(1.0 / sharpness))


def grade_slope(avoided: float, sharpness: float) -> float:
    """Slope of max(A', 0): dA'/dA = 1 / ((x0 + x) ln(1 + 1/x0)), x = 1 - A; 0 where A < 0.

    avoided: A, at most 1, from `avoided_share`.
    sharpness: x0, above 0, from `[method.task]`.
    """
    if avoided < 0.0:  # A' is below 0, and max(A', 0) is flat
        return 0.0
    return 1.0 / ((sharpness + 1.0 - avoided) * math.log1p(1.0 / sharpness))


def _contains(flags: ArrayLike, counts: Counts) -> BoolArray:
    """Whether each sample contains a flagged case, (m,)."""
    return counts @ np.asarray(flags, float) > 0.0
