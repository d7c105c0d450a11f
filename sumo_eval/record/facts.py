"""Recording half of an evaluation: plan its cases, simulate them into a run folder, resume, merge,
verify.

For `sumo_eval.evaluation`, the estimate of `run --dry-run`, the command line and nightly runs.

Users: `cli/run.py`, `cli/tools.py`, `evaluation.py`, `nightly/night.py`, `nightly/repeats.py`,
`record/estimate.py`.
"""

import math
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.cases import EVALUATED
from sumo_eval.cosim.doors.controller import find_controller
from sumo_eval.cosim.doors.entry import made_absolute
from sumo_eval.drivers.recorded.exposure import exposure_of
from sumo_eval.errors import InputError, StoppedError, must_be
from sumo_eval.frozen import frozen
from sumo_eval.input_file import working_folder
from sumo_eval.method.point_criticality import exactly_hazardous
from sumo_eval.method.severity import severity_of
from sumo_eval.method.zone_training import own_axes
from sumo_eval.record import loops, run_folder
from sumo_eval.record.cases import Case
from sumo_eval.record.engines import refuse_engine, run_cases
from sumo_eval.record.given import entry_of
from sumo_eval.record.only import narrowed, points_only
from sumo_eval.record.points import choose_points, refuse_unknown_axes, scenario_weights
from sumo_eval.record.progress import Progress, Stopping, never, quiet
from sumo_eval.record.qualification import read_qualification
from sumo_eval.record.reads import UNKNOWN
from sumo_eval.record.recording import (
    Planner,
    Space,
    find_stale,
    planner,
    record,
    refuse_to_compare_with_discarded,
    refuse_to_lose_cases,
    stages,
)
from sumo_eval.record.scenario_files import hashes_of_scenario
from sumo_eval.record.spread import alongside
from sumo_eval.record.store import Store, open_store
from sumo_eval.record.trust import refuse_foreign_code, remember
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.file import check_points
from sumo_eval.scenario.formats import expanded
from sumo_eval.scenario.resolved import WHOLE, Resolved
from sumo_eval.scenario.road.table import check_line
from sumo_eval.scenario.sampling.adaptive import size_of_round
from sumo_eval.settings import AdsSettings, EvaluationSettings, ScenarioSettings
from sumo_eval.settings.config import (
    PAPER_EVALUATION,
    check_evaluation,
    read_evaluation,
    settings_from,
    to_plain,
    validated,
)
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.settings.toml_file import refuse_unfit
from sumo_eval.text import clean, shown

Evaluable = EvaluationSettings | Mapping[str, Any] | str | os.PathLike[str] | None
"""Settings, the content of their file as a dict, the path of such a file or of a run, or None: the
run's own when it is resumed, else the paper's.
"""


@frozen
class Recorded:
    """Number of drives in a run folder, and of cases of ADSs that were not evaluated.

    notes: sentences on recorded drivers, and on recorded cases that had to be rerun.
    """

    drives: int
    not_evaluated: int
    notes: tuple[str, ...] = ()


def resolve(
    evaluation: Evaluable, folder: Path, resume: bool, ads: Sequence[Any] = (), **changes: object
) -> Resolved:
    """An evaluation with its scenarios. If `run.only` names cases, it is reduced to their ADSs and
    scenarios.

    ads, changes: as in `settings_of`.

    Raises InputError if `report.axes` names a scenario that the evaluation does not have.
    """
    run = Resolved.of(*settings_of(evaluation, folder, resume, ads, **changes))
    refuse_unknown_axes(run.scenarios, run.settings.report)
    return narrowed(run)


def settings_of(
    evaluation: Evaluable, folder: Path, resume: bool, ads: Sequence[Any] = (), **changes: object
) -> tuple[EvaluationSettings, Path]:
    """Settings of an evaluation, and the folder where their relative paths start.

    ads: locators, classes, functions or objects instead of the evaluation's ADSs; relative paths of
        locators start in the current folder.
    changes: values of `[run]` by name, instead of the evaluation's; None changes nothing.
    """
    current_folder = working_folder()
    settings, source = _read(evaluation, folder, resume, not ads)
    for locator in ads:
        # A program that does not exist is refused here. Below it is too late: `made_absolute` puts
        # `env -C` in front of the command, and `env` always exists.
        if isinstance(locator, str) and locator.startswith(("exec:", "traci:")):
            find_controller(locator, current_folder)
    if ads:
        entries = (
            AdsSettings(it, made_absolute(it, current_folder))
            if isinstance(it, str)
            else entry_of(it, folder, resume=resume)
            for it in ads
        )
        settings = replace(settings, ads=tuple(entries))
        for entry in settings.ads:  # the run's own file must hold it, with the path of its folder
            refuse_unfit(entry.controller, "The path of an ADS")
    check_evaluation(settings, "`ads`" if ads else "the evaluation")
    changed = {name: value for name, value in changes.items() if value is not None}
    return replace(
        settings,
        scenario=expanded(settings.scenario, source),
        run=replace(settings.run, **changed),  # type: ignore[arg-type]
    ), source


def _read(
    evaluation: Evaluable, folder: Path, resume: bool, own_ads: bool
) -> tuple[EvaluationSettings, Path]:
    """Settings of an evaluation as written, and the folder where their paths start.

    own_ads: whether its ADSs are used.
    """
    if isinstance(evaluation, EvaluationSettings):
        # as a file would have them: numbers of numpy become Python's
        return validated(to_plain(evaluation), EvaluationSettings, "the evaluation"), Path.cwd()
    if isinstance(evaluation, Mapping):
        content = _with_locators(evaluation, folder, resume)
        return settings_from(content, "the evaluation", own_ads=own_ads), Path.cwd()
    if evaluation is not None:
        path = Path(evaluation)
    elif resume and not folder.exists():
        raise InputError(f"{folder} does not exist: there is no run to resume.")
    else:
        path = folder if resume and run_folder.is_run(folder) else PAPER_EVALUATION
    if not run_folder.is_run(path):
        return read_evaluation(path, own_ads=own_ads), path.parent.resolve()
    settings = read_evaluation(path / run_folder.EVALUATION)
    source = run_folder.source_of(path)
    refuse_foreign_code(path, settings, source, driving=True)
    return settings, source


def _with_locators(evaluation: Mapping[str, Any], folder: Path, resume: bool) -> dict[str, Any]:
    """An evaluation as a dict, in which a locator replaces each class, function or object that is a
    controller. A missing controller stays missing: `settings_from` reports it.
    """
    content = dict(evaluation)
    if isinstance(content.get("ads"), list | tuple):
        content["ads"] = [
            {**entry, "controller": entry_of(entry["controller"], folder, resume=resume).controller}
            if isinstance(entry, Mapping) and not isinstance(entry.get("controller", ""), str)
            else entry
            for entry in content["ads"]
        ]
    return content


def record_facts(
    run: Resolved,
    folder: Path,
    *,
    resume: bool = False,
    progress: Progress = quiet,
    stopping: Stopping = never,
    another_round: bool = False,
    meanwhile: Callable[[], object] | None = None,
) -> Recorded:
    """Simulate the drives of an evaluation, or of its shard, that a run folder lacks.

    another_round: whether this process began or resumed the run earlier, and now adds a round of
        points.
    meanwhile: work that another process does while cases are driven. If the work fails, driving
        stops, and this process repeats the work to raise its error.

    Raises StoppedError after `stopping` returned true, or after Ctrl-C; recorded cases are kept,
    and `resume` continues.
    """
    settings, source = run.settings, run.source
    # checks that need no simulation come first
    for entry in settings.scenario:
        if entry.sampling.method == "adaptive" and run.shard != WHOLE:
            raise InputError(
                f"Scenario `{entry.use}` is sampled in rounds (`adaptive`), each chosen by the "
                "results of all cases before: it cannot be recorded in shards. More machines share "
                "its cases with `--engine dask`."
            )
    severity_of(settings.method.collision, source)
    refuse_engine(settings.run)
    run_folder.refuse_foreign(folder, resume)
    if settings.run.qualification and not run_folder.is_run(folder):
        read_qualification(settings.run.qualification, source)
    plan, spaces = planned(run, progress)
    compile_loops(settings, spaces, progress)
    with (
        run_folder.only_writer(folder, resume=resume),
        _filled_folder(folder, run, spaces, plan, another_round=another_round) as store,
    ):
        remember(folder, settings, source)
        # of recorded drivers, and of ADSs whose files have changed
        notes = (*plan.notes, *find_stale(store, source))
        store.remove_stale()
        store.unseal()
        try:
            _record_alongside(meanwhile, spaces, plan, store, progress, stopping)
        except (StoppedError, KeyboardInterrupt):
            raise StoppedError(
                f"Stopped. {_counted(store).drives} drives are recorded in {folder}; the same "
                f"command with --out {shlex.quote(str(folder))} --resume continues."
            ) from None
        store.seal()
        return replace(_counted(store), notes=notes)


def planned(
    run: Resolved, progress: Progress = quiet, looked_at: int | None = None
) -> tuple[Planner, list[Space]]:
    """The cases of an evaluation, and the points of every scenario with their zones.

    looked_at: as in `space_of`.

    Raises InputError for a mistake, before anything is compiled or driven.
    """
    for name, logical in run.scenarios.items():
        road = logical.road
        vehicle = run.settings.simulation.vehicle
        check_line(road.line, road.lanes, road.lane_width, f"scenario `{name}`", vehicle)
        own_axes(logical)  # for its refusal of spaces whose zones cannot be learnt
    plan = planner(run)
    progress("controllers checked", len(plan.identities), len(plan.identities))
    return plan, _spaces(run, progress, looked_at)


def compile_loops(
    settings: EvaluationSettings, spaces: Sequence[Space], progress: Progress = quiet
) -> None:
    """Compile the loops that an evaluation needs and this machine has not compiled yet.

    One point of a scenario shows whether its actors react (`lively`).
    """
    loops.ready(
        loops.of_evaluation(settings) | {loops.PLAYED for space in spaces if _middle(space).lively},
        progress,
    )


@contextmanager
def _filled_folder(
    folder: Path,
    run: Resolved,
    spaces: Sequence[Space],
    plan: Planner | None = None,
    *,
    another_round: bool = False,
    driven: run_folder.Manifest | None = None,
) -> Iterator[Store]:
    """Context with the store of a run folder, whose other files are written and whose shard is
    noted.

    plan: of a run that may continue; None: a new run.
    another_round, driven: as in `run_folder.create`.

    Raises InputError if the run in the folder cannot continue as this one, before a file changes.
    """
    shard = "{}/{}".format(*run.shard)
    if plan is not None and run_folder.is_run(folder):
        with open_store(folder, create=True, checked=True) as store:
            if (before := store.noted(run_folder.SHARD)) not in ("", shard):
                raise InputError(
                    f"Run {folder} is shard {before}; it cannot continue as shard {shard}."
                )
            refuse_to_lose_cases(store, spaces, run.settings, folder)
            find_stale(store, run.source)  # `store.holds` is False for cases of stale ADSs
            refuse_to_compare_with_discarded(store, spaces, plan, folder)
    examples = map(_middle, spaces)
    run_folder.create(
        folder, run.settings, run.source, examples, another_round=another_round, driven=driven
    )
    run_folder.write_exposures(folder, {space.logical.name: space.exposure for space in spaces})
    with open_store(folder, create=True) as store:
        store.note(run_folder.SHARD, shard)
        yield store


def _record_alongside(
    meanwhile: Callable[[], object] | None,
    spaces: Sequence[Space],
    plan: Planner,
    store: Store,
    progress: Progress,
    stopping: Stopping,
) -> None:
    """Record drives while another process does the work `meanwhile`. A failure of that work must
    not lose recorded drives.

    The engine `serial` has no other process: this process does `meanwhile` first.
    """
    if meanwhile is not None:
        if plan.run.settings.run.engine != "serial":
            with alongside(meanwhile) as failed:
                try:
                    record(spaces, plan, store, progress, lambda: stopping() or failed())
                except StoppedError:
                    if stopping() or not failed():
                        raise
            if not failed():
                return
        # Repeated here after a failure, `meanwhile` raises its error. If it raises none, its
        # process was lost by chance, and recording continues.
        meanwhile()
    record(spaces, plan, store, progress, stopping)


def in_rounds(run: Resolved, folder: Path | None) -> Resolved:
    """An evaluation in which every adaptive sample has its number of points per round, and the
    rounds that the run in the folder has already chosen.

    A sample keeps these rounds only if nothing but its end (`count`, `until`) has changed.

    folder: of a run to resume; None: a new run.
    """
    recorded = {}  # sampling of each scenario of the run in the folder
    if folder is not None and run_folder.is_run(folder):
        entries = read_evaluation(folder / run_folder.EVALUATION).scenario
        recorded = {entry.use: entry.sampling for entry in entries}

    def with_rounds(entry: ScenarioSettings) -> ScenarioSettings:
        sampling = entry.sampling
        earlier = recorded.get(entry.use)
        if sampling.method != "adaptive" or sampling.count is None:
            return entry
        if earlier is not None and not sampling.rounds:
            continued = replace(sampling, round=earlier.round, rounds=earlier.rounds)
            with_new_end = replace(earlier, count=sampling.count, until=sampling.until)
            # both are equal if nothing but the end of the sample differs from the recorded run
            if sampling.round in (None, earlier.round) and with_new_end == continued:
                return replace(entry, sampling=continued)
        size = size_of_round(
            sampling.count, sampling.round, f"the sampling of scenario `{entry.use}`"
        )
        return replace(entry, sampling=replace(sampling, round=size))

    scenario = tuple(map(with_rounds, run.settings.scenario))
    return replace(run, settings=replace(run.settings, scenario=scenario))


def merge(shards: Sequence[Path], out: Path) -> Recorded:
    """Put all shards of an evaluation together into a new run folder."""
    settings = run_folder.read_settings(shards[0])
    manifest = run_folder.read_manifest(shards[0])
    exposures = run_folder.read_exposures(shards[0])
    numbers = [_shard_of(folder, shards[0], settings, manifest, exposures) for folder in shards]
    _, count = numbers[0]
    folders: dict[int, Path] = {}  # by number of the shard
    for folder, (number, its_count) in zip(shards, numbers, strict=True):
        if its_count != count:
            raise InputError(f"{folder} is shard {number}/{its_count}, among shards of {count}.")
        if number in folders:
            raise InputError(f"{folder} and {folders[number]} are both shard {number}/{count}.")
        folders[number] = folder
    missing = [f"{number}/{count}" for number in range(1, count + 1) if number not in folders]
    if missing:
        raise InputError(
            f"To merge, every shard of {count} must be there; missing: {', '.join(missing)}."
        )
    run = Resolved.of(settings, Path(manifest["source_folder"]))
    driven = run_folder.manifest_of_shards(folders.values())
    with (
        run_folder.only_writer(out, resume=False),
        _filled_folder(out, run, _spaces(run), driven=driven) as store,
    ):
        # the merged run is trusted only if every shard is
        if run_folder.trust_own_runs(*shards):
            remember(out, settings, run.source)
        for shard in sorted(folders):
            store.take_over(folders[shard])
        # of the scenarios as they were driven: their files may have changed since
        run_folder.write_exposures(out, exposures)
        store.seal()
        # of each ADS one file of which the shards have read different versions
        changed = {ads: file for ads, file, digest in store.files_read() if digest == UNKNOWN}
        notes = (
            f"ADS `{clean(ads)}` may have driven with more than one version of {clean(file)}: its "
            "scores would mix them."
            for ads, file in changed.items()
        )
        return replace(_counted(store), notes=tuple(notes))


def _shard_of(
    folder: Path,
    first: Path,
    settings: EvaluationSettings,
    manifest: Mapping[str, Any],
    exposures: Mapping[str, Any],
) -> tuple[int, int]:
    """Number and count of a complete shard, refused unless it is of the same evaluation, files and
    versions as the first.

    settings, manifest, exposures: of the first.
    """
    other = run_folder.read_settings(folder)
    own = run_folder.read_manifest(folder)
    versions = run_folder.versions_of(own)
    first_versions = run_folder.versions_of(manifest)
    # of `[run]`, `only` alone is compared: it chooses the cases
    if replace(other, run=replace(settings.run, only=other.run.only)) != settings:
        raise InputError(
            f"{folder} is of another evaluation than {first}; only shards of one can be merged."
        )
    for name in ("sumo_eval", "libsumo"):
        if versions[name] != first_versions[name]:
            raise InputError(f"{folder} was made with another version of {name} than {first}.")
    # runs of earlier versions have no "files"
    if own.get("files") != manifest.get("files") or run_folder.read_exposures(folder) != exposures:
        raise InputError(
            f"{folder} was made with other files of scenarios or recordings than {first}: they "
            "were changed in between. Record one of the two again."
        )
    with open_store(folder) as store:
        run_folder.refuse_incomplete(store, folder)
        if store.discarded_size:
            raise InputError(
                f"To be merged, {folder} must have all trajectories; some were discarded after it "
                "was scored (`[run] keep`). It is a whole run, which can be used as it is."
            )
        return parse_shard(store.noted(run_folder.SHARD))


def parse_shard(text: str) -> tuple[int, int]:
    """`2/8`: the second of eight."""
    first, _, last = text.partition("/")
    # `float`, because `int` raises ValueError for thousands of digits
    if first.isdecimal() and last.isdecimal() and 1 <= float(first) <= float(last) < 1e9:
        return int(first), int(last)
    raise InputError(
        f"A shard must have the form i/n with 1 <= i <= n, e.g. 2/8, got {shown(text)}."
    )


def verify(
    folder: Path, share: float, *, workers: int | None = None, progress: Progress = quiet
) -> tuple[int, list[tuple[str, str]]]:
    """Simulate a share of a run's drives again.

    Returns the number of chosen drives, and case and reason of each that is not the same to the
    bit.
    """
    if not 0.0 < share <= 1.0:  # refuses nan, too
        raise must_be("`share`", "`verify`", "above 0, at most 1", share)
    # Refuses a folder that is not a run. `resolve` would not: it uses the paper's evaluation.
    run_folder.read_settings(folder)
    run = resolve(None, folder, resume=True, workers=workers, engine="processes")
    plan = planner(run)
    with open_store(folder) as store:
        run_folder.refuse_incomplete(store, folder)
        shard = parse_shard(store.noted(run_folder.SHARD) or "1/1")
        find_stale(store, run.source)  # `store.holds` is False for a stale ADS
        chosen = _draw(replace(run, shard=shard), plan, share)
        held = [case for case in chosen if store.holds(case)]
        why = "it depends on what has changed since: ADS, scenario, simulator or this package"
        differences = [(case.key, why) for case in chosen if not store.holds(case)]
        for done, outcome in enumerate(run_cases(held, plan.setup), 1):
            if difference := store.difference(outcome):
                differences.append((outcome.case.key, f"it is not the same again: {difference}"))
            progress("drives simulated again", done, len(held), len(differences))
    return len(chosen), differences


def _draw(run: Resolved, plan: Planner, share: float) -> list[Case]:
    """A share of a run's cases, drawn by its seed: at least one of each role in each scenario."""
    stream = random_stream(run.settings.seed, "verify")
    drawn: list[Case] = []
    for space in _spaces(run):
        for stage in stages(space, plan):
            cases = list(stage.cases)
            picked = stream.permutation(len(cases))[: math.ceil(share * len(cases))]
            drawn += [cases[index] for index in sorted(picked)]
    return drawn


def _spaces(run: Resolved, progress: Progress = quiet, looked_at: int | None = None) -> list[Space]:
    """The points of every scenario, with their zones."""
    spaces = []
    for number in range(len(run.scenarios)):
        spaces.append(space_of(run, number, looked_at))
        progress("zones", len(spaces), len(run.scenarios))
    # called for its refusals: without them scoring would refuse the weights after hours of driving
    scenario_weights(list(run.scenarios), run.settings.method.ranking)
    return spaces


def space_of(run: Resolved, number: int, looked_at: int | None = None) -> Space:
    """The points of one scenario of an evaluation, with their zones; a shard does every n-th.

    number: of the scenario in the evaluation.
    looked_at: most points to check and classify as safe or hazardous, evenly spread; each stands
        for those up to the next one. None: all points.

    Raises InputError for a scenario that is impossible to run at any of its points.
    """
    settings = run.settings
    entry, logical = list(run.entries)[number]
    exposure = exposure_of(logical, entry.exposure, settings.drivers, run.source)
    points = choose_points(logical, entry, run.source, settings, exposure.density)
    total = len(points.points)
    every = 1 if looked_at is None else math.ceil(total / looked_at)
    check_points(logical, points.points[::every])
    hazardous = exactly_hazardous(logical, points.points[::every], settings.method.zones)
    index, count = run.shard
    # Shards take turns over the points. The first point of each scenario goes to another shard:
    # otherwise scenarios with few points would fill the first shards only.
    share = range((index - 1 - number) % count, total, count)
    return Space(
        logical,
        points.points,
        np.repeat(hazardous, every)[:total],
        points_only(share, settings, logical.name, total),
        points.exposure,
        exposure.plain(points.points) | hashes_of_scenario(entry.use, run.source),
    )


def _middle(space: Space) -> ConcreteScenario:
    """The concrete scenario in the middle of the sample, the example that the run folder keeps for
    sumo-gui.
    """
    return space.concrete(len(space.points) // 2)


def _counted(store: Store) -> Recorded:
    drives = not_evaluated = 0
    for count in store.counts():
        drives += count.drives
        if count.role == "ads" and count.status not in EVALUATED:
            not_evaluated += count.drives
    return Recorded(drives, not_evaluated)
