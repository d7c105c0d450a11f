"""The table of passed and failed rows: what a scenario requires of every drive, case by case."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from heapq import nsmallest
from typing import Any

from sumo_eval.report.verdict import Beside
from sumo_eval.report.words import count
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.text import point_words

PASSED, FAILED, NOT_EVALUATED = "passed", "failed", "not evaluated"
MOST_LINES = 40  # of a terminal; checks.csv has all
MOST_ROWS = 500  # of the page; checks.csv has all


@dataclass(frozen=True, slots=True)
class CheckedCase:
    """A case of a scenario with requirements.

    values: the point's, of which `point` has six digits.
    missed: names of those that its drive misses; None: not evaluated.
    """

    case: str
    scenario: str
    ads: str
    point: str
    values: tuple[float, ...]
    missed: tuple[str, ...] | None

    @property
    def verdict(self) -> str:
        """Whether all checks passed."""
        return NOT_EVALUATED if self.missed is None else FAILED if self.missed else PASSED

    def verdict_of(self, check: str) -> str:
        """Whether one of them passed."""
        return NOT_EVALUATED if self.missed is None else FAILED if check in self.missed else PASSED


def checked_cases(
    evaluation: Evaluation, scores: Iterable[ScenarioResult] | None = None
) -> Iterator[CheckedCase]:
    """All cases of scenarios that have requirements, in the order of the evaluation.

    scores: only the cases of these; default: of all.
    """
    for score in evaluation.scores if scores is None else scores:
        if score.scenario not in evaluation.checks:
            continue
        for case in evaluation.cases_of(score.ads, score.scenario):
            missed = (
                None
                if case.requirements_missed is None
                else tuple(filter(None, case.requirements_missed.split("; ")))
            )
            point = point_words(case.values), tuple(case.values.values())
            yield CheckedCase(case.case, case.scenario, case.ads, *point, missed)


def check_lines(evaluation: Evaluation) -> Iterator[str]:
    """A line for each case with its verdict, failed ones first where they are too many; and a
    sentence before them.
    """
    verdicts = Counter(one.verdict for one in checked_cases(evaluation))
    number = verdicts.total()
    if not number:
        return
    yield f"{verdicts[PASSED]} of {count(number, 'case')} pass all checks of their scenarios:"
    shown: Iterable[CheckedCase] = checked_cases(evaluation)
    if number > MOST_LINES:
        order = (FAILED, NOT_EVALUATED, PASSED)
        shown = nsmallest(MOST_LINES, shown, key=lambda one: order.index(one.verdict))
    for one in shown:
        why = f": {'; '.join(one.missed)}" if one.missed else ""
        yield f"  {one.verdict}  {one.ads} in {one.scenario}, {one.point}{why}"
    if number > MOST_LINES:
        yield f"  and {number - MOST_LINES} more, all in checks.csv."


def checks_content(evaluation: Evaluation, _: Beside) -> Mapping[str, Any] | None:
    """For each scenario with requirements: their texts, how often each ADS misses them, and each
    row's verdict.
    """
    scored = {score.scenario for score in evaluation.scores}
    tables = [_table(evaluation, scenario) for scenario in evaluation.checks if scenario in scored]
    return {"tables": tables} if tables else None


def _table(evaluation: Evaluation, scenario: str) -> dict[str, Any]:
    """The table of one scenario."""
    checks = evaluation.checks[scenario]
    scores = evaluation.scores_in(scenario)
    names = [score.ads for score in scores]
    failed, passed = Counter[tuple[str, str]](), Counter[str]()
    points: set[int] = set()
    rows: dict[tuple[float, ...], dict[str, CheckedCase]] = {}
    for one in checked_cases(evaluation, scores):
        failed.update((one.ads, name) for name in checks if one.verdict_of(name) == FAILED)
        passed[one.ads] += one.verdict == PASSED
        points.add(hash(one.values))  # of a million points the texts would be 100 MB
        if len(rows) < MOST_ROWS or one.values in rows:
            rows.setdefault(one.values, {})[one.ads] = one
    return {
        "scenario": scenario,
        "ads": names,
        "checks": [
            (name, text, [failed[ads, name] for ads in names]) for name, text in checks.items()
        ],
        "passed": [passed[ads] for ads in names],
        "of": len(points),
        "rows": [
            (next(iter(found.values())).point, [found.get(ads) for ads in names])
            for found in rows.values()
        ],
        "more": max(0, len(points) - MOST_ROWS),
    }
