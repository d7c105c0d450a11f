"""ADSs in the order of S+ over all scenarios, and which of them can be told apart.

Two ADSs drove the same points beside the same drivers, so what they have in common cancels in their difference, as it
does not between two intervals. Each replicate gives the difference; unseen collisions are on the side of the ADS that
it speaks against at each end, because each ADS has its own.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from sumo_eval.record.points import scenario_weights
from sumo_eval.results import RankedAds, RankedPair, Ranking, ScenarioResult
from sumo_eval.scoring.confidence.intervals import LEVEL, ScoreIntervals
from sumo_eval.settings import RankingSettings
from sumo_eval.trajectory import FloatArray

Found = Mapping[tuple[str, str], ScoreIntervals | None]


def rank(scores: Sequence[ScenarioResult], found: Found, settings: RankingSettings, level: float = LEVEL) -> Ranking:
    """The ranking of an evaluation's ADSs. found: the replicates of each ADS in each scenario, by (ADS, scenario)."""
    weights = scenario_weights(list(dict.fromkeys(score.scenario for score in scores)), settings)
    names = list(dict.fromkeys(score.ads for score in scores))
    totals = {name: _total([score for score in scores if score.ads == name], weights) for name in names}
    spreads = {name: _spread(name, found, weights) for name in names}
    ranked = sorted(
        (name for name in names if totals[name] is not None), key=lambda name: (-(totals[name] or 0.0), name)
    )
    pairs = [
        _pair(above, below, (totals[above] or 0.0) - (totals[below] or 0.0), spreads[above], spreads[below], level)
        for above, below in itertools.combinations(ranked, 2)
    ]
    apart = {(pair.above, pair.below): pair.told_apart for pair in pairs}
    rows, place = [], 0
    for number, name in enumerate(ranked, start=1):
        if number == 1 or apart[ranked[number - 2], name]:
            place = number
        rows.append(RankedAds(name, place, totals[name], _interval(name, scores, totals[name], spreads[name], weights)))
    rows += [RankedAds(name, None, None, None) for name in sorted(names) if totals[name] is None]
    return Ranking(weights, level, tuple(rows), tuple(pairs))


def _total(scores: Sequence[ScenarioResult], weights: Mapping[str, float]) -> float | None:
    """Mean S+ of one ADS over the scenarios that weigh."""
    counted = [(weights[score.scenario], score.s_plus) for score in scores if weights[score.scenario] > 0.0]
    if any(value is None for _, value in counted):
        return None
    return sum(weight * (value or 0.0) for weight, value in counted) / sum(weight for weight, _ in counted)


def _spread(name: str, found: Found, weights: Mapping[str, float]) -> tuple[FloatArray, FloatArray] | None:
    """The mean S+ of every replicate, with unseen collisions and without, and with what missing cases leave open."""
    parts = [(weight, found.get((name, scenario))) for scenario, weight in weights.items() if weight > 0.0]
    known = [(weight, one) for weight, one in parts if one is not None]
    if len(known) < len(parts):
        return None
    total = sum(weight for weight, _ in known)
    worse, better = (
        np.sum([weight * (np.nan_to_num(getattr(one, kind)) + one.missing[end]) for weight, one in known], axis=0)
        / total
        for end, kind in enumerate(("worse", "better"))
    )
    return worse, better


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
