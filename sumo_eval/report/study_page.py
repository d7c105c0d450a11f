"""Pages of studies in the style of the report: sentences, tables and charts, some of them folded.

Users: `report/points_page.py`, `extras/rates/` and `extras/studies/`. The template reads the names
of the classes and of their fields.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sumo_eval.report.page import packed, write_filled
from sumo_eval.report.words import count

MOST_ROWS = 400  # that `write_study` shows where a file beside the page has all rows


class Text(NamedTuple):
    """A paragraph.

    kind: `note` where a reader must not miss it.
    """

    sentence: str
    kind: str = ""


class Table(NamedTuple):
    """A table, cells as text.

    file: name of the file beside the page that has all rows, too; "": there is none.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    file: str = ""

    @property
    def numbers(self) -> tuple[bool, ...]:
        """Whether each cell of a column that is not empty begins as a number does."""
        columns = [[row[j] for row in self.rows if row[j]] for j in range(len(self.header))]
        return tuple(
            bool(cells) and all(re.match(r"-?\d", it) for it in cells) for cells in columns
        )


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
    parts: Sequence[Text | Table | Chart]


Piece = Text | Table | Chart | Fold


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


def write_study(
    path: Path,
    *,
    kicker: str,
    title: str,
    sentences: Sequence[str],
    figures: Mapping[str, Any],
    data: Table | None = None,
    least_width: int = 640,
) -> Path:
    """Write a page of charts and their table, and return its path.

    kicker, sentences: as of `write_parts`.
    figures: plotly figures by title; their margins and legends change.
    data: the table below them. Of a long one with a file, the page has the first rows only.
    least_width: of each chart, px.
    """
    for figure in figures.values():
        figure.update_layout(
            margin={"l": 60, "r": 20, "t": 60, "b": 50},
            legend={"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "top", "yref": "container"},
        )
    parts: list[Piece] = [Chart(*item, least_width) for item in figures.items()]
    if data is not None:
        about = count(len(data.rows), "row")
        if data.file and len(data.rows) > MOST_ROWS:
            about += f", the first {MOST_ROWS} here; {data.file} beside this page has all"
            data = data._replace(rows=data.rows[:MOST_ROWS])
        parts.append(Fold("Table", about, (data,)))
    return write_parts(path, kicker=kicker, title=title, sentences=sentences, parts=parts)


def write_parts(
    path: Path, *, kicker: str, title: str, sentences: Sequence[str], parts: Sequence[Piece]
) -> Path:
    """Write a page and return its path.

    kicker: the small line above the title.
    sentences: those below the title.
    """
    charts = [
        part
        for piece in parts
        for part in (piece.parts if isinstance(piece, Fold) else (piece,))
        if isinstance(part, Chart)
    ]
    for chart in charts:
        chart.figure.update_layout(title=None, width=None, template="none")
    return write_filled(
        path, "study.html.j2", "The page",
        kicker=kicker, title=title, sentences=sentences, parts=parts, charts=charts,
        figures=packed(f"[{','.join(chart.figure.to_json() for chart in charts)}]")
    )  # fmt: skip
