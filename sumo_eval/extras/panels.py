"""Charts, described once for `figures`, `studies` and `rates`: plotly draws them on a page,
matplotlib in a figure for print.

Users: `extras/figures/`, `extras/rates/`, `extras/studies/`.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.frozen import frozen

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, FAINT = "#1b1f24", "#5b6670", "#c9d0d6"  # greys of lines and words, darkest first
SAFE, HAZARDOUS = "#e6f1f8", "#fbd9b5"  # areas of the zones
COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#000000",
    "#8a8f00",
)
"""Colours of ADSs, in order, distinct for every colour vision: of Okabe and Ito (2008), the
yellow darker.
"""

COLOURED_LINES = [(colour, line) for line in ("-", "--", "-.", ":") for colour in COLOURS]
"""Colours and line styles of ADSs on pages, in order: a ninth ADS has the first colour and dashes.
"""

_ON_PAGES = {
    "": None, "o": "circle", "X": "x", "-": "solid", "--": "dash", "-.": "dashdot", ":": "dot",
}  # fmt: skip
"""matplotlib's style of a line or marker -> plotly's name; None: it is not drawn."""


@frozen(eq=False)
class Marks:
    """Points of a panel, or a line through them.

    name: entry of the legend, which shows each name once; empty: no entry.
    x, y: of the points, (n,).
    line, marker: matplotlib's styles; empty: not drawn. Pages have only those of `_ON_PAGES`.
    bars: whether bars are drawn instead of line and marker; on a page only.
    spread: half the length of each point's error bar along x, (n,); None: no error bars.
    words: text of each point, on a page only.
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    colour: str = INK
    line: Any = ""
    marker: str = ""
    bars: bool = False
    spread: ArrayLike | None = None
    words: Sequence[str] | None = None


@frozen(eq=False)
class Panel:
    """One chart.

    x, y: labels of its axes. Without x the panel shares the axis of the panel below.
    title: above the panel.
    verticals: x of vertical lines across the whole panel.
    chance: map of safe and hazardous areas: x (m,), y (n,) and values (n, m), hazardous above 0.5.
        None: no map.
    range_: ends of the x axis; None: the library chooses them from the marks.
    """

    marks: Sequence[Marks]
    x: str = ""
    y: str = ""
    title: str = ""
    verticals: Sequence[float] = ()
    chance: tuple[Any, Any, Any] | None = None
    range_: tuple[float, float] | None = None


def on_page(panels: Sequence[Panel], columns: int, height: int) -> go.Figure:
    """Draw panels as one figure of plotly.

    columns: panels in a row.
    height: of the figure, px.
    """
    from plotly.subplots import make_subplots

    rows = -(-len(panels) // columns)  # rounded up
    # plotly takes the spaces between panels as shares of the figure
    figure = make_subplots(
        rows, columns, subplot_titles=[panel.title for panel in panels],
        vertical_spacing=0.3 / rows, horizontal_spacing=0.2 / columns,
    )  # fmt: skip
    named = {""}  # names in the legend; marks without a name need no entry
    for number, panel in enumerate(panels):
        at = {"row": number // columns + 1, "col": number % columns + 1}
        if panel.chance is not None:
            x, y, z = panel.chance
            levels = {"start": 0.5, "end": 0.5, "size": 1, "coloring": "heatmap"}
            figure.add_contour(
                x=x, y=y, z=z, contours=levels, colorscale=[[0.0, SAFE], [1.0, HAZARDOUS]],
                zmin=0.0, zmax=1.0, showscale=False, line={"color": INK, "width": 2},
                hoverinfo="skip", **at,
            )  # fmt: skip
        for marks in panel.marks:
            _add_marks(figure, marks, at, in_legend=marks.name not in named)
            named.add(marks.name)
        for x in panel.verticals:
            figure.add_vline(x=x, line={"dash": "dot", "width": 1}, **at)
        figure.update_xaxes(title_text=panel.x, range=panel.range_, **at)
        figure.update_yaxes(title_text=panel.y, **at)
    figure.update_annotations(font_size=12)
    return figure.update_layout(height=height, bargap=0.0)


def _add_marks(figure: go.Figure, marks: Marks, at: dict[str, int], *, in_legend: bool) -> None:
    """Draw marks in one panel; at: its `row` and `col`, from 1."""
    legend = {"name": marks.name, "legendgroup": marks.name, "showlegend": in_legend}
    if marks.bars:
        figure.add_bar(
            x=marks.x, y=marks.y, marker={"color": marks.colour}, opacity=0.55, **legend, **at
        )
        return
    styles = (("lines", marks.line), ("markers", marks.marker))
    mode = "+".join(shape for shape, style in styles if style)  # as `lines+markers`
    figure.add_scatter(
        x=marks.x, y=marks.y, mode=mode, text=marks.words, **legend, **at,
        line={"color": marks.colour, "dash": _ON_PAGES[marks.line]},
        marker={"color": marks.colour, "symbol": _ON_PAGES[marks.marker]},
        error_x=None if marks.spread is None else {"type": "data", "array": marks.spread},
    )  # fmt: skip


def draw(ax: Axes, panel: Panel, named: set[str]) -> None:
    """Draw a panel with matplotlib.

    named: names in the figure's legend; the names of this panel are added.
    """
    if panel.chance is not None:
        ax.contourf(*panel.chance, levels=[-np.inf, 0.5, np.inf], colors=[SAFE, HAZARDOUS])
        edge_of(ax, panel.chance, 0.5, INK, "-")
    for it in panel.marks:
        # a space before: matplotlib leaves a label that begins with `_` out of the legend
        label = "" if it.name in named else re.sub("^_", " _", it.name)
        named.add(it.name)
        # An unclipped marker at the axes' edge is drawn whole. Marks without points, which only
        # fill the legend, must be clipped: otherwise the layout fails.
        clipped = not it.marker or np.size(it.x) == 0
        ax.errorbar(
            it.x, it.y, xerr=it.spread, color=it.colour, ls=it.line, marker=it.marker, label=label,
            elinewidth=0.6, markeredgecolor=INK, markeredgewidth=0.3, clip_on=clipped,
            zorder=1 if it.colour == FAINT else 2,  # faint marks lie below all others
        )  # fmt: skip
    for x in panel.verticals:
        ax.axvline(x, color=FAINT, linewidth=3.0, zorder=0)
    ax.set(xlabel=panel.x, ylabel=panel.y, title=panel.title, xlim=panel.range_)
    ax.tick_params(labelbottom=bool(panel.x))


def edge_of(ax: Axes, map_: tuple[Any, Any, Any], level: float, colour: str, line: str) -> None:
    """Draw the line at a level of a map, as `Panel.chance`, if it has values on both sides."""
    x, y, z = map_
    if np.nanmin(z) < level < np.nanmax(z):
        ax.contour(x, y, z, levels=[level], colors=[colour], linestyles=[line], linewidths=0.9)


def add_title_and_legend(figure: Figure, title: str) -> None:
    """Put a title above a figure, wrapped to its width, and a legend below it if marks have
    names.
    """
    # figures are 3.5 inches wide (one column of a paper) or 7.1 inches (its page)
    one_column = figure.get_figwidth() < 5.0
    handles_and_labels = (ax.get_legend_handles_labels() for ax in figure.axes)
    if any(labels for _, labels in handles_and_labels):
        figure.legend(loc="outside lower center", ncols=2 if one_column else 4)
    longest_line = 50 if one_column else 100  # characters
    lines = (textwrap.fill(line, longest_line) for line in title.split("\n"))
    figure.suptitle("\n".join(lines), fontsize=7.0)
