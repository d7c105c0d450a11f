"""Points in rounds: each round samples more from cells of the space where earlier results differed
most. The method `adaptive` of `sampling`.

Cells: the candidates, an even sample of the possible points, are halved repeatedly across the
widest side of the space, down to cells that hold equally many candidates. Within a cell the
candidates have an order that is drawn once, and every round takes the next ones of this order. So
the numbers of points that each round takes from each cell determine all points.

Weights: a point of round k in cell h stands for m_k V_h / n_kh points of an even sample. The round
has m_k points, n_kh of them in the cell; V_h is the cell's share of the space. Every round draws
from every cell. The numbers n_kh are fixed before any point of the round is evaluated, and m_k does
not depend on results. So the weighted mean of anything over one round has the mean over the space
as its expectation, whatever the results of earlier rounds, and so has the mean over all rounds.

Why not V_h / n_h, with all points of a cell together: a cell that shows a collision early gets more
points, so that the collision weighs less, and a cell that by chance shows none gets no more points
to correct that.

Users: `record/facts.py`, `scenario/sampling/samples.py`, `scoring/confidence/next_round.py`.
"""

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.scenario.sampling.request import Drawn, Request, owner_of
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray, IntArray

LEAST_IN_CELL = 2
"""Points of a round in a cell, at least: one point alone shows no deviation."""

SMALLEST_ROUND = 8  # points
MOST_CELLS = 512
DEFAULT_ROUNDS, MOST_ROUNDS = 5, 16  # rounds of one sample
_CANDIDATES = 64  # for each point of a round
_LEAST_CANDIDATES, _MOST_CANDIDATES = 2**12, 2**21
_SPARE = 2  # possible candidates for each point of the budget, at least


def adaptive(logical: LogicalScenario, request: Request) -> Drawn:
    """The points of all rounds so far; without `request.rounds` those of a first round, evenly over
    the cells.

    request.count: number of points of all rounds together, at most.
    request.round: number of points of one round.
    request.rounds: number of points of each round in each cell, (rounds, H).
    """
    owner = owner_of(logical)
    budget = request.wanted(logical)
    size = size_of_round(budget, request.round, owner)
    possible, cells = _cells(logical, size, request.seed)
    if len(possible) < _SPARE * budget:
        raise InputError(
            f"`count` of {owner} must be at most {len(possible) // _SPARE} in rounds of {size} "
            f"points, got {budget}: "
            f"{len(possible)} of its candidates are possible. Larger rounds have more candidates."
        )
    capacity = capacity_of_cells(logical, size, request.seed)
    # The first round is spread without a limit of room (inf): `_SPARE` candidates for each point
    # leave enough.
    rounds = request.rounds or (
        spread(size_of_next(budget, size, 0), np.ones(len(cells)), np.full(len(cells), np.inf)),
    )
    counts = _checked_counts(rounds, capacity, budget, owner)
    # Number of points of each cell up to each round: a round takes those from the end of the round
    # before to its own.
    ends = counts.cumsum(axis=0)
    begins = ends - counts
    chosen = [
        cells[cell][begins[row, cell] : ends[row, cell]] for row, cell in np.ndindex(counts.shape)
    ]
    points = possible[np.concatenate(chosen)]
    # m_k V_h / n_kh, (rounds, H), then for each point
    of_cells = counts.sum(axis=1, keepdims=True) * capacity / float(len(possible)) / counts
    weights = np.repeat(of_cells, counts.ravel())
    exposure = logical.exposures(points) * weights
    return Drawn(
        points,
        exposure,
        stands_for=weights,
        # one for each cell of each round
        stratum=np.repeat(np.arange(counts.size, dtype=np.intp), counts.ravel()),
    )


def _checked_counts(
    rounds: Sequence[Sequence[int]], capacity: FloatArray, budget: int, owner: str
) -> IntArray:
    """Number of points of each round in each cell, (rounds, H).

    capacity: number of candidates in each cell, (H,).
    budget: number of points of all rounds together, at most.
    """
    for row in rounds:
        if len(row) != len(capacity) or min(row) < LEAST_IN_CELL:
            must = f"rows of {len(capacity)} numbers, at least {LEAST_IN_CELL} each"
            raise must_be("`rounds`", owner, must, list(row))
    counts = np.array(rounds)
    if counts.sum() > budget:
        must = f"at least the {counts.sum()} points that its rounds have"
        raise must_be("`count`", owner, must, budget)
    of_cells = counts.sum(axis=0)
    if (full := of_cells > capacity).any():
        must = f"at most {capacity[full][0]:g} points of a cell together"
        raise must_be("`rounds`", owner, must, int(of_cells[full][0]))
    return counts


def size_of_round(budget: int, size: int | None, owner: str) -> int:
    """Number of points of a round: `size`, or without one (None) a fifth of the budget, but at
    least `SMALLEST_ROUND`.

    Raises InputError for a budget or a size that makes no rounds.
    """
    if budget < SMALLEST_ROUND:
        raise must_be("`count`", owner, f"at least {SMALLEST_ROUND} points", budget)
    if size is None:
        return max(budget // DEFAULT_ROUNDS, SMALLEST_ROUND)
    least = max(SMALLEST_ROUND, math.ceil(budget / MOST_ROUNDS))
    if not least <= size <= budget:
        must = f"from {least} to `count`, {budget}: at most {MOST_ROUNDS} rounds"
        raise must_be("`round`", owner, must, size)
    return size


def cells_of_round(size: int) -> int:
    """Number of cells of the space for rounds of this size: the largest power of 2 with which
    `LEAST_IN_CELL` points in every cell take at most half of a round.
    """
    most = max(size // (2 * LEAST_IN_CELL), 1)
    # 1 << (bit length - 1): the largest power of 2 at or below a number
    return min(1 << (most.bit_length() - 1), MOST_CELLS)


def size_of_next(budget: int, size: int, done: int) -> int:
    """Number of points of the next round after `done` points; 0: there is no further round.

    A rest of less than two rounds is one round, as long as it is enough for every cell.
    """
    rest = budget - done
    if rest >= 2 * size:
        return size
    return rest if rest >= LEAST_IN_CELL * cells_of_round(size) else 0


def spread(points: int, attention: FloatArray, room: FloatArray) -> tuple[int, ...]:
    """Number of points of each of H cells, `points` in all: in proportion to `attention`, but at
    least `LEAST_IN_CELL`.

    attention: V_h s_h, a cell's share of the space times the deviation within it, (H,).
    room: number of points that a cell can give, (H,).

    With n points a cell's part of the variance is (V_h s_h)^2 / n, and one more point reduces it by
    (V_h s_h)^2 / (n (n + 1)). Each point goes where it reduces most (Wright 2012: Neyman's
    allocation in whole numbers).
    """
    largest = attention.max()
    # rounded, so that the last bit does not decide between cells
    wanted = np.round(attention / largest, 9) if largest > 0.0 else np.ones_like(attention)
    counts = np.full(len(attention), LEAST_IN_CELL)
    for _ in range(points - len(counts) * LEAST_IN_CELL):
        # root of the reduction that one more point gives; -1 where there is no room for it
        gains = np.where(counts < room, wanted / np.sqrt(counts * (counts + 1)), -1.0)
        # the largest gain (the last key sorts first); of equal ones the fewest points, then the
        # first cell
        cell = np.lexsort((counts, -gains))[0]
        if gains[cell] < 0.0:
            break
        counts[cell] += 1
    return tuple(counts.tolist())


def capacity_of_cells(logical: LogicalScenario, size: int, seed: int) -> FloatArray:
    """Number of candidates in each cell of the space for rounds of this size, (H,)."""
    _, cells = _cells(logical, size, seed)
    return np.array([len(cell) for cell in cells], float)


@lru_cache(maxsize=2)  # every stage of a round calls this
def _cells(
    logical: LogicalScenario, size: int, seed: int
) -> tuple[FloatArray, tuple[IntArray, ...]]:
    """The possible candidates (n, k), and for each cell the numbers of its candidates, in the order
    in which they are taken.
    """
    wanted = 2 ** math.ceil(math.log2(_CANDIDATES * size))
    count = min(max(wanted, _LEAST_CANDIDATES), _MOST_CANDIDATES)
    candidates = evenly(logical, count, random_stream(seed, "sampling", logical.name, "adaptive"))
    possible = candidates[logical.feasible(candidates)]
    order = random_stream(seed, "sampling", logical.name, "adaptive", "order")
    halves = _halved(np.arange(len(possible)), logical.to_unit(possible), cells_of_round(size))
    return possible, tuple(order.permutation(cell) for cell in halves)


def _halved(rows: IntArray, unit: FloatArray, parts: int) -> Iterator[IntArray]:
    """The rows in `parts` equal parts, by halving across the side along which they reach furthest.

    rows: numbers of points, (n,). unit: all points in the unit box. parts: a power of 2.
    """
    if parts == 1 or len(rows) < 2:
        yield rows
        return
    # rounded, so that of nearly equal sides the first is taken on every machine
    axis = int(np.argmax(np.round(np.ptp(unit[rows], axis=0), 3)))
    order = rows[np.argsort(unit[rows, axis], kind="stable")]
    yield from _halved(order[: len(rows) // 2], unit, parts // 2)
    yield from _halved(order[len(rows) // 2 :], unit, parts // 2)
