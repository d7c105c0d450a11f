"""Combination testing: few points of a grid that together hold every possible combination of values
of any `strength` parameters. The methods `pairwise` and `combinations` of `sampling`.

Three kinds of numbers: a level is the number of a value on its axis; a point has a number in the
grid; a combination (of levels on some axes) has a number among all combinations.

Users: `scenario/sampling/samples.py`.
"""

import itertools
import math
from collections.abc import Sequence

import covertable  # type: ignore[import-untyped]
import numpy as np

from sumo_eval.errors import must_be
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.grid import grid_axes, mesh
from sumo_eval.scenario.sampling.request import Drawn, Request, owner_of
from sumo_eval.trajectory import IntArray

Levels = IntArray
"""Points of a grid as levels, (n, k)."""
Numbers = IntArray
"""Numbers (n,) of points in a grid, the first axis slowest."""


def combinations(logical: LogicalScenario, request: Request) -> Drawn:
    """Few points with every possible combination of values of any `strength` parameters, by
    default 2, as in the method `pairwise`.

    These are the points of a covering array, and further points for the combinations that only its
    impossible points have, where a possible point of the grid has them. `sample` later removes the
    impossible points.
    """
    most = len(logical.parameters)
    strength = min(2, most) if request.strength is None else request.strength
    if not 1 <= strength <= most:
        raise must_be(
            "`strength`", owner_of(logical), f"within 1..{most}, its parameters", strength
        )
    axes, notes = grid_axes(logical, request)
    sizes = [len(axis) for axis in axes]
    grid = mesh(axes)
    feasible = logical.feasible(grid)
    chosen = _covering_array(sizes, strength, request.seed)
    levels = np.indices(sizes).reshape(len(sizes), -1).T  # of all points of the grid
    held = combination_numbers(levels, sizes, strength)
    added = _complete(chosen[feasible[chosen]], np.flatnonzero(feasible), held)
    total = sum(map(math.prod, itertools.combinations(sizes, strength)))
    possible = np.count_nonzero(np.bincount(held[:, feasible].ravel()))
    if possible < total:
        what = "pairs of" if strength == 2 else f"combinations of {strength}"
        notes += (
            f"{total - possible} of {total} {what} values exist in no possible point; the other "
            f"{possible} are held.",
        )
    return Drawn(grid[np.union1d(chosen, added)], notes=notes)


def _covering_array(sizes: Sequence[int], strength: int, seed: int) -> Numbers:
    """Points of a grid that hold every combination of any `strength` axes, constraints aside.

    sizes: number of values on each axis.
    """
    if strength == 1:  # as many points as the longest axis has values
        rows = [[number % size for size in sizes] for number in range(max(sizes))]
    else:
        values = [list(range(size)) for size in sizes]
        rows = list(covertable.make(values, strength=strength, salt=str(seed)))
    return np.asarray(np.ravel_multi_index(tuple(np.array(rows, np.intp).T), tuple(sizes)))


def combination_numbers(levels: Levels, sizes: Sequence[int], strength: int) -> IntArray:
    """The combinations that n points hold, (c, n): for each of c choices of `strength` axes the
    number of each point's combination on these axes. No two combinations share a number.

    sizes: number of values on each axis.
    """
    numbers = []
    first = 0  # number of the first combination on these axes
    for axes in itertools.combinations(range(len(sizes)), strength):
        counts = tuple(sizes[axis] for axis in axes)
        numbers.append(first + np.ravel_multi_index(tuple(levels[:, axes].T), counts))
        first += math.prod(counts)
    return np.array(numbers)


def _complete(have: Numbers, candidates: Numbers, held: IntArray) -> Numbers:
    """Numbers of further points to choose, so that every combination of a possible point is held.

    have: the possible points that are chosen already.
    candidates: all possible points, rising.
    held: `combination_numbers` of the full grid.

    Greedy: each round takes the point that holds most missing combinations, the first of equals.
    """
    held = held[:, candidates]
    missing = np.zeros(held.max(initial=0) + 1, bool)  # by number of the combination: not held
    missing[held] = True
    missing[held[:, np.searchsorted(candidates, have)]] = False
    added = []
    while missing.any():
        best = np.argmax(missing[held].sum(axis=0))
        added.append(candidates[best])
        missing[held[:, best]] = False
    return np.array(added, np.intp)
