"""Which cases a page has where a run has more than a page can hold."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from sumo_eval.cases import CaseResult, CaseTable, IntArray
from sumo_eval.results import Evaluation
from sumo_eval.scoring.behaviour import least_human, ranked, worst_case
from sumo_eval.trajectory import FloatArray

# cases that the page has, of all ADSs and scenarios together: with more it would be over 10 MB
MOST_SHOWN = 5_000
# a case that is named elsewhere, not evaluated, with an incident; others at most 1
_NAMED, _LOST, _HIT = 5.0, 4.0, 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """Which cases of a scenario the page has.

    places: of each ADS's cases, in their order; None: all.
    of: how many there are.
    """

    places: IntArray | None
    of: int

    def among(self, cases: CaseTable) -> Iterator[tuple[int, CaseResult]]:
        """Those of one ADS, each with its place among all of them."""
        places = range(len(cases)) if self.places is None else self.places.tolist()
        return ((place, cases[place]) for place in places if place < len(cases))

    def number(self, cases: CaseTable) -> int:
        """How many of one ADS's there are."""
        return (
            len(cases) if self.places is None else int(np.count_nonzero(self.places < len(cases)))
        )


def shown_cases(evaluation: Evaluation, named: Collection[str] = ()) -> dict[str, Shown]:
    """By scenario.

    Half of those that the page has tell most: not evaluated, incidents by U, the least human-like;
    the other half lie evenly among the rest. The ADSs of a scenario are shown at the same points.

    named: cases of failed limits; with the worst case and the least human-like one they tell more
        than all others.
    """
    every = {zone.scenario: evaluation.scores_in(zone.scenario) for zone in evaluation.zones}
    numbers = {
        name: sum(len(evaluation.cases_of(one.ads, name)) for one in scores)
        for name, scores in every.items()
    }
    if sum(numbers.values()) <= MOST_SHOWN:
        return {name: Shown(None, number) for name, number in numbers.items()}
    order = [one.ads for one in ranked(evaluation)]
    first = worst_case(evaluation, order), least_human(evaluation, order[0])
    named = {*named, *(one.case for one in first if one)}
    quota = max(MOST_SHOWN // max(len(evaluation.scores), 1), 2)
    found = {}
    for name, scores in every.items():
        told = [telling(evaluation.cases_of(one.ads, name), named) for one in scores]
        tells = np.zeros(max(map(len, told), default=0))
        for one in told:
            tells[: len(one)] = np.maximum(tells[: len(one)], one)
        if len(tells) <= quota:
            found[name] = Shown(None, numbers[name])
            continue
        most, rest = np.split(np.argsort(-tells, kind="stable"), [quota // 2])
        evenly = np.sort(rest)[np.arange(quota - quota // 2) * len(rest) // (quota - quota // 2)]
        found[name] = Shown(np.sort(np.concatenate([most, evenly])), numbers[name])
    return found


def telling(cases: CaseTable, named: Collection[str]) -> FloatArray:
    """How much each case tells, (n,)."""
    severity = np.nan_to_num(cases.incident_severity)
    harm = _HIT + severity / max(float(severity.max(initial=0.0)), 1.0)
    tells = np.where(cases.incident, harm, np.nan_to_num(1.0 - cases.human_likeness))
    tells = np.where(cases.evaluated, tells, _LOST)
    return np.where(np.isin(cases.case, list(named)), _NAMED, tells)
