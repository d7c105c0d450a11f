"""The table of passed and failed rows: what a scenario requires of every drive, case by case.

Users: `report/evidence.py`, `report/sections.py`, `report/tables.py`, `report/terminal.py`.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from heapq import nsmallest
from typing import NamedTuple

from sumo_eval.cases import CaseResult
from sumo_eval.report.page import Json
from sumo_eval.report.verdict import Additions
from sumo_eval.report.words import count
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.requirements import missed_in
from sumo_eval.text import point_words

PASSED, FAILED, NOT_EVALUATED = "passed", "failed", "not evaluated"
MOST_LINES = 40  # of a terminal; checks.csv has all
MOST_ROWS = 500  # of the page; checks.csv has all


class CheckedCase(NamedTuple):
    """A case of a scenario with requirements, and the names of the requirements that its drive
    misses; None: not evaluated.
    """

    case: CaseResult
    missed: Sequence[str] | None

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
        if score.scenario in evaluation.checks:
            for case in evaluation.cases_behind(score):
                text = case.requirements_missed
                yield CheckedCase(
                    case, None if text is None else [name for name, _ in missed_in(text)]
                )


def check_lines(evaluation: Evaluation) -> Iterator[str]:
    """A line for each case with its verdict, failed ones first where they are too many; and a
    sentence before them.
    """
    verdicts = Counter(checked.verdict for checked in checked_cases(evaluation))
    number = verdicts.total()
    if not number:
        return
    yield f"{verdicts[PASSED]} of {count(number, 'case')} pass all checks of their scenarios:"
    shown: Iterable[CheckedCase] = checked_cases(evaluation)
    if number > MOST_LINES:
        order = FAILED, NOT_EVALUATED, PASSED
        shown = nsmallest(MOST_LINES, shown, key=lambda checked: order.index(checked.verdict))
    for checked in shown:
        case = checked.case
        why = f": {case.requirements_missed}" if checked.missed else ""
        yield f"  {checked.verdict}  {case.ads} in {case.scenario}, {point_words(case.values)}{why}"
    if number > MOST_LINES:
        yield f"  and {number - MOST_LINES} more, all in checks.csv."


def checks_content(evaluation: Evaluation, _: Additions) -> Json | None:
    """For each scenario with requirements: their texts, how often each ADS misses them, and each
    row's verdict.
    """
    scenarios = evaluation.scenario_names
    tables = [_table(evaluation, name) for name in evaluation.checks if name in scenarios]
    return {"tables": tables} if tables else None


def _table(evaluation: Evaluation, scenario: str) -> Json:
    """The table of one scenario."""
    checks = evaluation.checks[scenario]
    scores = evaluation.scores_in(scenario)
    names = [score.ads for score in scores]
    failed, passed = Counter[tuple[str, str]](), Counter[str]()
    points = set()
    rows: dict[tuple[float, ...], dict[str, CheckedCase]] = {}
    for checked in checked_cases(evaluation, scores):
        ads, point = checked.case.ads, tuple(checked.case.values.values())
        failed.update((ads, name) for name in checked.missed or ())
        passed[ads] += checked.verdict == PASSED
        # the hash of a text, because the hashes of -1.0 and -2.0 are equal; a million texts
        # themselves would take 100 MB
        points.add(hash(str(point)))
        if len(rows) < MOST_ROWS or point in rows:
            rows.setdefault(point, {})[ads] = checked
    return {
        "scenario": scenario,
        "ads": names,
        "checks": [
            (name, text, [failed[ads, name] for ads in names]) for name, text in checks.items()
        ],
        "passed": [passed[ads] for ads in names],
        "of": len(points),
        "rows": [
            (point_words(next(iter(row.values())).case.values), [row.get(ads) for ads in names])
            for row in rows.values()
        ],
        "more": max(0, len(points) - MOST_ROWS),
    }
