"""Response of the ADSs' ranking to the constants that the paper leaves open."""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import stats

from sumo_eval.errors import InputError
from sumo_eval.evaluation import score
from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.extras.studies.tables import aligned
from sumo_eval.method.score_terms import ordering_score, paper_score
from sumo_eval.report.study_page import write_study
from sumo_eval.results import Evaluation
from sumo_eval.settings import EvaluationSettings
from sumo_eval.trajectory import FloatArray

if TYPE_CHECKING:
    import plotly.graph_objects as go

FACTORS = (0.5, 2.0)
_SETTING_OF = {
    "k1": "method.anthropomorphic.field.k1",
    "k2": "method.anthropomorphic.field.k2",
    "k3": "method.anthropomorphic.steering_threshold_deg",
    "k4": "method.anthropomorphic.acceleration_threshold",
    "centre floor": "method.anthropomorphic.centre_deviation_floor",
    "field floor": "method.anthropomorphic.field_deviation_floor",
}
"""Constants that move D and H: name -> path of the setting."""

K3_LEFT_OUT = (
    "k3 is left out: it is a threshold only where "
    '`method.anthropomorphic.steering_rule = "wheel"`; here a steering operation is a lateral '
    "manoeuvre."
)

_LIKENESSES = {"D": "d", "H": "human_likeness"}
_TOTALS = {"S": "s", "S+": "s_plus"}
"""Scores that the constants move: name -> field of ScenarioResult; a moves S and S+, the rest D and
H."""

# coarse slices for the bands of the drivers' own scores, which take long and are not used here
_COARSE_BANDS = "method.anthropomorphic.band_slice_spacing=100.0"
_VALUES_OF_A = (10.0, 25.0, 50.0, 75.0, 90.0)  # points for collision avoidance, of 100
_PANELS_ACROSS = 4
_PANEL_WIDTH, _PANEL_HEIGHT, _MARGIN = 260, 240, 80  # px

Scores = dict[str, float]
"""Score by ADS, nan where not computed."""


class SensitivityRow(NamedTuple):
    """The ADSs in one scenario with one constant changed.

    index: score by which they are ranked, `H`, `D`, `S+` or `S`.
    value: of the constant.
    scores: in the order of `ads`, nan where not computed.
    ranking: names, best first.
    tau: Kendall's tau-b of the scores with those as scored, 1 where no score changes; nan where
        fewer than two ADSs can be ranked, or where all tie.
    """

    scenario: str
    constant: str
    value: float
    index: str  # type: ignore[assignment]
    ads: tuple[str, ...]
    scores: tuple[float, ...]
    ranking: tuple[str, ...]
    tau: float


def sensitivity(
    run: Path, progress: Callable[[str, int, int], None], *, constants: Sequence[str] = ()
) -> list[SensitivityRow]:
    """Score a run again with each constant halved and doubled, and with other values of a.

    constants: any of k1, k2, k3, k4, `centre floor`, `field floor`, a (b = 100 - a); none: all that
        can move a score of this run (`k3_counts`).
    Raises InputError for others.
    """
    known = (*_SETTING_OF, "a")
    for name in constants:
        if name not in known:
            raise InputError(
                f"A constant of the sensitivity must be one of {', '.join(known)}, got {name!r}."
            )
    base = score(run, [_COARSE_BANDS])
    chosen = constants or [name for name in known if name != "k3" or k3_counts(base.settings)]
    changed = [name for name in chosen if name in _SETTING_OF]
    variants = []
    for name in changed:
        as_scored = float(operator.attrgetter(_SETTING_OF[name])(base.settings))
        variants.append((name, as_scored, base))
        for value in (as_scored * factor for factor in FACTORS):
            again = score(run, [_COARSE_BANDS, f"{_SETTING_OF[name]}={value!r}"])
            variants.append((name, value, again))
            progress("sensitivity", len(variants), len(changed) * (1 + len(FACTORS)))
    rows = []
    for scenario in dict.fromkeys(result.scenario for result in base.scores):
        for index, field in _TOTALS.items():
            before = _scores(base, scenario, field)
            for a in _VALUES_OF_A if "a" in chosen else ():
                scores = _with_points(base, scenario, a, index)
                rows.append(_row((scenario, "a", a, index), scores, before))
        for index, field in _LIKENESSES.items():
            before = _scores(base, scenario, field)
            for name, value, evaluation in variants:
                scores = _scores(evaluation, scenario, field)
                rows.append(_row((scenario, name, value, index), scores, before))
    return sorted(rows, key=lambda row: (row.scenario, row.constant, row.index, row.value))


def k3_counts(settings: EvaluationSettings) -> bool:
    """Whether k3 is a threshold: steering operations are turns of the wheel, not manoeuvres."""
    return settings.method.anthropomorphic.steering_rule != "manoeuvre"


def _scores(evaluation: Evaluation, scenario: str, field: str) -> Scores:
    results = (result for result in evaluation.scores if result.scenario == scenario)
    values = {result.ads: getattr(result, field) for result in results}
    return {ads: math.nan if value is None else float(value) for ads, value in values.items()}


def _with_points(evaluation: Evaluation, scenario: str, a: float, index: str) -> Scores:
    """S+ or S of every ADS with `a` points for collision avoidance, and the rest of 100, b, for
    likeness.
    """
    points = replace(evaluation.settings.method.score, a=a)

    def of(name: str) -> FloatArray:
        return np.array([*_scores(evaluation, scenario, name).values()])

    if index == "S":
        totals = paper_score(of("c"), of("d"), points)
    else:
        terms = of("task_share"), of("avoidance_grade"), of("human_likeness")
        totals = ordering_score(*terms, points)
    return dict(zip(_scores(evaluation, scenario, "c"), totals.tolist(), strict=True))


def _row(key: tuple[str, str, float, str], now: Scores, before: Scores) -> SensitivityRow:
    """key: scenario, constant, its value and the index."""
    ranked = [ads for ads in now if np.isfinite(now[ads])]
    both = [ads for ads in ranked if np.isfinite(before[ads])]
    scores_before, scores_now = [before[ads] for ads in both], [now[ads] for ads in both]
    tau = math.nan
    if len(both) >= 2:  # kendalltau is nan where all tie
        same = scores_before == scores_now
        tau = 1.0 if same else float(stats.kendalltau(scores_before, scores_now).statistic)
    ranking = tuple(sorted(ranked, key=lambda ads: -now[ads]))
    return SensitivityRow(*key, tuple(now), tuple(now.values()), ranking, tau)


def _table(rows: Sequence[SensitivityRow]) -> list[tuple[str, ...]]:
    """The rows in words, their head first."""
    table: list[tuple[str, ...]] = [
        ("scenario", "constant", "value", "index", "ranking, best first", "tau")
    ]
    for row in rows:
        scores = dict(zip(row.ads, row.scores, strict=True))
        ranked = " > ".join(f"{ads} {scores[ads]:z.3g}" for ads in row.ranking) or "none"
        value, tau = f"{row.value:g}", f"{row.tau:z.2f}"
        table.append((row.scenario, row.constant, value, row.index, ranked, tau))
    return table


def sensitivity_lines(rows: Sequence[SensitivityRow], *, k3: bool = True) -> list[str]:
    """The table for a terminal.

    k3: whether it counts in this run (`k3_counts`); where not, a sentence reports it.
    """
    return [*aligned(_table(rows)), *([] if k3 else [K3_LEFT_OUT])]


def write_sensitivity_plot(rows: Sequence[SensitivityRow], path: Path) -> None:
    """For each scenario three charts: the totals, D and H. A chart has a panel for each constant,
    with the ADSs' scores over it.
    """
    charts: dict[str, dict[str, list[SensitivityRow]]] = {}  # by caption, by title of the panel
    for row in rows:
        index = " and ".join(_TOTALS) if row.index in _TOTALS else row.index
        chart = charts.setdefault(f"{row.scenario}: {index}", {})
        chart.setdefault(f"{row.index} over {row.constant}", []).append(row)
    write_study(
        path,
        kicker="Sensitivity",
        title="Effect of the constants on the scores",
        sentences=[
            "Each constant is moved alone. Where the lines of two ADSs cross, it decides which of "
            "them is better."
        ],
        figures={caption: _chart(chart) for caption, chart in charts.items()},
        rows=_table(rows),
        least_width=_PANEL_WIDTH * _PANELS_ACROSS,
    )


def _chart(chart: Mapping[str, Sequence[SensitivityRow]]) -> go.Figure:
    """A panel for each score and constant."""
    panels = []
    for title, part in chart.items():
        values = [row.value for row in part]
        scores = zip(*(row.scores for row in part), strict=True)  # of one ADS over the values
        marks = [
            Marks(ads, values, ys, colour, "-")
            for ads, ys, colour in zip(part[0].ads, scores, itertools.cycle(COLOURS))
        ]
        panels.append(Panel(marks, title=title))
    height = _PANEL_HEIGHT * -(-len(panels) // _PANELS_ACROSS) + _MARGIN
    return on_page(panels, _PANELS_ACROSS, height)
