"""Tables, amounts and intervals on pages of rates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from sumo_eval.report.study_page import Table


def table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """A table of rows by column; a column that a row lacks is empty there."""
    listed = list(rows)
    names = dict.fromkeys(name for row in listed for name in row)
    return Table(
        [name.replace("_", " ") for name in names],
        [[_cell(row.get(name)) for name in names] for row in listed],
    )


def _cell(value: Any) -> str:
    """A value as text: two numbers are the limits of an interval."""
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, float):
        return amount(value)
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_cell(of)}" for name, of in value.items())
    if isinstance(value, Sequence):
        is_interval = len(value) == 2 and isinstance(value[0], float)
        return interval(*value) if is_interval else ", ".join(map(_cell, value))
    return str(value)


def amount(value: float) -> str:
    """A number in three digits, a large one written out: 168,000."""
    shown = f"{value:z.3g}"
    return f"{float(shown):,.0f}" if abs(float(shown)) >= 1000.0 else shown


def interval(low: float, high: float) -> str:
    """Two limits in words."""
    return f"{amount(low)} to {amount(high)}"
