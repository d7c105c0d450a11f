"""Engines: drive cases in this process, in child processes or on a cluster.

Users: `extras/studies/qualification/table.py`, `extras/studies/trials.py`, `nightly/repeats.py`,
`record/`, `whatif/search.py`.
"""

import os
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.record import loops, reads
from sumo_eval.record.batches import LATE, Batch, Batches, driven, largest_batch
from sumo_eval.record.cases import ALONE, Case, Outcome, Setup, Status, on_its_own
from sumo_eval.record.claims import (
    NO_USER_CODE,
    Results,
    affinity,
    affinity_of_ads,
    results_of,
)
from sumo_eval.record.identity import locator_identity
from sumo_eval.record.pool import Ended, Pool, Work
from sumo_eval.record.progress import Stopping, never
from sumo_eval.record.worker import answer
from sumo_eval.settings import RunSettings
from sumo_eval.settings.locators import load_object
from sumo_eval.text import clean
from sumo_eval.trajectory import Alone

# a case that timed out is rerun if no processor worked on it in more than this share of its time
IDLE = 0.2
# begins locators of its functions: `record/cluster.py` imports this file
_CLUSTER = "sumo_eval.record.cluster:"

Outcomes = Generator[list[Outcome], None, None]
"""Lists of outcomes: each list has the cases that ended together, or none. A case of TraCI code
that ran in a batch gets a second outcome if that code turns out to keep state between cases: it
then runs alone.
"""


def run_cases(cases: Iterable[Case], setup: Setup) -> Generator[Outcome, None, None]:
    """One outcome of each case, from the engine that `setup.run` names (see `once_each`)."""
    return once_each(run_batches(cases, setup))


def once_each(ended: Outcomes) -> Generator[Outcome, None, None]:
    """The final outcome of each case as it ends; outcomes that may be replaced come last."""
    replaceable: dict[str, Outcome] = {}
    with closing(ended) as batches:
        for outcome in chain.from_iterable(batches):
            if outcome.batched:
                replaceable[outcome.case.key] = outcome
            else:
                replaceable.pop(outcome.case.key, None)
                yield outcome
    yield from replaceable.values()


def run_batches(cases: Iterable[Case], setup: Setup, stopping: Stopping = never) -> Outcomes:
    """Outcomes of the cases by batches, from the engine that `setup.run` names."""
    refuse_engine(setup.run)
    if setup.run.engine == "serial":
        return _run_here(cases, setup, stopping)
    if setup.run.engine == "dask":
        outcomes: Outcomes = load_object(f"{_CLUSTER}run_on_cluster", None, "Engine")(
            cases, setup, stopping
        )
        return outcomes
    return run_in_children(cases, setup, stopping, setup.run.workers)


def refuse_engine(run: RunSettings) -> None:
    """Refuse the engine `processes` on a system that cannot fork (Windows), and `dask` without a
    scheduler or without Dask.
    """
    if run.engine == "dask":
        load_object(f"{_CLUSTER}refuse_without", None, "Engine")(run.scheduler)
    if run.engine == "processes" and not hasattr(os, "fork"):
        raise InputError(
            "The engine `processes` needs a system whose processes can fork, such as Linux; this "
            'one cannot. Drive in this process: --engine serial, or [run] engine = "serial". A '
            "hanging ADS is not ended there."
        )


def run_in_children(
    cases: Iterable[Case], setup: Setup, stopping: Stopping = never, workers: int = 1
) -> Outcomes:
    """Drive each batch in one of `workers` child processes; cases of a lost process run alone."""
    # Compile the rules now, or the first case would spend its time limit on that. If `cases` is an
    # iterator, the caller has compiled the rules.
    loops.ready(loops.of_cases(cases if isinstance(cases, Sequence) else ()))
    batches = Batches(cases, workers, min(largest_batch(setup), setup.run.cases_per_child))
    work = Work(answer, setup, results_of, lambda batch: affinity(batch[0], setup), driven)
    with Pool(workers, setup.run, setup.run.cases_per_child) as pool:
        yield from pool.run(
            work,
            batches.take,
            partial(_settled, batches=batches, setup=setup),
            stopping,
            batches.look_ahead,
        )


def identify(named: Sequence[tuple[str, str]], setup: Setup) -> dict[str, str]:
    """The identity of each ADS or other object that a user named, by its locator.

    named: pairs of kind and locator.

    Raises InputError for one that cannot be loaded.
    Loading runs a user's file, so each is loaded in a fresh child process, which has imported no
    other. On a system that cannot fork, the engine `serial` loads all in this process.
    """
    if setup.run.engine == "serial":
        refuse_to_share(affinity_of_ads(locator, setup) for kind, locator in named if kind == "ADS")
        if not hasattr(os, "fork"):
            return {pair[1]: locator_identity(pair, setup.folder) for pair in named}
    identities: dict[str, str] = {}
    with Pool(setup.run.workers, setup.run) as pool:
        for ended in pool.each(Work(locator_identity, setup.folder), named):
            kind, locator = ended.item
            if ended.how != "done":
                happened = what_happened(ended, setup.run, "It", "loaded it")
                log = ended.log.strip()
                last = f" Its last words: {clean(log.splitlines()[-1].strip())}" if log else ""
                raise InputError(f"{kind} `{locator}` cannot be loaded: {happened}{last}")
            identities[locator] = ended.result
    return identities


def refuse_to_share(affinities: Iterable[str]) -> None:
    """Raise InputError for two ADSs of the user: the engine `serial` has one process only."""
    users = sorted(set(affinities) - {NO_USER_CODE})
    if len(users) > 1:
        raise InputError(
            "The engine `serial` runs everything in one process, which can serve one ADS of "
            f"yours, got {users[0]} and {users[1]}. Run them one at a time, or with the engine "
            "`processes`."
        )


def _run_here(cases: Iterable[Case], setup: Setup, stopping: Stopping) -> Outcomes:
    batches = Batches(cases, 1, largest_batch(setup))
    batches.look_ahead()
    served: set[str] = set()
    reads.begin_run()
    while not stopping() and (batch := batches.take()) is not None:
        served.add(affinity(batch[0], setup))
        refuse_to_share(served)
        results = results_of(answer(batch, setup), batch)
        yield _settled(Ended(batch, "done", results, ""), batches, setup)
        batches.look_ahead()


def _settled(ended: Ended[Batch], batches: Batches, setup: Setup) -> list[Outcome]:
    """Outcomes of a batch that has ended; its cases without one return to `batches`, to be run
    alone.
    """
    batch = ended.item
    batches.ended()
    if on_its_own(batch):
        return _settled_alone(ended, batches, setup)
    printed = f"Printed by its batch of {len(batch)} cases:\n{ended.log}" if ended.log else ""
    if ended.how != "done":  # its process was lost
        happened = clean(what_happened(ended, setup.run, "It", "ran it"))
        why = Alone("pack_lost" if batch[0].block is None else "block_lost", happened)
        batches.record_failure(batch, [why] * len(batch), printed, too_slow=ended.how == "overdue")
        return []
    results: Results = ended.result
    if results is None:
        batches.never_together(batch)
        return []
    reasons = [result for result in results if isinstance(result, Alone)]
    if len(reasons) == len(batch):
        batches.record_failure(batch, reasons, printed)
        return []
    batches.record_success(batch)
    outcomes: list[Outcome] = []
    for case, result in zip(batch, results, strict=True):
        if isinstance(result, Alone):
            batches.run_alone(case, result)
        elif case.block is None and is_late_by_chance(result, ended, setup):
            batches.run_undisturbed(result)
        elif not result.batched or batches.note_batched(case):
            # the batch's output goes to the log of the first outcome
            outcomes.append(result if outcomes else replace(result, log=result.log + printed))
    return outcomes


def _settled_alone(ended: Ended[Batch], batches: Batches, setup: Setup) -> list[Outcome]:
    """The outcome of a case that ran alone; none if it was late by chance, and runs once more."""
    (case,) = ended.item
    why, printed = batches.remark(case)  # printed: by its batch, if it was in one before
    remark = printed if why is None else f"{ALONE}{why}\n{printed}"
    if ended.how == "done":
        (outcome,) = ended.result  # `results_of` refuses any other answer
    else:
        status: Status = "timeout" if ended.how == "overdue" else "crashed"
        outcome = Outcome(case, status, None, what_happened(ended, setup.run))
    outcome = replace(outcome, log=remark + outcome.log + ended.log, alone=why)
    # a late case is rerun once only
    may_repeat = why is None or why.why != LATE
    if may_repeat and is_late_by_chance(outcome, ended, setup):
        batches.run_undisturbed(outcome)
        return []
    return [outcome]


def is_late_by_chance(outcome: Outcome, ended: Ended[Batch], setup: Setup) -> bool:
    """Whether a case timed out for a reason that may not recur: in its first step, or because it
    waited too long for a processor (`IDLE`).
    """
    recording = outcome.recording
    in_first_step = recording is not None and recording.simulated_time <= setup.simulation.step
    return outcome.status in ("timeout", "ads_timeout") and (in_first_step or ended.idle > IDLE)


def what_happened(
    ended: Ended[Any], limits: RunSettings, what: str = "The case", did: str = "ran the case"
) -> str:
    """A sentence about an item without a result.

    what: subject of the sentence.
    did: what the process did, after "The process that".
    """
    if ended.how == "overdue":
        return f"{what} took longer than {limits.case_timeout:g} s of wall time."
    if ended.how == "overfull":  # `why` is then the memory held, MB
        return (
            f"The process that {did} and what it had started held {ended.why} MB, more than the "
            f"{limits.memory_limit:g} MB of `run.memory_limit`, and were ended."
        )
    return f"The process that {did} {ended.why}."
