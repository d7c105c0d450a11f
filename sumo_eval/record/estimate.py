"""Cost of an evaluation, from a few drives that are timed."""

from __future__ import annotations

import time as clock
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, zip_longest
from pathlib import Path
from statistics import fmean

from sumo_eval.method.zone_partition import refuse_impossible_zones
from sumo_eval.record.cases import Case, Role, Setup
from sumo_eval.record.claims import NO_USER_CODE, affinity
from sumo_eval.record.engines import refuse_engine, run_cases
from sumo_eval.record.facts import compile_loops, in_rounds, planned
from sumo_eval.record.recording import Planner, Space, find_stale, stages
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import open_store
from sumo_eval.scenario.resolved import Resolved

_TIMED = 32  # drives of a kind that an estimate times, at most
_A_KIND_FOR = 1.0  # s, where a user's ADS drives
_TIMED_FOR = 2.0  # s for all kinds; the drive that runs then is the last one
_LONGEST_DRIVE = 3.0  # s; a longer one is broken off
_KINDS = 12  # ADSs that are loaded and timed, and pairs of ADS and scenario, at most
_SORTS = {"ads": "ADSs", "references": "references", "humans": "human drivers"}
_LOOKED_AT = 2_000  # points of each scenario that are looked at, at most

Kind = tuple[str, list[Case]]
"""One of `_SORTS`, and cases that one driver drives in one scenario."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Cost of an evaluation: drives by sort, those recorded already, s of wall time.

    drives: of ADSs, of references (three at every point) and of human drivers, as in `_SORTS`.
    loaded: how many ADSs of how many.
    untimed: sorts of drives that count as the rest.
    broken_off: whether a drive took longer than all that is to be timed.
    """

    drives: Counter[str]
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
        some, every = self.loaded
        lines = [
            f"{self.drives['ads']} drives of the ADSs, {self.drives['humans']} of human drivers "
            f"and {self.drives['references']} of the references{done}.",
            f"About {time} with {self.workers} worker{many}, estimated from {timed} timed now, for "
            f"{_TIMED_FOR:g} s at most; scoring takes additional time.",
        ]
        if some < every:
            lines.append(f"{some} of the {every} ADSs were loaded and timed; a run loads them all.")
        if self.untimed:
            sorts = " and ".join(self.untimed)
            lines.append(f"Drives of the {sorts} were not timed: they count as the rest.")
        if self.broken_off:
            lines.append(
                f"A drive was broken off after {_LONGEST_DRIVE:g} s: the run takes longer than "
                "that."
            )
        return "\n".join(lines)


def estimate(run: Resolved, folder: Path | None) -> Estimate:
    """Number of drives of an evaluation, and their duration: timed at points from all over each
    scenario.

    Points that are chosen in rounds all count, as if one round had them.

    folder: of the run to resume.
    """
    refuse_engine(run.settings.run)
    recorded = 0 if folder is None else _recorded(folder, run)
    entries = tuple(
        replace(entry, sampling=replace(entry.sampling, round=entry.sampling.count, rounds=()))
        if entry.sampling.method == "adaptive"
        else entry
        for entry in run.settings.scenario
    )
    run = replace(run, settings=replace(run.settings, scenario=entries))
    settings, workers = run.settings, run.settings.run.workers
    # `run.only` needs the names of all ADSs
    every = 1 if settings.run.only else -(-len(settings.ads) // _KINDS)
    some = replace(run, settings=replace(settings, ads=settings.ads[::every]))
    plan, spaces = planned(some, looked_at=_LOOKED_AT)
    for space in spaces:
        refuse_impossible_zones(space.logical, settings.method.zones)  # a run would end there
    compile_loops(settings, spaces)

    whole, drives = replace(plan, run=run), Counter[str]()
    for kind in chain.from_iterable(stages(space, whole) for space in spaces):
        drives[_sort(kind.role)] += kind.total
    setup = replace(plan.setup, run=replace(settings.run, workers=1, engine="processes"))
    took, timed, broken_off = _seconds_a_drive(_kinds(plan, spaces), setup)
    usual = fmean(took.values()) if took else 0.0
    seconds = sum(number * took.get(sort, usual) for sort, number in drives.items())
    return Estimate(
        drives,
        recorded,
        seconds * max(1.0 - recorded / max(drives.total(), 1), 0.0) / workers,
        timed,
        workers,
        (len(some.settings.ads), len(settings.ads)),
        tuple(words for sort, words in _SORTS.items() if drives[sort] and sort not in took),
        broken_off,
    )


def _recorded(folder: Path, run: Resolved) -> int:
    """Number of drives of an evaluation that a run folder holds already."""
    if not (folder / FACTS).is_file():
        return 0
    plan, spaces = planned(in_rounds(run, folder), looked_at=_LOOKED_AT)
    with open_store(folder / FACTS) as store:
        find_stale(store, run.source)
        kinds = chain.from_iterable(stages(space, plan) for space in spaces)
        return sum(map(store.holds, chain.from_iterable(kind.cases for kind in kinds)))


def _sort(role: Role) -> str:
    return {"ads": "ads", "human": "humans"}.get(role, "references")


def _kinds(plan: Planner, spaces: Sequence[Space]) -> Iterable[Kind]:
    """Cases of each kind to time, one kind of each sort after another."""
    # at most `_TIMED` of the points to do of each, from one end to the other
    few = [
        replace(one, numbers=one.numbers[:: max(-(-len(one.numbers) // _TIMED), 1)])
        for one in spaces
    ]
    kinds = {sort: list[Iterable[Case]]() for sort in _SORTS}
    pairs = [(space, ads) for space in few for ads in plan.run.settings.ads]
    for space, ads in pairs[:: -(-len(pairs) // _KINDS)]:
        settings = replace(plan.run.settings, ads=(ads,))
        alone = replace(plan, run=replace(plan.run, settings=settings))
        kinds["ads"].append(alone.ads(space))
    for kind in chain.from_iterable(stages(space, plan) for space in few):
        if kind.role != "ads":
            kinds[_sort(kind.role)].append(kind.cases)
    turns = zip_longest(*([(sort, cases) for cases in some] for sort, some in kinds.items()))
    for sort, cases in filter(None, chain.from_iterable(turns)):
        if listed := list(islice(cases, _TIMED)):
            yield sort, listed


def _seconds_a_drive(kinds: Iterable[Kind], setup: Setup) -> tuple[dict[str, float], int, bool]:
    """Wall time of a drive of each sort that was reached, by how many drives, and whether one was
    broken off.
    """
    until, timed, late = clock.perf_counter() + _TIMED_FOR, 0, False
    took = defaultdict[str, list[float]](list)
    limit = replace(setup.run, case_timeout=min(setup.run.case_timeout, _LONGEST_DRIVE))
    for sort, cases in kinds:
        if timed and clock.perf_counter() >= until:
            break
        # with imports and compilation
        seconds, in_time = _seconds_each(cases[:1], replace(setup, run=limit))
        number = _TIMED
        if affinity(cases[0], setup) != NO_USER_CODE:  # nothing ends a batch that has begun
            number = int(min(_A_KIND_FOR, until - clock.perf_counter()) / seconds)
        timed += 1
        late |= not in_time and limit != setup.run
        if number > 0 and clock.perf_counter() < until:
            seconds, _ = _seconds_each(cases[:number], setup)
            timed += len(cases[:number])
        took[sort].append(seconds)
    return {sort: fmean(some) for sort, some in took.items()}, timed, late


def _seconds_each(cases: Sequence[Case], setup: Setup) -> tuple[float, bool]:
    """Wall time of each of some drives, and whether all of them ended in time."""
    began = clock.perf_counter()
    in_time = all(outcome.status != "timeout" for outcome in [*run_cases(cases, setup)])
    return (clock.perf_counter() - began) / len(cases), in_time
