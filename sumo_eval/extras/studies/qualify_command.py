"""Qualification of the tool itself: `qualify`."""

import sys
from pathlib import Path

import click

from sumo_eval.cli import out_folder
from sumo_eval.cli.exit_status import DONE, GATE_FAILED
from sumo_eval.cli.options import path_option
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import say


@click.command(epilog="Example: sumo-eval qualify --out qualification")
@path_option(
    "--out", default=Path("qualification"), show_default=True,
    help="Folder for qualification.html and qualification.json.",
)  # fmt: skip
def qualify(out: Path) -> None:
    """Verify this installation: known answers, found again on this machine, in some minutes.

    Exit status: 0 every check passed, 1 one failed.
    """
    from sumo_eval.extras.studies.qualification import qualified, table

    out_folder.ready(out)
    with Progress() as progress:
        qualification = qualified.qualify(table.all_checks(), progress)
    written = qualified.write_qualification(qualification, out)
    say(qualified.lines(qualification))
    say(map(str, written))
    sys.exit(GATE_FAILED if qualification.failed else DONE)
