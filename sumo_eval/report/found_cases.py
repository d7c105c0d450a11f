"""Lines on the cases of a run that are nearest to parameter values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sumo_eval.report.words import count, one_line
from sumo_eval.results import Evaluation
from sumo_eval.scoring.nearest import nearest
from sumo_eval.text import point_words


def nearest_cases(
    evaluation: Evaluation,
    values: Mapping[str, float],
    ads: str | None,
    scenario: str | None,
    most: int,
) -> Iterator[str]:
    """Lines on the nearest cases of each ADS; arguments as in `nearest`."""
    for cases, near in nearest(evaluation, values, ads, scenario, most):
        first = cases[0]
        yield f"{one_line(first.ads)} in {first.scenario}, {count(len(cases), 'case')}:"
        for case in near:
            at = f"{one_line(case.case)}: {point_words(case.values)}"
            yield f"  {at}; {case.outcome}, {case.zone} zone"
