"""What people say of the ADSs beside what the scores say (the paper's Fig. 11)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import checked_numbers, read_table
from sumo_eval.errors import InputError, unknown
from sumo_eval.extras.studies.tables import aligned
from sumo_eval.method.agreement import Agreement, concordance, rank_correlation, rank_interval
from sumo_eval.results import Evaluation

LEAST, MOST = 1.0, 10.0
INDEXES = {
    "S+": "s_plus",
    "T": "task_share",
    "A'": "avoidance_grade",
    "A": "avoided_share",
    "H": "human_likeness",
    "S": "s",
    "D": "d",
    "C": "c",
}
"""What is compared with people's opinion: name -> field of ScenarioResult."""


@dataclass(frozen=True, slots=True)
class RatedScore:
    """One ADS in one scenario: what people gave it on average, how many did, and its scores (None: not computed)."""

    ads: str
    scenario: str
    opinion: float
    deviation: float
    raters: int
    scores: Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class Opinion:
    """rows: one for each rated ADS and scenario. correlations: Spearman's rho with each of `INDEXES`; None where
    fewer than 3 rows have the score. concordance: Kendall's W between the raters who rated everything; None for fewer
    than two.
    """

    rows: tuple[RatedScore, ...]
    correlations: Mapping[str, Agreement | None]
    concordance: Agreement | None


def read_ratings(path: Path) -> pd.DataFrame:
    """Subjective scores: columns rater, ads, scenario, score (1-10). Raises InputError naming file and row."""
    table = read_table(path, ("rater", "ads", "scenario", "score"))
    checked_numbers(table, ["score"], path)
    for name in ("rater", "ads", "scenario"):
        table[name] = table[name].astype(str)
    wrong = np.flatnonzero((table["score"] < LEAST) | (table["score"] > MOST))
    if wrong.size:
        got = table["score"].iloc[wrong[0]]
        raise InputError(f"`score` in row {wrong[0] + 2} of {path} must be within {LEAST:g}..{MOST:g}, got {got:g}.")
    double = np.flatnonzero(table.duplicated(["rater", "ads", "scenario"]))
    if double.size:
        raise InputError(f"Row {double[0] + 2} of {path} rates what its rater has rated in a row above.")
    return table


def compare_opinion(evaluation: Evaluation, ratings: pd.DataFrame) -> Opinion:
    """The ratings beside the scores of a run. Raises InputError for an ADS or scenario that the run does not have."""
    known = {(score.ads, score.scenario): score for score in evaluation.scores}
    for column, place in (("ads", 0), ("scenario", 1)):
        names = list(dict.fromkeys(key[place] for key in known))
        for name in ratings[column].unique():
            if name not in names:
                raise unknown({"ads": "ADS", "scenario": "scenario"}[column], str(name), names)
    rows = []
    for (ads, scenario), given in ratings.groupby(["ads", "scenario"], sort=False):
        score = known[str(ads), str(scenario)]
        values = given["score"].to_numpy(dtype=np.float64)
        rows.append(
            RatedScore(
                str(ads),
                str(scenario),
                float(values.mean()),
                float(values.std(ddof=1)) if values.size > 1 else 0.0,
                values.size,
                {name: getattr(score, field) for name, field in INDEXES.items()},
            )
        )
    correlations: dict[str, Agreement | None] = {}
    for name in INDEXES:
        pairs = [(row.scores[name], row.opinion) for row in rows if row.scores[name] is not None]
        correlations[name] = rank_correlation(*zip(*pairs, strict=True)) if len(pairs) >= 3 else None
    table = ratings.pivot_table(index="rater", columns=["ads", "scenario"], values="score").dropna()
    enough = table.shape[0] >= 2 and table.shape[1] >= 2
    return Opinion(tuple(rows), correlations, concordance(table.to_numpy()) if enough else None)


def opinion_lines(opinion: Opinion) -> list[str]:
    """The comparison in words."""
    table = [("ADS", "scenario", "opinion", "raters", *INDEXES)]
    for row in opinion.rows:
        scores = [_number(row.scores[name]) for name in INDEXES]
        table.append((row.ads, row.scenario, f"{row.opinion:z.2f} +/- {row.deviation:z.2f}", str(row.raters), *scores))
    lines = aligned(table)
    for name, found in opinion.correlations.items():
        lines.append(
            f"{name}: fewer than 3 rated scores, no correlation."
            if found is None
            else f"{name}: Spearman's rho {found.value:z.3f}{_interval(found)} over {found.n} rated scores "
            f"(p = {found.p_value:z.3g})."
        )
    between = opinion.concordance
    lines.append(
        "Raters: fewer than two rated everything, no concordance."
        if between is None
        else f"Raters: Kendall's W {between.value:z.3f} of {between.n} who rated everything "
        f"(p = {between.p_value:z.3g})."
    )
    return lines


def opinion_json(opinion: Opinion) -> dict[str, Any]:
    """The comparison in plain values, as the report of the run shows it."""
    return {
        "rows": [asdict(row) for row in opinion.rows],
        "correlations": {name: found.value if found else None for name, found in opinion.correlations.items()},
        "intervals": {
            name: rank_interval(found.value, found.n) if found else None for name, found in opinion.correlations.items()
        },
        "concordance": opinion.concordance.value if opinion.concordance else None,
    }


def write_opinion_plot(opinion: Opinion, path: Path) -> None:
    """One panel for each of `INDEXES`: score against mean opinion, with the raters' deviation. Works offline."""
    from plotly.subplots import make_subplots

    titles = []
    for name in INDEXES:
        found = opinion.correlations[name]
        titles.append(f"{name} (rho {found.value:z.2f})" if found else name)
    figure = make_subplots(rows=1, cols=len(INDEXES), subplot_titles=titles)
    for column, name in enumerate(INDEXES, start=1):
        rows = [row for row in opinion.rows if row.scores[name] is not None]
        figure.add_scatter(
            x=[row.opinion for row in rows],
            y=[row.scores[name] for row in rows],
            error_x={"type": "data", "array": [row.deviation for row in rows]},
            text=[f"{row.ads}, {row.scenario}" for row in rows],
            mode="markers+text" if len(rows) <= 8 else "markers",
            textposition="top center",
            showlegend=False,
            row=1,
            col=column,
        )
        figure.update_xaxes(title_text="mean subjective score", range=[LEAST - 0.5, MOST + 0.5], row=1, col=column)
        figure.update_yaxes(title_text=name, row=1, col=column)
    figure.update_layout(title="People's opinion and the scores", template="plotly_white")
    try:
        figure.write_html(path, include_plotlyjs=True)
    except OSError as error:
        raise InputError(f"The plot {path} cannot be written: {error}.") from error


def _interval(found: Agreement) -> str:
    ends = rank_interval(found.value, found.n)
    return "" if ends is None else f" [{ends[0]:z.2f}, {ends[1]:z.2f}]"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:z.3f}"
