"""ADSs in the order of S+ over all scenarios, and which of them can be told apart.

Two ADSs drove the same points beside the same drivers, so what they have in common cancels in their difference, as it
does not between two intervals. Each replicate gives the difference; unseen collisions are on the side of the ADS that
it speaks against at each end, because each ADS has its own. Where two ADSs drove every case of a scenario alike, the
scenario has no part in what tells them apart: what was not seen there is as common to both as what was. So one ADS
under two names differs from itself by 0, exactly.

S+ over several scenarios is the mean of theirs. A scenario without a safe point has no task to
drive, no S+ and no part in the order. In one without people to compare with H counts 0, for every ADS alike.
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

    Scenarios without any S+ are left out.
    """
    weights = scenario_weights(list(dict.fromkeys(score.scenario for score in scores)), settings)
    weighing = [name for name, weight in weights.items() if weight > 0.0]
    alone = {score.scenario for score in scores if score.nobody_compared}
    bare = tuple(name for name in weighing if name in alone)
    known = {score.scenario for score in scores if score.task_share is not None}
    means = _Means({name: weights[name] for name in weighing if name in known})
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
        interval = _interval(own[name], totals[name], spreads[name], means)
        from_a, from_h = (
            means.of({scenario: getattr(score, part) for scenario, score in own[name].items()})
            for part in ("a_points", "h_points")
        )
        rows.append(RankedAds(name, place, totals[name], interval, from_a, from_h))
    rows += [RankedAds(name, None, None, None) for name in sorted(names) if totals[name] is None]
    taskless = tuple(name for name in weighing if name not in known)
    return Ranking(weights, level, tuple(rows), tuple(pairs), bare, taskless)


@dataclass(frozen=True, slots=True)
class _Means:
    """Means over the scenarios that weigh and have a task. weights: above 0, by scenario."""

    weights: Mapping[str, float]

    def of(self, values: Mapping[str, float]) -> float:
        """The mean of values by scenario."""
        return sum(weight * values[name] for name, weight in self.weights.items()) / sum(self.weights.values())

    def total(self, scores: Mapping[str, ScenarioResult]) -> float | None:
        """S+ of one ADS; None where it has none in a scenario. scores: by scenario."""
        plus = {name: scores[name].s_plus for name in self.weights if name in scores}
        if not plus or len(plus) < len(self.weights) or None in plus.values():
            return None
        return self.of({name: value or 0.0 for name, value in plus.items()})

    def spread(self, found: Mapping[str, ScoreIntervals | None]) -> tuple[FloatArray, FloatArray] | None:
        """`total` of every replicate, with one more case and without, and with what missing cases leave open."""
        known = {name: one for name in self.weights if (one := found.get(name)) is not None}
        if not known or len(known) < len(self.weights):
            return None
        worse, better = (
            np.sum(
                [
                    weight * (np.nan_to_num(getattr(known[name], side)) + known[name].missing[end])
                    for name, weight in self.weights.items()
                ],
                axis=0,
            )
            / sum(self.weights.values())
            for end, side in enumerate(("worse", "better"))
        )
        return worse, better


def _interval(
    own: Mapping[str, ScenarioResult],
    total: float | None,
    spread: tuple[FloatArray, FloatArray] | None,
    means: _Means,
) -> tuple[float, float] | None:
    """Of one ADS's mean: that of its replicates; in a single scenario the interval that its S+ has there."""
    if len(means.weights) == 1:
        return own[next(iter(means.weights))].s_plus_interval
    if total is None or spread is None:
        return None
    low, high = _percentiles(*spread, LEVEL)
    return min(low, total), max(high, total)


def _without_same_drives(
    first: Mapping[str, ScoreIntervals | None], second: Mapping[str, ScoreIntervals | None]
) -> tuple[Mapping[str, ScoreIntervals | None], Mapping[str, ScoreIntervals | None]] | None:
    """Both ADSs' replicates by scenario, 0 for both where they drove alike; None where they do so nowhere."""
    alike = {
        name: replace(one, worse=zero, better=zero)
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
