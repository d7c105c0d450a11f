"""Agreement of people's opinions with scores (Spearman's rank correlation), and of people with each
other (Kendall's coefficient of concordance).

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
"""Most pairs for which p is counted over all orders, 8! = 40,320.

For few pairs p by Student's t is wrong: four pairs in the same order would have p = 0.
"""


class Agreement(NamedTuple):
    """A coefficient of agreement.

    value: -1..1, or 0..1 for Kendall's W; nan if it does not exist.
    p_value: probability of a value at least as large without any agreement.
    n: number of pairs, or of raters, that it was computed from.
    """

    value: float
    p_value: float
    n: int


def rank_correlation(scores: ArrayLike, opinions: ArrayLike) -> Agreement:
    """Spearman's rho of n scores and n opinions, -1..1, and its p.

    scores, opinions: of the same n items, (n,), in any unit.

    p of at most 8 pairs is the share of all n! orders with at least this |rho|, p of more pairs is
    by Student's t. Both numbers are nan if one list is constant or contains a nan.

    Raises InputError for lists of different lengths, and for fewer than 3 pairs.
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
        # in proportion to |rho| of each order; `permutations` begins with the opinions' own order
        sums = np.abs(np.array(orders) @ ranks)
        p_value = float(np.mean(sums >= sums[0] - 1e-9))  # 1e-9: rounding of equal sums
    return Agreement(float(rho.statistic), p_value, first.size)


def rank_interval(rho: float, n: int, level: float = 0.95) -> tuple[float, float] | None:
    """Interval of Spearman's rho of n pairs: tanh(atanh rho -+ z sqrt((1 + rho^2/2) / (n - 3))).

    rho: -1..1 or nan, from `rank_correlation`.
    n: number of pairs.
    level: probability with which the interval covers rho; z is its quantile of the normal
        distribution.

    None if the spread of rho is not known: for fewer than 4 pairs, nan, or |rho| = 1 up to
    rounding.

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

    ratings: of the raters, (m, n), in any unit.

    R_i: sum of an item's ranks over the raters; t: size of each group of equal ranks of a rater.

    W is nan if every rater gave one rating to all items. Raises InputError for fewer than 2 raters
    or items, and for a rating that is not finite.

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
