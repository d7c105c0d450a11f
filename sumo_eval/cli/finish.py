"""Last step of scoring commands: files for people and machines, the table, the exit status.

Users: `cli/compare.py`, `cli/look.py`, `cli/run.py`, `extras/rates/people_command.py`.
"""

from __future__ import annotations

import shutil
import sys
from typing import TYPE_CHECKING, NoReturn

from sumo_eval.cli.exit_status import DONE, GATE_FAILED, NOT_EVALUATED
from sumo_eval.cli.options import flag
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import say, show, tell

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sumo_eval.results import Evaluation
    from sumo_eval.scenario.resolved import Resolved


ALL = flag(
    "--all",
    "everything",
    help="Print every number: C, D, all counts and intervals, in more tables.",
)
"""The option of every command that prints scores."""


def scored(run: Path, changes: Sequence[str] = (), resolved: Resolved | None = None) -> Evaluation:
    """A run, scored; the terminal shows the progress.

    changes, resolved: as in `score`.
    """
    from sumo_eval.evaluation import score

    with Progress() as progress:
        return score(run, changes, progress=progress, resolved=resolved)


def show_scores(evaluation: Evaluation, everything: bool = False) -> None:
    """Print the headline and the table, as wide as the terminal; without one, 100 characters."""
    from sumo_eval.report.citation import citation
    from sumo_eval.report.headline import headline
    from sumo_eval.report.score_table import LEGEND, WIDTH, score_lines

    first_words = headline(evaluation)
    say(f"{question}: {answer}" for question, answer in first_words.answers)
    say((f"! {ads}: {words}." for ads, words in first_words.alarms), fg="red")
    width = shutil.get_terminal_size((WIDTH, 24)).columns
    show(("", *score_lines(evaluation, width, everything), ""))
    say((LEGEND, citation(evaluation)))


def finish(
    evaluation: Evaluation, notes: Sequence[str] = (), *, everything: bool = False
) -> NoReturn:
    """Write report and result files, print the tables, and exit with the status of the cases.

    notes: sentences to print before the line that names the report.
    everything: whether to print all tables.
    """
    from sumo_eval.report.assessed import write_assessed_report
    from sumo_eval.report.junit import write_results
    from sumo_eval.report.terminal import closing_lines

    write_results(evaluation)
    with Progress() as progress:
        report = write_assessed_report(evaluation, progress=progress)
    show_scores(evaluation, everything)
    say((*closing_lines(evaluation), *notes, f"The report is {report}"))
    leave(evaluation, DONE)


def leave(evaluation: Evaluation, status: int) -> NoReturn:
    """Exit with a status: `status` unless it is `DONE`, else that of cases that could not be
    evaluated. `run.incomplete = "gate"` makes such cases a failed gate.
    """
    if evaluation.not_evaluated and evaluation.settings.run.incomplete == "gate":
        tell("The gate failed: `run.incomplete` allows no case that could not be evaluated.")
        sys.exit(GATE_FAILED)
    sys.exit(status or (NOT_EVALUATED if evaluation.not_evaluated else DONE))
