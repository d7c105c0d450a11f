"""Figures of a scored run: zones, fields, drives, collisions, intervals, where the points went."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import binary_erosion

from sumo_eval.cases import CaseTable
from sumo_eval.evaluation import zone_partitions
from sumo_eval.extras.figures.chosen import Asked, DrivenPoint, driven_point
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
from sumo_eval.results import ScenarioResult
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.scoring.findings import Findings
from sumo_eval.scoring.gate_settings import INDEXES
from sumo_eval.scoring.ledger import Ledger, ledger, ledger_plus
from sumo_eval.scoring.map_view import View, choose_view, slice_points, telling_slice
from sumo_eval.scoring.preventability import verdicts
from sumo_eval.trajectory import FloatArray, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CELLS = 140  # on each axis of a map
_STAIRS = 2  # cells beside what cannot be in which no learnt boundary is drawn
MOST_COLUMNS = 4
LEARNT = "#d55e00"  # colour of the learnt boundary


def zone_map(asked: Asked) -> Figure:
    """The zones of a space, the paper's Fig. 8 or 9, with the learnt and the exact boundary, and
    every case's outcome.

    One map for each value of a third parameter. `case` selects the ADS and scenario, where it is
    given.
    """
    evaluation, name = asked.evaluation, asked.one_place
    drove = (it.ads for it in asked.scores if it.scenario == name)
    who = next(drove, asked.names[0]) if asked.case is None else asked.row.ads
    zones = zone_partitions(evaluation)[name]
    cases = evaluation.cases_of(who, name)
    view, about = _slice(
        choose_view(zones.logical, cases, evaluation.settings.report.axes.get(name)), zones, cases
    )
    judged = dict(zip(cases.case, verdicts(evaluation, evaluation.score(who, name)), strict=True))
    shown = [one for one in cases if view.shows(one)]
    present = [verdict for verdict in LOOKS if verdict in {judged[one.case] for one in shown}]
    learnt = []
    panels = []
    for number in range(len(view.panels)):
        chance, predicted = _zones(zones, view, number)
        learnt.append((*chance[:2], predicted))
        marks = [
            Marks("safe zone", [], [], SAFE, marker="s"),
            Marks("hazardous zone", [], [], HAZARDOUS, marker="s"),
            Marks("cannot be", [], [], "white", marker="s"),
            Marks("boundary, exact", [], [], INK, "-"),
            Marks("boundary, learnt", [], [], LEARNT, "--"),
        ]
        here = [one for one in shown if view.panel_of(zones.logical.row(one.values)) == number]
        for verdict in present:
            dots = [one.values for one in here if judged[one.case] == verdict]
            x, y = ([0.0 if column is None else values[view.names[column]] for values in dots]
                    for column in (view.x, view.y))  # fmt: skip
            marker = {"avoided": "o", "better": "P"}.get(verdict, "X")
            marks.append(Marks(LOOKS[verdict].words, x, y, LOOKS[verdict].colour, marker=marker))
        axes = [
            zones.logical.parameters[column] for column in (view.x, view.y) if column is not None
        ]
        words = [label(item.name, item.unit_suffix.strip()) for item in axes]
        panels.append(Panel(marks, words[0], "".join(words[1:]), _value(zones, view, number),
            chance=chance,
                            range_=(axes[0].low, axes[0].high)))  # fmt: skip
    columns = min(len(panels), MOST_COLUMNS if asked.width == "page" else 2)
    note = "\n".join(filter(None, (f"{who} in {name.replace('_', ' ')}", about)))
    figure = on_paper(panels, asked.width, 0.9, columns, note)
    for ax, (x, y, predicted) in zip(figure.axes, learnt, strict=False):
        edge_of(ax, (x, y, predicted), 0.0, LEARNT, "--")
        if view.y is None:
            ax.set_yticks([])
    return figure


def _value(zones: ZonePartition, view: View, number: int) -> str:
    """The value of the third parameter on a map."""
    if view.panel is None:
        return ""
    parameter = zones.logical.parameters[view.panel]
    return f"{label(parameter.name, '')} {view.panels[number]:g}{parameter.unit_suffix}"


def _slice(view: View, zones: ZonePartition, cases: CaseTable) -> tuple[View, str]:
    """A view at its slice with most collisions, where it has a choice, and a note on it."""
    telling = telling_slice(view, cases)
    there = replace(view, fixed=telling or view.fixed)
    items = ((zones.logical.parameters[column], value) for column, value in there.fixed.items())
    where = ", ".join(f"{item.name} = {value:g}{item.unit_suffix}" for item, value in items)
    if not where:
        return there, gathered_words(view)
    if telling:
        shown = sum(there.shows(one) for one in cases)
        return there, f"The slice at {where}, with most collisions: {shown} of {len(cases)} cases."
    return there, (
        f"The map is the slice at {where}, the most common values, or the middle ones where none "
        "is. Nearly every case lies off it, so all cases are drawn where they would fall on it."
    )


def _zones(
    zones: ZonePartition, view: View, number: int
) -> tuple[tuple[Any, Any, Any], FloatArray]:
    """A map of the exact criticality y as `Panel.chance`, 0.5 - y, and y as it was learnt; nan
    where nothing can be.
    """
    logical = zones.logical
    ticks = np.linspace(0.0, 1.0, CELLS + 1)
    points = slice_points(
        logical, view, number, ticks, np.array([0.0, 1.0]) if view.y is None else ticks
    )
    rows = points.reshape(-1, points.shape[-1])
    shape = points.shape[:2]
    y = np.array([-1.0, 1.0]) if view.y is None else points[:, 0, view.y]
    possible = logical.feasible(rows).reshape(shape)
    exact = np.where(possible, exact_target(logical, rows, zones.settings).reshape(shape), np.nan)
    # else each stair of the edge has a mark
    within = binary_erosion(possible, iterations=_STAIRS, border_value=1)
    learnt = np.where(within, np.asarray(zones.predicted(rows)).reshape(shape), np.nan)
    return (points[0, :, view.x], y, 0.5 - exact), learnt


def field(asked: Asked) -> Figure:
    """The field of a driven trajectory over the road, Eqs. 9-10, the paper's Fig. 6; below it a
    human driver's.
    """
    row = asked.row
    who = row.ads if asked.ads is None else asked.names[0]
    scene = driven_point(asked, [who])
    settings = asked.evaluation.settings.method.anthropomorphic.field
    drives = {who: scene.runs[who], **dict(list(scene.people.items())[:1])}
    ego = scene.runs[who]
    reach = 1.5 * max(float(np.abs(drive.y).max()) for drive in drives.values()) + 3.0
    x = np.linspace(float(ego.x[0]), float(ego.x[-1]), 240)
    y = np.linspace(float(ego.y[0]) - reach, float(ego.y[0]) + reach, 60)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    values = trajectory_fields(points, list(drives.values()), settings)
    east, north = map_places(scene.line, x, y[:, None])[:2]
    lowest = float(values.min())
    # next to a vehicle that stands the field has no bound worth a colour
    tallest = float(np.quantile(values, 0.998))
    with styled():
        figure, axes = new_figure(asked.width, 0.16 + 0.3 * len(drives), len(drives))
        for ax, (name, drive), strength in zip(axes, drives.items(), values, strict=True):
            image = ax.pcolormesh(
                east,
                north,
                strength.reshape(len(y), len(x)),
                cmap="cividis",
                vmin=lowest,
                vmax=tallest,
                rasterized=True,
            )
            ax.plot(*map_places(scene.line, drive.x, drive.y)[:2], color="white", linewidth=0.8)
            ax.set_title(name.replace("_", " "))
            ax.set_ylabel(label("y", "m"))
            ax.set_xlim(east.min(), east.max())
            ax.set_ylim(north.min(), north.max())
            if scene.line:
                ax.set_aspect("equal")  # a bend keeps its radius
        axes[-1].set_xlabel(label("x", "m"))
        figure.colorbar(image, ax=axes, label="field strength S", extend="max")
        add_title_and_legend(figure, f"{row.case}\n{scene.words}")
    return figure


def _drives(scene: DrivenPoint, names: Sequence[str]) -> Iterator[tuple[str, Trajectory, str, Any]]:
    """Words of the legend, drive, colour and line of every drive; the ADSs last."""
    for drive in scene.people.values():
        yield "human drivers", drive, FAINT, "-"
    for drive in scene.others.values():
        yield "other vehicles", drive, MUTED, ":"
    for who, drive in scene.runs.items():
        colour, _, line = look_of(who, names)
        yield who, drive, colour, line


def trajectories(asked: Asked) -> Figure:
    """Paths over the road in one concrete scenario: every ADS, the human drivers, the
    other vehicles.
    """
    scene = driven_point(asked, asked.names)
    marks = [
        Marks(who, *map_places(scene.line, drive.x, drive.y)[:2], colour, line)
        for who, drive, colour, line in _drives(scene, asked.names)
    ]
    figure = on_paper(
        [Panel(marks, label("x", "m"), label("y", "m"))], asked.width, 0.5, words=scene.title
    )
    figure.axes[0].margins(y=0.25)
    return figure


def time_history(asked: Asked) -> Figure:
    """Speed, acceleration and lateral place over time in one concrete scenario: every ADS and the
    human drivers.
    """
    scene = replace(driven_point(asked, asked.names), others={})
    panels = [
        Panel([Marks(who, drive.time, getattr(drive, channel), colour, line)
               for who, drive, colour, line in _drives(scene, asked.names)], y=words)
        for channel, words in (("speed", "speed (m/s)"), ("acceleration", "acceleration (m/s²)"),
                               ("y", "lateral place (m)"))
    ]  # fmt: skip
    panels[-1] = replace(panels[-1], x=label("time", "s"))
    return on_paper(
        panels, asked.width, 0.32 if asked.width == "column" else 0.18, words=scene.title
    )


def collisions(asked: Asked) -> Figure:
    """Severity U of every collision, Eq. 15, beside that of the ideal vehicle in the same concrete
    scenario: on the line no better could have been done. One panel a scenario.
    """
    names, evaluation = asked.names, asked.evaluation
    panels = []
    for place in [asked.place] if asked.place else [zone.scenario for zone in evaluation.zones]:
        hits = {
            who: np.array([
                (row.ideal_severity, row.severity) for row in evaluation.cases_of(who, place)
                if row.collided and None not in (row.severity, row.ideal_severity)
            ]).reshape(-1, 2)
            for who in names
        }  # fmt: skip
        most = max((float(found.max()) for found in hits.values() if len(found)), default=0.0)
        marks = [Marks("", [0.0, most], [0.0, most], MUTED, "-")] if most else []
        for who, found in hits.items():
            colour, marker, _ = look_of(who, names)
            marks.append(Marks(who, found[:, 0], found[:, 1], colour, marker=marker))
        title = place.replace("_", " ") + ("" if most else ": no collision")
        panels.append(Panel(marks, "U of the ideal vehicle", "U of the ADS", title))
    return on_paper(
        panels, asked.width, 0.85, min(len(panels), 2 if asked.width == "column" else 3)
    )


def intervals(asked: Asked) -> Figure:
    """Every score with its 95 % interval: one panel a score, one line for each ADS in each
    scenario.
    """
    names, scores = asked.names, asked.scores
    panels = []
    for symbol, field_ in INDEXES.items():
        marks = []
        for place, one in enumerate(scores):
            value, interval = getattr(one, field_), getattr(one, f"{field_}_interval")
            colour, marker, _ = look_of(one.ads, names)
            if interval is not None:
                marks.append(Marks("", interval, [place, place], colour, "-"))
            if value is not None:
                marks.append(Marks("", [value], [place], colour, marker=marker))
        known = all(getattr(one, field_) is not None for one in scores)
        panels.append(Panel(marks, symbol if known else f"{symbol} (no mark: not computed)"))
    columns = 2 if asked.width == "column" else 4
    figure = on_paper(
        panels,
        asked.width,
        max(0.5, 0.09 * len(scores) + 0.3) * (1.3 if columns == 2 else 2.0),
        columns,
    )
    for place, ax in enumerate(figure.axes):
        _name_the_scores(ax, scores)
        ax.tick_params(labelleft=place % columns == 0)
        ax.grid(axis="x", color=FAINT, linewidth=0.4)
    return figure


def _name_the_scores(ax: Axes, scores: Sequence[ScenarioResult]) -> None:
    """A line of the y axis for each."""
    ax.set_ylim(len(scores) - 0.5, -0.5)
    ax.set_yticks(range(len(scores)))
    ax.tick_params(axis="y", length=0)
    ax.set_yticklabels(
        [f"{one.ads}, {one.scenario.replace('_', ' ')}" for one in scores], fontsize=5.5
    )


def points(asked: Asked) -> Figure:
    """Figure of the points of S+ and S: what each ADS kept of its hundred and what each term cost,
    scenario by scenario.
    """
    scores = asked.scores
    with styled():
        tall = 0.16 * len(scores) + 0.45 if asked.width == "column" else 0.07 * len(scores) + 0.2
        figure, axes = new_figure(asked.width, tall, 1, 2)
        drawn: dict[str, str] = {}
        for ax, make in zip(axes, (ledger_plus, ledger), strict=True):
            for place, one in enumerate(scores):
                _ledger_bar(ax, make(Findings.of(asked.evaluation, one)), place, drawn)
            ax.set_title("S+" if make is ledger_plus else "S")
            _name_the_scores(ax, scores)
            ax.set_xlabel("points")
            ax.set_xlim(0.0, 100.0)
        axes[1].tick_params(labelleft=False)
        for words, colour in drawn.items():
            axes[0].barh([0], [0.0], color=colour, label=words)
        figure.legend(
            loc="outside lower center", ncols=2 if asked.width == "column" else 4, fontsize=6.0
        )
    return figure


LOST = {"T": "#56b4e9", "A": "#d55e00", "C": "#d55e00", "H": "#e69f00", "D": "#e69f00"}
LOST_BY = {"T": "lost by not driving (T)", **dict.fromkeys("AC", "lost by harm (A, C)")}
KEPT = "#0072b2"


def _ledger_bar(ax: Axes, found: Ledger, place: int, drawn: dict[str, str]) -> None:
    """Kept points, then the losses of each term to their right."""
    kept = max(found.total, 0.0)
    ax.barh([place], [kept], color=KEPT, height=0.6)
    drawn["kept"] = KEPT
    wide = kept > 12.0
    ax.annotate(f"{found.total:.1f}", (kept, place), xytext=(-2 if wide else 2, 0),
        textcoords="offset points",
                ha="right" if wide else "left", va="center", fontsize=5.5,
                color="white")  # fmt: skip
    at = kept
    for term in dict.fromkeys(line.term for line in found.lines):
        lost = -math.fsum(
            line.points for line in found.lines if line.term == term and line.points < 0.0
        )
        if lost > 0.0:
            ax.barh([place], [lost], left=[at], color=LOST[term], height=0.6)
            drawn[LOST_BY.get(term, "lost by driving otherwise (H, D)")] = LOST[term]
            at += lost


def boundary(asked: Asked) -> Figure:
    """How the share of collisions grows with nearness to the exact boundary of the zones: every
    ADS, by the signed criticality of the concrete scenario, on the scale in which the zones are
    learnt.
    """
    name, names, rows = asked.one_place, asked.names, asked.evaluated
    zones = zone_partitions(asked.evaluation)[name]
    marks = [Marks("", [0.0, 0.0], [0.0, 1.0], INK, "-")]
    for who in names:
        own = [row for row in rows if row.ads == who]
        points = np.array([zones.logical.row(row.values) for row in own])
        points = points.reshape(-1, len(zones.logical.names))
        places = exact_target(zones.logical, points, zones.settings)
        order = np.argsort(places)
        hit = np.array([row.collided for row in own], dtype=np.float64)[order]
        share = np.cumsum(hit) / max(hit.sum(), 1.0)
        x, y = np.repeat([-1.0, *places[order]], 2)[1:], np.repeat([0.0, *share], 2)[:-1]
        colour, _, line = look_of(who, names)
        marks.append(Marks(f"{who}: {int(hit.sum())} of {len(own)} collide", x, y, colour, line))
    panel = Panel(
        marks, "criticality y of the concrete scenario (0: the boundary, above: safe)",
        "share of its collisions so far", range_=(-1.0, 1.0),
    )  # fmt: skip
    figure = on_paper([panel], asked.width, 0.52, words=name.replace("_", " "))
    for begin, colour in ((-1.0, HAZARDOUS), (0.0, SAFE)):
        figure.axes[0].axvspan(begin, begin + 1.0, color=colour, linewidth=0)
    return figure
