"""A case as rows of the tables of a facts file, and back; the hash of these rows.

The hash leaves out the table `latencies`, which came after it: an edited `latency_median`,
`latency_p99` or `latency_reference` is not found. Fixed: files of users have these tables and these
hashes (format 4, `facts_file.FORMAT_VERSION`).

Users: `record/`, `report/`, `scoring/`, `whatif/search.py`, `extras/`.
"""

from __future__ import annotations

import hashlib
import json
import marshal
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from math import isnan, nan
from sys import intern
from typing import Any

from sumo_eval.frozen import frozen
from sumo_eval.record.cases import Outcome, Role, Status
from sumo_eval.record.kept import KeptRecording, keep
from sumo_eval.trajectory import Alone, Clip, Collision, Latency, Recording

SCHEMA = """
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
LATER = {
    "files_read": "(ads TEXT, path BLOB, hash TEXT NOT NULL, PRIMARY KEY (ads, path))",
    "latencies": '("case" TEXT PRIMARY KEY, latency_median REAL, latency_p99 REAL, '
    "latency_reference REAL) WITHOUT ROWID",
    "let_go": '("case" TEXT PRIMARY KEY, hash BLOB NOT NULL) WITHOUT ROWID',
}
"""Tables that files of earlier versions lack, with their columns. `let_go` has the cases whose
trajectories were discarded, each with the hash that it had before."""
TABLES = ("facts", "circumstances", "latencies", "trajectories")
# bytes; the hash shows damage and careless edits, no forgery: whoever edits the file on purpose can
# write the hash that fits
HASH_SIZE = 16
Row = Sequence[Any]  # one value a column
HAPPENED = "status", "end_reason", "error", "simulated_time", "collision", "clips"
"""Columns of `facts` that are equal for equal drives, whatever drove them."""


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
SELECT_FACTS = (
    # Names of columns in brackets, not in quotes: SQLite reads "name" as a text where it knows no
    # such column, and reports no error.
    f"SELECT {', '.join(_SPLIT.get(it, f'[{it}]') for it in _COLUMNS)} FROM facts "  # noqa: S608
    'LEFT JOIN circumstances USING ("case") LEFT JOIN latencies USING ("case") WHERE '
)


def hash_of(fact: Row, circumstance: Row, drives: Iterable[tuple[str, bytes]]) -> bytes:
    """A hash of all that is recorded of a case, except its row of `latencies`.

    circumstance: without its hash.
    drives: packed trajectories, in the order of the vehicles' names.

    Trajectories enter by length and CRC-32, which finds every flipped bit in a fifth of the time of
    a longer hash. The row enters in the second format of `marshal`, which has numbers as their
    bits, at a quarter of the cost of `repr`.
    """
    sums = [(vehicle, len(data), zlib.crc32(data)) for vehicle, data in drives]
    row = (*fact, *circumstance, sums)
    return hashlib.blake2b(marshal.dumps(row, 2), digest_size=HASH_SIZE).digest()


def _real(value: float) -> float | None:
    """A number as SQLite returns it: a float, None for nan, and no -0.0. So a row has the same hash
    before it is written and after it is read.
    """
    return None if isnan(value) else float(value) + 0.0


_NONE: Any = None  # an end reason that is missing, although the field's type has no None
# what is stored of a case without a recording
_NO_RECORDING = KeptRecording({}, None, _NONE, (), Latency(*(5 * [nan])), nan, nan)


def rows_of(outcome: Outcome) -> tuple[Sequence[Row], ...]:
    """Rows of a case for each of `TABLES`."""
    case, recording = outcome.case, outcome.recording or _NO_RECORDING
    # a worker has packed the trajectories already
    kept = keep(recording) if isinstance(recording, Recording) else recording
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
    # `latencies` are median, 99th percentile and reference: a table of their own, not in the hash
    mean, longest, *latencies = map(_real, kept.controller_latency)
    # column `alone`, which `_SPLIT` takes apart again
    alone = outcome.batched if outcome.alone is None else json.dumps(_plain(outcome.alone))
    circumstance = (
        case.key, outcome.log, _real(kept.wall_time), mean, longest, outcome.error_place, alone
    )  # fmt: skip
    drives = sorted(kept.drives.items())
    digest = hash_of(fact, circumstance, drives)
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


def fact_of(row: Row) -> Fact:
    """The fact of a row that `SELECT_FACTS` gives."""
    columns = list(row)
    for index, make in _PLACES:
        columns[index] = make(columns[index])
    return Fact(*columns)
