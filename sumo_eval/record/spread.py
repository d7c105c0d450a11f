"""Computations spread over child processes, in which no users' code runs. For scores and zones."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from typing import Protocol, TypeVar

from sumo_eval.errors import InputError
from sumo_eval.record.children import child_context, tie_to_owner

Part = TypeVar("Part")
Result = TypeVar("Result")


class Spread(Protocol):
    """`work` of every part, in order, wherever it is done; `map` does it here."""

    def __call__(
        self, work: Callable[[Part], Result], parts: Sequence[Part], /
    ) -> Iterable[Result]:
        """The results."""


@contextmanager
def spread_over(workers: int, prepare: Callable[[], object]) -> Iterator[Spread]:
    """Child processes for any number of rounds of work, which end with this process.

    workers: number of processes; 1: this process computes.
    prepare: what each begins with at once, while the caller does something else.
    """
    if workers == 1:
        yield map
        return
    context = child_context()
    lifeline, held = context.Pipe(duplex=False)
    with lifeline, held:
        pool = ProcessPoolExecutor(workers, context, initializer=tie_to_owner, initargs=(lifeline,))
        try:
            for _ in range(workers):
                pool.submit(prepare)
            yield partial(_results, pool)
        finally:
            pool.shutdown(cancel_futures=True)


def _results(
    pool: ProcessPoolExecutor, work: Callable[[Part], Result], parts: Sequence[Part]
) -> Iterator[Result]:
    """Results from a pool, in the order of the parts.

    Raises InputError if a process of the pool was lost.
    """
    try:
        yield from pool.map(work, parts)
    except BrokenProcessPool as error:
        raise InputError(
            "A process that computes scores was killed, as happens when memory runs out. Score the "
            "run again; `--set run.workers=1` needs the least memory."
        ) from error


@contextmanager
def alongside(work: Callable[[], object]) -> Iterator[Callable[[], bool]]:
    """Do `work` in a child process while the block runs. The end of the block waits for that
    process; an exception in the block kills it.

    Gives the function that returns whether `work` has failed. The caller may then repeat it in this
    process to get its error.
    """
    context = child_context()
    lifeline, held = context.Pipe(duplex=False)
    with lifeline, held:
        child = context.Process(target=_tied, args=(lifeline, work))  # type: ignore[attr-defined]
        child.start()
        try:
            yield lambda: child.exitcode not in (None, 0)
        except BaseException:
            child.kill()
            raise
        finally:
            child.join()


def _tied(lifeline: Connection, work: Callable[[], object]) -> None:
    tie_to_owner(lifeline)
    with suppress(Exception):  # a traceback of this process would tell the user nothing
        work()
        return
    sys.exit(1)
