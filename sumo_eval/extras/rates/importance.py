"""Probability of a collision in one scenario, from few drives, by importance sampling.

Points are drawn where collisions are likely and encountered; each is weighted by its exposure over
the density that it was drawn with.

First, drives explore: where exposed points are and ideal braking comes near its limits, then where
the drives so far put the edge of the collisions. Then drives are drawn that count: `DEFENSIVE` of
them by exposure, the rest from a mixture of Gaussians laid over the points that probably collide,
weighted by exposure. The estimate is unbiased whatever the exploration saw: each round's mixture is
fixed before its points are drawn. A collision outside the explored region has a large weight, and
widens the interval.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from sumo_eval.errors import InputError
from sumo_eval.extras.studies.straddle import BoundarySearch
from sumo_eval.method.point_criticality import danger
from sumo_eval.scenario.formulas import ExposureDensity
from sumo_eval.scenario.joint import Joint, bells
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.settings import ZoneSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray

DEFENSIVE = 0.2  # share of the drives that count which are drawn by exposure
EXPLORED = 0.4  # share of a budget that explores, at most
FIRST = 24  # drives of the first exploring round, and 8 more a parameter
ROUND = 0.2  # share of the budget that a further round has
POOL = 4096  # points of each kind that a round weighs
ASKED = 1024  # of these whose danger is computed
# how far beyond the exposed points the pool reaches, in their own deviations
STRETCHED = 2.5
LIKELY = 0.3  # probability of a collision from which a point belongs to the mixture
SURE = 0.8  # probability from which it belongs to the second mixture
CENTRES = 256  # Gaussians in the mixture
POLISHED = 3  # times that the mixture is fitted to draws from itself
NORMALISED = 65_536  # draws by which the share of possible points is measured
LEVEL = 0.95

Limits = tuple[float, float, float]
"""A value and its 95 % limits."""


class Met(NamedTuple):
    """Exposure of a scenario's points, as a density that integrates to 1 over the possible ones.

    base: draws points by exposure, constraints aside; base_density: their density.
    scale: the exposure's integral.
    heaviest: largest density over base_density.
    """

    logical: LogicalScenario
    joint: Joint | None
    scale: float = 1.0
    heaviest: float = 1.0

    def base(self, count: int, stream: np.random.Generator) -> FloatArray:
        """Points (count, k), possible or not."""
        if self.joint is not None:
            return self.joint.draw(count, stream)
        shares = stream.uniform(size=(count, len(self.logical.names)))
        points = self.logical.from_unit(shares)
        for column, item in enumerate(self.logical.parameters):
            if item.distribution is not None:
                points[:, column] = item.distribution.quantile(
                    shares[:, column], item.low, item.high
                )
        return points

    def base_density(self, points: FloatArray) -> FloatArray:
        """The density (n,) of `base` at points (n, k)."""
        if self.joint is not None:
            return self.joint.density(points) / self.joint.mass()
        density = self.logical.in_box(points).astype(np.float64)
        for column, item in zip(points.T, self.logical.parameters, strict=True):
            if item.distribution is None:
                density /= item.high - item.low
            else:
                density *= item.distribution.density(column, item.low, item.high)
        return density

    def density(self, points: FloatArray) -> FloatArray:
        """p (n,) at points (n, k): 0 outside the box and where a constraint forbids them."""
        density = np.zeros(len(points))
        inside = self.logical.in_box(points)
        if inside.any():
            inside[inside] = self.logical.feasible(points[inside])
        if inside.any():
            density[inside] = self.logical.exposure(self.logical.columns(points[inside]))
        return density / self.scale


def how_met(logical: LogicalScenario) -> Met:
    """Exposure of a scenario's points: by its joint distribution, else by its parameters' own."""
    listed = [item.name for item in logical.parameters if item.values]
    if listed:
        raise InputError(
            f"Scenario `{logical.name}` must have ranges, from which a campaign draws, got listed "
            f"values of `{listed[0]}`."
        )
    joint = logical.exposure.joint if isinstance(logical.exposure, ExposureDensity) else None
    plain = Met(logical, joint)
    drawn = plain.base(NORMALISED, random_stream(0, "normalised", logical.name))
    ratio = plain.density(drawn) / np.maximum(plain.base_density(drawn), 1e-300)
    scale = ratio.mean()
    if not (math.isfinite(scale) and scale > 0.0):
        raise InputError(f"Scenario `{logical.name}` must have possible points, got none.")
    return plain._replace(scale=scale, heaviest=ratio.max() / scale)


class Mixture(NamedTuple):
    """Gaussians of one covariance in the unit box. centres (m, k), root (k, k) of the
    covariance.
    """

    centres: FloatArray
    root: FloatArray

    def draw(self, count: int, stream: np.random.Generator) -> FloatArray:
        """Points (count, k) of the unit box's coordinates."""
        chosen = self.centres[stream.integers(len(self.centres), size=count)]
        return chosen + stream.standard_normal(chosen.shape) @ self.root.T

    def density(self, unit: FloatArray) -> FloatArray:
        """Density (n,) there."""
        whiten = np.linalg.inv(self.root)
        centres, white = self.centres @ whiten.T, unit @ whiten.T
        norm = abs(np.linalg.det(whiten)) / (2.0 * math.pi) ** (unit.shape[1] / 2.0)
        return np.asarray(bells(white, centres).mean(axis=1) * norm)


class Draw(NamedTuple):
    """Points to drive. points (n, k); weights (n,) p/q.

    drawn: points for the estimate, the impossible ones included; 0: for exploring alone.
    """

    points: FloatArray
    weights: FloatArray
    drawn: int


Pool = tuple[FloatArray, FloatArray, FloatArray]
"""Possible points (m, k) near and far from the exposed ones, p there, and the density that they
were drawn with."""


class RareEvents:
    """The search: ask for points, tell what happened there, estimate. Same seed and outcomes, same
    questions.

    drives: how many were asked for.
    drawn: points for the estimate, the impossible ones included.
    in_estimate: (n,), whether each drive counts in the estimate; one that explores does not.
    weights, loss: (n,), of each drive.
    """

    def __init__(self, met: Met, budget: int, seed: int = 1) -> None:
        self.met, self.budget, self.seed = met, budget, seed
        self.loss, self.weights = np.empty(0), np.empty(0)
        self.in_estimate = np.empty(0, dtype=np.bool_)
        self.drawn = self.drives = self._rounds = 0
        self._search = BoundarySearch(met.logical, seed)

    @property
    def points(self) -> FloatArray:
        """Points of the drives, (n, k)."""
        return self._search.points

    @property
    def collided(self) -> BoolArray:
        """Whether each drive ended in a collision, (n,)."""
        return self._search.outcomes

    @property
    def exploring(self) -> bool:
        """Whether the next round explores."""
        return self.drives < EXPLORED * self.budget

    def ask(self) -> Draw:
        """The next points to drive; none once the budget is spent."""
        stream = random_stream(self.seed, "importance", self.met.logical.name, self._rounds)
        self._rounds += 1
        size = max(8, int(ROUND * self.budget))
        if self.drives == 0:
            first = FIRST + 8 * len(self.met.logical.names)
            size = min(first, max(1, int(EXPLORED * self.budget)))
        size = min(size, self.budget - self.drives)
        if size <= 0:
            return Draw(self.points[:0], np.empty(0), 0)
        draw = self._explore(size, stream) if self.exploring else self._count(size, stream)
        self.drives += len(draw.points)
        return draw

    def tell(self, draw: Draw, collided: BoolArray, loss: FloatArray) -> None:
        """Outcomes at drawn points: collisions (n,) and losses (n,), 0 without."""
        self.loss = np.append(self.loss, loss)
        self.weights = np.append(self.weights, draw.weights)
        self.in_estimate = np.append(self.in_estimate, np.full(len(collided), draw.drawn > 0))
        self.drawn += draw.drawn
        self._search.tell(draw.points, collided)

    # -- exploring

    def _explore(self, size: int, stream: np.random.Generator) -> Draw:
        points, density, drawn_with = self._pool(stream)
        level = density / density.max()
        if self._knows_both:
            chance = self._search.probability(points)
            edge = np.sqrt(level) * chance * (1.0 - chance) / drawn_with
            core = level * (chance > 0.5) / drawn_with
            half = size // 2
            near = _pick(points, edge, size - half, stream)
            rows = np.concatenate([near, _pick(points, core, half, stream)])
        else:
            chosen = _pick(points, level**0.25 / drawn_with, ASKED, stream)
            rows = _pick(
                chosen, 0.05 + danger(self.met.logical, chosen, ZoneSettings()), size, stream
            )
        rows = np.unique(rows, axis=0)
        return Draw(rows, np.zeros(len(rows)), 0)

    @property
    def _knows_both(self) -> bool:
        return bool(self.collided.any() and not self.collided.all())

    def _pool(self, stream: np.random.Generator) -> Pool:
        logical = self.met.logical
        base = self.met.base(POOL, stream)
        middle = np.median(base, axis=0)
        wide = middle + STRETCHED * (self.met.base(POOL, stream) - middle)
        points = np.concatenate([base, wide, evenly(logical, POOL, stream)])
        density = self.met.density(points)
        points, density = points[density > 0.0], density[density > 0.0]
        near = middle + (points - middle) / STRETCHED
        volume = np.prod(logical.high - logical.low)
        mixed = self.met.base_density(points)
        mixed = mixed + self.met.base_density(near) / STRETCHED ** len(middle) + 1.0 / volume
        return points, density, mixed / 3.0

    # -- drives that count

    def _count(self, size: int, stream: np.random.Generator) -> Draw:
        logical, mixtures = self.met.logical, self._mixtures(stream)
        defensive = DEFENSIVE if mixtures else 1.0
        drawn, density = 0, np.zeros(size)
        while not density.any():  # impossible points count, but end no search
            rows = self.met.base(size, stream)
            share = stream.uniform(size=size)
            for number, mixture in enumerate(mixtures):
                chosen = (share >= defensive) & ((np.arange(size) % len(mixtures)) == number)
                rows = np.where(
                    chosen[:, None], logical.from_unit(mixture.draw(size, stream)), rows
                )
            density = self.met.density(rows)
            drawn += size
        rows, density = rows[density > 0.0], density[density > 0.0]
        volume = np.prod(logical.high - logical.low)
        proposal = defensive * self.met.base_density(rows)
        for number, mixture in enumerate(mixtures):
            part = (1.0 - defensive) * (len(range(number, size, len(mixtures))) / size)
            proposal = proposal + part * mixture.density(logical.to_unit(rows)) / volume
        return Draw(rows, density / proposal, drawn)

    def _mixtures(self, stream: np.random.Generator) -> list[Mixture]:
        """Gaussians over points that may collide, and over those that almost surely do; over
        dangerous ones as long as no drive collided. None where there are none.

        The classifier's probability is 0.5 far from all drives; the second mixture keeps such
        places from taking all drives.
        """
        pool = self._pool(stream)
        if self._knows_both:
            mixtures = [self._polished(pool, least, stream) for least in (LIKELY, SURE)]
        else:
            points, density, drawn_with = pool
            if not self.collided.any():
                every = max(1, len(points) // ASKED)
                points, density, drawn_with = (item[::every] for item in pool)
                density = density * danger(self.met.logical, points, ZoneSettings()) ** 2
            mixtures = [_fitted(self.met.logical.to_unit(points), density / drawn_with, stream)]
        return [mixture for mixture in mixtures if mixture is not None]

    def _polished(self, pool: Pool, least: float, stream: np.random.Generator) -> Mixture | None:
        """Gaussians over points that collide with at least this probability, refitted to draws
        of its own.
        """
        logical = self.met.logical
        points, density, drawn_with = pool
        weight = density * (self._search.probability(points) > least) / drawn_with
        mixture = _fitted(logical.to_unit(points), weight, stream)
        if mixture is None:  # no such point in the pool: around the drives that collided, then
            hits = self.points[self.collided]
            mixture = _fitted(logical.to_unit(hits), np.sqrt(self.met.density(hits)), stream)
        for _ in range(POLISHED):
            if mixture is None:
                break
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

    def estimate(self) -> CollisionEstimate:
        """The estimate from the counted drives."""
        hits = self.in_estimate & self.collided
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
    if not len(possible):
        return points[:0]
    share = weight[possible] / weight[possible].sum()
    count = min(count, len(possible))
    return np.asarray(points[stream.choice(possible, size=count, replace=False, p=share)])


def _fitted(unit: FloatArray, weight: FloatArray, stream: np.random.Generator) -> Mixture | None:
    """A mixture over weighted points of the unit box; None where fewer than k + 2 of them count."""
    if not np.all(np.isfinite(weight)) or weight.sum() <= 0.0:
        return None
    share = weight / weight.sum()
    k = unit.shape[1]
    effective = 1.0 / float((share**2).sum())
    if effective < k + 2:  # all depends on a few points: the few heaviest ones, alike
        share = np.zeros(len(share))
        share[np.argsort(weight)[-min(4 * (k + 2), (weight > 0).sum()) :]] = 1.0
        share /= share.sum()
        effective = 1.0 / float((share**2).sum())
        if effective < 2.0:
            return None
    centred = unit - share @ unit
    covariance = (centred * share[:, None]).T @ centred + 1e-8 * np.eye(k)
    picks = np.searchsorted(np.cumsum(share), (stream.uniform() + np.arange(CENTRES)) / CENTRES)
    width = min(effective, CENTRES) ** (-1.0 / (k + 4))
    return Mixture(unit[np.minimum(picks, len(unit) - 1)], width * np.linalg.cholesky(covariance))


class CollisionEstimate(NamedTuple):
    """A probability of collision, and the expected loss L of Eq. 14, of an encounter, each with its
    95 % limits.

    deviation: standard error of the probability over its value.
    upper_limit: 95 % of the probability wherever the collisions may be, by the points drawn by
        exposure alone; the upper limits where no drive that counted collided.
    drives: all of them;
    hits: collisions among the `drawn` points that counted.
    """

    probability: Limits
    loss: Limits
    deviation: float
    upper_limit: float
    drives: int
    drawn: int
    hits: int
    collisions: int


def estimated(
    weights: FloatArray, loss: FloatArray, drawn: int, heaviest: float, collisions: int, drives: int
) -> CollisionEstimate:
    """weights, loss: p/q and L (h,) of the hits among `drawn` points.
    heaviest: the largest p over the density of points drawn by exposure.
    """
    limit = 1.0 if not drawn else min(1.0, -math.log(1.0 - LEVEL) * heaviest / (DEFENSIVE * drawn))
    probability = expected = 0.0, 0.0, limit
    deviation = math.inf
    if len(weights):
        probability, deviation = _mean(weights, drawn)
        expected, _ = _mean(weights * loss, drawn)
    counts = drives, drawn, len(weights), collisions
    return CollisionEstimate(probability, expected, deviation, limit, *counts)


def _mean(terms: FloatArray, drawn: int) -> tuple[Limits, float]:
    """Mean of `drawn` terms, all but these 0, its limits by a log-normal distribution with
    Student's quantile, none above 1, and its relative error.
    """
    mean = float(terms.sum()) / drawn
    variance = max((terms**2).sum() / drawn - mean**2, 0.0) / max(drawn - 1, 1)
    relative = math.sqrt(variance) / mean if mean > 0.0 else math.inf
    student = float(stdtrit(degrees_of_freedom(terms), (1.0 + LEVEL) / 2.0))
    reach = student * math.sqrt(math.log1p(relative**2))
    high = mean * math.exp(min(reach, 50.0))
    return (min(mean, 1.0), mean * math.exp(-reach), min(high, 1.0)), relative


def degrees_of_freedom(terms: FloatArray) -> float:
    """Degrees of freedom of the error of a mean of terms (h,): as many as count effectively, less
    one; at least one.
    """
    squares = (terms**2).sum()
    return max(float(terms.sum() ** 2) / squares - 1.0, 1.0) if squares > 0.0 else 1.0


def resampled(met: Met, count: int, seed: int) -> list[tuple[Any, float]]:
    """Joint distributions over resampled events, each with how many events it has over how many
    there are.

    Each event counts as often as a Poisson draw of mean 1: what another stretch of road would have
    shown.
    """
    if met.joint is None:
        return []
    stream = random_stream(seed, "events", met.logical.name)
    weights = stream.poisson(1.0, (count, len(met.joint.events))).astype(np.float64)
    return [
        (replace(met.joint, weights=tuple((row + 1e-9).tolist())), row.mean()) for row in weights
    ]
