"""`sumo-eval humans`: recorded driving in, what is in it, and what it says about the synthetic drivers."""

from __future__ import annotations

import json
from pathlib import Path

import click

from sumo_eval.cli.progress import Progress


@click.group()
def humans() -> None:
    """Recorded human driving: import it, look for events, weigh scenarios, check the synthetic population."""


@humans.command("import")
@click.argument("form", metavar="FORMAT")
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Table to write: .csv or .csv.gz.")
def import_(form: str, paths: tuple[Path, ...], out: Path) -> None:
    """Import files or folders of FORMAT into one canonical table.

    FORMAT: highd, ind, exid, round, unid, ngsim, commonroad, sumo_fcd, openacc, dlr_highway, csv.
    """
    from sumo_eval.drivers.recorded.importing import import_recordings
    from sumo_eval.drivers.recorded.recordings import write_csv

    recordings = import_recordings(form, paths)
    write_csv(recordings, out)
    for note in recordings.notes:
        click.echo(note)
    click.echo(f"{recordings.vehicles} vehicles, {len(recordings.table)} samples: {out}")


@humans.command()
@click.argument("tables", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the event tables.")
def events(tables: tuple[Path, ...], out: Path | None) -> None:
    """Find approaches, cut-outs, cut-ins and braking leaders in imported TABLES."""
    from sumo_eval.drivers.recorded.events import extract_events, write_events
    from sumo_eval.drivers.recorded.importing import OWN, import_recordings

    found = extract_events(import_recordings(OWN, tables))
    if out is not None:
        write_events(found, out)
    for sentence in found.sentences():
        click.echo(sentence)


@humans.command()
@click.argument("scenario")
@click.argument("tables", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--bandwidth", type=click.Choice(["scott", "cross_validated"]), default="scott", show_default=True)
def exposure(scenario: str, tables: tuple[Path, ...], bandwidth: str) -> None:
    """How often the concrete scenarios of SCENARIO are met in imported TABLES."""
    from sumo_eval.drivers.recorded.exposure import exposure_of
    from sumo_eval.scenario import catalogue
    from sumo_eval.settings import DriverSettings, ExposureSettings

    settings = ExposureSettings("recorded", tuple(map(str, tables)), bandwidth)  # type: ignore[arg-type]
    found = exposure_of(catalogue.find(scenario, Path.cwd()), settings, DriverSettings(), Path.cwd())
    click.echo(f"{scenario}: {found.about}.")


@humans.command()
@click.argument("tables", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--drivers", type=click.IntRange(min=10), default=200, show_default=True, help="Synthetic drivers.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="CSV file for the table.")
def population(tables: tuple[Path, ...], drivers: int, seed: int, out: Path | None) -> None:
    """Compare the synthetic population with the people in imported TABLES."""
    from sumo_eval.drivers.recorded.events import extract_events
    from sumo_eval.drivers.recorded.importing import OWN, import_recordings
    from sumo_eval.drivers.recorded.population_check import compare_population
    from sumo_eval.studies.tables import comparison_lines, write_rows

    found = extract_events(import_recordings(OWN, tables))
    with Progress() as progress:
        rows = compare_population(
            found, drivers=drivers, seed=seed, progress=lambda done, total: progress("synthetic drivers", done, total)
        )
    for line in comparison_lines(rows):
        click.echo(line)
    if out is not None:
        write_rows(rows, out)


@humans.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("ratings", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="HTML file for the plot (default: RUN/opinion.html).")
def opinion(run: Path, ratings: Path, out: Path | None) -> None:
    """Compare the scores of RUN with what people said: RATINGS, a CSV file with rater, ads, scenario, score (1-10)."""
    from sumo_eval.evaluation import score
    from sumo_eval.report.opinion_section import OPINION
    from sumo_eval.studies.opinion import (
        compare_opinion,
        opinion_json,
        opinion_lines,
        read_ratings,
        write_opinion_plot,
    )

    given = read_ratings(ratings)
    with Progress() as progress:
        evaluation = score(run, progress=progress)
    result = compare_opinion(evaluation, given)
    for line in opinion_lines(result):
        click.echo(line)
    place = run / "opinion.html" if out is None else out
    write_opinion_plot(result, place)
    click.echo(f"Plot: {place}")
    (run / OPINION).write_text(json.dumps(opinion_json(result), indent=2) + "\n", encoding="utf-8")
    click.echo(f"`sumo-eval report {run}` shows it in the report from now on.")


@humans.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="CSV file for the table (default: RUN/similarity.csv).")
def similarity(run: Path, out: Path | None) -> None:
    """Dynamic time warping and longest common subsequence beside every D_i of RUN (needs the extra `similarity`)."""
    from sumo_eval.evaluation import score
    from sumo_eval.studies.similarity import similarity_lines, similarity_rows
    from sumo_eval.studies.tables import write_rows

    with Progress() as progress:
        evaluation = score(run, progress=progress)
        rows = similarity_rows(evaluation, progress)
    place = run / "similarity.csv" if out is None else out
    write_rows(rows, place)
    for line in similarity_lines(rows):
        click.echo(line)
    click.echo(f"Table: {place}")
