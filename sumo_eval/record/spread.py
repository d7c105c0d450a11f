"""Computations spread over child processes, in which no users' code runs. For scores and zones.

Users: `record/facts.py`, `record/human_reference.py`, `scoring/space.py`, `scoring/steps.py`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.record.children import child_context, tie_to_owner

Spread = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Function like `map`: the result of `work` for each part, in order. Other processes may compute
the results; `map` itself computes them in this process.
"""


@contextmanager
def _children(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Child processes, which start when there is work for them and end with this process. The end
    of the block waits for their work; an exception in the block kills them.
    """
    context = child_context()
    lifeline, held = context.Pipe(duplex=False)
    with (
        lifeline,
        held,
        ProcessPoolExecutor(workers, context, tie_to_owner, (lifeline,)) as pool,
    ):
        try:
            yield pool
        except BaseException:
            held.close()  # the kernel kills them (`tie_to_owner`)
            raise


@contextmanager
def spread_over(workers: int) -> Iterator[Spread]:
    """Child processes for any number of rounds of work; the first round starts them.

    workers: number of processes; 1: this process computes.
    """
    if workers == 1:
        yield map
        return
    with _children(workers) as pool:

        def results(work: Callable[[Any], Any], parts: Sequence[Any]) -> Iterator[Any]:
            """Raises InputError if a process of the pool was lost."""
            try:
                yield from pool.map(work, parts)
            except BrokenProcessPool as error:
                raise InputError(
                    "A process that computes scores was killed, as happens when memory runs out. "
                    "Score the run again; `--set run.workers=1` needs the least memory."
                ) from error

        yield results


@contextmanager
def alongside(work: Callable[[], object]) -> Iterator[Callable[[], bool]]:
    """Do `work` in a child process while the block runs.

    Gives the function that returns whether `work` has failed. The caller may then repeat it in this
    process to get its error.
    """
    with _children(1) as pool:
        done = pool.submit(work)
        yield lambda: done.done() and done.exception() is not None
