"""Points of a space as files: a CSV that can be sampled from again, and a page that draws every
pair of parameters.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sumo_eval.report.page import write_csv
from sumo_eval.report.study_page import write_study
from sumo_eval.report.words import count
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import Sample

CHOSEN, REFUSED = "#0072b2", "#9aa1aa"


def write_points(
    logical: LogicalScenario, points: Sample, folder: Path, title: str
) -> tuple[Path, Path]:
    """Write `points.csv` and `points.html` into a folder and return their paths."""
    table, page = folder / "points.csv", folder / "points.html"
    rows = zip(points.points.tolist(), points.exposure.tolist(), strict=True)
    write_csv(table, [*logical.names, "exposure"], ([*row, exposure] for row, exposure in rows))
    write_study(
        page,
        kicker=f"Points of the logical scenario {logical.name}",
        title=title,
        sentences=_sentences(points),
        figures={title: picture(logical, points)},
        rows=[
            [*(item.title for item in logical.parameters), "exposure"],
            *(
                [f"{value:g}" for value in (*row, p)]
                for row, p in zip(points.points.tolist(), points.exposure.tolist(), strict=True)
            ),
        ],
        least_width=330 * max(1, len(logical.parameters) - 1),
    )
    return table, page


def _sentences(points: Sample) -> list[str]:
    """The text above the chart."""
    chosen = (
        f"{count(len(points.points), 'point')} chosen; {count(len(points.refused), 'point')} "
        "refused, because a"
    )
    return [f"{chosen} constraint of the scenario rules them out. A larger mark occurs more often."]


def picture(logical: LogicalScenario, points: Sample) -> go.Figure:
    """Every parameter against every later one; chosen points, sized by exposure, over those that
    constraints refuse.
    """
    k = len(logical.parameters)
    pairs = [(x, y) for y in range(1, k) for x in range(y)] or [(0, 0)]
    side = max(1, k - 1)
    figure = make_subplots(rows=side, cols=side, horizontal_spacing=0.08, vertical_spacing=0.1)
    largest = float(points.exposure.max()) if len(points.exposure) else 1.0
    size = 4.0 + 6.0 * np.sqrt(
        points.exposure / largest if largest > 0.0 else np.ones(len(points.points))
    )
    for place, (x, y) in enumerate(pairs):
        row, column = (1, 1) if k == 1 else (y, x + 1)
        for name, rows, colour, symbol, sizes in (
            (f"refused: {len(points.refused)}", points.refused, REFUSED, "x-thin-open", 5),
            (f"chosen: {len(points.points)}", points.points, CHOSEN, "circle", size),
        ):
            figure.add_trace(
                go.Scatter(
                    x=rows[:, x],
                    y=rows[:, y] if k > 1 else np.zeros(len(rows)),
                    mode="markers",
                    name=name,
                    legendgroup=name,
                    showlegend=place == 0,
                    marker={"color": colour, "symbol": symbol, "size": sizes, "opacity": 0.75},
                ),
                row=row,
                col=column,
            )
        for axis, item, update in ((x, "x", figure.update_xaxes), (y, "y", figure.update_yaxes)):
            parameter = logical.parameters[axis]
            if k > 1 or item == "x":
                update(title_text=parameter.title, row=row, col=column)
    figure.update_layout(height=300 * side + 120)
    return figure
