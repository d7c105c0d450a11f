"""What of a run a figure shows: the scenario, the ADS and the concrete scenario that are asked for, or telling ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sumo_eval.cases import CaseResult
from sumo_eval.errors import InputError, unknown
from sumo_eval.record.points import scenarios_of
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import open_store
from sumo_eval.results import Evaluation
from sumo_eval.scenario.road.reference_line import Piece
from sumo_eval.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Scene:
    """One concrete scenario of a run as it was driven.

    runs: the ego of every ADS, others: the other vehicles in the drive of the first, people: the egos of the human
    drivers by name, none in the hazardous zone. words: where it lies in the space. line: of the road, as in `Road`.
    """

    scenario: str
    words: str
    runs: Mapping[str, Trajectory]
    others: Mapping[str, Trajectory]
    people: Mapping[str, Trajectory]
    line: tuple[Piece, ...]


def scenario_of(evaluation: Evaluation, scenario: str | None) -> str:
    """The scenario asked for, else the first. Raises InputError for one that the run does not have."""
    names = [zone.scenario for zone in evaluation.zones]
    if scenario is not None and scenario not in names:
        raise unknown("scenario", scenario, names)
    return scenario or names[0]


def ads_of(evaluation: Evaluation, ads: str | None) -> list[str]:
    """The ADS asked for, else all. Raises InputError for one that the run does not have."""
    names = [entry.name for entry in evaluation.settings.ads]
    if ads is not None and ads not in names:
        raise unknown("ADS", ads, names)
    return names if ads is None else [ads]


def case_of(evaluation: Evaluation, case: str | None, scenario: str | None) -> CaseResult:
    """The case asked for, else a telling one of the scenario: the least human-like of those that have an index D_i.

    Raises InputError for a case that the run does not have, or where none was evaluated.
    """
    if case is not None:
        found = next((row for row in evaluation.cases if row.case == case), None)
        if found is None:
            raise unknown("case", case, [row.case for row in evaluation.cases])
        return found
    name = scenario_of(evaluation, scenario)
    rows = [row for row in evaluation.cases if row.scenario == name and row.evaluated]
    if not rows:
        raise InputError(f"No case of scenario `{name}` was evaluated, so there is no drive to draw.")
    judged = [row for row in rows if row.index is not None]
    return min(judged or rows, key=lambda row: (row.index if row.index is not None else 0.0, row.case))


def scene_of(evaluation: Evaluation, case: CaseResult, ads: Sequence[str]) -> Scene:
    """Everybody who drove through a case's concrete scenario."""
    with open_store(evaluation.folder / FACTS) as store:
        named = {name: (point, who) for name, point, who in store.names("ads", case.scenario)}
        point = named[case.case][0]
        driven = {who: name for name, (at, who) in named.items() if at == point and who in ads}
        runs: dict[str, Trajectory] = {}
        others: dict[str, Trajectory] = {}
        for who in ads:
            drive = store.trajectories(driven[who]) if who in driven else {}
            if "ego" in drive:
                runs[who] = drive.pop("ego")
                others = others or drive
        people = {
            who: drive["ego"]
            for name, at, who in store.names("human", case.scenario)
            if at == point and "ego" in (drive := store.trajectories(name))
        }
    if not runs:
        raise InputError(f"Case `{case.case}` has no trajectory to draw.")
    words = ", ".join(f"{name} = {value:g}" for name, value in case.values.items())
    logical = scenarios_of(evaluation.settings, Path(evaluation.manifest["source_folder"]))[case.scenario]
    return Scene(case.scenario, words, runs, others, people, logical.placed(case.values).road.line)
