"""The method from end to end, in the paper's six steps. The only module that knows both SUMO's side and the equations'.

Facts first: `evaluate` simulates and stores what happened. Scores second: `score` computes every index from the stored
facts alone, again and again, with other settings if wanted, without a simulation.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from sumo_eval.batch import run_folder
from sumo_eval.batch.recording import Progress, quiet, record
from sumo_eval.batch.store import open_store
from sumo_eval.config import PAPER_EVALUATION, read_evaluation, with_changes
from sumo_eval.cosim.controller import find_controller
from sumo_eval.errors import InputError
from sumo_eval.method.danger import danger
from sumo_eval.method.zone_partition import ZonePartition, partition
from sumo_eval.results import CaseResult, Evaluation, ScenarioResult, ZoneResult
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.request import Request
from sumo_eval.scenario.sampling import Sample, sample
from sumo_eval.scoring import (
    collision_terms,
    combine,
    criticality_measures,
    describe_zones,
    drivers_left_out,
    human_likeness,
    ideal_outcomes,
    tabulate,
)
from sumo_eval.settings import EvaluationSettings, ScenarioSettings, ZoneSettings


def evaluate(
    evaluation: EvaluationSettings | str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] = "results",
    *,
    workers: int | None = None,
    progress: Progress = quiet,
) -> Evaluation:
    """Simulate and score an evaluation (settings, or the path of its file; None: the paper's) into the folder `out`."""
    settings, source = _resolve(evaluation)
    if workers is not None:
        settings = replace(settings, run=replace(settings.run, workers=workers))
    for ads in settings.ads:  # a misspelt controller must not be found out after an hour of simulation
        find_controller(ads.controller, source)
    spaces = [choose_points(entry, source, settings) for entry in settings.scenario]
    for logical, _ in spaces:
        for name in settings.report.axes.get(logical.name, ()):
            logical.column(name)
    folder = Path(out)
    run_folder.create(folder, settings, source, [_middle(logical, points) for logical, points in spaces])
    with open_store(folder / run_folder.FACTS, create=True) as store:
        for logical, points in spaces:
            hazardous = zones_of(logical, settings.method.zones).hazardous(points.points)
            record(logical, points, hazardous, settings, source, store, progress)
    return score(folder, progress=progress)


def score(run: str | os.PathLike[str], changes: Sequence[str] = (), *, progress: Progress = quiet) -> Evaluation:
    """Score a run from its recorded facts. `changes`: settings to use instead, e.g. `method.score.a=60`."""
    folder = Path(run)
    for change in changes:
        if not change.strip().startswith(("method.", "report.", "run.")):
            raise InputError(
                f"`{change.partition('=')[0]}` cannot be changed by scoring: the recorded facts depend on it. "
                "Only `method`, `report` and `run` can; run the evaluation again for the rest."
            )
    settings = with_changes(run_folder.read_settings(folder), changes)
    manifest = run_folder.read_manifest(folder)
    source, method = Path(manifest["source_folder"]), settings.method
    zone_results: list[ZoneResult] = []
    scores: list[ScenarioResult] = []
    cases: list[CaseResult] = []
    with open_store(folder / run_folder.FACTS) as store:
        for entry in settings.scenario:
            logical, points = choose_points(entry, source, settings)
            zones = zones_of(logical, method.zones)  # step 1: safe and hazardous zones
            zone_results.append(describe_zones(logical, zones, points))
            for ads in settings.ads:
                facts = store.facts("ads", logical.name, ads.name)  # step 2: the ADS in every concrete scenario
                if not facts:
                    raise InputError(f"Run {folder} holds no case of ADS `{ads.name}` in scenario `{logical.name}`.")
                hazardous = zones.hazardous(np.array([logical.row(fact.values) for fact in facts]))
                safe = [fact for fact, dangerous in zip(facts, hazardous, strict=True) if not dangerous]
                indexes, notes = {}, drivers_left_out(logical, store)
                if not any(fact.collision for fact in safe):  # step 3: else there is no D
                    indexes = human_likeness(logical, safe, store, settings, progress)  # step 4: D_i
                collisions = collision_terms(logical, zones, facts, store)  # step 5: U, L, Ug, r
                measured = criticality_measures(facts, store)  # beside the paper: TTC, DRAC, PET ...
                rows = tabulate(facts, hazardous, indexes, collisions, ideal_outcomes(logical, store), measured)
                cases += rows
                scores.append(combine(ads.name, logical.name, rows, method, notes))  # step 6: C, D, S
    return Evaluation(settings.name, folder, settings, manifest, tuple(zone_results), tuple(scores), tuple(cases))


def zone_partitions(evaluation: Evaluation) -> dict[str, ZonePartition]:
    """The partition of every scenario of an evaluation, by scenario name."""
    settings, source = evaluation.settings, Path(evaluation.manifest["source_folder"])
    spaces = [catalogue.find(entry.use, source) for entry in settings.scenario]
    return {logical.name: zones_of(logical, settings.method.zones) for logical in spaces}


@lru_cache(maxsize=16)
def zones_of(logical: LogicalScenario, settings: ZoneSettings) -> ZonePartition:
    """The partition of a scenario; asked for again by every stage of an evaluation, computed once."""
    return partition(logical, settings)


def choose_points(
    entry: ScenarioSettings, source: Path, settings: EvaluationSettings
) -> tuple[LogicalScenario, Sample]:
    """A logical scenario and the points of its space that are simulated."""
    logical, sampling = catalogue.find(entry.use, source), entry.sampling
    request = Request(
        levels=sampling.levels,
        steps=sampling.steps,
        count=sampling.count,
        strength=sampling.strength,
        file=sampling.file,
        folder=source,
        seed=settings.seed,
        danger=lambda points: danger(logical, points, settings.method.zones),
    )
    points = sample(logical, sampling.method, request=request)
    if len(points.points) == 0:
        raise InputError(f"The sampling of scenario `{entry.use}` must choose at least one possible point, got none.")
    return logical, points


def _resolve(evaluation: EvaluationSettings | str | os.PathLike[str] | None) -> tuple[EvaluationSettings, Path]:
    """The settings and the folder where their relative paths start."""
    if isinstance(evaluation, EvaluationSettings):
        return evaluation, Path.cwd()
    path = PAPER_EVALUATION if evaluation is None else Path(evaluation)
    return read_evaluation(path), path.parent.resolve()


def _middle(logical: LogicalScenario, points: Sample) -> ConcreteScenario:
    """The concrete scenario in the middle of the sample, the example that the run folder keeps for sumo-gui."""
    return logical.concretes(points.points[len(points.points) // 2][None])[0]
