"""`sumo-eval sensitivity`: how the ranking of the ADSs responds to the open constants."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--constant",
    "constants",
    multiple=True,
    help="k1, k2, k3, k4, centre floor, field floor, a; default: all that can move a score.",
)
def sensitivity(run: Path, constants: tuple[str, ...]) -> None:
    """Score RUN again with k1..k4, the deviation floors and a (b = 100 - a) changed; a table and a plot in RUN."""
    from sumo_eval.record.run_folder import read_settings
    from sumo_eval.studies.sensitivity import sensitivity as respond
    from sumo_eval.studies.sensitivity import sensitivity_lines, without_the_wheel, write_sensitivity_plot
    from sumo_eval.studies.tables import write_rows

    with Progress() as progress:
        rows = respond(run, progress, constants=constants) if constants else respond(run, progress)
    by_wheel = not without_the_wheel(read_settings(run))
    for line in sensitivity_lines(rows, by_wheel=by_wheel):
        click.echo(line)
    write_rows(rows, run / "sensitivity.csv")
    write_sensitivity_plot(rows, run / "sensitivity.html")
    click.echo(f"Table and plot: {run / 'sensitivity.csv'}, {run / 'sensitivity.html'}")
