"""Ratings of the ADSs by people, compared with the scores (the paper's Fig. 11)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.importers.tables import checked_numbers, line_of_row, read_table
from sumo_eval.errors import InputError, unknown
from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.extras.studies.tables import aligned
from sumo_eval.method.agreement import Agreement, concordance, rank_correlation, rank_interval
from sumo_eval.report.opinion_section import OPINION, opinion_content
from sumo_eval.report.study_page import write_study
from sumo_eval.results import Evaluation
from sumo_eval.scoring.gate_settings import INDEXES

LEAST, MOST = 1.0, 10.0


class RatedScore(NamedTuple):
    """One ADS in one scenario: its mean rating, their deviation and number, and its scores (None:
    not computed).
    """

    ads: str
    scenario: str
    opinion: float
    deviation: float
    raters: int
    scores: Mapping[str, float | None]


class Opinion(NamedTuple):
    """Comparison of ratings and scores.

    rows: one for each rated ADS and scenario.
    correlations: Spearman's rho with each of `INDEXES`; None where fewer than 3 rows have the
        score, or all are alike.
    concordance: Kendall's W between the raters who rated everything; None for fewer than two, or
        where each gave one score to all.
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
    for row in np.flatnonzero(~table["score"].between(LEAST, MOST)).tolist():
        line, got = line_of_row(path, row), table["score"].iloc[row]
        raise InputError(
            f"`score` in row {line} of {path} must be within {LEAST:g}..{MOST:g}, got {got:g}."
        )
    for row in np.flatnonzero(table.duplicated(["rater", "ads", "scenario"])).tolist():
        line = line_of_row(path, row)
        raise InputError(f"Row {line} of {path} rates what its rater has rated in a row above.")
    return table


def compare_opinion(evaluation: Evaluation, ratings: pd.DataFrame) -> Opinion:
    """The ratings beside the scores of a run.

    Raises InputError for an ADS or scenario that the run does not have.
    """
    scores = {(score.ads, score.scenario): score for score in evaluation.scores}
    for column, kind, place in (("ads", "ADS", 0), ("scenario", "scenario", 1)):
        names = list(dict.fromkeys(key[place] for key in scores))
        for name in set(ratings[column]) - set(names):
            raise unknown(kind, name, names)
    rows = []
    for (ads, scenario), group in ratings.groupby(["ads", "scenario"], sort=False):
        score, values = scores[str(ads), str(scenario)], group["score"]
        deviation = float(values.std()) if values.size > 1 else 0.0
        indexes = {name: getattr(score, field) for name, field in INDEXES.items()}
        rows.append(
            RatedScore(str(ads), str(scenario), values.mean(), deviation, values.size, indexes)
        )
    correlations: dict[str, Agreement | None] = {}
    for name in INDEXES:
        pairs = [(row.scores[name], row.opinion) for row in rows if row.scores[name] is not None]
        enough = len(pairs) >= 3
        correlations[name] = _known(rank_correlation(*zip(*pairs, strict=True))) if enough else None
    table = ratings.pivot_table(index="rater", columns=["ads", "scenario"], values="score").dropna()
    enough = min(table.shape) >= 2
    between = _known(concordance(table.to_numpy())) if enough else None
    return Opinion(tuple(rows), correlations, between)


def _known(found: Agreement) -> Agreement | None:
    """An agreement; None where all values are alike, so that there is none."""
    return None if np.isnan(found.value) else found


def opinion_lines(opinion: Opinion) -> list[str]:
    """The comparison in words."""
    table = [("ADS", "scenario", "opinion", "raters", *INDEXES)]
    for row in opinion.rows:
        values = (row.scores[name] for name in INDEXES)
        scores = ("-" if value is None else f"{value:z.3f}" for value in values)
        mean = f"{row.opinion:z.2f} +/- {row.deviation:z.2f}"
        table.append((row.ads, row.scenario, mean, str(row.raters), *scores))
    lines = aligned(table)
    for name, rho in opinion.correlations.items():
        words = "fewer than 3 rated scores, or all alike: no correlation."
        if rho is not None:
            ends = rank_interval(rho.value, rho.n)
            within = "" if ends is None else f" [{ends[0]:z.2f}, {ends[1]:z.2f}]"
            words = (
                f"Spearman's rho {rho.value:z.3f}{within} over {rho.n} rated scores "
                f"(p = {rho.p_value:z.3g})."
            )
        lines.append(f"{name}: {words}")
    between = opinion.concordance
    words = "fewer than two rated everything, or each gave one score to all: no concordance."
    if between is not None:
        words = (
            f"Kendall's W {between.value:z.3f} of {between.n} who rated everything "
            f"(p = {between.p_value:z.3g})."
        )
    return [*lines, f"Raters: {words}"]


def opinion_json(opinion: Opinion) -> dict[str, Any]:
    """The comparison in plain values, as the report of the run shows it."""
    rhos = opinion.correlations.items()
    return {
        "rows": [row._asdict() for row in opinion.rows],
        "correlations": {name: rho.value if rho else None for name, rho in rhos},
        "intervals": {name: rank_interval(rho.value, rho.n) if rho else None for name, rho in rhos},
        "concordance": opinion.concordance.value if opinion.concordance else None,
    }


def opinion_panels(run: Path) -> list[Panel]:
    """A panel for each of `INDEXES`: score against mean opinion, with the raters' deviation, from
    the run's folder.

    Raises InputError without ratings.
    """
    if opinion_content(run) is None:
        raise InputError(
            f"{run} must hold ratings, got none; add them with: sumo-eval humans opinion."
        )
    content = json.loads((run / OPINION).read_text(encoding="utf-8"))
    panels = []
    for name, rho in content["correlations"].items():
        rows = [row for row in content["rows"] if row["scores"][name] is not None]
        ends = content.get("intervals", {}).get(name)
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
    """Write the comparison into the run's folder, whose report shows it, and draw it as a page."""
    (run / OPINION).write_text(json.dumps(opinion_json(opinion), indent=2) + "\n", encoding="utf-8")
    title = "People's opinion and the scores"
    write_study(
        page, kicker=run.name, title=title, sentences=(),
        figures={title: on_page(opinion_panels(run), 4, 700)},
        least_width=1000,
    )  # fmt: skip
