"""The SQLite file of a run's facts: opened, read and written with errors in words, and checked.

Every case carries a hash of what is recorded of it (`case_rows.hash_of`). A complete run has a
seal, a hash over all its cases.

Users: `record/run_folder.py`, `record/store.py`.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.record.case_rows import HASH_SIZE, LATER, SCHEMA, Row, hash_of
from sumo_eval.record.sealed import FIX

FORMAT_VERSION = 4

# names of notes in the table `about`
SEAL = "seal"
CONTENT = "content"  # the seal before trajectories were discarded
_DISCARDED = "discarded bytes"
checked_files: set[tuple[str, int, int]] = set()
"""Files that this process has checked as a whole: path, size, time of last change in ns."""

# Damaged cases: those in only one of `facts` and `circumstances`, which both have every case, those
# with a trajectory and no fact, and those with a latency that is not a number.
_DAMAGED = """
SELECT * FROM (SELECT "case" FROM facts EXCEPT SELECT "case" FROM circumstances)
UNION SELECT * FROM (SELECT "case" FROM circumstances EXCEPT SELECT "case" FROM facts)
UNION SELECT * FROM (SELECT "case" FROM trajectories EXCEPT SELECT "case" FROM facts)
UNION SELECT "case" FROM latencies WHERE typeof(latency_median) NOT IN ('real', 'null')
OR typeof(latency_p99) NOT IN ('real', 'null')
OR typeof(latency_reference) NOT IN ('real', 'null') ORDER BY 1
"""
ALL_FACTS = 'SELECT * FROM facts ORDER BY "case"'
DRIVES = 'SELECT vehicle, data FROM trajectories WHERE "case" = ? ORDER BY vehicle'
_UNREADABLE = (sqlite3.Error, UnicodeDecodeError)
"""Exceptions of reading a damaged file. UnicodeDecodeError: SQLite's message about the damage may
hold bytes of the file."""


class FactsFile:
    """A facts file that is open.

    unchecked: the file is vouched for, and a case is checked only when it is read.
    """

    def __init__(self, path: Path, *, create: bool = False) -> None:
        if not create and not path.is_file():
            raise InputError(f"{path.parent} is not a run folder: there is no {path.name} in it.")
        self.path = path
        self._writing = create
        self.unchecked = False
        try:
            self._connection = sqlite3.connect(path)
        except sqlite3.Error as error:
            raise InputError(f"{path} cannot be opened: {error}.") from error
        try:
            self._begin(create)
        except BaseException:
            self._connection.close()
            raise

    def _begin(self, create: bool) -> None:
        execute = self._connection.execute
        try:
            (version,) = execute("PRAGMA user_version").fetchone()
            if create and version == 0:
                self._connection.executescript(
                    f"BEGIN; {SCHEMA} PRAGMA user_version = {FORMAT_VERSION}; COMMIT;"
                )
                version = FORMAT_VERSION
            if version == FORMAT_VERSION:
                # WAL: whole after kill -9; a power cut may cost the last cases, which a resumed run
                # simulates again.
                if create:
                    execute("PRAGMA journal_mode = WAL")
                tables = {name for (name,) in execute("SELECT name FROM sqlite_master")}
                for name in LATER.keys() - tables:  # tables that later versions have added
                    execute(f"CREATE {'' if create else 'TEMP'} TABLE {name} {LATER[name]}")
                execute("PRAGMA synchronous = NORMAL" if create else "PRAGMA query_only = ON")
        except _UNREADABLE as error:
            raise InputError(
                f"{self.path} is not a facts file of a run, or cannot be used: {error}."
            ) from error
        if version == 0:
            raise InputError(
                f"{self.path} is empty or was cut off: it is not a facts file of a run."
            )
        if version != FORMAT_VERSION:
            older = (
                " Older versions carry no hash of their content, or another."
                if 0 < version < FORMAT_VERSION
                else ""
            )
            raise InputError(
                f"{self.path} has format version {version}; this sumo_eval reads version "
                f"{FORMAT_VERSION}.{older} Use the version of sumo_eval that wrote it, or run its "
                "evaluation again into a new folder."
            )

    def close(self) -> None:
        """Close the file; a finished one is a single file that needs no write access to be read."""
        # This may fail on a full disk, or while another process reads: the file then keeps its WAL,
        # with all its facts.
        with suppress(sqlite3.Error):
            if self._writing:
                self._connection.execute("PRAGMA journal_mode = DELETE")
        self._connection.close()

    def _read(
        self, query: str, values: Sequence[object] | Mapping[str, object] = ()
    ) -> Iterator[Any]:
        """The rows of a query. Raises InputError that names the file if SQLite cannot read it."""
        try:
            # not `yield from`, which would close the cursor
            for row in self._connection.execute(query, values):  # noqa: UP028
                yield row
        except _UNREADABLE as error:
            raise InputError(f"{self.path} cannot be read: {error}. {FIX}") from error

    def _first(self, query: str, *values: object) -> Any:
        """The first row of a query; None where it has none."""
        return next(self._read(query, values), None)

    @contextmanager
    def _changes(self) -> Iterator[None]:
        try:
            with self._connection:
                yield
        except sqlite3.IntegrityError:
            raise  # a case is recorded already: `take_over` reports it
        except sqlite3.Error as error:
            # SQLite knows a full disk, but not a full quota
            cause = " or full quota" if str(error) == "disk I/O error" else ""
            raise InputError(
                f"{self.path} cannot be written: {error}{cause}. Earlier results are kept."
            ) from error

    def note(self, name: str, value: str) -> None:
        """Keep a note about the run as a whole, e.g. that it is complete."""
        with self._changes():
            self._connection.execute("INSERT OR REPLACE INTO about VALUES (?,?)", (name, value))

    def noted(self, name: str) -> str:
        """The note under a name; "" if there is none."""
        row = self._first("SELECT value FROM about WHERE name = ?", name)
        return "" if row is None else str(row[0])

    def check(self) -> None:
        """Compare every case with its hash, and all of them with the seal.

        Raises InputError for the first that differs.
        """
        self._first("BEGIN")  # one state of the file for all queries, whatever is written
        try:
            self._compare()
        finally:
            self._connection.rollback()

    def check_all(self) -> None:
        """Check the whole file now, unless that is done."""
        if self.unchecked:
            self.check()
            self.unchecked = False
            checked_files.add(state_of(self.path))

    def _check_one(self, case: str) -> None:
        if not self.unchecked:
            return
        fact = self._first('SELECT * FROM facts WHERE "case" = ?', case)
        circumstance = self._first('SELECT * FROM circumstances WHERE "case" = ?', case)
        drives = list(self._read(DRIVES, (case,)))
        if fact is not None and circumstance is not None:
            self._check_hash(fact, circumstance, drives)
        elif fact is not None or circumstance is not None or drives:  # none: no such case
            raise self._lacking(case)

    def _check_hash(self, fact: Row, circumstance: Row, drives: Sequence[tuple[str, Any]]) -> None:
        *values, digest = circumstance
        whole = all(isinstance(data, bytes) for _, data in drives)
        if not whole or digest != hash_of(fact, values, drives):
            raise InputError(
                f"Case `{fact[0]}` in {self.path} is not as it was recorded: its row or a "
                f"trajectory of it was changed or damaged. {FIX}"
            )

    def _lacking(self, case: str) -> InputError:
        return InputError(
            f"{self.path} is damaged: a part of case `{case}` is missing or is not a number. {FIX}"
        )

    def _compare(self) -> None:
        # before any query: with a damaged index a query would leave out cases silently
        for (words,) in self._read("PRAGMA integrity_check(1)"):
            if words != "ok":
                raise InputError(f"{self.path} is damaged: {words.splitlines()[-1]}. {FIX}")
        for (case,) in self._read(_DAMAGED):
            raise self._lacking(case)
        circumstances = self._read('SELECT * FROM circumstances ORDER BY "case"')
        for fact, circumstance in zip(self._read(ALL_FACTS), circumstances, strict=True):
            self._check_hash(fact, circumstance, list(self._read(DRIVES, fact[:1])))
        before = self.noted(SEAL)
        now = self._sealed()
        if before not in ("", now):
            raise InputError(
                f"{self.path} is damaged: it was complete with {before.partition(' ')[0]} cases "
                f"and holds {now.partition(' ')[0]} now, or other ones. {FIX}"
            )

    def seal(self) -> None:
        """Note how many cases there are, and a hash over the hashes of all."""
        self.note(SEAL, self._sealed())

    def _sealed(self) -> str:
        """The seal: number of cases, a space, the hash over their hashes."""
        cases = 0
        seal = hashlib.blake2b(digest_size=HASH_SIZE)
        for (digest,) in self._read('SELECT hash FROM circumstances ORDER BY "case"'):
            cases += 1
            seal.update(digest)
        return f"{cases} {seal.hexdigest()}"

    @property
    def sealed(self) -> bool:
        """Whether the run is complete."""
        return bool(self.noted(SEAL))

    @property
    def content(self) -> str:
        """Number of cases of a complete run, and a hash over the hashes of all its records; empty
        for an incomplete run.
        """
        return self.noted(CONTENT) or self.noted(SEAL)

    def unseal(self) -> None:
        """Take the seal off, for a run that continues."""
        self.note(SEAL, "")
        self.note(CONTENT, "")

    def discard_trajectories(self, stays: Callable[[str, int], bool]) -> int:
        """Delete the trajectories at all points except the points that stay, in one transaction;
        return the number of cases that lost theirs.

        Rows of facts stay. Each of these cases gets a new hash. `let_go` keeps the old hash,
        because the cache has the results computed from the trajectories under it.

        stays: function of a scenario and a point: whether its trajectories stay.
        """
        content = self.content
        cases = 0
        with self._changes():
            write = self._connection.execute
            for fact in self._read(
                'SELECT * FROM facts WHERE "case" IN (SELECT "case" FROM trajectories)'
            ):
                case, scenario, point = fact[:3]
                if stays(scenario, point):
                    continue
                *circumstance, digest = self._first(
                    'SELECT * FROM circumstances WHERE "case" = ?', case
                )
                write("INSERT OR IGNORE INTO let_go VALUES (?,?)", (case, digest))
                write(
                    'UPDATE circumstances SET hash = ? WHERE "case" = ?',
                    (hash_of(fact, circumstance, ()), case),
                )
                cases += 1
            to_discard = 'FROM trajectories WHERE "case" IN (SELECT "case" FROM let_go)'
            (size,) = self._first(f"SELECT total(length(data)) {to_discard}")
            size = self.discarded_size + int(size)
            write(f"DELETE {to_discard}")
            self._connection.executemany(
                "INSERT OR REPLACE INTO about VALUES (?,?)",
                [(SEAL, self._sealed()), (CONTENT, content), (_DISCARDED, str(size))],
            )
        self._first("VACUUM")  # a file does not shrink by itself
        return cases

    @property
    def discarded_size(self) -> int:
        """Bytes of the trajectories that were discarded."""
        return int(self.noted(_DISCARDED) or 0)


def state_of(path: Path) -> tuple[str, int, int]:
    """Path, size, time of the last change in ns."""
    state = path.stat()
    return str(path.resolve()), state.st_size, state.st_mtime_ns


def is_written(path: Path) -> bool:
    """Whether a process has the file open for writing. Then its content may change while its time
    of last change does not.
    """
    return path.with_name(path.name + "-wal").exists()
