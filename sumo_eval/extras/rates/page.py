"""Pieces of pages in the style of the report, some of them folded, and their charts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sumo_eval.report.packing import packed
from sumo_eval.report.page import template, write_page

NUMBER = re.compile(r"-?\d")  # how a cell begins that is set like a number


class Text(NamedTuple):
    """A paragraph.

    kind: `note` where a reader must not miss it.
    """

    sentence: str
    kind: str = ""


class Table(NamedTuple):
    """A table, cells as text."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def numbers(self) -> tuple[bool, ...]:
        """Whether each column holds numbers alone."""
        columns = [[row[j] for row in self.rows if row[j]] for j in range(len(self.header))]
        return tuple(bool(cells) and all(NUMBER.match(cell) for cell in cells) for cells in columns)


class Chart(NamedTuple):
    """A plotly figure under a title."""

    title: str
    figure: Any
    least_width: int = 640  # px; on a narrower screen it scrolls in its frame


class Fold(NamedTuple):
    """A section that opens by a click.

    about: its content, in a few words.
    """

    title: str
    about: str
    parts: tuple[Text | Table | Chart, ...]


Piece = Text | Table | Chart | Fold


def write_parts(
    path: Path, *, kicker: str, title: str, sentences: Sequence[str], parts: Sequence[Piece]
) -> Path:
    """Write a page of pieces and return its path.

    sentences: under its title.
    """
    charts = [
        piece
        for part in parts
        for piece in (part.parts if isinstance(part, Fold) else (part,))
        if isinstance(piece, Chart)
    ]
    numbers = {id(chart): number for number, chart in enumerate(charts)}
    for chart in charts:
        chart.figure.update_layout(title=None, width=None, template="none")
    page = template("parts.html.j2").render(
        kicker=kicker, title=title, sentences=sentences, parts=parts,
        kind=lambda part: type(part).__name__, number=lambda chart: numbers[id(chart)],
        charts=charts,
        figures=packed(f"[{','.join(chart.figure.to_json() for chart in charts)}]"),
    )  # fmt: skip
    return write_page(path, page, "The page")


def table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """A table of rows by column; a column that a row lacks is empty there."""
    listed = list(rows)
    names = dict.fromkeys(name for row in listed for name in row)
    cells = tuple(tuple(_cell(row.get(name)) for name in names) for row in listed)
    return Table(tuple(name.replace("_", " ") for name in names), cells)


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
