"""Further cases that would tell most: where neighbouring cases differ much, and count much."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import steadily
from sumo_eval.trajectory import FloatArray

NEIGHBOURS = 6
CANDIDATES = 8_192


@dataclass(frozen=True, slots=True, eq=False)
class FurtherCases:
    """points: (N, k), the most telling first.
    shrink: what the sampled cases' part of the interval on S would be multiplied by, 0..1.
    """

    points: FloatArray
    shrink: float


def further_cases(
    logical: LogicalScenario, points: FloatArray, influence: FloatArray, count: int
) -> FurtherCases:
    """`count` further points for cases at `points` (n, k), whose `influence` (n,) is how many
    points of S each moves.

    Each case stands for the part of the space nearest to it, with the error that its neighbours'
    spread s_i shows; with m cases in that part the error's variance is s_i^2 / m. The next case
    goes where one more lowers the sum most (Neyman's allocation), and within the part to the place
    farthest from all cases.
    """
    unit = logical.to_unit(points)
    tree = KDTree(unit)
    neighbours = np.arange(1, min(NEIGHBOURS + 1, len(points)) + 1)
    variance = np.var(influence[np.asarray(tree.query(unit, k=neighbours)[1])], axis=1)
    candidates = logical.from_shares(steadily(len(logical.names), CANDIDATES))
    candidates = candidates[logical.feasible(candidates)]
    where = logical.to_unit(candidates)
    distance, cell = (np.asarray(part) for part in tree.query(where))
    held = np.ones(len(points))
    chosen: list[int] = []
    free = np.bincount(cell, minlength=len(points)) > 0
    for _ in range(min(count, len(candidates))):
        gain = np.where(free, variance * (1.0 / held - 1.0 / (held + 1.0)), -1.0)
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        inside = np.flatnonzero(cell == best)
        pick = int(inside[np.argmax(distance[inside])])
        if distance[pick] <= 0.0:
            free[best] = False
            continue
        chosen.append(pick)
        held[best] += 1.0
        distance = np.minimum(distance, np.linalg.norm(where - where[pick], axis=1))
    before = float(variance.sum())
    shrink = math.sqrt(float(np.sum(variance / held)) / before) if before > 0.0 else 1.0
    return FurtherCases(candidates[chosen], shrink)
