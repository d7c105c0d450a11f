"""The map of a space: its two axes, its panels along a third parameter, its slice through the rest.

Users: `extras/figures/of_scenes.py`, `report/density.py`, `report/html.py`, `report/junit.py`,
`report/page_data.py`, `scoring/zone_levels.py`.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.trajectory import FloatArray, IntArray

# Most panels with one value of a parameter each. With more values there are GATHERED_PANELS panels,
# and each case is drawn in the nearest. The page receives both, for panels of other parameters.
MOST_PANELS = 12
GATHERED_PANELS = 6
SMALLEST_SLICE = 0.1  # share of the cases; if a slice has fewer, all cases are drawn on it


class View(NamedTuple):
    """Choice of what a map of a space shows. A parameter is given by its column in `names`.

    A figure shows this view. The page opens with its axes and panels, at `telling_slice`. There the
    reader may choose others, and a slice may have a thickness (`templates/maps.js`).

    names: of all parameters.
    x, y: parameters of the axes; y is None for a space of one parameter, whose map is a strip.
    panel: the parameter of the panels; None: there is a single panel.
    panels: value of the `panel` parameter in each panel; (None,) for a single panel.
    fixed: the slice: column -> value of each parameter without an axis or panels.
    projected: whether a figure draws cases off the slice on it too; in the page its sliders decide.
    gathered: whether the panels' values are evenly spaced, and each case is drawn in the nearest
        panel.
    """

    names: tuple[str, ...]
    x: int
    y: int | None
    panel: int | None
    panels: tuple[float | None, ...]
    fixed: Mapping[int, float]
    projected: bool
    gathered: bool = False

    def panel_of(self, row: FloatArray) -> int:
        """Index of the panel nearest to a point of the space, (k,)."""
        if self.panel is None:
            return 0
        return int(np.argmin(np.abs(row[self.panel] - np.array(self.panels))))

    def shows(self, case: CaseResult) -> bool:
        """Whether a figure draws a case; `shows` in `templates/maps.js` decides it for the page."""
        return self.projected or all(
            case.values[self.names[column]] == value for column, value in self.fixed.items()
        )


def choose_view(
    logical: LogicalScenario, cases: CaseTable, axes: tuple[str, str] | None = None
) -> View:
    """The map of a space, chosen by the number of its parameters. The page opens with it.

    cases: that the map shows.
    axes: names of x and y from the settings; None: chosen here.

    - One or two parameters: a single panel.
    - Three without `axes`: a panel for each value of the first, the other two are x and y.
    - More, or three with `axes`: x and y are `axes`, else the two parameters with most different
      values. A slice fixes each other parameter at its most common value.
    """
    names, columns = logical.names, range(len(logical.parameters))
    if len(columns) < 3:
        x, *more = map(logical.column, axes or names)
        return View(names, x, more[0] if more else None, None, (None,), {}, projected=True)
    if len(columns) == 3 and axes is None:
        panels = np.unique(cases.parameters(names[:1])).tolist()
        if gathered := len(panels) > MOST_PANELS:
            first = logical.parameters[0]
            panels = np.linspace(first.low, first.high, GATHERED_PANELS).tolist()
        return View(names, 1, 2, 0, tuple(panels), {}, projected=True, gathered=gathered)
    points = cases.parameters(names)
    number, common = zip(*map(_variety, points.T), strict=True)
    by_variety = sorted(columns, key=lambda column: -number[column])
    x, y = sorted(by_variety[:2]) if axes is None else map(logical.column, axes)
    fixed = {column: common[column] for column in columns if column not in (x, y)}
    on_slice = np.all(points[:, list(fixed)] == list(fixed.values()), axis=1)
    projected = int(np.count_nonzero(on_slice)) < SMALLEST_SLICE * len(cases)
    return View(names, x, y, None, (None,), fixed, projected)


def _variety(column: FloatArray) -> tuple[int, float]:
    """Number of different values of a parameter, and its most common value.

    column: of the parameter, one value a case, (n,).

    Of several equally common values the least counts; if each value occurs once, the middle one.
    """
    values, counts = np.unique(column, return_counts=True)
    chosen = len(values) // 2 if counts.max() == 1 else np.argmax(counts)
    return len(values), float(values[chosen])


def telling_slice(view: View, cases: CaseTable) -> dict[int, float]:
    """The slice with most incidents (contact, departure, giving up), for a figure and for the page
    as it opens: column -> value.

    Of slices with equally many incidents the one with the least values counts. Empty if the view
    fixes no parameter, or draws all cases on one slice. Then the page opens at the worst case
    (`opening` in `templates/maps.js`).
    """
    if view.projected or not view.fixed:
        return {}
    points = cases.parameters([view.names[column] for column in view.fixed])
    # sorted slices, and each case's number among them
    slices, slice_of = np.unique(points, axis=0, return_inverse=True)
    incidents = np.bincount(slice_of.ravel(), cases.incident, len(slices))
    return dict(zip(view.fixed, slices[np.argmax(incidents)].tolist(), strict=True))


def tile_counts(
    axes: Sequence[Parameter], cases: CaseTable, tiles: int
) -> tuple[FloatArray, FloatArray]:
    """Number of cases in each tile of a plane, and the share of them that collided, both
    (tiles * tiles,), x fastest.

    axes: the parameters of x and y.
    tiles: number of tiles along each axis.
    """
    x, y = cases.parameters([item.name for item in axes]).T
    across, up = ((item.low, item.high) for item in axes)
    number, hits = (
        np.histogram2d(y, x, tiles, (up, across), weights=weights)[0].ravel()
        for weights in (None, cases.collided)
    )
    return number, hits / np.maximum(number, 1.0)


def cells_of(
    logical: LogicalScenario, points: FloatArray, cells: int
) -> tuple[IntArray, FloatArray]:
    """Equal cells of the space, for one JUnit test a cell: index of each point's cell along each
    parameter, (n, k), and the edges of the cells, (cells + 1, k).

    points: (n, k), in the parameters' units.
    cells: number of cells along each parameter.
    """
    # not of the box that the points fill: another sample must have the same cells
    low, spans = logical.low, logical.high - logical.low
    places = np.clip((cells * (points - low) / spans).astype(np.intp), 0, cells - 1)
    return places, low + spans / cells * np.arange(cells + 1)[:, None]


def slice_points(
    logical: LogicalScenario, view: View, panel: int, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Points of a panel at which a map shows the zones, (len(y), len(x), k), in the parameters'
    units.

    panel: its index in `view.panels`.
    x, y: positions on the axes, as shares of the parameters' ranges, 0..1.
    """
    unit = np.zeros((len(y), len(x), len(logical.parameters)))
    unit[..., view.x] = x
    if view.y is not None:
        unit[..., view.y] = y[:, None]
    points = logical.from_unit(unit)
    for column, value in view.fixed.items():
        points[..., column] = value
    if view.panel is not None:
        points[..., view.panel] = view.panels[panel]
    return np.clip(points, logical.low, logical.high)
