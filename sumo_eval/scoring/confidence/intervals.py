"""Intervals of every score from two sources: which points were driven, and which drivers H and D
compare with.

A bootstrap. Each replicate draws the points again (`resamples`), the same ones for every ADS, and
adds to D and H an error of the drivers' own size, which a jackknife over drivers has measured
(`sumo_eval.scoring.confidence.drivers`). What was never seen is counted too: a sample in which k of
n hazardous points hold a collision does not prove that other points hold none. The end of an
interval on the bad side therefore carries e unseen collisions, e from an exponential distribution
of mean 1, as hard as those of doing nothing: together with the drawn ones a gamma distribution of
shape k + 1, as in the exact interval of a Poisson count. Its 95 % point for k = 0 is 3.0, the rule
of three. A sum loses with each of them. C is a mean over collisions, so the first of them makes it
what collisions leave: it loses that with the chance that an evaluation of as many points sees any.

Points of a method that leaves no part of the space out are balanced over it: their mean place is
the box's, so what a score's terms owe to a trend along a parameter is not an error of theirs.
Replicates are balanced in the same way (`Balance`), except the few cases that collided, which no
method spreads: C is a mean over them, and a collision in the safe zone leaves no D, so a replicate
without any of these has one, and S with it.

T, A' and S+ fall steeply at their good end, so their lower ends carry one more case instead, as bad
as doing nothing (t = 0, lost = the mean at stake), that weighs e cases, e from an exponential
distribution of mean 0.5. It is a case of the scenario: every ADS receives the same one, so that it
cancels in a difference as far as two ADSs have it in common.

The limits of an interval are percentiles of the resamples. With few cases they are widened, by as
much as Student's t is wider than the normal distribution (Hesterberg 2015). A collision keeps its
weight r (Eq. 16) in every resample.

Everything random has a stream named by scenario, driver or ADS, never by a place in a list, so the
interval of an ADS does not depend on what else is evaluated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, ndtr, stdtrit

from sumo_eval.method.score_terms import (
    AskedTerms,
    Counts,
    KnownSums,
    avoidance_grade,
    excess,
    once,
    ordering_score,
    paper_score,
)
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.scoring.case_terms import COMPUTED, CaseTerms, point_values, ratios, scores_of
from sumo_eval.scoring.confidence.drivers import DriverDeviations
from sumo_eval.scoring.confidence.resamples import IntArray, Resampled, Strata, resamples
from sumo_eval.settings import MethodSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray

LEVEL = 0.95
REPLICATES = 2_000
ONE_MORE = 0.5  # cases that the one more, as bad as doing nothing, weighs in the mean
UNSEEN = 3.0  # rule of three: with none seen among n, at most 3/n with 95 % confidence
SCORED = tuple(name for name in COMPUTED if name != "collision_probability")
BAD_SIDE_UP = frozenset({"regret"})  # more is worse


@dataclass(frozen=True, slots=True)
class Interval:
    """A value and the limits between which it lies with the probability `level`."""

    value: float
    low: float
    high: float
    level: float = LEVEL


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One ADS in one scenario.

    points: which of the scenario's points each case is, (n,), none twice.
    hazardous: (n,).
    drivers: what the choice of drivers does to its D and H.
    """

    ads: str
    terms: CaseTerms
    points: IntArray
    hazardous: BoolArray
    drivers: DriverDeviations


@dataclass(frozen=True, slots=True, eq=False)
class ScoreIntervals:
    """limits: low and high of each score that exists, by its name among the scores.
    sources: half-width of S and S+ by each source alone, by score.
    worse, better: S+ of every replicate, with and without one more case, (m,).
    missing: how far missing cases may move S+, down and up.
    """

    limits: Mapping[str, tuple[float, float]]
    sources: Mapping[str, Mapping[str, float]]
    worse: FloatArray
    better: FloatArray
    missing: tuple[float, float] = (0.0, 0.0)


def score_intervals(
    judged: Sequence[Judged],
    groups: Strata,
    method: MethodSettings,
    seed: int,
    scenario: str,
    *,
    replicates: int = REPLICATES,
    even: FloatArray | None = None,
    progress: Progress = quiet,
) -> list[ScoreIntervals]:
    """The intervals of all ADSs in one scenario.

    groups: of all its points (`strata`).
    even: its points in the unit box, (n, k), where they are balanced over it (`Balance`).
    """
    sums = [_Sums.of(one, groups.points, replicates, method) for one in judged]

    def told(points: int, of: int) -> None:
        progress(f"{scenario}: resamples for the intervals", points * replicates // of, replicates)

    for part in resamples(groups, replicates, seed, ("intervals", scenario), even=even, done=told):
        for of_one in sums:
            of_one.add(part)
    found = []
    for one, of_one in zip(judged, sums, strict=True):
        drawn = _Draws.of(one, seed, scenario, replicates)
        found.append(_intervals(one, of_one.replicates(drawn), drawn, groups, method))
    return found


class _Sums:
    """All sums over cases that the scores of one ADS's replicates are made of, added up part by
    part of the cases.

    The terms of a part of the cases are made once for all replicates, and the scores once of the
    sums.

    rows: which case stands at each of the scenario's points, (p,), -1 where none does; None where
        the cases are the points.
    """

    def __init__(
        self, one: Judged, rows: IntArray | None, replicates: int, method: MethodSettings
    ) -> None:
        self._one, self._rows, self._method = one, rows, method
        self._exposed, self._free = bool(one.terms.exposure.any()), FreePoints.of(one)
        nobody, asked, hits = slice(0, 0), AskedTerms(), AskedTerms()
        self._ask(nobody, asked, hits)
        self._balanced = np.zeros((replicates, len(asked.terms)))
        self._drawn = np.zeros((replicates, len(hits.terms)))

    @classmethod
    def of(cls, one: Judged, points: int, replicates: int, method: MethodSettings) -> _Sums:
        """Nothing added yet.

        points: how many the scenario has.
        """
        if np.array_equal(one.points, np.arange(points)):
            return cls(one, None, replicates, method)
        rows = np.full(points, -1)
        rows[one.points] = np.arange(len(one.points))
        return cls(one, rows, replicates, method)

    def add(self, part: Resampled) -> None:
        """Add the cases at some of the points."""
        counts, drawn, rows = part.counts, part.drawn, part.places
        if self._rows is not None:
            there = self._rows[part.places] >= 0
            counts, drawn, rows = counts[:, there], drawn[:, there], self._rows[part.places[there]]
        asked, hits = AskedTerms(), AskedTerms()
        self._ask(rows, asked, hits)
        self._balanced += counts @ np.column_stack(asked.terms)
        self._drawn += drawn @ np.column_stack(hits.terms)

    def replicates(self, drawn: _Draws) -> _Replicates:
        """The scores of all replicates, once all points have been added."""
        plain, losses = self._ask(
            slice(0, 0), KnownSums(self._balanced.T), KnownSums(self._drawn.T)
        )
        better = _with_drivers(plain, drawn.index, drawn.likeness, self._method)
        worse = dict(better)
        for name, lost in losses.items():
            moved = lost.of(drawn.unseen)
            worse[name] = better[name] + moved if name in BAD_SIDE_UP else better[name] - moved
        return _Replicates(
            better,
            _with_one_more(worse, better, self._one.terms, drawn.one_more, self._method),
            plain,
        )

    def _ask(
        self, rows: IntArray | slice, counts: Counts, hits: Counts
    ) -> tuple[dict[str, FloatArray], dict[str, UnseenLoss]]:
        """Scores of these cases, and what unseen collisions would cost them: which sums are asked
        for, and in which order, is the same for any cases.
        """
        terms = self._one.terms.part(rows)
        scores = scores_of(terms, counts, self._method, hits, exposed=self._exposed)
        return scores, self._free.losses(terms, self._one.hazardous[rows], counts, self._method)


@dataclass(frozen=True, slots=True, eq=False)
class _Draws:
    """Random terms of one ADS, the points aside, (m,): unseen collisions, the weight of one more
    case (alike for all ADSs), and the drivers' errors of D and H.
    """

    unseen: FloatArray
    one_more: FloatArray
    index: FloatArray
    likeness: FloatArray

    @classmethod
    def of(cls, one: Judged, seed: int, scenario: str, replicates: int) -> _Draws:
        unseen = random_stream(seed, "intervals", "unseen", scenario, one.ads).standard_exponential(
            replicates
        )
        one_more = random_stream(seed, "intervals", "one more", scenario).exponential(
            ONE_MORE, replicates
        )
        deviates = driver_deviates(one.drivers, seed, replicates)
        return cls(unseen, one_more, deviates @ one.drivers.index, deviates @ one.drivers.likeness)


def driver_deviates(drivers: DriverDeviations, seed: int, replicates: int) -> FloatArray:
    """Student's t numbers, (m, k), one column a driver: each driver's are its own in every scenario
    and for every ADS.

    That is why the drivers' part of two ADSs' scores cancels in their difference as far as it is
    common.
    """
    normal = [
        random_stream(seed, "intervals", "driver", name).standard_normal(replicates)
        for name in drivers.names
    ]
    if not normal:
        return np.zeros((replicates, 0))
    share = random_stream(seed, "intervals", "spread of drivers").uniform(size=replicates)
    wider = np.sqrt(drivers.freedom / chdtri(drivers.freedom, share))
    return np.column_stack(normal) * wider[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class _Replicates:
    """Scores of replicates by name, (m,).

    better: as drawn.
    worse: with unseen collisions.
    points_only: without the drivers' error.
    """

    better: Mapping[str, FloatArray]
    worse: Mapping[str, FloatArray]
    points_only: Mapping[str, FloatArray]


def _with_drivers(
    scores: Mapping[str, FloatArray],
    index: FloatArray,
    likeness: FloatArray,
    method: MethodSettings,
) -> dict[str, FloatArray]:
    """The scores with errors of D and H, which stay within 0..1."""
    moved = dict(scores)
    moved["d"] = np.clip(scores["d"] + index, 0.0, 1.0)
    moved["human_likeness"] = np.clip(scores["human_likeness"] + likeness, 0.0, 1.0)
    return _summed(moved, method)


def _summed(scores: Mapping[str, FloatArray], method: MethodSettings) -> dict[str, FloatArray]:
    """The scores with S and S+ of what they are made of."""
    s = paper_score(scores["c"], scores["d"], method.score)
    plus = ordering_score(
        scores["task_share"], scores["avoidance_grade"], scores["human_likeness"], method.score
    )
    return {**scores, "s": s, "s_plus": plus}


def _with_one_more(
    worse: Mapping[str, FloatArray],
    better: Mapping[str, FloatArray],
    terms: CaseTerms,
    weight: FloatArray,
    method: MethodSettings,
) -> dict[str, FloatArray]:
    """The scores with one more case as bad as doing nothing, which weighs e of n cases: its share
    is e / (n + e).

    T loses that share, and 1 - A is drawn that far towards 1 where anything is at stake.

    weight: e, (m,).
    """
    known, stake = _known_stake(terms)
    timed, compared = int(np.isfinite(terms.task).sum()), int(known.sum()) if stake.any() else 0
    of_task, of_harm = (
        weight / (n + weight) if n else np.zeros(len(weight)) for n in (timed, compared)
    )
    moved = dict(worse)
    moved["task_share"] = better["task_share"] * (1.0 - of_task)
    harm = (1.0 - better["avoided_share"]) * (1.0 - of_harm) + of_harm
    moved["avoidance_grade"] = avoidance_grade(1.0 - harm, method.task.sharpness)
    return _summed(moved, method)


@dataclass(frozen=True, slots=True, eq=False)
class UnseenLoss:
    """Cost of unseen collisions for a score: whole, (m,), if every free point held one;

    points: among how many they are;
    first_takes_all: the first one costs the whole (C), else each one costs its part.
    """

    points: int
    whole: FloatArray
    first_takes_all: bool = False

    def of(self, unseen: ArrayLike) -> FloatArray:
        """The mean loss, (m,), to n collisions in expectation: p = unseen/points is the
        chance of a point.

        p * whole where each costs its part; (1 - (1 - p)^points) * whole where the first one costs
        it.
        """
        chance = np.minimum(np.asarray(unseen, dtype=np.float64) / self.points, 1.0)
        if self.first_takes_all:
            chance = 1.0 - (1.0 - chance) ** self.points
        return np.asarray(chance * self.whole, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class FreePoints:
    """Where an ADS may have unseen collisions, as far as that depends on all of its cases.

    A free point is a hazardous one without a collision (any evaluated one, if none is hazardous).
    An unseen collision is as hard there as that of `no_reaction`.

    points: how many hazardous ones there are.
    hazardous: whether there are any.
    weighted, exposed: whether any case that counts has a weight, an exposure.
    spotless: whether none collided, harmless: whether none holds an incident.
    """

    points: int
    hazardous: bool
    weighted: bool
    exposed: bool
    spotless: bool
    harmless: bool

    @classmethod
    def of(cls, one: Judged) -> FreePoints:
        """Those of all cases of an ADS."""
        known, _ = _known_stake(one.terms)
        hazardous = known & one.hazardous
        weighted, exposed = (
            bool((np.nan_to_num(weights) * known).any())
            for weights in (one.terms.weight, one.terms.exposure)
        )
        points = int(hazardous.sum()) or int(known.sum())
        return cls(
            points,
            bool(hazardous.any()),
            weighted,
            exposed,
            not one.terms.collided.any(),
            not one.terms.incident.any(),
        )

    def losses(
        self, terms: CaseTerms, hazardous: BoolArray, counts: Counts, method: MethodSettings
    ) -> dict[str, UnseenLoss]:
        """By score. A, regret: an unseen collision loses max(0, U0 - Ug). C: evaluations that see
        any have Ug/U0, the others 1; after a collision that was seen, C is a mean over collisions,
        which unseen ones do not lower for sure. Where all cases that count weigh nothing, every one
        weighs the same.

        terms, hazardous: of the cases of `counts`.
        """
        found: dict[str, UnseenLoss] = {}
        if not self.points:
            return found
        known, stake = _known_stake(terms)
        among = known & hazardous if self.hazardous else known
        free = among & ~terms.incident
        weight, exposure = (
            np.where(known, np.nan_to_num(weights) if any_weighs else 1.0, 0.0)
            for weights, any_weighs in (
                (terms.weight, self.weighted),
                (terms.exposure, self.exposed),
            )
        )
        for name, each in (("avoided_share", weight), ("avoided_share_exposure", exposure)):
            whole = _ratio(counts @ (each * stake * free), counts @ (each * stake))
            found[name] = UnseenLoss(self.points, whole)
        found["regret"] = UnseenLoss(
            self.points, _ratio(counts @ (weight * stake * free), counts @ weight)
        )
        if self.spotless:
            hit = np.nan_to_num(1.0 - ratios(terms.unreacting, terms.ideal, method)) * among
            whole = _ratio(counts @ (weight * hit), counts @ (weight * among))
            found["c"] = UnseenLoss(self.points, whole, first_takes_all=True)
        return found


def _known_stake(terms: CaseTerms) -> tuple[BoolArray, FloatArray]:
    """Which cases were evaluated and have something to be compared with, and max(0, U0 - Ug) there,
    0 elsewhere.
    """
    stake = excess(terms.unreacting, terms.ideal)
    known = terms.counted & np.isfinite(stake)
    return known, np.where(known, stake, 0.0)


def _ratio(over: FloatArray, under: FloatArray) -> FloatArray:
    return np.divide(over, under, out=np.zeros(over.shape), where=under > 0.0)


def _intervals(
    one: Judged,
    found: _Replicates,
    drawn: _Draws,
    groups: Strata,
    method: MethodSettings,
) -> ScoreIntervals:
    values = point_values(one.terms, method)
    free = _freedom(one, groups)
    limits = {}
    unseen, free_points = {}, FreePoints.of(one)
    if free_points.spotless:
        unseen = free_points.losses(one.terms, one.hazardous, once(len(one.points)), method)
        unseen = {
            name: loss for name, loss in unseen.items() if free_points.harmless or name == "c"
        }
    for name in SCORED:
        value = values[name]
        if value is None:
            continue
        low, high = (
            (found.better, found.worse) if name in BAD_SIDE_UP else (found.worse, found.better)
        )
        ends = _limits(low[name], high[name], free[name])
        if ends is None:
            continue
        # none was seen: what they would cost is known, and nothing of it is drawn
        if name in unseen:
            moved = float(unseen[name].of(UNSEEN)[0])
            ends = (value, value + moved) if name in BAD_SIDE_UP else (value - moved, value)
        limits[name] = min(ends[0], value), max(ends[1], value)
    zero = np.zeros(len(drawn.index))
    plain = {
        name: np.full(len(zero), np.nan if value is None else value)
        for name, value in values.items()
    }
    alone = {
        "cases": found.points_only,
        "drivers": _with_drivers(plain, drawn.index, drawn.likeness, method),
    }
    sources: dict[str, Mapping[str, float]] = {
        name: {source: _half(scores[name], free[name]) for source, scores in alone.items()}
        for name in ("s", "s_plus")
        if name in limits
    }
    return ScoreIntervals(limits, sources, found.worse["s_plus"], found.better["s_plus"])


def _freedom(one: Judged, groups: Strata) -> dict[str, int]:
    """Degrees of freedom of each score's error: points that have a part in it, less one in each
    group.
    """
    group = groups.numbers()

    def free(part: BoolArray) -> int:
        places = group[one.points[part]]
        return max(len(places) - len(np.unique(places)), 1)

    terms = one.terms
    everyone = free(terms.counted)
    return {
        **dict.fromkeys(SCORED, everyone),
        "s": free(terms.evaluated),
        "task_share": free(np.isfinite(terms.task)),
        "c": free(terms.evaluated)
        if not terms.collided.any()
        else max(int(np.isfinite(terms.ratio).sum()) - 1, 1),
        "d": free(np.isfinite(terms.index)),
        "human_likeness": free(np.isfinite(terms.likeness)),
    }


def _limits(low: FloatArray, high: FloatArray, freedom: int) -> tuple[float, float] | None:
    """Percentiles, widened for n degrees of freedom: by the quantile of t in place of the
    normal one.
    """
    low, high = low[np.isfinite(low)], high[np.isfinite(high)]
    if not (len(low) and len(high)):
        return None
    tail = float(ndtr(stdtrit(freedom, (1.0 - LEVEL) / 2.0)))
    return float(np.quantile(low, tail)), float(np.quantile(high, 1.0 - tail))


def _half(values: FloatArray, freedom: int) -> float:
    ends = _limits(values, values, freedom)
    return 0.0 if ends is None else (ends[1] - ends[0]) / 2.0
