"""Rows of cases as columns of bytes, and rows that are read from a run's folder when they are asked for.

A million rows in memory are some gigabytes; as columns on disk they are a twentieth, and a few hundred are decoded at a
time.
"""

from __future__ import annotations

import json
import struct
import zlib
from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from sumo_eval.errors import InputError
from sumo_eval.method.anthropomorphic import IndexNote
from sumo_eval.record.coded import decoded, encoded
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.results import CaseResult, ThinReference
from sumo_eval.trajectory import BoolArray, FloatArray

_RECORDS = {one.__name__: one for one in (ThinReference, IndexNote)}
_FIELDS: Final = tuple(field.name for field in fields(CaseResult))
_HEADER = struct.Struct("<I")
_HELD = 32  # chunks of rows that are in memory at a time
_REAL, _LISTED = "real", "listed"
_ASCII = 128  # code points below it are one byte in UTF-8, their own
_PLAIN = frozenset((str, bool, type(None)))

Thing = TypeVar("Thing")
Column = NDArray[Any]
IntArray = NDArray[np.intp]
_Held = OrderedDict[int, list[CaseResult]]


@dataclass(frozen=True, slots=True)
class Chunk:
    """Rows that lie together: of one ADS in one scenario, their number, and their place among those of a scoring."""

    scenario: str
    ads: str
    place: int
    rows: int


def encode_rows(rows: Sequence[CaseResult]) -> bytes:
    """Rows of one scenario as columns, each deflated by itself."""
    names = list(rows[0].values) if rows else []
    columns: list[tuple[str, list[Any]]] = [(f"values.{name}", [row.values[name] for row in rows]) for name in names]
    columns += [(name, [getattr(row, name) for row in rows]) for name in _FIELDS if name != "values"]
    header, bodies = [], []
    for name, values in columns:
        kind, body = _encode(values)
        bodies.append(zlib.compress(body, 1))
        header.append((name, kind, len(bodies[-1])))
    plain = json.dumps([len(rows), header]).encode()
    return b"".join((_HEADER.pack(len(plain)), plain, *bodies))


def decode_rows(data: bytes) -> list[CaseResult]:
    """What `encode_rows` wrote."""
    count, found = _columns(data)
    names = [name.removeprefix("values.") for name in found if name.startswith("values.")]
    values = zip(*(found[f"values.{name}"] for name in names), strict=True) if names else iter([()] * count)
    found["values"] = [dict(zip(names, row, strict=True)) for row in values]
    return [CaseResult(*row) for row in zip(*(found[name] for name in _FIELDS), strict=True)]


def decode_column(data: bytes, name: str) -> list[Any]:
    """One column of what `encode_rows` wrote."""
    return _columns(data, name)[1][name]


def _columns(data: bytes, *only: str) -> tuple[int, dict[str, list[Any]]]:
    """How many rows there are, and their columns, all or those of these names."""
    (size,) = _HEADER.unpack_from(data)
    count, header = json.loads(data[_HEADER.size : _HEADER.size + size])
    found, at = {}, _HEADER.size + size
    for name, kind, length in header:
        if not only or name in only:
            found[name] = _decode(zlib.decompress(data[at : at + length]), kind, count)
        at += length
    return count, found


def _arrays(data: bytes, names: Sequence[str]) -> dict[str, Column]:
    """Columns as arrays (n,), by `as_array`, without a Python object for each number."""
    (size,) = _HEADER.unpack_from(data)
    count, header = json.loads(data[_HEADER.size : _HEADER.size + size])
    found, at = {}, _HEADER.size + size
    for name, kind, length in header:
        if name in names:
            body = zlib.decompress(data[at : at + length])
            if kind == _REAL:
                numbers, missing = _numbers(body, count)
                found[name] = np.where(missing, np.nan, numbers)
            else:
                listed = as_array(decoded(body[4 * count :], _RECORDS))
                found[name] = listed[np.frombuffer(body[: 4 * count], dtype="<u4")]
        at += length
    return found


class _Column:
    """A column of many rows that is filled some rows at a time: numbers are never in memory twice."""

    def __init__(self, rows: int) -> None:
        self._numbers, self._filled = np.empty(rows), 0
        self._texts: list[Column] = []

    def add(self, part: Column) -> None:
        """Put the next rows in."""
        if part.dtype.kind == "U" and not self._texts:  # until now no row had a text
            self._texts = [np.full(self._filled, "")]
        if self._texts:
            self._texts.append(part if part.dtype.kind == "U" else np.full(len(part), ""))
        else:
            self._numbers[self._filled : self._filled + len(part)] = part
            self._filled += len(part)

    def whole(self) -> Column:
        """The column (n,); of texts a chunk in which no row has one has empty ones."""
        return np.concatenate(self._texts) if self._texts else self._numbers[: self._filled]


def as_array(values: Sequence[Any]) -> Column:
    """Values as an array (n,): numbers and truth values as numbers, None as nan; texts as texts, None as ""."""
    if any(isinstance(value, str) for value in values):
        return np.array(["" if value is None else value for value in values], dtype=np.str_)
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def arrays(cases: Sequence[CaseResult], *names: str) -> dict[str, Column]:
    """Fields of rows as arrays (n,), by `as_array`; of kept rows nothing else is read. `values.NAME`: a parameter's."""
    if isinstance(cases, KeptRows):
        return cases.arrays(*names)
    found = {}
    for name in names:
        head, _, parameter = name.partition(".")
        found[name] = as_array([case.values[parameter] if parameter else getattr(case, head) for case in cases])
    return found


def arrays_in_parts(cases: Sequence[CaseResult], *names: str) -> Iterator[dict[str, Column]]:
    """Fields of rows as arrays, of some rows after the other, so that no column of texts need be in memory whole."""
    return cases.arrays_in_parts(*names) if isinstance(cases, KeptRows) else iter([arrays(cases, *names)])


def _encode(values: list[Any]) -> tuple[str, bytes]:
    """Numbers as their bits, the missing ones marked; anything else as what occurs, and which of it each row has."""
    if all(value is None or isinstance(value, float) for value in values):
        missing = np.array([value is None for value in values], dtype=np.bool_)
        numbers = np.array([0.0 if value is None else value for value in values], dtype="<f8")
        return _REAL, np.packbits(missing).tobytes() + numbers.view(np.uint8).reshape(-1, 8).T.tobytes()
    written: dict[tuple[type, Any], bytes] = {}
    places: dict[bytes, int] = {}
    which = [places.setdefault(_written(value, written), len(places)) for value in values]
    listed = b"[" + b",".join(places) + b"]"
    return _LISTED, np.array(which, dtype="<u4").tobytes() + listed


def _written(value: Any, before: dict[tuple[type, Any], bytes]) -> bytes:
    """A value as `encoded` has it; what of texts, truth values and None was written before is not written again."""
    if type(value) not in _PLAIN:  # 0.0 equals -0.0, and is written otherwise
        return encoded(value)
    key = (type(value), value)
    if key not in before:
        before[key] = encoded(value)
    return before[key]


def _decode(body: bytes, kind: str, count: int) -> list[Any]:
    if kind == _REAL:
        numbers, missing = _numbers(body, count)
        values: list[Any] = numbers.tolist()
        for place in np.flatnonzero(missing).tolist():
            values[place] = None
        return values
    listed = decoded(body[4 * count :], _RECORDS)
    return [listed[place] for place in np.frombuffer(body[: 4 * count], dtype="<u4").tolist()]


def _numbers(body: bytes, count: int) -> tuple[FloatArray, BoolArray]:
    """The numbers of a column, (count,), and which of them are missing."""
    marks = (count + 7) // 8
    missing = np.unpackbits(np.frombuffer(body[:marks], dtype=np.uint8), count=count).astype(np.bool_)
    planes = np.frombuffer(body[marks:], dtype=np.uint8).reshape(8, count)
    return np.ascontiguousarray(planes.T).view("<f8").reshape(count), missing


@dataclass(frozen=True, slots=True, eq=False)
class OfSomeRows(Sequence[Thing]):
    """What stands for some rows of many, each made, and its row read, when it is asked for. places: which rows, (n,).

    A subclass may hold further arrays (n,); a slice has all of them at its places.
    """

    cases: Sequence[CaseResult]
    places: IntArray

    @abstractmethod
    def _made(self, place: int) -> Thing:
        """What stands at a place."""

    def _row(self, place: int) -> CaseResult:
        """The row behind it."""
        return self.cases[int(self.places[place])]

    def __len__(self) -> int:
        return len(self.places)

    @overload
    def __getitem__(self, place: int) -> Thing: ...

    @overload
    def __getitem__(self, place: slice) -> Self: ...

    def __getitem__(self, place: int | slice) -> Thing | Self:
        if not isinstance(place, slice):
            return self._made(place)
        held = [(one.name, getattr(self, one.name)) for one in fields(self)]
        some: dict[str, Any] = {name: value[place] for name, value in held if isinstance(value, np.ndarray)}
        return replace(self, **some)


@dataclass(frozen=True, slots=True, eq=False)
class Chosen(OfSomeRows[CaseResult]):
    """Some rows of many, each read where it is asked for."""

    def _made(self, place: int) -> CaseResult:
        return self._row(place)


class Made(Sequence[Thing]):
    """What is made of rows, one after the other, each when it is asked for. parts: rows, and what makes a thing of the
    row at a place among them.
    """

    def __init__(self, *parts: tuple[Sequence[CaseResult], Callable[[CaseResult, int], Thing]]) -> None:
        self._parts = parts

    def __len__(self) -> int:
        return sum(len(rows) for rows, _ in self._parts)

    def __iter__(self) -> Iterator[Thing]:
        for rows, make in self._parts:
            for place, row in enumerate(rows):
                yield make(row, place)

    @overload
    def __getitem__(self, place: int) -> Thing: ...

    @overload
    def __getitem__(self, place: slice) -> Sequence[Thing]: ...

    def __getitem__(self, place: int | slice) -> Thing | Sequence[Thing]:
        if isinstance(place, slice):
            return [self[one] for one in range(*place.indices(len(self)))]
        left = place + len(self) if place < 0 else place
        if left >= 0:
            for rows, make in self._parts:
                if left < len(rows):
                    return make(rows[left], left)
                left -= len(rows)
        raise IndexError(place)


def chosen(cases: Sequence[CaseResult], flags: BoolArray) -> Chosen:
    """The rows that are flagged, (n,), in their order."""
    return Chosen(cases, np.flatnonzero(flags))


def parameters_of(cases: Sequence[CaseResult], names: Sequence[str]) -> FloatArray:
    """Where cases lie, (n, k): the parameters of these names."""
    found, first = np.empty((len(cases), len(names))), 0
    for part in arrays_in_parts(cases, *(f"values.{name}" for name in names)):
        columns = [part[f"values.{name}"] for name in names]
        last = first + len(columns[0])
        for place, column in enumerate(columns):
            found[first:last, place] = column
        first = last
    return found


def names_at(cases: Sequence[CaseResult], places: IntArray) -> NDArray[np.str_]:
    """Keys of the cases at these places, (n,), as an array of texts."""
    return _keys_at(cases, places, lambda keys: keys)


def _keys_at(cases: Sequence[CaseResult], places: IntArray, written: Callable[[Column], Column]) -> Column:
    """Keys of the cases at these places, (n,), as an array of what they are written as."""
    wanted = np.zeros(len(cases), dtype=np.bool_)
    wanted[places] = True
    found, first = [written(np.empty(0, dtype=np.str_))], 0
    for part in arrays_in_parts(cases, "case"):
        found.append(written(part["case"][wanted[first : first + len(part["case"])]].astype(np.str_)))
        first += len(part["case"])
    keys = np.concatenate(found)
    found.clear()  # of a million cases never more than twice in memory
    return np.asarray(keys[np.cumsum(wanted)[places] - 1])


def _utf8(keys: Column) -> Column:
    """Texts as their bytes, which are a quarter of them; UTF-8 orders as the characters themselves do."""
    codes = keys.view(np.uint32).reshape(len(keys), -1) if len(keys) else np.zeros((0, 1), dtype=np.uint32)
    if codes.max(initial=0) >= _ASCII:
        return np.char.encode(keys, "utf-8", "surrogatepass")
    return codes.astype(np.uint8).view(f"S{codes.shape[1]}").ravel()


def keys_by_place(cases: Sequence[CaseResult], keys: Collection[str]) -> dict[int, str]:
    """The place of each case that has one of these keys, ascending, and its key."""
    found: dict[int, str] = {}
    wanted, first = np.array(sorted(keys), dtype=np.str_), 0
    for part in arrays_in_parts(cases, "case"):
        here = np.flatnonzero(np.isin(part["case"].astype(np.str_), wanted))
        found.update(zip((first + here).tolist(), part["case"][here].tolist(), strict=True))
        first += len(part["case"])
    return found


def name_ranks(cases: Sequence[CaseResult], places: IntArray) -> IntArray:
    """Numbers (n,) that order the cases at these places as their keys do; where keys ascend, no key is held."""
    if _names_ascend(cases):
        return places
    order = np.argsort(_keys_at(cases, places, _utf8), kind="stable")
    ranks = np.empty(len(order), dtype=np.intp)
    ranks[order] = np.arange(len(order))
    return ranks


def _names_ascend(cases: Sequence[CaseResult]) -> bool:
    """Whether the key of each case stands behind that of the case before it."""
    last: str | None = None
    for part in arrays_in_parts(cases, "case"):
        names = part["case"]
        if len(names) and ((last is not None and not last < str(names[0])) or not (names[:-1] < names[1:]).all()):
            return False
        last = str(names[-1]) if len(names) else last
    return True


def point_numbers(tables: Sequence[Sequence[CaseResult]]) -> list[IntArray]:
    """A number for each point of the space that some cases lie at, the same in all tables: (n,) for each table.

    The cases of all tables have the same parameters, by name.
    """
    ends = np.cumsum([len(table) for table in tables])
    point = np.zeros(int(ends[-1]) if len(ends) else 0, dtype=np.intp)
    if len(point):
        names = sorted(next(table for table in tables if len(table))[0].values)
        for name in (f"values.{name}" for name in names):
            read = np.concatenate([arrays(table, name)[name] for table in tables if len(table)])
            values = np.unique(read, return_inverse=True)[1]
            point = np.unique(point * (int(values.max()) + 1) + values, return_inverse=True)[1]
    return np.split(point, ends[:-1])


class KeptRows(Sequence[CaseResult]):
    """The rows of a scoring, or of one ADS in one scenario of it; equal to any sequence of equal rows. key: what the
    scoring depends on. held: chunks of rows that are in memory, shared by all parts of a scoring.
    """

    def __init__(self, kept: KeptResults, key: bytes, chunks: Sequence[Chunk], held: _Held | None = None) -> None:
        self._kept, self.key, self._chunks = kept, key, tuple(chunks)
        self._starts = np.cumsum([0, *(chunk.rows for chunk in self._chunks)])
        self._held: _Held = OrderedDict() if held is None else held
        self._parts: dict[tuple[str, str], KeptRows] = {}

    def part(self, ads: str, scenario: str) -> KeptRows:
        """Those of one ADS in one scenario."""
        if (ads, scenario) not in self._parts:
            chunks = [chunk for chunk in self._chunks if (chunk.ads, chunk.scenario) == (ads, scenario)]
            self._parts[ads, scenario] = KeptRows(self._kept, self.key, chunks, self._held)
        return self._parts[ads, scenario]

    def in_scenario(self, scenario: str) -> KeptRows:
        """Those of all ADSs in one scenario."""
        chunks = [chunk for chunk in self._chunks if chunk.scenario == scenario]
        return KeptRows(self._kept, self.key, chunks, self._held)

    def column(self, name: str) -> Iterator[Any]:
        """A field of all rows, without the rest of them."""
        for chunk in self._chunks:
            yield from decode_column(self._data(chunk), name)

    def columns(self, *names: str) -> Iterator[tuple[Any, ...]]:
        """These fields of all rows, without the rest of them."""
        for chunk in self._chunks:
            found = _columns(self._data(chunk), *names)[1]
            yield from zip(*(found[name] for name in names), strict=True)

    def arrays(self, *names: str) -> dict[str, Column]:
        """These fields of all rows as arrays (n,); `values.NAME` is a parameter's."""
        found = {name: _Column(len(self)) for name in names}
        for some in self.arrays_in_parts(*names):
            for name, part in some.items():
                found[name].add(part)
        return {name: found.pop(name).whole() for name in names}

    def arrays_in_parts(self, *names: str) -> Iterator[dict[str, Column]]:
        """These fields as arrays, of some rows after the other."""
        for chunk in self._chunks:
            yield _arrays(self._data(chunk), names)

    def find(self, case: str) -> CaseResult | None:
        """The row of a case; None where there is none."""
        place = next((place for place, name in enumerate(self.column("case")) if name == case), None)
        return None if place is None else self[place]

    def __len__(self) -> int:
        return int(self._starts[-1])

    def __iter__(self) -> Iterator[CaseResult]:
        for number in range(len(self._chunks)):
            yield from self._rows(number)

    @overload
    def __getitem__(self, place: int) -> CaseResult: ...

    @overload
    def __getitem__(self, place: slice) -> Sequence[CaseResult]: ...

    def __getitem__(self, place: int | slice) -> CaseResult | Sequence[CaseResult]:
        if isinstance(place, slice):
            return [self[one] for one in range(*place.indices(len(self)))]
        row = place + len(self) if place < 0 else place
        if not 0 <= row < len(self):
            raise IndexError(place)
        number = int(np.searchsorted(self._starts, row, side="right")) - 1
        return self._rows(number)[row - int(self._starts[number])]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence) or len(self) != len(other):
            return NotImplemented if not isinstance(other, Sequence) else False
        return all(mine == its for mine, its in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"KeptRows({len(self)} cases)"

    def _rows(self, number: int) -> list[CaseResult]:
        place = self._chunks[number].place
        if place in self._held:
            self._held.move_to_end(place)
            return self._held[place]
        rows = decode_rows(self._data(self._chunks[number]))
        self._held[place] = rows
        if len(self._held) > _HELD:
            self._held.popitem(last=False)
        return rows

    def _data(self, chunk: Chunk) -> bytes:
        data = self._kept.get("rows", self.key, chunk.place)
        if data is None:
            raise InputError(f"Rows of {self._kept.path} are gone: somebody took them out. Score the run again.")
        return data
