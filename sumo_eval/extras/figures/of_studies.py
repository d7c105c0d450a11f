"""Figures of studies: scores over nights, the boundary of an ADS's failures, ratings and scores.

`drawn.draw` calls them for `sumo-eval plot`.

Users: `extras/figures/drawn.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sumo_eval.errors import InputError, check_known
from sumo_eval.extras.figures.style import look_of, on_paper
from sumo_eval.extras.panels import Marks, Panel
from sumo_eval.extras.studies.boundary_page import edge_panels
from sumo_eval.extras.studies.opinion import opinion_panels
from sumo_eval.groups import grouped
from sumo_eval.nightly.history import GATE_FAILED, Night, QuantityLine, open_history

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUANTITIES = "S+", "A", "H", "S", "C", "D"
"""Scores that the trend shows, one panel each, where a night has them."""


def trend(history: Path, *, scenario: str | None, ads: str | None, width: str) -> Figure:
    """Scores of every ADS in one scenario over the nights, with marks where a night failed a gate.

    history: folder of the history of nights.
    scenario, ads: names; None: the first scenario, all ADSs.
    width: a key of `style.WIDTHS`.
    Raises InputError where the folder has no history, or the history no such scenario or ADS.
    """
    with open_history(history) as database:
        nights, values = database.in_time(), database.values()
    if not values:
        raise InputError(
            f"The history in {history} must have a night before a trend is drawn: it is empty."
        )
    scenarios = list(dict.fromkeys(value.scenario for value in values))
    all_ads = list(dict.fromkeys(value.ads for value in values))
    chosen = scenarios[0] if scenario is None else scenario
    names = all_ads if ads is None else [ads]
    check_known("scenario", scenarios, chosen)
    check_known("ADS", all_ads, *names)
    values = [it for it in values if it.scenario == chosen and it.ads in names]
    if not values:
        raise InputError(f"A night must have driven {ads} in {chosen} before this trend is drawn.")

    failed = [number for number, night in enumerate(nights) if night.exit_status == GATE_FAILED]
    by_quantity = grouped((it.quantity, it) for it in values)
    panels = [
        Panel(
            [_trend_line(by_quantity[quantity], nights, name, all_ads) for name in names],
            y=quantity,
            verticals=failed,
        )
        for quantity in QUANTITIES
        if quantity in by_quantity
    ]
    # the panels share the x axis, and the lowest one labels it
    panels[-1] = replace(panels[-1], x="night (grey: one that failed)")

    height = 0.35 if width == "column" else 0.17  # of a panel, as a share of its width
    figure = on_paper(panels, width, height, words=chosen)
    dates = [night.night[:10] for night in nights]
    for ax in figure.axes:
        ax.set_xticks(range(len(nights)), dates, rotation=45, ha="right")
    return figure


def _trend_line(
    values: Sequence[QuantityLine], nights: Sequence[Night], ads: str, all_ads: Sequence[str]
) -> Marks:
    """One score of an ADS over the numbers of the nights.

    values: of this score, of all ADSs.
    all_ads: by which an ADS looks the same alone and among others.
    """
    by_night = {it.night: it.value for it in values if it.ads == ads}
    # nan in a night without a value: a gap in the line
    y = np.array([by_night.get(night.night) for night in nights], float)
    colour, marker, line = look_of(ads, all_ads)
    return Marks(ads, range(len(nights)), y, colour, line, marker)


def edge(folder: Path, *, width: str) -> Figure:
    """Boundary of an ADS's collisions, with every trial.

    On one side of the boundary a collision is likelier than not. Two parameters have one map. Three
    have a map for each value of the third, one below the other.

    folder: of `sumo-eval boundary`.
    width: a key of `style.WIDTHS`.
    Raises InputError where a file is damaged, or missing as in a folder of an older version.
    """
    words, panels = edge_panels(folder)
    return on_paper(panels, width, 0.62, words=words)


def opinion(run: Path, *, width: str) -> Figure:
    """Scores over the mean rating by people, as in the paper's Fig. 11.

    One panel for each score, with Spearman's rho and its interval.

    width: a key of `style.WIDTHS`.
    Raises InputError for a run without ratings, which `sumo-eval humans opinion` adds.
    """
    return on_paper(opinion_panels(run), width, 0.85, columns=4 if width == "page" else 2)
