"""Figures of one scenario of a scored run: its zones, the drives in them, their fields.

`drawn.draw` calls each public function under its name, for `sumo-eval plot FIGURE`. A height given
to `on_paper` is a share of a panel's width, one given to `new_figure` of the figure's width.

Users: `extras/figures/drawn.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from sumo_eval.case_table import CaseTable
from sumo_eval.evaluation import zone_partitions
from sumo_eval.extras.figures.chosen import DrivenPoint, FigureRequest, driven_point
from sumo_eval.extras.figures.style import label, look_of, new_figure, on_paper, styled
from sumo_eval.extras.panels import (
    FAINT,
    HAZARDOUS,
    INK,
    MUTED,
    SAFE,
    Marks,
    Panel,
    add_title_and_legend,
    edge_of,
)
from sumo_eval.method.point_criticality import exact_target
from sumo_eval.method.trajectory_field import trajectory_fields
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.report.page_data import gathered_words
from sumo_eval.report.words import LOOKS
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.scoring.map_view import View, choose_view, slice_points, telling_slice
from sumo_eval.scoring.preventability import verdicts
from sumo_eval.settings import FieldSettings
from sumo_eval.trajectory import FloatArray, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CELLS = 140  # of a map along each axis
MOST_COLUMNS = 4  # panels in a row
LEARNT = "#d55e00"  # colour of the learnt boundary
FIELD_X, FIELD_Y = 240, 60  # points of a field along and across the road
BRIGHTEST = 0.998  # share of a field's points above which all have one colour

_ZONE_LEGEND = (
    Marks("safe zone", [], [], SAFE, marker="s"),
    Marks("hazardous zone", [], [], HAZARDOUS, marker="s"),
    Marks("cannot be", [], [], "white", marker="s"),  # a constraint forbids these points
    Marks("boundary, exact", [], [], INK, "-"),
    Marks("boundary, learnt", [], [], LEARNT, "--"),
)
"""Marks without points: entries of the legend for what a map shows as areas and lines."""

_Map = tuple[Any, Any, Any]
"""Map as `Panel.chance`: x (m,), y (n,) and values (n, m)."""


def zone_map(request: FigureRequest) -> Figure:
    """Zones of a space with the outcome of every case, as in the paper's Figs. 8 and 9.

    The boundary of the zones is drawn twice: exact (Eqs. 5-7) and as the Gaussian process learnt it
    (Eq. 8).

    A space of three parameters has a map for each value of the first one. Of a larger space the map
    is a slice. The ADS is that of the case if one is given, else the first with a score there.
    """
    evaluation, scenario = request.evaluation, request.one_scenario
    scored = (score.ads for score in request.scores if score.scenario == scenario)
    ads = request.row.ads if request.case is not None else next(scored, request.names[0])
    zones, cases = zone_partitions(evaluation)[scenario], evaluation.cases_of(ads, scenario)
    axes = evaluation.settings.report.axes.get(scenario)
    view, note = _slice(choose_view(zones.logical, cases, axes), zones, cases)
    outcomes = verdicts(evaluation, evaluation.score(ads, scenario))
    panels, learnt_maps = zip(*_map_panels(zones, view, cases, outcomes), strict=True)

    columns = min(len(panels), MOST_COLUMNS if request.width == "page" else 2)
    title = f"{ads} in {scenario}" + (f"\n{note}" if note else "")
    figure = on_paper(panels, request.width, 0.9, columns, title)
    # the figure has more axes than maps where its last row is not full
    for ax, learnt_map in zip(figure.axes, learnt_maps, strict=False):
        edge_of(ax, learnt_map, 0.0, LEARNT, "--")
        if view.y is None:
            ax.set_yticks([])
    return figure


def _slice(view: View, zones: ZonePartition, cases: CaseTable) -> tuple[View, str]:
    """The view at one slice, and a note on this slice; of several slices, the one with most
    incidents.
    """
    chosen = telling_slice(view, cases)  # parameter's column -> its value; empty: only one slice
    view = view._replace(fixed=chosen or view.fixed)
    items = ((zones.logical.parameters[column], value) for column, value in view.fixed.items())
    where = ", ".join(f"{item.name} = {value:g}{item.unit_suffix}" for item, value in items)
    if not where:  # the map shows all parameters
        return view, gathered_words(view)
    if chosen:
        shown = sum(view.shows(case) for case in cases)
        return view, f"The slice at {where}, with most incidents: {shown} of {len(cases)} cases."
    return view, (
        f"The map is the slice at {where}: the most common values, else the middle ones. Nearly "
        "every case lies off it, so all cases are projected onto it."
    )


def _map_panels(
    zones: ZonePartition, view: View, cases: CaseTable, outcomes: NDArray[np.str_]
) -> Iterator[tuple[Panel, _Map]]:
    """The panels of the view with zones and cases, each with a map of the learnt criticality.

    outcomes: verdict on each case, a key of `LOOKS`, (n,).
    """
    parameters = zones.logical.parameters
    across = parameters[view.x]
    # a space of one parameter has no second axis
    up = "" if view.y is None else label(parameters[view.y].title)
    for number, dots in enumerate(_verdict_marks(view, cases, outcomes)):
        exact, learnt = _zones(zones, view, number)
        title = ""
        if view.panel is not None:
            item = parameters[view.panel]
            title = f"{label(item.name)} {view.panels[number]:g}{item.unit_suffix}"
        range_ = across.low, across.high
        marks = [*_ZONE_LEGEND, *dots]
        yield Panel(marks, label(across.title), up, title, chance=exact, range_=range_), learnt


def _verdict_marks(
    view: View, cases: CaseTable, outcomes: NDArray[np.str_]
) -> Iterator[list[Marks]]:
    """Marks of the cases in each panel, by verdict.

    Every panel has marks of every verdict, so that the legend has the order of `LOOKS`.
    """
    points = cases.parameters(view.names)  # (n, parameters)
    x, y = points[:, view.x], points[:, view.y] if view.y is not None else np.zeros(len(points))
    shown = np.array([view.shows(case) for case in cases], np.bool_)
    panel_of = np.array([view.panel_of(point) for point in points])
    present = [verdict for verdict in LOOKS if verdict in outcomes[shown]]
    for number in range(len(view.panels)):
        marks = []
        for verdict in present:
            here, look = shown & (panel_of == number) & (outcomes == verdict), LOOKS[verdict]
            # a cross: with an incident, or not evaluated
            marker = {"avoided": "o", "better": "P"}.get(verdict, "X")
            marks.append(Marks(look.words, x[here], y[here], look.colour, marker=marker))
        yield marks


def _zones(zones: ZonePartition, view: View, number: int) -> tuple[_Map, _Map]:
    """Maps of the criticality y at the corners of cells, nan where no point is possible.

    The first map has 0.5 - y of the exact y (Eqs. 5-7): a hazardous point has y of at most 0, and
    `Panel.chance` shows values above 0.5 as hazardous. The second has the learnt y (Eq. 8).

    number: of the panel.
    """
    logical = zones.logical
    shares = np.linspace(0.0, 1.0, CELLS + 1)  # of the parameters' ranges
    # the map of one parameter is a strip from y = -1 to 1, the same at both edges
    y_shares = np.array([0.0, 1.0]) if view.y is None else shares
    points = slice_points(logical, view, number, shares, y_shares)  # (n, m, parameters)
    x = points[0, :, view.x]
    y = np.array([-1.0, 1.0]) if view.y is None else points[:, 0, view.y]
    possible = logical.feasible(points)
    rows = points.reshape(-1, points.shape[-1])
    exact = exact_target(logical, rows, zones.settings).reshape(possible.shape)
    # The possible points end in a staircase of cells. A learnt boundary along this staircase would
    # show as a dash at each stair, so it is drawn only two cells or more away from the staircase.
    inside = binary_erosion(possible, iterations=2, border_value=1)
    learnt = np.where(inside, zones.predicted(points), np.nan)
    return (x, y, np.where(possible, 0.5 - exact, np.nan)), (x, y, learnt)


def boundary(request: FigureRequest) -> Figure:
    """Cumulative share of each ADS's collisions over the exact criticality y (Eqs. 5-7).

    y of a concrete scenario goes from -1, most hazardous, through 0, the boundary of the zones, to
    1, safest.
    """
    scenario, names, cases = request.one_scenario, request.names, request.evaluated
    zones = zone_partitions(request.evaluation)[scenario]
    marks = [Marks("", [0.0, 0.0], [0.0, 1.0], INK, "-")]  # the boundary
    for ads in names:
        own = cases[cases.ads == ads]
        colour, _, line = look_of(ads, names)
        words = f"{ads}: {own.collided.sum()} of {len(own)} collide"
        marks.append(Marks(words, *_collision_stairs(own, zones), colour, line))
    panel = Panel(
        marks, "criticality y of the concrete scenario (0: the boundary, above: safe)",
        "share of its collisions so far", range_=(-1.0, 1.0)
    )  # fmt: skip
    figure = on_paper([panel], request.width, 0.52, words=scenario)
    for begin, colour in ((-1.0, HAZARDOUS), (0.0, SAFE)):
        figure.axes[0].axvspan(begin, begin + 1.0, color=colour, linewidth=0)
    return figure


def _collision_stairs(cases: CaseTable, zones: ZonePartition) -> tuple[FloatArray, FloatArray]:
    """Corners of the staircase: criticality y, and share s of the collisions up to this y.

    They are (-1, 0), (y0, 0), (y0, s0), (y1, s0), (y1, s1), ...
    """
    y = exact_target(zones.logical, cases.parameters(zones.logical.names), zones.settings)
    order = np.argsort(y)
    hit = cases.collided[order]
    share = np.cumsum(hit) / max(hit.sum(), 1.0)
    return np.repeat([-1.0, *y[order]], 2)[1:], np.repeat([0.0, *share], 2)[:-1]


def field(request: FigureRequest) -> Figure:
    """Field of a driven trajectory over the road (Eqs. 9-10), as in the paper's Fig. 6.

    Below it that of a human driver at the same point, where the run has one.
    """
    ads = request.row.ads if request.ads is None else request.names[0]
    scene = driven_point(request, [ads])
    settings = request.evaluation.settings.method.anthropomorphic.field
    first_driver = dict(list(scene.people.items())[:1])
    drives = {ads: scene.runs[ads], **first_driver}
    x, y, values = _fields(list(drives.values()), settings)
    east, north = map_places(scene.line, x, y[:, None])[:2]
    # next to a standing vehicle the field has no bound
    lowest, highest = np.quantile(values, [0.0, BRIGHTEST])

    with styled():
        figure, axes = new_figure(request.width, 0.16 + 0.3 * len(drives), len(drives))
        for ax, (name, drive), strength in zip(axes, drives.items(), values, strict=True):
            image = ax.pcolormesh(
                east, north, strength, cmap="cividis", vmin=lowest, vmax=highest, rasterized=True,
                shading="gouraud"  # values are at nodes: on a curve the cells are uneven
            )  # fmt: skip
            ax.plot(*map_places(scene.line, drive.x, drive.y)[:2], color="white", linewidth=0.8)
            ax.set(
                title=name, ylabel=label("y", "m"), xlim=(east.min(), east.max()),
                ylim=(north.min(), north.max()),
                aspect="equal" if scene.line else "auto"  # a curve keeps its shape
            )  # fmt: skip
        axes[-1].set_xlabel(label("x", "m"))
        figure.colorbar(image, ax=axes, label="field strength S", extend="max")
        add_title_and_legend(figure, f"{scene.cases[ads]}\n{scene.words}")
    return figure


def _fields(drives: Sequence[Trajectory], settings: FieldSettings) -> tuple[FloatArray, ...]:
    """Field of each drive over the stretch of road of the first drive.

    Returns x along the road, m, (`FIELD_X`,); y across it, m, (`FIELD_Y`,); and the fields,
    (drives, `FIELD_Y`, `FIELD_X`).
    """
    ego = drives[0]
    reach = 1.5 * max(np.abs(drive.y).max() for drive in drives) + 3.0  # m to each side
    x = np.linspace(ego.x[0], max(ego.x[-1], ego.x[0] + reach), FIELD_X)  # an ego may stand
    y = np.linspace(ego.y[0] - reach, ego.y[0] + reach, FIELD_Y)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return x, y, trajectory_fields(points, drives, settings).reshape(-1, len(y), len(x))


def _drives(scene: DrivenPoint, names: Sequence[str]) -> Iterator[tuple[str, Trajectory, str, Any]]:
    """Entry of the legend, trajectory, colour and line of every drive. The ADSs are last, so that
    they are drawn on top.

    names: of all ADSs in the figure.
    """
    for drive in scene.people.values():
        yield "human drivers", drive, FAINT, "-"
    for drive in scene.others.values():
        yield "other vehicles", drive, MUTED, ":"
    for ads, drive in scene.runs.items():
        colour, _, line = look_of(ads, names)
        yield ads, drive, colour, line


def trajectories(request: FigureRequest) -> Figure:
    """Paths over the road in one concrete scenario: every ADS, human drivers, other vehicles."""
    scene = driven_point(request, request.names)
    marks = [
        Marks(name, *map_places(scene.line, drive.x, drive.y)[:2], colour, line)
        for name, drive, colour, line in _drives(scene, request.names)
    ]
    figure = on_paper(
        [Panel(marks, label("x", "m"), label("y", "m"))], request.width, 0.5, words=scene.title
    )
    figure.axes[0].margins(y=0.25)
    return figure


def time_history(request: FigureRequest) -> Figure:
    """Speed, acceleration and lateral position over time in one concrete scenario: every ADS and
    the human drivers.
    """
    scene = replace(driven_point(request, request.names), others={})  # no other vehicles
    panels = [
        Panel([Marks(name, drive.time, getattr(drive, channel), colour, line)
               for name, drive, colour, line in _drives(scene, request.names)], y=words)
        for channel, words in (("speed", "speed (m/s)"), ("acceleration", "acceleration (m/s²)"),
                               ("y", "lateral place (m)"))
    ]  # fmt: skip
    # the panels share the x axis, and the lowest one labels it
    panels[-1] = replace(panels[-1], x=label("time", "s"))
    return on_paper(
        panels, request.width, 0.32 if request.width == "column" else 0.18, words=scene.title
    )
