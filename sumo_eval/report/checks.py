"""The table of passed and failed rows: what a scenario requires of every drive, case by case."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from sumo_eval.report.words import count, point
from sumo_eval.results import Evaluation

PASSED, FAILED, NOT_EVALUATED = "passed", "failed", "not evaluated"
MOST_LINES = 40  # of a terminal; checks.csv has all
MOST_ROWS = 500  # of the page; checks.csv has all


@dataclass(frozen=True, slots=True)
class CheckedCase:
    """A case of a scenario with requirements. missed: names of those that its drive misses; None: not evaluated."""

    case: str
    scenario: str
    ads: str
    point: str
    missed: tuple[str, ...] | None

    @property
    def verdict(self) -> str:
        """Whether all checks passed."""
        return NOT_EVALUATED if self.missed is None else FAILED if self.missed else PASSED

    def verdict_of(self, check: str) -> str:
        """Whether one of them passed."""
        return NOT_EVALUATED if self.missed is None else FAILED if check in self.missed else PASSED


def checked_cases(evaluation: Evaluation) -> list[CheckedCase]:
    """All cases of scenarios that have requirements, in the order of the evaluation."""
    return [
        CheckedCase(
            case.case, case.scenario, case.ads, point(case.values),
            None if case.requirements_missed is None
            else tuple(name for name in case.requirements_missed.split("; ") if name),
        )
        for case in evaluation.cases
        if case.scenario in evaluation.checks
    ]  # fmt: skip


def check_lines(evaluation: Evaluation) -> Iterator[str]:
    """A line for each case with its verdict, failed ones first where they are too many; and a sentence before them."""
    cases = checked_cases(evaluation)
    if not cases:
        return
    passed = sum(one.verdict == PASSED for one in cases)
    yield f"{passed} of {count(len(cases), 'case')} pass all checks of their scenarios:"
    shown = cases
    if len(cases) > MOST_LINES:
        shown = sorted(cases, key=lambda one: (FAILED, NOT_EVALUATED, PASSED).index(one.verdict))[:MOST_LINES]
    for one in shown:
        why = f": {'; '.join(one.missed)}" if one.missed else ""
        yield f"  {one.verdict}  {one.ads} in {one.scenario}, {one.point}{why}"
    if len(cases) > MOST_LINES:
        yield f"  and {len(cases) - MOST_LINES} more, all in checks.csv."


def checks_content(evaluation: Evaluation) -> Mapping[str, Any] | None:
    """For each scenario with requirements: what they are, how often each ADS misses them, and each row's verdict."""
    cases = checked_cases(evaluation)
    if not cases:
        return None
    tables = []
    for scenario, checks in evaluation.checks.items():
        here = [one for one in cases if one.scenario == scenario]
        names = list(dict.fromkeys(one.ads for one in here))
        rows: dict[str, dict[str, CheckedCase]] = {}
        for one in here:
            rows.setdefault(one.point, {})[one.ads] = one
        tables.append(
            {
                "scenario": scenario,
                "ads": names,
                "checks": [
                    (
                        name,
                        text,
                        [sum(one.verdict_of(name) == FAILED for one in here if one.ads == ads) for ads in names],
                    )
                    for name, text in checks.items()
                ],
                "passed": [sum(one.verdict == PASSED for one in here if one.ads == ads) for ads in names],
                "of": len(rows),
                "rows": [
                    (
                        place,
                        [(found.get(ads), quote(found[ads].case, safe="") if ads in found else "") for ads in names],
                    )
                    for place, found in list(rows.items())[:MOST_ROWS]
                ],
                "more": max(0, len(rows) - MOST_ROWS),
            }
        )
    return {"tables": tables}
