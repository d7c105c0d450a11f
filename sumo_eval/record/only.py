"""Single cases of an evaluation, driven without the rest: `run.only` names them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

from sumo_eval.errors import InputError, check_known
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import EvaluationSettings


def narrowed(run: Resolved) -> Resolved:
    """An evaluation without the ADSs and logical scenarios of which `run.only` names no case.

    Raises InputError for a name that no ADS of the evaluation has a case of.
    """
    settings = run.settings
    if not settings.run.only:
        return run
    names = [ads.name for ads in settings.ads]
    places = [_place(case, list(run.scenarios), names) for case in settings.run.only]
    scenarios, drivers = {scenario for scenario, _ in places}, {ads for _, ads in places}

    kept = [(entry, logical) for entry, logical in run.entries if logical.name in scenarios]
    gone, method, report = run.scenarios.keys() - scenarios, settings.method, settings.report
    weights = {name: it for name, it in method.ranking.weights.items() if name not in gone}
    axes = {name: it for name, it in report.axes.items() if name not in gone}
    settings = replace(
        settings,
        method=replace(method, ranking=replace(method.ranking, weights=weights)),
        report=replace(report, axes=axes),
        scenario=tuple(entry for entry, _ in kept),
        ads=tuple(ads for ads in settings.ads if ads.name in drivers),
    )
    return replace(run, settings=settings, scenarios={logical.name: logical for _, logical in kept})


def _place(case: str, scenarios: Sequence[str], every: Sequence[str]) -> tuple[str, str]:
    """Logical scenario and ADS of a case."""
    # a name may hold a number, too: `ncap-2026-ccrs-0003-idm`
    numbers = re.findall(r"-(\d{4,})(?=-)", case) or ["0000"]
    known = {
        f"{scenario}-{number}-{ads}": (scenario, ads)
        for scenario, number, ads in product(scenarios, numbers, every)
    }
    check_known("case of the evaluation", known, case)
    return known[case]


def points_only(
    numbers: Sequence[int], settings: EvaluationSettings, scenario: str, points: int
) -> Sequence[int]:
    """Numbers of the points of a logical scenario that `run.only` names; all where it names no
    case.

    numbers: those to choose from.
    points: how many the scenario has.
    Raises InputError for a number beyond them.
    """
    if not settings.run.only:
        return numbers
    drivers = "|".join(re.escape(ads.name) for ads in settings.ads)
    named = re.compile(rf"{re.escape(scenario)}-(\d{{4,}})-(?:{drivers})")
    wanted = {int(match[1]) for match in map(named.fullmatch, settings.run.only) if match}
    if wanted and max(wanted) >= points:
        raise InputError(
            f"A case of {scenario} must be numbered 0000 to {points - 1:04d}, got "
            f"{max(wanted):04d}: the evaluation has {points} points there."
        )
    return [number for number in numbers if number in wanted]
