"""The page of a study: a few sentences, charts that can be saved, and their table, in the style of
the report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import plotly.graph_objects as go

from sumo_eval.report.packing import packed
from sumo_eval.report.page import template, write_page

MOST_ROWS = 400  # of the table; the files beside the page have all of them


def write_study(
    path: Path,
    *,
    kicker: str,
    title: str,
    sentences: Sequence[str],
    figures: Mapping[str, go.Figure],
    rows: Sequence[Sequence[str]] = (),
    least_width: int = 640,
) -> Path:
    """Write the page and return its path.

    figures: the charts by what stands over them; each stays whole on paper where a sheet has room
        for it.
    rows: the table below them, its head first.
    least_width: of a chart, px; it scrolls on narrower screens.
    """
    for figure in figures.values():
        figure.update_layout(
            title=None, width=None, template="none", margin={"l": 60, "r": 20, "t": 60, "b": 50}
        )
        figure.update_layout(
            legend={"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "top", "yref": "container"}
        )
    drawn = ",".join(figure.to_json() for figure in figures.values())
    page = template("study.html.j2").render(
        kicker=kicker, title=title, sentences=sentences, head=list(rows[0]) if rows else [],
        rows=[list(row) for row in rows[1 : MOST_ROWS + 1]], more=max(0, len(rows) - 1 - MOST_ROWS),
        charts=[(caption, int(figure.layout.height or 520)) for caption, figure in figures.items()],
        least_width=least_width,
        figures=packed(f"[{drawn}]"),
    )  # fmt: skip
    return write_page(path, page, "The page")
