"""Process hygiene: a supervisor for every child that runs users' code, and a folder for what
children leave on disk.

The owner is the process whose pool (`record.pool`) starts children. A supervisor is a process
between the owner and one child, and runs no users' code. It is the subreaper (see prctl(2)) of
everything that the child starts: processes that an ADS leaves behind, even in a session of their
own, become the supervisor's children, and it ends them. It also watches the memory of them all, and
ends them when the owner ends.

Users: `record/pool.py`, `record/reads.py`.
"""

import ctypes
import os
import select
import shutil
import signal
import struct
import sys
import tempfile
import time as clock
import traceback
from collections.abc import Callable
from contextlib import suppress
from glob import glob
from pathlib import Path
from typing import NamedTuple, NoReturn

MEGABYTE = 1 << 20
_SET_DEATH_SIGNAL, _SET_SUBREAPER = 1, 36  # options of prctl(2)
_LOOK = 0.1  # s between two looks at the memory
_LEAVE_TIME = 5.0  # s for killed processes to be gone
_REPORT = struct.Struct("<id")  # a `Report` as bytes
SCRATCH_PREFIX = "sumo_eval_pool_"
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096


class Report(NamedTuple):
    """End of a child.

    exitcode: negative: the number of the signal that ended it.
    held: MB of memory, if it was ended because that was too much; else 0.
    """

    exitcode: int
    held: float

    @property
    def words(self) -> str:
        """`died with exit code -9 (SIGKILL)`."""
        name = ""
        if self.exitcode < 0:
            with suppress(ValueError):
                name = f" ({signal.Signals(-self.exitcode).name})"
        return f"died with exit code {self.exitcode}{name}"


def supervise(work: Callable[[], object], leash: int, report: int, memory_limit: float) -> None:
    """Make this process the supervisor of a child that does `work`: wait for the child's end, end
    all processes that it has left, report, and exit. It does not return.

    leash: descriptor of a pipe's reading end; at its end of file the owner has ended, or wants the
        child to end.
    report: descriptor to which the `Report` is written.
    memory_limit: of the child and all that it has started, MB.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the owner handles a Ctrl-C at the terminal
    os.setsid()
    _prctl(_SET_SUBREAPER, 1)
    supervisor = os.getpid()
    child = os.fork()
    if child == 0:
        _work_and_leave(work, supervisor, (leash, report))
    keep_open(leash, report)
    ended = _watch(child, leash, memory_limit)
    _end_family()
    with suppress(OSError):  # the owner may have ended
        os.write(report, _REPORT.pack(*ended))
    os._exit(0)


def _work_and_leave(
    work: Callable[[], object], supervisor: int, descriptors: tuple[int, int]
) -> NoReturn:
    """In the child: do the work and exit, whatever the work raises. So no code of the parent runs
    here.

    supervisor: its process id.
    descriptors: of the supervisor, to be closed here.
    """
    code = 1
    try:
        for descriptor in descriptors:
            os.close(descriptor)
        os.setsid()
        _prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() == supervisor:  # a supervisor that ended earlier sends no signal
            work()
            code = 0
    except BaseException:  # noqa: BLE001 - nothing may leave this function but the exit
        traceback.print_exc()
    finally:
        os._exit(code)


def read_report(descriptor: int) -> Report | None:
    """The report of a supervisor; None when it ended without one."""
    data = os.read(descriptor, _REPORT.size)
    return Report(*_REPORT.unpack(data)) if len(data) == _REPORT.size else None


def _watch(child: int, leash: int, memory_limit: float) -> Report:
    """Wait until the child has ended, the owner wants its end (`leash`), or the child and all that
    it has started hold more memory than they may.
    """
    poll = select.poll()
    poll.register(leash, select.POLLIN)
    if hasattr(os, "pidfd_open"):
        with suppress(OSError):  # an old kernel: then the end is seen at the next look
            poll.register(os.pidfd_open(child), select.POLLIN)
    limit = memory_limit * MEGABYTE
    while True:
        ready = poll.poll(1e3 * _LOOK)  # ms
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return Report(os.waitstatus_to_exitcode(status), 0.0)
        if any(descriptor == leash for descriptor, _ in ready):
            return Report(-signal.SIGKILL, 0.0)
        held = _held(limit)
        if held > limit:
            return Report(-signal.SIGKILL, held / MEGABYTE)


def _end_family() -> None:
    """Kill all descendants of this process until none is left, for at most `_LEAVE_TIME`. A
    descendant whose parent ends becomes a child of this process.
    """
    until = clock.monotonic() + _LEAVE_TIME
    while clock.monotonic() < until:
        for pid in family():
            with suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        clock.sleep(0.0005)


def family(pid: int | None = None) -> list[int]:
    """All descendants of a process, by default of this one."""
    descendants = _children(os.getpid() if pid is None else pid)
    for child in descendants:  # the list grows by the children of each
        descendants += _children(child)
    return descendants


def processor_time(pid: int) -> float:
    """Processor time of all descendants of a process so far, s; 0 without `/proc`."""
    ticks = 0
    for descendant in family(pid):
        with suppress(OSError, IndexError):  # it has ended meanwhile
            # Fields 14 to 17 of proc(5): user and system time of the process and of its children
            # that have ended. The name before `)` may hold spaces, so fields are counted from
            # there.
            spent = Path(f"/proc/{descendant}/stat").read_text().rpartition(")")[2].split()[11:15]
            ticks += sum(map(int, spent))
    return ticks / os.sysconf("SC_CLK_TCK")


def _children(pid: int) -> list[int]:
    children: list[int] = []
    for path in glob(f"/proc/{pid}/task/*/children"):
        with suppress(OSError), open(path) as file:  # it has ended meanwhile
            children += map(int, file.read().split())
    return children


def _held(limit: float) -> float:
    """Memory that all descendants of this process hold, bytes, shared mappings included.

    Resident sets count a shared page once per process. If their sum is over the limit, each page is
    divided among its processes (Pss), which is slower.
    """
    descendants = family()
    held = sum(map(memory, descendants))
    return sum(map(_proportional, descendants)) if held > limit and len(descendants) > 1 else held


def memory(pid: int, column: int = 1) -> float:
    """Memory of a process, bytes; 0 if it has ended.

    column: of `/proc/PID/statm`, the first is 0. 1: resident set; 2: the part of that set that
        belongs to files or is shared; 5: the process's own data, as RLIMIT_DATA counts it.
    """
    with suppress(OSError, IndexError), open(f"/proc/{pid}/statm") as file:
        return float(int(file.read().split()[column]) * _PAGE)
    return 0.0


def _proportional(pid: int) -> float:
    with suppress(OSError), open(f"/proc/{pid}/smaps_rollup") as file:
        for line in file:
            if line.startswith("Pss:"):
                return 1024.0 * int(line.split()[1])
    return memory(pid)  # another user's process, or a kernel without this file


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        if ctypes.CDLL(None, use_errno=True).prctl(option, ctypes.c_ulong(value), 0, 0, 0):
            code = ctypes.get_errno()
            raise OSError(code, f"prctl {option}: {os.strerror(code)}")


def keep_open(*kept: int) -> None:
    """Close every descriptor of this process, except these and the standard ones."""
    last = -1
    for number in sorted({0, 1, 2, *kept}):
        if number > last + 1:  # `os.closerange(0, 0)` would close every descriptor
            os.closerange(last + 1, number)
        last = number
    os.closerange(last + 1, max(os.sysconf("SC_OPEN_MAX"), last + 1))


# --- what children leave on disk ------------------------------------------------------------------


def scratch_folder() -> Path:
    """A new folder for the files of one pool's children; this user's folders whose owner has ended
    are removed first. The folder's name holds the owner (`_owner`).
    """
    place = Path(tempfile.gettempdir())
    this_owner = _owner(os.getpid())
    for folder in place.glob(f"{SCRATCH_PREFIX}*"):
        owner = folder.name.removeprefix(SCRATCH_PREFIX).partition("_")[0]
        if not _has_ended(owner, this_owner) or folder.is_symlink():
            continue
        with suppress(FileNotFoundError):  # another owner that starts now removes it, too
            if folder.lstat().st_uid == os.getuid():
                shutil.rmtree(folder, ignore_errors=True)
    return Path(tempfile.mkdtemp(prefix=f"{SCRATCH_PREFIX}{this_owner}_", dir=place))


def _owner(pid: int) -> str:
    """Process id, start time and PID namespace of an owner, such as `4711-88123-4026531836`.

    Of an unused process id, and on a system without `/proc`, the process id alone: no owner has
    such a name.
    """
    try:
        begun = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
        return f"{pid}-{begun}-{os.stat('/proc/self/ns/pid').st_ino}"
    except (OSError, IndexError):
        return str(pid)


def _has_ended(owner: str, this_owner: str) -> bool:
    """Whether an owner, as `_owner` writes it, has ended for certain: it is of this PID namespace,
    and its process id is unused or of a process with another start time.
    """
    pid, _, rest = owner.partition("-")
    return (
        pid.isdecimal()
        and rest.count("-") == 1
        and rest.rpartition("-")[2] == this_owner.rpartition("-")[2]
        and _owner(int(pid)) != owner
    )
