"""What every scoring command does last: files for people and machines, the table, the exit status."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, NoReturn

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED, NOT_EVALUATED
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import say, tell

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sumo_eval.results import Evaluation


def show_table(evaluation: Evaluation) -> None:
    """Print the scores: on a terminal as tables that fit it, elsewhere as one row an ADS and scenario."""
    from sumo_eval.report.terminal import plain_table, score_table

    if sys.stdout.isatty():
        from rich.console import Console

        console = Console()
        console.print(score_table(evaluation, console.width))
    else:
        click.echo(plain_table(evaluation))


def finish(evaluation: Evaluation, notes: Sequence[str] = ()) -> NoReturn:
    """Write what a person and a machine read, print the table, and leave with the status that the cases deserve.

    notes: sentences that stand before where the report is.
    """
    from sumo_eval.report.assessed import write_assessed_report
    from sumo_eval.report.junit import write_results
    from sumo_eval.report.terminal import closing_lines

    write_results(evaluation)
    with Progress() as progress:
        write_assessed_report(evaluation, progress=progress)
    show_table(evaluation)
    *closing, where = closing_lines(evaluation)
    say((*closing, *notes, where))
    if not evaluation.not_evaluated:
        sys.exit(DONE)
    if evaluation.settings.run.incomplete == "gate":
        tell("The gate failed: `run.incomplete` allows no case that could not be evaluated.")
        sys.exit(GATE_FAILED)
    sys.exit(NOT_EVALUATED)
