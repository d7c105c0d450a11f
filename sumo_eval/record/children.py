"""Creation of child processes: warm ones with the simulator loaded, which cannot outlive the
process that started them.

On Linux the fork server makes the children: a process of multiprocessing that has loaded the
simulator. A child never runs the user's script again. A child that only computes leads a process
group of its own, so that a Ctrl-C at the terminal does not reach it. Linux kills it when its
owner's end of the lifeline closes (a watching thread could not run while C code holds the
interpreter's lock). The pool gives a child that runs users' code a supervisor instead.

This file uses two private parts of multiprocessing, tried with Python 3.11. SUMO_EVAL_PLAIN=1
leaves them out. `Child.start` clears the daemon flag of a Dask worker, which could start no child
with it. `cool_down` ends the fork server by its process id when a command is refused: the server
would otherwise load for another 2 s.

Users: `cli/compare.py`, `cli/run.py`, `record/pool.py`, `record/spread.py`.
"""

import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from sumo_eval.errors import InputError, said
from sumo_eval.input_file import working_folder
from sumo_eval.kernels import PLAIN
from sumo_eval.settings.locators import FOLDERS

# never forked from this process, which has threads and state
_KIND = "forkserver" if sys.platform == "linux" else "spawn"
_ordinary: Any = multiprocessing.get_context(_KIND)

# Sets that iterate in the same order in every run, and no hidden threads, whose number would change
# sums by a bit.
_ENVIRONMENT = {
    "PYTHONHASHSEED": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}

# Any value keeps the working folder off the fork server's path. `loaded_loops` deletes the variable
# if it has this value.
_SAFE_PATH = {"PYTHONSAFEPATH": "sumo_eval"}

# held while a child starts: two threads would put each other's changes of this process back
_STARTING = threading.Lock()


class Child(_ordinary.Process):  # type: ignore[misc]
    """A child process.

    A child of multiprocessing normally imports the script that was started. A script without `if
    __name__ == "__main__":` would then run the evaluation again in every child. No child needs
    anything of that script, so `_Popen` hides it.
    """

    asked_for = False  # whether this process has started one

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802 - the name that multiprocessing looks for
        with _STARTING, _users_code_out_of_sight(), _children_environment():
            return _ordinary.Process._Popen(process_obj)

    def start(self) -> None:
        """Start the child, also from a daemonic process such as a Dask worker: the lifeline ends
        the child, so the exit handlers of multiprocessing need not.
        """
        Child.asked_for = True
        process: Any = multiprocessing.current_process()
        config: dict[str, Any] = process._config
        daemon = None if PLAIN else config.pop("daemon", None)
        try:
            super().start()
        finally:
            if daemon is not None:
                config["daemon"] = daemon


class _Context(type(_ordinary)):  # type: ignore[misc]
    Process = Child


def child_context() -> BaseContext:
    """Multiprocessing context from which pools start their children."""
    context = _Context()
    if _KIND == "forkserver":
        context.set_forkserver_preload(["sumo_eval.record.loaded_loops"])
    return cast("BaseContext", context)


def started(target: Callable[..., object], arguments: tuple[object, ...]) -> Any:
    """A child process that has begun `target`.

    Raises InputError when the system refuses it.
    """
    context: Any = child_context()
    process = context.Process(target=target, args=arguments, name="sumo_eval child")
    try:
        process.start()
    except (OSError, EOFError) as error:
        working_folder()  # raises InputError if it was deleted: no process starts there
        raise InputError(f"No child process can be started: {said(error)}.") from error
    return process


def warm_up() -> None:
    """Let the fork server begin to load the simulator, while this process loads what it needs
    itself.

    Nothing waits for it, and where children are spawned there is no fork server.
    """
    child_context()  # it names the modules that the fork server loads
    with _STARTING, _users_code_out_of_sight(), _children_environment():
        pass  # `_children_environment` has started the fork server


def cool_down() -> None:
    """End the fork server if it has made no child: it would load for seconds."""
    # no public name gives the process id
    pid = multiprocessing.forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    if pid is not None and not Child.asked_for and not PLAIN:
        with suppress(OSError):
            os.kill(pid, signal.SIGKILL)


def tie_to_owner(lifeline: Connection) -> None:
    """End this child when its owner ends.

    lifeline: reading end of a pipe whose writing end the owner holds.
    """
    if sys.platform != "win32":
        os.setsid()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "linux":
        threading.Thread(target=_leave_at_end_of, args=(lifeline,), daemon=True).start()
        return
    import fcntl

    # The pipe is opened again, for this child alone. All children share the inherited open file:
    # its owner and signal, set below, would be those of the child that set them last.
    reopened = os.open(f"/proc/self/fd/{lifeline.fileno()}", os.O_RDONLY | os.O_NONBLOCK)
    # at an event of the pipe the system sends SIGKILL to this child's process group
    fcntl.fcntl(reopened, fcntl.F_SETOWN, -os.getpgrp())
    fcntl.fcntl(reopened, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(reopened, fcntl.F_SETFL, os.O_ASYNC | os.O_NONBLOCK)
    if lifeline.poll():  # the owner ended before the signal was set up
        os._exit(1)


def _leave_at_end_of(lifeline: Connection) -> None:
    lifeline.poll(None)
    os._exit(1)


@contextmanager
def _users_code_out_of_sight() -> Iterator[None]:
    """Hide from children the script and the folders of users' files: a child imports only files
    beside its own ADS.
    """
    script = sys.modules["__main__"]
    places = sys.path[:]
    sys.modules["__main__"] = ModuleType("__main__")
    sys.path[:] = [path for path in places if path not in FOLDERS]
    try:
        yield
    finally:
        sys.modules["__main__"], sys.path[:] = script, places


def _begin_forkserver() -> None:
    """Start the fork server so that it ignores a Ctrl-C at the terminal while it loads. A Ctrl-C
    that comes to this process meanwhile acts afterwards.
    """
    # first, because at its end it unblocks SIGINT, which is blocked below
    multiprocessing.resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        multiprocessing.forkserver.ensure_running()
    except OSError as error:  # its socket lies in TMPDIR, under a path of about 100 characters
        raise InputError(
            f"No child process can be started: {said(error)}. Is TMPDIR a short path?"
        ) from error
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _starts_beside_the_package() -> bool:
    """Whether the working folder holds this package; False if the folder is gone."""
    try:
        return Path.cwd() == Path(__file__).parents[2]
    except OSError:
        return False


@contextmanager
def _children_environment() -> Iterator[None]:
    """The environment in which children, or the fork server, start. Variables that the user has set
    stay, except the hash seed.

    The working folder may hold another copy of this package, or a user's files with the names of
    modules. So the fork server imports nothing from it, unless this package itself lies in it.
    """
    wanted = dict(_ENVIRONMENT)
    if _KIND == "forkserver" and not _starts_beside_the_package():
        wanted |= _SAFE_PATH
    before = {name: os.environ.get(name) for name in wanted}
    for name, value in wanted.items():
        if before[name] is None or name == "PYTHONHASHSEED":
            os.environ[name] = value
    try:
        if _KIND == "forkserver":
            _begin_forkserver()
        yield
    finally:
        for name, old in before.items():
            if old is None:
                del os.environ[name]
            else:
                os.environ[name] = old
