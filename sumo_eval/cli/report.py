"""`sumo-eval report`: write the HTML report anew."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
def report(run: Path) -> None:
    """Write RUN/report.html anew from the recorded facts."""
    from sumo_eval.evaluation import score as score_run
    from sumo_eval.report.assessed import write_assessed_report

    with Progress() as progress:
        evaluation = score_run(run, progress=progress)
        path = write_assessed_report(evaluation, progress=progress)
    click.echo(str(path))
