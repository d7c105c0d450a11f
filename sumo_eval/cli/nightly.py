"""`sumo-eval nightly`: a night for cron, systemd and continuous integration."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED, NOT_EVALUATED
from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("evaluation", type=click.Path(path_type=Path))
@click.option(
    "--history", required=True, type=click.Path(path_type=Path), help="Folder of the nights and their history."
)
@click.option("--gate", type=click.Path(path_type=Path), help="Limits on changes and values (docs/compare.md).")
@click.option("--keep", type=click.IntRange(min=1), default=14, show_default=True, help="Nights whose folders stay.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes that simulate cases (default: as in the file).")
def nightly(evaluation: Path, history: Path, gate: Path | None, keep: int, workers: int | None) -> None:
    """Evaluate EVALUATION, compare with the last good night, write report, JUnit file and a line of history.

    Exit status: 0 a good night, 1 a gate failed, 2 the input is wrong or a night is running already, 3 some cases could
    not be evaluated.
    """
    from sumo_eval.record.children import warm_up

    warm_up()  # before the imports below, which take a second
    from sumo_eval.nightly.night import run_night
    from sumo_eval.report.gate_settings import read_gate
    from sumo_eval.report.terminal import closing_lines, comparison_lines, gate_lines, plain_table

    settings = read_gate(gate)
    with Progress() as progress:
        result = run_night(
            evaluation, history, settings, keep=keep, workers=workers,
            exit_statuses=(DONE, GATE_FAILED, NOT_EVALUATED), progress=progress,
        )  # fmt: skip
    click.echo(result.night.verdict)
    for note in result.notes:
        click.echo(note)
    click.echo(plain_table(result.evaluation))
    lines = gate_lines(result.gates)
    if result.comparison:
        lines = comparison_lines(result.comparison, result.gates, result.evaluation)[1:]
    for line in (*lines, *closing_lines(result.evaluation)[:-1]):
        click.echo(line)
    click.echo(f"The report is {result.report}")
    click.echo(f"The trend is {result.trend}")
    sys.exit(result.night.exit_status)
