"""Cases of a run that are nearest to values of parameters, for the command line.

Users: `cli/look.py`.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.errors import InputError, check_known
from sumo_eval.results import Evaluation


def nearest(
    evaluation: Evaluation,
    values: Mapping[str, float],
    ads: str | None,
    scenario: str | None,
    most: int,
) -> Iterator[tuple[CaseTable, CaseTable]]:
    """All cases of each ADS in a scenario, and those nearest to the values, nearest first.

    values: of some parameters, by name. The distance is over these, in the unit box.
    ads: only this ADS; None: every ADS.
    scenario: its name; None: the first scenario that has all of these parameters.
    most: number of nearest cases, at most.

    Raises InputError for a name that the run does not have, and for a value that is not finite.
    """
    scenarios = evaluation.scenarios
    fitting = [name for name, logical in scenarios.items() if values.keys() <= set(logical.names)]
    # If none fits, the first scenario: the check of the parameters below names the mistake then.
    name = scenario or next(iter((*fitting, *scenarios)))
    check_known("scenario of this run", scenarios, name)
    names = [score.ads for score in evaluation.scores_in(name)]
    chosen = names if ads is None else [ads]
    check_known(f"ADS of scenario `{name}`", names, *chosen)
    logical = scenarios[name]
    check_known(f"parameter of scenario `{name}`", logical.names, *values)
    for parameter, value in values.items():
        if not np.isfinite(value):
            raise InputError(f"`{parameter}` must be a finite number, got {value}.")
    spans = (logical.high - logical.low)[[logical.column(parameter) for parameter in values]]
    for ads_name in chosen:
        cases = evaluation.cases_of(ads_name, name)
        away = (cases.parameters(list(values)) - list(values.values())) / spans
        with np.errstate(over="ignore"):  # values beyond 1e154: all distances are inf
            distance = (away**2).sum(axis=1)
        yield cases, cases[np.argsort(distance, kind="stable")[:most]]
