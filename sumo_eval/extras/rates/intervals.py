"""95 % intervals of quantities that are learnt from recorded events: rates, ends of ranges,
correlations; and Kolmogorov distances.

Users: `extras/rates/campaign.py`, `extras/rates/campaign_page.py`, `extras/rates/importance.py`,
`extras/rates/learn_page.py`, `extras/rates/learned.py`.
"""

import math

import numpy as np

from sumo_eval.method.agreement import rank_correlation, rank_interval
from sumo_eval.trajectory import FloatArray

LEVEL = 0.95
OUTERMOST = 3  # k of `end_interval`

Limits = tuple[float, float, float]
"""A value and the limits of its interval; their level is `LEVEL` or a function's argument."""


def of_each(count: int) -> float:
    """Level of each of `count` intervals so that all hold at once with probability `LEVEL`.

    The probability is exact for independent intervals. For two-sided intervals of normal estimates
    it is at least `LEVEL`. Source: Sidak (1967).
    """
    return math.pow(LEVEL, 1.0 / max(count, 1))


def rate_interval(events: int, exposure: float, level: float = LEVEL) -> tuple[float, float]:
    """Exact limits of a Poisson rate, in events per unit of `exposure`.

    Without events the lower limit is 0. Source: Garwood (1936).
    """
    from scipy.special import gammaincinv

    tail = (1.0 - level) / 2.0
    low = float(gammaincinv(events, tail)) if events else 0.0
    return low / exposure, float(gammaincinv(events + 1, 1.0 - tail)) / exposure


def end_interval(values: FloatArray, *, upper: bool, level: float = LEVEL) -> tuple[float, float]:
    """Interval of the end of a range, from the k + 1 outermost values, k = `OUTERMOST`.

    values: within the range, (n,), at least 2.
    upper: whether of the range's upper end; else of its lower one.

    The interval begins at the outermost value. Let e be the distance from this value to the end of
    the range, and g the distance from it to the value k further in. If the density is even over
    these values, e / (e + g) has a beta distribution (1, k), so that e > c g with probability
    (1 + c)^-k. This is 1 - level for c = (1 - level)^(-1/k) - 1. If the density fades out, there is
    no end, and the interval means little.

    Source: after Robson and Whitlock (1964), who take k = 1.
    """
    ordered = np.sort(values if upper else -values)  # the lower end of x is the upper end of -x
    k = min(OUTERMOST, len(ordered) - 1)
    last = ordered[-1]
    beyond = last + (last - ordered[-1 - k]) * ((1.0 - level) ** (-1.0 / k) - 1.0)
    return (last, beyond) if upper else (-beyond, -last)


def correlation_interval(a: FloatArray, b: FloatArray, level: float = LEVEL) -> Limits:
    """Spearman's rank correlation of a (n,) and b (n,), and its limits."""
    rho = rank_correlation(a, b).value
    # `rank_interval` has no limits for -1 and 1, nor for fewer than 4 values
    limits = rank_interval(min(max(rho, -1.0 + 1e-12), 1.0 - 1e-12), len(a), level)
    return rho, *(limits or (-1.0, 1.0))


def kolmogorov(shares: FloatArray) -> float:
    """Kolmogorov distance of a distribution from a sample.

    shares: its distribution function at each value of the sample, (n,), 0..1.
    """
    from scipy.stats import kstest

    return float(kstest(shares, "uniform", method="asymp").statistic)


def kolmogorov_by_chance(count: int) -> float:
    """The `kolmogorov` distance that one of twenty samples of the distribution itself exceeds.

    count: values in a sample.

    1.358 is Kolmogorov's limit for many values. For five values the result is 8 % too large.
    """
    return 1.358 / math.sqrt(count)
