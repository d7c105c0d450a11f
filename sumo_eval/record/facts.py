"""The recording half of an evaluation: plan its cases, simulate them into a run folder, resume,
merge, verify.
"""

from __future__ import annotations

import math
import os
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice, zip_longest
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from sumo_eval.cases import EVALUATED
from sumo_eval.cosim.doors.controller import find_controller
from sumo_eval.cosim.doors.entry import made_absolute
from sumo_eval.drivers.recorded.exposure import exposure_of
from sumo_eval.errors import InputError, StoppedError
from sumo_eval.method.severity import severity_of
from sumo_eval.method.zone_partition import exactly_hazardous, refuse_impossible_zones
from sumo_eval.record import loops, run_folder
from sumo_eval.record.cases import Case, Role, Setup
from sumo_eval.record.claims import OURS, home
from sumo_eval.record.engines import refuse_engine, run_cases
from sumo_eval.record.given import entry_of
from sumo_eval.record.only import narrowed, points_only
from sumo_eval.record.points import Resolved, choose_points, scenario_weights
from sumo_eval.record.progress import Progress, Stopping, never, quiet
from sumo_eval.record.qualification import read_qualification
from sumo_eval.record.recording import (
    Planner,
    Space,
    find_stale,
    planner,
    record,
    refuse_to_lose_cases,
    stages,
)
from sumo_eval.record.spread import beside
from sumo_eval.record.store import Store, open_store
from sumo_eval.record.trust import refuse_foreign_code, remember
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.file import check_points
from sumo_eval.scenario.formats import expanded
from sumo_eval.scenario.road.table import check_line
from sumo_eval.scenario.sampling.adaptive import size_of_round
from sumo_eval.settings import AdsSettings, EvaluationSettings, RunSettings, ScenarioSettings
from sumo_eval.settings.config import (
    PAPER_EVALUATION,
    check_evaluation,
    read_evaluation,
    settings_from,
)
from sumo_eval.settings.random_streams import random_stream

Evaluable = EvaluationSettings | Mapping[str, Any] | str | os.PathLike[str] | None
"""Settings, what a file of them holds as a dict, the path of such a file or of a run, or None: the
run's own when it is resumed, else the paper's.
"""

WHOLE = (1, 1)
_TIMED = 32  # drives of a kind that an estimate times, at most
_A_KIND_FOR = 1.0  # s, where a user's ADS drives
_TIMED_FOR = 2.0  # s for all kinds; the drive that runs then is the last one
_LONGEST_DRIVE = 3.0  # s; a longer one is broken off
_KINDS = 12  # ADSs that are loaded and timed, and pairs of ADS and scenario, at most
_SORTS = {"ads": "ADSs", "references": "references", "humans": "human drivers"}
_LOOKED_AT = 2_000  # points that an estimate looks at, of each scenario, at most


@dataclass(frozen=True, slots=True)
class Recorded:
    """Contents of a run folder: drives by all, and those among them without an outcome that
    counts.

    notes: sentences on what was recorded before and had to be rerun.
    """

    folder: Path
    drives: int
    not_evaluated: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Estimate:
    """Cost of an evaluation: drives of ADSs, humans and references, those recorded already,
    s of wall time.

    references: drives of the ideal vehicle, of `no_reaction` and of the reference car, one each at
        every point.
    loaded: how many ADSs of how many.
    untimed: sorts of drives that take what the others took.
    broken_off: whether a drive took longer than all that is to be timed.
    """

    ads: int
    humans: int
    references: int
    recorded: int
    seconds: float
    timed: int
    workers: int
    loaded: tuple[int, int]
    untimed: tuple[str, ...]
    broken_off: bool

    def __str__(self) -> str:
        done = f"; {self.recorded} of them are recorded already" if self.recorded else ""
        minutes, seconds = divmod(round(self.seconds), 60)
        time = f"{minutes} min {seconds} s" if minutes else f"{self.seconds:.1f} s"
        many, timed = "s" * (self.workers > 1), f"{self.timed} drive{'s' * (self.timed > 1)}"
        return (
            f"{self.ads} drives of the ADSs, {self.humans} of human drivers and {self.references} "
            "of the "
            f"references{done}.\nAbout {time} with {self.workers} worker{many}, estimated from "
            f"{timed} timed now, for "
            f"{_TIMED_FOR:g} s at most; scoring takes additional time.{self._not_looked_at}"
        )

    @property
    def _not_looked_at(self) -> str:
        some, all_of_them = self.loaded
        ads = (
            f"\n{some} of the {all_of_them} ADSs were loaded and timed; a run loads them all."
            if some < all_of_them
            else ""
        )
        sorts = " and ".join(self.untimed)
        others = (
            f"\nDrives of the {sorts} were not timed: they count as the others." if sorts else ""
        )
        late = (
            f"\nA drive was broken off after {_LONGEST_DRIVE:g} s: the run takes longer than that."
        )
        least = late if self.broken_off else ""
        return f"{ads}{others}{least}"


def resolve(
    evaluation: Evaluable, folder: Path, resume: bool, ads: Sequence[Any] = (), **changes: object
) -> tuple[EvaluationSettings, Path]:
    """The settings, with those `changes` of `run` that are not None, and the folder where their
    paths start.

    ads: locators, classes, functions or objects in place of the evaluation's ADSs; relative paths
        of locators start in the current folder.
    """
    if isinstance(evaluation, EvaluationSettings):
        settings, source = evaluation, Path.cwd()
    elif isinstance(evaluation, Mapping):
        content = _with_locators(evaluation, folder, resume)
        settings, source = settings_from(content, "the evaluation", own_ads=not ads), Path.cwd()
    elif (run := _run_of(evaluation, folder, resume)) is not None:
        settings, source = read_evaluation(run / run_folder.EVALUATION), run_folder.source_of(run)
        refuse_foreign_code(run, settings, source, driving=True)
    else:
        path = PAPER_EVALUATION if evaluation is None else Path(evaluation)
        settings, source = read_evaluation(path, own_ads=not ads), path.parent.resolve()
    for locator in ads:
        # `env -C` exists, whatever it runs
        if isinstance(locator, str) and locator.startswith(("exec:", "traci:")):
            find_controller(locator, Path.cwd())
    if ads:
        entries = tuple(_entry(one, folder, resume) for one in ads)
        settings = replace(settings, ads=entries)
    check_evaluation(settings, "`ads`" if ads else "the evaluation")
    settings = replace(settings, scenario=expanded(settings.scenario, source))
    given = {name: value for name, value in changes.items() if value is not None}
    settings = replace(settings, run=replace(settings.run, **given))  # type: ignore[arg-type]
    return narrowed(settings, source), source


def _run_of(evaluation: str | os.PathLike[str] | None, folder: Path, resume: bool) -> Path | None:
    """The run whose own evaluation is meant: the one to resume, or one that is named in place
    of a file.
    """
    named = Path(evaluation) if evaluation is not None else folder if resume else None
    return named if named is not None and run_folder.is_run(named) else None


def _entry(ads: Any, folder: Path, resume: bool) -> AdsSettings:
    """The entry of an ADS that is named or given in place of the evaluation's."""
    if isinstance(ads, str):
        return AdsSettings(ads, made_absolute(ads, Path.cwd()))
    return entry_of(ads, folder, resume=resume)


def _with_locators(evaluation: Mapping[str, Any], folder: Path, resume: bool) -> dict[str, Any]:
    """An evaluation as a dict with a locator instead of each controller that is given as it
    is.
    """
    content = dict(evaluation)
    entries = content.get("ads", ())
    if isinstance(entries, list | tuple):
        content["ads"] = [
            {**one, "controller": entry_of(one["controller"], folder, resume=resume).controller}
            if isinstance(one, Mapping) and not isinstance(one.get("controller", ""), str)
            else one
            for one in entries
        ]
    return content


def record_facts(
    evaluation: EvaluationSettings,
    source: Path,
    folder: Path,
    *,
    resume: bool = False,
    shard: tuple[int, int] = WHOLE,
    progress: Progress = quiet,
    stopping: Stopping = never,
    another_round: bool = False,
    meanwhile: Callable[[], object] | None = None,
) -> Recorded:
    """Simulate an evaluation, or its share number i of n (`shard`), into a run folder, or what is
    missing there.

    another_round: whether this adds points to what the caller has recorded there just now.
    meanwhile: what a process of its own does while cases are driven; driving ends where that fails,
        with what it then says in this one.
    Raises StoppedError after `stopping` returned true, or after Ctrl-C; what was done by then is
    kept, and `resume` continues.
    """
    if shard != WHOLE:
        _refuse_rounds_in_shards(evaluation)
    severity_of(evaluation.method.collision, source)
    refuse_engine(evaluation.run)
    if evaluation.run.qualification and not run_folder.is_run(folder):
        read_qualification(evaluation.run.qualification, source)
    _check_scenarios(evaluation, source)
    loops.ready(loops.of_evaluation(evaluation), progress)
    # a misspelt controller must not be found out after an hour of simulation
    plan = planner(evaluation, source)
    progress("controllers checked", len(plan.identities), len(plan.identities))
    spaces = _spaces(evaluation, source, shard, progress)
    if any(_middle(space).lively for space in spaces):
        loops.ready([loops.PLAYED], progress)
    with (
        run_folder.only_writer(folder, resume=resume),
        _begun(folder, evaluation, source, spaces, another_round=another_round) as store,
    ):
        remember(folder, evaluation, source)
        _check_shard(store, shard, folder)
        refuse_to_lose_cases(store, spaces, evaluation, folder)
        notes = find_stale(store, source)
        store.unseal()
        store.note(run_folder.SHARD, f"{shard[0]}/{shard[1]}")
        try:
            _record_beside(meanwhile, spaces, plan, store, progress, stopping)
        except (StoppedError, KeyboardInterrupt):
            raise StoppedError(
                f"Stopped. {_counted(store, folder).drives} drives are recorded in {folder}; "
                "the same command with --resume continues."
            ) from None
        store.seal()
        return replace(_counted(store, folder), notes=notes)


@contextmanager
def _begun(
    folder: Path,
    settings: EvaluationSettings,
    source: Path,
    spaces: Sequence[Space],
    *,
    another_round: bool = False,
) -> Iterator[Store]:
    """The store of a run folder that is filled with its other files."""
    run_folder.create(
        folder, settings, source, [_middle(space) for space in spaces], another_round=another_round
    )
    run_folder.write_exposures(folder, {space.logical.name: space.exposure for space in spaces})
    with open_store(folder / run_folder.FACTS, create=True) as store:
        yield store


def _record_beside(
    meanwhile: Callable[[], object] | None,
    spaces: Sequence[Space],
    plan: Planner,
    store: Store,
    progress: Progress,
    stopping: Stopping,
) -> None:
    """Record while a process of its own does something else.

    An hour of driving must not end in its mistake.

    The engine `serial` has no other process: there it is done first.
    """
    if meanwhile is None or plan.settings.run.engine == "serial":
        if meanwhile is not None:
            meanwhile()
        record(spaces, plan, store, progress, stopping)
        return
    with beside(meanwhile) as failed:
        try:
            record(spaces, plan, store, progress, lambda: stopping() or failed())
        except StoppedError:
            if stopping() or not failed():
                raise
    if failed():
        meanwhile()
        # what is missing, where only the process was lost
        record(spaces, plan, store, progress, stopping)


def _check_scenarios(evaluation: EvaluationSettings, source: Path) -> None:
    """Tell a misspelt scenario, and a curve too tight for the ego's steering, before anything is
    compiled or driven.
    """
    for name, logical in Resolved.of(evaluation, source).scenarios.items():
        road = logical.road
        check_line(
            road.line,
            road.lanes,
            road.lane_width,
            f"scenario `{name}`",
            evaluation.simulation.vehicle,
        )


def in_rounds(settings: EvaluationSettings, folder: Path | None) -> EvaluationSettings:
    """The settings with how many points a round of each adaptive sample has, and the rounds that a
    run to resume has chosen already by the same rules.
    """
    before = {}
    if folder is not None and run_folder.is_run(folder):
        before = {
            entry.use: entry.sampling
            for entry in read_evaluation(folder / run_folder.EVALUATION).scenario
        }

    def filled(entry: ScenarioSettings) -> ScenarioSettings:
        mine, its = entry.sampling, before.get(entry.use)
        if mine.method != "adaptive" or mine.count is None:
            return entry
        if its is not None and not mine.rounds:
            known = replace(mine, round=its.round, rounds=its.rounds)
            if (
                mine.round in (None, its.round)
                and replace(its, count=mine.count, until=mine.until) == known
            ):
                return replace(entry, sampling=known)
        size = size_of_round(mine.count, mine.round, f"the sampling of scenario `{entry.use}`")
        return replace(entry, sampling=replace(mine, round=size))

    return replace(settings, scenario=tuple(filled(entry) for entry in settings.scenario))


def _refuse_rounds_in_shards(settings: EvaluationSettings) -> None:
    for entry in settings.scenario:
        if entry.sampling.method == "adaptive":
            raise InputError(
                f"Scenario `{entry.use}` is sampled in rounds (`adaptive`), each chosen by what "
                "all cases of those "
                "before came to: it cannot be recorded in shards. More machines share its cases "
                "with `--engine dask`."
            )


def merge(shards: Sequence[Path], out: Path) -> Recorded:
    """Put all shards of an evaluation together into a new run folder."""
    settings, manifest = run_folder.read_settings(shards[0]), run_folder.read_manifest(shards[0])
    found: dict[tuple[int, int], Path] = {}
    for folder in shards:
        other, its = run_folder.read_settings(folder), run_folder.read_manifest(folder)
        if replace(other, run=RunSettings()) != replace(settings, run=RunSettings()):
            raise InputError(
                f"{folder} is of another evaluation than {shards[0]}; only shards of one can be "
                "merged."
            )
        for name in ("sumo_eval", "libsumo"):
            if its["versions"][name] != manifest["versions"][name]:
                raise InputError(
                    f"{folder} was made with another version of {name} than {shards[0]}."
                )
        with open_store(folder / run_folder.FACTS) as store:
            if not store.sealed:
                raise InputError(
                    f"Shard {folder} is not complete; go on with: sumo-eval run --out {folder} "
                    "--resume."
                )
            shard = parse_shard(store.noted(run_folder.SHARD))
        if shard in found:
            raise InputError(f"{folder} and {found[shard]} are both shard {shard[0]}/{shard[1]}.")
        found[shard] = folder
    count = max(n for _, n in found)
    missing = [f"{i}/{count}" for i in range(1, count + 1) if (i, count) not in found]
    if missing or len(found) != count:
        raise InputError(
            f"To merge, every shard of {count} must be there; missing: {', '.join(missing)}."
        )
    source = Path(manifest["source_folder"])
    with run_folder.only_writer(out, resume=False):
        spaces = _spaces(settings, source, WHOLE)
        with _begun(out, settings, source, spaces) as store:
            if run_folder.give_what_is_own(*shards):
                remember(out, settings, source)
            for shard in sorted(found):
                store.take_over(found[shard] / run_folder.FACTS)
            store.note(run_folder.SHARD, "1/1")
            store.seal()
            return _counted(store, out)


def parse_shard(text: str) -> tuple[int, int]:
    """`2/8`: the second of eight."""
    first, slash, last = text.partition("/")
    if slash and first.isdecimal() and last.isdecimal() and 1 <= int(first) <= int(last):
        return int(first), int(last)
    raise InputError(f"A shard must have the form i/n with 1 <= i <= n, e.g. 2/8, got {text!r}.")


def verify(
    folder: Path, share: float, *, workers: int | None = None, progress: Progress = quiet
) -> tuple[int, list[str]]:
    """Simulate a share of a run's drives again: how many, and a sentence for each that is not the
    same to the bit.
    """
    settings, source = resolve(None, folder, resume=True, workers=workers, engine="processes")
    run_folder.read_settings(folder)
    plan = planner(settings, source)
    with open_store(folder / run_folder.FACTS) as store:
        shard = parse_shard(store.noted(run_folder.SHARD) or "1/1")
        find_stale(store, source)
        chosen = _chosen(store, plan, _spaces(settings, source, shard), share, settings.seed)
        changed = [case.key for case in chosen if not store.holds(case)]
        differences = [
            f"{key} depends on something that has changed since: the ADS, the simulator or this "
            "package."
            for key in changed
        ]
        same = [case for case in chosen if case.key not in set(changed)]
        for done, (case, difference) in enumerate(drive_again(same, plan.setup, store), start=1):
            if difference:
                differences.append(f"{case.key} is not the same again: {difference}.")
            progress("drives simulated again", done, len(same), len(differences))
    return len(chosen), differences


def drive_again(cases: Sequence[Case], setup: Setup, store: Store) -> Iterator[tuple[Case, str]]:
    """Each case, simulated once more, and where that differs from what is recorded: empty where it
    is the same.
    """
    with open_store(Path(":memory:"), create=True) as again:
        for outcome in run_cases(cases, setup):
            key, whole = outcome.case.key, not store.is_discarded(outcome.case.key)
            again.add(outcome)
            same = again.drive(key, whole=whole) == store.drive(key, whole=whole)
            yield outcome.case, "" if same else store.difference(key, again)
            again.remove([key])


def estimate(
    evaluation: EvaluationSettings, source: Path, folder: Path | None, shard: tuple[int, int]
) -> Estimate:
    """How many drives an evaluation takes, and how long: timed on points from all over each
    scenario.

    Of points chosen in rounds all that there may be count, as if one round had them.
    """
    entries = tuple(
        replace(entry, sampling=replace(entry.sampling, round=entry.sampling.count, rounds=()))
        if entry.sampling.method == "adaptive" and folder is None
        else entry
        for entry in evaluation.scenario
    )
    evaluation = replace(evaluation, scenario=entries)
    refuse_engine(evaluation.run)
    _check_scenarios(evaluation, source)
    loops.ready(loops.of_evaluation(evaluation))
    # what is recorded is told by all of them
    every = -(-len(evaluation.ads) // _KINDS) if folder is None else 1
    some = replace(evaluation, ads=evaluation.ads[::every])
    plan = planner(some, source)
    spaces = _spaces(evaluation, source, shard, looked_at=_LOOKED_AT)
    for space in spaces:
        refuse_impossible_zones(space.logical, evaluation.method.zones)  # a run would end there
    recorded = 0
    if folder is not None and (folder / run_folder.FACTS).is_file():
        with open_store(folder / run_folder.FACTS) as store:
            find_stale(store, source)
            recorded = sum(
                store.holds(case)
                for space in spaces
                for kind in stages(space, plan)
                for case in kind.cases
            )
    drives, kinds = dict.fromkeys(_SORTS, 0), {sort: list[list[Case]]() for sort in _SORTS}
    for space in spaces:
        for kind in stages(space, replace(plan, settings=evaluation)):
            drives[_sort(kind.role)] += kind.total
        for kind in stages(_some(space), plan):
            if kind.role != "ads":
                kinds[_sort(kind.role)].append(list(islice(kind.cases, _TIMED)))
    driven = [(space, one) for space in spaces for one in some.ads]
    for space, one in driven[:: -(-len(driven) // _KINDS)]:
        alone = replace(plan, settings=replace(some, ads=(one,)))
        kinds["ads"].append(list(islice(alone.ads(_some(space)), _TIMED)))
    setup = replace(plan.setup, run=replace(plan.setup.run, workers=1, engine="processes"))
    took, timed, broken_off = _seconds_a_drive(kinds, setup)
    usual = fmean(took.values()) if took else 0.0
    seconds = sum(number * took.get(sort, usual) for sort, number in drives.items())
    workers = evaluation.run.workers
    return Estimate(
        **drives,
        recorded=recorded,
        seconds=seconds * (1.0 - recorded / max(sum(drives.values()), 1)) / workers,
        timed=timed,
        workers=workers,
        loaded=(len(some.ads), len(evaluation.ads)),
        untimed=tuple(
            _SORTS[sort] for sort, number in drives.items() if number and sort not in took
        ),
        broken_off=broken_off,
    )


def _sort(role: Role) -> str:
    return {"ads": "ads", "human": "humans"}.get(role, "references")


def _some(space: Space) -> Space:
    """A space of at most `_TIMED` of the points to do, from one end to the other."""
    numbers = list(space.numbers[:: -(-len(space.numbers) // _TIMED)]) if space.numbers else []
    return replace(
        space,
        points=space.points[numbers],
        hazardous=space.hazardous[numbers],
        weights=space.weights[numbers],
        numbers=range(len(numbers)),
    )


def _seconds_a_drive(
    kinds: Mapping[str, Sequence[Sequence[Case]]], setup: Setup
) -> tuple[dict[str, float], int, bool]:
    """Wall time of a drive of each sort that was reached, by how many drives, and whether one was
    broken off.

    kinds: cases by sort, of which each gets its turn, for `_TIMED_FOR`.
    """
    until, timed, late = clock.perf_counter() + _TIMED_FOR, 0, False
    took: dict[str, list[float]] = {}
    turns = zip_longest(
        *([(sort, cases) for cases in some if cases] for sort, some in kinds.items())
    )
    for sort, cases in (kind for turn in turns for kind in turn if kind is not None):
        if timed and clock.perf_counter() >= until:
            break
        limit = replace(setup.run, case_timeout=min(setup.run.case_timeout, _LONGEST_DRIVE))
        # with imports and compilation
        a_drive, in_time = _seconds_each(cases[:1], replace(setup, run=limit))
        number = _TIMED
        if home(cases[0], setup) != OURS:  # nothing ends a pack that has begun
            number = int(min(_A_KIND_FOR, until - clock.perf_counter()) / a_drive)
        timed += 1
        late |= not in_time and limit != setup.run
        if number > 0 and clock.perf_counter() < until:
            a_drive, _ = _seconds_each(cases[:number], setup)
            timed += len(cases[:number])
        took.setdefault(sort, []).append(a_drive)
    return {sort: fmean(some) for sort, some in took.items()}, timed, late


def _seconds_each(cases: Sequence[Case], setup: Setup) -> tuple[float, bool]:
    """Wall time of each of some drives, and whether all of them ended in time."""
    began = clock.perf_counter()
    in_time = all(outcome.status != "timeout" for outcome in [*run_cases(cases, setup)])
    return (clock.perf_counter() - began) / len(cases), in_time


def _chosen(
    store: Store, plan: Planner, spaces: Sequence[Space], share: float, seed: int
) -> list[Case]:
    """A share of the recorded drives, at least one of each kind, drawn by the run's own seed."""
    stream = random_stream(seed, "verify")
    chosen: list[Case] = []
    for space in spaces:
        for kind in stages(space, plan):
            cases = list(kind.cases)
            picked = stream.permutation(len(cases))[: math.ceil(share * len(cases))]
            chosen += [cases[index] for index in sorted(picked.tolist())]
    return chosen


def _spaces(
    settings: EvaluationSettings,
    source: Path,
    shard: tuple[int, int],
    progress: Progress = quiet,
    looked_at: int | None = None,
) -> list[Space]:
    """The points of every scenario, with their zones; a shard has every n-th point, with all its
    drives.
    """
    spaces: list[Space] = []
    for offset, entry in enumerate(settings.scenario):
        spaces.append(space_of(entry, settings, source, shard, offset, looked_at))
        refuse_doubles(spaces)
        progress("zones", len(spaces), len(settings.scenario))
    scenario_weights([space.logical.name for space in spaces], settings.method.ranking)
    return spaces


def space_of(
    entry: ScenarioSettings,
    settings: EvaluationSettings,
    source: Path,
    shard: tuple[int, int] = WHOLE,
    offset: int = 0,
    looked_at: int | None = None,
) -> Space:
    """The points of one scenario of an evaluation, with their zones.

    looked_at: an estimate looks at about so many of the points only, and each stands for those that
        follow it.

    Raises InputError for whatever makes the scenario impossible to run, at any of its points;
    `check` and `run` ask it alike.

    offset: the scenario's place in the evaluation, so that shards share the points of all evenly.
    """
    logical = catalogue.find(entry.use, source)
    exposure = exposure_of(logical, entry.exposure, settings.drivers, source)
    points = choose_points(logical, entry, source, settings, exposure.density)
    every = 1 if looked_at is None else -(-len(points.points) // looked_at)
    check_points(logical, points.points[::every])
    # misspelt ones must not be found out at the report
    for name in settings.report.axes.get(logical.name, ()):
        logical.column(name)
    hazardous = exactly_hazardous(logical, points.points[::every], settings.method.zones)
    hazardous = np.repeat(hazardous, every)[: len(points.points)]
    index, count = shard
    numbers: Sequence[int] = range((index - 1 - offset) % count, len(points.points), count)
    numbers = points_only(numbers, settings.run.only, logical.name, len(points.points))
    return Space(
        logical, points.points, hazardous, numbers, points.exposure, exposure.plain(points.points)
    )


def refuse_doubles(spaces: Sequence[Space]) -> None:
    """Cases are named by their scenario's name: two files that give the same name cannot be told
    apart.
    """
    names = [space.logical.name for space in spaces]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"Logical scenarios of one evaluation must differ in their names, got `{name}` "
                "twice."
            )


def _middle(space: Space) -> ConcreteScenario:
    """The concrete scenario in the middle of the sample, the example that the run folder keeps for
    sumo-gui.
    """
    return space.concrete(len(space.points) // 2)


def _check_shard(store: Store, shard: tuple[int, int], folder: Path) -> None:
    before = store.noted(run_folder.SHARD)
    if before and parse_shard(before) != shard:
        raise InputError(
            f"Run {folder} is shard {before}; it cannot go on as shard {shard[0]}/{shard[1]}."
        )


def _counted(store: Store, folder: Path) -> Recorded:
    counts = store.counts()
    drives = sum(number for *_, number, _ in counts)
    failed = sum(
        number
        for _, role, _, status, number, _ in counts
        if role == "ads" and status not in EVALUATED
    )
    return Recorded(folder, drives, failed)
