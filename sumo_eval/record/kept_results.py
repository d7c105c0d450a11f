"""Cache of results computed of a run, beside its facts: parts of bytes, each under a hash of all
that it depends on. `scoring` keeps its results here.

A result depends only on recorded facts, settings and sources, and is kept under their hash. A
caller that finds a result under this hash uses it instead of computing it again. The file may be
deleted: its results are then computed again, except those of discarded trajectories. Every part
also carries a hash of its own content, so that a damaged part is an error, never a number.

Users: `evaluation.py`, `record/`, `report/assessed.py`, `scoring/`.
"""

import hashlib
import sqlite3
import weakref
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

from sumo_eval.errors import InputError

KEPT = "kept.sqlite"
Kind = Literal[
    "evaluation",
    "rows",
    "zones",
    "weights",
    "index",
    "band",
    "left_out",
    "drive",
    "checked",
    "report",
]
KeptPart = tuple[Kind, bytes, int, bytes]
"""Kind, key (hash of all that it depends on), place among the parts of this kind and key, content.

Most results are one part, at place 0; the rows of a run are many.
"""

_VERSION = 3
_HASH_SIZE = 16
_PATIENCE = 30.0  # s that another process may take to write
_SCHEMA = f"""
BEGIN; CREATE TABLE IF NOT EXISTS parts (
    kind TEXT NOT NULL, key BLOB NOT NULL, place INTEGER NOT NULL,
    data BLOB NOT NULL, hash BLOB NOT NULL,
    PRIMARY KEY (kind, key, place)
); PRAGMA user_version = {_VERSION}; COMMIT;
"""
_MEND = (
    "It may be deleted, unless `[run] keep` has discarded trajectories: what it holds is computed "
    "again from the recorded facts."
)


def key_of(*parts: object) -> bytes:
    """The key of whatever depends on these values alone: a hash of how they are written."""
    return hashlib.blake2b(repr(parts).encode(), digest_size=_HASH_SIZE).digest()


class KeptResults:
    """The cache of one run, in a file of its folder.

    If that file cannot be written, new parts go into a temporary file, which lasts as long as this
    object.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / KEPT
        # where to look, in order; parts are put into the first
        self._connections = [_opened(self.path)]
        self._finish = weakref.finalize(self, _close, self._connections)

    def close(self) -> None:
        """Close the file."""
        self._finish()

    def get(self, kind: Kind, key: bytes) -> bytes | None:
        """The content of the part at place 0; None if it is not kept.

        Raises InputError if the part was changed after it was written.
        """
        return next(iter(self.some(kind, key, 0, 1)), None)

    def some(self, kind: Kind, key: bytes, first: int, last: int) -> list[bytes]:
        """Contents of the parts from place `first` to before `last`; an empty list if none is kept.

        All of them were put together, so they are in one file.

        Raises InputError for a changed part, or if a part before another is missing.
        """
        query = (
            "SELECT place, data, hash FROM parts WHERE kind = ? AND key = ? AND place >= ? AND "
            "place < ? ORDER BY place"
        )
        for connection in self._connections:
            parts: list[bytes] = []
            for place, data, noted in self._read(connection, query, (kind, key, first, last)):
                unchanged = isinstance(data, bytes) and noted == _hash(kind, key, place, data)
                if not unchanged or place != first + len(parts):  # second: a lost part
                    raise InputError(
                        f"{self.path} is not as it was written: a part of it was changed. {_MEND}"
                    )
                parts.append(data)
            if parts:
                return parts
        return []

    def put(self, parts: Iterable[KeptPart]) -> None:
        """Keep parts, all of them or none; each replaces the part with its kind, key and place."""
        rows = [
            (kind, key, place, data, _hash(kind, key, place, data))
            for kind, key, place, data in parts
        ]
        try:
            self._write(rows)
        except sqlite3.OperationalError:
            if len(self._connections) > 1:  # this was the temporary one
                raise
            # the folder cannot be written or the disk is full, which loses no score
            self._connections.insert(0, _temporary())
            self._write(rows)
        except sqlite3.Error as error:
            raise InputError(f"{self.path} cannot be written: {error}. {_MEND}") from error

    def _write(self, rows: Iterable[tuple[object, ...]]) -> None:
        with self._connections[0] as connection:
            connection.executemany("INSERT OR REPLACE INTO parts VALUES (?,?,?,?,?)", rows)

    def sizes(self, kind: Kind) -> list[tuple[bytes, int]]:
        """Keys of a kind, with the number of bytes under each; the latest key is the last."""
        query = (
            "SELECT key, sum(length(data)) FROM parts WHERE kind = ? GROUP BY key ORDER BY "
            "max(rowid)"
        )
        return list(self._read(self._connections[0], query, (kind,)))

    def forget(self, keys: Iterable[bytes]) -> None:
        """Delete all parts under these keys."""
        try:
            with self._connections[0] as connection:
                connection.executemany("DELETE FROM parts WHERE key = ?", [(key,) for key in keys])
        except sqlite3.OperationalError:
            pass  # a file that cannot be written keeps its size

    def _read(
        self, connection: sqlite3.Connection, query: str, values: tuple[object, ...]
    ) -> Iterator[Any]:
        try:
            yield from connection.execute(query, values)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise InputError(
                f"{self.path} cannot be read, it was changed or damaged: {error}. {_MEND}"
            ) from error


def _opened(path: Path) -> sqlite3.Connection:
    """The opened file. It is made if it does not exist, and emptied if another version wrote it. If
    it cannot be opened or written, a temporary file replaces it.
    """
    try:  # check_same_thread: a finalizer closes it, in any thread that collects garbage
        connection = sqlite3.connect(path, timeout=_PATIENCE, check_same_thread=False)
    except sqlite3.OperationalError:
        return _temporary()
    try:
        (version,) = connection.execute("PRAGMA user_version").fetchone()
        if version != _VERSION:
            connection.executescript(f"DROP TABLE IF EXISTS parts; {_SCHEMA}")
        connection.execute("PRAGMA synchronous = NORMAL")
        return connection
    except sqlite3.OperationalError:
        connection.close()
        return _temporary()
    except (sqlite3.Error, UnicodeDecodeError) as error:
        connection.close()
        raise InputError(
            f"{path} cannot be read, it was changed or damaged: {error}. {_MEND}"
        ) from error


def _temporary() -> sqlite3.Connection:
    """An empty cache in a temporary file of SQLite, which it removes with the connection."""
    connection = sqlite3.connect("", check_same_thread=False)
    connection.executescript(_SCHEMA)
    return connection


def _close(connections: list[sqlite3.Connection]) -> None:
    for connection in connections:
        connection.close()


def _hash(kind: str, key: bytes, place: int, data: bytes) -> bytes:
    """Hash of a part: its content, and where it belongs."""
    content = hashlib.blake2b(data, digest_size=_HASH_SIZE, key=f"{kind}{place}".encode())
    content.update(key)
    return content.digest()
