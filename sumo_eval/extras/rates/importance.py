"""The probability of a collision in one scenario, from few drives: points drawn where collisions
are likely and met, each weighted by how much more often it was drawn than it is met.

First, drives explore: where points are met and ideal braking comes near its limits, then where what
was driven so far says that the edge of the collisions is. Then others are drawn that count. A drive
that counts comes with `DEFENSIVE` from what is met on the road, else from a mixture of Gaussians
laid over the points that probably collide, weighted by how often they are met. The estimate is
unbiased whatever the exploration found: each round's mixture is fixed before its points are drawn.
What it misses, it misses in the interval alone: a collision where nobody looked has a large weight,
and widens it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.extras.studies.straddle import BoundarySearch
from sumo_eval.method.zone_partition import danger
from sumo_eval.scenario.formulas import ExposureDensity
from sumo_eval.scenario.joint import Joint
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.settings import ZoneSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray

DEFENSIVE: Final = 0.2  # share of the drives that count which are drawn as points are met
EXPLORED: Final = 0.4  # share of a budget that explores, at most
FIRST: Final = 24  # drives of the first exploring round, and 8 more a parameter
ROUND: Final = 0.2  # share of the budget that a further round has
POOL: Final = 4096  # points of each kind that a round weighs
ASKED: Final = 1024  # of these whose danger is computed
# how far beyond the points that are met the pool reaches, in their own deviations
STRETCHED: Final = 2.5
LIKELY: Final = 0.3  # probability of a collision from which a point belongs to the mixture
SURE: Final = 0.8  # probability from which it belongs to the second mixture
CENTRES: Final = 256  # Gaussians in the mixture
POLISHED: Final = 3  # times that the mixture is fitted to draws from itself
NORMALISED: Final = 65_536  # draws by which the share of possible points is found
LEVEL: Final = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class Met:
    """Exposure of a scenario's points, as a density that integrates to 1 over the possible ones.

    base: draws points as often as parameters are met, constraints aside; base_density: their
        density.

    scale: the exposure's integral.
    """

    logical: LogicalScenario
    joint: Joint | None
    scale: float
    heaviest: float

    def base(self, count: int, stream: np.random.Generator) -> FloatArray:
        """Points (count, k), possible or not."""
        if self.joint is not None:
            return self.joint.draw(count, stream)
        return _independent(self.logical, stream.uniform(size=(count, len(self.logical.names))))

    def base_density(self, points: FloatArray) -> FloatArray:
        """The density (n,) of `base` at points (n, k)."""
        if self.joint is not None:
            return self.joint.density(points) / self.joint.mass()
        return _independent_density(self.logical, points)

    def density(self, points: FloatArray) -> FloatArray:
        """p (n,) at points (n, k): 0 outside the box and where a constraint forbids them."""
        found = np.zeros(len(points))
        inside = self.logical.in_box(points)
        if inside.any():
            inside[inside] = self.logical.feasible(points[inside])
        if inside.any():
            rows = points[inside]
            found[inside] = (
                np.broadcast_to(self.logical.exposure(self.logical.columns(rows)), len(rows))
                / self.scale
            )
        return found


def how_met(logical: LogicalScenario) -> Met:
    """Exposure of a scenario's points: by its joint distribution, else by its parameters' own."""
    listed = [item.name for item in logical.parameters if item.values]
    if listed:
        raise InputError(
            f"`{listed[0]}` of scenario `{logical.name}` has listed values only: a campaign draws "
            "from ranges."
        )
    joint = logical.exposure.joint if isinstance(logical.exposure, ExposureDensity) else None
    plain = Met(logical, joint, 1.0, 1.0)
    drawn = plain.base(NORMALISED, random_stream(0, "normalised", logical.name))
    ratio = plain.density(drawn) / np.maximum(plain.base_density(drawn), 1e-300)
    scale = float(ratio.mean())
    if not (math.isfinite(scale) and scale > 0.0):
        raise InputError(f"No point of scenario `{logical.name}` that is met is possible.")
    return Met(logical, joint, scale, float(ratio.max()) / scale)


def _independent(logical: LogicalScenario, shares: FloatArray) -> FloatArray:
    columns = [
        item.low + shares[:, j] * (item.high - item.low)
        if item.distribution is None
        else item.distribution.quantile(shares[:, j], item.low, item.high)
        for j, item in enumerate(logical.parameters)
    ]
    return np.column_stack(columns)


def _independent_density(logical: LogicalScenario, points: FloatArray) -> FloatArray:
    found = logical.in_box(points).astype(np.float64)
    for j, item in enumerate(logical.parameters):
        if item.distribution is None:
            found /= item.high - item.low
        else:
            found *= item.distribution.density(points[:, j], item.low, item.high)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """Gaussians of one covariance in the unit box. centres (m, k), root (k, k) of the
    covariance.
    """

    centres: FloatArray
    root: FloatArray

    def draw(self, count: int, stream: np.random.Generator) -> FloatArray:
        """Points (count, k) of the unit box's coordinates."""
        chosen = stream.integers(len(self.centres), size=count)
        return (
            self.centres[chosen]
            + stream.standard_normal((count, self.centres.shape[1])) @ self.root.T
        )

    def density(self, unit: FloatArray) -> FloatArray:
        """Density (n,) there."""
        whiten = np.linalg.inv(self.root)
        centres, white = self.centres @ whiten.T, unit @ whiten.T
        squared = (
            (white**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * white @ centres.T
        )
        norm = abs(float(np.linalg.det(whiten))) / (2.0 * math.pi) ** (unit.shape[1] / 2.0)
        return np.asarray(np.exp(-0.5 * np.maximum(squared, 0.0)).mean(axis=1) * norm)


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Points to drive. points (n, k); weights (n,) p/q;

    counts: drawn for the estimate, of which `drawn` in all, the impossible ones included; else for
        exploring alone.
    """

    points: FloatArray
    weights: FloatArray
    counts: bool
    drawn: int


@dataclass(slots=True)
class RareEvents:
    """The search: ask for points, tell what happened there, estimate. Same seed and outcomes, same
    questions.

    drives: how many were asked for.
    drawn: points for the estimate, the impossible ones included.
    """

    met: Met
    budget: int
    seed: int = 1
    loss: FloatArray = field(init=False, default_factory=lambda: np.empty(0))
    weights: FloatArray = field(init=False, default_factory=lambda: np.empty(0))
    counted: BoolArray = field(init=False, default_factory=lambda: np.empty(0, dtype=np.bool_))
    drawn: int = field(init=False, default=0)
    drives: int = field(init=False, default=0)
    _search: BoundarySearch = field(init=False)
    _batches: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._search = BoundarySearch(self.met.logical, self.seed)

    @property
    def points(self) -> FloatArray:
        """Where drives were, (n, k)."""
        return self._search.points

    @property
    def collided(self) -> BoolArray:
        """How they ended, (n,)."""
        return self._search.outcomes

    @property
    def exploring(self) -> bool:
        """Whether the next round explores."""
        return self.drives < EXPLORED * self.budget

    def ask(self) -> Batch:
        """The next points to drive; none once the budget is spent."""
        stream = random_stream(self.seed, "importance", self.met.logical.name, self._batches)
        self._batches += 1
        left = self.budget - self.drives
        if self.drives == 0:
            size = min(
                left, FIRST + 8 * len(self.met.logical.names), max(1, int(EXPLORED * self.budget))
            )
        else:
            size = min(left, max(8, int(ROUND * self.budget)))
        if size <= 0:
            return Batch(np.empty((0, self.points.shape[1])), np.empty(0), True, 0)
        batch = self._explore(size, stream) if self.exploring else self._count(size, stream)
        self.drives += len(batch.points)
        return batch

    def tell(self, batch: Batch, collided: BoolArray, loss: FloatArray) -> None:
        """Outcomes at a batch's points: collisions (n,) and losses (n,), 0 without."""
        self.loss = np.concatenate([self.loss, loss])
        self.weights = np.concatenate([self.weights, batch.weights])
        self.counted = np.concatenate([self.counted, np.full(len(collided), batch.counts)])
        self.drawn += batch.drawn if batch.counts else 0
        self._search.tell(batch.points, collided)

    # -- exploring

    def _explore(self, size: int, stream: np.random.Generator) -> Batch:
        points, density, pool_density = self._pool(stream)
        level = density / density.max()
        if self._knows_both:
            chance = self._search.probability(points)
            edge = np.sqrt(level) * chance * (1.0 - chance) / pool_density
            core = level * (chance > 0.5) / pool_density
            half = size // 2
            rows = np.concatenate(
                [_pick(points, edge, size - half, stream), _pick(points, core, half, stream)]
            )
        else:
            met_at_all = level**0.25 / pool_density
            chosen = _pick(points, met_at_all, ASKED, stream)
            rows = _pick(chosen, 0.05 + self._danger(chosen), size, stream)
        rows = np.unique(rows, axis=0)
        return Batch(rows, np.zeros(len(rows)), False, 0)

    @property
    def _knows_both(self) -> bool:
        return bool(self.collided.any() and not self.collided.all())

    def _danger(self, points: FloatArray) -> FloatArray:
        return danger(self.met.logical, points, ZoneSettings())

    def _pool(self, stream: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Possible points (m, k) near and far from the exposed ones, p there, and the density they
        were drawn with.
        """
        logical = self.met.logical
        base = self.met.base(POOL, stream)
        middle = np.median(base, axis=0)
        wide = middle + STRETCHED * (self.met.base(POOL, stream) - middle)
        points = np.concatenate([base, wide, evenly(logical, POOL, stream)])
        density = self.met.density(points)
        points, density = points[density > 0.0], density[density > 0.0]
        near = middle + (points - middle) / STRETCHED
        volume = float(np.prod(logical.high - logical.low))
        mixed = self.met.base_density(points)
        mixed = mixed + self.met.base_density(near) / STRETCHED ** len(middle) + 1.0 / volume
        return points, density, mixed / 3.0

    # -- drives that count

    def _count(self, size: int, stream: np.random.Generator) -> Batch:
        logical, mixtures = self.met.logical, self._mixtures(stream)
        rows = self.met.base(size, stream)
        defensive = DEFENSIVE if mixtures else 1.0
        whose = stream.uniform(size=size)
        volume = float(np.prod(logical.high - logical.low))
        for number, mixture in enumerate(mixtures):
            chosen = (whose >= defensive) & ((np.arange(size) % len(mixtures)) == number)
            rows = np.where(chosen[:, None], logical.from_unit(mixture.draw(size, stream)), rows)
        density = self.met.density(rows)
        possible = density > 0.0
        rows, density = rows[possible], density[possible]
        proposal = defensive * self.met.base_density(rows)
        for number, mixture in enumerate(mixtures):
            share = len(range(number, size, len(mixtures))) / size
            proposal = (
                proposal
                + (1.0 - defensive) * share * mixture.density(logical.to_unit(rows)) / volume
            )
        return Batch(rows, density / proposal, True, size)

    def _mixtures(self, stream: np.random.Generator) -> list[Mixture]:
        """Gaussians over points that may collide, and over those that almost surely do; over
        dangerous ones as long as no drive collided. None where there are none.

        Where nothing is known the classifier says 0.5; the second mixture keeps such places from
        taking all drives.
        """
        points, density, drawn_with = self._pool(stream)
        pool = points, density, drawn_with
        if not self.collided.any():
            few = tuple(item[:: max(1, len(points) // ASKED)] for item in pool)
            found = [
                _fitted(
                    self.met.logical.to_unit(few[0]),
                    few[1] * self._danger(few[0]) ** 2 / few[2],
                    stream,
                )
            ]
        elif not self._knows_both:
            found = [_fitted(self.met.logical.to_unit(points), density / drawn_with, stream)]
        else:
            found = [self._polished(pool, least, stream) for least in (LIKELY, SURE)]
        return [mixture for mixture in found if mixture is not None]

    def _polished(
        self,
        pool: tuple[FloatArray, FloatArray, FloatArray],
        least: float,
        stream: np.random.Generator,
    ) -> Mixture | None:
        """Gaussians over points that collide with at least this probability, refitted to draws
        of its own.
        """
        logical = self.met.logical
        points, density, drawn_with = pool
        weight = density * (self._search.probability(points) > least) / drawn_with
        mixture = _fitted(logical.to_unit(points), weight, stream)
        if mixture is None:  # nothing in the pool will do: where drives collided, then
            there = self.points[self.collided]
            mixture = _fitted(logical.to_unit(there), np.sqrt(self.met.density(there)), stream)
        for _ in range(POLISHED if mixture is not None else 0):
            assert mixture is not None
            unit = mixture.draw(POOL, stream)
            rows = logical.from_unit(unit)
            density = self.met.density(rows)
            possible = density > 0.0
            if possible.sum() < CENTRES // 4:
                break
            collides = self._search.probability(rows[possible]) > least
            weight = density[possible] * collides / mixture.density(unit[possible])
            mixture = _fitted(unit[possible], weight, stream) or mixture
        return mixture

    # -- what came of it

    def estimate(self) -> Estimate:
        """The estimate from the counted drives."""
        hits = self.counted & self.collided
        return estimated(
            self.weights[hits],
            self.loss[hits],
            self.drawn,
            self.met.heaviest,
            int(self.collided.sum()),
            self.drives,
        )


def _pick(
    points: FloatArray, weight: FloatArray, count: int, stream: np.random.Generator
) -> FloatArray:
    """`count` of the points, in proportion to their weights, none twice; fewer where fewer have
    any.
    """
    possible = np.flatnonzero(weight > 0.0)
    count = min(count, len(possible))
    if not count:
        return points[:0]
    chosen = stream.choice(
        possible, size=count, replace=False, p=weight[possible] / weight[possible].sum()
    )
    return np.asarray(points[chosen])


def _fitted(unit: FloatArray, weight: FloatArray, stream: np.random.Generator) -> Mixture | None:
    """A mixture over weighted points of the unit box; None where fewer than k + 2 of them count."""
    if not np.all(np.isfinite(weight)) or weight.sum() <= 0.0:
        return None
    share = weight / weight.sum()
    k = unit.shape[1]
    effective = 1.0 / float((share**2).sum())
    if effective < k + 2:  # all hangs on a few points: the few heaviest ones, alike
        share = np.zeros(len(share))
        share[np.argsort(weight)[-min(4 * (k + 2), int((weight > 0).sum())) :]] = 1.0
        share /= share.sum()
        effective = 1.0 / float((share**2).sum())
        if effective < 2.0:
            return None
    centred = unit - share @ unit
    covariance = (centred * share[:, None]).T @ centred + 1e-8 * np.eye(k)
    picks = np.searchsorted(np.cumsum(share), (stream.uniform() + np.arange(CENTRES)) / CENTRES)
    width = min(effective, CENTRES) ** (-1.0 / (k + 4))
    return Mixture(unit[np.minimum(picks, len(unit) - 1)], width * np.linalg.cholesky(covariance))


@dataclass(frozen=True, slots=True)
class Estimate:
    """A probability of collision, and the expected loss L of Eq. 14, of an encounter, each with its
    95 % limits.

    deviation: standard error over the value.
    upper_limit: 95 % of the probability whatever the collisions may look like, by the points drawn
        as they are met alone; the interval's upper end where no drive that counted collided.
    drives: all of them;
    hits: collisions among the `drawn` points that counted.
    """

    probability: float
    interval: tuple[float, float]
    loss: float
    loss_interval: tuple[float, float]
    deviation: float
    upper_limit: float
    drives: int
    drawn: int
    hits: int
    collisions: int


def estimated(
    weights: FloatArray, loss: FloatArray, drawn: int, heaviest: float, collisions: int, drives: int
) -> Estimate:
    """weights, loss: p/q and L (h,) of the hits among `drawn` points.
    heaviest: the largest p over the density of points drawn as they are met.
    """
    limit = 1.0 if not drawn else min(1.0, -math.log(1.0 - LEVEL) * heaviest / (DEFENSIVE * drawn))
    if not len(weights):
        return Estimate(
            0.0, (0.0, limit), 0.0, (0.0, limit), math.inf, limit, drives, drawn, 0, collisions
        )
    value, low, high, deviation = _mean(weights, drawn)
    mean_loss, loss_low, loss_high, _ = _mean(weights * loss, drawn)
    return Estimate(
        probability=min(value, 1.0),
        interval=(low, min(high, 1.0)),
        loss=min(mean_loss, 1.0),
        loss_interval=(loss_low, min(loss_high, 1.0)),
        deviation=deviation,
        upper_limit=limit,
        drives=drives,
        drawn=drawn,
        hits=len(weights),
        collisions=collisions,
    )


def _mean(terms: FloatArray, drawn: int) -> tuple[float, float, float, float]:
    """Mean of `drawn` terms, all but these 0, its limits by a log-normal distribution with
    Student's quantile, and its relative error.
    """
    from scipy.special import stdtrit

    mean = float(terms.sum()) / drawn
    variance = max(float((terms**2).sum()) / drawn - mean**2, 0.0) / max(drawn - 1, 1)
    relative = math.sqrt(variance) / mean if mean > 0.0 else math.inf
    reach = float(stdtrit(degrees_of_freedom(terms), (1.0 + LEVEL) / 2.0)) * math.sqrt(
        math.log1p(relative**2)
    )
    return mean, mean * math.exp(-reach), mean * math.exp(min(reach, 50.0)), relative


def degrees_of_freedom(terms: FloatArray) -> float:
    """How much a mean of terms (h,) knows of its own error: as many as count effectively, less one;
    at least one.
    """
    squares = float((terms**2).sum())
    return max(float(terms.sum() ** 2) / squares - 1.0, 1.0) if squares > 0.0 else 1.0


def resampled(met: Met, count: int, seed: int) -> list[tuple[Any, float]]:
    """Joint distributions over resampled events, each with how many events it has over how many
    there are.

    Each event counts as often as a Poisson draw of mean 1 says: what another stretch of road would
    have shown.
    """
    from dataclasses import replace

    if met.joint is None:
        return []
    stream = random_stream(seed, "events", met.logical.name)
    n = len(met.joint.events)
    found: list[tuple[Any, float]] = []
    for _ in range(count):
        weights = stream.poisson(1.0, n).astype(np.float64)
        found.append(
            (replace(met.joint, weights=tuple((weights + 1e-9).tolist())), float(weights.sum()) / n)
        )
    return found
