"""Response of the ADSs' ranking to constants that the paper leaves open: the command `sensitivity`.

Users: `extras/rates/people_command.py`.
"""

import itertools
import math
import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from sumo_eval.cli.sentences import aligned
from sumo_eval.errors import check_known
from sumo_eval.evaluation import score
from sumo_eval.extras.panels import COLOURED_LINES, Marks, Panel, on_page
from sumo_eval.groups import grouped
from sumo_eval.method.score_terms import ordering_score, paper_score
from sumo_eval.report.page import write_csv
from sumo_eval.report.study_page import Table, write_study
from sumo_eval.results import Evaluation
from sumo_eval.settings import EvaluationSettings
from sumo_eval.settings.checked import hints_of
from sumo_eval.text import cell
from sumo_eval.trajectory import FloatArray

FACTORS = 1.0, 0.5, 2.0  # of the value with which the run was scored
_SETTING_OF = {
    "k1": "method.anthropomorphic.field.k1",
    "k2": "method.anthropomorphic.field.k2",
    "k3": "method.anthropomorphic.steering_threshold_deg",
    "k4": "method.anthropomorphic.acceleration_threshold",
    "centre floor": "method.anthropomorphic.centre_deviation_floor",
    "field floor": "method.anthropomorphic.field_deviation_floor",
}
"""Constants that change D and H: name -> path of the setting."""

K3_IS_IDLE = (
    "k3 moves no score here: it is a threshold only where "
    '`method.anthropomorphic.steering_rule = "wheel"` and without a '
    "`steering_lateral_acceleration`."
)

_LIKENESS_FIELDS = {"D": "d", "H": "human_likeness"}
"""Scores shown for the constants of `_SETTING_OF`: name -> field of ScenarioResult."""
_TOTALS: dict[str, tuple[str, Callable[..., FloatArray], tuple[str, ...]]] = {
    "S": ("s", paper_score, ("c", "d")),
    "S+": ("s_plus", ordering_score, ("task_share", "avoidance_grade", "human_likeness")),
}
"""Scores shown for the constant a: name -> field of ScenarioResult; function that computes the
score, and fields of its arguments.
"""

# The bands of the drivers' own scores take long and are not used here: with slices of 100 m they
# take little time.
_COARSE_BANDS = "method.anthropomorphic.band_slice_spacing=100.0"
_VALUES_OF_A = 10.0, 25.0, 50.0, 75.0, 90.0  # points for collision avoidance, of 100
_PANELS_ACROSS = 4
_PANEL_WIDTH, _PANEL_HEIGHT, _MARGIN = 260, 240, 80  # px

Scores = dict[str, float]
"""Score by ADS, nan where not computed."""


class SensitivityRow(NamedTuple):
    """The ADSs in one scenario with one constant changed.

    constant, value: name and changed value of the constant.
    index: score by which the ADSs are ranked, `H`, `D`, `S+` or `S`.
    scores: of the ADSs, in the order of `ads`; nan where not computed.
    ranking: names of the ADSs, best first.
    tau: Kendall's tau-b between these scores and those of the run; 1 where no score changes. It is
        nan where fewer than two ADSs can be ranked, and where the scores of either all tie.
    """

    scenario: str
    constant: str
    value: float
    index: str  # type: ignore[assignment]  # tuples have a method of this name
    ads: tuple[str, ...]
    scores: tuple[float, ...]
    ranking: tuple[str, ...]
    tau: float


def sensitivity(
    run: Path, progress: Callable[[str, int, int], None], *, constants: Sequence[str]
) -> list[SensitivityRow]:
    """Score a run again with each constant halved and doubled, but never above its largest value,
    and with other values of a.

    progress: called with the stage, the number of values scored and the number of all.
    constants: any of k1, k2, k3, k4, `centre floor`, `field floor`, a (b = 100 - a); empty: all,
        but k3 only where it matters (`_k3_counts`).

    Raises InputError for any other constant.
    """
    names = (*_SETTING_OF, "a")
    check_known("constant of the sensitivity", names, *constants)
    base = score(run, [_COARSE_BANDS])
    chosen = constants or [name for name in names if name != "k3" or _k3_counts(base.settings)]
    variants = _variants(run, base, [name for name in _SETTING_OF if name in chosen], progress)
    rows: list[SensitivityRow] = []
    for scenario in dict.fromkeys(result.scenario for result in base.scores):
        if "a" in chosen:
            rows += _rows_of_a(base, scenario)
        for index, field in _LIKENESS_FIELDS.items():
            before = _scores(base, scenario, field)
            for name, value, evaluation in variants:
                scores = _scores(evaluation, scenario, field)
                rows.append(_row((scenario, name, value, index), scores, before))
    return sorted(rows, key=lambda row: (row.scenario, row.constant, row.index, row.value))


def _variants(
    run: Path, base: Evaluation, names: Sequence[str], progress: Callable[[str, int, int], None]
) -> list[tuple[str, float, Evaluation]]:
    """Name, value and evaluation for each value of each constant.

    base: the run as it was scored, the first variant of each constant.
    names: of constants in `_SETTING_OF`.
    """
    variants = []
    for name in names:
        path = _SETTING_OF[name]
        base_value = float(operator.attrgetter(path)(base.settings))
        for factor in FACTORS:
            value = min(base_value * factor, _most(base.settings, path))
            options = [_COARSE_BANDS, f"{path}={value!r}"]
            variants.append((name, value, base if factor == 1.0 else score(run, options)))
            progress("sensitivity", len(variants), len(names) * len(FACTORS))
    return variants


def _rows_of_a(base: Evaluation, scenario: str) -> Iterator[SensitivityRow]:
    """Rows of the totals with other values of a; their terms stay as they were scored."""
    for index, (field, total, terms) in _TOTALS.items():
        before = _scores(base, scenario, field)
        parts = [_scores(base, scenario, term) for term in terms]  # all of the same ADSs
        for a in _VALUES_OF_A:
            points = replace(base.settings.method.score, a=a)  # b follows: 100 - a
            totals = total(*(np.array([*part.values()]) for part in parts), points)
            scores = dict(zip(parts[0], totals.tolist(), strict=True))
            yield _row((scenario, "a", a, index), scores, before)


def _most(settings: EvaluationSettings, path: str) -> float:
    """Largest value that a setting may have.

    path: of the setting, as in `_SETTING_OF`.
    """
    table, _, key = path.rpartition(".")
    owner: Any = type(operator.attrgetter(table)(settings))
    return min(getattr(mark, "le", math.inf) for mark in hints_of(owner)[key].__metadata__)


def _k3_counts(settings: EvaluationSettings) -> bool:
    """Whether k3 matters: it does where steering operations are turns of the wheel beyond k3, not
    lateral manoeuvres or turns beyond a lateral acceleration.
    """
    rules = settings.method.anthropomorphic
    return rules.steering_rule != "manoeuvre" and rules.steering_lateral_acceleration is None


def _scores(evaluation: Evaluation, scenario: str, field: str) -> Scores:
    """One score of every ADS in a scenario; field: of ScenarioResult."""
    values = {result.ads: getattr(result, field) for result in evaluation.scores_in(scenario)}
    return {ads: math.nan if value is None else value for ads, value in values.items()}


def _row(key: tuple[str, str, float, str], now: Scores, before: Scores) -> SensitivityRow:
    """One row of the result.

    key: scenario, constant, its value and the index.
    now, before: scores with this value and as the run was scored.
    """
    ranked = [ads for ads in now if np.isfinite(now[ads])]
    both = [ads for ads in ranked if np.isfinite(before[ads])]
    scores_before, scores_now = [before[ads] for ads in both], [now[ads] for ads in both]
    tau = math.nan
    if len(both) >= 2:
        # kendalltau is nan where all tie; unchanged scores agree even then
        same = scores_before == scores_now
        tau = 1.0 if same else stats.kendalltau(scores_before, scores_now).statistic
    return SensitivityRow(
        *key, tuple(now), tuple(now.values()), tuple(sorted(ranked, key=lambda ads: -now[ads])), tau
    )


def _table(rows: Sequence[SensitivityRow]) -> list[tuple[str, ...]]:
    """The rows as text, after a row of column names."""
    table: list[tuple[str, ...]] = [
        ("scenario", "constant", "value", "index", "ranking, best first", "tau")
    ]
    for row in rows:
        scores = dict(zip(row.ads, row.scores, strict=True))
        ranked = " > ".join(f"{ads} {scores[ads]:z.3g}" for ads in row.ranking) or "none"
        value, tau = f"{row.value:g}", "-" if math.isnan(row.tau) else f"{row.tau:z.2f}"
        table.append((row.scenario, row.constant, value, row.index, ranked, tau))
    return table


def sensitivity_lines(
    rows: Sequence[SensitivityRow], constants: Sequence[str], settings: EvaluationSettings
) -> list[str]:
    """The table for a terminal, and a sentence where k3 is among the constants and moves no score.

    constants: as in `sensitivity`.
    """
    idle = "k3" in (constants or _SETTING_OF) and not _k3_counts(settings)
    return [*aligned(_table(rows)), *([K3_IS_IDLE] if idle else [])]


def write_rows(rows: Sequence[SensitivityRow], path: Path) -> None:
    """Write at least one row as CSV, fields as columns; a tuple's values stand in one cell,
    separated by spaces.
    """
    write_csv(path, rows[0]._fields, (map(_cell, row) for row in rows))


def _cell(value: Any) -> Any:
    if isinstance(value, tuple):
        value = " ".join(item if isinstance(item, str) else f"{item:g}" for item in value)
    return cell(value)


def write_sensitivity_plot(rows: Sequence[SensitivityRow], path: Path) -> None:
    """Write a page with up to three charts for each scenario: the totals, D and H.

    A chart has a panel for each score and constant, with the score of every ADS over its value.

    path: of the page; in the same folder is the file of `write_rows`, with the ending `.csv`.
    """
    header, *cells = _table(rows)
    # S and S+ share a chart
    caption = dict.fromkeys(_TOTALS, " and ".join(_TOTALS))
    charts = grouped((f"{row.scenario}: {caption.get(row.index, row.index)}", row) for row in rows)
    write_study(
        path,
        kicker="Sensitivity",
        title="Effect of the constants on the scores",
        sentences=[
            "Each constant is moved alone. Where the lines of two ADSs cross, it decides which of "
            "them is better."
        ],
        figures={caption: _chart(chart) for caption, chart in charts.items()},
        data=Table(header, cells, path.with_suffix(".csv").name),
        least_width=_PANEL_WIDTH * _PANELS_ACROSS,
    )


def _chart(rows: Sequence[SensitivityRow]) -> Any:
    """One chart; rows: of each panel by rising value of the constant."""
    panels = []
    for title, part in grouped((f"{it.index} over {it.constant}", it) for it in rows).items():
        values = [row.value for row in part]
        # for each ADS its scores at these values
        lines = zip(*(row.scores for row in part), strict=True)
        marks = [
            Marks(ads, values, scores, *look)
            for ads, scores, look in zip(part[0].ads, lines, itertools.cycle(COLOURED_LINES))
        ]
        panels.append(Panel(marks, title=title))
    return on_page(
        panels, _PANELS_ACROSS, _PANEL_HEIGHT * math.ceil(len(panels) / _PANELS_ACROSS) + _MARGIN
    )
