"""Engines: work off cases in child processes, one fault costing one case, outcomes in the order of the cases."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import TimeoutError as FutureTimeoutError

from pebble import ProcessExpired, ProcessPool

from sumo_eval.batch.cases import Case, Outcome, Setup
from sumo_eval.batch.children import child_context
from sumo_eval.batch.worker import run_case

_IN_FLIGHT_PER_WORKER = 8  # enough that a slow case does not starve the other workers, few enough to bound memory


def run_cases(cases: Iterable[Case], setup: Setup) -> Iterator[Outcome]:
    """Outcomes of the cases, in their order, worked off by `setup.run.workers` processes with a deadline for each."""
    with ProcessPool(max_workers=setup.run.workers, context=child_context()) as pool:
        try:
            yield from _outcomes(cases, setup, pool)
        except BaseException:
            pool.stop()  # type: ignore[no-untyped-call]
            raise


def _outcomes(cases: Iterable[Case], setup: Setup, pool: ProcessPool) -> Iterator[Outcome]:
    waiting: deque[tuple[Case, Callable[[], Outcome]]] = deque()
    for case in cases:
        waiting.append((case, pool.schedule(run_case, args=(case, setup), timeout=setup.run.case_timeout).result))
        if len(waiting) >= setup.run.workers * _IN_FLIGHT_PER_WORKER:
            yield _outcome(*waiting.popleft(), setup)
    while waiting:
        yield _outcome(*waiting.popleft(), setup)


def _outcome(case: Case, result: Callable[[], Outcome], setup: Setup) -> Outcome:
    try:
        return result()
    except FutureTimeoutError:
        return Outcome(case, "timeout", None, f"The case took longer than {setup.run.case_timeout:g} s of wall time.")
    except ProcessExpired as error:
        return Outcome(case, "crashed", None, f"The process that ran the case died with exit code {error.exitcode}.")
