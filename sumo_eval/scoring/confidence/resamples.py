"""Number of times that each point of a scenario occurs in each replicate of a bootstrap over the
points.

Points that may stand for each other are a list (`Strata`), and each replicate draws from every list
as many points as it has. Points of a method that leaves no part of the space out are balanced over
it as well (`Balance`).

All replicates of some points are drawn before those of the next ones (`Resamples`): what a
replicate costs a point is the same among a thousand points and among a million, and no table of all
points is ever there.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sumo_eval.cases import IntArray
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

# points in replicates that are held at a time: 16 MB a table, and 1,000 points with 2,000
AT_ONCE = 2_000_000
OF_MORE = 8  # of more points such a part of it: 2 MB a table
# ways of sampling that leave no part of the space out
EVEN = frozenset({"grid", "sobol", "halton"})
SMALLEST = 4  # points that are split in halves
_FLAT = 1e-9  # of the box: points that differ by less along a direction have no trend there


@dataclass(frozen=True, slots=True, eq=False)
class Strata:
    """Points that a replicate exchanges for each other, by their places: lists that lie one behind
    the other.

    order: all places, (n,).
    ends: where each list ends in it, (g,).
    even: the points in the unit box, (n, k), where they are balanced over it.
    """

    order: IntArray
    ends: IntArray
    even: FloatArray | None = None

    @property
    def sizes(self) -> IntArray:
        """Number of points of each list, (g,)."""
        return np.diff(self.ends, prepend=0)

    def of_size(self, size: int) -> IntArray:
        """The lists of one size, (k, size), in their order."""
        sizes = self.sizes
        places: IntArray = self.order[(self.ends - sizes)[sizes == size][:, None] + np.arange(size)]
        return places

    def numbers(self) -> IntArray:
        """The number of the list that each place stands in, (n,)."""
        found = np.empty(self.points, dtype=np.intp)
        found[self.order] = np.repeat(np.arange(len(self.ends)), self.sizes)
        return found

    @property
    def points(self) -> int:
        """Number of points of all lists."""
        return len(self.order)


def strata(unit: FloatArray, method: str) -> Strata:
    """Points that a replicate exchanges for each other: lists of their places in `unit`, (n, k) in
    the unit box.

    Points of a method that leaves no part of the space out (`EVEN`) are halved again and again,
    across the widest side, down to neighbours of two or three: only these may stand for each other.
    Points of all other methods are one list.
    """
    order, sizes = np.arange(len(unit)), np.array([len(unit)])
    while method in EVEN and (split := sizes >= SMALLEST).any():
        _sort_along_widest(order, sizes, unit)
        half = np.where(split, sizes // 2, sizes)
        sizes = np.column_stack([half, sizes - half])[np.column_stack([np.ones_like(split), split])]
    return Strata(order, np.cumsum(sizes), unit if method in EVEN else None)


def of_one_number(stratum: IntArray) -> Strata:
    """The places of each number in `stratum`, (n,), in the order of the numbers."""
    order = np.argsort(stratum, kind="stable")
    return Strata(order, np.append(np.flatnonzero(np.diff(stratum[order])) + 1, len(order)))


def one_list(points: int) -> Strata:
    """So many points, all of which may stand for each other."""
    return Strata(np.arange(points), np.array([points]))


def _sort_along_widest(order: IntArray, sizes: IntArray, unit: FloatArray) -> None:
    """Put the places of each list that will be halved in their order across its widest side.

    order: list behind list.

    Lists of one size are sorted together: a million points have half a million lists.
    """
    firsts = np.cumsum(sizes) - sizes
    for size in np.unique(sizes[sizes >= SMALLEST]).tolist():
        here = firsts[sizes == size][:, None] + np.arange(size)
        rows = order[here]
        points = unit[rows]
        axis = np.argmax(np.ptp(points, axis=1), axis=1)
        along = np.take_along_axis(points, axis[:, None, None], axis=2)[:, :, 0]
        order[here] = np.take_along_axis(rows, np.argsort(along, axis=1, kind="stable"), axis=1)


def same_sizes(groups: Strata) -> list[tuple[int, IntArray]]:
    """Groups of more than one point by their size: (size, places (g, size))."""
    return [(size, groups.of_size(size)) for size in np.unique(groups.sizes).tolist() if size > 1]


def draw_counts(groups: Strata, replicates: int, stream: np.random.Generator) -> FloatArray:
    """Number of times that each point occurs in each replicate, (m, n).

    From each group of s points s - 1 are drawn with replacement and count s/(s - 1) times (Rao and
    Wu 1988): so the variance of a mean is right for groups of two as well. A group of one stands in
    every replicate.
    """
    counts = np.ones((replicates, groups.points))
    for size, same in same_sizes(groups):
        drawn = _multinomial(size, (replicates, len(same)), stream) * (size / (size - 1))
        counts[:, same.ravel()] = drawn.reshape(replicates, -1)
    return counts


def _multinomial(
    size: int, shape: tuple[int, int], stream: np.random.Generator
) -> IntArray | FloatArray:
    """Number of times that each of `size` occurs among size - 1 draws, (*shape, size), by the
    stream's own multinomial numbers.

    Of two they are one number each, above a half or not, which takes a sixth of the time.
    """
    if size != 2:
        return stream.multinomial(size - 1, np.full(size, 1.0 / size), shape)
    drawn = np.empty((*shape, 2))
    drawn[..., 0] = stream.random(shape) > 0.5
    np.subtract(1.0, drawn[..., 0], out=drawn[..., 1])
    return drawn


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """Replicates whose points have the mean place that all points have, not below 0.

    Drawn counts are c = 1 + e. With R the projection on what is orthogonal to 1 and to the k
    coordinates of the points, and G the covariance of e: c' = 1 + sqrt(tr G / tr(R G)) R e. So the
    variance of a mean is that of the residuals of its terms from their linear trend, scaled so that
    terms without a trend keep theirs (balanced sampling: Deville and Tille 2005).

    trend: what R takes away, (n, r), orthonormal.
    scale: of what is left.
    """

    trend: FloatArray
    scale: float

    @classmethod
    def of(cls, groups: Strata, unit: FloatArray) -> Balance | None:
        """Balance of groups of points, (n, k) in the unit box; None with fewer than 2 k degrees of
        freedom in the groups, where a trend cannot be told from chance.
        """
        n, k = unit.shape
        sizes = groups.sizes
        if n - len(sizes) < 2 * k:
            return None
        # 1 is orthogonal to every draw: each group has as many points as it has
        about = unit - unit.mean(axis=0)
        # of `about` itself: thrice the room
        _, extent, directions = np.linalg.svd(np.linalg.qr(about, mode="r"))
        there = extent > _FLAT
        trend = about @ (directions[there].T / extent[there])
        del about
        spread = float(sizes[sizes > 1].sum())  # of a group of s: G = s/(s - 1) (1 - 1/s)
        by_group = np.zeros(len(sizes))
        for size, same in same_sizes(groups):
            part = trend[same]
            squares = np.square(part - part.mean(axis=1, keepdims=True)).reshape(len(part), -1)
            by_group[sizes == size] = size / (size - 1) * squares.sum(axis=1)
        lost = sum(map(float, by_group[sizes > 1]))
        return cls(trend, math.sqrt(spread / (spread - lost)))

    def along(self, counts: FloatArray, places: IntArray) -> FloatArray:
        """The part of e that lies along the trend, (m, r); that of all points is the sum over any
        parts of them.

        counts: (m, k), of the points at these places.
        """
        return (counts - 1.0) @ self.trend[places]

    def balanced(self, counts: FloatArray, places: IntArray, along: FloatArray) -> FloatArray:
        """The counts of these points, (m, k), balanced.

        along: of all points.
        """
        errors = counts - 1.0
        errors -= along @ self.trend[places].T
        errors *= self.scale
        errors += 1.0
        return np.maximum(errors, 0.0, out=errors)


@dataclass(frozen=True, slots=True, eq=False)
class Resampled:
    """Number of times that some of the points occur in each replicate.

    places: which points, (k,).
    counts: balanced, where the sample is;
    drawn: as drawn, both (m, k).
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
    """All points, some at a time: each stands in one part.

    groups: lists of points that stand for each other.
    name: of the random stream.
    done: told how many points have been drawn, and of how many; those of a balanced sample are
        drawn twice, because what balances them depends on all of them.
    """
    most = AT_ONCE // replicates
    most = most if groups.points <= most else max(most // OF_MORE, 1)
    blocks = list(_blocks(groups, most, replicates, seed, name))
    balance = None if groups.even is None else Balance.of(groups, groups.even)
    twice = balance is not None and len(blocks) > 1
    progress = itertools.accumulate(len(places) for places, _ in blocks * (1 + twice))

    def tell() -> None:
        done(next(progress), (1 + twice) * groups.points)

    if balance is None:
        for places, draw in blocks:
            counts = draw()
            tell()
            yield Resampled(places, counts, counts)
        return
    along = np.zeros((replicates, balance.trend.shape[1]))
    for places, draw in blocks:
        counts = draw()
        along += balance.along(counts, places)
        tell()
    for places, draw in blocks:
        if twice:
            counts = draw()
            tell()
        yield Resampled(places, balance.balanced(counts, places, along), counts)


def _blocks(
    lists: Strata, most: int, replicates: int, seed: int, name: Sequence[str]
) -> Iterator[tuple[IntArray, Callable[[], FloatArray]]]:
    """Points that are drawn together, list by list, at most n, a longer list in pieces; and what
    draws how often each stands in each replicate, (m, k), the same each time.
    """
    first, number, ends = 0, 0, lists.ends
    # of a piece: each holds a number for every replicate until all are drawn
    longest = max(AT_ONCE // replicates, 1)

    def drawn(
        number: int, draw: Callable[..., FloatArray], *given: Any
    ) -> Callable[[], FloatArray]:
        return lambda: draw(*given, random_stream(seed, *name, *([number] if number else [])))

    while first < len(lists.order):
        last = int(np.searchsorted(ends, first + most, side="right"))  # lists that end within reach
        if (end := int(ends[last - 1]) if last else 0) > first:
            here = ends[int(np.searchsorted(ends, first, side="right")) : last] - first
            groups = Strata(np.arange(end - first), here)
            yield lists.order[first:end], drawn(number, draw_counts, groups, replicates)
            number, first = number + 1, end
            continue
        size = int(ends[last]) - first
        pieces = np.array_split(lists.order[first : first + size], -(-size // longest))
        parts = np.array([len(places) for places in pieces]) / size
        shares = random_stream(seed, *name, "pieces", number).multinomial(
            size - 1, parts, replicates
        )
        for places, share in zip(pieces, shares.T, strict=True):
            yield places, drawn(number, _counts_of_piece, len(places), size, share)
            number += 1
        first += size


def _counts_of_piece(
    points: int, size: int, share: IntArray, stream: np.random.Generator
) -> FloatArray:
    """`draw_counts` of some points of a list of this size.

    share: how many of its draws fall on them, (m,).
    """
    drawn = stream.multinomial(share, np.full(points, 1.0 / points))
    return np.asarray(drawn * (size / (size - 1)))
