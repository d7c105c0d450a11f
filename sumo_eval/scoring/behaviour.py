"""Behaviour of each ADS of a run in all scenarios together, and its cases to look at first.

Users: `report.headline`, `report.summary`, `scoring.shown_cases`.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import point_numbers
from sumo_eval.cases import CaseResult
from sumo_eval.results import Evaluation, RankedAds
from sumo_eval.scoring.findings import findings_of, mean_of
from sumo_eval.scoring.rule import sign_test

CONTACT = 50.0 / 3.6
"""Impact speed that counts as one contact in `Behaviour.contacts`, m/s."""
BY_CHANCE = 0.05
"""Two ADSs count as different if the sign test's P is below this."""


class Behaviour(NamedTuple):
    """One ADS in all scenarios of a run. Integers are numbers of cases.

    avoidable: collisions that the ideal vehicle avoids.
    stands: safe cases in which the ADS stands where the references drive.
    slower: safe cases in which the ADS does not stand but is slower than the references.
    implausible: safe cases of plausibility 0, beyond all recorded people; 0 if these are at most
        half of the safe cases with a human-likeness.
    worst: impact speed of the hardest avoidable collision, m/s; 0 without such a collision.
    excess: mean of max(0, U - Ug) by exposure, m/s; 0 if nothing could be evaluated.
    grade: A'; None if it does not exist.
    human: H; None if it does not exist.
    """

    ads: str
    cases: int
    collisions: int
    avoidable: int
    departures: int
    stands: int
    slower: int
    implausible: int
    gave_up: int
    not_evaluated: int
    worst: float
    excess: float
    grade: float | None
    human: float | None

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
        order.append(RankedAds(ads, None, _mean((it.s_plus, 1.0) for it in scores), interval))
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

    def total(field: str) -> int:
        """Sum of a field of the scores over the scenarios."""
        return sum(getattr(score, field) for score in scores)

    def mean(values: Iterable[float | None], *, skip_missing: bool = False) -> float | None:
        """Mean of a value of each scenario.

        skip_missing: whether a scenario without a value is left out. If not, the mean is None.
        """
        return _mean(
            pair
            for pair in zip(values, weights, strict=True)
            if not skip_missing or pair[0] is not None
        )

    return Behaviour(
        ads,
        cases=total("cases"),
        collisions=total("collisions"),
        avoidable=total("avoidable_collisions"),
        departures=total("departures"),
        stands=stands,
        slower=sum(int(findings.slow.sum()) for findings in parts) - stands,
        implausible=int(beyond.sum()) if beyond.sum() > len(beyond) / 2 else 0,
        gave_up=total("gave_up"),
        not_evaluated=total("not_evaluated"),
        worst=max(
            float(findings.cases.impact_speed[findings.cases.avoidable].max(initial=0.0))
            for findings in parts
        ),
        excess=mean(
            (mean_of(findings.beyond, findings.cases.exposure) for findings in parts),
            skip_missing=True,
        )
        or 0.0,
        grade=mean(score.avoidance_grade for score in scores),
        human=mean((score.human_likeness for score in scores), skip_missing=True),
    )


def _mean(values: Iterable[tuple[float | None, float]]) -> float | None:
    """The mean of pairs (value, weight). None if all weights are 0, or if a value is missing whose
    weight is above 0.
    """
    pairs = list(values)
    whole = sum(weight for _, weight in pairs)
    if not whole or any(value is None for value, weight in pairs if weight):
        return None
    # a value that weighs 0 may be None
    return sum((value or 0.0) * weight for value, weight in pairs) / whole


class HarmBeside(NamedTuple):
    """Avoidable harm of an ADS compared with a second ADS, in numbers of points.

    less: points at which the ADS does less avoidable harm than the second.
    more: points at which it does more.
    common: points at which both have a case.
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
    return HarmBeside(int((harm < 0.0).sum()), int((harm > 0.0).sum()), len(harm))


def worst_case(evaluation: Evaluation, order: Sequence[str]) -> CaseResult | None:
    """The case to look at first: of the first ADS in `order` that lost any of A, the case that
    lowers its A most. If no ADS lost any, the least human-like case of the first ADS.

    order: names of the ADSs.
    """
    for ads in order:
        worst: list[tuple[float, str, CaseResult]] = []
        for findings in findings_of(evaluation, ads):
            losses = np.nan_to_num(findings.share_lost)
            if (most := float(losses.max(initial=0.0))) > 0.0:
                # of equal cases the last name counts, by `max`
                worst += [(most, case.case, case) for case in findings.cases[losses == most]]
        if worst:
            return max(worst)[2]
    return least_human(evaluation, order[0])


def least_human(evaluation: Evaluation, ads: str) -> CaseResult | None:
    """The case without a collision in which an ADS is least human-like; None without such a
    case.
    """
    least = []
    for findings in findings_of(evaluation, ads):
        likeness = np.where(findings.cases.collided, np.inf, findings.cases.human_likeness)
        lowest = float(np.fmin.reduce(likeness, initial=np.inf))  # fmin leaves out nan
        if lowest < np.inf:
            least += [(lowest, case.case, case) for case in findings.cases[likeness == lowest]]
    return min(least)[2] if least else None
