"""Choice of cases for a page, where a run has more than a page can hold."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from sumo_eval.cases import CaseTable, IntArray
from sumo_eval.results import Evaluation
from sumo_eval.scoring.behaviour import least_human, ranked, worst_case
from sumo_eval.trajectory import FloatArray

# cases that the page has, of all ADSs and scenarios together: with more it would be over 10 MB
MOST_SHOWN = 5_000
# a case that is named elsewhere, not evaluated, with an incident; others at most 1
_NAMED, _LOST, HIT = 5.0, 4.0, 2.0


def shown_cases(evaluation: Evaluation, named: Collection[str] = ()) -> dict[str, IntArray]:
    """Cases that the page has, by scenario: their places among those of each of its ADSs.

    Half of them tell most: not evaluated, incidents by U, the least human-like; the other half lie
    evenly among the rest.

    named: cases of failed limits; with the worst case and the least human-like one they tell more
        than all others.
    """
    cases = {
        zone.scenario: [
            evaluation.cases_of(one.ads, one.scenario)
            for one in evaluation.scores_in(zone.scenario)
        ]
        for zone in evaluation.zones
    }
    most = {name: max(map(len, tables), default=0) for name, tables in cases.items()}
    if sum(len(table) for tables in cases.values() for table in tables) <= MOST_SHOWN:
        return {name: np.arange(number) for name, number in most.items()}
    order = [one.ads for one in ranked(evaluation)]
    first = worst_case(evaluation, order), least_human(evaluation, order[0])
    named = {*named, *(one.case for one in first if one)}
    quota = max(MOST_SHOWN // max(len(evaluation.scores), 1), 2)
    found = {}
    for name, tables in cases.items():
        tells = np.zeros(most[name])
        for table in tables:
            tells[: len(table)] = np.maximum(tells[: len(table)], telling(table, named))
        few = min(quota, len(tells))
        told, rest = np.split(np.argsort(-tells, kind="stable"), [few // 2])
        evenly = np.sort(rest)[np.arange(few - few // 2) * len(rest) // (few - few // 2 or 1)]
        found[name] = np.sort(np.concatenate([told, evenly]))
    return found


def telling(cases: CaseTable, named: Collection[str] = ()) -> FloatArray:
    """Weight of each case in a choice: how much it tells a reader, (n,)."""
    severity = np.nan_to_num(cases.incident_severity)
    harm = HIT + severity / max(float(severity.max(initial=0.0)), 1.0)
    tells = np.where(cases.incident, harm, np.nan_to_num(1.0 - cases.human_likeness))
    tells = np.where(cases.evaluated, tells, _LOST)
    return np.where(np.isin(cases.case, list(named)), _NAMED, tells)
