"""Appearance and saving of figures: widths, fonts, and the look of each ADS.

`of_scenes`, `of_scores` and `of_studies` draw with it, `command` saves with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sumo_eval.errors import InputError, check_known, needs_extra
from sumo_eval.extras.panels import COLOURS, INK, MUTED, Panel, add_title_and_legend, draw
from sumo_eval.input_file import writing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1.0 / 25.4  # a millimetre in inches
WIDTHS = {"column": 88.0 * MM, "page": 180.0 * MM}
"""Widths of figures, inches: one column and both columns of a journal's page."""

ENDINGS = {"svg": {"Date": None}, "png": {}, "pdf": {"CreationDate": None}}
"""Ending of a figure's file -> its metadata: without a date, the same figure is the same bytes."""

# As many as `COLOURS`, with which `look_of` combines them. matplotlib takes a line as a name, or as
# (offset, lengths of dashes and gaps in widths of the line).
MARKERS = "o", "s", "^", "D", "v", "P", "X", "*"
LINES = "-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (8, 2))

_SETTINGS = {
    "font.size": 7.5,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 8.0,
    "axes.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": False,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.6,
    "figure.dpi": 150.0,
    "savefig.dpi": 300.0,
    "pdf.fonttype": 42,  # TrueType fonts within the file
    "svg.fonttype": "path",  # letters as outlines
    "svg.hashsalt": "sumo_eval",  # else the file's identifiers are random
    "axes.unicode_minus": True,
    "text.parse_math": False,  # a name may hold `$`
}
"""Settings of matplotlib: sizes of fonts in points, widths of lines in points."""


def refuse_without_matplotlib() -> None:
    """Raise InputError if matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise needs_extra("A figure", "plots")


@contextmanager
def styled() -> Iterator[None]:
    """Context that gives figures drawn in it the appearance of `_SETTINGS`.

    Raises InputError if matplotlib is not installed.
    """
    refuse_without_matplotlib()
    import matplotlib as mpl

    with mpl.rc_context(_SETTINGS):  # type: ignore[arg-type]  # names as strings
        yield


def width_of(width: str) -> float:
    """A named width, inches.

    Raises InputError for an unknown name.
    """
    check_known("width", WIDTHS, width)
    return WIDTHS[width]


def new_figure(width: str, height: float, rows: int, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """A figure of `rows` x `columns` panels and its panels, row by row.

    height: of the figure, as a share of its width.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from sumo_eval.report.drawing import Drawing

    across = width_of(width)
    figure = Drawing(figsize=(across, across * height), layout="constrained")
    FigureCanvasAgg(figure)  # attaches itself: the figure draws without a window
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def on_paper(
    panels: Sequence[Panel], width: str, height: float, columns: int = 1, words: str = ""
) -> Figure:  # fmt: skip
    """Panels as a figure of matplotlib.

    width: a key of `WIDTHS`.
    height: of each panel, as a share of its width.
    columns: panels in a row.
    words: title of the figure.
    """
    rows = -(-len(panels) // columns)  # rounded up
    with styled():
        # title and legend have 0.1 of the width
        figure, axes = new_figure(width, height * rows / columns + 0.1, rows, columns)
        named = {""}  # names in the legend; marks without a name need no entry
        for ax, panel in zip(axes, panels, strict=False):
            draw(ax, panel, named)
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        add_title_and_legend(figure, words)
    return figure


def ending_of(path: Path) -> str:
    """The ending of a figure's file: `svg`, `png` or `pdf`.

    Raises InputError for any other.
    """
    ending = path.suffix.lower().lstrip(".")
    if ending not in ENDINGS:
        raise InputError(
            f"The figure's file must end in one of {', '.join(f'.{name}' for name in ENDINGS)}, "
            f"got {path.name!r}."
        )
    return ending


def save(figure: Figure, path: Path) -> Path:
    """Write a figure in the format of its file's ending, and return the path.

    Raises InputError for another ending, or where the file cannot be written.
    """
    ending = ending_of(path)
    with writing(f"The figure {path}", path.parent), styled():
        figure.savefig(path, format=ending, metadata=ENDINGS[ending])
    return path


def look_of(ads: str, names: Sequence[str]) -> tuple[str, str, Any]:
    """Colour, marker and line style of an ADS, so that nothing depends on colour alone.

    names: of all ADSs in the figure.
    """
    count, index = len(COLOURS), list(names).index(ads)
    # from the ninth ADS on, colours come again, each with another style
    style = (index + index // count) % count
    return COLOURS[index % count], MARKERS[style], LINES[style]


def label(name: str, unit: str = "") -> str:
    """Axis label of a parameter or quantity, as `ego speed (m/s)`."""
    words = name.replace("_", " ")
    return f"{words} ({unit})" if unit else words
