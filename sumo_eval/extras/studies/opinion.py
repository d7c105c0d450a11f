"""Ratings of the ADSs by people, compared with the scores as in the paper's Fig. 11.

For `sumo-eval humans opinion`, and for `plot RUN opinion`.

Users: `extras/figures/of_studies.py`, `extras/rates/people_command.py`.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pandas import DataFrame

from sumo_eval.cli.sentences import aligned
from sumo_eval.drivers.recorded.importers.tables import line_of_row, make_numbers, read_table
from sumo_eval.errors import InputError
from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.method.agreement import Agreement, concordance, rank_correlation, rank_interval
from sumo_eval.report.opinion_section import OPINION, opinion_content
from sumo_eval.report.page import Json, write_json
from sumo_eval.report.study_page import write_study
from sumo_eval.results import Evaluation
from sumo_eval.scoring.gate_settings import HIGHER_IS_BETTER

LEAST, MOST = 1.0, 10.0  # of a rating
FEWEST = 3  # pairs of rating and score that have a correlation


class RatedScore(NamedTuple):
    """Ratings and scores of one ADS in one scenario.

    opinion: mean of its ratings, 1..10.
    deviation: standard deviation of its ratings.
    raters: number of its ratings.
    scores: by name, as in `HIGHER_IS_BETTER`; None: not computed.
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
    correlations: score of `HIGHER_IS_BETTER` -> its Spearman's rho with the mean ratings; None
        where fewer than `FEWEST` rows have the score, or where all means or all scores are equal.
    concordance: Kendall's W between the raters who rated all rows; None for fewer than two such
        raters or two rows, or where each of them gave one rating to all.
    """

    rows: tuple[RatedScore, ...]
    correlations: Mapping[str, Agreement | None]
    concordance: Agreement | None


def read_ratings(path: Path) -> DataFrame:
    """Ratings from a CSV file with the columns rater, ads, scenario and score (1-10).

    Raises InputError that names the file and the first wrong row.
    """
    names = ["rater", "ads", "scenario"]
    table = read_table(path, (*names, "score"), dtype=dict.fromkeys(names, str))
    make_numbers(table, ["score"], path)
    outside = np.flatnonzero(~table["score"].between(LEAST, MOST))
    if outside.size:
        line, got = line_of_row(path, outside[0]), table["score"].iloc[outside[0]]
        raise InputError(
            f"`score` in row {line} of {path} must be within {LEAST:g}..{MOST:g}, got {got:g}."
        )
    repeated = np.flatnonzero(table.duplicated(names))
    if repeated.size:
        line = line_of_row(path, repeated[0])
        raise InputError(f"Row {line} of {path} rates what its rater has rated in a row above.")
    return table


def compare_opinion(evaluation: Evaluation, ratings: DataFrame) -> Opinion:
    """Compare ratings, as `read_ratings` gives them, with the scores of a run.

    Raises InputError for an ADS in a scenario that the run has no score of.
    """
    rows = []
    for (ads, scenario), group in ratings.groupby(["ads", "scenario"], sort=False):
        try:
            score = evaluation.score(str(ads), str(scenario))
        except InputError as error:
            raise InputError(f"Rating {group.index[0] + 1} of the file: {error}") from error
        values = group["score"]
        deviation = values.std() if values.size > 1 else 0.0
        scores = {name: getattr(score, field) for name, field in HIGHER_IS_BETTER.items()}
        # Rounded, so that equal ratings in another order have an equal mean, and tie in rank.
        mean = round(values.mean(), 9)
        rows.append(RatedScore(score.ads, score.scenario, mean, deviation, values.size, scores))

    correlations: dict[str, Agreement | None] = {}
    for name in HIGHER_IS_BETTER:
        pairs = [(row.scores[name], row.opinion) for row in rows if row.scores[name] is not None]
        correlations[name] = None
        if len(pairs) >= FEWEST:
            scores_of_all, opinions = zip(*pairs, strict=True)
            correlations[name] = _defined(rank_correlation(scores_of_all, opinions))

    # a row for each rater, a column for each ADS and scenario; without raters who left one out
    table = ratings.pivot_table(index="rater", columns=["ads", "scenario"], values="score").dropna()
    between = None
    if min(table.shape) >= 2:  # `concordance` needs two raters and two items
        between = _defined(concordance(table.to_numpy()))
    return Opinion(tuple(rows), correlations, between)


def _defined(agreement: Agreement) -> Agreement | None:
    """The agreement; None where its coefficient is not defined, because all values are equal."""
    return None if np.isnan(agreement.value) else agreement


def opinion_lines(opinion: Opinion) -> Iterator[str]:
    """The comparison as a table and sentences for a terminal."""
    table = [("ADS", "scenario", "opinion", "raters", *HIGHER_IS_BETTER)]
    for row in opinion.rows:
        values = (row.scores[name] for name in HIGHER_IS_BETTER)
        scores = ("-" if value is None else f"{value:z.3f}" for value in values)
        mean = f"{row.opinion:z.2f} +/- {row.deviation:z.2f}"
        table.append((row.ads, row.scenario, mean, str(row.raters), *scores))
    yield from aligned(table)
    for name, rho in opinion.correlations.items():
        words = f"fewer than {FEWEST} rated scores, or all alike: no correlation."
        if rho is not None:
            ends = rank_interval(rho.value, rho.n)
            within = "" if ends is None else f" [{ends[0]:z.2f}, {ends[1]:z.2f}]"
            words = (
                f"Spearman's rho {rho.value:z.3f}{within} over {rho.n} rated scores "
                f"(p = {rho.p_value:z.3g})."
            )
        yield f"{name}: {words}"
    between = opinion.concordance
    words = "fewer than two rated everything, or each gave one score to all: no concordance."
    if len(opinion.rows) < 2:
        words = "fewer than two rated scores: no concordance."
    if between is not None:
        words = (
            f"Kendall's W {between.value:z.3f} of {between.n} who rated everything "
            f"(p = {between.p_value:z.3g})."
        )
    yield f"Raters: {words}"


def opinion_json(opinion: Opinion) -> Json:
    """The comparison as the content of `opinion.json` in the run's folder."""
    rhos = opinion.correlations.items()
    return {
        "rows": [row._asdict() for row in opinion.rows],
        "correlations": {name: rho.value if rho else None for name, rho in rhos},
        "intervals": {name: rank_interval(rho.value, rho.n) if rho else None for name, rho in rhos},
        "concordance": opinion.concordance.value if opinion.concordance else None,
    }


def opinion_panels(run: Path) -> list[Panel]:
    """A panel for each score of `HIGHER_IS_BETTER`: the score over the mean rating, with the
    deviation of the ratings, from `opinion.json` in the run's folder.

    Raises InputError for a run without ratings.
    """
    content = opinion_content(run)
    if content is None:
        raise InputError(
            f"{run} must hold ratings, got none; add them with: sumo-eval humans opinion."
        )
    panels = []
    for panel in content["panels"]:
        name, rho, ends = panel["name"], panel["rho"], panel["interval"]
        rows = [row for row in content["rows"] if row["scores"][name] is not None]
        within = "" if ends is None else f", {ends[0]:z.2f}..{ends[1]:z.2f}"
        marks = Marks(
            "", [row["opinion"] for row in rows], [row["scores"][name] for row in rows],
            COLOURS[0], marker="o",
            spread=[row["deviation"] for row in rows],
            words=[f"{row['ads']}, {row['scenario']}" for row in rows]
        )  # fmt: skip
        title = f"{name} (no correlation)" if rho is None else f"{name} (rho {rho:z.2f}{within})"
        panels.append(
            Panel([marks], "mean opinion (1-10)", name, title, range_=(LEAST - 0.5, MOST + 0.5))
        )
    return panels


def write_opinion(opinion: Opinion, run: Path, page: Path) -> None:
    """Write the comparison into the run's folder, whose report then shows it, and as a page."""
    write_json(run / OPINION, opinion_json(opinion), "The comparison")
    title = "People's opinion and the scores"
    write_study(
        page, kicker=run.name, title=title, sentences=(),
        figures={title: on_page(opinion_panels(run), 4, 700)},  # 4 in a row, 700 px high
        least_width=1000
    )  # fmt: skip
