"""Pool of warm child processes in which anything may fail: a fault loses at most the item in which
it happens, and its process.

Each child serves one affinity (a group of items, such as the cases of one ADS) and nothing else. It
has pipes of its own and a supervisor (see `hygiene`), so it cannot reach the results of another
child. Its results are frames that cannot execute anything (see `frames`). What it prints is kept
here up to a length, and never reaches the owner's stdout. Nothing here waits for a child longer
than its deadline. All code of the owner runs in the calling thread.

Users: `record/apart.py`, `record/engines.py`.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import pickle
import selectors
import shutil
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import count
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as ready
from pathlib import Path
from time import monotonic, sleep
from typing import Any, Generic, Literal, NamedTuple, TypeVar

from sumo_eval.errors import InputError
from sumo_eval.frozen import frozen
from sumo_eval.record.children import child_context, started
from sumo_eval.record.frames import FrameError, FrameReader, frame
from sumo_eval.record.hygiene import (
    MEGABYTE,
    Report,
    keep_open,
    memory,
    processor_time,
    read_report,
    scratch_folder,
    supervise,
)
from sumo_eval.record.watch import COPY
from sumo_eval.settings import RunSettings
from sumo_eval.text import clean, clean_log, last_lines

Item = TypeVar("Item")
Settled = TypeVar("Settled")
Task = Callable[[Any, Any], Any]
"""A function of an item and of what all items share, importable by name, with arguments that pickle
can send. It returns plain values, which a frame can carry, or raises InputError."""

How = Literal["done", "refused", "died", "overdue", "overfull", "garbled"]

LOG_END = 7_900  # bytes that are kept of the beginning, and of the end, of an item's output
_READS_AT_ONCE = 16  # reads of one child's output before those of the next child
_LEAVE_TIME = 5.0  # s to wait until a killed process is gone
_COPY_TIME = 0.2  # s to wait for copies that an ADS has forked and that also do the item
_LONGEST_WAIT = 3600.0  # s, of one wait for the children
_LONGEST_REFUSAL = 20_000  # characters of an InputError's text
_PRINTED = 3  # last lines of a log that an InputError shows
_WARNING_SHARE = 0.9  # share of the deadline after which the child prints where it hangs
_LENGTH = struct.Struct("<Q")  # number of bytes of an order, which follows it in the pipe
_CLOSED = "closed its connection"
# share of the memory limit beyond which a child gets no more items: memory that an ADS does not
# release would end a later case
_FULL = 0.8


@frozen
class Ended(Generic[Item]):
    """Outcome of one item.

    how: `done`: with a result. `refused`: by an InputError. `died`: the child ended by itself. Or
        the child was killed, because it was `overdue`, used too much memory (`overfull`), or sent
        no valid frame (`garbled`).
    log: output of the child.
    why: if `refused`, the InputError's text; if `overfull`, the MB used; else words that continue
        "the process that ran the case ...".
    idle: share of the item's wall time in which no processor worked on it.
    """

    item: Item
    how: How
    result: Any
    log: str
    why: str = ""
    idle: float = 0.0


@frozen
class Work(Generic[Item]):
    """Work to do with items.

    task: called with an item and `shared`, in a child.
    result: called with what the task returned and the item, in the owner: makes the item's result.
        If it fails, the child has sent no valid frame.
    affinity: of an item; a child serves items of one affinity only.
    size: number that an item counts for in `items_per_child`: of a batch, its cases.
    """

    task: Task
    shared: Any
    result: Callable[[Any, Item], Any] = lambda values, item: values
    affinity: Callable[[Item], str] = str
    size: Callable[[Item], int] = lambda item: 1


class _Answer(NamedTuple):
    """Content of a child's frame.

    is_last: whether the child ends now.
    twice: whether a forked copy of the child did the item as well.
    refusal: text of an InputError; empty: the item was not refused.
    result: as `Work.result` makes it.
    """

    is_last: bool
    twice: bool
    refusal: str
    result: Any


def _read_answer(work: Work[Item], item: Item, values: Any) -> _Answer:
    """The answer to an item, of the values of its frame."""
    sent = _Answer(*values)
    refusal = clean(sent.refusal, _LONGEST_REFUSAL, lines=True)
    result = None if refusal else work.result(sent.result, item)
    return sent._replace(refusal=refusal, result=result)


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
        """The kept parts, with a line for the bytes that are left out between them."""
        gap = f"\n[{self._left_out} bytes left out]\n".encode() if self._left_out else b""
        return clean_log((self._head + gap + self._tail).decode("utf-8", errors="replace"))


class Pool:
    """Child processes that work on items; a context manager.

    workers: most children at a time.
    limits: wall time of an item (`case_timeout`), memory of a child and all that it starts
        (`memory_limit`).
    items_per_child: a child is replaced after this number of items, so that leftovers of
        controllers cannot pile up in a process.
    """

    def __init__(self, workers: int, limits: RunSettings, items_per_child: int = 1) -> None:
        if not hasattr(os, "fork"):
            raise InputError(
                "Child processes need a system that can fork; on this one, use the engine `serial`."
            )
        self._workers = workers
        self._limits = limits
        self._items_per_child = items_per_child
        self._children: list[_Child] = []
        self._numbers = count(1)  # of items: a frame is accepted for its own item only
        self._last_wait_end = monotonic()  # s

    def __enter__(self) -> Pool:
        # a killed child leaves SUMO's files behind: they are in this folder, which the pool deletes
        self._scratch = scratch_folder()
        return self

    def __exit__(self, *_: object) -> None:
        for child in self._children:
            child.release()
        for child in self._children:
            child.end()
        self._children.clear()
        shutil.rmtree(self._scratch, ignore_errors=True)

    def each(self, work: Work[Item], items: Sequence[Item]) -> Iterator[Ended[Item]]:
        """Outcomes of the items, in their order, once all have ended.

        Raises InputError for the first that is refused, with the end of what it printed.
        """
        waiting = iter(items)
        ends = self.run(work, lambda: next(waiting, None), lambda ended: ended)
        for ended in sorted(ends, key=lambda ended: items.index(ended.item)):
            if ended.how == "refused":
                # code that ends its process on import, as `argparse` does, has printed why
                printed = ended.log and f"\nIt printed:\n{last_lines(ended.log, _PRINTED)}"
                raise InputError(ended.why + printed)
            yield ended

    def run(
        self,
        work: Work[Item],
        take: Callable[[], Item | None],
        settle: Callable[[Ended[Item]], Settled],
        stopping: Callable[[], bool] = lambda: False,
        meanwhile: Callable[[], object] = lambda: None,
    ) -> Iterator[Settled]:
        """Results of `settle` for the items, in the order in which they end.

        take: gives the next item whenever a child is free; None: there is none now, but the outcome
            of a running item may bring more.
        settle: called with each outcome at once; its results are yielded after the free children
            have been given more items.
        stopping: once it is true, no further item is taken.
        meanwhile: called while the children work, before waiting for them.
        """
        busy: list[_Child] = []
        settled: list[Settled] = []
        while True:
            while len(busy) < self._workers and not stopping():
                item = take()
                if item is None:
                    break
                busy.append(self._give(busy, work, item))
            yield from settled
            if not busy:
                return
            meanwhile()
            self._wait(busy)
            settled = []
            for child in list(busy):
                if ended := child.outcome():
                    busy.remove(child)
                    if child.is_last:
                        self._drop(child)
                    settled.append(settle(ended))

    def _give(self, busy: Sequence[_Child], work: Work[Item], item: Item) -> _Child:
        """Give the item to a free child of its affinity; if there is none, to a new child, which
        replaces one of another affinity where all places are taken.
        """
        affinity = work.affinity(item)
        deadline = self._limits.case_timeout
        for child in [it for it in self._children if it not in busy and it.affinity == affinity]:
            # a child that cannot take the item has served its time
            if child.items < self._items_per_child and child.is_quiet():
                with suppress(OSError):  # it has died since the check
                    child.give(work, item, next(self._numbers), deadline)
                    return child
            self._drop(child)
        if len(self._children) >= self._workers:
            self._drop(next(child for child in self._children if child not in busy))
        child = _Child(affinity, self._limits.memory_limit, self._scratch)
        self._children.append(child)
        with suppress(OSError):  # it died at once: `_how_it_ended` reports it
            child.give(work, item, next(self._numbers), deadline)
        return child

    def _wait(self, busy: Sequence[_Child]) -> None:
        """Wait until any child sends something or is overdue, and read what it sends.

        The time between two calls, in which this process ends children and writes results, is added
        to all deadlines.
        """
        away = monotonic() - self._last_wait_end
        watch = selectors.PollSelector()
        for child in busy:
            child.deadline += away
            for watched in child.watched():
                watch.register(*watched)
        wait = min(child.deadline for child in busy) - monotonic()
        for key, _ in watch.select(min(max(wait, 0.0), _LONGEST_WAIT)):
            key.data()  # the function that handles this pipe (`watched`)
        self._last_wait_end = monotonic()

    def _drop(self, child: _Child) -> None:
        self._children.remove(child)
        child.end()


class _Child:
    """One child process, the pipes to it, and its supervisor.

    affinity: of all items that it serves.
    """

    def __init__(self, affinity: str, memory_limit: float, scratch: Path) -> None:
        pipe = partial(child_context().Pipe, duplex=False)
        orders, self._orders = pipe()
        self._results, results = pipe()
        self._output, output = pipe()
        leash, self._leash = pipe()
        self._report, report = pipe()
        if sys.platform == "linux":
            import fcntl

            # the user's limit for pipes may be reached: then a child that prints much waits more
            with suppress(OSError):
                fcntl.fcntl(output.fileno(), fcntl.F_SETPIPE_SZ, MEGABYTE)
        for own in (self._orders, self._results, self._output):
            os.set_blocking(own.fileno(), False)
        self.affinity = affinity
        self.items = 0
        # of the item, s: its deadline and its begin by the clock; processor time used before it
        self.deadline = self._begun = self._used = 0.0
        self.is_last = False  # whether the child ends with its present item
        self._item: Any = None
        self._folder = Path(tempfile.mkdtemp(dir=scratch))
        self._log = BoundedLog()
        self._to_send = memoryview(b"")  # what the pipe for orders has not taken yet
        # bytes: while a child makes a frame, it holds the frame's values twice
        self._longest_frame = 0.5 * MEGABYTE * memory_limit
        # 0: of no item, as the child must not answer yet
        self._reader = FrameReader(0, self._longest_frame)
        self._answer: _Answer | None = None
        self._fault = ""  # what is wrong with that frame; continues "the process that ran ..."
        self._last_report: Report | None = None
        self._reported = False
        pipes = (orders, results, output, leash, report)
        self._process: Any = started(_begin, (pipes, memory_limit, str(self._folder)))
        for end in pipes:
            end.close()

    def is_quiet(self) -> bool:
        """Whether a child without an item is alive and has sent nothing."""
        return not (self._results.closed or ready((self._results, self._report), 0))

    def give(self, work: Work[Any], item: Any, number: int, deadline: float) -> None:
        """Begin to send an item; `_send_rest` later sends the bytes that the pipe cannot take now.

        Raises OSError if the child has ended.

        number: of the item, which its frame must carry.
        deadline: wall time of the item, s.
        """
        order = pickle.dumps(((work.task, item, work.shared), (deadline, number)))
        read = partial(_read_answer, work, item)
        self._item, self._reader = item, FrameReader(number, self._longest_frame, read)
        self._answer = None
        self._fault, self._to_send = "", memoryview(_LENGTH.pack(len(order)) + order)
        self.items += work.size(item)
        self._begun, self._used = monotonic(), processor_time(self._process.pid)
        self.deadline = self._begun + deadline
        self._send()

    def _send(self) -> None:
        with suppress(BlockingIOError):
            while self._to_send:
                self._to_send = self._to_send[os.write(self._orders.fileno(), self._to_send) :]

    def _send_rest(self) -> None:
        try:
            self._send()
        except OSError:  # the child has closed the pipe: `_how_it_ended` reports it
            self._to_send = memoryview(b"")

    def watched(self) -> Iterator[tuple[Connection, int, Callable[[], None]]]:
        """Pipes to watch, each with the event to wait for and what handles it."""
        for pipe, read in (
            (self._report, self._read_report),
            (self._results, self._read_results),
            (self._output, self._read_output),
        ):
            if not pipe.closed:
                yield pipe, selectors.EVENT_READ, read
        if self._to_send:
            yield self._orders, selectors.EVENT_WRITE, self._send_rest

    def outcome(self) -> Ended[Any] | None:
        """Outcome of the child's item; None while it runs."""
        if (end := self._how_it_ended()) is None:
            return None
        how, why = end
        wall = max(monotonic() - self._begun, 1e-9)
        idle = min(max(1.0 - (processor_time(self._process.pid) - self._used) / wall, 0.0), 1.0)
        answer = self._answer if how == "done" else None
        self.is_last = answer is None or answer.is_last or self._reported
        self._read_output()
        log = self._log.text()
        self._log = BoundedLog()
        return Ended(self._item, how, answer and answer.result, log, why, idle)

    def _how_it_ended(self) -> tuple[How, str] | None:
        """`how` and `why` of the item's `Ended`; None while it runs."""
        if self._answer is not None and not self._fault:
            if self._answer.refusal:
                return "refused", self._answer.refusal
            if not self._answer.twice:
                return "done", ""
            self._fault = "forked in a step, and both processes continued the case"
        begun = bool(self._reader.received)
        if self._fault:
            return "garbled", self._fault
        if self._reported:
            if begun:
                return "garbled", "ended amid its result"
            if self._last_report is not None and self._last_report.held:
                return "overfull", f"{self._last_report.held:.0f}"
            return "died", (_CLOSED if self._last_report is None else self._last_report.words)
        if self.deadline <= monotonic():
            if begun:
                return "garbled", "began a result and did not end it"
            # `died` if the pipe was closed without a report of the supervisor; `overdue` needs no
            # words
            return ("died" if self._results.closed else "overdue"), _CLOSED
        return None

    def _read_report(self) -> None:
        self._last_report = read_report(self._report.fileno())
        self._reported = True
        self._read_results()  # a child may end right after it has sent its result

    def _read_results(self) -> None:
        with suppress(BlockingIOError):
            while not self._results.closed and not self._fault:
                data = os.read(self._results.fileno(), MEGABYTE)
                if not data:
                    self._results.close()
                    return
                try:
                    self._answer = self._reader.feed(data)
                except FrameError as error:
                    self._fault = str(error)

    def _read_output(self) -> None:
        """Read what the child has printed, at most `_READS_AT_ONCE` pieces of it."""
        with suppress(BlockingIOError):
            for _ in range(_READS_AT_ONCE):
                if self._output.closed:
                    return
                data = os.read(self._output.fileno(), MEGABYTE)
                if not data:
                    self._output.close()
                self._log.add(data)

    def release(self) -> None:
        """Ask the supervisor to end the child and all that it has started; do not wait for it."""
        self._leash.close()

    def end(self) -> None:
        """End the child; leave no zombie and no file."""
        self.release()
        self._process.join(_LEAVE_TIME)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._read_output()
        for pipe in (self._orders, self._results, self._output, self._report):
            pipe.close()
        shutil.rmtree(self._folder, ignore_errors=True)


# --- in the child ---------------------------------------------------------------------------------


def _begin(pipes: Sequence[Connection], memory_limit: float, scratch: str) -> None:
    """Become the supervisor of a process that works on items."""
    *ends, leash, report = (pipe.fileno() for pipe in pipes)
    supervise(partial(_serve, ends, memory_limit, scratch), leash, report, memory_limit)


def _serve(ends: Sequence[int], memory_limit: float, scratch: str) -> None:
    """Work on items until no more come. An item that leaves a process, a thread, a full memory or a
    changed resource limit behind is the last: these must not disturb further items.

    ends: descriptors of the pipes for orders, results and output.
    """
    import resource

    orders, results, output = ends
    _print_into(output)
    keep_open(orders, results)
    # Limit the process's own data to the memory limit less the shared part (column 2), so that an
    # allocation fails before the supervisor has to end the process.
    pid = os.getpid()
    own_limit = max(int(memory_limit * MEGABYTE - memory(pid, 2)), 1)
    resource.setrlimit(resource.RLIMIT_DATA, (own_limit, own_limit))
    limits_before = _resource_limits()
    tempfile.tempdir = scratch
    faulthandler.enable(file=2)
    c_library = ctypes.CDLL(None)
    forks: list[bool] = []  # has an entry once this process has forked
    os.register_at_fork(after_in_parent=lambda: forks.append(True))
    threads_before = len(sys._current_frames())
    while (head := _read(orders, _LENGTH.size)) and (order := _read(orders, *_LENGTH.unpack(head))):
        (task, item, shared), (deadline, number) = pickle.loads(order)  # noqa: S301 - the owner's
        os.makedirs(scratch, exist_ok=True)  # another ADS may have removed it
        faulthandler.dump_traceback_later(_WARNING_SHARE * deadline, file=2)
        refusal = ""
        answer = None
        try:
            answer = task(item, shared)
        except InputError as error:
            refusal = str(error)
        faulthandler.cancel_dump_traceback_later()
        if os.getpid() != pid:  # this is a copy that the item forked: only the original answers
            os._exit(COPY)
        # flushed here, so that the output belongs to the item that printed it
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):  # an ADS may have replaced them by anything
                stream.flush()
        c_library.fflush(None)
        has_children, twice = _left_processes(patience=_COPY_TIME if forks else 0.0)
        is_last = (
            has_children
            or memory(pid, 5) > _FULL * own_limit  # column 5: own data
            or len(sys._current_frames()) > threads_before
            or _resource_limits() != limits_before
        )
        data = memoryview(frame([is_last, twice, refusal, answer], number))
        while data:
            data = data[os.write(results, data) :]
        if is_last:
            return


def _print_into(pipe: int) -> None:
    """Send all that this process prints into a pipe, line by line."""
    os.dup2(pipe, 1)
    os.dup2(pipe, 2)
    text = partial(open, mode="w", buffering=1, encoding="utf-8", errors="replace", closefd=False)
    sys.stdout, sys.stderr = text(1), text(2)


def _resource_limits() -> list[tuple[int, int]]:
    """All limits of this process, soft and hard."""
    import resource

    return [resource.getrlimit(vars(resource)[it]) for it in dir(resource) if "RLIMIT" in it]


def _read(descriptor: int, size: int) -> bytes:
    """The next `size` bytes from the owner; empty at the end of the pipe."""
    data = bytearray()
    while len(data) < size:
        more = os.read(descriptor, size - len(data))
        if not more:
            return b""
        data += more
    return bytes(data)


def _left_processes(patience: float) -> tuple[bool, bool]:
    """Whether this process has child processes, running or ended; and whether one of them was a
    copy of this process that did the item as well.

    patience: time to wait for the end of running ones, s.
    """
    until = monotonic() + patience
    has_children = twice = False
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return has_children, twice
        has_children = True
        if pid:
            twice = twice or os.waitstatus_to_exitcode(status) == COPY
        elif monotonic() >= until:
            return has_children, twice
        else:
            sleep(0.002)
