"""One writer at a time: a file that one process holds locked. The lock ends with the process, however that ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_BEYOND = 1 << 20  # bytes: past all words that a lock file can hold


class HeldError(Exception):
    """Another process holds the lock. Its text: the words that this one wrote into it, or nothing."""


@contextmanager
def held(path: Path, words: str) -> Iterator[None]:
    """Hold the lock file `path`, made if need be and taken away at the end; `words` say meanwhile who has it.

    Raises HeldError when another process holds it, and OSError when there can be no such file.
    """
    file = _locked(path, words)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(file)


def _locked(path: Path, words: str) -> int:
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            _lock(file)
        except OSError:
            os.close(file)
            raise HeldError(path.read_text(encoding="utf-8").strip() if path.exists() else "") from None
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
