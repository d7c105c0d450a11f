"""Results of many cases as a table of columns.

`scoring/` makes the table, `report/` and `nightly/` read it. A table loads a column when it is
first used: a million records take some gigabytes of memory, their columns on disk a twentieth of
that.

Users: `nightly/`, `record/`, `report/`, `results.py`, `scoring/`, `extras/`.
"""

from __future__ import annotations

import json
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from functools import lru_cache
from itertools import accumulate, chain, groupby
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cases import CaseProperties, CaseResult, ThinReference, floats
from sumo_eval.coded import decoded, encoded
from sumo_eval.frozen import frozen
from sumo_eval.method.index_terms import IndexNote
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

Column = NDArray[Any]
REAL = "float", "Measure"
"""Types of fields that hold real numbers, as text."""
_RECORDS = {record.__name__: record for record in (ThinReference, IndexNote)}
_TYPES = {item.name: str(item.type) for item in fields(CaseResult)}
"""Fields of a row and their annotations, as text."""
_PLACES = {name: index for index, name in enumerate(_TYPES)}
"""Fields and their places among the columns; behind the fields each parameter has a column.

The column of `values` holds the names of the parameters.
"""
_PARAMETER = ""  # stands for the name of a field where a column is a parameter's
COLUMNS = len(_PLACES) + 100
"""Most columns of a row: all fields, and room for 100 parameters."""
NUMBERS = tuple(name for name, kind in _TYPES.items() if kind.startswith((*REAL, "bool", "int")))
"""Fields that hold numbers or truth values."""
_TEXT = np.dtypes.StringDType()
_CACHED_CHUNKS = 32  # chunks whose records stay in memory


@frozen(eq=False)
class Chunk:
    """Consecutive rows of a table: one ADS in one scenario, the same names of parameters.

    rows: their number.
    columns: function that reads the columns at a slice of places, as `encode_rows` made them.
    """

    scenario: str
    ads: str
    rows: int
    columns: Callable[[slice], list[bytes]]


def encode_rows(rows: Sequence[CaseResult]) -> list[bytes]:
    """The columns of rows whose parameters have the same names, each compressed alone."""
    names = list(rows[0].values)
    columns = [
        _encoded(name, [getattr(row, name) for row in rows]) for name in _TYPES if name != "values"
    ]
    columns.insert(_PLACES["values"], encoded(names))
    return columns + [_encoded(_PARAMETER, [row.values[name] for row in rows]) for name in names]


def _is_real(name: str) -> bool:
    """Whether a column holds real numbers.

    name: of the field, or `_PARAMETER`, here and below.
    """
    return name == _PARAMETER or _TYPES[name].startswith(REAL)


def _encoded(name: str, values: Sequence[Any]) -> bytes:
    """A column as compressed bytes.

    Real numbers: the first of their 8 bytes of all rows, then the second of all rows and so on,
    which compresses better than row by row.
    Anything else: for each row the place of its value in the list of distinct values, 4 bytes,
    then that list.
    """
    if _is_real(name):
        return zlib.compress(floats(values).view(np.uint8).reshape(-1, 8).T.tobytes(), 1)
    places: dict[Any, int] = {}  # of the distinct values, in the order of their first row
    indices = [places.setdefault(value, len(places)) for value in values]
    return zlib.compress(np.array(indices, "<u4").tobytes() + encoded(list(places)), 1)


def _real(data: bytes, rows: int) -> FloatArray:
    """Real numbers (n,) of a column that `_encoded` made."""
    bytes_of_rows = np.frombuffer(zlib.decompress(data), np.uint8).reshape(8, rows)
    return np.ascontiguousarray(bytes_of_rows.T).view("<f8").reshape(rows)


def _listed(data: bytes, rows: int) -> tuple[tuple[Any, ...], IntArray]:
    """Distinct values of a column that `_encoded` made, and the place of each row's value among
    them, (n,).
    """
    body = zlib.decompress(data)
    indices = np.frombuffer(body[: 4 * rows], "<u4")
    return decoded(body[4 * rows :], _RECORDS), indices.astype(np.intp)


@lru_cache(256)
def _array_of(chunk: Chunk, name: str, column: int) -> Column:
    """The column of a chunk at a place, as an array; the last 256 stay in memory."""
    return _array(name, chunk.columns(slice(column, column + 1))[0], chunk.rows)


def _array(name: str, data: bytes, rows: int) -> Column:
    """A column as an array (n,): numbers with nan for None, truth values, texts with "" for None,
    else objects.
    """
    if _is_real(name):
        return _real(data, rows)
    values, indices = _listed(data, rows)
    kind = _TYPES[name]
    if kind == "bool":
        return np.array(values, np.bool_)[indices]
    if name in NUMBERS:
        return floats(values)[indices]
    if kind.startswith(("str", "Zone", "Literal")):
        return np.array([value or "" for value in values], _TEXT)[indices]
    # filled afterwards: of tuples `np.array` would make a 2-d array
    objects = np.empty(len(values), object)
    objects[:] = values
    return objects[indices]


def _plain(name: str, data: bytes, rows: int) -> list[Any]:
    """A column as the values of records, with None for nan."""
    if _is_real(name):
        # only nan differs from itself
        return [None if value != value else value for value in _real(data, rows).tolist()]
    values, indices = _listed(data, rows)
    return [values[index] for index in indices.tolist()]


@lru_cache(_CACHED_CHUNKS)
def records_of(chunk: Chunk) -> list[CaseResult]:
    """The records of a chunk."""
    data = chunk.columns(slice(COLUMNS))  # all in one query, which is faster than one for each
    columns = (
        _points(data, chunk.rows) if name == "values" else _plain(name, data[index], chunk.rows)
        for name, index in _PLACES.items()
    )
    return [CaseResult(*row) for row in zip(*columns, strict=True)]


def _points(data: Sequence[bytes], rows: int) -> list[dict[str, float]]:
    """The points of rows, from all their columns."""
    names = json.loads(data[_PLACES["values"]])
    parameters = [_plain(_PARAMETER, column, rows) for column in data[len(_PLACES) :]]
    if not parameters:  # a scenario without any
        return [{} for _ in range(rows)]
    return [dict(zip(names, point, strict=True)) for point in zip(*parameters, strict=True)]


class CaseTable(CaseProperties):
    """Rows of cases. A field of `CaseResult` is a column, an array (n,): nan and "" stand for None.

    chunks: where the rows are stored, in order.
    rows: those of this table, numbered over all chunks, (n,); None: it has all.
    key: hash under which the run's cache holds this scoring; None: it does not.
    """

    def __init__(
        self, chunks: Iterable[Chunk], rows: IntArray | None = None, key: bytes | None = None
    ) -> None:
        self.chunks, self.rows, self.key = tuple(chunks), rows, key
        # number of the first row of each chunk; at the end, of all rows
        self._starts = list(accumulate((chunk.rows for chunk in self.chunks), initial=0))

    @classmethod
    def of(cls, rows: Iterable[CaseResult] | CaseTable) -> CaseTable:
        """Make a table of records, in their order; a table is returned as it is."""
        if isinstance(rows, CaseTable):
            return rows
        chunks = []
        # consecutive rows of one scenario and ADS, with the same names of parameters
        of_chunk = groupby(rows, key=lambda row: (row.scenario, row.ads, *row.values))
        for (scenario, ads, *_), group in of_chunk:
            alike = list(group)
            chunks.append(Chunk(scenario, ads, len(alike), encode_rows(alike).__getitem__))
        return cls(chunks)

    def part(self, scenario: str, ads: str | None = None) -> CaseTable:
        """The rows in one scenario, of one ADS or (None) of all.

        Only of a table that has all rows of its chunks.
        """
        return CaseTable(
            it for it in self.chunks if it.scenario == scenario and ads in (None, it.ads)
        )

    def parameters(self, names: Sequence[str]) -> FloatArray:
        """Points of the cases, (n, k): the parameters of these names."""
        points = np.empty((self._starts[-1], len(names)))
        # `_starts` has one number more, hence not strict
        for first, chunk in zip(self._starts, self.chunks, strict=False):
            stored = json.loads(chunk.columns(slice(_PLACES["values"], _PLACES["values"] + 1))[0])
            for axis, name in enumerate(names):
                index = len(_PLACES) + stored.index(name)
                points[first : first + chunk.rows, axis] = _array_of(chunk, _PARAMETER, index)
        return points if self.rows is None else points[self.rows]

    def __getattr__(self, name: str) -> Column:
        if name not in _PLACES or name == "values":
            raise AttributeError(name)
        parts = [_array_of(chunk, name, _PLACES[name]) for chunk in self.chunks]
        column = np.concatenate(parts) if parts else _array(name, _encoded(name, []), 0)
        return column if self.rows is None else column[self.rows]

    def __len__(self) -> int:
        return self._starts[-1] if self.rows is None else len(self.rows)

    def __iter__(self) -> Iterator[CaseResult]:
        if self.rows is None:
            return chain.from_iterable(map(records_of, self.chunks))
        return map(self._record, self.rows.tolist())

    @overload
    def __getitem__(self, where: int | np.integer[Any]) -> CaseResult: ...

    @overload
    def __getitem__(self, where: slice | BoolArray | IntArray) -> CaseTable: ...

    def __getitem__(
        self, where: int | np.integer[Any] | slice | BoolArray | IntArray
    ) -> CaseResult | CaseTable:
        if isinstance(where, int | np.integer):
            row = range(len(self))[where]
            return self._record(row if self.rows is None else int(self.rows[row]))
        return CaseTable(
            self.chunks, (np.arange(len(self)) if self.rows is None else self.rows)[where]
        )

    def _record(self, row: int) -> CaseResult:
        """The record of a row, numbered over all chunks."""
        number = bisect_right(self._starts, row) - 1
        return records_of(self.chunks[number])[row - self._starts[number]]


def counts(cases: CaseTable) -> dict[str, int]:
    """Number of cases with each outcome, by the names of `ScenarioResult`."""
    flags = {
        "collisions": cases.collided,
        "avoidable_collisions": cases.avoidable,
        "unavoidable_collisions": cases.unavoidable,
        "caused_collisions": cases.caused,
        "safe_collisions": cases.collided & cases.safe,
        "off_road": cases.off_road,
        "departures": cases.departed,
        "gave_up": cases.gave_up,
        "not_evaluated": ~cases.evaluated,
    }
    return {name: int(flag.sum()) for name, flag in flags.items()}


def point_numbers(tables: Sequence[CaseTable]) -> list[IntArray]:
    """Number of each case's point, (n,) for each table: equal for equal points, in all tables.

    The cases of all tables have parameters of the same names.
    """
    filled = [table for table in tables if len(table)]
    sizes = list(map(len, tables))
    number = np.zeros(sum(sizes), np.intp)
    for name in sorted(filled[0][0].values) if filled else ():
        rank = _ranks(np.concatenate([table.parameters([name]).ravel() for table in filled]))
        # number each pair (number so far, rank in this parameter), without gaps
        number = _ranks(number * (int(rank.max()) + 1) + rank)
    return np.split(number, np.cumsum(sizes)[:-1])


def _ranks(values: Column) -> IntArray:
    """Number of each value among the sorted distinct ones, (n,)."""
    return np.unique(values, return_inverse=True)[1]
