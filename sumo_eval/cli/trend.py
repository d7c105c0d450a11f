"""`sumo-eval trend`: how the scores moved over the nights."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("history", type=click.Path(path_type=Path))
@click.option(
    "--import", "runs", multiple=True, type=click.Path(path_type=Path), help="Add an older run first; may be repeated."
)
def trend(history: Path, runs: tuple[Path, ...]) -> None:
    """Write HISTORY/trend.html: S, C, D, risk and run time of every ADS over the nights, with the gates."""
    from sumo_eval.nightly.history import open_history
    from sumo_eval.nightly.night import import_runs
    from sumo_eval.nightly.trend import write_trend

    if runs:
        with Progress() as progress:
            for night in import_runs(history, runs, progress):
                click.echo(f"Added {night.folder} as night {night.night}.")
    with open_history(history) as lines:
        click.echo(str(write_trend(history, lines)))
