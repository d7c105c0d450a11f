"""`sumo-eval run`: simulate and score an evaluation."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.commands.finish import finish
from sumo_eval.commands.progress import Progress


@click.command()
@click.argument("evaluation", required=False, type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="New folder for facts, scores and report.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes that simulate cases (default: as in the file).")
@click.option(
    "--ads", multiple=True, metavar="LOCATOR", help="An ADS in place of the file's, e.g. my_ads.py:MyAds; repeatable."
)
def run(evaluation: Path | None, out: Path, workers: int | None, ads: tuple[str, ...]) -> None:
    """Simulate and score EVALUATION, a TOML file; without one, the paper's evaluation."""
    from sumo_eval.evaluation import evaluate

    with Progress() as progress:
        result = evaluate(evaluation, out, workers=workers, ads=ads, progress=progress)
    finish(result)
