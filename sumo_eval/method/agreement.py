"""Agreement of people's opinions with the scores, and with each other: rank correlation and
Kendall's coefficient of concordance. For studies and the fits of `rates`.

Users: `extras/rates/intervals.py`, `extras/studies/opinion.py`.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from sumo_eval.errors import must_be

EXACT = 8
"""Most pairs for which p is counted over all orders: 8! = 40,320.

For few pairs Student's t is wrong: four pairs in the same order would have p = 0.
"""


class Agreement(NamedTuple):
    """A coefficient of agreement.

    value: -1..1, or 0..1 for Kendall's W; nan where it does not exist.
    p_value: probability of a value as large without any agreement.
    n: pairs or raters that it was computed from.
    """

    value: float
    p_value: float
    n: int


def rank_correlation(scores: ArrayLike, opinions: ArrayLike) -> Agreement:
    """Spearman's rho of n scores and n opinions, -1..1, and its p.

    Both are nan where either list is constant or contains a nan. p of up to 8 pairs is the share of
    all n! orders with at least this |rho|, p of more pairs is by Student's t.

    scores, opinions: (n,), n at least 3; fewer raise InputError.
    """
    first, second = np.asarray(scores, float), np.asarray(opinions, float)
    if first.shape != second.shape or first.ndim != 1 or first.size < 3:
        shapes = f"{first.shape} and {second.shape}"
        raise must_be("The lists", "a rank correlation", "equally long, at least 3", shapes)
    if not (np.ptp(first) > 0.0 and np.ptp(second) > 0.0):
        return Agreement(math.nan, math.nan, first.size)
    rho = stats.spearmanr(first, second)
    p_value = float(rho.pvalue)
    if first.size <= EXACT:
        mean_rank = 0.5 * (first.size + 1)
        ranks = stats.rankdata(first) - mean_rank
        orders = list(itertools.permutations(stats.rankdata(second) - mean_rank))
        # proportional to |rho| of each order; the first is the order of the opinions as given
        sums = np.abs(np.array(orders) @ ranks)
        p_value = float(np.mean(sums >= sums[0] - 1e-9))  # 1e-9: rounding of equal sums
    return Agreement(float(rho.statistic), p_value, first.size)


def rank_interval(rho: float, n: int, level: float = 0.95) -> tuple[float, float] | None:
    """Interval of Spearman's rho of n pairs: tanh(atanh rho -+ z sqrt((1 + rho^2/2) / (n - 3))).

    rho: -1..1 or nan.
    n: pairs.
    level: probability with which the interval covers rho.

    None where the spread of rho is not known: under 4 pairs, for nan, for |rho| = 1 up to rounding.

    Source: Bonett and Wright, Psychometrika 65, 23 (2000).
    """
    if n < 4 or not abs(rho) < 1.0 - 1e-13:
        return None
    half = float(stats.norm.ppf(0.5 + level / 2.0)) * math.sqrt((1.0 + rho * rho / 2.0) / (n - 3))
    middle = math.atanh(rho)
    return math.tanh(middle - half), math.tanh(middle + half)


def concordance(ratings: ArrayLike) -> Agreement:
    """Kendall's W of m raters (rows) who each rated the same n items (columns), 0..1, corrected for
    ties.

        W = 12 S / (m^2 (n^3 - n) - m sum(t^3 - t)), S = sum((R_i - mean R)^2), chi^2 = m (n - 1) W

    ratings: (m, n).
    R_i: sum of an item's ranks; t: sizes of the groups of equal ranks of each rater.

    W is nan where every rater gave one score to all. Raises InputError for fewer than 2 raters or
    items, or a missing rating.

    Source: Kendall, Babington Smith, Ann. Math. Stat. 10, 275 (1939).
    """
    table = np.asarray(ratings, float)
    if table.ndim != 2 or min(table.shape) < 2 or not np.all(np.isfinite(table)):
        raise must_be(
            "`ratings`", "Kendall's W", "a full table of at least 2 raters and 2 items", table.shape
        )
    m, n = table.shape
    ranks = stats.rankdata(table, axis=1)
    totals = ranks.sum(axis=0)
    ties = 0.0
    for row in ranks:
        t = np.unique(row, return_counts=True)[1]
        ties += float(np.sum(t**3 - t))
    divisor = m**2 * (n**3 - n) - m * ties
    if divisor == 0.0:
        return Agreement(math.nan, math.nan, m)
    w = 12.0 * float(np.sum((totals - totals.mean()) ** 2)) / divisor
    return Agreement(w, float(stats.chi2.sf(m * (n - 1) * w, n - 1)), m)
