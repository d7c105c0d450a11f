"""Rows of named tuples as CSV for machines and as aligned lines for a terminal.

Users: `extras/rates/people_command.py`, `extras/studies/opinion.py`,
`extras/studies/sensitivity.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sumo_eval.report.page import write_csv
from sumo_eval.text import cell


def write_rows(rows: Sequence[Any], path: Path) -> None:
    """One row a named tuple, at least one, fields as columns; a tuple's values stand in one cell,
    separated by spaces.
    """
    write_csv(path, rows[0]._fields, (map(_cell, row) for row in rows))


def _cell(value: Any) -> Any:
    if isinstance(value, tuple):
        value = " ".join(item if isinstance(item, str) else f"{item:g}" for item in value)
    return cell(value)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of words as lines with columns of one width."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
