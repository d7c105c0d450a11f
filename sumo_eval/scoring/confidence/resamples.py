"""Counts of a bootstrap over the points of a scenario: how often each point occurs in each
replicate.

Points that may replace each other form a list (`Strata`). A replicate draws from every list of s
points s - 1, each of which counts s/(s - 1) times. Replicates of a sample that leaves no part of
the space out are also balanced over the space (`Balance`), if it has enough points.

`resamples` draws all replicates of some points, then all replicates of the next points. So time
grows in proportion to the points, and no table of all points and replicates is in memory.
`intervals`, `assessment` and `paired_differences` sum the terms of scores over these parts.

Users: `scoring/confidence/assessment.py`, `scoring/confidence/intervals.py`,
`scoring/confidence/paired_differences.py`, `scoring/confidence/scored.py`, `scoring/steps.py`.
Fixed: names of random streams, order of the draws, and `AT_ONCE` and `SPLIT`, which cut large
samples into blocks with streams of their own: all intervals depend on them.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.random import Generator

from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray, IntArray

# Most numbers in a table of points and replicates, 16 MB: 1,000 points by 2,000 replicates. If all
# points need more, they are drawn in blocks of whole lists, each with at most 1/SPLIT of this. A
# list that needs more alone is cut into pieces, each with at most all of it.
AT_ONCE = 2_000_000
SPLIT = 8
# methods of sampling that leave no part of the space out
EVEN = frozenset({"grid", "sobol", "halton"})
SMALLEST = 4  # fewest points of a list that is halved
_FLAT = 1e-9  # singular value, unit-box lengths; along a direction with less the points do not vary


class Strata(NamedTuple):
    """g lists of points. A replicate exchanges the points of a list for each other.

    order: indices of all n points, list after list, (n,).
    ends: index in `order` at which each list ends (exclusive), (g,).
    even: the points in the unit box, (n, k), if replicates are to be balanced; else None.
    """

    order: IntArray
    ends: IntArray
    even: FloatArray | None = None

    @property
    def sizes(self) -> IntArray:
        """Number of points of each list, (g,)."""
        return np.diff(self.ends, prepend=0)

    def numbers(self) -> IntArray:
        """Number of each point's list, (n,)."""
        numbers = np.empty(self.points, np.intp)
        numbers[self.order] = np.repeat(np.arange(len(self.ends)), self.sizes)
        return numbers

    @property
    def points(self) -> int:
        """Number of points of all lists."""
        return len(self.order)


def strata(unit: FloatArray, method: str) -> Strata:
    """Lists of points that a replicate may exchange for each other.

    unit: the points, (n, k), in the unit box.
    method: of their sampling.

    Points of a method that leaves no part of the space out (`EVEN`) are halved again and again,
    along the widest side, down to two or three neighbours. Only these may replace each other.
    Points of any other method are one list.
    """
    order, sizes = np.arange(len(unit)), np.array([len(unit)])
    while method in EVEN and (sizes >= SMALLEST).any():
        _sort_along_widest(order, sizes, unit)
        # a list that is not halved has an empty second half, which is left out
        half = np.where(sizes >= SMALLEST, sizes // 2, sizes)
        halves = np.column_stack([half, sizes - half])
        sizes = halves[halves > 0]
    return Strata(order, np.cumsum(sizes), unit if method in EVEN else None)


def of_one_number(stratum: IntArray) -> Strata:
    """Lists of points, one for each stratum.

    stratum: number of each point's stratum, (n,).
    """
    order = np.argsort(stratum, kind="stable")
    return Strata(order, np.append(np.flatnonzero(np.diff(stratum[order])) + 1, len(order)))


def one_list(points: int) -> Strata:
    """One list of this number of points."""
    return Strata(np.arange(points), np.array([points]))


def _sort_along_widest(order: IntArray, sizes: IntArray, unit: FloatArray) -> None:
    """Sort the points of each list that is halved next along its widest side, in place.

    order: indices of the points, list after list, (n,).
    sizes: of the lists, (g,).
    unit: the points, (n, k), in the unit box.

    Lists of one size are sorted together, because a million points have half a million lists.
    """
    firsts = np.cumsum(sizes) - sizes  # index in `order` at which each list begins
    for size in np.unique(sizes[sizes >= SMALLEST]).tolist():
        places = firsts[sizes == size][:, None] + np.arange(size)
        rows = order[places]
        points = unit[rows]  # (g, size, k)
        axis = np.argmax(np.ptp(points, axis=1), axis=1)  # the widest side of each list, (g,)
        along = np.take_along_axis(points, axis[:, None, None], axis=2)[:, :, 0]
        order[places] = np.take_along_axis(rows, np.argsort(along, axis=1, kind="stable"), axis=1)


def same_sizes(groups: Strata) -> list[tuple[int, IntArray]]:
    """Each size of lists with more than one point, with the points of the lists of this size,
    (lists, size), in the order of the lists.
    """
    sizes, order = groups.sizes, groups.order
    firsts = groups.ends - sizes
    return [
        (size, order[firsts[sizes == size][:, None] + np.arange(size)])
        for size in np.unique(sizes[sizes > 1]).tolist()
    ]


def draw_counts(groups: Strata, replicates: int, stream: Generator) -> FloatArray:
    """Number of times that each point occurs in each replicate, (m, n).

    replicates: m.
    stream: of random numbers.

    From each list of s points s - 1 are drawn with replacement, and each draw counts s/(s - 1)
    times (Rao and Wu 1988). So the variance of a mean is right for lists of two as well. The point
    of a list of one occurs once in every replicate.
    """
    counts = np.ones((replicates, groups.points))
    for size, same in same_sizes(groups):
        drawn = _multinomial(size, (replicates, len(same)), stream) * (size / (size - 1))
        counts[:, same.ravel()] = drawn.reshape(replicates, -1)
    return counts


def _multinomial(size: int, shape: tuple[int, int], stream: Generator) -> IntArray | FloatArray:
    """Number of times that each of `size` points occurs among size - 1 draws, (*shape, size).

    shape: replicates, lists.

    For two points the result follows from one uniform number, above a half or not. It equals the
    stream's multinomial numbers, in a sixth of the time.
    """
    if size != 2:
        return stream.multinomial(size - 1, np.full(size, 1.0 / size), shape)
    drawn = np.empty((*shape, 2))
    drawn[..., 0] = stream.random(shape) > 0.5
    np.subtract(1.0, drawn[..., 0], out=drawn[..., 1])
    return drawn


class Balance(NamedTuple):
    """Changes counts so that the mean position of a replicate's points is that of all points, but
    for counts that would be below 0.

    trend: orthonormal basis of the directions that R removes, (n, r).
    scale: sqrt(tr G / tr(R G)).

    Drawn counts are c = 1 + e, (n,). G is the covariance of e. R projects e onto the space
    orthogonal to 1 and to the k coordinates of the points. Balanced counts are c' = 1 + scale R e,
    and at least 0. So a linear trend of the terms adds next to nothing to the variance of their
    mean, and the variance of terms without a trend stays (balanced sampling: Deville and Tille
    2005).
    """

    trend: FloatArray
    scale: float

    @classmethod
    def of(cls, groups: Strata, unit: FloatArray) -> Self | None:
        """Balance of lists of points. None if the lists have fewer than 2 k degrees of freedom:
        removing k trends would then remove most of what is chance.

        unit: the points, (n, k), in the unit box.
        """
        n, k = unit.shape
        sizes = groups.sizes
        if n - len(sizes) < 2 * k:
            return None
        # Basis of the coordinates about their mean. (e is orthogonal to 1 already, because each
        # list keeps its number of points.)
        about = unit - unit.mean(axis=0)
        # The triangle of QR has the singular values and directions of `about`. SVD of `about`
        # itself would need three times the memory.
        _, extent, directions = np.linalg.svd(np.linalg.qr(about, mode="r"))
        wide = extent > _FLAT
        trend = about @ (directions[wide].T / extent[wide])
        del about  # (n, k) numbers
        # tr G: the variance of each point in a list of s is s/(s - 1) (1 - 1/s) = 1
        spread = float(sizes[sizes > 1].sum())
        # tr G - tr(R G), list by list; within a list of s points G is s/(s - 1) (identity - 1/s)
        by_group = np.zeros(len(sizes))
        for size, same in same_sizes(groups):
            part = trend[same]
            squares = np.square(part - part.mean(axis=1, keepdims=True)).reshape(len(part), -1)
            by_group[sizes == size] = size / (size - 1) * squares.sum(axis=1)
        lost = sum(map(float, by_group[sizes > 1]))  # in this order: the bits depend on it
        return cls(trend, math.sqrt(spread / (spread - lost)))

    def along(self, counts: FloatArray, places: IntArray) -> FloatArray:
        """The part of e along the trend, (m, r): a sum over points, to which each part of the
        points adds its terms.

        counts: of p points in each replicate, (m, p).
        places: indices of these points, (p,).
        """
        return (counts - 1.0) @ self.trend[places]

    def balanced(self, counts: FloatArray, places: IntArray, along: FloatArray) -> FloatArray:
        """Balanced counts of some points, (m, p).

        counts, places: as in `along`.
        along: sum of `Balance.along` over all points, (m, r).
        """
        errors = counts - 1.0
        errors -= along @ self.trend[places].T
        errors *= self.scale
        errors += 1.0
        return np.maximum(errors, 0.0, out=errors)


class Resampled(NamedTuple):
    """Number of times that p of the points occur in each of m replicates.

    places: indices of the points, (p,).
    counts: (m, p), balanced if the sample is to be balanced.
    drawn: counts before balancing, (m, p).
    """

    places: IntArray
    counts: FloatArray
    drawn: FloatArray


def resamples(
    groups: Strata,
    replicates: int,
    seed: int,
    name: Sequence[str],
    *,
    done: Callable[[int, int], None] = lambda points, of: None,
) -> Iterator[Resampled]:
    """Replicates of all points, some points at a time. Each point is in one part.

    groups: lists of points that may replace each other.
    replicates: m.
    seed, name: of the random stream.
    done: receives the number of points drawn so far, and the number of points to draw. A balanced
        sample is drawn twice: first for `along`, the sum over all points that balancing needs.
    """
    most = AT_ONCE // replicates  # points at a time
    if groups.points > most:
        most = max(most // SPLIT, 1)
    draws = partial(_draws, groups, most, replicates, seed, name)
    balance = None if groups.even is None else Balance.of(groups, groups.even)
    along: Any = 0.0  # becomes the sum over all points
    number = 0  # points drawn so far
    to_draw = groups.points * (1 if balance is None else 2)
    if balance is not None:
        for places, counts in draws():
            along += balance.along(counts, places)
            number += len(places)
            done(number, to_draw)
    for places, counts in draws():
        number += len(places)
        done(number, to_draw)
        balanced = counts if balance is None else balance.balanced(counts, places, along)
        yield Resampled(places, balanced, counts)


def _draws(
    lists: Strata, most: int, replicates: int, seed: int, name: Sequence[str]
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Blocks of p points, with their counts in each replicate, (m, p), the same at each call.

    most: points of a block of whole lists. A list with more points is divided into several blocks.
    """
    first = 0  # index in `lists.order` of the next point
    number = 0  # of the next block
    ends = lists.ends
    # most points of a piece of a divided list; with shorter pieces the table `shares` would be
    # larger
    longest = max(AT_ONCE // replicates, 1)

    def stream() -> Generator:
        """The random stream of the next block."""
        return random_stream(seed, *name, *([number] if number else []))

    while first < len(lists.order):
        # whole lists from `first` on, as many as one block holds; last: first list after them
        last = int(np.searchsorted(ends, first + most, side="right"))
        if (end := int(ends[last - 1]) if last else 0) > first:
            list_ends = ends[int(np.searchsorted(ends, first, side="right")) : last] - first
            groups = Strata(np.arange(end - first), list_ends)
            yield lists.order[first:end], draw_counts(groups, replicates, stream())
            number, first = number + 1, end
            continue
        # The next list alone is too long for a block. Its draws are first shared among pieces at
        # random, then drawn within each piece.
        size = int(ends[last]) - first
        pieces = np.array_split(lists.order[first : first + size], -(-size // longest))
        parts = np.array([len(places) for places in pieces]) / size
        shares = random_stream(seed, *name, "pieces", number).multinomial(
            size - 1, parts, replicates
        )
        for places, share in zip(pieces, shares.T, strict=True):  # share: of the draws, (m,)
            counts = stream().multinomial(share, np.full(len(places), 1.0 / len(places)))
            yield places, np.asarray(counts * (size / (size - 1)))
            number += 1
        first += size
