"""`sumo-eval drive` opens the browser for one drive or a whole study, and repeats tapes."""

import asyncio
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED
from sumo_eval.cli.named_values import named_values
from sumo_eval.cli.options import flag, path_option
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import open_in_browser, say, tell
from sumo_eval.errors import InputError

PORT = 8765  # always the same, so that the browser remembers a wheel's calibration


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
    default=PORT,
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
    if what.endswith(".toml") and "consent" in read_toml(file, "file"):
        _run_study(file, port, collect, no_browser)
        return
    if collect:
        raise click.UsageError("`--collect` is for a study file, one with a `consent`.")
    from sumo_eval.extras.wheel.trip import concrete_of, settings_at, trips

    logical = find(what, Path.cwd())
    concrete = concrete_of(logical, named_values(values, "--set"))
    settings = settings_at(rate)
    use = str(file.absolute()) if is_file(what) else what
    _open(
        f"Drive {logical.name}",
        port,
        lambda window: trips(window, logical, concrete, settings, out, use),
        no_browser,
    )


def _run_study(file: Path, port: int, collect: bool, no_browser: bool) -> None:
    """Hold a session of a study, and write the study's results; with `collect` only the results."""
    from sumo_eval.extras.wheel import outcome
    from sumo_eval.extras.wheel.plan import read_study
    from sumo_eval.extras.wheel.study import study

    plan = read_study(file)
    try:
        if not collect:
            _open("Drive", port, lambda window: study(window, plan, click.echo), no_browser)
    finally:
        result = outcome.collect(plan)
        say(result.sentences())
        say(map(str, result.files))
        tell(
            f"Score with these people: sumo-eval run {shlex.quote(str(result.files[-1]))} --out "
            f"RUN; sumo-eval humans opinion RUN {shlex.quote(str(result.files[1]))}"
        )


def _open(title: str, port: int, work: Callable[[Any], Any], no_browser: bool) -> None:
    """Open a window, and keep it open while `work` uses it.

    work: coroutine function that receives the window.
    """
    from sumo_eval.extras.wheel.page import page
    from sumo_eval.extras.wheel.window import Window
    from sumo_eval.record.loops import PLAYED, WORLD, ready

    with Progress() as progress:
        # compiled here, because Ctrl-C cannot interrupt the thread in which the window drives
        ready((WORLD, PLAYED), progress)
    try:
        window = Window(page(title), port=port)
    except InputError:
        if port != PORT:
            raise
        window = Window(page(title))  # another program uses the usual port: take any free one

    async def session() -> None:
        async with window:
            tell(f"Drive here, on this machine only: {window.address}")
            # in a thread: a browser's command may end only after the page has come from `window`
            opening = [] if no_browser else [asyncio.to_thread(open_in_browser, window.address)]
            await asyncio.gather(work(window), *opening)
            await asyncio.sleep(0.3)  # s in which the browser receives the last view

    asyncio.run(session())
