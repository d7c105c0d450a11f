"""`sumo-eval export`: a run as tables for other tools."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--format", "kind", type=click.Choice(("csv", "parquet")), default="csv", show_default=True)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for the tables.")
def export(run: Path, kind: str, out: Path) -> None:
    """Write the cases, all drives and all trajectories of RUN as tables."""
    from sumo_eval.exchange import export as write

    for path in write(run, out, kind):
        click.echo(str(path))
