"""Evaluations: `run` them, `score` them again, `merge` their shards, `verify` that they are
reproduced.
"""

import shlex
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import click

from sumo_eval.cli import out_folder
from sumo_eval.cli.exit_status import DONE, GATE_FAILED, NOT_EVALUATED
from sumo_eval.cli.finish import ALL, finish, scored
from sumo_eval.cli.options import (
    POSITIVE,
    RESUME,
    RUN,
    WORKERS,
    Range,
    count_option,
    flag,
    path_argument,
    path_option,
    trusting,
)
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import say, tell
from sumo_eval.cli.stopping import heard, stop_on_signal
from sumo_eval.cli.tools import refuse_a_bare_file
from sumo_eval.errors import StoppedError
from sumo_eval.text import without_numbers


@click.command(epilog="Example: sumo-eval run evaluation.toml --out results/first --workers 2")
@path_argument("evaluation", required=False)
@path_option("--out", help="New folder for facts, scores and report (default: results/NAME-TIME).")
@WORKERS
@click.option(
    "--ads",
    multiple=True,
    metavar="LOCATOR",
    help="An ADS in place of the file's, e.g. my_ads.py:MyAds; repeatable.",
)
@click.option(
    "--engine",
    type=click.Choice(("processes", "serial", "dask")),
    help="Where cases run (default: the file's, else processes).",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="The Dask scheduler of --engine dask, e.g. tcp://host:8786.",
)
@click.option(
    "--case-timeout",
    type=POSITIVE,
    help="Wall time a case may take, s (default: the file's, else 60).",
)
@click.option(
    "--step-timeout",
    type=POSITIVE,
    help="Wall time a step of an ADS may take, s (default: the file's, else 1).",
)
@RESUME
@click.option(
    "--shard", metavar="I/N", help="Simulate the I-th of N parts only; `merge` puts them together."
)
@click.option(
    "--only",
    multiple=True,
    metavar="CASE",
    help="Drive this case alone, e.g. cut_in-0042-idm; repeatable.",
)
@flag("--dry-run", help="Say how many drives it takes and how long, and simulate nothing.")
@ALL
@trusting
def run(
    evaluation: Path | None,
    out: Path | None,
    ads: tuple[str, ...],
    resume: bool,
    shard: str | None,
    dry_run: bool,
    everything: bool,
    **changes: Any,
) -> None:
    """Simulate and score EVALUATION: a TOML or .xosc file or a run (default: the paper's; with
    --resume, the run's own).
    """
    from sumo_eval.record.children import warm_up

    if evaluation is not None and not evaluation.is_dir():
        from sumo_eval.settings.config import read_evaluation

        # reports a mistake before the slow imports; with `--ads` the file needs no ADSs of its own
        read_evaluation(evaluation, own_ads=not ads)
    with heard():
        # another process loads the simulator during these imports, which take a second; a signal
        # that comes meanwhile is raised after them
        warm_up()
        from sumo_eval.evaluation import discard_trajectories, record_rounds
        from sumo_eval.record.estimate import estimate
        from sumo_eval.record.facts import parse_shard, resolve
        from sumo_eval.record.run_folder import is_run
        from sumo_eval.scenario.resolved import WHOLE

    part = WHOLE if shard is None else parse_shard(shard)
    for locator in ads:
        refuse_a_bare_file(locator)
    if changes["scheduler"] is not None and changes["engine"] is None:
        changes["engine"] = "dask"
    if out is None and (resume or part != WHOLE):
        raise click.UsageError("`--resume` and `--shard` need `--out`, the folder that is meant.")
    name = "paper" if evaluation is None else evaluation.stem
    folder = out or (Path() if dry_run else out_folder.default(name))  # a dry run writes nothing
    changes["only"] = changes["only"] or None  # None: without the option, the file's `only` holds
    resolved = replace(resolve(evaluation, folder, resume, ads, **changes), shard=part)
    if dry_run:
        tell(str(estimate(resolved, out if resume else None)))
        sys.exit(DONE)
    try:
        with Progress() as progress, stop_on_signal() as stopping:
            recorded = record_rounds(
                resolved, folder, resume=resume, progress=progress, stopping=stopping
            )
        say(recorded.notes)
        if part != WHOLE:
            _leave_shard(shard, folder, recorded.drives, recorded.not_evaluated)
        result = scored(folder, resolved=resolved)
    except KeyboardInterrupt:  # between two rounds, after the last drive, or while scoring
        if not is_run(folder):
            raise
        raise StoppedError(
            f"Stopped. The drives so far are recorded in {folder}; the same command with "
            f"--out {shlex.quote(str(folder))} --resume continues."
        ) from None
    discard_trajectories(result)
    finish(result, everything=everything)


def _leave_shard(shard: str | None, folder: Path, drives: int, failed: int) -> NoReturn:
    """Print the number of drives of a shard, and exit: `merge` scores all shards together.

    drives: number of recorded drives, references included.
    failed: number of those drives of ADSs that could not be evaluated.
    """
    from sumo_eval.report.words import count

    note = f", {count(failed, 'drive')} of ADSs not evaluated" if failed else ""
    tell(f"Shard {shard}: {drives} drives are recorded in {folder}{note}.")
    sys.exit(NOT_EVALUATED if failed else DONE)


@click.command(epilog="Example: sumo-eval score results/first --set method.score.a=60")
@RUN
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="e.g. method.score.a=60; may be repeated.",
)
@ALL
@trusting
def score(run: Path, changes: tuple[str, ...], everything: bool) -> None:
    """Score RUN again from its recorded facts, without a simulation."""
    from sumo_eval.record.children import warm_up

    # another process loads the simulator during the imports of `scored`, which take a second
    warm_up()

    result = scored(run, changes)
    note = (
        f"Scored with {', '.join(changes)} instead of the values in "
        f"{result.folder / 'evaluation.toml'}. report.html and scores.json show these scores; "
        "other commands use the settings of the file."
    )
    finish(result, [note] if changes else [], everything=everything)


@click.command(epilog="Example: sumo-eval merge part1 part2 --out results/whole")
@path_argument("shards", nargs=-1, required=True)
@path_option("--out", required=True, help="New folder for the whole run.")
@ALL
@trusting
def merge(shards: tuple[Path, ...], out: Path, everything: bool) -> None:
    """Put SHARDS, the folders of all parts that `run --shard` made, together into one run, and
    score it.
    """
    from sumo_eval.evaluation import discard_trajectories
    from sumo_eval.record.facts import merge as put_together

    say(put_together(shards, out).notes)
    result = scored(out)
    discard_trajectories(result)
    finish(result, everything=everything)


@click.command(epilog="Example: sumo-eval verify results/first --share 0.1")
@RUN
@click.option(
    "--share",
    type=Range(0.0, 1.0, min_open=True),
    default=0.1,
    show_default=True,
    help="Share of the drives that is simulated again.",
)
@count_option("--workers", help="Processes that simulate (default: as in the run).")
@trusting
def verify(run: Path, share: float, workers: int | None) -> None:
    """Simulate a share of RUN again, chosen by its seed.

    Exit status 1 when any drive differs in a single bit, or is out of date.
    """
    from sumo_eval.record.facts import verify as simulate_again

    with Progress() as progress:
        drives, differences = simulate_again(run, share, workers=workers, progress=progress)
    alike = defaultdict[str, list[str]](list)  # messages, by their reason without its numbers
    for case, why in differences:
        alike[without_numbers(why)].append(f"{case}: {why}.")
    for first, *rest in alike.values():
        say([f"{first} Likewise {len(rest)} more." if rest else first])
    if differences:
        tell(f"{len(differences)} of {drives} drives of {run} differ from the recorded ones.")
        sys.exit(GATE_FAILED)
    tell(f"{drives} drives of {run} simulated again, all the same to the bit.")
    sys.exit(DONE)
