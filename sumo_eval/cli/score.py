"""`sumo-eval score`: score a run again from its facts."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.cli.finish import finish
from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="e.g. method.score.a=60; may be repeated.")
def score(run: Path, changes: tuple[str, ...]) -> None:
    """Score RUN again from its recorded facts, without a simulation."""
    from sumo_eval.record.children import warm_up

    warm_up()  # before the imports below, which take a second
    from sumo_eval.evaluation import score as score_run

    with Progress() as progress:
        result = score_run(run, changes, progress=progress)
    finish(result)
