"""Commands for runs over time: `compare`, `nightly`, `accept` and `trend`."""

import re
import sys
from collections.abc import Sequence
from datetime import datetime
from itertools import product
from pathlib import Path

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED
from sumo_eval.cli.finish import leave, scored, show_scores
from sumo_eval.cli.options import (
    GATE,
    WORKERS,
    count_option,
    flag,
    path_argument,
    path_option,
    trusting,
)
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import say, tell
from sumo_eval.cli.stopping import heard, stop_on_signal


@click.command(
    epilog="Example: sumo-eval compare results/before results/after --gate gate.toml --page "
    "compare.html"
)
@path_argument("base")
@path_argument("new")
@GATE
@path_option("--junit", help="Write gates and changed cases as JUnit XML.")
@click.option(
    "--pair",
    "pairs",
    multiple=True,
    metavar="BASE=NEW",
    help="ADSs that belong together; may be repeated.",
)
@flag("--accept-differences", help="Compare although settings or versions differ; they are shown.")
@path_option("--page", help="Write the comparison as a page of its own.")
@flag("--report", "with_report", help="Rewrite NEW/report.html, with the comparison first.")
@trusting
def compare(
    base: Path,
    new: Path,
    gate: Path | None,
    junit: Path | None,
    pairs: tuple[str, ...],
    accept_differences: bool,
    page: Path | None,
    with_report: bool,
) -> None:
    """Compare run NEW with run BASE, the same cases side by side, and apply a gate.

    Exit status: 0 the gate holds, 1 it does not, 2 the runs cannot be compared, 3 cases of NEW
    could not be evaluated.
    """
    from sumo_eval.evaluation import refuse_to_score
    from sumo_eval.nightly.gates import judge
    from sumo_eval.record.run_folder import trust_own_runs
    from sumo_eval.report.assessed import write_assessed_report
    from sumo_eval.report.comparison_lines import comparison_lines
    from sumo_eval.report.gate_result import failed
    from sumo_eval.report.junit import comparison_suites, write_junit
    from sumo_eval.report.verdict import Additions
    from sumo_eval.scoring.comparison import compare as compare_runs
    from sumo_eval.scoring.gate_settings import read_gate

    settings = read_gate(gate)
    trust_own_runs(base, new)  # one of them may name code that the other run makes trusted
    # a run that is incomplete or was changed is refused now: scoring the other may take hours
    for run in (base, new):
        refuse_to_score(run)
    partners = _partners(pairs, base, new)
    before, after = scored(base), scored(new)
    comparison = compare_runs(
        before, after, settings, pairs=partners, accept_differences=accept_differences
    )
    gates = judge(after, comparison, settings)
    if junit is not None:
        write_junit(comparison_suites(comparison, gates), junit)
    say(comparison_lines(comparison, gates, after))
    if page is not None:
        from sumo_eval.report.html import write_comparison

        tell(f"The page is {write_comparison(after, Additions(comparison, gates), page)}")
    if with_report:
        tell(f"The report is {write_assessed_report(after, Additions(comparison, gates))}")
    leave(after, GATE_FAILED if failed(gates) else DONE)


def _partners(pairs: Sequence[str], base: Path, new: Path) -> dict[str, str]:
    """ADS of the base -> ADS of the new run, from each --pair.

    pairs: BASE=NEW; both names may have a `=` in them.
    """
    from sumo_eval.errors import InputError, check_known
    from sumo_eval.record.run_folder import read_settings

    listed = " ".join(pairs)
    partners = []
    olds, news = ([ads.name for ads in read_settings(run).ads] for run in (base, new))
    for pair in pairs:
        split = re.fullmatch("(?s)(.+?)=(.+)", pair)  # at the first `=` that has text on both sides
        if split is None:
            raise InputError(f"A pair must have the form BASE=NEW, got {listed!r}.")
        # A `=` may be part of a name: the split into two known names is used. If there is none, the
        # first split is, which `check_known` refuses.
        known = (it for it in product(sorted(olds, key=len), news) if "=".join(it) == pair)
        old, now = next(known, split.groups())
        check_known("ADS", olds, old)
        check_known("ADS", news, now)
        partners.append((old, now))
    # `zip` gives two sides: all names of the base, and all names of the new run
    if any(len(set(side)) < len(partners) for side in zip(*partners, strict=True)):
        raise InputError(f"An ADS may stand in one --pair only, got {listed!r}.")
    return dict(partners)


@click.command(
    epilog="Example: sumo-eval nightly evaluation.toml --history nights --gate gate.toml"
)
@path_argument("evaluation", required=False)
@path_option("--history", required=True, help="Folder of the nights and their history.")
@GATE
@count_option("--keep", default=14, show_default=True, help="Nights whose folders stay.")
@WORKERS
@flag("--resume", help="Continue the night that was stopped before its end, if there is one.")
@click.option(
    "--newer-than",
    "age",
    metavar="AGE",
    help="Run nothing: exit 1 if the last finished night is older, e.g. 26h, 90m or 2d.",
)
@trusting
def nightly(
    evaluation: Path | None,
    history: Path,
    gate: Path | None,
    keep: int,
    workers: int | None,
    resume: bool,
    age: str | None,
) -> None:
    """Evaluate EVALUATION, compare with the last good and the accepted night, write report and a
    line of history.

    Exit status: 0 a good night, 1 a limit failed or cases went missing, 2 the input is wrong or a
    night is running already, 3 some cases could not be evaluated.
    """
    if age is not None:
        from sumo_eval.nightly.bases import finished_within

        recent, sentence = finished_within(history, age)
        tell(sentence)
        sys.exit(DONE if recent else GATE_FAILED)
    if evaluation is None:
        raise click.UsageError("Missing argument 'EVALUATION'.")
    with heard():
        from sumo_eval.record.children import warm_up

        warm_up()  # loads the simulator for the workers during the imports below
        from sumo_eval.nightly.morning import morning_lines, tell_github
        from sumo_eval.nightly.night import run_night
        from sumo_eval.report.comparison_lines import change_lines
        from sumo_eval.report.terminal import closing_lines
        from sumo_eval.scoring.gate_settings import read_gate

    settings = read_gate(gate)
    with Progress() as progress:
        result = run_night(
            evaluation, history, settings, keep=keep, workers=workers, resume=resume,
            progress=progress,
            stopping=stop_on_signal
        )  # fmt: skip
    say((*morning_lines(result), *result.notes))
    show_scores(result.evaluation)
    if comparison := result.judgement.bases.comparison:
        # verdict, differences and gates stand in `morning_lines`
        say(change_lines(comparison))
    say(closing_lines(result.evaluation))
    say(tell_github(result))
    tell(f"The report is {result.report}")
    tell(f"The trend is {result.trend}")
    leave(result.evaluation, result.night.exit_status)


@click.command(
    epilog='Example: sumo-eval accept nights --reason "brakes are softer on purpose" --until '
    "2026-12-31"
)
@path_argument("history")
@click.argument("run", required=False)
@click.option("--reason", required=True, help="Why; the history keeps it.")
@click.option(
    "--until",
    type=click.DateTime(["%Y-%m-%d"]),
    metavar="DATE",
    help="Last day on which it counts.",
)
def accept(history: Path, run: str | None, reason: str, until: datetime | None) -> None:
    """Accept night RUN of HISTORY, by default the newest, as the base that later nights are
    compared with.
    """
    from sumo_eval.nightly.bases import accept as accept_night

    last_day = None if until is None else until.date().isoformat()
    night, accepted, remaining = accept_night(history, run, reason, last_day)
    tell(f"Night {night.night} is accepted{f' until {last_day}' if last_day else ''}: {reason}")
    say(f"  accepted: {sentence}" for sentence in accepted)
    say(f"  not accepted, change the gate: {sentence}" for sentence in remaining)


@click.command(epilog="Example: sumo-eval trend nights")
@path_argument("history")
@path_option("--import", "runs", multiple=True, help="First add an older run; may be repeated.")
@trusting
def trend(history: Path, runs: tuple[Path, ...]) -> None:
    """Write HISTORY/trend.html: collisions, scores and run time of every ADS over the nights, with
    the gates.
    """
    from sumo_eval.nightly.history import open_history
    from sumo_eval.nightly.night import import_run
    from sumo_eval.nightly.trend import write_trend

    if runs:
        with Progress() as progress:
            for run in runs:  # one at a time: earlier ones are named even if a later one is refused
                night = import_run(history, run, progress)
                tell(f"Added {night.folder} as night {night.night}.")
    with open_history(history) as database:
        tell(str(write_trend(history, database)))
