"""Fill a run's store: ADSs in every concrete scenario, the ideal vehicle where one hit, drivers where it is safe."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from sumo_eval.batch.cases import Case, Outcome, Setup
from sumo_eval.batch.engines import run_cases
from sumo_eval.batch.store import Store
from sumo_eval.errors import InputError
from sumo_eval.locators import load_object
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling import Sample
from sumo_eval.settings import EvaluationSettings
from sumo_eval.trajectory import BoolArray, Recording, Trajectory

Progress = Callable[[str, int, int], None]
"""Told what is being done, how much of it is done, and how much there is."""


def quiet(stage: str, done: int, total: int) -> None:
    """Shows nothing."""


def record(
    logical: LogicalScenario,
    points: Sample,
    hazardous: BoolArray,
    settings: EvaluationSettings,
    source: Path,
    store: Store,
    progress: Progress,
) -> None:
    """Simulate one logical scenario at the chosen points. `source`: where relative paths of locators start."""
    numbered = list(enumerate(logical.concretes(points.points, points.exposure)))
    safe = [(number, concrete) for number, concrete in numbered if not hazardous[number]]
    setup = Setup(settings.simulation, settings.run, source)

    def keep(who: str, outcomes: Iterable[Outcome], total: int) -> None:
        for done, outcome in enumerate(outcomes, start=1):
            store.add(outcome)
            progress(f"{logical.name}: {who}", done, total)

    runs = [
        Case(number, concrete, "ads", ads.name, ads.controller) for number, concrete in numbered for ads in settings.ads
    ]
    keep("ADSs", run_cases(runs, setup), len(runs))
    struck = {fact.point for fact in store.facts("ads", logical.name) if fact.collision}
    runs = [
        Case(number, concrete, "ideal", "ideal", "ideal_braking") for number, concrete in numbered if number in struck
    ]
    keep("ideal vehicle", run_cases(runs, setup), len(runs))
    if settings.drivers.source == "synthetic":
        runs = _synthetic_drivers(safe, settings)
        keep("drivers", run_cases(runs, setup), len(runs))
    else:
        for number, concrete in safe:
            outcomes = list(_recorded_drivers(number, concrete, settings.drivers.source, source))
            keep("drivers", outcomes, len(outcomes))


def _synthetic_drivers(safe: Sequence[tuple[int, ConcreteScenario]], settings: EvaluationSettings) -> list[Case]:
    count = settings.drivers.count
    return [
        Case(number, concrete, "human", f"driver_{index:02d}", "synthetic", index, count, settings.seed)
        for number, concrete in safe
        for index in range(count)
    ]


def _recorded_drivers(number: int, concrete: ConcreteScenario, locator: str, source: Path) -> Iterator[Outcome]:
    """The trajectories that the user's function has for a concrete scenario, as cases beside the simulated ones."""
    reference = load_object(locator, source, "Human reference")
    for index, trajectory in enumerate(reference(concrete)):
        if not isinstance(trajectory, Trajectory):
            raise InputError(
                f"The human reference `{locator}` must return Trajectory objects, got {type(trajectory).__name__} "
                f"for {concrete.scenario} at {concrete.label}."
            )
        case = Case(number, concrete, "human", f"driver_{index:02d}", locator)
        yield Outcome(case, "ok", Recording(trajectory, {}, None, "recorded"))
