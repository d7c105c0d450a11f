"""ADSs in the order of S+ over all scenarios, and which of them can be told apart.

Two ADSs drove the same points beside the same drivers, so what they have in common cancels in their difference, as it
does not between two intervals. Each replicate gives the difference; unseen collisions are on the side of the ADS that
it speaks against at each end, because each ADS has its own. Where two ADSs drove every case of a scenario alike, the
scenario has no part in what tells them apart: what was not seen there is as common to both as what was. So one ADS
under two names differs from itself by 0, exactly.

S+ = a A + b H over all scenarios. Where nobody is there to compare with, there is no H: A is the mean over all of them,
H over those with people. With people everywhere that is the mean of S+.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sumo_eval.record.points import scenario_weights
from sumo_eval.results import RankedAds, RankedPair, Ranking, ScenarioResult
from sumo_eval.scoring.confidence.intervals import LEVEL, ScoreIntervals
from sumo_eval.settings import RankingSettings
from sumo_eval.trajectory import FloatArray

Found = Mapping[tuple[str, str], ScoreIntervals | None]


def rank(scores: Sequence[ScenarioResult], found: Found, settings: RankingSettings, level: float = LEVEL) -> Ranking:
    """The ranking of an evaluation's ADSs. found: the replicates of each ADS in each scenario, by (ADS, scenario).

    A scenario that has nobody to compare with has no H: there A counts, and H is the mean over the other scenarios.
    """
    weights = scenario_weights(list(dict.fromkeys(score.scenario for score in scores)), settings)
    alone = {score.scenario for score in scores if score.nobody_compared}
    bare = tuple(name for name, weight in weights.items() if weight > 0.0 and name in alone)
    means = _Means({name: weight for name, weight in weights.items() if weight > 0.0}, frozenset(bare))
    names = list(dict.fromkeys(score.ads for score in scores))
    own = {name: {score.scenario: score for score in scores if score.ads == name} for name in names}
    totals = {name: means.total(own[name]) for name in names}
    own_found = {name: {scenario: found.get((name, scenario)) for scenario in weights} for name in names}
    spreads = {name: means.spread(own_found[name]) for name in names}
    ranked = sorted(
        (name for name in names if totals[name] is not None), key=lambda name: (-(totals[name] or 0.0), name)
    )
    pairs = []
    for above, below in itertools.combinations(ranked, 2):
        apart_in = _without_same_drives(own_found[above], own_found[below])
        first, second = (spreads[above], spreads[below]) if apart_in is None else map(means.spread, apart_in)
        pairs.append(_pair(above, below, (totals[above] or 0.0) - (totals[below] or 0.0), first, second, level))
    apart = {(pair.above, pair.below): pair.told_apart for pair in pairs}
    rows, place = [], 0
    for number, name in enumerate(ranked, start=1):
        if number == 1 or apart[ranked[number - 2], name]:
            place = number
        interval = _interval(name, scores, totals[name], spreads[name], weights)
        from_a = means.everywhere({scenario: score.a_points for scenario, score in own[name].items()})
        from_h = means.where_people({scenario: score.h_points for scenario, score in own[name].items()})
        rows.append(RankedAds(name, place, totals[name], interval, from_a, from_h))
    rows += [RankedAds(name, None, None, None) for name in sorted(names) if totals[name] is None]
    return Ranking(weights, level, tuple(rows), tuple(pairs), bare)


@dataclass(frozen=True, slots=True)
class _Means:
    """Means over the scenarios that weigh. weights: above 0, by scenario. bare: those with nobody to compare with."""

    weights: Mapping[str, float]
    bare: frozenset[str]

    def everywhere(self, values: Mapping[str, float]) -> float:
        """The mean of all. values: by scenario."""
        return sum(weight * values[name] for name, weight in self.weights.items()) / sum(self.weights.values())

    def where_people(self, values: Mapping[str, float]) -> float:
        """The mean of those with people."""
        kept = {name: weight for name, weight in self.weights.items() if name not in self.bare}
        return sum(weight * values[name] for name, weight in kept.items()) / sum(kept.values())

    def total(self, scores: Mapping[str, ScenarioResult]) -> float | None:
        """S+ of one ADS: the mean of S+ where there are people, with the points of A of all scenarios in place of
        theirs. scores: by scenario. None where one is missing, or nowhere are people.
        """
        counted = {name: score for name, score in scores.items() if name in self.weights}
        people = {name: score.s_plus for name, score in counted.items() if name not in self.bare}
        if not people or any(value is None for value in people.values()):
            return None
        if any(counted[name].avoided_share is None for name in self.bare):
            return None
        plus = self.where_people({name: value or 0.0 for name, value in people.items()})
        from_a = {name: score.a_points for name, score in counted.items()}
        return plus + (self.everywhere(from_a) - self.where_people(from_a))

    def spread(self, found: Mapping[str, ScoreIntervals | None]) -> tuple[FloatArray, FloatArray] | None:
        """`total` of every replicate, with unseen collisions and without, and with what missing cases leave open."""
        known = {name: one for name, one in found.items() if name in self.weights and one is not None}
        if len(known) < len(self.weights) or len(self.bare) == len(self.weights):
            return None
        kept = {name: weight for name, weight in self.weights.items() if name not in self.bare}
        total, peopled = sum(self.weights.values()), sum(kept.values())
        ends = []
        for end, (plus, a) in enumerate((("worse", "worse_a"), ("better", "better_a"))):
            s_plus = [
                weight * (np.nan_to_num(getattr(known[name], plus)) + known[name].missing[end])
                for name, weight in kept.items()
            ]
            mean = np.sum(s_plus, axis=0) / peopled
            if self.bare:
                for name, weight in self.weights.items():
                    points = np.nan_to_num(getattr(known[name], a)) + known[name].missing_a[end]
                    mean = mean + points * (weight / total - kept.get(name, 0.0) / peopled)
            ends.append(mean)
        return ends[0], ends[1]


def _interval(
    name: str,
    scores: Sequence[ScenarioResult],
    total: float | None,
    spread: tuple[FloatArray, FloatArray] | None,
    weights: Mapping[str, float],
) -> tuple[float, float] | None:
    """Of one ADS's mean: that of its replicates; in a single scenario the interval that its S+ has there."""
    weighed = [score for score in scores if score.ads == name and weights[score.scenario] > 0.0]
    if len(weighed) == 1:
        return weighed[0].s_plus_interval
    if total is None or spread is None:
        return None
    low, high = _percentiles(*spread, LEVEL)
    return min(low, total), max(high, total)


def _without_same_drives(
    first: Mapping[str, ScoreIntervals | None], second: Mapping[str, ScoreIntervals | None]
) -> tuple[Mapping[str, ScoreIntervals | None], Mapping[str, ScoreIntervals | None]] | None:
    """Both ADSs' replicates by scenario, 0 for both where they drove alike; None where they do so nowhere."""
    alike = {
        name: replace(one, worse=zero, better=zero, worse_a=zero, better_a=zero)
        for name, one in first.items()
        if one is not None and one.same_drives is not None
        if (other := second[name]) is not None and other.same_drives == one.same_drives
        for zero in [np.zeros(len(one.worse))]
    }
    return ({**first, **alike}, {**second, **alike}) if alike else None


def _pair(
    above: str,
    below: str,
    difference: float,
    first: tuple[FloatArray, FloatArray] | None,
    second: tuple[FloatArray, FloatArray] | None,
    level: float,
) -> RankedPair:
    if first is None or second is None:
        return RankedPair(above, below, difference, None, False)
    low, high = _percentiles(first[0] - second[1], first[1] - second[0], level)
    interval = min(low, difference), max(high, difference)
    return RankedPair(above, below, difference, interval, interval[0] > 0.0)


def _percentiles(low: FloatArray, high: FloatArray, level: float) -> tuple[float, float]:
    tail = (1.0 - level) / 2.0
    return float(np.quantile(low, tail)), float(np.quantile(high, 1.0 - tail))
