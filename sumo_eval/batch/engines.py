"""Engines: work off cases here, in child processes or on a cluster. Outcomes come as cases end, each exactly once."""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import suppress
from typing import Any

from sumo_eval.batch.cases import Case, Outcome, Setup, Status
from sumo_eval.batch.identity import locator_identity
from sumo_eval.batch.pool import Ended, Pool
from sumo_eval.batch.worker import run_case
from sumo_eval.errors import InputError

Stopping = Callable[[], bool]
"""Asked before every case: whether no more of them should be begun."""


def never() -> bool:
    """Goes on to the end."""
    return False


def run_cases(cases: Iterable[Case], setup: Setup, stopping: Stopping = never) -> Generator[Outcome, None, None]:
    """Outcomes of the cases as they end, in whatever order, from the engine that `setup.run` names."""
    if setup.run.engine == "serial":
        return _run_here(cases, setup, stopping)
    if setup.run.engine == "dask":
        from sumo_eval.batch.cluster import run_on_cluster

        return run_on_cluster(cases, setup, stopping)
    return run_in_children(cases, setup, stopping, setup.run.workers)


def run_in_children(
    cases: Iterable[Case], setup: Setup, stopping: Stopping = never, workers: int = 1
) -> Generator[Outcome, None, None]:
    """Every case in one of `workers` child processes: whatever happens there costs that case alone."""
    with _pool(workers, setup, setup.run.cases_per_child) as pool:
        for ended in pool.run(run_case, cases, setup, stopping):
            yield _outcome(ended, setup)


def identify(named: Sequence[tuple[str, str]], setup: Setup) -> dict[str, str]:
    """The identity of every ADS or other thing that a user named, as (kind, locator), by locator.

    Raises InputError for one that cannot be loaded.
    Loading runs a user's file, so it happens in a child, a fresh one each: what one has imported is not another's.
    """
    identities: dict[str, str] = {}
    with _pool(1, setup, items_per_child=1) as pool:
        for ended in pool.run(locator_identity, named, setup.folder):
            kind, locator = ended.item
            if isinstance(ended.result, InputError):
                raise ended.result
            if ended.how != "done":
                happened = _what_happened(ended, setup).replace("ran the case", "loaded it").replace("The case", "It")
                raise InputError(f"{kind} `{locator}` cannot be loaded: {happened}{_quoted(ended.log)}")
            identities[locator] = ended.result
    return identities


def _run_here(cases: Iterable[Case], setup: Setup, stopping: Stopping) -> Generator[Outcome, None, None]:
    for case in cases:
        if stopping():
            return
        yield run_case(case, setup)


def _pool(workers: int, setup: Setup, items_per_child: int) -> Pool:
    return Pool(workers, setup.run.case_timeout, setup.run.memory_limit, items_per_child)


def _outcome(ended: Ended[Case], setup: Setup) -> Outcome:
    if ended.how != "done":
        status: Status = "timeout" if ended.how == "overdue" else "crashed"
        return Outcome(ended.item, status, None, _what_happened(ended, setup), ended.log)
    outcome: Outcome = ended.result
    return Outcome(ended.item, outcome.status, outcome.recording, outcome.error, outcome.log + ended.log)


def _what_happened(ended: Ended[Any], setup: Setup) -> str:
    if ended.how == "overdue":
        return f"The case took longer than {setup.run.case_timeout:g} s of wall time."
    if ended.exitcode is None:
        return "The process that ran the case closed its connection."
    name = ""
    if ended.exitcode < 0:
        with suppress(ValueError):
            name = f" ({signal.Signals(-ended.exitcode).name})"
    return f"The process that ran the case died with exit code {ended.exitcode}{name}."


def _quoted(log: str) -> str:
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    return f" Its last words: {lines[-1]}" if lines else ""
