"""Combination testing: few points of a grid that still hold every possible combination of t
parameters' values.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import covertable  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from sumo_eval.errors import must_be
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.grid import grid_axes, mesh
from sumo_eval.scenario.sampling.request import Drawn, Request, owner_of
from sumo_eval.trajectory import BoolArray

Levels = NDArray[np.intp]
"""Points of a grid (n, k), as the number of the value on each axis."""


def pairwise(logical: LogicalScenario, request: Request) -> Drawn:
    """Every possible pair of values of two parameters, in few points."""
    return _covering(logical, request, 2)


def combinations(logical: LogicalScenario, request: Request) -> Drawn:
    """Every possible combination of values of `strength` parameters, in few points."""
    most, strength = len(logical.parameters), 2 if request.strength is None else request.strength
    if not 1 <= strength <= most:
        raise must_be(
            "`strength`", owner_of(logical), f"within 1..{most}, its parameters", strength
        )
    return _covering(logical, request, strength)


def tuples_of(levels: Levels, sizes: Sequence[int], strength: int) -> list[NDArray[np.intp]]:
    """The combinations that points hold: one array of codes (n,) for each choice of `strength`
    axes.
    """
    found = []
    for axes in itertools.combinations(range(len(sizes)), strength):
        code = np.zeros(len(levels), dtype=np.intp)
        for axis in axes:
            code = code * sizes[axis] + levels[:, axis]
        found.append(code)
    return found


def _covering(logical: LogicalScenario, request: Request, strength: int) -> Drawn:
    """A covering array, without the points that constraints exclude, and with points for what these
    alone held.
    """
    axes, notes = grid_axes(logical, request)
    sizes = [len(axis) for axis in axes]
    everything = mesh(axes)
    every = np.stack([part.ravel() for part in np.indices(sizes)], axis=-1)
    feasible = logical.feasible(everything)
    strength = min(strength, len(sizes))
    if strength == 1 or len(sizes) == 1:
        rows = np.stack([np.arange(max(sizes)) % size for size in sizes], axis=-1)
    else:
        made = covertable.make(
            [list(range(size)) for size in sizes], strength=strength, salt=str(request.seed)
        )
        rows = np.array([list(row) for row in made], dtype=np.intp)
    chosen = _numbers(rows, sizes)
    possible = [np.unique(codes[feasible]) for codes in tuples_of(every, sizes, strength)]
    added = _complete(chosen[feasible[chosen]], every, feasible, sizes, strength)
    numbers = np.unique(np.concatenate([chosen, added]))
    total = sum(
        np.prod([sizes[axis] for axis in axes_])
        for axes_ in itertools.combinations(range(len(sizes)), strength)
    )
    held = sum(len(codes) for codes in possible)
    excluded = int(total) - held
    if excluded:
        what = {2: "pairs"}.get(strength, f"combinations of {strength}")
        notes += (
            f"{excluded} of {int(total)} {what} of values exist in no possible point; the other "
            f"{held} are held.",
        )
    return Drawn(everything[numbers], notes=notes)


def _complete(
    have: Levels, every: Levels, feasible: BoolArray, sizes: Sequence[int], strength: int
) -> Levels:
    """Numbers of further possible points, so that no combination is missing that a possible point
    could hold.

    Greedy: the point that holds most of what is missing, the first of equals, again and again.
    """
    candidates = np.flatnonzero(feasible)
    codes = tuples_of(every[candidates], sizes, strength)
    place = np.searchsorted(candidates, have)
    missing = []
    for code in codes:
        wanted = np.zeros(int(code.max()) + 1 if len(code) else 1, dtype=np.bool_)
        wanted[code] = True
        wanted[code[place]] = False
        missing.append(wanted)
    added: list[int] = []
    while any(wanted.any() for wanted in missing):
        gain = sum(
            wanted[code].astype(np.intp) for code, wanted in zip(codes, missing, strict=True)
        )
        best = int(np.argmax(gain))
        added.append(int(candidates[best]))
        for code, wanted in zip(codes, missing, strict=True):
            wanted[code[best]] = False
    return np.array(added, dtype=np.intp)


def _numbers(rows: Levels, sizes: Sequence[int]) -> Levels:
    """The number of each point in the full grid."""
    return np.asarray(np.ravel_multi_index(tuple(rows.T), tuple(sizes)), dtype=np.intp)
