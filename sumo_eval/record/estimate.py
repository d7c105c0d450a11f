"""Cost of an evaluation, from a few drives that are timed; for `sumo-eval run --dry-run`.

Users: `cli/run.py`.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import chain, islice, zip_longest
from math import ceil
from pathlib import Path
from statistics import fmean
from time import perf_counter
from typing import NamedTuple

from sumo_eval.frozen import frozen
from sumo_eval.method.zone_partition import refuse_impossible_zones
from sumo_eval.record.cases import Case, Outcome, Role, Setup
from sumo_eval.record.claims import NO_USER_CODE, affinity
from sumo_eval.record.engines import refuse_engine, run_batches
from sumo_eval.record.facts import compile_loops, in_rounds, planned
from sumo_eval.record.recording import Planner, Space, find_stale, stages
from sumo_eval.record.store import FACTS, RECORDED, open_store
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import EvaluationSettings
from sumo_eval.text import duration_words

_MOST_DRIVES = 32  # drives of a `Kind` that are timed, at most
_KIND_TIME = 1.0  # s that the timed drives of one kind may take, if a user's ADS drives
_ALL_TIME = 2.0  # s for all kinds: after that no further batch begins
_LONGEST_DRIVE = 3.0  # s; a longer drive is broken off; loading its ADS does not count
_MOST_KINDS = 12  # most ADSs, and most pairs of ADS and scenario, that are timed
_SORTS = {"ads": "ADSs", "references": "references", "humans": "human drivers"}
"""Sorts of drives, with their names in messages; drives of a sort count as equally long."""
_MOST_POINTS = 2_000  # points of each scenario that are checked and classified, at most

Kind = tuple[str, list[Case]]
"""A sort, key of `_SORTS`, and cases that are timed together: of one scenario, and of one ADS."""


@frozen
class Estimate:
    """Cost of an evaluation.

    drives: number by sort (`_SORTS`): of ADSs, references (three at every point), human drivers.
    recorded: number of drives that are recorded already.
    seconds: wall time of the drives that are left, with all workers.
    timed: number of timed drives.
    workers: number of processes of the run.
    loaded: number of ADSs that were loaded to be timed, and of all ADSs.
    untimed: names of sorts without a timed drive; their drives count as the mean of timed sorts.
    broken_off: whether a drive was ended after `_LONGEST_DRIVE`.
    fills: whether synthetic drivers may be added to recorded ones; their drives are not counted.
    """

    drives: Counter[str]
    recorded: int
    seconds: float
    timed: int
    workers: int
    loaded: tuple[int, int]
    untimed: tuple[str, ...]
    broken_off: bool
    fills: bool

    def __str__(self) -> str:
        done = f"; {self.recorded} of them are recorded already" if self.recorded else ""
        many = "s" * (self.workers > 1)
        timed = f"{self.timed} drive{'s' * (self.timed > 1)}"
        loaded, of_all = self.loaded
        time = duration_words(max(self.seconds, 1.0))
        lines = [
            f"{self.drives['ads']} drives of the ADSs, {self.drives['humans']} of human drivers "
            f"and {self.drives['references']} of the references{done}.",
            f"About {time} with {self.workers} worker{many}, estimated from {timed} timed now; "
            "scoring takes additional time.",
        ]
        if loaded < of_all:
            lines.append(f"At most {loaded} of the {of_all} ADSs were timed; a run loads them all.")
        if self.untimed:
            sorts = " and ".join(self.untimed)
            lines.append(f"Drives of the {sorts} were not timed: they count as the rest.")
        if self.fills:
            lines.append(
                "Drives of synthetic drivers, where too few are recorded, are not counted."
            )
        if self.broken_off:
            lines.append(
                f"A drive was broken off after {_LONGEST_DRIVE:g} s: the run takes longer than "
                "estimated."
            )
        return "\n".join(lines)


def estimate(run: Resolved, folder: Path | None) -> Estimate:
    """Number of drives of an evaluation, and their duration, timed at points that are spread over
    each scenario.

    folder: of the run to resume.
    """
    refuse_engine(run.settings.run)
    recorded = 0 if folder is None else _recorded(folder, run)
    settings = _in_one_round(run.settings)
    run = replace(run, settings=settings)
    # every n-th ADS; all of them if `run.only` names cases, which may be of any ADS
    step = 1 if settings.run.only else ceil(len(settings.ads) / _MOST_KINDS)
    loaded = settings.ads[::step]
    ends = [perf_counter()]  # of loading, then of further parts of the planning, s
    plan, spaces = planned(
        replace(run, settings=replace(settings, ads=loaded)),
        lambda *_: ends.append(perf_counter()),
        _MOST_POINTS,
    )
    loading = ends[1] - ends[0]  # of all these ADSs, at least as long as that of one
    for space in spaces:
        refuse_impossible_zones(space.logical, settings.method.zones)  # as a run does
    compile_loops(settings, spaces)

    # drives of every ADS count, also of ADSs that are not loaded
    plan_of_all = replace(plan, run=run)
    drives = Counter[str]()
    for stage in chain.from_iterable(stages(space, plan_of_all) for space in spaces):
        drives[_sort(stage.role)] += stage.total
    setup = replace(plan.setup, run=replace(settings.run, workers=1, engine="processes"))
    durations, timed, broken_off = _seconds_a_drive(_kinds(plan, spaces), setup, loading)
    mean = fmean(durations.values()) if durations else 0.0
    seconds = sum(number * durations.get(sort, mean) for sort, number in drives.items())
    # recorded drives are taken to last as long as the mean of all drives
    missing_share = max(1.0 - recorded / max(drives.total(), 1), 0.0)
    return Estimate(
        drives,
        recorded,
        seconds * missing_share / settings.run.workers,
        timed,
        settings.run.workers,
        (len(loaded), len(settings.ads)),
        tuple(words for sort, words in _SORTS.items() if drives[sort] and sort not in durations),
        broken_off,
        settings.drivers.source == RECORDED and settings.drivers.too_thin == "fill",
    )


def _in_one_round(settings: EvaluationSettings) -> EvaluationSettings:
    """Settings in which every adaptive sample has all its points in one round: they are counted
    here, not chosen.
    """
    return replace(
        settings,
        scenario=tuple(
            replace(entry, sampling=replace(entry.sampling, round=entry.sampling.count, rounds=()))
            if entry.sampling.method == "adaptive"
            else entry
            for entry in settings.scenario
        ),
    )


def _recorded(folder: Path, run: Resolved) -> int:
    """Number of drives of an evaluation that a run folder holds already."""
    if not (folder / FACTS).is_file():
        return 0
    plan, spaces = planned(in_rounds(run, folder), looked_at=_MOST_POINTS)
    with open_store(folder) as store:
        find_stale(store, run.source)  # `store.holds` is False for cases of ADSs marked as stale
        cases = (stage.cases for space in spaces for stage in stages(space, plan))
        return sum(map(store.holds, chain.from_iterable(cases)))


def _sort(role: Role) -> str:
    """Key of `_SORTS`."""
    return {"ads": "ads", "human": "humans"}.get(role, "references")


def _kinds(plan: Planner, spaces: Sequence[Space]) -> Iterable[Kind]:
    """Cases of each kind to time. The sorts alternate, so that each is timed before time is up."""
    # the spaces with at most `_MOST_DRIVES` of their points, evenly spread
    few = [
        replace(it, numbers=it.numbers[:: max(ceil(len(it.numbers) / _MOST_DRIVES), 1)])
        for it in spaces
    ]
    kinds = {sort: list[Iterable[Case]]() for sort in _SORTS}
    ads = plan.run.settings.ads
    pairs = min(len(ads) * len(few), _MOST_KINDS)
    # The ADSs alternate, so that each is timed equally often. The scenarios follow each other,
    # each with an equal share of the pairs. No pair occurs twice.
    for number in range(pairs):
        space, entry = few[number * len(few) // pairs], ads[number % len(ads)]
        run = replace(plan.run, settings=replace(plan.run.settings, ads=(entry,)))
        kinds["ads"].append(replace(plan, run=run).ads(space))
    for stage in chain.from_iterable(stages(space, plan) for space in few):
        if stage.role != "ads":
            kinds[_sort(stage.role)].append(stage.cases)
    for turn in zip_longest(*kinds.values(), fillvalue=()):
        for sort, cases in zip(kinds, turn, strict=True):
            if listed := list(islice(cases, _MOST_DRIVES)):
                yield sort, listed


def _seconds_a_drive(
    kinds: Iterable[Kind], setup: Setup, loading: float
) -> tuple[dict[str, float], int, bool]:
    """Wall time of a drive of each sort that was timed, s; number of timed drives; whether one of
    them was broken off.

    loading: longest time that loading an ADS may take, s.
    """
    until = perf_counter() + _ALL_TIME
    timed = 0
    broken_off = False
    durations = defaultdict[str, list[float]](list)
    longest = min(setup.run.case_timeout, _LONGEST_DRIVE + loading)
    limits = replace(setup.run, case_timeout=longest)
    for sort, cases in kinds:
        if timed and perf_counter() >= until:
            break
        first = _timed_drives(cases[:1], replace(setup, run=limits), until)
        # its process starts and loads the ADS, which in a run happens once for many drives
        start = first.elapsed - first.stepping
        seconds = first.stepping  # counts if no other drive is timed
        timed += 1
        # a run whose own limit is as short breaks the drive off, too: then its time is right
        broken_off |= not first.in_time and limits != setup.run
        number = _MOST_DRIVES if first.in_time else 0
        if affinity(cases[0], setup) != NO_USER_CODE:
            # a batch of a user's ADS cannot be stopped: drive only what fits into the time
            number = int(min(_KIND_TIME, until - perf_counter() - start) / seconds)
        further = cases[1:number]
        if further and perf_counter() < until:
            more = _timed_drives(further, setup, until)
            seconds = max(more.elapsed - start, more.stepping) / more.number
            timed += more.number
        durations[sort].append(seconds)
    return {sort: fmean(times) for sort, times in durations.items()}, timed, broken_off


class _TimedDrives(NamedTuple):
    """Drives that were timed.

    number: of these drives.
    elapsed: wall time until all had ended, with the start of their process, s.
    stepping: the part of it in which their simulations ran; all of it if that is not known.
    in_time: whether all of them ended in time.
    """

    number: int
    elapsed: float
    stepping: float
    in_time: bool


def _timed_drives(cases: Sequence[Case], setup: Setup, until: float) -> _TimedDrives:
    """Drive cases, at least one, until a time."""
    began = perf_counter()
    outcomes: list[Outcome] = []
    with closing(run_batches(cases, setup)) as batches:
        for ended in batches:  # all drives that ended together count, also when the time is up
            outcomes += ended
            if outcomes and perf_counter() >= until:
                break
    elapsed = perf_counter() - began
    recordings = [outcome.recording for outcome in outcomes if outcome.recording]
    lost = len(recordings) < len(outcomes)
    stepping = elapsed if lost else sum(recording.wall_time for recording in recordings)
    in_time = all(outcome.status != "timeout" for outcome in outcomes)
    return _TimedDrives(len(outcomes), elapsed, stepping, in_time)
