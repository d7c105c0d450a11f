"""Cases of a run by their parameters: those nearest to given values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from sumo_eval.errors import InputError, unknown
from sumo_eval.report.words import count, one_line, point
from sumo_eval.results import Evaluation


def nearest_cases(
    evaluation: Evaluation,
    values: Mapping[str, float],
    ads: str | None,
    scenario: str | None,
    most: int,
) -> Iterator[str]:
    """Lines on the `most` cases of each ADS that are nearest to parameter values, nearest first.

    Distance: in the unit box, over the parameters that are given.

    ads, scenario: only those; None: every ADS, and the first scenario that has all of these
        parameters.
    Raises InputError for one that the run does not have.
    """
    scenarios = evaluation.scenarios
    if scenario is not None and scenario not in scenarios:
        raise unknown("scenario of this run", scenario, scenarios)
    everybody = list(dict.fromkeys(score.ads for score in evaluation.scores))
    if ads is not None and ads not in everybody:
        raise unknown("ADS of this run", ads, everybody)
    having = [name for name, logical in scenarios.items() if values.keys() <= set(logical.names)]
    name = scenario or (having[0] if having else next(iter(scenarios)))
    logical = scenarios[name]
    for parameter in values:
        if parameter not in logical.names:
            raise unknown(f"parameter of scenario `{name}`", parameter, logical.names)
        if not np.isfinite(values[parameter]):
            raise InputError(f"`{parameter}` must be a finite number, got {values[parameter]}.")
    for one in everybody if ads is None else [ads]:
        cases = evaluation.cases_of(one, name)
        distance = np.zeros(len(cases))
        for parameter, column in zip(values, cases.parameters(list(values)).T, strict=True):
            item = logical.parameters[logical.column(parameter)]
            distance += ((column - values[parameter]) / (item.high - item.low)) ** 2
        order = np.argsort(distance, kind="stable")[:most].tolist()
        yield f"{one_line(one)} in {name}, {count(len(cases), 'case')}:"
        for place in order:
            case = cases[place]
            yield f"  {one_line(case.case)}: {point(case.values)}; {case.outcome}, {case.zone} zone"
