"""Facts of a run in one SQLite file: a row for each case, with its trajectories. A case is written
in one transaction.

`open_store` compares a file with its hashes (`record/facts_file.py`) once in each process, before
anything is read. `vouch` notes in the run's cache that a file was checked as a whole. As long as
that file does not change, later processes check only what they read: one case when they read it,
all cases in `facts` and `digest`. They read lists, such as `names`, unchecked.

Only the process that holds `run_folder.only_writer` may write.

Users: `cli/`, `evaluation.py`, `nightly/`, `record/`, `report/`, `scoring/`, `extras/`.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from sumo_eval.errors import InputError
from sumo_eval.input_file import sha256
from sumo_eval.record.case_rows import (
    HAPPENED,
    SELECT_FACTS,
    TABLES,
    Fact,
    Row,
    fact_of,
    rows_of,
)
from sumo_eval.record.cases import Case, Outcome, Role, Status
from sumo_eval.record.facts_file import (
    ALL_FACTS,
    DRIVES,
    FactsFile,
    checked_files,
    is_written,
    state_of,
)
from sumo_eval.record.kept import EGO as EGO
from sumo_eval.record.kept import unpack
from sumo_eval.record.kept_results import KEPT, KeptResults
from sumo_eval.record.reads import FileOfAds
from sumo_eval.trajectory import Alone, Trajectory

FACTS = "facts.sqlite"
"""Name of the facts file in a run's folder."""
RECORDED = "recorded"
"""Controller of a recorded driver's drive, and the setting `drivers.source` for such drives."""

LEFT_OUT = "left out"
"""Beginning of the names of notes on recorded drives that are left out. A note is JSON of three
numbers: drives that cover too little of the road, the largest share that one of these covers, and
drives that leave the road."""
# table and condition of these notes, for a query after FROM
_NOTES = f"about WHERE name LIKE '{LEFT_OUT} %'"
_ALL_DRIVES = 'SELECT "case", vehicle, data FROM trajectories ORDER BY "case", vehicle'


class Count(NamedTuple):
    """Cases of one kind: how many drives, with which exposure.

    driver: "" for human drivers, who count together.
    """

    scenario: str
    role: str
    driver: str
    status: str
    drives: int
    exposure: float


class Store(FactsFile):
    """The cases of a facts file.

    Values that differ between equal runs, such as wall times and printed text, are not in the table
    `facts` but in `circumstances` and `latencies`.

    stale: locators of ADSs that have read files that have changed since.
    """

    stale: frozenset[str] = frozenset()

    def is_discarded(self, case: str) -> bool:
        """Whether the trajectories of a case were deleted after it was scored."""
        return self._first('SELECT 1 FROM let_go WHERE "case" = ?', case) is not None

    def without_drivers(self) -> set[str]:
        """Scenarios in which trajectories of human drivers were discarded."""
        rows = self._read(
            'SELECT DISTINCT scenario FROM let_go JOIN facts USING ("case") WHERE role = ?',
            ("human",),
        )
        return {scenario for (scenario,) in rows}

    def no_trajectory(self, case: str) -> InputError:
        """Error that says why a case has no trajectories."""
        if self.is_discarded(case):
            return InputError(
                f"The trajectories of case `{case}` of {self.path.parent} were discarded after it "
                "was scored (`[run] keep`); what was computed of them then is known, anything else "
                "needs the evaluation run again."
            )
        return InputError(f"There is no trajectory of case `{case}` in run {self.path.parent}.")

    # -- writing -----------------------------------------------------------------------------------

    def add(self, *outcomes: Outcome) -> None:
        """Record cases, each with its row and all its trajectories: all of them or none.

        A case replaces one of the same name that was recorded with another fingerprint.

        outcomes: of cases that the file does not hold with their present fingerprint (`holds`).

        Raises InputError when the file cannot take them in, e.g. because the disk is full.
        """
        # by `TABLES`: the rows of each outcome
        tables = list(zip(*map(rows_of, outcomes), strict=True))
        with self._changes():
            for outcome in outcomes:
                key = outcome.case.key
                if self._fingerprint(key) is not None and not self.holds(outcome.case):
                    self._remove(key)
            # `tables` is empty where there are no outcomes
            for table, rows in zip(TABLES, tables, strict=False):
                self._insert(table, chain.from_iterable(rows))

    def _insert(self, table: str, rows: Iterator[Row]) -> None:
        first = next(rows, None)
        if first is not None:
            columns = ",".join("?" * len(first))
            query = f"INSERT INTO {table} VALUES ({columns})"  # noqa: S608
            self._connection.executemany(query, chain((first,), rows))

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
        for table in (*TABLES, "let_go"):
            # our own names
            self._connection.execute(f'DELETE FROM {table} WHERE "case" = ?', (case,))  # noqa: S608

    def difference(self, outcome: Outcome) -> str:
        """Differences of a drive from the recorded drive of its case, in words; "" if both are the
        same. Trajectories that were discarded are not compared.
        """
        case = outcome.case.key
        self._check_one(case)
        (facts,), *_, drives = rows_of(outcome)  # rows by `TABLES`: trajectories are the last
        before = self._first('SELECT * FROM facts WHERE "case" = ?', case)
        names = [name for _, name, *_ in self._read("PRAGMA table_info(facts)")]
        words = [
            f"{name}: {was!r}, now {value!r}"
            for name, was, value in zip(names, before, facts, strict=True)
            if was != value and name in HAPPENED
        ]
        recorded = [(case, *drive) for drive in self._read(DRIVES, (case,))]
        if not words and recorded != drives and not self.is_discarded(case):
            words = ["a trajectory differs"]
        return "; ".join(words)

    def left_out(self) -> list[tuple[int, float, int]]:
        """The notes of `LEFT_OUT`, one of each scenario and shard."""
        return [json.loads(*row) for row in self._read(f"SELECT value FROM {_NOTES}")]  # noqa: S608

    def take_over(self, other: Path) -> None:
        """Copy the cases of another run of the same format, the files that their ADSs have read,
        and its notes on drives that are left out, in one transaction.

        other: its folder.
        """
        try:
            with open_store(other) as part, self._changes():
                for rows in (*TABLES, _NOTES):  # a table, or a table WHERE a condition holds
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
        return map(fact_of, self._read(SELECT_FACTS + where, values))

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
        """The hash of a case as it was recorded, with trajectories that were discarded since; empty
        where there is no such case.
        """
        row = self._first(
            "SELECT coalesce(let_go.hash, circumstances.hash) FROM circumstances LEFT JOIN let_go "
            'USING ("case") WHERE "case" = ?',
            case,
        )
        return b"" if row is None else bytes(row[0])

    def counts(self) -> list[Count]:
        """How many cases there are of each kind, sorted."""
        rows = self._read(
            "SELECT scenario, role, CASE role WHEN 'human' THEN '' ELSE driver END AS who, "
            "status, count(*), total(exposure) FROM facts GROUP BY scenario, role, who, status "
            "ORDER BY scenario, role, who, status"
        )
        return [Count(*row) for row in rows]

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
        for row in chain(self._read(ALL_FACTS), self._read(_ALL_DRIVES)):
            digest.update(repr(row).encode())
        return digest.hexdigest()

    def drive(self, case: str, *, whole: bool = True) -> str | None:
        """A hash of what happened in a case, whatever drove it; None when it is not recorded.

        whole: with its trajectories.
        """
        self._check_one(case)
        row = self._first(
            f'SELECT {", ".join(HAPPENED)} FROM facts WHERE "case" = ?',  # noqa: S608
            case,
        )
        if row is None:
            return None
        drives = list(self._read(DRIVES, (case,))) if whole else []
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
        return {name: unpack(data) for name, data in self._read(DRIVES, (case,))}


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
        state = state_of(path)
        # a file that a process writes may have changed although its state is the same
        is_known = state in checked_files and not is_written(path)
        if not (checked or is_known):
            # a file that will be written is checked as a whole, too
            # state[1:]: size and time of the last change
            store.unchecked = not (whole or create) and _vouched(run) == state[1:]
            if not store.unchecked:
                store.check()
                checked_files.add(state)
        yield store
    finally:
        store.close()


# key, among the cache's parts of kind `checked`, of size and time of the facts file
_FACTS = b"facts"


def vouch(run: Path, cache: KeptResults) -> None:
    """Note that the facts file of a run, as it is, was checked, so that later processes need not
    check all of it.
    """
    path = run / FACTS
    if path.is_file() and not is_written(path) and (state := state_of(path)) in checked_files:
        cache.put([("checked", _FACTS, 0, json.dumps(state[1:]).encode())])


def _vouched(run: Path) -> tuple[int, ...] | None:
    """Size and time of the last change of a run's facts file when it was checked; None where that
    is not noted.
    """
    if is_written(run / FACTS) or not (run / KEPT).is_file():
        return None
    # a damaged cache vouches for nothing
    with suppress(InputError), closing(KeptResults(run)) as cache:
        noted = cache.get("checked", _FACTS)
        return None if noted is None else tuple(json.loads(noted))
    return None
