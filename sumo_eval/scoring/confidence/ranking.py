"""ADSs in the order of S+ over all scenarios, and which of them can be told apart.

Two ADSs drove the same points beside the same drivers, so what they have in common cancels in their
difference, as it does not between two intervals. Each replicate gives the difference twice, with
and without the one more case that every ADS receives (`intervals`); each end takes the one that
speaks against it. Missing cases speak against the ADS that lacks them. One ADS under two names
differs from itself by 0, exactly.

S+ over several scenarios is the mean of theirs. A scenario without a safe point has no task to
drive, no S+ and no part in the order. In one without people to compare with H counts 0, for every
ADS alike.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sumo_eval.record.points import scenario_weights
from sumo_eval.results import RankedAds, RankedPair, Ranking, ScenarioResult
from sumo_eval.scoring.confidence.intervals import LEVEL, ScoreIntervals
from sumo_eval.settings import RankingSettings
from sumo_eval.trajectory import FloatArray

Found = Mapping[tuple[str, str], ScoreIntervals | None]


def rank(scores: Sequence[ScenarioResult], found: Found, settings: RankingSettings) -> Ranking:
    """The ranking of an evaluation's ADSs.

    found: the replicates of each ADS in each scenario, by (ADS, scenario).

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
    totals = {name: total for name in names if (total := means.total(own[name])) is not None}
    spreads = {
        name: means.spread({scenario: found.get((name, scenario)) for scenario in weights})
        for name in names
    }
    ranked = sorted(totals, key=lambda name: (-totals[name], name))
    pairs = [
        _pair((above, below), totals[above] - totals[below], spreads)
        for above, below in itertools.combinations(ranked, 2)
    ]
    apart = {(pair.above, pair.below): pair.told_apart for pair in pairs}
    rows, place = [], 0
    for number, name in enumerate(ranked, start=1):
        if number == 1 or apart[ranked[number - 2], name]:
            place = number
        interval = _interval(own[name], totals[name], spreads[name], means)
        results = [own[name][scenario] for scenario in means.weights]
        from_a, from_h = (
            means.of(getattr(score, part) for score in results) for part in ("a_points", "h_points")
        )
        rows.append(RankedAds(name, place, totals[name], interval, from_a, from_h))
    rows += [RankedAds(name, None, None, None) for name in sorted(set(names) - set(ranked))]
    taskless = tuple(name for name in weighing if name not in known)
    return Ranking(weights, LEVEL, tuple(rows), tuple(pairs), bare, taskless)


@dataclass(frozen=True, slots=True)
class _Means:
    """Means over the scenarios that weigh and have a task.

    weights: above 0, by scenario.
    """

    weights: Mapping[str, float]

    def of(self, values: Iterable[Any]) -> Any:
        """The mean of values, one a scenario: numbers or arrays."""
        weights = self.weights.values()
        pairs = zip(weights, values, strict=True)
        return sum(weight * value for weight, value in pairs) / sum(weights)

    def total(self, scores: Mapping[str, ScenarioResult]) -> float | None:
        """S+ of one ADS; None where it has none in a scenario.

        scores: by scenario.
        """
        plus = [scores[name].s_plus if name in scores else None for name in self.weights]
        return None if not plus or None in plus else float(self.of(plus))

    def spread(self, found: Mapping[str, ScoreIntervals | None]) -> _Spread | None:
        """`total` of every replicate; None where a scenario has no replicates."""
        known = [one for name in self.weights if (one := found.get(name)) is not None]
        if not known or len(known) < len(self.weights):
            return None
        parts = [
            (np.nan_to_num(one.worse), np.nan_to_num(one.better), *one.missing) for one in known
        ]
        return _Spread(*map(self.of, zip(*parts, strict=True)))


@dataclass(frozen=True, slots=True, eq=False)
class _Spread:
    """One ADS's mean S+ in every replicate, (m,).

    worse, better: with one more case and without.
    lower, higher: how far missing cases may move it.
    """

    worse: FloatArray
    better: FloatArray
    lower: float
    higher: float


def _interval(
    own: Mapping[str, ScenarioResult], total: float, spread: _Spread | None, means: _Means
) -> tuple[float, float] | None:
    """Of one ADS's mean: that of its replicates; in a single scenario the interval that its S+ has
    there.
    """
    if len(means.weights) == 1:
        return own[next(iter(means.weights))].s_plus_interval
    if spread is None:
        return None
    low, high = _percentiles(spread.worse + spread.lower, spread.better + spread.higher)
    return min(low, total), max(high, total)


def _pair(
    names: tuple[str, str], difference: float, spreads: Mapping[str, _Spread | None]
) -> RankedPair:
    first, second = (spreads[name] for name in names)
    if first is None or second is None:
        return RankedPair(*names, difference, None, False)
    both = np.stack([first.worse - second.worse, first.better - second.better])
    low, high = _percentiles(
        both.min(axis=0) + first.lower - second.higher,
        both.max(axis=0) + first.higher - second.lower,
    )
    low, high = min(low, difference), max(high, difference)
    return RankedPair(*names, difference, (low, high), low > 0.0)


def _percentiles(low: FloatArray, high: FloatArray) -> tuple[float, float]:
    tail = (1.0 - LEVEL) / 2.0
    return float(np.quantile(low, tail)), float(np.quantile(high, 1.0 - tail))
