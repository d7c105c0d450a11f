"""Figures of studies: nights of an evaluation over time, and people's opinion beside the scores."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sumo_eval.errors import InputError, unknown
from sumo_eval.figures.style import FAINT, INK, MUTED, line_of, look_of, new_figure, styled
from sumo_eval.nightly.history import open_history
from sumo_eval.report.opinion_section import opinion_content

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
