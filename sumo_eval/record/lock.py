"""One writer at a time: a file that one process holds locked.

The lock ends with the process, however that ends.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sumo_eval.errors import InputError
from sumo_eval.input_file import writing

_BEYOND = 1 << 20  # bytes: past all words that a lock file can hold


@contextmanager
def held(path: Path, words: str, folder: str, busy: Callable[[str], str]) -> Iterator[None]:
    """Hold the lock file `path`, made with its folder if need be and taken away at the end.

    words: written into it, who has it.
    folder: begins the InputError where there can be no such file, `The run folder out`.
    busy: makes the InputError where another process holds it, of its words.
    """
    with writing(folder):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = _locked(path, words, busy)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(file)


def _locked(path: Path, words: str, busy: Callable[[str], str]) -> int:
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            _lock(file)
        except OSError:
            os.close(file)
            owner = path.read_text(encoding="utf-8").strip() if path.exists() else ""
            raise InputError(busy(owner or "starting")) from None
        if path.exists() and path.stat().st_ino == os.fstat(file).st_ino:
            os.truncate(file, 0)
            os.write(file, f"{words}\n".encode())
            return file
        os.close(file)  # its last owner has just taken it away


def _lock(file: int) -> None:
    """Raises OSError when another process has it."""
    if sys.platform == "win32":
        import msvcrt

        os.lseek(file, _BEYOND, os.SEEK_SET)  # Windows lets nobody else read a byte that is locked
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        os.lseek(file, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
