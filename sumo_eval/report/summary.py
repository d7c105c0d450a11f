"""The report's first screen: the first words of a run, the case to look at first, and the ADSs in
their order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.report.comparison import Comparison, builds_besides
from sumo_eval.report.gates import GateResult
from sumo_eval.report.headline import headline, ranked
from sumo_eval.report.page import case_key
from sumo_eval.report.verdict import verdict
from sumo_eval.report.words import (
    cause_words,
    count,
    number,
    span,
)
from sumo_eval.results import Evaluation, RankedAds
from sumo_eval.scoring.findings import findings, unevaluated

MOST_CHANGES = 4  # failed limits whose worst case is named
WIDE = 20.0  # points of S+: an interval wider than this tells little


def summary_content(
    evaluation: Evaluation,
    comparison: Comparison | None,
    gates: Sequence[GateResult],
    since: Mapping[tuple[str, str, str], str],
) -> Mapping[str, Any]:
    """Content of templates/sections/summary.html.j2.

    since: when failed limits began to fail, in words.
    """
    order = ranked(evaluation)
    said = headline(evaluation)
    scenarios = [zone.scenario for zone in evaluation.zones]
    digits = (
        0
        if any(one.interval is None or one.interval[1] - one.interval[0] > WIDE for one in order)
        else 1
    )
    compared = comparison is not None or bool(gates)
    failing = [(gate, gate.worst[0]) for gate in gates if gate.passed is False and gate.worst]
    changes = [(f"{gate.quantity} of {gate.ads}: {one.point}: "
                f"{one.words}", f"#case:{case_key(one.case)}")
               for gate, one in failing[:MOST_CHANGES]]  # fmt: skip
    builds = builds_besides(evaluation.manifest.get("builds", {}), comparison)

    return {
        "verdict": verdict(comparison, gates, evaluation).sentence if compared else "",
        "failed": any(gate.passed is False for gate in gates),
        "failures": [(since.get(gate.name, ""), gate) for gate in gates if gate.passed is False]
        if compared
        else [],
        "beside": [*builds, *(one.words for one in comparison.differences)] if comparison else [],
        "answers": said.answers,
        "alarms": said.alarms,
        "worst": failing[0][1].case
        if failing
        else worst_case(evaluation, [one.ads for one in order]),
        "looks": [*changes, *_cause(evaluation, order), *_looks(evaluation, order[0].ads)],
        "rows": [_row(evaluation, one, scenarios, digits) for one in order],
        "scenarios": scenarios,
    }


def worst_case(evaluation: Evaluation, order: Sequence[str]) -> str:
    """The case that takes most from A, of the first ADS that loses any; else the least human-like
    one of the first.
    """
    hit = next((case for ads in order if (case := _costliest(evaluation, ads)) is not None), None)
    worst = hit or _least_human(evaluation, order[0])
    return "" if worst is None else worst.case


def _cause(evaluation: Evaluation, order: Sequence[RankedAds]) -> list[tuple[str, str]]:
    """The costliest contact and its cause, as in `_looks`."""
    case = evaluation.case(worst_case(evaluation, [one.ads for one in order]))
    if case is None or not (words := cause_words(case)):
        return []
    return [(f"the worst collision, of {case.ads}: {words}", f"#case:{case_key(case.case)}")]


def _looks(evaluation: Evaluation, best: str) -> list[tuple[str, str]]:
    """Links to look at next: (words, key of a case or an anchor)."""
    looks = []
    if missing := sum(map(len, unevaluated(evaluation))):
        looks.append((f"{count(missing, 'case')} that could not be evaluated", "#missing"))
    least = _least_human(evaluation, best)
    if least is not None:
        looks.append(
            (f"the least human-like case of {best}: {_at(least)}", f"#case:{case_key(least.case)}")
        )
    if (evaluation.cases.collided | ~evaluation.cases.evaluated).any():
        looks.append(("failures that are alike, in the maps", "#maps"))
    return looks


def _costliest(evaluation: Evaluation, ads: str) -> CaseResult | None:
    """The case of an ADS that takes most from A: a collision, a departure or a case given up."""
    worst: list[tuple[float, CaseResult]] = []
    for one in findings(evaluation):
        if one.score.ads == ads:
            losses = np.nan_to_num(one.share_lost)
            most = float(losses.max(initial=0.0))
            if most > 0.0:
                worst.append((most, max(one.cases[losses == most], key=lambda case: case.case)))
    return max(worst, key=lambda pair: (pair[0], pair[1].case))[1] if worst else None


def _least_human(evaluation: Evaluation, ads: str) -> CaseResult | None:
    """The case without a collision in which an ADS is least human-like."""
    found: list[CaseResult] = []
    for one in findings(evaluation):
        if one.score.ads == ads:
            cases = one.cases
            likeness = np.where(cases.collided, np.nan, cases.human_likeness)
            if np.isfinite(likeness).any():
                found.append(
                    min(cases[likeness == np.nanmin(likeness)], key=lambda case: case.case)
                )
    return min(found, key=lambda case: (case.human_likeness or 0.0, case.case), default=None)


def _at(case: CaseResult) -> str:
    """A point in few digits."""
    return ", ".join(f"{name} {value:z.4g}" for name, value in case.values.items())


def _row(
    evaluation: Evaluation, one: RankedAds, scenarios: Sequence[str], digits: int
) -> dict[str, Any]:
    scores = [score for score in evaluation.scores if score.ads == one.ads]
    own = {score.scenario: score.s_plus for score in scores}
    return {
        "ads": one.ads,
        "place": "–" if one.place is None else str(one.place),
        "s_plus": number(one.s_plus, digits),
        "interval": span(one.interval, 0),
        "whisker": _whisker(one.s_plus, one.interval),
        "collisions": sum(score.collisions for score in scores),
        "avoidable": sum(score.avoidable_collisions for score in scores),
        "departures": sum(score.departures for score in scores),
        "cases": sum(score.cases for score in scores),
        "missing": sum(score.not_evaluated for score in scores),
        "scenarios": [number(own.get(name), 0) for name in scenarios] if len(scenarios) > 1 else [],
    }


def _whisker(value: float | None, interval: tuple[float, float] | None) -> dict[str, str] | None:
    """Places of a score and its interval on a rail of 100 units."""
    if value is None:
        return None
    low, high = (value, value) if interval is None else interval
    return {
        "low": f"{max(0.0, low):z.1f}",
        "width": f"{max(0.6, min(100.0, high) - max(0.0, low)):z.1f}",
        "at": f"{min(max(value, 0.0), 100.0):z.1f}",
    }
