"""Ranking of the ADSs by S+ over all scenarios, and which ADSs can be told apart.

Two ADSs share points and drivers, so errors that are common to both cancel in the difference of
their scores. A comparison of two intervals would not use this. A replicate has two values of S+:
`worse`, with one more case that is as bad as doing nothing (`intervals.py`), and `better`, without
this case. The lower end of an interval takes the smaller of the two differences, the upper end the
larger. Missing cases count against the ADS that lacks them. An ADS differs from itself under
another name by exactly 0.

S+ over several scenarios is the mean of their S+. A scenario without a safe point has no task to
drive, so no S+ and no part in the order. In a scenario without drivers to compare with, H counts 0
for every ADS.

Users: `scoring/steps.py`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.record.points import scenario_weights
from sumo_eval.results import RankedAds, RankedPair, Ranking, ScenarioResult
from sumo_eval.score_notes import Bounds
from sumo_eval.scoring.confidence.intervals import LEVEL, ScoreIntervals, percentiles
from sumo_eval.settings import RankingSettings
from sumo_eval.trajectory import FloatArray, IntArray

Replicates = Mapping[tuple[str, str], ScoreIntervals | None]
"""(ADS, scenario) -> its intervals with their replicates; None: too few cases."""


def rank(
    scores: Sequence[ScenarioResult], replicates: Replicates, settings: RankingSettings
) -> Ranking:
    """The ranking of an evaluation's ADSs.

    scores: of every ADS in every scenario.
    settings: `[method.ranking]`: weights of the scenarios.

    Scenarios without any S+ are left out.
    """
    weights = scenario_weights(list(dict.fromkeys(score.scenario for score in scores)), settings)
    weighted = [name for name, weight in weights.items() if weight > 0.0]
    without_people = {score.scenario for score in scores if score.nobody_compared}
    with_task = {score.scenario for score in scores if score.task_share is not None}
    means = _Means({name: weights[name] for name in weighted if name in with_task})
    results_of: dict[str, dict[str, ScenarioResult]] = {}
    for score in scores:
        results_of.setdefault(score.ads, {})[score.scenario] = score
    totals = {
        name: total
        for name, results in results_of.items()
        if (total := means.total(results)) is not None
    }
    spreads = {name: means.spread(name, replicates) for name in totals}
    ranked = sorted(totals, key=lambda name: (-totals[name], name))
    pairs = _pairs(ranked, totals, spreads)
    rows = []
    for name, place in zip(ranked, _places(ranked, pairs), strict=True):
        weighted_results = [results_of[name][scenario] for scenario in means.weights]
        # with a single scenario the interval of S+ there, so that ranking and scores agree
        spread, ends = spreads[name], weighted_results[0].s_plus_interval
        if len(weighted_results) > 1:
            ends = None if spread is None else spread.interval(totals[name])
        rows.append(
            RankedAds(
                name, place, totals[name], ends,
                a_points=means.of(score.a_points for score in weighted_results),
                h_points=means.of(score.h_points for score in weighted_results)
            )
        )  # fmt: skip
    rows += [
        RankedAds(name, place=None, s_plus=None, interval=None)
        for name in sorted(results_of.keys() - totals.keys())
    ]
    return Ranking(
        weights,
        LEVEL,
        tuple(rows),
        tuple(pairs),
        without_people=tuple(name for name in weighted if name in without_people),
        without_task=tuple(name for name in weighted if name not in with_task),
    )


def _pairs(
    ranked: Sequence[str], totals: Mapping[str, float], spreads: Mapping[str, _Spread | None]
) -> list[RankedPair]:
    """Each two ADSs with the difference of their S+, its interval, and whether it excludes 0.

    ranked: names, the largest S+ first.
    totals: name -> S+.
    spreads: name -> replicates of S+; None: too few cases, so that there is no interval.
    """
    pairs = []
    for above, below in itertools.combinations(ranked, 2):
        difference = totals[above] - totals[below]
        ends = None
        first, second = spreads[above], spreads[below]
        if first is not None and second is not None:
            ends = first.minus(second).interval(difference)
        pairs.append(RankedPair(above, below, difference, ends, ends is not None and ends[0] > 0.0))
    return pairs


def _places(ranked: Sequence[str], pairs: Sequence[RankedPair]) -> list[int]:
    """The place of each ADS, from 1 on.

    An ADS shares the place of the ADS above it, unless it can be told apart from the first ADS at
    that place.
    """
    told_apart = {(pair.above, pair.below): pair.told_apart for pair in pairs}
    places, place = [], 1
    for number, name in enumerate(ranked, 1):
        if told_apart.get((ranked[place - 1], name)):
            place = number
        places.append(place)
    return places


class _Means(NamedTuple):
    """Weighted means over the scenarios with a task.

    weights: scenario -> its weight, above 0.
    """

    weights: Mapping[str, float]

    def of(self, values: Iterable[Any]) -> Any:
        """The mean of values (numbers or arrays), one for each scenario in the order of
        `weights`.
        """
        weights = self.weights.values()
        weighted = zip(weights, values, strict=True)
        return sum(weight * value for weight, value in weighted) / sum(weights)

    def total(self, scores: Mapping[str, ScenarioResult]) -> float | None:
        """S+ of one ADS; None if it has no S+ in one of the scenarios.

        scores: scenario -> its result.
        """
        plus = [scores[name].s_plus if name in scores else None for name in self.weights]
        return None if not plus or None in plus else float(self.of(plus))

    def spread(self, ads: str, replicates: Replicates) -> _Spread | None:
        """The mean S+ of one ADS in every replicate; None if a scenario has no replicates.

        In a replicate without safe points no ADS has an S+, and S+ counts 0 for all of them.
        """
        intervals: list[Any] = [replicates.get((ads, scenario)) for scenario in self.weights]
        if None in intervals:
            return None
        weights = np.array(list(self.weights.values()))[:, None]
        return _Spread(
            worse=self.of(np.nan_to_num(interval.worse) for interval in intervals),
            better=weights
            * np.nan_to_num([interval.better for interval in intervals])
            / weights.sum(),
            freedom=np.array([interval.freedom for interval in intervals]),
            lower=self.of(interval.missing[0] for interval in intervals),
            higher=self.of(interval.missing[1] for interval in intervals),
        )


class _Spread(NamedTuple):
    """m replicates of the mean S+ of one ADS over k scenarios, or of the difference of two means.

    worse: with one more case, (m,).
    better: without this case, the part of each scenario in the mean, (k, m).
    freedom: degrees of freedom of each scenario, (k,).
    lower: how far missing cases may move the mean down, at most 0.
    higher: how far missing cases may move the mean up, at least 0.
    """

    worse: FloatArray
    better: FloatArray
    freedom: IntArray
    lower: float
    higher: float

    def minus(self, other: _Spread) -> _Spread:
        """The difference to another ADS. `lower` has missing cases at their worst for this ADS and
        at their best for the other, `higher` the reverse.
        """
        return _Spread(
            self.worse - other.worse,
            self.better - other.better,
            np.minimum(self.freedom, other.freedom),
            self.lower - other.higher,
            self.higher - other.lower,
        )

    def interval(self, value: float) -> Bounds:
        """The interval of a mean or difference; it always contains the value itself.

        value: of the cases as they are.

        Each scenario counts in the degrees of freedom by its variance (Satterthwaite 1946).
        """
        both = np.stack([self.worse, self.better.sum(axis=0)])
        variance = self.better.var(axis=1) + 1e-12  # above 0, because it is a divisor
        ends = percentiles(
            both.min(axis=0) + self.lower,
            both.max(axis=0) + self.higher,
            variance.sum() ** 2 / (variance**2 / self.freedom).sum(),
        )
        assert ends is not None  # `_Means` has made all sums finite
        return min(ends[0], value), max(ends[1], value)
