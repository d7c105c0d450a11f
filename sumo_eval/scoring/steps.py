"""The paper's six steps over the recorded facts of a run: zones, drives, D_i, losses and weights, scores, ranking.

Whoever finds the scores of a run kept needs none of this: `sumo_eval.evaluation.score` imports it where it computes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sumo_eval.method.plausibility import Quantiles
from sumo_eval.method.severity import Severity
from sumo_eval.record.human_reference import LeftOut
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.record.points import choose_points, kept_zones
from sumo_eval.record.progress import Progress
from sumo_eval.record.spread import Spread
from sumo_eval.record.store import Fact, Store
from sumo_eval.results import ScenarioResult, ZoneResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.confidence.drivers import driver_deviations
from sumo_eval.scoring.confidence.intervals import ScoreIntervals
from sumo_eval.scoring.confidence.next_round import ADAPTIVE, standing
from sumo_eval.scoring.confidence.ranking import rank
from sumo_eval.scoring.confidence.scored import with_intervals
from sumo_eval.scoring.drive_measures import drive_measures
from sumo_eval.scoring.driving_task import recorded_with, tasks_of_drives
from sumo_eval.scoring.fingerprint import sources, space_key
from sumo_eval.scoring.kept_scores import RowWriter, Scores
from sumo_eval.scoring.likeness import (
    Comparison,
    Survey,
    compare_with_people,
    reference_notes,
    references,
    survey,
    with_people,
)
from sumo_eval.scoring.plausible_people import plausible_people
from sumo_eval.scoring.quantities import (
    Remarks,
    combine,
    describe_zones,
    drivers_left_out,
    point_terms,
    simulated_alone,
    tabulate,
)
from sumo_eval.scoring.requirements import with_counts, with_requirements
from sumo_eval.scoring.zones import zones_key
from sumo_eval.settings import EvaluationSettings, ScenarioSettings

POINTS_AT_ONCE = 512
"""Concrete scenarios whose cases are in memory at a time while a run is scored."""


@dataclass(frozen=True, slots=True)
class Scoring:
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
        # One thread: these matrices gain little from more, several wait for each other where the machine is busy (five
        # times the processor time at a load of six), and sums may differ by a bit with their number.
        with threadpool_limits(1):
            return self._all_scenarios(rows)

    def _all_scenarios(self, rows: RowWriter) -> Scores:
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
        key = zones_key(entry, settings, self.source)
        zones = kept_zones(logical, method.zones, self.kept, key)  # step 1: safe and hazardous zones
        known = survey(  # step 2: the ADSs in every concrete scenario
            logical, zones, key, store, settings, self.kept, self.progress
        )
        if points.stands_for is not None:
            known = replace(known, weights=known.weights * points.stands_for[: known.points])
        nobody = not logical.has_drivers and not known.compared
        plausible = plausible_people(logical, store, method.plausibility)
        remarks = {ads.name: Remarks(self.severity) for ads in settings.ads}
        car = method.task.task_reference if recorded_with(store, method.task.task_reference) else ""
        space = f"{entry.use} {space_key(entry, self.source)} {sources('scenario', 'settings')}"
        left_out: dict[str, LeftOut] = {}
        present: dict[str, Sequence[str]] = {}
        for first in range(0, known.points, POINTS_AT_ONCE):
            at_once = range(first, min(first + POINTS_AT_ONCE, known.points))
            people = self._some_points(
                logical, known, plausible.people, at_once, remarks, rows, space, car, nobody=nobody
            )
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
                *remarks[ads.name].actors_left,
                *remarks[ads.name].references_collide,
                *reference_notes(table),
                *remarks[ads.name].beyond_range,
            )
            scored = combine(  # step 6: C, D, S; T, A, H, S+
                ads.name, logical.name, table, method, notes, people=not nobody, task_reference=car
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
            points.stratum,
            self.progress,
        )
        described = describe_zones(logical, zones, points)
        if settings.run.only:
            few = len({point for places in known.driven.values() for point in places.tolist()})
            told = f"`run.only` asks for {few} of {len(points.points)} points: every number is of these alone."
            described = replace(described, notes=(*described.notes, told))
        if entry.sampling.method == ADAPTIVE:
            stands = standing(
                entry.sampling, points, finished, tables, [known.driven[ads.name] for ads in settings.ads], method,
                logical.name,
            )  # fmt: skip
            described = replace(described, notes=(*described.notes, stands.sentence))
        return described, finished, found

    def _some_points(
        self,
        logical: LogicalScenario,
        known: Survey,
        plausible: Quantiles,
        points: range,
        remarks: Mapping[str, Remarks],
        rows: RowWriter,
        space: str,
        car: str,
        *,
        nobody: bool,
    ) -> Comparison:
        """Steps 3 to 5 at some points: the rows of every ADS's cases there. space: stands for the scenario's files.
        car: the reference car, "" where the run holds none.
        """
        settings, store, method = self.settings, self.store, self.settings.method
        drives: dict[str, list[Fact]] = {ads.name: [] for ads in settings.ads}
        for fact in store.facts_at(points, "ads", logical.name):
            if fact.driver in drives:
                drives[fact.driver].append(fact)
        drivers = store.facts_at(points, "human", logical.name)
        compared = references(drivers, settings.drivers)
        judged = {  # step 3: collisions have no D_i
            name: [fact for fact in facts if not known.hazardous[fact.point] and fact.collision is None]
            for name, facts in drives.items()
        }
        stage = f"{logical.name}: comparison with the drivers"
        people = compare_with_people(  # step 4: D_i
            logical, compared, judged, known, store, settings, self.spread,
            lambda share: self.progress(stage, points.start + round(share * len(points)), known.points), self.kept,
        )  # fmt: skip
        idle = store.facts_at(points, "no_reaction", logical.name)
        cars = store.facts_at(points, "task_reference", logical.name) if car else []
        everyone = [*idle, *(fact for facts in drives.values() for fact in facts)]
        tasks = tasks_of_drives(  # beside the paper: departures and t_i
            everyone, [*drivers, *cars], logical, method.task.road_margin, store, self.kept, self.spread
        )
        there = point_terms(  # step 5: U, L, Ug, r, and U0 beside the paper
            known.weights, points, logical, store, self.severity, method, idle, tasks
        )
        outside = set(self.exposures.get(logical.name, {}).get("outside_support", ()))
        for name, facts in drives.items():
            measured = drive_measures(
                facts, store, plausible, logical, self.kept, space, self.spread
            )  # beside the paper: TTC, DRAC, PET, plausibility ...
            inside = known.hazardous[[fact.point for fact in facts]]
            table = tabulate(facts, inside, people.indexes, there, measured, self.severity, method, tasks)
            if nobody:
                table = [replace(row, human_likeness=None) for row in table]
            table = with_people(table, facts, people, compared, outside, settings.drivers)
            rows.add(with_requirements(table, facts, logical, store))
            remarks[name].add(facts)
            remarks[name].add_references([fact for fact in (*drivers, *cars) if not known.hazardous[fact.point]])
        self.progress(stage, points.stop, known.points)
        return people
