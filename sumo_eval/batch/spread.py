"""Work that only computes, spread over child processes; nothing of a user's runs in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from sumo_eval.batch.children import child_context, tie_to_owner

Part = TypeVar("Part")
Result = TypeVar("Result")


def spread(work: Callable[[Part], Result], parts: Sequence[Part], workers: int) -> Iterator[Result]:
    """`work` of every part, in order; `workers` = 1: in this process. The children die with this process."""
    if workers == 1:
        yield from map(work, parts)
        return
    context = child_context()
    lifeline, held = context.Pipe(duplex=False)
    with lifeline, held:
        pool = ProcessPoolExecutor(workers, context, initializer=tie_to_owner, initargs=(lifeline,))
        try:
            yield from pool.map(work, parts)
        finally:
            pool.shutdown(cancel_futures=True)
