"""A run for other tools: pandas tables in memory, CSV and Parquet files on disk.

For `sumo_eval.open_run` and `sumo-eval export`.

Users: `cli/look.py`.
"""

from __future__ import annotations

import csv
import json
import os
import shlex
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import fields
from html import escape
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from sumo_eval.case_table import REAL
from sumo_eval.cases import CaseResult
from sumo_eval.errors import InputError, check_known, needs_extra
from sumo_eval.frozen import frozen
from sumo_eval.input_file import taking_apart, writing
from sumo_eval.record import run_folder
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.cases import Role
from sumo_eval.record.store import Count, Store, open_store
from sumo_eval.text import cell, each_text, from_cell
from sumo_eval.trajectory import CHANNELS, Trajectory

if TYPE_CHECKING:
    import pandas as pd

CASES = "cases.csv"
FORMATS = ("csv", "parquet")
_ROUND_TRIP = "%.17g"  # of trajectories: every double is read back to the bit
_NAMES = ("case", "scenario", "ads")  # columns of names: text, even if a name looks like a number
_COLUMNS = [field.name for field in fields(Fact) if field.name not in ("log", "clips", "collision")]
# columns that differ from machine to machine, after those that do not
_TIMES = [name for name in _COLUMNS if name.startswith(("wall_time", "latency"))]
_CONTACT = {
    "collision_time": "time", "collision_with": "other", "impact_speed": "relative_speed",
    "overlap": "overlap",
    "side": "side",
}  # fmt: skip
"""Columns of a drive's contact, and the field of `Collision` that each shows."""
_TYPES = {
    **dict.fromkeys((*_NAMES, "driver", "collision_with"), "VARCHAR"),
    # `REAL`: texts of the annotations of fields that are numbers
    **{it.name: "DOUBLE" for it in fields(CaseResult) if str(it.type).startswith(REAL)},
    # columns with other names than the fields, and one of `drives`
    **dict.fromkeys(("d_i", "incident_severity", "collision_time"), "DOUBLE"),
}
"""DuckDB's types of columns. Else it would take a name of digits for a number, and an empty column
of numbers for text."""


@frozen
class Run:
    """A run folder. Each property reads it when it is asked for. Quantities are in SI units."""

    folder: Path

    @property
    def cases(self) -> pd.DataFrame:
        """One row for each case of an ADS, as last scored: parameters, zone, outcome, U, L, Ug, r,
        D_i, measures.
        """
        import pandas as pd

        # an ADS may be called `007` or `NA`; `from_cell` removes the `'` that
        # keeps a spreadsheet from running a cell that begins like a formula
        options: Any = {"dtype": dict.fromkeys(_NAMES, str), "na_values": [""]}
        table = pd.read_csv(_scored(self.folder, CASES), keep_default_na=False, **options)
        return each_text(table, from_cell)

    @property
    def scores(self) -> pd.DataFrame:
        """One row for each ADS in each logical scenario, with all that scores.json has of it."""
        import pandas as pd

        path = _scored(self.folder, "scores.json")
        # an unreadable file becomes an InputError with this advice
        with taking_apart(path, "`sumo-eval score` writes it again."):
            return pd.DataFrame(json.loads(path.read_text("utf-8"))["scores"])

    @property
    def drives(self) -> pd.DataFrame:
        """One row for each recorded drive: the ADSs', the references' and the human drivers'."""
        import pandas as pd

        with self._store() as store:
            return pd.DataFrame(_drive_rows(store))

    @property
    def counts(self) -> pd.DataFrame:
        """Drives and exposure by scenario, role, driver and status; no drive is read for it."""
        import pandas as pd

        with self._store() as store:
            return pd.DataFrame(store.counts(), columns=Count._fields)

    def trajectories(self, case: str) -> dict[str, Trajectory]:
        """Every vehicle's trajectory of a case, the ego's under `ego`."""
        with self._store() as store:
            if vehicles := store.trajectories(case):
                return vehicles
            raise store.no_trajectory(case)

    def trajectory_table(self, case: str) -> pd.DataFrame:
        """The trajectories of a case as one table: vehicle, time, x, y, heading, speed,
        acceleration, steering.
        """
        return _trajectory_table(case, self.trajectories(case))

    @property
    def discarded(self) -> int:
        """Bytes of trajectories that were discarded after the run was scored."""
        with self._store() as store:
            return store.discarded_size

    def digest(self) -> str:
        """A hash of all recorded facts: equal for equal configurations, whatever the workers, order
        or machine.
        """
        with self._store() as store:
            return store.digest()

    def _repr_html_(self) -> str:
        """Text for a notebook: where the run lies, and how its drives ended."""
        counts = self.counts.to_html(index=False)
        return f"<p>Run <code>{escape(str(self.folder))}</code></p>{counts}"

    def _store(self) -> AbstractContextManager[Store]:
        return open_store(self.folder)


def open_run(path: str | os.PathLike[str]) -> Run:
    """A run folder as pandas tables and trajectories.

    Raises InputError if the folder holds no run, or one of another format.
    """
    folder = Path(path)
    # read only to raise InputError now: the properties of `Run` read the files again
    run_folder.read_settings(folder)
    run_folder.read_manifest(folder)
    with open_store(folder):
        return Run(folder)


def export(
    path: str | os.PathLike[str], out: str | os.PathLike[str], kind: str = "csv"
) -> list[Path]:
    """Write `cases`, `drives` and `trajectories` of a run as files of a kind (`csv`, `parquet`)
    into a folder.

    Drives are read one at a time, so a run of any size can be exported. Parquet needs the extra
    `parquet`.
    """
    check_known("format of an export", FORMATS, kind)
    run, folder = open_run(path), Path(out)
    scored = _scored(run.folder, CASES)
    with writing(f"The export to {folder}", folder):
        if kind == "csv":
            (folder / CASES).write_bytes(scored.read_bytes())
            return [folder / CASES, *_write_drives(run, folder, cell)]
        with tempfile.TemporaryDirectory(prefix="sumo_eval_", dir=folder) as scratch:
            cases = _unquoted(scored, Path(scratch) / CASES)
            tables = [cases, *_write_drives(run, Path(scratch), lambda value: value)]
            return _to_parquet(tables, folder)


def _scored(folder: Path, name: str) -> Path:
    if not (folder / name).is_file():
        with open_store(folder) as store:
            run_folder.check_complete(store, folder)
        raise InputError(
            f"Run {folder} has not been scored, {name} is missing; first: sumo-eval score "
            f"{shlex.quote(str(folder))}."
        )
    return folder / name


def _unquoted(table: Path, out: Path) -> Path:
    """A copy of a CSV file without the `'` that keeps a spreadsheet from running a cell: Parquet
    has types and needs none.
    """
    with (
        table.open(newline="", encoding="utf-8") as source,
        out.open("w", newline="", encoding="utf-8") as copy,
    ):
        rows = csv.reader(source)
        csv.writer(copy).writerows([from_cell(value) for value in row] for row in rows)
    return out


def _write_drives(run: Run, folder: Path, fit: Callable[[Any], Any]) -> list[Path]:
    """Write `drives.csv` and `trajectories.csv`.

    fit: changes each cell before it is written: `cell` adds the `'` for spreadsheets.
    """
    drives, trajectories = folder / "drives.csv", folder / "trajectories.csv"
    with (
        run._store() as store,
        drives.open("w", newline="", encoding="utf-8") as drives_file,
        trajectories.open("w", newline="", encoding="utf-8") as trajectories_file,
    ):
        names = sorted({name for row in _drive_rows(store) for name in row["values"]})
        writer = csv.writer(drives_file, lineterminator="\n")
        for number, row in enumerate(_drive_rows(store)):
            values = row.pop("values")
            row |= {f"parameter_{name}": values.get(name) for name in names}
            if number == 0:
                writer.writerow(map(fit, row))
            writer.writerow(map(fit, row.values()))
            table = _trajectory_table(row["case"], store.trajectories(row["case"]))
            each_text(table, fit).to_csv(
                trajectories_file, index=False, header=number == 0, float_format=_ROUND_TRIP
            )
    return [drives, trajectories]


def _drive_rows(store: Store) -> Iterator[dict[str, Any]]:
    """Rows of all drives, role by role: facts, then the contact, then the wall times."""
    for fact in chain.from_iterable(map(store.facts, get_args(Role))):
        row = {name: getattr(fact, name) for name in _COLUMNS}
        # without a collision every value of the contact is None
        contact = {column: getattr(fact.collision, name, None) for column, name in _CONTACT.items()}
        times = {name: row.pop(name) for name in _TIMES}
        yield row | contact | times


def _trajectory_table(case: str, trajectories: dict[str, Trajectory]) -> pd.DataFrame:
    import pandas as pd

    tables = [
        pd.DataFrame(
            {"case": case, "vehicle": name}
            | {channel: getattr(trajectory, channel) for channel in CHANNELS}
        )
        for name, trajectory in trajectories.items()
    ]
    return pd.concat(tables) if tables else pd.DataFrame(columns=["case", "vehicle", *CHANNELS])


def _to_parquet(tables: list[Path], folder: Path) -> list[Path]:
    """Write each CSV table again as Parquet. DuckDB never holds a whole table in memory."""
    try:
        import duckdb
    except ImportError as error:
        raise needs_extra("Parquet", "parquet") from error
    written = []
    with duckdb.connect() as database:
        for table in tables:
            target = folder / f"{table.stem}.parquet"
            quoted = str(target).replace("'", "''")
            with table.open(newline="", encoding="utf-8") as file:
                types = {name: _TYPES[name] for name in next(csv.reader(file)) if name in _TYPES}
            # a Python dict is a valid struct in DuckDB's SQL; -1: types are found from all rows
            options = f"header = true, sample_size = -1, types = {types}"
            rows = f"SELECT * FROM read_csv(?, {options})"  # noqa: S608 - our own names
            database.execute(f"COPY ({rows}) TO '{quoted}' (FORMAT parquet)", [str(table)])
            written.append(target)
    return written
