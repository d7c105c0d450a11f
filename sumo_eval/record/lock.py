"""One writer at a time: a file that one process holds locked.

The lock ends with the process, however that ends.

Users: `extras/studies/trials.py`, `nightly/night.py`, `record/run_folder.py`.
"""

import os
import platform
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

from sumo_eval.errors import InputError
from sumo_eval.input_file import writing
from sumo_eval.text import timestamp

LOCK = ".lock"  # of a folder
# Windows locks bytes and lets no other process read them: a byte far behind the file's text
_LOCKED_BYTE = 1 << 20


@contextmanager
def held(path: Path, folder: str, busy: Callable[[str], str]) -> Iterator[None]:
    """Hold the lock file `path`, in which the name of its owner stands. The file and its folder are
    made if they do not exist; the file is removed at the end.

    folder: begins the InputError if the file cannot be made, e.g. `The run folder out`.
    busy: makes the error message if another process holds the file, from the name of that owner.
    """
    with writing(folder, path.parent):  # makes an InputError of an OSError
        file = _locked(path, busy)
    try:
        yield
    finally:
        # On Windows an open file cannot be removed: the next owner takes it over. It is removed
        # while it is still locked, see `_locked`.
        with suppress(PermissionError):
            path.unlink(missing_ok=True)
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
    """Descriptor of the opened and locked file.

    The last owner may remove the file between `open` and `_lock`. The lock of a removed file is
    worthless, as another process would make and lock a new one. So the file is then opened again.
    """
    now = timestamp()
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
