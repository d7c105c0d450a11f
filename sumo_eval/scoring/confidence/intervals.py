"""Intervals of every score from two sources: which points were driven, and which drivers H and D compare with.

A bootstrap. Each replicate draws the points anew (`draw_counts`), the same ones for every ADS, and adds to D and H an
error of the drivers' own size, which a jackknife over drivers has measured (`sumo_eval.scoring.confidence.drivers`).
What was never seen is counted too: a sample in which k of n hazardous points hold a collision is no proof that other
points hold none. The end of an interval on the bad side therefore carries e unseen collisions, e from an exponential
distribution of mean 1, as hard as those of doing nothing: together with the drawn ones a gamma distribution of shape
k + 1, as in the exact interval of a Poisson count. Its 95 % point for k = 0 is 3.0, the rule of three. A sum loses
with each of them. C is a mean over collisions, so the first of them makes it what collisions leave: it loses that with
the chance that an evaluation of as many points sees any.

Points of a method that leaves no part of the space out are balanced over it: their mean place is the box's, so what a
score's terms owe to a trend along a parameter is no error of theirs. Replicates are balanced in the same way
(`balanced`), but for the few cases that collided, which no method spreads: C is a mean over them, and a collision in
the safe zone leaves no D, so a replicate without any of these has one, and S with it.

The limits of an interval are percentiles of the resamples. With few cases they are widened, by as much as Student's t
is wider than the normal distribution (Hesterberg 2015). A collision keeps its weight r (Eq. 16) in every resample.

Everything random has a stream named by scenario, driver or ADS, never by a place in a list, so an interval is one
ADS's, whoever else is evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri, ndtr, stdtrit

from sumo_eval.method.score_terms import excess, ordering_score, paper_score
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.scoring.case_terms import SCORES, CaseTerms, point_values, ratios, scores_of
from sumo_eval.scoring.confidence.drivers import DriverDeviations
from sumo_eval.settings import MethodSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray

LEVEL = 0.95
REPLICATES = 2_000
AT_ONCE = 2_000_000  # cases in replicates that are held at a time: 16 MB a table, and 1,000 cases with all replicates
DRAWN_AT_ONCE = 500_000  # of these, what is drawn at a time
POINTS_IN_CACHE = 8_000  # that are looked at together, with some arrays of their coordinates: half a megabyte
EVEN = frozenset({"grid", "sobol", "halton"})  # ways of sampling that leave no part of the space out
SMALLEST = 4  # points that are split in halves
_FLAT = 1e-9  # of the box: points that differ by less along a direction have no trend there
UNSEEN = 3.0  # rule of three: with none seen among n, at most 3/n with 95 % confidence
SCORED = tuple(name for name in SCORES if name != "collision_probability")
BAD_SIDE_UP = frozenset({"regret"})  # more is worse

IntArray = NDArray[np.intp]


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
class Judged:
    """One ADS in one scenario. points: which of the scenario's points each case is, (n,). hazardous: (n,).
    drivers: what the choice of drivers does to its D and H.
    """

    ads: str
    terms: CaseTerms
    points: IntArray
    hazardous: BoolArray
    drivers: DriverDeviations


@dataclass(frozen=True, slots=True, eq=False)
class ScoreIntervals:
    """limits: low and high of each score that exists, by its name among the scores. sources: half-width of S and S+ by
    each source alone, by score. worse, better: S+ of every replicate, with and without unseen collisions, (m,).
    worse_a, better_a: the points that A gives to it. missing, missing_a: how far missing cases may move S+ and these
    points, down and up. same_drives: a number that ADSs have in common who drove every case of the scenario alike.
    """

    limits: Mapping[str, tuple[float, float]]
    sources: Mapping[str, Mapping[str, float]]
    worse: FloatArray
    better: FloatArray
    worse_a: FloatArray
    better_a: FloatArray
    missing: tuple[float, float] = (0.0, 0.0)
    missing_a: tuple[float, float] = (0.0, 0.0)
    same_drives: int | None = None


class Strata(Sequence[IntArray]):
    """Points that a replicate exchanges for each other, by their places: lists that lie one behind the other.

    A list is made when it is asked for: half a million arrays of two places each are ten times what they hold. order:
    all places, (n,). ends: where each list ends in it, (g,).
    """

    def __init__(self, order: IntArray, ends: IntArray) -> None:
        self._order, self._ends = order, ends

    @classmethod
    def of(cls, groups: Sequence[IntArray]) -> Strata:
        """These lists, which may be strata already."""
        if isinstance(groups, Strata):
            return groups
        order = np.concatenate([np.empty(0, dtype=np.intp), *groups])
        return cls(order, np.cumsum([len(group) for group in groups], dtype=np.intp))

    @property
    def sizes(self) -> IntArray:
        """How many places each list has, (g,)."""
        return np.diff(self._ends, prepend=0)

    def of_size(self, size: int) -> IntArray:
        """The lists of one size, (k, size), in their order."""
        sizes = self.sizes
        places: IntArray = self._order[(self._ends - sizes)[sizes == size][:, None] + np.arange(size)]
        return places

    def numbers(self) -> IntArray:
        """The number of the list that each place stands in, (n,)."""
        found = np.empty(self.points, dtype=np.intp)
        found[self._order] = np.repeat(np.arange(len(self._ends)), self.sizes)
        return found

    @property
    def points(self) -> int:
        """How many points they have together."""
        return len(self._order)

    def __len__(self) -> int:
        return len(self._ends)

    def __iter__(self) -> Iterator[IntArray]:
        first = 0
        for end in map(int, self._ends):
            yield self._order[first:end]
            first = end

    @overload
    def __getitem__(self, place: int) -> IntArray: ...

    @overload
    def __getitem__(self, place: slice) -> Sequence[IntArray]: ...

    def __getitem__(self, place: int | slice) -> IntArray | Sequence[IntArray]:
        if isinstance(place, slice):
            return [self[one] for one in range(*place.indices(len(self)))]
        one = range(len(self))[place]
        return self._order[int(self._ends[one - 1]) if one else 0 : int(self._ends[one])]


def strata(unit: FloatArray, method: str) -> Strata:
    """Points that a replicate exchanges for each other: lists of their places in `unit`, (n, k) in the unit box.

    Points of a method that leaves no part of the space out (`EVEN`) are halved again and again, across the widest side,
    down to neighbours of two or three: only these may stand for each other. Points of all other methods are one list.
    """
    order, sizes = np.arange(len(unit)), np.array([len(unit)])
    while method in EVEN and (split := sizes >= SMALLEST).any():
        _sort_along_widest(order, sizes, unit)
        half = np.where(split, sizes // 2, sizes)
        sizes = np.column_stack([half, sizes - half])[np.column_stack([np.ones_like(split), split])]
    return Strata(order, np.cumsum(sizes))


def of_one_number(stratum: IntArray) -> Strata:
    """The places of each number in `stratum`, (n,), in the order of the numbers."""
    order = np.argsort(stratum, kind="stable")
    return Strata(order, np.append(np.flatnonzero(np.diff(stratum[order])) + 1, len(order)))


def _sort_along_widest(order: IntArray, sizes: IntArray, unit: FloatArray) -> None:
    """Put the places of each list that will be halved in their order across its widest side. order: list behind list.

    Lists of one size are sorted together, as many as stay in a cache: a million points have half a million lists.
    """
    firsts = np.cumsum(sizes) - sizes
    for size in np.unique(sizes[sizes >= SMALLEST]).tolist():
        for same in _some_at_a_time(firsts[sizes == size], size):
            here = same[:, None] + np.arange(size)
            rows = order[here]
            points = unit[rows]
            axis = np.argmax(np.ptp(points, axis=1), axis=1)
            along = np.take_along_axis(points, axis[:, None, None], axis=2)[:, :, 0]
            order[here] = np.take_along_axis(rows, np.argsort(along, axis=1, kind="stable"), axis=1)


def _some_at_a_time(lists: IntArray, size: int) -> Iterator[IntArray]:
    """Arrays along their first axis, of lists of one size, at most as many as `POINTS_IN_CACHE` allows."""
    some = max(POINTS_IN_CACHE // size, 1)
    for first in range(0, len(lists), some):
        yield lists[first : first + some]


def same_sizes(groups: Sequence[IntArray]) -> list[tuple[int, IntArray]]:
    """Groups of more than one point by their size: (size, places (g, size))."""
    found = Strata.of(groups)
    return [(size, found.of_size(size)) for size in np.unique(found.sizes).tolist() if size > 1]


def draw_counts(
    groups: Sequence[IntArray],
    replicates: int,
    stream: np.random.Generator,
    sizes: Sequence[tuple[int, IntArray]] | None = None,
) -> FloatArray:
    """How often each point stands in each replicate, (m, n). sizes: `same_sizes` of the groups, where that is known.

    From each group of s points s - 1 are drawn with replacement and count s/(s - 1) times (Rao and Wu 1988): so the
    variance of a mean is right for groups of two as well. A group of one stands in every replicate.
    """
    counts = np.ones((replicates, Strata.of(groups).points))
    for size, same in same_sizes(groups) if sizes is None else sizes:
        some = max(DRAWN_AT_ONCE // same.size, 1)  # replicates: the numbers of a stream are the same, however many
        for first in range(0, replicates, some):
            rows = slice(first, min(first + some, replicates))
            drawn = stream.multinomial(size - 1, np.full(size, 1.0 / size), (rows.stop - first, len(same)))
            counts[rows, same.ravel()] = (drawn * (size / (size - 1))).reshape(rows.stop - first, -1)
    return counts


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """What `balanced` does to every draw from the same groups. trend: (n, r), orthonormal. scale: of what is left."""

    trend: FloatArray
    scale: float

    @classmethod
    def of(cls, groups: Sequence[IntArray], unit: FloatArray) -> Balance | None:
        """Of groups of points, (n, k) in the unit box; None where a trend cannot be told from chance."""
        n, k = unit.shape
        sizes = Strata.of(groups).sizes
        if n - len(sizes) < 2 * k:
            return None
        trend, extent, _ = np.linalg.svd(unit - unit.mean(axis=0), full_matrices=False)
        trend = trend[:, extent > _FLAT]  # 1 is orthogonal to every draw: each group has as many points as it has
        spread = float(sizes[sizes > 1].sum())  # of a group of s: G = s/(s - 1) (1 - 1/s)
        by_group = np.zeros(len(sizes))
        for size, same in same_sizes(groups):
            squares = [_squares_about_mean(trend[some]) for some in _some_at_a_time(same, size)]
            by_group[sizes == size] = size / (size - 1) * np.concatenate(squares)
        lost = sum(map(float, by_group[sizes > 1]))
        return cls(trend, math.sqrt(spread / (spread - lost)))

    def __call__(self, counts: FloatArray) -> FloatArray:
        """The draws (m, n), balanced."""
        errors = counts - 1.0
        errors -= (errors @ self.trend) @ self.trend.T
        errors *= self.scale
        errors += 1.0
        return np.maximum(errors, 0.0, out=errors)


def _squares_about_mean(places: FloatArray) -> FloatArray:
    """Sum of squared distances of the places of each group from their mean, (g,) of (g, s, r)."""
    squares = np.square(places - places.mean(axis=1, keepdims=True))
    return np.asarray(squares.reshape(len(places), -1).sum(axis=1))


def balanced(counts: FloatArray, groups: Sequence[IntArray], unit: FloatArray) -> FloatArray:
    """Replicates whose points have the mean place that all points have, (m, n); not below 0.

    counts: drawn from groups, c = 1 + e. unit: the points, (n, k). With R the projection on what is orthogonal to 1 and
    to the k coordinates, and G the covariance of e: c' = 1 + sqrt(tr G / tr(R G)) R e. So the variance of a mean is
    that of the residuals of its terms from their linear trend, scaled so that terms without a trend keep theirs
    (balanced sampling: Deville and Tille 2005). With fewer than 2 k degrees of freedom in the groups a trend cannot be
    told from chance, and the counts stay as they are.
    """
    balance = Balance.of(groups, unit)
    return counts if balance is None else balance(counts)


def score_intervals(
    judged: Sequence[Judged],
    groups: Sequence[IntArray],
    method: MethodSettings,
    seed: int,
    scenario: str,
    *,
    level: float = LEVEL,
    replicates: int = REPLICATES,
    even: FloatArray | None = None,
    progress: Progress = quiet,
) -> list[ScoreIntervals]:
    """The intervals of all ADSs in one scenario. groups: of all its points (`strata`). even: its points in the unit
    box, (n, k), where they are balanced over it (`balanced`).
    """
    stream = random_stream(seed, "intervals", scenario)
    groups = Strata.of(groups)
    n = groups.points
    parts: list[list[_Replicates]] = [[] for _ in judged]
    at_once = max(AT_ONCE // max(n, 1), 1)
    draws = [_Draws.of(one, seed, scenario, replicates) for one in judged]
    sizes = same_sizes(groups)
    balance = None if even is None else Balance.of(groups, even)
    for first in range(0, replicates, at_once):
        rows = slice(first, min(first + at_once, replicates))
        plain = draw_counts(groups, rows.stop - first, stream, sizes)
        counts = plain if balance is None else balance(plain)
        for one, drawn, part in zip(judged, draws, parts, strict=True):
            part.append(_replicates(one, _at(counts, one.points), _at(plain, one.points), drawn.rows(rows), method))
        progress(f"{scenario}: replicates for the intervals", rows.stop, replicates)
    return [
        _intervals(one, _Replicates.joined(part), drawn, groups, method, level)
        for one, drawn, part in zip(judged, draws, parts, strict=True)
    ]


def _at(counts: FloatArray, points: IntArray) -> FloatArray:
    """How often the points of an ADS's cases stand, (m, n): the counts themselves where it drove at all points."""
    return counts if np.array_equal(points, np.arange(counts.shape[1])) else counts[:, points]


@dataclass(frozen=True, slots=True, eq=False)
class _Draws:
    """What is random of one ADS besides the points, (m,): unseen collisions, and the drivers' errors of D and H."""

    unseen: FloatArray
    index: FloatArray
    likeness: FloatArray

    @classmethod
    def of(cls, one: Judged, seed: int, scenario: str, replicates: int) -> _Draws:
        unseen = random_stream(seed, "intervals", "unseen", scenario, one.ads).standard_exponential(replicates)
        deviates = driver_deviates(one.drivers, seed, replicates)
        return cls(unseen, deviates @ one.drivers.index, deviates @ one.drivers.likeness)

    def rows(self, rows: slice) -> _Draws:
        return _Draws(self.unseen[rows], self.index[rows], self.likeness[rows])


def driver_deviates(drivers: DriverDeviations, seed: int, replicates: int) -> FloatArray:
    """Student's t numbers, (m, k), one column a driver: each driver's are his own in every scenario and for every ADS.

    That is why the drivers' part of two ADSs' scores cancels in their difference as far as it is common.
    """
    normal = [random_stream(seed, "intervals", "driver", name).standard_normal(replicates) for name in drivers.names]
    if not normal:
        return np.zeros((replicates, 0))
    share = random_stream(seed, "intervals", "spread of drivers").uniform(size=replicates)
    wider = np.sqrt(drivers.freedom / chdtri(drivers.freedom, share))
    return np.column_stack(normal) * wider[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class _Replicates:
    """Scores of replicates by name, (m,). better: as drawn. worse: with unseen collisions. points_only: without the
    drivers' error.
    """

    better: Mapping[str, FloatArray]
    worse: Mapping[str, FloatArray]
    points_only: Mapping[str, FloatArray]

    @classmethod
    def joined(cls, parts: Sequence[_Replicates]) -> _Replicates:
        def join(kind: str) -> dict[str, FloatArray]:
            tables = [getattr(part, kind) for part in parts]
            return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}

        return cls(join("better"), join("worse"), join("points_only"))


def _replicates(
    one: Judged, counts: FloatArray, plain_counts: FloatArray, drawn: _Draws, method: MethodSettings
) -> _Replicates:
    terms = one.terms
    plain = scores_of(terms, counts, method, plain_counts)
    better = _with_drivers(plain, drawn.index, drawn.likeness, method)
    worse = dict(better)
    for name, lost in unseen_losses(one, counts, method).items():
        moved = lost.of(drawn.unseen)
        worse[name] = better[name] + moved if name in BAD_SIDE_UP else better[name] - moved
    return _Replicates(better, _summed(worse, method), plain)


def _with_drivers(
    scores: Mapping[str, FloatArray], index: FloatArray, likeness: FloatArray, method: MethodSettings
) -> dict[str, FloatArray]:
    """The scores with errors of D and H, which stay within 0..1."""
    moved = dict(scores)
    moved["d"] = np.clip(scores["d"] + index, 0.0, 1.0)
    moved["human_likeness"] = np.clip(scores["human_likeness"] + likeness, 0.0, 1.0)
    return _summed(moved, method)


def _summed(scores: Mapping[str, FloatArray], method: MethodSettings) -> dict[str, FloatArray]:
    """The scores with S and S+ of what they are made of."""
    s = paper_score(scores["c"], scores["d"], method.score)
    plus = ordering_score(scores["avoided_share"], scores["human_likeness"], method.score)
    return {**scores, "s": s, "s_plus": plus}


@dataclass(frozen=True, slots=True, eq=False)
class UnseenLoss:
    """What unseen collisions would cost a score: whole, (m,), if every free point held one; points: among how many
    they are; first_takes_all: the first one costs the whole (C), else each one costs its part.
    """

    points: int
    whole: FloatArray
    first_takes_all: bool = False

    def of(self, unseen: ArrayLike) -> FloatArray:
        """The mean loss, (m,), to so many collisions in expectation: p = unseen/points is the chance of a point.

        p * whole where each costs its part; (1 - (1 - p)^points) * whole where the first one costs it.
        """
        chance = np.minimum(np.asarray(unseen, dtype=np.float64) / self.points, 1.0)
        if self.first_takes_all:
            chance = 1.0 - (1.0 - chance) ** self.points
        return np.asarray(chance * self.whole, dtype=np.float64)


def unseen_losses(one: Judged, counts: FloatArray, method: MethodSettings) -> dict[str, UnseenLoss]:
    """By score. A free point is a hazardous one without a collision (any evaluated one, if none is hazardous).

    An unseen collision is as hard there as that of `no_reaction`. A, regret: it loses max(0, U0 - Ug). C: evaluations
    that see any have Ug/U0, the others 1; after a collision that was seen, C is a mean over collisions, which unseen
    ones do not lower for sure.
    """
    terms = one.terms
    stake = excess(terms.unreacting, terms.ideal)
    known = terms.evaluated & np.isfinite(stake)
    among = known & one.hazardous if (known & one.hazardous).any() else known
    found: dict[str, UnseenLoss] = {}
    if not among.any():
        return found
    points, free = int(among.sum()), among & ~terms.collided
    stake = np.where(known, stake, 0.0)
    for name, weights in (("avoided_share", terms.weight), ("avoided_share_exposure", terms.exposure)):
        weight = _weights(weights, known)
        found[name] = UnseenLoss(points, _ratio(counts @ (weight * stake * free), counts @ (weight * stake)))
    weight = _weights(terms.weight, known)
    found["regret"] = UnseenLoss(points, _ratio(counts @ (weight * stake * free), counts @ weight))
    if not terms.collided.any():
        hit = np.nan_to_num(1.0 - ratios(terms.unreacting, terms.ideal, method)) * free
        found["c"] = UnseenLoss(points, _ratio(counts @ (weight * hit), counts @ (weight * free)), first_takes_all=True)
    return found


def _weights(weights: FloatArray, known: BoolArray) -> FloatArray:
    """Of the known cases; every one the same where all are 0."""
    weight = np.where(known, np.nan_to_num(weights), 0.0)
    return weight if weight.any() else known.astype(np.float64)


def _ratio(over: FloatArray, under: FloatArray) -> FloatArray:
    return np.divide(over, under, out=np.zeros(over.shape), where=under > 0.0)


def _intervals(
    one: Judged,
    found: _Replicates,
    drawn: _Draws,
    groups: Sequence[IntArray],
    method: MethodSettings,
    level: float,
) -> ScoreIntervals:
    values = point_values(one.terms, method)
    free = _freedom(one, groups)
    limits = {}
    once = np.ones((1, len(one.points)))
    unseen = {} if one.terms.collided.any() else unseen_losses(one, once, method)
    for name in SCORED:
        value = values[name]
        if value is None:
            continue
        low, high = (found.better, found.worse) if name in BAD_SIDE_UP else (found.worse, found.better)
        ends = _limits(low[name], high[name], free[name], level)
        if ends is None:
            continue
        if name in unseen:  # none was seen: what they would cost is known, and nothing of it is drawn
            moved = float(unseen[name].of(UNSEEN)[0])
            ends = (value, value + moved) if name in BAD_SIDE_UP else (value - moved, value)
        limits[name] = min(ends[0], value), max(ends[1], value)
    zero = np.zeros(len(drawn.index))
    plain = {name: np.full(len(zero), np.nan if value is None else value) for name, value in values.items()}
    alone = {
        "cases": found.points_only,
        "drivers": _with_drivers(plain, drawn.index, drawn.likeness, method),
    }
    sources: dict[str, Mapping[str, float]] = {
        name: {source: _half(scores[name], free[name], level) for source, scores in alone.items()}
        for name in ("s", "s_plus")
        if name in limits
    }
    worse_a, better_a = (
        ordering_score(scores["avoided_share"], 0.0, method.score) for scores in (found.worse, found.better)
    )
    return ScoreIntervals(limits, sources, found.worse["s_plus"], found.better["s_plus"], worse_a, better_a)


def _freedom(one: Judged, groups: Sequence[IntArray]) -> dict[str, int]:
    """Degrees of freedom of each score's error: points that have a part in it, less one in each group."""
    group = Strata.of(groups).numbers()

    def free(part: BoolArray) -> int:
        places = group[one.points[part]]
        return max(len(places) - len(np.unique(places)), 1)

    terms = one.terms
    everyone = free(terms.evaluated)
    return {
        **dict.fromkeys(SCORED, everyone),
        "c": everyone if not terms.collided.any() else max(int(np.isfinite(terms.ratio).sum()) - 1, 1),
        "d": free(np.isfinite(terms.index)),
        "human_likeness": free(np.isfinite(terms.likeness)),
    }


def _limits(low: FloatArray, high: FloatArray, freedom: int, level: float) -> tuple[float, float] | None:
    """Percentiles, widened for so many degrees of freedom: by the quantile of t in place of the normal one."""
    low, high = low[np.isfinite(low)], high[np.isfinite(high)]
    if not (len(low) and len(high)):
        return None
    tail = float(ndtr(stdtrit(freedom, (1.0 - level) / 2.0)))
    return float(np.quantile(low, tail)), float(np.quantile(high, 1.0 - tail))


def _half(values: FloatArray, freedom: int, level: float) -> float:
    ends = _limits(values, values, freedom, level)
    return 0.0 if ends is None else (ends[1] - ends[0]) / 2.0
