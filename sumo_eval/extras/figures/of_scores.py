"""Figures of the scores of a run: collisions, intervals, and the points that were lost.

`drawn.draw` finds each public function by its name, for `sumo-eval plot FIGURE`. A height given to
`on_paper` is a share of a panel's width, one given to `new_figure` of the figure's width.

Users: `extras/figures/drawn.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sumo_eval.extras.figures.chosen import FigureRequest
from sumo_eval.extras.figures.style import look_of, new_figure, on_paper, styled
from sumo_eval.extras.panels import FAINT, MUTED, Marks, Panel
from sumo_eval.groups import grouped
from sumo_eval.results import ScenarioResult
from sumo_eval.scoring.findings import Findings
from sumo_eval.scoring.gate_settings import HIGHER_IS_BETTER
from sumo_eval.scoring.ledger import NOT_COMPUTED, Ledger, LedgerLine, ledger, ledger_plus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOST = {
    "T": ("lost by not driving (T)", "#56b4e9"),
    **dict.fromkeys(("A", "C"), ("lost by harm (A, C)", "#d55e00")),
    **dict.fromkeys(("H", "D"), ("lost by driving otherwise (H, D)", "#e69f00")),
    NOT_COMPUTED: ("of a term that was not computed", FAINT),
}
"""Term of S+ (T, A, H) or of S (C, D), or `NOT_COMPUTED` -> words and colour of the points that it
costs.
"""
KEPT = "#0072b2"  # colour of the points that an ADS kept


def collisions(request: FigureRequest) -> Figure:
    """Severity U of every collision (Eq. 15) over that of the ideal vehicle at the same point.

    One panel a scenario. On its diagonal the ADS collides as severely as the ideal vehicle.
    """
    chosen = request.chosen_scenario
    scenarios = [chosen] if chosen else request.evaluation.scenario_names
    panels = [_severity_panel(request, scenario) for scenario in scenarios]
    columns = min(len(panels), 2 if request.width == "column" else 3)
    return on_paper(panels, request.width, 0.85, columns)


def _severity_panel(request: FigureRequest, scenario: str) -> Panel:
    """The panel of one scenario."""
    marks, most = [], 0.0
    collisions = without_severity = 0
    for ads in request.names:
        cases = request.evaluation.cases_of(ads, scenario)
        # U of the ideal vehicle and of the ADS, m/s, (n, 2); nan: not known
        pairs = np.column_stack([cases.ideal_severity, cases.severity])[cases.collided]
        known = ~np.isnan(pairs).any(axis=1)
        collisions += len(pairs)
        without_severity += int(np.count_nonzero(~known))
        pairs = pairs[known]
        most = pairs.max(initial=most)
        colour, marker, _ = look_of(ads, request.names)
        marks.append(Marks(ads, pairs[:, 0], pairs[:, 1], colour, marker=marker))
    if most:
        marks.insert(0, Marks("", [0.0, most], [0.0, most], MUTED, "-"))
    title = scenario
    if not collisions:
        title += ": no collision"
    elif without_severity:
        title += f": U unknown in {without_severity} of {collisions}"
    return Panel(marks, "U of the ideal vehicle", "U of the ADS", title)


def intervals(request: FigureRequest) -> Figure:
    """Scores that are better when higher, each with its 95 % interval.

    One panel a score, with a line for each ADS in each scenario.
    """
    scores, panels = request.scores, []
    for symbol, name in HIGHER_IS_BETTER.items():
        missing = any(getattr(score, name) is None for score in scores)
        title = f"{symbol} (no mark: not computed)" if missing else symbol
        panels.append(Panel([*_interval_marks(request, name)], title))
    columns = 2 if request.width == "column" else 4
    # Each line needs room. Four panels in a row are narrower, so their height is a larger share.
    height = max(0.5, 0.09 * len(scores) + 0.3) * (1.3 if columns == 2 else 2.0)
    figure = on_paper(panels, request.width, height, columns)
    for number, ax in enumerate(figure.axes):
        _name_lines(ax, scores)
        ax.tick_params(labelleft=number % columns == 0)
        ax.grid(axis="x", color=FAINT, linewidth=0.4)
    return figure


def _interval_marks(request: FigureRequest, name: str) -> Iterator[Marks]:
    """Value and interval of a score of every ADS and scenario, on a line for each.

    name: of the score, a field of `ScenarioResult`.
    """
    for line, score in enumerate(request.scores):
        value, interval = getattr(score, name), getattr(score, f"{name}_interval")
        colour, marker, _ = look_of(score.ads, request.names)
        if interval is not None:
            yield Marks("", interval, [line, line], colour, "-")
        if value is not None:
            yield Marks("", [value], [line], colour, marker=marker)


def _name_lines(ax: Axes, scores: Sequence[ScenarioResult]) -> None:
    """Label the y axis with ADS and scenario of each score; line 0 is the uppermost."""
    ax.set_ylim(len(scores) - 0.5, -0.5)
    ax.tick_params(axis="y", length=0)
    names = [f"{score.ads}, {score.scenario}" for score in scores]
    ax.set_yticks(range(len(scores)), names, fontsize=5.5, parse_math=False)


def points(request: FigureRequest) -> Figure:
    """Points of S+ and of S: how many of 100 each ADS kept, and how many each term cost.

    One panel a score, with a line for each ADS in each scenario.
    """
    scores, column = request.scores, request.width == "column"
    height = 0.16 * len(scores) + 0.45 if column else 0.07 * len(scores) + 0.2
    with styled():
        figure, axes = new_figure(request.width, height, 1, 2)
        legend = {"kept": KEPT}  # words -> colour; the bars add to it
        panels = (("S+", ledger_plus), ("S", ledger))
        for ax, (title, account_of) in zip(axes, panels, strict=True):
            for line, score in enumerate(scores):
                account = account_of(Findings.of(request.evaluation, score))
                _ledger_bar(ax, account, line, legend)
            _name_lines(ax, scores)
            ax.set(title=title, xlabel="points", xlim=(0.0, 100.0))
        axes[1].tick_params(labelleft=False)
        for words, colour in legend.items():
            axes[0].barh([0], [0.0], color=colour, label=words)  # for the legend only
        figure.legend(loc="outside lower center", ncols=2 if column else 4, fontsize=6.0)
    return figure


def _ledger_bar(ax: Axes, account: Ledger, line: int, legend: dict[str, str]) -> None:
    """Draw kept points as a bar, and to its right the points that each term costs; words instead,
    if the score was not computed.

    line: y of the bar.
    legend: words -> colour; those of the costs are added.
    """
    if getattr(account.score, HIGHER_IS_BETTER[account.name]) is None:
        ax.text(1.0, line, NOT_COMPUTED, va="center", fontsize=5.5, color=MUTED)
        return
    end = account.total
    ax.barh([line], [end], color=KEPT, height=0.6)
    # the score stands within its bar, or right of one that is too short for it
    offset, side = (-2, "right") if end > 12.0 else (2, "left")
    ax.annotate(
        f"{end:.1f}", (end, line), xytext=(offset, 0), textcoords="offset points", ha=side,
        va="center", fontsize=5.5, color="white"
    )  # fmt: skip
    lost = grouped((_reason(item), -item.points) for item in account.lines if item.points < 0.0)
    for reason, losses in lost.items():
        words, colour = LOST[reason]
        ax.barh([line], [math.fsum(losses)], left=[end], color=colour, height=0.6)
        legend[words] = colour
        end += math.fsum(losses)


def _reason(item: LedgerLine) -> str:
    """The key in `LOST` of a line that costs points."""
    # A term that collisions void is not computed either, but then the line has their cases.
    return item.cause if item.cause == NOT_COMPUTED and not item.entries else item.term
