"""Cases: a record for each, and tables of many that keep every column by itself and read it where
it is asked for.

A million records in memory are some gigabytes; as columns on disk they are a twentieth.
"""

from __future__ import annotations

import json
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import accumulate, chain, groupby
from typing import Any, Final, Literal, overload

import numpy as np
from numpy.typing import NDArray

from sumo_eval.coded import decoded, encoded
from sumo_eval.method.anthropomorphic import IndexNote
from sumo_eval.settings.locators import load_object
from sumo_eval.trajectory import BoolArray, FloatArray

Zone = Literal["safe", "hazardous"]
Column = NDArray[Any]
IntArray = NDArray[np.intp]

# a text, because words are made in a room that builds on this one
_CASE = "sumo_eval.report.notebook:case_html"

EVALUATED = ("ok", "collision", "off_road")
"""Statuses of cases whose outcome counts; all others could not be evaluated."""
OUTCOMES = ("no contact", "collision", "off road", "not evaluated")
"""Outcomes of a case, in the order in which the report shows them."""
GAVE_UP = ("ads_error", "ads_timeout", "timeout", "crashed", "rejected")
"""Statuses of cases that their ADS gave up: they count in T, A, A', H and S+ all the same."""


@dataclass(frozen=True, slots=True)
class ThinReference:
    """A concrete scenario with fewer recorded drivers than an evaluation asks for.

    filled: synthetic drivers who make up for them; None: the case is left out of D instead.
    """

    recorded: int
    least: int
    filled: int | None


def _rule(of: Callable[[Any], Any]) -> Any:
    """A rule on fields as a property: a plain value of a record, an array (n,) of a table."""

    def value(cases: Any) -> Any:
        found = of(cases)
        return (
            found.item()
            if isinstance(cases, CaseResult) and isinstance(found, np.ndarray | np.generic)
            else found
        )

    return property(value, doc=of.__doc__)


def _number(values: Any) -> FloatArray:
    return np.asarray(values, dtype=np.float64)


def _among(status: Any, statuses: Sequence[str]) -> Any:
    return np.isin(status, statuses) if isinstance(status, np.ndarray) else status in statuses


def _known(value: Any) -> Any:
    return np.isfinite(value) if isinstance(value, np.ndarray) else value is not None


def _known_contact(severity: Any) -> Any:
    return np.nan_to_num(severity) != 0.0 if isinstance(severity, np.ndarray) else bool(severity)


class Outcome:
    """Rules on what became of cases: of one record, or of all rows of a table."""

    __slots__ = ()

    @_rule
    def safe(self: Any) -> Any:
        """Whether it lies in the safe zone."""
        return self.zone == "safe"

    @_rule
    def evaluated(self: Any) -> Any:
        """Whether it has an outcome that counts."""
        return _among(self.status, EVALUATED)

    @_rule
    def gave_up(self: Any) -> Any:
        """Whether the ADS gave it up."""
        return _among(self.status, GAVE_UP)

    @_rule
    def counted(self: Any) -> Any:
        """Whether it counts in T, A, H and S+: one given up does."""
        return self.evaluated | self.gave_up

    @_rule
    def missing(self: Any) -> Any:
        """Whether its outcome, Ug or U0 is not known."""
        references = _number(self.ideal_severity) + _number(self.no_reaction_severity)
        return np.logical_not(self.evaluated) | np.isnan(references)

    @_rule
    def off_road(self: Any) -> Any:
        """Whether its centre left the road, whatever the margin."""
        return self.status == "off_road"

    @_rule
    def departed(self: Any) -> Any:
        """Whether it left the road."""
        return _known(self.departure_time)

    @_rule
    def incident(self: Any) -> Any:
        """Whether it holds a contact, a departure or a giving up."""
        return self.collided | self.departed | self.gave_up

    @_rule
    def incident_severity(self: Any) -> Any:
        """U of the worst of its incidents, 0 without one; nan where the harness failed, or giving
        up has no U0.
        """
        hit = np.where(self.collided, _number(self.severity), 0.0)
        worst = np.fmax(hit, np.nan_to_num(_number(self.departure_severity)))
        worst = np.where(self.gave_up, np.maximum(worst, _number(self.no_reaction_severity)), worst)
        return np.where(self.counted, worst, np.nan)

    @_rule
    def avoidable(self: Any) -> Any:
        """Whether it is a collision that the ideal vehicle avoids in the same concrete scenario."""
        return self.collided & (self.ideal_severity == 0.0)

    @_rule
    def unavoidable(self: Any) -> Any:
        """Whether it is a collision that the ideal vehicle has as well."""
        return self.collided & _known_contact(self.ideal_severity)

    @_rule
    def caused(self: Any) -> Any:
        """Whether it is a collision that neither the ideal vehicle nor doing nothing has."""
        return self.avoidable & (self.no_reaction_severity == 0.0)

    @_rule
    def outcome(self: Any) -> Any:
        """Which of `OUTCOMES` it had."""
        gone = self.departed | self.off_road
        flags = [self.collided, np.logical_not(self.evaluated), gone]
        return np.select(flags, ("collision", "not evaluated", "off road"), OUTCOMES[0])

    @_rule
    def kind(self: Any) -> Any:
        """Of a collision: caused, avoidable or unavoidable; "not known" of one without the ideal
        vehicle's outcome.
        """
        kinds = ("caused", "avoidable", "unavoidable")
        return np.select([getattr(self, name) for name in kinds], kinds, "not known")

    @_rule
    def voids_index(self: Any) -> Any:
        """Whether it is a collision after which there is no D: in the safe zone, unless the ideal
        vehicle has it too.

        One whose ideal vehicle could not be evaluated is.
        """
        return self.safe & self.collided & np.logical_not(_known_contact(self.ideal_severity))

    @_rule
    def counts_for_index(self: Any) -> Any:
        """Whether it may have a D_i that counts: in the safe zone and without a collision."""
        return self.safe & np.logical_not(self.collided | self.struck_from_behind)


@dataclass(frozen=True, slots=True)
class CaseResult(Outcome):
    """One concrete scenario driven by one ADS. None: does not apply, or could not be evaluated (see
    `status`).

    severity U and loss L belong to collisions, Eqs. 14-15. ideal_severity Ug and
    no_reaction_severity U0: those of the ideal vehicle and of `no_reaction` in the same concrete
    scenario, 0 where they avoid, None where their drive could not be evaluated, and ideal_error,
    no_reaction_error: why not.

    ideal_collided: whether the former hit something.
    weight: r of Eq. 16, of every case.

    departure_time s, departure_speed m/s: when a corner of the body was first more than
    `road_margin` off the road, and departure_severity: U of a contact beside the road at that
    speed; None where it stayed on the road.

    task_share: t_i, at safe points part of T; None without a reference. no_reaction_severity
        likewise counts departures, ideal_severity contacts alone.

    latency_median and latency_p99: of a step of the ADS, s.

    latency_reference: median of a fixed piece of work, timed between the steps in the same process,
        s;
    latency_relative: latency_median over it.

    index (in tables also `d_i`): D_i and its factors, of safe-zone cases without a collision, Eqs.
        11-12. Beside it the
    terms of H: operation_tolerance f_n+, mixture_similarity, plausibility (of every evaluated case)
    and human_likeness, which is 0 for a safe case with a collision that the ideal vehicle avoids.

    min_ttc s, max_ittc 1/s, min_thw s, min_gap m, max_drac m/s2, pet s, max_deceleration m/s2,
    max_jerk m/s3 and delta_v m/s as in `sumo_eval.method.measures`; None where a measure is not
    defined or has no bound. largest_offset m, overshoot m, over_line_time s and settling_time s:
    how the lane was kept. conflict_pet s: PET of the drive where an actor's way conflicts with the
    ego's; undisturbed_pet s and time_to_conflict s: PET of both, and how long until the ego is at
    the conflict area, if neither reacts.

    struck_from_behind: a vehicle that reacts ran into the ego's rear and is at fault; such a case
        is not `collided`. Its task_share is 0: any contact ends the drive,
        whichever vehicle is at fault.

    Safe-zone cases: drivers that D_i is computed from, recorded people among them;

    reference_note: where they are too few;
    human_low, human_mean, human_high: what these drivers score when each is left out once;
    bimodal: whether they fall into two groups somewhere; manoeuvre of the ADS and the share of
        drivers who made it (mixture mode).
    exposure_note: whether the point lies outside the support of recorded events.
    error_place: file, line and function of the user's code that the exception in `error` came from.
    no_return_time s: of a contact, the last moment at which full braking avoids it, None where none
        does, braking_time s: when the ADS first braked, and contact_cause: see `cause_of_contact`.
    batched: of an ADS that asks SUMO and shared it with other cases: "batched", or "compared" with
        the case alone, and equal.
    requirements_missed: names of the requirements of the scenario that do not hold in the drive, ""
        where all do, None where nothing is required or nothing was evaluated.
    """

    case: str
    scenario: str
    ads: str
    values: Mapping[str, float]
    zone: Zone
    exposure: float
    status: str
    end_reason: str | None
    error: str | None
    wall_time: float | None
    simulated_time: float | None
    latency_mean: float | None
    latency_max: float | None
    collided: bool
    impact_speed: float | None = None
    overlap: float | None = None
    side: str | None = None
    severity: float | None = None
    loss: float | None = None
    ideal_severity: float | None = None
    weight: float | None = None
    beats_ideal: bool = False
    index: float | None = None
    length_factor: float | None = None
    operation_factor: float | None = None
    similarity: float | None = None
    index_note: tuple[IndexNote, ...] = ()
    clips: str = ""
    ideal_collided: bool | None = None
    min_ttc: float | None = None
    max_ittc: float | None = None
    min_thw: float | None = None
    min_gap: float | None = None
    max_drac: float | None = None
    pet: float | None = None
    max_deceleration: float | None = None
    max_jerk: float | None = None
    delta_v: float | None = None
    drivers: int | None = None
    recorded_drivers: int | None = None
    reference_note: ThinReference | None = None
    human_low: float | None = None
    human_mean: float | None = None
    human_high: float | None = None
    bimodal: bool = False
    manoeuvre: str = ""
    manoeuvre_share: float | None = None
    exposure_note: Literal["", "outside_support"] = ""
    error_place: str = ""
    no_reaction_severity: float | None = None
    operation_tolerance: float | None = None
    mixture_similarity: float | None = None
    plausibility: float | None = None
    human_likeness: float | None = None
    struck_from_behind: bool = False
    largest_offset: float | None = None
    overshoot: float | None = None
    over_line_time: float | None = None
    settling_time: float | None = None
    requirements_missed: str | None = None
    conflict_pet: float | None = None
    undisturbed_pet: float | None = None
    time_to_conflict: float | None = None
    ideal_error: str = ""
    no_reaction_error: str = ""
    task_share: float | None = None
    departure_time: float | None = None
    departure_speed: float | None = None
    departure_severity: float | None = None
    latency_median: float | None = None
    latency_p99: float | None = None
    latency_reference: float | None = None
    latency_relative: float | None = None
    no_return_time: float | None = None
    braking_time: float | None = None
    contact_cause: str = ""
    batched: str = ""

    def _repr_html_(self) -> str:
        """The table for a notebook."""
        shown: str = load_object(_CASE, None, "Case")(self)
        return shown


# --- tables ---------------------------------------------------------------------------------------

_RECORDS: Final = {one.__name__: one for one in (ThinReference, IndexNote)}
_TYPES: Final = {item.name: str(item.type) for item in fields(CaseResult)}
_PLACES: Final = {name: place for place, name in enumerate(_TYPES)}
COLUMNS: Final = len(_PLACES) + 100
"""Columns that rows may have: their fields, and behind them a parameter each."""
NUMBERS: Final = tuple(
    name for name, kind in _TYPES.items() if kind.startswith(("float", "bool", "int"))
)
"""Fields that hold numbers or truth values."""
_TEXT: Final = np.dtypes.StringDType()
_HELD = 32  # chunks whose records are in memory at a time


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """Rows of one ADS in one scenario that are kept together.

    columns: the bytes of columns, by their places.
    """

    scenario: str
    ads: str
    rows: int
    columns: Callable[[slice], list[bytes]]


def encode_rows(rows: Sequence[CaseResult]) -> list[bytes]:
    """The columns of rows whose parameters have the same names, each deflated by itself."""
    names = list(rows[0].values)
    columns = [
        _encoded(name, [getattr(row, name) for row in rows]) for name in _TYPES if name != "values"
    ]
    columns.insert(_PLACES["values"], encoded(names))
    return columns + [_encoded("", [row.values[name] for row in rows]) for name in names]


def _is_real(name: str) -> bool:
    """Whether a column holds real numbers; without a name it is a parameter's."""
    return not name or _TYPES[name].startswith("float")


def _encoded(name: str, values: Sequence[Any]) -> bytes:
    """Real numbers as their bits, byte by byte; anything else as what occurs, and which of it each
    row has.
    """
    if _is_real(name):
        numbers = _with_nan(values)
        return zlib.compress(numbers.view(np.uint8).reshape(-1, 8).T.tobytes(), 1)
    places: dict[Any, int] = {}
    which = [places.setdefault(value, len(places)) for value in values]
    return zlib.compress(np.array(which, dtype="<u4").tobytes() + encoded(list(places)), 1)


def _with_nan(values: Sequence[float | None]) -> FloatArray:
    """Numbers (n,), nan for None."""
    return np.array([np.nan if value is None else value for value in values], dtype="<f8")


def _real(data: bytes, rows: int) -> FloatArray:
    planes = np.frombuffer(zlib.decompress(data), dtype=np.uint8).reshape(8, rows)
    return np.ascontiguousarray(planes.T).view("<f8").reshape(rows)


def _listed(data: bytes, rows: int) -> tuple[tuple[Any, ...], IntArray]:
    """Distinct values of a column, and which of them each row has, (n,)."""
    body = zlib.decompress(data)
    return decoded(body[4 * rows :], _RECORDS), np.frombuffer(body[: 4 * rows], dtype="<u4").astype(
        np.intp
    )


@lru_cache(256)
def _array_of(chunk: Chunk, name: str, place: int) -> Column:
    """A column of a chunk, by its name and its place; those that were asked for last wait in some
    megabytes.
    """
    return _array(name, chunk.columns(slice(place, place + 1))[0], chunk.rows)


def _array(name: str, data: bytes, rows: int) -> Column:
    """A column as an array (n,): numbers with nan for None, truth values, texts with "" for None,
    else objects.
    """
    if _is_real(name):
        return _real(data, rows)
    values, which = _listed(data, rows)
    kind = _TYPES[name]
    if kind == "bool":
        return np.array(values, dtype=np.bool_)[which]
    if name in NUMBERS:
        return _with_nan(values)[which]
    if kind.startswith(("str", "Zone", "Literal")):
        return np.array([value or "" for value in values], dtype=_TEXT)[which]
    found = np.empty(len(values), dtype=object)
    found[:] = values
    return found[which]


def _plain(name: str, data: bytes, rows: int) -> list[Any]:
    """A column as the values of records."""
    if _is_real(name):
        numbers = _real(data, rows)
        found: list[Any] = numbers.tolist()
        for place in np.flatnonzero(np.isnan(numbers)).tolist():
            found[place] = None
        return found
    values, which = _listed(data, rows)
    return [values[place] for place in which.tolist()]


@lru_cache(_HELD)
def records_of(chunk: Chunk) -> list[CaseResult]:
    """The records of a chunk."""
    data = chunk.columns(slice(COLUMNS))  # at once: a query for each took a fifth longer
    names: list[str] = json.loads(data[_PLACES["values"]])
    parameters = [_plain("", one, chunk.rows) for one in data[len(_PLACES) :]]
    values = [dict(zip(names, point, strict=True)) for point in zip(*parameters, strict=True)]
    columns = (
        (values or [{}] * chunk.rows) if name == "values" else _plain(name, data[place], chunk.rows)
        for name, place in _PLACES.items()
    )
    return [CaseResult(*row) for row in zip(*columns, strict=True)]


class CaseTable(Outcome):
    """Rows of cases. A field of `CaseResult` is a column, an array (n,): nan and "" stand for None.

    rows: which of the chunks' rows these are; None: all.
    key: what a kept scoring depends on.
    """

    def __init__(
        self, chunks: Iterable[Chunk], rows: IntArray | None = None, key: bytes | None = None
    ) -> None:
        self.chunks, self.rows, self.key = tuple(chunks), rows, key
        self._ends = list(accumulate(chunk.rows for chunk in self.chunks))

    @classmethod
    def of(cls, rows: Iterable[CaseResult] | CaseTable) -> CaseTable:
        """A table of these records, in their order; of a table that has all rows of its chunks
        itself.
        """
        if isinstance(rows, CaseTable) and rows.rows is None:
            return rows
        alike = groupby(rows, key=lambda row: (row.scenario, row.ads, *row.values))
        return cls(
            Chunk(row[0], row[1], len(some), encode_rows(some).__getitem__)
            for row, some in ((row, list(group)) for row, group in alike)
        )

    def part(self, scenario: str, ads: str | None = None) -> CaseTable:
        """The rows in one scenario, of one ADS or of all, of a table that has all rows of its
        chunks.
        """
        return CaseTable(
            one for one in self.chunks if one.scenario == scenario and ads in (None, one.ads)
        )

    def parameters(self, names: Sequence[str]) -> FloatArray:
        """Points of the cases, (n, k): the parameters of these names."""
        found, first = np.empty((sum(chunk.rows for chunk in self.chunks), len(names))), 0
        for chunk in self.chunks:
            known = json.loads(chunk.columns(slice(_PLACES["values"], _PLACES["values"] + 1))[0])
            for place, name in enumerate(names):
                column = len(_PLACES) + known.index(name)
                found[first : first + chunk.rows, place] = _array_of(chunk, "", column)
            first += chunk.rows
        return found if self.rows is None else found[self.rows]

    def __getattr__(self, name: str) -> Column:
        if name not in _PLACES or name == "values":
            raise AttributeError(name)
        parts = [_array_of(chunk, name, _PLACES[name]) for chunk in self.chunks]
        found = np.concatenate(parts) if parts else _array(name, _encoded(name, []), 0)
        return found if self.rows is None else found[self.rows]

    def __len__(self) -> int:
        return sum(chunk.rows for chunk in self.chunks) if self.rows is None else len(self.rows)

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
        number = bisect_right(self._ends, row)
        chunk = self.chunks[number]
        return records_of(chunk)[row - self._ends[number] + chunk.rows]


def counts(cases: CaseTable) -> dict[str, int]:
    """Number of cases with each outcome, by the names of `ScenarioResult`."""
    flags = {name: getattr(cases, flag) for name, flag in _FLAGS.items()}
    flags |= {"safe_collisions": cases.collided & cases.safe, "not_evaluated": ~cases.evaluated}
    return {name: int(np.count_nonzero(flag)) for name, flag in flags.items()}


_FLAGS = {
    "collisions": "collided", "avoidable_collisions": "avoidable",
    "unavoidable_collisions": "unavoidable", "caused_collisions": "caused", "off_road": "off_road",
    "departures": "departed", "gave_up": "gave_up",
}  # fmt: skip


def point_numbers(tables: Sequence[CaseTable]) -> list[IntArray]:
    """A number for each point of the space that some cases lie at, the same in all tables: (n,) for
    each table.

    The cases of all tables have the same parameters, by name.
    """
    ends = np.cumsum([len(table) for table in tables])
    point = np.zeros(int(ends[-1]) if len(ends) else 0, dtype=np.intp)
    if len(point):
        for name in sorted(next(table for table in tables if len(table))[0].values):
            read = np.concatenate(
                [table.parameters([name]).ravel() for table in tables if len(table)]
            )
            values = np.unique(read, return_inverse=True)[1]
            point = np.unique(point * (int(values.max()) + 1) + values, return_inverse=True)[1]
    return np.split(point, ends[:-1])
