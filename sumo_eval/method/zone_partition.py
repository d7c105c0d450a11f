"""Safe and hazardous zones of a parameter space, Eqs. 7-8.

A Gaussian process (GP) learns from the training points how much time ideal braking leaves. A point
is hazardous where the GP's y <= 0. The box holds all points within the parameters' ranges, the
space those that satisfy the constraints too. Zones are the connected hazardous regions of the
space. Distances are taken in the unit box, because a distance cannot add metres to metres per
second. A scenario may name coordinates in which its criticality is smoother than in its parameters.
The GP then learns in those coordinates, scaled to a unit box of their own.

`zone_training.py` fits the GP, `zone_search.py` finds boundary and most dangerous points on it.

Users: `record/` (`points.kept_zones` calls `partition`), `scoring/`, `report/`, `cli/`, `extras/`,
`evaluation.py`; Eq. 16 (`collision_avoidance`). Fixed: `partition` and `ZonePartition`, which users
call; its fields, which a run's cache stores (`fitted_parts`); results to the last bit.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import must_be
from sumo_eval.method.point_criticality import criticality, exactly_hazardous, is_searched
from sumo_eval.method.zone_search import (
    crossings,
    exists,
    most_dangerous_point,
    nearest_on_boundary,
)
from sumo_eval.method.zone_surface import Surface, coordinates
from sumo_eval.method.zone_training import (
    EDGE,
    checked_unit,
    dense_grid,
    learn,
    own_axes,
    user_points,
)
from sumo_eval.scenario import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import steadily
from sumo_eval.scenario.sampling.grid import mesh
from sumo_eval.settings import ZoneSettings
from sumo_eval.text import point_words
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

DEFAULT_SETTINGS = ZoneSettings()

# A zone gets a note if the GP's y, -1..0 in a zone, is above -SHALLOW at its most dangerous point.
SHALLOW = 0.02


@dataclass(frozen=True, eq=False)
class ZonePartition:
    """The zones of one logical scenario. Points are rows (..., k) in the order and units of
    `logical.parameters`.

    training_points: (n, k), sorted.
    surface: the GP, in the unit box.
    most_dangerous: x* of each zone, name -> value, the largest zone first.
    zone_shares: share of the space that each zone takes, in the same order.
    notes: sentences on what limits the trust in the zones.
    zone_points: points of the dense grid that are in a zone, unit box, (z, k).
    zone_index: number of the zone of each of these, 0 for the largest zone, (z,).
    boundary: points where the dense grid's lines cross y = 0, unit box, (b, k); empty if the whole
        space is safe or the whole space is hazardous.

    Public methods raise InputError for points outside the box, where the GP has learnt nothing.
    """

    logical: LogicalScenario
    settings: ZoneSettings
    training_points: FloatArray
    surface: Surface
    most_dangerous: tuple[dict[str, float], ...]
    zone_shares: tuple[float, ...]
    notes: tuple[str, ...]
    zone_points: FloatArray
    zone_index: IntArray
    boundary: FloatArray

    @property
    def zones(self) -> int:
        """Number of hazardous zones."""
        return len(self.zone_shares)

    def predicted(self, points: ArrayLike) -> FloatArray:
        """Eq. 8: the GP's y, (...); above 0 is safe.

        points: (..., k), in the parameters' units.

        If all training points are safe, y is +1 everywhere; if all are hazardous, -1.
        """
        return self.surface.value(checked_unit(self.logical, points))

    def hazardous(self, points: ArrayLike) -> BoolArray:
        """Eq. 8: whether y <= 0, (...). Maps and the weights of Eq. 16 use this form of the zones.

        points: (..., k), in the parameters' units.
        """
        return self.predicted(points) <= 0.0

    def exactly_hazardous(self, points: ArrayLike) -> BoolArray:
        """Eqs. 5-6: whether max ITTC reaches its threshold, without the GP, (...).

        points: (..., k), in the parameters' units.

        This decides the zone of every case that is driven. The GP may call a point safe at which
        even ideal braking collides.
        """
        *shape, k = checked_unit(self.logical, points).shape
        rows = np.asarray(points, float).reshape(-1, k)
        return exactly_hazardous(self.logical, rows, self.settings).reshape(shape)

    def nearest_zone(self, points: ArrayLike) -> IntArray:
        """Number of the nearest zone, an index of `most_dangerous`, (...): that of the nearest of
        the `zone_points` in the unit box; -1 without zones.

        points: (..., k), in the parameters' units.
        """
        unit = checked_unit(self.logical, points)
        if not self.zones:
            return np.full(unit.shape[:-1], -1, np.intp)
        return self._nearest(unit)

    def _nearest(self, unit: FloatArray) -> IntArray:
        """Number of the nearest zone of points in the unit box, (..., k); there must be a zone."""
        zone_tree, _ = self._trees
        _, nearest = zone_tree.query(unit)
        return np.asarray(self.zone_index[nearest])

    @cached_property
    def _trees(self) -> tuple[Any, Any]:
        """Search trees of `zone_points` and of `boundary`."""
        from scipy.spatial import KDTree  # takes time to import

        return KDTree(self.zone_points), KDTree(self.boundary)

    def members(self, zone: int, points: FloatArray) -> FloatArray:
        """Those of the points (n, k) that satisfy the constraints, are hazardous for the GP, and
        have the zone of this number as their nearest.
        """
        points = points[self.logical.feasible(points)]
        unit = self.logical.to_unit(points)
        inside = (self.surface.value(unit) <= 0.0) & (self._nearest(unit) == zone)
        return np.asarray(points[inside])

    def exists(self, points: ArrayLike) -> BoolArray:
        """Whether each point satisfies the constraints, (...), up to 1e-9 of the box beyond a
        constraint's limit, which counts as rounding.

        points: (..., k), in the parameters' units.
        """
        return exists(self.logical, checked_unit(self.logical, points))

    def boundary_distance(self, points: ArrayLike) -> FloatArray:
        """Distance to the zone boundary y = 0 in the unit box, (...): positive in the safe zone,
        negative in a hazardous one; inf without a hazardous zone, -inf without a safe one.

        points: (..., k), in the parameters' units.

        Edges of the space do not count as boundary. The sign is that of y. The distance is exact
        to 1e-6, with one exception: if the nearest boundary point lies on an edge of the space, the
        distance is too long, by less than the diagonal of a cell of the dense grid (with three
        parameters 0.05).
        """
        unit = checked_unit(self.logical, points)
        sign = np.where(self.surface.value(unit) <= 0.0, -1.0, 1.0)
        if not len(self.boundary):
            return sign * np.inf
        _, boundary_tree = self._trees
        distance, nearest = boundary_tree.query(unit)
        foot = nearest_on_boundary(self.surface, unit, self.boundary[nearest])
        refined = np.linalg.norm(foot - unit, axis=-1)
        # where the search has not ended on the boundary within the space, `distance` stays
        is_boundary = (np.abs(self.surface.value(foot)) < EDGE) & exists(self.logical, foot)
        return np.asarray(sign * np.where(is_boundary & (refined <= distance), refined, distance))


def partition(
    logical: LogicalScenario,
    settings: ZoneSettings = DEFAULT_SETTINGS,
    *,
    points: ArrayLike | None = None,
) -> ZonePartition:
    """Eqs. 7-8: split the space of a logical scenario into a safe zone and hazardous zones.

    logical: the scenario.
    settings: `[method.zones]`.
    points: training points, (n, k), in the parameters' units. None: the grid of the parameters' own
        steps over the whole box, with more points where the GP is wrong.

    Points that violate a constraint train the GP too, because criticality is defined there, but
    belong to no zone. If all training points are safe, no GP is fitted, and the whole space counts
    as safe; likewise if all are hazardous. Neither order nor repetition of `points` matters.

    Raises InputError for points outside the box, and for more parameters than a grid can have.
    """
    axes, notes = own_axes(logical)
    if points is None:
        training = mesh(axes)
        rounds = 1 + settings.refinements
    else:  # used as they are, without refinement
        training = user_points(logical, points)
        notes = ()
        rounds = 1
    axes, grid, feasible = dense_grid(logical, axes, settings)
    learnt = learn(logical, training, grid, feasible, settings, rounds)
    notes += learnt.notes
    shape = tuple(map(len, axes))
    hazard = (learnt.y <= 0.0) & feasible
    zone = _zone_numbers(hazard, learnt.wrong, shape)
    in_zone = zone >= 0
    spurious = hazard & ~in_zone
    if spurious.any():
        share = 100.0 * (spurious.sum() / feasible.sum())
        notes += (f"{share:.2f} % of the space is hazardous for the GP alone, and forms no zone.",)
    unit = logical.to_unit(grid)
    zones = ZonePartition(
        logical=logical,
        settings=settings,
        training_points=learnt.training,
        surface=learnt.surface,
        most_dangerous=(),
        zone_shares=tuple((np.bincount(zone[in_zone]) / feasible.sum()).tolist()),
        notes=(),
        zone_points=unit[in_zone],
        zone_index=zone[in_zone],
        boundary=unit[:0],
    )
    if zones.zones:
        boundary = crossings(
            logical, zones.surface, unit.reshape(*shape, -1), learnt.y.reshape(shape)
        )
        cell = max(1.0 / (len(axis) - 1) for axis in axes)  # unit-box width of the widest cell
        worst = tuple(
            most_dangerous_point(
                logical,
                settings,
                partial(zones.members, number),
                np.concatenate([grid[zone == number], training]),
                cell,
            )
            for number in range(zones.zones)
        )
        zones = replace(zones, most_dangerous=worst, boundary=boundary)
        notes += tuple(_edge_notes(zones))
    # `logical.notes` already say that a scenario without a criterion has no zones
    has_criterion = logical.approach or logical.search or logical.margin
    return replace(zones, notes=notes if has_criterion else ())


def _edge_notes(zones: ZonePartition) -> Iterator[str]:
    """A note on each most dangerous point that lies near its zone's edge for the GP."""
    rows = [zones.logical.row(point) for point in zones.most_dangerous]
    y = zones.surface.value(zones.logical.to_unit(rows))
    for number in np.flatnonzero(y > -SHALLOW).tolist():
        words = point_words(zones.most_dangerous[number])
        yield (
            f"The GP has the most dangerous point {words} near its zone's edge: the weights r near "
            "that zone are uncertain."
        )


def _zone_numbers(hazard: BoolArray, wrong: BoolArray, shape: tuple[int, ...]) -> IntArray:
    """Number of each grid point's zone, 0 for the largest zone, (g,); -1: no zone.

    hazard: whether the point is in the space and y <= 0 there, (g,).
    wrong: whether y has the wrong sign, (g,).
    shape: of the dense grid, values on each axis.

    A region in which no point is hazardous by max ITTC itself is not a zone. Its most dangerous
    point would lie on its edge, and Eq. 16 divides by the distance from there to the edge: weights
    would reach 10^9.
    """
    from scipy.ndimage import label

    # `label` numbers connected regions from 1 on. The structure of ones connects cells that touch
    # at a corner.
    regions = label(hazard.reshape(shape), structure=np.ones((3,) * len(shape)))[0].ravel()
    real = np.unique(regions[hazard & ~wrong])
    sizes = np.bincount(regions)
    number_of = np.full(len(sizes), -1, np.intp)  # label -> number of the zone
    number_of[real[np.argsort(-sizes[real], kind="stable")]] = range(len(real))
    return number_of[regions]


def refuse_impossible_zones(logical: LogicalScenario, settings: ZoneSettings) -> None:
    """Raise the InputErrors of `partition` without fitting a GP.

    Where criticality is searched over time (`is_searched`), this looks at every eighth point of the
    dense grid only, to save time.
    """
    axes, _ = own_axes(logical)
    _, grid, feasible = dense_grid(logical, axes, settings)
    # computed only for the errors that a scenario's own functions raise
    exactly_hazardous(logical, grid[feasible][:: 8 if is_searched(logical) else 1], settings)
    training = mesh(axes)
    criticality(logical, training, settings)
    coordinates(logical, training)  # raises where the scenario's own coordinates fail


def fitted_parts(zones: ZonePartition) -> dict[str, Any]:
    """Fields of a partition as they are stored; `of_parts` restores the partition.

    Not stored: the scenario and the settings, which the caller of `of_parts` has, and the surface's
    `coordinates`, a function that follows from the scenario and the training points.
    """
    # [2:]: without `logical` and `settings`, the first two fields
    parts = {item.name: getattr(zones, item.name) for item in fields(zones)[2:]}
    return parts | {"surface": replace(zones.surface, coordinates=None)}


def of_parts(
    logical: LogicalScenario, settings: ZoneSettings, parts: dict[str, Any]
) -> ZonePartition:
    """The partition of a scenario under these settings, from its `fitted_parts`."""
    to_x = coordinates(logical, parts["training_points"])
    surface = replace(parts["surface"], coordinates=to_x)
    return ZonePartition(logical, settings, **parts | {"surface": surface})


class BoundaryError(NamedTuple):
    """Shares of points that the GP puts in the wrong zone, 0..1.

    box: of all points of the box.
    feasible: of the points that satisfy the constraints; nan without any.
    """

    box: float
    feasible: float


@lru_cache(maxsize=64)  # evaluations in one process share a partition, and its error
def boundary_error(zones: ZonePartition, n: int | None = None) -> BoundaryError:
    """Compare a partition with the criterion itself (max ITTC >= ITTC*) at n evenly spread points
    of the box.

    zones: the partition.
    n: number of points. None: 50,000, or 2,000 in a scenario with a `search`.

    The points are an additive recurrence (`steadily`) and not a regular grid. The error on a grid
    depends on how many of its lines are lines of the training grid: one partition has 0.08 % on a
    grid of 40^3 points and 0.18 % on one of 53^3.
    """
    if n is None:
        n = 50_000 if zones.logical.search is None else 2_000
    if n < 1:
        raise must_be("`n`", "`boundary_error`", "at least 1", n)
    points = zones.logical.from_unit(steadily(len(zones.logical.parameters), n))
    wrong = zones.hazardous(points) != exactly_hazardous(zones.logical, points, zones.settings)
    feasible = zones.logical.feasible(points)
    return BoundaryError(
        float(wrong.mean()), float(wrong[feasible].mean()) if feasible.any() else math.nan
    )
