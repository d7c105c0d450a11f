"""Scenarios of other tools: what is understood of a file."""

from pathlib import Path

import click

from sumo_eval.cli.named_values import named_values
from sumo_eval.cli.options import flag, path_option
from sumo_eval.cli.sentences import say, tell


@click.command("import", epilog="Example: sumo-eval import CCRm.xosc")
@click.argument("file", required=False)
@path_option("--folder", help="Of a catalogue (osc_alks, ncap_2026): where your copy is.")
@path_option("--out", help="Write one point of FILE as a scenario file (.toml).")
@click.option(
    "--set",
    "values",
    multiple=True,
    metavar="NAME=VALUE",
    help="With --out: a parameter of the point.",
)
@flag("--conformity", help="List what of OpenSCENARIO plays, is ignored and is refused.")
def import_(
    file: str | None,
    folder: Path | None,
    out: Path | None,
    values: tuple[str, ...],
    conformity: bool,
) -> None:
    """Say what is understood of FILE, and what does not play.

    FILE: an OpenSCENARIO scenario or variation (.xosc), also with options: FILE.xosc?road=2.

    Of a catalogue (osc_alks, ncap_2026): its files, the points of each and how many play.

    `use = "FILE.xosc"` in an evaluation plays it. Exit status 2 where nothing of it plays.
    """
    from sumo_eval.errors import InputError, did_you_mean
    from sumo_eval.extras.openscenario.collections import COLLECTIONS
    from sumo_eval.extras.openscenario.conformity import table
    from sumo_eval.extras.openscenario.describe import described, listed
    from sumo_eval.extras.openscenario.logical import read_file
    from sumo_eval.extras.openscenario.written import scenario_content, write_scenario
    from sumo_eval.gone import refuse_use_case
    from sumo_eval.scenario.catalogue import options_of
    from sumo_eval.text import shown

    if conformity:
        click.echo(table())
    if file is None:
        if not conformity:
            raise click.UsageError("Missing argument 'FILE'.")
        return
    name, options = options_of(file)
    if values and out is None:
        raise click.UsageError("`--set` chooses the point that `--out` writes, got no `--out`.")
    if name in COLLECTIONS:
        if out is not None or options:
            what = "`--out` is" if out is not None else "Options `?` are"
            raise InputError(f"{what} for one file, got the catalogue {name}.")
        say(listed(name, COLLECTIONS[name].files(folder or Path())))
        return
    refuse_use_case(name)  # a removed kind of file gets a message of its own
    if not name.endswith(".xosc"):
        raise InputError(
            f"`import` reads OpenSCENARIO files (.xosc) and catalogues, got {shown(name)}."
            f"{did_you_mean(name, COLLECTIONS)}"
        )
    if folder is not None:
        raise click.UsageError(f"`--folder` is for a catalogue, got the file {name}.")
    read = read_file(Path(name), options)
    say(described(read))
    if out is not None:
        write_scenario(scenario_content(read, named_values(values, "--set")), out)
        tell(f"wrote {out}")
