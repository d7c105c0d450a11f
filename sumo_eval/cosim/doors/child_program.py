"""A program of the user's as a child process: started for a case, its words kept, its process group
killed after.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

from sumo_eval.errors import InputError, must_be

_PATIENCE = 0.5  # s of wall time that a program has to end by itself once its case is over
_KEPT = 20_000  # bytes of what a program says that are kept
_PR_SET_PDEATHSIG = 1


def split_command(command: str, folder: Path | None, scheme: str) -> tuple[str, ...]:
    """The words of a command line.

    Raises InputError when there is none, or no such program.
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
    found = (
        (folder or Path.cwd()) / program
        if os.sep in program
        else shutil.which(program, path=search_path())
    )
    if found is None or not os.access(found, os.X_OK) or Path(found).is_dir():
        raise InputError(f"{owner}: there is no program `{program}` that can be run.")
    return words


def search_path() -> str:
    """Where programs are looked for: as usual, and before that in the environment that this one
    runs in, unless another is activated.
    """
    usual = os.environ.get("PATH", os.defpath)
    if (
        sys.prefix == sys.base_prefix
        or os.environ.get("VIRTUAL_ENV")
        or os.environ.get("CONDA_PREFIX")
    ):
        return usual
    return os.pathsep.join([str(Path(sys.executable).parent), usual])


class ChildProgram:
    """A running program.

    With `talks` its stdin and stdout are pipes; else what it prints is kept beside its stderr.
    """

    def __init__(
        self,
        command: Sequence[str],
        folder: Path | None,
        *,
        talks: bool,
        variables: Mapping[str, str] | None = None,
    ) -> None:
        environment = {
            name: value for name, value in os.environ.items() if name != "LIBSUMO_AS_TRACI"
        }
        environment["PATH"] = search_path()
        self._said: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `stop`
        pipe = subprocess.PIPE if talks else subprocess.DEVNULL
        self.process = subprocess.Popen(
            list(command),
            stdin=pipe,
            stdout=subprocess.PIPE if talks else self._said,
            stderr=self._said,
            cwd=folder,
            env=environment | dict(variables or {}),
            start_new_session=True,
            preexec_fn=_die_with_parent if sys.platform == "linux" else None,
        )

    def stop(self) -> str:
        """End the program and everything that it started; what it said."""
        process = self.process
        if process.stdin is not None:
            with contextlib.suppress(OSError):  # it may have closed its end already
                process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_PATIENCE)
        # nobody of the group is left
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
        before = max(self._said.seek(0, os.SEEK_END) - _KEPT, 0)
        self._said.seek(before)
        text = self._said.read().decode("utf-8", errors="replace")
        self._said.close()
        return f"[the first {before} bytes are left out]\n{text}" if before else text

    def ended(self) -> str:
        """How the program ended: `with status 1`; of one that has only closed its output, that it
        did.
        """
        try:
            return f"with status {self.process.wait(_PATIENCE)}"
        except subprocess.TimeoutExpired:
            return "closing its output"

    def kill(self) -> None:
        """End the program and everything that it started, now."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)


def _die_with_parent() -> None:
    """A worker that is killed in the middle of a case leaves no program behind."""
    import ctypes

    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
