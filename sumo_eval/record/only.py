"""Single cases of an evaluation, driven without the rest: `run.only` names them.

Users: `cli/tools.py`, `record/facts.py`, `report/export_case.py`.
"""

import re
from collections.abc import Iterable, Sequence, Set
from dataclasses import replace
from itertools import product

from sumo_eval.errors import InputError, check_known
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import EvaluationSettings

Parts = tuple[str, int, str]
"""Logical scenario, number of the point and ADS of a case."""


def narrowed(run: Resolved) -> Resolved:
    """An evaluation without the ADSs and logical scenarios of which `run.only` names no case.

    Raises InputError for a name that is not a case of the evaluation.
    """
    settings = run.settings
    if not settings.run.only:
        return run
    named = []
    for case in settings.run.only:
        parts_of = _parts_by_key(case, run.scenarios, settings)
        check_known("case of the evaluation", parts_of, case)
        named.append(parts_of[case])
    kept = {scenario for scenario, *_ in named}
    chosen_ads = {ads for *_, ads in named}
    entries = [(entry, logical) for entry, logical in run.entries if logical.name in kept]
    settings = replace(
        without_left_out(run, kept),
        scenario=tuple(entry for entry, _ in entries),
        ads=tuple(ads for ads in settings.ads if ads.name in chosen_ads),
    )
    return replace(
        run, settings=settings, scenarios={logical.name: logical for _, logical in entries}
    )


def without_left_out(run: Resolved, kept: Set[str]) -> EvaluationSettings:
    """An evaluation's settings without those of scenarios that are left out, and of their
    parameters: where a scenario is missing, they would be refused as unknown names.

    kept: names of the scenarios that are not left out.
    """
    settings = run.settings
    method, report, drivers = settings.method, settings.report, settings.drivers
    left_out = run.scenarios.keys() - kept
    parameters = {name for scenario in kept for name in run.scenarios[scenario].names}
    # a name that the evaluation does not know stays: it is refused later
    weights = {name: w for name, w in method.ranking.weights.items() if name not in left_out}
    if not any(weights.get(name, 1.0) for name in kept):  # weights of 0 alone would be refused
        weights = {name: w for name, w in weights.items() if name not in kept}
    axes = {name: pair for name, pair in report.axes.items() if name not in left_out}
    # `Resolved.of` has refused unknown parameters
    tolerance = {name: far for name, far in (drivers.tolerance or {}).items() if name in parameters}
    return replace(
        settings,
        method=replace(method, ranking=replace(method.ranking, weights=weights)),
        report=replace(report, axes=axes),
        drivers=replace(drivers, tolerance=tolerance or None),
    )


def _parts_by_key(
    case: str, scenarios: Iterable[str], settings: EvaluationSettings
) -> dict[str, Parts]:
    """Parts of the cases that a text may name, by key."""
    # Any number in the text may be that of the point, because names may hold numbers too:
    # `ncap-2026-ccrs-0003-idm`. A text without a number gets point 0: the error message then offers
    # the nearest key.
    numbers = map(int, re.findall(r"-(\d{4,9})(?=-)", case) or ["0"])
    return {
        f"{scenario}-{number:04d}-{ads.name}": (scenario, number, ads.name)
        for scenario, number, ads in product(scenarios, numbers, settings.ads)
    }


def points_only(
    numbers: Sequence[int], settings: EvaluationSettings, scenario: str, points: int
) -> Sequence[int]:
    """Numbers of the points of a logical scenario that `run.only` names; all where it names no
    case.

    numbers: numbers to choose from.
    points: number of points of the scenario.

    Raises InputError for a number that no point has.
    """
    if not settings.run.only:
        return numbers
    named = [_parts_by_key(case, [scenario], settings).get(case) for case in settings.run.only]
    wanted = {parts[1] for parts in named if parts}
    if wanted and max(wanted) >= points:
        raise InputError(
            f"A case of {scenario} must be numbered 0000 to {points - 1:04d}, got "
            f"{max(wanted):04d}: the evaluation has {points} points there."
        )
    return [number for number in numbers if number in wanted]
