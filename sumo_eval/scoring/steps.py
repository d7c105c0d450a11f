"""The paper's six steps over the recorded facts of a run: zones, drives, comparison with drivers,
D_i, losses and weights, scores. Then intervals, and the ranking of the ADSs.

`sumo_eval.evaluation.score` imports this file only if the run's folder does not keep its scores.

Users: `evaluation.py`. Fixed: the order in which points and ADSs are scored, on which sums and
random streams depend.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sumo_eval.drivers.recorded.exposure import exposure_of
from sumo_eval.errors import InputError
from sumo_eval.method.plausibility import Quantiles
from sumo_eval.method.severity import Severity
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.human_reference import LeftOut
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.record.points import choose_points, kept_zones
from sumo_eval.record.progress import Progress
from sumo_eval.record.scenario_files import is_edited
from sumo_eval.record.spread import Spread
from sumo_eval.record.store import Store
from sumo_eval.results import ScenarioResult, ZoneResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.scenario.sampling.samples import Sample, sample_of
from sumo_eval.scoring.confidence.drivers import driver_deviations
from sumo_eval.scoring.confidence.intervals import ScoreIntervals
from sumo_eval.scoring.confidence.next_round import ADAPTIVE, standing
from sumo_eval.scoring.confidence.ranking import rank
from sumo_eval.scoring.confidence.resamples import Strata, of_one_number, strata
from sumo_eval.scoring.confidence.scored import with_intervals
from sumo_eval.scoring.drive_results import drive_results, recorded_with
from sumo_eval.scoring.kept_scores import KeptScoring, Scores
from sumo_eval.scoring.likeness import (
    DriverComparison,
    Survey,
    as_driven,
    compare_with_people,
    survey,
)
from sumo_eval.scoring.plausible_people import plausible_people
from sumo_eval.scoring.quantities import (
    Remarks,
    combine,
    describe_zones,
    harm_at,
    references_struck,
    tabulate,
)
from sumo_eval.scoring.requirements import with_counts
from sumo_eval.scoring.space import ScenarioRun
from sumo_eval.scoring.zones import zones_key
from sumo_eval.settings import EvaluationSettings, ScenarioSettings
from sumo_eval.trajectory import IntArray

POINTS_AT_ONCE = 512
"""Concrete scenarios whose cases are in memory at a time while a run is scored."""


class Scoring(NamedTuple):
    """A run to be scored: its facts, its settings, and the means to compute.

    run: settings and scenarios.
    exposures: scenario -> notes on its exposure, made when the run was recorded.
    severity: the measure of a collision's severity, U or its replacement.
    store: the facts.
    cache: earlier results.
    spread: `map`, or a function like it that shares the work among processes.
    """

    run: Resolved
    exposures: Mapping[str, Any]
    severity: Severity
    store: Store
    cache: KeptResults
    spread: Spread
    progress: Progress

    def scores(self, rows: KeptScoring) -> Scores:
        """The paper's six steps in every scenario, then the ranking of the ADSs.

        rows: takes in the rows of all cases.
        """
        # One thread, for two reasons. These matrices gain little from more threads, which wait for
        # each other on a busy machine (five times the processor time). And sums may differ by a bit
        # with the number of threads.
        with threadpool_limits(1):
            of_scenarios = [
                score_scenario(self._space(entry, logical), rows)
                for entry, logical in self.run.entries
            ]
        zones = tuple(zones for zones, _ in of_scenarios)
        scored = [pair for _, pairs in of_scenarios for pair in pairs]
        scores = tuple(score for score, _ in scored)
        intervals = {(score.ads, score.scenario): ends for score, ends in scored}
        ranking = None
        if self._same_points():
            ranking = rank(scores, intervals, self.run.settings.method.ranking)
        return Scores(zones, scores, ranking, rows.chunks(list(intervals)))

    def _same_points(self) -> bool:
        """Whether all ADSs drove the same points. Under `run.only` they may not have."""
        if not self.run.settings.run.only:
            return True
        points = defaultdict[str, set[str]](set)
        for case, _, ads in self.store.names("ads"):
            # the key of a case is `scenario-point-ADS`
            points[ads].add(case.removesuffix(ads))
        return len(set(map(frozenset, points.values()))) == 1

    def _space(self, entry: ScenarioSettings, logical: LogicalScenario) -> ScenarioRun:
        """One scenario of the run."""
        settings = self._settings_in(logical.name)
        reference = settings.method.task.task_reference
        exposure = self.exposures.get(logical.name, {})
        return ScenarioRun(
            entry, logical, self._points(entry, logical), settings, self.run.source,
            self.severity, self.store, self.cache, self.spread, self.progress,
            car=reference if recorded_with(self.store, reference) else "",
            outside=frozenset(exposure.get("outside_support", ())),
            edited=is_edited(exposure, entry.use, self.run.source)
        )  # fmt: skip

    def _settings_in(self, scenario: str) -> EvaluationSettings:
        """The settings of the run. Under `run.only` they list only ADSs with a case in the
        scenario.
        """
        settings = self.run.settings
        if not settings.run.only:
            return settings
        # names of these ADSs
        names = {
            count.driver
            for count in self.store.counts()
            if (count.scenario, count.role) == (scenario, "ads")
        }
        return replace(settings, ads=tuple(ads for ads in settings.ads if ads.name in names))

    def _points(self, entry: ScenarioSettings, logical: LogicalScenario) -> Sample:
        """The points that the settings choose now. If a file that they need is gone or has a
        mistake: no points, and a note.

        Scoring reads no recordings. If the choice needs a density from recordings: no points, and
        no note.
        """
        settings, source = self.run.settings, self.run.source
        density_is_recorded = entry.exposure.kind == "recorded"
        density = None
        try:
            if not density_is_recorded:
                density = exposure_of(logical, entry.exposure, settings.drivers, source).density
            return choose_points(logical, entry, source, settings, density)
        except InputError as error:
            no_points = sample_of(np.empty((0, len(logical.names))), entry.sampling.method or "")
            if density_is_recorded and not entry.sampling.file:
                return no_points
            remark = "The settings choose no points any more, so those that were driven count"
            return replace(no_points, notes=(f"{remark}: {error}",))


Scored = list[tuple[ScenarioResult, ScoreIntervals | None]]
"""The result of each ADS in a scenario, with the intervals that a ranking needs; None: too few
cases for intervals."""


def score_scenario(space: ScenarioRun, rows: KeptScoring) -> tuple[ZoneResult, Scored]:
    """The six steps in one scenario, steps 3 to 5 for `POINTS_AT_ONCE` points at a time.

    rows: takes in the rows of the cases.
    """
    method = space.method
    # 1  safe and hazardous zones, Eqs. 1-8
    key = zones_key(space.entry, space.settings, space.source)
    zones = kept_zones(space.logical, method.zones, space.cache, key)
    # 2  the ADSs in every concrete scenario
    overview = survey(space, zones, key)
    people, people_notes = plausible_people(space.logical, space.store, method.plausibility)
    remarks = {ads.name: Remarks(Counter(), Counter()) for ads in space.settings.ads}
    struck = list(references_struck(space, overview))
    left_out: dict[str, tuple[LeftOut, Sequence[str]]] = {}
    for first in range(0, len(overview.weights), POINTS_AT_ONCE):
        part = range(first, min(first + POINTS_AT_ONCE, len(overview.weights)))
        # 3 to 5  D_i, losses and weights of the cases, Eqs. 9-12 and 14-16
        compared = score_points(space, overview, part, people, remarks, rows)
        left_out |= compared.left_out
    tables = [rows.rows(ads.name, space.name) for ads in space.settings.ads]
    # 6  C, D and S, Eqs. 13, 17, 18; T, A', H, S+
    scores = []
    for (name, remark), table in zip(remarks.items(), tables, strict=True):
        score = combine(
            name, space.name, table, method,
            remark.notes(name, space, people_notes, struck, table),
            people=overview.people, task_reference=space.car
        )  # fmt: skip
        scores.append(with_counts(score, table, space.logical))

    # intervals, and the summary of the zones
    points = as_driven(space.points, overview.points, whole=not space.settings.run.only)
    places = [overview.driven[name] for name in remarks]  # of each ADS the points of its cases
    deviations = [
        driver_deviations(table, left_out, space.settings.drivers, space.settings.seed)
        for table in tables
    ]
    groups = _exchangeable(points, space.logical)
    scores, intervals = with_intervals(
        scores, tables, places, deviations, groups, space.settings, space.progress
    )
    described = describe_zones(space.logical, zones, points)
    sentences = [*described.notes, *_on_points(space, points, places)]
    # without a stratum the points can no longer be chosen, which a sentence reports
    if space.entry.sampling.method == ADAPTIVE and points.stratum is not None:
        state = standing(space.entry.sampling, points, scores, tables, places)
        sentences.append(state.sentence)
    return replace(described, notes=tuple(sentences)), list(zip(scores, intervals, strict=True))


def _exchangeable(points: Sample, logical: LogicalScenario) -> Strata:
    """Lists of points that a resample may exchange for each other: the sample's own strata, if it
    has any.
    """
    if points.stratum is not None:
        return of_one_number(points.stratum)
    return strata(logical.to_unit(points.points), points.method)


def _on_points(space: ScenarioRun, points: Sample, places: Sequence[IntArray]) -> Iterator[str]:
    """Sentences for a run whose points are not those of the settings, or not all of them.

    points: the sample that was driven.
    places: of each ADS the numbers of the points of its cases.
    """
    chosen = space.points
    # Scoring cannot repeat a choice that needs a density from recordings. A choice from a file of
    # points needs none.
    is_repeatable = space.entry.exposure.kind != "recorded" or space.entry.sampling.file
    if points is not chosen and len(chosen.points) and is_repeatable:
        yield "The settings choose other points now, so those that were driven count."
    if space.edited:
        yield "The scenario's file changed after it was driven: zones are those of today's file."
    if space.settings.run.only:
        number = len(np.unique(np.concatenate(places)))
        yield (
            f"`run.only` asks for {number} of {len(points.points)} points: every number is of "
            "these alone."
        )


def score_points(
    space: ScenarioRun,
    overview: Survey,
    points: range,
    people: Quantiles,
    remarks: Mapping[str, Remarks],
    rows: KeptScoring,
) -> DriverComparison:
    """Steps 3 to 5 at some points. Adds every ADS's cases there to `rows`, and remarks on them to
    `remarks`; returns the comparison with the drivers there.

    overview: zones and weights of all points.
    points: numbers of the points.
    people: table of people that the plausibility compares with.
    remarks: of each ADS.
    """
    drives: dict[str, list[Fact]] = {ads.name: [] for ads in space.settings.ads}
    for fact in space.facts_at(points, "ads"):
        if fact.driver in drives:
            drives[fact.driver].append(fact)
    drivers = space.facts_at(points, "human")
    unreacting = space.facts_at(points, "no_reaction")
    cars = space.facts_at(points, "task_reference") if space.car else []
    # 3 and 4  D_i of the safe cases without a collision, Eqs. 9-12
    compared = compare_with_people(space, overview, points, drivers, drives)
    egos = [*unreacting, *(fact for facts in drives.values() for fact in facts)]
    # beyond the paper: departures, t_i, TTC, PET, extremes ...
    results = drive_results(egos, [*drivers, *cars], space)
    # 5  U, L, Ug, r, Eqs. 14-16
    harm = harm_at(space, overview, points, unreacting, results)
    for name, facts in drives.items():
        rows.add(list(tabulate(facts, space, overview, compared, harm, results, people)))
        remarks[name].add(facts, space.severity)
    space.progress(f"{space.name}: comparison with the drivers", points.stop, len(overview.weights))
    return compared
