"""One writer at a time: a file that one process holds locked.

The lock ends with the process, however that ends.

Users: runs (`run_folder`), studies (`extras.studies.trials`) and nights (`night`).
"""

import os
import platform
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from sumo_eval.errors import InputError
from sumo_eval.input_file import writing

LOCK = ".lock"  # of a folder
_LOCKED_BYTE = 1 << 20  # Windows locks bytes: one behind the text, so that others can read it


@contextmanager
def held(path: Path, folder: str, busy: Callable[[str], str]) -> Iterator[None]:
    """Hold the lock file `path`, which names its owner. It and its folder are made if they do not
    exist; the file is removed at the end.

    folder: begins the InputError if the file cannot be made, e.g. `The run folder out`.
    busy: makes the error message if another process holds it, from that owner's name.
    """
    with writing(folder):  # makes an InputError of an OSError
        path.parent.mkdir(parents=True, exist_ok=True)
        file = _locked(path, busy)
    try:
        yield
    finally:
        with suppress(PermissionError):  # Windows keeps an open file; the next holder takes it
            path.unlink(missing_ok=True)  # while still locked: see `_locked`
        os.close(file)


def held_folder(folder: Path) -> AbstractContextManager[None]:
    """Hold the right to write the folder of a run or a study, which is made if it does not exist.

    Raises InputError if another process holds it.
    """
    return held(
        folder / LOCK,
        f"The folder {folder}",
        lambda owner: (
            f"{folder} is being written by another process ({owner}); it has one writer at a time."
        ),
    )


def _locked(path: Path, busy: Callable[[str], str]) -> int:
    """The opened and locked file.

    Its last owner may have removed it between `open` and `_lock`. Then another process would make
    and lock a new file, so this one opens it again.
    """
    now = datetime.now(UTC).isoformat(timespec="seconds")
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            _lock(file)
        except OSError as error:
            owner = os.read(file, _LOCKED_BYTE).decode().strip()
            os.close(file)
            if not isinstance(error, BlockingIOError | PermissionError):
                raise
            # empty: locked, but its owner has written nothing yet
            raise InputError(busy(owner or "starting")) from None
        with suppress(FileNotFoundError):
            if os.path.samestat(path.stat(), os.fstat(file)):
                os.truncate(file, 0)
                os.write(file, f"process {os.getpid()} on {platform.node()} since {now}\n".encode())
                return file
        os.close(file)


def _lock(file: int) -> None:
    """Raises BlockingIOError, on Windows PermissionError, when another process has it."""
    if sys.platform == "win32":
        import msvcrt

        os.lseek(file, _LOCKED_BYTE, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        os.lseek(file, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
