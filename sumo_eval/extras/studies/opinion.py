"""What people say of the ADSs beside what the scores say (the paper's Fig. 11)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import checked_numbers, read_table
from sumo_eval.errors import InputError, unknown
from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.extras.studies.tables import aligned
from sumo_eval.method.agreement import Agreement, concordance, rank_correlation, rank_interval
from sumo_eval.report.opinion_section import OPINION, opinion_content
from sumo_eval.report.study_page import write_study
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
    """One ADS in one scenario: what people gave it on average, how many did, and its scores (None:
    not computed).
    """

    ads: str
    scenario: str
    opinion: float
    deviation: float
    raters: int
    scores: Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class Opinion:
    """rows: one for each rated ADS and scenario.
    correlations: Spearman's rho with each of `INDEXES`; None where fewer than 3 rows have the
        score.
    concordance: Kendall's W between the raters who rated everything; None for fewer than two.
    """

    rows: tuple[RatedScore, ...]
    correlations: Mapping[str, Agreement | None]
    concordance: Agreement | None


def read_ratings(path: Path) -> pd.DataFrame:
    """Subjective scores: columns rater, ads, scenario, score (1-10).

    Raises InputError naming file and row.
    """
    table = read_table(path, ("rater", "ads", "scenario", "score"))
    checked_numbers(table, ["score"], path)
    for name in ("rater", "ads", "scenario"):
        table[name] = table[name].astype(str)
    wrong = np.flatnonzero((table["score"] < LEAST) | (table["score"] > MOST))
    if wrong.size:
        got = table["score"].iloc[wrong[0]]
        raise InputError(
            f"`score` in row {wrong[0] + 2} of {path} must be within {LEAST:g}..{MOST:g}, got "
            f"{got:g}."
        )
    double = np.flatnonzero(table.duplicated(["rater", "ads", "scenario"]))
    if double.size:
        raise InputError(
            f"Row {double[0] + 2} of {path} rates what its rater has rated in a row above."
        )
    return table


def compare_opinion(evaluation: Evaluation, ratings: pd.DataFrame) -> Opinion:
    """The ratings beside the scores of a run.

    Raises InputError for an ADS or scenario that the run does not have.
    """
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
        correlations[name] = (
            rank_correlation(*zip(*pairs, strict=True)) if len(pairs) >= 3 else None
        )
    table = ratings.pivot_table(index="rater", columns=["ads", "scenario"], values="score").dropna()
    enough = table.shape[0] >= 2 and table.shape[1] >= 2
    return Opinion(tuple(rows), correlations, concordance(table.to_numpy()) if enough else None)


def opinion_lines(opinion: Opinion) -> list[str]:
    """The comparison in words."""
    table = [("ADS", "scenario", "opinion", "raters", *INDEXES)]
    for row in opinion.rows:
        scores = [_number(row.scores[name]) for name in INDEXES]
        table.append(
            (
                row.ads,
                row.scenario,
                f"{row.opinion:z.2f} +/- {row.deviation:z.2f}",
                str(row.raters),
                *scores,
            )
        )
    lines = aligned(table)
    for name, found in opinion.correlations.items():
        lines.append(
            f"{name}: fewer than 3 rated scores, no correlation."
            if found is None
            else f"{name}: Spearman's rho {found.value:z.3f}{_interval(found)} over {found.n} "
            "rated scores "
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
        "correlations": {
            name: found.value if found else None for name, found in opinion.correlations.items()
        },
        "intervals": {
            name: rank_interval(found.value, found.n) if found else None
            for name, found in opinion.correlations.items()
        },
        "concordance": opinion.concordance.value if opinion.concordance else None,
    }


def opinion_panels(run: Path) -> list[Panel]:
    """A panel for each of `INDEXES`: score against mean opinion, with the raters' deviation, from
    the run's folder.

    Raises InputError where nobody has been asked.
    """
    if opinion_content(run) is None:
        raise InputError(
            f"Nobody's opinion is in {run}; ask people first and add it with: sumo-eval humans "
            "opinion."
        )
    told = json.loads((run / OPINION).read_text(encoding="utf-8"))
    panels = []
    for name, rho in told["correlations"].items():
        rows = [row for row in told["rows"] if row["scores"][name] is not None]
        ends = told.get("intervals", {}).get(name)
        within = "" if ends is None else f", {ends[0]:z.2f}..{ends[1]:z.2f}"
        marks = Marks(
            "", [row["opinion"] for row in rows], [row["scores"][name] for row in rows],
            COLOURS[0], marker="o",
            spread=[row["deviation"] for row in rows],
            words=[f"{row['ads']}, {row['scenario']}" for row in rows],
        )  # fmt: skip
        title = f"{name} (no correlation)" if rho is None else f"{name} (rho {rho:z.2f}{within})"
        panels.append(
            Panel([marks], "mean opinion (1-10)", name, title, range_=(LEAST - 0.5, MOST + 0.5))
        )
    return panels


def write_opinion(opinion: Opinion, run: Path, page: Path) -> None:
    """Keep the comparison in the run's folder, whose report shows it from then on, and draw it as a
    page.
    """
    (run / OPINION).write_text(json.dumps(opinion_json(opinion), indent=2) + "\n", encoding="utf-8")
    title = "People's opinion and the scores"
    write_study(
        page, kicker=run.name, title=title, sentences=(),
        figures={title: on_page(opinion_panels(run), 4, 700)},
        least_width=1000,
    )  # fmt: skip


def _interval(found: Agreement) -> str:
    ends = rank_interval(found.value, found.n)
    return "" if ends is None else f" [{ends[0]:z.2f}, {ends[1]:z.2f}]"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:z.3f}"
