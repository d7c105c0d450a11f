"""Figures of studies: nights of an evaluation over time, and people's opinion beside the scores."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sumo_eval.errors import InputError, unknown
from sumo_eval.extras.figures.style import look_of, on_paper
from sumo_eval.extras.panels import Marks, Panel
from sumo_eval.extras.studies.boundary_page import edge_panels
from sumo_eval.extras.studies.opinion import opinion_panels
from sumo_eval.nightly.history import GATE_FAILED, open_history

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUANTITIES = ("S+", "A", "H", "S", "C", "D")
"""Quantities of a night that the trend shows."""


def trend(history: Path, *, scenario: str | None, ads: str | None, width: str) -> Figure:
    """The scores of every ADS over the nights, one panel a score; nights that failed a gate are
    marked.

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
        raise InputError(
            f"The history in {history} must have a night before a trend is drawn: it is empty."
        )
    place = scenario or scenarios[0]
    names = everybody if ads is None else [ads]
    shown = [name for name in QUANTITIES if any(value.quantity == name for value in values)]
    at = {night.night: number for number, night in enumerate(nights)}
    panels = []
    for quantity in shown:
        marks = []
        for who in names:
            own = [v for v in values if (v.ads, v.scenario, v.quantity) == (who, place, quantity)]
            y = [np.nan if value.value is None else value.value for value in own]
            colour, marker, line = look_of(who, everybody)
            marks.append(Marks(who, [at[value.night] for value in own], y, colour, line, marker))
        failed = [at[night.night] for night in nights if night.exit_status == GATE_FAILED]
        panels.append(Panel(marks, y=quantity, verticals=failed))
    panels[-1] = replace(panels[-1], x="night (grey: one that failed)")
    figure = on_paper(
        panels, width, 0.35 if width == "column" else 0.17, words=place.replace("_", " ")
    )
    for ax in figure.axes:
        ax.set_xticks(
            range(len(nights)), [night.night[:10] for night in nights], rotation=45, ha="right"
        )
    return figure


def edge(folder: Path, *, width: str) -> Figure:
    """Boundary of a folder of `sumo-eval boundary`: where an ADS is likelier to collide than not.

    Every trial is drawn. One map for two parameters, one below the other for each value of a third.

    Raises InputError where a file is missing, as in a folder of an older version.
    """
    words, panels = edge_panels(folder)
    return on_paper(panels, width, 0.62, words=words)


def opinion(run: Path, *, width: str) -> Figure:
    """Scores against people's mean opinion, as Fig. 11 of the paper.

    A panel a score, with Spearman's rho and its interval.

    Raises InputError without answers (`sumo-eval humans opinion`).
    """
    return on_paper(opinion_panels(run), width, 0.85, 4 if width == "page" else 2)
