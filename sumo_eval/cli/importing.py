"""Scenarios of other tools: what is understood of a file."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("import", epilog="Example: sumo-eval import CCRm.xosc")
@click.argument("file", required=False)
@click.option("--folder", type=click.Path(), help="Of a catalogue (osc_alks, ncap_2026): where your copy is.")
@click.option("--conformity", is_flag=True, help="List what of OpenSCENARIO plays, is ignored and is refused.")
def import_(file: str | None, folder: str | None, conformity: bool) -> None:
    """Say what is understood of FILE, an OpenSCENARIO scenario or variation (.xosc), and what does not play.

    Of a catalogue (osc_alks, ncap_2026): its files, the points of each and how many play.

    `use = "FILE.xosc"` in an evaluation plays it. Exit status 2 where nothing of it plays.
    """
    from sumo_eval.errors import InputError
    from sumo_eval.scenario.catalogue import options_of
    from sumo_eval.scenario.openscenario.collections import COLLECTIONS
    from sumo_eval.scenario.openscenario.conformity import table
    from sumo_eval.scenario.openscenario.describe import described, listed
    from sumo_eval.scenario.openscenario.logical import read_file

    if conformity:
        click.echo(table())
    if file is None:
        if not conformity:
            raise click.UsageError("Missing argument 'FILE'.")
        return
    plain, given = options_of(file)
    if plain in COLLECTIONS:
        for line in listed(plain, Path(folder or ".")):
            click.echo(line)
        return
    if not plain.endswith(".xosc"):
        raise InputError(f"`import` reads OpenSCENARIO files (.xosc), got {plain}.")
    for line in described(read_file(Path(plain), given)):
        click.echo(line)
