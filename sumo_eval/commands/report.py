"""`sumo-eval report`: write the HTML report anew."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.commands.progress import Progress


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
def report(run: Path) -> None:
    """Write RUN/report.html anew from the recorded facts."""
    from sumo_eval.confidence.assessment import assess
    from sumo_eval.evaluation import score as score_run
    from sumo_eval.evaluation import zone_partitions
    from sumo_eval.report.confidence_section import write_confidence
    from sumo_eval.report.html import write_report
    from sumo_eval.report.sections import Beside

    with Progress() as progress:
        evaluation = score_run(run, progress=progress)
    partitions = zone_partitions(evaluation)
    confidence = assess(evaluation, partitions)
    write_confidence(confidence, evaluation.folder)
    click.echo(str(write_report(evaluation, partitions, Beside(confidence=confidence))))
