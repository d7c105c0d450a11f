"""Results computed of a run, kept beside its facts: parts of bytes, each under a hash of all that
it depends on.

Scores are computed from recorded facts, so computing them again gives the same: a caller that finds
a part under the hash of the facts, settings and sources that it depends on need not. The file may
be deleted, which costs the time to compute it. Every part carries a hash of its own content: a
damaged one is an error, never a number.
"""

from __future__ import annotations

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
    "task",
    "checked",
    "report",
]
Part = tuple[Kind, bytes, int, bytes]
"""Kind, key (all that it depends on), its number among those of one key, and its content."""

_VERSION = 2
_HASH_SIZE = 16
_PATIENCE = 30.0  # s that another process may take to write
_SCHEMA = f"""
BEGIN; CREATE TABLE IF NOT EXISTS parts (
    kind TEXT NOT NULL, key BLOB NOT NULL, place INTEGER NOT NULL,
    data BLOB NOT NULL, hash BLOB NOT NULL,
    PRIMARY KEY (kind, key, place)
); PRAGMA user_version = {_VERSION}; COMMIT;
"""
_MEND = "It may be deleted: what it holds is computed again from the recorded facts."


def key_of(*parts: object) -> bytes:
    """The key of whatever depends on these values alone: a hash of how they are written."""
    return hashlib.blake2b(repr(parts).encode(), digest_size=_HASH_SIZE).digest()


class KeptResults:
    """The file of one run.

    Where it cannot be written, what is put there is kept until this object is gone.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / KEPT
        self._connections = [_opened(self.path)]
        self._finish = weakref.finalize(self, _close, self._connections)

    def close(self) -> None:
        """Close the file."""
        self._finish()

    def get(self, kind: Kind, key: bytes) -> bytes | None:
        """The content of the first part of a key; None where it is not kept.

        Raises InputError for one that is not as it was written.
        """
        return next(iter(self.some(kind, key, 0, 1)), None)

    def some(self, kind: Kind, key: bytes, first: int, last: int) -> list[bytes]:
        """The contents of the parts with these places, in their order, `last` not among them."""
        query = (
            "SELECT place, data, hash FROM parts WHERE kind = ? AND key = ? AND place >= ? AND "
            "place < ? ORDER BY place"
        )
        for connection in self._connections:
            found: list[bytes] = []
            for place, data, known in self._read(connection, query, (kind, key, first, last)):
                whole = isinstance(data, bytes) and known == _hash(kind, key, place, data)
                if not (whole and place == first + len(found)):  # else one before it is lost
                    raise InputError(
                        f"{self.path} is not as it was written: a part of it was changed. {_MEND}"
                    )
                found.append(data)
            if found:
                return found
        return []

    def put(self, parts: Iterable[Part]) -> None:
        """Keep parts, all of them or none; each replaces the part with its kind, key and number."""
        rows = [
            (kind, key, place, data, _hash(kind, key, place, data))
            for kind, key, place, data in parts
        ]
        if not rows:
            return
        try:
            self._write(rows)
        # a folder that cannot be written, a full disk: nothing is kept, no score is lost
        except sqlite3.OperationalError:
            if len(self._connections) > 1:
                raise
            self._connections.insert(0, _fresh())
            self._write(rows)
        except sqlite3.Error as error:
            raise InputError(f"{self.path} cannot be written: {error}. {_MEND}") from error

    def _write(self, rows: Iterable[tuple[object, ...]]) -> None:
        with self._connections[0] as connection:
            connection.executemany("INSERT OR REPLACE INTO parts VALUES (?,?,?,?,?)", rows)

    def sizes(self, kind: Kind) -> list[tuple[bytes, int]]:
        """The keys of a kind and the bytes under each, the one that was put last at the end."""
        query = (
            "SELECT key, sum(length(data)) FROM parts WHERE kind = ? GROUP BY key ORDER BY "
            "max(rowid)"
        )
        return list(self._read(self._connections[0], query, (kind,)))

    def forget(self, keys: Iterable[bytes]) -> None:
        """Take out all that is kept under these keys."""
        try:
            with self._connections[0] as connection:
                connection.executemany("DELETE FROM parts WHERE key = ?", [(key,) for key in keys])
        except sqlite3.OperationalError:
            pass  # what cannot be written stays as large as it is

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
    """The file, made where there is none or where another version wrote it; in memory's place where
    it cannot be.
    """
    try:  # a finalizer closes it, in whichever thread collects garbage
        connection = sqlite3.connect(path, timeout=_PATIENCE, check_same_thread=False)
    except sqlite3.OperationalError:
        return _fresh()
    try:
        (version,) = connection.execute("PRAGMA user_version").fetchone()
        if version != _VERSION:
            connection.executescript(f"DROP TABLE IF EXISTS parts; {_SCHEMA}")
        connection.execute("PRAGMA synchronous = NORMAL")
        return connection
    except sqlite3.OperationalError:
        connection.close()
        return _fresh()
    except (sqlite3.Error, UnicodeDecodeError) as error:
        connection.close()
        raise InputError(
            f"{path} cannot be read, it was changed or damaged: {error}. {_MEND}"
        ) from error


def _fresh() -> sqlite3.Connection:
    """An empty one in a file of SQLite's own, which is gone with the connection."""
    connection = sqlite3.connect("", check_same_thread=False)
    connection.executescript(_SCHEMA)
    return connection


def _close(connections: list[sqlite3.Connection]) -> None:
    for connection in connections:
        connection.close()


def _hash(kind: str, key: bytes, place: int, data: bytes) -> bytes:
    found = hashlib.blake2b(data, digest_size=_HASH_SIZE, key=f"{kind}{place}".encode())
    found.update(key)
    return found.digest()
