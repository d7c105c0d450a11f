"""Intervals on C, D and S from three sources: which cases were sampled, which drivers, and where the zone boundary is.

A bootstrap. Each replicate draws the cases anew, with replacement; adds to D an error of the drivers' own size, which a
jackknife over drivers has measured; and draws the zone boundary from the GP's posterior, all cases at once, so that
cases near it change sides together. The limits are percentiles, widened as Student's t is wider than the normal
distribution ("expanded percentiles", Hesterberg 2015): plain ones are too narrow for few cases.

Weights r of collisions (Eq. 16) are held as they are. A grid is no random sample: for it the first source is an upper
estimate, as if its points had fallen where they are by chance.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, stdtrit

from sumo_eval.errors import must_be
from sumo_eval.method.score_terms import collision_avoidance, combined, exposure_mean
from sumo_eval.settings import ScoreSettings
from sumo_eval.trajectory import BoolArray, FloatArray

SOURCES = ("cases", "drivers", "boundary")
REPLICATES = 2_000
AT_ONCE = 2_000_000  # cases in replicates that are held at a time: 16 MB a table, and 1,000 cases with all replicates


@dataclass(frozen=True, slots=True)
class Interval:
    """A value and the limits between which it lies with the probability `level`."""

    value: float
    low: float
    high: float
    level: float

    @property
    def half_width(self) -> float:
        """Half the distance between the limits."""
        return (self.high - self.low) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class CaseTerms:
    """What each evaluated case brings to C and D: arrays (n,).

    exposure: p. collided. avoided: Ug/U (or its class form), nan without a collision or an ideal to compare with.
    weight: r, nan likewise. index: D_i, nan where there is none. y: the zone surface at the case (Eq. 8), safe above 0.
    boundary: (n, m) the posterior deviation of y, as a factor of m standard normal numbers; m = 0: it is sure.
    driver_error: standard error of D from the choice of `drivers` drivers.
    """

    exposure: FloatArray
    collided: BoolArray
    avoided: FloatArray
    weight: FloatArray
    index: FloatArray
    y: FloatArray
    boundary: FloatArray
    driver_error: float
    drivers: int


@dataclass(frozen=True, slots=True)
class ScoreIntervals:
    """Intervals of one ADS in one scenario. d None: D was not computed. d_lost: share of replicates in which a
    collision lies in the safe zone, so that there is no D. sources: half-width of S by each source alone.
    """

    c: Interval
    d: Interval | None
    s: Interval
    d_lost: float
    sources: dict[str, float]


def score_intervals(
    terms: CaseTerms,
    score: ScoreSettings,
    stream: np.random.Generator,
    *,
    level: float = 0.95,
    replicates: int = REPLICATES,
) -> ScoreIntervals:
    """Intervals on C, D and S. level: of confidence. replicates: of the bootstrap."""
    if not 0.0 < level < 1.0:
        raise must_be("`level`", "an interval", "within 0..1", level)
    n = len(terms.exposure)
    if n < 2:
        raise must_be("The cases", "an interval", "at least 2", n)
    plain_c, plain_d = _replicates(terms, stream, 1, ())
    c, d = _replicates(terms, stream, replicates, SOURCES)
    total = _total(c, d, score)
    alone = {}
    for source in SOURCES:
        parts = _replicates(terms, stream, replicates, (source,))
        alone[source] = _limits(float("nan"), _total(*parts, score), n, level).half_width
    counted = int(np.sum(np.isfinite(terms.index) & (terms.y > 0.0)))
    hits = int(np.sum(np.isfinite(terms.avoided)))
    known = np.isfinite(d)
    d_value = float(plain_d[0])
    return ScoreIntervals(
        c=_limits(float(plain_c[0]), c, max(hits, 2), level),
        d=None if math.isnan(d_value) or not known.any() else _limits(d_value, d[known], max(counted, 2), level),
        s=_limits(float(_total(plain_c, plain_d, score)[0]), total, n, level),
        d_lost=float(np.mean(~known)),
        sources=alone,
    )


def _replicates(
    terms: CaseTerms, stream: np.random.Generator, replicates: int, sources: Collection[str]
) -> tuple[FloatArray, FloatArray]:
    """C and D of each replicate; D is nan where a collision lies in the safe zone or no safe case has an index."""
    at_once = max(AT_ONCE // len(terms.exposure), 1)
    parts = [
        _some_replicates(terms, stream, min(at_once, replicates - done), sources)
        for done in range(0, replicates, at_once)
    ]
    c, d = (np.concatenate(part) for part in zip(*parts, strict=True))
    return c, d


def _some_replicates(
    terms: CaseTerms, stream: np.random.Generator, replicates: int, sources: Collection[str]
) -> tuple[FloatArray, FloatArray]:
    n = len(terms.exposure)
    counts: FloatArray = np.ones((replicates, n))
    if "cases" in sources:
        counts = stream.multinomial(n, np.full(n, 1.0 / n), replicates).astype(np.float64)
    y = np.broadcast_to(terms.y, (replicates, n))
    if "boundary" in sources and terms.boundary.shape[1]:
        y = terms.y + stream.standard_normal((replicates, terms.boundary.shape[1])) @ terms.boundary.T
    safe = y > 0.0

    compared = np.isfinite(terms.avoided)  # a collision that cannot be compared has no part in C
    c = collision_avoidance(terms.avoided, terms.weight, compared, np.ones(n), counts)
    kept = counts * safe
    d = exposure_mean(terms.index, terms.exposure, kept)
    if "drivers" in sources and terms.driver_error > 0.0:
        d = d + terms.driver_error * stream.standard_t(max(terms.drivers - 1, 1), replicates)
    d[(kept @ terms.collided.astype(np.float64)) > 0.0] = np.nan
    return c, np.where(np.isnan(d), np.nan, np.clip(d, 0.0, 1.0))


def _total(c: FloatArray, d: FloatArray, score: ScoreSettings) -> FloatArray:
    return combined(c, d, score.a, score.b, score.k5, score.k6)


def _limits(value: float, replicates: FloatArray, n: int, level: float) -> Interval:
    """Percentiles, widened for n cases: by the quantile of t in place of the normal one."""
    tail = (1.0 - level) / 2.0
    tail = float(ndtr(math.sqrt(n / (n - 1)) * stdtrit(n - 1, tail)))
    low, high = np.quantile(replicates, [tail, 1.0 - tail])
    return Interval(value, float(low), float(high), level)


def jackknife_error(left_out: Sequence[float]) -> float:
    """Standard error of a value from what it is with each driver left out, one after the other."""
    values = np.asarray(left_out, dtype=np.float64)
    count = len(values)
    return math.sqrt((count - 1) / count * float(np.sum((values - values.mean()) ** 2))) if count > 1 else 0.0
