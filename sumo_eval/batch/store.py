"""The facts of a run in one SQLite file: a row a case, its trajectories beside it, written once, never changed."""

from __future__ import annotations

import json
import sqlite3
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.batch.cases import Outcome, Role, Status
from sumo_eval.errors import InputError
from sumo_eval.trajectory import CHANNELS, Clip, Collision, Trajectory

FORMAT_VERSION = 1
EGO = "ego"

_SCHEMA = """
CREATE TABLE IF NOT EXISTS facts (
    "case" TEXT PRIMARY KEY, scenario TEXT NOT NULL, point INTEGER NOT NULL, role TEXT NOT NULL, driver TEXT NOT NULL,
    controller TEXT NOT NULL, "values" TEXT NOT NULL, exposure REAL NOT NULL, status TEXT NOT NULL, end_reason TEXT,
    error TEXT, log TEXT NOT NULL, simulated_time REAL, collision TEXT, clips TEXT NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS costs (
    "case" TEXT PRIMARY KEY, wall_time REAL, latency_mean REAL, latency_max REAL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS trajectories (
    "case" TEXT NOT NULL, vehicle TEXT NOT NULL, data BLOB NOT NULL, PRIMARY KEY ("case", vehicle)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS facts_by_point ON facts (scenario, point, role);
"""


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
    log: str
    simulated_time: float | None
    collision: Collision | None
    clips: tuple[Clip, ...]
    wall_time: float | None
    latency_mean: float | None
    latency_max: float | None


class Store:
    """The facts file of one run."""

    def __init__(self, path: Path, *, create: bool = False) -> None:
        if not create and not path.is_file():
            raise InputError(f"{path.parent} is no run folder: there is no {path.name} in it.")
        self.path = path
        self._writing = create
        self._connection = sqlite3.connect(path)
        try:
            self._connection.execute("PRAGMA journal_mode = WAL" if create else "PRAGMA query_only = ON")
            if create:
                self._connection.executescript(_SCHEMA)
                self._connection.execute(f"PRAGMA user_version = {FORMAT_VERSION}")
            version = self._connection.execute("PRAGMA user_version").fetchone()[0]
        except sqlite3.DatabaseError as error:
            self._connection.close()
            raise InputError(f"{path} is no facts file of a run: {error}.") from error
        if version != FORMAT_VERSION:
            self._connection.close()
            raise InputError(
                f"{path} has format version {version}; this sumo_eval reads version {FORMAT_VERSION}. "
                "Use the version of sumo_eval that wrote it."
            )

    def close(self) -> None:
        """Close the file; a finished one is a single file that needs no write access to be read."""
        if self._writing:
            self._connection.execute("PRAGMA journal_mode = DELETE")
        self._connection.close()

    def add(self, outcome: Outcome) -> None:
        """Record a case: its row and all its trajectories, or nothing, in one transaction."""
        case, recording = outcome.case, outcome.recording
        row = (
            case.key,
            case.concrete.scenario,
            case.point,
            case.role,
            case.driver,
            case.controller,
            json.dumps(dict(case.concrete.values)),
            case.concrete.exposure,
            outcome.status,
            recording.end_reason if recording else None,
            outcome.error,
            outcome.log,
            recording.simulated_time if recording else None,
            json.dumps(asdict(recording.collision)) if recording and recording.collision else None,
            json.dumps([asdict(clip) for clip in recording.clips] if recording else []),
        )
        with self._connection:
            self._connection.execute("INSERT INTO facts VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)", row)
            if recording is None:
                return
            self._connection.execute(
                "INSERT INTO costs VALUES (?,?,?,?)", (case.key, recording.wall_time, *recording.controller_latency)
            )
            self._connection.executemany(
                "INSERT INTO trajectories VALUES (?,?,?)",
                [
                    (case.key, name, pack(trajectory))
                    for name, trajectory in {EGO: recording.ego, **recording.actors}.items()
                ],
            )

    def facts(self, role: Role, scenario: str | None = None, driver: str | None = None) -> list[Fact]:
        """The recorded cases of a role (of one scenario, of one driver), by scenario, point and driver."""
        query = (
            'SELECT facts.*, wall_time, latency_mean, latency_max FROM facts LEFT JOIN costs USING ("case") '
            "WHERE role = ? AND scenario = coalesce(?, scenario) AND driver = coalesce(?, driver) "
            "ORDER BY scenario, point, driver"
        )
        return [_fact(row) for row in self._connection.execute(query, (role, scenario, driver))]

    def trajectory(self, case: str, vehicle: str = EGO) -> Trajectory:
        """A recorded trajectory of a case."""
        row = self._connection.execute(
            'SELECT data FROM trajectories WHERE "case" = ? AND vehicle = ?', (case, vehicle)
        ).fetchone()
        if row is None:
            raise InputError(f"There is no trajectory of `{vehicle}` in case `{case}` of {self.path.parent}.")
        return unpack(row[0])

    def trajectories(self, case: str) -> dict[str, Trajectory]:
        """Every vehicle's trajectory of a case, the ego's under `ego`."""
        rows = self._connection.execute(
            'SELECT vehicle, data FROM trajectories WHERE "case" = ? ORDER BY vehicle', (case,)
        )
        return {name: unpack(data) for name, data in rows}


@contextmanager
def open_store(path: Path, *, create: bool = False) -> Iterator[Store]:
    """A facts file, closed at the end of the block."""
    store = Store(path, create=create)
    try:
        yield store
    finally:
        store.close()


def _fact(row: tuple[Any, ...]) -> Fact:
    (case, scenario, point, role, driver, controller, values, exposure, status, end_reason, error, log, simulated_time,
     collision, clips, wall_time, latency_mean, latency_max) = row  # fmt: skip
    return Fact(
        case, scenario, point, role, driver, controller, json.loads(values), exposure, status, end_reason, error, log,
        simulated_time, _collision(collision), tuple(Clip(**clip) for clip in json.loads(clips)),
        wall_time, latency_mean, latency_max,
    )  # fmt: skip


def _collision(text: str | None) -> Collision | None:
    if text is None:
        return None
    plain = json.loads(text)
    channels: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in plain.items()
    }
    return Collision(**channels)


_DOUBLE = ("time", "x")  # the others lose nothing that matters in single precision: 1e-7 of a lane, a speed, an angle
_SINGLE = tuple(name for name in CHANNELS if name not in _DOUBLE)
_HEADER = struct.Struct("<Idd")


def pack(trajectory: Trajectory) -> bytes:
    """A trajectory as bytes: time and x in double, the rest in single precision, byte planes together, deflated."""
    planes = [
        np.ascontiguousarray(getattr(trajectory, name), dtype=kind).view(np.uint8).reshape(len(trajectory), -1).T
        for names, kind in ((_DOUBLE, "<f8"), (_SINGLE, "<f4"))
        for name in names
    ]
    body = b"".join(plane.tobytes() for plane in planes)
    return _HEADER.pack(len(trajectory), trajectory.length, trajectory.width) + zlib.compress(body, 6)


def unpack(data: bytes) -> Trajectory:
    """The trajectory that `pack` wrote."""
    n, length, width = _HEADER.unpack_from(data)
    body = np.frombuffer(zlib.decompress(data[_HEADER.size :]), dtype=np.uint8)
    channels: dict[str, Any] = {}
    offset = 0
    for names, kind, size in ((_DOUBLE, "<f8", 8), (_SINGLE, "<f4", 4)):
        for name in names:
            plane = body[offset : offset + n * size].reshape(size, n)
            channels[name] = np.ascontiguousarray(plane.T).view(kind).reshape(n).astype(np.float64)
            offset += n * size
    return Trajectory(**channels, length=length, width=width)
