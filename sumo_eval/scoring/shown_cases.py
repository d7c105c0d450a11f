"""Choice of the cases on the report's page, for a run with more cases than a page can hold.

Users: `report/html.py`, `report/sent_drives.py`.
"""

from collections.abc import Collection

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.results import Evaluation
from sumo_eval.scoring.behaviour import least_human, ranked, worst_case
from sumo_eval.trajectory import FloatArray, IntArray

# most cases on a page, of all ADSs and scenarios together; with more it would be over 10 MB
MOST_SHOWN = 5_000
# Weights in the choice: of a named case, which is always chosen; of a case that was not evaluated;
# the least of an incident, which weighs at most HIT + 1. Any other case weighs at most 1.
_NAMED_WEIGHT, _UNEVALUATED_WEIGHT, HIT = 5.0, 4.0, 2.0


def shown_cases(evaluation: Evaluation, named: Collection[str] = ()) -> dict[str, IntArray]:
    """Scenario -> indices of the cases on the page, the same for each of its ADSs.

    named: keys of cases of failed limits; all of them are chosen.

    Named cases come first, with the worst case and the least human-like case of the run. Then come
    cases that were not evaluated, then incidents by U, then the least human-like cases.
    """
    cases = {
        zone.scenario: [
            evaluation.cases_behind(score) for score in evaluation.scores_in(zone.scenario)
        ]
        for zone in evaluation.zones
    }
    most = {name: max(map(len, tables), default=0) for name, tables in cases.items()}
    if len(evaluation.cases) <= MOST_SHOWN:
        return {name: np.arange(number) for name, number in most.items()}
    order = [ads.ads for ads in ranked(evaluation)]
    extremes = worst_case(evaluation, order), least_human(evaluation, order[0])
    named = {*named, *(case.case for case in extremes if case)}
    quota = max(MOST_SHOWN // len(evaluation.scores), 2)  # cases of an ADS in a scenario
    shown = {}
    for name, tables in cases.items():
        weights = np.zeros(most[name])  # of each index, the largest of all ADSs
        for table in tables:
            weights[: len(table)] = np.maximum(weights[: len(table)], case_weights(table, named))
        shown[name] = _chosen(weights, min(quota, len(weights)))
    return shown


def _chosen(weights: FloatArray, number: int) -> IntArray:
    """Indices of `number` cases, ascending: half of them weigh most, the other half are evenly
    spread over the rest. All named cases are chosen, even if they are more than half or `number`.

    weights: of all cases, (n,).
    """
    named = int(np.count_nonzero(weights == _NAMED_WEIGHT))
    by_weight = max(number // 2, named)
    heaviest, rest = np.split(np.argsort(-weights, kind="stable"), [by_weight])
    further = max(number - by_weight, 0)
    evenly = np.sort(rest)[np.arange(further) * len(rest) // further]
    return np.sort(np.concatenate([heaviest, evenly]))


def case_weights(cases: CaseTable, named: Collection[str] = ()) -> FloatArray:
    """Weight of each case in a choice, (n,): how much a reader learns from it.

    named: keys of cases that must be chosen.
    """
    severity = np.nan_to_num(cases.incident_severity)
    harm = HIT + severity / max(float(severity.max(initial=0.0)), 1.0)
    weights = np.where(cases.incident, harm, np.nan_to_num(1.0 - cases.human_likeness))
    weights = np.where(cases.evaluated, weights, _UNEVALUATED_WEIGHT)
    return np.where(np.isin(cases.case, list(named)), _NAMED_WEIGHT, weights)
