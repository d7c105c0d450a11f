"""`sumo-eval calibrate`: k5 and k6 from a population of ADSs."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--by", type=click.Choice(["median", "mean"]), default="median", show_default=True, help="Middle ADS.")
def calibrate(runs: tuple[Path, ...], by: str) -> None:
    """Choose k5 and k6 so that the middle one of the ADSs in RUNS gets half of the points."""
    from sumo_eval.evaluation import score
    from sumo_eval.studies.calibration import calibrate as calibrated
    from sumo_eval.studies.calibration import calibration_lines

    with Progress() as progress:
        evaluations = [score(run, progress=progress) for run in runs]
    for line in calibration_lines(calibrated(evaluations, by=by)):
        click.echo(line)
