"""Proposed further cases: points where neighbouring cases differ much in their effect on S, so that
one more case narrows the interval of S most. `assessment` proposes them.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import steadily
from sumo_eval.trajectory import FloatArray

NEIGHBOURS = 6  # nearest other cases from which the spread at a case is estimated
CANDIDATES = 8_192  # evenly spread points among which further ones are chosen


class FurtherCases(NamedTuple):
    """Proposed cases.

    points: (N, k); the first point narrows the interval most.
    shrink: width of that part of the interval of S which the sampled cases cause, with the proposed
        cases added, divided by its width now, 0..1.
    """

    points: FloatArray
    shrink: float


def further_cases(
    logical: LogicalScenario, points: FloatArray, influence: FloatArray, count: int
) -> FurtherCases:
    """At most `count` further points for the cases of an ADS.

    points: of the cases, (n, k).
    influence: change of S by each case, in points of S, (n,).

    Each case stands for its cell, the part of the space that is nearest to it. The spread s_i of
    its neighbours' influence gives the cell's error: with m cases in the cell its variance is
    s_i^2 / m. The next case goes to the cell where one more lowers the sum of the variances most
    (Neyman's allocation), and there to the candidate farthest from all cases.
    """
    unit = logical.to_unit(points)
    tree = KDTree(unit)
    # the first is the case itself; an array of ranks gives (n, ranks) for a single case, too
    ranks = np.arange(1, min(NEIGHBOURS + 1, len(points)) + 1)
    nearest = np.asarray(tree.query(unit, k=ranks)[1])  # indices of cases, (n, ranks)
    variance = np.var(influence[nearest], axis=1)
    candidates = logical.from_shares(steadily(len(logical.names), CANDIDATES))  # evenly spread
    candidates = candidates[logical.feasible(candidates)]
    where = logical.to_unit(candidates)
    # by candidate: distance to its nearest case (later also to those chosen), index of that case
    distance, cell = (np.asarray(part) for part in tree.query(where))
    held = np.ones(len(points))  # number of cases in each cell, chosen candidates included
    chosen = []
    free = np.bincount(cell, minlength=len(points)) > 0  # cells with candidates
    for _ in range(min(count, len(candidates))):
        gain = np.where(free, variance * (1.0 / held - 1.0 / (held + 1.0)), -1.0)
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        inside = np.flatnonzero(cell == best)
        pick = int(inside[np.argmax(distance[inside])])
        if distance[pick] <= 0.0:  # all candidates of the cell are cases already
            free[best] = False
            continue
        chosen.append(pick)
        held[best] += 1.0
        distance = np.minimum(distance, np.linalg.norm(where - where[pick], axis=1))
    before = float(variance.sum())
    shrink = math.sqrt(float(np.sum(variance / held)) / before) if before > 0.0 else 1.0
    return FurtherCases(candidates[chosen], shrink)
