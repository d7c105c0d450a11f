"""Response of the ADSs' ranking to the constants that the paper leaves open."""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

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
    'the steering wheel (`method.anthropomorphic.steering_rule = "wheel"`).'
)
"""Why the default leaves k3 out."""

_LIKENESSES = {"D": "d", "H": "human_likeness"}
_TOTALS = {"S": "s", "S+": "s_plus"}
"""Scores that the constants move: name -> field of ScenarioResult; a moves S and S+, the rest D and
H."""

# the drivers' own scores are not used here
_NO_BANDS = "method.anthropomorphic.band_slice_spacing=100.0"
_POINTS = (10.0, 25.0, 50.0, 75.0, 90.0)


Scores = dict[str, float]
"""Of each ADS, nan where not computed."""


class SensitivityRow(NamedTuple):
    """The ADSs in one scenario with one constant changed.

    index: score by which they are ranked, `H`, `D`, `S+` or `S`.
    value: of the constant.
    scores: in the order of `ads`, nan where not computed.
    ranking: names, best first.
    tau: Kendall's tau with the ranking as scored, 1 where it is the same; nan where fewer than two
        ADSs can be ranked.
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
    """Score a run again with each constant halved and doubled, and with other shares of the points.

    constants: any of k1, k2, k3, k4, `centre floor`, `field floor`, a (b = 100 - a); none: all that
        can move a score of this run (`without_the_wheel`).
    Raises InputError for others.
    """
    known = (*_D_PATHS, "a")
    for name in constants:
        if name not in known:
            raise InputError(
                f"A constant of the sensitivity must be one of {', '.join(known)}, got {name!r}."
            )
    base = score(run, [_NO_BANDS])
    if not constants:
        silent = {"k3"} if without_the_wheel(base.settings) else set()
        constants = [name for name in known if name not in silent]
    wanted = [(name, factor) for name in constants if name in _D_PATHS for factor in FACTORS]
    variants = [(name, _value(base, name), base) for name in constants if name in _D_PATHS]
    for done, (name, factor) in enumerate(wanted, start=1):
        value = _value(base, name) * factor
        variants.append((name, value, score(run, [_NO_BANDS, f"{_D_PATHS[name]}={value!r}"])))
        progress("sensitivity", done, len(wanted))
    rows = []
    for scenario in dict.fromkeys(result.scenario for result in base.scores):
        for index, field in _TOTALS.items() if "a" in constants else ():
            standing = _scores(base, scenario, field)
            for a in _POINTS:
                scores = _with_points(base, scenario, a, index)
                rows.append(_row((scenario, "a", a, index), scores, standing))
        for index, field in _LIKENESSES.items():
            standing = _scores(base, scenario, field)
            for name, value, evaluation in variants:
                scores = _scores(evaluation, scenario, field)
                rows.append(_row((scenario, name, value, index), scores, standing))
    return sorted(rows, key=lambda row: (row.scenario, row.constant, row.index, row.value))


def without_the_wheel(settings: EvaluationSettings) -> bool:
    """Whether steering operations are lateral manoeuvres, for which k3 sets no threshold."""
    return settings.method.anthropomorphic.steering_rule == "manoeuvre"


def _value(evaluation: Evaluation, constant: str) -> float:
    value = operator.attrgetter(_D_PATHS[constant])(evaluation.settings)
    assert isinstance(value, float)
    return value


def _scores(evaluation: Evaluation, scenario: str, field: str) -> Scores:
    results = (result for result in evaluation.scores if result.scenario == scenario)
    values = {result.ads: getattr(result, field) for result in results}
    return {ads: math.nan if value is None else float(value) for ads, value in values.items()}


def _with_points(evaluation: Evaluation, scenario: str, a: float, index: str) -> Scores:
    """S+ or S of every ADS with a points for collisions and 100 - a for likeness."""
    points = replace(evaluation.settings.method.score, a=a)
    names: tuple[str, ...] = ("c", "d")
    total: Any = paper_score
    if index == "S+":
        names, total = ("task_share", "avoidance_grade", "human_likeness"), ordering_score
    terms = [_scores(evaluation, scenario, name) for name in names]
    return {
        ads: float(total(*(np.array([term[ads]]) for term in terms), points)[0]) for ads in terms[0]
    }


def _row(key: tuple[str, str, float, str], now: Scores, before: Scores) -> SensitivityRow:
    """key: scenario, constant, its value and the index."""
    ranked = [ads for ads in now if np.isfinite(now[ads])]
    both = [ads for ads in ranked if np.isfinite(before[ads])]
    first, second = ([scores[ads] for ads in both] for scores in (before, now))
    tau = math.nan
    if len(both) >= 2:
        tau = 1.0 if first == second else float(stats.kendalltau(first, second).statistic)
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


def sensitivity_lines(rows: Sequence[SensitivityRow], *, by_wheel: bool = True) -> list[str]:
    """The table for a terminal.

    by_wheel: whether k3 is a threshold of this run; where not, a sentence reports it.
    """
    return [*aligned(_table(rows)), *([] if by_wheel else [NO_WHEEL])]


_ACROSS = 4
"""Panels in a row."""


def write_sensitivity_plot(rows: Sequence[SensitivityRow], path: Path) -> None:
    """Charts for each scenario, of the totals, of D and of H; in them one panel for each constant:
    the ADSs' scores against it.
    """
    charts: dict[str, list[SensitivityRow]] = {}
    for row in rows:
        index = " and ".join(_TOTALS) if row.index in _TOTALS else row.index
        charts.setdefault(f"{row.scenario}: {index}", []).append(row)
    write_study(
        path,
        kicker="Sensitivity",
        title="Effect of the constants on the scores",
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
    groups: dict[str, list[SensitivityRow]] = {}
    for row in rows:
        groups.setdefault(f"{row.index} over {row.constant}", []).append(row)
    panels = []
    for title, part in groups.items():
        values, scores = (
            [row.value for row in part],
            zip(*(row.scores for row in part), strict=True),
        )
        marks = [
            Marks(ads, values, each, colour, "-")
            for ads, each, colour in zip(part[0].ads, scores, itertools.cycle(COLOURS))
        ]
        panels.append(Panel(marks, title=title))
    return on_page(panels, _ACROSS, 240 * -(-len(panels) // _ACROSS) + 80)
