"""Rows of dataclasses as CSV for machines and as aligned lines for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sumo_eval.report.page import write_csv
from sumo_eval.text import cell

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def write_rows(rows: Sequence[DataclassInstance], path: Path) -> None:
    """One row a dataclass, at least one, fields as columns; a tuple's values stand in one cell,
    separated by spaces.
    """
    plain = [{name: _cell(value) for name, value in asdict(row).items()} for row in rows]
    write_csv(path, plain[0], (row.values() for row in plain))


def _cell(value: Any) -> Any:
    if isinstance(value, tuple):
        value = " ".join(item if isinstance(item, str) else f"{item:g}" for item in value)
    return cell(value)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of words as lines with columns of one width."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
