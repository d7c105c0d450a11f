"""Scenarios of other tools and use cases: what is understood of a file."""

from __future__ import annotations

from pathlib import Path

import click

from sumo_eval.cli.named_values import named_values
from sumo_eval.cli.sentences import say, tell


@click.command("import", epilog="Example: sumo-eval import CCRm.xosc")
@click.argument("file", required=False)
@click.option("--folder", type=click.Path(), help="Of a catalogue (osc_alks, ncap_2026, autoware): where your copy is.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Write the scenario file (.toml) that was understood: its whole space.",
)
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="With --out: hold a parameter at a value.")
@click.option("--conformity", is_flag=True, help="List what of OpenSCENARIO plays, is ignored and is refused.")
@click.option("--steps", is_flag=True, help="List the sentences of use cases that are understood.")
def import_(
    file: str | None, folder: str | None, out: Path | None, values: tuple[str, ...], conformity: bool, steps: bool
) -> None:
    """Say what is understood of FILE, and what does not play.

    FILE: an OpenSCENARIO scenario or variation (.xosc), or a use case as a Gherkin table (.feature.md, .feature).

    Of a catalogue (osc_alks, ncap_2026, autoware): its files, the points of each and how many play.

    `use = "FILE.xosc"` in an evaluation plays it. Exit status 2 where nothing of it plays.
    """
    from sumo_eval.errors import InputError, did_you_mean
    from sumo_eval.scenario.catalogue import options_of
    from sumo_eval.scenario.openscenario.collections import COLLECTIONS
    from sumo_eval.scenario.openscenario.conformity import table
    from sumo_eval.scenario.openscenario.describe import described, listed
    from sumo_eval.scenario.openscenario.logical import read_file
    from sumo_eval.scenario.openscenario.written import write_scenario
    from sumo_eval.scenario.openscenario.written_space import space_contents
    from sumo_eval.scenario.usecase import describe as use_cases
    from sumo_eval.scenario.usecase.logical import ENDINGS, read_use_case

    if conformity:
        click.echo(table())
    if steps:
        say(use_cases.sentences())
    if file is None:
        if not conformity and not steps:
            raise click.UsageError("Missing argument 'FILE'.")
        return
    plain, given = options_of(file)
    use_case = read = None
    if plain in COLLECTIONS:
        files = COLLECTIONS[plain].files(Path(folder or "."))
        gherkin = files[0].name.endswith(ENDINGS)
        lines = use_cases.listed(plain, files) if gherkin else listed(plain, files)
    elif plain.endswith(ENDINGS):
        use_case = read_use_case(Path(plain), given)
        lines = use_cases.described(use_case)
    elif plain.endswith(".xosc"):
        read = read_file(Path(plain), given)
        lines = described(read)
    else:
        near = did_you_mean(plain, COLLECTIONS)
        raise InputError(
            f"`import` reads OpenSCENARIO files (.xosc), use cases (.feature.md) and catalogues, got {plain}.{near}"
        )
    say(lines)
    if out is None:
        return
    if use_case is not None:
        write_scenario(use_case.table, out)
    elif read is not None:
        contents = space_contents(read, named_values(values, "--set"))
        for number, content in enumerate(contents, 1):
            written = out if number == 1 else out.with_stem(f"{out.stem}_{number}")
            write_scenario(content, written)
            tell(f"wrote {written}")
        if len(contents) > 1:
            tell(f"{len(contents)} files: the others are not the same bodies or do not move alike at all points")
        return
    else:
        raise InputError(f"`--out` is for one file, got the catalogue {plain}.")
    tell(f"wrote {out}")
