"""A pool of warm child processes in which anything may go wrong: one item costs at most itself and its process.

Each child has pipes of its own, so nothing that a child does or leaves undone can reach another one's results. What a
child prints comes here, bounded, and never to our own stdout. Everything happens in the calling thread.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import shutil
import signal
import sys
import tempfile
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Literal, TypeVar

from sumo_eval.batch.children import child_context, tie_to_owner
from sumo_eval.text import clean_log

Item = TypeVar("Item")
Settled = TypeVar("Settled")
Task = Callable[[Any, Any], Any]
"""A function of the item and of what all items share; importable by name, like both arguments picklable."""

LOG_END = 7_900  # bytes that are kept of the beginning, and of the end, of what an item printed
_MEGABYTE = 1 << 20
_READS_AT_ONCE = 16  # of one child's output, before another one's turn
_LEAVE_TIME = 5.0  # s for a killed process to be gone
_WARNING_SHARE = 0.9  # of the deadline: then the child writes where it hangs


@dataclass(frozen=True, slots=True)
class Ended(Generic[Item]):
    """What became of one item: `done` with a result, `died` with an exit code, or `overdue` and killed."""

    item: Item
    how: Literal["done", "died", "overdue"]
    result: Any
    exitcode: int | None
    log: str


class BoundedLog:
    """Beginning and end of a stream of bytes of any length."""

    def __init__(self) -> None:
        self._head = b""
        self._tail = b""
        self._left_out = 0

    def add(self, data: bytes) -> None:
        """Take in more of the stream."""
        room = LOG_END - len(self._head)
        self._head += data[:room]
        tail = self._tail + data[room:]
        self._left_out += max(len(tail) - LOG_END, 0)
        self._tail = tail[-LOG_END:]

    def text(self) -> str:
        """What is kept of it, with a line in the place of what is not."""
        gap = f"\n[{self._left_out} bytes left out]\n".encode() if self._left_out else b""
        return clean_log((self._head + gap + self._tail).decode("utf-8", errors="replace"))


class Pool:
    """Child processes that work off items, at most `workers` at a time. A context manager.

    deadline: wall time of one item, s. memory_limit: of a child, MB. items_per_child: after that many a child is
    replaced, so that what controllers leave in a process cannot pile up.
    """

    def __init__(self, workers: int, deadline: float, memory_limit: float, items_per_child: int) -> None:
        self._workers = workers
        self._deadline = deadline
        self._memory_limit = memory_limit
        self._items_per_child = items_per_child
        self._children: list[_Child] = []

    def __enter__(self) -> Pool:
        # A child that is killed leaves SUMO's files behind; here they go when the pool does.
        self._scratch = Path(tempfile.mkdtemp(prefix="sumo_eval_pool_"))
        self._lifeline, self._held = child_context().Pipe(duplex=False)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for child in self._children:
            child.end()
        self._children.clear()
        self._held.close()
        self._lifeline.close()
        shutil.rmtree(self._scratch, ignore_errors=True)

    def run(
        self,
        task: Task,
        take: Callable[[], Item | None],
        shared: Any,
        settle: Callable[[Ended[Item]], Settled],
        stopping: Callable[[], bool] = lambda: False,
        size: Callable[[Item], int] = lambda item: 1,
    ) -> Iterator[Settled]:
        """What `settle` makes of the items, as they end. When `stopping`, those that run are the last.

        take: gives the next item whenever a child is free; None: there is none, unless one that runs brings up more.
        settle: is told of every end at once; its results come out when the children have been given more to do.
        size: how many of `items_per_child` an item counts as.
        """
        busy: dict[_Child, Item] = {}
        settled: list[Settled] = []
        while True:
            while len(busy) < self._workers and not stopping():
                item = take()
                if item is None:
                    break
                busy[self._give(busy, task, item, shared, size(item))] = item
            yield from settled
            if not busy:
                return
            settled = []
            for child, ended in self._next_ended(busy):
                del busy[child]
                settled.append(settle(ended))

    def _give(self, busy: dict[_Child, Any], task: Task, item: Any, shared: Any, size: int) -> _Child:
        """Let a free child work on an item; one that has died meanwhile, or served long enough, is replaced."""
        child = next((child for child in self._children if child not in busy), None)
        if child is not None and child.items >= self._items_per_child:
            self._drop(child)
            child = None
        if child is not None:
            try:
                child.give(task, item, shared, self._deadline, size)
            except OSError:
                self._drop(child)
            else:
                return child
        child = _Child(self._lifeline, self._memory_limit, self._scratch)
        self._children.append(child)
        child.give(task, item, shared, self._deadline, size)
        return child

    def _next_ended(self, busy: dict[_Child, Item]) -> list[tuple[_Child, Ended[Item]]]:
        """Wait until something happens; the items that have ended by then, often none."""
        nearest = min(child.deadline for child in busy)
        pipes: dict[Any, _Child] = {}
        for child in busy:
            pipes[child.results] = child
            if child.output is not None:
                pipes[child.output] = child
        ready = wait(list(pipes), max(nearest - clock.monotonic(), 0.0))
        found: list[tuple[_Child, Ended[Item]]] = []
        for pipe in ready:
            child = pipes[pipe]
            if pipe is child.output:
                for _ in range(_READS_AT_ONCE):
                    if not child.read_output():
                        break
        for pipe in ready:
            child = pipes[pipe]
            if pipe is not child.results:
                continue
            result, last, came = child.receive()
            if came:
                log = child.take_log()
                if last:
                    self._drop(child)
                found.append((child, Ended(busy[child], "done", result, None, log)))
            else:
                code = self._drop(child, died=True)
                found.append((child, Ended(busy[child], "died", None, code, child.take_log())))
        ended = {child for child, _ in found}
        now = clock.monotonic()
        for child in busy:
            if child not in ended and child.deadline <= now and not child.results.poll():
                self._drop(child)
                found.append((child, Ended(busy[child], "overdue", None, None, child.take_log())))
        return found

    def _drop(self, child: _Child, *, died: bool = False) -> int | None:
        self._children.remove(child)
        return child.end(died=died)


class _Child:
    """One child process and the pipes to it."""

    def __init__(self, lifeline: Connection, memory_limit: float, scratch: Path) -> None:
        self.results, theirs = child_context().Pipe()
        self.output: Connection | None
        self.output, writing = child_context().Pipe(duplex=False)
        if sys.platform == "linux":
            import fcntl

            with suppress(OSError):  # a user may have no more room for pipes; then a talkative child waits more often
                fcntl.fcntl(writing.fileno(), fcntl.F_SETPIPE_SZ, _MEGABYTE)
        self.items = 0
        self.deadline = 0.0
        self._log = BoundedLog()
        self._process: Any = child_context().Process(  # type: ignore[attr-defined]
            target=_serve, args=(theirs, writing, lifeline, memory_limit, str(scratch)), name="sumo_eval child"
        )
        self._process.start()
        theirs.close()
        writing.close()

    def give(self, task: Task, item: Any, shared: Any, deadline: float, size: int) -> None:
        """Send an item. Raises OSError when the child is no more."""
        self.results.send((task, item, shared, deadline))
        self.items += size
        self.deadline = clock.monotonic() + deadline

    def receive(self) -> tuple[Any, bool, bool]:
        """The result, whether it is the child's last, and whether there was one at all."""
        try:
            result, last = self.results.recv()
        except Exception:  # noqa: BLE001 - end of file, or half a message of a child that died while it sent
            return None, True, False
        return result, last, True

    def read_output(self) -> bool:
        """Take in what the child has printed; False when there is nothing."""
        if self.output is None or not self.output.poll():
            return False
        data = os.read(self.output.fileno(), _MEGABYTE)
        if not data:
            self.output.close()
            self.output = None
            return False
        self._log.add(data)
        return True

    def take_log(self) -> str:
        """What was printed since the last time."""
        while self.read_output():
            pass
        log, self._log = self._log, BoundedLog()
        return log.text()

    def end(self, *, died: bool = False) -> int | None:
        """Kill it and whatever it has started, and leave no zombie. `died`: it ended by itself; then its exit code."""
        if died:
            self._process.join(_LEAVE_TIME)
        code: int | None = self._process.exitcode
        if sys.platform != "win32":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        self._process.join(_LEAVE_TIME)
        while self.read_output():
            pass
        self.results.close()
        if self.output is not None:
            self.output.close()
            self.output = None
        return code


# --- in the child -----------------------------------------------------------------------------------------------------


def _serve(connection: Connection, output: Connection, lifeline: Connection, memory_limit: float, scratch: str) -> None:
    """Work off items until there are no more or something is left behind that another item must not meet."""
    tie_to_owner(lifeline)
    _print_into(output)
    _limit_memory(memory_limit)
    tempfile.tempdir = scratch
    faulthandler.enable(file=2)
    c_library = None if sys.platform == "win32" else ctypes.CDLL(None)
    threads = threading.active_count()
    while True:
        try:
            task, item, shared, deadline = connection.recv()
        except EOFError:
            return
        faulthandler.dump_traceback_later(_WARNING_SHARE * deadline, file=2)
        result = task(item, shared)
        faulthandler.cancel_dump_traceback_later()
        _flush(c_library)
        last = threading.active_count() > threads or _has_children()
        connection.send((result, last))
        if last:
            os._exit(0)


def _print_into(output: Connection) -> None:
    os.dup2(output.fileno(), 1)
    os.dup2(output.fileno(), 2)
    sys.stdout = open(1, "w", buffering=1, encoding="utf-8", errors="replace", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", buffering=1, encoding="utf-8", errors="replace", closefd=False)  # noqa: SIM115


def _flush(c_library: ctypes.CDLL | None) -> None:
    """Let Python's and C's buffers go where the item that filled them is still known."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):  # an ADS may have put anything in their place
            stream.flush()
    if c_library is not None:
        c_library.fflush(None)


def _limit_memory(megabytes: float) -> None:
    if sys.platform != "win32":
        import resource

        limit = int(megabytes * _MEGABYTE)
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))


def _has_children() -> bool:
    """Whether this process has children of its own, running or not."""
    if sys.platform == "win32":
        return False
    try:
        os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        return False
    return True
