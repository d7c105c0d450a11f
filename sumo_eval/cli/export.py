"""`sumo-eval export`: a run as tables for other tools, or one of its cases as files that stand alone."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("case", required=False)
@click.option("--format", "kind", type=click.Choice(("csv", "parquet")), help="Of the tables (default: csv).")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for the files.")
def export(run: Path, case: str | None, kind: str | None, out: Path) -> None:
    """Write the cases, all drives and all trajectories of RUN as tables; with CASE, that case as a SUMO configuration,
    as OpenSCENARIO, and as an evaluation that drives it again.
    """
    if case is None:
        from sumo_eval.record.exchange import export as write

        for path in write(run, out, kind or "csv"):
            click.echo(str(path))
        return
    if kind is not None:
        raise click.UsageError("`--format` is for the tables of a whole run; a case has its own kinds of files.")
    from sumo_eval.report.export_case import export_case

    exported = export_case(run, case, out)
    for path in exported.paths:
        click.echo(str(path))
    click.echo(f"Drive it again, in that folder: {exported.line}")
