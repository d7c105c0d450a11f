"""The method from end to end, in the paper's six steps.

It joins recording (`record/`), which simulates, with scoring (`scoring/`), which computes.

Facts first: `evaluate` simulates and stores what happened. Scores second: `score` computes every
index from the stored facts alone, without a simulation, as often as wanted and with other settings
if wanted. Functions import the modules that simulate or compute where they need them: these imports
take a second, and scores that a run has kept are read without them.

Users: `__init__.py`, `cli/`, `nightly/`, `report/assessed.py`, `extras/figures/`,
`extras/studies/sensitivity.py`.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sumo_eval.errors import InputError, must_be
from sumo_eval.method.severity import severity_of
from sumo_eval.record import run_folder
from sumo_eval.record.fingerprint import scores_key
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.record.points import choose_points, refuse_unknown_axes
from sumo_eval.record.progress import Progress, Stopping, never, quiet
from sumo_eval.record.store import open_store, vouch
from sumo_eval.results import Evaluation
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.scoring.kept_scores import KeptScoring
from sumo_eval.settings import EvaluationSettings, TaskSettings
from sumo_eval.settings.config import with_changes
from sumo_eval.settings.locators import load_object

if TYPE_CHECKING:
    from sumo_eval.method.zone_partition import ZonePartition
    from sumo_eval.record.facts import Evaluable, Recorded


_SCORING_SETTINGS = "method.", "report.", "run.workers", "run.incomplete"
"""Beginnings of settings on which no recorded fact depends, except `task_reference`."""


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

    The folder is the one that `sumo-eval run` leaves, with `scores.json`, `cases.csv` and
    `junit.xml`; its page, `report.html`, is written by `sumo-eval report OUT`.

    Raises StoppedError when `stopping` asks for it; what was done by then is kept.

    evaluation: settings, a dict as the file would be, the path of the file or of a run; None: the
        paper's, or with `resume` that of the run.
    workers, engine, scheduler: in place of those in `[run]`.
    resume: continue the run in `out`.
    ads: ADSs in place of the evaluation's own: locators, whose relative paths start in the current
        folder, or classes, functions and objects, of a notebook's cell too.
    """
    from sumo_eval.record.facts import resolve

    if isinstance(ads, str) or not isinstance(ads, Collection):
        raise must_be("`ads`", "`evaluate`", "a list of ADSs", ads)
    folder = Path(out)
    run = resolve(
        evaluation, folder, resume, ads, workers=workers, engine=engine, scheduler=scheduler
    )
    record_rounds(run, folder, resume=resume, progress=progress, stopping=stopping)
    done = score(folder, progress=progress, resolved=run)
    discard_trajectories(done)
    # loaded by its name, because `report/` imports this file
    load_object("sumo_eval.report.junit:write_results", None, "function")(done)
    return done


def record_rounds(
    run: Resolved, folder: Path, *, resume: bool, progress: Progress, stopping: Stopping
) -> Recorded:
    """Simulate an evaluation into a run folder, and where a scenario is sampled in rounds, one
    round after another.

    Each round is scored before the next one is chosen. A stopped run continues in its round.
    """
    from sumo_eval.record.facts import in_rounds, record_facts
    from sumo_eval.scoring.zones import find_zones, zones_are_known

    adaptive = any(entry.sampling.method == "adaptive" for entry in run.settings.scenario)
    if adaptive:
        run = in_rounds(run, folder if resume else None)
    # scoring needs the zones, driving does not: missing ones are computed while cases are driven
    zones = None
    if not zones_are_known(run.settings, run.source):
        zones = partial(find_zones, run.settings, run.source, folder)
    record = partial(record_facts, folder=folder, progress=progress, stopping=stopping)
    recorded = record(run, resume=resume, meanwhile=zones)
    # a run of single cases (`only`) has no further round
    while adaptive and not run.settings.run.only:
        further = _further_rounds(score(folder, progress=progress, resolved=run), run.settings)
        if further == run.settings:
            break
        run, notes = replace(run, settings=further), recorded.notes
        recorded = record(run, resume=True, another_round=True)
        # the notes of all rounds, each note once
        recorded = replace(recorded, notes=tuple(dict.fromkeys(notes + recorded.notes)))
    return recorded


def _further_rounds(evaluation: Evaluation, settings: EvaluationSettings) -> EvaluationSettings:
    """The settings with one more round in every adaptive scenario whose sample is not complete."""
    from sumo_eval.scoring.confidence.next_round import further_round

    entries = []
    for entry, logical in zip(settings.scenario, evaluation.scenarios.values(), strict=True):
        if entry.sampling.method == "adaptive":
            points = choose_points(logical, entry, evaluation.source, settings)
            entry = replace(
                entry, sampling=further_round(logical, entry.sampling, points, evaluation)
            )
        entries.append(entry)
    return replace(settings, scenario=tuple(entries))


def score(
    run: str | os.PathLike[str],
    changes: Sequence[str] = (),
    *,
    progress: Progress = quiet,
    resolved: Resolved | None = None,
) -> Evaluation:
    """Score a run from its recorded facts.

    changes: settings to use instead, e.g. `method.score.a=60`.
    resolved: the evaluation of the run, where its scenarios have been looked up.

    The run's folder keeps the results under a hash of all that they depend on. If it has them
    already, they are read from there.
    """
    folder = Path(run)
    recorded = run_folder.read_settings(folder)
    settings = with_changes(recorded, changes)
    _refuse_changes_of_facts(changes, recorded.method.task, settings.method.task)
    resolved = resolved or Resolved.of(settings, run_folder.source_of(folder))
    if changes:
        refuse_unknown_axes(resolved.scenarios, settings.report)
    resolved = replace(resolved, settings=settings)
    exposures = run_folder.read_exposures(folder)
    severity = severity_of(settings.method.collision, resolved.source)
    manifest = run_folder.read_manifest(folder)
    manifest = {
        **manifest,
        "versions": run_folder.versions_of(manifest),
        "severity": {"name": severity.name, "unit": severity.unit, "sha256": severity.sha256},
    }
    with open_store(folder) as store:
        run_folder.check_complete(store, folder)
        left_out, cache = store.left_out(), KeptResults(folder)
        key = scores_key(settings, store.content, resolved.source, severity.sha256, exposures)
        kept = KeptScoring(cache, key)
        results = kept.scores()
        if results is None:
            from sumo_eval.record.human_reference import point_processes
            from sumo_eval.scoring.steps import Scoring

            store.check_all()
            with point_processes(store, settings.run.workers) as spread:
                scoring = Scoring(resolved, exposures, severity, store, cache, spread, progress)
                results = kept.keep(scoring.scores(kept))
        vouch(folder, cache)
    return Evaluation(
        settings.name,
        folder,
        settings,
        manifest,
        results.zones,
        results.scores,
        kept.table(results.chunks),
        exposures,
        results.ranking,
        resolved.scenarios,
        left_out,
    )


def _refuse_changes_of_facts(
    changes: Sequence[str], recorded: TaskSettings, changed: TaskSettings
) -> None:
    """Raise InputError for a changed setting on which recorded facts depend.

    recorded, changed: `[method.task]` of the run, and with the changes.
    """
    names = [
        change.partition("=")[0]
        for change in changes
        if not change.strip().startswith(_SCORING_SETTINGS)
    ]
    if recorded.task_reference != changed.task_reference:
        names.append("method.task.task_reference")
    if names:
        raise InputError(
            f"`{names[0]}` cannot be changed by scoring: the recorded facts depend on it. Only "
            "`method` (except `task.task_reference`), `report`, `run.workers` and "
            "`run.incomplete` can; run the evaluation again for the rest."
        )


def refuse_to_score(folder: Path) -> None:
    """Raise InputError for a folder that holds no complete run, or one that is not as it was
    recorded.
    """
    run_folder.read_settings(folder)
    run_folder.read_manifest(folder)
    with open_store(folder) as store:
        run_folder.check_complete(store, folder)


def discard_trajectories(evaluation: Evaluation) -> int:
    """Discard the trajectories that `[run] keep` does not ask for; return the number of cases that
    lost theirs.

    Scores stay: D_i, bands and measures of these drives are kept.
    """
    keep, folder = evaluation.settings.run.keep, evaluation.folder
    if keep == "all":
        return 0
    from sumo_eval.scoring.critical import critical_points

    with run_folder.only_writer(folder, resume=True):
        with open_store(folder, create=True) as store:
            numbers = {case: number for case, number, _ in store.names("ads")}
            critical = critical_points(evaluation, numbers) if keep == "critical" else set()
            discarded = store.discard_trajectories(
                lambda scenario, number: (scenario, number) in critical
            )
        cache = KeptResults(folder)
        # the file has changed, so it is checked as a whole before it is vouched for
        with open_store(folder, whole=True):
            vouch(folder, cache)
        cache.close()
    return discarded


def zone_partitions(evaluation: Evaluation) -> dict[str, ZonePartition]:
    """The partition of every scenario of an evaluation, by scenario name."""
    from sumo_eval.scoring.zones import zones_of

    with closing(KeptResults(evaluation.folder)) as cache:
        return zones_of(evaluation.resolved, cache)
