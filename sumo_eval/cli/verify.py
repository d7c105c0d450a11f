"""`sumo-eval verify`: is a run still what the same configuration gives?"""

from __future__ import annotations

import sys
from pathlib import Path

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED
from sumo_eval.cli.progress import Progress

_MOST_LISTED = 20


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--share", type=click.FloatRange(0.0, 1.0, min_open=True), default=0.1, show_default=True,
              help="Share of the drives that is simulated again.")  # fmt: skip
@click.option("--workers", type=click.IntRange(min=1), help="Processes that simulate (default: as in the run).")
def verify(run: Path, share: float, workers: int | None) -> None:
    """Simulate a share of RUN again, chosen by its seed. Exit status 1 when any drive differs in a single bit."""
    from sumo_eval.record.facts import verify as simulate_again

    with Progress() as progress:
        drives, differences = simulate_again(run, share, workers=workers, progress=progress)
    for sentence in differences[:_MOST_LISTED]:
        click.echo(sentence)
    if len(differences) > _MOST_LISTED:
        click.echo(f"and {len(differences) - _MOST_LISTED} more.")
    if differences:
        click.echo(f"{len(differences)} of {drives} drives of {run} are not what they were.")
        sys.exit(GATE_FAILED)
    click.echo(f"{drives} drives of {run} simulated again, all the same to the bit.")
    sys.exit(DONE)
