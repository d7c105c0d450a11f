"""Commands for recorded drivers (`humans`), and for constants of a scored run.

`calibrate` chooses k5 and k6; `sensitivity` changes the other constants and scores again.
"""

import shlex
from pathlib import Path

import click

from sumo_eval.cli.finish import scored
from sumo_eval.cli.options import RUN, path_argument, path_option
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import WHOLE, say, tell
from sumo_eval.errors import must_be


@click.group(epilog="Example: sumo-eval humans import highd recordings --out people.csv.gz")
def humans() -> None:
    """Recorded human driving: import it, look for events, weigh scenarios; people's opinions."""


@humans.command(
    "import", epilog="Example: sumo-eval humans import highd recordings --out people.csv.gz"
)
@click.argument("form", metavar="FORMAT")
@path_argument("paths", nargs=-1, required=True)
@path_option("--out", required=True, help="Table to write: .csv or .csv.gz.")
def import_(form: str, paths: tuple[Path, ...], out: Path) -> None:
    """Import files or folders of FORMAT into one canonical table.

    FORMAT: highd, ind, exid, round, unid, ngsim, commonroad, sumo_fcd, openacc, dlr_highway, osi,
    map, csv.
    """
    from sumo_eval.drivers.recorded.importing import import_recordings
    from sumo_eval.drivers.recorded.recordings import write_csv

    if not out.name.endswith((".csv", ".csv.gz")):
        raise must_be("`--out`", "import", "a file that ends with .csv or .csv.gz", str(out))
    recordings = import_recordings(form, paths)
    write_csv(recordings, out)
    say(recordings.notes)
    tell(f"{recordings.vehicles} vehicles, {len(recordings.table)} samples: {out}")


@humans.command(epilog="Example: sumo-eval humans events people.csv.gz --out events")
@path_argument("tables", nargs=-1, required=True)
@path_option("--out", help="Folder for the event tables.")
def events(tables: tuple[Path, ...], out: Path | None) -> None:
    """Find approaches, cut-outs, cut-ins and braking leads in imported TABLES."""
    from sumo_eval.drivers.recorded.events import extract_events, write_events
    from sumo_eval.drivers.recorded.importing import OWN, import_recordings

    recordings = import_recordings(OWN, tables)
    extracted = extract_events(recordings)
    if out is not None:
        write_events(extracted, out)
    say((*recordings.notes, *extracted.sentences()))


@humans.command(epilog="Example: sumo-eval humans exposure cut_in people.csv.gz")
@click.argument("scenario")
@path_argument("tables", nargs=-1, required=True)
@click.option(
    "--bandwidth",
    type=click.Choice(["scott", "cross_validated"]),
    default="scott",
    show_default=True,
)
def exposure(scenario: str, tables: tuple[Path, ...], bandwidth: str) -> None:
    """Exposure of the concrete scenarios of SCENARIO in imported TABLES."""
    from sumo_eval.drivers.recorded.exposure import exposure_of
    from sumo_eval.drivers.recorded.reference import notes_of, open_people
    from sumo_eval.scenario import catalogue
    from sumo_eval.settings import DriverSettings, ExposureSettings

    logical = catalogue.find(scenario, Path.cwd())
    drivers = DriverSettings(recordings=tuple(map(str, tables)))
    settings = ExposureSettings("recorded", bandwidth=bandwidth)  # type: ignore[arg-type]
    # notes first, because the exposure may be refused; it gets the recordings read here
    say(notes_of(open_people(drivers, Path.cwd()), {}))
    tell(f"{scenario}: {exposure_of(logical, settings, drivers, Path.cwd()).about}.")


@humans.command(
    epilog="Example: sumo-eval humans scene people.csv.gz --ego 17 --react IDM --out scene.toml"
)
@path_argument("tables", nargs=-1, required=True)
@click.option("--ego", required=True, metavar="VEHICLE", help="The one that an ADS replaces.")
@click.option("--recording", metavar="NAME", help="Which one, where the tables hold several.")
@click.option(
    "--begin",
    type=float,
    help="Begin of the scene, s of the recording (default: the vehicle's own).",
)
@click.option("--end", type=float, help="End of the scene, s (default: 30 s after its start).")
@click.option(
    "--react",
    type=click.Choice(["IDM", "EIDM", "Krauss"]),
    help="SUMO's model by which actors react.",
)
@click.option(
    "--beyond",
    type=float,
    default=2.0,
    show_default=True,
    metavar="M",
    help="Distance of the ego from the recorded one beyond which actors react.",
)
@path_option("--out", required=True, help="Scenario file to write: .toml.")
def scene(
    tables: tuple[Path, ...],
    ego: str,
    recording: str | None,
    begin: float | None,
    end: float | None,
    react: str | None,
    beyond: float,
    out: Path,
) -> None:
    """A scene of imported TABLES as a scenario file: an ADS replaces VEHICLE, the rest drive as
    recorded.
    """
    from sumo_eval.drivers.recorded.importing import OWN, import_recordings
    from sumo_eval.extras.rates.recorded_scene import ROAD_AS_WRITTEN, write_scene
    from sumo_eval.report.words import count

    recordings = import_recordings(OWN, tables)
    say(recordings.notes)
    written = write_scene(recordings, out, ego, recording, (begin, end), react, beyond)
    mean, most = written.error
    tell(
        f"{count(written.others, 'vehicle')} around {ego} for {written.seconds:z.1f} s; in the "
        f"file they are {mean:z.3f} m (root mean square; at most {most:z.2f} m) from where they "
        "were recorded."
    )
    if written.continued:
        tell(
            f"{written.continued} of them were not recorded throughout: before and after, they "
            "keep speed and lane."
        )
    for reason, number in written.left_out.items():
        tell(f"Left out: {count(number, 'vehicle')}, {reason}.")
    tell(ROAD_AS_WRITTEN)
    tell(f"Scene: {out}")


@humans.command(epilog="Example: sumo-eval humans departure results/scene")
@RUN
@path_option("--out", help="HTML file for the page (default: RUN/departure.html).")
def departure(run: Path, out: Path | None) -> None:
    """Distance of the ADSs of RUN from the vehicle that was recorded in their place."""
    from sumo_eval.extras.rates.departures import PAGE, write_departures

    path = run / PAGE if out is None else out
    say(write_departures(run, path))
    tell(f"Page: {path}")


@humans.command(epilog="Example: sumo-eval humans opinion results/first ratings.csv")
@RUN
@path_argument("ratings")
@path_option("--out", help="HTML file for the plot (default: RUN/opinion.html).")
def opinion(run: Path, ratings: Path, out: Path | None) -> None:
    """Compare the scores of RUN with ratings by people: RATINGS, a CSV file with rater, ads,
    scenario, score (1-10).
    """
    from sumo_eval.extras.studies.opinion import (
        compare_opinion,
        opinion_lines,
        read_ratings,
        write_opinion,
    )

    table = read_ratings(ratings)  # before the run is scored, which takes longer
    result = compare_opinion(scored(run), table)
    say(opinion_lines(result))
    path = run / "opinion.html" if out is None else out
    write_opinion(result, run, path)  # the page, and `opinion.json` in the run
    tell(f"Plot: {path}")
    tell(f"`sumo-eval report {shlex.quote(str(run))}` shows it in the report from now on.")


# the whole first sentence: in the help of the group click would cut a long one
for command in humans.commands.values():
    command.short_help = command.get_short_help_str(WHOLE)


@click.command(epilog="Example: sumo-eval calibrate results/first results/second --by median")
@path_argument("runs", nargs=-1, required=True)
@click.option(
    "--by",
    type=click.Choice(["median", "mean"]),
    default="median",
    show_default=True,
    help="Middle ADS.",
)
def calibrate(runs: tuple[Path, ...], by: str) -> None:
    """Choose k5 and k6 so that the middle one of the ADSs in RUNS gets half of the points."""
    from sumo_eval.extras.studies.calibration import calibrate as choose_constants
    from sumo_eval.extras.studies.calibration import calibration_lines

    say(calibration_lines(choose_constants([scored(run) for run in runs], by=by)))


@click.command(epilog="Example: sumo-eval sensitivity results/first --constant k2")
@RUN
@click.option(
    "--constant",
    "constants",
    multiple=True,
    help="k1, k2, k3, k4, centre floor, field floor, a; default: all that can move a score.",
)
def sensitivity(run: Path, constants: tuple[str, ...]) -> None:
    """Score RUN again with k1..k4, the deviation floors and a (b = 100 - a) changed; a table and a
    plot in RUN.
    """
    from sumo_eval.extras.studies.sensitivity import sensitivity as score_again
    from sumo_eval.extras.studies.sensitivity import (
        sensitivity_lines,
        write_rows,
        write_sensitivity_plot,
    )
    from sumo_eval.record.run_folder import read_settings

    with Progress() as progress:
        rows = score_again(run, progress, constants=constants)
    say(sensitivity_lines(rows, constants, read_settings(run)))
    write_rows(rows, run / "sensitivity.csv")
    write_sensitivity_plot(rows, run / "sensitivity.html")
    tell(f"Table and plot: {run / 'sensitivity.csv'}, {run / 'sensitivity.html'}")
