"""The report's first screen: the first words of a run, the case to look at first, and the ADSs in
their order.

Users: `nightly/night.py` (the levers of `first_case`), `report/sections.py`.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.report.gate_result import failed
from sumo_eval.report.headline import headline
from sumo_eval.report.page import Json, case_key
from sumo_eval.report.verdict import Additions, verdict
from sumo_eval.report.words import cause_words, count, number, span
from sumo_eval.results import Evaluation, RankedAds
from sumo_eval.score_notes import Bounds
from sumo_eval.scoring.behaviour import Behaviour, least_human, ranked, worst_case
from sumo_eval.scoring.comparison import builds_besides
from sumo_eval.scoring.findings import unevaluated

MOST_CHANGES = 4  # failed gates whose worst case is named
WIDE = 20.0  # points of S+: an interval wider than this tells little


def summary_content(evaluation: Evaluation, additions: Additions) -> Json:
    """Content of templates/sections/summary.html.j2."""
    first_words, comparison = headline(evaluation), additions.comparison
    order = [ads for ads, _ in first_words.order]
    scenarios = evaluation.scenario_names
    ends = [ads.interval or (0.0, np.inf) for ads in order]  # no interval counts as wide
    digits = 0 if any(high - low > WIDE for low, high in ends) else 1
    failures = failed(additions.gates)
    worst = worst_case(evaluation, [ads.ads for ads in order])
    changes = [
        (
            f"{gate.quantity} of {gate.ads}: {change.point}: {change.words}",
            f"#case:{case_key(change.case)}",
        )
        for gate in failures
        for change in gate.worst[:1]
    ][:MOST_CHANGES]
    notes = []
    if comparison:
        # the builds that no difference lists
        notes = builds_besides(evaluation.manifest.get("builds", {}), comparison)
        notes += [difference.words for difference in comparison.differences]
    return {
        "verdict": verdict(comparison, additions.gates, evaluation).sentence
        if comparison or additions.gates
        else "",
        # each with the night since which it fails
        "failures": [(additions.since.get(gate.name, ""), gate) for gate in failures],
        "beside": notes,
        "answers": first_words.answers,
        "alarms": first_words.alarms,
        "worst": first_case(evaluation, additions),
        "looks": [*changes, *_looks(evaluation, worst, order[0].ads)],
        "rows": [_row(evaluation, *pair, scenarios, digits) for pair in first_words.order],
        "scenarios": scenarios,
    }


def first_case(evaluation: Evaluation, additions: Additions) -> str:
    """Key of the case to look at first: the worst of the first failed gate that names any, else
    of the run.
    """
    failing = (change.case for gate in failed(additions.gates) for change in gate.worst[:1])
    worst = worst_case(evaluation, [ads.ads for ads in ranked(evaluation)])
    return next(failing, worst.case if worst else "")


def _looks(
    evaluation: Evaluation, worst: CaseResult | None, best: str
) -> Iterator[tuple[str, str]]:
    """Links to look at next: their words, and addresses on the page."""
    if worst is not None and (words := cause_words(worst)):
        collision = f"the collision that lowers A of {worst.ads} most: {words}"
        yield collision, f"#case:{case_key(worst.case)}"
    if missing := sum(map(len, unevaluated(evaluation))):
        yield f"{count(missing, 'case')} that could not be evaluated", "#missing"
    least = least_human(evaluation, best)
    if least is not None:
        at = ", ".join(f"{name} {value:z.4g}" for name, value in least.values.items())
        yield f"the least human-like case of {best}: {at}", f"#case:{case_key(least.case)}"
    if (evaluation.cases.incident | ~evaluation.cases.evaluated).any():
        yield "failures that are alike, in the maps", "#maps"


def _row(
    evaluation: Evaluation,
    ads: RankedAds,
    behaviour: Behaviour,
    scenarios: Sequence[str],
    digits: int,
) -> Json:
    """A row of the table of ADSs. digits: decimals of S+."""
    points = {it.scenario: it.s_plus for it in evaluation.scores if it.ads == ads.ads}
    return {
        "of": behaviour,
        "place": "–" if ads.place is None else str(ads.place),
        "s_plus": number(ads.s_plus, digits),
        "interval": span(ads.interval, 0),
        "whisker": _whisker(ads.s_plus, ads.interval),
        # a column for each scenario, only where there are several
        "scenarios": [number(points.get(name), 0) for name in scenarios if len(scenarios) > 1],
    }


def _whisker(value: float | None, interval: Bounds | None) -> dict[str, str] | None:
    """Places of a score and its interval on a rail of 100 units."""
    if value is None:
        return None
    low, high, at = np.clip([*(interval or (value, value)), value], 0.0, 100.0).tolist()
    return {"low": f"{low:z.1f}", "width": f"{max(0.6, high - low):z.1f}", "at": f"{at:z.1f}"}
