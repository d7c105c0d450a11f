"""Safe and hazardous zones of a parameter space, Eqs. 7-8.

A Gaussian process learns from the training points how much time ideal braking leaves; a point is
hazardous where the learnt y <= 0. Zones are the connected hazardous regions of the points that
exist (box and constraints). Distances are taken in the unit box, because metres and metres per
second have no common length. A scenario may name coordinates in which its criticality is smoother
than in its parameters; the GP then sees those, scaled alike.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, must_be
from sumo_eval.method.point_criticality import asks_some, criticality, exactly_hazardous
from sumo_eval.method.zone_surface import SEED, Surface, coordinates, fit
from sumo_eval.scenario import LogicalScenario, Parameter
from sumo_eval.scenario.sampling.drawn_points import steadily
from sumo_eval.scenario.sampling.grid import decimal, evenly, mesh
from sumo_eval.settings import ZoneSettings
from sumo_eval.text import point_words
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

DEFAULT_SETTINGS = ZoneSettings()

OWN_GRID_POINTS = 1_500  # larger grids of own steps are thinned: a GP's cost grows with the cube
MOST_POINTS = 5_000  # training points a user may bring
# points of the dense grid where every one of them is a search of its own, at most
SEARCHED_GRID = 8_000
ADDED_AT_ONCE = 500  # training points added in one refinement, at most
# of the box, where the search for a most dangerous point ends if criticality is searched
SEARCHED_WINDOW = 1e-3
EDGE = 1e-9  # unit-box lengths within which a point counts as on an edge of the space
ERROR_WORTH_A_NOTE = 0.01  # share of the space
SHALLOW = 0.02  # of -1..0: a zone whose most dangerous point has a y above that is noted


@dataclass(frozen=True, eq=False)
class ZonePartition:
    """The zones of one logical scenario. Points are rows (..., k) in the order and units of
    `logical.parameters`.

    training_points: (n, k), sorted.
    surface: the GP, in the unit box.
    most_dangerous: one point a zone, name -> value, the largest zone first.
    zone_shares: share of the space that each zone takes.
    notes: sentences on limits of the trust in it.
    zone_points: the zones' points on the dense grid, unit box; none without zones.
    zone_index: the zone of each of them.
    boundary: where the grid's edges cross the zone boundary; nowhere without zones and without a
        safe zone.

    Every method refuses points outside the box: the GP knows nothing there.
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
        """Eq. 8: the GP's y; above 0 is safe.

        Exactly +1 or -1 everywhere if all training points agree.
        """
        unit = _checked_unit(self.logical, points)
        return self.surface.value(_rows(unit)).reshape(unit.shape[:-1])

    def hazardous(self, points: ArrayLike) -> BoolArray:
        """Whether y <= 0: the zones' form, for maps and for the weights of Eq. 16."""
        return self.predicted(points) <= 0.0

    def exactly_hazardous(self, points: ArrayLike) -> BoolArray:
        """Whether max ITTC itself, in closed form or searched over time, reaches its threshold.

        This decides the zone of every case that is driven: the GP may put a point of certain
        contact on the safe side.
        """
        shape = _checked_unit(self.logical, points).shape[:-1]
        return exactly_hazardous(self.logical, _rows(points), self.settings).reshape(shape)

    def largest_inverse_ttc(self, point: FloatArray) -> float:
        """Eqs. 5-6: largest inverse TTC under ideal braking at one point (k,), 1/s."""
        return float(criticality(self.logical, point[None], self.settings).inverse[0])

    def nearest_zone(self, points: ArrayLike) -> IntArray:
        """Number of the zone nearest in the unit box, -1 if there is none, by the dense grid of
        the zones.
        """
        unit = _checked_unit(self.logical, points)
        if not self.zones:
            return np.full(unit.shape[:-1], -1, dtype=np.intp)
        return self._nearest(unit)

    def _nearest(self, unit: FloatArray) -> IntArray:
        return np.asarray(self.zone_index[self._zone_tree.query(unit)[1]])

    @cached_property
    def _zone_tree(self) -> Any:
        return _tree(self.zone_points)

    @cached_property
    def _boundary_tree(self) -> Any:
        return _tree(self.boundary)

    def members(self, zone: int, points: FloatArray) -> FloatArray:
        """The points (n, k) that exist and belong to a zone."""
        points = points[self.logical.feasible(points)]
        unit = self.logical.to_unit(points)
        inside = (self.surface.value(unit) <= 0.0) & (self._nearest(unit) == zone)
        return np.asarray(points[inside])

    def exists(self, points: ArrayLike) -> BoolArray:
        """Whether each point belongs to the space.

        Its edges do, and also what rounding puts 1e-9 of the box beyond one.
        """
        unit = _checked_unit(self.logical, points)
        return _exists(self.logical, _rows(unit)).reshape(unit.shape[:-1])

    def boundary_distance(self, points: ArrayLike) -> FloatArray:
        """Distance to the zone boundary y = 0 in the unit box: positive in the safe zone, negative
        in a hazardous one.

        inf without a hazardous zone, -inf without a safe one. Edges of the space do not count as
        boundary. The sign is exact; the distance is exact to 1e-6 where the nearest boundary point
        is off the edges of the space; otherwise it is too long, by less than the diagonal of a cell
        of the dense grid (0.05 for three parameters).
        """
        unit = _checked_unit(self.logical, points)
        rows = _rows(unit)
        sign = np.where(self.surface.value(rows) <= 0.0, -1.0, 1.0)
        if not len(self.boundary):
            return (sign * np.inf).reshape(unit.shape[:-1])
        distance, nearest = self._boundary_tree.query(rows)
        foot = self.boundary[nearest]
        # Onto the surface's tangent plane again and again: it settles where the connection is
        # normal to it. Half steps, because whole ones diverge where the boundary is more curved
        # than the distance is short.
        for _ in range(60):
            slope = self.surface.gradient(foot)
            reach = self.surface.value(foot) + np.sum(slope * (rows - foot), axis=1)
            steepness = np.maximum(np.sum(slope**2, axis=1), np.finfo(float).tiny)
            projected = np.clip(rows - (reach / steepness)[:, None] * slope, 0.0, 1.0)
            foot = (foot + projected) / 2.0
        closer = np.linalg.norm(foot - rows, axis=1)
        settled = (np.abs(self.surface.value(foot)) < EDGE) & _exists(self.logical, foot)
        closer = np.where(settled & (closer <= distance), closer, distance)
        return np.asarray(sign * closer).reshape(unit.shape[:-1])


def _tree(points: FloatArray) -> Any:
    """A search tree of points (n, k)."""
    from scipy.spatial import KDTree  # takes time to import

    return KDTree(points)


def partition(
    logical: LogicalScenario,
    settings: ZoneSettings = DEFAULT_SETTINGS,
    *,
    points: ArrayLike | None = None,
) -> ZonePartition:
    """Eqs. 7-8: split the space of a logical scenario into a safe zone and hazardous zones.

    logical: the scenario.
    settings: `[method.zones]`.
    points: training points (n, k) in the parameters' units; by default the grid of the parameters'
        own steps over the whole box.

    Points that violate a constraint train the GP too (criticality is defined there), but belong to
    no zone. If all training points agree there is nothing to learn: that outcome then holds
    everywhere, and no GP is fitted. The order of the points, and repeated ones, change nothing.

    Raises InputError for points outside the box.
    """
    from scipy.ndimage import generate_binary_structure, label

    axes, thinned = _own_axes(logical)
    notes = list(thinned) if points is None else []
    training = mesh(axes) if points is None else _user_points(logical, points)

    refined, grid, feasible = _dense_grid(logical, axes, settings)
    unit = logical.to_unit(grid)
    rounds = 1 + settings.refinements if points is None else 1
    learnt = _learn(logical, training, grid, feasible, settings, rounds)
    notes += learnt.notes

    shape = tuple(len(axis) for axis in refined)
    hazard = ((learnt.y <= 0.0) & feasible).reshape(shape)
    # Regions that the GP alone calls hazardous are no zones: with the most dangerous point on their
    # own edge, Eq. 16 would weigh a point near them 10^9 times.
    regions, _ = label(hazard, structure=generate_binary_structure(len(shape), len(shape)))
    real = np.unique(regions[hazard & ~learnt.wrong.reshape(shape)])
    spurious = hazard & ~np.isin(regions, real)
    if spurious.any():
        share = 100.0 * float(spurious.sum() / feasible.sum())
        notes.append(
            f"{share:.2f} % of the space is hazardous for the GP alone, and forms no zone."
        )
    sizes = np.array([np.count_nonzero(regions == region) for region in real], dtype=np.intp)
    by_size = np.argsort(-sizes, kind="stable")
    zone = np.full(hazard.size, -1, dtype=np.intp)
    for number, region in enumerate(real[by_size]):
        zone[regions.ravel() == region] = number
    in_zone, surface = zone >= 0, learnt.surface
    zones = ZonePartition(
        logical=logical,
        settings=settings,
        training_points=learnt.training,
        surface=surface,
        most_dangerous=(),
        zone_shares=tuple(float(size) / int(feasible.sum()) for size in sizes[by_size]),
        notes=(),
        zone_points=unit[in_zone],
        zone_index=zone[in_zone],
        boundary=unit[:0],
    )
    if len(real):
        crossings = _crossings(logical, surface, unit.reshape(*shape, -1), learnt.y.reshape(shape))
        cell = max(1.0 / (len(axis) - 1) for axis in refined)
        worst = tuple(
            _most_dangerous(zones, number, np.concatenate([grid[zone == number], training]), cell)
            for number in range(len(real))
        )
        zones = replace(zones, most_dangerous=worst, boundary=crossings)
        deepest = surface.value(logical.to_unit([logical.row(point) for point in worst]))
        notes += [
            f"The GP has the most dangerous point {point_words(worst[number])} near its zone's "
            "edge: the weights r near that zone are uncertain."
            for number in np.flatnonzero(deepest > -SHALLOW)
        ]
    # a scenario without a criterion says itself that it has no zones
    judged = logical.approach or logical.search or logical.margin
    return replace(zones, notes=tuple(notes) if judged else ())


def refuse_impossible_zones(logical: LogicalScenario, settings: ZoneSettings) -> None:
    """Raise the InputErrors of `partition` without learning anything.

    Of a dense grid whose points are searches of their own (`asks_some`), one in eight is tried.
    """
    axes, _ = _own_axes(logical)
    _, grid, feasible = _dense_grid(logical, axes, settings)
    exactly_hazardous(logical, grid[feasible][:: 8 if asks_some(logical) else 1], settings)
    training = mesh(axes)
    criticality(logical, training, settings)
    if (better := coordinates(logical, training)) is not None:
        better(logical.to_unit(training))


def _dense_grid(
    logical: LogicalScenario, axes: list[list[float]], settings: ZoneSettings
) -> tuple[list[list[float]], FloatArray, BoolArray]:
    """The axes of the dense grid, its points (n, k), and which of them can be."""
    most = (
        settings.grid_points if logical.search is None else min(settings.grid_points, SEARCHED_GRID)
    )
    refined = _refine(axes, most)
    grid = mesh(refined)
    feasible = logical.feasible(grid)
    if not feasible.any():
        raise InputError(
            f"Scenario `{logical.name}` must have points that satisfy its constraints: none of "
            f"{len(grid)} do."
        )
    return refined, grid, feasible


def fitted_parts(zones: ZonePartition) -> dict[str, Any]:
    """The results of a fit by field: `of_parts` makes the partition of them again."""
    parts = {item.name: getattr(zones, item.name) for item in fields(zones)[2:]}
    return parts | {"surface": replace(zones.surface, coordinates=None)}


def of_parts(
    logical: LogicalScenario, settings: ZoneSettings, parts: Mapping[str, Any]
) -> ZonePartition:
    """The partition of a scenario under some settings, from its parts."""
    seen = coordinates(logical, parts["training_points"])
    surface = replace(parts["surface"], coordinates=seen)
    return ZonePartition(logical, settings, **{**parts, "surface": surface})


class BoundaryError(NamedTuple):
    """Share of misclassified points: over the whole box, and over the points that satisfy the
    constraints.
    """

    box: float
    feasible: float


@lru_cache(maxsize=64)  # for each evaluation of a process that has this partition
def boundary_error(zones: ZonePartition, n: int | None = None) -> BoundaryError:
    """Compare a partition with the criterion itself (max ITTC >= ITTC*) at n evenly spread points
    of the box.

    zones: the partition.
    n: by default 50,000, or 2,000 where every point is a search of its own.

    Max ITTC is in closed form where the scenario has one, else searched over time. The points are
    an additive recurrence (`steadily`). A regular grid would share its lines with the training
    grid: one partition measures 0.08 % on 40^3 of its points and 0.18 % on 53^3.
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


# --- training -------------------------------------------------------------------------------------


class _Learnt(NamedTuple):
    """A surface and what it was learnt from: training points (n, k); y on the dense grid, and where
    that has the wrong sign.
    """

    training: FloatArray
    surface: Surface
    y: FloatArray
    wrong: BoolArray
    notes: tuple[str, ...]


def _learn(
    logical: LogicalScenario,
    training: FloatArray,
    grid: FloatArray,
    feasible: BoolArray,
    settings: ZoneSettings,
    rounds: int,
) -> _Learnt:
    """Fit the GP; while it has too much of the dense grid on the wrong side, add some of that and
    fit again. The best of the rounds counts.
    """
    exact = np.zeros(len(grid), dtype=bool)
    exact[feasible] = exactly_hazardous(logical, grid[feasible], settings)
    unit, own, possible = logical.to_unit(grid), len(training), int(feasible.sum())
    learnt: list[_Learnt] = []
    for _ in range(rounds):
        found = criticality(logical, training, settings)
        target = found.target
        if settings.target == "label":
            target = np.where(found.inverse >= settings.critical_inverse_ttc, -1.0, 1.0)
        surface, notes = fit(logical, training, target, settings)
        y = surface.value(unit)
        wrong = feasible & ((y <= 0.0) != exact)
        if len(training) > own:
            added = len(training) - own
            notes += [f"{added} training points were added where the GP was on the wrong side."]
        learnt.append(_Learnt(training, surface, y, wrong, tuple(notes)))
        if wrong.sum() <= ERROR_WORTH_A_NOTE * possible:
            break
        more = np.random.default_rng(SEED).permutation(np.flatnonzero(wrong))[:ADDED_AT_ONCE]
        training = np.unique(np.concatenate([training, grid[more]]), axis=0)
    best = min(learnt, key=lambda one: int(one.wrong.sum()))
    share = best.wrong.sum() / possible
    if share > ERROR_WORTH_A_NOTE:
        remark = f"The GP puts {100 * share:.1f} % of the space in the wrong zone: add points."
        best = best._replace(notes=(*best.notes, remark))
    return best


# --- points ---------------------------------------------------------------------------------------


def _own_axes(logical: LogicalScenario) -> tuple[list[list[float]], tuple[str, ...]]:
    """The values of each parameter's own steps, thinned where they are too many for a GP, and a
    sentence about that.
    """
    counts = [_own_count(parameter) for parameter in logical.parameters]
    own = math.prod(counts)
    while math.prod(counts) > OWN_GRID_POINTS:
        counts[counts.index(max(counts))] = min(max(counts) - 1, OWN_GRID_POINTS)
    axes = [
        _axis(parameter, count) for parameter, count in zip(logical.parameters, counts, strict=True)
    ]
    if math.prod(counts) == own:
        return axes, ()
    return axes, (
        f"The zones were learnt from a grid of {math.prod(counts)} points, coarser than the "
        f"scenario's own of {own}.",
    )


def _own_count(parameter: Parameter) -> int:
    """Number of values from low in steps, and high."""
    extent = decimal(parameter.high) - decimal(parameter.low)
    return math.ceil(extent / decimal(parameter.step)) + 1


def _axis(parameter: Parameter, count: int) -> list[float]:
    """Low, low + step, ... and high; evenly spaced values if `count` is less than that takes."""
    if count < _own_count(parameter):
        return evenly(parameter, count)
    low, step = decimal(parameter.low), decimal(parameter.step)
    return [*(float(low + step * index) for index in range(count - 1)), float(parameter.high)]


def _refine(axes: list[list[float]], most: int) -> list[list[float]]:
    """Split every interval in the same number of parts, as many as `most` points allow: old points
    stay on the grid.

    On decimals: two parameters that meet in a constraint must get equal numbers where they are
    equal.
    """
    parts = 1
    while math.prod((len(axis) - 1) * (parts + 1) + 1 for axis in axes) <= most:
        parts += 1
    return [
        [
            *(
                float(a + (b - a) * part / parts)
                for a, b in itertools.pairwise(map(decimal, axis))
                for part in range(parts)
            ),
            axis[-1],
        ]
        for axis in axes
    ]


def _rows(points: ArrayLike) -> FloatArray:
    """Points (..., k) as (n, k)."""
    array = np.asarray(points, dtype=float)
    return array.reshape(-1, array.shape[-1])


def _user_points(logical: LogicalScenario, points: ArrayLike) -> FloatArray:
    array = np.asarray(points, dtype=float)
    owner = f"scenario `{logical.name}`"
    if (
        array.ndim != 2
        or array.shape[1] != len(logical.parameters)
        or not 1 <= len(array) <= MOST_POINTS
    ):
        wanted = f"an (n, {len(logical.parameters)}) array with n in 1..{MOST_POINTS}"
        raise must_be("The training points", owner, wanted, array.shape)
    _checked_unit(logical, array)
    return np.unique(array, axis=0)


def _checked_unit(logical: LogicalScenario, points: ArrayLike) -> FloatArray:
    """Points in the unit box; refuses what lies outside of it by more than rounding."""
    columns = logical.columns(points)
    for parameter in logical.parameters:
        values = columns[parameter.name]
        slack = EDGE * (parameter.high - parameter.low)
        outside = ~((values >= parameter.low - slack) & (values <= parameter.high + slack))
        if np.any(outside):
            allowed = f"within {parameter.low:g}..{parameter.high:g}{parameter.unit_suffix}"
            owner = f"scenario `{logical.name}`"
            raise must_be(
                f"`{parameter.name}`", owner, allowed, float(np.ravel(values)[np.ravel(outside)][0])
            )
    return np.clip(logical.to_unit(points), 0.0, 1.0)


def _exists(logical: LogicalScenario, unit: FloatArray) -> BoolArray:
    """Constraints with their edges: a point also exists if a nudge of `EDGE` to some side makes it
    feasible.
    """
    holds = logical.feasible(logical.from_unit(unit))
    if not holds.all():
        nudges = EDGE * mesh([[-1.0, 0.0, 1.0]] * unit.shape[1])
        nudged = np.clip(unit[~holds][:, None, :] + nudges, 0.0, 1.0)
        holds[~holds] = logical.feasible(logical.from_unit(nudged)).any(axis=1)
    return holds


# --- zones ----------------------------------------------------------------------------------------


def _crossings(
    logical: LogicalScenario, surface: Surface, unit: FloatArray, y: FloatArray
) -> FloatArray:
    """Points where the grid's edges cross y = 0 within the space, (m, k), for unit points (..., k)
    and y (...) on the grid.
    """
    crossings = []
    for axis in range(y.ndim):
        ahead, places = np.moveaxis(y, axis, 0), np.moveaxis(unit, axis, 0)
        changes = (ahead[:-1] <= 0.0) != (ahead[1:] <= 0.0)
        y0, y1 = ahead[:-1][changes], ahead[1:][changes]
        x0, x1 = places[:-1][changes], places[1:][changes]
        # regula falsi: a distance to the crossings must never come out too short
        for _ in range(5):
            crossing = x0 + (y0 / (y0 - y1))[:, None] * (x1 - x0)
            value = surface.value(crossing)
            first = (value <= 0.0) == (y0 <= 0.0)
            x0, y0 = np.where(first[:, None], crossing, x0), np.where(first, value, y0)
            x1, y1 = np.where(first[:, None], x1, crossing), np.where(first, y1, value)
        crossings.append(crossing)
    found = np.concatenate(crossings)
    return found[_exists(logical, found)]


def _most_dangerous(
    zones: ZonePartition, zone: int, candidates: FloatArray, cell: float
) -> dict[str, float]:
    """The most dangerous point of a zone: impact speed, then max ITTC, then smaller gap, then the
    smaller row.

    Take the worst of those candidates (n, k) that belong to the zone; then look around it in ever
    smaller windows, the first as wide as a cell; then round it, if the rounded point belongs to the
    zone. The windows are what finds a corner between a constraint and the box, where no grid point
    lies.
    """
    logical, searched = zones.logical, zones.logical.search is not None
    k = len(logical.parameters)
    members = zones.members(zone, candidates)
    best, width = members[_by_danger(zones, members)[0]], cell
    fineness = 3 if searched else {1: 21, 2: 15, 3: 9, 4: 5}.get(k, 3)
    offsets = mesh([np.linspace(-1.0, 1.0, fineness).tolist()] * k)
    for _ in range(200):
        around = logical.from_unit(np.clip(logical.to_unit(best) + width * offsets, 0.0, 1.0))
        rows = np.concatenate([best[None, :], around[logical.feasible(around)]])
        order = _by_danger(zones, rows)
        # The surface costs most: it is asked only about what is worse.
        worse = zones.members(zone, rows[order[: int(np.argmin(order))]])
        if not len(worse):
            width *= 0.4
        else:
            best = worse[0]
        if width < (SEARCHED_WINDOW if searched else 1e-12):
            break
    # to 1e-7 of the box, in the fewest digits that still lie within the zone
    close = SEARCHED_WINDOW if searched else 1e-7
    for digits in range(10):
        short = np.clip(np.round(best, digits), logical.low, logical.high)
        near = np.all(np.abs(logical.to_unit(short) - logical.to_unit(best)) < close)
        if near and len(zones.members(zone, short[None, :])):
            best = short
            break
    return dict(zip(logical.names, best.tolist(), strict=True))


def _by_danger(zones: ZonePartition, points: FloatArray) -> IntArray:
    """The numbers of points (n, k), the most dangerous first."""
    found = criticality(zones.logical, points, zones.settings)
    # Rounded, so that equal danger is a tie and not a matter of the last digit.
    keys = (np.round(found.gap, 9), -np.round(found.inverse, 9), -np.round(found.impact, 9))
    return np.lexsort((*points.T[::-1], *keys))
