"""Parameters of a space that a map shows, and where it cuts through all further ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sumo_eval.cases import CaseResult, CaseTable, IntArray
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.trajectory import FloatArray

# more values than this of the first parameter are gathered in GATHERED_PANELS panels
MOST_PANELS = 12
GATHERED_PANELS = 6
# share of the cases; a slice with fewer shows all cases projected onto it
SLICE_WORTH_SHOWING = 0.1


@dataclass(frozen=True, slots=True)
class View:
    """View of a space in a map: columns of x and y (None: a strip), panels along a third, the
    others held fixed.

    panels: values of the `panel` parameter, one panel each; a single None where there is no such
        parameter.
    fixed: column -> value of the slice.
    projected: cases off the slice are drawn on it too.
    gathered: each case lies in the panel nearest to it.
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
        """The panel nearest to a point of the space."""
        if self.panel is None:
            return 0
        return int(np.argmin(np.abs(row[self.panel] - np.array(self.panels, dtype=np.float64))))

    def shows(self, case: CaseResult) -> bool:
        """Whether a case is drawn."""
        return self.projected or all(
            case.values[self.names[column]] == value for column, value in self.fixed.items()
        )


def choose_view(
    logical: LogicalScenario, cases: CaseTable, axes: tuple[str, str] | None = None
) -> View:
    """One map for two parameters, a panel for each value of the first for three, a slice through
    more.

    axes: the parameters of x and y, where the settings name them; a map of more than two
        parameters then is a slice through all others.
    """
    columns = range(len(logical.parameters))
    if len(columns) < 3:
        own = [*map(logical.column, axes or logical.names)]
        y = own[1] if own[1:] else None
        return View(logical.names, own[0], y, None, (None,), {}, True)
    if len(columns) == 3 and axes is None:
        distinct = np.unique(cases.parameters(logical.names[:1])).tolist()
        if gathered := len(distinct) > MOST_PANELS:
            first = logical.parameters[0]
            distinct = np.linspace(first.low, first.high, GATHERED_PANELS).tolist()
        return View(logical.names, 1, 2, 0, tuple(distinct), {}, True, gathered)
    points = cases.parameters(logical.names)
    number, common = zip(*(_variety(points[:, column]) for column in columns), strict=True)
    by_variety = sorted(columns, key=lambda column: -number[column])
    x, y = sorted(by_variety[:2]) if axes is None else map(logical.column, axes)
    fixed = {column: common[column] for column in columns if column not in (x, y)}
    on_slice = int(np.count_nonzero(np.all(points[:, list(fixed)] == list(fixed.values()), axis=1)))
    projected = on_slice < SLICE_WORTH_SHOWING * len(cases)
    return View(logical.names, x, y, None, (None,), fixed, projected)


def _variety(column: FloatArray) -> tuple[int, float]:
    """Number of values of a parameter, and the most common one, of equals the least; where each
    occurs once, the middle one.
    """
    values, often = np.unique(column, return_counts=True)
    return len(values), float(values[len(values) // 2 if often.max() == 1 else np.argmax(often)])


def telling_slice(view: View, cases: CaseTable) -> dict[int, float]:
    """The slice that a map with a choice of slices opens at, column -> value: the one with most
    collisions.

    Of equals the first in order of the values. Empty where a view has no slices.
    """
    if view.projected or not view.fixed:
        return {}
    points = cases.parameters([view.names[column] for column in view.fixed])
    slices, which = np.unique(points, axis=0, return_inverse=True)  # in the order of their values
    collisions = np.bincount(which.ravel(), cases.collided, len(slices))
    return dict(zip(view.fixed, slices[int(np.argmax(collisions))].tolist(), strict=True))


def tile_counts(
    axes: Sequence[Parameter], cases: CaseTable, tiles: int
) -> tuple[IntArray, FloatArray]:
    """Number of cases in each tile of the plane of two parameters, x and y, and the share of them
    that collided, (tiles * tiles,), y slowest.

    tiles: along each axis.
    """
    points = cases.parameters([item.name for item in axes])
    low, high = (np.array([getattr(item, end) for item in axes]) for end in ("low", "high"))
    shares = (points - low) / (high - low)
    x, y = np.clip((shares * tiles).astype(np.intp), 0, tiles - 1).T
    number = np.bincount(y * tiles + x, minlength=tiles * tiles)
    hits = np.bincount(y * tiles + x, cases.collided, tiles * tiles)
    return number, np.divide(hits, number, out=np.zeros(len(hits)), where=number > 0)


class Cells(NamedTuple):
    """The box of cases in equal cells.

    places: of the cell of each case, (n, k).
    """

    low: FloatArray
    step: FloatArray
    places: IntArray

    def edges(self, place: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Least and largest values of a cell, (k,) each."""
        return self.low + self.step * np.array(place), self.low + self.step * (np.array(place) + 1)


def cells_of(points: FloatArray, cells: int) -> Cells:
    """The cells of points (n, k).

    cells: along each axis.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    spans = np.where(high > low, high - low, 1.0)
    places = np.minimum(cells - 1, (cells * (points - low) / spans).astype(np.intp))
    return Cells(low, (high - low) / cells, places)


def slice_points(
    logical: LogicalScenario, view: View, panel: int, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Points (len(y), len(x), k) of a panel; x and y in the unit box."""
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
