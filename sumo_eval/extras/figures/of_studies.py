"""Figures of studies: nights of an evaluation over time, and people's opinion beside the scores."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sumo_eval.errors import InputError, unknown
from sumo_eval.extras.figures.style import (
    COLOURS,
    FAINT,
    HAZARDOUS,
    INK,
    MUTED,
    SAFE,
    line_of,
    look_of,
    new_figure,
    styled,
)
from sumo_eval.nightly.history import open_history
from sumo_eval.report.opinion_section import opinion_content

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OF_AN_EDGE = ("chances.csv", "trials.csv")

QUANTITIES = ("S+", "A", "H", "S", "C", "D")
"""What the trend shows of the quantities that nights keep."""


def trend(history: Path, *, scenario: str | None, ads: str | None, width: str) -> Figure:
    """The scores of every ADS over the nights, one panel a score; nights that failed a gate are marked.

    Raises InputError where the folder has no history, or the history no such scenario or ADS.
    """
    with open_history(history) as lines:
        nights, values = lines.nights(), lines.values()
    scenarios = list(dict.fromkeys(value.scenario for value in values))
    everybody = list(dict.fromkeys(value.ads for value in values))
    if scenario is not None and scenario not in scenarios:
        raise unknown("scenario", scenario, scenarios)
    if ads is not None and ads not in everybody:
        raise unknown("ADS", ads, everybody)
    if not values:
        raise InputError(f"The history in {history} holds no night yet, so there is no trend to draw.")
    place = scenario or scenarios[0]
    names = everybody if ads is None else [ads]
    shown = [name for name in QUANTITIES if any(value.quantity == name for value in values)]
    at = {night.night: number for number, night in enumerate(nights)}
    with styled():
        figure, axes = new_figure(width, (0.35 if width == "column" else 0.17) * len(shown) + 0.2, len(shown))
        for ax, quantity in zip(axes, shown, strict=True):
            for who in names:
                own = [v for v in values if (v.ads, v.scenario, v.quantity) == (who, place, quantity)]
                y = np.array([np.nan if value.value is None else value.value for value in own])
                colour, marker = look_of(who, everybody)
                ax.plot([at[value.night] for value in own], y, color=colour, marker=marker,
                        linestyle=line_of(who, everybody), label=who if ax is axes[0] else None)  # fmt: skip
            for night in nights:
                if not night.good:
                    ax.axvline(at[night.night], color=FAINT, linewidth=3.0, zorder=0)
            ax.set_ylabel(quantity)
            ax.set_xticks(range(len(nights)))
            ax.tick_params(labelbottom=ax is axes[-1])
        axes[-1].set_xticklabels([night.night[:10] for night in nights], rotation=45, ha="right")
        if any(not night.good for night in nights):
            axes[0].plot([], [], color=FAINT, linewidth=3.0, label="a night that failed")
        figure.legend(loc="outside lower center", ncols=4)
        figure.suptitle(place.replace("_", " "))
    return figure


def edge(folder: Path, *, width: str) -> Figure:
    """What `sumo-eval boundary` wrote into a folder: where the ADS is likelier to collide than not, and every trial.

    One map for two parameters, one below the other for each value of a third. Raises InputError where a file is
    missing, as in a folder of an older version.
    """
    try:
        told = json.loads((folder / "boundary.json").read_text(encoding="utf-8"))
        tables = [np.genfromtxt(folder / name, delimiter=",", skip_header=1, ndmin=2) for name in _OF_AN_EDGE]
    except OSError as error:
        raise InputError(f"The boundary in {folder} cannot be drawn: {error}. Search it again.") from error
    chances, trials = tables
    axes_of = told["parameters"]
    k = len(axes_of)
    maps = np.split(chances, np.flatnonzero(np.diff(chances[:, 2])) + 1) if k > 2 else [chances]
    third = np.array([one[0, 2] for one in maps]) if k > 2 else np.zeros(1)
    nearest = np.argmin(np.abs(trials[:, 2:3] - third), axis=1) if k > 2 else np.zeros(len(trials), dtype=int)
    names = [", ".join((one["name"], *([one["unit"]] if one["unit"] not in ("", "1") else []))) for one in axes_of]
    with styled():
        figure, axes = new_figure(width, 0.62 * len(maps), len(maps))
        for number, (ax, one) in enumerate(zip(axes, maps, strict=True)):
            if k > 1:
                side = int(np.flatnonzero(np.diff(one[:, 1]))[0]) + 1  # values of the first parameter
                x, y, chance = (one[:, column].reshape(-1, side) for column in (0, 1, -1))
            else:
                x, chance = (np.tile(one[:, column], (2, 1)) for column in (0, -1))
                y = np.array([[-1.0], [1.0]]) * np.ones(x.shape)
            ax.contourf(x, y, chance, levels=[-1.0, 0.5, 2.0], colors=[SAFE, HAZARDOUS])
            if np.nanmin(chance) < 0.5 < np.nanmax(chance):
                ax.contour(x, y, chance, levels=[0.5], colors=[INK], linewidths=1.0)
            for hit, marker, label in ((0.0, "o", "no collision"), (1.0, "x", "collision")):
                here = trials[(trials[:, -1] == hit) & (nearest == number)]
                ax.plot(here[:, 0], here[:, 1] if k > 1 else np.zeros(len(here)), marker, markersize=3.0,
                        color=COLOURS[int(hit)], label=label if ax is axes[0] else None)  # fmt: skip
            if k > 2:
                ax.set_title(f"{axes_of[2]['name']} = {third[number]:z.3g}")
            if k > 1:
                ax.set_ylabel(names[1])
            else:
                ax.set_yticks([])
        axes[-1].set_xlabel(names[0])
        figure.legend(loc="outside lower center", ncols=2)
        figure.suptitle(f"{told['scenario'].replace('_', ' ')}: where {told['ads']} collides")
    return figure


def opinion(run: Path, *, width: str) -> Figure:
    """The paper's Fig. 11: scores against people's mean opinion, a panel a score, with Spearman's rho and its interval.

    Raises InputError where nobody has been asked (`sumo-eval humans opinion`).
    """
    told = opinion_content(run)
    if told is None:
        raise InputError(f"Nobody's opinion is in {run}; ask people first and add it with: sumo-eval humans opinion.")
    panels = told["panels"]
    columns = 3 if width == "page" else 2
    rows = -(-len(panels) // columns)
    with styled():
        figure, axes = new_figure(width, 0.85 * rows / columns + 0.05, rows, columns)
        for ax, panel in zip(axes, panels, strict=False):
            most = float(panel["most"])
            ax.scatter([dot["opinion"] for dot in panel["dots"]], [dot["share"] * most for dot in panel["dots"]],
                       s=12, c=INK, linewidths=0)  # fmt: skip
            rho = "no correlation: fewer than 3" if panel["rho"] is None else f"rho {panel['rho']:.2f}"
            if panel["interval"] is not None:
                rho += f", {panel['interval'][0]:.2f}..{panel['interval'][1]:.2f}"
            ax.set_title(f"{panel['name']} ({rho})")
            ax.set_xlim(0.5, 10.5)
            ax.set_xlabel("mean opinion (1-10)")
            ax.set_ylabel(panel["name"], color=MUTED)
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
    return figure
