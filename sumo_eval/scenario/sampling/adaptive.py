"""Points in rounds: each round samples more from cells of the space where earlier results differed
most.

The candidates, an even sample of the possible points, are halved repeatedly across the widest
side, down to cells that hold equally many of them. A cell's candidates stand in an order drawn
once, and the next n points of that cell are the next n in this order. So a table of the points that
each round takes from each cell determines all points.

A point of round k in cell h stands for m_k V_h / n_kh points of an even sample: the round has m_k
points, n_kh of them in the cell, whose share of the space is V_h. Every round draws from every
cell, their numbers are fixed before any of them is evaluated, and the weight of a round, m_k, does
not depend on results. So the weighted mean of anything over one round has the space's mean as its
expectation, whatever the earlier rounds found, and so has that of all rounds. (Weights V_h / n_h of
a cell's points from all rounds would not: a cell that shows a collision early gets more points,
so that collision weighs less, and a cell that shows none by luck keeps showing none.)

Users: `record/facts.py`, `scenario/sampling/samples.py`, `scoring/confidence/next_round.py`.
"""

import math
from collections.abc import Iterator
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
    """The points of all rounds in `request.rounds`; without any, those of the first round, evenly
    over the cells.

    `request.count`: points of all rounds together, at most. `request.round`: of one.
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
    # Points of each round in each cell. The first round needs no limit of room: `_SPARE` candidates
    # for each point leave enough.
    counts = request.rounds or (
        spread(size_of_next(budget, size, 0), np.ones(len(cells)), np.full(len(cells), np.inf)),
    )
    for row in counts:
        if len(row) != len(cells) or min(row) < LEAST_IN_CELL:
            must = f"rows of {len(cells)} numbers, at least {LEAST_IN_CELL} each"
            raise must_be("`rounds`", owner, must, list(row))
    taken = np.array(counts)
    if taken.sum() > budget:
        must = f"at least the {taken.sum()} points that its rounds have"
        raise must_be("`count`", owner, must, budget)
    ends = taken.cumsum(axis=0)
    if (full := ends[-1] > capacity).any():
        must = f"at most {capacity[full][0]:g} points of a cell together"
        raise must_be("`rounds`", owner, must, int(ends[-1][full][0]))
    # round by round, the next candidates of each cell
    chosen = [
        cells[cell][end - count : end]
        for row, cell_ends in zip(taken, ends, strict=True)
        for cell, (count, end) in enumerate(zip(row, cell_ends, strict=True))
    ]
    points = possible[np.concatenate(chosen)]
    # m_k V_h / n_kh, (rounds, H), then for each point
    weight = taken.sum(axis=1, keepdims=True) * capacity / float(len(possible)) / taken
    weights = np.repeat(weight, taken.ravel())
    exposure = logical.exposures(points) * weights
    return Drawn(
        points,
        exposure,
        stands_for=weights,
        # one for each cell of each round
        stratum=np.repeat(np.arange(taken.size, dtype=np.intp), taken.ravel()),
    )


def size_of_round(budget: int, size: int | None, owner: str) -> int:
    """Number of points of a round: as asked for, or a fifth of all.

    Refuses a budget or a size that makes no rounds.
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
    # the power of 2 at or below size // (2 * LEAST_IN_CELL)
    return min(1 << (max(size // (2 * LEAST_IN_CELL), 1).bit_length() - 1), MOST_CELLS)


def size_of_next(budget: int, size: int, done: int) -> int:
    """Number of points of the next round after `done` points; the last round takes a rest that is
    too small for another.
    """
    left = budget - done
    if left >= 2 * size:
        return size
    return left if left >= LEAST_IN_CELL * cells_of_round(size) else 0


def spread(points: int, attention: FloatArray, room: FloatArray) -> tuple[int, ...]:
    """Points of each cell, (H,), `points` in all: in proportion to `attention`, but at least
    `LEAST_IN_CELL`.

    attention: V_h s_h, a cell's share of the space times the deviation within it, (H,). With n
        points the cell's part of the variance is (V_h s_h)^2 / n, and one more point reduces it by
        (V_h s_h)^2 / (n (n + 1)). Each point goes where it reduces most (Wright 2012: Neyman's
        allocation in whole numbers).
    room: number of points that a cell can give, (H,).
    """
    largest = attention.max()
    # rounded, so that the last bit does not decide between cells
    wanted = np.round(attention / largest, 9) if largest > 0.0 else np.ones_like(attention)
    counts = np.full(len(attention), LEAST_IN_CELL)
    for _ in range(points - len(counts) * LEAST_IN_CELL):
        # root of the reduction that one more point gives; below 0 where there is no room for it
        gains = np.where(counts < room, wanted / np.sqrt(counts * (counts + 1)), -1.0)
        # of equal ones the cell with the fewest points, then the first
        cell = np.lexsort((counts, -gains))[0]
        if gains[cell] < 0.0:
            break
        counts[cell] += 1
    return tuple(counts.tolist())


def capacity_of_cells(logical: LogicalScenario, size: int, seed: int) -> FloatArray:
    """Number of candidates in each cell of the space for rounds of this size, (H,)."""
    return np.array([len(cell) for cell in _cells(logical, size, seed)[1]], float)


@lru_cache(maxsize=2)  # asked for by every stage of a round
def _cells(
    logical: LogicalScenario, size: int, seed: int
) -> tuple[FloatArray, tuple[IntArray, ...]]:
    """The possible candidates (n, k), and which of them each cell holds, in the order in which they
    are taken.
    """
    wanted = 2 ** math.ceil(math.log2(_CANDIDATES * size))
    count = min(max(wanted, _LEAST_CANDIDATES), _MOST_CANDIDATES)
    candidates = evenly(logical, count, random_stream(seed, "sampling", logical.name, "adaptive"))
    possible = candidates[logical.feasible(candidates)]
    order = random_stream(seed, "sampling", logical.name, "adaptive", "order")
    halves = _halved(np.arange(len(possible)), logical.to_unit(possible), cells_of_round(size))
    return possible, tuple(order.permutation(cell) for cell in halves)


def _halved(rows: IntArray, unit: FloatArray, parts: int) -> Iterator[IntArray]:
    """The rows in `parts` equal parts, by halving across the widest side of the unit box."""
    if parts == 1 or len(rows) < 2:
        yield rows
        return
    # rounded: of sides that are nearly as wide, the first is taken
    axis = int(np.argmax(np.round(np.ptp(unit[rows], axis=0), 3)))
    order = rows[np.argsort(unit[rows, axis], kind="stable")]
    yield from _halved(order[: len(rows) // 2], unit, parts // 2)
    yield from _halved(order[len(rows) // 2 :], unit, parts // 2)
