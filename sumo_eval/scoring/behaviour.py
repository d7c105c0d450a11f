"""Behaviour of each ADS of a run in all scenarios together, and its cases to look at first.

Users: `report.headline`, `report.summary`, `scoring.shown_cases`.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import point_numbers
from sumo_eval.cases import CaseResult
from sumo_eval.results import Evaluation, RankedAds
from sumo_eval.scoring.findings import Findings, findings_of, mean_of
from sumo_eval.scoring.rule import sign_test
from sumo_eval.trajectory import FloatArray

CONTACT = 50.0 / 3.6
"""Impact speed that counts as one contact in `Behaviour.contacts`, m/s."""
BY_CHANCE = 0.05
"""Two ADSs count as different if the sign test's P is below this."""


class Behaviour(NamedTuple):
    """One ADS in all scenarios of a run. Integers are numbers of cases.

    avoidable_collisions: those that the ideal vehicle avoids.
    stands: safe cases in which the ADS stands where the references drive.
    slower: safe cases in which the ADS does not stand but is slower than the references.
    implausible: safe cases of plausibility 0, beyond all recorded people; 0 if these are at most
        half of the safe cases with a human-likeness.
    worst: impact speed of the hardest avoidable collision, m/s; 0 without such a collision.
    excess: mean of max(0, U - Ug) by exposure, m/s; 0 if nothing could be evaluated.
    grade: A'; None if it does not exist.
    human: H; None if it does not exist.
    task: T; None if it does not exist.
    """

    ads: str
    cases: int
    collisions: int
    avoidable_collisions: int
    departures: int
    gave_up: int
    not_evaluated: int
    stands: int
    slower: int
    implausible: int
    worst: float
    excess: float
    grade: float | None
    human: float | None
    task: float | None

    @property
    def contacts(self) -> float:
        """The excess in units of `CONTACT`; 1 means one contact at this speed in every case."""
        return self.excess / CONTACT


def ranked(evaluation: Evaluation) -> tuple[RankedAds, ...]:
    """The ADSs by their place in the ranking. Without a ranking: by the mean S+ of their scenarios,
    ADSs without S+ last, equal ADSs in the evaluation's order.
    """
    if evaluation.ranking is not None and evaluation.ranking.ads:
        return evaluation.ranking.ads
    order = []
    for ads in evaluation.ads_names:
        scores = [score for score in evaluation.scores if score.ads == ads]
        interval = scores[0].s_plus_interval if len(scores) == 1 else None
        mean = _mean([it.s_plus for it in scores], [1.0] * len(scores))
        order.append(RankedAds(ads, None, mean, interval))
    # -S+ is at most 0, so 1.0 puts an ADS without S+ last
    return tuple(sorted(order, key=lambda ads: 1.0 if ads.s_plus is None else -ads.s_plus))


def behaviour_of(evaluation: Evaluation, ads: str) -> Behaviour:
    """Behaviour of one ADS in all scenarios: sums, and means by the weights of the ranking."""
    parts = findings_of(evaluation, ads)
    scores = [findings.score for findings in parts]
    by_scenario = {} if evaluation.ranking is None else evaluation.ranking.weights
    weights = [by_scenario.get(score.scenario, 1.0) for score in scores]
    stands = sum(int(findings.stands.sum()) for findings in parts)  # `slow` contains these cases
    # whether each safe case with a human-likeness has plausibility 0
    beyond = np.concatenate([part.cases.plausibility[part.likened] == 0.0 for part in parts])
    excess = [mean_of(findings.beyond, findings.cases.exposure) for findings in parts]
    counts = "cases", "collisions", "avoidable_collisions", "departures", "gave_up", "not_evaluated"
    return Behaviour(
        ads,
        **{count: sum(getattr(score, count) for score in scores) for count in counts},
        stands=stands,
        slower=sum(int(findings.slow.sum()) for findings in parts) - stands,
        implausible=int(beyond.sum()) if beyond.sum() > len(beyond) / 2 else 0,
        worst=max(
            float(findings.cases.impact_speed[findings.cases.avoidable].max(initial=0.0))
            for findings in parts
        ),
        excess=_mean(excess, weights, skip_missing=True) or 0.0,
        grade=_mean([score.avoidance_grade for score in scores], weights),
        human=_mean([score.human_likeness for score in scores], weights, skip_missing=True),
        task=_mean([score.task_share for score in scores], weights, skip_missing=True),
    )


def _mean(
    values: Sequence[float | None], weights: Sequence[float], *, skip_missing: bool = False
) -> float | None:
    """The weighted mean of a value of each scenario. None if all weights are 0, or if a value is
    missing whose weight is above 0.

    skip_missing: whether a scenario without a value is left out instead.
    """
    pairs = [
        (value, weight)
        for value, weight in zip(values, weights, strict=True)
        if not (skip_missing and value is None)
    ]
    whole = sum(weight for _, weight in pairs)
    if not whole or any(value is None for value, weight in pairs if weight):
        return None
    # a value that weighs 0 may be None
    return sum((value or 0.0) * weight for value, weight in pairs) / whole


class HarmBeside(NamedTuple):
    """Avoidable harm of an ADS compared with a second ADS, in numbers of points.

    less: points at which the ADS does less avoidable harm than the second.
    more: points at which it does more.
    common: points at which the harm of both is known.
    """

    less: int
    more: int
    common: int

    @property
    def chance(self) -> float:
        """P of the two-sided sign test: twice P of the one-sided test of the larger number."""
        return min(1.0, 2.0 * sign_test(max(self.less, self.more), min(self.less, self.more)))

    @property
    def told_apart(self) -> bool:
        """Whether the ADS does less harm than the second ADS, and not by chance."""
        return self.chance < BY_CHANCE and self.less > self.more


def harm_beside(evaluation: Evaluation, first: str, second: str) -> HarmBeside:
    """Compare the avoidable harm of two ADSs point by point."""
    of_second = {findings.score.scenario: findings for findings in findings_of(evaluation, second)}
    differences = [np.empty(0)]
    for own in findings_of(evaluation, first):
        if (other := of_second.get(own.score.scenario)) is not None:
            points, other_points = point_numbers([own.cases, other.cases])
            # rows of the common points in both tables
            rows, other_rows = np.intersect1d(points, other_points, return_indices=True)[1:]
            differences.append(own.beyond[rows] - other.beyond[other_rows])
    harm = np.concatenate(differences)
    return HarmBeside(
        int((harm < 0.0).sum()), int((harm > 0.0).sum()), int(np.isfinite(harm).sum())
    )


def worst_case(evaluation: Evaluation, order: Sequence[str]) -> CaseResult | None:
    """The case to look at first: of the first ADS in `order` that lost any of A, the case that
    lowers its A most. If no ADS lost any, the least human-like case of the first ADS.

    order: names of the ADSs.
    """
    for ads in order:
        worst = _least(
            (it, np.where(it.share_lost > 0.0, -it.share_lost, np.nan))
            for it in findings_of(evaluation, ads)
        )
        if worst is not None:
            return worst
    return least_human(evaluation, order[0])


def least_human(evaluation: Evaluation, ads: str) -> CaseResult | None:
    """The case without a collision in which an ADS is least human-like; None without such a
    case.
    """
    return _least(
        (it, np.where(it.cases.collided, np.nan, it.cases.human_likeness))
        for it in findings_of(evaluation, ads)
    )


def _least(values_of: Iterable[tuple[Findings, FloatArray]]) -> CaseResult | None:
    """The case with the least value; of equal cases the first by name. None if all are nan.

    values_of: findings of some scenarios, and a value of each case, (n,).
    """
    least = []
    for findings, values in values_of:
        lowest = float(np.fmin.reduce(values, initial=np.inf))  # fmin leaves out nan
        least += [(lowest, case.case, case) for case in findings.cases[values == lowest]]
    return min(least)[2] if least else None
