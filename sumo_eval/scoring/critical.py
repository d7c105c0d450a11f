"""Critical points of a run: under `[run] keep = "critical"`, `evaluation.score` keeps their
trajectories alone.

Users: `evaluation.py`.
"""

from collections.abc import Mapping

import numpy as np
from scipy.spatial import KDTree

from sumo_eval.results import Evaluation

LEAST_HUMAN = 100
"""Number of least human-like cases, of an ADS in a scenario, whose points are critical."""


def critical_points(evaluation: Evaluation, numbers: Mapping[str, int]) -> set[tuple[str, int]]:
    """Scenario and number of every critical point.

    numbers: case -> number of its point.

    A point is critical if the case of an ADS there
    - collided, left the road or could not be evaluated,
    - collided while the ADS's case at the nearest other point did not, or the reverse,
    - is among the ADS's `LEAST_HUMAN` least human-like cases of the scenario.
    """
    critical_ones = set()
    for score in evaluation.scores:
        name, logical = score.scenario, evaluation.scenarios[score.scenario]
        cases = evaluation.cases_behind(score)
        points = np.array([numbers[case] for case in cases.case.tolist()], np.intp)
        collided, likeness = cases.collided, cases.human_likeness
        critical = collided | cases.departed | (cases.status != "ok")
        rows = np.flatnonzero(np.isfinite(likeness))
        least_first = rows[np.lexsort((points[rows], likeness[rows]))]  # ties by point
        critical[least_first[:LEAST_HUMAN]] = True
        if len(points) > 1:
            places = logical.to_unit(cases.parameters(logical.names))
            # column 1: the nearest of all (column 0) is the point itself
            nearest = np.asarray(KDTree(places).query(places, k=2)[1])[:, 1]
            critical |= collided[nearest] != collided
        critical_ones |= {(name, number) for number in points[critical].tolist()}
    return critical_ones
