"""The engine `dask`: batches of cases on an existing Dask cluster (extra `cluster`). Each worker of
the cluster drives its batches in child processes, as the engine `processes` does.

Users: `record/engines.py`, by locators.
"""

import logging
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

from sumo_eval.errors import InputError, needs_extra, said
from sumo_eval.record.batches import Batch, Batches
from sumo_eval.record.cases import Case, Outcome, Setup
from sumo_eval.record.engines import Outcomes, once_each, run_in_children
from sumo_eval.record.identity import harness_identity
from sumo_eval.record.progress import Stopping

# most cases in a batch: each batch starts a child process, and is rerun if its worker is lost
BATCH = 100
# batches submitted at a time for each thread of the cluster: more than one, so that no thread waits
_BATCHES_PER_THREAD = 3
_TIMES = 3  # submissions of a batch to the cluster before its cases count as crashed
_CONNECT_TIME = 10.0  # s
_LOG_OF_DASK = "distributed.client"


def run_batch(cases: Batch, setup: Setup, harness: str) -> list[Outcome] | str:
    """The outcomes of a batch; runs on a worker of the cluster. A worker with other versions of the
    software would record other facts: it returns the end of an error message instead.

    harness: `harness_identity` of the process that collects the facts.
    """
    if harness_identity() != harness:
        return (
            "has another version of sumo_eval or of libsumo than the process that collects the "
            "facts"
        )
    return list(once_each(run_in_children(cases, setup)))


def run_on_cluster(cases: Iterable[Case], setup: Setup, stopping: Stopping) -> Outcomes:
    """Outcomes of the cases from the cluster with the scheduler `setup.run.scheduler`, as batches
    end.

    A batch whose worker is lost is submitted again, `_TIMES` times in all.
    """
    address = setup.run.scheduler
    client = _connect(address)
    from distributed import as_completed
    from distributed.comm.core import CommClosedError

    log = logging.getLogger(_LOG_OF_DASK)
    level = log.level
    # Dask writes a traceback if the scheduler is lost; here that is an InputError
    log.setLevel(logging.CRITICAL)
    try:
        under_way: Any = as_completed(loop=client.loop)  # type: ignore[no-untyped-call]
        # by key of its task: a batch, and how many times it was submitted
        submitted: dict[str, tuple[Batch, int]] = {}
        harness = harness_identity()
        batches = Batches(cases, _threads(client, address), BATCH)

        def submit(batch: Batch, times: int) -> None:
            future = client.submit(run_batch, batch, setup, harness, pure=False)
            submitted[future.key] = batch, times
            under_way.add(future)

        def fill() -> None:
            most = _threads(client, address) * _BATCHES_PER_THREAD
            while len(submitted) < most and not stopping():
                batch = batches.take()
                if batch is None:
                    return
                submit(batch, 1)
                batches.look_ahead()

        fill()
        while submitted:
            future = next(under_way)
            batch, times = submitted.pop(future.key)
            fault = _fault(future)
            if fault is None:
                result = future.result()
                if isinstance(result, str):
                    raise InputError(f"A worker of the Dask cluster {address} {result}.")
                yield list(_counted(result, batches))
            elif times < _TIMES:
                submit(batch, times + 1)
            else:
                yield [
                    Outcome(case, "crashed", None, f"Its worker was lost {times} times: {fault}")
                    for case in batch
                ]
            future.release()
            fill()
    except CommClosedError as error:
        raise _lost(address, error) from error
    finally:
        client.close()
        log.setLevel(level)


def _counted(outcomes: Iterable[Outcome], batches: Batches) -> Iterator[Outcome]:
    """The outcomes, except those of batches of an ADS that keeps state between cases. Once one
    worker finds such an ADS, all cases of this ADS run alone, on any worker.
    """
    for outcome in outcomes:
        why = batches.remark(outcome.case)[0] or outcome.alone
        if why is not None and why.why == "keeps_state":
            batches.rerun_alone(outcome.case.controller, why)
        if not outcome.batched or batches.note_batched(outcome.case):
            yield replace(outcome, alone=why)


def _threads(client: Any, address: str) -> int:
    """Number of threads of the cluster's workers, at least 1.

    Raises InputError if the scheduler does not answer.
    """
    try:
        return max(sum(int(threads) for threads in client.nthreads().values()), 1)
    except OSError as error:
        raise _lost(address, error) from error


def _lost(address: str, error: OSError) -> InputError:
    return InputError(
        f"The Dask scheduler at {address} does not answer any more: {said(error)}. What had ended "
        "is recorded; start a scheduler again and continue with --resume."
    )


def _fault(future: Any) -> str | None:
    """Message of a task that the cluster lost; None if the task returned."""
    if future.status == "finished":
        return None
    return said(future.exception()) if future.status == "error" else str(future.status)


def refuse_without(address: str) -> None:
    """Raise InputError if no scheduler is named or Dask is missing."""
    if not address:
        raise InputError(
            "The engine `dask` needs the address of a scheduler: --scheduler tcp://HOST:8786."
        )
    if find_spec("distributed") is None:
        raise needs_extra("The engine `dask`", "cluster")


def _connect(address: str) -> Any:
    from distributed import Client

    try:
        return Client(  # type: ignore[no-untyped-call]
            address, timeout=_CONNECT_TIME, set_as_default=False
        )
    # the last two: `tls://` without certificates, `tcp://` if the cluster requires encryption
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"There is no Dask scheduler at {address}: {said(error)}.") from error
