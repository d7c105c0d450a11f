"""The facts of a run in one SQLite file: a row a case, its trajectories next to it, each case in
one transaction.

Every case carries a hash of all that is recorded of it, and a complete run a seal over all its
cases. A file is checked against them once in every process that reads it, before the first answer
is taken from it. One that has not changed since it was scored (`vouch`) was checked then: there
each case is checked when it is read, and all of them before many are.
"""

from __future__ import annotations

import hashlib
import json
import marshal
import math
import sqlite3
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from itertools import groupby, takewhile
from pathlib import Path
from sys import intern
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.record.cases import Case, Outcome, Role, Status
from sumo_eval.record.kept import EGO as EGO
from sumo_eval.record.kept import KeptRecording, keep, unpack
from sumo_eval.record.kept_results import KEPT, KeptResults
from sumo_eval.record.reads import LINKS, Told, links
from sumo_eval.trajectory import Alone, Clip, Collision, Trajectory

FORMAT_VERSION = 4

RECORDED = "recorded"
"""Name of the controller of a recorded person's drive, and the setting `drivers.source` that
asks for them."""

_SCHEMA = """
CREATE TABLE IF NOT EXISTS facts (
    "case" TEXT PRIMARY KEY, scenario TEXT NOT NULL, point INTEGER NOT NULL,
    role TEXT NOT NULL, driver TEXT NOT NULL,
    controller TEXT NOT NULL, "values" TEXT NOT NULL, exposure REAL NOT NULL,
    status TEXT NOT NULL, end_reason TEXT,
    error TEXT, simulated_time REAL, collision TEXT, clips TEXT NOT NULL, fingerprint TEXT NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS circumstances (
    "case" TEXT PRIMARY KEY, log TEXT NOT NULL, wall_time REAL, latency_mean REAL, latency_max REAL,
    error_place TEXT NOT NULL, alone TEXT NOT NULL, hash BLOB NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS trajectories (
    "case" TEXT NOT NULL, vehicle TEXT NOT NULL, data BLOB NOT NULL, PRIMARY KEY ("case", vehicle)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS facts_by_point ON facts (scenario, role, point);
"""
_LATER = """
CREATE TABLE IF NOT EXISTS reads (name TEXT PRIMARY KEY, before TEXT NOT NULL, files TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS latencies (
    "case" TEXT PRIMARY KEY, latency_median REAL, latency_p99 REAL, latency_reference REAL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS read_by ("case" TEXT PRIMARY KEY, link INTEGER NOT NULL) WITHOUT ROWID;
"""
_LET_GO = (
    'CREATE TABLE IF NOT EXISTS let_go ("case" TEXT PRIMARY KEY, hash BLOB NOT NULL) WITHOUT ROWID'
)
_TABLES = ("facts", "circumstances", "trajectories")
_SEAL = "seal"
_CONTENT = "content"  # the seal before trajectories were let go
# bytes: damage and edits are found; who can write the file can also write a hash that fits
_HASH_SIZE = 16
# files that this process has checked: path, size, time of last change
_checked: set[tuple[str, int, int]] = set()


_HALVES = """
SELECT * FROM (SELECT "case" FROM facts EXCEPT SELECT "case" FROM circumstances)
UNION SELECT * FROM (SELECT "case" FROM circumstances EXCEPT SELECT "case" FROM facts) ORDER BY 1
"""
Row = Sequence[Any]
_ALL_FACTS = 'SELECT * FROM facts ORDER BY "case"'
_ALL_DRIVES = 'SELECT * FROM trajectories ORDER BY "case", vehicle'
_DRIVES = 'SELECT vehicle, data FROM trajectories WHERE "case" = ? ORDER BY vehicle'
_UNREADABLE = (sqlite3.Error, UnicodeDecodeError)
"""Errors of reading a damaged file: SQLite's own words about it may hold its bytes."""

_MEND = "Take the file from a copy of the run, or run the evaluation again into a new folder."


@dataclass(frozen=True, slots=True)
class Fact:
    """One recorded case, without its trajectories."""

    case: str
    scenario: str
    point: int
    role: Role
    driver: str
    controller: str
    values: Mapping[str, float]
    exposure: float
    status: Status
    end_reason: str | None
    error: str | None
    error_place: str
    log: str
    simulated_time: float | None
    collision: Collision | None
    clips: tuple[Clip, ...]
    wall_time: float | None
    latency_mean: float | None
    latency_max: float | None
    latency_median: float | None
    latency_p99: float | None
    latency_reference: float | None


_COLUMNS = [field.name for field in fields(Fact)]
_TIMES = 3  # of the columns, the last: those of a table that older files have not


class Store:
    """The facts file of one run.

    What differs from run to run - times, printed text - is kept apart from the facts.
    """

    def __init__(self, path: Path, *, create: bool = False) -> None:
        if not create and not path.is_file():
            raise InputError(f"{path.parent} is no run folder: there is no {path.name} in it.")
        self.path = path
        self._writing = create
        self._unchecked = False  # whether what is read must be looked at first
        # cases whose ADS has read files that are not there as they were
        self.stale: frozenset[str] = frozenset()
        self._links: dict[str, int] = {}  # rows of `reads` by their names
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
        try:
            version = self._version()
            if create and version == 0:
                self._connection.executescript(
                    f"BEGIN; {_SCHEMA} PRAGMA user_version = {FORMAT_VERSION}; COMMIT;"
                )
                version = FORMAT_VERSION
            if version == FORMAT_VERSION:
                if create:
                    self._connection.executescript(_LATER)
                # WAL: whole after kill -9; a power cut may cost the last cases, which a resumed run
                # simulates again.
                self._connection.execute(
                    "PRAGMA journal_mode = WAL" if create else "PRAGMA query_only = ON"
                )
                self._connection.execute("PRAGMA synchronous = NORMAL")
        except _UNREADABLE as error:
            raise InputError(
                f"{self.path} is no facts file of a run, or cannot be used: {error}."
            ) from error
        if version == 0:
            raise InputError(f"{self.path} is empty or was cut off: it is no facts file of a run.")
        if version != FORMAT_VERSION:
            older = (
                " Older versions carry no hash of their content, or another."
                if 0 < version < FORMAT_VERSION
                else ""
            )
            raise InputError(
                f"{self.path} has format version {version}; this sumo_eval reads version "
                f"{FORMAT_VERSION}.{older} "
                "Use the version of sumo_eval that wrote it, or run its evaluation again into a "
                "new folder."
            )

    def _version(self) -> int:
        return int(self._connection.execute("PRAGMA user_version").fetchone()[0])

    def close(self) -> None:
        """Close the file; a finished one is a single file that needs no write access to be read."""
        try:
            if self._writing:
                self._connection.execute("PRAGMA journal_mode = DELETE")
        except sqlite3.Error:
            pass  # a full or broken disk, or somebody who reads: the file stays as whole as it is
        finally:
            self._connection.close()

    # -- whole or not ------------------------------------------------------------------------------

    def check(self) -> None:
        """Compare every case with its hash, and all of them with the seal.

        InputError names the first that differs.

        SQLite's own check comes first: an index that lost a row would leave a case out without a
        word.
        """
        # one state of the file for all queries, whoever else may be writing
        for _ in self._read("BEGIN"):
            pass
        try:
            self._compare()
        finally:
            self._connection.rollback()

    def check_what_is_read(self) -> None:
        """Check each case when it is read, and the whole file before many are."""
        self._unchecked = True

    def check_all(self) -> None:
        """Check the whole file now, where only what is read would be."""
        if self._unchecked:
            self.check()
            self._unchecked = False
            _checked.add(_state(self.path))

    def _check_one(self, case: str) -> None:
        if not self._unchecked:
            return
        fact, beside = (
            # our own names
            next(self._read(f'SELECT * FROM {table} WHERE "case" = ?', (case,)), None)  # noqa: S608
            for table in ("facts", "circumstances")
        )
        drives = list(self._read(_DRIVES, (case,)))
        if fact is None and beside is None and not drives:
            return  # no such case: whoever asks says so
        if fact is None or beside is None:
            raise self._lacking(case)
        self._check_hash(fact, beside, drives)

    def _check_hash(self, fact: Row, beside: Row, drives: Sequence[tuple[str, bytes]]) -> None:
        if not all(isinstance(data, bytes) for _, data in drives) or beside[-1] != _hash(
            fact, beside[:-1], drives
        ):
            raise InputError(
                f"Case `{fact[0]}` in {self.path} is not as it was recorded: its row or a "
                "trajectory of it was changed "
                f"or damaged. {_MEND}"
            )

    def _lacking(self, case: str) -> InputError:
        return InputError(f"{self.path} is damaged: a part of case `{case}` is missing. {_MEND}")

    def _compare(self) -> None:
        for (words,) in self._read("PRAGMA integrity_check(1)"):
            if words != "ok":
                raise InputError(f"{self.path} is damaged: {words.splitlines()[-1]}. {_MEND}")
        for (case,) in self._read(_HALVES):
            raise self._lacking(case)
        cases, seal = 0, hashlib.blake2b(digest_size=_HASH_SIZE)
        groups = groupby(self._read(_ALL_DRIVES), key=lambda row: row[0])
        recorded = next(groups, None)
        circumstances = self._read('SELECT * FROM circumstances ORDER BY "case"')
        for fact, beside in zip(self._read(_ALL_FACTS), circumstances, strict=True):
            drives: list[tuple[str, bytes]] = []
            if recorded is not None and recorded[0] == fact[0]:
                drives = [(vehicle, data) for _, vehicle, data in recorded[1]]
                recorded = next(groups, None)
            self._check_hash(fact, beside, drives)
            cases += 1
            seal.update(beside[-1])
        if recorded is not None:
            raise self._lacking(recorded[0])
        sealed = self.noted(_SEAL)
        if sealed and sealed != f"{cases} {seal.hexdigest()}":
            raise InputError(
                f"{self.path} is damaged: it was complete with {sealed.partition(' ')[0]} cases "
                f"and holds {cases} now, "
                f"or other ones. {_MEND}"
            )

    def seal(self) -> None:
        """Note how many cases there are, and a hash over the hashes of all: a complete run misses
        none of them.
        """
        self.note(_SEAL, self._sealed())

    def _sealed(self) -> str:
        cases, seal = 0, hashlib.blake2b(digest_size=_HASH_SIZE)
        for (found,) in self._read('SELECT hash FROM circumstances ORDER BY "case"'):
            cases += 1
            seal.update(found)
        return f"{cases} {seal.hexdigest()}"

    @property
    def sealed(self) -> bool:
        """Whether the run is complete."""
        return bool(self.noted(_SEAL))

    def unseal(self) -> None:
        """Take the seal off, for a run that continues."""
        self.note(_SEAL, "")
        self.note(_CONTENT, "")

    def let_go(self, stays: Callable[[str, int], bool]) -> int:
        """Take out the trajectories at all points, by scenario and number, but those that stay; all
        of it or nothing.

        All else that is recorded stays, with a hash of its own, and the hash of all that was
        recorded stands next to it: what was computed from the trajectories is still known by it.
        How many cases lost theirs comes back.
        """
        content, gone = self.content, 0
        with self._changes():
            write = self._connection.execute
            write(_LET_GO)
            query = (
                'SELECT facts.* FROM facts JOIN (SELECT DISTINCT "case" FROM trajectories) USING '
                '("case")'
            )
            for fact in self._read(query):
                if stays(fact[1], fact[2]):
                    continue
                (beside,) = write(
                    'SELECT * FROM circumstances WHERE "case" = ?', fact[:1]
                ).fetchall()
                write("INSERT OR IGNORE INTO let_go VALUES (?,?)", (fact[0], beside[-1]))
                write(
                    'UPDATE circumstances SET hash = ? WHERE "case" = ?',
                    (_hash(fact, beside[:-1], ()), fact[0]),
                )
                gone += 1
            write('DELETE FROM trajectories WHERE "case" IN (SELECT "case" FROM let_go)')
            for name, value in ((_SEAL, self._sealed()), (_CONTENT, content)):
                write("INSERT OR REPLACE INTO about VALUES (?,?)", (name, value))
        for _ in self._read("VACUUM"):  # a file does not shrink by itself
            pass
        return gone

    def is_let_go(self, case: str) -> bool:
        """Whether the trajectories of a case were taken out after it was scored."""
        return self._hash_before(case) is not None

    def _hash_before(self, case: str) -> bytes | None:
        if not self._has("let_go"):
            return None
        row = next(self._read('SELECT hash FROM let_go WHERE "case" = ?', (case,)), None)
        return None if row is None else bytes(row[0])

    def _has(self, table: str) -> bool:
        return (
            next(self._read("SELECT 1 FROM sqlite_master WHERE name = ?", (table,)), None)
            is not None
        )

    def no_trajectory(self, case: str, vehicle: str = EGO) -> InputError:
        """Why there is no trajectory of a vehicle in a case."""
        if self.is_let_go(case):
            return InputError(
                f"The trajectories of case `{case}` of {self.path.parent} were let go after it "
                "was scored "
                "(`[run] keep`); what was computed of them then is known, anything else needs the "
                "evaluation run again."
            )
        return InputError(
            f"There is no trajectory of `{vehicle}` in case `{case}` of {self.path.parent}."
        )

    def _read(
        self, query: str, values: Sequence[object] | Mapping[str, object] = ()
    ) -> Iterator[Any]:
        """The rows of a query; what SQLite cannot read is an error that names the file."""
        try:
            # `yield from` would close the cursor
            for row in self._connection.execute(query, values):  # noqa: UP028
                yield row
        except _UNREADABLE as error:
            raise InputError(f"{self.path} cannot be read: {error}. {_MEND}") from error

    def add(self, *outcomes: Outcome) -> None:
        """Record cases, each with its row and all its trajectories: all of them or none, in one
        transaction.

        A case of the same name takes the place of one that was recorded with another fingerprint.

        Raises InputError when the file cannot take them in, e.g. because the disk is full.
        """
        recorded = [(outcome, _kept(outcome)) for outcome in outcomes]
        facts = [_fact_row(outcome, kept) for outcome, kept in recorded]
        circumstances = [
            (*row, _hash(fact, row, sorted(kept.drives.items()) if kept else ()))
            for fact, (outcome, kept) in zip(facts, recorded, strict=True)
            for row in (_circumstance_row(outcome, kept),)
        ]
        driven = [(outcome.case.key, kept) for outcome, kept in recorded if kept is not None]
        latencies = [(key, *map(_real, kept.controller_latency[2:])) for key, kept in driven]
        drives = [(key, name, data) for key, kept in driven for name, data in kept.drives.items()]
        with self._changes():
            for outcome in outcomes:
                if self._is_recorded_otherwise(outcome.case):
                    self._remove(outcome.case.key)
                if outcome.reads is not None:
                    row = outcome.case.key, self._link(outcome.reads)
                    self._connection.execute("INSERT OR REPLACE INTO read_by VALUES (?,?)", row)
            self._connection.executemany(
                "INSERT INTO facts VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)", facts
            )
            self._connection.executemany(
                "INSERT INTO circumstances VALUES (?,?,?,?,?,?,?,?)", circumstances
            )
            self._connection.executemany("INSERT INTO latencies VALUES (?,?,?,?)", latencies)
            self._connection.executemany("INSERT INTO trajectories VALUES (?,?,?)", drives)

    def holds(self, case: Case) -> bool:
        """Whether the case is recorded as it would be made now."""
        return case.key not in self.stale and self._fingerprint(case.key) == case.fingerprint

    def _link(self, reads: str) -> int:
        """The row of what was read up to a case, made with those that it builds on where they are
        not there yet.
        """
        new = list(takewhile(lambda link: link not in self._links, links(reads)))
        for link in reversed(new):
            before, files = LINKS[link]
            self._connection.execute(
                "INSERT OR IGNORE INTO reads VALUES (?,?,?)", (link, before, json.dumps(files))
            )
            query = "SELECT rowid FROM reads WHERE name = ?"
            ((self._links[link],),) = self._connection.execute(query, (link,)).fetchall()
        return self._links[reads]

    def reads(self) -> dict[str, Told]:
        """Links of what processes have read: the name of the one before and the files, by name."""
        if not self._has("reads"):
            return {}
        rows = self._read("SELECT name, before, files FROM reads ORDER BY rowid")
        return {
            name: (before, [(path, was) for path, was in json.loads(files)])
            for name, before, files in rows
        }

    def read_by(self) -> Iterator[tuple[str, str, str]]:
        """Case, driver, and the name of what its process had read by then, of the cases of which
        that is known.
        """
        query = (
            'SELECT "case", driver, name FROM read_by JOIN reads ON reads.rowid = link JOIN facts '
            'USING ("case")'
        )
        return self._read(query) if self._has("reads") else iter(())

    def remove(self, cases: Iterable[str]) -> None:
        """Take out cases that are not part of the evaluation any more, as where an ADS or the zones
        have changed.
        """
        gone = list(cases)
        with self._changes():
            for case in gone:
                self._remove(case)

    def _is_recorded_otherwise(self, case: Case) -> bool:
        known = self._fingerprint(case.key)
        return known is not None and (known != case.fingerprint or case.key in self.stale)

    def _fingerprint(self, case: str) -> str | None:
        row = next(self._read('SELECT fingerprint FROM facts WHERE "case" = ?', (case,)), None)
        return None if row is None else str(row[0])

    def _remove(self, case: str) -> None:
        for table in (
            *_TABLES,
            "read_by",
            "latencies",
            *(["let_go"] if self._has("let_go") else []),
        ):
            # our own names
            self._connection.execute(f'DELETE FROM {table} WHERE "case" = ?', (case,))  # noqa: S608

    @contextmanager
    def _changes(self) -> Iterator[None]:
        try:
            with self._connection:
                yield
        except sqlite3.IntegrityError:
            raise  # a case that is there already
        except sqlite3.Error as error:
            raise InputError(
                f"{self.path} cannot be written: {error}. What it holds is kept."
            ) from error

    def difference(self, case: str, other: Store) -> str:
        """Where a case differs from the same case in another store, in words."""
        query = 'SELECT * FROM facts WHERE "case" = ?'
        names = [name for _, name, *_ in self._read("PRAGMA table_info(facts)")]
        a, b = (next(store._read(query, (case,))) for store in (self, other))
        found = [f"{n}: {x!r}, now {y!r}" for n, x, y in zip(names, a, b, strict=True) if x != y]
        return "; ".join(found) or "a trajectory differs"

    # -- about the run -----------------------------------------------------------------------------

    def note(self, name: str, value: str) -> None:
        """Keep a word about the run as a whole, e.g. that it is complete."""
        with self._changes():
            self._connection.execute("INSERT OR REPLACE INTO about VALUES (?,?)", (name, value))

    def noted(self, name: str) -> str:
        """The note under a name, or nothing."""
        row = next(self._read("SELECT value FROM about WHERE name = ?", (name,)), None)
        return "" if row is None else str(row[0])

    def take_over(self, other: Path) -> None:
        """Copy everything recorded in another store of the same format, in one transaction."""
        for _ in self._read("ATTACH ? AS other", (f"{other}",)):
            pass
        try:
            with self._changes():
                for table in _TABLES:
                    copy = f"INSERT INTO {table} SELECT * FROM other.{table}"  # noqa: S608
                    self._connection.execute(copy)
                if (
                    next(
                        self._read("SELECT 1 FROM other.sqlite_master WHERE name = 'latencies'"),
                        None,
                    )
                    is not None
                ):
                    self._connection.execute("INSERT INTO latencies SELECT * FROM other.latencies")
                if (
                    next(self._read("SELECT 1 FROM other.sqlite_master WHERE name = 'reads'"), None)
                    is not None
                ):
                    self._connection.execute(
                        "INSERT OR IGNORE INTO reads SELECT * FROM other.reads"
                    )
                    self._connection.execute(
                        'INSERT INTO read_by SELECT "case", mine.rowid FROM other.read_by '
                        "JOIN other.reads AS its ON its.rowid = link JOIN main.reads AS mine "
                        "USING (name)"
                    )
        except sqlite3.IntegrityError as error:
            raise InputError(
                f"{other.parent} holds a case that is in another part as well: {error}."
            ) from error
        finally:
            self._connection.execute("DETACH other")

    # -- reading -----------------------------------------------------------------------------------

    def facts(
        self, role: Role, scenario: str | None = None, driver: str | None = None
    ) -> list[Fact]:
        """The recorded cases of a role (of one scenario, of one driver), by scenario, point and
        driver.
        """
        return list(self.each_fact(role, scenario, driver))

    def each_fact(
        self, role: Role, scenario: str | None = None, driver: str | None = None
    ) -> Iterator[Fact]:
        """Recorded cases of a role, as `facts` has them, read in order without holding them all."""
        self.check_all()
        where = "role = ? AND scenario = coalesce(?, scenario) AND driver = coalesce(?, driver)"
        return self._facts(f"{where} ORDER BY scenario, point, driver", role, scenario, driver)

    def _facts(self, where: str, *values: object) -> Iterator[Fact]:
        times, joined = ["NULL"] * _TIMES, ""
        if self._has("latencies"):
            times, joined = _COLUMNS[-_TIMES:], ' LEFT JOIN latencies USING ("case")'
        columns = ", ".join([*(f'"{name}"' for name in _COLUMNS[:-_TIMES]), *times])
        table = f'facts LEFT JOIN circumstances USING ("case"){joined}'
        query = f"SELECT {columns} FROM {table} WHERE {where}"  # noqa: S608
        return map(_fact, self._read(query, values))

    def facts_at(self, points: range, role: Role, scenario: str) -> list[Fact]:
        """The recorded cases of a role at the points with these numbers, by point and driver."""
        where = "scenario = ? AND role = ? AND point >= ? AND point < ? ORDER BY point, driver"
        found = list(self._facts(where, scenario, role, points.start, points.stop))
        for fact in found:
            self._check_one(fact.case)
        return found

    def fact(self, case: str) -> Fact | None:
        """One recorded case; None where there is none of that name."""
        self._check_one(case)
        return next(self._facts('facts."case" = ?', case), None)

    def outcomes(self, role: Role, scenario: str) -> Iterator[tuple[int, str, Status, bool]]:
        """Point, driver, status and whether there was a contact, of a role's recorded cases, by
        point and driver.
        """
        query = (
            "SELECT point, driver, status, collision IS NOT NULL FROM facts WHERE role = ? AND "
            "scenario = ? "
            "ORDER BY point, driver"
        )
        for point, driver, status, hit in self._read(query, (role, scenario)):
            yield point, driver, status, bool(hit)

    def drivers_at_points(self, scenario: str, recorded: str) -> Iterator[tuple[int, int, int]]:
        """Point, how many human drives there ended well, and how many of these have the controller
        `recorded`.
        """
        query = (
            "SELECT point, count(*), sum(controller = ?) FROM facts WHERE scenario = ? AND role = "
            "'human' "
            "AND status = 'ok' GROUP BY point ORDER BY point"
        )
        yield from self._read(query, (recorded, scenario))

    def names(self, role: Role, scenario: str | None = None) -> Iterator[tuple[str, int, str]]:
        """Case, point and driver of the recorded cases of a role, of all scenarios or of one."""
        query = (
            'SELECT "case", point, driver FROM facts WHERE role = ? AND scenario = coalesce(?, '
            "scenario)"
        )
        yield from self._read(query, (role, scenario))

    def case_hash(self, case: str) -> bytes:
        """The hash of all that was recorded of a case, as it stands in the file; empty where there
        is none.
        """
        before = self._hash_before(case)
        if before is not None:
            return before
        row = next(self._read('SELECT hash FROM circumstances WHERE "case" = ?', (case,)), None)
        return b"" if row is None else bytes(row[0])

    @property
    def content(self) -> str:
        """How many cases a complete run has, and a hash over the hashes of all that was recorded of
        them; nothing where it is not complete.
        """
        return self.noted(_CONTENT) or self.noted(_SEAL)

    def counts(self) -> list[tuple[str, str, str, str, int, float]]:
        """Scenario, role, driver, status; how many such cases and their exposure.

        Computed by the database.
        """
        query = (
            "SELECT scenario, role, CASE role WHEN 'human' THEN '' ELSE driver END AS who, "
            "status, count(*), "
            "total(exposure) FROM facts GROUP BY scenario, role, who, status ORDER BY scenario, "
            "role, who, status"
        )
        return list(self._read(query))

    def simulated_alone(self, scenario: str, ads: str) -> dict[Alone, int]:
        """How many drives of an ADS, and of those that it is compared with, left their batch, by
        the reason.
        """
        query = (
            'SELECT alone, count(*) FROM facts JOIN circumstances USING ("case") WHERE scenario = '
            ":scenario "
            "AND (role != 'ads' OR driver = :ads) AND alone != '' GROUP BY alone ORDER BY alone"
        )
        found = self._read(query, {"scenario": scenario, "ads": ads})
        return {Alone(**json.loads(alone)): number for alone, number in found}

    def digest(self) -> str:
        """A hash of all facts and trajectories, whatever the order they came in; equal digests,
        equal content.
        """
        self.check_all()
        found = hashlib.sha256()
        for query in (_ALL_FACTS, _ALL_DRIVES):
            for row in self._read(query):
                found.update(repr(row).encode())
        return found.hexdigest()

    def drive(self, case: str, *, whole: bool = True) -> str | None:
        """A hash of what happened in a case, whatever drove it under whatever key; None when it is
        not recorded.

        whole: with its trajectories.
        """
        self._check_one(case)
        query = (
            "SELECT status, end_reason, error, simulated_time, collision, clips FROM facts WHERE "
            '"case" = ?'
        )
        row = next(self._read(query, (case,)), None)
        if row is None:
            return None
        drives = list(self._read(_DRIVES, (case,))) if whole else []
        return hashlib.sha256(repr((row, drives)).encode()).hexdigest()

    def trajectory(self, case: str, vehicle: str = EGO) -> Trajectory:
        """A recorded trajectory of a case."""
        self._check_one(case)
        query = 'SELECT data FROM trajectories WHERE "case" = ? AND vehicle = ?'
        row = next(self._read(query, (case, vehicle)), None)
        if row is None:
            raise self.no_trajectory(case, vehicle)
        return unpack(row[0])

    def trajectories(self, case: str) -> dict[str, Trajectory]:
        """Every vehicle's trajectory of a case, the ego's under `ego`."""
        self._check_one(case)
        return {name: unpack(data) for name, data in self._read(_DRIVES, (case,))}


@contextmanager
def open_store(
    path: Path, *, create: bool = False, checked: bool = False, whole: bool = False
) -> Iterator[Store]:
    """A facts file, checked and closed at the end of the block.

    checked: another process has just done that.
    whole: all of it is checked, also where it was vouched for.

    A file that has not changed since this process checked it is not checked again.
    """
    store = Store(path, create=create)
    try:
        if not checked:
            _check_once(store, whole or create)
        yield store
    finally:
        store.close()


def _check_once(store: Store, whole: bool) -> None:
    if not store.path.is_file():
        return  # in memory
    state = _state(store.path)
    if _is_written(store.path) or state not in _checked:
        if not whole and _vouched(store.path) == state[1:]:
            store.check_what_is_read()
            return
        store.check()
        _checked.add(state)


def _state(path: Path) -> tuple[str, int, int]:
    state = path.stat()
    return str(path.resolve()), state.st_size, state.st_mtime_ns


def _is_written(path: Path) -> bool:
    """Whether a process has it open for writing: then the file's own time does not tell when."""
    return path.with_name(path.name + "-wal").exists()


_FACTS = b"facts"


def vouch(path: Path, kept: KeptResults) -> None:
    """Note that a facts file, as it is, was checked, so that later processes need not look through
    all of it.
    """
    if path.is_file() and not _is_written(path) and (state := _state(path)) in _checked:
        _, size, changed = state
        kept.put([("checked", _FACTS, 0, json.dumps([size, changed]).encode())])


def _vouched(path: Path) -> tuple[int, int] | None:
    """Size and time of the last change of a facts file when it was checked; None where nobody noted
    it.
    """
    if _is_written(path) or not path.with_name(KEPT).is_file():
        return None
    kept = None
    try:
        kept = KeptResults(path.parent)
        noted = kept.get("checked", _FACTS)
    except InputError:
        return None  # a damaged file vouches for nothing
    finally:
        if kept is not None:
            kept.close()
    if noted is None:
        return None
    size, changed = json.loads(noted)
    return int(size), int(changed)


def _hash(
    fact: Sequence[object], circumstance: Sequence[object], drives: Iterable[tuple[str, bytes]]
) -> bytes:
    """A hash of all that is recorded of a case; `drives` in the order of the vehicles' names.

    Trajectories enter by length and CRC-32, which finds every flipped bit in a fifth of the time of
    a longer hash. The row enters in the second format of `marshal`, which has numbers as their
    bits, at a quarter of the cost of `repr`.
    """
    sums = [(vehicle, len(data), zlib.crc32(data)) for vehicle, data in drives]
    row: Any = (*fact, *circumstance, sums)
    return hashlib.blake2b(marshal.dumps(row, 2), digest_size=_HASH_SIZE).digest()


def _real(value: float | None) -> float | None:
    """A number as SQLite gives it back: its own kind, without the sign of a zero, and missing where
    it is not one.
    """
    return None if value is None or math.isnan(value) else float(value) + 0.0


def _kept(outcome: Outcome) -> KeptRecording | None:
    recording = outcome.recording
    return (
        recording if recording is None or isinstance(recording, KeptRecording) else keep(recording)
    )


def _fact_row(outcome: Outcome, kept: KeptRecording | None) -> tuple[object, ...]:
    case = outcome.case
    return (
        case.key,
        case.concrete.scenario,
        int(case.point),
        case.role,
        case.driver,
        case.controller,
        json.dumps(dict(case.concrete.values)),
        _real(case.concrete.exposure),
        outcome.status,
        kept.end_reason if kept else None,
        outcome.error,
        _real(kept.simulated_time) if kept else None,
        json.dumps(_plain(kept.collision)) if kept and kept.collision else None,
        json.dumps([_plain(clip) for clip in kept.clips] if kept else []),
        case.fingerprint,
    )


def _plain(record: Collision | Clip | Alone) -> dict[str, object]:
    """Its fields by name, in their order; `dataclasses.asdict` copies them, at five times the
    cost.
    """
    return {field.name: getattr(record, field.name) for field in fields(record)}


def _circumstance_row(outcome: Outcome, kept: KeptRecording | None) -> tuple[object, ...]:
    times = (kept.wall_time, *kept.controller_latency[:2]) if kept else (None, None, None)
    alone = "" if outcome.alone is None else json.dumps(_plain(outcome.alone))
    return (
        outcome.case.key,
        outcome.log,
        *(_real(time) for time in times),
        outcome.error_place,
        alone,
    )


def _fact(row: tuple[Any, ...]) -> Fact:
    columns = list(row)
    for place, make in _PLACES:
        columns[place] = make(columns[place])
    return Fact(*columns)


def _values(text: str) -> dict[str, float]:
    """The names are the same in all rows of a scenario, and so they shall be in memory."""
    return {intern(name): value for name, value in json.loads(text).items()}


def _collision(text: str | None) -> Collision | None:
    if text is None:
        return None
    plain = json.loads(text)
    channels: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in plain.items()
    }
    return Collision(**channels)


def _clips(text: str) -> tuple[Clip, ...]:
    return tuple(Clip(**clip) for clip in json.loads(text))


_MAKES: dict[str, Callable[[Any], Any]] = {
    "scenario": intern, "driver": intern, "controller": intern, "values": _values,
    "collision": _collision,
    "clips": _clips,
}  # fmt: skip
"""Functions that make a field of a fact out of its column; all other columns are as they are."""
_PLACES = [(_COLUMNS.index(name), make) for name, make in _MAKES.items()]
