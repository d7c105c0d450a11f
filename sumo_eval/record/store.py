"""Facts of a run in one SQLite file: a row for each case, with its trajectories. A case is written
in one transaction.

Every case carries a hash of all that is recorded of it. A complete run has a seal, a hash over all
its cases. Each process compares a file with these hashes once, before it reads anything. `vouch`
notes in the run's cache that a file was checked as a whole. As long as that file does not change,
later processes check less: a case when they read it, and the whole file before they read many.

Users: `cli/`, `evaluation.py`, `nightly/`, `record/`, `report/`, `scoring/`, `whatif/search.py`,
`extras/`.
"""

from __future__ import annotations

import hashlib
import json
import marshal
import os
import sqlite3
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import fields
from itertools import chain
from math import isnan, nan
from pathlib import Path
from sys import intern
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.frozen import frozen
from sumo_eval.input_file import sha256
from sumo_eval.record.cases import Case, Outcome, Role, Status
from sumo_eval.record.kept import EGO as EGO
from sumo_eval.record.kept import KeptRecording, keep, unpack
from sumo_eval.record.kept_results import KEPT, KeptResults
from sumo_eval.record.reads import FileOfAds
from sumo_eval.record.sealed import FIX
from sumo_eval.trajectory import Alone, Clip, Collision, Latency, Recording, Trajectory

FACTS = "facts.sqlite"
"""Name of the facts file in a run's folder."""
FORMAT_VERSION = 4

RECORDED = "recorded"
"""Controller of a recorded driver's drive, and the setting `drivers.source` for such drives."""

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
_LATER = {
    "files_read": "(ads TEXT, path BLOB, hash TEXT NOT NULL, PRIMARY KEY (ads, path))",
    "latencies": '("case" TEXT PRIMARY KEY, latency_median REAL, latency_p99 REAL, '
    "latency_reference REAL) WITHOUT ROWID",
    "let_go": '("case" TEXT PRIMARY KEY, hash BLOB NOT NULL) WITHOUT ROWID',
}
"""Tables that files of earlier versions lack, with their columns. `let_go` has the cases whose
trajectories were discarded: the hash of each case with its trajectories."""
_TABLES = ("facts", "circumstances", "latencies", "trajectories")
# names of notes in the table `about`
_SEAL = "seal"
_CONTENT = "content"  # the seal before trajectories were discarded
_DISCARDED = "discarded bytes"
LEFT_OUT = "left out"
"""Beginning of the names of notes on recorded drives that are left out. A note is JSON of three
numbers: drives that cover too little of the road, the largest share that one of these covers, and
drives that leave the road."""
# table and condition of these notes, for a query after FROM
_NOTES = f"about WHERE name LIKE '{LEFT_OUT} %'"
# bytes; the hash shows damage and careless edits, but a forger of the file can write one that fits
_HASH_SIZE = 16
# files that this process has checked as a whole: path, size, time of last change in ns
_checked: set[tuple[str, int, int]] = set()

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
Row = Sequence[Any]  # one value a column
_HAPPENED = "status", "end_reason", "error", "simulated_time", "collision", "clips"
"""Columns of `facts` that are equal for equal drives, whatever drove them."""
_ALL_FACTS = 'SELECT * FROM facts ORDER BY "case"'
_ALL_DRIVES = 'SELECT "case", vehicle, data FROM trajectories ORDER BY "case", vehicle'
_DRIVES = 'SELECT vehicle, data FROM trajectories WHERE "case" = ? ORDER BY vehicle'
_UNREADABLE = (sqlite3.Error, UnicodeDecodeError)
"""Exceptions of reading a damaged file. UnicodeDecodeError: SQLite's message about the damage may
hold bytes of the file."""


@frozen
class Fact:
    """One recorded case, without its trajectories.

    alone: why the case was simulated alone, an `Alone` as JSON; "": no reason is recorded.
    batched: as in `Recording`.
    wall_time, latency_...: s; `latency_max`, `latency_p99` are `longest`, `late` of `Latency`.
    """

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
    alone: str
    batched: str


_COLUMNS = [field.name for field in fields(Fact)]
# The file's column `alone` holds two fields: why a case was simulated alone, as JSON, or how it
# shared a simulation (`batched`).
_SPLIT = {
    "alone": "CASE WHEN alone LIKE '{%' THEN alone ELSE '' END",
    "batched": "CASE WHEN alone LIKE '{%' THEN '' ELSE alone END",
}
_SELECT_FACTS = (
    # in brackets: SQLite takes a quoted name that it does not know for a text
    f"SELECT {', '.join(_SPLIT.get(it, f'[{it}]') for it in _COLUMNS)} FROM facts "  # noqa: S608
    'LEFT JOIN circumstances USING ("case") LEFT JOIN latencies USING ("case") WHERE '
)


class Store:
    """Facts file of one run.

    Values that differ between equal runs, such as wall times and printed text, are not in the table
    `facts` but in `circumstances` and `latencies`.
    """

    def __init__(self, path: Path, *, create: bool = False) -> None:
        if not create and not path.is_file():
            raise InputError(f"{path.parent} is not a run folder: there is no {path.name} in it.")
        self.path = path
        self._writing = create
        # True: the file is vouched for, and a case is checked only when it is read
        self.unchecked = False
        # locators of ADSs that have read files that have changed since
        self.stale: frozenset[str] = frozenset()
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
        write = self._connection.execute
        try:
            (version,) = write("PRAGMA user_version").fetchone()
            if create and version == 0:
                self._connection.executescript(
                    f"BEGIN; {_SCHEMA} PRAGMA user_version = {FORMAT_VERSION}; COMMIT;"
                )
                version = FORMAT_VERSION
            if version == FORMAT_VERSION:
                # WAL: whole after kill -9; a power cut may cost the last cases, which a resumed run
                # simulates again.
                if create:
                    write("PRAGMA journal_mode = WAL")
                for name in _LATER.keys() - {
                    it for (it,) in write("SELECT name FROM sqlite_master")
                }:
                    write(f"CREATE {'' if create else 'TEMP'} TABLE {name} {_LATER[name]}")
                write("PRAGMA synchronous = NORMAL" if create else "PRAGMA query_only = ON")
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

    # -- whole or not ------------------------------------------------------------------------------

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
            _checked.add(_state(self.path))

    def _check_one(self, case: str) -> None:
        if not self.unchecked:
            return
        fact = self._first('SELECT * FROM facts WHERE "case" = ?', case)
        circumstance = self._first('SELECT * FROM circumstances WHERE "case" = ?', case)
        drives = list(self._read(_DRIVES, (case,)))
        if fact is not None and circumstance is not None:
            self._check_hash(fact, circumstance, drives)
        elif fact is not None or circumstance is not None or drives:  # none: no such case
            raise self._lacking(case)

    def _check_hash(self, fact: Row, circumstance: Row, drives: Sequence[tuple[str, Any]]) -> None:
        *values, digest = circumstance
        whole = all(isinstance(data, bytes) for _, data in drives)
        if not whole or digest != _hash(fact, values, drives):
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
        for fact, circumstance in zip(self._read(_ALL_FACTS), circumstances, strict=True):
            self._check_hash(fact, circumstance, list(self._read(_DRIVES, fact[:1])))
        before = self.noted(_SEAL)
        now = self._sealed()
        if before not in ("", now):
            raise InputError(
                f"{self.path} is damaged: it was complete with {before.partition(' ')[0]} cases "
                f"and holds {now.partition(' ')[0]} now, or other ones. {FIX}"
            )

    def seal(self) -> None:
        """Note how many cases there are, and a hash over the hashes of all."""
        self.note(_SEAL, self._sealed())

    def _sealed(self) -> str:
        """The seal: number of cases, a space, the hash over their hashes."""
        cases = 0
        seal = hashlib.blake2b(digest_size=_HASH_SIZE)
        for (digest,) in self._read('SELECT hash FROM circumstances ORDER BY "case"'):
            cases += 1
            seal.update(digest)
        return f"{cases} {seal.hexdigest()}"

    @property
    def sealed(self) -> bool:
        """Whether the run is complete."""
        return bool(self.noted(_SEAL))

    def unseal(self) -> None:
        """Take the seal off, for a run that continues."""
        self.note(_SEAL, "")
        self.note(_CONTENT, "")

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
                    (_hash(fact, circumstance, ()), case),
                )
                cases += 1
            to_discard = 'FROM trajectories WHERE "case" IN (SELECT "case" FROM let_go)'
            (size,) = self._first(f"SELECT total(length(data)) {to_discard}")
            size = self.discarded_size + int(size)
            write(f"DELETE {to_discard}")
            self._connection.executemany(
                "INSERT OR REPLACE INTO about VALUES (?,?)",
                [(_SEAL, self._sealed()), (_CONTENT, content), (_DISCARDED, str(size))],
            )
        self._first("VACUUM")  # a file does not shrink by itself
        return cases

    @property
    def discarded_size(self) -> int:
        """Bytes of the trajectories that were discarded."""
        return int(self.noted(_DISCARDED) or 0)

    def is_discarded(self, case: str) -> bool:
        """Whether the trajectories of a case were deleted after it was scored."""
        return self._first('SELECT 1 FROM let_go WHERE "case" = ?', case) is not None

    def no_trajectory(self, case: str) -> InputError:
        """Error that says why a case has no trajectories."""
        if self.is_discarded(case):
            return InputError(
                f"The trajectories of case `{case}` of {self.path.parent} were discarded after it "
                "was scored (`[run] keep`); what was computed of them then is known, anything else "
                "needs the evaluation run again."
            )
        return InputError(f"There is no trajectory of case `{case}` in run {self.path.parent}.")

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

    # -- writing -----------------------------------------------------------------------------------

    def add(self, *outcomes: Outcome) -> None:
        """Record cases, each with its row and all its trajectories: all of them or none.

        A case replaces one of the same name that was recorded with another fingerprint.

        Raises InputError when the file cannot take them in, e.g. because the disk is full.
        """
        tables = list(zip(*map(_rows, outcomes), strict=True))
        with self._changes():
            for outcome in outcomes:
                key = outcome.case.key
                if self._fingerprint(key) is not None and not self.holds(outcome.case):
                    self._remove(key)
            # `tables` is empty where there are no outcomes
            for table, rows in zip(_TABLES, tables, strict=False):
                self._insert(table, chain.from_iterable(rows))

    def _insert(self, table: str, rows: Iterator[Row]) -> None:
        for row in rows:  # once: the first row shows how many columns there are
            query = f"INSERT INTO {table} VALUES ({','.join('?' * len(row))})"  # noqa: S608
            self._connection.executemany(query, chain((row,), rows))

    def holds(self, case: Case) -> bool:
        """Whether the case is recorded with the fingerprint that it has now, and of an ADS that is
        not stale.
        """
        stale = case.role == "ads" and case.controller in self.stale
        return not stale and self._fingerprint(case.key) == case.fingerprint

    def note_files(self, files: Iterable[FileOfAds]) -> None:
        """Note files that ADSs have read."""
        rows = [(locator, os.fsencode(path), digest) for locator, path, digest in files]
        with self._changes():
            self._connection.executemany("INSERT OR REPLACE INTO files_read VALUES (?,?,?)", rows)

    def files_read(self) -> Iterator[FileOfAds]:
        """Files that ADSs have read."""
        for locator, path, digest in self._read("SELECT * FROM files_read ORDER BY path"):
            yield locator, os.fsdecode(path), digest

    def driven_by(self, locator: str) -> list[tuple[str, str]]:
        """Case and ADS of the recorded cases with this locator."""
        return list(
            self._read(
                """SELECT "case", driver FROM facts WHERE role = 'ads' AND controller = ?""",
                (locator,),
            )
        )

    def remove_stale(self) -> None:
        """Remove the cases of stale ADSs, and the notes on files that these have read."""
        with self._changes():
            for locator in self.stale:
                for case, _ in self.driven_by(locator):
                    self._remove(case)
                self._connection.execute("DELETE FROM files_read WHERE ads = ?", (locator,))
        self.stale = frozenset()

    def remove(self, cases: Iterable[str]) -> None:
        """Remove cases, e.g. those that the evaluation does not have any more."""
        keys = list(cases)
        with self._changes():
            for case in keys:
                self._remove(case)

    def _fingerprint(self, case: str) -> str | None:
        row = self._first('SELECT fingerprint FROM facts WHERE "case" = ?', case)
        return None if row is None else str(row[0])

    def _remove(self, case: str) -> None:
        for table in (*_TABLES, "let_go"):
            # our own names
            self._connection.execute(f'DELETE FROM {table} WHERE "case" = ?', (case,))  # noqa: S608

    @contextmanager
    def _changes(self) -> Iterator[None]:
        try:
            with self._connection:
                yield
        except sqlite3.IntegrityError:
            raise  # a case is recorded already: `take_over` reports it
        except sqlite3.Error as error:
            raise InputError(
                f"{self.path} cannot be written: {error}. Earlier results are kept."
            ) from error

    def difference(self, outcome: Outcome) -> str:
        """Differences of a drive from the recorded drive of its case, in words; "" if both are the
        same. Trajectories that were discarded are not compared.
        """
        case = outcome.case.key
        self._check_one(case)
        (now,), *_, drives = _rows(outcome)
        before = self._first('SELECT * FROM facts WHERE "case" = ?', case)
        names = [name for _, name, *_ in self._read("PRAGMA table_info(facts)")]
        words = [
            f"{name}: {was!r}, now {value!r}"
            for name, was, value in zip(names, before, now, strict=True)
            if was != value and name in _HAPPENED
        ]
        recorded = [(case, *drive) for drive in self._read(_DRIVES, (case,))]
        if not words and recorded != drives and not self.is_discarded(case):
            words = ["a trajectory differs"]
        return "; ".join(words)

    def note(self, name: str, value: str) -> None:
        """Keep a note about the run as a whole, e.g. that it is complete."""
        with self._changes():
            self._connection.execute("INSERT OR REPLACE INTO about VALUES (?,?)", (name, value))

    def noted(self, name: str) -> str:
        """The note under a name; "" if there is none."""
        row = self._first("SELECT value FROM about WHERE name = ?", name)
        return "" if row is None else str(row[0])

    def left_out(self) -> list[tuple[int, float, int]]:
        """The notes of `LEFT_OUT`, one of each scenario and shard."""
        return [json.loads(*row) for row in self._read(f"SELECT value FROM {_NOTES}")]  # noqa: S608

    def take_over(self, other: Path) -> None:
        """Copy everything recorded in another run of the same format, in one transaction.

        other: its folder.
        """
        try:
            with open_store(other) as part, self._changes():
                for rows in (*_TABLES, _NOTES):  # a table, or a table WHERE a condition holds
                    self._insert(rows.split()[0], part._read(f"SELECT * FROM {rows}"))  # noqa: S608
                for file in part._read("SELECT * FROM files_read"):
                    # the hash becomes `?` (`reads.UNKNOWN`) if shards have read different versions
                    self._connection.execute(
                        "INSERT INTO files_read VALUES (?,?,?) ON CONFLICT DO UPDATE SET hash = "
                        "iif(hash = excluded.hash, hash, '?')",
                        file,
                    )
        except sqlite3.IntegrityError as error:
            raise InputError(
                f"{other} holds a case that is in another part as well: {error}."
            ) from error

    # -- reading -----------------------------------------------------------------------------------

    def facts(self, role: Role, scenario: str | None = None) -> Iterator[Fact]:
        """Recorded cases of a role (in one scenario), by scenario, point and driver, one at a
        time.
        """
        self.check_all()
        return self._facts(
            "role = ? AND scenario = coalesce(?, scenario) ORDER BY scenario, point, driver",
            role,
            scenario,
        )

    def _facts(self, where: str, *values: object) -> Iterator[Fact]:
        for row in self._read(_SELECT_FACTS + where, values):
            columns = list(row)
            for index, make in _PLACES:
                columns[index] = make(columns[index])
            yield Fact(*columns)

    def facts_at(self, points: range, role: Role, scenario: str) -> list[Fact]:
        """Recorded cases of a role at the points with these numbers, by point and driver."""
        where = "scenario = ? AND role = ? AND point >= ? AND point < ? ORDER BY point, driver"
        facts = list(self._facts(where, scenario, role, points.start, points.stop))
        for fact in facts:
            self._check_one(fact.case)
        return facts

    def driven_at(self, scenario: str, point: int, *roles: Role) -> list[Fact]:
        """Drives of roles at a point that ended well and whose trajectories are there."""
        points = range(point, point + 1)
        drives = chain.from_iterable(self.facts_at(points, role, scenario) for role in roles)
        return [it for it in drives if it.status == "ok" and not self.is_discarded(it.case)]

    def fact(self, case: str) -> Fact | None:
        """One recorded case; None where there is none of that name."""
        self._check_one(case)
        return next(self._facts('facts."case" = ?', case), None)

    def outcomes(self, role: Role, scenario: str) -> Iterator[tuple[int, str, Status, bool]]:
        """Point, driver, status and whether there was a contact, of a role's cases, by point and
        driver.
        """
        return self._read(
            "SELECT point, driver, status, collision IS NOT NULL FROM facts WHERE role = ? AND "
            "scenario = ? ORDER BY point, driver",
            (role, scenario),
        )

    def drivers_at_points(self, scenario: str) -> Iterator[tuple[int, int, int]]:
        """Point, how many human drives ended well there, and how many of these were recorded."""
        return self._read(
            "SELECT point, count(*), sum(controller = ?) FROM facts WHERE scenario = ? AND role = "
            "'human' AND status = 'ok' GROUP BY point ORDER BY point",
            (RECORDED, scenario),
        )

    def names(self, role: Role, scenario: str | None = None) -> Iterator[tuple[str, int, str]]:
        """Case, point and driver of the recorded cases of a role, of all scenarios or of one."""
        return self._read(
            'SELECT "case", point, driver FROM facts WHERE role = ? AND scenario = coalesce(?, '
            "scenario)",
            (role, scenario),
        )

    def case_hash(self, case: str) -> bytes:
        """The hash of all that was recorded of a case, with trajectories that were discarded since;
        empty where there is none.
        """
        row = self._first(
            "SELECT coalesce(let_go.hash, circumstances.hash) FROM circumstances LEFT JOIN let_go "
            'USING ("case") WHERE "case" = ?',
            case,
        )
        return b"" if row is None else bytes(row[0])

    @property
    def content(self) -> str:
        """Number of cases of a complete run, and a hash over the hashes of all its records; empty
        for an incomplete run.
        """
        return self.noted(_CONTENT) or self.noted(_SEAL)

    def counts(self) -> list[tuple[str, str, str, str, int, float]]:
        """Scenario, role, driver, status; how many such cases and their exposure.

        Human drivers count together, with "" as driver.
        """
        return list(
            self._read(
                "SELECT scenario, role, CASE role WHEN 'human' THEN '' ELSE driver END AS who, "
                "status, count(*), total(exposure) FROM facts GROUP BY scenario, role, who, status "
                "ORDER BY scenario, role, who, status"
            )
        )

    def simulated_alone(self, scenario: str, ads: str) -> dict[Alone, int]:
        """Number of drives that were simulated alone, by reason: drives of an ADS, and drives that
        the ADS is compared with.
        """
        rows = self._read(
            'SELECT alone, count(*) FROM facts JOIN circumstances USING ("case") WHERE scenario = '
            "? AND (role != 'ads' OR driver = ?) AND alone LIKE '{%' GROUP BY alone ORDER BY alone",
            (scenario, ads),
        )
        return {Alone(**json.loads(alone)): number for alone, number in rows}

    def digest(self) -> str:
        """A hash of all facts and trajectories, in whatever order they were added."""
        self.check_all()
        digest = hashlib.sha256()
        for row in chain(self._read(_ALL_FACTS), self._read(_ALL_DRIVES)):
            digest.update(repr(row).encode())
        return digest.hexdigest()

    def drive(self, case: str, *, whole: bool = True) -> str | None:
        """A hash of what happened in a case, whatever drove it; None when it is not recorded.

        whole: with its trajectories.
        """
        self._check_one(case)
        row = self._first(
            f'SELECT {", ".join(_HAPPENED)} FROM facts WHERE "case" = ?',  # noqa: S608
            case,
        )
        if row is None:
            return None
        drives = list(self._read(_DRIVES, (case,))) if whole else []
        return sha256(repr((row, drives)))

    def trajectory(self, case: str) -> Trajectory:
        """The ego's recorded trajectory of a case."""
        self._check_one(case)
        row = self._first(
            'SELECT data FROM trajectories WHERE "case" = ? AND vehicle = ?', case, EGO
        )
        if row is None:
            raise self.no_trajectory(case)
        return unpack(row[0])

    def trajectories(self, case: str) -> dict[str, Trajectory]:
        """Every vehicle's trajectory of a case, the ego's under `ego`."""
        self._check_one(case)
        return {name: unpack(data) for name, data in self._read(_DRIVES, (case,))}


@contextmanager
def open_store(
    run: Path, *, create: bool = False, checked: bool = False, whole: bool = False
) -> Iterator[Store]:
    """The facts file in a run's folder, checked first, and closed at the end of the block.

    create: open it for writing, and make it if it does not exist.
    checked: another process has just checked it, so this one does not.
    whole: check all of it, even if it is vouched for.

    A file that has not changed since this process checked it is not checked again.
    """
    path = run / FACTS
    store = Store(path, create=create)
    try:
        state = None if checked else _state(path)
        if state and (state not in _checked or _is_written(path)):
            store.unchecked = not (whole or create) and _vouched(run) == state[1:]
            if not store.unchecked:
                store.check()
                _checked.add(state)
        yield store
    finally:
        store.close()


def _state(path: Path) -> tuple[str, int, int]:
    state = path.stat()
    return str(path.resolve()), state.st_size, state.st_mtime_ns


def _is_written(path: Path) -> bool:
    """Whether a process has the file open for writing. Then its content may change while its time
    of last change does not.
    """
    return path.with_name(path.name + "-wal").exists()


_FACTS = b"facts"  # key of the cache's part of kind `checked`: size and time of the facts file


def vouch(run: Path, cache: KeptResults) -> None:
    """Note that the facts file of a run, as it is, was checked, so that later processes need not
    check all of it.
    """
    path = run / FACTS
    if path.is_file() and not _is_written(path) and (state := _state(path)) in _checked:
        cache.put([("checked", _FACTS, 0, json.dumps(state[1:]).encode())])


def _vouched(run: Path) -> tuple[int, ...] | None:
    """Size and time of the last change of a run's facts file when it was checked; None where that
    is not noted.
    """
    if _is_written(run / FACTS) or not (run / KEPT).is_file():
        return None
    # a damaged cache vouches for nothing
    with suppress(InputError), closing(KeptResults(run)) as cache:
        noted = cache.get("checked", _FACTS)
        return None if noted is None else tuple(json.loads(noted))
    return None


def _hash(fact: Row, circumstance: Row, drives: Iterable[tuple[str, bytes]]) -> bytes:
    """A hash of all that is recorded of a case; `drives` in the order of the vehicles' names.

    Trajectories enter by length and CRC-32, which finds every flipped bit in a fifth of the time of
    a longer hash. The row enters in the second format of `marshal`, which has numbers as their
    bits, at a quarter of the cost of `repr`.
    """
    sums = [(vehicle, len(data), zlib.crc32(data)) for vehicle, data in drives]
    row = (*fact, *circumstance, sums)
    return hashlib.blake2b(marshal.dumps(row, 2), digest_size=_HASH_SIZE).digest()


def _real(value: float) -> float | None:
    """A number as SQLite returns it: a float, None for nan, and no -0.0. So a row has the same hash
    before it is written and after it is read.
    """
    return None if isnan(value) else float(value) + 0.0


_NONE: Any = None  # an end reason that is missing, although the field's type has no None
# what is stored of a case without a recording
_NO_RECORDING = KeptRecording({}, None, _NONE, (), Latency(*(5 * [nan])), nan, nan)


def _rows(outcome: Outcome) -> tuple[Sequence[Row], ...]:
    """Rows of a case for each of `_TABLES`."""
    case, recording = outcome.case, outcome.recording
    kept = keep(recording) if isinstance(recording, Recording) else recording or _NO_RECORDING
    fact = (
        case.key,
        case.concrete.scenario,
        int(case.point),
        case.role,
        case.driver,
        case.controller,
        json.dumps(dict(case.concrete.values)),
        _real(case.concrete.exposure),
        outcome.status,
        kept.end_reason,
        outcome.error,
        _real(kept.simulated_time),
        json.dumps(_plain(kept.collision)) if kept.collision else None,
        json.dumps([_plain(clip) for clip in kept.clips]),
        case.fingerprint,
    )
    # `latencies` are median, 99th percentile and reference, which have a table of their own
    mean, longest, *latencies = map(_real, kept.controller_latency)
    # column `alone`, which `_SPLIT` takes apart again
    alone = outcome.batched if outcome.alone is None else json.dumps(_plain(outcome.alone))
    circumstance = (
        case.key, outcome.log, _real(kept.wall_time), mean, longest, outcome.error_place, alone
    )  # fmt: skip
    drives = sorted(kept.drives.items())
    digest = _hash(fact, circumstance, drives)
    trajectories = [(case.key, *drive) for drive in drives]
    return [fact], [(*circumstance, digest)], [(case.key, *latencies)], trajectories


def _plain(record: Collision | Clip | Alone) -> dict[str, object]:
    """The fields of a record by name, in their order. `dataclasses.asdict` would take five times as
    long, because it copies values.
    """
    return {field.name: getattr(record, field.name) for field in fields(record)}


def _values(text: str) -> dict[str, float]:
    """Values by name. `intern`: all rows of a scenario share the names in memory."""
    return {intern(name): value for name, value in json.loads(text).items()}


def _collision(text: str | None) -> Collision | None:
    if text is None:
        return None
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in json.loads(text).items()
    }
    return Collision(**values)


_MAKES: dict[str, Callable[[Any], Any]] = {
    "scenario": intern, "driver": intern, "controller": intern, "values": _values,
    "collision": _collision,
    "clips": lambda text: tuple(Clip(**clip) for clip in json.loads(text)),
}  # fmt: skip
"""Functions that make a field of a fact from its column; other columns are the field already."""
# (index of the column, its function)
_PLACES = [(_COLUMNS.index(name), make) for name, make in _MAKES.items()]
