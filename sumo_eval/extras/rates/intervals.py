"""95 % intervals of figures of events: rates, ends of ranges, correlations."""

from __future__ import annotations

import math

import numpy as np

from sumo_eval.method.agreement import rank_interval
from sumo_eval.trajectory import FloatArray

LEVEL = 0.95
OUTERMOST = 3  # spacings between the furthest values that show an end


def of_each(count: int) -> float:
    """The level of each of `count` intervals that hold all at once with probability `LEVEL` (Sidak
    1967).

    Exact where they are independent, and never below `LEVEL` for two-sided intervals of normal
    estimates.
    """
    return float(LEVEL ** (1.0 / max(count, 1)))


def rate_interval(events: int, exposure: float, level: float = LEVEL) -> tuple[float, float]:
    """Exact limits of a Poisson rate, per unit of `exposure` (Garwood 1936); 0 events: 0 and the
    upper limit alone.
    """
    from scipy.special import gammaincinv

    tail = (1.0 - level) / 2.0
    low = float(gammaincinv(events, tail)) if events else 0.0
    return low / exposure, float(gammaincinv(events + 1, 1.0 - tail)) / exposure


def end_interval(values: FloatArray, *, upper: bool, level: float = LEVEL) -> tuple[float, float]:
    """Where a range ends, by the k + 1 values of (n,) that reach furthest, k = `OUTERMOST` (after
    Robson and Whitlock 1964, who take k = 1).

    The end lies beyond the furthest value, and by more than c = (1 - level)^(-1/k) - 1 times the
    distance from there to the value k further in with probability (1 + c)^-k = 1 - level: the
    spacings there are alike where the density is even over the outermost values, and e / (e + g) of
    one and the sum g of k others is then a beta (1, k). A density that fades out instead has no
    end, and the interval means little.
    """
    ordered = np.sort(values)
    k = min(OUTERMOST, len(ordered) - 1)
    last, within = (ordered[-1], ordered[-1 - k]) if upper else (ordered[0], ordered[k])
    beyond = last + (last - within) * ((1.0 - level) ** (-1.0 / k) - 1.0)
    return (last, beyond) if upper else (beyond, last)


def rank_correlation(
    a: FloatArray, b: FloatArray, level: float = LEVEL
) -> tuple[float, float, float]:
    """Spearman's rank correlation of (n,) and (n,), and its limits."""
    from scipy.stats import spearmanr

    rho = float(spearmanr(a, b).statistic)
    # of 1 itself there are none
    limits = rank_interval(min(max(rho, -1.0 + 1e-12), 1.0 - 1e-12), len(a), level)
    return rho, *(limits or (-1.0, 1.0))


def kolmogorov(shares: FloatArray) -> float:
    """Largest distance between values (n,) of a distribution function at drawn points, and the even
    distribution.
    """
    from scipy.stats import kstest

    return float(kstest(shares, "uniform", method="asymp").statistic)


def kolmogorov_by_chance(count: int) -> float:
    """The `kolmogorov` distance that `count` values, drawn from the distribution itself, exceed in
    one case of twenty.

    Kolmogorov's limit for many values; for five it is 8 % too large.
    """
    return 1.358 / math.sqrt(count)
