"""`sumo-eval explain`: the arithmetic of one case, or the ledger of a run."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("case", required=False)
def explain(run: Path, case: str | None) -> None:
    """Print the whole arithmetic of CASE of RUN, step by step; without CASE, where the points of S+ and S went."""
    from sumo_eval.evaluation import score, zone_partitions
    from sumo_eval.report.explain import explain_case
    from sumo_eval.report.terminal import ledger_lines

    with Progress() as progress:
        evaluation = score(run, progress=progress)
    lines = ledger_lines(evaluation) if case is None else explain_case(evaluation, zone_partitions(evaluation), case)
    for line in lines:
        click.echo(line)
