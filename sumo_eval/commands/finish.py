"""What every scoring command does last: files for people and machines, the table, the exit status."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, NoReturn

import click

from sumo_eval.commands.exit_status import DONE, NOT_EVALUATED

if TYPE_CHECKING:
    from sumo_eval.results import Evaluation


def finish(evaluation: Evaluation) -> NoReturn:
    """Write what a person and a machine read, print the table, and leave with the status that the cases deserve."""
    from sumo_eval.confidence.assessment import assess
    from sumo_eval.evaluation import zone_partitions
    from sumo_eval.report.confidence_section import write_confidence
    from sumo_eval.report.html import write_report
    from sumo_eval.report.tables import cases_csv, scores_json
    from sumo_eval.report.terminal import closing_lines, plain_table, score_table

    scores = json.dumps(scores_json(evaluation), indent=2, allow_nan=False)
    (evaluation.folder / "scores.json").write_text(scores + "\n", encoding="utf-8")
    cases_csv(evaluation, evaluation.folder / "cases.csv")
    partitions = zone_partitions(evaluation)
    confidence = assess(evaluation, partitions)
    write_confidence(confidence, evaluation.folder)
    write_report(evaluation, partitions, confidence)
    if sys.stdout.isatty():
        from rich.console import Console

        Console().print(score_table(evaluation))
    else:
        click.echo(plain_table(evaluation))
    for line in closing_lines(evaluation):
        click.echo(line)
    sys.exit(NOT_EVALUATED if evaluation.not_evaluated else DONE)
