"""The method from end to end, in the paper's six steps. The only module that knows both SUMO's side and the equations'.

Facts first: `evaluate` simulates and stores what happened. Scores second: `score` computes every index from the stored
facts alone, again and again, with other settings if wanted, without a simulation.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record import run_folder
from sumo_eval.record.engines import Stopping, never
from sumo_eval.record.facts import Evaluable, check_complete, record_facts, resolve
from sumo_eval.record.human_reference import point_processes
from sumo_eval.record.points import choose_points, zones_of
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.record.store import Fact, open_store
from sumo_eval.results import CaseResult, Evaluation, ScenarioResult, ZoneResult
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.confidence.drivers import driver_deviations
from sumo_eval.scoring.confidence.intervals import ScoreIntervals
from sumo_eval.scoring.confidence.ranking import rank
from sumo_eval.scoring.confidence.scored import with_intervals
from sumo_eval.scoring.likeness import (
    compare_with_people,
    plausible_people,
    reference_notes,
    references,
    with_people,
)
from sumo_eval.scoring.quantities import (
    beyond_range,
    chosen_severity,
    combine,
    describe_zones,
    drive_measures,
    driven_in_blocks,
    drivers_left_out,
    point_terms,
    simulated_alone,
    tabulate,
)
from sumo_eval.scoring.requirements import with_counts, with_requirements
from sumo_eval.settings.config import with_changes
from sumo_eval.trajectory import BoolArray


def evaluate(
    evaluation: Evaluable = None,
    out: str | os.PathLike[str] = "results",
    *,
    workers: int | None = None,
    engine: str | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    ads: Sequence[Any] = (),
    progress: Progress = quiet,
    stopping: Stopping = never,
) -> Evaluation:
    """Simulate and score an evaluation into the folder `out`.

    evaluation: settings, a dict as the file would be, or the path of the file; None: the paper's.

    workers, engine, scheduler: instead of those in `[run]`. resume: go on with the run in `out`, whose own evaluation
    is what None then means. ads: what to drive in place of the evaluation's own ADSs: locators, whose relative paths
    start in the current folder, or classes, functions and objects, of a notebook's cell too. Raises StoppedError when
    `stopping` said so; what was done by then is kept.
    """
    folder = Path(out)
    settings, source = resolve(evaluation, folder, resume, ads, workers=workers, engine=engine, scheduler=scheduler)
    record_facts(settings, source, folder, resume=resume, progress=progress, stopping=stopping)
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
    exposures = run_folder.read_exposures(folder)
    severity = chosen_severity(method.collision, source)
    made_with = {"name": method.collision.severity, "unit": severity.unit, "sha256": severity.sha256}
    manifest = {**manifest, "severity": made_with}
    zone_results: list[ZoneResult] = []
    scores: list[ScenarioResult] = []
    cases: list[CaseResult] = []
    spreads: dict[tuple[str, str], ScoreIntervals | None] = {}
    checks: dict[str, dict[str, str]] = {}
    with open_store(folder / run_folder.FACTS) as store, point_processes(store, settings.run.workers) as spread:
        check_complete(store, folder)
        for entry in settings.scenario:
            logical, points = choose_points(entry, source, settings)
            if logical.requirements is not None:
                checks[logical.name] = {one.name: one.text for one in logical.requirements.all}
            zones = zones_of(logical, method.zones)  # step 1: safe and hazardous zones
            zone_results.append(describe_zones(logical, zones, points))
            compared = references(logical, store, settings.drivers)
            exposure = exposures.get(logical.name, {})
            drives: dict[str, list[Fact]] = {}
            hazardous: dict[str, BoolArray] = {}
            judged: list[list[Fact]] = []
            for ads in settings.ads:
                facts = store.facts("ads", logical.name, ads.name)  # step 2: the ADS in every concrete scenario
                if not facts:
                    raise InputError(f"Run {folder} holds no case of ADS `{ads.name}` in scenario `{logical.name}`.")
                inside = zones.exactly_hazardous(np.array([logical.row(fact.values) for fact in facts]))
                safe = [fact for fact, dangerous in zip(facts, inside, strict=True) if not dangerous]
                drives[ads.name], hazardous[ads.name] = facts, inside
                judged.append([fact for fact in safe if fact.collision is None])  # step 3: collisions have no D_i
            people = compare_with_people(  # step 4: D_i
                logical, compared, judged, store, settings, spread, progress
            )
            nobody = not logical.has_drivers and not compared
            left_out = drivers_left_out(logical, store)
            plausible = plausible_people(logical, store, method.plausibility)
            there = point_terms(  # step 5: U, L, Ug, r, and U0 beside the paper
                logical, zones, store, severity, method.collision
            )
            combined: list[ScenarioResult] = []
            tables: list[list[CaseResult]] = []
            for name, facts in drives.items():
                measured = drive_measures(
                    facts, store, plausible.people, logical
                )  # beside the paper: TTC, DRAC, PET, plausibility ...
                rows = tabulate(facts, hazardous[name], people.indexes, there, measured, severity, method.collision)
                if nobody:
                    rows = [replace(row, human_likeness=None) for row in rows]
                rows = with_people(rows, facts, people, compared, exposure, settings.drivers)
                rows = with_requirements(rows, facts, logical, store)
                notes = (
                    *left_out,
                    *plausible.notes,
                    *simulated_alone(logical, name, store),
                    *driven_in_blocks(facts),
                    *reference_notes(rows),
                    *beyond_range(facts, severity),
                )
                tables.append(rows)
                scored = combine(  # step 6: C, D, S; A, H, S+
                    name, logical.name, rows, method, notes, people=not nobody
                )
                combined.append(with_counts(scored, rows, logical))
            present = {
                fact.case: compared[fact.point].drivers
                for facts in drives.values()
                for fact in facts
                if fact.point in compared
            }
            finished, found = with_intervals(
                combined,
                tables,
                [[fact.point for fact in facts] for facts in drives.values()],
                [driver_deviations(rows, people.left_out, present, settings.drivers, settings.seed) for rows in tables],
                logical.to_unit(points.points),
                points.method,
                settings,
            )
            scores += finished
            cases += [row for rows in tables for row in rows]
            spreads |= {(one.ads, one.scenario): spread for one, spread in zip(finished, found, strict=True)}
    return Evaluation(
        settings.name,
        folder,
        settings,
        manifest,
        tuple(zone_results),
        tuple(scores),
        tuple(cases),
        exposures,
        rank(scores, spreads, method.ranking),
        checks,
    )


def zone_partitions(evaluation: Evaluation) -> dict[str, ZonePartition]:
    """The partition of every scenario of an evaluation, by scenario name."""
    settings, source = evaluation.settings, Path(evaluation.manifest["source_folder"])
    spaces = [catalogue.find(entry.use, source) for entry in settings.scenario]
    return {logical.name: zones_of(logical, settings.method.zones) for logical in spaces}
