"""The method from end to end, in the paper's six steps. The only module that knows both SUMO's side and the equations'.

Facts first: `evaluate` simulates and stores what happened. Scores second: `score` computes every index from the stored
facts alone, again and again, with other settings if wanted, without a simulation.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.method.plausibility import Quantiles
from sumo_eval.method.severity import Severity
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record import run_folder
from sumo_eval.record.engines import Stopping, never
from sumo_eval.record.facts import Evaluable, check_complete, record_facts, resolve
from sumo_eval.record.human_reference import LeftOut, point_processes
from sumo_eval.record.kept_results import KeptResults, key_of
from sumo_eval.record.points import choose_points, kept_zones, scenarios_of
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.record.spread import Spread
from sumo_eval.record.store import Fact, Store, open_store, vouch
from sumo_eval.results import Evaluation, ScenarioResult, ZoneResult
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.confidence.drivers import driver_deviations
from sumo_eval.scoring.confidence.intervals import ScoreIntervals
from sumo_eval.scoring.confidence.ranking import rank
from sumo_eval.scoring.confidence.scored import with_intervals
from sumo_eval.scoring.critical import critical_points
from sumo_eval.scoring.drive_measures import drive_measures
from sumo_eval.scoring.fingerprint import scores_key, sources, space_key
from sumo_eval.scoring.kept_rows import KeptRows
from sumo_eval.scoring.kept_scores import RowWriter, Scores, keep_scores, kept_scores
from sumo_eval.scoring.likeness import (
    Comparison,
    Survey,
    compare_with_people,
    plausible_people,
    reference_notes,
    references,
    survey,
    with_people,
)
from sumo_eval.scoring.quantities import (
    Remarks,
    chosen_severity,
    combine,
    describe_zones,
    drivers_left_out,
    point_terms,
    simulated_alone,
    tabulate,
)
from sumo_eval.scoring.requirements import with_counts, with_requirements
from sumo_eval.settings import EvaluationSettings, ScenarioSettings
from sumo_eval.settings.config import with_changes

ROOMS_OF_ZONES = ("method", "scenario", "settings")
"""Rooms of this package that a partition comes from."""
POINTS_AT_ONCE = 512
"""Concrete scenarios whose cases are in memory at a time while a run is scored."""


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
    done = score(folder, progress=progress)
    let_go(done)
    return done


def score(run: str | os.PathLike[str], changes: Sequence[str] = (), *, progress: Progress = quiet) -> Evaluation:
    """Score a run from its recorded facts. `changes`: settings to use instead, e.g. `method.score.a=60`.

    What was computed is kept in the run's folder with a hash of all that it depends on, and taken from there.
    """
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
    facts = folder / run_folder.FACTS
    with open_store(facts) as store:
        check_complete(store, folder)
        kept = KeptResults(folder)
        key = scores_key(settings, store.content, source, severity.sha256, exposures)
        found = kept_scores(kept, key)
        if found is None:
            store.check_all()
            with point_processes(store, settings.run.workers) as spread:
                scoring = _Scoring(settings, source, exposures, severity, store, kept, spread, progress)
                found = keep_scores(kept, key, scoring.scores(RowWriter(kept, key)))
        vouch(facts, kept)
    return Evaluation(
        settings.name,
        folder,
        settings,
        manifest,
        found.zones,
        found.scores,
        KeptRows(kept, key, found.chunks),
        exposures,
        found.ranking,
        _checks(settings, source),
    )


def _checks(settings: EvaluationSettings, source: Path) -> dict[str, dict[str, str]]:
    """Names and conditions of what scenarios require, by scenario."""
    return {
        name: {one.name: one.text for one in logical.requirements.all}
        for name, logical in scenarios_of(settings, source).items()
        if logical.requirements is not None
    }


def refuse_to_score(run: str | os.PathLike[str]) -> None:
    """Raise InputError for a folder that holds no complete run, or one that is not as it was recorded."""
    folder = Path(run)
    run_folder.read_settings(folder)
    run_folder.read_manifest(folder)
    with open_store(folder / run_folder.FACTS) as store:
        check_complete(store, folder)


@dataclass(frozen=True, slots=True)
class _Scoring:
    """One reading of a run's facts. spread: where D_i are computed. kept: what was computed before."""

    settings: EvaluationSettings
    source: Path
    exposures: Mapping[str, Any]
    severity: Severity
    store: Store
    kept: KeptResults
    spread: Spread
    progress: Progress

    def scores(self, rows: RowWriter) -> Scores:
        """The paper's six steps in every scenario, and the ADSs in their order."""
        zones: list[ZoneResult] = []
        scores: list[ScenarioResult] = []
        spreads: dict[tuple[str, str], ScoreIntervals | None] = {}
        for entry in self.settings.scenario:
            result, finished, found = self._scenario(entry, rows)
            zones.append(result)
            scores += finished
            spreads |= {(one.ads, one.scenario): spread for one, spread in zip(finished, found, strict=True)}
        ranking = rank(scores, spreads, self.settings.method.ranking)
        order = [(one.ads, one.scenario) for one in scores]
        return Scores(tuple(zones), tuple(scores), ranking, rows.chunks(order))

    def _scenario(
        self, entry: ScenarioSettings, rows: RowWriter
    ) -> tuple[ZoneResult, list[ScenarioResult], list[ScoreIntervals | None]]:
        settings, store, method = self.settings, self.store, self.settings.method
        logical, points = choose_points(entry, self.source, settings)
        zones = _zones(entry, logical, settings, self.source, self.kept)  # step 1: safe and hazardous zones
        known = survey(logical, zones, store, settings)  # step 2: the ADSs in every concrete scenario
        nobody = not logical.has_drivers and not known.compared
        plausible = plausible_people(logical, store, method.plausibility)
        remarks = {ads.name: Remarks(self.severity) for ads in settings.ads}
        space = f"{entry.use} {space_key(entry, self.source)} {sources('scenario', 'settings')}"
        left_out: dict[str, LeftOut] = {}
        present: dict[str, Sequence[str]] = {}
        for first in range(0, known.points, POINTS_AT_ONCE):
            at_once = range(first, min(first + POINTS_AT_ONCE, known.points))
            people = self._some_points(logical, known, plausible.people, at_once, remarks, rows, space, nobody=nobody)
            left_out |= people.left_out
            present |= people.present
        combined: list[ScenarioResult] = []
        tables = [rows.rows(ads.name, logical.name) for ads in settings.ads]
        for ads, table in zip(settings.ads, tables, strict=True):
            notes = (
                *drivers_left_out(logical, store),
                *plausible.notes,
                *simulated_alone(logical, ads.name, store),
                *remarks[ads.name].in_blocks,
                *reference_notes(table),
                *remarks[ads.name].beyond_range,
            )
            scored = combine(  # step 6: C, D, S; A, H, S+
                ads.name, logical.name, table, method, notes, people=not nobody
            )
            combined.append(with_counts(scored, table, logical))
        finished, found = with_intervals(
            combined,
            tables,
            [known.driven[ads.name] for ads in settings.ads],
            [driver_deviations(table, left_out, present, settings.drivers, settings.seed) for table in tables],
            logical.to_unit(points.points),
            points.method,
            settings,
        )
        return describe_zones(logical, zones, points), finished, found

    def _some_points(
        self,
        logical: LogicalScenario,
        known: Survey,
        plausible: Quantiles,
        points: range,
        remarks: Mapping[str, Remarks],
        rows: RowWriter,
        space: str,
        *,
        nobody: bool,
    ) -> Comparison:
        """Steps 3 to 5 at some points: the rows of every ADS's cases there. space: stands for the scenario's files."""
        settings, store, method = self.settings, self.store, self.settings.method
        drives: dict[str, list[Fact]] = {ads.name: [] for ads in settings.ads}
        for fact in store.facts_at(points, "ads", logical.name):
            if fact.driver in drives:
                drives[fact.driver].append(fact)
        compared = references(store.facts_at(points, "human", logical.name), settings.drivers)
        judged = {  # step 3: collisions have no D_i
            name: [fact for fact in facts if not known.hazardous[fact.point] and fact.collision is None]
            for name, facts in drives.items()
        }
        stage = f"{logical.name}: comparing everybody with the drivers"
        people = compare_with_people(  # step 4: D_i
            logical, compared, judged, known, store, settings, self.spread,
            lambda share: self.progress(stage, points.start + round(share * len(points)), known.points), self.kept,
        )  # fmt: skip
        there = point_terms(  # step 5: U, L, Ug, r, and U0 beside the paper
            known.weights, points, logical, store, self.severity, method.collision
        )
        outside = set(self.exposures.get(logical.name, {}).get("outside_support", ()))
        for name, facts in drives.items():
            measured = drive_measures(
                facts, store, plausible, logical, self.kept, space, self.spread
            )  # beside the paper: TTC, DRAC, PET, plausibility ...
            inside = known.hazardous[[fact.point for fact in facts]]
            table = tabulate(facts, inside, people.indexes, there, measured, self.severity, method.collision)
            if nobody:
                table = [replace(row, human_likeness=None) for row in table]
            table = with_people(table, facts, people, compared, outside, settings.drivers)
            rows.add(logical.name, name, with_requirements(table, facts, logical, store))
            remarks[name].add(facts)
        self.progress(stage, points.stop, known.points)
        return people


def _zones(
    entry: ScenarioSettings, logical: LogicalScenario, settings: EvaluationSettings, source: Path, kept: KeptResults
) -> ZonePartition:
    """The partition of a scenario, kept or computed."""
    key = key_of("zones", settings.method.zones, entry.use, space_key(entry, source), sources(*ROOMS_OF_ZONES))
    return kept_zones(logical, settings.method.zones, kept, key)


def let_go(evaluation: Evaluation) -> int:
    """Take out the trajectories that `[run] keep` does not ask for; how many cases lost theirs comes back.

    What was scored stays scored: D_i, bands and measures of these drives are kept.
    """
    keep, folder = evaluation.settings.run.keep, evaluation.folder
    if keep == "all":
        return 0
    facts, source = folder / run_folder.FACTS, Path(evaluation.manifest["source_folder"])
    with run_folder.only_writer(folder, resume=True):
        with open_store(facts, create=True) as store:
            critical: set[tuple[str, int]] = set()
            if keep == "critical":
                numbers = {case: number for case, number, _ in store.names("ads")}
                critical = critical_points(evaluation, scenarios_of(evaluation.settings, source), numbers)
            gone = store.let_go(lambda scenario, number: (scenario, number) in critical)
        kept = KeptResults(folder)
        with open_store(facts, whole=True):
            vouch(facts, kept)
        kept.close()
    return gone


def zone_partitions(evaluation: Evaluation) -> dict[str, ZonePartition]:
    """The partition of every scenario of an evaluation, by scenario name."""
    settings, source = evaluation.settings, Path(evaluation.manifest["source_folder"])
    kept = KeptResults(evaluation.folder)
    found = {}
    for entry in settings.scenario:
        logical = catalogue.find(entry.use, source)
        found[logical.name] = _zones(entry, logical, settings, source, kept)
    kept.close()
    return found
