"""Probability of a collision in one scenario, from few drives, by importance sampling.

`campaign` makes a `RareEvents` for each ADS in each scenario, and drives the points that it asks
for. A point's weight is p/q: its exposure p over the density q with which it was drawn.

The first drives explore, and have no weight. They lie at exposed points where ideal braking comes
near its limits, and later at the edge of the collisions so far. All later drives count. A share
`DEFENSIVE` of these is drawn by exposure. The rest is drawn from mixtures of Gaussians over the
exposed points that probably collide.

The estimate is unbiased whatever the exploration found, because each round's Gaussians are fixed
before its points are drawn. A collision outside the explored region has a large weight, and widens
the interval.

Users: `extras/rates/campaign.py`, `extras/rates/campaign_page.py`.
"""

from __future__ import annotations

from math import exp, inf, log1p, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.special import gammaincinv, stdtrit

from sumo_eval.extras.rates.exposure import Exposure
from sumo_eval.extras.rates.intervals import LEVEL, Limits
from sumo_eval.extras.studies.straddle import BoundarySearch
from sumo_eval.method.point_criticality import danger
from sumo_eval.scenario.joint import bells
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.settings import ZoneSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray

DEFENSIVE = 0.2  # share of the counted drives that are drawn by exposure
EXPLORED = 0.4  # share of the budget that explores, at most
FIRST = 24  # drives of the first round, and 8 more for each parameter
ROUND = 0.2  # share of the budget in each later round
POOL = 4096  # points of each of the three kinds in `_pool`
WITH_DANGER = 1024  # points of the pool whose danger is computed, about
STRETCH = 2.5  # factor by which the pool spreads exposed points away from their median
LIKELY = 0.3  # the first mixture lies over points that collide with at least this probability
NEARLY_SURE = 0.8  # the same of the second mixture
CENTRES = 256  # Gaussians in a mixture
REFITS = 3  # times that a mixture is fitted again, to draws from itself
LARGEST_EXPONENT = 50.0  # so that exp stays finite


class Mixture(NamedTuple):
    """Gaussians of equal weight and covariance in the coordinates of the unit box.

    centres: (m, k).
    root: Cholesky factor of the covariance, (k, k).
    """

    centres: FloatArray
    root: FloatArray

    def draw(self, count: int, stream: Generator) -> FloatArray:
        """Draw points (count, k) in the coordinates of the unit box, some of them outside it."""
        chosen = self.centres[stream.integers(len(self.centres), size=count)]
        return chosen + stream.standard_normal(chosen.shape) @ self.root.T

    def density(self, unit: FloatArray) -> FloatArray:
        """Density (n,) at points (n, k) in the coordinates of the unit box."""
        whiten = np.linalg.inv(self.root)
        centres, white = self.centres @ whiten.T, unit @ whiten.T
        norm = abs(np.linalg.det(whiten)) / (2.0 * pi) ** (unit.shape[1] / 2.0)
        return np.asarray(bells(white, centres).mean(axis=1) * norm)


class Draw(NamedTuple):
    """Points to drive.

    points: (n, k).
    weights: p/q, (n,); all 0: the points explore.
    drawn: number of points drawn for the estimate, impossible ones included; 0: the points explore.
    """

    points: FloatArray
    weights: FloatArray
    drawn: int


class Candidates(NamedTuple):
    """Possible points to choose from.

    points: (m, k).
    density: p at these points, (m,).
    drawn_with: density with which they were drawn, (m,).
    """

    points: FloatArray
    density: FloatArray
    drawn_with: FloatArray


class RareEvents:
    """Search for collisions: `ask` for points, `tell` their outcomes, `estimate`.

    exposure: of the scenario's points.
    budget: most drives.

    drawn: number of points drawn for the estimate, impossible ones included.
    weights, loss: p/q and L of each drive, (n,).

    The same seed and the same outcomes lead to the same points.
    """

    def __init__(self, exposure: Exposure, budget: int, seed: int = 1) -> None:
        self.exposure, self.budget, self.seed = exposure, budget, seed
        self.loss, self.weights = np.empty(0), np.empty(0)
        self.drawn = self._rounds = 0
        self._search = BoundarySearch(exposure.logical, seed)

    @property
    def points(self) -> FloatArray:
        """Points of the drives, (n, k)."""
        return self._search.points

    @property
    def collided(self) -> BoolArray:
        """Whether each drive ended in a collision, (n,)."""
        return self._search.outcomes

    @property
    def in_estimate(self) -> BoolArray:
        """Whether each drive counts, (n,); a drive that explores has no weight."""
        return self.weights > 0.0

    @property
    def drives(self) -> int:
        """Number of drives so far."""
        return len(self.points)

    @property
    def exploring(self) -> bool:
        """Whether the next round explores."""
        return self.drives < EXPLORED * self.budget

    def ask(self) -> Draw:
        """The next points to drive; none once the budget is spent."""
        stream = random_stream(self.seed, "importance", self.exposure.logical.name, self._rounds)
        self._rounds += 1
        size = int(ROUND * self.budget)
        if self.drives == 0:
            size = min(FIRST + 8 * len(self.exposure.logical.names), int(EXPLORED * self.budget))
        size = min(size, self.budget - self.drives)
        if size == 0:
            return Draw(self.points[:0], np.empty(0), 0)
        return self._explore(size, stream) if self.exploring else self._count(size, stream)

    def tell(self, draw: Draw, collided: BoolArray, loss: FloatArray) -> None:
        """Learn from the outcomes of a draw.

        collided: whether each drive ended in a collision, (n,).
        loss: L of each drive, 0 without a collision, (n,).
        """
        self.loss = np.append(self.loss, loss)
        self.weights = np.append(self.weights, draw.weights)
        self.drawn += draw.drawn
        self._search.tell(draw.points, collided)

    def _explore(self, size: int, stream: Generator) -> Draw:
        """Draw at most `size` points that explore.

        Every score of a point is divided by the density with which the pool was drawn, so that it
        does not depend on how the pool was drawn.
        """
        points, density, drawn_with = self._pool(stream)
        level = density / density.max()
        if self._knows_both:
            # Half of the points lie at the edge of the collisions, the rest among them. The square
            # root also admits points of little exposure at the edge.
            chance = self._search.probability(points)
            edge = np.sqrt(level) * chance * (1.0 - chance) / drawn_with
            core = level * (chance > 0.5) / drawn_with
            half = size // 2
            at_edge = _pick(points, edge, size - half, stream)
            rows = np.concatenate([at_edge, _pick(points, core, half, stream)])
        else:
            # The exponent admits points of little exposure. 0.05 admits some without danger, as the
            # ADS may collide where ideal braking would not.
            exposed = _pick(points, level**0.25 / drawn_with, WITH_DANGER, stream)
            score = 0.05 + danger(self.exposure.logical, exposed, ZoneSettings())
            rows = _pick(exposed, score, size, stream)
        rows = np.unique(rows, axis=0)  # a point may be picked for the edge and for the core
        return Draw(rows, np.zeros(len(rows)), 0)

    @property
    def _knows_both(self) -> bool:
        """Whether some drives collided and others did not."""
        return bool(self.collided.any() and not self.collided.all())

    def _pool(self, stream: Generator) -> Candidates:
        """Draw points to choose from: a third each by exposure, spread wider, and evenly."""
        exposure = self.exposure
        logical = exposure.logical
        base = exposure.base(POOL, stream)
        middle = np.median(base, axis=0)
        wide = middle + STRETCH * (exposure.base(POOL, stream) - middle)
        points = np.concatenate([base, wide, evenly(logical, POOL, stream)])
        density = exposure.density(points)
        points, density = points[density > 0.0], density[density > 0.0]

        # mean density of the three thirds; stretching divides the density of `base` by STRETCH in
        # each direction
        unstretched = middle + (points - middle) / STRETCH
        drawn_with = (
            exposure.base_density(points)
            + exposure.base_density(unstretched) / STRETCH ** len(middle)
            + 1.0 / np.prod(logical.high - logical.low)
        ) / 3.0
        return Candidates(points, density, drawn_with)

    def _count(self, size: int, stream: Generator) -> Draw:
        """Draw `size` points that count; impossible ones have no drive."""
        logical, mixtures = self.exposure.logical, self._mixtures(stream)
        defensive = DEFENSIVE if mixtures else 1.0
        # for each mixture, which points (size,) it may draw: the mixtures take turns
        turns = [np.arange(size) % len(mixtures) == turn for turn in range(len(mixtures))]
        drawn = 0
        density = np.zeros(size)
        while not density.any():  # until at least one point is possible
            rows = self.exposure.base(size, stream)
            lots = stream.uniform(size=size)  # below `defensive`: the point of `base` stays
            for mixture, turn in zip(mixtures, turns, strict=True):
                chosen = turn & (lots >= defensive)
                rows[chosen] = logical.from_unit(mixture.draw(size, stream))[chosen]
            density = self.exposure.density(rows)
            drawn += size
        rows, density = rows[density > 0.0], density[density > 0.0]

        volume = np.prod(logical.high - logical.low)  # of the box, in the parameters' units
        # q: density with which these points were drawn
        proposal = defensive * self.exposure.base_density(rows)
        for mixture, turn in zip(mixtures, turns, strict=True):
            part = (1.0 - defensive) * turn.mean()
            proposal += part * mixture.density(logical.to_unit(rows)) / volume
        return Draw(rows, density / proposal, drawn)

    def _mixtures(self, stream: Generator) -> list[Mixture]:
        """Mixtures over exposed points where a collision is likely, and where it is nearly sure.

        Far from all drives the classifier's probability is 0.5. The second mixture keeps such
        places from taking all drives.

        Where all drives collided, one mixture covers all points. Where none did, it covers the
        dangerous ones. A mixture that cannot be fitted is left out.
        """
        logical, pool = self.exposure.logical, self._pool(stream)
        if self._knows_both:
            mixtures = [self._polished(pool, least, stream) for least in (LIKELY, NEARLY_SURE)]
        else:
            points, density, drawn_with = pool
            if not self.collided.any():
                step = max(1, len(points) // WITH_DANGER)  # danger takes long to compute
                points, density, drawn_with = (column[::step] for column in pool)
                density = density * danger(logical, points, ZoneSettings()) ** 2
            mixtures = [_fitted(logical.to_unit(points), density / drawn_with, stream)]
        return [mixture for mixture in mixtures if mixture is not None]

    def _polished(self, pool: Candidates, least: float, stream: Generator) -> Mixture | None:
        """A mixture over exposed points that collide with a probability above `least`.

        The mixture is fitted to the pool, then to draws from itself, of which more lie there.
        """
        logical = self.exposure.logical
        weight = pool.density * (self._search.probability(pool.points) > least) / pool.drawn_with
        mixture = _fitted(logical.to_unit(pool.points), weight, stream)
        if mixture is None:  # the pool has too few such points: take the drives that collided
            hits = self.points[self.collided]
            mixture = _fitted(logical.to_unit(hits), np.sqrt(self.exposure.density(hits)), stream)
        if mixture is None:
            return None
        for _ in range(REFITS):
            unit = mixture.draw(POOL, stream)
            density = self.exposure.density(logical.from_unit(unit))
            unit, density = unit[density > 0.0], density[density > 0.0]
            if len(unit) < CENTRES // 4:  # too few for a better fit
                break
            collides = self._search.probability(logical.from_unit(unit)) > least
            weight = density * collides / mixture.density(unit)
            mixture = _fitted(unit, weight, stream) or mixture
        return mixture

    def estimate(self) -> CollisionEstimate:
        """The estimate from the counted drives."""
        hits = self.in_estimate & self.collided
        return estimated(
            self.weights[hits],
            self.loss[hits],
            self.drawn,
            self.exposure.heaviest,
            int(self.collided.sum()),
            self.drives,
        )


def _pick(points: FloatArray, weight: FloatArray, count: int, stream: Generator) -> FloatArray:
    """Draw `count` different points in proportion to their weights, or all that have a weight."""
    possible = np.flatnonzero(weight > 0.0)
    if not len(possible):
        return points[:0]
    share = weight[possible] / weight[possible].sum()
    rows = stream.choice(possible, size=min(count, len(possible)), replace=False, p=share)
    return np.asarray(points[rows])


def _fitted(unit: FloatArray, weight: FloatArray, stream: Generator) -> Mixture | None:
    """A mixture over weighted points; None where fewer than two weights are above 0.

    unit: points in the coordinates of the unit box, (n, k).
    weight: of each point, (n,).
    """
    if not np.all(np.isfinite(weight)) or weight.sum() <= 0.0:
        return None
    share = weight / weight.sum()
    k = unit.shape[1]
    effective = 1.0 / (share**2).sum()  # number of points, as if all had the same weight
    if effective < k + 2:  # too few for a covariance: the heaviest points count alike
        number = min(4 * (k + 2), (weight > 0.0).sum())
        if number < 2:
            return None
        share = np.zeros(len(share))
        share[np.argsort(weight)[-number:]] = 1.0 / number
        effective = 1.0 / (share**2).sum()
    centred = unit - share @ unit
    # 1e-8 of the box: points in a plane have a covariance too
    covariance = (centred * share[:, None]).T @ centred + 1e-8 * np.eye(k)
    # systematic resampling: a point becomes a centre about `CENTRES` times its share
    picks = np.searchsorted(np.cumsum(share), (stream.uniform() + np.arange(CENTRES)) / CENTRES)
    width = min(effective, CENTRES) ** (-1.0 / (k + 4))  # Scott's rule for kernels
    # by rounding, the last pick may lie beyond the last point
    return Mixture(unit[np.minimum(picks, len(unit) - 1)], width * np.linalg.cholesky(covariance))


class CollisionEstimate(NamedTuple):
    """Probability of a collision in an encounter, and its expected loss L (Eq. 14), with limits.

    deviation: standard error of the probability over its value.
    upper_limit: 95 % limit of the probability wherever the collisions lie. It rests on the number
        of points drawn by exposure. Without hits, it is the upper limit of probability and loss.
    drives, collisions: numbers of all drives, and of those with a collision.
    drawn, hits: numbers of points drawn for the estimate, and of their collisions.
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
    """The estimate from the collisions among the counted drives.

    weights, loss: p/q and L of each of these, (h,).
    drawn, collisions, drives: as in `CollisionEstimate`.
    heaviest: as in `Exposure`.
    """
    # Upper limit of the mean of a Poisson number of hits; without any it is -ln(1 - LEVEL). Hits
    # that were not drawn by exposure count too, so the limit is rather too large than too small.
    hits = float(gammaincinv(len(weights) + 1.0, LEVEL))
    limit = min(1.0, hits * heaviest / (DEFENSIVE * drawn)) if drawn else 1.0
    probability = expected = 0.0, 0.0, limit
    deviation = inf
    if len(weights):
        probability, deviation = _mean(weights, drawn)
        expected, _ = _mean(weights * loss, drawn)
    return CollisionEstimate(
        probability, expected, deviation, limit, drives, drawn, len(weights), collisions
    )


def _mean(terms: FloatArray, drawn: int) -> tuple[Limits, float]:
    """Mean of `drawn` terms with its limits, none above 1, and its relative standard error.

    terms: those that are not 0, (h,).

    The limits are those of a log-normal distribution with Student's quantile instead of the normal
    one.
    """
    mean = terms.sum() / drawn
    variance = max((terms**2).sum() / drawn - mean**2, 0.0) / max(drawn - 1, 1)
    relative = sqrt(variance) / mean if mean > 0.0 else inf
    student = float(stdtrit(degrees_of_freedom(terms), (1.0 + LEVEL) / 2.0))
    reach = student * sqrt(log1p(relative**2))
    value = min(mean, 1.0)  # by chance, weights p/q may have a mean above 1
    high = value * exp(min(reach, LARGEST_EXPONENT))
    return (value, value * exp(-reach), min(high, 1.0)), relative


def degrees_of_freedom(terms: FloatArray) -> float:
    """Degrees of freedom of a mean's error: the effective number of terms less one, at least one.

    terms: (h,).
    """
    squares = (terms**2).sum()
    return max(terms.sum() ** 2 / squares - 1.0, 1.0) if squares > 0.0 else 1.0
