"""Which points of a run matter most: what `[run] keep = "critical"` keeps the trajectories of."""

from __future__ import annotations

import heapq
from collections.abc import Mapping

import numpy as np
from scipy.spatial import KDTree

from sumo_eval.results import Evaluation
from sumo_eval.scenario.logical import LogicalScenario

LEAST_HUMAN = 100
"""Cases of an ADS in a scenario, the least human-like ones, whose points are critical."""


def critical_points(
    evaluation: Evaluation, spaces: Mapping[str, LogicalScenario], numbers: Mapping[str, int]
) -> set[tuple[str, int]]:
    """Scenario and number of every critical point. spaces: the scenarios by name. numbers: of each case's point.

    Critical is where, with some ADS, there was a collision; where its drive could not be evaluated or left the road;
    where the nearest other point of the space ended otherwise, with a collision or without; and where it is among its
    `LEAST_HUMAN` least human-like.
    """
    found: set[tuple[str, int]] = set()
    for score in evaluation.scores:
        name, logical = score.scenario, spaces[score.scenario]
        points, unit, hit, likeness = [], [], [], []
        for case in evaluation.cases_of(score.ads, name):
            number = numbers[case.case]
            points.append(number)
            unit.append(logical.to_unit(logical.row(case.values)))
            hit.append(case.collided)
            if case.collided or case.status != "ok":
                found.add((name, number))
            if case.human_likeness is not None:
                likeness.append((case.human_likeness, number))
        found |= {(name, number) for _, number in heapq.nsmallest(LEAST_HUMAN, likeness)}
        if len(points) > 1:
            places, ended = np.array(unit), np.array(hit)
            nearest = np.asarray(KDTree(places).query(places, k=2)[1])[:, 1]
            flips = np.flatnonzero(ended[nearest] != ended)
            found |= {(name, points[place]) for place in flips.tolist()}
    return found
