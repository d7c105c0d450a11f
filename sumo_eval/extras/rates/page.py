"""Tables, amounts and intervals, for `learn_page` and `campaign_page`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from sumo_eval.report.study_page import Table


def table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """A table of rows, each column name -> value; where a row lacks a column, the cell is empty."""
    listed = list(rows)
    names = dict.fromkeys(name for row in listed for name in row)
    return Table(
        [name.replace("_", " ") for name in names],
        [[_cell(row.get(name)) for name in names] for row in listed],
    )


def _cell(value: Any) -> str:
    """A value as text; a sequence of two floats is an interval."""
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
    """A number in three digits, from 1,000 on without an exponent: `168,000`."""
    shown = f"{value:z.3g}"
    return f"{float(shown):,.0f}" if abs(float(shown)) >= 1000.0 else shown


def interval(low: float, high: float) -> str:
    """Limits as `0 to 1,230`."""
    return f"{amount(low)} to {amount(high)}"
