"""Single cases of an evaluation, driven without the rest: `run.only` names them."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from sumo_eval.errors import InputError, unknown
from sumo_eval.scenario import catalogue
from sumo_eval.settings import EvaluationSettings


def narrowed(settings: EvaluationSettings, source: Path) -> EvaluationSettings:
    """An evaluation without the ADSs and logical scenarios of which `run.only` names no case.

    Raises InputError for a name that no ADS of the evaluation has a case of.
    """
    if not settings.run.only:
        return settings
    names = [catalogue.find(entry.use, source).name for entry in settings.scenario]
    every = [ads.name for ads in settings.ads]
    places = [_place(case, names, every) for case in settings.run.only]
    scenarios, drivers = {scenario for scenario, _ in places}, {ads for _, ads in places}

    entries = zip(settings.scenario, names, strict=True)
    return replace(
        settings,
        scenario=tuple(entry for entry, name in entries if name in scenarios),
        ads=tuple(ads for ads in settings.ads if ads.name in drivers),
    )


def _place(case: str, scenarios: Sequence[str], every: Sequence[str]) -> tuple[str, str]:
    """Logical scenario and ADS of a case."""
    number = next(iter(re.findall(r"-(\d{4,})-", case)), "0000")
    known = {
        f"{scenario}-{number}-{ads}": (scenario, ads) for scenario in scenarios for ads in every
    }
    if case not in known:
        raise unknown("case of the evaluation", case, known)
    return known[case]


def points_only(
    numbers: Sequence[int], cases: Collection[str], scenario: str, points: int
) -> Sequence[int]:
    """Numbers of the points of a logical scenario that `run.only` names; all where it names none.

    points: how many the scenario has.
    Raises InputError for a number beyond them.
    """
    if not cases:
        return numbers
    named = {
        re.sub(rf"^{re.escape(scenario)}-(\d{{4,}})-.*", r"\1", case, flags=re.DOTALL)
        for case in cases
    }
    wanted = {int(number) for number in named if number.isdecimal()}
    if wanted and max(wanted) >= points:
        raise InputError(
            f"A case of {scenario} must be numbered 0000 to {points - 1:04d}, got "
            f"{max(wanted):04d}: "
            f"the evaluation has {points} points there."
        )
    return [number for number in numbers if number in wanted]
