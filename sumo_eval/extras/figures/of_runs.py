"""Figures of a scored run: zones, fields, drives, collisions, intervals, where the points went."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import binary_erosion

from sumo_eval.cases import CaseResult, CaseTable
from sumo_eval.evaluation import zone_partitions
from sumo_eval.extras.figures.chosen import Asked, Scene, scene_of
from sumo_eval.extras.figures.style import (
    FAINT,
    HAZARDOUS,
    INK,
    MUTED,
    SAFE,
    label,
    line_of,
    look_of,
    new_figure,
    styled,
)
from sumo_eval.method.trajectory_field import trajectory_fields
from sumo_eval.method.zone_partition import ZonePartition, exact_target
from sumo_eval.report.ledger import Ledger, ledger, ledger_plus
from sumo_eval.report.page_data import View, choose_view, slice_points, telling_slice
from sumo_eval.report.preventability import LOOKS, Verdict, verdicts
from sumo_eval.results import ScenarioResult
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.trajectory import FloatArray, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CELLS = 140  # on each axis of a map
_STAIRS = 2  # cells beside what cannot be in which no learnt boundary is drawn
MOST_COLUMNS = 4
LONGEST_LINE = 100  # characters of a note above a figure of a page's width
INDEXES = {
    "T": "task_share",
    "A'": "avoidance_grade",
    "A": "avoided_share",
    "H": "human_likeness",
    "C": "c",
    "D": "d",
    "S+": "s_plus",
    "S": "s",
}
"""Scores of the intervals' figure by their symbol; the last two are of 100."""


def zone_map(asked: Asked) -> Figure:
    """The paper's Fig. 8 or 9: the zones of a space, the boundary that was learnt and the exact one, and every case's
    outcome in it; one map for each value of a third parameter. `case` says the ADS and scenario, where it is given.
    """
    evaluation, name = asked.evaluation, asked.one_place
    who = asked.names[0] if asked.case is None else asked.row.ads
    zones = zone_partitions(evaluation)[name]
    cases = evaluation.cases_of(who, name)
    view = _telling(choose_view(zones.logical, cases, evaluation.settings.report.axes.get(name)), zones, cases)
    judged = dict(zip(cases.case, verdicts(evaluation, evaluation.score(who, name)), strict=True))
    panels = range(len(view.panels))
    columns = min(len(panels), MOST_COLUMNS if asked.width == "page" else 2)
    rows = math.ceil(len(panels) / columns)
    with styled():
        figure, axes = new_figure(asked.width, 0.12 + 0.9 * rows / columns, rows, columns)
        for panel, ax in zip(panels, axes, strict=False):
            _zones(ax, zones, view, panel)
            shown = [one for one in cases if view.shows(one)]
            here = [one for one in shown if view.panel_of(zones.logical.row(one.values)) == panel]
            for verdict, look in LOOKS.items():
                dots = [one for one in here if judged[one.case] == verdict]
                x = [one.values[view.names[view.x]] for one in dots]
                y = [0.0 if view.y is None else one.values[view.names[view.y]] for one in dots]
                marker = {"avoided": "o", "better": "P"}.get(verdict, "X")
                ax.scatter(
                    x, y, s=9, marker=marker, c=look.colour, edgecolors=INK, linewidths=0.3, zorder=3, clip_on=False
                )
            if view.panel is not None:
                parameter = zones.logical.parameters[view.panel]
                ax.set_title(f"{label(parameter.name, '')} {view.panels[panel]:g}{parameter.behind}")
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        present = [verdict for verdict in LOOKS if verdict in {judged[one.case] for one in cases if view.shows(one)}]
        _legend_of_map(figure, present)
        note = _in_lines(view.note, figure)
        figure.suptitle("\n".join(filter(None, (f"{who} in {name.replace('_', ' ')}", note))), fontsize="medium")
    return figure


def _telling(view: View, zones: ZonePartition, cases: CaseTable) -> View:
    """A view whose slice, where it is one, is that with most collisions."""
    fixed = telling_slice(view, cases)
    if not fixed:
        return view
    items = [(zones.logical.parameters[column], value) for column, value in fixed.items()]
    there = replace(view, fixed=fixed)
    shown = sum(there.shows(one) for one in cases)
    where = ", ".join(f"{item.name} = {value:g}{item.behind}" for item, value in items)
    return replace(there, note=f"The slice at {where}, with most collisions: {shown} of {len(cases)} cases.")


def _zones(ax: Axes, zones: ZonePartition, view: View, panel: int) -> None:
    logical = zones.logical
    ticks = np.linspace(0.0, 1.0, CELLS + 1)
    points = slice_points(logical, view, panel, ticks, np.array([0.0, 1.0]) if view.y is None else ticks)
    rows = points.reshape(-1, points.shape[-1])
    shape = points.shape[:2]
    x = points[0, :, view.x]
    y = np.array([-1.0, 1.0]) if view.y is None else points[:, 0, view.y]
    possible = logical.feasible(rows).reshape(shape)
    exact = np.where(possible, exact_target(logical, rows, zones.settings).reshape(shape), np.nan)
    within = binary_erosion(possible, iterations=_STAIRS, border_value=1)  # else each stair of the edge has a mark
    learnt = np.where(within, np.asarray(zones.predicted(rows)).reshape(shape), np.nan)
    ax.contourf(x, y, exact, levels=[-np.inf, 0.0, np.inf], colors=[HAZARDOUS, SAFE])
    for values, style, colour in ((exact, "-", INK), (learnt, "--", "#d55e00")):
        known = values[np.isfinite(values)]
        if known.size and known.min() <= 0.0 < known.max():
            ax.contour(x, y, values, levels=[0.0], colors=[colour], linestyles=[style], linewidths=0.9)
    parameter = logical.parameters[view.x]
    ax.set_xlabel(label(parameter.name, parameter.behind.strip()))
    ax.set_xlim(parameter.low, parameter.high)
    if view.y is None:
        ax.set_yticks([])
    else:
        other = logical.parameters[view.y]
        ax.set_ylabel(label(other.name, other.behind.strip()))
        ax.set_ylim(other.low, other.high)


def _columns(figure: Figure) -> int:
    """Columns of a legend that fit below it."""
    return 2 if figure.get_figwidth() < 5.0 else 4


def _in_lines(words: str, figure: Figure) -> str:
    """Words above a figure, broken where it ends."""
    return textwrap.fill(words, LONGEST_LINE * _columns(figure) // 4)


def _legend_of_map(figure: Figure, present: Sequence[Verdict]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Patch | Line2D] = [
        Patch(facecolor=SAFE, edgecolor=MUTED, linewidth=0.4, label="safe zone"),
        Patch(facecolor=HAZARDOUS, edgecolor=MUTED, linewidth=0.4, label="hazardous zone"),
        Patch(facecolor="white", edgecolor=MUTED, linewidth=0.4, label="cannot be"),
        Line2D([], [], color=INK, linewidth=0.9, label="boundary, exact"),
        Line2D([], [], color="#d55e00", linewidth=0.9, linestyle="--", label="boundary, learnt"),
    ]
    for verdict in present:
        look = LOOKS[verdict]
        marker = {"avoided": "o", "better": "P"}.get(verdict, "X")
        handles.append(
            Line2D([], [], linestyle="", marker=marker, markerfacecolor=look.colour, markeredgecolor=INK,
                   markeredgewidth=0.3, label=look.words)
        )  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=_columns(figure))


def field(asked: Asked) -> Figure:
    """The paper's Fig. 6: the field of a driven trajectory over the road, Eqs. 9-10; below it a human driver's."""
    row = asked.row
    who = row.ads if asked.ads is None else asked.names[0]
    scene = scene_of(asked, [who])
    settings = asked.evaluation.settings.method.anthropomorphic.field
    drives = {who: scene.runs[who], **dict(list(scene.people.items())[:1])}
    ego = scene.runs[who]
    reach = 1.5 * max(float(np.abs(drive.y).max()) for drive in drives.values()) + 3.0
    x = np.linspace(float(ego.x[0]), float(ego.x[-1]), 240)
    y = np.linspace(float(ego.y[0]) - reach, float(ego.y[0]) + reach, 60)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    values = trajectory_fields(
        points, list(drives.values()), k1=settings.k1, k2=settings.k2, sample_interval=settings.sample_interval,
        superposition=settings.superposition,
    )  # fmt: skip
    east, north = map_places(scene.line, x, y[:, None])[:2]
    lowest = float(values.min())
    tallest = float(np.quantile(values, 0.998))  # next to a vehicle that stands the field has no bound worth a colour
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
        figure.suptitle(f"{row.case}\n{_in_lines(scene.words, figure)}", fontsize=7.0)
    return figure


def trajectories(asked: Asked) -> Figure:
    """Everybody's way over the road in one concrete scenario: every ADS, the human drivers, the other vehicles."""
    names = asked.names
    scene = scene_of(asked, names)

    def way(drive: Trajectory) -> tuple[FloatArray, FloatArray]:
        return map_places(scene.line, drive.x, drive.y)[:2]

    with styled():
        figure, (ax,) = new_figure(asked.width, 0.55)
        for drive in scene.people.values():
            ax.plot(*way(drive), color=FAINT, linewidth=0.7, zorder=1)
        for other in scene.others.values():
            ax.plot(*way(other), color=MUTED, linewidth=0.8, linestyle=":", zorder=2)
        for who, drive in scene.runs.items():
            ax.plot(*way(drive), color=look_of(who, names)[0], linestyle=line_of(who, names), label=who, zorder=3)
        _name_the_grey(ax, bool(scene.people), bool(scene.others))
        ax.set_xlabel(label("x", "m"))
        ax.set_ylabel(label("y", "m"))
        ax.margins(y=0.25)
        _name_the_scene(figure, scene)
    return figure


def _name_the_scene(figure: Figure, scene: Scene) -> None:
    figure.legend(loc="outside lower center", ncols=_columns(figure))
    figure.suptitle(_in_lines(f"{scene.scenario.replace('_', ' ')}: {scene.words}", figure), fontsize=7.0)


def _name_the_grey(ax: Axes, people: bool, others: bool) -> None:
    if people:
        ax.plot([], [], color=FAINT, linewidth=0.7, label="human drivers")
    if others:
        ax.plot([], [], color=MUTED, linewidth=0.8, linestyle=":", label="other vehicles")


def time_history(asked: Asked) -> Figure:
    """Speed, acceleration and lateral place over time in one concrete scenario: every ADS and the human drivers."""
    names = asked.names
    scene = scene_of(asked, names)
    channels = (("speed", "m/s"), ("acceleration", "m/s²"), ("y", "m"))
    with styled():
        figure, axes = new_figure(asked.width, 1.05 if asked.width == "column" else 0.62, len(channels))
        for ax, (channel, unit) in zip(axes, channels, strict=True):
            for drive in scene.people.values():
                ax.plot(drive.time, getattr(drive, channel), color=FAINT, linewidth=0.7, zorder=1)
            for who, drive in scene.runs.items():
                named = who if channel == "speed" else None
                ax.plot(drive.time, getattr(drive, channel), label=named, zorder=3, color=look_of(who, names)[0],
                        linestyle=line_of(who, names))  # fmt: skip
            ax.set_ylabel(label("lateral place" if channel == "y" else channel, unit))
            if ax is not axes[-1]:
                ax.tick_params(labelbottom=False)
        _name_the_grey(axes[0], bool(scene.people), others=False)
        axes[-1].set_xlabel(label("time", "s"))
        _name_the_scene(figure, scene)
    return figure


def collisions(asked: Asked) -> Figure:
    """Severity U of every collision, Eq. 15, beside that of the ideal vehicle in the same concrete scenario: on the
    line no better could have been done. One panel a scenario.
    """
    names, evaluation = asked.names, asked.evaluation
    hits = [row for row in evaluation.cases if row.ads in names and row.collided and row.severity is not None]
    places = [asked.place] if asked.place else [zone.scenario for zone in evaluation.zones]
    columns = min(len(places), 2 if asked.width == "column" else 3)
    rows = math.ceil(len(places) / columns)
    with styled():
        figure, axes = new_figure(asked.width, 0.18 + 0.85 * rows / columns, rows, columns)
        for ax, place in zip(axes, places, strict=False):
            here = [row for row in hits if row.scenario == place and row.ideal_severity is not None]
            most = max((max(row.severity or 0.0, row.ideal_severity or 0.0) for row in here), default=1.0)
            if here:
                ax.plot([0.0, most], [0.0, most], color=MUTED, linewidth=0.7)
            for who in names:
                own: list[CaseResult] = [row for row in here if row.ads == who]
                colour, marker = look_of(who, names)
                ax.scatter(
                    [row.ideal_severity or 0.0 for row in own], [row.severity or 0.0 for row in own],
                    s=12, c=colour, marker=marker, linewidths=0, alpha=0.8,
                )  # fmt: skip
            if not here:
                ax.text(0.5, 0.5, "no collision", ha="center", va="center", color=MUTED, transform=ax.transAxes)
            ax.set_title(place.replace("_", " "))
            ax.set_xlabel("U of the ideal vehicle")
            ax.set_ylabel("U of the ADS")
        for ax in axes[len(places) :]:
            ax.set_visible(False)
        for who in names:
            colour, marker = look_of(who, names)
            axes[0].scatter([], [], s=12, c=colour, marker=marker, label=who)
        figure.legend(loc="outside lower center", ncols=4)
    return figure


def intervals(asked: Asked) -> Figure:
    """Every score with its 95 % interval: one panel a score, one line for each ADS in each scenario."""
    names, scores = asked.names, asked.scores
    with styled():
        columns = 2 if asked.width == "column" else 4
        rows = math.ceil(len(INDEXES) / columns)
        tall = max(0.5, 0.09 * len(scores) + 0.3) * rows / 2.0 * (4.0 / 3.0 if asked.width == "column" else 1.0)
        figure, axes = new_figure(asked.width, tall, rows, columns)
        for ax, (symbol, name) in zip(axes, INDEXES.items(), strict=True):
            for place, one in enumerate(scores):
                _interval(ax, one, name, place, names)
            ax.set_title(symbol)
            _name_the_scores(ax, scores)
            if (axes.index(ax) % columns) > 0:
                ax.tick_params(labelleft=False)
            ax.grid(axis="x", color=FAINT, linewidth=0.4)
    return figure


def _name_the_scores(ax: Axes, scores: Sequence[ScenarioResult]) -> None:
    """A line of the y axis for each."""
    ax.set_ylim(len(scores) - 0.5, -0.5)
    ax.set_yticks(range(len(scores)))
    ax.tick_params(axis="y", length=0)
    ax.set_yticklabels([f"{one.ads}, {one.scenario.replace('_', ' ')}" for one in scores], fontsize=5.5)


def _interval(ax: Axes, one: ScenarioResult, name: str, place: int, names: list[str]) -> None:
    value, interval = getattr(one, name), getattr(one, f"{name}_interval")
    colour, marker = look_of(one.ads, names)
    if interval is not None:
        ax.plot(interval, [place, place], color=colour, linewidth=1.4, solid_capstyle="butt")
    if value is not None:
        ax.plot([value], [place], marker=marker, color=colour)
    if value is None and interval is None:
        ax.annotate("not computed", (0.02, place), xycoords=("axes fraction", "data"), va="center", fontsize=5.5,
                    color=MUTED)  # fmt: skip


def points(asked: Asked) -> Figure:
    """Where the points of S+ and S went: what each ADS kept of its hundred and what each term cost, scenario by
    scenario.
    """
    scores = asked.scores
    with styled():
        tall = 0.16 * len(scores) + 0.45 if asked.width == "column" else 0.07 * len(scores) + 0.2
        figure, axes = new_figure(asked.width, tall, 1, 2)
        drawn: dict[str, str] = {}
        for ax, make in zip(axes, (ledger_plus, ledger), strict=True):
            for place, one in enumerate(scores):
                _ledger_bar(ax, make(asked.evaluation, one), place, drawn)
            ax.set_title("S+" if make is ledger_plus else "S")
            _name_the_scores(ax, scores)
            ax.set_xlabel("points")
            ax.set_xlim(0.0, 100.0)
        axes[1].tick_params(labelleft=False)
        for words, colour in drawn.items():
            axes[0].barh([0], [0.0], color=colour, label=words)
        figure.legend(loc="outside lower center", ncols=2 if asked.width == "column" else 4, fontsize=6.0)
    return figure


LOST = {"T": "#56b4e9", "A": "#d55e00", "C": "#d55e00", "H": "#e69f00", "D": "#e69f00"}
LOST_BY = {"T": "lost by not driving (T)", **dict.fromkeys("AC", "lost by harm (A, C)")}
KEPT = "#0072b2"


def _ledger_bar(ax: Axes, found: Ledger, place: int, drawn: dict[str, str]) -> None:
    """Kept points, then the losses of each term beside them."""
    kept = max(found.total, 0.0)
    ax.barh([place], [kept], color=KEPT, height=0.6)
    drawn["kept"] = KEPT
    wide = kept > 12.0
    ax.annotate(f"{found.total:.1f}", (kept, place), xytext=(-2 if wide else 2, 0), textcoords="offset points",
                ha="right" if wide else "left", va="center", fontsize=5.5, color="white")  # fmt: skip
    at = kept
    for term in dict.fromkeys(line.term for line in found.lines):
        lost = -math.fsum(line.points for line in found.lines if line.term == term and line.points < 0.0)
        if lost > 0.0:
            ax.barh([place], [lost], left=[at], color=LOST[term], height=0.6)
            drawn[LOST_BY.get(term, "lost by driving otherwise (H, D)")] = LOST[term]
            at += lost


def boundary(asked: Asked) -> Figure:
    """How the share of collisions grows with nearness to the exact boundary of the zones: every ADS, by the signed
    criticality of the concrete scenario, on the scale in which the zones are learnt.
    """
    name, names, rows = asked.one_place, asked.names, asked.evaluated
    zones = zone_partitions(asked.evaluation)[name]
    with styled():
        figure, (ax,) = new_figure(asked.width, 0.62)
        ax.axvspan(-1.0, 0.0, color=HAZARDOUS, linewidth=0)
        ax.axvspan(0.0, 1.0, color=SAFE, linewidth=0)
        ax.axvline(0.0, color=INK, linewidth=0.9)
        for who in names:
            own = [row for row in rows if row.ads == who]
            places = exact_target(
                zones.logical, np.array([zones.logical.row(row.values) for row in own]), zones.settings
            )
            order = np.argsort(places)
            hit = np.array([row.collided for row in own], dtype=np.float64)[order]
            share = np.cumsum(hit) / max(hit.sum(), 1.0)
            colour = look_of(who, names)[0]
            steps = [-1.0, *places[order]], [0.0, *share]
            ax.plot(*steps, color=colour, linestyle=line_of(who, names), drawstyle="steps-post",
                    label=f"{who}: {int(hit.sum())} of {len(own)} collide")  # fmt: skip
        ax.set_xlim(-1.0, 1.0)
        ax.set_ylim(-0.03, 1.03)
        ax.set_xlabel("criticality y of the concrete scenario (0: the boundary, above: safe)")
        ax.set_ylabel("share of its collisions so far")
        figure.legend(loc="outside lower center", ncols=1 if asked.width == "column" else 2)
        figure.suptitle(name.replace("_", " "))
    return figure
