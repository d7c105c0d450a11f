"""Proposed further cases: points where neighbouring cases differ much in their effect on S. One
more case there narrows the interval of S most.

Users: `scoring/confidence/assessment.py`, `report/`.
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

    points: (N, k), in the parameters' units; the first point narrows the interval most.
    shrink: expected width of the interval of S with the proposed cases, divided by its width now,
        0..1. Only the part of the interval that comes from the sample of cases counts.
    """

    points: FloatArray
    shrink: float


def further_cases(
    logical: LogicalScenario, points: FloatArray, influence: FloatArray, count: int
) -> FurtherCases:
    """At most `count` further points for the cases of an ADS.

    points: of the cases, (n, k), in the parameters' units.
    influence: points by which each case moves S, (n,), from `assessment.influence`.
    count: most points that are proposed.

    Each case has a cell, the part of the space that is nearest to it. s_i^2 is the variance of the
    influence of the case's neighbours. With m cases in the cell, the cell's part of the variance of
    S is s_i^2 / m. The next case goes to the cell where it lowers the sum of these parts most
    (Neyman's allocation), and there to the candidate farthest from all cases.
    """
    unit = logical.to_unit(points)
    tree = KDTree(unit)
    # Rank 1 is the case itself, which counts as a neighbour. Ranks as an array, because the tree
    # gives an array (n, ranks) for them even if there is one rank.
    ranks = np.arange(1, min(NEIGHBOURS + 1, len(points)) + 1)
    nearest = np.asarray(tree.query(unit, k=ranks)[1])  # indices of cases, (n, ranks)
    variance = np.var(influence[nearest], axis=1)
    candidates = logical.from_shares(steadily(len(logical.names), CANDIDATES))  # evenly spread
    candidates = candidates[logical.feasible(candidates)]
    where = logical.to_unit(candidates)
    # of each candidate: distance to its nearest case (later also to chosen candidates), and index
    # of this case, which is the number of its cell
    distance, cell = (np.asarray(part) for part in tree.query(where))
    cases_in_cell = np.ones(len(points))  # chosen candidates count too
    picks = []  # indices of the chosen candidates
    free = np.bincount(cell, minlength=len(points)) > 0  # whether a cell has candidates left
    for _ in range(min(count, len(candidates))):
        gain = np.where(free, variance * (1.0 / cases_in_cell - 1.0 / (cases_in_cell + 1.0)), -1.0)
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        inside = np.flatnonzero(cell == best)
        pick = int(inside[np.argmax(distance[inside])])
        if distance[pick] <= 0.0:  # all candidates of the cell are cases already
            free[best] = False
            continue
        picks.append(pick)
        cases_in_cell[best] += 1.0
        distance = np.minimum(distance, np.linalg.norm(where - where[pick], axis=1))
    before = float(variance.sum())
    shrink = math.sqrt(float(np.sum(variance / cases_in_cell)) / before) if before > 0.0 else 1.0
    return FurtherCases(candidates[picks], shrink)
