"""Combination testing: few points of a grid that still hold every possible combination of values
of any `strength` parameters. The methods `pairwise` and `combinations` of `sampling`.

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
"""Points of a grid (n, k), as the number of the value on each axis."""
Numbers = IntArray
"""Numbers (n,) of points in a grid, the first axis slowest."""


def combinations(logical: LogicalScenario, request: Request) -> Drawn:
    """Few points with every possible combination of values of any `strength` parameters, by
    default 2, as in the method `pairwise`.

    These are a covering array, and further points with the combinations that constraints take out
    of it though a possible point has them. `sample` removes the excluded points.
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
    levels = np.indices(sizes).reshape(len(sizes), -1).T
    feasible = logical.feasible(grid)
    if strength == 1:  # as many points as the longest axis has values
        rows = [[number % size for size in sizes] for number in range(max(sizes))]
    else:
        values = [list(range(size)) for size in sizes]
        rows = list(covertable.make(values, strength=strength, salt=str(request.seed)))
    # the array's points, as numbers in the grid
    chosen = np.ravel_multi_index(tuple(np.array(rows, np.intp).T), tuple(sizes))
    codes = tuples_of(levels, sizes, strength)
    added = _complete(chosen[feasible[chosen]], np.flatnonzero(feasible), codes)
    numbers = np.union1d(chosen, added)
    total = sum(map(math.prod, itertools.combinations(sizes, strength)))
    held = np.count_nonzero(np.bincount(codes[:, feasible].ravel()))
    if held < total:
        what = "pairs" if strength == 2 else f"combinations of {strength}"
        notes += (
            f"{total - held} of {total} {what} of values exist in no possible point; the other "
            f"{held} are held.",
        )
    return Drawn(grid[numbers], notes=notes)


def tuples_of(levels: Levels, sizes: Sequence[int], strength: int) -> IntArray:
    """The combinations that points hold, (c, n): for each choice of `strength` axes, the number of
    each point's combination of values on these axes. No two combinations share a number.
    """
    codes = []
    first = 0
    for axes in itertools.combinations(range(len(sizes)), strength):
        counts = tuple(sizes[axis] for axis in axes)
        codes.append(first + np.ravel_multi_index(tuple(levels[:, axes].T), counts))
        first += math.prod(counts)
    return np.array(codes)


def _complete(have: Numbers, candidates: Numbers, codes: IntArray) -> Numbers:
    """Numbers of further points, so that every combination of a possible point is held.

    have: numbers of the possible points that are chosen already.
    candidates: numbers of all possible points, rising.
    codes: `tuples_of` the full grid.

    Greedy: each round takes the point that holds most missing combinations, the first of equals.
    """
    codes = codes[:, candidates]
    missing = np.zeros(codes.max(initial=0) + 1, bool)  # by number of the combination
    missing[codes] = True
    missing[codes[:, np.searchsorted(candidates, have)]] = False
    added = []
    while missing.any():
        best = np.argmax(missing[codes].sum(axis=0))
        added.append(candidates[best])
        missing[codes[:, best]] = False
    return np.array(added, np.intp)
