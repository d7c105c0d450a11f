"""Boundary of an ADS's collisions, for `sumo-eval boundary`.

The points that `straddle` asks for are driven until the boundary hardly changes.

Users: `extras/studies/boundary_command.py`, `extras/studies/boundary_page.py`.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError, check_known
from sumo_eval.extras.studies.straddle import BoundarySearch
from sumo_eval.extras.studies.trials import Trials
from sumo_eval.scenario.logical import LogicalScenario

# Trials of the first round for each parameter, and of each later round. A search that was stopped
# asks again for the same rounds: with other numbers it could not resume.
FIRST, ROUND = 16, 16


class Round(NamedTuple):
    """State of the search after a round of trials. The names are keys of `boundary.json`.

    simulations, collisions: numbers so far.
    expected_change: share of the space that the next round is expected to put in another class.
    doubt: mean probability that a point is in the wrong class. 1 stands for unknown in both.
    """

    simulations: int
    collisions: int
    expected_change: float
    doubt: float


class FailureBoundary(NamedTuple):
    """Result of the search.

    ads: locator of the ADS.
    search: the evaluated trials, and the boundary learnt from them.
    rounds: state after each round.
    not_evaluated: number of trials that could not be evaluated, by status.
    stopped: why the search ended: `settled`, `budget` or `no point left`, as in `boundary.json`.
    """

    logical: LogicalScenario
    ads: str
    search: BoundarySearch
    rounds: tuple[Round, ...]
    not_evaluated: dict[str, int]
    stopped: str


def find_boundary(
    logical: LogicalScenario,
    controller: str,
    trials: Trials,
    *,
    budget: int,
    tolerance: float = 0.001,
    seed: int = 1,
    watch: Callable[[int, int], None] = lambda done, total: None,
) -> FailureBoundary:
    """Search a space, or a slice of it (`slice_of`), for the boundary of an ADS's collisions.

    controller: locator of the ADS.
    budget: most simulations.
    tolerance: share of the space, 0..1. The search ends once the next round is expected to move a
        smaller share to the other side of the boundary.
    watch: receives the number of simulations done and the budget.

    Raises InputError for a space that `BoundarySearch` refuses, and for an ADS that no trial of the
    first round could evaluate.
    """
    search = BoundarySearch(logical, seed)
    rounds: list[Round] = []
    not_evaluated: Counter[str] = Counter()
    done, stopped = 0, "budget"
    while done < budget:
        points = search.ask(min(ROUND if rounds else FIRST * len(logical.names), budget - done))
        if not len(points):
            stopped = "no point left"
            break
        statuses = np.array(
            [
                trial.status
                for trial in trials.at(
                    points, logical, ("ads", controller), first=done,  # number of the first point
                    ended=lambda ended: watch(ended, budget)
                )
            ]
        )  # fmt: skip
        done += len(points)
        evaluated = np.isin(statuses, EVALUATED)
        not_evaluated.update(statuses[~evaluated].tolist())
        search.tell(points[evaluated], statuses[evaluated] == "collision")
        if not len(search.points):  # refused below: more of the budget would show no more
            break
        rounds.append(Round(done, int(search.outcomes.sum()), search.expected_change, search.doubt))
        if rounds[-1].expected_change < tolerance:
            stopped = "settled"
            break
    numbers = dict(sorted(not_evaluated.items()))
    if not len(search.points):
        why = ", ".join(f"{number} {status}" for status, number in numbers.items())
        raise InputError(f"None of {done} cases of ADS `{controller}` could be evaluated ({why}).")
    return FailureBoundary(logical, controller, search, tuple(rounds), numbers, stopped)


def slice_of(logical: LogicalScenario, fixed: Mapping[str, float]) -> LogicalScenario:
    """The scenario over its free parameters, those that are not in `fixed`.

    fixed: values by name.
    Raises InputError for unknown names and values.
    """
    check_known(f"parameter of scenario `{logical.name}`", logical.names, *fixed)
    free = {item.name: item for item in logical.parameters}
    for name, value in fixed.items():
        free.pop(name).check(value, f"the slice of scenario `{logical.name}`")
    if not free:
        raise InputError(
            f"The slice of scenario `{logical.name}` must leave at least one parameter free."
        )
    if not fixed:
        return logical
    return replace(
        logical,
        parameters=tuple(free.values()),
        fixed=(*logical.fixed, *fixed.items()),
        zone_coordinates=None,  # one of them may be constant on the slice
        samples=(),  # prescribed points have values of all parameters
        default_sample="grid",  # the default may be one of these samples
    )
