"""Points of a space as files: a CSV that can be sampled from again, and a page that draws every
pair of parameters.

Users: `cli/space.py`.
"""

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sumo_eval.report.page import write_csv
from sumo_eval.report.study_page import Table, write_study
from sumo_eval.report.words import count
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import Sample

CHOSEN, REFUSED = "#0072b2", "#9aa1aa"


def write_points(
    logical: LogicalScenario, points: Sample, folder: Path, title: str
) -> tuple[Path, Path]:
    """Write `points.csv` and `points.html` into a folder and return their paths."""
    table, page = folder / "points.csv", folder / "points.html"
    rows = np.column_stack([points.points, points.exposure]).tolist()
    write_csv(table, [*logical.names, "exposure"], rows)
    chosen, refused = (count(len(some), "point") for some in (points.points, points.refused))
    write_study(
        page,
        kicker=f"Points of the logical scenario {logical.name}",
        title=title,
        sentences=[
            f"{chosen} chosen; {refused} refused, because a constraint of the scenario rules them "
            "out. The larger a mark, the more often its point occurs."
        ],
        figures={title: picture(logical, points)},
        data=Table(
            [*(item.title for item in logical.parameters), "exposure"],
            [[f"{value:g}" for value in row] for row in rows],
            table.name,
        ),
        least_width=330 * max(1, len(logical.parameters) - 1),
    )
    return table, page


def picture(logical: LogicalScenario, points: Sample) -> go.Figure:
    """Every parameter against every later one; chosen points, sized by exposure, over points that
    constraints refuse.
    """
    k = len(logical.parameters)
    side = max(1, k - 1)
    # in proportion to the panels: plotly refuses spaces that leave no room for many of them
    spacing = {"horizontal_spacing": 0.24 / side, "vertical_spacing": 0.3 / side}
    figure = make_subplots(rows=side, cols=side, **spacing)
    size = 4.0 + 6.0 * np.sqrt(points.exposure / (points.exposure.max(initial=0.0) or 1.0))
    pairs = [(i, j) for j in range(1, k) for i in range(j)] or [(0, 0)]  # one parameter: alone
    for x, y in pairs:
        cell = {"row": max(y, 1), "col": x + 1}
        for name, rows, colour, symbol, sizes in (
            ("refused", points.refused, REFUSED, "x-thin-open", 5),
            ("chosen", points.points, CHOSEN, "circle", size),
        ):
            figure.add_scatter(
                x=rows[:, x],
                y=rows[:, y] if k > 1 else np.zeros(len(rows)),
                mode="markers",
                name=f"{name}: {len(rows)}",
                legendgroup=name,
                showlegend=y < 2 and x == 0,  # of the first pair, (0, 1) or (0, 0), alone
                marker={"color": colour, "symbol": symbol, "size": sizes, "opacity": 0.75},
                **cell,
            )
        figure.update_xaxes(title_text=logical.parameters[x].title, **cell)
        if k > 1:
            figure.update_yaxes(title_text=logical.parameters[y].title, **cell)
    figure.update_layout(height=300 * side + 120)
    return figure
