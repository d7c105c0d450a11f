"""Coverage of a space by its sample, for `assessment`.

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
COUNTED = 2**15  # number of evenly spread points that stand for the space
# distance within which both sides of the boundary need a case; the range of each parameter is 1
RESOLVED = 0.1


class PairCoverage(NamedTuple):
    """Number of cases in each pair of buckets of two parameters.

    x, y: names of the parameters.
    counts: (buckets of y, buckets of x); -1 where no point is possible.
    """

    x: str
    y: str
    counts: FloatArray


class SpaceCoverage(NamedTuple):
    """Coverage of one space. Distances are in the unit box: the range of each parameter is 1.

    buckets: parameter -> number of its buckets with a case, and number of possible buckets.
    pairs: cases by every pair of parameters.
    empty_radius, empty_centre: largest ball around a possible point that holds no case; its radius
        in the unit box, its centre by parameter.
    boundary_resolved: share of the zone boundary with a case within `RESOLVED` on each side; None
        without a boundary.
    exposure_inside: share of all encounters whose parameters lie in the ranges, by the
        distributions of those parameters that have one; None where none has.
    """

    buckets: Mapping[str, tuple[int, int]]
    pairs: tuple[PairCoverage, ...]
    empty_radius: float
    empty_centre: Mapping[str, float]
    boundary_resolved: float | None
    exposure_inside: float | None

    @property
    def pairs_hit(self) -> tuple[int, int]:
        """Bucket pairs with a case, and possible ones."""
        hit = sum(int(np.sum(pair.counts > 0)) for pair in self.pairs)
        return hit, sum(int(np.sum(pair.counts >= 0)) for pair in self.pairs)


def space_coverage(zones: ZonePartition, points: FloatArray) -> SpaceCoverage:
    """Coverage by cases at `points` (n, k) of the space that `zones` partitions."""
    logical = zones.logical
    possible = logical.from_shares(steadily(len(logical.names), COUNTED))
    # the cases' points count as possible too: a narrow space may admit no evenly spread point
    possible = np.concatenate([possible[logical.feasible(possible)], points])
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
        np.add.at(counts, (hit[:, y], hit[:, x]), 1.0)
        pairs.append(PairCoverage(logical.names[x], logical.names[y], counts))
    distance = np.asarray(KDTree(logical.to_unit(points)).query(logical.to_unit(possible))[0])
    emptiest = int(np.argmax(distance))
    return SpaceCoverage(
        buckets=buckets,
        pairs=tuple(pairs),
        empty_radius=float(distance[emptiest]),
        empty_centre=dict(zip(logical.names, possible[emptiest].tolist(), strict=True)),
        boundary_resolved=_resolved(zones, points),
        exposure_inside=_inside(logical.parameters),
    )


def _buckets(logical: LogicalScenario, points: FloatArray) -> np.ndarray:
    """Index of the bucket of each point along each parameter, (n, k). Each of a parameter's listed
    values is a bucket of its own.
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
    """`boundary_resolved` of `SpaceCoverage`."""
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
