"""95 % intervals of what is read off events: rates, ends of ranges, correlations."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from sumo_eval.trajectory import FloatArray

LEVEL: Final = 0.95
Z: Final = 1.959963984540054  # the normal distribution's 97.5 % point


def rate_interval(events: int, exposure: float, level: float = LEVEL) -> tuple[float, float]:
    """Exact limits of a Poisson rate, per unit of `exposure` (Garwood 1936); 0 events: 0 and the upper limit alone."""
    from scipy.special import gammaincinv

    tail = (1.0 - level) / 2.0
    low = float(gammaincinv(events, tail)) if events else 0.0
    return low / exposure, float(gammaincinv(events + 1, 1.0 - tail)) / exposure


def end_interval(values: FloatArray, *, upper: bool, level: float = LEVEL) -> tuple[float, float]:
    """Where a range ends, by the two values (n,) that reach furthest (Robson and Whitlock 1964).

    The end lies beyond the furthest value, and beyond it by more than (level / (1 - level)) times the distance from the
    second furthest with probability 1 - level, whatever the distribution, as long as its density at the end is neither
    0 nor infinite. Where it fades out instead there is no end, and the interval says little.
    """
    ordered = np.sort(values)
    last, before = (ordered[-1], ordered[-2]) if upper else (ordered[0], ordered[1])
    beyond = float(last + (last - before) * level / (1.0 - level))
    return (float(last), beyond) if upper else (beyond, float(last))


def rank_correlation(a: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    """Spearman's rank correlation of (n,) and (n,), and its 95 % limits (Bonett and Wright 2000)."""
    ranks = [np.argsort(np.argsort(values, kind="stable"), kind="stable").astype(np.float64) for values in (a, b)]
    rho = float(np.corrcoef(ranks[0], ranks[1])[0, 1])
    if len(a) < 4:
        return rho, -1.0, 1.0
    half = Z * math.sqrt((1.0 + rho**2 / 2.0) / (len(a) - 3))
    middle = math.atanh(min(max(rho, -1.0 + 1e-12), 1.0 - 1e-12))
    return rho, math.tanh(middle - half), math.tanh(middle + half)


def kolmogorov(shares: FloatArray) -> float:
    """Largest distance between values (n,) of a distribution function at what was drawn, and the even distribution."""
    ordered, n = np.sort(shares), len(shares)
    steps = np.arange(n) / n
    return float(max(np.max(ordered - steps), np.max(steps + 1.0 / n - ordered)))
