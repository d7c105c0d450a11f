"""Boundary of an ADS's collisions: run it where the search asks, until the boundary is settled."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.extras.studies.straddle import BoundarySearch
from sumo_eval.record.cases import Case, Outcome, Setup
from sumo_eval.record.engines import identify, run_cases
from sumo_eval.scenario.logical import Constraint, LogicalScenario
from sumo_eval.trajectory import FloatArray

FIRST = 16  # trials of the first round, for each parameter
ROUND = 16  # trials of the others


class Round(NamedTuple):
    """State of the search after a round of trials."""

    simulations: int
    collisions: int
    expected_change: float
    doubt: float


class FailureBoundary(NamedTuple):
    """Result of the search.

    search: the trials that count, and their consequences.
    not_evaluated: how many could not be evaluated, by status.
    stopped: why the search ended.
    """

    logical: LogicalScenario
    ads: str
    search: BoundarySearch
    rounds: tuple[Round, ...]
    not_evaluated: dict[str, int]
    stopped: str


Watch = Callable[[int, int], None]


def find_boundary(
    logical: LogicalScenario,
    controller: str,
    setup: Setup,
    *,
    budget: int = 500,
    tolerance: float = 0.001,
    seed: int = 1,
    watch: Watch = lambda done, total: None,
) -> FailureBoundary:
    """Search the space (or a slice of it) for where an ADS collides, with at most `budget`
    simulations.

    It stops sooner when a round is expected to move less than `tolerance` of the space from one
    side to the other.

    watch: receives the number of simulations done and the budget.
    Raises InputError for an ADS that does not exist.
    """
    if not 0.0 <= tolerance < 1.0:
        raise must_be("`tolerance`", "the search", "a share of the space within 0..1", tolerance)
    identify([("ADS", controller)], setup)
    search = BoundarySearch(logical, seed)
    rounds: list[Round] = []
    lost: Counter[str] = Counter()
    done, stopped = 0, "budget"
    while done < budget:
        points = search.ask(min(ROUND if rounds else FIRST * len(logical.names), budget - done))
        if not len(points):
            stopped = "no point left"
            break
        outcomes = outcomes_at(
            points, logical, controller, setup, first=done, ended=lambda ended: watch(ended, budget)
        )
        done += len(points)
        lost.update(outcome.status for outcome in outcomes if outcome.status not in EVALUATED)
        counts = np.array([outcome.status in EVALUATED for outcome in outcomes])
        hits = np.array([outcome.status == "collision" for outcome in outcomes])
        search.skip(points[~counts])
        search.tell(points[counts], hits[counts])
        rounds.append(Round(done, int(search.outcomes.sum()), search.expected_change, search.doubt))
        if rounds[-1].expected_change < tolerance:
            stopped = "settled"
            break
    statuses = dict(sorted(lost.items()))
    if not len(search.points):
        why = ", ".join(f"{number} {status}" for status, number in statuses.items())
        raise InputError(f"None of {done} cases of ADS `{controller}` could be evaluated ({why}).")
    return FailureBoundary(logical, controller, search, tuple(rounds), statuses, stopped)


def outcomes_at(
    points: FloatArray,
    logical: LogicalScenario,
    controller: str,
    setup: Setup,
    *,
    first: int,
    ended: Callable[[int], None],
) -> list[Outcome]:
    """The outcomes at points (n, k), in their order.

    first: number of the first.
    ended: receives how many have ended.
    """
    cases = [
        Case(first + number, concrete, "ads", "ads", controller)
        for number, concrete in enumerate(logical.concretes(points))
    ]
    outcomes: list[Outcome] = []
    for outcome in run_cases(cases, setup):
        outcomes.append(outcome)
        ended(first + len(outcomes))
    return sorted(outcomes, key=lambda outcome: outcome.case.point)


@dataclass(frozen=True)
class _Filled:
    """A function of all parameters as one of those that are left; arrays stay arrays of one
    shape.
    """

    function: Callable[[Mapping[str, Any]], Any]
    fixed: Mapping[str, float]

    def __call__(self, values: Mapping[str, Any]) -> Any:
        shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
        held = {
            name: np.full(shape, value) if shape else value for name, value in self.fixed.items()
        }
        return self.function({**values, **held})


def slice_of(logical: LogicalScenario, fixed: Mapping[str, float]) -> LogicalScenario:
    """The scenario over the parameters that are not in `fixed`.

    Raises InputError for unknown names and values.
    """
    check_known(f"parameter of scenario `{logical.name}`", logical.names, *fixed)
    items = {item.name: item for item in logical.parameters}
    for name, value in fixed.items():
        items.pop(name).check(value, f"the slice of scenario `{logical.name}`")
    if not items:
        raise InputError(
            f"The slice of scenario `{logical.name}` must leave at least one parameter free."
        )
    if not fixed:
        return logical
    functions: dict[str, Any] = {
        name: _Filled(function, fixed)
        for name in ("place", "approach", "margin", "exposure")
        if (function := getattr(logical, name)) is not None
    }
    if logical.search is not None:
        delay = _Filled(logical.search.delay, fixed)
        functions["search"] = replace(logical.search, delay=delay)
    constraints = [Constraint(it.about, _Filled(it.holds, fixed)) for it in logical.constraints]
    return replace(
        logical,
        parameters=tuple(items.values()),
        constraints=tuple(constraints),
        zone_coordinates=None,  # one of them may be constant on the slice
        samples=(),
        default_sample="grid",
        **functions,
    )
