"""The history of nights: one SQLite file to which lines are added and in which none is ever changed
or removed.

Users: `cli/compare.py`, `extras/figures/of_studies.py`, `nightly/bases.py`, `nightly/judgement.py`,
`nightly/morning.py`, `nightly/night.py`, `nightly/repeats.py`, `nightly/trend.py`.
"""

import sqlite3
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.errors import InputError
from sumo_eval.report.gate_result import GateResult
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.scoring.gate_settings import NearMissSettings
from sumo_eval.text import as_utf8

HISTORY = "history.sqlite"
FORMAT_VERSION = 1
DONE, GATE_FAILED, NOT_EVALUATED = 0, 1, 3  # exit statuses of a night
GOOD = DONE, NOT_EVALUATED  # of a night in which no limit failed
REGRET_OF_LOSSES = "regret of losses"
"""Name of the regret in the history where it is one of losses, without unit; `regret` is in m/s."""

# fields of a `ScenarioResult` that the history keeps, in addition to its scores
_KEPT = (
    "collision_probability", "collisions", "avoidable_collisions", "unavoidable_collisions",
    "caused_collisions",
    "departures", "gave_up", "not_evaluated"
)  # fmt: skip
_TABLES = "nights", "quantities", "gates", "begun", "accepted", "shaky", "builds"
_SCHEMA = """
CREATE TABLE IF NOT EXISTS begun (night TEXT PRIMARY KEY);
CREATE TABLE IF NOT EXISTS nights (
    night TEXT PRIMARY KEY, evaluation TEXT NOT NULL, folder TEXT NOT NULL, wall_time REAL,
    exit_status INTEGER NOT NULL, base TEXT,
    verdict TEXT NOT NULL, sumo_eval TEXT NOT NULL, libsumo TEXT NOT NULL, imported INTEGER NOT NULL
);
CREATE TABLE IF NOT EXISTS quantities (
    night TEXT NOT NULL REFERENCES nights, ads TEXT NOT NULL, scenario TEXT NOT NULL,
    quantity TEXT NOT NULL,
    value REAL, PRIMARY KEY (night, ads, scenario, quantity)
);
CREATE TABLE IF NOT EXISTS gates (
    night TEXT NOT NULL REFERENCES nights, ads TEXT NOT NULL, scenario TEXT NOT NULL,
    quantity TEXT NOT NULL,
    passed INTEGER, threshold REAL, sentence TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS accepted (
    night TEXT NOT NULL REFERENCES nights, at TEXT NOT NULL, reason TEXT NOT NULL, until TEXT,
    itself INTEGER NOT NULL
);
CREATE TABLE IF NOT EXISTS shaky (
    night TEXT NOT NULL, ads TEXT NOT NULL, scenario TEXT NOT NULL, point TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS builds (night TEXT NOT NULL, ads TEXT NOT NULL, build TEXT NOT NULL);
""" + "".join(
    f"CREATE TRIGGER IF NOT EXISTS {table}_{change.lower()} BEFORE {change} ON {table} "
    "BEGIN SELECT RAISE(ABORT, 'the history is only added to'); END;\n"
    for table in _TABLES
    for change in ("UPDATE", "DELETE")
)


_FIX = "Put a copy of it back, or begin a history in another folder. No night was removed."
PATIENCE = 60.0  # s to wait for another process that holds the file locked
# codes of SQLite's errors after which the file is as it was
_OUTSIDE = sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY


class Night(NamedTuple):
    """One line of the history.

    night: its name, which is the UTC time at which it began.
    folder: path of its folder, relative to the history's folder; of an imported run, absolute.
    wall_time: s.
    base: night that it was compared with; None: none.
    """

    night: str
    evaluation: str
    folder: str
    wall_time: float | None
    exit_status: int
    base: str | None
    verdict: str
    sumo_eval: str
    libsumo: str
    imported: bool

    @property
    def good(self) -> bool:
        """Whether no limit failed: then later nights may be compared with this one.

        Some cases may not have been evaluated (`NOT_EVALUATED`).
        """
        return self.exit_status in GOOD


class QuantityLine(NamedTuple):
    """One quantity of one ADS in one logical scenario in one night.

    quantity: name of a score, of a number of cases, or `run_time`: wall time of the ADS's cases, s.
    value: None: it was not computed.
    """

    night: str
    ads: str
    scenario: str
    quantity: str
    value: float | None


class GateLine(NamedTuple):
    """One gate of one night.

    passed: 1 or 0; None: it could not be evaluated.
    threshold: the value at which it would fail; None: it has none.
    bound: as in `GateResult`; "" in histories of earlier versions.
    """

    night: str
    ads: str
    scenario: str
    quantity: str
    passed: int | None
    threshold: float | None
    sentence: str
    bound: str = ""


class Accepted(NamedTuple):
    """A night accepted as a base.

    at: when, UTC.
    until: the last day on which it counts.
    itself: whether the nightly run accepted it, without a user.
    """

    night: str
    at: str
    reason: str
    until: str | None
    itself: bool

    @property
    def words(self) -> str:
        """Reason and last day: `softer brakes on purpose, until 2026-12-31`."""
        return f"{self.reason}, until {self.until}" if self.until else self.reason


class ShakyCase(NamedTuple):
    """A case that was bad in some drives of one build and not in all."""

    ads: str
    scenario: str
    point: str


class Build(NamedTuple):
    """The build of an ADS in a night."""

    night: str
    ads: str
    build: str


class History:
    """An open history file."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection = connection
        self._path = path

    def add(
        self,
        night: Night,
        evaluation: Evaluation,
        gates: Sequence[GateResult],
        *,
        shaky: Collection[ShakyCase] = (),
        pin: Accepted | None = None,
    ) -> None:
        """Add a night and all its lines in the other tables, in one transaction.

        shaky: as in `shaky`.
        pin: acceptance of this night, if it becomes a base at once.

        Raises InputError if the history has a night of this name.
        """
        if any(known.night == night.night for known in self.nights()):
            raise InputError(
                f"The history {self._path} has a night {night.night} already; nothing in it is "
                "replaced."
            )
        name, builds = night.night, evaluation.manifest.get("builds", {})
        values = [
            (name, score.ads, score.scenario, quantity, value)
            for score in evaluation.scores
            for quantity, value in _quantities(evaluation, score).items()
        ]
        columns_of = attrgetter(*GateLine._fields[1:])  # a GateResult lacks `night`
        with self._connection:
            self._insert("nights", [night])
            self._insert("quantities", values)
            self._insert("builds", [(name, *ads_build) for ads_build in builds.items()])
            self._insert("gates", [(name, *columns_of(gate)) for gate in gates])
            self._insert("shaky", [(name, *case) for case in shaky])
            self._insert("accepted", [] if pin is None else [pin])

    def accept(self, pin: Accepted) -> None:
        """Note that a night is accepted as a base."""
        with self._connection:
            self._insert("accepted", [pin])

    def _insert(self, table: str, rows: Sequence[tuple[Any, ...]]) -> None:
        for row in rows:
            places = ",".join("?" * len(row))
            self._connection.execute(
                f"INSERT INTO {table} VALUES ({places})",  # noqa: S608
                [as_utf8(value) if isinstance(value, str) else value for value in row],
            )

    def accepted(self) -> list[Accepted]:
        """Everything that was accepted, the oldest first."""
        return self._read("accepted", Accepted)

    def shaky(self) -> set[ShakyCase]:
        """Cases that were bad in some drives of one build, in a good or an accepted night."""
        rows = self._connection.execute(
            "SELECT ads, scenario, point FROM shaky WHERE night IN (SELECT night FROM nights "
            "WHERE exit_status IN (?, ?) UNION SELECT night FROM accepted)",
            GOOD,
        )
        return {ShakyCase(*row) for row in rows}

    def builds(self) -> dict[str, dict[str, str]]:
        """Build of each ADS by night."""
        builds: dict[str, dict[str, str]] = {}
        for night, ads, build in self._read("builds", Build):
            builds.setdefault(night, {})[ads] = build
        return builds

    def _read(self, table: str, kind: Any) -> list[Any]:
        """The lines of a table, the oldest first; none where an older history has no such table."""
        columns = _columns(self._connection, table)
        names = ", ".join(name for name in kind._fields if name in columns)
        if not names:
            return []
        rows = self._connection.execute(
            f"SELECT {names} FROM {table} ORDER BY rowid"  # noqa: S608
        )
        return [kind(*row) for row in rows]

    def begin(self, night: str) -> None:
        """Note that a night begins, so that its folder is known if it is stopped."""
        with self._connection:
            self._insert("begun", [(night,)])

    def stopped(self) -> set[str]:
        """Names of the nights that began and have no line: they were stopped, or failed."""
        return {
            night
            for (night,) in self._connection.execute(
                "SELECT night FROM begun EXCEPT SELECT night FROM nights"
            )
        }

    def stopped_last(self) -> list[str]:
        """Nights that began after the last night with a line, in the order of their beginning."""
        names = self._connection.execute(
            "SELECT night FROM begun WHERE rowid > coalesce("
            "(SELECT max(b.rowid) FROM begun AS b JOIN nights USING (night)), 0) ORDER BY rowid"
        )
        return [night for (night,) in names]

    def nights(self) -> list[Night]:
        """Every night in the order of adding, whatever the clock said."""
        return self._read("nights", Night)

    def ran(self) -> list[Night]:
        """All nights but the imported ones, in the order of adding."""
        return [night for night in self.nights() if not night.imported]

    def in_time(self) -> list[Night]:
        """`nights`, with each imported run before the nights that began after it."""
        nights = self.ran()
        for run in sorted(night for night in self.nights() if night.imported):
            later = (place for place, night in enumerate(nights) if night.night > run.night)
            nights.insert(next(later, len(nights)), run)
        return nights

    def values(self) -> list[QuantityLine]:
        """Every quantity of every night, the oldest first."""
        return self._read("quantities", QuantityLine)

    def gates(self) -> list[GateLine]:
        """Every gate of every night, the oldest first."""
        return self._read("gates", GateLine)


@contextmanager
def open_history(folder: Path, *, create: bool = False) -> Iterator[History]:
    """The history file in a folder.

    create: make a missing folder, a missing file, and tables that older histories lack.

    Raises InputError where there is none, or one of another format.
    """
    path = folder / HISTORY
    if not path.is_file() and not create:
        raise InputError(f"There is no history in {folder}: it has no {HISTORY}.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(path, timeout=PATIENCE)
    except (OSError, sqlite3.Error) as error:
        raise InputError(f"The history {path} cannot be opened: {error}.") from error
    try:
        _check(connection, path)
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        if version == 0 and connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            raise InputError(f"{path} is not a history: it is a database of something else.")
        if version == FORMAT_VERSION:
            # Raises sqlite3.Error if one of these tables is missing. The others were added by later
            # versions, so they may be missing.
            connection.execute("SELECT 1 FROM nights, quantities, gates LIMIT 0")
        if version in (0, FORMAT_VERSION) and create:
            connection.executescript(
                f"BEGIN; {_SCHEMA} PRAGMA user_version = {FORMAT_VERSION}; COMMIT;"
            )
            if "bound" not in _columns(connection, "gates"):
                connection.execute("ALTER TABLE gates ADD COLUMN bound TEXT NOT NULL DEFAULT ''")
        elif version == 0:
            raise InputError(f"The history {path} is empty. {_FIX}")
        elif version != FORMAT_VERSION:
            raise InputError(
                f"The history {path} has format version {version}; this sumo_eval reads version "
                f"{FORMAT_VERSION}."
            )
        yield History(connection, path)
    except sqlite3.Error as error:
        # the last 8 bits are the kind of error
        sound = getattr(error, "sqlite_errorcode", 0) & 0xFF in _OUTSIDE
        fix = "It is as it was: remove the cause and run the command again." if sound else _FIX
        raise InputError(f"The history {path} cannot be used: {error}. {fix}") from error
    finally:
        connection.close()


def _columns(connection: sqlite3.Connection, table: str) -> set[str]:
    """Names of a table's columns; none without such a table."""
    # a row has the number of a column, its name, and more
    return {name for _, name, *_ in connection.execute(f"PRAGMA table_info({table})")}


def is_begun(folder: Path) -> bool:
    """Whether there is a history file in a folder, and something in it."""
    path = folder / HISTORY
    # something else than a file counts, too: `open_history` then reports that it cannot be opened
    return path.exists() and (not path.is_file() or path.stat().st_size > 0)


def _check(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that SQLite finds damaged anywhere, not only where it is read first."""
    try:
        state = str(connection.execute("PRAGMA integrity_check(1)").fetchone()[0])
    except sqlite3.OperationalError:  # the file is locked, for example
        raise
    except sqlite3.DatabaseError as error:
        raise InputError(f"{path} is not a history, or is damaged: {error}. {_FIX}") from error
    if state != "ok":
        raise InputError(f"The history {path} is damaged: {state.splitlines()[-1]}. {_FIX}")


def near_misses(cases: CaseTable) -> int:
    """Number of cases of status `ok` with a measure inside its zone, by the defaults of
    `NearMissSettings`.
    """
    inside = [
        measure.sign * getattr(cases, measure.quantity) < measure.sign * measure.zone
        for measure in NearMissSettings().measure
        if measure.zone is not None
    ]
    return int(np.sum(np.any(inside, axis=0) & (cases.status == "ok")))


def _quantities(evaluation: Evaluation, score: ScenarioResult) -> dict[str, float | None]:
    """Quantities of one ADS in one logical scenario that the history keeps."""
    cases = evaluation.cases_behind(score)
    unit = evaluation.settings.method.collision.regret_unit
    renamed = {} if unit else {"regret": REGRET_OF_LOSSES}
    return {
        **{renamed.get(name, name): getattr(score, field) for name, (field, _) in SCORES.items()},
        **{name: getattr(score, name) for name in _KEPT},
        "near_misses": near_misses(cases),
        "run_time": float(np.nansum(cases.wall_time)),
    }
