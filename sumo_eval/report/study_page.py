"""Pages of studies in the style of the report: sentences, tables and charts that can be saved, some
of them folded.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sumo_eval.report.page import packed, template, write_page
from sumo_eval.report.words import count

MOST_ROWS = 400  # of a study's table; the files beside the page have all of them


class Text(NamedTuple):
    """A paragraph.

    kind: `note` where a reader must not miss it.
    """

    sentence: str
    kind: str = ""


class Table(NamedTuple):
    """A table, cells as text."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def numbers(self) -> tuple[bool, ...]:
        """Whether each column holds numbers alone, by how its cells begin."""
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


def write_study(
    path: Path,
    *,
    kicker: str,
    title: str,
    sentences: Sequence[str],
    figures: Mapping[str, Any],
    rows: Sequence[Sequence[str]] = (),
    least_width: int = 640,
) -> Path:
    """Write a page of charts and their table, and return its path.

    kicker: the small line above the title.
    figures: plotly figures by title; in print none is split over two sheets if it fits on one.
    rows: the table below them, its head first.
    least_width: of a chart, px; it scrolls on narrower screens.
    """
    for figure in figures.values():
        figure.update_layout(
            margin={"l": 60, "r": 20, "t": 60, "b": 50},
            legend={"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "top", "yref": "container"},
        )
    parts: list[Piece] = [Chart(*item, least_width) for item in figures.items()]
    if rows:
        head, *cells = rows
        about = count(len(cells), "row")
        if len(cells) > MOST_ROWS:
            about += f", the first {MOST_ROWS} here; the files beside this page have all"
        parts.append(Fold("Table", about, (Table(head, cells[:MOST_ROWS]),)))
    return write_parts(path, kicker=kicker, title=title, sentences=sentences, parts=parts)


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
    for chart in charts:
        chart.figure.update_layout(title=None, width=None, template="none")
    page = template("study.html.j2").render(
        kicker=kicker, title=title, sentences=sentences, parts=parts, charts=charts,
        figures=packed(f"[{','.join(chart.figure.to_json() for chart in charts)}]"),
    )  # fmt: skip
    return write_page(path, page, "The page")
