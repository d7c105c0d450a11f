"""Safe and hazardous zones of a parameter space, Eqs. 7-8.

A Gaussian process learns from the training points how much time ideal braking leaves; a point is
hazardous where the learnt y <= 0. Zones are the connected hazardous regions of the space: the
points in the box that satisfy the constraints. Distances are taken in the unit box, because a
distance cannot add metres to metres per second. A scenario may name coordinates in which its
criticality is smoother than in its parameters. The GP then learns in those, scaled to a unit box.

Users: `record/` (`points.kept_zones` calls `partition`), `scoring/`, `report/`, `cli/`, `extras/`,
`evaluation.py`; Eq. 16 (`collision_avoidance`).
"""

from __future__ import annotations

import itertools
import math
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

# Most training points from the parameters' steps: the time to fit a GP grows with their cube.
OWN_GRID_POINTS = 1_500
MOST_POINTS = 5_000  # most training points that a caller may give
# Most points of the dense grid in a scenario whose criticality is searched over time, point by
# point.
SEARCHED_GRID = 8_000
ADDED_AT_ONCE = 500  # most training points that one refinement adds
# Unit-box length at which the search for a most dangerous point ends where criticality is searched
# over time.
SEARCHED_WINDOW = 1e-3
EDGE = 1e-9  # unit-box length; a point this close to an edge of the space counts as on the edge
ERROR_WORTH_A_NOTE = 0.01  # share of the space on the wrong side of the GP's boundary
SHALLOW = 0.02  # a zone gets a note if y (-1..0 in a zone) is above -SHALLOW at its worst point


@dataclass(frozen=True, eq=False)
class ZonePartition:
    """The zones of one logical scenario. Points are rows (..., k) in the order and units of
    `logical.parameters`.

    training_points: (n, k), sorted.
    surface: the GP, in the unit box.
    most_dangerous: one point a zone, name -> value, the largest zone first.
    zone_shares: share of the space that each zone takes.
    notes: sentences on what limits the trust in the zones.
    zone_points: points of the dense grid in a zone, unit box, (z, k).
    zone_index: number of the zone of each of these, (z,).
    boundary: points where the dense grid's lines cross y = 0, unit box, (b, k); none if the whole
        space is safe or the whole space is hazardous.

    Methods that take points from outside refuse those outside the box: the GP has learnt nothing
    there.
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

        Exactly +1 or -1 everywhere if all training points agree.
        """
        return self.surface.value(_checked_unit(self.logical, points))

    def hazardous(self, points: ArrayLike) -> BoolArray:
        """Whether y <= 0. Maps and the weights of Eq. 16 use this smooth form of the zones."""
        return self.predicted(points) <= 0.0

    def exactly_hazardous(self, points: ArrayLike) -> BoolArray:
        """Eqs. 5-6: whether max ITTC itself, without the GP, reaches its threshold, (...).

        points: (..., k), in the parameters' units.

        This decides the zone of every case that is driven, because the GP may call a point safe at
        which even ideal braking collides.
        """
        *shape, k = _checked_unit(self.logical, points).shape
        rows = np.asarray(points, dtype=float).reshape(-1, k)
        return exactly_hazardous(self.logical, rows, self.settings).reshape(shape)

    def nearest_zone(self, points: ArrayLike) -> IntArray:
        """Zone of the nearest of the `zone_points`, as its number in `most_dangerous`; -1 without
        zones.
        """
        unit = _checked_unit(self.logical, points)
        if not self.zones:
            return np.full(unit.shape[:-1], -1, dtype=np.intp)
        return self._nearest(unit)

    def _nearest(self, unit: FloatArray) -> IntArray:
        """`nearest_zone` of unit points, where there is a zone."""
        return np.asarray(self.zone_index[self._zone_tree.query(unit)[1]])

    @cached_property
    def _zone_tree(self) -> Any:
        return _tree(self.zone_points)

    @cached_property
    def _boundary_tree(self) -> Any:
        return _tree(self.boundary)

    def members(self, zone: int, points: FloatArray) -> FloatArray:
        """Those of the points (n, k) that satisfy the constraints and belong to a zone."""
        points = points[self.logical.feasible(points)]
        unit = self.logical.to_unit(points)
        inside = (self.surface.value(unit) <= 0.0) & (self._nearest(unit) == zone)
        return np.asarray(points[inside])

    def exists(self, points: ArrayLike) -> BoolArray:
        """Whether each point belongs to the space.

        A point on an edge does, also if rounding has put it beyond the edge by up to 1e-9 of the
        box.
        """
        return _exists(self.logical, _checked_unit(self.logical, points))

    def boundary_distance(self, points: ArrayLike) -> FloatArray:
        """Distance to the zone boundary y = 0 in the unit box: positive in the safe zone, negative
        in a hazardous one.

        inf without a hazardous zone, -inf without a safe one. Edges of the space do not count as
        boundary. The sign is exact. The distance is exact to 1e-6 unless the nearest boundary point
        lies on an edge of the space. Then it is too long, by less than the diagonal of a cell of
        the dense grid (with three parameters 0.05).
        """
        unit = _checked_unit(self.logical, points)
        sign = np.where(self.surface.value(unit) <= 0.0, -1.0, 1.0)
        if not len(self.boundary):
            return np.asarray(sign * np.inf)
        distance, nearest = self._boundary_tree.query(unit)
        foot = self.boundary[nearest]
        # `foot` becomes the boundary point nearest to its point. Each round takes the surface as
        # linear around `foot`, projects the point onto the plane where that is 0, and moves `foot`
        # half of the way there. Whole steps would diverge where the boundary's radius of curvature
        # is less than the distance.
        for _ in range(60):
            slope = self.surface.gradient(foot)
            linear_y = self.surface.value(foot) + np.sum(slope * (unit - foot), axis=-1)
            slope_squared = np.maximum(np.sum(slope**2, axis=-1), np.finfo(float).tiny)
            projected = np.clip(unit - (linear_y / slope_squared)[..., None] * slope, 0.0, 1.0)
            foot = (foot + projected) / 2.0
        refined = np.linalg.norm(foot - unit, axis=-1)
        settled = (np.abs(self.surface.value(foot)) < EDGE) & _exists(self.logical, foot)
        refined = np.where(settled & (refined <= distance), refined, distance)
        return np.asarray(sign * refined)


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
    no zone. If all training points are safe, or all are hazardous, no GP is fitted and the whole
    space counts as such. The order of `points`, and repeated points, change nothing.

    Raises InputError for points outside the box, and for more parameters than a grid has room for.
    """
    from scipy.ndimage import generate_binary_structure, label

    axes, grid_notes = _own_axes(logical)
    if points is None:
        training, notes, rounds = mesh(axes), list(grid_notes), 1 + settings.refinements
    else:  # used as they are, without refinement
        training = _user_points(logical, points)
        notes = []
        rounds = 1

    refined, grid, feasible = _dense_grid(logical, axes, settings)
    unit = logical.to_unit(grid)
    learnt = _learn(logical, training, grid, feasible, settings, rounds)
    notes += learnt.notes

    shape = tuple(map(len, refined))
    hazard = (learnt.y <= 0.0) & feasible
    # Each connected region of the dense grid gets a label from 1 on. The structure connects cells
    # that touch at a corner.
    connected = generate_binary_structure(len(shape), len(shape))
    regions = label(hazard.reshape(shape), structure=connected)[0].ravel()
    # A region without a point that is exactly hazardous is not a zone. Its most dangerous point
    # would lie on its edge. Eq. 16 divides by the distance from there to the edge: weights of up
    # to 10^9.
    real = np.unique(regions[hazard & ~learnt.wrong])
    sizes = np.bincount(regions)
    by_size = real[np.argsort(-sizes[real], kind="stable")]  # the zones' labels, the largest first
    number_of = np.full(len(sizes), -1, dtype=np.intp)  # label -> number of the zone; -1: none
    number_of[by_size] = range(len(real))
    zone = number_of[regions]
    in_zone = zone >= 0
    spurious = hazard & ~in_zone
    if spurious.any():
        share = 100.0 * float(spurious.sum() / feasible.sum())
        notes.append(
            f"{share:.2f} % of the space is hazardous for the GP alone, and forms no zone."
        )
    surface = learnt.surface
    # The search for the most dangerous points asks this partition which points belong to a zone.
    # These points, the boundary and the notes are filled in afterwards.
    zones = ZonePartition(
        logical=logical,
        settings=settings,
        training_points=learnt.training,
        surface=surface,
        most_dangerous=(),
        zone_shares=tuple((sizes[by_size] / feasible.sum()).tolist()),
        notes=(),
        zone_points=unit[in_zone],
        zone_index=zone[in_zone],
        boundary=unit[:0],
    )
    if len(real):
        crossings = _crossings(logical, surface, unit.reshape(*shape, -1), learnt.y.reshape(shape))
        cell = max(1.0 / (len(axis) - 1) for axis in refined)  # unit-box width of the widest cell
        worst = tuple(
            _most_dangerous(zones, number, np.concatenate([grid[zone == number], training]), cell)
            for number in range(len(real))
        )
        zones = replace(zones, most_dangerous=worst, boundary=crossings)
        y_at_worst = surface.value(logical.to_unit([logical.row(point) for point in worst]))
        notes += [
            f"The GP has the most dangerous point {point_words(worst[number])} near its zone's "
            "edge: the weights r near that zone are uncertain."
            for number in np.flatnonzero(y_at_worst > -SHALLOW)
        ]
    # `logical.notes` already say that a scenario without a criterion has no zones
    has_criterion = logical.approach or logical.search or logical.margin
    return replace(zones, notes=tuple(notes) if has_criterion else ())


def refuse_impossible_zones(logical: LogicalScenario, settings: ZoneSettings) -> None:
    """Raise the InputErrors of `partition` without fitting a GP.

    Where criticality is searched over time (`asks_some`), it is computed at every eighth point of
    the dense grid only, to save time.
    """
    axes, _ = _own_axes(logical)
    _, grid, feasible = _dense_grid(logical, axes, settings)
    # computed only for the errors that a scenario's own functions raise
    exactly_hazardous(logical, grid[feasible][:: 8 if asks_some(logical) else 1], settings)
    training = mesh(axes)
    criticality(logical, training, settings)
    coordinates(logical, training)  # raises where the scenario's own ones fail


def _dense_grid(
    logical: LogicalScenario, axes: list[list[float]], settings: ZoneSettings
) -> tuple[list[list[float]], FloatArray, BoolArray]:
    """Axes of the dense grid, its points (n, k), and which of them satisfy the constraints."""
    most = settings.grid_points
    refined = _refine(axes, most if logical.search is None else min(most, SEARCHED_GRID))
    grid = mesh(refined)
    feasible = logical.feasible(grid)
    if not feasible.any():
        raise InputError(
            f"Scenario `{logical.name}` must have points that satisfy its constraints: none of "
            f"{len(grid)} do."
        )
    return refined, grid, feasible


def fitted_parts(zones: ZonePartition) -> dict[str, Any]:
    """Fields of a partition as they are stored; `of_parts` restores the partition.

    Not stored: the scenario and the settings, which the caller of `of_parts` has, and the surface's
    `coordinates`, a function that follows from the scenario and the training points.
    """
    # all fields after `logical` and `settings`
    parts = {item.name: getattr(zones, item.name) for item in fields(zones)[2:]}
    return parts | {"surface": replace(zones.surface, coordinates=None)}


def of_parts(
    logical: LogicalScenario, settings: ZoneSettings, parts: dict[str, Any]
) -> ZonePartition:
    """The partition of a scenario under these settings, from its `fitted_parts`."""
    learnt_in = coordinates(logical, parts["training_points"])
    surface = replace(parts["surface"], coordinates=learnt_in)
    return ZonePartition(logical, settings, **parts | {"surface": surface})


class BoundaryError(NamedTuple):
    """Share of misclassified points: over the whole box, and over the points that satisfy the
    constraints.
    """

    box: float
    feasible: float


@lru_cache(maxsize=64)  # evaluations in one process share a partition, and its error
def boundary_error(zones: ZonePartition, n: int | None = None) -> BoundaryError:
    """Compare a partition with the criterion itself (max ITTC >= ITTC*) at n evenly spread points
    of the box.

    zones: the partition.
    n: by default 50,000, or 2,000 where max ITTC is searched over time.

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


# --- training -------------------------------------------------------------------------------------


class _Learnt(NamedTuple):
    """Outcome of one fit of the GP.

    training: training points, (n, k).
    surface: the GP that was fitted to them.
    y: on the dense grid, (g,).
    wrong: where y has the wrong sign at a point that satisfies the constraints, (g,).
    notes: sentences on what limits the trust in the surface.
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
    """Fit the GP in up to `rounds` rounds, and return the round with the fewest wrong grid points.

    training: training points of the first round, (n, k).
    grid: points of the dense grid, (g, k).
    feasible: which of these satisfy the constraints, (g,).

    As long as more than `ERROR_WORTH_A_NOTE` of the dense grid is on the wrong side, some of those
    points become training points of the next round.
    """
    exact = np.zeros(len(grid), dtype=bool)
    exact[feasible] = exactly_hazardous(logical, grid[feasible], settings)
    unit, n_first, n_feasible = logical.to_unit(grid), len(training), int(feasible.sum())
    fits: list[_Learnt] = []
    for _ in range(rounds):
        danger = criticality(logical, training, settings)
        target = danger.target
        if settings.target == "label":  # the zone alone, without how far the point is inside it
            target = np.where(danger.inverse >= settings.critical_inverse_ttc, -1.0, 1.0)
        surface, notes = fit(logical, training, target, settings)
        y = surface.value(unit)
        wrong = feasible & ((y <= 0.0) != exact)
        if added := len(training) - n_first:
            notes += [f"{added} training points were added where the GP was on the wrong side."]
        fits.append(_Learnt(training, surface, y, wrong, tuple(notes)))
        if wrong.sum() <= ERROR_WORTH_A_NOTE * n_feasible:
            break
        more = np.random.default_rng(SEED).permutation(np.flatnonzero(wrong))[:ADDED_AT_ONCE]
        training = np.unique(np.concatenate([training, grid[more]]), axis=0)
    best = min(fits, key=lambda fit: int(fit.wrong.sum()))
    share = best.wrong.sum() / n_feasible
    if share > ERROR_WORTH_A_NOTE:
        remark = f"The GP puts {100 * share:.1f} % of the space in the wrong zone: add points."
        best = best._replace(notes=(*best.notes, remark))
    return best


# --- points ---------------------------------------------------------------------------------------


def _own_axes(logical: LogicalScenario) -> tuple[list[list[float]], tuple[str, ...]]:
    """The values of each parameter at its `step`, fewer where the grid of them is too large for a
    GP, and a note on that.

    Raises InputError where two values of each parameter are too many.
    """
    counts = [_own_count(parameter) for parameter in logical.parameters]
    own = math.prod(counts)
    # parameters of which two values each still fit: 2**most points
    most = OWN_GRID_POINTS.bit_length() - 1
    if len(counts) > most:
        raise InputError(
            f"Scenario `{logical.name}` must have at most {most} parameters, since its zones are "
            f"learnt from a grid, got {len(counts)}: give some of them a fixed value."
        )
    # Take a value from the longest axis until the grid is small enough. An axis that alone is too
    # long is cut at once.
    while math.prod(counts) > OWN_GRID_POINTS:
        counts[counts.index(max(counts))] = min(max(counts) - 1, OWN_GRID_POINTS)
    axes = list(map(_axis, logical.parameters, counts))
    if math.prod(counts) == own:
        return axes, ()
    return axes, (
        f"The zones were learnt from a grid of {math.prod(counts)} points, coarser than the "
        f"scenario's own of {own}.",
    )


def _own_count(parameter: Parameter) -> int:
    """Number of values of a parameter: low, low + step, ... and high."""
    extent = decimal(parameter.high) - decimal(parameter.low)
    return math.ceil(extent / decimal(parameter.step)) + 1


def _axis(parameter: Parameter, count: int) -> list[float]:
    """Low, low + step, ... and high; if `count` is too small for these, evenly spaced values."""
    if count < _own_count(parameter):
        return evenly(parameter, count)
    low, step = decimal(parameter.low), decimal(parameter.step)
    return [*(float(low + step * index) for index in range(count - 1)), float(parameter.high)]


def _refine(axes: list[list[float]], most: int) -> list[list[float]]:
    """Split every interval of the axes into equally many parts: as many as keep the grid within
    `most` points. The old values stay on the axes.

    The values are computed as decimals: two parameters that a constraint compares must get equal
    floats where their values are equal.
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


def _user_points(logical: LogicalScenario, points: ArrayLike) -> FloatArray:
    """Training points of a caller, sorted, each once. Raises InputError as `partition` does."""
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
    """Whether each unit point (..., k) satisfies the constraints, itself or after a step of `EDGE`
    up or down along any of the axes.
    """
    holds = np.asarray(logical.feasible(logical.from_unit(unit)))
    if not holds.all():
        nudges = EDGE * mesh([[-1.0, 0.0, 1.0]] * unit.shape[-1])
        nudged = np.clip(unit[~holds][:, None, :] + nudges, 0.0, 1.0)
        holds[~holds] = logical.feasible(logical.from_unit(nudged)).any(axis=1)
    return holds


# --- zones ----------------------------------------------------------------------------------------


def _crossings(
    logical: LogicalScenario, surface: Surface, unit: FloatArray, y: FloatArray
) -> FloatArray:
    """Points of the space where a line between neighbours on the dense grid crosses y = 0, (m, k).

    unit: points of the grid, unit box, (..., k).
    y: the GP's value at each, (...).
    """
    parts = []
    for axis in range(y.ndim):
        # neighbours along this axis are neighbours along the first axis of these
        along_y, along_unit = np.moveaxis(y, axis, 0), np.moveaxis(unit, axis, 0)
        changes = (along_y[:-1] <= 0.0) != (along_y[1:] <= 0.0)
        y0, y1 = along_y[:-1][changes], along_y[1:][changes]
        x0, x1 = along_unit[:-1][changes], along_unit[1:][changes]
        # Five steps of regula falsi put each crossing onto the curved surface. One straight line
        # would put it off the boundary, and `boundary_distance` would be too short.
        for _ in range(5):
            crossing = x0 + (y0 / (y0 - y1))[:, None] * (x1 - x0)
            value = surface.value(crossing)
            replaces_0 = (value <= 0.0) == (y0 <= 0.0)
            x0, y0 = np.where(replaces_0[:, None], crossing, x0), np.where(replaces_0, value, y0)
            x1, y1 = np.where(replaces_0[:, None], x1, crossing), np.where(replaces_0, y1, value)
        parts.append(crossing)
    crossings = np.concatenate(parts)
    return crossings[_exists(logical, crossings)]


def _most_dangerous(
    zones: ZonePartition, zone: int, candidates: FloatArray, cell: float
) -> dict[str, float]:
    """The most dangerous point of a zone, in the order of `_by_danger`.

    zone: its number.
    candidates: points at which the search may begin, (n, k).
    cell: half of the first window's width, unit box.

    The search begins at the worst candidate in the zone. It looks around that point in a window,
    moves to a worse point of the zone or else shrinks the window, and so on. The windows find
    corners between a constraint and the box, where no grid point lies. At last the point is rounded
    if it stays in the zone.
    """
    logical, searched = zones.logical, zones.logical.search is not None
    k = len(logical.parameters)
    members = zones.members(zone, candidates)
    best, half_width = members[_by_danger(zones, members)[0]], cell
    # values on each axis of a window; fewer with more parameters, as a window has their k-th power
    values_per_axis = 3 if searched else {1: 21, 2: 15, 3: 9, 4: 5}.get(k, 3)
    offsets = mesh([np.linspace(-1.0, 1.0, values_per_axis).tolist()] * k)
    for _ in range(200):  # a bound; usually the window is small enough long before
        around = logical.from_unit(np.clip(logical.to_unit(best) + half_width * offsets, 0.0, 1.0))
        rows = np.concatenate([best[None, :], around[logical.feasible(around)]])
        order = _by_danger(zones, rows)
        # `best` is row 0. Its place in `order` is argmin(order); the rows before it are worse. Only
        # these are looked up in the zone, because the GP takes most of the time.
        worse = zones.members(zone, rows[order[: int(np.argmin(order))]])
        if not len(worse):
            half_width *= 0.4
        else:
            best = worse[0]
        if half_width < (SEARCHED_WINDOW if searched else 1e-12):
            break
    # the fewest digits with which the point moves by less than `tolerance` and stays in the zone
    tolerance = SEARCHED_WINDOW if searched else 1e-7  # unit-box length
    for digits in range(10):  # at 10 digits and more, the point stays as it is
        rounded = np.clip(np.round(best, digits), logical.low, logical.high)
        near = np.all(np.abs(logical.to_unit(rounded) - logical.to_unit(best)) < tolerance)
        if near and len(zones.members(zone, rounded[None, :])):
            best = rounded
            break
    return dict(zip(logical.names, best.tolist(), strict=True))


def _by_danger(zones: ZonePartition, points: FloatArray) -> IntArray:
    """Indices of points (n, k), the most dangerous first: by impact speed, then by max ITTC, then
    by the smaller gap, then by the smaller parameters.
    """
    danger = criticality(zones.logical, points, zones.settings)
    # rounded, so that the last digit does not decide between points of equal danger
    keys = (np.round(danger.gap, 9), -np.round(danger.inverse, 9), -np.round(danger.impact, 9))
    return np.lexsort((*points.T[::-1], *keys))  # the last key counts first
