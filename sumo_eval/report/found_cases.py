"""Lines on the cases of a run that are nearest to parameter values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from sumo_eval.cases import CaseTable
from sumo_eval.report.words import count, one_line
from sumo_eval.text import point_words


def nearest_cases(groups: Iterable[tuple[CaseTable, CaseTable]]) -> Iterator[str]:
    """Lines on the nearest cases of each ADS, as `nearest` gives them."""
    for cases, near in groups:
        first = cases[0]
        yield f"{one_line(first.ads)} in {first.scenario}, {count(len(cases), 'case')}:"
        for case in near:
            at = f"{one_line(case.case)}: {point_words(case.values)}"
            yield f"  {at}; {case.outcome}, {case.zone} zone"
