"""Coverage of a space by its sample: which parts of the space have cases, and which have none.

Users: `report/confidence_section.py`, `scoring/confidence/assessment.py`.
"""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.scenario.sampling.drawn_points import steadily
from sumo_eval.trajectory import FloatArray

BUCKETS = 5  # equal parts of each parameter's range
COUNTED = 2**15  # number of evenly spread points that represent the space
RESOLVED = 0.1  # unit-box length within which the zone boundary needs a case on each side


class PairCoverage(NamedTuple):
    """Number of cases in each pair of buckets of two parameters.

    x, y: names of the parameters.
    counts: number of cases, (buckets of y, buckets of x); -1 where no point is possible.
    """

    x: str
    y: str
    counts: FloatArray


class SpaceCoverage(NamedTuple):
    """Coverage of one space. A point is possible if it satisfies the constraints.

    buckets: parameter -> number of its buckets with a case, and number of buckets with a possible
        point.
    pairs: cases by every pair of parameters.
    empty_radius: radius of the largest ball around a possible point that holds no case, unit box.
    empty_centre: centre of this ball, by parameter.
    boundary_resolved: share of the zone boundary with a case within `RESOLVED` on each side; None
        without a boundary.
    exposure_inside: share of all encounters whose parameters lie in the ranges, by the
        distributions of the parameters; None if no parameter has a distribution.
    """

    buckets: Mapping[str, tuple[int, int]]
    pairs: tuple[PairCoverage, ...]
    empty_radius: float
    empty_centre: Mapping[str, float]
    boundary_resolved: float | None
    exposure_inside: float | None

    @property
    def pairs_hit(self) -> tuple[int, int]:
        """Number of pairs of buckets with a case, and number of possible pairs."""
        hit = sum(int(np.sum(pair.counts > 0)) for pair in self.pairs)
        return hit, sum(int(np.sum(pair.counts >= 0)) for pair in self.pairs)


def space_coverage(zones: ZonePartition, points: FloatArray) -> SpaceCoverage:
    """Coverage of a space by cases.

    zones: partition of the space.
    points: of the cases, (n, k), in the parameters' units.
    """
    logical = zones.logical
    possible = logical.from_shares(steadily(len(logical.names), COUNTED))
    # the cases' points too, because a narrow space may contain no evenly spread point
    possible = np.concatenate([possible[logical.feasible(possible)], points])
    # bucket of each case and of each possible point, along each parameter
    hit, reachable = _buckets(logical, points), _buckets(logical, possible)
    sizes = [len(item.values) or BUCKETS for item in logical.parameters]
    buckets = {
        name: (len(np.unique(hit[:, column])), len(np.unique(reachable[:, column])))
        for column, name in enumerate(logical.names)
    }
    pairs = []
    for x, y in itertools.combinations(range(len(sizes)), 2):
        counts = np.full((sizes[y], sizes[x]), -1.0)
        counts[reachable[:, y], reachable[:, x]] = 0.0
        np.add.at(counts, (hit[:, y], hit[:, x]), 1.0)  # counts a bucket as often as it occurs
        pairs.append(PairCoverage(logical.names[x], logical.names[y], counts))
    distance = np.asarray(KDTree(logical.to_unit(points)).query(logical.to_unit(possible))[0])
    emptiest = int(np.argmax(distance))
    return SpaceCoverage(
        buckets=buckets,
        pairs=tuple(pairs),
        empty_radius=float(distance[emptiest]),
        empty_centre=logical.point(possible[emptiest].tolist()),
        boundary_resolved=_resolved(zones, points),
        exposure_inside=_inside(logical.parameters),
    )


def _buckets(logical: LogicalScenario, points: FloatArray) -> np.ndarray:
    """Index of the bucket of each point along each parameter, (n, k).

    points: (n, k), in the parameters' units.

    A parameter with listed values has a bucket for each value.
    """
    columns = []
    for column, item in enumerate(logical.parameters):
        values = points[:, column]
        if item.values:
            columns.append(np.argmin(np.abs(values[:, None] - np.array(item.values)), axis=1))
        else:
            share = (values - item.low) / (item.high - item.low)
            columns.append(np.clip((share * BUCKETS).astype(int), 0, BUCKETS - 1))
    return np.column_stack(columns)


def _resolved(zones: ZonePartition, points: FloatArray) -> float | None:
    """`boundary_resolved` of `SpaceCoverage`.

    points: of the cases, (n, k), in the parameters' units.
    """
    boundary = zones.boundary  # points in the unit box
    if not len(boundary):
        return None
    unit, hazardous = zones.logical.to_unit(points), zones.exactly_hazardous(points)
    if hazardous.all() or not hazardous.any():
        return 0.0
    near = [KDTree(unit[side]).query(boundary)[0] <= RESOLVED for side in (hazardous, ~hazardous)]
    return float(np.mean(near[0] & near[1]))


def _inside(parameters: tuple[Parameter, ...]) -> float | None:
    """`exposure_inside` of `SpaceCoverage`."""
    shares = [
        item.distribution.inside(item.low, item.high)
        for item in parameters
        if item.distribution is not None
    ]
    return float(np.prod(shares)) if shares else None
