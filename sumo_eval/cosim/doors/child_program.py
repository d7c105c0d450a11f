"""A user's program as a child process, for ADSs of `exec:` and `traci:`.

The program is started for a case; its output is kept; its process group is killed after the case.

Users: `cosim/doors/json_lines.py`, `cosim/doors/traci_program.py`.
"""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

from sumo_eval.errors import ControllerError, InputError, must_be, said

_PATIENCE = 0.5  # s of wall time in which a program may end by itself before it is killed
_KEPT = 20_000  # bytes at the end of a program's output that are kept
_PR_SET_PDEATHSIG = 1  # of Linux's prctl.h: the signal at the death of the parent


def checked_command(command: str, folder: Path, scheme: str) -> tuple[str, ...]:
    """The words of a command whose program can be run on this system.

    Raises InputError if there is no command, no such program, or no process groups.

    folder: where the program runs.
    scheme: `exec` or `traci`, for messages.
    """
    owner = f"ADS `{scheme}:{command}`"
    try:
        words = tuple(shlex.split(command))
    except ValueError as error:
        raise must_be(
            "The command", owner, f"one that a shell could split ({error})", command
        ) from None
    if not words:
        raise must_be("The command", owner, "a program and its arguments", command)
    if not hasattr(os, "killpg"):
        raise InputError(f"{owner} needs a system with process groups (Linux, macOS).")
    program = words[0]
    # Joined as text, since a `Path` drops `./`: `which` would then search PATH, as it does for a
    # name without a slash.
    path = os.path.join(folder, program) if os.sep in program else program
    if shutil.which(path, path=search_path()) is None:
        if os.sep in program and os.path.isfile(path):
            raise InputError(
                f"{owner}: the file `{program}` must be executable; `chmod +x` makes it so, or "
                f"name what runs it, e.g. `{scheme}:python3 {command}`."
            )
        is_file = os.path.isfile(os.path.join(folder, program))
        hint = f" Is it `./{program}`, or `{scheme}:python3 {command}`?" if is_file else ""
        raise InputError(f"{owner}: there is no program `{program}` that can be run.{hint}")
    return words


def search_path() -> str:
    """Where to search for programs: the folder of this Python's virtual environment, then PATH;
    PATH alone if the user has activated an environment, or Python is in none.
    """
    usual = os.environ.get("PATH", os.defpath)
    has_environment = sys.prefix != sys.base_prefix
    if not has_environment or os.environ.get("VIRTUAL_ENV") or os.environ.get("CONDA_PREFIX"):
        return usual
    return os.pathsep.join([str(Path(sys.executable).parent), usual])


class ChildProgram:
    """A running program.

    command: from `checked_command`. folder: in which it runs.
    talks: its stdin and stdout are pipes for messages; else it has no input, and its stdout is kept
        together with its stderr.
    variables: of its environment, in addition to the variables of this process.
    """

    def __init__(
        self,
        command: Sequence[str],
        folder: Path,
        *,
        talks: bool,
        variables: Mapping[str, str] = {},
    ) -> None:
        self._output: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `stop`
        try:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE if talks else subprocess.DEVNULL,
                stdout=subprocess.PIPE if talks else self._output,
                stderr=self._output,
                cwd=folder,
                env=_environment(variables),
                start_new_session=True,
                preexec_fn=_die_with_parent if sys.platform == "linux" else None,
            )
        except OSError as error:
            self._output.close()
            raise ControllerError(
                "The ADS's program must be one that the system can start (a script's first line, "
                f"`#!/bin/sh`, ends without a carriage return), got {said(error)}"
            ) from error

    def stop(self) -> str:
        """End the program and everything that it started; return the output that was kept."""
        process = self.process
        if process.stdin is not None:
            with suppress(OSError):  # it may have closed its end already
                process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            process.wait(_PATIENCE)
        self.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
        left_out = max(self._output.seek(0, os.SEEK_END) - _KEPT, 0)
        self._output.seek(left_out)
        text = self._output.read().decode("utf-8", errors="replace")
        self._output.close()
        return f"[the first {left_out} bytes are left out]\n{text}" if left_out else text

    def ended(self, closed: str) -> ControllerError:
        """The error of a program that has ended, or that still runs but has closed a connection.

        closed: name of the connection, for the message: `input`, `output` or `connection`.
        """
        try:
            how = f"with status {self.process.wait(_PATIENCE)}"
        except subprocess.TimeoutExpired:
            how = f"closing its {closed}"
        return ControllerError(f"The ADS's program ended before its case did, {how}")

    def kill(self) -> None:
        """End the program and everything that it started, now."""
        # if the group has no process any more, Linux reports the first error, macOS the second
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)


def _environment(variables: Mapping[str, str]) -> dict[str, str]:
    """Environment of a program: that of this process, with these variables."""
    environment = {**os.environ, "PATH": search_path(), **variables}
    # with this variable a TraCI program would load libsumo instead of connecting
    environment.pop("LIBSUMO_AS_TRACI", None)
    return environment


def _die_with_parent() -> None:
    """Ask Linux to kill this process once the thread that started it ends.

    A worker that is killed in the middle of a case then leaves no program behind.
    """
    import ctypes

    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
