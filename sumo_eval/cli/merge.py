"""`sumo-eval merge`: put the shards of an evaluation together."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.cli.finish import finish
from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("shards", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="New folder for the whole run.")
def merge(shards: tuple[Path, ...], out: Path) -> None:
    """Put SHARDS, the folders of all parts that `run --shard` made, together into one run, and score it."""
    from sumo_eval.evaluation import score
    from sumo_eval.record.facts import merge as put_together

    put_together(shards, out)
    with Progress() as progress:
        result = score(out, progress=progress)
    finish(result)
