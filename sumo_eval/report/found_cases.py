"""Cases of a run by their parameters: those nearest to given values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from sumo_eval.errors import InputError, unknown
from sumo_eval.report.words import count, one_line
from sumo_eval.results import Evaluation
from sumo_eval.text import point_words


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
    everybody = evaluation.ads_names
    having = [name for name, logical in scenarios.items() if values.keys() <= set(logical.names)]
    name = scenario or next(iter((*having, *scenarios)))
    logical = scenarios.get(name)
    known = logical.names if logical else ()
    for kind, wanted, names in (
        ("scenario of this run", name, scenarios),
        ("ADS of this run", ads or everybody[0], everybody),
        *((f"parameter of scenario `{name}`", parameter, known) for parameter in values),
    ):
        if wanted not in names:
            raise unknown(kind, wanted, names)
    if bad := [item for item in values.items() if not np.isfinite(item[1])]:
        raise InputError(f"`{bad[0][0]}` must be a finite number, got {bad[0][1]}.")
    columns = [scenarios[name].column(parameter) for parameter in values]
    spans = (scenarios[name].high - scenarios[name].low)[columns]
    for one in everybody if ads is None else [ads]:
        cases = evaluation.cases_of(one, name)
        away = (cases.parameters(list(values)) - list(values.values())) / spans
        distance = (away**2).sum(axis=1)
        order = np.argsort(distance, kind="stable")[:most].tolist()
        yield f"{one_line(one)} in {name}, {count(len(cases), 'case')}:"
        for place in order:
            case = cases[place]
            at = f"{one_line(case.case)}: {point_words(case.values)}"
            yield f"  {at}; {case.outcome}, {case.zone} zone"
