"""`drive` opens the browser for one drive or a whole study, and repeats tapes."""

from __future__ import annotations

import asyncio
import shlex
import sys
from pathlib import Path
from typing import Any

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED
from sumo_eval.cli.named_values import named_values
from sumo_eval.cli.options import flag, path_option
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import open_in_browser, say, tell


@click.command(
    epilog="Example: sumo-eval drive front_vehicle_cut_out --set ego_speed=25 --set gap=60"
)
@click.argument("what", metavar="SCENARIO|STUDY.toml|TAPE.jsonl")
@click.option(
    "--set", "values", multiple=True, metavar="NAME=VALUE", help="A parameter (default: mid-range)."
)
@click.option(
    "--rate", type=int, default=50, show_default=True, help="Steps a second: 20, 50 or 100."
)
@path_option("--out", default=Path("drives"), show_default=True, help="Folder.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=8765,
    show_default=True,
    help="Of 127.0.0.1; 0: any.",
)
@flag("--collect", help="Of a study: rewrite its folder from the recordings; no browser.")
@flag("--no-browser", help="Print the address and open nothing.")
def drive(
    what: str,
    values: tuple[str, ...],
    rate: int,
    out: Path,
    port: int,
    collect: bool,
    no_browser: bool,
) -> None:
    """Drive SCENARIO yourself, in 3-D, in the browser; or run a STUDY with participants (extra
    `drive`).

    A study writes the folder that `[drivers] cases` takes, ratings for `humans opinion`, and an
    evaluation that replaces the drivers with its participants. A TAPE, the record of a drive, is
    repeated and compared with its result, byte by byte: exit status 1 where they differ.
    """
    from sumo_eval.scenario.catalogue import find, is_file
    from sumo_eval.settings.toml_file import read_toml

    file = Path(what)
    if what.endswith(".jsonl"):
        from sumo_eval.extras.wheel.tape import again

        repetition = again(file)
        tell(repetition.sentence)
        sys.exit(GATE_FAILED if repetition.same is False else DONE)
    from sumo_eval.extras.wheel.trip import concrete_of, opened, settings_at, trips

    is_study = what.endswith(".toml") and "consent" in read_toml(file, "file")
    if collect:
        if not is_study:
            raise click.UsageError("`--collect` is for a study file, one with a `consent`.")
        _collect(file)
        return

    from sumo_eval.record.loops import PLAYED, WORLD, ready

    with Progress() as progress:
        ready((WORLD, PLAYED), progress)  # in a thread of the window's, Ctrl-C would wait for it

    def show(address: str) -> None:
        tell(f"Drive here, on this machine only: {address}")
        if not no_browser:
            open_in_browser(address)

    if is_study:
        from sumo_eval.extras.wheel.plan import read_study
        from sumo_eval.extras.wheel.study import study

        plan = read_study(file)
        settings_at(plan.settings.rate)
        try:
            asyncio.run(opened("Drive", port, lambda window: study(window, plan, click.echo), show))
        finally:
            _collect(file)
        return
    logical = find(what, Path.cwd())
    concrete, settings = concrete_of(logical, named_values(values, "--set")), settings_at(rate)
    use = str(file.resolve()) if is_file(what) else what
    title = f"Drive {logical.name}"

    def work(window: Any) -> Any:
        return trips(window, logical, concrete, settings, out, use)

    asyncio.run(opened(title, port, work, show))


def _collect(path: Path) -> None:
    """Write the results of a study."""
    from sumo_eval.extras.wheel.outcome import collect
    from sumo_eval.extras.wheel.plan import read_study

    result = collect(read_study(path))
    say(result.sentences())
    say(map(str, result.files))
    tell(
        f"Score with these people: sumo-eval run {shlex.quote(str(result.files[-1]))} --out RUN; "
        f"sumo-eval humans opinion RUN {shlex.quote(str(result.files[1]))}"
    )
