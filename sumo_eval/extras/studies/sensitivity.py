"""How the ADSs' ranking responds to the constants that the paper leaves open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    import plotly.graph_objects as go

BASE = "as scored"
FACTORS = (0.5, 2.0)
_D_PATHS = {
    "k1": "method.anthropomorphic.field.k1",
    "k2": "method.anthropomorphic.field.k2",
    "k3": "method.anthropomorphic.steering_threshold_deg",
    "k4": "method.anthropomorphic.acceleration_threshold",
    "centre floor": "method.anthropomorphic.centre_deviation_floor",
    "field floor": "method.anthropomorphic.field_deviation_floor",
}
"""Constants that move D and H: name -> path of the setting."""

NO_WHEEL = (
    "k3 moves nothing here: a steering operation is a lateral manoeuvre, and k3 is a threshold of "
    "the steering wheel "
    '(`method.anthropomorphic.steering_rule = "wheel"`).'
)
"""Why the default leaves k3 out."""

_LIKENESSES = {"D": "d", "H": "human_likeness"}
_TOTALS = {"S": "s", "S+": "s_plus"}
"""What the constants move: name -> field of ScenarioResult.

The rest move D and H, a moves S and S+.
"""

# the drivers' own scores are not looked at here
_NO_BANDS = "method.anthropomorphic.band_slice_spacing=100.0"
_POINTS = (10.0, 25.0, 50.0, 75.0, 90.0)


@dataclass(frozen=True, slots=True)
class SensitivityRow:
    """The ADSs in one scenario with one constant changed.

    index: what they are ranked by, `H`, `D`, `S+` or `S`.
    value: of the constant.
    scores: in the order of `ads`, nan where not computed.
    ranking: names, best first.
    tau: Kendall's tau with the ranking as scored, 1 where it is the same; nan where fewer than two
        ADSs can be ranked.
    """

    scenario: str
    constant: str
    value: float
    index: str
    ads: tuple[str, ...]
    scores: tuple[float, ...]
    ranking: tuple[str, ...]
    tau: float


def sensitivity(
    run: Path, progress: Callable[[str, int, int], None], *, constants: Sequence[str] = ()
) -> list[SensitivityRow]:
    """Score a run again with each constant halved and doubled, and with other shares of the points.

    constants: any of k1, k2, k3, k4, `centre floor`, `field floor`, a (b = 100 - a); none: all that
        can move a score of this run (`without_the_wheel`).
    Raises InputError for others.
    """
    for name in constants:
        if name not in (*_D_PATHS, "a"):
            raise InputError(
                f"A constant of the sensitivity must be one of {', '.join((*_D_PATHS, 'a'))}, got "
                f"{name!r}."
            )
    base = score(run, [_NO_BANDS])
    if not constants:
        constants = [
            name
            for name in (*_D_PATHS, "a")
            if name != "k3" or not without_the_wheel(base.settings)
        ]
    wanted = [(name, factor) for name in constants if name in _D_PATHS for factor in FACTORS]
    variants: list[tuple[str, float, Evaluation]] = []
    for done, (name, factor) in enumerate(wanted, start=1):
        value = _value(base, _D_PATHS[name]) * factor
        variants.append((name, value, score(run, [_NO_BANDS, f"{_D_PATHS[name]}={value!r}"])))
        progress("sensitivity", done, len(wanted))
    rows = []
    for scenario in dict.fromkeys(result.scenario for result in base.scores):
        for name in constants:
            if name == "a":
                for index, field in _TOTALS.items():
                    standing = _scores(base, scenario, field)
                    rows += [
                        _row(
                            scenario,
                            "a",
                            a,
                            index,
                            _with_points(base, scenario, a, index),
                            standing,
                        )
                        for a in _POINTS
                    ]
                continue
            for index, field in _LIKENESSES.items():
                before = _scores(base, scenario, field)
                rows.append(
                    _row(scenario, name, _value(base, _D_PATHS[name]), index, before, before)
                )
                for changed, value, evaluation in variants:
                    if changed == name:
                        rows.append(
                            _row(
                                scenario,
                                name,
                                value,
                                index,
                                _scores(evaluation, scenario, field),
                                before,
                            )
                        )
    return sorted(rows, key=lambda row: (row.scenario, row.constant, row.index, row.value))


def without_the_wheel(settings: EvaluationSettings) -> bool:
    """Whether steering operations are lateral manoeuvres, of which k3 is no threshold."""
    return settings.method.anthropomorphic.steering_rule == "manoeuvre"


def _value(evaluation: Evaluation, path: str) -> float:
    place: object = evaluation.settings
    for name in path.split("."):
        place = getattr(place, name)
    assert isinstance(place, float)
    return place


def _scores(evaluation: Evaluation, scenario: str, field: str) -> dict[str, float]:
    return {
        result.ads: float("nan")
        if getattr(result, field) is None
        else float(getattr(result, field))
        for result in evaluation.scores
        if result.scenario == scenario
    }


def _with_points(evaluation: Evaluation, scenario: str, a: float, index: str) -> dict[str, float]:
    """S+ or S of every ADS with a points for collisions and 100 - a for likeness."""
    points = replace(evaluation.settings.method.score, a=a)
    names = ("task_share", "avoidance_grade", "human_likeness") if index == "S+" else ("c", "d")
    parts = [_scores(evaluation, scenario, name) for name in names]
    totals = {}
    for ads in parts[0]:
        first, second, *third = (np.array([part[ads]]) for part in parts)
        total = (
            ordering_score(first, second, third[0], points)
            if third
            else paper_score(first, second, points)
        )
        totals[ads] = float(total[0])
    return totals


def _row(
    scenario: str,
    constant: str,
    value: float,
    index: str,
    now: dict[str, float],
    before: dict[str, float],
) -> SensitivityRow:
    known = [ads for ads in now if np.isfinite(now[ads]) and np.isfinite(before[ads])]
    tau = float("nan")
    if len(known) >= 2:
        first, second = [before[ads] for ads in known], [now[ads] for ads in known]
        tau = 1.0 if first == second else float(stats.kendalltau(first, second).statistic)
    ranking = tuple(
        sorted((ads for ads in now if np.isfinite(now[ads])), key=lambda ads: -now[ads])
    )
    return SensitivityRow(
        scenario, constant, value, index, tuple(now), tuple(now.values()), ranking, tau
    )


def _table(rows: Sequence[SensitivityRow]) -> list[tuple[str, ...]]:
    """The rows in words, their head first."""
    table: list[tuple[str, ...]] = [
        ("scenario", "constant", "value", "index", "ranking, best first", "tau")
    ]
    for row in rows:
        ranked = (
            " > ".join(f"{ads} {row.scores[row.ads.index(ads)]:z.3g}" for ads in row.ranking)
            or "none"
        )
        table.append(
            (row.scenario, row.constant, f"{row.value:g}", row.index, ranked, f"{row.tau:z.2f}")
        )
    return table


def sensitivity_lines(rows: Sequence[SensitivityRow], *, by_wheel: bool = True) -> list[str]:
    """The table for a terminal.

    by_wheel: whether k3 is a threshold of this run; where not, a sentence says so.
    """
    return [*aligned(_table(rows)), *([] if by_wheel else [NO_WHEEL])]


_ACROSS = 4
"""Panels beside each other."""


def write_sensitivity_plot(rows: Sequence[SensitivityRow], path: Path) -> None:
    """Charts for each scenario, of the totals, of D and of H; in them one panel for each constant:
    the ADSs' scores against it.
    """
    charts: dict[str, list[SensitivityRow]] = {}
    for row in rows:
        what = " and ".join(_TOTALS) if row.index in _TOTALS else row.index
        charts.setdefault(f"{row.scenario}: {what}", []).append(row)
    write_study(
        path,
        kicker="Sensitivity",
        title="What the constants do to the scores",
        sentences=[
            "Each constant is moved alone. Where the lines of two ADSs cross, it decides which of "
            "them is better."
        ],
        figures={caption: _chart(part) for caption, part in charts.items()},
        rows=_table(rows),
        least_width=260 * _ACROSS,
    )


def _chart(rows: Sequence[SensitivityRow]) -> go.Figure:
    """One panel for each score and constant of these."""
    panels = []
    for index, constant in dict.fromkeys((row.index, row.constant) for row in rows):
        part = [row for row in rows if (row.index, row.constant) == (index, constant)]
        values = [row.value for row in part]
        marks = [
            Marks(
                ads,
                values,
                [row.scores[number] for row in part],
                COLOURS[number % len(COLOURS)],
                "-",
            )
            for number, ads in enumerate(part[0].ads)
        ]
        panels.append(Panel(marks, title=f"{index} over {constant}"))
    return on_page(panels, _ACROSS, 240 * -(-len(panels) // _ACROSS) + 80)
